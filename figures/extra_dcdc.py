"""A voltage converter stays within its limits for ever by switching between two positions.

The boost converter of Girard, Pola & Tabuada, *Approximately bisimilar symbolic models for incrementally stable
switched systems*, IEEE Transactions on Automatic Control 55(1), 2010, as in SCOTS's example `dcdc`: the inductor's
current and five times the capacitor's voltage stay in a box, and the switch is set every half second. No target, no
disturbance, no number of steps: the ends of the grid are all there is to avoid. SCOTS and method "certified" both prove
their shares, cell by cell.
"""

from collections.abc import Callable

import numpy as np
from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import sdhj
from sdhj import plotting
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import INK
from sdhj.table.batches import Table

MAIN_JOB = False
DELTA = 0.5
LOWER, UPPER = (1.15, 5.45), (1.55, 5.85)
SCOTS = 0.924  # the share of the box that SCOTS finds, with states 2 / 4000 apart
CELLS, FEW = 800, 100  # on each axis: SCOTS's own, and some that take a tenth of a second
SHOWN_STEPS = 40
MODES = {
    "open": "#cfe3f3",
    "closed": "#f2c14e",
    "either way": "#2a8c82",
}  # which positions of the switch keep what is promised


def circuit() -> tuple[FloatArray, FloatArray]:
    """A (2, 2, 2) and b (2,) of dq/dt = A[mode] q + b: the switch is closed in mode 0, open in mode 1."""
    xc, xl, rc, rl, ro, vs = 70.0, 3.0, 0.005, 0.05, 1.0, 1.0  # per unit
    divided = ro / (ro + rc)
    closed = [[-rl / xl, 0.0], [0.0, -1 / (xc * (ro + rc))]]
    opened = [[-(rl + rc * divided) / xl, -divided / xl / 5], [5 * divided / xc, -1 / (xc * (ro + rc))]]
    return np.array([closed, opened]), np.array([vs / xl, 0.0])


def dcdc() -> sdhj.ReachAvoidProblem:
    """The converter, for ever."""
    a, b = circuit()
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid(
            LOWER, UPPER, (401, 401), names=["current $x_1$ (per unit)", "5 times the voltage $x_2$ (per unit)"]
        ),
        dynamics=sdhj.Dynamics([[0.0], [1.0]], lambda q, u: q @ a[int(u[0])].T + b, np.zeros((2, 1)), [0.0]),
        target=None,
        unsafe=[],
        delta=DELTA,
        steps=None,
        name="dcdc",
    )


def converter(cells: int) -> Table:
    """The states from which it is proved to stay within its limits, on cells x cells."""
    return sdhj.solve(dcdc(), sdhj.Certified(cells=(cells, cells)))


def moved(mode: int) -> tuple[FloatArray, FloatArray]:
    """E (2, 2) and e (2,) of the exact map q -> E q + e of an interval in a mode: the Taylor series of exp(delta A)."""
    a, b = circuit()
    powers, whole = np.eye(3), np.zeros((3, 3))
    generator = DELTA * np.block([[a[mode], b[:, None]], [np.zeros((1, 3))]])
    for k in range(1, 20):
        whole, powers = whole + powers, powers @ generator / k
    return whole[:2, :2], whole[:2, 2]


def run(choose: Callable[[FloatArray], int], start: FloatArray, steps: int) -> FloatArray:
    """States (steps + 1, 2) at the sampling times, without an error of integration."""
    maps, states = [moved(mode) for mode in (0, 1)], [np.asarray(start)]
    for _ in range(steps):
        whole, constant = maps[choose(states[-1])]
        states.append(whole @ states[-1] + constant)
    return np.array(states)


def value(context: Context) -> float:
    """The share of the box in which the converter is proved to stay, on few cells."""
    return converter(FEW).fraction()


def draw(context: Context) -> Figure:
    context.say("a voltage converter")
    table = converter(FEW if context.coarse else CELLS)
    figure = plotting.new_figure(4.6, 4.4)
    ax = figure.subplots()
    share = draw_modes(ax, table)
    controller = sdhj.Controller(table)
    states = run(lambda q: controller.select(q, 0), np.array([1.2, 5.8]), SHOWN_STEPS)
    plotting.draw_path(ax, table.grid, states, marks=states)
    cells = FEW if context.coarse else CELLS
    ax.set(title=f"{share:.1%} of the box, on {cells} x {cells} cells (SCOTS: {SCOTS:.1%})", aspect="equal")
    entries = [Patch(facecolor=c, edgecolor=INK, linewidth=0.6, label=f"switch {how}") for how, c in MODES.items()]
    figure.legend(handles=entries, loc="outside lower center", ncols=3)
    return figure


def draw_modes(ax: Axes, table: Table) -> float:
    """Which positions of the switch keep the converter within its limits from each node; returns the share."""
    inside = table.values(start=0, within=1).T <= 0
    closed, opened = np.moveaxis(table.inputs(start=0, within=1), 2, 0).swapaxes(1, 2)
    which = np.select([~inside, closed & opened, closed, opened], [np.nan, 2.0, 1.0, 0.0], np.nan)
    nodes = [table.grid.nodes(axis) for axis in (0, 1)]
    colours = ListedColormap(list(MODES.values()))
    ax.pcolormesh(*nodes, which, cmap=colours, vmin=-0.5, vmax=2.5, shading="nearest", rasterized=True, gid="modes")
    plotting.frame_slice(ax, table.grid)
    return table.fraction(start=0, within=1)


if __name__ == "__main__":
    command_of(__file__)()
