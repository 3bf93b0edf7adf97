"""The store of a table: a Zarr group (version 3) in a folder, written slab by slab.

    tubes         (T, *shape)              level-set functions, as `LookupTable.tubes`
    masks         (T, bytes, *shape)       the inputs marked, as `LookupTable.masks`
    avoid_static  (1, L, *subgrid)         avoid tubes, as `AvoidTubes`
    avoid_moving  (N, L, *subgrid)
    tables, opaque                         what formulas look up, and values of black boxes

Its attributes say the problem, how it is cut and, once it is whole, which entry is which tube. A slab of an entry is
one file: a compressed chunk with its CRC-32C, or a *shard* of several, each small enough for a controller to read. A
file appears under its name when it is whole, so what is there is finished: this is all that going on after a crash
needs. Zarr takes what is missing for empty; here it is an error.
"""

import hashlib
import importlib
import itertools
import json
import math
import os
import shutil
import threading
import uuid
import warnings
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.kernels import FloatArray
from sdhj.table.files import TableFileError, probed, unwritable

STORE_FORMAT = 2
CHUNK_BYTES = 2**21  # bytes of a chunk at most: what is read for a state at the least
CACHE_BYTES = 2**27  # bytes of what was read or written that are kept where that helps
THICK = 16  # nodes of a chunk along the axis that is cut, at most
NAMES = ("tubes", "masks", "avoid_static", "avoid_moving")

Runs = Sequence[tuple[int, int]]

try:
    zarr: Any = importlib.import_module("zarr")
    codecs: Any = importlib.import_module("zarr.codecs")
    NDBuffer: Any = importlib.import_module("zarr.buffer.cpu").NDBuffer
except ImportError as missing:
    raise ImportError("a store needs Zarr: pip install 'sdhj[outofcore]'") from missing


class TableStore:
    """An open store; FileNotFoundError where there is none, TableFileError if it is damaged or of another version."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path, self.cache_room = Path(path), CACHE_BYTES
        if not (self.path / "zarr.json").is_file():
            raise FileNotFoundError(f"no store {self.path}; write one with sdhj.solve(problem, store=...)")
        try:
            self.group = zarr.open_group(str(self.path), mode="r+" if os.access(self.path, os.W_OK) else "r")
            text = self.group.attrs["sdhj"]
            if hashlib.sha256(text.encode()).hexdigest() != self.group.attrs["sha256"]:
                raise ValueError("its attributes have another digest")
            self.head: dict[str, Any] = json.loads(text)
            if self.head["store"] != STORE_FORMAT:
                raise ValueError(f"it has store version {self.head['store']}, and this sdhj reads {STORE_FORMAT}")
            # what is all zero is written too, or it would be missing
            self.arrays = {name: self.group[name].with_config({"write_empty_chunks": True}) for name in NAMES}
            for name, (shape, dtype) in self.head["arrays"].items():
                array = self.arrays[name]
                if list(array.shape[1:]) != shape[1:] or array.shape[0] > shape[0] or array.dtype != np.dtype(dtype):
                    raise ValueError(f"its array {name} is {array.dtype} of {array.shape}")
            self._cache: OrderedDict[Any, FloatArray] = OrderedDict()
            self._lock = threading.Lock()
        except Exception as error:  # whatever Zarr makes of files that are not what they were
            raise TableFileError(f"{self.path} is damaged or no store of a table ({error}); solve it anew") from error

    @property
    def functions(self) -> dict[str, FloatArray]:
        """The tables that formulas look up, and values of black boxes, by name; TableFileError where they are not."""
        here = [name for name in self.head["functions"] if name in self.group]
        found = {name: np.array(self.group[name], dtype=np.float64) for name in here}
        for name, expected in self.head["functions"].items():
            if name not in found or digest(found[name]) != expected:
                raise TableFileError(f"{self.path} is damaged: its array {name} is missing or another; solve it anew")
        return found

    # ---- its slabs

    def files(self, name: str, lead: int, runs: Runs) -> Iterator[tuple[Path, Any, tuple[slice, ...]]]:
        """The files with some of `array[lead]`, where in it that is, and where in what is read or written."""
        array = self.arrays[name]
        between = array.ndim - len(runs) - 1  # axes of which a shard has all
        for place, parts, here in blocks(runs, (array.shards or array.chunks)[array.ndim - len(runs) :]):
            there = (lead, *[slice(None)] * between, *(slice(*part) for part in parts))
            yield self.path / name / array.metadata.encode_chunk_key((lead, *[0] * between, *place)), there, here

    def there(self, name: str, lead: int, runs: Runs) -> bool:
        """Whether `array[lead]` has been written from begin to end of each axis of the grid."""
        return all(file.is_file() for file, _, _ in self.files(name, lead, runs))

    def read(self, name: str, lead: int, runs: Runs) -> FloatArray:
        """`array[lead]` from begin to end of each axis of the grid; TableFileError if a chunk is damaged or missing."""
        array = self.arrays[name]
        between = array.shape[1 : array.ndim - len(runs)]
        out = np.empty((*between, *(end - begin for begin, end in runs)), array.dtype)
        for file, there, here in self.files(name, lead, runs):
            try:
                if not file.stat().st_size:
                    raise ValueError("it is empty")
                array.get_basic_selection(there, out=NDBuffer.from_numpy_array(out[here]))  # without another copy
            except OSError as error:
                what = "is missing" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"
                raise TableFileError(f"{file} {what}; solve with resume=True, which makes it anew") from error
            except Exception as error:  # of a codec, by what it stumbled over
                raise TableFileError(
                    f"{file} is damaged ({type(error).__name__}); delete it and solve with resume=True, which makes "
                    "it anew"
                ) from error
        return out

    def cached(self, name: str, lead: int, runs: Runs) -> FloatArray:
        """As `read`, but what was read so or written of late is in memory; not to be changed."""
        with self._lock:
            key = name, lead, tuple(runs)
            values = self._cache.pop(key, None)
            return self._remember(key, self.read(name, lead, runs) if values is None else values)

    def _remember(self, key: Any, values: FloatArray) -> FloatArray:
        if values.nbytes <= self.cache_room:
            self._cache[key] = values  # as the latest
        while sum(one.nbytes for one in self._cache.values()) > self.cache_room:
            self._cache.popitem(last=False)
        return values

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OSError(
                f"cannot write in {self.path}: {error.strerror or error}; what is finished stays: make room, or see "
                "who may write there, and solve with resume=True"
            ) from error

    def write(self, name: str, lead: int, runs: Runs, values: FloatArray) -> None:
        """Write `array[lead]` from begin to end of each axis of the grid, whole shards."""
        with self._writing():
            between = [slice(None)] * (self.arrays[name].ndim - len(runs) - 1)
            self.arrays[name][(lead, *between, *(slice(*run) for run in runs))] = values
        if name != "masks":  # which a solve does not read
            self._remember((name, lead, tuple(runs)), values)

    def finish(self, index: FloatArray, details: Mapping[str, Any]) -> None:
        """Say which entry is which tube, and that all are there."""
        with self._writing():
            for array in (self.arrays["tubes"], self.arrays["masks"]):
                array.resize((int(index.max()) + 1, *array.shape[1:]))
            self.group.update_attributes(attributes(self.head | {"index": index.tolist(), "details": dict(details)}))


def blocks(runs: Runs, size: Sequence[int]) -> Iterator[tuple[tuple[int, ...], Runs, tuple[Any, ...]]]:
    """The blocks of an array with some runs of it: their places, which part of the runs, where in what is read."""
    ranges = [range(begin // n, -(-end // n)) for (begin, end), n in zip(runs, size, strict=True)]
    for place in itertools.product(*ranges):
        each = zip(place, size, runs, strict=True)
        parts = [(max(begin, i * n), min(end, (i + 1) * n)) for i, n, (begin, end) in each]
        here = (slice(low - begin, high - begin) for (low, high), (begin, _) in zip(parts, runs, strict=True))
        yield place, parts, (..., *here)


def attributes(head: Mapping[str, Any]) -> dict[str, str]:
    """The attributes of a store: a head as text, and the digest of that."""
    text = json.dumps(head, sort_keys=True)
    return {"sdhj": text, "sha256": hashlib.sha256(text.encode()).hexdigest()}


def chunked(shape: Sequence[int], cut: int | None, width: int, each: int) -> tuple[list[int], list[int]]:
    """Chunks and shards of the nodes of a (sub)grid, with `each` bytes a node, in slabs of the axis that is cut.

    Of the other axes the first are split, down to one node if need be: chunks lie in one piece in memory.
    """
    most = [min(width, n) if axis == cut else n for axis, n in enumerate(shape)]
    size = [max(c for c in range(1, THICK + 1) if n % c == 0) if axis == cut else n for axis, n in enumerate(most)]
    for axis, n in enumerate(shape):
        room = CHUNK_BYTES * n // (each * math.prod(size))  # nodes along this axis
        if axis != cut and room < n:  # few nodes beyond the end, and few states between two chunks, which read both
            size[axis] = min(range(1, max(room, 1) + 1), key=lambda c: -(-n // c) * (c + 1))
    return size, [-(-n // c) * c for n, c in zip(most, size, strict=True)]


def digest(values: FloatArray) -> str:
    """SHA-256 of an array's shape and numbers."""
    found = hashlib.sha256(repr(values.shape).encode())
    found.update(values.data.cast("B"))
    return found.hexdigest()


def create(path: Path, head: Mapping[str, Any], functions: Mapping[str, FloatArray]) -> None:
    """Make a store with this head and these functions, else empty; the folder appears when it is whole.

    FileExistsError if there is one.
    """
    free_name(path)
    probed(path.parent)
    temporary = path.with_name(f".sdhj-{uuid.uuid4().hex}.zarr")
    packing: Any = {"compressors": [codecs.BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), codecs.Crc32cCodec()]}
    packing |= {"fill_value": 0, "chunk_key_encoding": {"name": "default", "separator": "."}}  # all in one folder
    try:
        group = zarr.create_group(str(temporary), attributes=attributes(head))
        for name, values in functions.items():
            group.create_array(name, data=values, chunks=values.shape)
        axis, width = head["cut"]
        for name, (shape, dtype) in head["arrays"].items():
            axes = head["avoid_axes"].get(name.removeprefix("avoid_"), list(range(len(head["grid"]["shape"]))))
            cut = axes.index(axis) if axis in axes and width < head["grid"]["shape"][axis] else None
            lead = len(shape) - len(axes)
            ahead = (1, *shape[1:lead])
            chunks, shards = chunked(shape[lead:], cut, width, math.prod(ahead) * np.dtype(dtype).itemsize)
            blocks = {"chunks": (*ahead, *chunks), "shards": None if chunks == shards else (*ahead, *shards)}
            group.create_array(name, shape=tuple(shape), dtype=dtype, **blocks, **packing)
        os.rename(temporary, path)
    except OSError as error:
        free_name(path)
        raise unwritable(path.parent, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def free_name(path: Path) -> None:
    """Raise FileExistsError where there is something of that name."""
    if os.path.lexists(path):
        raise FileExistsError(f"{path} exists already; go on with it by resume=True, remove it, or choose another name")


def room_for(path: Path, needed: int) -> None:
    """Warn where a disk may not hold what is to be written, which is known before compression only."""
    with suppress(OSError):
        if needed > (free := shutil.disk_usage(path.parent).free):
            warnings.warn(
                f"{path} takes up to {needed / 1e9:.3g} GB, less what compression saves, and {free / 1e9:.3g} GB are "
                "free; where the disk is full the solve ends, and goes on with resume=True",
                stacklevel=4,
            )
