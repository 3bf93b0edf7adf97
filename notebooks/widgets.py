"""Pictures in a notebook, and live ones: sliders bound to functions that draw.

`picture` shows a drawing once. An `Explorer` has controls, a picture that answers to them, and the numbers it shows;
each `explore_*` of the chapters' modules returns one. Put it on the last line of a cell. A reader without a kernel sees
the picture for the first setting; where a kernel runs, moving a slider redraws that picture in place.
"""

import inspect
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any

import ipywidgets
import matplotlib as mpl
import numpy as np
from IPython.display import Image, display
from matplotlib.figure import Figure

from sdhj.arm.case_studies import scene
from sdhj.plotting.looks import UNDATED, new_figure, style
from sdhj.problem import ReachAvoidProblem
from sdhj.table import Table

DPI = 115
WIDE = (8.2, 3.5)
VIEW = "application/vnd.jupyter.widget-view+json"
Numbers = Mapping[str, float | str]
Draw = Callable[..., Numbers | None]


def render(
    draw: Draw, size: tuple[float, float], *data: Any, places: list[Any] | None = None, **values: Any
) -> tuple[bytes, dict[str, float | str]]:
    """Draw on a new figure and return its PNG file and the numbers that `draw` returned.

    `draw` takes a figure, or the only axes of one where its first argument is named "ax". `places` remembers where the
    axes came to lie, so that the next picture need not lay them out again, which takes longer than to draw them.
    """
    with style(), mpl.rc_context({"axes.titley": 1.0}):  # a given height saves the search for one
        figure = new_figure(*size, layout="none" if places else "constrained")
        first = next(iter(inspect.signature(draw).parameters))
        numbers = draw(figure.subplots() if first == "ax" else figure, *data, **values)
        if places and len(places) == len(figure.axes):
            for ax, place in zip(figure.axes, places, strict=True):
                ax.set_position(place)
        elif places:
            figure.set_layout_engine("constrained")
        png = _png(figure)
        if places is not None:
            places[:] = [ax.get_position(original=True) for ax in figure.axes]
        return png, dict(numbers) if isinstance(numbers, Mapping) else {}


def _png(figure: Figure, **options: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata=UNDATED["png"], **options)
    return buffer.getvalue()


def picture(draw: Draw, *data: Any, size: tuple[float, float] = WIDE, alt: str = "", **values: Any) -> None:
    """Show draw(figure or axes, *data, **values) once; `size` in inches, `alt` a description for screen readers."""
    png, numbers = render(draw, size, *data, **values)
    display(Image(data=png, format="png", alt=alt or _first_line(draw)))
    if numbers:
        print(_told(numbers))


def show(figure: Figure, alt: str = "picture") -> None:
    """Show a figure that is already drawn, with a description for screen readers."""
    with style():
        display(Image(data=_png(figure, bbox_inches="tight"), format="png", alt=alt))


def _first_line(draw: Draw) -> str:
    return (inspect.getdoc(draw) or "picture").splitlines()[0]


def _told(numbers: Numbers) -> str:
    return "; ".join(f"{name}: {_number(value)}" for name, value in numbers.items())


def _number(value: float | str) -> str:
    if isinstance(value, float) and np.isnan(value):
        return "none"
    return str(value) if isinstance(value, int | str) else f"{value:.3g}"


class Explorer:
    """Controls and a picture that answers to them.

    Parameters
    ----------
    draw : callable (figure, **values) -> mapping or None
        Draws for one value of each control, and returns the numbers to show. A ValueError is shown to the user and
        leaves the picture as it was.
    controls : mapping of str to widget
        By argument of `draw`.
    size : (float, float)
        Of the picture, inches.
    slow : bool
        The picture takes longer than a moment: `draw` is given `progress` and writes a progress bar where that is true.

    Attributes
    ----------
    controls : dict of str to widget
    numbers : dict of str to float
        What the picture shown now says.
    error : str
        Why the last change was refused; empty where it was not.
    """

    def __init__(
        self,
        draw: Draw,
        controls: Mapping[str, Any],
        *,
        size: tuple[float, float] = WIDE,
        slow: bool = False,
        alt: str = "",
    ) -> None:
        self.draw, self.controls, self.size, self.slow, self.alt = draw, dict(controls), size, slow, alt
        self.numbers: dict[str, float | str] = {}
        self.error = ""
        self.png = b""
        self._picture: Any = None
        self._places: list[Any] = []
        self._status = ipywidgets.HTML()
        self._progress = ipywidgets.Output()
        for control in self.controls.values():
            control.observe(self._changed, names="value")
        self._redraw(first=True)
        if self.error:
            raise ValueError(self.error)

    @property
    def values(self) -> dict[str, Any]:
        """The controls' values by argument."""
        return {name: control.value for name, control in self.controls.items()}

    def set(self, **values: Any) -> dict[str, float | str]:
        """Move controls, as a user would, and return the numbers that the picture then shows."""
        for name, value in values.items():
            self.controls[name].value = value
        return self.numbers

    def _changed(self, _change: Any) -> None:
        self._redraw()
        if self._picture is not None:
            self._picture.update(self._image())

    def _redraw(self, *, first: bool = False) -> None:
        live = self.slow and not first
        if live:
            self._status.value = "solving ..."
        extra = {"progress": live} if self.slow else {}
        try:
            with self._progress if live else nullcontext():
                self.png, self.numbers = render(self.draw, self.size, places=self._places, **self.values, **extra)
            self.error = ""
        except ValueError as error:
            self.error = str(error)
        if live and self._picture is not None:
            self._progress.clear_output()
        told = f"<span style='color:#a8330f'>{self.error}</span>" if self.error else _told(self.numbers)
        self._status.value = f"<div style='line-height:1.4'>{told}</div>"

    def _image(self) -> Image:
        return Image(data=self.png, format="png", alt=self.alt or _first_line(self.draw))

    def panel(self) -> Any:
        """The controls in columns, with the numbers below."""
        rows = ipywidgets.Box(
            [_labelled(control) for control in self.controls.values()],
            layout=ipywidgets.Layout(display="flex", flex_flow="row wrap", align_items="center"),
        )
        parts = [rows, self._status, self._progress] if self.slow else [rows, self._status]
        return ipywidgets.VBox(parts)

    def _ipython_display_(self) -> None:
        names = ", ".join(
            f"{control.description or name} ({_number(control.value)})" for name, control in self.controls.items()
        )
        text = f"Controls, live where the notebook runs: {names}\nShown: {_told(self.numbers)}"
        panel = self.panel()
        display(
            {VIEW: {"version_major": 2, "version_minor": 0, "model_id": panel.model_id}, "text/plain": text}, raw=True
        )
        self._picture = display(self._image(), display_id=True)


def _labelled(control: Any) -> Any:
    """A control, with a button to play it where it has one."""
    play = getattr(control, "player", None)
    return control if play is None else ipywidgets.HBox([play, control])


# ----------------------------------------------------------------------------------------------------------------------
# Controls
# ----------------------------------------------------------------------------------------------------------------------

LOOK = {"style": {"description_width": "13em"}, "layout": ipywidgets.Layout(width="30em")}


def slider(label: str, low: float, high: float, step: float, value: float, *, live: bool = True) -> Any:
    """A slider; with live=False it acts only where it is let go."""
    kind = ipywidgets.IntSlider if all(isinstance(v, int) for v in (low, high, step, value)) else ipywidgets.FloatSlider
    shown = {} if kind is ipywidgets.IntSlider else {"readout_format": ".2f"}
    return kind(value, min=low, max=high, step=step, description=label, continuous_update=live, **shown, **LOOK)


def choice(label: str, options: Sequence[Any], value: Any) -> Any:
    return ipywidgets.Dropdown(options=options, value=value, description=label, **LOOK)


def angle(label: str, value: float) -> Any:
    return slider(label, -3.14, 3.14, 0.02, value)


def step_sliders(table: Table) -> dict[str, Any]:
    return {
        "start": slider("start, step k", 0, table.steps, 1, 0),
        "within": slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }


def agent_sliders(problem: ReachAvoidProblem, x: float = 0.24, y: float = 0.24) -> dict[str, Any]:
    box = float(problem.grid.upper[2])
    name = scene(problem).agent
    return {"px": slider(f"{name} x (m)", -box, box, 0.01, x), "py": slider(f"{name} y (m)", -box, box, 0.01, y)}
