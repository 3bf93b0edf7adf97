"""Chapter 7, The recursion: its pictures, widgets and checks (finite games, played out by brute force)."""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import sdhj
from course.chapter_04 import draw_plane_game
from course.exercises import exercise, expect
from course.robots import point_robot
from course.slices import HERE, LIVE, draw_pixels, fewest_steps, slice_values
from course.widgets import Explorer, Numbers, played, slider
from sdhj.arm.workspace import Disk, Line
from sdhj.plotting import plane, step_colours
from sdhj.plotting.looks import INK, OUTCOME_INK
from sdhj.table.batches import Table

# ---- pictures

UNSAFE_PINK, NOTHING = (0.965, 0.741, 0.659, 1.0), (1.0, 1.0, 1.0, 0.0)


def filling(steps: int) -> list[tuple[int, int | None]]:
    """What the library makes, in its order: (k, None), the walls of row k, and (k, n), a tube of it; (7.1)."""
    made: list[tuple[int, int | None]] = []
    for k in range(steps, -1, -1):
        made += [(k, None)] if k < steps else []
        made += [(k, n) for n in range(steps - k + 1)]
    return made


def draw_filling(ax: Axes, table: Table, made: int) -> Numbers:
    """The look-up table after so many of `filling`: the newest framed, and dashed the two that it was made from."""
    done, grid, gap = filling(table.steps)[:made], table.grid, 0.18
    k_now, n_now = done[-1] if done else (None, None)
    sources = {(k_now, n_now - 1), (k_now + 1, n_now - 1)} if n_now and k_now is not None else set()
    where, side = plane(grid, (0.0, 0.0), resolution=LIVE // 2), grid.upper[0] - grid.lower[0]
    colours = np.array([*step_colours(table.steps), UNSAFE_PINK, NOTHING])
    for k in range(table.steps + 1):
        blank = (k, None) not in done and (k, 0) not in done  # nothing of this row is known yet
        hit = where.shaped(table.problem.unsafe_value(where.points, table.problem.time(k))) <= 0
        for n in range(table.steps - k + 1):
            left, low = n * (side + gap), (table.steps - k) * (side + gap)
            places = np.where(hit & (not blank), -2, -1)
            if (k, n) in done:
                values = slice_values(grid, table.values(start=k, within=n), (0, 0), (0, 1), where.x, where.y)
                places[values <= 0] = n
            draw_pixels(ax, colours[places], (left, left + side, low, low + side), f"tube-{k}-{n}")
            now = k == k_now and n_now in (n, None)
            looks = {"edgecolor": OUTCOME_INK if now else INK if (k, n) in sources else "#9a9a9a"}
            looks |= {"linewidth": 2.4 if now else 1.8 if (k, n) in sources else 0.6}
            looks |= {"linestyle": "--" if (k, n) in sources else "-", "zorder": 4.0 if now else 3.0}
            ax.add_patch(Rectangle((left, low), side, side, facecolor="none", gid=f"cell-{k}-{n}", **looks))
        ax.text(-gap, (table.steps - k) * (side + gap) + side / 2, f"k = {k}", ha="right", va="center")
        ax.text(k * (side + gap) + side / 2, -gap, f"n = {k}", ha="center", va="top")
    far = (table.steps + 1) * (side + gap)
    ax.set(xlim=(-0.45 * side, far), ylim=(-0.3 * side, far), aspect="equal")
    ax.axis("off")
    tubes = [(k, n) for k, n in done if n is not None]
    newest = "nothing" if not done else f"walls of row {k_now}" if n_now is None else f"tube k = {k_now}, n = {n_now}"
    return {
        "made last": newest,
        "tubes": len(tubes),
        "games to reach": len(table.problem.inputs) * sum(n > 0 for _, n in tubes),
        "games to avoid": len(table.problem.inputs) * (len(done) - len(tubes)),
    }


def draw_row(ax: Axes, table: Table, *, start: int, point: Sequence[float]) -> Numbers:
    """A row of the look-up table: the tubes from step `start`, the leftmost one that holds `point` framed."""
    most, gap, grid = table.steps - start, 0.15, table.grid
    colours = np.array([NOTHING, UNSAFE_PINK])
    where = plane(grid, point, resolution=LIVE)
    unsafe = where.shaped(table.problem.unsafe_value(where.points, start * table.problem.delta)) <= 0
    side = grid.upper[0] - grid.lower[0]
    first = fewest_steps(table, point, start, most)
    for n in range(most + 1):
        left = n * (side + gap)
        image = colours[unsafe.astype(int)]
        image[slice_values(grid, table.values(start=start, within=n), point, (0, 1), where.x, where.y) <= 0] = (
            step_colours(table.steps)[n]
        )
        chosen = n == first
        draw_pixels(ax, image, (left, left + side, 0, side), f"tube-{n}")
        width, colour, gid = (2.4, OUTCOME_INK, "frame") if chosen else (0.6, "#9a9a9a", f"cell-{n}")
        looks = {"facecolor": "none", "linewidth": width, "edgecolor": colour}
        ax.add_patch(Rectangle((left, 0), side, side, zorder=3.0, gid=gid, **looks))
        ax.plot(left + point[0] - grid.lower[0], point[1] - grid.lower[1], **HERE)
        ax.text(left + side / 2, side * 1.04, f"n = {n}", ha="center")
    ax.set(xlim=(-0.05, (table.steps + 1) * (side + gap)), ylim=(-0.05, side * 1.2), aspect="equal")
    ax.axis("off")
    return {"fewest steps to go": first, "tubes that hold the point": 0 if np.isnan(first) else most + 1 - int(first)}


# ---- widgets


def explore_filling(table: Table) -> Explorer:
    """The look-up table while it is made, row by row from below: first its walls, then one tube after another."""

    def draw(figure: Figure, made: int) -> Numbers:
        return draw_filling(figure.subplots(), table, made)

    last = len(filling(table.steps))
    controls = {"made": played(slider("walls and tubes made", 0, last, 1, (2 * last) // 3))}
    alt = "The look-up table while it is filled, a tube made from its two neighbours"
    return Explorer(draw, controls, size=(6.0, 5.0), alt=alt, process="made")


def explore_row(table: Table) -> Explorer:
    """A row of the look-up table: every tube from one step, and the leftmost one that holds a point you place."""

    def draw(figure: Figure, start: int, x: float, y: float) -> Numbers:
        return draw_row(figure.subplots(), table, start=start, point=(x, y))

    controls = {
        "start": slider("start, step k", 0, table.steps, 1, 0),
        "x": slider("x (m)", -1.0, 1.0, 0.05, -0.3),
        "y": slider("y (m)", -1.0, 1.0, 0.05, 0.3),
    }
    return Explorer(
        draw, controls, size=(8.6, 2.1), alt="A row of tubes, the leftmost that holds the point framed", motion="x"
    )


def explore_plane_game(nodes: int = 41) -> Explorer:
    """The point robot's whole game, solved at each change: adversary, sampling interval, inputs, obstacle."""

    @lru_cache(maxsize=32)
    def solved(v_max: float, delta: float, input_levels: int, obstacle_x: float, obstacle_speed: float) -> Table:
        obstacle = Disk(Line((obstacle_x, -0.45), (0.0, obstacle_speed)), 0.16)
        problem = point_robot(nodes, 4, delta=delta, v_max=v_max, input_levels=input_levels, obstacle=obstacle)
        return sdhj.solve(problem, progress=False)

    def draw(figure: Figure, start: int, **game: Any) -> Numbers:
        table, ax = solved(**game), figure.subplots()
        draw_plane_game(ax, table, start=start)
        ax.set_title(f"from step {start}, t = {table.problem.time(start):.2f} s")
        return {f"within {n}": table.fraction(start=start, within=n) for n in range(4 - start + 1)}

    controls = {
        "v_max": slider("adversary's speed (m/s)", 0.0, 0.9, 0.05, 0.25, live=False),
        "delta": slider("sampling interval (s)", 0.05, 0.4, 0.05, 0.2, live=False),
        "input_levels": slider("input levels on each axis", 2, 5, 1, 3, live=False),
        "obstacle_x": slider("obstacle's x (m)", -0.8, 0.1, 0.05, -0.15, live=False),
        "obstacle_speed": slider("obstacle's speed (m/s)", 0.0, 1.0, 0.05, 0.5, live=False),
        "start": slider("start, step k", 0, 4, 1, 0),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), slow="solving", alt="Tubes of the point robot", motion="v_max")


# ---- checks


def _game(seed, states=12, inputs=3, moves=2):
    """A random finite game with most goals in the middle and a few unsafe states."""
    rng = np.random.default_rng(seed)
    step = np.clip(
        np.arange(states)[:, None] + rng.integers(-3, 4, (inputs, 1, 1)) + rng.integers(-1, 2, (inputs, states, moves)),
        0,
        states - 1,
    )
    goal, unsafe = np.zeros((2, states), bool)
    goal[[3, 8]] = True
    unsafe[rng.choice(states, 2, replace=False)] = True
    return step, goal, unsafe


def _wins(step, goal, unsafe):
    """A function (state, n): whether the goal can be forced within n steps."""

    @cache
    def wins(s, n):
        if unsafe[s]:
            return False
        return bool(goal[s]) or (n > 0 and any(all(wins(t, n - 1) for t in moves) for moves in step[:, s].tolist()))

    return wins


@exercise("7.1", "From step k there are N - k intervals left, and nobody needs more than are left.")
def check_rows(entry):
    """min(n, N - k)."""
    for N, k, n, wanted in (
        (8, 0, 8, 8),
        (8, 0, 3, 3),
        (8, 5, 2, 2),
        (8, 5, 3, 3),
        (8, 5, 7, 3),
        (8, 8, 4, 0),
        (4, 3, 4, 1),
    ):
        got = entry(N, k, n)
        expect(got <= N - k, f"N = {N}, k = {k}, n = {n}: that entry is a star, only {N - k} intervals are left.")
        expect(got <= n, f"N = {N}, k = {k}, n = {n}: no more than n steps are allowed.")
        expect(got == wanted, f"N = {N}, k = {k}, n = {n}: the tube is {wanted} columns from the first.")


@exercise("7.2", "tube[step] has the shape of step: `all` over the moves of the adversary, `any` over the inputs.")
def check_tubes(finite_tubes):
    """Against a game played out."""
    for seed in range(30):
        step, goal, unsafe = _game(seed)
        got = np.asarray(finite_tubes(step, goal, unsafe, 4))
        expect(got.shape == (5, 12), "one row for each n from 0 to N, one column for each state.")
        wins = _wins(step, goal, unsafe)
        wanted = np.array([[wins(s, n) for s in range(12)] for n in range(5)])
        expect(got[0] == wanted[0], "n = 0: the goal, less what is unsafe.")
        expect(~got[:, unsafe], "an unsafe state wins, or is used on the way.")
        expect(got[1:] >= got[:-1], "who wins within n - 1 steps wins within n: the union with the tube before.")
        expect(~(got & ~wanted), "some state is called won from which the adversary can prevent it: all v, not some v.")
        expect(got == wanted, "some state is called lost that one of the inputs wins.")


@exercise(
    "7.3",
    "Row n holds states that row n - 1 lacks. Their inputs are those that lead into row n - 1 in any case.",
)
def check_inputs(progress_inputs):
    """Inputs of the leftmost set."""
    for seed in range(30):
        step, goal, unsafe = _game(seed)
        wins = _wins(step, goal, unsafe)
        got = np.asarray(progress_inputs(step, goal, unsafe, 4))
        expect(got.shape == (3, 12), "one row for each input, one column for each state.")
        for s in range(12):
            fewest = next((n for n in range(5) if wins(s, n)), None)
            if not fewest:
                expect(~got[:, s], "in the goal nothing is left to do, and for a lost state no input is promised.")
                continue
            for j in range(3):
                wanted = all(wins(int(t), fewest - 1) for t in step[j, s])
                expect(got[j, s] or not wanted, "an input is missing that leads in any case to fewer steps.")
                expect(
                    wanted or not got[j, s],
                    "an input is promised that the adversary can make useless, or that makes no progress.",
                )


@exercise("7.4", "kept = kept and some input leads into kept in any case; over when a round takes nothing away.")
def check_viable(viable):
    """The greatest fixed point."""
    some = 0
    for seed in range(40):
        step, _, unsafe = _game(seed)
        kept = ~unsafe
        for _ in range(13):
            kept = kept & np.array([any(kept[step[j, s]].all() for j in range(3)) for s in range(12)])
        got = np.asarray(viable(step, unsafe))
        expect(got.shape == (12,), "one answer for each state.")
        expect(~got[unsafe], "an unsafe state is not safe for ever.")
        expect(~(got & ~kept), "some state is called viable that leaves after a few steps. Is one round enough?")
        expect(got == kept, "some state is called lost that can stay: against all v, with one of the inputs.")
        some += kept.any()
    return f"{some} of 40 random games have such states. The library asks the same with target=None."


@exercise(
    "7.5",
    "Find the tubes of `second` first. A state of `first` is as good as the steps left make it, and no better.",
)
def check_in_order(in_order):
    """Played out with a flag for whether the first place has been seen."""
    for seed in range(40):
        step, first, unsafe = _game(seed)
        second = np.roll(first, 3)

        @cache
        def wins(s, seen, n, step=step, first=first, second=second, unsafe=unsafe):
            if unsafe[s]:
                return False
            seen = seen or bool(first[s])
            if seen and second[s]:
                return True
            return n > 0 and any(all(wins(t, seen, n - 1) for t in moves) for moves in step[:, s].tolist())

        most = (0, 1, 2, 5)[seed % 4]
        wanted = np.array([wins(s, False, most) for s in range(12)])
        got = np.asarray(in_order(step, first, second, unsafe, most))
        expect(got.shape == (12,), "one answer for each state.")
        expect(
            ~(got & ~wanted), "some state is called won where the steps do not last for both, or the order is wrong."
        )
        expect(
            got == wanted, "some state is called lost that wins. May the first place be seen early, and passed again?"
        )
    return "It is Theorem 2 on states with a flag: a product of the game and a small automaton."


def _entries(step, goals, unsafe):
    """Every entry (k, n) of a game whose goal depends on time, by Theorem 2."""
    last = len(goals) - 1
    entries = {(k, 0): goals[k] & ~unsafe for k in range(last + 1)}
    for k in range(last - 1, -1, -1):
        for n in range(1, last - k + 1):
            leads = entries[k + 1, n - 1][step].all(axis=2).any(axis=0)
            entries[k, n] = entries[k, n - 1] | (leads & ~unsafe)
    return entries


@exercise(
    "7.6",
    "For n = 1 there is no second entry to look at in the row below. And what row k has done so far says nothing about "
    "what it will do.",
)
def check_pausing(settled, pausing):
    """Entry (k, n) equals (k, n - 1) where (k + 1, n - 1) equals (k + 1, n - 2); a row that pauses and grows again."""
    for seed in range(60):
        step, goal, unsafe = _game(seed)
        rng = np.random.default_rng(seed)
        goals = goal & (rng.random((5, 1)) < 0.4)  # there at some steps only
        entries = _entries(step, goals, unsafe)
        for k, n in ((start, within) for start in range(3, -1, -1) for within in range(1, 5 - start)):
            known = {at: entry for at, entry in entries.items() if at[0] > k or (at[0] == k and at[1] < n)}
            got = bool(settled(known, k, n))
            same = np.array_equal(entries[k, n], entries[k, n - 1])
            where = f"entry ({k}, {n}) of a game with goals at some steps only"
            expect(
                same or not got, f"{where}: you say that it is settled, and it grows. Is it the row below that tells?"
            )
            told = n >= 2 and np.array_equal(entries[k + 1, n - 1], entries[k + 1, n - 2])
            expect(got or not told, f"{where}: the two entries below are equal, so nothing new can come from there.")
    step, goals, unsafe = map(np.asarray, pausing)
    m = len(unsafe)
    expect(step.ndim == 3 and step.shape[1] == m and goals.shape == (5, m), "step (inputs, m, moves), goals (5, m).")
    expect((step >= 0) & (step < m), "every move leads to one of the states 0 to m - 1.")
    entries = _entries(step, goals.astype(bool), unsafe.astype(bool))
    grows = [not np.array_equal(entries[0, n], entries[0, n - 1]) for n in range(1, 5)]
    expect(any(grows), "row 0 never grows. Is the goal there at a step that it can be reached at?")
    last = 4 - grows[::-1].index(True)
    expect(not all(grows[:last]), "row 0 grows at every column until it ends. When is the goal there?")
    return "Row 0 holds " + ", ".join(str(int(entries[0, n].sum())) for n in range(5)) + " states."
