"""Fig. 5: The policy moves the robot; the adversary disturbs it and moves the pursuer."""

from common import Context, command_of
from diagrams import ADVERSE, ROBOT_SIDE, STORED, Board
from matplotlib.figure import Figure


def draw(context: Context) -> Figure:
    board = Board(7.0, 2.6)
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
    return board.figure


if __name__ == "__main__":
    command_of(__file__)()
