"""An independent check of certified sets: reads a file and derives its claims anew.

Nothing of the solver is used, neither its code nor its bounds: only the numbers in the file. What is proved, and how:

1.  *The cells cover the axes*, in fractions; the period of an angle is an interval that holds 2 pi. (`uncovered`)
2.  *Sets grow*: S_k^{n-1} is a part of S_k^n, so that `within` means what it says. (`cells_added`)
3.  *Reach*: under some input everything that a new cell of S_k^n can lead to lies in cells of S_{k+1}^{n-1}. The cells
    of an axis that the image of a cell may overlap are worked out in fractions, walls included (`overlapped`), and the
    whole product of the four lists has to be in the set. Along the agent's axes that product stays in one block of the
    file's pool, so each block is eroded once (`erode`); along the joints' axes eroded blocks are intersected
    (`reaching`).
4.  *Clearance*: under the same input the arm meets neither the pursuer nor a known obstacle at any time of the closed
    interval. A link and a disk, or a cell of the pursuer grown by what it can move, are further apart than r if along
    some unit vector n every point of the body is more than r ahead of every point of the link. How far a link extends
    along n is bounded for all joint angles of a box at once (`farthest`). For all of the pursuer's cells in a row some
    directions are tried in every part of the interval, and each proves a half plane of cells (`sweep`). The cells that
    this leaves are asked about one by one, each with a direction of its own; where one direction does not do, time,
    angles and cell are halved (`link_clear`).
5.  *Goals*: the cells of S_k^0 are inside the target at t_k (`tip_inside`), and clear of everything at that instant.
6.  *Rounding* is bounded once for all numbers that are let in (`separation`), and a state counts as in a cell up to
    1e-10 from it (`moved`), in metres and radians; of other robots all that is allowed is a share of the coordinates.
7.  *The file* describes what its head names: the digest of the problem is computed from what is read of it, names of
    axes and sets included (`reading`), and an arm's recipe makes what the head describes (`recipe`). A forger may write
    the digest of another problem as well: only who has the problem finds that, by `sdhj verify --problem` or
    `sdhj.load(path, problem=...)`, which compare it with the file's.

Statements of `arm`, `formulas` and `intervals` marked `# check 4.2` are of 4, and a test fails where they are changed
(tests/changes.py).

The answer is "proved" or "not proved". A cell whose certificate is right may, in principle, need more halving than is
granted. This is the arm's (`arm`, with `bits`), which is compiled. For every other robot, whose functions are in the
file as text, the whole argument is in `argument`, in NumPy alone: begin there. It reads the problem by `stated`, its
functions by `formulas` and `intervals`, files by `files` and `reading`, and what was exported for C by `words`.

From the command line: `python -m sdhj.certified.check table.npz`, or `sdhj verify table.npz`, with `--problem
module:function` where the robot has black boxes.
"""

import os
import sys
from typing import Any

from tqdm import tqdm

from sdhj.certified.check.argument import Argument
from sdhj.certified.check.arm.claims import Arm
from sdhj.certified.check.arm.exported import claims as claims_of_an_arm
from sdhj.certified.check.claims import Claim, Verdict
from sdhj.certified.check.reading import expect, expect_room, head_and_arrays, is_whole
from sdhj.certified.check.words import Words, claims

__all__ = ["Claim", "Verdict", "verify"]


def verify(
    path: str | os.PathLike[str],
    problem: Any = None,
    *,
    everywhere: bool = False,
    samples: int | None = None,
    seed: int = 0,
    progress: bool | None = None,
    exported: str | os.PathLike[str] | None = None,
) -> Verdict:
    """Check the certified sets in a table's file, by code and numbers that share nothing with the solver.

    Parameters
    ----------
    path : path
        The file that `table.save` wrote.
    problem : ReachAvoidProblem, optional
        For a robot of one's own with black boxes, whose functions are not in the file: `problem.black_box(name)`. All
        else is in the file, and is not compared with the problem: `sdhj.load(path, problem=...)` does that first.
    everywhere : bool
        Whether moves and clear inputs are proved of all cells, too; by default of those that are promised, which some
        set has with a step to go. The others serve who has lost his promise (`fallback`, `hazards`, `filter`). Of an
        arm all are, always.
    samples : int or None
        How many rows are drawn at random, each checked with all its claims; None checks every row. For a robot of one's
        own: how many cells.
    seed : int
        Of what is drawn, at least 0.
    progress : bool, optional
        Whether to show progress bars; by default where standard error is a terminal.
    exported : path, optional
        The folder of an export of these sets, or the `sdhj_table.bin` in it: checks as well that every word of it is
        within what is proved of the sets (`words`).

    Returns
    -------
    Verdict
        All claims, with what was not proved of each; `ok` if nothing failed. And the problem as it was read.

    Raises
    ------
    ValueError
        Where the file holds no certified sets, is damaged, or has numbers that are too large for the check; where it
        needs a problem that is not given; and for samples or a seed that make no sense.
    OSError
        Where the file cannot be read.
    MemoryError
        Where more memory is needed than is free, before any is taken.
    """
    expect(samples is None or is_whole(samples, 1), "samples must be a positive number", samples)
    expect(is_whole(seed, 0), "seed must be a whole number of at least 0", seed)
    words = None if exported is None else Words(exported)
    sets: Arm | Argument | None = None
    opaque: dict[str, str] = {}
    with head_and_arrays(path) as (head, arrays):
        if "cells" in head and head["cells"].get("kind") == "arm":
            expect_room(Arm.bytes_needed(arrays))
            sets = Arm(head, arrays)
        elif "cells" in head and not ((opaque := dict(head["formulas"]["opaque"])) and problem is None):
            sets = Argument(head, arrays, problem)
            expect_room(sets.bytes_needed())
    if opaque and problem is None:
        names = ", ".join(f"{name} ({why})" for name, why in opaque.items())
        raise ValueError(
            f"{path} rests on black boxes, whose functions are not in the file: {names}; give the problem, for example "
            "as `sdhj verify --problem module:function`"
        )
    if sets is None:
        raise ValueError(f"{path} holds no certified sets; make them with method='certified'")
    silent = sys.stderr is None or not (sys.stderr.isatty() if progress is None else progress)
    if isinstance(sets, Arm):
        found = [*sets.claims(samples, seed, silent)]
        found += [] if words is None else claims_of_an_arm(words, sets, head, silent)
        return Verdict(tuple(found))

    def bar(through: Any, what: str, total: int) -> Any:
        return tqdm(through, what, total, disable=silent)

    found = [*sets.claims(everywhere, samples, seed, bar)]
    found += [] if words is None else claims(words, sets, everywhere, bar)
    return Verdict(tuple(found), str(sets.problem))
