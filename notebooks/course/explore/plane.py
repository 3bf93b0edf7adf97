"""Games in the plane, live: one interval, one horizon cut into several, the whole recursion, a car."""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import sdhj
from course.draw.plane import draw_car, draw_filling, draw_plane_game, draw_row, filling
from course.paper import boat
from course.robots import point_robot
from course.widgets import Explorer, Numbers, angle, choice, played, slider
from sdhj.arm.workspace import Disk, Line
from sdhj.table.batches import Table


def explore_interval(nodes: int = 49) -> Explorer:
    """A boat that holds a heading for one interval, in turning water and wind: solved and played at each change."""

    @lru_cache(maxsize=64)
    def solved(nodes: int, hold: float, wind: float, heading: float) -> boat.OneStepGame:
        u = (1.5 * math.cos(heading), 1.5 * math.sin(heading))
        return boat.one_step_game(boat.boat_problem(nodes=nodes, hold=hold, wind=wind, heading=u))

    def draw(figure: Figure, show: str, hold: float, wind: float, heading: float, x: float, y: float) -> Numbers:
        game, coarse = (solved(count, hold, wind, heading) for count in (nodes, nodes // 2 + 1))
        runs = boat.play(game.problem, (x, y))
        boat.draw_one_step(figure.subplots(), game, show=show, starts=[("$q$", runs)])
        q, won = np.array([[x, y]]), runs.costs <= 0
        cost, rough = (float(one.problem.grid.interpolate(one.cost, q)[0]) for one in (game, coarse))
        values, name = {
            "reach": (game.reach, "reach set"),
            "avoid": (game.avoid, "avoid tube"),
            "reach-avoid": (game.cost, "reach-avoid set"),
        }[show]
        return {
            f"share of the lake in the {name}": game.problem.grid.fraction(values <= 0),
            "cost of q, Eq. (6)": cost,
            "on half the nodes": rough,
            "costliest run": float(runs.costs.max()),
            "runs won": f"{int(won.sum())} of {won.size}",
        }

    controls = {
        "show": choice("show", boat.CONSTRUCTS, "reach-avoid"),
        "hold": slider("length of the interval (s)", 0.1, 0.9, 0.05, 0.6, live=False),
        "wind": slider("wind, at most (m/s)", 0.0, 0.5, 0.02, 0.14, live=False),
        "heading": slider("heading held (rad)", -1.0, 1.0, 0.05, 0.05, live=False),
        "x": slider("start x (m)", -0.9, 0.6, 0.02, -0.4),
        "y": slider("start y (m)", -0.5, 0.8, 0.02, 0.2),
    }
    alt = "Reach-avoid set of one interval with runs against many winds"
    return Explorer(draw, controls, size=(6.6, 4.2), slow=True, alt=alt, motion="wind", process="hold")


def explore_holding(nodes: int = 41) -> Explorer:
    """One horizon of 0.8 s cut into 1 to 20 intervals: what it costs to hold an input and not to look."""

    def draw(figure: Figure, intervals: int, v_max: float, input_levels: int) -> Numbers:
        problem = point_robot(nodes, intervals, delta=0.8 / intervals, v_max=v_max, input_levels=input_levels)
        table = sdhj.solve(problem, progress=False)
        ax = figure.subplots()
        draw_plane_game(ax, table)
        ax.set_title(f"{intervals} interval{'s' * (intervals > 1)} of {0.8 / intervals:.2f} s")
        return {
            "share of the square inside": table.fraction(start=0, within=intervals),
            "one-step games solved": len(problem.inputs) * intervals * (intervals + 1) // 2,
        }

    controls = {
        "intervals": slider("intervals in 0.8 s", 1, 20, 1, 4, live=False),
        "v_max": slider("adversary's speed (m/s)", 0.0, 0.9, 0.05, 0.25, live=False),
        "input_levels": slider("input levels on each axis", 2, 5, 1, 3, live=False),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), slow=True, alt="Tubes of the point robot", motion="intervals")


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
    return Explorer(draw, controls, size=(4.8, 3.9), slow=True, alt="Tubes of the point robot", motion="v_max")


def explore_car(table: Table) -> Explorer:
    """The car's tubes, heading by heading."""

    def draw(figure: Figure, heading: float, within: int) -> Numbers:
        return draw_car(figure.subplots(), table, heading=heading, within=within)

    controls = {
        "heading": angle("heading (rad)", 0.0),
        "within": slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Tubes of the car for one heading", motion="heading")
