"""First use: compile every kernel once, so that what follows is fast (`sdhj warmup`)."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import sdhj

METHODS = ("hji", "projected", "lax")
CELLS = (63, 63, 18, 18)  # of the certified method: enough that the tubes grow


def compile_kernels(methods: Sequence[str] = METHODS, say: Callable[[str], Any] = lambda line: None) -> None:
    """Call every kernel that the methods and the controller need once, on a small problem."""
    for method in methods:
        began = time.perf_counter()
        say(f"warming up {method}")
        cells = CELLS if method == "certified" else None
        table = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=2), method=method, cells=cells, progress=False)
        sdhj.monte_carlo(sdhj.Controller(table), runs=10, adversary="worst", seed=0, progress=False)
        if method == "certified":
            _compile_checker(table)
        say(f"  {time.perf_counter() - began:.1f} s")


def _compile_checker(table: sdhj.LookupTable) -> None:
    from sdhj.certified.check.verify import verify

    with TemporaryDirectory() as folder:
        path = Path(folder) / "certified.h5"
        table.save(path)
        verify(path, samples=10, progress=False)
