"""What the checker reads of a robot: robots of all kinds are proved, forged tables of numbers refused."""

from contextlib import nullcontext

import numpy as np
import pytest
import zoo
from forged_robots import WIND, file_of, plane
from forging import FORGERIES, forged, replaced

import sdhj
from sdhj.certified.check import verify
from sdhj.certified.check.stated import BlackBox


def saved(problem, path, cells=(60, 60)):
    table = sdhj.solve(problem, sdhj.Certified(cells=cells, parts=3), progress=False)
    assert table.fraction(start=0, within=3) > table.fraction(start=0, within=0) > 0
    table.save(path)
    return path


def flow(q, u, v, t):
    along = u[0] + v[0] * (1.0 + 0.5 * v[1]) * np.cos(t)
    return np.stack([np.full(len(q), along), u[1] + 0.1 * np.abs(v[1]) * (q[:, 0] + 0.3)], axis=1)


ROBOTS = {
    "a disk that passes": {},
    "not linear in the adversary": {"drift": None, "gain": None, "velocity": flow},
    "bounds that depend on time": {"bounds": lambda q, u, t: np.stack([0.1 + 0.05 * np.sin(t), 0.1])},
    "a wind from a table": {"drift": lambda q, u: np.stack([u[0] + WIND(q), np.full(len(q), u[1])], axis=1)},
    "a black box": {
        "drift": sdhj.BlackBox(
            lambda q, u, t: np.stack([u[0] + 0.1 * np.sin(q[:, 1]), 0.0 * q[:, 0] + u[1]], axis=1),
            slope=[[0.0, 0.1], [0.0, 0.0]],
            rate=0.0,
        )
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_robots_of_all_kinds_are_proved(name, tmp_path):
    problem = plane(**ROBOTS[name])
    path = saved(problem, tmp_path / "plane.npz")
    verdict = verify(path, problem if problem.opaque else None, samples=400, progress=False)
    assert verdict.ok, str(verdict)
    assert ("is stated of drift" in str(verdict)) == (name == "a black box")


@pytest.mark.slow
@pytest.mark.parametrize("share", [1.0, 1.5])
def test_an_adversary_that_does_not_enter_linearly(share, tmp_path):
    """u + v again, v written as |v + 1| - 1, so that only its range over the box tells what it does."""
    path = saved(plane(), tmp_path / "plane.npz")
    lines = ["p 1", "p 2", "const 0x1p+0", f"const {share.hex()}"]
    for v in (0, 1):
        n = len(lines)
        lines += [f"add {v} 2", f"abs {n}", f"sub {n + 1} 2", f"mul {n + 2} 3"]
    lines += ["const -0x1p+0", "const 0x0p+0"]  # numbers 12 and 13
    pairs = [(u, v) for along in ((2, 13), (12, 13), (13, 2), (13, 12)) for u, v in zip(along, (7, 11), strict=True)]
    results = range(len(lines), len(lines) + len(pairs))
    lines += [*(f"add {u} {v}" for u, v in pairs), " ".join(["return", *map(str, results)])]
    with forged(path, named=True) as (told, _):
        functions = told["formulas"]["functions"]
        del functions["drift"], functions["gain"]
        functions["velocity"] = {"coordinates": 2, "parameters": 3, "lines": lines}
    verdict = verify(path, samples=200, progress=False)
    assert verdict.ok == (share == 1.0), str(verdict)


@pytest.mark.parametrize("forgery", [name for name in FORGERIES if name != "too short"])
def test_a_forged_table_is_refused(forgery, tmp_path):
    (path := tmp_path / "forged.npz").write_bytes(file_of("windy"))
    with forged(path, named=True) as parts:
        replaced("tables/0", FORGERIES[forgery])(*parts)
    if forgery == "too long":  # a table of another robot
        verify(path, samples=10, progress=False)
        return
    with pytest.raises(ValueError, match=r"make no sense"):
        verify(path, progress=False)


@pytest.mark.parametrize("push", [5.0, 9.0, 40.0])
def test_a_strong_push_is_widened_by_its_own_roundings(push, tmp_path):
    """Moves that are right to the last cell are proved, however far an interval pushes: the product rounds once."""
    problem = zoo.cart(
        grid=sdhj.Grid([-1, -1], [1, 1], [11, 11]),
        dynamics=sdhj.Dynamics(
            [[0.0]], lambda q, u: np.stack([q[:, 1] + u[0], 0 * q[:, 1]], 1), [[0.0], [1.0]], [push]
        ),
        target=zoo.goal(0.0, 0.5),
        delta=0.3,
        steps=1,
    )
    sdhj.solve(problem, sdhj.Certified(cells=(10, 10)), progress=False, play=False).save(tmp_path / "pushed.npz")
    assert (verdict := verify(tmp_path / "pushed.npz", progress=False)).ok, str(verdict)


@pytest.mark.parametrize("when", [0.0, 1.0, None])
def test_what_is_stated_of_a_black_box_is_tried_at_either_end_of_the_times(when):
    """A wall that is half a metre nearer at one instant, of which its author says that it hardly moves."""
    wall = sdhj.BlackBox(lambda p, t: p[:, 0] - (0.5 if t == when else 0.0), slope=1.0, rate=0.1)
    low, high = np.zeros((3, 1)), np.full((3, 1), 0.2)
    with pytest.raises(ValueError, match="wall") if when is not None else nullcontext():
        least, most = BlackBox("wall", wall, 1, 1).bounds(low, high, (0.0, 1.0))
        assert (least <= -0.05).all() and (most >= 0.25).all()
