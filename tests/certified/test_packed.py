"""Packed sets of cells, against plain arrays, and the questions of states about them."""

import naive_certified as naive
import numpy as np
import pytest

from sdhj.certified.arm.proof import packed_window
from sdhj.kernels import packed
from sdhj.kernels.arm.links import Agent


@pytest.mark.parametrize("count", [1, 63, 64, 65, 144])
def test_words_hold_the_bits_and_nothing_else(count, rng):
    bits = rng.random((7, count)) < 0.5
    words = packed.to_words(bits)
    np.testing.assert_array_equal(words, naive.packed(bits[:, None]))
    np.testing.assert_array_equal(packed.to_bits(words, count), bits)
    assert np.bitwise_count(words).sum() == bits.sum()


@pytest.mark.parametrize("shape", [(1, 3, 1, 5), (2, 70, 3, 130), (3, 64, 2, 64), (1, 1, 4, 65), (2, 129, 1, 3)])
def test_the_packed_axis_changes_places(shape, rng):
    outer, first, middle, last = shape
    bits = rng.random(shape) < 0.4
    out = np.empty((outer * last * middle, -(-first // 64)), np.uint64)
    packed.swap_packed(packed.to_words(bits).reshape(outer * first * middle, -1), first, middle, last, out)
    np.testing.assert_array_equal(out, packed.to_words(bits.swapaxes(1, 3)).reshape(out.shape))


def test_packed_erosion_agrees_with_shifted_arrays(rng):
    """On sizes that do and do not fill words, with windows that are clipped at the walls."""
    for nx, ny, reach in ((5, 7, 1), (8, 8, 2), (12, 12, 3)):
        first = np.stack([np.maximum(np.arange(12) - reach, 0)] * 2)
        last = np.stack([np.minimum(np.arange(12) + reach, n - 1) for n in (nx, ny)])
        agent = Agent(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, nx, ny)
        shifts, passes = packed_window(first, last - first + 1, agent)
        cells = rng.random((6, nx, ny)) < 0.9
        blocks = naive.packed(cells)
        packed.erode_packed(blocks, shifts, passes)
        reached = [np.clip(np.arange(n)[:, None] + np.arange(-reach, reach + 1), 0, n - 1) for n in (nx, ny)]
        for block, own in zip(naive.unpacked(blocks, (nx, ny)), cells, strict=True):
            np.testing.assert_array_equal(block, naive.erosion(own, *reached))


@pytest.mark.slow
def test_state_on_an_edge(small):
    """A state that rounding has pushed out of a certified cell still has that cell's inputs; one beyond has none."""
    inside = small.bits(start=0, within=2)
    last = np.argwhere(inside[:-1] & ~inside[1:])[0]
    edges = [axis.edges() for axis in small.axes]
    state = np.array([(own[i] + own[i + 1]) / 2 for own, i in zip(edges, last, strict=True)])
    inputs = []
    for off in (-1e-6, 0.0, 5e-11):
        state[0] = edges[0][last[0] + 1] + off
        assert small.contains(state[None], start=0, within=2).all() == (off <= 0.0)  # what is off is a run's reserve
        assert (small.steps_to_go(state[None], 0) <= 2).all()
        inputs.append(list(np.flatnonzero(small.certified_inputs(state[None], 0, 2)[0])))
    assert inputs[0] == inputs[1] == inputs[2]
    state[0] = edges[0][last[0] + 1] + 1e-6
    assert not small.contains(state[None], start=0, within=2).any()
    assert not small.certified_inputs(state[None], 0, 2).any()
