"""All compiled code, and how it is compiled; it imports nothing of the rest."""

from collections.abc import Callable
from functools import cached_property, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[Any]
T = TypeVar("T")


def read_only(value: T) -> T:
    """An array, or all those in tuples, lists and mappings, made read-only in place.

    So is every array that somebody keeps, from the beginning: to compiled code what may not be written has another
    type, and a kernel that is given both is compiled twice.
    """
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple | list | dict):
        for one in value.values() if isinstance(value, dict) else value:
            read_only(one)
    return value


class kept(cached_property[T]):
    """A `cached_property` whose arrays are read-only."""

    def __init__(self, function: Callable[[Any], T]) -> None:
        super().__init__(wraps(function)(lambda self: read_only(function(self))))
