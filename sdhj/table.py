"""The look-up table of Fig. 8: every S_k^i and which inputs are guaranteed where, in memory and on disk."""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import sdhj
from sdhj.checks import whole
from sdhj.files import replaced_whole
from sdhj.grid import FloatArray, Grid
from sdhj.problem import ReachAvoidProblem

FORMAT = "sdhj look-up table"
FORMAT_VERSION = 1
BLOCK = 1 << 24  # bytes by which a file grows in memory
CONVENTION = "a set is where its function is <= 0; union is min, intersection is max"


class TableFileError(ValueError):
    """A file that is not a whole look-up table of a known version."""


@dataclass(frozen=True)
class AvoidTubes:
    """Level-set functions of the avoid tubes (Definition 3), <= 0 where u_j is safe over the interval.

    static : (L, *subgrid of static_axes), the same for every step; moving : (steps, L, *subgrid of moving_axes).
    With no axes there is no such unsafe set and the values are -inf: safe everywhere.
    """

    static_axes: tuple[int, ...]
    static: FloatArray
    moving_axes: tuple[int, ...]
    moving: FloatArray

    def lifted(self, grid: Grid, step: int, j: int) -> FloatArray:
        """The tube of u_j over the interval from `step`, on the whole grid."""
        both = np.maximum(
            grid.lift(self.static[j], self.static_axes), grid.lift(self.moving[step, j], self.moving_axes)
        )
        return np.ascontiguousarray(np.broadcast_to(both, grid.shape))


def entry(steps: int, start: int, within: int) -> int:
    """Place of (start, within) in the stacked arrays: rows of Fig. 8 one after the other."""
    return start * (steps + 1) - start * (start - 1) // 2 + within


@dataclass(frozen=True)
class LookupTable:
    """Every reach-avoid tube S_k^i, with n = N - i steps to go written `within`, and the inputs that realise it.

    Made by `sdhj.solve` or `sdhj.load`. `details` says how it was computed.
    """

    problem: ReachAvoidProblem
    method: str
    tubes: FloatArray  # (entries, *grid.shape)
    masks: FloatArray  # (entries, bytes, size) uint8, bit j % 8 of byte j // 8 stands for u_j
    avoid: AvoidTubes
    details: Mapping[str, Any]

    def __repr__(self) -> str:
        return in_a_line(self)

    @classmethod
    def empty(
        cls, problem: ReachAvoidProblem, method: str, dtype: str, avoid: AvoidTubes
    ) -> "LookupTable":
        """A table with room for everything and nothing filled in."""
        entries = entry(problem.steps, problem.steps, 0) + 1
        tubes = np.empty((entries, *problem.grid.shape), dtype)
        masks = np.zeros((entries, -(-len(problem.inputs) // 8), problem.grid.size), np.uint8)
        return cls(problem, method, tubes, masks, avoid, {})

    @staticmethod
    def rooms(problem): return entry(problem.steps, problem.steps, 0) + 1
    def share(self, k, n):
        self.value_array(k, n)[:] = self.value_array(k, n-1)
        self.mask_array(k, n)[:] = self.mask_array(k, n-1)
    def finish(self, details):
        self.details.update(details)
        if self.problem.timeless:
            for k in range(1, self.steps+1):
                for n in range(self.steps-k+1):
                    self.value_array(k, n)[:] = self.value_array(0, n)
                    self.mask_array(k, n)[:] = self.mask_array(0, n)
        return self
    def values_at(self, points, step, within):
        return self._c.tube_values(points, step, within)

    @property
    def grid(self) -> Grid:
        return self.problem.grid

    @property
    def steps(self) -> int:
        return self.problem.steps

    def entry(self, start: int, within: int) -> int:
        """Checked place of (start, within); `within` beyond N - start means N - start."""
        start = whole("start", start, least=0, most=self.steps)
        return entry(self.steps, start, min(whole("within", within, least=0), self.steps - start))

    def value_array(self, start: int, within: int) -> FloatArray:
        return self.tubes[self.entry(start, within)]

    def mask_array(self, start: int, within: int) -> FloatArray:
        return self.masks[self.entry(start, within)]

    def values(self, *, start: int, within: int) -> FloatArray:
        """Level-set function of the states that reach the target within `within` steps from step `start`.

        Shape grid.shape, <= 0 inside; a view, not to be modified.
        """
        view = self.value_array(start, within).view()
        view.flags.writeable = False
        return view

    def inputs(self, *, start: int, within: int) -> FloatArray:
        """Which inputs are safe and make progress at each node: bool, grid.shape + (L,).

        u_j is marked where, held over the interval from `start`, it avoids the unsafe sets and ends in the tube with
        `within` - 1 steps to go, whatever the adversary does. Nothing is marked for within = 0.
        """
        count = len(self.problem.inputs)
        bits = np.unpackbits(self.mask_array(start, within), axis=0, count=count, bitorder="little")
        return np.moveaxis(bits.reshape(count, *self.grid.shape), 0, -1).astype(bool)

    def contains(self, points: FloatArray, *, start: int, within: int) -> FloatArray:
        """Whether each row of `points` (M, ndim) lies in the tube, by multilinear interpolation: bool (M,)."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        if np.isnan(points).any():
            raise ValueError("points has a NaN; every coordinate must be a number")
        return self.grid.interpolate(self.value_array(start, within), points) <= 0

    def fraction(self, *, start: int, within: int) -> float:
        """Share of the grid's volume inside the tube."""
        return self.grid.fraction(self.value_array(start, within) <= 0)

    @property
    def nbytes(self) -> int:
        """Bytes that the tubes and masks take in memory."""
        return int(self.tubes.nbytes + self.masks.nbytes)

    def _checksum(self) -> str:
        """SHA-256 of what a file holds: a table that was read whole has the checksum it was written with."""
        axes = [self.avoid.static_axes, self.avoid.moving_axes]
        told = json.dumps(
            [self.method, self.problem.digest, dict(self.problem.recipe), dict(self.details), axes], sort_keys=True
        )
        h = hashlib.sha256(told.encode())
        for array in (self.tubes, self.masks, self.avoid.static, self.avoid.moving):
            h.update(repr((array.dtype.str, array.shape)).encode())
            h.update(np.ascontiguousarray(array).data)
        return h.hexdigest()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an HDF5 file that describes itself; an older file of that name is replaced only by a whole new one.

        Raises
        ------
        OSError
            Where the folder does not exist or cannot be written.
        """
        with written_whole(path) as file:
            self._write(file)

    def _write(self, file: h5py.File) -> None:
        grid = self.grid
        file_header(file, self.problem, self.method, self.details)
        packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
        file["entries"] = np.array([(k, n) for k in range(self.steps + 1) for n in range(self.steps - k + 1)])
        file["entries"].attrs["columns"] = ["start", "within"]
        file.attrs["checksum"] = self._checksum()
        file.create_dataset("tubes", data=self.tubes, chunks=(1, *grid.shape), **packing)
        file.create_dataset("masks", data=self.masks, chunks=(1, 1, grid.size), **packing)
        for name in ("static", "moving"):
            array = getattr(self.avoid, name)
            data = file.create_dataset(f"avoid_{name}", data=array, chunks=True, **packing)
            data.attrs["axes"] = np.array(getattr(self.avoid, f"{name}_axes"), dtype=np.int64)

    @classmethod
    def read(cls, file: h5py.File, path: Path, problem: ReachAvoidProblem) -> "LookupTable":
        """The table in an open file of this problem; TableFileError where it is damaged."""
        axes = {name: tuple(int(axis) for axis in file[f"avoid_{name}"].attrs["axes"]) for name in ("static", "moving")}
        avoid = AvoidTubes(axes["static"], file["avoid_static"][()], axes["moving"], file["avoid_moving"][()])
        tubes, masks = file["tubes"][()], file["masks"][()]
        entries = entry(problem.steps, problem.steps, 0) + 1
        if tubes.shape != (entries, *problem.grid.shape) or masks.shape[0::2] != (entries, problem.grid.size):
            raise TableFileError(f"{path} is damaged: its arrays do not fit its grid and steps; solve it anew")
        table = cls(problem, str(file.attrs["method"]), tubes, masks, avoid, json.loads(file.attrs["details"]))
        if table._checksum() != file.attrs["checksum"]:
            raise TableFileError(
                f"{path} is damaged: its contents do not have the checksum they were written with; solve it anew"
            )
        return table


def in_a_line(table: Any) -> str:
    """One line on a table of any method: what was solved, how, and the share of the grid that it holds."""
    problem, nodes = table.problem, " x ".join(map(str, table.grid.shape))
    return (
        f"<{type(table).__name__} of {problem.name!r}, method {table.method!r}: {nodes} nodes, "
        f"{len(problem.inputs)} inputs, {table.steps} steps of {problem.delta:g} s; "
        f"{table.fraction(start=0, within=table.steps):.1%} of the grid's volume within all of them>"
    )


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[h5py.File]:
    """An HDF5 file that is made in memory and put on disk at the end: the HDF5 library does not survive a full disk."""
    with h5py.File("image", "w", driver="core", backing_store=False, block_size=BLOCK) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with replaced_whole(path) as temporary:
        try:
            temporary.write_bytes(image)
        except OSError as error:
            raise OSError(f"cannot write {path}: {error.strerror}; free {len(image) / 1e6:.0f} MB") from error


def file_header(file: h5py.File, problem: ReachAvoidProblem, method: str, details: Mapping[str, Any]) -> None:
    """What every file says of itself: format, versions, conventions, and the problem in full."""
    file.attrs.update(
        format=FORMAT,
        format_version=FORMAT_VERSION,
        sdhj_version=sdhj.__version__,
        convention=CONVENTION,
        problem=problem.name,
        digest=problem.digest,
        recipe=json.dumps(dict(problem.recipe), sort_keys=True),
        method=method,
        details=json.dumps(dict(details), sort_keys=True),
        delta=problem.delta,
        steps=problem.steps,
        view_time=problem.view_time,
    )
    grid = problem.grid
    layout = file.create_group("grid")
    layout.attrs.update(lower=grid.lower, upper=grid.upper, shape=grid.shape, periodic=grid.periodic, names=grid.names)
    file["inputs"] = problem.inputs

Table = LookupTable
