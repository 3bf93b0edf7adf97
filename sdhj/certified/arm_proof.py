"""What one interval does to the cells of an arm and its agent, from the case study's geometry.

The joints are the axes that number the blocks, the agent's axes are packed into bits. The inputs move only the joints
and the agent moves alike under all of them, so its part of an image is an erosion by a fixed window, done once for each
set.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from tqdm import tqdm

from sdhj.arm.case_studies import ArmScene, scene
from sdhj.certified.cells import CellAxis, measured, velocity_bounds
from sdhj.certified.contact import ArmMotion, Disks, arm_inputs, cells_clear, pursuer_clear, tips_within
from sdhj.certified.links import Agent, joint_moves
from sdhj.certified.packed import add_certified, erode_packed, erode_rows, to_words
from sdhj.compiling import hidden
from sdhj.grid import FloatArray
from sdhj.problem import ReachAvoidProblem

if TYPE_CHECKING:
    from sdhj.certified.table import CertifiedTable

HALVINGS = 5  # of an interval, to tell whether the arm is clear of a moving disk
LONGEST = 10.0  # m; CONTACT_MARGIN is for arms and speeds up to this size
MARKED_STEPS = 64  # a bit for each in `steps_blocked`


def is_arm(problem: ReachAvoidProblem) -> bool:
    """Whether a case study built the problem."""
    return bool(problem.recipe)


@dataclass(frozen=True)
class ArmProof:
    """What one interval does to the cells, for the recursion and for questions about states.

    Attributes
    ----------
    problem : ReachAvoidProblem
    axes : tuple of CellAxis
    parts : int
        Parts of the interval under the fastest input.
    motion : ArmMotion
    """

    problem: ReachAvoidProblem
    axes: tuple[CellAxis, ...]
    parts: int
    motion: ArmMotion
    kind = "arm"
    rows = 2

    @classmethod
    def of(
        cls, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, allowed: FloatArray | None = None
    ) -> "ArmProof":
        """Everything that does not depend on a set; `allowed` is computed where it is None."""
        stage, count, delta = scene(problem), len(problem.inputs), measured(problem.delta)
        arm, (x, y) = arm_numbers(stage), axes[2:]
        if max(arm[0] + arm[1], stage.agent_box, *(d.radius + d.speed for d in stage.obstacles), 0.0) > LONGEST:
            raise ValueError(f"certified sets are for lengths up to {LONGEST:g} m and speeds up to that in a second")
        speeds = [[velocity_bounds(problem, axis, j) for j in range(count)] for axis in range(2)]
        velocities = np.array(speeds, dtype=np.float64)  # (2, L, 2)
        pieces, widest = parts_of(velocities, parts), max(axis.count for axis in axes[:2])
        first, number = np.zeros((2, 2, count, widest), np.int64)
        moves = np.zeros((2, count, widest, pieces.max(), 6))
        for axis in range(2):
            n, edges = axes[axis].count, axes[axis].edges()
            for j in range(count):
                first[axis, j, :n], number[axis, j, :n] = axes[axis].image(*speeds[axis][j], delta)
                joint_moves(edges, *velocities[axis, j], problem.delta, pieces[j], moves[axis, j, :n])
        speed = float(max(velocity_bounds(problem, axis, 0)[1] for axis in (2, 3)))
        plane = (float(x.lower), float(y.lower), float(x.width), float(y.width), x.count, y.count)
        motion = ArmMotion(
            first=first,
            number=number,
            window=agent_window(problem, axes),
            moves=moves,
            parts=pieces,
            allowed=clear_of_obstacles(problem, stage, axes, velocities) if allowed is None else allowed,
            arm=arm,
            agent=Agent(float(problem.delta), speed, float(stage.agent_radius + stage.arm.half_width), *plane),
            pursued=stage.agent == "pursuer",
        )
        return cls(problem, axes, parts, motion)

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays take in memory."""
        return sum(part.nbytes for part in self.motion if isinstance(part, np.ndarray))

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Of a set: cells of the joints, words."""
        n1, n2, nx, ny = (axis.count for axis in self.axes)
        return n1, n2, -(-nx * ny // 64)

    def inputs(self, table: "CertifiedTable", states: FloatArray, step: int, places: tuple[int, int]) -> FloatArray:
        """Which inputs are certified for states (M, 4), bool (M, L); places of S_k^n and S_{k+1}^{n-1} in the index."""
        out = np.empty((len(states), self.motion.parts.size), np.bool_)
        index, following = (table.index[place] for place in places)
        arm_inputs(states, step, table.cells, self.motion, index, following, table.pool, out)
        return out

    def save(self, group: h5py.Group) -> None:
        """Write what is not quickly computed again: where the arm is clear of the known obstacles."""
        allowed = self.motion.allowed
        group.attrs.update(parts=self.parts, allowed_shape=allowed.shape)
        group.create_dataset("allowed", data=np.packbits(allowed, bitorder="little"), compression="gzip")

    @classmethod
    def load(cls, group: h5py.Group, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...]) -> "ArmProof":
        """Read what `save` wrote."""
        shape = tuple(int(n) for n in group.attrs["allowed_shape"])
        bits = np.unpackbits(group["allowed"][()], count=math.prod(shape), bitorder="little")
        return cls.of(problem, axes, int(group.attrs["parts"]), bits.view(np.bool_).reshape(shape))

    # ---- the recursion; sets are (n1 * n2, W) uint64

    @property
    def needed(self) -> int:
        """Bytes that the recursion takes: where each input is clear, two sets, scratch."""
        return 8 * (len(self.problem.inputs) + 6) * math.prod(self.shape)

    def prepare(self, progress: bool | None) -> list[FloatArray]:
        """For each input the cells from which the agent cannot touch the arm during one interval, each (n1, n2, W)."""
        motion, clear = self.motion, []
        for j in tqdm(range(motion.parts.size), desc="intervals", disable=hidden(progress)):
            clear.append(np.empty(self.shape, np.uint64))
            if motion.pursued:
                moves = (motion.moves[axis, j, : self.shape[axis], : motion.parts[j]] for axis in (0, 1))
                pursuer_clear(*map(np.ascontiguousarray, moves), motion.arm, motion.agent, clear[j])
            else:
                clear[j][:] = to_words(np.ones(motion.agent.nx * motion.agent.ny, np.bool_))
        return clear

    def add(self, clear: Any, cells: FloatArray, following: FloatArray, step: int, within: int) -> None:
        """Add to `cells`, S_k^{n-1}, those that an input takes into `following`, S_{k+1}^{n-1}."""
        motion, (n1, n2, words) = self.motion, self.shape
        eroded, scratch = following.copy(), np.empty((n1, n2 * words), np.uint64)
        erode_packed(eroded, *packed_window(motion.window, motion.agent.nx, motion.agent.ny))
        tables = np.stack([motion.first[0, :, :n1], motion.number[0, :, :n1]], axis=1)
        for table in np.unique(tables, axis=0):  # inputs that move the first joint alike
            erode_rows(eroded.reshape(n1, n2 * words), *table, scratch)
            for j in np.flatnonzero((tables == table).all(axis=(1, 2))):
                second = motion.first[1, j, :n2], motion.number[1, j, :n2]
                allowed, out = motion.allowed[step, j], cells.reshape(self.shape)
                add_certified(scratch.reshape(self.shape), *second, allowed, clear[j], out)

    def goal(self, step: int) -> FloatArray:
        """Cells inside the target and outside the unsafe set at t_k."""
        motion, t, stage = self.motion, self.problem.time(step), scene(self.problem)
        out, inside = np.empty(self.shape, np.uint64), np.empty((*self.shape[:2], 1), np.uint64)
        edges = [axis.edges() for axis in self.axes[:2]]
        still = [at_rest(own) for own in edges]
        if stage.target is None:
            tips_within(*still, stage.agent_radius, motion.arm, motion.agent, out)
        else:
            pursuer_clear(*still, motion.arm, motion.agent._replace(delta=0.0, speed=0.0), out)
            (x, y), width = stage.target.centre(t), 0.0
            centre = Agent(0.0, 0.0, 0.0, float(x), float(y), width, width, 1, 1)
            tips_within(*still, stage.target.radius, motion.arm, centre, inside)
            out *= inside
        if stage.obstacles:
            clear = np.empty((1, 1, *self.shape[:2]), np.bool_)
            known = known_disks(stage, np.full((3, 1), t), 0.0, 0)
            cells_clear(*edges, np.zeros((2, 1, 2)), known, motion.arm, clear)
            out *= clear[0, 0, :, :, None].astype(np.uint64)
        return out.reshape(-1, self.shape[2])

    def share(self, step: int, within: int) -> None:
        """Nothing is kept of the inputs."""


def arm_numbers(stage: ArmScene) -> FloatArray:
    """(l1, l2, turn) of `links.link_points`: see `Arm.joints`."""
    l1, l2 = stage.arm.lengths
    return np.array([l1, l2, 1.0]) if stage.arm.kinematics == "relative" else np.array([l1, l1 + l2, 0.0])


def parts_of(velocities: FloatArray, parts: int) -> FloatArray:
    """Into how many parts the interval is cut under each input: in proportion to its speed, (L,) int64."""
    speed = np.abs(velocities.mean(axis=2)).max(axis=0)
    return np.maximum(np.ceil(parts * speed / max(speed.max(), 1e-300)), 1.0).astype(np.int64)


def agent_window(problem: ReachAvoidProblem, axes: Sequence[CellAxis]) -> FloatArray:
    """First and last cell that the image of each cell of the agent's axes needs; (2, 2, n), padded."""
    window = np.zeros((2, 2, max(axes[2].count, axes[3].count)), np.int64)
    for place, axis in enumerate((2, 3)):
        first, number = axes[axis].image(*velocity_bounds(problem, axis, 0), measured(problem.delta))
        window[place, :, : first.size] = first, first + number - 1
    return window


def clear_of_obstacles(
    problem: ReachAvoidProblem, stage: ArmScene, axes: Sequence[CellAxis], velocities: FloatArray
) -> FloatArray:
    """Cells of the joints from which the arm stays clear of the known obstacles: (steps, L, n1, n2) bool."""
    steps, count = problem.steps, velocities.shape[1]
    if steps > MARKED_STEPS:
        raise ValueError(f"certified sets are for at most {MARKED_STEPS} steps, got {steps}")
    out = np.ones((steps, count, axes[0].count, axes[1].count), np.bool_)
    if stage.obstacles:
        instants = np.arange(2 ** (HALVINGS + 1) + 1) / 2 ** (HALVINGS + 1)
        times = (np.arange(steps) + instants[:, None]) * problem.delta
        known = known_disks(stage, times, problem.delta, HALVINGS)
        cells_clear(axes[0].edges(), axes[1].edges(), velocities, known, arm_numbers(stage), out)
    return out


def known_disks(stage: ArmScene, times: FloatArray, delta: float, depth: int) -> Disks:
    """The obstacles at times (2^(depth + 1) + 1, steps)."""
    return Disks(
        delta=float(delta),
        depth=depth,
        centres=np.ascontiguousarray(np.stack([disk.centre(times) for disk in stage.obstacles], axis=-2)),
        radii=np.array([disk.radius + stage.arm.half_width for disk in stage.obstacles]),
        speeds=np.array([disk.speed for disk in stage.obstacles]),
    )


def at_rest(edges: FloatArray) -> FloatArray:
    """`joint_moves` of cells that do not move."""
    moves = np.empty((edges.size - 1, 1, 6))
    joint_moves(edges, 0.0, 0.0, 0.0, 1, moves)
    return moves


def packed_window(window: FloatArray, nx: int, ny: int) -> tuple[FloatArray, FloatArray]:
    """Shifts and passes of `packed.erode_packed` for the windows of the agent's two axes.

    A cell needs its neighbours at the offsets of the widest window, but for those beyond its own window, at a wall.
    """
    x, y = np.divmod(np.arange(nx * ny), ny)
    first = np.stack([window[0, 0, x] - x, window[1, 0, y] - y])
    last = np.stack([window[0, 1, x] - x, window[1, 1, y] - y])
    if first.max() > 0 or last.min() < 0:
        raise ValueError("the agent must be able to stay where it is: its drift is larger than its speed")
    offsets = np.arange(first.min(), last.max() + 1)
    passes = (offsets[:, None] < first[:, None]) | (offsets[:, None] > last[:, None])  # (2, offsets, cells)
    return offsets * np.array([[ny], [1]]), to_words(passes)
