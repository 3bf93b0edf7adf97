"""Disturbances in a ball: the polygon around it, by its support function, and the same table as by hand."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import zoo

import sdhj
from sdhj.problem.ball import MOST_SIDES

SPEEDS = 0.5 * np.array(zoo.STEPS)


PLANE = np.eye(2)


def room(gain=PLANE, bounds=None, **given):
    usual = {
        "grid": sdhj.Grid([-1.5, -1.5], [1.5, 1.5], [21, 21]),
        "dynamics": given.pop("dynamics", None) or sdhj.Dynamics(SPEEDS, SPEEDS, gain, bounds),
        "target": zoo.goal(0.8, 0.0, 0.35),
        "unsafe": [zoo.post(0.0, 0.1, 0.3)],
        "steps": 4,
    }
    return zoo.plane(**usual | given)


def octagon(r, sides=8):
    """The recipe of old: components along each pair of sides, half as long as the side."""
    pairs = sides // 2
    angles = np.pi / pairs * np.arange(pairs)
    return {
        "gain": np.stack([np.cos(angles), np.sin(angles)]),
        "bounds": np.full(pairs, r * np.tan(np.pi / (2 * pairs))),
    }


@pytest.mark.parametrize("sides", [4, 6, MOST_SIDES])
def test_what_is_played_is_outside_the_ball_and_no_farther_than_its_corners(sides, rng):
    """Its support function: at least r in every direction, r across sides, at most r / cos(pi / sides)."""
    dynamics = sdhj.Dynamics(SPEEDS, SPEEDS, np.eye(2), sdhj.Ball(0.3, sides))
    angles = np.concatenate([rng.uniform(0.0, 2 * np.pi, 1000), np.pi / 2 + 2 * np.pi / sides * np.arange(sides)])
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    support = np.abs(ways @ dynamics.gain) @ dynamics.bounds
    assert support.min() >= 0.3 * (1 - 1e-12) and support.max() <= 0.3 / np.cos(np.pi / sides) * (1 + 1e-12)
    assert np.allclose(support[1000:], 0.3, rtol=1e-12)


@pytest.mark.parametrize("method", ["hji", sdhj.Certified(cells=(40, 40))])
def test_a_table_is_that_of_components_along_the_sides(method):
    one, other = (sdhj.solve(room(**given), method, play=False) for given in ({"bounds": sdhj.Ball(0.2)}, octagon(0.2)))
    assert one.problem.digest == other.problem.digest and np.array_equal(one.values(), other.values())
    if not one.proved:  # of a certified table boxes are an image's, wider by a rounding than the square's
        assert one.fraction() > sdhj.solve(room(bounds=[0.2, 0.2]), method, play=False).fraction()


def test_the_sides_are_the_adversary_s_and_files_have_them(tmp_path):
    table = sdhj.solve(room(bounds=sdhj.Ball(0.2)), play=False)
    table.save(tmp_path / "table.npz")
    assert sdhj.load(tmp_path / "table.npz", problem=room(bounds=sdhj.Ball(0.2))).problem.dynamics.disturbance_dim == 4
    run = sdhj.simulate(sdhj.Controller(table), [0.5, 0.1], seed=1)
    assert run.disturbances.shape[1] == 4


FORMS = {
    "a radius that depends on the state": dict(
        drift=SPEEDS, gain=np.eye(2), bounds=sdhj.Ball(lambda q: 0.1 + 0.05 * q[:, 0] ** 2)
    ),
    "and on input and time": dict(
        drift=SPEEDS, gain=np.eye(2), bounds=sdhj.Ball(lambda q, u, t: 0.1 + 0.1 * u[0] ** 2 + 0.05 * q[:, 0] ** 2 + t)
    ),
    "a gain that does": dict(
        drift=SPEEDS,
        gain=lambda q: np.stack(
            [np.stack([1 + 0.1 * q[:, 0], 0 * q[:, 0]], 1), np.stack([0 * q[:, 0], 1 + 0 * q[:, 0]], 1)], 1
        ),
        bounds=sdhj.Ball(0.2),
    ),
    "a velocity": dict(velocity=lambda q, u, v: u + v, bounds=sdhj.Ball(0.2)),
}


@pytest.mark.parametrize("name", FORMS)
def test_velocities_of_the_adversary_s_corners_are_in_the_polygon(name, rng):
    problem = room(dynamics=sdhj.Dynamics(SPEEDS, **FORMS[name]))
    field = problem.dynamics
    for q in rng.uniform(-1.4, 1.4, (5, 2)):
        r = 0.2 if "does" in name or "velocity" in name else 0.1 + 0.05 * q[0] ** 2 + (0.35 if "input" in name else 0.0)
        t = 0.325 if "input" in name else 0.0  # .1 u^2 is .025 under input 1
        at, own = q[None], field.gain_at(q[None], 1, t)[0] * field.bounds_at(1, t)
        pushes = own @ np.sign(rng.normal(size=(4, 50)))
        stretch = np.array([1 + 0.1 * q[0] if "gain" in name else 1.0, 1.0])
        far = np.linalg.norm(pushes / stretch[:, None], axis=0)
        assert at.shape == (1, 2) and far.max() <= r / np.cos(np.pi / 8) * (1 + 1e-9)
        across = np.abs(own[0]).sum() / stretch[0]
        assert np.isclose(across, r)  # the box around the octagon is that of the ball


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda: sdhj.Ball(-0.1), "radius"),
        (lambda: sdhj.Ball(0.1, 7), "even number"),
        (lambda: sdhj.Dynamics(SPEEDS, SPEEDS, np.eye(3), sdhj.Ball(0.1)), r"of shape \(ndim, 2\)"),
        (lambda: sdhj.Dynamics(SPEEDS, SPEEDS, None, sdhj.Ball(0.1)), "belong together"),
        (lambda: sdhj.Dynamics(SPEEDS, SPEEDS, sdhj.BlackBox(lambda q: q, slope=0.0), sdhj.Ball(0.1)), "formula"),
        (lambda: room(gain=lambda q: np.ones((len(q), 2, 3)), bounds=sdhj.Ball(0.1)), "two columns"),
    ],
)
def test_what_does_not_fit_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        given()


def test_dynamics_can_be_replaced():
    dynamics = sdhj.Dynamics(SPEEDS, SPEEDS, np.eye(2), sdhj.Ball(0.2))
    assert replace(dynamics, inputs=SPEEDS[:3], drift=SPEEDS[:3]).bounds.size == 4


def bent(q, u, v):
    """A push that is stronger the longer it is: nonlinear in both components."""
    return u + v * (1 + v[0] ** 2 + v[1] ** 2)


@pytest.mark.parametrize("radius", [0.3, lambda q, u: 0.2 + 0.1 * q[:, 0] ** 2 + 0.0 * u[0]], ids=["fixed", "varies"])
def test_a_ball_whose_disturbance_enters_nonlinearly_is_the_ball_itself(radius, rng):
    """Every v of the ball is one of the adversary's, and no other; the pieces hold the velocities of all."""
    problem = room(dynamics=sdhj.Dynamics(SPEEDS, velocity=bent, bounds=sdhj.Ball(radius)))
    field, q = problem.dynamics, rng.uniform(-1.0, 1.0, (1, 2))
    r = radius if isinstance(radius, float) else radius(q, SPEEDS[1])[0]
    assert field.disturbance_dim == 2 and field.pieces_of_components((0, 1)) == (8, 8)
    w = rng.uniform(-1.0, 1.0, (300, 2)) * field.bounds_at(1)
    pushes = np.array([field.velocity_at(q, 1, one, 0.0)[0] for one in w]) - SPEEDS[1]
    far = np.linalg.norm(pushes, axis=1)
    assert far.max() <= r * (1 + r**2) * (1 + 1e-9) and far.max() > 0.95 * r * (1 + r**2)
    angles = np.arctan2(pushes[:, 1], pushes[:, 0])
    assert np.histogram(angles, 8, (-np.pi, np.pi))[0].min() > 10
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    reach = field.greatest_along(q, 1, 0.0, ways)[0] - ways @ SPEEDS[1]
    assert (reach >= r * (1 + r**2) * (1 - 1e-9)).all()


@pytest.mark.slow
def test_more_pieces_come_nearer_to_the_ball():
    """What they reach beyond it falls to the first order, and the table grows; one piece is the square."""

    def made(pieces, bounds=0.2):
        dynamics = sdhj.Dynamics(SPEEDS, velocity=bent, bounds=sdhj.Ball(bounds), pieces=pieces)
        return room(dynamics=dynamics, grid=sdhj.Grid([-1.5, -1.5], [1.5, 1.5], [31, 31]))

    angles, beyond = np.linspace(0.0, 2 * np.pi, 100), []
    for pieces in (8, 16, 32, 64):
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        reach = made(pieces).dynamics.greatest_along(np.zeros((1, 2)), 1, 0.0, ways)[0] - ways @ SPEEDS[1]
        beyond.append((reach / (0.2 * 1.04) - 1.0).max())
    assert beyond[0] < 0.2 and all(0.0 < more < 0.6 * less for less, more in pairwise(beyond))
    shares = [sdhj.solve(made(pieces), play=False).fraction() for pieces in (1, 6)]
    assert shares[1] > 1.3 * shares[0]


@pytest.mark.slow
def test_a_nonlinear_ball_is_kept_in_files(tmp_path):
    def made(r=0.2):
        return room(dynamics=sdhj.Dynamics(SPEEDS, velocity=bent, bounds=sdhj.Ball(r), pieces=3))

    table = sdhj.solve(made(), play=False)
    table.save(tmp_path / "table.npz")
    assert sdhj.load(tmp_path / "table.npz", problem=made()).problem.digest == table.problem.digest
    with pytest.raises(ValueError, match="bounds"):
        sdhj.load(tmp_path / "table.npz", problem=made(0.25))
