"""Every step of the checker is needed: without it, one of the tests of `sdhj.certified.check.verify` fails.

Each case takes one thing out of a copy of the library and runs that test on the copy, without compiling.
"""

import mutations
import pytest

FILE, KERNELS = "verify.py", "verify_kernels.py"
COVER, LISTS, REFUSED = "test_cells_that_do_not", "test_image_lists", "test_numbers_beyond"
ROW, CLEAR, FLAGS = "test_nothing_that_samples", "test_what_is_proved", "test_flags_that"
FARTHER, DISK, HAIR, HALF = "test_no_point", "test_a_disk_stays", "test_contact_is_met", "test_half_planes"
EROSION, SURVEY, BESIDE, TIPS = "test_erosion", "test_survey", "test_states_beside", "test_tips"

# file, what is taken out, what is left, the test that must fail
MUTATIONS = {
    "2 pi from below": (FILE, "extent[0] <= 2 * PI[0]", "True", COVER),
    "2 pi from above": (FILE, "extent[1] >= 2 * PI[1]", "True", COVER),
    "the last cell": (FILE, "n * width >= extent[1]", "True", COVER),
    "the agent's box": (FILE, "extent == (2 * box, 2 * box)", "True", COVER),
    "where the box begins": (FILE, "file.lowers[axis] == -box", "True", COVER),
    "slow end": (FILE, "cell * width + slow * delta", "cell * width + fast * delta", LISTS),
    "fast end": (FILE, "(cell + 1) * width) + fast * delta", "(cell + 1) * width) + slow * delta", LISTS),
    "laps": (FILE, "for lap in (-2, -1, 0, 1, 2)", "for lap in (0,)", LISTS),
    "numbers that are let in": (FILE, "(sizes <= LARGEST).all()", "True", REFUSED),
    "numbers below zero": (FILE, "not least >= 0.0", "False", REFUSED),
    "linear term of joint 1": (KERNELS, "abs(side_a) * d1 + bend", "bend", FARTHER),
    "linear term of the tip": (KERNELS, "abs(side_a + turn * side_b) * d1", "0.0", FARTHER),
    "linear term of joint 2": (KERNELS, " + abs(side_b) * d2\n", "\n", FARTHER),
    "bend of joint 1": (KERNELS, "max(-a, 0.0) * d1", "0.0 * d1", FARTHER),
    "bend of joint 2": (KERNELS, "max(-b, 0.0) *", "0.0 *", FARTHER),
    "the base": (KERNELS, "return max(elbow, 0.0)", "return elbow", FARTHER),
    "the elbow": (KERNELS, "return max(elbow, tip + bend", "return max(-1.0, tip + bend", FARTHER),
    "move of a disk": (KERNELS, "half * vx, half * vy", "0.0, 0.0", DISK),
    "bend of a path": (KERNELS, "abs(disk[4]) * (disk[5] * half) ** 2 / 2", "0.0", DISK),
    "rounding": (KERNELS, "ROUNDING = 1e-11", "ROUNDING = 0.0", HAIR),
    "error of states": (KERNELS, "STATE_ERROR = 1e-10", "STATE_ERROR = 0.0", BESIDE),
    "radius": (KERNELS, "needed = body[7] + ROUNDING", "needed = ROUNDING", HAIR),
    "disturbance": (KERNELS, "velocity[joint] - world.push", "velocity[joint]", CLEAR),
    "start of the time": (KERNELS, "min(slow * tau0, slow * tau1)", "slow * tau0", CLEAR),
    "end of the time": (KERNELS, "max(fast * tau0, fast * tau1)", "fast * tau0", CLEAR),
    "move of the agent": (KERNELS, "cell[side + 1] + world.agent[0] * tau1", "cell[side + 1]", CLEAR),
    "half of the time": (
        KERNELS,
        "moved(cell, velocity, middle, box[9], world, stack[size])",
        "moved(cell, velocity, box[8], middle, world, stack[size])",
        CLEAR,
    ),
    "half of the box": (KERNELS, "second[2 * axis] = middle", "second[2 * axis + 1] = middle", CLEAR),
    "second link": (
        KERNELS,
        "for link in range(2):\n        if not link_clear",
        "for link in range(1):\n        if not link_clear",
        CLEAR,
    ),
    "cell of the agent": (KERNELS, "behind = abs(nx) * hx + abs(ny) * hy", "behind = 0.0", CLEAR),
    "move in a half plane": (KERNELS, "grow = world.agent[0] * box[9] + STATE_ERROR", "grow = 0.0", HALF),
    "parts of a sweep": (KERNELS, "for part in range(parts)", "for part in range(1)", HALF),
    "far edge of a column": (KERNELS, "shift = 0 if nx > 0.0 else 1", "shift = 0", HALF),
    "width of a half plane": (KERNELS, "(bound + abs(nx) * grow) / ny", "(bound - abs(nx) * grow) / ny", HALF),
    "lower end of a column": (
        KERNELS,
        "np.searchsorted(edges_y[1:], low[x])",
        "np.searchsorted(edges_y[1:], low[x]) + 1",
        HALF,
    ),
    "bend of the tip": (KERNELS, "if furthest + rest + ROUNDING <=", "if furthest <=", TIPS),
    "turn of the tip": (KERNELS, "for turned in (-d1, d1)", "for turned in (0.0, 0.0)", TIPS),
    "size of the evader": (KERNELS, "math.hypot(abs(off_x) + hx, abs(off_y) + hy)", "math.hypot(off_x, off_y)", ROW),
    "all of erosion": (
        KERNELS,
        "column[word] & wanted[y, word] == wanted[y, word]",
        "column[word] & wanted[y, word] != NONE",
        EROSION,
    ),
    "sets that grow": (KERNELS, "shrinks[place] |= pool[less, word] & ~new != NONE", "pass", SURVEY),
    "all ends of joint 1": (KERNELS, "for a in range(ends1.size)", "for a in range(1)", ROW),
    "all ends of joint 2": (KERNELS, "for b in range(ends2.size)", "for b in range(1)", ROW),
    "one step less": (KERNELS, "start + 1, within - 1), n2", "start + 1, min(within, steps - start - 1)), n2", ROW),
    "reach and clear at once": (KERNELS, "todo[place] &= ~(able[place] & need)", "todo[place] &= ~need", ROW),
    "inputs that are allowed": (KERNELS, "if not sets.allowed[start, j, i1, i2]:", "if False:", ROW),
    "many cells at once": (KERNELS, "sweep(cell, j, world.delta, world, low, high, need)", "pass", ROW),
    "cells one by one": (KERNELS, "settle(cell, world.inputs[j], world.delta, world, stack, need)", "pass", ROW),
    "the pursuer at a goal": (KERNELS, "settle(cell, world.inputs[0], 0.0, world, stack, need)", "pass", ROW),
    "obstacles at a goal": (KERNELS, "disks_clear(cell, world.inputs[0], t, 0.0, world, stack)", "True", ROW),
    "the target at its time": (KERNELS, "if not world.chased or tip_inside(cell, t, world, stack)", "if True", ROW),
    "the evader's tips": (KERNELS, "if not tip_inside(cell, 0.0, world, stack)", "if False", ROW),
    "flags": (KERNELS, "failed, example = failed + 1,", "failed, example = failed,", FLAGS),
    "time of a flag": (
        KERNELS,
        "start * world.delta, world.delta, world, stack",
        "0.0, world.delta, world, stack",
        FLAGS,
    ),
}


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    with mutations.started(request, MUTATIONS, "test_verify.py", tmp_path_factory) as started:
        yield started


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, runs):
    mutations.assert_needed(runs[name].result())
