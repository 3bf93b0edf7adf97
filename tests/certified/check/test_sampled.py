"""The look at its own claims with which a solve ends: at all of few, at a sample of many; what is false is no table."""

import itertools
import re
from dataclasses import replace
from types import SimpleNamespace

import naive_certified as naive
import numpy as np
import pytest
from forged_robots import cart, file_of, solved

import sdhj
from sdhj.certified.check import sampled
from sdhj.certified.check.argument import Argument, marked
from sdhj.certified.check.arm import claims, drawn
from sdhj.certified.check.arm.claims import Arm, cells_added
from sdhj.certified.check.claims import ARRIVE, CLEAR, GOALS, MOVES, NEARER, Claim
from sdhj.certified.check.reading import head_and_arrays
from sdhj.certified.general_proof import GeneralProof

MANY = ("line", "drifting", "ring", "standing", "stream", "tide", "spread and remembered", "endless")


@pytest.fixture
def few(monkeypatch):
    """So few claims are looked at that it is a sample of any robot's."""
    monkeypatch.setattr(sampled, "MOST_WHOLE", 0)
    monkeypatch.setattr(sampled, "SAMPLED", 600)


def test_few_claims_are_all_looked_at():
    table = solved("line")
    verdict, every = table.verify(progress=False), table.verify(everywhere=True, progress=False)
    assert verdict.ok and every.ok and sum(one.made for one in every.claims) > sum(one.made for one in verdict.claims)
    assert any(0 < one.checked < one.made for one in table.verify(samples=5, progress=False).claims)
    assert table.details["checked"] == [sum(claim.made for claim in verdict.claims)] * 2
    assert f"{table.details['checked'][0]:,} claims checked" in repr(table)


@pytest.mark.parametrize("name", MANY)
def test_of_many_a_sample_is_looked_at_and_counted(name, few):
    table = solved(name)
    looked, made = table.looked_over()
    assert 0 < looked <= made == sum(claim.made for claim in table.verify(progress=False).claims)


def test_claims_are_counted_where_later_steps_promise_more(tmp_path):
    told, arrays = parts_of("crossed", tmp_path)
    arrays["index"][:4] = arrays["index"][9]
    sets = Argument(told, sampled.InMemory(arrays))
    assert sets.promised(0).sum() < sets.promised(None).sum()
    assert sampled.claims_made(sets) == sum(claim.made for claim in sets.claims())


@pytest.mark.parametrize("name", ["crossed", "standing", "tide", "out to the left", "spread"])
def test_every_input_step_seam_wall_and_end_is_among_them(name, few, monkeypatch, tmp_path):
    solved(name).save(tmp_path / "table.npz")
    with head_and_arrays(tmp_path / "table.npz") as (told, arrays):
        sets = Argument(told, arrays)
    asked, drawn, counts = [], {}, []
    whole_look, whole_draw = sampled.of_an_input, sampled.some_cells

    def look(sets, step, j, numbers):
        asked.append((step, j))
        count, wrong = whole_look(sets, step, j, numbers)
        counts.append(count)
        cells, said = np.array(np.unravel_index(numbers, sets.counts)), [(one.own, one.bits) for one in sets.clear]
        said += [(sets.sites > 0, sets.arrives)] * (len(sets.arrives) > 0)
        each = [marked(bits, step, j, np.unique(sets.strides_of(axes) @ cells)).sum() for axes, bits in said]
        assert count == len({*(sets.strides @ cells).tolist()}) + sum(each)
        return count, wrong

    def draw(sets, step, within, *given):
        drawn[step, within] = whole_draw(sets, step, within, *given)
        return drawn[step, within]

    monkeypatch.setattr(sampled, "ROWS", 2)
    monkeypatch.setattr(sampled, "of_an_input", look)
    monkeypatch.setattr(sampled, "some_cells", draw)
    arrays = {one: arrays.array(one) for one in arrays.stated}
    looked, _, wrong = sampled.looked_over(told, arrays, None)
    whole = len(sets.counts) + len(sets.pairs) + sets.problem.count * (name == "spread")
    assert not wrong and looked == whole + sum(counts) + sum(map(len, drawn.values()))
    promised = {step for step, within in sets.pairs if within and sets.promised(step).any()}
    assert {j for _, j in asked} == {*range(sets.problem.count)} and {step for step, _ in asked} == promised
    assert drawn.keys() == {*sets.pairs}
    for pair, cells in drawn.items():
        new = sets.bits(*pair)
        if pair[1] and sets.problem.target is not None:
            new = new & ~sets.bits(pair[0], pair[1] - 1)
        assert new[cells].all() and len({*cells.tolist()}) == cells.size and (cells.size > 0) == new.any()
        every, own = (np.array(np.unravel_index(one, sets.counts)) for one in (np.flatnonzero(new), cells))
        for k, end in itertools.product(range(len(sets.counts)), (0, 1)):
            there = end * (sets.counts[k] - 1)
            assert (own[k] == there).any() == (every[k] == there).any(), (pair, k, end)


@pytest.mark.parametrize(
    ("name", "step", "within"), [("standing", 0, 20), ("cart", 0, 3), ("plane", 0, 3), ("ring", 0, 2)]
)
def test_half_of_a_sample_is_at_the_rim_of_its_set(name, step, within, tmp_path, rng, most=60):
    """Of what the set of a step less has not; beside an end there is no rim, and beside a seam what is behind it."""
    told, arrays = parts_of(name, tmp_path)
    sets = Argument(told, sampled.InMemory(arrays))
    inside = sets.bits(step, within).reshape(sets.counts)
    new = inside & ~sets.bits(step, within - 1).reshape(sets.counts) if sets.problem.target is not None else inside
    rim = np.zeros_like(new)
    for k, closes in enumerate(sets.problem.periodic):
        for way in (-1, 1):
            beside = np.roll(inside, way, axis=k)
            if not closes:
                end = np.arange(sets.counts[k]) == (0 if way > 0 else sets.counts[k] - 1)
                beside |= end.reshape([-1 if axis == k else 1 for axis in range(new.ndim)])
            rim |= new & ~beside
    found = sampled.some_cells(sets, step, within, most, np.any(sets.pool, axis=1), rng)
    at_rim = rim.ravel()[found]
    assert len({*found.tolist()}) == found.size <= most and new.ravel()[found].all()
    assert at_rim.sum() >= min(rim.sum(), most // 2) and (~at_rim).sum() >= min((new & ~rim).sum(), most // 4)


def parts_of(name, folder):
    """What the file of a robot's table tells, and its arrays."""
    (folder / "table.npz").write_bytes(file_of(name))
    with head_and_arrays(folder / "table.npz") as (told, arrays):
        return told, {one: arrays.array(one).copy() for one in arrays.stated}


def changed(name, folder, **changes):
    """What a look says of the table of a robot in which arrays are other than they were, and its `Argument`."""
    told, arrays = parts_of(name, folder)
    for one, change in changes.items():
        change(arrays[one])
    return sampled.looked_over(told, arrays, None)


FALSE = {
    "moves": ("cart", f"{MOVES}: input 1, step", {"low": lambda low: low[:, 1].__iadd__(1)}),
    "clear": ("cart", f"{CLEAR}: input ", {"clear": lambda clear: clear.fill(255)}),
    "arrivals": ("line", f"{ARRIVE}: input ", {"arrives": lambda marks: marks.fill(255)}),
    "goals": (
        "line",
        f"{GOALS}: step 0, cell",
        {"pool": lambda pool: pool.__setitem__(slice(1, None), 2**64 - 1 >> 48)},
    ),
    "sets of a step less": (
        "line",
        f"{NEARER}: step 0, cell",
        {"index": lambda index: index[:-1].__setitem__(slice(1, 3), index[2:4])},
    ),
    "steps": ("cart", f"{NEARER}: step 0, cell", {"clear": lambda clear: clear.fill(0)}),
}


@pytest.mark.parametrize("name", FALSE)
def test_what_is_false_is_named(name, few, tmp_path):
    robot, said, changes = FALSE[name]
    looked, made, found = changed(robot, tmp_path, **changes)
    assert any(said in one for one in found) and len(found) <= 5 and looked < made, found
    assert all(re.search(r"within [1-3]$", one) for one in found if NEARER in one)


def test_what_is_told_of_a_look_is_counted_and_named():
    claims = Claim("moves", 9, 8, [f"place {at}" for at in range(7)], 70), Claim("clear", 5, 5, [])
    assert sampled.counted(claims) == (13, 14, [f"moves: place {at}" for at in range(5)])
    assert sampled.named(1, 7, np.array([2, 5])) == "step 1, cell (1, 2)"


@pytest.mark.parametrize("name", ["turning", "tide"])
def test_what_fails_is_named_by_its_place(name, few, monkeypatch, tmp_path):
    """Of each kind every second cell, place or site: all that were asked about, and no others."""
    told, arrays = parts_of(name, tmp_path)
    sets, wrong = Argument(told, sampled.InMemory(arrays)), set()

    def even(kind, step, numbers, counts, behind=()):
        for number, more in zip(numbers.tolist(), [*behind] or [""] * numbers.size, strict=True):
            if number % 2 == 0:
                wrong.add(f"{kind}step {step}, cell {tuple(map(int, np.unravel_index(number, counts)))}{more}")
        return numbers % 2 > 0

    def of_axes(some):
        return [n if one else 1 for n, one in zip(sets.counts.tolist(), some, strict=True)]

    def not_led(_, numbers, into, step, __):
        within = {sets.number(step + 1, n): f", within {n + 1}" for n in range(sets.problem.steps - step)}
        behind = map(within.__getitem__, into.tolist())
        return np.flatnonzero(~even(f"{NEARER}: ", step, numbers, sets.counts, behind))

    def moves_hold(_, step, j, places, __):
        return even(f"{MOVES}: input {j}, ", step, places, of_axes(sets.known))

    def clear_of(_, one, step, j, numbers, __):
        return even(f"{CLEAR}: input {j}, ", step, numbers, of_axes(one.own))

    def arrivals_hold(_, step, sites, __):
        return even(f"{ARRIVE}: ", step, sites, of_axes(sets.sites > 0))

    monkeypatch.setattr(Argument, "goals_hold", lambda _, step, cells: even(f"{GOALS}: ", step, cells, sets.counts))
    monkeypatch.setattr(Argument, "not_led", not_led)
    monkeypatch.setattr(Argument, "moves_hold", moves_hold)
    monkeypatch.setattr(Argument, "arrivals_hold", arrivals_hold)
    monkeypatch.setattr(sampled, "clear_of", clear_of)
    monkeypatch.setattr(sampled, "SHOWN", 10**6)
    _, _, found = sampled.looked_over(told, arrays, None)
    # which input an arrival is asked about under is not handed over
    assert {re.sub(f"({ARRIVE}: )input \\d+, ", r"\1", one) for one in found} == wrong
    assert {one.split(": ")[0] for one in found} == {GOALS, NEARER, MOVES, CLEAR, ARRIVE}


WHOLE = {  # what is looked at whole, of however many claims
    "cells": ("line", "cells cover the axes: axis 0", lambda told, arrays: told["cells"].update(widths=["99/1000"])),
    "sets": (
        "line",
        "sets grow with the steps to go: start 0",
        lambda told, arrays: arrays["index"][2:3].__setitem__(0, arrays["index"][0]),
    ),
    "predictions": (
        "spread",
        "predictions are as near as stated: input 0",
        lambda told, arrays: told["proof"].update(unsure=[0.05]),
    ),
}


@pytest.mark.parametrize("name", WHOLE)
def test_what_needs_whole_arrays_is_looked_at_whole(name, few, tmp_path):
    robot, said, change = WHOLE[name]
    told, arrays = parts_of(robot, tmp_path)
    change(told, arrays)
    looked, made, found = sampled.looked_over(told, arrays, None)
    assert looked == 0 < made and any(said in one for one in found), found


def test_a_solve_returns_no_table_of_which_a_claim_is_false(monkeypatch):
    """The prover says of every input that it is clear from everywhere."""
    prepare = GeneralProof.prepare

    def rashly(proof, progress):
        made = prepare(proof, progress)
        proof.clear.setflags(write=True)
        proof.clear[:] = 255
        proof.clear.setflags(write=False)  # else kernels are compiled for it
        return made

    monkeypatch.setattr(GeneralProof, "prepare", rashly)
    with pytest.raises(RuntimeError, match=r"input \d, cell"):
        sdhj.solve(cart(), sdhj.Certified((20, 20), parts=1), progress=False, play=False)


@pytest.mark.parametrize("periodic", [(False, True), (True, True)])
def test_cells_are_looked_up_as_sums_count_them(periodic, rng, tmp_path):
    """Boxes of any size and place, around axes that close, up to all of them."""
    told, arrays = parts_of("standing", tmp_path)
    sets = Argument(told, sampled.InMemory(arrays))
    sets.problem.periodic = np.array(periodic)
    cells = rng.random(sets.counts) < 0.995
    words = np.packbits(np.pad(cells, ((0, 0), (0, -cells.shape[1] % 64))), axis=1, bitorder="little").view(np.uint64)
    sets.pool, sets.low, sets.high = (
        words,
        np.zeros((1, 1, 1, 2), np.int16),
        np.array([48, 10], np.int16).reshape(1, 1, 1, 2),
    )
    first = rng.integers(-12, 50, (2, 1000))
    past = first + rng.integers(1, [[50], [12]], (2, 1000))
    # The second of the two sets has the rows of the first in another order.
    both = np.array([np.arange(len(words)), rng.permutation(len(words))])
    sets.index, own = both, rng.integers(0, 2, 1000)
    found = sampled.all_in(sets, first, past, own)
    each = np.array([sets.all_in(sets.sums(cells[rows].ravel()), first, past) for rows in both])
    np.testing.assert_array_equal(found, each[own, np.arange(1000)])
    some = rng.permutation(1000)[:500]
    np.testing.assert_array_equal(sampled.all_in(sets, first[:, some], past[:, some], own[some]), found[some])
    assert 0.05 < found.mean() < 0.95


def test_what_was_looked_at_is_in_the_file_and_its_summary(tmp_path):
    table = solved("line")
    table.save(tmp_path / "table.npz")
    assert sdhj.load(tmp_path / "table.npz").details["checked"] == table.details["checked"]
    few = replace(table, details=dict(table.details) | {"checked": [5, 1000]})
    assert "5 of 1,000 claims" in repr(few)
    sdhj.export_c(few, tmp_path / "robot")
    header = (tmp_path / "robot" / "sdhj_robot.h").read_text()
    assert "solve; `sdhj verify` checks" in header
    for wrong in (["all"], [2, 1], [-1, 1], 3, [True, 1]):
        replace(table, details=dict(table.details) | {"checked": wrong}).save(tmp_path / "wrong.npz")
        with pytest.raises(sdhj.TableFileError):
            sdhj.load(tmp_path / "wrong.npz")


@pytest.fixture
def arm(rng):
    """Sets of an arm that grow by chance, and whose last two are larger by a cell alone; one input is clear once."""
    cells = naive.sets_of(3, (9, 8, 6, 7), rng, [0.02, 0.02, 0.02, 0.0])[0]
    cells[2] = cells[1]
    cells[3] = cells[1]
    cells[2:4, 4, 4, 2, 2] = cells[3, 5, 5, 3, 3] = True
    arm = with_sets(cells)
    arm.allowed = rng.random((3, 5, 9, 8)) < 0.3
    arm.allowed[:, 2] = False
    arm.allowed[1, 2, 7, 7] = True
    return arm


def with_sets(cells):
    """An arm with those sets, (10, n1, n2, nx, ny) bool."""
    arm, (_, *shape) = object.__new__(Arm), cells.shape
    arm.steps, arm.still, arm.counts, arm.pairs, arm.cells = 3, False, np.array(shape), naive.pairs(3), cells
    blocks = naive.packed(cells).reshape(10, shape[0] * shape[1], -1)
    arm.pool, index = np.unique(blocks.reshape(-1, blocks.shape[-1]), axis=0, return_inverse=True)
    arm.index = index.reshape(10, -1)
    return arm


@pytest.mark.parametrize(("more", "told"), [((), []), ((3, 4), [1, 1]), ((4,), [1]), ((5,), [2])])
def test_later_sets_of_an_arm_among_what_stands_still_are_inside_those_of_step_0(more, told):
    """Which all steps ask: sets of one row, of which some have a cell more."""
    words = np.array([0b1, 0b11, 0b111, 0b1, 0b11, 0b1], np.uint64)
    words[list(more)] |= np.uint64(0b1000)
    pool, index = np.unique(words, return_inverse=True)
    given = {"steps": 2, "pairs": naive.pairs(2), "pool": pool[:, None], "index": index[:, None]}
    assert cells_added(SimpleNamespace(still=False, **given))[1].failed == 0
    found = cells_added(SimpleNamespace(still=True, **given))[1].failures
    assert [int(one.split()[1].rstrip(":")) for one in found] == told


def new_of(arm):
    """Which cells of each set of an arm are claimed: none that the set of a step less has."""
    return [own & ~arm.cells[at - 1] if arm.pairs[at, 1] else own for at, own in enumerate(arm.cells)]


@pytest.mark.parametrize("full", [False, True])
def test_rims_of_an_arm_are_counted_as_cell_by_cell(arm, full, rng):
    """Of few cells all are at rims; of nearly all few, each for one cell beside it."""
    if full:
        arm = with_sets(naive.sets_of(3, (9, 8, 6, 7), rng, [0.96] * 4)[0])
    rims, ends = np.zeros((9, 8), int), np.zeros((9, 8, 4), int)
    for own, new in zip(arm.cells, new_of(arm), strict=True):
        for i, j, x, y in np.argwhere(new):
            joints = [((i + 1) % 9, j, x, y), (i - 1, j, x, y), (i, (j + 1) % 8, x, y), (i, j - 1, x, y)]
            places = [
                (i, j, min(x + 1, 5), y),
                (i, j, max(x - 1, 0), y),
                (i, j, x, min(y + 1, 6)),
                (i, j, x, max(y - 1, 0)),
            ]
            rims[i, j] += not all(own[one] for one in joints + places)
            ends[i, j] += x == 0, x == 5, y == 0, y == 6
    for row, (i, j) in enumerate(np.ndindex(9, 8)):
        assert drawn.at_rims(arm, row) == [rims[i, j], *ends[i, j]]


def test_rows_of_each_kind_are_those_that_have_it(arm):
    rows = [*np.ndindex(9, 8)]
    some = [arm.cells[:, i, j].any() for i, j in rows]
    ends = [(0, 0), (0, 8), (1, 0), (1, 7)]
    expected = [[full and row[joint] == end for full, row in zip(some, rows, strict=True)] for joint, end in ends]
    expected += [[arm.allowed[:, j, i1, i2].any() for i1, i2 in rows] for j in range(5)]
    expected += [[new[i1, i2].any() for i1, i2 in rows] for new in reversed(new_of(arm))]
    assert [own.tolist() for own in drawn.each_of(arm)] == expected


@pytest.mark.parametrize("seed", range(5))
def test_rows_of_an_arm_have_claims_enough_rims_and_all_else(arm, seed, monkeypatch):
    monkeypatch.setattr(drawn, "NEAR_RIMS", 40)
    new = np.array([own.sum(axis=(2, 3)).ravel() for own in new_of(arm)])
    made = new.sum(axis=0) + arm.allowed.sum(axis=(0, 1)).ravel()
    np.testing.assert_array_equal(arm.made, made)
    for few in (20, 200, 400):
        rows = drawn.some_rows(arm, few, np.random.default_rng(seed))
        found = np.array([drawn.at_rims(arm, row) for row in rows.tolist()]).sum(axis=0)
        assert rows.size == len({*rows.tolist()}) < 60 and made[rows].sum() >= few and found[0] >= few / 2
        assert (found[1:] > 0).all() and ((new[:, rows] > 0).any(axis=1) == (new > 0).any(axis=1)).all()
        assert arm.allowed.any(axis=0).reshape(5, -1)[:, rows].any(axis=1).all()
        assert {0, 8} <= {*(rows // 8).tolist()} and {0, 7} <= {*(rows % 8).tolist()}


@pytest.mark.parametrize("many", [False, True])
def test_of_an_arm_with_few_claims_all_rows_are_looked_at(arm, many, monkeypatch):
    monkeypatch.setattr(claims, "Arm", lambda *_: arm)
    monkeypatch.setattr(sampled, "MOST_WHOLE", int(arm.made.sum()) - many)
    monkeypatch.setattr(sampled, "SAMPLED", 200)
    asked = []
    arm.claims = lambda rows, _: asked.extend(rows.tolist()) or [Claim("clear", 9, len(rows), ["mine"])]
    assert sampled.looked_over({"cells": {"kind": "arm"}}, {}, None) == (len(asked), 9, ["clear: mine"])
    every = np.flatnonzero(arm.made).tolist()
    assert len(asked) < len(every) if many else asked == every
