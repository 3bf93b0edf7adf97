"""Tapes for tests: of one operation, and random ones."""

import numpy as np

from sdhj.formulas.rules import FACTS, RULES
from sdhj.kernels import tape as tapes

OPERATIONS = [op for op in RULES if op not in ("x", "p", "const", "gridded")]
TRUTHS = ("and", "or", "not")
NONE = np.zeros(1)  # parameters


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


def random_rows(rng, coordinates, length):
    """Rows whose slots are their own numbers; all operations but `gridded`, preferring recent operands."""
    rows = [("x", k, (k,), 0.0) for k in range(coordinates)]
    rows += [("const", k, (), float(rng.choice([0.0, 1.0, -1.0, 0.5, np.pi, -0.3, 1e-3, 100.0]))) for k in range(3, 5)]
    truths: list[int] = []
    while len(rows) < length:
        op = str(rng.choice(OPERATIONS))
        numbers = [row[1] for row in rows if row[1] not in truths]
        if (op in TRUTHS or op == "where") and not truths:
            continue
        kinds = [truths] * arity(op) if op in TRUTHS else [numbers] * arity(op)
        kinds[0] = truths if op == "where" else kinds[0]
        operands = tuple(kind[max(0, len(kind) - 1 - int(rng.exponential(4)))] for kind in kinds)
        if op in (*TRUTHS, "less", "lesseq", "equal"):
            truths.append(len(rows))
        rows.append((op, len(rows), operands, float(rng.integers(-5, 7)) if op == "power" else 0.0))
    return rows


def in_few_slots(rows, outputs):
    """The same, with each result in the slot of an operand that no later row needs, or in another free one."""
    last = {k: i for i, row in enumerate(rows) if row[0] != "x" for k in row[2]} | dict.fromkeys(outputs, len(rows))
    slot, free, top, few = {}, [], 0, []
    for i, (op, _, operands, value) in enumerate(rows):
        places = operands if op == "x" else tuple(slot[k] for k in operands)
        if op != "x":
            free += [slot[k] for k in dict.fromkeys(operands) if last[k] == i]
        if not free:
            free, top = [top], top + 1
        slot[i] = free.pop()
        few.append((op, slot[i], places, value))
        if i not in last:
            free.append(slot[i])
    return made(few, [slot[k] for k in outputs], top)


def random_boxes(rng, count, coordinates):
    """(low, high): small and large, of width 0 in some axes, with zeros and ones among their ends."""
    shape = (count, coordinates)
    centre = rng.normal(size=shape) * 10.0 ** rng.integers(-3, 3, (count, 1))
    centre[rng.random(shape) < 0.2], centre[rng.random(shape) < 0.1] = 0.0, 1.0
    width = np.abs(rng.normal(size=shape)) * 10.0 ** rng.integers(-4, 1, (count, 1)) * (rng.random(shape) < 0.7)
    return centre - width * (rng.random(shape) < 0.7), centre + width


def random_points(rng, low, high):
    """A point in each box, its coordinates often at ends."""
    share = np.clip(rng.uniform(-0.5, 1.5, low.shape), 0.0, 1.0)
    return np.clip(low + share * (high - low), low, high)
