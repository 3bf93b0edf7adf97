"""What is shown while a person waits: whether bars are, and a line before the first kernel is compiled."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.event import Listener, install_listener
from tqdm import tqdm

LINE = "compiling for this machine, up to a minute; later runs read it from a cache"
_listening: list[Listener] = []


class _Announcer(Listener):
    """A listener to Numba that writes `LINE` when the first kernel of this package is compiled, not read."""

    said = False

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if not self.said and function.__module__.startswith("sdhj."):
            self.said = True
            tqdm.write(LINE, file=sys.stderr)  # above a progress bar, should there be one

    def on_end(self, event: Any) -> None:
        """Numba's listeners must have this method."""
        pass


def hidden(progress: bool | None) -> bool:
    """Whether nothing is to be shown while work goes on: as `progress` says; for None, without a terminal."""
    stream: Any = sys.stderr
    # a program without a console has none, which tqdm does not survive
    return stream is None or not (stream.isatty() if progress is None else progress)


@contextmanager
def announced(progress: bool | None = None) -> Iterator[None]:
    """A context that says once on standard error that kernels are compiled, should any be, unless `progress` is False.

    Also where standard error is no terminal, but for cells of notebooks, which would keep it.
    """
    in_cell = type(sys.stderr).__module__.startswith("ipykernel")
    if _listening or in_cell or hidden(progress is not False):  # what is around it says it already
        yield
        return
    listener = _Announcer()
    _listening.append(listener)
    try:
        with install_listener("numba:compile", listener):
            yield
    finally:
        _listening.remove(listener)
