"""Damaged and forged tables: damage is found before the HDF5 library sees it, no forgery crashes, hangs or reads on.

A forger knows the format and gives the file the digest that belongs to it; what a table says may then be wrong, but
reading it stays inside the file and its arrays.
"""

import shutil
import time

import h5py
import numpy as np
import pytest
from forging import FORGERIES, forged, replaced, seal, spoiled
from toys import torus_problem

import sdhj
from sdhj.problem import memory as memory_module
from sdhj.table.files import header

LONGEST = 10.0  # seconds that an answer may take


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "torus.h5"
    sdhj.solve(torus_problem(nodes=10, steps=3), progress=False).save(path)
    return path


@pytest.fixture
def path(saved, tmp_path):
    return shutil.copy(saved, tmp_path / "forged.h5")


def refused(path, match=None):
    began = time.perf_counter()
    with pytest.raises(sdhj.TableFileError, match=match):
        sdhj.load(path, problem=torus_problem(nodes=10, steps=3))
    assert time.perf_counter() - began < LONGEST


def no_library(*arguments, **options):
    raise AssertionError("the HDF5 library saw damaged bytes")


@pytest.mark.parametrize("count", [50, pytest.param(1000, marks=pytest.mark.slow)])
def test_all_damage_is_found_before_the_library_sees_it(path, rng, count, monkeypatch):
    for damaged in spoiled(path.read_bytes(), rng, count):
        path.write_bytes(damaged)
        with monkeypatch.context() as patch:
            patch.setattr(h5py, "File", no_library)
            refused(path, "damaged, cut short or not a look-up table|format version")
            with pytest.raises(sdhj.TableFileError):
                header(path)


@pytest.mark.parametrize("keep", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(path, keep):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * keep)])
    refused(path, "damaged")


@pytest.mark.parametrize("name", ["index", "tubes", "masks", "avoid_static", "avoid_moving"])
@pytest.mark.parametrize("forgery", FORGERIES)
def test_a_forged_array_is_refused(path, name, forgery):
    with forged(path) as (told, arrays):
        replaced(name, FORGERIES[forgery])(told, arrays)
    refused(path, f"is undamaged, but not a look-up table that can be read.*({name}|index)")


def test_other_files_are_not_read(path, tmp_path):
    """Nor is what stands in them told: neither by an array nor by the header, which needs none."""
    (tmp_path / "secret").write_bytes(b"\x07" * 10_000)
    with forged(path) as (_, arrays):
        index = arrays["index"][()]
        del arrays["index"]
        arrays.create_dataset("index", index.shape, index.dtype, external=[(str(tmp_path / "secret"), 0, 10_000)])
    refused(path, "index lies in another file")
    assert 7 not in np.unique(header(path)["inputs"])


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("avoid_axes", {"static": [], "moving": [0, 9]}, "ascending axes of the grid"),
        ("avoid_axes", {"static": [], "moving": [1, 0]}, "ascending axes of the grid"),
        ("avoid_axes", {"static": [], "moving": [0]}, "avoid_moving must be"),
        ("avoid_axes", {}, "static"),
        ("steps", 10**400, "steps is 1000"),
        ("steps", 2, "steps is 2 there and 3 here|must be"),
        ("delta", float("nan"), "delta"),
        ("inputs", [[1.0], [2.0, 3.0]], "inhomogeneous|inputs"),
        ("inputs", "text", "inputs"),
        ("method", 7, "must be text"),
        ("recipe", [1], "must be text, the recipe a mapping"),
        ("details", 3, "not iterable"),
        ("grid", {}, "lower"),
    ],
)
def test_what_is_told_is_checked(path, name, value, match):
    with forged(path) as (told, _):
        told[name] = value
        if name == "steps":
            told["digest"] = "0" * 64
    refused(path, match)


@pytest.mark.parametrize("text", [b"[" * 10**6, b"{}", b"7", b"\xff", b'{"grid": {"lower": ' + b"9" * 10**6])
def test_text_that_tells_nothing_is_refused(path, text):
    first, _, _, image = path.read_bytes().split(b"\n", 3)
    seal(path, first, text + b"\n" + image)
    refused(path, "can be read")
    with pytest.raises(sdhj.TableFileError):
        header(path)


@pytest.mark.parametrize("wrong", [-1, 10**6])
def test_an_index_beyond_the_tubes_is_refused(path, wrong):
    with forged(path) as (_, arrays):
        arrays["index"][3] = wrong
    refused(path, "index|tubes must be")


def test_an_array_that_does_not_fit_into_memory_is_told(path, monkeypatch):
    monkeypatch.setattr(memory_module, "available", lambda: (1000, "are available"))
    monkeypatch.setattr(memory_module, "SPARE", 0)
    problem = torus_problem(nodes=10, steps=3)
    with pytest.raises(MemoryError, match="the array tubes of the file needs about"):
        sdhj.load(path, problem=problem)
