"""Forged tables of robots: each is refused with its sentence, and every line of the checker refuses one of them."""

import dataclasses
import re
from pathlib import Path

import mutations
import numpy as np
import pytest
from forged_robots import FORGERIES, ROBOTS, save
from naive_certified import CIRCLE, LINE, SMALL, STILL

import sdhj
from sdhj.certified.check import verify

BESIDE = {name: ROBOTS[name][0] for name in ("hidden", "hidden and moving")}  # what is given beside the file
SAYS = dict.fromkeys(BESIDE, "rests on what is stated of wall")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of a robot's file, by its name; each is made once."""
    folder, made = tmp_path_factory.mktemp("robots"), {}

    def read(name):
        if name not in made:
            made[name] = save(name, folder / f"{name}.h5").read_bytes()
        return made[name]

    return read


def refusals(check, path, forgery):
    """What a checker says against a forgery."""
    samples = 20 if forgery.robot == "windy" else None  # all of those are of what it says, not of what holds
    try:
        verdict = check(path, forgery.beside and forgery.beside(), samples=samples, progress=False)
    except ValueError as error:
        return [str(error)]
    return [str(claim) for claim in verdict.claims if claim.failed]


def proves(check, path, name):
    """Whether it proves a robot's file, and says what that rests on."""
    try:
        said = str(check(path, BESIDE[name]() if name in BESIDE else None, progress=False))
    except ValueError:
        return False
    return "NOT proved" not in said and ("rests on" in said) == (name in SAYS) and SAYS.get(name, "proved") in said


@pytest.mark.parametrize("name", ROBOTS)
def test_what_is_true_is_proved(name, files, tmp_path):
    (tmp_path / "true.h5").write_bytes(files(name))
    assert proves(verify, tmp_path / "true.h5", name)


@pytest.mark.parametrize("name", FORGERIES)
def test_what_is_false_is_refused_with_its_sentence(name, files, tmp_path):
    forgery = FORGERIES[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.h5")
    assert any(forgery.said in said for said in refusals(verify, path, forgery))


@pytest.mark.slow
def test_an_arm_among_obstacles_is_proved_as_any_robot(tmp_path):
    """What its proof looks up in small boxes the checker halves as often as it takes."""
    arm = sdhj.arm_case_study(**(SMALL | {"obstacles": [STILL, LINE, CIRCLE]}))
    wall = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.3, name="wall")
    problem = dataclasses.replace(arm, unsafe=(*arm.unsafe, wall))
    sdhj.solve(problem, sdhj.Certified(cells=(24, 24, 10, 10), parts=4), progress=False).save(tmp_path / "arm.h5")
    assert (verdict := verify(tmp_path / "arm.h5", samples=300, progress=False)).ok, str(verdict)


# ---- mutations

ROBOTS_PY, READING, VERIFY, DESCRIBED, FORMULAS = (
    f"{name}.py" for name in ("robots", "reading", "__init__", "described", "formulas")
)

# file, what is taken out, what is left, the forgery that is then believed, or the robot that is not proved any more
MUTATIONS = {
    "where an axis begins": (READING, "begin in (None, low)", "True", "cells that begin elsewhere"),
    "how long an axis is": (READING, "least <= shortest and most >= longest", "True", "a longer axis"),
    "the last cell": (READING, "n * width >= most", "True", "cells that are too narrow"),
    "no cell past the end": (READING, "(n - 1) * width < least", "True", "cells that are too wide"),
    "a length as it is written": (
        ROBOTS_PY,
        "if periodic else Fraction(0)",
        "if False else Fraction(1)",
        "a length that is a guess",
    ),
    "a period nearly as it is": (ROBOTS_PY, "length / 2**40 if", "length if", "a period that is a guess"),
    "cells that move alike are alike": (
        ROBOTS_PY,
        "abs(n * width - most) <= STICKS_OUT * float(self.scale[axis])",
        "True",
        "cells that are not alike",
    ),
    "no wall where cells move alike": (ROBOTS_PY, "else free", "else True", "a wall on the way"),
    "a wall and velocities in one range": (
        DESCRIBED,
        'any(one.reads("x") for one in some)',
        "False",
        "a wall on the way",
    ),
    # layers
    "layers at walls": (
        ROBOTS_PY,
        'at_wall = grid.ends[k][side] == "wall" and',
        "at_wall = True and",
        "a layer at an end that is no wall",
    ),
    "layers at either end": (
        ROBOTS_PY,
        "grid.ends[k][side] == ",
        "grid.ends[k][0] == ",
        "a layer at an upper end that is no wall",
    ),
    "no layers where an axis closes": (
        ROBOTS_PY,
        "and not grid.periodic[k] and",
        "and",
        "a layer where an axis closes",
    ),
    "layers of cells that do not move alike": (
        ROBOTS_PY,
        "and not grid.periodic[k] and self.known[k]",
        "and not grid.periodic[k]",
        "a layer of cells that move alike",
    ),
    "where a lower layer is": (
        ROBOTS_PY,
        "float(lower - self.layers[axis][0] * width)",
        "float(lower)",
        "standing",
    ),
    "the lower end of an image beside layers": (
        ROBOTS_PY,
        "first = begin + (own + low) * float(width) - self.edges[axis][own]",
        "first = begin - 9.0",
        "the fastest that are not held by the wall",
    ),
    "layers have no width": (
        READING,
        "[*[begin] * a, *inner, end, *[end] * b]",
        "[begin + i * float(width) for i in range(n + 1)]",
        "standing",
    ),
    "layers are cells": (READING, "n = cells - some", "n = cells", "standing"),
    "a short piece beside a layer": (ROBOTS_PY, "if part == 0 and any(", "if False and any(", "standing soon"),
    "room only where something grows": (
        ROBOTS_PY,
        "more = OUTWARD * some * (far != 0)",
        "more = OUTWARD * some",
        "standing",
    ),
    # moves
    "errors of measurements before": (
        ROBOTS_PY,
        "held(np.zeros((2, *cells.shape)) + OUTWARD * self.off)",
        "held(np.zeros((2, *cells.shape)))",
        "one measurement that errs",
    ),
    "errors of measurements after": (
        ROBOTS_PY,
        "held(last + OUTWARD * self.off)",
        "held(last)",
        "one measurement that errs",
    ),
    "what is remembered": (ROBOTS_PY, "if not self.sensing.memory:", "if False:", "errors that are forgotten"),
    "images shrunk once": (
        ROBOTS_PY,
        "- at, last - OUTWARD * self.off",
        "- at, last - 2 * OUTWARD * self.off",
        "images shrunk by too much",
    ),
    "the middle": (
        ROBOTS_PY,
        "middle = (first > second) & self.known",
        "middle = first < first",
        "a middle that is elsewhere",
    ),
    "memory or none": (READING, "expect(self.memory in (True, False)", "expect(True", "head: memory"),
    "a late end": (ROBOTS_PY, "self.length = self.delta + 2 * self.jitter", "self.length = self.delta", "no late end"),
    "an early end": (ROBOTS_PY, "self.length - 4 * self.jitter", "self.length", "no early end"),
    "all ends from the earliest on": (
        ROBOTS_PY,
        "least, most = np.minimum(least, moved[0]), np.maximum(most, moved[1])",
        "least, most = moved",
        "no early end",
    ),
    "what counts from the earliest on": (ROBOTS_PY, "if begin <= soonest:", "if True:", "no early end"),
    "walls": (ROBOTS_PY, "np.clip(at + moved, *bars)", "at + moved", "a wall that holds"),
    "the time of a piece": (ROBOTS_PY, "(start + begin, start + end)", "(begin, end)", "the tide of another hour"),
    "the time of a step": (ROBOTS_PY, "self.time(start), finer", "self.time(0), finer", "the tide of another hour"),
    "the whole time of a piece": (
        ROBOTS_PY,
        "np.concatenate(every, axis=1), times)",
        "np.concatenate(every, axis=1), times[:1] * 2)",
        "a little later",
    ),
    "room to stay in": (ROBOTS_PY, "(~self.known | (OUTWARD * (room - box - far) > 0)).all()", "True", "less growth"),
    "all that is reached from the box": (
        ROBOTS_PY,
        "(far + more)  #",
        "more  #",
        "a speed that grows",
    ),
    "a closer tube": (ROBOTS_PY, "room = box + self.known * (far", "room = room + 0 * (far", "rail"),
    "the face in which the last can be": (
        ROBOTS_PY,
        "(box[side] + far + OUTWARD",
        "(box[side] + OUTWARD",
        "less growth",
    ),
    "the face on its side": (ROBOTS_PY, "(box[side] + far", "(box[1] + far", "growth from the lower end"),
    "the worst in a face": (
        ROBOTS_PY,
        "found[side, own, :, axis]",
        "found[0, own, :, axis]",
        "less growth",
    ),
    "states near a cell": (ROBOTS_PY, "self.ends(cells, self.near)", "self.ends(cells)", "states near a cell"),
    "what an image may stick out": (ROBOTS_PY, "STICKS_OUT = 2e-13", "STICKS_OUT = 2e-10", "states near a cell"),
    "the lower end of an image": (ROBOTS_PY, "(first <= moved[0, :, axis] + sticks[axis])", "True", "a shorter move"),
    "the upper end of an image": (
        ROBOTS_PY,
        "(moved[1, :, axis] <= last + sticks[axis])",
        "True",
        "a move that ends too early",
    ),
    "cells that are not alike": (
        ROBOTS_PY,
        "if self.periodic[axis] and self.known[axis]:",
        "if False:",
        "a seam like any other edge",
    ),
    "moves that do not hold": (
        ROBOTS_PY,
        "held[own] = self.moves_hold(",
        "held[own] = True | self.moves_hold(",
        "a stronger push",
    ),
    "every input": (ROBOTS_PY, "range(inputs))], desc", "range(2))], desc", "out by the upper end"),
    # the velocity
    "the adversary": (DESCRIBED, "        if pushed:\n", "        if False:\n", "a stronger push"),
    "bounds at all times": (
        DESCRIBED,
        'self.own["bounds"][j].bounds(low, high, times)',
        'self.own["bounds"][j].bounds(low, high, (0.0, 0.0))',
        "gusts that grow",
    ),
    "bounds of the input": (
        DESCRIBED,
        'self.own["bounds"][j].bounds',
        'self.own["bounds"][0].bounds',
        "gusts of another input",
    ),
    "gain of both signs": (
        DESCRIBED,
        'np.maximum(*map(np.abs, self.own["gain"][j].bounds(low, high, times)))',
        'np.maximum(*self.own["gain"][j].bounds(low, high, times))',
        "gusts from the other side",
    ),
    "both ends of a push": (
        DESCRIBED,
        "((-one, one) for one in half.T)",
        "((one, one) for one in half.T)",
        "an adversary that enters as it likes",
    ),
    "all components of a push": (DESCRIBED, "push = each.sum(axis=2)", "push = each[:, :, 0]", "two that push"),
    # predictions
    "what is told of predictions": (ROBOTS_PY, "if self.sensing:", "if False:", "predictions as near as measurements"),
    "errors of measurements in predictions": (
        ROBOTS_PY,
        "room, wrong, stride = self.off - self.error,",
        "room, wrong, stride = self.off,",
        "predictions as near as measurements",
    ),
    "halving ends": (
        ROBOTS_PY,
        "out = holds(boxes)",
        "out = holds(boxes) | (depth == 0)",
        "predictions as near as measurements",
    ),
    "predictions of the next": (
        ROBOTS_PY,
        "box + travel + OUTWARD * self.off, times)",
        "box + travel, times)",
        "predictions that begin where the state is",
    ),
    "how far a prediction moves": (
        ROBOTS_PY,
        "travel = [np.minimum(slow, 0).min(axis=0), np.maximum(fast, 0).max(axis=0)]",
        "travel = [0 * slow[0], 0 * fast[0]]",
        "predictions that move on at once",
    ),
    "predictions under every input": (
        ROBOTS_PY,
        "range(self.count if self.delay else 0)",
        "range(1)",
        "predictions for the first input",
    ),
    "predictions at every time": (
        ROBOTS_PY,
        "cuts if self.moves.timed else cuts[:1]",
        "cuts[:1]",
        "predictions for the first step",
    ),
    "predictions of both signs": (
        ROBOTS_PY,
        "np.maximum(wild[1] - calm[0], calm[1] - wild[0])",
        "wild[1] - calm[0]",
        "predictions pushed one way",
    ),
    # which inputs are clear
    "what is on the way": (
        ROBOTS_PY,
        "a, b = np.minimum(a, moved[0]), np.maximum(b, moved[1])",
        "a, b = moved",
        "a post not met at the end",
    ),
    "both halves of a box": (
        ROBOTS_PY,
        "(False, True) if one else (False,)",
        "(False,)",
        "the far half of a tube",
    ),
    "every unsafe set": (
        ROBOTS_PY,
        "for part in self.unsafe:\n            own",
        "for part in self.unsafe[:1]:\n            own",
        "the second post",
    ),
    "a set is closed": (
        ROBOTS_PY,
        "else least > 0",
        "else least >= 0",
        "a set that is closed",
    ),
    "states near a tube": (
        ROBOTS_PY,
        "(whole[:, left] + OUTWARD * 2 * self.near)",
        "whole[:, left]",
        "a set nearer than rounding",
    ),
    "states near a part of a tube": (
        ROBOTS_PY,
        "np.moveaxis(swept[at[left], piece], 1, 0) + OUTWARD * 2 * self.near",
        "np.moveaxis(swept[at[left], piece], 1, 0)",
        "a moving set nearer than rounding",
    ),
    "all cells of a block": (
        ROBOTS_PY,
        "np.minimum(first[some] + sides, counts) - 1",
        "first[some]",
        "the second post",
    ),
    "the upper end": (ROBOTS_PY, "(whole[1, :, axis] <= grid.upper[axis] + room)", "True", "out by the upper end"),
    "the lower end": (ROBOTS_PY, "(whole[0, :, axis] >= grid.lower[axis] - room)", "True", "out by the lower end"),
    "how near past an end": (ROBOTS_PY, "ROOM = 1e-6", "ROOM = 10.0", "out by the lower end"),
    "clear in every step": (
        ROBOTS_PY,
        "range(len(self.clear)) if starts == 1 else [start]",
        "[start]",
        "a post that comes later",
    ),
    "sets at the time of a step": (
        ROBOTS_PY,
        "[self.time(step) + piece",
        "[self.time(0) + piece",
        "a post that comes later",
    ),
    "sets at all times of a step": (
        ROBOTS_PY,
        "piece / self.parts * self.length",
        "piece / self.parts * 0.0",
        "a post that comes meanwhile",
    ),
    "a clock that is off": (
        ROBOTS_PY,
        "when = times[0] - self.jitter, times[1] + self.jitter",
        "when = times[0] + self.jitter, times[1] - self.jitter",
        "a post beside an uncertain clock",
    ),
    "a clock that is ahead": (
        ROBOTS_PY,
        "when = times[0] - self.jitter,",
        "when = times[0] + self.jitter,",
        "a post behind an uncertain clock",
    ),
    "when an input begins": (
        ROBOTS_PY,
        "return step * self.delta + self.delay",
        "return step * self.delta",
        "a post beside an uncertain clock",
    ),
    "where a periodic axis closes": (
        ROBOTS_PY,
        "low[over], high[over] = np.minimum(low[over], beyond[0]), np.maximum(high[over], beyond[1])",
        "pass",
        "a set behind the seam",
    ),
    "laps": (ROBOTS_PY, "np.floor((a - least) / (most - least)) * (most - least)", "0.0", "a set before the seam"),
    "all of a tube": (
        ROBOTS_PY,
        "swept[:, :, 0].min(axis=1), swept[:, :, 1].max(axis=1)",
        "swept[:, 0, 0], swept[:, 0, 1]",
        "a rock at the end of the way",
    ),
    "all parts of a tube": (
        ROBOTS_PY,
        "if not there.all():\n            until = np.where(there[:, :, None, None], swept[at], swept[at, :1])",
        "if True:\n            until = swept[at, :1]",
        "a rock at the end of the way",
    ),
    "wholly past a lower end": (
        ROBOTS_PY,
        "left |= (b < grid.lower[axis] - self.near[axis])",
        "left |= (a < grid.lower[axis] - self.near[axis])",
        "a rock at a safe end",
    ),
    "wholly past an upper end": (
        ROBOTS_PY,
        "left |= (a > grid.upper[axis] + self.near[axis])",
        "left |= (b > grid.upper[axis] + self.near[axis])",
        "a rock at the upper safe end",
    ),
    "what is not clear": (
        ROBOTS_PY,
        "out[left[~good]], left = False, left[good]",
        "left = left[good]",
        "the second post",
    ),
    # sets
    "all of a goal": (
        ROBOTS_PY,
        "return most <= 0 if inside",
        "return least <= 0 if inside",
        "a goal more",
    ),
    "a goal is safe": (
        ROBOTS_PY,
        "out &= self.outside(part, box[..., list(part.axes)], times)",
        "pass",
        "a goal in a post",
    ),
    "the time of a goal": (
        ROBOTS_PY,
        "(self.time(step) - self.jitter, self.time(step) + self.jitter)",
        "(self.time(0) - self.jitter, self.time(0) + self.jitter)",
        "a goal of another time",
    ),
    "a goal by a clock that is off": (
        ROBOTS_PY,
        "(self.time(step) - self.jitter, self.time(step) + self.jitter)",
        "(self.time(step), self.time(step))",
        "a goal beside an uncertain clock",
    ),
    "predictions in a goal": (
        ROBOTS_PY,
        "self.near + self.off), np.ones",
        "self.near), np.ones",
        "a goal beside an error",
    ),
    "sets that grow": (
        ROBOTS_PY,
        "if self.stays else (less & ~here)",
        "if self.stays else (less & False)",
        "a set that loses a cell",
    ),
    "sets that shrink": (
        ROBOTS_PY,
        "((here & ~less) if self.stays",
        "((here & False) if self.stays",
        "a set that wins a cell",
    ),
    "every cell of an image": (ROBOTS_PY, "total == np.prod(last - first + 1, axis=1)", "total > 0", "a cell more"),
    "inputs that are clear": (
        ROBOTS_PY,
        "out = (clear[numbers, j // 8] >> np.uint8(j % 8)) & 1 == 1",
        "out = np.ones(len(numbers), np.bool_)",
        "a cell of which no input is clear",
    ),
    "the next set": (
        ROBOTS_PY,
        "self.bits(step + 1, within - 1)",
        "self.bits(step, within - 1)",
        "a step into sets of another time",
    ),
    "what stays is new each time": (
        ROBOTS_PY,
        "new = here if self.stays else here & ~less",
        "new = here & ~less",
        "a cell that is not safe as long",
    ),
    "for ever": (ROBOTS_PY, "rows = [(0, 0), (0, 1)]", "rows = [(0, 0)]", "a cell that is not safe for ever"),
    "past a lower end by a cell": (ROBOTS_PY, "(last < -1)", "(last < 0)", "past the lower end by less than a cell"),
    "past an upper end by a cell": (
        ROBOTS_PY,
        "(first > most + 1)",
        "(first > most)",
        "past the upper end by less than a cell",
    ),
    "only safe ends": (ROBOTS_PY, "(last < -1) & self.safe[:, 0]", "(last < -1)", "past a wall"),
    # black boxes, arrays
    "black boxes are tried": (DESCRIBED, "expect(not wrong.size, what,", "expect(True, what,", "a slope of 0"),
    "values above what is stated": (DESCRIBED, " | (value > most + near)", "", "an enclosure that ends below"),
    "values below what is stated": (DESCRIBED, "(value < least - near) | ", "", "an enclosure that begins above"),
    "a slope counts": (DESCRIBED, "slope * np.linalg.norm(by, axis=1, keepdims=True)", "0.0 * by[:, :1]", "hidden"),
    "a rate counts": (
        DESCRIBED,
        "far + duration * (0.0 if rate is None else np.array(rate))",
        "far + 0.0",
        "hidden and moving",
    ),
    "black boxes are asked for": (VERIFY, "and problem is None):", "and False):", "nobody's black box"),
    "what it rests on is said": (ROBOTS_PY, "self.trusted.add(part.name)", "pass", "hidden"),
    "one move for each time": (
        ROBOTS_PY,
        "moves = self.steps if timed else 1, self.count",
        "moves = 1, self.count",
        "moves of one hour",
    ),
    "sets for each time": (ROBOTS_PY, "fits = not self.timeless or", "fits = True or", "sets for all times"),
    "moves that begin": (ROBOTS_PY, "(self.low <= self.high).all()", "True", "moves that end before they begin"),
    "no jitter with a tide": (
        ROBOTS_PY,
        "expect(not (self.jitter and self.moves.timed)",
        "expect(True",
        "a clock that is off, and a tide",
    ),
    "measurements in predictions": (
        ROBOTS_PY,
        "expect(bool((self.off >= self.error).all())",
        "expect(True",
        "predictions nearer than measurements",
    ),
    # the head of a file
    "formulas of another format": (DESCRIBED, 'expect(formulas["format"] == 1', "expect(True", "head: another format"),
    "a formula": (DESCRIBED, 'expect(name in self.texts, f"there', 'expect(True, f"there', "head: no bounds"),
    "bounds for each input": (
        DESCRIBED,
        "len(bounds.results) == d * len(inputs) and",
        "True and",
        "head: bounds of some inputs",
    ),
    "results of a function": (DESCRIBED, "len(found.results) == len(inputs) * each", "True", "head: results"),
    "one result of a set": (DESCRIBED, "len(own.results) == 1", "True", "head: two results"),
    "coordinates of a function": (FORMULAS, "given[name] == count", "True", "head: coordinates"),
    "axes of a set": (DESCRIBED, "is_whole(axis, 0, ndim - 1)", "True", "head: axes"),
    "an axis twice": (DESCRIBED, "len(axes) == len({*axes})", "len(axes)", "head: axes twice"),
    "the target first": (
        DESCRIBED,
        'fits = kinds == ["target"] * first + ["unsafe"] * (len(kinds) - first)',
        "fits = True",
        "head: kinds",
    ),
    "kinds of ends": (DESCRIBED, "{*pair} <= ENDS", "True", "head: ends"),
    "lower and upper ends": (DESCRIBED, "expect(all(a < b for a, b in bounds)", "expect(True", "head: order"),
    "lists of axes": (
        DESCRIBED,
        "1 <= len(lower) <= MOST_AXES and len({len(part) for part in (lower, upper, periodic, shape, ends)}) == 1",
        "True",
        "head: seven axes",
    ),
    "numbers": (
        READING,
        "isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most",
        "True",
        "head: NaN",
    ),
    "numbers of nodes": (
        DESCRIBED,
        "is_whole(n, 2, MOST_ON_AN_AXIS) for n in shape",
        "True for n in shape",
        "head: nodes",
    ),
    "what is periodic": (DESCRIBED, "flag in (True, False) for flag", "True for flag", "head: periods"),
    "late by half a step": (READING, "0.0, delta / 2)", "0.0, 2 * delta)", "head: jitter"),
    "errors on each axis": (READING, "isinstance(values, list) and len(values) == count", "True", "head: error"),
    "errors of at least 0": (READING, "* ndim, ndim, 0.0)", "* ndim, ndim)", "head: an error below zero"),
    "some inputs": (ROBOTS_PY, "expect(1 <= self.count <= MOST_INPUTS", "expect(True", "head: no inputs"),
    "whole steps": (ROBOTS_PY, "expect(is_whole(self.steps, 1, MOST_STEPS)", "expect(True", "head: steps"),
    "some parts": (ROBOTS_PY, "expect(is_whole(self.parts, 1, MOST_COUNTED)", "expect(True", "head: parts"),
    "some cells": (
        READING,
        "is_whole(n, 2, MOST_ON_AN_AXIS) for n in shape",
        "True for n in shape",
        "head: one cell",
    ),
    "fractions": (READING, 'expect(bool(fits), "cells must', 'expect(True, "cells must', "head: widths"),
    "one flag for each axis": (
        ROBOTS_PY,
        'expect(fits, f"the problem has',
        'expect(True, f"the problem has',
        "head: axes of a place",
    ),
    "one number for each axis": (
        READING,
        "isinstance(values, list) and len(values) == count",
        "True",
        "head: predictions",
    ),
    "predictions of at least 0": (
        ROBOTS_PY,
        'stated["unsure"], ndim, 0.0)',
        'stated["unsure"], ndim)',
        "head: predictions below zero",
    ),
    # formulas as text
    "lines before": (
        FORMULAS,
        'self.whole(word, len(self.nodes), "an',
        'self.whole(word, 10**6, "an',
        "text: a later line",
    ),
    "coordinates": (
        FORMULAS,
        "self.whole(words[0], self.leaves[name], kind)",
        "int(words[0])",
        "text: another coordinate",
    ),
    "so many operands": (
        FORMULAS,
        'self.expect(len(words) == count + (name == "power")',
        "self.expect(True",
        "text: operands",
    ),
    "numbers as they are": (FORMULAS, "REAL.fullmatch(word) is not None", "True", "text: a decimal"),
    "a last line": (FORMULAS, 'self.expect(name == "return"', "self.expect(True", "text: no result"),
    "lines of text": (FORMULAS, "self.expect(isinstance(line, str)", "self.expect(True", "text: no text"),
    "a list of lines": (FORMULAS, "isinstance(lines, list) and", "", "text: no list"),
    "truths": (FORMULAS, "self.truths.issuperset(truths)", "True", "text: a truth that is none"),
    "steps of a table": (FORMULAS, "and min(spacing) > 0", "", "text: a table backwards"),
    "axes of a table": (DESCRIBED, "expect(found.ndim == axes", "expect(True", "text: a table of more axes"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, files, tmp_path):
    """Without it a robot is not proved, or a forgery not refused with its sentence, as the tests above ask."""
    file, old, new, needs = MUTATIONS[name]
    with mutations.checker(tmp_path, file, old, new) as check:
        if needs in ROBOTS:
            (tmp_path / "true.h5").write_bytes(files(needs))
            assert not proves(check, tmp_path / "true.h5", needs)
            return
        forgery = FORGERIES[needs]
        path = forgery.write(files(forgery.robot), tmp_path / "forged.h5")
        try:
            said = refusals(check, path, forgery)
        except Exception:  # a test notices that as well
            return
        assert not any(forgery.said in one for one in said)


def test_the_list_of_obligations_is_true():
    """Tests and forgeries that it names are there, and every forgery of what it lists is of one of its claims."""
    text = sdhj.certified.sets.__doc__
    names = re.findall(r'"([^"]+)"', text[text.index("For robots of one's own") :])
    assert len(names) > 35 and set(names) <= FORGERIES.keys()
    tests = {
        name
        for path in Path(__file__).parents[2].rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)", path.read_text(encoding="utf-8"))
    }
    assert set(re.findall(r"\btest_\w+(?!\w|\.py)", text)) <= tests
