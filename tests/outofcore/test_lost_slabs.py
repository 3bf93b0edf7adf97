"""A solve that is stopped goes on where it was and ends with the same bits; what is damaged or missing is said."""

import errno
import os
import pickle
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
import toys
from slabbed import assert_bit_equal, lines_of, room

import sdhj
from sdhj import outofcore
from sdhj.solver import recursion
from sdhj.table import store as store_module
from sdhj.table.store import head_of_store
from sdhj.table.table import LookupTable

SCRIPT = """
import os, sys
sys.path.insert(0, {tests!r})
import toys, sdhj
from sdhj.table.store import Store
enter, sent = Store.record_finished, []
def stopped(self, slab, digest):
    lines = [line for line in self.finished_slabs if line.array == "tubes"]
    if {number} and not sent and len(lines) >= 5:
        with open(self.path / "ledger", "ab") as ledger:
            ledger.write(b"\\ntubes 1 1 0123")
        sent.append(os.kill(os.getpid(), {number}))
    return enter(self, slab, digest)
Store.record_finished = stopped
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
    path = tmp_path_factory.mktemp("stores") / "t"
    sdhj.solve(problem, store=path, memory=memory)
    return path


@pytest.fixture
def store(finished, tmp_path):
    shutil.copytree(finished, tmp_path / "t")
    return tmp_path / "t"


class Stopped(Exception):
    pass


def stop_after(monkeypatch, tasks, error):
    """Have a solve fail with an error after some tasks."""
    counted, work = [], recursion.work

    def limited(plan, store, task):
        if len(counted) == tasks:
            raise error
        counted.append(task)
        return work(plan, store, task)

    monkeypatch.setattr(outofcore, "work", limited)
    return counted


@pytest.mark.slow
@pytest.mark.parametrize("tasks", [0, 9, 30])
def test_a_stopped_solve_goes_on(problem, memory, table, tmp_path, monkeypatch, tasks):
    stop_after(monkeypatch, tasks, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        sdhj.solve(problem, store=tmp_path / "t", memory=memory)
    with pytest.raises(sdhj.TableFileError, match=r"is not finished; go on with .*resume=True"):
        sdhj.load(tmp_path / "t", problem=problem)
    with pytest.raises(FileExistsError, match="exists already; go on with it by resume=True, remove it"):
        sdhj.solve(problem, store=tmp_path / "t")
    monkeypatch.undo()
    done = stop_after(monkeypatch, 10**6, Stopped())
    stored = sdhj.solve(problem, store=tmp_path / "t", resume=True)
    slabs = stored.details["slabs"]
    assert len(done) + tasks == slabs * (10 - stored.details["tubes_shared"]) + 3 * slabs  # nothing is done twice
    assert_bit_equal(stored, table)


def run_until(store, memory, number, resume=False, preexec=None):
    """Solve in a process of its own, which gets a signal while it writes a tube and some others are there."""
    told = {"store": str(store), "memory": memory, "resume": resume, "number": int(number or 0)}
    text = SCRIPT.format(tests=str(Path(toys.__file__).parent), **told)
    command = [sys.executable, "-c", text]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, preexec_fn=preexec, timeout=300)
    return done.returncode, done.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("signals_are_heard")
@pytest.mark.parametrize(
    "number",
    [signal.SIGKILL, *(pytest.param(other, marks=pytest.mark.slow) for other in (signal.SIGTERM, signal.SIGINT))],
)
def test_signals_lose_nothing(problem, memory, table, tmp_path, number):
    ended, _ = run_until(tmp_path / "t", memory, number)
    assert ended == -number
    assert len(lines_of(tmp_path / "t", "tubes")) >= 5 and "tubes 1 1 0123" in lines_of(tmp_path / "t", "tubes")
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t", resume=True), table)


def test_resume_begins_where_there_is_nothing(problem, memory, table, tmp_path):
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t", memory=memory, resume=True), table)


def test_a_full_disk(problem, memory, table, tmp_path, monkeypatch):
    synced, as_it_is = [], os.fsync

    def full(number):
        if synced.append(number) or len(synced) > 40:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return as_it_is(number)

    monkeypatch.setattr(store_module.os, "fsync", full)
    with pytest.raises(
        OSError, match=r"cannot write in .*: No space left on device; what is finished stays: make room"
    ):
        sdhj.solve(problem, store=tmp_path / "t", memory=memory)
    monkeypatch.undo()
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t", resume=True), table)


@pytest.mark.slow
def test_sixty_kills(table, memory, tmp_path):
    """At times as they come, from before there is a store to after it is whole."""
    path, rng, killed = tmp_path / "t", np.random.default_rng(0), 0
    text = SCRIPT.format(tests=str(Path(toys.__file__).parent), store=str(path), memory=memory, resume=True, number=0)
    begun = time.monotonic()
    subprocess.run([sys.executable, "-c", text], check=True)
    lasted = time.monotonic() - begun
    for number in range(60):
        if number % 6 == 0:
            shutil.rmtree(path, ignore_errors=True)
        child = subprocess.Popen([sys.executable, "-c", text])
        try:
            child.wait(rng.uniform(0.5, 1.0) * lasted)
        except subprocess.TimeoutExpired:
            child.kill()
        killed += child.wait() == -signal.SIGKILL
    assert killed > 10
    assert_bit_equal(sdhj.solve(toys.torus_problem(nodes=40), store=path, memory=memory, resume=True), table)


@pytest.mark.slow
def test_files_that_may_not_grow(problem, memory, table, tmp_path):
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))  # noqa: E731
    ended, said = run_until(tmp_path / "t", memory, None, preexec=limit)
    assert ended != 0
    assert "File too large" in said.splitlines()[-1]
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t", memory=memory, resume=True), table)


# ---- damage


@pytest.fixture
def few(tmp_path):
    """A store of few slabs, as all of them are read each time, and its problem."""
    problem = toys.torus_problem(nodes=12, steps=2)
    sdhj.solve(problem, store=tmp_path / "few", memory=room(problem, width=6))
    return problem, tmp_path / "few"


@pytest.mark.slow
def test_every_flipped_byte_is_found(few, rng):
    problem, store = few
    table = sdhj.solve(problem)
    for name in ("tubes", "marks", "avoid_moving"):
        file = store / f"{name}.npy"
        whole, begin = file.read_bytes(), 128
        for place in [begin, len(whole) - 1, *rng.integers(begin, len(whole), 4)]:
            file.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
            for resume in (False, True):
                with pytest.raises(sdhj.TableFileError, match=r"is damaged, or .*; delete the line") as told:
                    sdhj.solve(problem, store=store, resume=True) if resume else sdhj.load(store, problem=problem)
        for length in (0, len(whole) - 1):
            file.write_bytes(whole[:length])
            with pytest.raises(sdhj.TableFileError, match=rf"{name}\.npy is missing, damaged or of another store"):
                sdhj.load(store, problem=problem)
        file.unlink()
        with pytest.raises(sdhj.TableFileError, match=rf"{name}\.npy is missing, damaged or of another store"):
            sdhj.load(store, problem=problem)
        file.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
        ledger = store / "ledger"
        with pytest.raises(sdhj.TableFileError, match="delete the line") as told:
            sdhj.load(store, problem=problem)
        line = re.search("the line that begins '(.*)' from", str(told.value))[1]
        kept = [one for one in ledger.read_text().splitlines() if not one.startswith(f"{line} ")]
        ledger.write_text("\n".join(kept))
        with pytest.raises(sdhj.TableFileError, match=r"1 slabs of .* not in its ledger.*; solve with resume=True"):
            sdhj.load(store, problem=problem)
        assert_bit_equal(sdhj.solve(problem, store=store, resume=True), table)
        assert_bit_equal(sdhj.load(store), table)


@pytest.mark.slow
def test_twenty_swapped_slabs_are_refused(problem, store, rng):
    """Also where the ledger's lines are swapped with them."""
    for number in range(20):
        name = ("tubes", "marks", "avoid_moving")[number % 3]
        whole, values = (store / f"{name}.npy").read_bytes(), np.load(store / f"{name}.npy")
        blocks = values.reshape(len(values), -1, 4, 10 * 40)  # slabs of ten rows
        while True:
            one, other = (tuple(rng.integers(0, n) for n in (len(values), 4)) for _ in range(2))
            if not np.array_equal(blocks[one[0], :, one[1]], blocks[other[0], :, other[1]]):
                break
        kept = blocks[one[0], :, one[1]].copy()
        blocks[one[0], :, one[1]], blocks[other[0], :, other[1]] = blocks[other[0], :, other[1]], kept
        np.save(store / f"{name}.npy", values)
        ledger = (store / "ledger").read_text()
        line = "tubes" if name == "marks" else name
        first, second = (f"\n{line} {place} {slab} " for place, slab in (one, other))
        swapped = ledger.replace(first, "\n?").replace(second, first).replace("\n?", second)
        for text in (ledger, swapped):
            (store / "ledger").write_text(text)
            with pytest.raises(sdhj.TableFileError, match="is damaged, or parts of it are not what was written"):
                sdhj.load(store)
            with pytest.raises(sdhj.TableFileError, match="is damaged, or parts of it are not what was written"):
                sdhj.solve(problem, store=store, resume=True)
        (store / "ledger").write_text(ledger)
        (store / f"{name}.npy").write_bytes(whole)
    assert sdhj.load(store).steps == 3


@pytest.mark.parametrize("foreign", [["tubes.npy"], ["tubes.npy", "ledger"], ["head"], ["index"]])
def test_what_comes_from_another_store_is_refused(problem, memory, store, tmp_path, foreign):
    other = toys.torus_problem(nodes=40, view_time="sampled")
    sdhj.solve(other, store=tmp_path / "other", memory=memory)
    for name in foreign:
        shutil.copy(tmp_path / "other" / name, store / name)
    wrong = pytest.raises(sdhj.TableFileError, match=r"is damaged|of another store|another problem")
    with wrong:
        sdhj.load(store, problem=problem)
    if foreign != ["index"]:  # which a solve writes anew
        with wrong:
            sdhj.solve(problem, store=store, resume=True)


def test_a_store_that_tells_something_else(problem, store):
    told = store / "head"
    whole = told.read_text()
    for text in (whole.replace("delta", "Delta", 1), whole[: len(whole) // 2], ""):
        told.write_text(text)
        with pytest.raises(
            sdhj.TableFileError, match=r"t/head is missing, damaged or of another store .*; solve it anew"
        ):
            sdhj.load(store, problem=problem)
    told.write_text(whole)
    np.save(store / "tubes.npy", np.load(store / "tubes.npy").astype(np.float64))
    with pytest.raises(sdhj.TableFileError, match=r"tubes\.npy .* of another store \(it is float64"):
        sdhj.load(store, problem=problem)


def test_a_zarr_store_is_refused_in_a_line(problem, tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "zarr.json").write_text("{}")
    for use in (lambda: sdhj.load(tmp_path / "old"), lambda: sdhj.solve(problem, store=tmp_path / "old", resume=True)):
        with pytest.raises(sdhj.TableFileError, match=r"old is a Zarr store, .*; solve it anew$"):
            use()


# ---- as any other table


def test_a_stored_table_is_a_look_up_table_on_maps(problem, table, store):
    """Its queries compile nothing and give the same bits; its pickle is its name."""
    read = sdhj.load(store)
    assert isinstance(read, LookupTable) and isinstance(read.tubes.base, np.memmap)
    for name in ("index", "tubes", "marks"):
        one, other = (getattr(of, name) for of in (read, table))
        assert numba.typeof(one) == numba.typeof(other)
    assert numba.typeof(read.avoid.moving) == numba.typeof(table.avoid.moving)
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2))
    for one, other in zip(read.batch(states, 0), table.batch(states, 0), strict=True):
        np.testing.assert_array_equal(one, other)
    told = pickle.dumps(read)
    assert len(told) < 1000
    assert_bit_equal(pickle.loads(told), table)
    changed = replace(read, details={"changed": True})
    assert pickle.loads(pickle.dumps(changed)).details == {"changed": True}


def test_a_store_on_a_disk_that_is_only_read(table, store):
    for path in (*store.rglob("*"), store):
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        assert_bit_equal(sdhj.load(store), table)
    finally:
        for path in (store, *store.rglob("*")):
            path.chmod(0o755)


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
    monkeypatch.setattr(outofcore, "VERSION", "9.9")
    with pytest.raises(sdhj.TableFileError, match=r"was begun by sdhj .*, and this is 9\.9, which may round otherwise"):
        sdhj.solve(problem, store=store, resume=True)
    sdhj.load(store, problem=problem)  # to be read it need not be the same


@pytest.mark.slow
def test_two_processes_on_one_store(problem, memory, table, tmp_path, monkeypatch):
    path = tmp_path / "t"
    stop_after(monkeypatch, 9, Stopped())
    with pytest.raises(Stopped):
        sdhj.solve(problem, store=path, memory=memory)
    with ThreadPoolExecutor(2) as pool:
        both = [pool.submit(run_until, path, memory, None, resume=True) for _ in range(2)]
    assert [one.result()[0] for one in both] == [0, 0], both
    assert_bit_equal(sdhj.load(path), table)


def test_a_folder_that_cannot_be_written(problem, memory, tmp_path, monkeypatch):
    with pytest.raises(OSError, match=r"cannot write in .*; choose a folder that exists and can be written"):
        sdhj.solve(problem, store=tmp_path / "nowhere" / "deep" / "t", memory=memory)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot write in"):
        sdhj.solve(problem, store=tmp_path / "file" / "t", memory=memory)
    if os.geteuid():  # the superuser may write anywhere
        tmp_path.chmod(0o500)
        with pytest.raises(OSError, match="cannot write in"):
            sdhj.solve(problem, store=tmp_path / "t", memory=memory)
        tmp_path.chmod(0o700)


# ---- before anything is written


def test_what_is_not_solved_out_of_core_is_refused(problem, tmp_path):
    def solve(given, method="hji", **options):
        return sdhj.solve(given, method, store=tmp_path / "t", **options)

    timed = sdhj.Dynamics(problem.inputs, lambda q, u, t: u * np.cos(t), np.eye(2), [0.4, 0.4])
    still = replace(problem, unsafe=(), target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(*p.T) - 0.8))
    safe = sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [9, 9], ends=["safe", "wall"])
    fence = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.4)
    refused = {
        "method 'projected'": (problem, sdhj.Projected(((0,), (1,)))),
        'games="joint"': (problem, sdhj.HJI(games="joint")),
        "steps=None": (replace(still, steps=None), "hji"),
        "sensing": (replace(problem, sensing=sdhj.Sensing(error=0.01, memory=False)), "hji"),
        "dynamics that depend on time": (replace(problem, dynamics=timed), "hji"),
        "safe ends": (replace(still, grid=safe, target=None, unsafe=(fence,)), "hji"),
    }
    for what, (given, method) in refused.items():
        with pytest.raises(ValueError, match=f"a store does not take {what}.*; leave store= out"):
            solve(given, method)
    with pytest.raises(ValueError, match="store must be the name of a folder, got 5"):
        sdhj.solve(problem, store=5)
    with pytest.raises(ValueError, match="memory must be a whole number"):
        solve(problem, memory=0)
    with pytest.raises(ValueError, match="resume must be True or False, got 'no'"):
        solve(problem, resume="no")
    with pytest.raises(ValueError, match=r"client must be a distributed\.Client, got 5"):
        solve(problem, client=5)
    assert not list(tmp_path.iterdir())


def test_the_disk_is_looked_at_first(problem, memory, tmp_path, monkeypatch):
    class Little:
        free = 1000

    monkeypatch.setattr(store_module.shutil, "disk_usage", lambda _: Little)
    stop_after(monkeypatch, 0, Stopped())
    with pytest.warns(UserWarning, match=r"takes up to .* GB, and 1e-06 GB are free"):
        with pytest.raises(Stopped):
            sdhj.solve(problem, store=tmp_path / "t", memory=memory)


def test_progress_states_what_a_solve_costs_and_comes_to_it(problem, memory, tmp_path, capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stored = sdhj.solve(problem, store=tmp_path / "t", memory=memory, progress=True)
    shown = capsys.readouterr().err
    assert stored.details["slabs"] > 1 and "0.00/" in shown
    assert re.search("op/s, 6 tubes, at most .* GB and .* GB on disk", shown)
    part, total = re.findall(r"([\d.]+\w)/([\d.]+\w)", shown)[-1]
    assert part == total
    assert head_of_store(tmp_path / "t")[0]["cut"] == [0, 10]
