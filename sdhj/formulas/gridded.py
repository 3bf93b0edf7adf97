"""Multilinear interpolation of a table, as a function of points that formulas know."""

from collections.abc import Callable
from functools import partial
from typing import Any

from sdhj.formulas.formula import Formula
from sdhj.formulas.graph import Lookup, interned, leaf


def gridded(values: Any, lower: Any, spacing: Any) -> Callable[[Any], Any]:
    """A function of points (M, axes) -> (M,) that interpolates values at the nodes of a grid, multilinearly.

    Beyond the grid it is the value at the nearest point; NaN for NaN. Within a level set, drift or gain it is read as
    part of the formula.

    Parameters
    ----------
    values : array of 1 to 6 axes, at least two nodes each
        Copied, unless read-only, contiguous float64 that owns its memory.
    lower, spacing : float, one for each axis
        The first node, and the distance from node to node.

    Raises
    ------
    ValueError
        If all tables of a problem take more than 2^30 bytes.

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
