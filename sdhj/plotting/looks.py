"""Colours, the shared style file, and writing figures to disk.

Nothing here uses `matplotlib.pyplot`: figures have no window and no global state, so they can be made in a service as
well as in a widget. Colours also differ by lightness, hatch or line style, so figures can be read in greyscale.
"""

import io
import logging
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.style
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from sdhj.common.remembering import FloatArray
from sdhj.table.files import Named, replaced_whole, require_writable, unwritable_error, writable_file

Looks = dict[str, Any]  # keywords of Matplotlib's patches
State = Sequence[float] | FloatArray  # one state (ndim,)
STYLE_FILE = Path(__file__).resolve().parent / "style.mplstyle"
UNDATED: dict[str, dict[str, Any]] = {  # metadata without a date, so that equal figures give equal files
    "pdf": {"CreationDate": None, "Producer": None, "Creator": "sdhj"},
    "svg": {"Date": None, "Creator": "sdhj"},
    "png": {"Software": "sdhj"},
}

INK = "#1a1a1a"
FAINT = "#8c8c8c"
ROBOT_LOOKS: Looks = {"facecolor": "#b9bec4", "edgecolor": "#22262b", "linewidth": 0.9}
UNSAFE_LOOKS: Looks = {"facecolor": "#f6bda8", "edgecolor": "#a8330f", "hatch": "/////", "linewidth": 0.9}
TARGET_LOOKS: Looks = {"facecolor": "#7fb2e5", "edgecolor": "#0b3c5d", "hatch": "", "linewidth": 1.1}
PURSUER_LOOKS: Looks = {"facecolor": "none", "edgecolor": "#000000", "linestyle": (0, (1, 1.1)), "linewidth": 2.0}
FULL_LOOKS: Looks = {"facecolor": "#cfe3f3", "edgecolor": "#0b3c5d", "hatch": "", "linewidth": 1.2}
INNER_LOOKS: Looks = {"facecolor": "#2a8c82", "edgecolor": "#052e2a", "linewidth": 1.2, "linestyle": (0, (4, 1.5))}
LOOKS = {"pursuer": PURSUER_LOOKS, "target": TARGET_LOOKS, "evader": TARGET_LOOKS}
OUTCOME_INK = "#c44e00"  # a run, on blue tubes


def style() -> AbstractContextManager[None]:
    """A context manager in which figures are drawn and saved in the project's style."""
    return mpl.style.context(STYLE_FILE)


def look(name: str) -> Looks:
    """Matplotlib's keywords for a patch of the set `name`, not to be changed; by default an unsafe set's."""
    return LOOKS.get(name, UNSAFE_LOOKS)


def step_colours(steps: int) -> list[Any]:
    """RGBA colours for 0 to `steps` steps to go, from dark to light in even steps of lightness.

    Examples
    --------
    >>> from sdhj import plotting
    >>> len(plotting.step_colours(8))
    9
    """
    return [mpl.colormaps["YlGnBu_r"](0.06 + 0.84 * n / max(steps, 1)) for n in range(steps + 1)]


def patch(name: str, label: str) -> Patch:
    """A legend entry for the set "target", "obstacles" or "pursuer"; others look like unsafe sets.

    Examples
    --------
    >>> from sdhj import plotting
    >>> plotting.patch("obstacles", "known obstacles").get_label()
    'known obstacles'
    """
    return Patch(**look(name), label=label)


def new_figure(width: float = 7.0, height: float = 3.4, **options: Any) -> Figure:
    """A figure of this size, in inches, with constrained layout; `options` as for Matplotlib's `Figure`.

    Examples
    --------
    >>> from sdhj import plotting
    >>> plotting.new_figure(5.0, 4.0).get_size_inches()
    array([5., 4.])
    """
    return Figure(figsize=(width, height), **({"layout": "constrained"} | options))


def writable_folder(folder: Named) -> Path:
    """The folder, made if need be, after trying that a file can be written in it: before long work."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable_error(folder, error) from error
    require_writable(folder)
    return folder


def writable_picture(path: Path | None, suffixes: Sequence[str] = (".png", ".pdf", ".svg")) -> None:
    """Raise OSError if a picture cannot be written, ValueError for another ending: before long work."""
    if path is not None:
        writable_file(path)
        if path.suffix.lower() not in suffixes:
            raise ValueError(f"{path} must end in {' or '.join(suffixes)}, which selects the file type of the picture")


def save(figure: Figure, folder: Named, name: str, formats: Sequence[str] = ("pdf", "png")) -> list[Path]:
    """Write `figure` as folder/name.format for each format; equal figures give equal files.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    folder : path
        Made where it does not exist.
    name : str
        Without an ending.
    formats : sequence of {"pdf", "svg", "png"}

    Raises
    ------
    OSError
        If the folder cannot be written to.

    Examples
    --------
    >>> import tempfile
    >>> from sdhj import plotting
    >>> [path.name for path in plotting.save(plotting.new_figure(2, 2), tempfile.mkdtemp(), "empty", ["png"])]
    ['empty.png']
    """
    if unknown := set(formats) - set(UNDATED):
        raise ValueError(f"formats must be among {', '.join(UNDATED)}, got {', '.join(sorted(unknown))}")
    files = [writable_folder(folder) / f"{name}.{form}" for form in formats]
    logging.getLogger("fontTools").setLevel(logging.ERROR)  # it warns that the file has no date
    with style():
        for file in files:
            write(figure, file)
    return files


def write(figure: Figure, path: Named) -> None:
    """Write `figure` to a .pdf, .svg or .png, whole or not at all (OSError).

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from sdhj import plotting
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "empty.svg"
    >>> plotting.write(plotting.new_figure(2, 2), path)
    >>> path.is_file()
    True
    """
    # in memory first: Matplotlib reports a full disk by an unrelated error
    drawn, form = io.BytesIO(), Path(path).suffix[1:].lower()
    figure.savefig(drawn, format=form, metadata=UNDATED[form])
    with replaced_whole(path) as temporary:
        temporary.write_bytes(drawn.getvalue())
