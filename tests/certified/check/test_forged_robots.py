"""Forged tables of robots: each is refused with its sentence, and every line of the checker refuses one of them."""

import dataclasses
import re
from pathlib import Path

import mutations
import numpy as np
import pytest
from changes import unlisted
from forged_robots import CLEAR, FORGERIES, NEARER, ROBOTS, save
from naive_certified import CIRCLE, LINE, SMALL, STILL
from parameters import but_slow

import sdhj
from sdhj.certified.check import verify, windows
from sdhj.certified.check.robots import Robot, Unbounded

BESIDE = {name: ROBOTS[name][0] for name in ("hidden", "hidden and moving")}  # what is given beside the file
SAYS = dict.fromkeys(BESIDE, "rests on what is stated of wall")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of a robot's file, by its name; each is made once."""
    folder, made = tmp_path_factory.mktemp("robots"), {}

    def read(name):
        if name not in made:
            made[name] = save(name, folder / f"{name}.npz").read_bytes()
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
    (tmp_path / "true.npz").write_bytes(files(name))
    assert proves(verify, tmp_path / "true.npz", name)


@pytest.mark.parametrize("name", but_slow(["line", "tide"], "tide"))
def test_pieces_in_which_nothing_is_bounded_leave_open_what_shorter_ones_prove(name, files, tmp_path, monkeypatch):
    piece, asked = Robot.piece, []

    def fail(self, box, moved, j, times, far):
        asked.append(long := times[1] - times[0] > 0.5 * self.length / self.parts)
        if long:
            raise Unbounded("nothing was found")
        return piece(self, box, moved, j, times, far)

    (tmp_path / "true.npz").write_bytes(files(name))
    monkeypatch.setattr(Robot, "piece", fail)
    assert proves(verify, tmp_path / "true.npz", name) and set(asked) == {False, True}
    forgery = next(one for one in FORGERIES.values() if one.robot == name)
    assert any(
        forgery.said in said for said in refusals(verify, forgery.write(files(name), tmp_path / "f.npz"), forgery)
    )
    monkeypatch.setattr(Robot, "driven", fail_always)
    with pytest.raises(ValueError, match="nothing was found"):
        verify(tmp_path / "true.npz", progress=False)


def fail_always(*_):
    raise Unbounded("nothing was found")


LONG = ["a wall that holds", "the tide of another hour", "gusts that grow", "gusts of another input"]


@pytest.mark.parametrize("name", but_slow(FORGERIES, *LONG))
def test_what_is_false_is_refused_with_its_sentence(name, files, tmp_path):
    forgery = FORGERIES[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    assert any(forgery.said in said for said in refusals(verify, path, forgery))


@pytest.mark.parametrize("name", [name for name, one in FORGERIES.items() if one.said in (CLEAR, NEARER)])
def test_what_is_false_is_refused_where_all_cells_are_looked_at_at_once(name, files, tmp_path, monkeypatch):
    monkeypatch.setattr(windows, "LEAST_CELLS", 1)
    forgery = FORGERIES[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    assert any(forgery.said in said for said in refusals(verify, path, forgery))


@pytest.mark.slow
def test_an_arm_among_obstacles_is_proved_as_any_robot(tmp_path):
    """What its proof looks up in small boxes the checker halves as often as it takes."""
    arm = sdhj.arm_case_study(**(SMALL | {"obstacles": [STILL, LINE, CIRCLE]}))
    wall = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.3, name="wall")
    problem = dataclasses.replace(arm, unsafe=(*arm.unsafe, wall))
    sdhj.solve(problem, sdhj.Certified(cells=(24, 24, 10, 10), parts=4), progress=False).save(tmp_path / "arm.npz")
    assert (verdict := verify(tmp_path / "arm.npz", samples=300, progress=False)).ok, str(verdict)


# ---- mutations

# what is changed of which mark `# check`, the forgery that is then believed, or the robot that is not proved any more
MUTATIONS = {
    "where an axis begins": ("1.1 true 14", "cells that begin elsewhere"),
    "how long an axis is": ("1.1 put 2 True and {9} and {14}", "a longer axis"),
    "the last cell": ("1.2 true 11", "cells that are too narrow"),
    "no cell past the end": ("1.2 true 4", "cells that are too wide"),
    "a length as it is written": ("1.4 false 11; number 19 1", "a length that is a guess"),
    "a period nearly as it is": ("1.4 drop 14", "a period that is a guess"),
    "cells that move alike are alike": ("1.5 true 7", "cells that are not alike"),
    "no wall where cells move alike": ("1.5 true 23", "a wall on the way"),
    "a wall and velocities in one range": ("1.6 false 6", "a wall on the way"),
    "layers at walls": ("1.7 true 3", "a layer at an end that is no wall"),
    "layers at either end": ("1.7 zero 9", "a layer at an upper end that is no wall"),
    "no layers where an axis closes": ("1.7 drop 11", "a layer where an axis closes"),
    "layers of cells that do not move alike": ("1.7 drop 16", "a layer of cells that move alike"),
    "where a lower layer is": ("1.8 drop 14", "standing"),
    "the lower end of an image beside layers": (
        "3.8 copy 3 4; number 12 9.0",
        "the fastest that are not held by the wall",
    ),
    "layers have no width": ("1.9 put 7 sorted({11} + 0.01 * i for i in range(len({7})))", "standing"),
    "layers are cells": ("1.10 drop 4", "standing"),
    "a short piece beside a layer": ("1.11 false 4", "standing soon"),
    "room only where something grows": ("1.12 drop 4", "standing"),
    "errors of measurements before": ("3.9 drop 9", "one measurement that errs"),
    "errors of measurements after": ("3.10 drop 7", "one measurement that errs"),
    "what is remembered": ("3.11 false 1", "errors that are forgotten"),
    "images shrunk once": ("3.12 put 17 2 * {17}", "images shrunk by too much"),
    "the middle": ("3.13 put 2 {4} < {4}", "a middle that is elsewhere"),
    "errors in all but a layer": ("3.80 true 7", "a measurement that errs nowhere"),
    "errors in all but an upper layer": ("3.80 true 14", "a measurement that errs nowhere"),
    "who remembers to be in a layer": ("3.80 false 7", "noisy"),
    "who remembers to be in an upper layer": ("3.80 false 14", "noisy"),
    "points beside a layer": ("3.81 drop", "half a shell above a wall"),
    "points beside an upper layer": ("3.82 drop", "half a shell below a wall"),
    "memory or none": ("7.8 true 3", "head: memory"),
    "a late end": ("3.14 drop 6", "no late end"),
    "an early end": ("3.15 drop 17", "no early end"),
    "all ends from the earliest on": ("3.16 copy 4 10", "no early end"),
    "what counts from the earliest on": ("3.17 true 1", "no early end"),
    "walls": ("3.18 copy 2 5", "a wall that holds"),
    "the time of a piece": ("3.19 copy 16 18; copy 19 21", "the tide of another hour"),
    "the time of a step": ("3.20 zero 15", "the tide of another hour"),
    "the whole time of a piece": ("3.21 put 20 {20}[:1] * 2", "a little later"),
    "room to stay in": ("3.22 put 2 {2} | True", "less growth"),
    "all that is reached from the box": ("3.23 drop 8", "a speed that grows"),
    "the face in which the last can be": ("3.24 drop 13", "less growth"),
    "the face on its side": ("3.24 number 12 1", "growth from the lower end"),
    "the worst in a face": ("3.25 zero 10", "less growth"),
    "ends in no face": ("3.94 drop", "a shorter move"),
    "states near a cell": ("3.26 drop 13", "states near a cell"),
    "what an image may stick out": ("3.27 number 2 2e-10", "states near a cell"),
    "the lower end of an image": ("3.28 true 3", "a shorter move"),
    "the upper end of an image": ("3.28 true 15", "a move that ends too early"),
    "cells that are not alike": ("3.29 false 1", "a seam like any other edge"),
    "moves that do not hold": ("3.30 true 4", "a stronger push"),
    "every input": ("4.27 put 9 [range(2)]", "out by the upper end"),
    "the adversary": ("3.31 false 1", "a stronger push"),
    "bounds at all times": ("3.32 put 19 (0.0, 0.0)", "gusts that grow"),
    "bounds of the input": ("3.32 put 16 0 * {16}", "gusts of another input"),
    "gain of both signs": ("3.33 copy 6 10", "gusts from the other side"),
    "both ends of a push": ("3.34 turn 4", "an adversary that enters as it likes"),
    "all components of a push": ("3.35 put 4 {6}[:, :, 0]", "two that push"),
    "what is told of predictions": ("3.36 false 1", "predictions as near as measurements"),
    "errors of measurements in predictions": ("3.37 drop 9", "predictions as near as measurements"),
    "halving ends": ("3.38 drop", "predictions as near as measurements"),
    "predictions of the next": ("3.39 drop 10", "predictions that begin where the state is"),
    "how far a prediction moves": ("3.40 put 3 0 * {8}[0]; put 11 0 * {16}[0]", "predictions that move on at once"),
    "predictions under every input": ("3.41 number 4 1", "predictions for the first input"),
    "predictions at every time": ("3.42 drop 11", "predictions for the first step"),
    "predictions of both signs": ("3.43 copy 2 5", "predictions pushed one way"),
    "what is on the way": ("4.28 copy 4 10", "a post not met at the end"),
    "both halves of a box": ("4.29 number 12 1", "the far half of a tube"),
    "every unsafe set": ("4.30 put 2 {2}[:1]", "the second post"),
    "sets of some inputs": ("4.50 drop 6", "an input where it is forbidden"),
    "sets of all inputs": ("4.50 false 2", "the second post"),
    "a set is closed": ("4.31 weaken 2", "a set that is closed"),
    "states near a tube": ("4.32 drop 16", "a set nearer than rounding"),
    "states near a part of a tube": ("4.33 drop 20", "a moving set nearer than rounding"),
    "looked up in its own part": ("4.52 put 8 0", "a post beside an uncertain clock"),
    "looked up in all parts": ("4.77 put 7 {9}[:0].any(axis=0)", "a post beside an uncertain clock"),
    "boxes at their own time": ("4.79 put 12 0 * {12}", "a post beside an uncertain clock"),
    "a black box at its own time": ("4.80 put 13 0", "a black box that comes meanwhile"),
    "a clock that is off, looked up": ("4.58 put 3 {15}", "a post beside an uncertain clock"),
    "all of a tube, looked up": ("4.59 put 6 {9}[:, 0, 0]; put 15 {9}[:, 0, 1]", "a rock at the end of the way"),
    "the lower end, looked up": ("4.60 true 3", "out by the lower end"),
    "the upper end, looked up": ("4.61 true 3", "out by the upper end"),
    "sets of an input, looked up": ("4.62 true 1", "an input where it is forbidden"),
    "no box that may meet a set": ("4.63 true 8", "the second post"),
    "no box around several tubes": ("4.78 true 2", "the second post"),
    "a least of several": ("6.41 true 1", "the second post"),
    "the upper end": ("4.35 true 3", "out by the upper end"),
    "the lower end": ("4.36 true 3", "out by the lower end"),
    "how near past an end": ("4.37 number 2 10.0", "out by the lower end"),
    "sites of the target, too": ("5.17 drop", "plane"),
    "sites at every time": ("5.18 put 3 False", "tide"),
    "all of a cell that arrives": ("5.19 zero 3", "an arrival more"),
    "where a cell arrives": ("5.19 zero 11", "an arrival that leaves"),
    "states near a cell that arrives": ("5.19 zero 7", "an arrival nearer than rounding"),
    "when a cell arrives": ("5.20 zero 8; zero 14", "tide"),
    "inside the target": ("5.21 put 4 {4} | True", "an arrival more"),
    "arrivals are looked at": ("5.22 drop", "an arrival more"),
    "the input that arrives": ("5.23 zero 2", "line"),
    "the box of each that arrives": ("5.24 put 2 {2}[::-1]", "line"),
    "the boxes of an input": ("3.83 put 6 {6}[::-1]", "line"),
    "the input of a box": ("3.84 put 11 {11}[::-1]", "line"),
    "the input of the half of a box": ("3.85 put 17 0 * {17}", "turning"),
    "arrivals count": ("3.77 drop", "thin"),
    "arrivals of what is known": ("7.55 drop 7", "arrivals of predictions"),
    "clear in every step": ("4.38 false 6", "a post that comes later"),
    "sets at the time of a step": ("4.39 zero 7", "a post that comes later"),
    "sets at all times of a step": ("4.39 zero 13", "a post that comes meanwhile"),
    "a clock that is off": ("4.40 put 3 {4} + {7}; put 9 {10} - {7}", "a post beside an uncertain clock"),
    "a clock that is ahead": ("4.40 turn 3", "a post behind an uncertain clock"),
    "when an input begins": ("4.41 drop 6", "a post beside an uncertain clock"),
    "where a periodic axis closes": ("4.42 drop", "a set behind the seam"),
    "laps": ("4.43 zero 12", "a set before the seam"),
    "all of a tube": ("4.44 put 9 {12}[:, 0, 0]; put 18 {12}[:, 0, 1]", "a rock at the end of the way"),
    "all parts of a tube": ("4.45 true 1; 4.46 copy 2 15", "a rock at the end of the way"),
    "wholly past a lower end": ("4.47 true 3", "a rock at a safe end"),
    "wholly past an upper end": ("4.48 true 3", "a rock at the upper safe end"),
    "what is not clear": ("4.49 copy 1 5; copy 9 11", "the second post"),
    "all of a goal": ("5.17 copy 3 6", "a goal more"),
    "a goal is safe": ("5.14 drop", "a goal in a post"),
    "the time of a goal": ("5.15 zero 12; zero 19", "a goal of another time"),
    "a goal by a clock that is off": ("5.15 copy 8 9; copy 15 9", "a goal beside an uncertain clock"),
    "predictions in a goal": ("5.16 drop 15", "a goal beside an error"),
    "sets that grow": ("2.2 false 12", "a set that loses a cell"),
    "sets that shrink": ("2.2 false 8", "a set that wins a cell"),
    "every cell of an image": ("3.44 put 1 {2} > 0", "a cell more"),
    "inputs that are clear": ("3.45 put 2 {14}.ones(len({8}), {14}.bool_)", "a cell of which no input is clear"),
    "the next set": ("3.46 drop 12", "a step into sets of another time"),
    "what stays is new each time": ("3.47 drop 5", "a cell that is not safe as long"),
    "for ever": ("3.48 drop 6", "a cell that is not safe for ever"),
    "past a lower end by a cell": ("3.49 weaken 8", "past the lower end by less than a cell"),
    "past an upper end by a cell": ("3.50 weaken 8", "past the upper end by less than a cell"),
    "only safe ends": ("3.49 drop 3", "past a wall"),
    "black boxes are tried": ("7.9 true 3", "a slope of 0"),
    "values above what is stated": ("7.10 drop 14", "an enclosure that ends below"),
    "values below what is stated": ("7.10 drop 9", "an enclosure that begins above"),
    "a slope counts": ("1.13 zero 15; put 16 {8}[:, :1]", "hidden"),
    "a rate counts": ("1.14 zero 4", "hidden and moving"),
    "black boxes are asked for": ("7.11 false 16", "nobody's black box"),
    "what it rests on is said": ("1.15 drop", "hidden"),
    "one move for each time": ("7.12 drop 5", "moves of one hour"),
    "sets for each time": ("7.13 true 3", "sets for all times"),
    "moves that begin": ("7.14 true 7", "moves that end before they begin"),
    "no jitter with a tide": ("7.15 true 3", "a clock that is off, and a tide"),
    "measurements in predictions": ("7.16 true 3", "predictions nearer than measurements"),
    "formulas of another format": ("7.17 true 3", "head: another format"),
    "a formula": ("7.18 true 3", "head: no bounds"),
    "bounds for each input": ("7.19 true 3", "head: bounds of some inputs"),
    "results of a function": ("7.20 true 2", "head: results"),
    "one result of a set": ("7.21 true 9", "head: two results"),
    "coordinates of a function": ("7.22 true 3", "head: coordinates"),
    "axes of a set": ("7.23 true 7", "head: axes"),
    "an axis twice": ("7.24 drop 12", "head: axes twice"),
    "fields that are known": ("7.50 true 3", "head: lines"),
    "numbers of inputs": ("7.49 zero 13", "head: inputs of a set"),
    "the target first": ("7.25 true 2", "head: kinds"),
    "kinds of ends": ("7.26 true 6", "head: ends"),
    "lower and upper ends": ("7.27 true 3", "head: order"),
    "lists of axes": ("7.28 true 2", "head: seven axes"),
    "numbers": ("7.29 true 2", "head: NaN"),
    "numbers of nodes": ("7.30 true 6", "head: nodes"),
    "what is periodic": ("7.31 true 6", "head: periods"),
    "late by half a step": ("7.32 put 12 2 * {13}", "head: jitter"),
    "errors on each axis": ("7.33 true 3", "head: error"),
    "errors of at least 0": ("7.34 drop 20", "head: an error below zero"),
    "some inputs": ("7.35 true 3", "head: no inputs"),
    "whole steps": ("7.36 true 3", "head: steps"),
    "some parts": ("7.37 true 3", "head: parts"),
    "some cells": ("7.38 true 6", "head: one cell"),
    "fractions": ("7.39 true 3", "head: widths"),
    "one flag for each axis": ("7.40 true 3", "head: axes of a place"),
    "one number for each axis": ("7.33 true 3", "head: predictions"),
    "predictions of at least 0": ("7.41 drop 13", "head: predictions below zero"),
    "lines before": ("7.3 put 8 10 ** 6", "text: a later line"),
    "coordinates": ("7.42 put 6 int({9})", "text: another coordinate"),
    "so many operands": ("7.43 true 4", "text: operands"),
    "numbers as they are": ("7.44 true 4", "text: a decimal"),
    "a last line": ("7.45 true 4", "text: no result"),
    "lines of text": ("7.46 true 4", "text: no text"),
    "a list of lines": ("7.4 drop 3", "text: no list"),
    "truths": ("7.6 true 4", "text: a truth that is none"),
    "steps of a table": ("7.47 drop 12", "text: a table backwards"),
    "axes of a table": ("7.48 true 3", "text: a table of more axes"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, files, tmp_path):
    """Without it a robot is not proved, or a forgery not refused with its sentence, as the tests above ask."""
    change, needs = MUTATIONS[name]
    with mutations.checker(tmp_path, change) as check:
        if needs in ROBOTS:
            (tmp_path / "true.npz").write_bytes(files(needs))
            assert not proves(check, tmp_path / "true.npz", needs)
            return
        forgery = FORGERIES[needs]
        path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
        try:
            said = refusals(check, path, forgery)
        except Exception:  # a test notices that as well
            return
        assert not any(forgery.said in one for one in said)


@pytest.mark.slow
@pytest.mark.parametrize("change", unlisted("check"))
def test_the_check_needs_what_is_marked_and_not_listed(change, files, tmp_path):
    """Of what is marked `# check 4` alone every change is noticed by a robot or a forgery."""
    with mutations.checker(tmp_path, change) as check:
        for name in ROBOTS:
            (tmp_path / "true.npz").write_bytes(files(name))
            if not proves(check, tmp_path / "true.npz", name):
                return
        for forgery in FORGERIES.values():
            path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
            if not any(forgery.said in said for said in refusals(check, path, forgery)):
                return
    pytest.fail("nothing notices it")


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
