"""Tables' files changed on purpose, and given the digest that belongs to them again: what a forger would do."""

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import h5py
import numpy as np

from sdhj.kernels import FloatArray
from sdhj.problem.describing import arrays_of, described

TOLD = ("problem", "delta", "steps", "view_time", "grid", "inputs", "sensing", "sets", "formulas")


def digest(told: dict[str, Any], arrays: h5py.File) -> str:
    """What names a problem: SHA-256 of what the head says of it and of the arrays of its functions."""
    said = {name: told[name] for name in TOLD}
    if not isinstance(said["sensing"].get("error", []), list):
        said["sensing"] = said["sensing"] | {"error": [said["sensing"]["error"]] * len(told["grid"]["shape"])}
    groups = [(name, arrays[name]) for name in ("tables", "opaque") if name in arrays]
    every = {f"{name}/{one}": group[one][()] for name, group in groups for one in group}
    held = {name: [list(one.shape), hashlib.sha256(one.tobytes()).hexdigest()] for name, one in every.items()}
    return hashlib.sha256(json.dumps([said, held], sort_keys=True).encode()).hexdigest()


@contextmanager
def forged(path: Any, *, named: bool = False) -> Iterator[tuple[dict[str, Any], h5py.File]]:
    """What the file tells and its arrays, both to be changed. Named: the head then names what it tells, if it can."""
    first, _, text, *_ = path.read_bytes().split(b"\n", 3)
    told = json.loads(text)
    with h5py.File(path, "r+") as arrays:
        block = arrays.userblock_size
        yield told, arrays
        if named:
            with suppress(Exception):  # of what cannot be named there is nothing to name
                told["digest"] = digest(told, arrays)
    image = path.read_bytes()[block:]
    text = json.dumps(told, sort_keys=True).encode() + b"\n"
    while len(first) + 74 + len(text) > block:
        block *= 2
    seal(path, first, text.ljust(block - len(first) - 73) + image)


def describe(path: Any, problem: Any) -> None:
    """The file's robot becomes the one of a problem; its claims stay."""
    with forged(path, named=True) as (told, arrays):
        told.update(described(problem))
        for name, values in arrays_of(problem).items():
            if name in arrays:
                del arrays[name]
            arrays[name] = values


def seal(path: Any, first: bytes, rest: bytes) -> None:
    """Write a file of that first line and all that follows the digest."""
    path.write_bytes(first + b"\nsha256 " + hashlib.sha256(rest).hexdigest().encode() + b"\n" + rest)


def spoiled(whole: bytes, rng: np.random.Generator, count: int) -> Iterator[bytes]:
    """A file's bytes with one bit turned over, and with 512 of them zeroed, each at `count` random places."""
    for place in rng.integers(0, len(whole), count):
        changed = bytearray(whole)
        changed[place] ^= 1 << int(rng.integers(8))
        yield bytes(changed)
    for place in rng.integers(0, len(whole), count):
        changed = bytearray(whole)
        changed[place : place + 512] = bytes(len(changed[place : place + 512]))
        if changed != whole:
            yield bytes(changed)


def replaced(name: str, make: Callable[[Any, str, FloatArray], Any]) -> Callable[[Any, Any], None]:
    """A forgery: the array of that name made anew, by its file, its name and what it held."""

    def forge(told: Any, arrays: Any) -> None:
        old = arrays[name][()]
        del arrays[name]
        make(arrays, name, old)

    return forge


def elsewhere(arrays: Any, name: str, old: FloatArray) -> None:
    """Data in another file, raw: whatever stands in it would be told."""
    arrays.create_dataset(name, old.shape, old.dtype, external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])


def virtual(arrays: Any, name: str, old: FloatArray) -> None:
    layout = h5py.VirtualLayout(old.shape, old.dtype)
    layout[...] = h5py.VirtualSource("other.h5", name, old.shape)
    arrays.create_virtual_dataset(name, layout)


def bomb(arrays: Any, name: str, old: FloatArray) -> None:
    """Some 250 MB of zeros in a small file, far more than gzip can pack so small."""
    shape = (old.shape[0] + int(2.5e8) // max(old[:1].nbytes, 1), *old.shape[1:])
    chunks = (min(shape[0], 10**6), *(1 for _ in shape[1:]))
    arrays.create_dataset(name, shape, old.dtype, chunks=chunks, compression="gzip")


def as_group(arrays: Any, name: str, old: FloatArray) -> None:
    arrays[name] = arrays["/"]  # a circle


FORGERIES: dict[str, Callable[[Any, str, FloatArray], Any]] = {
    "external storage": elsewhere,
    "virtual": virtual,
    "external link": lambda arrays, name, old: arrays.__setitem__(name, h5py.ExternalLink("other.h5", name)),
    "soft link": lambda arrays, name, old: arrays.__setitem__(name, h5py.SoftLink("/samples")),
    "text": lambda arrays, name, old: arrays.create_dataset(name, data=["a"] * 4, dtype=h5py.string_dtype()),
    "objects": lambda arrays, name, old: arrays.create_dataset(name, old.shape, h5py.vlen_dtype(np.int64)),
    "missing": lambda arrays, name, old: None,
    "group": as_group,
    "scalar": lambda arrays, name, old: arrays.__setitem__(name, 7),
    "empty": lambda arrays, name, old: arrays.__setitem__(name, h5py.Empty(old.dtype)),
    "too short": lambda arrays, name, old: arrays.__setitem__(name, old[:-1]),
    "too long": lambda arrays, name, old: arrays.__setitem__(name, np.concatenate([old, old[:1]])),
    "other kind": lambda arrays, name, old: arrays.__setitem__(name, old.astype(np.complex128)),
    "other order": lambda arrays, name, old: arrays.__setitem__(name, old.astype(">f8")),
    "other packing": lambda arrays, name, old: arrays.create_dataset(name, data=old, chunks=True, fletcher32=True),
    "bomb": bomb,
}
