"""The target L and the unsafe set G of Eq. (3), as level-set functions of some of the axes.

Both are closed (Definition 5): a state is unsafe if g <= 0, and has reached the target if s <= 0 and g > 0. The samples
of g that solvers use are negative wherever g <= 0 (`sdhj.problem.nodes.closed`), so boundary nodes are unsafe.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from sdhj.common.checks import axis_numbers, number, option, pair, whole
from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import Formula
from sdhj.problem.grid import Grid
from sdhj.problem.shapes.bodies import Body, Footprint, Pose, body_level_set, footprint_of, map_body_level_set
from sdhj.problem.shapes.maps import map_distance
from sdhj.problem.shapes.polygons import polygon_level_set

VIEW_TIMES = ("swept", "sampled", "instantaneous")
# factor inside sets of sampling="steep": in the maze of figures/studies/ 3 loses 2 % of the starts, 5 1 %, 10 none
STEEP = 10.0
SUBSAMPLES = 20  # of one sampling interval, for view_time="sampled" (Sec. 6.2.1)

# Level-set value. All arithmetic on the grid is homogeneous of degree 1 in it, so that rounding hangs on no magnitude;
# only overflow does: sums of differences of third order are at most 16 times a value, which may be `STEEP`.
LARGEST = 1e36


class LevelSet:
    """What targets and unsafe sets have in common."""

    level_set: Any

    @property
    def moving(self) -> bool:
        """Whether the level-set function depends on the time; a black box does unless its `BlackBox.rate` is 0."""
        return bool(self.level_set.depends_on_time)


@dataclass(frozen=True)
class UnsafeSet(LevelSet):
    """A set that the robot must not touch, given by a level-set function: a part of G (Eq. 3).

    Parameters
    ----------
    axes : sequence of int
        The axes that the function depends on, from 0, ascending. The fewer, the faster the solve.
    level_set : callable (points (M, len(axes)), t) -> (M,)
        Of coordinates on these axes and the time, s. <= 0 in the set, its boundary included, and > 0 outside; ideally
        the signed distance. One that is 0 in a whole region is refused by methods on the grid, unless sampling="cell".
    swept : callable (points, t0, t1) -> (M,), optional
        Of a set that contains this one at every time in [t0, t1]. By default `level_set` is bounded over [t0, t1] in
        pieces of time.
    name : str
        For messages and pictures.
    inputs : sequence of int, optional
        The inputs under which the set is unsafe, by index; by default all. A state in the set is then not lost: only
        none of these inputs, as thrust near a station, may be applied where the state may be in it. For a map or a
        polygon use `dataclasses.replace(unsafe_set, inputs=...)`.
    sampling : {"nodes", "steep", "cell"}
        What a node gets. "nodes": the function's value; right where the set is some cells thick everywhere, else
        `solve` warns. "steep": that times 10 inside the set, so that one a node or two thick is not worn away; it grows
        by less than a cell. "cell": a lower bound over all cells that touch the node, so no thin part is missed, but
        the set grows by a cell.

    Raises
    ------
    ValueError
        If a function cannot be read as a formula: at which line, and what to write instead.

    Notes
    -----
    Functions are read once, as formulas (`sdhj.formulas`); one that cannot be is given as a `sdhj.BlackBox`.
    On
    periodic axes they are given wrapped coordinates, and have to be periodic.

    Examples
    --------
    A disk of radius 0.5 m that moves along the first axis at 0.2 m/s:

    >>> import numpy as np
    >>> import sdhj
    >>> disk = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.2 * t, p[:, 1]) - 0.5)
    >>> disk.level_set(np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0)
    array([-0.3,  0.3])
    """

    axes: tuple[int, ...]
    level_set: Any  # once the set is made, a Formula or a BlackBox
    swept: Any = None
    name: str = "unsafe"
    sampling: str = "nodes"
    inputs: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        option(f"sampling of the unsafe set {self.name!r}", self.sampling, ("nodes", "steep", "cell"))
        object.__setattr__(self, "axes", axis_numbers(self.axes, self.name))
        if self.inputs is not None:
            object.__setattr__(self, "inputs", _input_numbers(self.inputs, self.name))
        # After `axes`, as functions are read with a state of so many coordinates.
        count, name = len(self.axes), f"level set of {self.name!r}"
        object.__setattr__(self, "level_set", Formula.read(name, self.level_set, count, "t"))
        if self.swept is not None:
            swept = Formula.read(f"swept of {self.name!r}", self.swept, count, "t0", "t1")
            object.__setattr__(self, "swept", swept)

    @classmethod
    def from_map(
        cls,
        source: str | os.PathLike[str] | FloatArray,
        axes: Sequence[int] = (0, 1),
        *,
        resolution: float | None = None,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        radius: float = 0.0,
        footprint: Footprint = None,
        tolerance: float = 0.01,
        name: str = "map",
    ) -> "UnsafeSet":
        """Everything that a map does not show as free, enlarged by the radius of a disk-shaped robot.

        What lies outside of the map is unsafe, too.

        Parameters
        ----------
        source : path of a map server's YAML file, or bool array (rows, columns)
            An array is True where the map is not free; row 0 is its top, as in an image.
        axes : sequence of int
            The grid's axes for the map's x and y, m; with a footprint, for x, y and heading, or those of its poses.
        resolution : float
            Side of a pixel, m, for an array.
        origin : (x, y) or (x, y, yaw)
            The lower left corner of an array's map, m, and its rotation about it, rad.
        radius : float
            Of the robot, m.
        footprint : array (K, 2), Body, or a sequence of Body
            As for `polygon`; disks that cover it are looked up.
        tolerance : float
            How far these may reach beyond it, m. Half of it takes some 1.4 times as many disks.
        name : str
            For messages and pictures.

        Returns
        -------
        UnsafeSet
            Its level set is at most the signed distance, m, for a point or a disk at most half a pixel's diagonal below
            it.

        Raises
        ------
        ValueError
            If a file is invalid, no pixel is free, there are more than about 33 million pixels, a footprint has no
            three axes to move with, or the tolerance is too small for it.
        MemoryError
            If 130 bytes a pixel are more than is available.
        ImportError
            Without the extra `maps`.

        Examples
        --------
        A wall at the left of a room, in pixels of 0.5 m:

        >>> import numpy as np
        >>> import sdhj
        >>> occupied = np.zeros((9, 9), dtype=bool)
        >>> occupied[:, 0] = True
        >>> wall = sdhj.UnsafeSet.from_map(occupied, resolution=0.5, radius=0.1)
        >>> wall.level_set(np.array([[0.25, 2.25], [2.25, 2.25]]), 0.0) <= 0
        array([ True, False])
        """
        own = _plane(axes, name) if footprint is None else axis_numbers(axes, name)
        robot, allowed = footprint_of(footprint, own), number("tolerance", tolerance, above=0.0)
        distance, place = map_distance(source, resolution, origin, radius, name)
        return cls(own, map_body_level_set(robot, distance, place, allowed), name=name)

    @classmethod
    def polygon(
        cls,
        vertices: FloatArray,
        axes: Sequence[int] = (0, 1),
        *,
        radius: float = 0.0,
        footprint: Footprint = None,
        pose: Pose | None = None,
        outside: bool = False,
        name: str = "polygon",
    ) -> "UnsafeSet":
        """A simple polygon, or what is outside of one, enlarged by the radius of a disk-shaped robot.

        Parameters
        ----------
        vertices : array (K, 2)
            Corners in order, m; in the polygon's own frame if it has a pose.
        axes : sequence of int
            The grid's axes for x and y of a point or a disk, for x, y and heading of a footprint, or those that the
            poses are functions of.
        radius : float
            Of a disk-shaped robot, m.
        footprint : array (K, 2), Body, or a sequence of Body, optional
            The robot's corners in its own frame, m, x ahead, or its bodies; by default a point.
        pose : callable (points (M, axes), t) -> (x, y, heading), optional
            Where the polygon's frame is, m and rad, if it moves.
        outside : bool
            Whether it is a fence: what is outside is unsafe.
        name : str

        Returns
        -------
        UnsafeSet
            Its level set is the signed distance, m, exact outside.

        Raises
        ------
        ValueError
            If edges cross, or the axes do not fit footprint and poses.
        ImportError
            If Shapely is not installed.

        Notes
        -----
        The value is the least signed distance between convex parts of the two: its sign is right everywhere, and where
        they do not meet it is the distance (`sdhj.problem.shapes.bodies`).

        Examples
        --------
        A robot of 1.2 m by 0.5 m in a room of 4 m by 3 m; across its corner, and sideways along a wall:

        >>> import sdhj
        >>> robot = [[-0.3, -0.25], [0.9, -0.25], [0.9, 0.25], [-0.3, 0.25]]
        >>> room = [[0, 0], [4, 0], [4, 3], [0, 3]]
        >>> walls = sdhj.UnsafeSet.polygon(room, axes=(0, 1, 2), footprint=robot, outside=True)
        >>> walls.level_set([[3.2, 2.2, 0.7], [2.0, 0.3, 0.0]], 0.0).round(3)
        array([-0.049,  0.05 ])
        """
        if footprint is None and pose is None and not outside:
            # What stands still and has no footprint has one exact distance, without convex parts.
            return cls(_plane(axes, name), polygon_level_set(vertices, radius), name=name)
        body = Body(vertices, radius, pose)
        if len(body.vertices) < 3:
            raise ValueError(f"vertices must have shape (K, 2), at least three of them, got {body.vertices.shape}")
        return cls._of(body.outside if outside else body.parts, body, axes, footprint, name)

    @classmethod
    def box(
        cls,
        lower: Sequence[float],
        upper: Sequence[float],
        axes: Sequence[int] = (0, 1),
        *,
        radius: float = 0.0,
        footprint: Footprint = None,
        pose: Pose | None = None,
        outside: bool = False,
        name: str = "box",
    ) -> "UnsafeSet":
        """The box from its lower left corner (x, y) to the upper right one.

        Parameters
        ----------
        lower, upper : (float, float)
            The two corners, m.
        axes, radius, footprint, pose, outside, name
            As for `polygon`, and so are errors.

        Examples
        --------
        >>> import sdhj
        >>> table_top = sdhj.UnsafeSet.box([0, 0], [1, 1], radius=0.2)
        >>> table_top.level_set([[1.1, 0.5], [1.5, 0.5]], 0.0).round(3)
        array([-0.1,  0.3])
        """
        (left, low), (right, high) = (
            pair(f"{which} of {name!r}", one) for which, one in (("lower", lower), ("upper", upper))
        )
        if not (left < right and low < high):
            raise ValueError(f"lower must be below upper in both coordinates, got {lower} and {upper}")
        body = Body(np.array([[left, low], [right, low], [right, high], [left, high]]), radius, pose)
        return cls._of(body.outside if outside else body.parts, body, axes, footprint, name)

    @classmethod
    def disk(
        cls,
        centre: Sequence[float],
        radius: float,
        axes: Sequence[int] = (0, 1),
        *,
        footprint: Footprint = None,
        pose: Pose | None = None,
        name: str = "disk",
    ) -> "UnsafeSet":
        """The disk with a centre (x, y) and a radius.

        Parameters
        ----------
        centre : (float, float)
            m
        radius : float
            m; for a disk-shaped robot the sum of both radii.
        axes, footprint, pose, name
            As for `polygon`, and so are errors.

        Examples
        --------
        >>> import sdhj
        >>> sdhj.UnsafeSet.disk([0, 0], radius=0.5).level_set([[0.3, 0.4], [0.6, 0.8]], 0.0).round(3)
        array([0. , 0.5])
        """
        # a point, whose radius is that of the disk
        body = Body(np.array([pair(f"centre of {name!r}", centre)]), radius, pose)
        return cls._of(body.parts, body, axes, footprint, name)

    @classmethod
    def _of(cls, parts: Any, body: Body, axes: Sequence[int], footprint: Footprint, name: str) -> "UnsafeSet":
        """The states in which the robot meets one of the `parts` of a body, or of what is outside of it."""
        own = axis_numbers(axes, name) if footprint is not None or body.pose else _plane(axes, name)
        robot = footprint_of(footprint, own)
        return cls(own, body_level_set(robot, parts, body), name=name)

    def counts(self, inputs: FloatArray | int | None) -> FloatArray:
        """Whether the set is unsafe under each of these inputs, or under all for None."""
        if self.inputs is None or inputs is None:
            return np.full(np.shape(0 if inputs is None else inputs), self.inputs is None)
        return np.isin(inputs, self.inputs)

    def over(self, points: FloatArray, t0: float, t1: float, view_time: str) -> FloatArray:
        """Values (M,) of one static level-set function for all of [t0, t1] (Sec. 5.4, 6.2.1)."""
        if not self.moving:
            return self.level_set(points, t0)
        if view_time == "swept" and self.swept is not None:
            return self.swept(points, t0, t1)
        times = np.linspace(t0, t1, SUBSAMPLES).tolist()
        if view_time == "swept":  # a lower bound over each piece of the time, so that the set contains this one
            pieces = pairwise(times) if t1 > t0 else [(t0, t1)]
            return reduce(np.minimum, [self.level_set.least(points, piece) for piece in pieces])
        return reduce(np.minimum, [self.level_set(points, t) for t in times])  # the union of the sets at these times

    def least(self, low: FloatArray, high: FloatArray, t0: float, t1: float | None, view_time: str) -> FloatArray:
        """Lower bounds (M,) in boxes of the level-set function at t0 or of that of `over`."""
        # case by case as `over`, with the same instants: of sampling="cell" it takes the place of that
        times = [(t0, t0)]
        if self.moving and t1 is not None:
            if view_time == "swept" and self.swept is not None:
                return np.asarray(self.swept.bounds_by_branch(low, high, (t0, t0), (t1, t1))[0])
            ends = np.linspace(t0, t1, SUBSAMPLES).tolist()
            times = list(pairwise(ends)) if view_time == "swept" and t1 > t0 else [(t, t) for t in ends]
        return reduce(np.minimum, [self.level_set.bounds_by_branch(low, high, when)[0] for when in times])


class Solved(Protocol):
    """What `TargetSet.from_table` needs of a table."""

    @property
    def grid(self) -> Grid:
        """The grid of its problem."""

    problem: Any

    def as_level_set(self, within: int | None) -> Callable[[FloatArray, float], FloatArray]:
        """Level-set function (points, t) of the tube, within so many steps, of the step at t."""


@dataclass(frozen=True)
class TargetSet(LevelSet):
    """The target L (Eq. 3), of some axes of the grid: `level_set(points (M, len(axes)), t)` is <= 0 in it at time t.

    Parameters
    ----------
    axes : sequence of int
        As for `UnsafeSet`.
    level_set : callable (points (M, len(axes)), t) -> (M,)
        Of coordinates on these axes and the time, s; <= 0 in the target, > 0 outside, ideally the signed distance.

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
    level_set: Any
    name: str = "target"

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Copied and pickled as any object; `ANYWHERE` by its name, as it is one object in each process."""
        return "ANYWHERE" if self is ANYWHERE else super().__reduce_ex__(protocol)

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", axis_numbers(self.axes, self.name))
        name = f"level set of {self.name!r}"
        object.__setattr__(self, "level_set", Formula.read(name, self.level_set, len(self.axes), "t"))

    @classmethod
    def from_table(cls, table: Solved, within: int | None = None) -> "TargetSet":
        """The tube of another table, as the target of a second problem that leads into it.

        Both problems have the same axes and share one clock. At time t the target is the table's tube from step k = t /
        delta, empty after its last step and between its sampling times; if nothing depends on time in the table's
        problem, that of step 0.

        The tube of a grid table is interpolated (`sdhj.gridded`); that its states reach the first target is not proved.

        For a certified table the target is exactly its certified cells, a black box with an enclosure, and a certified
        table of the second problem proves the whole way: rounding at the handover is within the slack of every
        certified set.

        Parameters
        ----------
        table : Table
        within : int, optional
            By default all steps that are left.

        Examples
        --------
        With the robot on a line of `help(sdhj)`, first into its tube, then on to its target:

        >>> first = sdhj.TargetSet.from_table(table, within=3)
        >>> first.level_set(np.array([[-2.0], [0.0]]), 0.0) <= 0
        array([ True,  True])
        """
        if not hasattr(table, "as_level_set"):
            raise ValueError(f"table must be what sdhj.solve returns, got {type(table).__name__}")
        return cls(tuple(range(table.grid.ndim)), table.as_level_set(within), f"the tube of {table.problem.name}")


ANYWHERE = TargetSet((0,), lambda points, t: np.full(len(points), -1.0), "anywhere")


def _input_numbers(given: Any, name: str) -> tuple[int, ...]:
    """The indices of inputs that a user gave for the unsafe set `name`, ascending, checked."""
    found = given if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) else ()
    numbers = sorted(whole(f"a number in inputs of {name!r}", one, least=0) for one in found)
    if not numbers or len(numbers) != len(set(numbers)):
        raise ValueError(
            f"inputs of {name!r} must be the numbers of some inputs, each once, or left out, got {given!r}"
        )
    return tuple(numbers)


def _plane(axes: Sequence[int], name: str) -> tuple[int, ...]:
    """The two axes for x and y of the set `name`, checked."""
    if len(both := axis_numbers(axes, name)) != 2:
        raise ValueError(f"axes of {name!r} must be two axes of the grid, for x and y, got {axes!r}")
    return both
