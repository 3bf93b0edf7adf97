"""The commands of figures and studies: the main job on a small grid, and what they refuse."""

import csv
from pathlib import Path

import bench
import costs
import large
import pytest
import reproduce
from click.testing import CliRunner
from common import command_of

FIGURE = command_of("fig09_spaces.py")


@pytest.mark.parametrize(
    ("command", "arguments", "named"),
    [
        (reproduce.main, ["--out", "blocked/inside"], "choose a folder"),
        (reproduce.main, ["--nodes", "3"], "from 5 to"),
        (reproduce.main, ["--runs", "0"], "runs"),
        (reproduce.main, ["--seed", "-1"], "-1"),
        (FIGURE, ["--nodes", "3"], "from 5 to"),
        (FIGURE, ["--out", "blocked/inside"], "choose a folder"),
        (bench.main, ["--nodes", "many"], "many"),
        (bench.main, ["--nodes", "15,7"], "nodes"),
        (bench.main, ["--repeats", "0"], "repeats"),
        (bench.main, ["-o", "."], "name a file"),
        (bench.main, ["-o", "x.txt"], "x.txt must end in"),
        (costs.main, ["stored", "train"], "stored has case study, case study, finer"),
        (costs.main, ["stored", "-o", "stored.png"], "only of the maze"),
        (large.main, ["--full-only", "-o", "large.png"], "--full-only"),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2(command, arguments, named, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("blocked").touch()
    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == 2 and named in done.output and "Traceback" not in done.output
    assert len([line for line in done.output.splitlines() if line.startswith("Error")]) == 1
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["blocked"]


@pytest.mark.slow
def test_the_whole_main_job(tmp_path: Path) -> None:
    arguments = ["--nodes", "9", "--runs", "20", "--out", str(tmp_path), "--certified"]
    done = CliRunner().invoke(reproduce.main, arguments)
    assert done.exit_code == 0, done.output
    rows = list(csv.DictReader((tmp_path / "results.csv").open()))
    assert (rows[3]["method"], rows[3]["failures, worst"]) == ("certified", "0.00%")
    names = {path.stem for path in tmp_path.iterdir()}
    assert {"results", "fig01_problem", "fig12_trajectory", "fig14_timing", "extra_fractions"} <= names
    assert len(names) == 19 and "extra_rules" not in names
