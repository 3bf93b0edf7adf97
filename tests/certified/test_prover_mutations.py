"""Every obligation of the general proof is needed: without it the checker refuses what is proved of a small robot.

Each case takes one thing out of a copy of the prover, which then solves a robot of `forged_robots`. The judge is the
checker, which shares no code with it, or plain loops over the cells.
"""

import mutations
import numpy as np
import pytest
import test_tape
from forged_robots import CLEAR, COVER, GOAL, MOVES, NEAR, NEARER, save, solved
from naive_certified import assert_all_that_follows

import sdhj.certified.sets
import sdhj.certified.table
from sdhj.certified.check import verify
from sdhj.kernels import tape

pytestmark = pytest.mark.slow

PIECES, STENCILS, CELLS, BOUNDS, IMAGES, GENERAL = mutations.PROVER
INTERVALS, TAPE = mutations.KERNELS

# file, what is taken out, what is left, the robot, the claim that is not proved any more
FALSE = {
    # predictions
    "error of a measurement": (
        CELLS,
        "return measured(error) + measured",
        "return measured",
        "held",
        "predictions are off",
    ),
    "delay of a measurement": (CELLS, "* (fast - slow) / 2", "* 0", "held", NEAR),
    "what is unsure grows": (IMAGES, "if (wider <= box).all():", "if True:", "spread", NEAR),
    "velocities near a prediction": (IMAGES, "near(disturbed, box)", "near(disturbed, 0.0)", "spread", NEAR),
    "what a prediction moves by": (
        IMAGES,
        "(np.minimum(a.min(axis=0), 0) * stride, np.maximum(b.max(axis=0), 0) * stride) for a, b in fastest",
        "(0.0 * a[0], 0.0 * b[0]) for a, b in fastest",
        "spread",
        NEAR,
    ),
    "an adversary that pushes one way": (
        IMAGES,
        "np.maximum(most - slow, fast - least).max",
        "(most - slow).max",
        "late",
        NEAR,
    ),
    "predictions at every time": (
        IMAGES,
        "range(problem.steps if timed else 1)",
        "range(1)",
        "gusty",
        NEAR,
    ),
    "predictions under every input": (
        IMAGES,
        "product(range(len(problem.inputs)), strides",
        "product([0] * len(problem.inputs), strides",
        "gusty",
        NEAR,
    ),
    # places
    "cells that are not alike": (IMAGES, "own[place] |= axis.periodic and", "own[place] |= False and", "ring", COVER),
    "walls that a state leaves again": (
        IMAGES,
        'own[place] |= not steady and "wall"',
        'own[place] |= False and "wall"',
        "walled",
        COVER,
    ),
    # layers
    "layers at walls": (CELLS, 'int(known and end == "wall"', "int(known", "standing unsafely", COVER),
    "all of an image at the wall": (CELLS, "np.where(end <= 0.0, 0,", "np.where(begin <= 1e-6, 0,", "standing", MOVES),
    "all of an image at an upper wall": (
        CELLS,
        "np.where(begin >= length,",
        "np.where(end >= length - 1e-6,",
        "standing",
        MOVES,
    ),
    "what is beside a layer": (
        CELLS,
        "+ lower, np.ceil(end / width) - 1 + lower",
        ", np.ceil(end / width) - 1",
        "standing",
        MOVES,
    ),
    "room where something grows": (
        IMAGES,
        "(velocity[1] <= 0.0)",
        "True",
        "standing",
        MOVES,
    ),
    # moves
    "errors before": (
        IMAGES,
        "self._held(start, before + SIDES * self.unsure)",
        "before.copy()",
        "sensed",
        MOVES,
    ),
    "errors after": (IMAGES, "last + SIDES * self.unsure", "last", "sensed", MOVES),
    "what is carried on": (
        IMAGES,
        "last = last - SIDES * self.unsure",
        "last = last - 1.5 * SIDES * self.unsure",
        "remembered",
        MOVES,
    ),
    "the middle": (IMAGES, "np.where((low > high) &", "np.where((low > high) & False &", "calming", MOVES),
    "a late end": (
        IMAGES,
        "length, early = self.problem.sensing.hold(self.problem.delta)",
        "length, early = self.problem.delta, 2 * self.problem.sensing.jitter",
        "sensed",
        MOVES,
    ),
    "an early end": (IMAGES, "if begin >= soonest:", "if False:", "sensed", MOVES),
    "the time of a piece": (IMAGES, "(time + begin, time + end)", "(begin, end)", "tide", MOVES),
    "the time of a step": (IMAGES, "self.problem.time(start), pieces", "self.problem.time(0), pieces", "tide", MOVES),
    "room that holds": (
        PIECES,
        "inside &= way * end < way * room[side, m, k]",
        "pass",
        "growing faster",
        MOVES,
    ),
    "the face that the first can be in": (
        PIECES,
        "box[0, m, axis] = end",
        "box[0, m, axis] = ends[1, m, axis]",
        "growing",
        MOVES,
    ),
    "the face that the last can be in": (
        PIECES,
        "box[1, m, axis] = end",
        "box[1, m, axis] = ends[0, m, axis]",
        "growing slowly",
        MOVES,
    ),
    "the worst in a face": (
        IMAGES,
        "self.bounds.fastest(side, axis",
        "self.bounds.fastest(0, axis",
        "growing",
        MOVES,
    ),
    "walls on the way": (
        PIECES,
        "moved[side, m, k] = np.nextafter(at_wall",
        "at_wall = np.nextafter(at_wall",
        "walled",
        MOVES,
    ),
    "the first cell of an image": (
        CELLS,
        "np.floor((low + drift) / width)",
        "np.ceil((low + drift) / width)",
        "cart",
        MOVES,
    ),
    "the last cell of an image": (
        CELLS,
        "np.ceil((high - drift) / width)",
        "np.floor((high - drift) / width)",
        "cart",
        MOVES,
    ),
    "a narrower cell": (CELLS, "if not known or not self.periodic:", "if True:", "ring", MOVES),
    "states near a cell": (IMAGES, "axis.edges()[own + 1] + self.shell[k]", "axis.edges()[own + 1]", "sliding", MOVES),
    "the adversary": ("certified/bounds.py", "(t0, t1), signs)", "(t0, t1), np.zeros(1))", "line", MOVES),
    # which inputs are clear: `_lattices`, `lattice_of`, `_strike`, `_met`, and `strike` with what it calls
    "boxes of a set": (
        GENERAL,
        "high = [begin + step + more",
        "high = [begin + more",
        "thin",
        CLEAR,
    ),
    "times of a set": (
        GENERAL,
        "bounds.signs(part, low, high, span)",
        "bounds.signs(part, low, high, span[:1] * 2)",
        "crossed",
        CLEAR,
    ),
    "boxes as wide as tubes sway": (GENERAL, "wider = sway +", "wider = 0 * sway +", "calm", CLEAR),
    "a set nearer than rounding": (GENERAL, "MARGIN_OF_BOXES = 4e-10", "MARGIN_OF_BOXES = 0.0", "nearer", CLEAR),
    "laps of a set": (
        GENERAL,
        "meets = np.concatenate([meets, meets], axis=k)",
        "meets = np.concatenate([meets, meets & False], axis=k)",
        "past the seam",
        CLEAR,
    ),
    "sets at the time of a step": (
        GENERAL,
        "for begin in map(self.problem.time, range(self.problem.steps)):",
        "for begin in [0.0] * self.problem.steps:",
        "crossed",
        CLEAR,
    ),
    "sets in all of an interval": (
        GENERAL,
        "begin + length * at / self.parts",
        "begin + 0.0 * at / self.parts",
        "crossed",
        CLEAR,
    ),
    "a clock that is off": (GENERAL, "(t0 - late, t1 + late)", "(t0, t1)", "sensed", CLEAR),
    "sets that stand still": (GENERAL, "(one for one in lattices if len(one) == 1)", "()", "line", CLEAR),
    "sets that move": (GENERAL, "(one for one in lattices if len(one) > 1)", "()", "crossed", CLEAR),
    "clear in every step": (
        GENERAL,
        "self._met(clear, tubes, places, known[step], bit)",
        "self._met(clear, tubes, places, known[0], bit)",
        "crossed",
        CLEAR,
    ),
    "unsafe ends": (GENERAL, "if np.isfinite(faces).any():", "if False:", "line", CLEAR),
    "how near past an end": (
        GENERAL,
        "faces += np.stack([-room, room])",
        "faces += np.array([[-1.0], [1.0]])",
        "line",
        CLEAR,
    ),
    "what is between the parts": (
        IMAGES,
        "tube = [np.minimum(tube[0], moved[0]), np.maximum(tube[1], moved[1])]",
        "tube = [moved[0], moved[1]]",
        "line",
        CLEAR,
    ),
    "cells that are met alike": (GENERAL, "alike[axes] = False", "pass", "line", CLEAR),
    "cells that leave alike": (
        GENERAL,
        "alike[axes] = False",
        "alike[axes] &= True",
        "line",
        CLEAR,
    ),
    "boxes that a tube overlaps": (
        STENCILS,
        "last = min(max(math.ceil(end",
        "last = min(max(math.floor(end",
        "thin",
        CLEAR,
    ),
    "boxes that a tube begins in": (
        STENCILS,
        "first = min(max(math.floor(begin / pitch), 0), size - 1)",
        "first = min(max(math.ceil(begin / pitch), 0), size - 1)",
        "thin",
        CLEAR,
    ),
    "boxes of the next lap": (STENCILS, "if end > length:", "if False:", "past the seam", CLEAR),
    "laps of a tube": (
        STENCILS,
        "begin - length * math.floor(begin / length), end",
        "begin, end",
        "before the seam",
        CLEAR,
    ),
    "the lower end of a tube": (STENCILS, "low + lattice.narrow[k]", "lattice.narrow[k]", "line", CLEAR),
    "the upper end of a tube": (STENCILS, "high - lattice.narrow[k]", "0.0 - lattice.narrow[k]", "line", CLEAR),
    "each cell of a line": (STENCILS, "swept_boxes(begin + n, span", "swept_boxes(begin, span", "line", CLEAR),
    "all cells of a segment": (STENCILS, "max(hulls[1, segment], along[1, n])", "along[1, 0]", "line", CLEAR),
    "both ends on the other axes": (STENCILS, "flat += at[sides & 1, k]", "flat += at[0, k]", "plane", CLEAR),
    "parts in turn": (STENCILS, "sums[(span - 1) % len(sums)]", "sums[0]", "crossed", CLEAR),
    "all parts together": (GENERAL, "np.any(some, axis=0)", "some[0]", "crossed", CLEAR),
    "whole tiles": (
        BOUNDS,
        "np.append(ends[side - 1 :: side], ends[-1:])",
        "np.append(ends[::side], [])",
        "line",
        CLEAR,
    ),
    "out by a lower end": (
        STENCILS,
        "far[0, axis] < faces[0, axis]",
        "far[0, axis] < -1e9",
        "line",
        CLEAR,
    ),
    "out on another axis than a line's": (STENCILS, "(axis == along) != others", "axis == along", "plane", CLEAR),
    "out by an upper end": (
        STENCILS,
        "far[1, axis] > faces[1, axis]",
        "far[1, axis] > 1e9",
        "line",
        CLEAR,
    ),
    "wholly past an upper end": (
        STENCILS,
        "+ tube[part, axis, 0] > layout.safe",
        "+ 3 * tube[part, axis, 0] > layout.safe",
        "rock at the upper end",
        CLEAR,
    ),
    "wholly past a lower end": (
        STENCILS,
        "+ tube[part, axis, 1] < layout.safe",
        "+ 3 * tube[part, axis, 1] < layout.safe",
        "rock at the lower end",
        CLEAR,
    ),
    # goals
    "all of a goal": (
        GENERAL,
        "self.over_cells(problem.target, times) < 0",
        "self.over_cells(problem.target, times) <= 0",
        "line",
        GOAL,
    ),
    "every piece of a goal": (BOUNDS, "known[box] = False", "known[box] = True", "line", GOAL),
    "a goal is clear of what stands still": (
        GENERAL,
        "self.over_cells(part, self._always) > 0",
        "True",
        "post in the target",
        GOAL,
    ),
    "a goal is clear of what moves": (GENERAL, "self.over_cells(part, times) > 0", "True", "sensed", GOAL),
    "the time of a goal": (
        GENERAL,
        "problem, t, out = self.problem, self.problem.time(step)",
        "problem, t, out = self.problem, 0.0",
        "tide",
        GOAL,
    ),
    "a goal by a clock that is off": (
        GENERAL,
        "(t - problem.sensing.jitter, t + problem.sensing.jitter)",
        "(t, t)",
        "sensed",
        GOAL,
    ),
    "predictions in a goal": (
        IMAGES,
        "self.shell[axis] + self.unsure[axis])",
        "self.shell[axis])",
        "sensed",
        GOAL,
    ),
    # sets
    "every cell of an image": (STENCILS, "at[axis] < number[axis]:", "at[axis] < number[axis] - 1:", "cart", NEARER),
    "the last cells of a row": (STENCILS, "(word, begin, end)", "(word, begin, begin + 1)", "cart", NEARER),
    "the last cells of a long row": (
        STENCILS,
        "has_bits(block, begin, min(end, whole))",
        "has_bits(block, begin, begin + 1)",
        "rail",
        NEARER,
    ),
    "past an upper end by a cell": (STENCILS, "begin > count and", "begin >= count and", "out to the right", NEARER),
    "past a lower end by a cell": (STENCILS, "end < -1 and", "end < 0 and", "out to the left", NEARER),
    "every cell of an image at once": (STENCILS, "while run < length:", "while False:", "line", NEARER),
    "what is past an end": (IMAGES, '"wrap" if self.axes[-1].periodic else "edge"', '"edge"', "circle", NEARER),
    "inputs that are clear": (
        STENCILS,
        "clear.size > 0 and not (clear[number, j >> 3] >> (j & 7)) & 1",
        "False",
        "beside a post",
        NEARER,
    ),
}
# file, what is taken out, what is left, the robot of which plain loops then say something else
ANOTHER = {
    "cells whose images change": (STENCILS, "first - reach[1], last - reach[0]", "first, last", "cornered"),
    "cells at an end": (STENCILS, "return 0 if first == 0 else max(begin, 0)", "return max(begin, 0)", "to the left"),
    "words that change": (STENCILS, "(min(end, count - 1) >> 6) + 1] = True", "first >> 6] = True", "cart"),
    "only what was in the set": (STENCILS, "if has_bit(inside, bit) != keep:", "if False:", "cart"),
    "inputs that lead there": (
        STENCILS,
        "if out[m, j] and len(sets) > 0:",
        "if False:",
        "line",
    ),
    "safe inputs": (
        STENCILS,
        "out[m, j] = ahead[m] > 0 and (safe[j >> 3] >> (j & 7)) & 1",
        "out[m, j] = ahead[m] > 0",
        "cart",
    ),
    "all inputs": (STENCILS, "for j in range(out.shape[1]):", "for j in range(1):", "line"),
}

# file, what is taken out, what is left, the test of tests/test_tape.py that fails with it, and of which operation
WRONG = {
    "rounding of sums": (
        INTERVALS,
        "low = low if rest_low >= 0.0 else low - abs(low) * STEP",
        "low = low",
        "hold_what_is_exact",
        "add",
    ),
    "rounding of sums above": (
        INTERVALS,
        "high if rest_high <= 0.0 else high + abs(high) * STEP",
        "high",
        "hold_what_is_exact",
        "sub",
    ),
    "rounding of products": (
        INTERVALS,
        "low - (abs(low) * STEP + TINY), high +",
        "low, high +",
        "hold_what_is_exact",
        "mul",
    ),
    "what a product loses": (INTERVALS, "TINY = 2.0**-1020", "TINY = 0.0", "hold_what_is_exact", "mul"),
    "all corners": (INTERVALS, "lesser(lesser(p, q), lesser(r, s))", "lesser(p, s)", "hold_what_is_exact", "mul"),
    "signs": (
        INTERVALS,
        "return low if negative else larger(0.0, low)",
        "return larger(0.0, low)",
        "hold_what_is_exact",
        "mul",
    ),
    "a divisor of zero": (INTERVALS, "low if above | below else NAN", "low", "hold_what_is_exact", "div"),
    "a share of zero": (TAPE, "-1.0 if zero else low", "0.0 if zero else low", "hold_what_is_exact", "share"),
    "hills": (
        INTERVALS,
        "most = 1.0 if _holds_whole(low, high) else larger(p, q)",
        "most = larger(p, q)",
        "hold_what_is_exact",
        "sin",
    ),
    "valleys": (INTERVALS, "-1.0 if _holds_whole(low - 0.5, high - 0.5) else", "", "hold_what_is_exact", "cos"),
    "where hills are": (TAPE, "shift = 0.25 if op == SIN else 0.0", "shift = 0.0", "hold_what_is_exact", "sin"),
    "poles": (
        INTERVALS,
        "NAN if _holds_whole(low * (2.0 * TURN) - 0.5, high * (2.0 * TURN) - 0.5) else least",
        "least",
        "hold_what_is_exact",
        "tan",
    ),
    "laps of a rest": (
        INTERVALS,
        "(larger(low, p) if rises else low) if known",
        "p if known",
        "hold_what_is_exact",
        "mod",
    ),
    "a power of zero": (
        INTERVALS,
        "return p if (n >= 0) | (low > 0.0) | (high < 0.0) else NAN,",
        "return p,",
        "hold_what_is_exact",
        "power -1",
    ),
    "powers below zero": (
        TAPE,
        "falls = 1 if op == POWER and n < 0 else int(fact[FALLS])",
        "falls = int(fact[FALLS])",
        "hold_what_is_exact",
        "power -1",
    ),
    "even powers": (TAPE, "(op == POWER and n % 2 == 0):", "False:", "hold_what_is_exact", "power 2"),
    "other corners": (
        TAPE,
        "twice = op == POW or op == ARCTAN2  #",
        "twice = op == ARCTAN2  #",
        "hold_what_is_exact",
        "pow",
    ),
    "an angle that jumps": (TAPE, "-PI_UP if cut else", "", "hold_what_is_exact", "arctan2"),
    "a base of zero": (
        TAPE,
        "(a[0, m] == 0.0) & (b[0, m] > 0.0) else NAN",
        "(a[0, m] == 0.0) else NAN",
        "hold_what_is_exact",
        "pow",
    ),
    "what is equal": (
        TAPE,
        "(a[0, m] == b[1, m]) & (a[1, m] == b[0, m]) else 0.0",
        "(a[0, m] == b[0, m]) else 0.0",
        "hold_what_is_exact",
        "equal",
    ),
    "an open condition": (
        TAPE,
        "(c[0, m] if never else lesser(b[0, m], c[0, m]))",
        "c[0, m]",
        "hold_what_is_exact",
        "where",
    ),
    "NaN": (TAPE, "(a[m] == a[m]) & (b[m] == b[m])", "True", "is_undefined_stays_so", "equal"),
    "endless ends": (TAPE, "(out[0, m] >= -LARGEST) & (out[1, m] <= LARGEST) &", "", "is_undefined_stays_so", "exp"),
    "nodes in a box": (
        TAPE,
        "number[axis] = 2 + int(np.ceil(ends[1, axis])) - 1 - int(ends[0, axis]) if",
        "number[axis] = 2 if",
        "gridded",
        2,
    ),
    "rounding of tables": (
        TAPE,
        "slack = (4.0 * lookup[0] + 2.0) * (STEP * largest) + TINY",
        "slack = 0.0",
        "of_tables_hold_what_is_exact",
        2,
    ),
}


@pytest.fixture
def without(monkeypatch):
    """The prover goes on without something."""

    def change(file, old, new):
        with mutations.modules(mutations.PROVER, file, old, new) as made:
            for user in (sdhj.certified.sets, sdhj.certified.table):
                monkeypatch.setattr(user, "GeneralProof", made[GENERAL].GeneralProof)
            if CELLS in made:
                monkeypatch.setattr(sdhj.certified.sets, "aligned", made[CELLS].aligned)

    return change


@pytest.mark.parametrize("name", FALSE)
def test_the_checker_refuses_what_is_proved_without_it(name, without, tmp_path):
    *change, robot, claim = FALSE[name]
    without(*change)
    path = save(robot, tmp_path / "false.h5")
    try:
        said = [str(one) for one in verify(path, progress=False).claims if one.failed]
    except ValueError as error:
        said = [str(error)]
    assert any(claim in one for one in said)


@pytest.mark.parametrize("name", ANOTHER)
def test_plain_loops_say_something_else_without_it(name, without):
    *change, robot = ANOTHER[name]
    without(*change)
    with pytest.raises(AssertionError):
        assert_all_that_follows(solved(robot))


@pytest.mark.parametrize("name", WRONG)
def test_bounds_are_not_bounds_without_it(name, monkeypatch):
    *change, test, operation = WRONG[name]
    with mutations.modules(mutations.KERNELS, *change) as made:
        monkeypatch.setattr(tape, "play_bounds", made[TAPE].play_bounds)
    given = (operation,)
    if isinstance(operation, str):
        op, _, n = operation.partition(" ")
        given = op, int(n or 0)
    check = next(getattr(test_tape, one) for one in dir(test_tape) if one.endswith(test))
    with pytest.raises(AssertionError), np.errstate(all="ignore"):
        check(*given)
