"""The paper's diagrams: the problem, the offline and online stages, the game (Figs. 1, 2, 3 and 5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path

from sdhj.arm.case_studies import ArmScene
from sdhj.plotting.looks import FAINT, INK, step_colours
from sdhj.plotting.workspace import draw_workspace

ROBOT_SIDE = "#e3edf7"  # what the robot's designer chooses
ADVERSE = "#f8d9cc"  # what the adversary chooses; hatched as well
NEUTRAL = "#ffffff"
STORED = "#eef0f2"
Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A box of a block diagram: centre and size, inches."""

    x: float
    y: float
    width: float
    height: float

    def side(self, name: str, shift: float = 0.0) -> Point:
        """The middle of a side ("left", "right", "top", "bottom"), or a point `shift` beside it."""
        if name in ("left", "right"):
            return self.x + (self.width if name == "right" else -self.width) / 2, self.y + shift
        return self.x + shift, self.y + (self.height if name == "top" else -self.height) / 2


class Board:
    """An empty page whose coordinates are inches, to put boxes and arrows on."""

    def __init__(self, figure: Figure) -> None:
        figure.set_layout_engine("none")
        self.ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        width, height = figure.get_size_inches()
        self.ax.set(xlim=(0, width), ylim=(0, height))
        self.ax.axis("off")

    def box(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        text: str,
        face: str = NEUTRAL,
        hatch: str = "",
        **font: Any,
    ) -> Box:
        """A rounded box about (x, y) with centred text."""
        shape = FancyBboxPatch(
            (x - width / 2, y - height / 2),
            width,
            height,
            boxstyle="round,pad=0,rounding_size=0.06",
            facecolor=face,
            edgecolor=INK,
            linewidth=0.9,
            zorder=2,
            gid="box",
        )
        self.ax.add_patch(shape)
        if hatch:  # a strip at the left edge: hatching behind words would make them hard to read
            strip = FancyBboxPatch(
                (x - width / 2, y - height / 2),
                0.09,
                height,
                boxstyle="square,pad=0",
                facecolor="none",
                edgecolor="#a8330f",
                hatch=hatch,
                linewidth=0.0,
                zorder=2.1,
            )
            strip.set_clip_path(shape)
            self.ax.add_patch(strip)
        self.text(x + (0.04 if hatch else 0.0), y, text, **font)
        return Box(x, y, width, height)

    def text(self, x: float, y: float, text: str, **font: Any) -> None:
        looks: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 4, "linespacing": 1.35} | font
        self.ax.text(x, y, text, **looks)

    def arrow(self, *points: Point, dashed: bool = False) -> None:
        """An arrow along a polyline."""
        self.ax.add_patch(
            FancyArrowPatch(
                path=Path(np.array(points)),
                arrowstyle="-|>,head_length=4,head_width=2",
                mutation_scale=1.0,
                color=INK,
                linewidth=1.0,
                linestyle="--" if dashed else "-",
                joinstyle="miter",
                zorder=3,
            )
        )

    def zone(self, x0: float, y0: float, x1: float, y1: float, title: str) -> None:
        """A dashed frame with a title at its top left."""
        self.ax.add_patch(
            FancyBboxPatch(
                (x0, y0),
                x1 - x0,
                y1 - y0,
                boxstyle="round,pad=0,rounding_size=0.08",
                facecolor="#fafafa",
                edgecolor=FAINT,
                linestyle=(0, (4, 2)),
                linewidth=0.9,
                zorder=0.5,
            )
        )
        self.text(x0 + 0.08, y1 - 0.13, title, ha="left", color="#444444", fontsize=7.5)


def draw_problem(ax: Axes, scene: ArmScene, *, state: Sequence[float], trail: Sequence[float]) -> None:
    """The arm among known moving disks and an unpredictable agent, named (Fig. 1)."""
    draw_workspace(ax, scene, state=state, trail=np.asarray(trail))
    ax.set(xlim=(-0.66, 0.66), ylim=(-0.34, 0.34))
    ax.axis("off")
    pursuer, radius = scene.agent_disk(state)
    for angle in np.deg2rad((20, 65, 110, 155, 200, 245, 290, 335)):  # it may go anywhere
        way = np.array([np.cos(angle), np.sin(angle)])
        ax.annotate(
            "",
            tuple(pursuer + (radius + 0.045) * way),
            tuple(pursuer + (radius + 0.01) * way),
            arrowprops={"arrowstyle": "->", "color": INK, "linewidth": 0.8},
        )
    base, (elbow, tip) = np.zeros(2), scene.arm.joints(np.asarray(state)[:2])
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


def draw_offline(figure: Figure) -> None:
    """What is computed before the robot moves (Fig. 2). For a figure of 7 by 3 inches."""
    board = Board(figure)
    constraints = board.box(
        0.95, 2.30, 1.60, 0.62, "Constraints\n" r"unsafe $\mathcal{G}(t)$, target $\mathcal{L}_k$", ROBOT_SIDE
    )
    inputs = board.box(
        0.95, 1.50, 1.60, 0.62, "Dynamics and inputs\n" r"$\dot q = f(q, u_j, v)$,  $u_j \in \mathcal{U}$", ROBOT_SIDE
    )
    bounds = board.box(
        0.95, 0.70, 1.60, 0.62, "Adversary's bounds\n" r"$v = (v_p, v_d) \in \mathcal{V}$", ADVERSE, "//////"
    )
    board.zone(2.15, 1.02, 5.15, 2.85, r"for each input $u_j$, over the interval $[t_k, t_{k+1}]$  (Sec. 4.1)")
    game = board.box(2.95, 1.85, 1.32, 1.05, "Reach-avoid game:\nHJI equation\n(Prop. 1)\n" r"$V^j = \Phi(\cdot, t_k)$")
    reach = board.box(
        4.42,
        1.85,
        1.16,
        1.05,
        "CT robust\nreach-avoid set\n" r"$\mathcal{RA}_k^j(\mathcal{S}_{k+1}^{i+1}, \mathbb{G})$",
    )
    for source, shift in ((constraints, 0.25), (inputs, 0.0), (bounds, -0.25)):
        end = game.side("left", shift)
        middle = 2.02 if source is bounds else 1.9
        board.arrow(source.side("right"), (middle, source.y), (middle, end[1]), end)
    board.arrow(game.side("right"), reach.side("left"))
    recursion = board.box(3.85, 0.40, 3.1, 0.66, "")
    board.text(3.85, 0.58, "Recursion (Theorem 2, Sec. 4.2)")
    formula = (
        r"$\mathcal{S}_k^i = \mathcal{S}_k^{i+1} \cup \bigcup_j \mathcal{RA}_k^j(\mathcal{S}_{k+1}^{i+1}, \mathbb{G})$"
    )
    board.text(3.85, 0.31, formula)
    board.arrow(reach.side("bottom"), (reach.x, 0.73))
    board.arrow((game.x, 0.73), game.side("bottom"))
    board.text(3.03, 0.87, r"$\mathcal{S}_k^i$ is the next goal", ha="left", fontsize=7.5)
    _draw_stack(board, 6.2, 1.85)
    board.arrow(reach.side("right"), (5.55, 1.85))
    board.arrow(recursion.side("right"), (6.2, 0.40), (6.2, 1.22))
    board.text(6.2, 2.66, "Look-up table (Fig. 8)", fontweight="bold")


def _draw_stack(board: Board, x: float, y: float) -> None:
    """The triangular table as a small picture about (x, y)."""
    size, count = 0.2, 6
    left, top = x - count * size / 2, y + count * size / 2
    colours = step_colours(count)
    for row in range(count):
        for column in range(count - row):
            corner = (left + column * size + 0.015, top - (row + 1) * size + 0.015)
            cell = FancyBboxPatch(
                corner,
                size - 0.03,
                size - 0.03,
                boxstyle="square,pad=0",
                facecolor=colours[column],
                edgecolor=INK,
                linewidth=0.5,
                zorder=2,
            )
            board.ax.add_patch(cell)


def draw_online(figure: Figure) -> None:
    """What runs at each sampling time (Fig. 3). For a figure of 7 by 2.6 inches."""
    board = Board(figure)
    board.zone(0.12, 1.28, 5.42, 2.48, r"digital controller, once every $\delta$  (Sec. 4.3)")
    table = board.box(
        4.5, 1.85, 1.5, 0.7, "Look-up table\n" r"fewest steps to go:" "\n" r"$q^k \in \mathcal{S}_k^i$", STORED
    )
    viable = board.box(
        2.65,
        1.85,
        1.5,
        0.7,
        "Viable inputs\n" r"$\{u_j : q^k \in \mathcal{RA}_k^j(\mathcal{S}_{k+1}^{i+1}, \mathbb{G})\}$",
        ROBOT_SIDE,
        fontsize=7.2,
    )
    rule = board.box(0.92, 1.85, 1.25, 0.7, "Selection rule\nbest input $u^*$", ROBOT_SIDE)
    hold = board.box(0.92, 0.55, 1.25, 0.6, "Hold\n" r"$u(t) = u^*$ on $[t_k, t_{k+1})$", fontsize=7.2)
    plant = board.box(3.6, 0.55, 2.3, 0.6, "Robot and pursuer, continuous\n" r"$\dot q = f(q, u, v)$")
    sample = board.box(6.2, 1.2, 1.15, 0.6, "Sample\n" r"$q^k = q(t_k)$")
    board.arrow(table.side("left"), viable.side("right"))
    board.arrow(viable.side("left"), rule.side("right"))
    board.arrow(rule.side("bottom"), hold.side("top"))
    board.arrow(hold.side("right"), plant.side("left"))
    board.arrow(plant.side("right"), (6.2, 0.55), sample.side("bottom"))
    board.arrow(sample.side("top"), (6.2, 1.85), table.side("right"))
    board.text(2.0, 0.68, r"$u(t)$")
    board.text(5.1, 0.68, r"$q(t)$")
    board.text(5.65, 1.98, r"$q^k$")
    board.arrow((3.6, 1.16), plant.side("top"))
    board.text(3.68, 1.05, r"adversary $v = (v_p, v_d)$", ha="left")


def draw_game(figure: Figure) -> None:
    """Who acts on what (Fig. 5). For a figure of 7 by 2.6 inches."""
    board = Board(figure)
    board.zone(0.12, 1.72, 2.35, 2.5, "robot")
    board.zone(0.12, 0.1, 2.35, 1.6, "adversarial team")
    policy = board.box(1.25, 2.02, 1.7, 0.36, r"policy  $\pi$", ROBOT_SIDE)
    disturbance = board.box(1.25, 1.17, 1.7, 0.36, r"disturbance  $\gamma_d[u]$", ADVERSE, "//////")
    pursuer = board.box(1.25, 0.42, 1.7, 0.36, r"pursuer  $\gamma_p[u]$", ADVERSE, "//////")
    robot = board.box(3.85, 1.60, 1.7, 0.62, "Robot\n" r"$\dot q_r = f_r(q_r, u, v_d)$")
    chaser = board.box(3.85, 0.42, 1.7, 0.62, "Pursuer\n" r"$\dot q_p = v_p$")
    joint = board.box(6.08, 1.01, 1.45, 0.86, "Joint\nconfiguration\n" r"$q = (q_r, q_p)$", STORED)
    board.arrow(policy.side("right"), (2.72, 2.02), (2.72, 1.75), robot.side("left", 0.15))
    board.arrow(disturbance.side("right"), (2.72, 1.17), (2.72, 1.45), robot.side("left", -0.15))
    board.arrow(pursuer.side("right"), chaser.side("left"))
    board.arrow(robot.side("right"), (5.02, 1.60), (5.02, 1.2), joint.side("left", 0.19))
    board.arrow(chaser.side("right"), (5.02, 0.42), (5.02, 0.82), joint.side("left", -0.19))
    for x, y, text in (
        (2.55, 2.14, "$u$"),
        (2.55, 1.29, "$v_d$"),
        (2.65, 0.54, "$v_p$"),
        (4.86, 1.72, "$q_r$"),
        (4.86, 0.55, "$q_p$"),
    ):
        board.text(x, y, text)
    board.arrow((6.08, 1.44), (6.08, 2.32), (1.25, 2.32), policy.side("top"), dashed=True)
    board.text(4.4, 2.42, r"measured at $t_k$ only:  $u \equiv \pi[q^k]$ on $[t_k, t_{k+1})$", fontsize=7.5)
