"""Damaged and forged certified tables: refused by the table and, with code of its own, by the independent checker."""

import itertools
import shutil
import time
from functools import cache

import numpy as np
import pytest
from forging import FORGERIES, forged, replaced, spoiled
from naive_certified import SMALL

import sdhj
from sdhj.certified.check import reading
from sdhj.certified.check.arm.claims import Arm
from sdhj.certified.check.reading import head_and_arrays
from sdhj.table import files

pytestmark = pytest.mark.slow  # the arm's own kernels are compiled

LONGEST = 10.0  # seconds that an answer may take


def read_to_check(path):
    with head_and_arrays(path) as (told, arrays):
        file = Arm(told, arrays)
    if file.uncovered():  # then `verify` goes no further
        raise ValueError("not proved")
    return file


READERS = {"table": lambda path: sdhj.load(path, problem=small_problem()), "checker": read_to_check}


@cache
def small_problem():
    return sdhj.arm_case_study(**SMALL)


@pytest.fixture(scope="module")
def saved(small, tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "small.npz"
    small.save(path)
    return path


@pytest.fixture
def path(saved, tmp_path):
    return shutil.copy(saved, tmp_path / "forged.npz")


def refused(path, reader, match=None):
    began = time.perf_counter()
    with pytest.raises(ValueError, match=match):
        READERS[reader](path)
    assert time.perf_counter() - began < LONGEST


@pytest.mark.parametrize("reader", READERS)
def test_what_is_whole_is_read(path, reader):
    assert READERS[reader](path).pool.any()


@pytest.mark.parametrize("reader", READERS)
def test_all_damage_is_found_before_the_head_is_believed(path, reader, rng, monkeypatch):
    def not_yet(*arguments, **options):
        raise AssertionError("damaged bytes were believed")

    for damaged in spoiled(path.read_bytes(), rng, 1000):
        path.write_bytes(damaged)
        with monkeypatch.context() as patch:
            patch.setattr(files, "checked_head", not_yet)
            patch.setattr(reading, "digest", not_yet)
            refused(path, reader)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("name", "forgery"),
    [
        *(("index", forgery) for forgery in FORGERIES),  # and some of the others, which are read alike
        *itertools.product(("pool", "allowed"), ("missing", "too short", "other kind", "bomb")),
    ],
)
def test_a_forged_array_is_refused(path, reader, name, forgery):
    with forged(path) as (told, arrays):
        replaced(name, FORGERIES[forgery])(told, arrays)
    refused(path, reader, "can be read|no sense")


def ones(told, arrays):
    """More than all cells: the bits past the last one in a block count as well."""
    arrays["pool"][...] = np.uint64(0xFFFFFFFFFFFFFFFF)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    "forge",
    [
        ones,
        lambda told, arrays: told["cells"].update(shape=[32, 32, 12, 10**12]),
        lambda told, arrays: told["cells"].update(shape=[10**6, 10**6, 10**6, 10**6]),
        lambda told, arrays: told["cells"].update(widths=["1e999999999"] * 4),
        lambda told, arrays: told["cells"].update(widths=["1/" + "9" * 300] * 4),
        lambda told, arrays: told["cells"].update(widths=["0", "-1", "1/0", 7]),
        lambda told, arrays: told["cells"].update(widths=[]),
        lambda told, arrays: told["cells"].update(kind="arm " * 2) or told.update(cells=7),
    ],
)
def test_cells_that_make_no_sense_are_refused(path, reader, forge):
    with forged(path) as parts:
        forge(*parts)
    refused(path, reader)


@pytest.mark.parametrize("parts", [0, 10**9, "7", None])
def test_parts_that_make_no_sense_are_refused(path, parts):
    with forged(path) as (told, _):
        told["proof"]["parts"] = parts
    refused(path, "table")
