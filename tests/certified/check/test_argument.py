"""The parts of the checker's argument by which work is cut in pieces and put together, against plain loops."""

import os
from itertools import product

import numpy as np
import pytest
from forged_robots import file_of

from sdhj.certified.check import argument
from sdhj.certified.check.argument import Argument, everywhere, failing, in_slabs, in_tiles, left_open, some_of, spread
from sdhj.certified.check.claims import ARRIVE, COVER, GROW, PREDICTED, Claim
from sdhj.certified.check.reading import head_and_arrays


def read(name, folder):
    (folder / "table.npz").write_bytes(file_of(name))
    with head_and_arrays(folder / "table.npz") as (told, arrays):
        return Argument(told, arrays)


@pytest.mark.parametrize("ends", [(-4.0, 1.0), (-1.0, 4.0), (3.0, 4.0)])
def test_what_counts_as_near_is_a_share_of_the_largest_coordinate(ends, tmp_path):
    (tmp_path / "table.npz").write_bytes(file_of("line"))
    with head_and_arrays(tmp_path / "table.npz") as (told, arrays):
        told["grid"].update(lower=[ends[0]], upper=[ends[1]])
        sets = Argument(told, arrays)
    assert sets.scale == 4.0 and sets.near == 4e-10 and sets.room == pytest.approx(1e-6 * (ends[1] - ends[0]) / 80)


@pytest.mark.parametrize("slab", [3, 1 << 15])
def test_boxes_are_halved_until_all_is_known(slab, rng, monkeypatch):
    """A property that is told of boxes of a side of 1/4 at most, and fails on disks: those that meet one fail."""
    monkeypatch.setattr(argument, "SLAB", slab)
    centres = rng.uniform(0.0, 6.0, (6, 2))
    low = rng.uniform(0.0, 5.0, (20, 2))
    boxes = np.array([low, low + 1.0]).swapaxes(1, 2)
    asked = []

    def holds(some):
        asked.append(some.shape[2])
        apart = np.array([np.hypot(*(np.clip(centre[:, None], *some) - centre[:, None])) > 0.3 for centre in centres])
        within = np.array([np.hypot(*np.abs(some - centre[:, None]).max(axis=0)) < 0.3 for centre in centres])
        small = (some[1] - some[0] <= 0.25 + 1e-9).all(axis=0)
        return apart.all(axis=0) & small, within.any(axis=0)

    nearest = np.array([np.clip(centre, low, low + 1.0) - centre for centre in centres])
    met = (np.hypot(*nearest.transpose(2, 0, 1)) <= 0.3).any(axis=0)
    found = everywhere(holds, boxes, (0, 1), 2)
    assert found.tolist() == (~met).tolist() and 4 < met.sum() < 16
    assert max(asked[1:]) <= slab
    assert not everywhere(holds, boxes, (0, 1), 1).any()  # once is too few
    assert not everywhere(holds, boxes, (0,), 9).any()  # nor are both axes halved


@pytest.mark.parametrize("axes", [1, 2, 3, 4])
def test_boxes_of_few_axes_are_halved_more_often(axes):
    deepest = {1: 10, 2: 8}.get(axes, 6)
    boxes = np.array([np.zeros((axes, 1)), np.ones((axes, 1))])

    def in_the_corner(some, side):
        small, beside = (some[1] - some[0] <= side).all(axis=0), (some[0] > 0.0).any(axis=0)
        return small | beside, np.zeros(some.shape[2], np.bool_)

    def near_the_corner(some):
        return in_the_corner(some, 0.5**deepest)

    def nearer(some):
        return in_the_corner(some, 0.5 ** (deepest + 1))

    assert everywhere(near_the_corner, boxes, range(axes)).all()
    assert not everywhere(nearer, boxes, range(axes)).any()


@pytest.mark.parametrize("slab", [7, 1 << 15])
@pytest.mark.parametrize("tiles", [(1, 1), (8, 1), (8, 8), (3, 4)])
def test_cells_are_asked_about_by_tiles_and_then_one_by_one(tiles, slab, rng, monkeypatch):
    monkeypatch.setattr(argument, "SLAB", slab)
    some, true = rng.random((13, 9)) < 0.5, rng.random((13, 9)) < 0.9
    asked = []

    def holds(boxes):
        asked.append(boxes.shape[1])
        out = []
        for i, j, past_i, past_j in zip(*boxes, strict=True):
            inside = slice(i, past_i + 1), slice(j, past_j + 1)
            assert some[inside].any() and past_i < 13 and past_j < 9
            out.append(true[inside].all())
        return np.array(out, np.bool_)

    assert (left_open(holds, some, np.array(tiles)) == (some & ~true)).all() and max(asked) <= slab
    assert not left_open(holds, np.zeros_like(some), np.array(tiles)).any()


def test_tiles_have_what_their_cells_have_and_the_other_way_round(rng):
    some = rng.random((13, 9)) < 0.1
    tiles = in_tiles(some, np.array([4, 1]))
    assert tiles.tolist() == [[bool(some[i : i + 4, j].any()) for j in range(9)] for i in range(0, 13, 4)]
    again = spread(tiles, (13, 9))
    assert again.tolist() == [[bool(tiles[i // 4, j]) for j in range(9)] for i in range(13)]


def test_what_fails_is_told_at_its_place(rng, monkeypatch):
    monkeypatch.setattr(argument, "SLAB", 3)
    asked, true = rng.random(20) < 0.6, rng.random(20) < 0.5
    found = failing(lambda some, tubes: true[some] & (tubes == "tubes"), asked, "tubes")
    assert found.tolist() == (asked & ~true).tolist()
    assert in_slabs(lambda some: true[some], np.zeros(0, np.int64)).tolist() == []


@pytest.mark.parametrize("given", [None, {}, "01", [True], [0.0], [-1], [3], [1, 1], ["0"]])
def test_numbers_of_things_are_whole_and_each_once(given):
    assert some_of("axes", [2, 0], 3).tolist() == [True, False, True]
    assert not some_of("axes", [], 3).any()
    with pytest.raises(ValueError, match="axes must be numbers below 3, each once"):
        some_of("axes", given, 3)


def test_so_many_tasks_are_looked_at_together(tmp_path, monkeypatch):
    """As many as there are cores; of large sets fewer, and one where users wrote a function."""
    sets = read("line", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2}, raising=False)
    assert [sets.together(tasks) for tasks in (1, 2, 9)] == [1, 2, 3]
    for most, tasks in ((79, 1), (80, 1), (160, 2), (400, 3)):
        monkeypatch.setattr(argument, "MOST_CELLS", most)
        assert sets.together(9) == tasks
    sets.problem.trusted = {"unsafe 0"}
    assert sets.together(9) == 1
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    sets.problem.trusted = set()
    assert sets.together(9) == 1


@pytest.mark.parametrize("name", ["crossed", "endless", "cart"])
def test_sets_are_numbered_by_steps_and_steps_to_go(name, tmp_path):
    """One behind the other; one for all steps where nothing moves, and one for ever where it holds for ever."""
    sets = read(name, tmp_path)
    steps = sets.problem.steps
    pairs = {"crossed": [(k, n) for k in range(4) for n in range(4 - k)], "cart": [(0, n) for n in range(4)]}
    pairs = pairs.get(name, [(0, 0), (0, 1)])
    assert sets.pairs == pairs
    numbers = {"crossed": [*range(10)], "cart": [*range(4)]}.get(name, [0, 0])
    assert [sets.number(*pair) for pair in pairs] == numbers
    if name != "crossed":
        assert all(sets.number(step, n) == sets.number(0, n) for step, n in product(range(steps), range(2)))


@pytest.mark.parametrize("axes", [[1, 0], [1]])
def test_functions_are_asked_about_boxes_on_the_grid(axes, tmp_path, rng):
    """Cut off at ends; where an axis closes in parts, of any length and any number of turns away: x + 2 y and -y."""
    sets = read("turning", tmp_path)
    low, turn = np.array([-1.0, -np.pi]), 2 * np.pi
    starts = low + rng.uniform(-3.0, 3.0, (100, 2)) * [1.0, turn]
    sizes = rng.choice([0.0, 0.01, 0.3, 0.9, 2.4], (100, 2)) * rng.uniform(0.8, 1.0, (100, 2)) * [2.0, turn]
    starts[:4, 1], sizes[:4, 1] = [-np.pi, np.pi, -np.pi, 0.0], [turn, 0.1, 0.1, turn]
    boxes = np.array([starts, starts + sizes]).swapaxes(1, 2)[:, axes]
    before, x, y = boxes.copy(), axes.index(0) if 0 in axes else None, axes.index(1)

    def bounds(low, high):
        assert (low <= high).all() and (low[y] >= -np.pi).all() and (high[y] <= np.pi).all()
        along = (0.0, 0.0) if x is None else (low[x], high[x])
        both = [
            [first + 2 * second, -other]
            for first, second, other in zip(along, (low[y], high[y]), (high[y], low[y]), strict=True)
        ]
        return np.where((low[y] <= 3.0) & (high[y] >= 3.0) & (high[y] - low[y] < 0.05), np.nan, both)

    found = sets.on_grid(axes, boxes, bounds)
    assert (boxes == before).all() and found.shape == (2, 2, 100)
    for box, least, most in zip(boxes.transpose(2, 1, 0), *found.transpose(0, 2, 1), strict=True):
        first, last = box[y]
        laps = [(a, b) for a, b in ((first + lap * turn, last + lap * turn) for lap in range(-6, 7))]
        parts = [(max(a, -np.pi), min(b, np.pi)) for a, b in laps if a < np.pi - 1e-9 and b > -np.pi - 1e-9]
        parts = [(-np.pi, np.pi)] if last - first >= turn - 1e-9 else [part for part in parts if part[0] <= part[1]]
        if any(a <= 3.0 <= b and b - a < 0.05 for a, b in parts):
            assert np.isinf(least).all() and np.isinf(most).all() and (least < most).all()
            continue
        lower, upper = min(a for a, _ in parts), max(b for _, b in parts)
        along = np.clip(box[x], -1.0, 1.0) if x is not None else (0.0, 0.0)
        np.testing.assert_allclose(least, [along[0] + 2 * lower, -upper], atol=1e-9)
        np.testing.assert_allclose(most, [along[1] + 2 * upper, -lower], atol=1e-9)


@pytest.mark.parametrize("layers", [[1, 1], [1, 0], [0, 1], [0, 0]])
@pytest.mark.parametrize("memory", [True, False])
def test_who_remembers_knows_of_a_layer_that_he_is_in_it(layers, memory, tmp_path):
    """And of no other cell, also not of the first and the last where there is no layer."""
    sets = read("noisy", tmp_path)
    assert sets.known.tolist() == [False, True] and sets.counts[1] == 12
    sets.layers, sets.problem.memory = [[0, 0], layers], memory
    found = sets.off_at(np.arange(12))
    inside = [memory and ((layers[0] and k == 0) or (layers[1] and k == 11)) for k in range(12)]
    assert found[1].tolist() == [0.0 if one else sets.off[1] for one in inside] and (found[0] == sets.off[0]).all()


def test_cells_of_large_sets_are_counted(tmp_path):
    """More than two bytes count."""
    sets = read("cart", tmp_path)
    sets.counts = np.array([200, 200])
    sums = sets.sums(np.ones(40_000, np.bool_))
    assert sums[-1, -1] == 40_000 and sums[100, 3] == 300 and not sums[0].any()
    assert sets.all_in(sums, np.array([[0], [-5]]), np.array([[200], [250]])).all()


@pytest.mark.parametrize("name", ["cart", "crossed", "line", "endless"])
def test_cells_are_promised_that_some_set_has(name, tmp_path):
    """Those with the most steps to go, without a target with the fewest."""
    sets = read(name, tmp_path)
    largest = [sets.bits(k, 1 if name in ("cart", "endless") else 3 - k) for k in range(3)]
    assert all((sets.promised(k).ravel() == own).all() for k, own in enumerate(largest))
    assert (sets.promised(None).ravel() == np.any(largest, axis=0)).all() and 0 < largest[0].sum() < largest[0].size


@pytest.mark.parametrize("safe", [(True, False), (False, True), (True, True), (False, False)])
def test_who_has_left_by_a_cell_over_a_safe_end_is_in_no_need_of_a_set(safe, tmp_path):
    sets = read("stream", tmp_path)
    sets.safe = np.array([safe, (False, False)])
    numbers = np.arange(100)
    for j, way in enumerate((-3, 3)):
        found = sets.leads(numbers, 0 * numbers, 0, j, lambda first, past, into: np.zeros(first.shape[1], np.bool_))
        cells = np.arange(10)
        low, high = (cells + each[0, j, 0, 0] for each in (sets.low, sets.high))
        gone = (safe[0] & (high < -1)) | (safe[1] & (low > 10))
        clear = sets.is_clear(0, j, np.array(np.unravel_index(numbers, (10, 10))))
        assert found.tolist() == (clear & np.repeat(gone, 10)).tolist() and found.any() == safe[way > 0]


def test_each_input_step_and_black_box_is_a_claim(tmp_path):
    """Of predictions one for each input, also without a delay; of sets that grow one for each step and steps to go."""
    for name, predicted, pairs in (("calming", 3, 4), ("crossed", None, 10)):
        sets = read(name, tmp_path)
        found = {claim.name: (claim.made, claim.checked) for claim in sets.claims(samples=1)}
        assert found.get(PREDICTED, (None,) * 2) == (predicted,) * 2 and found[GROW] == (pairs,) * 2
        assert found[COVER] == (sets.problem.ndim,) * 2 and (ARRIVE in found) == (name == "crossed")
    sets.problem.trusted = {"unsafe 1", "drift"}
    *_, last = sets.claims(samples=1)
    assert last == Claim("rests on what is stated of drift, unsafe 1", 0, 0, [])
