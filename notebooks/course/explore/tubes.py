"""Tubes in four dimensions, live: slices of a table, of two tables, of games solved at each change."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from matplotlib.figure import Figure

import sdhj
from course.draw.bodies import TURNED, Body, draw_turned
from course.draw.slices import POSTURE
from course.draw.tubes import TALL, draw_certified, draw_gap, draw_pursuer_plane, draw_tube_and_arm
from course.widgets import Explorer, Numbers, agent_sliders, angle, choice, played, slider, step_sliders
from sdhj.arm.case_studies import OBSTACLES
from sdhj.arm.workspace import Disk, Still
from sdhj.table.batches import Table

PLANES = {"q1 and q2": (0, 1), "px and py": (2, 3), "q1 and px": (0, 2), "q2 and py": (1, 3)}


def explore_tube(table: Table) -> Explorer:
    """Slice the four-dimensional tube wherever you like."""

    def draw(figure: Figure, axes: str, start: int, within: int, **at: float) -> Numbers:
        state = [at[name] for name in ("q1", "q2", "px", "py")]
        return draw_tube_and_arm(figure, table, state=state, start=start, within=within, axes=PLANES[axes])

    controls = {
        "axes": choice("slice", list(PLANES), "q1 and q2"),
        **agent_sliders(table.problem),
        **step_sliders(table),
        "q1": angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": angle("joint angle q2 (rad)", POSTURE[1]),
    }
    return Explorer(draw, controls, size=TALL, alt="A slice of the tube beside the arm", motion="px")


def explore_growing(steps: int = 20) -> Explorer:
    """The tube while it grows from the target: the case study's 0.8 s, cut into more and shorter intervals."""
    problem = sdhj.arm_case_study((25, 25, 13, 13), steps, delta=0.8 / steps)  # all axes at 25: 0.6 GB of tables
    table = sdhj.solve(problem, progress=False, play=False)

    def draw(figure: Figure, within: int, px: float, py: float) -> Numbers:
        return draw_tube_and_arm(figure, table, state=(*POSTURE, px, py), within=within)

    controls = {
        "within": played(slider("within, steps to go n", 0, steps, 1, steps // 2)),
        **agent_sliders(problem),
    }
    return Explorer(draw, controls, size=TALL, alt="The tube as it grows, step by step", process="within")


def explore_pursuer(table: Table) -> Explorer:
    """The other slice: for one posture of the arm, where may the pursuer be?"""

    def draw(figure: Figure, q1: float, q2: float, start: int, within: int) -> Numbers:
        return draw_pursuer_plane(figure.subplots(), table, state=(q1, q2, 0.36, 0.36), start=start, within=within)

    controls = {
        "q1": angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": angle("joint angle q2 (rad)", POSTURE[1]),
        **step_sliders(table),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Where the pursuer may start", motion="q1")


def explore_arm_game(nodes: int = 25, method: str = "hji") -> Explorer:
    """The arm's game in four dimensions, solved at each change of the adversary, clock, inputs or an obstacle."""

    @lru_cache(maxsize=2)  # a table of 25 nodes takes 180 MB, which the system is slow to hand out
    def solved(v_p: float, v_d: float, delta: float, levels: int, x: float, y: float) -> Table:
        obstacles = (Disk(Still((x, y)), 0.06), *OBSTACLES[1:])
        problem = sdhj.arm_case_study(
            nodes, delta=delta, v_p_max=v_p, v_d_max=v_d, input_levels=levels, obstacles=obstacles
        )
        return sdhj.solve(problem, method=method, progress=False, play=False)

    def draw(figure: Figure, v_p: float, v_d: float, delta: float, levels: int, x: float, y: float) -> Numbers:
        return draw_tube_and_arm(figure, solved(v_p, v_d, delta, levels, x, y), state=(*POSTURE, 0.24, 0.24))

    controls = {
        "v_p": slider("pursuer's speed (m/s)", 0.0, 0.8, 0.05, 0.2, live=False),
        "v_d": slider("disturbance (rad/s)", 0.0, 3.0, 0.15, 0.3, live=False),
        "delta": slider("sampling interval (s)", 0.05, 0.2, 0.01, 0.1, live=False),
        "levels": slider("input levels on each axis", 2, 7, 1, 5, live=False),
        "x": slider("static obstacle x (m)", -0.3, 0.3, 0.02, -0.22, live=False),
        "y": slider("static obstacle y (m)", -0.3, 0.3, 0.02, 0.1, live=False),
    }
    return Explorer(draw, controls, size=TALL, slow=True, alt="A slice of the tube, solved anew", motion="v_d")


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


def explore_certified(table: Table, certified: Any) -> Explorer:
    """What of an interpolated table is certified, slice by slice."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int) -> Numbers:
        return draw_certified(figure, table, certified, state=(*POSTURE, px, py), start=start, within=within)

    return Explorer(
        draw,
        {**agent_sliders(table.problem), **step_sliders(table)},
        size=(8.6, 3.8),
        alt="Certified and interpolated tube",
        motion="px",
    )


def explore_evader(nodes: int = 25, method: str = "hji") -> Explorer:
    """The evading target of Sec. 6.1, solved at each change of its speed and size."""

    @lru_cache(maxsize=2)
    def solved(v_e: float, v_d: float, radius: float) -> Table:
        problem = sdhj.evader_case_study(nodes, v_e_max=v_e, v_d_max=v_d, evader_radius=radius)
        return sdhj.solve(problem, method=method, progress=False, play=False)

    def draw(figure: Figure, v_e: float, v_d: float, radius: float, px: float, py: float) -> Numbers:
        return draw_tube_and_arm(figure, solved(v_e, v_d, radius), state=(*POSTURE, px, py))

    problem = sdhj.evader_case_study(nodes)
    controls = {
        "v_e": slider("evader's speed (m/s)", 0.0, 0.5, 0.025, 0.1, live=False),
        "v_d": slider("disturbance (rad/s)", 0.0, 2.0, 0.1, 0.3, live=False),
        "radius": slider("evader's radius (m)", 0.05, 0.1, 0.01, 0.06, live=False),
        **agent_sliders(problem),
    }
    alt = "A slice of the tube of the evader game"
    return Explorer(draw, controls, size=TALL, slow=True, alt=alt, motion="v_e")
