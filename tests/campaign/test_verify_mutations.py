"""Every step of formulas, intervals and the arm's checker is needed: without it, a test in tests/certified/check fails.

Each case puts something else into a copy of the library, and runs that test on the copy, without compiling.
"""

import multiprocessing
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import pytest

pytestmark = pytest.mark.campaign

TESTS = Path(__file__).parents[1]
LIBRARY = TESTS.parent / "sdhj"

EXACT, FORMS, TABLES, TEXT = "test_every_exact", "test_closed_forms", "test_tables_are_interpolated", "test_what_is_no"
COVER, LISTS, REFUSED = "test_cells_that_do_not", "test_image_lists", "test_numbers_beyond"
ROW, CLEAR, FLAGS = "test_nothing_that_samples", "test_what_is_proved", "test_flags_that"
FARTHER, DISK, HAIR, HALF = "test_no_point", "test_a_disk_stays", "test_contact_is_met", "test_half_planes_prove"
BOXES = "test_boxes_cover"
EROSION, SURVEY, BESIDE, TIPS = "test_erosion", "test_survey", "test_states_beside", "test_tips"

# the file of the checker, the test that must fail, and what stands there with what stands there instead
MUTATIONS = {
    "2 pi from below": ("arm/claims.py", COVER, "least <= shortest", "True"),
    "2 pi from above": ("arm/claims.py", COVER, "most >= longest", "True"),
    "doubt about 2 pi": ("arm/claims.py", COVER, "most - least <= doubt", "True"),
    "the last cell": ("arm/claims.py", COVER, "n * width >= most", "True"),
    "the agent's box": ("arm/claims.py", COVER, "[(-box, 2", "[(-box, 0", "Fraction(0))]", "Fraction(9))]"),
    "where the box begins": ("arm/claims.py", COVER, "begin in (None, low)", "True"),
    "slow end": ("arm/claims.py", LISTS, "+ back -", "+ 0 -"),
    "fast end": ("arm/claims.py", LISTS, "+ ahead +", "+ 0 +"),
    "errors of both measurements": ("arm/claims.py", LISTS, "2 * arm.scene.off(axis)", "arm.scene.off(axis)"),
    "a late end": ("arm/claims.py", LISTS, 'decimal(self.given["delta"]) + late', "decimal(self.given['delta'])"),
    "a late begin": ("arm/separation.py", DISK, "(box[9] - box[8]) / 2 + world.late", "(box[9] - box[8]) / 2"),
    "error of a joint": ("arm/separation.py", BESIDE, "world.off[joint] + STATE_ERROR", "STATE_ERROR"),
    "error of the agent": (
        "arm/separation.py",
        BESIDE,
        "world.agent[0] * tau1 + world.off[axis]",
        "(world.agent[0] * tau1)",
    ),
    "error in a half plane": ("arm/separation.py", "test_half_planes_count", "max(world.off[2], world.off[3])", "0"),
    "laps": ("arm/claims.py", LISTS, "(-2, -1, 0, 1, 2)", "(0,)"),
    "numbers that are let in": ("arm/claims.py", REFUSED, "(numbers <= LONGEST_LENGTH).all()", "True"),
    "numbers below zero": ("arm/claims.py", REFUSED, "not least >= 0.0", "False"),
    "linear term of joint 1": ("arm/separation.py", FARTHER, "a + abs(side_a) * d1", "a"),
    "linear term of the tip": ("arm/separation.py", FARTHER, "abs(side_a + turn * side_b) * d1", "0"),
    "linear term of joint 2": (
        "arm/separation.py",
        FARTHER,
        "= a + b +",
        "= a +",
        "abs(side_a + turn * side_b) * d1",
        "b",
        "abs(side_b) * d2",
        "abs((side_a + turn * side_b)) * d1",
    ),
    "bend of joint 1": ("arm/separation.py", FARTHER, "max(-a, 0.0)", "0"),
    "bend of joint 2": ("arm/separation.py", FARTHER, "max(-b, 0.0)", "0"),
    "the base": ("arm/separation.py", FARTHER, "max(elbow, 0.0)", "elbow"),
    "the elbow": ("arm/separation.py", FARTHER, "return max(elbow, tip", "return max((-1.0), tip"),
    "move of a disk": ("arm/separation.py", DISK, "half * vx", "0", "half * vy", "0"),
    "bend of a path": ("arm/separation.py", DISK, "abs(disk[4]) * (disk[5] * half) ** 2 / 2", "0"),
    "rounding": ("arm/separation.py", HAIR, "ROUNDING = 1e-11 ", "ROUNDING = 0 "),
    "error of states": ("arm/separation.py", BESIDE, "= 1e-10 ", "= 0 "),
    "radius": (
        "arm/separation.py",
        HAIR,
        "> body[7] + ROUNDING:",
        "> ROUNDING:",
        "> body[7] + ROUNDING,",
        "> ROUNDING,",
    ),
    "disturbance": ("arm/separation.py", CLEAR, "velocity[joint] + part[10 + 2 * joint]", "velocity[joint]"),
    "disturbance of a row": (
        "arm/rows.py",
        "test_half_planes_count",
        "= -world.push, world.push, -world.push, world.push",
        "= 0, 0, 0, 0",
    ),
    "start of the time": ("arm/separation.py", CLEAR, "min(slow * tau0, slow * tau1)", "(slow * tau0)"),
    "end of the time": ("arm/separation.py", CLEAR, "max(fast * tau0, fast * tau1)", "(fast * tau0)"),
    "move of the agent": ("arm/separation.py", CLEAR, "world.agent[0] * tau1 + world.off[axis]", "world.off[axis]"),
    "half of the time": ("arm/separation.py", CLEAR, "second[2 * axis", "second[(2 * axis + (axis == 4))"),
    "half of the disturbance": (
        "arm/separation.py",
        "test_all_that_a_dist",
        "second[2 * axis",
        "second[(2 * axis + (axis > 4))",
    ),
    "half of the box": ("arm/separation.py", CLEAR, "second[2 * axis", "second[(2 * axis + (axis < 4))"),
    "second link": (
        "arm/separation.py",
        CLEAR,
        "for link in range(2):\n            if not link_clear(link, body, part, velocity, start, world, stack):",
        "for link in range(1):\n            if not link_clear(link, body, part, velocity, start, world, stack):",
    ),
    "cell of the agent": ("arm/separation.py", CLEAR, "abs(nx) * hx + abs(ny) * hy", "0"),
    "move in a half plane": (
        "arm/separation.py",
        HALF,
        "world.agent[0] * box[9] + max(world.off[2], world.off[3])",
        "max(world.off[2], world.off[3])",
    ),
    "parts of a sweep": ("arm/separation.py", HALF, "range(parts", "range(1"),
    "far edge of a column": ("arm/separation.py", HALF, "0 if nx > 0.0 else 1", "0"),
    "width of a half plane": ("arm/separation.py", HALF, "bound + abs(nx) * grow", "(bound - abs(nx) * grow)"),
    "lower end of a column": ("arm/separation.py", HALF, "y[first] >= low[x]", "(y[first] > y[-1])"),
    "bend of the tip": ("arm/separation.py", TIPS, "furthest + rest + ROUNDING", "furthest"),
    "turn of the tip": ("arm/separation.py", TIPS, "in (-d1, d1", "in (0, 0"),
    "size of the evader": ("arm/separation.py", ROW, "abs(off_x) + hx", "off_x", "abs(off_y) + hy", "off_y"),
    "all of erosion": (
        "arm/bits.py",
        EROSION,
        "every &= (near >> bit) | (following << 1 << (63 - bit)) | ~needs",
        "every = near >> bit | following << 1 << 63 - bit | ~needs",
    ),
    "all of a column": (
        "arm/bits.py",
        EROSION,
        "((0, along_x, len(along_y)), (1, along_y, 1))",
        "((0, along_x, len(along_y)),)",
    ),
    "sets that grow": ("arm/claims.py", SURVEY, "(pool[less[rows]] & ~pool[here[rows]]).any()", "False"),
    "all ends of joint 1": ("arm/rows.py", ROW, "ends1.size", "1"),
    "all ends of joint 2": ("arm/rows.py", ROW, "ends2.size", "1"),
    "one step less": ("arm/rows.py", ROW, "place + steps - start", "min(place + steps - start + 1, len(todo) - 1)"),
    "reach and clear at once": ("arm/rows.py", ROW, "able[place] & need", "need"),
    "inputs that are allowed": (
        "arm/rows.py",
        ROW,
        "within > 0 and stored.allowed[start, j, i1, i2] and any_bit(todo[place])",
        "(within > 0 and any_bit(todo[place]))",
    ),
    "many cells at once": ("arm/rows.py", ROW, "sweep(j, world.held, world, bench, need)", "pass"),
    "cells one by one": ("arm/rows.py", ROW, "drop_unproved(world.inputs[j], world.held, world, bench, need)", "pass"),
    "many cells at a goal": ("arm/rows.py", ROW, "sweep(0, 0.0, world, bench, near)", "pass"),
    "the pursuer at a goal": ("arm/rows.py", ROW, "drop_unproved(still, 0.0, world, bench, need)", "pass"),
    "obstacles at a goal": (
        "arm/rows.py",
        ROW,
        "clear((0, len(world.disks)), bench.part, still, t, world, bench.stack)",
        "True",
    ),
    "the target at its time": (
        "arm/rows.py",
        ROW,
        "not world.chased or tip_inside(bench.part, t, world, bench.stack)",
        "True",
    ),
    "the evader's tips": ("arm/rows.py", ROW, "not tip_inside(bench.part, 0.0, world, bench.stack)", "False"),
    "outward rounding": ("intervals.py", EXACT, "low - (by * np.abs(low) + least)", "low"),
    "underflow": ("intervals.py", EXACT, "5e-324", "0"),
    "not below zero": ("intervals.py", FORMS, "return np.maximum(low, least), high", "return low, high"),
    "signs of products": ("intervals.py", FORMS, "np.where(same_sign, np.maximum(low, 0.0), low)", "low"),
    "a divisor of zero": ("intervals.py", FORMS, "(b[0] <= 0) & (b[1] >= 0)", "(b[0] > b[1])"),
    "a share of zero": ("intervals.py", EXACT, "np.where(zero, known - 1.0, low)", "low"),
    "odd powers": ("intervals.py", EXACT, "np.where(a[0] < 0, -up, down)", "down"),
    "a base of zero": ("intervals.py", EXACT, "(a[0] == 0) & (b[0] > 0)", "(a[0] == 0)"),
    "NumPy's powers of one": ("intervals.py", "test_what_is_undefined", "~defined | np.isnan(b[0])", "(~defined)"),
    "hills": ("intervals.py", EXACT, "np.where(hills, 1.0, high)", "high"),
    "valleys": ("intervals.py", EXACT, "np.where(valleys, -1.0, low)", "low"),
    "poles": ("intervals.py", FORMS, "unless(pole", "unless(np.isnan(begin)"),
    "the jump of an angle": ("intervals.py", EXACT, "(y[0] <= 0) & (y[1] >= 0) & (x[0] <= 0)", "(x[0] > x[1])"),
    "laps of a rest": (
        "intervals.py",
        FORMS,
        "np.where(first == last, np.maximum(remainder[0], least), least)",
        "remainder[0]",
    ),
    "the part below a jump": ("intervals.py", EXACT, "side == 0", "True"),
    "the last of two laps": ("intervals.py", EXACT, "(first, last)[side]", "first"),
    "all sides of jumps": ("formulas.py", "test_every_value_is_on", "every[1:])]", "every[2:])]"),
    "NaN in a comparison": (
        "intervals.py",
        "test_what_is_undefined",
        "np.isnan(a[0]) | np.isnan(b[0])",
        "np.isnan(a[0])",
    ),
    "an open condition": ("intervals.py", EXACT, "np.where(no, b[0], np.minimum(a[0], b[0]))", "b[0]"),
    "nodes in a box": ("intervals.py", TABLES, "begin + 1.0,", "begin + 0,"),
    "the lower end in a table": ("intervals.py", TABLES, "begin * along[1]", "0"),
    "the upper end in a table": ("intervals.py", TABLES, "end * along[-1]", "0"),
    "endless ends": ("intervals.py", FORMS, "np.isfinite(low) & np.isfinite(high)", "(~np.isnan(low + high))"),
    "what is taken away": ("intervals.py", EXACT, "neg(b)", "(-b[0], -b[1])"),
    "all corners": (
        "intervals.py",
        EXACT,
        "[of(p, q) for p in a for q in b]",
        "[of(p, q) for p, q in zip(a, b, strict=True)]",
    ),
    "least absolute values": ("intervals.py", EXACT, "np.maximum(a[0], -a[1]), 0.0", "a[0], (-a[1])"),
    "most absolute values": ("intervals.py", EXACT, "np.maximum(-a[0], a[1])", "a[1]"),
    "even powers": ("intervals.py", EXACT, "n % 2 == 0", "False"),
    "errors of functions": ("intervals.py", EXACT, "2.0**-49", "0"),
    "what falls": ("intervals.py", EXACT, "np.arccos(a[1]), np.arccos(a[0])", "np.arccos(a[0]), np.arccos(a[1])"),
    "sizes of both sides": ("intervals.py", EXACT, "= size(a),", "= a,", "size(b)", "b"),
    "what is surely less": ("intervals.py", EXACT, "< b[0], a[0]", "< b[1], a[0]"),
    "what is never less": ("intervals.py", EXACT, "> b[1], a,", "> b[0], a,"),
    "what is surely equal": ("intervals.py", FORMS, "(a[0] == b[1]) & (a[1] == b[0])", "(a[0] == b[0])"),
    "what is not": ("intervals.py", EXACT, "- a[1], 1.0", "- a[0], 1.0", "- a[0])),", "- a[1])),"),
    "rounding of tables": (
        "intervals.py",
        TABLES,
        "2.0**table.ndim + 2 * table.ndim",
        "0",
        "2.0 ** len(sizes) + 2 * len(sizes)",
        "0",
    ),
    "a table as a whole": ("intervals.py", TABLES, "[table.max()]", "[table.min()]"),
    "what is read": ("formulas.py", "test_what_it_reads", "number in (None, *node.given)", "(number is None)"),
    "later lines": ("formulas.py", TEXT, "tuple(self.whole(word, len(self.nodes)", "tuple(self.whole(word, (10 ** 6)"),
    "lines": ("formulas.py", TEXT, "1 <= len(lines) <= MOST_LINES", "True"),
    "exponents": ("formulas.py", TEXT, "abs(exponent) <= MOST_EXPONENT", "True"),
    "truth values": ("formulas.py", TEXT, "self.truths.issuperset(truths)", "True"),
    "flags": ("arm/rows.py", FLAGS, "failed + 1", "failed"),
    "time of a flag": ("arm/rows.py", FLAGS, "start * world.delta + world.begin", "0"),
}

# Importing these takes longer than most of the tests: one process does, and each run is a copy of it.
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["hypothesis", "matplotlib.pyplot", "numba", "pytest", "scipy.sparse"])


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    """The runs of all cases that are asked for, by name, as many at a time as there are cores."""
    chosen = [item.callspec.params["name"] for item in request.session.items if item.module is request.module]
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        yield {name: pool.submit(run, *MUTATIONS[name], folder=tmp_path_factory.mktemp("copy")) for name in chosen}
    finally:
        pool.shutdown(cancel_futures=True)


def run(file, test, *texts, folder):
    """Run the tests of a name on a copy of the library in `folder` in which texts stand in place of others."""
    shutil.copytree(LIBRARY, folder / "sdhj", ignore=shutil.ignore_patterns("__pycache__"))
    changed = folder / "sdhj" / "certified" / "check" / file
    source = changed.read_text(encoding="utf-8")
    for stands, instead in zip(texts[::2], texts[1::2], strict=True):
        assert source.count(stands) == 1, (stands, source.count(stands))
        source = source.replace(stands, instead)
    changed.write_text(source, encoding="utf-8")
    holding = [str(path) for path in sorted((TESTS / "certified" / "check").glob("test_*.py")) if has(path, test)]
    command = ["-o", "addopts=--import-mode=importlib", "-q", "-x", "-p", "no:cacheprovider", "-m", "not bench"]
    command += [f"-c{TESTS.parent / 'pyproject.toml'}", *holding, "-k", test]
    process = SERVER.Process(target=outcome_of, args=(str(folder), command))
    process.start()
    process.join(600)
    process.kill()
    process.join()
    return subprocess.CompletedProcess(command, process.exitcode, (folder / "said").read_text(encoding="utf-8"))


def has(path, test):
    """Whether a file has tests of a name: importing others takes longer."""
    return re.search(rf"def \w*({test.replace(' or ', '|')})", path.read_text(encoding="utf-8"))


def outcome_of(folder, command):
    """Run pytest on the library in `folder`, in a process of its own; what it prints is in a file there."""
    os.chdir(folder)
    os.environ |= {
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": folder,
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # starting those takes as long as most of these tests
    }
    numba.config.reload_config()
    sys.dont_write_bytecode = True
    sys.path[:0] = [folder]
    with open("said", "wb", buffering=0) as said:
        for stream in (1, 2):
            os.dup2(said.fileno(), stream)
    code = pytest.main(command)
    sys.stdout.flush()
    os._exit(code)


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, runs):
    """The tests fail, by an assertion, or because bounds are compared with what they bound."""
    done = runs[name].result()
    assert done.returncode == 1, done.stdout[-2000:]  # 1: tests ran and some failed
    words = "AssertionError", "assert ", "DID NOT RAISE", "of that state alone"
    assert any(one in done.stdout for one in words)
