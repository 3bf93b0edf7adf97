"""Arrays in a file or a folder: NumPy and any zip program read them, and no byte of it can be another.

The library and the checker have readers of their own, and both refuse what is not to the byte what is written.
"""

import io
import json
import os
import zipfile
import zlib
from contextlib import nullcontext

import numpy as np
import pytest

from sdhj.certified.check import files as checker
from sdhj.table import container
from sdhj.table.container import Contents, Damaged, begin_array, file_name, head_text, stated_in, write_zip

ARRAYS = {
    "index": np.arange(7),
    "marks": np.arange(24, dtype=np.uint8).reshape(2, 3, 4),
    "none": np.zeros((0, 3), np.int16),
    "one": np.array(2.5),
    "opaque/unsafe 0": np.linspace(0.0, 1.0, 5),
    "pool": np.arange(9, dtype=np.uint64),
    "tubes": np.linspace(-1.0, 1.0, 60, dtype=np.float32).reshape(3, 4, 5)[:, ::-1],
}
HEAD = {"method": "hji", "told": [1, 2.5]}


REFUSED = ValueError, LookupError, TypeError, AttributeError, OSError


@pytest.fixture(params=[False, True], ids=["plain", "packed"])
def packed(request):
    return request.param


def by_the_library(path):
    found = Contents(path)
    found.check()
    return found


READERS = ((by_the_library, Damaged), (checker.Arrays, checker.Damaged))


def refused(path, *, damaged=False):
    """Both readers refuse it; `damaged`: as bytes that were not written."""
    for read, error in READERS:
        with pytest.raises(error if damaged else REFUSED):
            read(path).array("tubes")


def written(folder, compress=False, arrays=ARRAYS, head=HEAD):
    path = folder / "table.npz"
    with open(path, "wb") as out:
        write_zip(out, head, arrays, compress)
    return path


def same(path, arrays=ARRAYS, **head):
    """Both readers find the arrays, and the head."""
    for read, _ in READERS:
        found = read(path)
        assert found.stated.keys() == arrays.keys() and found.head == HEAD | head
        for name, values in arrays.items():
            got = found.array(name)
            assert np.array_equal(got, values) and (got.dtype, got.shape) == (values.dtype, values.shape)
            assert got.flags.aligned and not got.flags.writeable


@pytest.mark.parametrize("by", [64, 1 << 24])
def test_a_file_is_read_as_it_was_written(tmp_path, packed, by, monkeypatch):
    """Where its bytes are compared in many pieces, too; by the checker also by a link to it."""
    monkeypatch.setattr(checker, "BY", by)
    same(path := written(tmp_path, packed))
    (tmp_path / "link").symlink_to(path)
    assert checker.Arrays(tmp_path / "link").nbytes == sum(256 + one.nbytes for one in ARRAYS.values())


def test_no_head_is_read_that_is_longer_than_any(tmp_path, monkeypatch):
    monkeypatch.setattr(checker, "MOST_TEXT", 1000)
    with pytest.raises(checker.Damaged, match="head"):
        checker.Arrays(written(tmp_path))


def test_numpy_and_zipfile_read_it(tmp_path, packed):
    path = written(tmp_path, packed)
    with np.load(path, allow_pickle=False) as loaded:
        for name, values in ARRAYS.items():
            assert np.array_equal(loaded[file_name(name).removesuffix(".npy")], values)
    with zipfile.ZipFile(path) as file:
        assert file.testzip() is None and json.loads(file.read("problem.json"))["method"] == "hji"
        assert [one.compress_type for one in file.infolist()][1:] == [8 * packed] * len(ARRAYS)


def test_numbers_begin_at_multiples_of_64_bytes(tmp_path):
    for read, _ in READERS:
        found = read(written(tmp_path))
        assert all(found.array(name).ctypes.data % 64 == 0 for name, values in ARRAYS.items() if values.size)


def test_unpacked_by_any_program_it_is_the_folder(tmp_path, packed):
    with zipfile.ZipFile(written(tmp_path, packed)) as file:
        file.extractall(tmp_path / "folder")
    same(tmp_path / "folder")


def test_a_folder_is_begun_and_finished(tmp_path):
    for name, values in ARRAYS.items():
        shape = (values.shape[0] + 3, *values.shape[1:]) if name == "tubes" else values.shape
        begin_array(tmp_path, name, values.dtype.name, shape)
        with open(tmp_path / file_name(name), "r+b") as out:
            out.seek(container.HEADER)
            out.write(values.tobytes())
    assert np.load(tmp_path / "tubes.npy").shape == (6, 4, 5)
    stated = stated_in(tmp_path, {name: (values.dtype.name, values.shape) for name, values in ARRAYS.items()})
    (tmp_path / "problem.json").write_bytes(head_text(HEAD, stated))
    same(tmp_path)
    assert np.array_equal(np.load(tmp_path / "tubes.npy"), ARRAYS["tubes"])


def test_every_bit_counts(tmp_path, packed, rng):
    path = written(tmp_path, packed)
    whole = path.read_bytes()
    for place in rng.integers(0, len(whole), 250).tolist():
        path.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << place % 8)]) + whole[place + 1 :])
        refused(path, damaged=True)


def test_of_what_is_packed_every_bit_counts_whether_or_not_all_was_compared(tmp_path):
    path = written(tmp_path, True)
    whole, part = path.read_bytes(), bytes(Contents(path).parts["tubes"])
    for place in range(begin := whole.index(part), begin + len(part)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << place % 8)]) + whole[place + 1 :])
        with pytest.raises(Damaged):
            Contents(path).array("tubes")


def test_cut_or_longer_files_are_refused(tmp_path, packed):
    path = written(tmp_path, packed)
    whole = path.read_bytes()
    for other in (*(whole[:keep] for keep in range(0, len(whole), 101)), whole + b"\0", b"\0" + whole, whole + whole):
        path.write_bytes(other)
        refused(path, damaged=True)


# ---- zips that lie: the head is right, and what is around it is not


def rezipped(path, change=lambda members: members, **options):
    """The file written anew by zipfile, of members (name or ZipInfo, bytes) that are changed before."""
    with zipfile.ZipFile(path) as file:
        members = [(one.filename, file.read(one)) for one in file.infolist()]
    with zipfile.ZipFile(path, "w", **options) as file:
        for name, data in change(members):
            file.writestr(name, data)


def as_link(members):
    about = zipfile.ZipInfo("tubes.npy")
    about.create_system, about.external_attr = 3, 0o120777 << 16
    return [(about if name == "tubes.npy" else name, data) for name, data in members]


LIES = {
    "another program": lambda members: members,
    "a link": as_link,
    "a name above": lambda members: [("../" + n if n == "tubes.npy" else n, d) for n, d in members],
    "one more": lambda members: [*members, ("more.npy", members[-1][1])],
    "one less": lambda members: members[:-1],
    "in another order": lambda members: members[::-1],
}


@pytest.mark.parametrize("lie", LIES)
def test_other_zips_of_the_same_are_refused(tmp_path, lie):
    path = written(tmp_path)
    rezipped(path, LIES[lie])
    refused(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_name_that_is_there_twice_is_refused(tmp_path):
    path = written(tmp_path)
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("tubes.npy", b"another")
    refused(path)


def test_a_comment_and_data_before_or_behind_are_refused(tmp_path):
    path = written(tmp_path)
    whole = path.read_bytes()
    with zipfile.ZipFile(path, "a") as file:
        file.comment = b"more"
    refused(path)
    path.write_bytes(b"#!/bin/sh\n" + whole)
    refused(path)
    path.write_bytes(whole + b"more")
    refused(path)


def test_the_directory_says_what_the_headers_say(tmp_path):
    path = written(tmp_path)
    whole = bytearray(path.read_bytes())
    for name in (b"tubes.npy", b"index.npy"):
        first, last = whole.index(name), whole.rindex(name)
        assert first < last
        for place in (first, last):
            other = bytearray(whole)
            other[place : place + 1] = b"X"
            path.write_bytes(other)
            refused(path)


# ---- heads that lie: their digest is right


def forged(path, change, image=lambda name, data: data):
    """A file whose head and whose members are changed, and sealed anew."""
    found = Contents(path)
    arrays = {name: one.entry for name, one in found.stated.items()}
    parts = {name: bytes(found.parts[name]) for name in arrays}
    head = dict(found.head) | {"arrays": arrays}
    change(head)
    text = json.dumps(head, sort_keys=True)[1:].encode() + b"\n"
    text = container.FIRST_LINE.format(6, container.sha256(text)).encode() + text
    members, pieces = [container.Member(b"problem.json", zlib.crc32(text), len(text), len(text), False, 0)], [text]
    for name in sorted(parts):
        data, deflated = image(name, parts[name]), '"packed"' in json.dumps(head.get("arrays"))
        deflated = deflated and name == "tubes"
        about = file_name(name).encode(), zlib.crc32(data), len(data), len(data), deflated, members[-1].end
        members.append(container.Member(*about))
        pieces.append(data)
    out = io.BytesIO()
    for member, piece in zip(members, pieces, strict=True):
        out.write(member.header + piece)
    path.write_bytes(out.getvalue() + container.directory(members))


def test_what_is_sealed_anew_is_read(tmp_path):
    path = written(tmp_path)
    forged(path, lambda head: head.update(method="lax"))
    same(path, method="lax")


def states(**entry):
    return lambda head: head["arrays"]["tubes"].update(entry)


HEADS = {
    "negative": states(shape=[-3, 4, 5]),
    "huge product": states(shape=[1 << 49] * 8),
    "many axes": states(shape=[1] * 33),
    "no numbers": states(shape=[3.0, 4, 5]),
    "true": states(shape=[True, 4, 15]),
    "larger": states(shape=[4, 4, 5]),
    "other shape": states(shape=[5, 4, 3]),
    "objects": states(dtype="object"),
    "other kind": states(dtype="int32"),
    "same size": states(dtype="uint32"),
    "no digest": states(sha256="0"),
    "no text": states(sha256=7),
    "other digest": states(sha256="0" * 64),
    "packed": states(packed=[496, "0" * 64]),
    "packed by one": states(packed=[496]),
    "missing": lambda head: head["arrays"].pop("tubes"),
    "one more": lambda head: head["arrays"].update(more=head["arrays"]["tubes"]),
    "a path": lambda head: head["arrays"].update({"../tubes": head["arrays"].pop("tubes")}),
    "no entry": lambda head: head["arrays"].update(tubes=7),
    "no entries": lambda head: head.update(arrays=7),
    "no arrays": lambda head: head.pop("arrays"),
}


@pytest.mark.parametrize("lie", HEADS)
def test_heads_that_lie_are_refused(tmp_path, lie):
    path = written(tmp_path)
    forged(path, HEADS[lie])
    refused(path)


def npy(values, version=None, pickled=False):
    out = io.BytesIO()
    np.lib.format.write_array(out, values, version, allow_pickle=pickled)
    return out.getvalue()


NPYS = {
    "pickle": npy(np.array([print], object), pickled=True),
    "by columns": npy(np.asfortranarray(ARRAYS["tubes"])),
    "version 2": npy(ARRAYS["tubes"], (2, 0)),
    "other order": npy(ARRAYS["tubes"].astype(">f4")),
    "numpy's own header": npy(ARRAYS["tubes"]),
    "nothing": b"",
}


@pytest.mark.parametrize("lie", NPYS)
def test_other_npy_files_are_refused(tmp_path, lie):
    path, data = written(tmp_path), NPYS[lie]
    forged(path, states(sha256=container.sha256(data)), lambda name, own: data if name == "tubes" else own)
    refused(path, damaged=True)


def packs(data, claimed):
    """A forgery: the tubes are these packed bytes, said to be an array of so many numbers."""
    entry = {"dtype": "uint8", "shape": [claimed], "sha256": "0" * 64, "packed": [len(data), container.sha256(data)]}
    return lambda head: head["arrays"].update(tubes=entry), lambda name, own: data if name == "tubes" else own


@pytest.mark.parametrize("claimed", [1 << 20, 1 << 31])
def test_a_small_file_that_is_a_large_one_unpacked_is_refused(tmp_path, claimed, monkeypatch):
    """Of 2 GB where it says so, which is refused unread, and of 32 MB that are said to be one."""
    packer = zlib.compressobj(1, zlib.DEFLATED, -15)
    data = packer.compress(container.header("uint8", (claimed,)) + bytes(1 << 25)) + packer.flush()
    assert len(data) < 3e5
    if claimed > 1 << 28:
        monkeypatch.setattr(zlib, "decompressobj", None)
    path = written(tmp_path)
    forged(path, *packs(data, claimed))
    refused(path)


@pytest.mark.parametrize("more", [-1, 0])
def test_all_that_is_packed_has_so_much_room_together(tmp_path, more, monkeypatch):
    """Or as much as what is packed takes, so many times."""
    path, size = written(tmp_path, True), sum(256 + one.nbytes for one in ARRAYS.values())
    for most, times in ((size + more, 0), (0, size + more)):
        monkeypatch.setattr(checker, "MOST_UNPACKED", most)
        monkeypatch.setattr(checker, "MOST_TIMES", times)
        with pytest.raises(ValueError, match="packed so closely") if most and more else nullcontext():
            checker.Arrays(path)


NOT_STATED = {
    "tubes": [
        {"dtype": "complex128"},
        {"dtype": 7},
        {"shape": [1] * 9},
        {"shape": [True]},
        {"shape": [-1]},
        {"shape": [2.0]},
        {"shape": [1 << 51]},
        {"shape": [1 << 25, 1 << 26]},
        {"sha256": "0" * 63},
        {"sha256": "0" * 65},
        {"sha256": "F" * 64},
        {"sha256": 7},
        {"packed": [-1, "0" * 64]},
        {"packed": [True, "0" * 64]},
        {"packed": ["9", "0" * 64]},
        {"packed": [9, "0" * 63]},
        {"packed": [9, 7]},
    ],
    **{name: [{}] for name in ("", "Tubes", "a.b", "a.b/c", "a/b/c", "../tubes", "/tubes", "a/b.c", "a/", "a" * 41)},
}


@pytest.mark.parametrize(("name", "lie"), [(name, lie) for name, each in NOT_STATED.items() for lie in each])
def test_what_is_no_entry_of_an_array_is_refused(name, lie):
    entry = {"dtype": "uint8", "shape": [2, 3], "sha256": "0" * 64}
    assert checker.Stated("opaque/unsafe 0", entry).size == 256 + 2 * 3
    with pytest.raises(ValueError, match="arrays of numbers"):
        checker.Stated(name, entry | lie)


def test_what_packs_too_closely_is_written_plain(tmp_path, monkeypatch):
    monkeypatch.setattr(container, "MOST_UNPACKED", 1000)
    monkeypatch.setattr(container, "MOST_RATIO", 100)
    path = written(tmp_path, True, {"index": np.zeros(10**6)})
    for read, _ in READERS:
        found = read(path)
        assert found.stated["index"].packed is None and not found.array("index").any()


def test_what_is_packed_and_no_deflate_is_refused(tmp_path):
    path = written(tmp_path)
    forged(path, *packs(b"\xff" * 300, 100))
    refused(path)


# ---- folders


@pytest.fixture
def folder(tmp_path):
    with zipfile.ZipFile(written(tmp_path)) as file:
        file.extractall(tmp_path / "folder")
    return tmp_path / "folder"


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(
            ("tubes.npy", kind)
            for kind in ("link", "pipe", "folder", "missing", "cut", "longer", "longer, and said so", "device")
        ),
        *(("problem.json", kind) for kind in ("link", "pipe", "empty")),
    ],
)
def test_what_is_no_file_of_a_folder_is_refused(folder, name, kind):
    path = folder / name
    data = path.read_bytes()
    path.rename(folder.parent / "elsewhere")
    if kind == "link":
        path.symlink_to(folder.parent / "elsewhere")
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.write_bytes({"empty": b"", "cut": data[:-1]}.get(kind, data + b"\0"))
    if kind == "longer, and said so":
        told = json.loads((folder / "problem.json").read_bytes())
        told["arrays"]["tubes"]["sha256"] = container.sha256(path.read_bytes())
        text = json.dumps({name: told[name] for name in told if name not in ("format", "sha256")})[1:].encode()
        first = container.FIRST_LINE.format(container.FORMAT, container.sha256(text)).encode()
        (folder / "problem.json").write_bytes(first + text)
    refused(folder, damaged=kind == "longer, and said so")


def test_what_lies_beside_in_a_folder_is_not_read(folder):
    (folder / "README.txt").write_text("mine")
    os.mkfifo(folder / "pipe")
    (folder / "link").symlink_to("/dev/zero")
    same(folder)
