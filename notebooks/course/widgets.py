"""Pictures in a notebook, and live ones: sliders bound to functions that draw.

`picture` shows a drawing once. An `Explorer` has controls, a picture that answers to them, and the numbers it shows;
each `explore_*` of a chapter's module returns one. Put it on the last line of a cell. A reader without a kernel sees
the picture for the first setting; where a kernel runs, moving a slider redraws that picture in place. The site shows
some frames of one control, which `notebooks/site/frames.py` writes when the notebook is executed.
"""

import base64
import gc
import html
import inspect
import io
import threading
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import ipywidgets
import matplotlib as mpl
import numpy as np
import PIL.Image
from IPython.display import display
from matplotlib.figure import Figure
from PIL import ImageDraw, ImageFont

from course.live_figure import LiveFigure
from sdhj.arm.case_studies import scene
from sdhj.common.findings import ResolutionWarning
from sdhj.plotting.looks import UNDATED, new_figure, style
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.table.batches import Table

DPI = 115
WIDE = (8.2, 3.5)
VIEW = "application/vnd.jupyter.widget-view+json"
Numbers = Mapping[str, float | str]
Draw = Callable[..., Numbers | None]
DRAWING = threading.RLock()  # rcParams belong to all figures, and a kernel may answer two sliders in two threads


def render(draw: Draw, figure: Figure, *data: Any, **values: Any) -> tuple[bytes, dict[str, float | str]]:
    """Draw on a figure, cleared before, and return its PNG file and the numbers that `draw` returned.

    `draw` takes a figure, or the only axes of one where its first argument is named "ax". Where it follows a slider
    write "n = 3", not "$n = 3$": to parse a formula takes longer than to draw it (`course.slices.frame_live`).
    """
    with DRAWING, style(), mpl.rc_context({"axes.titley": 1.0}):  # a given height saves the search for one
        figure.clear()
        first = next(iter(inspect.signature(draw).parameters))
        numbers = draw(figure.subplots() if first == "ax" else figure, *data, **values)
        told = dict(numbers) if isinstance(numbers, Mapping) else {}
        return _png(figure), told


def _png(figure: Figure, **options: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata=UNDATED["png"], **options)
    return buffer.getvalue()


def picture(draw: Draw, *data: Any, size: tuple[float, float] = WIDE, alt: str = "", **values: Any) -> None:
    """Show draw(figure or axes, *data, **values) once; `size` in inches, `alt` a description for screen readers."""
    with DRAWING, style():
        figure = new_figure(*size)
    png, numbers = render(draw, figure, *data, **values)
    display(as_html(png, alt or first_line(draw)), raw=True)
    if numbers:
        print(told_of(numbers))


def show(figure: Figure, alt: str = "picture") -> None:
    """Show a figure that is already drawn, with a description for screen readers."""
    with DRAWING, style():
        display(as_html(_png(figure, bbox_inches="tight"), alt), raw=True)


def as_html(png: bytes, alt: str) -> dict[str, str]:
    """A picture by kinds of output: HTML, as JupyterLab drops the words that come beside a PNG file."""
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return {"text/html": f'<img src="{source}" alt="{html.escape(alt)}">', "text/plain": alt}


def first_line(draw: Draw) -> str:
    return (inspect.getdoc(draw) or "picture").splitlines()[0]


def told_of(numbers: Numbers) -> str:
    return "; ".join(f"{name.replace('$', '')}: {number_of(value)}" for name, value in numbers.items())


def number_of(value: float | str) -> str:
    if isinstance(value, float) and np.isnan(value):
        return "none"
    return str(value) if isinstance(value, int | str) else f"{value:.3g}"


@contextmanager
def garbage_waits() -> Iterator[None]:
    """Until the picture is there: a picture is 10^5 new objects, and looking for garbage among them takes a quarter."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


class Explorer:
    """Controls and a picture that answers to them.

    What `draw` refuses, by an exception of any kind, is told in words below the controls. The picture stays that of the
    last setting that could be drawn, turns grey, and names that setting. What a solve says that its grid does not see
    is told beside the numbers. A value that comes back from the browser rounded is no new value. Whatever threads move
    controls, one picture is drawn at a time, and the last one is of the newest setting.

    Parameters
    ----------
    draw : callable (figure, **values) -> mapping or None
        Draws for one value of each control, and returns the numbers to show.
    controls : mapping of str to widget
        By argument of `draw`.
    size : (float, float)
        Of the picture, inches.
    slow : str
        Where a picture can take longer than a moment: what it waits for, which the line below the controls says.
    motion : str, optional
        The control that moves in the frames of the site; default the first that has two ends.
    named : sequence of float
        Values of that control which the text beside the widget speaks of: each has a frame.
    process : str, optional
        The control along which something happens, a run or a horizon: the site shows it as a loop.
    idle : callable (**values) -> names of controls, optional
        Those that play no part as the others stand: they are greyed.

    Attributes
    ----------
    controls : dict of str to widget
    numbers : dict of str to float
        What the picture shown now says.
    error : str
        Why the last change was refused; empty where it was not.
    figure : LiveFigure
        What all pictures are drawn on.
    """

    def __init__(
        self,
        draw: Draw,
        controls: Mapping[str, Any],
        *,
        size: tuple[float, float] = WIDE,
        slow: str = "",
        alt: str = "",
        motion: str = "",
        named: Sequence[float] = (),
        process: str = "",
        idle: Callable[..., Collection[str]] = lambda **_: (),
    ) -> None:
        self.draw, self.controls, self.slow, self.alt, self.idle = draw, dict(controls), slow, alt, idle
        self.motion = motion or next((name for name, control in self.controls.items() if hasattr(control, "max")), "")
        self.named, self.process = tuple(named), process
        self.numbers: dict[str, float | str] = {}
        self.error = ""
        self.displayed: Any = None
        with DRAWING, style():
            self.figure = LiveFigure(size, DPI)
        self._status = ipywidgets.HTML()
        self._asked = self._drawn = self.values
        self._unseen: dict[tuple[Any, ...], str] = {}  # what solves said, by the controls' values: each solves once
        self._render()  # raises what is refused
        self._tell()
        self._rest()
        for control in self.controls.values():
            control.observe(self._changed, names="value")

    @property
    def values(self) -> dict[str, Any]:
        """The controls' values by argument, on the steps of their sliders."""
        return {name: _on_its_step(control) for name, control in self.controls.items()}

    def set(self, **values: Any) -> dict[str, float | str]:
        """Move controls, as a user would, and return the numbers that the picture then shows."""
        for name, value in values.items():
            self.controls[name].value = value
        return self.numbers

    def _render(self) -> None:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            self.png, self.numbers = render(self.draw, self.figure, **self._asked)
        self._drawn = self._asked
        for warning in told:
            if issubclass(warning.category, ResolutionWarning):
                self._unseen[tuple(self._asked.values())] = str(warning.message)
            else:
                warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)

    @property
    def note(self) -> str:
        """What the solve of the picture shown now said that its grid does not see; empty where it sees all."""
        return self._unseen.get(tuple(self._asked.values()), "")

    def _changed(self, _change: Any) -> None:
        with DRAWING:  # who has waited here finds the newest setting, or one that another thread has drawn meanwhile
            if self.values != self._asked:
                self._asked = self.values
                self._answer()

    def _answer(self) -> None:
        """Draw what is asked for, or say why not."""
        self._rest()
        if self.slow:
            self._status.value = WORKING.format(self.slow)
        with garbage_waits():
            try:
                self._render()
                self.error = ""
            except Exception as error:  # whatever it is: nobody sees what a callback in a notebook raises
                self.error = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            if self.displayed is not None:
                self.displayed.update(self._image(), raw=True)
            self._tell()

    def _rest(self) -> None:
        """Grey the controls that play no part."""
        idle = self.idle(**self._asked)
        for name, control in self.controls.items():
            for part in (control, getattr(control, "player", None), getattr(control, "slider", None)):
                if part is not None:
                    part.disabled = name in idle

    @property
    def shown_setting(self) -> str:
        """In what the setting of the picture differs from the one that was asked for, in words."""
        told = (
            f"{self.controls[name].description or name}: {number_of(value)}"
            for name, value in self._drawn.items()
            if value != self._asked[name]
        )
        return "; ".join(told)

    def _tell(self) -> None:
        if self.error:
            still = f"The picture, in grey, is that of {html.escape(self.shown_setting)}."
            reason = f"Not possible: {html.escape(self.error)}.<br>{still}"
            self._status.value = f"<div role='alert' style='line-height:1.4; color:#a8330f'>{reason}</div>"
        else:
            told = f"<div role='status' style='line-height:1.4'>{html.escape(told_of(self.numbers))}</div>"
            note = f"<div role='note' style='line-height:1.4; color:#555555'>{html.escape(self.note)}</div>"
            self._status.value = told + (note if self.note else "")

    def _image(self) -> dict[str, str]:
        alt = self.alt or first_line(self.draw)
        alt = f"{alt}. {told_of(self.numbers)}" if self.numbers else alt
        if not self.error:
            return as_html(self.png, alt)
        said = f"still the picture of {self.shown_setting}"
        return as_html(greyed(self.png, said), f"{said}. {alt}")

    def panel(self) -> Any:
        """The controls in columns, with the numbers below."""
        rows = ipywidgets.Box(
            [_whole(control) for control in self.controls.values()],
            layout=ipywidgets.Layout(display="flex", flex_flow="row wrap", align_items="center"),
        )
        return ipywidgets.VBox([rows, self._status])

    def _ipython_display_(self) -> None:
        names = ", ".join(
            f"{control.description or name} ({number_of(control.value)})" for name, control in self.controls.items()
        )
        text = f"Controls, live where the notebook runs: {names}\nShown: {told_of(self.numbers)}"
        panel = self.panel()
        display(
            {VIEW: {"version_major": 2, "version_minor": 0, "model_id": panel.model_id}, "text/plain": text}, raw=True
        )
        self.displayed = display(self._image(), raw=True, display_id=True)
        SHOWN.append(self)


SHOWN: list[Explorer] = []  # in the order in which they were displayed


def greyed(png: bytes, said: str) -> bytes:
    """A picture without its colours, half as dark, with words across its top."""
    shown = PIL.Image.open(io.BytesIO(png))
    grey = PIL.Image.blend(shown.convert("L"), PIL.Image.new("L", shown.size, 255), 0.45)
    font = ImageFont.load_default(15)
    brush = ImageDraw.Draw(grey)
    left, top, right, bottom = brush.textbbox((8, 6), said, font)
    brush.rectangle((left - 4, top - 4, right + 4, bottom + 4), fill=255, outline=90)
    brush.text((8, 6), said, fill=30, font=font)
    buffer = io.BytesIO()
    grey.save(buffer, "png")
    return buffer.getvalue()


def _on_its_step(control: Any) -> Any:
    """The value of a control without what rounding in the browser did to it."""
    value = control.value
    if not isinstance(value, float):
        return value
    if isinstance(control, ipywidgets.FloatSlider):
        value = control.min + round((value - control.min) / control.step) * control.step
    return min(max(round(value, 6), control.min), control.max)


def _whole(control: Any) -> Any:
    """A control with what it has beside it: a button to play it, a slider for its number box."""
    before, behind = getattr(control, "player", None), getattr(control, "slider", None)
    parts = [part for part in (before, control, behind) if part is not None]
    return ipywidgets.HBox(parts) if len(parts) > 1 else control


# ----------------------------------------------------------------------------------------------------------------------
# Controls
# ----------------------------------------------------------------------------------------------------------------------

WORKING = "<div role='status' style='line-height:1.4; color:#555555'>{} ... (the first time also compiling)</div>"
LABEL = {"description_width": "13em"}
LOOK = {"style": LABEL, "layout": ipywidgets.Layout(width="36em")}


def slider(label: str, low: float, high: float, step: float, value: float, *, live: bool = True) -> Any:
    """A slider; with live=False it acts only where it is let go."""
    kind = ipywidgets.IntSlider if all(isinstance(v, int) for v in (low, high, step, value)) else ipywidgets.FloatSlider
    shown = {} if kind is ipywidgets.IntSlider else {"readout_format": ".2f" if step >= 0.01 else ".3f"}
    return kind(value, min=low, max=high, step=step, description=label, continuous_update=live, **shown, **LOOK)


def played(control: Any, interval: int = 250) -> Any:
    """The same whole-numbered slider with a button beside it that plays it.

    The two are linked in the browser, where the first to be displayed wins: both begin with the slider's value.
    """
    play = {"min": control.min, "max": control.max, "step": control.step, "interval": interval}
    control.player = ipywidgets.Play(value=control.value, show_repeat=False, **play)
    ipywidgets.jslink((control.player, "value"), (control, "value"))
    return control


def choice(label: str, options: Sequence[Any], value: Any) -> Any:
    return ipywidgets.Dropdown(options=options, value=value, description=label, **LOOK)


def angle(label: str, value: float, step: float = 0.02) -> Any:
    """An angle in radians: a number box, because a slider has fewer pixels than an angle has values, and a slider."""
    ends = {"min": -3.14, "max": 3.14, "step": step}
    box = ipywidgets.BoundedFloatText(
        value, description=label, style=LABEL, layout=ipywidgets.Layout(width="19em"), **ends
    )
    box.slider = ipywidgets.FloatSlider(
        value, readout=False, tooltip=label, layout=ipywidgets.Layout(width="17em"), **ends
    )

    def moved(change: Any) -> None:  # what is typed stays as it is; the slider shows the nearest of its places
        if abs(change.new - box.value) > step / 2:
            box.value = round(change.new, 2)

    box.slider.observe(moved, names="value")
    box.observe(lambda change: setattr(box.slider, "value", change.new), names="value")
    return box


def step_sliders(table: Table) -> dict[str, Any]:
    return {
        "start": slider("start, step k", 0, table.steps, 1, 0),
        "within": slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }


def agent_sliders(problem: ReachAvoidProblem) -> dict[str, Any]:
    """Where the agent is: a pursuer that leaves the arm a way, an evader that the arm can catch."""
    x, y = (0.1, 0.18) if scene(problem).target is None else (0.24, 0.24)
    box = float(problem.grid.upper[2])
    name = scene(problem).agent
    return {"px": slider(f"{name} x (m)", -box, box, 0.01, x), "py": slider(f"{name} y (m)", -box, box, 0.01, y)}
