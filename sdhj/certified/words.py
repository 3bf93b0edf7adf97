"""What is proved of each cell, as a word: the fewest steps to go, the proved inputs, and the one that a rule prefers.

All that an adversary can do is in a word already. So the controller of a certified table looks words up, in Python
(`Words`) and on the robot (`sdhj.certified.export`). A word is made when it is first asked for.
"""

import threading
from functools import cached_property
from itertools import repeat
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.kernels.words import INPUTS, NOTHING, unite
from sdhj.table.batches import CHUNK, NOT_ADMISSIBLE, Batch
from sdhj.table.rules import RULES, Candidates

MOST_WORDS = 1 << 20  # for one step, within and rule; before one more is kept all are forgotten
Rule = str | tuple[int, ...] | None  # a built-in one; all inputs, the first proved one of which is taken; none
CLEAR = -1  # in place of `within`: the inputs that stay clear for one interval


class ProvedBatch(Batch):
    """The answers of a certified table for M states: a `Batch` whose `margins` are computed when they are first read.

    These are numbers of steps: with n = max(steps_to_go, within), min(steps to go of the undisturbed successor - (n -
    1), 0); +inf for inputs that are not certified.
    """

    table: Any

    @cached_property
    def margins(self) -> FloatArray:
        """The margins (M, L), by where inputs lead the states without a disturbance."""
        steps_left = np.maximum(self.steps_to_go, self.within)
        moves = self.table.problem.interval(self.step).displacements(self.states)
        # constant dynamics have one row of moves for all states
        rows = np.arange(len(self.states)) if len(moves) > 1 else np.zeros(len(self.states), np.int64)
        return margins_of(self.table, self.states, self.step, steps_left, self.safe, moves, rows)


def margins_of(
    table: Any,
    states: FloatArray,
    step: int,
    steps_left: FloatArray,
    safe: FloatArray,
    moves: FloatArray,
    rows: FloatArray,
) -> FloatArray:
    """The margin of each safe input of states (M, ndim) at a step, +inf for others: (M, L).

    min(steps to go of the undisturbed successor - (steps_left - 1), 0); past a safe end the successor has 0 to go.
    """
    margins = np.full(safe.shape, np.inf)
    pairs, inputs = np.nonzero(safe)
    if pairs.size:
        # for answers in Python, and by `chosen_of` for what exported words prefer
        moved = states[pairs] + moves[rows[pairs], inputs]
        after = table.steps_by_cells(table.grid.clipped(moved), step + 1)
        if table.grid.has("frees"):
            after[table.grid.beyond(moved, "frees")] = 0  # out of danger for good
        margins[pairs, inputs] = np.minimum(after - (steps_left[pairs] - 1), 0)  # an integrator's error proves nothing
    return margins


def words_of(
    table: Any,
    cells: FloatArray,
    step: int,
    within: int,
    rule: Rule,
    among: FloatArray | None = None,
    lines: bool = False,
) -> FloatArray:
    """The words of cells (M, ndim) at a step, as `sdhj.kernels.words` reads them: (M, 2 + ceil(L / 32)) uint32.

    The inputs of a word are those proved to leave max(steps to go, within) - 1 steps, or with `CLEAR` to stay clear,
    and only those `among` other words; a cell that is not certified has `NOTHING`. By the rule None the one of least
    index is preferred. `lines` says that the cells come in lines along `proof.along`, which takes less time.
    """
    count = len(table.problem.inputs)
    to_go = np.zeros(len(cells), np.int64) if within == CLEAR else table.fewest(cells, step)
    held = np.flatnonzero(to_go <= table.steps - step)
    # What is nearer is asked with as many steps to go as the caller has.
    some, to_go, steps_left = cells[held], to_go[held], np.maximum(to_go[held], within)
    if within == CLEAR:
        safe = table.clear_inputs(some, step)
    else:
        safe = table.inputs_of(some, steps_left, step, None if among is None else inputs_in(among[held], count), lines)
    bits = np.zeros((held.size, 4 * -(-count // 32)), np.uint8)
    bits[:, : -(-count // 8)] = np.packbits(safe, axis=1, bitorder="little")
    made = np.empty((held.size, INPUTS + bits.shape[1] // 4), np.uint32)
    made[:, 0], made[:, INPUTS:] = to_go, bits.view("<u4")
    made[:, 1] = chosen_of(table, some, step, steps_left, to_go, safe, rule)  # -1 becomes NOTHING
    out = np.zeros((len(cells), made.shape[1]), np.uint32)
    # Cells that no set has have no inputs and no steps.
    out[:, :INPUTS] = NOTHING
    out[held] = made
    return out


def inputs_in(words: FloatArray, count: int) -> FloatArray:
    """The inputs that words list: (M, count)."""
    bits = np.ascontiguousarray(words[:, INPUTS:]).view(np.uint8)
    return np.unpackbits(bits, axis=1, count=count, bitorder="little").view(np.bool_)


def chosen_of(
    table: Any, cells: FloatArray, step: int, steps_left: FloatArray, to_go: FloatArray, safe: FloatArray, rule: Rule
) -> FloatArray:
    """The safe input that a rule prefers at the centre of each cell, or -1: (M,)."""
    count = safe.sum(axis=1)
    chosen = np.where(count > 0, safe.argmax(axis=1), NOT_ADMISSIBLE)
    some = np.flatnonzero(count > 1)
    if rule is None or not some.size:
        return chosen
    if isinstance(rule, tuple):
        order = np.array(rule)
        chosen[some] = order[safe[some][:, order].argmax(axis=1)]
        return chosen
    centres = table.centres(cells[some])
    places = table.proof.places(cells[some])
    # cells at one place have the same velocities, so moves are computed once for each place
    _, first, rows = np.unique(places, return_index=True, return_inverse=True)
    moves = table.problem.interval(step).displacements(centres[first])
    # Displacements that depend on no state have one row for all.
    rows = rows if len(moves) > 1 else np.zeros(some.size, np.int64)
    margins = margins_of(table, centres, step, steps_left[some], safe[some], moves, rows)
    if rule == "deepest":
        chosen[some] = margins.argmin(axis=1)
        return chosen
    batch = Batch(centres, step, 1, to_go[some], safe[some], margins, chosen[some])
    scores = np.full(margins.shape, np.inf)
    at, inputs = np.nonzero(safe[some])
    scores[safe[some]] = RULES[rule](Candidates(table.problem, batch, at, inputs, np.full(len(at), -1)))
    chosen[some] = preferred(scores, margins)
    return chosen


def preferred(scores: FloatArray, margins: FloatArray) -> FloatArray:
    """The input of least score for each state, of equals that of least margin, of these that of least index: (M,)."""
    least = scores.min(axis=1, keepdims=True)
    return np.where(scores == least, margins, np.inf).argmin(axis=1)


class Words:
    """The words of a certified table that have been asked for."""

    def __init__(self) -> None:
        self.layers: dict[Any, WordTable] = {}

    def __reduce__(self) -> Any:
        """Copy and pickle as an object without words."""
        return Words, ()  # locks cannot be copied

    def look_up(
        self, table: Any, states: FloatArray, step: int, within: int, rule: Rule
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Steps to go (M,), proved inputs (M, L) bool and preferred inputs (M,) of states (M, ndim) at a step.

        -1 where there is none. A state has the inputs of the cells within whose shell it lies that have the fewest
        steps to go.
        """
        alike = table.problem.time_invariant and not table.problem.has_no_target  # a word of step 0 is one of all steps
        start = 0 if alike else step
        # without a target a word is of the steps that are left, and of each step there are others
        key, inputs = (start, within, rule), len(table.problem.inputs)
        if key not in self.layers:
            self.layers.setdefault(key, WordTable(INPUTS + -(-inputs // 32), table.shape))
        layer, count = self.layers[key], len(states)
        out = np.empty(count, np.int64), np.empty((count, inputs), np.bool_), np.empty(count, np.int64)
        for begin in range(0, count, CHUNK):
            some = slice(begin, begin + CHUNK) if count > CHUNK else slice(None)
            layer.look_up(table, states[some], key, table.steps - step, tuple(part[some] for part in out))
        return out


class WordTable:
    """The words for one step, within and rule; several threads may ask."""

    def __init__(self, width: int, shape: tuple[int, ...]) -> None:
        self.lock, self.strides = threading.Lock(), np.cumprod([1, *shape[:0:-1]])[::-1]
        # by the flat number of a cell the place of its word
        self.places, self.words = dict[int, int](), np.empty((0, width), np.uint32)

    def look_up(self, table: Any, states: FloatArray, key: Any, most: int, out: Any) -> None:
        """Write the answers for states (M, ndim) into `out`: (to_go (M,), safe (M, L), chosen (M,))."""
        whose, near = table.near_cells(states)
        unite(whose, self.of(table, near.dot(self.strides), key), key[1], most, *out)

    def of(self, table: Any, cells: FloatArray, key: Any) -> FloatArray:
        """The words of cells with flat numbers (n,), made and kept if they are missing: (n, width)."""
        with self.lock:  # not while words are made
            places, words = [*map(self.places.get, cells.tolist(), repeat(-1))], self.words
        if -1 not in places:
            return words.take(places, 0)
        known = np.array(places) >= 0
        missing, which = np.unique(cells[~known], return_inverse=True)
        made = words_of(table, np.stack(np.unravel_index(missing, table.shape), axis=1), *key)
        found = np.empty((len(cells), made.shape[1]), np.uint32)
        found[known], found[~known] = words[np.array(places)[known]], made[which]
        with self.lock:
            self.keep(missing.tolist(), made)
        return found

    def keep(self, cells: list[int], made: FloatArray) -> None:
        """Keep the words `made` of cells with flat numbers (n,); the lock is held."""
        if len(self.places) + len(cells) > MOST_WORDS:
            self.places, self.words = {}, made[:0]
        # another thread may have kept some of them meanwhile
        used, new = len(self.places), [i for i, cell in enumerate(cells) if cell not in self.places]
        if used + len(new) > len(self.words):
            self.words = np.concatenate([self.words[:used], np.empty((used + len(new), made.shape[1]), np.uint32)])
        self.words[used : used + len(new)] = made[new]
        self.places.update((cells[i], used + n) for n, i in enumerate(new))
