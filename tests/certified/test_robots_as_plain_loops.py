"""Sets and inputs of small robots: all that follows from the moves and clear inputs of their tables, and no more."""

import itertools

import numpy as np
import pytest
from forged_robots import ROBOTS, solved
from naive_certified import leads

ONLY = [name for name in ROBOTS if name != "windy"]  # which is larger


def moves_as_plain_loops_say(table, step, following):
    """Which inputs are clear from a cell and lead into a set: (*cells, L) bool."""
    proof, grid, found = table.proof, table.grid, np.zeros((*table.shape, len(table.problem.inputs)), bool)
    safe = [[end == "safe" for end in ends] for ends in grid.ends]
    low, high = (moves[min(step, len(moves) - 1)] for moves in (proof.low, proof.high))
    clear = proof.clear[min(step, len(proof.clear) - 1)].reshape(*table.shape, -1)
    for cell, j in itertools.product(np.ndindex(table.shape), range(found.shape[-1])):
        place = int(np.dot(cell, proof.strides))
        if clear[cell][j // 8] >> (j % 8) & 1:
            found[*cell, j] = leads(cell, low[j, place], high[j, place], following, grid.periodic, safe)
    return found


def assert_all_that_follows(table):
    """Of the first step, and of the second one, where that is another."""
    centres = [np.convolve(axis.edges(), [0.5, 0.5], "valid") for axis in table.axes]
    states = np.stack([one.ravel() for one in np.meshgrid(*centres, indexing="ij")], axis=1)
    for step in range(1 if len(table.index) <= table.steps + 1 else 2):
        for within in range(1, table.steps - step + 1):
            less, here = (table.bits(start=step, within=n) for n in (within - 1, within))
            inputs = moves_as_plain_loops_say(table, step, table.bits(start=step + 1, within=within - 1))
            follows = inputs.any(axis=-1)
            assert np.array_equal(here, less & follows if table.problem.stays else less | follows), (step, within)
            found = table.certified_inputs(states, step, within).reshape(inputs.shape)
            assert np.array_equal(found, inputs), (step, within)


@pytest.mark.parametrize("name", ONLY)
def test_sets_and_inputs_are_all_that_follows(name):
    assert_all_that_follows(solved(name))
