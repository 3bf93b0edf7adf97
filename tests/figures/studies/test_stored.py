"""The script that times stores: its tables, on few nodes, beside what the library says itself."""

import re
import tempfile

import pytest
import stored
from click.testing import CliRunner

import sdhj


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_one_solve_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(stored, "on_disk", lambda path: 15 * 10**8 if (path / "head").is_file() else 0)
    monkeypatch.setattr(stored, "timed", lambda call, *args, clock, **options: (1234.4, call(*args, **options)))
    done = CliRunner().invoke(stored.main, ["--robot", "case study", "--nodes", "9", "--memory", "100000000"])
    assert done.exit_code == 0, done.output
    name, slabs, seconds, memory, disk, share = cells(done.stdout.splitlines()[-1])
    table = sdhj.solve(sdhj.arm_case_study(9), store=tmp_path / "again", memory=100_000_000)
    assert (name, int(slabs)) == ("case study, 9 nodes, hji", table.details["slabs"])
    assert (share, seconds, disk) == (f"{table.fraction(start=0, within=8):.3f}", "1,234", "1.5 GB")
    assert memory.endswith(" GB") and float(memory.split()[0]) >= 0.1  # what Python and the kernels take
    assert [path.name for path in tmp_path.iterdir()] == ["again"]


@pytest.mark.slow
def test_slabs_are_shared_out(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setitem(stored.MAKERS, "case study", lambda nodes: sdhj.arm_case_study(nodes, steps=2))
    options = ["--nodes", "9", "--method", "lax", "--memory", "1900000", "--workers", "1", "--repeats", "1"]
    done = CliRunner().invoke(stored.main, ["--robot", "case study", *options])
    assert done.exit_code == 0, done.output
    told = dict(zip(*map(cells, done.stdout.splitlines()[::2]), strict=True))
    slabs, number = int(told["slabs"]), r"(-?\d+) (?:ms|kB|MB)"
    assert slabs > 1 and int(told["tasks"]) == (6 + 1 + 2) * slabs  # tubes, avoid tubes of the column and of the disk
    sizes = [float(re.fullmatch(number, told[name])[1]) for name in ("sent a task", "written")]
    assert 1 < sizes[0] < 100 and sizes[1] < 20
    assert not list(tmp_path.iterdir())


def test_of_each_way_the_fastest_is_compared(monkeypatch):
    compiling = 9.0, 9.0, 9.0, 9
    measured = iter([compiling, (2.0, 5.0, 3.0, 42_000_000), (1.0, 6.0, 4.0, 42_000_000)])
    monkeypatch.setattr(stored, "three_ways", lambda problem, method: next(measured))
    assert stored.compared("case study", 9, "lax", 2) == "| case study, 9 nodes, lax | 1.0 | 5.0 | 3.0 | 3.00 | 42 MB |"


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


def test_too_little_memory_is_told_without_a_traceback():
    done = CliRunner().invoke(stored.main, ["--robot", "arm", "--nodes", "9", "--memory", "1000"])
    assert done.exit_code != 0 and "allowed; give more as memory=" in done.output
    assert isinstance(done.exception, SystemExit)


def test_options_of_a_robot_need_one():
    done = CliRunner().invoke(stored.main, ["--nodes", "9"])
    assert done.exit_code == 2 and "give one of them, too" in done.output
