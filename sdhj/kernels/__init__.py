"""All compiled code, and how it is compiled; it imports nothing of the rest."""

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[Any]
T = TypeVar("T")


def read_only(value: T) -> T:
    """Make an array, or all those in tuples, lists and mappings, read-only in place; returns what was given.

    So is every array that somebody keeps, from the beginning: to compiled code what may not be written has another
    type, and a kernel that is given both is compiled twice.
    """
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple | list | dict):
        for one in value.values() if isinstance(value, dict) else value:
            read_only(one)
    return value


def _refuse(self: Any, *_: Any, **__: Any) -> Any:
    """Raise TypeError, which says how to write to a copy: what every method of `Sealed` and `SealedList` that
    would write does.
    """
    kind = "dict" if isinstance(self, dict) else "list"
    raise TypeError(f"this {kind} is read-only, as everything that is handed out; write to a copy, {kind}(it)")


class Sealed(dict[str, Any]):
    """A dict that cannot be written, nor the mappings and lists in it, TypeError; `dict(it)` is a copy that can."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        """A copy of a mapping, sealed at every depth (`unwritable`)."""
        super().__init__({name: unwritable(one) for name, one in given.items()})

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> Any:
        """Pickle its entries, so that it is sealed again when it is unpickled."""
        return Sealed, (dict(self),)


class SealedList(list[Any]):
    """A list that cannot be written, nor the mappings and lists in it, TypeError; `list(it)` is a copy that can."""

    def __init__(self, given: Iterable[Any]) -> None:
        """A copy of a list, sealed at every depth (`unwritable`)."""
        super().__init__(map(unwritable, given))

    __setitem__ = __delitem__ = __iadd__ = __imul__ = append = extend = insert = _refuse
    pop = remove = clear = sort = reverse = _refuse

    def __reduce__(self) -> Any:
        """Pickle its entries, so that it is sealed again when it is unpickled."""
        return SealedList, (list(self),)


def unwritable(value: Any) -> Any:
    """The value with mappings and lists, at every depth, as `Sealed` and `SealedList` copies; anything else is
    the same object.
    """
    if isinstance(value, Mapping):
        return Sealed(value)
    if type(value) is tuple:
        parts = tuple(map(unwritable, value))  # the same object where nothing of it could be written
        return value if all(one is other for one, other in zip(parts, value, strict=True)) else parts
    return SealedList(value) if isinstance(value, list) else value


class kept(cached_property[T]):
    """A `cached_property` whose arrays are made read-only in place, and whose mappings and lists are sealed copies."""

    def __init__(self, function: Callable[[Any], T]) -> None:
        """Make the property of a method, whose value is made read-only once it is found."""

        def found(self: Any) -> Any:
            """The method's value, made read-only."""
            return unwritable(read_only(function(self)))

        super().__init__(wraps(function)(found))
