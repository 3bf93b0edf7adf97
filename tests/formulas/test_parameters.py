"""The first parameter of a function is the state, whatever it is called; what may be read in two ways is refused."""

import functools

import numpy as np
import pytest
import zoo

import sdhj
from sdhj import BlackBox, Dynamics, Grid, TargetSet, UnsafeSet

GRID = Grid([-2.0], [2.0], [41])


def near(q, t):
    return np.abs(q[:, 0] - 1.2) - 0.2


def boat(**parts):
    return zoo.line(
        grid=GRID, dynamics=Dynamics([[-1.0], [1.0]], **parts), target=TargetSet((0,), near), delta=0.25, steps=4
    )


class Thrust:
    def __call__(self, v, u):
        return u[0] - 2 * v

    def of(self, v, u):
        return u[0] - 2 * v


def scaled(v, u, factor):
    return u[0] - factor * v


DYNAMICS = {
    "velocity of (v, u)": {"velocity": lambda v, u: u[0] - 2 * v, "bounds": [0.1]},
    "velocity of (u, v)": {"velocity": lambda u, v: u - 2 * v, "bounds": [0.1]},
    "velocity of (t, u, v)": {"velocity": lambda t, u, v: u - 2 * v, "bounds": [0.1]},
    "drift of (v, u)": {"drift": lambda v, u: u[0] - 2 * v},
    "drift of v": {"drift": lambda v: -v},
    "drift of (u, t)": {"drift": lambda u, t: u * t},
    "drift of (t, x)": {"drift": lambda t, x: x},
    "a default": {"drift": lambda u, t=0.0: u},
    "a default of the first": {"drift": lambda v=0.0, u=0.0: u - v},
    "by position alone": {"drift": lambda v, /, u: u - v},
    "a partial": {"drift": functools.partial(scaled, factor=2.0)},
    "an object": {"drift": Thrust()},
    "a method": {"drift": Thrust().of},
    "a black box": {"drift": BlackBox(lambda v, u: u - v, slope=1.0, rate=0.0)},
    "gain of u": {"drift": [[-1.0], [1.0]], "gain": lambda u: u[:, None], "bounds": [0.1]},
    "bounds of u": {"drift": [[-1.0], [1.0]], "gain": [[1.0]], "bounds": lambda u: np.abs(u)},
    "bounds of (t, u)": {"drift": [[-1.0], [1.0]], "gain": [[1.0]], "bounds": lambda t, u: [t]},
    "bounds of v": {"drift": [[-1.0], [1.0]], "gain": [[1.0]], "bounds": lambda v: np.abs(v)},
}


@pytest.mark.parametrize("name", DYNAMICS)
def test_a_first_parameter_with_the_name_of_another_is_refused_with_both_readings(name):
    with pytest.raises(ValueError, match="its first parameter is"):
        boat(**DYNAMICS[name])


SETS = {
    "(t, p)": lambda t, p: np.abs(p[:, 0]) - 1.0,
    "(u, t)": lambda u, t: np.abs(u[:, 0]) - 1.0,
    "(v, t)": lambda v, t: np.abs(v[:, 0]) - 1.0,
    "a black box": BlackBox(lambda t, p: np.abs(p[:, 0]) - 1.0, slope=1.0, rate=0.0),
    "a partial": functools.partial(lambda t, p, r: np.abs(p[:, 0]) - r, r=1.0),
}


@pytest.mark.parametrize("name", SETS)
def test_so_is_that_of_a_set_and_of_sets_together(name):
    said = "first parameter.*state"
    with pytest.raises(ValueError, match=said):
        TargetSet((0,), SETS[name])
    with pytest.raises(ValueError, match=said):
        UnsafeSet((0,), SETS[name])
    if name != "a black box":
        for joined in (sdhj.union, sdhj.intersection):
            with pytest.raises(ValueError, match=said):
                joined(near, SETS[name])
        with pytest.raises(ValueError, match=said):
            sdhj.complement(SETS[name])


@pytest.mark.parametrize(
    ("function", "swept"),
    [
        (lambda p, u: np.abs(p[:, 0]) - 1.0, None),
        (lambda p, v: np.abs(p[:, 0]) - 1.0, None),
        (lambda time, p: np.abs(p[:, 0]) - 1.0, None),
        (lambda p, r=0.5: np.abs(p[:, 0]) - r, None),
        (near, lambda p, t1, t0: near(p, t0)),
        (near, lambda p, t, dt: near(p, t)),
        (near, lambda p, *, t0, t1: near(p, t0)),
    ],
)
def test_what_stands_in_the_place_of_the_time_is_the_time(function, swept):
    with pytest.raises(ValueError, match=r"must be a function of|never gets"):
        UnsafeSet((0,), function, swept)


def test_enclosures_have_their_places_too():
    ends = lambda low, high, t1, t0: (low[:, 0], high[:, 0])  # noqa: E731
    with pytest.raises(ValueError, match="level set of 'target'"):
        TargetSet((0,), BlackBox(near, enclosure=ends))
    with pytest.raises(ValueError, match="enclosure of drift must"):
        boat(drift=BlackBox(lambda q, u: q, enclosure=lambda low, high, t0, t1, u: (low, high)))


def test_a_state_may_have_any_other_name_and_the_readings_that_are_named_are_taken():
    """The advice of the errors, followed: each gives the velocity that its author meant."""
    states, u = np.array([[0.5], [-1.0]]), np.array([1.0])
    for velocity in (lambda q, u: u[0] - 2 * q, lambda U, u: u[0] - 2 * U, lambda speed, u: u[0] - 2 * speed):
        moved = boat(velocity=velocity, bounds=[0.1]).dynamics.velocity_at(states, 1, np.zeros(1), 0.0)
        assert np.allclose(moved, u - 2 * states)
    assert np.allclose(boat(drift=lambda q, u, t: u * t).dynamics.drift_at(states, 1, 0.5), 0.5)  # one value for all
    timed = boat(drift=[[-1.0], [1.0]], gain=[[1.0]], bounds=lambda t: [0.1 + t])
    assert timed.dynamics.bounds_at(0, 0.25).tolist() == [0.35]
    with pytest.raises(ValueError, match=r"write \(q, u\); if it is the disturbance"):
        boat(velocity=lambda v, u: u[0] - 2 * v, bounds=[0.1])
    with pytest.raises(ValueError, match=r"write \(q, t\); if it is the time"):
        TargetSet((0,), lambda t, p: near(p, t))


def test_one_value_for_all_states_may_not_hang_on_one_of_them():
    with pytest.raises(ValueError, match=r"\(M, 1\), got \(1,\)"):
        boat(drift=lambda q, u: q[0])
