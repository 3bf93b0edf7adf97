"""For ever needs a proof: what is promised for ever holds for ever, by closed forms and by a judge of its own.

The camera hangs on a cable: its place (encoder steps) and speed (steps/s), brakes of 264 steps/s^2, a rope that shakes
it by 20, the fastest speed a wall. The fence is a drone's, whose velocity follows what is commanded with a lag of .3 s,
in gusts of .5 m/s^2. The pumps keep a level between 5 and 95 %. The judge shares no code with the library: Heun's
steps, and an adversary that decides five times in an interval for the vertex that leads nearest to an end.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.common.findings import ResolutionWarning
from sdhj.solver.joint import Joint

SECONDS = sdhj.Certified(seconds=6)


class Plant:
    """dq/dt = f(q, u) + gain v, |v| <= push, kept between walls; lost is what is past an end of `lower` and `upper`."""

    def __init__(
        self, rate: Any, inputs: Any, gain: Any, push: float, delta: float, ends: Any, walls: Any = None
    ) -> None:
        self.rate, self.inputs, self.gain, self.push, self.delta = rate, np.array(inputs), np.array(gain), push, delta
        self.ends, self.walls = np.array(ends, float), walls

    def moved(self, q: Any, u: Any, v: Any, h: float) -> Any:
        """States (M, ndim) a time h later under commands (M, m) and pushes (M,)."""
        slope = self.rate(q, u) + v[:, None] * self.gain
        slope = (slope + self.rate(q + h * slope, u) + v[:, None] * self.gain) / 2
        return q + h * slope if self.walls is None else np.clip(q + h * slope, *self.walls)

    def room(self, q: Any) -> Any:
        """The distance to the nearest end, of states (M, ndim): (M,)."""
        return np.minimum(q - self.ends[0], self.ends[1] - q).min(axis=1)

    def worst(self, q: Any, u: Any, left: float) -> Any:
        """The push (M,) that comes nearest to an end if it is held for what is left of an interval."""
        rooms = []
        for sign in (-1.0, 1.0):
            at, least = q, np.full(len(q), np.inf)
            for _ in range(3):
                at = self.moved(at, u, np.full(len(q), sign * self.push), left / 3)
                least = np.minimum(least, self.room(at))
            rooms.append(least)
        return np.where(rooms[0] < rooms[1], -self.push, self.push)

    def lost(self, answer: Any, starts: Any, steps: int, parts: int = 20) -> tuple[int, int]:
        """Of runs from starts (M, ndim): how many were ever past an end, and how many answers were not promised."""
        q, out, unpromised = np.array(starts), np.zeros(len(starts), bool), 0
        for _ in range(steps):
            inputs, promised = answer(q)
            unpromised, u = unpromised + int((~promised & ~out).sum()), self.inputs[inputs]
            for part in range(parts):
                if part % (parts // 5) == 0:
                    v = self.worst(q, u, self.delta * (1 - part / parts))
                q = self.moved(q, u, v, self.delta / parts)
                out |= self.room(q) < -1e-9
        return int(out.sum()), unpromised


def camera(nodes: tuple[int, int] = (83, 61), steps: int | None = None) -> tuple[sdhj.ReachAvoidProblem, Plant]:
    problem = zoo.cart(
        (-264.0, 0.0, 264.0),
        20.0,
        **{"lower": [48, -600], "upper": [1679, 600], "nodes": nodes, "ends": ["unsafe", "wall"]},
        delta=0.02,
        steps=steps,
    )
    ends, walls = ([48, -np.inf], [1679, np.inf]), ([-np.inf, -600.0], [np.inf, 600.0])
    rate = lambda q, u: np.stack([q[:, 1], u[:, 0]], 1)  # noqa: E731
    return problem, Plant(rate, problem.inputs, [0, 1], 20.0, 0.02, ends, walls)


def camera_holds(q: Any) -> Any:
    """Brakes stop it: at 264 less 20 steps/s^2 the speed v takes v^2 / 488 more steps."""
    pos, speed = q.T
    return (pos + np.maximum(speed, 0) ** 2 / 488 < 1679) & (pos - np.minimum(speed, 0) ** 2 / 488 > 48)


LAG, GUST = 0.3, 0.5


def fence() -> tuple[sdhj.ReachAvoidProblem, Plant]:
    def drift(q: Any, u: Any) -> Any:
        return np.stack([q[:, 1], (u[0] - q[:, 1]) / LAG], axis=1)

    grid = {"lower": [-3.5, -1.3], "upper": [3.5, 1.3], "nodes": [141, 53]}
    problem = zoo.cart((-1.0, -0.5, 0.0, 0.5, 1.0), GUST, drift=drift, **grid)
    rate = lambda q, u: np.stack([q[:, 1], (u[:, 0] - q[:, 1]) / LAG], axis=1)  # noqa: E731
    return problem, Plant(rate, problem.inputs, [0, 1], GUST, 0.1, ([-3.5, -1.3], [3.5, 1.3]))


def fence_holds(q: Any) -> Any:
    """Commanded back at 1 m/s a drone at speed v > 0 goes on by LAG v less (1 - GUST LAG) t, until it turns at t."""

    def beyond(v: Any) -> Any:
        back, v = 1 - GUST * LAG, np.maximum(v, 0.0)
        return LAG * v - back * LAG * np.log1p(v / back)

    x, v = q.T
    return (3.5 - x > beyond(v)) & (3.5 + x > beyond(-v))


def pumps(sensing: Any = None) -> tuple[sdhj.ReachAvoidProblem, Plant]:
    """Inflow 0 to 6 %/min, two pumps of 4 %/min: off never lets it fall, both never let it rise."""
    problem = zoo.line(
        (0.0, 1.0, 2.0),
        3.0,
        drift=lambda q, u: np.full((len(q), 1), 3.0 - 4.0 * u[0]),
        **{"lower": [5], "upper": [95], "nodes": 91, "names": ["level"]},
        target=None,
        delta=1 / 6,
        steps=None,
        sensing=sensing or sdhj.Sensing(),
    )
    return problem, Plant(lambda q, u: 3 - 4 * u, problem.inputs, [1], 3.0, 1 / 6, ([5], [95]))


def drawn(problem: sdhj.ReachAvoidProblem, count: int, rng: np.random.Generator) -> Any:
    return rng.uniform(problem.grid.lower, problem.grid.upper, (count, problem.grid.ndim))


def selecting(table: Any) -> Any:
    controller = sdhj.Controller(table)

    def answer(q: Any) -> Any:
        told = controller.batch(q)
        return controller.choose(told), told.promised

    return answer


def filtering(table: Any, wanted: int) -> Any:
    controller = sdhj.Controller(table)

    def answer(q: Any) -> Any:
        told = controller.filter(q, wanted=np.full(len(q), wanted))
        return told.inputs, told.promised

    return answer


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "holds", "share", "steps", "forward"),
    [(camera, camera_holds, 0.845, 250, 2), (fence, fence_holds, 0.99, 100, 4)],
)
def test_what_is_promised_for_ever_holds(
    robot: Any, holds: Any, share: float, steps: int, forward: int, rng: Any
) -> None:
    """Nothing is promised that the closed form denies; no run leaves, nor behind the filter one of who drives on."""
    problem, plant = robot()
    table = sdhj.solve(problem, SECONDS, play=False, progress=False)
    states = drawn(problem, 100_000, rng)
    promised = table.contains(states)
    assert not (promised & ~holds(states)).any() and promised.mean() >= share, promised.mean()
    starts = states[promised][:300]
    for answer in (selecting(table), filtering(table, forward)):
        assert plant.lost(answer, starts, steps) == (0, 0)


@pytest.mark.parametrize("error", [0.0, 2.5])
def test_pumps_keep_the_level_for_ever(error: float) -> None:
    """Wherever it is; where it is measured up to 2.5 % wrong, all of what two errors explain has to be a level."""
    problem, plant = pumps(sdhj.Sensing(error=error))
    table, levels = sdhj.solve(problem, SECONDS, play=False, progress=False), np.linspace(5, 95, 9001)[:, None]
    promised, ideal = table.contains(levels), (levels[:, 0] >= 5 + 2 * error) & (levels[:, 0] <= 95 - 2 * error)
    assert not (promised & ~ideal).any() and promised.sum() >= 0.99 * ideal.sum()
    if not error:
        for wanted in (0, 2):
            assert plant.lost(filtering(table, wanted), levels[promised][::50], 100) == (0, 0)


def test_pumps_keep_the_level_for_ever_by_what_is_measured(rng: np.random.Generator) -> None:
    """The loop of `Controller.step` with its memory, against the worst flow and errors that mislead."""
    problem, plant = pumps(sdhj.Sensing(error=2.5))
    table = sdhj.solve(problem, SECONDS, play=False, progress=False)
    for start in (10.3, 50.0, 89.7):
        for sign in (-1.0, 1.0):
            controller, level = sdhj.Controller(table), np.array([[start]])
            for step in range(60):
                seen = level[0] + rng.choice([-2.5, sign * 2.5])
                told = controller.step(seen, step * problem.delta)
                assert told.promised
                level = plant.moved(level, plant.inputs[[told.input]], np.array([sign * 3.0]), problem.delta)
                assert plant.room(level)[0] >= -1e-9


# ---- what a grid says of it


FOR_EVER = "for ever.*method='certified'.*enclosure= or slope=.*steps=N"


@pytest.mark.parametrize("method", ["hji", Joint()])
def test_no_grid_promises_for_ever(method: Any) -> None:
    problem = camera((9, 9))[0]
    with pytest.raises(ValueError, match=FOR_EVER):
        sdhj.solve(problem, method)
    target = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 800.0, p[:, 1]) - 100.0)
    name = getattr(method, "name", method)
    with pytest.raises(ValueError, match=f"'{name}'.*steps=60.*steps_to_go.*method='certified'"):
        sdhj.solve(replace(problem, target=target), method)


def test_nor_does_a_method_of_the_formula_of_hopf_and_lax() -> None:
    with pytest.raises(ValueError, match=FOR_EVER):
        sdhj.solve(replace(pumps()[0], dynamics=sdhj.Dynamics([[0.0]], [[1.0]], [[1.0]], [3.0])), "lax")


def test_where_no_method_is_named_for_ever_is_proved(capsys: pytest.CaptureFixture[str]) -> None:
    problem = pumps()[0]
    table = sdhj.solve(problem, progress=True)
    assert table.method == "certified" and table.details["endless"]
    assert "sdhj.Certified(seconds=10) proves what holds" in capsys.readouterr().err
    assert sdhj.solve(replace(problem, steps=5), play=False, progress=False).method == "hji"


@pytest.mark.usefixtures("solves_are_played")
@pytest.mark.parametrize("steps", [20, pytest.param(150, marks=pytest.mark.slow)])
def test_a_number_of_steps_is_no_way_round(steps: int) -> None:
    """The camera's grid promises what is lost, whatever its nodes: half of the runs from its boundary are."""
    said = "within a cell.*greedy.*certified"
    with pytest.warns(ResolutionWarning, match=said):
        table = sdhj.solve(camera(steps=steps)[0], "hji", progress=False)
    told = table.details["played"]
    assert told["boundary_lost"] > 0.3 * told["boundary"] > 0


@pytest.mark.usefixtures("solves_are_played")
def test_of_a_grid_that_is_right_up_to_a_cell_nothing_is_said() -> None:
    """The fence's; warnings are errors here."""
    table = sdhj.solve(replace(fence()[0], steps=20), "hji", progress=False)
    told = table.details["played"]
    assert told["lost"] <= 1 and told["boundary"] == told["runs"] == 100
