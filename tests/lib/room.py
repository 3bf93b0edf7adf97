"""What is done where little memory is free."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

from sdhj.certified.check import reading as reading_module
from sdhj.common import memory as memory_module


@contextmanager
def room(nbytes: int | None) -> Iterator[None]:
    """So many bytes are free, and whatever is asked for is counted; None: the system does not say."""
    free = None if nbytes is None else (nbytes, "are available")
    with (
        mock.patch.object(memory_module, memory_module.available.__name__, lambda: free),
        mock.patch.object(memory_module, "SPARE", 0),
        mock.patch.object(
            reading_module, reading_module.free_memory.__name__, lambda: [] if nbytes is None else [nbytes]
        ),
    ):
        yield
