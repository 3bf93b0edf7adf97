"""What one interval does to the cells of an arm and its agent, from the case study's geometry.

The joints are the axes that number the blocks, the agent's axes are packed into bits. The inputs move only the joints
and the agent moves alike under all of them, so its part of an image is an erosion by a fixed window, done once for each
set. The window is a box: an agent whose speed is bounded by a norm counts as one with the square of velocities around.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from tqdm import tqdm

from sdhj.arm.case_studies import ArmScene, scene
from sdhj.arm.workspace import Still
from sdhj.certified.cells import MOST_PIECES, CellAxis, moved_bounds, prediction_error_along, velocity_bounds
from sdhj.certified.images import Proof
from sdhj.common.checks import whole
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray, read_only
from sdhj.common.showing import hidden
from sdhj.formulas.formula import Ends
from sdhj.kernels.arm.contact import ArmMotion, Disks, arm_inputs, cells_clear, pursuer_clear, tips_within
from sdhj.kernels.arm.links import Agent, joint_moves
from sdhj.kernels.packed import STATE_SLACK, add_certified, erode_packed, erode_rows, to_words
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.container import Contents
from sdhj.table.files import read_array

HALVINGS = 5  # of an interval, to tell whether the arm is clear of a moving disk
LONGEST = 10.0  # m; CONTACT_MARGIN is for arms and speeds up to this size
MARKED_STEPS = 64  # a bit for each in `steps_blocked`


@dataclass(frozen=True)
class ArmProof(Proof):
    """The images of an arm's cells over one interval, for the recursion and for questions about states.

    The axes are the two joint angles and the coordinates x and y of the agent: the pursuer or the evader whose position
    is in the state. Sets of cells are packed: a row for each pair of cells of the joints, in it a bit for each pair of
    cells of the agent.
    """

    # images, tubes and where the arm is clear of the known obstacles; fewer parts under slower inputs
    motion: ArmMotion
    kind = "arm"

    rows = 2
    time_invariant = False

    @classmethod
    def of(
        cls, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int, allowed: FloatArray | None = None
    ) -> "ArmProof":
        """The proof of an arm's problem, with all that depends on no set; `allowed` is that of `clear_of_obstacles`.

        ValueError for lengths or speeds beyond `LONGEST`, more than `MARKED_STEPS` steps, jitter without a `Still`.
        """
        stage, count = scene(problem), len(problem.inputs)
        arm, (x, y), length = arm_numbers(stage), axes[2:], problem.sensing.hold(problem.delta)[0]
        if max(arm[0] + arm[1], stage.agent_box, *(d.radius + d.speed for d in stage.obstacles), 0.0) > LONGEST:
            raise ValueError(f"certified sets are for lengths up to {LONGEST:g} m and speeds up to that in a second")
        if problem.sensing.jitter and stage.target is not None and not isinstance(stage.target.path, Still):
            # a line or circle at speed 0: what moves the problem has refused
            raise ValueError(
                f"with jitter the path of an arm's target must be a Still, which the checker knows to be at rest, got "
                f'{stage.target.path}; use a Still, or method="hji"'
            )
        if problem.steps > MARKED_STEPS:
            raise ValueError(f"certified sets are for at most {MARKED_STEPS} steps, got {problem.steps}")
        speeds = [[velocity_bounds(problem, axis, j) for j in range(count)] for axis in range(4)]
        velocities = np.array(speeds[:2], dtype=np.float64)  # (2, L, 2)
        speed = np.abs(velocities.mean(axis=2)).max(axis=0)
        # a file states `parts` alone, so that `load` has to cut as the solve did
        pieces = np.maximum(np.ceil(parts * speed / max(speed.max(), 1e-300)), 1.0).astype(np.int64)
        widest, cells = max(axis.count for axis in axes), math.prod(axis.count for axis in axes)
        needed = cls.peak_bytes_for(problem, axes, parts) if allowed is None else count * widest * (64 + 96 * parts)
        require_memory(needed, f"certifying {cells:.1e} cells", "use fewer cells")
        first, number = np.zeros((2, 4, count, widest), np.int64)
        moves = np.zeros((2, count, widest, pieces.max(), 6))
        for (axis, own), j in itertools.product(enumerate(axes), range(count)):
            images = own.image(*moved_bounds(problem, axis, j))
            first[axis, j, : own.count], number[axis, j, : own.count] = images
            if axis < 2:
                moved = joint_moves(_may_be(problem, axes, axis), *velocities[axis, j], length, pieces[j])
                moves[axis, j, : own.count, : pieces[j]] = moved
        if allowed is None:
            instants = np.arange(2 ** (HALVINGS + 1) + 1) / 2 ** (HALVINGS + 1)
            # intervals begin a delay later, and are as long as jitter may make them (`World.begin` and `held` in the
            # checker)
            parts_of = np.arange(problem.steps) + instants[:, None] * (length / problem.delta)
            times = parts_of * problem.delta + problem.sensing.delay
            allowed = clear_of_obstacles(problem, axes, times, velocities, length)
        contact = float(stage.agent_radius + stage.arm.half_width)
        fastest = float(max(speeds[2][0][1], speeds[3][0][1]))
        plane = (float(x.lower), float(y.lower), float(x.width), float(y.width), x.count, y.count)
        prediction_error = float(max(prediction_error_along(problem, 2), prediction_error_along(problem, 3)))
        agent, pursued = Agent(length, fastest, contact, *plane, prediction_error), stage.agent == "pursuer"
        return cls(problem, axes, parts, ArmMotion(first, number, moves, pieces, allowed, arm, agent, pursued))

    def __post_init__(self) -> None:
        read_only(tuple(self.motion))

    @property
    def shell(self) -> FloatArray:
        """How far off a cell a state counts as in it, (4,): `STATE_SLACK`, in metres and radians."""
        return read_only(np.full(4, STATE_SLACK))

    @staticmethod
    def peak_bytes_for(problem: ReachAvoidProblem, axes: tuple[CellAxis, ...], parts: int) -> int:
        """The bytes that a solve takes at most, without the sets; an estimate from above."""
        count, (n1, n2, nx, ny) = len(problem.inputs), (axis.count for axis in axes)
        # where each input is clear, of obstacles and of the agent; two sets, scratch; its motion
        joints = n1 * n2 * problem.steps + max(n1, n2, nx, ny) * (64 + 96 * parts)
        return count * joints + 8 * (count + 6) * -(-n1 * n2 * nx * ny // 64)

    @property
    def peak_bytes(self) -> int:
        """As `peak_bytes_for`."""
        return self.peak_bytes_for(self.problem, self.axes, self.parts)

    @property
    def nbytes(self) -> int:
        """The bytes that the proof's arrays take in memory."""
        return sum(part.nbytes for part in self.motion if isinstance(part, np.ndarray))

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """The shape (n1, n2, W) of a packed set: cells of both joints, words of the agent's cells."""
        n1, n2, nx, ny = (axis.count for axis in self.axes)
        return n1, n2, -(-nx * ny // 64)

    @property
    def depends(self) -> FloatArray:
        """depends[i, k]: whether the image along axis i varies with the index along axis k: if i = k."""
        return read_only(np.eye(4, dtype=np.bool_))

    def image(self, some: FloatArray, inputs: Any, step: int) -> Ends:
        """The first and the last cell, each (M, 4), of the images of cells `some` (M, 4) under inputs.

        On a periodic axis the last cell may lie past the end.
        """
        at = np.arange(some.shape[-1]), np.asarray(inputs)[..., None], some
        return self.motion.first[at], self.motion.first[at] + self.motion.number[at] - 1

    def inputs(
        self,
        some: FloatArray,
        steps_left: FloatArray,
        step: int,
        sets: FloatArray,
        pool: FloatArray,
        among: FloatArray,
        lines: bool,
    ) -> FloatArray:
        """As `GeneralProof.inputs`."""
        # `lines` is not read: cells of an arm have none (`Proof.along`).
        out = among.copy()
        arm_inputs(some, steps_left, step, self.cells, self.motion, sets, pool, out)
        return out

    @property
    def entry_in_head(self) -> dict[str, Any]:
        """The proof's part of a file's head: the parts of an interval."""
        return {"parts": self.parts}

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """The proof's array in a file, "allowed": bits in bytes, the lowest first."""
        return {"allowed": np.packbits(self.motion.allowed, bitorder="little")}

    @classmethod
    def load(
        cls, stated: Mapping[str, Any], file: Contents, problem: ReachAvoidProblem, axes: tuple[CellAxis, ...]
    ) -> "ArmProof":
        """The proof whose array is in an open file.

        The bits are not checked.
        """
        shape = (problem.steps, len(problem.inputs), axes[0].count, axes[1].count)
        packed = read_array(file, "allowed", "uint8", (-(-math.prod(shape) // 8),))
        # in the order of steps, inputs and joints, which the checker's `Arm` reads, too
        bits = np.unpackbits(packed, count=math.prod(shape), bitorder="little")
        parts = whole("parts", stated["parts"], least=1, most=MOST_PIECES)
        # All else is computed anew from the problem: a file has the bits of the obstacles alone.
        return cls.of(problem, axes, parts, bits.view(np.bool_).reshape(shape))

    # ---- the recursion; sets are (n1 * n2, W) uint64

    def prepare(self, progress: bool | None) -> list[FloatArray]:
        """The cells from which the agent cannot touch the arm in an interval: (n1, n2, W) uint64 for each input."""
        motion, clear = self.motion, []
        for j in tqdm(range(motion.parts.size), desc="intervals", leave=False, disable=hidden(progress)):
            clear.append(np.empty(self.shape, np.uint64))
            if motion.pursued:
                # Contiguous, as `pursuer_clear` is compiled once more for arrays of another layout.
                moves = (motion.moves[axis, j, : self.shape[axis], : motion.parts[j]] for axis in (0, 1))
                pursuer_clear(*read_only([*map(np.ascontiguousarray, moves)]), motion.arm, motion.agent, clear[j])
            else:
                # an evader may be touched
                clear[j][:] = to_words(np.ones(motion.agent.nx * motion.agent.ny, np.bool_))
        return clear

    def add(self, clear: Any, cells: FloatArray, following: FloatArray, step: int, changed: Any = None) -> None:
        """Turn `cells`, S_k^{n-1}, into S_k^n for k = step, in place: add those that an input leads into `following`.

        Of these inputs, the arm has to stay clear of the obstacles and, by `clear` of `prepare`, of the agent. Sets are
        (n1 n2, W) uint64.
        """
        motion, (n1, n2, words) = self.motion, self.shape
        # the agent's window is that of input 0: all move it alike
        eroded, scratch = following.copy(), np.empty((n1, n2 * words), np.uint64)
        erode_packed(eroded, *packed_window(motion.first[2:, 0], motion.number[2:, 0], motion.agent))
        tables = np.stack([motion.first[0, :, :n1], motion.number[0, :, :n1]], axis=1)
        for table in np.unique(tables, axis=0):  # inputs that move the first joint alike
            erode_rows(eroded.reshape(n1, n2 * words), *table, scratch)
            for j in np.flatnonzero((tables == table).all(axis=(1, 2))):
                second = motion.first[1, j, :n2], motion.number[1, j, :n2]
                allowed, out = motion.allowed[step, j], cells.reshape(self.shape)
                add_certified(scratch.reshape(self.shape), *second, allowed, clear[j], out)

    def goal(self, step: int) -> FloatArray:
        """S_k^0 for k = step, (n1 n2, W) uint64: cells inside the target and outside the unsafe sets at t_k.

        From every state whose prediction is in the cell: the tip is over the evader or the target's disk.
        """
        motion, t, stage = self.motion, self.problem.time(step), scene(self.problem)
        out, inside = np.empty(self.shape, np.uint64), np.empty((*self.shape[:2], 1), np.uint64)
        still = read_only([joint_moves(_may_be(self.problem, self.axes, axis), 0.0, 0.0, 0.0, 1) for axis in (0, 1)])
        if stage.target is None:
            tips_within(*still, stage.agent_radius, motion.arm, motion.agent, out)
        else:
            pursuer_clear(*still, motion.arm, motion.agent._replace(delta=0.0, speed=0.0), out)
            x, y = map(float, stage.target.centre(t))
            centre = Agent(0.0, 0.0, 0.0, x, y, 0.0, 0.0, 1, 1)  # a cell without width
            # `inside` has one word for each pair of joint cells, 1 or 0: a product with it keeps a row or empties it
            tips_within(*still, stage.target.radius, motion.arm, centre, inside)
            out *= inside
        clear = clear_of_obstacles(self.problem, self.axes, np.full((3, 1), t), np.zeros((2, 1, 2)), 0.0)
        out *= clear[0, 0, :, :, None].astype(np.uint64)
        return out.reshape(-1, self.shape[2])


def arm_numbers(stage: ArmScene) -> FloatArray:
    """(l1, l2, turn), (3,): the tip is at l1 e(q1) + l2 e(turn q1 + q2), m, where e(a) = (cos a, sin a).

    turn is 1 for relative joint angles, and 0 for Eq. (8) as printed, where l2 is the sum of both lengths
    (`Arm.joints`).
    """
    l1, l2 = stage.arm.lengths
    return np.array([l1, l2, 1.0]) if stage.arm.kinematics == "relative" else np.array([l1, l1 + l2, 0.0])


def _may_be(problem: ReachAvoidProblem, axes: Sequence[CellAxis], axis: int) -> FloatArray:
    """The least and the greatest coordinate of a state whose prediction is in each cell: (n, 2)."""
    edges, off = axes[axis].edges(), float(prediction_error_along(problem, axis))
    return np.stack([edges[:-1] - off, edges[1:] + off], axis=1)


def clear_of_obstacles(
    problem: ReachAvoidProblem, axes: Sequence[CellAxis], times: FloatArray, velocities: FloatArray, delta: float
) -> FloatArray:
    """Whether the arm is proved to stay clear of the obstacles from each cell of the joints: (steps, L, n1, n2).

    For every time of an interval of length `delta`, from every state whose prediction is in the cell. `times` (2^(h +
    1) + 1, steps) cut each step's interval evenly, to halve it h times. `velocities` (2, L, 2) are the least and the
    greatest of both joints.
    """
    stage, jitter = scene(problem), problem.sensing.jitter
    out = np.ones((times.shape[1], velocities.shape[1], axes[0].count, axes[1].count), np.bool_)
    if stage.obstacles:
        disks = Disks(
            delta=float(delta),
            # of 2^(h + 1) + 1 instants it is h
            depth=(len(times) - 1).bit_length() - 2,
            centres=np.ascontiguousarray(np.stack([disk.centre(times) for disk in stage.obstacles], axis=-2)),
            # When the clock is off, a disk may be farther on: its radius is larger by as much.
            radii=np.array([disk.radius + stage.arm.half_width + disk.speed * jitter for disk in stage.obstacles]),
            speeds=np.array([disk.speed for disk in stage.obstacles]),
        )
        cells_clear(*(_may_be(problem, axes, axis) for axis in (0, 1)), velocities, disks, arm_numbers(stage), out)
    return out


def packed_window(first: FloatArray, number: FloatArray, agent: Agent) -> tuple[FloatArray, FloatArray]:
    """The neighbours that a cell of the agent needs, as `erode_packed` takes them: (shifts, passes).

    shifts (2, offsets) int64 : how many bits away the neighbours at all offsets are, along x and along y. passes (2,
    offsets, W) uint64 : the cells that do not need the neighbour at an offset, as it is not in their image.
    """
    cells = np.stack(np.divmod(np.arange(agent.nx * agent.ny), agent.ny))
    low = np.take_along_axis(first, cells, axis=1) - cells
    high = low + np.take_along_axis(number, cells, axis=1) - 1
    if low.max() > 0 or high.min() < 0:
        # `erode_packed` asks for the cell itself in any case, and skips an offset of 0
        raise ValueError("the agent must be able to stay where it is: its drift is larger than its speed")
    offsets = np.arange(low.min(), high.max() + 1)
    passes = (offsets[:, None] < low[:, None]) | (offsets[:, None] > high[:, None])  # (2, offsets, cells)
    return offsets * np.array([[agent.ny], [1]]), to_words(passes)
