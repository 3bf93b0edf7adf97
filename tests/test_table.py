"""The look-up table in memory and on disk."""

import dataclasses
import os
import re

import h5py
import numpy as np
import pytest
from toys import interval_problem, torus_problem

import sdhj
from sdhj.table import FORMAT_VERSION


@pytest.fixture(scope="module")
def table():
    return sdhj.solve(torus_problem(nodes=10, steps=3))


@pytest.fixture(scope="module")
def arm_table():
    return sdhj.solve(sdhj.arm_case_study(nodes=7, steps=2))


def same(a, b):
    for k in range(a.steps + 1):
        for n in range(a.steps - k + 1):
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


def test_round_trip_of_your_own_problem(table, tmp_path):
    table.save(tmp_path / "own.h5")
    with pytest.raises(sdhj.TableFileError, match="problem="):
        sdhj.load(tmp_path / "own.h5")
    same(table, sdhj.load(tmp_path / "own.h5", problem=torus_problem(nodes=10, steps=3)))
    for other, told in (
        (torus_problem(nodes=10, steps=3, view_time="sampled"), "; view_time is 'swept' there and 'sampled' here$"),
        (torus_problem(nodes=12, steps=3), r"; shape is \[10, 10\] there and \[12, 12\] here$"),
        (dataclasses.replace(torus_problem(nodes=10, steps=3), delta=0.7), "; delta is .* there and 0.7 here$"),
        (
            dataclasses.replace(torus_problem(nodes=10, steps=3), target=sdhj.TargetSet((0, 1), lambda p, t: p[:, 0])),
            "; what differs are the values of its functions",
        ),
    ):
        with pytest.raises(sdhj.TableFileError, match=f"another problem.*{told}"):
            sdhj.load(tmp_path / "own.h5", problem=other)


def test_a_table_is_shown_in_a_line(table):
    share = f"{table.fraction(start=0, within=3):.1%}"
    assert re.fullmatch(
        rf"<LookupTable of .*, method '.*': 10 x 10 nodes, 9 inputs, 3 steps of .* s; {share} of .*>", repr(table)
    )


def test_the_file_describes_itself(arm_table, tmp_path):
    arm_table.save(tmp_path / "arm.h5")
    with h5py.File(tmp_path / "arm.h5") as file:
        attrs = dict(file.attrs)
        assert attrs["sdhj_version"] == sdhj.__version__ and attrs["method"] == "hji"
        assert "<= 0" in attrs["convention"] and len(attrs["digest"]) == 64
        for word in ("v_p_max", "pursuer_radius", "half_width", "obstacles"):
            assert word in attrs["recipe"]
        for word in ("flux", "order", "cfl", "dtype"):
            assert word in attrs["details"]
        assert file["grid"].attrs["periodic"].tolist() == [True, True, False, False]
        assert file["tubes"].shape[0] == len(file["entries"]) == 6


def test_an_unwritable_folder_is_a_clear_error(arm_table, tmp_path):
    with pytest.raises(OSError, match="folder"):
        arm_table.save(tmp_path / "missing" / "arm.h5")


def test_a_failed_write_leaves_the_old_file(arm_table, table, tmp_path, monkeypatch):
    path = tmp_path / "arm.h5"
    arm_table.save(path)
    before = path.read_bytes()

    def fail(*args, **kwargs):
        raise OSError("disk full")

    monkeypatch.setattr(type(table), "_write", fail)
    with pytest.raises(OSError, match="disk full"):
        table.save(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["arm.h5"]


def test_files_that_are_no_table_are_refused(arm_table, tmp_path):
    path = tmp_path / "arm.h5"
    with pytest.raises(FileNotFoundError, match=r"arm\.h5"):
        sdhj.load(path)
    path.write_bytes(b"not HDF5 at all")
    with pytest.raises(sdhj.TableFileError, match="damaged"):
        sdhj.load(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(sdhj.TableFileError, match="no look-up table"):
        sdhj.load(path)
    arm_table.save(path)
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = FORMAT_VERSION + 1
    with pytest.raises(sdhj.TableFileError, match="upgrade"):
        sdhj.load(path)


@pytest.mark.parametrize("digest", [7, 1.5, np.bytes_(b"abc"), ["a", "b"]])
def test_a_digest_of_another_kind_is_refused(arm_table, tmp_path, digest):
    path = tmp_path / "arm.h5"
    arm_table.save(path)
    with h5py.File(path, "r+") as file:
        file.attrs["digest"] = digest
    with pytest.raises(sdhj.TableFileError, match="digest"):
        sdhj.load(path)


@pytest.mark.parametrize("name", ["static", "moving"])
def test_edited_axes_of_avoid_tubes_are_refused(arm_table, tmp_path, name):
    path = tmp_path / "arm.h5"
    arm_table.save(path)
    with h5py.File(path, "r+") as file:
        attrs = file[f"avoid_{name}"].attrs
        attrs["axes"] = [3 - axis for axis in attrs["axes"]]
    with pytest.raises(sdhj.TableFileError, match="checksum"):
        sdhj.load(path)


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(arm_table, tmp_path, keep):
    path = tmp_path / "arm.h5"
    arm_table.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * keep)])
    with pytest.raises(sdhj.TableFileError):
        sdhj.load(path)


def test_flipped_bytes_never_pass_unnoticed(arm_table, tmp_path, rng):
    """A flipped byte is refused, or lies where nothing is stored and changes nothing."""
    path = tmp_path / "arm.h5"
    arm_table.save(path)
    whole = bytearray(path.read_bytes())
    refused = 0
    for place in rng.integers(0, len(whole), size=60):
        broken = bytearray(whole)
        broken[place] ^= 0xFF
        path.write_bytes(broken)
        try:
            loaded = sdhj.load(path)
        except sdhj.TableFileError:
            refused += 1
        else:
            same(arm_table, loaded)
    assert refused > 20


def test_values_cannot_be_modified_and_indices_are_checked(table):
    with pytest.raises(ValueError):
        table.values(start=0, within=1)[0, 0] = 1.0
    for bad in (
        {"start": 4, "within": 0},
        {"start": -1, "within": 0},
        {"start": 0, "within": -1},
        {"start": 0.5, "within": 1},
        {"start": 0, "within": float("nan")},
        {"start": 0, "within": np.inf},
        {"start": 0, "within": None},
        {"start": 0, "within": "1"},
        {"start": True, "within": 1},
    ):
        with pytest.raises(ValueError, match="whole number"):
            table.values(**bad)


def test_contains_on_and_off_the_grid(table):
    grid = table.grid
    inside = table.values(start=0, within=2).ravel() <= 0
    assert np.array_equal(table.contains(grid.points(), start=0, within=2), inside)
    turned = grid.points() + np.array([2 * np.pi, -4 * np.pi])
    safely = np.abs(table.values(start=0, within=2).ravel()) > 1e-5
    assert np.array_equal(table.contains(turned, start=0, within=2)[safely], inside[safely])
    with pytest.raises(ValueError, match="NaN"):
        table.contains([[np.nan, 0.0]], start=0, within=1)
    with pytest.raises(ValueError, match="shape"):
        table.contains([[0.0, 0.0, 0.0]], start=0, within=1)


def test_off_a_bounded_axis_nothing_is_contained():
    table = sdhj.solve(interval_problem(steps=2, unsafe=False))
    assert table.contains([[0.0], [4.1], [-4.1]], start=0, within=2).tolist() == [True, False, False]


def test_fraction_is_a_share_of_volume(table):
    assert table.fraction(start=0, within=2) == pytest.approx((table.values(start=0, within=2) <= 0).mean())
    bounded = sdhj.solve(interval_problem(nodes=9, steps=1, unsafe=False))
    # nodes -4, -3, ..., 4; the target |q| <= 1 holds three of the eight cells' worth
    assert bounded.fraction(start=0, within=0) == pytest.approx(3 / 8)


def test_digest_sees_every_part_of_a_problem():
    problem = torus_problem(nodes=8)
    (part,) = problem.unsafe
    changed = [
        dataclasses.replace(problem, delta=0.21),
        dataclasses.replace(problem, steps=4),
        dataclasses.replace(problem, view_time="sampled"),
        dataclasses.replace(problem, unsafe=()),
        dataclasses.replace(problem, unsafe=(dataclasses.replace(part, rate=3.0),)),
        dataclasses.replace(problem, dynamics=dataclasses.replace(problem.dynamics, bounds=[0.4, 0.5])),
        dataclasses.replace(problem, dynamics=dataclasses.replace(problem.dynamics, gain=2 * np.eye(2))),
        torus_problem(nodes=9),
    ]
    digests = {p.digest for p in changed}
    assert len(digests) == len(changed) and problem.digest not in digests
    assert torus_problem(nodes=8).digest == problem.digest
