"""Files are whole or not there, nothing but a file is replaced by one, and a table's file says what it is of."""

import dataclasses
import json
import os
import pickle
import re
import zipfile

import digest_cases
import forged_robots
import make_golden
import numpy as np
import pytest
from click.testing import CliRunner
from forging import forged
from parameters import but_slow
from zoo import interval_problem, one_row, small_torus_table, torus_problem, unicycle_problem

import sdhj
from sdhj.cli import main
from sdhj.plotting.looks import writable_folder
from sdhj.problem.describing import described
from sdhj.table import files
from sdhj.table import table as table_module
from sdhj.table.files import read_head, replaced_whole, writable_file
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
    with pytest.raises(OSError, match="folder; name a file"):
        check(tmp_path)
    with pytest.raises(OSError, match="cannot write in"):
        check(tmp_path / "missing" / "a.txt")


def test_a_folder_is_made_where_it_can_be(tmp_path):
    assert writable_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="cannot write in"):
        writable_folder(tmp_path / "file" / "c")


# ---- tables


@pytest.fixture(scope="module")
def table():
    return small_torus_table()


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


@pytest.mark.slow
def test_round_trip_of_your_user_problem(table, tmp_path):
    table.save(tmp_path / "own.npz")
    same(table, sdhj.load(tmp_path / "own.npz"))
    same(table, sdhj.load(tmp_path / "own.npz", problem=torus_problem(nodes=10, steps=3)))
    for other, told in (
        (torus_problem(nodes=10, steps=3, view_time="sampled"), "; view_time is swept there and sampled here$"),
        (torus_problem(nodes=12, steps=3), r"; shape is \(10, 10\) there and \(12, 12\) here$"),
        (dataclasses.replace(torus_problem(nodes=10, steps=3), delta=0.7), "; delta is .* there and 0.7 here$"),
        (
            dataclasses.replace(torus_problem(nodes=10, steps=3), target=sdhj.TargetSet((0, 1), lambda p, t: p[:, 0])),
            "; the formula of target is another$",
        ),
    ):
        with pytest.raises(sdhj.TableFileError, match=f"another problem.*{told}"):
            sdhj.load(tmp_path / "own.npz", problem=other)


def test_the_file_describes_itself(arm_table, tmp_path):
    """In JSON, which anything can show; the arrays are NumPy's."""
    arm_table.save(tmp_path / "arm.npz")
    with zipfile.ZipFile(tmp_path / "arm.npz") as file:
        text = file.read("problem.json")
    first, _, rest = text.partition(b"\n")
    assert re.fullmatch(rb'\{"format": 6, "sha256": "[0-9a-f]{64}",', first) and rest.count(b"\n") == 1
    told = json.loads(text)
    assert told["format"] == 6 and told["sdhj_version"] == sdhj.__version__ and told["method"] == "hji"
    assert "<= 0" in told["convention"] and len(told["digest"]) == 64
    assert {"v_p_max", "pursuer_radius", "half_width", "obstacles"} <= set(told["recipe"]["arguments"])
    assert {"flux", "order", "cfl", "dtype"} <= set(told["details"])
    assert told["grid"]["periodic"] == [True, True, False, False]
    assert told["formulas"]["format"] == 1 and told["formulas"]["opaque"] == {}
    functions = told["formulas"]["functions"]
    assert sorted(functions) == ["bounds", "drift", "gain", "swept 0", "target", "unsafe 0", "unsafe 1"]
    assert functions["bounds"]["lines"] == [
        "const 0x1.3333333333333p-2",
        "const 0x1.999999999999ap-3",
        functions["bounds"]["lines"][-1],
    ]
    assert functions["swept 0"]["parameters"] == 2 and functions["unsafe 1"]["coordinates"] == 4
    with np.load(tmp_path / "arm.npz", allow_pickle=False) as arrays:
        assert arrays["entries"].tolist() == entries(2).tolist() and arrays["index"].shape == (6,)
        assert arrays["tubes"].shape[0] == arrays["marks"].shape[0] == arrays["index"].max() + 1


def test_a_failed_write_leaves_the_old_file(arm_table, table, tmp_path, monkeypatch):
    path = tmp_path / "arm.npz"
    arm_table.save(path)
    before = path.read_bytes()

    def fail(*args, **kwargs):
        raise OSError("disk full")

    monkeypatch.setattr(table_module, "entries", fail)
    with pytest.raises(OSError, match="disk full"):
        table.save(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["arm.npz"]


def test_files_that_are_no_table_are_refused(arm_table, tmp_path):
    path = tmp_path / "arm.npz"
    with pytest.raises(FileNotFoundError, match=r"arm\.npz"):
        sdhj.load(path)
    for text in (b"", b"not a zip at all", b"PK\3\4", b"PK\3\4" + bytes(26) + b"problem.json" + bytes(300)):
        path.write_bytes(text)
        with pytest.raises(sdhj.TableFileError, match="damaged"):
            sdhj.load(path)
    np.savez(path, tubes=np.zeros(3))
    with pytest.raises(sdhj.TableFileError, match="damaged"):
        sdhj.load(path)
    arm_table.save(path)
    whole = path.read_bytes()
    for version, told in ((7, "upgrade sdhj"), (5, "solve it anew")):
        path.write_bytes(whole.replace(b'"format": 6', b'"format": %d' % version, 1))
        for read in (sdhj.load, read_head):
            with pytest.raises(sdhj.TableFileError, match=f"format version {version}.*{told}$"):
                read(path)


@pytest.mark.parametrize("begin", [b"\x89HDF\r\n\x1a\n", b"sdhj look-up table, format 5\nsha256 0\n{}\n"])
def test_files_of_older_formats_are_refused_in_a_sentence(tmp_path, begin):
    """Formats 1 and 2 were HDF5 files from the first byte on, 3 to 5 behind three lines of text."""
    path = tmp_path / "old.h5"
    path.write_bytes(begin + bytes(1000))
    for read in (sdhj.load, read_head):
        with pytest.raises(sdhj.TableFileError, match=r"earlier sdhj.*anew$"):
            read(path)


# ---- a file, a folder, and tables that are mapped from them


def unzipped(path):
    with zipfile.ZipFile(path) as file:
        file.extractall(folder := path.with_suffix(""))
    return folder


@pytest.fixture(params=["file", "folder"])
def stored(request, arm_table, tmp_path):
    arm_table.save(path := tmp_path / "arm.npz")
    return path if request.param == "file" else unzipped(path)


def is_mapped(values):
    while isinstance(values, np.ndarray):
        values = values.base
    return isinstance(values, memoryview)


def test_a_table_is_mapped_and_answers_as_before(arm_table, stored, rng):
    loaded = sdhj.load(stored)
    same(arm_table, loaded)
    assert type(loaded) is type(arm_table) and all(map(is_mapped, (loaded.tubes, loaded.marks, loaded.avoid.static)))
    with pytest.raises(ValueError, match="read-only"):
        loaded.tubes[0] = 0.0
    agree(arm_table, loaded, rng)


def test_a_packed_table_is_as_well(arm_table, tmp_path, rng):
    arm_table.save(tmp_path / "packed.npz", compress=True)
    arm_table.save(tmp_path / "plain.npz")
    assert (tmp_path / "packed.npz").stat().st_size < 0.7 * (tmp_path / "plain.npz").stat().st_size
    same(arm_table, sdhj.load(tmp_path / "packed.npz"))
    same(arm_table, sdhj.load(unzipped(tmp_path / "plain.npz")))
    same(arm_table, sdhj.load(unzipped(tmp_path / "packed.npz")))
    with pytest.raises(ValueError, match="compress"):
        arm_table.save(tmp_path / "packed.npz", compress=7)


def test_a_mapped_table_is_pickled_as_its_name(arm_table, stored):
    loaded = sdhj.load(stored)
    text = pickle.dumps(loaded)
    assert len(text) < 1000 < len(pickle.dumps(arm_table))
    again = pickle.loads(text)
    same(arm_table, again)
    changed = dataclasses.replace(loaded, details={})
    assert changed.origin is None and not pickle.loads(pickle.dumps(changed)).details


def test_a_table_whose_file_is_gone_is_pickled_with_its_arrays(arm_table, tmp_path):
    arm_table.save(tmp_path / "arm.npz")
    loaded = sdhj.load(tmp_path / "arm.npz")
    text = pickle.dumps(loaded)
    (tmp_path / "arm.npz").unlink()
    same(arm_table, pickle.loads(pickle.dumps(loaded)))
    with pytest.raises(FileNotFoundError, match="no file"):
        pickle.loads(text)
    dataclasses.replace(arm_table, details={}).save(tmp_path / "arm.npz")
    same(arm_table, pickle.loads(pickle.dumps(loaded)))
    with pytest.raises(sdhj.TableFileError, match="changed since the table"):
        pickle.loads(text)


def test_digests_are_read_of_small_tables_and_where_they_are_asked_for(arm_table, stored, monkeypatch):
    file = stored / "tubes.npy" if stored.is_dir() else stored
    whole = bytearray(file.read_bytes())
    whole[whole.index(b"'<f4'") + 10_000] ^= 1  # in the tubes, or in an avoid tube
    file.write_bytes(whole)
    for check in (None, True):
        with pytest.raises(sdhj.TableFileError, match="is damaged"):
            sdhj.load(stored, check=check)
    assert sdhj.load(stored, check=False).steps == 2
    monkeypatch.setattr(files, "CHECKED", 1000)
    assert sdhj.load(stored).steps == 2
    with pytest.raises(sdhj.TableFileError, match="is damaged"):
        sdhj.load(stored, check=True)
    with pytest.raises(ValueError, match="or None, got 7"):
        sdhj.load(stored, check=7)


def test_info_reads_all_digests(arm_table, tmp_path, monkeypatch):
    arm_table.save(path := tmp_path / "arm.npz")
    monkeypatch.setattr(files, "CHECKED", 1000)
    assert CliRunner().invoke(main, ["info", str(path)]).exit_code == 0
    whole = bytearray(path.read_bytes())
    whole[whole.index(b"'<f4'") + 10_000] ^= 1
    path.write_bytes(whole)
    shown = CliRunner().invoke(main, ["info", str(path)])
    assert shown.exit_code == 2 and re.search("arm.npz.* damaged", shown.output)


def test_certified_tables_are_packed_unless_it_is_said(tmp_path):
    table = sdhj.solve(forged_robots.line(), sdhj.Certified(cells=(40,)), progress=False, play=False)
    for name, said in (("packed", {}), ("plain", {"compress": False})):
        table.save(tmp_path / f"{name}.npz", **said)
        loaded = sdhj.load(tmp_path / f"{name}.npz")
        assert is_mapped(loaded.pool) and (loaded.origin is None) == (name == "packed")  # of a file, or of what it held
        for one in (loaded, pickle.loads(pickle.dumps(loaded))):
            assert np.array_equal(one.index, table.index) and np.array_equal(one.pool, table.pool)
            assert one.contains([[0.3], [3.0]]).tolist() == table.contains([[0.3], [3.0]]).tolist()
    sizes = [(tmp_path / f"{name}.npz").stat().st_size for name in ("packed", "plain")]
    assert sizes[0] < sizes[1]


def test_a_folder_that_is_no_table_is_refused(arm_table, tmp_path):
    with pytest.raises(sdhj.TableFileError, match=r"folder without problem\.json: name"):
        sdhj.load(tmp_path)
    arm_table.save(tmp_path / "arm.npz")
    (unzipped(tmp_path / "arm.npz") / "marks.npy").unlink()
    with pytest.raises(sdhj.TableFileError, match="is damaged"):
        sdhj.load(tmp_path / "arm")


def test_a_table_is_saved_over_the_file_that_it_is_mapped_from(arm_table, tmp_path):
    arm_table.save(tmp_path / "arm.npz")
    loaded = sdhj.load(tmp_path / "arm.npz")
    loaded.save(tmp_path / "arm.npz", compress=True)
    same(loaded, sdhj.load(tmp_path / "arm.npz"))


def test_equal_tubes_are_written_once(tmp_path):
    table = one_row(sdhj.solve(interval_problem(steps=6, rate=-0.3), progress=False))
    table.save(tmp_path / "small.npz")
    with np.load(tmp_path / "small.npz") as file:
        assert len(file["tubes"]) == len(file["marks"]) == 7 and len(file["entries"]) == len(file["index"]) == 28
    same(table, sdhj.load(tmp_path / "small.npz", problem=interval_problem(steps=6, rate=-0.3)))


def test_a_case_study_of_another_version_is_what_its_formulas_say(arm_table, tmp_path):
    """A recipe only says how a problem was made: tables are those of the formulas."""
    path = tmp_path / "arm.npz"
    arm_table.save(path)
    for recipe in ({"builder": "three_link_arm", "arguments": {}}, {}):
        with forged(path) as (told, _):
            told["recipe"] = recipe
        loaded = sdhj.load(path)
        same(arm_table, loaded)
        assert loaded.problem.recipe == recipe and loaded.problem.digest == arm_table.problem.digest
        same(arm_table, sdhj.load(path, problem=arm_table.problem))


def test_the_header_is_what_the_file_says(arm_table, tmp_path):
    arm_table.save(tmp_path / "arm.npz")
    told, problem = read_head(tmp_path / "arm.npz"), arm_table.problem
    assert told["grid"] == problem.grid and np.array_equal(told["inputs"], problem.inputs)
    assert told["recipe"] == dict(problem.recipe) and told["details"]["flux"] == arm_table.details["flux"]
    for name in ("digest", "delta", "steps", "view_time"):
        assert told[name] == getattr(problem, name)
    assert (told["problem"], told["method"], told["sdhj_version"]) == (problem.name, "hji", sdhj.__version__)
    with pytest.raises(FileNotFoundError, match="no file"):
        read_head(tmp_path / "none.npz")


# ---- tables of any robot, from the file alone


def gridded_problem():
    """Past a wall that is looked up in a table."""
    axes = np.linspace(-3.2, 3.2, 17)
    x, y = np.meshgrid(axes, axes, indexing="ij")
    wall = sdhj.gridded(np.hypot(x - 1.5, y) - 0.9, [-3.2, -3.2], [0.4, 0.4])
    part = sdhj.UnsafeSet((0, 1), lambda p, t: wall(p) + 0.1 * t, name="wall")
    return dataclasses.replace(torus_problem(nodes=12, steps=2), unsafe=(part,))


def turned_problem():
    """A car whose heading the adversary turns: it does not enter linearly, and its bounds depend on the state."""

    def velocity(q, u, v):
        heading = q[:, 2] + v[0]
        return np.stack([np.cos(heading), np.sin(heading), np.full(len(q), u[0])], axis=1)

    problem = unicycle_problem(nodes=(9, 9, 8), steps=2)
    dynamics = sdhj.Dynamics(problem.inputs, velocity=velocity, bounds=lambda q: 0.1 + 0.1 * q[:, :1] ** 2)
    return dataclasses.replace(problem, dynamics=dynamics, unsafe=())


def small_torus():
    return torus_problem(nodes=12, steps=2)


CASES = {
    "projected": (small_torus, "projected"),
    "lax": (small_torus, "lax"),
    "certified": (small_torus, sdhj.Certified(cells=(24, 24), parts=3)),
    "gridded": (gridded_problem, "hji"),
    "gridded, certified": (gridded_problem, sdhj.Certified(cells=(24, 24))),
    "swept": (lambda: digest_cases.moving(True), "lax"),
    "velocity": (turned_problem, "hji"),
    "velocity, certified": (turned_problem, sdhj.Certified(cells=(12, 12, 16))),
    "time and state": (lambda: digest_cases.tide(turning=True), "hji"),
    "sensing": (lambda: dataclasses.replace(small_torus(), sensing=sdhj.Sensing(0.02, 0.01, memory=False)), "lax"),
    "safe ends": (lambda: digest_cases.cart(["safe", "wall"], unsafe=digest_cases.posts()), "hji"),
}


def agree(one, other, rng):
    """Sets, answers and runs of two tables are the same bit for bit."""
    assert one.problem.digest == other.problem.digest and one.method == other.method
    assert json.loads(json.dumps(dict(one.details))) == dict(other.details)
    grid = one.grid
    states = rng.uniform(grid.lower, grid.upper, (200, grid.ndim))
    for start, within in entries(one.steps).tolist():
        for name in ("values", "inputs"):
            a, b = (getattr(table, name)(start=start, within=within) for table in (one, other))
            assert np.array_equal(a, b), (name, start, within)
        assert np.array_equal(*(table.contains(states, start=start, within=within) for table in (one, other)))
    for step in range(one.steps):
        a, b = (table.batch(states, step) for table in (one, other))
        assert np.array_equal(a.margins, b.margins, equal_nan=True) and np.array_equal(a.safe, b.safe)
    runs = [
        sdhj.monte_carlo(sdhj.Controller(table), 30, "worst", seed=1, progress=False)
        for table in (one, other)
        if one.fraction(start=0, within=one.steps) > 0
    ]
    assert all(np.array_equal(run.outcomes, runs[0].outcomes) for run in runs)
    assert all(np.array_equal(run.starts, runs[0].starts) for run in runs)


LONG = ["gridded, certified", "swept", "velocity", "velocity, certified", "time and state"]


@pytest.mark.filterwarnings("ignore::sdhj.ResolutionWarning")
@pytest.mark.parametrize("name", but_slow(CASES, *LONG))
def test_a_table_of_any_robot_is_read_from_its_file_alone(name, tmp_path, rng):
    problem, method = CASES[name]
    table = sdhj.solve(problem(), method, progress=False)
    table.save(tmp_path / "own.npz")
    loaded = sdhj.load(tmp_path / "own.npz")
    agree(table, loaded, rng)
    loaded.save(tmp_path / "again.npz")  # and is written as it was
    heads = [read_head(tmp_path / f"{name}.npz") for name in ("own", "again")]
    assert heads[0]["formulas"] == heads[1]["formulas"] and heads[0]["sets"] == heads[1]["sets"]


def test_the_golden_file_is_still_read(rng):
    """Written by a former version: `tests/make_golden.py`."""
    table, problem = sdhj.load(make_golden.FILE), make_golden.golden()
    assert read_head(make_golden.FILE)["formulas"] == json.loads(json.dumps(described(problem)["formulas"]))
    same(table, sdhj.load(make_golden.FILE, problem=problem))
    points, t = rng.uniform([-1.0, 0.0], [1.0, 2.0], (50, 2)), 0.3
    x, y = points.T
    post = np.hypot(x - 0.5 + 0.2 * t, y - 1.0) - 0.4
    stairs = np.interp(x, [-1.0, 0.0, 1.0], [0.75, 0.5, -0.25])
    assert np.allclose(table.problem.unsafe_value(points, t), np.minimum(post, stairs), rtol=0, atol=1e-14)
    assert np.allclose(table.problem.target_value(points, t), abs(x + 0.5) - 0.25, rtol=0, atol=1e-15)
    assert table.fraction(start=0, within=0) < table.fraction(start=0, within=2) < 1.0
    assert len(make_golden.FILE.read_bytes()) < 30_000


# ---- one problem on two machines


def machine(change, *, black=False):
    """A problem whose constants are another machine's: they differ by a factor."""
    wide, fast = 0.5 * (1.0 + change), 2.0 * (1.0 - change)
    pillar = lambda p, t: np.hypot(p[:, 0] - 0.8, p[:, 1]) - 0.4 * wide  # noqa: E731
    problem = unicycle_problem(nodes=(9, 9, 8), steps=2)
    part = sdhj.UnsafeSet((0, 1), sdhj.BlackBox(pillar, slope=1.0, rate=0.0) if black else pillar, sampling="steep")

    def drift(q, u):
        return np.stack([np.cos(fast * q[:, 2] / 2.0), np.sin(q[:, 2]), np.full(len(q), fast * u[0])], axis=1)

    dynamics = sdhj.Dynamics(problem.inputs, drift, np.eye(3)[:, :2] * (1.0 + change), [0.1, 0.1 * (1.0 + change)])
    return dataclasses.replace(problem, dynamics=dynamics, unsafe=(part,))


@pytest.mark.slow
@pytest.mark.parametrize("black", [False, True], ids=["formulas", "black box"])
def test_a_table_is_read_where_constants_are_rounded_otherwise(black, tmp_path):
    table = sdhj.solve(machine(0.0, black=black), progress=False)
    table.save(tmp_path / "own.npz")
    for change in (1e-13, -3e-13):
        problem = machine(change, black=black)
        assert problem.digest != table.problem.digest
        loaded = sdhj.load(tmp_path / "own.npz", problem=problem)
        same(table, loaded)
        assert loaded.problem is problem
    for change in (1e-9, -1e-3):
        with pytest.raises(sdhj.TableFileError, match=r"formula of (bounds|drift)"):
            sdhj.load(tmp_path / "own.npz", problem=machine(change, black=black))


def test_a_black_box_needs_its_problem_and_is_known_by_its_values(tmp_path):
    path = tmp_path / "own.npz"
    table = sdhj.solve(machine(0.0, black=True), progress=False)
    table.save(path)
    with pytest.raises(sdhj.TableFileError) as refused:
        sdhj.load(path)
    assert re.search(r"unsafe 0: a BlackBox with slope, rate.*load\(path, ", str(refused.value))
    assert "\n" not in str(refused.value)
    with np.load(path) as file:
        assert file["opaque.unsafe 0"].shape == (1000,)
    (part,) = table.problem.unsafe
    for moved, told in ((1e-9, "values of unsafe 0"), (1e-14, "")):
        other = sdhj.BlackBox(lambda p, t, moved=moved: part.level_set(p, t) + moved, slope=1.0, rate=0.0)
        problem = dataclasses.replace(table.problem, unsafe=(dataclasses.replace(part, level_set=other),))
        if told:
            with pytest.raises(sdhj.TableFileError, match=told):
                sdhj.load(path, problem=problem)
        else:
            same(table, sdhj.load(path, problem=problem))
    plain = dataclasses.replace(machine(0.0), unsafe=machine(0.0).unsafe)
    with pytest.raises(sdhj.TableFileError, match=r"boxes are \['unsafe 0'\]"):
        sdhj.load(path, problem=plain)


def test_a_stronger_adversary_is_another_problem(tmp_path):
    problem = unicycle_problem(nodes=(9, 9, 8), steps=2)
    sdhj.solve(problem, progress=False, play=False).save(tmp_path / "own.npz")
    dynamics = sdhj.Dynamics(problem.inputs, problem.dynamics.drift, 1.2 * np.eye(3)[:, :2], [0.1, 0.1])
    with pytest.raises(sdhj.TableFileError, match=r"another problem.*formula of gain"):
        sdhj.load(tmp_path / "own.npz", problem=dataclasses.replace(problem, dynamics=dynamics))
