"""All compiled code, and how it is compiled; it imports nothing of the rest."""

from collections.abc import Callable, Mapping
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


class Sealed(dict[str, Any]):
    """A mapping that cannot be written, nor the mappings in it; `dict(mapping)` is a copy that can."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        super().__init__({name: Sealed(one) if isinstance(one, Mapping) else one for name, one in given.items()})

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise TypeError("this mapping is read-only, as everything that is handed out; write to a copy, dict(mapping)")

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> Any:
        return Sealed, (dict(self),)


class kept(cached_property[T]):
    """A `cached_property` whose arrays are read-only, and whose mapping is."""

    def __init__(self, function: Callable[[Any], T]) -> None:
        def found(self: Any) -> Any:
            value = read_only(function(self))
            return Sealed(value) if isinstance(value, dict) else value

        super().__init__(wraps(function)(found))
