"""Every obligation of oblique images is needed: without it the checker refuses what is proved."""

import mutations
import pytest
from oblique_robots import OTHERS, ROBOTS

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
    "cells of a line behind the seam": ("3.28 false 2", "over the seam", "one step nearer"),
    "lines over the seam": ("3.27 put 4 (max({6}, 0), min({13}, {7}))", "car", "one step nearer"),
    "the way of what velocities depend on": ("2.47 put 4 {5}", "car", "moves: "),
    "all pieces of v": ("2.48 put 21 {21}[:1]", "turned", "moves: "),
    "all times of a part": ("2.45 copy 15 12", "timed", "moves: "),
    "rows that are beyond a plane": ("2.49 true 2", "gust", "moves: "),
    "lines between planes": ("2.50 false 2", "gust", "moves: "),
}
FEW = {"gust": (40, 40), WALLS: (40, 40), "car": (16, 16, 12), "turned": (40, 40), "timed": (40, 40)}


@pytest.mark.campaign
@pytest.mark.parametrize("name", FALSE)
def test_the_checker_refuses_lines_that_are_drawn_without_it(name, monkeypatch, tmp_path):
    change, robot, claim = FALSE[name]
    with mutations.modules(mutations.PROVER, change) as made:
        for user in (sdhj.certified.sets, sdhj.certified.table):
            monkeypatch.setattr(user, "GeneralProof", made["certified/general_proof.py"].GeneralProof, raising=False)
    problem, cells = (ROBOTS | OTHERS)[robot]
    table = sdhj.solve(problem(), sdhj.Certified(cells=FEW.get(robot, cells), parts=1), progress=False)
    table.save(tmp_path / "false.npz")
    assert any(claim in str(one) for one in verify(tmp_path / "false.npz", progress=False).claims if one.failed)
