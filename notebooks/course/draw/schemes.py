"""The Hamilton-Jacobi equation of Prop. 1 without an obstacle, on a line and in the plane: solved and drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from course.draw.sets import disk
from sdhj.kernels import FloatArray
from sdhj.plotting import draw_set, frame_slice, plane
from sdhj.plotting.looks import FULL_LOOKS, OUTCOME_INK
from sdhj.problem.grid import Grid
from sdhj.problem.interval import Velocities
from sdhj.solver.schemes import Scheme, evolve

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
