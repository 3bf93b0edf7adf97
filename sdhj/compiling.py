"""Saying when kernels are being compiled: the first use takes up to half a minute in which nothing else happens."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.event import Listener, install_listener
from tqdm import tqdm

LINE = "compiling for this machine, up to half a minute; later runs read it from a cache"
_listening: list[Listener] = []


class _Announcer(Listener):
    """Says `LINE` when the first kernel of this package is compiled, not when it is read from the cache."""

    said = False

    def on_start(self, event: Any) -> None:
        kernel = event.data["dispatcher"].py_func
        if not self.said and kernel.__module__.startswith("sdhj."):
            self.said = True
            tqdm.write(LINE, file=sys.stderr)  # above a progress bar, should there be one

    def on_end(self, event: Any) -> None:
        pass


def hidden(progress: bool | None) -> bool:
    """Whether nothing is to be shown while work goes on; progress as for `solve`.

    A program without a console, or with that descriptor closed, has no standard error, which tqdm does not survive.
    """
    stream: Any = sys.stderr
    return stream is None or not (stream.isatty() if progress is None else progress)


@contextmanager
def announced(progress: bool | None = None) -> Iterator[None]:
    """Within it, say once on standard error that kernels are compiled, should any be.

    progress : as for `solve`; by default where standard error is a terminal.
    """
    if _listening or hidden(progress):  # what is around it says it already
        yield
        return
    listener = _Announcer()
    _listening.append(listener)
    try:
        with install_listener("numba:compile", listener):
            yield
    finally:
        _listening.remove(listener)
