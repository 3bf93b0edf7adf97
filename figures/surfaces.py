"""Isosurfaces of tubes in three of the state's axes, for example (q1, q2, p_x) (Fig. 13)."""

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from sdhj.common.remembering import FloatArray
from sdhj.kernels.compiling import kernel
from sdhj.plotting.slices import QUARTER_LABELS, RIGHT_ANGLES, State
from sdhj.problem.grid import Grid
from sdhj.table.batches import Table

LIGHT = np.array([-0.45, -0.55, 0.70])  # towards the lamp, over the viewer's left shoulder
CAP = 1e-3  # share of a cell at which a set that leaves the box is closed


def _tetrahedra() -> FloatArray:
    """The six tetrahedra about one diagonal of a cube, (6, 4), corner c at offsets (c >> 2, c >> 1, c) & 1."""
    paths = []
    for order in permutations((4, 2, 1)):
        corner, path = 0, [0]
        for step in order:
            corner |= step
            path.append(corner)
        paths.append(path)
    return np.array(paths)


TETRAHEDRA = _tetrahedra()
# The edges that the surface cuts, in a ring, where the first one, two or three vertices of a tetrahedron are inside.
EDGES = np.array([[(0, 1), (0, 2), (0, 3), (0, 0)], [(0, 2), (0, 3), (1, 3), (1, 2)], [(0, 3), (1, 3), (2, 3), (0, 0)]])
CUT = np.array([0, 3, 4, 3, 0])  # how many there are


def isosurface(values: FloatArray, coordinates: Sequence[FloatArray]) -> FloatArray:
    """Triangles of the surface values = 0 by marching tetrahedra, (T, 3, 3), normals pointing out of {values <= 0}.

    Parameters
    ----------
    values : (X, Y, Z) array
        Linear between the corners of each tetrahedron; the surface is watertight inside the box.
    coordinates : three arrays (X,), (Y,), (Z,)
    """
    x, y, z = (np.asarray(c, dtype=np.float64) for c in coordinates)
    triangles = np.empty((2 * len(TETRAHEDRA) * values.size, 3, 3))  # what is not written takes no memory
    return triangles[: march(np.ascontiguousarray(values, np.float64), x, y, z, TETRAHEDRA, triangles)].copy()


@kernel()
def march(values: Any, x: Any, y: Any, z: Any, tetrahedra: Any, triangles: Any) -> int:
    """Write the triangles of all tetrahedra of all cells, and return how many there are."""
    count, points, at = 0, np.empty((4, 3)), np.empty(4)
    ring = np.empty((4, 3))
    for i in range(len(x) - 1):
        for j in range(len(y) - 1):
            for k in range(len(z) - 1):
                for t in range(len(tetrahedra)):
                    first, last = 0, 4  # vertices inside come first, those outside last
                    for corner in tetrahedra[t]:
                        a, b, c = i + (corner >> 2), j + (corner >> 1 & 1), k + (corner & 1)
                        if values[a, b, c] <= 0.0:
                            place, first = first, first + 1
                        else:
                            last -= 1
                            place = last
                        at[place], points[place] = values[a, b, c], (x[a], y[b], z[c])
                    for corner in range(CUT[first]):
                        inside, outside = EDGES[first - 1, corner]
                        share = at[inside] / (at[inside] - at[outside])
                        for d in range(3):
                            ring[corner, d] = points[inside, d] + share * (points[outside, d] - points[inside, d])
                    for one in range(CUT[first] - 2):  # triangles from the ring's first corner
                        outwards = 0.0
                        for d in range(3):
                            e, f = (d + 1) % 3, (d + 2) % 3
                            normal = (ring[one + 1, e] - ring[0, e]) * (ring[one + 2, f] - ring[0, f])
                            normal -= (ring[one + 1, f] - ring[0, f]) * (ring[one + 2, e] - ring[0, e])
                            outwards += normal * (points[3, d] - points[0, d])
                        b, c = (one + 1, one + 2) if outwards >= 0.0 else (one + 2, one + 1)
                        for d in range(3):
                            triangles[count, 0, d] = ring[0, d]
                            triangles[count, 1, d], triangles[count, 2, d] = ring[b, d], ring[c, d]
                        count += 1
    return count


def normals(triangles: FloatArray) -> FloatArray:
    """Normals (T, 3) of triangles (T, 3, 3), as long as twice their area."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def block(grid: Grid, values: FloatArray, axes: Sequence[int], through: State) -> tuple[FloatArray, list[FloatArray]]:
    """Values on the nodes of three axes through a state, periodic axes closed, in a box whose sides are all outside.

    Returns the values (X, Y, Z) and the coordinates of its three axes. The added sides close sets that leave the box.
    """
    coordinates = [
        np.append(grid.nodes(axis), grid.upper[axis]) if grid.periodic[axis] else grid.nodes(axis) for axis in axes
    ]
    mesh = np.meshgrid(*coordinates, indexing="ij")
    points = np.tile(np.asarray(through, dtype=np.float64), (mesh[0].size, 1))
    points[:, list(axes)] = np.stack([m.ravel() for m in mesh], axis=1)
    inner = grid.interpolate(values, points).reshape(mesh[0].shape)
    padded = np.pad(inner, 1, constant_values=max(1.0, float(np.abs(inner).max())))
    widened = []
    for axis, c in zip(axes, coordinates, strict=True):
        gap = CAP * grid.spacing[axis]
        widened.append(np.concatenate([[c[0] - gap], c, [c[-1] + gap]]))
    return padded, widened


def draw_isosurface(
    ax: Any,
    table: Table,
    *,
    through: State,
    start: int = 0,
    within: int | None = None,
    axes: Sequence[int] = (0, 1, 2),
    colour: str = "#4c8fc4",
    alpha: float = 1.0,
    tube: FloatArray | None = None,
    gid: str = "surface",
) -> None:
    """The boundary of a tube in three axes, lit, on a 3-D axes; a bitmap inside vector files, to keep them small.

    Another set can take the tube's place: `tube` (grid.shape).
    """
    grid = table.grid
    within = table.steps - start if within is None else within
    tube = table.values(start=start, within=within) if tube is None else tube
    values, coordinates = block(grid, tube, axes, through)
    triangles = isosurface(values, coordinates)
    frame_block(ax, grid, axes)
    if not len(triangles):
        return
    scale = np.array([grid.upper[axis] - grid.lower[axis] for axis in axes])
    normal = normals(triangles / scale)
    length = np.linalg.norm(normal, axis=1)
    triangles, normal = triangles[length > 0], normal[length > 0] / length[length > 0, None]
    light = 0.55 + 0.45 * np.clip(normal @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    faces = np.concatenate([light[:, None] * np.array(to_rgb(colour)), np.full((len(light), 1), alpha)], axis=1)
    looks = {"edgecolors": "none", "linewidths": 0.0, "antialiased": False, "rasterized": True}
    surface = Poly3DCollection(triangles, facecolors=faces, **looks)
    surface.set_gid(gid)
    ax.add_collection3d(surface, autolim=False)


def frame_block(ax: Any, grid: Grid, axes: Sequence[int]) -> None:
    """Limits, ticks and labels of a 3-D axes."""
    for axis, name in zip(axes, "xyz", strict=True):
        low, high = grid.lower[axis], grid.upper[axis]
        getattr(ax, f"set_{name}lim")(low, high)
        unit = "rad" if grid.names[axis].startswith("q") else "m"
        symbol = f"${grid.names[axis][0]}_{grid.names[axis][1:]}$" if len(grid.names[axis]) == 2 else grid.names[axis]
        getattr(ax, f"set_{name}label")(f"{symbol} ({unit})", labelpad=-3 if name == "z" else -5)
        if grid.periodic[axis] and np.allclose((low, high), (-np.pi, np.pi)):
            first = 2 if name == "y" else 0  # two axes meet in one corner
            getattr(ax, f"set_{name}ticks")(RIGHT_ANGLES[first::2], QUARTER_LABELS[first::2])
        else:
            ax.locator_params(axis=name, nbins=4)
        ax.tick_params(axis=name, pad=-1 if name == "z" else -2)
    for side in (ax.xaxis, ax.yaxis, ax.zaxis):
        side.set_pane_color((1.0, 1.0, 1.0, 0.0))
    ax.grid(False)
    ax.view_init(elev=24, azim=-58)
    ax.set_proj_type("ortho")
    ax.set_box_aspect((1.0, 1.0, 0.8), zoom=0.86)
