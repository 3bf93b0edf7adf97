"""Maps and polygons: against brute-force distances, what they claim of slope and bounds, files good and bad."""

import io
import itertools
import math
import os
import socket
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import naive_maps
import numpy as np
import pytest
import shapely
import zoo
from parameters import but_slow
from PIL import Image
from room import room

import sdhj
from sdhj import UnsafeSet
from sdhj.certified import Certified
from sdhj.certified.check import stated, verify
from sdhj.formulas import graph
from sdhj.formulas.graph import ordered
from sdhj.problem import problem as problem_module
from sdhj.problem.shapes.maps import BYTES_A_PIXEL, distances_at_nodes
from sdhj.table import files

GREY = {"free": 254, "occupied": 0, "unknown": 205}
YAML = """image: map.pgm
mode: trinary
resolution: 0.05
origin: [-0.4, -0.6, 0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def flat() -> np.ndarray:
    """A flat as a robot maps it, (24, 32) grey: walls of one pixel, a door, a pillar, and what no beam has reached."""
    pixels = np.full((24, 32), GREY["unknown"], np.uint8)
    pixels[2:22, 3:30] = GREY["free"]
    pixels[2:22, [3, 29]] = pixels[[2, 21], 3:30] = GREY["occupied"]
    pixels[2:22, 16] = GREY["occupied"]  # one pixel wide
    pixels[9:15, 16] = GREY["free"]  # the door in it
    pixels[6, 8] = GREY["occupied"]  # a pillar of one pixel
    return pixels


def binary_pgm(pixels: np.ndarray, most: int = 255) -> bytes:
    kind = ">u2" if most > 255 else "u1"
    return b"P5\n# made by a test\n%d %d\n%d\n" % (*pixels.shape[::-1], most) + pixels.astype(kind).tobytes()


def plain_pgm(pixels: np.ndarray) -> bytes:
    rows = "\n".join(" ".join(map(str, row)) for row in pixels)
    return f"P2\n# made by a test\n{pixels.shape[1]} {pixels.shape[0]}\n255\n{rows}\n".encode()


def png(width: int, height: int, data: bytes, *more: tuple[bytes, bytes]) -> bytes:
    """A PNG in grey of that data, with more chunks before it."""
    header = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    chunks = [(b"IHDR", header), *more, (b"IDAT", zlib.compress(data)), (b"IEND", b"")]
    whole = (
        len(held).to_bytes(4, "big") + kind + held + zlib.crc32(kind + held).to_bytes(4, "big") for kind, held in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(whole)


LONGEST = 1.0  # s of this process, in which what is hostile is refused


@contextmanager
def refused_soon(said: str) -> Iterator[None]:
    """A ValueError of one short line, before much time or memory is taken."""
    began = time.process_time()
    with pytest.raises(ValueError, match=said) as refused:
        yield
    assert time.process_time() - began < LONGEST
    assert str(refused.value).isprintable() and len(str(refused.value)) < 1000


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """A function that writes a map, its picture and its YAML with some lines changed, and gives the YAML's path."""

    def write(picture: bytes | None = None, **changes: str | None) -> Path:
        (tmp_path / "map.pgm").write_bytes(binary_pgm(flat()) if picture is None else picture)
        told = dict(line.split(": ", 1) for line in YAML.splitlines()) | changes
        text = "".join(f"{key}: {value}\n" for key, value in told.items() if value is not None)
        (tmp_path / "map.yaml").write_text(text, encoding="utf-8")
        return tmp_path / "map.yaml"

    return write


def some_points(rng: np.random.Generator, blocked: np.ndarray, side: float, count: int) -> np.ndarray:
    """In and around the map's own frame: anywhere, on the nodes of the half pixels, and within a rounding of those."""
    size = np.array(blocked.shape[::-1]) * side
    anywhere = rng.uniform(-0.3 * size, 1.3 * size, (count, 2))
    nodes = rng.integers(0, 2 * np.array(blocked.shape[::-1]) + 1, (count, 2)) * side / 2
    return np.concatenate([anywhere, nodes, nodes + rng.uniform(-1e-12, 1e-12, nodes.shape)])


@pytest.mark.parametrize("seed", range(3))
def test_distances_at_the_nodes_are_exact(seed: int) -> None:
    rng, side = np.random.default_rng(seed), 0.3
    blocked = rng.random((rng.integers(1, 7), rng.integers(1, 7))) < rng.random()
    blocked[0, 0] = False
    nodes = distances_at_nodes(blocked, side)
    assert nodes.shape == (2 * blocked.shape[1] + 1, 2 * blocked.shape[0] + 1)
    for (i, j), value in np.ndenumerate(nodes):
        told = naive_maps.signed_distance(i * side / 2, j * side / 2, blocked.tolist(), side)
        assert abs(value - told) < 1e-12


@pytest.mark.parametrize(("seed", "yaw"), [(0, 0.0), (1, 0.7), (2, 0.7)])
def test_a_map_is_seen_whole_and_not_much_larger(seed: int, yaw: float) -> None:
    """<= 0 wherever the robot's disk meets a blocked square; at most the half diagonal of a pixel below the truth."""
    rng, side, radius, origin = np.random.default_rng(seed), 0.2, 0.11, np.array([1.3, -2.1])
    blocked = rng.random((7, 9)) < 0.3
    part = UnsafeSet.from_map(blocked, (0, 1), resolution=side, origin=(*origin, yaw), radius=radius)
    local = some_points(rng, blocked, side, 150)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    values = part.level_set(local @ turn.T + origin, 0.0)
    truth = np.array([naive_maps.signed_distance(x, y, blocked.tolist(), side) for x, y in local]) - radius
    assert (values <= truth + 1e-12).all()
    within = ((local >= 0) & (local <= np.array(blocked.shape[::-1]) * side)).all(axis=1)
    assert within.sum() > 150 and (~within).sum() > 50
    assert (values[within] >= truth[within] - side / np.sqrt(2) - 1e-12).all()
    assert (values[~within] < 0).all()
    assert not part.moving and part.axes == (0, 1)


def test_what_is_claimed_of_the_slope_holds_and_is_not_idle(rng: np.random.Generator) -> None:
    """sqrt(2) in any direction and 1 along an axis, also across the map's edge; at a corner it is reached."""
    blocked = rng.random((12, 12)) < 0.25
    part = UnsafeSet.from_map(blocked, resolution=0.1)
    steepest, along = 0.0, 0.0
    for step in (1e-4, 0.02, 0.3):
        points, angle = rng.uniform(-0.3, 1.5, (40_000, 2)), rng.uniform(0, 2 * np.pi, 40_000)
        for direction in (np.stack([np.cos(angle), np.sin(angle)], axis=1), np.eye(2)[rng.integers(0, 2, 40_000)]):
            change = np.abs(part.level_set(points + step * direction, 0.0) - part.level_set(points, 0.0)).max() / step
            straight = (direction == 0).any()
            steepest, along = max(steepest, change), max(along, change if straight else 0.0)
    assert 1.3 < steepest <= np.sqrt(2) + 1e-9
    assert 0.99 < along <= 1.0 + 1e-9


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_bounds_of_a_map_are_no_wider_than_its_slopes(yaw: float, rng: np.random.Generator) -> None:
    """A turned box is wider by the sine and the cosine; the slope along an axis of the map is 1."""
    part = UnsafeSet.from_map(rng.random((15, 20)) < 0.2, resolution=0.1, origin=(0.3, -0.2, yaw))
    formula = part.level_set
    assert len(ordered(formula.outputs)) <= 26
    for width in (0.0, 0.01, 0.3):
        low = rng.uniform(-1.0, 2.5, (2000, 2))
        least, greatest = formula.bounds(low, low + width, (0.0, 0.0))
        for _ in range(20):
            values = formula(low + width * rng.random(low.shape), 0.0)
            assert (least <= values).all() and (values <= greatest).all()
        past = 2.0  # outside the map the table's value and the distance to the map may change, both by this much
        assert (greatest - least <= past * 2 * width * (np.cos(yaw) + np.sin(yaw)) + 1e-12).all()


def test_one_pixel_is_seen_from_everywhere() -> None:
    """A wall of one pixel, and a pillar: not a point of them is free, and half a pixel's diagonal beside them is."""
    side = 0.05
    blocked = flat() != GREY["free"]
    part = UnsafeSet.from_map(blocked, resolution=side)
    across = np.linspace(12.0, 20.0, 2001) * side
    values = part.level_set(np.stack([across, np.full(2001, 5.3 * side)], axis=1), 0.0)
    wall = (across >= 16 * side) & (across <= 17 * side)
    assert (values[wall] <= 0).all()
    assert (values[(across < (16 - 0.71) * side) | (across > (17 + 0.71) * side)] > 0).all()
    door = part.level_set(np.array([[16.5 * side, 12.0 * side]]), 0.0)  # rows 9 to 14 from the top, of 24
    assert door[0] == pytest.approx(3 * side - side / np.sqrt(8))  # on a node: less the allowance alone
    assert part.level_set(np.array([[8.5 * side, 17.5 * side]]), 0.0)[0] < 0  # the pillar, row 6 from the top


@pytest.mark.parametrize("make", [binary_pgm, plain_pgm, lambda pixels: binary_pgm(pixels * 257.0, 65535)])
def test_a_file_is_its_array(written: Callable[..., Path], make: Any, rng: np.random.Generator) -> None:
    array = UnsafeSet.from_map(flat() != GREY["free"], resolution=0.05, origin=(-0.4, -0.6), radius=0.1)
    file = UnsafeSet.from_map(str(written(make(flat()))), axes=(0, 1), radius=0.1)
    points = rng.uniform(-1, 2, (500, 2))
    np.testing.assert_array_equal(file.level_set(points, 0.0), array.level_set(points, 0.0))
    assert (array.level_set(points, 0.0) > 0).any()


def test_pictures_in_colour_and_upside_down(written: Callable[..., Path], tmp_path: Path) -> None:
    """PNG in grey, in colour and with pixels that are not opaque; `negate`; the rows are those of an image."""
    points = np.array([[x, y] for x in np.arange(-0.35, 1.2, 0.05) for y in np.arange(-0.55, 0.6, 0.05)])
    expected = UnsafeSet.from_map(written()).level_set(points, 0.0)
    colour = np.stack([flat()] * 3 + [np.full_like(flat(), 255)], axis=2)
    Image.fromarray(flat()).save(tmp_path / "grey.png")
    Image.fromarray(colour).save(tmp_path / "colour.png")
    Image.fromarray(255 - flat()).save(tmp_path / "negative.png")
    for changes in ({"image": "grey.png"}, {"image": "colour.png"}, {"image": "negative.png", "negate": "1"}):
        np.testing.assert_array_equal(UnsafeSet.from_map(written(**changes)).level_set(points, 0.0), expected)
    colour[12, 10, 3] = 254
    Image.fromarray(colour).save(tmp_path / "glass.png")
    glass = UnsafeSet.from_map(written(image="glass.png", mode="scale")).level_set(points, 0.0)
    hidden = [[-0.4 + 10.5 * 0.05, -0.6 + 11.5 * 0.05]]
    assert UnsafeSet.from_map(written()).level_set(np.array(hidden), 0.0)[0] > 0
    assert UnsafeSet.from_map(written(image="glass.png")).level_set(np.array(hidden), 0.0)[0] < 0
    assert (glass <= expected).all() and (glass < expected).any()


@pytest.mark.parametrize("mode", ["trinary", "scale", None])
def test_thresholds_are_the_map_servers(written: Callable[..., Path], mode: str | None) -> None:
    """Free is what is darker than free_thresh by less than nothing: at the threshold itself it is not free."""
    greys = np.array([[255, 206, 205, 204, 128, 0]], np.uint8)
    map_ = UnsafeSet.from_map(written(binary_pgm(greys), mode=mode, origin="[0, 0, 0]", free_thresh="0.196"))
    middles = np.stack([(np.arange(6) + 0.5) * 0.05, np.full(6, 0.025)], axis=1)
    assert ((map_.level_set(middles, 0.0) > 0) == [True, True, False, False, False, False]).all()
    exact = (255 - 205) / 255
    map_ = UnsafeSet.from_map(written(binary_pgm(greys), mode=mode, origin="[0, 0, 0]", free_thresh=repr(exact)))
    assert ((map_.level_set(middles, 0.0) > 0) == [True, True, False, False, False, False]).all()


def test_the_unknown_that_counts_as_free_is_told(written: Callable[..., Path]) -> None:
    with pytest.warns(UserWarning, match="counts the grey 205"):
        UnsafeSet.from_map(written(free_thresh="0.25"))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"resolution": None, "negate": None}, r"map\.yaml.*it lacks resolution, negate"),
        ({"resolution": "-0.05"}, "resolution"),
        ({"resolution": "fine"}, "resolution"),
        ({"resolution": ".inf"}, "resolution"),
        ({"resolution": "true"}, "resolution"),
        ({"resolution": "1e999"}, "resolution"),
        ({"origin": "[0, 0]"}, r"numbers, got \['0', '0'\]"),
        ({"origin": "[0, 0, north]"}, r"origin\[2\]"),
        ({"origin": "{x: 0}"}, "must be three numbers"),
        ({"mode": "raw"}, "mode"),
        ({"negate": "2"}, "negate"),
        ({"negate": "[]"}, "negate"),
        ({"free_thresh": "0.7"}, "occupied_thresh"),
        ({"image": "[map.pgm]"}, "name of a file"),
        ({"image": "none.pgm"}, "No such file"),
        ({"image": "map.yaml"}, "picture of a map"),
        ({"image": "[1, 2"}, "not the YAML file"),
    ],
)
def test_bad_files_are_named(written: Callable[..., Path], changes: dict[str, str | None], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        UnsafeSet.from_map(written(**changes))


@pytest.mark.parametrize(
    ("side", "negate"),
    [("1e-1", "0"), ("0.1", "false"), ("'0.1'", "No"), ("!!python/name:os.system 0.1", "off"), ("&a .1", "'0'")],
)
def test_numbers_are_those_of_today_s_yaml(written: Callable[..., Path], negate: str, side: str) -> None:
    """To YAML 1.1, which PyYAML reads, 1e-1 is a word."""
    points = np.array([[0.55, -0.05], [0.5, 0.5], [-1.0, 0.3]])
    expected = UnsafeSet.from_map(written(resolution="0.1")).level_set(points, 0.0)
    found = UnsafeSet.from_map(written(resolution=side, negate=negate)).level_set(points, 0.0)
    np.testing.assert_array_equal(found, expected)


PIXELS = flat().tobytes()
NOISE = np.random.default_rng(0).integers(0, 256, (40, 30), np.uint8)  # line ends among them
PICTURES = {
    "empty": (b"", "cannot identify"),
    "short": (b"P5\n4 4\n255\n12", "16 bytes.*4 x 4 pixels.* 2 "),
    "a pixel more": (binary_pgm(flat()) + b"\n", "768 bytes.*769"),
    "line ends of noise": (binary_pgm(NOISE).replace(b"\n", b"\r\n"), "bytes.*header"),
    "line ends without returns": (binary_pgm(np.tile([13, 10], (4, 4))).replace(b"\r\n", b"\n"), " 16 "),
    "a pixel less of 16 bits": (binary_pgm(flat() * 257.0, 65535)[:-2], "1,536 bytes"),
    "the maximum of 8 bits": (binary_pgm(flat() * 257.0, 65535).replace(b"65535", b"00255"), " 1,536 "),
    "bits": (b"P4\n9 2\n" + bytes(3), "4 bytes"),
    "colours": (b"P6\n2 2\n255\n" + bytes(4), "12 bytes"),
    "a word": (b"P2\n2 2\n255\n1 2 three 4\n", "invalid literal|Non-decimal"),
    "a number less": (b"P2\n2 2\n255\n1 2\n", "not enough"),
    "no width": (b"P5\n0 4\n255\n", r"\S"),
    "huge PGM": (b"P5\n999999999 999999999\n255\n", "too many|exceeds limit"),
    "huge PNG": (png(60_000, 60_000, b""), "too many|exceeds limit"),
    "bomb": (png(6_000, 6_000, b"\0" * 10), "6,000 x 6,000 pixels are too many"),
    "PNG cut short": (png(34, 34, NOISE.tobytes())[:600], r"\S"),
    "PNG of noise": (png(34, 34, NOISE.tobytes())[:60] + NOISE.tobytes(), r"\S"),
    "postscript": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "cannot identify"),
    "GIF": (b"GIF89a" + bytes(100), "cannot identify"),
}


@pytest.mark.parametrize("kind", PICTURES)
def test_bad_pictures_are_named(written: Callable[..., Path], tmp_path: Path, kind: str) -> None:
    picture, said = PICTURES[kind]
    with refused_soon(f"map\\.pgm is not a picture.*({said})"):
        UnsafeSet.from_map(written(picture))


def bomb_of_aliases() -> str:
    """A list of 9 lists of 9 lists..."""
    lines = ["a0: &a0 [0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 9)]
    return "\n".join(lines)


TEXTS = {
    "bombs in the origin": (bomb_of_aliases() + "\norigin: [*a8, *a8, *a8]\n", r"origin\[0\]"),
    "bomb as mode": (bomb_of_aliases() + "\nmode: *a8\n", "mode"),
    "itself": ("origin: &a [*a, 0, 0]\n", "recursive"),
    "brackets": ("origin: " + "[" * 3_800, "more than 100 brackets"),
    "dashes": ("origin:\n" + "- " * 1_900, "not the YAML file"),
    "a long name": ("image: " + "x" * 3_000, "File name too long"),
    "many numbers": ("origin: [" + "0, " * 1_000 + "0]", "origin.*three numbers"),
    "800,000 characters": ("image: " + "x" * 800_000, "has more than 4,096 bytes"),
    "a tag": ("origin: !!python/object/apply:os.system [exit 1]", "three numbers"),
    "escapes": ('image: "\\e[31m\\nred"', "not a picture"),
    "nothing in the name": ('image: "a\\0b"', "null (byte|character)"),
    "a byte of no text": ("image: \x00", "not the YAML file"),
    "two documents": ("--- 1\n--- 2\n", "single document"),
    "a list as a key": ("[1]: 2\n", "unhashable"),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_hostile_texts_are_refused_in_a_line_within_a_second(written: Callable[..., Path], kind: str) -> None:
    text, said = TEXTS[kind]
    path = written(**{word.split(":")[0]: None for word in text.splitlines() if ": " in word})
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")
    with refused_soon(said):
        UnsafeSet.from_map(path)


@pytest.mark.parametrize(
    ("kind", "part"),
    [
        *((kind, "yaml") for kind in ("folder", "zero", "null", "socket", "name", "dead link", "memory")),
        *itertools.product(("fifo", "sparse"), ("yaml", "image")),
    ],
)
def test_what_is_no_file_is_refused_at_once(written: Callable[..., Path], tmp_path: Path, kind: str, part: str) -> None:
    """A pipe would be waited for, a device read for ever."""
    path = tmp_path / "other"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(os.path.relpath(path))
    elif kind == "sparse":
        with open(path, "wb") as stream:
            stream.truncate(1 << 40)
    elif kind == "dead link":
        path.symlink_to(tmp_path / "nowhere")
    else:
        path = {"name": Path("x" * 800_000), "memory": Path("/proc/self/mem")}.get(kind, Path("/dev") / kind)
    wrong = "folder, a device or a pipe|has more than|File name too long|No such file|Input/output error"
    with refused_soon(wrong):
        UnsafeSet.from_map(path if part == "yaml" else written(image=str(path)[:60_000]))


def test_pixels_of_16_bits_that_are_transparent_are_not_free(written: Callable[..., Path], tmp_path: Path) -> None:
    sixteen, points = Image.fromarray(flat().astype(np.uint16) * 257), np.array([[0.05, 0.0]])
    sixteen.save(tmp_path / "sixteen.png")
    assert UnsafeSet.from_map(written(image="sixteen.png")).level_set(points, 0.0)[0] > 0
    sixteen.save(tmp_path / "glass.png", transparency=254 * 257)
    with pytest.raises(ValueError, match="no pixel"):
        UnsafeSet.from_map(written(image="glass.png"))


def test_pictures_in_files_that_map_servers_write(written: Callable[..., Path], tmp_path: Path) -> None:
    """A comment, bits, colours and BMP: the same map as from the PGM."""
    points = np.random.default_rng(1).uniform(-1, 2, (500, 2))
    expected = UnsafeSet.from_map(written()).level_set(points, 0.0)
    free = flat() == GREY["free"]
    colour = b"P6 32 24 255 " + np.stack([flat()] * 3, axis=2).tobytes()
    bits = b"P4\n32 24\n" + np.packbits(~free, axis=1).tobytes()
    plain = b"P1\n32 #columns\n24\n" + "\n".join("".join("01"[not one] for one in row) for row in free).encode()
    commented = b"P5\n#made\n#by\n\n32 #columns\r24 #rows\n 255\n" + PIXELS
    bmp = io.BytesIO()
    Image.fromarray(flat()).save(bmp, "BMP")
    for picture in (colour, bits, plain, commented, bmp.getvalue()):
        np.testing.assert_array_equal(UnsafeSet.from_map(written(picture)).level_set(points, 0.0), expected)


def test_maps_have_one_limit_that_is_said_before_anything_is_taken(written: Callable[..., Path]) -> None:
    """The checker imports nothing of the rest, so it states the limit itself."""
    assert stated.MOST_TABLES == graph.MOST_TABLES
    side = math.isqrt(graph.MOST_TABLES // 32)
    with refused_soon(r"5,793 x 5,792 pixels are too many: .* takes 1,07\d,\d{3},\d{3} bytes.*at most 1,073,741,824"):
        UnsafeSet.from_map(np.broadcast_to(False, (side, side + 1)), resolution=0.1)
    with refused_soon("too many"):
        UnsafeSet.from_map(written(b"P5\n%d %d\n255\n" % (side + 1, side)))
    with refused_soon(r"a table of shape \(9, 99999999\) takes 7,199,999,928 bytes, .*use fewer nodes"):
        sdhj.gridded(np.broadcast_to(0.0, (9, 99999999)), [0.0, 0.0], [1.0, 1.0])


def yard(*unsafe: UnsafeSet) -> sdhj.ReachAvoidProblem:
    """A robot on a square of 4 m."""
    grid = sdhj.Grid([0, 0], [4, 4], [21, 21])
    return zoo.walk(grid=grid, target=zoo.goal(2.0, 2.0, 0.5), unsafe=unsafe, steps=2)


@pytest.mark.slow
def test_the_tables_of_a_problem_count_together_for_all_who_read_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two maps of 20 x 20 pixels, of 13,448 bytes each; the same map, moved, is one table, and read as one."""
    blocked = np.zeros((20, 20), bool)
    blocked[10, 3] = True
    one, moved = (UnsafeSet.from_map(blocked, resolution=0.2, origin=(x, 0.0), name=f"at {x}") for x in (0.0, 0.001))
    other = UnsafeSet.from_map(blocked.T, resolution=0.2, name="other")
    monkeypatch.setattr(problem_module, "MOST_TABLES", 20_000)
    with pytest.raises(ValueError, match="take 26,896 bytes together"):
        yard(one, other)
    assert len(yard(one, moved).texts[1]) == 1
    monkeypatch.setattr(problem_module, "MOST_TABLES", 26_896)
    path = tmp_path / "two.npz"
    sdhj.solve(yard(one, other), Certified(cells=[20, 20]), play=False).save(path)
    for reader, read in ((files, sdhj.load), (stated, partial(verify, progress=False))):
        monkeypatch.setattr(reader, "MOST_TABLES", 26_896)
        read(path)
        monkeypatch.setattr(reader, "MOST_TABLES", 26_895)
        with pytest.raises(ValueError, match="tables/1"):
            read(path)


@pytest.mark.slow
def test_a_large_map_is_saved_loaded_and_verified(tmp_path: Path) -> None:
    """Of 2,100 x 2,100 pixels: its table takes 141 MB."""
    blocked = np.zeros((2100, 2100), bool)
    blocked[300:500, 700:900] = True
    table = sdhj.solve(yard(UnsafeSet.from_map(blocked, resolution=4 / 2100)), Certified(cells=[40, 40]), play=False)
    table.save(tmp_path / "large.npz")
    loaded, q = sdhj.load(tmp_path / "large.npz"), np.random.default_rng(0).uniform(0, 4, (1000, 2))
    np.testing.assert_array_equal(loaded.contains(q), table.contains(q))
    assert loaded.fraction() > 0.02 and verify(tmp_path / "large.npz", progress=False).ok


@pytest.mark.slow
def test_threads_save_and_load_at_once(tmp_path: Path) -> None:
    """Also where one writes over the file that another reads."""
    office = UnsafeSet.from_map(np.eye(20, dtype=bool)[::-1], resolution=0.2)
    tables = [sdhj.solve(yard(office), method, play=False) for method in ("hji", "lax", Certified(cells=[20, 20]))]
    for place, table in enumerate(tables):
        table.save(tmp_path / f"{place}.npz")

    def at_work(task: int) -> None:
        place = task % len(tables)
        path, table = tmp_path / f"{place}.npz", tables[place]
        for _ in range(5):
            if task < 2 * len(tables):
                table.save(path if task < len(tables) else tmp_path / f"{place} again.npz")
            np.testing.assert_array_equal(sdhj.load(path).values(start=0), table.values(start=0))

    with ThreadPoolExecutor(9) as pool:
        list(pool.map(at_work, range(3 * len(tables))))


def test_a_store_keeps_its_maps_as_arrays(tmp_path: Path) -> None:
    """As text in the head, a map took thousands of bytes a pixel; what is not the map of the solve is refused."""
    blocked = np.zeros((100, 100), bool)
    blocked[30:40, 30:60] = True
    table = sdhj.solve(yard(UnsafeSet.from_map(blocked, resolution=0.04)), store=tmp_path / "a", progress=False)
    q = np.random.default_rng(0).uniform(0, 4, (300, 2))
    np.testing.assert_array_equal(sdhj.load(tmp_path / "a").contains(q), table.contains(q))
    assert (tmp_path / "a" / "problem.json").stat().st_size < 20_000
    (tmp_path / "a" / "tables.0.npy").unlink()
    with pytest.raises(sdhj.TableFileError, match="damaged"):
        sdhj.load(tmp_path / "a")


def test_memory_is_stated_before_it_is_taken(written: Callable[..., Path]) -> None:
    said = r"4,000 x 3,000 pixels.* 1\.56 GB.* 0\.268 GB.*scale"
    for source, side in ((np.broadcast_to(False, (3000, 4000)), 0.1), (written(b"P5\n4000 3000\n255\n"), None)):
        began = time.perf_counter()
        with room(2**28), pytest.raises(MemoryError, match=said):
            UnsafeSet.from_map(source, resolution=side)
        assert time.perf_counter() - began < LONGEST


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peaks of memory are told by Linux")
def test_a_map_takes_no_more_memory_than_is_stated() -> None:
    """From the pixels to a table that is asked; in a process of its own, whose peak is set back."""
    code = """
import gc, sys, numpy as np, sdhj, tempfile
def now(what):
    return next(1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith(what))
speeds = 0.5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
def asked(n, path):
    blocked = np.random.default_rng(0).random((n, n)) < 1e-4
    before = now("VmRSS")
    open("/proc/self/clear_refs", "w").write("5")
    office = sdhj.UnsafeSet.from_map(blocked, resolution=4 / n)
    target = sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 2, p[:, 1] - 2) - 0.5)
    dynamics = sdhj.Dynamics(speeds, speeds, np.eye(2), [0.1, 0.1])
    problem = sdhj.ReachAvoidProblem(sdhj.Grid([0, 0], [4, 4], [41, 41]), dynamics, target, [office], 0.25, 3)
    del office
    table = sdhj.solve(problem)
    table.save(path)
    del table, problem
    gc.collect()
    sdhj.Controller(sdhj.load(path)).steps_to_go([2.0, 2.0], 0)
    return (now("VmHWM") - before) / n**2
with tempfile.TemporaryDirectory() as folder:
    asked(20, folder + "/small.npz")
    print(asked(1500, folder + "/large.npz"))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True)
    assert 32.0 < float(done.stdout) < BYTES_A_PIXEL


def test_what_is_no_map_is_refused(written: Callable[..., Path], tmp_path: Path) -> None:
    free = np.zeros((3, 3), bool)
    with pytest.raises(ValueError, match="not the YAML file"):
        UnsafeSet.from_map(tmp_path / "absent.yaml")
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(ValueError, match=r"list\.yaml.*it has no keys"):
        UnsafeSet.from_map(tmp_path / "list.yaml")
    with pytest.raises(ValueError, match=r"map\.yaml' is free"):
        UnsafeSet.from_map(written(binary_pgm(np.zeros((4, 4)))))
    with pytest.raises(ValueError, match="map 'office' is free"):
        UnsafeSet.from_map(~free, resolution=0.1, name="office")
    for array in (free.astype(int), free[0], free[:0]):
        with pytest.raises(ValueError, match=r"bool array \(rows, columns\)"):
            UnsafeSet.from_map(array, resolution=0.1)
    with pytest.raises(ValueError, match="resolution"):
        UnsafeSet.from_map(free)
    with pytest.raises(ValueError, match="origin "):
        UnsafeSet.from_map(free, resolution=0.1, origin=(0.0,))
    with pytest.raises(ValueError, match="radius"):
        UnsafeSet.from_map(free, resolution=0.1, radius=-1)
    for make in (partial(UnsafeSet.from_map, free, resolution=1.0), partial(UnsafeSet.polygon, SHAPE)):
        with pytest.raises(ValueError, match="axes of the grid"):
            make(axes=(0,))


def test_pillow_missing_is_named(written: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(ImportError, match=r"Pillow.*sdhj\[maps\]"):
        UnsafeSet.from_map(written())


# ---- polygons

SHAPE = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 0.4], [0.0, 1.5]]  # not convex


def test_a_polygon_has_its_signed_distance_less_a_radius(rng: np.random.Generator) -> None:
    part = UnsafeSet.polygon(SHAPE, axes=(0, 1), radius=0.25, name="table")
    points = rng.uniform(-1, 3, (2000, 2))
    values = part.level_set(points, 0.0)
    truth = [naive_maps.to_polygon(x, y, SHAPE) - 0.25 for x, y in points]
    np.testing.assert_allclose(values, truth, rtol=0, atol=1e-12)
    assert (values < -0.25).any() and part.name == "table" and not part.moving
    beside = points + 1e-3 * rng.standard_normal(points.shape)
    change = np.abs(part.level_set(beside, 0.0) - values) / np.linalg.norm(beside - points, axis=1)
    assert 0.99 < change.max() <= 1.0 + 1e-9


def any_polygon(rng: np.random.Generator, count: int, places: float) -> np.ndarray:
    """A triangle to which corners are added anywhere (on a lattice, if `places` is small) as long as no edges meet."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for _ in range(400):
        more = np.insert(corners, rng.integers(len(corners)), np.round(rng.random(2) * places) / places, axis=0)
        if len(corners) < count and shapely.Polygon(more).is_valid:
            corners = more
    return corners[:: rng.choice([-1, 1])]


ANGLES = np.linspace(0.0, 6 * np.pi, 60)[:, None]
SPIRAL = np.concatenate([(1 + ANGLES / 9) * np.hstack([np.cos(ANGLES), np.sin(ANGLES)]) * share for share in (1, 0.9)])
SPIRAL[60:] = SPIRAL[:59:-1]  # out along the one, back along the other
COMB = [[k // 2 * 2 + k % 2, 3.0 if (k // 2) % 2 else 0.0] for k in range(20)] + [
    [19.0, -1.0],
    [0.0, -1.0],
]  # even tips
DOUBLE = [
    [0, 0],
    [0, 0],
    [1, 0],
    [2, 0],
    [2, 1],
    [2, 1],
    [1, 1],
    [0.5, 1],
    [0, 1],
    [0, 0],
]  # corners twice, or straight


@pytest.mark.parametrize("seed", but_slow(["spiral", "comb", "double", *range(12)], "spiral", *range(3, 12)))
def test_polygons_of_every_shape_are_formulas(seed: Any, rng: np.random.Generator) -> None:
    """Signed distances to the last digits; away from edges bounds say outside, and inside where there is one part."""
    if isinstance(seed, int):
        rng = np.random.default_rng(seed)
        vertices = any_polygon(rng, int(rng.integers(3, 25)), [4.0, 10.0, 2.0**40][seed % 3])
    else:
        vertices = np.array({"spiral": SPIRAL, "comb": COMB, "double": DOUBLE}[seed], dtype=float)
    formula = UnsafeSet.polygon(vertices).level_set
    size = np.ptp(vertices, axis=0)
    points = vertices.min(axis=0) + size * rng.uniform(-0.3, 1.3, (600, 2))
    points[:300] = np.round(points[:300] * 20) / 20  # also on lines of edges
    values = formula(points, 0.0)
    corners = vertices[(vertices != np.roll(vertices, -1, axis=0)).any(axis=1)].tolist()
    truth = [naive_maps.to_polygon(x, y, corners) for x, y in points]
    np.testing.assert_allclose(values, truth, rtol=0, atol=1e-13 * size.max())
    assert len(ordered(formula.outputs)) <= 36 * len(
        corners
    )  # three edges and a box for each of two triangles fewer than corners
    width = 0.02 * size.max()
    least, greatest = formula.bounds(points - width / 2, points + width / 2, (0.0, 0.0))
    beside = formula(points + width * rng.uniform(-0.5, 0.5, points.shape), 0.0)
    assert (least <= beside).all() and (beside <= greatest).all()
    assert (least > 0)[values > 1.5 * width].all()
    shape = shapely.Polygon(vertices)
    assert not shape.convex_hull.equals(shape) or (greatest < 0)[values < -1.5 * width].all()


@pytest.mark.parametrize(
    ("vertices", "said"),
    [
        ([[0, 0], [1, 1]], r"2\), at least three"),
        ([[0, 0, 0]] * 3, "shape \\(K, 2\\)"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "Self-intersection"),
        ([[0, 0], [1, 1], [2, 2]], "edges do not meet"),
        ([[0, 0], [1, np.nan], [2, 2]], "vertices has a NaN"),
    ],
)
def test_what_is_no_polygon_is_refused(vertices: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        UnsafeSet.polygon(vertices)


# ---- in a problem


def flat_problem(nodes: tuple[int, int], part: UnsafeSet) -> sdhj.ReachAvoidProblem:
    """From the left room of the flat through its door: 0.3 m/s along the axes, wind of 0.05 m/s."""
    grid, target = sdhj.Grid([-0.4, -0.6], [1.2, 0.6], nodes), zoo.goal(0.8, 0.0, 0.2)
    moves = 0.3 * np.array(zoo.STEPS)
    return zoo.plane(moves, 0.05, grid=grid, target=target, unsafe=(part,), delta=0.25, steps=24)


@pytest.mark.slow
def test_a_robot_comes_through_the_door_of_its_map(written: Callable[..., Path]) -> None:
    """Solved, certified by the bounds of its formula, and no run meets a square."""
    part = UnsafeSet.from_map(written(), radius=0.02)
    problem = flat_problem((65, 49), part)
    start = [[0.05, -0.2]]
    blocked = (flat() != GREY["free"]).tolist()
    for method in (sdhj.HJI(), Certified((64, 48))):
        table = sdhj.solve(problem, method, progress=False)
        assert table.contains(start, start=0, within=24)[0]
        assert not table.contains([[-0.4 + 16.5 * 0.05, -0.3]], start=0, within=24)[0]  # in the wall
        run = sdhj.simulate(sdhj.Controller(table), start[0], adversary="worst", seed=3)
        assert run.outcome == "reached"
        clear = [naive_maps.signed_distance(x + 0.4, y + 0.6, blocked, 0.05) - 0.02 for x, y in run.states[::4]]
        assert min(clear) > 0
