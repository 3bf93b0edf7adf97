"""The script that measures what remembering gains, of its cheapest robot."""

import pytest
import remembering
from click.testing import CliRunner

import sdhj


@pytest.mark.slow
def test_a_row_has_the_shares_of_both(monkeypatch):
    """On few cells: nobody who forgets stands for ever."""
    monkeypatch.setattr(sdhj, "solve", lambda one, solve=sdhj.solve, **given: solve(one, few, **given))
    few = sdhj.Certified(cells=(400, 60))
    done = CliRunner().invoke(remembering.main, ["standing"])
    assert done.exit_code == 0, done.output
    forgets, remembers = map(float, done.output.splitlines()[2].split("|")[3:5])
    assert forgets == 0.0 and remembers == pytest.approx(0.73, abs=0.01)
