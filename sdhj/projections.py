"""Games 2 and 3 on lower-dimensional subspaces (`method="projected"`; Sec. 5.1, App. A.4 and A.5).

A subspace keeps some axes and drops the others. The dropped coordinates w act as a disturbance that may take any value
on their axes at any time, so what holds in the subspace holds in the whole space for every w:

* The set S to be reached is projected from the inside: x is in it where (x, w) is in S for all w,
  s_p(x) = max over w of s(x, w).
* An unsafe set G is projected from the outside: x is in it where (x, w) is in G for some w,
  g_p(x) = min over w of g(x, w).
* Where the velocity of the kept axes depends on w, the Hamiltonian takes the supremum over w as well.

On the grid w runs over the nodes of its axes, which gives the extremes of the linear interpolant; what a function does
between nodes is a matter of the spacing, as everywhere on a grid.

A solution on the subspace, constant along the dropped axes, is its back-projection. Each subspace gives a reach set
and an avoid tube inside the true ones, so their union over the subspaces, the minimum of the level-set functions, is
inside as well, and larger than any of them. The last display of App. A.5 prints an intersection of complements: that
is inside too, but smaller than each. (The complement of the union is the intersection of the over-approximations of
what is unsafe.)

The tubes S_k^i live on the whole grid; the recursion projects them anew at each step. An unsafe set that depends only
on axes that one subspace keeps needs no projection and is solved on its own axes, exactly as in the full method.
"""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba import get_num_threads, njit, prange, set_num_threads

from sdhj.games import HJISolver, LaxSolver, Solver, avoid_axes, sampled_velocities, unsafe_values, velocities
from sdhj.grid import FloatArray, Grid
from sdhj.problem import Dynamics, ReachAvoidProblem, TargetSet, UnsafeSet
from sdhj.schemes import Scheme, Velocities
from sdhj.table import AvoidTubes, LookupTable

INNER = ("hji", "lax")
SMALL = 2**16  # nodes of a subspace
Axes = tuple[int, ...]


class ProjectionWarning(UserWarning):
    """A collection of subspaces with which the projected method finds little or nothing."""


# --------------------------------------------------------------------------------------------------------------------
# Which subspaces, and what becomes of the problem on one
# --------------------------------------------------------------------------------------------------------------------


def default_subspaces(problem: ReachAvoidProblem) -> tuple[Axes, ...]:
    """Drop, one at a time, each axis that no input drives; where there is none, each axis.

    What the inputs drive has to stay, or nothing can be steered to the target. In the case studies this drops py, then
    px: the paper's two subspaces.
    """
    ndim, everything = problem.grid.ndim, tuple(range(problem.grid.ndim))
    if ndim == 1:
        raise ValueError('method="projected" needs a grid of at least 2 axes, one to drop; use method="hji"')
    driven = driven_axes(problem)
    dropped = [axis for axis in reversed(everything) if not driven[axis]] or list(reversed(everything))
    return tuple(tuple(axis for axis in everything if axis != drop) for drop in dropped)


def driven_axes(problem: ReachAvoidProblem) -> FloatArray:
    """Whether the choice of the input changes the velocity along each axis; (ndim,) bool."""
    dynamics, count = problem.dynamics, len(problem.inputs)
    points = np.zeros((1, problem.grid.ndim)) if dynamics.constant else problem.grid.points()
    first = dynamics.drift_at(points, 0)
    return np.any([(dynamics.drift_at(points, j) != first).any(axis=0) for j in range(count)], axis=0)


def checked_subspaces(problem: ReachAvoidProblem, subspaces: Sequence[Sequence[int]] | None) -> tuple[Axes, ...]:
    """The collection of subspaces as tuples of ascending axes.

    Raises
    ------
    ValueError
        Where it is empty or no collection, or one of them is not made of distinct axes of the grid, or comes twice.
    """
    if subspaces is None:
        return default_subspaces(problem)
    ndim = problem.grid.ndim
    whole = all(
        isinstance(axes, Sequence | np.ndarray) and all(isinstance(axis, int | np.integer) for axis in axes)
        for axes in (subspaces if isinstance(subspaces, Sequence | np.ndarray) else [None])
    )
    if not whole or any(isinstance(axis, bool | np.bool_) for axes in subspaces for axis in axes):
        raise ValueError(
            "subspaces must be a sequence of sequences of axes, which are whole numbers, for example "
            f"[(0, 1, 2), (0, 1, 3)], got {subspaces!r}"
        )
    chosen = [tuple(sorted(int(axis) for axis in axes)) for axes in subspaces]
    for axes in chosen:
        if not axes or len(set(axes)) < len(axes) or not set(axes) <= set(range(ndim)):
            raise ValueError(f"a subspace must be distinct axes of the grid (0 to {ndim - 1}), got {axes}")
    if not chosen or len(set(chosen)) < len(chosen):
        raise ValueError(f"subspaces must be one or more different sets of axes, got {subspaces}")
    return tuple(chosen)


def _embed(points: FloatArray, axes: Axes, others: FloatArray) -> FloatArray:
    """Full states (M, ndim) from coordinates (M, len(axes)) on the kept axes; `others` (ndim,) gives the rest."""
    full = np.tile(others, (len(points), 1))
    full[:, axes] = points
    return full


def subproblem(problem: ReachAvoidProblem, axes: Axes) -> ReachAvoidProblem:
    """The robot on some axes alone, with no target or unsafe set of its own.

    The dropped coordinates stand at the lower end of their axes wherever the dynamics read them, which is right where
    they do not enter the dynamics of the kept ones.
    """
    dynamics, keep = problem.dynamics, list(axes)
    f, b = dynamics.drift, dynamics.gain

    def embed(points: FloatArray) -> FloatArray:
        full = np.tile(problem.grid.lower, (len(points), 1))
        full[:, keep] = points
        return full

    return ReachAvoidProblem(
        grid=problem.grid.subgrid(axes),
        dynamics=Dynamics(
            inputs=problem.inputs,
            drift=(lambda points, u: f(embed(points), u)[:, keep]) if callable(f) else f[:, keep],
            gain=(lambda points: b(embed(points))[:, keep]) if callable(b) else b[keep],
            bounds=dynamics.bounds,
        ),
        target=TargetSet((0,), lambda points, t: np.full(len(points), -1.0), "everything"),
        unsafe=(),
        delta=problem.delta,
        steps=problem.steps,
        view_time=problem.view_time,
        name=f"{problem.name} on {', '.join(problem.grid.names[axis] for axis in axes)}",
    )


def disturbed_velocities(problem: ReachAvoidProblem, j: int, axes: Axes) -> Velocities:
    """The velocity set under u_j on a subspace, the dropped coordinates ranging over all their nodes (App. A.4).

    Each value w of the dropped coordinates that enter the dynamics is one mode: H = max over w. Where w moves the
    velocity of one kept axis at most and the adversary does not couple axes, the hull of the modes' boxes has the same
    H: it is again a box, cheaper and with the sharper flux.
    """
    alone = velocities(problem, j, axes)
    if alone is not None:
        return alone
    grid, keep = problem.grid, list(axes)
    field = sampled_velocities(problem, j, keep)
    dropped = [axis for axis in range(grid.ndim) if axis not in axes]
    for axis in dropped:  # a coordinate that does not enter needs no samples
        first = field.take([0], axis=2 + axis)
        if np.array_equal(np.broadcast_to(first, field.shape), field):
            field = first
    field = np.moveaxis(field, [2 + axis for axis in dropped], range(len(dropped)))
    field = field.reshape(-1, *field.shape[len(dropped) :])
    f, b = field[:, :, 0], field[:, :, 1:]
    spread = np.abs(b).sum(axis=2)
    lower, upper = f - spread, f + spread
    hull = lower.min(axis=0), upper.max(axis=0)
    moved = sum(bool((lower[:, i] != hull[0][i]).any() or (upper[:, i] != hull[1][i]).any()) for i in range(len(keep)))
    coupled = (np.count_nonzero(b.any(axis=(0, *range(3, b.ndim))), axis=0) > 1).any()
    return Velocities(*hull) if moved <= 1 and not coupled else Velocities(*hull, drift=f, gain=b)


# --------------------------------------------------------------------------------------------------------------------
# The games on the subspaces
# --------------------------------------------------------------------------------------------------------------------


class DisturbedSolver(HJISolver):
    """The games on one subspace where dropped coordinates enter the dynamics.

    It reads the velocities from the whole problem and everything else from the subproblem.
    """

    def __init__(self, problem: ReachAvoidProblem, axes: Axes, scheme: Scheme) -> None:
        super().__init__(subproblem(problem, axes), scheme)
        self.whole, self.axes = problem, axes
        self._boxes: dict[int, Velocities] = {}

    def field(self, j: int, axes: Sequence[int], drift: bool = True) -> Velocities:
        """As `HJISolver.field`, for all axes of the subspace and with the drift.

        Boxes are kept, being small; modes, which take as much as the whole grid, are sampled anew.
        """
        if j in self._boxes:
            return self._boxes[j]
        field = disturbed_velocities(self.whole, j, self.axes)
        if not field.coupled:
            self._boxes[j] = field
        return field


class ProjectedSolver:
    """Games 2 and 3 on a collection of subspaces, back-projected and united (`method="projected"`).

    Parameters
    ----------
    problem : ReachAvoidProblem
    scheme : Scheme
    subspaces : sequence of sequence of int, optional
        The axes that each subspace keeps; see `default_subspaces`.
    inner : {"hji", "lax"}
        How the games are solved on them: finite differences or the Hopf-Lax formula.
    interpolation : {"limited", "linear"}
        For "lax".

    Raises
    ------
    ValueError
        Where a subspace or an option does not fit.
    """

    def __init__(
        self,
        problem: ReachAvoidProblem,
        scheme: Scheme,
        subspaces: Sequence[Sequence[int]] | None = None,
        *,
        inner: str = "hji",
        interpolation: str = "limited",
    ) -> None:
        if inner not in INNER:
            raise ValueError(f"inner must be one of {', '.join(INNER)}, got {inner!r}")
        self.problem, self.scheme, self.dtype = problem, scheme, scheme.dtype
        self.subspaces = checked_subspaces(problem, subspaces)
        self.inner, self.interpolation = inner, interpolation
        self._solvers: dict[Axes, Solver] = {}
        # by place in problem.unsafe: the largest share of a subspace that the set's outer projection leaves free
        self._free: dict[int, float] = {}
        self._sampled: dict[tuple[float, float], dict[Axes, FloatArray]] = {}

    @property
    def solved(self) -> int:
        """PDEs so far, on all subspaces."""
        return sum(solver.solved for solver in self._solvers.values())

    def solver(self, axes: Axes) -> Solver:
        """The solver of the games on the subspace of some axes."""
        if axes not in self._solvers:
            self._solvers[axes] = self._make_solver(axes)
        return self._solvers[axes]

    def _make_solver(self, axes: Axes) -> Solver:
        problem = self.problem
        whole = len(axes) == problem.grid.ndim
        reduced = problem if whole else subproblem(problem, axes)
        if self.inner == "lax":
            return LaxSolver(reduced, self.interpolation, self.dtype)
        autonomous = whole or problem.dynamics.constant
        if autonomous or all(velocities(problem, j, axes) is not None for j in range(len(problem.inputs))):
            return HJISolver(reduced, self.scheme)
        return DisturbedSolver(problem, axes, self.scheme)

    # -- game 3 ------------------------------------------------------------------------------------------------------

    def inner_projection(self, values: FloatArray, axes: Axes) -> FloatArray:
        """s_p(x) = max over the dropped coordinates of s(x, w), shape of the subgrid."""
        dropped = tuple(axis for axis in range(self.problem.grid.ndim) if axis not in axes)
        return values.max(axis=dropped)

    def reach_pieces(self, values: FloatArray, out: FloatArray | None = None) -> list[FloatArray]:
        """Phi_j(t_k) on each subspace for each input, each (L, *subgrid): views of `out` (L, sum of sizes) if given."""
        grids = [self.problem.grid.subgrid(axes) for axes in self.subspaces]
        ends = np.cumsum([grid.size for grid in grids])
        if out is None:
            out = np.empty((len(self.problem.inputs), ends[-1]), self.dtype)
        parts = np.split(out, ends[:-1], axis=1)
        for axes, grid, part in zip(self.subspaces, grids, parts, strict=True):
            with _threads_for(grid.size):
                for j, phi in self.solver(axes).reach(self.inner_projection(values, axes)):
                    part[j] = phi.ravel()
        return [part.reshape(-1, *grid.shape) for part, grid in zip(parts, grids, strict=True)]

    def reach(self, values: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        """As `HJISolver.reach`: on the whole grid, inside the true reach sets."""
        pieces = self.reach_pieces(values)
        for j in range(len(self.problem.inputs)):
            yield j, _unite(self.problem.grid, [piece[j] for piece in pieces], self.subspaces)

    # -- games 1 and 2 -----------------------------------------------------------------------------------------------

    def avoid(self, part: UnsafeSet, step: int) -> FloatArray:
        """As `HJISolver.avoid`: inside the true avoid tubes, shape (L, *subgrid of avoid_axes)."""
        problem, count = self.problem, len(self.problem.inputs)
        axes = avoid_axes(problem, part)
        if any(set(axes) <= set(subspace) for subspace in self.subspaces):
            with _threads_for(problem.grid.subgrid(axes).size):
                return self.solver(tuple(range(problem.grid.ndim))).avoid(part, step)
        kept, grid = self._kept(axes), problem.grid.subgrid(axes)
        self._sampled.clear()  # of an earlier step
        if not kept:  # all that this set depends on was dropped: it is everywhere, or nowhere
            g = unsafe_values(problem, part, axes, problem.time(step), problem.time(step + 1), problem.view_time)
            self._note_free(part, float(g.min() > 0))
            return np.full((count, *grid.shape), -g.min(), self.dtype)
        tubes = []
        for keep in kept:
            with _threads_for(problem.grid.subgrid(keep).size):
                tubes.append(self.solver(keep).avoid(self._outer_projection(part, axes, keep), step))
        local = [tuple(axes.index(axis) for axis in keep) for keep in kept]
        return np.stack([_unite(grid, [tube[j] for tube in tubes], local) for j in range(count)])

    def _kept(self, axes: Axes) -> list[Axes]:
        """What the subspaces keep of some axes; what is part of another is left out, because it is only looser."""
        kept = [tuple(axis for axis in axes if axis in subspace) for subspace in self.subspaces]
        return [k for k in dict.fromkeys(kept) if k and not any(set(k) < set(other) for other in kept)]

    def _outer_projection(self, part: UnsafeSet, axes: Axes, keep: Axes) -> UnsafeSet:
        """g_p(x) = min over the dropped coordinates of g(x, w), as an unsafe set of the subproblem on `keep`."""
        grid = self.problem.grid.subgrid(keep)

        def projected(points: FloatArray, t0: float, t1: float) -> FloatArray:
            key = (t0, t1) if part.moving else (0.0, 0.0)
            if key not in self._sampled:  # sampled once for all subspaces
                self._sampled[key] = self._outer_projections(part, axes, t0, t1)
            return grid.interpolate(self._sampled[key][keep], points)

        return UnsafeSet(
            axes=tuple(range(len(keep))),
            level_set=lambda points, t: projected(points, t, t),
            swept=projected,
            rate=part.rate,
            name=part.name,
        )

    def _outer_projections(self, part: UnsafeSet, axes: Axes, t0: float, t1: float) -> dict[Axes, FloatArray]:
        """g_p at t0 = t1 or over [t0, t1] for each set of kept axes; notes how much of the space it leaves free."""
        local = [axes.index(axis) for axis in part.axes]

        def level_set(points: FloatArray) -> FloatArray:
            seen = points[:, local]
            return part.level_set(seen, t0) if t0 == t1 else part.over(seen, t0, t1, "swept")

        g = self.problem.sample(axes, level_set, part.name)
        projected = {}
        for keep in self._kept(axes):
            projected[keep] = g.min(axis=tuple(i for i, axis in enumerate(axes) if axis not in keep))
            self._note_free(part, self.problem.grid.subgrid(keep).fraction(projected[keep] > 0))
        return projected

    def _note_free(self, part: UnsafeSet, share: float) -> None:
        place = next(i for i, known in enumerate(self.problem.unsafe) if known is part)
        self._free[place] = max(share, self._free.get(place, 0.0))

    def _name(self, place: int) -> str:
        """The name of an unsafe set; of several with one name, its place too."""
        names = [part.name for part in self.problem.unsafe]
        return (
            names[place] if names.count(names[place]) == 1 else f"{names[place]}, number {place + 1} of problem.unsafe"
        )

    # -- the recursion -----------------------------------------------------------------------------------------------

    def add_row(self, table: LookupTable, avoid: AvoidTubes, step: int) -> None:
        """Fill the tubes and masks of `step` for every number of steps to go, from those of the next step.

        What `reach` and the recursion do together, without ever holding a reach set on the whole grid.
        """
        grid, most = self.problem.grid, self.problem.steps - step
        size = sum(grid.subgrid(axes).size for axes in self.subspaces)
        reach = np.empty((most, len(self.problem.inputs), size), self.dtype)
        for n in range(most):
            self.reach_pieces(table.value_array(step + 1, n), reach[n])
        static, moving = (tubes.reshape(len(tubes), -1) for tubes in (avoid.static, avoid.moving[step]))
        if step == self.problem.steps - 1:  # the first row to be filled
            self._static_bits = pack(static[None])[0]
        starts, along = _layout(grid, self.subspaces)
        first, rows = table.index[table.entry(step, 0)], (-1, grid.shape[-1])
        unite_row(
            table.tubes[first : first + most + 1].reshape(most + 1, *rows),
            table.masks[first : first + most + 1].reshape(most + 1, table.masks.shape[1], *rows),
            (reach, pack(reach)),
            starts[~along],
            starts[along],
            (static, moving, self._static_bits, pack(moving[None])[0]),
            *_layout(grid, (avoid.static_axes, avoid.moving_axes), apart=True),
        )

    @property
    def options(self) -> dict[str, Any]:
        """What was chosen, for the table's details."""
        chosen = {"subspaces": [list(axes) for axes in self.subspaces], "inner": self.inner}
        return chosen | ({"interpolation": self.interpolation} if self.inner == "lax" else {})

    def diagnose(self, table: LookupTable) -> dict[str, Any]:
        """How much the projections cost, for the table's details; warns where they leave little or nothing.

        Returns
        -------
        dict
            "target_kept": for each subspace, how much of the volume of the safe target survives the inner projection
            (a share; the largest over the steps). "free": for each unsafe set that had to be projected, the largest
            share of a subspace outside its outer projection. "warnings": sentences.
        """
        kept = [
            max(self._share_kept(table.value_array(k, 0), axes) for k in range(table.steps + 1))
            for axes in self.subspaces
        ]
        free = {self._name(place): share for place, share in sorted(self._free.items())}
        found = self._findings(table, kept, free)
        for sentence in found:
            warnings.warn(sentence, ProjectionWarning, stacklevel=3)
        return {"target_kept": kept, "free": free, "warnings": found}

    def _share_kept(self, goal: FloatArray, axes: Axes) -> float:
        grid = self.problem.grid
        whole = grid.fraction(goal <= 0)
        return grid.subgrid(axes).fraction(self.inner_projection(goal, axes) <= 0) / whole if whole > 0 else 0.0

    def _findings(self, table: LookupTable, kept: Sequence[float], free: Mapping[str, float]) -> list[str]:
        problem, names = self.problem, self.problem.grid.names
        found = []
        for axes, share in zip(self.subspaces, kept, strict=True):
            dropped = [axis for axis in range(problem.grid.ndim) if axis not in axes]
            if share == 0.0:
                lost = [axis for axis in dropped if axis in problem.target.axes]
                cause = (
                    f"the target depends on {_listed(names, lost)}"
                    if lost
                    else f"everywhere in the target some value of {_listed(names, dropped)} is unsafe"
                )
                found.append(
                    f"dropping {_listed(names, dropped)} leaves nothing of the target: the projected target has to be "
                    f"reached for every value of what was dropped, but {cause}; keep it, or use method='hji'"
                )
        for name, share in free.items():
            if share == 0.0:
                found.append(
                    f"the outer projection of the unsafe set {name!r} fills every subspace: everywhere some value of "
                    "what was dropped is unsafe, so no input counts as safe; keep more of the axes it depends on"
                )
        within = {n: table.fraction(start=0, within=n) for n in (0, table.steps)}
        if not found and within[0] == within[table.steps]:
            found.append("the projected tubes never grow beyond the target: these subspaces are too conservative here")
        return found


@contextmanager
def _threads_for(size: int) -> Iterator[None]:
    """One thread for kernels on few nodes: sharing them out costs more than it saves, most of all on a busy machine."""
    before = get_num_threads()
    if size < SMALL:
        set_num_threads(1)
    try:
        yield
    finally:
        set_num_threads(before)


def _listed(names: Sequence[str], axes: Sequence[int]) -> str:
    return " and ".join(names[axis] for axis in axes)


def _unite(grid: Grid, pieces: Sequence[FloatArray], axes: Sequence[Axes]) -> FloatArray:
    """Back-project functions on subspaces and unite their sets: the minimum, on the whole of `grid`."""
    total = grid.lift(pieces[0], axes[0])
    for piece, keep in zip(pieces[1:], axes[1:], strict=True):
        total = np.minimum(total, grid.lift(piece, keep))
    return np.ascontiguousarray(np.broadcast_to(total, grid.shape))


def _layout(grid: Grid, collection: Sequence[Axes], *, apart: bool = False) -> tuple[FloatArray, FloatArray]:
    """Where the rows of the grid, along its last axis, find their values in flat functions on subspaces.

    Returns
    -------
    starts : (subspaces, rows) int64
        Where each row begins, the functions lying one behind the other or, with `apart`, each on its own.
    along : (subspaces,) bool
        Whether the function varies along a row; where it does not, it has one value for the whole row.
    """
    starts, offset = [], 0
    for axes in collection:
        size = grid.subgrid(axes).size if axes else 1
        places = np.broadcast_to(grid.lift(np.arange(offset, offset + size), axes), grid.shape)
        starts.append(places[..., 0].ravel())
        offset += 0 if apart else size
    return np.stack(starts), np.array([grid.ndim - 1 in axes for axes in collection])


@njit(cache=True, parallel=True)
def pack(values):
    """Which of the L functions are <= 0: (n, L, size) to (n, ceil(L / 8), size) uint8, bit j % 8 of byte j // 8."""
    steps, count, size = values.shape
    out = np.zeros((steps, (count + 7) // 8, size), np.uint8)
    chunk = 1024
    blocks = (size + chunk - 1) // chunk
    for task in prange(steps * blocks):
        n = np.int64(task) // blocks
        start = (np.int64(task) - n * blocks) * chunk
        stop = min(start + chunk, size)
        for j in range(count):
            bit = np.uint8(1 << j % 8)
            bits, row = out[n, j // 8], values[n, j]
            for i in range(start, stop):
                bits[i] |= bit if row[i] <= 0.0 else np.uint8(0)
    return out


@njit(cache=True, inline="always")
def _smaller(a, b):
    return a if a < b else b


@njit(cache=True, inline="always")
def _larger(a, b):
    return a if a > b else b


@njit(cache=True, parallel=True)
def unite_row(tubes, masks, reach, flat, varied, walls, wall_starts, wall_along):
    """Back-projection, union, intersection with the avoid tubes and union over the inputs, in one pass.

    tubes : (n + 1, rows, width), the first filled in; the others are written.
    masks : (n + 1, bytes, rows, width) uint8; all but the first are written.
    reach : values (n, L, size) of the reach sets on all subspaces, one behind the other, and their bits (see `pack`).
    flat, varied : (subspaces, rows), where each row begins in the subspaces in which its value stays the same, and in
    those in which it varies.
    walls : the static avoid tubes (L, any size), the moving ones (L, any size), and the bits of both; wall_starts
    (2, rows) and wall_along (2,) say where a row begins and whether its values vary along it.
    """
    values, bits = reach
    static, moving, static_bits, moving_bits = walls
    steps, count = values.shape[0], values.shape[1]
    rows, width = tubes.shape[1], np.uint64(tubes.shape[2])  # unsigned: negative indices would have to be wrapped
    infinity = tubes.dtype.type(np.inf)
    along0, along1 = np.uint64(wall_along[0]), np.uint64(wall_along[1])
    blocks = min(rows, 64)
    for block in prange(blocks):
        wall = np.empty((count, width), tubes.dtype)
        row = np.empty(width, tubes.dtype)
        best = np.empty(width, tubes.dtype)
        safe = np.empty((masks.shape[1], width), np.uint8)
        for r in range(np.int64(block) * rows // blocks, (np.int64(block) + 1) * rows // blocks):
            o0, o1 = np.uint64(wall_starts[0, r]), np.uint64(wall_starts[1, r])
            for j in range(count):
                if along0 == 1 and along1 == 0:  # the common case, written out because it vectorises
                    constant = moving[j, o1]
                    for i in range(width):
                        wall[j, i] = _larger(static[j, o0 + i], constant)
                else:
                    for i in range(width):
                        wall[j, i] = _larger(static[j, o0 + i * along0], moving[j, o1 + i * along1])
            for b in range(masks.shape[1]):
                for i in range(width):
                    safe[b, i] = static_bits[b, o0 + i * along0] & moving_bits[b, o1 + i * along1]
            for i in range(width):
                best[i] = tubes[0, r, i]
            for n in range(steps):
                for j in range(count):
                    constant = infinity
                    for s in range(flat.shape[0]):
                        constant = _smaller(values[n, j, flat[s, r]], constant)
                    if varied.shape[0] == 1:  # likewise
                        o = np.uint64(varied[0, r])
                        for i in range(width):
                            best[i] = _smaller(best[i], _larger(_smaller(values[n, j, o + i], constant), wall[j, i]))
                    else:
                        row[:] = constant
                        for s in range(varied.shape[0]):
                            o = np.uint64(varied[s, r])
                            for i in range(width):
                                row[i] = _smaller(row[i], values[n, j, o + i])
                        for i in range(width):
                            best[i] = _smaller(best[i], _larger(row[i], wall[j, i]))
                for i in range(width):
                    tubes[n + 1, r, i] = best[i]
                for b in range(masks.shape[1]):  # the same on packed bits: min is or, max is and
                    some = np.uint8(0)
                    for s in range(flat.shape[0]):
                        some |= bits[n, b, flat[s, r]]
                    for i in range(width):
                        masks[n + 1, b, r, i] = some
                    for s in range(varied.shape[0]):
                        o = np.uint64(varied[s, r])
                        for i in range(width):
                            masks[n + 1, b, r, i] |= bits[n, b, o + i]
                    for i in range(width):
                        masks[n + 1, b, r, i] &= safe[b, i]
