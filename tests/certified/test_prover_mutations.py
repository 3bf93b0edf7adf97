"""Every obligation of the general proof is needed: without it the checker refuses what is proved of a small robot.

Each case takes one thing out of a copy of the prover, which then solves a robot of `forged_robots`. The judge is the
checker, which shares no code with it, or plain loops over the cells.
"""

import mutations
import pytest
from forged_robots import CLEAR, COVER, GOAL, MOVES, NEAR, NEARER, save, solved
from naive_certified import assert_all_that_follows

import sdhj.certified.sets
import sdhj.certified.table
from sdhj.certified.check import verify

pytestmark = pytest.mark.slow

STENCILS, CELLS, BOUNDS, GENERAL = mutations.PROVER
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
    "what is unsure grows": (GENERAL, "if (wider <= box).all():", "if True:", "spread", NEAR),
    "velocities near a prediction": (GENERAL, "self._ends(self.any, box)", "self._ends(self.any, 0.0)", "spread", NEAR),
    "what a prediction moves by": (
        GENERAL,
        "(np.minimum(a.min(axis=0), 0) * stride, np.maximum(b.max(axis=0), 0) * stride) for a, b in fastest",
        "(0.0 * a[0], 0.0 * b[0]) for a, b in fastest",
        "spread",
        NEAR,
    ),
    "an adversary that pushes one way": (
        GENERAL,
        "np.maximum(most - slow, fast - least).max",
        "(most - slow).max",
        "late",
        NEAR,
    ),
    "predictions at every time": (
        GENERAL,
        "range(problem.steps if problem.dynamics.timed else 1)",
        "range(1)",
        "gusty",
        NEAR,
    ),
    "predictions under every input": (
        GENERAL,
        "product(range(len(self.problem.inputs)), self.strides)",
        "product([0] * len(self.problem.inputs), self.strides)",
        "gusty",
        NEAR,
    ),
    # places
    "cells that are not alike": (GENERAL, "own[place] |= axis.periodic and", "own[place] |= False and", "ring", COVER),
    "walls that a state leaves again": (
        GENERAL,
        'own[place] |= not problem.dynamics.constant and "wall"',
        'own[place] |= False and "wall"',
        "walled",
        COVER,
    ),
    # moves
    "errors before": (
        GENERAL,
        "moved = self._held(low, high, before + SIDES * self.unsure)",
        "moved = before.copy()",
        "sensed",
        MOVES,
    ),
    "errors after": (GENERAL, "last + SIDES * self.unsure", "last", "sensed", MOVES),
    "a late end": (
        GENERAL,
        "length, early = self.problem.sensing.hold(self.problem.delta)",
        "length, early = self.problem.delta, 2 * self.problem.sensing.jitter",
        "sensed",
        MOVES,
    ),
    "an early end": (GENERAL, "if begin >= soonest:", "if False:", "sensed", MOVES),
    "the time of a piece": (GENERAL, "[start + begin, start + end]", "[begin, end]", "tide", MOVES),
    "the time of a step": (GENERAL, "self.problem.time(start), min", "self.problem.time(0), min", "tide", MOVES),
    "room that holds": (
        GENERAL,
        "if ((reached[0] > box[0]) | carried).all() and ((reached[1] < box[1]) | carried).all():",
        "if True:",
        "growing faster",
        MOVES,
    ),
    "the face that the first can be in": (
        GENERAL,
        "face[0][:, axis] = ends[side][:, axis]",
        "face[0][:, axis] = ends[1][:, axis]",
        "growing",
        MOVES,
    ),
    "the face that the last can be in": (
        GENERAL,
        "face[1][:, axis] = ends[side][:, axis]",
        "face[1][:, axis] = ends[0][:, axis]",
        "growing slowly",
        MOVES,
    ),
    "the worst in a face": (
        GENERAL,
        "velocity[2 + side][:, axis] = least_most[side]",
        "velocity[2 + side][:, axis] = least_most[0]",
        "growing",
        MOVES,
    ),
    "walls on the way": (GENERAL, "out[side] = np.where(held, at_wall, out[side])", "pass", "walled", MOVES),
    "the first cell of an image": (
        CELLS,
        "np.floor((low + DRIFT) / width)",
        "np.ceil((low + DRIFT) / width)",
        "cart",
        MOVES,
    ),
    "the last cell of an image": (
        CELLS,
        "np.ceil((high - DRIFT) / width)",
        "np.floor((high - DRIFT) / width)",
        "cart",
        MOVES,
    ),
    "a narrower cell": (CELLS, "if not known or not axis.periodic:", "if True:", "ring", MOVES),
    "states near a cell": (GENERAL, "edges[1] + STATE_SLACK", "edges[1]", "sliding", MOVES),
    "the adversary": ("certified/bounds.py", "(t0, t1), self.signs)", "(t0, t1), np.zeros(1))", "line", MOVES),
    # which inputs are clear
    "boxes of a set": (
        GENERAL,
        "corner + pitch + MARGIN_OF_BOXES, t0, t1",
        "corner + MARGIN_OF_BOXES, t0, t1",
        "thin",
        CLEAR,
    ),
    "times of a set": (
        GENERAL,
        "corner + pitch + MARGIN_OF_BOXES, t0, t1",
        "corner + pitch + MARGIN_OF_BOXES, t0, t0",
        "crossed",
        CLEAR,
    ),
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
    "unsafe ends": (GENERAL, "if np.isfinite([least, most]).any():", "if False:", "line", CLEAR),
    "how near past an end": (
        GENERAL,
        "np.stack([least - room, most + room])",
        "np.stack([least - 1, most + 1])",
        "line",
        CLEAR,
    ),
    "what is between the parts": (
        GENERAL,
        "tube = [np.minimum(tube[0], moved[0]), np.maximum(tube[1], moved[1])]",
        "tube = [moved[0], moved[1]]",
        "line",
        CLEAR,
    ),
    "cells that are met alike": (GENERAL, "alike[known.axes] = False", "pass", "line", CLEAR),
    "boxes that a tube overlaps": (
        STENCILS,
        "at[1, k] = min(max(math.ceil(end",
        "at[1, k] = min(max(math.floor(end",
        "thin",
        CLEAR,
    ),
    "boxes that a tube begins in": (
        STENCILS,
        "at[0, k] = min(max(math.floor(begin / pitch), 0), size - 1)",
        "at[0, k] = min(max(math.ceil(begin / pitch), 0), size - 1)",
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
    "the lower end of a tube": (STENCILS, "tube[begin:end, axis, 0].min() + narrow", "narrow", "line", CLEAR),
    "the upper end of a tube": (STENCILS, "tube[begin:end, axis, 1].max() - narrow", "0.0 - narrow", "line", CLEAR),
    "parts in turn": (
        STENCILS,
        "met = boxes_meeting(box, max(part, 0) % kinds",
        "met = boxes_meeting(box, 0 % kinds",
        "crossed",
        CLEAR,
    ),
    "out by a lower end": (
        STENCILS,
        "tube[:, axis, 0].min() < faces[0, axis]",
        "tube[:, axis, 0].min() < -1e9",
        "line",
        CLEAR,
    ),
    "out by an upper end": (
        STENCILS,
        "tube[:, axis, 1].max() > faces[1, axis]",
        "tube[:, axis, 1].max() > 1e9",
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
        "self._over_cells(problem.target, times)[1] <= 0.0",
        "self._over_cells(problem.target, times)[0] <= 0.0",
        "line",
        GOAL,
    ),
    "a goal is clear of what stands still": (
        GENERAL,
        "self._over_cells(part, self._always)[0] > 0.0",
        "True",
        "post in the target",
        GOAL,
    ),
    "a goal is clear of what moves": (GENERAL, "self._over_cells(part, times)[0] > 0.0", "True", "sensed", GOAL),
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
        GENERAL,
        "more = STATE_SLACK + self.unsure[list(part.axes)]",
        "more = STATE_SLACK",
        "sensed",
        GOAL,
    ),
    # sets
    "every cell of an image": (STENCILS, "at[axis] < number[axis]:", "at[axis] < number[axis] - 1:", "cart", NEARER),
    "the last cells of a row": (
        STENCILS,
        "has_bits(block, begin, min(end, count))",
        "has_bits(block, begin, begin + 1)",
        "line",
        NEARER,
    ),
    "past an upper end by a cell": (STENCILS, "begin > count and", "begin >= count and", "out to the right", NEARER),
    "past a lower end by a cell": (STENCILS, "end < -1 and", "end < 0 and", "out to the left", NEARER),
    "inputs that are clear": (
        STENCILS,
        "if (safe[j >> 3] >> (j & 7)) & 1 and image",
        "if image",
        "beside a post",
        NEARER,
    ),
}
# file, what is taken out, what is left, the robot of which plain loops then say something else
ANOTHER = {
    "rows whose images change": (
        STENCILS,
        "cell[axis] - reach[1, axis], cell[axis] - reach[0, axis]",
        "cell[axis], cell[axis]",
        "cornered",
    ),
    "rows at an end": (
        STENCILS,
        "begin = 0 if cell[axis] == 0 else max(begin, 0)",
        "begin = max(begin, 0)",
        "to the left",
    ),
    "only what was in the set": (STENCILS, "if has_bit(own[row], bit) != stays:", "if False:", "cart"),
    "inputs that lead there": (
        STENCILS,
        "out[m, j] = pool.size == 0 or image_inside(",
        "out[m, j] = True or image_inside(",
        "line",
    ),
    "safe inputs": (
        STENCILS,
        "if (safe[j >> 3] >> (j & 7)) & 1 and not out[m, j]:",
        "if not out[m, j]:",
        "beside a post",
    ),
    "all inputs": (STENCILS, "for j in range(out.shape[1]):", "for j in range(1):", "line"),
}


@pytest.fixture
def without(monkeypatch):
    """The prover goes on without something."""

    def change(file, old, new):
        with mutations.modules(mutations.PROVER, file, old, new) as made:
            for user in (sdhj.certified.sets, sdhj.certified.table):
                monkeypatch.setattr(user, "GeneralProof", made[GENERAL].GeneralProof)

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
