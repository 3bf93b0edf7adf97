"""Tapes for tests, and boxes of awkward numbers."""

import math

import numpy as np

from sdhj.formulas.rules import FACTS, RULES
from sdhj.kernels import tape as tapes

OPERATIONS = [op for op in RULES if op not in ("x", "p", "const", "gridded")]
TRUTHS = ("and", "or", "not")
NONE = np.zeros(1)  # parameters
AWKWARD = [0.0, 1.0, 0.5, 2.0, 7 / 16, 19 / 16, math.pi / 4, math.pi / 2, math.pi, 0.1, 3.0, 100.0, 1e6, 1e10]
AWKWARD += [5e-324, 1e-310, 1e-200, 1e-17, 1e200, 1.7e308, 708.0, 745.0, np.nextafter(1.0, 0.0), np.nextafter(1.0, 2.0)]
AWKWARD = sorted([-a for a in AWKWARD] + AWKWARD)
POWERS = [0, 1, 2, 3, 7, 8, 64, -1, -2, -3, -64]


def arity(op):
    return RULES[op].arity


def made(rows, outputs, slots=None, lookups=(), places=(), tables=()):
    """A tape of rows (operation, slot, operands, value)."""
    both = [(op, slot, operands * 2 if len(operands) == 1 else operands) for op, slot, operands, _ in rows]
    code = [(RULES[op].code, slot, *operands, *[0] * (3 - len(operands))) for op, slot, operands in both]
    return tapes.packed(
        np.array(code, np.int64),
        np.array([slots or 1 + max(row[1] for row in rows)]),
        np.array(outputs, np.int64),
        np.array(lookups, np.int64).reshape(-1, 14),
        np.array([row[3] for row in rows], float),
        np.array(places, float).reshape(-1, 12),
        np.array(tables, float).ravel(),
    )


def of_one(op, n=0, slot=0):
    """A tape of one operation of the coordinates, its result in one of its operands' slots."""
    leaves = [("x", k, (k,), 0.0) for k in range(arity(op))]
    return made([*leaves, (op, slot, tuple(range(arity(op))), n)], [slot])


def results(tape):
    return int(np.diff(tape.ints[2 * tapes.RESULTS :][:2])[0])


def values(tape, points, parameters=NONE):
    points = np.ascontiguousarray(points, float)
    out = np.full((results(tape), len(points)), -7.0)
    tapes.play(tape, points, np.asarray(parameters, float), out)
    return out


def bounds(tape, low, high, parameters_low=NONE, parameters_high=NONE, facts=FACTS):
    low, high = np.ascontiguousarray(low, float), np.ascontiguousarray(high, float)
    out = np.full((2, results(tape), len(low)), -7.0)
    tapes.play_bounds(tape, facts, low, high, np.array([parameters_low, parameters_high], float), out)
    return out


def awkward_boxes(op, rng, count):
    """(low, high) (M, operands): of awkward numbers, many of width 0, and moderate ones."""
    shape = (count, arity(op))
    ends = rng.choice(AWKWARD, (2, *shape))
    moderate = rng.random((count, 1)) < 0.5
    centre = rng.normal(size=shape) * 10.0 ** rng.integers(-1, 2, (count, 1))
    low, high = np.minimum(*ends), np.maximum(*ends)
    low, high = np.where(moderate, centre, low), np.where(moderate, centre + rng.exponential(0.5, shape), high)
    high = np.where(rng.random(shape) < 0.3, low, high)
    columns = slice(0, RULES[op].truths)
    low[:, columns], high[:, columns] = low[:, columns] > 0.1, 1.0 * (high[:, columns] > 0.0)
    return low, np.maximum(low, high)
