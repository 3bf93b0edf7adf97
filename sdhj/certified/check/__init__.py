"""An independent check of certified sets: it reads a file and derives its claims anew.

Nothing of the solver is used, neither its code nor its bounds: only the numbers in the file, NumPy and Python's
standard library. To be read in this order:

1.  `argument`: why the sets hold, for any robot, in one file. Its first lines say where each obligation stands: ten of
    the eleven that `sdhj.certified.sets` lists, as the last, that a controller finds what is proved, is no claim of a
    file.
2.  `stated`: the problem that the file states, entry by entry; what is not known is refused. It is printed before the
    verdict, as it was read.
3.  `formulas` and `intervals`: functions as text, and bounds of them over boxes, rounded outward.
4.  `reading` and `files`: numbers, arrays and bytes, of which no one counts before its digest is right. The digest of
    the problem is computed from what is read of it. A forger may write that of another problem as well: only who has
    the problem finds this, by `sdhj verify --problem` or `sdhj.load(path, problem=...)`, which compare it with the
    file's.
5.  `words`: what C reads of an exported file is within what is proved.
6.  `sampled`: the look at its own claims with which a solve ends, at a sample where they are many. It proves nothing of
    the rest.

The answer is "proved" or "not proved": what holds may, in principle, need a finer look than is taken.

The case studies' arm has a geometry of its own, and a checker of its own for it, `arm`, which is compiled; it is loaded
for the file of an arm alone.

From the command line: `python -m sdhj.certified.check table.npz`, or `sdhj verify table.npz`, with `--problem
module:function` where the robot has black boxes.
"""

import os
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from sdhj.certified.check.argument import Argument, silently
from sdhj.certified.check.claims import Claim, Verdict
from sdhj.certified.check.reading import expect, expect_room, head_and_arrays, is_whole
from sdhj.certified.check.sampled import looked_over
from sdhj.certified.check.words import Words, claims

__all__ = ["Claim", "Verdict", "looked_over", "verify"]


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
        Of `table.save`.
    problem : ReachAvoidProblem, optional
        For black boxes, whose functions are not in the file. All else is not compared with it: `sdhj.load(path,
        problem=...)` does that.
    everywhere : bool
        Whether moves and clear inputs are proved of all cells, too; by default of those that are promised. The others
        serve who has lost his promise (`fallback`, `hazards`, `filter`). Of an arm all are.
    samples : int or None
        How many cells, of an arm rows, are drawn at random; None checks all.
    seed : int
        Of what is drawn.
    progress : bool, optional
        By default where standard error is a terminal.
    exported : path, optional
        The folder of an export of these sets, or its `sdhj_table.bin`: every word of it has to be within what is proved
        (`words`).

    Returns
    -------
    Verdict
        All claims, with what was not proved, and the problem as it was read.

    Raises
    ------
    ValueError
        Where the file holds no certified sets, is damaged, has numbers that are too large for the check, or needs a
        problem that is not given.
    OSError
        Where the file cannot be read.
    MemoryError
        Where more memory is needed than is free.
    """
    expect(samples is None or is_whole(samples, 1), "samples must be a positive number", samples)
    expect(is_whole(seed, 0), "seed must be a whole number of at least 0", seed)
    words = None if exported is None else Words(exported)
    silent = sys.stderr is None or not (sys.stderr.isatty() if progress is None else progress)
    sets: Any = None
    opaque: dict[str, str] = {}
    with head_and_arrays(path) as (head, arrays):
        if "cells" in head and head["cells"].get("kind") == "arm":
            from sdhj.certified.check.arm.claims import Arm  # with Numba, which no other robot needs

            expect_room(Arm.bytes_needed(arrays))
            sets = Arm(head, arrays)
        elif "cells" in head and not ((opaque := dict(head["formulas"]["opaque"])) and problem is None):
            sets = Argument(head, arrays, problem)
            expect_room(sets.bytes_needed())
    # Out of the `with`, within which an error would be told as one of the file.
    if opaque and problem is None:
        names = ", ".join(f"{name} ({why})" for name, why in opaque.items())
        raise ValueError(
            f"{path} rests on black boxes, whose functions are not in the file: {names}; give the problem, for example "
            "as `sdhj verify --problem module:function`"
        )
    if sets is None:
        raise ValueError(f"{path} holds no certified sets; make them with method='certified'")
    if isinstance(sets, Argument):
        bar = silently if silent else shown
        found = [*sets.claims(everywhere, samples, seed, bar)]
        found += [] if words is None else claims(words, sets, everywhere, bar)
        return Verdict(tuple(found), str(sets.problem))
    found = [*sets.claims(np.random.default_rng(seed).permutation(sets.index.shape[1])[:samples], silent)]
    if words is not None:
        from sdhj.certified.check.arm.exported import claims as claims_of_an_arm

        found += claims_of_an_arm(words, sets, silent)
    return Verdict(tuple(found))


def shown(through: Iterable[Any], what: str, total: int) -> Iterator[Any]:
    """A `Bar` that tells on standard error how far it is."""
    told = 0.0
    for number, one in enumerate(through, 1):
        # Ten times a second at most, and once all are done, which ends the line.
        if number == total or time.monotonic() - told > 0.1:
            told = time.monotonic()
            print(f"\r{what}: {number:,} of {total:,}", end="\n" * (number == total), file=sys.stderr, flush=True)
        yield one
