"""What an exported table claims beyond what is proved is refused, field by field; and what was written is proved."""

import math
import re
import struct
import zlib
from dataclasses import replace
from functools import cache
from hashlib import sha256

import numpy as np
import pytest
from forged_robots import line, solved
from naive_certified import SMALL
from parameters import but_slow

import sdhj
from sdhj.certified.check import verify
from sdhj.certified.check.argument import Argument
from sdhj.certified.check.arm.claims import Arm
from sdhj.certified.check.arm.exported import claims as claims_of_an_arm
from sdhj.certified.check.reading import head_and_arrays
from sdhj.certified.check.words import UNPROVED, Words, _body, claims
from sdhj.certified.export import FIELDS, images_of, packed_table


@cache
def made(name):
    """A table: of a robot of `forged_robots`, or an arm."""
    if "arm" not in name:
        return solved(name)
    if name == "arm":  # of which sets grow with the steps to go, and the target moves
        problem, method = sdhj.arm_case_study(**(SMALL | {"v_p_max": 0.9})), sdhj.Certified((32, 32, 8, 8), parts=4)
    else:
        problem = replace(sdhj.arm_case_study(nodes=9, steps=1), sensing=sdhj.Sensing(0.01, memory=True))
        method = sdhj.Certified(cells=(42, 42, 12, 12))
    return sdhj.solve(problem, method, play=False, progress=False)


@cache
def exported(name, only=FIELDS, rule="deepest"):
    """The bytes of its export."""
    return packed_table(made(name), only, rule, 0, False)


ARMS = ("arm", "arm that remembers")
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
    made(name).save(folder / "table.npz")
    (folder / "sdhj_table.bin").write_bytes(data)
    try:
        words = Words(folder / "sdhj_table.bin")
        with head_and_arrays(folder / "table.npz") as (head, arrays):
            of, argument = (claims_of_an_arm, Arm) if "arm" in name else (claims, Argument)
            return [claim.name for claim in of(words, argument(head, arrays), True) if claim.failed]
    except ValueError as error:
        return [str(error)]


@pytest.mark.parametrize(
    "name", but_slow(["plane", "forbidden", "noisy", "standing", "tide", "drifting", "one way out", *ARMS], *ARMS)
)
def test_what_is_exported_is_proved(name, tmp_path):
    assert refusals(name, exported(name), tmp_path) == []


@pytest.mark.parametrize("only", [("select",), ("steps", "clear"), ("filter",)], ids="+".join)
@pytest.mark.parametrize("rule", ["deepest", "effort"])
@pytest.mark.slow
def test_some_fields_by_other_rules_are_proved(tmp_path, only, rule):
    assert refusals("plane", exported("plane", only, rule), tmp_path) == []


@pytest.mark.slow
def test_the_verdict_has_the_claims_of_both(tmp_path):
    made("plane").save(tmp_path / "table.npz")
    forged = bytearray(exported("plane"))
    in_words("safe", MORE["safe"])(forged)
    for data in (exported("plane"), signed(forged)):
        (tmp_path / "sdhj_table.bin").write_bytes(data)
        verdict = verify(tmp_path / "table.npz", exported=tmp_path / "sdhj_table.bin", progress=False)
        assert verdict.ok == (data == exported("plane"))
        assert "exported: filter" in str(verdict) and "one step nearer" in str(verdict)


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
        images = b"".join(one.tobytes() for one in images_of(made(name))[2])
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


MORE = {  # what one word claims beyond what it did
    "steps": lambda own: b"\1\0\0\0" if own == b"\xff" * 4 else own,
    "select": lambda own: b"\0\0" if own < b"\xfe\xff" or own == b"\xff\xff" else own,
    "safe": lambda own: bytes([own[0] | 1]) + own[1:],
    "filter": lambda own: bytes([own[0] | 2]) + own[1:],
    "clear": lambda own: bytes([own[0] | 4]) + own[1:],
}
FIT, VERSION, CELLS, PAST = "table must fit", "version 2 has images", "cells and inputs", "bodies must be whole"
FORGED = {  # of which table, what is changed, which claim is not proved or why it is not read
    f"{field} of {name}": (name, in_words(field, MORE[field]), field) for name in ("plane", "arm") for field in FIELDS
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
    "an image of an arm": ("arm that remembers", an_image("arm that remembers", 0, 1), "images"),
    "version 3": ("noisy", put(8, 3), "version 1 or 2"),
    "version 1 with images": ("noisy", put(8, 1), VERSION),
    "version 2 without images": ("plane", put(8, 2), VERSION),
    "no images": ("noisy", put(80, 0), VERSION),
    "images of another step": ("noisy", put(80, 2), FIT),
    "images of fewer axes": ("noisy", put(209, 1), FIT),
    "images of other axes": ("noisy", put(209, 3), FIT),
    "images of no axis": ("noisy", put(209, 4), VERSION),
    "inputs": ("plane", lambda data: turned(begins(data)[1] + 6)(data), CELLS),
    "a body that is cut off": ("plane", first_body(lambda size, most: size - 2), PAST),
    "a body past the end": ("plane", first_body(lambda size, most: size), PAST),
    "a body far past the end": ("plane", first_body(lambda size, most: most), PAST),
}


@pytest.mark.parametrize("name", but_slow(FORGED, *(name for name in FORGED if "arm" in name)))
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
    made("post in the target").save(tmp_path / "table.npz")
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


def test_inputs_of_cells_that_are_not_promised_are_counted(tmp_path):
    made("plane").save(tmp_path / "table.npz")
    (tmp_path / "sdhj_table.bin").write_bytes(exported("plane"))
    words = Words(tmp_path / "sdhj_table.bin")
    with head_and_arrays(tmp_path / "table.npz") as (head, arrays):
        each = [{one.name: one for one in claims(words, Argument(head, arrays), every)} for every in (True, False)]
    whole, some = (one["exported: clear"] for one in each)
    assert 0 < some.made < whole.made == some.made + some.beside and not whole.beside


def test_numbers_of_two_bytes_are_read():
    """Where there are more than 256 words: a palette of three for five cells, by hand."""
    body = struct.pack("<BH3H", 2, 3, 300, 7, 65535) + bytes([0b00_10_01_00, 0b10, 0, 0])
    assert _body(b"before" + body, 6, 5, 2).tolist() == [300, 7, 65535, 300, 65535]


@pytest.mark.slow
def test_damage_is_refused(tmp_path):
    data, rng = exported("plane"), np.random.default_rng(0)
    for at in [*rng.integers(0, len(data), 20).tolist(), 12, len(data) - 1]:
        bad = bytearray(data)
        bad[at] ^= 16
        assert "exported table " in refusals("plane", bytes(bad), tmp_path)[0]
    assert "exported table " in refusals("plane", data[:-8], tmp_path)[0]
