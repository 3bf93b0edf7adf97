"""Forged tables of arms: refused by the table, and where their cells make no sense by the checker's code as well."""

import itertools
import shutil
import time
from functools import cache

import make_arms
import pytest
from forging import FORGERIES, forged, replaced

import sdhj
from sdhj.certified.check.arm.claims import Arm
from sdhj.certified.check.reading import head_and_arrays

pytestmark = pytest.mark.slow

LONGEST = 10.0  # seconds that an answer may take


def read_to_check(path):
    with head_and_arrays(path) as (told, arrays):
        file = Arm(told, arrays)
    if file.uncovered():  # then `verify` goes no further
        raise ValueError("not proved")
    return file


@cache
def problem():
    return sdhj.arm_case_study(**make_arms.COMMON, **make_arms.CHASED)


READERS = {"table": lambda path: sdhj.load(path, problem=problem()), "checker": read_to_check}


@pytest.fixture
def path(tmp_path):
    return shutil.copy(make_arms.FOLDER / "chased.npz", tmp_path / "forged.npz")


def refused(path, reader, match=None):
    began = time.perf_counter()
    with pytest.raises(ValueError, match=match):
        READERS[reader](path)
    assert time.perf_counter() - began < LONGEST


@pytest.mark.parametrize(
    ("name", "forgery"),
    [
        *(("index", forgery) for forgery in FORGERIES),  # and some of the others, which are read alike
        *itertools.product(("pool", "allowed"), ("missing", "too short", "other kind", "bomb")),
    ],
)
def test_a_forged_array_is_refused(path, name, forgery):
    assert READERS["table"](path).pool.any()
    with forged(path) as (told, arrays):
        replaced(name, FORGERIES[forgery])(told, arrays)
    refused(path, "table", "can be read|no sense")


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    "forge",
    [
        lambda cells: cells.update(shape=[32, 32, 12, 10**12]),
        lambda cells: cells.update(shape=[10**6, 10**6, 10**6, 10**6]),
        lambda cells: cells.update(widths=["1e999999999"] * 4),
        lambda cells: cells.update(widths=["1/" + "9" * 300] * 4),
        lambda cells: cells.update(widths=["0", "-1", "1/0", 7]),
        lambda cells: cells.update(widths=[]),
        lambda cells: cells.clear(),
    ],
)
def test_cells_that_make_no_sense_are_refused(path, reader, forge):
    with forged(path) as (told, _):
        forge(told["cells"])
    refused(path, reader)


@pytest.mark.parametrize("parts", [0, 10**9, "7", None])
def test_parts_that_make_no_sense_are_refused(path, parts):
    with forged(path) as (told, _):
        told["proof"]["parts"] = parts
    refused(path, "table")
