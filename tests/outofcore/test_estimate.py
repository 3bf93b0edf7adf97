"""What a solve with a store will take, said before it begins."""

import tempfile
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
import toys
from slabbed import room, rough_problem

import sdhj
from sdhj.outofcore import estimate, solve
from sdhj.recursion import PROCESS

pytestmark = pytest.mark.filterwarnings("ignore::sdhj.resolution.ResolutionWarning")
COST = {"static": 50.0, "moving": 7.0, "goal": 2.0, "extend": 11.0}  # s, by the clock of these tests


def moving_problem():
    """A disk that crosses, and a target that runs away: tubes of all steps differ."""
    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [40, 15], ends="wall"),
        dynamics=sdhj.Dynamics([[1.0], [-1.0]], [[1.0, 0.0], [-1.0, 0.0]], np.eye(2), [0.1, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.2 * t, p[:, 1]) - 0.4),
        unsafe=[
            sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] + 0.6, p[:, 1] - t) - 0.3, rate=1.0, name="disk"),
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


def test_an_estimate_refuses_what_a_solve_refuses():
    problem = toys.interval_problem(nodes=161)
    with pytest.raises(ValueError, match="a store does not take method 'projected'"):
        estimate(problem, sdhj.Projected(subspaces=[(0,)]))
    with pytest.raises(MemoryError, match="are allowed"):
        estimate(problem, memory=1)
