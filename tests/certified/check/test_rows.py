"""The claims of a row, against plain loops and samples."""

import itertools
import math

import naive_certified as naive
import numpy as np
import pytest
from naive_certified import CIRCLE, LINE, SMALL, STILL
from parameters import but_slow

import sdhj
from sdhj.certified.check.arm import bits, rows, separation
from sdhj.certified.check.arm.claims import Scene

pytestmark = pytest.mark.usefixtures("checked_plainly")


@pytest.mark.slow
def test_half_planes_prove_what_is_clear(arm_world, rng):
    """The cells that `sweep` keeps are clear in samples, and are most of those that are proved one by one."""
    edges = [np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), np.linspace(-0.36, 0.36, 25), np.linspace(-0.36, 0.36, 31)]
    world = arm_world(edges, u_max=3.0, v_d_max=0.4, delta=0.1, v_p_max=0.2)
    shape, bench = (24, 30), rows.bench_of(0, 0, world)
    kept_count = proved_count = 0
    for j in (0, 4, 7):
        low = rng.uniform(-3, 3, 2)
        bench.part[:4] = low[0], low[0] + 0.02, low[1], low[1] + 0.02
        bits = naive.packed(np.ones(shape, np.bool_))
        rows.sweep(j, 0.1, world, bench, bits)
        kept = naive.unpacked(bits, shape)
        near = kept & ~naive.erosion(kept, *naive.neighbours(shape))
        for x, y in np.argwhere(near):  # the other ones are further away
            rows.agent_cell(x * 30 + y, 0.1, world, bench.part)
            assert naive.smallest_gap(world, bench.part[:8], j, 3, 0.0, 0.1, rng, count=60) > 0.0
        for x, y in rng.permutation(np.argwhere(np.ones(shape)))[:40]:
            rows.agent_cell(x * 30 + y, 0.1, world, bench.part)
            if rows.clear((3, 4), bench.part, world.inputs[j], 0.0, world, bench.stack):
                proved_count += 1
                kept_count += kept[x, y]
    assert kept_count > 0.9 * proved_count > 30


@pytest.mark.parametrize(("j", "axis"), [(2, 2), (8, 3)])
def test_half_planes_count_what_predictions_are_off(j, axis, arm_world, rng):
    """What `sweep` keeps is clear from cells of the pursuer that are wider by as much."""
    edges = [np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), np.linspace(-0.36, 0.36, 25), np.linspace(-0.36, 0.36, 31)]
    world, shape, counts = arm_world(edges, u_max=3.0, v_d_max=0.4, delta=0.1, v_p_max=0.2), (24, 30), []
    world = world._replace(parts=np.full(9, 2))  # few, so that each is much of the interval
    for off in (0.0, 0.03):
        bench, bits = rows.bench_of(0, 0, world), naive.packed(np.ones(shape, np.bool_))
        bench.part[:4] = 0.3, 0.32, -0.4, -0.38
        rows.sweep(j, 0.1, world._replace(off=off * (np.arange(4) == axis)), bench, bits)
        kept = naive.unpacked(bits, shape)
        counts.append(kept.sum())
        for x, y in np.argwhere(kept & ~naive.erosion(kept, *naive.neighbours(shape))):
            rows.agent_cell(x * 30 + y, 0.1, world, bench.part)
            part = bench.part[:8] + off * np.outer(np.arange(4) == axis, [-1, 1]).ravel()
            assert naive.smallest_gap(world, part, j, 3, 0.0, 0.1, rng, count=60) > 0.0
    assert 0 < counts[1] < counts[0]


def test_a_link_that_stands_upright_is_swept_too(arm_world, rng):
    """One normal of it is horizontal, and no half plane has an upper end there. What is left is asked cell by cell."""
    edges = [np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), np.linspace(-0.36, 0.36, 25), np.linspace(-0.36, 0.36, 31)]
    world, shape = arm_world(edges), (24, 30)
    bench, bits = rows.bench_of(0, 0, world), naive.packed(np.ones(shape, np.bool_))
    bench.part[:4] = math.pi / 2, math.pi / 2, 0.0, 0.0
    rows.sweep(0, 0.0, world, bench, bits)
    kept = naive.unpacked(bits, shape)
    others = naive.packed(~kept)
    rows.drop_unproved(world.inputs[0], 0.0, world, bench, others)
    alone = naive.unpacked(others, shape)  # proved one by one: a few of those that no half plane shows clear
    assert 0 < alone.sum() < (~kept).sum() / 2
    for x, y in [*rng.permutation(np.argwhere(kept))[:40], *np.argwhere(alone)]:
        rows.agent_cell(x * 30 + y, 0.0, world, bench.part)
        assert naive.smallest_gap(world, bench.part[:8], 0, 3, 0.0, 0.0, rng, count=60) > 0.0


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
            problem = sdhj.arm_case_study(**(SMALL | {"obstacles": [STILL, LINE, near], "v_d_max": 0.4}))
        self.given = dict(problem.recipe["arguments"])
        if not evader:
            self.given["target"] = self.given["target"] | {"radius": 0.11}  # some rows are partly outside
        self.known = self.given["obstacles"]
        self.world = Scene(problem.recipe | {"arguments": self.given}, naive.sensing()).world((*joints, *plane))
        self.cells, index, pool = naive.sets_of(self.steps, self.shape, rng, [0.4, 0.93, 0.93])
        self.along = [np.clip(np.arange(6)[:, None] + [-1, 0], 0, 5), np.clip(np.arange(6)[:, None] + [0, 1], 0, 5)]
        self.ends = [np.sort(rng.integers(0, 3, (9, 3, 2)), axis=2) for _ in range(2)]
        self.allowed = rng.random((self.steps, 9, 3, 3)) < 0.2
        eroded = bits.erode(pool, *self.along)
        self.stored = rows.Stored(naive.pairs(self.steps), index, pool, eroded, self.allowed, *self.ends)

    def bounds(self, cell):
        edges = (self.world.q1, self.world.q2, self.world.x, self.world.y)
        return np.array([edge[i + side] for edge, i in zip(edges, cell, strict=True) for side in (0, 1)])

    def touches(self, cell, j, start, duration, bodies):
        """Whether samples of a cell touch: True is sure."""
        states, taus = naive.states_during(self.world, self.bounds(cell), j, duration, self.rng, 60)
        for (q1, q2, *p), tau in zip(states, taus, strict=True):
            for body in bodies:
                if body == "agent":
                    point, contact = p, self.world.agent[1]
                else:
                    point, contact = naive.disk_centre(body, start + tau), body["radius"] + 0.01
                if naive.arm_distance(point, q1, q2, tuple(self.world.arm)) <= contact:
                    return True
        return False

    def misses(self, cell, t):
        """Whether samples of a cell have the tip outside the target."""
        states, _ = naive.states_during(self.world, self.bounds(cell), 4, 0.0, self.rng, 60)
        target = self.given.get("target")
        for q1, q2, *p in states:
            _, tip = naive.elbow_and_tip(q1, q2, tuple(self.world.arm))
            centre, radius = (p, 0.2) if target is None else (naive.disk_centre(target, t), target["radius"])
            if math.dist(tip, centre) > radius:
                return True
        return False

    def reaches(self, cell, j, place):
        ends = [self.ends[0][j, cell[0]], self.ends[1][j, cell[1]], self.along[0][cell[2]], self.along[1][cell[3]]]
        return all(self.cells[(place, *end)] for end in itertools.product(*ends))


def test_a_row_has_its_bounds_and_all_that_a_disturbance_may_add(arm_world):
    world = arm_world([np.linspace(-1, 1, n) for n in (4, 5, 6, 7)], v_d_max=0.4)
    part = rows.bench_of(1, 2, world).part
    assert part.tolist() == [*world.q1[1:3], *world.q2[2:4], *[0.0] * 6, -0.4, 0.4, -0.4, 0.4]
    rows.agent_cell(2 * 6 + 3, 0.1, world, part)
    assert part[4:10].tolist() == [*world.x[2:4], *world.y[3:5], 0.0, 0.1]


@pytest.mark.parametrize("evader", but_slow([False, True], False))
def test_nothing_that_samples_refute_is_proved(evader, rng):
    """A row's claims about random sets: where samples refute a cell it is not proved, and few others are left."""
    twin = Twin(evader, rng)
    agent = [] if evader else ["agent"]
    refuted_count, idle, proved = 0, 0, np.zeros(twin.steps + 1, np.int64)
    for row in (0, 4, 7):
        left = naive.unpacked(rows.unproved(row // 3, row % 3, twin.world, twin.stored), twin.shape[2:])
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
                    following = naive.place_of(twin.steps, k + 1, n - 1)
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
        failed, example = rows.check_flags(i1, i2, twin.world, twin.stored)
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


def test_steps_are_later_where_the_first_one_is(monkeypatch, rng):
    """Flags and goals of the first step are those of a later one, where intervals begin as much later."""
    monkeypatch.setattr(separation, "GRANTED", 20)
    twin, found = Twin(False, rng), []
    for begin, start in ((0.0, 0), (0.0, 1), (twin.world.delta, 0)):
        world, allowed = twin.world._replace(begin=begin), np.zeros((2, 9, 3, 3), bool)
        allowed[start, ::2] = True
        stored, todo = twin.stored._replace(allowed=allowed), np.zeros((6, 1), np.uint64)
        todo[naive.place_of(2, start, 0)] = 2**36 - 1
        rows.check_goals(world, stored, rows.bench_of(0, 1, world), todo)
        found.append((rows.check_flags(0, 0, world, stored)[0], todo.sum()))
    at_once, second, later = found
    assert later == second and at_once[0] != later[0] and at_once[1] != later[1], found
