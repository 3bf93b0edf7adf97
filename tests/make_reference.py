"""A reference for the robot arm's case study: the exact recursion on grids refined until the answer stays.

It shares no solver code with sdhj, only the geometry of the case study. The velocities do not depend on the state, so
every game of a sampling interval is a maximum over boxes (Hopf-Lax): for game 3, over the states the interval can end
in; for games 1 and 2, also over the time within the interval, sampled densely, with the clearance of the arm from a box
of pursuer positions in closed form. What is left is interpolation between nodes, which `interpolate` does in two ways
that converge from different sides.

    python tests/make_reference.py 4 2 --view-time instantaneous

solves with 4 * 25 nodes on each joint and 2 * 24 + 1 on each pursuer axis, so that the nodes of the 25^4 grid are among
them, and writes the level-set functions of step 0 there to a file. `--combine` adds what refining the other axes
changes and writes the bits that tests/solver/test_reference.py compares with. What is stored was made by the runs 8 1,
4 2, 4 1, 2 4 and 2 2 and

    python tests/make_reference.py --combine 8_1 4_2 4_1 2_4 2_2    (each the name of a file)
"""

import argparse
import time

import numpy as np
from numba import njit, prange

import sdhj
from sdhj.arm.case_studies import scene
from sdhj.problem.samples import Samples

SAMPLES = 16  # times within an interval, besides its start
MARGIN = 2e-3  # m; 99% of the nodes near the boundary moved by less than 1.9 mm between 100 and 200 nodes a joint
FINE = 8  # the games on the joints alone use a grid this many times finer


@njit(inline="always")
def minmod(a, b):
    if a * b <= 0.0:
        return a * 0.0
    return a if abs(a) < abs(b) else b


@njit(inline="always")
def node(i, n, periodic):
    return i % n if periodic else min(max(i, 0), n - 1)


@njit
def interpolate(values, out, position, periodic, limited):
    """out (B,) = values (n, B) at a position in nodes: linearly, or with the lesser of two second differences."""
    n = values.shape[0]
    if not periodic:
        position = min(max(position, 0.0), n - 1.0)
    base = int(np.floor(position))
    t = np.float32(position - base)
    if t == 0.0:
        out[:] = values[node(base, n, periodic)]
        return
    m, a, b, p = (
        values[node(base - 1, n, periodic)],
        values[node(base, n, periodic)],
        values[node(base + 1, n, periodic)],
        values[node(base + 2, n, periodic)],
    )
    bend = np.float32(0.5) * t * (t - np.float32(1)) if limited else np.float32(0)
    if not periodic and (base == 0 or base >= n - 2):
        bend = np.float32(0)  # no second difference across a wall
    for k in range(out.size):
        line = a[k] + t * (b[k] - a[k])
        out[k] = line + bend * minmod((m[k] - a[k]) + (b[k] - a[k]), (p[k] - b[k]) + (a[k] - b[k]))


@njit
def maximum_near(values, out, scratch, centre, half, periodic, limited):
    """out (B,) = max of values (n, B) over [centre - half, centre + half], in nodes."""
    interpolate(values, out, centre - half, periodic, limited)
    if half == 0.0:
        return
    interpolate(values, scratch, centre + half, periodic, limited)
    for k in range(out.size):
        out[k] = max(out[k], scratch[k])
    n = values.shape[0]
    for i in range(int(np.ceil(centre - half)), int(np.floor(centre + half)) + 1):
        row = values[node(i, n, periodic)]
        for k in range(out.size):
            out[k] = max(out[k], row[k])


@njit(parallel=True)
def box_maximum(values, out, shift, half, periodic, limited):
    """out[a, i] = max of values (A, n, B) along the middle axis over i + shift + [-half, half], in nodes."""
    before, n, after = values.shape
    for task in prange(before * n):
        a = np.int64(task) // n
        i = np.int64(task) - a * n
        scratch = np.empty(after, values.dtype)
        maximum_near(values[a], out[a, i], scratch, i + shift, half, periodic, limited)


@njit(parallel=True)
def absorb(still, avoid, tube, shift1, shift2, limited):
    """tube = min(tube, max(still at the shifted joints, avoid)); all (n, n, P), both shifts in nodes."""
    n, _, width = still.shape
    flat = still.reshape(n, n * width)
    for i in prange(n):
        moved = np.empty(n * width, still.dtype)
        row = np.empty(width, still.dtype)
        interpolate(flat, moved, np.int64(i) + shift1, True, limited)
        plane = moved.reshape(n, width)
        for k in range(n):
            interpolate(plane, row, k + shift2, True, limited)
            for x in range(width):
                tube[i, k, x] = min(tube[i, k, x], max(row[x], avoid[i, k, x]))


@njit
def segment_rectangle(x0, y0, x1, y1, cx, cy, half):
    """Distance of a segment from the square of points within `half` of (cx, cy) on both axes."""
    best = np.inf
    # a corner nearest to the segment, or an end of the segment nearest to the square, or they cross
    dx, dy = x1 - x0, y1 - y0
    square = dx * dx + dy * dy
    for sx in (-half, half):
        for sy in (-half, half):
            s = min(max(((cx + sx - x0) * dx + (cy + sy - y0) * dy) / square, 0.0), 1.0)
            best = min(best, np.hypot(x0 + s * dx - cx - sx, y0 + s * dy - cy - sy))
    for x, y in ((x0, y0), (x1, y1)):
        best = min(best, np.hypot(max(abs(x - cx) - half, 0.0), max(abs(y - cy) - half, 0.0)))
    low, high = 0.0, 1.0  # the part of the segment within the square (clipping)
    for start, along, centre in ((x0, dx, cx), (y0, dy, cy)):
        if along == 0.0:
            if abs(start - centre) > half:
                low = 2.0
        else:
            s, t = (centre - half - start) / along, (centre + half - start) / along
            low, high = max(low, min(s, t)), min(high, max(s, t))
    return 0.0 if low <= high else best


@njit(parallel=True)
def pursuer_clearance(elbow, tip, nodes, half, gap, out):
    """out (M, P, P): how far the arm at M joint angles is from a pursuer in the square about each node, less `gap`."""
    for m in prange(elbow.shape[0]):
        for i in range(nodes.size):
            for k in range(nodes.size):
                upper = segment_rectangle(0.0, 0.0, elbow[m, 0], elbow[m, 1], nodes[i], nodes[k], half)
                fore = segment_rectangle(elbow[m, 0], elbow[m, 1], tip[m, 0], tip[m, 1], nodes[i], nodes[k], half)
                out[m, i, k] = min(upper, fore) - gap


def angles(n):
    """All pairs of n joint angles, (n * n, 2)."""
    q = -np.pi + 2 * np.pi / n * np.arange(n)
    return np.stack(np.meshgrid(q, q, indexing="ij"), axis=-1).reshape(-1, 2)


class Reference:
    """The recursion for one refinement."""

    def __init__(self, joints, pursuer, steps, view_time, limited):
        self.problem = sdhj.arm_case_study(
            (25 * joints, 25 * joints, 24 * pursuer + 1, 24 * pursuer + 1), steps, view_time
        )
        self.scene = scene(self.problem)
        self.n, self.width = 25 * joints, (24 * pursuer + 1) ** 2
        self.joints, self.pursuer, self.limited = joints, pursuer, limited
        self.cell = np.array(self.problem.grid.spacing)
        self.u = np.asarray(self.problem.dynamics.drift)[:, :2]
        self.v = self.problem.dynamics.bounds
        self.times = self.problem.delta * np.arange(SAMPLES + 1) / SAMPLES

    def widened(self, values, axis, half, shift=0.0, cell=None):
        """max over shift + [-half, half] along one axis of an array, in the axis's units."""
        cell = self.cell[axis] if cell is None else cell
        shape = values.shape
        view = values.reshape(int(np.prod(shape[:axis])), shape[axis], int(np.prod(shape[axis + 1 :])))
        out = np.empty_like(view)
        box_maximum(view, out, shift / cell, half / cell, axis < 2, self.limited)
        return out.reshape(shape)

    def known(self, step):
        """Avoid tubes of the known obstacles, (L, n, n), on a finer grid of the joints."""
        n, problem = self.n * FINE // self.joints, self.problem
        q, cell, t0 = angles(n), 2 * np.pi / n, problem.time(step)
        result = np.full((len(self.u), self.n, self.n), -np.inf, np.float32)
        for tau in self.times:
            if problem.view_time == "swept":
                g = self.scene.obstacles_swept_value(q, t0, t0 + problem.delta)
            else:
                g = self.scene.obstacles_value(q, t0 + tau)
            wall = -g.reshape(n, n, 1).astype(np.float32)
            for axis in (0, 1):
                wall = self.widened(wall, axis, self.v[axis] * tau, cell=cell)
            for j, u in enumerate(self.u):
                moved = self.widened(self.widened(wall, 0, 0.0, u[0] * tau, cell), 1, 0.0, u[1] * tau, cell)
                coarse = moved[:: FINE // self.joints, :: FINE // self.joints, 0]
                np.maximum(result[j], coarse, out=result[j])
        return result

    def walls(self):
        """-g of the pursuer over the square it can reach and the joint angles disturbed, for each time; (n, n, P)."""
        elbow, tip = self.scene.arm.joints(angles(self.n))
        nodes = self.problem.grid.nodes(2)
        gap = self.scene.agent_radius + self.scene.arm.half_width
        for tau in self.times:
            wall = np.empty((self.n * self.n, nodes.size, nodes.size), np.float32)
            pursuer_clearance(elbow, tip, nodes, self.v[2] * tau, gap, wall)
            np.negative(wall, out=wall)
            wall = wall.reshape(self.n, self.n, self.width)
            for axis in (0, 1):
                wall = self.widened(wall, axis, self.v[axis] * tau)
            yield tau, wall

    def pursued(self):
        """Avoid tubes of the pursuer, (L, n, n, P)."""
        result = np.full((len(self.u), self.n, self.n, self.width), np.inf, np.float32)
        np.negative(result, out=result)
        for tau, wall in self.walls():
            for first in np.unique(self.u[:, 0]):
                moved = self.widened(wall, 0, 0.0, first * tau)
                for j in np.flatnonzero(self.u[:, 0] == first):
                    np.maximum(result[j], self.widened(moved, 1, 0.0, self.u[j, 1] * tau), out=result[j])
        return result

    def solve(self):
        """Level-set functions of step 0 at the nodes of the 25^4 grid, (steps + 1, 25, 25, 25, 25)."""
        problem, delta = self.problem, self.problem.delta
        shape = (self.n, self.n, self.width)
        pursued = self.pursued()
        following = []
        for k in range(problem.steps, -1, -1):
            row = [Samples(problem).goal(k).astype(np.float32).reshape(shape)]
            if following:
                known = self.known(k)
                still = []
                for values in following:
                    values = values.reshape(problem.grid.shape)
                    for axis in range(4):
                        values = self.widened(values, axis, self.v[axis] * delta)
                    still.append(values.reshape(shape))
                row += [np.full(shape, np.inf, np.float32) for _ in still]
                for j, u in enumerate(self.u):
                    avoid = np.maximum(pursued[j], known[j][..., None])
                    shift = u * delta / self.cell[:2]
                    for tube, values in zip(row[1:], still, strict=True):
                        absorb(values, avoid, tube, shift[0], shift[1], self.limited)
                for n in range(1, len(row)):
                    np.minimum(row[n], row[n - 1], out=row[n])
            following = row
            print(f"  step {k}", flush=True)
        return np.stack([self.coarse(values) for values in following])

    def coarse(self, values):
        q, p = self.joints, self.pursuer
        return values.reshape(self.problem.grid.shape)[::q, ::q, ::p, ::p]


def combine(base, corrections, path):
    """Write what the tests compare with: the base run plus what refining another axis changes, as bits beyond a margin.

    corrections : pairs (finer, coarser) of runs that differ in the refinement of one kind of axis.
    """

    def values(name):
        return np.load(name)["values"].astype(np.float64)

    best = values(base) + sum(values(finer) - values(coarser) for finer, coarser in corrections)
    bits = {"inside": best <= -MARGIN, "outside": best > MARGIN, "sign": best <= 0}
    packed = {name: np.packbits(mask.reshape(len(best), -1), axis=1) for name, mask in bits.items()}
    np.savez_compressed(path, margin=MARGIN, **packed)
    print("node share", *(f"{(v <= 0).mean():.4f}" for v in best))
    for margin in (-MARGIN, MARGIN):
        print(f"  {1e3 * margin:+.0f} mm  ", *(f"{(v <= margin).mean():.4f}" for v in best))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("joints", nargs="?", type=int, help="25 nodes times this on the joint axes (a divisor of 8)")
    parser.add_argument("pursuer", nargs="?", type=int, help="24 cells times this on the pursuer's axes")
    parser.add_argument("--view-time", default="instantaneous", choices=("instantaneous", "swept"))
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--linear", action="store_true", help="interpolate linearly")
    parser.add_argument("--combine", nargs="+", metavar="FILE", help="base, then finer and coarser runs in pairs")
    parser.add_argument("--output", default="tests/data/reference_arm.npz", help="what --combine writes")
    given = parser.parse_args()
    if given.combine:
        base, *rest = given.combine
        return combine(base, zip(rest[::2], rest[1::2], strict=True), given.output)
    started = time.time()
    reference = Reference(given.joints, given.pursuer, given.steps, given.view_time, not given.linear)
    values = reference.solve()
    grid = sdhj.arm_case_study(25, given.steps).grid
    print("node share", *(f"{(v <= 0).mean():.4f}" for v in values))
    print("volume    ", *(f"{grid.fraction(v <= 0):.4f}" for v in values))
    kind = "linear" if given.linear else "limited"
    name = f"reference_{given.joints}_{given.pursuer}_{given.view_time}_{kind}.npz"
    np.savez_compressed(name, values=values.astype(np.float32))
    print(f"{name}: {time.time() - started:.0f} s")


if __name__ == "__main__":
    main()
