"""The campaign of robots that are off, late and out of time: a few runs of the quick robots, and its table."""

import pytest
from click.testing import CliRunner
from shaky import ROBOTS, Row, main, played

import sdhj


@pytest.mark.slow
def test_a_few_runs_of_the_double_integrator() -> None:
    """What knows of error, delay and jitter loses none; what does not loses some of as few."""
    done = CliRunner().invoke(main, ["--runs", "2000", "--robot", "double integrator"])
    assert done.exit_code == 0, done.output
    rows = [line.split(" | ") for line in done.output.splitlines() if "double" in line]
    lost = {row[1]: int(row[4]) for row in rows}
    assert [row[3] for row in rows] == ["2,000", *["200"] * 4]
    assert lost["certified"] == 0 and lost["certified, told nothing of it"] > 5 and lost["hji, told nothing of it"] > 5


def test_where_nothing_is_promised_nothing_is_played() -> None:
    robot = ROBOTS["double integrator"]
    table = sdhj.solve(robot.problem(), sdhj.Certified(cells=(2, 2)), progress=False)
    assert played(table, robot.sensing, 10) == (0, 0, "nothing promised")
    row = str(Row("arm", "hji", 0.25, 10_000, 3, "left 3"))
    assert row == "| arm | hji | 0.2500 | 10,000 | 3 | 0.0300% | left 3 |"
