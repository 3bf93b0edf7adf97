"""The script that times stores: its tables, on few nodes, beside what the library says itself."""

import stored
from click.testing import CliRunner

import sdhj


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_one_solve_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    done = CliRunner().invoke(stored.main, ["--robot", "case study", "--nodes", "9", "--memory", "100000000"])
    assert done.exit_code == 0, done.output
    name, slabs, seconds, memory, disk, share = cells(done.stdout.splitlines()[-1])
    table = sdhj.solve(sdhj.arm_case_study(9), store=tmp_path / "again.zarr", memory=100_000_000)
    assert (name, int(slabs)) == ("case study, 9 nodes, hji", table.details["slabs"])
    assert share == f"{table.fraction(start=0, within=8):.3f}" and 0.0 <= float(seconds) < 600
    assert memory.endswith(" GB") and disk == "0.0 GB"
    assert [path.name for path in tmp_path.iterdir()] == ["again.zarr"]


def test_what_is_compared_stands_in_one_line(monkeypatch):
    monkeypatch.setattr(stored, "COMPARED", [("case study", 9, "lax")])
    done = CliRunner().invoke(stored.main, ["--repeats", "2"])
    assert done.exit_code == 0, done.output
    name, bare, saved, kept, ratio, disk = cells(done.stdout.splitlines()[-1])
    assert name == "case study, 9 nodes, lax" and float(bare) <= float(saved)
    assert disk.endswith(" MB") and float(kept) >= 0.0 and float(ratio) > 0.0


def test_a_folder_counts_its_files(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "one").write_bytes(b"123")
    (tmp_path / "two").write_bytes(b"45")
    assert stored.on_disk(tmp_path) == 5


def test_too_little_memory_is_told_without_a_traceback():
    done = CliRunner().invoke(stored.main, ["--robot", "arm", "--nodes", "9", "--memory", "1000"])
    assert done.exit_code != 0 and "allowed; give more as memory=" in done.output
    assert isinstance(done.exception, SystemExit)


def test_options_of_a_robot_need_one():
    done = CliRunner().invoke(stored.main, ["--nodes", "9"])
    assert done.exit_code == 2 and "give one of them, too" in done.output
