"""Closed-loop simulation against an adversary, with the true dynamics and the true geometry.

The robot measures its state at every sampling time t_k and asks the controller; nothing else here reads the table, but
for the adversary that is allowed to. Collisions are judged by the true level-set functions at 20 instants of every
interval. The outcome of a run is one of

* reached: at a sampling time the state was truly in the target, and no collision was seen before; without a target,
  the last sampling time came, or the state left for good over a safe end;
* collided: the state was in an unsafe set at one of the instants, the start included;
* left: at a sampling time before the last no tube held the state, so the controller had no answer;
* late: the last sampling time came without any of those;
* off the grid: the state left through an end of the grid that is unsafe (or, played with walls=False, a wall).

Where the interpolated table calls a state reached that is truly just outside, the run goes on with the inputs that
bring it back into the target: known geometry is measured, not interpolated.
"""

import reprlib
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm

from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import announced, hidden
from sdhj.problem.checks import finite_array, whole
from sdhj.problem.memory import require
from sdhj.problem.sensing import Sensing
from sdhj.simulation.adversaries import ADVERSARIES, SUBSTEPS, Adversary, Moment, first_moment
from sdhj.simulation.outcomes import COLLIDED, LATE, LEFT, OUTCOMES, REACHED, UNDECIDED, Watch, play_interval
from sdhj.simulation.sensed import sensed_rollouts
from sdhj.table.batches import CHUNK, threads
from sdhj.table.controller import Controller

Z95 = 1.959963984540054  # two-sided 95% quantile of the normal distribution
FOREVER_PLAYED = 100  # steps, where staying clear has no end
MOST_RUNS = 10**8  # whose starts and ends are held in memory
DRAWS = 1000  # rounds of rejection sampling before giving up


@dataclass(frozen=True)
class Trajectory:
    """One run, at every instant looked at.

    Attributes
    ----------
    times : (T,) array
        s; every SUBSTEPS-th is a sampling time.
    states : (T, ndim) array
        Coordinates of periodic axes are not wrapped, so that the path has no jumps.
    inputs : (K,) int array
        Index into problem.inputs of the input held over each interval.
    steps_to_go : (K,) int array
        What the controller promised at the start of each interval.
    disturbances : (T - 1, D) array
        What the adversary played between one instant and the next.
    outcome : {"reached", "collided", "left", "late", "off the grid"}
        In the target at a sampling time; in an unsafe set before; at a sampling time in a state that no tube holds,
        where the controller has no answer; none of these by the last step; or past an end of the grid.
    """

    times: FloatArray
    states: FloatArray
    inputs: FloatArray
    steps_to_go: FloatArray
    disturbances: FloatArray
    outcome: str

    @property
    def samples(self) -> FloatArray:
        """The states at the sampling times, (K + 1, ndim), or (K, ndim) where a collision ended an interval early."""
        return self.states[::SUBSTEPS]


def score_interval(count: int, runs: int) -> tuple[float, float]:
    """95% confidence interval of a rate that was `count` of `runs` (Wilson's score interval)."""
    n, p = runs, count / runs
    centre = (p + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
    half = Z95 / (1 + Z95**2 / n) * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2))
    return max(0.0, centre - half), min(1.0, centre + half)


@dataclass(frozen=True)
class Report:
    """How many runs ended how; `str()` is a table.

    Attributes
    ----------
    runs, adversary, rule, method, seed
        What was simulated.
    counts : mapping of outcome to int
    starts : (runs, ndim) array
    outcomes : (runs,) int array
        Places in `OUTCOMES`; see `Trajectory`.
    steps : (runs,) int array
        Intervals that each run took.
    seconds : float
        Wall-clock time.
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

    def rate(self, outcome: str) -> float:
        """Share of the runs with an outcome."""
        return self.counts[outcome] / self.runs

    def interval(self, outcome: str) -> tuple[float, float]:
        """95% confidence interval of the rate (Wilson's score interval)."""
        return score_interval(self.counts[outcome], self.runs)

    def __str__(self) -> str:
        head = f"{self.runs} runs, {self.method} table, adversary {self.adversary}, rule {self.rule}, seed {self.seed}"
        lines = [head, f"{'outcome':<13}{'runs':>10}{'rate':>10}   95% interval"]
        for outcome in OUTCOMES:
            rate, low, high = (100 * share for share in (self.rate(outcome), *self.interval(outcome)))
            lines.append(f"{outcome:<13}{self.counts[outcome]:>10}{rate:>9.3f}%   {low:.3f}% to {high:.3f}%")
        reached = self.steps[self.outcomes == OUTCOMES.index("reached")]
        if reached.size:
            lines.append(f"reached after {reached.mean():.2f} steps on average, {reached.max()} at most")
        lines.append(f"took {self.seconds:.1f} s")
        return "\n".join(lines)


def simulate(
    controller: Controller,
    q0: FloatArray,
    adversary: str | Adversary = "worst",
    seed: int = 0,
    *,
    walls: bool = True,
    steps: int | None = None,
) -> Trajectory:
    """Run the closed loop once from state q0 (ndim,) at step 0.

    Parameters
    ----------
    controller : Controller
    q0 : (ndim,) array
    adversary : {"worst", "aggressive", "random", "none"} or callable (Moment) -> (M, D)
        See `sdhj.simulation.adversaries`; yours is called at every substep.
    seed : int
    walls : bool
        Whether the plant is held by the walls of the grid; False plays beyond walls that are only assumed.
    steps : int, optional
        How many to play, more than the table has or fewer, where nothing depends on time: the table then is asked as of
        step 0 at each of them. By default those of the table, one after the other; of a table solved with steps=None as
        many, asked as of step 0, and without a target `FOREVER_PLAYED` = 100.

    Raises
    ------
    NotAdmissible
        Where no tube holds q0.
    ValueError
        For a state that is not one, an unknown adversary, or one that leaves its bounds, or steps of what depends on
        time.
    """
    check_controller(controller)
    play, seed = adversary_of(adversary), whole("seed", seed, least=0)
    start = finite_array("q0", q0)
    controller.safe_inputs(start, 0)  # raises where there is nothing to simulate
    seen: list[tuple[float, FloatArray, FloatArray]] = []
    held: list[tuple[int, int]] = []
    began: list[float] = []

    def watch(moment: Moment, v: FloatArray, states: FloatArray, _: FloatArray) -> None:
        seen.append((moment.time + moment.duration, states[0], v[0]))
        if moment.substep == 0:
            began.append(moment.time)
            held.append((moment.inputs[0], moment.steps_to_go[0]))

    rng, steps = np.random.default_rng(seed), play_length(controller, steps)
    outcomes, _ = rollouts(controller, start[None], play, rng, watch, walls=walls, steps=steps)
    inputs, steps_to_go = np.array(held, dtype=np.int64).reshape(-1, 2).T
    return Trajectory(
        times=np.array([began[0] if began else 0.0, *(t for t, _, _ in seen)]),
        states=np.array([start, *(state for _, state, _ in seen)]),
        inputs=inputs,
        steps_to_go=steps_to_go,
        disturbances=np.array([v for _, _, v in seen]).reshape(-1, controller.problem.dynamics.adversaries),
        outcome=OUTCOMES[outcomes[0]],
    )


def monte_carlo(
    controller: Controller,
    runs: int = 100_000,
    adversary: str | Adversary = "worst",
    seed: int = 0,
    *,
    walls: bool = True,
    steps: int | None = None,
    sensing: Sensing | None = None,
    progress: bool | None = None,
) -> Report:
    """Run the closed loop many times, from states drawn uniformly from the tube of step 0.

    Parameters
    ----------
    controller, runs : Controller, int
    adversary : {"worst", "aggressive", "random", "none"} or callable (Moment) -> (M, D)
    walls, steps
        As for `simulate`. An adversary of yours is called from one thread, the named ones from several.
    sensing : Sensing, played against: by default what the table was solved for; see `sdhj.simulation.sensed`
    seed : int, of which each has one report, whatever the number of threads
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Raises
    ------
    ValueError
        For an option that does not fit, or where the tube of step 0 is empty.
    """
    check_controller(controller)
    play, began, length = adversary_of(adversary), time.perf_counter(), play_length(controller, steps)
    runs, seed = whole("runs", runs, least=1, most=MOST_RUNS), whole("seed", seed, least=0)
    require(runs * 8 * (4 + controller.problem.grid.ndim), f"keeping {runs:,} runs", "use fewer")
    sizes = [min(CHUNK, runs - begin) for begin in range(0, runs, CHUNK)]
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))  # a stream for each chunk: threads change nothing
    bar = tqdm(total=runs, desc="rollouts", unit="run", disable=hidden(progress))

    def chunk(number: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        starts = admissible_states(controller, sizes[number], rng := np.random.default_rng(seeds[number]))
        return (starts, *rollouts(controller, starts, play, rng, walls=walls, steps=length, sensing=sensing))

    workers = 1 if callable(adversary) or callable(controller.rule) else threads()
    with announced(progress), bar, ThreadPoolExecutor(workers) as pool:
        results = []
        for result in pool.map(chunk, range(len(sizes))):
            bar.update(len(result[0]))
            results.append(result)
    starts, outcomes, taken = map(np.concatenate, zip(*results, strict=True))
    return Report(
        runs=runs,
        adversary=named(adversary),
        rule=named(controller.rule),
        method=controller.table.method,
        seed=seed,
        counts={outcome: int((outcomes == place).sum()) for place, outcome in enumerate(OUTCOMES)},
        starts=starts,
        outcomes=outcomes,
        steps=taken,
        seconds=time.perf_counter() - began,
    )


def play_length(controller: Controller, steps: int | None) -> int | None:
    """How many steps to play, asked as of step 0; None: those of the table, one after the other."""
    table = controller.table
    if steps is None and table.details.get("endless"):
        return FOREVER_PLAYED if table.problem.stays else table.steps
    if steps is not None and not table.problem.timeless:
        raise ValueError(
            f"runs follow the {table.steps} steps of the table, as something depends on time; leave out steps"
        )
    return None if steps is None else whole("steps", steps, least=1)


def named(option: object) -> str:
    return option if isinstance(option, str) else getattr(option, "__name__", type(option).__name__)


def check_controller(given: Any) -> None:
    """Raise ValueError for what cannot play, a table for example."""
    if not isinstance(given, Controller):
        raise ValueError(f"controller must be a Controller, for example Controller(table), got {type(given).__name__}")


def adversary_of(adversary: str | Adversary) -> Adversary:
    if callable(adversary):
        return adversary
    if not isinstance(adversary, str) or adversary not in ADVERSARIES:
        names = ", ".join(ADVERSARIES)
        raise ValueError(f"adversary must be one of {names}, or a function of a Moment, got {reprlib.repr(adversary)}")
    return ADVERSARIES[adversary]


def admissible_states(controller: Controller, count: int, rng: np.random.Generator) -> FloatArray:
    """States (count, ndim) drawn uniformly from the tube of step 0, by rejection.

    Raises
    ------
    ValueError
        Where next to nothing of the grid is admissible.
    """
    grid, steps = controller.problem.grid, controller.table.steps
    found: list[FloatArray] = []
    missing = count
    for _ in range(DRAWS):
        states = rng.uniform(grid.lower, grid.upper, (max(1024, 2 * count), grid.ndim))
        within = np.full(len(states), steps)
        inside = states[controller.table.values_at(states[:, None], 0, within)[:, 0] <= 0][:missing]
        inside = inside[~controller.problem.refuted(inside, 0, steps)]
        if controller.problem.sensing:  # to be known to be admissible
            inside = inside[controller.table.contains(inside, start=0, within=steps)]
        found.append(inside)
        missing -= len(inside)
        if missing == 0:
            return np.concatenate(found)
    raise ValueError(
        f"the tube of step 0 within {steps} steps is empty or tiny (its share of the grid is "
        f"{controller.table.fraction(start=0, within=steps):.2g}), so there is nothing to start from; use more steps "
        "or nodes, or a larger target"
    )


def rollouts(
    controller: Controller,
    starts: FloatArray,
    play: Adversary,
    rng: np.random.Generator,
    watch: Watch | None = None,
    *,
    walls: bool = True,
    steps: int | None = None,
    sensing: Sensing | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Run the closed loop from each start (M, ndim); outcome (M,), a place in OUTCOMES, and intervals taken (M,).

    `steps` as `play_length` returns them.
    """
    problem, last = controller.problem, controller.problem.steps if steps is None else steps
    if sensing := problem.sensing if sensing is None else sensing:
        return sensed_rollouts(controller, starts, play, rng, watch, walls, steps, sensing)
    states, alive = starts.copy(), np.arange(len(starts))
    outcomes, taken = np.full(len(starts), UNDECIDED), np.zeros(len(starts), dtype=np.int64)
    outcomes[problem.unsafe_value(states, problem.time(0)) <= 0] = COLLIDED
    for number in range(last + 1):
        step, now = number if steps is None else 0, problem.time(number)
        alive = alive[outcomes[alive] == UNDECIDED]
        inside = np.full(alive.size, problem.stays and number == last)
        if alive.size and not problem.stays:
            inside = problem.target_value(states[alive], now) <= 0
        outcomes[alive[inside]] = REACHED
        alive = alive[~inside]
        if number == last or not alive.size:
            break
        batch = controller.batch(states[alive], step)
        inputs = controller.choose(batch)
        outcomes[alive[inputs < 0]] = LEFT
        known = inputs >= 0
        alive, to_go = alive[known], batch.steps_to_go[known]
        if not alive.size:
            break
        begun = first_moment(controller.table, problem, states[alive], inputs[known], to_go, step, now, alive, rng)
        states[alive], outcomes[alive] = play_interval(begun, play, watch, walls)
        taken[alive] += 1
    outcomes[outcomes == UNDECIDED] = LATE
    return outcomes, taken
