"""What the first answer compiles: CPU seconds of a process that finds nothing on disk, step by step, kernel by kernel.

    python figures/studies/first.py car

Each step is made in turn: the problem, its solution, the runs that `solve` plays, the first `select`. A kernel's own
seconds are without those of the kernels that it calls, which are compiled with it.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import click
import numpy as np
from numba.core.event import Listener, install_listener

import sdhj
from sdhj.cli import plainly

sys.path.append(str(Path(__file__).parents[1]))  # the scripts are no package to install

import extra_sensing

CLOCK = time.process_time
LINES = 30  # kernels that are listed
PROBLEMS: dict[str, Callable[[], Any]] = {
    "arm": sdhj.arm_case_study,
    "car": extra_sensing.car,
    "car, certified": extra_sensing.car,
}
CELLS = (24, 24, 16)


class _Clock(Listener):
    """By kernel: its own CPU seconds, and how often it was compiled, by itself and within another one."""

    def __init__(self) -> None:
        self.open: list[float] = []
        self.found: dict[str, list[float]] = {}

    def on_start(self, event: Any) -> None:
        self.open.append(0.0)
        event.data["began"] = CLOCK()

    def on_end(self, event: Any) -> None:
        spent, inside, kernel = CLOCK() - event.data["began"], self.open.pop(), event.data["dispatcher"].py_func
        name = f"{kernel.__module__.removeprefix('sdhj.kernels.')}.{kernel.__qualname__}"
        row = self.found.setdefault(name, [0.0, 0, 0])
        row[0], row[1 + bool(self.open)] = row[0] + spent - inside, row[1 + bool(self.open)] + 1
        if self.open:
            self.open[-1] += spent


def measured(name: str) -> dict[str, Any]:
    """In this process: CPU seconds of each step, and of each kernel what `_Clock` counts."""
    steps, clock, began = dict[str, float](), _Clock(), CLOCK()

    def done(step: str) -> None:
        nonlocal began
        steps[step], began = CLOCK() - began, CLOCK()

    with install_listener("numba:compile", clock):
        problem = PROBLEMS[name]()
        done("problem")
        method = sdhj.Certified(cells=CELLS) if "certified" in name else "hji"
        solved = sdhj.solve(problem, method, progress=False, play=False)
        done("solve")
        solved.played(200)
        done("runs")
        with suppress(sdhj.NotAdmissible):
            sdhj.Controller(solved).select(np.array(problem.grid.lower), 0)
        done("select")
    return {"steps": steps, "kernels": clock.found}


def in_a_new_process(name: str) -> dict[str, Any]:
    """`measured` where nothing is on disk, on one thread."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder, "NUMBA_NUM_THREADS": "1"}
        command = [sys.executable, __file__, name, "--here"]
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def table(name: str, found: dict[str, Any]) -> str:
    """What was measured, as lines of text."""
    steps, kernels = found["steps"], found["kernels"]
    lines = [f"{name}: {sum(steps.values()):.1f} s, {', '.join(f'{step} {s:.1f}' for step, s in steps.items())}"]
    lines.append(f"{'kernel':<48}{'own CPU s':>10}{'by itself':>11}{'within':>8}")
    for kernel, (seconds, whole, within) in sorted(kernels.items(), key=lambda one: -one[1][0])[:LINES]:
        lines.append(f"{kernel:<48}{seconds:>10.2f}{whole:>11}{within:>8}")
    whole, within = (sum(row[i] for row in kernels.values()) for i in (1, 2))
    return "\n".join([*lines, f"{'all':<48}{sum(row[0] for row in kernels.values()):>10.2f}{whole:>11}{within:>8}"])


@click.command()
@click.argument("name", default="car", type=click.Choice(list(PROBLEMS)))
@click.option("--here", is_flag=True, hidden=True, help="In this process, and printed as JSON.")
@plainly
def main(name: str, here: bool) -> None:
    """Measure what the first answer compiles, from an empty cache."""
    click.echo(json.dumps(measured(name)) if here else table(name, in_a_new_process(name)))


if __name__ == "__main__":
    main()
