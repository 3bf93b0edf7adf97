"""Finite differences for Hamilton-Jacobi-Isaacs equations, in any number of dimensions.

Backward in time, with tau = t_{k+1} - t, the games of App. A.3 all read

    d Phi / d tau = H(x, D Phi),      H(x, p) = sup_v  p . f(x, u_j, v),

optionally followed by Phi <- max(Phi, -g). Space is discretised by upwind differences p- and p+ of order 1, 2 or 3
(first order; essentially non-oscillatory, Osher & Shu 1991), which one of two numerical Hamiltonians combines:

* Where the adversary moves every axis on its own, the velocity set is a box, H(x, p) = sum_i max(a_i p_i, b_i p_i)
  with a_i <= b_i the extreme velocities on axis i, and Godunov's flux is exact and cheap: each extreme velocity takes
  its upwind difference, and standing still is allowed where a_i < 0 < b_i (a local maximum then stays).
* Lax-Friedrichs: H((p- + p+) / 2) + sum_i alpha_i (p+_i - p-_i) / 2, with alpha_i(x) = max(|a_i|, |b_i|) the local
  bound on |dH / dp_i|: just enough dissipation to be monotone, and it works for coupled velocity sets too.

Time is discretised by the total-variation-diminishing Runge-Kutta schemes of order 1, 2, 3 (Shu & Osher 1988).

`sdhj.kernels.stages` does the work, on planes of the last two axes; the differences and the numerical Hamiltonians are
there.
"""

import math
import reprlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from sdhj.common.checks import Options, option
from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import choice
from sdhj.kernels.stages import DIFFERENCES, HAMILTONIANS, STENCIL_RADIUS, Layout, stage
from sdhj.problem.boxes import most_on_padding, out_of_danger
from sdhj.problem.grid import Grid
from sdhj.problem.velocities import Velocities

DTYPES = ("float32", "float64")
RUN = 2048  # nodes in one loop: long enough to vectorise, short enough for the first-level cache
# each stage: (weight kept of the step's start, the rest goes to an Euler step from the stage before; time reached)
STAGES = {
    "euler": ((0.0, 1.0),),
    "rk2": ((0.0, 1.0), (0.5, 1.0)),
    "rk3": ((0.0, 1.0), (0.75, 0.5), (1 / 3, 1.0)),
}
OPTIONS: dict[str, tuple[Any, ...]] = {
    "flux": tuple(HAMILTONIANS),
    "order": tuple(DIFFERENCES),
    "integrator": tuple(STAGES),
    "frame": ("moving", "fixed"),
    "dtype": DTYPES,
}


@dataclass(frozen=True)
class Scheme(Options):
    """How the Hamilton-Jacobi-Isaacs equations are discretised (Sec. 5.4).

    Parameters
    ----------
    flux : {"godunov", "lax-friedrichs"}
        The numerical Hamiltonian. Godunov is sharper; if the adversary couples axes, Lax-Friedrichs is used in any
        case.
    order : {2, 1, 3}
        Of the upwind differences in space.
    integrator : {"rk2", "euler", "rk3"}
        In time.
    cfl : float
        Time step as a fraction of the largest stable one, in (0, 1].
    frame : {"moving", "fixed"}
        "moving": where the drift is constant, the PDE is solved once in coordinates that move with it, and shifted back
        for each input (`HJIGames.moving_frame` says where not). Where each component of the disturbance moves one axis,
        by a cell or more in an interval, maxima are kept that differences would erode; if the drift is along periodic
        axes only, the avoid games are then solved in closed form (`sdhj.solver.hopf_lax`). "fixed", and otherwise:
        finite differences for everything.
    dtype : {"float32", "float64"}

    Notes
    -----
    Orders 2 and 3 choose, at each node, the difference that is smaller (Osher and Shu). Ties are broken alike in mirror
    images. Differences of opposite sign that are equal but for a rounding make the choice, and so the value, jump: by
    some 1e-5 in float32, more where many choices follow one another, and 1e-12 in float64.

    Examples
    --------
    In both frames; on a coarse grid the fixed one loses states:

    >>> import sdhj
    >>> problem = sdhj.arm_case_study(nodes=13, steps=3)
    >>> methods = [sdhj.HJI(sdhj.Scheme(frame=frame)) for frame in ("fixed", "moving")]
    >>> [round(sdhj.solve(problem, method).fraction(start=0, within=3), 2) for method in methods]
    [0.16, 0.18]
    """

    flux: str = "godunov"
    order: int = 2
    integrator: str = "rk2"
    cfl: float = 0.75
    frame: str = "moving"
    dtype: str = "float32"

    def __post_init__(self) -> None:
        for name, allowed in OPTIONS.items():
            option(name, getattr(self, name), allowed)
        cfl: Any = self.cfl
        # truth values and durations are numbers to Python and NumPy
        real = isinstance(cfl, int | float | np.integer | np.floating) and not isinstance(cfl, bool | np.timedelta64)
        if not real or not 0.0 < cfl <= 1.0:
            raise ValueError(f"cfl must be a number in (0, 1], got {reprlib.repr(cfl)}: a larger step is unstable")


@dataclass(frozen=True)
class FiniteDifferences(Options):
    """Base of methods by finite differences, whose one option is the scheme."""

    scheme: Scheme = field(default_factory=Scheme)

    def __post_init__(self) -> None:
        if not isinstance(self.scheme, Scheme):
            raise ValueError(f"scheme must be a sdhj.Scheme, for example Scheme(order=3), got {self.scheme!r}")

    @property
    def options(self) -> dict[str, Any]:
        """The options of the scheme as plain values by name, for a table's details."""
        return dict(vars(self.scheme))


def too_restless_error(delta: float) -> ValueError:
    """The ValueError for velocities that change too fast within an interval of delta s."""
    return ValueError(
        f"velocities change too fast within a sampling interval of delta = {delta:g} to be followed; use a "
        "shorter delta, or include the vibration in the adversary's bounds"
    )


@lru_cache(maxsize=64)
def layout_of(grid: Grid, order: int) -> Layout:
    """The layout in which kernels read a function on the grid, for differences of some order."""
    *leading, rows, nodes = (1, *grid.shape) if grid.ndim == 1 else grid.shape
    ghosts = min(order, STENCIL_RADIUS)
    top, width = ghosts if grid.ndim > 1 else 0, nodes + 2 * ghosts
    begins = np.arange(math.prod(leading)).reshape(leading) * (rows + 2 * top) * width  # of each plane
    near = np.empty((begins.size, grid.ndim, 2, STENCIL_RADIUS), np.int64)
    for axis, side, o in np.ndindex(near.shape[1:]):
        shift = (2 * side - 1) * min(o + 1, ghosts)  # a low order reads less than it is handed
        if axis < len(leading):
            moved = begins.take(_neighbour(np.arange(grid.shape[axis]) + shift, grid, axis), axis=axis)
        else:
            moved = begins + shift * (1 if axis == grid.ndim - 1 else width)
        near[:, axis, side, o] = moved.ravel()
    source = _neighbour(np.arange(-top, rows + top), grid, -2) if top else np.zeros(1, np.int64)
    chunks = min(max(1, round(rows * width / RUN)), rows)
    return Layout(
        near.reshape(begins.size, grid.ndim, -1),
        source,
        rows,
        top,
        nodes,
        width,
        ghosts,
        chunks,
        grid.periodic[-1],
    )


def _neighbour(node: FloatArray, grid: Grid, axis: int) -> FloatArray:
    """Which nodes along an axis stand for the indices `node`, which may be beyond the ends.

    Around a periodic axis; at a bounded one the last node stands for all beyond it (constant extrapolation).
    """
    n = grid.shape[axis]
    return node % n if grid.periodic[axis] else np.clip(node, 0, n - 1)


def _with_ghosts(grid: Grid, layout: Layout, values: FloatArray, dtype: str) -> FloatArray:
    """Values with ghost nodes before and behind those of the last two axes, new."""
    # the kernel `stage` sets the ghosts of what it writes by the same rule (`_fill_ghosts`)
    rows, planes, n, g = layout.rows + 2 * layout.top, layout.near.shape[0], layout.nodes, layout.ghosts
    out = np.empty((planes, rows, layout.width), dtype)
    out[:, layout.top : rows - layout.top, g:-g] = values.reshape(planes, layout.rows, n)
    lines = out.reshape(-1, layout.width)  # a column at a time: long loops
    for o in range(g):
        left, right = (n + o, g + o) if layout.periodic else (g, n + g - 1)
        lines[:, o], lines[:, n + g + o] = lines[:, left], lines[:, right]
    for row in [*range(layout.top), *range(rows - layout.top, rows)]:
        out[:, row] = out[:, layout.source[row] + layout.top]
    return out.reshape((*grid.shape[:-2], rows, layout.width)[-grid.ndim :])


def _field(
    grid: Grid, layout: Layout, parts: FloatArray | tuple[FloatArray, ...], leading: int, dtype: str
) -> FloatArray:
    """Functions on the grid as the kernels read them: (count, leading..., nodes with ghosts), new.

    `parts` are (count, leading..., *grid.shape), or (count, leading...) for constant functions, which get one plane of
    nodes.
    """
    plane, shape = (layout.rows + 2 * layout.top) * layout.width, (len(parts), *parts[0].shape[:leading])
    if parts[0].ndim == leading:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(parts)[..., None], (*shape, plane)), dtype)
    out = np.empty((*shape, layout.near.shape[0] * plane), dtype)
    for place in np.ndindex(shape):  # none where the adversary has no components
        out[place] = _with_ghosts(grid, layout, parts[place[0]][place[1:]], dtype).ravel()
    return out


def terms_of(grid: Grid, layout: Layout, velocities: Velocities, dtype: str) -> tuple[FloatArray, ...]:
    """Velocities as the kernel `stage` reads them, flat arrays, kept in `velocities.terms` if that is a dict.

    (box / dx,) where they are constant; else (box, 1 / dx), or for velocities that couple axes (box, 1 / dx, drift,
    gain). box has the lower velocities of all axes, then the upper ones; all but 1 / dx have ghost nodes.
    """
    # the kernel knows these cases by the length of the tuple alone
    kept = {} if velocities.terms is None else velocities.terms
    if (key := (grid, layout.ghosts, dtype)) in kept:
        return kept[key]
    spacing, box = np.array(grid.spacing), (velocities.low, velocities.high)
    if isinstance(box[0], np.ndarray) and box[0].ndim == 1 and not velocities.coupled:
        return kept.setdefault(key, ((np.stack(box) / spacing).ravel().astype(dtype),))
    if isinstance(box[0], np.ndarray):
        laid_out = _field(grid, layout, box, 1, dtype)
    else:  # each end lies on the axes that it varies along
        laid_out = np.empty(
            (2 * grid.ndim, layout.near.shape[0] * (layout.rows + 2 * layout.top) * layout.width), dtype
        )
        for row, one in zip(laid_out, (*box[0], *box[1]), strict=True):
            row[:] = _with_ghosts(grid, layout, np.broadcast_to(one.astype(dtype), grid.shape), dtype).ravel()
    found = laid_out.ravel(), (1.0 / spacing).astype(dtype)
    if velocities.drift is not None and velocities.gain is not None:
        coupled = _field(grid, layout, velocities.drift, 1, dtype), _field(grid, layout, velocities.gain, 2, dtype)
        return kept.setdefault(key, (*found, *coupled))
    return kept.setdefault(key, found)


def arranged_bytes(grid: Grid, scheme: Scheme) -> int:
    """Bytes of what `terms_of` makes of velocities, a box at each node, that depend on the state."""
    layout = layout_of(grid, scheme.order)
    plane = (layout.rows + 2 * layout.top) * layout.width
    return 2 * grid.ndim * np.dtype(scheme.dtype).itemsize * len(layout.near) * plane


def _over_time(given: Any, arrange: Callable[[Any], Any]) -> Callable[[float], Any]:
    """The function tau -> arrange(given), arranged at once, or tau -> arrange(given(tau))."""
    if callable(given):
        return lru_cache(maxsize=1)(lambda tau: arrange(given(tau)))
    arranged = arrange(given)
    return lambda tau: arranged


def evolve(
    grid: Grid,
    values: FloatArray,
    velocities: Velocities | Callable[[float], Velocities],
    duration: float,
    scheme: Scheme,
    *,
    obstacle: FloatArray | Callable[[float], FloatArray] | None = None,
    steps: int | None = None,
) -> FloatArray:
    """Solve d Phi / d tau = H(tau, x, D Phi) from Phi(0) = values (*shape) on, up to tau = duration: (*shape), new.

    At every stage Phi is kept at least as high as the `obstacle`, -g for an avoid game (App. A.3) and, on a padding, at
    most `most_on_padding`. Velocities and obstacle may be functions of tau, s, which counts back from the interval's
    end; then `steps` have to be given, else the CFL condition says how many.
    """
    if steps is None:
        if callable(velocities):
            raise ValueError("velocities that depend on time need steps: as many as the fastest of them require")
        steps = velocities.steps(grid, duration, scheme.cfl)
    layout, dt, none = layout_of(grid, scheme.order), duration / max(steps, 1), np.empty((0,) * grid.ndim, scheme.dtype)

    def arranged(g: Any) -> FloatArray:
        return none if g is None else _with_ghosts(grid, layout, out_of_danger(grid, np.asarray(g)), scheme.dtype)

    terms = _over_time(velocities, lambda one: terms_of(grid, layout, one, scheme.dtype))
    phi, obstacle_at = arranged(values), _over_time(obstacle, arranged)
    order, flux = choice(DIFFERENCES, scheme.order), choice(HAMILTONIANS, scheme.flux)
    # dt and keep are handed over in this type: as Python's floats they would make kernels compute in double precision
    kind, most = np.dtype(scheme.dtype).type, arranged(most_on_padding(grid))

    def euler(source: FloatArray, out: FloatArray, now: float, then: float, keep: float) -> None:
        # out = keep out + (1 - keep) (source + dt H(source, now)), >= the obstacle at `then`
        stage(source, out, obstacle_at(then), terms(now), order, flux, layout, kind(dt), kind(keep))
        if most.size:
            np.minimum(out, most, out=out)

    if obstacle is not None:
        np.maximum(phi, obstacle_at(0.0), out=phi)
    phi, free = _integrate(phi, np.empty_like(phi), euler, STAGES[scheme.integrator], steps, dt)
    # without ghost nodes, into what is free: fresh memory would cost a tenth of a solve
    out = free.ravel()[: grid.size].reshape(grid.shape)
    planes = phi.reshape(-1, layout.rows + 2 * layout.top, layout.width)
    rows, nodes = slice(layout.top, layout.top + layout.rows), slice(layout.ghosts, layout.ghosts + layout.nodes)
    out.reshape(-1, layout.rows, layout.nodes)[:] = planes[:, rows, nodes]
    return out


def evolve_with_early_end(
    grid: Grid,
    values: FloatArray,
    velocities: Any,
    duration: float,
    scheme: Scheme,
    early: float,
    *,
    obstacle: Any = None,
    steps: int | None = None,
) -> FloatArray:
    """Solve the equation of `evolve` where the adversary may stop up to `early` s before the end: (*shape), new.

    Phi = max over all durations from duration - early to duration. If `early` is not 0, velocities and obstacle may not
    depend on tau, and `steps` is ignored.
    """
    if early:  # stopping is worth `values`: until it is too late for that they are an obstacle
        stop = values if obstacle is None else np.maximum(values, obstacle)
        values = evolve(grid, values, velocities, early, scheme, obstacle=stop)
        duration, steps = duration - early, None
    return evolve(grid, values, velocities, duration, scheme, obstacle=obstacle, steps=steps)


def _integrate(
    phi: FloatArray,
    work: FloatArray,
    euler: Callable[..., None],
    stages: tuple[tuple[float, float], ...],
    steps: int,
    dt: float,
) -> tuple[FloatArray, FloatArray]:
    """Phi after `steps` time steps of dt by `stages`, and an array that is free: phi and work are both overwritten.

    euler(source, out, now, then, keep) writes out = keep out + (1 - keep) (an Euler step of `source` from time `now`);
    `then` is the result's time.
    """
    # Only "rk3" writes to it, whose second stage may overwrite neither its source nor phi, which the third one keeps.
    spare = np.empty_like(phi)  # what is never written takes no memory
    for step in range(steps):
        source, now = phi, step * dt
        for number, (keep, reached) in enumerate(stages, 1):
            out = phi if number == len(stages) > 1 else spare if source is work else work
            # `euler` reads from `out` what it keeps of the step's start
            if keep and out is not phi:
                np.copyto(out, phi)
            then = (step + reached) * dt
            euler(source, out, now, then, keep)
            source, now = out, then
        if source is not phi:
            phi, work = work, phi
    return phi, work
