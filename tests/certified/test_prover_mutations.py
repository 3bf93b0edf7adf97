"""Every obligation of the general proof is needed: without it the checker refuses what is proved of a small robot.

Each case takes one thing out of a copy of the prover, which then solves a robot of `forged_robots`. The judge is the
checker, which shares no code with it, or plain loops over the cells.
"""

import mutations
import numpy as np
import pytest
import test_tape
from forged_robots import ARRIVE, CLEAR, COVER, GOAL, MOVES, NEAR, NEARER, save, solved
from naive_certified import assert_all_that_follows

import sdhj.certified.sets
import sdhj.certified.table
from sdhj.certified import word_tubes
from sdhj.certified.check import verify
from sdhj.kernels import tape

pytestmark = pytest.mark.campaign

TESTED = "hold_what_is_exact"

# what is changed of which mark `# obligation` in the library, the robot, the claim that is not proved any more
FALSE = {
    "error of a measurement": ("10.1 drop 2", "held", "predictions are off"),
    "delay of a measurement": ("10.1 put 5 {7} * 0", "held", NEAR),
    "what is unsure grows": ("10.2 true 1", "spread", NEAR),
    "velocities near a prediction": ("10.3 zero 7", "spread", NEAR),
    "what a prediction moves by": ("10.4 zero 5; put 13 {10}[0]; zero 15; put 23 {20}[0]", "spread", NEAR),
    "an adversary that pushes one way": ("10.5 copy 3 6", "late", NEAR),
    "predictions at every time": ("10.6 drop 6", "gusty", NEAR),
    "predictions under every input": ("10.7 put 7 [0] * {9}", "gusty", NEAR),
    "cells that are not alike": ("1.1 false 4", "ring", COVER),
    "walls that a state leaves again": ("1.2 false 4", "walled", COVER),
    "layers at walls": ("1.3 drop 9", "standing unsafely", COVER),
    "all of an image at the wall": ("2.1 true 8", "standing", MOVES),
    "all of an image at an upper wall": ("2.2 true 8", "standing", MOVES),
    "what is beside a layer": ("2.3 copy 5 6; copy 13 14", "standing", MOVES),
    "room where something shrinks": ("2.4 true 10", "standing soon", MOVES),
    "room where something grows": ("2.5 true 10", "standing soon", MOVES),
    "errors before": ("2.6 put 14 {19}.copy()", "sensed", MOVES),
    "errors after": ("2.7 drop 14", "sensed", MOVES),
    "what is carried on": ("2.8 put 5 1.5 * {5}", "remembered", MOVES),
    "the middle": ("2.9 put 5 {5} & False", "calming", MOVES),
    "errors in all but a layer": ("2.60 true 3", "noisy", MOVES),
    "errors in all but an upper layer": ("2.60 true 14", "noisy", MOVES),
    "points beside a layer": ("2.61 drop", "noisy", MOVES),
    "points beside an upper layer": ("2.62 drop", "noisy", MOVES),
    "a late end": ("2.10 put 4 ({9}, 2 * {6}.jitter)", "sensed", MOVES),
    "an early end": ("2.11 false 1", "sensed", MOVES),
    "the time of a piece": ("2.12 copy 10 12; copy 13 15", "tide", MOVES),
    "the time of a step": ("2.13 zero 12", "tide", MOVES),
    "room that holds": ("2.14 drop", "growing faster", MOVES),
    "the face that the first can be in": ("2.15 put 9 ends[1, {5}, {6}]", "growing", MOVES),
    "the face that the last can be in": ("2.16 put 9 ends[0, {5}, {6}]", "growing slowly", MOVES),
    "the worst in a face": ("2.17 zero 11", "growing", MOVES),
    "walls on the way": ("2.18 copy 1 11", "walled", MOVES),
    "the first cell of an image": ("2.19 turn 6", "cart", MOVES),
    "the last cell of an image": ("2.19 turn 14", "cart", MOVES),
    "a narrower cell": ("2.20 true 1", "ring", MOVES),
    "states near a cell": ("2.21 drop 23", "sliding", MOVES),
    "the adversary": ("2.22 put 13 {13}.undisturbed()", "line", MOVES),
    "boxes of a set": ("4.1 drop 6", "thin", CLEAR),
    "times of a set": ("4.2 put 10 {10}[:1] * 2", "crossed", CLEAR),
    "boxes as wide as tubes sway": ("4.3 put 3 0 * {3}", "calm", CLEAR),
    "a set nearer than rounding": ("4.4 zero 2", "nearer", CLEAR),
    "laps of a set": ("4.5 put 7 {1} & False", "past the seam", CLEAR),
    "sets at the time of a step": ("4.6 put 2 [0.0] * {9}", "crossed", CLEAR),
    "sets in all of an interval": ("4.7 zero 10", "crossed", CLEAR),
    "a clock that is off": ("4.8 zero 8; zero 11", "sensed", CLEAR),
    "sets of some inputs": ("4.47 put 13 {15}.inputs is None", "forbidden", CLEAR),
    "sets that stand still": ("4.9 put 2 ()", "line", CLEAR),
    "sets that move": ("4.10 put 2 ()", "crossed", CLEAR),
    "clear in every step": ("4.11 zero 9", "crossed", CLEAR),
    "unsafe ends": ("4.12 false 1", "line", CLEAR),
    "how near past an end": ("4.13 put 3 {4}.array; put 6 [-1.0]; put 8 [1.0]", "line", CLEAR),
    "what is between the parts": ("4.14 copy 3 9; copy 12 18", "line", CLEAR),
    "cells that are met alike": ("4.15 drop", "line", CLEAR),
    "cells that leave alike": ("4.15 write {1} &= True", "line", CLEAR),
    "boxes that a tube overlaps": ("4.16 turn 7", "thin", CLEAR),
    "boxes that a tube begins in": ("4.17 turn 7", "thin", CLEAR),
    "boxes of the next lap": ("4.18 false 1", "past the seam", CLEAR),
    "laps of a tube": ("4.19 drop 7", "before the seam", CLEAR),
    "the lower end of a tube": ("4.20 drop 6", "line", CLEAR),
    "the upper end of a tube": ("4.20 zero 12", "line", CLEAR),
    "each cell of a line": ("4.21 drop 8", "line", CLEAR),
    "all cells of a segment": ("4.22 put 6 {14}[1, 0]", "line", CLEAR),
    "both ends on the other axes": ("4.23 zero 5", "plane", CLEAR),
    "parts in turn": ("4.24 zero 5", "crossed", CLEAR),
    "all parts together": ("4.25 put 9 {6}[0]", "crossed", CLEAR),
    "whole tiles": ("4.26 zero 10; put 14 []", "line", CLEAR),
    "out by a lower end": ("4.27 put 16 -1000000000.0", "line", CLEAR),
    "out on another axis than a line's": ("4.28 copy 1 2", "plane", CLEAR),
    "out by an upper end": ("4.29 number 18 1000000000.0", "line", CLEAR),
    "from the last cell back": ("4.59 number 7 1", "line", CLEAR),
    "wholly past an upper end": ("4.30 put 12 3 * {12}", "rock at the upper end", CLEAR),
    "wholly past a lower end": ("4.30 put 36 3 * {36}", "rock at the lower end", CLEAR),
    "every function of a set": ("4.48 put 2 {2}[:1]", "two posts in one", CLEAR),
    "which of the boxes": ("4.50 copy 2 12", "pursued", CLEAR),
    "boxes along a row": ("4.51 drop", "pursued", CLEAR),
    "what only an adversary moves": ("4.52 zero 6", "pursued", CLEAR),
    "boxes that may meet a set": ("4.53 put 2 {2} & False", "pursued", CLEAR),
    "the first box of a tube": ("4.55 turn 5", "pursued", CLEAR),
    "sets in words": ("4.56 put 4 []", "pursued", CLEAR),
    "parts of sets in words": ("4.58 put 11 0 * {11}", "pursued", CLEAR),
    "all of a goal": ("9.1 weaken 2", "line", GOAL),
    "every piece of a goal": ("9.2 true 4", "line", GOAL),
    "a goal is clear of what stands still": ("9.3 true 2", "post in the target", GOAL),
    "a goal is clear of what moves": ("9.4 true 2", "sensed", GOAL),
    "the time of a goal": ("9.5 zero 7", "tide", GOAL),
    "a goal by a clock that is off": ("9.6 copy 8 9; copy 13 9", "sensed", GOAL),
    "predictions in a goal": ("9.7 drop 15", "sensed", GOAL),
    "when a cell arrives": ("9.8 zero 19", "tide", ARRIVE),
    "states near a cell that arrives": ("9.9 zero 11", "aimed", ARRIVE),
    "the lower end of what arrives": ("9.10 zero 15", "plane", ARRIVE),
    "the upper end of what arrives": ("9.11 zero 17", "plane", ARRIVE),
    "all of what arrives": ("9.12 number 12 0", "plane", ARRIVE),
    "both halves of what arrives": ("9.13 copy 10 9; copy 16 15", "slit", ARRIVE),
    "what is open does not arrive": ("9.14 drop", "slit", ARRIVE),
    "arrivals that are clear": ("9.15 drop 7", "post in the target", NEARER),
    "every cell of an image": ("3.1 put 5 {5} - 1", "cart", NEARER),
    "the last cells of a row": ("3.2 put 6 {5} + 1", "ring", NEARER),
    "the last cells of a long row": ("3.3 put 7 {6} + 1", "bent rail", NEARER),
    "past an upper end by a cell": ("3.4 weaken 3", "out to the right", NEARER),
    "past a lower end by a cell": ("3.4 zero 17", "out to the left", NEARER),
    "every cell of an image at once": ("3.5 false 1", "line", NEARER),
    "what is past an end": ("3.6 put 9 __import__('dataclasses').replace({9}, periodic=False)", "circle", NEARER),
    "inputs that are clear": ("3.7 true 2", "beside a post", NEARER),
    "words that miss nothing": ("3.29 drop 4", "pursued", NEARER),
    "cells of a word that miss nothing": ("3.30 false 1", "pursued", NEARER),
    "inputs of cells that go along": ("3.31 drop 2", "pursued where it must not go up", NEARER),
    "which input of cells that go along": ("3.31 drop 11", "pursued where it must not go up", NEARER),
    "where images of all cells end": ("3.32 copy 19 16", "pursued", NEARER),
    "where images of all cells begin": ("3.32 copy 16 19", "pursued", NEARER),
    "cells that no input keeps safe": ("3.34 put 5 False", "pursued without a target", NEARER),
    "images past the ends of a row": ("3.35 zero 9", "pursued without a target", NEARER),
    "every group of inputs": ("3.33 put 10 np.arange(len(first))", "pursued where it must not go up", NEARER),
}
# what is changed, the robot of which plain loops then say something else
ANOTHER = {
    "cells whose images change": ("3.8 zero 7; zero 22", "cornered"),
    "cells at an end": ("3.9 put 17 -1", "to the left"),
    "words that change": ("3.10 zero 4", "cart"),
    "only what was in the set": ("3.11 drop 3", "cart"),
    "arrivals by inputs that are clear": ("9.16 drop 3", "post in the target"),
    "inputs that lead there": ("3.12 false 1", "line"),
    "safe inputs": ("3.13 drop 12", "cart"),
    "all inputs": ("3.14 number 4 1; 3.15 number 4 1", "line"),
}
# what is changed, the test of tests/test_tape.py that fails with it, and of which operation
WRONG = {
    "rounding of sums": ("7.1 drop 3", TESTED, "add"),
    "rounding of sums above": ("7.2 drop 4", TESTED, "sub"),
    "rounding of products": ("7.3 drop 7", TESTED, "mul"),
    "what a product loses": ("7.4 zero 2", TESTED, "mul"),
    "all corners": ("7.5 copy 4 6; copy 8 11", TESTED, "mul"),
    "signs": ("7.6 drop 4", TESTED, "mul"),
    "a divisor of zero": ("7.7 drop 3", TESTED, "div"),
    "a share of zero": ("7.8 zero 15", TESTED, "share"),
    "hills": ("7.9 drop 7", TESTED, "sin"),
    "valleys": ("7.10 drop 11", TESTED, "cos"),
    "where hills are": ("7.11 drop 6", TESTED, "sin"),
    "poles": ("7.12 drop 18", TESTED, "tan"),
    "laps of a rest": ("7.13 copy 4 9", TESTED, "mod"),
    "a power of zero": ("7.14 drop 3", TESTED, "power -1"),
    "powers below zero": ("7.15 copy 2 11", TESTED, "power -1"),
    "what falls": ("7.15 zero 11", TESTED, "neg"),
    "what is even": ("7.18 false 2", TESTED, "hypot"),
    "even powers": ("7.18 false 7", TESTED, "power 2"),
    "other corners": ("7.19 drop 3", TESTED, "pow"),
    "an angle that jumps": ("7.20 drop 15", TESTED, "arctan2"),
    "a base of zero": ("7.21 drop 23", TESTED, "pow"),
    "errors of functions": ("7.22 zero 9", TESTED, "exp"),
    "what is equal": ("7.23 put 7 {9} == {25}", TESTED, "equal"),
    "an open condition": ("7.24 drop 10", TESTED, "where"),
    "NaN": (
        "7.25 true 5; 7.26 true 5; 7.27 true 5; 7.28 copy 4 5; copy 20 13; true 27",
        "is_undefined_stays_so",
        "equal",
    ),
    "endless ends": ("7.28 drop 4", "is_undefined_stays_so", "exp"),
    "nodes in a box": ("7.29 put 8 int({13})", "gridded", 2),
    "the last block": ("7.35 put 2 max({3}, 1)", "of_boxes_with_many_nodes", (900,)),
    "boxes of which one operand differs": ("7.36 drop 6", "share_coordinates_have_the_bounds_of_each", 0),
    "rounding of tables": ("7.30 zero 2", "of_tables_hold_what_is_exact", 2),
}


@pytest.fixture
def without(monkeypatch):
    """The prover goes on without something."""

    def change(row):
        monkeypatch.setattr(word_tubes, "COUNTED", 0)
        with mutations.modules(mutations.PROVER, row) as made:
            if "certified/word_tubes.py" in made:
                made["certified/word_tubes.py"].COUNTED = 0
            for user in (sdhj.certified.sets, sdhj.certified.table):
                for module in made.values():
                    for name in {"GeneralProof", "aligned"} & vars(user).keys() & vars(module).keys():
                        monkeypatch.setattr(user, name, getattr(module, name))

    return change


@pytest.mark.parametrize("name", FALSE)
def test_the_checker_refuses_what_is_proved_without_it(name, without, tmp_path):
    change, robot, claim = FALSE[name]
    without(change)
    path = save(robot, tmp_path / "false.npz")
    try:
        said = [str(one) for one in verify(path, everywhere=True, progress=False).claims if one.failed]
    except ValueError as error:
        said = [str(error)]
    assert any(claim in one for one in said)


@pytest.mark.parametrize("name", ANOTHER)
def test_plain_loops_say_something_else_without_it(name, without):
    change, robot = ANOTHER[name]
    without(change)
    with pytest.raises(AssertionError):
        assert_all_that_follows(solved(robot))


@pytest.mark.parametrize("name", WRONG)
def test_bounds_are_not_bounds_without_it(name, monkeypatch):
    change, test, operation = WRONG[name]
    with mutations.modules(mutations.KERNELS, change) as made:
        monkeypatch.setattr(tape, "play_bounds", made["kernels/tape.py"].play_bounds)
    given = (operation,)
    if isinstance(operation, str):
        op, _, n = operation.partition(" ")
        given = op, int(n or 0)
    check = next(getattr(test_tape, one) for one in dir(test_tape) if one.endswith(test))
    with pytest.raises(AssertionError), np.errstate(all="ignore"):
        check(*given)
