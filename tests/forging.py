"""Tables' files changed on purpose, and given the digest that belongs to them again: what a forger would do."""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import h5py


@contextmanager
def forged(path: Any) -> Iterator[tuple[dict[str, Any], h5py.File]]:
    """What the file tells and its arrays, both to be changed."""
    first, _, text, *_ = path.read_bytes().split(b"\n", 3)
    told = json.loads(text)
    with h5py.File(path, "r+") as arrays:
        block = arrays.userblock_size
        yield told, arrays
    image = path.read_bytes()[block:]
    text = json.dumps(told, sort_keys=True).encode() + b"\n"
    while len(first) + 74 + len(text) > block:
        block *= 2
    seal(path, first, text.ljust(block - len(first) - 73) + image)


def seal(path: Any, first: bytes, rest: bytes) -> None:
    """Write a file of that first line and all that follows the digest."""
    path.write_bytes(first + b"\nsha256 " + hashlib.sha256(rest).hexdigest().encode() + b"\n" + rest)
