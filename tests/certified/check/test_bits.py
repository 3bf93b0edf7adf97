"""Packed sets of a file, against plain arrays."""

import pickle
import shutil
from types import SimpleNamespace

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


def test_code_that_is_not_what_was_kept_is_not_run(tmp_path):
    """It is of these sources and this stamp, of this key, and each byte of it is what was written."""

    def kept(stamp):
        return bits.Kept(
            SimpleNamespace(_source_stamp=stamp, _index_name="f", _cache_path=tmp_path, _dump=pickle.dumps)
        )

    ours = kept((1, 2))
    ours.save("key", "code")
    ours.save("other", "more code")
    file, other = ours.place("key"), ours.place("other")
    assert (ours.load("key"), ours.load("other")) == ("code", "more code")
    assert {*tmp_path.iterdir()} == {file, other} and file.name.startswith("f.")
    with pytest.raises(OSError, match="No such file"):
        ours.load("nobody's")
    assert kept((1, 3)).load("key") is None
    shutil.copy(file, other)
    assert ours.load("other") is None
    whole = file.read_bytes()
    for place in (0, 63, 64, len(whole) - 1):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert ours.load("key") is None
    file.write_bytes(whole[:-1])
    assert ours.load("key") is None
