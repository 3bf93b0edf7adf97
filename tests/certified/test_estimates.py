"""What a certified solve tells before it starts, and what is left when it is interrupted."""

import os
import signal
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from naive_certified import SMALL
from toys import interval_problem, unicycle_problem

import sdhj
from sdhj.certified import sets
from sdhj.certified.arm.proof import ArmProof
from sdhj.certified.general_proof import GeneralProof
from sdhj.common import memory as memory_module

CELLS = (12, 12, 16)


def arm():
    return sdhj.arm_case_study(**SMALL)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "kind", "cells"),
    [
        (unicycle_problem, GeneralProof, (60, 60, 63)),
        (arm, ArmProof, (32, 32, 12, 12)),
        (arm, ArmProof, (60, 60, 36, 36)),
    ],
)
def test_time_is_measured_from_a_solve_with_fewer_cells(monkeypatch, problem, kind, cells):
    """By a clock that says: a second for each thousand cells, to prepare, of the arm for each thousand rows of cells of
    the pursuer; and three for each thousand cells in the recursion.
    """
    problem, now, asked = problem(), [0.0], []
    monkeypatch.setattr(sets, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    monkeypatch.setattr(sets, "cost", lambda problem, axes, *_: (count_of(axes), 2 * count_of(axes)))
    plain, plainly = kind.prepare, sets.recursion

    def count_of(axes):
        return float(np.prod([axis.count for axis in axes]))

    def rows_of(axes):
        return count_of(axes[:3] if kind is ArmProof else axes)

    def prepare(self, progress):
        asked.append(count_of(self.axes))
        now[0] += rows_of(self.axes) / 1000
        return plain(self, progress)

    def recursion(some, steps, done):
        now[0] += 3 * count_of(some.proof.axes) / 1000
        plainly(some, steps, done)

    monkeypatch.setattr(kind, "prepare", prepare)
    monkeypatch.setattr(sets, "recursion", recursion)
    method = sdhj.Certified(cells=cells, parts=4)
    told = method.estimate(problem)
    assert told.seconds == pytest.approx((rows_of(method.axes(problem)) + 3 * told.cells) / 1000)
    assert asked[0] <= asked[1] / 4 and (asked[1] < told.cells / 2 or told.cells < 200_000)  # few are all timed
    assert f"{told.cells:.1e} cells" in str(told)
    monkeypatch.undo()
    if told.cells > 200_000:
        return
    table = sdhj.solve(problem, method, progress=False, play=False)
    assert told.cells == np.prod(table.details["cells"]) and told.nbytes > table.nbytes


def test_memory_is_stated_before_anything_is_made(monkeypatch):
    monkeypatch.setattr(memory_module, "available", lambda: (10**7, "are left"))
    for problem in (unicycle_problem(), sdhj.arm_case_study(**SMALL)):
        with pytest.raises(MemoryError, match="use fewer cells"):
            sdhj.Certified(cells=(300,) * problem.grid.ndim).estimate(problem)


def test_nbytes_are_those_of_every_array():
    table = sdhj.solve(interval_problem(), sdhj.Certified(cells=(80,)), progress=False, play=False)
    parts = [*vars(table).values(), *vars(table.proof).values()]
    arrays = [one.nbytes for one in parts if isinstance(one, np.ndarray)]
    assert len(arrays) > 8 and table.nbytes == sum(arrays)


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
