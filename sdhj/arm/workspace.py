"""The planar workspace of the case study: a two-link arm, and disks that move on given paths (Sec. 5.2 and 5.3).

Distances are measured from the arm's *skeleton* (its two links as line segments) to a point or to the trace of a moving
point; an arm of half-width w is clear of a disk of radius r where ``distance - r - w > 0``.

All functions of states and times are plain NumPy that `sdhj.formulas` reads: no decisions but `np.where`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sdhj.common.checks import number, option, pair
from sdhj.common.remembering import FloatArray

KINEMATICS = ("relative", "printed")
TURN = 2.0 * np.pi


class Segment(NamedTuple):
    """Line segments in the plane from `start` (..., 2), m, for `length` (...) in a unit `direction` (..., 2).

    Distances to them need neither divisions nor a case for segments that are points.
    """

    start: FloatArray
    direction: FloatArray
    length: Any

    @classmethod
    def point(cls, points: FloatArray) -> "Segment":
        """Points (..., 2) as segments of length 0."""
        return cls(points, np.array([1.0, 0.0]), 0.0)

    def at(self, along: Any) -> FloatArray:
        """The point (..., 2) of the line that is `along` (...) from the start."""
        return self.start + np.asarray(along)[..., None] * self.direction

    @property
    def end(self) -> FloatArray:
        return self.at(self.length)

    def coordinates(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where points (..., 2) are, seen from the start: along the direction, and to its left."""
        out, (x, y) = points - self.start, np.moveaxis(self.direction, -1, 0)
        return out[..., 0] * x + out[..., 1] * y, out[..., 1] * x - out[..., 0] * y

    def distance(self, points: FloatArray) -> FloatArray:
        """Distance of points (..., 2) from the segments, broadcast: (...)."""
        along, left = self.coordinates(points)
        beyond = np.maximum(along - self.length, np.minimum(along, 0.0))  # 0 beside the segment
        return np.hypot(beyond, left)


def segment_distance(one: Segment, other: Segment) -> FloatArray:
    """Distance between segments, which broadcast: (...), m; 0 where they cross."""
    # Segments that do not cross are nearest at an end of one of them. Where rounding hides a crossing, it is within
    # rounding of an end, and that end's distance is within rounding of zero.
    ends, others = (one.start, one.end), (other.start, other.end)
    nearest = reduce(np.minimum, [other.distance(end) for end in ends] + [one.distance(end) for end in others])
    split = np.multiply(*(one.coordinates(end)[1] for end in others)) < 0.0
    splits = np.multiply(*(other.coordinates(end)[1] for end in ends)) < 0.0
    return np.where(split & splits, 0.0, nearest)


def _unit(angle: FloatArray) -> FloatArray:
    """(cos a, sin a) of angles a (...): (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


class _Path:
    """Base of the paths of a point, whose fields are checked when they are made.

    A path has its position `at(t)`, (*t.shape, 2), a bound `speed` on its speed, and `swept_distance(segment, t0, t1)`,
    the least distance (...) from segments to its trace over [t0, t1]; s, m, m/s.
    """

    def __post_init__(self) -> None:
        # a field of another path that has two numbers is named here, or it is refused
        for name, value in vars(self).items():
            of_two = name in ("centre", "start", "velocity")
            least = 0.0 if name == "radius" else -np.inf
            object.__setattr__(self, name, pair(name, value) if of_two else number(name, value, least=least))


@dataclass(frozen=True)
class Still(_Path):
    """The path of a point that stays at `centre`, m."""

    centre: tuple[float, float]
    speed = 0.0

    def at(self, t: ArrayLike) -> FloatArray:
        return np.asarray(self.centre) + 0.0 * np.asarray(t, dtype=np.float64)[..., None]

    def swept_distance(self, segment: Segment, t0: float, t1: float) -> FloatArray:
        return segment.distance(self.at(t0))


@dataclass(frozen=True)
class Line(_Path):
    """The path of a point at `start` + t * `velocity` (m, m/s)."""

    start: tuple[float, float]
    velocity: tuple[float, float]

    @property
    def speed(self) -> float:
        return float(np.hypot(*self.velocity))

    def at(self, t: ArrayLike) -> FloatArray:
        return np.asarray(self.start) + np.asarray(t, dtype=np.float64)[..., None] * np.asarray(self.velocity)

    def swept_distance(self, segment: Segment, t0: float, t1: float) -> FloatArray:
        """The distance to the segment that it traces."""
        direction = np.array(self.velocity) / self.speed if self.speed else np.array([1.0, 0.0])
        return segment_distance(segment, Segment(self.at(t0), direction, self.speed * (t1 - t0)))


@dataclass(frozen=True)
class Circle(_Path):
    """The path of a point on the circle of `radius` about `centre`, m, at the angle `rate` t + `phase`, rad."""

    centre: tuple[float, float]
    radius: float
    rate: float
    phase: float = 0.0

    @property
    def speed(self) -> float:
        return self.radius * abs(self.rate)

    def at(self, t: ArrayLike) -> FloatArray:
        angle = self.rate * np.asarray(t, dtype=np.float64) + self.phase
        return np.asarray(self.centre) + self.radius * _unit(angle)

    def swept_distance(self, segment: Segment, t0: float, t1: float) -> FloatArray:
        """The distance to the arc that it traces: too small by rounding at most."""
        # A nearest pair either has an end of the arc in it, or is radial: the point of the segment then stands at a
        # minimum of | distance from the centre - radius | along the segment, and the arc faces it. Such minima are
        # where the segment crosses the circle, at the foot of the perpendicular from the centre where the line stays
        # outside, and at ends of the segment. `half_chord` is half the chord that the circle cuts from the segment's
        # line (0 where it cuts none), so foot - half_chord and foot + half_chord, clipped to the segment, are all of
        # them: an end inside the circle lies between the two, an end outside that is a minimum has both beyond it.
        foot, left = segment.coordinates(np.array(self.centre))
        half_chord = np.sqrt(np.maximum(self.radius**2 - np.square(left), 0.0))
        first = self.rate * (t0 if self.rate >= 0.0 else t1) + self.phase
        nearest = np.minimum(segment.distance(self.at(t0)), segment.distance(self.at(t1)))
        for along in (foot - half_chord, foot + half_chord):
            out = segment.at(np.clip(along, 0.0, segment.length)) - np.array(self.centre)
            angle = np.mod(np.arctan2(out[..., 1], out[..., 0]) - first, TURN)
            radial = np.abs(np.hypot(out[..., 0], out[..., 1]) - self.radius)
            nearest = np.where(angle <= abs(self.rate) * (t1 - t0), np.minimum(nearest, radial), nearest)
        return nearest


Path = Still | Line | Circle
PATH_KINDS: dict[str, type] = {"still": Still, "line": Line, "circle": Circle}


@dataclass(frozen=True)
class Disk:
    """A disk whose centre moves along a Still, Line or Circle; radius in m."""

    path: Path
    radius: float

    def __post_init__(self) -> None:
        if not isinstance(self.path, Still | Line | Circle):
            raise ValueError(f"path of a disk must be a Still, Line or Circle, got {self.path!r}")
        object.__setattr__(self, "radius", number("radius of the disk", self.radius, least=0.0))

    @property
    def speed(self) -> float:
        """A bound on the speed of the centre, m/s."""
        return self.path.speed

    def centre(self, t: ArrayLike) -> FloatArray:
        """Centre at the times t; shape (*t.shape, 2)."""
        return self.path.at(t)

    def describe(self) -> dict[str, Any]:
        """The disk as plain numbers, lists and strings, which `Disk.of` reads back."""
        # recipes in files have this, by names of classes and fields; `disk` in the checker's `arm.claims` reads it
        plain = {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self.path).items()}
        return {"radius": self.radius, "path": {"kind": type(self.path).__name__.lower(), **plain}}

    @classmethod
    def of(cls, disk: "Disk | Mapping[str, Any]") -> "Disk":
        """A Disk, also from a dictionary of `describe`."""
        if isinstance(disk, cls):
            return disk
        # what `describe` has made: recipes of files come back here
        try:
            path = dict(disk["path"])  # type: ignore[index]
            kind = path.pop("kind")
            return cls(PATH_KINDS[kind](**path), disk["radius"])  # type: ignore[index]
        except (TypeError, KeyError, AttributeError, IndexError):
            raise ValueError(
                "a disk must be a Disk or {'radius': r, 'path': {'kind': one of "
                f"{', '.join(PATH_KINDS)}, ...}}}}, got {disk!r}"
            ) from None


@dataclass(frozen=True)
class Arm:
    """A planar arm with two links, its base at the origin (Sec. 5.2); angles q (M, 2) in rad.

    Of the kinematics "relative" is the textbook arm, whose second link has the length l2 and the angle q1 + q2.
    "printed" is Eq. (8) as printed, with the second term (l1 + l2) (cos q2, sin q2): from the same elbow, l1 (cos q1,
    sin q1), the second link has the length l1 + l2 and the absolute angle q2.
    """

    lengths: tuple[float, float] = (0.15, 0.15)  # l1 and l2, m
    half_width: float = 0.01  # by which each link is thicker than its segment, on each side and at its ends, m
    kinematics: str = "relative"  # or "printed"

    def __post_init__(self) -> None:
        object.__setattr__(self, "lengths", pair("lengths", self.lengths, above=0.0))
        object.__setattr__(self, "half_width", number("half_width", self.half_width, least=0.0))
        option("kinematics", self.kinematics, KINEMATICS)

    def links(self, q: FloatArray) -> tuple[Segment, Segment]:
        """The two links at joint angles q (..., 2), from the base to the tip."""
        q = np.asarray(q, dtype=np.float64)
        if q.ndim < 1 or q.shape[-1] != 2:
            raise ValueError(f"joint angles must have shape (..., 2), got {q.shape}")
        # proofs have these kinematics in `sdhj.certified.arm.proof`, and the checker in its `Scene.world` and `joints`
        l1, l2 = self.lengths
        relative = self.kinematics == "relative"
        upper = Segment(np.zeros(2), _unit(q[..., 0]), l1)
        angle = q[..., 0] + q[..., 1] if relative else q[..., 1]
        return upper, Segment(upper.end, _unit(angle), l2 if relative else l1 + l2)

    def joints(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions of elbow and tip, (..., 2) each, m."""
        upper, lower = self.links(q)
        return upper.end, lower.end

    def tip(self, q: FloatArray) -> FloatArray:
        """The end-effector's position E[q] of Eq. (4), (..., 2), m."""
        return self.joints(q)[1]

    def distance(self, q: FloatArray, points: FloatArray) -> FloatArray:
        """Distance from the skeleton to points (2,) or (M, 2): (M,), m."""
        upper, lower = self.links(q)
        if points.shape not in ((2,), lower.start.shape):
            raise ValueError(f"points must have shape (2,) or {lower.start.shape}, got {points.shape}")
        return np.minimum(upper.distance(points), lower.distance(points))

    def swept_distance(self, q: FloatArray, path: Path, t0: float, t1: float) -> FloatArray:
        """The least distance from the skeleton to a point on `path` during [t0, t1]: (M,), m."""
        # the infimum over all times, not over samples (Sec. 6.2.1)
        upper, lower = self.links(q)
        return np.minimum(path.swept_distance(upper, t0, t1), path.swept_distance(lower, t0, t1))

    def outline(self, q: Sequence[float] | FloatArray, arc_points: int = 12) -> FloatArray:
        """The closed outline of the arm at q (2,), for drawing: (V, 2), m.

        It lies inside the true outline, by less than half_width * (pi / (4 * arc_points))**2.
        """
        try:
            from shapely import LineString  # only drawing needs it
        except ImportError as error:
            raise ImportError("drawing an arm needs Shapely, which is missing: pip install 'sdhj[plot]'") from error
        elbow, tip = self.joints(np.asarray(q, dtype=np.float64).reshape(2))
        skeleton = np.stack([np.zeros(2), elbow, tip, elbow, np.zeros(2)])
        if self.half_width == 0.0:
            return skeleton
        return np.asarray(LineString(skeleton[:3]).buffer(self.half_width, quad_segs=arc_points).exterior.coords)
