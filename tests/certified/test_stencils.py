"""Kernels of the general proof against plain loops: what is struck, led and asked again, and where boxes are cut."""

import itertools
import math

import numpy as np
import pytest

from sdhj.certified.packing import reached_words
from sdhj.common.remembering import read_only
from sdhj.kernels.packed import Cells, to_bits, to_words, with_beyond
from sdhj.kernels.pieces import cut_boxes
from sdhj.kernels.stencils import TOGETHER, Boxes, Clear, Moves, Placed, grow, mark_collisions, mark_exits


@pytest.mark.parametrize("seed", range(5))
def test_every_cell_whose_image_a_change_is_in_is_asked_again(seed):
    """Images that lead as far as they may, from random cells, on axes of which the last has up to three words."""
    rng = np.random.default_rng(seed)
    counts = np.array([rng.integers(3, 7), rng.integers(3, 7), rng.choice([5, 64, 72, 130])])
    periodic = rng.random(3) < 0.5
    cells = Cells(np.zeros(3), np.ones(3), counts.astype(float), np.zeros((2, 3), int), counts, periodic, 2)
    low = rng.integers(-4, 3, 3)
    reach = np.stack([low, low + rng.integers(0, 4, 3)])
    rows = np.sort(rng.choice(counts[0] * counts[1], 2, replace=False))
    changed = np.zeros((2, counts[2]), np.bool_)
    changed[[0, 1], rng.integers(counts[2], size=2)] = True
    near = reached_words(rows, to_words(changed), reach, cells)
    places = [(divmod(int(row), int(counts[1])), bits) for row, bits in zip(rows, changed, strict=True)]
    at = {(*place, int(bit)) for place, bits in places for bit in np.flatnonzero(bits)}
    for cell in itertools.product(*map(range, counts)):
        spans = []
        for k in range(3):
            span = range(cell[k] + reach[0, k], cell[k] + reach[1, k] + 1)
            spans.append({(i % counts[k] if periodic[k] else min(max(i, 0), counts[k] - 1)) for i in span})
        if any(all(spot[k] in spans[k] for k in range(3)) for spot in at):
            assert near[cell[0] * counts[1] + cell[1], cell[2] // 64], (cell, at)
    assert not near[np.setdiff1d(np.arange(len(near)), _rows(at, reach, counts, periodic))].any()


def _rows(at, reach, counts, periodic):
    """The rows with cells that inputs of this reach lead to some cells from, at a clipped end from anywhere."""
    found, (first, last) = set(), reach
    for cell in at:
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(9))
def test_cells_are_struck_as_plain_loops_say(seed):
    """Boxes on one to three axes, of one lattice or one for each part; lines or single cells; unsafe and safe ends."""
    rng = np.random.default_rng(seed)
    counts, periodic, parts = rng.integers(4, 40, 3), rng.random(3) < 0.4, 3
    while counts.prod() > 6000:
        counts //= 2
    own = rng.random(3) < 0.4
    edges = np.full((3, counts.max() + 1), np.nan)
    for k in range(3):
        edges[k, : counts[k] + 1] = 1.0 + np.arange(counts[k] + 1)
    axes = np.sort(rng.choice(3, rng.integers(1, 4), replace=False))
    fine = rng.integers(1, 3, axes.size)
    sizes = counts[axes] * fine
    each = rng.random((1 if seed % 2 else parts, *sizes)) < 0.2 / 3**axes.size
    each.flat[each.size // 2] = True
    meets = [*each, each.any(axis=0)] if len(each) > 1 else each
    sums = []
    for one in meets:
        sums.append(np.pad(one, [(1, 0)] * axes.size).astype(np.int32))
        for k in range(axes.size):
            np.cumsum(sums[-1], axis=k, out=sums[-1])
    length, narrow = counts[axes].astype(float), np.full(axes.size, 0.01)
    sums = np.stack([one.ravel() for one in sums])
    lattice = Boxes(axes, sizes, np.ones(axes.size), 1 / fine, length, periodic[axes], narrow, sums)
    safe = np.array([[-np.inf] * 3, [np.inf] * 3])
    if seed % 3 == 0:
        safe[1, 0] = counts[0] + 0.5

    def numbers(which):
        flat = np.cumprod([1, *counts[:0:-1]])[::-1]
        return np.asarray(flat @ np.indices(np.where(which, counts, 1)).reshape(3, -1))

    free = [int(k) for k in axes if not own[k]]
    axis, lined = [int(axes[-1]), *free][-1], ~own
    if free:
        lined[axis] = False
    stride, many = (int(counts[axis + 1 :].prod()), int(counts[axis])) if free else (0, 1)
    layout = Placed(*read_only((counts, numbers(own))), numbers(lined), axis, stride, many, *read_only((edges, safe)))
    places = layout.begin.size
    low = rng.uniform(-2.0, 1.0, (places, parts, 3))
    tubes = np.stack([low, low + rng.uniform(0.0, 1.5, low.shape)], axis=-1)
    clear = rng.integers(0, 256, counts.prod()).astype(np.uint8)
    struck, expected, left, out = (clear.copy() for _ in range(4))
    mark_collisions(struck, tubes, (0, places), lattice, np.uint8(4), layout, (1, 4, TOGETHER)[seed // 3 % 3])
    faces = np.where(rng.random((2, 3)) < 0.7, np.stack([np.full(3, 0.4), counts + 1.3]), [[-np.inf], [np.inf]])
    mark_exits(left, tubes, (0, places), faces, np.uint8(4), layout)
    place_of = {int(number): place for place, number in enumerate(layout.begin)}
    for number, cell in enumerate(np.ndindex(*counts)):
        tube = tubes[place_of[int(np.ravel_multi_index(np.where(own, cell, 0), counts))]]
        for part in range(parts):
            ends = [[edges[k, cell[k] + side] + tube[part, k, side] for side in (0, 1)] for k in range(3)]
            if (np.array(ends)[:, 0] > safe[1]).any():
                break
            boxes = itertools.product(*_overlapped(ends, axes, fine, counts, periodic))
            if any(each[part % len(each)][at] for at in boxes):
                expected[number] &= 255 - 4
            if any(a < low or b > high for (a, b), low, high in zip(ends, *faces, strict=True)):
                out[number] &= 255 - 4
    assert np.array_equal(struck, expected) and 0 < (struck != clear).sum() < (clear & 4 > 0).sum()
    assert np.array_equal(left, out) and 0 < (left != clear).sum() < (clear & 4 > 0).sum()


def _overlapped(ends, axes, fine, counts, periodic):
    """Which boxes an interval overlaps on each axis, 0.01 narrower on each side."""
    for k, pieces in zip(axes, fine, strict=True):
        begin, end = ((end - 1.0) * pieces for end in (ends[k][0] + 0.01, ends[k][1] - 0.01))
        boxes = range(math.floor(begin), max(math.ceil(end), math.floor(begin) + 1))
        size = int(counts[k] * pieces)
        yield {i % size if periodic[k] else min(max(i, 0), size - 1) for i in boxes}


@pytest.mark.parametrize("seed", range(5))
def test_words_of_cells_are_led_as_plain_loops_say(seed):
    """Images that do not depend on the last axis, up to three words long."""
    rng = np.random.default_rng(seed)
    counts, periodic = np.array([2, 6, rng.choice([6, 63, 64, 100, 130])]), rng.random(3) < 0.5
    cells = read_only(Cells(np.zeros(3), np.ones(3), np.ones(3), np.zeros((2, 3), int), counts, periodic, 1))
    keep = seed % 3 == 0
    inside, following = (rng.random(counts) < share for share in (0.5, 0.93))
    low = rng.integers(-4, 3, (4, 12, 3)).astype(np.int16)
    high = (low + rng.integers(0, [2, 8, 4], low.shape)).astype(np.int16)
    clear, beside = (rng.integers(0, 16, size).astype(np.uint8) for size in (counts, counts[[0, 2]]))
    beside |= rng.integers(0, 16, beside.shape).astype(np.uint8)
    both = np.concatenate([clear.ravel(), beside.ravel()]), np.array([0, clear.size])
    kinds = Clear(*read_only((*both, np.array([[6 * counts[2], counts[2], 1], [counts[2], 0, 1]]))))
    mode = "wrap" if periodic[2] else "edge"
    far = min(8, counts[2])
    wide = np.pad(np.pad(following.reshape(12, -1), [(0, 0), (far, far)], mode=mode), [(0, 0), (64 - far, 64 - far)])
    extended = np.empty((12, -(-counts[2] // 64) + 2), np.uint64)
    with_beyond(to_words(following.reshape(12, -1)), counts[2], far, bool(periodic[2]), extended)
    assert np.array_equal(to_bits(extended, wide.shape[1]), wide)
    found, near = to_words(inside.reshape(12, -1)), np.ones((12, -(-counts[2] // 64)), np.bool_)
    moves = read_only(Moves(low, high, np.array([6, 1, 0]), np.array([[-np.inf] * 3, [np.inf] * 3])))
    grow(near, found, extended, kinds, moves, cells, keep)
    clear = clear & beside[:, None]
    expected = inside.copy()
    for cell in np.ndindex(*counts):
        leads = []
        for j in range(4):
            ends, at = (low[j, 6 * cell[0] + cell[1]], high[j, 6 * cell[0] + cell[1]]), []
            for c, n, wraps, a, b in zip(cell, counts, periodic, *ends, strict=True):
                at.append([(c + d) % n if wraps else min(max(c + d, 0), n - 1) for d in range(a, b + 1)])
            leads.append(following[np.ix_(*at)].all() and bool(clear[cell] >> j & 1))
        expected[cell] = inside[cell] and any(leads) if keep else inside[cell] or any(leads)
    assert np.array_equal(to_bits(found, int(counts[2])), expected.reshape(12, -1))
    assert (expected != inside).any() and expected.any() and not expected.all()
