"""Robots whose promises are judged: the true motion and the true sets of each, written once, and its problem.

What a `Robot` holds is the robot itself, which the problem and the judge (`judge.trial`) have in common: how fast it
moves, where it must not be, where it has to get to. Grids belong to the problem alone; of their ends the judge knows
only what they stand for in the world (`Robot.ends`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from itertools import pairwise
from typing import Any

import numpy as np
from zoo import made

import sdhj
from sdhj.common.remembering import FloatArray

Level = Callable[[FloatArray, float], FloatArray]  # of points (M, axes) and a time, s: (M,), at most 0 inside
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Hazard:
    """A part of what is unsafe.

    Attributes
    ----------
    axes : tuple of int
        Of the state, ascending.
    level : callable (points (M, len(axes)), t) -> (M,)
        At most 0 in the set at time t, s.
    name : str
    """

    axes: tuple[int, ...]
    level: Level
    name: str


@dataclass(frozen=True)
class Robot:
    """dq/dt = drift(q, u) + gain v, |v_d| <= bounds_d; the same functions for the problem and for the judge.

    Attributes
    ----------
    lower, upper, nodes : (ndim,)
        The part of the state space that the problem is about, and the nodes of its grid.
    inputs : (L, m) array
    drift : callable (states (M, ndim), u (m,) or (M, m)) -> (M, ndim)
    gain : (ndim, D) array
    bounds : (D,) array
    hazards : sequence of Hazard
    delta, steps : float, int or None
        Of an interval, s; None: for ever, and it is asked at step 0 throughout.
    target : (axes, callable (points, t) -> (M,)), or None
    periodic : (ndim,) bool
    names : (ndim,) str
    ends : (ndim,) str or pair of str
        What lies past `lower` and `upper`: "unsafe", that is lost; "safe", out of danger for good; or "wall", what
        holds the robot there, as brakes do at a standstill.
    stateless : bool
        Whether the drift is that of the input alone, as method "lax" asks for.
    cells : (ndim,) int
        With which method "certified" takes a minute or two; none where it takes more, or proves nothing.
    steep : bool
        Whether it is solved with sampling="steep" too.
    """

    lower: Sequence[float]
    upper: Sequence[float]
    nodes: Sequence[int]
    inputs: FloatArray
    drift: Callable[[FloatArray, FloatArray], FloatArray]
    gain: FloatArray
    bounds: FloatArray
    hazards: Sequence[Hazard]
    delta: float
    steps: int | None
    target: tuple[tuple[int, ...], Level] | None = None
    periodic: Sequence[bool] = ()
    names: Sequence[str] = ()
    ends: Sequence[str | tuple[str, str]] = ()
    stateless: bool = False
    cells: tuple[int, ...] = ()
    steep: bool = False
    scales: dict[str, FloatArray] = field(default_factory=dict, compare=False)

    @property
    def ndim(self) -> int:
        return len(self.lower)

    def problem(self, sampling: str = "nodes") -> sdhj.ReachAvoidProblem:
        """What is solved: of these very functions."""
        inputs, periodic = np.array(self.inputs, dtype=float), list(self.periodic) or [False] * self.ndim
        drift: Any = self.drift
        if self.stateless:
            drift = np.concatenate([self.drift(np.zeros((1, self.ndim)), u) for u in inputs])
        return made(
            {"names": self.names or None, "ends": self.ends or "unsafe"},
            **{"lower": self.lower, "upper": self.upper, "nodes": self.nodes, "periodic": periodic},
            **{"inputs": inputs, "drift": drift, "gain": np.array(self.gain, dtype=float), "bounds": self.bounds},
            target=None if self.target is None else sdhj.TargetSet(*self.target),
            unsafe=[sdhj.UnsafeSet(one.axes, one.level, name=one.name, sampling=sampling) for one in self.hazards],
            delta=self.delta,
            steps=self.steps,
        )

    # ---- what the judge knows

    def velocity(self, q: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
        """Of states (M, ndim) under commands (M, m) and pushes (M, D): (M, ndim)."""
        return self.drift(q, u) + v @ np.array(self.gain, dtype=float).T

    def unsafe(self, q: FloatArray, t: float) -> FloatArray:
        """The least of all hazards' levels at states (M, ndim): (M,), at most 0 where one has happened."""
        return np.min([np.full(len(q), np.inf), *(one.level(q[:, list(one.axes)], t) for one in self.hazards)], axis=0)

    def reached(self, q: FloatArray, t: float) -> FloatArray:
        """Whether states (M, ndim) are in the target: (M,) bool, False where there is none."""
        if self.target is None:
            return np.zeros(len(q), bool)
        axes, level = self.target
        return level(q[:, list(axes)], t) <= 0

    @cached_property
    def faces(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """For "unsafe", "safe" and "wall" the coordinates of such ends, both (ndim,); infinite where there is none."""
        ends = [(one, one) if isinstance(one, str) else one for one in self.ends or ["unsafe"] * self.ndim]
        open_ends = ~np.array(list(self.periodic) or [False] * self.ndim)[:, None]
        found = {}
        for kind in ("unsafe", "safe", "wall"):
            own = np.array([[end == kind for end in pair] for pair in ends]) & open_ends
            low, high = np.where(own[:, 0], self.lower, -np.inf), np.where(own[:, 1], self.upper, np.inf)
            found[kind] = low, high
        return found

    def held(self, q: FloatArray) -> FloatArray:
        """States (M, ndim) held at the walls."""
        return np.clip(q, *self.faces["wall"])

    def beyond(self, q: FloatArray, kind: str) -> FloatArray:
        """Whether states (M, ndim) are past an end of a kind, by more than rounding: (M,) bool."""
        low, high = self.faces[kind]
        slack = 1e-9 * (np.array(self.upper) - self.lower)
        return np.any((q < low - slack) | (q > high + slack), axis=1)

    def clearances(self, q: FloatArray, t: float) -> FloatArray:
        """How far states (M, ndim) are from each hazard and each unsafe end, (M, hazards + ends), in no unit.

        Levels are divided by how much they differ over the state space, distances from ends by half an axis's length.
        """
        half = (np.array(self.upper) - self.lower) / 2
        low, high = self.faces["unsafe"]
        least = np.minimum(q - low, high - q)[:, np.isfinite(low) | np.isfinite(high)]
        ends = least / half[np.isfinite(low) | np.isfinite(high)]
        levels = [one.level(q[:, list(one.axes)], t)[:, None] / self.scale(one) for one in self.hazards]
        return np.concatenate([*levels, ends], axis=1)

    def scale(self, hazard: Hazard) -> float:
        """The standard deviation of a hazard's level over the state space at time 0."""
        if hazard.name not in self.scales:
            states = np.random.default_rng(0).uniform(self.lower, self.upper, (2000, self.ndim))
            self.scales[hazard.name] = np.std(hazard.level(states[:, list(hazard.axes)], 0.0)) + 1e-9
        return float(self.scales[hazard.name])


def part(u: FloatArray, k: int) -> Any:
    """Component k of a command (m,) or of commands (M, m)."""
    return u[k] if u.ndim == 1 else u[:, k]


def rows(q: FloatArray, *columns: Any) -> FloatArray:
    """Velocities (M, ndim) of columns that are numbers or (M,)."""
    still = np.zeros(len(q))
    return np.stack([still + column for column in columns], axis=1)


def every(*levels: Sequence[float]) -> FloatArray:
    """All combinations of levels, one row each."""
    return np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, len(levels))


def compass(count: int, speed: float) -> FloatArray:
    """To stand still, and so many directions in the plane: (count + 1, 2)."""
    angles = 2 * np.pi / count * np.arange(count)
    return speed * np.concatenate([np.zeros((1, 2)), np.stack([np.cos(angles), np.sin(angles)], axis=1)])


def disk(x: float, y: float, radius: float) -> Level:
    """The level of a disk that stands still, of points (M, 2), m."""
    return lambda p, t: np.hypot(p[:, 0] - x, p[:, 1] - y) - radius


# ---- robots that have to get somewhere


def quadrotor() -> Robot:
    """A quadrotor in a vertical plane, in gusts, that has to be near its place, clear of a pole.

    x, z (m), pitch (rad), their rates; inputs are thrust over mass (m/s^2) and angular acceleration (rad/s^2).
    """

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        thrust, turn = part(u, 0), part(u, 1)
        fall = thrust * np.cos(q[:, 2]) - GRAVITY
        return rows(q, q[:, 3], q[:, 4], q[:, 5], -thrust * np.sin(q[:, 2]), fall, turn)

    return Robot(
        lower=[-2.0, -1.5, -0.8, -2.0, -2.0, -3.0],
        upper=[2.0, 1.5, 0.8, 2.0, 2.0, 3.0],
        nodes=[9] * 6,
        inputs=every([6.0, GRAVITY, 14.0], [-4.0, 0.0, 4.0]),
        drift=drift,
        gain=np.eye(6)[:, 3:5],
        bounds=np.array([0.3, 0.3]),
        hazards=[Hazard((0, 1), disk(1.3, 0.9, 0.4), "pole")],
        target=((0, 1), lambda p, t: np.maximum(np.abs(p[:, 0]), np.abs(p[:, 1])) - 0.8),
        delta=0.2,
        steps=4,
    )


GATE_PACE, GATE_WAY = 0.5, 1.4  # rad/s; m


def gate_edge(t: Any) -> Any:
    """Where the lower edge of the gate is, m: it closes and opens again."""
    return 0.8 - GATE_WAY * (0.5 - 0.5 * np.cos(GATE_PACE * t))


def forklift() -> Robot:
    """A forklift, steered at the rear, that has to pass a gate which closes and opens: x, y (m), heading (rad)."""
    size = 0.3  # m, of half the forklift, a square

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        speed, steer = part(u, 0), part(u, 1)
        return rows(q, speed * np.cos(q[:, 2]), speed * np.sin(q[:, 2]), -speed * np.tan(steer) / 0.9)

    def wall(p: FloatArray, t: float) -> FloatArray:
        return np.maximum(np.abs(p[:, 0]), p[:, 1] + 0.9) - size

    def gate(p: FloatArray, t: float) -> FloatArray:
        return np.maximum(np.abs(p[:, 0]), gate_edge(t) - p[:, 1]) - size

    return Robot(
        lower=[-3.0, -2.0, -np.pi],
        upper=[3.0, 2.0, np.pi],
        nodes=[49, 33, 24],
        inputs=every([-0.6, 0.9], [-0.8, 0.0, 0.8]),
        drift=drift,
        gain=np.eye(3),
        bounds=np.array([0.05, 0.05, 0.1]),
        hazards=[
            Hazard((0, 1), wall, "wall"),
            Hazard((0, 1), gate, "gate"),
        ],
        target=((0, 1), disk(1.8, 0.3, 0.6)),
        delta=0.4,
        steps=12,
        periodic=[False, False, True],
        cells=(60, 40, 48),
    )


def swing_up() -> Robot:
    """A pendulum that a weak motor has to swing up, in degrees: angle from upright (deg), its rate (deg/s)."""

    degree = np.pi / 180

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, q[:, 1], (GRAVITY * np.sin(degree * q[:, 0]) + part(u, 0)) / degree)

    def upright(q: FloatArray, t: float) -> FloatArray:  # about in degrees: less than 20 off, and 80 a second
        return np.maximum(170.0 * (np.cos(20 * degree) - np.cos(degree * q[:, 0])), (np.abs(q[:, 1]) - 80.0) / 4.0)

    return Robot(
        lower=[-180.0, -500.0],
        upper=[180.0, 500.0],
        nodes=[72, 101],
        inputs=np.array([[-4.0], [0.0], [4.0]]),  # rad/s^2
        drift=drift,
        gain=np.array([[0.0], [1.0]]),
        bounds=np.array([15.0]),  # deg/s^2
        hazards=[],
        target=((0, 1), upright),
        delta=0.1,
        steps=12,
        periodic=[True, False],
        cells=(360, 400),
    )


def measured_wind() -> FloatArray:
    """Wind (9, 7, 2) that stations half a metre apart have measured, m/s, rounded: two eddies, and scatter."""
    at = every(np.linspace(0.0, 4.0, 9), np.linspace(0.0, 3.0, 7)).reshape(9, 7, 2)
    wind = np.zeros(at.shape)
    for centre, strength in (((1.2, 0.8), 0.9), ((2.8, 2.0), -0.8)):
        away = at - centre
        wind += strength * np.stack([-away[..., 1], away[..., 0]], axis=-1) / (0.3 + (away**2).sum(axis=-1))[..., None]
    return np.round(wind + np.random.default_rng(7).normal(0.0, 0.08, at.shape), 2)


WIND = measured_wind()


def wind_at(p: FloatArray) -> FloatArray:
    """The measured wind between the stations, bilinear, at points (M, 2): (M, 2), m/s."""
    return np.stack([sdhj.gridded(WIND[:, :, k], [0.0, 0.0], [0.5, 0.5])(p) for k in (0, 1)], axis=1)


def airship() -> Robot:
    """An airship in a wind that stations have measured, and that may differ from what they say: x, y (m)."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return wind_at(q) + u

    return Robot(
        lower=[0.0, 0.0],
        upper=[4.0, 3.0],
        nodes=[61, 46],
        inputs=compass(8, 0.5),
        drift=drift,
        gain=np.eye(2),
        bounds=np.array([0.1, 0.1]),
        hazards=[Hazard((0, 1), disk(2.0, 1.5, 0.3), "mast")],
        target=((0, 1), disk(3.3, 2.2, 0.4)),
        delta=0.25,
        steps=16,
    )


def many_inputs() -> Robot:
    """A ferry with 256 velocities and 200 short steps, in a current: x, y (m)."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, part(u, 0), part(u, 1))

    angles, speeds = 2 * np.pi / 32 * np.arange(32), np.linspace(0.0, 0.5, 8)
    inputs = np.array([[s * np.cos(a), s * np.sin(a)] for s in speeds for a in angles])
    return Robot(
        lower=[0.0, 0.0],
        upper=[4.0, 3.0],
        nodes=[61, 46],
        inputs=inputs,
        drift=drift,
        gain=np.eye(2),
        bounds=np.array([0.18, 0.18]),
        hazards=[Hazard((0, 1), disk(2.0, 1.4, 0.4), "island")],
        target=((0, 1), disk(3.0, 1.5, 0.4)),
        delta=0.025,
        steps=200,
        stateless=True,
    )


def tractor() -> Robot:
    """A tractor with its trailer: x, y of the rear axle (m), heading (rad), angle between them (rad), no jackknife."""
    wheelbase, drawbar = 0.8, 1.0  # m

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        speed, turn = part(u, 0), part(u, 0) * np.tan(part(u, 1)) / wheelbase
        fold = turn - speed / drawbar * np.sin(q[:, 3])
        return rows(q, speed * np.cos(q[:, 2]), speed * np.sin(q[:, 2]), turn, fold)

    def trailer(q: FloatArray, t: float) -> FloatArray:
        angle = q[:, 2] - q[:, 3]
        return np.hypot(q[:, 0] - drawbar * np.cos(angle), q[:, 1] - drawbar * np.sin(angle)) - 0.5

    return Robot(
        lower=[-2.4, -2.4, -np.pi, -1.2],
        upper=[2.4, 2.4, np.pi, 1.2],
        nodes=[25, 25, 24, 13],
        inputs=every([-0.6, 1.0], [-0.5, 0.0, 0.5]),
        drift=drift,
        gain=np.eye(4)[:, :3],
        bounds=np.array([0.05, 0.05, 0.05]),
        hazards=[Hazard((0, 1), disk(0.0, 0.0, 0.5), "tree"), Hazard((0, 1, 2, 3), trailer, "tree at the trailer")],
        target=((0, 1), disk(1.3, 1.0, 0.7)),
        delta=0.3,
        steps=8,
        periodic=[False, False, True, False],
        cells=(40, 40, 36, 20),
    )


LANE_SPEED = 9.0  # m/s, of the others


def merging() -> Robot:
    """A car on a ramp that has to get into a gap between two others: along, across (m), speed (m/s)."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, q[:, 2], part(u, 1), part(u, 0))

    def car(middle: float) -> Level:
        def level(p: FloatArray, t: float) -> FloatArray:
            return np.maximum(np.abs(p[:, 0] - middle - LANE_SPEED * t) - 4.5, 1.4 - p[:, 1])

        return level

    def gap(q: FloatArray, t: float) -> FloatArray:
        return np.maximum(np.abs(q[:, 0] - 25.0 - LANE_SPEED * t) - 4.0, 3.0 * (2.5 - q[:, 1]))

    return Robot(
        lower=[0.0, 0.0, 0.0],
        upper=[100.0, 4.0, 16.0],
        nodes=[101, 17, 17],
        inputs=every([-3.0, 0.0, 2.0], [-1.0, 0.0, 1.0]),  # m/s^2, m/s
        drift=drift,
        gain=np.eye(3)[:, 1:],
        bounds=np.array([0.1, 0.3]),
        hazards=[
            Hazard((0, 1), car(12.0), "car behind"),
            Hazard((0, 1), car(38.0), "car in front"),
            Hazard((0, 1), lambda p, t: np.maximum(80.0 - p[:, 0], p[:, 1] - 2.0), "end of the ramp"),
        ],
        target=((0, 1), gap),
        delta=0.5,
        steps=12,
        ends=["unsafe", "unsafe", "wall"],
        cells=(200, 80, 64),
        steep=True,
    )


def confined(places: FloatArray, velocity: FloatArray, box: float) -> FloatArray:
    """The velocity (M, 2) of a pursuer that cannot pass the walls of its box: it stops 10 ms before them."""
    return np.where(np.abs(places + 0.01 * velocity) > box, 0.0, velocity)


REACH, BOX, CATCH, TIP, TIP_RADIUS = 0.3, 0.36, 0.05, (0.05, 0.2), 0.08
POST, POST_RADIUS = (-0.2, 0.1), 0.07


@dataclass(frozen=True)
class ArmPursued:
    """The functions of an arm; its links are REACH long together."""

    links: int
    pursuers: int

    @property
    def might(self) -> FloatArray:
        """Of the adversary, rad/s and m/s."""
        return np.array([0.3] * self.links + [0.2] * 2 * self.pursuers)

    def agents(self, q: FloatArray) -> list[tuple[Any, Any]]:
        """Where the pursuers are."""
        return [(q[:, axis], q[:, axis + 1]) for axis in range(self.links, self.links + 2 * self.pursuers, 2)]

    def joints(self, q: FloatArray) -> list[tuple[Any, Any]]:
        """Base, elbows and tip of states (M, >= links)."""
        found, angle = [(0.0 * q[:, 0], 0.0 * q[:, 0])], 0.0
        for joint in range(self.links):
            angle, (x, y), link = angle + q[:, joint], found[-1], REACH / self.links
            found.append((x + link * np.cos(angle), y + link * np.sin(angle)))
        return found

    def clear_of(self, q: FloatArray, x: Any, y: Any) -> Any:
        """Distance (M,) of the links from a point, or from one for each state."""
        gaps = []
        for (x0, y0), (x1, y1) in pairwise(self.joints(q)):
            along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / (REACH / self.links) ** 2
            share = np.clip(along, 0.0, 1.0)
            gaps.append(np.hypot(x0 + share * (x1 - x0) - x, y0 + share * (y1 - y0) - y))
        return reduce(np.minimum, gaps)

    def target(self, q: FloatArray, t: float) -> Any:
        x, y = self.joints(q)[-1]
        return np.hypot(x - TIP[0], y - TIP[1]) - TIP_RADIUS

    def unsafe(self, q: FloatArray, t: float) -> Any:
        caught = reduce(np.minimum, (self.clear_of(q, *agent) for agent in self.agents(q)))
        return np.minimum(caught - CATCH, self.clear_of(q, *POST) - POST_RADIUS)

    def velocity(self, q: FloatArray, u: FloatArray, signs: FloatArray, t: float) -> FloatArray:
        v, links = self.might * signs, self.links
        return np.column_stack([u + v[:, :links], confined(q[:, links:], v[:, links:], BOX)])

    def hunt(self, q: FloatArray, u: FloatArray, left: float) -> FloatArray:
        later, rows = np.array(self.joints(q[:, : self.links] + left * u)[1:]), np.arange(len(q))
        ways = []
        for agent in self.agents(q):
            apart = later - np.array(agent)
            ways += list(np.sign(apart[np.argmin(np.hypot(*apart.swapaxes(0, 1)), axis=0), :, rows].T))
        return np.column_stack([np.sign(u + 1e-9), *ways])

    def robot(self, nodes: int, steps: int = 8) -> Robot:
        """Angles (rad) and the pursuers' places (m), in a fenced field."""
        links, places = self.links, range(self.links, self.links + 2 * self.pursuers, 2)
        own, axes = tuple(range(links)), [f"p{axis}{k or ''} (m)" for k in range(self.pursuers) for axis in "xy"]

        def drift(q: FloatArray, u: FloatArray) -> FloatArray:
            return rows(q, *(part(u, k) for k in own), *[0.0] * len(axes))

        def caught(q: FloatArray, t: float) -> FloatArray:
            return self.clear_of(q, q[:, links], q[:, links + 1]) - CATCH

        return Robot(
            lower=[-np.pi] * links + [-BOX] * len(axes),
            upper=[np.pi] * links + [BOX] * len(axes),
            nodes=[nodes] * (links + len(axes)),
            inputs=every(*[np.linspace(-3.0, 3.0, 3 if links > 2 else 5)] * links),
            drift=drift,
            gain=np.eye(links + len(axes)),
            bounds=self.might,
            hazards=[
                *(Hazard((*own, axis, axis + 1), caught, "pursuer") for axis in places),
                Hazard(own, lambda q, t: self.clear_of(q, *POST) - POST_RADIUS, "post"),
            ],
            delta=0.1,
            steps=steps,
            target=(own, self.target),
            periodic=[True] * links + [False] * len(axes),
            names=[f"q{joint + 1} (rad)" for joint in own] + axes,
            ends=["unsafe"] * links + ["wall"] * len(axes),
            stateless=True,
        )

    def problem(self, nodes: int) -> sdhj.ReachAvoidProblem:
        return self.robot(nodes).problem()


def arm() -> Robot:
    """Of three links, and a pursuer (`ArmPursued`)."""
    return ArmPursued(3, 1).robot(17, steps=6)


def coarse_disk() -> Robot:
    """A point, and a disk of radius 0.3 m in the middle of a cell, with nodes 0.375 m apart: x, y (m)."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, part(u, 0), part(u, 1))

    return Robot(
        lower=[0.0, 0.0],
        upper=[4.5, 3.0],
        nodes=[13, 9],
        inputs=compass(8, 0.5),
        drift=drift,
        gain=np.eye(2),
        bounds=np.array([0.1, 0.1]),
        hazards=[Hazard((0, 1), disk(2.4375, 1.3125, 0.3), "disk")],
        target=((0, 1), disk(3.4, 1.5, 0.6)),
        delta=0.4,
        steps=10,
        stateless=True,
        cells=(180, 120),
    )


# ---- robots that have to stay clear, some until the last step and some for ever


def crossing() -> Robot:
    """Two roads that cross: own place (m) and speed (m/s), the other's place (m). Who has crossed is safe."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, q[:, 1], part(u, 0), 8.0)

    return Robot(
        lower=[-16.0, 0.0, -22.0],
        upper=[6.0, 12.0, 6.0],
        nodes=[45, 25, 43],
        inputs=np.array([[-1.5], [0.0], [1.0]]),  # m/s^2
        drift=drift,
        gain=np.eye(3)[:, 1:],
        bounds=np.array([0.3, 2.0]),  # m/s^2, m/s
        hazards=[
            Hazard((0, 2), lambda p, t: np.maximum(np.abs(p[:, 0]) - 3.0, np.abs(p[:, 1]) - 4.0), "the other"),
        ],
        delta=0.25,
        steps=24,
        cells=(88, 48, 56),
        ends=[("unsafe", "safe"), "wall", ("unsafe", "safe")],
    )


def rail() -> Robot:
    """The README's cart on a rail, for ever: x (m), v (m/s)."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, q[:, 1], part(u, 0))

    return Robot(
        lower=[-1.0, -4.0],
        upper=[1.0, 4.0],
        nodes=[81, 81],
        inputs=np.array([[-3.0], [0.0], [3.0]]),  # m/s^2
        drift=drift,
        gain=np.array([[0.0], [1.0]]),
        bounds=np.array([0.3]),
        hazards=[],
        delta=0.1,
        steps=None,
        cells=(160, 160),
    )


def double_integrator() -> Robot:
    """A point on a line that brakes as hard as it drives, for ever: x (m), v (m/s)."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, q[:, 1], part(u, 0))

    return Robot(
        lower=[-1.0, -2.0],
        upper=[1.0, 2.0],
        nodes=[51, 51],
        inputs=np.array([[-1.0], [0.0], [1.0]]),  # m/s^2
        drift=drift,
        gain=np.array([[0.0], [1.0]]),
        bounds=np.array([0.2]),
        hazards=[],
        delta=0.1,
        steps=None,
        cells=(160, 160),
    )


def pendulum() -> Robot:
    """An inverted pendulum whose motor cannot lift it from where it hangs, for ever: angle (rad), its rate (rad/s)."""

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        return rows(q, q[:, 1], GRAVITY * np.sin(q[:, 0]) + part(u, 0))

    return Robot(
        lower=[-0.5, -1.6],
        upper=[0.5, 1.6],
        nodes=[81, 81],
        inputs=np.array([[-3.0], [0.0], [3.0]]),  # rad/s^2
        drift=drift,
        gain=np.array([[0.0], [1.0]]),
        bounds=np.array([0.1]),
        hazards=[],
        delta=0.05,
        steps=None,
        cells=(200, 200),
    )


def cart_pole() -> Robot:
    """A cart with a pole, for ever: x (m), v (m/s), the pole's angle (rad), its rate (rad/s)."""
    cart, pole, length = 1.0, 0.2, 0.5  # kg, kg, m: half the pole's

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        sin, cos = np.sin(q[:, 2]), np.cos(q[:, 2])
        whole = (part(u, 0) + pole * length * q[:, 3] ** 2 * sin) / (cart + pole)
        turn = (GRAVITY * sin - cos * whole) / (length * (4 / 3 - pole * cos**2 / (cart + pole)))
        return rows(q, q[:, 1], whole - pole * length * turn * cos / (cart + pole), q[:, 3], turn)

    return Robot(
        lower=[-1.5, -2.5, -0.5, -2.5],
        upper=[1.5, 2.5, 0.5, 2.5],
        nodes=[17, 17, 21, 21],
        inputs=np.array([[-10.0], [-5.0], [0.0], [5.0], [10.0]]),  # N
        drift=drift,
        gain=np.eye(4)[:, 3:],
        bounds=np.array([0.2]),  # rad/s^2
        hazards=[],
        delta=0.1,
        steps=None,
    )


def air3d() -> Robot:
    """Two aircraft at 5 m/s, the pursuer seen from the evader, for ever: ahead, left (m), heading (rad).

    Mitchell, Bayen & Tomlin (2005); who leaves the grid is not caught later (`extra_air3d.py`).
    """

    def drift(q: FloatArray, u: FloatArray) -> FloatArray:
        turn = part(u, 0)
        ahead = -5.0 + 5.0 * np.cos(q[:, 2]) + turn * q[:, 1]
        return rows(q, ahead, 5.0 * np.sin(q[:, 2]) - turn * q[:, 0], -turn)

    return Robot(
        lower=[-6.0, -10.0, 0.0],
        upper=[20.0, 10.0, 2 * np.pi],
        nodes=[51, 40, 50],
        inputs=np.array([[-1.0], [0.0], [1.0]]),  # rad/s
        drift=drift,
        gain=np.array([[0.0], [0.0], [1.0]]),
        bounds=np.array([1.0]),
        hazards=[Hazard((0, 1), disk(0.0, 0.0, 5.0), "collision")],
        delta=0.175,
        steps=None,
        periodic=[False, False, True],
        ends=["safe"] * 3,
        cells=(104, 80, 72),
    )


FLEET: dict[str, Callable[[], Robot]] = {
    "quadrotor": quadrotor,
    "forklift": forklift,
    "crossing": crossing,
    "swing-up": swing_up,
    "airship": airship,
    "256 inputs": many_inputs,
    "cart with a pole": cart_pole,
    "tractor": tractor,
    "merging": merging,
    "arm": arm,
    "rail": rail,
    "pendulum": pendulum,
    "double integrator": double_integrator,
    "air3d": air3d,
    "coarse disk": coarse_disk,
}
