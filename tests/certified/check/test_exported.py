"""What an exported table claims beyond what is proved is refused, field by field; and what was written is proved."""

import math
import re
import struct
import sys
import zlib
from copy import copy
from functools import cache
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pytest
from forged_robots import first_clear, line, solved

import sdhj
from sdhj.certified.check import Claim
from sdhj.certified.check import words as words_module
from sdhj.certified.check.argument import Argument
from sdhj.certified.check.reading import head_and_arrays
from sdhj.certified.check.words import ARRIVED, NO_INPUT, UNPROVED, Words, _body, claims, steps_to_go
from sdhj.certified.export import FIELDS, images_of, packed_table


@cache
def exported(name, only=FIELDS, rule="deepest"):
    """The bytes of its export."""
    return packed_table(solved(name), only, rule, 0, False)


NUMBERS = (  # of a file's beginning
    "size ndim inputs components steps starts fields brake record "
    "words width index_width bodies body_bytes tests at_width leads"
).split()


def number(data, name):
    return struct.unpack_from("<I", data, 16 + 4 * NUMBERS.index(name))[0]


def blocks(data):
    """How many blocks the words of a step have."""
    counts, sides = np.frombuffer(data, "<u4", 12, 160).reshape(2, 6)[:, : number(data, "ndim")].astype(int)
    return math.prod((-(-counts // sides)).tolist())


def begins(data):
    """Where words, inputs, their numbers, places of blocks and places of bodies begin."""
    inputs, starts = number(data, "inputs"), max(number(data, "starts"), 1)
    sizes = number(data, "record") * number(data, "words"), inputs * number(data, "components") * 8, inputs * 2
    sizes = *sizes, blocks(data) * starts * number(data, "index_width")
    return np.cumsum([560, *(-(-size // 8) * 8 for size in sizes)]).tolist()


def signed(data):
    """With a digest and a checksum of its own."""
    data[128:160] = sha256(data[160:]).digest()
    data[12:16] = zlib.crc32(bytes(data[:12] + data[16:])).to_bytes(4, "little")
    return bytes(data)


def refusals(name, data, folder):
    """The claims of an export that are not proved of the table of that name, or why it is not read."""
    solved(name).save(folder / "table.npz")
    (folder / "sdhj_table.bin").write_bytes(data)
    try:
        words = Words(folder / "sdhj_table.bin")
        with head_and_arrays(folder / "table.npz") as (head, arrays):
            return [claim.name for claim in claims(words, Argument(head, arrays), True) if claim.failed]
    except ValueError as error:
        return [str(error)]


@pytest.mark.parametrize(
    "name", ["plane", "forbidden", "noisy", "standing", "tide", "drifting", "one way out", "standing unsafely"]
)
def test_what_is_exported_is_proved(name, tmp_path):
    assert refusals(name, exported(name), tmp_path) == []


# ---- forgeries: what is changed of the bytes


def put(at, value):
    return lambda data: data.__setitem__(at, value)


def turned(at):
    """One bit turned over."""
    return lambda data: data.__setitem__(at, data[at] ^ 1)


def in_words(field, change):
    """A field of every word: change(bytes of it) in its place."""

    def forge(data):
        mask = -(-number(data, "inputs") // 8)
        sizes = dict(zip(FIELDS, (4, 2, mask, mask, mask), strict=True))
        first, size = 560 + sum(sizes[one] for one in FIELDS[: FIELDS.index(field)]), number(data, "record")
        for own in range(first, first + size * number(data, "words"), size):
            data[own : own + sizes[field]] = change(bytes(data[own : own + sizes[field]]))

    return forge


def exchange(data, begin, size, first, second):
    one, other = (slice(begin + at * size, begin + (at + 1) * size) for at in (first, second))
    data[one], data[other] = data[other], data[one]


def two_words(data):
    first, second = np.random.default_rng(0).choice(number(data, "words"), 2, replace=False).tolist()
    exchange(data, 560, number(data, "record"), first, second)


def two_steps(data):
    exchange(data, begins(data)[3], blocks(data) * number(data, "index_width"), 0, 1)


def an_image(name, side, by):
    """One end of an image in the middle is a cell off."""

    def forge(data):
        images = b"".join(one.tobytes() for one in images_of(solved(name))[2])
        at = data.index(images) + 2 * (2 * (len(images) // 8) + side)
        own = int.from_bytes(data[at : at + 2], "little", signed=True) + by
        data[at : at + 2] = own.to_bytes(2, "little", signed=True)

    return forge


def slack(share):
    def forge(data):
        data[496:544] = (share * np.frombuffer(data, "<f8", 6, 496)).tobytes()

    return forge


def as_if_free(data):
    """The words of the robot to whom nothing is forbidden, under the name of the other."""
    digest = data[96:128]
    free = sdhj.solve(line(unsafe=[]), sdhj.Certified(cells=(80,), parts=1), play=False, progress=False)
    data[:] = packed_table(free, FIELDS, "deepest", 0, False)
    data[96:128] = digest


def first_body(place):
    """Where the first body of words begins, said by a function of how many bytes bodies have and of the most."""

    def forge(data):
        begin, width = begins(data)[4], number(data, "at_width")
        assert int.from_bytes(data[begin : begin + width], "little") == 0 < number(data, "bodies")
        said = place(number(data, "body_bytes"), 256**width - 1)
        data[begin : begin + width] = said.to_bytes(width, "little")

    return forge


def other(name, by=None, value=None):
    """A number of the beginning is another."""

    def forge(data):
        own = number(data, name) + by if value is None else value
        at = 16 + 4 * NUMBERS.index(name)
        data[at : at + 4] = own.to_bytes(4, "little")

    return forge


def past(count, part):
    """The first number of a block's body, or of a word in a palette, is the first that there is none of."""

    def forge(data):
        *_, index, places = begins(data)
        bodies = places + -(-number(data, "bodies") * number(data, "at_width") // 8) * 8
        at, width = (index, "index_width") if part == "index" else (bodies + 3, "width")
        data[at : at + number(data, width)] = number(data, count).to_bytes(number(data, width), "little")

    return forge


def longer(data):
    """Eight bytes more, as it says."""
    data.extend(bytes(8))
    other("size", by=8)(data)


MORE = {  # what one word claims beyond what it did
    "steps": lambda own: b"\1\0\0\0" if own == b"\xff" * 4 else own,
    "select": lambda own: b"\0\0" if own < b"\xfe\xff" or own == b"\xff\xff" else own,
    "safe": lambda own: bytes([own[0] | 1]) + own[1:],
    "filter": lambda own: bytes([own[0] | 2]) + own[1:],
    "clear": lambda own: bytes([own[0] | 4]) + own[1:],
}
FIT, VERSION, CELLS, PAST = "table must fit", "version 2 has images", "cells and inputs", "bodies must be whole"
BYTES, INPUTS = "must have its bytes", "must be numbers of inputs"
FORGED = {  # of which table, what is changed, which claim is not proved or why it is not read
    f"{field} of plane": ("plane", in_words(field, MORE[field]), field) for field in FIELDS
}
FORGED |= {f"{field}, forbidden": ("forbidden", as_if_free, field) for field in FIELDS}
FORGED |= {f"image, {end}, {by}": ("noisy", an_image("noisy", end, by), "images") for end in (0, 1) for by in (-1, 1)}
# layers are at both ends of the speed: 6; the slack is how far from a wall a state still counts as at it
FORGED |= {f"layers {flag}": ("standing", put(212, flag), CELLS) for flag in (0, 2, 4, 7)}
FORGED |= {f"slack {share}": ("standing", slack(share), CELLS) for share in (0.0, 0.5, 2.0)}
ELSEWHERE = (208, 232, 262, 310, 358, 406, 454, 550, 502, 96, 32)  # cells, interval, ends, slack, problem, steps
FORGED |= {f"elsewhere, {at}": ("plane", turned(at), f"{CELLS}|exported table") for at in ELSEWHERE}
FORGED |= {
    "to be in the target": ("plane", in_words("select", lambda _: b"\xfe\xff"), "select"),
    "two words": ("plane", two_words, "exported: "),
    "two steps of a tide": ("tide", two_steps, "filter"),
    "two steps while the target moves": ("drifting", two_steps, "safe"),
    "the other way out": ("one way out", put(232, 1), CELLS),
    "version 3": ("noisy", put(8, 3), "version 1 or 2"),
    "version 1 with images": ("noisy", put(8, 1), VERSION),
    "version 2 without images": ("plane", put(8, 2), VERSION),
    "no images": ("noisy", put(80, 0), VERSION),
    "images of another step": ("noisy", put(80, 2), FIT),
    "images of fewer axes": ("noisy", put(209, 1), FIT),
    "images of other axes": ("noisy", put(209, 3), FIT),
    "images of no axis": ("noisy", put(209, 4), VERSION),
    "an axis on which images depend, and no images": ("plane", put(209, 1), VERSION),
    "more layers than one": ("standing", put(212, 14), CELLS),
    "no axes": ("plane", other("ndim", value=0), BYTES),
    "seven axes": ("plane", other("ndim", value=7), BYTES),
    "no input": ("plane", other("inputs", value=0), BYTES),
    "another size": ("plane", other("size", by=8), BYTES),
    "bytes of nothing": ("plane", longer, FIT),
    "no cells": ("plane", put(160, 0), "must be cells"),
    "blocks of no cells": ("plane", put(188, 0), "must be cells"),
    "a block of no body": ("plane", past("bodies", "index"), "must have a body"),
    "a cell of no word": ("plane", past("words", "bodies"), "must have a word"),
    "words of a field less": ("plane", other("fields", value=15), "must have their fields"),
    "an input to brake that is none": ("plane", other("brake", value=4), INPUTS),
    "an input that is none": ("plane", in_words("select", lambda own: b"\4\0" if own < b"\xfe\xff" else own), INPUTS),
    "inputs": ("plane", lambda data: turned(begins(data)[1] + 6)(data), CELLS),
    "a body that is cut off": ("plane", first_body(lambda size, most: size - 2), PAST),
    "a body past the end": ("plane", first_body(lambda size, most: size), PAST),
    "a body far past the end": ("plane", first_body(lambda size, most: most), PAST),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_export_is_refused(name, tmp_path):
    table, forge, said = FORGED[name]
    data = bytearray(exported(table))
    forge(data)
    assert data != exported(table)
    found = refusals(table, signed(data), tmp_path)
    assert any(re.search(said, one) for one in found), found


@pytest.mark.parametrize("field", ["select", "safe", "filter"])
def test_an_input_of_a_cell_in_no_set_is_refused(tmp_path, field):
    """Whatever the table's file says of it: nobody looks at what is not promised, and here all inputs are clear.

    From the post that is in the target all lead into it.
    """
    solved("post in the target").save(tmp_path / "table.npz")
    (tmp_path / "sdhj_table.bin").write_bytes(exported("post in the target"))
    words = Words(tmp_path / "sdhj_table.bin")
    unproved = words.fields["steps"] == UNPROVED
    if field == "select":
        words.fields[field] = np.where(unproved, 0, words.fields[field])
    else:
        words.fields[field] = words.fields[field] | unproved[:, None]
    cells = sum(int(unproved[ids].sum()) for _, ids in words.ids(0))
    with head_and_arrays(tmp_path / "table.npz") as (head, arrays):
        sets = Argument(head, arrays)
        sets.clear = [one._replace(bits=np.full_like(one.bits, 255)) for one in sets.clear]
        (claim,) = (one for one in claims(words, sets, False) if one.name == f"exported: {field}")
    assert claim.failed == cells * (1 if field == "select" else len(words.inputs)) > 0


def cell_by_cell(name, words):
    """How many claims words make of cells that are promised, and of others, and what is false: by fields, in loops."""
    table, found = solved(name), {field: [0, 0, []] for field in FIELDS}
    with TemporaryDirectory() as folder:
        table.save(path := Path(folder) / "table.npz")
        with head_and_arrays(path) as (head, arrays):
            low, high, clear = (arrays.array(one).copy() for one in ("low", "high", "clear"))
            arrives = arrays.array("arrives").copy() if head["proof"].get("arrives") else None
    own, counts = np.flatnonzero(head["proof"]["own"]), np.array(head["cells"]["shape"])
    clear, none = first_clear(head, clear), all(one["kind"] != "target" for one in head["sets"])
    (one,), ends = head["proof"]["clear"], np.array(head["grid"]["ends"])

    def number_of(cell, axes):
        return int(np.ravel_multi_index([cell[k] for k in axes], [counts[k] for k in axes])) if len(axes) else 0

    def marked(bits, step, at, j):
        return bool(bits[min(step, len(bits) - 1), at, j // 8] >> j % 8 & 1)

    def is_clear(step, cell, j):
        return marked(clear, step, number_of(cell, one["axes"]), j)

    def leads(step, cell, j, within):
        moves = [each[min(step, len(each) - 1), j, number_of(cell, own)] for each in (low, high)]
        first, last = (cell + each for each in moves)
        if ((last + 1 < 0) & (ends[:, 0] == "safe") | (first > counts) & (ends[:, 1] == "safe")).any():
            return is_clear(step, cell, j)
        first, last = (np.clip(each, 0, counts - 1) for each in (first, last))
        image = table.bits(start=step + 1, within=within)[tuple(map(slice, first, last + 1))]
        arrived = arrives is not None and marked(arrives, step, number_of(cell, range(len(counts))), j)
        return is_clear(step, cell, j) and (image.all() or arrived)

    for step in range(words.starts):
        left = words.steps - step
        within = [left] if none else range(left + 1)
        tubes = [(n, table.bits(start=step, within=n)) for n in within]
        promised = table.bits(start=step, within=1 if none else left) if left else np.zeros(counts, bool)
        ids = np.concatenate([ids for _, ids in words.ids(step)])
        for at, cell in enumerate(np.ndindex(*counts)):
            said, where = {field: words.fields[field][ids[at]] for field in FIELDS}, f"cell {at}"
            fewest, steps = next((n for n, tube in tubes if tube[cell]), left + 1), said["steps"]
            if steps != UNPROVED:
                found["steps"][0] += 1
                if fewest > steps or steps > left or (none and steps != left):
                    found["steps"][2].append(f"start {step}, {where}")
            if said["select"] == ARRIVED:
                found["select"][0] += 1
                if none or fewest:
                    found["select"][2].append(f"start {step}, {where}")
            nearest = 0 if steps > left else left if none else min(max(steps, 1), left)
            inputs = {"safe": said["safe"], "select": np.arange(len(words.inputs)) == said["select"]}
            for field, some in (inputs | {"filter": said["filter"]}).items():
                ahead = nearest if field != "filter" else left if fewest <= left else 0
                for j in np.flatnonzero(some).tolist():
                    found[field][0] += 1
                    if not (ahead and left and leads(step, cell, j, ahead - 1)):
                        found[field][2].append(f"start {step}, input {j}, {where}")
            found["clear"][not promised[cell]] += int(said["clear"].sum())
            if any(not left or not is_clear(step, cell, j) for j in np.flatnonzero(said["clear"]).tolist()):
                found["clear"][2].append(f"start {step}, {where}")
    return found


@pytest.mark.parametrize("name", ["tide", "drifting", "out to the left", "line"])
def test_what_words_claim_is_counted_and_refused_as_cell_by_cell(name, tmp_path, rng, monkeypatch):
    """Where each cell of each step has a word of its own, which is another than it was by chance."""
    monkeypatch.setattr(sys.modules[Claim.__module__], "SHOWN", 10**6)
    monkeypatch.setattr(words_module, "AT_ONCE", 1)  # few rows of blocks are looked at at once
    (tmp_path / "sdhj_table.bin").write_bytes(exported(name))
    words = Words(tmp_path)
    ids, many, inputs = words.bodies[words.index].ravel(), words.bodies[words.index].size, len(words.inputs)
    words.bodies = np.arange(many, dtype=np.uint32).reshape(-1, words.bodies.shape[1])
    words.index = np.arange(len(words.bodies)).reshape(words.index.shape)
    others = {
        "steps": rng.choice([*range(words.steps + 2), UNPROVED], many),
        "select": rng.choice([*range(inputs), ARRIVED, NO_INPUT], many),
        **{field: rng.random((many, inputs)) < 0.5 for field in ("safe", "filter", "clear")},
    }
    for field, values in others.items():
        some = rng.random((many, *[1] * (values.ndim - 1))) < 0.3
        words.fields[field] = np.where(some, values, words.fields[field][ids])
    solved(name).save(tmp_path / "table.npz")
    with head_and_arrays(tmp_path / "table.npz") as (head, arrays):
        sets = Argument(head, arrays)
    expected = cell_by_cell(name, words)
    for every in (False, True):
        (cells, *found) = claims(words, sets, every)
        assert not cells.failed and [one.name for one in found] == [f"exported: {field}" for field in FIELDS]
        for one, (count, beside, wrong) in zip(found, expected.values(), strict=True):
            count, beside = (count + beside, 0) if every else (count, beside)
            assert (one.made, one.checked, one.beside, one.failed) == (count, count, beside, len(wrong)), one.name
            assert wrong and sorted(one.failures) == sorted(wrong)


OTHERS = {  # of an export, by the name of what is compared: an attribute and what it is instead
    **{
        name: (name, lambda own: own + 1) for name in ("layers", "steps", "starts", "delta", "error", "slack", "inputs")
    },
    "cells": ("counts", lambda own: own[::-1]),
    "periodic axes": ("periodic", np.logical_not),
    "begins": ("lower", lambda own: np.nextafter(own, 9.0)),
    "widths": ("width", lambda own: np.nextafter(own, 9.0)),
    "lengths": ("length", lambda own: np.nextafter(own, 9.0)),
    "upper ends": ("upper", lambda own: np.nextafter(own, 9.0)),
    "safe ends": ("safe_ends", lambda own: own + np.array([0, 2])),
    "problem": ("problem", lambda own: own[::-1]),
    "steps with images of their own": ("leads", lambda own: 0),
}


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    """The words of an export with images, and the sets that it was made of."""
    folder = tmp_path_factory.mktemp("noisy")
    (folder / "sdhj_table.bin").write_bytes(exported("noisy"))
    solved("noisy").save(folder / "table.npz")
    with head_and_arrays(folder / "table.npz") as (head, arrays):
        sets = Argument(head, arrays)
    return Words(folder), sets


@pytest.mark.parametrize("name", [*OTHERS, "delay"])
def test_an_export_of_another_robot_is_told_apart_and_asked_nothing_else(name, noisy):
    words, sets = map(copy, noisy)
    if name == "delay":
        sets.problem = copy(sets.problem)
        sets.problem.delay = 0.01
    else:
        attribute, change = OTHERS[name]
        setattr(words, attribute, change(getattr(words, attribute)))
    (claim,) = claims(words, sets, True)
    assert (claim.made, claim.checked, claim.failed) == (1, 1, 1) and claim.failures[0].startswith(f"{name}: ")


def test_images_are_counted_and_told_by_step_input_and_axis(noisy):
    words, sets = map(copy, noisy)
    words.images = [own.copy() for own in words.images]
    words.images[1][0, 2, ..., 0, 1] += 1
    *_, claim = claims(words, sets, True)
    cells = [math.prod(own.shape[2:-1]) for own in words.images]
    assert claim == Claim("exported: images", 3 * sum(cells), 3 * sum(cells), ["start 0, input 2, axis 1"])


def test_of_many_steps_to_go_each_is_told():
    sets = SimpleNamespace(counts=np.array([4]), bits=lambda start, within: within >= np.array([0, 299, 300, 301]))
    assert steps_to_go(sets, 0, 300, False).tolist() == [0, 299, 300, 301]


def test_fields_are_proved_without_those_that_are_not_exported(tmp_path):
    assert refusals("line", exported("line", ("select", "filter"), "effort"), tmp_path) == []


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_numbers_of_words_have_as_many_bytes_as_they_need(width):
    """A palette of three for five cells, by hand."""
    numbers = [256**width - 1, 7, 256 ** (width - 1) + 1]
    palette = b"".join(one.to_bytes(width, "little") for one in numbers)
    body = struct.pack("<BH", 2, 3) + palette + bytes([0b00_10_01_00, 0b10, 0, 0])
    expected = [numbers[at] for at in (0, 1, 2, 0, 2)]
    assert _body(b"before" + body, 6, 5, width).tolist() == expected


BODIES = {  # bits of an entry, colours, the palette and entries of five cells
    "no colours": (2, 0, bytes(4)),
    "more colours than entries tell apart": (1, 3, bytes(6)),
    "entries of 17 bits": (17, 1, bytes(14)),
    "an entry that is in no palette": (2, 3, bytes([1, 2, 3, 0b11, 0, 0, 0])),
    "a byte less": (2, 3, bytes([1, 2, 3, 0, 0, 0])),
    "no number of colours": (2, None, b""),
}


@pytest.mark.parametrize("name", BODIES)
def test_what_is_no_body_is_refused(name):
    bits, colours, rest = BODIES[name]
    body = bytes([bits]) + (b"\0" if colours is None else struct.pack("<H", colours)) + rest
    assert _body(bytes([2, 3, 0, 1, 2, 3, 0, 0, 0, 0]), 0, 5, 1).tolist() == [1] * 5
    with pytest.raises(ValueError, match="palette" if "no palette" in name else PAST):
        _body(body, 0, 5, 1)


@pytest.mark.parametrize("many", [1, 1 << 20])
@pytest.mark.parametrize("name", ["standing", "tide"])
def test_words_of_cells_are_found_cell_by_cell(name, many, tmp_path, monkeypatch):
    """Also where few rows of blocks are looked at at once."""
    (tmp_path / "sdhj_table.bin").write_bytes(exported(name))
    words = Words(tmp_path)
    monkeypatch.setattr(words_module, "AT_ONCE", many)
    for start in {0, words.starts - 1}:
        slices, found = zip(*words.ids(start), strict=True)
        assert [*np.r_[slices]] == [*range(math.prod(words.counts))] if len(slices) > 1 else slices[0].start == 0
        assert len(slices) == (1 if many > 1 else words.blocks[0])
        expected = []
        for cell in np.ndindex(*words.counts):
            block, own = zip(*map(divmod, cell, words.sides.tolist()), strict=True)
            inner = int(np.ravel_multi_index(own, words.sides))
            expected.append(words.bodies[words.index[(start, *block)], inner])
        assert np.concatenate(found).tolist() == expected


def test_damage_is_refused(tmp_path):
    path, rng = tmp_path / "sdhj_table.bin", np.random.default_rng(0)
    data = bytes(exported("plane"))
    changed = [*rng.integers(16, len(data), 20).tolist(), 0, 12, 128, 159, 160, len(data) - 1]
    spoiled = [data[:at] + bytes([data[at] ^ 16]) + data[at + 1 :] for at in changed]
    spoiled += [data[:-8], data[:559], data[:12], b"", b"sdhjcell"]
    for at in (100, 300):  # with one of the two sums right
        for wrong in (12, 128):
            own = bytearray(data)
            own[at] ^= 1
            own = bytearray(signed(own))
            own[wrong] ^= 1
            if wrong == 128:
                own[12:16] = zlib.crc32(bytes(own[:12] + own[16:])).to_bytes(4, "little")
            spoiled.append(bytes(own))
    spoiled.append(signed(bytearray(b"sdhjcelk" + data[8:])))
    for bad in spoiled:
        path.write_bytes(bad)
        with pytest.raises(ValueError, match="must be whole"):
            Words(path)
