"""Every step of the checker is needed: without it, one of the tests in tests/certified/check fails.

Each case takes one thing out of a copy of the library and runs that test on the copy, without compiling.
"""

import mutations
import pytest

pytestmark = pytest.mark.slow

ARM, READING, SEPARATION, ROWS, BITS, INTERVALS, FORMULAS = (
    f"certified/check/{name}.py"
    for name in ("arm/claims", "reading", "arm/separation", "arm/rows", "bits", "intervals", "formulas")
)
EXACT, FORMS, TABLES, TEXT = "test_every_exact", "test_closed_forms", "test_tables_are_interpolated", "test_what_is_no"
COVER, LISTS, REFUSED = "test_cells_that_do_not", "test_image_lists", "test_numbers_beyond"
ROW, CLEAR, FLAGS = "test_nothing_that_samples", "test_what_is_proved", "test_flags_that"
FARTHER, DISK, HAIR, HALF = "test_no_point", "test_a_disk_stays", "test_contact_is_met", "test_half_planes_prove"
EROSION, SURVEY, BESIDE, TIPS = "test_erosion", "test_survey", "test_states_beside", "test_tips"

# file, what is taken out, what is left, the test that must fail
MUTATIONS = {
    "2 pi from below": (READING, "least <= shortest", "True", COVER),
    "2 pi from above": (READING, "most >= longest", "True", COVER),
    "doubt about 2 pi": (READING, "most - least <= doubt", "True", COVER),
    "the last cell": (READING, "n * width >= most", "True", COVER),
    "the agent's box": (
        ARM,
        "[(-box, 2 * box, 2 * box, Fraction(0))]",
        "[(-box, 0 * box, 2 * box, Fraction(9))]",
        COVER,
    ),
    "where the box begins": (READING, "begin in (None, low)", "True", COVER),
    "slow end": (ARM, "cell * width + back - off", "cell * width + ahead - off", LISTS),
    "fast end": (ARM, "(cell + 1) * width) + ahead + off", "(cell + 1) * width) + back + off", LISTS),
    "errors of both measurements": (ARM, "2 * arm.scene.off(axis)", "arm.scene.off(axis)", LISTS),
    "a late end": (ARM, 'decimal(self.given["delta"]) + late', 'decimal(self.given["delta"])', LISTS),
    "a late begin": (SEPARATION, "/ 2 + world.late", "/ 2", DISK),
    "error of a joint": (SEPARATION, "world.off[joint] + STATE_ERROR", "STATE_ERROR", BESIDE),
    "error of the agent": (SEPARATION, "world.off[axis] + STATE_ERROR", "STATE_ERROR", BESIDE),
    "error in a half plane": (SEPARATION, "max(world.off[2], world.off[3])", "0.0", "test_half_planes_count"),
    "laps": (ARM, "for lap in (-2, -1, 0, 1, 2)", "for lap in (0,)", LISTS),
    "numbers that are let in": (ARM, "(sizes <= LONGEST_LENGTH).all()", "True", REFUSED),
    "numbers below zero": (ARM, "not least >= 0.0", "False", REFUSED),
    "linear term of joint 1": (SEPARATION, "a + abs(side_a) * d1 + bend", "a + bend", FARTHER),
    "linear term of the tip": (SEPARATION, "abs(side_a + turn * side_b) * d1", "0.0", FARTHER),
    "linear term of joint 2": (SEPARATION, " + abs(side_b) * d2\n", "\n", FARTHER),
    "bend of joint 1": (SEPARATION, "max(-a, 0.0) * d1", "0.0 * d1", FARTHER),
    "bend of joint 2": (SEPARATION, "max(-b, 0.0) *", "0.0 *", FARTHER),
    "the base": (SEPARATION, "return max(elbow, 0.0)", "return elbow", FARTHER),
    "the elbow": (SEPARATION, "return max(elbow, tip + bend", "return max(-1.0, tip + bend", FARTHER),
    "move of a disk": (SEPARATION, "half * vx, half * vy", "0.0, 0.0", DISK),
    "bend of a path": (SEPARATION, "abs(disk[4]) * (disk[5] * half) ** 2 / 2", "0.0", DISK),
    "rounding": (SEPARATION, "ROUNDING = 1e-11", "ROUNDING = 0.0", HAIR),
    "error of states": (SEPARATION, "STATE_ERROR = 1e-10", "STATE_ERROR = 0.0", BESIDE),
    "radius": (SEPARATION, "best > body[7] + ROUNDING", "best > ROUNDING", HAIR),
    "disturbance": (SEPARATION, "velocity[joint] + part[10 + 2 * joint]", "velocity[joint]", CLEAR),
    "disturbance of a row": (
        ROWS,
        "= -world.push, world.push, -world.push, world.push",
        "= 0.0, 0.0, 0.0, 0.0",
        "test_half_planes_count",
    ),
    "start of the time": (SEPARATION, "min(slow * tau0, slow * tau1)", "slow * tau0", CLEAR),
    "end of the time": (SEPARATION, "max(fast * tau0, fast * tau1)", "fast * tau0", CLEAR),
    "move of the agent": (SEPARATION, "off = world.agent[0] * tau1 + ", "off = ", CLEAR),
    "half of the time": (SEPARATION, "= second[2 * axis] =", "= second[2 * axis + (axis == 4)] =", CLEAR),
    "half of the disturbance": (
        SEPARATION,
        "= second[2 * axis] =",
        "= second[2 * axis + (axis > 4)] =",
        "test_all_that_a_dist",
    ),
    "half of the box": (SEPARATION, "= second[2 * axis] =", "= second[2 * axis + (axis < 4)] =", CLEAR),
    "second link": (
        SEPARATION,
        "for link in range(2):\n            if not link_clear",
        "for link in range(1):\n            if not link_clear",
        CLEAR,
    ),
    "cell of the agent": (SEPARATION, "behind = abs(nx) * hx + abs(ny) * hy", "behind = 0.0", CLEAR),
    "move in a half plane": (SEPARATION, "world.agent[0] * box[9] + max", "max", HALF),
    "parts of a sweep": (SEPARATION, "for k in range(parts)", "for k in range(1)", HALF),
    "far edge of a column": (SEPARATION, "shift = 0 if nx > 0.0 else 1", "shift = 0", HALF),
    "width of a half plane": (SEPARATION, "(bound + abs(nx) * grow) / ny", "(bound - abs(nx) * grow) / ny", HALF),
    "lower end of a column": (SEPARATION, "and y[first] >= low[x]", "and y[first] > y[-1]", HALF),
    "bend of the tip": (SEPARATION, "if furthest + rest + ROUNDING <=", "if furthest <=", TIPS),
    "turn of the tip": (SEPARATION, "for turned in (-d1, d1)", "for turned in (0.0, 0.0)", TIPS),
    "size of the evader": (SEPARATION, "math.hypot(abs(off_x) + hx, abs(off_y) + hy)", "math.hypot(off_x, off_y)", ROW),
    "all of erosion": (BITS, "every &= (near", "every = (near", EROSION),
    "all of a column": (BITS, "(1, along_y, 1))", ")", EROSION),
    "sets that grow": (ARM, "if within and (old & ~new).any():", "if False:", SURVEY),
    "all ends of joint 1": (ROWS, "for a in range(ends1.size)", "for a in range(1)", ROW),
    "all ends of joint 2": (ROWS, "for b in range(ends2.size)", "for b in range(1)", ROW),
    "one step less": (ROWS, "[place + steps - start]", "[min(place + steps - start + 1, len(todo) - 1)]", ROW),
    "reach and clear at once": (ROWS, "todo[place] &= ~(able[place] & need)", "todo[place] &= ~need", ROW),
    "inputs that are allowed": (ROWS, "stored.allowed[start, j, i1, i2] and any_bit", "any_bit", ROW),
    "many cells at once": (ROWS, "sweep(j, world.held, world, bench, need)", "pass", ROW),
    "cells one by one": (ROWS, "settle(world.inputs[j], world.held, world, bench, need)", "pass", ROW),
    "many cells at a goal": (ROWS, "sweep(0, 0.0, world, bench, near)", "pass", ROW),
    "the pursuer at a goal": (ROWS, "settle(still, 0.0, world, bench, need)", "pass", ROW),
    "obstacles at a goal": (
        ROWS,
        "clear((0, len(world.disks)), bench.part, still, t, world, bench.stack)",
        "True",
        ROW,
    ),
    "the target at its time": (
        ROWS,
        "if not world.chased or tip_inside(bench.part, t, world, bench.stack)",
        "if True",
        ROW,
    ),
    "the evader's tips": (ROWS, "if not tip_inside(bench.part, 0.0, world, bench.stack)", "if False", ROW),
    "outward rounding": (INTERVALS, "return low - (by * np.abs(low) + least),", "return low,", EXACT),
    "underflow": (INTERVALS, "TINY = 5e-324", "TINY = 0.0", EXACT),
    "not below zero": (INTERVALS, "return np.maximum(low, least), high", "return low, high", FORMS),
    "signs of products": (INTERVALS, "np.where(alike, np.maximum(low, 0.0), low)", "low", FORMS),
    "a divisor of zero": (INTERVALS, "(b[0] <= 0) & (b[1] >= 0)", "b[0] > b[1]", FORMS),
    "a share of zero": (INTERVALS, "np.where(zero, known - 1.0, low)", "low", EXACT),
    "odd powers": (INTERVALS, "np.where(a[0] < 0, -up, down)", "down", EXACT),
    "a base of zero": (INTERVALS, "((a[0] == 0) & (b[0] > 0))", "(a[0] == 0)", EXACT),
    "NumPy's powers of one": (INTERVALS, "~defined | np.isnan(b[0])", "~defined", "test_what_is_undefined"),
    "hills": (INTERVALS, "np.where(hills, 1.0, high)", "high", EXACT),
    "valleys": (INTERVALS, "np.where(valleys, -1.0, low)", "low", EXACT),
    "poles": (INTERVALS, "unless(pole, ", "unless(np.isnan(begin), ", FORMS),
    "the jump of an angle": (INTERVALS, "jump = (y[0] <= 0) & (y[1] >= 0) & (x[0] <= 0)", "jump = x[0] > x[1]", EXACT),
    "laps of a rest": (
        INTERVALS,
        "low = np.where(first == last, np.maximum(rest[0], least), least)",
        "low = rest[0]",
        FORMS,
    ),
    "the part below a jump": (INTERVALS, "if side == 0 else (below,", "if True else (below,", EXACT),
    "the last of two laps": (INTERVALS, "(first, last)[side]", "first", EXACT),
    "all sides of jumps": (FORMULAS, "for sides in every[1:]", "for sides in every[2:]", "test_every_value_is_on"),
    "NaN in a comparison": (INTERVALS, "np.isnan(a[0]) | np.isnan(b[0])", "np.isnan(a[0])", "test_what_is_undefined"),
    "an open condition": (INTERVALS, "np.where(no, b[0], np.minimum(a[0], b[0]))", "b[0]", EXACT),
    "nodes in a box": (INTERVALS, "(np.ceil(high) - begin).max(axis=1) + 1", "[2] * len(low)", TABLES),
    "the last block": (INTERVALS, "np.ceil(high).astype(np.int64)", "np.floor(high).astype(np.int64)", TABLES),
    "endless ends": (INTERVALS, "np.isfinite(low) & np.isfinite(high)", "~np.isnan(low + high)", FORMS),
    "what is taken away": (INTERVALS, "return add(a, neg(b))", "return add(a, (-b[0], -b[1]))", EXACT),
    "all corners": (INTERVALS, "for p in a for q in b]", "for p, q in zip(a, b, strict=True)]", EXACT),
    "least absolute values": (INTERVALS, "np.maximum(np.maximum(a[0], -a[1]), 0.0)", "np.maximum(a[0], -a[1])", EXACT),
    "most absolute values": (INTERVALS, "np.maximum(-a[0], a[1])", "a[1]", EXACT),
    "even powers": (INTERVALS, "if n % 2 == 0:", "if False:", EXACT),
    "errors of functions": (INTERVALS, "UNITS = 2.0**-49", "UNITS = 0.0", EXACT),
    "what falls": (INTERVALS, "np.arccos(a[1]), np.arccos(a[0])", "np.arccos(a[0]), np.arccos(a[1])", EXACT),
    "sizes of both sides": (INTERVALS, "(a0, a1), (b0, b1) = size(a), size(b)", "(a0, a1), (b0, b1) = a, b", EXACT),
    "what is surely less": (INTERVALS, "truth(a[1] < b[0], a[0] >= b[1]", "truth(a[1] < b[1], a[0] >= b[1]", EXACT),
    "what is never less": (INTERVALS, "truth(a[1] <= b[0], a[0] > b[1]", "truth(a[1] <= b[0], a[0] > b[0]", EXACT),
    "what is surely equal": (INTERVALS, "(a[0] == b[1]) & (a[1] == b[0])", "(a[0] == b[0])", FORMS),
    "what is not": (INTERVALS, "(1.0 - a[1], 1.0 - a[0])", "(1.0 - a[0], 1.0 - a[1])", EXACT),
    "rounding of tables": (INTERVALS, "(2.0**table.ndim + 2 * table.ndim) * UNIT", "0.0 * UNIT", TABLES),
    "blocks of a table": (INTERVALS, "np.minimum.reduceat(least", "np.maximum.reduceat(least", TABLES),
    "what is read": (FORMULAS, "number in (None, *node.given) for", "number is None for", "test_what_it_reads"),
    "later lines": (FORMULAS, "self.whole(word, len(self.nodes), ", "self.whole(word, 10**6, ", TEXT),
    "lines": (FORMULAS, "1 <= len(lines) <= MOST_LINES", "True", TEXT),
    "exponents": (FORMULAS, "abs(exponent) <= MOST_EXPONENT", "True", TEXT),
    "truth values": (FORMULAS, "self.truths.issuperset(truths)", "True", TEXT),
    "values let go": (FORMULAS, "del values[operand]", "pass", "test_many_values"),
    "flags": (ROWS, "failed, example = failed + 1,", "failed, example = failed,", FLAGS),
    "time of a flag": (
        ROWS,
        "t = start * world.delta + world.begin\n                if not clear",
        "t = 0.0\n                if not clear",
        FLAGS,
    ),
}


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    with mutations.started(request, MUTATIONS, "certified/check", tmp_path_factory) as started:
        yield started


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, runs):
    mutations.assert_needed(runs[name].result())
