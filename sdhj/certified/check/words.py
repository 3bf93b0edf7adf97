"""The words of an exported table, `sdhj_table.bin`: what C reads of a cell is within what the table's file proves.

What was rounded, merged or packed on the way is of no matter: this reader shares no code with what wrote the file, and
asks of every cell and every input in its word what `argument` asks of some input. A word may claim less than is proved.

A cell is in the set of the steps to go that it claims (`steps`); under each input that is claimed the cell is clear,
and all cells that it may lead to are in the set with a step less (`safe`, `select`), or in that of all remaining steps
(`filter`); under others it is clear (`clear`). Images for a controller that remembers are neither wider nor narrower
than those of the table's file: of a narrower one the state may be outside, a wider one may hold cells from which
nothing is proved.
"""

import hashlib
import math
import os
import struct
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.certified.check.argument import Argument, Bar, silently
from sdhj.certified.check.claims import Claim, Count
from sdhj.certified.check.intervals import Array
from sdhj.certified.check.reading import expect

MAGIC, HEAD = b"sdhjcell", 560
FIELDS = ("steps", "select", "safe", "filter", "clear")
UNPROVED, NO_INPUT, ARRIVED = 0xFFFFFFFF, 65535, 65534
AT_ONCE = 1 << 20  # cells that are looked at at once


class Words:
    """A file that `sdhj export` wrote, as it was read.

    steps, starts, leads : how many there are, how many with words, and how many with images of their own.
    counts, sides, blocks : along each axis, of cells, of a block's cells, and of blocks; (ndim,) int each.
    index : (starts, *blocks), of each block's body. bodies : (bodies, cells of a block) uint32, the numbers of words.
    fields : by name, of each word; "steps" and "select" as (words,) int64, fields of inputs as (words, L) bool.
    images : for each axis (leads, L, cells of axes in `reads`, 2), the first and the last cell, less the cell's own.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Read an exported file."""
        version, data = _whole(path)
        # offsets and order are those of `file_of` in `sdhj.certified.export` and of `sdhj_open` in sdhj.h
        numbers = struct.unpack_from("<17I", data, 16)
        size, ndim, inputs, components, self.steps, self.starts, fields, self.brake = numbers[:8]
        record, words, width, index_width, bodies, body_bytes, tests, at_width, self.leads = numbers[8:]
        expect(size == len(data) and 1 <= ndim <= 6 and 1 <= inputs, "the exported table must have its bytes", size)
        self.counts, self.sides, periodic, self.safe_ends = (
            np.frombuffer(data, "<u4", 24, 160).reshape(4, 6)[:, :ndim].astype(int)
        )
        self.periodic, reals = periodic % 2 == 1, np.frombuffer(data, "<f8", 38, 256)
        self.layers = np.stack([periodic >> 1 & 1, periodic >> 2 & 63], axis=1)  # at the lower, at the upper end
        self.reads = (periodic[:, None] >> 8 + np.arange(ndim)) & 1 == 1
        shown = self.leads or periodic.max() < 256  # which axes images depend on
        fits = version == 1 + (self.leads > 0) and shown and not (periodic >> 8 + ndim).any()
        expect(fits, "only a table of version 2 has images", self.leads)
        self.lower, self.width, self.length, self.error, self.upper, self.slack = reals[:36].reshape(6, 6)[:, :ndim]
        self.delta = reals[36]
        expect(bool((self.counts > 0).all() and (self.sides > 0).all()), "there must be cells", self.counts)
        self.blocks, self.problem = -(-self.counts // self.sides), data[96:128].hex()
        number, cells = math.prod(self.blocks.tolist()) * self.starts, math.prod(self.sides.tolist())
        shapes = [(self.leads, inputs, *self.counts[reads].tolist(), 2) for reads in self.reads]
        images = sum(2 * math.prod(shape) for shape in shapes)
        lengths = (words * record, inputs * components * 8, inputs * 2, number * index_width, bodies * at_width)
        parts, at = list[bytes](), HEAD
        for length in (*lengths, body_bytes, images, tests * (2 * ndim + 2)):
            parts.append(data[at : at + length])
            # Each part begins at a multiple of 8 bytes.
            at += -(-length // 8) * 8
        expect(at == size and len(parts[7]) == tests * (2 * ndim + 2), "the parts of the exported table must fit", at)
        self.images = _arrays(parts[6], shapes)
        self.inputs = np.frombuffer(parts[1], "<f8").reshape(inputs, components)
        self.index = _numbers(parts[3], index_width).reshape(self.starts, *self.blocks)
        expect(int(self.index.max()) < bodies, "blocks must have a body", bodies)
        self.bodies = np.stack(
            [_body(parts[5], place, cells, width) for place in _numbers(parts[4], at_width).tolist()]
        )
        expect(int(self.bodies.max()) < words, "cells must have a word", words)
        rows, mask, begin = np.frombuffer(parts[0], np.uint8).reshape(words, record), -(-inputs // 8), 0
        found: dict[str, Array] = {}
        for bit, name in enumerate(FIELDS):
            if fields >> bit & 1:
                long = {"steps": 4, "select": 2}.get(name, mask)
                found[name], begin = rows[:, begin : begin + long], begin + long
        expect(begin == record, "words must have their fields", record)
        self.fields = _fields(found, inputs)
        chosen = self.fields.get("select", np.zeros(1, np.int64))
        fits = self.brake < inputs and bool(((chosen < inputs) | (chosen == NO_INPUT) | (chosen == ARRIVED)).all())
        expect(fits, "inputs of the exported table must be numbers of inputs", self.brake)

    def ids(self, start: int) -> Iterator[tuple[slice, Array]]:
        """Yield of some flat cells at a time, a slice, the numbers of their words at a step < `starts`, (M,) uint32."""
        ndim, row = len(self.counts), int(self.sides[0] * math.prod(self.counts[1:].tolist()))
        order = [place for axis in range(ndim) for place in (axis, ndim + axis)]
        many = max(AT_ONCE // row, 1)
        for first in range(0, int(self.blocks[0]), many):
            index = self.index[start, first : first + many]
            blocks = self.bodies[index].reshape(*index.shape, *self.sides).transpose(order)
            begin, past = first * self.sides[0], min((first + many) * self.sides[0], self.counts[0])
            own = blocks.reshape(np.array(index.shape) * self.sides)[: past - begin]
            # without what blocks have past the last cell of an axis
            own = own[(slice(None), *map(slice, self.counts[1:]))].ravel()
            yield slice(int(begin) * row // int(self.sides[0]), int(past) * row // int(self.sides[0])), own


def _whole(path: str | os.PathLike[str]) -> tuple[int, bytes]:
    """The version and all the bytes of an exported file, whose digests are right."""
    path = Path(path) / "sdhj_table.bin" if Path(path).is_dir() else Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} is not there: exported is the folder of an export, or the sdhj_table.bin in it"
        )
    data = path.read_bytes()
    whole = len(data) >= HEAD and data[:8] == MAGIC
    version = struct.unpack_from("<I", data, 8)[0] if whole else 0
    # Before all else, as another version may lie otherwise; bytes 12 to 15 are the sum itself.
    expect(not whole or version in (1, 2), "the exported table must be of version 1 or 2; export it anew", version)
    whole = whole and zlib.crc32(data[:12] + data[16:]) == struct.unpack_from("<I", data, 12)[0]
    expect(
        whole and hashlib.sha256(data[160:]).digest() == data[128:160],
        "the exported table must be whole, an sdhj_table.bin",
        str(path),
    )
    return version, data


def _arrays(data: bytes, shapes: list[tuple[int, ...]]) -> list[Array]:
    """Arrays of the given shapes, as int, that lie one after the other in bytes, as numbers of 16 signed bits."""
    each = np.split(np.frombuffer(data, "<i2").astype(int), np.cumsum([math.prod(shape) for shape in shapes])[:-1])
    return [own.reshape(shape) for own, shape in zip(each, shapes, strict=True)]


def _fields(found: dict[str, Array], inputs: int) -> dict[str, Array]:
    """The fields of words by name, as `Words` has them; found : the bytes of each, (words, bytes) uint8."""
    return {
        name: _numbers(some.tobytes(), some.shape[1])
        if name in ("steps", "select")
        else np.unpackbits(some, axis=1, count=inputs, bitorder="little").astype(bool)
        for name, some in found.items()
    }


def _numbers(data: bytes, width: int) -> Array:
    """The whole numbers in bytes, each of `width` bytes, the lowest byte first."""
    each = np.frombuffer(data, np.uint8).reshape(-1, width).astype(np.int64)
    return each @ (1 << 8 * np.arange(width))


def _body(data: bytes, at: int, cells: int, width: int) -> Array:
    """The numbers of the words of a block's cells, (cells,) uint32, from its body, which begins at data[at].

    A body is a palette of numbers of words, of `width` bytes each, and for each cell its entry there.
    """
    expect(at + 3 <= len(data), "bodies must be whole", at)
    bits, colours = struct.unpack_from("<BH", data, at)
    begin = at + 3 + colours * width
    end = begin + -(-cells * bits // 8)
    # two bytes more, as `sdhj_entry` reads three of any entry
    expect(1 <= colours <= 1 << bits <= 65536 and end + 2 <= len(data), "bodies must be whole", (at, bits, colours))
    palette = _numbers(data[at + 3 : begin], width)
    packed = np.unpackbits(np.frombuffer(data[begin:end], np.uint8), count=cells * bits, bitorder="little")
    entries = packed.reshape(cells, bits) @ (1 << np.arange(bits))
    expect(int(entries.max(initial=0)) < colours, "entries must be in the palette", colours)
    return palette[entries].astype(np.uint32)


def claims_of_inputs(
    words: Words, ids: Array, fewest: Array, left: int, has_no_target: bool
) -> Iterator[tuple[str, Array, Array]]:
    """Yield each field of inputs that lead on: its name, the inputs of each word, and of each cell the steps to go.

    fewest (cells,) : the steps to go by the table's file, more than `left` where there are none.
    """
    # of an arm, too (`arm.exported`), which knows these fields by their names
    steps = words.fields["steps"][ids] if "steps" in words.fields else fewest
    # 0 leads nowhere: where a cell is in no set, what its file says of its moves may be false
    nearest = np.where(steps > left, 0, left if has_no_target else np.minimum(np.maximum(steps, 1), left))
    for name, some in words.fields.items():
        if name == "select":
            # `NO_INPUT` and `ARRIVED` are numbers of no input, so that they claim none here
            one = some[:, None] == np.arange(len(words.inputs))
            yield name, one, nearest
        elif name == "safe":
            yield name, some, nearest
        elif name == "filter":
            yield name, some, np.where(fewest > left, 0, left)


def claims_of_steps(
    words: Words, ids: Array, fewest: Array, left: int, has_no_target: bool
) -> Iterator[tuple[str, int, Array]]:
    """Yield each field that claims cells to be in a set: its name, how many claims it makes, and where they fail."""
    if "steps" in words.fields:
        steps = words.fields["steps"][ids]
        made = steps != UNPROVED
        # Without a target a cell is in the set of all steps that are left, or in none.
        bad = (steps > left) | ((steps != left) & has_no_target) | (fewest > steps)
        yield "steps", int(made.sum()), np.flatnonzero(made & bad)
    if "select" in words.fields:
        arrived = words.fields["select"][ids] == ARRIVED
        yield "select", int(arrived.sum()), np.flatnonzero(arrived & ((fewest != 0) | has_no_target))


def claims(words: Words, sets: Argument, every: bool, bar: Bar = silently) -> Iterator[Claim]:
    """Yield all claims of an exported table, checked against the table's file; only the first where heads differ.

    every : whether what the file says of cells that are not promised is proved as well.
    """
    starts = 1 if sets.alike else words.steps + 1
    wrong = differences(words, sets, sets.near, starts, len(sets.low) * sets.problem.memory)
    yield Claim("exported: the cells and inputs are the table's", 1, 1, wrong)
    if wrong:
        return
    found = {name: Count() for name in words.fields}
    with np.errstate(all="ignore"):
        for start in bar(range(words.starts), "exported", words.starts):
            for name, one in of_a_start(words, sets, start, every):
                found[name].add(one)
    for name, own in found.items():
        yield own.claim(f"exported: {name}")
    if words.leads:
        made = sum(one[..., 0].size for one in words.images)
        yield Claim("exported: images", made, made, list(images_differ(words, sets)))


def of_a_start(words: Words, sets: Argument, start: int, every: bool) -> Iterator[tuple[str, Count]]:
    """Yield what the words of a step claim, counted, by fields: some of them several times."""
    left, none = words.steps - start, sets.problem.target is None
    fewest = steps_to_go(sets, start, left, none)
    for cells, ids in words.ids(start):
        for name, made, bad in claims_of_steps(words, ids, fewest[cells], left, none):
            yield name, Count(made, made, cells.start + bad, f"start {start}, cell ")
    if "clear" in words.fields:
        yield from (("clear", one) for one in clear_at(words, sets, start, every))
    # By steps to go, as the sums of one set take longest and serve all words that lead into it.
    for ahead in range(left + 1):
        leads = ahead > 0 and left > 0
        after = sets.number(start + 1, ahead - 1) if leads else 0
        all_in = partial(sets.all_in, sets.sums(sets.bits(start + 1, ahead - 1)) if leads else None)
        for cells, ids in words.ids(start):
            numbers = np.r_[cells]
            said = [
                (name, at := np.flatnonzero(steps == ahead), some[ids[at]])
                for name, some, steps in claims_of_inputs(words, ids, fewest[cells], left, none)
            ]
            for j in range(sets.problem.count):
                own = {name: at[some[:, j]] for name, at, some in said}
                # most cells are in several fields, and are asked about once
                bad = np.zeros(len(ids), np.bool_)
                for at in own.values():
                    bad[at] = True
                asked = np.flatnonzero(bad)
                if leads:
                    bad[asked] = ~sets.leads(numbers[asked], np.full(asked.size, after), start, j, all_in)
                for name, at in own.items():
                    wrong = cells.start + at[bad[at]]
                    yield name, Count(at.size, at.size, wrong, f"start {start}, input {j}, cell ")


def clear_at(words: Words, sets: Argument, start: int, every: bool) -> Iterator[Count]:
    """Yield what is claimed of inputs that are clear at a step, some cells at a time."""
    going = start < words.steps
    # Where no step is left, and of cells that nobody promises, clear inputs count as made only if `every`.
    promised = sets.promised(start).ravel() if going and not every else np.broadcast_to(every, sets.counts).reshape(-1)
    for cells, ids in words.ids(start):
        said, at = words.fields["clear"][ids], np.array(np.unravel_index(np.r_[cells], sets.counts))
        clear = np.array([sets.is_clear(start, j, at) for j in range(sets.problem.count)]).T & going
        bad = cells.start + np.flatnonzero((said & ~clear).any(axis=1))
        made = int(said[promised[cells]].sum())
        own = Count(made, made, bad, f"start {start}, cell ")
        own.beside = int(said.sum()) - made
        yield own


def steps_to_go(sets: Any, start: int, left: int, has_no_target: bool) -> Array:
    """The fewest steps to go from each cell at a start, (cells,): left + 1 for none; without a target all or none."""
    out = np.full(math.prod(sets.counts.tolist()), left + 1, np.min_scalar_type(left + 1))
    # Descending, so that the fewest stays.
    for within in [left] if has_no_target else range(left, -1, -1):
        out[sets.bits(start, within)] = within
    return out


def images_differ(words: Words, sets: Argument) -> Iterator[str]:
    """A text for each step, input and axis whose images are not those that the table's file proves."""
    shape = np.where(sets.known, sets.counts, 1)
    for axis, (own, reads) in enumerate(zip(words.images, words.reads, strict=True)):
        for start, j in np.ndindex(own.shape[:2]):
            # As many of them as there are cells of the axes that this one reads, 1 along others.
            said = own[start, j].reshape(*np.where(reads, words.counts, 1), 2)
            proved = [moves[start, j, :, axis].reshape(shape) for moves in (sets.low, sets.high)]
            if not all(bool((said[..., side] == proved[side]).all()) for side in (0, 1)):
                yield f"start {start}, input {j}, axis {axis}"


def differences(words: Words, sets: Any, slack: Any, starts: int, leads: int) -> list[str]:
    """A text "name: mine and not theirs" for each number of an exported table that is not that of the table's file.

    With less slack (ndim,) a state at a wall may be in no layer. starts, leads : steps with words and images of their
    own.
    """
    robot, axes = sets.problem, [*zip(sets.axes, sets.layers, strict=True)]
    safe = (np.array(robot.ends) == "safe") & ~robot.periodic[:, None]
    pairs = {
        "cells": (words.counts.tolist(), sets.counts.tolist()),
        "periodic axes": (words.periodic.tolist(), robot.periodic.tolist()),
        "layers": (words.layers.tolist(), sets.layers),
        "begins": (words.lower.tolist(), [float(low - a * width) for (low, width, *_), (a, _) in axes]),
        "widths": (words.width.tolist(), [float(width) for _, width, *_ in sets.axes]),
        "lengths": (
            words.length.tolist(),
            [float((least + most) / 2 + sum(some) * width) for (_, width, least, most), some in axes],
        ),
        # at both ends of the grid `sdhj.h` clips what is measured, and it tells which of them are safe to leave by
        "upper ends": (words.upper.tolist(), robot.upper.tolist()),
        "safe ends": (words.safe_ends.tolist(), (safe @ [1, 2]).tolist()),
        "inputs": (words.inputs.tolist(), robot.inputs),
        "steps": (words.steps, robot.steps),
        "starts": (words.starts, starts),
        "delta": (float(words.delta), robot.delta),
        "slack": (bool((np.abs(words.slack - slack) <= slack * 1e-12).all()), True),
        "error": (words.error.tolist(), robot.error.tolist()),
        "delay": (0.0, robot.delay),
        "problem": (words.problem, robot.head["digest"]),
        "steps with images of their own": (words.leads, leads),
    }
    return [f"{name}: {mine} and not {theirs}" for name, (mine, theirs) in pairs.items() if mine != theirs]
