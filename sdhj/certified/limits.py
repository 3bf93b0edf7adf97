"""What keeps a certified table small: its problem solved again on few cells, each time without one cause.

What a cell loses in one step comes back in the next as an image that is not covered, so no look at one state tells the
cause. A *copy* of the problem has coarser cells. Of these something is taken away:

* *rounding*, or without a target *creep*: images are rounded out to all cells that they overlap. Without it an image is
  what the centre of a cell may lead to, [a, b] on an axis in cells: those from floor(a + p) to floor(b + p), where p
  goes through `PHASES` from step to step, so that on the average nothing is added to it;
* *target*: only cells that are wholly in the target count. Without it those count of which the centre is;
* *clearance*: the tube of a whole cell has to stay clear of unsafe sets. Without it that of its centre. At an unsafe
  end it is the whole cell's in any case: a centre that leaves by half a cell would be back in its cell.

With all three taken away cells lose nearly nothing, and what a copy has then is about what the problem has. From such a
copy is taken away what is of the problem itself: *push*, the adversary; *noise*, what `Sensing` says of errors, delays
and jitter; *clearance* again, each unsafe set; and if nothing of all this is it, the number of steps and what inputs
cannot do. And to the copy that lacks nothing is added what a user might try: twice the cells along an axis, an interval
of twice the length or of half, a controller that remembers.

No copy is a proof, and all images of copies are boxes. What counts is what it has more than the copy that it was made
from.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np

from sdhj.certified.arrivals import HALVINGS, MOST_PIECES, Arrivals
from sdhj.certified.cells import CellAxis, aligned, axis_of, layers_of
from sdhj.certified.choosing import cost, speeds_of
from sdhj.certified.general_proof import GeneralProof, finest
from sdhj.certified.images import BOXES_OF_A_SET
from sdhj.certified.packing import Changes, Packing
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import is_constant
from sdhj.kernels import FloatArray, read_only
from sdhj.kernels.stencils import Moves
from sdhj.problem.cost import ENDLESS_STEPS
from sdhj.problem.findings import findings
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.solver.recursion import recursion

PHASES = (0.5, 0.125, 0.75, 0.375, 0.9375, 0.25, 0.625, 0.0625)  # each about as far from those before as can be
CELLS = frozenset({"rounding", "target", "clearance"})
EVERY = "more cells along every axis"
MOST_AXES = 3  # that are cut finer at once
LONGEST, EVER = 60, 1000  # steps of a copy, and for ever
SHARE, LEAST = 0.8, 1.2  # of the solve's time for all copies, by the model; and seconds that they always have
PLANNED = 1.2  # copies that are solved, about, for each axis and two more
# seconds, however few cells there are: of a solve, of an input in one interval, and of an entry
START, CALL, ENTRY = 3e-3, 8e-4, 3e-4  # of an input and an entry where all cells move alike
MOST_ENTRIES = 200  # after about so many nothing changes any more
ENOUGH = 0.5  # of what is missing without the losses of cells: a cause that gains so much is the last that is tried
MORE_STEPS = "more steps"
KINDS = ("cells", "problem", "reach", "finer", "all finer", "other")
COARSER, COARSEST, FEWEST = 1.25, 4.0, 4  # from one try of cells to the next, and at most; cells of an axis
MOST_SETS = 4  # unsafe sets that are taken away one at a time, if there are no more
GAINED, BESIDE = 0.002, 0.25  # of states; and of what the best of its kind gains: less is not said
FAR_BEHIND = 0.05  # likewise of what the problem without something gains, for what cells lose


@dataclass(frozen=True)
class CoarseProof(GeneralProof):
    """A recursion on coarse cells, as a proof makes it, from which some of what cells lose can be taken away.

    Its sets tell how much would be won without a loss; they prove nothing. `CELLS` names the losses: "rounding" of
    images to whole cells, goal cells that lie in the "target" only in part, and "clearance" of whole cells in place of
    their centres. So it also keeps how far the centres of cells may move. Made by `of`, which leaves the two last
    arrays empty, and given these by `dataclasses.replace`; filled by `prepare`. Then `without_losses` gives the same
    proof with some of its losses taken away; `add` counts the sets that it has made.

    Attributes
    ----------
    without : frozenset of str
        What of `CELLS` is taken away.
    of_centres : (starts, cells, bytes) uint8
        As `clear`, but a bit says that the tube of the cell's centre is clear.
    ends : (starts, L, places, ndim, 2) float32
        How far the lower and the upper ends of the cells at a place have moved at the interval's end, in the axes'
        units.
    most_boxes : int
        In how many boxes each unsafe set is asked for, fewer than in a proof.
    unites : bool
        False: boxes are counted, whatever their number (`GeneralProof.unites`).
    _without_sets : dict
        By the name of an unsafe set, the proof of the problem without this set and without all of `CELLS`, which has
        the images of this one and is prepared with it; empty unless `parted` has filled it.
    """

    without: frozenset[str] = frozenset()
    of_centres: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0), np.uint8))
    ends: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0, 0, 2), np.float32))
    most_boxes: ClassVar[int] = BOXES_OF_A_SET // 64
    unites: ClassVar[bool] = False
    _without_sets: "dict[str, CoarseProof]" = field(default_factory=dict)
    _rounded: dict[tuple[int, int], tuple[Moves, Packing]] = field(default_factory=dict)  # by start and phase
    _turn: list[int] = field(default_factory=lambda: [0, 0])  # how many sets have been made, and the phase

    def without_losses(self, *what: str) -> "CoarseProof":
        """This proof, which has been prepared, without the losses `what`, some of `CELLS`; nothing else is taken away.

        A new proof, which shares its arrays with this one.
        """
        clear = self.of_centres if "clearance" in what else self.clear
        return replace(self, without=frozenset(what), clear=clear, _rounded={}, _turn=[0, 0])

    def parted(self) -> "CoarseProof":
        """Fill `_without_sets` in place, unless there are more than `MOST_SETS` sets; returns this proof.

        To be called before `prepare`.
        """
        unsafe = self.problem.unsafe
        for one in unsafe if len({part.name for part in unsafe}) == len(unsafe) <= MOST_SETS else ():
            with suppress(ValueError):  # a problem needs something to stay clear of
                problem = replace(self.problem, unsafe=tuple(other for other in unsafe if other is not one))
                clear = np.full_like(self.clear, 255)
                self._without_sets[one.name] = replace(
                    self.without_losses(*CELLS), problem=problem, clear=clear, _without_sets={}
                )
        return self

    @property
    def phases(self) -> int:
        """After how many steps in a row without a change sets will not change any more (`Proof.phases`).

        The length of `PHASES` where rounding is taken away, as images then differ from step to step; else 1.
        """
        return len(PHASES) if "rounding" in self.without else 1

    def prepare(self, progress: bool | None) -> Packing:
        """Fill the arrays and make them read-only, unless that has been done; return the `Packing` that `add` needs.

        progress : not used, no bar is shown. ValueError where no bound on a velocity is found (`Images.swept`).
        """
        if not self.low.flags.writeable:
            return Packing(self)
        mark, of_centres = partial(self._mark_collisions, self._lattices(False)), self._lattices(False, True)
        mark_centres = [partial(self.without_losses("clearance")._mark_collisions, of_centres)]
        for name, without in self._without_sets.items():
            kept = [own for own, part in zip(of_centres, self._sets_tested_by_cell, strict=True) if part.name != name]
            mark_centres.append(partial(without._mark_collisions, kept))
        arrivals = Arrivals(self)

        def use(start: int, j: int, some: FloatArray, tubes: FloatArray, last: FloatArray) -> None:
            """Keep what the recursion needs of the places `some` (M,) under u_j, for cells and for centres.

            start : the index of the interval. tubes (M, parts, ndim, 2), last (M, ndim, 2) : how far the ends of cells
            move in each part and up to the interval's end (`Images.swept`).
            """
            mark(start, j, some, tubes)
            centred = self.centred(some, tubes)
            for of_some in mark_centres:
                of_some(start, j, some, centred, tubes)
            self.ends[start, j, some] = last
            arrivals.add(start, j, some, last)

        self.fill(int(finest(self.problem, self.parts, self.low.shape)), False, use)
        read_only((self.low, self.high, self.clear, self.of_centres, self.sites, self.arrives, self.ends))
        return Packing(self)

    def centred(self, places: FloatArray, ends: FloatArray) -> FloatArray:
        """How far the centres of the cells at places (M,) may move, from how far their ends do: both (M, ..., ndim, 2).

        Half of the cell's width is taken off at both sides. Where that would leave the lower end above the upper, both
        are the middle between them. In the axes' units.
        """
        cells = self.cells_at(places)
        half = np.stack([np.diff(axis.edges())[own] / 2 for axis, own in zip(self.axes, cells.T, strict=True)], axis=1)
        half = half.reshape(len(places), *[1] * (ends.ndim - 3), len(self.axes))
        low, high = ends[..., 0] + half, ends[..., 1] - half
        crossed = np.maximum(low - (high + 2 * half), 0.0) / 2  # where ends come nearer to each other
        return np.stack([low - crossed, high + crossed], axis=-1)

    def moves(self, step: int) -> Moves:
        """As `Images.moves`, the images of the interval from a step; without rounding, those of a phase of `PHASES`.

        The phase is that of the set that `add` is at. Computed once for each phase and interval.
        """
        return self._of_centres(step)[0] if "rounding" in self.without else super().moves(step)

    def _of_centres(self, step: int) -> tuple[Moves, Packing]:
        """The images of the interval from a step without rounding, in the phase that `moves` says, and a packing."""
        start, turn = min(step, len(self.low) - 1), self._turn[1]
        if (start, turn) not in self._rounded:
            self._rounded[start, turn] = self._moves_of_centres(start, PHASES[turn]), Packing(self)
        return self._rounded[start, turn]

    def _moves_of_centres(self, start: int, phase: float) -> Moves:
        """The images of the centres in one interval, shifted by phase - 1/2 of a cell and rounded out: `Moves`.

        Clipped to the images of the whole cells.

        start : the index of the interval in `low` and `high`. phase : from 0 to 1.
        """
        low, high = np.empty((2, *self.low.shape[1:]), np.int16)
        places, width = np.arange(self.low.shape[2]), np.array([float(axis.width) for axis in self.axes])
        for j, ends in enumerate(self.ends[start]):
            found = self.in_cells(places, self.centred(places, ends.astype(float)) + (phase - 0.5) * width[:, None])
            low[j], high[j] = (np.clip(one, self.low[start, j], self.high[start, j]) for one in found)
        return Moves(*read_only((low, high)), self.strides, self.open_ends)

    def add(self, prepared: Any, cells: FloatArray, following: FloatArray, step: int, changed: Changes) -> None:
        """As `sdhj.certified.general_proof.GeneralProof.add`, turn `cells`, S_k^{n-1}, into S_k^n, in place.

        k is `step`, and `following` S_{k+1}^{n-1}. Without rounding `prepared` and `changed` are not used, and all
        cells are asked about: their images are others than in the step before. Their phase is that with number `step`
        or, where nothing depends on time, with the number of calls so far, both modulo the length of `PHASES`.
        """
        if self.phases > 1:  # its moves are those of a turn
            self._turn[1] = (self._turn[0] if self.time_invariant else step) % len(PHASES)
            prepared, changed = self._of_centres(step)[1], None
        super().add(prepared, cells, following, step, changed)
        self._turn[0] += 1

    def over_cells(self, part: Any, times: tuple[float, float]) -> FloatArray:
        """As `Images.over_cells`, the sign of a set's level-set function in all of each cell.

        For the target, if "target" is taken away, -1 also for each cell whose centre is in it.
        """
        found = super().over_cells(part, times)
        if "target" not in self.without or part is not self.problem.target:
            return found
        middles = [np.convolve(self.axes[k].edges(), [0.5, 0.5], "valid") for k in part.axes]
        centres = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, len(part.axes))
        off = (self.shell + self.prediction_error)[list(part.axes)]
        inside = self.bounds.inside(part, centres - off, centres + off, times, HALVINGS, MOST_PIECES)
        return np.where(inside.reshape(found.shape), -1, found)


class Trial(NamedTuple):
    """A copy that may be solved, made from another one by taking something away or adding something.

    kind : "cells", what cells lose; "problem", what is taken away from the problem; "reach", what may bring in states
        that nothing else does; "finer" and "all finer", cells that are added; "other", what else is.
    cause : what is taken away, in words for the user; "" if something is added.
    helps : what is added or, if something is taken away, what helps against it; "" if that is not known.
    proof : makes the copy's proof; it raises ValueError or MemoryError where there is none.
    seconds : what that takes and its solve, by the model.
    """

    kind: str
    cause: str
    helps: str
    proof: Callable[[], CoarseProof]
    seconds: float


class Gain(NamedTuple):
    """How many states are won by what was taken away, or added.

    name, helps : `cause` and `helps` of the copy (`Trial`).
    before, then : the shares of the states, from 0 to 1, in the tubes of the copy before the change and after it.
    """

    name: str
    helps: str
    before: float
    then: float

    @property
    def more(self) -> float:
        """By how much the share grows."""
        return self.then - self.before


class Limits:
    """The coarse copies of a table's problem, and which of the changes to it gain states.

    A copy is solved once it is asked about and may matter, and kept. All of them together take about as long as the
    table's solve, by the model of `sdhj.certified.choosing`, or `LEAST`.

    Attributes
    ----------
    problem : ReachAvoidProblem
        Of the copies: the table's, with no more steps than a copy takes.
    axes : tuple of CellAxis
        The cells of each axis.
    plain, free : CertifiedTable
        Of the copy that lacks nothing, and of the one without all that cells lose.
    left : float
        The seconds that may still be taken, by the model.
    """

    def __init__(self, table: Any, sets: Callable[..., Any]) -> None:
        """Solve the two copies `plain` and `free` of a table's problem.

        At most `LONGEST` steps are solved of a problem that does not depend on time, and `EVER` for ever. Warnings and
        findings of the solves are dropped.

        table : the `CertifiedTable`. sets : the class `CellSets`, which solves.

        Raises
        ------
        ValueError, MemoryError
            As `sdhj.Certified.sets`. A table of the arm's case study may raise them too: its own proof needs less
            than the `GeneralProof` of its copies.
        """
        problem, self.sets, self.parts = table.problem, sets, table.proof.parts
        self.settled = bool(table.details.get("endless"))
        self.endless = self.settled and problem.has_no_target
        steps = EVER if self.endless else min(problem.steps, LONGEST) if problem.time_invariant else problem.steps
        self.problem = replace(problem, recipe={}, steps=steps)
        self._tables: dict[tuple[str, str], Any] = {}  # by the cause and what helps; None where there is none
        with _quiet():
            self.axes, self.left = self._coarse_cells(table)
            self._base = self._proof(self.problem, self.axes, parted=True)
            self.plain, self.free = self._solved(self._base), self._solved(self._base.without_losses(*CELLS))
        first, rest = self._seconds(self.axes)
        self.left = max(self.left - first - 2 * rest, self.left / 2)  # what these two took may be more

    @property
    def cells(self) -> str:
        """The numbers of cells that the copies have along each axis, as a text such as "20 x 30"."""
        return " x ".join(str(axis.count) for axis in self.axes)

    @property
    def tried(self) -> list[tuple[str, str]]:
        """(cause, helps) of all copies that have been solved besides the first two."""
        return [key for key, table in self._tables.items() if table is not None]

    def gains(self, states: FloatArray, step: int, within: int) -> tuple[list[Gain], list[Gain]]:
        """What limits the table at some states, and what would gain some if added: (causes, added), lists of `Gain`.

        In both the one that gains most is first; those that gain little (`_largest`) are left out, so a list may be
        empty. What may gain most is tried first. What cells lose is not, nor more cells along one axis, where `free`
        shows that it is little, and no more is taken away from the problem once one thing gains `ENOUGH` of what `free`
        lacks.

        states (M, ndim) : M > 0. step : of the problem. within : the steps to go.
        """
        share = partial(self._share, states, step, within)
        kept, free = share(self.plain), share(self.free)
        lost, beyond = free - kept, 1.0 - free  # the most that cells can gain, and that all else can
        found: dict[str, list[Gain]] = {kind: [] for kind in KINDS}

        def matters(kind: str) -> bool:
            """Whether a trial of this kind may still be told of."""
            most = max((own.more for own in found["problem"]), default=0.0)
            if kind == "problem":
                return beyond >= max(GAINED, BESIDE * lost) and most < ENOUGH * beyond
            if kind == "reach":
                return all(own.more < max(GAINED, FAR_BEHIND * beyond) for some in found.values() for own in some)
            if kind == "all finer":  # also where little is lost: on few cells even `free` may lack what more cells have
                return not _largest(found["finer"], FAR_BEHIND * lost)
            return kind == "other" or lost >= max(GAINED, FAR_BEHIND * most)

        for trial in self._trials(lost >= beyond):
            if matters(trial.kind) and (table := self._table(trial)) is not None:
                more = 0 if trial.helps != MORE_STEPS else self.problem.steps
                then = self._share(states, step, within + more, table) if more else share(table)
                before = free if trial.kind in ("problem", "reach") else kept
                found[trial.kind].append(Gain(trial.cause, trial.helps, before, then))
        together, others = Gain("wide cells", "", kept, free), found["problem"] + found["reach"]
        most = max((own.more for own in others), default=0.0)
        causes = _largest(found["cells"], FAR_BEHIND * most) or _largest([together], FAR_BEHIND * most)
        causes += _largest(others, BESIDE * max(own.more for own in (*found["cells"], together)))
        every = max([own.more for own in causes], default=0.0)
        added = _largest(found["finer"] + found["all finer"] + found["other"], FAR_BEHIND * every)
        return sorted(causes, key=lambda own: -own.more), added

    def reached(self, states: FloatArray, step: int, within: int) -> float:
        """The share of states (M, ndim) that the copy without all that cells lose has, from 0 to 1."""
        return self._share(states, step, within, self.free)

    def _share(self, states: FloatArray, step: int, within: int, table: Any) -> float:
        """The share of states (M, ndim) that the tube (step, within) of a copy's table contains, from 0 to 1.

        step, within : of the problem; a copy may have other intervals; as many whole ones count as there are.
        """
        longer = table.problem.delta / self.problem.delta
        step = 0 if table.problem.time_invariant else min(int(step / longer), table.steps)
        within = table.steps if self.endless else min(int(within / longer), table.steps - step)
        return float(1 - table.outside(states, step, within).mean())

    # ---- the copies

    def _coarse_cells(self, table: Any) -> tuple[tuple[CellAxis, ...], float]:
        """The cells of each axis of the copies, and the seconds that all may take.

        The table's cells, or fewer, so that about as many copies as are solved take no longer; those that take least
        where none are few enough, as what unsafe sets and calls cost does not shrink with the cells. At most `COARSEST`
        times as wide as the table's, and at least `FEWEST` along an axis.
        """
        few, speeds, many = table.axes, speeds_of(self.problem), PLANNED * (len(table.axes) + 2)
        settles = replace(self.problem, steps=min(self.problem.steps or ENDLESS_STEPS, ENDLESS_STEPS))
        self._model = partial(cost, settles, parts=self.parts, speeds=speeds, boxes=CoarseProof.most_boxes)
        own = table.proof.seconds if not isinstance(table.proof, GeneralProof) else sum(self._seconds(few, False))
        most, tried, factor = max(SHARE * own, LEAST), list[tuple[float, Any]](), 1.0
        while factor <= COARSEST:
            tried.append((many * sum(self._seconds(few)), few))
            if tried[-1][0] <= most:
                return few, most
            factor *= COARSER
            wished = [max(round(axis.count / factor), FEWEST) for axis in table.axes]
            few = aligned(self.problem, wished)
        return min(tried, key=lambda one: one[0])[1], most

    def _seconds(self, axes: tuple[CellAxis, ...], copied: bool = True) -> tuple[float, float]:
        """The seconds that the proof and the recursion of cells `axes` take by the model, with those of each call.

        copied : of a copy; False: of the table itself.
        """
        problem, entries = self.problem, self.problem.steps or ENDLESS_STEPS
        first, rest = self._model(axes) if copied else self._model(axes, boxes=BOXES_OF_A_SET)
        times = 1 if problem.time_invariant else problem.steps
        calls = len(problem.inputs) * times * (1 + len(problem.unsafe))
        entries = min(entries, MOST_ENTRIES) if problem.time_invariant else entries * (entries + 1) // 2
        entries *= len(problem.inputs) if problem.dynamics.constant else 1
        return first + CALL * calls, rest + START + ENTRY * entries

    def _trials(self, cells_first: bool) -> Iterator[Trial]:
        """Yield what may be tried, in the order of worth: what cells lose and more cells first, or the problem."""
        if cells_first:
            yield from self._of_cells()
        yield from self._of_problem()
        if not cells_first:
            yield from self._of_cells()
        yield from self._of_intervals()
        yield from self._of_reach()
        problem, axes = self.problem, self.axes
        if 1 < len(axes) <= MOST_AXES:
            every = tuple(self._finer(k) for k in range(len(axes)))
            yield Trial("all finer", "", EVERY, partial(self._proof, problem, every), sum(self._seconds(every)))

    def _of_cells(self) -> Iterator[Trial]:
        """Yield copies without one of the losses of cells, and with twice the cells along one axis."""
        rest = self._seconds(self.axes)[1]
        names = {"rounding": "creep" if self.problem.has_no_target else "rounding"}
        names |= {} if self.problem.has_no_target else {"target": "whole cells of the target"}
        for one, name in (names | {"clearance": "clearance of whole cells"}).items():
            yield Trial("cells", name, "", lambda one=one: self._base.without_losses(one), rest)  # type: ignore[misc]
        for k, name in enumerate(self.problem.grid.names):
            axes = (*self.axes[:k], self._finer(k), *self.axes[k + 1 :])
            proof = partial(self._proof, self.problem, axes)
            yield Trial("finer", "", f"more cells along {name}", proof, sum(self._seconds(axes)))

    def _of_problem(self) -> Iterator[Trial]:
        """Yield copies of which something is taken away from the problem, and nothing is lost to cells.

        The push, the errors of a `Sensing`, and each unsafe set where there are at most `MOST_SETS`; what the problem
        does not have is left out.
        """
        problem, (first, rest), freed = self.problem, self._seconds(self.axes), self._freed
        if not all(is_constant(one, 0.0) for one in problem.dynamics.bounds.outputs):
            helps, calm = "a smaller disturbance or stronger inputs", freed(dynamics=problem.dynamics.undisturbed)
            yield Trial("problem", "push", helps, calm, first + rest)
        if problem.sensing:
            yield Trial("problem", "noise", "a smaller error, delay or jitter", freed(sensing=Sensing), first + rest)
        names = [one.name for one in problem.unsafe] if len(problem.unsafe) <= MOST_SETS else []
        for name in names:
            cause, helps = f"clearance of {name!r}", f"more room beside {name!r}"
            yield Trial("problem", cause, helps, lambda name=name: self._without(name), rest)  # type: ignore[misc]

    def _of_reach(self) -> Iterator[Trial]:
        """Yield copies of twice the steps, and of twice as strong inputs, of which nothing is lost to cells."""
        problem, (first, rest) = self.problem, self._seconds(self.axes)
        if problem.time_invariant and not problem.has_no_target and not self.settled and problem.steps < LONGEST:
            longer = partial(replace, problem, steps=2 * problem.steps)
            proof = lambda: replace(self._base.without_losses(*CELLS), problem=longer())  # noqa: E731
            yield Trial("reach", "few steps", MORE_STEPS, proof, 2 * rest)
        if isinstance(problem.dynamics.drift, Formula) and problem.dynamics.gain is not None:
            strong = self._freed(dynamics=problem.dynamics.stronger)
            yield Trial("reach", "weak inputs", "stronger inputs", strong, first + rest)

    def _freed(self, **change: Callable[[], Any]) -> Callable[[], CoarseProof]:
        """What makes the proof of the problem without the losses of cells, with fields made by what is given."""

        def made() -> CoarseProof:
            """The prepared proof of the problem with these fields."""
            fields = {name: field() for name, field in change.items()}
            return self._proof(replace(self.problem, **fields), self.axes).without_losses(*CELLS)

        return made

    def _of_intervals(self) -> Iterator[Trial]:
        """Yield copies with a controller that remembers, and with an interval of twice the length and of half."""
        problem, (first, rest) = self.problem, self._seconds(self.axes)
        if problem.sensing and not problem.sensing.remembers:
            memory = replace(problem.sensing, memory=True)
            yield self._other("Sensing(..., memory=True) and Controller.step", first + rest, sensing=memory)
        steps = cast(int, problem.steps)
        yield self._other("a longer interval", first + rest, delta=2 * problem.delta, steps=max(steps // 2, 1))
        entries = 2 if problem.time_invariant else 4
        yield self._other("a shorter interval", first + entries * rest, delta=problem.delta / 2, steps=2 * steps)

    def _other(self, helps: str, seconds: float, **change: Any) -> Trial:
        """The trial of the problem with fields changed, which cells lose as much of as before."""
        return Trial("other", "", helps, lambda: self._proof(replace(self.problem, **change), self.axes), seconds)

    def _without(self, name: str) -> CoarseProof:
        """The proof of the problem without an unsafe set, by its name; ValueError where there is none."""
        if name not in self._base._without_sets:
            raise ValueError(f"nothing is left to stay clear of without {name!r}")
        return self._base._without_sets[name]

    def _finer(self, k: int) -> CellAxis:
        """The cells of axis k, half as wide."""
        return axis_of(self.problem.grid, k, self.axes[k].width / 2, self.axes[k].layers)

    def _table(self, trial: Trial) -> Any:
        """The table of a trial's copy, solved at first use; None where its problem or its proof is refused.

        None as well where no time is `left` for it.
        """
        key = trial.cause, trial.helps
        if key not in self._tables and trial.seconds <= self.left:
            self.left, self._tables[key] = self.left - trial.seconds, None
            with _quiet(), suppress(ValueError, MemoryError):
                self._tables[key] = self._solved(trial.proof())
        return self._tables.get(key)

    def _proof(self, problem: ReachAvoidProblem, axes: Sequence[CellAxis], parted: bool = False) -> CoarseProof:
        """The `CoarseProof` of a problem, prepared, with cells as wide as those of `axes`.

        Layers are those that the problem has, whatever those of `axes`. ValueError and MemoryError as for `Limits`.

        parted : whether `CoarseProof._without_sets` is filled.
        """
        grid = problem.grid
        own = tuple(axis_of(grid, k, axis.width, layers_of(problem, k)) for k, axis in enumerate(axes))
        proof: Any = CoarseProof.of(problem, own, self.parts)
        ends = np.zeros((*proof.low.shape, 2), np.float32)
        copy: CoarseProof = replace(proof, of_centres=proof.clear.copy(), ends=ends)
        (copy.parted() if parted else copy).prepare(False)
        return copy

    def _solved(self, proof: CoarseProof) -> Any:
        """Solve a copy by its proof, which is prepared, and return its table."""
        sets = self.sets(proof, False)
        recursion(sets, proof.problem.most_steps, lambda: None)
        return sets.finish({})


@contextmanager
def _quiet() -> Iterator[None]:
    """A context in which warnings and findings are dropped."""
    with warnings.catch_warnings(), findings():
        warnings.simplefilter("ignore")
        yield


def _largest(gains: Sequence[Gain], least: float = 0.0) -> list[Gain]:
    """The gains of at least `least`, of `GAINED`, and of the share `BESIDE` of the largest, the largest first.

    gains : in any order, possibly none.
    """
    least = max([least, GAINED, *(BESIDE * own.more for own in gains)])
    return sorted((own for own in gains if own.more >= least), key=lambda own: -own.more)
