"""Two aircraft: what sampling costs the one that evades, beside the collision tube of continuous time.

Mitchell, Bayen & Tomlin, *A time-dependent Hamilton-Jacobi formulation of reachable sets for continuous dynamic games*,
IEEE Transactions on Automatic Control 50(7), 2005, Sec. IV; `hj_reachability.systems.Air3d`. Nothing is to be reached:
the evader stays more than a disk's radius away from the pursuer until the horizon, or leaves the grid, from where
nobody catches it (on a wider grid nothing more is unsafe). It measures at the beginning of each interval and holds its
turn; the pursuer turns as it likes. The more intervals, the less is unsafe, down to the tube of continuous time.
"""

import numpy as np
from common import Context, command_of
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.grid import FloatArray
from sdhj.plotting.looks import FAINT, INK, UNSAFE_LOOKS
from sdhj.table import Table

STUDY = True
SPEED, RADIUS, HORIZON = 5.0, 5.0, 2.8  # of both aircraft; of the disk; s
NODES = (51, 40, 50)
LOWER, UPPER = (-6.0, -10.0, 0.0), (20.0, 10.0, 2 * np.pi)
PEER = 0.2714  # the share that hj_reachability 0.7 finds unsafe on these nodes, accuracy "very_high" (WENO5)
INTERVALS = (1, 2, 4, 8, 16, 32, 64)
SHOWN = (1, 2, 32)
SHOWN_AT = (0.0, 0.0, np.pi)  # head-on


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

    periodic, names = (False, False, True), ("ahead $x$", "left $y$", r"heading $\psi$ (rad)")
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


def draw(context: Context) -> Figure:
    nodes = (27, 21, 24) if context.coarse else NODES
    figure, tables = plotting.new_figure(7.2, 3.3), {}
    for number in INTERVALS:
        context.say(f"two aircraft, {number} intervals")
        tables[number] = sdhj.solve(air3d(number, nodes))
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1))
    grid = tables[1].grid
    where = plotting.plane(grid, SHOWN_AT, resolution=241)
    for number, colour, dashes in zip(SHOWN, ("#c44e00", "#2a8c82", "#0b3c5d"), ("-", (0, (4, 1.5)), "-"), strict=True):
        values = -where.of(grid, tables[number].values(start=0, within=number))
        looks = {"facecolor": "none", "edgecolor": colour, "linewidth": 1.2, "linestyle": dashes}
        plotting.draw_set(left, where, values, looks, f"tube-{number}")
        left.plot([], [], color=colour, linestyle=dashes, label=f"{number} interval" + "s" * (number > 1))
    disk = np.hypot(*where.points[:, :2].T) - RADIUS
    plotting.draw_set(left, where, where.shaped(disk), UNSAFE_LOOKS, "disk", 1.0)
    plotting.frame_slice(left, grid)
    left.set(aspect="equal", title=r"unsafe where the headings are opposite, $\psi = \pi$")
    left.legend(loc="lower right")
    shares = [unsafe_share(table) for table in tables.values()]
    right.semilogx(INTERVALS, shares, "o-", color="#0b3c5d", base=2, gid="shares")
    for at in (0, INTERVALS.index(32)):
        place = {"textcoords": "offset points", "xytext": (4, 5), "fontsize": 8}
        right.annotate(f"{shares[at]:.4f}", (INTERVALS[at], shares[at]), **place)
    if nodes == NODES:
        right.axhline(PEER, color=FAINT, linestyle="--", gid="peer")
        right.annotate(f"continuous time: {PEER}", (1, PEER), (0, -11), textcoords="offset points", color=INK)
    right.set_xticks(INTERVALS, [str(number) for number in INTERVALS])
    right.minorticks_off()
    right.set(xlabel=f"intervals in {HORIZON} s", ylabel="share of the grid unsafe")
    right.margins(y=0.12)
    return figure


if __name__ == "__main__":
    command_of(__file__)()
