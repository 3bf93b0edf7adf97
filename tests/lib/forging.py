"""Tables' files changed on purpose, and given the digests that belong to them again: what a forger would do."""

import hashlib
import json
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.describing import arrays_of, described
from sdhj.table import container
from sdhj.table.container import Contents, Member, Stated

TOLD = ("problem", "delta", "steps", "view_time", "grid", "inputs", "sensing", "sets", "formulas")
Arrays = dict[str, Any]  # by name, NumPy's or `Claimed`


@dataclass
class Claimed:
    """An array that is said to be packed, of this dtype and shape; what is packed is `data`."""

    kind: str
    shape: tuple[int, ...]
    data: bytes = b""

    @property
    def bytes(self) -> bytes:
        """`data`, or as many bytes as so many zeros are packed to."""
        size = Stated(self.kind, self.shape, "").size
        return self.data or bytes(size // 1000 + 10)


def written(path: Path, told: dict[str, Any], arrays: Arrays) -> None:
    """Write a file of what is told and of these arrays, with the digests and the zip that belong to them."""
    parts, stated = dict[str, bytes](), dict[str, Stated]()
    for name, values in sorted(arrays.items()):
        if isinstance(values, Claimed):
            parts[name], kind, shape = values.bytes, values.kind, values.shape
            stated[name] = Stated(kind, shape, "0" * 64, (len(parts[name]), hashlib.sha256(parts[name]).hexdigest()))
            continue
        kind, shape = values.dtype.name, values.shape
        parts[name] = container.header(values.dtype, shape) + np.ascontiguousarray(values).tobytes()
        stated[name] = Stated(kind, shape, hashlib.sha256(parts[name]).hexdigest())
    seal(path, container.head_text(told, stated).partition(b"\n")[2], parts, stated)


def seal(path: Path, text: bytes, parts: dict[str, bytes], stated: dict[str, Stated]) -> None:
    """Write a file of that head, given as what follows its first line, and these arrays' files."""
    text = container.FIRST_LINE.format(container.FORMAT, hashlib.sha256(text).hexdigest()).encode() + text
    members, out = [Member(container.HEAD.encode(), zlib.crc32(text), len(text), len(text), False, 0)], [text]
    for name, one in stated.items():
        size = Stated(one.kind, one.shape, "").size if one.packed else len(parts[name])
        about = len(parts[name]), size, bool(one.packed), members[-1].end
        members.append(Member(container.file_name(name).encode(), zlib.crc32(parts[name]), *about))
        out.append(parts[name])
    whole = b"".join(one.header + data for one, data in zip(members, out, strict=True))
    path.write_bytes(whole + container.directory(members))


def retold(path: Path, text: bytes) -> None:
    """Give a file another head, of that text, with the digest that belongs to it; the arrays stay."""
    found = Contents(path)
    seal(path, text, {name: bytes(part) for name, part in found.parts.items()}, found.stated)


def digest(told: dict[str, Any], arrays: Arrays) -> str:
    """What names a problem: SHA-256 of what the head says of it and of the arrays of its functions."""
    said = {name: told[name] for name in TOLD}
    if not isinstance(said["sensing"].get("error", []), list):
        said["sensing"] = said["sensing"] | {"error": [said["sensing"]["error"]] * len(told["grid"]["shape"])}
    every = {name: one for name, one in arrays.items() if name.startswith(("tables/", "opaque/"))}
    held = {name: [list(one.shape), hashlib.sha256(one.tobytes()).hexdigest()] for name, one in every.items()}
    return hashlib.sha256(json.dumps([said, held], sort_keys=True).encode()).hexdigest()


@contextmanager
def forged(path: Any, *, named: bool = False) -> Iterator[tuple[dict[str, Any], Arrays]]:
    """What the file tells and its arrays, both to be changed. Named: the head then names what it tells, if it can."""
    found = Contents(path)
    told, arrays = found.head, {name: found.array(name).copy() for name in found.stated}
    yield told, arrays
    if named:
        with suppress(Exception):  # of what cannot be named there is nothing to name
            told["digest"] = digest(told, arrays)
    written(path, told, arrays)


def describe(path: Any, problem: Any) -> None:
    """The file's robot becomes the one of a problem; its claims stay."""
    with forged(path, named=True) as (told, arrays):
        told.update(described(problem))
        arrays.update(arrays_of(problem))


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


def replaced(name: str, make: Callable[[FloatArray], Any]) -> Callable[[Any, Any], None]:
    """A forgery: the array of that name made anew, of what it was; None: it is missing."""

    def forge(told: Any, arrays: Any) -> None:
        made = make(arrays.pop(name))
        if made is not None:
            arrays[name] = made

    return forge


FORGERIES: dict[str, Callable[[FloatArray], Any]] = {
    "missing": lambda old: None,
    "text": lambda old: np.array(["a"] * 4),
    "scalar": lambda old: np.array(7),
    "empty": lambda old: old[:0],
    "too short": lambda old: old[:-1],
    "too long": lambda old: np.concatenate([old, old[:1]]),
    "another axis": lambda old: old[None],
    "other kind": lambda old: old.astype(np.complex128),
    "flags": lambda old: old.astype(np.bool_),
    "bomb": lambda old: Claimed(old.dtype.name, (old.shape[0] + int(2.5e9) // max(old[:1].nbytes, 1), *old.shape[1:])),
    "no deflate": lambda old: Claimed(old.dtype.name, old.shape, b"\xff" * 1000),
}
