"""Problems of one's own: growth boxes, level sets over boxes, closed forms and runs."""

import dataclasses
import itertools
from fractions import Fraction

import naive_certified as naive
import numpy as np
import pytest
from forged_robots import ROBOTS
from forging import forged
from zoo import interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj.certified.bounds import Bounds
from sdhj.certified.check import verify
from sdhj.certified.general_proof import GeneralProof, counted_boxes
from sdhj.kernels.packed import Cells, to_words
from sdhj.kernels.pieces import move_on
from sdhj.kernels.stencils import box_of_image, rows_inside

HEADING = [[0, 0, 1.0], [0, 0, 1.0], [0, 0, 0]]  # how fast the unicycle's velocity changes along each axis


def certified(problem, **options):
    return sdhj.solve(problem, sdhj.Certified(**options), progress=False)


def proof_of(problem, cells, parts=5):
    """Nothing solved: what one interval does."""
    return GeneralProof.of(problem, sdhj.Certified(cells=cells).axes(problem), parts)


def opaque_unicycle():
    """The same, but its functions cannot be read: their author says how fast they change."""
    problem = unicycle_problem()
    field = problem.dynamics

    def drift(points, u, t):
        return field.drift_at(points, [-2.0, 0.0, 2.0].index(float(u[0])), t)

    box = sdhj.BlackBox(drift, reads=[2], slope=HEADING, rate=0.0)
    dynamics = sdhj.Dynamics(field.inputs, box, [[1, 0], [0, 1], [0, 0]], [0.1, 0.1])
    boxed = [
        dataclasses.replace(part, level_set=sdhj.BlackBox(part.level_set, slope=1.0, rate=0.0))
        for part in (problem.target, *problem.unsafe)
    ]
    return dataclasses.replace(problem, dynamics=dynamics, target=boxed[0], unsafe=boxed[1:])


@pytest.mark.slow
@pytest.mark.parametrize("problem", [unicycle_problem, opaque_unicycle], ids=["formulas", "black boxes"])
def test_general_reach_box_holds_every_trajectory(rng, problem):
    problem = problem()
    proof = proof_of(problem, (30, 30, 40))
    turns = 48 if problem.dynamics.formulas else 40  # .4 rad in an interval are 3 cells where that is known
    assert proof.low.shape[2:] == (30 * 30 * turns, 3)  # the axes with walls count
    places = np.concatenate([rng.integers(0, proof.low.shape[2], 300), [0, 30 * 30 * turns - 1]])
    edges, cells = naive.edges_of(proof), proof.cells_at(places)
    low, high = edges[range(3), cells], edges[range(3), cells + 1]
    for j in range(3):
        tubes, last = proof.tubes_of_places(places, j, 0.0, 2)
        for _ in range(10):
            states = np.where(rng.random(low.shape) < 0.5, low, high)
            sign = rng.choice([-1.0, 1.0], (len(low), 2)) * 0.1
            for step in range(200):  # Euler steps of a thousandth: off by less than 1e-3 in all
                push = np.einsum("mid,md->mi", problem.dynamics.gain_at(states), sign)
                states = states + 0.001 * (problem.dynamics.drift_at(states, j) + push)
                states[:, :2] = np.clip(states[:, :2], -1.5, 1.5)
                tube = tubes[:, step * 5 // 200]
                assert ((low + tube[..., 0] - 5e-4 <= states) & (states <= high + tube[..., 1] + 5e-4)).all()
            assert ((low + last[..., 0] - 5e-4 <= states) & (states <= high + last[..., 1] + 5e-4)).all()


def test_damped_motion_shrinks():
    """dx = -x: the ends of a cell come nearer to each other, as exp(-t) says; a bound on |d f/dx| cannot tell."""
    dynamics = sdhj.Dynamics([[0.0]], lambda q, u: -q, [[0.0]], [0.0])
    problem = dataclasses.replace(interval_problem(unsafe=False, ends="unsafe"), dynamics=dynamics)
    proof = proof_of(problem, (80,), parts=10)
    _, last = proof.tubes_of_places(np.array([60]), 0, 0.0, 8)
    low, high = proof.axes[0].edges()[60:62]
    exact = [low * np.exp(-0.5), high * np.exp(-0.5)]
    found = [low + last[0, 0, 0], high + last[0, 0, 1]]
    assert exact[0] - 0.01 < found[0] <= exact[0] and exact[1] <= found[1] < exact[1] + 0.01
    assert found[1] - found[0] < high - low


def test_what_a_piece_adds_is_rounded_outward(rng):
    """Against fractions, for a piece that is longer by what its length is off."""
    moved, h, velocity = rng.normal(size=(2, 1000, 2)), float(rng.uniform(0.01, 0.1)), rng.normal(size=(2, 1000, 2))
    longer, found, still = Fraction(h) * (1 + Fraction(5, 10**16)), moved.copy(), moved.copy()
    move_on(found, velocity, h)
    for up in (0, 1):
        for a, v, b in zip(moved[up].flat, velocity[up].flat, found[up].flat, strict=True):
            exact = [Fraction(a) + length * Fraction(v) for length in (Fraction(h), longer)]
            assert max(exact) <= b if up else b <= min(exact)
    assert (np.abs(found - moved - h * velocity) < 8 * np.spacing(np.abs(moved) + 1.0)).all()
    move_on(still, 0.0 * velocity, h)
    assert np.array_equal(still, moved)


def test_what_is_not_read_is_carried_along():
    """A car's velocity depends on its heading alone: so do its images, exactly where nothing moves."""
    problem = unicycle_problem()
    grid = sdhj.Grid([-1.5, -1.5, -np.pi], [1.5, 1.5, np.pi], (17, 17, 16), [False, False, True])
    still = sdhj.Dynamics(
        [[0.0, 0.0]], lambda q, u: u[0] * np.stack([np.cos(q[:, 2])] * 3, axis=1), np.zeros((3, 1)), [0.0]
    )
    proof = proof_of(dataclasses.replace(problem, grid=grid), (30, 30, 40))
    assert proof.low.shape == (1, 3, 48, 3) and proof.strides.tolist() == [0, 0, 1]
    proof = proof_of(dataclasses.replace(problem, grid=grid, dynamics=still), (30, 30, 40))
    proof.prepare(False)
    assert not proof.low.any() and not proof.high.any()


def fenced(back=0.0):
    """A cart on a swell, and a pursuer within a fence; back: how strongly it is drawn to the middle."""

    def drift(q, u):
        return np.stack([u[0] + 0.2 * np.cos(q[:, 1]), 0 * q[:, 1] + 1.0, -back * q[:, 2]], axis=1)

    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1, 0, -1], [1, 6, 1], [9, 9, 9], [False, True, False], ends=["unsafe", "unsafe", "wall"]),
        sdhj.Dynamics([[-1.0], [0.0], [1.0]], drift, [[0.0], [0.0], [1.0]], [0.5]),
        sdhj.TargetSet((0,), lambda p, t: 0.5 - p[:, 0]),
        [sdhj.UnsafeSet((0, 2), lambda p, t: np.abs(p[:, 0] - p[:, 1]) - 0.2, name="pursuer")],
        0.2,
        3,
    )


@pytest.mark.slow
def test_at_a_fence_cells_move_alike_where_the_velocity_is_always_in_one_range(rng, tmp_path):
    """Against pursuers that turn round at random times, from cells at the fence and beside it."""
    proof = proof_of(fenced(0.1), (20, 6, 20))
    assert (proof.strides > 0).tolist() == [False, True, True]
    table = sdhj.solve(fenced(), sdhj.Certified(cells=(20, 6, 20)))
    proof, edges = table.proof, table.axes[2].edges()
    assert (proof.strides > 0).tolist() == [False, True, False]
    for cell in (0, 1, 10, 18, 19):
        where = rng.uniform(edges[cell], edges[cell + 1], 500)
        for _ in range(20):
            where = np.clip(where + 0.01 * rng.choice([-0.5, 0.0, 0.5], 500), -1.0, 1.0)
        first, last = (int(np.clip(cell + far[0, 0, 0, 2], 0, 19)) for far in (proof.low, proof.high))
        assert edges[first] <= where.min() and where.max() <= edges[last + 1]
    table.save(tmp_path / "fenced.npz")
    assert table.fraction() > table.fraction(within=0) > 0.0 and verify(tmp_path / "fenced.npz").ok


@pytest.mark.slow
def test_no_state_of_a_clear_cell_is_met(rng):
    """Of drawn states, at all times of a step, under drawn plays."""
    problem, cells, parts = ROBOTS["pursued"][0](), *ROBOTS["pursued"][1:]
    proof, runs, met = proof_of(problem, cells, parts), 40_000, 0
    proof.prepare(False)
    clear = np.unpackbits(proof.bits_of_clear[0], axis=-1, bitorder="little", count=4).astype(bool)
    assert 0.1 < clear.mean() < 0.9
    states = rng.uniform(problem.grid.lower, problem.grid.upper, (runs, 3))
    own = [np.searchsorted(axis.edges(), q, "right") - 1 for axis, q in zip(proof.axes, states.T, strict=True)]
    numbers = np.ravel_multi_index(own, [axis.count for axis in proof.axes])
    for step, j in itertools.product(range(problem.steps), range(4)):
        q, push = states.copy(), rng.choice([-1.0, 1.0], (runs, 3)) * [0.4, 0.1, 0.1]
        hit = np.zeros(runs, bool)
        for t in np.linspace(0.0, problem.delta, 11):
            at = q + t * (problem.dynamics.inputs[j] @ np.eye(3)[1:] + push)
            at[:, 0] = np.clip(at[:, 0], -1.0, 1.0)
            hit |= problem.unsafe_value(problem.grid.wrapped(at), problem.time(step) + t) <= 0
        assert not (hit & clear[step, numbers, j]).any()
        met += int(hit.sum())
    assert met > 1000


@pytest.mark.slow
def test_images_and_tubes_count_in_cells(rng):
    """Against 200 motions from each: which cells a box of states overlaps, which of them may meet a moving disk."""
    problem = torus_problem()
    proof = proof_of(problem, (40, 30), parts=2)
    proof.prepare(False)
    (disk,), counts, seen, (bits,) = problem.unsafe, proof.cells.counts, set(), proof.bits_of_clear
    edges = naive.edges_of(proof)
    for j, number in itertools.product((0, 4, 8), rng.integers(0, counts.prod(), 25)):
        cell = np.array(np.unravel_index(number, counts))
        low, high = edges[[0, 1], cell], edges[[0, 1], cell + 1]
        place = int((cell * proof.strides).sum())
        inside = [
            {(int(cell[a]) + k) % counts[a] for k in range(proof.low[0, j, place, a], proof.high[0, j, place, a] + 1)}
            for a in (0, 1)
        ]
        velocity = problem.dynamics.arrays[0][j]
        for step in range(problem.steps):
            hit, states, signs = False, rng.uniform(low, high, (200, 2)), rng.uniform(-0.4, 0.4, (200, 2))
            for tau in np.linspace(0.0, 0.2, 9):
                at = (states + tau * (velocity + signs) + np.pi) % (2 * np.pi) - np.pi
                hit |= bool((disk.level_set(at, problem.time(step) + tau) <= 0).any())
            for a in (0, 1):  # at the end
                assert set(np.searchsorted(proof.axes[a].edges(), at[:, a], side="right") - 1) <= inside[a]
            clear = bool(bits[step, number, j // 8] >> (j % 8) & 1)
            assert not (hit and clear)
            seen.add((hit, clear))
    assert seen == {(True, False), (False, True), (False, False)}


def test_general_bounds_hold_over_boxes_and_times(rng):
    """A level set's bounds hold at every state and time of the boxes, also those that follow from what is declared."""
    problem = torus_problem()
    (disk,) = problem.unsafe
    hidden = sdhj.BlackBox(disk.level_set, slope=1.0, rate=2.0)
    low = rng.uniform(-3, 3, (500, 2))
    high = low + rng.uniform(0, 0.3, (500, 2))
    for part in (disk, dataclasses.replace(disk, level_set=hidden)):
        least, most = Bounds(problem).bounds_of_level_set(part, low, high, 0.4, 0.45)
        assert (least > -2.0).all() and np.median(most - least) < 0.6
        for _ in range(50):
            states = rng.uniform(low, high)
            for t in (0.4, 0.43, 0.45):
                value = problem.value_of(disk, states, t)
                assert (least <= value).all() and (value <= most).all()


def test_signs_are_those_of_each_box_and_of_its_pieces(rng):
    """Without halving a box is told as its bounds tell; with it, more boxes are, and points of them agree."""
    problem = torus_problem()
    part = sdhj.UnsafeSet((0, 1), lambda p, t: p[:, 0] * (p[:, 0] - p[:, 1]) + p[:, 1] - 0.5 + t)
    bounds = Bounds(problem)
    cuts = [np.linspace(-3.0, 3.0, n + 1) for n in (53, 41)]
    low, high = [cut[:-1] - 0.01 for cut in cuts], [cut[1:] + 0.01 for cut in cuts]
    boxes = [np.stack([a.ravel() for a in np.meshgrid(*ends, indexing="ij")], axis=1) for ends in (low, high)]
    least, most = bounds.bounds_of_level_set(part, *boxes, 0.1, 0.15)
    once = bounds.signs(part, low, high, (0.1, 0.15))
    assert np.array_equal(once.ravel(), np.where(least > 0, 1, np.where(most <= 0, -1, 0)))
    halved = bounds.signs(part, low, high, (0.1, 0.15), 4)
    assert (halved[once != 0] == once[once != 0]).all() and {-1, 0, 1} == set(halved.flat)
    assert (halved == 0).sum() < (once == 0).sum()
    for _ in range(200):
        states = rng.uniform(*boxes)
        value = problem.value_of(part, states, rng.uniform(0.1, 0.15))
        assert (value[halved.ravel() == 1] > 0).all() and (value[halved.ravel() == -1] <= 0).all()


@pytest.mark.parametrize("share", [0.6, 3.0])
def test_bounds_of_a_lattice_hold_in_its_boxes(share, rng):
    """Wherever a disk is at some time of a part, all boxes are counted that are so near as tubes sway, if that is less
    than a box."""
    problem = torus_problem()
    proof, disk = proof_of(problem, (40, 30), parts=2), problem.unsafe[0]
    times = [(0.2, 0.3), (0.3, 0.4)]
    pitch = counted_boxes(proof.bounds, proof.axes, disk, times, problem.steps, np.zeros(2)).pitch
    lattice = counted_boxes(proof.bounds, proof.axes, disk, times, problem.steps, share * pitch)
    sway, seen = share * pitch if share < 1 else 0.0 * pitch, 0
    np.testing.assert_allclose(lattice.narrow, sway, atol=2e-10 * np.pi)
    for part, t in itertools.product((0, 1), (0.2, 0.25, 0.3, 0.35, 0.4)):
        if not 0.2 + 0.1 * part <= t <= 0.3 + 0.1 * part:
            continue
        states = rng.uniform(-2.5, 2.5, (1000, 2))
        states = states[disk.level_set(states, t) <= 0]
        sums = lattice.sums[part].reshape(lattice.sizes + 1)
        for corner in itertools.product((-1.0, 1.0), repeat=2):
            for i, k in ((states + corner * sway - lattice.lower) / lattice.pitch).astype(int):
                seen += 1
                assert sums[i + 1, k + 1] - sums[i, k + 1] - sums[i + 1, k] + sums[i, k] == 1
    assert seen > 100
    assert lattice.sums[0].max() < lattice.sizes.prod() / 4


ANY_VELOCITY = {
    "nobody": ({}, lambda q, u, v: u - 0.1 * q),
    "cubed": ({"bounds": [0.5]}, lambda q, u, v: u - 0.1 * q + v**3),
    "brake": ({"bounds": lambda q: 0.3 + 0.1 * np.abs(q)}, lambda q, u, v: u * (1 - v**2) - 0.1 * np.abs(v) + 0.0 * q),
    "later": ({"bounds": lambda t: np.stack([0.2 + 0.2 * t])}, lambda q, u, v, t: u + np.sin(3.0 * v + t) + 0.0 * q),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ANY_VELOCITY)
def test_an_adversary_that_enters_as_it_likes_wins_no_run(name, rng):
    """Certified states lead one step nearer under what the function says."""
    (given, velocity), plain = ANY_VELOCITY[name], interval_problem(steps=3)
    dynamics = sdhj.Dynamics(plain.inputs, velocity=velocity, **given)
    problem = dataclasses.replace(plain, dynamics=dynamics)
    if name == "nobody":  # v stands for nothing, so drift says the same
        problem = dataclasses.replace(plain, dynamics=sdhj.Dynamics(plain.inputs, lambda q, u: velocity(q, u, None)))
    table = certified(problem, cells=(200,))
    assert table.fraction(start=0, within=3) > table.fraction(start=0, within=0) + 0.05
    states, most = rng.uniform(-4, 4, (4000, 1)), given.get("bounds", [0.0])

    def pushed(q, j, share, t):
        half = most(t) if name == "later" else most(q) if callable(most) else np.array(most)
        return velocity(q, problem.inputs[j], share * half, *([t] if name == "later" else []))

    for step in range(3):
        left = naive.steps_to_go(table, states, step)
        near = (left > 0) & (left < 99)
        assert near.sum() > 100
        chosen = naive.chosen_inputs(table, states[near], step, rng)
        for share in (-1.0, -0.5, 0.0, 0.5, 1.0, None):
            now = states[near].copy()
            for k in range(50):
                part, t, h = (rng.uniform(-1, 1) if share is None else share), (step + k / 50) * 0.5, 0.01
                for j in range(3):
                    own = chosen == j
                    middle = now[own] + h / 2 * pushed(now[own], j, part, t)
                    now[own] = now[own] + h * pushed(middle, j, part, t + h / 2)
            assert (naive.steps_left(table, now, step + 1) <= left[near] - 1).all()


@pytest.mark.slow
def test_images_are_inside_as_plain_loops_say(rng):
    """The kernel against loops over all cells of an image: walls, a period, safe ends, sets that are nearly full."""
    counts, periodic = np.array([4, 5, 7]), np.array([False, True, False])
    cells = Cells(np.zeros(3), np.ones(3), np.ones(3), np.zeros((2, 3), int), counts, periodic, 2)
    room, found = np.empty((3, 3), np.int64), []
    for _ in range(300):
        inside = rng.random(counts) < 0.93
        pool, index = to_words(inside.reshape(-1, 7)), np.arange(20)
        cell, low = rng.integers(0, counts), rng.integers(-5, 4, 3)
        high, safe = low + rng.integers(0, 3, 3), np.array([[-np.inf] * 3, [np.inf] * 3])
        if safely := bool(rng.random() < 0.5):  # the lower end of the first axis, the upper one of the last
            safe[0, 0], safe[1, 2] = 0.0, 7.0
        each = [
            [(c + k) % n if wraps else min(max(c + k, 0), n - 1) for k in range(a, b + 1)]
            for c, a, b, n, wraps in zip(cell, low, high, counts, periodic, strict=True)
        ]
        left = safely and (cell[0] + high[0] < -1 or cell[2] + low[2] > 7)
        expected = left or all(inside[at] for at in itertools.product(*each))
        total = box_of_image(cell, low, high, safe, cells, 3, room)
        assert rows_inside(total, cells, index, pool, room) == expected
        found.append(expected)
    assert 50 < sum(found) < 250


@pytest.mark.slow
def test_a_push_along_several_axes_counts_as_its_box():
    """Of one component as of one for each axis; and where it enters nonlinearly, by all of its range."""
    ways = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    dynamics = (
        sdhj.Dynamics(ways, ways, [[0.25], [0.25]], [1.0]),
        sdhj.Dynamics(ways, ways, 0.25 * np.eye(2), [1.0, 1.0]),
        sdhj.Dynamics(ways, velocity=lambda q, u, v: u + 0.25 * np.stack([v[0], v[0] ** 3]) + 0 * q, bounds=[1.0]),
    )
    one, other, bent = (
        certified(dataclasses.replace(torus_problem(), dynamics=own), cells=(64, 64)) for own in dynamics
    )
    assert np.array_equal(one.pool, other.pool) and np.array_equal(one.index, other.index)
    assert one.fraction() > 1.2 * one.fraction(within=0) > 0.01
    first, last = np.array([[0.75, -0.25], [1.25, 0.25]]) * torus_problem().delta
    width = np.array([float(axis.width) for axis in bent.axes])
    assert np.array_equal(bent.proof.low[0, 1, 0], np.floor(first / width))
    assert np.array_equal(bent.proof.high[0, 1, 0], np.ceil(1 + last / width) - 1)


def test_fields_that_are_not_known_are_refused(tmp_path):
    """As `lines`, which images had that were no boxes."""
    certified(interval_problem(), cells=(80,)).save(tmp_path / "table.npz")
    with forged(tmp_path / "table.npz", named=True) as (told, _):
        told["proof"]["normals"] = [[1.0]]
    with pytest.raises(ValueError, match="know; solve it anew"):
        sdhj.load(tmp_path / "table.npz")


def test_cells_whose_sign_is_open_are_looked_at_in_pieces(tmp_path):
    """q - q / 2 - 3 / 4 is at most -1/4 on [0, 1], where intervals have up to 1/4: the cell is a goal, and verified."""
    half = sdhj.TargetSet((0,), lambda p, t: p[:, 0] - 0.5 * p[:, 0] - 0.75)
    problem = dataclasses.replace(interval_problem(steps=1), target=half, unsafe=())
    table = certified(problem, cells=(8,))
    edges = table.axes[0].edges()
    assert table.bits(start=0, within=0).tolist() == (edges[1:] <= 1.0).tolist()
    table.save(tmp_path / "half.npz")
    assert (verdict := verify(tmp_path / "half.npz", progress=False)).ok, str(verdict)
