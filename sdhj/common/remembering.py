"""What all rooms keep their results in: arrays and mappings that cannot be written, and objects that remember."""

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[Any]
T = TypeVar("T")


def read_only(value: T) -> T:
    """Make an array, or all arrays in tuples, lists and dicts, read-only in place.

    To compiled code it has another type, and a kernel that is given both kinds is compiled twice.
    """
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple | list | dict):
        for one in value.values() if isinstance(value, dict) else value:
            read_only(one)
    return value


def _refuse(self: Any, *_: Any, **__: Any) -> Any:
    """Raise TypeError, which says how to write to a copy."""
    kind = "dict" if isinstance(self, dict) else "list"
    raise TypeError(f"this {kind} is read-only, as everything that is handed out; write to a copy, {kind}(it)")


class Sealed(dict[str, Any]):
    """A dict that cannot be written, nor the mappings and lists in it; `dict(sealed)` can be."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        super().__init__({name: sealed_copy(one) for name, one in given.items()})

    # all methods of dict that write: one that is missing here writes
    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> Any:
        """Pickle as a dict, which is sealed again when it is read."""
        return Sealed, (dict(self),)


class SealedList(list[Any]):
    """A list that cannot be written, nor the mappings and lists in it; `list(sealed)` can be."""

    def __init__(self, given: Iterable[Any]) -> None:
        super().__init__(map(sealed_copy, given))

    __setitem__ = __delitem__ = __iadd__ = __imul__ = append = extend = insert = _refuse
    pop = remove = clear = sort = reverse = _refuse

    def __reduce__(self) -> Any:
        """Pickle as a list, which is sealed again when it is read."""
        return SealedList, (list(self),)


def sealed_copy(value: Any) -> Any:
    """A mapping or list as a `Sealed` or `SealedList` copy, a tuple with its entries so."""
    if isinstance(value, Mapping):
        return Sealed(value)
    if type(value) is tuple:
        parts = tuple(map(sealed_copy, value))  # the same object where nothing of it could be written
        return value if all(one is other for one, other in zip(parts, value, strict=True)) else parts
    return SealedList(value) if isinstance(value, list) else value


class kept(cached_property[T]):
    """A `cached_property` whose value cannot be written: arrays are read-only, mappings and lists sealed copies."""

    def __init__(self, function: Callable[[Any], T]) -> None:
        def found(self: Any) -> Any:
            return sealed_copy(read_only(function(self)))

        super().__init__(wraps(function)(found))


class ReadOnly:
    """Base class of objects whose arrays cannot be written, nor can those of their copies and pickles."""

    def __post_init__(self) -> None:
        """Make the fields of a dataclass read-only in place."""
        read_only(vars(self))

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Take the attributes of the original, whose copied arrays can be written until they are here."""
        vars(self).update(read_only(state))


class Remembering(ReadOnly):
    """Base class of objects that carry a cache, neither compared nor pickled, of what others computed about them."""

    def remembered(self, key: Any, find: Callable[[], T]) -> T:
        """The value kept under a hashable key, at first `find()`, which hangs on the object and the key alone."""
        # all who ask of one object share its keys: two that use one for different things get each other's
        known = vars(self).setdefault("_remembered", {})
        if key not in known:  # without a lock: two threads may both compute one value
            known[key] = find()
        found: T = known[key]
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The attributes that are pickled: all but the cache."""
        return {name: value for name, value in vars(self).items() if name != "_remembered"}
