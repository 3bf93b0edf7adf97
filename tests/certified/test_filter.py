"""A filter of one state and one command, which has a way of its own, against the filter of many."""

import numpy as np
import pytest
import zoo

import sdhj


@pytest.mark.slow
def test_one_command_is_answered_as_among_many():
    table = sdhj.solve(zoo.unicycle_problem(), sdhj.Certified(cells=(30, 30, 38)), progress=False, play=False)
    controller, rng = sdhj.Controller(table), np.random.default_rng(0)
    states = rng.uniform(-1.0, 1.0, (300, 3)) * [0.7, 0.7, np.pi]
    wanted = rng.choice(
        [-2.5, -2.0, -1.0, 0.1, 1.0, 2.0], (300, 1)
    )  # also exactly between two inputs, and equal to one
    many, kept = controller.filter(states, 0, wanted), 0
    for at, (state, command) in enumerate(zip(states, wanted, strict=True)):
        for given in (command, command.tolist()):
            one = controller.filter(state, 0, given)
            kept += bool(one.promised)
            for field, among in vars(many).items():
                assert np.array_equal(getattr(one, field), among[at])
    assert 50 < kept < 600
