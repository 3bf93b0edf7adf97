"""Every obligation of oblique images is needed: without it the checker refuses what is proved."""

from dataclasses import replace

import mutations
import numpy as np
import pytest
from oblique_robots import ROBOTS, gust

import sdhj
import sdhj.certified.sets
import sdhj.certified.table
from sdhj.certified.check import verify

WALLS = "between walls"
# what is changed of which mark `# obligation`, the robot, the claim of the checker that fails then
FALSE = {
    "the farthest of the cell": ("2.34 drop", "gust", "moves: "),
    "all of a row": ("2.37 turn 3", "gust", "moves: "),
    "where a line ends": ("2.38 put 5 {5} / 2", "gust", "moves: "),
    "where a line begins": ("2.39 put 5 {5} / 2", "gust", "moves: "),
    "the adversary along a normal": ("2.42 zero 7; zero 10", "gust", "moves: "),
    "all of the time": ("2.45 put 3 0.9 * {3}", "gust", "moves: "),
    "room for the way": ("2.46 put 2 0 * {2}", WALLS, "moves: "),
    "boxes near an end": ("3.20 false 1", "in a corner", "one step nearer"),
    "boxes near an end of the last axis": ("3.25 true 1", "in a corner", "one step nearer"),
    "all cells of lines at once": ("3.26 put 13 {13} - 1", "gust", "one step nearer"),
    "lines with cells": ("3.22 false 1", "car", "one step nearer"),
    "all cells of a line": ("3.23 put 1 False", "car", "one step nearer"),
}
CORNER = replace(
    gust(ends="wall", periodic=False),
    target=sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.85, p[:, 1] - 0.85) - 0.3),
)
FEW = {"gust": (40, 40), WALLS: (40, 40), "in a corner": (96, 96), "car": (16, 16, 12)}


@pytest.mark.slow
@pytest.mark.parametrize("name", FALSE)
def test_the_checker_refuses_lines_that_are_drawn_without_it(name, monkeypatch, tmp_path):
    change, robot, claim = FALSE[name]
    with mutations.modules(mutations.PROVER, change) as made:
        for user in (sdhj.certified.sets, sdhj.certified.table):
            monkeypatch.setattr(user, "GeneralProof", made["certified/general_proof.py"].GeneralProof, raising=False)
    table = sdhj.solve(
        CORNER if robot == "in a corner" else ROBOTS[robot][0](),
        sdhj.Certified(cells=FEW[robot], parts=1),
        progress=False,
    )
    table.save(tmp_path / "false.h5")
    assert any(claim in str(one) for one in verify(tmp_path / "false.h5", progress=False).claims if one.failed)
