"""Packed sets of a file, against plain arrays."""

import naive_certified as naive
import numpy as np
import pytest

from sdhj.certified.check.arm import bits


@pytest.mark.parametrize("shape", [(5, 7), (3, 64), (4, 71), (2, 130)])
def test_erosion_agrees_with_the_twin(shape, rng):
    cells = rng.random((6, *shape)) < np.array([0.0, 1.0, 0.97, 0.97, 0.9, 0.7])[:, None, None]
    along = [np.sort(rng.integers(0, n, (n, 2)), axis=1) for n in shape]
    out = bits.erode(naive.packed(cells), *along)
    for block, expected in zip(naive.unpacked(out, shape), cells, strict=True):
        np.testing.assert_array_equal(block, naive.erosion(expected, *along))
    assert (naive.packed(naive.unpacked(out, shape)) == out).all()  # nothing beyond the last cell


def test_bits_are_dropped():
    for start, stop in [(0, 1), (0, 64), (3, 64), (60, 130), (64, 128), (191, 192), (0, 192)]:
        block = np.full(3, ~np.uint64(0))
        bits.drop(block, start, stop)
        kept = naive.unpacked(block, (1, 192))[0]
        assert not kept[start:stop].any() and kept.sum() == 192 - (stop - start)
        assert bits.any_bit(block) == kept.any()
        assert [bits.has(block, bit) for bit in range(192)] == kept.tolist()
