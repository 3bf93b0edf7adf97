"""Chapter 16, The robot as it is: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

import sdhj
from course.exercises import exercise, expect
from course.slices import LIVE, around, draw_pixels
from course.widgets import Explorer, Numbers, slider
from sdhj.common.remembering import FloatArray
from sdhj.plotting import plane
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK, TARGET_LOOKS
from sdhj.table.batches import Table

# ---- pictures

Row = tuple[str, Sequence[tuple[Any, Any]], str]  # what is written, intervals, and "known" or "true"
COLOURS = {"true": TARGET_LOOKS["facecolor"], "known": "#f2c14e"}


def draw_line_sets(ax: Axes, rows: Sequence[Row], box: float) -> None:
    """Sets of a line, one below the other: sets of states blue, of predictions yellow; the first row is on top."""
    for place, (label, intervals, kind) in enumerate(reversed(rows)):
        for low, high in intervals:
            ax.plot(
                [float(low), float(high)],
                [place, place],
                linewidth=9,
                linestyle="-",
                color=COLOURS[kind],
                solid_capstyle="butt",
                gid=label,
            )
            for end, away in ((float(low), -1), (float(high), 1)):
                ax.annotate(
                    f"{end:.2f}", (end, place), (4 * away, 0), textcoords="offset points", va="center", fontsize=7,
                    ha="left" if away > 0 else "right",
                )  # fmt: skip
    ax.set_yticks(range(len(rows)), [label for label, _, _ in reversed(rows)])
    ax.plot([-box, box], [len(rows) - 0.3] * 2, linewidth=2, linestyle="-", color=OUTCOME_INK, gid="box")
    ax.text(box, len(rows) - 0.3, " the box E", va="center", fontsize=8, color=OUTCOME_INK)
    ax.set(xlabel="q", ylim=(-0.7, len(rows) + 0.1))
    ax.margins(x=0.12)


SHOWN = 20  # paths of either kind in a picture


def draw_sensed(ax: Axes, table: Table, paths: FloatArray, lost: FloatArray) -> None:
    """What a table promises to states of a cart, in some steps (light) and in none (dark), and true paths from it."""
    grid, problem = table.grid, table.problem
    where = plane(grid, (0.0, 0.0), resolution=LIVE)
    image = np.zeros((*where.shaped(where.points[:, 0]).shape, 4))
    inside = where.shaped(table.contains(where.points, start=0, within=table.steps)) > 0
    known = where.shaped(table.contains(where.points, start=0, within=0)) > 0
    wall = where.shaped(problem.unsafe_value(where.points, 0.0)) <= 0
    for chosen, colour in (
        (inside, FULL_LOOKS["facecolor"]),
        (known, TARGET_LOOKS["facecolor"]),
        (wall, "#f6bda8"),
    ):
        image[chosen] = to_rgba(colour)
    draw_pixels(ax, image, around(where.x, where.y), "promised")
    worst_last = np.concatenate([np.flatnonzero(~lost)[:SHOWN], np.flatnonzero(lost)[:SHOWN]])
    for path, bad in zip(paths[worst_last], lost[worst_last], strict=True):
        colour, width = (OUTCOME_INK, 1.3) if bad else (INNER_LOOKS["facecolor"], 0.7)
        ax.plot(path[:, 0], path[:, 1], color=colour, linewidth=width, linestyle="-", gid="lost" if bad else "won")
        ax.plot(*path[0], "o", color=colour, markersize=2.5)
    ax.set(
        xlabel="x (m)",
        ylabel="v (m/s)",
        xlim=(grid.lower[0], grid.upper[0]),
        ylim=(grid.lower[1], grid.upper[1]),
    )


def draw_two_by_two(ax: Axes, cells: Sequence[Sequence[str]]) -> None:
    """A table of two by two: of each table of the robot, in each world."""
    ax.axis("off")
    columns = ("the robot as it is", "the same, measured and timed perfectly")
    rows = ("the table reckons with it", "it does not")
    made = ax.table(cells, rowLabels=rows, colLabels=columns, cellLoc="center", bbox=(0.28, 0.0, 0.7, 1.0))
    made.auto_set_font_size(False)
    made.set_fontsize(8)


# ---- widgets


def explore_sensing(problem: Any, drive: Callable[..., tuple[FloatArray, FloatArray]]) -> Explorer:
    """Two controllers of one robot: one whose table knows what is uncertain, one whose table does not."""

    @lru_cache(maxsize=64)
    def solved(**sensing: float) -> sdhj.Controller:
        unsure = replace(problem, sensing=sdhj.Sensing(**sensing, memory=False))
        return sdhj.Controller(sdhj.solve(unsure, progress=False))

    def draw(figure: Figure, error: float, delay: float, jitter: float) -> Numbers:
        told = {"error": error, "delay": delay, "jitter": jitter}
        grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.3))
        numbers: dict[str, float | str] = {}
        rows = []
        for place, (name, known) in enumerate((("reckons with it", told), ("does not", dict.fromkeys(told, 0.0)))):
            controller = solved(**known)
            worlds = {
                "as it is": sdhj.Sensing(**told, memory=False),
                "perfect": sdhj.Sensing(delay=known["delay"], memory=False),
            }
            runs = {world: drive(controller, sensing) for world, sensing in worlds.items()}
            ax = figure.add_subplot(grid[0, place])
            draw_sensed(ax, controller.table, *runs["as it is"])
            ax.set_title(f"a table that {name}, the robot as it is")
            share = controller.table.fraction(start=0, within=problem.steps)
            numbers[f"promised, {name}"] = share
            for world, (_, lost) in runs.items():
                numbers[f"lost, {name}, {world}"] = float(lost.mean()) if len(lost) else "nothing promised"
            rows.append([f"{lost.sum()} of {len(lost)} lost" for _, lost in runs.values()])
        draw_two_by_two(figure.add_subplot(grid[1, :]), rows)
        return numbers

    controls = {
        "error": slider("error e (m, m/s)", 0.0, 0.08, 0.005, 0.02, live=False),
        "delay": slider("delay d (s)", 0.0, 0.2, 0.02, 0.1, live=False),
        "jitter": slider("jitter j (s)", 0.0, 0.1, 0.01, 0.02, live=False),
    }
    alt = "Runs of a cart with a table that knows of errors, and without"
    return Explorer(draw, controls, size=(8.2, 4.4), slow="solving", alt=alt, motion="error")


# ---- checks


@exercise(
    "16.1",
    "Eq. (16.4): the place is off by e_1, by what the speed is off in the delay, and by what the wind adds in it.",
)
def check_box(half_widths):
    """(1/50 + 1/125 + 1/100, 1/25 + 1/10)."""
    expect(len(half_widths) == 2, "a pair: of the place and of the speed.")
    expect(all(isinstance(one, Fraction) for one in half_widths), "as Fractions, so that nothing is rounded.")
    place, speed = half_widths
    expect(speed == Fraction(7, 50), "the speed: what it is off by at first, and what the wind adds in 1/5 s.")
    expect(place != Fraction(1, 50), "the place: the robot moves on with a speed that is not known exactly.")
    expect(place == Fraction(19, 500), "the place: e_1 + e_2 d + b d^2 / 2, Eq. (16.4).")


@exercise("16.2", "All of the box has to lie in one of the intervals of K(u).")
def check_inputs(right_inputs):
    """All of [y - E, y + E] in one interval."""
    kept_by = {-1: [(-3, -1), (0, 2)], 0: [(1, 4)], 1: [(-1, 1), (3, 5)]}
    expect(sorted(right_inputs(2, kept_by, 0)) == [-1, 0], "with E = 0 the prediction is the state; 2 is in two sets.")
    said = "K(0) = [1, 4] holds all of [1.5, 3.5], and no other does."
    expect(list(right_inputs(Fraction(5, 2), kept_by, 1)) == [0], said)
    said = "at y = 1.5 with E = 1 each state has an input that is right, and no input is right for all."
    expect(list(right_inputs(Fraction(3, 2), kept_by, 1)) == [], said)
    said = "a box that reaches from one interval into the next lies in neither: what is between them is lost."
    expect(list(right_inputs(Fraction(-1, 2), {7: [(-3, -1), (0, 2)]}, 1)) == [], said)
    rng = np.random.default_rng(0)
    for _ in range(400):
        kept_by = {}
        for u in range(-2, 3):
            ends = sorted({int(end) for end in rng.integers(-20, 21, 6)})
            kept_by[u] = list(zip(ends[::2], ends[1::2], strict=False))
        y, half = int(rng.integers(-20, 21)), int(rng.integers(0, 6))
        wanted = [u for u, parts in kept_by.items() if any(low <= y - half and y + half <= high for low, high in parts)]
        got = right_inputs(y, kept_by, half)
        expect(sorted(got) == sorted(wanted), f"for y = {y}, E = {half} and {kept_by} it should be {wanted}.")


@exercise("16.3", "Set the bracket of (16.10) to zero and solve for delta; then mind d + 2 j.")
def check_shortest(shortest):
    """max(2 (e + d b) / (1 - b) + 2 j, d + 2 j)."""
    zero, fifth = Fraction(0), Fraction(1, 5)
    expect(not isinstance(shortest(fifth, fifth, zero, fifth), float), "as a Fraction, so that nothing is rounded.")
    expect(shortest(zero, zero, zero, fifth) == 0, "a perfect robot may measure as often as it likes.")
    expect(shortest(fifth, zero, zero, zero) == 2 * fifth, "an error costs 2 e, and without a wind a step gains delta.")
    expect(shortest(zero, zero, fifth, zero) == 2 * fifth, "the shortest interval lasts delta - 2 j.")
    expect(shortest(zero, fifth, zero, zero) == fifth, "without a wind a delay blurs nothing; but it must fit.")
    rng = np.random.default_rng(0)
    for _ in range(300):
        error, delay, jitter, push = (Fraction(int(n), 20) for n in rng.integers(0, 10, 4))
        wanted = max(2 * (error + delay * push) / (1 - push) + 2 * jitter, delay + 2 * jitter)
        given = f"e, d, j, b = {error}, {delay}, {jitter}, {push}"
        expect(shortest(error, delay, jitter, push) == wanted, f"{given}: the bracket of (16.10) is not zero there.")


def _robot(rng):
    """A controller that is constant between edges, narrow slots among them, and how badly off the robot then is."""
    edges = np.sort(np.concatenate([rng.uniform(-1, 1, 5), rng.uniform(-1, 1, 3)]))
    edges[4] = edges[3] + 1e-5  # a slot that no grid finds
    chosen, harm = rng.permutation(len(edges) + 1), rng.normal(size=len(edges) + 1)
    harm[chosen[4]] += 2.0

    def choose(y):
        return int(chosen[np.searchsorted(edges, y)])

    def after(q, u):
        return float(harm[u] + 0.1 * q)

    return np.sort(edges), choose, after


@exercise("16.4", "Cut what is within reach at the edges, and try the middle of every piece.")
def check_attack(attack):
    """As bad as the worst piece within reach."""
    rng = np.random.default_rng(0)
    for trial in range(200):
        edges, choose, after = _robot(rng)
        q, error = float(rng.uniform(-0.7, 0.7)), float(rng.uniform(0.05, 0.4))
        off = float(attack(q, error, edges, choose, after))
        expect(abs(off) <= error, f"an error of {off:.4g} is larger than {error:.4g}: the adversary keeps its bound.")
        cuts = np.concatenate([[q - error], edges[np.abs(edges - q) < error], [q + error]])
        worst = max(after(q, choose(y)) for y in [*cuts, *(cuts[1:] + cuts[:-1]) / 2])
        got = after(q, choose(q + off))
        said = "between two edges the answer is the same: one try in the middle of each piece is enough."
        expect(got >= worst - 1e-9, f"try {trial}: {got:.3f}, but {worst:.3f} can be had. Hint: {said}")


def _slider(error):
    """A cart on a short rail, coarse enough to be solved in a moment."""
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.2, -1.0], [1.2, 1.0], (41, 31)),
        dynamics=sdhj.Dynamics(
            [[-1.0], [0.0], [1.0]],
            lambda q, u: np.stack([q[:, 1], np.full(len(q), u[0])], axis=1),
            [[0.0], [1.0]],
            [0.1],
        ),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.abs(p).max(axis=1) - 0.35),
        unsafe=[],
        delta=0.4,
        steps=3,
        sensing=sdhj.Sensing(error=error, delay=0.1, memory=False),
    )


def _promised(error, state):
    try:
        table = sdhj.solve(_slider(error), progress=False)
    except ValueError:
        return False
    return bool(table.contains(np.array([state]), start=0, within=3)[0])


@exercise("16.5", "Bisect. A ValueError means that it is not promised, and `table.contains` answers for states.")
def check_largest(largest_error):
    """Promised a little below, not a little above; and the state is not a prediction."""
    for state in ((0.0, 0.0), (-0.45, 0.2)):
        got = float(largest_error(_slider, np.array(state)))
        expect(0 <= got <= 0.2, f"for the state {state}: {got:g} is not between 0 and 0.2.")
        below, above = max(got - 1e-3, 0.0), got + 1e-3
        said = f"for the state {state}: with an error of"
        hint = "`table.contains` answers for states, `table.values` for predictions"
        expect(_promised(below, state), f"{said} {below:.4f} it is not promised any more. ({hint}.)")
        expect(not _promised(above, state), f"{said} {above:.4f} it is promised still. (Halve an interval.)")
    got = float(largest_error(lambda error: _slider(error / 20), np.zeros(2)))
    expect(
        0.2 - 1e-3 <= got <= 0.2, f"{got:g} for a robot that keeps its promise with any error up to 0.2, and beyond."
    )
