"""The Hopf-Lax operator against its slow twin, closed forms and the finite differences."""

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdhj import Grid, Scheme
from sdhj.problem.boxes import INTERPOLATIONS, maximum_over_boxes
from sdhj.problem.velocities import Velocities
from sdhj.solver.hopf_lax import Moved, maxima_over_sets
from sdhj.solver.schemes import evolve

ROUNDING = 1e-12  # a dozen float64 operations on values of order one


def maximum_over_interval(grid, values, axis, low, high, interpolation):
    """Of one box, which stretches along one axis."""
    along = np.arange(grid.ndim) == axis
    return next(maximum_over_boxes(grid, values, [low * along], [high * along], interpolation))[1]


@settings(max_examples=30)
@given(
    nodes=st.integers(6, 12),
    low=st.floats(-4, 4),
    width=st.floats(0, 4),
    periodic=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_linear_interval_maximum_equals_the_slow_twin(nodes, low, width, periodic, seed):
    line = np.random.default_rng(seed).normal(size=nodes)
    grid = Grid([0.0], [float(nodes if periodic else nodes - 1)], [nodes], [periodic])
    got = maximum_over_interval(grid, line, 0, low, low + width, "linear")
    np.testing.assert_allclose(got, naive.maximum_over_interval(line, low, low + width, periodic), rtol=0, atol=1e-9)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_every_axis_of_a_grid_is_treated_alike(rng, axis):
    grid = Grid([0.0] * 3, [1.0] * 3, (6, 7, 8), (True, False, True))
    values = rng.normal(size=grid.shape)
    got = maximum_over_interval(grid, values, axis, -0.13, 0.22, "linear")
    h = grid.spacing[axis]
    expected = np.apply_along_axis(naive.maximum_over_interval, axis, values, -0.13 / h, 0.22 / h, grid.periodic[axis])
    np.testing.assert_allclose(got, expected, rtol=0, atol=ROUNDING)


def test_boxes_are_never_below_the_maximum_of_the_interpolant(rng):
    """Axis by axis bounds the true maximum of the multilinear interpolant over the box, and at one axis equals it."""
    grid = Grid([0.0, 0.0], [1.0, 1.0], (7, 8), (True, False))
    values = rng.normal(size=grid.shape)
    low = np.array([[-0.1, -0.05], [0.2, 0.0], [-0.1, 0.0]])
    high = np.array([[0.1, 0.15], [0.2, 0.0], [0.1, 0.0]])
    results = dict(maximum_over_boxes(grid, values, low, high, "linear"))
    assert sorted(results) == [0, 1, 2]
    points = grid.points()
    for j, got in results.items():
        sampled = np.full(grid.size, -np.inf)
        for a in np.linspace(low[j, 0], high[j, 0], 41):
            for b in np.linspace(low[j, 1], high[j, 1], 41):
                moved = points + np.array([a, b])
                moved[:, 1] = np.clip(moved[:, 1], 0.0, 1.0)
                sampled = np.maximum(sampled, grid.interpolate(values, moved))
        assert (got.ravel() >= sampled - 1e-9).all()
        if j:  # the boxes that stretch along one axis only: equal up to the sampling of the box (half a step of 0.005)
            slope = 2 * np.abs(values).max() / min(grid.spacing)
            assert (got.ravel() <= sampled + slope * 0.005).all()


@pytest.mark.parametrize(("interpolation", "order"), [("linear", 2), ("limited", 3)])
def test_order_of_the_interpolated_shift(interpolation, order):
    errors, nodes = [], np.array([20, 40, 80])
    for n in nodes:
        grid = Grid([0.0], [2 * np.pi], [n], [True])
        x = grid.nodes(0)
        shift = 0.37 * grid.spacing[0]
        got = maximum_over_interval(grid, np.sin(x), 0, shift, shift, interpolation)
        # in the mean: next to an inflection, where the limiter lets go, "limited" is no better than "linear"
        errors.append(np.abs(got - np.sin(x + shift)).mean())
    fitted = -np.polyfit(np.log(nodes), np.log(errors), 1)[0]
    print(f"{interpolation}: fitted order {fitted:.2f}")
    assert fitted == pytest.approx(order, abs=0.15)
    assert set(INTERPOLATIONS) == {"linear", "limited"}


@pytest.mark.parametrize("interpolation", ["linear", "limited"])
def test_walls_clip_the_motion(interpolation):
    grid = Grid([0.0], [1.0], [11])
    line = np.linspace(0.0, 1.0, 11) ** 2
    pushed = maximum_over_interval(grid, line, 0, 0.25, 0.25, interpolation)
    np.testing.assert_allclose(pushed[-3:], 1.0, rtol=0, atol=ROUNDING)
    everything = maximum_over_interval(grid, line, 0, -5.0, 5.0, interpolation)
    np.testing.assert_allclose(everything, 1.0, rtol=0, atol=ROUNDING)


def test_finite_differences_converge_to_the_closed_form():
    """In two dimensions: the same game by both solvers, against the exact maximum over a box of a smooth function."""
    differences = {"hji": [], "lax": []}
    nodes = np.array([20, 40, 80])
    for n in nodes:
        grid = Grid([-np.pi, -np.pi], [np.pi, np.pi], [n, n], [True, True])
        x, y = grid.points().T
        lower, upper = np.array([0.4, -0.8]), np.array([1.0, -0.2])
        values = (np.cos(x) + np.cos(y)).reshape(grid.shape).astype(np.float32)

        def best(z, a, b):  # maximum of cos over [z + a, z + b]: one where the interval holds a multiple of 2 pi
            hit = np.floor((z + b) / (2 * np.pi)) > np.floor((z + a) / (2 * np.pi))
            return np.where(hit, 1.0, np.maximum(np.cos(z + a), np.cos(z + b)))

        exact = (best(x, lower[0], upper[0]) + best(y, lower[1], upper[1])).reshape(grid.shape)
        scheme = Scheme(frame="fixed")
        hji = evolve(grid, values, Velocities(lower, upper), 1.0, scheme)
        (_, lax), *_ = maximum_over_boxes(grid, values, lower[None], upper[None], "linear")
        differences["hji"].append(np.abs(hji - exact).mean())
        differences["lax"].append(np.abs(lax - exact).mean())
    rates = {name: -np.polyfit(np.log(nodes), np.log(errors), 1)[0] for name, errors in differences.items()}
    print(differences, rates)
    assert rates["hji"] > 1.5 and rates["lax"] > 1.5  # second order but at the kinks


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_who_is_past_a_safe_end_by_the_drift_alone_is_not_out_of_danger(side):
    """Led on by 0.3 m and by up to 0.2 m more or less along a diagonal, where all that is inside is in danger."""
    ends = [["unsafe", "safe"] if side > 0 else ["safe", "unsafe"], "wall"]
    grid = Grid([-1.0, -1.0], [1.0, 1.0], [21, 21], ends=ends)
    wide = grid.wider([(0, 8) if side > 0 else (8, 0), (0, 0)], grid.ends)
    by, half = np.array([[side * 0.3, 0.0]]), np.array([[[0.2, 0.2]]])
    (some,) = maxima_over_sets(wide, np.ones(wide.shape), Moved(by, by, half), "linear", wide.inner)
    least = side * grid.nodes(0) + 0.3 - 0.2  # how far out it may be at the end, at least
    expected = np.where(least > 1.0 + 1e-9, 1.0 - least, 1.0)
    np.testing.assert_allclose(some.of()[0], np.broadcast_to(expected[:, None], grid.shape), atol=1e-9)
