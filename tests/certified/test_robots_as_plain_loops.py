"""Sets and inputs of small robots: all that follows from the moves and clear inputs of their tables, and no more."""

import pytest
from forged_robots import ROBOTS, solved
from naive_certified import assert_all_that_follows

ONLY = [name for name in ROBOTS if name not in ("windy", "rail")]  # which have more cells


@pytest.mark.parametrize("name", ONLY)
def test_sets_and_inputs_are_all_that_follows(name):
    assert_all_that_follows(solved(name))
