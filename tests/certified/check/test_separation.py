"""What is proved clear of one body, against samples of states, disturbances and times."""

import itertools
import math

import naive_certified as naive
import numpy as np
import pytest
from naive_certified import CIRCLE, LINE, STILL

import sdhj
from sdhj.certified.check.arm import separation
from sdhj.certified.check.arm.claims import Scene

pytestmark = pytest.mark.usefixtures("checked_plainly")


def part_of(cell, duration=0.0, push=0.0):
    """Bounds of the joints and the agent (8,) with those of a time from 0 to `duration`, and of a disturbance."""
    return np.array([*cell, 0.0, duration, -push, push, -push, push])


def test_no_point_of_the_arm_is_farther(rng):
    """`farthest` bounds samples of a box, and by little where the box is small."""
    corners = np.array(list(itertools.product((-1, 1), repeat=2)))
    for turn, size in itertools.product((0.0, 1.0), (0.02, 0.3, 1.5)):
        l1, l2 = 0.15, 0.2
        for _ in range(30):
            q, d, angle = rng.uniform(-3, 3, 2), rng.uniform(0, size, 2), rng.uniform(-np.pi, np.pi)
            box = np.array([q[0] - d[0], q[0] + d[0], q[1] - d[1], q[1] + d[1], 0, 0, 0, 0, 0, 0])
            pose = separation.pose_of(box, np.array([l1, l2, turn]))
            q1, q2 = (q + np.concatenate([rng.uniform(-1, 1, (300, 2)), corners]) * d).T
            elbow = l1 * np.cos(q1 - angle)  # along the direction
            tip = elbow + l2 * np.cos(turn * q1 + q2 - angle)
            for link, found in enumerate((max(elbow.max(), 0.0), max(elbow.max(), tip.max()))):
                bound = separation.farthest(math.cos(angle), math.sin(angle), link, pose, turn)
                assert bound >= found - 1e-12
                if size == 0.02:  # the corners hold all but terms of second order, each below l d^2 with d <= 0.04
                    assert bound - found < 0.35 * 0.04**2


def test_what_is_reached_holds_every_push_and_time(arm_world):
    """Each joint is pushed by what is its own."""
    world, box = arm_world(), np.empty(10)
    part = np.array([0.1, 0.2, -0.4, -0.2, 0.0, 0.1, 0.2, 0.3, 0.05, 0.1, -0.5, 0.2, 0.3, 1.1])
    for j, (one, two) in enumerate(itertools.product((-4.0, 0.0, 4.0), repeat=2)):
        separation.moved(part, world.inputs[j], world, box)
        for joint, u in ((0, one), (1, two)):
            pushes = part[10 + 2 * joint : 12 + 2 * joint]
            ends = [q + (u + v) * t for q in part[2 * joint : 2 * joint + 2] for v in pushes for t in (0.05, 0.1)]
            assert box[2 * joint : 2 * joint + 2] == pytest.approx([min(ends), max(ends)], abs=2e-10)
        assert box[4:] == pytest.approx([-0.06, 0.16, 0.14, 0.36, 0.05, 0.1], abs=2e-10)


@pytest.mark.parametrize("late", [0.0, 0.03])
def test_a_disk_stays_where_it_is_said_to_be(late, arm_world):
    world = arm_world()._replace(late=late)
    for body, disk in enumerate([STILL, LINE, CIRCLE]):
        for tau0, tau1 in ((0.0, 0.0), (0.0, 0.1), (0.02, 0.07)):
            box = np.array([0, 0, 0, 0, 0, 0, 0, 0, tau0, tau1])
            x, y, hx, hy, move_x, move_y, bend, contact = separation.body_of(box, body, 0.3, world)
            assert contact == disk["radius"] + 0.01 and hx == hy == 0.0
            for tau, angle in itertools.product(np.linspace(tau0 - late, tau1 + late, 9), np.linspace(0, 6, 13)):
                n = np.array([math.cos(angle), math.sin(angle)])
                ahead = n @ (naive.disk_centre(disk, 0.3 + tau) - [x, y])
                assert ahead >= -abs(n @ [move_x, move_y]) - bend - 1e-12


@pytest.mark.parametrize("evader", [False, True])
def test_tips_that_are_proved_inside_are_inside(evader, arm_world, rng):
    """Wide cells; the target's radius is about the distance of the farthest tip in samples."""
    world, stack, outcomes = arm_world(), np.empty((separation.STACK, separation.BOUNDS)), []
    for _ in range(100):
        low = rng.uniform([-3, -3, -0.3, -0.3], [3, 3, 0.3, 0.3])
        cell = np.stack([low, low + rng.uniform(0.0, [1.0, 1.0, 0.1, 0.1])], axis=1).ravel()
        centre = rng.uniform(-0.3, 0.3, 2)
        states, _ = naive.states_during(world, cell, 4, 0.0, rng, 400)
        farthest = max(
            math.dist(naive.elbow_and_tip(q1, q2, tuple(world.arm))[1], p if evader else centre)
            for q1, q2, *p in states
        )
        share = rng.uniform(0.97, 1.1)
        goal = np.array([*centre, 0.0, 0.0, 0.0, 0.0, 0.0, share * farthest])
        proved = separation.tip_inside(part_of(cell), 0.0, world._replace(chased=not evader, target=goal), stack)
        assert not proved or share >= 1.0
        outcomes.append((proved, share))
    assert np.mean([proved for proved, share in outcomes if share > 1.05]) > 0.9


def test_a_tip_is_inside_by_more_than_states_are_off(arm_world):
    """A stretched arm, whose tip is in the middle of the target, by errors of an axis; or by that of any state."""
    stack, goal = np.empty((separation.STACK, separation.BOUNDS)), np.array([0.3, *[0.0] * 7])
    chased = [(True, 0, 0.006), (True, 1, 0.003), (True, None, 4e-11)]
    flees = [(False, 0, 0.006), (False, 2, 0.02), (False, 3, 0.02), (False, None, 1.4e-10)]
    for is_chased, axis, least in chased + flees:
        world = arm_world()._replace(off=0.02 * (np.arange(4) == axis), chased=is_chased, target=goal)
        for goal[7], expected in ((0.9 * least, False), (1.1 * least + 1e-9, True)):
            assert separation.tip_inside(pose(0, 0, 0.3, 0.0), 0.0, world, stack) == expected, (is_chased, axis)


@pytest.mark.parametrize("kinematics", ["relative", "printed"])
@pytest.mark.slow
def test_what_is_proved_clear_is_clear(kinematics, arm_world, rng):
    """And what is not proved nearly touches."""
    world = arm_world(kinematics=kinematics, u_max=3.0, v_d_max=0.4, delta=0.1)
    stack, gaps = np.empty((separation.STACK, separation.BOUNDS)), {True: [], False: []}
    for trial in range(120):
        low = rng.uniform([-3, -3, -0.3, -0.3], [3, 3, 0.3, 0.3])
        cell = np.stack([low, low + rng.uniform(0.01, 0.05, 4)], axis=1).ravel()
        j, body, duration = int(rng.integers(0, 9)), trial % 4, 0.1 if trial % 3 else 0.0
        proved = separation.clear(
            (body, body + 1), part_of(cell, duration, world.push), world.inputs[j], 0.2, world, stack
        )
        gaps[proved].append(naive.smallest_gap(world, cell, j, body, 0.2, duration, rng))
    assert min(gaps[True]) > 0.0 and len(gaps[True]) > 40 and len(gaps[False]) > 10
    assert max(gaps[False]) < 0.006  # samples of a cell of up to 15 mm do not find the nearest state


def pose(q1, q2, px, py, duration=0.0, push=0.0):
    return part_of(np.array([q1, q1, q2, q2, px, px, py, py], dtype=float), duration, push)


def test_contact_is_met_to_a_hair(arm_world):
    """A stretched arm and a pursuer: 50 mm between centre and link is contact; so are rounding and a state's error."""
    world, stack, still = arm_world(obstacles=()), np.empty((separation.STACK, separation.BOUNDS)), np.zeros(2)
    at_rest = world._replace(push=0.0)
    for x, link in ((0.07, 0), (0.2, 1)):
        for y, expected in ((0.0501, True), (0.05 + 1e-8, True), (0.05 + 1e-10, False), (0.05, False), (0.03, False)):
            assert separation.link_clear(link, 0, pose(0, 0, x, y), still, 0.0, at_rest, stack) == expected
    box = pose(0, 0, 0.2, 0.05 + 5e-12)  # the error of the state left out
    arm, body = separation.pose_of(box, world.arm), separation.body_of(box, 0, 0.0, world)
    assert not separation.separated(1, arm, body, 1.0)[0]
    coming = pose(0, 0, 0.2, 0.12, 0.1, world.push)
    assert not separation.clear((0, 1), coming, np.array([3.0, 0.0]), 0.0, world, stack)
    slow = world._replace(push=0.3, agent=np.array([0.2, 0.05]))
    assert separation.clear((0, 1), pose(0, 0, 0.2, -0.085, 0.1, 0.3), np.array([3.0, 0.0]), 0.0, slow, stack)


def test_all_that_a_disturbance_adds_counts(arm_world):
    """A stretched arm at rest beside a pursuer at rest: to either side it is pushed to contact, or not as far."""
    world, stack, still = arm_world(obstacles=()), np.empty((separation.STACK, separation.BOUNDS)), np.zeros(2)
    world = world._replace(agent=np.array([0.0, 0.05]))
    for y in (-0.058, 0.058):
        for push, expected in ((0.1, True), (0.5, False)):
            part = pose(0, 0, 0.25, y, 0.1, push)
            assert separation.clear((0, 1), part, still, 0.0, world._replace(push=push), stack) == expected


def test_what_is_hard_to_separate_is_proved():
    """Cells of the case study, as many as there are by default: a corner of a cell of the pursuer, disks beside a link.

    The first one is 48 micrometres from contact, in the others the disturbance moves the arm by more than a cell.
    """
    problem = sdhj.arm_case_study()
    edges = [axis.edges() for axis in sdhj.Certified().axes(problem)]
    world, stack = Scene(problem.recipe, naive.sensing()).world(edges), np.empty((separation.STACK, separation.BOUNDS))

    def proved(bodies, joints, agent, start, duration):
        bounds = [edge[i : i + 2] for edge, i in zip(edges, (*joints, *agent), strict=True)]
        part = part_of(np.concatenate(bounds), duration, world.push)
        return separation.clear(bodies, part, world.inputs[12], start * world.delta, world, stack)

    assert proved((3, 4), (313, 117), (30, 38), 8, 0.0)
    for joints, start in (((194, 200), 1), ((186, 216), 0), ((278, 95), 0)):
        assert proved((0, 3), joints, (0, 0), start, world.held)


def test_states_beside_their_cell_count(arm_world):
    world, box = arm_world(), np.empty(10)
    cell = pose(0.3, -0.2, 0.1, 0.2)
    separation.moved(cell, world.inputs[4], world, box)
    assert (box[:8:2] <= cell[:8:2] - 0.9e-10).all() and (box[1:8:2] >= cell[1:8:2] + 0.9e-10).all()
    off = np.array([0.01, 0.02, 0.03, 0.04])  # of predictions
    separation.moved(cell, world.inputs[4], world._replace(off=off), box)
    assert (box[:8:2] <= cell[:8:2] - off).all() and (box[1:8:2] >= cell[1:8:2] + off).all()
