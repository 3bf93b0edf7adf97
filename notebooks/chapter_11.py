"""The evader, and the limits of the adversary."""

from functools import lru_cache

from chapter_06 import draw_tube_and_arm
from live_slices import POSTURE
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, agent_sliders, slider

import sdhj
from sdhj.table import Table


def explore_evader(nodes: int = 13, method: str = "hji") -> Explorer:
    """The evading target of Sec. 6.1, solved at each change of its speed and size."""

    @lru_cache(maxsize=16)
    def solved(v_e: float, v_d: float, radius: float, progress: bool) -> Table:
        return sdhj.solve(
            sdhj.evader_case_study(nodes, v_e_max=v_e, v_d_max=v_d, evader_radius=radius),
            method=method,
            progress=progress,
        )

    def draw(figure: Figure, v_e: float, v_d: float, radius: float, px: float, py: float, progress: bool) -> Numbers:
        return draw_tube_and_arm(figure, solved(v_e, v_d, radius, progress), state=(*POSTURE, px, py))

    problem = sdhj.evader_case_study(nodes)
    controls = {
        "v_e": slider("evader's speed (m/s)", 0.0, 0.6, 0.05, 0.1, live=False),
        "v_d": slider("disturbance (rad/s)", 0.0, 2.0, 0.1, 0.3, live=False),
        "radius": slider("evader's radius (m)", 0.05, 0.1, 0.01, 0.06, live=False),
        **agent_sliders(problem, 0.1, 0.18),
    }
    return Explorer(draw, controls, slow=True, alt="A slice of the tube of the evader game")
