"""The rows of an arm at which a solve looks where its claims are many: at rims of sets, of each kind, and by chance.

It proves nothing: `sampled` has the claims of these rows checked as all are.
"""

import math
from collections.abc import Iterator

import numpy as np

from sdhj.certified.check.arm.bits import Array
from sdhj.certified.check.arm.claims import Arm

NEAR_RIMS = 512  # rows, from which those at rims are drawn


def some_rows(arm: Arm, most: int, rng: np.random.Generator) -> Array:
    """Numbers of rows with `most` claims or more, half as many at rims of sets.

    Every set of every step, every input and every end of a joint is among them; of the agent's walls what any of
    `NEAR_RIMS` rows has.
    """
    made = arm.made
    rows = rng.permutation(np.flatnonzero(made))
    near = rows[:NEAR_RIMS]
    found = np.array([at_rims(arm, row) for row in near.tolist()])
    # Those first of whose claims most are at rims.
    order = np.argsort(-found[:, 0] / made[near])
    rims = order[: 1 + np.searchsorted(np.cumsum(found[order, 0]), most // 2)]
    walls = [order[found[order, wall] > 0][:1] for wall in range(1, 5)]
    chosen = np.unique(near[np.concatenate([rims, *walls])])
    for own in map(np.flatnonzero, each_of(arm)):
        if own.size and not np.isin(own, chosen).any():
            chosen = np.append(chosen, rng.choice(own))
    others = rows[~np.isin(rows, chosen)]
    # At least one by chance, and more where all these have too few.
    return np.append(chosen, others[: 1 + np.searchsorted(np.cumsum(made[others]), most - made[chosen].sum())])


def each_of(arm: Arm) -> Iterator[Array]:
    """Yield which rows are at each end of a joint, have claims of each input, and new cells of each set: (rows,) bool.

    Sets of late steps come first, as rows that have new cells of these have some of earlier ones, as a rule.
    """
    filled: Array = np.any(arm.pool, axis=1)
    some: Array = np.any(filled[arm.index], axis=0)
    for joint, n in enumerate(arm.counts[:2].tolist()):
        at = np.indices(arm.counts[:2].tolist())[joint].ravel()
        yield from (some & (at == end) for end in (0, n - 1))
    yield from arm.allowed.any(axis=0).reshape(arm.allowed.shape[1], -1)
    for number in reversed(range(len(arm.index))):
        own = arm.index[number]
        # Where the block is another, the cells are.
        yield own != arm.index[number - 1] if arm.pairs[number, 1] else filled[own]


def at_rims(arm: Arm, row: int) -> list[int]:
    """How many of the new cells in a row are at the rim of their set, and how many at each end of the agent's axes."""
    n1, n2, *sides = arm.counts.tolist()

    def blocks(first: int, second: int) -> Array:
        words = arm.pool[arm.index[:, first % n1 * n2 + second % n2]]
        return np.unpackbits(words.view(np.uint8), axis=1, count=math.prod(sides), bitorder="little")

    i, j = divmod(row, n2)
    own = blocks(i, j)
    less, new = np.flatnonzero(arm.pairs[:, 1]), own.copy()
    new[less] &= ~own[less - 1]
    # A wall is no rim: beside a cell at a wall is the cell itself.
    beside = np.pad(own.reshape(-1, *sides), ((0, 0), (1, 1), (1, 1)), "edge")
    inner = beside[:, 2:, 1:-1] & beside[:, :-2, 1:-1] & beside[:, 1:-1, 2:] & beside[:, 1:-1, :-2]
    for joints in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
        inner &= blocks(*joints).reshape(inner.shape)
    new = new.reshape(inner.shape)
    return [int((each > 0).sum()) for each in (new > inner, new[:, 0], new[:, -1], new[..., 0], new[..., -1])]
