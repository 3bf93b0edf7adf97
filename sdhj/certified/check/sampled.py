"""The look at its own claims with which every solve ends: at all of few, at a sample of many.

No step of the argument stands here: each claim is asked of the function of `argument` that proves it. What needs whole
arrays is looked at whole: that cells cover the axes, that sets grow, and how far off predictions are.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import groupby
from operator import itemgetter
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.check.argument import FINENESS, Argument, Clear, Tubes, axes_of, marked
from sdhj.certified.check.claims import ARRIVE, CLEAR, COVER, GOALS, GROW, MOVES, NEARER, PREDICTED, SHOWN, Claim
from sdhj.certified.check.files import BEFORE
from sdhj.certified.check.intervals import Array

MOST_WHOLE = 200_000  # claims that are all looked at
SAMPLED = 100_000  # claims that are looked at of more
ROWS = 64  # of a set, from which cells are drawn


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
    """How many claims were looked at, how many there are, and a text for each of the first that are not proved."""
    # for `CertifiedTable.looked_over`, which lets no table out where a claim is not proved
    in_memory: Any = InMemory(arrays)
    if head["cells"]["kind"] == "arm":
        from sdhj.certified.check.arm.claims import Arm  # with Numba, which no other robot needs
        from sdhj.certified.check.arm.drawn import some_rows

        arm = Arm(head, in_memory)
        few = arm.made.sum() <= MOST_WHOLE
        rows = np.flatnonzero(arm.made) if few else some_rows(arm, SAMPLED, np.random.default_rng(0))
        return counted(arm.claims(rows, True))
    sets = Argument(head, in_memory, problem)
    if (made := claims_made(sets)) <= MOST_WHOLE:
        return counted(sets.claims())
    wrong = [f"{COVER}: {text}" for text in sets.uncovered()]
    wrong += [f"{GROW}: {text}" for text in sets.do_not_grow()]
    if sets.problem.sensed:
        wrong += [f"{PREDICTED}: {text}" for text in sets.far_off()]
    if wrong:
        return 0, made, wrong[:SHOWN]
    rng, looked = np.random.default_rng(0), 0
    drawn: dict[int, Array] = {}  # by step cells of which something is promised
    most = max(SAMPLED // (3 * len(sets.pairs)), 8)
    filled: Array = np.any(sets.pool, axis=1)
    with np.errstate(all="ignore"):
        for step, pairs in groupby(sets.pairs, itemgetter(0)):
            goals, *others = (some_cells(sets, *pair, most, filled, rng) for pair in pairs)
            wrong += [f"{GOALS}: {named(step, cell, sets.counts)}" for cell in goals[~sets.goals_hold(step, goals)]]
            looked += goals.size
            if others:
                # All sets of a step are asked about at once, as there are few cells of each.
                drawn[step], sizes = np.concatenate(others), [cells.size for cells in others]
                within = np.repeat(np.arange(len(others)) + 1, sizes)
                into = np.repeat([sets.number(step + 1, n) for n in range(len(others))], sizes)
                bad = sets.not_led(drawn[step], into, step, partial(all_in, sets))
                wrong += [f"{NEARER}: {named(step, drawn[step][at], sets.counts)}, within {within[at]}" for at in bad]
                looked += drawn[step].size
        for count, own in of_inputs(sets, drawn, rng):
            looked, wrong = looked + count, wrong + own
    whole = sets.problem.ndim + len(sets.pairs) + sets.problem.count * sets.problem.sensed
    return looked + whole, made, wrong[:SHOWN]


def counted(claims: Iterable[Claim]) -> tuple[int, int, list[str]]:
    """How many claims were checked and how many there are, and a text for each of the first not proved."""
    found = [*claims]
    wrong = [f"{claim.name}: {text}" for claim in found if claim.failed for text in claim.failures[:SHOWN]]
    return sum(claim.checked for claim in found), sum(claim.made for claim in found), wrong


def named(step: int, cell: Any, counts: Array) -> str:
    """A step and a cell, by its flat number among so many, as text."""
    return f"step {step}, cell {tuple(int(one) for one in np.unravel_index(cell, counts))}"


def claims_made(sets: Argument) -> int:
    """How many claims there are, as `Argument.claims` counts them."""
    robot = sets.problem
    # As `Argument.claims`: axes that are covered, sets that grow, and predictions of each input.
    out = robot.ndim + len(sets.pairs) + robot.count * robot.sensed
    inputs = np.packbits(np.ones(robot.count, np.bool_), bitorder="little")  # other bits of marks are of none
    answers = [(sets.low, sets.known), *((one.bits, one.own) for one in sets.clear), (sets.arrives, sets.sites > 0)]
    for array, axes in answers:
        for step in range(len(array)):
            of_step = sets.moves_claimed if array is sets.low else sets.promised
            asked = of_step(None if len(array) == 1 else step).any(axis=axes_of(~axes)).ravel()
            marks = inputs * asked[:, None]
            out += int(asked.sum()) * robot.count if array is sets.low else bits_of(array[step] & marks)
    for step, within in sets.pairs:
        out += bits_of(sets.pool[sets.row(step, within)])
        # Only new cells are claimed, those that n - 1 has not.
        if within and robot.target is not None:
            out -= bits_of(sets.pool[sets.row(step, within - 1)])
    return out


def bits_of(words: Array) -> int:
    """How many bits are set."""
    return int(np.bitwise_count(words).sum(dtype=np.int64))


def some_cells(sets: Argument, step: int, within: int, most: int, filled: Array, rng: np.random.Generator) -> Array:
    """Flat numbers of about so many new cells of S_k^n, a quarter at ends and seams of axes, half at its rim.

    filled : of each block of the pool, whether it has any cell.
    """
    row, counts, grows = sets.row(step, within), sets.counts, within > 0 and sets.problem.target is not None
    less = sets.row(step, within - 1) if grows else None
    # Rows with a block of their own: others are the same block as those of n - 1 and have nothing new.
    changed = np.flatnonzero(filled[row] if less is None else row != less)
    places = (
        np.array(np.unravel_index(changed, counts[:-1])) if len(counts) > 1 else np.zeros((0, changed.size), np.int64)
    )
    # Some rows by chance, and of each axis two at either end, where a seam or a wall is.
    picked = [rng.permutation(changed)[:ROWS]]
    for k, n in enumerate(counts[:-1]):
        picked += [rng.permutation(changed[places[k] == end])[:2] for end in (0, n - 1)]
    rows = np.unique(np.concatenate(picked))
    # Only what n has and n - 1 has not.
    blocks = sets.pool[row[rows]] if less is None else sets.pool[row[rows]] & ~sets.pool[less[rows]]
    new = np.unpackbits(blocks.view(np.uint8), axis=1, count=int(counts[-1]), bitorder="little")
    own, last = np.nonzero(new)
    cells = rng.permutation(rows[own] * counts[-1] + last)
    at = np.array(np.unravel_index(cells, counts))
    ends = ((at == 0) | (at == counts[:, None] - 1)).any(axis=0)
    each = [cells[at[k] == end][:1] for k, n in enumerate(counts) for end in (0, n - 1)]
    # First what is at ends: one of each end of each axis, then any up to a quarter.
    first = np.unique(np.concatenate([*each, cells[ends][: most // 4]]))
    # A rim is looked for among 8 times as many as are wanted.
    cells = np.concatenate([first, cells[~np.isin(cells, first)][: 8 * most]])
    at, sides = np.array(np.unravel_index(cells, counts)), np.eye(len(counts), dtype=np.int64)
    beside = np.concatenate([at + side[:, None] for side in (*sides, *-sides)], axis=1)
    among: Array = all_in(sets, beside, beside + 1, np.full(beside.shape[1], sets.number(step, within)))
    rim: Array = np.any(~among.reshape(2 * len(counts), cells.size), axis=0)
    # What is first has been taken.
    rim[: first.size] = False
    others = ~rim
    others[: first.size] = False
    edge = cells[rim][: most // 2]
    return np.concatenate([first, edge, cells[others][: max(most - first.size - edge.size, 0)]])


def all_in(sets: Argument, first: Array, past: Array, into: Array) -> Array:
    """As `argument.AllIn`, by looking up each cell, without the sums of a whole set."""
    axes = zip(sets.counts.tolist(), sets.problem.periodic, first, past, strict=True)
    both = [
        (a, np.minimum(b - a, n)) if closes else (np.clip(a, 0, n - 1), np.clip(b, 1, n) - np.clip(a, 0, n - 1))
        for n, closes, a, b in axes
    ]
    begin, wide = np.array(both).swapaxes(0, 1)
    left = np.arange(begin.shape[1])
    for by in np.ndindex(*wide.max(axis=1, initial=1)):  # of the widest box
        # Smaller boxes ask about their last cell again.
        by_own = np.minimum(np.array(by)[:, None], wide[:, left] - 1)
        *rows, last = (begin[:, left] + by_own) % sets.counts[:, None]
        row = np.ravel_multi_index(rows, sets.counts[:-1]) if rows else np.zeros(left.size, np.int64)
        words = sets.pool[sets.index[into[left], row], last >> 6]
        left = left[(words >> (last & 63).astype(np.uint64) & np.uint64(1)).astype(np.bool_)]
        if not left.size:
            break
    return np.isin(np.arange(begin.shape[1]), left)


def of_inputs(sets: Argument, drawn: Mapping[int, Array], rng: np.random.Generator) -> Iterator[tuple[int, list[str]]]:
    """Yield what `of_an_input` says of every input at some step, and of every step under some input.

    drawn : by step cells of which something is promised.
    """
    inputs, steps = rng.permutation(sets.problem.count).tolist(), rng.permutation([*drawn]).tolist()
    tasks = range(max(len(inputs), len(steps)) if steps else 0)
    for j, step in ((inputs[task % len(inputs)], steps[task % len(steps)]) for task in tasks):
        cells = rng.permutation(drawn[step])[: max(SAMPLED // (3 * len(tasks)), 1)]
        yield of_an_input(sets, step, j, np.unique(cells))


def of_an_input(sets: Argument, step: int, j: int, numbers: Array) -> tuple[int, list[str]]:
    """How many claims there are of u_j in the interval from a step, of some cells, and which fail.

    What stays open is asked again by finer pieces of the interval. numbers : of cells, flat; of moves there is a claim
    at each of their places, of the rest where the bit is set, as `Argument.of_an_input` checks of all cells.
    """
    start, cells = min(step, len(sets.low) - 1), np.array(np.unravel_index(numbers, sets.counts))
    left = [Drawn(MOVES, sets.strides, np.unique(sets.strides @ cells), partial(sets.moves_hold, start, j))]
    for one in sets.clear:
        strides = sets.strides_of(one.own)
        clear = np.unique(strides @ cells)
        clear = clear[marked(one.bits, step, j, clear)]
        # `one` is bound here, as the loop goes on.
        left.append(Drawn(CLEAR, strides, clear, partial(clear_of, sets, one, step, j)))
    if len(sets.arrives):
        at, sites = min(step, len(sets.arrives) - 1), np.unique(sets.sites @ cells)
        sites = sites[marked(sets.arrives, at, j, sites)]
        left.append(Drawn(ARRIVE, sets.sites, sites, partial(sets.arrivals_hold, at)))
    looked = sum(one.numbers.size for one in left)
    # What holds with coarse pieces is not asked with finer ones.
    for pieces in FINENESS:
        places = np.unique(np.concatenate([sets.strides @ sets.cells_at(one.numbers, one.strides) for one in left]))
        if not places.size:
            break
        tubes = sets.tubes(places, j, start, pieces)
        left = [one._replace(numbers=one.numbers[~one.hold(one.numbers, tubes)]) for one in left if one.numbers.size]
    texts = [
        f"{one.name}: input {j}, {named(step, own, np.where(one.strides, sets.counts, 1))}"
        for one in left
        for own in one.numbers
    ]
    return looked, texts


class Drawn(NamedTuple):
    """Claims of one kind of cells on some axes: by their numbers, and what tells with tubes of which they hold."""

    name: str
    strides: Array
    numbers: Array
    hold: Callable[[Array, Tubes], Array]


def clear_of(sets: Argument, one: Clear, step: int, j: int, numbers: Array, tubes: Tubes) -> Array:
    """Whether u_j is proved clear, of what `one` is about, from each of its cells (M,), by their numbers: (M,)."""
    cells, out = sets.cells_at(numbers, sets.strides_of(one.own)), np.ones(numbers.size, np.bool_)
    for _, holds in sets.questions(one, step, j, tubes):
        left = np.flatnonzero(out)
        out[left] = holds(np.tile(cells[:, left], (2, 1)))
    return out
