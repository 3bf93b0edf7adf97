"""Simulated runs that count how many of a table's promises are broken, how, and what helps: `Table.played`."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.common.checks import whole
from sdhj.common.findings import Finding, tell
from sdhj.common.remembering import FloatArray
from sdhj.simulation.adversaries import ADVERSARIES, Adversary, Moment
from sdhj.simulation.outcomes import COLLIDED, OFF, OUTCOMES, REACHED
from sdhj.simulation.runs import MOST_RUNS, admissible_states, adversary_of, name_of, play_length, score_interval
from sdhj.simulation.sensed import rollouts
from sdhj.solver.findings import NEARLY_EMPTY, empty_finding, gaps_advice, target_reachable_in_a_step
from sdhj.table.batches import Table
from sdhj.table.controller import Controller

ALARMING = 0.02  # a solve warns where, with 95 % confidence, more than this share of the runs is lost
# and more than this share of those that begin within a cell of the boundary of a tube that is to be kept: of tables
# that are right up to a cell a greedy adversary wins at most .16 there
ALARMING_BESIDE = 0.25
BESIDE_DRAWN = 20_000  # states among which those beside a boundary are looked for
FEWEST_PLAYED, MOST_PLAYED = 200, 1000  # runs at the end of a solve
SHARE_PLAYED = 0.03  # the runs take this share of the solve's time, estimated by the two costs below
NODE_COST, RUN_COST = 3e-9, 1.3e-4  # s for a node of a PDE, and for a step of a run
FEW_OUTSIDE = 30  # states: from fewer outside the target nothing is concluded; .04 have none if a tenth of all leads in
PROOF = 'method="certified", which promises only what it proves'
HOPELESS = (
    "From none of the states drawn outside the target does an input lead into it whatever the disturbance does, so "
    "what is promised there is the error of the grid, with any number of nodes. What helps: stronger inputs, a smaller "
    f"disturbance, a shorter delta or a larger target; {PROOF}"
)
DECIDES = 5  # substeps for which the adversary keeps its decision, at the end of a solve


@dataclass(frozen=True)
class Played:
    """Statistics of runs from states drawn uniformly from the tube of all steps; `str()` gives a summary.

    Attributes
    ----------
    runs, lost : int
        How many were simulated, and did not end as "reached".
    adversary : str
        Its name.
    ways : mapping of str to int
        How many were lost in each way, the most frequent first: an outcome, with the unsafe set, or the axis whose end
        was crossed.
    outside, outside_lost : int
        How many began outside the target (all without one), and how many of these were lost.
    advice : str
        What would reduce the losses, in sentences.
    """

    runs: int
    lost: int
    adversary: str
    ways: Mapping[str, int]
    outside: int
    outside_lost: int
    advice: str

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the share of lost runs (Wilson's score interval)."""
        return score_interval(self.lost, self.runs)

    @property
    def alarming(self) -> bool:
        """Whether, at 95 %, more than `ALARMING` of all runs, or of those from outside the target, are lost."""
        outside = score_interval(self.outside_lost, self.outside) if self.outside else (0.0, 1.0)
        return max(self.interval[0], outside[0]) > ALARMING

    def __str__(self) -> str:
        return str(self.finding(""))

    def finding(self, opening: str) -> Finding:
        """The finding on the share of lost runs: a sentence that begins with `opening`, and the advice."""
        low, high = self.interval
        message = f"{opening}{self.lost} of {self.runs} runs lost to adversary {self.adversary}"
        message += f" ({low:.1%} to {high:.1%})"
        # without a target all begin outside, and there is nothing to tell apart
        if self.outside < self.runs:
            message += f", {self.outside_lost} of {self.outside} from outside the target"
        ways = ", ".join(f"{count} {way}" for way, count in self.ways.items())
        return Finding(message + (f": {ways}. " if self.lost else ""), self.lost / self.runs, self.advice)


def played(
    table: Table, runs: int = 1000, adversary: str | Adversary = "worst", seed: int = 0, steps: int | None = None
) -> Played:
    """`Table.played` as a function of the table."""
    controller, play = Controller(table), adversary_of(adversary)
    runs, rng = whole("runs", runs, least=1, most=MOST_RUNS), np.random.default_rng(whole("seed", seed, least=0))
    return _played(controller, admissible_states(controller, runs, rng), play, rng, steps)


def _played(
    controller: Controller, starts: FloatArray, play: Adversary, rng: np.random.Generator, steps: int | None = None
) -> Played:
    """Simulate a run from each of some states (M, ndim) at step 0, and count what is lost."""
    table, runs = controller.table, len(starts)
    places: dict[int, str] = {}  # by run: the set that it first touches, or the axis past whose end it leaves

    def watch(moment: Moment, _: FloatArray, states: FloatArray, clearance: FloatArray) -> None:
        for row in np.flatnonzero((clearance <= 0) | table.grid.beyond(states, "fails")):
            at = moment.time + moment.duration
            met, j = bool(clearance[row] <= 0), int(moment.inputs[row])
            # The first that a run meets is kept.
            places.setdefault(int(moment.runs[row]), _place_of_failure(table, states[row], at, met, j))

    outcomes, _ = rollouts(controller, starts, play, rng, watch, steps=play_length(controller, steps))
    lost = np.flatnonzero(outcomes != REACHED)
    message = {COLLIDED: "collided with ", OFF: "went off the grid past the end of "}
    ways = Counter(
        message[outcome] + places.get(run, "something") if outcome in message else str(OUTCOMES[outcome])
        for run, outcome in zip(lost.tolist(), outcomes[lost].tolist(), strict=True)
    )
    problem = table.problem
    outside = np.ones(runs, np.bool_) if problem.has_no_target else problem.target_value(starts, problem.time(0)) > 0
    outside_lost = int(outside[lost].sum())
    left = starts[outside] if outside_lost and not problem.has_no_target else starts[:0]
    advice = _advice(table, ways, len(lost) / runs, left) if ways else ""
    return Played(runs, len(lost), name_of(play), dict(ways.most_common()), int(outside.sum()), outside_lost, advice)


def _place_of_failure(table: Table, state: FloatArray, t: float, met: bool, j: int) -> str:
    """The unsafe set that a run has met, under input j, or the axis past whose end it has left."""
    problem, grid = table.problem, table.grid
    if met:
        inside = grid.clipped(state[None], "frees")
        some = [part for part in problem.unsafe if part.counts(j)]
        # of several the one that it is deepest in
        return min(some, key=lambda part: float(problem.value_of(part, inside, t)[0])).name
    low, high = grid.faces("fails")
    return grid.names[int(np.argmax(np.maximum(low - state, state - high)))]


def _advice(table: Table, ways: Mapping[str, int], share: float, outside: FloatArray) -> str:
    """What helps where a share of the runs, among those from `outside` (M, ndim), is lost in these ways."""
    problem, grid = table.problem, table.grid
    if len(outside) >= FEW_OUTSIDE and not target_reachable_in_a_step(problem, outside):
        return HOPELESS
    if not table.proved and share >= ALARMING and (remedy := _advice_on_gaps(table)):
        return f"{remedy}; or {PROOF}"
    interval, corner = problem.interval(0), np.array(grid.lower)[None]
    still = np.ptp(interval.displacements(corner)[0], axis=0) == 0  # axes along which no input moves the robot
    pushed = still & interval.gain(corner, np.zeros(1, np.int64), interval.begin)[0].any(axis=1)
    for name in (grid.names[axis] for axis in np.flatnonzero(pushed)):
        if f"went off the grid past the end of {name}" in ways:
            wins = "only the adversary moves the robot along it, and it wins by pushing the state past an unsafe end"
            return f'What helps: ends="wall" or "safe" for {name}, or a longer axis: {wins}; or {PROOF}'
    return f"What helps: {PROOF}"


def _advice_on_gaps(table: Table) -> str:
    """`gaps_advice` of a table, kept, as it is asked before runs are played and of those that are lost."""
    # the second time would be a fifth of all that is done at the end of a solve
    shifted = bool(table.details.get("shifted"))
    return table.problem.remembered(("gaps", shifted), lambda: gaps_advice(table.problem, shifted))


def check_by_runs(table: Table) -> dict[str, Any]:
    """Warn of an empty tube or broken promises of a solved table; returns {'played': counts} for its details, or {}."""
    # `Table.__repr__` reads the counts by name, and files keep them
    share = table.fraction()
    if share < NEARLY_EMPTY or (not table.problem.has_no_target and share <= table.fraction(within=0)):
        tell(empty_finding(table, share))
    if share < NEARLY_EMPTY:  # from which nothing can be simulated
        return {}
    mean = max(table.steps / 2, 1)  # steps of a run
    work = NODE_COST * table.details.get("pdes_solved", 0) * table.grid.size
    runs = int(np.clip(SHARE_PLAYED * work / (RUN_COST * mean), FEWEST_PLAYED, MOST_PLAYED))
    if table.problem.has_no_target:
        return {"played": _check_staying_clear(table, runs)}
    runs = MOST_PLAYED if (remedy := _advice_on_gaps(table)) else runs
    play: Any = ADVERSARIES["worst"]

    def worst(moment: Moment) -> FloatArray:  # keeps its decision for some substeps
        again = moment.substep % DECIDES == 0
        return play(moment) if again else np.clip(moment.previous, -moment.bounds, moment.bounds)

    found = played(table, runs, play if table.problem.sensing else worst)
    if found.alarming or (remedy and found.lost >= ALARMING * found.runs):
        tell(found.finding("of what this table promises "))
    counts = {name: getattr(found, name) for name in ("runs", "lost", "outside", "outside_lost")}
    return {"played": counts | {"ways": dict(found.ways)}}


def _check_staying_clear(table: Table, runs: int) -> dict[str, Any]:
    """Counts of runs of a table without a target against a greedy adversary, with a warning of what is lost.

    Half of them begin within a cell of the boundary, where errors of a grid add up from step to step.
    """
    controller, rng, play = Controller(table), np.random.default_rng(0), ADVERSARIES["greedy"]
    # Half of the runs begin anywhere in the tube, half beside its boundary.
    half = -(-runs // 2)
    found = _played(controller, admissible_states(controller, half, rng), play, rng)
    if found.interval[0] > ALARMING:
        tell(found.finding("of what this table promises "))
    # without "outside", of which `Table.__repr__` would tell as of runs that begin outside a target
    counts: dict[str, Any] = {"runs": found.runs, "lost": found.lost, "boundary": 0, "boundary_lost": 0}
    ways = Counter(found.ways)
    if len(starts := states_beside_boundary(table, half, rng)):
        beside = _played(controller, starts, play, rng)
        if beside.interval[0] > ALARMING_BESIDE:
            tell(beside.finding("of what this table promises within a cell of its boundary "))
        counts |= {"boundary": beside.runs, "boundary_lost": beside.lost}
        ways += Counter(beside.ways)
    return counts | {"ways": dict(ways.most_common())}


def states_beside_boundary(table: Table, count: int, rng: np.random.Generator) -> FloatArray:
    """Up to `count` states (M, ndim) of the tube of all steps from which a cell along an axis leads out."""
    grid, steps = table.grid, table.steps
    states = rng.uniform(grid.lower, grid.upper, (BESIDE_DRAWN, grid.ndim))
    states = states[table.contains(states, start=0, within=steps)]
    out, within = np.zeros(len(states), np.bool_), np.full(len(states), steps)
    for cell in np.diag(grid.spacing):
        for moved in (states - cell, states + cell):
            # an unsafe end is a boundary of the tube, too
            out |= (table.values_at(moved[:, None], 0, within)[:, 0] > 0) | grid.beyond(moved, "fails")
    return states[out][:count]
