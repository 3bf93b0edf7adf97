"""What the file of a certified table says, every number of it checked: what follows believes them.

`files` reads it: the digests are right before anything is believed. No array counts that is not one of numbers, of the
expected shape, or before it is known that all of them fit into memory. The digest of the problem that the head names
has to be that of what is read of it.
"""

import hashlib
import json
import math
import os
import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.certified.check.files import BEFORE, Arrays, Damaged
from sdhj.certified.check.intervals import Array

FEW_DIGITS = 14  # of a decimal that is no rounded number, such as that of pi
MOST_COUNTED = 1000  # parts, and levels of an input
MOST_STEPS = 10**6
LARGEST, SMALLEST = 1e120, 1e-120  # of a number in the head, and of one above 0: products are numbers, in any units
MOST_BYTES = 1 << 34  # of an array
MOST_TABLES = 1 << 30  # bytes of all tables together
MOST_ON_AN_AXIS = 10**6  # cells
TOLD = ("problem", "delta", "steps", "view_time", "grid", "inputs", "sensing", "sets", "formulas")  # of the problem


def decimal(value: float) -> Fraction:
    """The fraction that a float most likely stands for: the shortest decimal, times a power of two, that rounds to it.

    The number itself if every such decimal has more than `FEW_DIGITS` digits.
    """
    # `as_fraction` of the solver has to read alike, with as many digits (`EXACT_DIGITS`): cells begin at such numbers
    part, power = math.frexp(value)
    scaled = [(str(value), 0), *((str(math.ldexp(part, by)), power - by) for by in range(-40, 41))]
    digits, text, by = min((len(re.sub("e.*|[-.]", "", text).strip("0")), text, by) for text, by in scaled)
    return Fraction(text) * Fraction(2) ** by if digits <= FEW_DIGITS else Fraction(value)


def expect(fits: bool, what: str, given: Any) -> None:
    """Raise ValueError("{what}, got {given}") unless `fits`."""
    if not fits:
        raise ValueError(f"{what}, got {reprlib.repr(given)}")


def is_whole(value: Any, least: int, most: float = math.inf) -> bool:
    """Whether a value is a whole number from `least` to `most`; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(least <= value <= most)


def real(name: str, value: Any, least: float = -LARGEST, most: float = LARGEST) -> float:
    """A number of the head, from `least` to `most`, as a float."""
    fits = isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most
    expect(fits, f"{name} must be a number from {least:g} to {most:g}", value)
    return float(value)


def reals(name: str, values: Any, count: int, least: float = -LARGEST) -> list[float]:
    """A list of `count` numbers of the head, all >= `least`, as floats."""
    expect(isinstance(values, list) and len(values) == count, f"{name} must be {count} numbers", values)
    return [real(name, value, least) for value in values]


@contextmanager
def head_and_arrays(path: str | os.PathLike[str]) -> Iterator[tuple[dict[str, Any], Arrays]]:
    """A context with the head of a file or folder, a dict, and its arrays; all digests, the problem's too, are right.

    ValueError where they are not, and in place of any error that is raised inside the context.
    """
    if not os.path.isfile(path) and not os.path.isdir(path) and os.path.exists(path):
        raise ValueError(f"{path} is no file")
    if not os.path.exists(path):
        raise FileNotFoundError(f"no file {path}")
    try:
        arrays = Arrays(path)
        # Before arrays are unpacked, which may be larger than the file.
        expect_room(arrays.nbytes)
        own, named = digest(arrays.head, arrays), arrays.head["digest"]
        expect(named == own, f"its head must name the problem that it describes, {own}", named)
        # What callers do with them is tried here, too: their errors are told as the file's.
        yield arrays.head, arrays
    except Damaged as error:
        raise ValueError(
            f"{path} is damaged, or holds no certified sets in format 6 ({error}); solve it anew"
        ) from error
    except (LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, ValueError) as error:
        raise ValueError(
            f"{path}: its certified sets make no sense ({error}); the file is damaged, or another problem's"
        ) from error


def digest(head: Mapping[str, Any], arrays: Arrays) -> str:
    """The SHA-256, in hexadecimal, of the problem: of the head's entries `TOLD` and the arrays of its functions."""
    # `digest_of` in `sdhj.problem.describing` writes it, and has `TOLD`, too: both change together
    said, of_arrays = {name: head[name] for name in TOLD}, dict[str, Any]()
    error = said["sensing"].get("error")
    if error is not None:
        each = error if isinstance(error, list) else [error] * len(said["grid"]["shape"])
        said["sensing"] = {**said["sensing"], "error": each}
    for name in arrays.stated:
        if name.startswith(("tables/", "opaque/")):
            values = array(arrays, name, np.float64, ..., most=MOST_TABLES)
            own = hashlib.sha256(np.ascontiguousarray(values, "<f8").data.cast("B") if values.size else b"")
            of_arrays[name] = [list(values.shape), own.hexdigest()]
    return hashlib.sha256(json.dumps([said, of_arrays], sort_keys=True).encode()).hexdigest()


def expect_room(needed: int) -> None:
    """Raise MemoryError if `needed` bytes are more than the machine, this process or its group can still get."""
    free, digits = min(free_memory()), math.log10(max(needed, 1))  # which may be more than a float holds
    if needed > free:
        shown = f"{needed / 1e9:.3g} GB" if digits < 300 else f"10^{digits:.0f} bytes"
        raise MemoryError(
            f"to check the file takes {shown} of memory, and {free / 1e9:.3g} GB are free; check some cells with "
            "samples=1000, or use a machine with more memory"
        )


def free_memory() -> Iterator[float]:
    """Yield the bytes that are free by each limit that the system tells: the machine's, the group's, the process's."""
    yield math.inf
    with suppress(OSError, LookupError, ValueError):  # no such file, or no number in it: no limit
        found = dict(line.split(":") for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines())
        yield 1024 * int(found["MemAvailable"].split()[0])
    with suppress(OSError, LookupError, ValueError):
        limit, used = (Path(f"/sys/fs/cgroup/memory.{n}").read_text(encoding="ascii") for n in ("max", "current"))
        lines = Path("/sys/fs/cgroup/memory.stat").read_text(encoding="ascii").splitlines()
        kept = dict(line.split() for line in lines)
        # files that are kept in memory for speed give way
        yield int(limit) - int(used) + int(kept["inactive_file"])
    with suppress(OSError, LookupError, ValueError, ImportError):
        import resource  # where there is ulimit

        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        yield math.inf if most == resource.RLIM_INFINITY else most - pages * resource.getpagesize()


def array(file: Arrays, name: str, kind: type, *shape: Any, most: int = MOST_BYTES) -> Array:
    """An array of a dtype and a shape in a file, looked at before it is read: ValueError where it is another.

    In the shape None is any length, a single ... any shape. most : bytes.
    """
    one = file.stated.get(name)
    expect(one is not None and one.kind == np.dtype(kind).name, f"{name} must be an array of {np.dtype(kind)}", name)
    found = file.shape(name)
    same = len(found) == len(shape) and all(map(lambda n, m: n in (None, m), shape, found))
    fits = (same or shape == (...,)) and file.stated[name].size - BEFORE <= most
    # Before anything is read, so that no array is made of what does not fit.
    expect(fits, f"{name} must be kept in the file, of shape {shape}", found)
    return file.array(name)


def fraction(text: Any) -> Fraction:
    """The fraction that a text such as "-1/3" states, of numbers of up to 300 digits."""
    fits = isinstance(text, str) and re.fullmatch("-?[0-9]{1,300}(/[0-9]{1,300})?", text)
    expect(bool(fits), "cells must be stated as fractions", text)
    # of a denominator 0 `head_and_arrays` makes a ValueError
    return Fraction(text)


def edges_of(cells: int, axis: Sequence[Fraction], layers: Sequence[int]) -> Array:
    """The ends of the cells of an axis, (cells + 1,), as the nearest floats; both ends of a layer are the same.

    axis : its lower end, the width of a cell, the least and the greatest length. layers : at the lower, the upper end.
    """
    (low, width, least, most), (a, b) = axis, layers
    # numerators over one denominator: Python's quotient of two whole numbers is the nearest float, as of a fraction
    over = math.lcm(low.denominator, width.denominator)
    first, step = int(low * over), int(width * over)
    inner = [(first + i * step) / over for i in range(cells - a - b)]
    begin, end = float(low), float(low + (least + most) / 2)
    return np.array([*[begin] * a, *inner, end, *[end] * b])
