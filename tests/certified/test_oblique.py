"""Oblique images: lines of cells against plants that share no code, plain loops over cells, and brute force."""

import math
from itertools import product

import mutations
import numpy as np
import pytest
from forging import forged
from naive_certified import assert_runs_succeed
from oblique_robots import AHEAD, OTHERS, POST, ROBOTS, WAYS, gust

import sdhj
import sdhj.certified.oblique
from sdhj.certified.check import verify
from sdhj.table.files import opened_table


@pytest.fixture(scope="module")
def tables():
    made = {}

    def solved(name):
        if name not in made:
            robot, _, mistake = name.partition(", ")  # of MISTAKES
            problem, cells = (ROBOTS | OTHERS)[robot]
            with pytest.MonkeyPatch.context() as patch:
                if mistake:
                    patch.setattr(sdhj.certified.oblique, *MISTAKES[mistake])
                made[name] = sdhj.solve(problem(), sdhj.Certified(cells=cells), progress=False)
        return made[name]

    return solved


def ended(problem, states, j, rng, pieces, fine=6):
    """Where states end under u_j and an adversary that changes its mind so often, by small steps; held at walls."""
    dynamics, grid, x = problem.dynamics, problem.grid, states.copy()
    most = dynamics.bounds_at(j)
    for _ in range(pieces):
        v = rng.choice([-1.0, -0.5, 0.5, 1.0], (len(x), len(most)), p=[0.4, 0.1, 0.1, 0.4]) * most
        for _ in range(fine):
            x = x + problem.delta / pieces / fine * dynamics.velocity_at(x, j, v, 0.0)
            for axis, ends in enumerate(grid.ends):
                if "wall" in ends and not grid.periodic[axis]:
                    x[:, axis] = np.clip(x[:, axis], grid.lower[axis], grid.upper[axis])
    return x


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_no_state_ends_outside_the_lines(name, tables, rng):
    """Whether v is held, switches or changes all the time; and a line is narrower than the box somewhere."""
    table, short = tables(name), 0
    problem, proof, counts = table.problem, table.proof, np.array(table.shape)
    width = np.array([float(axis.width) for axis in table.axes])
    lower = np.array(problem.grid.lower)
    for j, pieces in product(range(len(problem.inputs)), (1, 2, 5)):
        cells = rng.integers(0, counts - 1, (150, len(counts)))
        cells[:20] = [1 if name == "between walls" else 30] * len(counts)
        states = lower + (cells + rng.choice([0.0, 1.0, 0.4], cells.shape)) * width
        inside = ((states >= lower) & (states <= problem.grid.upper)).all(axis=1)
        ends = ended(problem, states, j, rng, pieces)
        for cell, end in zip(cells[inside], ends[inside], strict=True):
            clear = proof.clear[0, np.ravel_multi_index(cell, counts), j // 8] >> (j % 8) & 1
            if not clear:
                continue
            at = (end - lower) / width
            around = np.array(list(product(*({math.floor(a - 1e-8), math.floor(a + 1e-8)} for a in at))))
            first, last = proof.image(cell, j, 0)
            near = around[((around >= first) & (around <= last)).all(axis=1)]
            assert len(near) and proof.in_image(near, cell, j, 0).any(), (cell, j, at)
            every = np.array(list(product(*(range(a, b + 1) for a, b in zip(first, last, strict=True)))))
            short += int((~proof.in_image(every, cell, j, 0)).sum())
    assert short > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gust", "between walls", "car"])
def test_sets_are_all_that_follows_by_plain_loops(name, tables):
    """Every cell for which some input is clear and leads, line by line, into the set of a step less."""
    table = tables(name)
    proof, counts, problem = table.proof, np.array(table.shape), table.problem
    lines, less, here = proof.lines, table.bits(start=1, within=1), table.bits(start=0, within=2)
    oblique, last = np.flatnonzero(lines.normals.any(axis=0)[:-1]), len(counts) - 1
    rng = np.random.default_rng(2)
    border = np.argwhere(here ^ np.roll(here, 1, axis=0) | (here ^ np.roll(here, 2, axis=1)))
    for cell in rng.permutation(border)[:120]:
        leads = False
        for j in range(len(problem.inputs)):
            if not proof.clear[0, np.ravel_multi_index(cell, counts), j // 8] >> (j % 8) & 1:
                continue
            place = int(cell @ proof.strides)
            low, high = proof.low[0, j, place].astype(int), proof.high[0, j, place].astype(int)
            far = ((cell >= lines.halo[0]) & (cell < counts - lines.halo[1])).all()
            good = True
            for row in product(*(range(a, b + 1) for a, b in zip(low[:-1], high[:-1], strict=True))):
                number = 0
                for axis in oblique:
                    number = number * (high[axis] - low[axis] + 1) + row[axis] - low[axis]
                a, b = lines.each[0, j, place, number] if far else (low[last], high[last])
                for k in range(a, b + 1):
                    at = cell + np.array([*row, k])
                    periodic = np.array(problem.grid.periodic)
                    good &= bool(less[tuple(np.where(periodic, at % counts, np.clip(at, 0, counts - 1)))])
            leads |= good
        assert bool(here[tuple(cell)]) == (leads or bool(table.bits(start=0, within=1)[tuple(cell)])), cell


@pytest.mark.parametrize("name", ["gust", "between unsafe ends", "between walls"])
def test_no_promised_run_is_lost(name, tables, rng):
    table = tables(name)
    states = rng.uniform(table.grid.lower, table.grid.upper, (4000, table.grid.ndim))
    states = states[table.contains(states)]
    assert len(states) > 100
    assert_runs_succeed(table, states, rng)


@pytest.mark.parametrize("name", ROBOTS)
def test_files_carry_lines_and_the_checker_proves_them(name, tables, rng, tmp_path):
    table = tables(name)
    table.save(tmp_path / "table.npz")
    assert (verdict := verify(tmp_path / "table.npz", progress=False)).ok, str(verdict)
    again = sdhj.load(tmp_path / "table.npz")
    np.testing.assert_array_equal(again.proof.lines.each, table.proof.lines.each)
    states = rng.uniform(table.grid.lower, table.grid.upper, (2000, table.grid.ndim))
    within = table.steps
    for one in (table, again):
        safe = one.certified_inputs(states, 0, within).any(axis=1)
        assert safe[one.contains(states) & ~one.contains(states, within=0)].all()


def narrower(axes, normals, low, high, far, drawn=sdhj.certified.oblique.lines_in_boxes):
    """Lines that end at their first cell."""
    out = drawn(axes, normals, low, high, far)
    out[..., 1] = np.minimum(out[..., 0], out[..., 1])
    return out


def mistaken(name, given=None, answer=None):
    """A function of `sdhj.certified.oblique` whose arguments or whose answer are changed."""
    own = getattr(sdhj.certified.oblique, name)

    def function(*some):
        out = own(*(given(*some) if given else some))
        return answer(*out) if answer else out

    return name, function


# what is set in `sdhj.certified.oblique` while sets are made that are too large
MISTAKES = {
    "lines everywhere": ("halo_of", lambda axes, *given: np.zeros((2, len(axes)), np.int64)),
    "a cell a line": ("lines_in_boxes", narrower),
    "no way": mistaken("changes_along", lambda *some: (*some[:4], 0 * some[4], *some[5:])),
    "less time": mistaken("changes_along", lambda *some: (*some[:-1], 0.9 * some[-1])),
    "begins of parts": mistaken("rates_along", lambda *some: (*some[:-1], (some[-1][0],) * 2)),
    "nothing before": mistaken("_component", answer=lambda low, high: (0 * low, high)),
    "nothing behind": mistaken("_component", answer=lambda low, high: (low, 0 * high)),
}


def as_it_is(told, arrays):
    """A mistake was made before."""


def honest(robot):
    """Sets that were made by mistake, with the lines and the halo that are true of a robot."""

    def change(told, arrays):
        problem, cells = (ROBOTS | OTHERS)[robot]
        lines = sdhj.solve(problem(), sdhj.Certified(cells=cells), progress=False).proof.lines
        told["proof"]["halo"], arrays["lines"][...] = lines.halo.tolist(), lines.each

    return change


def tiny(told, arrays):
    """No lines, between planes of which nothing is left where they are multiplied."""
    told["proof"]["normals"] = (1e-322 * np.array(told["proof"]["normals"])).tolist()
    arrays["lines"][...] = np.array([0, -1])


def around(told, arrays):
    """Moves that go around the first axis."""
    arrays["high"][..., 0] = arrays["low"][..., 0] + told["cells"]["shape"][0]


def shorter(side):
    """A line of the first input that is a cell short of what it was, at one of its ends."""

    def change(told, arrays):
        lines = arrays["lines"][()]
        row = int(np.argmax(lines[0, 0, 0, :, 1] - lines[0, 0, 0, :, 0]))
        lines[0, 0, 0, row, side] += 1 - 2 * side
        arrays["lines"][...] = lines

    return change


def none(told, arrays):
    """One line less."""
    lines = arrays["lines"][()]
    row = int(np.argmax(lines[0, 0, 0, :, 1] - lines[0, 0, 0, :, 0]))
    lines[0, 0, 0, row] = 0, -1
    arrays["lines"][...] = lines


def said(path, change):
    """What the checker says of a file after a change of its head and arrays."""
    with forged(path, named=True) as (told, arrays):
        change(told, arrays)
    try:
        return " ".join(str(one) for one in verify(path, progress=False).claims if one.failed)
    except ValueError as error:
        return str(error)


FORGERIES = {
    "a line that begins a cell late": ("gust", shorter(0), "moves: "),
    "a line that ends a cell early": ("gust", shorter(1), "moves: "),
    "no line": ("gust", none, "moves: "),
    "no halo before": ("between walls", lambda told, _: told["proof"]["halo"][0].__setitem__(0, 1), "moves: "),
    "no halo behind": ("between walls", lambda told, _: told["proof"]["halo"][1].__setitem__(1, 1), "moves: "),
    "no normals": ("gust", lambda told, _: told["proof"].update(normals=[]), "normals must be"),
    "normals along a place": (
        "car",
        lambda told, _: told["proof"]["normals"][0].__setitem__(2, 1.0),
        "normals must be along axes",
    ),
    "normals that are next to nothing": ("gust", tiny, "normals must be"),
    "lines of what is measured": (
        "gust",
        lambda told, _: told["sensing"].update(error=0.0, delay=0.0, jitter=1e-3),
        "images of what is measured must be boxes",
    ),
    "once around": ("gust", around, "less than once around"),
    "an end that v leads to late": ("turned", shorter(1), "moves: "),
    "an end that v leads to soon": ("turned", shorter(0), "moves: "),
    "lines without the way": ("car, no way", as_it_is, "moves: "),
    "lines of less time": ("gust, less time", as_it_is, "moves: "),
    "lines of begins of parts": ("timed, begins of parts", as_it_is, "moves: "),
    "lines without what is before": ("gust, nothing before", as_it_is, "moves: "),
    "lines without what is behind": ("gust, nothing behind", as_it_is, "moves: "),
    "lines near a wall": ("in a corner, lines everywhere", honest("in a corner"), "one step nearer"),
    "lines that are not inside": ("gust, a cell a line", honest("gust"), "one step nearer"),
    "halo in parts": ("gust", lambda told, _: told["proof"]["halo"][0].__setitem__(0, 0.5), "halo must be"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FORGERIES)
def test_what_is_false_of_lines_is_refused(name, tables, tmp_path):
    robot, change, sentence = FORGERIES[name]
    tables(robot).save(tmp_path / "forged.npz")
    assert sentence in said(tmp_path / "forged.npz", change)


@pytest.mark.slow
@pytest.mark.parametrize(("cells", "least"), [(96, 0.075), (480, 0.85 * 0.1375)])
def test_the_share_is_near_that_of_brute_force(cells, least):
    """.1375 of all states by brute force, of polygons on a fine grid; by boxes .0722."""
    problem = sdhj.ReachAvoidProblem(
        sdhj.Grid([-1, -1], [1, 1], [41, 41], periodic=[True, True]),
        sdhj.Dynamics(WAYS, WAYS, np.array([[1.0], [1.0]]) / np.sqrt(2), [0.9]),
        AHEAD,
        [POST, sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0], p[:, 1] + 0.3) - 0.15, name="other post")],
        0.1,
        10,
    )
    table = sdhj.solve(problem, sdhj.Certified(cells=(cells, cells)), progress=False)
    assert least <= table.fraction(start=0, within=10) <= 0.1375


def test_a_box_stays_a_box(tmp_path):
    """Where no component moves two axes there are no lines, in memory or in the file."""
    problem = gust()
    dynamics = sdhj.Dynamics(WAYS, WAYS, np.eye(2), [0.6, 0.6])
    box = sdhj.ReachAvoidProblem(problem.grid, dynamics, AHEAD, [POST], 0.1, 2)
    table = sdhj.solve(box, sdhj.Certified(cells=(40, 40)), progress=False)
    table.save(tmp_path / "table.npz")
    assert not len(table.proof.lines.normals)
    with opened_table(tmp_path / "table.npz") as (head, arrays):
        assert "normals" not in head["proof"] and "lines" not in arrays.stated


# ---- mutations

# what is changed of which mark `# check`, the forgery that is then believed
BELIEVED = {
    "pushes along a normal": ("3.52 zero 7; zero 10", "a line that ends a cell early"),
    "halo before": ("3.57 true 10; true 19", "no halo before"),
    "halo behind": ("3.58 true 10; true 21", "no halo behind"),
    "the cell itself": ("3.61 zero 4", "a line that ends a cell early"),
    "all of a row": ("3.62 turn 5", "a line that ends a cell early"),
    "where a line begins": ("3.63 true 3", "a line that begins a cell late"),
    "where a line ends": ("3.64 true 3", "a line that ends a cell early"),
    "lines": ("3.68 drop", "a line that ends a cell early"),
    "the way of what velocities depend on": ("3.69 put 2 {3}", "lines without the way"),
    "all of the time": ("3.70 put 16 0.9 * {16}", "lines of less time"),
    "all times of a part": ("3.71 put 12 ({12}[0],) * 2", "lines of begins of parts"),
    "sums before": ("3.72 zero 7", "lines without what is before"),
    "sums behind": ("3.73 zero 7", "lines without what is behind"),
    "all pieces of v": ("3.74 put 5 {9}", "an end that v leads to soon"),
    "each piece of v": ("3.74 put 10 {14}", "an end that v leads to late"),
    "boxes near the ends": ("3.75 true 5; true 11", "lines near a wall"),
    "all cells of a line": ("3.76 put 12 {7}", "lines that are not inside"),
    "normals of some length": ("7.52 true 7", "normals that are next to nothing"),
    "nothing measured": ("7.53 true 3", "lines of what is measured"),
    "less than once around": ("7.54 true 3", "once around"),
    "some normals": ("7.50 true 2", "no normals"),
    "no normals along places": ("7.51 true 3", "normals along a place"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BELIEVED)
def test_the_check_of_lines_needs_it(name, tables, tmp_path):
    change, forgery = BELIEVED[name]
    robot, forge, sentence = FORGERIES[forgery]
    tables(robot).save(tmp_path / "forged.npz")
    with forged(tmp_path / "forged.npz", named=True) as (told, arrays):
        forge(told, arrays)
    with mutations.checker(tmp_path, change) as check:
        try:
            said = [str(one) for one in check(tmp_path / "forged.npz", progress=False).claims if one.failed]
        except Exception as error:  # what stands behind it notices
            said = [str(error)]
    assert not any(sentence in one for one in said)
