"""Fig. 3: Online, the controller measures the state every delta and looks up which inputs are viable."""

from common import Context, command_of
from diagrams import ROBOT_SIDE, STORED, Board
from matplotlib.figure import Figure


def draw(context: Context) -> Figure:
    board = Board(7.0, 2.6)
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
    return board.figure


if __name__ == "__main__":
    command_of(__file__)()
