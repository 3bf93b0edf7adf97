"""The look at its own claims with which every solve ends: at all of few, at a sample of many.

No step of the argument stands here: each claim is asked of the function of `argument` that proves it. What needs whole
arrays is looked at whole: that cells cover the axes, that sets grow, and how far off predictions are.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from sdhj.certified.check.argument import FINENESS, SHOWN, Argument, Tubes, axes_of, farthest
from sdhj.certified.check.claims import ARRIVE, CLEAR, COVER, GOALS, GROW, MOVES, NEARER, PREDICTED, Claim
from sdhj.certified.check.files import BEFORE
from sdhj.certified.check.intervals import Array

MOST_WHOLE = 200_000  # claims that are all looked at
SAMPLED = 100_000  # claims that are looked at of more
ROWS = 64  # of a set, from which cells are drawn
AT_ONCE = 1 << 17  # cells that are looked up at once


class InMemory:
    """Arrays by name, as `Argument` reads those of a file."""

    def __init__(self, arrays: Mapping[str, Array]) -> None:
        """Arrays of numbers, which nobody changes."""
        self.arrays = arrays
        self.stated = {
            name: SimpleNamespace(kind=one.dtype.name, size=BEFORE + one.nbytes) for name, one in arrays.items()
        }

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of an array."""
        return self.arrays[name].shape

    def array(self, name: str) -> Array:
        """The array of a name."""
        return self.arrays[name]


def looked_over(head: Mapping[str, Any], arrays: Mapping[str, Array], problem: Any) -> tuple[int, int, list[str]]:
    """How many claims were looked at, how many there are, and a text for each of the first that are not proved.

    head, arrays : what a file would have, but for digests. problem : for black boxes, as of `verify`.
    """
    held: Any = InMemory(arrays)
    if head["cells"]["kind"] == "arm":
        from sdhj.certified.check.arm.claims import Arm  # with Numba, which no other robot needs

        arm = Arm(head, held)
        share = SAMPLED / max(int(arm.allowed.sum()) + bits_of(arm.pool), 1)
        rows = None if 2 * share >= 1 else max(round(share * arm.index.shape[1]), 1)
        return counted(arm.claims(rows, 0, True))
    sets = Argument(head, held, problem)
    if (made := claims_made(sets)) <= MOST_WHOLE:
        return counted(sets.claims())
    wrong = [f"{COVER}: {text}" for text in sets.uncovered()]
    wrong += [f"{GROW}: {text}" for text in sets.do_not_grow()]
    if sets.problem.sensed:
        wrong += [f"{PREDICTED}: {text}" for text in sets.far_off()]
    if wrong:
        return 0, made, wrong[:SHOWN]
    rng, looked = np.random.default_rng(0), 0
    drawn: dict[int, list[Array]] = {}  # by step cells of which something is promised
    each = max(SAMPLED // (3 * len(sets.pairs)), 8)
    with np.errstate(all="ignore"):
        for step, within in sets.pairs:
            cells = some_cells(sets, step, within, each, rng)
            bad = cells[~sets.goals_hold(cells, step)] if not within else not_nearer(sets, step, within, cells)
            wrong += [
                f"{NEARER if within else GOALS}: {named(step, cell, sets.counts)}, within {within}" for cell in bad
            ]
            looked += cells.size
            if within:
                drawn.setdefault(step, []).append(cells)
        for count, own in of_inputs(sets, {step: np.concatenate(own) for step, own in drawn.items()}, rng):
            looked, wrong = looked + count, wrong + own
    whole = sets.problem.ndim + len(sets.pairs) + sets.problem.count * sets.problem.sensed
    return looked + whole, made, wrong[:SHOWN]


def counted(claims: Iterable[Claim]) -> tuple[int, int, list[str]]:
    """How many claims were checked and how many there are, in all, and a text for each of the first not proved."""
    found = [*claims]
    wrong = [f"{claim.name}: {text}" for claim in found if claim.failed for text in claim.failures[:SHOWN]]
    return sum(claim.checked for claim in found), sum(claim.made for claim in found), wrong


def named(step: int, cell: Any, counts: Array) -> str:
    """A step and a cell, by its flat number among so many, as text."""
    return f"step {step}, cell {tuple(int(one) for one in np.unravel_index(cell, counts))}"


def claims_made(sets: Argument) -> int:
    """How many claims there are, as `Argument.claims` counts them."""
    robot, steps = sets.problem, range(sets.problem.steps)
    out = robot.ndim + len(sets.pairs) + robot.count * robot.sensed
    inputs = np.packbits(np.ones(robot.count, np.bool_), bitorder="little")  # other bits of marks are of none
    for array, axes in ((sets.low, sets.known), (sets.clear, sets.known | True), (sets.arrives, sets.sites > 0)):
        for step in range(len(array)):
            asked = sets.promised(steps if len(array) == 1 else [step])
            asked = asked.any(axis=axes_of(~axes)).ravel()
            out += int(asked.sum()) * robot.count if array is sets.low else bits_of(array[step][asked] & inputs)
    for step, within in sets.pairs:
        out += bits_of(sets.pool[sets.row(step, within)])
        if within and robot.target is not None:
            out -= bits_of(sets.pool[sets.row(step, within - 1)])
    return out


def bits_of(words: Array) -> int:
    """How many bits are set."""
    return int(np.bitwise_count(words).sum(dtype=np.int64))


def some_cells(sets: Argument, step: int, within: int, most: int, rng: np.random.Generator) -> Array:
    """Flat numbers of cells that S_k^n adds to the set with a step less, or has without a target; about so many.

    A quarter is at ends and seams of axes, half at the rim of the set, as far as there are such.
    """
    row, counts, grows = sets.row(step, within), sets.counts, within > 0 and sets.problem.target is not None
    less = sets.row(step, within - 1) if grows else None
    filled: Array = np.any(sets.pool, axis=1)
    rows = np.flatnonzero(filled[row] if less is None else row != less)
    at = np.array(np.unravel_index(rows, counts[:-1])) if len(counts) > 1 else np.zeros((0, rows.size), np.int64)
    picked = [rng.permutation(rows)[:ROWS]]
    for k, n in enumerate(counts[:-1]):
        picked += [rng.permutation(rows[at[k] == end])[:2] for end in (0, n - 1)]
    rows = np.unique(np.concatenate(picked))
    blocks = sets.pool[row[rows]] if less is None else sets.pool[row[rows]] & ~sets.pool[less[rows]]
    new = np.unpackbits(blocks.view(np.uint8), axis=1, count=int(counts[-1]), bitorder="little")
    own, last = np.nonzero(new)
    cells = rng.permutation(rows[own] * counts[-1] + last)
    at = np.array(np.unravel_index(cells, counts))
    ends = ((at == 0) | (at == counts[:, None] - 1)).any(axis=0)
    each = [cells[at[k] == end][:1] for k, n in enumerate(counts) for end in (0, n - 1)]
    first = np.unique(np.concatenate([*each, cells[ends][: most // 4]]))
    cells = np.concatenate([first, cells[~np.isin(cells, first)][: 8 * most]])
    rim = np.zeros(cells.size, np.bool_)
    for k, side in ((k, side) for k in range(len(counts)) for side in (-1, 1)):
        beside = np.array(np.unravel_index(cells, counts))
        beside[k] += side
        rim |= ~all_in(sets, row, beside, beside + 1)
    rim[: first.size] = False
    others = ~rim
    others[: first.size] = False
    edge = cells[rim][: most // 2]
    return np.concatenate([first, edge, cells[others][: max(most - first.size - edge.size, 0)]])


def all_in(sets: Argument, row: Array, first: Array, past: Array) -> Array:
    """Whether all cells of boxes from first to past (ndim, M) are in a set: (M,) bool, by looking up each of them.

    As `Argument.all_in`, without the sums of a whole set. row : of the set, as of `Argument.row`.
    """
    axes = zip(sets.counts.tolist(), sets.problem.periodic, first, past, strict=True)
    both = [
        (a, np.minimum(b - a, n)) if closes else (np.clip(a, 0, n - 1), np.clip(b, 1, n) - np.clip(a, 0, n - 1))
        for n, closes, a, b in axes
    ]
    begin, wide = np.array(both).swapaxes(0, 1)
    out = np.ones(begin.shape[1], np.bool_)
    corners = np.indices([2] * len(wide)).reshape(len(wide), -1) * wide.max(initial=1)
    for steps in (corners, np.indices(wide.max(axis=1, initial=1)).reshape(len(wide), -1)):  # of the widest box
        left = np.flatnonzero(out)
        for own in np.array_split(left, -(-left.size * steps.shape[1] // AT_ONCE) or 1):
            by = np.minimum(steps[:, None], wide[:, own, None] - 1)
            *rows, last = (begin[:, own, None] + by) % sets.counts[:, None, None]
            number = np.zeros(by.shape[1:], np.int64)
            for n, cells in zip(sets.counts.tolist(), rows, strict=False):
                number = number * n + cells
            words = sets.pool[row[number], last >> 6]
            out[own] = (words >> (last & 63).astype(np.uint64) & np.uint64(1)).all(axis=1)
    return out


def not_nearer(sets: Argument, step: int, within: int, cells: Array) -> Array:
    """Of cells of S_k^n, flat numbers, those that no clear input leads on, as `Argument.not_nearer` has it."""
    inside = partial(all_in, sets, sets.row(step + 1, within - 1))
    for j in range(sets.problem.count):
        if not cells.size:
            break
        cells = cells[~sets.leads(cells, step, j, inside)]
    return cells


def of_inputs(sets: Argument, drawn: Mapping[int, Array], rng: np.random.Generator) -> Iterator[tuple[int, list[str]]]:
    """Yield how many claims of moves, clear inputs and arrivals were looked at, and a text for each that is not proved.

    Every input at some step, and every step under some input. drawn : by step cells of which something is promised.
    """
    inputs, steps = rng.permutation(sets.problem.count).tolist(), rng.permutation([*drawn]).tolist()
    tasks = range(max(len(inputs), len(steps)) if steps else 0)
    for j, step in ((inputs[task % len(inputs)], steps[task % len(steps)]) for task in tasks):
        cells = rng.permutation(drawn[step])[: max(SAMPLED // (3 * len(tasks)), 1)]
        yield of_an_input(sets, step, j, np.unique(cells))


def of_an_input(sets: Argument, step: int, j: int, numbers: Array) -> tuple[int, list[str]]:
    """How many claims there are of u_j in the interval from a step, of cells with flat numbers, and which fail."""
    start = min(step, len(sets.low) - 1)
    cells = np.array(np.unravel_index(numbers, sets.counts))
    places = np.unique(sets.strides @ cells)
    said = [(CLEAR, sets.clear, numbers), (ARRIVE, sets.arrives, sets.sites @ cells)]
    shapes = {MOVES: np.where(sets.known, sets.counts, 1), ARRIVE: np.where(sets.sites, sets.counts, 1)}
    left = [(MOVES, places)]
    for name, marks, own in said:
        if len(marks):
            at = marks[min(step, len(marks) - 1), own, j // 8] >> np.uint8(j % 8) & 1 == 1
            left.append((name, np.unique(own[at])))
    looked = sum(own.size for _, own in left)
    for pieces in FINENESS:
        open_places = [own if name == MOVES else at_place(sets, own, name) for name, own in left]
        places = np.unique(np.concatenate(open_places))
        if not places.size:
            break
        rows = np.empty(sets.low.shape[2], np.int64)
        rows[places] = np.arange(places.size)
        swept, last = sets.driven(places, j, start, pieces)
        tubes, open_ = Tubes(rows, swept, farthest(swept), last), list[tuple[str, Array]]()
        for name, own in left:
            if name == MOVES:
                good = sets.moves_hold(own, start, j, last[:, :, rows[own]])
            elif name == ARRIVE:
                good = sets.arrivals_hold(own, min(step, len(sets.arrives) - 1), tubes)
            else:
                good = clear_of(sets, step, j, np.array(np.unravel_index(own, sets.counts)), tubes)
            open_.append((name, own[~good]))
        left = open_
    texts = [
        f"{name}: input {j}, {named(step, one, shapes.get(name, sets.counts))}" for name, own in left for one in own
    ]
    return looked, texts


def at_place(sets: Argument, numbers: Array, name: str) -> Array:
    """The places of cells, or of sites where the claim is of arrivals, with flat numbers (M,): (M,)."""
    if name == ARRIVE:
        return sets.strides @ sets.cells_at(numbers, sets.sites)
    return sets.strides @ np.array(np.unravel_index(numbers, sets.counts))


def clear_of(sets: Argument, step: int, j: int, cells: Array, tubes: Tubes) -> Array:
    """Whether u_j is proved clear from each of the cells (ndim, M) in the interval from a step: (M,) bool."""
    out = np.ones(cells.shape[1], np.bool_)
    for _, holds in sets.questions(step, j, tubes):
        left = np.flatnonzero(out)
        out[left] = holds(np.tile(cells[:, left], (2, 1)))
    return out
