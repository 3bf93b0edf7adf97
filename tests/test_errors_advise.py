"""What an error says that helps, helps: each piece of advice is followed once, and the error goes.

A row is a pattern of the message, the call that raises it, and what its advice makes of that call. Advice on files,
stores, robots' files and formulas is followed in their own tests; that of warnings in test_advice.
"""

import os
import re
import shutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from toys import interval_problem, unicycle_problem

import sdhj
from sdhj import Certified, Controller, Dynamics, TargetSet, UnsafeSet
from sdhj.cli import main

MOVES = [[-1.0], [0.0], [1.0]]


@cache
def line(**options):
    """A problem with one axis."""
    return interval_problem(**options)


@cache
def table(method="hji", **options):
    return sdhj.solve(line(**options), method, play=False, progress=False)


def solved(problem, method="hji", **options):
    return sdhj.solve(problem, method, play=False, progress=False, **options)


def with_target(level, **options):
    return replace(line(**options), target=TargetSet((0,), level))


def staying(level):
    return replace(line(), target=None, unsafe=(UnsafeSet((0,), level, name="all"),))


def turned():
    """A robot in the plane whose velocity depends on its heading."""
    return unicycle_problem()


def square(p, t):
    return np.abs(p[:, 0]) - 1.0


def far(p, t):
    return np.abs(p[:, 0]) * 1e40 - 1.0


def odd(candidates):
    return np.full(len(candidates.rows), np.nan)


def timed(p, t):
    return np.abs(p[:, 0] - 0.1 * t) - 1.0


BLACK = sdhj.BlackBox(lambda p, t: np.array([max(one, -one) for one in p[:, 0].tolist()]) - 1.0)
CASES = {
    "swallowed": (
        "the unsafe sets swallow the target; move it, or check the sign",
        lambda to: solved(
            replace(
                line(), unsafe=(UnsafeSet((0,), lambda p, t: 2.0 - np.abs(p[:, 0]) * 0 - p[:, 0] - 4.5, name="all"),)
            )
        ),
        lambda to: solved(replace(line(), unsafe=(UnsafeSet((0,), lambda p, t: p[:, 0] + 3.0, name="all"),))),
    ),
    "all unsafe": (
        r"every grid node is in an unsafe set: check the signs \(negative is inside\)",
        lambda to: solved(staying(lambda p, t: np.abs(p[:, 0]) - 5.0)),
        lambda to: solved(staying(lambda p, t: 5.0 - np.abs(p[:, 0]))),
    ),
    "a target between nodes: more nodes": (
        "falls between nodes, or its level-set function has the wrong sign .*; move or enlarge it, or use more nodes",
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.05) - 0.04)),
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.05) - 0.04, nodes=641, disturbance=0.01)),
    ),
    "a target between nodes: move it": (
        "move or enlarge it",
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.05) - 0.04)),
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.1) - 0.04)),
    ),
    "a level set that is too large": (
        "single precision supports at most .*; clip it",
        lambda to: solved(with_target(far)),
        lambda to: solved(with_target(lambda p, t: np.minimum(far(p, t), 10.0))),
    ),
    "nothing to do": (
        "nothing to stay clear of; give an unsafe set or an unsafe end",
        lambda to: replace(line(), target=None, unsafe=()),
        lambda to: (replace(line(), target=None), replace(line(ends="unsafe"), target=None, unsafe=())),
    ),
    "for ever, and in time": (
        "depend on time; give a number of steps",
        lambda to: replace(line(), target=TargetSet((0,), timed), steps=None),
        lambda to: replace(line(), target=TargetSet((0,), timed), steps=3),
    ),
    "lax and the state": (
        'needs velocities that do not depend on the state; use method="hji"',
        lambda to: solved(turned(), "lax"),
        lambda to: solved(turned(), "hji"),
    ),
    "projected on one axis": (
        'needs a grid of at least 2 axes, one to drop; use method="hji"',
        lambda to: solved(line(), "projected"),
        lambda to: solved(line(), "hji"),
    ),
    "resume without a store": (
        "apply to a store only; give one, for example store='table.zarr'",
        lambda to: solved(line(), resume=True),
        lambda to: solved(line(), resume=True, store=to / "table.zarr"),
    ),
    "no step where time matters": (
        r"the answer depends on time: give the step, for example select\(q, step=0\)",
        lambda to: Controller(table(view_time="swept", rate=0.1)).select([0.5]),
        lambda to: Controller(table(view_time="swept", rate=0.1)).select([0.5], step=0),
    ),
    "a rule that answers NaN": (
        "met a NaN, .*; look at the functions it calls",
        lambda to: Controller(table(), rule=odd).select([2.0]),
        lambda to: Controller(table(), rule=lambda c: np.nan_to_num(odd(c))).select([2.0]),
    ),
    "a table that is a folder": (
        "is a folder; name a file",
        lambda to: sdhj.load(to),
        lambda to: (table().save(to / "table.h5"), sdhj.load(to / "table.h5")),
    ),
    "a table that is a pipe": (
        "neither read nor replaced; name a file",
        lambda to: (os.mkfifo(to / "pipe"), table().save(to / "pipe")),
        lambda to: table().save(to / "table.h5"),
    ),
    "no file": (
        r"no file .*; write one with table.save",
        lambda to: sdhj.load(to / "no.h5"),
        lambda to: (table().save(to / "no.h5"), sdhj.load(to / "no.h5")),
    ),
    "a damaged file": (
        "is damaged, cut short or not a look-up table; solve it anew",
        lambda to: ((to / "table.h5").write_bytes(b"x"), sdhj.load(to / "table.h5")),
        lambda to: (solved(line()).save(to / "table.h5"), sdhj.load(to / "table.h5")),
    ),
    "black boxes are not in the file": (
        r"it has black boxes .*use load\(path, problem=...\)",
        lambda to: (solved(with_target(BLACK)).save(to / "table.h5"), sdhj.load(to / "table.h5")),
        lambda to: sdhj.load(to / "table.h5", problem=with_target(BLACK)),
    ),
    "a store that exists": (
        "exists already; go on with it by resume=True, remove it, or choose another name",
        lambda to: (solved(line(), store=to / "one.zarr"), solved(line(), store=to / "one.zarr")),
        lambda to: (
            solved(line(), store=to / "one.zarr", resume=True),
            solved(line(), store=to / "two.zarr"),
            shutil.rmtree(to / "one.zarr"),
            solved(line(), store=to / "one.zarr"),
        ),
    ),
    "a grid table for a robot": (
        'only certified tables are exported, .*: solve the problem with method="certified"',
        lambda to: sdhj.export_c(table(), to),
        lambda to: sdhj.export_c(table("certified"), to, progress=False),
    ),
    "a resolution for a map that has one": (
        "read from the map's file; give them with an array only",
        lambda to: UnsafeSet.from_map(to / "map.yaml", (0, 1), resolution=0.1),
        lambda to: UnsafeSet.from_map(np.eye(4, dtype=bool), (0, 1), resolution=0.1),
    ),
    "a parameter that is never given": (
        "leave the . out",
        lambda to: with_target(lambda p, *, t: np.abs(p[:, 0] - t) - 1.0),
        lambda to: with_target(lambda p, t: np.abs(p[:, 0] - t) - 1.0),
    ),
    "velocity as a black box": (
        "velocity cannot be a BlackBox: give drift and gain, which can be",
        lambda to: replace(
            line(), dynamics=Dynamics(MOVES, velocity=sdhj.BlackBox(lambda q, u, v: u + v), bounds=[0.2])
        ),
        lambda to: solved(
            replace(line(), dynamics=Dynamics(MOVES, sdhj.BlackBox(black_drift, rate=0.0), [[1.0]], [0.2]))
        ),
    ),
    "images of too many cells": (
        "an interval moves the state by more than 32,767 cells; use fewer cells",
        lambda to: solved(line(), Certified(cells=(500_000,))),
        lambda to: solved(line(), Certified(cells=(500,))),
    ),
    "a set below its sweep": (
        "or leave it out: the library then sweeps the set itself",
        lambda to: solved(post(swept=lambda p, t0, t1: 4.0 - p[:, 0])),
        lambda to: solved(post()),
    ),
    "--start and --runs": (
        "give only one of them",
        lambda to: (table().save(to / "t.h5"), command("simulate", to / "t.h5", "--start", "0.5", "--runs", "10")),
        lambda to: command("simulate", to / "t.h5", "--start", "0.5"),
    ),
    "a robot that exists": (
        "exists; choose another name",
        lambda to: [command("new", to / "car.py") for _ in range(2)],
        lambda to: command("new", to / "truck.py"),
    ),
    "a folder and no table": (
        "the folder of an export; give the table that it was made of: --table table.h5",
        lambda to: (sdhj.export_c(table("certified"), to, progress=False), command("verify", to)),
        lambda to: (table("certified").save(to / "t.h5"), command("verify", to, "--table", to / "t.h5")),
    ),
    "neither a file nor a store": (
        "give -o, the file to write, or --store",
        lambda to: ((to / "robot.py").write_text(ROBOT), command("solve", f"{to / 'robot.py'}:problem")),
        lambda to: command("solve", f"{to / 'robot.py'}:problem", "-o", to / "t.h5"),
    ),
    "cells of a grid method": (
        "needs --method certified, got --method hji; leave out one of them",
        lambda to: ((to / "robot.py").write_text(ROBOT), solve_robot(to, "--cells", "40", "--method", "hji")),
        lambda to: (solve_robot(to, "--cells", "40", "--method", "certified"), solve_robot(to, "--method", "hji")),
    ),
    "options of the arm": (
        "is of the arm's case study; state it in the problem of",
        lambda to: ((to / "robot.py").write_text(ROBOT), solve_robot(to, "--nodes", "41")),
        lambda to: ((to / "robot.py").write_text(ROBOT.replace("[81]", "[41]")), solve_robot(to)),
    ),
    "too long, on the command line": (
        "or allow more by --operations",
        lambda to: ((to / "robot.py").write_text(ROBOT), solve_robot(to, "--operations", "10")),
        lambda to: solve_robot(to, "--operations", "1e9"),
    ),
}
ROBOT = """import numpy as np
import sdhj

problem = sdhj.ReachAvoidProblem(
    sdhj.Grid([-4], [4], [81], ends="wall"),
    sdhj.Dynamics([[-1.0], [0.0], [1.0]], [[-1.0], [0.0], [1.0]], [[1.0]], [0.2]),
    sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 1.0),
    [],
    0.5,
    3,
)
"""


def black_drift(q, u):
    return np.array([[float(u[0])] for _ in q])


def post(**options):
    part = UnsafeSet((0,), lambda p, t: 3.0 - 0.1 * t - p[:, 0], name="wall", **options)
    return replace(line(), unsafe=(part,))


def command(*arguments):
    """Run the command; ValueError with what it says where it refuses."""
    done = CliRunner().invoke(main, [str(one) for one in arguments])
    if done.exit_code:
        raise ValueError(done.output)


def solve_robot(folder, *options):
    command("solve", f"{folder / 'robot.py'}:problem", "-o", folder / "t.h5", *options)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", CASES)
def test_advice_of_an_error_is_followed_once(name, tmp_path):
    pattern, wrong, followed = CASES[name]
    with pytest.raises((ValueError, OSError, LookupError, sdhj.NotAdmissible), match=re.compile(pattern, re.DOTALL)):
        wrong(tmp_path)
    followed(tmp_path)
