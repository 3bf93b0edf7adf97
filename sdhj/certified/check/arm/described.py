"""What the file of an arm says of its sensing, its cells and its sets, every number of it checked."""

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from sdhj.certified.check.files import Arrays
from sdhj.certified.check.intervals import Array
from sdhj.certified.check.reading import MOST_ON_AN_AXIS, array, edges_of, expect, fraction, is_whole, real, reals


class Sensing:
    """How the robot senses: `error` (ndim,) of a measurement, `delay` and `jitter`, s, and `memory`, bool.

    It is True as a truth value where anything is uncertain.
    """

    def __init__(self, head: Mapping[str, Any], ndim: int, delta: float) -> None:
        """Read the head's entry for sensing; ValueError where a number is negative or too large."""
        error = head.get("error", 0.0)
        self.error = np.array(reals("error", error if isinstance(error, list) else [error] * ndim, ndim, 0.0))
        self.delay = real("delay", head.get("delay", 0.0), 0.0, delta)
        self.jitter = real("jitter", head.get("jitter", 0.0), 0.0, delta / 2)
        self.memory = head.get("memory", False)
        expect(self.memory in (True, False), "memory must be true or false", self.memory)

    def __bool__(self) -> bool:
        """Whether an error, a delay or a jitter is above 0."""
        return bool(self.error.any()) or self.delay > 0 or self.jitter > 0


class Sets:
    """The cells of each axis, and the certified sets, as a file states them; base of `Arm`.

    A row is a cell of the first axes; each set has a block for each row, whose bits are the cells of the other axes.

    axes : for each axis its lower end, the width of a cell, and the least and the greatest length, as fractions. layers
    : at the lower and the upper end of each axis. counts (ndim,) : of cells, layers included. index (entries, rows) :
    for each set and row the number of a block of the pool (blocks, words).
    """

    def __init__(self, head: Mapping[str, Any], arrays: Arrays, ndim: int, rows: int, entries: int | None) -> None:
        """Read the cells of `ndim` axes and the sets on them; ValueError where an entry or an array does not fit."""
        shape, ends = head["shape"], zip(head["lowers"], head["widths"], head["extents"], strict=True)
        expect(all(is_whole(n, 2, MOST_ON_AN_AXIS) for n in shape), "shape must be numbers of cells", shape)
        self.axes = [(fraction(low), fraction(width), *map(fraction, extent)) for low, width, extent in ends]
        expect(len(self.axes) == len(shape) == ndim, f"the problem has {ndim} axes", shape)
        self.layers = [*map(list, head.get("layers", [(0, 0)] * ndim))]
        whole = all(len(pair) == 2 and all(is_whole(n, 0, 1) for n in pair) for pair in self.layers)
        expect(whole and len(self.layers) == ndim, "layers must be 0 or 1 at both ends of each axis", self.layers)
        self.counts, packed = np.array(shape), math.prod(shape[rows:])
        self.index = array(arrays, "index", np.uint32, entries, math.prod(shape[:rows]))
        self.pool = array(arrays, "pool", np.uint64, int(self.index.max()) + 1, -(-packed // 64))
        # Whole words are compared and counted: bits past the last cell would count as cells.
        beyond = self.pool[:, -1] >> np.uint64(packed % 64) if packed % 64 else np.zeros(1)
        expect(not beyond.any(), "the sets must have no cells that there are not", packed)

    @cached_property
    def edges(self) -> list[Array]:
        """The ends of the cells of each axis, (n + 1,)."""
        return [edges_of(*one) for one in zip(self.counts.tolist(), self.axes, self.layers, strict=True)]

    def uncovered(self, ends: Iterable[tuple[Fraction | None, Fraction, Fraction, Fraction]]) -> list[str]:
        """A text for each axis that its cells do not cover, or would cover without the last one; [] if all is well."""
        # `Argument.uncovered` asks the same of other robots' cells
        wrong: list[str] = []
        own = zip(self.counts.tolist(), map(sum, self.layers), self.axes, ends, strict=True)
        for axis, (cells, some, (low, width, least, most), (begin, shortest, longest, doubt)) in enumerate(own):
            # an axis may begin anywhere where `begin` is None, as an angle may
            n = cells - some
            fits = least <= shortest and most >= longest and most - least <= doubt and begin in (None, low)
            if not (fits and (n - 1) * width < least and n * width >= most):
                wrong.append(f"axis {axis}: {n} cells of width {float(width):.6g} do not cover it")
        return wrong
