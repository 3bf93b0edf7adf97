"""What the checker reads of a robot: robots of all kinds are proved, forged heads refused with a sentence."""

import shutil

import h5py
import numpy as np
import pytest
from forging import FORGERIES, forged

import sdhj
from sdhj.certified.check import verify

WIND = sdhj.gridded(np.eye(5) * 0.2, [-2.0, -2.0], [1.0, 1.0])
AWAY = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.0, p[:, 1]) - 0.5)


def plane(radius=0.3, **dynamics):
    """A robot in the plane, beside which a disk passes."""
    post = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] - 1.2 + 0.4 * t) - radius, name="post")
    inputs = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
    given = {"drift": np.array(inputs), "gain": np.eye(2), "bounds": [0.1, 0.1]} | dynamics
    grid = sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [21, 21])
    return sdhj.ReachAvoidProblem(grid, sdhj.Dynamics(inputs, **given), AWAY, [post], 0.25, 3)


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
    "bounds that depend on time": {"bounds": lambda u, t: np.stack([0.1 + 0.05 * np.sin(t), 0.1])},
    "a wind from a table": {"drift": lambda q, u: np.stack([u[0] + WIND(q), np.full(len(q), u[1])], axis=1)},
    "a black box": {
        "drift": sdhj.BlackBox(
            lambda q, u, t: np.stack([u[0] + 0.1 * np.sin(q[:, 1]), 0.0 * q[:, 0] + u[1]], axis=1),
            slope=[[0.0, 0.1], [0.0, 0.0]],
            rate=0.0,
        )
    },
}


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_of_all_kinds_are_proved(name, tmp_path):
    problem = plane(**ROBOTS[name])
    path = saved(problem, tmp_path / "plane.h5")
    verdict = verify(path, problem if problem.opaque else None, samples=1500, progress=False)
    assert verdict.ok, str(verdict)
    assert ("rests on what is stated of drift" in str(verdict)) == (name == "a black box")


@pytest.mark.parametrize("share", [1.0, 1.5])
def test_an_adversary_that_does_not_enter_linearly(share, tmp_path):
    """u + v again, v written as |v + 1| - 1, so that only its range over the box tells what it does."""
    path = saved(plane(), tmp_path / "plane.h5")
    lines = ["p 1", "p 2", "const 0x1p+0", f"const {share.hex()}"]
    for v in (0, 1):
        n = len(lines)
        lines += [f"add {v} 2", f"abs {n}", f"sub {n + 1} 2", f"mul {n + 2} 3"]
    lines += ["const -0x1p+0", "const 0x0p+0"]  # numbers 12 and 13
    pairs = [(u, v) for along in ((2, 13), (12, 13), (13, 2), (13, 12)) for u, v in zip(along, (7, 11), strict=True)]
    results = range(len(lines), len(lines) + len(pairs))
    lines += [*(f"add {u} {v}" for u, v in pairs), " ".join(["return", *map(str, results)])]
    with forged(path) as (told, _):
        functions = told["formulas"]["functions"]
        del functions["drift"], functions["gain"]
        functions["velocity"] = {"coordinates": 2, "parameters": 3, "lines": lines}
    verdict = verify(path, samples=500, progress=False)
    assert verdict.ok == (share == 1.0), str(verdict)


DISK = [
    "x 0",
    "x 1",
    "p 0",
    f"const {(0.4).hex()}",
    "mul 2 3",
    f"const {(1.2).hex()}",
    "sub 1 5",
    "add 6 4",
    "hypot 0 7",
]
DISK += [f"const {(0.3).hex()}", "sub 8 9"]


def test_what_sweeps_a_set_is_used_and_named(tmp_path):
    """A formula that is never above the disk from t0 to t1; the disk's own is written so that intervals are wide."""
    path = saved(plane(radius=0.4), tmp_path / "plane.h5")
    with forged(path) as (told, _):
        functions = told["formulas"]["functions"]
        wide = [*DISK, "const 0x1p+12", "mul 2 11", "add 10 12", "sub 13 12", "return 14"]
        functions["unsafe 0"]["lines"] = wide
    assert not verify(path, samples=500, progress=False).ok
    with forged(path) as (told, _):
        slower = [*DISK, "p 1", "sub 11 2", "mul 12 3", "sub 10 13", "return 14"]
        told["formulas"]["functions"]["swept 0"] = {"coordinates": 2, "parameters": 2, "lines": slower}
    verdict = verify(path, samples=500, progress=False)
    assert verdict.ok and "rests on what is stated of the sweep of post" in str(verdict), str(verdict)


@pytest.fixture(scope="module")
def windy(tmp_path_factory):
    """A file with a table."""
    problem = plane(**ROBOTS["a wind from a table"])
    return saved(problem, tmp_path_factory.mktemp("windy") / "plane.h5", (30, 30))


def lines(told, name):
    return told["formulas"]["functions"][name]["lines"]


FORGED = {
    "a function less": (lambda told: told["formulas"]["functions"].pop("gain"), "there must be a formula gain"),
    "no bounds": (lambda told: told["formulas"]["functions"].pop("bounds"), "there must be a formula bounds"),
    "another format": (lambda told: told["formulas"].update(format=2), "formulas must be of format 1"),
    "a line": (lambda told: lines(told, "drift").insert(0, "halt 0"), "line 0 of drift: an operation must be one"),
    "results": (lambda told: lines(told, "drift").__setitem__(-1, "return 0"), "drift must have 8 results"),
    "two results": (lambda told: lines(told, "target").__setitem__(-1, "return 0 0"), "target must have one result"),
    "coordinates": (lambda told: told["formulas"]["functions"]["gain"].update(coordinates=3), "gain must have 2 coord"),
    "both": (lambda told: told["formulas"].update(opaque={"drift": ""}), "black boxes, whose functions are not"),
    "axes": (lambda told: told["sets"][1].update(axes=[0, 2]), "axes of a set"),
    "axes twice": (lambda told: told["sets"][1].update(axes=[0, 0]), "axes of a set"),
    "kinds": (lambda told: told["sets"].reverse(), "sets must be a target, if there is one, and unsafe sets"),
    "ends": (lambda told: told["grid"].update(ends=[["open", "wall"]] * 2), "ends must be of safe, unsafe, wall"),
    "order": (lambda told: told["grid"].update(upper=[-3.0, 2.0]), "lower ends must be below"),
    "seven axes": (lambda told: told["grid"].update(lower=[0.0] * 7), "a grid must have 1 to 6 axes"),
    "no number": (lambda told: told["grid"].update(lower=["0", 0.0]), "lower must be a number"),
    "infinite": (lambda told: told.update(delta=float("inf")), "delta must be a number"),
    "NaN": (lambda told: told.update(delta=float("nan")), "delta must be a number"),
    "jitter": (lambda told: told.update(sensing={"jitter": 0.2}), "jitter must be a number from 0 to 0.125"),
    "delay": (lambda told: told.update(sensing={"delay": -1}), "delay must be a number"),
    "error": (lambda told: told.update(sensing={"error": [0.1]}), "error must be 2 numbers"),
    "no inputs": (lambda told: told.update(inputs=[]), "there must be 1 to"),
    "steps": (lambda told: told.update(steps=2.5), "steps must be a number"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_head_is_refused(name, windy, tmp_path):
    path, (forge, what) = shutil.copy(windy, tmp_path / "forged.h5"), FORGED[name]
    with forged(path) as (told, _):
        forge(told)
    with pytest.raises(ValueError, match=what):
        verify(path, progress=False)


@pytest.mark.parametrize("forgery", FORGERIES)
def test_a_forged_table_is_refused(forgery, windy, tmp_path):
    path = shutil.copy(windy, tmp_path / "forged.h5")
    with forged(path) as (_, arrays):
        old = arrays["tables/0"][()]
        del arrays["tables/0"]
        FORGERIES[forgery](arrays, "tables/0", old)
    if forgery in ("too short", "too long"):  # a table of another robot
        verify(path, samples=10, progress=False)
        return
    with pytest.raises(ValueError, match=r"make no sense"):
        verify(path, progress=False)


def test_tables_of_another_file_are_refused(windy, tmp_path):
    path = shutil.copy(windy, tmp_path / "forged.h5")
    with forged(path) as (_, arrays):
        del arrays["tables"]
        arrays["tables"] = h5py.ExternalLink("other.h5", "tables")
    with pytest.raises(ValueError, match="tables must be in the file itself"):
        verify(path, progress=False)
