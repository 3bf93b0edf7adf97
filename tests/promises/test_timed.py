"""Drift, gain and bounds that depend on time and on the input, from the games to the closed loop.

On one axis dx = f(u, t) + b(u, t) v with |v| <= c(u, t) the sets are intervals, which the slow twin works out in plain
arithmetic; on a torus whose boxes end at nodes the formula is exact; and a game on two axes whose field turns is, in a
frame that turns along, one on a single axis. Closed loops are judged without the library (`judge`).
"""

from dataclasses import dataclass, replace
from functools import cache

import judge
import naive
import numpy as np
import pytest
import zoo
from parameters import but_slow

import sdhj
from sdhj import HJI, BlackBox, HopfLax, TargetSet, UnsafeSet
from sdhj.problem.samples import Samples
from sdhj.solver.joint import Joint

ADVERSARIES = ("switching", "exact")  # exact: knows the twin's tubes, and leaves as little as it can


@dataclass(frozen=True)
class Case:
    """A game on one axis: functions of (u, t) written once for the library, the twin and the judge.

    The target is |x - centre(t)| <= radius; x >= wall + rate t is unsafe.
    """

    inputs: tuple[float, ...]
    drift: object
    gain: object
    bound: object
    centre: object
    radius: float
    wall: float
    delta: float
    steps: int
    rate: float = 0.0
    timed: bool = True

    def speed(self, u, t, sign):
        """dx of the adversary that pushes as hard as it can, up or down."""
        return self.drift(u, t) + sign * abs(self.gain(u, t)) * self.bound(u, t)

    def problem(self):
        functions = (
            lambda q, u, t: [self.drift(u[0], t)],
            lambda q, u, t: [[self.gain(u[0], t)]],
            lambda q, u, t: [self.bound(u[0], t)],
        )
        if not self.timed:
            functions = [lambda q, u, function=function: function(q, u, 0.0) for function in functions]
        target = TargetSet((0,), lambda p, t: np.abs(p[:, 0] - self.centre(t)) - self.radius)
        wall = UnsafeSet((0,), lambda p, t: self.wall + self.rate * t - p[:, 0], name="wall")
        return zoo.line(
            self.inputs,
            nodes=25 if self.timed else 97,  # where time matters a game takes many more steps
            **dict(zip(("drift", "gain", "bounds"), functions, strict=True)),
            target=target,
            unsafe=(wall,),
            delta=self.delta,
            steps=self.steps,
            view_time="instantaneous",
        )

    def travels(self, begin, end, parts):
        """Displacements under each input at several times, the adversary down and up: (2, L, parts + 1)."""
        rates = [[lambda t, u=u, sign=sign: self.speed(u, t, sign) for u in self.inputs] for sign in (-1, 1)]
        return np.array([[naive.displacements(rate, begin, end, parts) for rate in row] for row in rates])

    def walls(self, begin, end, parts):
        return self.wall + self.rate * np.linspace(begin, end, parts + 1)

    def exact(self, parts=1000):
        """(tubes, marked) of the slow twin."""
        times, centres = (
            [k * self.delta for k in range(self.steps)],
            [self.centre(k * self.delta) for k in range(self.steps + 1)],
        )
        moves = [self.travels(t, t + self.delta, parts).tolist() for t in times]
        walls = [self.walls(t, t + self.delta, parts).tolist() for t in times]
        goals = [[(centre - self.radius, centre + self.radius)] for centre in centres]
        return naive.interval_game(goals, [low for low, _ in moves], [high for _, high in moves], walls)


CASES = {
    # the faster, the less certain: the target is too narrow to be hit at full speed
    "slip": Case(
        inputs=(-2.0, -1.0, 0.0, 1.0, 2.0),
        drift=lambda u, t: u,
        gain=lambda u, t: 1.0,
        bound=lambda u, t: 0.05 + 0.2 * u**2,
        centre=lambda t: 0.0,
        radius=0.4,
        wall=2.5,
        delta=0.5,
        steps=4,
        timed=False,
    ),
    # a current that turns within an interval and is faster than the robot, the target drifting
    "tide": Case(
        inputs=(-1.0, 0.0, 1.0),
        drift=lambda u, t: u + 2.0 * np.sin(4.0 * t),
        gain=lambda u, t: 1.0 + 0.5 * np.cos(3.0 * t),
        bound=lambda u, t: 0.15,
        centre=lambda t: 0.3 * t,
        radius=0.7,
        wall=2.0,
        delta=0.6,
        steps=4,
    ),
    # everything at once, stronger gusts as time goes on, and a wall that comes in
    "gusts": Case(
        inputs=(-1.5, 0.0, 1.0),
        drift=lambda u, t: u * (1.0 + 0.2 * np.sin(5.0 * t)) - 0.2,
        gain=lambda u, t: 1.0 + 0.1 * u,
        bound=lambda u, t: 0.05 + 0.2 * abs(u) * t + 0.1 * t**2,
        centre=lambda t: -0.5,
        radius=0.8,
        wall=2.2,
        delta=0.4,
        steps=5,
        rate=-0.5,
    ),
    # a storm that passes: what the adversary may do at the start of an interval it may not at its end
    "calming": Case(
        inputs=(-1.0, -0.5, 0.0, 0.5, 1.0),
        drift=lambda u, t: u,
        gain=lambda u, t: 1.0 - 0.2 * u,
        bound=lambda u, t: 0.05 + 0.8 * np.exp(-2.0 * t),
        centre=lambda t: 0.1,
        radius=0.45,
        wall=1.5,
        delta=0.5,
        steps=4,
    ),
}
METHODS = {
    "hji": HJI(),
    "joint": Joint(),
    "lax": HopfLax("linear"),
    "limited": HopfLax(),
}


@cache
def exact(name):
    return CASES[name].exact()


@cache
def table(name, method):
    return sdhj.solve(CASES[name].problem(), METHODS[method], progress=False)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", but_slow(CASES, "tide", "gusts", "calming"))
def test_tubes_and_marks_are_the_intervals_of_the_twin(name, method):
    found, (tubes, marked) = table(name, method), exact(name)
    grid, worst = found.grid, 0.0
    nodes, count = grid.nodes(0), len(CASES[name].inputs)
    # the formula is exact for distances; differences spread their kinks over some cells
    tolerance = {"hji": 0.5, "joint": 1.0}.get(method, 0.05) * grid.spacing[0]
    for (k, n), intervals in tubes.items():
        inside = found.values(start=k, within=n) <= 0
        marks = found.inputs(start=k, within=n)
        sets = [(intervals, inside)] + [(marked[k, n, j], marks[:, j]) for j in range(count) if n]
        for its, own in sets:
            depths = np.array([naive.depth(its, x) for x in nodes])
            wrong = own != (depths > 0)
            worst = max(worst, np.abs(depths[wrong]).max(initial=0.0, where=np.isfinite(depths[wrong])))
            assert not own[depths < -tolerance].any(), (k, n)
            assert own[depths > tolerance].all(), (k, n)
    print(f"{name}, {method}: nodes are wrong up to {worst / grid.spacing[0]:.2f} cells from the boundary")
    assert len(tubes) == (found.steps + 1) * (found.steps + 2) // 2


@pytest.mark.parametrize("name", ["slip", "tide"])
def test_the_table_tells_how_many_equations_were_asked_for_and_solved(name):
    """Where time matters the avoid games are different ones in every interval; where not, so are no two rows."""
    case, details = CASES[name], table(name, "hji").details
    count, rows = len(case.inputs), case.steps * (case.steps + 1) // 2
    assert details["pdes_of_algorithm"] == count * (rows + (case.steps if case.timed else 1))
    different = rows + case.steps if case.timed else case.steps + 1
    assert details["pdes_solved"] == count * (different - details["tubes_shared"])


def as_if(name, **parts):
    """The table of someone who takes some of a case's functions for others."""
    return sdhj.solve(replace(CASES[name], **parts).problem(), METHODS["lax"], progress=False)


def test_fast_inputs_that_slip_serve_from_afar_only():
    """What the twin says of "slip", seen in the table: u = 2 reaches the first tube, never the target itself."""
    found, sure = table("slip", "lax"), as_if("slip", bound=lambda u, t: 0.05)
    fast = [found.inputs(start=0, within=n)[:, [0, 4]].any() for n in range(5)]
    assert fast == [False, False, True, True, True]
    assert sure.inputs(start=0, within=1)[:, [0, 4]].any()
    assert sure.fraction(start=0, within=4) > found.fraction(start=0, within=4) + 0.05


# ---- the controller looks ahead from its own step


@pytest.mark.parametrize("name", ["slip", "tide", "gusts"])
def test_margins_are_those_of_the_boxes_of_that_step(name, rng):
    """The worst interpolated value over all ends of the interval, by the twin's displacements."""
    case, found = CASES[name], table(name, "lax")
    controller, nodes, seen = sdhj.Controller(found), found.grid.nodes(0), 0
    for step in range(case.steps):
        low, high = case.travels(step * case.delta, (step + 1) * case.delta, 100)[..., -1]
        batch = controller.batch(rng.uniform(-2.5, 2.5, (25, 1)), step)
        for x, to_go, safe, margins in zip(
            batch.states[:, 0], batch.steps_to_go, batch.safe, batch.margins, strict=True
        ):
            if not safe.any() or margins[safe].min() > 0:
                continue  # not admissible, or nothing is promised
            line, seen = found.values(start=step + 1, within=max(to_go, 1) - 1), seen + 1
            for j, margin in enumerate(margins):
                ends = [x + low[j], x + high[j]]
                reached = [*ends, *nodes[(nodes > ends[0]) & (nodes < ends[1])]]
                assert margin == pytest.approx(np.interp(reached, nodes, line).max(), abs=1e-9), (step, x, j)
    assert seen > 25


@pytest.mark.parametrize("name", ["tide", "gusts"])
def test_rules_see_where_inputs_lead_from_that_step(name, rng):
    case = CASES[name]
    controller, differ = sdhj.Controller(table(name, "lax"), "target"), 0
    for step in range(case.steps):
        middle, centre = (step + 0.5) * case.delta, case.centre((step + 1) * case.delta)
        batch = controller.batch(rng.uniform(-2.5, 2.5, (200, 1)), step)
        chosen = controller.choose(batch)
        moves = case.delta * np.array([case.drift(u, middle) for u in case.inputs])
        distances = np.where(batch.safe, np.abs(batch.states + moves - centre), np.inf)
        known = batch.safe.any(axis=1)
        assert (chosen[known] >= 0).all()
        np.testing.assert_array_equal(chosen[known], np.argmin(distances, axis=1)[known])
        differ += (batch.safe[known].sum(axis=1) > 1).sum()
    assert differ > 20


# ---- closed loops, judged by plain functions


def velocity_of(case):
    def velocity(states, inputs, signs, t):
        middle, most = (np.array([case.speed(u, t, sign) for u in case.inputs])[inputs] for sign in (0, 1))
        return (middle + (most - middle) * signs[:, 0])[:, None]

    return velocity


def pushes(name, adversary, rng):
    """signs(states, inputs, t, end) of one of ADVERSARIES."""
    case, (tubes, _) = CASES[name], exact(name)

    def signs(states, inputs, t, end):
        if adversary == "switching":
            return rng.choice([-1.0, 1.0], states.shape)
        x, step = states[:, 0], round(end / case.delta)
        (down, up), later = case.travels(t, end, 10)[:, inputs], tubes[step, case.steps - step]
        hits = (x[:, None] + up >= case.walls(t, end, 10)).any(axis=1)
        depths = [np.array([naive.depth(later, q) for q in x + moves[:, -1]]) for moves in (down, up)]
        return np.where(hits | (depths[1] < depths[0]), 1.0, -1.0)[:, None]

    return signs


def judged(name, controller, adversary, starts, rng):
    case = CASES[name]
    return judge.play(
        lambda states, step: controller.choose(controller.batch(states, step)),
        velocity_of(case),
        pushes(name, adversary, rng),
        lambda states, t: np.abs(states[:, 0] - case.centre(t)) - case.radius,
        lambda states, t: case.wall + case.rate * t - states[:, 0],
        np.array(starts)[:, None],
        delta=case.delta,
        steps=case.steps,
    )


@pytest.mark.parametrize("adversary", ADVERSARIES)
@pytest.mark.parametrize("name", CASES)
def test_no_run_from_within_the_exact_tube_is_lost(name, adversary, rng):
    """Starts everywhere in the twin's tube but for a cell at its boundary, which the table knows by interpolation."""
    tubes, _ = exact(name)
    cell = table(name, "hji").grid.spacing[0]
    starts = [x for x in rng.uniform(-4, 4, 1000) if naive.depth(tubes[0, CASES[name].steps], x) > cell]
    for method in METHODS if name == "slip" else METHODS.keys() - {"joint"}:
        outcomes = judged(name, sdhj.Controller(table(name, method)), adversary, starts, rng)
        assert (outcomes == "reached").all(), (method, np.array(starts)[outcomes != "reached"], outcomes)
    assert len(starts) > 200


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tide", "gusts"])
def test_who_ignores_time_is_lost(name, rng):
    """From states that the table of someone who freezes the field at t = 0 calls sure, the adversary wins every run.

    The twin's tubes prove it: outside of them the adversary can stay outside of the next, whatever the input. There the
    table that knows of time makes no promise, and where it makes one no run is lost.
    """
    case, (tubes, _) = CASES[name], exact(name)
    wrong = as_if(name, timed=False)
    right, cell = table(name, "lax"), wrong.grid.spacing[0]
    states = rng.uniform(-4, 4, 4000)
    outside = np.array([naive.depth(tubes[0, case.steps], x) for x in states]) < -cell
    fooled = wrong.contains(states[:, None], start=0, within=case.steps) & outside
    assert fooled.mean() > 0.03 and not right.contains(states[fooled, None], start=0, within=case.steps).any()
    outcomes = judged(name, sdhj.Controller(wrong), "exact", states[fooled], rng)
    assert not (outcomes == "reached").any()
    print(f"{name}: {fooled.mean():.1%} of the axis called sure and lost every time")


@pytest.mark.parametrize("name", ["tide", "gusts"])
@pytest.mark.parametrize("adversary", ["random", "worst", "aggressive"])
def test_the_librarys_own_plant_and_adversaries_agree(name, adversary):
    controller = sdhj.Controller(table(name, "lax"))
    report = sdhj.monte_carlo(controller, 500, adversary, progress=False)
    assert report.counts["reached"] == 500, str(report)
    assert np.abs(report.starts).max() <= 4.0


# ---- two axes


@pytest.mark.parametrize("first", [0, 2])
def test_time_steps_are_as_many_as_the_speeds_of_their_own_interval_ask_for(first):
    """dx = u (1 + 2 t) + v: at most 2.12, 3.12 and 4.12 m/s, by .75 of a cell of 0.2 m, in whatever order."""
    inputs = np.array([[-1.0], [1.0]])
    dynamics = sdhj.Dynamics(inputs, lambda q, u, t: u * (1.0 + 2.0 * t) + 0.0 * q, [[1.0]], [0.12])
    problem = zoo.line(dynamics=dynamics, unsafe=[zoo.post(3.0, 0.5)], nodes=41)
    games, order = sdhj.HJI().on(Samples(problem)), [first, 1, 2 - first]
    assert [games.steps((0,), step) for step in order] == [int(np.ceil((2.12 + k) * 0.5 / 0.15)) for k in order]
    tables = [sdhj.solve(problem, method, progress=False, play=False) for method in ("hji", "lax")]
    for step in range(3):
        shares = [one.fraction(start=step, within=1) for one in tables]
        assert abs(shares[0] - shares[1]) < 0.03 and shares[0] > tables[0].fraction(start=step, within=0)


def lattice_problem(seed=4):
    """A torus of 9 x 11 nodes with target values drawn for each step; every box of displacements ends at nodes."""
    values, shape = np.random.default_rng(seed).normal(size=(4, 9, 11)), (9, 11)

    def target(points, t):
        index = np.rint(points).astype(int) % shape
        return values[round(t)][tuple(index.T)]

    problem = zoo.plane(
        [[-1.0], [0.0], [1.0]],
        drift=lambda q, u, t: [u[0] * (0.5 + t), 2 * t - 1],
        gain=lambda q, u: np.diag([abs(u[0]), 1.0]),
        bounds=lambda t: [1.0, 0.5 + t],
        lower=[0.0, 0.0],
        upper=[9.0, 11.0],
        nodes=shape,
        periodic=[True, True],
        target=TargetSet((0, 1), BlackBox(target)),
        delta=1.0,
    )
    return problem, values


def test_boxes_that_end_at_nodes_make_the_exact_game_on_a_torus():
    """Every whole displacement tried: by k + 1 nodes and one more or less along x, by 2 k and k + 1 along y."""
    problem, values = lattice_problem()
    low = [[(u * (k + 1) - abs(u), 2 * k - (k + 1)) for u in (-1, 0, 1)] for k in range(3)]
    high = [[(u * (k + 1) + abs(u), 2 * k + (k + 1)) for u in (-1, 0, 1)] for k in range(3)]
    tubes = naive.lattice_game(list(values), low, high)
    tables = [sdhj.solve(problem, HopfLax(interpolation), progress=False) for interpolation in ("linear", "limited")]
    for (k, n), expected in tubes.items():
        for table in tables:
            np.testing.assert_allclose(table.values(start=k, within=n), expected, rtol=0, atol=1e-5)  # single precision
    assert (tubes[0, 3] < tubes[0, 2]).any() and (tubes[0, 1] < tubes[0, 0]).any()


class Turning:
    """dx = w(t) J x + e(t) (f(u, t) + b(u, t) v) on two axes, e turning at the rate w(t) = 0.8 + t / 2.

    Along e the state moves as in `game`, across it not at all: the tubes are those of `game` times an interval.
    """

    game = Case(
        inputs=(-1.0, 0.0, 1.0),
        drift=lambda u, t: u * (1.0 + 0.3 * np.sin(5.0 * t)),
        gain=lambda u, t: 1.0 + 0.2 * t,
        bound=lambda u, t: 0.1 + 0.15 * abs(u),
        centre=lambda t: 0.2 * t,
        radius=0.5,
        wall=99.0,
        delta=0.4,
        steps=3,
    )
    half_width = 0.6

    @staticmethod
    def frame(t):
        """e(t) and the direction across."""
        angle = 0.8 * t + t**2 / 4
        return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])

    @classmethod
    def field(cls, points, push, t):
        turned = np.stack([-points[:, 1], points[:, 0]], axis=1)
        return (0.8 + t / 2) * turned + np.asarray(push).reshape(-1, 1) * cls.frame(t)[0]

    @classmethod
    def target(cls, points, t):
        along, across = (points @ direction for direction in cls.frame(t))
        return np.maximum(np.abs(along - cls.game.centre(t)) - cls.game.radius, np.abs(across) - cls.half_width)

    @classmethod
    def problem(cls, nodes):
        game = cls.game
        return zoo.plane(
            [[u] for u in game.inputs],
            drift=lambda points, u, t: cls.field(points, game.drift(u[0], t), t),
            gain=lambda q, u, t: game.gain(u[0], t) * cls.frame(t)[0][:, None],
            bounds=lambda q, u: [game.bound(u[0], 0.0)],
            lower=[-2.5, -2.5],
            upper=[2.5, 2.5],
            nodes=nodes,
            target=TargetSet((0, 1), cls.target),
            delta=game.delta,
            steps=game.steps,
        )

    @classmethod
    def depths(cls, intervals, points, t):
        along, across = (points @ direction for direction in cls.frame(t))
        return np.minimum([naive.depth(intervals, x) for x in along], cls.half_width - np.abs(across))


@cache
def turning_table(nodes):
    return sdhj.solve(Turning.problem(nodes), progress=False)


@pytest.mark.slow
def test_a_turning_game_is_the_one_along_a_turning_axis():
    tubes, _ = Turning.game.exact()
    wrong = []
    for nodes in (25, 49):
        table, deepest, share = turning_table(nodes), 0.0, 0.0
        points = table.grid.points()
        for (k, n), intervals in tubes.items():
            inside = (table.values(start=k, within=n) <= 0).ravel()
            depths = Turning.depths(intervals, points, k * Turning.game.delta)
            differ = inside != (depths > 0)
            deepest, share = max(deepest, np.abs(depths[differ]).max(initial=0.0)), share + differ.mean() / len(tubes)
        print(f"{nodes} nodes: {share:.2%} of the nodes are wrong, up to {deepest / table.grid.spacing[0]:.2f} cells")
        wrong.append((deepest, share, table.grid.spacing[0]))
    assert max(deepest / cell for deepest, _, cell in wrong) < 1.0
    assert wrong[1][1] < wrong[0][1] / 1.4


@pytest.mark.slow
@pytest.mark.parametrize("adversary", ["switching", "away"])
def test_no_run_of_the_turning_game_is_lost(adversary, rng):
    game, table = Turning.game, turning_table(25)
    tubes, controller = Turning.game.exact()[0], sdhj.Controller(table)
    starts = rng.uniform(-2.5, 2.5, (8000, 2))
    starts = starts[Turning.depths(tubes[0, game.steps], starts, 0.0) > table.grid.spacing[0]]

    def signs(states, inputs, t, end):
        if adversary == "switching":
            return rng.choice([-1.0, 1.0], (len(states), 1))
        outward = np.where(states @ Turning.frame(t)[0] > game.centre(end), 1.0, -1.0)
        return outward[:, None]

    def velocity(states, inputs, signs, t):
        return Turning.field(states, velocity_of(game)(states, inputs, signs, t), t)

    outcomes = judge.play(
        lambda states, step: controller.choose(controller.batch(states, step)),
        velocity,
        signs,
        Turning.target,
        lambda states, t: np.full(len(states), np.inf),
        starts,
        delta=game.delta,
        steps=game.steps,
    )
    told = {outcome: int((outcomes == outcome).sum()) for outcome in np.unique(outcomes)}
    print(adversary, len(starts), told)
    assert len(starts) > 400 and set(told) == {"reached"}
