"""Which part of an interpolated tube a certificate covers: three labels for every state."""

from dataclasses import replace
from typing import cast

import numpy as np

from sdhj.arm.case_studies import rebuild
from sdhj.formulas.formula import Formula
from sdhj.formulas.text import alike
from sdhj.kernels import FloatArray
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.restoring import near
from sdhj.table.batches import Table

LABELS = ("certified", "not certified", "outside")


def same_game(table: Table, certified: Table) -> None:
    """Raise ValueError unless two tables are of one game; the nodes of the grid and `view_time` may differ.

    Numbers may differ by rounding; with a black box the problems must be equal (`ReachAvoidProblem.digest`).
    """
    one, other = table.problem, certified.problem
    if one.digest != other.digest and not _alike(one, other, but=("shape", "view_time")):
        raise ValueError("the two tables are of different games; certify the problem that the table was solved for")


def as_built(problem: ReachAvoidProblem) -> bool:
    """Whether a problem is what its recipe builds, up to rounding and whatever its sensing; False without a recipe.

    A problem to which a set was added may still have the recipe, which then builds another problem.
    """
    if not problem.recipe:
        return False
    built = replace(rebuild(problem.recipe), sensing=problem.sensing)
    return built.digest == problem.digest or _alike(built, problem)


def _alike(one: ReachAvoidProblem, other: ReachAvoidProblem, but: tuple[str, ...] = ()) -> bool:
    """Whether two problems without black boxes are equal, up to the rounding of two machines.

    one, other : the two. but : names of entries of `ReachAvoidProblem.numbers` that are not compared. False where a
    function is a black box.
    """
    ours, theirs, drop = one.functions, other.functions, dict.fromkeys(("grid", "inputs", *but))
    same = ours.keys() == theirs.keys() and one.inputs.shape == other.inputs.shape
    same = same and len({repr(each.numbers | each.numbers["grid"] | drop) for each in (one, other)}) == 1
    if not same or other.opaque or not near(one.inputs, other.inputs):
        return False
    pairs = [(cast(Formula, ours[name]), cast(Formula, theirs[name])) for name in ours]
    return all(alike(a.outputs, b.outputs) for a, b in pairs)


def labels(table: Table, certified: Table, states: FloatArray, *, start: int = 0, within: int) -> FloatArray:
    """The index in LABELS of each of the states (M, ndim): (M,) int.

    "certified" has a proof, whatever the interpolated table says; "not certified" is in that table's tube without a
    proof; "outside" is in neither.

    table, certified : the interpolated and the certified table. start, within : the tube, k and n, as for
        `Table.contains`.

    ValueError where the tables are of different games (`same_game`).
    """
    same_game(table, certified)
    proved = certified.contains(states, start=start, within=within)
    claimed = table.contains(states, start=start, within=within)
    return np.where(proved, 0, np.where(claimed, 1, 2))
