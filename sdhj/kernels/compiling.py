"""How a kernel is compiled, kept on disk, and run by threads.

Numba makes of each function, by itself, code that LLVM has optimised, machine code, and wrappers for callers in Python
and C; where another function calls it, its code is linked into that one and optimised again. Of some two hundred
functions here Python calls a dozen. So a kernel is two functions to Numba (`Kernel`):

- the one that Python calls is compiled as ever, and kept on disk (`Whole`, `MachineCode`);
- the one that compiled code calls, `within`, has no wrappers, is only translated into LLVM's language (`Linked`), and
  is optimised once, as a part of each whole kernel that it is linked into. So is all else that is compiled on the way:
  NumPy's functions, loops that threads share. It is never kept on disk by itself.

A kernel that is called from both sides is compiled twice, so its code depends on sources and types alone: not on which
side called first, nor on what other processes left on disk. All this rests on parts of Numba that it does not promise;
where a version lacks one (`LINKED` is False), every kernel is compiled as Numba does: slower, to the same results.
"""

import gc
import os
import pickle
import sys
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numba
from numba import get_num_threads, njit, set_num_threads, threading_layer, types  # type: ignore[attr-defined]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.options import DefaultOptions
from numba.core.registry import CPUDispatcher, cpu_target
from numba.extending import overload

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

FEW = 2**16  # numbers: to share out fewer costs more than it saves, most of all on a busy machine
SELDOM = 100_000  # objects that are made between two looks for garbage while a kernel is compiled; Python's own is 700
GLANCE = 0.05  # s between two looks at how many cores are free
KEPT_DAYS = 30  # that a version of a compiled kernel is kept on disk when nobody uses it
PROC = Path("/proc")  # where Linux says so
# Numba would count the references to every array: a view made or dropped is an atomic step on a count that all threads
# share, and many loops here are shorter. Without the counts the compiler also refuses whatever would allocate.
# The option is not among Numba's documented ones: a version without it counts, and takes twice as long.
UNCOUNTED: Any = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}
WITHIN: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # of a function that only compiled code calls
# By NumPy's rules of division nothing asks whether a divisor is 0. All kernels have them: NumPy's functions, and those
# that are `inlined`, are compiled anew for each set of options of the functions that call them.
#
# No other liberty is given to the compiler. Were it allowed to fuse multiplications and additions, it would do so in
# the part of a row that it vectorises otherwise than in what is left over, and the bits of a node would hang on where
# its row begins and on how the row is cut, which the version of Python decides.
DIVISION: Any = {"error_model": "numpy"}
INLINED: Any = {"forceinline": True, **DIVISION, **WITHIN}
LOOP = "__numba_parfor"  # how Numba names what threads do of a loop; were it another name, that would be made whole
# Whether this version of Numba has what `Whole` and `Linked` use of its insides.
LINKED = all(
    hasattr(JITCodeLibrary, name)
    for name in (
        "_optimize_final_module",
        "_finalize_final_module",
        "_finalize_dynamic_globals",
        "_finalized",
    )
) and hasattr(CompileResult, "_find_referenced_environments")
LINKED = LINKED and all(hasattr(cpu_target.target_context.codegen(), name) for name in ("_library_class", "set_env"))


def kernel(least: int = 0, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function as `numba.njit(error_model="numpy", **options)` does, and keep the machine code on disk.

    With parallel=True, loops are shared out to threads if the largest array has `least` entries.
    """

    options = {**DIVISION, **options}

    def compiled(function: Callable[..., Any]) -> Any:
        whole = {"pipeline_class": Whole, **options} if LINKED else options
        try:
            dispatcher: Any = njit(cache=True, **whole)(function)
        except RuntimeError as error:  # no folder for it can be written
            _say_uncached(str(error))
            dispatcher = njit(**whole)(function)
        if LINKED and isinstance(dispatcher, CPUDispatcher):  # and not the function, where nothing is compiled
            dispatcher.__class__ = Kernel
            others = {name: value for name, value in options.items() if name != "nogil"}
            dispatcher.within = njit(**WITHIN, **others)(function)  # type: ignore[attr-defined]
        # Numba offers no way to say so: where its insides differ (or nothing is compiled) its own rules stay
        found: Any = getattr(dispatcher, "_cache", None)
        # Numba's own cache watches one file, and would run on with an old helper of another,
        # and with damaged code. Here kept code belongs to all `sources`.
        if hasattr(found, "_guard_against_spurious_io_errors") and hasattr(found._cache_file, "_source_stamp"):
            found._cache_file = code = MachineCode(found._cache_file, function.__code__.co_filename)
            found._guard_against_spurious_io_errors = _cache_is_optional
            dispatcher.compile = code.by_one_process(dispatcher.compile)
        return Shared(dispatcher, least) if options.get("parallel") else dispatcher

    return compiled


class Kernel(CPUDispatcher):
    """A dispatcher of Numba for calls from Python; compiled code calls `within` instead, as a part of itself."""

    within: Any = None  # of a copy in another process

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.within or self)


class Whole(Compiler):
    """Numba's compiler for a function that Python calls: optimised once, with all that it calls."""

    def compile_extra(self, func: Any) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = codegen.create_library(func.__qualname__)
        self.state.library.enable_object_caching()
        before, codegen._library_class = codegen._library_class, Linked  # one thread at a time compiles
        often = gc.get_threshold()
        gc.set_threshold(SELDOM if often[0] else 0)  # looks for garbage among all that Numba makes take .08 of the time
        try:
            found = super().compile_extra(func)
        finally:
            codegen._library_class = before
            gc.set_threshold(*often)
        for environment in found._find_referenced_environments():  # as Numba does when it reads it from the disk
            codegen.set_env(environment.env_name, environment)
        return found


class Linked(JITCodeLibrary):
    """Numba's library of a function that is called by what is being compiled: no machine code is made of it by itself.

    Unless Python can call it, too (`whole`). LLVM's passes over one function at a time stay: without them loops that
    are linked are not vectorised, and a union takes half as long again.
    """

    whole = False

    def _optimize_final_module(self) -> None:
        if self.whole:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        """Finish the library if it is the `whole` one; for a part, do only what linking it needs."""
        if self.whole:
            super()._finalize_final_module()
        else:
            self._finalize_dynamic_globals()
            self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """The address of a function in machine code; 0 for a part, which has none.

        The first call sets `whole`: whether a wrapper for Python is defined here.
        """
        if not self._finalized:
            defined = (function.name for function in self._final_module.functions if not function.is_declaration)
            self.whole = name in defined and not self.name.startswith(LOOP)
        return super().get_pointer_to_function(name) if self.whole else 0

    @property
    def codegen(self) -> Any:
        """Numba's code generator for a `whole` library; for a part this object itself, whose `set_env` does nothing."""
        return self._codegen if self.whole else self

    def set_env(self, name: str, environment: Any) -> None:
        """A part has no machine code whose environment could be set; `Whole` sets it."""


class MachineCode:
    """Compiled versions of a function on disk, a file for each: a digest, and then the key and the code.

    In place of Numba's cache, of which damaged code ends the process, and a damaged index every later one.
    """

    def __init__(self, files: Any, source: str) -> None:
        self.start = os.path.join(files._cache_path, files._index_name.removesuffix(".nbi"))
        inside = Path(__file__).parent in Path(source).parents
        # of a file elsewhere Numba's stamp, too: the time at which it was changed last
        self.stamp = repr((numba.__version__, sources(), None if inside else files._source_stamp)).encode()
        self.flush, self.dump = files.flush, files._dump

    def _path(self, key: Any) -> Path:
        """The file of the code for a key, named by a digest of it and the stamp."""
        return Path(f"{self.start}.{blake2b(self.stamp + repr(key).encode(), digest_size=16).hexdigest()}.code")

    def load(self, key: Any) -> Any:
        """The code kept under a key, whose file now counts as used; None where it is damaged."""
        path = self._path(key)
        try:
            whole = path.read_bytes()
        except FileNotFoundError:
            return None
        if whole[:64] != blake2b(self.stamp + whole[64:]).digest():
            return None
        with suppress(OSError):
            os.utime(path)  # so that it is not old
        kept, data = pickle.loads(whole[64:])
        return data if kept == key else None

    def save(self, key: Any, data: Any) -> None:
        """Keep the code under a key, in a file that appears whole or not at all."""
        path, code = self._path(key), self.dump((key, data))
        temporary = path.with_suffix(f".{uuid.uuid4().hex}.code")
        try:
            temporary.write_bytes(blake2b(self.stamp + code).digest() + code)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
        _clear(path.parent)

    def by_one_process(self, compile_it: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """A dispatcher's method, made to run in one process at a time for each signature.

        Locks are taken in the order in which functions call one another, so no two processes wait for each other, and
        the system frees those of a process that has ended.
        """

        def compiled(signature: Any) -> Any:
            path = self._path(signature).with_suffix(".lock")
            with global_compiler_lock, _locked(path):  # Numba's keeps other threads out
                return compile_it(signature)

        return compiled


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """A context that one process at a time may be in, for each path, where files can be locked."""
    lock = None
    with suppress(OSError):
        if fcntl is not None:
            lock = open(path, "w")
            fcntl.flock(lock, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if lock is not None:
            with suppress(OSError), lock:
                # one who waits for the removed file and one who makes it anew may both compile then, which costs time
                # alone
                path.unlink()


@contextmanager
def _cache_is_optional() -> Iterator[None]:
    """A context in which any error of the cache on disk is said once: Numba then compiles the kernel."""
    try:
        yield
    except Exception as error:
        _say_uncached(str(error))


@cache
def _say_uncached(why: str) -> None:
    """Warn that compiled code is not kept on disk, and `why`, the first time in a process."""
    if _say_uncached.cache_info().currsize == 0:  # once, whatever else is in the way
        warnings.warn(
            f"compiled code is not kept for the next process: {why}; set NUMBA_CACHE_DIR to a folder that can be "
            "written and has room",
            RuntimeWarning,
            stacklevel=3,
        )


class Shared:
    """A compiled function whose loops are shared out over threads; one such function runs at a time, others wait.

    On the simplest of Numba's threading layers two at once would end the process. A process forked off one whose OpenMP
    threads have started would end, or wait for ever; here it gets a RuntimeError.
    """

    running = threading.RLock()
    lost = False  # whether this process was forked off one whose threads cannot be used here
    looked, free = -GLANCE, (1, 1)  # when `free_cores` has looked last, and what it has found then and before

    def __init__(self, dispatcher: Any, least: int = 0) -> None:
        self.dispatcher, self.least = dispatcher, least

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # which copies ask of one that is still empty
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    def __call__(self, *arguments: Any) -> Any:
        """Call the function on as many threads as cores are free, on one if its arrays are small."""
        if Shared.lost:
            raise RuntimeError(
                "this process was forked off one in which sdhj had started threads, which OpenMP does not survive; "
                "start processes with multiprocessing.get_context('spawn'), or set NUMBA_THREADING_LAYER=workqueue"
            )
        with Shared.running:
            threads = get_num_threads()
            # arrays within a tuple, as velocities are, do not count
            large = threads > 1 and max([getattr(one, "size", 0) for one in arguments]) >= self.least
            some = min(threads, free_cores()) if large else 1
            if some == threads:
                return self.dispatcher(*arguments)
            set_num_threads(some)
            try:
                return self.dispatcher(*arguments)
            finally:
                set_num_threads(threads)


def free_cores() -> int:
    """How many cores no other program keeps busy, at least one; all cores where that cannot be seen.

    A thread that has to share its core is slow: beside a busy program a solve by two threads on two cores took 1.4 to
    1.7 times as long as by one.
    """
    cores = os.cpu_count() or 1
    now = time.monotonic()
    if now - Shared.looked >= GLANCE:
        free = cores
        with suppress(OSError, ValueError, IndexError, AttributeError):
            # Linux tells how many processes run, but not on which cores
            if len(os.sched_getaffinity(0)) == cores:
                busy = int((PROC / "loadavg").read_text().split()[3].split("/")[0])
                states = [one.read_text().rpartition(")")[2].split()[0] for one in PROC.glob("self/task/*/stat")]
                free = max(1, cores - max(0, busy - states.count("R")))
        # a core counts as busy only at two looks in a row
        Shared.looked, Shared.free = now, (free, Shared.free[0])
    return max(Shared.free)


def _forked() -> None:
    """In the child of a fork, make a new lock, and note in `Shared.lost` whether threads cannot be used there."""
    Shared.running = threading.RLock()
    with suppress(ValueError):  # no threads were started
        lost = threading_layer() == "omp" and sys.modules["numba.np.ufunc.omppool"].openmp_vendor == "GNU"
        Shared.lost = Shared.lost or lost


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function into each kernel that calls it.

    The function may call itself with the rest of a tuple: `if len(rest) == 0` is then decided, and the calls are
    unrolled, when compiling. (Such a test must be of an argument itself: what is not decided must fit all types.)
    """
    overload(function, strict=False, jit_options=INLINED)(lambda *types: function)
    return function


def chosen(table: Mapping[Any, Callable[..., Any]]) -> Callable[..., Any]:
    """A function for kernels that calls one of the `inlined` functions of a table, decided when the kernel is compiled.

    Its first argument is `choice(table, name)`, a tuple whose length says which. The table is read once.
    """
    functions = tuple(table.values())

    def call(place: tuple[int, ...], *arguments: Any) -> Any:
        return functions[len(place)](*arguments)

    def compiled(place: Any, *types_of_others: Any) -> Callable[..., Any]:
        function = functions[len(place)]
        return lambda place, *arguments: function(*arguments)

    overload(call, strict=False, jit_options=INLINED)(compiled)
    return call


def choice(table: Mapping[Any, Any], name: Any) -> tuple[int, ...]:
    """The first argument of a `chosen` function for an entry of its table: a zero for each earlier entry."""
    return (0,) * list(table).index(name)


@cache
def sources() -> str:
    """A digest of all source files of this folder: an edit of one, also of a comment, compiles all kernels anew."""
    folder = Path(__file__).parent
    digest = blake2b(digest_size=16)
    for file in sorted(folder.rglob("*.py")):
        text = file.read_bytes()
        digest.update(f"{file.relative_to(folder).as_posix()} {len(text)} ".encode() + text)
    return digest.hexdigest()


@cache
def _clear(folder: Path) -> None:
    """Remove the kernels in a folder that nobody has used for `KEPT_DAYS`, once in a process."""
    for path in folder.glob("*.code"):
        with suppress(OSError):  # another process may be at it
            if time.time() - path.stat().st_mtime > KEPT_DAYS * 86400:
                path.unlink()
