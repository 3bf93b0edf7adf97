"""A cache that an object carries, of what other code has computed about it."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar

T = TypeVar("T")


class Remembering:
    """Base class of objects that carry a cache of what other code has computed about them, filled by `remembered`.

    The cache starts empty, is never emptied, and takes no part in comparing or pickling the object. Values are kept
    under keys that the callers choose; no lock is held, so two threads may both compute one value.
    """

    @cached_property
    def _remembered(self) -> dict[Any, Any]:
        """The cache: {key: value}, empty at first."""
        return {}

    def remembered(self, key: Any, find: Callable[[], T]) -> T:
        """Return the value kept under a hashable key; where there is none yet, call `find()` and keep what it returns.

        The same object is returned each time, not a copy. `find` must give the same answer whenever it is called with
        this key.
        """
        if key not in self._remembered:
            self._remembered[key] = find()
        found: T = self._remembered[key]
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The attributes that are pickled: all but the cache."""
        return {name: value for name, value in vars(self).items() if name != "_remembered"}
