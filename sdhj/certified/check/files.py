"""A reader of a table's file, or folder: problem.json and NumPy's arrays, every byte of them compared before it counts.

It shares no code with what writes such files, and needs NumPy and Python alone. A file is a zip of problem.json, first
of all, and of the arrays in the order of their names; a folder has the same files. problem.json is JSON whose first
line ends behind the SHA-256 of all that follows; that states of each array dtype, shape and the SHA-256 of its .npy
file, and where it is packed (by deflate) the size and the SHA-256 of what is packed. So what stands around an array,
in its .npy file and in the zip, is known before it is read, and must be that, to the byte: nothing that a header says
is followed. Links are refused, and so is what a small file makes large.
"""

import hashlib
import json
import math
import mmap
import os
import re
import stat
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from sdhj.certified.check.intervals import Array

BEGINNING = b'{"format": 6, "sha256": "%s",\n'  # of problem.json
KINDS = {"float32": "<f4", "float64": "<f8", "int16": "<i2", "int64": "<i8"}
KINDS |= {"uint8": "|u1", "uint32": "<u4", "uint64": "<u8"}
MOST_TEXT = 1 << 24  # bytes of problem.json
MOST_BYTES = 1 << 50  # of an array
MOST_AXES = 8
BEFORE = 256  # bytes before the numbers of an .npy file
MOST_UNPACKED, MOST_TIMES = 1 << 28, 256  # bytes of all packed arrays, or so many times what is packed
BY = 1 << 24  # bytes that are read at a time
ALL = 0xFFFFFFFF  # in a zip: the number is in the extra field


class Damaged(ValueError):
    """Bytes are not those that were written."""


class Stated:
    """What the head states of an array, and of a packed one size and SHA-256 as it is packed."""

    def __init__(self, name: str, entry: Any) -> None:
        """Read an entry of the head, refused where it is not one of an array that may be."""
        self.kind, self.shape, self.sha256 = entry["dtype"], tuple(entry["shape"]), entry["sha256"]
        packed: Any = entry.get("packed") or (None, self.sha256)
        self.packed, own = packed
        sizes = [*self.shape, 0 if self.packed is None else self.packed]
        # with no dots, and one slash, which becomes a dot: no file outside of a folder can be named
        fits = bool(re.fullmatch("[a-z_]{1,40}(/[a-z0-9 ]{1,40})?", name)) and self.kind in KINDS
        fits = fits and len(self.shape) <= MOST_AXES and all(type(n) is int and 0 <= n <= MOST_BYTES for n in sizes)
        fits = fits and all(type(text) is str and re.fullmatch("[0-9a-f]{64}", text) for text in (self.sha256, own))
        self.size = BEFORE + np.dtype(KINDS[self.kind]).itemsize * math.prod(self.shape) if fits else MOST_BYTES + 1
        if self.size > MOST_BYTES:
            raise ValueError(f"its head must state arrays of numbers, got {name[:40]}")
        self.as_it_lies, self.file = own, name.replace("/", ".") + ".npy"

    @property
    def header(self) -> bytes:
        """The first `BEFORE` bytes of the .npy file."""
        # as `header` of `sdhj.table.container` writes it
        text = f"{{'descr': '{KINDS[self.kind]}', 'fortran_order': False, 'shape': {self.shape}, }}"
        return b"\x93NUMPY\x01\x00\xf6\x00" + text.ljust(BEFORE - 11).encode() + b"\n"


class Arrays:
    """The arrays of an open file or folder, whose digests are right, mapped, or unpacked when asked for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Read a file or folder and compare all of its bytes; `Damaged` where one is not what was written."""
        folder = os.path.isdir(path)
        # Users may name a link to a file; within a folder each must be a file itself.
        image = mapped(os.path.join(path, "problem.json") if folder else os.path.realpath(path))
        begin, size = (0, len(image)) if folder else first_of_zip(image)
        text = bytes(image[begin : begin + min(size, MOST_TEXT)])
        first, _, rest = text.partition(b"\n")
        expect_same(first + b"\n", BEGINNING % hashlib.sha256(rest).hexdigest().encode(), "its head")
        self.head = dict(json.loads(b"{" + rest))
        self.stated = {name: Stated(name, entry) for name, entry in sorted(self.head.pop("arrays").items())}
        if folder:  # where what was packed is not any more
            for one in self.stated.values():
                one.packed, one.as_it_lies = None, one.sha256
        deflated = [one for one in self.stated.values() if one.packed is not None]
        # Before anything is unpacked, which might not fit in any memory.
        most = max(MOST_UNPACKED, MOST_TIMES * sum(one.packed for one in deflated))
        if sum(one.size for one in deflated) > most:
            raise ValueError("its arrays must not be packed so closely")
        if folder:
            self.parts = {name: mapped(os.path.join(path, one.file)) for name, one in self.stated.items()}
        else:
            self.parts = dict(zip(self.stated, parts_of_zip(image, text, [*self.stated.values()]), strict=True))
        for name, one in self.stated.items():
            found, part = hashlib.sha256(), self.parts[name]
            for at in range(0, len(part), BY):
                found.update(part[at : at + BY])
            expect_same(found.hexdigest(), one.as_it_lies, f"its array {name}")
            if one.packed is None:
                expect_same((len(part), bytes(part[:BEFORE])), (one.size, one.header), f"its array {name}")

    @property
    def nbytes(self) -> int:
        """The bytes that all arrays take, unpacked."""
        return sum(one.size for one in self.stated.values())

    def shape(self, name: str) -> tuple[int, ...]:
        """The shape of an array."""
        return self.stated[name].shape

    def array(self, name: str) -> Array:
        """The numbers of an array, read-only."""
        one, part = self.stated[name], self.parts[name]
        if one.packed is not None:
            try:
                # one byte more than is stated, so that more is seen and never made
                unpacker = zlib.decompressobj(-15)
                part = memoryview(unpacker.decompress(part, one.size + 1))
            except zlib.error as error:
                raise ValueError(f"its array {name} cannot be unpacked ({error})") from None
            found = len(part), unpacker.eof, bool(unpacker.unused_data), bytes(part[:BEFORE])
            expect_same(found, (one.size, True, False, one.header), f"its array {name}")
        numbers = np.frombuffer(part, KINDS[one.kind], math.prod(one.shape), BEFORE)
        return numbers.reshape(one.shape)


def expect_same(found: Any, written: Any, what: str) -> None:
    """Raise `Damaged` unless two values are the same."""
    if found != written:
        raise Damaged(f"{what} is not what was written")


def mapped(path: str) -> memoryview:
    """The bytes of a regular file, mapped. `Damaged` if it is a link or none; a pipe is not waited for."""
    if os.path.islink(path) or not os.path.exists(path):
        raise Damaged(f"{path} must be a file")
    stream = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    try:
        about = os.fstat(stream)
        if not stat.S_ISREG(about.st_mode):
            raise Damaged(f"{path} must be a file")
        # Nothing at all cannot be mapped.
        return memoryview(mmap.mmap(stream, 0, access=mmap.ACCESS_READ) if about.st_size else b"")
    finally:
        os.close(stream)


# ---- zips


def before(name: bytes, crc: int, size: int, packed: int, method: int, at: int) -> bytes:
    """What stands before a file in a zip, whose header begins `at`; its numbers begin at a multiple of 64 bytes."""
    # here and below what `Member` and `directory` of `sdhj.table.container` write, a second time on purpose
    about = struct.pack("<HHHHHIIIH", 45, 0, method, 0, 33, crc, ALL, ALL, len(name))
    fields = struct.pack("<HHQQ", 1, 16, size, packed)
    pad = -(at + 30 + len(name) + 24) % 64
    fields += struct.pack("<HH", 0xD935, pad) + b"\0" * pad
    return b"PK\3\4" + about + struct.pack("<H", len(fields)) + name + fields


def listed(name: bytes, crc: int, size: int, packed: int, method: int, at: int) -> bytes:
    """What the list at the end of a zip says of the file of `before`."""
    about = struct.pack("<HHHHHHIII", 45, 45, 0, method, 0, 33, crc, ALL, ALL)
    rest = struct.pack("<HHHHHII", len(name), 28, 0, 0, 0, 0, ALL)
    return b"PK\1\2" + about + rest + name + struct.pack("<HHQQQ", 1, 24, size, packed, at)


def first_of_zip(image: memoryview) -> tuple[int, int]:
    """Where the head begins in a zip, and what size is stated."""
    begin = len(before(b"problem.json", 0, 0, 0, 0, 0))
    expect_same(bytes(image[:4]) + bytes(image[30:42]), b"PK\3\4problem.json", "its beginning")
    return begin, int.from_bytes(image[46:54], "little")


def parts_of_zip(image: memoryview, text: bytes, stated: list[Stated]) -> Iterator[memoryview]:
    """Yield the bytes of each array, as they lie; `Damaged` where a byte around them is not what was written."""
    at, entries = 0, b""
    files: list[Any] = [("problem.json", len(text), None), *((one.file, one.size, one.packed) for one in stated)]
    for name, size, packed in files:
        crc = int.from_bytes(image[at + 14 : at + 18], "little") if at else zlib.crc32(text)  # digests are enough
        about = name.encode(), crc, size, size if packed is None else packed, 0 if packed is None else 8, at
        header, begin = before(*about), at
        entries += listed(*about)
        expect_same(image[at : at + len(header)], header, "its zip")
        at += len(header) + about[3]
        if begin:
            yield image[at - about[3] : at]
    count = len(stated) + 1
    end = struct.pack("<IQHHIIQQQQ", 0x06064B50, 44, 45, 45, 0, 0, count, count, len(entries), at)
    end += struct.pack("<IIQI", 0x07064B50, 0, at + len(entries), 1)
    end += struct.pack("<IHHHHIIH", 0x06054B50, 0, 0, 0xFFFF, 0xFFFF, ALL, ALL, 0)
    # All bytes up to the end, so that a zip has nothing else in it.
    expect_same(image[at:], entries + end, "its zip")
