"""Chapter 10, Cost: what it draws, its widgets, and the checks of its exercises."""

import time

import numpy as np
from numba import njit

from course.exercises import exercise, expect, expect_close
from sdhj.problem.grid import Grid
from sdhj.problem.velocities import Velocities
from sdhj.solver.schemes import Scheme, evolve


@exercise("10.1", "Half the interval is twice the steps: N = 16. Seven levels for each of two joints make L.")
def check_games(games):
    """L = 49, N = 16."""
    expect(games != 25 * 36, "that is the case study as it is.")
    expect(games != 49 * 36 and games != 25 * 136, "that is one of the two changes.")
    expect(games != 98 * 136 and games != 7 * 136, "seven levels for each of two joints: how many inputs?")
    expect_close(games, 49 * 16 * 17 // 2, "L N (N + 1) / 2 with N twice as large.")
    return "Half the interval takes half the time steps; more levels change nothing about a game."


@exercise(
    "10.2",
    "45 tubes with 4 bytes of value and 4 of marks at each of m^4 nodes; 25 avoid tubes on all axes, 200 on two.",
)
def check_memory(most):
    """The largest m with 45 m^4 8 + 100 m^4 + 800 m^2 <= 1e9."""

    def size(m):
        return 45 * m**4 * (4 + 4) + 4 * 25 * m**4 + 4 * 25 * 8 * m**2

    expect(int(most) == most, "nodes come whole.")
    expect(most != 40, "the tubes alone would fit. Do the avoid tubes?")
    expect(
        size(most) <= 1e9, f"{most} nodes take {size(most) / 1e9:.2f} GB: 45 tubes, 8 bytes a node, and avoid tubes."
    )
    expect(size(most + 1) > 1e9, "one more would fit: 25 inputs take 4 bytes at each node, a value 4.")


@exercise("10.3", "The second that was no game stays as it is; of the games one in 25 is left.")
def check_amdahl(seconds):
    """1 s of the rest, 7/25 s of games, 25 shifts."""
    expect(abs(seconds - 8 / 25) > 1e-9, "not everything is games: what of the eighth second?")
    expect(abs(seconds - 1.28) > 1e-9, "and the shifts?")
    expect_close(
        seconds, 1 + 7 / 25 + 25 * 0.02, "the rest stays, one game of 25 stays, 25 shifts are new.", within=5e-3
    )


@exercise("10.4", "delta / c times the sum of speed over spacing, rounded up.")
def check_steps(time_steps):
    """As the library counts."""
    rng = np.random.default_rng(0)
    for ndim in (1, 2, 4):
        shape, speed = rng.integers(8, 40, ndim), rng.uniform(0.1, 4.0, ndim)
        grid = Grid([-1.0] * ndim, [1.0] * ndim, shape)
        for delta, cfl in ((0.1, 0.75), (1.0, 0.5)):
            wanted = Velocities(-speed, speed).steps(grid, delta, cfl)
            got = time_steps(np.array(grid.spacing), speed, delta, cfl)
            expect(int(got) == got, "a number of steps is whole.")
            hint = f"{ndim} axes, delta {delta}, c {cfl}: {wanted} steps. The sum over the axes counts, rounded up."
            expect_close(got, wanted, hint)


def _reference(phi, a, b, ratios, periodic):
    grid = Grid([0.0] * 3, [1.0] * 3, phi.shape, periodic, ends="wall")
    velocities = Velocities(*(np.array(v) * ratios * np.array(grid.spacing) for v in (a, b)))
    scheme = Scheme(order=1, integrator="euler", frame="fixed", dtype="float64")
    return evolve(grid, phi, velocities, 1.0, scheme, steps=1)


def _with_arrays(phi, a, b, ratios, periodic):
    out = phi.copy()
    for axis in range(3):
        ghosts = [(1, 1) if axis == i else (0, 0) for i in range(3)]
        differences = np.diff(np.pad(phi, ghosts, mode="wrap" if periodic[axis] else "edge"), axis=axis)
        minus, plus = (differences.take(range(s, phi.shape[axis] + s), axis) for s in (0, 1))
        best = np.maximum(*(v * (plus if v > 0 else minus) for v in (a[axis], b[axis])))
        out += ratios[axis] * (np.maximum(best, 0) if a[axis] < 0 < b[axis] else best)
    return out


def _least(act, repeats=5):
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        act()
        times.append(time.perf_counter() - began)
    return min(times)


@exercise(
    "10.5",
    "Give each axis its left and right neighbour first, wrapped or held. Then take the larger of low and high, "
    "each with its own difference, and zero where a < 0 < b.",
)
def check_kernel(step_3d):
    """Compiled, against the library's first order and an array version; the gain is told, not judged."""
    step = getattr(step_3d, "__wrapped__", step_3d)
    compiled = step if hasattr(step, "py_func") else njit(step)
    rng = np.random.default_rng(1)
    phi = rng.normal(size=(23, 17, 29))
    ratios = np.array([0.1, 0.15, 0.2])
    for a, b, periodic, what in (
        ((0.5, 0.2, 0.3), (1.0, 0.9, 0.4), (False, False, False), "velocities of one sign take p+ on every axis"),
        ((-0.5, -1.0, -0.3), (-0.2, -0.5, -0.1), (False, False, False), "negative velocities take p-"),
        ((-0.5, 0.2, -1.0), (0.7, 0.6, 0.1), (False, False, False), "where a < 0 < b, zero is a third candidate"),
        ((-0.5, -0.2, -1.0), (0.7, 0.6, 0.1), (False, True, False), "periodic axes wrap, the others do not"),
        ((-0.5, 0.2, -1.0), (0.7, 0.6, 0.1), (True, False, True), "periodic axes wrap, the others do not"),
    ):
        out = np.full_like(phi, np.nan)
        compiled(phi, out, a, b, ratios, periodic)
        expect(~np.isnan(out), "not all of `out` was written: every node gets a value, and nothing is returned.")
        expect_close(out, _reference(phi, a, b, ratios, periodic), f"{what}.", within=1e-12)
    large, given = rng.normal(size=(80, 80, 80)), (a, b, ratios, periodic)
    out = np.empty_like(large)
    gain = _least(lambda: _with_arrays(large, *given)) / _least(lambda: compiled(large, out, *given))
    return f"On 80^3 nodes it is {gain:.0f} times as fast as whole arrays."
