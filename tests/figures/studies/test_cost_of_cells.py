"""The command that measures the constants of the model of cells."""

import re

import cost_of_cells
import fleet
import pytest
from click.testing import CliRunner

from sdhj.certified.table import CellSets


@pytest.mark.slow
def test_each_part_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = CellSets.extend
    monkeypatch.setattr(cost_of_cells, "ROBOTS", {"forklift": (fleet.forklift().problem, (12, 12, 12))})
    done = CliRunner().invoke(cost_of_cells.main, [])
    assert done.exit_code == 0, done.output
    found = re.findall(r"(intervals|unsafe sets|arrivals|recursion) ([0-9.]+) ([0-9.]+)", done.output)
    assert [name for name, *_ in found] == 2 * ["intervals", "unsafe sets", "arrivals", "recursion"]
    assert float(found[1][1]) > 0 and float(found[3][1]) > 0 and CellSets.extend is plain
