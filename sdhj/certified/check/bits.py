"""Compiled operations on the packed sets of a file.

A *block* holds the bits of the agent's cells for one pair of joint cells (a *row*): cell (x, y) of nx times ny is bit
x * ny + y, bit b is bit b % 64 of word b // 64.
"""

from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[Any]

ONE = np.uint64(1)
NONE = np.uint64(0)


@cache
def sources() -> str:
    """A digest of the files of this folder."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return blake2b(b"".join(file.read_bytes() for file in files)).hexdigest()


def compiled(**options: Any) -> Callable[[Any], Any]:
    """`numba.njit`, kept on disk until any file of this folder changes; Numba alone looks at one file only."""

    def compile_it(function: Any) -> Any:
        dispatcher = njit(cache=True, **options)(function)
        kept: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if hasattr(kept, "_source_stamp"):
            kept._source_stamp = kept._source_stamp, sources()
        return dispatcher

    return compile_it


@compiled()
def has(block, bit):
    return (block[bit >> 6] >> np.uint64(bit & 63)) & ONE != NONE


@compiled()
def drop(block, start, stop):
    """Clear the bits start..stop-1, in place."""
    for word in range(start >> 6, ((stop - 1) >> 6) + 1):
        mask = ~NONE
        if word == start >> 6:
            mask &= ~NONE << np.uint64(start & 63)
        if word == (stop - 1) >> 6:
            mask &= ~NONE >> np.uint64(63 - ((stop - 1) & 63))
        block[word] &= ~mask


@compiled()
def any_bit(block):
    for word in block:
        if word != NONE:
            return True
    return False


@compiled(parallel=True)
def erode(pool, along_x, along_y, out):
    """For every block the cells (x, y) for which it holds all of along_x[x] times along_y[y]; written to `out`.

    along_x (nx, most), along_y (ny, most) : cells, the last one repeated
    """
    nx, ny = along_x.shape[0], along_y.shape[0]
    for number in prange(pool.shape[0]):
        block, cells, column = pool[number], np.empty(64 * pool.shape[1], np.bool_), np.empty(ny, np.bool_)
        for word in range(block.size):
            for bit in range(64):
                cells[64 * word + bit] = (block[word] >> np.uint64(bit)) & ONE
        out[number] = NONE
        for x in range(nx):
            column[:] = True
            for other in along_x[x]:
                column &= cells[other * ny : other * ny + ny]
            for y in range(ny):
                inside = True
                for other in along_y[y]:
                    inside &= column[other]
                out[number, (x * ny + y) >> 6] |= np.uint64(inside) << np.uint64((x * ny + y) & 63)
