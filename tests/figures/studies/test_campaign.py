"""Campaigns of runs: what is counted, and what is written."""

import csv
from dataclasses import replace

import campaign as campaign_module
import numpy as np
import pytest
import zoo
from campaign import Row, campaign, main, upper_bound, write_rows
from click.testing import CliRunner

import sdhj

PLACE = np.array([1.5, 0.0])  # minus this: where a disk stands that no table knows of


@pytest.mark.slow
def test_a_campaign_counts_batch_by_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign_module, "BATCH", 300)
    table = sdhj.solve(zoo.torus_problem(nodes=32), method="lax", progress=False)
    disk = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(*zoo.wrapped(p + PLACE).T) - 0.2)
    controller = sdhj.Controller(replace(table, problem=replace(table.problem, unsafe=(disk,))))
    rows = campaign({"toy": controller.table}, ["random", "worst", "search"], runs=700, seed=4, progress=False)
    assert [(row.table, row.method, row.adversary) for row in rows] == [
        ("toy", "lax", name) for name in ("random", "worst", "search")
    ]
    for row in rows[:2]:
        reports = [
            sdhj.monte_carlo(controller, n, row.adversary, 4 + b, progress=False) for b, n in enumerate((300, 300, 100))
        ]
        for outcome in ("collided", "left", "late"):
            assert getattr(row, outcome) == sum(report.counts[outcome] for report in reports)
        assert row.runs == row.starts == 700
    assert rows[0].collided > 0
    assert rows[2].starts == 3 and 3 * 32 <= rows[2].runs <= 3 * 32 * 8
    with pytest.raises(ValueError, match="adversaries must be some"):
        campaign({"toy": controller.table}, ["nasty"], runs=10)


def test_rows_are_written(tmp_path) -> None:
    rows = [Row("a", "hji", "random", 1000, 1000, 3, 2, 0, 1.5), Row("b", "certified", "search", 500, 9000, 0, 0, 0, 2)]
    table, page = write_rows(rows, tmp_path, "A note.")
    read = list(csv.DictReader(table.open()))
    assert [record["collided"] for record in read] == ["3", "0"] and read[1]["runs"] == "9000"
    lines = page.read_text().splitlines()
    assert lines[2] == "| a | random | 1000 | 1000 | 3 | 2 | 0 | 0.50% | 2 |"
    assert "0 (< 6.0e-03)" in lines[3] and lines[-1] == "A note."
    assert (1 - upper_bound(500)) ** 500 == pytest.approx(0.05)


@pytest.mark.slow
def test_campaign_from_the_command_line(tmp_path) -> None:
    problem = sdhj.arm_case_study(nodes=9, steps=2)
    sdhj.solve(problem, sdhj.Certified(cells=(63, 63, 18, 18)), progress=False).save(tmp_path / "proved.npz")
    arguments = [str(tmp_path / "proved.npz"), "--runs", "600", "--adversaries", "random,search"]
    done = CliRunner().invoke(main, [*arguments, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    rows = list(csv.DictReader((tmp_path / "out" / "campaign.csv").open()))
    assert [(row["adversary"], row["collided"], row["left"], row["late"]) for row in rows] == [
        ("random", "0", "0", "0"),
        ("search", "0", "0", "0"),
    ]
    bad = CliRunner().invoke(main, [*arguments[:-1], "nasty", "--out", str(tmp_path / "out")])
    assert bad.exit_code == 2 and "nasty" in bad.output and "Traceback" not in bad.output
