"""A solve that is stopped goes on where it was and ends with the same bits; what is damaged or missing is said."""

import errno
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import toys
from slabbed import assert_bit_equal, files_of, room

import sdhj
from sdhj.outofcore import slabs as slabs_module
from sdhj.outofcore import solve as solve_module
from sdhj.outofcore import store as store_module
from sdhj.outofcore.store import TableStore, chunked

SCRIPT = """
import os, sys
sys.path.insert(0, {tests!r})
import toys, sdhj
from zarr.storage import _local
put, sent = _local._put, []
def stopped(path, value, **options):
    if {number} and not sent and path.parent.name == "tubes" and len(list(path.parent.glob("c.*[0-9]"))) >= 5:
        path.with_suffix(".0.partial").write_bytes(bytes(value.as_buffer_like())[:10])
        sent.append(os.kill(os.getpid(), {number}))
    return put(path, value, **options)
_local._put = stopped
sdhj.solve(toys.torus_problem(nodes=40), store={store!r}, memory={memory}, resume={resume})
"""


@pytest.fixture(scope="module")
def problem():
    return toys.torus_problem(nodes=40)


@pytest.fixture(scope="module")
def memory(problem):
    return room(problem, width=10)


@pytest.fixture(scope="module")
def table(problem):
    return sdhj.solve(problem)


@pytest.fixture(scope="module")
def finished(problem, memory, tmp_path_factory):
    path = tmp_path_factory.mktemp("stores") / "t.zarr"
    sdhj.solve(problem, store=path, memory=memory)
    return path


@pytest.fixture
def store(finished, tmp_path):
    shutil.copytree(finished, tmp_path / "t.zarr")
    return tmp_path / "t.zarr"


class Stopped(Exception):
    pass


def stop_after(monkeypatch, tasks, error):
    """Have a solve fail with an error after some tasks."""
    counted, work = [], slabs_module.work

    def limited(plan, task):
        if len(counted) == tasks:
            raise error
        counted.append(task)
        return work(plan, task)

    monkeypatch.setattr(solve_module, "work", limited)
    return counted


@pytest.mark.parametrize("tasks", [0, 9, 30])
def test_a_stopped_solve_goes_on(problem, memory, table, tmp_path, monkeypatch, tasks):
    stop_after(monkeypatch, tasks, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        sdhj.solve(problem, store=tmp_path / "t.zarr", memory=memory)
    with pytest.raises(sdhj.TableFileError, match=r"is not finished; go on with .*resume=True"):
        sdhj.load(tmp_path / "t.zarr", problem=problem)
    with pytest.raises(FileExistsError, match="exists already; go on with it by resume=True, remove it"):
        sdhj.solve(problem, store=tmp_path / "t.zarr")
    monkeypatch.undo()
    done = stop_after(monkeypatch, 10**6, Stopped())
    stored = sdhj.solve(problem, store=tmp_path / "t.zarr", resume=True)
    slabs = stored.details["slabs"]
    assert len(done) + tasks == slabs * (10 - stored.details["tubes_shared"]) + 1 + 3 * slabs  # nothing is done twice
    assert_bit_equal(stored, table)


def run_until(store, memory, number, resume=False, preexec=None):
    """Solve in a process of its own, which gets a signal while it writes a tube and some others are there."""
    told = {"store": str(store), "memory": memory, "resume": resume, "number": int(number or 0)}
    text = SCRIPT.format(tests=str(Path(toys.__file__).parent), **told)
    command = [sys.executable, "-c", text]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, preexec_fn=preexec, timeout=300)
    return done.returncode, done.stderr


@pytest.mark.usefixtures("signals_are_heard")
@pytest.mark.parametrize(
    "number",
    [signal.SIGKILL, *(pytest.param(other, marks=pytest.mark.slow) for other in (signal.SIGTERM, signal.SIGINT))],
)
def test_signals_lose_nothing(problem, memory, table, tmp_path, number):
    ended, _ = run_until(tmp_path / "t.zarr", memory, number)
    assert ended == -number
    assert len(files_of(tmp_path / "t.zarr", "tubes")) >= 5 and list((tmp_path / "t.zarr").rglob("*.partial"))
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t.zarr", resume=True), table)


def test_resume_begins_where_there_is_nothing(problem, memory, table, tmp_path):
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t.zarr", memory=memory, resume=True), table)


def test_a_full_disk(problem, memory, table, tmp_path, monkeypatch):
    from zarr.storage import _local

    written, as_it_is = [], _local._put

    def full(path, value, **options):
        if written.append(path) or len(written) > 40:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_suffix(".0.partial").write_bytes(bytes(value.as_buffer_like())[:10])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return as_it_is(path, value, **options)

    monkeypatch.setattr(_local, "_put", full)
    with pytest.raises(
        OSError, match=r"cannot write in .*: No space left on device; what is finished stays: make room"
    ):
        sdhj.solve(problem, store=tmp_path / "t.zarr", memory=memory)
    monkeypatch.undo()
    assert list((tmp_path / "t.zarr").rglob("*.partial"))
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t.zarr", resume=True), table)


@pytest.mark.slow
def test_files_that_may_not_grow(problem, memory, table, tmp_path):
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))  # noqa: E731
    ended, said = run_until(tmp_path / "t.zarr", memory, None, preexec=limit)
    assert ended != 0
    assert "File too large" in said.splitlines()[-1]
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t.zarr", memory=memory, resume=True), table)


# ---- damage


def test_every_flipped_byte_of_a_chunk_is_found(tmp_path):
    """Of a store of few chunks, as all of them are read each time."""
    problem, store, rng = toys.torus_problem(nodes=12, steps=2), tmp_path / "few.zarr", np.random.default_rng(0)
    table = sdhj.solve(problem)
    sdhj.solve(problem, store=store, memory=room(problem, width=6))
    for name in ("tubes", "masks", "avoid_moving"):
        file = files_of(store, name)[-1]
        whole = file.read_bytes()
        for place in [0, len(whole) - 1, *rng.integers(0, len(whole), 4)]:
            file.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
            with pytest.raises(
                sdhj.TableFileError, match=f"{name}.* is damaged .*; delete it and solve with resume=True"
            ):
                sdhj.load(store, problem=problem).loaded()
        for length in (0, len(whole) - 1):
            file.write_bytes(whole[:length])
            with pytest.raises(sdhj.TableFileError, match=f"{name}.* is damaged"):
                sdhj.load(store, problem=problem).loaded()
        file.unlink()
        with pytest.raises(sdhj.TableFileError, match=f"{name}.* is missing; solve with resume=True"):
            sdhj.load(store, problem=problem).loaded()
        file.write_bytes(whole)
    for name in ("tubes", "masks", "avoid_moving"):
        files_of(store, name)[-2].unlink()
    assert_bit_equal(sdhj.solve(problem, store=store, resume=True), table)


def test_the_controller_says_what_is_missing(problem, store):
    for file in files_of(store, "tubes"):
        file.unlink()
    table = sdhj.load(store, problem=problem)
    with pytest.raises(sdhj.TableFileError, match="is missing; solve with resume=True"):
        sdhj.Controller(table).select([0.0, 0.0], 0)


def test_a_store_that_tells_something_else(problem, store):
    told = store / "zarr.json"
    whole = told.read_text()
    for text in (whole.replace("delta", "Delta", 1), whole[: len(whole) // 2], ""):
        told.write_text(text)
        with pytest.raises(sdhj.TableFileError, match=r"t\.zarr is damaged or no store of a table .*; solve it anew"):
            sdhj.load(store, problem=problem)
    told.write_text(whole)
    array = store / "tubes" / "zarr.json"
    array.write_text(array.read_text().replace("float32", "float64"))
    with pytest.raises(sdhj.TableFileError, match=r"its array tubes is float64"):
        sdhj.load(store, problem=problem)


# ---- whose store it is


def test_a_store_of_another_problem_is_refused(problem, store):
    round_target = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(*p.T) - 0.8)
    others = {
        "nodes": toys.torus_problem(nodes=41),
        "steps": toys.torus_problem(nodes=40, steps=4),
        "view_time": toys.torus_problem(nodes=40, view_time="sampled"),
        "values": sdhj.ReachAvoidProblem(
            problem.grid,
            problem.dynamics,
            round_target,
            problem.unsafe,
            0.2,
            3,
        ),
    }
    for other in others.values():
        with pytest.raises(sdhj.TableFileError, match="another problem"):
            sdhj.solve(other, store=store, resume=True)
        with pytest.raises(sdhj.TableFileError, match="another problem"):
            sdhj.load(store, problem=other)
    with pytest.raises(sdhj.TableFileError, match=r"is being solved by method 'hji' with .* and this is 'lax'"):
        sdhj.solve(problem, "lax", store=store, resume=True)
    assert sdhj.load(store).problem.digest == problem.digest  # its formulas are in it


def test_a_store_of_another_version_is_refused(problem, store, monkeypatch):
    monkeypatch.setattr(solve_module, "VERSION", "9.9")
    with pytest.raises(sdhj.TableFileError, match=r"was begun by sdhj .*, and this is 9\.9, which may round otherwise"):
        sdhj.solve(problem, store=store, resume=True)
    sdhj.load(store, problem=problem)  # to be read it need not be the same


def test_two_processes_on_one_store(problem, memory, table, tmp_path, monkeypatch):
    path = tmp_path / "t.zarr"
    stop_after(monkeypatch, 9, Stopped())
    with pytest.raises(Stopped):
        sdhj.solve(problem, store=path, memory=memory)
    with ThreadPoolExecutor(2) as pool:
        both = [pool.submit(run_until, path, memory, None, resume=True) for _ in range(2)]
    assert [one.result()[0] for one in both] == [0, 0], both
    assert_bit_equal(sdhj.load(path), table)


def test_a_folder_that_cannot_be_written(problem, memory, tmp_path, monkeypatch):
    with pytest.raises(OSError, match=r"cannot write in .*; choose a folder that exists and can be written"):
        sdhj.solve(problem, store=tmp_path / "nowhere" / "deep" / "t.zarr", memory=memory)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot write in"):
        sdhj.solve(problem, store=tmp_path / "file" / "t.zarr", memory=memory)
    if os.geteuid():  # the superuser may write anywhere
        tmp_path.chmod(0o500)
        with pytest.raises(OSError, match="cannot write in"):
            sdhj.solve(problem, store=tmp_path / "t.zarr", memory=memory)
        tmp_path.chmod(0o700)


# ---- before anything is written


def test_what_is_not_solved_out_of_core_is_refused(problem, tmp_path):
    from dataclasses import replace

    def solve(given, method="hji", **options):
        return sdhj.solve(given, method, store=tmp_path / "t.zarr", **options)

    timed = sdhj.Dynamics(problem.inputs, lambda q, u, t: u * np.cos(t), np.eye(2), [0.4, 0.4])
    still = replace(problem, unsafe=(), target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(*p.T) - 0.8))
    safe = sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [9, 9], ends=["safe", "wall"])
    fence = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.4)
    refused = {
        "method 'projected'": (problem, sdhj.Projected(((0,), (1,)))),
        'games="joint"': (problem, sdhj.HJI(games="joint")),
        "steps=None": (replace(still, steps=None), "hji"),
        "sensing": (replace(problem, sensing=sdhj.Sensing(error=0.01)), "hji"),
        "dynamics that depend on time": (replace(problem, dynamics=timed), "hji"),
        "safe ends": (replace(still, grid=safe, target=None, unsafe=(fence,)), "hji"),
    }
    for what, (given, method) in refused.items():
        with pytest.raises(ValueError, match=f"a store does not take {what}.*; leave store= out"):
            solve(given, method)
    with pytest.raises(ValueError, match="resume, client and memory apply to a store only"):
        sdhj.solve(problem, resume=True)
    with pytest.raises(
        MemoryError, match=r"a slab of one node along axis 0 takes .* are allowed; give more as memory="
    ):
        solve(problem, memory=1000)
    with pytest.raises(ValueError, match="store must be the name of a folder, got 5"):
        sdhj.solve(problem, store=5)
    with pytest.raises(ValueError, match="memory must be a whole number"):
        solve(problem, memory=0)
    assert not list(tmp_path.iterdir())


def test_the_disk_is_looked_at_first(problem, memory, tmp_path, monkeypatch):
    class Little:
        free = 1000

    monkeypatch.setattr(store_module.shutil, "disk_usage", lambda _: Little)
    stop_after(monkeypatch, 0, Stopped())
    with pytest.warns(UserWarning, match=r"takes up to .* GB, less what compression saves, and 1e-06 GB are free"):
        with pytest.raises(Stopped):
            sdhj.solve(problem, store=tmp_path / "t.zarr", memory=memory)


@pytest.mark.parametrize("shape", [(7,), (40, 40), (25, 25, 25, 25), (9, 101, 3), (13,) * 6])
@pytest.mark.parametrize("width", [1, 5, 16, 17, 40])
def test_chunks_and_shards(shape, width):
    for cut in (None, 0, len(shape) - 1):
        chunks, shards = chunked(shape, cut, width, 16)
        assert all(s % c == 0 for s, c in zip(shards, chunks, strict=True))
        assert cut is None or shards[cut] == min(width, shape[cut])
        assert all(s >= n for axis, (s, n) in enumerate(zip(shards, shape, strict=True)) if axis != cut)
        assert 16 * np.prod(chunks) <= store_module.CHUNK_BYTES or len(shape) == 1


@pytest.mark.parametrize("shape", [(17,) * 5, (25,) * 5, (40,) * 5, (37,) * 4, (20,) * 6])
@pytest.mark.parametrize("each", [4, 100])
def test_files_hold_little_beyond_the_grid(shape, each):
    """Chunks of a size that does not divide an axis reach beyond its end, and what is there is packed and read too."""
    chunks, files = chunked(shape, None, shape[0], each)
    assert np.prod(files) <= 1.1 * np.prod(shape)
    assert store_module.CHUNK_BYTES / 4 <= each * np.prod(chunks) <= store_module.CHUNK_BYTES


def test_an_array_is_one_folder(store):
    """A folder for each index of each file would cost more than the file."""
    assert not [path for name in store_module.NAMES for path in (store / name).iterdir() if path.is_dir()]


def test_progress_states_what_a_solve_costs_and_comes_to_it(problem, memory, tmp_path, capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stored = sdhj.solve(problem, store=tmp_path / "t.zarr", memory=memory, progress=True)
    shown = capsys.readouterr().err
    assert stored.details["slabs"] > 1 and "op/s, 6 tubes, at most" in shown and "0.00/" in shown
    part, total = re.findall(r"([\d.]+\w)/([\d.]+\w)", shown)[-1]
    assert part == total
    assert TableStore(tmp_path / "t.zarr").head["cut"] == [0, 10]
