"""Disturbances that enter nonlinearly and move several axes: their range is cut into pieces, so that hji converges."""

import naive_zonotopes
import numpy as np
import pytest

import sdhj
from sdhj.problem import interval as interval_module
from sdhj.problem.findings import ResolutionWarning

COURSES = np.pi / 4 * np.arange(8)
WAYS = np.vstack([np.zeros((1, 2)), 0.8 * np.stack([np.cos(COURSES), np.sin(COURSES)], axis=1)])
ERROR = 0.6  # rad


def turned(q, u, v):
    """A command in a direction that is off by v."""
    return np.stack([u[0] * np.cos(v[0]) - u[1] * np.sin(v[0]), u[0] * np.sin(v[0]) + u[1] * np.cos(v[0])])


def misled(nodes=61, *, velocity=turned, bounds=(ERROR,), ways=WAYS, **more):
    """A point on a torus between two posts, whose compass is wrong."""
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [nodes, nodes], periodic=[True, True]),
        sdhj.Dynamics(ways, velocity=velocity, bounds=bounds, **more),
        sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.5, p[:, 1]) - 0.25),
        [
            sdhj.UnsafeSet(
                (0, 1),
                lambda p, t: np.minimum(np.hypot(p[:, 0], p[:, 1] - 0.3), np.hypot(p[:, 0], p[:, 1] + 0.3)) - 0.15,
                name="posts",
            )
        ],
        0.1,
        10,
    )


def share(problem, method="hji"):
    return sdhj.solve(problem, method, progress=False, play=False).fraction(start=0, within=problem.steps)


def hull_of_arc(way, delta=0.1, corners=25):
    """A dense net of the hull of the ends of an interval, and its corners, up to a hundredth of a cell."""
    v = np.linspace(-ERROR, ERROR, corners)
    arc = delta * np.array([turned(None, way, [one]) for one in v])
    return np.unique(np.round((arc[:, None] + arc[None]) / 2, 9).reshape(-1, 2), axis=0)[::4], arc


def test_pieces_converge_to_brute_force():
    """What one box loses for ever comes back with the pieces, to the first order."""
    given = (-1.0, -1.0), (1.0, 1.0), (41, 41), (True, True)
    sets = [hull_of_arc(way) if way.any() else (np.zeros((1, 2)),) * 2 for way in WAYS]
    disks, target = [(0.0, 0.3, 0.15), (0.0, -0.3, 0.15)], lambda p: np.hypot(p[:, 0] - 0.5, p[:, 1]) - 0.25
    true = naive_zonotopes.shares_of(*given, sets, disks, target, 10)[-1]
    found = {pieces: share(misled(41, pieces=pieces)) for pieces in (1, 2, 4, 8, 32)}
    assert found[1] < 0.6 * true and found[32] == pytest.approx(true, rel=0.04)  # differences on 41 nodes lose 3.4 %
    for pieces in (2, 4, 8):
        assert found[32] - found[pieces] < 0.55 * (found[32] - found[pieces // 2])
    assert share(misled(41)) == found[8]


def test_eight_pieces_win_what_finer_grids_do_not():
    assert share(misled(121)) >= 0.33
    assert share(misled(121, pieces=1)) < 0.2


def test_boxes_of_pieces_equal_the_slow_twin(rng):
    """Each piece has the box of its own arc; the Hamiltonian is the most of theirs, and never below the true one."""
    problem, cut = misled(11), np.linspace(-ERROR, ERROR, 9)
    for j, way in enumerate(WAYS):
        field = problem.interval(0).velocities(j, (0, 1))
        assert field.coupled and field.drift.shape[:2] == (8, 2)
        for i in range(8):
            fine = np.array([turned(None, way, [v]) for v in np.linspace(cut[i], cut[i + 1], 501)])
            half = np.abs(field.gain[i]).sum(axis=1)
            low, high = (field.drift[i] + sign * half for sign in (-1.0, 1.0))
            assert (low.max(axis=(1, 2)) <= fine.min(axis=0) + 1e-9).all()
            assert (high.min(axis=(1, 2)) >= fine.max(axis=0) - 1e-9).all()
            np.testing.assert_allclose(low[:, 0, 0], fine.min(axis=0), atol=0.8 * 0.15)  # of sums of two intervals
        for p in rng.normal(size=(20, 2)):
            spread = np.abs(np.einsum("a,pad...->pd...", p, field.gain)).sum(axis=1)
            most = (np.einsum("a,pa...->p...", p, field.drift) + spread).max(axis=0)
            assert most.min() >= max(p @ turned(None, way, [v]) for v in np.linspace(-ERROR, ERROR, 101)) - 1e-9


def test_what_moves_one_axis_or_enters_linearly_is_one_piece():
    apart = lambda q, u, v: np.stack([u[0] + np.sin(v[0]), u[1] + np.sin(v[1])])  # noqa: E731
    line = lambda q, u, v: np.stack([u[0] + v[0], u[1] + 2 * v[0]])  # noqa: E731
    mixed = lambda q, u, v: np.stack([u[0] * np.cos(v[0]), u[1] * np.cos(v[0]) + np.sin(v[1])])  # noqa: E731
    assert misled(velocity=apart, bounds=[0.1, 0.1]).dynamics.cuts((0, 1)) == (1, 1)
    assert misled(velocity=line, bounds=[0.1]).dynamics.cuts((0, 1)) == (1,)
    assert misled(velocity=mixed, bounds=[0.1, 0.1], pieces=5).dynamics.cuts((0, 1)) == (5, 1)
    assert misled().dynamics.cuts((0,)) == (1,)
    one, many = (misled(21, velocity=apart, bounds=[0.1, 0.1], pieces=pieces) for pieces in (1, 8))
    assert one.digest == many.digest
    tables = [sdhj.solve(problem, progress=False, play=False) for problem in (one, many)]
    np.testing.assert_array_equal(*(table.values(start=0, within=10) for table in tables))


def test_pieces_are_kept_in_files_and_told_apart(tmp_path):
    table = sdhj.solve(misled(15, pieces=3), progress=False, play=False)
    table.save(tmp_path / "t.h5")
    loaded = sdhj.load(tmp_path / "t.h5")
    assert loaded.problem.dynamics.pieces == 3 and loaded.problem.digest == table.problem.digest
    assert misled(15).digest != table.problem.digest
    with pytest.raises(ValueError, match="pieces is 3 there and 8 here"):
        sdhj.load(tmp_path / "t.h5", problem=misled(15))
    again = sdhj.solve(loaded.problem, progress=False, play=False)
    np.testing.assert_array_equal(again.values(start=0), table.values(start=0))


def test_memory_is_stated_before(monkeypatch):
    asked = []
    monkeypatch.setattr(interval_module, "require", lambda many, what: asked.append((many, what)))
    misled(21).interval(0).velocities(1, (0, 1))
    assert asked == [(8 * 8 * 2 * 5 * 21 * 21, "velocities of 8 pieces of v")]


@pytest.mark.parametrize("pieces", [0, -1, 2.5, 1025, "8"])
def test_numbers_of_pieces_are_checked(pieces):
    with pytest.raises(ValueError, match="pieces"):
        sdhj.Dynamics(WAYS, velocity=turned, bounds=[ERROR], pieces=pieces)


def test_lax_keeps_the_box_and_says_so():
    with pytest.warns(ResolutionWarning, match='use method="hji"'):
        found = share(misled(41), "lax")
    assert found < 0.6 * share(misled(41))
