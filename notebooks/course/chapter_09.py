"""Chapter 9, Projections: what it draws, its widgets, and the checks of its exercises."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from PIL import Image

import sdhj
from course.exercises import exercise, expect, expect_close
from course.paper import LIGHT, block, isosurface
from course.slices import LIVE, POSTURE, around, draw_arm_live, draw_pixels, draw_sets, slice_values
from course.widgets import Explorer, Numbers, agent_sliders, played, slider, step_sliders
from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import kernel
from sdhj.plotting import plane
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK
from sdhj.plotting.slices import Plane
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table

# ---- pictures

TURNED = {"hji": "#6aa6d6", "projected": "#46ab9f"}  # the colours of Fig. 13
VIEW = 1.85  # half a side of the picture of a turned box, whose half-diagonal is 1.73
SIDE = 390  # pixels of it
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
EDGES = np.array([(one, other) for one, other in combinations(CORNERS, 2) if (one != other).sum() == 1])  # of the box
FINE = 2  # parts of a pixel's side, for smooth edges


def turned(points: FloatArray, azimuth: float, elevation: float) -> FloatArray:
    """Points (..., 3) as seen from a direction, degrees: right, up, and towards the viewer."""
    a, e = np.radians((azimuth, elevation))
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    towards = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    return points @ np.stack([right, np.cross(towards, right), towards], axis=1)


@dataclass(frozen=True)
class Body:
    """The boundary of a set in a box, scaled to [-1, 1]^3: triangles (T, 3, 3), unit normals (T, 3), share inside."""

    triangles: FloatArray
    normals: FloatArray
    share: float

    @classmethod
    def of(cls, table: Table, through: Sequence[float]) -> "Body":
        """Of the whole tube over (q1, q2, px) through a state."""
        lower, upper = (np.array(ends[:3]) for ends in (table.grid.lower, table.grid.upper))
        values, coordinates = block(table.grid, table.values(start=0, within=table.steps), (0, 1, 2), through)
        triangles = (isosurface(values, coordinates) - (lower + upper) / 2) / ((upper - lower) / 2)
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1)
        kept = length > 1e-12
        share = float((values[1:-2, 1:-2, 1:-1] <= 0).mean())
        return cls(triangles[kept], normals[kept] / length[kept, None], share)


@kernel()
def paint(triangles: FloatArray, colours: FloatArray, image: FloatArray, heights: FloatArray) -> None:
    """Paint triangles (T, 3, 3) of column, row and height in colours (T, 3) into an image (Y, X, 4) by a z-buffer.

    `heights` (Y, X) are of what the image shows; higher is nearer. Both are changed in place. The centre of pixel
    (0, 0) is at column 0 and row 0.
    """
    for t in range(len(triangles)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangles[t]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0:  # seen from its side
            continue
        for y in range(max(0, int(np.ceil(min(ay, by, cy)))), min(len(image) - 1, int(max(ay, by, cy))) + 1):
            for x in range(max(0, int(np.ceil(min(ax, bx, cx)))), min(image.shape[1] - 1, int(max(ax, bx, cx))) + 1):
                a = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
                b = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
                if a >= 0.0 and b >= 0.0 and a + b <= 1.0:
                    height = cz + a * (az - cz) + b * (bz - cz)
                    if height > heights[y, x]:
                        heights[y, x], image[y, x, 3] = height, 255
                        for channel in range(3):
                            image[y, x, channel] = colours[t, channel]


def draw_turned(ax: Axes, body: Body, *, azimuth: float, elevation: float, colour: str) -> None:
    """A body, turned, in its box."""
    facing = turned(body.normals, azimuth, elevation)[:, 2] > 0
    seen, normals = turned(body.triangles[facing], azimuth, elevation), body.normals[facing]
    light = 0.55 + 0.45 * np.clip(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    side = SIDE * FINE
    seen[..., :2] = (seen[..., :2] * (1, -1) + VIEW) / (2 * VIEW) * side - 0.5
    image, heights = np.zeros((side, side, 4), dtype=np.uint8), np.full((side, side), -np.inf)
    paint(seen, np.round(255 * light[:, None] * to_rgb(colour)).astype(np.uint8), image, heights)
    smooth = np.asarray(Image.fromarray(image).reduce(FINE))
    draw_pixels(ax, smooth[::-1], (-VIEW, VIEW, -VIEW, VIEW), "surface", zorder=2.0)
    ends = turned(EDGES, azimuth, elevation)
    behind = ends[..., 2].mean(axis=1) < 0
    for edges, layer in ((ends[behind], 1.0), (ends[~behind], 3.0)):  # behind the body and in front of it
        parted = np.pad(edges[..., :2], ((0, 0), (0, 1), (0, 0)), constant_values=np.nan).reshape(-1, 2)
        ax.plot(*parted.T, color="#8c8c8c", linewidth=0.7, linestyle="-", zorder=layer)
    for name, label in zip(("q1", "q2", "px"), turned((2 * np.eye(3) - 1) * 1.14, azimuth, elevation), strict=True):
        ax.text(*label[:2], name, ha="center", va="center", zorder=4.0)
    ax.set(xlim=(-VIEW, VIEW), ylim=(-VIEW, VIEW), aspect="equal")
    ax.axis("off")


def draw_over(
    figure: Figure, problem: ReachAvoidProblem, where: Plane, state: Sequence[float], start: int, masks: Sequence[Any]
) -> Axes:
    """The workspace in `state`, and beside it sets of a slice over each other: light, dark, orange. Its axes."""
    left, right = figure.subplots(1, 2)
    draw_arm_live(left, problem, state, start * problem.delta)
    left.set_title("workspace")
    image = np.zeros((*masks[0].shape, 4))
    for mask, colour in zip(masks, (FULL_LOOKS["facecolor"], INNER_LOOKS["facecolor"], OUTCOME_INK), strict=False):
        image[mask] = to_rgba(colour)
    draw_pixels(right, image, around(where.x, where.y), "sets")
    draw_sets(right, problem, through=state, step=start, filled=False)
    return right


def draw_gap(
    figure: Figure,
    full: Table,
    inner: Table,
    *,
    state: Sequence[float],
    start: int = 0,
    within: int | None = None,
) -> Numbers:
    """One tube by two methods over each other, through the pursuer in `state` (Fig. 13): `full` light, `inner` dark."""
    within = full.steps - start if within is None else min(within, full.steps - start)
    where = plane(full.grid, state, resolution=LIVE)
    a, b = (
        slice_values(table.grid, table.values(start=start, within=within), state, (0, 1), where.x, where.y)
        for table in (full, inner)
    )
    right = draw_over(figure, full.problem, where, state, start, (a <= 0, b <= 0, (b <= 0) & (a > 0)))
    right.set_title(f"light: {full.method}, dark: {inner.method}; within {within}")
    return {
        f"slice inside, {full.method}": float((a <= 0).mean()),
        f"slice inside, {inner.method}": float((b <= 0).mean()),
        f"in {inner.method} and not in {full.method}": float(((b <= 0) & (a > 0)).mean()),
    }


def draw_toy(figure: Figure, grid: Grid, cases: Mapping[str, tuple[FloatArray, FloatArray]]) -> None:
    """Reach sets in the plane (light) under what comes back from the line (dark); orange where that is wrong."""
    axes = figure.subplots(1, len(cases), sharey=True)
    for ax, (title, (full, line)) in zip(axes, cases.items(), strict=True):
        claimed = np.broadcast_to(line[:, None] <= 0, grid.shape)
        image = np.zeros((*grid.shape, 4))
        image[full <= 0] = to_rgba(FULL_LOOKS["facecolor"])
        image[claimed] = to_rgba(INNER_LOOKS["facecolor"])
        image[claimed & (full > 1e-9)] = to_rgba(OUTCOME_INK)
        extent = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
        draw_pixels(ax, image.swapaxes(0, 1), extent, "toy")
        ax.contour(grid.nodes(0), grid.nodes(1), full.T, levels=[0.0], colors=[FULL_LOOKS["edgecolor"]], linewidths=1.0)
        ax.set(title=title, xlabel="kept, $x$", xlim=(-1, 1))
    axes[0].set_ylabel(r"dropped, $\omega$")


# ---- widgets


def explore_gap(full: Table, inner: Table) -> Explorer:
    """A tube by two methods over each other."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int) -> Numbers:
        return draw_gap(figure, full, inner, state=(*POSTURE, px, py), start=start, within=within)

    controls = {**agent_sliders(full.problem), **step_sliders(full)}
    return Explorer(draw, controls, alt="Two tubes over each other", motion="px")


def explore_surface(tables: Mapping[str, Table]) -> Explorer:
    """Fig. 13 in three axes: tubes over (q1, q2, px) side by side, turned, cut at a height of the pursuer."""

    @lru_cache(maxsize=16)
    def body(name: str, py: float) -> Body:
        return Body.of(tables[name], (0.0, 0.0, 0.0, py))

    def draw(figure: Figure, azimuth: int, elevation: int, py: float) -> Numbers:
        for ax, (name, table) in zip(figure.subplots(1, len(tables)), tables.items(), strict=True):
            colour = TURNED[table.method]
            draw_turned(ax, body(name, py), azimuth=azimuth, elevation=elevation, colour=colour)
            ax.set_title(name, loc="center")
        return {f"share of the box inside, {name}": body(name, py).share for name in tables}

    controls = {
        "azimuth": played(slider("from the side (degrees)", -180, 180, 6, -60), interval=150),
        "elevation": slider("from above (degrees)", -90, 90, 6, 24),
        "py": slider("pursuer y (m)", -0.36, 0.36, 0.01, 0.24),
    }
    return Explorer(draw, controls, size=(6.4, 3.2), alt="Two tubes in three axes, turned", motion="azimuth")


# ---- checks


@exercise("9.1", "For all omega: the worst of them has to be in the set. For some omega: the best of them is.")
def check_direction(project):
    """Maximum for a set to be reached, minimum for one to be avoided."""
    values = np.random.default_rng(0).normal(size=(5, 6, 7, 8))
    got = np.asarray(project(values, (3,), True))
    expect(got.shape == (5, 6, 7), "the dropped axes are gone, the others stay.")
    expect_close(got, values.max(axis=3), "to be reached: x must be in the set for ALL omega. Is that a min or a max?")
    expect_close(
        project(values, (1, 2), False), values.min(axis=(1, 2)), "to be avoided: x is in the shadow for SOME omega."
    )


@cache
def _share(subspaces, nodes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what a hopeless subspace is told
        table = sdhj.solve(sdhj.arm_case_study(nodes=nodes), sdhj.Projected(subspaces=subspaces), progress=False)
    return table.fraction(start=0, within=8)


@exercise(
    "9.2",
    "`sdhj.Projected(subspaces=[(0, 1, 2)])` is a method for `sdhj.solve`, and `table.fraction` gives shares.",
)
def check_subspace(share):
    """The tube from (q1, q2, px) alone."""
    both, one = _share(((0, 1, 2), (0, 1, 3)), 25), _share(((0, 1, 2),), 25)
    expect(0 < share < 1, "a share of C, between 0 and 1.")
    expect(abs(share - both) > 2e-3, "that is the union of both subspaces.")
    expect_close(share, one, "25 nodes, start=0, within=8, subspaces=[(0, 1, 2)].", within=2e-3)
    return f"Both together give {both:.3f}."


@exercise(
    "9.3",
    "Which x are within the target for every omega, and how far from there does the disturbance drive in one interval?",
)
def check_wave(amplitude):
    """0.3 - a >= 0.3 * 0.2."""
    expect(abs(amplitude - 0.3) > 1e-9, "there the core is a line; can it be hit with the disturbance?")
    expect_close(amplitude, 0.24, "the core is |x - 0.2| <= 0.3 - a; the disturbance takes delta v_1 from either side.")


@exercise("9.4", "Take a target in which omega matters as much as x does, a diagonal strip for example.")
def check_target(hopeless_projection):
    """Full: more than the target within one step or more; projected: nothing."""
    problem = hopeless_projection()
    expect(isinstance(problem, sdhj.ReachAvoidProblem), "return a sdhj.ReachAvoidProblem.")
    expect(problem.grid.ndim == 2 and max(problem.grid.shape) <= 61, "two axes, at most 61 nodes on each.")
    full = sdhj.solve(problem, progress=False)
    goal, tube = (full.fraction(start=0, within=n) for n in (0, full.steps))
    expect(tube > goal, "the full game wins nothing beyond the target: more speed, more steps, less adversary?")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        small = sdhj.solve(problem, sdhj.Projected(subspaces=[(0,)]), progress=False)
    gained = small.fraction(start=0, within=full.steps) - goal
    expect(gained <= 1e-12, "the projection onto x wins something: some x is in the target for every omega.")


@exercise("9.5", "itertools.combinations(range(4), size) lists the axes, and what each adds takes a solve on 15 nodes.")
def check_three(share):
    """The paper's two and up to one more, on 15 nodes."""
    paper = ((0, 1, 2), (0, 1, 3))
    others = [axes for size in (2, 3) for axes in combinations(range(4), size) if axes not in paper]
    best = max(_share((*paper, axes), 15) for axes in others)
    expect(abs(share - _share(paper, 25)) > 1e-4, "that is on 25 nodes; here on 15.")
    expect_close(share, best, "have you tried all subspaces of two and three axes beside the two?", within=1e-4)
    kept = _share(paper, 15)
    return f"The paper's two alone give {kept:.4f}: " + ("no third one helps." if best <= kept + 1e-6 else "one helps.")
