"""The gate of the plain checker: both checkers on every forgery, and new ones that only the plain one has to refuse."""

from dataclasses import replace

import numpy as np
import pytest
from forged_robots import ARRIVE, CLEAR, COVER, FORGERIES, MOVES, NEARER, ROBOTS, Forgery, edit, head, put
from forged_robots import line as on_a_line

import sdhj
from sdhj.certified.check.argument import Argument
from sdhj.certified.check.reading import head_and_arrays

# what the plain checker says of the forgeries that it refuses with words of its own
SAYS = {
    "a layer where an axis closes": "cells must close where the axes do",
    "a sweep that the file states": "functions must be of velocities, the target or unsafe sets",
    "sets for all times": "there must be sets for each step",
    "moves that end before they begin": "must lead to some cell",
    "nobody's black box": "must have the black box of the file",
    "head: both": "a function is a formula or a black box",
    "head: axes of a place": "axes of a place must be a list of 2",
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of a robot's file, by its name or of a problem; each is made once."""
    folder, made = tmp_path_factory.mktemp("robots"), {}

    def read(name):
        if name not in made:
            problem, cells, parts = ROBOTS[name] if name in ROBOTS else OTHERS[name]
            table = sdhj.solve(problem(), sdhj.Certified(cells=cells, parts=parts), progress=False, play=False)
            table.save(folder / "table.npz")
            made[name] = (folder / "table.npz").read_bytes()
        return made[name]

    return read


def refusals(path, beside=None, every=True, **given):
    """What the plain checker says against a file: a text for each claim that it does not prove, or one sentence."""
    try:
        with head_and_arrays(path) as (told, arrays):
            argument = Argument(told, arrays, beside)
            return [str(claim) for claim in argument.claims(every, **given) if claim.failed]
    except ValueError as error:
        return [str(error)]


def box_beside(name):
    return ROBOTS[name][0]() if name.startswith("hidden") else None


@pytest.mark.parametrize("every", [True, False])
@pytest.mark.parametrize("name", ROBOTS)
def test_what_is_true_is_proved(name, every, files, tmp_path):
    (tmp_path / "true.npz").write_bytes(files(name))
    assert refusals(tmp_path / "true.npz", box_beside(name), every) == []


@pytest.mark.parametrize("name", FORGERIES)
def test_a_forgery_is_refused_by_both(name, files, tmp_path):
    forgery = FORGERIES[name]
    path = forgery.write(files(forgery.robot), tmp_path / "forged.npz")
    said = refusals(path, forgery.beside and forgery.beside())
    assert any(SAYS.get(name, forgery.said) in one for one in said), said


# ---- forgeries of which the other checker believes some


def drifting():
    """A robot whose target alone moves, so that no unsafe set nor velocity tells of a time."""
    target = sdhj.TargetSet((0,), lambda p, t: np.abs(p[:, 0] - 0.4 * t) - 1.0)
    return replace(on_a_line(), target=target)


def slope():
    """A line that ends at walls, along which the drift depends on the place; only the drift says so."""
    levels = [[-1.0], [0.0], [1.0]]
    dynamics = sdhj.Dynamics(levels, lambda q, u: u + 0.01 * np.sin(q), [[1.0]], [0.2])
    return replace(on_a_line(ends="wall", posts=()), dynamics=dynamics)


OTHERS = {"drifting": (drifting, (80,), 1), "slope": (slope, (80,), 1)}


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


def one_place(told, arrays):
    told["proof"]["own"] = [False]
    put(arrays, **{name: arrays[name][()][:, :, 40:41] for name in ("low", "high")})


def no_layers(told, arrays):
    del told["cells"]["layers"]


NEW = {
    "own as numbers": Forgery("growing", "axes of a place must be true or false", whole("proof own", [1])),
    "own as a fraction": Forgery("growing", "axes of a place must be true or false", whole("proof own", [0.5])),
    "own as text": Forgery("growing", "axes of a place must be true or false", whole("proof own", ["false"])),
    "an empty image beside a layer": Forgery("standing", "must lead to some cell", empty_images),
    "a set less": Forgery("crossed", "there must be sets for each step", fewer_rows),
    "sets of a step that is none": Forgery("cart", "there must be sets for each step", fewer_rows),
    "sets alike while the target moves": Forgery("drifting", "there must be sets for each step", alike),
    "arrivals of a tide": Forgery("tide", ARRIVE, arrives_everywhere(1)),
    "arrivals of a target that moves": Forgery("drifting", ARRIVE, arrives_everywhere(2)),
    "a wall on the way of an axis of no place": Forgery("slope", COVER, one_place),
    "an end called Wall": Forgery("line", "ends must be of safe, unsafe", whole("grid ends", [["Wall", "unsafe"]])),
    "an end without a name": Forgery(
        "line", "ends must be of safe, unsafe, wall", whole("grid ends", [[None, "unsafe"]])
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
    "a name of two lines": Forgery("line", "a name must be plain text", of_a_set(1, name="post\nproved")),
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
        argument = Argument(told, arrays)
    places = np.arange(argument.low.shape[2])
    soon = argument.driven(places, 0, 0, 8, True)[1]
    monkeypatch.setattr(argument, "time", lambda step: 2.0 * np.pi * 1e12)
    late = argument.driven(places, 0, 0, 8, True)[1]
    np.testing.assert_array_equal(late, soon)


def test_what_is_not_promised_is_counted(files, tmp_path):
    (tmp_path / "true.npz").write_bytes(files("plane"))
    with head_and_arrays(tmp_path / "true.npz") as (told, arrays):
        argument = Argument(told, arrays)
    made = {every: {claim.name: claim for claim in argument.claims(every)} for every in (True, False)}
    some, all_of_it = made[False][CLEAR], made[True][CLEAR]
    assert 0 < some.checked == some.made < all_of_it.made == some.made + some.beside and not all_of_it.beside
    promised = argument.promised([0]).ravel()
    assert made[False][NEARER].made == made[True][NEARER].made and 0 < promised.sum() < promised.size
    assert "were not looked at" in str(some) and "were not looked at" not in str(all_of_it)
    few = {claim.name: claim for claim in argument.claims(True, samples=50, seed=1)}
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
