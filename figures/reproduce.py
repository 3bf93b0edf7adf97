"""The main job: the paper's case study solved, its controller exercised, every figure drawn, the results in a table."""

import csv
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import click
import numba
import numpy as np
from common import HERE, Context, of_main_job, write_all

import sdhj
from sdhj.cli import INTERPOLATED, RUNS, SEED, compile_kernels, plainly
from sdhj.plotting.looks import writable_folder
from sdhj.table.batches import Table
from sdhj.table.files import replaced_whole

ADVERSARIES = ("random", "aggressive", "worst")
BESIDE = "fig14_timing"  # half of what all figures take; it counts the processor time of one thread


@click.command(context_settings={"show_default": True})
@click.option("--nodes", default=25, help="Nodes on each axis.")
@click.option("--out", default="results", type=click.Path(path_type=Path), help="Folder for figures and tables.")
@click.option("--runs", default=10_000, type=RUNS, help="Closed-loop runs for each method and adversary.")
@click.option("--seed", default=0, type=SEED, help="Seed of everything random.")
@click.option("--certified", is_flag=True, help="A certified table too: minutes more, and 6 GB of memory.")
@plainly
def main(nodes: int, out: Path, runs: int, seed: int, certified: bool) -> None:
    """Solve the case study, exercise its controller, write every figure and a table of results."""
    writable_folder(out)
    began = time.perf_counter()
    problem = sdhj.arm_case_study(nodes=nodes)
    tables: dict[str, Table] = {}
    for method in INTERPOLATED:
        click.echo(f"compiling for {method}: {compile_kernels('arm', method):.1f} s")
    for method in (*INTERPOLATED, *(["certified"] if certified else [])):
        click.echo(f"solving the case study: {method}, {nodes}^4 nodes")
        tables[method] = sdhj.solve(problem, method=method)
    command = [sys.executable, HERE / f"{BESIDE}.py", "--nodes", str(nodes), "--out", out]
    # in a session of its own, so that Ctrl-C reaches this process alone, which ends the other
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as beside:
        try:
            rows = []
            for method, table in tables.items():
                click.echo(f"playing {runs} runs against each adversary: {method}")
                rows.append(summary(table, runs, seed))
            write_table(rows, out, f"{nodes} nodes on each axis, {runs} runs for each adversary, seed {seed}")
            click.echo("drawing the figures")
            tables.pop("certified", None)  # the figures show interpolated tubes
            context = Context(tables=tables, seed=seed, say=click.echo)
            write_all(context, out, [name for name in of_main_job() if name != BESIDE])
            click.echo(f"drawing {BESIDE}\n{beside.communicate()[0]}", nl=False)
        finally:
            beside.kill()  # if it still runs
    if beside.returncode:
        raise click.ClickException(f"{BESIDE}.py ended with status {beside.returncode}")
    click.echo(f"{out}: done in {time.perf_counter() - began:.0f} s")


def summary(table: Table, runs: int, seed: int) -> dict[str, str]:
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
        f"peak memory of solves and runs {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB.",
        "",
    ]
    with replaced_whole(out / "results.md") as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")
    click.echo("\n".join(lines))


if __name__ == "__main__":
    main()
