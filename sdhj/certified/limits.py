"""What keeps a certified table small, and what would help: its problem solved again, on a grid and on few cells.

A state that a table lacks is kept out by the problem itself or by its cells, and what a cell loses in one step comes
back in the next, so no look at one state tells which. Method "hji" does: nothing is rounded to whole cells there, so a
grid of few nodes has about what finer and finer cells come to.

* Where the grid has the state, cells keep it out: *rounding*, of images, of the target and of the clearance to whole
  cells, which is called *creep* without a target. What may help is tried on *copies*, the same problem with fewer and
  wider cells: twice as many along an axis, and an interval of twice the length. As a copy may have less than the table,
  what counts is what it gains of all that the grid has, not whether it has the state.
* Where the grid lacks it, the problem is solved on the grid without one thing at a time: *push*, the adversary;
  *noise*, what `Sensing` says of errors, delays and jitter; *clearance*, each unsafe set. If nothing of this is it,
  with twice the steps, with stronger inputs, with an interval of half the length.

None of these solves is a proof. Of a state that the grid lacks but has within a node, nothing is known (`decided`).
"""

import itertools
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sdhj.certified.cells import CellAxis, aligned, axis_of, layers_of
from sdhj.certified.general_proof import GeneralProof
from sdhj.certified.images import BOXES_OF_A_SET
from sdhj.common.findings import findings
from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import is_constant
from sdhj.kernels import FloatArray
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.solver.methods import HJI
from sdhj.solver.recursion import recursion

FEW_NODES, FEWEST_NODES, FINER = 5_000, 5, 4.0  # of a grid; along an axis; and there for each cell, at most
WORK = 1.5e6  # nodes x inputs x tubes: fewer nodes where this would be more
ENDLESS_STEPS = 100  # that are counted where a problem has no number of steps
FEW_CELLS, FEWEST = 10_000, 4  # of a copy, and along an axis
SHARE_OF_NODES, SHARE_OF_CELLS = 100, 16  # of so many cells one is a node's, or a copy's, where that is more
MOST_NODES = 1_000_000  # that this gives: nine times as many took as long as the solve of the arm's case study
MOST_STEPS = 1000  # that are solved where nothing depends on time
MORE_STEPS, MORE_ROOM = "more steps", "more room beside"
LESS_PUSH = "a smaller disturbance or stronger inputs"
MORE_CELLS = "more cells along"
DRAWN = 2000  # states of which is asked what changes of cells gain
MOST_SETS = 4  # unsafe sets that are taken away one at a time, if there are no more
MOST_NEAR = 500  # states whose neighbourhood is looked at
ENOUGH = 0.5  # of what is missing: nothing more is tried after a cause that gains so much
GAINED, BESIDE = 0.002, 0.25  # of states; and of what the best gains: less is not said


@dataclass(frozen=True)
class CoarseProof(GeneralProof):
    """The proof of a copy: with fewer boxes for each unsafe set, and fewer pieces of an interval."""

    most_boxes: ClassVar[int] = BOXES_OF_A_SET // 64
    most_pieces: ClassVar[int] = 1


class Gain(NamedTuple):
    """How many states are won by what was taken away, or added.

    name : what was taken away, in words for the user; "" if something was added.
    helps : what was added or, if something was taken away, what helps against it; "" if that is not known.
    before, then : the shares of the states, from 0 to 1, in the tubes before the change and after it.
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
    """A table's problem on few nodes and on few cells, and which of the changes to it gain states.

    Each is solved once it is asked about and may matter, and kept. Warnings and findings of the solves are dropped.

    Attributes
    ----------
    problem : ReachAvoidProblem
        What is solved again: the table's, with `steps` None if the table holds for ever, or finds its number; on nodes
        `ENDLESS_STEPS` stand for that.
    own_axes : tuple of CellAxis
        The table's cells.
    steps : int
        Of the table.
    """

    def __init__(self, table: Any, sets: Callable[..., Any]) -> None:
        """Nothing is solved yet. table : the `CertifiedTable`. sets : the class `CellSets`, which solves by cells."""
        problem, self.own_axes, self.parts, self.sets = table.problem, table.axes, table.proof.parts, sets
        self.steps: int = table.steps
        self.endless = bool(table.details.get("endless"))
        steps = min(problem.steps, MOST_STEPS) if problem.time_invariant else problem.steps
        self.problem: ReachAvoidProblem = replace(problem, recipe={}, steps=None if self.endless else steps)
        self._tables: dict[tuple[str, str], Any] = {}  # by the cause and what helps; None where there is none

    @property
    def tried(self) -> list[tuple[str, str]]:
        """(cause, helps) of all changes that have been solved."""
        return [key for key, table in self._tables.items() if table is not None and key[1] not in ("", "nothing")]

    @property
    def doubled(self) -> bool:
        """Whether twice the cells along each axis have been tried."""
        return all(("", f"{MORE_CELLS} {name}") in self.tried for name in self.problem.grid.names)

    @cached_property
    def grid(self) -> Any:
        """The table of the problem on few nodes, by `HJI`; None where that refuses it, as it does some black boxes."""
        return self._table("", "", self._on_nodes)

    @cached_property
    def plain(self) -> Any:
        """The table of the copy to which nothing is added; None if it is refused."""
        return self._table("", "nothing", lambda: self._by_cells(self.problem, self.axes))

    def gains(self, states: FloatArray, step: int, within: int) -> tuple[list[Gain], list[Gain]]:
        """What limits the table at some states, and what would gain some if added: (causes, added), lists of `Gain`.

        In both the one that gains most is first; those that gain little (`_largest`) are left out, so a list may be
        empty. Without a `grid` only what is added is told, and without a copy nothing of that.

        states (M, ndim) : M > 0, which the table lacks. step : of the problem. within : the steps to go.
        """
        won = 0.0 if self.grid is None else self._share(states, step, within, self.grid)
        causes, added = list[Gain](), list[Gain]()
        if self.grid is None or won >= max(GAINED, BESIDE * (1.0 - won)):
            added += self.of_cells
        if self.grid is not None:
            causes = [Gain("creep" if self.problem.has_no_target else "rounding", "", 0.0, won)]
        if self.grid is not None and 1.0 - won >= max(GAINED, BESIDE * won):
            asked = states, step, within, self.grid
            found = self._tried(self._of_problem(), *asked) or self._tried(self._of_reach(), *asked)
            causes += [one for one in found if one.name]
            added += [one for one in found if not one.name]
        return _largest(causes), added

    @cached_property
    def of_cells(self) -> tuple[Gain, ...]:
        """What more cells along an axis gain on copies, and inputs held longer, of `DRAWN` states that the grid has.

        Shares are those at step 0 with all steps to go. As `gains` tells them, the largest first.
        """
        space = self.problem.grid
        drawn = np.random.default_rng(0).uniform(space.lower, space.upper, (DRAWN, space.ndim))
        asked = 0, self.steps
        if self.grid is not None and (has := self._has(drawn, *asked, self.grid)).any():
            drawn = drawn[has]
        return () if self.plain is None else tuple(self._tried(self._of_cells(), drawn, *asked, self.plain))

    def decided(self, states: FloatArray, step: int, within: int) -> bool:
        """Whether the grid tells of most states that it lacks that finer cells would not have them either.

        Not if it has something within a node of them, or nothing anywhere, or there is no `grid`. Arguments as for
        `gains`.
        """
        if self.grid is None or not self.grid.fraction():
            return False
        space, states = self.grid.problem.grid, states[:MOST_NEAR]
        lacked = states[~self._has(states, step, within, self.grid)]
        near = np.zeros(len(lacked), np.bool_)
        for signs in itertools.product((-1, 0, 1), repeat=space.ndim) if len(lacked) else ():
            moved = np.clip(space.wrapped(lacked + np.array(signs) * space.spacing), space.lower, space.upper)
            near |= self._has(moved, step, within, self.grid)
        return not len(lacked) or float(near.mean()) < ENOUGH

    def _tried(self, trials: Iterator[tuple[str, str, Callable[[], Any]]], *asked: Any) -> list[Gain]:
        """What trials gain beyond a table, the largest first (`_largest`).

        asked : states, step and within as for `gains`, and the table. No more is tried once a cause gains `ENOUGH` of
        what that lacks.
        """
        states, step, within, _ = asked
        before, out = self._share(*asked), list[Gain]()
        for name, helps, made in trials:
            if any(one.name and one.more >= ENOUGH * (1.0 - before) for one in out):
                break
            if (table := self._table(name, helps, made)) is not None:
                more = self.problem.steps if helps == MORE_STEPS else 0
                out.append(Gain(name, helps, before, self._share(states, step, within + more, table)))
        return _largest(out)

    def _share(self, states: FloatArray, step: int, within: int, table: Any) -> float:
        """The share of states (M, ndim) that the tube (step, within) of a table contains, from 0 to 1 (`_has`)."""
        return float(self._has(states, step, within, table).mean())

    def _has(self, states: FloatArray, step: int, within: int, table: Any) -> FloatArray:
        """Whether the tube (step, within) of a table contains states (M, ndim): (M,) bool.

        step, within : of the problem; the table may have other intervals; as many whole ones count as there are.
        """
        longer = table.problem.delta / self.problem.delta
        step = 0 if table.problem.time_invariant else min(int(step / longer), table.steps)
        ever = self.endless and within >= self.steps
        within = table.steps if ever else min(int(within / longer), table.steps - step)
        if table.proved:  # what more cells would do is a question of cells
            return np.asarray(table.in_cells(states, step, within))
        return np.asarray(table.contains(states, start=step, within=within))

    def _table(self, name: str, helps: str, made: Callable[[], Any]) -> Any:
        """The table that `made` solves, at first use; None where its problem or its proof is refused."""
        if (name, helps) not in self._tables:
            self._tables[name, helps] = None
            with _quiet(), suppress(ValueError, MemoryError):
                self._tables[name, helps] = made()
        return self._tables[name, helps]

    # ---- on a grid

    def _of_problem(self) -> Iterator[tuple[str, str, Callable[[], Any]]]:
        """Yield (cause, helps, solve) of what is taken away from the problem, and of a controller that remembers.

        The push, the errors of a `Sensing`, and each unsafe set where there are at most `MOST_SETS`; what the problem
        does not have is left out.
        """
        problem, unsafe = self.problem, self.problem.unsafe
        if not all(is_constant(one, 0.0) for one in problem.dynamics.bounds.outputs):
            yield "push", LESS_PUSH, lambda: self._on_nodes(dynamics=problem.dynamics.undisturbed())
        if problem.sensing:
            if not problem.sensing.remembers:
                memory = replace(problem.sensing, memory=True)
                yield "", "Sensing(..., memory=True) and Controller.step", lambda: self._on_nodes(sensing=memory)
            yield "noise", "a smaller error, delay or jitter", lambda: self._on_nodes(sensing=Sensing())
        for one in unsafe if len(unsafe) <= MOST_SETS else ():
            rest = tuple(other for other in unsafe if other is not one)
            yield f"clearance of {one.name!r}", f"{MORE_ROOM} {one.name!r}", partial(self._on_nodes, unsafe=rest)

    def _of_reach(self) -> Iterator[tuple[str, str, Callable[[], Any]]]:
        """Yield (cause, helps, solve) of twice the steps, of twice as strong inputs, and of half the interval."""
        problem = self.problem
        if problem.time_invariant and not problem.has_no_target and not self.endless:
            yield "few steps", MORE_STEPS, lambda: self._on_nodes(steps=self._steps(2.0))
        if isinstance(problem.dynamics.drift, Formula) and problem.dynamics.gain is not None:
            yield "weak inputs", "stronger inputs", lambda: self._on_nodes(dynamics=problem.dynamics.stronger())
        steps = self._steps(2.0) or 2 * ENDLESS_STEPS
        yield "", "a shorter interval", lambda: self._on_nodes(delta=problem.delta / 2, steps=steps)

    def _steps(self, factor: float) -> int | None:
        """So many times the problem's number of steps, at least one; None if it has no number."""
        return None if self.problem.steps is None else max(int(factor * self.problem.steps), 1)

    def _on_nodes(self, **change: Any) -> Any:
        """The table of the problem with fields changed, by `HJI` on few nodes, as many along an axis as cells suggest.

        ValueError and MemoryError as `HJI` raises them.
        """
        problem = self.problem
        cells = np.array([axis.count for axis in self.own_axes])
        steps = problem.steps or ENDLESS_STEPS  # no grid promises for ever
        tubes = steps if problem.time_invariant else steps * (steps + 1) // 2
        share = min(cells.prod() / SHARE_OF_NODES, MOST_NODES)
        few = max(min(FEW_NODES, WORK / (len(problem.inputs) * tubes)), share)
        nodes = np.maximum(np.round(cells * min((few / cells.prod()) ** (1 / len(cells)), FINER)), FEWEST_NODES) + 1
        grid: Any = replace(problem.grid, shape=tuple(nodes.astype(int).tolist()))
        made = replace(problem, **({"grid": grid, "steps": steps} | change))
        sets = HJI().sets(made, False)
        recursion(sets, made.most_steps, lambda: None)
        return sets.finish({})

    # ---- by cells

    @cached_property
    def axes(self) -> tuple[CellAxis, ...]:
        """The cells of each axis of the copies: the table's, or fewer and at least `FEWEST` along an axis."""
        cells = np.array([axis.count for axis in self.own_axes])
        factor = (max(FEW_CELLS, cells.prod() / SHARE_OF_CELLS) / cells.prod()) ** (1 / len(cells))
        if factor >= 1.0:
            return tuple(self.own_axes)
        return aligned(self.problem, [max(round(factor * one), FEWEST) for one in cells.tolist()])

    def _of_cells(self) -> Iterator[tuple[str, str, Callable[[], Any]]]:
        """Yield ("", helps, solve) of twice the cells along each axis, and of inputs held for two and three periods."""
        problem, axes = self.problem, self.axes
        for k, name in enumerate(problem.grid.names):
            finer = axis_of(problem.grid, k, axes[k].width / 2, axes[k].layers)
            yield "", f"{MORE_CELLS} {name}", partial(self._by_cells, problem, (*axes[:k], finer, *axes[k + 1 :]))
        for periods, number in ((2, "two"), (3, "three")):
            helps = f"inputs held for {number} periods, delta={periods * problem.delta:g}"
            yield "", helps, partial(self._held_longer, periods)

    def _held_longer(self, periods: int) -> Any:
        """The table of the problem by the copies' cells, with inputs that are held for so many of its periods."""
        longer = replace(self.problem, delta=periods * self.problem.delta, steps=self._steps(1 / periods))
        return self._by_cells(longer, self.axes)

    def _by_cells(self, problem: ReachAvoidProblem, axes: Sequence[CellAxis]) -> Any:
        """The table of a problem by cells as wide as those of `axes`, with the layers that the problem has.

        ValueError where intervals cannot evaluate a function, as for the arm's case study, whose own proof needs less
        than a `GeneralProof`; MemoryError where there is too little memory.
        """
        grid = problem.grid
        own = tuple(axis_of(grid, k, axis.width, layers_of(problem, k)) for k, axis in enumerate(axes))
        proof: Any = CoarseProof.of(problem, own, self.parts)
        sets = self.sets(proof, False)
        recursion(sets, problem.most_steps, lambda: None)
        return sets.finish({})


@contextmanager
def _quiet() -> Iterator[None]:
    """A context in which warnings and findings are dropped."""
    with warnings.catch_warnings(), findings():
        warnings.simplefilter("ignore")
        yield


def _largest(gains: Sequence[Gain]) -> list[Gain]:
    """The gains of at least `GAINED`, and of the share `BESIDE` of the largest, the largest first.

    gains : in any order, possibly none.
    """
    least = max([GAINED, *(BESIDE * own.more for own in gains)])
    return sorted((own for own in gains if own.more >= least), key=lambda own: -own.more)
