"""What is done where little memory is free."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock


@contextmanager
def room(nbytes: int | None) -> Iterator[None]:
    """So many bytes are free, and whatever is asked for is counted; None: the system does not say."""
    free = None if nbytes is None else (nbytes, "are available")
    with (
        mock.patch("sdhj.common.memory.available", lambda: free),
        mock.patch("sdhj.common.memory.SPARE", 0),
        mock.patch("sdhj.certified.check.reading.free_memory", lambda: [] if nbytes is None else [nbytes]),
    ):
        yield
