"""The script that measures what remembering gains, of its cheapest robot."""

from dataclasses import replace

import pytest
import remembering
from click.testing import CliRunner

import sdhj


def test_a_row_has_the_shares_of_both(monkeypatch):
    """On few nodes and cells: nobody who forgets stands for ever."""
    small = replace(remembering.standing(), grid=sdhj.Grid([0, 0], [100, 15], (21, 11), ends=["unsafe", "wall"]))
    monkeypatch.setitem(remembering.ROBOTS, "standing", lambda: small)
    monkeypatch.setattr(remembering.sdhj, "solve", lambda one, method, **given: solve(one, method, given))
    done = CliRunner().invoke(remembering.main, ["standing"])
    assert done.exit_code == 0, done.output
    forgets, remembers = map(float, done.output.splitlines()[2].split("|")[3].split("->"))
    assert forgets == 0.0 and remembers == pytest.approx(0.73, abs=0.01)


def solve(problem, method, given, solve=sdhj.solve):
    return solve(problem, sdhj.Certified(cells=(400, 60)) if method == "certified" else method, **given)
