"""The independent checker: it proves what holds, nothing that sampling refutes, and finds what was planted.

Nothing here but the first part needs the solver: the checker's own steps are held against plain loops and samples.
"""

import itertools
import json
import math
import shutil
from fractions import Fraction
from types import SimpleNamespace

import h5py
import naive_certified as naive
import numpy as np
import pytest
from test_certified import small_problem

import sdhj
from sdhj.certified.check import kernels
from sdhj.certified.check.verify import PI, Scene, cells_cover, counted, overlapped, verify
from sdhj.certified.sets import certify

CIRCLE = {
    "path": {"kind": "circle", "centre": [0.0, -0.22], "radius": 0.07, "rate": 9.0, "phase": -1.0},
    "radius": 0.04,
}
LINE = {"path": {"kind": "line", "start": [0.24, -0.02], "velocity": [-0.6, 0.7]}, "radius": 0.04}
STILL = {"path": {"kind": "still", "centre": [-0.22, 0.1]}, "radius": 0.06}


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Certified sets of a small problem in a file, and the sets."""
    sets = certify(small_problem(v_p_max=0.9), cells=(32, 32, 8, 8), parts=4, progress=False)
    return write(sets, tmp_path_factory.mktemp("verify") / "small.h5"), sets


def write(sets, path):
    with h5py.File(path, "w") as file:
        sets.save(file.create_group("certified"))
    return path


def claims_of(report):
    return {claim.name: claim for claim in report.claims}


def test_every_claim_of_a_small_file_is_proved(saved):
    path, sets = saved
    report = verify(path)
    assert report.ok, str(report)
    claims = claims_of(report)
    added = sets.bits(start=0, within=2) & ~sets.bits(start=0, within=1)
    assert claims["one step nearer, within 2"].checked == claims["one step nearer, within 2"].made == added.sum() > 0
    assert claims["clear of the obstacles"].checked == sets.proof.motion.allowed.sum()
    assert "proved" in str(report) and "NOT" not in str(report)


def test_rows_are_drawn_and_counted(saved):
    report = verify(saved[0], samples=300, seed=1)
    assert report.ok
    claims = claims_of(report)
    nearer = claims["one step nearer, within 1"]
    assert 0 < nearer.checked < nearer.made and 0 < nearer.boundary[1] < nearer.boundary[0]
    assert str(verify(saved[0], samples=np.int64(300), seed=np.uint8(1))) == str(report)
    assert str(verify(saved[0], samples=300, seed=2)) != str(report)


@pytest.mark.parametrize("name", ["printed", "evader"])
def test_every_claim_of_other_arms_is_proved(name, tmp_path):
    obstacles = [STILL, LINE, CIRCLE]
    if name == "evader":
        numbers = {"v_e_max": 0.3, "evader_radius": 0.14, "u_max": 4.0, "v_d_max": 1.0}
        problem = sdhj.evader_case_study(nodes=9, steps=2, input_levels=3, obstacles=obstacles, **numbers)
    else:
        problem = small_problem(kinematics="printed", obstacles=obstacles)
    sets = certify(problem, cells=(63, 63, 24, 24), parts=4, progress=False)
    report = verify(write(sets, tmp_path / "other.h5"))
    assert report.ok, str(report)
    assert claims_of(report)["one step nearer, within 1"].checked > 100


# --------------------------------------------------------------------------------------------------------------------
# Planted faults
# --------------------------------------------------------------------------------------------------------------------


def planted(saved, tmp_path, change):
    """Report on a copy of the file that `change` was let loose on."""
    path = tmp_path / "planted.h5"
    shutil.copy(saved[0], path)
    with h5py.File(path, "r+") as file:
        change(file["certified"])
    return verify(path)


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
        named = [failure for claim in report.claims for failure in claim.failures]
        assert report.ok or f"start {start}, within {within}, cell {tuple(cell.tolist())}" in named
    assert found >= 2


def test_a_cell_too_few_is_found_where_others_rest_on_it(saved, tmp_path, rng):
    """A cell in the middle of S_1^1 is taken away: cells of S_0^2 lose what they end in, S_1^0 is inside no more."""
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
        wrong = claims_of(report)["clear of the obstacles"]
        assert wrong.failed == 1
        assert wrong.failures == ("start {}, input {}, joints {}, {}".format(*place.tolist()),)


def test_wrong_cells_end_the_check(saved, tmp_path):
    def wider(group):
        group.attrs["widths"] = ["19/100", *list(group.attrs["widths"])[1:]]

    report = planted(saved, tmp_path, wider)
    assert [claim.failed for claim in report.claims] == [1]


def test_a_stronger_adversary_is_not_proved(saved, tmp_path):
    """The sets of one problem under the numbers of harder ones."""
    for old, new in (('"v_d_max": 2.0', '"v_d_max": 2.1'), ('"v_p_max": 0.9', '"v_p_max": 1.0')):

        def harder(group, old=old, new=new):
            assert old in group.attrs["recipe"]
            group.attrs["recipe"] = group.attrs["recipe"].replace(old, new)

        report = planted(saved, tmp_path, harder)
        assert not report.ok and "NOT proved" in str(report)


def test_files_that_cannot_be_checked_are_refused(saved, tmp_path):
    with h5py.File(tmp_path / "empty.h5", "w"):
        pass
    with pytest.raises(ValueError, match="no certified sets"):
        verify(tmp_path / "empty.h5")
    for name in ("index", "allowed", "pool"):
        with pytest.raises(ValueError, match="damaged"):
            planted(saved, tmp_path, lambda group, n=name: rewrite(group, n, group[n][()][:-1]))

    def beyond_the_pool(group):
        rewrite(group, "index", group["index"][()] + np.uint32(len(group["pool"])))

    with pytest.raises(ValueError, match="damaged"):
        planted(saved, tmp_path, beyond_the_pool)


# --------------------------------------------------------------------------------------------------------------------
# Its own steps, one by one
# --------------------------------------------------------------------------------------------------------------------


def arm_world(edges=None, **changes):
    recipe = small_problem(**({"obstacles": [STILL, LINE, CIRCLE]} | changes)).recipe
    return Scene.of(recipe).world((np.linspace(-1, 1, 9),) * 4 if edges is None else tuple(edges))


def scratch():
    return np.empty((kernels.STACK, 10))


def test_numbers_beyond_the_bound_on_rounding_are_refused():
    recipe = small_problem().recipe
    far = STILL | {"path": {"kind": "still", "centre": [20.0, 0.0]}}
    fast = CIRCLE | {"path": CIRCLE["path"] | {"rate": 1000.0}}
    for changes in (
        {"obstacles": [far]},
        {"obstacles": [fast]},
        {"target": far},
        {"u_max": 150.0},
        {"lengths": [11.0, 1.0]},
        {"lengths": [0.15, 0.0]},
    ):
        scene = Scene.of(recipe | {"arguments": recipe["arguments"] | changes})
        with pytest.raises(ValueError, match="bound on rounding"):
            scene.world((np.linspace(-1, 1, 9),) * 4)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("half_width", -0.5),
        ("half_width", True),
        ("half_width", "a"),
        ("pursuer_radius", -1.0),
        ("pursuer_radius", math.nan),
        ("v_d_max", -0.1),
        ("delta", math.inf),
        ("steps", 2.5),
        ("steps", 0),
        ("input_levels", 1),
        ("input_levels", 10**30),
        ("lengths", [0.15]),
        ("lengths", None),
        ("kinematics", "foo"),
        ("obstacles", {}),
        ("obstacles", [3]),
        ("obstacles", [STILL | {"radius": -1.0}]),
        ("obstacles", [STILL | {"path": STILL["path"] | {"kind": "spiral"}}]),
        ("obstacles", [STILL | {"path": STILL["path"] | {"centre": [0.0]}}]),
        ("obstacles", [CIRCLE | {"path": CIRCLE["path"] | {"rate": None}}]),
        ("target", None),
        ("target", {}),
    ],
)
def test_numbers_that_make_no_sense_are_refused(saved, tmp_path, name, value):
    def senseless(group):
        recipe = json.loads(group.attrs["recipe"])
        recipe["arguments"][name] = value
        group.attrs["recipe"] = json.dumps(recipe)

    with pytest.raises(ValueError, match=r"make no sense .*; the file is damaged"):
        planted(saved, tmp_path, senseless)


@pytest.mark.parametrize(
    "damage",
    [
        lambda group: group.attrs.__delitem__("shape"),
        lambda group: group.attrs.__setitem__("shape", 32),
        lambda group: group.attrs.__setitem__("widths", ["1/0"] * 4),
        lambda group: group.attrs.__setitem__("widths", ["1/2"] * 3),
        lambda group: group.attrs.__setitem__("recipe", "[]"),
        lambda group: group.attrs.__setitem__("recipe", '{"builder": "foo", "arguments": {}}'),
        lambda group: group.__delitem__("pool"),
        lambda group: rewrite(group, "index", -group["index"][()].astype(np.int64)),
        lambda group: rewrite(group, "index", group["index"][()].astype(">u4")),
        lambda group: rewrite(group, "pool", group["pool"][()].astype(np.int64)),
        lambda group: rewrite(group, "allowed", group["allowed"][()].astype(np.float64)),
    ],
)
def test_damaged_files_are_refused(saved, tmp_path, damage):
    with pytest.raises(ValueError, match=r"make no sense .*; the file is damaged"):
        planted(saved, tmp_path, damage)


def test_samples_and_seed_that_make_no_sense_are_refused(saved):
    for options in ({"samples": 0}, {"samples": -1}, {"samples": True}, {"seed": -1}, {"seed": 0.5}):
        with pytest.raises(ValueError, match="must be a"):
            verify(saved[0], **options)


def test_no_direction_of_a_sweep_is_horizontal(rng):
    for nx, ny in [(1.0, 0.0), (-1.0, -1e-12), (0.0, 1.0), *rng.normal(size=(20, 2))]:
        length = math.hypot(nx, ny)
        tilted = kernels.tilted(nx / length, ny / length)
        assert math.hypot(*tilted) == pytest.approx(1.0, abs=1e-15) and abs(tilted[1]) >= 1e-7
        assert tilted == pytest.approx((nx / length, ny / length), abs=1.1e-6)


def test_cells_that_do_not_cover_are_found():
    scene = Scene.of(small_problem().recipe)
    width = scene.box / 4
    fine = {"extents": [(2 * PI[0], 2 * PI[1])] * 2 + [(2 * scene.box,) * 2] * 2, "lowers": [-scene.box] * 4}
    fine |= {"scene": scene, "shape": (32, 32, 8, 8), "widths": [PI[1] / 16] * 2 + [width] * 2}
    assert cells_cover(SimpleNamespace(**fine)).failed == 0
    for axis, name, value in (
        (0, "extents", (Fraction(22, 7) * 2,) * 2),
        (1, "extents", (2 * PI[1],) * 2),
        (1, "extents", (2 * PI[0],) * 2),
        (0, "widths", PI[0] / 16),
        (3, "widths", width * Fraction(99, 100)),
        (2, "lowers", -scene.box + 1),
        (2, "extents", (2 * scene.box - width / 2,) * 2),
    ):
        wrong = [value if k == axis else kept for k, kept in enumerate(fine[name])]
        assert cells_cover(SimpleNamespace(**(fine | {name: wrong}))).failed == 1, (axis, name)


@pytest.mark.parametrize("axis", [0, 2])
def test_image_lists_hold_every_end(axis, rng):
    """Exact end states of random starts, and of the cells' ends, lie in the listed cells; and no list is idly long."""
    scene = Scene.of(small_problem().recipe)
    size = 2 * PI[1] if axis == 0 else 2 * scene.box
    n, width = 23, size / 23 + Fraction(1, 10**4)
    file = SimpleNamespace(scene=scene, shape=(n,) * 4, widths=[width] * 4, extents=[(size, size)] * 4)
    slow, fast = Fraction(-17, 10), Fraction(23, 10)
    lists = overlapped(axis, file, slow, fast)
    delta = Fraction(str(scene.given["delta"]))
    for cell, listed in enumerate(lists):
        high = min((cell + 1) * width, size)
        found = set()
        for a, b in [*itertools.product((0, 1), repeat=2), *rng.integers(0, 10**6, (20, 2)).tolist()]:
            scale = 1 if a in (0, 1) and b in (0, 1) else 10**6
            end = (
                cell * width
                + Fraction(a, scale) * (high - cell * width)
                + (slow + Fraction(b, scale) * (fast - slow)) * delta
            )
            end = end % size if axis == 0 else min(max(end, Fraction(0)), size)
            if end % width == 0 and (a, b) == (1, 1):  # an edge that is shared with the next cell
                continue
            found.add(min(int(end // width), n - 1))
        assert found <= set(listed)
        span = (high - cell * width + (fast - slow) * delta) / width
        assert len(listed) <= span + 2


def naive_erosion(cells, along_x, along_y):
    nx, ny = cells.shape
    return np.array([[all(cells[a, b] for a in along_x[x] for b in along_y[y]) for y in range(ny)] for x in range(nx)])


def packed(cells):
    """Bool (..., nx, ny) as blocks (..., words)."""
    flat = cells.reshape(*cells.shape[:-2], -1)
    words = -(-flat.shape[-1] // 64)
    out = np.zeros((*flat.shape[:-1], words * 64), np.bool_)
    out[..., : flat.shape[-1]] = flat
    return np.packbits(out, axis=-1, bitorder="little").view(np.uint64)


def unpacked(blocks, shape):
    flat = np.unpackbits(blocks.view(np.uint8), axis=-1, count=shape[0] * shape[1], bitorder="little")
    return flat.astype(np.bool_).reshape(*blocks.shape[:-1], *shape)


@pytest.mark.parametrize("shape", [(5, 7), (3, 64), (4, 71), (2, 130)])
def test_erosion_agrees_with_the_twin(shape, rng):
    cells = rng.random((6, *shape)) < np.array([0.0, 1.0, 0.97, 0.97, 0.9, 0.7])[:, None, None]
    along = [np.sort(rng.integers(0, n, (n, 2)), axis=1) for n in shape]
    out = np.full_like(packed(cells), 12345)
    kernels.erode(packed(cells), *along, out)
    for block, expected in zip(unpacked(out, shape), cells, strict=True):
        np.testing.assert_array_equal(block, naive_erosion(expected, *along))
    assert (packed(unpacked(out, shape)) == out).all()  # nothing beyond the last cell


def test_bits_are_counted_dropped_and_named(rng):
    for start, stop in [(0, 1), (0, 64), (3, 64), (60, 130), (64, 128), (191, 192), (0, 192)]:
        bits = np.full(3, ~np.uint64(0))
        kernels.drop_range(bits, start, stop)
        kept = unpacked(bits, (1, 192))[0]
        assert not kept[start:stop].any() and kept.sum() == 192 - (stop - start)
    words = rng.integers(0, 2**63, 50, dtype=np.uint64)
    assert [kernels.count(word) for word in words] == [int(word).bit_count() for word in words]
    steps = 5
    places = [kernels.entry(steps, k, n) for k in range(steps + 1) for n in range(steps - k + 1)]
    assert places == list(range(len(places)))


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


def test_survey_agrees_with_the_twin(rng):
    steps, shape = 2, (4, 3, 5, 6)
    cells, index, pool = sets_of(steps, shape, rng, [0.97] * 3)
    file = SimpleNamespace(steps=steps, shape=shape, index=index, pool=pool)
    counts, grow = counted(file)
    assert grow.failed == 0
    expected, at = np.zeros_like(counts), 0
    for k in range(steps + 1):
        for n in range(steps - k + 1):
            new = cells[at] & ~cells[at - 1] if n else cells[at]
            for cell in np.argwhere(new):
                edge = False
                for axis in range(2):
                    for side in (-1, 1):
                        beside = cell.copy()
                        beside[axis] = (beside[axis] + side) % shape[axis]
                        edge |= not cells[(at, *beside)]
                for dx, dy in itertools.product((-1, 0, 1), repeat=2):
                    x, y = np.clip(cell[2] + dx, 0, shape[2] - 1), np.clip(cell[3] + dy, 0, shape[3] - 1)
                    edge |= not cells[at, cell[0], cell[1], x, y]
                expected[cell[0] * shape[1] + cell[1], n] += (1, edge)
            at += 1
    np.testing.assert_array_equal(counts, expected)
    file.index = index.copy()
    file.index[1, 7] = np.flatnonzero((pool & pool[index[0, 7]] != pool[index[0, 7]]).any(axis=1))[0]
    assert counted(file)[1].failures[0] == "start 0: the set within 0 is not inside the one within 1"


def test_no_point_of_the_arm_is_farther(rng):
    """`farthest` bounds samples of a box, and by little where the box is small."""
    for turn, size in itertools.product((0.0, 1.0), (0.02, 0.3, 1.5)):
        arm = np.array([0.15, 0.2, turn])
        for _ in range(30):
            q, d, angle = rng.uniform(-3, 3, 2), rng.uniform(0, size, 2), rng.uniform(-np.pi, np.pi)
            box = np.array([q[0] - d[0], q[0] + d[0], q[1] - d[1], q[1] + d[1], 0, 0, 0, 0, 0, 0])
            pose, n = kernels.pose_of(box, arm), np.array([math.cos(angle), math.sin(angle)])
            corners = np.array(list(itertools.product((-1, 1), repeat=2)))
            shares = np.concatenate([rng.uniform(-1, 1, (300, 2)), corners])
            found = [-np.inf, -np.inf]
            for q1, q2 in q + shares * d:
                elbow, tip = naive.elbow_and_tip(q1, q2, arm)
                found[0] = max(found[0], 0.0, n @ elbow)
                found[1] = max(found[1], n @ elbow, n @ tip)
            for link in (0, 1):
                bound = kernels.farthest(n[0], n[1], link, pose, turn)
                assert bound >= found[link] - 1e-12
                if size == 0.02:  # the corners hold all but terms of second order, each below l d^2 with d <= 0.04
                    assert bound - found[link] < 0.35 * 0.04**2


def disk_centre(disk, t):
    """Where a disk is, from its description."""
    path = disk["path"]
    if path["kind"] == "still":
        return np.array(path["centre"])
    if path["kind"] == "line":
        return np.array(path["start"]) + t * np.array(path["velocity"])
    angle = path["rate"] * t + path["phase"]
    return np.array(path["centre"]) + path["radius"] * np.array([math.cos(angle), math.sin(angle)])


def test_a_disk_stays_where_it_is_said_to_be():
    world = arm_world()
    for body, disk in enumerate([STILL, LINE, CIRCLE]):
        for tau0, tau1 in ((0.0, 0.0), (0.0, 0.1), (0.02, 0.07)):
            box = np.array([0, 0, 0, 0, 0, 0, 0, 0, tau0, tau1])
            x, y, hx, hy, move_x, move_y, bend, contact = kernels.body_of(box, body, 0.3, world)
            assert contact == disk["radius"] + 0.01 and hx == hy == 0.0
            for tau, angle in itertools.product(np.linspace(tau0, tau1, 9), np.linspace(0, 6, 13)):
                n = np.array([math.cos(angle), math.sin(angle)])
                ahead = n @ (disk_centre(disk, 0.3 + tau) - [x, y])
                assert ahead >= -abs(n @ [move_x, move_y]) - bend - 1e-12


# --------------------------------------------------------------------------------------------------------------------
# What is proved, against samples of states, disturbances and times
# --------------------------------------------------------------------------------------------------------------------


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
    """The least distance, over samples, between the arm and a body, less that at contact."""
    states, taus = states_during(world, cell, j, duration, rng, count)
    known = [STILL, LINE, CIRCLE]
    contact = world.agent[1] if body == 3 else known[body]["radius"] + 0.01
    points = states[:, 2:] if body == 3 else [disk_centre(known[body], start + tau) for tau in taus]
    arm = tuple(world.arm)
    return min(naive.arm_distance(p, q1, q2, arm) for p, (q1, q2) in zip(points, states[:, :2], strict=True)) - contact


@pytest.mark.parametrize("evader", [False, True])
def test_tips_that_are_proved_inside_are_inside(evader, rng):
    """Wide cells; the target's radius is about the distance of the farthest tip in samples."""
    stack, outcomes = scratch(), []
    for _ in range(100):
        low = rng.uniform([-3, -3, -0.3, -0.3], [3, 3, 0.3, 0.3])
        cell = np.stack([low, low + rng.uniform(0.0, [1.0, 1.0, 0.1, 0.1])], axis=1).ravel()
        world, centre = arm_world(), rng.uniform(-0.3, 0.3, 2)
        states, _ = states_during(world, cell, 4, 0.0, rng, 400)
        farthest = max(
            math.dist(naive.elbow_and_tip(q1, q2, tuple(world.arm))[1], p if evader else centre)
            for q1, q2, *p in states
        )
        share = rng.uniform(0.97, 1.1)
        goal = np.array([*centre, 0.0, 0.0, 0.0, 0.0, 0.0, share * farthest])
        proved = kernels.tip_inside(cell, 0.0, world._replace(chased=not evader, goal=goal), stack)
        assert not proved or share >= 1.0
        outcomes.append((proved, share))
    assert np.mean([proved for proved, share in outcomes if share > 1.05]) > 0.9


@pytest.mark.parametrize("kinematics", ["relative", "printed"])
def test_what_is_proved_clear_is_clear(kinematics, rng):
    """And what is not proved nearly touches."""
    world = arm_world(kinematics=kinematics, u_max=3.0, v_d_max=0.4, delta=0.1)
    stack, gaps = scratch(), {True: [], False: []}
    for trial in range(120):
        low = rng.uniform([-3, -3, -0.3, -0.3], [3, 3, 0.3, 0.3])
        cell = np.stack([low, low + rng.uniform(0.01, 0.05, 4)], axis=1).ravel()
        j, body, duration = int(rng.integers(0, 9)), trial % 4, 0.1 if trial % 3 else 0.0
        proved = kernels.clear(body, cell, world.inputs[j], 0.2, duration, world, stack)
        gaps[proved].append(smallest_gap(world, cell, j, body, 0.2, duration, rng))
    assert min(gaps[True]) > 0.0 and len(gaps[True]) > 40 and len(gaps[False]) > 10
    assert max(gaps[False]) < 0.006  # samples of a cell of up to 15 mm do not find the nearest state


def pose(q1, q2, px, py):
    return np.array([q1, q1, q2, q2, px, px, py, py], dtype=float)


def test_contact_is_met_to_a_hair():
    """A stretched arm and a pursuer: 50 mm between centre and link is contact; so are rounding and a state's error."""
    world, stack, still = arm_world(obstacles=()), scratch(), np.zeros(2)
    at_rest = world._replace(push=0.0)
    for x, link in ((0.07, 0), (0.2, 1)):
        for y, expected in ((0.0501, True), (0.05 + 1e-8, True), (0.05 + 1e-10, False), (0.05, False), (0.03, False)):
            assert kernels.link_clear(link, 0, pose(0, 0, x, y), still, 0.0, 0.0, at_rest, stack) == expected
    box = np.array([*pose(0, 0, 0.2, 0.05 + 5e-12), 0.0, 0.0])  # the error of the state left out
    arm, body = kernels.pose_of(box, world.arm), kernels.body_of(box, 0, 0.0, world)
    assert not kernels.separated(1, arm, body, 1.0)
    assert not kernels.clear(0, pose(0, 0, 0.2, 0.12), np.array([3.0, 0.0]), 0.0, 0.1, world, stack)  # the arm comes
    slow = world._replace(push=0.3, agent=np.array([0.2, 0.05]))
    assert kernels.clear(0, pose(0, 0, 0.2, -0.085), np.array([3.0, 0.0]), 0.0, 0.1, slow, stack)


def test_states_beside_their_cell_count():
    world, box = arm_world(), np.empty(10)
    cell = pose(0.3, -0.2, 0.1, 0.2)
    kernels.moved(cell, world.inputs[4], 0.0, 0.0, world, box)
    assert (box[:8:2] <= cell[::2] - 0.9e-10).all() and (box[1:8:2] >= cell[1::2] + 0.9e-10).all()


def test_half_planes_prove_what_is_clear(rng):
    """The cells that `sweep` keeps are clear in samples, and are most of those that are proved one by one."""
    edges = [np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), np.linspace(-0.36, 0.36, 25), np.linspace(-0.36, 0.36, 31)]
    world = arm_world(edges, u_max=3.0, v_d_max=0.4, delta=0.1, v_p_max=0.2)
    shape, stack = (24, 30), scratch()
    kept_count = proved_count = 0
    for j in (0, 4, 7):
        low = rng.uniform(-3, 3, 2)
        cell = np.array([low[0], low[0] + 0.02, low[1], low[1] + 0.02, 0, 0, 0, 0])
        bits = packed(np.ones(shape, np.bool_))
        kernels.sweep(cell, j, 0.1, world, np.empty(24), np.empty(24), bits)
        kept = unpacked(bits, shape)
        near = kept & ~naive_erosion(kept, *(np.clip(np.arange(n)[:, None] + [-1, 0, 1], 0, n - 1) for n in shape))
        for x, y in np.argwhere(near):  # the other ones are further away
            kernels.agent_cell(x * 30 + y, world, cell)
            assert smallest_gap(world, cell, j, 3, 0.0, 0.1, rng, count=60) > 0.0
        for x, y in rng.permutation(np.argwhere(np.ones(shape)))[:40]:
            kernels.agent_cell(x * 30 + y, world, cell)
            if kernels.clear(3, cell, world.inputs[j], 0.0, 0.1, world, stack):
                proved_count += 1
                kept_count += kept[x, y]
    assert kept_count > 0.9 * proved_count > 30


# --------------------------------------------------------------------------------------------------------------------
# All claims of a row, against plain loops
# --------------------------------------------------------------------------------------------------------------------


class Twin:
    """Random sets around a pose that has its tip in the target, and what samples say about them."""

    shape = (3, 3, 6, 6)
    steps = 2

    def __init__(self, evader, rng):
        self.rng = rng
        joints = [q + np.linspace(-0.1, 0.5, 4) for q in (0.513, 1.626)]
        plane = [np.linspace(-0.12, 0.24, 7), np.linspace(0.0, 0.36, 7)]
        if evader:
            numbers = {"v_e_max": 0.6, "evader_radius": 0.2, "evader_box": 0.36, "u_max": 4.0, "v_d_max": 2.0}
            problem = sdhj.evader_case_study(
                nodes=9, steps=2, input_levels=3, obstacles=[STILL, LINE, CIRCLE], **numbers
            )
        else:
            near = CIRCLE | {
                "path": CIRCLE["path"] | {"centre": [0.27, 0.2], "radius": 0.1, "rate": 9.0, "phase": -2.5}
            }
            problem = small_problem(obstacles=[STILL, LINE, near], v_d_max=0.4)
        self.given = dict(problem.recipe["arguments"])
        if not evader:
            self.given["target"] = self.given["target"] | {"radius": 0.11}  # some rows are partly outside
        self.known = self.given["obstacles"]
        self.world = Scene.of(problem.recipe | {"arguments": self.given}).world((*joints, *plane))
        self.cells, index, pool = sets_of(self.steps, self.shape, rng, [0.4, 0.93, 0.93])
        self.along = [np.clip(np.arange(6)[:, None] + [-1, 0], 0, 5), np.clip(np.arange(6)[:, None] + [0, 1], 0, 5)]
        self.ends = [np.sort(rng.integers(0, 3, (9, 3, 2)), axis=2) for _ in range(2)]
        self.allowed = rng.random((self.steps, 9, 3, 3)) < 0.2
        eroded = np.empty_like(pool)
        kernels.erode(pool, *self.along, eroded)
        self.sets = kernels.Sets(self.steps, index, pool, eroded, self.allowed, *self.ends)

    def bounds(self, cell):
        edges = (self.world.q1, self.world.q2, self.world.x, self.world.y)
        return np.array([edge[i + side] for edge, i in zip(edges, cell, strict=True) for side in (0, 1)])

    def touches(self, cell, j, start, duration, bodies):
        """Whether samples of a cell touch: True is sure."""
        states, taus = states_during(self.world, self.bounds(cell), j, duration, self.rng, 60)
        for (q1, q2, *p), tau in zip(states, taus, strict=True):
            for body in bodies:
                if body == "agent":
                    point, contact = p, self.world.agent[1]
                else:
                    point, contact = disk_centre(body, start + tau), body["radius"] + 0.01
                if naive.arm_distance(point, q1, q2, tuple(self.world.arm)) <= contact:
                    return True
        return False

    def misses(self, cell, t):
        """Whether samples of a cell have the tip outside the target."""
        states, _ = states_during(self.world, self.bounds(cell), 4, 0.0, self.rng, 60)
        target = self.given.get("target")
        for q1, q2, *p in states:
            _, tip = naive.elbow_and_tip(q1, q2, tuple(self.world.arm))
            centre, radius = (p, 0.2) if target is None else (disk_centre(target, t), target["radius"])
            if math.dist(tip, centre) > radius:
                return True
        return False

    def reaches(self, cell, j, place):
        ends = [self.ends[0][j, cell[0]], self.ends[1][j, cell[1]], self.along[0][cell[2]], self.along[1][cell[3]]]
        return all(self.cells[(place, *end)] for end in itertools.product(*ends))


@pytest.mark.parametrize("evader", [False, True])
def test_nothing_that_samples_refute_is_proved(evader, rng):
    """A row's claims about random sets: where samples refute a cell it is not proved, and few others are left."""
    twin = Twin(evader, rng)
    agent = [] if evader else ["agent"]
    refuted_count, idle, proved = 0, 0, np.zeros(twin.steps + 1, np.int64)
    for row in (0, 4, 7):
        left = unpacked(kernels.unproved(row, twin.shape, twin.world, twin.sets), twin.shape[2:])
        place = 0
        for k, n in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0)):
            before = twin.cells[place - 1] if n else np.zeros_like(twin.cells[0])
            for x, y in itertools.product(range(6), repeat=2):
                cell = (row // 3, row % 3, x, y)
                if before[cell] or not twin.cells[(place, *cell)]:
                    assert not left[place, x, y]
                    continue
                if n == 0:
                    t = k * twin.world.delta
                    refuted = twin.misses(cell, t) or twin.touches(cell, 4, t, 0.0, agent + twin.known)
                else:
                    following = kernels.entry(twin.steps, k + 1, n - 1)
                    refuted = all(
                        not twin.allowed[k, j, cell[0], cell[1]]
                        or not twin.reaches(cell, j, following)
                        or twin.touches(cell, j, 0.0, twin.world.delta, agent)
                        for j in range(9)
                    )
                assert left[place, x, y] or not refuted
                assert not evader or n == 0 or refuted == left[place, x, y]  # nothing but reach, which the twin knows
                refuted_count += refuted
                idle += left[place, x, y] and not refuted
                proved[n] += not left[place, x, y]
            place += 1
    assert refuted_count > 60 and proved[0] > 10 and proved[1] + proved[2] > 3
    assert idle < 0.1 * refuted_count, (idle, refuted_count, proved)


def test_flags_that_samples_refute_are_found(rng):
    twin = Twin(False, rng)
    wrong = allowed = 0
    for i1, i2 in itertools.product(range(3), repeat=2):
        failed, example = kernels.check_flags(i1, i2, twin.world, twin.sets)
        sure = {
            k * 9 + j
            for k, j in np.argwhere(twin.allowed[:, :, i1, i2])
            if twin.touches((i1, i2, 0, 0), j, k * twin.world.delta, twin.world.delta, twin.known)
        }
        assert failed >= len(sure)
        assert failed == 0 or twin.allowed[example // 9, example % 9, i1, i2]
        wrong += failed
        allowed += int(twin.allowed[:, :, i1, i2].sum())
    assert 0.2 * allowed < wrong < 0.8 * allowed and allowed > 20
