"""What was got wrong by deliberate abuse: functions that lie, arrays that are no numbers, numbers without bounds."""

import os
import re
import resource
import runpy
import subprocess
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import zoo
from zoo import interval_problem, interval_table

import sdhj
from sdhj import BlackBox, Controller, Dynamics, TargetSet, UnsafeSet
from sdhj.certified import Certified
from sdhj.common import memory

ONE = np.array([2.0])


@cache
def a_line():
    """Not made while tests are collected, since to read functions kernels are compiled."""
    return interval_problem()


def on_line(**change):
    """A problem on the line, steps of 0.1 s."""
    return replace(interval_problem(), **{"delta": 0.1, "steps": 8} | change)


def moved_by(drift=((-1.0,), (0.0,), (1.0,)), gain=((1.0,),), bounds=(0.2,)):
    return Dynamics(a_line().inputs, drift, gain, bounds)


def run_python(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


# ---- values that are none


@pytest.mark.parametrize("kind", ["unsafe", "target"])
def test_a_level_set_that_is_no_number_stops_the_run(kind):
    """`clearance <= 0` is False of a NaN, which would count as clear, and as outside the target."""

    def strip(p, t):  # between the nodes, where only runs come by
        return np.where(np.abs(p[:, 0] - (1.55 if kind == "unsafe" else 0.0)) < 0.04, np.nan, np.abs(p[:, 0]) + 0.5)

    problem = interval_problem()
    changed = (UnsafeSet((0,), strip, name="strip"),) if kind == "unsafe" else TargetSet((0,), strip, "strip")
    object.__setattr__(problem, kind, changed)
    controller = Controller(replace(interval_table(), problem=problem))
    with pytest.raises(ValueError, match="level set of 'strip'"):
        sdhj.monte_carlo(controller, 500, progress=False)


def test_small_values_are_taken():
    small = TargetSet((0,), lambda p, t: 1e-30 * (np.abs(p[:, 0]) - 1.0))
    wholly = TargetSet((0,), lambda p, t: np.zeros(len(p)))
    flagged = TargetSet((0,), lambda p, t: np.where(np.abs(p[:, 0]) > 1.0, 1.0, 0.0))
    for target in (small, wholly, flagged):
        assert on_line(target=target).target == target


# ---- what moves


def test_a_set_that_comes_and_goes_is_not_static():
    def decides(p, t):
        return np.where(0.05 < t < 0.45, np.abs(p[:, 0] - 2.0) - 0.3, 3.0)

    def blink(p, t):
        return np.where((0.05 < t) & (t < 0.45), np.abs(p[:, 0] - 2.0) - 0.3, 3.0)

    with pytest.raises(ValueError, match="'blink' cannot be read"):
        UnsafeSet((0,), decides, name="blink")
    part = on_line(unsafe=(UnsafeSet((0,), blink, name="blink"),)).unsafe[0]
    found = [part.over(np.array([[2.0]]), t, t + 0.1, "swept")[0] for t in (-0.1, 0.0, 0.2, 0.4, 0.45)]
    assert part.moving and found == pytest.approx([3.0, -0.3, -0.3, -0.3, 3.0], abs=1e-12)


def test_a_moment_of_thousands_of_steps_is_met():
    def visit(p, t):
        return np.where((321.0401 < t) & (t < 321.0402), 1.0, 2.0) + 0.0 * p[:, 0]

    part = on_line(unsafe=(UnsafeSet((0,), visit, name="visit"),), steps=9000).unsafe[0]
    found = [part.over(np.zeros((1, 1)), 0.1 * k, 0.1 * (k + 1), "swept")[0] for k in (3209, 3210, 3211)]
    assert found == pytest.approx([2.0, 1.0, 2.0], abs=1e-12)


@pytest.mark.slow
def test_tables_and_proofs_see_what_comes_and_goes_between_all_samples():
    def wink(p, t):
        return np.where((t > 0.1234) & (t < 0.1235), np.abs(p[:, 0] - 2.0) - 0.3, 3.0)

    problem = on_line(unsafe=(UnsafeSet((0,), wink, name="wink"),))
    for method in ("hji", "lax", Certified(cells=[60])):
        found = sdhj.solve(problem, method, progress=False).hazards([[2.0], [0.5]], 1)
        assert (found < 0).any(axis=1).tolist() == [False, True], method
    sampled = replace(problem, view_time="sampled")
    with pytest.warns(UserWarning, match="the unsafe set 'wink'"):
        believed = sdhj.solve(sampled, progress=False).hazards([[2.0], [0.5]], 1)
    assert (believed < 0).any(axis=1).tolist() == [True, True]


@pytest.mark.slow
def test_a_swept_function_is_tried_in_every_step():
    def near(p, t):
        return np.abs(p[:, 0] - 3.0 + t) - 0.1

    def swept(p, t0, t1):
        lost = np.where((0.05 < t0) & (t0 < 0.15), 1.0, 0.0)  # in the second step alone
        times = [t0 + (t1 - t0) * share for share in np.linspace(0.0, 1.0, 50)]
        return np.minimum.reduce([near(p, t) for t in times]) - 0.01 + lost

    part = UnsafeSet((0,), near, swept, "ball")
    with pytest.raises(ValueError, match=r"'ball' over \[0.1, 0.2\]"):
        on_line(unsafe=(part,), steps=20)


@pytest.mark.parametrize(("soon", "late"), [(0.0, 0.0), (0.05, 0.0), (0.0, 0.05)])
def test_a_swept_function_is_tried_at_all_times_that_a_clock_that_is_off_allows(soon, late):
    """Of a ball that moves on by 1 m/s, which is left out at the begin or the end for as long as the clock is off."""

    def swept(p, t0, t1):
        return np.maximum(3.0 - t1 + late - p[:, 0], p[:, 0] - 3.0 + t0 + soon) - 0.1

    ball = UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] - 3.0 + t) - 0.1, swept, "ball")
    with pytest.raises(ValueError, match="swept of 'ball'") if soon or late else nullcontext():
        zoo.line(unsafe=[ball], sensing=sdhj.Sensing(jitter=0.05))


# ---- functions and the library's arrays


def test_a_reused_buffer_is_copied():
    kept = np.empty(1000)

    def reused(p, t):
        kept[: len(p)] = p[:, 0] - t
        return kept[: len(p)]

    points = np.array([[0.0], [1.0]])
    with pytest.raises(ValueError, match="'unsafe' cannot be read"):
        UnsafeSet((0,), reused)
    part = UnsafeSet((0,), BlackBox(reused))
    assert part.over(points, 0.0, 1.0, "sampled").tolist() == [-1.0, 0.0]
    rising = UnsafeSet((0,), BlackBox(lambda p, t: reused(p, -t)))  # the least value comes first
    assert rising.over(points, 0.0, 1.0, "sampled").tolist() == [0.0, 1.0]
    assert not np.shares_memory(TargetSet((0,), BlackBox(reused)).level_set(points, 0.0), kept)


def test_a_network_in_single_precision_is_taken(rng):
    """As a black box; what it says of a point is rounded otherwise beside others, and it may read memory as it lies."""
    widths = ((1, 64), (64, 64), (64, 1))
    layers = [rng.normal(size=shape).astype(np.float32) / np.float32(np.sqrt(shape[0])) for shape in widths]

    def net(p):
        assert not isinstance(p, np.ndarray) or p.flags.c_contiguous
        return np.tanh(np.tanh(p.astype(np.float32) @ layers[0]) @ layers[1]) @ layers[2]

    def drift(p, u):
        return 0.1 * net(p) + u

    with pytest.raises(ValueError, match="under input 0 cannot"):
        moved_by(drift).read(1)
    problem = on_line(dynamics=moved_by(BlackBox(drift, rate=0.0)))
    assert problem.opaque == {"drift": "a BlackBox with rate"}
    assert sdhj.solve(problem, progress=False).contains([[0.0]], start=0, within=8).all()


def test_rules_and_adversaries_read_only():
    controller, kept = Controller(interval_table()), np.zeros((1, 1))

    def greedy(among):
        among.batch.margins[:] = 0.0
        return among.margins

    def pushing(moment):
        moment.states[:] = 0.0
        return np.zeros_like(moment.previous)

    def reused(moment):
        kept[:] = 0.1 * np.cos(moment.substep)
        return kept

    with pytest.raises(ValueError, match="read-only"):
        Controller(interval_table(), greedy).select(ONE, 0)
    with pytest.raises(ValueError, match="read-only"):
        sdhj.simulate(controller, ONE, pushing)
    played = sdhj.simulate(controller, ONE, reused).disturbances[:20, 0]
    assert played == pytest.approx(0.1 * np.cos(np.arange(20)))


# ---- numbers without bounds, and memory


@pytest.mark.parametrize("asked", ["0", "4097", "1.5", ""])
def test_a_number_of_threads_that_is_none_is_told(asked, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", asked)
    with pytest.warns(UserWarning, match=f"NUMBA_NUM_THREADS.* 4096.* {asked};"):
        runpy.run_path(sdhj.__file__)
    assert "NUMBA_NUM_THREADS" not in os.environ


@pytest.mark.slow
def test_before_numba_is_imported():
    done = run_python("import sdhj, numba; print(numba.get_num_threads())", NUMBA_NUM_THREADS="many")
    assert done.returncode == 0 and int(done.stdout) >= 1, done.stderr
    assert re.search("NUMBA_NUM_THREADS.* 4096.* many;", done.stderr) and "Traceback" not in done.stderr


@pytest.mark.slow
def test_address_space_is_a_limit_and_is_named():
    code = "\n".join(
        [
            "import resource, sdhj",
            "from sdhj.common import memory",
            "resource.setrlimit(resource.RLIMIT_AS, (3 * 10**9, resource.RLIM_INFINITY))",
            "memory.require_memory(10**8, 'little')",
            "memory.require_memory(29 * 10**8, 'much')",
        ]
    )
    done = run_python(code, OPENBLAS_NUM_THREADS="1")
    assert done.returncode == 1, done.stderr
    assert re.search("much needs.* 2.9.*3 GB of address space.*ulimit -v.*fewer nodes", done.stderr), done.stderr


def put(folder, **files):
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name.replace("__", ".")).write_text(text)


def test_control_groups_of_both_versions_are_limits_and_are_named(tmp_path):
    own, root = tmp_path / "cgroup", tmp_path / "fs"
    own.write_text("0::/outer/inner\n")
    put(root, memory__current="1\n")
    put(
        root / "outer",
        memory__max="1000000000\n",
        memory__current="900000000\n",
        memory__stat="file 7\ninactive_file 5\n",
    )
    put(root / "outer/inner", memory__max="max\n", memory__current="900000000\n", memory__stat="inactive_file 5\n")
    ((left, said),) = memory.of_control_groups(root, own)
    assert left == 100_000_005 and "1 GB" in said and said.endswith(str(root / "outer"))
    own.write_text("3:cpu,cpuacct:/\n2:memory:/not/seen/from/here\n1:name=systemd:/\n")
    put(
        root / "memory",
        memory__limit_in_bytes="500\n",
        memory__usage_in_bytes="600\n",
        memory__stat="total_inactive_file 50\ninactive_file 1\n",
    )
    ((left, said),) = memory.of_control_groups(root, own)
    assert left == 0 and "5e-07 GB" in said and said.endswith(str(root / "memory"))
    assert list(memory.of_control_groups(root, tmp_path / "absent")) == []


def test_a_certified_table_too_large_is_refused_before_it_is_begun():
    problem, began = sdhj.arm_case_study(nodes=5, steps=1), time.perf_counter()
    with pytest.raises(MemoryError, match="use fewer cells"):
        sdhj.solve(problem, Certified(cells=(5000, 5000, 300, 300)), progress=False)
    assert time.perf_counter() - began < 10  # minutes, where every image is worked out first


def test_the_limit_that_this_process_has_is_read(monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda which: (10**12, 10**12) if which == resource.RLIMIT_AS else None)
    ((left, said),) = memory.of_process()
    assert 0 < left < 10**12 and "1e+03 GB of address" in said
