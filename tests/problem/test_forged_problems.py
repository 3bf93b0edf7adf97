"""Files that describe another problem than they were made for: what a forger changes, and who finds it.

The head names its problem by a digest. Where only what is described has changed, whoever reads the file finds it; where
the forger writes the digest that belongs to it, only who has the problem itself: `load(path, problem=)` and
`sdhj verify --problem`.
"""

import dataclasses
import functools
import os
import shutil
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
import zoo
from click.testing import CliRunner
from forging import Claimed, digest, forged

import sdhj
from sdhj.certified.check import verify
from sdhj.cli import main

LONGEST = 10.0  # CPU seconds that an answer may take
SENSING = sdhj.Sensing([0.01, 0.02], 0.01, 0.0, memory=False)
INPUTS = [[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]]


def robot():
    """In a plane, past a post and a wall that is looked up; it senses, and a gust bends its way."""
    wall = sdhj.gridded(np.array([1.0, 0.5, 1.0]), [-2.0], [2.0])

    def drift(q, u):
        return np.stack([u[0] - 0.1 * q[:, 1], u[1] + 0.1 * q[:, 0]], axis=1)

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-2.0, -2.0], [2.0, 2.0], [21, 21], names=["north", "east"]),
        dynamics=sdhj.Dynamics(INPUTS, drift, np.diag([1.0, 1.0]), [0.05, 0.1]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.9, p[:, 1] - 0.7) - 0.7),
        unsafe=[
            sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.2, name="post"),
            sdhj.UnsafeSet((1,), lambda p, t: wall(p), name="wall", sampling="steep"),
        ],
        delta=0.25,
        steps=3,
        sensing=SENSING,
        name="robot",
    )


def other():
    return dataclasses.replace(robot(), dynamics=sdhj.Dynamics(INPUTS, INPUTS, np.eye(2), [0.4, 0.4]))


def hidden():
    """The same with a post that is a black box."""
    post = sdhj.BlackBox(lambda p, t: np.hypot(p[:, 0], p[:, 1]) - 0.2, slope=1.0, rate=0.0)
    return dataclasses.replace(robot(), unsafe=[sdhj.UnsafeSet((0, 1), post, name="post")])


def arm():
    return sdhj.arm_case_study(nodes=9, steps=2)


@cache
def problem(make):
    return make()


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder, made = tmp_path_factory.mktemp("tables"), {}

    def of(make):
        if make not in made:
            made[make] = folder / f"{make.__name__}.npz"
            cells = [63, 63, 18, 18] if make is arm else [24, 24]
            sdhj.solve(problem(make), sdhj.Certified(cells), progress=False, play=False).save(made[make])
        return made[make]

    return of


# ---- what a forger changes


def lines(name, change):
    """A line of a function, the first that has what is to go."""

    def forge(told, arrays):
        text = told["formulas"]["functions"][name]["lines"]
        place = next(k for k, line in enumerate(text) if change[0] in line)
        text[place] = text[place].replace(*change)

    return forge


def put(*path, value):
    """What is told at a place, replaced by a value, or by what a function makes of it."""

    def forge(told, arrays):
        *inner, last = path
        for name in inner:
            told = told[name]
        told[last] = value(told[last]) if callable(value) else value

    return forge


def swapped(*path):
    return put(*path, value=lambda old: old[::-1])


def exchanged(one, other):
    """Two functions in each other's place."""

    def forge(told, arrays):
        functions = told["formulas"]["functions"]
        functions[one], functions[other] = functions[other], functions[one]

    return forge


def array(name, change):
    def forge(told, arrays):
        arrays[name][...] = change(arrays[name][()])

    return forge


def without_the_wall(told, arrays):
    told["sets"].pop()
    del told["formulas"]["functions"]["unsafe 1"]
    del arrays["tables/0"]


def post_twice(told, arrays):
    told["sets"].append(told["sets"][1] | {"name": "another"})
    told["formulas"]["functions"]["unsafe 2"] = told["formulas"]["functions"]["unsafe 0"]


def hexed(old, new):
    return f"const {float(old).hex()}", f"const {float(new).hex()}"


PROBLEMS = {
    "inputs in another order": (robot, swapped("inputs")),
    "inputs by a billionth": (robot, put("inputs", value=lambda old: ((1 + 1e-9) * np.array(old)).tolist())),
    "an interval by a billionth": (robot, put("delta", value=0.25 * (1 + 1e-9))),
    "a name of an axis": (robot, put("grid", "names", 1, value="down")),
    "names of sets": (robot, put("sets", 1, "name", value="wall")),
    "the name of the problem": (robot, put("problem", value="another")),
    "a lower end": (robot, put("grid", "lower", 0, value=-2.5)),
    "an upper end": (robot, put("grid", "upper", 1, value=2.0 + 1e-12)),
    "numbers of nodes": (robot, put("grid", "shape", value=[41, 21])),
    "an axis that closes": (robot, put("grid", "periodic", value=[True, False])),
    "ends that hold": (robot, put("grid", "ends", 0, value=["wall", "wall"])),
    "moving sets another way": (robot, put("view_time", value="sampled")),
    "a set on another axis": (robot, put("sets", 2, "axes", value=[0])),
    "a smaller error": (robot, put("sensing", "error", value=[0.01, 0.01])),
    "no delay": (robot, put("sensing", "delay", value=0.0)),
    "gusts by a billionth": (robot, lines("bounds", hexed(0.1, 0.1 * (1 - 1e-9)))),
    "another sign": (robot, lines("drift", ("sub", "add"))),
    "a weaker gain": (robot, lines("gain", hexed(1.0, 0.5))),
    "the target for the post": (robot, exchanged("target", "unsafe 0")),
    "a wall by a billionth": (robot, array("tables/0", lambda old: old * (1 + 1e-9))),
    "a wall that is wider": (robot, lines("unsafe 1", (f"spacing {float(2).hex()}", f"spacing {float(3).hex()}"))),
    "a set less": (robot, without_the_wall),
    "a set more": (robot, post_twice),
    "values of a black box": (hidden, array("opaque/unsafe 0", lambda old: old - 0.1)),
    "what is stated of a black box": (hidden, put("formulas", "opaque", value={"unsafe 0": "nothing"})),
    "a black box of another name": (hidden, put("formulas", "opaque", value={"unsafe 1": "a BlackBox with slope"})),
}


def recipe(*path, value):
    return put("recipe", "arguments", *path, value=value)


PROBLEMS |= {  # the claims of an arm are those of its recipe
    "a slower pursuer": (arm, recipe("v_p_max", value=0.1)),
    "an obstacle on another way": (arm, recipe("obstacles", 2, "path", "rate", value=1.0)),
    "another arm": (arm, recipe("kinematics", value="printed")),
    "an evader": (arm, put("recipe", "builder", value="evader_case_study")),
}
ONLY_SAID = {"what is stated of a black box"}  # words for people, from which nothing follows


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_what_is_described_is_what_the_head_names(name, saved, tmp_path):
    """And its recipe. Without a problem beside it: neither the table nor the checker reads on."""
    make, forge = PROBLEMS[name]
    path = shutil.copy(saved(make), tmp_path / "forged.npz")
    given = problem(make) if make is hidden else None
    sdhj.load(path, problem=given)
    with forged(path) as parts:
        forge(*parts)
    with pytest.raises(sdhj.TableFileError, match=r"changed after|can(not)? be read|recipe"):
        sdhj.load(path, problem=given)
    with pytest.raises(ValueError, match=r"problem that it describes|of the head|no sense"):
        verify(path, given, samples=1, progress=False)


@pytest.mark.parametrize(
    "name", [name for name, (make, _) in PROBLEMS.items() if make is not arm and name not in ONLY_SAID]
)
def test_who_has_the_problem_finds_what_its_name_hides(name, saved, tmp_path):
    """The forger writes the name that belongs to what is described."""
    make, forge = PROBLEMS[name]
    path = shutil.copy(saved(make), tmp_path / "forged.npz")
    with forged(path, named=True) as (told, arrays):
        forge(told, arrays)
    with pytest.raises(sdhj.TableFileError, match=r"another problem|can(not)? be read"):
        sdhj.load(path, problem=problem(make))


@pytest.mark.parametrize("of", ["robot", "other"])
def test_the_name_of_another_problem_is_found(of, saved, tmp_path):
    """Of the problem given beside it, too."""
    path = shutil.copy(saved(robot), tmp_path / "forged.npz")
    with forged(path) as (told, _):
        told["digest"] = problem(other).digest
    given = problem(globals()[of])
    with pytest.raises(sdhj.TableFileError, match="changed after"):
        sdhj.load(path, problem=given)
    with pytest.raises(ValueError, match="problem that it describes"):
        verify(path, progress=False)
    shown = CliRunner().invoke(main, ["verify", str(path)])
    assert shown.exit_code == 2 and "Traceback" not in shown.output


def test_the_digest_is_what_is_said_of_it(saved):
    """By three readers: the problem, and two that read files, of which one is in `forging`."""
    for make in (robot, hidden):
        with forged(saved(make)) as (told, arrays):
            assert told["digest"] == problem(make).digest == digest(told, arrays)


def test_numbers_of_another_machine_are_let_in(saved):
    near = dataclasses.replace(
        problem(robot), dynamics=sdhj.Dynamics(INPUTS, INPUTS, np.eye(2), [0.05, 0.1]), unsafe=problem(robot).unsafe[:1]
    )
    with pytest.raises(sdhj.TableFileError, match="the formula of drift"):
        sdhj.load(saved(robot), problem=near)
    small = dataclasses.replace(problem(robot), sensing=sdhj.Sensing((0.01, 0.02), 0.01, 0.0, memory=False))
    assert sdhj.load(saved(robot), problem=small).problem is small


# ---- sizes


@pytest.fixture(scope="module")
def forever(tmp_path_factory):
    """A cart that stays on its rail for ever."""
    path = tmp_path_factory.mktemp("rail") / "rail.npz"
    rail = zoo.cart(gust=0.3, grid=sdhj.Grid([-1.0, -4.0], [1.0, 4.0], [41, 41]))
    sdhj.solve(rail, sdhj.Certified([40, 40]), progress=False, play=False).save(path)
    return path


def many_cells(told, arrays):
    """A table of 9e8 cells of which nothing is known, in one megabyte."""
    n = 30_000
    told["cells"].update(shape=[n, n], widths=["1/15000", "1/3750"])
    told["proof"].update(own=[False, False])
    arrays["index"], arrays["pool"] = np.zeros((1, n), np.uint32), np.zeros((1, -(-n // 64)), np.uint64)
    arrays["clear"] = Claimed("uint8", (n * n,))
    arrays.update({name: arrays[name][:, :, :1] for name in ("low", "high")})


def many_tables(told, arrays):
    arrays.update({f"tables/{number}": Claimed("float64", (1 << 24,)) for number in range(60)})


def two_gigabytes(told, arrays):
    arrays["clear"] = Claimed("uint8", (2 * 10**9,))


SIZES = {
    "steps past counting": put("steps", value=10**30),
    "ten million steps": put("steps", value=10**7),
    "steps that are no number": put("steps", value=1e30),
    "parts past counting": put("proof", "parts", value=10**12),
    "cells past counting": put("cells", "shape", value=[10**6, 10**6]),
    "cells of twelve axes": put("cells", "shape", value=[10**6] * 12),
    "nodes past counting": put("grid", "shape", value=[10**9, 10**9]),
    "many zeros": many_cells,
    "many tables": many_tables,
    "two gigabytes": two_gigabytes,
}


READ = """
import sys, time, sdhj
from sdhj.certified.check import verify
for path in sys.argv[1:]:
    for read in (sdhj.load, lambda path: verify(path, progress=False)):
        began = time.process_time()
        try:
            read(path)
            said = "read"
        except (ValueError, MemoryError) as error:
            said = f"{type(error).__name__} {' '.join(str(error).split())}"
        print(said[:300], time.process_time() - began, sep="|")
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="address space is limited as Linux does")
def test_sizes_are_looked_at_before_anything_is_made_of_them(forever, tmp_path):
    """A sentence, soon, from both readers, in a process that has 3 GB of address space."""
    import resource

    paths = [shutil.copy(forever, tmp_path / f"{name}.npz") for name in SIZES]
    for path, forge in zip(paths, SIZES.values(), strict=True):
        with forged(path, named=forge is not many_tables) as parts:
            forge(*parts)
        assert path.stat().st_size < 20_000_000
    given = os.environ | dict.fromkeys(("OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    limited = functools.partial(resource.setrlimit, resource.RLIMIT_AS, (3 * 10**9, 3 * 10**9))
    command = [sys.executable, "-c", READ, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=limited, env=given, check=True)
    lines = [line.split("|") for line in done.stdout.splitlines()]
    for name, (table, _), (checker, _) in zip(SIZES, lines[::2], lines[1::2], strict=True):
        assert checker.startswith(("ValueError", "MemoryError")), (name, checker)
        assert table.startswith(("TableFileError", "MemoryError")) or (name in KNOWN and table == "read"), (name, table)
    assert max(float(seconds) for _, seconds in lines) < LONGEST


KNOWN = {"many zeros", "parts past counting"}  # a table of nothing that fits; and parts of which a table makes nothing


@pytest.mark.slow
def test_for_ever_is_claimed_by_the_sets_themselves(saved, tmp_path):
    """Sets for some steps cannot say that they are for ever."""
    without_target = dataclasses.replace(problem(robot), target=None, sensing=sdhj.Sensing())
    path = tmp_path / "some.npz"
    sdhj.solve(without_target, sdhj.Certified([24, 24]), progress=False, play=False).save(path)
    assert verify(path, progress=False).ok
    with forged(path, named=True) as (told, _):
        told["details"]["endless"] = True
    with pytest.raises(sdhj.TableFileError, match="says to be for"):
        sdhj.load(path, problem=dataclasses.replace(without_target, steps=None))
    with pytest.raises(ValueError, match="for ever"):
        verify(path, progress=False)
