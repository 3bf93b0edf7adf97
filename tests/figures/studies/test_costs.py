"""The script that says what tables cost: its rows, on few cells and nodes, beside what the library says itself."""

import re
import tempfile
import time
from dataclasses import replace

import costs
import fleet
import numpy as np
import pytest
from click.testing import CliRunner

import sdhj


def printed(*arguments: str) -> list[list[str]]:
    """The cells of the rows below the head."""
    done = CliRunner().invoke(costs.main, [*arguments, "--repeats", "1"])
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith(costs.HEAD)
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in done.stdout.splitlines()[2:]]


@pytest.mark.slow
def test_the_checker_counts_what_it_checks(monkeypatch):
    row = costs.TABLES["verified"][0]
    monkeypatch.setitem(costs.TABLES, "verified", [row._replace(method=costs.cells(40, 40))])
    (name, solved, *_), (_, checked, share, seconds, _, _, disk, claims) = printed("verified", "rail")
    assert name == "rail, 40 x 40" and (solved, checked) == ("certified, in memory", "certified, verified")
    assert 0 < float(share) < 1 and float(seconds) >= 0 and float(disk) >= 0
    assert int(claims.split()[0].replace(",", "")) > 1600


@pytest.mark.slow
def test_three_ways_solve_the_same_and_leave_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    rows = printed("stored", "case study", "--nodes", "9")
    share = sdhj.solve(sdhj.arm_case_study(9), "hji", progress=False, play=False).fraction()
    assert [row[1] for row in rows] == ["hji, in memory", "hji, saved", "hji, with store"]
    assert {row[0] for row in rows} == {"case study, 9 x 9 x 9 x 9"} and {row[2] for row in rows} == {f"{share:.3f}"}
    bare, *kept = [row[6] for row in rows]
    assert bare == "" and all(float(size) > 0.01 for size in kept) and not list(tmp_path.iterdir())


@pytest.mark.slow
def test_what_is_watched_is_the_most_there_was():
    if not costs.anonymous_memory():
        pytest.skip("this system does not say")
    with costs.watched() as most:
        held = np.ones(25_000_000)
        time.sleep(0.1)
        del held
    assert 1.5e8 < most[0] < 1e9


@pytest.mark.slow
def test_workers_are_compared(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    short = costs.Row("turning", lambda nodes: replace(costs.turning(nodes), steps=3), "hji", (61,))
    monkeypatch.setitem(costs.TABLES, "storable", [short])
    alone, shared = printed("storable", "turning", "--nodes", "9", "--workers", "2")
    assert (alone[1], shared[1]) == ("hji, one worker", "hji, 2 workers")
    assert float(alone[3]) > 0 and float(shared[3]) > 0 and float(shared[4]) > 0
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_who_forgets_and_who_remembers(monkeypatch):
    """On few cells: nobody who forgets stands for ever."""
    few = costs.Row("standing", costs.standing, costs.cells(400, 60), ways=costs.SENSED)
    monkeypatch.setitem(costs.TABLES, "remembering", [few])
    forgets, remembers = (float(row[2]) for row in printed("remembering"))
    assert forgets == 0.0 and remembers == pytest.approx(0.73, abs=0.01)


@pytest.mark.slow
def test_a_solve_is_measured_beside_its_count(monkeypatch):
    row = costs.Row("forklift", fleet.forklift().problem, costs.cells(12, 12, 12), ways=(costs.counted,))
    monkeypatch.setitem(costs.TABLES, "counted", [row])
    ((*_, said),) = printed("counted")
    *terms, total = map(float, re.findall(r"[0-9.]+", said))
    assert len(terms) == 3 and sum(terms) == pytest.approx(total, abs=0.1)


@pytest.mark.slow
def test_the_maze_is_played_and_drawn(tmp_path):
    done = CliRunner().invoke(costs.main, ["maze", "--repeats", "1", "-o", str(tmp_path / "maze.png")])
    assert done.exit_code == 0, done.output
    assert "of 2,000 runs 2,000 reached" in done.stdout and (tmp_path / "maze.png").stat().st_size > 10_000
