"""A cost along the run: against dynamic programming in plain loops, and in runs of a plant that shares no code."""

from functools import cache
from itertools import product
from typing import Any

import naive_controller
import numpy as np
import pytest
import zoo
from room import room

import sdhj


def rooms(**given: Any) -> sdhj.ReachAvoidProblem:
    """A plane with a post in the middle: to the other side of it, at .4 or .8 m/s in eight directions."""
    turns = [(np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 4]
    inputs = [[0.0, 0.0], *([speed * x, speed * y] for speed in (0.4, 0.8) for x, y in turns)]
    grid = sdhj.Grid([-2.0, -1.5], [2.0, 1.5], [41, 31])
    usual = {"grid": grid, "target": zoo.goal(1.2, 0.0, 0.4), "unsafe": (zoo.post(0.0, 0.0, 0.3),), "steps": 12}
    return zoo.plane(inputs, **usual | given)


@cache
def table(method: str) -> Any:
    options = {"certified": sdhj.Certified(cells=[80, 60], parts=4)}
    return sdhj.solve(rooms(), options.get(method, method), progress=False, play=False)


# ---- the twin


def plainly(table: Any, stage: Any, end: Any, join: Any, reserve: float) -> list[dict[Any, float]]:
    """J at the nodes of every step, in plain loops; which inputs are safe is asked of the table, node by node."""
    problem, grid, steps = table.problem, table.grid, table.steps
    nodes = list(product(*(range(n) for n in grid.shape)))
    lattice = {name: getattr(grid, name) for name in ("lower", "spacing", "shape", "periodic")}
    axes, found = range(grid.ndim), [dict[Any, float]() for _ in range(steps + 1)]
    for step in range(steps, -1, -1):
        for at in nodes:
            q = np.array([grid.lower[i] + at[i] * grid.spacing[i] for i in axes])
            told = table.batch(q[None], step, steps - step)
            if told.steps_to_go[0] == 0:
                found[step][at] = end(q, problem.time(step))
            safe = [j for j in range(len(problem.inputs)) if told.safe[0, j]]
            if told.steps_to_go[0] <= 0 or not safe:
                continue
            kept = [j for j in safe if told.margins[0, j] <= -reserve]
            least, costs = min(told.margins[0, j] for j in safe), []
            for j in kept or [j for j in safe if told.margins[0, j] == least]:
                moved = q + problem.delta * problem.dynamics.drift_at(q[None], j)[0]
                total = weights = 0.0
                for weight, node in naive_controller.surrounding(moved, axes, lattice):
                    if node in found[step + 1]:
                        total, weights = total + weight * found[step + 1][node], weights + weight
                if weights >= 1e-3:
                    costs.append(join(stage(moved, j, problem.time(step + 1)), total / weights))
            if costs:
                found[step][at] = min(costs)
    return found


@pytest.mark.parametrize(
    ("name", "cost"),
    [
        *[("torus", cost) for cost in ("effort", "distance", "clearance", "own")],
        *[("certified", cost) for cost in ("effort", "clearance")],
    ],
)
def test_against_dynamic_programming_in_plain_loops(name: str, cost: str) -> None:
    if name == "torus":
        made = zoo.small_torus_table()  # moving, periodic
    else:
        coarse = rooms(steps=3, grid=sdhj.Grid([-2.0, -1.5], [2.0, 1.5], [13, 9]))
        made = sdhj.solve(coarse, sdhj.Certified(cells=[40, 30], parts=3), progress=False, play=False)
    problem, delta, inputs = made.problem, made.problem.delta, made.problem.inputs
    stages: dict[str, Any] = {
        "effort": lambda q, j, t: delta * sum(u * u for u in inputs[j]),
        "distance": lambda q, j, t: delta * max(problem.target_value(q[None], t)[0], 0.0),
        "clearance": lambda q, j, t: -problem.unsafe_value(q[None], t)[0],
        "own": lambda q, j, t: 1.0 + j,
    }
    end = (lambda q, t: -problem.unsafe_value(q[None], t)[0]) if cost == "clearance" else (lambda q, t: 0.0)
    join = max if cost == "clearance" else (lambda a, b: a + b)
    expected = plainly(made, stages[cost], end, join, 0.0 if made.proved else made.change_over_cell / 3)
    rule = sdhj.CostToGo(made, (lambda among: 1.0 + among.inputs) if cost == "own" else cost, progress=False)
    values, known = rule._values[:, 0].reshape(-1, *made.grid.shape), rule._values[:, 1].reshape(-1, *made.grid.shape)
    for step, there in enumerate(expected):
        assert {tuple(at) for at in np.argwhere(known[step]).tolist()} == set(there) and there
        mine = np.array([values[step][at] for at in there])
        assert np.allclose(mine, list(there.values()), rtol=0, atol=1e-5)
    assert len(expected[0]) > len(expected[-1])


# ---- runs


def runs(controller: sdhj.Controller, starts: np.ndarray, pushes: np.ndarray) -> dict[str, np.ndarray]:
    """Runs of dq = u + v in the plane: whether each arrived, its effort, and its least distance from the post."""
    problem, q, count = controller.problem, starts.copy(), len(starts)
    arrived, lost = np.zeros(count, bool), np.zeros(count, bool)
    effort, nearest = np.zeros(count), np.hypot(q[:, 0], q[:, 1]) - 0.3
    for step in range(problem.steps + 1):
        arrived |= ~lost & (np.hypot(q[:, 0] - 1.2, q[:, 1]) <= 0.4)
        going = ~arrived & ~lost
        if step == problem.steps or not going.any():
            break
        chosen = controller.choose(controller.batch(q, step))
        lost |= going & (chosen < 0)
        going &= chosen >= 0
        u = problem.inputs[np.maximum(chosen, 0)]
        effort += going * problem.delta * (u**2).sum(axis=1)
        for _ in range(10):
            q = np.where(going[:, None], q + problem.delta / 10 * (u + pushes[step]), q)
            nearest = np.minimum(nearest, np.hypot(q[:, 0], q[:, 1]) - 0.3)
            lost |= going & ((nearest <= 0) | (np.abs(q) > [2.0, 1.5]).any(axis=1))
    return {"arrived": arrived, "effort": effort, "nearest": nearest}


@pytest.mark.parametrize("method", ["certified", "hji"])
def test_paired_runs_in_the_plane(method: str, rng: np.random.Generator) -> None:
    """With the cost effort a tenth less effort, with the cost clearance more clearance; of proved runs none is lost."""
    made = table(method)
    starts = rng.uniform([-2.0, -1.5], [2.0, 1.5], (4000, 2))
    starts = starts[made.contains(starts) & (np.hypot(starts[:, 0] - 1.2, starts[:, 1]) > 0.4)][:300]
    pushes = rng.uniform(-0.1, 0.1, (made.steps, len(starts), 2))
    played = {
        rule: runs(sdhj.Controller(made, rule=rule), starts, pushes) for rule in ("deepest", "effort", "clearance")
    }
    for cost, counted, sign in (("effort", "effort", -1.0), ("clearance", "nearest", 1.0)):
        with_it = runs(sdhj.Controller(made, rule=sdhj.CostToGo(made, cost, progress=False)), starts, pushes)
        lost = 1.0 - with_it["arrived"].mean()
        assert lost == 0.0 if made.proved else lost <= 0.025
        for rule in ("deepest", cost):  # the rule that looks one step ahead
            both = with_it["arrived"] & played[rule]["arrived"]
            before, gained = played[rule][counted][both], sign * (with_it[counted] - played[rule][counted])[both]
            least = gained.mean() - 1.96 * gained.std() / np.sqrt(both.sum())
            assert least > (0.1 * before.mean() if cost == "effort" else 0.0), (cost, rule, least, before.mean())


def test_the_loop_counts_its_steps() -> None:
    """Though nothing depends on the time: else a robot that has time left would never go."""
    made = table("certified")
    frugal = sdhj.Controller(made, rule=sdhj.CostToGo(made, "effort", progress=False))
    q, controller, inputs = np.array([0.5, 1.0]), frugal, made.problem.inputs
    answers = []
    for step in range(made.steps + 1):
        answers.append(controller.step(q, step * 0.3))
        if answers[-1].arrived:
            break
        q = q + 0.3 * inputs[answers[-1].input]
    assert answers[-1].arrived and len(answers) > made.steps - 2 > answers[0].steps_to_go
    assert all(one.promised for one in answers[:-1])
    with pytest.raises(ValueError, match="time must be at"):
        controller.step(q, (made.steps + 1) * 0.3)
    for ask in (frugal.select, frugal.safe_inputs, frugal.steps_to_go):
        with pytest.raises(ValueError, match="give the step"):
            ask([0.5, 1.0])
        ask([0.5, 1.0], 0)
    kept = set(np.flatnonzero(made.batch([[0.5, 1.0]], 0, made.steps).safe[0]).tolist())
    assert set(frugal.safe_inputs([0.5, 1.0], 0).tolist()) == kept
    with pytest.raises(ValueError, match="steps must be left"):
        sdhj.monte_carlo(frugal, runs=10, steps=5)
    report = sdhj.monte_carlo(frugal, runs=200, adversary="worst", progress=False)
    assert report.counts["reached"] == 200 and report.rule == "cost to go of effort"
    assert report.steps.mean() > sdhj.monte_carlo(sdhj.Controller(made), runs=200, progress=False).steps.mean() + 2
    run = sdhj.simulate(frugal, [0.5, 1.0])
    assert run.outcome == "reached" and len(run.inputs) > run.steps_to_go[0]


def test_the_worst_adversary_plays_against_the_tube_of_all_steps_left() -> None:
    """It pushes out of what the controller keeps: seen by an adversary of one's own, whose tube is asked."""
    made, seen = table("certified"), []

    def asks(moment: sdhj.Moment) -> np.ndarray:
        if moment.substep == 0:
            level = moment.tube(moment.states[:, None])[:, 0]
            seen.append(np.array_equal(level <= 0, made.contains(moment.states, start=moment.step + 1)))
        return np.zeros_like(moment.previous)

    rule = sdhj.CostToGo(made, "clearance", progress=False)
    sdhj.monte_carlo(sdhj.Controller(made, rule=rule), runs=50, adversary=asks, progress=False)
    assert len(seen) > 3 and all(seen)


def test_any_rule_may_ask_for_all_inputs_that_keep_the_steps_left(rng: np.random.Generator) -> None:
    """By its attribute: it is handed those that are safe for all steps, on a grid with a third of a cell to spare."""
    made, handed = table("hji"), []

    def slowest(among: sdhj.Candidates) -> np.ndarray:
        handed.append(among)
        return np.linalg.norm(made.problem.inputs, axis=1)[among.inputs]

    slowest.all_left = True  # type: ignore[attr-defined]
    states = rng.uniform([-2.0, -1.5], [2.0, 1.5], (300, 2))
    controller = sdhj.Controller(made, rule=slowest)
    batch = controller.batch(states, 2)
    chosen, told = controller.choose(batch), made.batch(states, 2, made.steps - 2)
    (among,) = handed
    for m in range(300):
        safe = np.flatnonzero(told.safe[m])
        kept = [j for j in safe if told.margins[m, j] <= -made.change_over_cell / 3]
        least = [j for j in safe if told.margins[m, j] == told.margins[m, safe].min()]
        assert among.inputs[among.rows == m].tolist() == (kept or least)
        assert chosen[m] in (kept or least or [told.best[m]])


@pytest.mark.slow
def test_with_sensing_and_from_a_store(tmp_path: Any) -> None:
    """Predictions are states to it, remembered ones too; a table on disk gives the same."""
    noisy = rooms(steps=8, sensing=sdhj.Sensing(error=0.02, delay=0.1, memory=True))
    made = sdhj.solve(noisy, sdhj.Certified(cells=[100, 75]), progress=False, play=False)
    rule = sdhj.CostToGo(made, "effort", progress=False)
    report = sdhj.monte_carlo(sdhj.Controller(made, rule=rule), runs=100, adversary="worst", progress=False)
    assert report.counts["reached"] == 100
    stored = sdhj.solve(rooms(), store=tmp_path / "store", progress=False, play=False)
    for cost in ("effort", "clearance"):
        controllers = [
            sdhj.Controller(one, rule=sdhj.CostToGo(one, cost, progress=False)) for one in (stored, table("hji"))
        ]
        states = np.random.default_rng(0).uniform([-2.0, -1.5], [2.0, 1.5], (500, 2))
        chosen = [one.choose(one.batch(states, 0)) for one in controllers]
        assert (chosen[0] == chosen[1]).all() and (chosen[0] >= 0).any()


@pytest.mark.slow
def test_what_has_no_cost_along_the_run_is_refused(tmp_path: Any) -> None:
    """Each in a line that says what to do, and the advice holds."""
    made = table("hji")
    for cost in ("deepest", 1, None):
        with pytest.raises(ValueError, match="cost"):
            sdhj.CostToGo(made, cost)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="table must be what"):
        sdhj.CostToGo(sdhj.Controller(made), "effort")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="score for each candidate"):
        sdhj.CostToGo(made, lambda among: np.zeros(3), progress=False)
    for never in (-np.inf, np.nan):
        with pytest.raises(ValueError, match="be numbers, or inf"):
            sdhj.CostToGo(made, lambda among, never=never: np.full(len(among.inputs), never), progress=False)
    with pytest.raises(ValueError, match="must be real numbers"):
        sdhj.CostToGo(made, lambda among: np.full(len(among.inputs), "a"), progress=False)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="rule"):
        sdhj.Controller(made, rule=sdhj.CostToGo)  # type: ignore[arg-type]
    other, again = (sdhj.solve(rooms(delta=delta), progress=False, play=False) for delta in (0.2, 0.3))
    with pytest.raises(ValueError, match=r"another table.*CostToGo\(table"):
        sdhj.Controller(other, rule=sdhj.CostToGo(made, "effort", progress=False)).select([0.5, 1.0], 0)
    own = [sdhj.Controller(again, rule=sdhj.CostToGo(one, "effort", progress=False)) for one in (again, made)]
    assert own[0].select([0.5, 1.0], 0) == own[1].select([0.5, 1.0], 0)
    ever = sdhj.solve(rooms(target=None, steps=None), sdhj.Certified([40, 30]), play=False, progress=False)
    with pytest.raises(ValueError, match="a number of steps"):
        sdhj.CostToGo(ever, "effort")
    staying = sdhj.solve(rooms(target=None, steps=5), play=False, progress=False)
    assert sdhj.Controller(staying, sdhj.CostToGo(staying, "effort", progress=False)).select([1.0, 1.0], 0) == 0
    with pytest.raises(ValueError, match="none: use another cost"):
        sdhj.CostToGo(staying, "distance")
    with pytest.raises(ValueError, match="unsafe under every input"):
        sdhj.CostToGo(empty := sdhj.solve(rooms(unsafe=()), play=False, progress=False), "clearance")
    sdhj.CostToGo(empty, "effort", progress=False)
    with pytest.raises(ValueError, match="rule"):
        sdhj.export_c(table("certified"), tmp_path, rule=sdhj.CostToGo(table("certified"), "effort"))  # type: ignore[arg-type]
    with room(100_000), pytest.raises(MemoryError, match="needs about"):
        sdhj.CostToGo(made, "effort")


@pytest.mark.parametrize("method", ["hji", sdhj.Certified(cells=[80])], ids=["hji", "certified"])
def test_past_a_safe_end_nothing_is_left_to_cost(method):
    """From 3.7 m one step to the right leads out at 4 m, for a tenth of what any other step costs."""
    problem = zoo.line(target=None, ends=[["unsafe", "safe"]], steps=3)
    table = sdhj.solve(problem, method, progress=False, play=False)
    right = int(np.argmax(problem.inputs[:, 0]))
    rule = sdhj.CostToGo(table, lambda among: np.where(among.inputs == right, 0.1, 1.0), progress=False)
    controller = sdhj.Controller(table, rule)
    batch = controller.batch([[3.7], [3.2], [-2.0]], 0)
    scores = np.full(batch.safe.shape, np.inf)
    rows, inputs = np.nonzero(batch.safe)
    scores[rows, inputs] = rule(sdhj.Candidates(problem, batch, rows, inputs, np.full(len(rows), -1)))
    assert scores[0, right] == pytest.approx(0.1) and scores[1, right] == pytest.approx(0.2, abs=0.06)
    assert controller.choose(batch).tolist() == [right] * 3
