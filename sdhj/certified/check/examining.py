"""Every claim of the file of a robot of one's own, examined: what was made, what was checked, what failed."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from tqdm import tqdm

from sdhj.certified.check.bits import Array
from sdhj.certified.check.robots import BOXES_AT_ONCE, FINER, Robot


def examine(robot: Robot, samples: int | None, seed: int, silent: bool) -> Iterator[tuple[str, int, int, list[str]]]:
    """Of each kind of claim its name, how many were made and checked, and what failed."""
    wrong = robot.cover()
    yield "cells cover the axes", len(robot.axes), len(robot.axes), wrong
    if wrong:
        return
    size, rng = int(np.prod(robot.counts)), np.random.default_rng(seed)
    chosen = np.ones(size, np.bool_)
    if samples is not None:
        chosen[:] = False
        chosen[rng.permutation(size)[:samples]] = True
    if robot.sensing:
        wrong = robot.known_within()
        yield "predictions are as near as told", robot.low.shape[1], robot.low.shape[1], wrong
    yield from examine_moves(robot, chosen, silent)
    yield from examine_sets(robot, chosen, silent)
    if robot.trusted:
        yield f"rests on what is stated of {', '.join(sorted(robot.trusted))}", 0, 0, []


def examine_moves(robot: Robot, chosen: Array, silent: bool) -> Iterator[tuple[str, int, int, list[str]]]:
    """Moves of the cells chosen, and every input that is clear from them."""
    numbers = np.flatnonzero(chosen)
    at = robot.cells(numbers) @ robot.strides
    places = np.unique(at)
    wrong: tuple[list[str], list[str]] = ([], [])
    made = checked = 0
    for start, j in tqdm([*product(range(len(robot.low)), range(robot.low.shape[1]))], desc="moves", disable=silent):
        steps = range(len(robot.clear)) if len(robot.low) == 1 else [start]
        flags = {step: (robot.clear[step, :, j // 8] >> np.uint8(j % 8)) & 1 for step in steps}
        told = {step: np.flatnonzero(flags[step][numbers]) for step in steps}
        made, checked = made + sum(int(f.sum()) for f in flags.values()), checked + sum(t.size for t in told.values())
        moving = places
        for finer in FINER:
            asked = np.union1d(moving, np.concatenate([at[some] for some in told.values()])).astype(np.int64)
            if not asked.size:
                break
            swept, last = robot.driven(asked, j, robot.time(start), finer)
            moving = np.intersect1d(moving, asked[~robot.moves_hold(asked, start, j, last)])
            for step, some in told.items():
                rows = np.searchsorted(asked, at[some])
                slabs = [slice(begin, begin + BOXES_AT_ONCE) for begin in range(0, some.size, BOXES_AT_ONCE)]
                good = [robot.clear_holds(numbers[some[own]], step, swept[rows[own]]) for own in slabs]
                told[step] = some[~np.concatenate(good)] if good else some
        wrong[0].extend(f"start {start}, input {j}, place {place}" for place in moving)
        wrong[1].extend(f"start {step}, input {j}, cell {n}" for step, some in told.items() for n in numbers[some])
    starts, inputs, all_places, _ = robot.low.shape
    yield "moves", starts * inputs * all_places, starts * inputs * places.size, wrong[0]
    yield "clear of the unsafe sets", made, checked, wrong[1]


def examine_sets(robot: Robot, chosen: Array, silent: bool) -> Iterator[tuple[str, int, int, list[str]]]:
    """Goals, whether sets grow (without a target: shrink), and every step."""
    stays, kinds = robot.stays, {"in the target, and safe": [0, 0], "one step nearer": [0, 0]}
    failed: dict[str, list[str]] = {"sets grow with the steps to go": [], **{name: [] for name in kinds}}
    rows = [(0, n) for n in range(robot.steps + 1)]
    if not robot.timeless:
        rows = [(k, n) for k in range(robot.steps + 1) for n in range(robot.steps - k + 1)]
    if len(robot.index) == 1:  # what is safe for ever: it leads into itself
        rows = [(0, 0), (0, 1)]

    def row_of(step: int, within: int) -> int:
        if robot.timeless:
            return min(within, len(robot.index) - 1)
        return step * (robot.steps + 1) - step * (step - 1) // 2 + within

    for step, within in tqdm(rows, desc="sets", disable=silent):
        here = robot.bits(row_of(step, within))
        name = "one step nearer" if within else "in the target, and safe"
        new = here
        if within:
            less = robot.bits(row_of(step, within - 1))
            if ((here & ~less) if stays else (less & ~here)).any():
                failed["sets grow with the steps to go"].append(f"start {step}, within {within}")
            new = here if stays else here & ~less
        numbers = np.flatnonzero(new & chosen)
        kinds[name][0] += int(new.sum())
        kinds[name][1] += numbers.size
        if not within:
            good = robot.goals_hold(numbers, step)
        else:
            good = robot.steps_hold(numbers, step, robot.bits(row_of(step + 1, within - 1)))
        failed[name].extend(f"start {step}, within {within}, cell {number}" for number in numbers[~good])
    yield "sets grow with the steps to go", len(rows), len(rows), failed["sets grow with the steps to go"]
    for name, (made, checked) in kinds.items():
        yield name, made, checked, failed[name]
