"""The script that measures exported tables, on few cells."""

import exported
import pytest
from click.testing import CliRunner


@pytest.mark.slow
def test_a_row_is_what_the_files_take():
    done = CliRunner().invoke(exported.main, ["24,24,26"])
    assert done.exit_code == 0, done.output
    cells, share, everything, select, each = (one.strip() for one in done.output.splitlines()[2].strip("|").split("|"))
    assert cells == "24 x 24 x 26" and 0.0 < float(share) < 0.2
    assert 1 <= int(select.split()[0]) < int(everything.split()[0]) < 100 and float(each.split()[0]) > 0
