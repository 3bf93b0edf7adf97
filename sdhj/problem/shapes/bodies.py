"""Rigid bodies in the plane: the signed distance between a robot's parts and what it must not touch, as formulas.

Let A and B be convex, and a body's edges have outward normals n and offsets h, so that n . q <= h within. B is apart
from A if some edge of one has all corners of the other beyond it (the separating axis theorem), so the number

    s = max over the edges of both, min over the corners q of the other one, of n . q - h

is above 0 if and only if they do not meet. Where they do, -s is how far one has to be moved until they only touch.
Where they do not, their distance is the least one of a corner of one to an edge of the other. A segment has edges to
both sides and beyond both ends; a point has none. Other polygons are unions of convex ones, and their distance is the
least one of the parts; a radius is subtracted.

A corner c that turns by the angle a is along n by |n| |c| cos(a + phase), one cosine rather than two products, so that
the bounds over an interval of headings are tight.

A map is known by the signed distance at points (`sdhj.problem.shapes.maps`). There a footprint is covered by disks,
each as deep in it as its radius less a tolerance: what they reach beyond it is at most that.
"""

import math
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from sdhj.common.checks import finite_array, number
from sdhj.common.remembering import FloatArray
from sdhj.problem.shapes.polygons import ROUNDING, box_without, convex_parts, outline, polygon_level_set

Pose = Callable[[Any, Any], Sequence[Any]]  # (points, t) -> x, y and heading, each (M,) or a number
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # rows times it are a quarter turn to the left
UNIT = np.eye(2)
QUARTERS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
FINE = 0.25  # of how deep a square lies, or of the tolerance: half the side of squares that disks are made of
MOST_SQUARES = 8_000


class Part(NamedTuple):
    """A convex body, or a half-plane: its points q have normal @ q <= offset for all edges.

    A segment has edges to both sides and beyond both ends, a point has none, a half-plane one edge and no corner.
    """

    corners: FloatArray  # (K, 2), counter-clockwise
    normals: FloatArray  # (E, 2), outward unit vectors of the edges
    ends: FloatArray  # (E, 2), of each edge the coordinates of its begin and end along itself, the normal turned left
    offsets: FloatArray  # (E,)


def part(corners: FloatArray, larger: float = 0.0) -> Part:
    """The convex `Part` with these corners (K, 2), counter-clockwise; edges lie `larger` out."""
    if len(corners) == 1:
        return Part(corners, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    begin, end = corners, np.roll(corners, -1, axis=0)
    along = (end - begin) / np.hypot(*(end - begin).T)[:, None]
    if len(corners) == 2:  # beyond its ends are edges of no length
        begin, end, along = *np.concatenate([[begin, end], [end, end]], axis=1), np.concatenate([along, along @ TURN])
    normals = along @ -TURN
    offsets = (normals * end).sum(axis=1) + larger
    return Part(corners, normals, np.stack([(along * one).sum(axis=1) for one in (begin, end)], axis=1), offsets)


def half_plane(normal: Any, offset: float) -> Part:
    """The half-plane of all points q with normal @ q >= offset, |normal| = 1."""
    return Part(np.zeros((0, 2)), -np.array([normal]), np.zeros((1, 2)), np.array([-offset]))


@dataclass(frozen=True)
class Body:
    """A rigid body in the plane: a robot's footprint, a link of an arm, or an obstacle.

    Parameters
    ----------
    vertices : array (K, 2)
        In the body's own frame, m: corners of a simple polygon in order, ends of a segment, or one point.
    radius : float
        By which it is enlarged, m.
    pose : callable (points (M, axes), t) -> (x, y, heading), optional
        Where the body's frame is, m and rad. By default the three axes of its set.

    Raises
    ------
    ValueError
        If edges cross.
    ImportError
        If a polygon needs Shapely, which is not installed.

    Examples
    --------
    The links of an arm, 0.3 m long and 0.04 m wide, by its joint angles:

    >>> import numpy as np
    >>> import sdhj
    >>> upper = sdhj.Body([[0, 0], [0.3, 0]], radius=0.02, pose=lambda q, t: (0.0, 0.0, q[:, 0]))
    >>> lower = sdhj.Body(
    ...     [[0, 0], [0.3, 0]],
    ...     radius=0.02,
    ...     pose=lambda q, t: (0.3 * np.cos(q[:, 0]), 0.3 * np.sin(q[:, 0]), q[:, 0] + q[:, 1]),
    ... )
    >>> post = sdhj.UnsafeSet.disk([0.3, 0.5], radius=0.05, footprint=[upper, lower])
    >>> post.level_set(np.array([[0.0, 0.0], [0.0, np.pi / 2]]), 0.0)
    array([0.43, 0.13])
    """

    vertices: FloatArray
    radius: float = 0.0
    pose: Pose | None = None

    def __post_init__(self) -> None:
        vertices = finite_array("vertices of a body", self.vertices)
        if vertices.ndim != 2 or vertices.shape[1:] != (2,) or not len(vertices):
            raise ValueError(f"vertices of a body must have shape (K, 2), one of them at least, got {vertices.shape}")
        if len(vertices) == 2 and (vertices[0] == vertices[1]).all():
            vertices = vertices[:1]
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "radius", number("radius of a body", self.radius, least=0.0))
        if self.pose is not None and not callable(self.pose):
            raise ValueError("the pose of a body must be a function of (points, t) that returns x, y and heading")
        _ = self.parts  # refuses edges that cross, here and not at the first look

    @cached_property
    def parts(self) -> list[Part]:
        """The convex parts of the body, in its own frame, without its radius."""
        return [part(self.vertices)] if len(self.vertices) < 3 else parts_of(outline(self.vertices))

    @cached_property
    def outside(self) -> list[Part]:
        """The convex parts of all that is outside of a polygon: those of the box around it, and what is beyond."""
        shape = outline(self.vertices)
        left, low, right, high = shape.bounds
        # half-planes have no corner, so they can only be the second part of `clearance`
        sides = [
            half_plane(UNIT[0], right),
            half_plane(-UNIT[0], -left),
            half_plane(UNIT[1], high),
            half_plane(-UNIT[1], -low),
        ]
        return [*sides, *parts_of(box_without(shape))]

    def placed(self, points: Any, t: Any) -> Sequence[Any]:
        """The body's pose, by default the first three coordinates, at points and time t: x, y, heading."""
        if self.pose is None:
            return points[:, 0], points[:, 1], points[:, 2]
        pose = self.pose(points, t)
        if not isinstance(pose, tuple | list) or len(pose) != 3:
            raise ValueError(
                "the pose of a body must return x, y and heading, as lambda q, t: (q[:, 0], q[:, 1], 0.0) does, got "
                f"{reprlib.repr(pose)}"
            )
        return pose


def parts_of(shape: Any) -> list[Part]:
    """The convex parts of polygons of Shapely, without those of no area."""
    corners_of_each = convex_parts(shape)
    # edges that parts share are moved outward, so that rounding loses no point on them
    size = max((float(np.ptp(corners)) for corners in corners_of_each), default=0.0)
    return [part(corners, ROUNDING * size if len(corners_of_each) > 1 else 0.0) for corners in corners_of_each]


def dot_turned(a: FloatArray, b: FloatArray, heading: Any) -> Any:
    """a @ R(heading) b for vectors (2,) as |a| |b| cos(heading + phase), which has tight bounds over headings."""
    cosine, sine = float(a @ b), float(a[0] * b[1] - a[1] * b[0])
    if cosine < 0.0 or (cosine == 0.0 and sine < 0.0):  # opposite ones share a node
        return -dot_turned(-a, b, heading)
    size = math.hypot(cosine, sine)
    return size * np.cos(heading + math.atan2(sine, cosine)) if size else 0.0


def clearance(a: Part, b: Part, x: Any, y: Any, heading: Any) -> Any:
    """Signed distance, (M,), between a part `a`, in a frame with a pose, and a part `b`, which stands still.

    The s of the module where the parts meet, else the least distance of a corner to an edge, or s if b is a half-plane.
    `a` must have a corner.
    """

    def of_a(n: FloatArray) -> list[Any]:
        return [n[0] * x + n[1] * y + dot_turned(n, corner, heading) for corner in a.corners]

    def of_b(n: FloatArray) -> list[Any]:
        along = dot_turned(UNIT[0], n, heading), dot_turned(UNIT[1], n, heading)
        return [(p - x) * along[0] + (q - y) * along[1] for p, q in b.corners]

    beside = list[tuple[list[Any], list[Any], FloatArray]]()  # of each edge: how far corners are beyond and along it
    # corners of `a` along normals of `b`, and of `b` along those of `a`, in the frame of `a`
    for body, far in ((b, of_a), (a, of_b)) if len(b.corners) else ((b, of_a),):
        for normal, ends, offset in zip(body.normals, body.ends, body.offsets, strict=True):
            # `part` has measured `ends` along normal @ TURN, too
            beside.append(([one - offset for one in far(normal)], far(normal @ TURN), ends))
    if not beside:  # two points
        (p, q), corner = b.corners[0], a.corners[0]
        return np.hypot(x + dot_turned(UNIT[0], corner, heading) - p, y + dot_turned(UNIT[1], corner, heading) - q)
    apart = reduce(np.maximum, [reduce(np.minimum, beyond_it) for beyond_it, *_ in beside])
    if not len(b.corners):
        return apart
    squares = [
        np.square(beyond) + np.square(np.maximum(np.maximum(along - ends[1], ends[0] - along), 0.0))
        for beyond_it, along_it, ends in beside
        for beyond, along in zip(beyond_it, along_it, strict=True)
    ]
    distance = np.sqrt(reduce(np.minimum, squares))
    return np.where(apart > 0.0, np.maximum(apart, distance), apart)


def relative(pose: Sequence[Any], other: Sequence[Any]) -> Sequence[Any]:
    """The pose seen from a frame with the pose `other`: R(-turned) (x - a, y - b), heading - turned; also traced."""
    (x, y, heading), (a, b, turned) = pose, other
    still = isinstance(turned, float)  # NumPy's functions have other bits on other processors
    cosine, sine = (math.cos(turned), math.sin(turned)) if still else (np.cos(turned), np.sin(turned))
    return cosine * (x - a) + sine * (y - b), cosine * (y - b) - sine * (x - a), heading - turned


POINT = Body(np.zeros((1, 2)), pose=lambda points, t: (points[:, 0], points[:, 1], 0.0))
Footprint = Any  # vertices, a Body, or several


def footprint_of(given: Footprint, axes: Sequence[int]) -> list[Body]:
    """The bodies that a user gives as a footprint; one without a pose needs three axes."""
    if given is None:
        return [POINT]
    bodies = [given] if isinstance(given, Body) else list(given)
    if not bodies or not all(isinstance(one, Body) for one in bodies):
        # What are no bodies are the corners of one.
        bodies = [Body(given)]
    if any(one.pose is None for one in bodies) and len(axes) != 3:
        raise ValueError(
            f"a footprint moves with x, y and heading, so it needs three axes, as axes=(0, 1, 2), got {tuple(axes)}; "
            "of other axes sdhj.Body(vertices, pose=lambda q, t: (q[:, 0], q[:, 1], 0.0)) says how it moves"
        )
    return bodies


def body_level_set(
    robot: Sequence[Body], parts: Sequence[Part], obstacle: Body
) -> Callable[[FloatArray, float], FloatArray]:
    """The level-set function of states in which a robot meets `parts` of an obstacle, or of what is outside."""

    # called once, traced (`Formula.read`): nothing in it may hang on values
    def level_set(points: FloatArray, t: float) -> FloatArray:
        place, found = obstacle.placed(points, t) if obstacle.pose else None, list[Any]()
        for body in robot:
            at = body.placed(points, t)
            at = at if place is None else relative(at, place)
            each = [clearance(one, other, *at) for one, other in product(body.parts, parts)]
            found.append(reduce(np.minimum, each) - (body.radius + obstacle.radius))
        return reduce(np.minimum, found)

    return level_set


def covering_disks(body: Body, tolerance: float) -> FloatArray:
    """Disks (K, 3), x, y, radius, that cover a body without its radius and reach at most `tolerance` beyond it, m.

    The square around it is halved until half the side of each is at most `FINE` times the depth of its middle in the
    body, or times the tolerance; a disk about each middle, of this depth plus the tolerance, is a candidate.
    """
    if len(body.vertices) == 1:
        return np.array([[*body.vertices[0], 0.0]])
    (left, low), (right, high) = body.vertices.min(axis=0), body.vertices.max(axis=0)
    side, middles, sides = max(right - left, high - low), list[FloatArray](), list[FloatArray]()
    centres = np.array([[left + right, low + high]]) / 2
    while len(centres):
        depth, half = depths_in_body(body, centres), side / 2
        near = depth > -half * math.sqrt(2.0)  # others have nothing of the body
        done = near & (half <= np.maximum(depth, tolerance) * FINE)
        middles.append(centres[done])
        sides.append(np.full(int(done.sum()), half))
        if (count := sum(map(len, middles)) + 4 * int((near & ~done).sum())) > MOST_SQUARES:
            raise ValueError(
                f"to cover a footprint of {right - left:g} m by {high - low:g} m to {tolerance:g} m takes more than "
                f"{count:,} squares; allow a greater tolerance"
            )
        centres = (centres[near & ~done, None] + QUARTERS * half / 2).reshape(-1, 2)
        side = half
    squares, halves = np.concatenate(middles), np.concatenate(sides)
    radii = depths_in_body(body, squares) + tolerance
    return fewest_disks(squares, halves, radii)


def fewest_disks(squares: FloatArray, halves: FloatArray, radii: FloatArray) -> FloatArray:
    """Some of the disks about the middles of squares (M, 2) such that each square lies in one.

    That needs radii above half of the squares' diagonals, as `covering_disks` makes them.
    """
    corners = squares[:, None] + QUARTERS * halves[:, None, None]
    # Others do not have even their own square.
    able = np.flatnonzero(radii > halves * math.sqrt(2.0))
    covers = np.ones((len(able), len(squares)), np.bool_)
    for k in range(len(QUARTERS)):
        gap = np.hypot(*(squares[able, None] - corners[None, :, k]).transpose(2, 0, 1))
        covers &= gap <= radii[able, None]
    counts, found = covers.sum(axis=1), list[int]()
    while counts.any():  # greedy: the disk in which most of the squares that are left lie
        best = int(np.argmax(counts))
        found.append(int(able[best]))
        new = np.flatnonzero(covers[best])
        counts -= covers[:, new].sum(axis=1)
        covers[:, new] = False
    return np.column_stack([squares[found], radii[found]])


def depths_in_body(body: Body, points: FloatArray) -> FloatArray:
    """How deep points (M, 2) lie in a body without its radius: minus the signed distance."""
    if len(body.vertices) < 3:
        x, y = points.T
        return np.asarray(-clearance(part(np.zeros((1, 2))), body.parts[0], x, y, 0.0))
    return np.asarray(-polygon_level_set(body.vertices, 0.0)(points, 0.0))


def map_body_level_set(
    robot: Sequence[Body], distance: Callable[[Any, Any], Any], origin: Sequence[float], tolerance: float
) -> Callable[[FloatArray, float], FloatArray]:
    """The level-set function of a robot, covered by disks, that must not touch what a map at `origin` has."""
    disks = [(body, covering_disks(body, tolerance)) for body in robot]

    # likewise; each disk looks the map up once more, so the formula grows with their number
    def level_set(points: FloatArray, t: float) -> FloatArray:
        found = list[Any]()
        for body, some in disks:
            x, y, heading = relative(body.placed(points, t), origin)
            for a, b, size in some:
                place = [dot_turned(one, np.array([a, b]), heading) for one in UNIT]
                found.append(distance(x + place[0], y + place[1]) - (size + body.radius))
        return reduce(np.minimum, found)

    return level_set
