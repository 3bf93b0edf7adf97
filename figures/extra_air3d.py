"""Of two aircraft the one that evades is safe in fewer states if it acts at sampling times only.

Mitchell, Bayen & Tomlin, *A time-dependent Hamilton-Jacobi formulation of reachable sets for continuous dynamic games*,
IEEE Transactions on Automatic Control 50(7), 2005, Sec. IV; `hj_reachability.systems.Air3d`. Nothing is to be reached:
the evader stays more than a disk's radius away from the pursuer until the horizon, or leaves the grid, from where
nobody catches it (on a wider grid nothing more is unsafe). It measures at the beginning of each interval and holds its
turn; the pursuer turns as it likes. The more intervals, the less is unsafe, down to the tube of continuous time.
"""

from collections.abc import Mapping

import numpy as np
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import FAINT, INK, UNSAFE_LOOKS
from sdhj.table.batches import Table

MAIN_JOB = False
SPEED, RADIUS, HORIZON = 5.0, 5.0, 2.8  # of both aircraft, m/s; of the disk, m; s
COARSE = (27, 21, 24)
NODES = (51, 40, 50)
LOWER, UPPER = (-6.0, -10.0, 0.0), (20.0, 10.0, 2 * np.pi)
PEER = 0.2714  # the share that hj_reachability 0.7 finds unsafe on these nodes, accuracy "very_high" (WENO5)
METHOD = sdhj.HJI(sdhj.Scheme(order=3, integrator="rk3"))  # as accurate: second order wears a thousandth off the tube
INTERVALS = (2, 4, 8, 16, 32, 64)
SHOWN = (2, 4, 32)
LINES = [
    {"edgecolor": colour, "linestyle": dashes, "linewidth": 1.2}
    for colour, dashes in (("#c44e00", "-"), ("#2a8c82", (0, (4, 1.5))), ("#0b3c5d", "-"))
]


def air3d(
    intervals: int = 32,
    nodes: tuple[int, int, int] = NODES,
    turns: tuple[float, ...] = (-1.0, 0.0, 1.0),
    lower: tuple[float, ...] = LOWER,
    upper: tuple[float, ...] = UPPER,
) -> sdhj.ReachAvoidProblem:
    """The pursuer seen from the evader: where it is ahead, to the left, and its heading, relative to the evader's.

    Parameters
    ----------
    intervals : int
        Into which the horizon is divided; the evader's turn is held over each.
    nodes : (int, int, int)
    turns : tuple of float
        The evader's rates of turn to choose from, rad/s; the pursuer has all of [-1, 1].
    lower, upper : (x, y, psi)
        The ends of the grid.
    """

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        x, y, psi = q.T
        closing = SPEED * np.cos(psi) - SPEED + u[0] * y, SPEED * np.sin(psi) - u[0] * x
        return np.stack([*closing, np.full(len(q), -u[0])], axis=1)

    periodic, names = (False, False, True), ("ahead $x$ (m)", "left $y$ (m)", r"heading $\psi$ (rad)")
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid(lower, upper, nodes, periodic, names, ends="safe"),
        dynamics=sdhj.Dynamics(np.array(turns)[:, None], drift, gain=[[0], [0], [1]], bounds=[1.0]),
        target=None,
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - RADIUS, name="unsafe")],
        delta=HORIZON / intervals,
        steps=intervals,
        name="air3d",
    )


def unsafe_share(table: Table) -> float:
    """Share of the grid's volume from which some pursuer comes within the disk; an end node stands for half a cell."""
    return 1 - table.fraction(start=0, within=table.steps)


def value(context: Context) -> list[float]:
    """The shares that are unsafe with 2 and with 8 intervals, on a coarse grid."""
    return [unsafe_share(sdhj.solve(air3d(number, COARSE), METHOD)) for number in (2, 8)]


def draw(context: Context) -> Figure:
    nodes = COARSE if context.coarse else NODES
    tables = {}
    for number in INTERVALS:
        context.say(f"two aircraft, {number} intervals")
        tables[number] = sdhj.solve(air3d(number, nodes), METHOD)
    figure = plotting.new_figure(7.2, 5.6)
    parts = figure.subplot_mosaic([["beside", "against"], ["shares", "shares"]], height_ratios=(1.5, 1))
    draw_slice(parts["beside"], tables, 0.0, r"side by side, $\psi = 0$")
    draw_slice(parts["against"], tables, np.pi, r"head-on, $\psi = \pi$")
    parts["beside"].legend(loc="upper right")
    draw_shares(parts["shares"], tables, PEER if nodes == NODES else None)
    return figure


def draw_slice(ax: Axes, tables: Mapping[int, Table], heading: float, title: str) -> None:
    """What is unsafe for some numbers of intervals, and the disk."""
    grid = tables[SHOWN[0]].grid
    where = plotting.plane(grid, (0.0, 0.0, heading), resolution=241)
    for number, looks in zip(SHOWN, LINES, strict=True):
        values = -where.of(grid, tables[number].values(start=0, within=number))
        plotting.draw_set(ax, where, values, {"facecolor": "none"} | looks, f"tube-{number}")
        ax.plot([], [], color=looks["edgecolor"], linestyle=looks["linestyle"], label=f"{number} intervals")
    disk = np.hypot(*where.points[:, :2].T) - RADIUS
    plotting.draw_set(ax, where, where.shaped(disk), UNSAFE_LOOKS, "disk", 1.0)
    plotting.frame_slice(ax, grid)
    ax.set(aspect="equal", title=title)


def draw_shares(ax: Axes, tables: Mapping[int, Table], peer: float | None) -> None:
    """The unsafe share against the number of intervals, above that of continuous time."""
    shares = [unsafe_share(table) for table in tables.values()]
    ax.semilogx(list(tables), shares, "o-", color="#0b3c5d", base=2, gid="shares")
    for number, share in zip(tables, shares, strict=True):
        ax.annotate(f"{share:.4f}", (number, share), (2, 5), textcoords="offset points", fontsize=8)
    if peer is not None:
        ax.axhline(peer, color=FAINT, linestyle="--", gid="peer")
        ax.annotate(f"continuous time: {peer}", (2, peer), (0, -11), textcoords="offset points", color=INK)
    ax.set_xticks(list(tables), [str(number) for number in tables])
    ax.minorticks_off()
    ax.set(xlabel=f"intervals in {HORIZON} s", ylabel="share unsafe")
    ax.margins(x=0.06, y=0.25)


if __name__ == "__main__":
    command_of(__file__)()
