"""What a certified solve tells before it starts, and what is left when it is interrupted."""

import os
import signal
import threading

import numpy as np
import pytest
from naive_certified import SMALL
from room import room
from zoo import interval_problem, unicycle_problem

import sdhj
from sdhj.certified.general_proof import GeneralProof

CELLS = (12, 12, 16)


def test_cells_and_megabytes_are_said_first(capsys):
    sdhj.solve(interval_problem(), sdhj.Certified(cells=(80,)), progress=True, play=False)
    assert "80 cells, at most" in capsys.readouterr().err


def test_memory_is_stated_before_anything_is_made():
    for problem in (unicycle_problem(), sdhj.arm_case_study(**SMALL)):
        with room(10**7), pytest.raises(MemoryError, match="fewer cells"):
            sdhj.Certified(cells=(300,) * problem.grid.ndim).proof(problem)


def test_nbytes_are_those_of_every_array():
    table = sdhj.solve(interval_problem(), sdhj.Certified(cells=(80,)), progress=False, play=False)
    parts = [*vars(table).values(), *vars(table.proof).values()]
    arrays = [one.nbytes for one in parts if isinstance(one, np.ndarray)]
    assert len(arrays) > 8 and table.nbytes == sum(arrays)


@pytest.mark.slow
@pytest.mark.usefixtures("signals_are_heard")
@pytest.mark.parametrize("at", ["_mark_collisions", "add"])
def test_ctrl_c_leaves_nothing_half(monkeypatch, at):
    """While intervals are looked at in threads, and in the recursion: it ends at once, and a new solve is whole."""
    problem, method = unicycle_problem(), sdhj.Certified(cells=CELLS, parts=2)
    whole, calls, plain = sdhj.solve(problem, method, progress=False), [], getattr(GeneralProof, at)
    threads = threading.active_count()  # tqdm's own among them, once there was a bar

    def interrupted(self, *told):
        calls.append(at)
        if len(calls) == 1:
            os.kill(os.getpid(), signal.SIGINT)
        return plain(self, *told)

    monkeypatch.setattr(GeneralProof, at, interrupted)
    with pytest.raises(KeyboardInterrupt):
        sdhj.solve(problem, method, progress=False)
    assert len(calls) == 1 and threading.active_count() == threads
    again = sdhj.solve(problem, method, progress=False)
    assert np.array_equal(again.pool, whole.pool) and np.array_equal(again.index, whole.index)
