"""One table of what is refused: a pattern of the message, the call that raises it, and what its advice makes of it.

`ADVISED` says what helps, which is followed once; `REFUSED` says only what was wrong and what is expected.
"""

import math
import os
import shutil
from dataclasses import replace
from functools import cache
from unittest import mock

import numpy as np
import pytest
import zoo
from click.testing import CliRunner
from room import room
from zoo import interval_problem, unicycle_problem

import sdhj
from sdhj import BlackBox, Certified, Controller, Dynamics, Grid, Scheme, TargetSet, UnsafeSet
from sdhj.arm.workspace import Disk, Line, Still
from sdhj.certified.check import verify
from sdhj.cli import main
from sdhj.problem import dynamics as dynamics_module
from sdhj.problem import problem as problem_module
from sdhj.solver.recursion import GridParts, bytes_of_solve

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


def jittered_arm(**given):
    """The proof of an arm whose clock is off, on few cells, not solved."""
    problem = replace(sdhj.arm_case_study(nodes=7, steps=2, **given), sensing=sdhj.Sensing(jitter=0.01))
    return Certified(cells=(12, 12, 4, 4)).proof(problem)


def with_target(level, **options):
    return replace(line(**options), target=TargetSet((0,), level))


def staying(level):
    return replace(line(), target=None, unsafe=(UnsafeSet((0,), level, name="all"),))


def turned():
    """A robot in the plane whose velocity depends on its heading."""
    return unicycle_problem()


def moving(drift, **options):
    """The robot in the plane with another drift."""
    robot = turned()
    return replace(robot, dynamics=Dynamics(robot.inputs, drift, **options))


def square(p, t):
    return np.abs(p[:, 0]) - 1.0


def far(p, t):
    return np.abs(p[:, 0]) * 1e40 - 1.0


def odd(candidates):
    return np.full(len(candidates.rows), np.nan)


def timed(p, t):
    return np.abs(p[:, 0] - 0.1 * t) - 1.0


NOISE = np.random.default_rng(0)
BLACK = sdhj.BlackBox(lambda p, t: np.array([max(one, -one) for one in p[:, 0].tolist()]) - 1.0)
ADVISED = {
    "swallowed": (
        "swallow.*sign",
        lambda to: solved(
            replace(
                line(), unsafe=(UnsafeSet((0,), lambda p, t: 2.0 - np.abs(p[:, 0]) * 0 - p[:, 0] - 4.5, name="all"),)
            )
        ),
        lambda to: solved(replace(line(), unsafe=(UnsafeSet((0,), lambda p, t: p[:, 0] + 3.0, name="all"),))),
    ),
    "all unsafe": (
        "every grid node.*sign",
        lambda to: solved(staying(lambda p, t: np.abs(p[:, 0]) - 5.0)),
        lambda to: solved(staying(lambda p, t: 5.0 - np.abs(p[:, 0]))),
    ),
    "a target between nodes: more nodes": (
        "between nodes.*more nodes",
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.05) - 0.04)),
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.05) - 0.04, nodes=641, disturbance=0.01)),
    ),
    "a target between nodes: move it": (
        "enlarge",
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.05) - 0.04)),
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0] - 0.1) - 0.04)),
    ),
    "a level set that is too large": (
        "single precision.*clip",
        lambda to: solved(with_target(far)),
        lambda to: solved(with_target(lambda p, t: np.minimum(far(p, t), 10.0))),
    ),
    "nothing to do": (
        "unsafe set.*unsafe end",
        lambda to: replace(line(), target=None, unsafe=()),
        lambda to: (replace(line(), target=None), replace(line(ends="unsafe"), target=None, unsafe=())),
    ),
    "for ever, and in time": (
        "time.*number of steps",
        lambda to: replace(line(), target=TargetSet((0,), timed), steps=None),
        lambda to: replace(line(), target=TargetSet((0,), timed), steps=3),
    ),
    "lax and the state": (
        'state.*method="hji"',
        lambda to: solved(turned(), "lax"),
        lambda to: solved(turned(), "hji"),
    ),
    "projected on one axis": (
        '2 axes.*method="hji"',
        lambda to: solved(line(), "projected"),
        lambda to: solved(line(), "hji"),
    ),
    "resume without a store": (
        "store='table",
        lambda to: solved(line(), resume=True),
        lambda to: solved(line(), resume=True, store=to / "table.store"),
    ),
    "no step where time matters": (
        r"select\(q, step=0\)",
        lambda to: Controller(table(view_time="swept", rate=0.1)).select([0.5]),
        lambda to: Controller(table(view_time="swept", rate=0.1)).select([0.5], step=0),
    ),
    "a table onto a folder": (
        "folder.*name a file",
        lambda to: table().save(to),
        lambda to: table().save(to / "t.npz"),
    ),
    "an export onto a file": (
        "file.*another folder",
        lambda to: (to / "table").write_text("") or sdhj.export_c(table("certified"), to / "table", progress=False),
        lambda to: sdhj.export_c(table("certified"), to / "robot", progress=False),
    ),
    "what was exported, elsewhere": (
        "sdhj_table.bin.*folder of an export",
        lambda to: (table("certified").save(to / "t.npz"), verify(to / "t.npz", exported=to)),
        lambda to: (
            sdhj.export_c(table("certified"), to, progress=False),
            verify(to / "t.npz", exported=to),
            verify(to / "t.npz", exported=to / "sdhj_table.bin"),
        ),
    ),
    "inputs in one row": (
        r"\(4,\).*\[\[-1\], \[0\], \[1\], \.\.\.\]$",
        lambda to: Dynamics([-1, 0, 1, 2], [[1.0]] * 4),
        lambda to: Dynamics([[-1], [0], [1], [2]], [[1.0]] * 4),
    ),
    "a drift of v: as a velocity": (
        r"\(q, u, v\).*velocity=f\(q, u, v\)",
        lambda to: Dynamics(MOVES, drift=lambda q, u, v: q + u + v, bounds=[0.1]),
        lambda to: Dynamics(MOVES, velocity=lambda q, u, v: q + u + v, bounds=[0.1]),
    ),
    "a drift of v: by a gain": (
        "gain=.*bounds=",
        lambda to: Dynamics(MOVES, drift=lambda q, u, v: q + u + v),
        lambda to: Dynamics(MOVES, drift=lambda q, u: q + u, gain=[[1.0]], bounds=[0.1]),
    ),
    "one state at a time": (
        r"points\[:, k\]",
        lambda to: moving(lambda q, u: np.array([np.cos(q[2]), np.sin(q[2]), u[0]])),
        lambda to: moving(
            lambda q, u: np.stack([np.cos(q[:, 2]), np.sin(q[:, 2]), np.full_like(q[:, 2], u[0])], axis=1)
        ),
    ),
    "noise in a drift": (
        "differently.*disturbance",
        lambda to: moving(lambda q, u: 0.0 * q + 0.1 * np.random.default_rng(0).normal(size=(len(q), 3))),
        lambda to: moving(lambda q, u: 0.0 * q, gain=np.eye(3), bounds=[0.1] * 3),
    ),
    "noise in a drift, the same for all": (
        "called again.*disturbance",
        lambda to: moving(lambda q, u: 0.0 * q + NOISE.normal()),
        lambda to: moving(lambda q, u: 0.0 * q, gain=np.ones((3, 1)), bounds=[0.1]),
    ),
    "no input after the last step": (
        "step 5.*0 to 4$",
        lambda to: Controller(table()).select([3.0], table().steps),
        lambda to: Controller(table()).select([1.2], table().steps - 1),
    ),
    "a command of another size": (
        r"wanted.*1 number.*\[1.0, 0.0\]",
        lambda to: Controller(table()).filter([1.5], 0, wanted=[1.0, 0.0]),
        lambda to: Controller(table()).filter([1.5], 0, wanted=[1.0]),
    ),
    "a rule that answers NaN": (
        "NaN.*functions",
        lambda to: Controller(table(), rule=odd).select([2.0]),
        lambda to: Controller(table(), rule=lambda c: np.nan_to_num(odd(c))).select([2.0]),
    ),
    "a table that is a folder": (
        "folder.*problem.json",
        lambda to: sdhj.load(to),
        lambda to: (table().save(to / "table.npz"), sdhj.load(to / "table.npz")),
    ),
    "a table that is a pipe": (
        "name a file",
        lambda to: (os.mkfifo(to / "pipe"), table().save(to / "pipe")),
        lambda to: table().save(to / "table.npz"),
    ),
    "no file": (
        "no file.*table.save",
        lambda to: sdhj.load(to / "no.npz"),
        lambda to: (table().save(to / "no.npz"), sdhj.load(to / "no.npz")),
    ),
    "a damaged file": (
        "damaged.*anew",
        lambda to: ((to / "table.npz").write_bytes(b"x"), sdhj.load(to / "table.npz")),
        lambda to: (solved(line()).save(to / "table.npz"), sdhj.load(to / "table.npz")),
    ),
    "black boxes are not in the file": (
        r"black boxes.*load\(path, problem=...\)",
        lambda to: (solved(with_target(BLACK)).save(to / "table.npz"), sdhj.load(to / "table.npz")),
        lambda to: sdhj.load(to / "table.npz", problem=with_target(BLACK)),
    ),
    "a store that exists": (
        "exists.*resume=True.*another name",
        lambda to: (solved(line(), store=to / "one.store"), solved(line(), store=to / "one.store")),
        lambda to: (
            solved(line(), store=to / "one.store", resume=True),
            solved(line(), store=to / "two.store"),
            shutil.rmtree(to / "one.store"),
            solved(line(), store=to / "one.store"),
        ),
    ),
    "a grid table for a robot": (
        'exported.*method="certified"',
        lambda to: sdhj.export_c(table(), to),
        lambda to: sdhj.export_c(table("certified"), to, progress=False),
    ),
    "a resolution for a map that has one": (
        "map's file.*array",
        lambda to: UnsafeSet.from_map(to / "map.yaml", (0, 1), resolution=0.1),
        lambda to: UnsafeSet.from_map(np.eye(4, dtype=bool), (0, 1), resolution=0.1),
    ),
    "a parameter that is never given": (
        "leave the . out",
        lambda to: with_target(lambda p, *, t: np.abs(p[:, 0] - t) - 1.0),
        lambda to: with_target(lambda p, t: np.abs(p[:, 0] - t) - 1.0),
    ),
    "velocity as a black box": (
        "velocity.*BlackBox.*drift and gain",
        lambda to: replace(
            line(), dynamics=Dynamics(MOVES, velocity=sdhj.BlackBox(lambda q, u, v: u + v), bounds=[0.2])
        ),
        lambda to: solved(
            replace(line(), dynamics=Dynamics(MOVES, sdhj.BlackBox(black_drift, rate=0.0), [[1.0]], [0.2]))
        ),
    ),
    "images of too many cells": (
        "32,767 cells.*fewer cells",
        lambda to: solved(line(), Certified(cells=(500_000,))),
        lambda to: solved(line(), Certified(cells=(500,))),
    ),
    "more cells of an axis than a file has": (
        "10,000,000 cells.*1,000,000",
        lambda to: solved(line(), Certified(cells=(10**7,))),
        lambda to: solved(line(), Certified(cells=(500,))),
    ),
    "a clock that is off and a target on a line": (
        r"target.*Line\(.*use a Still",
        lambda to: jittered_arm(target=Disk(Line((0.1, 0.1), (0.0, 0.0)), 0.1)),
        lambda to: jittered_arm(target=Disk(Still((0.1, 0.1)), 0.1)),
    ),
    "a set below its sweep": (
        "leave it out",
        lambda to: solved(post(swept=lambda p, t0, t1: 4.0 - p[:, 0])),
        lambda to: solved(post()),
    ),
    "--start and --runs": (
        "only one",
        lambda to: (table().save(to / "t.npz"), command("simulate", to / "t.npz", "--start", "0.5", "--runs", "10")),
        lambda to: command("simulate", to / "t.npz", "--start", "0.5"),
    ),
    "a robot that exists": (
        "exists.*another name",
        lambda to: [command("new", to / "car.py") for _ in range(2)],
        lambda to: command("new", to / "truck.py"),
    ),
    "a folder and no table": (
        "--table table.npz",
        lambda to: (sdhj.export_c(table("certified"), to, progress=False), command("verify", to)),
        lambda to: (table("certified").save(to / "t.npz"), command("verify", to, "--table", to / "t.npz")),
    ),
    "neither a file nor a store": (
        "-o.*--store",
        lambda to: ((to / "robot.py").write_text(ROBOT), command("solve", f"{to / 'robot.py'}:problem")),
        lambda to: command("solve", f"{to / 'robot.py'}:problem", "-o", to / "t.npz"),
    ),
    "cells of a grid method": (
        "--method certified.*leave out",
        lambda to: ((to / "robot.py").write_text(ROBOT), solve_robot(to, "--cells", "40", "--method", "hji")),
        lambda to: (solve_robot(to, "--cells", "40", "--method", "certified"), solve_robot(to, "--method", "hji")),
    ),
    "options of the arm": (
        "case study.*problem",
        lambda to: ((to / "robot.py").write_text(ROBOT), solve_robot(to, "--nodes", "41")),
        lambda to: ((to / "robot.py").write_text(ROBOT.replace("[81]", "[41]")), solve_robot(to)),
    ),
    "a drift that is not one of the state": (
        "first parameter.*state.*write",
        lambda to: Dynamics(MOVES, lambda u, q: q[0] + 0 * u),
        lambda to: Dynamics(MOVES, lambda q, u: u[0] + 0 * q),
    ),
    "compiled code that says nothing": (
        "wrap it in a lambda",
        lambda to: Dynamics(MOVES, max),
        lambda to: Dynamics(MOVES, lambda q, u: np.maximum(0 * q, u)),
    ),
    "bounds as a black box": (
        "BlackBox.*half-widths",
        lambda to: replace(line(), dynamics=Dynamics(MOVES, MOVES, [[1.0]], sdhj.BlackBox(lambda q, u: 0.2 + 0 * q))),
        lambda to: [
            replace(line(), dynamics=Dynamics(MOVES, MOVES, [[1.0]], one)) for one in ([0.2], lambda q: 0.2 + 0 * q)
        ],
    ),
    "too many inputs": (
        "quantise more coarsely",
        lambda to: Dynamics(*[np.linspace(-1.0, 1.0, 70_000)[:, None]] * 2),
        lambda to: Dynamics(*[np.linspace(-1.0, 1.0, 100)[:, None]] * 2),
    ),
    "a drift without dynamics' other half": (
        "drift.*gain.*velocity",
        lambda to: Dynamics(MOVES),
        lambda to: (
            Dynamics(MOVES, MOVES, [[1.0]], [0.2]),
            Dynamics(MOVES, velocity=lambda q, u, v: 0 * q + u[0] + v[0], bounds=[0.2]),
        ),
    ),
    "order of HJI": (
        r"Scheme\(order=",
        lambda to: sdhj.HJI(order=3),
        lambda to: sdhj.HJI(sdhj.Scheme(order=3)),
    ),
    "a mask": (
        "mask.*filled",
        lambda to: table().contains(np.ma.masked_less([[0.5]], 0.0)),
        lambda to: table().contains(np.ma.masked_less([[0.5]], 0.0).filled(9.0)),
    ),
    "one state for many": (
        r"q\[None\] is one state",
        lambda to: Controller(table()).batch(0.5),
        lambda to: Controller(table()).batch(np.array([0.5])[None]),
    ),
    "many states for one": (
        r"for many states use batch\(\)",
        lambda to: Controller(table()).select([[0.5], [1.0]]),
        lambda to: Controller(table()).batch([[0.5], [1.0]]),
    ),
    "in the target, and not to be kept there": (
        r"fallback\(\)",
        lambda to: Controller(solved(drifting(), "certified")).select([0.9]),
        lambda to: Controller(solved(drifting(), "certified")).fallback([0.9]),
    ),
    "a state that is not promised: another, or more steps": (
        r"table.contains\(q, start=0, within=1\).*more steps",
        lambda to: Controller(table(steps=1)).select([-2.0]),
        lambda to: (
            Controller(table(steps=1)).select([-1.2])
            if table(steps=1).contains([[-1.2]], start=0, within=1)
            else 1 / 0,
            Controller(table(steps=5)).select([-2.0]),
        ),
    ),
    "a state that is not promised: more cells": (
        "for ever.*more cells",
        lambda to: Controller(braking(12)).select([0.9, 0.6]),
        lambda to: Controller(braking(200)).select([0.9, 0.6]),
    ),
    "records of a velocity": (
        "linearly.*drift and gain",
        lambda to: recorded(Dynamics(MOVES, velocity=lambda q, u, v: 0 * q + u[0] + v[0] ** 3, bounds=[0.2])),
        lambda to: recorded(line().dynamics),
    ),
    "records of other inputs": (
        "inputs.*recorded",
        lambda to: recorded(line().dynamics, 0.5),
        lambda to: recorded(Dynamics([[0.5]], [[0.5]], [[1.0]], [0.2]), 0.5),
    ),
    "a loop of a table that forgets": (
        "memory=True.*loop",
        lambda to: exported_with(to, memory=False).loop(1),
        lambda to: exported_with(to, memory=True).loop(1).step([[0.0]]),
    ),
    "no run can start": (
        "no run can start",
        lambda to: sdhj.monte_carlo(Controller(solved(parking(1e-6))), 10, progress=False),
        lambda to: sdhj.monte_carlo(Controller(solved(parking(0.6))), 10, progress=False),
    ),
    "a level set undefined between nodes": (
        r"np.maximum\(x, 0.0\).*swept=.*view_time='sampled'",
        lambda to: solved(rooted(np.sqrt)),
        lambda to: (
            solved(rooted(lambda x: np.sqrt(np.maximum(x, 0.0)))),
            solved(
                rooted(np.sqrt, swept=lambda p, t0, t1: np.abs(p[:, 0] - 3 - (t0 + t1) / 20) - (t1 - t0) / 20 - 0.5)
            ),
            solved(replace(rooted(np.sqrt), view_time="sampled")),
        ),
    ),
    "a level set that is too small": (
        "scale.*return 0",
        lambda to: solved(with_target(lambda p, t: 1e-46 * (np.abs(p[:, 0]) - 1.0))),
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0]) - 1.0)),
    ),
    "a black box in time": (
        "rate=0.0.*view_time='sampled'",
        lambda to: boxed(),
        lambda to: (solved(boxed(rate=0.0)), solved(boxed("sampled"))),
    ),
    "a black box at an instant": (  # games sweep it over each time step
        "rate=0.0",
        lambda to: boxed("instantaneous"),
        lambda to: solved(boxed("instantaneous", rate=0.0)),
    ),
    "a black box and a proof": (
        "slope.*enclosure.*proof",
        lambda to: solved(boxed(rate=0.0), Certified(cells=(80,))),
        lambda to: (
            solved(boxed(rate=0.0, slope=1.0), Certified(cells=(80,))),
            solved(boxed(enclosure=lambda low, high, t0, t1: (3 - high[:, 0], 3 - low[:, 0])), Certified(cells=(80,))),
        ),
    ),
    "a black box and sensing": (
        "drift.*slope.*Sensing",
        lambda to: sensed(sdhj.BlackBox(black_drift, rate=0.0)),
        lambda to: sensed(sdhj.BlackBox(black_drift, slope=0.0, rate=0.0)),
    ),
    "a black box in a function": (
        "whole function.*sdhj.BlackBox",
        lambda to: with_target(lambda p, t: BLACK(p, t) + 1.0),
        lambda to: with_target(sdhj.BlackBox(lambda p, t: BLACK.function(p, t) + 1.0)),
    ),
    "a velocity that may be undefined": (
        "clip",
        lambda to: sensed(lambda q, u: u[0] + 1e-6 / (q - 0.123456)),
        lambda to: sensed(lambda q, u: u[0] + 1e-6 / np.maximum(q - 0.123456, 1e-3)),
    ),
    "more doubt than target": (
        "error or delay.*enlarge",
        lambda to: replace(line(), sensing=sdhj.Sensing(0.6, memory=False)),
        lambda to: (
            replace(line(), sensing=sdhj.Sensing(0.1, memory=False)),
            replace(with_target(lambda p, t: np.abs(p[:, 0]) - 2.0), sensing=sdhj.Sensing(0.6, memory=False)),
        ),
    ),
    "a run that is over": (
        r"reset\(\)",
        lambda to: agent().step(0),
        lambda to: agent(reset=True).step(0),
    ),
    "something else than its arguments": (
        "arguments alone.*sdhj.BlackBox",
        lambda to: solved(with_target(elsewhere)),
        lambda to: solved(with_target(lambda p, t: np.abs(p[:, 0]) - 1.0)),
    ),
    "a store and a proof": (
        "store=.*memory",
        lambda to: solved(line(), "certified", store=to / "t.store"),
        lambda to: solved(line(), "certified"),
    ),
    "for ever on a grid": (
        "method='certified'.*steps=N",
        lambda to: solved(replace(line(), target=None, steps=None), "hji"),
        lambda to: (
            solved(replace(line(), target=None, steps=None), "certified"),
            solved(replace(line(), target=None)),
        ),
    ),
    "some time on a grid": (
        "steps=60.*steps_to_go.*method='certified'",
        lambda to: solved(replace(line(), steps=None), "hji"),
        lambda to: (solved(replace(line(), steps=60)), solved(replace(line(), steps=None), "certified")),
    ),
    "safe ends and a target": (
        "without a target",
        lambda to: line(ends="safe"),
        lambda to: replace(line(), target=None, grid=sdhj.Grid([-4.0], [4.0], [81], ends="safe")),
    ),
    "no certified sets": (
        "certified.*method='certified'",
        lambda to: (table().save(to / "t.npz"), verify(to / "t.npz")),
        lambda to: (table("certified").save(to / "t.npz"), verify(to / "t.npz")),
    ),
    "black boxes to verify": (
        "black boxes.*give the problem",
        lambda to: (solved(boxed(**KNOWN), "certified").save(to / "t.npz"), verify(to / "t.npz")),
        lambda to: verify(to / "t.npz", problem=boxed(**KNOWN)),
    ),
    "a figure of one axis": (
        "sdhj info",
        lambda to: (table().save(to / "t.npz"), command("plot", to / "t.npz", "-o", to / "t.png")),
        lambda to: command("info", to / "t.npz"),
    ),
    "an ending": (
        "t.gif.*.png or .svg",
        lambda to: (plane().save(to / "t.npz"), command("plot", to / "t.npz", "-o", to / "t.gif")),
        lambda to: command("plot", to / "t.npz", "-o", to / "t.png"),
    ),
    "a default in the place of the time": (
        "default.*last",
        lambda to: with_target(lambda p, size=1.0: np.abs(p[:, 0]) - size),
        lambda to: with_target(lambda p, t, size=1.0: np.abs(p[:, 0]) - size),
    ),
    "a large table": (
        "fewer nodes",
        lambda to: sdhj.gridded(np.broadcast_to(0.0, 2**28), [0.0], [1.0]),
        lambda to: sdhj.gridded(np.broadcast_to(0.0, 2**8), [0.0], [1.0]),
    ),
    "large tables": (
        "fewer nodes or pixels",
        lambda to: patched(problem_module, "MOST_TABLES", 4000, lambda: with_map(40)),
        lambda to: patched(problem_module, "MOST_TABLES", 4000, lambda: with_map(10)),
    ),
    "a large map": (
        "pixels.*scale.*cut off",
        lambda to: UnsafeSet.from_map(np.broadcast_to(False, (20_000, 20_000)), (0, 1), resolution=0.1),
        lambda to: [
            UnsafeSet.from_map(some, (0, 1), resolution=side)
            for some, side in ((np.broadcast_to(False, (20_000, 20_000))[::500, ::500], 50.0), (np.eye(40) > 0, 0.1))
        ],
    ),
    "a map and no memory": (
        "GB are available.*scale",
        lambda to: with_room(10**7, lambda: with_map(1000)),
        lambda to: with_room(10**7, lambda: with_map(100)),
    ),
    "a solve and no memory": (
        'fewer nodes or steps.*"float32"',
        lambda to: with_room(scarce(), lambda: solved(line(nodes=1001, steps=40), DOUBLE)),
        lambda to: with_room(
            scarce(),
            lambda: (
                solved(line(nodes=101, steps=40), DOUBLE),
                solved(line(nodes=1001, steps=4), DOUBLE),
                solved(line(nodes=1001, steps=40)),
            ),
        ),
    ),
    "a proof and no memory": (
        "certifying.*fewer cells",
        lambda to: with_room(2 * 10**6, lambda: solved(line(), Certified(cells=(30_000,)))),
        lambda to: with_room(2 * 10**6, lambda: solved(line(), Certified(cells=(300,)))),
    ),
    "a check and no memory": (
        "samples=1000",
        lambda to: (table("certified").save(to / "t.npz"), with_room(0, lambda: verify(to / "t.npz"))),
        lambda to: (
            table("certified").save(to / "t.npz"),
            with_room(200_000, lambda: verify(to / "t.npz", samples=10)),
        ),
    ),
    "a drift of many lines": (
        "fewer inputs.*sdhj.gridded.*sdhj.BlackBox",
        lambda to: patched(dynamics_module, "MOST_LINES", 9, lambda: waving(3)),
        lambda to: patched(
            dynamics_module,
            "MOST_LINES",
            9,
            lambda: (waving(1), waving(3, lambda q, u: u[0] + 0 * q), waving(3, sdhj.BlackBox(waves))),
        ),
    ),
    "an interval that is too long": (
        "shorter delta.*fewer nodes.*units",
        lambda to: solved(replace(line(), delta=1e5)),
        lambda to: solved(line()),
    ),
    "velocities that vibrate": (
        "shorter delta.*bounds",
        lambda to: solved(vibrating(1.0)),
        lambda to: (solved(vibrating(0.01)), solved(vibrating(1.0, 0.0, 3.2))),
    ),
    "a picture whose line ends were changed": (
        r"\*.pgm binary",
        lambda to: of_map(to, PICTURE.replace(b"\n", b"\r\n")),
        lambda to: of_map(to, PICTURE),
    ),
    "no such folder": (
        "folder that exists",
        lambda to: table().save(to / "no" / "t.npz"),
        lambda to: ((to / "no").mkdir(), table().save(to / "no" / "t.npz")),
    ),
    "no compiler": (
        "gcc or clang.*CC",
        lambda to: patched(shutil, "which", lambda name: None, lambda: asked(to)),
        lambda to: patched(shutil, "which", lambda name: None, lambda: asked(to, CC=COMPILER)),
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


def drifting():
    """A robot that is blown out of its target, whatever it does."""
    return replace(line(), dynamics=Dynamics(MOVES, lambda q, u: u[0] + 2.0 + 0 * q, [[1.0]], [0.1]))


def recorded(dynamics, applied=1.0):
    """What the records of a robot that was driven by one input say."""
    problem = replace(line(), dynamics=dynamics)
    t = np.arange(11) / 10
    records = [np.column_stack([t, (applied + wind) * t, np.full(11, applied)]) for wind in np.linspace(-0.2, 0.2, 10)]
    return sdhj.bounds_from_records(problem, records, error=0.0)


def exported_with(folder, memory):
    if memory and not COMPILER:
        pytest.skip("there is neither gcc nor clang")
    sensing = sdhj.Sensing(0.05, memory=memory)
    found = solved(replace(line(), sensing=sensing), Certified(cells=(80,)))
    return sdhj.export_c(found, folder, progress=False)


@cache
def braking(cells):
    """A cart that has to stay before a wall at 1.8 m, for ever."""
    moves = Dynamics(MOVES, lambda q, u: np.stack([q[:, 1], np.full(len(q), u[0])], axis=1))
    before = UnsafeSet((0,), lambda p, t: 1.8 - p[:, 0], name="wall")
    problem = zoo.cart(grid=Grid([-2, -1.5], [2, 1.5], [41, 31]), dynamics=moves, unsafe=[before], delta=0.2)
    return solved(problem, Certified(cells=(cells, cells)))


def parking(tolerance):
    """A target that few nodes lie in, and an adversary as strong as the robot."""
    return replace(with_target(lambda p, t: np.abs(p[:, 0]) - tolerance, disturbance=0.9), steps=1)


def rooted(root, **options):
    """A post |q - 3 - t / 10| <= 0.5, whose root has wider bounds than its values."""

    def level(p, t):
        far = p[:, 0] - 3 - 0.1 * t
        return root(far * far - 2 * far + 1 + 2 * far - 1) - 0.5

    return replace(line(), unsafe=(UnsafeSet((0,), level, name="post", **options),))


def boxed(view_time="swept", **declared):
    """The wall as a black box."""
    return replace(line(), unsafe=(UnsafeSet((0,), sdhj.BlackBox(wall, **declared), name="wall"),), view_time=view_time)


def wall(p, t):
    return 3.0 - p[:, 0]


def sensed(drift):
    """A problem with measurement error."""
    return replace(line(), dynamics=Dynamics(MOVES, drift, [[1.0]], [0.2]), sensing=sdhj.Sensing(0.1, memory=False))


def agent(reset=False, **options):
    environment = pytest.importorskip("sdhj.simulation.environment", exc_type=ImportError)
    made = environment.ReachAvoidEnv(solved(replace(line(), **options)))
    if reset:
        made.reset()
    return made


def elsewhere(p, t):
    """The distance from a place that a module of yours may move."""
    return np.abs(p[:, 0]) - PLACES[0] * (1.0 if type(p) is np.ndarray else 2.0)


def patched(module, name, value, act):
    """What `act` does where a module has this value for a name."""
    with mock.patch.object(module, name, value):
        return act()


def with_room(nbytes, act):
    """What `act` does where so little memory is free, and all of it is counted."""
    with room(nbytes):
        return act()


@cache
def scarce():
    """Bytes that a solve of half of what is asked for needs."""
    most, few = (bytes_of_solve(GridParts(line(nodes=1001, steps=steps), DOUBLE)) for steps in (40, 4))
    return (most + few) // 2


def with_map(side):
    """A problem in the plane, of which a map of so many pixels is unsafe."""
    office = UnsafeSet.from_map(np.eye(side) > 0, (0, 1), resolution=3.0 / side, origin=(-1.5, -1.5))
    return replace(turned(), unsafe=(office,))


def of_map(folder, picture):
    (folder / "map.pgm").write_bytes(picture)
    (folder / "map.yaml").write_text(YAML)
    return UnsafeSet.from_map(folder / "map.yaml", (0, 1))


def waves(q, u):
    return u[0] + np.sin(q) + np.cos(2 * q) * u[0]


def waving(count, drift=waves):
    """As many inputs."""
    inputs = np.linspace(-1.0, 1.0, count)[:, None]
    return replace(line(), dynamics=Dynamics(inputs, drift, [[1.0]], [0.2]))


def vibrating(delta, amplitude=6.0, bound=0.2):
    """Gusts of 6 m/s, eight in a second, or an adversary that can do as much around their mean."""
    drift = lambda q, u, t: u[0] + amplitude * np.sin(8 * np.pi * t) ** 2 + (6.0 - amplitude) / 2 + 0 * q  # noqa: E731
    return replace(line(), dynamics=Dynamics(MOVES, drift, [[1.0]], [bound]), delta=delta, steps=2)


def asked(folder, **environment):
    """What the compiled C of a table answers."""
    if not COMPILER:
        pytest.skip("there is neither gcc nor clang")
    with mock.patch.dict(os.environ, environment):
        return sdhj.export_c(table("certified"), folder, progress=False).select([[0.5]])


COMPILER = shutil.which("gcc") or shutil.which("clang")
DOUBLE = sdhj.HopfLax(dtype="float64")
PICTURE = b"P5\n4 3\n255\n" + bytes([254] * 11 + [0])
YAML = """image: map.pgm
resolution: 1
origin: [0, 0, 0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
PLACES = [1.0]
KNOWN = {"rate": 0.0, "slope": 1.0}


@cache
def plane():
    return solved(turned())


def command(*arguments):
    """Run the command; ValueError with what it says where it refuses."""
    done = CliRunner().invoke(main, [str(one) for one in arguments])
    if done.exit_code:
        raise ValueError(done.output)


def solve_robot(folder, *options):
    command("solve", f"{folder / 'robot.py'}:problem", "-o", folder / "t.npz", *options)


def run(velocity, *, periodic=False, upper=4.0):
    """x on a line or a ring, a goal near its end, and one input that stands still beside one that moves."""
    return zoo.line(
        grid=Grid([0.0], [upper], [41], [periodic], ["x"]),
        dynamics=Dynamics([[0.0], [1.0]], velocity, [[1.0]], [0.1]),
        target=zoo.goal(upper - 0.5, 0.3),
        delta=0.25,
    )


def certified_run(velocity):
    """The goal's share is 0.6 / 4, less its boundary: half of it is there."""
    assert solved(run(velocity), Certified(cells=[400], parts=40)).fraction() > 0.075


ADVISED |= {
    "a velocity without bound": (
        r"along x under input 0.*\[0.51\] and \[0.52\].*np.maximum",
        lambda to: certified_run(lambda q, u: 0.02 * u[0] / (q - 0.513)),
        lambda to: certified_run(lambda q, u: 0.02 * u[0] / np.maximum(q - 0.513, 0.01)),
    ),
    "a velocity that grows too fast": (
        r"under input 1.*\[2.\d+\] and \[\d.*np.minimum",
        lambda to: certified_run(lambda q, u: u[0] * (q / 1.5) ** 9),
        lambda to: certified_run(lambda q, u: u[0] * np.minimum((q / 1.5) ** 9, 2.0)),
    ),
}


def ring(speed):
    """Every place is on the grid: an image that wraps around an integer would seem to be at home."""
    return run(lambda q, u: speed * u[0] * (2.0 + np.sin(2.0 * np.pi * q)), periodic=True, upper=1.0)


LONG = [  # rows that take more than a quarter of a second
    "images of too many cells",
    "a loop of a table that forgets",
    "no compiler",
    "a solve and no memory",
    "an ending",
    "a set below its sweep",
    "a velocity without bound",
    "a velocity that grows too fast",
    "an export onto a file",
]
ARRAY, TWO = np.zeros(3), [np.zeros(2), np.zeros(3)]
REFUSED = [  # a call, what it says
    (
        lambda: sdhj.simulate(Controller(table()), [2.0], ["worst"]),
        r"adversary.*aggressive.*\['worst'\]",
    ),
    (lambda: sdhj.monte_carlo(Controller(table()), 5, {}), "adversary.*aggressive.*{}"),
    (lambda: Scheme(flux=ARRAY), "flux.*godunov"),
    (lambda: Scheme(order=ARRAY), "order.*1, 2, 3"),
    (lambda: Scheme(cfl=ARRAY), r"cfl.*\(0, 1\].*array"),
    (lambda: Scheme(cfl=np.complex128(0.5)), r"cfl.*\(0, 1\].*complex"),
    (lambda: sdhj.HopfLax(interpolation=ARRAY), "interpolation.*limited"),
    (lambda: replace(line(), view_time=ARRAY), "view_time.*sampled"),
    (
        lambda: replace(line(), steps=10**400),
        r"steps.*1,000,000.*1000.*\.\.\.",
    ),
    (
        lambda: TargetSet((0,), lambda p, t: [1.0, "a"] * 40),
        "'target'.*constant of type",
    ),
    (lambda: TargetSet((0,), lambda p, t: TWO), "'target'.*different lengths"),
    (
        lambda: TargetSet((0,), lambda p, t: None),
        "'target'.*None.*return",
    ),
    (lambda: TargetSet((0,), lambda p, t: p[:, 0] > 1.0), "'target'.*real.*comparison"),
    (lambda: TargetSet((0,), BlackBox("a")), "function of a BlackBox.*'a'"),
    (lambda: BlackBox(max, slope=-1.0), "slope of a BlackBox.*-1.0"),
    (lambda: BlackBox(max, reads=[0.5]), "reads.*whole numbers"),
    (lambda: BlackBox(max, rate=np.nan), "rate of a BlackBox.*nan"),
    (lambda: BlackBox(max, enclosure=3), "enclosure of a BlackBox.*3"),
    (lambda: Dynamics(TWO, TWO, [[1.0]], [0.1]), "inputs.*real numbers"),
    (lambda: Dynamics([[1.0]], [[1.0]], [[1.0]], TWO), "bounds.*real numbers"),
    (lambda: Dynamics([[1.0]], lambda p: TWO, [[1.0]], [0.1]).read(1), "drift.*different lengths"),
    (lambda: Grid(TWO, [1.0], [5]), "lower.* 2 entries"),
    (lambda: Grid([ARRAY], [1.0], [5]), r"lower\[0\].*number.*array"),
    (lambda: Grid([0.0], [1.0], [5], ends=[[["wall"], ["wall"]]]), "ends.*unsafe, wall, safe"),
    (lambda: Grid([0.0], [1.0], b"abc"), "shape.*sequence.*b'abc'"),
    (lambda: Certified(parts=10**400), "parts.*10,000.*1000"),
    (lambda: Certified(parts=0), "parts.*10,000.* 0"),
    (lambda: Certified(cells=[10**400]), "cells.* 2 .*1000"),
    (lambda: line().target_value([["a"]], 0.0), "points.*real numbers"),
    (lambda: sdhj.Projected(subspaces=ARRAY), r"subspaces.*\(0, 1, 2\)"),
    (lambda: table().values_at(np.full((1, 1, 1), np.nan), 0, np.array([3])), "points.*NaN"),
    *(
        (lambda speed=speed: solved(ring(speed), Certified(cells=[40])), "32,767 cells")
        for speed in (1e10, 1e19, 1e300)
    ),
]


REFUSED += [  # numbers and sets of a problem; `test_checks` has more of what is no number
    (lambda: replace(line(), delta=0.0), "delta"),
    (lambda: replace(line(), steps=0), "steps"),
    (lambda: replace(line(), target="home"), "TargetSet.*None.*'home'"),
    (lambda: replace(line(), unsafe=None), "sequence of UnsafeSet.*None"),
    (lambda: replace(line(), unsafe=UnsafeSet((0,), wall)), "sequence of UnsafeSet"),
    (lambda: replace(line(), unsafe=[UnsafeSet((0, 0), wall)]), "ascending"),
    (lambda: replace(line(), target=TargetSet((1,), square)), "axes of 'target'"),
    (lambda: with_target(lambda p, t: np.ones(len(p))), "wrong sign"),
    (lambda: with_target(lambda p, t: np.log(p[:, 0] + 9.0) / p[:, 0]), "undefined or infinite.*at .*0.0"),
    (lambda: with_target(lambda p, t: np.full(len(p), np.nan)), "undefined or infinite.*nan"),
    (lambda: with_target(lambda p, t: np.zeros((len(p), 2))), "shape"),
    *((lambda axes=axes: TargetSet(axes, square), "sequence of whole numbers") for axes in (0, (0.0,), "x")),
    (lambda: TargetSet((0,), 0.3), "level set of 'target'"),
    (lambda: TargetSet((0,), lambda p: p[:, 0]), "level set of 'target'"),
    (lambda: UnsafeSet((0,), wall, wall), r"of \(points, t0, t1\)"),
    (lambda: BlackBox(wall, rate="fast"), "rate of a BlackBox.*real numbers"),
    *((lambda some=some: verify("none.npz", samples=some), "samples must be") for some in (0, -1, 2.5, True)),
    *((lambda seed=seed: verify("none.npz", seed=seed), "seed must be") for seed in (-1, 0.5, None)),
]


def writing(p, *others):
    """A level set that moves the points that it is given."""
    p -= 0.5
    return np.abs(p[:, 0]) - 1.0


def stopping(given):
    given[...] = 0.0
    return given


def moved_by(drift=MOVES, gain=((1.0,),), bounds=(0.2,)):
    """Dynamics whose functions have been called."""
    return Dynamics(MOVES, drift, gain, bounds).read(1)


def among(share):
    """A level set that hangs on how many points there are: they come in pieces, and in runs one by one."""
    return TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 1.0 + share / len(p))


REFUSED += [  # functions that change what they are given, or answer otherwise than of each state by itself
    (lambda: TargetSet((0,), writing), "level set of 'target'"),
    (lambda: UnsafeSet((0,), wall, writing), "writing into an argument"),
    (lambda: moved_by(lambda p, u: stopping(p)), "drift under input 0"),
    (lambda: moved_by(gain=lambda q, u: stopping(u)[None]), "read-only\nwhile gain under input 0"),
    (lambda: among(1.0), "'target'.* differently"),
    (lambda: among(1e-15), "'target'.* differently"),
    (lambda: moved_by(lambda p, u: 0.0 * p + u / (1.0 + len(p))), "input 0.* differently"),
    (lambda: moved_by(gain=lambda p: np.full((len(p), 1, 1), p.max())), "gain.* differently"),
]


CALLS = iter(range(10**9))


def restless(shape):
    return np.full(shape, 0.5 + 1e-9 * next(CALLS))


def at_rest(p, *times):
    return np.abs(p[:, 0]) - 1.0


def unsteady(p, *times):
    return np.abs(p[:, 0]) - restless(len(p))


UNSTEADY = {
    "target": lambda: TargetSet((0,), unsteady),
    "unsafe": lambda: UnsafeSet((0,), unsteady, name="unsafe"),
    "swept": lambda: UnsafeSet((0,), at_rest, lambda p, *t: unsteady(p) - 1.0, "unsafe"),
    "drift": lambda: moved_by(lambda p, u: restless(p.shape)),
    "gain": lambda: moved_by(gain=lambda q, t: restless((1, 1))),
    "bounds": lambda: moved_by(bounds=lambda t: restless(1)),
}
REFUSED += [(call, f"{name}.* differently.*called again") for name, call in UNSTEADY.items()]
NO_NUMBERS = {
    "masked": np.ma.array([2.0], mask=[True]),
    "complex": np.array([2.0 + 1.0j]),
    "date": np.array(["2020-01-01"], "datetime64[D]"),
    "duration": np.array([2], "timedelta64[s]"),
    "text": ["2.0"],
    "nothing": None,
    "ragged": [[1.0], [1.0, 2.0]],
    "bool": [True],
}


def row(kind):
    """As states of several, of which this is one."""
    q = NO_NUMBERS[kind]
    return q if kind in ("nothing", "ragged") else (np.ma.asanyarray if kind == "masked" else np.asarray)(q)[None]


REFUSED += [(lambda kind=kind: table().contains(row(kind), start=0, within=1), "^points ") for kind in NO_NUMBERS]
REFUSED += [(lambda kind=kind: Controller(table()).select(NO_NUMBERS[kind], 0), "^a state ") for kind in NO_NUMBERS]
Q, ROW = NO_NUMBERS["complex"], NO_NUMBERS["complex"][None]
REFUSED += [  # all else that is asked with a state, states or a command
    (lambda: Controller(table()).steps_to_go(Q, 0), "^a state "),
    (lambda: Controller(table()).batch(ROW, 0), "^states "),
    (lambda: table().hazards(ROW, 0), "^states "),
    (lambda: Controller(table()).filter(Q, 0, 1), "^states "),
    (lambda: Controller(table()).filter([2.0], 0, Q), "^wanted "),
    (lambda: line().target_value(ROW, 0.0), "^points "),
    (lambda: line().unsafe_value(ROW, 0.0), "^points "),
    (lambda: line().grid.interpolate(table().values(start=0, within=1), ROW), "^points "),
    (lambda: sdhj.simulate(Controller(table()), Q), "^q0 "),
]
REFUSED += [
    (lambda name=name, wrong=wrong: replace(line(), **{name: wrong}), rf"^{name}.* sdhj\.\w+")
    for name in ("grid", "dynamics")
    for wrong in (None, "grid", Grid)
]
ARGUMENTS = [  # of which function, the function, what is said
    ("drift", lambda: 0.0, r"got \(\)"),
    ("drift", lambda a, b, c, d: a, r"got \(a, b, c"),
    (
        "drift",
        lambda q, w, s: q,
        r"known, got \(q, w",
    ),
    ("drift", lambda points, *, t=0.0: points, r"never gets t"),
    ("drift", lambda points, u, v: u, r"got \(points, u, v\)"),
    ("drift", lambda *args: args[0], r"got \(\*args\)"),
    ("drift", lambda points, *, wind: points, r"got \(points, \*, wind\)"),
    ("drift", lambda points, scale=2.0, t=0.0: points, r"got \(points, scale=2.0, t=0.0\)"),
    ("drift", max, "what it takes: wrap"),
    ("gain", lambda a, b, c, d: a, "state first and then"),
    (
        "bounds",
        lambda time: [time],
        r"are known, got \(time\)",
    ),
    ("bounds", lambda points, time: [time], r"got \(points, time\)"),
    ("velocity", lambda q, u, w: q, r"got \(q, u, w\)"),
]
OF_DYNAMICS = [  # what differs from a line on which u = 1 moves the robot, what is said
    ({"inputs": [[np.nan]]}, "inputs has a NaN"),
    ({"inputs": [1.0]}, r"have shape \(L, m\)"),
    ({"inputs": np.zeros((0, 1))}, r"input, got \(0, 1\)$"),
    ({"inputs": [["fast"]]}, "must be real numbers"),
    ({"inputs": np.zeros((65_537, 1)), "drift": np.zeros((65_537, 1))}, "65537 inputs; at most"),
    ({"drift": [[np.inf]]}, "NaN or an infinity"),
    ({"gain": [["a"]]}, "must be real numbers"),
    ({"bounds": [-0.1]}, r">= 0, got \[-0.1\]"),
    ({"bounds": [[0.1]]}, "half-widths"),
    ({"bounds": [0.1j]}, "must be real numbers"),
    ({"bounds": [np.nan]}, "bounds has a NaN"),
    ({"velocity": lambda q, u, v: q}, "give drift, with gain"),
    ({"velocity": lambda q, u, v: q, "drift": None}, "give drift, with gain"),
    (
        {"velocity": [[1.0]], "drift": None, "gain": None},
        r"v, t\), got \[\[1.0\]\]",
    ),
]
ON_A_GRID = [  # the same, where a problem is made
    ({"drift": [[1.0, 2.0]]}, r"\(1, 1\), got \(1"),
    ({"gain": [[1.0], [2.0]]}, r"1 bounds, got \(2"),
    ({"gain": [[1.0, 2.0]]}, r"1 bounds, got \(1"),
    ({"gain": [[1.0, 2.0]], "bounds": lambda t: [0.5 * t]}, "for 1 bounds, got"),
]
IN_A_PLANE = [  # and of two axes
    ({"drift": lambda p: p[:, :1]}, r"2\), got \(M, 1\)"),
    ({"drift": lambda q, u: [1.0]}, r"\(M, 2\), got \(1,\)"),
    ({"gain": lambda p: p}, r"shape \(M, 2, 1\)"),
    ({"gain": lambda q, t: [t]}, r"2, 1\), got \(1,\)"),
    ({"bounds": lambda t: 0.1}, r"v, shape \(D,\), got"),
    ({"bounds": lambda q, t: q[:, 0]}, r"shape \(M, D\), got"),
    ({"bounds": lambda t: ["a"]}, "bounds"),
    ({"bounds": lambda t: [0.1] * (1 + (t > 1))}, "times a whole number"),
    ({"drift": lambda p, u, t: p if t < 1 else -p}, r"\.py, line"),
    ({"drift": lambda p, t: p * math.sin(t)}, "drift cannot be read"),
    ({"bounds": BlackBox(lambda q, u, t: np.full((len(q), 1), 0.1))}, "BlackBox.*half-widths"),
]


def driven(two_axes=False, **change):
    """A problem of one input, whose dynamics are those of arrays but for what is changed."""
    arrays = {"inputs": [[1.0]], "drift": [[1.0]], "gain": [[1.0]], "bounds": [0.1]}
    arrays |= {"drift": [[1.0, 0.0]], "gain": [[1.0], [0.0]]} if two_axes else {}
    dynamics = Dynamics(**arrays | change)
    return zoo.plane(dynamics=dynamics) if two_axes else replace(line(), dynamics=dynamics)


def of_velocity(name, function):
    return driven(**({"drift": None, "gain": None} if name == "velocity" else {}) | {name: function})


REFUSED += [(lambda name=name, one=one: of_velocity(name, one), said) for name, one, said in ARGUMENTS]
REFUSED += [(lambda change=change: driven(**change), said) for change, said in [*OF_DYNAMICS, *ON_A_GRID]]
REFUSED += [(lambda change=change: driven(True, **change), said) for change, said in IN_A_PLANE]
SENSINGS = [
    ({"error": -0.1}, "error"),
    ({"error": [0.1, 0.1]}, "error"),
    ({"error": "much"}, "error"),
    ({"delay": 0.6}, "most delta, 0.5 s"),
    ({"jitter": 0.3}, "most delta, 0.5 s"),
    ({"delay": 0.4, "jitter": 0.1}, r"delay \+ 2 jitter"),
    ({"error": 0.6}, r"known to within \[0.6\]"),
    ({"delay": 0.1, "rest": 3}, "rest"),
    ({"error": 0.1, "memory": "yes"}, "memory"),
]
REFUSED += [
    (lambda given=given: replace(line(), sensing=sdhj.Sensing(**{"memory": False} | given)), said)
    for given, said in SENSINGS
]
GRIDS = [  # what differs from a grid in the plane, what it says
    ({"lower": ["a", 0]}, r"lower\[0\].*number.*'a'"),
    ({"upper": [1, math.inf]}, r"upper\[1\].*finite.*inf"),
    ({"upper": [1e308, 1]}, r"upper\[0\].*1e\+300.*1e\+308"),
    ({"lower": [0, -1e308]}, r"lower\[1\].*-1e\+300.*-1e\+308"),
    ({"upper": [1, -1]}, r"upper\[1\].* 0.*-1"),
    ({"lower": [0, 1]}, r"upper\[1\].* 1.* 1"),
    ({"lower": -1}, "lower.*sequence.*-1"),
    ({"upper": None}, "upper.*sequence.*None"),
    ({"upper": np.array(1.0)}, "upper.*sequence.*array"),
    ({"shape": 9}, "shape.*sequence.*9"),
    ({"shape": [9, 9.5]}, r"shape\[1\].* 5 .*9.5"),
    ({"periodic": True}, "periodic.*sequence.*True"),
    ({"periodic": ["no", True]}, r"periodic\[0\].*True or False.*'no'"),
    ({"periodic": [True, 0]}, r"periodic\[1\].*True or False.*0"),
    ({"names": 5}, "names.*sequence.*5"),
    ({"shape": [4, 9]}, r"shape\[0\].* 5 .*4"),
    ({"lower": [0] * 7, "upper": [1] * 7, "shape": [5] * 7}, "1 to 6"),
    ({"periodic": [True]}, "periodic has 1"),
]
SQUARE = {"lower": [0, 0], "upper": [1, 1], "shape": [9, 9]}
REFUSED += [(lambda change=change: Grid(**SQUARE | change), said) for change, said in GRIDS]
