"""Two examples without a target: against a peer, a closed form, proofs for cells, and in runs judged from outside."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import judge
import make_air3d
import numpy as np
import pytest
from extra_air3d import METHOD, PEER, RADIUS, air3d, unsafe_share
from extra_dcdc import DELTA, SCOTS, circuit, converter, dcdc, moved
from extra_dcdc import LOWER as LEAST
from extra_dcdc import UPPER as MOST

import sdhj
from sdhj import Controller

NUMBERS = Path(__file__).parents[2] / "notebooks" / "site" / "numbers.md"

# ---- two aircraft


@cache
def solved(intervals, **options):
    return sdhj.solve(air3d(intervals, **options), METHOD, progress=False)


def unsafe(table):
    return table.values(start=0, within=table.steps) > 0


@pytest.mark.slow
@pytest.mark.parametrize("turns", [(-1.0, 0.0, 1.0), (-1.0, 1.0)])
def test_more_intervals_leave_less_unsafe_down_to_continuous_time(turns):
    """Who may turn at every half interval may also turn at every whole one: what comes in is error."""
    tables = [solved(intervals, turns=turns) for intervals in (2, 8, 32)]
    for one, other in pairwise(tables):
        assert one.grid.fraction(unsafe(other) & ~unsafe(one)) < 2e-4 and unsafe_share(other) < unsafe_share(one)
    assert PEER < unsafe_share(tables[-1]) < PEER + 0.001
    assert unsafe_share(tables[0]) > PEER + 0.005  # sampling has a price; 0.0076 on a grid with ten more cells


@pytest.mark.slow
def test_the_tube_is_the_peers():
    """Node by node; most of the nodes that hj_reachability alone finds unsafe are its own error: see below."""
    table, theirs = solved(32), make_air3d.stored()
    assert table.grid.fraction(theirs) == pytest.approx(PEER, abs=5e-5)
    ours, grid = unsafe(table), table.grid
    assert grid.fraction(ours & ~theirs) < 0.0008 and grid.fraction(theirs & ~ours) < 0.0005
    disk = np.hypot(*grid.points()[:, :2].T).reshape(grid.shape) <= RADIUS
    assert (ours ^ theirs).sum() < 0.01 * (theirs & ~disk).sum()
    for end in (0, -1):  # why "safe" ends: nothing unsafe comes near them
        assert not ours[[end, end - 1]].any() and not theirs[[end, end - 1]].any()


@pytest.mark.slow
def test_side_by_side_nobody_comes_nearer():
    """At psi = 0 a pursuer whose every turn is copied stays where it is: in continuous time only the disk is unsafe.

    WENO5 finds some of the nodes around it unsafe, up to 0.11 outside; ours none.
    """
    distance = np.hypot(*solved(32).grid.points()[:, :2].T).reshape(51, 40, 50)[..., 0]
    beside = unsafe(solved(32))[..., 0]
    assert np.array_equal(beside, distance <= RADIUS)
    assert 10 < (make_air3d.stored()[..., 0] ^ beside).sum() < 30


def closing(q, u, v):
    """Velocities of the pursuer, as the evader sees them: turns u and v (M,)."""
    x, y, psi = q.T
    return np.stack([-5 + 5 * np.cos(psi) + u * y, 5 * np.sin(psi) - u * x, v - u], axis=1)


def worst(table):
    """The pursuer turns to where the evader's level-set function at the interval's end is higher."""

    def signs(states, inputs, t, end):
        step = round(end / table.problem.delta)
        ahead = states + np.array([[[0.0, 0.0, 0.1]], [[0.0, 0.0, -0.1]]])
        up, down = (table.grid.interpolate(table.values(start=step, within=table.steps), q) for q in ahead)
        return np.where(up > down, 1.0, -1.0)[:, None]

    return signs


def pursued(table, choose, signs, starts):
    """How chases end; the game goes on beyond the ends of the grid."""
    turns = table.problem.inputs[:, 0]
    return judge.play(
        choose,
        lambda q, u, v, t: closing(q, turns[np.maximum(u, 0)], v[:, 0]),
        signs,
        lambda q, t: np.ones(len(q)),
        lambda q, t: np.hypot(q[:, 0], q[:, 1]) - RADIUS,
        starts,
        delta=table.problem.delta,
        steps=table.steps,
    )


@pytest.mark.slow
@pytest.mark.parametrize("pursuer", ["worst", "random", "left", "right"])
def test_the_evader_is_not_caught(pursuer, rng):
    """From states that are just about safe, where whoever flies straight on is caught."""
    table = solved(32)
    controller, grid = Controller(table), table.grid
    states = rng.uniform(grid.lower, grid.upper, (50_000, 3))
    values = grid.interpolate(table.values(start=0, within=32), states)
    starts = states[(values <= 0) & (values > -1.0)][:1000]
    assert len(starts) == 1000
    signs = {
        "worst": worst(table),
        "random": lambda q, u, t, end: rng.choice([-1.0, 1.0], (len(q), 1)),
        "left": lambda q, u, t, end: np.ones((len(q), 1)),
        "right": lambda q, u, t, end: -np.ones((len(q), 1)),
    }[pursuer]

    def choose(q, step):
        off = grid.beyond(q, "frees")
        chosen = controller.choose(controller.batch(grid.clipped(q, "frees"), step))
        return np.where(off & (chosen < 0), 1, chosen)  # out there: straight on

    outcomes = pursued(table, choose, signs, starts)
    print(pursuer, dict(zip(*np.unique(outcomes, return_counts=True), strict=True)))
    assert np.mean(outcomes != "late") < 0.02
    if pursuer == "worst":
        straight = pursued(table, lambda q, step: np.full(len(q), 1), signs, starts)
        assert np.mean(straight == "collided") > 0.2


# ---- the voltage converter


def proved(cells):
    """Which cells are proved to stay in the box for ever, and to leave it: two bool arrays.

    A cell stays where in one mode the box about its image lies in cells that stay, and may stay where in one mode that
    box meets a cell that may: iterated from "all" until nothing changes, with counts in boxes by sums along both axes.
    """
    low, width = np.array(LEAST), (np.array(MOST) - LEAST) / cells
    corners = low + width * np.stack(np.meshgrid(*[np.arange(cells + 1)] * 2, indexing="ij"), axis=-1)
    counts = []
    for mode in (0, 1):
        whole, constant = moved(mode)
        at = (corners @ whole.T + constant - low) / width
        four = np.stack([at[:-1, :-1], at[1:, :-1], at[:-1, 1:], at[1:, 1:]])
        first, last = np.floor(four.min(axis=0) + 1e-9).astype(int), np.ceil(four.max(axis=0) - 1e-9).astype(int)
        fits = ((first >= 0) & (last <= cells)).all(axis=-1)
        (a, c), (b, d) = (np.moveaxis(np.clip(box, 0, cells), -1, 0) for box in (first, last))
        flat = [i * (cells + 1) + j for i, j in ((b, d), (a, d), (b, c), (a, c))]
        counts.append((flat, fits, (last - first).prod(axis=-1)))

    def settle(enough):
        inside = np.ones((cells, cells), bool)
        while True:
            sums = np.pad(inside.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))).ravel()
            after = np.zeros_like(inside)
            for (p, q, r, s), fits, size in counts:
                after |= enough(sums[p] - sums[q] - sums[r] + sums[s], fits, size)
            if np.array_equal(after & inside, inside):
                return inside
            inside &= after

    stay = settle(lambda count, fits, size: fits & (count == size))
    may = settle(lambda count, fits, size: count > 0)
    return stay, ~may


def test_the_exact_map_is_that_of_the_equation(rng):
    a, b = circuit()
    states = rng.uniform(LEAST, MOST, (50, 2))
    for mode in (0, 1):
        whole, constant = moved(mode)
        q = states
        for _ in range(20):
            q = judge.rk4(lambda q, t, mode=mode: q @ a[mode].T + b, q, 0.0, DELTA / 20)
        np.testing.assert_allclose(states @ whole.T + constant, q, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("parts", "name"), [(10, "converter"), (3, "converter, in 3 parts")])
def test_the_converter_is_certified_where_the_exact_map_keeps_it(parts, name):
    """On SCOTS's cells as much is certified as SCOTS has, none of it proved to leave; the page has the shares."""
    table = sdhj.solve(dcdc(), sdhj.Certified(cells=(800, 800), parts=parts), progress=False)
    share, bits, (stay, leave) = table.fraction(), table.bits(start=0, within=1), proved(800)
    print(f"certified {share:.4f}; proved to stay {stay.mean():.4f}, to leave {leave.mean():.4f}")
    assert not (bits & ~stay).any() and not (bits & leave).any() and share > 0.95 * stay.mean()
    assert share > SCOTS - 5e-4 and f"| {name} | 800 x 800 | {share:.1%} |" in NUMBERS.read_text(encoding="utf-8")


def kept(table, count, steps, rng):
    """How runs end on the true circuit; leaving the box is colliding."""
    controller, (a, b) = Controller(table), circuit()
    states = rng.uniform(LEAST, MOST, (2 * count, 2))
    starts = states[table.contains(states, start=0, within=1)][:count]
    assert len(starts) == count
    return judge.play(
        lambda q, step: controller.choose(controller.batch(q, 0)),
        lambda q, u, v, t: np.where((u == 0)[:, None], q @ a[0].T, q @ a[1].T) + b,
        lambda q, u, t, end: np.zeros((len(q), 1)),
        lambda q, t: np.ones(len(q)),
        lambda q, t: np.minimum(q - LEAST, MOST - q).min(axis=1) + 1e-9,
        starts,
        delta=DELTA,
        steps=steps,
    )


@pytest.mark.slow
def test_the_converter_stays_within_its_limits(rng):
    assert (kept(converter(800), 1000, 1000, rng) == "late").all()
