"""Compiling kernels, and saying so: the first use takes up to half a minute in which nothing else happens."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.event import Listener, install_listener
from numba.extending import overload
from tqdm import tqdm

LINE = "compiling for this machine, up to half a minute; later runs read it from a cache"
_listening: list[Listener] = []


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function as `numba.njit(**options)` does, and keep the machine code on disk for the next process.

    Numba's own disk cache watches the one file that a function stands in, and would run on with an old helper or
    constant of another file. Here any change to a file of this package throws what is kept away. Functions compiled in
    other packages or notebooks may use it too: changes to their own file count as ever.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = njit(cache=True, **options)(function)
        # Numba offers no way to say so: where its insides differ (or nothing is compiled) its own rule stays
        kept: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if hasattr(kept, "_source_stamp"):
            kept._source_stamp = kept._source_stamp, package_digest()
        return dispatcher

    return compiled


def inlined(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function into each compiled one that calls it, anew for all types of arguments; options as `kernel`.

    It may call itself with the rest of a tuple: `if len(rest) == 0` is then decided, and the calls are unrolled, when
    compiling. (Such a test must be of an argument itself: what is not decided must fit all types.)
    """

    inside: Any = {"forceinline": True, **options}

    def compiled(function: Callable[..., Any]) -> Any:
        overload(function, strict=False, jit_options=inside)(lambda *types: function)
        return function

    return compiled


def chosen(table: Mapping[Any, Callable[..., Any]]) -> Callable[..., Any]:
    """A function that is one of a table of `inlined` ones: its first argument is `choice(table, name)`, others follow.

    Which one it is, is known when compiling: the length of a tuple is part of its type.
    """
    functions = tuple(table.values())

    def call(place: tuple[int, ...], *arguments: Any) -> Any:
        return functions[len(place)](*arguments)

    def compiled(place: Any, *types: Any) -> Callable[..., Any]:
        function = functions[len(place)]
        return lambda place, *arguments: function(*arguments)

    overload(call, strict=False, jit_options={"forceinline": True})(compiled)
    return call


def choice(table: Mapping[Any, Any], name: Any) -> tuple[int, ...]:
    """What stands for an entry of a table where `chosen` picks a function: as many zeros as entries precede it."""
    return (0,) * list(table).index(name)


@cache
def package_digest() -> str:
    """A digest of all source files of this package, names included."""
    folder, digest = Path(__file__).parent, blake2b(digest_size=16)
    for file in sorted(folder.rglob("*.py")):
        text = file.read_bytes()
        digest.update(f"{file.relative_to(folder).as_posix()} {len(text)} ".encode() + text)
    return digest.hexdigest()


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
