"""What the checker says of all cells at once, against plain loops, and against what it says of one after the other."""

import dataclasses
import itertools
import sys

import mutations
import numpy as np
import pytest
from forged_robots import put, sensed, sets_of
from forging import forged

import sdhj
from sdhj.certified.check import verify, windows
from sdhj.certified.check.bits import flags_of, numbers_of, packed, unpacked
from sdhj.certified.check.lattice import Lattice
from sdhj.certified.check.robots import Robot
from sdhj.certified.check.windows import each_once, overlapped, united

WALLS = ["wall", "unsafe", "unsafe"]


def pursued(moving=False):
    """A point on a strip that closes, a pursuer that runs along it, and a wall in the way: pursuer, x, y (m)."""
    inputs = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    pursuer = sdhj.UnsafeSet(
        (0, 1, 2),
        lambda q, t: np.hypot(1.27 * np.sin(np.pi / 4 * q[:, 1]), q[:, 2] - q[:, 0]) - 0.5 - 0.1 * t * moving,
    )
    post = sdhj.UnsafeSet(
        (1, 2), lambda p, t: np.hypot(p[:, 0] - 0.9, p[:, 1] + 0.8) - 0.2, inputs=[0, 1, 2], name="post"
    )
    grid = sdhj.Grid([-1.0, -2.0, -1.5], [1.0, 2.0, 1.5], [9, 9, 9], [False, True, False], ends=WALLS)
    return sdhj.ReachAvoidProblem(
        grid,
        sdhj.Dynamics(inputs, np.pad(inputs, ((0, 0), (1, 0))), np.eye(3), [0.4, 0.1, 0.1]),
        sdhj.TargetSet((1, 2), lambda p, t: 0.7 - p[:, 1]),
        [pursuer, post],
        0.25,
        3,
    )


def turning():
    """The same, of a point that goes where it is headed: heading, pursuer, x, y."""
    given = pursued()
    grid = sdhj.Grid([-np.pi, -1.0, -2.0, -1.5], [np.pi, 1.0, 2.0, 1.5], [9] * 4, [True, False, True, False])
    grid = dataclasses.replace(grid, ends=["unsafe", *WALLS])

    def drift(q, u):
        return np.stack([u[0] + 0 * q[:, 0], 0 * q[:, 0], np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)

    unsafe = [dataclasses.replace(part, axes=tuple(axis + 1 for axis in part.axes)) for part in given.unsafe]
    unsafe[1] = dataclasses.replace(unsafe[1], inputs=[1])
    target = dataclasses.replace(given.target, axes=(2, 3))
    dynamics = sdhj.Dynamics([[-1.0], [1.0]], drift, np.eye(4)[:, 1:], [0.4, 0.1, 0.1])
    return sdhj.ReachAvoidProblem(grid, dynamics, target, unsafe, 0.25, 3)


CASES = {
    "all alike": (pursued, (6, 16, 12)),
    "moving": (lambda: pursued(moving=True), (5, 8, 12)),
    "by heading": (turning, (8, 5, 8, 12)),
}


OTHERS = {"late": (sensed, (160,))}  # of which only is asked what a forged file is judged


@pytest.mark.parametrize("seed", range(6))
def test_what_windows_hold_is_united_as_plain_loops_say(seed):
    """Windows before, across and behind cells of two axes, with and without periods, of tubes some of which agree."""
    rng = np.random.default_rng(seed)
    counts, fine, periodic = [5, int(rng.choice([3, 8, 21]))], rng.integers(1, 4, 2), rng.random(2) < 0.5
    sizes = [n * f for n, f in zip(counts, fine.tolist(), strict=True)]
    boxes, ends = rng.random(sizes) < 0.1, []
    for n, size, wraps in zip(counts, sizes, periodic, strict=True):
        first = np.arange(n) * (size // n) + rng.integers(-5, 6, (6, 1))
        last = first + rng.integers(0, 6, (6, 1))
        first[1], last[1] = first[0], last[0]
        ends.append((first, last) if wraps else (np.clip(first, 0, size - 1), np.clip(last, 0, size - 1)))
    seen = []
    for some, met in united(packed(boxes), sizes, [each_once(*pair) for pair in ends], np.arange(6)):
        found = unpacked(met, counts[1])
        for tube, cell in itertools.product(some, np.ndindex(*counts)):
            spans = [
                range(a[tube, c], z[tube, c] + 1) for (a, z), c in zip(ends, cell, strict=True)
            ]  # in numpy as in Python -1 is the last one
            assert found[cell] == any(boxes[i % sizes[0], k % sizes[1]] for i, k in itertools.product(*spans))
        seen.append(set(some.tolist()))
    assert set().union(*seen) == set(range(6)) and any({0, 1} <= one for one in seen)


def test_boxes_that_windows_hold_are_those_that_plain_loops_find(rng):
    """Of cells on three axes, of each tube others."""
    sizes, counts, cells = [10, 6, 17], [5, 6, 9], rng.random((4, 5, 6, 9)) < 0.05
    ends, expected = [], np.zeros(sizes, bool)
    for n in counts:
        first = np.arange(n) + rng.integers(-3, 4, (4, 1))
        ends.append((first, first + rng.integers(0, 3, (4, 1))))
    for tube, *cell in np.argwhere(cells).tolist():
        spans = [np.arange(a[tube, c], z[tube, c] + 1) % n for (a, z), c, n in zip(ends, cell, sizes, strict=True)]
        expected[np.ix_(*spans)] = True
    found = overlapped(
        lambda some: packed(cells[some].any(axis=0)), sizes, [each_once(*pair) for pair in ends], np.arange(4)
    )
    assert np.array_equal(unpacked(found, 17), expected) and 0.2 < expected.mean() < 0.9


def test_boxes_hold_all_of_tubes_that_are_alike(rng):
    """Along such an axis a box is its cell with the outermost ends of tubes; it is met where that is."""
    edges, tubes = [np.linspace(0.0, 1.0, 6), np.linspace(-1.0, 1.0, 41)], np.array([[-0.3, 0.05], [0.4, 0.1]])
    own = Lattice(
        edges, np.array([1, 2]), np.array([False] * 2), np.full(2, 1e-10), np.zeros(2), np.array([True, False]), tubes
    )
    low, high = own.boxes(np.array([[2, 7]]), 1)
    assert low[0, 0] <= 0.4 - 0.3 - 2e-10 and high[0, 0] >= 0.6 + 0.4 + 2e-10 and high[0, 0] < 1.0 + 1e-8
    first, last = own.overlapped(0, *(np.tile(end, (3, 1)) for end in (edges[0][:-1], edges[0][1:])))
    assert (first == np.arange(5)).all() and (last == first).all()

    def half(box, at=None):
        """A set below .55 along the first axis and above 0 along the second."""
        outside = (box[0, :, 0] > 0.55) | (box[1, :, 1] < 0.0)
        return outside, (box[1, :, 0] <= 0.55) & (box[0, :, 1] >= 0.0)

    every = np.stack(np.unravel_index(np.arange(5 * 80), (5, 80)), axis=1)
    assert np.array_equal(unpacked(own.united([half]), 80).ravel(), ~half(own.boxes(every, 1))[0])


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """The checker's reading of a case, and the file; each is made once."""
    made = {}

    def robot(name):
        if name not in made:
            problem, cells = (CASES | OTHERS)[name]
            path = tmp_path_factory.mktemp("windows") / "it.npz"
            sdhj.solve(problem(), sdhj.Certified(cells=cells, parts=2), play=False, progress=False).save(path)
            made[name] = path
        return made[name]

    return robot


def reads(path, monkeypatch):
    """What the checker makes of a file, with all cells looked at at once however few they are."""
    kept = []
    with monkeypatch.context() as patched:
        patched.setattr(windows, "LEAST_CELLS", 1)
        patched.setattr(Robot, "claims", lambda self, *_: kept.append(self) or [])
        verify(path, progress=False)
    return kept[0]


@pytest.mark.parametrize("name", CASES)
def test_what_is_clear_at_once_is_clear_by_halves(name, robots, monkeypatch):
    """Of cells drawn from all, under every input and in every step; and little is left open that is clear."""
    robot, rng = reads(robots(name), monkeypatch), np.random.default_rng(0)
    every, few = packed(np.ones(robot.counts, np.bool_)), 0
    numbers = np.sort(rng.choice(len(robot.clear[0]), 150, replace=False))
    robot.at_once.look_at(0)
    places, total = robot.cells(numbers) @ robot.strides, 0
    for step, j in itertools.product(range(len(robot.clear)), range(robot.count)):
        open_ = np.isin(numbers, robot.at_once.open_cells(every, step, j))
        swept, _ = robot.driven(np.arange(robot.low.shape[2]), np.full(robot.low.shape[2], j), robot.time(0), 2)
        clear = robot.clear_holds(robot.ends(robot.cells(numbers)), step, j, swept, places)
        assert not (~open_ & ~clear).any()
        few, total = few + int((open_ & clear).sum()), total + int(clear.sum())
    assert few < 0.12 * total and 0.2 < total / (150 * robot.count * len(robot.clear)) < 0.9


def test_a_tube_that_leads_exactly_to_an_end_is_clear(tmp_path, monkeypatch):
    """From the 14 of 16 cells of .25 that a step of .5 keeps inside: at once, looked up, and by halves."""
    dynamics = sdhj.Dynamics([[1.0], [-1.0]], [[1.0], [-1.0]], [[1.0]], [0.0])
    target = sdhj.TargetSet((0,), lambda p, t: p[:, 0] - 1.0)
    problem = sdhj.ReachAvoidProblem(sdhj.Grid([0.0], [4.0], [17]), dynamics, target, (), 0.5, 2)
    sdhj.solve(problem, sdhj.Certified(cells=(16,)), play=False, progress=False).save(tmp_path / "it.npz")
    robot = reads(tmp_path / "it.npz", monkeypatch)
    robot.at_once.look_at(0)
    for j, clear in enumerate([np.arange(14), np.arange(2, 16)]):
        assert numbers_of(flags_of(robot.clear[0], j, (16,)), 16).tolist() == clear.tolist()
        assert not robot.at_once.open_cells(flags_of(robot.clear[0], j, (16,)), 0, j).size
        swept, every = robot.driven(np.zeros(1, int), np.array([j]), 0.0, 1)[0], np.arange(16)
        left = robot.clear_by_lattice(j, {0: every}, every, np.zeros(1, int), swept, 0 * every)[0]
        halved = robot.clear_holds(robot.ends(robot.cells(every)), 0, j, swept, 0 * every)
        assert np.setdiff1d(every, left).tolist() == np.flatnonzero(halved).tolist() == clear.tolist()


@pytest.mark.parametrize("name", ["all alike", "moving"])
def test_cells_are_led_at_once_as_one_by_one(name, robots, monkeypatch):
    """Into drawn sets of cells, and into those of the file."""
    robot, rng = reads(robots(name), monkeypatch), np.random.default_rng(0)
    assert robot.at_once.leads()
    numbers = np.arange(len(robot.clear[0]))
    for step, share in itertools.product(range(len(robot.clear)), (0.0, 0.9, 0.99)):
        following = rng.random(numbers.size) < share if share else robot.bits(step + 1, 0)
        found = unpacked(
            robot.at_once.cells_led_into(step, packed(following.reshape(robot.counts))), robot.counts[-1]
        ).ravel()
        counted = robot.sums(following)
        one_by_one = np.any([robot.leads(numbers, step, j, counted) for j in range(robot.count)], axis=0)
        assert np.array_equal(found, one_by_one) and 0 < found.sum() < found.size


def overstated(path, to):
    """A copy of a file in which inputs are clear and arrive anywhere, and sets have more cells."""
    rng = np.random.default_rng(0)
    to.write_bytes(path.read_bytes())
    with forged(to, named=True) as (told, arrays):
        put(arrays, clear=rng.integers(0, 256, arrays["clear"].shape, np.uint8))
        if "arrives" in arrays:
            arrives = rng.integers(0, 256, arrays["arrives"].shape, np.uint8)
            put(arrays, arrives=arrives & (rng.random(arrives.shape) < 0.2) * np.uint8(255))
        with sets_of(told, arrays) as sets:
            more = rng.random(sets.shape[1:])
            for own, share in zip(sets, np.linspace(0.5, 1.0, len(sets)), strict=True):
                own |= more < share
    return to


@pytest.mark.parametrize("name", CASES)
def test_it_proves_as_much_as_one_by_one_and_refuses_as_much(name, robots, tmp_path, monkeypatch):
    paths = robots(name), overstated(robots(name), tmp_path / "forged.npz")
    one_by_one = [str(verify(path, progress=False)) for path in paths]
    monkeypatch.setattr(windows, "LEAST_CELLS", 1)
    assert one_by_one == [str(verify(path, progress=False)) for path in paths]
    assert "NOT" not in one_by_one[0] and one_by_one[1].count("NOT") == 4


MUTATIONS = {  # a change of what is marked `# check`, and the case that is then judged otherwise
    "all of tubes that are alike": ("4.67 zero 9", "all alike"),
    "sets of an input": ("4.69 put 1 False", "all alike"),
    "a part of a tube": ("4.70 put 11 0; put 12 1", "moving"),
    "all parts of a tube": ("4.70 put 3 True", "all alike"),
    "what is met": ("4.71 drop", "all alike"),
    "what is left open": ("4.73 zero 4", "all alike"),
    "the lower end": ("4.74 false 3", "all alike"),
    "the upper end": ("4.75 false 3", "all alike"),
    "how far a tube gets": ("4.76 turn 7; turn 16", "all alike"),
    "how far tubes get": ("4.68 turn 6; turn 17", "all alike"),
    "images that leave the set": ("3.92 drop 6", "all alike"),
    "a clock that is off": ("4.72 zero 9; zero 13", "late"),
    "who arrives": ("3.93 drop 27", "all alike"),
    "who arrives and is clear": ("3.90 drop 3", "all alike"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, robots, tmp_path, monkeypatch):
    """Without it a file that states too much is judged otherwise."""
    change, case = MUTATIONS[name]
    path = overstated(robots(case), tmp_path / "forged.npz")
    monkeypatch.setattr(windows, "LEAST_CELLS", 1)
    right = str(verify(path, progress=False))
    with mutations.checker(tmp_path, change) as check:
        sys.modules[f"{check.__module__}.windows"].LEAST_CELLS = 1
        assert str(check(path, progress=False)) != right
