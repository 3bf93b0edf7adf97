"""A figure to draw on again and again, because to make and to draw axes takes longer than to draw what is in them."""

import struct
import zlib
from typing import Any, BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from PIL.PngImagePlugin import putchunk

FAST = 1  # of 9: without transparency half the time of the usual 6 with it, for a file at most a third larger
DARK = 200  # of 255: what is darker at an edge of the canvas is cut off there
ABOVE = 2  # the filter of rows that are stored as what changes from the row above: most of a picture does not


class LiveFigure(Figure):
    """A figure that hands out its axes again after `clear`, and draws what frames them only where that has changed.

    Cleared axes are as new, but for the objects that draw their ticks: to make these takes longest. They come in the
    order in which they were made; where another place is asked for, new ones are made. Axes are laid out when they
    are new, and where what they show would be cut off. What frames them (background, ticks, labels) is drawn below
    all else. For axes in the plane.

    Parameters
    ----------
    size : (float, float)
        Inches.
    dpi : float
    """

    def __init__(self, size: tuple[float, float], dpi: float) -> None:
        self._waiting: list[Axes] = []  # cleared axes, to be handed out in this order
        self._laid_out = False
        self._framed: Any = None  # what the background was drawn from
        self._background: Any = None
        super().__init__(figsize=size, dpi=dpi)
        self._agg = FigureCanvasAgg(self)

    def clear(self, keep_observers: bool = False) -> None:
        """Empty the figure; its axes wait to be handed out again."""
        if not self.axes:
            return super().clear(keep_observers)
        if len(self._waiting) < len(self.axes):
            self._waiting = list(self.axes)
            for ax in self._waiting:
                ax.clear()
                ax.set_aspect("auto")  # `clear` leaves the aspect, and the room that it took
                ax.apply_aspect()
        for artist in (*self.legends, *self.texts, *self.lines, *self.patches, *self.images):
            artist.remove()

    def add_subplot(self, *args: Any, **kwargs: Any) -> Any:
        if self._waiting and _place(*args) == _place(self._waiting[0].get_subplotspec()):
            return self._waiting.pop(0)
        self._forget_waiting()
        ax = super().add_subplot(*args, **kwargs)
        for axis in (ax.xaxis, ax.yaxis):
            # What `clear` asks for. The ticks stay, and where they are clipped: to the axes, wherever these are.
            axis.reset_ticks, axis.set_clip_path = (lambda: None), (lambda *_: None)
        self._laid_out = False
        return ax

    def _forget_waiting(self) -> None:
        for ax in self._waiting:
            ax.remove()
            self._laid_out = False
        self._waiting = []

    def savefig(self, fname: BinaryIO, **_: Any) -> None:  # type: ignore[override]
        """Write what is drawn as a PNG file, in the figure's own resolution."""
        self._forget_waiting()
        if not self._laid_out:
            self._lay_out()
        pixels = self._drawn()
        if np.concatenate((pixels[[0, -1]], pixels[:, [0, -1]].swapaxes(0, 1)), axis=1).min() < DARK:
            self._lay_out()
            pixels = self._drawn()
        write_png(fname, pixels, self.dpi)

    def _lay_out(self) -> None:
        self.set_layout_engine("constrained")
        self.draw_without_rendering()
        self.set_layout_engine("none")
        self._laid_out = True

    def _drawn(self) -> Any:
        """The colours (height, width, 3) of the canvas, all drawn."""
        frames = [self.patch, *(ax.patch for ax in self.axes)]
        frames += [axis for ax in self.axes if ax.axison for axis in (ax.xaxis, ax.yaxis)]
        self._draw_frames(frames)
        hidden = [part for part in frames if part.get_visible()]
        for part in hidden:
            part.set_visible(False)
        try:
            self.draw(self._agg.get_renderer())
        finally:
            for part in hidden:
                part.set_visible(True)
        return np.asarray(self._agg.buffer_rgba())[..., :3]

    def _draw_frames(self, frames: list[Any]) -> None:
        """Put the background on the canvas, drawn anew where something else is to be seen on it."""
        for ax in self.axes:
            ax.apply_aspect()
        framed = [_looks(ax) for ax in self.axes]
        renderer = self._agg.get_renderer()
        if framed != self._framed:
            renderer.clear()
            for part in frames:
                part.draw(renderer)
            self._framed, self._background = framed, self._agg.copy_from_bbox(self.bbox)
        else:
            self._agg.restore_region(self._background)


def write_png(file: BinaryIO, pixels: Any, dpi: float) -> None:
    """Write colours (height, width, 3), uint8, in two thirds of the time of a library that tries all filters."""
    height, width = pixels.shape[:2]
    rows = np.full((height, 1 + 3 * width), ABOVE, np.uint8)
    values = rows[:, 1:]
    values[:] = pixels.reshape(height, -1)
    values[1:] -= values[:-1].copy()
    per_metre = round(dpi / 0.0254)
    file.write(b"\x89PNG\r\n\x1a\n")
    putchunk(file, b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0))
    putchunk(file, b"pHYs", struct.pack(">2IB", per_metre, per_metre, 1))
    putchunk(file, b"IDAT", zlib.compress(rows, FAST))
    putchunk(file, b"IEND")


def _place(spec: Any = None, *_: Any) -> Any:
    """What tells one place in a figure from another; None stands for all of the figure."""
    if not isinstance(spec, SubplotSpec):
        return spec
    grid = spec.get_gridspec()
    return spec.get_geometry(), grid.get_width_ratios(), grid.get_height_ratios()


def _looks(ax: Axes) -> Any:
    """What tells the look of the frame of one axes from that of another."""
    sides = []
    for axis in (ax.xaxis, ax.yaxis):
        places = axis.get_majorticklocs()
        texts = axis.get_major_formatter().format_ticks(places)
        sides.append((axis.label.get_text(), list(axis.get_view_interval()), list(places), texts))
    return ax.bbox.bounds, ax.axison, sides
