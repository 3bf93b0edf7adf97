"""The paper's case studies as instances of `ReachAvoidProblem` (Sec. 5 and 6.1).

The state is q = (q1, q2, px, py): the arm's joint angles and the centre of an agent, which pursues the arm in
`arm_case_study` and flees from its end-effector in `evader_case_study`. Level-set functions are in metres.
"""

import inspect
import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np

from sdhj.arm.workspace import Arm, Circle, Disk, Line, Still
from sdhj.common.checks import number, whole
from sdhj.common.remembering import FloatArray
from sdhj.formulas.formula import Formula
from sdhj.formulas.text import alike
from sdhj.problem.dynamics import MOST_INPUTS, Dynamics
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.restoring import near
from sdhj.problem.sets import TargetSet, UnsafeSet

AXES = ("q1", "q2", "px", "py")
JOINTS = (0, 1)  # the axes that the obstacles OBS(t) and the target TAR(t) depend on
ALL_AXES = (0, 1, 2, 3)
MOST = 1_000_000  # the largest value of `nodes` and `steps`

TARGET = Disk(Line((0.05, 0.20), (0.10, -0.05)), 0.06)
OBSTACLES = (
    Disk(Still((-0.22, 0.10)), 0.06),
    Disk(Line((0.24, -0.02), (-0.10, 0.12)), 0.04),
    Disk(Circle((0.0, -0.22), 0.07, 2.0, -1.0), 0.04),
)


@dataclass(frozen=True)
class ArmScene:
    """The workspace of a case study, with its level-set functions of angles q (M, 2) or states (M, 4): (M,), m."""

    arm: Arm
    obstacles: tuple[Disk, ...]  # OBS(t), which move on given paths
    agent: str  # which of the two the adversary moves, "pursuer" or "evader": a disk about (px, py) of the state
    agent_radius: float
    agent_box: float  # the centre of that disk stays in [-agent_box, agent_box]^2
    target: Disk | None  # TAR(t); None where the evader is the target

    # The checker has these distances once more (`sdhj.certified.check.arm.recipe`): it compares a file's formulas with
    # them, and where they differ it refuses the file.
    def obstacles_value(self, q: FloatArray, t: float) -> FloatArray:
        """Signed distance of the thick arm to the nearest obstacle's disk at time t."""
        return np.min([self.arm.distance(q, disk.centre(t)) - self._contact(disk) for disk in self.obstacles], axis=0)

    def obstacles_swept_value(self, q: FloatArray, t0: float, t1: float) -> FloatArray:
        """The least of `obstacles_value` over [t0, t1], by the obstacles' ways, not by samples (Sec. 5.4)."""
        distances = [self.arm.swept_distance(q, disk.path, t0, t1) for disk in self.obstacles]
        return np.min([d - self._contact(disk) for d, disk in zip(distances, self.obstacles, strict=True)], axis=0)

    def pursuer_value(self, states: FloatArray, t: float) -> FloatArray:
        """Signed distance of the thick arm to the pursuer's disk, which is in the state."""
        return self.arm.distance(states[:, :2], states[:, 2:]) - (self.agent_radius + self.arm.half_width)

    def target_value(self, q: FloatArray, t: float) -> FloatArray:
        """Distance of the end-effector to the target's centre at time t, less its radius."""
        assert self.target is not None
        return np.hypot(*(self.arm.tip(q) - self.target.centre(t)).T) - self.target.radius

    def evader_value(self, states: FloatArray, t: float) -> FloatArray:
        """Distance of the end-effector to the evader's centre, which is in the state, less its radius."""
        return np.hypot(*(self.arm.tip(states[:, :2]) - states[:, 2:]).T) - self.agent_radius

    def _contact(self, disk: Disk) -> float:
        """The distance of a disk's centre from the arm's skeleton at which the thick arm touches the disk."""
        return disk.radius + self.arm.half_width


def arm_case_study(
    nodes: int | Sequence[int] = 25,
    steps: int = 8,
    view_time: str = "swept",
    kinematics: str = "relative",
    *,
    delta: float = 0.1,
    lengths: Sequence[float] = (0.15, 0.15),
    half_width: float = 0.01,
    u_max: float = 3.0,
    v_d_max: float = 0.3,
    v_p_max: float = 0.2,
    input_levels: int = 5,
    pursuer_radius: float = 0.04,
    pursuer_box: float = 0.36,
    target: Disk | Mapping[str, Any] = TARGET,
    obstacles: Sequence[Disk | Mapping[str, Any]] = OBSTACLES,
) -> ReachAvoidProblem:
    """The robot arm of the paper (Kleff & Li 2020, Sec. 5), as a `ReachAvoidProblem` to be given to `sdhj.solve`.

    Its base is at the origin. It has to reach a moving target, clear of moving obstacles and a pursuer.

    Most defaults are this library's choice, as the paper does not state them.

    Parameters
    ----------
    nodes : int or sequence of 4 int
        On each of the axes q1, q2 (periodic, [-pi, pi)) and px, py.
    steps : int
        N.
    view_time : {"swept", "sampled", "instantaneous"}
        See `ReachAvoidProblem`.
    kinematics : {"relative", "printed"}
        The textbook arm, with q2 measured from the first link, or Eq. (8) exactly as printed.
    delta : float
        Sampling interval, s.
    lengths, half_width : (float, float), float
        Of the two links, m.
    u_max, v_d_max, v_p_max : float
        Bounds of each component of u and v_d (rad/s, Eq. 9) and of the pursuer's velocity v_p (m/s, Eq. 10).
    input_levels : int
        Samples of each input component from -u_max to u_max; the first varies slowest.
    pursuer_radius, pursuer_box : float
        And half the side of the square that its centre stays in, m.
    target : Disk
        Of the end-effector, with `Disk`, `Still`, `Line` and `Circle` from `sdhj.arm.workspace`: `Disk(Line((0.05,
        0.2), (0.1, -0.05)), 0.06)`, from where, how fast, radius; m, s, rad.
    obstacles : sequence of Disk
        For both links.

    Examples
    --------
    >>> import sdhj
    >>> problem = sdhj.arm_case_study(nodes=9, v_p_max=0.1)
    >>> problem.grid.shape, problem.inputs.shape
    ((9, 9, 9, 9), (25, 2))
    """
    # Only the arguments here. Files keep them by name: with one added, removed or renamed `_checked_recipe` refuses the
    # recipes of earlier files, whose certified tables then do not load; the arm's checker reads them by name, too.
    recipe = _recipe("arm_case_study", locals())
    return _problem(recipe, *_sets(_scene(recipe)))


def evader_case_study(
    nodes: int | Sequence[int] = 25,
    steps: int = 8,
    view_time: str = "swept",
    kinematics: str = "relative",
    *,
    delta: float = 0.1,
    lengths: Sequence[float] = (0.15, 0.15),
    half_width: float = 0.01,
    u_max: float = 3.0,
    v_d_max: float = 0.3,
    v_e_max: float = 0.1,
    input_levels: int = 5,
    evader_radius: float = 0.06,
    evader_box: float = 0.36,
    obstacles: Sequence[Disk | Mapping[str, Any]] = OBSTACLES,
) -> ReachAvoidProblem:
    """The evading target of Sec. 6.1: bring the end-effector into a disk that flees, clear of the obstacles.

    The target set is the evader, so it depends on all four axes, and "projected" finds nothing: use "hji". Only the
    obstacles are unsafe. The paper gives no numbers. The evader's square is larger than the arm's reach, so it can
    escape.

    Parameters
    ----------
    nodes, steps, view_time, kinematics, delta, lengths, half_width, u_max, v_d_max, input_levels, obstacles
        As for `arm_case_study`.
    v_e_max : float
        Of each component of the evader's velocity, m/s.
    evader_radius, evader_box : float
        And half the side of the square that its centre stays in, m.

    Examples
    --------
    >>> import sdhj
    >>> sdhj.evader_case_study(nodes=9, steps=3).target.axes
    (0, 1, 2, 3)
    """
    # only the arguments here, whose names files keep: see `arm_case_study`
    recipe = _recipe("evader_case_study", locals())
    return _problem(recipe, *_sets(_scene(recipe)))


BUILDERS: dict[str, Callable[..., Any]] = {"arm_case_study": arm_case_study, "evader_case_study": evader_case_study}


def rebuild(recipe: Mapping[str, Any]) -> ReachAvoidProblem:
    """The problem of a recipe: {"builder": a case study, "arguments": all, by name}."""
    given = _checked_recipe(recipe)
    return BUILDERS[given["builder"]](**given["arguments"])


def as_built(problem: ReachAvoidProblem) -> bool:
    """Whether a problem is what its recipe builds, up to rounding and whatever its sensing."""
    if not problem.recipe:
        return False
    # A problem to which a set was added may still have the recipe. What is accepted here `ArmProof` proves by recipe
    # and sensing alone, so all else has to be compared.
    built = replace(rebuild(problem.recipe), sensing=problem.sensing)
    return built.digest == problem.digest or _alike(built, problem)


def _alike(one: ReachAvoidProblem, other: ReachAvoidProblem) -> bool:
    """Whether two problems are equal, up to the rounding of two machines; never with a black box."""
    ours, theirs, drop = one.functions, other.functions, dict.fromkeys(("grid", "inputs"))
    same = ours.keys() == theirs.keys() and one.inputs.shape == other.inputs.shape
    # the entries of the grid one by one; the inputs, which NumPy computes, are compared up to rounding below
    same = same and len({repr(each.numbers | each.numbers["grid"] | drop) for each in (one, other)}) == 1
    if not same or other.opaque or not near(one.inputs, other.inputs):
        return False
    pairs = [(cast(Formula, ours[name]), cast(Formula, theirs[name])) for name in ours]
    return all(alike(a.outputs, b.outputs) for a, b in pairs)


def scene(problem: ReachAvoidProblem) -> ArmScene:
    """The workspace of a case study's problem, to draw or to measure distances in."""
    # drawings ask, and `ArmProof`, which proves by what this says of arm, disks and agent
    if not problem.recipe:
        raise ValueError(f"the problem {problem.name!r} has no workspace to draw: it was not built by a case study")
    return _scene(_checked_recipe(problem.recipe))


def _checked_recipe(recipe: Mapping[str, Any]) -> Mapping[str, Any]:
    """The recipe, if its builder and the names of its arguments are those of this version."""
    builder = recipe.get("builder") if isinstance(recipe, Mapping) else None
    # names of another version are refused: a default in their place would build another problem
    if builder not in BUILDERS or set(recipe["arguments"]) != set(inspect.signature(BUILDERS[builder]).parameters):
        raise ValueError(
            f"a recipe must be {{'builder': one of {', '.join(BUILDERS)}, 'arguments': all that it takes in this "
            f"version}}, got {reprlib.repr(recipe)}; if another version wrote it, solve the problem again"
        )
    return recipe


def _recipe(builder: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The recipe of a case study's call: all its arguments, checked, as plain numbers, lists and strings."""
    # files keep these entries, and `Scene` of `sdhj.certified.check.arm.claims` reads them by name, in this form
    plain: dict[str, Any] = {}
    for name, value in given.items():
        if name == "nodes":
            several = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)
            counts = list(value) if several else [value] * len(AXES)
            if len(counts) != len(AXES):
                shown = f"{', '.join(AXES)}, got {reprlib.repr(value)}"
                raise ValueError(f"nodes must be one number or one for each of the axes {shown}")
            plain[name] = [whole("nodes", n, least=1, most=MOST) for n in counts]
        elif name == "steps":
            plain[name] = whole(name, value, least=1, most=MOST)
        elif name == "input_levels":  # its square is the number of inputs
            plain[name] = whole(name, value, least=2, most=math.isqrt(MOST_INPUTS))
        elif name in ("view_time", "kinematics"):
            plain[name] = str(value)
        elif name == "lengths":
            plain[name] = list(Arm(value).lengths)
        elif name == "target":
            plain[name] = Disk.of(value).describe()
        elif name == "obstacles":
            if not isinstance(value, Sequence):
                raise ValueError(f"obstacles must be a list of disks, got {value!r}")
            plain[name] = [Disk.of(disk).describe() for disk in value]
        elif name in ("delta", "u_max") or name.endswith("_box"):
            plain[name] = number(name, value, above=0.0)
        else:
            # All others are lengths and speeds, which may be 0.
            plain[name] = number(name, value, least=0.0)
    return {"builder": builder, "arguments": plain}


def _agent(recipe: Mapping[str, Any]) -> str:
    """What the adversary of a recipe moves: "pursuer" or "evader"."""
    return "pursuer" if "pursuer_radius" in recipe["arguments"] else "evader"


def _scene(recipe: Mapping[str, Any]) -> ArmScene:
    """The workspace that a recipe describes; a target only if the adversary moves a pursuer."""
    given, agent = recipe["arguments"], _agent(recipe)
    return ArmScene(
        arm=Arm(given["lengths"], given["half_width"], given["kinematics"]),
        obstacles=tuple(Disk.of(disk) for disk in given["obstacles"]),
        agent=agent,
        # both have the agent's name in a recipe, by which `_agent` tells the two case studies apart
        agent_radius=given[f"{agent}_radius"],
        agent_box=given[f"{agent}_box"],
        target=Disk.of(given["target"]) if agent == "pursuer" else None,
    )


@lru_cache(maxsize=8)  # to read the functions takes longer than all else
def _sets(workspace: ArmScene) -> tuple[TargetSet, tuple[UnsafeSet, ...]]:
    """The target and the unsafe sets, obstacles (G1 of App. A.3) and pursuer (G2)."""
    # in this order: `expect_recipe` of the checker takes the sets one by one, the obstacles before the pursuer
    unsafe = list[UnsafeSet]()
    if workspace.obstacles:
        unsafe.append(UnsafeSet(JOINTS, workspace.obstacles_value, workspace.obstacles_swept_value, "obstacles"))
    if workspace.target is None:
        return TargetSet(ALL_AXES, workspace.evader_value, name="evader"), tuple(unsafe)
    unsafe.append(UnsafeSet(ALL_AXES, workspace.pursuer_value, name="pursuer"))
    return TargetSet(JOINTS, workspace.target_value), tuple(unsafe)


def _problem(recipe: Mapping[str, Any], target: TargetSet, unsafe: tuple[UnsafeSet, ...]) -> ReachAvoidProblem:
    """The problem of a recipe with these sets and dq = u + v_d, dp = v_p (Eq. 9 and 10)."""
    given, agent = recipe["arguments"], _agent(recipe)
    # `expect_recipe` of the checker has grid, inputs and bounds a second time; the first component of u varies slowest
    box, speed = given[f"{agent}_box"], given[f"v_{agent[0]}_max"]
    levels = np.linspace(-given["u_max"], given["u_max"], given["input_levels"])
    inputs = np.stack(np.meshgrid(levels, levels, indexing="ij"), axis=-1).reshape(-1, 2)
    angle, periodic = math.pi, (True, True, False, False)
    ends = (-angle, -angle, -box, -box), (angle, angle, box, box)
    grid = Grid(*ends, given["nodes"], periodic, names=AXES, ends="wall")  # the agent's centre stays in its box
    bounds = [given["v_d_max"], given["v_d_max"], speed, speed]
    return ReachAvoidProblem(
        grid=grid,
        dynamics=Dynamics(inputs, np.hstack([inputs, np.zeros_like(inputs)]), np.eye(4), bounds),
        target=target,
        unsafe=unsafe,
        delta=given["delta"],
        steps=given["steps"],
        view_time=given["view_time"],
        name=recipe["builder"],
        recipe=recipe,
    )
