"""The main job, on a small grid, and what it refuses."""

import csv
from pathlib import Path

import pytest
import reproduce
from click.testing import CliRunner


def run(*arguments: object):
    return CliRunner().invoke(reproduce.main, [str(a) for a in arguments])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--out", "/proc/nothing"], "folder"),
        (["--nodes", "many"], "many"),
        (["--nodes", 3], "from 5 to"),
        (["--seed", -1], "-1"),
        (["--runs", 0], "runs"),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2(arguments, named, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = run(*arguments)
    assert done.exit_code == 2 and named in done.output and "Traceback" not in done.output


@pytest.mark.slow
def test_the_whole_main_job(tmp_path: Path) -> None:
    done = run("--nodes", 9, "--runs", 20, "--out", tmp_path, "--certified")
    assert done.exit_code == 0, done.output
    rows = list(csv.DictReader((tmp_path / "results.csv").open()))
    assert (rows[3]["method"], rows[3]["failures, worst"]) == ("certified", "0.00%")
    names = {path.stem for path in tmp_path.iterdir()}
    assert {"results", "fig01_problem", "fig12_trajectory", "fig14_timing", "extra_fractions"} <= names
    assert len(names) == 19 and "extra_rules" not in names
