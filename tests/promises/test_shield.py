"""The fallback and the filter: closed forms, what they promise, and a random commander judged without the library."""

from functools import cache
from typing import Any

import judge
import numpy as np
import pytest
import zoo
from naive_certified import SMALL

import sdhj
import sdhj.table.controller
from sdhj.certified import Certified
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.sensed import rollouts
from sdhj.table.batches import Table
from sdhj.table.beside import fallbacks
from sdhj.table.controller import Controller

MOST, ENDS, FASTEST = 0.5, 0.9, 0.8  # of the adversary's acceleration, m/s^2; of position, m, and speed, m/s


def skater_problem(steps: int = 10) -> sdhj.ReachAvoidProblem:
    """A double integrator that must stay within 0.9 m and 0.8 m/s; accelerations of -3 to 3 m/s^2, held for 0.1 s."""
    return zoo.cart(
        np.linspace(-3.0, 3.0, 7),
        MOST,
        grid=sdhj.Grid([-1.0, -1.0], [1.0, 1.0], [41, 41]),
        target=sdhj.TargetSet((0, 1), lambda p, t: np.abs(p).max(axis=1) - 0.4),
        unsafe=(
            sdhj.UnsafeSet((0,), lambda p, t: ENDS - np.abs(p[:, 0]), name="ends"),
            sdhj.UnsafeSet((1,), lambda p, t: FASTEST - np.abs(p[:, 0]), name="speed"),
        ),
        steps=steps,
    )


@cache
def skater(method: str) -> Table:
    """Its table, certified or interpolated."""
    certified = Certified((100, 100))
    return sdhj.solve(skater_problem(), certified if method == "certified" else sdhj.HJI(), progress=False)


def states_in(table: Table, count: int, rng: np.random.Generator) -> np.ndarray:
    states = rng.uniform(table.grid.lower, table.grid.upper, (100 * count, table.grid.ndim))
    return states[table.contains(states, start=0, within=table.steps)][:count]


def skated(choose: Any, starts: np.ndarray, steps: int, rng: np.random.Generator) -> dict[str, int]:
    """How the judge saw runs end. Half of the adversaries switch at random, half push outward all the time."""
    pushes, outward = np.linspace(-3.0, 3.0, 7), np.arange(len(starts)) % 2 == 0

    def velocity(states, inputs, signs, t):
        return np.stack([states[:, 1], pushes[inputs] + MOST * signs[:, 0]], axis=1)

    def signs(states, inputs, t, end):
        away = np.where(states.sum(axis=1) > 0, 1.0, -1.0)
        return np.where(outward, away, rng.choice([-1.0, 1.0], len(states)))[:, None]

    def unsafe(states, t):
        return np.minimum(ENDS - np.abs(states[:, 0]), FASTEST - np.abs(states[:, 1]))

    def never(states, t):
        return np.ones(len(states))

    outcomes = judge.play(choose, velocity, signs, never, unsafe, starts, delta=0.1, steps=steps)
    return {outcome: int((outcomes == outcome).sum()) for outcome in np.unique(outcomes)}


# ---- the fallback


def test_fallback_on_the_line_is_the_closed_form() -> None:
    """Unsafe is q >= 3: after 0.5 s input u may have led 0.5 (u + 0.2) towards it, and was never nearer than that."""
    table = zoo.interval_table()
    controller = Controller(table)
    for q in (-3.9, -2.0, 2.0, 2.89, 2.95, 3.2):
        hazards = [q + max(0.0, 0.5 * (u + 0.2)) - 3.0 for u in (-1, 0, 1)]
        np.testing.assert_allclose(table.hazards(np.array([[q]]), 0)[0], hazards, rtol=0, atol=1e-6)  # single precision
        told = controller.fallback([q], 0)
        assert told.input == 0 and told.hazard == pytest.approx(hazards[0], abs=1e-6)
        assert told.steps == (q < 3.0)
    assert controller.fallback([-3.95], 0).steps == 1  # no tube of five steps holds it
    with pytest.raises(sdhj.NotAdmissible):
        controller.select([-3.95], 0)


def test_where_nothing_is_unsafe_the_fallback_leads_back() -> None:
    problem = zoo.interval_problem(unsafe=False)
    controller = Controller(sdhj.solve(problem, sdhj.HopfLax("linear"), progress=False))
    for q, expected in ((3.9, 0), (-3.9, 2)):
        told = controller.fallback([q], 0)
        assert controller.steps_to_go([q], 0) is None
        assert (told.input, told.steps, told.hazard) == (expected, 1, -np.inf)


def test_off_the_grid_nothing_is_promised_but_by_rounding() -> None:
    for table, rounding in ((zoo.interval_table(), 1e-9), (line_certified(), 5e-11)):
        states = np.array([[-4.0 - rounding], [-4.0], [-4.001], [9.0]])
        chosen, steps, _ = fallbacks(table, states, 0)
        assert steps.tolist() == [1, 1, 0, 0] and chosen[3] == 0
    states = np.array([[7.0, 0.5], [0.7, -9.0]])  # of periodic axes no state is
    table = zoo.torus_table()
    again = states + 2 * np.pi * np.array([[1, 0], [0, -2]])
    for one, other in zip(fallbacks(table, states, 0), fallbacks(table, again, 0), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


@cache
def line_certified() -> Table:
    return sdhj.solve(zoo.interval_problem(), Certified((80,)), progress=False)


def test_hazards_of_a_certified_table_are_what_it_proves(rng: np.random.Generator) -> None:
    """For the cell of a state: of what touches or is inside positive, of what is clear by more than a cell negative."""
    table, states = line_certified(), rng.uniform(-4, 3.3, (400, 1))
    states[:3, 0] = 3.0 - 0.6, 3.0 - 0.1, 3.0
    hazards = table.hazards(states, 2)
    exact = states + np.maximum(0.0, 0.5 * (np.array([-1, 0, 1]) + 0.2)) - 3.0
    cell = float(table.axes[0].width)
    assert (hazards[exact > -1e-9] > 0).all() and (hazards[exact < -cell - 1e-9] < 0).all()
    assert ((-cell < exact) & (exact < 0)).sum() > 5 and not (hazards == 0).any()


@pytest.mark.parametrize("method", ["certified", "hji"])
def test_what_the_fallback_promises_is_kept(method: str, rng: np.random.Generator) -> None:
    """From states that no tube holds: where a step is promised, none of the judge's adversaries wins within it."""
    table = skater(method)
    states = rng.uniform(-1, 1, (10_000, 2))
    states = states[table.batch(states, 0).steps_to_go < 0]
    chosen, steps, hazards = fallbacks(table, states, 0)
    cell = 0.0 if method == "certified" else table.grid.spacing[0] / 10  # between the nodes the tube is interpolated
    clear = (steps == 1) & (hazards < -cell)
    assert clear.sum() > 300 and (steps == 0).sum() > 1000
    counts = skated(lambda now, step: chosen[clear], states[clear], 1, rng)
    assert counts == {"late": int(clear.sum())}
    worst = skated(lambda now, step: (chosen[clear] + 4) % 7, states[clear], 1, rng)  # another input does worse
    assert worst["collided"] > 30


@pytest.mark.slow
def test_the_arms_proof_says_where_it_is_clear(rng: np.random.Generator) -> None:
    """A promise of the certified arm: half of its states have none, and where there is one, nobody meets the arm."""
    problem = sdhj.arm_case_study(**SMALL)
    table = sdhj.solve(problem, Certified(cells=(32, 32, 12, 12), parts=4), progress=False)
    states = rng.uniform(table.grid.lower, table.grid.upper, (2000, 4))
    hazards = table.hazards(states, 1)
    safe = table.certified_inputs(states, 1, 2)
    assert safe.any() and (hazards[safe] < 0).all()  # what is certified is clear
    chosen, steps, _ = fallbacks(table, states, 1)
    clear = steps == 1
    assert 0.1 < clear.mean() < 0.9
    interval, bounds = problem.interval(1), problem.interval(1).bounds(chosen, 0.0)
    for _ in range(20):
        now, v = states[clear], rng.choice([-1.0, 1.0], (clear.sum(), bounds.shape[1])) * bounds[clear]
        for part in range(20):
            now = interval.advance(now, chosen[clear], v, 0.0, problem.delta / 20)
            assert (problem.unsafe_value(now, problem.time(1) + (part + 1) * problem.delta / 20) > 0).all()


# ---- the filter


def test_filter_on_the_line_is_the_closed_form() -> None:
    """Safe is what stays below 3 for certain and leaves the target within four steps; inputs -1, 0 and 1."""
    controller = Controller(zoo.interval_table())
    kept = controller.filter([2.2], 0, 2)  # 2.2 + 0.6 < 3, but then the target is 1.8 away, and four steps are 1.6
    assert (kept.inputs, kept.changed, kept.overruled, kept.promised, kept.fallback) == (1, True, True, True, False)
    assert controller.filter([1.9], 0, 2).inputs == 2  # two steps would be the fewest, and moving away is none of them
    assert 2 not in controller.safe_inputs([1.9], 0)
    between = controller.filter([0.0], 0, [0.6])
    assert (between.inputs, between.commands.tolist()) == (2, [1.0]) and between.changed and not between.overruled
    same = controller.filter([0.0], 0, [1.0])
    assert same.inputs == 2 and not same.changed and not same.overruled
    lost = controller.filter([-3.95], 0, 1)
    assert lost.fallback and not lost.promised and lost.inputs == 0 and lost.changed
    assert lost.inputs == controller.fallback([-3.95], 0).input


@pytest.mark.parametrize("make", [zoo.torus_table, line_certified, zoo.interval_table])
def test_filter_gives_the_nearest_safe_input(make: Any, rng: np.random.Generator) -> None:
    """Against plain loops over what the table says, for indices and for commands, of one state and of many.

    Of a table on a grid those that keep a third of a cell; where none does, the one of least margin.
    """
    table = make()
    reserve = 0.0 if table.proved else table.change_over_cell / 3
    reserved = 0
    controller, inputs = Controller(table), table.problem.inputs
    states = rng.uniform(table.grid.lower, table.grid.upper, (100, table.grid.ndim))
    for step in range(table.steps):
        batch = table.batch(states, step, table.steps - step)
        indices = rng.integers(0, len(inputs), 100)
        commands = rng.uniform(-3, 3, (100, inputs.shape[1]))
        commands[:25] = inputs[indices[:25]]
        for wanted, meant in ((indices, inputs[indices]), (commands, commands)):
            told = controller.filter(states, step, wanted)
            for m in range(100):
                distances = np.sqrt(((inputs - meant[m]) ** 2).sum(axis=1))
                safe, j = np.flatnonzero(batch.safe[m]), told.inputs[m]
                kept = safe[batch.margins[m, safe] <= -reserve]
                if safe.size:
                    reserved += kept.size < safe.size
                    if kept.size:
                        assert j in kept and distances[j] == distances[kept].min()
                    else:
                        assert j in safe and batch.margins[m, j] == batch.margins[m, safe].min()
                    assert told.promised[m] and not told.fallback[m]
                else:
                    assert j == controller.fallback(states[m], step).input
                    assert told.fallback[m] and not told.promised[m]
                assert (told.commands[m] == inputs[j]).all()
                assert told.changed[m] == (inputs[j] != meant[m]).any()
                assert told.overruled[m] == (distances[j] > distances.min())
                if m < 8:
                    alone = controller.filter(states[m], step, wanted[m])
                    assert alone.inputs == j and alone.changed == told.changed[m]
                    assert alone.commands.shape == (inputs.shape[1],)
            assert told.changed.any() and not told.changed.all()
            assert told.fallback.any() and told.overruled.any()
    assert (reserved > 0) == (not table.proved)


def test_a_cell_of_the_value_is_the_gradient_s_in_any_units() -> None:
    """Of a distance on nodes .05 m and .2 m apart that grows along (3, 4) / 5: hypot(.05 * .6, .2 * .8) m."""
    for unit in (1.0, 1e-3, 1e3):
        problem = zoo.plane(
            [[0.0, 0.0]],
            0.0,
            grid=sdhj.Grid([-2 * unit, -2 * unit], [2 * unit, 2 * unit], [81, 21]),
            target=sdhj.TargetSet((0, 1), lambda p, t: 0.6 * p[:, 0] + 0.8 * p[:, 1]),
            delta=0.1,
            steps=1,
        )
        cell = sdhj.solve(problem, play=False, progress=False).change_over_cell
        assert cell == pytest.approx(np.hypot(0.05 * 0.6, 0.2 * 0.8) * unit, rel=1e-3)


@pytest.mark.slow
def test_a_random_policy_behind_the_arm_s_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the worst adversary; with no reserve at least three times as many are lost."""
    problem = sdhj.arm_case_study(nodes=25)
    table = sdhj.solve(problem, progress=False, play=False)
    drawn = np.random.default_rng(3)
    states = drawn.uniform(problem.grid.lower, problem.grid.upper, (40_000, 4))
    states = states[table.contains(states) & (problem.target_value(states, 0.0) > 0)][:1500]

    class Shielded(Controller):
        def choose(self, batch: Any, before: Any = None) -> np.ndarray:
            wanted = rng.integers(0, len(problem.inputs), len(batch.states))
            return self.filter(batch.states, batch.step, wanted).inputs

    lost = []
    for share in (sdhj.table.controller.SHIELDED, 0.0):
        monkeypatch.setattr(sdhj.table.controller, "SHIELDED", share)
        rng = np.random.default_rng(4)
        outcomes, _ = rollouts(Shielded(table), states, ADVERSARIES["worst"], np.random.default_rng(1))
        lost.append((outcomes != 0).mean())
    assert len(states) == 1500 and 0 < lost[0] <= 0.025 and lost[1] >= 3 * lost[0], lost


def test_of_inputs_with_one_command_the_index_is_kept() -> None:
    twice = [[0.0], [1.0], [1.0], [-1.0]]
    problem = zoo.line(
        grid=sdhj.Grid([-2.0], [2.0], [41]),
        dynamics=sdhj.Dynamics(twice, twice, [[0.0]], [0.0]),
        target=zoo.goal(0.0, 1.5),
        delta=0.1,
        steps=2,
    )
    controller = Controller(sdhj.solve(problem, progress=False))
    for wanted in range(4):
        assert controller.filter([0.0], 0, wanted).inputs == wanted


@pytest.mark.parametrize(
    ("q", "step", "wanted", "said"),
    [
        ([0.0], 0, 3, "0 to 2, got"),
        ([0.0], 0, 1.0, "command of 1 number"),
        ([0.0], 0, True, "got True"),
        ([[0.0], [1.0]], 0, [1], r"int of shape \(2,\)"),
        ([[0.0], [1.0]], 0, [[1], [np.nan]], "wanted has a NaN"),
        ([0.0], 5, 1, "step"),
        ([0.0, 0.0], 0, 1, r"have shape \(M, 1\)"),
    ],
)
def test_what_is_no_command_is_refused(q: Any, step: int, wanted: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Controller(zoo.interval_table()).filter(q, step, wanted)


@pytest.mark.parametrize(
    ("q", "step", "said"),
    [
        ([0.0], 5, "step"),
        ([[0.0]], 0, r"must have shape \(1,\)"),
        ([np.inf], 0, "NaN or an infinity"),
    ],
)
def test_what_is_no_state_has_no_fallback(q: Any, step: int, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Controller(zoo.interval_table()).fallback(q, step)


def commander(table: Table, rng: np.random.Generator, seen: list[Any]) -> Any:
    """A random policy behind the filter: half of its runs want indices, the other half any acceleration."""
    controller = Controller(table)

    def choose(states: np.ndarray, step: int) -> np.ndarray:
        half, inputs = len(states) // 2, np.empty(len(states), np.int64)
        for rows, wanted in (
            (slice(half), rng.integers(0, 7, half)),
            (slice(half, None), rng.uniform(-4, 4, (len(states) - half, 1))),
        ):
            told = controller.filter(states[rows], 0, wanted)  # nothing depends on time: always N steps left
            inputs[rows] = told.inputs
            seen.append((told.overruled.mean(), told.promised.all(), told.fallback.any()))
        return inputs

    return choose


def test_a_random_commander_without_the_filter_is_lost(rng: np.random.Generator) -> None:
    starts = states_in(skater("certified"), 300, rng)
    counts = skated(lambda states, step: rng.integers(0, 7, len(states)), starts, 50, rng)
    assert counts["collided"] > 270


@pytest.mark.parametrize(("runs", "steps"), [(1000, 20), pytest.param(2000, 500, marks=pytest.mark.slow)])
def test_a_random_commander_behind_the_certified_filter_is_never_lost(
    runs: int, steps: int, rng: np.random.Generator
) -> None:
    """The slow one plays 10^6 steps, each of 40 instants at which the judge looks."""
    table, seen = skater("certified"), []
    counts = skated(commander(table, rng, seen), states_in(table, runs, rng), steps, rng)
    overruled, promised, fallback = np.array(seen).T
    print(f"{runs * steps} steps, {counts}, overruled {overruled.mean():.3f}")
    assert counts == {"late": runs}
    assert promised.all() and not fallback.any() and overruled.mean() > 0.1


@pytest.mark.slow
def test_behind_an_interpolated_filter_few_are_lost(rng: np.random.Generator) -> None:
    table, seen = skater("hji"), []
    counts = skated(commander(table, rng, seen), states_in(table, 1000, rng), 50, rng)
    assert counts.get("collided", 0) <= 20
