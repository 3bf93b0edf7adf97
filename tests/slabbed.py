"""Solving in slabs as thick as a test wants them, and comparing what comes of it to the last bit."""

import warnings
from pathlib import Path

import numpy as np

import sdhj
from sdhj.outofcore import planned, task_bytes
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.solving import method_of


def room(problem: ReachAvoidProblem, method="hji", width=8, axis=0) -> int:
    """Bytes that make slabs at most `width` nodes thick."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return task_bytes(planned(problem, method_of(method), (axis, width)))


def assert_bit_equal(stored, table) -> None:
    """A table in a store has every bit of the one in memory."""
    for part, whole in ((stored, table), (stored.avoid, table.avoid)):
        for name in (
            ("index", "tubes", "marks") if part is stored else ("static_axes", "static", "moving_axes", "moving")
        ):
            one, other = (np.asarray(getattr(of, name)) for of in (part, whole))
            assert (one.dtype, one.shape) == (other.dtype, other.shape), name
            assert one.tobytes() == other.tobytes(), name


def rough_problem(
    nodes=24, *, across=None, gain=0.4, drift=1.0, ends="wall", state=False, steps=2, delta=0.1
) -> ReachAvoidProblem:
    """A torus and a line: values from node to node as they come, so what reaches too little is seen to.

    across : nodes of the line, as many as the torus has by default
    """
    rng = np.random.default_rng(3)
    shape = nodes, across or nodes
    table = rng.uniform(-1.0, 1.0, shape)
    lower, upper = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
    closed = np.concatenate([table, table[:1]])  # where the torus closes
    rough = sdhj.gridded(closed, lower, (upper - lower) / [nodes, shape[1] - 1])

    def level_set(points, t):
        return rough(points)

    levels = np.array([[drift, 0.0], [-drift / 2, 0.0]])

    def moved(points, u):
        return np.stack([u[0] * np.cos(3 * points[:, 1]), np.sin(points[:, 0] * np.pi)], axis=1)

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid(lower.tolist(), upper.tolist(), shape, [True, False], ends=ends),
        dynamics=sdhj.Dynamics(levels, moved if state else levels, gain * np.eye(2), [1.0, 1.0]),
        target=sdhj.TargetSet((0, 1), level_set),
        unsafe=(sdhj.UnsafeSet((0, 1), lambda p, t: level_set(-p, t) + 0.5, name="rough"),),
        delta=delta,
        steps=steps,
    )


def lines_of(store: Path, array: str) -> list[str]:
    """The lines of an array in the ledger of a store."""
    return [line for line in (store / "ledger").read_text().splitlines() if line.startswith(array)]
