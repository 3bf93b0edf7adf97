"""What others found out about an object, which goes with it."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar

T = TypeVar("T")


class Remembering:
    """Base of objects with which others keep what they find out about them (`remembered`); it is neither compared
    nor pickled.
    """

    @cached_property
    def _remembered(self) -> dict[Any, Any]:
        """The values found, by key; {} at first."""
        return {}

    def remembered(self, key: Any, find: Callable[[], T]) -> T:
        """The value of `find()`, which is called only the first time that this key is asked for; then the value
        is kept.
        """
        if key not in self._remembered:
            self._remembered[key] = find()
        found: T = self._remembered[key]
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The attributes that are pickled: all but what was found out."""
        return {name: value for name, value in vars(self).items() if name != "_remembered"}
