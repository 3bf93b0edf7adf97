"""Certified sets: every obligation of the proof, the twins, closed forms and runs against adversaries."""

import dataclasses
import itertools
import math
from fractions import Fraction

import h5py
import naive_certified as naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toys import interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj.arm.case_studies import scene
from sdhj.certified import kernels
from sdhj.certified.arm import ArmRecursion, at_rest, pack
from sdhj.certified.cells import CellAxis, aligned_width, exact, measured, period_bounds
from sdhj.certified.general import Reach
from sdhj.certified.sets import CertifiedSets, LipschitzBounds, cell_axes, certify, unpack

ARM = np.array([0.15, 0.15, 1.0])
PRINTED = np.array([0.15, 0.30, 0.0])
PI = (Fraction(314159265358979323846, 10**20), Fraction(314159265358979323847, 10**20))
TARGET = {"radius": 0.14, "path": {"kind": "line", "start": [0.05, 0.2], "velocity": [0.1, -0.05]}}


def small_problem(**changes):
    """A case study of two long steps, with strong disturbances, for coarse cells."""
    numbers = {"u_max": 4.0, "v_d_max": 2.0, "v_p_max": 0.6, "input_levels": 3, "target": TARGET, "steps": 2}
    return sdhj.arm_case_study(nodes=9, **(numbers | changes))


@pytest.fixture(scope="module")
def small():
    """Its certified sets on 32 x 32 x 12 x 12 cells."""
    return certify(small_problem(), cells=(32, 32, 12, 12), parts=4, progress=False)


def blocks_to_bool(blocks, shape):
    nx, ny = shape
    rows = blocks.reshape(-1, blocks.shape[-1])
    return unpack(rows, nx * ny).reshape(*blocks.shape[:-1], nx, ny)


# --------------------------------------------------------------------------------------------------------------------
# Cells and images
# --------------------------------------------------------------------------------------------------------------------


def angle_axis(width=Fraction(3, 100)):
    return CellAxis(exact(-np.pi), period_bounds(-np.pi, np.pi), width, True)


def test_cells_partition_the_axis():
    for axis in (angle_axis(), CellAxis(exact(-0.36), (Fraction(72, 100),) * 2, Fraction(1, 50), False)):
        edges = axis.edges()
        assert np.all(np.diff(edges) > 0)
        assert edges[0] == float(axis.lower)
        assert edges[-1] == pytest.approx(float(axis.lower + axis.extent[0]), abs=2e-14)  # the doubt about 2 pi
        assert axis.shares().sum() == pytest.approx(1.0, abs=1e-12)
        assert (axis.count - 1) * axis.width < axis.extent[0] <= axis.extent[1] <= axis.count * axis.width
    low, high = angle_axis().extent
    assert low < 2 * PI[0] and 2 * PI[1] < high and high - low < Fraction(1, 10**13)
    assert period_bounds(0.0, 1.0) == (1, 1)  # a period that is a short decimal is exact


def test_cells_are_aligned_where_the_numbers_allow():
    axes = cell_axes(sdhj.arm_case_study(nodes=5, steps=1), (419, 419, 72, 72))
    assert [axis.width for axis in axes] == [Fraction(3, 200)] * 2 + [Fraction(1, 100)] * 2
    assert aligned_width(Fraction(1), True, [Fraction(1, 3)], 10) == Fraction(1, 9)
    assert aligned_width(Fraction(1), True, [Fraction(1, 3000001)], 10) == Fraction(1, 10)  # no sensible measure
    assert aligned_width(Fraction(1), True, [], 10) == Fraction(1, 10)


@given(
    st.booleans(),
    st.integers(50, 300),
    st.integers(3, 40),
    st.integers(-400, 400),
    st.integers(0, 100),
    st.sampled_from([0, 1]),
)
def test_image_holds_the_worst_adversary(periodic, extent, cells, drift, push, doubt):
    """The ends of the cell, moved by the extreme and the middle velocities, are in the cells of the image."""
    length = Fraction(extent, 100)
    width = length / cells if not periodic else length * 7 / (7 * cells - 3)  # a seam cell of 4/7 of the others
    error = doubt * periodic * length / 2**49  # only a period may be known to some digits
    axis = CellAxis(Fraction(0), (length - error, length + error), width, periodic)
    slow, fast = Fraction(drift - push, 100), Fraction(drift + push, 100)
    first, number = axis.image(slow, fast, Fraction(1))
    edges = axis.edges()
    for cell in range(axis.count):
        image = [(first[cell] + c) % axis.count for c in range(number[cell])]
        for x in np.linspace(edges[cell], edges[cell + 1], 4):
            for v in np.linspace(float(slow), float(fast), 3):
                y = x + v
                y = y % float(length) if periodic else min(max(y, 0.0), float(length))
                held = [edges[i] - 1e-9 <= y <= edges[i + 1] + 1e-9 for i in image]
                around = periodic and (y < 1e-9 or y > float(length) - 1e-9)  # either side of the seam
                assert any(held) or around, (cell, x, v)


def test_image_loses_nothing_where_cells_are_aligned():
    axis = angle_axis(Fraction(3, 200))
    first, number = axis.image(measured(1.2), measured(1.8), measured(0.1))
    inner = slice(0, axis.count - 30)
    np.testing.assert_array_equal(first[inner], np.arange(axis.count - 30) + 8)
    assert set(number[inner]) == {5}
    assert number.max() <= 7  # a cell more to each side across the seam


# --------------------------------------------------------------------------------------------------------------------
# Geometry
# --------------------------------------------------------------------------------------------------------------------


def hull_of(x, y):
    hull_x, hull_y = np.empty(2 * len(x)), np.empty(2 * len(x))
    size = kernels.convex_hull(x.copy(), y.copy(), len(x), hull_x, hull_y)
    return hull_x, hull_y, size


@pytest.mark.parametrize("arm", [ARM, PRINTED], ids=["relative", "printed"])
def test_hulls_hold_the_links(arm, rng):
    """Points of the links at random joint angles of a box lie in the hull thickened by the remainder, and need it."""
    needed = 0.0
    for _ in range(40):
        low, width = rng.uniform(-4, 4, 2), rng.uniform(0.0, 0.4, 2)
        ends = np.empty((2, 6))
        for axis in range(2):
            kernels.joint_ends(low[axis], low[axis] + width[axis], 0.0, 0.0, 0.0, 0.0, ends[axis])
        for link in range(2):
            x, y = np.empty(6), np.empty(6)
            n, remainder = kernels.link_points(link, ends[0], ends[1], arm, x, y)
            hull_x, hull_y, size = hull_of(x[:n], y[:n])
            for q1, q2, s in itertools.product(*(np.linspace(low, low + width, 5).T), (0.0, 0.6, 1.0)):
                elbow, tip = naive.elbow_and_tip(q1, q2, arm)
                a, b = ((0.0, 0.0), elbow) if link == 0 else (elbow, tip)
                point = (a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]))
                off = kernels.hull_distance(*point, hull_x, hull_y, size)
                assert off <= remainder + 1e-12  # rounding of a few sums of numbers below one
                needed = max(needed, off / max(remainder, 1e-300))
    assert needed > 0.5  # the remainder is no larger than it has to be by a factor of two


def cells_touched(x, y, radius, growth, plane, shape):
    hull_x, hull_y, size = hull_of(x, y)
    block = np.zeros(-(-shape[0] * shape[1] // 64), np.uint64)
    scratch = np.empty((2, 12, 4))
    kernels.touch_cells(
        hull_x, hull_y, size, radius, growth, plane, np.array(shape), 0, shape[0], scratch[0], scratch[1], block
    )
    return blocks_to_bool(block[None], shape)[0]


def test_pursuer_is_met_wherever_it_can_meet(rng):
    """The cells that touch a thick hull are those whose distance to it says so, for hulls of any kind of points."""
    for trial in range(120):
        points = rng.normal(size=(rng.integers(1, 7), 2)) * 0.15
        if trial % 3 == 0:
            points = points.round(1)  # many on one line, or equal
        shape = tuple(int(n) for n in rng.integers(4, 9, 2))
        plane = np.array([-0.36, -0.36, 0.72 / shape[0], 0.72 / shape[1]])
        radius, growth = rng.uniform(0.02, 0.1), rng.choice([0.0, 0.013])
        found = cells_touched(points[:, 0], points[:, 1], radius, growth, plane, shape)
        for i, k in itertools.product(range(shape[0]), range(shape[1])):
            x0, y0 = plane[0] + i * plane[2] - growth, plane[1] + k * plane[3] - growth
            box = (x0, y0, x0 + plane[2] + 2 * growth, y0 + plane[3] + 2 * growth)
            distance = naive.box_polygon_distance(box, [tuple(p) for p in points])
            if abs(distance - radius) > 1e-9:  # nearer than that, rounding may decide
                assert found[i, k] == (distance < radius)


def met_at_rest(offset):
    """Whether a pursuer's cell whose lower edge is `offset` beyond contact with a stretched arm is met."""
    edges = np.array([0.0, 0.0])  # a cell without width: the arm points along x
    contact = 0.05
    plane = np.array([0.0, contact + offset, 0.3, 0.1])
    clear = np.empty((1, 1, 1), np.uint64)
    still = at_rest(edges)
    kernels.pursuer_clear(still, still, 0.0, 0.0, contact, ARM, plane, np.array([1, 1]), clear)
    return clear[0, 0, 0] == 0


def disk_clear(*, centres, radius, speed=0.0, delta=0.0, depth=0, slow=(0.0, 0.0), fast=(0.0, 0.0), q=(0.0, 0.0)):
    """Whether the arm at q is clear of one disk through an interval of one step."""
    edges = [np.array([angle, angle]) for angle in q]
    instants = 2 ** (depth + 1) + 1
    centres = np.broadcast_to(np.asarray(centres, dtype=float), (instants, 2)).reshape(instants, 1, 1, 2).copy()
    out = np.empty((1, 1, 1, 1), np.bool_)
    kernels.disks_clear(
        *edges,
        np.array([slow]),
        np.array([fast]),
        delta,
        centres,
        np.array([radius]),
        np.array([speed]),
        depth,
        ARM,
        out,
    )
    return bool(out[0, 0, 0, 0])


def test_contact_within_rounding_is_not_clear():
    """What is apart by no more than rounding and slack explain counts as touching; a tenth of a millimetre does not."""
    assert met_at_rest(0.0) and met_at_rest(1e-10) and not met_at_rest(1e-4)
    for gap, clear in ((0.0, False), (1e-10, False), (1e-4, True)):
        assert disk_clear(centres=(0.1, 0.05 + gap), radius=0.05) == clear
    edges, inside = np.array([0.0, 0.0]), np.empty((1, 1), np.bool_)
    for gap, expected in ((0.0, False), (1e-10, False), (1e-4, True)):
        kernels.tip_inside(at_rest(edges), at_rest(edges), np.array([0.2, 0.0]), 0.1 + gap, ARM, inside)
        assert inside[0, 0] == expected


@pytest.mark.parametrize("depth", [0, 3])
def test_no_time_is_left_out(depth):
    """Contact at any one time of the interval counts, whoever moves."""
    times = np.linspace(0.0, 0.1, 2 ** (depth + 1) + 1)
    # a disk falls onto the arm at the end, or rises from it at the start: at mid-interval it is clear
    for path in (0.111 - 0.6 * times, 0.051 + 0.6 * times):
        path = np.stack([np.full_like(times, 0.2), path], axis=1)
        assert disk_clear(centres=path + np.array([0, 0.05]), radius=0.05, speed=0.6, delta=0.1, depth=depth)
        touching = path - [0, 0.0015]
        assert not disk_clear(centres=touching, radius=0.05, speed=0.6, delta=0.1, depth=depth)
    # the arm sweeps past a disk that is behind it in the end, or meets one only through a disturbance
    ahead = (0.25 * math.cos(0.15), 0.25 * math.sin(0.15))
    still = {"radius": 0.005, "delta": 0.1, "depth": depth}
    assert not disk_clear(centres=ahead, slow=(3.0, 0.0), fast=(3.0, 0.0), **still)
    assert disk_clear(centres=(-ahead[0], -ahead[1]), slow=(3.0, 0.0), fast=(3.0, 0.0), **still)
    assert not disk_clear(centres=ahead, slow=(-1.6, 0.0), fast=(1.6, 0.0), **still)
    assert not disk_clear(centres=ahead, slow=(-1.6, 0.0), fast=(1.0, 0.5), **still) or depth > 0


@pytest.mark.parametrize("parts", [1, 4])
def test_no_time_is_left_out_of_the_pursuit(parts):
    """The pursuer counts where it can be at the end of each part, and the arm where it passes."""

    def clear(offset, slow, fast, speed):
        moves = [np.empty((1, parts, 6)) for _ in range(2)]
        for axis in range(2):
            kernels.joint_moves(
                np.zeros(2), slow if axis == 0 else 0.0, fast if axis == 0 else 0.0, 0.1, parts, moves[axis]
            )
        plane = np.array([0.24, 0.05 + offset, 0.01, 0.01])
        out = np.empty((1, 1, 1), np.uint64)
        kernels.pursuer_clear(moves[0], moves[1], 0.1, speed, 0.05, ARM, plane, np.array([1, 1]), out)
        return out[0, 0, 0] == 1

    assert clear(0.021, 0.0, 0.0, 0.2) and not clear(0.019, 0.0, 0.0, 0.2)  # it comes 0.02 nearer
    assert not clear(0.03, 0.0, 3.0, 0.0)  # the arm comes to it
    assert clear(-0.15, 0.0, 0.0, 0.0) and not clear(-0.15, -3.0, 0.0, 0.0)  # and to the other side


def test_tubes_hold_every_sampled_motion(small, rng):
    """Motions from cells and inputs that are marked clear, with random and extreme adversaries, meet nothing."""
    problem, motion = small.problem, small.proof.motion
    stage = scene(problem)
    clear = [
        blocks_to_bool(words, small.shape[2:])
        for words in ArmRecursion(problem, small.axes, motion).clear_of_agent(NoBar())
    ]
    edges = [axis.edges() for axis in small.axes]
    least, checked = math.inf, 0
    while checked < 1000:
        cell = [int(rng.integers(n)) for n in small.shape]
        step, j = int(rng.integers(problem.steps)), int(rng.integers(len(problem.inputs)))
        if not (motion.allowed[step, j, cell[0], cell[1]] and clear[j][tuple(cell)]):
            continue
        checked += 1
        low = np.array([own[i] for own, i in zip(edges, cell, strict=True)])
        high = np.array([own[i + 1] for own, i in zip(edges, cell, strict=True)])
        states = np.where(rng.random((16, 4)) < 0.7, rng.choice([low, high], (16,)), rng.uniform(low, high, (16, 4)))
        push = rng.choice([-1.0, 1.0], (16, 4)) * problem.dynamics.bounds
        for tau in np.linspace(0.0, problem.delta, 9):
            moved = states + tau * (problem.dynamics.drift[j] + push)
            t = problem.time(step) + tau
            clearance = np.minimum(stage.obstacles_value(moved[:, :2], t), stage.pursuer_value(moved, t))
            least = min(least, clearance.min())
    assert 0.0 < least < 0.01  # never met, and the bounds are not loose by a centimetre


class NoBar:
    def update(self):
        pass


def test_goal_cells_are_inside_the_target(small, rng):
    problem, stage = small.problem, scene(small.problem)
    edges = [axis.edges() for axis in small.axes]
    for step in range(problem.steps + 1):
        cells = np.argwhere(small.bits(start=step, within=0))
        assert len(cells) > 100
        for cell in rng.permutation(cells)[:100]:
            low = np.array([own[i] for own, i in zip(edges, cell, strict=True)])
            high = np.array([own[i + 1] for own, i in zip(edges, cell, strict=True)])
            states = np.array(list(itertools.product(*zip(low, high, strict=True))))
            states = np.concatenate([states, rng.uniform(low, high, (16, 4))])
            t = problem.time(step)
            assert (stage.target_value(states[:, :2], t) < 0).all()
            assert (stage.obstacles_value(states[:, :2], t) > 0).all() and (stage.pursuer_value(states, t) > 0).all()


def test_no_goal_cell_is_left_out_by_much(small):
    """A cell whose states are inside the target by 2 mm and clear by 2 mm (at its corners and middle) is certified."""
    problem, stage = small.problem, scene(small.problem)
    mesh = [axis.edges() for axis in small.axes]
    goal = small.bits(start=1, within=0)
    t = problem.time(1)
    for cell in itertools.product(range(0, 31, 3), range(0, 31, 3), range(0, 12, 4), range(0, 12, 4)):
        ends = [np.linspace(own[i], own[i + 1], 5) for own, i in zip(mesh, cell, strict=True)]
        states = np.stack([grid.ravel() for grid in np.meshgrid(*ends)], axis=1)
        deep = stage.target_value(states[:, :2], t).max() < -0.002
        free = min(stage.obstacles_value(states[:, :2], t).min(), stage.pursuer_value(states, t).min()) > 0.002
        assert goal[cell] or not (deep and free)


# --------------------------------------------------------------------------------------------------------------------
# Recursion
# --------------------------------------------------------------------------------------------------------------------


def test_recursion_agrees_with_the_twin(small):
    problem, motion = small.problem, small.proof.motion
    _, _, nx, ny = small.shape
    clear = ArmRecursion(problem, small.axes, motion).clear_of_agent(NoBar())
    for step, within in ((0, 1), (0, 2)):
        following = small.bits(start=step + 1, within=within - 1)
        expected = small.bits(start=step, within=within - 1).copy()
        for j in range(len(problem.inputs)):
            first = [motion.first[axis, j, : small.shape[axis]] for axis in range(2)]
            number = [motion.number[axis, j, : small.shape[axis]] for axis in range(2)]
            found = naive.one_step(
                following, first, number, motion.window, motion.allowed[step, j], blocks_to_bool(clear[j], (nx, ny))
            )
            for cell in found:
                expected[cell] = True
        np.testing.assert_array_equal(small.bits(start=step, within=within), expected)
    assert small.fraction(start=0, within=2) > small.fraction(start=0, within=1) > small.fraction(start=0, within=0) > 0


def test_packed_erosion_agrees_with_shifted_arrays(rng):
    """On sizes that do and do not fill words, with windows that are clipped at the walls."""
    for nx, ny, reach in ((5, 7, 1), (8, 8, 2), (12, 12, 3)):
        window = np.stack(
            [
                np.stack([np.maximum(np.arange(12) - reach, 0), np.minimum(np.arange(12) + reach, n - 1)])
                for n in (nx, ny)
            ]
        )
        shifts, passes = sdhj.certified.arm.packed_window(window, nx, ny)
        bits = rng.random((6, nx * ny)) < 0.9
        words = -(-nx * ny // 64)
        padded = np.zeros((6, words * 64), np.bool_)
        padded[:, : nx * ny] = bits
        blocks = pack(padded)
        kernels.erode_packed(blocks, shifts, passes)
        expected = np.array(
            [
                [
                    [row[max(x - reach, 0) : x + reach + 1, max(y - reach, 0) : y + reach + 1].all() for y in range(ny)]
                    for x in range(nx)
                ]
                for row in bits.reshape(6, nx, ny)
            ]
        )
        np.testing.assert_array_equal(unpack(blocks, nx * ny).reshape(6, nx, ny), expected)
        np.testing.assert_array_equal(kernels.count_bits(blocks), expected.sum(axis=(1, 2)))


def test_finer_cells_certify_more():
    fractions = [
        certify(small_problem(steps=1), cells=cells, parts=4, progress=False).fraction(start=0, within=1)
        for cells in ((32, 32, 12, 12), (63, 63, 12, 12), (63, 63, 24, 24))
    ]
    assert fractions == sorted(fractions) and fractions[2] > fractions[0] + 0.01


def test_evader_is_certified_too(rng):
    problem = sdhj.evader_case_study(
        nodes=9, steps=2, u_max=4.0, v_d_max=1.0, v_e_max=0.3, input_levels=3, evader_radius=0.14, obstacles=()
    )
    sets = certify(problem, cells=(63, 63, 24, 24), parts=4, progress=False)
    assert sets.fraction(start=0, within=2) > sets.fraction(start=0, within=0) > 0.001
    states = states_in(sets, rng, 2000)
    inside = sets.contains(states, start=0, within=0)
    assert (problem.target_value(states[inside], 0.0) < 0).all() and inside.any()
    assert_runs_succeed(sets, states, rng)


# --------------------------------------------------------------------------------------------------------------------
# Questions about states
# --------------------------------------------------------------------------------------------------------------------


def states_in(sets, rng, count, within=None):
    """Random states of S_0."""
    grid = sets.problem.grid
    within = sets.problem.steps if within is None else within
    found = []
    while sum(map(len, found)) < count:
        states = rng.uniform(grid.lower, grid.upper, (20000, grid.ndim))
        found.append(states[sets.contains(states, start=0, within=within)])
    return np.concatenate(found)[:count]


def steps_to_go(sets, states, step):
    out = np.full(len(states), 99)
    for within in range(sets.problem.steps - step, -1, -1):
        out[sets.contains(states, start=step, within=within)] = within
    return out


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


def assert_runs_succeed(sets, states, rng, pieces=8, fine=3):
    """From every state a certified input leads, against adversaries that switch within the step, one step nearer."""
    problem = sets.problem
    for step in range(problem.steps + 1):
        left = steps_to_go(sets, states, step)
        assert left.max(initial=0) <= problem.steps - step
        there = left == 0
        assert (problem.target_value(states[there], problem.time(step)) <= 0).all()
        states, left = states[~there], left[~there]
        if not len(states):
            return
        safe = np.empty((len(states), len(problem.inputs)), np.bool_)
        for n in np.unique(left):
            safe[left == n] = sets.certified_inputs_many(states[left == n], step, int(n))
        assert safe.any(axis=1).all()
        chosen = (safe * rng.random(safe.shape)).argmax(axis=1)
        drift = np.empty_like(states)
        for piece in range(pieces):
            sign = rng.choice([-1.0, 1.0], (len(states), problem.dynamics.bounds.size))
            for part in range(fine):
                for j in np.unique(chosen):
                    drift[chosen == j] = problem.dynamics.drift_at(states[chosen == j], j)
                push = np.einsum("mid,md->mi", problem.dynamics.gain_at(states), sign * problem.dynamics.bounds)
                states = held(problem, states + problem.delta / pieces / fine * (drift + push))
                t = problem.time(step) + problem.delta * (piece + (part + 1) / fine) / pieces
                assert (problem.unsafe_value(states, t) > 0).all()
        assert (steps_to_go(sets, states, step + 1) < left).all()


def test_runs_from_certified_states_succeed(small, rng):
    assert_runs_succeed(small, states_in(small, rng, 20000), rng)


def test_runs_from_edges_of_cells_succeed(small, rng):
    """With adversaries at their bounds the states stay on edges of cells, up to rounding."""
    edges = [axis.edges() for axis in small.axes]
    states = np.stack([rng.choice(own[:-1], 40000) for own in edges], axis=1)
    states = states[small.contains(states, start=0, within=2)]
    assert len(states) > 1000
    assert_runs_succeed(small, states, rng, pieces=1, fine=1)


def test_state_on_an_edge(small):
    """A state that rounding has pushed out of a certified cell still has that cell's inputs; one beyond has none."""
    inside = small.bits(start=0, within=2)
    last = np.argwhere(inside[:-1] & ~inside[1:])[0]
    edges = [axis.edges() for axis in small.axes]
    state = np.array([(own[i] + own[i + 1]) / 2 for own, i in zip(edges, last, strict=True)])
    inputs = []
    for off in (-1e-6, 0.0, 5e-11):
        state[0] = edges[0][last[0] + 1] + off
        assert small.contains(state, start=0, within=2).all()
        inputs.append(list(small.certified_inputs(state, 0, 2)))
    assert inputs[0] == inputs[1] == inputs[2] or not small.contains(state, start=0, within=2).all()
    state[0] = edges[0][last[0] + 1] + 1e-6
    assert not small.contains(state, start=0, within=2).any()
    assert small.certified_inputs(state, 0, 2).size == 0


def test_every_certified_state_has_an_input(small, rng):
    """In every certified cell, and exactly the inputs that the recursion found there, but for the halved margin."""
    problem, motion = small.problem, small.proof.motion
    clear = [
        blocks_to_bool(words, small.shape[2:])
        for words in ArmRecursion(problem, small.axes, motion).clear_of_agent(NoBar())
    ]
    new = small.bits(start=0, within=2) & ~small.bits(start=0, within=1)
    cells = rng.permutation(np.argwhere(new))[:400]
    following = small.bits(start=1, within=1)
    edges = [axis.edges() for axis in small.axes]
    for cell in cells:
        state = np.array([(own[i] + own[i + 1]) / 2 for own, i in zip(edges, cell, strict=True)])
        found = set(small.certified_inputs(state, 0, 2))
        expected = set()
        for j in range(len(problem.inputs)):
            boxes = [
                (motion.first[axis, j, cell[axis]] + np.arange(motion.number[axis, j, cell[axis]])) % small.shape[axis]
                for axis in range(2)
            ]
            boxes += [
                np.arange(motion.window[a, 0, cell[2 + a]], motion.window[a, 1, cell[2 + a]] + 1) for a in range(2)
            ]
            if motion.allowed[0, j, cell[0], cell[1]] and clear[j][tuple(cell)] and following[np.ix_(*boxes)].all():
                expected.add(j)
        assert expected and expected == found


def test_outside_is_said(small):
    far = np.array([[0.0, 0.0, 1.0, 0.0]])
    assert not small.contains(far, start=0, within=2).any()
    assert small.certified_inputs(far[0], 0, 2).size == 0
    with pytest.raises(ValueError, match="NaN"):
        small.contains(np.full((1, 4), np.nan), start=0, within=2)
    with pytest.raises(ValueError, match=r"shape \(M, 4\)"):
        small.contains(np.zeros((1, 3)), start=0, within=2)
    with pytest.raises(ValueError, match="start must be a whole number from 0 to 2"):
        small.contains(far, start=3, within=0)
    with pytest.raises(ValueError, match="within must be a whole number"):
        small.contains(far, start=0, within=-1)


def test_angles_wrap(small, rng):
    states = states_in(small, rng, 500)
    turned = states + np.array([2 * np.pi, -2 * np.pi, 0.0, 0.0])
    assert small.contains(turned, start=0, within=2).all()


def test_fractions_are_shares_of_volume(small, rng):
    grid = small.problem.grid
    states = rng.uniform(grid.lower, grid.upper, (100_000, 4))
    share = small.contains(states, start=0, within=2).mean()
    assert share == pytest.approx(small.fraction(start=0, within=2), abs=4 * math.sqrt(0.25 / 100_000))


def test_sets_survive_a_file(small, tmp_path, rng):
    with h5py.File(tmp_path / "sets.h5", "w") as file:
        small.save(file.create_group("certified"))
    with h5py.File(tmp_path / "sets.h5") as file:
        again = CertifiedSets.load(file["certified"], small.problem)
        with pytest.raises(ValueError, match="other numbers"):
            CertifiedSets.load(file["certified"], small_problem(v_d_max=1.9))
    states = states_in(small, rng, 300)
    for within in (1, 2):
        np.testing.assert_array_equal(again.bits(start=0, within=within), small.bits(start=0, within=within))
        np.testing.assert_array_equal(
            again.certified_inputs_many(states, 0, within), small.certified_inputs_many(states, 0, within)
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cells": (32, 32, 12)}, "cells must be"),
        ({"cells": (1, 32, 12, 12)}, "cells must be"),
        ({"parts": 0}, "parts must be"),
    ],
)
def test_options_are_checked(options, message):
    with pytest.raises(ValueError, match=message):
        certify(small_problem(), progress=False, **options)


def test_sizes_beyond_the_margin_are_refused():
    with pytest.raises(ValueError, match="lengths up to"):
        certify(small_problem(lengths=(8.0, 8.0), target=TARGET | {"radius": 14.0}, obstacles=()), progress=False)


# --------------------------------------------------------------------------------------------------------------------
# Any dynamics
# --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [1, 3, 5])
def test_closed_form_on_a_line(steps):
    """|q| <= 1 + n (1 - 0.2) 0.5, cut where the wall at 3 may be touched: cells of 0.1 tell it to within one cell."""
    problem = interval_problem(steps=steps)
    bounds = LipschitzBounds(sets={"target": [1.0], "wall": [1.0]})
    sets = certify(problem, cells=(80,), bounds=bounds, progress=False)
    assert sets.axes[0].width == Fraction(1, 10)
    for within in range(steps + 1):
        inside = sets.bits(start=0, within=within)
        edges = sets.axes[0].edges()
        low, high = edges[:-1][inside].min(), edges[1:][inside].max()
        reach = 1 + 0.4 * within
        assert inside.sum() == round((high - low) / 0.1)  # no gap
        # the layer of cells that the margin and the target's edge cost, once: nothing is lost from step to step
        assert -reach - 1e-9 <= low <= -reach + 0.1 + 1e-9
        assert min(reach, 3.0) - 0.1 - 1e-9 <= high <= min(reach, 3.0) + 1e-9


def test_moving_obstacle_is_met_between_the_samples(rng):
    problem = torus_problem()
    bounds = LipschitzBounds(sets={"target": [1.0, 1.0], "orbiting disk": [1.0, 1.0]})
    sets = certify(problem, cells=(80, 80), bounds=bounds, progress=False)
    assert sets.fraction(start=0, within=3) > 1.5 * sets.fraction(start=0, within=0) > 0.01
    assert_runs_succeed(sets, states_in(sets, rng, 20000), rng)


UNICYCLE = LipschitzBounds(
    dynamics=np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0, 0]]), sets={"target": [1.0, 1.0], "pillar": [1.0, 1.0]}
)


def test_general_reach_box_holds_every_trajectory(rng):
    problem = unicycle_problem()
    reach = Reach(problem, np.asarray(UNICYCLE.dynamics), 5)
    low = rng.uniform([-1.4, -1.4, -3], [1.3, 1.3, 3], (300, 3))
    high = low + rng.uniform(0, 0.1, (300, 3))
    for j in range(3):
        tube, first, last = reach.run(low.copy(), high.copy(), j)
        for _ in range(10):
            states = np.where(rng.random((300, 3)) < 0.5, low, high)
            sign = rng.choice([-1.0, 1.0], (300, 2)) * 0.1
            for part in range(200):  # Euler steps of a thousandth: off by less than 1e-3 in all
                push = np.einsum("mid,md->mi", problem.dynamics.gain_at(states), sign)
                states = states + 0.001 * (problem.dynamics.drift_at(states, j) + push)
                boxes = tube[part * 5 // 200]
                states[:, :2] = np.clip(states[:, :2], -1.5, 1.5)
                assert (np.abs(states - boxes.centre) <= boxes.half + 5e-4).all()
            assert (first - 5e-4 <= states).all() and (states <= last + 5e-4).all()
    # the image of a point is small: twice what the disturbance and the walls explain
    point = np.zeros((1, 3))
    _, first, last = reach.run(point.copy(), point.copy(), 1)
    assert ((last - first)[0] <= 2 * np.array([0.04, 0.04, 1e-6])).all()


def test_general_bounds_hold_over_boxes_and_times(rng):
    """The lower bound of a level set is below its value at every state and time of the boxes."""
    problem = torus_problem()
    disk = problem.unsafe[0]
    reach = Reach(problem, np.zeros((2, 2)), 2)
    low = rng.uniform(-3, 3, (500, 2))
    tube, _, _ = reach.run(low, low + rng.uniform(0, 0.3, (500, 2)), 0)
    for boxes in tube:
        bound = reach.least(disk, boxes, np.array([1.0, 1.0]), 0.4, disk.rate)
        for _ in range(30):
            states = boxes.centre + boxes.half * rng.uniform(-1, 1, (500, 2))
            for tau in (boxes.begin, boxes.end):
                assert (bound <= disk.level_set(states, 0.4 + tau)).all()


def test_unicycle_runs_succeed(rng):
    problem = unicycle_problem()
    sets = certify(problem, cells=(60, 60, 60), bounds=UNICYCLE, progress=False)
    assert sets.fraction(start=0, within=3) > 1.3 * sets.fraction(start=0, within=0) > 0.01
    assert_runs_succeed(sets, states_in(sets, rng, 5000), rng, pieces=4, fine=10)


def test_general_and_arm_agree_on_the_arm():
    """The general method, with Lipschitz bounds of the arm, certifies a part of what the arm's geometry does."""
    arm = [0.30, 0.15]
    bounds = LipschitzBounds(sets={"target": arm, "obstacles": arm, "pursuer": [*arm, 1.0, 1.0]})
    problem = small_problem(steps=1)
    general = certify(problem, cells=(32, 32, 5, 5), bounds=bounds, parts=4, progress=False)
    special = certify(problem, cells=(32, 32, 5, 5), parts=4, progress=False)
    for within in (0, 1):
        rough, fine = general.bits(start=0, within=within), special.bits(start=0, within=within)
        assert rough.any() and not (rough & ~fine).any()


def test_bounds_are_asked_for():
    with pytest.raises(ValueError, match="no Lipschitz bounds for the sets 'target', 'wall': give"):
        certify(interval_problem(), progress=False)
    with pytest.raises(ValueError, match="depend on the state"):
        certify(unicycle_problem(), bounds=LipschitzBounds(sets=UNICYCLE.sets), progress=False)
    with pytest.raises(ValueError, match=r"\(3, 3\) matrix"):
        certify(unicycle_problem(), bounds=LipschitzBounds(np.eye(2), UNICYCLE.sets), progress=False)
    with pytest.raises(ValueError, match="2 finite numbers"):
        certify(
            unicycle_problem(),
            bounds=LipschitzBounds(UNICYCLE.dynamics, {"target": [1.0], "pillar": [1, 1]}),
            progress=False,
        )
    with pytest.raises(ValueError, match="more parts"):
        certify(
            unicycle_problem(), bounds=LipschitzBounds(np.full((3, 3), 9.0), UNICYCLE.sets), parts=1, progress=False
        )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"sets": {"pillar": [0.9, 1.0]}},
            "'pillar' changes by .* along the axis 'x'.* bound 0.9 allows .* at least 1",
        ),
        ({"sets": {"target": [1.0, 0.0]}}, "'target' changes by .* along the axis 'y'.* bound 0 allows"),
        ({"sets": {"pillars": [1.0, 1.0]}}, "bounds for 'pillars', but the problem's sets are 'target', 'pillar'"),
        ({"dynamics": 0.9}, "velocity along 'x' under input 0 changes by .* along the axis 'theta'.* give a bound"),
    ],
)
def test_bounds_that_a_look_at_the_functions_refutes(change, told):
    sets = dict(UNICYCLE.sets) | change.get("sets", {})
    bounds = LipschitzBounds(np.array(UNICYCLE.dynamics) * change.get("dynamics", 1.0), sets)
    with pytest.raises(ValueError, match=told):
        certify(unicycle_problem(), bounds=bounds, progress=False)


def test_a_gain_that_depends_on_the_state_counts_in_full():
    """d/dx (v x) is as large as v gets: 0.1."""
    problem = interval_problem()
    dynamics = sdhj.Dynamics([[0.0]], lambda q, u: 0.0 * q, lambda q: q[:, :, None], [0.1])
    problem = dataclasses.replace(problem, dynamics=dynamics)
    for bound in (0.1, 0.099):
        bounds = LipschitzBounds([[bound]], {"target": [1.0], "wall": [1.0]})
        if bound == 0.1:
            assert certify(problem, cells=[40], bounds=bounds, progress=False).bits(start=0, within=0).any()
        else:
            with pytest.raises(ValueError, match=r"bound 0\.099 allows"):
                certify(problem, cells=[40], bounds=bounds, progress=False)


@pytest.mark.parametrize("part", ["level set", "drift"])
def test_no_lipschitz_bound_holds_across_a_jump_at_the_seam(part):
    """A set written for angles as plain numbers ends where the axis closes; boxes of tubes reach across."""
    jump = part == "level set"
    problem = sdhj.ReachAvoidProblem(
        sdhj.Grid([-np.pi], [np.pi], [40], [True]),
        sdhj.Dynamics(
            [[-1.0], [1.0]], lambda q, u: u + (0 if jump else 0.1) * q, lambda q: np.ones((len(q), 1, 1)), [0.1]
        ),
        sdhj.TargetSet((0,), lambda q, t: np.abs(q[:, 0]) - 1.0),
        (sdhj.UnsafeSet((0,), lambda q, t: np.abs(q[:, 0] - (2.9 if jump else 0.0)) - 0.2 + 3.0 * (not jump)),),
        0.2,
        2,
    )
    bounds = LipschitzBounds(dynamics=[[0.1]], sets={"target": [1.0], "unsafe": [1.0]})
    with pytest.raises(ValueError, match=f"{part}.*jumps by .* periodic axis 'x1' closes"):
        certify(problem, cells=[50], bounds=bounds, progress=False)


def test_a_set_that_jumps_at_the_seam_at_some_times_only_is_refused():
    """Its centre is at the middle of the axis at every t_k, where the distance that nobody wrapped is periodic."""
    part = sdhj.UnsafeSet(
        (0,), lambda p, t: np.abs(p[:, 0] - 2.9 * np.sin(np.pi * t)) - 0.3, rate=2.9 * np.pi, name="disk"
    )
    target = sdhj.TargetSet((0,), lambda p, t: np.maximum(2.0 - np.abs(p[:, 0]), 0.5 - t))
    dynamics = sdhj.Dynamics([[0.0]], [[0.0]], [[1.0]], [0.1])
    problem = sdhj.ReachAvoidProblem(sdhj.Grid([-np.pi], [np.pi], [64], [True]), dynamics, target, (part,), 1.0, 1)
    bounds = LipschitzBounds(sets={"target": [1.0], "disk": [1.0]})
    with pytest.raises(ValueError, match=r"'disk' at t = .* jumps by .* periodic axis 'x1' closes"):
        certify(problem, cells=[400], bounds=bounds, progress=False)


def test_bounds_of_two_sets_of_one_name_are_not_told_apart():
    problem = interval_problem(steps=1)
    steep = sdhj.UnsafeSet((0,), lambda p, t: 5.0 * (3.5 + p[:, 0]), name="wall")
    problem = dataclasses.replace(problem, unsafe=(*problem.unsafe, steep))
    with pytest.raises(ValueError, match="two of the sets have one name"):
        certify(problem, cells=[40], bounds=LipschitzBounds(sets={"target": [1.0], "wall": [1.0]}), progress=False)
