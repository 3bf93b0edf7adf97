"""What is asked again after a change, and where boxes are cut, against plain loops."""

import itertools
import math

import numpy as np
import pytest

from sdhj.kernels.packed import Cells, to_words
from sdhj.kernels.pieces import cut_boxes
from sdhj.kernels.stencils import reached_words


@pytest.mark.parametrize("seed", range(12))
def test_every_cell_whose_image_a_change_is_in_is_asked_again(seed):
    """Images that lead as far as they may, from random cells, on axes of which the last has up to three words."""
    rng = np.random.default_rng(seed)
    counts = np.array([rng.integers(3, 7), rng.integers(3, 7), rng.choice([5, 64, 72, 130])])
    periodic = rng.random(3) < 0.5
    cells = Cells(np.zeros(3), np.ones(3), counts.astype(float), counts, periodic, 2)
    low = rng.integers(-4, 3, (2, 3))
    reach = np.stack([low, low + rng.integers(0, 4, (2, 3))], axis=1)
    rows = np.sort(rng.choice(counts[0] * counts[1], 2, replace=False))
    changed = np.zeros((2, counts[2]), np.bool_)
    changed[[0, 1], rng.integers(counts[2], size=2)] = True
    near = np.zeros((counts[0] * counts[1], -(-counts[2] // 64)), np.bool_)
    scratch = np.empty((4, 2), np.int64), np.empty(near.shape[1], np.bool_)
    reached_words(rows, to_words(changed), reach, cells, near, *scratch)
    places = [(divmod(int(row), int(counts[1])), bits) for row, bits in zip(rows, changed, strict=True)]
    at = {(*place, int(bit)) for place, bits in places for bit in np.flatnonzero(bits)}
    for cell in itertools.product(*map(range, counts)):
        for first, last in reach:
            spans = []
            for k in range(3):
                span = range(cell[k] + first[k], cell[k] + last[k] + 1)
                spans.append({(i % counts[k] if periodic[k] else min(max(i, 0), counts[k] - 1)) for i in span})
            if any(all(spot[k] in spans[k] for k in range(3)) for spot in at):
                assert near[cell[0] * counts[1] + cell[1], cell[2] // 64], (cell, at)
    assert not near[np.setdiff1d(np.arange(len(near)), _rows(at, reach, counts, periodic))].any()


def _rows(at, reach, counts, periodic):
    """The rows with cells that an input of this reach leads to some cells from, at a clipped end from anywhere."""
    found = set()
    for cell, (first, last) in itertools.product(at, reach):
        spans = []
        for k in range(2):
            begin, end = cell[k] - last[k], cell[k] - first[k]
            begin = begin if cell[k] or periodic[k] else 0
            end = end if cell[k] < counts[k] - 1 or periodic[k] else counts[k] - 1
            spans.append({i % counts[k] for i in range(begin, end + 1) if periodic[k] or 0 <= i < counts[k]})
        found |= {i * counts[1] + j for i, j in itertools.product(*spans)}
    return sorted(found)


def test_boxes_are_cut_where_axes_end_and_close(rng):
    """Any point of a box is in one of its pieces, where its axes are clipped or laps taken off; and none is outside."""
    ends, periodic = np.array([[-1.0, 0.0, -np.pi], [1.0, 2.0, np.pi]]), np.array([False, True, True])
    low = rng.uniform(-4.0, 4.0, (300, 3))
    high = low + rng.uniform(0.0, 3.0, (300, 3)) * (rng.random((300, 3)) < 0.8)
    high[:20, 1:] += 10.0
    out, rows = np.empty((2, 1200, 3)), np.empty(1200, np.int64)
    count = cut_boxes(low, high, ends, periodic, out, rows)
    assert 300 < count < 1200 and (np.diff(rows[:count]) >= 0).all() and set(rows[:count]) == set(range(300))
    assert (out[0, :count] <= out[1, :count]).all()
    assert (out[0, :count] >= ends[0]).all() and (out[1, :count] <= ends[1]).all()
    for m in range(300):
        pieces = out[:, :count][:, rows[:count] == m]
        laps, clipped = np.minimum(high[m] - low[m], ends[1] - ends[0]), np.clip([low[m], high[m]], *ends)
        whole = np.where(periodic, laps, np.ptp(clipped, axis=0))
        assert math.isclose((pieces[1] - pieces[0]).prod(axis=1).sum(), whole.prod(), abs_tol=1e-12)
        for point in rng.uniform(low[m], high[m], (20, 3)):
            laps = np.where(periodic, np.floor((point - ends[0]) / (ends[1] - ends[0])), 0.0)
            spot = np.clip(point - laps * (ends[1] - ends[0]), *ends)
            assert ((pieces[0] <= spot + 1e-12) & (spot - 1e-12 <= pieces[1])).all(axis=1).any()
