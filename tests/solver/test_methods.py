"""Methods are objects: one of a user's own, what is refused, and what the short forms stand for."""

from dataclasses import dataclass

import naive
import numpy as np
import pytest
import zoo
from plain import run_plainly

import sdhj
from sdhj import HJI, HopfLax, Projected
from sdhj.problem.samples import Samples
from sdhj.problem.sets import LARGEST
from sdhj.solver.joint import Joint
from sdhj.solver.recursion import GridSets
from sdhj.solving import METHODS, method_of

# ---- a method of one's own: exact on a ring of nodes where every velocity moves the state by whole nodes


class ShiftGames:
    """The games of an interval: under u_j the state moves by any number of nodes from `low` to `high`."""

    dtype, solved = "float32", 0

    def __init__(self, samples):
        delta = samples.problem.delta
        corners = np.array(samples.interval(0).displacement_boxes(0.0, delta)) / samples.grid.spacing[0]
        self.samples, self.moves = samples, np.rint(corners[..., 0]).astype(int)

    def highest(self, values, low, high):
        return np.max([np.roll(values, -move) for move in range(low, high + 1)], axis=0)

    def reach(self, values, step):
        for j, (low, high) in enumerate(zip(*self.moves, strict=True)):
            yield j, self.highest(values, low, high)

    def avoid(self, part, step):
        wall = -self.samples.sample(part, *self.samples.problem.span(step))
        tubes = [self.highest(wall, min(low, 0), max(high, 0)) for low, high in zip(*self.moves, strict=True)]
        return np.stack(tubes).astype(self.dtype)


@dataclass(frozen=True)
class Shift:
    """Exact shifts on a periodic axis."""

    name, options = "shift", {"exact": True}

    def on(self, samples):
        return ShiftGames(samples)

    def sets(self, problem, progress=None):
        if problem.grid.ndim != 1 or not problem.grid.periodic[0]:
            raise ValueError("shift needs one periodic axis")
        return GridSets(problem, self)


@pytest.mark.parametrize("rate", [0.0, 0.5])
def test_a_method_of_ones_own_solves_what_the_twin_does(rate):
    problem = zoo.ring(rate=rate)
    table, moves = sdhj.solve(problem, Shift(), progress=False), [(-5, -3), (-1, 1), (3, 5)]

    def highest(values, low, high):
        return np.array([max(values[(i + move) % 32] for move in range(low, high + 1)) for i in range(32)])

    rock = problem.unsafe[0]
    walls = [-Samples(problem).sample(rock, k, k + 1) for k in range(5)]
    avoid = [[highest(wall, min(low, 0), max(high, 0)) for low, high in moves] for wall in walls]
    tubes, marks = naive.recursion(
        [Samples(problem).goal(k) for k in range(6)],
        lambda values, k: [highest(values, *move) for move in moves],
        avoid,
    )
    for (k, n), expected in tubes.items():
        np.testing.assert_array_equal(table.values(start=k, within=n), expected.astype(np.float32))
        if n:
            own = np.stack([marks[k, n, j] for j in range(3)], axis=-1)
            np.testing.assert_array_equal(table.inputs(start=k, within=n), own)
    assert table.method == "shift" and table.details["exact"] is True and table.details["pdes_solved"] == 0
    assert table.fraction(start=0, within=5) > 2 * table.fraction(start=0, within=0)


@pytest.mark.parametrize("adversary", ["random", "worst"])
def test_it_is_controlled_and_simulated(adversary):
    """Sets with kinks at nodes, so that interpolation is exact as well: no run may fail."""
    controller = sdhj.Controller(sdhj.solve(zoo.ring(rate=0.5), Shift(), progress=False))
    report = sdhj.monte_carlo(controller, 500, adversary, progress=False)
    assert report.counts["reached"] == 500 and report.method == "shift", str(report)
    run = sdhj.simulate(controller, [7.2], adversary)
    assert run.outcome == "reached" and run.inputs[0] == 0


def test_its_table_is_saved_and_read(tmp_path):
    problem = zoo.ring()
    table = sdhj.solve(problem, Shift(), progress=False)
    table.save(tmp_path / "shift.npz")
    again = sdhj.load(tmp_path / "shift.npz", problem=problem)
    assert again.method == "shift" and again.details["exact"] is True
    np.testing.assert_array_equal(again.values(start=0, within=5), table.values(start=0, within=5))


def test_what_a_method_of_ones_own_refuses_reaches_the_user():
    with pytest.raises(ValueError, match="shift needs one periodic"):
        sdhj.solve(zoo.interval_problem(), Shift(), progress=False)


# ---- what is no method


class Nameless:
    def sets(self, problem, progress=None):
        raise AssertionError("solved all the same")


class Mute:
    name, sets = "mute", "many"


@pytest.mark.parametrize(
    ("method", "said"),
    [
        ("magic", "got 'magic'"),
        (["hji"], r"got \['hji'\]"),
        (HJI, "got <class '.*HJI'>"),
        (Nameless(), "got <.*Nameless object"),
        (Mute(), "got <.*Mute object"),
    ],
    ids=["unknown", "list", "class", "nameless", "mute"],
)
def test_what_is_no_method_is_refused_with_what_is_one(method, said):
    expected = rf"{', '.join(METHODS)}, .*"
    with pytest.raises(ValueError, match=expected + said):
        sdhj.solve(zoo.interval_problem(steps=1), method, progress=False)


def test_something_else_than_a_problem_is_named():
    with pytest.raises(ValueError, match="a ReachAvoidProblem, got None"):
        sdhj.solve(None)


# ---- short forms


def objects():
    return {"hji": HJI(), "lax": HopfLax(), "projected": Projected(), "certified": sdhj.Certified()}


def test_a_short_form_stands_for_the_object_with_its_usual_options():
    assert METHODS.keys() == objects().keys()
    for name, method in objects().items():
        assert method_of(name) == method and method_of(method) is method and method.name == name


def test_methods_of_equal_options_are_equal_and_cannot_change():
    assert HJI(sdhj.Scheme(order=3)) == HJI(sdhj.Scheme(order=3)) != HJI()
    assert Projected([[0, 1]]) == Projected(((0, 1),)) != Projected([[0, 2]])
    assert len({HopfLax(), HopfLax("limited"), HopfLax("linear")}) == 2
    for method in (HJI(), HopfLax(), Projected()):
        with pytest.raises(AttributeError):
            method.name = "mine"


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (
            lambda: HJI(order=9),
            r"belongs to scheme=sdhj.Scheme\(order=...\), where",
        ),
        (lambda: Projected(order=3), r"to scheme=sdhj.Scheme\(order=...\), in inner=sdhj.HJI\(...\)$"),
        (lambda: HopfLax(order=1), "options are interpolation, dtype$"),
        (lambda: Projected(scheme=3), r"belongs to inner=sdhj.HJI\(scheme=...\), where"),
        (lambda: sdhj.Certified(cell=[3]), "options are cells, parts"),
    ],
)
def test_an_option_that_is_not_there_says_where_it_is(make, says):
    with pytest.raises(TypeError, match=says):
        make()


MOVES = 0.5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1.0]])
SLOWED = lambda q, u: u - 0.1 * q  # noqa: E731


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "drift"),
    [
        (sdhj.HJI(), SLOWED),
        (sdhj.HJI(scheme=sdhj.Scheme(order=3, flux="lax-friedrichs")), SLOWED),
        (Joint(), SLOWED),
        (sdhj.HJI(), MOVES),
        (sdhj.HopfLax(), MOVES),
    ],
    ids=["differences", "third order", "joint", "frame", "lax"],
)
def test_tubes_hang_on_no_magnitude_of_level_sets(method: object, drift: object, monkeypatch) -> None:
    """Bit for bit up to the largest that is supported, steep inside; overflow, not rounding, is what limits it."""
    plain = getattr(method, "games", "") == "joint" or getattr(method, "scheme", sdhj.Scheme()).order == 3
    if plain:  # what nothing else compiles
        run_plainly(monkeypatch)

    def tubes(scale: float) -> np.ndarray:
        post = sdhj.UnsafeSet((0, 1), lambda p, t: scale * (np.hypot(p[:, 0] + 1, p[:, 1]) - 0.4), sampling="steep")
        problem = zoo.plane(
            MOVES,
            drift=drift,
            bounds=[0.03, 0.3],
            nodes=9 if plain else 21,
            ends="wall",
            target=sdhj.TargetSet((0, 1), lambda p, t: scale * (np.hypot(p[:, 0] - 1, p[:, 1] - 0.8) - 0.6)),
            unsafe=[post],
            delta=0.25,
        )
        return np.asarray(sdhj.solve(problem, method, play=False, progress=False).tubes, np.float64)

    usual, most = tubes(1.0), 2.0 ** int(np.log2(LARGEST / 4))  # values up to 3.6
    np.testing.assert_array_equal(tubes(most), usual * most)
    with pytest.raises(ValueError, match=r"supports at most 1e\+36"):
        tubes(2 * most)
