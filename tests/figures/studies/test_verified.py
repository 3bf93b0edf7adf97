"""The script that times the checker, on few cells."""

import verified
from click.testing import CliRunner


def test_a_row_counts_what_is_checked(monkeypatch):
    monkeypatch.setitem(verified.ROBOTS, "rail", verified.ROBOTS["rail"]._replace(cells=(40, 40)))
    done = CliRunner().invoke(verified.main, ["rail"])
    assert done.exit_code == 0, done.output
    *head, line = done.output.splitlines()
    assert "\n".join(head) == verified.HEAD
    name, cells, claims, solved, checked, each = (one.strip() for one in line.strip("|").split("|"))
    assert (name, cells) == ("rail", "40 x 40") and int(claims.replace(",", "")) > 1600
    assert float(solved) >= 0 and float(checked) >= 0 and float(each) > 0
