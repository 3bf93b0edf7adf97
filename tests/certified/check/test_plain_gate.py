"""The gate of the checker: what is true is proved, every forgery refused, and nothing in its argument goes unneeded."""

import re
from pathlib import Path

import numpy as np
import pytest
from forged_robots import FORGERIES, NEARER, PROMISED, ROBOTS, Forgery, file_of, sets
from gate import box_beside, refusals
from parameters import but_slow

import sdhj
from sdhj.certified.check.argument import Argument
from sdhj.certified.check.reading import head_and_arrays

WHOLE = ("plane", "noisy", "standing", "tide", "stream", "ring", "cart", "spread", "sensed", "growing", "hidden")


@pytest.mark.parametrize("name", but_slow(ROBOTS, *(name for name in ROBOTS if name not in WHOLE)))
def test_what_is_true_is_proved(name, tmp_path):
    """Of all cells: what is promised a solve has looked at, and returned no table otherwise."""
    (tmp_path / "true.npz").write_bytes(file_of(name))
    assert [*refusals(tmp_path / "true.npz", box_beside(name))] == []


NAMED = {  # what is told of forgeries, of which one thing is false: the line below its claim
    "a shorter move": "start 0, input 1, place 0",
    "the second post": "start 0, input 1, cell of x1 69",
    "a post that comes later": "start 2, input 1, cell of x1 56",
    "out by an end of the second axis": "start 0, input 3, cell of x1, x2 450",
    "an arrival more": "start 0, input 1, site 29",
    "a goal more": "start 0, within 0, cell 30",
    "a goal beside an uncertain clock": "start 2, within 0, cell 93",
    "a cell more": "start 0, within 1, cell 26",
    "a late set that loses a cell": "start 2, within 1",
    "predictions for the first step": "input 1, from 0.213 s on",
    "a layer at an upper end that is no wall": "axis 1: a layer where no wall holds",
    "cells that are not alike": "axis 0: its cells do not move alike",
    "cells that are too wide": "axis 0: 80 cells of width 0.111111 do not cover it",
}


@pytest.mark.parametrize("name", [name for name in FORGERIES if name not in PROMISED])
def test_a_forgery_is_refused(name, tmp_path):
    """With the words of its claim; of what is not promised, too, where all is asked for."""
    forgery = FORGERIES[name]
    path = forgery.write(file_of(forgery.robot), tmp_path / "forged.npz")
    said = refusals(path, forgery.beside and forgery.beside())
    found = next((one for one in said if forgery.said in one), None)
    assert found is not None, [*refusals(path, forgery.beside and forgery.beside())]
    assert name not in NAMED or f"    {NAMED[name]}" in found.splitlines()


@pytest.mark.parametrize("name", PROMISED)
def test_what_is_false_of_what_is_promised_is_refused(name, tmp_path):
    forgery = PROMISED[name]
    path = forgery.write(file_of(forgery.robot), tmp_path / "forged.npz")
    assert any(forgery.said in one for one in refusals(path, every=False))


@pytest.mark.parametrize("row", [5, 3])
def test_of_many_cells_each_is_looked_at(row, tmp_path, monkeypatch):
    """Of so many that they are looked at in turn, eight at a time here: the second, or the last, is false."""
    forgery = Forgery("stream", NEARER, sets(lambda found: found[:, 0, row].fill(0)))
    path = forgery.write(file_of(forgery.robot), tmp_path / "forged.npz")
    together = [*refusals(path)]
    monkeypatch.setattr(sdhj.certified.check.argument, "SLAB", 1)
    assert [*refusals(path)] == together and f"cell {20 + row}" in together[0]


# ---- what is not in a file


@pytest.mark.parametrize("name", ["growing slowly", "bent", "standing"])
def test_what_begins_late_moves_as_far(name, tmp_path, monkeypatch):
    """The length of a piece is handed over: of times of a day, or a year, it could not be told."""
    (tmp_path / "true.npz").write_bytes(file_of(name))
    with head_and_arrays(tmp_path / "true.npz") as (told, arrays):
        plain = Argument(told, arrays)
    places = np.arange(plain.low.shape[2])
    soon = plain.driven(places, 0, 0, 8)[1]
    monkeypatch.setattr(plain, "time", lambda step: 2.0 * np.pi * 1e12)
    late = plain.driven(places, 0, 0, 8)[1]
    np.testing.assert_array_equal(late, soon)


@pytest.mark.parametrize("tries", [1, 2, 30])
def test_where_a_search_is_given_up_nothing_is_known(tries, tmp_path, monkeypatch):
    """A guess that no step confirms is no bound of what is reached: of dx = 48 x, from 1 on, exp(48 t)."""
    (tmp_path / "true.npz").write_bytes(file_of("growing faster"))
    with head_and_arrays(tmp_path / "true.npz") as (told, arrays):
        plain = Argument(told, arrays)
    monkeypatch.setattr(sdhj.certified.check.argument, "TRIES", tries)
    plain.length = 5.9 / 48.0  # s, until when it grows on
    assert plain.edges[0][1] == 1.0 and plain.driven(np.array([0]), 0, 0, 1)[1][1, 0, 0] >= np.expm1(5.9)


def test_the_list_of_obligations_is_true():
    """Tests and forgeries that it names are there, and every forgery of what it lists is of one of its claims."""
    text = sdhj.certified.sets.__doc__
    names = re.findall(r'"([^"]+)"', text[text.index("For robots of one's own") :])
    assert len(names) > 35 and set(names) <= FORGERIES.keys()
    tests = {
        name
        for path in Path(__file__).parents[2].rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)", path.read_text(encoding="utf-8"))
    }
    assert set(re.findall(r"\btest_\w+(?!\w|\.py)", text)) <= tests
