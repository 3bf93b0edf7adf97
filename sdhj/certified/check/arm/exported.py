"""The words of an exported table of an arm: every word of every cell is within what the table's file proves.

As `words` asks it of any robot; here each input of each cell is proved clear of the pursuer one by one (`words_hold`):
it takes a few times as long as `verify`. Images are neither wider nor narrower than those that `overlapped` derives.
"""

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from tqdm import tqdm

from sdhj.certified.check.arm.bits import Array
from sdhj.certified.check.arm.claims import Arm, in_threads, overlapped
from sdhj.certified.check.arm.rows import words_hold
from sdhj.certified.check.arm.separation import STATE_ERROR
from sdhj.certified.check.claims import Claim
from sdhj.certified.check.words import Words, claims_of_inputs, claims_of_steps, differences, steps_to_go


def claims(words: Words, sets: Arm, silent: bool) -> Iterator[Claim]:
    """Yield all claims of an exported table, checked against the sets of the certified table.

    Only the first where a number of the exported table, of cells, inputs, steps or sensing, is another than the file's.
    """
    slack = np.full(len(words.counts), STATE_ERROR)
    wrong = differences(words, sets, slack, 1 if sets.still else words.steps + 1, int(sets.problem.memory))
    yield Claim("exported: the cells and inputs are the table's", 1, 1, wrong)
    if wrong:
        return
    counted: dict[str, list[Any]] = {name: [0, []] for name in words.fields}
    for name, made, failures in _check_arm(words, sets, silent):
        counted[name][0] += made
        counted[name][1] += failures
    for name, (made, failures) in counted.items():
        yield Claim(f"exported: {name}", made, made, failures)
    if words.leads:
        made = sum(own[..., 0].size for own in words.images)
        yield Claim("exported: images", made, made, list(images_differ(words, sets)))


def images_differ(words: Words, sets: Arm) -> Iterator[str]:
    """Yield a text for each step, input and axis whose exported images are not those that the table's file proves."""
    for axis, (own, reads) in enumerate(zip(words.images, words.reads, strict=True)):
        for start, j in np.ndindex(own.shape[:2]):
            if not _arm_images_agree(own[start, j].reshape(*np.where(reads, words.counts, 1), 2), sets, axis, j):
                yield f"start {start}, input {j}, axis {axis}"


def _arm_images_agree(said: Array, sets: Arm, axis: int, j: int) -> bool:
    """Whether the exported images of an arm along an axis under u_j are exactly the cells that `overlapped` derives.

    said (n, 2) : the first and the last cell of each image, less the cell's own index; False for another size.
    """
    n, drift = int(sets.counts[axis]), sets.scene.inputs()[j][axis] if axis < 2 else Fraction(0)
    push = sets.scene.push(axis)
    if said.size != 2 * n:  # it depends on this axis alone
        return False
    found = []
    for first, last in (np.arange(n)[:, None] + said.reshape(n, 2)).tolist():
        cells = range(first, min(last, first + n - 1) + 1)
        found.append(sorted({cell % n for cell in cells} if axis < 2 else {min(max(cell, 0), n - 1) for cell in cells}))
    return found == overlapped(axis, sets, drift - push, drift + push)


def _check_arm(words: Words, sets: Arm, silent: bool) -> Iterator[tuple[str, int, list[str]]]:
    """Check the words of an arm: yield a field's name, how many claims it makes, and texts of false ones.

    A field may be yielded several times.
    """
    world, (rows, count) = sets.scene.world(sets.edges), (sets.index.shape[1], len(words.inputs))
    every, kinds = (
        np.zeros((words.starts, rows, math.prod(sets.counts[2:].tolist())), np.uint32),
        ("select", "safe", "filter", "clear"),
    )
    # of the first two kinds, and of "filter"; `words_hold` knows the kinds by this order
    ahead = np.zeros((2, *every.shape), np.int16)
    marks = np.zeros((4, len(next(iter(words.fields.values()))), count), np.bool_)
    for start in range(words.starts):
        ids, left = np.concatenate([own for _, own in words.ids(start)]), words.steps - start
        fewest = steps_to_go(sets, start, left, False)
        for name, made, bad in claims_of_steps(words, ids, fewest, left, False):
            yield name, made, [f"start {start}, cell {cell}" for cell in bad]
        every[start] = ids.reshape(rows, -1)
        for name, some, steps in claims_of_inputs(words, ids, fewest, left, False):
            marks[kinds.index(name)] = some
            ahead[int(name == "filter"), start] = steps.reshape(rows, -1)
    if "clear" in words.fields:
        marks[3] = words.fields["clear"]
    counts, failed = np.zeros((2, rows, 4), np.int64)
    with tqdm(total=rows, desc="exported", unit="row", disable=silent) as bar:
        stored = sets.stored(numbers := np.arange(rows))
        for done in in_threads(
            rows, lambda at: words_hold(numbers[at], every, ahead, marks, world, stored, counts[at], failed[at])
        ):
            bar.update(done)
    for kind, name in enumerate(kinds):
        if name in words.fields:
            bad = np.flatnonzero(failed[:, kind])
            yield name, int(counts[:, kind].sum()), [f"{failed[row, kind]} inputs of cells of row {row}" for row in bad]
