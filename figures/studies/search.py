"""A search for adversaries that win: what random play does not find, gradient-free optimisation may.

A *plan* is all that an adversary does in one run, decided in advance: (steps, switches, D), which share of its bounds,
from -1 to 1, it plays in each of the equal parts of each interval. For every start a small population of plans plays
against the closed loop. Those that come nearest to a failure are the parents of the next generation: half of them by
clearance (the least level-set value of the unsafe sets), half by depth (how near the state was to leaving the largest
tube). The first plans are random vertices of the box, some held over whole intervals, and what the adversaries
"aggressive" and "worst" play where they decide once in each part. A start is *lost* when a plan makes its run fail:
collide, leave the tubes, or come late.

A lost start refutes a table. A start that is not lost is no proof: `method="certified"` is for that.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from sdhj.common.checks import whole
from sdhj.common.remembering import FloatArray
from sdhj.common.showing import hidden
from sdhj.simulation.adversaries import ADVERSARIES, Adversary, Moment
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.runs import SUBSTEPS, admissible_states, check_controller, name_of, rollouts
from sdhj.table.batches import CHUNK, NOT_ADMISSIBLE, threads
from sdhj.table.controller import Controller, NotAdmissible

SCOUTS = ("aggressive", "worst")  # whose play is among the first plans
PARENTS = 8  # plans of each start that the next generation comes from
INTERIOR = 0.2  # share of new v that are anywhere in the box, not at a vertex
CHANGED = 0.1  # share of a plan's parts that a mutation decides anew
NUDGES = (0.02, 0.5)  # how far a nudge goes, in half-widths of the box
REACHED = OUTCOMES.index("reached")
NEVER = -1


@dataclass(frozen=True)
class SearchReport:
    """Which starts an adversary was found to win from; `str()` is a summary."""

    method: str
    rule: str
    seed: int
    population: int
    generations: int
    starts: FloatArray = field(repr=False)  # (S, ndim)
    outcomes: FloatArray = field(repr=False)  # (S,) places in OUTCOMES: how a run failed; "reached" where none did
    generation: FloatArray = field(repr=False)  # (S,) the one that won, 0 for the first; -1 where none did
    plans: FloatArray = field(repr=False)  # (S, steps, switches, D) which won, or came nearest to a collision
    clearance: FloatArray = field(repr=False)  # (S,) the least that any plan achieved; see `Margins`
    depth: FloatArray = field(repr=False)  # (S,) likewise
    rollouts: int  # closed-loop runs played in all
    seconds: float  # of wall-clock time

    @property
    def lost(self) -> FloatArray:
        """Whether a losing adversary was found, (S,) bool."""
        return self.outcomes != REACHED

    def count(self, outcome: str) -> int:
        """From how many starts a run was found that ends so."""
        return int((self.outcomes == OUTCOMES.index(outcome)).sum())

    def adversary(self, start: int) -> Adversary:
        """The plan of one start as an adversary for `simulate`, which ends as `outcomes` says."""
        return planned(self.plans[start][None])

    def __str__(self) -> str:
        failed = ", ".join(f"{self.count(outcome)} {outcome}" for outcome in OUTCOMES[1:])
        return (
            f"search for losing adversaries, {self.method} table, rule {self.rule}, seed {self.seed}\n"
            f"{self.rollouts} runs: {self.population} plans in each of {self.generations} generations\n"
            f"lost {int(self.lost.sum())} of {len(self.starts)} starts ({self.lost.mean():.3%}): {failed}\n"
            f"least clearance {self.clearance.min():.3g}, least depth {self.depth.min():.3g}\n"
            f"took {self.seconds:.1f} s"
        )


def search_losing(
    controller: Controller,
    starts: int | FloatArray = 1000,
    *,
    population: int = 32,
    generations: int = 8,
    switches: int = 4,
    seed: int = 0,
    progress: bool | None = None,
) -> SearchReport:
    """Search an adversary that wins, from each of many starts.

    Parameters
    ----------
    controller : Controller
    starts : int or (S, ndim) array
        How many states to draw uniformly from the tube of step 0, or which.
    population, generations : int
        Plans for each start in a generation, at least 4, and how many generations at most: a lost start is done.
    switches : int
        How often the adversary decides in an interval; a divisor of the 20 instants.
    seed : int
        The same seed gives the same report, whatever the number of threads.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Raises
    ------
    NotAdmissible
        Where no tube holds one of the starts.
    ValueError
        For an option that does not fit, or where the tube of step 0 is empty.
    """
    check_controller(controller)
    population = whole("population", population, least=len(SCOUTS) + 2)
    generations, seed = whole("generations", generations, least=1), whole("seed", seed, least=0)
    if whole("switches", switches, least=1) > SUBSTEPS or SUBSTEPS % switches:
        raise ValueError(f"switches must divide {SUBSTEPS}, the instants of an interval, got {switches}")
    began, (drawing, *streams) = time.perf_counter(), np.random.SeedSequence(seed).spawn(2)
    states = _starts(controller, starts, np.random.default_rng(drawing))
    share = max(1, CHUNK // population)  # starts that one thread takes at a time
    chunks = [states[begin : begin + share] for begin in range(0, len(states), share)]
    seeds = streams[0].spawn(len(chunks))  # a stream for each chunk: threads change nothing

    def search(number: int) -> dict[str, FloatArray]:
        rng = np.random.default_rng(seeds[number])
        return _Search(controller, population, switches, rng).run(chunks[number], generations)

    runs = population * generations
    bar = tqdm(total=len(states) * runs, desc="search", unit="run", disable=hidden(progress))
    with bar, ThreadPoolExecutor(1 if callable(controller.rule) else threads()) as pool:
        found = []
        for result in pool.map(search, range(len(chunks))):
            bar.update(len(result["outcomes"]) * runs)
            found.append(result)
    played = int(sum(result.pop("rollouts").sum() for result in found))
    arrays = {name: np.concatenate([result[name] for result in found]) for name in found[0]} | {"starts": states}
    told = {"method": controller.table.method, "rule": name_of(controller.rule), "seed": seed, "rollouts": played}
    told |= {"population": population, "generations": generations, "seconds": time.perf_counter() - began}
    return SearchReport(**told, **arrays)


def planned(plans: FloatArray) -> Adversary:
    """The adversary that plays plans (M, steps, switches, D), one for each of M runs that start together."""
    switches = plans.shape[2]

    def play(moment: Moment) -> FloatArray:
        return plans[moment.runs, moment.step, moment.substep * switches // SUBSTEPS] * moment.bounds

    return play


def _recorded(name: str, plans: FloatArray) -> Adversary:
    """A named adversary that decides once in each part of an interval; what it plays is written into the plans."""
    decide, play, length = ADVERSARIES[name], planned(plans), SUBSTEPS // plans.shape[2]

    def recorded(moment: Moment) -> FloatArray:
        if moment.substep % length == 0:
            v, bounds = decide(moment), moment.bounds
            plans[moment.runs, moment.step, moment.substep // length] = v / np.where(bounds > 0.0, bounds, 1.0)
        return play(moment)

    return recorded


def _starts(controller: Controller, starts: int | FloatArray, rng: np.random.Generator) -> FloatArray:
    if np.ndim(starts) == 0:
        return admissible_states(controller, whole("starts", starts, least=1), rng)
    states = np.array(starts, dtype=np.float64)
    outside = np.flatnonzero(controller.batch(states, 0).steps_to_go == NOT_ADMISSIBLE)
    if not len(states):
        raise ValueError("starts holds no state")
    if outside.size:
        raise NotAdmissible(f"start {outside[0]}, {states[outside[0]].tolist()}, is in no tube of step 0")
    return states


class Margins:
    """How near each of M runs that start together came to failing; filled while `rollouts` calls `watch`.

    Attributes
    ----------
    clearance : (M,) array
        Least true level-set value of the unsafe sets at the instants looked at; <= 0 for a collision.
    depth : (M,) array
        Least depth in the largest tube of a sampling time, minus its level-set value, before the target was reached:
        how near the run was to having no answer. +inf where it was reached at once.
    """

    def __init__(self, controller: Controller, starts: FloatArray) -> None:
        self.problem, self.table = controller.problem, controller.table
        self.clearance = np.array(self.problem.unsafe_value(starts, 0.0))
        self.depth = np.full(len(starts), np.inf)
        self.sample(0, np.arange(len(starts)), starts)

    def watch(self, moment: Moment, v: FloatArray, states: FloatArray, clearance: FloatArray) -> None:
        """Lower the margins of the runs that are going."""
        self.clearance[moment.runs] = np.minimum(self.clearance[moment.runs], clearance)
        if moment.substep == SUBSTEPS - 1:
            self.sample(moment.step + 1, moment.runs, states)

    def sample(self, step: int, runs: FloatArray, states: FloatArray) -> None:
        """Lower the depth, at a sampling time, of the runs that have neither collided nor reached the target."""
        going = self.clearance[runs] > 0
        runs, states = runs[going], states[going]
        if runs.size:
            outside = self.problem.target_value(states, self.problem.time(step)) > 0
            runs, states = runs[outside], states[outside]
        if runs.size:
            largest = np.full(runs.size, self.problem.steps - step)
            depth = 0.0 - self.table.values_at(states[:, None], step, largest)[:, 0]
            self.depth[runs] = np.minimum(self.depth[runs], depth)


class _Played(NamedTuple):
    """Plans (S, P, steps, switches, D) of S starts, and how their runs went, each (S, P)."""

    plans: FloatArray
    outcomes: FloatArray
    taken: FloatArray
    clearance: FloatArray
    depth: FloatArray

    def taking(self, rows: FloatArray, columns: FloatArray) -> "_Played":
        """Some of the plans of some of the starts: rows and columns, shapes broadcast."""
        return _Played(*(array[rows, columns] for array in self))

    def beside(self, *others: "_Played") -> "_Played":
        return _Played(*(np.concatenate(each, axis=1) for each in zip(self, *others, strict=True)))

    def parents(self) -> "_Played":
        """The plans that came nearest to a failure: half by clearance, half by depth, the clearer one last."""
        half = min(PARENTS // 2, self.outcomes.shape[1])
        near = np.argsort(self.clearance, axis=1, kind="stable")[:, :half]
        shallow = np.lexsort((self.clearance, self.depth), axis=1)[:, :half]
        return self.taking(np.arange(len(near))[:, None], np.hstack([near, shallow]))


class _Search:
    """Evolves the plans of a chunk of starts."""

    def __init__(self, controller: Controller, population: int, switches: int, rng: np.random.Generator) -> None:
        self.controller, self.population, self.rng = controller, population, rng
        self.shape = (controller.problem.steps, switches, controller.problem.dynamics.disturbance_dim)

    def run(self, starts: FloatArray, generations: int) -> dict[str, FloatArray]:
        """Evolve plans for each start (S, ndim) until it is lost or the generations are over; see `SearchReport`."""
        count = len(starts)
        outcomes, generation, total = np.full(count, REACHED), np.full(count, NEVER), np.zeros(count, np.int64)
        plans, (clearance, depth) = np.zeros((count, *self.shape)), np.full((2, count), np.inf)
        alive, parents = np.arange(count), None
        for number in range(generations):
            if parents is None:
                played = self.first(starts)
            else:
                played = parents.beside(self.play(starts[alive], self.children(parents)))
            total[alive] += self.population
            rows = np.arange(alive.size)
            failed = played.outcomes != REACHED
            lost = failed.any(axis=1)
            best = np.where(lost, failed.argmax(axis=1), played.clearance.argmin(axis=1))
            plans[alive], outcomes[alive] = played.plans[rows, best], played.outcomes[rows, best]
            clearance[alive], depth[alive] = played.clearance.min(axis=1), played.depth.min(axis=1)
            generation[alive[lost]] = number
            going = ~lost & (played.taken.max(axis=1) > 0)  # where it starts in the target there is nothing to play
            alive, parents = alive[going], played.taking(rows[going][:, None], np.arange(failed.shape[1])).parents()
            if not alive.size:
                break
        found = {"outcomes": outcomes, "generation": generation, "plans": plans, "clearance": clearance}
        return found | {"depth": depth, "rollouts": total}

    def play(self, starts: FloatArray, plans: FloatArray, play: Adversary | None = None) -> _Played:
        """Play plans (S, P, steps, switches, D) from starts (S, ndim); `play` may write them while it plays."""
        count, population = plans.shape[:2]
        flat = plans.reshape(count * population, *plans.shape[2:])  # nothing to play where D = 0
        repeated = np.repeat(starts, population, axis=0)
        margins = Margins(self.controller, repeated)
        results = rollouts(self.controller, repeated, play or planned(flat), self.rng, margins.watch)
        arrays = (*results, margins.clearance, margins.depth)
        return _Played(plans, *(array.reshape(count, population) for array in arrays))

    def first(self, starts: FloatArray) -> _Played:
        """Random plans, the first half held over intervals, after those of the scouts."""
        plans = self.decided((len(starts), self.population, *self.shape))
        held = slice(len(SCOUTS), (self.population + len(SCOUTS)) // 2)
        plans[:, held] = plans[:, held, :, :1]
        scouted = [
            self.play(starts, own, _recorded(name, own[:, 0]))
            for name, own in zip(SCOUTS, np.split(plans[:, : len(SCOUTS)], len(SCOUTS), axis=1), strict=True)
        ]
        return scouted[0].beside(*scouted[1:], self.play(starts, plans[:, len(SCOUTS) :]))

    def decided(self, shape: tuple[int, ...]) -> FloatArray:
        """New shares, the last axis the components of v: most at vertices of the box, some anywhere in it."""
        anywhere = self.rng.uniform(-1.0, 1.0, shape)
        return np.where(self.rng.random((*shape[:-1], 1)) < INTERIOR, anywhere, np.sign(anywhere))

    def children(self, parents: _Played) -> FloatArray:
        """New plans (S, population, steps, switches, D), each of two parents of the same start, mutated.

        A child has the intervals of its first parent up to a cut and those of the second after it. Then some parts are
        changed, and always one that the first parent lived to play, or in every other child its whole interval: decided
        anew in half of the children, and nudged, most by a little, in the other half.
        """
        rng, population, (count, pool, steps, switches, _) = self.rng, self.population, parents.plans.shape
        rows, two = np.arange(count)[:, None], rng.integers(0, pool, (2, count, population))
        early = np.arange(steps)[:, None, None] < rng.integers(1, steps + 1, (count, population, 1, 1, 1))
        plans = np.where(early, parents.plans[rows, two[0]], parents.plans[rows, two[1]])
        interval = rng.integers(0, np.maximum(parents.taken[rows, two[0]], 1))[..., None, None]
        part = rng.integers(0, switches, (count, population, 1, 1))
        entire = (np.arange(population) % 2 == 0)[:, None, None]
        changed = (np.arange(steps)[:, None] == interval) & (entire | (np.arange(switches) == part))
        changed |= rng.random(changed.shape) < CHANGED
        new = self.decided(plans.shape)
        new = np.where(entire[..., None], new[..., :1, :], new)  # one v for a whole interval
        scale = NUDGES[0] * (NUDGES[1] / NUDGES[0]) ** rng.random((count, population, 1, 1, 1))
        nudged = np.clip(plans + scale * rng.standard_normal(plans.shape), -1.0, 1.0)
        new = np.where((np.arange(population) % 4 < 2)[:, None, None, None], new, nudged)
        return np.where(changed[..., None], new, plans)
