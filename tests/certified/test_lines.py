"""Inputs of cells in lines, whose images share slices, against each cell alone."""

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.certified import export as export_module
from sdhj.certified.export import InLines


def robot(periodic, end):
    """Images depend on the heading alone."""
    target = None if end == "safe" else zoo.goal(0.4, 0.0, 0.3)
    sets = {"target": target, "unsafe": [zoo.post(-0.5, 0.0, 0.2)]}
    box = {"lower": [-1, -1, -np.pi], "upper": [1, 1, np.pi], "nodes": 11, "ends": [end, end, "wall"]}
    return zoo.car(**box, **sets, periodic=[False, periodic, True])


@pytest.mark.slow
@pytest.mark.parametrize(("periodic", "end"), [(True, "unsafe"), (False, "unsafe"), (False, "safe")])
def test_lines_of_cells_are_answered_as_each_cell_alone(periodic, end):
    table = sdhj.solve(robot(periodic, end), sdhj.Certified(cells=(25, 24, 70)), progress=False, play=False)
    assert table.proof.along == (-1 if end == "safe" else 1)  # a cell past a safe end is not asked
    pieces, rng = InLines(table), np.random.default_rng(0)
    asked = 0
    for step, at in pieces.work[:3]:
        cells = pieces.cells(at)
        to_go = table.fewest(cells, step)
        held = to_go <= table.steps - step
        lines, to_go = cells[held], to_go[held]
        for order in (
            np.arange(len(lines)),
            rng.permutation(len(lines)),
            np.flatnonzero(rng.random(len(lines)) < 0.3)[::-1],
        ):
            for ahead in (np.full(order.size, table.steps), to_go[order], rng.integers(0, 5, order.size)):
                among = rng.random((order.size, 6)) < 0.8
                alone = table.inputs_of(lines[order], ahead, step, among)
                assert np.array_equal(table.inputs_of(lines[order], ahead, step, among, lines=True), alone)
                asked += alone.sum()
    assert asked > 1000


@pytest.mark.slow
def test_pieces_hold_each_cell_once_and_in_the_blocks_of_the_file():
    table = sdhj.solve(zoo.unicycle_problem(), sdhj.Certified(cells=(20, 20, 20)), progress=False, play=False)
    for most in (1 << 20, 3000, 10):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(export_module, "CELLS_AT_ONCE", most)
            pieces = InLines(table)
            parts = [
                pieces.in_blocks(np.ravel_multi_index(tuple(pieces.cells(at).T), table.shape), at)
                for _, at in pieces.work
            ]
        found = np.concatenate(parts)
        sides, counts = pieces.sides, np.array(table.shape)
        for number, block in enumerate(np.ndindex(*pieces.blocks.tolist())):
            inside = np.array(list(np.ndindex(*sides.tolist()))) + np.array(block) * sides
            expected = np.ravel_multi_index(tuple(np.minimum(inside, counts - 1).T), table.shape)
            assert np.array_equal(found[number], expected)
