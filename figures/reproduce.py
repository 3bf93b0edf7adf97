"""The main job: the paper's case study solved, its controller exercised, every figure drawn, the results in a table."""

import csv
import platform
import resource
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np

import sdhj
from sdhj.checks import whole
from sdhj.files import replaced_whole
from sdhj.table import LookupTable
from sdhj.warmup import METHODS, compile_kernels

ADVERSARIES = ("random", "aggressive", "worst")


def reproduce(
    *, nodes: int, out: Path, runs: int, seed: int, certified: bool = False, say: Callable[[str], Any]
) -> None:
    """Write figures, results.csv and results.md into the folder `out`; `say` receives progress lines.

    With certified=True the table of results gets a row for method "certified" too, which takes minutes.

    Raises
    ------
    ValueError
        For numbers that no case study can be made of.
    OSError
        Where `out` cannot be written.
    """
    from catalogue import draw_all

    runs, seed = whole("runs", runs, least=1), whole("seed", seed, least=0)
    began = time.perf_counter()
    problem = sdhj.arm_case_study(nodes=nodes)
    tables: dict[str, LookupTable] = {}
    compile_kernels(METHODS, say)
    for method in (*METHODS, *(["certified"] if certified else [])):
        say(f"solving the case study: {method}, {nodes}^4 nodes")
        tables[method] = sdhj.solve(problem, method=method)
    rows = []
    for method, table in tables.items():
        say(f"playing {runs} runs against each adversary: {method}")
        rows.append(summary(table, runs, seed))
    write_table(rows, out, f"{nodes} nodes on each axis, {runs} runs for each adversary, seed {seed}")
    say("drawing the figures")
    tables.pop("certified", None)  # the figures show interpolated tubes
    draw_all(tables, out, seed=seed, say=say)
    say(f"{out}: done in {time.perf_counter() - began:.0f} s")


def summary(table: LookupTable, runs: int, seed: int) -> dict[str, str]:
    """One row of the results table: volume, cost, and failures in the closed loop by adversary."""
    row = {
        "method": table.method,
        "share of C within 0 steps": f"{table.fraction(start=0, within=0):.4f}",
        f"share of C within {table.steps} steps": f"{table.fraction(start=0, within=table.steps):.4f}",
        "solved in, s": f"{table.details['seconds']:.2f}",
        "table, MB": f"{table.nbytes / 1e6:.0f}",
    }
    controller = sdhj.Controller(table)
    for adversary in ADVERSARIES:
        report = sdhj.monte_carlo(controller, runs=runs, adversary=adversary, seed=seed)
        failures = runs - report.counts["reached"]
        row[f"failures, {adversary}"] = f"{failures / runs:.2%}"
    return row


def write_table(rows: Sequence[dict[str, str]], out: Path, note: str) -> None:
    """results.csv and results.md with the same rows; the Markdown names the machine and the versions."""
    columns = list(rows[0])
    with replaced_whole(out / "results.csv") as temporary, open(temporary, "w", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    lines = [
        "| " + " | ".join(columns) + " |",
        "|" + " --- |" * len(columns),
        *("| " + " | ".join(row[column] for column in columns) + " |" for row in rows),
        "",
        f"{note}. sdhj {sdhj.__version__}, NumPy {np.__version__}, Numba {numba.__version__} with "
        f"{numba.get_num_threads()} threads, Python {platform.python_version()}, {platform.machine()}; "
        f"peak memory of the whole job {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB.",
        "",
    ]
    with replaced_whole(out / "results.md") as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")
