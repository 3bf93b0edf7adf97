"""Multilinear interpolation of a table, as a function of points that formulas know."""

from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import blake2b
from itertools import product
from typing import Any

import numpy as np

from sdhj.formulas.tracing import Traced, gridded_entries
from sdhj.kernels import FloatArray

MOST_AXES = 6


@dataclass(frozen=True)
class Lookup:
    """Values at the nodes lower + i * spacing of a grid; two with the same numbers are equal."""

    values: FloatArray = field(compare=False, repr=False)
    lower: tuple[float, ...]
    spacing: tuple[float, ...]
    digest: str

    @classmethod
    def of(cls, values: Any, lower: Any, spacing: Any) -> "Lookup":
        """ValueError where they do not fit each other."""
        array = np.array(values, dtype=np.float64, order="C")
        low, step = (tuple(np.atleast_1d(np.asarray(one, dtype=np.float64)).tolist()) for one in (lower, spacing))
        if not 1 <= array.ndim <= MOST_AXES or min(array.shape) < 2 or not np.isfinite(array).all():
            raise ValueError(
                f"values must be finite, on 1 to {MOST_AXES} axes with two nodes at least, got {array.shape}"
            )
        if (
            not len(low) == len(step) == array.ndim
            or not np.isfinite(low).all()
            or not (np.isfinite(step).all() and min(step) > 0)
        ):
            raise ValueError(
                f"lower and spacing must be {array.ndim} numbers, the spacing above 0, got {low} and {step}"
            )
        array.setflags(write=False)
        return cls(array, low, step, blake2b(repr(array.shape).encode() + array.tobytes(), digest_size=16).hexdigest())


def gridded(values: Any, lower: Any, spacing: Any) -> Callable[[Any], Any]:
    """A function of points that interpolates values given at the nodes of a grid, multilinearly.

    Beyond the ends of the grid it has the value at the end.

    Parameters
    ----------
    values : array of 1 to 6 axes, at least two nodes each
    lower, spacing : float, one for each axis
        Where the first node is, and how far nodes are apart.

    Returns
    -------
    function of points (M, axes) -> (M,)

    Raises
    ------
    ValueError
        If values are not finite or the shapes do not fit.

    Examples
    --------
    Wind that grows from 0 to 2 m/s within 10 m of height:

    >>> import numpy as np
    >>> import sdhj
    >>> wind = sdhj.gridded([0.0, 2.0], lower=[0.0], spacing=[10.0])
    >>> wind(np.array([[5.0], [20.0]]))
    array([1., 2.])
    """
    table = Lookup.of(values, lower, spacing)

    def interpolated(points: Any) -> Any:
        if isinstance(points, Traced):
            if points.ndim != 2 or points.shape[1] != table.values.ndim:
                raise ValueError(f"points must have shape (M, {table.values.ndim}), got {points.shape}")
            return gridded_entries(list(points.T), table)
        return looked_up(table, np.asarray(points, dtype=np.float64))

    return interpolated


def looked_up(table: Lookup, points: FloatArray) -> FloatArray:
    """The interpolated values at points (M, axes), in NumPy: (M,)."""
    if points.ndim != 2 or points.shape[1] != table.values.ndim:
        raise ValueError(f"points must have shape (M, {table.values.ndim}), got {points.shape}")
    nodes = np.array(table.values.shape)
    place = np.clip((points - np.array(table.lower)) / np.array(table.spacing), 0.0, nodes - 1.0)
    first = np.minimum(np.floor(np.nan_to_num(place)).astype(np.int64), nodes - 2)
    share, out = place - first, np.zeros(len(points))
    for corner in product((0, 1), repeat=table.values.ndim):
        weight = np.prod(np.where(corner, share, 1.0 - share), axis=1)
        out += weight * table.values[tuple((first + corner).T)]
    return out
