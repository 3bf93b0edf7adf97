"""The gate of the checker: what is true is proved, every forgery refused, and nothing in its argument goes unneeded."""

import re
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from forged_robots import (
    ARRIVE,
    CLEAR,
    COVER,
    FORGERIES,
    GOAL,
    GROW,
    MOVES,
    NEAR,
    NEARER,
    ROBOTS,
    Forgery,
    arrives,
    both,
    clears,
    crossed,
    edit,
    first_clear,
    head,
    nothing_in_sets,
    put,
    ring,
    sets,
    standing,
    stream,
)
from forged_robots import line as on_a_line
from naive_certified import CIRCLE, LINE, SMALL, STILL
from parameters import but_slow

import sdhj
from sdhj.certified.check import argument, formulas, reading, stated, verify
from sdhj.certified.check.argument import Argument
from sdhj.certified.check.reading import head_and_arrays

# what the plain checker says of the forgeries that it refuses with words of its own
SAYS = {
    "a layer where an axis closes": "cells must close where the axes do",
    "sets for all times": "there must be sets for each step",
    "moves that end before they begin": "must lead to some cell",
    "nobody's black box": "must have the black box of the file",
    "head: both": "a function is a formula or a black box",
    "head: axes of a place": "axes of a place must be a list of 2",
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of a robot's file, by its name; each is made once."""
    folder, made = tmp_path_factory.mktemp("robots"), {}

    def read(name):
        if name not in made:
            problem, cells, parts = ROBOTS[name] if name in ROBOTS else OTHERS[name]
            table = sdhj.solve(problem(), sdhj.Certified(cells=cells, parts=parts), progress=False, play=False)
            table.save(folder / "table.npz")
            made[name] = (folder / "table.npz").read_bytes()
        return made[name]

    return read


def refusals(path, beside=None, every=True, of=argument):
    """What the plain checker says against a file: a text for each claim that it does not prove, or one sentence."""
    try:
        with reading.head_and_arrays(path) as (told, arrays):
            return [str(claim) for claim in of.Argument(told, arrays, beside).claims(every) if claim.failed]
    except ValueError as error:
        return [str(error)]


def box_beside(name):
    return ROBOTS[name][0]() if name.startswith("hidden") else None


@pytest.mark.parametrize("every", [True, False])
@pytest.mark.parametrize(
    "name", but_slow(ROBOTS, *(name for name in ROBOTS if name.startswith(("pursued", "windy", "bent"))))
)
def test_what_is_true_is_proved(name, every, files, tmp_path):
    (tmp_path / "true.npz").write_bytes(files(name))
    assert refusals(tmp_path / "true.npz", box_beside(name), every) == []


@pytest.mark.parametrize("name", but_slow(FORGERIES, "a steeper wall"))
def test_a_forgery_is_refused(name, files, tmp_path):
    forgery = FORGERIES[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    said = refusals(path, forgery.beside and forgery.beside())
    assert any(SAYS.get(name, forgery.said) in one for one in said), said


# ---- more forgeries


def drifting():
    """A robot whose target alone moves, so that no unsafe set nor velocity tells of a time."""
    target = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.4 * t) - 1.0)
    return replace(on_a_line(), target=target)


def carried():
    """A place between walls, carried on by a current that depends on a second coordinate, which stays as it is."""
    grid = sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [21, 21], ends=["wall", "unsafe"])
    inputs = [[-1.0], [1.0]]
    drift = lambda q, u: np.stack([u[0] + 0.5 * np.sin(q[:, 1]), 0.0 * q[:, 1]], axis=1)  # noqa: E731
    target = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.5)
    return sdhj.ReachAvoidProblem(grid, sdhj.Dynamics(inputs, drift), target, [], 0.2, 2)


def lane():
    """A stream from which the first input leads out to the left, and meanwhile beside what is above."""
    above = sdhj.UnsafeSet((1,), lambda p, t: 0.8 - p[:, 0], name="above")
    problem = stream()
    dynamics = sdhj.Dynamics([[-1.0], [1.0]], [[-3.0, 1.5], [3.0, 0.0]], np.eye(2), [0.0, 0.0])
    return replace(problem, dynamics=dynamics, unsafe=[above])


OTHERS = {"drifting": (drifting, (80,), 1), "carried": (carried, (20, 20), 1), "lane": (lane, (10, 10), 2)}


def whole(name, values):
    """A field of the proof, of the cells or of the grid is other than it is."""
    of, field = name.split(" ")
    return head(lambda told: told[of].__setitem__(field, values))


def of_a_set(number, **fields):
    return head(lambda told: told["sets"][number].update(fields))


def empty_images(told, arrays):
    """Beside a layer: from the first cell past the last."""
    edit("low", lambda moves: moves[..., 1].fill(3))(told, arrays)
    edit("high", lambda moves: moves[..., 1].fill(-3))(told, arrays)


def fewer_rows(told, arrays):
    index = arrays["index"][()][:-1]
    put(arrays, index=index, pool=arrays["pool"][()][: index.max() + 1])


def arrives_everywhere(step):
    return edit("arrives", lambda marks: marks[step].fill(255))


def two_targets(told, arrays):
    told["sets"].insert(1, dict(told["sets"][0]))


def alike(told, arrays):
    """The sets of step 0, for all steps, though the target moves on."""
    index = arrays["index"][()][:4]
    put(arrays, index=index, pool=arrays["pool"][()][: index.max() + 1])


def places_on_one_axis(told, arrays):
    told["proof"]["own"] = [False, True]
    for name in ("low", "high"):
        moves = arrays[name][()]
        middle = moves.reshape(1, 2, 20, -1, 2)[:, :, 10]
        put(arrays, **{name: middle})


def on_axes(*each):
    """What is clear is told of cells of fewer axes: what it was of the first cells on the others."""

    def forge(told, arrays):
        every, cells = first_clear(told, arrays["clear"][()]), told["cells"]["shape"]
        every, out = every.reshape(len(every), *cells, -1), []
        for axes, some, _ in each:
            few = tuple(slice(None) if k in axes else slice(1) for k in range(len(cells)))
            out.append(every[slice(None if some else 1), *few].ravel())
        put(arrays, clear=np.concatenate(out))
        told["proof"]["clear"] = [dict(zip(("axes", "sets", "ends"), one, strict=True)) for one in each]

    return both(nothing_in_sets, forge)


def of_clear(**entry):
    """What is clear is of other axes, sets or ends."""
    return head(lambda told: told["proof"]["clear"][0].update(entry))


def first_cell_leaves(told, arrays):
    """From the first cell of a line an input leads out: as if that were the target."""
    sets(lambda found: found[1:, 0].fill(True))(told, arrays)


def before_the_seam():
    """The ring, whose target ends at the seam: an image that begins before it ends elsewhere."""
    return replace(ring(), target=sdhj.TargetSet((0,), lambda p, t: 2.0 - p[:, 0]))


WAY_OUT = "safe ends must be of a robot without target and sensing"
DEPENDS, EVERY = "tubes must depend on no other axes", "inputs must be clear of every unsafe set"


def no_layers(told, arrays):
    del told["cells"]["layers"]


NEW = {
    "own as numbers": Forgery("growing", "axes of a place must be true or false", whole("proof own", [1])),
    "own as a fraction": Forgery("growing", "axes of a place must be true or false", whole("proof own", [0.5])),
    "own as text": Forgery("growing", "axes of a place must be true or false", whole("proof own", ["false"])),
    "an empty image beside a layer": Forgery("standing", "must lead to some cell", empty_images),
    "an entry less": Forgery("crossed", "there must be sets for each step", fewer_rows),
    "sets of a step that is none": Forgery("cart", "there must be sets for each step", fewer_rows),
    "sets alike while the target moves": Forgery("drifting", "there must be sets for each step", alike),
    "arrivals of a tide": Forgery("tide", ARRIVE, arrives_everywhere(1)),
    "arrivals of a target that moves": Forgery("drifting", ARRIVE, arrives_everywhere(2)),
    "a wall on the way of an axis of no place": Forgery("carried", COVER, places_on_one_axis),
    "an end called Wall": Forgery("line", "ends must be of safe, unsafe", whole("grid ends", [["Wall", "unsafe"]])),
    "an end without a name": Forgery(
        "line", "ends must be of safe, unsafe, wall", whole("grid ends", [[None, "unsafe"]])
    ),
    "an axis on which rounding is no share": Forgery(
        "line", "upper ends must be 1e-120 above", head(lambda told: told["grid"].update(lower=[0.0], upper=[1e-323]))
    ),
    "a grid of one node": Forgery("line", "shape must be numbers of nodes", whole("grid shape", [1])),
    "an obstacle": Forgery("line", "sets must be a target", of_a_set(1, kind="obstacle")),
    "an Unsafe set": Forgery("line", "sets must be a target", of_a_set(2, kind="Unsafe")),
    "a second target": Forgery("line", "sets must be a target", two_targets),
    "no input of a set": Forgery("forbidden", "inputs of an unsafe set must be", of_a_set(1, inputs=[])),
    "inputs of a target": Forgery("line", "inputs of an unsafe set must be", of_a_set(0, inputs=[0])),
    "no inputs": Forgery("line", "there must be 1 to", head(lambda told: told.update(inputs=[]))),
    "inputs of several sizes": Forgery(
        "line", "an input must be 1 numbers", head(lambda told: told.update(inputs=[[0.0], [0.0, 1.0], [1.0]]))
    ),
    "truth values that are numbers": Forgery(
        "line",
        "must be given truth values",
        head(
            lambda told: told["formulas"]["functions"]["unsafe 0"].update(
                lines=["x 0", "const 0x1.0p+0", "where 0 1 0", "return 2"]
            )
        ),
    ),
    "a negative delta": Forgery("line", "delta must be a number", head(lambda told: told.update(delta=-0.5))),
    "a delta that is true": Forgery("line", "delta must be a number", head(lambda told: told.update(delta=True))),
    "no parts": Forgery("line", "parts must be a number", whole("proof parts", 0)),
    "parts below zero": Forgery("line", "parts must be a number", whole("proof parts", -1)),
    "so many pieces": Forgery("line", "the proof must have no unknown field", whole("proof pieces", 10**9)),
    "lines": Forgery("line", "the proof must have no unknown field", whole("proof normals", [[1.0]])),
    "two layers": Forgery("standing", "layers must be 0 or 1", whole("cells layers", [[0, 0], [2, 1]])),
    "less than no layer": Forgery("standing", "layers must be 0 or 1", whole("cells layers", [[0, 0], [-1, 1]])),
    "layers that are true": Forgery("standing", "layers must be 0 or 1", whole("cells layers", [[0, 0], [True, 1]])),
    "a layer where an axis closes, said so": Forgery(
        "standing", COVER, whole("cells periodic", [False, True]), becomes=lambda: standing(periodic=True)
    ),
    "the second of two posts in one": Forgery("two posts in one", CLEAR, clears(1, 69)),
    "layers that are cells": Forgery("standing", COVER, no_layers),
    "unsure of what is measured exactly": Forgery("line", "without a delay are off by", whole("proof unsure", [0.1])),
    "unsure of more than errors": Forgery("calming", "without a delay are off by", whole("proof unsure", [0.2])),
    "unsure of less than errors": Forgery("remembered", "predictions are off by", whole("proof unsure", [0.05])),
    "a field of the grid": Forgery("line", "grid must have no unknown field", whole("grid offset", [0.0])),
    "a field of the cells": Forgery("line", "cells must have no unknown field", whole("cells first", [0])),
    "a field of sensing": Forgery(
        "line", "sensing must have no unknown field", head(lambda told: told.update(sensing={"bias": 0.1}))
    ),
    "a field of a set": Forgery("line", "a set must have no unknown field", of_a_set(1, until=1.0)),
    "cells of an arm": Forgery("line", "cells must be those of a robot", whole("cells kind", "arms")),
    "cells that close": Forgery("line", "cells must close where the axes do", whole("cells periodic", [True])),
    "a name that is none": Forgery("line", "a name must be text", of_a_set(1, name=7)),
    "two velocities": Forgery(
        "line",
        "functions must be of velocities",
        head(lambda told: told["formulas"]["functions"].update(velocity=told["formulas"]["functions"]["drift"])),
    ),
    "sets for ever that are not": Forgery(
        "cart", "sets that hold for ever must be one", head(lambda told: told["details"].update(endless=True))
    ),
    "endless in words": Forgery(
        "cart", "endless must be true", head(lambda told: told["details"].update(endless="no"))
    ),
    "steps that are true": Forgery("line", "steps must be a number", head(lambda told: told.update(steps=True))),
    "an axis of a set that is true": Forgery("plane", "axes of a set", of_a_set(1, axes=[False, True])),
    "a rail on too few axes": Forgery("cart", DEPENDS, on_axes(([0], [], [0]), ([1], [], [1]))),
    "a lane on too few axes": Forgery("lane", DEPENDS, on_axes(([1], [0], []))),
    "a post on too few axes": Forgery("plane", DEPENDS, on_axes(([0], [0], [0]), ([1], [], [1]))),
    "ends on too few axes": Forgery("cart", DEPENDS, on_axes(([1], [], [0, 1]))),
    "a set less": Forgery("line", EVERY, of_clear(sets=[1])),
    "an end less": Forgery("line", EVERY, of_clear(ends=[])),
    "an end of another axis": Forgery("line", "ends that inputs are clear of must be", of_clear(ends=[1])),
    "a set that is none": Forgery("line", "sets that inputs are clear of must be", of_clear(sets=[0, 1, 2])),
    "an axis twice": Forgery("line", "axes that clear inputs depend on must be", of_clear(axes=[0, 0])),
    "axes that are true": Forgery("cart", "axes that clear inputs depend on must be", of_clear(axes=[False, True])),
    "steps of clear inputs": Forgery("line", "what is clear must have no unknown field", of_clear(starts=1)),
    "clear inputs by name": Forgery("line", "clear must be a list", whole("proof clear", {"axes": [0]})),
    "fewer clear inputs": Forgery(
        "line", "clear must be kept", lambda told, arrays: put(arrays, clear=arrays["clear"][()][:-1])
    ),
    "more clear inputs": Forgery(
        "line", "clear must be kept", lambda told, arrays: put(arrays, clear=np.tile(arrays["clear"][()], 2))
    ),
    "a way out with a target": Forgery(
        "line", WAY_OUT, both(whole("grid ends", [["safe", "safe"]]), clears(0, 0), first_cell_leaves)
    ),
    "a way out that is measured": Forgery("stream", WAY_OUT, head(lambda told: told.update(sensing={"error": 0.01}))),
    "inputs that begin before the last": Forgery(
        "line", "delay + 2 jitter", head(lambda told: told.update(sensing={"delay": 0.3, "jitter": 0.2}))
    ),
    "an arrival whose first half is in the target": Forgery("ring", ARRIVE, arrives(2, 119), becomes=before_the_seam),
    "cells beyond the last": Forgery(
        "line", "no cells that there are not", edit("pool", lambda pool: pool.fill(2**64 - 1))
    ),
}


@pytest.mark.parametrize("name", NEW)
def test_a_new_forgery_is_refused(name, files, tmp_path):
    forgery = NEW[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    for every in (True, False):
        said = refusals(path, every=every)
        assert said or (every is False and forgery.said in (ARRIVE, CLEAR, MOVES)), said
        assert not said or any(forgery.said in one for one in said), said


def only_from_step_1(told, arrays):
    """No set of step 0 has a cell, and those of step 1 are the first of which something is promised."""
    sets(lambda found: found[: told["steps"] + 1].fill(False))(told, arrays)


PROMISED = {  # of cells of which something is promised, so that whoever verifies by default is told
    "a stronger push once step 0 is over": Forgery(
        "crossed", MOVES, only_from_step_1, becomes=lambda: crossed(push=0.3)
    ),
    "a post where two steps are to go": Forgery("line", CLEAR, becomes=lambda: on_a_line(posts=(-2.1, 3.0))),
}


@pytest.mark.parametrize("name", PROMISED)
def test_what_is_false_of_what_is_promised_is_refused(name, files, tmp_path):
    forgery = PROMISED[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    assert any(forgery.said in one for one in refusals(path, every=False))


@pytest.mark.parametrize("name", OTHERS)
def test_what_is_true_of_others_is_proved(name, files, tmp_path):
    (tmp_path / "true.npz").write_bytes(files(name))
    assert refusals(tmp_path / "true.npz") == []


# ---- what is not in a file


@pytest.mark.parametrize("name", ["growing slowly", "bent", "standing"])
def test_what_begins_late_moves_as_far(name, files, tmp_path, monkeypatch):
    """The length of a piece is handed over: of times of a day, or a year, it could not be told."""
    (tmp_path / "true.npz").write_bytes(files(name))
    with head_and_arrays(tmp_path / "true.npz") as (told, arrays):
        plain = Argument(told, arrays)
    places = np.arange(plain.low.shape[2])
    soon = plain.driven(places, 0, 0, 8)[1]
    monkeypatch.setattr(plain, "time", lambda step: 2.0 * np.pi * 1e12)
    late = plain.driven(places, 0, 0, 8)[1]
    np.testing.assert_array_equal(late, soon)


def test_a_name_is_printed_in_one_line(files, tmp_path):
    path = Forgery("line", "", of_a_set(1, name="post\n\nproved" + 200 * "!")).write(files("line"), tmp_path / "f.npz")
    with head_and_arrays(path) as (told, arrays):
        text = str(Argument(told, arrays).problem)
    assert "unsafe, post\\n\\nproved!!!" in text and 101 * "!" not in text


def test_what_is_not_promised_is_counted(files, tmp_path):
    (tmp_path / "true.npz").write_bytes(files("plane"))
    with head_and_arrays(tmp_path / "true.npz") as (told, arrays):
        plain = Argument(told, arrays)
    made = {every: {claim.name: claim for claim in plain.claims(every)} for every in (True, False)}
    some, all_of_it = made[False][CLEAR], made[True][CLEAR]
    assert 0 < some.checked == some.made < all_of_it.made == some.made + some.beside and not all_of_it.beside
    promised = plain.promised(0).ravel()
    assert made[False][NEARER].made == made[True][NEARER].made and 0 < promised.sum() < promised.size
    assert "were not looked at" in str(some) and "were not looked at" not in str(all_of_it)
    few = {claim.name: claim for claim in plain.claims(True, samples=50, seed=1)}
    assert 0 < few[CLEAR].checked < few[CLEAR].made == all_of_it.made


def test_the_problem_is_printed_as_it_was_read(files, tmp_path):
    (tmp_path / "true.npz").write_bytes(files("plane"))
    with head_and_arrays(tmp_path / "true.npz") as (told, arrays):
        text = str(Argument(told, arrays).problem)
    for line in (
        "x1 from -2 to 2, ends: unsafe, unsafe",
        "3 intervals of 0.25 s",
        "u1 = (-1, 0)",
        "|v2| <= 0.1",
        "dx1/dt: drift -1.0    [u1]",
        "target, target:",
        "hypot(x1 - 1.0, x2) - 0.5 <= 0",
        "hypot(x1, x2 - 1.2 + 0.4 * t) - 0.3 <= 0",
    ):
        assert line in text, text


# ---- mutations: each check is taken away, and its forgery believed, or a robot not proved any more

OF = {name: f"sdhj.certified.check.{name}" for name in ("stated", "argument")}
MUTATIONS = {  # the file, what stands there, what stands there instead, the forgery or the robot
    # 1: cells
    "where an axis begins": ("argument", "low == decimal(robot.lower[k]) and ", "", "cells that begin elsewhere"),
    "how long an axis is": ("argument", "least <= length <= most and ", "", "a longer axis"),
    "the last cell": ("argument", " and inner * width >= most", "", "cells that are too narrow"),
    "no cell past the end": ("argument", "(inner - 1) * width < least and ", "", "cells that are too wide"),
    "a length as it is written": ("argument", "else Fraction(0)  #", "else length  #", "a length that is a guess"),
    "a period nearly as it is": ("argument", " and most - least <= doubt", "", "a period that is a guess"),
    "cells that move alike are alike": (
        "argument",
        "return abs(beyond) <= STICKS * self.scale[k]",
        "return True",
        "cells that are not alike",
    ),
    "no wall where cells move alike": ("argument", "not self.walls[k].any() or ", "True or ", "a wall on the way"),
    "velocities in one range": (
        "stated",
        "not self.timed and not any(one.reads(",
        "not any(() and one.reads(",
        "a wall on the way",
    ),
    "a wall before every axis of no place": (
        "stated",
        "some = self.along(axis) if plain else",
        'some = self.of["bounds"] if plain else',
        "a wall on the way of an axis of no place",
    ),
    "layers at walls": (
        "argument",
        "(self.walls[k, side] and self.known[k])",
        "self.known[k]",
        "a layer at an end that is no wall",
    ),
    "layers at either end": (
        "argument",
        "self.walls[k, side] and self.known[k]",
        "self.walls[k, 0] and self.known[k]",
        "a layer at an upper end that is no wall",
    ),
    "layers of cells that do not move alike": (
        "argument",
        "(self.walls[k, side] and self.known[k])",
        "self.walls[k, side]",
        "a layer of cells that move alike",
    ),
    "no walls where an axis closes": (
        "argument",
        "for pair in robot.ends]) & ~robot.periodic[:, None]",
        "for pair in robot.ends])",
        "a layer where an axis closes, said so",
    ),
    "layers have no width": (
        "argument",
        "[*[begin] * a, *inner,",
        "[*[begin] * a, *[one + 0.05 * a * (one == begin) for one in inner],",
        "standing",
    ),
    "layers are cells": ("argument", "inner, length = n - sum(self.layers[k]),", "inner, length = n,", "standing"),
    # 2: moves
    "a short piece beside a layer": ("argument", "soon = [self.length * AT_FIRST]", "soon = [0.0]", "standing soon"),
    "room only where something grows": ("argument", "far + some * (far != 0)", "far + some", "standing"),
    "the adversary": (
        "stated",
        ").max(axis=0) if pushed else np.zeros(",
        ").max(axis=0) * 0 if pushed else np.zeros(",
        "a stronger push",
    ),
    "bounds at all times": (
        "stated",
        "bounds(low.T, high.T, times, *more)",
        'bounds(low.T, high.T, times if name != "bounds" else (0.0, 0.0), *more)',
        "gusts that grow",
    ),
    "bounds of the input": (
        "stated",
        "self.of[name][j].bounds(",
        'self.of[name][j * (name != "bounds")].bounds(',
        "gusts of another input",
    ),
    "gain of both signs": ("stated", 'gain = np.abs(of("gain"))', 'gain = of("gain")', "gusts from the other side"),
    "both ends of a push": (
        "stated",
        "((-one, one) for one in half)",
        "((one, one) for one in half)",
        "an adversary that enters as it likes",
    ),
    "all components of a push": ("stated", "(gain * half).sum(axis=1)", "(gain * half)[:, 0]", "two that push"),
    "walls": ("argument", "stopped = np.clip(at + moved, *bars)", "stopped = at + moved", "a wall that holds"),
    "the time of a step": (
        "argument",
        "begun, marks = self.time(start),",
        "begun, marks = self.time(0),",
        "the tide of another hour",
    ),
    "the whole time of a piece": (
        "argument",
        "(begun + begin, begun + end)",
        "(begun + begin, begun + begin)",
        "a little later",
    ),
    "the whole time of a piece, from its begin": (
        "argument",
        "(begun + begin, begun + end)",
        "(begun + end, begun + end)",
        "a little sooner",
    ),
    "finer where it is open": ("argument", "FINENESS = 1, 8, 16", "FINENESS = (1,)", "cart"),
    "room to stay in": ("argument", "fits = ~known |", "fits = np.bool_(True) |", "less growth"),
    "all that is reached from the box": (
        "argument",
        "box + np.where(known, far + some * (far != 0), 0.0)",
        "box + 0.0 * far",
        "a speed that grows",
    ),
    "the face that an end passes": (
        "argument",
        "(box[side] + far + some)[:, axis]",
        "(box[side] + some)[:, axis]",
        "less growth",
    ),
    "the face on its side": (
        "argument",
        "(box[side] + far + some)[:, axis]",
        "(box[1] + far + some)[:, axis]",
        "growth from the lower end",
    ),
    "the worst in a face": ("argument", "times)[side, axis]\n", "times)[0, axis]\n", "less growth"),
    "states near a cell": (
        "argument",
        "self.ends(self.cells_at(places, self.strides), self.near), whole)",
        "self.ends(self.cells_at(places, self.strides)), whole)",
        "states near a cell",
    ),
    "what an image may stick out": ("argument", "STICKS = 2e-13", "STICKS = 2e-10", "states near a cell"),
    "the lower end of an image": ("argument", "(first <= last[0, k] + sticks[k]) & ", "", "a shorter move"),
    "the upper end of an image": ("argument", " & (last[1, k] <= past + sticks[k])", "", "a move that ends too early"),
    "cells that are not alike": (
        "argument",
        "if self.problem.periodic[k] and self.known[k]:",
        "if False:",
        "a seam like any other edge",
    ),
    "the lower end of an image beside layers": (
        "argument",
        "(own + low) * wide - edges[own], begin",
        "(own + low - 1) * wide - edges[own], begin",
        "the fastest that are not held by the wall",
    ),
    "where a lower layer is": ("argument", "float(lower - self.layers[k][0] * width)", "float(lower)", "standing"),
    "moves that do not hold": (
        "argument",
        "moved, places = partial(self.moves_hold, start, j),",
        "moved, places = lambda some, _: some >= 0,",
        "a stronger push",
    ),
    # 10: measurements that err
    "errors of measurements before": ("argument", "+ OUT * self.off_at(places))", ")", "one measurement that errs"),
    "errors of measurements after": (
        "argument",
        "else last + OUT * self.off[:, None])",
        "else last)",
        "one measurement that errs",
    ),
    "what is remembered": ("argument", "if robot.memory else", "if True else", "errors that are forgotten"),
    "images shrunk once": (
        "argument",
        "less = last - OUT * self.off[:, None]",
        "less = last - 2 * OUT * self.off[:, None]",
        "images shrunk by too much",
    ),
    "the middle": (
        "argument",
        "(first > second) & self.known[:, None]",
        "(first < second) & False",
        "a middle that is elsewhere",
    ),
    "errors in all but a layer": (
        "argument",
        "np.where(at_wall & self.known[:, None] & self.problem.memory",
        "np.where(True",
        "a measurement that errs nowhere",
    ),
    "who remembers to be in a layer": (
        "argument",
        "np.where(at_wall & self.known[:, None] & self.problem.memory",
        "np.where(False & at_wall",
        "noisy",
    ),
    "points beside a layer": (
        "argument",
        "np.where(layers[:, 0], below + sticks - at[1], -np.inf)",
        "-np.inf",
        "half a shell above a wall",
    ),
    "points beside an upper layer": (
        "argument",
        "np.where(layers[:, 1], above - sticks - at[0], np.inf)",
        "np.inf",
        "half a shell below a wall",
    ),
    "a late end": (
        "argument",
        "self.length = robot.delta + 2 * robot.jitter",
        "self.length = robot.delta",
        "no late end",
    ),
    "an early end": ("argument", "soonest = self.length - 4 * robot.jitter", "soonest = self.length", "no early end"),
    "all ends from the earliest on": ("argument", "farthest(np.array([ending, moved]))", "moved", "no early end"),
    "what is told of predictions": (
        "argument",
        "self.problem.count, self.far_off())",
        "self.problem.count, [])",
        "predictions as near as measurements",
    ),
    "errors of measurements in predictions": (
        "argument",
        "allowed = (self.off - robot.error)",
        "allowed = self.off",
        "predictions as near as measurements",
    ),
    "predictions of the next": (
        "argument",
        "wild = self.velocity(j, box + travel + OUT * self.off[:, None], times)",
        "wild = self.velocity(j, box + travel, times)",
        "predictions that begin where the state is",
    ),
    "how far a prediction moves": (
        "argument",
        "travel = stride * np.array(",
        "travel = 0 * np.array(",
        "predictions that move on at once",
    ),
    "predictions of both signs": (
        "argument",
        "np.maximum(wild[1] - calm[0], calm[1] - wild[0])",
        "(wild[1] - calm[0])",
        "predictions pushed one way",
    ),
    "predictions under every input": (
        "argument",
        "inputs = range(robot.count if robot.delay else 0)",
        "inputs = range(1)",
        "predictions for the first input",
    ),
    "predictions at every time": (
        "argument",
        "begins if robot.timed else begins[:1]",
        "begins[:1]",
        "predictions for the first step",
    ),
    # 4: clear
    "what is on the way": (
        "argument",
        "reached = farthest(np.array([reached, moved]))",
        "pass",
        "a post not met at the end",
    ),
    "both halves of a box": (
        "argument",
        "some[1, axis, : middle.size] = some[0, axis, middle.size :] = middle",
        "some[1, axis] = np.tile(middle, 2)",
        "the far half of a tube",
    ),
    "every unsafe set": (
        "argument",
        "for part in one.parts:\n            if part.inputs",
        "for part in one.parts[:1]:\n            if part.inputs",
        "the second post",
    ),
    "sets of some inputs": (
        "argument",
        "if part.inputs is None or j in part.inputs:",
        "if part.inputs is None:",
        "an input where it is forbidden",
    ),
    "a set is closed": (
        "argument",
        "return least > 0, most <= 0",
        "return least >= 0, most < 0",
        "a set that is closed",
    ),
    "states near a tube": (
        "argument",
        "self.whole(first, last, tubes) + OUT * 2 * self.near[:, None]",
        "self.whole(first, last, tubes)",
        "a set nearer than rounding",
    ),
    "a clock that is off": (
        "argument",
        "late = self.problem.jitter if part.moving else 0.0",
        "late = 0.0",
        "a post beside an uncertain clock",
    ),
    "when an input begins": (
        "argument",
        "return step * self.problem.delta + self.problem.delay",
        "return step * self.problem.delta",
        "a post beside an uncertain clock",
    ),
    "sets at the time of a step": (
        "argument",
        "at, (first, last) = self.time(step), np",
        "at, (first, last) = 0.0, np",
        "a post that comes later",
    ),
    "sets at all times of a step": (
        "argument",
        "[at + cut for cut in self.cuts(1)]",
        "[at for cut in self.cuts(1)]",
        "a post that comes meanwhile",
    ),
    "where a periodic axis closes": (
        "argument",
        "np.minimum.at(found[0, row], of[count:], found[0, row, count:])",
        "pass",
        "a set behind the seam",
    ),
    "laps": ("argument", "np.floor((a - least) / (most - least)) * (most - least)", "0.0 * a", "a set before the seam"),
    "all of a tube": (
        "argument",
        "swept[:, 0].min(axis=0), swept[:, 1].max(axis=0)",
        "swept[0, 0], swept[0, 1]",
        "a rock at the end of the way",
    ),
    "wholly past a lower end": (
        "argument",
        "(self.edges[k][cells[k] + 1] + high <",
        "(self.edges[k][cells[k]] + low <",
        "a rock at a safe end",
    ),
    "wholly past an upper end": (
        "argument",
        "(self.edges[k][cells[k]] + low >",
        "(self.edges[k][cells[k] + 1] + high >",
        "a rock at the upper safe end",
    ),
    "a least of several": (
        "argument",
        "for one in part.function.least_of:",
        "for one in part.function.least_of[:1]:",
        "the second of two posts in one",
    ),
    "the lower end": (
        "argument",
        "(low >= robot.lower[k] - room) | ~self.unsafe[k, 0]",
        "True",
        "out by the lower end",
    ),
    "the upper end": (
        "argument",
        "(high <= robot.upper[k] + room) | ~self.unsafe[k, 1]",
        "True",
        "out by the upper end",
    ),
    "ends of every axis": (
        "argument",
        "for k in axes_of(one.ends):",
        "for k in axes_of(one.ends)[:1]:",
        "out by an end of the second axis",
    ),
    "how near past an end": ("argument", "ROOM = 1e-6", "ROOM = 10.0", "out by the lower end"),
    "what is not clear": ("argument", "return bad & asked", "return bad & ~asked", "the second post"),
    "a tile is met where a cell is": ("argument", "self.ends(last)[1]", "self.ends(first)[1]", "the second post"),
    "velocities that a tube depends on": (
        "argument",
        " | robot.reads[own].any(axis=0)",
        "",
        "a rail on too few axes",
    ),
    "safe ends that a tube depends on": ("argument", " | self.safe.any(axis=1) |", " |", "a lane on too few axes"),
    "the axes of a set": (
        "argument",
        "needed[[axis for part in parts for axis in part.axes]] = True",
        "pass",
        "a post on too few axes",
    ),
    "the axes of ends": ("argument", "needed = at_ends | ", "needed = ", "ends on too few axes"),
    "sets that nobody asks about": ("argument", "(left.any() or open_ends.any())", "open_ends.any()", "a set less"),
    "ends that nobody asks about": ("argument", "(left.any() or open_ends.any())", "left.any()", "an end less"),
    # 9: the target
    "all of a goal": ("argument", "return most <= 0, least > 0", "return least <= 0, least > 0", "a goal more"),
    "a goal is safe": (
        "argument",
        "out &= part.inputs is not None or self.outside(",
        "out &= True or self.outside(",
        "a goal in a post",
    ),
    "the time of a goal": ("argument", "else (at - late, at + late)", "else (0.0, 0.0)", "a goal of another time"),
    "a goal by a clock that is off": (
        "argument",
        "else (at - late, at + late)",
        "else (at, at)",
        "a goal beside an uncertain clock",
    ),
    "predictions in a goal": (
        "argument",
        "self.counts)), self.near + self.off)",
        "self.counts)), self.near)",
        "a goal beside an error",
    ),
    "arrivals are looked at": (
        "argument",
        "partial(failing, partial(self.arrivals_hold, step))",
        "partial(failing, lambda some, _: some >= 0)",
        "an arrival more",
    ),
    "where a cell arrives": (
        "argument",
        "self.ends(cells, 2 * self.near) + moved\n        return",
        "self.ends(cells, 2 * self.near)\n        return",
        "an arrival that leaves",
    ),
    "states near a cell that arrives": (
        "argument",
        "self.ends(cells, 2 * self.near) + moved\n        return",
        "self.ends(cells) + moved\n        return",
        "an arrival nearer than rounding",
    ),
    "both halves of what crosses a seam": (
        "argument",
        "np.maximum.at(found[1, row], of[count:], found[1, row, count:])",
        "pass",
        "an arrival whose first half is in the target",
    ),
    "when a cell arrives": ("argument", "self.sites), self.time(step + 1)", "self.sites), self.time(0)", "tide"),
    "arrivals of each time": (
        "argument",
        "range(len(marks)) if len(self.low) == 1 else",
        "[0] if len(self.low) == 1 else",
        "arrivals of a target that moves",
    ),
    # 3: steps
    "sets that grow": ("argument", "* bool(lacks)", "* 0", "a set that loses a cell"),
    "sets that shrink": ("argument", "* bool(lacks)", "* 0", "a set that wins a cell"),
    "sets of each step": ("argument", "* bool(lacks)", "* bool(lacks and not step)", "a late set that loses a cell"),
    "every cell of an image": ("argument", "return counted == size", "return counted > 0", "a cell more"),
    "inputs that are clear": (
        "argument",
        "out = self.is_clear(step, j, cells)",
        "out = np.ones(cells.shape[1], np.bool_)",
        "a cell of which no input is clear",
    ),
    "the next set": (
        "argument",
        "self.sums(self.bits(step + 1, within - 1))",
        "self.sums(self.bits(step, within - 1))",
        "a step into sets of another time",
    ),
    "steps of late sets": (
        "argument",
        "int(asked.sum()), 0, len(wrong), wrong",
        "int(asked.sum()), 0, 0 if step else len(wrong), wrong",
        "a late set that has all cells",
    ),
    "what stays is new each time": (
        "argument",
        "if self.problem.target is not None:\n            new =",
        "if True:\n            new =",
        "a cell that is not safe as long",
    ),
    "for ever": ("argument", "return [(0, 0), (0, 1)]", "return [(0, 0)]", "a cell that is not safe for ever"),
    "past a lower end by a cell": (
        "argument",
        "(past[k] < 0)",
        "(past[k] <= 0)",
        "past the lower end by less than a cell",
    ),
    "past an upper end by a cell": (
        "argument",
        "(first[k] > n)",
        "(first[k] >= n)",
        "past the upper end by less than a cell",
    ),
    "only safe ends": ("argument", "(past[k] < 0) & self.safe[k, 0]", "(past[k] < 0)", "past a wall"),
    "arrivals count": ("argument", "inside |= marked(self.arrives, step, j, self.sites @ cells)", "pass", "thin"),
    # black boxes
    "values above what is stated": (
        "stated",
        "(value < least - near) | (value > most + near)",
        "value < least - near",
        "an enclosure that ends below",
    ),
    "values below what is stated": (
        "stated",
        "(value < least - near) | (value > most + near)",
        "value > most + near",
        "an enclosure that begins above",
    ),
    "a slope counts": ("stated", "change((high - low) / 2, ", "change(0.0 * (high - low), ", "hidden"),
    "a rate counts": ("stated", "duration * (0.0 if rate is None else np.array(rate))", "0.0", "hidden and moving"),
}


def changed(monkeypatch, file, stands, instead):
    """The module of the argument of a checker in which one thing stands in place of another."""
    source = {name: Path(sys.modules[of].__file__).read_text(encoding="utf-8") for name, of in OF.items()}
    assert source[file].count(stands) == 1, (stands, source[file].count(stands))
    source[file] = source[file].replace(stands, instead)
    for name, of in OF.items():
        module = types.ModuleType(of)
        monkeypatch.setitem(sys.modules, of, module)
        exec(compile(source[name], f"changed {name}", "exec"), vars(module))
    return module


@pytest.mark.campaign
@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, files, tmp_path, monkeypatch):
    file, stands, instead, needs = MUTATIONS[name]
    of = changed(monkeypatch, file, stands, instead)
    if needs in ROBOTS:
        (tmp_path / "true.npz").write_bytes(files(needs))
        assert refusals(tmp_path / "true.npz", box_beside(needs), of=of)
        return
    forgery = (FORGERIES | NEW)[needs]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    beside = forgery.beside and forgery.beside()
    words = SAYS.get(needs, forgery.said)
    assert any(words in said for said in refusals(path, beside))
    assert not any(words in said for said in refusals(path, beside, of=of))


SENTENCES = {
    name: one
    for name, one in (FORGERIES | NEW).items()
    if one.said not in (COVER, MOVES, CLEAR, ARRIVE, GOAL, GROW, NEARER, NEAR)
}


@pytest.mark.campaign
@pytest.mark.parametrize("name", SENTENCES)
def test_a_sentence_is_what_refuses(name, files, tmp_path, monkeypatch):
    """Without it the file is believed, or something else breaks."""
    forgery = SENTENCES[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    beside, words = forgery.beside and forgery.beside(), SAYS.get(name, forgery.said)
    assert any(words in said for said in refusals(path, beside))

    lenient = lenient_of(reading.expect, words)
    for module in (argument, stated, formulas, reading):
        monkeypatch.setattr(module, "expect", lenient)
    try:
        said = refusals(path, beside)
    except Exception:  # a test notices that as well
        return
    assert not any(words in one for one in said)


def lenient_of(expect, words):
    """What refuses with all sentences but one."""
    return lambda fits, what, given: None if words in what else expect(fits, what, given)


@pytest.mark.slow
def test_an_arm_among_obstacles_is_proved_as_any_robot(tmp_path):
    arm = sdhj.arm_case_study(**(SMALL | {"obstacles": [STILL, LINE, CIRCLE]}))
    wall = sdhj.UnsafeSet((0,), lambda p, t: np.abs(p[:, 0]) - 0.3, name="wall")
    problem = replace(arm, unsafe=(*arm.unsafe, wall))
    sdhj.solve(problem, sdhj.Certified(cells=(24, 24, 10, 10), parts=4), progress=False).save(tmp_path / "arm.npz")
    assert (verdict := verify(tmp_path / "arm.npz", samples=300, progress=False)).ok, str(verdict)


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
