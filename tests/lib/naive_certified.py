"""Slow twins of the certified kernels, in plain Python, and the arm's geometry by sampling. Imports nothing of sdhj.

Also the numbers of the small case studies that the tests of proof and checker share, and runs from certified states.
"""

import itertools
import math
from types import SimpleNamespace

import numpy as np

# A case study of two long steps, with strong disturbances, for coarse cells: arguments of `sdhj.arm_case_study`.
TARGET = {"radius": 0.14, "path": {"kind": "line", "start": [0.05, 0.2], "velocity": [0.1, -0.05]}}
SMALL = {"nodes": 9, "steps": 2, "u_max": 4.0, "v_d_max": 2.0, "v_p_max": 0.6, "input_levels": 3, "target": TARGET}

STILL = {"path": {"kind": "still", "centre": [-0.22, 0.1]}, "radius": 0.06}
LINE = {"path": {"kind": "line", "start": [0.24, -0.02], "velocity": [-0.6, 0.7]}, "radius": 0.04}
CIRCLE = {
    "path": {"kind": "circle", "centre": [0.0, -0.22], "radius": 0.07, "rate": 9.0, "phase": -1.0},
    "radius": 0.04,
}


def sensing(error=(0.0,) * 4, delay=0.0, jitter=0.0, memory=False):
    """How an arm senses, as the checker reads it."""
    return SimpleNamespace(error=np.array(error), delay=delay, jitter=jitter, memory=memory)


def pairs(steps):
    """Every (start, within) in the order in which files have them: (entries, 2)."""
    return np.array([(start, within) for start in range(steps + 1) for within in range(steps - start + 1)])


def place_of(steps, start, within):
    """Where that order has (start, within)."""
    return pairs(steps).tolist().index([start, within])


def elbow_and_tip(q1, q2, arm):
    """Positions of the arm's elbow and tip; arm is (l1, l2, turn)."""
    l1, l2, turn = arm
    phi = turn * q1 + q2
    elbow = (l1 * math.cos(q1), l1 * math.sin(q1))
    return elbow, (elbow[0] + l2 * math.cos(phi), elbow[1] + l2 * math.sin(phi))


def segment_distance(p, a, b):
    """Distance from a point to a segment."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    s = 0.0 if square == 0 else min(max(((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square, 0.0), 1.0)
    return math.hypot(a[0] + s * dx - p[0], a[1] + s * dy - p[1])


def arm_distance(p, q1, q2, arm):
    """Distance from a point to the two links."""
    elbow, tip = elbow_and_tip(q1, q2, arm)
    return min(segment_distance(p, (0.0, 0.0), elbow), segment_distance(p, elbow, tip))


def box_polygon_distance(box, corners):
    """Distance from a box (x0, y0, x1, y1) to the convex hull of points: of all pairs of segments, or 0."""
    x0, y0, x1, y1 = box
    edges = [((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)), ((x1, y1), (x0, y1)), ((x0, y1), (x0, y0))]
    if any(x0 <= x <= x1 and y0 <= y <= y1 for x, y in corners) or inside_hull((x0, y0), corners):
        return 0.0
    best = math.inf
    for a, b in itertools.combinations_with_replacement(corners, 2):
        for c, d in edges:
            if crossing(a, b, c, d):
                return 0.0
            best = min(best, segment_distance(a, c, d), segment_distance(b, c, d))
            best = min(best, segment_distance(c, a, b), segment_distance(d, a, b))
    return best


def cross(o, a, b):
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def crossing(a, b, c, d):
    """Whether two segments cross properly."""
    return cross(a, b, c) * cross(a, b, d) < 0 and cross(c, d, a) * cross(c, d, b) < 0


def inside_hull(p, corners):
    """Whether a point is strictly inside a triangle of three of the corners or on its edge."""
    for a, b, c in itertools.combinations(corners, 3):
        signs = [cross(a, b, p), cross(b, c, p), cross(c, a, p)]
        if cross(a, b, c) != 0 and (all(s >= 0 for s in signs) or all(s <= 0 for s in signs)):
            return True
    return False


def one_step(following, first, number, window, allowed, clear):
    """Cells whose image is in `following` under one input, and which are allowed and clear.

    following, clear (n1, n2, nx, ny) bool; first, number (2, n); window (2, 2, n); allowed (n1, n2) bool.
    """
    n1, n2, nx, ny = following.shape
    found = []
    for i1 in range(n1):
        for i2 in range(n2):
            if not allowed[i1, i2]:
                continue
            rows = [(first[0][i1] + a) % n1 for a in range(number[0][i1])]
            columns = [(first[1][i2] + b) % n2 for b in range(number[1][i2])]
            for x in range(nx):
                for y in range(ny):
                    if clear[i1, i2, x, y] and all(
                        following[r, c, v, w]
                        for r in rows
                        for c in columns
                        for v in range(window[0][0][x], window[0][1][x] + 1)
                        for w in range(window[1][0][y], window[1][1][y] + 1)
                    ):
                        found.append((i1, i2, x, y))
    return found


# ---- packed sets


def leads(cell, low, high, following, periodic, safe):
    """Whether all cells from cell + low to cell + high are in a set; past a safe end, by a cell or more, none is asked.

    following : bool, of the cells' shape. safe : for each axis whether its lower, and its upper, end is safe.
    """
    each = []
    for c, a, b, n, wraps, (lower, upper) in zip(cell, low, high, following.shape, periodic, safe, strict=True):
        if not wraps and ((lower and c + b < -1) or (upper and c + a > n)):
            return True
        each.append([(c + k) % n if wraps else min(max(c + k, 0), n - 1) for k in range(a, b + 1)])
    return bool(following[np.ix_(*each)].all())


def packed(cells):
    """Bool (..., nx, ny) as blocks (..., words)."""
    flat = cells.reshape(*cells.shape[:-2], -1)
    words = -(-flat.shape[-1] // 64)
    out = np.zeros((*flat.shape[:-1], words * 64), np.bool_)
    out[..., : flat.shape[-1]] = flat
    return np.packbits(out, axis=-1, bitorder="little").view(np.uint64)


def unpacked(blocks, shape):
    """Blocks (..., words) as bool (..., nx, ny)."""
    flat = np.unpackbits(blocks.view(np.uint8), axis=-1, count=shape[0] * shape[1], bitorder="little")
    return flat.astype(np.bool_).reshape(*blocks.shape[:-1], *shape)


def erosion(cells, along_x, along_y):
    """Cells (nx, ny) for which all of along_x[x] times along_y[y] are in `cells`."""
    nx, ny = cells.shape
    return np.array([[all(cells[a, b] for a in along_x[x] for b in along_y[y]) for y in range(ny)] for x in range(nx)])


def neighbours(shape):
    """For each cell of two axes itself and the cells beside it, along each axis, held at the walls."""
    return [np.clip(np.arange(n)[:, None] + [-1, 0, 1], 0, n - 1) for n in shape]


def sets_of(steps, shape, rng, shares):
    """Random sets that grow by a share for each start: bool (entries, n1, n2, nx, ny), index and pool."""
    cells = []
    for k in range(steps + 1):
        grown = np.zeros(shape, np.bool_)
        for _ in range(steps - k + 1):
            grown = grown | (rng.random(shape) < shares[k])
            cells.append(grown)
    blocks = packed(np.array(cells)).reshape(len(cells), shape[0] * shape[1], -1)
    pool, index = np.unique(blocks.reshape(-1, blocks.shape[-1]), axis=0, return_inverse=True)
    return np.array(cells), index.reshape(blocks.shape[:2]).astype(np.uint32), np.ascontiguousarray(pool)


# ---- disks, and where a cell's states can get


def disk_centre(disk, t):
    """Where a disk is, from its description."""
    path = disk["path"]
    if path["kind"] == "still":
        return np.array(path["centre"])
    if path["kind"] == "line":
        return np.array(path["start"]) + t * np.array(path["velocity"])
    angle = path["rate"] * t + path["phase"]
    return np.array(path["centre"]) + path["radius"] * np.array([math.cos(angle), math.sin(angle)])


def states_during(world, cell, j, duration, rng, count):
    """Random states (count, 4) that can be reached from a cell, with extreme starts and moves among them; the times."""

    def extreme(shape):
        kind = rng.integers(0, 3, shape)
        return np.where(kind == 2, rng.uniform(0, 1, shape), kind)

    low, high = cell[::2], cell[1::2]
    tau = duration * extreme(count)
    speed = np.array([world.push, world.push, world.agent[0], world.agent[0]])
    drift = np.array([*world.inputs[j], 0.0, 0.0])
    start = low + extreme((count, 4)) * (high - low)
    return start + (drift + speed * (2 * extreme((count, 4)) - 1)) * tau[:, None], tau


def smallest_gap(world, cell, j, body, start, duration, rng, count=150):
    """The least distance, over samples, between the arm and a body, less that at contact; body 3 is the agent."""
    states, taus = states_during(world, cell, j, duration, rng, count)
    known = [STILL, LINE, CIRCLE]
    contact = world.agent[1] if body == 3 else known[body]["radius"] + 0.01
    points = states[:, 2:] if body == 3 else [disk_centre(known[body], start + tau) for tau in taus]
    arm = tuple(world.arm)
    return min(arm_distance(p, q1, q2, arm) for p, (q1, q2) in zip(points, states[:, :2], strict=True)) - contact


# ---- runs from certified states


def states_in(table, rng, count, within=None):
    """Random states of S_0."""
    grid = table.problem.grid
    within = table.problem.steps if within is None else within
    found = []
    while sum(map(len, found)) < count:
        states = rng.uniform(grid.lower, grid.upper, (20000, grid.ndim))
        found.append(states[table.contains(states, start=0, within=within)])
    return np.concatenate(found)[:count]


def steps_to_go(table, states, step):
    """From `contains` alone: the fewest steps, 99 where there are none."""
    out = np.full(len(states), 99)
    for within in range(table.problem.steps - step, -1, -1):
        out[table.contains(states, start=step, within=within)] = within
    return out


def steps_left(table, states, step):
    """`steps_to_go`, of which none are left in the target itself, also where its cell is not whole."""
    problem, t = table.problem, table.problem.time(step)
    there = not problem.has_no_target and problem.target_value(states, t) <= 0
    return np.where(there & (problem.unsafe_value(states, t) > 0), 0, steps_to_go(table, states, step))


def held(problem, states):
    """States after the walls and the period of the grid."""
    for axis, (lower, upper, periodic) in enumerate(
        zip(problem.grid.lower, problem.grid.upper, problem.grid.periodic, strict=True)
    ):
        if periodic:
            states[:, axis] = lower + np.mod(states[:, axis] - lower, upper - lower)
        else:
            states[:, axis] = np.clip(states[:, axis], lower, upper)
    return states


def held_periodic(grid, states):
    """States with the coordinates of periodic axes between the ends."""
    states = np.array(states)
    for axis in np.flatnonzero(grid.periodic):
        period = grid.upper[axis] - grid.lower[axis]
        states[:, axis] = grid.lower[axis] + np.mod(states[:, axis] - grid.lower[axis], period)
    return states


def chosen_inputs(table, states, step, rng):
    """For each state one of the inputs certified for its steps to go, at random; there is one."""
    left, safe = steps_to_go(table, states, step), np.empty((len(states), len(table.problem.inputs)), np.bool_)
    for n in np.unique(left):
        safe[left == n] = table.certified_inputs(states[left == n], step, int(n))
    assert safe.any(axis=1).all()
    return (safe * rng.random(safe.shape)).argmax(axis=1)


def assert_runs_succeed(table, states, rng, pieces=8, fine=3):
    """From every state a certified input leads, against adversaries that switch within the step, one step nearer."""
    problem, dynamics = table.problem, table.problem.dynamics
    for step in range(problem.steps + 1):
        left = steps_to_go(table, states, step)
        assert left.max(initial=0) <= problem.steps - step
        there = left == 0
        assert (problem.target_value(states[there], problem.time(step)) <= 0).all()
        states, left = states[~there], left[~there]
        if not len(states):
            return
        chosen, velocity = chosen_inputs(table, states, step, rng), np.empty_like(states)
        for piece in range(pieces):
            sign = rng.choice([-1.0, 1.0], (len(states), dynamics.disturbance_dim))
            for part in range(fine):
                for j in np.unique(chosen):
                    own = chosen == j
                    push = np.einsum("mid,md->mi", dynamics.gain_at(states[own], j), sign[own] * dynamics.bounds_at(j))
                    velocity[own] = dynamics.drift_at(states[own], j) + push
                states = held(problem, states + problem.delta / pieces / fine * velocity)
                t = problem.time(step) + problem.delta * (piece + (part + 1) / fine) / pieces
                assert (problem.unsafe_value(states, t) > 0).all()
        after = steps_left(table, states, step + 1)
        assert (after < left).all()
        states = states[after > 0]


def edges_of(proof):
    """The ends of the cells of each axis, (ndim, most + 1), NaN behind the last."""
    out = np.full((len(proof.axes), max(axis.count for axis in proof.axes) + 1), np.nan)
    for axis, cells in enumerate(proof.axes):
        out[axis, : cells.count + 1] = cells.edges()
    return out


def clear_bytes(table, step):
    """The bytes of the inputs that are clear from each cell of all unsafe sets and ends: (*cells, bytes)."""
    out, begin = np.full((*table.shape, -(-len(table.problem.inputs) // 8)), 255, np.uint8), 0
    for one in table.proof.entry_in_head["clear"]:
        starts = table.steps if any(table.problem.unsafe[k].moving for k in one["sets"]) else 1
        starts = table.steps if table.problem.dynamics.depends_on_time else starts
        shape = [n if k in one["axes"] else 1 for k, n in enumerate(table.shape)]
        size = int(np.prod(shape)) * out.shape[-1]
        at = begin + min(step, starts - 1) * size
        out &= table.proof.clear[at : at + size].reshape(*shape, -1)
        begin += starts * size
    assert begin == table.proof.clear.size
    return out


def inputs_that_lead(table, step, following):
    """Which inputs are clear from a cell and lead into a set, or into the target itself: (*cells, L) bool."""
    proof, grid, found = table.proof, table.grid, np.zeros((*table.shape, len(table.problem.inputs)), bool)
    safe = [[end == "safe" for end in ends] for ends in grid.ends]
    low, high = (moves[min(step, len(moves) - 1)] for moves in (proof.low, proof.high))
    clear = clear_bytes(table, step)
    arrives = proof.arrives[min(step, len(proof.arrives) - 1)] if len(proof.arrives) else None
    for cell, j in itertools.product(np.ndindex(table.shape), range(found.shape[-1])):
        place = int(np.dot(cell, proof.strides))
        if clear[cell][j // 8] >> (j % 8) & 1:
            found[*cell, j] = leads(cell, low[j, place], high[j, place], following, grid.periodic, safe)
            if arrives is not None:
                found[*cell, j] |= bool(arrives[int(np.dot(cell, proof.sites)), j // 8] >> (j % 8) & 1)
    return found


def with_neighbours(inputs, axes, told=False):
    """Inputs (*cells, L) of the middles of cells: that of a cell of no width is on the border of the next one, too.

    told: points are in a cell of no width only if they say so, and these do not.
    """
    inputs = inputs.copy()
    for place, axis in enumerate(axes):
        each = np.moveaxis(inputs, place, 0)  # a view
        for layer, beside in [(0, 1)] * axis.layers[0] + [(-1, -2)] * axis.layers[1]:
            each[layer] = each[beside] | (each[layer] & (not told))
    return inputs


def assert_all_that_follows(table):
    """Of the first step, and of the second one, where that is another."""
    centres = [np.convolve(axis.edges(), [0.5, 0.5], "valid") for axis in table.axes]
    states = np.stack([one.ravel() for one in np.meshgrid(*centres, indexing="ij")], axis=1)
    for step in range(1 if len(table.index) <= table.steps + 1 else 2):
        for within in range(1, table.steps - step + 1):
            less, here = (table.bits(start=step, within=n) for n in (within - 1, within))
            inputs = inputs_that_lead(table, step, table.bits(start=step + 1, within=within - 1))
            follows = inputs.any(axis=-1)
            assert np.array_equal(here, less & follows if table.problem.has_no_target else less | follows), (
                step,
                within,
            )
            found = table.certified_inputs(states, step, within).reshape(inputs.shape)
            assert np.array_equal(found, with_neighbours(inputs, table.axes, bool(table.problem.sensing))), (
                step,
                within,
            )
