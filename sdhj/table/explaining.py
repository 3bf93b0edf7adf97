"""Why a state is in a tube of a table, or is not: the answer of `explain`, and how tables on a grid give it."""

import textwrap
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from sdhj.common.checks import finite_array, whole
from sdhj.common.remembering import FloatArray

SHOWN = 6  # inputs
INSTANTS_TRIED = 21  # instants of an interval at which is looked for what an input comes near


@dataclass(frozen=True)
class Failure:
    """Why one input does not keep the promise of a tube.

    Attributes
    ----------
    input : int
        Index into problem.inputs.
    by : str
        The unsafe set, or the end of an axis, that the state may meet; "image" if it may lead out of the next tube,
        "rounding" if only its whole cell may; "marks" if only the nodes around or the true sets refuse it.
    short : float
        By how much, below 0: a level-set value, the way past the end, or of a certified table the share of cells not
        certified.
    says : str
        The same in words.
    """

    input: int
    by: str
    short: float
    says: str


@dataclass(frozen=True)
class Explanation:
    """The answer of `table.explain`; `str()` gives it in words.

    Attributes
    ----------
    inside : bool
        Whether the state is in the tube.
    says : str
        What is true of the state as a whole.
    failures : tuple of Failure
        One for each input that does not keep the promise, the nearest to doing so first.
    helps : tuple of str
        What may let an input do so.
    causes : tuple of str
        Only of a certified table, for a state that is not in the tube but that method "hji" has on few nodes:
        "rounding" to whole cells, without a target "creep", what cells lose again in every step.
    """

    inside: bool
    says: str
    failures: tuple[Failure, ...] = ()
    helps: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()

    def __str__(self) -> str:
        lines = [f"  input {one.input}: {one.says}" for one in self.failures[:SHOWN]]
        rest = len(self.failures) - SHOWN
        lines += [f"  and {rest} more inputs"] if rest > 0 else []
        lines += ["What keeps it out: " + "; ".join(self.causes)] if self.causes else []
        helps = "What may help: " + "; ".join(self.helps)
        lines += textwrap.wrap(helps, 88, subsequent_indent="  ") if self.helps else []
        return "\n".join([self.says, *lines])


def tube_in_words(table: Any, step: int, within: int) -> str:
    """Words after "the tube": "for step 2 with 3 steps to go", or "for ever"."""
    if table.details.get("endless") and table.problem.has_no_target:
        return "for ever"
    return f"for step {step} with {within} step{'s' * (within != 1)} to go"


def why_refuted(table: Any, state: FloatArray, step: int, within: int) -> str:
    """Why a state (1, ndim) is, by the level-set functions alone, in no tube, as a sentence; else ""."""
    # it asks what `surely_in_no_tube` and the ends ask, set by set, so that `contains` and these words agree
    problem = table.problem
    if table.grid.beyond(state, "fails", "holds", "frees")[0]:
        return "The state is off the grid."
    for unsafe_set in (one for one in problem.unsafe if one.inputs is None):
        if (value := problem.value_of(unsafe_set, state, problem.time(step))[0]) <= 0:
            return f"The state is in the unsafe set {unsafe_set.name!r}, whose level there is {value:.3g}."
    if within == 0 and not problem.has_no_target and (value := problem.target_value(state, problem.time(step))[0]) > 0:
        return f"The state is not in the target, whose level there is {value:.3g} > 0."
    return ""


def explain_on_grid(table: Any, q: FloatArray, step: int, within: int | None) -> Explanation:
    """`Table.explain` of a table on a grid: by the true sets and, where these do not refuse the state, by the tubes."""
    step, within = table.clipped(whole("step", step, least=0, most=table.steps), within)
    state = finite_array("a state", q, (table.grid.ndim,))[None]
    if says := why_refuted(table, state, step, within):
        return Explanation(False, says)
    entry, value = tube_in_words(table, step, within), table.values_at(state[None], step, np.array([within]))[0, 0]
    inside = bool(table.contains(state, start=step, within=within)[0])
    says = f"In the tube {entry}: its level there is {value:.3g}."
    if not inside:
        says = f"Not in the tube {entry}: its level there is {value:.3g} > 0."
        if value <= 0:
            says = f"Not in the tube {entry}: not all states that the measurement may stand for are."
    if within == 0 or step == table.steps:  # no interval is left, over which an input could fail
        return Explanation(inside, says)
    interval, ndim = table.problem.interval(step), table.grid.ndim
    corners, middles = (np.array(list(product(sides, repeat=ndim))) for sides in ((0.0, 1.0), (0.0, 0.5, 1.0)))
    ends = interval.reachable_points(state, corners)[0]
    margins = _margins(table, state, interval.reachable_points(state, middles)[0], step, within - 1)
    hazards, batch = table.hazards(state, step)[0], table.batch(state, step, within)
    # Those that leave one step less, as the tube asks of them.
    safe = batch.safe[0] & (batch.steps_after[0] == within - 1) if inside else np.zeros(len(margins), np.bool_)
    failures = [
        _failure(table, state, j, step, within - 1, hazards[j], margins[j], ends[j])
        for j in np.flatnonzero(~safe).tolist()
    ]
    # first the inputs that meet nothing, as False comes before True
    failures.sort(key=lambda one: (one.by not in ("image", "marks"), -one.short))
    if safe.any():
        says += f" Safe inputs: {np.flatnonzero(safe).tolist()}."
    longer = [n for n in range(within + 1, table.steps - step + 1) if table.contains(state, start=step, within=n)[0]]
    helps = (f"more time: the tube within {longer[0]} steps has the state",) if longer and not inside else ()
    return Explanation(inside, says, tuple(failures), helps)


def _margins(table: Any, state: FloatArray, ends: FloatArray, step: int, left: int) -> FloatArray:
    """For each input the largest value of the next tube where it may lead: (L,)."""
    points = table.grid.clipped(state + ends)
    return np.asarray(table.values_at(points, step + 1, np.full(len(points), left)).max(axis=1))


def _failure(
    table: Any,
    state: FloatArray,
    j: int,
    step: int,
    left: int,
    hazard: float,  # of the avoid tube
    margin: float,  # of the next tube
    ends: FloatArray,
) -> Failure:
    """Why input j does not keep the promise: it may meet something, leave the tube, or is not marked."""
    if hazard > 0:
        name, when = _nearest(table, state, j, ends, step)
        says = f"it may meet {name} about {when:.3g} s later: the level of its avoid tube is {hazard:.3g} > 0"
        return Failure(j, name, -float(hazard), says)
    if margin > 0:
        next_tube = tube_in_words(table, step + 1, left)
        says = f"it may lead out of the tube {next_tube}, whose level reaches {margin:.3g} > 0"
        return Failure(j, "image", -float(margin), says)
    says = "the nodes around the state do not all mark it, or it comes too near a true set between them"
    return Failure(j, "marks", 0.0, says)


def _nearest(table: Any, state: FloatArray, j: int, ends: FloatArray, step: int) -> tuple[str, float]:
    """The unsafe set, or the unsafe end of an axis, that input j comes nearest to, and when, s."""
    problem, grid = table.problem, table.grid
    # by level-set value, or distance to an end, on straight lines from the state to state + `ends` (P, ndim)
    best = np.inf, "the unsafe ends of the grid", 0.0
    for s in np.linspace(0.0, 1.0, INSTANTS_TRIED).tolist():
        points, t = state + s * ends, problem.time(step) + s * problem.delta
        for unsafe_set in (one for one in problem.unsafe if one.counts(j)):
            level = float(problem.value_of(unsafe_set, grid.clipped(points), t).min())
            best = min(best, (level, unsafe_set.name, s * problem.delta))
        for name, least, most in zip(grid.names, *grid.faces("fails"), strict=True):
            x = points[:, grid.names.index(name)]
            best = min(best, (float((x - least).min()), f"the lower end of {name}", s * problem.delta))
            best = min(best, (float((most - x).min()), f"the upper end of {name}", s * problem.delta))
    return best[1:]
