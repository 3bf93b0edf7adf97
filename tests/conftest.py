"""What holds for every test: floating-point errors raise, figures are closed, random numbers are seeded."""

import gc
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import hypothesis
import matplotlib
import numba
import numpy as np
import pytest

import sdhj.solving
from sdhj.kernels import compiling
from sdhj.kernels.compiling import Kernel

matplotlib.use("Agg")  # draws without a screen

# Reading a notebook imports jsonschema, which where it can parses a grammar of internet addresses first, for seconds.
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]

# Two workers with two threads each, on two cores, would mostly wait for one another, and OpenMP waits at full speed.
# Tests of threads ask for two themselves, and the programs that tests start have all.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    numba.set_num_threads(1)

# The same examples in every run; no time limit for one example, because the first one compiles the kernels.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")

# Compiling makes objects by the million; by default Python looks for garbage after every 700.
gc.set_threshold(100_000)


# As many threads as a test asks for, however busy the machine is.
free_cores, compiling.free_cores = compiling.free_cores, lambda: os.cpu_count() or 1

check_by_runs, sdhj.solving.check_by_runs = sdhj.solving.check_by_runs, lambda table: {}
scanty_finding, sdhj.solving.scanty_finding = sdhj.solving.scanty_finding, lambda table: None


called_while_collecting: list[str] = []


def pytest_collection_finish() -> None:
    """No kernel should be called until here; what was made stays, so no time is spent on looking for garbage in it."""
    gc.collect()
    kernels = [one for one in gc.get_objects() if isinstance(one, Kernel)]
    called_while_collecting.extend(sorted(one.py_func.__qualname__ for one in kernels if one.signatures))
    gc.freeze()


@pytest.fixture
def kernels_called_while_collecting() -> list[str]:
    """What a file of tests calls where it is imported, as making a problem does: all workers wait while it compiles."""
    return called_while_collecting


@pytest.fixture
def cores_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """`free_cores` as users have it."""
    monkeypatch.setattr(compiling, free_cores.__name__, free_cores)
    return free_cores


@pytest.fixture
def solves_are_played(monkeypatch: pytest.MonkeyPatch) -> None:
    """What `solve` does at its end, as users have it: tests that are about something else save its time."""
    monkeypatch.setattr(sdhj.solving, check_by_runs.__name__, check_by_runs)
    monkeypatch.setattr(sdhj.solving, scanty_finding.__name__, scanty_finding)


@pytest.fixture(autouse=True)
def floating_point_errors_raise() -> Iterator[None]:
    """Overflow, division by zero and invalid operations in NumPy raise; underflow to zero is harmless.

    Where a test means to compute with infinities, it says so with its own `np.errstate`.
    """
    with np.errstate(all="raise", under="ignore"):
        yield


@pytest.fixture(autouse=True)
def figures_are_closed() -> Iterator[None]:
    """Close whatever a test drew."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


@pytest.fixture
def files_of_at_most() -> Callable[[int], AbstractContextManager[None]]:
    """Within `files_of_at_most(n)` no file grows beyond n bytes, as on a full disk."""

    @contextmanager
    def limited(count: int) -> Iterator[None]:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (count, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limited


@pytest.fixture
def signals_are_heard() -> Iterator[None]:
    """Ctrl-C and SIGTERM do here, and in the programs that the test starts, what they do at a terminal.

    Shells have what runs in the background ignore Ctrl-C, and a program hands on to its children what it ignores.
    """
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers, the same for every test."""
    return np.random.default_rng(20200101)
