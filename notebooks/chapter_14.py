"""The evader, and the limits of the adversary."""

from functools import lru_cache

import numpy as np
from chapter_08 import TALL, draw_tube_and_arm
from live_slices import POSTURE
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from widgets import Explorer, Numbers, agent_sliders, slider

import sdhj
from sdhj.kernels import FloatArray
from sdhj.table.batches import Table


def draw_limits(ax: Axes, bounds: FloatArray, shares: FloatArray, limit: float) -> None:
    """Shares of C within 0 and 8 steps, (B, 2), against the disturbance, with the limit that the pencil found."""
    for column, label in enumerate(("in the target", "within 8 steps")):
        ax.plot(bounds, shares[:, column], marker="o", label=label, gid=label)
    ax.axvline(limit, color="#c44e00", linestyle=":", label="predicted limit")
    share = r"share of $\mathcal{C}$ inside"
    ax.set(xlabel="disturbance of the joints (rad/s)", ylabel=share, ylim=(0, 1.05 * float(np.max(shares))))
    ax.grid(axis="y")
    ax.legend()


def explore_evader(nodes: int = 13, method: str = "hji") -> Explorer:
    """The evading target of Sec. 6.1, solved at each change of its speed and size."""

    @lru_cache(maxsize=16)
    def solved(v_e: float, v_d: float, radius: float) -> Table:
        return sdhj.solve(
            sdhj.evader_case_study(nodes, v_e_max=v_e, v_d_max=v_d, evader_radius=radius),
            method=method,
            progress=False,
        )

    def draw(figure: Figure, v_e: float, v_d: float, radius: float, px: float, py: float) -> Numbers:
        return draw_tube_and_arm(figure, solved(v_e, v_d, radius), state=(*POSTURE, px, py))

    problem = sdhj.evader_case_study(nodes)
    controls = {
        "v_e": slider("evader's speed (m/s)", 0.0, 0.6, 0.05, 0.1, live=False),
        "v_d": slider("disturbance (rad/s)", 0.0, 2.0, 0.1, 0.3, live=False),
        "radius": slider("evader's radius (m)", 0.05, 0.1, 0.01, 0.06, live=False),
        **agent_sliders(problem, 0.1, 0.18),
    }
    alt = "A slice of the tube of the evader game"
    return Explorer(draw, controls, size=TALL, slow=True, alt=alt, motion="v_e")
