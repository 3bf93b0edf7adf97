"""Level-set functions of maps, for `UnsafeSet.from_map`.

The whole closed square of every pixel that is not free is unsafe, and so is everything outside the map. Let s be the
signed distance to this set, negative inside, and h half the side of a pixel. At the *nodes*, the corners, middles of
edges and centres of pixels, s is computed exactly: the point of a square nearest to a node is again a node (clipping a
multiple of h to an interval between multiples of h gives one), so the exact Euclidean distance transform finds it.

Between the nodes s is interpolated bilinearly, as the mean of s at the corners X of a cell with the weights of a point
x. It differs from s(x) by at most the mean of |X - x|, because s has slope 1; and (mean |X - x|)^2 is at most
mean |X - x|^2 = (a (1 - a) + b (1 - b)) h^2 <= h^2 / 2. This bound and the robot's radius are subtracted:

    interpolant - h / sqrt(2) - radius  <=  s - radius  <=  interpolant + h / sqrt(2) - radius.

The level-set function, the left-hand side, is <= 0 wherever the robot's disk meets the unsafe set, and within the map
at most half the diagonal of a pixel, sqrt(2) h, below the true one. Along each axis the slope of the interpolant is a
difference of s between neighbours over their distance, at most 1; in any direction it is at most sqrt(2). Outside the
map the function is its value at the nearest point of the map, less the distance to that point: its slope is at most 1
along the normal of the edge and along the edge, so the same bounds hold.
"""

import io
import math
import os
import reprlib
import stat
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sdhj.common.checks import finite_array, number, one_line, option, plain_array
from sdhj.common.memory import require_memory
from sdhj.common.remembering import FloatArray
from sdhj.formulas.graph import MOST_TABLES
from sdhj.formulas.gridded import gridded
from sdhj.problem.shapes.polygons import MISSING

KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")  # that the map server requires
MODES = ("trinary", "scale")
UNKNOWN_GREY = 205  # with which map savers mark unknown pixels
BYTES_A_PIXEL = 130  # that reading a map and making its distances take at most
MOST_TEXT = 1 << 12  # bytes of a YAML file, which has some hundred
MOST_BRACKETS = 100  # in it: PyYAML's time grows with the square of what is nested
MOST_PICTURE = 1 << 27  # bytes of a picture
FORMATS = ("PPM", "PNG", "BMP")  # that map servers write; to Pillow PGM and PBM are PPM


def map_distance(
    source: Any, resolution: float | None, origin: Sequence[float], radius: float, name: str
) -> tuple[Callable[[Any, Any], Any], tuple[float, float, float]]:
    """The signed distance (x (M,), y (M,)) -> (M,) to what a map does not show as free, less a radius, and its pose.

    All in m, in the map's frame; arguments and errors are those of `UnsafeSet.from_map`.
    """
    if isinstance(source, str | os.PathLike):
        if resolution is not None or tuple(origin) != (0.0, 0.0, 0.0):
            raise ValueError("resolution and origin are read from the map's file; give them with an array only")
        blocked, resolution, origin = read_map(Path(source))
    else:
        blocked = plain_array("a map", source)
        if blocked.ndim != 2 or blocked.dtype != np.bool_ or not blocked.size:
            raise ValueError(
                "a map must be the path of a YAML file or a bool array (rows, columns), True where it is occupied or "
                f"unknown, got {type(source).__name__} of {blocked.dtype} of shape {blocked.shape}"
            )
    require_memory_for_map(*blocked.shape[::-1])
    if blocked.all():
        shown = os.fspath(source) if isinstance(source, str | os.PathLike) else name
        raise ValueError(f"no pixel of the map {shown!r} is free; an array must be True where it is occupied")
    radius, side = number("radius", radius, least=0.0), number("resolution", resolution, above=0.0)
    if np.shape(origin) not in ((2,), (3,)):
        raise ValueError(f"origin must be (x, y) or (x, y, yaw), got {reprlib.repr(origin)}")
    x, y, yaw = (*finite_array("origin", origin).tolist(), 0.0)[:3]
    nodes = distances_at_nodes(blocked, side)
    width, height = ((np.array(nodes.shape) - 1.0) * (side / 2)).tolist()
    # h / sqrt(2) of the module's bound, as h is side / 2
    nodes -= side / math.sqrt(8.0) + radius
    nodes.setflags(write=False)  # so that it is not copied
    table = gridded(nodes, [0.0, 0.0], [side / 2, side / 2])
    del nodes

    def distance(x: Any, y: Any) -> Any:
        past = [np.maximum(one - size, np.minimum(one, 0.0)) for one, size in ((x, width), (y, height))]  # 0 on the map
        return table(np.stack([x, y], axis=1)) - np.hypot(*past)

    return distance, (x, y, yaw)


def distances_at_nodes(blocked: FloatArray, side: float) -> FloatArray:
    """Signed distance to blocked pixels and to what is outside the map, m, at nodes half a pixel apart.

    blocked (rows, columns), row 0 at the top; the result (2 columns + 1, 2 rows + 1), x before y, ascending.
    """
    try:
        from scipy.ndimage import binary_dilation, distance_transform_edt
    except ImportError as error:
        raise ImportError(f"distances on a map need SciPy; {MISSING}") from error

    def closed(cells: FloatArray) -> FloatArray:
        centres = np.zeros([2 * n + 1 for n in cells.shape], np.bool_)
        centres[1::2, 1::2] = cells
        return np.asarray(binary_dilation(centres, np.ones((3, 3))))

    cells = blocked[::-1].T
    unsafe, off_border = closed(cells), closed(~cells)
    unsafe[[0, -1]] = unsafe[:, [0, -1]] = True  # they touch the outside of the map
    np.logical_not(np.logical_and(off_border, unsafe, out=off_border), out=off_border)
    # the border of the unsafe set is on a blocked square, or at the edge of the map, and on a free one
    nearest = distance_transform_edt(off_border, return_distances=False, return_indices=True)
    del off_border
    out, columns = np.empty(unsafe.shape), np.arange(unsafe.shape[1])
    for i, (row, column) in enumerate(zip(*nearest, strict=True)):  # SciPy's own distances take twice the memory
        squares = np.square(row - i, dtype=np.float64) + np.square(column - columns, dtype=np.float64)
        out[i] = np.sqrt(squares) * np.where(unsafe[i], -side / 2, side / 2)
    return out


def read_map(path: Path) -> tuple[FloatArray, float, Sequence[float]]:
    """The pixels that are not free, (rows, columns), the side of a pixel, m, and the origin of a map's YAML file.

    As for the map server, a pixel is free if its darkness (its lightness with `negate`), from 0 to 1, is below
    `free_thresh`, in every mode.
    """
    try:
        import yaml
    except ImportError as error:
        raise ImportError(f"reading the file of a map needs PyYAML; {MISSING}") from error
    words = {"0": False, "1": True} | yaml.SafeLoader.bool_values
    try:
        text = bytes_of_file(path, MOST_TEXT).decode("utf-8")
        if text.count("[") + text.count("{") > MOST_BRACKETS:
            raise ValueError(f"it has more than {MOST_BRACKETS} brackets; a map needs one pair, of its origin")
        # to this loader every value is text: numbers are those of YAML 1.2, such as 1e-1, and nothing is made of tags
        entries = yaml.load(text, Loader=yaml.BaseLoader)
        if not isinstance(entries, dict) or (lacking := [key for key in KEYS if key not in entries]):
            said = f"it lacks {', '.join(lacking)}" if isinstance(entries, dict) else "it has no keys"
            raise ValueError(f"it must have the keys {', '.join(KEYS)}, and {said}")
        option("mode", entries.get("mode", MODES[0]), MODES)
        image, negate, origin = (entries[key] for key in ("image", "negate", "origin"))
        option("negate", negate.lower() if isinstance(negate, str) else negate, [*words])
        free = number("free_thresh", number_or_text(entries["free_thresh"]), least=0.0, most=1.0)
        number("occupied_thresh", number_or_text(entries["occupied_thresh"]), least=free, most=1.0)
        resolution = number("resolution", number_or_text(entries["resolution"]), above=0.0)
        if not isinstance(origin, list) or len(origin) != 3:
            raise ValueError(f"origin must be three numbers, got {reprlib.repr(origin)}")
        origin = [number(f"origin[{i}]", number_or_text(one)) for i, one in enumerate(origin)]
        if not isinstance(image, str):
            raise ValueError(f"image must be the name of a file, got {reprlib.repr(image)}")
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise file_error(path, "the YAML file of a map", error) from error
    grey, opaque = read_image(path.parent / image)
    # What is dark is occupied, unless the map says `negate`.
    darkness = (grey if words[negate.lower()] else 255.0 - grey) / 255.0
    blocked = ~((darkness < free) & opaque)
    if (grey[~blocked] == UNKNOWN_GREY).any():
        # at the line that calls `UnsafeSet.from_map`: a function more in between takes another level
        warnings.warn(
            f"{path} counts the grey {UNKNOWN_GREY}, which usually marks unknown pixels, as free, because its "
            f"free_thresh {free:g} is above {1 - UNKNOWN_GREY / 255:.4f}; lower it if these pixels are unknown",
            stacklevel=4,
        )
    return blocked, resolution, origin


def number_or_text(text: Any) -> Any:
    """float(text) where a text spells a number; else what was given."""
    try:
        return float(text)
    except (TypeError, ValueError):
        return text


def read_image(path: Path) -> tuple[FloatArray, FloatArray]:
    """Lightness of the pixels of a picture, 0 to 255, and whether they are opaque: (rows, columns) each."""
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError(f"reading the picture of a map needs Pillow; {MISSING}") from error
    bombs = Image.DecompressionBombError, Image.DecompressionBombWarning
    try:
        data = bytes_of_file(path, MOST_PICTURE)
        with (
            warnings.catch_warnings(action="error", category=bombs[1]),
            Image.open(io.BytesIO(data), formats=FORMATS) as image,
        ):
            require_memory_for_map(*image.size)
            require_whole(data, image)
            if image.mode.startswith("I"):  # 16 bits
                grey = np.asarray(image, dtype=np.float64)
                # 65535 / 257 is 255.
                return grey / 257.0, grey != image.info.get("transparency", -1)
            pixels = np.asarray(image.convert("RGBA"))
    except (OSError, ValueError, SyntaxError, *bombs) as error:
        raise file_error(path, "a picture of a map, such as a PGM or PNG file", error) from error
    return pixels[..., :3].mean(axis=2), pixels[..., 3] == 255


def require_whole(data: bytes, image: Any) -> None:
    """Refuse a picture in P4, P5 or P6 that is not as long as its header says.

    It has no checksum: where Git or an editor has changed its line ends, the map would be read shifted.
    """
    if data[:2] not in (b"P4", b"P5", b"P6"):
        return
    _, _, begin, told = image.tile[0]  # of what Pillow decodes: where it begins, and (kind, largest value) but for 255
    wide = told == "I;16B" or (isinstance(told, tuple) and told[1] > 255)
    columns, rows = image.size
    row = -(-columns // 8) if image.mode == "1" else columns * len(image.getbands()) * (2 if wide else 1)
    if (there := len(data) - begin) != row * rows:
        raise ValueError(
            f"{row * rows:,} bytes must follow its header, for {columns:,} x {rows:,} pixels, and {there:,} do; if Git "
            "or an editor has changed its line ends, say that it is binary (*.pgm binary in .gitattributes)"
        )


def bytes_of_file(path: Path, most: int) -> bytes:
    """The bytes of a file, at most `most`; a device or pipe, which might not end, is refused."""
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("it is a folder, a device or a pipe")
    found = b""
    if status.st_size <= most:
        with open(path, "rb") as stream:
            found = stream.read(most + 1)  # files of /proc have no size
    if max(status.st_size, len(found)) > most:
        raise ValueError(f"it has more than {most:,} bytes")
    return found


def require_memory_for_map(width: int, height: int) -> None:
    """Refuse a map that is too large, by its width and height in pixels, before it is read."""
    # a number for each corner, middle of an edge and centre of a pixel, as `distances_at_nodes` makes them
    size = 8 * (2 * width + 1) * (2 * height + 1)
    if size > MOST_TABLES:
        raise ValueError(
            f"{width:,} x {height:,} pixels are too many: the table of their distances takes {size:,} bytes, and the "
            f"tables of a problem at most {MOST_TABLES:,} together; scale the map down, or cut off what is not needed"
        )
    require_memory(BYTES_A_PIXEL * width * height, f"a map of {width:,} x {height:,} pixels", "scale it down")


def file_error(path: Path, what: str, why: Exception | str) -> ValueError:
    """A ValueError that says in one line that the file is not `what` it should be, and `why`."""
    return ValueError(one_line(f"{path} is not {what}: {getattr(why, 'strerror', None) or why}"))
