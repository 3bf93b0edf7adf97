"""The independent checker: proves what holds, finds what was planted, and its intervals hold what they should."""

import math
import shutil

import h5py
import numpy as np
import pytest
from test_certified import small_problem

import sdhj
from sdhj.certified import certify
from sdhj.verify import Clearance, Interval, Scene, tips_inside, verify


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Certified sets of a small problem in a file, and the sets."""
    sets = certify(small_problem(v_p_max=0.9), cells=(32, 32, 8, 8), parts=4, progress=False)
    path = tmp_path_factory.mktemp("verify") / "small.h5"
    with h5py.File(path, "w") as file:
        sets.save(file.create_group("certified"))
    return path, sets


def test_every_claim_of_a_small_file_is_proved(saved):
    path, sets = saved
    report = verify(path, samples=None)
    assert report.ok, str(report)
    claims = {claim.name: claim for claim in report.claims}
    added = sets.bits(start=0, within=2) & ~sets.bits(start=0, within=1)
    assert claims["one step nearer, within 2"].checked == claims["one step nearer, within 2"].made == added.sum() > 0
    assert claims["clear of the obstacles"].checked == sets.proof.motion.allowed.sum()
    assert "proved" in str(report) and "NOT" not in str(report)


def test_samples_are_counted(saved):
    report = verify(saved[0], samples=50, seed=1)
    assert report.ok
    assert all(claim.checked <= 80 for claim in report.claims)
    assert max(claim.made for claim in report.claims) > 1000


def planted(saved, tmp_path, change):
    """Report on a copy of the file that `change` was let loose on."""
    path = tmp_path / "planted.h5"
    shutil.copy(saved[0], path)
    with h5py.File(path, "r+") as file:
        change(file["certified"])
    return verify(path, samples=None)


def rewrite(group, name, data):
    del group[name]
    group[name] = data


def flip(group, sets, start, within, cell):
    """Flip one cell of one set, in a block of its own."""
    index, pool = group["index"][()], group["pool"][()]
    _, n2, _, ny = sets.shape
    place, row, bit = sets._entry(start, within), cell[0] * n2 + cell[1], cell[2] * ny + cell[3]
    block = pool[index[place, row]].copy()
    block[bit // 64] ^= np.uint64(1) << np.uint64(bit % 64)
    index[place, row] = len(pool)
    rewrite(group, "index", index)
    rewrite(group, "pool", np.concatenate([pool, block[None]]))


def test_a_cell_too_many_is_found(saved, tmp_path, rng):
    """A cell beside a set is added to it. (One that the solver left out needlessly may be proved, not more.)"""
    _, sets = saved
    found = 0
    for start, within in ((0, 2), (1, 1), (1, 0)):
        inside = sets.bits(start=start, within=within)
        outside = np.argwhere(~inside & np.roll(inside, 1, axis=0))
        cell = rng.permutation(outside)[0]
        report = planted(saved, tmp_path, lambda group, c=cell, k=start, n=within: flip(group, sets, k, n, c))
        found += not report.ok
    assert found >= 2


def test_a_cell_too_few_is_found_where_others_rest_on_it(saved, tmp_path, rng):
    """A cell in the middle of S_1^0 is taken away: cells of S_0^1 lose what they end in, or S_1^1 what it holds."""
    _, sets = saved
    inside = sets.bits(start=1, within=1)
    deep = inside & np.roll(inside, 1, axis=0) & np.roll(inside, -1, axis=0) & np.roll(inside, 1, axis=1)
    cell = rng.permutation(np.argwhere(deep & sets.bits(start=1, within=0)))[0]
    report = planted(saved, tmp_path, lambda group: flip(group, sets, 1, 1, cell))
    assert not report.ok
    assert any("not inside" in failure for claim in report.claims for failure in claim.failures)


def test_an_input_bit_too_many_is_found(saved, tmp_path, rng):
    _, sets = saved
    allowed = sets.proof.motion.allowed
    sure = allowed.copy()  # blocked beside blocked: not only by a hair
    for axis in (2, 3):
        for side in (-1, 1):
            sure |= np.roll(allowed, side, axis=axis)
    for place in rng.permutation(np.argwhere(~sure))[:2]:
        changed = allowed.copy()
        changed[tuple(place)] = True
        bits = np.packbits(changed, bitorder="little")
        report = planted(saved, tmp_path, lambda group, b=bits: rewrite(group, "allowed", b))
        claims = {claim.name: claim for claim in report.claims}
        assert claims["clear of the obstacles"].failed == 1


def test_wrong_cells_are_found(saved, tmp_path):
    def wider(group):
        widths = list(group.attrs["widths"])
        group.attrs["widths"] = ["19/100", *widths[1:]]

    def rational_pi(group):
        extents = group.attrs["extents"]
        extents[0] = ["22/7", "22/7"]
        group.attrs["extents"] = extents

    for change in (wider, rational_pi):
        claims = {claim.name: claim for claim in planted(saved, tmp_path, change).claims}
        assert claims["cells cover the axes"].failed == 1


def test_a_stronger_adversary_is_not_proved(saved, tmp_path):
    """The sets of one problem under the numbers of a harder one."""

    def harder(group):
        group.attrs["recipe"] = group.attrs["recipe"].replace('"v_d_max": 2.0', '"v_d_max": 2.1')

    report = planted(saved, tmp_path, harder)
    assert not report.ok and "NOT proved" in str(report)


def test_a_file_without_certified_sets_is_refused(tmp_path):
    with h5py.File(tmp_path / "empty.h5", "w"):
        pass
    with pytest.raises(ValueError, match="no certified sets"):
        verify(tmp_path / "empty.h5")


# --------------------------------------------------------------------------------------------------------------------
# Its own tools
# --------------------------------------------------------------------------------------------------------------------


def random_intervals(rng, count=2000):
    low = rng.uniform(-7, 7, count)
    return Interval(low, low + rng.uniform(0, 4, count) * rng.integers(0, 2, count))


def test_intervals_hold_their_values(rng):
    a, b = random_intervals(rng), random_intervals(rng)
    for _ in range(20):
        x, y = rng.uniform(a.low, a.high), rng.uniform(b.low, b.high)
        for interval, value in (
            (a + b, x + y),
            (a - b, x - y),
            (a * b, x * y),
            (a.square(), x * x),
            (a.cos(), np.cos(x)),
            (a.sin(), np.sin(x)),
            (a.positive(), np.maximum(x, 0)),
        ):
            assert (interval.low <= value).all() and (value <= interval.high).all()


def test_intervals_round_outward():
    tenth, third = Interval.of(0.1), Interval.of(1 / 3)
    for interval in (tenth + third, tenth * third, tenth - third, tenth.square()):
        assert interval.low < interval.high
    whole = Interval(np.array([-0.1, 3.0]), np.array([0.1, 3.3])).cos()
    assert whole.high[0] == 1.0 and whole.low[1] == -1.0
    at_pi = Interval.of(np.array([math.pi])).cos()
    assert at_pi.low[0] == -1.0


def pose(q1, q2, px, py):
    return np.array([[[q1, q1], [q2, q2], [px, px], [py, py]]], dtype=float)


def test_clearance_of_poses():
    """A stretched arm and a pursuer: 50 mm between centre and link is contact."""
    problem = sdhj.arm_case_study(nodes=9, steps=1, obstacles=())
    clearance = Clearance(Scene.of(problem.recipe))
    for y, expected in ((0.0501, True), (0.05, False), (0.03, False)):
        still = clearance.prove(pose(0, 0, 0.2, y), np.zeros((1, 2)), np.zeros(1), 0.0, [0])
        assert still[0] == expected
    moving = clearance.prove(pose(0, 0, 0.2, 0.12), np.array([[3.0, 0.0]]), np.zeros(1), 0.1, [0])
    assert not moving[0]  # the arm comes to it
    away = clearance.prove(pose(0, 0, 0.2, -0.075), np.array([[3.0, 0.0]]), np.zeros(1), 0.1, [0])
    assert away[0]
    assert not tips_inside(Scene.of(problem.recipe), pose(0, 0, 0, 0), np.zeros(1))[0]
