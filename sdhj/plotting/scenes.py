"""The workspace: the arm, the obstacles, the target and the agent (Figs. 1, 9a and 12a)."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from sdhj.arm.case_studies import ArmScene
from sdhj.arm.workspace import Disk
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FAINT, INK, ROBOT_LOOKS, TARGET_LOOKS, UNSAFE_LOOKS, Looks, State, look

FRAME_MARGIN = 0.02


# `add_artist`, not `add_patch`: `draw_workspace` sets the limits, so Matplotlib need not compute them from each patch.


def draw_arm(ax: Axes, scene: ArmScene, q: State, *, alpha: float = 1.0, zorder: float = 5.0) -> None:
    """Draw the arm at joint angles q (2,): the thick links, base, elbow and end-effector.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    scene : ArmScene
        What `sdhj.arm.case_studies.scene` returns.
    q : (2,) array
        The joint angles, rad.
    alpha, zorder : float
        As Matplotlib has them.

    Examples
    --------
    With the paper's arm on a few nodes:

    >>> import sdhj
    >>> from sdhj import plotting
    >>> from sdhj.arm.case_studies import scene
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> plotting.draw_arm(ax, scene(sdhj.arm_case_study(nodes=9)), [0.5, 1.0])
    """
    q = np.asarray(q, dtype=np.float64)[:2]
    elbow, tip = scene.arm.joints(q)
    ax.add_artist(Polygon(scene.arm.outline(q), closed=True, alpha=alpha, zorder=zorder, gid="arm", **ROBOT_LOOKS))
    dots: dict[str, Any] = {"linestyle": "none", "marker": "o", "alpha": alpha, "zorder": zorder + 0.1}
    ax.plot([0.0, elbow[0]], [0.0, elbow[1]], color="white", markeredgecolor=INK, markersize=3.0, gid="joints", **dots)
    ax.plot(*tip, color=INK, markersize=2.8, gid="tip", **dots)


def draw_trail(ax: Axes, disk: Disk, times: FloatArray, looks: Looks, gid: str) -> None:
    """Outlines of a moving disk at times (K,), s, and the path of its centre."""
    plain: Looks = {"facecolor": "none", "edgecolor": looks["edgecolor"], "linewidth": 0.5, "alpha": 0.55}
    for t in times:
        ax.add_artist(Circle(tuple(disk.centre(float(t))), disk.radius, zorder=1.5, gid=gid, **plain))
    fine = np.linspace(times[0], times[-1], 60)
    ax.plot(*disk.centre(fine).T, color=looks["edgecolor"], linestyle=":", linewidth=0.8, zorder=1.6)


def draw_workspace(
    ax: Axes, scene: ArmScene, *, state: State | None = None, time: float = 0.0, trail: FloatArray | None = None
) -> None:
    """Draw obstacles (red, hatched) and target (blue) at a time, and arm and pursuer or evader in a state (Fig. 9a).

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    scene : ArmScene
        As for `draw_arm`.
    state : (4,) array, optional
        Joint angles, rad, and the position of the pursuer or evader, m; by default not drawn.
    time : float
        s
    trail : (K,) array, optional
        Times, s, at which moving disks are outlined.

    Examples
    --------
    With the paper's arm on a few nodes:

    >>> import sdhj
    >>> from sdhj import plotting
    >>> from sdhj.arm.case_studies import scene
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> plotting.draw_workspace(ax, scene(sdhj.arm_case_study(nodes=9)), state=[0.5, 1.0, 0.2, 0.2], time=0.1)
    """
    disks = [(disk, UNSAFE_LOOKS, f"obstacle-{i}") for i, disk in enumerate(scene.obstacles)]
    if scene.target is not None:
        disks.append((scene.target, TARGET_LOOKS, "target"))
    for disk, looks, gid in disks:
        if trail is not None and disk.speed:
            draw_trail(ax, disk, np.asarray(trail, dtype=np.float64), looks, f"{gid}-trail")
        # Above trails (1.5), below pursuer or evader (4) and arm (5).
        ax.add_artist(Circle(tuple(disk.centre(time)), disk.radius, zorder=2.0, gid=gid, **looks))
    if state is not None:
        draw_arm(ax, scene, np.asarray(state)[:2])
        centre = np.asarray(state)[2:4]
        ax.add_artist(Circle(tuple(centre), scene.agent_radius, zorder=4.0, gid=scene.agent, **look(scene.agent)))
        ax.plot(*centre, "+", color=INK, markersize=4, zorder=4.0)
    else:
        ax.plot(0, 0, "s", color=FAINT, markersize=3)
    # Room for wherever the arm, and the pursuer or evader, may be.
    half_side = max(scene.agent_box + scene.agent_radius, sum(scene.arm.lengths)) + FRAME_MARGIN
    limits = (-half_side, half_side)
    ax.set(xlim=limits, ylim=limits, aspect="equal", xlabel="$x$ (m)", ylabel="$y$ (m)")
