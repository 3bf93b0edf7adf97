"""The command that prints what a solve takes beside the count by which cells are chosen."""

import re

import cost_of_cells
import fleet
import pytest
from click.testing import CliRunner


@pytest.mark.slow
def test_a_solve_is_measured_beside_its_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost_of_cells, "ROBOTS", {"forklift": (fleet.forklift().problem, (12, 12, 12))})
    done = CliRunner().invoke(cost_of_cells.main, [])
    assert done.exit_code == 0, done.output
    took, *terms, counted = map(float, re.findall(r"([0-9.]+)(?: s,| \+| =|$)", done.output.split("share")[1]))
    assert took > 0.0 and len(terms) == 3 and sum(terms) == pytest.approx(counted, abs=0.1)
