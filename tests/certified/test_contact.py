"""Contact of the arm with what moves: at every time, and to a hair."""

import math

import numpy as np
import pytest

from sdhj.common.remembering import read_only
from sdhj.kernels.arm import contact
from sdhj.kernels.arm.links import Agent, joint_moves

pytestmark = pytest.mark.slow  # the arm's own kernels are compiled

ARM = read_only(np.array([0.15, 0.15, 1.0]))


def pursuer_clear(moves1, moves2, agent):
    """Whether a pursuer with one cell stays clear of an arm with one cell."""
    out = np.empty((1, 1, 1), np.uint64)
    contact.pursuer_clear(read_only(moves1), read_only(moves2), ARM, agent, out)
    return out[0, 0, 0] == 1


def met_at_rest(offset):
    """Whether a pursuer's cell whose lower edge is `offset` beyond contact with a stretched arm is met."""
    still = joint_moves(np.zeros((1, 2)), 0.0, 0.0, 0.0, 1)  # a cell without width: the arm points along x
    return not pursuer_clear(still, still, Agent(0.0, 0.0, 0.05, 0.0, 0.05 + offset, 0.3, 0.1, 1, 1))


def disk_clear(*, centres, radius, speed=0.0, delta=0.0, depth=0, slow=(0.0, 0.0), fast=(0.0, 0.0), q=(0.0, 0.0)):
    """Whether the arm at q is clear of one disk through an interval of one step."""
    ends, velocities = [np.array([[angle, angle]]) for angle in q], np.stack([slow, fast], axis=1)[:, None]
    instants = 2 ** (depth + 1) + 1
    centres = np.broadcast_to(np.asarray(centres, dtype=float), (instants, 2)).reshape(instants, 1, 1, 2).copy()
    disks = contact.Disks(delta, depth, centres, np.array([radius]), np.array([speed]))
    out = np.empty((1, 1, 1, 1), np.bool_)
    contact.cells_clear(*ends, velocities, disks, ARM, out)
    return bool(out[0, 0, 0, 0])


def test_contact_within_rounding_is_not_clear():
    """What is apart by no more than rounding and slack explain counts as touching; a tenth of a millimetre does not."""
    assert met_at_rest(0.0) and met_at_rest(1e-10) and not met_at_rest(1e-4)
    for gap, clear in ((0.0, False), (1e-10, False), (1e-4, True)):
        assert disk_clear(centres=(0.1, 0.05 + gap), radius=0.05) == clear
    still, inside = read_only(joint_moves(np.zeros((1, 2)), 0.0, 0.0, 0.0, 1)), np.empty((1, 1, 1), np.uint64)
    centre = Agent(0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1, 1)  # a cell without width
    for gap, expected in ((0.0, False), (1e-10, False), (1e-4, True)):
        contact.tips_within(still, still, 0.1 + gap, ARM, centre, inside)
        assert inside[0, 0, 0] == expected


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
        moves = (
            joint_moves(np.zeros((1, 2)), slow, fast, 0.1, parts),
            joint_moves(np.zeros((1, 2)), 0.0, 0.0, 0.1, parts),
        )
        return pursuer_clear(*moves, Agent(0.1, speed, 0.05, 0.24, 0.05 + offset, 0.01, 0.01, 1, 1))

    assert clear(0.021, 0.0, 0.0, 0.2) and not clear(0.019, 0.0, 0.0, 0.2)  # it comes 0.02 nearer
    assert not clear(0.03, 0.0, 3.0, 0.0)  # the arm comes to it
    assert clear(-0.15, 0.0, 0.0, 0.0) and not clear(-0.15, -3.0, 0.0, 0.0)  # and to the other side
