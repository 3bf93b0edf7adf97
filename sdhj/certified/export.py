"""A certified table as C99: `sdhj_table.bin`, the header `sdhj.h` that reads it, and `sdhj_robot.h` of this robot.

The file: a head of 560 bytes, then one behind the other, each from a multiple of 8 on, the words, the inputs, their
order from the braking one on, for each block of cells the number of its body, where bodies begin, the bodies, and
states with their answers to test a reader. `sdhj.h` says what each number is; it and this file change together.

For a controller that remembers (`Sensing.memory`) the images stand behind the bodies, and the file is of version 2: of
each axis, for each input and each cell of the axes that these images depend on, from the cell's own number on the first
and the last cell that it leads to, four bytes (`images_of`). Other files are of version 1.
"""

import ctypes
import hashlib
import os
import shutil
import struct
import subprocess
import zlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tqdm import tqdm

from sdhj.certified.arriving import arrived_in_c
from sdhj.certified.table import CertifiedTable
from sdhj.certified.words import CLEAR, Rule, words_of
from sdhj.common.checks import option, whole
from sdhj.common.remembering import FloatArray
from sdhj.common.showing import hidden
from sdhj.kernels.words import INPUTS, NOTHING, number_records, pack_block
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import threads
from sdhj.table.beside import predicted, squared_distances
from sdhj.table.files import replaced_whole, writable_file
from sdhj.table.rules import RULES

FIELDS = ("steps", "select", "safe", "filter", "clear")  # of a word, in this order
BLOCK_SIDES = {1: 256, 2: 16, 3: 6, 4: 4, 5: 3, 6: 3}  # cells of a block along each axis
CELLS_AT_ONCE = 1 << 20
NO_INPUT, ARRIVED = 65535, 65534
MOST_EXPORTED = 65533
TESTS = 1000
DRAWN_CELLS = 1 << 17  # cells, to see which inputs are frequent
STATUS = {"IN_TARGET": 1, "NOT_PROVED": -1, "OFF_GRID": -2, "PAST_SAFE_END": -3, "LAST_STEP": -5}
STATUS |= {"LEFT_OUT": -8, "NOT_CARRIED": -9}
FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-shared", "-fPIC")
FIXED_HEADER = Path(__file__).with_name("sdhj").with_suffix(".h")


def export_c(
    table: CertifiedTable,
    folder: str | os.PathLike[str],
    *,
    rule: str | None = None,
    only: Sequence[str] = FIELDS,
    brake: int | None = None,
    progress: bool | None = None,
) -> "Exported":
    """Write a certified table for a robot without Python, as C99: `sdhj_table.bin`, `sdhj.h` and `sdhj_robot.h`.

    Parameters
    ----------
    table : CertifiedTable
        Of a problem without delay. If it is for a controller that remembers, the loop is `sdhj_step`, or
        `Exported.loop`.
    folder : path
        Made where it does not exist.
    rule : {"deepest", "effort", "target", "clearance", "small"}, optional
        Which proved input `sdhj_select` prefers, asked at the centre of each cell; "small", the one proved in most
        cells, is the default where "select" is all that is exported, else "deepest".
    only : sequence of {"steps", "select", "safe", "filter", "clear"}
        What the file answers: the steps to go; one input; all inputs of the fewest steps; all after which the target
        can still be reached in time; all that stay clear for one interval, for `sdhj_fallback`.
    brake : int, optional
        The input where nothing is proved, by index; by default the first of least norm.
    progress : bool, optional
        By default if standard error is a terminal.

    Returns
    -------
    Exported
        Its methods call the C, where there is a compiler.

    Raises
    ------
    ValueError
        If the table is not certified, its measurements have a delay, it has too many inputs or would take more than 4
        GB.
    OSError
        If the folder cannot be written.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, certified:

    >>> import tempfile
    >>> proved = sdhj.solve(problem, sdhj.Certified(cells=[80]))
    >>> robot = sdhj.export_c(proved, tempfile.mkdtemp())
    >>> robot.nbytes < 10_000
    True
    """
    problem, fields = _exportable(table), _fields_of(only)
    rule = rule or ("small" if fields == ("select",) else "deepest")
    option("rule", rule, (*RULES, "small"))
    norms = np.square(problem.inputs).sum(axis=1)
    # By default the input of least norm, as standing still is where it is one.
    brake = int(norms.argmin()) if brake is None else whole("brake", brake, least=0, most=len(problem.inputs) - 1)
    folder = Path(folder)
    if taken := [str(one) for one in (folder, *folder.parents) if one.exists() and not one.is_dir()]:
        raise ValueError(f"{taken[0]} is a file, and an export is a folder: name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    writable_file(folder / "sdhj_table.bin")
    data = packed_table(table, fields, _frequent(table) if rule == "small" else rule, brake, progress)
    robot = header_of(table, data, fields, rule, brake)
    files = {"sdhj_table.bin": data, FIXED_HEADER.name: FIXED_HEADER.read_bytes(), "sdhj_robot.h": robot.encode()}
    # one after the other: of two exports mixed, `sdhj_open` refuses the table by the digest in the header
    for name, text in files.items():
        with replaced_whole(folder / name) as temporary:
            temporary.write_bytes(text)
    return Exported(folder, table)


def _fields_of(only: Sequence[str]) -> tuple[str, ...]:
    """The fields named in `only`, each once, in the order of `FIELDS`."""
    only = (only,) if isinstance(only, str) else tuple(only)
    for one in only:
        option("only", one, FIELDS)
    if not only:
        raise ValueError(f"only must name some of {', '.join(FIELDS)}")
    # In the order of `FIELDS`, in which a word has them.
    return tuple(one for one in FIELDS if one in only)


def _exportable(table: Any) -> ReachAvoidProblem:
    """The problem of a `CertifiedTable`, without delay, of few enough inputs."""
    if not isinstance(table, CertifiedTable):
        raise ValueError(
            f"only certified tables are exported, whose answers need no formulas; got {type(table).__name__}: solve "
            'the problem with method="certified"'
        )
    if table.problem.sensing.delay:
        raise ValueError("a table for measurements with a delay is not exported: predictions need the robot's formulas")
    if len(table.problem.inputs) > MOST_EXPORTED:
        raise ValueError(f"at most {MOST_EXPORTED:,} inputs are exported, got {len(table.problem.inputs):,}")
    return table.problem


# ---- the words


def _frequent(table: CertifiedTable) -> tuple[int, ...]:
    """The indices of all inputs, those first that are proved at step 0 in the most of `DRAWN_CELLS` random cells."""
    # the same cells each time, so that a table's export is always the same file
    rng, left = np.random.default_rng(0), table.steps
    cells = np.stack([rng.integers(0, count, DRAWN_CELLS) for count in table.shape], axis=1)
    ahead = table.fewest(cells, 0)
    least = left if table.problem.has_no_target else 1
    safe = table.inputs_of(cells, np.where(ahead <= left, np.maximum(ahead, least), 0), 0)
    return tuple(np.argsort(-safe.sum(axis=0), kind="stable").tolist())


def words_in_file(table: CertifiedTable, cells: FloatArray, step: int, fields: Sequence[str], rule: Rule) -> FloatArray:
    """The words of cells (M, ndim) at a step, with the given fields, as bytes of the file: (M, bytes) uint8.

    A cell that is not certified has `NO_INPUT`; one in the target where no input is chosen `ARRIVED`.
    """
    count, left, parts = len(table.problem.inputs), table.steps - step, dict[str, FloatArray]()
    within, every = left if table.problem.has_no_target else min(1, left), None
    if "filter" in fields and within < left:
        every = words_of(table, cells, step, left, None, lines=True)
    # an input of the fewest steps is one of all steps
    nearest = words_of(table, cells, step, within, rule, every, lines=True)

    def mask(words: FloatArray) -> FloatArray:
        return np.ascontiguousarray(words[:, INPUTS:]).view(np.uint8)[:, : -(-count // 8)]

    # of a cell that is not certified `NOTHING` stays, which is UINT32_MAX in C
    steps, chosen = nearest[:, 0].copy(), nearest[:, 1].astype("<u2")
    chosen[nearest[:, 1] == NOTHING] = NO_INPUT
    if table.problem.has_no_target:
        steps[steps == 0] = left
    else:
        chosen[(steps == 0) & (chosen == NO_INPUT)] = ARRIVED
    parts["steps"] = steps.astype("<u4").view(np.uint8).reshape(-1, 4)
    parts["select"], parts["safe"] = chosen.view(np.uint8).reshape(-1, 2), mask(nearest)
    if "filter" in fields:
        parts["filter"] = parts["safe"] if every is None else mask(every)
    if "clear" in fields:
        clear = np.packbits(table.clear_inputs(cells, step), axis=1, bitorder="little") if left else None
        parts["clear"] = np.zeros((len(cells), -(-count // 8)), np.uint8) if clear is None else clear
    # in the order of `FIELDS`, by which `sdhj_offset` and `Words` of the checker find them
    return np.concatenate([parts[one] for one in fields], axis=1)


class Packer:
    """The different words and bodies of blocks of an exported file, each kept once and known by a number.

    Call `add` for the words of every piece of cells first, then `pack` for blocks of their numbers.
    """

    def __init__(self, size: int) -> None:
        # words (room, size) uint8, of which the first `used` rows count
        self.known, self.used = np.zeros((1024, size), np.uint8), 0
        # a hash table of the numbers of words, -1: free; each body's number, each block's
        self.slots, self.bodies, self.index = np.full(4096, -1), dict[bytes, int](), list[int]()
        self.blocks: list[FloatArray] = []

    def add(self, found: FloatArray) -> FloatArray:
        """The numbers (n,) of the words found (n, size); new words are kept."""
        out = np.empty(len(found), np.int64)
        while (used := number_records(found, self.known, self.used, self.slots, out)) < 0:
            full = self.known  # all of it is used
            self.known = np.concatenate([full, np.zeros_like(full)])
            self.slots = np.full(4 * len(self.known), -1)
            self.used = number_records(full, self.known, 0, self.slots, np.empty(len(full), np.int64))
        self.used = used
        return out.astype(np.uint32)

    def pack(self, numbers: FloatArray, width: int) -> None:
        """Pack the numbers (B, cells) of B blocks into bodies, of `width` bytes; after the last `add`."""
        # as long as the palette with all cells and 16 bits for each, which are the most (`sdhj_entry`)
        seen, room = np.full(self.used, -1), np.empty(8 + numbers.shape[1] * (width + 2), np.uint8)
        for one in numbers:
            body = room[: pack_block(one, width, seen, room)].tobytes()
            self.index.append(self.bodies.setdefault(body, len(self.bodies)))


class InLines:
    """The cells of a table in whole blocks, and the blocks in pieces of work of at most about `CELLS_AT_ONCE` cells.

    A piece is one row of blocks along each of the first few axes, and all blocks along the others; `work` has the step
    and the rows of each.
    """

    def __init__(self, table: CertifiedTable) -> None:
        # -1, where no axis is better, is the last one
        self.counts, self.along = np.array(table.shape), table.proof.along % len(table.shape)
        self.sides = np.minimum(self.counts, BLOCK_SIDES[len(self.counts)])
        self.blocks = -(-self.counts // self.sides)
        rows, every = self.sides.tolist(), (self.blocks * self.sides).tolist()
        # else single blocks along all axes but the last, though these make more
        fits = (alone for alone in range(len(rows)) if prod(rows[:alone] + every[alone:]) <= CELLS_AT_ONCE)
        alone = next(fits, len(rows) - 1)
        starts = range(1 if table.problem.time_invariant else table.steps + 1)
        self.work = [(step, at) for step in starts for at in np.ndindex(*self.blocks[:alone].tolist())]

    def cells(self, at: Sequence[int]) -> FloatArray:
        """The cells (M, ndim) of the piece with rows of blocks `at`, in lines along the axis `along`."""
        begins = np.array([*at, *[0] * (len(self.sides) - len(at))]) * self.sides
        ends = np.where(np.arange(len(self.sides)) < len(at), begins + self.sides, self.blocks * self.sides)
        # a block that reaches past the end of an axis has the last cell there again
        every = np.stack(np.meshgrid(*map(np.arange, begins, ends), indexing="ij", copy=False), axis=-1)
        return np.minimum(np.moveaxis(every, self.along, -2).reshape(-1, len(self.sides)), self.counts - 1)

    def in_blocks(self, numbers: FloatArray, at: Sequence[int]) -> FloatArray:
        """The numbers (M,) of a piece's words put in order by block: (B, cells of a block)."""
        # blocks, and cells in a block, with the last axis fastest, as `sdhj_word` and the checker's `Words.ids` count
        blocks = [1] * len(at) + self.blocks[len(at) :].tolist()
        shape = [one * side for one, side in zip(blocks, self.sides.tolist(), strict=True)]
        shape.append(shape.pop(self.along))
        cut = np.moveaxis(numbers.reshape(shape), -1, self.along)
        cut = cut.reshape([one for pair in zip(blocks, self.sides.tolist(), strict=True) for one in pair])
        order = [*range(0, cut.ndim, 2), *range(1, cut.ndim, 2)]
        return np.ascontiguousarray(cut.transpose(order)).reshape(prod(blocks), -1)


def packed_table(table: CertifiedTable, fields: Sequence[str], rule: Rule, brake: int, progress: bool | None) -> bytes:
    """The bytes of `sdhj_table.bin`; its words are made in threads, pieces of cells at a time."""
    pieces, packer, several = InLines(table), None, threads()

    def found(one: tuple[int, tuple[int, ...]]) -> FloatArray:
        step, at = one
        return words_in_file(table, pieces.cells(at), step, fields, rule)

    with (
        tqdm(total=len(pieces.work), desc="words", disable=hidden(progress)) as bar,
        ThreadPoolExecutor(several) as pool,
    ):
        # in the order of `work`, by which blocks are numbered: all of a step, then those of the next
        for some in (pieces.work[at : at + several] for at in range(0, len(pieces.work), several)):
            for (_, at), rows in zip(some, pool.map(found, some), strict=True):
                # How long a word is, its first rows tell.
                packer = packer or Packer(rows.shape[1])
                packer.blocks.append(pieces.in_blocks(packer.add(np.ascontiguousarray(rows)), at))
                bar.update()
    assert packer is not None
    # Only now it is known how many words there are, and so how many bytes their numbers take.
    width = _bytes_for(packer.used)
    for numbers in packer.blocks:
        packer.pack(numbers, width)
    return file_of(table, packer, fields, rule, brake, pieces.sides)


def _bytes_for(count: int) -> int:
    """The fewest bytes in which every whole number below `count` can be written."""
    return max(1, -(-(count - 1).bit_length() // 8))


def file_of(
    table: CertifiedTable, packer: Packer, fields: Sequence[str], rule: Rule, brake: int, sides: FloatArray
) -> bytes:
    """The bytes of `sdhj_table.bin`: the head with its digest, and the parts that the module docstring names.

    ValueError above 4 GB. Three readers know these offsets and change with them: `sdhj_open` in sdhj.h, `Words` in
    `sdhj.certified.check.words`, and `header_of`, which takes the digest.
    """
    problem, grid, ndim = table.problem, table.grid, len(table.axes)
    inputs, index_bytes = np.ascontiguousarray(problem.inputs), _bytes_for(len(packer.bodies))
    # `sdhj_fallback` takes the first of these that stays clear
    order = np.argsort(squared_distances(inputs, inputs[brake][None])[0], kind="stable")
    order = np.array([brake, *order[order != brake]])
    index = np.array(packer.index, "<u4").view(np.uint8).reshape(-1, 4)[:, :index_bytes]
    lengths = [len(body) for body in packer.bodies]
    bodies = b"".join(packer.bodies) + bytes(2)  # as `sdhj_entry` reads three bytes of any entry, also of the last
    starts = np.cumsum([0, *lengths[:-1]]).astype("<u4")
    at_bytes, tests = _bytes_for(int(starts[-1]) + 1), answered_states(table, fields, rule, brake)
    leads, reads, images = images_of(table) if problem.sensing.remembers else (0, [0] * ndim, [])
    parts = (
        packer.known[: packer.used].tobytes(),
        inputs.astype("<f8").tobytes(),
        order.astype("<u2").tobytes(),
        index.tobytes(),
        starts.view(np.uint8).reshape(-1, 4)[:, :at_bytes].tobytes(),
        bodies,
        b"".join(one.tobytes() for one in images),
        tests.tobytes(),
    )
    if sum(map(len, parts)) + 1024 >= 1 << 32:
        raise ValueError("a file has room for 4 GB, and these words take more; use fewer cells, or export less (only)")
    parts_of_file = b"".join(part.ljust(-(-len(part) // 8) * 8, b"\0") for part in parts)
    flags = sum(1 << FIELDS.index(one) for one in fields)
    each = 1 if problem.time_invariant else table.steps + 1
    numbers = (ndim, *inputs.shape, table.steps, each, flags, brake, packer.known.shape[1], packer.used)
    numbers += (_bytes_for(packer.used), index_bytes, len(packer.bodies), len(bodies), len(tests), at_bytes, leads)
    safe = ([1, 2] @ grid.ends_where("frees")).tolist()
    layers = table.cells.layers.T @ [2, 4]  # a reader that does not know them refuses the file
    whole_numbers = (table.shape, sides.tolist(), grid.periodic + layers + 256 * np.array(reads), safe)
    error = np.broadcast_to(np.array(problem.sensing.error, dtype=np.float64), (ndim,))
    reals = (table.cells.lower, table.cells.width, table.cells.length, error, grid.upper, table.proof.shell)
    # it begins at byte 160; at 256 there are the reals, at 544 delta, and the head ends at 560
    tail = b"".join(struct.pack("<6I", *map(int, one), *[0] * (6 - ndim)) for one in whole_numbers)
    tail += b"".join(struct.pack("<6d", *map(float, one), *[0.0] * (6 - ndim)) for one in reals)
    tail += struct.pack("<2d", problem.delta, 0.0)
    digest = hashlib.sha256(tail + parts_of_file).digest()
    head = b"sdhjcell" + struct.pack("<I", 2 if images else 1)
    # from byte 16 on; at 96 there is the problem's digest, at 128 that of all from 160 on
    rest = struct.pack(f"<{1 + len(numbers)}I", 560 + len(parts_of_file), *numbers).ljust(80, b"\0")
    rest += bytes.fromhex(problem.digest)[:32].ljust(32, b"\0") + digest + tail + parts_of_file
    return head + struct.pack("<I", zlib.crc32(head + rest)) + rest


# ---- images, for a controller that remembers


def images_of(table: CertifiedTable) -> tuple[int, list[int], list[FloatArray]]:
    """The images of cells for a controller that remembers: (steps, masks, images), the last two for each axis.

    Images are (steps, L, places, 2) int16, the first and the last cell less the cell's own index.
    """
    problem = table.problem
    starts, masks, images = problem.steps if problem.dynamics.depends_on_time else 1, list[int](), list[FloatArray]()
    for axis, reads in enumerate(table.proof.depends):
        # all cells on the axes that it reads, the first on the others
        # with the last axis fastest, as `sdhj_image` counts them
        cells = np.indices(np.where(reads, table.shape, 1).tolist()).reshape(len(reads), -1).T
        own = np.empty((starts, len(problem.inputs), len(cells), 2), "<i2")
        for step, j in np.ndindex(own.shape[:2]):
            first, last = table.proof.image(cells, np.full(len(cells), j), step)
            own[step, j] = np.stack([first, last], axis=1)[:, :, axis] - cells[:, None, axis]
        masks.append(int(reads @ (1 << np.arange(len(reads)))))
        images.append(own)
    return starts, masks, images


# ---- states with their answers


def answered_states(table: CertifiedTable, fields: Sequence[str], rule: Rule, brake: int) -> FloatArray:
    """Random states with checksums of Python's answers, for `sdhj_selftest`: (TESTS, ndim + 1) uint16."""
    problem, cells = table.problem, table.cells
    parts = np.random.default_rng(0).integers(0, 1 << 16, (TESTS, len(table.axes)))
    # a state is written in 65535ths of a range longer than the axis: some are off the grid
    # `sdhj_selftest` takes the same operations in the same order: a state near an edge is in another cell by one bit
    states = cells.lower - 0.02 * cells.length + parts * (1.04 / 65535) * cells.length
    out, steps = np.zeros((TESTS, len(table.axes) + 1), "<u2"), 1 if problem.time_invariant else table.steps + 1
    out[:, :-1] = parts
    for step in range(min(steps, TESTS)):
        some = np.arange(step, TESTS, steps)
        said = python_answers(table, states[some], step, some % len(problem.inputs), fields, rule, brake)
        # the lower half
        out[some, -1] = [zlib.crc32(one) & 0xFFFF for one in said]
    return out


def python_answers(
    table: CertifiedTable,
    states: FloatArray,
    step: int,
    wanted: FloatArray,
    fields: Sequence[str],
    rule: Rule,
    brake: int,
) -> list[bytes]:
    """Python's answers for states (M, ndim) at a step, as bytes of which `sdhj_selftest` makes checksums.

    For each of "steps", "select" and "filter", asked about `wanted` (M,), a status, one byte, and a value, four; then
    such pairs for the safe inputs and those that stay clear, and for a controller that remembers the image along each
    axis.
    """
    problem, left, count = table.problem, table.steps - step, len(states)
    # without a delay a measurement is only clipped, as by `sdhj_seen`; the order of what follows is that of
    # `sdhj_selftest`
    states = predicted(problem, states, np.full(count, problem.sensing.rest), step)
    within = left if problem.has_no_target else min(1, left)
    to_go, safe, chosen = table._words.look_up(table, states, step, within, rule)
    proved = table._words.look_up(table, states, step, left, None)[1]
    clear = table._words.look_up(table, states, step, CLEAR, None)[1] if left and "clear" in fields else safe & False
    distances = squared_distances(problem.inputs, problem.inputs[wanted])
    # A wanted input that is proved is the nearest, before another that is the same.
    distances[np.arange(count), wanted] = -1.0
    nearest = np.where(proved, distances, np.inf).argmin(axis=1)
    where, out = location_status(table, states), []
    for m in range(count):
        # C sees by one of these two fields that a cell is in the target (`sdhj_least_ahead`)
        arrived = not problem.has_no_target and to_go[m] == 0 and bool({"steps", "select"} & set(fields))
        none = STATUS["IN_TARGET" if arrived else "NOT_PROVED"] if left else STATUS["LAST_STEP"]
        steps = left if problem.has_no_target else int(to_go[m])
        answers = (
            ("steps", to_go[m] >= 0, steps, STATUS["NOT_PROVED"], 0xFFFFFFFF),
            ("select", chosen[m] >= 0, int(chosen[m]), none, brake),
            ("filter", bool(proved[m].any()), int(nearest[m]), none, brake),
        )
        said = b""
        for name, found, value, otherwise, instead in answers:
            status = where[m] or (STATUS["LEFT_OUT"] if name not in fields else 0 if found else otherwise)
            said += struct.pack("<BI", status & 255, instead if status else value)
        if not where[m]:
            some = np.flatnonzero(safe[m]) if "safe" in fields else safe[m][:0]
            # 65536 tells inputs that are clear from those that are safe.
            each = [*some.tolist(), *(np.flatnonzero(clear[m]) + 65536).tolist()]
            said += b"".join(struct.pack("<BI", 0, j) for j in each)
        out.append(said)
    if problem.sensing.remembers and left:
        rows, *ends = table.image_cells(states, wanted, step)
        for m, first, last in zip(rows.tolist(), *ends, strict=True):
            each = [one & 0xFFFFFFFF for pair in zip(first.tolist(), last.tolist(), strict=True) for one in pair]
            out[m] += b"" if where[m] else b"".join(struct.pack("<BI", 0, one) for one in each)
    return out


def location_status(table: CertifiedTable, states: FloatArray) -> FloatArray:
    """Where states (M, ndim) are: 0 on the grid, else `OFF_GRID` or `PAST_SAFE_END`."""
    below, above = table.past_ends(states)
    # as `sdhj_place_of` says it
    safe = table.grid.ends_where("frees")
    # past an end that is not safe is off the grid, whatever the other axes say
    past = (below & safe[0]) | (above & safe[1])
    off = (below | above).any(axis=1)
    return np.where(
        ((below | above) & ~past).any(axis=1), STATUS["OFF_GRID"], np.where(off, STATUS["PAST_SAFE_END"], 0)
    )


# ---- the header of a robot


def c_comment(text: str) -> str:
    """The text with "_" for what is not printable ASCII, or might end or upset a comment of C."""
    return "".join(one if one.isascii() and one.isprintable() and one not in '*/\\"?' else "_" for one in text)


def checked_in_c(table: CertifiedTable) -> list[str]:
    """Lines of a comment of C: how many of the table's claims were checked."""
    looked, made = table.details.get("checked", (0, 0))
    more = "; `sdhj verify` checks all" if looked < made else ""
    return [f" * {looked:,} of {made:,} claims of the table were checked at its solve{more}"] * (made > 0)


def header_of(table: CertifiedTable, data: bytes, fields: Sequence[str], rule: str, brake: int) -> str:
    """The text of `sdhj_robot.h`: the constants of the robot and of its file `data`."""
    problem, grid, inputs, arrived = table.problem, table.grid, table.problem.inputs, arrived_in_c(table.problem)
    name, *axes = map(c_comment, (problem.name, *grid.names))
    # The digest that `file_of` writes there, which C compares when it opens a table.
    digest = [f"0x{byte:02x}" for byte in data[128:160]]
    # 17 digits, so that each number is the same to the bit in C.
    rows = [", ".join(format(float(x), ".17g") for x in row) for row in inputs]
    lines = [
        f"/* The robot of sdhj_table.bin: {name}. Written by `sdhj export`; do not edit.",
        " *",
        f" * state: {', '.join(axes)}, in the problem's units (by convention metres, radians, seconds)",
        f" * the file answers {', '.join(fields)}; sdhj_select prefers by the rule {rule!r}",
        f" * problem {problem.digest}",
        *checked_in_c(table),
        " */",
        "#ifndef SDHJ_ROBOT_H",
        "#define SDHJ_ROBOT_H",
        "",
        "#include <stdint.h>",
        *(["#ifndef SDHJ_NO_FLOAT", "#include <math.h>", "#endif"] if arrived else []),
        "",
        f"#define SDHJ_ROBOT_AXES {grid.ndim}",
        f"#define SDHJ_ROBOT_INPUTS {inputs.shape[0]}",
        f"#define SDHJ_ROBOT_COMPONENTS {inputs.shape[1]} /* of an input */",
        f"#define SDHJ_ROBOT_MASK_BYTES {-(-len(inputs) // 8)} /* of inputs as bits */",
        f"#define SDHJ_ROBOT_STEPS {table.steps}",
        f"#define SDHJ_ROBOT_TIMELESS {int(problem.time_invariant)} /* 1: steps are ignored, a loop may have no end */",
        f"#define SDHJ_ROBOT_BRAKE {brake} /* the input to apply where nothing is proved */",
        f"#define SDHJ_ROBOT_REMEMBERS {int(problem.sensing.remembers)} /* 1: the loop is sdhj_step, with a memory */",
        f"#define SDHJ_ROBOT_ARRIVES {int(bool(arrived))} /* 1: table.arrived = sdhj_robot_arrived, once it is open */",
        f"#define SDHJ_ROBOT_BYTES {len(data)}u /* of the file */",
        *(f"#define SDHJ_ROBOT_CELLS_{axis} {count} /* of {axes[axis]} */" for axis, count in enumerate(table.shape)),
        "",
        f"static const double sdhj_robot_delta = {problem.delta!r}; /* seconds from step to step */",
        f"static const double sdhj_robot_inputs[{inputs.shape[0]}][{inputs.shape[1]}] = {{",
        *(f"    {{{row}}}," for row in rows),
        "};",
        "static const uint8_t sdhj_robot_digest[32] = {",
        *(f"    {', '.join(digest[at : at + 8])}," for at in range(0, 32, 8)),
        "};",
        "",
        *(["#ifndef SDHJ_NO_FLOAT", *arrived, "#endif", ""] if arrived else []),
        "#endif",
    ]
    return "\n".join(lines) + "\n"


# ---- the C, called from Python

CALLS = """#include "sdhj.h"
size_t x_size(void) { return sizeof(sdhj_table); }
int x_open(void *t, const void *bytes, size_t size, const uint8_t *digest) {
  const int status = sdhj_open((sdhj_table *)t, bytes, size, digest);
  ((sdhj_table *)t)->arrived = ARRIVED;
  return status;
}
uint32_t x_selftest(const void *t) { return sdhj_selftest((const sdhj_table *)t); }
void x_ask(const void *table, int what, int first, uint32_t step, const double *states, size_t count,
           const uint32_t *wanted, const double *commands, int32_t *status, uint32_t *value, uint8_t *masks) {
  sdhj_table own = *(const sdhj_table *)table;
  const sdhj_table *t = &own;
  size_t i;
  if (first) own.leads = 0; /* no loop has begun: a copy that knows of none looks up the same places */
  for (i = 0; i < count; i++) {
    const double *q = states + i * t->axes;
    uint8_t *bits = masks + i * t->mask;
    if (what == 0) status[i] = sdhj_steps_to_go(t, step, q, value + i);
    if (what == 1) status[i] = sdhj_select(t, step, q, value + i);
    if (what == 2) status[i] = sdhj_fallback(t, step, q, value + i);
    if (what == 3) status[i] = sdhj_filter(t, step, q, wanted[i], value + i);
    if (what == 4) status[i] = sdhj_filter_command(t, step, q, commands + i * t->components, value + i);
    if (what == 5) status[i] = sdhj_safe_inputs(t, step, q, bits);
    if (what == 6) status[i] = sdhj_clear_inputs(t, step, q, bits);
  }
}
"""
LOOP = """
size_t x_memory(void) { return sizeof(sdhj_memory); }
void x_step(const void *table, void *memories, uint32_t step, const double *measurements, size_t count,
            const uint32_t *wanted, int32_t *status, uint32_t *value, double *points, uint8_t *missed) {
  const sdhj_table *t = (const sdhj_table *)table;
  sdhj_memory *memory = (sdhj_memory *)memories;
  size_t i;
  for (i = 0; i < count; i++) {
    const double *q = measurements + i * t->axes;
    if (wanted == NULL) status[i] = sdhj_step(t, memory + i, step, q, value + i);
    else status[i] = sdhj_step_filter(t, memory + i, step, q, wanted[i], value + i);
    memcpy(points + i * t->axes, memory[i].point, t->axes * sizeof(double));
    missed[i] = (uint8_t)memory[i].missed;
  }
}
"""
QUESTIONS = ("steps_to_go", "select", "fallback", "filter", "filter_command", "safe_inputs", "clear_inputs")


class Exported:
    """An exported table, whose methods ask the C of `sdhj.h` about states (M, ndim) at a step.

    A method for each of `QUESTIONS` returns the status of every state, (M,), 0 where the answer counts (`sdhj.h`
    has the others), and the answers: (M,) int of `steps_to_go`, `select`, `fallback`, `filter` and `filter_command`,
    (M, L) bool of `safe_inputs` and `clear_inputs`. OSError where there is no C compiler.
    """

    def __init__(self, folder: Path, table: CertifiedTable) -> None:
        """Read the file in a folder to which `table` has been exported."""
        self.folder, self.table = folder, table
        self.data = (folder / "sdhj_table.bin").read_bytes()

    @property
    def nbytes(self) -> int:
        """The bytes of `sdhj_table.bin`."""
        return len(self.data)

    def ask(
        self, what: str, states: FloatArray, step: int = 0, wanted: Any = None, *, first: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """The status (M,) and the answers of the C to one of `QUESTIONS`, for states (M, ndim) at a step.

        Parameters
        ----------
        what : str
            One of `QUESTIONS`.
        states : (M, ndim) array
        step : int
            Not used where nothing depends on time.
        wanted : array, optional
            For "filter" indices (M,), for "filter_command" commands (M, m), or one for all states; by default 0.
        first : bool
            Of a table for a controller that remembers, whether all states are first measurements of loops; `loop`
            carries points on.

        Raises
        ------
        OSError
            Without a C compiler.
        """
        # As C reads them by a pointer.
        given = np.ascontiguousarray(np.atleast_2d(states), np.float64)
        inputs, count = self.table.problem.inputs, len(given)
        if given.ndim != 2 or given.shape[1] != self.table.grid.ndim:
            raise ValueError(f"states must have shape (M, {self.table.grid.ndim}), got {given.shape}")
        index, command = np.zeros(count, np.uint32), np.zeros((count, inputs.shape[1]))
        if wanted is not None:
            target = index if what == "filter" else command
            target[:] = wanted
        status, value = np.empty(count, np.int32), np.zeros(count, np.uint32)
        masks = np.zeros((count, -(-len(inputs) // 8)), np.uint8)
        # of the types and in the order of the arguments of x_ask, which ctypes does not check
        arrays = [ctypes.c_void_p(part.ctypes.data) for part in (given, index, command, status, value, masks)]
        library, opened = self._opened
        library.x_ask(
            *(opened, QUESTIONS.index(what), int(first), ctypes.c_uint32(step)),
            *(arrays[0], ctypes.c_size_t(count), *arrays[1:]),
        )
        if what.endswith("inputs"):
            return status, np.unpackbits(masks, axis=1, count=len(inputs), bitorder="little").astype(bool)
        return status, value.astype(np.int64)

    def __getattr__(self, name: str) -> Any:
        """One of `QUESTIONS` as a function that calls `ask`."""
        if name not in QUESTIONS:
            raise AttributeError(name)
        return partial(self.ask, name)

    def loop(self, count: int) -> "Loop":
        """The control loops of `count` robots, with empty memories, of a table for controllers that remember."""
        if not self.table.problem.sensing.remembers:
            raise ValueError("only tables solved with Sensing(..., memory=True) have a loop; ask select and filter")
        return Loop(self, count)

    def selftest(self) -> int:
        """For how many of the `TESTS` states in the file the C answers otherwise than Python did."""
        library, opened = self._opened
        library.x_selftest.restype = ctypes.c_uint32
        return int(library.x_selftest(opened))

    @cached_property
    def _opened(self) -> tuple[Any, Any]:
        """The loaded library and the opened table, made at first use."""
        compiler = os.environ.get("CC") or next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
        if compiler is None:
            raise OSError("no C compiler was found; install gcc or clang, or name one in the environment variable CC")
        with TemporaryDirectory() as folder:
            source, library = Path(folder, "calls.c"), Path(folder, "calls.so")
            arrived = arrived_in_c(self.table.problem)
            lines = ["#include <math.h>", "#include <stdint.h>", *arrived] if arrived else []
            lines.append(f"#define ARRIVED {'sdhj_robot_arrived' if arrived else 'NULL'}\n")
            source.write_text("\n".join(lines) + CALLS + LOOP)
            command = [compiler, *FLAGS, f"-I{self.folder}", str(source), "-o", str(library)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise OSError(f"{compiler} cannot compile sdhj.h: {done.stderr[:500]}")
            loaded: Any = ctypes.CDLL(str(library))
        loaded.x_size.restype = loaded.x_memory.restype = ctypes.c_size_t
        opened = ctypes.create_string_buffer(loaded.x_size())
        # C reads the table in these bytes and makes no copy.
        kept = ctypes.create_string_buffer(self.data, len(self.data))
        if loaded.x_open(opened, kept, ctypes.c_size_t(len(self.data)), self.data[128:160]) != 0:
            raise ValueError(f"sdhj_open refuses {self.folder / 'sdhj_table.bin'}: export it anew")
        self._kept = kept  # the table points into it
        return loaded, opened


class Loop:
    """The control loops of M robots in C, each with a memory of its own (`sdhj_step`)."""

    def __init__(self, exported: Exported, count: int) -> None:
        self.exported, self.count = exported, count
        self.memories = np.zeros((count, exported._opened[0].x_memory()), np.uint8)

    def step(self, measurements: FloatArray, step: int = 0, wanted: Any = None) -> tuple[FloatArray, ...]:
        """Answer the measurements (M, ndim) of all robots at a step, and carry their memories on.

        By `sdhj_step` or, where the indices of inputs (M,) are `wanted`, by `sdhj_step_filter`. Returns the status
        (M,), the inputs (M,), the points (M, ndim) that are carried on, and whether a measurement broke what the memory
        had promised.
        """
        given = np.ascontiguousarray(measurements, np.float64)
        if given.shape != (self.count, self.exported.table.grid.ndim):
            raise ValueError(f"measurements must have shape {(self.count, self.exported.table.grid.ndim)}")
        status, value, missed = np.empty(self.count, np.int32), np.empty(self.count, np.uint32), given[:, 0] > np.inf
        points = np.empty_like(given)
        asked = None if wanted is None else np.ascontiguousarray(wanted, np.uint32)
        if asked is not None and asked.shape != (self.count,):  # the C reads so many
            raise ValueError(f"wanted must have shape {(self.count,)}, got {asked.shape}")
        library, opened = self.exported._opened
        # likewise for x_step, which writes `missed` as bytes: it is an array of bool, False at first
        arrays = [ctypes.c_void_p(one.ctypes.data) for one in (self.memories, given, status, value, points, missed)]
        pointer = None if asked is None else ctypes.c_void_p(asked.ctypes.data)
        library.x_step(
            opened, arrays[0], ctypes.c_uint32(step), arrays[1], ctypes.c_size_t(self.count), pointer, *arrays[2:]
        )
        return status, value.astype(np.int64), points, missed
