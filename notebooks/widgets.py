"""Live pictures for the notebooks: sliders bound to the drawing functions of `sdhj.plotting`.

`picture` shows a drawing once. Each `explore_*` returns an `Explorer`: controls, a picture that answers to them, and
the numbers it shows. Put it on the last line of a cell. A reader without a kernel sees the picture for the first
setting; where a kernel runs, moving a slider redraws that picture in place.
"""

import inspect
import io
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import lru_cache
from typing import Any

import ipywidgets
import matplotlib as mpl
import numpy as np
from IPython.display import Image, display
from matplotlib.figure import Figure

import sdhj
from sdhj import figures, illustrations, lessons
from sdhj.arm.workspace import Disk, Line, Still
from sdhj.plotting import games, runs, teaching
from sdhj.plotting.looks import UNDATED, new_figure, style
from sdhj.problem import ReachAvoidProblem
from sdhj.schemes import Scheme
from sdhj.table import LookupTable

DPI = 115
WIDE = (8.2, 3.5)
POSTURE = (1.3, 0.9)  # of the arm, where a picture starts, rad
VIEW = "application/vnd.jupyter.widget-view+json"
INTEGRATOR = {1: "euler", 2: "rk2", 3: "rk3"}  # as accurate in time as the differences are in space
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


def paper_figure(name: str, context: figures.Context | None = None) -> None:
    """Show a figure of the paper, by its name in `catalogue.FIGURES`, from what a `catalogue.Context` holds."""
    if name not in figures.FIGURES:
        raise ValueError(f"figure must be one of {', '.join(figures.FIGURES)}, got {name!r}")
    show(figures.draw(name, context or figures.Context()), alt=figures.FIGURES[name].title)


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


def _slider(label: str, low: float, high: float, step: float, value: float, *, live: bool = True) -> Any:
    """A slider; with live=False it acts only where it is let go."""
    kind = ipywidgets.IntSlider if all(isinstance(v, int) for v in (low, high, step, value)) else ipywidgets.FloatSlider
    shown = {} if kind is ipywidgets.IntSlider else {"readout_format": ".2f"}
    return kind(value, min=low, max=high, step=step, description=label, continuous_update=live, **shown, **LOOK)


def _choice(label: str, options: Sequence[Any], value: Any) -> Any:
    return ipywidgets.Dropdown(options=options, value=value, description=label, **LOOK)


def _angle(label: str, value: float) -> Any:
    return _slider(label, -3.14, 3.14, 0.02, value)


def _steps(table: LookupTable) -> dict[str, Any]:
    return {
        "start": _slider("start, step k", 0, table.steps, 1, 0),
        "within": _slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }


def _agent(problem: ReachAvoidProblem, x: float = 0.24, y: float = 0.24) -> dict[str, Any]:
    box = float(problem.grid.upper[2])
    name = sdhj.arm.case_studies.scene(problem).agent
    return {"px": _slider(f"{name} x (m)", -box, box, 0.01, x), "py": _slider(f"{name} y (m)", -box, box, 0.01, y)}


# ----------------------------------------------------------------------------------------------------------------------
# Sets and schemes
# ----------------------------------------------------------------------------------------------------------------------


def explore_sets(nodes: int = 81) -> Explorer:
    """Union, intersection and difference of a disk and a rectangle, as min and max of their functions."""
    grid = lessons.canvas(nodes)
    b = lessons.rectangle(grid, (0.25, 0.0), (0.35, 0.55))

    def draw(figure: Figure, operation: str, x: float, radius: float) -> Numbers:
        a = lessons.disk(grid, (x, 0.0), radius)
        c = lessons.combine(a, b, operation)
        teaching.draw_functions(figure, grid, {"$a$, disk": a, "$b$, rectangle": b, f"{operation}": c})
        return {
            f"area of {name}": lessons.area(grid, values, 401)
            for name, values in (("A", a), ("B", b), ("the result", c))
        }

    controls = {
        "operation": _choice("operation", lessons.OPERATIONS, "union"),
        "x": _slider("disk's centre x (m)", -0.9, 0.9, 0.05, -0.25),
        "radius": _slider("disk's radius (m)", 0.1, 0.8, 0.05, 0.45),
    }
    return Explorer(draw, controls, size=(8.2, 3.0), alt="A disk, a rectangle, and what the operation makes of them")


def explore_nodes() -> Explorer:
    """What a coarse grid keeps of a thin bar: linear interpolation between nodes, and nothing else."""
    fine = lessons.canvas(401)

    def draw(figure: Figure, nodes: int, thickness: float, shift: float) -> Numbers:
        coarse, half = lessons.canvas(nodes), (0.7, thickness / 2)
        values, exact = (lessons.rectangle(grid, (0.0, shift), half) for grid in (coarse, fine))
        teaching.draw_nodes(figure, coarse, values, fine, exact)
        return {
            "spacing (m)": coarse.spacing[0],
            "true area": 1.4 * thickness,
            "area held": lessons.area(coarse, values, 401),
            "nodes inside": int(np.count_nonzero(values <= 0)),
        }

    controls = {
        "nodes": _slider("nodes on each axis", 5, 41, 2, 11),
        "thickness": _slider("thickness (m)", 0.04, 0.6, 0.02, 0.3),
        "shift": _slider("shift (m)", -0.2, 0.2, 0.01, 0.05),
    }
    return Explorer(draw, controls, size=(6.0, 3.6), alt="A bar, and what the nodes of a coarse grid hold of it")


def explore_upwinding() -> Explorer:
    """A profile carried along a line with left, central or right differences and a time step of your choice."""

    def draw(figure: Figure, difference: str, cfl: float, nodes: int, velocity: float) -> Numbers:
        with np.errstate(over="ignore"):
            profile = lessons.carry(difference, cfl=cfl, nodes=nodes, velocity=velocity)
        teaching.draw_profile(figure.subplots(), profile)
        return {"time steps": profile.steps, "largest error (m)": profile.error}

    controls = {
        "difference": _choice("difference", lessons.DIFFERENCES, "right"),
        "cfl": _slider("step, CFL number", 0.1, 1.5, 0.05, 0.75),
        "nodes": _slider("nodes", 20, 160, 10, 80),
        "velocity": _slider("velocity (m/s)", -1.0, 1.0, 0.25, 1.0),
    }
    return Explorer(
        draw, controls, size=(7.0, 3.2), alt="A hat-shaped profile, where it should be and where it is computed to be"
    )


def explore_schemes() -> Explorer:
    """A disk carried back under an adversary: flux, order and grid against the exact answer."""

    def draw(figure: Figure, flux: str, order: int, nodes: int, adversary: float) -> Numbers:
        scheme = Scheme(flux=flux, order=order, integrator=INTEGRATOR[order], frame="fixed", dtype="float64")
        case = lessons.shrink(nodes, scheme, adversary=adversary)
        ax = figure.subplots()
        teaching.draw_shrunk(ax, case)
        ax.legend(handles=teaching.shrunk_legend(), loc="lower right")
        return {
            "time steps": case.steps,
            "mean error near the boundary (m)": case.mean_error,
            "nodes wrongly inside": case.wrongly_inside,
        }

    controls = {
        "flux": _choice("flux", ("godunov", "lax-friedrichs"), "godunov"),
        "order": _choice("order", (1, 2, 3), 1),
        "nodes": _slider("nodes on each axis", 11, 81, 10, 31),
        "adversary": _slider("adversary's speed (m/s)", 0.0, 1.0, 0.05, 0.3),
    }
    return Explorer(draw, controls, size=(5.2, 3.9), alt="The computed reach set and the exact one")


# ----------------------------------------------------------------------------------------------------------------------
# One interval, and games in the plane: solved anew at each change
# ----------------------------------------------------------------------------------------------------------------------


def explore_interval(nodes: int = 49) -> Explorer:
    """A boat that holds a heading for one interval, in turning water and wind: solved and played at each change."""

    @lru_cache(maxsize=32)
    def solved(hold: float, wind: float, heading: float) -> illustrations.OneStepGame:
        u = (1.5 * math.cos(heading), 1.5 * math.sin(heading))
        return illustrations.one_step_game(illustrations.boat_problem(nodes=nodes, hold=hold, wind=wind, heading=u))

    def draw(
        figure: Figure, show: str, hold: float, wind: float, heading: float, x: float, y: float, progress: bool
    ) -> Numbers:
        game = solved(hold, wind, heading)
        played = illustrations.play(game.problem, (x, y))
        games.draw_one_step(figure.subplots(), game, show=show, starts=[("$q$", played)])
        cost = float(game.problem.grid.interpolate(game.cost, np.array([[x, y]]))[0])
        won = played.costs <= 0
        return {
            "share of the lake in the reach-avoid set": game.problem.grid.fraction(game.cost <= 0),
            "cost of q, Eq. (6)": cost,
            "runs won": f"{int(won.sum())} of {won.size}",
        }

    controls = {
        "show": _choice("show", games.CONSTRUCTS, "reach-avoid"),
        "hold": _slider("length of the interval (s)", 0.1, 0.9, 0.05, 0.6, live=False),
        "wind": _slider("wind, at most (m/s)", 0.0, 0.5, 0.02, 0.14, live=False),
        "heading": _slider("heading held (rad)", -1.0, 1.0, 0.05, 0.05, live=False),
        "x": _slider("start x (m)", -0.9, 0.6, 0.02, -0.4),
        "y": _slider("start y (m)", -0.5, 0.8, 0.02, 0.2),
    }
    return Explorer(
        draw, controls, size=(6.6, 4.2), slow=True, alt="Reach-avoid set of one interval with runs against many winds"
    )


def explore_holding(nodes: int = 41) -> Explorer:
    """One horizon of 0.8 s cut into 1 to 8 intervals: what it costs to hold an input and not to look."""

    def draw(figure: Figure, intervals: int, v_max: float, input_levels: int, progress: bool) -> Numbers:
        problem = lessons.point_robot(nodes, intervals, delta=0.8 / intervals, v_max=v_max, input_levels=input_levels)
        table = sdhj.solve(problem, progress=progress)
        ax = figure.subplots()
        teaching.draw_plane_game(ax, table)
        ax.set_title(f"{intervals} intervals of {0.8 / intervals:.2f} s")
        return {
            "share of the square inside": table.fraction(start=0, within=intervals),
            "one-step games solved": len(problem.inputs) * intervals * (intervals + 1) // 2,
        }

    controls = {
        "intervals": _slider("intervals in 0.8 s", 1, 8, 1, 4, live=False),
        "v_max": _slider("adversary's speed (m/s)", 0.0, 0.9, 0.05, 0.25, live=False),
        "input_levels": _slider("input levels on each axis", 2, 5, 1, 3, live=False),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), slow=True, alt="Tubes of the point robot")


def explore_plane_game(nodes: int = 41) -> Explorer:
    """The point robot's whole game, solved at each change: adversary, sampling interval, inputs, obstacle."""

    def draw(
        figure: Figure,
        v_max: float,
        delta: float,
        input_levels: int,
        obstacle_x: float,
        obstacle_speed: float,
        start: int,
        progress: bool,
    ) -> Numbers:
        obstacle = Disk(Line((obstacle_x, -0.45), (0.0, obstacle_speed)), 0.16)
        table = sdhj.solve(
            lessons.point_robot(nodes, 4, delta=delta, v_max=v_max, input_levels=input_levels, obstacle=obstacle),
            progress=progress,
        )
        ax = figure.subplots()
        teaching.draw_plane_game(ax, table, start=start)
        ax.set_title(f"from step {start}, $t = {start * delta:.2f}$ s")
        return {f"within {n}": table.fraction(start=start, within=n) for n in range(4 - start + 1)}

    controls = {
        "v_max": _slider("adversary's speed (m/s)", 0.0, 0.9, 0.05, 0.25, live=False),
        "delta": _slider("sampling interval (s)", 0.05, 0.4, 0.05, 0.2, live=False),
        "input_levels": _slider("input levels on each axis", 2, 5, 1, 3, live=False),
        "obstacle_x": _slider("obstacle's x (m)", -0.8, 0.1, 0.05, -0.15, live=False),
        "obstacle_speed": _slider("obstacle's speed (m/s)", 0.0, 1.0, 0.05, 0.5, live=False),
        "start": _slider("start, step k", 0, 4, 1, 0),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), slow=True, alt="Tubes of the point robot")


def explore_row(table: LookupTable) -> Explorer:
    """A row of the look-up table: every tube from one step, and the leftmost one that holds a point you place."""

    def draw(figure: Figure, start: int, x: float, y: float) -> Numbers:
        return teaching.draw_row(figure.subplots(), table, start=start, point=(x, y))

    controls = {
        "start": _slider("start, step k", 0, table.steps, 1, 0),
        "x": _slider("x (m)", -1.0, 1.0, 0.05, -0.3),
        "y": _slider("y (m)", -1.0, 1.0, 0.05, 0.3),
    }
    return Explorer(draw, controls, size=(8.6, 2.1), alt="A row of tubes, the leftmost that holds the point framed")


# ----------------------------------------------------------------------------------------------------------------------
# The arm
# ----------------------------------------------------------------------------------------------------------------------


def explore_spaces(problem: ReachAvoidProblem) -> Explorer:
    """Place the arm in C-space and see it in the workspace, or the other way round."""

    def draw(figure: Figure, q1: float, q2: float, px: float, py: float, step: float) -> Numbers:
        return teaching.draw_both_spaces(figure, problem, state=(q1, q2, px, py), step=step)

    controls = {
        "q1": _angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": _angle("joint angle q2 (rad)", POSTURE[1]),
        **_agent(problem),
        "step": _slider("time (steps of delta)", 0.0, float(problem.steps), 0.1, 0.0),
    }
    return Explorer(draw, controls, alt="The arm in the workspace and as a point in configuration space")


def explore_view_time(problem: ReachAvoidProblem) -> Explorer:
    """Swept volume of the moving obstacles over one interval, and what a union of samples misses."""

    def draw(figure: Figure, step: int, samples: int) -> Numbers:
        return teaching.draw_view_time(figure, problem, step=step, samples=samples)

    controls = {
        "step": _slider("step k", 0, problem.steps - 1, 1, 2),
        "samples": _slider("samples of the interval", 1, 20, 1, 2),
    }
    return Explorer(draw, controls, alt="Swept and sampled obstacles in the workspace and in configuration space")


def explore_tube(table: LookupTable) -> Explorer:
    """Slice the four-dimensional tube wherever you like."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int, q1: float, q2: float) -> Numbers:
        return teaching.draw_tube_and_arm(figure, table, state=(q1, q2, px, py), start=start, within=within)

    controls = {
        **_agent(table.problem),
        **_steps(table),
        "q1": _angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": _angle("joint angle q2 (rad)", POSTURE[1]),
    }
    return Explorer(draw, controls, alt="A slice of the tube beside the arm")


def explore_pursuer(table: LookupTable) -> Explorer:
    """The other slice: for one posture of the arm, where may the pursuer be?"""

    def draw(figure: Figure, q1: float, q2: float, start: int, within: int) -> Numbers:
        return teaching.draw_pursuer_plane(
            figure.subplots(), table, state=(q1, q2, 0.36, 0.36), start=start, within=within
        )

    controls = {
        "q1": _angle("joint angle q1 (rad)", POSTURE[0]),
        "q2": _angle("joint angle q2 (rad)", POSTURE[1]),
        **_steps(table),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Where the pursuer may start")


def explore_arm_game(nodes: int = 15, method: str = "hji") -> Explorer:
    """The arm's game in four dimensions, solved at each change of the adversary, clock, inputs or an obstacle."""

    @lru_cache(maxsize=16)
    def solved(v_p: float, v_d: float, delta: float, levels: int, x: float, y: float, progress: bool) -> LookupTable:
        from sdhj.arm.case_studies import OBSTACLES

        obstacles = (Disk(Still((x, y)), 0.06), *OBSTACLES[1:])
        problem = sdhj.arm_case_study(
            nodes, delta=delta, v_p_max=v_p, v_d_max=v_d, input_levels=levels, obstacles=obstacles
        )
        return sdhj.solve(problem, method=method, progress=progress)

    def draw(
        figure: Figure, v_p: float, v_d: float, delta: float, levels: int, x: float, y: float, progress: bool
    ) -> Numbers:
        return teaching.draw_tube_and_arm(
            figure, solved(v_p, v_d, delta, levels, x, y, progress), state=(*POSTURE, 0.24, 0.24)
        )

    controls = {
        "v_p": _slider("pursuer's speed (m/s)", 0.0, 0.8, 0.05, 0.2, live=False),
        "v_d": _slider("disturbance (rad/s)", 0.0, 2.0, 0.1, 0.3, live=False),
        "delta": _slider("sampling interval (s)", 0.05, 0.2, 0.01, 0.1, live=False),
        "levels": _slider("input levels on each axis", 2, 7, 1, 5, live=False),
        "x": _slider("static obstacle x (m)", -0.3, 0.3, 0.02, -0.22, live=False),
        "y": _slider("static obstacle y (m)", -0.3, 0.3, 0.02, 0.1, live=False),
    }
    return Explorer(draw, controls, slow=True, alt="A slice of the tube, solved anew")


def explore_gap(full: LookupTable, inner: LookupTable) -> Explorer:
    """A tube by two methods over each other."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int) -> Numbers:
        return teaching.draw_gap(figure, full, inner, state=(*POSTURE, px, py), start=start, within=within)

    return Explorer(draw, {**_agent(full.problem), **_steps(full)}, alt="Two tubes over each other")


def explore_certified(table: LookupTable, certified: Any) -> Explorer:
    """What of an interpolated table is certified, slice by slice."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int) -> Numbers:
        return teaching.draw_certified(figure, table, certified, state=(*POSTURE, px, py), start=start, within=within)

    return Explorer(draw, {**_agent(table.problem), **_steps(table)}, alt="Certified and interpolated tube")


def explore_run(
    table: LookupTable,
    states: Sequence[Sequence[float]],
    *,
    adversaries: Sequence[str] = ("none", "random", "aggressive", "worst"),
    rules: Sequence[str] = ("deepest",),
) -> Explorer:
    """Play and step through a run from one of `states` against an adversary of your choice."""
    controllers = {rule: sdhj.Controller(table, rule=rule) for rule in rules}

    @lru_cache(maxsize=64)
    def run(number: int, adversary: str, rule: str, seed: int) -> Any:
        return sdhj.simulate(
            controllers[rule], np.asarray(states[number], dtype=np.float64), adversary=adversary, seed=seed
        )

    def draw(figure: Figure, number: int, adversary: str, rule: str, seed: int, moment: float) -> Numbers:
        played = run(number, adversary, rule, seed)
        index = round(moment / 100 * (len(played.times) - 1))
        runs.draw_moment(figure, table, played, index=index)
        return {
            "time (s)": float(played.times[index]),
            "outcome": played.outcome,
            "steps taken": len(played.inputs),
            "cost so far": _closest(table.problem, played, index),
        }

    moment = _slider("progress of the run (%)", 0, 100, 4, 60)
    moment.player = ipywidgets.Play(min=0, max=100, step=4, interval=250, show_repeat=True)
    ipywidgets.jslink((moment.player, "value"), (moment, "value"))
    controls = {
        "number": _slider("initial state", 0, len(states) - 1, 1, 0)
        if len(states) > 1
        else _choice("initial state", (0,), 0),
        "adversary": _choice("adversary", adversaries, adversaries[-1]),
        "rule": _choice("rule", rules, rules[0]),
        "seed": _slider("seed", 0, 9, 1, 0),
        "moment": moment,
    }
    return Explorer(draw, controls, size=(8.2, 3.7), alt="One moment of a run")


def _closest(problem: ReachAvoidProblem, played: Any, index: int) -> float:
    """The least clearance so far, m, negated: positive after a collision (the second term of Eq. (5))."""
    clearances = [problem.unsafe_value(played.states[i : i + 1], float(played.times[i]))[0] for i in range(index + 1)]
    return -float(min(clearances))


def explore_evader(nodes: int = 13, method: str = "hji") -> Explorer:
    """The evading target of Sec. 6.1, solved at each change of its speed and size."""

    @lru_cache(maxsize=16)
    def solved(v_e: float, v_d: float, radius: float, progress: bool) -> LookupTable:
        return sdhj.solve(
            sdhj.evader_case_study(nodes, v_e_max=v_e, v_d_max=v_d, evader_radius=radius),
            method=method,
            progress=progress,
        )

    def draw(figure: Figure, v_e: float, v_d: float, radius: float, px: float, py: float, progress: bool) -> Numbers:
        return teaching.draw_tube_and_arm(figure, solved(v_e, v_d, radius, progress), state=(*POSTURE, px, py))

    problem = sdhj.evader_case_study(nodes)
    controls = {
        "v_e": _slider("evader's speed (m/s)", 0.0, 0.6, 0.05, 0.1, live=False),
        "v_d": _slider("disturbance (rad/s)", 0.0, 2.0, 0.1, 0.3, live=False),
        "radius": _slider("evader's radius (m)", 0.05, 0.1, 0.01, 0.06, live=False),
        **_agent(problem, 0.1, 0.18),
    }
    return Explorer(draw, controls, slow=True, alt="A slice of the tube of the evader game")


def explore_car(table: LookupTable) -> Explorer:
    """The car's tubes, heading by heading."""

    def draw(figure: Figure, heading: float, within: int) -> Numbers:
        return teaching.draw_car(figure.subplots(), table, heading=heading, within=within)

    controls = {
        "heading": _angle("heading (rad)", 0.0),
        "within": _slider("within, steps to go n", 0, table.steps, 1, table.steps),
    }
    return Explorer(draw, controls, size=(4.8, 3.9), alt="Tubes of the car for one heading")
