"""The target L and the unsafe set G of Eq. (3), as level-set functions of some of the axes.

Both are closed (Definition 5): a state is unsafe where g <= 0, and has won where s <= 0 and g > 0. What solvers read of
g at the nodes is below 0 wherever g <= 0 (`sdhj.problem.problem.closed`), so what they find safe is so strictly.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.checks import Asked, ascending, number, option, whole
from sdhj.problem.maps import map_level_set, polygon_level_set

VIEW_TIMES = ("swept", "sampled", "instantaneous")
STEEP = 10.0  # times as deep inside, by sampling="steep": in figures/maze.py 3 loses 2 % of the starts, 5 1 %, 10 none
SUBSAMPLES = 20  # of one sampling interval, for view_time="sampled" (Sec. 6.2.1)

LARGEST = 1e9  # of a level-set function: beyond it, differences in single precision are rounding, and overflow is near

StaticLevelSet = Callable[[FloatArray, float], FloatArray]
SweptLevelSet = Callable[[FloatArray, float, float], FloatArray]


@dataclass(frozen=True)
class UnsafeSet:
    """A part of the unsafe set G (Eq. 3), as a level-set function of some of the axes (App. A.3).

    Parameters
    ----------
    axes : sequence of int
        The axes it depends on, ascending. Fewer axes make the avoid game cheaper.
    level_set : callable (points (M, len(axes)), t) -> (M,)
        At most 0 in the set at time t, its boundary included, and above 0 outside; best a distance that is negative
        inside. One that is 0 in the whole set will do, if outside it grows as a distance does.
    swept : callable (points, t0, t1) -> (M,), optional
        Negative wherever the set is at any time of [t0, t1] (it may be larger, never smaller).
    rate : float, optional
        A bound on how fast the level-set function changes in time; a moving set needs one. Zero (default): the set
        is static. For a moving set without `swept`, samples lowered by rate * gap / 2 take its place.
    name : str
    slope : float, optional
        A bound on how fast the level-set function changes with the state, per unit of distance.
    sampling : {"nodes", "steep", "cell"}
        What a node of the grid knows of the set: the value there; the value, but inside the set times `STEEP`, so that
        errors of differences and of interpolation, which are worst where the set is a node or two thick, make it larger
        (by less than a cell) and never smaller; or a bound from below on the values in all cells that touch the node,
        with which nothing thin is lost and all is a cell larger (`sdhj.solver.resolution`).

    The functions are called with the coordinates of periodic axes between the ends of the grid.
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
        object.__setattr__(self, "level_set", Asked.of(f"level_set of {self.name!r}", self.level_set, "points", "t"))
        if self.swept is not None:
            swept = Asked.of(f"swept of {self.name!r}", self.swept, "points", "t0", "t1")
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
        """What a robot's map does not show as free, from a map server's file or an array, less a disk robot's radius.

        The parameters are those of `sdhj.problem.maps.map_level_set`; `axes` are the two axes of the grid that are the
        map's x and y, m.
        """
        level_set, slope = map_level_set(source, resolution=resolution, origin=origin, radius=radius, name=name)
        return cls(_plane(axes, name), level_set, name=name, slope=slope)

    @classmethod
    def polygon(
        cls, vertices: FloatArray, axes: Sequence[int] = (0, 1), *, radius: float = 0.0, name: str = "polygon"
    ) -> "UnsafeSet":
        """A simple polygon with vertices (K, 2), m, grown by a disk robot's radius: `maps.polygon_level_set`."""
        level_set, slope = polygon_level_set(vertices, radius=radius)
        return cls(_plane(axes, name), level_set, name=name, slope=slope)

    @property
    def moving(self) -> bool:
        return self.rate > 0.0

    def over(self, points: FloatArray, t0: float, t1: float, view_time: str) -> FloatArray:
        """One static level-set function for the whole interval [t0, t1] (Sec. 5.4 and 6.2.1).

        "swept" contains the set at every time of the interval; "sampled" is the union of 20 samples and does not.
        """
        return self.union(points, t0, t1, view_time) - self.lowering(t0, t1, view_time)

    def union(self, points: FloatArray, t0: float, t1: float, view_time: str) -> FloatArray:
        """As `over`, before it is lowered for what happens between the samples."""
        if not self.moving:
            return self.level_set(points, t0)
        if view_time == "swept" and self.swept is not None:
            return self.swept(points, t0, t1)
        union = self.level_set(points, t0)
        for t in np.linspace(t0, t1, SUBSAMPLES)[1:]:
            union = np.minimum(union, self.level_set(points, float(t)))
        return union

    def lowering(self, t0: float, t1: float, view_time: str) -> float:
        """By how much: a time between two samples is at most half a gap from one of them."""
        if not self.moving or view_time != "swept" or self.swept is not None:
            return 0.0
        times = np.linspace(t0, t1, SUBSAMPLES)
        return float(self.rate * (times[1] - times[0]) / 2)


@dataclass(frozen=True)
class TargetSet:
    """The target L (Eq. 3): `level_set(points (M, len(axes)), t)` is negative inside at time t."""

    axes: tuple[int, ...]
    level_set: StaticLevelSet
    name: str = "target"

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", ascending(self.axes, self.name))
        object.__setattr__(self, "level_set", Asked.of(f"level_set of {self.name!r}", self.level_set, "points", "t"))

    @classmethod
    def from_table(cls, table: Any, within: int | None = None) -> "TargetSet":
        """The states from which a solved table reaches its own target in time: see `table_level_set`."""
        level_set = table_level_set(table, within)
        return cls(tuple(range(table.grid.ndim)), level_set, f"the tube of {table.problem.name}")


ANYWHERE = TargetSet((0,), lambda points, t: np.full(len(points), -1.0), "anywhere")


def _plane(axes: Sequence[int], name: str) -> tuple[int, ...]:
    if len(own := ascending(axes, name)) != 2:
        raise ValueError(f"axes of {name!r} must be two axes of the grid, for x and y, got {axes!r}")
    return own


def table_level_set(table: Any, within: int | None = None) -> StaticLevelSet:
    """Level-set function of what a table reaches its target from: first into its tube, then by its own inputs.

    The problem that it is the target of has the same axes, and both clocks are one: at time t the target holds the
    states from which the table reaches its own target, from its step k = t / delta on, in the steps that are left of
    its N, or in `within` of them. At times that are no sampling times of the table, and after its last step, the target
    is empty. Where nothing depends on time in the table's problem its step is 0 at any time. A table without a target
    is one of staying safe: then the target holds the states from which it keeps clear until its last step.

    Of a certified table the target is exactly its certified cells, and a certified table of the second problem proves
    the whole way: a cell is in its target where certified cells of the first cover it. Handing over may take a state
    out of them by what rounding may in three steps (`sdhj.certified.cells.DRIFT`), within the slack of every certified
    set. Of other tables it is the interpolated tube, which proves nothing, so method "certified" refuses it as a
    target.

    Raises
    ------
    ValueError
        For what is no table, or a number of steps that it does not have.
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
            raise ValueError(f"what a table of {problem.name!r} reaches depends on time")
        step = step_at(t0)
        if step is None:
            return np.ones(len(low)), np.ones(len(low))
        off = table.proof.unsure  # what is certified with sensing are predictions
        every, some = table.over(low - off, high + off, start=step, within=most)
        return np.where(some, -1.0, 1.0), np.where(every, -1.0, 1.0)

    if table.method == "certified":
        level_set.enclosure = enclosure  # type: ignore[attr-defined]
    return level_set
