"""The script that times stores: its tables, on few nodes, beside what the library says itself."""

import tempfile
import time
from dataclasses import replace

import numpy as np
import pytest
import stored
from click.testing import CliRunner

import sdhj


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.mark.slow
def test_one_solve_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(stored, "on_disk", lambda path: 15 * 10**8 if (path / "problem.json").is_file() else 0)
    monkeypatch.setattr(stored, "timed", lambda call, *args, clock, **options: (1234.4, call(*args, **options)))
    done = CliRunner().invoke(stored.main, ["--robot", "case study", "--nodes", "9"])
    assert done.exit_code == 0, done.output
    name, seconds, memory, disk, share = cells(done.stdout.splitlines()[-1])
    table = sdhj.solve(sdhj.arm_case_study(9), store=tmp_path / "again", progress=False)
    assert name == "case study, 9 nodes, hji"
    assert (share, seconds, disk) == (f"{table.fraction(start=0, within=8):.3f}", "1,234", "1.5 GB")
    assert memory.endswith(" GB") and 0.0 <= float(memory.split()[0]) < 0.1
    assert [path.name for path in tmp_path.iterdir()] == ["again"]


@pytest.mark.slow
def test_what_is_watched_is_the_most_there_was():
    if not stored.anonymous_memory():
        pytest.skip("this system does not say")
    with stored.watched() as most:
        held = np.ones(25_000_000)
        time.sleep(0.1)
        del held
    assert 1.5e8 < most[0] < 1e9


@pytest.mark.slow
def test_workers_are_compared(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    options = ["--nodes", "9", "--workers", "2", "--repeats", "1"]
    monkeypatch.setitem(stored.MAKERS, "turning", lambda nodes: replace(stored.turning(nodes), steps=3))
    done = CliRunner().invoke(stored.main, ["--robot", "turning", *options])
    assert done.exit_code == 0, done.output
    name, alone, shared, ratio = cells(done.stdout.splitlines()[-1])
    assert name == "turning, 9 nodes, hji" and float(alone) > 0 and float(shared) > 0 and float(ratio) > 0
    assert not list(tmp_path.iterdir())


def test_of_each_way_the_fastest_is_compared(monkeypatch):
    compiling = 9.0, 9.0, 9.0, 9
    measured = iter([compiling, (2.0, 5.0, 3.0, 42_000_000), (1.0, 6.0, 4.0, 42_000_000)])
    monkeypatch.setattr(stored, "three_ways", lambda problem, method: next(measured))
    assert stored.compared("case study", 9, "lax", 2) == "| case study, 9 nodes, lax | 1.0 | 5.0 | 3.0 | 3.00 | 42 MB |"


@pytest.mark.slow
def test_three_ways_solve_and_leave_nothing(tmp_path, monkeypatch):
    written, taken = [], iter([1.0, 3.0, 5.0])

    def timed(call, *args, clock, **options):
        call(*args, **options)
        written.append([path.name for folder in tmp_path.iterdir() for path in folder.iterdir()])
        return next(taken), None

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(stored, "timed", timed)
    bare, saved, kept, size = stored.three_ways(sdhj.arm_case_study(9), "lax")
    assert (bare, saved, kept) == (1.0, 5.0, 3.0) and size > 10_000 and not list(tmp_path.iterdir())
    assert [sorted(names) for names in written] == [[], ["table"], ["table", "table.npz"]]


def test_a_folder_counts_its_files(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "one").write_bytes(b"123")
    with open(tmp_path / "two", "wb") as two:
        two.truncate(10**8)  # of which nothing is written
    assert 3 <= stored.on_disk(tmp_path) < 10**6


def test_options_of_a_robot_need_one():
    done = CliRunner().invoke(stored.main, ["--nodes", "9"])
    assert done.exit_code == 2 and "give one of them, too" in done.output
