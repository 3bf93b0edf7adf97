"""Fig. 2: Offline, a game is solved for each interval and input, and a recursion fills the look-up table."""

from common import Context, command_of
from diagrams import ADVERSE, ROBOT_SIDE, Board
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from sdhj import plotting
from sdhj.plotting.looks import INK


def draw(context: Context) -> Figure:
    board = Board(7.0, 3.0)
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
    united = r"\mathcal{S}_k^{i+1} \cup \bigcup_j \; \mathcal{RA}_k^j(\mathcal{S}_{k+1}^{i+1}, \mathbb{G})"
    board.text(3.85, 0.31, rf"$\mathcal{{S}}_k^i = {united}$")
    board.arrow(reach.side("bottom"), (reach.x, 0.73))
    board.arrow((game.x, 0.73), game.side("bottom"))
    board.text(3.03, 0.87, r"$\mathcal{S}_k^i$ is the next goal", ha="left", fontsize=7.5)
    draw_stack(board, 6.2, 1.85)
    row, bottom = (5.6, 1.85), (5.7, 1.25)  # the left side of the table's middle row, the foot of its first column
    board.arrow(reach.side("right"), row)
    board.arrow(recursion.side("right"), (bottom[0], 0.40), bottom)
    board.text(5.78, 0.80, r"new sets $\mathcal{S}_k^i$", ha="left", fontsize=7.5)
    board.text(5.375, 1.97, "stored", fontsize=7.5)
    board.text(6.2, 2.66, "Look-up table (Fig. 8)", fontweight="bold")
    return board.figure


def draw_stack(board: Board, x: float, y: float) -> None:
    """The triangular table as a small picture about (x, y)."""
    size, count = 0.2, 6
    left, top = x - count * size / 2, y + count * size / 2
    colours = plotting.step_colours(count)
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


if __name__ == "__main__":
    command_of(__file__)()
