"""Functions that cannot be read: proofs rest on what is declared of them, and ask for what is not."""

import dataclasses
import itertools

import naive_certified as naive
import numpy as np
import pytest
import zoo
from zoo import interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj.certified.bounds import Bounds


def certified(problem, **options):
    return sdhj.solve(problem, sdhj.Certified(**options), progress=False)


def opaque(part, **declared):
    """The same set, of a function that nobody can look into."""
    function = part.level_set
    return dataclasses.replace(part, level_set=sdhj.BlackBox(lambda points, t: function(points, t), **declared))


def with_wall(**declared):
    problem = interval_problem(view_time="sampled")  # which asks for no rate; proofs count every time
    return dataclasses.replace(problem, unsafe=[opaque(part, **declared) for part in problem.unsafe])


def with_drift(**declared):
    """dq = u: an array as a black box."""
    drift = sdhj.BlackBox(lambda q, u, t: u + 0.0 * q, **declared)
    dynamics = sdhj.Dynamics([[-1.0], [0.0], [1.0]], drift, [[1.0]], [0.2])
    return dataclasses.replace(interval_problem(), dynamics=dynamics)


def with_gain(**declared):
    gain = sdhj.BlackBox(lambda q, u, t: np.ones((len(q), 1, 1)), **declared)
    dynamics = sdhj.Dynamics([[-1.0], [0.0], [1.0]], [[-1.0], [0.0], [1.0]], gain, [0.2])
    return dataclasses.replace(interval_problem(), dynamics=dynamics)


def test_nothing_is_asked_for_where_functions_can_be_read():
    assert certified(interval_problem(), cells=[80]).fraction(start=0, within=5) > 0.5


BUILDERS = {"level set of 'wall'": with_wall, "drift": with_drift, "gain": with_gain}
ENCLOSURES = {
    "level set of 'wall'": lambda low, high, t0, t1: (3.0 - high[:, 0], 3.0 - low[:, 0]),
    "drift": lambda low, high, u, t0, t1: (u + 0.0 * low, u + 0.0 * high),
    "gain": lambda low, high, u, t0, t1: (np.ones((len(low), 1, 1)),) * 2,
}


@pytest.mark.parametrize("name", BUILDERS)
def test_what_a_proof_needs_is_asked_for(name):
    for declared, told in (({}, "a slope"), ({"rate": 0.0}, "a slope"), ({"slope": 1.0}, "a rate")):
        with pytest.raises(ValueError, match=f"{name} is a BlackBox without {told} or an enclosure, which a proof"):
            certified(BUILDERS[name](**declared), cells=[40])


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILDERS)
def test_what_is_declared_truly_proves_the_same_or_nearly(name):
    """What is linear or constant costs a layer of cells in each step at most; a slope that is too steep costs more."""
    true = certified(interval_problem(), cells=[400]).bits(start=0, within=5)
    slope, steep = (1.0, 300.0) if name.startswith("level") else (0.0, 40.0)
    for declared in ({"enclosure": ENCLOSURES[name], "rate": 0.0}, {"slope": slope, "rate": 0.0}):
        found = certified(BUILDERS[name](**declared), cells=[400]).bits(start=0, within=5)
        found = found[1:-1] if len(found) > 400 else found  # a box may read the state, and has layers at walls
        assert not (found & ~true).any() and (true & ~found).sum() <= 10
    worse = certified(BUILDERS[name](slope=steep, rate=0.0), cells=[400]).bits(start=0, within=5)
    assert worse.any() and worse.sum() < found.sum()


def test_a_box_of_which_it_is_not_declared_that_it_stands_still_is_asked_at_every_step():
    problem = interval_problem(steps=3)
    tables = [
        certified(dataclasses.replace(problem, target=opaque(problem.target, slope=1.0, rate=rate)), cells=[80])
        for rate in (0.0, 0.001)
    ]
    assert [len(table.index) for table in tables] == [4, 10]
    for start in range(4):
        still, moving = (table.bits(start=start, within=2) for table in tables)
        assert moving.any() and not (moving & ~still).any()


def test_slopes_bound_every_kind_of_change(rng):
    """One number for all ways, one for each coordinate, a matrix; none is worth more than it says."""
    low = rng.uniform(-1, 1, (300, 2))
    high = low + rng.uniform(0, 0.3, (300, 2))
    problem = torus_problem()

    def flat(points, t):
        return 2.0 * points[:, 0] - points[:, 1] + np.sin(3.0 * t)

    for slope in (np.sqrt(5.0), (2.0, 1.0)):
        part = sdhj.UnsafeSet((0, 1), sdhj.BlackBox(flat, slope=slope, rate=3.0))
        least, most = Bounds(problem).bounds_of_level_set(part, low, high, 0.1, 0.4)
        values = np.array([flat(low + (high - low) * share, t) for share, t in corners(rng)])
        assert (least <= values).all() and (values <= most).all()
        exact = (high - low) @ [2.0, 1.0] + 0.9
        widths = (most - least) / exact
        assert (widths >= 1.0).all() and widths.max() < (1.0001 if np.ndim(slope) else 1.8)

    def bent(points, u, t):
        return np.stack([np.sin(points[:, 1]) + 0.5 * t, u[0] * points[:, 0]], axis=1)

    drift = sdhj.BlackBox(bent, slope=[[0.0, 1.0], [2.0, 0.0]], rate=[0.5, 0.0])
    dynamics = sdhj.Dynamics([[2.0, 0.0]], drift, np.eye(2), [0.1, 0.2])
    least, most = Bounds(dataclasses.replace(problem, dynamics=dynamics)).velocity(0, low, high, 0.1, 0.4)
    for share, t in corners(rng):
        for push in itertools.product((-0.1, 0.1), (-0.2, 0.2)):
            velocity = bent(low + (high - low) * share, [2.0, 0.0], t) + push
            assert (least <= velocity).all() and (velocity <= most).all()
    assert (
        most - least <= np.stack([0.2 + 0.15 + high[:, 1] - low[:, 1], 0.4 + 2 * (high - low)[:, 0]]).T + 1e-6
    ).all()


def corners(rng):
    """Places in a box, as shares of its sides, and times."""
    return [
        *((np.array(share), t) for share in itertools.product((0.0, 1.0), repeat=2) for t in (0.1, 0.4)),
        *((rng.random(2), rng.uniform(0.1, 0.4)) for _ in range(30)),
    ]


def test_a_gain_that_depends_on_the_state_counts_in_full():
    """x v with |v| <= 0.1: from boxes about 2 the adversary moves the state at 0.2 or a little more."""
    problem = interval_problem()
    gain = sdhj.BlackBox(lambda q, u, t: q[:, :, None], slope=1.0, rate=0.0)
    low = np.array([[2.0], [-3.0]])
    for given in (gain, lambda q: q[:, :, None]):
        dynamics = sdhj.Dynamics([[0.0]], lambda q, u: 0.0 * q, given, [0.1])
        least, most = Bounds(dataclasses.replace(problem, dynamics=dynamics)).velocity(0, low, low + 0.5, 0.0, 0.0)
        np.testing.assert_allclose(most[:, 0], [0.25, 0.3], atol=1e-8)
        np.testing.assert_allclose(least[:, 0], [-0.25, -0.3], atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["level set", "velocity"])
def test_a_function_may_jump_at_the_seam(part, rng):
    """A set written for angles as plain numbers ends where the axis closes; tubes reach across, and are cut there."""
    jump = part == "level set"
    problem = zoo.line(
        (-1.0, 1.0),
        0.1,
        drift=lambda q, u: u + (0 if jump else 0.1) * q,
        gain=lambda q: np.ones((len(q), 1, 1)),
        lower=[-np.pi],
        upper=[np.pi],
        nodes=40,
        periodic=[True],
        unsafe=[sdhj.UnsafeSet((0,), lambda q, t: np.abs(q[:, 0] - (2.9 if jump else 0.0)) - 0.2 + 3.0 * (not jump))],
        delta=0.2,
        steps=6,
    )
    drift = sdhj.BlackBox(lambda q, u, t: u + (0 if jump else 0.1) * q, slope=0.1, rate=0.0)
    boxed = dataclasses.replace(
        problem,
        dynamics=sdhj.Dynamics([[-1.0], [1.0]], drift, [[1.0]], [0.1]),
        target=opaque(problem.target, slope=1.0, rate=0.0),
        unsafe=[opaque(problem.unsafe[0], slope=1.0, rate=0.0)],
    )
    for given in (problem, boxed):
        table = certified(given, cells=[100])
        assert table.fraction(start=0, within=6) > 1.5 * table.fraction(start=0, within=0)
        if jump:  # from the far side of the disk both ways lead through it or are too long
            assert not table.contains([[2.9], [2.75]], start=0, within=6).any()
        naive.assert_runs_succeed(table, naive.states_in(table, rng, 2000), rng)


def test_a_box_across_the_seam_has_values_of_both_sides():
    problem = torus_problem()
    part = sdhj.UnsafeSet((1,), lambda q, t: -q[:, 0])
    for each in (part, opaque(part, slope=1.0, rate=0.0)):
        least, most = Bounds(problem).bounds_of_level_set(each, np.array([[3.0]]), np.array([[3.5]]), 0.0, 0.0)
        np.testing.assert_allclose([least[0], most[0]], [-np.pi, np.pi], rtol=1e-8)


def test_two_sets_of_one_name_are_two_sets():
    problem = interval_problem(steps=1)
    steep = sdhj.UnsafeSet((0,), lambda p, t: 5.0 * (3.5 + p[:, 0]), name="wall")
    both = dataclasses.replace(problem, unsafe=(*problem.unsafe, steep))
    table = certified(both, cells=[80])
    assert table.contains([[0.0]], start=0, within=1)
    lines = [certified(dataclasses.replace(both, unsafe=(part,)), cells=[80]) for part in both.unsafe]
    each = [one.bits(start=0, within=1) for one in lines]
    assert np.array_equal(table.bits(start=0, within=1), each[0] & each[1])


def test_black_boxes_are_named():
    problem = unicycle_problem()
    assert not problem.opaque
    pillar = opaque(problem.unsafe[0], slope=1.0, rate=0.0)
    assert list(dataclasses.replace(problem, unsafe=[pillar]).opaque) == ["unsafe 0"]
