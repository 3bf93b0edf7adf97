"""What an exported table claims beyond what is proved is refused, field by field; and what was written is proved."""

import math
import struct
import zlib
from dataclasses import replace
from functools import cache
from hashlib import sha256

import forged_robots
import numpy as np
import pytest
import test_memory
import zoo

import sdhj
from sdhj.certified.check import verify
from sdhj.certified.check.argument import Argument
from sdhj.certified.check.arm.claims import Arm
from sdhj.certified.check.arm.exported import claims as claims_of_an_arm
from sdhj.certified.check.reading import head_and_arrays
from sdhj.certified.check.words import UNPROVED, Words, claims
from sdhj.certified.export import FIELDS, images_of, packed_table


@cache
def robot():
    return sdhj.solve(zoo.unicycle_problem(), sdhj.Certified(cells=(20, 20, 24), parts=3), play=False, progress=False)


@cache
def joint():
    """One that remembers, so that its file has images."""
    table = sdhj.solve(test_memory.joint(0.02), sdhj.Certified(cells=(60, 60), parts=4), play=False, progress=False)
    assert table.fraction() > 0.5
    return table


@cache
def remembered():
    """A cart that remembers, with layers at the walls of its speed."""
    return forged_robots.solved("noisy")


@cache
def remembering_arm():
    problem = replace(sdhj.arm_case_study(nodes=9, steps=1), sensing=sdhj.Sensing(0.01, memory=True))
    return sdhj.solve(problem, sdhj.Certified(cells=(42, 42, 12, 12)), play=False, progress=False)


@cache
def arm():
    problem = sdhj.arm_case_study(nodes=9, steps=1)
    return sdhj.solve(problem, sdhj.Certified(cells=(42, 42, 12, 12)), play=False, progress=False)


def exported_of(table):
    if id(table) not in KEPT:
        KEPT[id(table)] = packed_table(table, FIELDS, "deepest", 0, False)
    return KEPT[id(table)]


KEPT = {}


def words_of(data):
    """Where the words of a file are: begin, bytes of one, how many."""
    return 560, int.from_bytes(data[48:52], "little"), int.from_bytes(data[52:56], "little")


def signed(data):
    """With a digest and a checksum of its own."""
    data[128:160] = sha256(data[160:]).digest()
    data[12:16] = zlib.crc32(bytes(data[:12] + data[16:])).to_bytes(4, "little")
    return bytes(data)


def failed(table, data, folder):
    """The claims of an exported table that are not proved of its table."""
    table.save(folder / "table.npz")
    (folder / "sdhj_table.bin").write_bytes(data)
    words = Words(folder / "sdhj_table.bin")
    with head_and_arrays(folder / "table.npz") as (head, arrays):
        if table.proof.kind == "arm":
            return {claim.name for claim in claims_of_an_arm(words, Arm(head, arrays), True) if claim.failed}
        return {claim.name for claim in claims(words, Argument(head, arrays), True) if claim.failed}


@pytest.mark.slow
def test_the_verdict_has_the_claims_of_both(tmp_path):
    robot().save(tmp_path / "table.npz")
    for forged_one in (False, True):
        data = forged(robot(), "safe", FORGERIES["safe"]) if forged_one else exported_of(robot())
        (tmp_path / "sdhj_table.bin").write_bytes(data)
        verdict = verify(tmp_path / "table.npz", exported=tmp_path / "sdhj_table.bin", progress=False)
        assert verdict.ok != forged_one and "exported: filter" in str(verdict) and "one step nearer" in str(verdict)


@pytest.mark.parametrize("only", [FIELDS, ("select",), ("steps", "clear"), ("filter",)], ids="+".join)
@pytest.mark.parametrize("rule", ["deepest", "effort"])
@pytest.mark.slow
def test_what_is_exported_is_proved(tmp_path, only, rule):
    assert failed(robot(), packed_table(robot(), only, rule, 0, False), tmp_path) == set()


def forged(table, field, change):
    """The file in which one word of each that has the field claims more; change(bytes of it, word) in place."""
    data = bytearray(exported_of(table))
    mask = -(-len(table.problem.inputs) // 8)
    sizes = dict(zip(FIELDS, (4, 2, mask, mask, mask), strict=True))
    at = sum(sizes[one] for one in FIELDS[: FIELDS.index(field)])
    begin, size, count = words_of(data)
    for word in range(count):
        own = begin + word * size + at
        data[own : own + sizes[field]] = change(bytes(data[own : own + sizes[field]]))
    return signed(data)


FORGERIES = {
    "steps": lambda own: b"\1\0\0\0" if own == b"\xff" * 4 else own,
    "select": lambda own: b"\0\0" if own < b"\xfe\xff" or own == b"\xff\xff" else own,
    "safe": lambda own: bytes([own[0] | 1]) + own[1:],
    "filter": lambda own: bytes([own[0] | 2]) + own[1:],
    "clear": lambda own: bytes([own[0] | 4]) + own[1:],
}


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("table", [robot, pytest.param(arm, marks=pytest.mark.slow)], ids=["robot", "arm"])
def test_a_word_that_claims_more_is_refused(tmp_path, table, field):
    assert f"exported: {field}" in failed(table(), forged(table(), field, FORGERIES[field]), tmp_path)


@pytest.mark.parametrize("field", ["select", "safe", "filter"])
def test_an_input_of_a_cell_in_no_set_is_refused(tmp_path, field):
    """Whatever the table's file says of it: nobody looks at what is not promised, and here all inputs are clear."""
    robot().save(tmp_path / "table.npz")
    (tmp_path / "sdhj_table.bin").write_bytes(exported_of(robot()))
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


def test_a_word_that_says_to_be_in_the_target_is_refused(tmp_path):
    data = forged(robot(), "select", lambda _: b"\xfe\xff")  # in place of every input, too
    assert failed(robot(), data, tmp_path) == {"exported: select"}


@pytest.mark.parametrize("field", FIELDS)
def test_inputs_that_are_forbidden_somewhere(tmp_path, field):
    """What is exported is proved; the words of the robot to whom nothing is forbidden are refused under its name."""
    table = forged_robots.solved("forbidden")
    free = sdhj.solve(forged_robots.line(unsafe=[]), sdhj.Certified(cells=(80,), parts=1), play=False, progress=False)
    assert failed(table, packed_table(table, (field,), "deepest", 0, False), tmp_path) == set()
    data = bytearray(packed_table(free, (field,), "deepest", 0, False))
    data[96:128] = packed_table(table, (field,), "deepest", 0, False)[96:128]  # the digest of the problem
    assert failed(table, signed(data), tmp_path) == {f"exported: {field}"}


@pytest.mark.parametrize("name", ["tide", "drifting"])
def test_words_are_those_of_their_step(tmp_path, name):
    """Where something moves: what is exported is proved, and refused where the words of two steps change places."""
    table = forged_robots.solved(name)
    data = bytearray(packed_table(table, FIELDS, "deepest", 0, False))
    assert failed(table, bytes(data), tmp_path) == set()
    record, words, _, width = struct.unpack_from("<4I", data, 16 + 32)
    inputs, components = struct.unpack_from("<2I", data, 16 + 8)
    begin = 560 + sum(-(-size // 8) * 8 for size in (words * record, inputs * components * 8, inputs * 2))
    blocks = math.prod(Words(tmp_path / "sdhj_table.bin").blocks.tolist()) * width
    first, second = (slice(begin + step * blocks, begin + (step + 1) * blocks) for step in (0, 1))
    data[first], data[second] = data[second], data[first]
    assert failed(table, signed(data), tmp_path) >= {"exported: safe", "exported: filter"}


@pytest.mark.slow
def test_what_is_exported_of_an_arm_is_proved(tmp_path):
    assert failed(arm(), exported_of(arm()), tmp_path) == set()


def test_two_words_that_change_places_are_refused(tmp_path):
    data = bytearray(exported_of(robot()))
    begin, size, count = words_of(data)
    rng = np.random.default_rng(0)
    first, second = rng.choice(count, 2, replace=False).tolist()
    one, other = (slice(begin + word * size, begin + word * size + size) for word in (first, second))
    data[one], data[other] = data[other], data[one]
    assert failed(robot(), signed(data), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("table", [joint, pytest.param(remembering_arm, marks=pytest.mark.slow)])
def test_images_are_what_is_proved_and_nothing_else(tmp_path, table):
    """A cell short the state may be elsewhere; a cell more, and it is led to where nothing is proved."""
    data, rng = exported_of(table()), np.random.default_rng(0)
    assert not failed(table(), data, tmp_path)
    images = b"".join(one.tobytes() for one in images_of(table())[2])
    begin = data.index(images)
    for _ in range(6):
        bad, at = bytearray(data), begin + 2 * int(rng.integers(0, len(images) // 2))
        own = int.from_bytes(bad[at : at + 2], "little", signed=True) + int(rng.choice([-1, 1]))
        bad[at : at + 2] = own.to_bytes(2, "little", signed=True)
        assert failed(table(), signed(bad), tmp_path) == {"exported: images"}


@pytest.mark.parametrize("by", [-1, 1])
@pytest.mark.parametrize("side", [0, 1])
def test_an_image_a_cell_off_at_one_end_is_refused(tmp_path, side, by):
    table = remembered()
    data = bytearray(packed_table(table, ("select",), "deepest", 0, False))
    assert not failed(table, bytes(data), tmp_path)
    images = b"".join(one.tobytes() for one in images_of(table)[2])
    at = data.index(images) + 2 * (2 * (len(images) // 8) + side)  # of a pair in the middle
    own = int.from_bytes(data[at : at + 2], "little", signed=True) + by
    data[at : at + 2] = own.to_bytes(2, "little", signed=True)
    assert failed(table, signed(data), tmp_path) == {"exported: images"}


def test_a_file_of_another_version_or_with_images_of_another_shape_is_refused(tmp_path):
    data = exported_of(joint())
    assert data[8] == 2 and exported_of(robot())[8] == 1
    for at, value, sentence in (
        (8, 3, "version 1 or 2"),
        (8, 1, "version 2 has images"),
        (80, 0, "version 2 has images"),
        (80, 2, "exported table must fit"),
        (209, 1, "exported table must fit"),  # layers are cells: 62 of the speed, 60 of the angle
        (209, 3, "exported table must fit"),
        (209, 4, "version 2 has images"),
    ):
        bad = bytearray(data)
        bad[at] = value
        with pytest.raises(ValueError, match=sentence):
            failed(joint(), signed(bad), tmp_path)
    bad = bytearray(exported_of(robot()))
    bad[8] = 2
    with pytest.raises(ValueError, match="version 2 has images"):
        failed(robot(), signed(bad), tmp_path)


def test_layers_are_those_of_the_table(tmp_path):
    """A file that says that a cell of no width is one like any other, or the other way round."""
    table = forged_robots.solved("standing")
    assert not failed(table, exported_of(table), tmp_path)
    for flag in (0, 2, 4, 7):
        data = bytearray(exported_of(table))
        assert data[212:216] == bytes([6, 0, 0, 0])  # of the speed: both ends
        data[212] = flag
        assert any("cells and inputs" in said for said in failed(table, signed(data), tmp_path))


@pytest.mark.parametrize("share", [0.0, 0.5, 2.0])
def test_the_slack_is_that_of_the_proof(tmp_path, share):
    """With none a state at a wall is in no layer, from which alone it may be proved to stay there."""
    table = forged_robots.solved("standing")
    data = bytearray(exported_of(table))
    data[496:544] = (share * np.frombuffer(data, "<f8", 6, 496)).tobytes()
    assert any("cells and inputs" in said for said in failed(table, signed(data), tmp_path))


@pytest.mark.slow
def test_cells_claimed_elsewhere_are_refused(tmp_path):
    """Cells that begin elsewhere, or are wider; inputs, steps, interval and ends of another robot."""
    data = exported_of(robot())
    _, size, count = words_of(data)
    inputs = 560 + -(-size * count // 8) * 8
    for at in (208, 232, 256, 304, 352, 400, 448, 544, 496, 96, inputs, 32):
        bad = bytearray(data)
        bad[at + 6 if at > 250 else at] ^= 1
        try:
            (said,) = failed(robot(), signed(bad), tmp_path)
            assert "cells and inputs" in said, at
        except ValueError as error:
            assert "exported table" in str(error)


@pytest.mark.slow
def test_damage_is_refused(tmp_path):
    data, rng = exported_of(robot()), np.random.default_rng(0)
    for at in [*rng.integers(0, len(data), 20).tolist(), 12, len(data) - 1]:
        bad = bytearray(data)
        bad[at] ^= 16
        with pytest.raises(ValueError, match="exported table "):
            failed(robot(), bytes(bad), tmp_path)
    with pytest.raises(ValueError, match="exported table "):
        failed(robot(), data[:-8], tmp_path)


def test_a_body_that_begins_past_the_last_is_refused(tmp_path):
    data = bytearray(exported_of(robot()))
    record, words, _, index_width, bodies, body_bytes, _, at_width, _ = struct.unpack_from("<9I", data, 16 + 32)
    inputs, components = struct.unpack_from("<2I", data, 16 + 8)
    counts, sides = np.frombuffer(data, "<u4", 12, 160).reshape(2, 6)[:, :3].astype(int)
    sizes = words * record, inputs * components * 8, inputs * 2, math.prod(-(-counts // sides)) * index_width
    begin = 560 + sum(-(-size // 8) * 8 for size in sizes)
    assert int.from_bytes(data[begin : begin + at_width], "little") == 0 < bodies  # where the first body begins
    for at in (body_bytes - 2, body_bytes, 256**at_width - 1):
        data[begin : begin + at_width] = at.to_bytes(at_width, "little")
        with pytest.raises(ValueError, match="bodies must be whole"):
            failed(robot(), signed(data), tmp_path)
