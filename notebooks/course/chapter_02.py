"""Chapter 2, Upwinding: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from course.chapter_01 import disk
from course.exercises import exercise, expect, expect_close
from course.widgets import Explorer, Numbers, choice, slider
from sdhj.common.remembering import FloatArray
from sdhj.plotting import draw_set, frame_slice, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.problem.grid import Grid
from sdhj.problem.velocities import Velocities
from sdhj.solver.schemes import Scheme, evolve

# ---- pictures

DIFFERENCES = ("left", "central", "right")
INTEGRATOR = {1: "euler", 2: "rk2", 3: "rk3"}  # as accurate in time as the differences are in space
EXACT: dict[str, Any] = {"color": "#c44e00", "linestyle": (0, (4, 1.5)), "linewidth": 1.6}


@dataclass(frozen=True)
class Profile:
    """A function on a line that was carried along: nodes `x` (n,), values before and after, and time steps taken."""

    x: FloatArray
    start: FloatArray
    computed: FloatArray
    exact: FloatArray
    steps: int

    @property
    def error(self) -> float:
        """The largest difference from the exact profile."""
        return float(np.abs(self.computed - self.exact).max())


def hat(x: FloatArray) -> FloatArray:
    """Level-set function of |x| <= 0.3 on the periodic line [-1, 1), capped so that it is flat far away."""
    wrapped = np.mod(x + 1.0, 2.0) - 1.0
    return np.clip(np.abs(wrapped) - 0.3, -0.2, 0.2)


def carry(
    difference: str = "right", *, nodes: int = 80, velocity: float = 1.0, duration: float = 0.4, cfl: float = 0.75
) -> Profile:
    """Solve d Phi / d tau = velocity * d Phi / dx on a periodic line with explicit Euler steps.

    The exact solution is Phi(x, tau) = s(x + velocity * tau): what x is worth comes from the side it moves to.

    Parameters
    ----------
    difference : {"left", "central", "right"}
        Which neighbours the derivative is taken from.
    nodes : int
        On the line [-1, 1).
    velocity, duration : float
        m/s and s.
    cfl : float
        The length of a step in units of spacing / |velocity|.

    Raises
    ------
    ValueError
        For an unknown difference.
    """
    if difference not in DIFFERENCES:
        raise ValueError(f"difference must be one of {', '.join(DIFFERENCES)}, got {difference!r}")
    x = -1.0 + 2.0 / nodes * np.arange(nodes)
    spacing = 2.0 / nodes
    steps = max(1, int(np.ceil(duration * abs(velocity) / (spacing * cfl) - 1e-9)))
    start = hat(x)
    values = start.copy()
    for _ in range(steps):
        left, right = values - np.roll(values, 1), np.roll(values, -1) - values
        slope = {"left": left, "central": (left + right) / 2, "right": right}[difference] / spacing
        values = values + duration / steps * velocity * slope
    return Profile(x, start, values, hat(x + velocity * duration), steps)


@dataclass(frozen=True)
class Shrunk:
    """A disk to be reached, carried back through one interval: computed and exact values, each (nodes, nodes)."""

    grid: Grid
    start: FloatArray
    computed: FloatArray
    exact: FloatArray
    steps: int

    @property
    def mean_error(self) -> float:
        """Mean error at the nodes near the boundary, abs(Phi) < 0.3, away from the walls."""
        near = (np.abs(self.exact) < 0.3) & (np.abs(self.grid.points()).max(axis=1) < 1.2).reshape(self.grid.shape)
        return float(np.abs(self.computed - self.exact)[near].mean())

    @property
    def wrongly_inside(self) -> int:
        """Nodes that the scheme calls winning and the exact solution does not."""
        return int(np.count_nonzero((self.computed <= 0) & (self.exact > 0)))


def shrink(
    nodes: int = 41,
    scheme: Scheme | None = None,
    *,
    velocity: Sequence[float] = (1.0, 0.5),
    adversary: float = 0.3,
    duration: float = 0.5,
) -> Shrunk:
    """Game 3 for one input in the plane: from where is a disk reached, whatever |v|_inf <= `adversary` does?

    dq/dt = velocity + v, and the exact cost is the largest distance from the disk over the box of places to end in.
    """
    scheme = Scheme(frame="fixed", dtype="float64") if scheme is None else scheme
    grid = Grid((-1.5, -1.5), (1.5, 1.5), (nodes, nodes), names=("x", "y"), ends="wall")
    u, b = np.asarray(velocity, dtype=np.float64), np.full(2, adversary)
    rates = Velocities(u - b, u + b)
    start = disk(grid, (0.3, 0.15), 0.6)
    away = np.abs(grid.points() + u * duration - np.array([0.3, 0.15])) + adversary * duration
    exact = (np.hypot(away[:, 0], away[:, 1]) - 0.6).reshape(grid.shape)
    computed = evolve(grid, start, rates, duration, scheme)
    return Shrunk(grid, start, computed, exact, rates.steps(grid, duration, scheme.cfl))


def draw_profile(ax: Axes, profile: Profile) -> None:
    """A level-set function on a line that was carried along, and the sets {Phi <= 0} as bars below."""
    ax.axhline(0.0, color="#8c8c8c", linewidth=0.6)
    kinds = (
        ("start", profile.start, "#8c8c8c", 1.0),
        ("exact", profile.exact, "#c44e00", 1.6),
        ("computed", profile.computed, "#0b3c5d", 1.6),
    )
    for row, (name, values, colour, width) in enumerate(kinds):
        looks = {"linewidth": width, "marker": "." if name == "computed" else "", "markersize": 3}
        ax.plot(profile.x, values, color=colour, linestyle="-", label=name, gid=name, **looks)
        inside = np.where(values <= 0, -0.3 - 0.035 * row, np.nan)
        ax.plot(profile.x, inside, color=colour, linewidth=3, linestyle="-", solid_capstyle="butt", gid=f"{name}-set")
    ax.set(xlim=(-1, 1), ylim=(-0.42, 0.42), xlabel="$x$ (m)", ylabel=r"$\Phi(x)$ (m)")
    ax.legend(loc="upper right", ncols=3)


def draw_profiles(figure: Figure, profiles: Mapping[str, Profile]) -> None:
    """Several profiles side by side."""
    axes = np.atleast_1d(figure.subplots(1, len(profiles), sharey=True))
    for ax, (title, profile) in zip(axes, profiles.items(), strict=True):
        draw_profile(ax, profile)
        ax.set_title(title)
        ax.get_legend().remove()
    for ax in axes[1:]:
        ax.set_ylabel("")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_shrunk(ax: Axes, shrunk: Shrunk) -> None:
    """A disk carried back through one interval, computed (blue) and exact (dashed); crosses: nodes wrongly inside."""
    grid = shrunk.grid
    where = plane(grid, (0.0, 0.0), resolution=301)
    outline = {"facecolor": "none", "edgecolor": "#8c8c8c", "linewidth": 1.0}
    draw_set(ax, where, where.of(grid, shrunk.start), outline, "target", 1.0)
    draw_set(ax, where, where.of(grid, shrunk.computed), FULL_LOOKS | {"linewidth": 1.8}, "computed", 1.2)
    dashed = {"colors": EXACT["color"], "linewidths": 1.6, "linestyles": "--"}
    ax.contour(where.x, where.y, where.of(grid, shrunk.exact), levels=[0.0], zorder=3, **dashed)
    wrong = grid.points()[((shrunk.computed <= 0) & (shrunk.exact > 0)).ravel()]
    ax.plot(*wrong.T, "x", color=OUTCOME_INK, markersize=5, zorder=4, gid="wrong")
    frame_slice(ax, grid)
    ax.set_aspect("equal")


def shrunk_legend() -> list[Line2D]:
    """Legend entries of `draw_shrunk`."""
    return [
        Line2D([], [], color="#8c8c8c", linewidth=1.0, linestyle="-", label="to be reached"),
        Line2D([], [], color="#0b3c5d", linewidth=1.8, linestyle="-", label="computed"),
        Line2D([], [], label="exact", **EXACT),
    ]


def draw_orders(figure: Figure, cases: Mapping[str, Shrunk]) -> None:
    """The same answer from several schemes, side by side."""
    axes = np.atleast_1d(figure.subplots(1, len(cases), sharey=True))
    for ax, (title, case) in zip(axes, cases.items(), strict=True):
        draw_shrunk(ax, case)
        ax.set_title(title)
    figure.legend(handles=shrunk_legend(), loc="outside lower center", ncols=3)


def draw_convergence(ax: Axes, spacing: Sequence[float], errors: Mapping[str, Sequence[float]]) -> None:
    """Errors against spacing on logarithmic axes, one line for each scheme; the slope of a line is its order."""
    markers = ("o", "s", "^", "D")
    for marker, (name, values) in zip(markers, errors.items(), strict=False):
        ax.loglog(spacing, values, marker=marker, label=name, gid=name)
    ax.set(xlabel="spacing (m)", ylabel="mean error near the boundary (m)")
    ax.set_xticks(list(spacing), [f"{h:.3f}" for h in spacing])
    ax.minorticks_off()
    ax.grid(True, which="major")
    ax.legend()


# ---- widgets


def explore_upwinding() -> Explorer:
    """A profile carried along a line with left, central or right differences and a time step of your choice."""

    def draw(figure: Figure, difference: str, cfl: float, nodes: int, velocity: float, duration: float) -> Numbers:
        with np.errstate(over="ignore"):
            profile = carry(difference, cfl=cfl, nodes=nodes, velocity=velocity, duration=duration)
        draw_profile(figure.subplots(), profile)
        return {"time steps": profile.steps, "largest error (m)": profile.error}

    controls = {
        "difference": choice("difference", DIFFERENCES, "right"),
        "cfl": slider("step, CFL number", 0.1, 1.5, 0.05, 0.75),
        "nodes": slider("nodes", 20, 160, 10, 80),
        "velocity": slider("velocity (m/s)", -1.0, 1.0, 0.25, 1.0),
        "duration": slider("carried for (s)", 0.0, 0.8, 0.05, 0.4),
    }
    alt = "A hat-shaped profile, where it should be and where it is computed to be"
    return Explorer(draw, controls, size=(7.0, 3.2), alt=alt, motion="cfl", named=(1.0,), process="duration")


def explore_schemes() -> Explorer:
    """A disk carried back under an adversary: flux, order and grid against the exact answer."""

    def draw(figure: Figure, flux: str, order: int, nodes: int, adversary: float) -> Numbers:
        scheme = Scheme(flux=flux, order=order, integrator=INTEGRATOR[order], frame="fixed", dtype="float64")
        case = shrink(nodes, scheme, adversary=adversary)
        ax = figure.subplots()
        draw_shrunk(ax, case)
        ax.legend(handles=shrunk_legend(), loc="lower right")
        return {
            "time steps": case.steps,
            "mean error near the boundary (m)": case.mean_error,
            "nodes wrongly inside": case.wrongly_inside,
        }

    controls = {
        "flux": choice("flux", ("godunov", "lax-friedrichs"), "godunov"),
        "order": choice("order", (1, 2, 3), 1),
        "nodes": slider("nodes on each axis", 11, 81, 2, 31),
        "adversary": slider("adversary's speed (m/s)", 0.0, 1.0, 0.05, 0.3),
    }
    return Explorer(draw, controls, size=(5.2, 3.9), alt="The computed reach set and the exact one", motion="nodes")


# ---- checks


@exercise(
    "2.1",
    "The greatest speeds are those of the velocity and of the adversary together, and 41 nodes have 40 gaps.",
)
def check_steps(steps):
    """ceil(0.5 (1.3 + 0.8) / (3 / 40) / 0.75)."""
    expect(steps != 18, "the count is the next whole number above: a step must not be longer than allowed.")
    expect(
        steps != 14,
        "does the adversary add to the speed (1.3 and 0.8 m/s)? Does a step take 0.75 of what (2.6) allows?",
    )
    expect(steps not in (12, 20), "rates add over the axes, and 41 nodes have 40 gaps between them.")
    expect_close(steps, 19, "0.5 s times the sum of speed over spacing, divided by the CFL number.")


@exercise(
    "2.2",
    "Two Euler steps multiply by (1 + z)^2. Half of that and half of 1 is G, which is complex: its size is asked for.",
)
def check_amplification(amplification):
    """|1 + z + z^2 / 2|."""
    theta = np.linspace(-np.pi, np.pi, 101)
    for courant in (0.25, 0.75, 1.0):
        z = courant * (np.exp(1j * theta) - 1)
        got = np.asarray(amplification(courant, theta))
        expect(np.isrealobj(got), "return the absolute value of G, a real number for each theta.")
        euler = np.allclose(got, np.abs(1 + z))
        expect(not euler, "that is a single Euler step. Multiply twice by 1 + z, and take the mean with 1.")
        expect_close(got, np.abs(1 + z + z**2 / 2), "half of 1 and half of (1 + z) squared.")
    return "At most 1 up to a CFL number of 1, and closer to it for long waves than Euler's: less is smeared out."


@exercise("2.3", "In `godunov` the largest of the candidates wins. Who chooses here, and is zero a candidate?")
def check_help(helper):
    """min over w of max(w, 0) p+ + min(w, 0) p-."""
    minus, plus = np.random.default_rng(0).normal(size=(2, 400))
    for low, high in ((0.2, 1.0), (-1.0, -0.1), (-0.6, 1.3), (-0.5, 0.5), (0.4, 0.4)):
        w = np.unique([*np.linspace(low, high, 41), *([0.0] if low < 0 < high else [])])[:, None]
        best = np.min(np.maximum(w, 0) * plus + np.minimum(w, 0) * minus, axis=0)
        got = np.asarray(helper(minus, plus, low, high))
        where = f"velocities in [{low}, {high}]"
        expect(
            got <= best + 1e-9, f"{where}: the robot can do better, and may choose any w between, standing still too."
        )
        expect_close(got, best, f"{where}: which side does each velocity look to? Right where w > 0.")


@exercise("2.4", "Follow one state: where is it after tau, if it meets the end on its way, and if it does not?")
def check_wall(at_the_wall):
    """min(x + tau, 1)."""
    x = np.linspace(-1, 1, 41)
    for tau in (0.0, 0.3, 1.0, 2.5):
        got = np.asarray(at_the_wall(x, tau))
        expect(got.shape == x.shape, "x is an array: one cost for each start.")
        expect(np.isfinite(got), "the end is a wall here and not a cliff: the state stays, nothing is lost.")
        expect(got <= 1 + 1e-9, "no state passes the wall at x = 1, so no state pays more than 1.")
        expect_close(got, np.minimum(x + tau, 1.0), "a state that has not yet met the wall pays x + tau.")
    return "A grid whose end is not a wall in the world needs an unsafe margin instead, or pretends that there is one."


def _eno3(values, h):
    """From the definition: nodes i - 1 and i (or i and i + 1), then twice the neighbour with the smaller difference."""
    count, found = len(values), np.zeros((2, len(values)))
    for side, base in enumerate((-1, 0)):
        for i in range(count):
            nodes = [i + base, i + base + 1]
            for _ in range(2):
                left, right = [nodes[0] - 1, *nodes], [*nodes, nodes[-1] + 1]
                sizes = [abs(np.diff(values[np.mod(one, count)], len(nodes))[0]) for one in (left, right)]
                nodes = left if sizes[0] < sizes[1] else right
            places = np.array(nodes) - i
            found[side, i] = np.polyfit(places, values[np.mod(nodes, count)], 3)[2] / h
    return found


@exercise(
    "2.5",
    "Keep three arrays: D between nodes, B = D - D at nodes, C = B - B between nodes. With which factor C enters "
    "is the slope of (i - a)(i - b) / 6 at node i.",
)
def check_third(eno3):
    """Exact for cubics, third order for a sine, one-sided at a kink."""
    n, h = 60, 0.1
    x = h * np.arange(n)
    away = slice(4, -4)
    for power in range(1, 4):
        minus, plus = eno3((x - 2.0) ** power, h)
        expect(np.shape(minus) == (n,) and np.shape(plus) == (n,), "p- and p+ at each of the nodes.")
        exact = power * (x - 2.0) ** (power - 1)
        for name, got in (("p-", minus), ("p+", plus)):
            expect_close(got[away], exact[away], f"{name} is not exact for x^{power}.", within=1e-8)
    errors = []
    for n in (40, 80, 160):
        x = 2 * np.pi / n * np.arange(n)
        minus, plus = eno3(np.sin(x), 2 * np.pi / n)
        errors.append(np.mean(np.abs(minus - np.cos(x)) + np.abs(plus - np.cos(x))))
    order = np.log2(errors[-2] / errors[-1])
    expect(order > 2.7, f"for a sine the error falls with order {order:.1f}. Is the line closed at its ends?")
    rough = np.random.default_rng(0).normal(size=40)
    said = "on values that jump: which four nodes does each difference use? One more is next to those already used."
    expect_close(eno3(rough, 0.5), _eno3(rough, 0.5), said)
    x = 0.1 * (np.arange(60) - 30)
    minus, plus = eno3(np.abs(x), 0.1)
    left, right = slice(6, 30), slice(31, 54)
    expect_close(np.r_[minus[left], plus[right]], np.r_[-np.ones(24), np.ones(23)], "it looks across a kink of |x|.")
    expect_close(
        [minus[30], plus[30]], [-1.0, 1.0], "at the kink p- is the slope on the left, p+ the one on the right."
    )
    return f"Fitted order on a sine: {order:.1f}."


@exercise(
    "2.6",
    "Where would the function have to be concave, and how near to zero would it have to be there? 16 steps of a mean "
    "of two neighbours spread a crest over a few nodes.",
)
def check_filled(lowered, filled):
    """Second differences below zero; two lost nodes claimed by the right scheme."""
    values = np.random.default_rng(0).normal(size=60)
    got = np.asarray(lowered(values))
    expect(got.shape == (60,), "one answer for each node of the periodic line.")
    bend = np.roll(values, -1) - 2 * values + np.roll(values, 1)
    expect(
        not np.array_equal(got, bend > 0),
        "the sign of the term is that of the second derivative: where is that negative?",
    )
    expect(got == (bend < 0), "a node and its two neighbours tell: the second difference, on a line that closes.")
    nodes, courant, steps = 80, 0.5, 16
    x, h = np.linspace(-1.0, 1.0, nodes, endpoint=False), 2.0 / nodes
    start = np.asarray(filled(x), dtype=np.float64)
    expect(start.shape == x.shape, "x is an array: one value for each place.")
    expect(np.abs(np.roll(start, -1) - start) <= h * (1 + 1e-9), "somewhere the slope is more than one, ends included.")
    computed = start
    for _ in range(steps):
        computed = (1 - courant) * computed + courant * np.roll(computed, -1)
    exact = np.asarray(filled(np.mod(x + steps * courant * h + 1.0, 2.0) - 1.0), dtype=np.float64)
    expect(np.any(exact <= 0), "there is nothing to be reached.")
    false = int(np.count_nonzero((computed <= 0) & (exact > 1e-12)))
    expect(
        false >= 2,
        f"{false} lost nodes are claimed. The function has to be concave, and just above zero, between two parts.",
    )
    return f"{false} lost nodes are claimed. The coarser the grid, the wider the gaps that it fills."
