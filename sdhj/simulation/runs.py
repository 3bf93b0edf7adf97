"""Closed-loop simulation against an adversary, with the true dynamics and the true geometry.

At every sampling time t_k the robot measures its state and the controller selects an input. Apart from the controller,
only the adversary may read the table. Collisions are detected by the true level-set functions at 20 instants of every
interval, and between these where bounds on the functions leave open whether something fast was met. The outcome of a
run is one of

* reached: at a sampling time the state was in the true target, and no collision was detected before; without a target,
  the run lasted until the last sampling time, or the state left the grid past a safe end;
* collided: the state was in an unsafe set at one of these instants, the start included;
* left: at a sampling time before the last, the state was in no tube, so the controller had no answer;
* late: none of these by the last sampling time;
* off the grid: the state left the grid past an unsafe end.

The target is checked by its true level-set function.
"""

import reprlib
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from sdhj.common.checks import finite_array, whole
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray, Sealed, read_only
from sdhj.common.showing import announced, hidden
from sdhj.problem.sensing import Sensing
from sdhj.simulation.adversaries import ADVERSARIES, SUBSTEPS, Adversary, Moment
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.sensed import rollouts
from sdhj.table.batches import CHUNK, threads
from sdhj.table.controller import Controller

Z95 = 1.959963984540054  # two-sided 95% quantile of the normal distribution
FOREVER_PLAYED = 100  # steps of a run, for tables that promise to stay clear for ever
MOST_RUNS = 10**8  # their start states and outcomes are kept in memory
DRAWS = 1000  # rounds of rejection sampling before giving up


@dataclass(frozen=True)
class Trajectory:
    """One simulated run, recorded at the T instants at which collisions are checked; returned by `simulate`.

    Attributes
    ----------
    times : (T,) array
        The instants, s; every 20th is a sampling time.
    states : (T, ndim) array
        Coordinates of periodic axes are not wrapped, so the path has no jumps.
    inputs, steps_to_go : (K,) int array
        The input held over each of the K intervals, by index, and the steps to go then.
    disturbances : (T - 1, D) array
        Between one instant and the next.
    outcome : {"reached", "collided", "left", "late", "off the grid"}
        As `sdhj.simulation.runs` says.
    """

    times: FloatArray
    states: FloatArray
    inputs: FloatArray
    steps_to_go: FloatArray
    disturbances: FloatArray
    outcome: str

    def __post_init__(self) -> None:
        read_only((self.times, self.states, self.inputs, self.steps_to_go, self.disturbances))

    @property
    def samples(self) -> FloatArray:
        """The states at the sampling times, (K + 1, ndim), or (K, ndim) where an interval ended early; a view."""
        return self.states[::SUBSTEPS]


def score_interval(count: int, runs: int) -> tuple[float, float]:
    """95% confidence interval of a rate observed as `count` out of `runs` >= 1: Wilson's score interval.

    (p + z^2 / 2n +- z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n), p = count / n and z = `Z95`.
    """
    n, p = runs, count / runs
    centre = (p + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
    half = Z95 / (1 + Z95**2 / n) * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def outcome_name(outcome: str, has_no_target: bool) -> str:
    """An outcome as people read it: "reached" becomes "stayed clear" if there is no target."""
    return "stayed clear" if has_no_target and outcome == "reached" else outcome


@dataclass(frozen=True)
class Report:
    """The outcomes of many simulated runs, of `monte_carlo`; `str()` formats them as a table.

    Attributes
    ----------
    runs, seed : int
        As given.
    adversary, rule, method : str
        Their names.
    counts : mapping of outcome to int
        Of `Trajectory`.
    starts : (runs, ndim) array
    outcomes : (runs,) int array
        Indices into `OUTCOMES`.
    steps : (runs,) int array
        Intervals of each run.
    seconds : float
        Wall-clock time.
    has_no_target : bool
        Whether "reached" means to have stayed clear.
    """

    runs: int
    adversary: str
    rule: str
    method: str
    seed: int
    counts: Mapping[str, int]
    starts: FloatArray = field(repr=False)
    outcomes: FloatArray = field(repr=False)
    steps: FloatArray = field(repr=False)
    seconds: float
    has_no_target: bool = False

    def __post_init__(self) -> None:
        read_only((self.starts, self.outcomes, self.steps))
        object.__setattr__(self, "counts", Sealed(self.counts))

    def rate(self, outcome: str) -> float:
        """The share of the runs that had this outcome.

        Parameters
        ----------
        outcome : str
            A key of `counts`, else KeyError.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> sdhj.monte_carlo(controller, runs=100, progress=False).rate("collided")
        0.0
        """
        return self.counts[outcome] / self.runs

    def interval(self, outcome: str) -> tuple[float, float]:
        """95% confidence interval of the rate of an outcome, from 0 to 1 (Wilson's score interval).

        Parameters
        ----------
        outcome : str
            As for `rate`.

        Examples
        --------
        With the robot on a line of `help(sdhj)`:

        >>> low, high = sdhj.monte_carlo(controller, runs=100, progress=False).interval("collided")
        >>> float(round(high, 3))
        0.037
        """
        return score_interval(self.counts[outcome], self.runs)

    def __str__(self) -> str:
        head = f"{self.runs} runs, {self.method} table, adversary {self.adversary}, rule {self.rule}, seed {self.seed}"
        lines = [head, f"{'outcome':<13}{'runs':>10}{'rate':>10}   95% interval"]
        for outcome in OUTCOMES:
            rate, low, high = (100 * share for share in (self.rate(outcome), *self.interval(outcome)))
            name, count = outcome_name(outcome, self.has_no_target), self.counts[outcome]
            lines.append(f"{name:<13}{count:>10}{rate:>9.3f}%   {low:.3f}% to {high:.3f}%")
        reached = self.steps[self.outcomes == OUTCOMES.index("reached")]
        if reached.size:
            done = outcome_name("reached", self.has_no_target) + (" for" if self.has_no_target else " after")
            lines.append(f"{done} {reached.mean():.2f} steps on average, {reached.max()} at most")
        lines.append(f"took {self.seconds:.1f} s")
        return "\n".join(lines)


def simulate(
    controller: Controller,
    q0: FloatArray,
    adversary: str | Adversary = "worst",
    seed: int = 0,
    *,
    steps: int | None = None,
) -> Trajectory:
    """Simulate one run of the closed loop from the state q0 at step 0, until it reaches the target or is lost.

    Parameters
    ----------
    controller : Controller
    q0 : (ndim,) array
        The true state at step 0.
    adversary : {"worst", "greedy", "aggressive", "random", "none"} or callable (Moment) -> (M, D)
        Who chooses the disturbance, at each of 20 substeps of an interval: the corner of its box that leads farthest
        out of the tube by the interval's end, comes nearest to what is unsafe until then, or brings it nearer fastest;
        a random one for each interval; or none. For your own see `Moment`.
    seed : int
        The same seed gives the same run.
    steps : int, optional
        How many steps to simulate with the tubes of step 0, if nothing depends on time. By default the steps of the
        table, or `FOREVER_PLAYED` = 100 for a table that stays clear for ever.

    Raises
    ------
    NotAdmissible
        If q0 is in no tube.
    ValueError
        If the adversary is unknown or returns v outside its bounds, or `steps` is given although something depends on
        time.

    Examples
    --------
    With the robot on a line of `help(sdhj)`:

    >>> run = sdhj.simulate(controller, [-2.1], adversary="worst", seed=0)
    >>> run.outcome, len(run.inputs)
    ('reached', 3)
    """
    check_controller(controller)
    play, seed = adversary_of(adversary), whole("seed", seed, least=0)
    start = finite_array("q0", q0)
    controller.safe_inputs(start, 0, first=True)  # raises NotAdmissible
    seen: list[tuple[float, FloatArray, FloatArray]] = []
    applied: list[tuple[int, int]] = []
    began: list[float] = []

    def watch(moment: Moment, v: FloatArray, states: FloatArray, _: FloatArray) -> None:
        seen.append((moment.time + moment.duration, states[0], v[0]))
        if moment.substep == 0:
            began.append(moment.time)
            applied.append((moment.inputs[0], moment.steps_to_go[0]))

    rng, steps = np.random.default_rng(seed), play_length(controller, steps)
    outcomes, _ = rollouts(controller, start[None], play, rng, watch, steps=steps)
    inputs, steps_to_go = np.array(applied, dtype=np.int64).reshape(-1, 2).T
    return Trajectory(
        # without an interval, as of a run that begins in the target, there is no moment, and one instant
        times=np.array([began[0] if began else 0.0, *(t for t, _, _ in seen)]),
        states=np.array([start, *(state for _, state, _ in seen)]),
        inputs=inputs,
        steps_to_go=steps_to_go,
        disturbances=np.array([v for _, _, v in seen]).reshape(-1, controller.problem.dynamics.disturbance_dim),
        outcome=OUTCOMES[outcomes[0]],
    )


def monte_carlo(
    controller: Controller,
    runs: int = 100_000,
    adversary: str | Adversary = "worst",
    seed: int = 0,
    *,
    steps: int | None = None,
    sensing: Sensing | None = None,
    progress: bool | None = None,
) -> Report:
    """Simulate many runs of the closed loop from states drawn uniformly from the tube of step 0.

    Parameters
    ----------
    controller, runs : Controller, int
    adversary, steps
        As for `simulate`; a function of your own runs in one thread.
    seed : int
        The same seed gives the same report.
    sensing : Sensing
        The errors and delays to simulate; by default those that the table was solved for.
    progress : bool, optional
        By default where standard error is a terminal.

    Raises
    ------
    ValueError
        If the tube is empty, or an adversary exceeds its bounds.

    Examples
    --------
    With the robot on a line of `help(sdhj)`:

    >>> report = sdhj.monte_carlo(controller, runs=500, adversary="worst", seed=0, progress=False)
    >>> report.counts["reached"]
    500
    """
    check_controller(controller)
    play, began, length = adversary_of(adversary), time.perf_counter(), play_length(controller, steps)
    runs, seed = whole("runs", runs, least=1, most=MOST_RUNS), whole("seed", seed, least=0)
    require_memory(runs * 8 * (4 + controller.problem.grid.ndim), f"keeping {runs:,} runs", "use fewer")
    sizes = [min(CHUNK, runs - begin) for begin in range(0, runs, CHUNK)]
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))  # one stream for each chunk, whichever thread runs it
    # (so the runs of a seed hang on `CHUNK`, too: with another size of chunks they are others)
    bar = tqdm(total=runs, desc="rollouts", unit="run", disable=hidden(progress))

    # called from several threads
    def chunk(number: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        starts = admissible_states(controller, sizes[number], rng := np.random.default_rng(seeds[number]))
        return (starts, *rollouts(controller, starts, play, rng, steps=length, sensing=sensing))

    # functions of users need not bear to be called from several threads
    workers = 1 if callable(adversary) or callable(controller.rule) else threads()
    with announced(progress), bar, ThreadPoolExecutor(workers) as pool:
        results = []
        for result in pool.map(chunk, range(len(sizes))):
            bar.update(len(result[0]))
            results.append(result)
    starts, outcomes, taken = map(np.concatenate, zip(*results, strict=True))
    return Report(
        runs=runs,
        adversary=name_of(adversary),
        rule=name_of(controller.rule),
        method=controller.table.method,
        seed=seed,
        counts={outcome: int((outcomes == i).sum()) for i, outcome in enumerate(OUTCOMES)},
        starts=starts,
        outcomes=outcomes,
        steps=taken,
        seconds=time.perf_counter() - began,
        has_no_target=controller.problem.has_no_target,
    )


def play_length(controller: Controller, steps: int | None) -> int | None:
    """The number of steps to simulate with the tubes of step 0; None: the table's steps in order."""
    table = controller.table
    if steps is None and table.details.get("endless") and not controller.depends_on_time:
        # a table that holds for ever has no last step at which a run would be over
        return FOREVER_PLAYED if table.problem.has_no_target else table.steps
    if steps is not None and controller.depends_on_time:
        raise ValueError(f"steps must be left out: as time matters, runs follow the table's {table.steps} steps")
    return None if steps is None else whole("steps", steps, least=1)


def name_of(option: object) -> str:
    """The name of an option: a text itself, else its `name`, its `__name__`, or that of its class."""
    if isinstance(option, str):
        return option
    return str(getattr(option, "name", getattr(option, "__name__", type(option).__name__)))


def check_controller(given: Any) -> None:
    """Raise ValueError if `given` is not a Controller."""
    if not isinstance(given, Controller):
        raise ValueError(f"controller must be a Controller, for example Controller(table), got {type(given).__name__}")


def adversary_of(adversary: str | Adversary) -> Adversary:
    """The built-in adversary of a name; a callable is returned as it is."""
    if callable(adversary):
        return adversary
    if not isinstance(adversary, str) or adversary not in ADVERSARIES:
        names = ", ".join(ADVERSARIES)
        raise ValueError(f"adversary must be one of {names}, or a function of a Moment, got {reprlib.repr(adversary)}")
    return ADVERSARIES[adversary]


def admissible_states(controller: Controller, count: int, rng: np.random.Generator) -> FloatArray:
    """States (count, ndim) drawn uniformly from the tube of all steps from step 0, by rejection.

    They are outside the unsafe sets themselves; with a `Sensing` admissible however they are measured.
    """
    grid, steps = controller.problem.grid, controller.table.steps
    found: list[FloatArray] = []
    missing = count
    for _ in range(DRAWS):
        # runs of a seed hang on how many are drawn in one go
        states = rng.uniform(grid.lower, grid.upper, (max(1024, 2 * count), grid.ndim))
        within = np.full(len(states), steps)
        inside = states[controller.table.values_at(states[:, None], 0, within)[:, 0] <= 0][:missing]
        inside = inside[~controller.problem.surely_in_no_tube(inside, 0, steps)]
        # admissible for every measurement of the state; of a proved table in a closed cell, not in the shell around it
        if controller.problem.sensing or controller.table.proved:
            inside = inside[controller.table.contains(inside, start=0, within=steps)]
        found.append(inside)
        missing -= len(inside)
        if missing == 0:
            return np.concatenate(found)
    has_no_target = controller.problem.has_no_target
    advice = (
        "stronger inputs, more nodes or fewer steps" if has_no_target else "more steps or nodes, or a larger target"
    )
    raise ValueError(
        f"the tube of step 0 within {steps} steps is empty or tiny (its share of the grid is "
        f"{controller.table.fraction(start=0, within=steps):.2g}), so no run can start from it; use {advice}"
    )
