"""Torques, delay and noise in MuJoCo: bounds from records, a proof with these bounds, and the runs that keep it.

The paper's last wish is a real platform (Sec. 6.2.3). This one has masses, motors with a limit of torque, friction, an
encoder, an answer that comes 10 ms late and a pursuer that is measured to 4 mm. None of this is in the model dq = u, so
it has to become bounds.

*The state is the reference*, the integrated command, which the computer knows. A servo on each joint follows it: a
planner that is proved and a tracker whose error is measured, as in FaSTrack (Herbert et al. 2017). If the joints stay
within e of the reference, every point of the arm is within the *lever* of where the reference has it:

    (l1 + l2) e1 + l2 e2,

so links that are this much thicker and a target that is this much smaller make a proof of the reference one of the arm.
The pursuer's error and the delay are for `Sensing`. The error e is read from recorded runs, which is evidence about the
recorded inputs and no bound on the next ones; how often it was exceeded is counted.

Nothing of ours runs inside a rollout. The servo is part of MuJoCo's model, its set-point is known for 10 ms ahead, and
noise and counts of the encoder enter as a change of the set-point: a motor that believes to be n further on stops n
short. MuJoCo also measures: distances of the arm from what it must not touch, and where tip and target are.

Needs the extra `physics`: pip install 'sdhj[physics]'.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import click
import numpy as np
import physics
from physics import World, longest, mujoco, write_frames
from tqdm import tqdm

import sdhj
from sdhj.arm.case_studies import TARGET
from sdhj.arm.workspace import Disk
from sdhj.cli import RUNS, SEED, plainly
from sdhj.common.remembering import FloatArray
from sdhj.common.showing import hidden
from sdhj.plotting.looks import writable_folder
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.simulation.adversaries import first_moment, worst
from sdhj.simulation.records import chance
from sdhj.simulation.runs import admissible_states
from sdhj.table.batches import Table
from sdhj.table.controller import Action, Controller

if mujoco is not None:
    from mujoco import rollout

STEP = 0.001  # s, of MuJoCo
PIECE = 0.01  # s: how often the pursuer turns, and what a call of MuJoCo takes
LENGTHS = (0.15, 0.15)  # m
MASS = 0.3  # kg, of each link
FRICTION, VISCOUS, ROTOR = 0.02, 0.01, 5e-4  # of each joint: N m, N m s/rad, kg m^2
COUNTS = 4096  # of an encoder, in a turn
INERTIA = MASS * (LENGTHS[0] ** 2 / 3 + (LENGTHS[0] + LENGTHS[1] / 2) ** 2 + LENGTHS[1] ** 2 / 12)  # stretched, kg m^2
REST = 12  # the input 0, which is held before the first answer
SENSING = Sensing(error=[0.0, 0.0, 0.004, 0.004], delay=0.01, rest=REST, memory=False)  # rad and m, s
CELLS = (126, 126, 72, 72)  # asked for; aligned with the lengths of the problem they become 126, 126, 90, 90
FEWER = (84, 84, 36, 36)  # 63, 63, 45, 45: a fifth of the time
ROUNDED = 5e-4  # rad: errors are rounded up to a multiple of it, so that versions of MuJoCo agree on the problem
OUTCOMES = REACHED, COLLIDED, LEFT, LATE, MISSED, UNDECIDED = (
    "reached", "collided", "without an answer", "late", "missed the target", "undecided")  # fmt: skip


# ---- the plant


@dataclass(frozen=True)
class Motors:
    """A servo on each joint: torque = stiffness (set-point - angle) - damping velocity, cut off at the limit.

    Attributes
    ----------
    torque : float
        The most that each can do, N m.
    stiffness, damping : (float, float)
        N m/rad, N m s/rad.
    """

    torque: float
    stiffness: tuple[float, float]
    damping: tuple[float, float]

    @property
    def lead(self) -> FloatArray:
        """How far the set-point is ahead of the reference, s: then no damping slows a steady motion."""
        return np.array(self.damping) / np.array(self.stiffness)


def gains(torque: float) -> list[Motors]:
    """The 18 that are tried: frequency (rad/s) and damping of the stretched arm, and the share of the second joint."""
    found = []
    for frequency, ratio, share in product((20.0, 40.0, 80.0), (1.0, 1.75, 2.5), (0.125, 0.25)):
        stiffness, damping = INERTIA * frequency**2, 2 * ratio * INERTIA * frequency
        found.append(Motors(torque, (stiffness, share * stiffness), (damping, share * damping)))
    return found


def arm(u_max: float, **changes: Any) -> ReachAvoidProblem:
    """The paper's arm as the model has it: the reference, which nothing disturbs, and the pursuer."""
    return sdhj.arm_case_study(lengths=LENGTHS, u_max=u_max, v_d_max=0.0, **changes)


class Plant:
    """The arm with its motors and all that moves around it, for many runs at once.

    A MuJoCo state has the time, the joints' positions and their velocities; the first two joints are the arm's, the
    next two the pursuer's, the others belong to what moves as it is known to. Only the arm is pushed: all others go on
    as they do. Contacts push nothing, because a run ends where a distance is no longer positive.

    Parameters
    ----------
    problem : ReachAvoidProblem
        `arm`.
    motors : Motors
    """

    def __init__(self, problem: ReachAvoidProblem, motors: Motors) -> None:
        self.motors, limit = motors, f"{-motors.torque} {motors.torque}"
        servos = [
            f'<general joint="q{i + 1}" gainprm="{stiff}" biastype="affine" biasprm="0 {-stiff} {-damp}" '
            f'forcelimited="true" forcerange="{limit}"/>'
            for i, (stiff, damp) in enumerate(zip(motors.stiffness, motors.damping, strict=True))
        ]
        obstacles = ["pursuer", *(f"obstacle{i}" for i in range(len(problem.recipe["arguments"]["obstacles"])))]
        pairs = product(("link1", "link2"), obstacles)
        sensors = [f'<distance geom1="{link}" geom2="{other}" cutoff="{physics.FAR}"/>' for link, other in pairs]
        sensors += ['<framepos objtype="site" objname="tip"/>', '<framepos objtype="geom" objname="target"/>']
        self.world = World(
            problem,
            joint=f'frictionloss="{FRICTION}" damping="{VISCOUS}" armature="{ROTOR}"',
            link=f'mass="{MASS}"',
            more=f'<option timestep="{STEP}"><flag contact="disable"/></option>'
            f"<actuator>{''.join(servos)}</actuator><sensor>{''.join(sensors)}</sensor>",
        )
        # Not implicitfast: MuJoCo 3.2 counts the damping of a motor that is cut off, a third of its torque.
        self.model, self.data = self.world.model, self.world.data
        self.joints = self.model.nq
        self.arm, self.pursuer, self.push = slice(1, 3), slice(3, 5), slice(1 + self.joints + 2, 1 + self.joints + 4)

    def begin(self, states: FloatArray) -> FloatArray:
        """MuJoCo states at time 0 with the arm and the pursuer at rest in states (M, 4)."""
        full = np.zeros((len(states), 1 + self.joints + self.model.nv))
        full[:, 1:5] = states
        full[:, 5 : 1 + self.joints] = self.world.begin
        full[:, 1 + self.joints + 4 :] = self.world.rates
        return full

    def set_points(self, reference: FloatArray, speeds: FloatArray, rng: np.random.Generator) -> FloatArray:
        """For references (M, 2) now and speeds (M, T, 2) from now on: what the servos are told, (M, T, 2)."""
        ahead = reference[:, None] + STEP * (np.cumsum(speeds, axis=1) - speeds)
        noise = np.pi / COUNTS * rng.choice([-1.0, 1.0], speeds.shape)  # half a count
        return ahead + self.motors.lead * speeds + noise

    def play(self, full: FloatArray, set_points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The MuJoCo states after each of T steps, (M, T, ·), and what was measured before each, (M, T, ·)."""
        return rollout.rollout(self.model, self.data, full, set_points)  # type: ignore[no-any-return]


# ---- bounds from records


def recorded(plant: Plant, count: int, rng: np.random.Generator) -> FloatArray:
    """How far the joints were from the reference at most, (count, 2), rad: in records of 8 inputs drawn at random.

    Every other record has inputs that are extreme for both joints. Each begins at rest.
    """
    problem = plant.world.problem
    inputs = problem.inputs[rng.integers(len(problem.inputs), size=(count, problem.steps))]
    extreme = problem.inputs.max() * rng.choice([-1.0, 1.0], inputs.shape)
    inputs[::2] = extreme[::2]
    starts = np.zeros((count, 4))
    starts[:, :2] = rng.uniform(-np.pi, np.pi, (count, 2))
    speeds = np.repeat(inputs, round(problem.delta / STEP), axis=1)
    states, _ = plant.play(plant.begin(starts), plant.set_points(starts[:, :2], speeds, rng))
    reference = starts[:, None, :2] + STEP * np.cumsum(speeds, axis=1)
    return np.abs(states[:, :, plant.arm] - reference).max(axis=1)


def lever(error: Sequence[float] | FloatArray) -> float:
    """How far a point of the arm is from where the reference has it, at most, m: links turn by `error`, rad."""
    return float((LENGTHS[0] + LENGTHS[1]) * error[0] + LENGTHS[1] * error[1])


@dataclass(frozen=True)
class Evidence:
    """What the records say of motors: the gains of the least lever, and the errors of other records with them.

    Attributes
    ----------
    motors : Motors
    peaks : (n, 2) array
        The largest distance of each joint from the reference in each record, rad.
    """

    motors: Motors
    peaks: FloatArray

    @cached_property
    def error(self) -> FloatArray:
        """e, (2,): the largest of the records, rounded up."""
        return np.ceil(self.peaks.max(axis=0) / ROUNDED) * ROUNDED

    def __str__(self) -> str:
        (e1, e2), count, thicker = self.error, len(self.peaks), 1e3 * lever(self.error)
        return (
            f"motors of {self.motors.torque:g} N m: e = {e1:.4f}, {e2:.4f} rad, lever {thicker:.1f} mm\n"
            f"with 95% confidence at most {chance(count, 2):.2%} of records drawn like these {count} exceed it"
        )


def identify(torque: float, u_max: float, records: int = 1000, tried: int = 100, seed: int = 0) -> Evidence:
    """Choose gains by `tried` records each, and read e from `records` others."""
    rng, problem = np.random.default_rng(seed), arm(u_max)

    def peaks(motors: Motors, count: int) -> FloatArray:
        return recorded(Plant(problem, motors), count, rng)

    best = min(gains(torque), key=lambda motors: lever(peaks(motors, tried).max(axis=0)))
    return Evidence(best, peaks(best, records))


def grown(u_max: float, error: Sequence[float] | FloatArray, sensing: Sensing = SENSING) -> ReachAvoidProblem:
    """The reference's problem: links as much thicker, and a target as much smaller, as the lever is long."""
    more = lever(error)
    smaller = Disk(TARGET.path, TARGET.radius - more)
    return replace(arm(u_max, half_width=0.01 + more, target=smaller), sensing=sensing)


# ---- runs


@dataclass(frozen=True)
class Film:
    """One run: the states (T, 4) of arm and pursuer at T instants, s."""

    times: FloatArray
    states: FloatArray


@dataclass(frozen=True)
class Played:
    """What became of M runs; `str()` is a summary.

    Attributes
    ----------
    outcomes : (M,) array of str
        Each one of `OUTCOMES`.
    steps : (M,) int array
        Intervals that were begun.
    closest : (M,) array
        The least distance of the arm from what it must not touch, m, as MuJoCo measured it every millisecond.
    peaks : (M, 2) array
        The largest distance of each joint from the reference, rad.
    error : (2,) array
        The bounds on `peaks` with which the table was solved.
    films : list of Film
        Of all runs.
    """

    outcomes: FloatArray
    steps: FloatArray
    closest: FloatArray
    peaks: FloatArray
    error: FloatArray
    films: list[Film]

    def count(self, *outcomes: str) -> int:
        return int(np.isin(self.outcomes, outcomes).sum())

    @property
    def lost(self) -> int:
        return self.count(*OUTCOMES[1:])

    @property
    def exceeded(self) -> int:
        """Runs in which a joint was farther from the reference than e."""
        return int((self.peaks > self.error).any(axis=1).sum())

    def __str__(self) -> str:
        told = ", ".join(f"{self.count(one)} {one}" for one in OUTCOMES[1:5])
        apart = f"e exceeded in {self.exceeded} runs" if self.error.any() else "e ignored"
        return (
            f"{self.lost} of {len(self.outcomes)} runs lost ({told})\n"
            f"closest {1e3 * self.closest.min():.1f} mm; {apart}, "
            f"largest {', '.join(f'{peak:.4f}' for peak in self.peaks.max(axis=0))} rad"
        )


class Loop:
    """Runs of a table's controllers on a plant, all at the same time."""

    def __init__(self, table: Table, plant: Plant, error: FloatArray, sensing: Sensing, count: int, seed: int) -> None:
        self.table, self.plant, self.error, self.sensing = table, plant, error, sensing
        self.controllers = [Controller(table) for _ in range(count)]  # each remembers its last input
        self.rng = np.random.default_rng(seed)
        states = admissible_states(self.controllers[0], count, self.rng)
        self.reference = states[:, :2].copy()
        self.speed = float(table.problem.recipe["arguments"]["v_p_max"])  # of the pursuer, m/s
        self.drawn = self.rng.uniform(-self.speed, self.speed, (count, 2))  # its velocity before the first answer
        box = plant.world.box
        if sensing.delay:  # states are those in which the first input starts
            states[:, 2:] = np.clip(states[:, 2:] - sensing.delay * self.drawn, -box, box)
        self.full = plant.begin(states)
        self.inputs, self.to_go = np.full(count, REST), np.zeros(count, np.int64)
        self.outcomes = np.full(count, UNDECIDED, dtype=object)
        self.steps = np.zeros(count, np.int64)
        self.closest, self.peaks = np.full(count, np.inf), np.zeros((count, 2))
        self.seen: list[tuple[FloatArray, FloatArray]] = [(np.arange(count), self.full[:, :5].copy())]

    @property
    def alive(self) -> FloatArray:
        return np.flatnonzero(self.outcomes == UNDECIDED)

    def run(self, progress: bool | None = None) -> Played:
        steps, late = self.table.problem.steps, round(self.sensing.delay / PIECE)
        pieces = round(self.table.problem.delta / PIECE)
        for k in tqdm(range(steps + 1), desc="experiment", unit="step", disable=hidden(progress)):
            answers = self.measure(k)
            for piece in range(late):
                self.piece(k - 1, late - piece)
            self.take(answers)
            for piece in range(pieces - late if k < steps else 0):
                self.piece(k, pieces - piece)
        self.outcomes[self.alive] = LATE
        return Played(
            self.outcomes.astype(str), self.steps, self.closest, self.peaks, self.error, films(self.seen, self.steps)
        )

    def measure(self, k: int) -> dict[int, Action]:
        """What the controllers answer to the measurements of step k, by the number of the run."""
        rows = self.alive
        states = np.hstack([self.reference[rows], self.full[rows, self.plant.pursuer]])
        states += np.array(self.sensing.error) * self.misleading(rows)
        now = k * self.table.problem.delta
        return {row: self.controllers[row].step(state, now) for row, state in zip(rows, states, strict=True)}

    def misleading(self, rows: FloatArray) -> FloatArray:
        """Errors of a measurement, (M, 4), of size 1: a pursuer that chases seems farther off, others are anywhere."""
        signs = self.rng.choice([-1.0, 1.0], (len(rows), 4))
        chase = rows % 2 == 0
        signs[chase, 2:] = -np.sign(self.towards(rows[chase]))
        return signs

    def take(self, answers: dict[int, Action]) -> None:
        """One delay after the measurement: the runs that have arrived end, the others apply their new inputs."""
        rows = np.array([row for row in self.alive if answers[row].steps_to_go == 0], np.int64)
        if rows.size:
            still = self.plant.set_points(self.reference[rows], np.zeros((len(rows), 1, 2)), self.rng)
            _, sensors = self.plant.play(self.full[rows], still)
            self.closest[rows] = np.minimum(self.closest[rows], sensors[:, 0, :-6].min(axis=1))
            apart = np.linalg.norm(sensors[:, 0, -6:-4] - sensors[:, 0, -3:-1], axis=1)
            arrived = apart <= self.plant.world.given["target"]["radius"]
            self.outcomes[rows] = np.where(self.closest[rows] <= 0, COLLIDED, np.where(arrived, REACHED, MISSED))
        for row in self.alive:
            action = answers[row]
            self.inputs[row], self.to_go[row] = action.input, action.steps_to_go or 0
            if not action.promised:
                self.outcomes[row] = LEFT if action.step < self.table.problem.steps else LATE
        self.steps[self.alive] += 1

    def piece(self, k: int, left: int) -> None:
        """Let 10 ms pass in the interval of step k, of which `left` pieces are left."""
        rows, plant, box = self.alive, self.plant, self.plant.world.box
        if not rows.size:
            return
        at = self.full[rows, plant.pursuer]
        velocity = np.clip(self.steered(rows, k, left), (-box - at) / PIECE, (box - at) / PIECE)  # its walls
        self.full[rows, plant.push] = velocity
        speeds = np.repeat(self.table.problem.inputs[self.inputs[rows]][:, None], round(PIECE / STEP), axis=1)
        states, sensors = plant.play(self.full[rows], plant.set_points(self.reference[rows], speeds, self.rng))
        reference = self.reference[rows][:, None] + STEP * np.cumsum(speeds, axis=1)
        off = np.abs(states[:, :, plant.arm] - reference).max(axis=1)
        self.peaks[rows] = np.maximum(self.peaks[rows], off)
        self.closest[rows] = np.minimum(self.closest[rows], sensors[:, :, :-6].min(axis=(1, 2)))
        self.full[rows], self.reference[rows] = states[:, -1], reference[:, -1]
        self.outcomes[rows[self.closest[rows] <= 0]] = COLLIDED
        self.seen.append((rows, states[:, -1, :5].copy()))

    def steered(self, rows: FloatArray, k: int, left: int) -> FloatArray:
        """The pursuer's velocity (M, 2), m/s: every other one chases the arm, the others play the library's worst."""
        if k < 0:
            return self.drawn[rows]
        velocity, others = np.clip(self.towards(rows) / PIECE, -self.speed, self.speed), rows % 2 == 1
        if others.any():
            rows = rows[others]
            states = np.hstack([self.reference[rows], self.full[rows, self.plant.pursuer]])
            problem, now = self.table.problem, float(self.full[rows[0], 0])
            seen = first_moment(
                self.table, problem, states, self.inputs[rows], self.to_go[rows], k, now, rows, self.rng
            )
            velocity[others] = worst(replace(seen, remaining=left * PIECE, duration=PIECE))[:, 2:]
        return velocity

    def towards(self, rows: FloatArray) -> FloatArray:
        """From the pursuer to the nearest point of the arm, (M, 2), m."""
        (q1, q2), at = self.full[rows, self.plant.arm].T, self.full[rows, self.plant.pursuer]
        start, found = np.zeros_like(at), []
        for length, angle in zip(LENGTHS, (q1, q1 + q2), strict=True):
            along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            share = np.clip(((at - start) * along).sum(axis=1), 0.0, length)
            found.append(start + share[:, None] * along - at)
            start = start + length * along
        nearer = np.linalg.norm(found[0], axis=1) <= np.linalg.norm(found[1], axis=1)
        return np.where(nearer[:, None], *found)


def films(seen: list[tuple[FloatArray, FloatArray]], steps: FloatArray) -> list[Film]:
    """The runs one by one, of pieces in which each has a row while it goes on: row numbers and (time, state)."""
    numbers, rows = np.concatenate([one for one, _ in seen]), np.concatenate([one for _, one in seen])
    order = np.argsort(numbers, kind="stable")
    return [Film(one[:, 0], one[:, 1:]) for one in np.split(rows[order], np.cumsum(np.bincount(numbers))[:-1])]


def play(
    table: Table,
    motors: Motors,
    runs: int = 1000,
    seed: int = 0,
    *,
    error: Sequence[float] | FloatArray = (0.0, 0.0),
    sensing: Sensing = SENSING,
    progress: bool | None = None,
) -> Played:
    """Play runs from states drawn uniformly from the tube of step 0, each with a controller of its own.

    Parameters
    ----------
    table : Table
        Of `grown`.
    motors : Motors
    runs, seed : int
    error : (float, float)
        What `Played.exceeded` compares with.
    sensing : Sensing
        How the robot measures and how late it acts, whatever the table was solved for; a delay in whole pieces.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.
    """
    u_max = float(table.problem.inputs.max())
    return Loop(table, Plant(arm(u_max), motors), np.asarray(error), sensing, runs, seed).run(progress)


# ---- the experiment


@dataclass(frozen=True)
class Case:
    """A table, and runs of it.

    Attributes
    ----------
    name : str
    share : float
        Of C in the tube of all steps.
    played : Played
    """

    name: str
    share: float
    played: Played

    @property
    def row(self) -> tuple[str, ...]:
        """Of the table of results."""
        played = self.played
        counts = [len(played.outcomes), played.lost, *(played.count(one) for one in (COLLIDED, LEFT, LATE, MISSED))]
        exceeded = str(played.exceeded) if played.error.any() else "ignored"
        return self.name, f"{self.share:.3f}", *map(str, counts), exceeded, f"{1e3 * played.closest.min():.1f}"


HEADINGS = (
    "case", "share of C", "runs", "lost", "collided", "without an answer", "late", "missed", "e exceeded", "closest, mm"
)  # fmt: skip


def certified(problem: ReachAvoidProblem, cells: Sequence[int] = CELLS) -> Table:
    return sdhj.solve(problem, sdhj.Certified(cells=tuple(cells)), progress=False)


def case(name: str, table: Table, motors: Motors, runs: int, seed: int, **options: Any) -> Case:
    """Play a table."""
    played = play(table, motors, runs, seed, **options)
    return Case(name, table.fraction(start=0, within=table.steps), played)


def controls(evidence: Evidence, u_max: float, runs: int, seed: int = 0) -> list[Case]:
    """What must lose, each with the reason taken away beside it, and what is only told: half of e.

    (a) A table that was solved without `Sensing`, played with delay and error, and without. (b) A table for 3 rad/s
    that ignores e, played with motors that cannot follow, and with motors that can.
    """
    exact = Sensing(rest=REST)
    blind = certified(grown(u_max, evidence.error, sensing=exact), FEWER)
    rigid = certified(grown(3.0, (0.0, 0.0)), FEWER)
    half = certified(grown(u_max, evidence.error / 2), FEWER)
    motors, told = evidence.motors, {"error": evidence.error}
    return [
        case("(a) solved without Sensing", blind, motors, runs, seed, **told),
        case("(a) the same, played without delay and error", blind, motors, runs, seed, **told, sensing=exact),
        case("(b) 3 rad/s, e ignored, 0.5 N m", rigid, identify(0.5, 3.0, 100).motors, runs, seed),
        case("(b) the same table, 40 N m", rigid, identify(40.0, 3.0, 100).motors, runs, seed),
        case("half of e", half, motors, runs, seed, error=evidence.error / 2),
    ]


def table_of(cases: Sequence[Case]) -> str:
    """Markdown."""
    rows = [HEADINGS, ("---",) * len(HEADINGS), *(one.row for one in cases)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


@click.command(context_settings={"show_default": True})
@click.argument("folder", type=click.Path(path_type=Path), default=Path("results"))
@click.option("--torque", default=4.0, type=click.FloatRange(0, min_open=True), help="Limit of each motor, N m.")
@click.option("--u-max", default=2.0, type=click.FloatRange(0, min_open=True), help="Bound of the inputs, rad/s.")
@click.option("--runs", default=10_000, type=RUNS, help="Of the certified case; a fifth of it for each control.")
@click.option("--seed", default=0, type=SEED, help="Of the runs.")
@click.option("--coarse", is_flag=True, help="Fewer cells, and no controls.")
@click.pass_context
@plainly
def main(context: click.Context, folder: Path, torque: float, u_max: float, runs: int, seed: int, coarse: bool) -> None:
    """Identify the motors, certify with their bounds, play; write experiment.md and experiment_strip.png into FOLDER.

    Status 1 where a run of the certified case is lost.
    """
    if mujoco is None:
        raise ImportError("runs in MuJoCo need the extra that brings it: pip install 'sdhj[physics]'")
    writable_folder(folder)
    evidence = identify(torque, u_max)
    click.echo(str(evidence))
    table = certified(grown(u_max, evidence.error), FEWER if coarse else CELLS)
    name = f"certified, {u_max:g} rad/s, {torque:g} N m"
    cases = [case(name, table, evidence.motors, runs, seed, error=evidence.error)]
    click.echo(f"{cases[0].share:.3f} of C; {cases[0].played}")
    if not coarse:
        cases += controls(evidence, u_max, max(runs // 5, 1), seed)
    told = f"{table_of(cases)}\n\n{evidence}. MuJoCo {mujoco.__version__}, sdhj {sdhj.__version__}, seed {seed}."
    (folder / "experiment.md").write_text(told + "\n", encoding="utf-8")
    write_frames(World(arm(u_max)), longest(cases[0].played.films), folder / "experiment_strip.png")
    click.echo(told)
    context.exit(1 if cases[0].played.lost else 0)


if __name__ == "__main__":
    main()
