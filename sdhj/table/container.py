"""Arrays and what is told of them, in one file or one folder: NumPy's .npy files and a problem.json.

The file is a zip of the same, by custom an .npz, which `numpy.load` opens; arrays are not compressed unless asked, and
begin at multiples of 64 bytes, so that they are mapped and not read. problem.json is JSON, the *head*: its first line
has the format and the SHA-256 of all that follows; then comes each array's dtype, shape and SHA-256 of its .npy file,
and of a packed one also the size and the SHA-256 of what is packed.

Every byte of a file is known from its head but the arrays themselves and their CRC-32: so all are compared with what
would be written, and nothing that lies is followed.
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
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray

FORMAT = 6  # those before were HDF5 files
FIRST_LINE = '{{"format": {}, "sha256": "{}",\n'  # of problem.json
HEAD = "problem.json"
MOST_HEAD = 1 << 24  # bytes of the head
HEADER = 256  # bytes before the numbers of an .npy file, for every shape, so that it can be written again
ALIGNED = 64  # bytes, of which numbers in a file begin at a multiple
KINDS = ("float32", "float64", "int16", "int64", "uint8", "uint32", "uint64")
MOST_AXES, MOST_BYTES = 8, 1 << 50  # of an array
NAME = re.compile("[a-z_]{1,40}(/[a-z0-9 ]{1,40})?")  # of an array
MOST_UNPACKED, MOST_RATIO = 1 << 28, 256  # bytes of all packed arrays, or so many times what is packed
CHECKED = 1 << 30  # bytes of arrays up to which digests are read with the head
PART = 1 << 24  # bytes that are looked at in one go
FULL = 0xFFFFFFFF  # says in a zip that the number is in the field behind: always, so that all sizes are written alike


class Damaged(ValueError):
    """The bytes are not those that were written."""


class Stated(NamedTuple):
    """An array as the head states it: dtype, shape, SHA-256 of its .npy file, and of what is packed."""

    kind: str
    shape: tuple[int, ...]
    sha256: str
    packed: tuple[int, str] | None = None  # where the array is compressed

    @classmethod
    def of_json(cls, name: str, entry: Any) -> "Stated":
        """The entry of an array in the head, checked."""
        kind, shape, packed = entry["dtype"], entry["shape"], entry.get("packed")
        size = [*shape, *(packed[:1] if packed else [])]
        # before anything is made of it, as a file may state any size
        whole = all(isinstance(n, int) and not isinstance(n, bool) and 0 <= n <= MOST_BYTES for n in size)
        texts = [entry["sha256"], *(packed[1:] if packed else ["0" * 64])]
        digests = len(texts) == 2 and all(isinstance(one, str) and re.fullmatch("[0-9a-f]{64}", one) for one in texts)
        if not (NAME.fullmatch(name) and kind in KINDS and whole and digests and len(shape) <= MOST_AXES):
            raise ValueError(f"its head states no array {name} that a table may have")
        found = cls(kind, tuple(shape), entry["sha256"], (packed[0], packed[1]) if packed else None)
        if found.size > MOST_BYTES:
            raise ValueError(f"its array {name} has {found.size:,} bytes")
        return found

    @property
    def nbytes(self) -> int:
        """The bytes of the numbers."""
        return np.dtype(self.kind).itemsize * math.prod(self.shape)

    @property
    def size(self) -> int:
        """The bytes of the .npy file."""
        return HEADER + self.nbytes

    @property
    def entry(self) -> dict[str, Any]:
        """The entry in the head, for JSON."""
        found = {"dtype": self.kind, "shape": list(self.shape), "sha256": self.sha256}
        return found | ({"packed": list(self.packed)} if self.packed else {})


def header(kind: Any, shape: Sequence[int]) -> bytes:
    """What stands before the numbers in an .npy file of version 1.0: `HEADER` bytes.

    Readers compare these bytes, the checker with a copy of its own: another blank refuses all files written before.
    """
    descr = np.dtype(kind).newbyteorder("<").str
    text = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {tuple(map(int, shape))}, }}"
    return struct.pack("<6s2BH", b"\x93NUMPY", 1, 0, HEADER - 10) + text.encode().ljust(HEADER - 11) + b"\n"


def file_name(name: str) -> str:
    """The name of an array's file, in a zip or a folder."""
    return name.replace("/", ".") + ".npy"


def numbers_in(part: memoryview, kind: str, shape: Sequence[int]) -> FloatArray:
    """The array (shape) whose .npy file `part` has the bytes of, as a view of them."""
    found = np.frombuffer(part, np.dtype(kind).newbyteorder("<"), math.prod(shape), HEADER)
    return found.reshape(shape)


def mapped(path: Path) -> memoryview:
    """The bytes of a regular file, mapped; ValueError if it is a link or none."""
    flags = sum(getattr(os, f"O_{name}", 0) for name in ("RDONLY", "NOFOLLOW", "NONBLOCK", "BINARY"))
    if path.is_symlink():  # where the system has no such flag
        raise ValueError(f"{path.name} is a link")
    stream = os.open(path, flags)
    try:
        if not stat.S_ISREG((about := os.fstat(stream)).st_mode):
            raise ValueError(f"{path.name} is no file")
        if not about.st_size:
            return memoryview(b"")
        return memoryview(mmap.mmap(stream, 0, access=mmap.ACCESS_READ))
    finally:
        os.close(stream)


def parts_of(data: memoryview) -> Iterator[memoryview]:
    """Yield parts of some bytes, of at most `PART`, in their order."""
    return (data[begin : begin + PART] for begin in range(0, len(data), PART))


def sha256(*pieces: memoryview | bytes) -> str:
    """The SHA-256, in hexadecimal, of pieces one behind the other."""
    found = hashlib.sha256()
    for piece in pieces:
        found.update(piece)
    return found.hexdigest()


# ---- writing


class Member(NamedTuple):
    """A file in a zip: its name, CRC-32, sizes packed and not, whether it is compressed, where its header begins."""

    name: bytes
    crc: int
    packed: int
    size: int
    deflated: bool
    at: int

    @property
    def header(self) -> bytes:
        """The bytes before its own, which then begin at a multiple of `ALIGNED`."""
        # the same bytes as `before` in `sdhj.certified.check.files`: with another number here the checker refuses every
        # file
        extra = struct.pack("<2H2Q", 1, 16, self.size, self.packed)
        pad = -(self.at + 30 + len(self.name) + len(extra) + 4) % ALIGNED
        extra += struct.pack("<2H", 0xD935, pad) + bytes(pad)
        about = 45, 0, 8 * self.deflated, 0, 0x21, self.crc, FULL, FULL, len(self.name), len(extra)
        return struct.pack("<4s5H3L2H", b"PK\3\4", *about) + self.name + extra

    @property
    def entry(self) -> bytes:
        """Its entry in the directory of the zip."""
        # the same bytes as `listed` there
        extra = struct.pack("<2H3Q", 1, 24, self.size, self.packed, self.at)
        about = 45, 45, 0, 8 * self.deflated, 0, 0x21, self.crc, FULL, FULL, len(self.name), len(extra), 0, 0, 0, 0
        return struct.pack("<4s6H3L5H2L", b"PK\1\2", *about, FULL) + self.name + extra

    @property
    def end(self) -> int:
        """Where the next one begins."""
        return self.at + len(self.header) + self.packed


def directory(members: Sequence[Member]) -> bytes:
    """The end of a zip of these files: what is where."""
    # readers compare it with the end of a file, the checker by its `parts_of_zip`: no byte of it may change
    each, at, count = b"".join(one.entry for one in members), members[-1].end, len(members)
    whole = struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, count, count, len(each), at)
    place = struct.pack("<4sLQL", b"PK\6\7", 0, at + len(each), 1)
    return each + whole + place + struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 0xFFFF, 0xFFFF, FULL, FULL, 0)


def head_text(head: Mapping[str, Any], stated: Mapping[str, Stated]) -> bytes:
    """The bytes of problem.json: a head, with an entry "arrays" besides.

    The checker has its first line a second time, on purpose (in `sdhj.certified.check.files`).
    """
    about = {name: stated[name].entry for name in sorted(stated)}
    text = json.dumps(dict(head) | {"arrays": about}, sort_keys=True)[1:].encode() + b"\n"
    if len(text) > MOST_HEAD - 100:
        raise ValueError(f"recipe, details and inputs take {len(text):,} bytes as text, and at most {MOST_HEAD:,} fit")
    return FIRST_LINE.format(FORMAT, sha256(text)).encode() + text


def write_zip(out: BinaryIO, head: Mapping[str, Any], arrays: Mapping[str, FloatArray], compress: bool) -> None:
    """Write head and arrays to an open file, packed if `compress` says so and they are `believed`."""
    pieces, stated, checks = dict[str, list[Any]](), dict[str, Stated](), dict[str, int]()
    for name in sorted(arrays):
        values: FloatArray = np.asarray(arrays[name], order="C")
        kind, shape = values.dtype.name, values.shape
        data = values.astype(values.dtype.newbyteorder("<"), copy=False).reshape(-1).view(np.uint8).data
        every: list[memoryview | bytes] = [header(kind, shape), *parts_of(data)]
        found, crc = hashlib.sha256(), 0
        # -15: without a header of its own, as files in a zip are packed.
        packer, packed = zlib.compressobj(1, zlib.DEFLATED, -15), list[bytes]()
        for piece in every:
            found.update(piece)
            crc = zlib.crc32(piece, crc)
            if compress:
                packed.append(packer.compress(piece))
        packed.append(packer.flush())
        size = sum(map(len, packed))
        how = (size, sha256(*packed)) if compress else None
        pieces[name], checks[name] = packed if compress else every, crc
        stated[name] = Stated(kind, shape, found.hexdigest(), how)
    # known only now that all are packed: a reader would refuse what was packed so closely
    if compress and not believed(stated):
        return write_zip(out, head, arrays, compress=False)
    text = head_text(head, stated)
    members = [Member(HEAD.encode(), zlib.crc32(text), len(text), len(text), False, 0)]
    for name, one in stated.items():
        size = one.packed[0] if one.packed else one.size
        members.append(
            Member(file_name(name).encode(), checks[name], size, one.size, bool(one.packed), members[-1].end)
        )
    for member, each in zip(members, [[text], *pieces.values()], strict=True):
        for piece in (member.header, *each):
            out.write(piece)
    out.write(directory(members))


def believed(stated: Mapping[str, Stated]) -> bool:
    """Whether packed arrays are no larger than a reader unpacks."""
    # the checker has this bound a second time (`MOST_UNPACKED`, `MOST_TIMES`)
    packed = [(one.packed[0], one.size) for one in stated.values() if one.packed]
    return sum(size for _, size in packed) <= max(MOST_UNPACKED, MOST_RATIO * sum(small for small, _ in packed))


def begin_array(folder: Path, name: str, kind: str, shape: Sequence[int]) -> None:
    """Make the .npy file of an array in a folder, or cut or extend the one that is there."""
    path = folder / file_name(name)
    with open(path, "r+b" if path.exists() else "xb") as out:
        out.write(header(kind, shape))
        # what is not written yet is 0, and takes no room where the system knows that
        out.truncate(Stated(kind, tuple(shape), "").size)


def stated_in(folder: Path, shapes: Mapping[str, tuple[str, Sequence[int]]]) -> dict[str, Stated]:
    """The arrays of a folder, of these dtypes and shapes, with their digests: all are read."""
    found = {}
    for name, (kind, shape) in sorted(shapes.items()):
        begin_array(folder, name, kind, shape)
        with open(folder / file_name(name), "r+b") as stream:
            # on the disk before the head, with which the folder is complete
            os.fsync(stream.fileno())
            found[name] = Stated(kind, tuple(map(int, shape)), hashlib.file_digest(stream, "sha256").hexdigest())
    return found


# ---- reading


class Contents:
    """An open file or folder: its head, and its arrays, mapped or unpacked when asked for."""

    def __init__(self, path: Path) -> None:
        """Compare all bytes but the arrays' with what would be written: `Damaged` where they differ."""
        # the checker has a reader of its own on purpose, `Arrays` in `sdhj.certified.check.files`: what one refuses the
        # other has to refuse
        self.path, self.folder = path, path.is_dir()
        image = mapped(path / HEAD) if self.folder else mapped(path)
        begin, size = (0, len(image)) if self.folder else first_in(image)
        text = image[begin : begin + min(size, MOST_HEAD + 1)]
        # head : without the entry "arrays", which `stated` has; sha256 : of the head
        self.sha256, self.head = digest_and_head(bytes(text))
        self.stated = {name: Stated.of_json(name, one) for name, one in sorted(self.head.pop("arrays").items())}
        if self.folder:  # where what was packed is not any more
            self.stated = {name: one._replace(packed=None) for name, one in self.stated.items()}
        if not believed(self.stated):
            raise ValueError("its arrays are packed more closely than any that are written")
        unpacked = sum(one.size for one in self.stated.values() if one.packed)
        require_memory(unpacked, "all that is packed in the file", "close other programs, or use a larger machine")
        if self.folder:
            self.parts = {name: mapped(path / file_name(name)) for name in self.stated}
        else:
            self.parts = self._members(image, bytes(text))
        for name, one in self.stated.items():
            part = self.parts[name]
            if not one.packed and (len(part) != one.size or part[:HEADER] != header(one.kind, one.shape)):
                raise Damaged(f"its array {name} is not what was written")

    def _members(self, image: memoryview, text: bytes) -> dict[str, memoryview]:
        """The bytes of each array in a zip, of which every byte between them is compared."""
        first = Member(HEAD.encode(), zlib.crc32(text), len(text), len(text), False, 0)
        members, parts = [first], dict[str, memoryview]()
        for name, one in self.stated.items():
            at, size = members[-1].end, one.packed[0] if one.packed else one.size
            # whatever is stated there: the digests in the head tell what is damaged
            crc = int.from_bytes(image[at + 14 : at + 18], "little")
            members.append(Member(file_name(name).encode(), crc, size, one.size, bool(one.packed), at))
            parts[name] = image[members[-1].end - size : members[-1].end]
        written = [(one.at, one.header) for one in members]
        if any(image[at : at + len(piece)] != piece for at, piece in written) or (
            image[members[-1].end :] != directory(members)
        ):
            raise Damaged("its zip is not what was written")
        return parts

    @property
    def nbytes(self) -> int:
        """The bytes of all arrays."""
        return sum(one.size for one in self.stated.values())

    def check(self) -> None:
        """Read all arrays and compare their digests: `Damaged` where one differs."""
        for name, one in self.stated.items():
            if sha256(*parts_of(self.parts[name])) != (one.packed[1] if one.packed else one.sha256):
                raise Damaged(f"its array {name} is not what was written")

    def array(self, name: str) -> FloatArray:
        """The array of that name, read-only."""
        one, part = self.stated[name], self.parts[name]
        if one.packed:
            if sha256(part) != one.packed[1]:
                raise Damaged(f"its array {name} is not what was written")
            # one byte more than is stated, at most: a small file may unpack to any size
            unpacker, data = zlib.decompressobj(-15), b""
            with suppress(zlib.error):
                data = unpacker.decompress(part, one.size + 1)
            same = len(data) == one.size and unpacker.eof and not unpacker.unused_data
            if not same or data[:HEADER] != header(one.kind, one.shape):
                raise ValueError(f"its array {name} cannot be unpacked")
            part = memoryview(data)
        return numbers_in(part, one.kind, one.shape)


def first_in(image: memoryview) -> tuple[int, int]:
    """Where the head begins in a zip, and the size that is stated."""
    if len(image) < HEADER or bytes(image[:4]) != b"PK\3\4" or image[30 : 30 + len(HEAD)] != HEAD.encode():
        raise Damaged("it does not begin as a table's file does")
    # 30 bytes, the name, and 4 of the extra field, before the size (`Member.header`)
    begin = len(Member(HEAD.encode(), 0, 0, 0, False, 0).header)
    return begin, int.from_bytes(image[30 + len(HEAD) + 4 :][:8], "little")


def digest_and_head(text: bytes) -> tuple[str, dict[str, Any]]:
    """The SHA-256 and the content of a problem.json, whose bytes are compared with those of this format."""
    first, _, rest = text.partition(b"\n")
    if len(text) > MOST_HEAD or first + b"\n" != FIRST_LINE.format(FORMAT, found := sha256(rest)).encode():
        raise Damaged("its head is not what was written")
    head = json.loads(b"{" + rest)
    return found, dict(head)
