"""Grids and problems: interpolation, what sets are over a time and along a path, functions of all kinds."""

import dataclasses
import inspect
import itertools

import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from zoo import interval_problem, line, plane, post

from sdhj import (
    BlackBox,
    Controller,
    Grid,
    TargetSet,
    UnsafeSet,
    monte_carlo,
    simulate,
    solve,
)
from sdhj.problem.samples import Samples


@given(seed=st.integers(0, 2**32 - 1), ndim=st.integers(1, 4))
@pytest.mark.slow
def test_interpolation_equals_the_slow_twin(seed, ndim):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(5, 8, size=ndim).tolist())
    periodic = tuple(rng.random(ndim) < 0.5)
    grid = Grid([-1.0] * ndim, [2.0] * ndim, shape, periodic)
    values = rng.normal(size=shape)
    points = rng.uniform(-1, 2, size=(5, ndim)) + np.where(periodic, rng.integers(-2, 3, size=(5, ndim)) * 3.0, 0.0)
    expected = [naive.interpolate(values, grid.lower, grid.spacing, periodic, p) for p in points]
    np.testing.assert_allclose(grid.interpolate(values, points), expected, rtol=0, atol=1e-9)


def test_interpolation_reproduces_nodes_and_multilinear_functions(rng):
    grid = Grid([0.0, -1.0, 2.0], [1.0, 1.0, 5.0], (5, 6, 7))
    x, y, z = grid.points().T

    def f(x, y, z):
        return 1 + 2 * x - y + 0.5 * z + x * y - 3 * x * y * z

    values = f(x, y, z).reshape(grid.shape)
    assert np.allclose(grid.interpolate(values, grid.points()), values.ravel(), rtol=0, atol=1e-12)
    points = rng.uniform([0, -1, 2], [1, 1, 5], size=(100, 3))
    assert np.allclose(grid.interpolate(values, points), f(*points.T), rtol=0, atol=1e-12)


def test_off_the_grid_is_outside_every_set():
    grid = Grid([0.0, 0.0], [1.0, 1.0], (5, 5), (True, False))
    values = -np.ones((5, 5))
    points = [[7.3, 0.5], [0.5, 1.01], [0.5, -0.01], [np.nan, 0.5], [0.5, np.nan], [np.inf, 0.5]]
    assert grid.interpolate(values, np.array(points)).tolist() == [-1.0] + [np.inf] * 5
    with pytest.raises(ValueError, match=r"\(M, 2\)"):
        grid.interpolate(values, np.zeros(2))


def test_volume_weights_sum_to_one_and_halve_the_ends():
    grid = Grid([0.0, 0.0], [1.0, 1.0], (5, 8), (False, True))
    each = np.array([grid.fraction(np.arange(40).reshape(5, 8) == node) for node in range(40)]).reshape(5, 8)
    assert each.sum() == pytest.approx(1.0)
    assert np.allclose(each[0] * 2, each[1]) and np.allclose(each[0], each[4]) and np.allclose(each[1], each[2])
    assert grid.fraction(np.ones((5, 8), bool)) == pytest.approx(1.0)


def test_subgrid_and_lift():
    grid = Grid([0, 1, 2], [3, 4, 5], (5, 6, 7), (True, False, True), ["a", "b", "c"])
    sub = grid.subgrid((0, 2))
    assert (sub.shape, sub.lower, sub.periodic, sub.names) == ((5, 7), (0.0, 2.0), (True, True), ("a", "c"))
    assert grid.lift(np.zeros((5, 7)), (0, 2)).shape == (5, 1, 7)


def test_whole_numbers_may_come_as_floats():
    problem = dataclasses.replace(interval_problem(), steps=2.0)
    assert problem.steps == 2 and isinstance(problem.steps, int)


@pytest.mark.slow
def test_functions_see_periodic_coordinates_on_the_grid_only(rng):
    """A run is followed beyond the ends of a periodic axis; the user's functions, here black boxes, never are."""
    grid = Grid([-np.pi, 0.0], [np.pi, 1.0], (64, 9), (True, False))

    def on_the_grid(points):
        assert (points[:, 0] >= -np.pi).all() and (points[:, 0] < np.pi).all()
        return points

    problem = plane(
        [[-2.0], [2.0]],
        drift=BlackBox(lambda p, u, t: np.stack([u[0] + 0 * on_the_grid(p)[:, 0], 0 * p[:, 0]], axis=1), rate=0.0),
        gain=BlackBox(lambda p, u, t: np.broadcast_to([[1.0], [0.0]], (len(on_the_grid(p)), 2, 1)), rate=0.0),
        bounds=[0.1],
        grid=grid,
        target=TargetSet((0,), BlackBox(lambda p, t: np.abs(on_the_grid(p)[:, 0] - 2.0) - 0.5, rate=0.0)),
        unsafe=(UnsafeSet((0,), BlackBox(lambda p, t: np.abs(on_the_grid(p)[:, 0]) - 0.3, rate=0.0)),),
        delta=0.2,
        steps=5,
    )
    controller = Controller(solve(problem, progress=False))
    for adversary in ("random", "aggressive", "worst"):
        report = monte_carlo(controller, 200, adversary, progress=False)
        assert report.counts["reached"] == 200
    run = simulate(controller, [-2.6, 0.5], "worst")
    assert run.outcome == "reached" and run.states[-1, 0] < -np.pi
    far = rng.uniform(-30, 30, (100, 2))
    wrapped = grid.wrapped(far)
    assert np.allclose(np.exp(1j * wrapped[:, 0]), np.exp(1j * far[:, 0])) and (wrapped[:, 1] == far[:, 1]).all()
    assert (grid.wrapped(np.array([[np.nextafter(-np.pi, -4), 0.5]]))[:, 0] < np.pi).all()


def swaying(p, t):
    return np.abs(p[:, 0] - np.sin(3 * t)) - 0.1


@pytest.mark.parametrize("level_set", [swaying, BlackBox(swaying, rate=3.0)], ids=["formula", "black box"])
def test_swept_that_is_not_given_bounds_every_time(level_set):
    """Pieces of time hold the set of a formula at all times; samples of a black box, lowered by half a gap's motion."""
    part = UnsafeSet((0,), level_set)
    points = np.linspace(-2, 2, 401)[:, None]
    swept = part.over(points, 0.2, 0.5, "swept")
    sampled = part.over(points, 0.2, 0.5, "sampled")
    dense = np.min([part.level_set(points, t) for t in np.linspace(0.2, 0.5, 5001)], axis=0)
    assert (swept <= dense).all() and (swept >= dense - 3.0 * 0.3 / 19).all()
    assert (sampled > dense + 1e-4).any()


@pytest.mark.parametrize("when", [0.2, 0.3501, 0.4999])
def test_what_comes_and_goes_between_samples_is_in_the_swept_set(when):
    """At a place, and in cells: as long as it is there at all; samples see nothing of it but at one."""
    part = UnsafeSet((0,), lambda p, t: np.where(np.abs(t - when) < 5e-5, np.abs(p[:, 0]) - 0.5, 2.0))
    points = np.linspace(-1.0, 1.0, 41)[:, None]
    least = part.least(points - 0.1, points + 0.1, 0.2, 0.5, "swept")
    assert (least <= np.maximum(np.abs(points[:, 0]) - 0.6, -0.5) + 1e-12).all()
    assert (part.over(points, 0.2, 0.5, "swept") <= np.abs(points[:, 0]) - 0.5).all()
    for sampled in (
        part.least(points - 0.1, points + 0.1, 0.2, 0.5, "sampled"),
        part.over(points, 0.2, 0.5, "sampled"),
    ):
        assert (sampled == 2.0).all() == (when != 0.2)


def test_true_values_need_no_grid():
    problem = plane(
        grid=Grid([0.0, 0.0], [1.0, 1.0], (9, 9)),
        target=TargetSet((0,), lambda p, t: p[:, 0] - 0.5 - t),
        unsafe=(UnsafeSet((1,), lambda p, t: p[:, 0] - 0.2), UnsafeSet((0,), lambda p, t: p[:, 0] - 0.1)),
    )
    q = np.array([[0.4, 0.7], [0.7, 0.3]])
    assert np.allclose(problem.target_value(q, 0.1), [-0.2, 0.1])
    assert np.allclose(problem.unsafe_value(q, 0.0), [0.3, 0.1])
    assert np.isinf(dataclasses.replace(problem, unsafe=()).unsafe_value(q, 0.0)).all()


def test_functions_that_do_not_tell_their_arguments_are_taken():
    class Compiled:
        __signature__ = "none that Python knows"

        def __call__(self, points, t):
            return points[:, 0] - 0.5

    with pytest.raises((TypeError, ValueError), match="signature"):
        inspect.signature(Compiled())
    assert TargetSet((0,), Compiled()).level_set(np.array([[2.0]]), 0.0) == 1.5
    with pytest.raises(ValueError, match="no signature"):
        inspect.signature(max)
    with pytest.raises(ValueError, match="'target' cannot be read"):
        TargetSet((0,), max)
    assert TargetSet((0,), BlackBox(max)).level_set.function is max


def test_along_a_path_each_set_is_where_it_is_at_that_instant(rng):
    """Of a wall that comes nearer and one that holds under input 2 alone, for times that repeat, too."""
    coming = UnsafeSet((0,), lambda p, t: 3.0 - 0.7 * t - p[:, 0])
    under = UnsafeSet((0,), lambda p, t: p[:, 0] + 2.0 - 0.3 * t, inputs=[2])
    problem = line(unsafe=[coming, under])
    times, inputs = np.array([0.4, 0.4, 0.1, 1.2, 1.2, 0.4]), np.array([0, 2, 1, 2])
    x = rng.uniform(-4.0, 4.0, (4, 6, 1))
    first, second = 3.0 - 0.7 * times - x[..., 0], x[..., 0] + 2.0 - 0.3 * times
    np.testing.assert_allclose(problem.unsafe_along(x, times), first, atol=1e-12)
    both = np.where(inputs[:, None] == 2, np.minimum(first, second), first)
    np.testing.assert_allclose(problem.unsafe_along(x, times, inputs), both, atol=1e-12)


@pytest.mark.parametrize(
    ("problem", "changes"),
    [
        (line, [{"sampling": one} for one in ("nodes", "steep", "cell")]),
        (lambda **given: plane(lower=[-2.0, -1.0], upper=[2.0, 3.0], **given), [{"axes": (0,)}, {"axes": (1,)}]),
    ],
    ids=["sampling", "axes"],
)
def test_sets_of_one_function_that_are_sampled_otherwise_are_two(problem, changes):
    """Whichever of them is asked about first."""
    sets = [dataclasses.replace(post(1.02, 0.3), **one) for one in changes]
    alone = [Samples(problem(unsafe=[one])).sample(one, 0.0) for one in sets]
    assert not any(np.array_equal(one, other) for one, other in itertools.combinations(alone, 2))
    for order in itertools.permutations(range(len(sets))):
        samples = Samples(problem(unsafe=sets))
        assert all(np.array_equal(samples.sample(sets[at], 0.0), alone[at]) for at in order)
