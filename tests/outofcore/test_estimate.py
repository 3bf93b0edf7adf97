"""What a solve with a store will take, said before it begins."""

import dataclasses
import tempfile
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
import toys
from slabbed import room, rough_problem

import sdhj
from sdhj.outofcore import estimate, solve
from sdhj.solver.recursion import PROCESS

pytestmark = pytest.mark.filterwarnings("ignore::sdhj.solver.resolution.ResolutionWarning")
COST = {"static": 50.0, "moving": 7.0, "goal": 2.0, "extend": 11.0}  # s, by the clock of these tests


def moving_problem():
    """A disk that crosses, and a target that runs away: tubes of all steps differ."""
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [40, 15], ends="wall"),
        dynamics=sdhj.Dynamics([[1.0], [-1.0]], [[1.0, 0.0], [-1.0, 0.0]], np.eye(2), [0.1, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.2 * t, p[:, 1]) - 0.4),
        unsafe=[
            sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] + 0.6, p[:, 1] - t) - 0.3, name="disk"),
            sdhj.UnsafeSet((1,), lambda p, t: 0.9 - np.abs(p[:, 0]), name="walls"),
        ],
        delta=0.1,
        steps=4,
    )


@pytest.fixture
def clock(monkeypatch):
    """Time goes on while slabs are worked on, and only then; which tasks there were."""
    now, tasks, work = [0.0], Counter(), solve.work

    def charged(plan, task):
        now[0] += COST[task.kind]
        tasks[task.kind] += 1
        return work(plan, task)

    monkeypatch.setattr(solve, "work", charged)
    monkeypatch.setattr(solve, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    return tasks


@pytest.mark.parametrize(
    ("make", "width"),
    [(moving_problem, 40), (moving_problem, 12), (lambda: rough_problem(48, steps=3), 16)],
    ids=["one slab", "slabs", "nothing moves"],
)
def test_an_estimate_is_what_a_solve_takes(clock, make, width, tmp_path, monkeypatch):
    memory = room(problem := make(), width=width)
    table = sdhj.solve(problem, store=tmp_path / "table.zarr", memory=memory)
    assert table.details["tubes_shared"] == 0  # or it would be less
    seconds = sum(COST[kind] * number for kind, number in clock.items())
    assert sum(clock.values()) >= table.details["slabs"] * (table.steps + 1)

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    clock.clear()
    told = estimate(problem, memory=memory)
    assert (told.slabs, told.disk, told.seconds) == (table.details["slabs"], table.nbytes, pytest.approx(seconds))
    assert PROCESS < told.nbytes <= PROCESS + memory
    assert max(clock[kind] for kind in ("static", "moving", "extend")) == 2  # a slab each, twice
    assert list((tmp_path / "temporary").iterdir()) == []
    assert str(told).startswith(f"slabs: {told.slabs}, ")


def drifting(method, *, periodic):
    """A plan of a line of 240 nodes in slabs of 8, closed or with ends."""
    problem = sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([0.0, 0.0], [2.4 if periodic else 2.39, 1.0], [240, 15], [periodic, False], ends="wall"),
        dynamics=sdhj.Dynamics([[1.0]], [[0.3, 0.0]], np.eye(2), [0.1, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.2, p[:, 1] - 0.5) - 0.3),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.6, p[:, 1] - 0.5) - 0.2, name="disk")],
        delta=0.3,
        steps=2,
    )
    return solve.planned(problem, method, (0, 8))


@pytest.mark.parametrize("method", [sdhj.HJI(scheme=sdhj.Scheme(frame="fixed")), sdhj.HopfLax()], ids=["hji", "lax"])
def test_the_largest_slab_is_stated(method):
    """Where a grid ends the halo does too, but for the slabs in the middle."""
    ended, closed = drifting(method, periodic=False), drifting(method, periodic=True)
    assert ended.halo == closed.halo
    assert 8 < ended.halo < 100  # more than a slab, and no window is the grid
    assert solve.task_bytes(ended) == solve.task_bytes(closed)


def test_an_estimate_does_not_warn_of_what_comes_later(recwarn):
    """A disk that is not there in the first step is there for a solve."""
    problem = dataclasses.replace(
        moving_problem(),
        unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - t + 0.15, name="late")],
    )
    estimate(problem)
    assert [str(warning.message) for warning in recwarn if "danger" in str(warning.message)] == []


def test_an_estimate_refuses_what_a_solve_refuses():
    problem = toys.interval_problem(nodes=161)
    with pytest.raises(ValueError, match="a store does not take method 'projected'"):
        estimate(problem, sdhj.Projected(subspaces=[(0,)]))
    with pytest.raises(MemoryError, match="are allowed"):
        estimate(problem, memory=1)


def test_a_small_problem_asks_for_little():
    """What one slab keeps is no more than its arrays."""
    assert estimate(moving_problem()).nbytes < PROCESS + 2**27
