"""A solve on disk has the bits of one in memory, goes on where it was stopped, and says what is in its way."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zoo
from digest_cases import CASES
from on_disk import assert_bit_equal
from room import room

import sdhj
from sdhj.solver import entries
from sdhj.solver.entries import Folder
from sdhj.solver.joint import Joint

SCRIPT = """
import os, signal, sys
import numpy as np
sys.path.insert(0, {tests!r})
import zoo, sdhj
from sdhj.solver.entries import Folder
write, counted = Folder.write, []
def stopped(self, name, values, positions=(0,)):
    counted.append(name)
    if len(counted) == {writes}:
        torn = np.array(values)
        torn.reshape(-1)[torn.size // 2 :] = 0
        write(self, name, torn, positions)
        os.kill(os.getpid(), signal.{signal})
    return write(self, name, values, positions)
Folder.write = stopped
sdhj.solve(zoo.torus_problem(nodes=24), store={store!r}, resume=True, progress=False)
"""
TESTS = str(Path(zoo.__file__).parent)


def settling(steps=20):
    """A line on which tubes stop growing while a set moves at first: entries share tubes, and are no single row."""
    ball = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0] + 0.1 * np.minimum(t, 0.35)) - 0.3, name="ball")
    return zoo.line(grid=sdhj.Grid([-3.0], [3.0], [49]), target=zoo.goal(2.0, 0.4), unsafe=[ball], steps=steps)


@pytest.fixture(scope="module")
def problem():
    return zoo.torus_problem(nodes=24)


@pytest.fixture(scope="module")
def table(problem):
    return sdhj.solve(problem, progress=False)


class Stopped(Exception):
    pass


def stop_after(monkeypatch, parts, error):
    """Have a solve fail with an error after some parts; the list of those that were completed."""
    counted, complete = [], Folder.complete

    def limited(self, part):
        if self.mark(part) is None:
            if len(counted) == parts:
                raise error
            counted.append(part)
        return complete(self, part)

    monkeypatch.setattr(Folder, "complete", limited)
    return counted


# ---- the bits


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name, case in CASES.items() if "certified" not in name and "joint" not in name]
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_every_method_on_every_problem_has_the_bits_of_memory(name, tmp_path):
    problem, method = CASES[name].problem(), CASES[name].method
    if problem.steps is None:
        pytest.skip("a grid has a number of steps")
    stored = sdhj.solve(problem, method, store=tmp_path / "t", progress=False)
    table = sdhj.solve(problem, method, progress=False, play=False)
    assert_bit_equal(stored, table)
    told = {key: value for key, value in table.details.items() if key not in ("seconds", "findings")}
    assert told == {key: stored.details[key] for key in told}


@pytest.mark.slow
def test_equal_tubes_are_stored_once_and_the_index_is_that_of_memory(tmp_path):
    problem = settling()
    table = sdhj.solve(problem, progress=False)
    stored = sdhj.solve(problem, store=tmp_path / "t", progress=False)
    assert table.details["tubes_shared"] == stored.details["tubes_shared"] >= 5
    assert len(stored.tubes) < len(stored.index)
    assert_bit_equal(stored, table)


@pytest.mark.parametrize("last", [0.9, 1.4])
def test_a_row_grows_again_where_the_target_appears_or_goes(tmp_path, last):
    """Entries are shared where those of the next step are equal, and not where those of the same step were."""
    late = sdhj.TargetSet((0,), lambda p, t: np.where(t > last, np.abs(p[:, 0]) - 1.0, 1.0))
    early = sdhj.TargetSet((0,), lambda p, t: np.where(t < last, np.abs(p[:, 0]) - 1.0, 1.0))
    for number, target in enumerate((late, early)):
        problem = zoo.line(nodes=41, target=target, steps=4)
        table = sdhj.solve(problem, progress=False, play=False)
        assert_bit_equal(sdhj.solve(problem, store=tmp_path / str(number), progress=False, play=False), table)
        assert (np.diff([table.fraction(start=0, within=n) for n in range(5)]) == 0.0).any()


def test_what_is_left_is_a_folder_of_numpy_arrays(problem, table, tmp_path):
    sdhj.solve(problem, store=tmp_path / "t", progress=False)
    names = {path.name for path in (tmp_path / "t").iterdir()}
    assert names >= {"problem.json", "tubes.npy", "marks.npy", "avoid_static.npy", "avoid_moving.npy", "index.npy"}
    assert not names & {"begun.json", "done", "shares"}
    np.testing.assert_array_equal(np.load(tmp_path / "t" / "tubes.npy"), table.tubes)
    assert_bit_equal(sdhj.load(tmp_path / "t"), table)
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t", resume=True, progress=False), table)


# ---- going on


@pytest.mark.parametrize("parts", [0, 5, 12])
def test_a_stopped_solve_goes_on_and_does_nothing_twice(problem, table, tmp_path, monkeypatch, parts):
    stop_after(monkeypatch, parts, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        sdhj.solve(problem, store=tmp_path / "t", progress=False)
    with pytest.raises(sdhj.TableFileError, match="resume=True"):
        sdhj.load(tmp_path / "t")
    with pytest.raises(FileExistsError, match="exists already; go on"):
        sdhj.solve(problem, store=tmp_path / "t", progress=False)
    monkeypatch.undo()
    done, avoid, entry = [], Folder._avoid, Folder._entry
    monkeypatch.setattr(Folder, avoid.__name__, lambda self, part: done.append(part) or avoid(self, part))
    monkeypatch.setattr(Folder, entry.__name__, lambda self, part: done.append(part) or entry(self, part))
    stored = sdhj.solve(problem, store=tmp_path / "t", resume=True, progress=False)
    assert len(done) + parts == len(set(done)) + parts == 3 + 10  # avoid tubes of three steps, and ten entries
    assert_bit_equal(stored, table)


def test_resume_begins_where_there_is_nothing(problem, table, tmp_path, capsys):
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t", resume=True, progress=True), table)
    assert "6/6" in capsys.readouterr().err  # tubes


@pytest.mark.slow
def test_tubes_that_are_being_moved_up_are_not_lost(tmp_path, monkeypatch):
    """Stopped at every write of what is done when all entries are complete."""
    problem, finishing, counted = settling(), [], []
    table = sdhj.solve(problem, progress=False)
    write, closed_up, finish = Folder.write, Folder.closed_up, Folder.finish

    def limited(self, name, values, positions=(0,)):
        if finishing:
            counted.append(name)
            if len(counted) == allowed:
                torn = np.array(values)
                torn.reshape(-1)[torn.size // 2 :] = 0
                write(self, name, torn, positions)
                raise Stopped
        return write(self, name, values, positions)

    def begun(of):
        def begin(self, *given):
            finishing.append(of)
            return of(self, *given)

        return begin

    monkeypatch.setattr(Folder, "write", limited)
    monkeypatch.setattr(Folder, "closed_up", begun(closed_up))
    monkeypatch.setattr(Folder, "finish", begun(finish))
    allowed, stops = 1, 0
    while True:
        finishing.clear()
        counted.clear()
        try:
            stored = sdhj.solve(problem, store=tmp_path / "t", resume=True, progress=False)
            break
        except Stopped:
            stops, allowed = stops + 1, 1 + stops % 3  # sometimes further
    assert stops > 20
    assert_bit_equal(stored, table)


def killed_at(store, writes, number="SIGKILL"):
    """Solve in a process of its own, which is ended while it writes an array for the so many'th time."""
    text = SCRIPT.format(tests=TESTS, store=str(store), writes=writes, signal=number)
    return subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=300)


@pytest.mark.slow
@pytest.mark.parametrize("writes", [1, 2, 7, 12, 21, 22])
def test_a_kill_within_a_write_loses_nothing(table, tmp_path, writes):
    """Of the empty avoid tubes while the folder is made, of the first avoid tubes, of marks, of tubes, of the index."""
    assert killed_at(tmp_path / "t", writes).returncode == -signal.SIGKILL
    ended = killed_at(tmp_path / "t", 0)
    assert not ended.returncode, ended.stderr
    assert_bit_equal(sdhj.load(tmp_path / "t"), table)


@pytest.mark.slow
def test_forty_kills(table, tmp_path):
    """At times as they come, from before there is a folder to after it is whole."""
    path, rng, killed = tmp_path / "t", np.random.default_rng(0), 0
    text = SCRIPT.format(tests=TESTS, store=str(path), writes=0, signal="SIGKILL")
    begun = time.monotonic()
    subprocess.run([sys.executable, "-c", text], check=True)
    lasted = time.monotonic() - begun
    for number in range(40):
        if number % 5 == 0:
            shutil.rmtree(path, ignore_errors=True)
        child = subprocess.Popen([sys.executable, "-c", text])
        try:
            child.wait(rng.uniform(0.5, 1.0) * lasted)
        except subprocess.TimeoutExpired:
            child.kill()
        killed += child.wait() == -signal.SIGKILL
    assert killed > 5
    subprocess.run([sys.executable, "-c", text], check=True)
    assert_bit_equal(sdhj.load(path), table)
    assert not [one for one in tmp_path.glob(".sdhj-*") if (one / "problem.json").exists()]


@pytest.mark.slow
def test_two_processes_in_one_folder(problem, table, tmp_path, monkeypatch):
    stop_after(monkeypatch, 5, Stopped())
    with pytest.raises(Stopped):
        sdhj.solve(problem, store=tmp_path / "t", progress=False)
    with ThreadPoolExecutor(2) as pool:
        both = [pool.submit(killed_at, tmp_path / "t", 0) for _ in range(2)]
    assert [one.result().returncode for one in both] == [0, 0], both
    assert_bit_equal(sdhj.load(tmp_path / "t"), table)


def test_a_full_disk_is_told_and_loses_nothing(problem, table, tmp_path, monkeypatch):
    synced, as_it_is = [], os.fsync

    def full(number):
        if synced.append(number) or len(synced) > 12:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return as_it_is(number)

    monkeypatch.setattr(entries.os, "fsync", full)
    with pytest.raises(OSError, match="space left on device"):
        sdhj.solve(problem, store=tmp_path / "t", progress=False)
    monkeypatch.undo()
    assert_bit_equal(sdhj.solve(problem, store=tmp_path / "t", resume=True, progress=False), table)


# ---- what is refused


def begun_with(monkeypatch, problem, path, method="hji"):
    with monkeypatch.context() as patch:
        stop_after(patch, 6, Stopped())
        with pytest.raises(Stopped):
            sdhj.solve(problem, method, store=path, progress=False)


def test_another_problem_method_or_version_does_not_go_on(problem, tmp_path, monkeypatch):
    begun_with(monkeypatch, problem, tmp_path / "begun")
    sdhj.solve(problem, store=tmp_path / "done", progress=False)
    for path in (tmp_path / "begun", tmp_path / "done"):
        for other in (replace(problem, delta=0.1), replace(problem, steps=2)):
            with pytest.raises(sdhj.TableFileError, match="another problem"):
                sdhj.solve(other, store=path, resume=True, progress=False)
        for method in ("lax", sdhj.HJI(sdhj.Scheme(order=1))):
            with pytest.raises(sdhj.TableFileError, match="solved by method 'hji'"):
                sdhj.solve(problem, method, store=path, resume=True, progress=False)
    monkeypatch.setattr(entries, "VERSION", "9.9")
    with pytest.raises(sdhj.TableFileError, match=r"9\.9, which may round"):
        sdhj.solve(problem, store=tmp_path / "begun", resume=True, progress=False)


@pytest.mark.parametrize("text", ["", "[]", '{"sdhj_version": 5}'])
def test_a_folder_that_is_none_of_a_solve_is_refused(problem, tmp_path, text):
    (tmp_path / "t").mkdir()
    if text:
        (tmp_path / "t" / "begun.json").write_text(text)
    with pytest.raises(sdhj.TableFileError, match="folder of a solve"):
        sdhj.solve(problem, store=tmp_path / "t", resume=True, progress=False)


@pytest.mark.parametrize("text", ["", "[]", '{"place": 99}'])
def test_a_mark_that_is_damaged_is_told(problem, tmp_path, monkeypatch, text):
    begun_with(monkeypatch, problem, tmp_path / "t")
    (tmp_path / "t" / "done" / "entry-3-0").write_text(text)
    with pytest.raises(sdhj.TableFileError, match="entry-3-0 is damaged; remove"):
        sdhj.solve(problem, store=tmp_path / "t", resume=True, progress=False)


def test_what_is_not_solved_into_a_folder_is_refused(problem, tmp_path):
    for method in (Joint(), "certified"):
        with pytest.raises(ValueError, match="; leave store= out"):
            sdhj.solve(problem, method, store=tmp_path / "t", progress=False)
    with pytest.raises(ValueError, match="a folder, got 5"):
        sdhj.solve(problem, store=5)
    with pytest.raises(ValueError, match="resume"):
        sdhj.solve(problem, store=tmp_path / "t", resume="no")
    with pytest.raises(ValueError, match=r"a distributed\.Client, got 5"):
        sdhj.solve(problem, store=tmp_path / "t", client=5)
    with pytest.raises(ValueError, match="resume and client apply"):
        sdhj.solve(problem, resume=True)
    with pytest.raises(OSError, match="; choose a folder"):
        sdhj.solve(problem, store=tmp_path / "nowhere" / "t", progress=False)
    assert not list(tmp_path.iterdir())


def test_memory_and_disk_are_looked_at_first(problem, tmp_path, monkeypatch):
    class Little:
        free = 1000

    monkeypatch.setattr(entries.shutil, "disk_usage", lambda _: Little)
    stop_after(monkeypatch, 0, Stopped())
    with pytest.warns(UserWarning, match="1e-06 GB are free"), pytest.raises(Stopped):
        sdhj.solve(problem, store=tmp_path / "t", progress=False)
    with room(10**8), pytest.raises(MemoryError, match=r"0\.1 GB are available"):
        sdhj.solve(problem, store=tmp_path / "u", progress=False)
    assert not (tmp_path / "u").exists()
