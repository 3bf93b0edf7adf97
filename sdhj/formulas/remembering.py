"""What many objects carry: arrays that cannot be written, and a cache of what other code has computed about them."""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, TypeVar

from sdhj.kernels import read_only

T = TypeVar("T")


class ReadOnly:
    """Base class of objects whose arrays cannot be written, nor can those of their copies and pickles."""

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Take the attributes of the original, whose copied arrays can be written until they are here."""
        vars(self).update(read_only(state))


class Remembering(ReadOnly):
    """Base class of objects that carry a cache, neither compared nor pickled, of what others computed about them."""

    @cached_property
    def _remembered(self) -> dict[Any, Any]:
        return {}

    def remembered(self, key: Any, find: Callable[[], T]) -> T:
        """The value kept under a hashable key, at first `find()`, which hangs on the object and the key alone."""
        # without a lock: two threads may both compute one value
        if key not in self._remembered:
            self._remembered[key] = find()
        found: T = self._remembered[key]
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The attributes that are pickled: all but the cache."""
        return {name: value for name, value in vars(self).items() if name != "_remembered"}
