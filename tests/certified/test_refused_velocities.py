"""Velocities of which nothing can be proved: the error names where they are, and its advice has been followed."""

import numpy as np
import pytest

import sdhj


def line(velocity, *, periodic=False, upper=4.0):
    """x on a line or a ring, a goal near its end, and one input that stands still beside one that moves."""
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([0.0], [upper], [41], [periodic], ["x"]),
        sdhj.Dynamics([[0.0], [1.0]], velocity, [[1.0]], [0.1]),
        sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - upper + 0.5) - 0.3),
        [],
        0.25,
        3,
    )


CELLS = sdhj.Certified(cells=[400], parts=40)


@pytest.mark.parametrize(
    ("velocity", "says", "limited"),
    [
        (
            lambda q, u: 0.02 * u[0] / (q - 0.513),
            r"velocity along x under input 0 may be undefined or unbounded between \[0.51\] and \[0.52\], .*np.maximum",
            lambda q, u: 0.02 * u[0] / np.maximum(q - 0.513, 0.01),
        ),
        (
            lambda q, u: u[0] * (q / 1.5) ** 9,
            r"velocity under input 1 grows too fast between \[2.\d+\] and \[\d.*limit it, for example by np.minimum",
            lambda q, u: u[0] * np.minimum((q / 1.5) ** 9, 2.0),
        ),
    ],
)
@pytest.mark.slow
def test_where_nothing_can_be_proved_is_named_and_the_advice_helps(velocity, says, limited):
    with pytest.raises(ValueError, match=says):
        sdhj.solve(line(velocity), CELLS, play=False)
    # the goal's share is 0.6 / 4, less its boundary
    assert sdhj.solve(line(limited), CELLS, play=False).fraction() > 0.075


@pytest.mark.parametrize("speed", [1e10, 1e17, 1e18, 1e19, 1e20, 1e100, 1e300])
def test_an_image_of_more_cells_than_there_are_integers_is_refused(speed):
    """On a ring, where every place is on the grid: an image that wraps around an integer would seem to be at home."""
    problem = line(lambda q, u: speed * u[0] * (2.0 + np.sin(2.0 * np.pi * q)), periodic=True, upper=1.0)
    with pytest.raises(ValueError, match="moves the state by more than 32,767 cells"):
        sdhj.solve(problem, sdhj.Certified(cells=[40]), play=False)
