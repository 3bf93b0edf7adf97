"""Multilinear interpolation of a table, as a function of points that formulas know."""

from collections.abc import Callable
from functools import partial
from typing import Any

from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import Lookup, interned, leaf


def gridded(values: Any, lower: Any, spacing: Any) -> Callable[[Any], Any]:
    """A function of points (M, axes) -> (M,) that interpolates values given at the nodes of a grid, multilinearly.

    Beyond the ends of the grid its value is that at the nearest point of the grid. Where a coordinate is NaN, it is
    NaN. Within a level set, drift or gain it is read as part of the formula.

    Parameters
    ----------
    values : array of 1 to 6 axes, at least two nodes each
        Copied, unless it is a read-only, contiguous float64 array that owns its memory.
    lower, spacing : float, one for each axis
        The coordinate of the first node, and the distance from node to node, in the axes' units.

    Returns
    -------
    callable (points (M, axes)) -> (M,)

    Raises
    ------
    ValueError
        If values are not finite, shapes do not fit, or the values take more than 2^30 bytes, which is the limit for all
        tables of a problem together.

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
    axes = len(table.lower)
    node = interned("gridded", tuple(leaf("x", axis) for axis in range(axes)), table)
    formula = Formula((node,), axes, 0, name="what sdhj.gridded returns")
    return partial(formula, finite=False)
