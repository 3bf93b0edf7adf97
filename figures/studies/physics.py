"""The arm's runs judged by MuJoCo: another program's kinematics and collision detection, no grid and none of ours.

The model is written from the case study's plain numbers. Everything that moves has joints and their velocities are
imposed: the arm's hinges turn at u + v_d, the pursuer's slides at v_p up to the walls of its box, obstacles slide or
circle as they are known to. MuJoCo places the bodies and finds contacts. The links are capsules in the plane z = 0 and
disks are upright capsules through it: between those, the distance in space is that of the disks in the plane.

Needs the extra `physics`: pip install 'sdhj[physics]'.
"""

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol
from xml.sax.saxutils import quoteattr

import click
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from tqdm import tqdm

import sdhj
from sdhj import plotting
from sdhj.cli import RUNS, SEED, plainly
from sdhj.common.checks import whole
from sdhj.common.remembering import FloatArray
from sdhj.common.showing import hidden
from sdhj.plotting.looks import writable_picture
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.runs import SUBSTEPS, Trajectory, admissible_states, name_of, simulate
from sdhj.table.controller import Controller
from sdhj.table.files import replaced_whole

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")  # draws without a screen; read when mujoco is imported

try:
    import mujoco
except ModuleNotFoundError:  # `main` says what to do about it
    mujoco = None

UPRIGHT = 0.015  # half-length of the segment of an upright capsule, m
FAR = 10.0  # distances beyond it, m, are not told apart
COLOURS = {
    "arm": "0.20 0.35 0.65 1",
    "obstacle": "0.75 0.25 0.22 1",
    "pursuer": "0.93 0.60 0.15 1",
    "evader": "0.30 0.65 0.35 1",
    "target": "0.30 0.65 0.35 1",
}
COLLIDES = {"arm": 'contype="1" conaffinity="2"', "obstacle": 'contype="2" conaffinity="1"'}
COLLIDES |= {"pursuer": COLLIDES["obstacle"]}
PASSES = 'contype="0" conaffinity="0"'


# ---- the model


def mjcf(problem: ReachAvoidProblem, *, joint: str = "", link: str = "", more: str = "") -> str:
    """The case study as a MuJoCo model, MJCF text; by default of bodies that are placed, not pushed.

    Parameters
    ----------
    problem : ReachAvoidProblem
    joint, link : str
        Further attributes of the arm's two hinges and of its two links.
    more : str
        Further elements of the model.

    Raises
    ------
    ValueError
        Where no case study built the problem, or a capsule would have no thickness.
    """
    given = _arguments(problem)
    l1, l2 = given["lengths"]
    reach = l2 if given["kinematics"] == "relative" else l1 + l2
    agent = _agent(given)
    disks = [_disk(f"obstacle{i}", "obstacle", disk) for i, disk in enumerate(given["obstacles"])]
    if "target" in given:
        disks.append(_disk("target", "target", given["target"]))
    return f"""<mujoco model={quoteattr(problem.name)}>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <visual>
    <global offwidth="960" offheight="960"/>
    <headlight ambient="0.4 0.4 0.4" diffuse="0.35 0.35 0.35" specular="0 0 0"/>
  </visual>
  <worldbody>
    <light pos="0.4 -0.6 2" dir="-0.2 0.3 -1" diffuse="0.45 0.45 0.45" specular="0.1 0.1 0.1"/>
    <camera name="above" pos="0 -0.5 3" xyaxes="1 0 0 0 0.986 0.164" fovy="15"/>
    <geom name="floor" type="plane" pos="0 0 -0.06" size="1 1 0.1" rgba="0.70 0.72 0.75 1" {PASSES}/>
    <geom name="base" type="cylinder" size="0.018 0.03" pos="0 0 -0.03" rgba="0.2 0.2 0.22 1" {PASSES}/>
    <body>
      <joint name="q1" type="hinge" axis="0 0 1" {joint}/>
      {_capsule("link1", "arm", given["half_width"], (0, 0, 0), (l1, 0, 0), link)}
      <body pos="{_numbers((l1, 0, 0))}">
        <joint name="q2" type="hinge" axis="0 0 1" {joint}/>
        {_capsule("link2", "arm", given["half_width"], (0, 0, 0), (reach, 0, 0), link)}
        <site name="tip" pos="{_numbers((reach, 0, 0))}" size="0.001" rgba="0 0 0 0"/>
      </body>
    </body>
    <body>
      <joint name="px" type="slide" axis="1 0 0"/>
      <joint name="py" type="slide" axis="0 1 0"/>
      {_upright(agent, agent, given[f"{agent}_radius"], (0, 0))}
    </body>
    {" ".join(disks)}
  </worldbody>
  {more}
</mujoco>"""


def _arguments(problem: ReachAvoidProblem) -> Mapping[str, Any]:
    if not problem.recipe:
        raise ValueError(f"the problem {problem.name!r} has no arm to model: no case study built it")
    arguments: Mapping[str, Any] = problem.recipe["arguments"]
    return arguments


def _agent(given: Mapping[str, Any]) -> str:
    return "pursuer" if "pursuer_radius" in given else "evader"


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _capsule(name: str, kind: str, radius: float, start: Sequence[float], end: Sequence[float], more: str = "") -> str:
    if radius <= 0.0:
        raise ValueError(f"MuJoCo needs a positive radius or half-width, {name} has {radius}")
    return (
        f'<geom name="{name}" type="capsule" size="{radius!r}" fromto="{_numbers([*start, *end])}" '
        f'rgba="{COLOURS[kind]}" {COLLIDES.get(kind, PASSES)} {more}/>'
    )


def _upright(name: str, kind: str, radius: float, at: Sequence[float]) -> str:
    """A disk of the plane. What the arm may touch lies flat below it instead, for the eye only."""
    if kind in COLLIDES:
        return _capsule(name, kind, radius, (*at, -UPRIGHT), (*at, UPRIGHT))
    place = _numbers((*at, -0.02))
    return (
        f'<geom name="{name}" type="cylinder" size="{radius!r} 0.002" pos="{place}" rgba="{COLOURS[kind]}" {PASSES}/>'
    )


def _disk(name: str, kind: str, disk: Mapping[str, Any]) -> str:
    """A disk on its path: still, or with a joint whose position is that of `_known`."""
    path, radius = disk["path"], disk["radius"]
    if path["kind"] == "circle":
        joint, origin, at = '<joint name="{}" type="hinge" axis="0 0 1"/>', path["centre"], (path["radius"], 0)
    elif path["kind"] == "line" and any(path["velocity"]):
        axis = _numbers((*path["velocity"], 0))
        joint, origin, at = f'<joint name="{{}}" type="slide" axis="{axis}"/>', path["start"], (0, 0)
    else:
        joint, origin, at = "", path.get("centre", path.get("start")), (0, 0)
    return f'<body pos="{_numbers((*origin, 0))}">{joint.format(name)}{_upright(name, kind, radius, at)}</body>'


class World:
    """A MuJoCo model of a case study, its bodies where they were placed last.

    Parameters
    ----------
    problem : ReachAvoidProblem
        Built by a case study.
    **more : str
        What `mjcf` takes besides.
    """

    def __init__(self, problem: ReachAvoidProblem, **more: str) -> None:
        self.problem, self.given = problem, _arguments(problem)
        self.model = mujoco.MjModel.from_xml_string(mjcf(problem, **more))
        self.data = mujoco.MjData(self.model)
        self._relative = self.given["kinematics"] == "relative"
        self.box = self.given[f"{_agent(self.given)}_box"]
        joints = range(4, self.model.njnt)  # after the arm's two and the agent's two
        names = [mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in joints]
        disks = {f"obstacle{i}": disk for i, disk in enumerate(self.given["obstacles"])}
        known = [_known((disks | {"target": self.given.get("target")})[name]) for name in names]
        self.begin, self.rates = np.array(known).reshape(-1, 2).T
        kinds = [geom for geom in range(self.model.ngeom) if self.model.geom_contype[geom] == 2]
        links = [self.model.geom("link1").id, self.model.geom("link2").id]
        self._pairs = [(link, geom) for link in links for geom in kinds]

    def place(self, state: FloatArray, t: float) -> None:
        """Put the arm and the agent as in a state (4,), and everything known where it is at time t."""
        self.data.qpos[:] = [*self._joints(state), *(self.begin + t * self.rates)]
        mujoco.mj_fwdPosition(self.model, self.data)

    def move(self, velocity: FloatArray, duration: float) -> None:
        """Let time pass while the arm's angles and the agent change with a velocity (4,)."""
        self.data.qvel[:] = [*self._joints(velocity), *self.rates]
        mujoco.mj_integratePos(self.model, self.data.qpos, self.data.qvel, duration)
        self.data.qpos[2:4] = np.clip(self.data.qpos[2:4], -self.box, self.box)
        mujoco.mj_fwdPosition(self.model, self.data)

    def _joints(self, values: FloatArray) -> FloatArray:
        """Angles of the case study to those of the hinges, of which the second is relative to the first link."""
        q1, q2, px, py = values
        return np.array([q1, q2 if self._relative else q2 - q1, px, py])

    @property
    def state(self) -> FloatArray:
        """(q1, q2, px, py) as MuJoCo has it, (4,)."""
        q1, q2, px, py = self.data.qpos[:4]
        return np.array([q1, q2 if self._relative else q1 + q2, px, py])

    def distance(self) -> float:
        """Signed distance of the arm from the nearest thing it must not touch, m; negative where they overlap."""
        pairs = (mujoco.mj_geomDistance(self.model, self.data, *pair, FAR, None) for pair in self._pairs)
        return min(pairs, default=FAR)

    def touched(self) -> bool:
        """Whether MuJoCo's collision detection reports a contact."""
        return any(self.data.contact.dist[: self.data.ncon] <= 0.0)


def _known(disk: Mapping[str, Any]) -> tuple[float, float]:
    """Position at time 0 and velocity of the joint of a disk that moves as it is known to."""
    path = disk["path"]
    if path["kind"] == "circle":
        return path["phase"], path["rate"]
    return 0.0, float(np.hypot(*path["velocity"]))


# ---- runs


@dataclass(frozen=True)
class Replay:
    """A run of `simulate` as MuJoCo sees it, at T instants.

    Attributes
    ----------
    times, distances : (T,) array
        s, m; `World.distance`.
    touched : (T,) bool array
        Where collision detection reported a contact.
    difference : float
        Largest difference of MuJoCo's distance from our level-set function at the instants that both looked at, m.
    drift : float
        Distance of MuJoCo's last state from ours, in the largest component.
    """

    times: FloatArray
    distances: FloatArray
    touched: FloatArray
    difference: float
    drift: float


def replay(world: World, run: Trajectory, finer: int = 5) -> Replay:
    """Play a run's inputs and disturbances in MuJoCo; look `finer` times as often as the simulation did."""
    problem, (velocities, gain, _) = world.problem, world.problem.dynamics.arrays
    world.place(run.states[0], 0.0)
    times, distances, touched = [0.0], [world.distance()], [world.touched()]
    for i, v in enumerate(run.disturbances):
        velocity = velocities[run.inputs[i // SUBSTEPS]] + gain @ v
        duration = (run.times[i + 1] - run.times[i]) / finer
        for part in range(finer):
            world.move(velocity, duration)
            times.append(run.times[i] + (part + 1) * duration)
            distances.append(world.distance())
            touched.append(world.touched())
    ours = [problem.unsafe_value(q[None], t)[0] for q, t in zip(run.states, run.times, strict=True)]
    differences = np.abs(np.array(distances[::finer]) - ours)
    drift = np.abs(world.state - run.states[-1]).max()
    return Replay(np.array(times), np.array(distances), np.array(touched), float(differences.max()), float(drift))


@dataclass(frozen=True)
class PhysicsReport:
    """Runs of the controller judged by MuJoCo; `str()` is a summary.

    Attributes
    ----------
    runs, adversary, rule, method, seed
        What was played.
    collided : int
        Runs that our geometry, at 20 instants of each interval, calls collided.
    touched : int
        Runs with a contact in MuJoCo at any of the instants it looked at.
    disagree : int
        Runs that only one of the two calls so.
    instants : int
        At which MuJoCo looked, in all runs.
    closest : float
        Least distance in MuJoCo, m.
    difference, drift : float
        The largest of all runs; see `Replay`.
    problem : ReachAvoidProblem
    trajectories : tuple of Trajectory
    """

    runs: int
    adversary: str
    rule: str
    method: str
    seed: int
    collided: int
    touched: int
    disagree: int
    instants: int
    closest: float
    difference: float
    drift: float
    problem: ReachAvoidProblem = field(repr=False)
    trajectories: tuple[Trajectory, ...] = field(repr=False)

    def __str__(self) -> str:
        return "\n".join(
            [
                f"{self.runs} runs in MuJoCo {mujoco.__version__}, {self.method} table, adversary {self.adversary}, "
                f"rule {self.rule}, seed {self.seed}",
                f"contacts in MuJoCo: {self.touched} runs, looked at {self.instants} instants",
                f"collisions in our geometry: {self.collided} runs; the two disagree on {self.disagree}",
                f"closest in MuJoCo {self.closest * 1e3:.3f} mm; distances differ by at most {self.difference:.1e} m, "
                f"states by {self.drift:.1e}",
            ]
        )


def check_runs(
    controller: Controller,
    runs: int = 1000,
    adversary: str = "aggressive",
    seed: int = 0,
    *,
    finer: int = 5,
    progress: bool | None = None,
) -> PhysicsReport:
    """Simulate runs from states drawn uniformly from the tube of step 0, and replay each in MuJoCo.

    Parameters
    ----------
    controller : Controller
    runs, adversary, seed
        As for `monte_carlo`.
    finer : int
        How many times as often MuJoCo looks for contacts, against 20 instants of an interval.
    progress : bool, optional
        Show a progress bar; by default where standard error is a terminal.

    Raises
    ------
    ValueError
        Where no case study built the problem, an option does not fit, or the tube of step 0 is empty.
    """
    runs, finer = whole("runs", runs, least=1), whole("finer", finer, least=1)
    world, rng = World(controller.problem), np.random.default_rng(whole("seed", seed, least=0))
    starts = admissible_states(controller, runs, rng)
    trajectories, replays = [], []
    for i in tqdm(range(runs), desc="MuJoCo", unit="run", disable=hidden(progress)):
        trajectories.append(simulate(controller, starts[i], adversary, seed=seed + i))
        replays.append(replay(world, trajectories[-1], finer))
    collided = np.array([run.outcome == "collided" for run in trajectories])
    touched = np.array([bool(one.touched.any()) for one in replays])
    return PhysicsReport(
        runs=runs,
        adversary=name_of(adversary),
        rule=name_of(controller.rule),
        method=controller.table.method,
        seed=seed,
        collided=int(collided.sum()),
        touched=int(touched.sum()),
        disagree=int((collided != touched).sum()),
        instants=sum(len(one.times) for one in replays),
        closest=min(float(one.distances.min()) for one in replays),
        difference=max(one.difference for one in replays),
        drift=max(one.drift for one in replays),
        problem=controller.problem,
        trajectories=tuple(trajectories),
    )


# ---- pictures


class Run(Protocol):
    """What a picture is drawn from: the states (T, 4) at T instants (s)."""

    @property
    def times(self) -> FloatArray: ...

    @property
    def states(self) -> FloatArray: ...


def frames(world: World, run: Run, count: int = 6, size: int = 480) -> list[tuple[float, FloatArray]]:
    """Pictures of a run, evenly spaced in time: times (s) and images (size, size, 3) uint8, drawn by MuJoCo.

    Raises
    ------
    ValueError
        Where MuJoCo finds nothing to draw with.
    """
    try:
        renderer = mujoco.Renderer(world.model, size, size)
    except Exception as error:  # whatever the OpenGL binding raises
        raise ValueError(
            f"MuJoCo cannot draw here ({error}); install EGL or OSMesa and set MUJOCO_GL to egl or osmesa"
        ) from error
    pictures = []
    with renderer:
        for i in np.linspace(0, len(run.times) - 1, count).round().astype(int):
            world.place(run.states[i], run.times[i])
            renderer.update_scene(world.data, camera="above")
            pictures.append((float(run.times[i]), renderer.render()))
    return pictures


def write_strip(report: PhysicsReport, path: str | os.PathLike[str], count: int = 6) -> None:
    """Draw the longest run of a report, of several the one whose joints turn most, into a png file."""

    write_frames(World(report.problem), longest(report.trajectories), path, count)


def longest(runs: Iterable[Run]) -> Run:
    """Of several that take as long, the one whose joints turn most."""
    return max(runs, key=lambda run: (len(run.times), float(np.abs(np.diff(run.states[:, :2], axis=0)).sum())))


def write_frames(world: World, run: Run, path: str | os.PathLike[str], count: int = 6) -> None:
    """Draw a run as a film strip of rows of three, a png file."""
    pictures, columns = frames(world, run, count), min(count, 3)
    rows = -(-count // columns)
    with plotting.style(), replaced_whole(path) as temporary:
        figure = plotting.new_figure(2.4 * columns, 2.65 * rows + 0.3)
        for i, (t, image) in enumerate(pictures):
            panel = figure.add_subplot(rows, columns, i + 1)
            panel.imshow(image, interpolation="lanczos")
            panel.set_title(f"$t = {t:.2f}$ s", fontsize=8)
            panel.set_axis_off()
        put_legend(figure)
        figure.savefig(temporary, dpi=150, format="png", metadata={"Software": "sdhj"})


def put_legend(figure: Figure) -> None:
    """What the colours of a strip's bodies mean, below it."""
    colours = {
        kind: [float(part) for part in COLOURS[kind].split()] for kind in ("arm", "pursuer", "obstacle", "target")
    }
    entries = [Patch(facecolor=colour, label=kind) for kind, colour in colours.items()]
    figure.legend(handles=entries, loc="outside lower center", ncols=len(entries))


@click.command(context_settings={"show_default": True})
@click.argument("table", type=click.Path(path_type=Path))
@click.option("--runs", default=1000, type=RUNS, help="Runs from uniformly drawn admissible states.")
@click.option("--adversary", default="aggressive", type=click.Choice(list(ADVERSARIES)), help="Who plays.")
@click.option("--rule", default="deepest", help="How one of the safe inputs is chosen.")
@click.option("--seed", default=0, type=SEED, help="Seed of the adversary and the starts.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Pictures of the longest run: a png file.")
@click.pass_context
@plainly
def main(
    context: click.Context, table: Path, runs: int, adversary: str, rule: str, seed: int, output: Path | None
) -> None:
    """Play a table's runs in MuJoCo and let its collision detection judge; status 1 where it finds a contact."""
    if mujoco is None:
        raise ImportError("runs in MuJoCo need the extra that brings it: pip install 'sdhj[physics]'")
    writable_picture(output, [".png"])
    report = check_runs(sdhj.Controller(sdhj.load(table), rule=rule), runs, adversary, seed)
    click.echo(str(report))
    if output is not None:
        write_strip(report, output)
        click.echo(output)
    context.exit(1 if report.touched else 0)


if __name__ == "__main__":
    main()
