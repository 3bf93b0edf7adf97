"""Damaged and forged tables: damage is found before the head is looked at, no forgery crashes, hangs or reads on.

A forger knows the format and gives the file the digest that belongs to it; what a table says may then be wrong, but
reading it stays inside the file and its arrays.
"""

import shutil
import time
from functools import cache

import make_golden
import pytest
from click.testing import CliRunner
from forging import FORGERIES, forged, replaced, retold, spoiled
from parameters import but_slow
from room import room
from zoo import torus_problem

import sdhj
from sdhj.cli import main
from sdhj.table import files
from sdhj.table.files import read_head

LONGEST = 10.0  # seconds that an answer may take


@cache
def torus():
    return torus_problem(nodes=10, steps=3)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "torus.npz"
    sdhj.solve(torus(), progress=False).save(path)
    return path


@pytest.fixture
def path(saved, tmp_path):
    return shutil.copy(saved, tmp_path / "forged.npz")


def refused(path, match=None):
    began = time.perf_counter()
    with pytest.raises(sdhj.TableFileError, match=match):
        sdhj.load(path, problem=torus())
    assert time.perf_counter() - began < LONGEST


def not_yet(*arguments, **options):
    raise AssertionError("damaged bytes were believed")


@pytest.mark.slow
def test_all_damage_is_found_before_the_head_is_believed(path, rng, monkeypatch):
    for damaged in spoiled(path.read_bytes(), rng, 1000):
        path.write_bytes(damaged)
        with monkeypatch.context() as patch:
            patch.setattr(files, "checked_head", not_yet)
            refused(path, "damaged|format version")
            with pytest.raises(sdhj.TableFileError):
                read_head(path)


@pytest.mark.parametrize("text", [b"[" * 10**6, b"7", b"\xff"])
def test_text_that_tells_nothing_is_refused(path, text):
    retold(path, text)
    refused(path, "can be read")
    with pytest.raises(sdhj.TableFileError):
        read_head(path)


def test_a_packed_array_that_does_not_fit_into_memory_is_told(path):
    sdhj.load(path).save(path, compress=True)
    with room(1000), pytest.raises(MemoryError, match="the file needs about"):
        sdhj.load(path, problem=torus())


# ---- forgeries: what is changed, and what is said of it


def tells(**changed):
    return lambda told, arrays: told.update(changed)


def points_to(place):
    return lambda told, arrays: arrays["index"].__setitem__(3, place)


def lines(name, given, said):
    """A row: the lines of a formula are these."""
    return lambda told, arrays: told["formulas"]["functions"][name].update(lines=given), said


RETURN = "return 0"
TORUS = [
    (tells(avoid_axes={"static": [], "moving": [0, 9]}), "ascending axes"),
    (tells(avoid_axes={"static": [], "moving": [1, 0]}), "ascending axes"),
    (tells(avoid_axes={"static": [], "moving": [0]}), "avoid_moving "),
    (tells(avoid_axes={}), "static"),
    (tells(steps=10**400), "steps"),
    (tells(steps=2), "6 entries, got 10"),
    (tells(delta=float("nan")), "delta"),
    (tells(inputs=[[1.0], [2.0, 3.0]]), "inhomogeneous|inputs"),
    (tells(inputs="text"), "inputs"),
    (tells(method=7), "must be text"),
    (tells(recipe=[1]), "the recipe a mapping"),
    (tells(details=3), "not iterable"),
    (tells(grid={}), "lower"),
    (points_to(-1), "index|tubes "),
    (points_to(10**6), "index|tubes "),
    *((replaced("index", make), "undamaged, but.*(index|packed)") for make in FORGERIES.values()),
    *(  # and some of the others, which are read alike
        (replaced(name, FORGERIES[forgery]), f"undamaged, but.*({name}|packed)")
        for name in ("tubes", "marks", "avoid_static", "avoid_moving")
        for forgery in ("missing", "too short", "other kind", "bomb")
    ),
]
GOLDEN = [  # of lines by themselves `test_graph` has more
    lines("target", ["x 0", "gamma 0", "return 1"], "line 1 of.*'gamma 0'.*no operation"),
    lines("target", ["x 0", f"abs {'9' * 5000}", "return 1"], "line 1 of a formula"),
    lines("target", ["x 0", f"power 0 {'9' * 5000}", "return 1"], "line 1 of a formula"),
    lines("target", ["x 0"] * 100_000 + [RETURN], "2 to 100,000 lines.*100,001"),
    lines("target", ["x 0", "return 0 0"], "'target'.*1 results.*2"),
    lines("velocity", ["x 0", RETURN], "'velocity'.*4 results.*1"),
    lines("target", ["const inf", RETURN], "undefined or infinite"),
    lines("target", ["x 0", "log 0", "return 1"], "undefined or infinite"),
    lines("target", [1, 2], "cannot be read"),
    lines("target", None, "cannot be read|can be read"),
    (lambda told, arrays: told["formulas"].update(format=2), "formulas have format 2"),
    (lambda told, arrays: told["formulas"].update(functions=[]), "can be read|cannot be read"),
    (lambda told, arrays: told["formulas"]["functions"].pop("velocity"), "formulas drift and gain"),
    (lambda told, arrays: told["formulas"]["functions"].pop("bounds"), "bounds"),
    (lambda told, arrays: told["formulas"]["functions"].pop("target"), "level set of|cannot be read"),
    (lambda told, arrays: told["formulas"].update(opaque=3), "can be read|cannot be read"),
    (lambda told, arrays: told["sets"][1].update(axes=[0, 7]), "axes of 'post' must"),
    (lambda told, arrays: told["sets"][1].update(axes=[0]), "whole number below 1"),
    (lambda told, arrays: told["sets"][1].update(sampling="never"), "sampling"),
    (lambda told, arrays: told.update(inputs=[]), "inputs"),
    (lambda told, arrays: told.update(sensing={"error": -1.0}), "error"),
]


@pytest.fixture(scope="module")
def golden():
    return make_golden.FILE


@pytest.mark.parametrize(("forge", "said"), [*TORUS, *GOLDEN])
def test_a_forgery_is_refused_in_a_line(saved, golden, tmp_path, forge, said):
    given = {"problem": torus()} if (forge, said) in TORUS else {}
    path = shutil.copy(saved if given else golden, tmp_path / "forged.npz")
    with forged(path, named=True) as parts:
        forge(*parts)
    began = time.perf_counter()
    with pytest.raises(sdhj.TableFileError, match=said) as refused:
        sdhj.load(path, **given)
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 500
    assert time.perf_counter() - began < LONGEST
    shown = CliRunner().invoke(main, ["info", str(path)])
    assert shown.exit_code in (0, 2) and "Traceback" not in shown.output


@pytest.mark.parametrize("forgery", but_slow([*FORGERIES, "name"], "bomb"))
def test_forged_tables_of_formulas_are_refused(golden, tmp_path, forgery):
    path = shutil.copy(golden, tmp_path / "forged.npz")
    with forged(path, named=True) as (told, arrays):
        if forgery == "name":
            arrays["tables/one"] = arrays.pop("tables/0")
        else:
            replaced("tables/0", FORGERIES[forgery])(told, arrays)
    if forgery in ("too long", "too short"):  # another table, of an array that can be one
        assert sdhj.load(path).problem.digest == read_head(path)["digest"]
        with pytest.raises(sdhj.TableFileError, match="another problem"):
            sdhj.load(path, problem=make_golden.golden())
        return
    with pytest.raises((sdhj.TableFileError, MemoryError)):
        sdhj.load(path)


@pytest.mark.slow
def test_long_and_deep_formulas_are_read_in_time(golden, tmp_path):
    path = shutil.copy(golden, tmp_path / "deep.npz")
    with forged(path, named=True) as (told, _):
        first = told["formulas"]["functions"]["target"]["lines"]
        count = int(first[-1].split()[1])
        deep = [f"{op} {count + place}" for place, op in enumerate(["exp", "log"] * 20_000)]
        told["formulas"]["functions"]["target"]["lines"] = [*first[:-1], *deep, f"return {count + len(deep)}"]
    began = time.perf_counter()
    table = sdhj.load(path)
    assert time.perf_counter() - began < LONGEST
    assert table.problem.digest == read_head(path)["digest"] != make_golden.golden().digest
