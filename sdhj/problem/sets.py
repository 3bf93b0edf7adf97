"""The target L and the unsafe set G of Eq. (3), as level-set functions of some of the axes.

Both are closed (Definition 5): a state is unsafe if g <= 0, and has reached the target if s <= 0 and g > 0. The samples
of g that solvers use are negative wherever g <= 0 (`sdhj.problem.problem.closed`), so boundary nodes are unsafe.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import CheckedFunction, ascending, number, option, whole
from sdhj.problem.maps import map_level_set, polygon_level_set

VIEW_TIMES = ("swept", "sampled", "instantaneous")
STEEP = 10.0  # factor inside sets of sampling="steep": in figures/maze.py 3 loses 2 % of the starts, 5 1 %, 10 none
SUBSAMPLES = 20  # of one sampling interval, for view_time="sampled" (Sec. 6.2.1)

LARGEST = 1e9  # level-set value: beyond it, differences in single precision are only rounding, and overflow is near

StaticLevelSet = Callable[[FloatArray, float], FloatArray]
SweptLevelSet = Callable[[FloatArray, float, float], FloatArray]


@dataclass(frozen=True)
class UnsafeSet:
    """A set that the robot must not touch, given by a level-set function: a part of G (Eq. 3).

    Parameters
    ----------
    axes : sequence of int
        The axes of the grid that the function depends on, numbered from 0, ascending. The fewer, the faster the solve.
    level_set : callable (points (M, len(axes)), t) -> (M,)
        Takes coordinates on these axes and the time in s. Values <= 0 in the set at time t, its boundary included, and
        > 0 outside; ideally the signed distance to the set. A function that is 0 in the whole set also works if it
        grows like a distance outside.
    swept : callable (points, t0, t1) -> (M,), optional
        Level-set function of a set that contains this one at every time in [t0, t1]; at most `level_set` at each time.
    rate : float
        Upper bound on how fast the level-set function changes in time, per second: at least the speed of a set that
        moves, and 0 for one that does not. It bounds the function between the 20 times of an interval at which it is
        sampled where there is no `swept`.
    name : str
        For messages and pictures.
    slope : float, optional
        Upper bound on the change of the level-set function per unit of distance, for method "certified".
    sampling : {"nodes", "steep", "cell"}
        The value that a node of the grid gets. "nodes": the function's value there; right where the set is some
        cells thick everywhere, else `solve` warns. "steep": the same, times 10 inside the set, so that a set one or two
        nodes thick is not worn away by the scheme; it grows by less than a cell. "cell" is the conservative option: a
        lower bound over all cells that touch the node, so no thin part is missed, but the set grows by a cell.

    Raises
    ------
    ValueError
        If an argument does not fit, here or when the set is given to a problem.

    Notes
    -----
    Coordinates on periodic axes are wrapped into the grid before a function is called.

    Examples
    --------
    A disk of radius 0.5 m that moves along the first axis at 0.2 m/s:

    >>> import numpy as np
    >>> import sdhj
    >>> disk = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.2 * t, p[:, 1]) - 0.5, rate=0.2)
    >>> disk.level_set(np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0)
    array([-0.3,  0.3])
    """

    axes: tuple[int, ...]
    level_set: StaticLevelSet
    swept: SweptLevelSet | None = None
    rate: float = 0.0
    name: str = "unsafe"
    slope: float | None = None
    sampling: str = "nodes"

    def __post_init__(self) -> None:
        option(f"sampling of the unsafe set {self.name!r}", self.sampling, ("nodes", "steep", "cell"))
        object.__setattr__(self, "axes", ascending(self.axes, self.name))
        object.__setattr__(
            self, "level_set", CheckedFunction.of(f"level_set of {self.name!r}", self.level_set, "points", "t")
        )
        if self.swept is not None:
            swept = CheckedFunction.of(f"swept of {self.name!r}", self.swept, "points", "t0", "t1")
            object.__setattr__(self, "swept", swept)
        if self.slope is not None:
            object.__setattr__(self, "slope", number(f"slope of {self.name!r}", self.slope, least=0.0))
        rate = number(f"rate of the unsafe set {self.name!r}", self.rate, least=0.0, most=LARGEST)
        object.__setattr__(self, "rate", rate)

    @classmethod
    def from_map(
        cls,
        source: str | os.PathLike[str] | FloatArray,
        axes: Sequence[int] = (0, 1),
        *,
        resolution: float | None = None,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        radius: float = 0.0,
        name: str = "map",
    ) -> "UnsafeSet":
        """Everything that a map does not show as free, enlarged by the radius of a disk-shaped robot.

        `source` is the YAML file of a map server or an array; the parameters are those of
        `sdhj.problem.maps.map_level_set`. `axes` are the grid's axes for the map's x and y, m.
        """
        level_set, slope = map_level_set(source, resolution=resolution, origin=origin, radius=radius, name=name)
        return cls(_plane(axes, name), level_set, name=name, slope=slope)

    @classmethod
    def polygon(
        cls, vertices: FloatArray, axes: Sequence[int] = (0, 1), *, radius: float = 0.0, name: str = "polygon"
    ) -> "UnsafeSet":
        """A simple polygon with vertices (K, 2), m, enlarged by the radius of a disk-shaped robot, m."""
        level_set, slope = polygon_level_set(vertices, radius=radius)
        return cls(_plane(axes, name), level_set, name=name, slope=slope)

    @property
    def moving(self) -> bool:
        return self.rate > 0.0

    def over(self, points: FloatArray, t0: float, t1: float, view_time: str) -> FloatArray:
        """Values (M,) of one static level-set function for the whole interval [t0, t1] (Sec. 5.4 and 6.2.1).

        With "swept" its set contains this one at every time; with "sampled" it is the union of 20 samples only.
        """
        return self.union(points, t0, t1, view_time) - self.lowering(t0, t1, view_time)

    def union(self, points: FloatArray, t0: float, t1: float, view_time: str) -> FloatArray:
        """As `over`, before `lowering`."""
        if not self.moving:
            return self.level_set(points, t0)
        if view_time == "swept" and self.swept is not None:
            return self.swept(points, t0, t1)
        union = self.level_set(points, t0)
        for t in np.linspace(t0, t1, SUBSAMPLES)[1:]:
            union = np.minimum(union, self.level_set(points, float(t)))
        return union

    def lowering(self, t0: float, t1: float, view_time: str) -> float:
        """How much `over` subtracts for the times between samples, which are at most half a gap from one of them."""
        if not self.moving or view_time != "swept" or self.swept is not None:
            return 0.0
        times = np.linspace(t0, t1, SUBSAMPLES)
        return float(self.rate * (times[1] - times[0]) / 2)


@dataclass(frozen=True)
class TargetSet:
    """The target L (Eq. 3), of some axes of the grid: `level_set(points (M, len(axes)), t)` is <= 0 in it at time t.

    Examples
    --------
    A disk of radius 0.5 m about the origin:

    >>> import numpy as np
    >>> import sdhj
    >>> target = sdhj.TargetSet((0, 1), lambda points, t: np.hypot(points[:, 0], points[:, 1]) - 0.5)
    >>> target.level_set(np.array([[0.0, 0.0], [0.0, 2.0]]), 0.0)
    array([-0.5,  1.5])
    """

    axes: tuple[int, ...]
    level_set: StaticLevelSet
    name: str = "target"

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", ascending(self.axes, self.name))
        object.__setattr__(
            self, "level_set", CheckedFunction.of(f"level_set of {self.name!r}", self.level_set, "points", "t")
        )

    @classmethod
    def from_table(cls, table: Any, within: int | None = None) -> "TargetSet":
        """The states from which another table reaches its target, to chain two problems: see `table_level_set`."""
        level_set = table_level_set(table, within)
        return cls(tuple(range(table.grid.ndim)), level_set, f"the tube of {table.problem.name}")


ANYWHERE = TargetSet((0,), lambda points, t: np.full(len(points), -1.0), "anywhere")


def _plane(axes: Sequence[int], name: str) -> tuple[int, ...]:
    if len(pair := ascending(axes, name)) != 2:
        raise ValueError(f"axes of {name!r} must be two axes of the grid, for x and y, got {axes!r}")
    return pair


def table_level_set(table: Any, within: int | None = None) -> StaticLevelSet:
    """Level-set function of the tube of a table, as the target of a second problem that leads into it.

    Both problems have the same axes and share one clock. At time t the target is the table's tube from step k = t /
    delta, within all steps that are left or `within` of them: the states from which the table reaches its target or,
    without one, stays safe. It is empty after the table's last step and at times other than its sampling times; if
    nothing depends on time in the table's problem, step 0 is used at every time.

    For a certified table the target is exactly its certified cells, and a certified table of the second problem proves
    the whole way: a cell is in its target if certified cells of the first table cover it. Rounding at the handover may
    move a state out of them by what it may in three steps (`sdhj.certified.cells.DRIFT`), within the slack of every
    certified set. Tubes of other tables are not proved, so method "certified" refuses them as targets.

    Raises
    ------
    ValueError
        If `table` is not a table, or does not have `within` steps.
    """
    if not hasattr(table, "values_at"):
        raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
    most = table.steps if within is None else whole("within", within, least=0, most=table.steps)
    problem = table.problem

    def step_at(t: float) -> int | None:
        step = 0 if problem.timeless else max(round((t - problem.time(0)) / problem.delta), 0)
        on_time = problem.timeless or abs(problem.time(step) - t) <= 1e-9 * problem.delta
        return step if on_time and step <= table.steps else None

    def level_set(points: FloatArray, t: float) -> FloatArray:
        step = step_at(t)
        if step is None:
            return np.ones(len(points))
        if table.method == "certified":
            return np.where(table.contains(points, start=step, within=most), -1.0, 1.0)
        tube = table.values(start=step, within=most)
        return np.minimum(problem.grid.interpolate(tube, points), max(float(tube.max()), 1.0))

    def enclosure(low: FloatArray, high: FloatArray, t0: float, t1: float) -> tuple[FloatArray, FloatArray]:
        if t0 != t1 and not problem.timeless:
            raise ValueError(f"the tube of {problem.name!r} depends on time, so it has no bounds over an interval")
        step = step_at(t0)
        if step is None:
            return np.ones(len(low)), np.ones(len(low))
        off = table.proof.unsure  # with sensing the certified states are predictions
        every, some = table.over(low - off, high + off, start=step, within=most)
        return np.where(some, -1.0, 1.0), np.where(every, -1.0, 1.0)

    if table.method == "certified":
        level_set.enclosure = enclosure  # type: ignore[attr-defined]
    return level_set
