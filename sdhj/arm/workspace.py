"""The planar workspace of the case study: a two-link arm, and disks that move on given paths (Sec. 5.2 and 5.3).

Lengths are in metres, angles in radians, times in seconds. Distances are measured from the arm's *skeleton* (its two
links as line segments) to a point or to the trace of a moving point; an arm of half-width w is clear of a disk of
radius r where ``distance - r - w > 0``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sdhj.kernels import FloatArray
from sdhj.kernels.skeleton import POINT, joints, skeleton_distances
from sdhj.problem.checks import number, pair

KINEMATICS = ("relative", "printed")
TURN = 2.0 * np.pi


def _dot_product(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _norm(a: FloatArray) -> FloatArray:
    return np.sqrt(_dot_product(a, a))


def _foot(start: FloatArray, along: FloatArray, points: FloatArray) -> FloatArray:
    """The s at which start + s * along is nearest to each point, not clipped; 0 where `along` has no length."""
    square = _dot_product(along, along)
    return _dot_product(points - start, along) / np.where(square > POINT, square, np.inf)


def point_segment_distance(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distance from points (..., 2) to the segments start-end (..., 2), broadcast; start and end may be equal."""
    along = end - start
    s = np.clip(_foot(start, along, points), 0.0, 1.0)
    return _norm(start + s[..., None] * along - points)


def segment_segment_distance(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Distance between the segments a-b and c-d, all (..., 2) and broadcast.

    Two segments that do not cross are nearest at an end of one of them. Where rounding hides a crossing, it is
    within rounding of an end, and that end's distance is within rounding of zero.
    """
    nearest = np.minimum(
        np.minimum(point_segment_distance(a, c, d), point_segment_distance(b, c, d)),
        np.minimum(point_segment_distance(c, a, b), point_segment_distance(d, a, b)),
    )
    splits_cd = _cross(b - a, c - a) * _cross(b - a, d - a) < 0.0
    splits_ab = _cross(d - c, a - c) * _cross(d - c, b - c) < 0.0
    return np.where(splits_cd & splits_ab, 0.0, nearest)


def skeleton_clearance(elbow: FloatArray, tip: FloatArray, centres: FloatArray, radii: FloatArray) -> FloatArray:
    """Least distance from the arm's links, origin-elbow and elbow-tip (M, 2), to disks; shape (M,).

    The disks have radii (D,) and centres (D, 2), or (M, D, 2) for different centres in each row. The distance to a
    centre is bit-for-bit the smaller `point_segment_distance`; one compiled pass, as simulations spend most time here.
    """
    out = np.empty(len(elbow))
    skeleton_distances(elbow, tip, np.broadcast_to(centres, (len(elbow), len(radii), 2)), radii, out)
    return out


@dataclass(frozen=True)
class Still:
    """A point that stays at `centre`."""

    centre: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", pair("centre", self.centre))

    @property
    def speed(self) -> float:
        """A bound on the speed, m/s."""
        return 0.0

    def at(self, t: ArrayLike) -> FloatArray:
        """Position at the times t; shape (*t.shape, 2)."""
        return np.asarray(self.centre) + 0.0 * np.asarray(t, dtype=np.float64)[..., None]

    def swept_distance(self, start: FloatArray, end: FloatArray, t0: float, t1: float) -> FloatArray:
        """Distance from the segments start-end (M, 2) to the trace over [t0, t1], here a point; shape (M,)."""
        return point_segment_distance(self.at(t0), start, end)


@dataclass(frozen=True)
class Line:
    """A point at `start` + t * `velocity` (m, m/s)."""

    start: tuple[float, float]
    velocity: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", pair("start", self.start))
        object.__setattr__(self, "velocity", pair("velocity", self.velocity))

    @property
    def speed(self) -> float:
        """A bound on the speed (here the speed itself), m/s."""
        return float(np.hypot(*self.velocity))

    def at(self, t: ArrayLike) -> FloatArray:
        """Position at the times t; shape (*t.shape, 2)."""
        return np.asarray(self.start) + np.asarray(t, dtype=np.float64)[..., None] * np.asarray(self.velocity)

    def swept_distance(self, start: FloatArray, end: FloatArray, t0: float, t1: float) -> FloatArray:
        """Distance from the segments start-end (M, 2) to the trace over [t0, t1], here a segment; shape (M,)."""
        return segment_segment_distance(start, end, self.at(t0), self.at(t1))


@dataclass(frozen=True)
class Circle:
    """A point on the circle of `radius` about `centre`, at the angle `rate` * t + `phase` (m, rad/s, rad)."""

    centre: tuple[float, float]
    radius: float
    rate: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", pair("centre", self.centre))
        object.__setattr__(self, "radius", number("radius of the circle", self.radius, least=0.0))
        object.__setattr__(self, "rate", number("rate", self.rate))
        object.__setattr__(self, "phase", number("phase", self.phase))

    @property
    def speed(self) -> float:
        """A bound on the speed (here the speed itself), m/s."""
        return self.radius * abs(self.rate)

    def at(self, t: ArrayLike) -> FloatArray:
        """Position at the times t; shape (*t.shape, 2)."""
        angle = self.rate * np.asarray(t, dtype=np.float64) + self.phase
        return np.asarray(self.centre) + self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def _arc_distance(self, points: FloatArray, t0: float, t1: float) -> FloatArray:
        """Distance from points (M, 2) to the arc travelled over [t0, t1]; shape (M,)."""
        span = abs(self.rate) * (t1 - t0)
        first = min(self.rate * t0, self.rate * t1) + self.phase
        out = points - np.asarray(self.centre)
        facing = np.mod(np.arctan2(out[..., 1], out[..., 0]) - first, TURN) <= span
        ends = np.minimum(_norm(points - self.at(t0)), _norm(points - self.at(t1)))
        return np.where(facing, np.abs(_norm(out) - self.radius), ends)

    def swept_distance(self, start: FloatArray, end: FloatArray, t0: float, t1: float) -> FloatArray:
        """Distance from the segments start-end (M, 2) to the trace over [t0, t1], here an arc; shape (M,).

        A nearest pair either has an end of the arc in it, or is radial: the point of the segment then stands at a
        minimum of | distance from the centre - radius | along the segment, and its own distance to the arc is the
        answer. Such minima are where the segment crosses the circle, at the foot of the perpendicular from the centre
        where the line stays outside, and at ends of the segment. `reach` is half the chord that the circle cuts from
        the segment's line (0 where it cuts none), so foot - reach and foot + reach, clipped to the segment, are all
        of them: an end inside the circle lies between the two, an end outside that is a minimum has both beyond it.
        Each candidate is the distance between two points that exist, so the answer is too small by rounding at most.
        """
        along = end - start
        centre = np.asarray(self.centre)
        foot = _foot(start, along, centre)
        depth = self.radius**2 - np.square(_norm(start + foot[..., None] * along - centre))
        square = _dot_product(along, along)
        reach = np.sqrt(np.maximum(depth, 0.0) / np.where(square > POINT, square, np.inf))
        nearest = np.minimum(
            point_segment_distance(self.at(t0), start, end), point_segment_distance(self.at(t1), start, end)
        )
        for s in (foot - reach, foot + reach):
            candidate = start + np.clip(s, 0.0, 1.0)[..., None] * along
            nearest = np.minimum(nearest, self._arc_distance(candidate, t0, t1))
        return nearest


Path = Still | Line | Circle
PATH_KINDS: dict[str, type] = {"still": Still, "line": Line, "circle": Circle}


@dataclass(frozen=True)
class Disk:
    """A disk of `radius` (m; zero for a point) whose centre moves along `path`, a Still, Line or Circle."""

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
        """The disk as plain numbers, lists and strings (JSON), which `Disk.of` reads back."""
        plain = {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self.path).items()}
        return {"radius": self.radius, "path": {"kind": type(self.path).__name__.lower(), **plain}}

    @classmethod
    def of(cls, disk: "Disk | Mapping[str, Any]") -> "Disk":
        """Return `disk` itself if it is a Disk, else the Disk that a dictionary from `describe` stands for.

        Raises
        ------
        ValueError
            If `disk` is neither.
        """
        if isinstance(disk, cls):
            return disk
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
    """A planar arm with two links, its base at the origin (Sec. 5.2).

    Parameters
    ----------
    lengths : (float, float)
        l1 and l2, m.
    half_width : float
        Each link is its segment thickened by this much on each side and at its ends, m.
    kinematics : {"relative", "printed"}
        "relative" is the textbook arm: the second link has length l2 and the angle q1 + q2. "printed" is Eq. (8)
        exactly as printed, with the second term (l1 + l2) (cos q2, sin q2): the second link then begins at the same
        elbow, l1 (cos q1, sin q1), and has length l1 + l2 and the absolute angle q2.
    """

    lengths: tuple[float, float] = (0.15, 0.15)
    half_width: float = 0.01
    kinematics: str = "relative"

    def __post_init__(self) -> None:
        object.__setattr__(self, "lengths", pair("lengths", self.lengths, above=0.0))
        object.__setattr__(self, "half_width", number("half_width", self.half_width, least=0.0))
        if self.kinematics not in KINEMATICS:
            raise ValueError(f"kinematics must be one of {', '.join(KINEMATICS)}, got {self.kinematics!r}")

    def joints(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions of elbow and tip, each of shape (..., 2), at joint angles q (..., 2)."""
        q = np.asarray(q, dtype=np.float64)
        if q.ndim < 1 or q.shape[-1] != 2:
            raise ValueError(f"joint angles must have shape (..., 2), got {q.shape}")
        l1, l2 = self.lengths
        relative = self.kinematics == "relative"
        reach = l2 if relative else l1 + l2
        first, second = q[..., 0].ravel(), q[..., 1].ravel()
        if relative:
            second = first + second
        elbow, tip = np.empty((first.size, 2)), np.empty((first.size, 2))
        joints(np.cos(first), np.sin(first), np.cos(second), np.sin(second), (l1, reach), elbow, tip)
        return elbow.reshape(q.shape), tip.reshape(q.shape)

    def tip(self, q: FloatArray) -> FloatArray:
        """The end-effector's position E[q] of Eq. (4), shape (..., 2)."""
        return self.joints(q)[1]

    def distance(self, q: FloatArray, points: FloatArray) -> FloatArray:
        """Distance from the skeleton at q (M, 2) to points, one (2,) or one for each row (M, 2); shape (M,), m."""
        elbow, tip = self.joints(q)
        points = np.asarray(points, dtype=np.float64)
        if points.shape not in ((2,), elbow.shape):
            raise ValueError(f"points must have shape (2,) or {elbow.shape}, got {points.shape}")
        return skeleton_clearance(elbow, tip, points[..., None, :], np.zeros(1))

    def swept_distance(self, q: FloatArray, path: Path, t0: float, t1: float) -> FloatArray:
        """Distance from the skeleton at q (M, 2) to the trace of a point on `path` during [t0, t1]; shape (M,), m.

        It is the infimum over all times, not over samples (Sec. 6.2.1), and exact up to rounding for every `path`.
        """
        if not t0 <= t1:
            raise ValueError(f"an interval needs t0 <= t1, got [{t0}, {t1}]")
        elbow, tip = self.joints(q)
        base = np.zeros(2)
        return np.minimum(path.swept_distance(base, elbow, t0, t1), path.swept_distance(elbow, tip, t0, t1))

    def outline(self, q: Sequence[float] | FloatArray, arc_points: int = 12) -> FloatArray:
        """Outline of the region R(q) that the arm occupies at the joint angles q (2,), for drawing.

        It is a closed polygon (V, 2), inside the true shape by less than half_width * (pi / (4 * arc_points))**2.
        """
        try:
            from shapely import LineString  # only drawing needs it
        except ImportError as error:
            raise ImportError(
                "the outline of an arm needs Shapely, which is not installed: pip install 'sdhj[plot]'"
            ) from error
        elbow, tip = self.joints(np.asarray(q, dtype=np.float64).reshape(2))
        skeleton = np.stack([np.zeros(2), elbow, tip, elbow, np.zeros(2)])
        if self.half_width == 0.0:
            return skeleton
        return np.asarray(LineString(skeleton[:3]).buffer(self.half_width, quad_segs=arc_points).exterior.coords)
