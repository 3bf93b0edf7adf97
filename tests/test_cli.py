"""The command line: each command on a small grid, and one clear line for everything that is wrong."""

import re

import pytest
from click.testing import CliRunner

import sdhj
from sdhj.cli import main


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "arm.h5"
    result = run("solve", "--nodes", 9, "--steps", 3, "-o", path)
    assert result.exit_code == 0, result.output
    assert re.search(r"\d+\.\d% of C", result.output)
    return path


def test_solve_writes_a_table_that_loads(saved):
    table = sdhj.load(saved)
    assert table.method == "hji" and table.grid.shape == (9,) * 4 and table.steps == 3


def test_info_tells_what_the_file_holds(saved):
    result = run("info", saved)
    assert result.exit_code == 0
    table = sdhj.load(saved)
    for text in (
        "method hji",
        "9 nodes",
        "25 inputs",
        table.problem.digest,
        f"{table.fraction(start=0, within=3):.4f}",
    ):
        assert text in result.output


def test_simulate_plays_one_run_and_many(saved):
    many = run("simulate", saved, "--runs", 50, "--adversary", "random")
    assert many.exit_code == 0, many.output
    assert "reached" in many.output
    lost = run("simulate", saved, "--start", 3.0, 3.0, 0.0, 0.0)
    assert lost.exit_code == 2 and "Traceback" not in lost.output


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["solve", "--nodes", 3, "-o", "x.h5"], "3 nodes"),
        (["solve", "--method", "magic", "-o", "x.h5"], "magic"),
        (["solve", "--steps", 0, "-o", "x.h5"], "steps"),
        (["solve", "-o", "/nonexistent/folder/x.h5"], "folder"),
        (["solve", "-o", "."], "folder"),
        (["info", "missing.h5"], "missing.h5"),
        (["simulate", "missing.h5"], "missing.h5"),
        (["reproduce", "--out", "/proc/nothing"], "folder"),
        (["reproduce", "--nodes", "many"], "many"),
        (["nonsense"], "nonsense"),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2(arguments, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert named in result.output and "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []  # nothing half-written
    (line,) = [line for line in result.output.splitlines() if line.startswith("Error")]
    assert len(line) < 300


def test_damaged_file_is_one_line(tmp_path):
    path = tmp_path / "broken.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n then nothing")
    result = run("info", path)
    assert result.exit_code == 2 and "damaged" in result.output and "Traceback" not in result.output


def test_help_explains_each_command_in_a_line():
    result = run("--help")
    assert result.exit_code == 0
    for command in main.commands:
        (line,) = [line for line in result.output.splitlines() if line.strip().startswith(command + " ")]
        assert len(line.split()) > 4
        assert run(command, "--help").exit_code == 0
