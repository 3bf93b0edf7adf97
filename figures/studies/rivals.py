"""How long two standard examples of discretised control take to certify on one thread, beside published times.

`python figures/studies/rivals.py` certifies the vehicle in a maze (`costs.py`) and the voltage converter
(`extra_dcdc.py`), both until nothing changes, in seconds of CPU time, compiling apart. SCOTS's shares are those of its
examples `vehicle` and `dcdc`; the times are those that Dionysos.jl publishes for its own abstractions of the two, on
its own host: the same problems, by other methods on other machines.

`ON_H100` is a stored result of hj_reachability: few have such a card.
"""

import os
import sys
import time
from pathlib import Path

import numba

import sdhj

sys.path.append(str(Path(__file__).parents[1]))  # the scripts are no package to install

import extra_dcdc
from costs import MAZE_CELLS, SCOTS_SHARE, maze

# By nodes on each axis, s: the arm's 900 PDEs by hj_reachability on one H100, all 25 inputs abreast and one by one, and
# the whole game (avoid tubes, PDEs, union and marks) by sdhj on 2 and on 16 cores of the same machine, in one run.
# Of the commit 31532c8 of sdhj, so from before 26 November 2026; neither the day nor the versions were written down.
# The extra `bench` asked for hj-reachability 0.7 and jax 0.10, or later.
ON_H100 = {25: (0.64, 1.07, 0.75, 0.25), 40: (5.4, 6.0, 4.7, 1.3)}


def on_h100() -> str:
    """The stored result as a table."""
    lines = ["| nodes | 900 PDEs on an H100, abreast | one by one | whole game, 2 cores | 16 cores |"]
    lines += ["| --- | --- | --- | --- | --- |"]
    return "\n".join(
        [*lines, *(f"| {n} | " + " | ".join(f"{s:g} s" for s in row) + " |" for n, row in ON_H100.items())]
    )


def main() -> None:
    """Print a row for each, and the stored result."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    numba.set_num_threads(1)
    print("| | cells | proved | time | SCOTS's share | Dionysos.jl |\n| --- | --- | --- | --- | --- | --- |")
    vehicle, converter = maze(), extra_dcdc.dcdc()
    for name, problem, cells, parts, scots, published in (
        ("maze", vehicle, MAZE_CELLS, 10, SCOTS_SHARE, 15.0),
        ("converter", converter, (800, 800), 10, extra_dcdc.SCOTS, 4.8),
        ("converter, in 3 parts", converter, (800, 800), 3, extra_dcdc.SCOTS, 4.8),
    ):
        for _ in range(2):  # the first time compiles, or reads what was compiled
            began = time.process_time()
            table = sdhj.solve(problem, sdhj.Certified(cells=cells, parts=parts), progress=False)
            seconds = time.process_time() - began
        share = table.fraction(start=0, within=table.steps)
        at = " x ".join(map(str, table.shape))
        print(f"| {name} | {at} | {share:.1%} | {seconds:.1f} s | {scots:.1%} | {published} s |", flush=True)
    print(f"\n{on_h100()}")


if __name__ == "__main__":
    main()
