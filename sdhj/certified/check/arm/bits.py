"""Operations on the packed sets of a file, and how they are compiled.

The agent is the pursuer or the evader of an arm, whose position is in the state. A *block* holds the bits of its cells
for one pair of joint cells (a *row*): cell (x, y) of nx times ny is bit x * ny + y, bit b bit b % 64 of word b // 64.
"""

import os
import pickle
import uuid
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import njit
from numba.core.options import DefaultOptions
from numpy.typing import NDArray

Array = NDArray[Any]

ONE = np.uint64(1)
NONE = np.uint64(0)
SOURCES = blake2b(b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.rglob("*.py")))).hexdigest()
# Numba would count the references to each array, which threads share; versions without the option do, and are slower.
UNCOUNTED: Any = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def compiled(**options: Any) -> Callable[[Any], Any]:
    """A decorator that compiles a function by `numba.njit(**options)` and keeps the machine code on disk.

    Kept code is read in later processes, unless any file of this folder has changed or the code is damaged: then the
    function is compiled anew, as it is where no folder can be written. Numba's own cache looks at one file only, and
    runs damaged code.
    """

    # its code is kept on disk behind a digest, where a folder can be written
    def compile_it(function: Any) -> Any:
        try:
            dispatcher = njit(cache=True, **options)(function)
        except RuntimeError:  # no folder for it can be written
            return njit(**options)(function)
        kept: Any = getattr(dispatcher, "_cache", None)
        if hasattr(kept, "_guard_against_spurious_io_errors") and hasattr(kept._cache_file, "_source_stamp"):
            kept._cache_file = Kept(kept._cache_file)
            kept._guard_against_spurious_io_errors = lambda: suppress(Exception)  # code is not kept or not found
        return dispatcher

    return compile_it


class Kept:
    """Machine code kept on disk, in files that begin with a digest of the code and of the sources it was made of."""

    def __init__(self, files: Any) -> None:
        """Keep code in the folder of Numba's cache `files`, stamped with Numba's version and this folder's sources."""
        self.files, self.made_of = files, f"{numba.__version__} {files._source_stamp!r} {SOURCES}".encode()

    def place(self, key: Any) -> Path:
        """The path of the file of the code for a key, Numba's signature and target."""
        name = f"{self.files._index_name}.{blake2b(repr(key).encode(), digest_size=16).hexdigest()}"
        return Path(self.files._cache_path) / name

    def load(self, key: Any) -> Any:
        """The code that is kept under a key; None where a digest or the key does not fit. OSError without a file.

        Numba asks it in place of its own cache file; `compiled` takes every exception as a function to be compiled.
        """
        whole = self.place(key).read_bytes()
        # Compiled code is run: whatever is not what was kept is compiled anew.
        if whole[:64] != blake2b(self.made_of + whole[64:]).digest():
            return None
        known, code = pickle.loads(whole[64:])
        return code if known == key else None

    def save(self, key: Any, data: Any) -> None:
        """Keep the code `data` under a key, behind its digest; the file appears whole or not at all."""
        code, beside = self.files._dump((key, data)), self.place(key).with_suffix(f".{uuid.uuid4().hex}")
        try:
            beside.write_bytes(blake2b(self.made_of + code).digest() + code)
            os.replace(beside, self.place(key))
        finally:
            beside.unlink(missing_ok=True)


@compiled()
def has(block, bit):
    """Whether bit number `bit` of packed words, `block` (words,) uint64, is set; it must be one of these."""
    return (block[bit >> 6] >> np.uint64(bit & 63)) & ONE != NONE


@compiled()
def drop(block, start, stop):
    """Clear the bits start..stop-1 of packed words, `block` (words,) uint64, in place; start < stop."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        mask = ~NONE
        if word == start >> 6:
            mask &= ~NONE << np.uint64(start & 63)
        if word == (stop - 1) >> 6:
            mask &= ~NONE >> np.uint64(63 - ((stop - 1) & 63))
        block[word] &= ~mask


@compiled()
def any_bit(block):
    """Whether any bit of packed words, `block` (words,) uint64, is set."""
    for word in block:
        if word != NONE:
            return True
    return False


def erode(pool: Array, along_x: Array, along_y: Array) -> Array:
    """For every block of `pool` the cells (x, y) for which it has all of along_x[x] x along_y[y]: (blocks, words).

    pool (blocks, words) : uint64; blocks do not depend on one another, so threads may share them out.
    along_x (nx, most), along_y (ny, most) : for each cell of an axis the cells that are needed, int, each on the axis;
        where there are fewer than `most` the last one is repeated.
    """
    words, cells = pool.shape[1], np.indices((len(along_x), len(along_y))).reshape(2, -1)

    # flags (cells,) bool as bits of 64-bit words, the first in the lowest bit
    def in_bits(flags: Array) -> Array:
        return np.packbits(np.pad(flags, (0, 64 * words - flags.size)), bitorder="little").view(np.uint64)

    for axis, along, stride in ((0, along_x, len(along_y)), (1, along_y, 1)):
        known, every = np.pad(pool, ((0, 0), (words, words + 1))), np.tile(in_bits(cells[0] >= 0), (len(pool), 1))
        # How far the cells that are needed are from each; few distances serve all cells.
        offsets = along - np.arange(len(along))[:, None]
        for offset in np.unique(offsets):  # of all blocks the bits that are so far from others, word by word
            needs = in_bits((offsets == offset).any(axis=1)[cells[axis]])
            word, bit = divmod(int(offset) * stride, 64)
            near, following = (known[:, words + at : 2 * words + at] for at in (word, word + 1))
            every &= (near >> bit) | (following << 1 << (63 - bit)) | ~needs
        pool = every
    return pool
