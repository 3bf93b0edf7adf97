"""The look-up table of Fig. 8, which all methods on a grid produce.

A state between the nodes is in a tube if the interpolated level-set function is <= 0. `notebooks/site/code.md` says
which inputs are safe there, by the marks of the nodes around it and by margins. Margins lose fewer runs than the marks
alone; marks exclude inputs that only just avoid an obstacle. If the adversary couples axes, a margin is over the sum of
a box and segments or, where v enters nonlinearly, over the hull of what its pieces lead to; where gain or bounds depend
on time, and at walls, it is over the box around, which is larger than the reachable set, and promises are given more
rarely.
"""

import os
from collections.abc import Mapping
from dataclasses import InitVar, dataclass, field
from functools import cached_property, partial
from typing import Any, Self

import numpy as np

from sdhj.common.checks import axis_numbers, read_only_view
from sdhj.common.remembering import FloatArray, ReadOnly, Sealed, kept, read_only
from sdhj.formulas.formula import BlackBox
from sdhj.kernels.lookup import decide
from sdhj.kernels.tape import RESULTS
from sdhj.kernels.true_sets import TUBES
from sdhj.kernels.tubes import avoid_values, tube_values
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.uncertain import eroded_by_error, largest_in_error_box
from sdhj.table.ahead import NO_TAPES, tapes_of
from sdhj.table.batches import NOWHERE, Batch, Player, Table, entry
from sdhj.table.container import Contents
from sdhj.table.files import read_array, write_table


@dataclass(frozen=True)
class AvoidTubes(ReadOnly):
    """Level-set functions of the avoid tubes (Definition 3), <= 0 where u_j is safe over the interval.

    A node is safe under u_j at step k if static[j] and moving[k, j] are both <= 0 there.

    Attributes
    ----------
    static_axes, moving_axes : tuple of int
        The axes on which the tubes that are the same at all steps, and those that differ, depend.
    static : (L, *subgrid of static_axes)
        -inf where there is no such unsafe set.
    moving : (steps, L, *subgrid of moving_axes)
    """

    static_axes: tuple[int, ...]
    static: FloatArray
    moving_axes: tuple[int, ...]
    moving: FloatArray


def entries(steps: int) -> FloatArray:
    """Every pair (start, within) of a table of so many steps, in the order of `entry`: (entries, 2)."""
    # files keep it beside the index, for readers without this package
    return np.column_stack(np.nonzero(np.tri(steps + 1, dtype=bool)[::-1]))


@dataclass(frozen=True, repr=False)
class LookupTable(Table):
    """A solved problem on a grid: all tubes, and the inputs that are safe and make progress in them (Fig. 8).

    `sdhj.solve` and `sdhj.load` make one. `start` and `within` select a tube, by default that of all steps from 0:
    (start=k, within=n), S_k^{N-n} in the paper, holds the states from which the target is reached safely (without a
    target: those that stay clear) in at most n of the N - k steps that are left at step k. All methods raise ValueError
    where an argument does not fit.

    Attributes
    ----------
    problem, method : ReachAvoidProblem, str
    index : (entries,) int64
        For each (start, within) the number of its stored tube.
    tubes : (T, *grid.shape)
        The level-set functions of the T stored tubes, <= 0 inside.
    marks : (T, ceil(L / 8), nodes) uint8
        Bit j % 8 of byte j // 8 stands for u_j.
    avoid : AvoidTubes
        Where each input stays clear over one interval.
    details : mapping
        Options and statistics of the solve.

    Examples
    --------
    >>> import sdhj
    >>> table = sdhj.solve(sdhj.arm_case_study(nodes=13, steps=3))
    >>> table.values(start=0, within=3).shape, table.inputs(start=0, within=3).shape
    ((13, 13, 13, 13), (13, 13, 13, 13, 25))
    >>> [round(table.fraction(start=0, within=n), 2) for n in range(4)]
    [0.02, 0.06, 0.1, 0.18]
    """

    problem: ReachAvoidProblem
    method: str
    index: FloatArray
    tubes: FloatArray
    marks: FloatArray
    avoid: AvoidTubes
    details: Mapping[str, Any]
    player: Player | None = field(default=None, compare=False)
    mapped_from: InitVar[Any] = None  # `origin`; nothing of what `dataclasses.replace` makes of it

    def __post_init__(self, mapped_from: Any) -> None:
        object.__setattr__(self, "details", Sealed(self.details))
        object.__setattr__(self, "origin", mapped_from)

    # ---- at the nodes

    def value_array(self, start: int, within: int | None) -> FloatArray:
        """The tube (start, within) as it is stored, no copy, grid.shape."""
        return self.tubes[self.tube_index(start, within)]

    def mark_array(self, start: int, within: int | None) -> FloatArray:
        """The marks of the tube (start, within) as they are stored, no copy, (bytes, size) uint8."""
        return self.marks[self.tube_index(start, within)]

    def values(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """The level-set function of a tube at the nodes of the grid, to draw or to measure it.

        Parameters
        ----------
        start, within : int
            The tube, as in `contains`.

        Returns
        -------
        array of shape grid.shape
            <= 0 inside; a read-only view. `contains` and `batch` also check the true sets. With `Sensing`, the states
            are predictions.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> values = table.values(start=0, within=3)
        >>> values.shape, problem.grid.nodes(0)[values <= 0][[0, -1]]
        ((81,), array([-2.1,  2.1]))
        """
        return read_only_view(self.value_array(start, within))

    def inputs(self, *, start: int = 0, within: int | None = None) -> FloatArray:
        """Which inputs are safe and make progress at each node: a mask, bool of shape grid.shape + (L,), new.

        True where the input avoids the unsafe sets over the interval from `start` and ends in the tube (start + 1,
        within - 1), whatever the adversary does.

        Parameters
        ----------
        start, within : int
            The tube, as in `contains`.

        Examples
        --------
        With the robot on a line of `help(sdhj)`, the inputs -1, 0 and 1 m/s at -2 m:

        >>> table.inputs(start=0, within=3)[20]
        array([False, False,  True])
        """
        count = len(self.problem.inputs)
        bits = np.unpackbits(self.mark_array(start, within), axis=0, count=count, bitorder="little")
        return np.moveaxis(bits.reshape(count, *self.grid.shape), 0, -1).astype(bool)

    def _inside(self, points: FloatArray, start: int, within: int) -> FloatArray:
        """Whether points (M, ndim) are in a tube, interpolated; with sensing in all of the box E."""
        return largest_in_error_box(self.problem, self.value_array(start, within), points) <= 0

    def _share(self, start: int, within: int) -> float:
        """The share of the grid's volume in a tube, by nodes; with sensing of the tube eroded by E."""
        return self.grid.fraction(eroded_by_error(self.problem, self.value_array(start, within)) <= 0)

    @property
    def nbytes(self) -> int:
        """Bytes that tubes, marks and avoid tubes take in memory."""
        return sum(a.nbytes for a in (self.index, self.tubes, self.marks, self.avoid.static, self.avoid.moving))

    # ---- between the nodes

    def _hazards(self, states: FloatArray, step: int) -> FloatArray:
        """The avoid tubes of a step, interpolated at states: (M, L), new."""
        out = np.empty((len(states), len(self.problem.inputs)))
        avoid_values(states, step, *self.tape_at(step), *self._stored[3:], out)
        return out

    def _values_at(self, points: FloatArray, step: int, within: FloatArray) -> FloatArray:
        """The values of tubes interpolated at points (M, V, ndim): (M, V)."""
        out = np.empty(points.shape[:2])
        places = self.index[entry(self.steps, step, 0) + within]
        tube_values(points, places, self._stored[1], *self.tape_at(step), out)
        return out

    def _fill_in_and_check(self, batch: Batch, scores: FloatArray, checks: int, rows: FloatArray) -> None:
        """As `Table._fill_in_and_check`, by compiled code where all level-set functions are formulas."""
        interval, states, done = self.problem.interval(batch.step), batch.states, False
        if self._all_formulas:
            played, alike = self._tapes[RESULTS].size > 0, interval.dynamics.stateless
            ends = NOWHERE if played else interval.displacement_sets(states if alike else states[rows])
            done = self._call(batch, rows, ends, scores, checks)
        if not done:  # with black boxes, or to say what is undefined
            super()._fill_in_and_check(batch, scores, checks, rows)

    def _fill_in_by_tubes(self, batch: Batch, rows: FloatArray, ends: FloatArray) -> None:
        """Fill in rows (R,) of a batch in place by interpolation and marks, without the true sets."""
        self._call(batch, rows, ends, batch.margins, TUBES)

    def _call(self, batch: Batch, rows: FloatArray, ends: FloatArray, scores: FloatArray, checks: int) -> bool:
        """Fill in rows (R,) of a batch in place by the compiled `decide`; False, with undefined rows, if it cannot."""
        asked, leads = (batch.states, rows, batch.step, batch.within, checks), (ends, scores, self.normals)
        out = batch.steps_to_go, batch.safe, batch.margins, batch.best
        return bool(decide(*asked, *self.tape_at(batch.step), self.steps, *self._stored, *leads, *out))

    @cached_property
    def _all_formulas(self) -> bool:
        """Whether no level-set function is a black box, so that compiled code can evaluate all."""
        return not any(isinstance(one.level_set, BlackBox) for one in self.problem.all_sets)

    @kept
    def _tapes(self) -> Any:
        """`tapes_of` the problem; `NO_TAPES` where a set is a black box."""
        return tapes_of(self.problem) if self._all_formulas else NO_TAPES

    @kept
    def _axes(self) -> Any:
        """The axes of the static and of the moving avoid tubes."""
        return [np.array(axes, dtype=np.int64) for axes in (self.avoid.static_axes, self.avoid.moving_axes)]

    @cached_property
    def _stored(self) -> tuple[FloatArray, ...]:
        """The arrays of `StoredTubes`: read-only views, nodes in one axis."""
        inputs, tubes = len(self.problem.inputs), self.tubes.reshape(len(self.tubes), -1)
        static, moving = self.avoid.static.reshape(inputs, -1), self.avoid.moving.reshape(self.steps * inputs, -1)
        # in the order of the arguments of `decide`; `_hazards` takes the last two, and `_values_at` the second
        return read_only(tuple(one.view() for one in (self.index, tubes, self.marks, static, moving)))  # one signature

    # ---- on disk

    def save(self, path: str | os.PathLike[str], compress: bool = False) -> None:
        """Write the table to a file, which `numpy.load` opens, too.

        Parameters
        ----------
        path : path
            Of the file; by custom it ends in .npz.
        compress : bool
            Whether to pack the arrays, to a fifth or so; `sdhj.load` then unpacks them into memory.

        Raises
        ------
        OSError
            If the file cannot be written.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "line.npz"
        >>> table.save(path)
        >>> sdhj.load(path).fraction() == table.fraction()
        True
        """
        axes = {name: getattr(self.avoid, f"{name}_axes") for name in ("static", "moving")}
        arrays = {"entries": entries(self.steps), "index": self.index, "tubes": self.tubes, "marks": self.marks}
        arrays |= {f"avoid_{name}": getattr(self.avoid, name) for name in axes}
        told = {"avoid_axes": axes, "entries": "start and within of each entry of the index"}
        write_table(path, self, arrays, compress, **told)

    @classmethod
    def read(cls, head: Mapping[str, Any], file: Contents, problem: ReachAvoidProblem, **fields: Any) -> Self:
        """The table of this problem in an open file, with its checked head."""
        index = read_array(file, "index", "int64", (len(entries(problem.most_steps)),))
        return cls.of_arrays(head, partial(read_array, file), index, problem, **fields)

    @classmethod
    def of_arrays(
        cls, head: Mapping[str, Any], stored: Any, index: FloatArray, problem: ReachAvoidProblem, **fields: Any
    ) -> Self:
        """The table whose arrays `stored(name, dtypes, shape)` reads."""
        grid, count, steps = problem.grid, len(problem.inputs), problem.most_steps
        if index.shape != (len(entries(steps)),):
            raise ValueError(f"its index must have {len(entries(steps))} entries, got shape {index.shape}")
        # as many tubes as the index names: a number beyond the file's is refused by the shape below
        most = int(index.max()) + 1
        if index.min() < 0:
            raise ValueError("its index points before the first tube")
        if problem.has_no_target and head["details"].get("endless"):
            raise ValueError(
                "it is of an older version, which promised for ever what is only interpolated; method='certified' "
                "proves what holds for ever"
            )
        tubes = stored("tubes", "float32 float64", (most, *grid.shape))
        marks = stored("marks", "uint8", (most, -(-count // 8), grid.size))
        avoid: list[Any] = []
        for name, lead in (("static", (count,)), ("moving", (steps, count))):
            axes = ascending_axes(head["avoid_axes"][name], f"avoid_{name}", grid)
            shape = tuple(grid.shape[axis] for axis in axes)
            avoid += [axes, stored(f"avoid_{name}", "float32 float64", (*lead, *shape))]
        arrays, method = read_only((index, tubes, marks)), head["method"]
        return cls(problem, method, *arrays, AvoidTubes(*avoid), head["details"], **fields)


def ascending_axes(axes: Any, name: str, grid: Grid) -> tuple[int, ...]:
    """The numbers of axes that a file lists, checked to be ascending."""
    found = axis_numbers(axes, name)
    if list(found) != sorted(set(found) & set(range(grid.ndim))):
        raise ValueError(f"the axes of {name} must be ascending axes of the grid, got {found}")
    return found
