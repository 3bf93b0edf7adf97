"""Words of cells: what they say of states near these, and how they are packed.

A *word* is a row of uint32: the fewest steps to go, the input that a rule prefers, and the inputs that are proved, 32
in a number, the first one lowest. `NOTHING` stands for no steps, and for no input.
"""

import numpy as np

from sdhj.kernels.compiling import kernel
from sdhj.kernels.packed import cells_at, first_holding

NOTHING = np.uint32(0xFFFFFFFF)
INPUTS = 2  # where the inputs of a word begin
SPREAD = np.uint64(0x9E3779B97F4A7C15)  # an odd number with bits everywhere, which spreads neighbours


@kernel(nogil=True)
def unite(whose, words, within, most, to_go, safe, chosen):
    """Write what the words (n, ...) of the cells near some states say to to_go (M,), safe (M, L) and chosen (M,).

    Of several cells near a state those with the fewest steps to go, at least `within`, count: their inputs are united,
    and the first one's choice is the state's. Words with more than `most` steps say nothing. -1 for none.

    whose (n,) : of which state each word is, in order. within <= most.
    """
    to_go[:], safe[:], chosen[:] = -1, False, -1
    fewest = 0  # of the state of the word before
    for i in range(whose.size):
        m, word = whose[i], words[i]
        steps = np.int64(word[0])
        if steps > most:
            continue
        steps_left = max(steps, within)
        if to_go[m] < 0 or steps_left < fewest:
            fewest = steps_left
            chosen[m], safe[m] = -1, False
        to_go[m] = steps if to_go[m] < 0 else min(to_go[m], steps)
        # After the reset, so that inputs of all cells that are as near are united.
        if steps_left == fewest:
            for j in range(safe.shape[1]):
                safe[m, j] |= (word[INPUTS + (j >> 5)] >> np.uint32(j & 31)) & np.uint32(1) != 0
            if chosen[m] < 0 and word[1] != NOTHING:
                chosen[m] = word[1]


@kernel(nogil=True)
def cells_near(states, cells, slack, rows, near):
    """Write the cells within slack (ndim,) of states (M, ndim) to near (n, ndim), and whose to rows; returns n."""
    # callers make rows and near for M 2^ndim cells, the most that there can be
    found = np.empty((1 << states.shape[1], states.shape[1]), np.int64)
    count = 0
    for m in range(states.shape[0]):
        for k in range(cells_at(states[m], cells, slack, found)):
            rows[count], near[count] = m, found[k]
            count += 1
    return count


@kernel(nogil=True)
def fewest_of_cells(some, cells, index, pool, out):
    """out[m] = the number of the first of n nested sets that has the cell some[m], of (M, ndim), n for none; in place.

    index (n, R), pool (B, W) : as for `fewest_steps`.
    """
    for m in range(some.shape[0]):
        # For cells themselves, where `fewest_steps` is for states and what is near them.
        out[m] = first_holding(some[m], index.shape[0], cells, index, pool)


# ---- packing


@kernel(nogil=True)
def number_records(records, known, used, slots, out):
    """out[i] = the number of records[i] (bytes,) among the `used` known ones; new ones are added, in place.

    Returns how many are known then, or -1 where there is no room: then nothing in `out` counts. slots (K,) : a hash
    table of numbers, -1 for none, K a power of two above the rows of `known`; in place.
    """
    # `Packer.add` then makes room and asks again
    for i in range(records.shape[0]):
        if i > 0 and np.array_equal(records[i], records[i - 1]):  # as neighbours mostly are
            out[i] = out[i - 1]
            continue
        mixed = np.uint64(0)
        # Of all bytes, as records differ in few of them.
        for byte in records[i]:
            mixed = (mixed ^ np.uint64(byte)) * SPREAD
        slot = np.int64(mixed >> np.uint64(32)) & (slots.size - 1)
        while slots[slot] >= 0 and not np.array_equal(known[slots[slot]], records[i]):
            slot = (slot + 1) & (slots.size - 1)
        if slots[slot] < 0:
            if used == known.shape[0]:
                return -1
            known[used], slots[slot] = records[i], used
            used += 1
        out[i] = slots[slot]
    return used


@kernel(nogil=True)
def pack_block(numbers, width, seen, out):
    """Write a block's numbers (cells,), at most 65535 different ones, as bytes to `out`; returns how many.

    In order: the bits of an entry, a byte; the palette's length, two bytes; the palette, the different numbers as they
    come, `width` bytes each; and for each cell its number's place in the palette. seen (words,) : -1 everywhere, as it
    is again in the end.
    """
    colours = 0
    for number in numbers:
        if seen[number] < 0:
            seen[number] = colours
            for byte in range(width):
                out[3 + colours * width + byte] = (number >> (8 * byte)) & 255
            colours += 1
    # `sdhj_word` and `sdhj_bodies_fit` in sdhj.h read this, and `Words` in `sdhj.certified.check.words`
    bits = 0
    while (1 << bits) < colours:
        bits += 1
    out[0], out[1], out[2] = bits, colours & 255, colours >> 8
    begin = 3 + colours * width
    pending, record = 0, 0
    for number in numbers:
        pending |= seen[number] << record
        record += bits
        while record >= 8:
            out[begin] = pending & 255
            begin += 1
            pending, record = pending >> 8, record - 8
    # What is left of the last byte; bits behind the last entry are 0.
    if record > 0:
        out[begin] = pending
        begin += 1
    for number in numbers:
        seen[number] = -1
    return begin
