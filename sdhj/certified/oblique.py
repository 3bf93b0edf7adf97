"""Images that are no boxes: where a component of the disturbance moves several axes, lines of cells between planes.

On axes that no velocity depends on, states of a place move alike: by an integral of velocities that u_j and V allow
there. Along any normal n it is at most the integral of the greatest n . f, whatever v does in the interval: a mean
of velocities lies in their hull. So the image of a cell lies between two planes for each normal, as well as in its box:

    dq/dt = drift + gain v:   n . f in n . drift + [-1, 1] sum_d |n . gain_d| bounds_d, which is narrow where n is
                              normal to gain_d
    any velocity(v):          n . f in what it is over some of the pieces that V is cut into (`Dynamics.pieces`)

Of each row of cells in the box the image is then a *line*, from a first to a last cell along the last axis. A cell from
which a bounded axis may end on the way, by `halo`, keeps its box: whoever a wall holds back is not between the planes.
With `Sensing`, with black boxes, and where moves would take too much memory, all cells do.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import combinations, pairwise, product
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.bounds import Bounds, within_grid
from sdhj.certified.cells import DRIFT, CellAxis
from sdhj.formulas.formula import Ends, Formula
from sdhj.kernels import FloatArray, read_only
from sdhj.kernels.oblique import draw_lines
from sdhj.problem.dynamics import VectorField
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.container import Contents
from sdhj.table.files import read_array

FAN = 8  # normals in the plane of two axes where one component has many, half a turn of them
SAME = 1e-9  # normals that are nearer to each other are one
MOST_NORMALS = 32
MOST_LINES = 1 << 22  # of all places and inputs: 16 MB
STICK = 1.01 * DRIFT  # what an image may stick out of its cells, and what rounding adds
ROUNDED = 1e-15


class Lines(NamedTuple):
    """The lines of all images; where there are no normals, no image is lines.

    normals : (K, ndim), of the planes that images lie between.
    halo : (2, ndim) int64. A cell with fewer than halo[0] cells before it, or halo[1] behind it, on some axis keeps its
        box.
    each : (starts, L, places, rows, 2) int16, the first and the last cell along the last axis, less the cell's own
        index, in each row of the box over the other axes that a normal has a part along.
    """

    normals: FloatArray
    halo: FloatArray
    each: FloatArray


def no_lines(ndim: int) -> Lines:
    """The `Lines` of a proof of `ndim` axes whose images are all boxes: without normals, and read-only."""
    nothing = np.zeros((0, ndim)), np.zeros((2, ndim), np.int64), np.zeros((0, 0, 0, 0, 2), np.int16)
    return Lines(*read_only(nothing))


def normals_of(problem: ReachAvoidProblem, axes: Sequence[CellAxis], depends: FloatArray) -> FloatArray:
    """The normals of the planes that images may lie between: (K, ndim), K = 0 where there are none.

    Planes are of use where a component of the disturbance moves two axes that no velocity depends on. Where the gain is
    one for all states and times, the normals in the plane of two such axes are these axes and what is normal to each
    column of the gain; else a fan of `FAN` directions. There are none with `Sensing`, with black boxes, or if they were
    more than `MOST_NORMALS`.

    axes : the cells of each axis. depends : (ndim,) bool, the axes of a place (`sdhj.certified.images.place_axes`). A
    normal has no part along these; its largest part is 1.
    """
    dynamics, found = problem.dynamics, list[FloatArray]()
    if problem.sensing or not dynamics.formulas:
        return np.zeros((0, len(axes)))
    gain = dynamics.gain
    for pair in combinations(np.flatnonzero(~depends).tolist(), 2):
        own_pair = list(pair)
        if not problem.remembered(("coupled", pair), partial(_is_coupled, dynamics, own_pair)):
            continue
        some = [np.array(direction) for direction in ((1.0, 0.0), (0.0, 1.0))]
        if isinstance(gain, Formula) and all(one.op == "const" for one in gain.outputs):
            entries = np.array([one.value for one in gain.outputs]).reshape(gain.shape)[:, own_pair]
            columns = np.moveaxis(entries, 1, 2).reshape(-1, 2)
            some += [np.array([b, -a]) for a, b in columns.tolist() if a and b]
        else:
            angles, widths = np.pi / FAN * np.arange(FAN), [float(axes[k].width) for k in pair]
            some += [np.array([np.cos(a), np.sin(a)]) / widths for a in angles if abs(np.sin(2 * a)) > SAME]
        for direction in some:
            normal = np.zeros(len(axes))
            normal[own_pair] = direction / np.abs(direction).max() * (1.0 if direction[0] > 0 else -1.0)
            normal = np.abs(normal) if (normal != 0).sum() == 1 else normal
            if not any(np.abs(normal - one).max() < SAME for one in found):
                found.append(normal)
    return np.array(found) if 0 < len(found) <= MOST_NORMALS else np.zeros((0, len(axes)))


def _is_coupled(dynamics: VectorField, pair: list[int]) -> bool:
    """Whether some component of v, which may enter nonlinearly, moves both axes of a pair."""
    return max(dynamics.pieces_of_components(pair), default=1) > 1 or dynamics.couples(pair)


def rates_along(
    bounds: Bounds, normals: FloatArray, j: int, low: FloatArray, high: FloatArray, times: tuple[float, float]
) -> FloatArray:
    """The least and the greatest n . f under u_j in boxes (M, ndim) and `times`, for each of K normals n: (2, M, K).

    f is the velocity under any disturbance: drift + gain v, or velocity(v) with v in any of the pieces that its bounds
    are cut into. Only the part of a box that is on the grid counts; infinite where no bound is known.

    bounds : of a problem whose dynamics are formulas. normals : (K, ndim). low, high : the corners of the boxes.
    times : from s to s.
    """
    dynamics, grid = bounds.problem.dynamics, bounds.problem.grid

    def bounded(low: FloatArray, high: FloatArray) -> Ends:
        """The least and the greatest n . f over boxes (n, ndim), from low to high and within the grid: two (n, K)."""
        if dynamics.gain is None:
            # obligation 2.48
            pieces = [
                _component(normals, *dynamics.functions_by_input["drift"][j].bounds(low, high, times, *v)) for v in cut
            ]
            return np.min([one[0] for one in pieces], axis=0), np.max([one[1] for one in pieces], axis=0)
        (least, most), gain = (
            dynamics.functions_by_input[name][j].bounds(low, high, times) for name in ("drift", "gain")
        )
        a, b = _component(normals, least, most)
        for d in range(dynamics.disturbance_dim):
            push = np.maximum(*np.abs(_component(normals, gain[0][:, :, d], gain[1][:, :, d]))) * v_most[d]
            a, b = a - push, b + push  # obligation 2.42
        return a, b

    ends = dynamics.disturbance_bounds(j, low, high, times)
    v_most = ends[1]
    cuts = zip(ends.T, dynamics.pieces_of_components(np.flatnonzero(normals.any(axis=0)).tolist()), strict=True)
    nodes = [np.linspace(end[0], end[1], cut + 1).tolist() for end, cut in cuts]
    cut = list(product(*(list(pairwise(one)) for one in nodes)))
    return within_grid(grid, range(grid.ndim), low, high, bounded)


def _component(normals: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest n . x over boxes from low to high (M, ndim), for K normals (K, ndim): two (M, K).

    Rounded outward.
    """
    with np.errstate(invalid="ignore"):
        ends = np.stack([low[:, None] * normals, high[:, None] * normals])
    ends = np.where(normals == 0.0, 0.0, ends)
    more = ROUNDED * np.abs(ends).max(axis=0).sum(axis=2)
    return ends.min(axis=0).sum(axis=2) - more, ends.max(axis=0).sum(axis=2) + more


def changes_along(
    bounds: Bounds,
    normals: FloatArray,
    j: int,
    boxes: FloatArray,
    tubes: FloatArray,
    begin: float,
    duration: float,
) -> FloatArray:
    """By how much n . x changes at least and at most in an interval, for states of boxes (2, M, ndim): (2, M, K).

    The sum over the parts of length * (bounds on n . f in the part's tube), rounded outward.

    bounds, normals, j : as for `rates_along`. boxes : lower and upper corners.
    tubes (M, parts, ndim, 2) : how far the ends of the boxes move in each part, under u_j.
    begin, duration : of the interval, s. The length of a part is duration / parts, not a difference of two times, whose
        rounding grows with the times.
    """
    out, parts = np.zeros((2, boxes.shape[1], len(normals))), tubes.shape[1]
    cuts = [begin + duration * part / parts for part in range(parts + 1)]
    length = np.nextafter(duration / parts, np.inf)
    for part in range(parts):
        low, high = boxes + np.moveaxis(tubes[:, part], 2, 0)  # obligation 2.47
        moved = length * rates_along(bounds, normals, j, low, high, (cuts[part], cuts[part + 1]))  # obligation 2.45
        out += moved + ROUNDED * np.array([[[-1.0]], [[1.0]]]) * (np.abs(moved) + np.abs(out))
    return out


def rows_of(normals: FloatArray, low: FloatArray, high: FloatArray) -> int:
    """The largest number of rows that a box of cells has, of those from low to high (M, ndim), M > 0.

    A row has one index on each of the axes, except the last, that one of the normals (K, ndim) has a part along.
    """
    oblique: Any = normals.any(axis=0)
    numbers = high.astype(np.int64)[:, :-1] - low[:, :-1] + 1
    return int(np.where(oblique[:-1], numbers, 1).prod(axis=1).max())


def lines_in_boxes(
    axes: Sequence[CellAxis], normals: FloatArray, low: FloatArray, high: FloatArray, far: FloatArray
) -> FloatArray:
    """The lines of M images: in each row of a box the first and the last cell between its planes, (M, rows, 2) int16.

    As offsets, along the last axis, from a cell's own index. A row where no cell is between the planes ends before it
    begins, as in (0, -1). Rows are those of `rows_of` in C order, as many as the largest box has; in rows that another
    box has not there is 0.

    axes : the cells of all axes. normals (K, ndim) : of the planes.
    low, high (M, ndim) : the boxes of the images, as offsets; M > 0.
    far (2, M, K) : by how much n . x changes at least and at most, as `changes_along` returns it.
    """
    out = np.zeros((len(low), rows_of(normals, low, high), 2), np.int16)
    width, scale = (np.array([float(getattr(axis, name)) for axis in axes]) for name in ("width", "scale"))
    boxes = [np.ascontiguousarray(end, dtype=np.int64) for end in (low, high)]
    draw_lines(*boxes, far[0], far[1], normals, width, STICK * scale, out)
    return out


def halo_of(axes: Sequence[CellAxis], normals: FloatArray, tubes: FloatArray, ends: Any) -> FloatArray:
    """By how many cells, and two more, anything gets below and above a cell: `Lines.halo`, (2, ndim) int64.

    0 on periodic axes, and on those along which no normal has a part. axes : the cells of all axes.
    tubes (M, parts, ndim, 2) : how far the ends of the cells move in each part.
    ends : (low, high), each (M, ndim), the boxes of the images, as offsets in cells.
    """
    width = np.array([float(axis.width) for axis in axes])
    low, high = ends
    back = np.maximum(-tubes[..., 0].min(axis=(0, 1)) / width, -low.min(axis=0))
    ahead = np.maximum(tubes[..., 1].max(axis=(0, 1)) / width, high.max(axis=0))
    bounded = normals.any(axis=0) & ~np.array([axis.periodic for axis in axes])
    halo = np.ceil(np.maximum(np.stack([back, ahead]), 0.0)) + 2  # obligation 2.46
    return np.where(bounded, np.minimum(halo, 2.0**31), 0).astype(np.int64)


class Drawing:
    """Draws the lines of a proof's images, a slab of places at a time, while the proof is prepared.

    `add` is called for each slab; then `lines` has the lines of all of them.
    """

    def __init__(self, proof: Any) -> None:
        """Find the normals (`normals_of`) for a `GeneralProof` that is being prepared; there are no lines yet."""
        self.proof, self.found = proof, dict[tuple[int, int, int], FloatArray]()
        self.halo: FloatArray = np.zeros((2, len(proof.axes)), np.int64)
        self.normals = normals_of(proof.problem, proof.axes, proof.strides > 0)

    def add(self, start: int, j: int, some: FloatArray, tubes: FloatArray) -> None:
        """Draw the lines of places `some` (M,), consecutive numbers, under u_j, and keep them.

        The places' moves must already be in the proof. Does nothing without normals. Where lines would take too much
        memory, or a row goes once around a periodic axis, all normals are dropped for good, and all images stay boxes.

        start : the index of the interval in the proof's moves. tubes (M, parts, ndim, 2) : as `Images.swept` returns
            them.
        """
        proof, normals = self.proof, self.normals
        if not len(normals):
            return
        low, high = (moves[start, j, some].astype(np.int64) for moves in (proof.low, proof.high))
        laps = np.array([axis.count if axis.periodic else np.inf for axis in proof.axes])
        whole = (normals.any(axis=0) & (high - low >= laps))[:, :-1].any()  # once around, a row is no row's own
        if whole or rows_of(normals, low, high) * proof.low[..., 0].size > MOST_LINES:
            self.normals = normals[:0]
            return
        times = proof.problem.time(start), proof.problem.sensing.hold(proof.problem.delta)[0]
        far = changes_along(proof.bounds, normals, j, proof.boxes(some), tubes, *times)
        self.found[start, j, int(some[0])] = lines_in_boxes(proof.axes, normals, low, high, far)
        self.halo = np.maximum(self.halo, halo_of(proof.axes, normals, tubes, (low, high)))

    @property
    def lines(self) -> Lines:
        """The `Lines` of all places that were added, read-only; a new object each time.

        Rows beyond those of a box, and those of places that were not added, are 0. No lines without normals.
        """
        if not len(self.normals):
            return no_lines(len(self.proof.axes))
        rows = max(one.shape[1] for one in self.found.values())
        out = np.zeros((*self.proof.low.shape[:3], rows, 2), np.int16)
        for (start, j, first), one in self.found.items():
            out[start, j, first : first + len(one), : one.shape[1]] = one
        return Lines(*read_only((self.normals, self.halo, out)))


def most_bytes(problem: ReachAvoidProblem, axes: Sequence[CellAxis], depends: FloatArray) -> int:
    """The bytes that the lines of images take at most, while they are drawn, too; 0 without normals (`normals_of`).

    axes : the cells of each axis. depends : (ndim,) bool, the axes of a place.
    """
    return 8 * MOST_LINES if len(normals_of(problem, axes, depends)) else 0


def lines_in_file(stated: Mapping[str, Any], file: Contents, proof: Any) -> Lines:
    """The lines in an open file, read-only; ValueError where their normals, halo or shape do not fit the proof.

    stated : the proof's part of the head, with "normals" and "halo". proof : a `GeneralProof` that has its moves.
    """
    ndim, depends = len(proof.axes), proof.strides > 0
    normals, halo = np.array(stated["normals"], np.float64), np.array(stated["halo"], np.int64)
    fits = normals.ndim == 2 and normals.shape[1] == ndim and 0 < len(normals) <= MOST_NORMALS
    if not fits or not np.isfinite(normals).all() or normals[:, depends].any() or halo.shape != (2, ndim):
        raise ValueError(f"lines must lie between planes along axes that no velocity depends on, got {normals}")
    rows = rows_of(normals, *(moves.reshape(-1, ndim) for moves in (proof.low, proof.high)))
    return Lines(*read_only((normals, halo, read_array(file, "lines", "int16", (*proof.low.shape[:3], rows, 2)))))
