"""Fig. 1: An arm is to reach a target among disks whose motion is known and an agent that nobody can predict."""

import numpy as np
from common import SHOWN_STATE, Context, command_of, draw_velocities
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.arm.case_studies import ArmScene
from sdhj.plotting.looks import INK


def value(context: Context) -> float:
    """How far the robot shown is from what is unsafe, m."""
    return float(context.problem.unsafe_value(np.array([SHOWN_STATE]), 0.0)[0])


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6, layout="none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    plotting.draw_workspace(ax, context.scene, state=SHOWN_STATE, trail=np.array([0.0, 0.2, 0.4, 0.6, 0.8]))
    draw_velocities(ax, context.scene)
    ax.set(xlim=(-0.66, 0.66), ylim=(-0.34, 0.34))
    ax.axis("off")
    draw_names(ax, context.scene)
    return figure


def draw_names(ax: Axes, scene: ArmScene) -> None:
    """What is what, and arrows about the agent, which may go anywhere."""
    state = np.array(SHOWN_STATE)
    pursuer, radius = state[2:], scene.agent_radius
    for angle in np.deg2rad((20, 65, 110, 155, 200, 245, 290, 335)):
        way = np.array([np.cos(angle), np.sin(angle)])
        arrow = {"arrowstyle": "->", "color": INK, "linewidth": 0.8}
        ax.annotate(
            "", tuple(pursuer + (radius + 0.045) * way), tuple(pursuer + (radius + 0.01) * way), arrowprops=arrow
        )
    base, (elbow, tip) = np.zeros(2), scene.arm.joints(state[:2])
    assert scene.target is not None
    still, line, circle = (disk.centre(0.0) for disk in scene.obstacles)
    names = [
        ("unpredictable agent\n(pursuer)", pursuer, 0.38, 0.30),
        ("end-effector", tip, -0.40, -0.12),
        ("robot arm", 0.5 * elbow + 0.5 * tip, -0.40, -0.24),
        ("known moving obstacles", line, 0.38, -0.12),
        ("", circle + np.array([0.035, -0.01]), 0.38, -0.12),
        ("base", base, -0.40, 0.0),
        ("known static obstacle", still, -0.40, 0.13),
        ("known moving target", scene.target.centre(0.0), -0.40, 0.26),
    ]
    for text, point, x, y in names:
        right = x > 0
        ax.annotate(
            text,
            point,
            (x, y),
            ha="left" if right else "right",
            va="center",
            annotation_clip=False,
            zorder=8,
            arrowprops={"arrowstyle": "-", "color": "#555555", "linewidth": 0.7, "shrinkA": 2, "shrinkB": 3},
        )


if __name__ == "__main__":
    command_of(__file__)()
