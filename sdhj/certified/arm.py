"""Certified sets of the case studies: the arm's geometry and the recursion on packed cells.

The joints are the axes that number the blocks, the agent's axes are packed into bits. The inputs move only the joints
and the agent moves alike under all of them, so its part of an image is an erosion by a fixed window, done once for each
set.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import h5py
import numpy as np
from tqdm import tqdm

from sdhj.arm.case_studies import ArmScene, scene
from sdhj.certified import kernels
from sdhj.certified.cells import CellAxis, measured
from sdhj.certified.kernels import ArmMotion, Cells
from sdhj.compiling import hidden
from sdhj.grid import FloatArray
from sdhj.memory import require
from sdhj.problem import ReachAvoidProblem
from sdhj.table import entry

HALVINGS = 5  # of an interval, to tell whether the arm is clear of a moving disk
LONGEST = 10.0  # m; MARGIN is for arms and speeds up to this size
MOST_STEPS = 64  # a bit for each in `disks_clear`


def is_arm(problem: ReachAvoidProblem) -> bool:
    """Whether a case study built the problem."""
    return bool(problem.recipe)


@dataclass(frozen=True)
class ArmProof:
    """What one interval does to the cells of an arm and its agent.

    Attributes
    ----------
    motion : ArmMotion
        Arrays for the questions about one state.
    parts : int
        Parts of the interval under the fastest input.
    """

    motion: ArmMotion
    parts: int
    kind = "arm"
    rows = 2

    @classmethod
    def prepare(cls, problem: ReachAvoidProblem, axes: Sequence[CellAxis], parts: int) -> "ArmProof":
        """Compute everything that does not depend on a set."""
        return cls(arm_motion(problem, axes, parts, None), parts)

    def recursion(
        self, problem: ReachAvoidProblem, axes: Sequence[CellAxis], progress: bool | None
    ) -> tuple[FloatArray, FloatArray]:
        """Index and pool of all S_k^n."""
        return ArmRecursion(problem, axes, self.motion).run(progress)

    def inputs_of(
        self,
        state: FloatArray,
        step: int,
        cells: Cells,
        index: FloatArray,
        place: int,
        following: int,
        pool: FloatArray,
    ) -> FloatArray:
        """Which inputs are certified for one state (4,), bool (L,)."""
        out = np.empty(self.motion.parts.size, np.bool_)
        kernels.arm_inputs_one(state, step, cells, self.motion, index[place], index[following], pool, out)
        return out

    def inputs_of_many(
        self,
        states: FloatArray,
        step: int,
        cells: Cells,
        index: FloatArray,
        place: int,
        following: int,
        pool: FloatArray,
    ) -> FloatArray:
        """Which inputs are certified for states (M, 4), bool (M, L)."""
        out = np.empty((len(states), self.motion.parts.size), np.bool_)
        inside = np.empty(len(states), np.bool_)
        kernels.arm_inputs_many(states, step, cells, self.motion, index[place], index[following], pool, inside, out)
        return out

    def save(self, group: h5py.Group) -> None:
        """Write what is not quickly computed again: where the arm is clear of the known obstacles."""
        allowed = self.motion.allowed
        group.attrs.update(parts=self.parts, allowed_shape=allowed.shape)
        group.create_dataset("allowed", data=np.packbits(allowed, bitorder="little"), compression="gzip")

    @classmethod
    def load(cls, group: h5py.Group, problem: ReachAvoidProblem, axes: Sequence[CellAxis]) -> "ArmProof":
        """Read what `save` wrote."""
        shape = tuple(int(n) for n in group.attrs["allowed_shape"])
        bits = np.unpackbits(group["allowed"][()], count=int(np.prod(shape)), bitorder="little")
        parts = int(group.attrs["parts"])
        return cls(arm_motion(problem, axes, parts, bits.view(np.bool_).reshape(shape)), parts)


def velocity_bounds(problem: ReachAvoidProblem, axis: int, j: int) -> tuple[Fraction, Fraction]:
    """Least and greatest velocity on one axis under input j, exactly, for dynamics that do not depend on the state."""
    dynamics = problem.dynamics
    pushes = zip(np.asarray(dynamics.gain)[axis], dynamics.bounds, strict=True)
    push = sum((abs(measured(g)) * measured(b) for g, b in pushes), Fraction(0))
    drift = measured(np.asarray(dynamics.drift)[j, axis])
    return drift - push, drift + push


def arm_motion(
    problem: ReachAvoidProblem, axes: Sequence[CellAxis], parts: int, allowed: FloatArray | None
) -> ArmMotion:
    """The arrays of `ArmMotion`; `allowed` is computed where it is None."""
    stage, count = scene(problem), len(problem.inputs)
    arm = arm_numbers(stage)
    if max(arm[0] + arm[1], stage.agent_box, *(disk.radius + disk.speed for disk in stage.obstacles), 0.0) > LONGEST:
        raise ValueError(f"certified sets are for lengths up to {LONGEST:g} m and speeds up to that in a second")
    delta = measured(problem.delta)
    speeds = [[velocity_bounds(problem, axis, j) for j in range(count)] for axis in range(2)]
    velocities = np.array([[[float(end) for end in bounds] for bounds in axis] for axis in speeds])  # (2, L, 2)
    pieces = parts_of(velocities, parts)
    widest = max(axes[0].count, axes[1].count)
    first, number = np.zeros((2, count, widest), np.int64), np.zeros((2, count, widest), np.int64)
    moves = np.zeros((2, count, widest, pieces.max(), 6))
    for axis in range(2):
        n, edges = axes[axis].count, axes[axis].edges()
        for j in range(count):
            first[axis, j, :n], number[axis, j, :n] = axes[axis].image(*speeds[axis][j], delta)
            slow, fast = velocities[axis, j]
            kernels.joint_moves(edges, slow, fast, problem.delta, pieces[j], moves[axis, j, :n])
    if allowed is None:
        allowed = clear_of_obstacles(problem, stage, axes, velocities)
    return ArmMotion(
        first=first,
        number=number,
        window=agent_window(problem, axes),
        moves=moves,
        parts=pieces,
        allowed=allowed,
        delta=float(problem.delta),
        speed=float(max(velocity_bounds(problem, axis, 0)[1] for axis in (2, 3))),
        radius=float(stage.agent_radius + stage.arm.half_width),
        arm=arm,
        plane=np.array([float(axes[2].lower), float(axes[3].lower), float(axes[2].width), float(axes[3].width)]),
        shape=np.array([axes[2].count, axes[3].count]),
        pursuer=stage.agent == "pursuer",
    )


def arm_numbers(stage: ArmScene) -> FloatArray:
    """(l1, l2, turn) of `kernels.link_points`: see `Arm.joints`."""
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
        window[place, 0, : first.size] = first
        window[place, 1, : first.size] = first + number - 1
    return window


def clear_of_obstacles(
    problem: ReachAvoidProblem, stage: ArmScene, axes: Sequence[CellAxis], velocities: FloatArray
) -> FloatArray:
    """Cells of the joints from which the arm stays clear of the known obstacles: (steps, L, n1, n2) bool."""
    steps, count = problem.steps, velocities.shape[1]
    if steps > MOST_STEPS:
        raise ValueError(f"certified sets are for at most {MOST_STEPS} steps, got {steps}")
    out = np.ones((steps, count, axes[0].count, axes[1].count), np.bool_)
    if stage.obstacles:
        instants = np.arange(2 ** (HALVINGS + 1) + 1) / 2 ** (HALVINGS + 1)
        times = (np.arange(steps) + instants[:, None]) * problem.delta
        slow, fast = np.ascontiguousarray(velocities[..., 0].T), np.ascontiguousarray(velocities[..., 1].T)
        kernels.disks_clear(
            axes[0].edges(),
            axes[1].edges(),
            slow,
            fast,
            problem.delta,
            *disks(stage, times),
            HALVINGS,
            arm_numbers(stage),
            out,
        )
    return out


def disks(stage: ArmScene, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The obstacles' centres at times of any shape (*shape, disks, 2), radii of contact and speeds (disks,)."""
    centres = np.ascontiguousarray(np.stack([disk.centre(times) for disk in stage.obstacles], axis=-2))
    radii = np.array([disk.radius + stage.arm.half_width for disk in stage.obstacles])
    return centres, radii, np.array([disk.speed for disk in stage.obstacles])


class ArmRecursion:
    """Theorem 2 on packed cells, one more step to go at a time."""

    def __init__(self, problem: ReachAvoidProblem, axes: Sequence[CellAxis], motion: ArmMotion) -> None:
        self.problem, self.axes, self.motion = problem, tuple(axes), motion
        self.stage = scene(problem)
        self.n1, self.n2, nx, ny = (axis.count for axis in axes)
        self.words = -(-nx * ny // 64)
        held = len(problem.inputs) + problem.steps + 4  # where each input is clear, the set of each step, scratch
        needed = 8 * held * self.n1 * self.n2 * self.words
        require(needed, f"certifying {self.n1 * self.n2 * nx * ny:.1e} cells", "use fewer cells")
        self.shifts, self.passes = packed_window(motion.window, nx, ny)
        self.chunks = [np.zeros((1, self.words), np.uint64)]  # of the pool; its first block is empty
        self.blocks = 1
        steps = problem.steps
        self.index = np.zeros((entry(steps, steps, 0) + 1, self.n1 * self.n2), np.uint32)

    def run(self, progress: bool | None) -> tuple[FloatArray, FloatArray]:
        """Index and pool of all sets."""
        steps, count = self.problem.steps, len(self.problem.inputs)
        with tqdm(total=count + steps * (steps + 1) // 2, desc="certified", disable=hidden(progress)) as bar:
            sets = [self.goal(step) for step in range(steps + 1)]
            for step in range(steps + 1):
                self.keep(sets[step], np.any(sets[step] != 0, axis=2), entry(steps, step, 0), None)
            clear = self.clear_of_agent(bar)
            for within in range(1, steps + 1):
                for step in range(steps - within + 1):  # ascending: S_{k+1} still has within - 1 steps to go
                    changed = self.add_step(sets[step], sets[step + 1], step, clear)
                    self.keep(sets[step], changed, entry(steps, step, within), entry(steps, step, within - 1))
                    bar.update()
        del sets, clear
        return self.index, np.concatenate(self.chunks)

    def keep(self, cells: FloatArray, changed: FloatArray, place: int, before: int | None) -> None:
        """Add the changed blocks of a set to the pool."""
        rows = np.flatnonzero(changed.ravel())
        if before is not None:
            self.index[place] = self.index[before]
        self.index[place, rows] = np.arange(self.blocks, self.blocks + rows.size)
        self.blocks += rows.size
        self.chunks.append(cells.reshape(-1, self.words)[rows])

    def add_step(self, cells: FloatArray, following: FloatArray, step: int, clear: list[FloatArray]) -> FloatArray:
        """Add to a set every cell that one step takes into `following`; which blocks changed, (n1, n2) bool."""
        n1, n2, words, motion = self.n1, self.n2, self.words, self.motion
        changed = np.zeros((n1, n2), np.bool_)
        eroded = following.copy()
        kernels.erode_packed(eroded.reshape(n1 * n2, words), self.shifts, self.passes)
        scratch = np.empty_like(eroded)
        tables = (motion.first[0, :, :n1], motion.number[0, :, :n1])
        for group in alike(np.concatenate(tables, axis=1)):  # inputs that move the first joint alike
            kernels.erode_rows(
                eroded.reshape(1, n1, n2 * words),
                tables[0][group[0]],
                tables[1][group[0]],
                scratch.reshape(1, n1, n2 * words),
            )
            for j in group:
                first, number = motion.first[1, j, :n2], motion.number[1, j, :n2]
                kernels.add_certified(scratch, first, number, motion.allowed[step, j], clear[j], cells, changed)
        return changed

    def clear_of_agent(self, bar: Any) -> list[FloatArray]:
        """For each input the cells from which the agent cannot touch the arm during one interval, each (n1, n2, W)."""
        motion, out = self.motion, []
        if not motion.pursuer:
            everything = np.zeros(self.words * 64, np.bool_)
            everything[: int(np.prod(motion.shape))] = True
            return [np.tile(pack(everything), (self.n1, self.n2, 1))] * motion.parts.size
        for j in range(motion.parts.size):
            clear = np.empty((self.n1, self.n2, self.words), np.uint64)
            moves1, moves2 = (
                np.ascontiguousarray(motion.moves[axis, j, :n, : motion.parts[j]])
                for axis, n in ((0, self.n1), (1, self.n2))
            )
            kernels.pursuer_clear(
                moves1, moves2, motion.delta, motion.speed, motion.radius, motion.arm, motion.plane, motion.shape, clear
            )
            out.append(clear)
            bar.update()
        return out

    def goal(self, step: int) -> FloatArray:
        """S_k^0: cells inside the target and outside the unsafe set at t_k, (n1, n2, W)."""
        motion, stage = self.motion, self.stage
        edges1, edges2 = self.axes[0].edges(), self.axes[1].edges()
        t = self.problem.time(step)
        out = np.empty((self.n1, self.n2, self.words), np.uint64)
        still = [at_rest(edges) for edges in (edges1, edges2)]
        if stage.target is None:
            reach = stage.agent_radius
            kernels.tip_near_cells(still[0], still[1], reach, motion.arm, motion.plane, motion.shape, out)
        else:
            kernels.pursuer_clear(
                still[0], still[1], 0.0, 0.0, motion.radius, motion.arm, motion.plane, motion.shape, out
            )
            inside = np.empty((self.n1, self.n2), np.bool_)
            kernels.tip_inside(still[0], still[1], stage.target.centre(t), stage.target.radius, motion.arm, inside)
            out *= inside[:, :, None].astype(np.uint64)
        if stage.obstacles:
            clear = np.empty((1, 1, self.n1, self.n2), np.bool_)
            nothing = np.zeros((1, 2))
            kernels.disks_clear(
                edges1, edges2, nothing, nothing, 0.0, *disks(stage, np.full((3, 1), t)), 0, motion.arm, clear
            )
            out *= clear[0, 0, :, :, None].astype(np.uint64)
        return out


def at_rest(edges: FloatArray) -> FloatArray:
    """`joint_moves` of cells that do not move."""
    moves = np.empty((edges.size - 1, 1, 6))
    kernels.joint_moves(edges, 0.0, 0.0, 0.0, 1, moves)
    return moves


def alike(rows: FloatArray) -> list[FloatArray]:
    """Groups of the indices of equal rows."""
    _, group = np.unique(rows, axis=0, return_inverse=True)
    return [np.flatnonzero(group.ravel() == g) for g in range(group.max() + 1)]


def pack(bits: FloatArray) -> FloatArray:
    """Bool (..., 64 W) as uint64 (..., W), the first bit lowest."""
    return np.packbits(bits, axis=-1, bitorder="little").view(np.uint64)


def packed_window(window: FloatArray, nx: int, ny: int) -> tuple[FloatArray, FloatArray]:
    """Shifts and passes of `kernels.erode_packed` for the windows of the agent's two axes.

    A cell needs its neighbours at the offsets of the widest window, but for those beyond its own window, at a wall.
    """
    x, y = np.divmod(np.arange(nx * ny), ny)
    words = -(-nx * ny // 64)
    shifts, passes = [], []
    for axis, (place, stride, n) in enumerate(((x, ny, nx), (y, 1, ny))):
        first, last = window[axis, 0, :n][place] - place, window[axis, 1, :n][place] - place
        if first.max() > 0 or last.min() < 0:
            raise ValueError("the agent must be able to stay where it is: its drift is larger than its speed")
        offsets = [offset for offset in range(first.min(), last.max() + 1) if offset != 0]
        shifts.append([offset * stride for offset in offsets])
        beyond = np.zeros((len(offsets), words * 64), np.bool_)
        for k, offset in enumerate(offsets):
            beyond[k, : nx * ny] = (offset < first) | (offset > last)
        passes.append(pack(beyond))
    most = max(len(own) for own in shifts)
    padded = np.zeros((2, most, words), np.uint64)
    for axis in range(2):
        padded[axis, : len(passes[axis])] = passes[axis]
    return np.array([own + [0] * (most - len(own)) for own in shifts], dtype=np.int64).reshape(2, most), padded
