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
and jitter; *clearance* again, each unsafe set. And to the copy that lacks nothing is added what a user might try: twice
the cells along an axis, an interval of twice the length, a controller that remembers.

No copy is a proof, and all images of copies are boxes. What counts is what it has more than the copy that it was made
from.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
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
SHARE, LEAST = 1 / 3, 2.0  # of the solve's time for all copies, by the model; and seconds that they always have
COARSER, FEWEST, LITTLE = 1.25, 4, 0.98  # from one try of cells to the next; cells of an axis; what is no gain of time
MOST_SETS = 4  # unsafe sets that are taken away one at a time, if there are no more
GAINED, BESIDE = 0.002, 0.25  # of states; and of what the best of its kind gains: less is not said
FAR_BEHIND = 0.05  # likewise of what the problem without something gains, for what cells lose


@dataclass(frozen=True)
class Copy(GeneralProof):
    """A recursion on coarse cells, as a proof makes it, from which some of what cells lose can be taken away.

    Its sets tell how much would be won without a loss; they prove nothing. `CELLS` names the losses: "rounding" of
    images to whole cells, goal cells that lie in the "target" only in part, and "clearance" of whole cells in place of
    their centres. So it also keeps how far the centres of cells may move. Made by `of`, which leaves the two last
    arrays empty, and given these by `dataclasses.replace`; filled by `prepare`. Then `taking` gives the same proof
    with some of its losses taken away; `add` counts the sets that it has made.

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
    """

    without: frozenset[str] = frozenset()
    of_centres: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0), np.uint8))
    ends: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0, 0, 2), np.float32))
    most_boxes: ClassVar[int] = BOXES_OF_A_SET // 64
    unites: ClassVar[bool] = False
    _rounded: dict[tuple[int, int], Moves] = field(default_factory=dict)  # by start and phase
    _turn: list[int] = field(default_factory=lambda: [0])  # how many sets have been made, where they are of no step

    def taking(self, *what: str) -> "Copy":
        """This proof, which has been prepared, without the losses `what`, some of `CELLS`; nothing else is taken away.

        A new proof, which shares its arrays with this one.
        """
        clear = self.of_centres if "clearance" in what else self.clear
        return replace(self, without=frozenset(what), clear=clear, _rounded={}, _turn=[0])

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
        mark = partial(self._mark_collisions, self._lattices(False))
        mark_centres = partial(self.taking("clearance")._mark_collisions, self._lattices(False, True))
        arrivals = Arrivals(self)

        def use(start: int, j: int, some: FloatArray, tubes: FloatArray, last: FloatArray) -> None:
            """Keep what the recursion needs of the places `some` (M,) under u_j, for cells and for centres.

            start : the index of the interval. tubes (M, parts, ndim, 2), last (M, ndim, 2) : how far the ends of cells
            move in each part and up to the interval's end (`Images.swept`).
            """
            mark(start, j, some, tubes)
            mark_centres(start, j, some, self.centred(some, tubes), tubes)
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

        The phase is that with number `step` or, where nothing depends on time, that with the number of sets made so
        far, both modulo the length of `PHASES`. Computed once for each phase and interval.
        """
        if "rounding" not in self.without:
            return super().moves(step)
        start, turn = min(step, len(self.low) - 1), (self._turn[0] if self.time_invariant else step) % len(PHASES)
        if (start, turn) not in self._rounded:
            self._rounded[start, turn] = self._moves_of_centres(start, PHASES[turn])
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
        return Moves(low, high, self.strides, self.past)

    def add(self, prepared: Any, cells: FloatArray, following: FloatArray, step: int, changed: Changes) -> None:
        """As `sdhj.certified.general_proof.GeneralProof.add`, turn `cells`, S_k^{n-1}, into S_k^n, in place.

        k is `step`, and `following` S_{k+1}^{n-1}. Without rounding `prepared` and `changed` are not used, and all
        cells are asked about: their images are others than in the step before. Each call is counted, as `moves` goes by
        how many sets have been made.
        """
        if self.phases > 1:  # its moves are those of a turn
            prepared, changed = Packing(self), None
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


class Tried(NamedTuple):
    """A copy that was solved, and the copy that it was made from by taking something away or adding something.

    cause : what was taken away, in words for the user; "" if something was added.
    helps : what was added or, if something was taken away, what helps against it; "" if that is not known.
    table : the copy's table. before : the table of the copy that it was made from.
    """

    cause: str
    helps: str
    table: Any
    before: Any


class Gain(NamedTuple):
    """How many states are won by what was taken away, or added.

    name, helps : `cause` and `helps` of the copy (`Tried`).
    before, then : the shares of the states, from 0 to 1, in the tubes of the copy before the change and after it.
    """

    name: str
    helps: str
    before: float
    then: float


class Limits:
    """The coarse copies of a table's problem, and which of the changes to it gain states.

    All copies are solved when it is made, which takes seconds; `gains` then answers for any states.
    """

    def __init__(self, table: Any, sets: Callable[..., Any]) -> None:
        """Solve all copies of a table's problem, with so few cells that it takes a share `SHARE` of the table's solve.

        Or `LEAST` seconds where that is more, both by the model of `sdhj.certified.choosing`. At most `LONGEST` steps
        are solved of a problem that does not depend on time, and `EVER` for ever. Warnings and findings of the solves
        are dropped.

        table : the `CertifiedTable`. sets : the class `CellSets`, which solves.

        Raises
        ------
        ValueError, MemoryError
            As `sdhj.Certified.sets`. A table of the arm's case study may raise them too: its own proof needs less
            than the `GeneralProof` of its copies.
        """
        problem, self.sets, self.parts = table.problem, sets, table.proof.parts
        self.ever = bool(table.details.get("endless") and problem.has_no_target)
        steps = EVER if self.ever else min(problem.steps, LONGEST) if problem.time_invariant else problem.steps
        self.problem = replace(problem, recipe={}, steps=steps)
        with warnings.catch_warnings(), findings():
            warnings.simplefilter("ignore")
            self.axes = self._few(table)
            self.tried = tuple(self._copies())

    @property
    def cells(self) -> str:
        """The numbers of cells that the copies have along each axis, as a text such as "20 x 30"."""
        return " x ".join(str(axis.count) for axis in self.axes)

    def gains(self, states: FloatArray, step: int, within: int) -> tuple[list[Gain], list[Gain]]:
        """What limits the table at some states, and what would gain some if added: (causes, added), lists of `Gain`.

        In both the one that gains most is first; those that gain little (`_most`) are left out, so a list may be empty.

        states (M, ndim) : M > 0. step : of the problem. within : the steps to go.
        """
        every = [
            Gain(one.cause, one.helps, *(self._share(own, states, step, within) for own in (one.before, one.table)))
            for one in self.tried
        ]
        added = _most([own for own in every if not own.name])
        if any(own.helps.startswith("more cells") and own.helps != EVERY for own in added):
            added = [own for own in added if own.helps != EVERY]
        cells = [own for own, one in zip(every, self.tried, strict=True) if own.name and one.before is self.plain]
        others = [own for own, one in zip(every, self.tried, strict=True) if one.before is not self.plain]
        together = cells.pop()  # all that cells lose, of which one thing alone says more
        most = max((own.then - own.before for own in others), default=0.0)
        causes = _most(cells, FAR_BEHIND * most) or _most([together], FAR_BEHIND * most)
        causes += _most(others, BESIDE * max(own.then - own.before for own in (*cells, together)))
        return sorted(causes, key=lambda own: own.before - own.then), added

    def _share(self, table: Any, states: FloatArray, step: int, within: int) -> float:
        """The share of states (M, ndim) that the tube (step, within) of a copy's table contains, from 0 to 1.

        step, within : of the problem; a copy may have fewer and longer steps; as many whole ones count as there are.
        """
        longer = round(table.problem.delta / self.problem.delta)
        step = 0 if table.problem.time_invariant else min(step // longer, table.steps)
        within = table.steps if self.ever else min(within // longer, table.steps - step)
        return float(1 - table.outside(states, step, within).mean())

    # ---- the copies

    def _few(self, table: Any) -> tuple[CellAxis, ...]:
        """The cells of each axis of the copies: the table's, or fewer, so that all copies take as long as they may.

        At least `FEWEST` along an axis, and no fewer once that saves no more time (`Limits`).
        """
        problem, speeds, few, ndim = self.problem, speeds_of(self.problem), table.axes, len(table.axes)
        problems, cells = 2 + sum(1 for _ in self._lesser()), 2 * ndim + 2**ndim * (ndim <= MOST_AXES)
        settles = replace(problem, steps=min(problem.steps or ENDLESS_STEPS, ENDLESS_STEPS))
        model = partial(cost, settles, parts=self.parts, speeds=speeds)
        own = sum(model(few)) if isinstance(table.proof, GeneralProof) else 0.0  # that of the arm takes far less
        (first, rest), before, factor = model(few, boxes=Copy.most_boxes), np.inf, 1.0
        # what unsafe sets cost does not shrink with the cells
        while (problems + cells) * (first + rest) + 3 * problems * rest > max(SHARE * own, LEAST) and first < before:
            factor, before = factor * COARSER, LITTLE * first
            few = aligned(problem, [max(round(axis.count / factor), FEWEST) for axis in table.axes])
            first, rest = model(few, boxes=Copy.most_boxes)
        return few

    def _copies(self) -> Iterator[Tried]:
        """Solve the copies and yield each but the first, which is kept as `plain`, with the one that it was made from.

        First those without something of what cells lose, the last of them without all of it; of this one those without
        something of the problem; and at last those of `plain` with something added. Of the last two kinds those are
        left out whose problem or proof is refused.
        """
        proof, ever = self._proof(self.problem, self.axes), self.problem.has_no_target
        self.plain = plain = self._solved(proof)
        yield Tried("creep" if ever else "rounding", "", self._solved(proof.taking("rounding")), plain)
        if not ever:
            yield Tried("whole cells of the target", "", self._solved(proof.taking("target")), plain)
        yield Tried("clearance of whole cells", "", self._solved(proof.taking("clearance")), plain)
        free = self._solved(proof.taking(*CELLS))
        yield Tried("wide cells", "", free, plain)
        for cause, helps, change in self._lesser():
            with suppress(ValueError, MemoryError):  # a problem that there is not, or of which nothing can be proved
                proof = self._proof(replace(self.problem, **change), self.axes)
                yield Tried(cause, helps, self._solved(proof.taking(*CELLS)), free)
        for helps, change, axes in self._further():
            with suppress(ValueError, MemoryError):
                yield Tried("", helps, self._solved(self._proof(replace(self.problem, **change), axes)), plain)

    def _lesser(self) -> Iterator[tuple[str, str, dict[str, Any]]]:
        """Yield what may be taken away from the problem, one thing at a time: (its name, what helps, fields).

        The push, the errors of a `Sensing`, and each unsafe set where there are at most `MOST_SETS`; what the problem
        does not have is left out. fields : the keywords by which `dataclasses.replace` makes the problem without it.
        """
        problem = self.problem
        if not all(is_constant(one, 0.0) for one in problem.dynamics.bounds.outputs):
            yield "push", "a smaller disturbance or stronger inputs", {"dynamics": problem.dynamics.undisturbed()}
        if problem.sensing:
            yield "noise", "a smaller error, delay or jitter", {"sensing": Sensing()}
        for one in problem.unsafe if len(problem.unsafe) <= MOST_SETS else ():
            rest = [other for other in problem.unsafe if other is not one]
            yield f"clearance of {one.name!r}", f"more room beside {one.name!r}", {"unsafe": rest}

    def _further(self) -> Iterator[tuple[str, dict[str, Any], tuple[CellAxis, ...]]]:
        """Yield what may be added: (what it is, in words, the problem's changed fields, the cells of each axis)."""
        problem, axes, every = self.problem, self.axes, list[CellAxis]()
        for k, name in enumerate(problem.grid.names):
            finer = axis_of(problem.grid, k, axes[k].width / 2, axes[k].layers)
            every.append(finer)
            yield f"more cells along {name}", {}, (*axes[:k], finer, *axes[k + 1 :])
        if 1 < len(axes) <= MOST_AXES:
            yield EVERY, {}, tuple(every)
        yield "a longer interval", {"delta": 2 * problem.delta, "steps": max(cast(int, problem.steps) // 2, 1)}, axes
        if problem.sensing and not problem.sensing.remembers:
            remembers = replace(problem.sensing, memory=True)
            yield "Sensing(..., memory=True) and Controller.step", {"sensing": remembers}, axes

    def _proof(self, problem: ReachAvoidProblem, axes: Sequence[CellAxis]) -> Copy:
        """The `Copy` of a problem, prepared, with cells as wide as those of `axes`.

        Layers are those that the problem has, whatever those of `axes`. ValueError and MemoryError as for `Limits`.
        """
        grid = problem.grid
        own = tuple(axis_of(grid, k, axis.width, layers_of(problem, k)) for k, axis in enumerate(axes))
        proof: Any = Copy.of(problem, own, self.parts)
        ends = np.zeros((*proof.low.shape, 2), np.float32)
        copy: Copy = replace(proof, of_centres=proof.clear.copy(), ends=ends)
        copy.prepare(False)
        return copy

    def _solved(self, proof: Copy) -> Any:
        """Solve a copy by its proof, which is prepared, and return its table."""
        sets = self.sets(proof, False)
        recursion(sets, proof.problem.most_steps, lambda: None)
        return sets.finish({})


def _most(gains: Sequence[Gain], least: float = 0.0) -> list[Gain]:
    """The gains of at least `least`, of `GAINED`, and of the share `BESIDE` of the largest, the largest first.

    gains : in any order, possibly none.
    """
    least = max([least, GAINED, *(BESIDE * (own.then - own.before) for own in gains)])
    return sorted((own for own in gains if own.then - own.before >= least), key=lambda own: own.before - own.then)
