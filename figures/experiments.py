"""What Sec. 6.1 claims, as experiments that return data; plotting is elsewhere.

* The stronger the adversary, the smaller the victory domain, until nothing is left (`sweep_adversary`).
* More input levels enlarge it, at a cost that grows with their number (`sweep_input_levels`).
* The rule that picks one of the safe inputs trades effort, clearance and time (`compare_rules`).
* How a moving obstacle enters the game of one interval decides whether the result is safe (`compare_view_times`).
* The more cells, the more of the tubes can be certified (`sweep_cells`).
* An evading target takes no other method, but cannot be projected (`evading_target`).

Sizes are arguments with the case study's defaults: give fewer nodes and steps for a quick look.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdhj.arm.case_studies import arm_case_study, evader_case_study
from sdhj.certified.sets import certify
from sdhj.certified.table import CertifiedTable
from sdhj.controller import Controller
from sdhj.grid import FloatArray
from sdhj.problem import VIEW_TIMES, ReachAvoidProblem
from sdhj.projections import ProjectionWarning
from sdhj.recursion import solve
from sdhj.simulation import SUBSTEPS, Report, Trajectory, admissible_states, monte_carlo, simulate
from sdhj.table import LookupTable
from sdhj.arm.workspace import Disk, Line

SWEEPS: Mapping[str, tuple[float, ...]] = {
    "v_p_max": (0.0, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.4, 3.2, 4.0, 5.0),  # m/s
    "v_d_max": (0.0, 0.3, 0.6, 0.9, 1.2, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0),  # rad/s
}
RULES = ("deepest", "effort", "target", "clearance")
INSTANTS = 400  # of each interval, at which `compare_view_times` looks for collisions
BULLET = Disk(Line((0.10, 2.6), (0.0, -20.0)), 0.005)  # crosses the workspace in 0.03 s, within the second interval


def _share_won(table: LookupTable, start: int = 0) -> float:
    """Share of the grid's volume from which the robot, not in the target yet, is guaranteed to reach it."""
    inside = table.values(start=start, within=table.steps) <= 0
    return table.grid.fraction(inside & ~(table.values(start=start, within=0) <= 0))


@dataclass(frozen=True)
class AdversarySweep:
    """The victory domain against a bound of the adversary's.

    Attributes
    ----------
    bound : str
        "v_p_max" (m/s) or "v_d_max" (rad/s).
    values : tuple of float
    fractions : tuple of float
        Share of the grid inside the tube of step 0 within all steps, the target itself included.
    won : tuple of float
        The same without the states that are in the target already: what the controller wins.
    """

    bound: str
    values: tuple[float, ...]
    fractions: tuple[float, ...]
    won: tuple[float, ...]

    @property
    def extinct(self) -> float | None:
        """The first value at which nothing is won; None where the sweep does not reach so far."""
        return next((value for value, won in zip(self.values, self.won, strict=True) if won == 0.0), None)


def sweep_adversary(
    bound: str,
    values: Sequence[float] | None = None,
    *,
    method: str = "hji",
    nodes: int = 25,
    steps: int = 8,
    **arguments: Any,
) -> AdversarySweep:
    """Solve the arm's case study for a range of one bound of the adversary's (Sec. 6.1).

    Parameters
    ----------
    bound : {"v_p_max", "v_d_max"}
    values : sequence of float, optional
        By default from nothing to extinction.
    method, nodes, steps, arguments
        As for `solve` and `arm_case_study`.
    """
    if bound not in SWEEPS:
        raise ValueError(f"bound must be one of {', '.join(SWEEPS)}, got {bound!r}")
    chosen = tuple(SWEEPS[bound] if values is None else values)
    fractions, won = [], []
    for value in chosen:
        problem = arm_case_study(nodes=nodes, steps=steps, **(arguments | {bound: value}))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ProjectionWarning)  # an empty tube is what a sweep is for
            table = solve(problem, method=method, progress=False)
        fractions.append(table.fraction(start=0, within=steps))
        won.append(_share_won(table))
    return AdversarySweep(bound, chosen, tuple(fractions), tuple(won))


@dataclass(frozen=True)
class CellSweep:
    """What is certified with more and more cells.

    Attributes
    ----------
    numbers : tuple of int
        Cells of the whole state space.
    fractions : tuple of float
        Certified share of the grid, from step 0 within all steps.
    seconds : tuple of float
    finest : CertifiedTable
    """

    numbers: tuple[int, ...]
    fractions: tuple[float, ...]
    seconds: tuple[float, ...]
    finest: CertifiedTable


def sweep_cells(
    problem: ReachAvoidProblem, cells: Sequence[Sequence[int]], say: Callable[[str], Any] = lambda line: None
) -> CellSweep:
    """Certify a problem with each of `cells`, as `sdhj.certified.sets.certify` takes them; `say` receives progress lines."""
    numbers, fractions, seconds = [], [], []
    for each in cells:
        say(f"certifying with {' x '.join(map(str, each))} cells")
        finest = CertifiedTable(certify(problem, cells=each))
        numbers.append(int(np.prod(finest.sets.shape, dtype=np.int64)))
        fractions.append(finest.fraction(start=0, within=problem.steps))
        seconds.append(float(finest.details["seconds"]))
    return CellSweep(tuple(numbers), tuple(fractions), tuple(seconds), finest)


@dataclass(frozen=True)
class LevelSweep:
    """The victory domain and its price against the levels of each input component.

    Attributes
    ----------
    levels : tuple of int
    inputs : tuple of int
        L, their square.
    problems : tuple of int
        One-step reach problems, L N (N + 1) / 2.
    fractions, seconds : tuple of float
        Share of the grid inside the tube of step 0 within all steps; wall-clock time of the solution.
    """

    levels: tuple[int, ...]
    inputs: tuple[int, ...]
    problems: tuple[int, ...]
    fractions: tuple[float, ...]
    seconds: tuple[float, ...]


def sweep_input_levels(
    levels: Sequence[int] = (3, 5, 7, 9), *, method: str = "hji", nodes: int = 25, steps: int = 8, **arguments: Any
) -> LevelSweep:
    """Solve the arm's case study with more and more inputs (Sec. 6.1)."""
    solve(arm_case_study(nodes=5, steps=1, **arguments), method=method, progress=False)  # compiles, outside the clock
    tables = [
        solve(
            arm_case_study(nodes=nodes, steps=steps, **(arguments | {"input_levels": n})), method=method, progress=False
        )
        for n in levels
    ]
    counts = [len(table.problem.inputs) for table in tables]
    return LevelSweep(
        levels=tuple(levels),
        inputs=tuple(counts),
        problems=tuple(count * steps * (steps + 1) // 2 for count in counts),
        fractions=tuple(table.fraction(start=0, within=steps) for table in tables),
        seconds=tuple(table.details["seconds"] for table in tables),
    )


# --------------------------------------------------------------------------------------------------------------------
# Runs of the controller
# --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RuleOutcome:
    """What one selection rule does over many runs from the same starts.

    Attributes
    ----------
    rule : str
    runs, reached, collided : int
    effort : float
        Mean over the runs that reached the target of the integral of |u|^2, rad^2 / s.
    clearance : float
        Mean over those of the least distance to anything unsafe on the way, m.
    time : float
        Mean time to the target, s.
    """

    rule: str
    runs: int
    reached: int
    collided: int
    effort: float
    clearance: float
    time: float


def compare_rules(
    table: LookupTable,
    rules: Sequence[str] = RULES,
    *,
    runs: int = 200,
    adversary: str = "random",
    seed: int = 0,
) -> list[RuleOutcome]:
    """Run every rule from the same starts, drawn from the tube outside the target, against one kind of adversary."""
    problem = table.problem
    starts = _starts(table, runs, seed)
    outcomes = []
    for rule in rules:
        controller = Controller(table, rule=rule)
        every = [simulate(controller, q, adversary, seed=seed + i) for i, q in enumerate(starts)]
        good = [run for run in every if run.outcome == "reached"]
        effort = [problem.delta * np.square(problem.inputs[run.inputs]).sum() for run in good]
        outcomes.append(
            RuleOutcome(
                rule=rule,
                runs=runs,
                reached=len(good),
                collided=sum(run.outcome == "collided" for run in every),
                effort=_mean(effort),
                clearance=_mean(_clearances(problem, good, 1)),
                time=_mean([run.times[-1] for run in good]),
            )
        )
    return outcomes


def _mean(values: Sequence[float] | FloatArray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _starts(table: LookupTable, count: int, seed: int) -> FloatArray:
    """States (count, ndim) drawn uniformly from the tube of step 0, truly outside the target and what is unsafe."""
    controller, rng, found = Controller(table), np.random.default_rng(seed), np.empty((0, table.grid.ndim))
    while len(found) < count:
        drawn = admissible_states(controller, 4 * count, rng)
        outside = (table.problem.target_value(drawn, 0.0) > 0) & (table.problem.unsafe_value(drawn, 0.0) > 0)
        if not outside.any():
            raise ValueError("the tube of step 0 holds next to nothing but the target: there is nothing to simulate")
        found = np.concatenate([found, drawn[outside]])
    return found[:count]


def _clearances(problem: ReachAvoidProblem, runs: Sequence[Trajectory], finer: int) -> FloatArray:
    """Least true level-set value of what is unsafe along each run, (runs,), `finer` instants for each one simulated.

    Between the simulated instants the velocity is constant, so states are interpolated, not approximated.
    """
    if not runs:
        return np.empty(0)
    least = problem.unsafe_value(np.array([run.states[0] for run in runs]), 0.0)
    longest = max(len(run.times) for run in runs)
    for i in range(longest - 1):
        going = [place for place, run in enumerate(runs) if len(run.times) > i + 1]
        before, after = (np.array([runs[place].states[at] for place in going]) for at in (i, i + 1))
        t0, t1 = runs[going[0]].times[[i, i + 1]]
        for part in np.arange(1, finer + 1) / finer:
            value = problem.unsafe_value(before + part * (after - before), t0 + part * (t1 - t0))
            least[going] = np.minimum(least[going], value)
    return least


@dataclass(frozen=True)
class ViewTimeOutcome:
    """What one view-time promises and what happens.

    Attributes
    ----------
    view_time : str
    fraction : float
        Share of the grid inside the tube of step 0 within all steps.
    runs : int
        From states that the table calls admissible.
    collided : int
        Runs that truly touched something unsafe.
    rate : float
        Their share.
    deepest : float
        The least clearance of all runs, m; negative where the robot was inside an obstacle.
    """

    view_time: str
    fraction: float
    runs: int
    collided: int
    deepest: float

    @property
    def rate(self) -> float:
        return self.collided / self.runs


def compare_view_times(
    view_times: Sequence[str] = VIEW_TIMES,
    *,
    method: str = "hji",
    nodes: int = 25,
    steps: int = 4,
    runs: int = 200,
    rule: str = "effort",
    adversary: str = "none",
    seed: int = 0,
    obstacles: Sequence[Disk | Mapping[str, Any]] = (BULLET,),
    **arguments: Any,
) -> list[ViewTimeOutcome]:
    """Solve with each view-time and count the collisions that happen although the table promised there would be none.

    By default a small obstacle crosses the workspace at 20 m/s: between two of 20 samples of an interval it moves
    0.1 m, so "sampled" sees gaps in its path that are wider than the arm. Collisions are looked for with the true
    geometry at 400 instants of each interval. The adversary does nothing by default: what goes wrong is then the
    table's doing.
    """
    outcomes = []
    for view_time in view_times:
        problem = arm_case_study(nodes=nodes, steps=steps, view_time=view_time, obstacles=obstacles, **arguments)
        table = solve(problem, method=method, progress=False)
        controller = Controller(table, rule=rule)
        every = [simulate(controller, q, adversary, seed=seed + i) for i, q in enumerate(_starts(table, runs, seed))]
        least = _clearances(problem, every, INSTANTS // SUBSTEPS)
        outcomes.append(
            ViewTimeOutcome(
                view_time=view_time,
                fraction=table.fraction(start=0, within=steps),
                runs=runs,
                collided=int((least <= 0).sum()),
                deepest=float(least.min()),
            )
        )
    return outcomes


@dataclass(frozen=True)
class EvaderOutcome:
    """The evading target, full and projected, and how chases end.

    Attributes
    ----------
    fraction, won : float
        Full method: share of the grid inside the tube of step 0 within all steps, and without the target itself.
    projected_won : float
        The same by projections: nothing, for the reasons in `warnings`.
    warnings : tuple of str
    reports : mapping of adversary to Report
    """

    fraction: float
    won: float
    projected_won: float
    warnings: tuple[str, ...]
    reports: Mapping[str, Report]


def evading_target(
    adversaries: Sequence[str] = ("random", "worst"),
    *,
    nodes: int = 25,
    steps: int = 8,
    runs: int = 2000,
    seed: int = 0,
    **arguments: Any,
) -> EvaderOutcome:
    """Solve the evader's case study both ways and chase evaders that move at random and that flee optimally (Sec. 6.1).

    Projecting along a coordinate of the evader asks that the end-effector be on it wherever, along that axis, it is;
    no state is. The projected method therefore finds the target alone, and says so.
    """
    problem = evader_case_study(nodes=nodes, steps=steps, **arguments)
    full = solve(problem, progress=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ProjectionWarning)  # reported in the result
        projected = solve(problem, method="projected", progress=False)
    controller = Controller(full)
    return EvaderOutcome(
        fraction=full.fraction(start=0, within=steps),
        won=_share_won(full),
        projected_won=_share_won(projected),
        warnings=tuple(projected.details["projection"]["warnings"]),
        reports={name: monte_carlo(controller, runs, name, seed, progress=False) for name in adversaries},
    )
