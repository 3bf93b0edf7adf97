"""How long two standard examples of discretised control take to certify on one thread, beside published times.

`python figures/rivals.py` certifies the vehicle in a maze (`maze.py`) and the voltage converter (`extra_dcdc.py`), both
until nothing changes, in seconds of CPU time, compiling apart. SCOTS's shares are those of its examples `vehicle` and
`dcdc`; the times are those that Dionysos.jl publishes for its own abstractions of the two, on its own host: the same
problems, by other methods on other machines. `ON_H200` is a stored result of `gpu.py`.
"""

import os
import time

import extra_dcdc
import maze
import numba

import sdhj

# What `gpu.py` measured on 27 November 2026 on one H200 (driver 580.159.04) and on cores of the same machine (Xeon),
# with Python 3.12.3, numba 0.68.0, numba-cuda 0.30.4 and numpy 2.4.6, fused operations off: by nodes on each axis, ms.
# The game on the card is avoid tubes, PDEs, unions and marks; besides it, samples of the sets on one core, copies there
# and back. `sdhj.solve(play=False)` on 1, 2 and 16 cores: the least and the greatest median of three solves.
ON_H200 = {
    25: {"game": 23, "besides": (70, 4, 28), "solve": ((804, 1078), (724, 859), (313, 467))},
    40: {"game": 71, "besides": (304, 14, 141), "solve": ((6642, 8932), (4166, 5691), (1613, 2020))},
}


def main() -> None:
    """Print a row for each."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    numba.set_num_threads(1)
    vehicle, converter = maze.maze(), extra_dcdc.dcdc()
    for name, problem, cells, parts, scots, published in (
        ("maze", vehicle, maze.CELLS, 10, maze.SCOTS_SHARE, 15.0),
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


if __name__ == "__main__":
    main()
