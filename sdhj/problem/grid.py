"""Grids, at whose nodes level-set functions are sampled.

A set is the zero sublevel set of its function (Definition 5), which is negative inside. A union is the minimum of the
functions, an intersection the maximum, a complement the negative.
"""

import math
import reprlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from sdhj.common.checks import number, points_array, sequence, whole
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray, Remembering, kept, read_only
from sdhj.formulas.arrays import Traced
from sdhj.kernels.interpolation import SLACK, Lattice, interpolate, wrap
from sdhj.problem.ends import ENDS, Fate

MOST_EXTENT = 1e300  # of an end of an axis: its length is a number, and so is what is moved past it
MIN_NODES = 5  # the widest stencils use two nodes on each side
MAX_NODES = 10**9  # on an axis
MAX_AXES = 6
SMALL = 2**20  # nodes that always fit into memory
PIECE = 2**16  # nodes at which functions are sampled at a time: their intermediate results stay in the cache


@dataclass(frozen=True)
class Grid(Remembering):
    """A rectangular grid of 1 to 6 axes, one for each coordinate of the state.

    Parameters
    ----------
    lower, upper : sequence of float
        The ends of each axis, in the units of the state.
    shape : sequence of int
        Nodes on each axis, at least 5.
    periodic : sequence of bool, optional
        By default none. A periodic axis has no node at its upper end, which is the lower end again.
    ends : str, or sequence of str or of pairs of str, optional
        Of bounded axes: for all, for each, or for its lower and its upper end. "unsafe" (default): a state that leaves
        has failed. "wall": the state cannot pass and slides along. "safe": a state that leaves is out of danger for
        good (problems without a target only).
    names : sequence of str, optional
        Axis labels, for plots and files.

    Examples
    --------
    A position and an angle:

    >>> import numpy as np
    >>> import sdhj
    >>> grid = sdhj.Grid([0.0, -np.pi], [2.0, np.pi], [5, 8], periodic=[False, True])
    >>> grid.nodes(0)
    array([0. , 0.5, 1. , 1.5, 2. ])
    >>> values = grid.points()[:, 0].reshape(grid.shape)  # the position at each node
    >>> grid.interpolate(values, np.array([[0.75, 3.0], [9.0, 0.0]]))
    array([0.75,  inf])
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    shape: tuple[int, ...]
    periodic: tuple[bool, ...] = ()
    names: tuple[str, ...] = ()
    ends: tuple[tuple[str, str], ...] = ()
    ends_not_given: bool = field(default=False, init=False, repr=False, compare=False)  # neither `periodic` nor `ends`
    ndim: int = field(default=0, init=False, repr=False)  # number of axes
    size: int = field(default=0, init=False, repr=False)  # number of nodes; exact, however large
    # distance between neighbouring nodes on each axis: (upper - lower) / (n - 1), or / n where it is periodic
    spacing: tuple[float, ...] = field(default=(), init=False, repr=False)
    # nodes past both ends of each axis of the grid that this one was made `wider` than
    added: tuple[tuple[int, int], ...] = field(default=(), init=False, repr=False)

    def __init__(
        self,
        # in the order of `LAYOUT` in `sdhj.problem.describing`, in which `sdhj.load` gives these of a file
        lower: Sequence[float],
        upper: Sequence[float],
        shape: Sequence[int],
        periodic: Sequence[bool] | None = None,
        names: Sequence[str] | None = None,
        ends: str | Sequence[Any] | None = None,
        # the spacing, to the bit, and the nodes added, of a grid that goes past another one
        _past: tuple[Sequence[float], Sequence[Sequence[int]]] | None = None,
    ) -> None:
        ndim = len(sequence("shape", shape))
        if not 1 <= ndim <= MAX_AXES:
            raise ValueError(f"a grid has 1 to {MAX_AXES} axes, got {ndim}")
        # Who gave none is told where an axis seems to be an angle (`_angle_findings`).
        object.__setattr__(self, "ends_not_given", periodic is None and ends is None)
        periodic, ends = [False] * ndim if periodic is None else periodic, next(iter(ENDS)) if ends is None else ends
        names = [f"x{axis + 1}" for axis in range(ndim)] if names is None else names
        for label, given in (("lower", lower), ("upper", upper), ("periodic", periodic), ("names", names)):
            if len(sequence(label, given)) != ndim:
                raise ValueError(f"{label} has {len(given)} entries for a grid of {ndim} axes")
        for axis in range(ndim):
            low = number(f"lower[{axis}]", lower[axis], least=-MOST_EXTENT)
            number(f"upper[{axis}]", upper[axis], above=low, most=MOST_EXTENT)
            if not isinstance(periodic[axis], bool | np.bool_):
                raise ValueError(f"periodic[{axis}] must be True or False, got {reprlib.repr(periodic[axis])}")
        nodes = tuple(whole(f"shape[{axis}]", n, least=MIN_NODES, most=MAX_NODES) for axis, n in enumerate(shape))
        given = [ends] * ndim if isinstance(ends, str) else sequence("ends", ends)
        pairs = tuple((end, end) if isinstance(end, str) else tuple(sequence("ends", end)) for end in given)
        valid = all(len(pair) == 2 and all(isinstance(end, str) and end in ENDS for end in pair) for pair in pairs)
        if len(pairs) != ndim or not valid:
            shown = reprlib.repr(ends)
            raise ValueError(f"ends must be {', '.join(ENDS)} or a pair of them for each axis, got {shown}")
        checked: dict[str, Any] = {"lower": map(float, lower), "upper": map(float, upper), "shape": nodes}
        checked |= {"periodic": map(bool, periodic), "names": map(str, names), "ends": pairs}
        for name, values in checked.items():
            object.__setattr__(self, name, tuple(values))
        each = zip(self.lower, self.upper, self.shape, self.periodic, strict=True)
        # a file has no spacing: `sdhj.load` and the checker work it out from the ends and the number of nodes again
        own = [(high - low) / (n if turns else n - 1) for low, high, n, turns in each]
        spacing, added = (own, [(0, 0)] * ndim) if _past is None else _past
        object.__setattr__(self, "ndim", ndim)
        object.__setattr__(self, "size", math.prod(nodes))
        object.__setattr__(self, "spacing", tuple(spacing))
        object.__setattr__(self, "added", tuple((int(low), int(high)) for low, high in added))

    @property
    def sampling_bytes(self) -> int:
        """Bytes to sample a function in `pieces`."""
        # asked by `check_sensing` and `bytes_of_solve`: room for a piece, and three float64 copies of the values
        return 8 * ((2 * self.ndim + 5) * min(self.size, PIECE) + 3 * self.size)

    def nodes(self, axis: int) -> FloatArray:
        """Coordinates of the nodes on one axis, in its unit: (shape[axis],).

        IndexError if the grid has no such axis.

        Examples
        --------
        >>> import sdhj
        >>> sdhj.Grid([-1.0], [1.0], [5]).nodes(0)
        array([-1. , -0.5,  0. ,  0.5,  1. ])
        """
        return self.lower[axis] + self.spacing[axis] * np.arange(self.shape[axis])

    def points(self) -> FloatArray:
        """Coordinates of all nodes, (size, ndim) float64 in the axes' units, the last axis varying fastest.

        MemoryError if they do not fit into memory together with some arrays of the same size.

        Examples
        --------
        >>> import sdhj
        >>> sdhj.Grid([0.0, 0.0], [4.0, 8.0], [5, 5]).points()[:6].tolist()
        [[0.0, 0.0], [0.0, 2.0], [0.0, 4.0], [0.0, 6.0], [0.0, 8.0], [1.0, 0.0]]
        """
        if self.size > SMALL:
            what = f"a list of the nodes of {' x '.join(map(str, self.shape))}"
            require_memory(8 * (2 * self.ndim + 5) * self.size, what)
        return np.concatenate([*self.pieces()])

    def wider(self, by: Sequence[Sequence[int]], ends: Sequence[Any] | str = "wall") -> "Grid":
        """The grid with by[axis] = (before, behind) more nodes on each bounded axis, at the same spacing to the bit."""
        past, nodes = np.array(by).T * self.spacing, (np.sum(by, axis=1) + self.shape).tolist()
        lower, upper = (self.lower - past[0]).tolist(), (self.upper + past[1]).tolist()
        added = np.array(self.added) + by
        return Grid(lower, upper, nodes, self.periodic, self.names, ends, _past=(self.spacing, added.tolist()))

    @property
    def piece_shape(self) -> tuple[int, tuple[int, ...]]:
        """How many nodes of one axis are in a piece, and how many pieces are along that axis and those before it."""
        axis = next(axis for axis in range(self.ndim) if math.prod(self.shape[axis + 1 :]) <= PIECE)
        # `try_goals` draws pieces by their numbers, as `pieces` counts them: along the last of these axes fastest
        some = PIECE // math.prod(self.shape[axis + 1 :])
        return some, (*self.shape[:axis], -(-self.shape[axis] // some))

    def pieces(self, order: Iterable[int] | None = None) -> Iterator[FloatArray]:
        """Yield the nodes' points, at most `PIECE` at a time, (M, ndim): all pieces, or those in `order`."""
        some, places = self.piece_shape
        for which in range(math.prod(places)) if order is None else order:
            rest, at = int(which), list[int]()
            for n in reversed(places):  # NumPy's own refuses more places than 64 bits count
                rest, own = divmod(rest, n)
                at.insert(0, own)
            *rows, place = at
            cut = [slice(row, row + 1) for row in rows] + [slice(place * some, (place + 1) * some)]
            lines = [self.nodes(axis)[cut[axis] if axis < len(cut) else slice(None)] for axis in range(self.ndim)]
            points = np.empty((*map(len, lines), self.ndim))
            for axis, line in enumerate(lines):
                points[..., axis] = line.reshape([-1 if axis == k else 1 for k in range(self.ndim)])
            yield points.reshape(-1, self.ndim)

    def subgrid(self, axes: Sequence[int]) -> "Grid":
        """The grid of some axes only, numbered from 0, in the order given: the projection of this grid (App. A.4).

        IndexError if the grid has not all of them.

        Examples
        --------
        >>> import sdhj
        >>> sdhj.Grid([0.0, -1.0], [1.0, 1.0], [6, 5]).subgrid([1]).shape
        (5,)
        """
        # one object for the same axes, as what is found of a grid is remembered with it
        known: dict[tuple[int, ...], Grid] = self.remembered("subgrids", dict)
        if (key := tuple(axes)) not in known:
            each: tuple[Any, ...] = self.lower, self.upper, self.shape, self.periodic, self.names, self.ends
            past = [self.spacing[axis] for axis in axes], [self.added[axis] for axis in axes]
            lower, upper, shape, periodic, names, ends = ([one[axis] for axis in axes] for one in each)
            known[key] = Grid(lower, upper, shape, periodic, names, ends, past)
        return known[key]

    @property
    def padding(self) -> tuple[tuple[int, int], ...]:
        """How many nodes of each axis lie past its lower and its upper safe end, ((low, high), ...)."""
        frees = self.ends_where("frees").T
        return tuple((low * bool(a), high * bool(b)) for (low, high), (a, b) in zip(self.added, frees, strict=True))

    @property
    def inner(self) -> tuple[slice, ...]:
        """Index, a slice for each axis, of the nodes that are not part of the `padding`."""
        return tuple(slice(low, n - high) for n, (low, high) in zip(self.shape, self.padding, strict=True))

    def edges(self, values: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
        """Values at the first and at the second node of every edge between neighbours along an axis."""
        if self.periodic[axis]:
            return values, np.roll(values, -1, axis)
        behind = (slice(None),) * axis
        return values[(*behind, slice(0, -1))], values[(*behind, slice(1, None))]

    def lift(self, values: FloatArray, axes: Sequence[int]) -> FloatArray:
        """View `values` on `subgrid(axes)`, axes ascending, with one node on every other axis (back-projection).

        Examples
        --------
        >>> import sdhj
        >>> grid = sdhj.Grid([0.0, -1.0], [1.0, 1.0], [6, 5])
        >>> grid.lift(grid.nodes(1), [1]).shape
        (1, 5)
        """
        return values.reshape([n if axis in axes else 1 for axis, n in enumerate(self.shape)])

    def wrapped(self, points: Any) -> Any:
        """Points (M, ndim), also traced, with periodic coordinates wrapped into [lower, upper); else the same array."""
        if not any(self.periodic):
            return points
        if isinstance(points, Traced):
            each = zip(points.T, self.lower, self.upper, self.periodic, strict=True)
            return np.stack([low + np.mod(x - low, high - low) if p else x for x, low, high, p in each], axis=1)
        # A copy, as `wrap` writes in place.
        points = np.array(points, dtype=np.float64, order="C")
        wrap(points, *self._ends)
        return points

    @kept
    def _ends(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lower ends, upper ends, and whether each axis is periodic (bool): (ndim,) each."""
        return np.array(self.lower), np.array(self.upper), np.array(self.periodic)

    def interpolate(self, values: FloatArray, points: FloatArray) -> FloatArray:
        """Interpolate values at the nodes (shape `grid.shape`) multilinearly at points (M, ndim): (M,) float64.

        Periodic axes are wrapped. For a point off the grid, or with a NaN, the result is +inf: in no set.

        Examples
        --------
        >>> import numpy as np
        >>> import sdhj
        >>> grid = sdhj.Grid([-1.0], [1.0], [5])
        >>> grid.interpolate(grid.nodes(0) ** 2, np.array([[0.25], [2.0]]))
        array([0.125,   inf])
        """
        flat = np.ascontiguousarray(values).reshape(1, self.size)
        flat.flags.writeable = False  # of all that comes: what may be written has another type, compiled anew
        return interpolate(flat, points_array("points", points, self.ndim), self.arrays)

    @kept
    def arrays(self) -> Lattice:
        """The grid as compiled code takes it, with `SLACK` cells added to its ends."""
        (least, most), (low, high) = self.faces("fails"), self.faces("frees")
        slack, shape = SLACK * np.array(self.spacing), np.array(self.shape, dtype=np.int64)
        ends = least - slack, most + slack, np.concatenate([low - slack, high + slack])
        # `tape_of_problem` packs these nine arrays in their order, and `unpacked_lattice` finds them by it
        nodes = np.array(self.lower), np.array(self.spacing), shape, np.array(self.periodic)
        return Lattice(*nodes, *ends, first=0 * shape, extent=shape)

    def ends_where(self, *fates: Fate) -> FloatArray:
        """Whether the lower and the upper end of each axis has one of these fates: (2, ndim)."""
        if fates not in (cache := self.remembered("ends", dict)):
            such = [[any(getattr(ENDS[end], fate) for fate in fates) for end in ends] for ends in self.ends]
            cache[fates] = read_only(np.array(such).T & ~np.array(self.periodic))
        return cache[fates]

    def faces(self, *fates: Fate) -> tuple[FloatArray, FloatArray]:
        """Coordinates of lower and upper ends with one of these fates, before the `padding`, or -+inf: (ndim,) each."""
        if fates not in (cache := self.remembered("faces", dict)):
            low, high = self.ends_where(*fates)
            past = np.array(self.padding).T * self.spacing
            # infinite elsewhere, so that nothing is ever past such an end
            low = np.where(low, self.lower + past[0], -np.inf)
            cache[fates] = read_only((low, np.where(high, self.upper - past[1], np.inf)))
        return cache[fates]

    def has(self, fate: Fate) -> bool:
        """Whether some bounded axis has an end with this fate."""
        return bool(self.ends_where(fate).any())

    def to_ends(self, fate: Fate) -> FloatArray:
        """Distance from each node to the nearest end with a fate, negative past it, or +inf; broadcasts."""
        out = np.full((1,) * self.ndim, np.inf)
        for axis, (low, high) in enumerate(zip(*self.faces(fate), strict=True)):
            nodes = self.nodes(axis)
            out = np.minimum(out, self.lift(np.minimum(nodes - low, high - nodes), (axis,)))
        return out

    @cached_property
    def walled(self) -> "Grid":
        """A grid with the same nodes, all of whose bounded ends are walls."""
        return self.wider([(0, 0)] * self.ndim)

    def clipped(self, states: Any, *fates: Fate) -> Any:
        """States (..., ndim), also traced, clipped at the ends with these fates, by default at walls."""
        low, high = self.faces(*(fates or ("holds",)))
        return np.minimum(np.maximum(states, low), high)

    def beyond(self, states: FloatArray, *fates: Fate) -> FloatArray:
        """Whether states (..., ndim) are past an end with one of these fates by more than `SLACK` cells: (...)."""
        # the slack is that of `arrays`, by which compiled look-ups judge
        (low, high), slack = self.faces(*fates), SLACK * np.array(self.spacing)
        return np.asarray(((states < low - slack) | (states > high + slack)).any(axis=-1))

    def shares(self, axis: int) -> FloatArray:
        """Share of an axis's length that each of its nodes represents: half a cell at bounded ends."""
        share = np.ones(self.shape[axis])
        if not self.periodic[axis]:
            share[[0, -1]] = 0.5
        return share / share.sum()

    def fraction(self, inside: FloatArray) -> float:
        """Share of the grid's volume, from 0 to 1, where `inside` (*shape) is true.

        Examples
        --------
        >>> import sdhj
        >>> grid = sdhj.Grid([-1.0], [1.0], [5])
        >>> grid.fraction(grid.nodes(0) > 0.4)
        0.375
        """
        if self.size > SMALL and self.ndim > 1:  # row by row, without the weights of all nodes
            rest = self.subgrid(range(1, self.ndim))
            return sum(share * rest.fraction(row) for share, row in zip(self.shares(0).tolist(), inside, strict=True))
        weights = np.ones(())
        for axis in range(self.ndim):
            weights = weights[..., None] * self.shares(axis)
        return float(np.sum(weights, where=inside))
