"""Files are whole or not there, nothing but a file is replaced by one, and a table's file says what it is of."""

import dataclasses
import json
import os
import re

import h5py
import numpy as np
import pytest
from forging import forged
from toys import interval_problem, one_row, torus_problem, unicycle_problem

import sdhj
from sdhj.plotting.looks import writable_folder
from sdhj.problem.problem import ROW, ULPS, alike, signed_sums
from sdhj.table import table as table_module
from sdhj.table.files import FORMAT_VERSION, header, replaced_whole, writable_file
from sdhj.table.table import entries


def test_a_file_takes_its_name_when_it_is_whole(tmp_path):
    path = tmp_path / "a.txt"
    with replaced_whole(path) as temporary:
        temporary.write_text("new")
        assert not path.exists() and temporary.suffix == ".txt"
    assert path.read_text() == "new" and os.listdir(tmp_path) == ["a.txt"]


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), replaced_whole(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]


def test_a_link_stays_a_link_to_the_new_file(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    with replaced_whole(tmp_path / "link.txt") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"


@pytest.mark.parametrize("check", [writable_file, lambda path: replaced_whole(path).__enter__()])
def test_what_is_no_file_is_not_replaced(tmp_path, check):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match=r"pipe.*name a file"):
        check(tmp_path / "pipe")
    with pytest.raises(OSError, match="is a folder; name a file"):
        check(tmp_path)
    with pytest.raises(OSError, match=r"cannot write in .*missing.*choose a folder"):
        check(tmp_path / "missing" / "a.txt")


def test_a_folder_is_made_where_it_can_be(tmp_path):
    assert writable_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"cannot write in .*file.*choose a folder"):
        writable_folder(tmp_path / "file" / "c")


# ---- tables


@pytest.fixture(scope="module")
def table():
    return sdhj.solve(torus_problem(nodes=10, steps=3))


@pytest.fixture(scope="module")
def arm_table():
    return sdhj.solve(sdhj.arm_case_study(nodes=7, steps=2))


def same(a, b):
    assert np.array_equal(a.index, b.index) and a.nbytes == b.nbytes
    for k, n in entries(a.steps).tolist():
        assert np.array_equal(a.values(start=k, within=n), b.values(start=k, within=n))
        assert np.array_equal(a.inputs(start=k, within=n), b.inputs(start=k, within=n))
    assert np.array_equal(a.avoid.static, b.avoid.static) and np.array_equal(a.avoid.moving, b.avoid.moving)
    assert (a.avoid.static_axes, a.avoid.moving_axes) == (b.avoid.static_axes, b.avoid.moving_axes)
    assert a.method == b.method and dict(a.details) == dict(b.details)


def test_round_trip_of_a_case_study(arm_table, tmp_path):
    arm_table.save(tmp_path / "arm.h5")
    loaded = sdhj.load(tmp_path / "arm.h5")
    same(arm_table, loaded)
    assert loaded.problem.digest == arm_table.problem.digest
    assert os.listdir(tmp_path) == ["arm.h5"]  # no temporary left


def test_round_trip_of_your_user_problem(table, tmp_path):
    table.save(tmp_path / "own.h5")
    with pytest.raises(sdhj.TableFileError, match="problem="):
        sdhj.load(tmp_path / "own.h5")
    same(table, sdhj.load(tmp_path / "own.h5", problem=torus_problem(nodes=10, steps=3)))
    for other, told in (
        (torus_problem(nodes=10, steps=3, view_time="sampled"), "; view_time is 'swept' there and 'sampled' here$"),
        (torus_problem(nodes=12, steps=3), r"; shape is \(10, 10\) there and \(12, 12\) here$"),
        (dataclasses.replace(torus_problem(nodes=10, steps=3), delta=0.7), "; delta is .* there and 0.7 here$"),
        (
            dataclasses.replace(torus_problem(nodes=10, steps=3), target=sdhj.TargetSet((0, 1), lambda p, t: p[:, 0])),
            "; the values of its functions differ by more than rounding$",
        ),
    ):
        with pytest.raises(sdhj.TableFileError, match=f"another problem.*{told}"):
            sdhj.load(tmp_path / "own.h5", problem=other)


def test_the_file_describes_itself(arm_table, tmp_path):
    """In three lines of text, before the arrays, that anything can show."""
    arm_table.save(tmp_path / "arm.h5")
    first, second, text, _ = (tmp_path / "arm.h5").read_bytes().split(b"\n", 3)
    assert first == f"sdhj look-up table, format {FORMAT_VERSION}".encode() and re.fullmatch(
        b"sha256 [0-9a-f]{64}", second
    )
    told = json.loads(text)
    assert told["sdhj_version"] == sdhj.__version__ and told["method"] == "hji"
    assert "<= 0" in told["convention"] and len(told["digest"]) == 64
    assert {"v_p_max", "pursuer_radius", "half_width", "obstacles"} <= set(told["recipe"]["arguments"])
    assert {"flux", "order", "cfl", "dtype"} <= set(told["details"])
    assert told["grid"]["periodic"] == [True, True, False, False]
    with h5py.File(tmp_path / "arm.h5") as file:
        assert not dict(file.attrs) and all(isinstance(part, h5py.Dataset) for part in file.values())
        assert file["entries"][()].tolist() == entries(2).tolist() and file["index"].shape == (6,)
        assert file["tubes"].shape[0] == file["masks"].shape[0] == file["index"][()].max() + 1


def test_an_unwritable_folder_is_a_clear_error(arm_table, tmp_path):
    with pytest.raises(OSError, match="folder"):
        arm_table.save(tmp_path / "missing" / "arm.h5")


def test_a_failed_write_leaves_the_old_file(arm_table, table, tmp_path, monkeypatch):
    path = tmp_path / "arm.h5"
    arm_table.save(path)
    before = path.read_bytes()

    def fail(*args, **kwargs):
        raise OSError("disk full")

    monkeypatch.setattr(table_module, "entries", fail)
    with pytest.raises(OSError, match="disk full"):
        table.save(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["arm.h5"]


def test_files_that_are_no_table_are_refused(arm_table, tmp_path):
    path = tmp_path / "arm.h5"
    with pytest.raises(FileNotFoundError, match=r"arm\.h5"):
        sdhj.load(path)
    for text in (
        b"",
        b"not HDF5 at all",
        b"sdhj look-up table, format 3\n",
        b"sdhj look-up table, format 3\nsha256 \n{}\n",
    ):
        path.write_bytes(text)
        with pytest.raises(sdhj.TableFileError, match="is damaged, cut short or not a look-up table; solve it anew"):
            sdhj.load(path)
    arm_table.save(path)
    whole = path.read_bytes()
    for version, told in ((FORMAT_VERSION + 1, "upgrade sdhj"), (FORMAT_VERSION - 1, "solve it anew")):
        path.write_bytes(whole.replace(b"format 3", b"format %d" % version, 1))
        for read in (sdhj.load, header):
            with pytest.raises(sdhj.TableFileError, match=f"format version {version}; this is sdhj .*: {told}$"):
                read(path)


def test_files_of_older_formats_are_refused_in_a_sentence(arm_table, tmp_path):
    """Format 2 and those before were HDF5 files from the first byte on."""
    path = tmp_path / "old.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update(format="sdhj look-up table", format_version=2, sdhj_version="0.2.0")
    for read in (sdhj.load, header):
        with pytest.raises(
            sdhj.TableFileError, match=r"without the first lines of a table: an older sdhj wrote it.*solve it anew$"
        ):
            read(path)


def test_equal_tubes_are_written_once(tmp_path):
    table = one_row(sdhj.solve(interval_problem(steps=6, rate=-0.3), progress=False))
    table.save(tmp_path / "small.h5")
    with h5py.File(tmp_path / "small.h5") as file:
        assert len(file["tubes"]) == len(file["masks"]) == 7 and len(file["entries"]) == len(file["index"]) == 28
    same(table, sdhj.load(tmp_path / "small.h5", problem=interval_problem(steps=6, rate=-0.3)))


def test_a_case_study_of_another_version_needs_its_problem(arm_table, tmp_path):
    path = tmp_path / "arm.h5"
    arm_table.save(path)
    with forged(path) as (told, _):
        told["recipe"] = {"builder": "three_link_arm", "arguments": {}}
    with pytest.raises(sdhj.TableFileError, match=r"user-defined problem 'arm_case_study'.*problem="):
        sdhj.load(path)
    with forged(path) as (told, _):
        told["recipe"] = {"builder": "arm_case_study", "arguments": {"wheels": 4}}
    with pytest.raises(sdhj.TableFileError, match=r"not a look-up table that can be read.*differ in the arguments"):
        sdhj.load(path)


def test_the_header_is_what_the_file_says(arm_table, tmp_path):
    arm_table.save(tmp_path / "arm.h5")
    told, problem = header(tmp_path / "arm.h5"), arm_table.problem
    assert told["grid"] == problem.grid and np.array_equal(told["inputs"], problem.inputs)
    assert told["recipe"] == dict(problem.recipe) and told["details"]["flux"] == arm_table.details["flux"]
    for name in ("digest", "delta", "steps", "view_time"):
        assert told[name] == getattr(problem, name)
    assert (told["problem"], told["method"], told["sdhj_version"]) == (problem.name, "hji", sdhj.__version__)
    with pytest.raises(FileNotFoundError, match="no file"):
        header(tmp_path / "none.h5")


# ---- one problem on two machines


def machine(last_bits, *, steps=3, shift=0.0):
    """The problem as a machine computes it whose mathematical library rounds otherwise: values moved by some ulps."""

    def rounded(values):
        random = np.random.default_rng(last_bits)  # a machine rounds alike whenever it is asked
        for _ in range(abs(last_bits)):
            values = np.nextafter(values, np.where(random.random(values.shape) < 0.5, -np.inf, np.inf))
        return values

    problem = unicycle_problem(nodes=(9, 9, 8), steps=steps)
    (part,) = problem.unsafe
    drift, target = problem.dynamics.drift, problem.target
    place = problem.grid.subgrid(part.axes).points()[27]

    def moved(points, t):
        return rounded(part.level_set(points, t)) + shift * (points == place).all(axis=1)

    return dataclasses.replace(
        problem,
        dynamics=dataclasses.replace(problem.dynamics, drift=lambda points, u: rounded(drift(points, u))),
        target=dataclasses.replace(target, level_set=lambda points, t: rounded(target.level_set(points, t))),
        unsafe=(dataclasses.replace(part, level_set=moved),),
    )


def test_a_table_is_read_where_values_are_rounded_otherwise(tmp_path):
    """Every value of every function moved by one unit in the last place, or by as many as are allowed."""
    table = sdhj.solve(machine(0), progress=False)
    table.save(tmp_path / "own.h5")
    for bits in (1, 2, ULPS):
        problem = machine(bits)
        assert problem.digest != table.problem.digest
        same(table, sdhj.load(tmp_path / "own.h5", problem=problem))


@pytest.mark.parametrize("shift", [1e-9, 1e-3, 0.5])
def test_one_value_that_is_another_is_another_problem(tmp_path, shift):
    sdhj.solve(machine(0), progress=False).save(tmp_path / "own.h5")
    for bits in (0, 1):
        with pytest.raises(sdhj.TableFileError, match=r"values of its functions differ by more than rounding$"):
            sdhj.load(tmp_path / "own.h5", problem=machine(bits, shift=shift))


def test_changes_that_would_cancel_are_seen(rng):
    """Pairs of equal and opposite changes, among values of any size."""
    values = rng.normal(size=5000) * 10.0 ** rng.integers(-6, 10, 5000)
    sums = identity_of(values)
    assert alike(sums, identity_of(np.nextafter(values, np.inf)))
    for _ in range(200):
        i, j = rng.choice(np.flatnonzero(np.abs(values) < 1), 2, replace=False)
        changed = values.copy()
        changed[[i, j]] += (1e-6, -1e-6)
        assert not alike(sums, identity_of(changed))


@pytest.mark.parametrize("apart", [1, ROW - 1, ROW, 2 * ROW, 1000])
def test_numbers_that_change_places_are_others(rng, apart):
    values = rng.normal(size=3 * ROW + 5)
    for i in rng.integers(0, ROW, 20):
        changed = values.copy()
        changed[[i, i + apart]] = changed[[i + apart, i]]
        assert not alike(identity_of(values), identity_of(changed))


@pytest.mark.parametrize("factor", [1 + 1e-9, 1.2, 1e6, -1.0])
def test_numbers_that_are_all_larger_are_others(rng, factor):
    """Alone, all equal, or of any size: sums of what is relative to the mean do not tell by themselves."""
    for values in (np.array([0.5]), np.full((3, 2), 0.7).ravel(), rng.normal(size=1000) * 1e-3):
        assert not alike(identity_of(values), identity_of(values * factor))


@pytest.mark.parametrize("part", ["bounds", "gain"])
def test_a_stronger_adversary_is_another_problem(tmp_path, part):
    problem = unicycle_problem(nodes=(9, 9, 8), steps=2)
    sdhj.solve(problem, progress=False).save(tmp_path / "own.h5")
    dynamics = dataclasses.replace(problem.dynamics, **{part: 1.2 * np.asarray(getattr(problem.dynamics, part))})
    with pytest.raises(sdhj.TableFileError, match="another problem"):
        sdhj.load(tmp_path / "own.h5", problem=dataclasses.replace(problem, dynamics=dynamics))


def identity_of(values):
    return np.array([signed_sums(values, 4.0)])


def test_a_recipe_is_compared_as_well(arm_table, tmp_path, monkeypatch):
    """With sums that are alike, as where a change is too small for them."""
    arm_table.save(tmp_path / "arm.h5")
    other = dataclasses.replace(arm_table.problem, delta=arm_table.problem.delta)
    recipe = json.loads(json.dumps(dict(other.recipe)))
    recipe["arguments"]["v_d_max"] *= 1 + 1e-15
    object.__setattr__(other, "recipe", recipe)
    other.__dict__["identity"] = "0" * 64, arm_table.problem.identity[1]
    with pytest.raises(sdhj.TableFileError, match=r"another problem.*; recipe is "):
        sdhj.load(tmp_path / "arm.h5", problem=other)
    object.__setattr__(other, "recipe", dict(arm_table.problem.recipe))
    same(arm_table, sdhj.load(tmp_path / "arm.h5", problem=other))
