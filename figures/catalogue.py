"""Every figure of the paper by name, from tables that are solved at most once.

`FIGURES` lists them; `draw(name, context)` returns a Matplotlib figure and `write` saves it. The scripts in `figures/`
and `sdhj reproduce` are thin shells around this module. It is not imported by `import sdhj`, which needs no Matplotlib.
"""

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import sdhj
from sdhj import experiments, illustrations, plotting
from sdhj.arm.case_studies import ArmScene, scene
from comparison import compare
from sdhj.files import writable_folder
from sdhj.grid import FloatArray
from sdhj.plotting import diagrams, games, runs, studies
from label_pictures import draw_labels, label_legend
from sdhj.problem import ReachAvoidProblem
from sdhj.simulation import OUTCOMES
from sdhj.table import LookupTable
from sdhj.warmup import compile_kernels

FORMATS = ("pdf", "png")
SHOWN_STATE = (-2.2, -0.9, 0.19, 0.22)  # what Figs. 1 and 9 show
PURSUER_AT = (0.0, 0.0, 0.24, 0.24)  # the slices of Figs. 10, 11: the joint angles play no part
PURSUER_ALSO = (0.0, 0.0, -0.15, 0.21)
PURSUERS = ((0.24, 0.24), (-0.15, 0.21), (-0.27, -0.09), (0.12, -0.21), (0.30, 0.03), (0.03, 0.33))  # Fig. 13
BOAT_STARTS = (("$q$", (-0.42, 0.30)), ("$q'$", (-0.42, 0.03)), ("$q''$", (-0.60, 0.68)))
CANDIDATES = 20_000  # states among which a run's start is chosen
STARTS = 20  # runs, of which the longest is shown
TIMED_NODES = studies.PAPER_NODES
TIMED_METHODS = ("hji", "projected")
STUDY_RUNS = 200
# of the tables that extra_certified compares
CELLS = ((42, 42, 12, 12), (84, 84, 36, 36), (210, 210, 36, 36), (210, 210, 72, 72), (419, 419, 72, 72))
EVADER_AT = (0.0, 0.0, 0.12, 0.12)


class Context:
    """What the figures are drawn from, each part made when first asked for and kept.

    Parameters
    ----------
    nodes : int
        Nodes on each axis of the case study.
    tables : mapping, optional
        Tables that are already solved, by method; they fix the problem.
    seed : int
        Of the run that Figs. 4, 8 and 12 show.
    timed_nodes : sequence of int, optional
        Grid densities of Fig. 14; the paper's, or just `nodes` where that is coarser than all of them.
    say : callable, optional
        Receives a line before anything that takes long.
    """

    def __init__(
        self,
        *,
        nodes: int = 25,
        tables: Mapping[str, LookupTable] | None = None,
        seed: int = 0,
        timed_nodes: Sequence[int] | None = None,
        say: Callable[[str], Any] | None = None,
    ) -> None:
        self._tables = dict(tables or {})
        given = next(iter(self._tables.values()), None)
        self.problem: ReachAvoidProblem = given.problem if given else sdhj.arm_case_study(nodes=nodes)
        self.seed, self.say = seed, say or (lambda line: None)
        self.nodes = self.problem.grid.shape[0]
        self.timed_nodes = tuple(timed_nodes or (TIMED_NODES if self.nodes >= min(TIMED_NODES) else (self.nodes,)))

    @property
    def scene(self) -> ArmScene:
        return scene(self.problem)

    def table(self, method: str = "hji") -> LookupTable:
        """The case study's table by a method, solved once."""
        if method not in self._tables:
            self.say(f"solving: {method}, {self.nodes} nodes on each axis")
            self._tables[method] = sdhj.solve(self.problem, method=method)
        return self._tables[method]

    @cached_property
    def run(self) -> runs.Run:
        """A run of the controller against the paper's random adversary: of STARTS many, the one with the most steps."""
        table = self.table("hji")
        controller = sdhj.Controller(table)
        tried = [
            sdhj.simulate(controller, start, adversary="random", seed=self.seed)
            for start in starts_of_runs(table, STARTS, self.seed)
        ]
        return max(tried, key=lambda run: (run.outcome == "reached", len(run.inputs)))

    @cached_property
    def boat(self) -> illustrations.OneStepGame:
        """The small game of Figs. 6 and 7."""
        return illustrations.one_step_game(illustrations.boat_problem())

    @cached_property
    def timings(self) -> dict[str, dict[int, float]]:
        """Seconds by method and nodes, measured here and now (Fig. 14)."""
        return measure(self.timed_nodes, TIMED_METHODS, self.say)


def starts_of_runs(table: LookupTable, count: int, seed: int = 0, within: int = 7) -> FloatArray:
    """States (up to count, ndim) with `within` steps to go at step 0, or the most there are.

    Of many such states well inside their tube, those whose agent is nearest to the target.

    Raises
    ------
    ValueError
        Where no tube holds any of the states tried.
    """
    grid = table.grid
    states = np.random.default_rng(seed).uniform(grid.lower, grid.upper, (CANDIDATES, grid.ndim))
    inside = np.stack(
        [grid.interpolate(table.values(start=0, within=n), states) for n in range(min(within, table.steps) + 1)]
    )
    for n in range(len(inside) - 1, -1, -1):
        fits = (inside[n] <= 0) & (inside[n - 1] > 0 if n else True)
        if fits.any():
            deep = fits & (inside[n] <= np.quantile(inside[n][fits], 0.3))
            nearest = np.argsort(np.where(deep, _agent_to_target(table.problem, states), np.inf), kind="stable")
            return states[nearest[: min(count, int(deep.sum()))]]
    raise ValueError(f"none of {CANDIDATES} states is admissible; use more nodes or an easier problem")


def _agent_to_target(problem: ReachAvoidProblem, states: FloatArray) -> FloatArray:
    """How far the agent is from the middle of the known target's way, (M,); zeros where the target is the agent."""
    target = scene(problem).target
    if target is None:
        return np.zeros(len(states))
    return np.linalg.norm(states[:, 2:4] - target.centre(problem.time(problem.steps) / 2), axis=1)


def measure(
    nodes: Sequence[int], methods: Sequence[str] = TIMED_METHODS, say: Callable[[str], Any] = lambda line: None
) -> dict[str, dict[int, float]]:
    """Seconds that each method takes at each density for constraints and recursion, as the paper counts.

    Compiling is not counted: every method solves a small problem first.
    """
    seconds: dict[str, dict[int, float]] = {method: {} for method in methods}
    compile_kernels(methods)
    for count in nodes:
        for method in methods:  # one after the other, so that what else the machine does weighs on both
            say(f"timing: {method}, {count} nodes on each axis")
            began = time.perf_counter()
            sdhj.solve(sdhj.arm_case_study(nodes=count), method=method)
            seconds[method][count] = time.perf_counter() - began
    return seconds


def machine() -> str:
    """How many cores of what kind, for the legend of measured times."""
    return f"{os.cpu_count()} cores, {platform.machine()}"


# --------------------------------------------------------------------------------------------------------------------
# The figures
# --------------------------------------------------------------------------------------------------------------------


def _set_legend(figure: Figure, *, target: bool = True) -> None:
    entries = [plotting.patch("obstacles", "known obstacles"), plotting.patch("pursuer", "pursuer")]
    if target:
        entries.insert(1, plotting.patch("target", "target"))
    figure.legend(handles=entries, loc="outside upper center", ncols=3, handleheight=1.1)


def problem_diagram(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6, layout="none")
    diagrams.draw_problem(
        figure.add_axes((0.0, 0.0, 1.0, 1.0)), context.scene, state=SHOWN_STATE, trail=(0.0, 0.2, 0.4, 0.6, 0.8)
    )
    return figure


def offline_diagram(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.0)
    diagrams.draw_offline(figure)
    return figure


def online_diagram(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 2.6)
    diagrams.draw_online(figure)
    return figure


def sampled_data(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6)
    run = illustrations.sampled_run()
    runs.draw_sampled_data(
        figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0)),
        run.times,
        run.states[:, 0],
        run.held[:, 0],
        run.delta,
        levels=run.levels,
        names=("state $x(t)$ (m)", "input $u(t)$ (m/s)"),
    )
    return figure


def game_diagram(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 2.6)
    diagrams.draw_game(figure)
    return figure


def _rollouts(context: Context, *places: int) -> list[tuple[str, illustrations.Rollouts]]:
    return [
        (label, illustrations.play(context.boat.problem, start)) for label, start in (BOAT_STARTS[p] for p in places)
    ]


def reach_set(context: Context) -> Figure:
    figure = plotting.new_figure(5.0, 4.0)
    (label, inside), (_, outside) = _rollouts(context, 0, 2)
    games.draw_one_step(figure.subplots(), context.boat, show="reach", starts=[(label, inside), ("$q'$", outside)])
    figure.legend(handles=games.one_step_legend("reach"), loc="outside upper center", ncols=2)
    return figure


def reach_avoid_game(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.3)
    left, right = figure.subplots(1, 2, sharey=True)
    games.draw_one_step(left, context.boat, show="reach-avoid", starts=_rollouts(context, 0, 1, 2))
    games.draw_cost(right, context.boat)
    left.set_title("(a) runs from three states")
    right.set_title("(b) optimal cost $V^j$ (m); its zero level is bold")
    right.set_ylabel("")
    figure.legend(handles=games.one_step_legend("reach-avoid"), loc="outside upper center", ncols=3)
    return figure


def lookup_table(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 7.0)
    runs.draw_lookup(figure, context.table("hji"), context.run)
    return figure


def spaces(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.75)
    left, right = figure.subplots(1, 2)
    times = context.problem.delta * np.arange(0, context.problem.steps + 1, 2)
    plotting.draw_workspace(left, context.scene, state=SHOWN_STATE, trail=times)
    plotting.draw_constraints(right, context.problem, through=SHOWN_STATE)
    left.set_title(r"(a) workspace $\mathcal{W}$ at $t = 0$")
    right.set_title(r"(b) configuration space $\mathcal{C}^r$ at $t = 0$")
    _set_legend(figure)
    return figure


def _tubes(table: LookupTable) -> Figure:
    figure = plotting.new_figure(7.0, 4.15)
    parts = figure.subplot_mosaic([["left", "right"], ["bar", "bar"]], height_ratios=(1.0, 0.045))
    left, right, bar = parts["left"], parts["right"], parts["bar"]
    for ax, state in ((left, PURSUER_AT), (right, PURSUER_ALSO)):
        plotting.draw_tubes(ax, table, through=state)
        ax.set_title(f"pursuer at ({state[2]:.2f}, {state[3]:.2f}) m")
    right.set_ylabel("")
    plotting.draw_steps_bar(bar, table.steps, r"steps to go, $n$:  the set $\mathcal{S}_0^{N-n}$", horizontal=True)
    _set_legend(figure, target=False)
    return figure


def full_tubes(context: Context) -> Figure:
    return _tubes(context.table("hji"))


def projected_tubes(context: Context) -> Figure:
    return _tubes(context.table("projected"))


def trajectory(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 7.4)
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    left, right = above.subplots(1, 2)
    runs.draw_workspace_run(left, context.problem, context.run)
    runs.draw_cspace_run(right, context.table("hji"), context.run)
    left.set_title(r"(a) end-effector in $\mathcal{W}$")
    right.set_title(r"(b) robot in $\mathcal{C}^r$")
    steps = len(runs.samples(context.run, context.problem))
    columns = max(3, -(-steps // 2))
    runs.draw_frames(below.subplots(2, columns).ravel(), context.problem, context.run)
    _set_legend(figure)
    return figure


def _animation(context: Context, folder: Path) -> list[Path]:
    return [runs.save_animation(context.table("hji"), context.run, folder / "fig12_trajectory.gif")]


def comparison(context: Context) -> Figure:
    full, inner = context.table("hji"), context.table("projected")
    figure = plotting.new_figure(7.0, 5.3)
    for place, (ax, (px, py)) in enumerate(
        zip(figure.subplots(2, 3, sharex=True, sharey=True).ravel(), PURSUERS, strict=True)
    ):
        through = (0.0, 0.0, px, py)
        plotting.draw_comparison(ax, full, inner, through=through)
        kept = kept_share(full, inner, through)
        ax.set_title(f"({px:.2f}, {py:.2f}) m: {kept:.0%} kept", fontsize=8)
        ax.set(xlabel=ax.get_xlabel() if place >= 3 else "", ylabel=ax.get_ylabel() if place % 3 == 0 else "")
    figure.legend(handles=plotting.comparison_legend(), loc="outside upper center", ncols=4, handleheight=1.1)
    return figure


def kept_share(
    full: LookupTable, inner: LookupTable, through: Sequence[float], start: int = 0, within: int | None = None
) -> float:
    """Share of a slice of the full tube that the inner tube keeps; NaN where the full one is empty there."""
    within = full.steps if within is None else within
    where = plotting.plane(full.grid, through)
    inside = [where.of(table.grid, table.values(start=start, within=within)) <= 0 for table in (full, inner)]
    return float(inside[1].sum() / inside[0].sum()) if inside[0].any() else float("nan")


def isosurfaces(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.6, layout="none")
    for place, (method, title) in enumerate((("hji", "full"), ("projected", "projected"))):
        ax = figure.add_axes((0.49 * place, 0.0, 0.49, 0.94), projection="3d")
        ax.patch.set_visible(False)
        colour = "#6aa6d6" if method == "hji" else "#46ab9f"
        plotting.draw_isosurface(ax, context.table(method), through=PURSUER_AT, colour=colour)
        ax.set_title(
            f"{title}: {context.table(method).fraction(start=0, within=context.problem.steps):.1%} of $\\mathcal{{C}}$",
            y=0.97,
        )
    figure.text(
        0.5, 0.985, f"within {context.problem.steps} steps, $p_y$ = {PURSUER_AT[3]:.2f} m", ha="center", va="top"
    )
    return figure


def timings(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.3)
    studies.draw_timings(figure.subplots(1, 2, width_ratios=(1.5, 1.0)), context.timings, machine())
    return figure


def fractions(context: Context) -> Figure:
    figure = plotting.new_figure(4.6, 3.2)
    steps = context.problem.steps
    shares = {
        method: [context.table(method).fraction(start=0, within=n) for n in range(steps + 1)]
        for method in ("hji", "lax", "projected")
    }
    studies.fraction_curves(figure.subplots(), shares)
    return figure


def conservativeness(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.7)
    cut = {"px": PURSUER_AT[2], "py": PURSUER_AT[3]}
    numbers = compare(context.table("hji"), context.table("projected"), slices=[cut])
    left, right = figure.subplots(1, 2)
    studies.draw_entries(left, numbers.entries("ratio"), label="volume of the projected tube / full")
    title = f"Hausdorff distance (rad), pursuer at ({cut['px']:.2f}, {cut['py']:.2f}) m"
    studies.draw_entries(right, numbers.entries(numbers.header[-1]), label=title, cmap="cividis_r")
    return figure


def adversary_bounds(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.2)
    labels = {
        "v_p_max": "pursuer's speed bound $v_p^{\\max}$ (m/s)",
        "v_d_max": "disturbance bound $v_d^{\\max}$ (rad/s)",
    }
    for ax, (bound, label) in zip(figure.subplots(1, 2, sharey=True), labels.items(), strict=True):
        context.say(f"sweeping {bound}")
        sweeps = {m: experiments.sweep_adversary(bound, method=m, nodes=context.nodes) for m in TIMED_METHODS}
        nominal = context.problem.recipe["arguments"][bound]
        won = {method: sweep.won for method, sweep in sweeps.items()}
        studies.draw_sweep(ax, sweeps["hji"].values, won, xlabel=label, nominal=nominal)
        extinct = sweeps["hji"].extinct
        ax.set_title("nothing is left at " + (f"{extinct:g}" if extinct is not None else "none of these"))
        ax.set_ylabel(r"share of $\mathcal{C}$ won" if bound == "v_p_max" else "")
    return figure


def input_levels(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.0)
    sweep = experiments.sweep_input_levels(nodes=context.nodes)
    studies.draw_input_levels(figure.subplots(1, 2), sweep.levels, sweep.fractions, sweep.seconds)
    return figure


def selection_rules(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 2.9)
    outcomes = experiments.compare_rules(context.table("hji"), runs=STUDY_RUNS, seed=context.seed)
    rules = [outcome.rule for outcome in outcomes]
    panels = (
        ("effort", "mean effort (rad$^2$/s)", [o.effort for o in outcomes]),
        ("clearance", "mean least clearance (mm)", [1000 * o.clearance for o in outcomes]),
        ("time", "mean time to the target (s)", [o.time for o in outcomes]),
    )
    for ax, (name, label, values) in zip(figure.subplots(1, 3), panels, strict=True):
        studies.draw_bars(ax, rules, {name: values}, ylabel=label)
        ax.tick_params(axis="x", rotation=30)
    return figure


def view_times(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 2.9)
    outcomes = experiments.compare_view_times(nodes=context.nodes, runs=STUDY_RUNS, seed=context.seed)
    names = [outcome.view_time for outcome in outcomes]
    left, right = figure.subplots(1, 2)
    studies.draw_bars(left, names, {"share": [o.fraction for o in outcomes]}, ylabel=r"share of $\mathcal{C}$ inside")
    rates = [100 * outcome.rate for outcome in outcomes]
    studies.draw_bars(right, names, {"collisions": rates}, ylabel="promised safe, yet collided (%)")
    return figure


def evader(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.5)
    problem = sdhj.evader_case_study(nodes=context.nodes)
    chased = experiments.evading_target(nodes=context.nodes, runs=10 * STUDY_RUNS, seed=context.seed)
    left, right = figure.subplots(1, 2)
    plotting.draw_tubes(left, sdhj.solve(problem), through=EVADER_AT)
    left.set_title(f"evader at ({EVADER_AT[2]:.2f}, {EVADER_AT[3]:.2f}) m; dark is near")
    rates = {name: [100 * report.rate(outcome) for outcome in OUTCOMES] for name, report in chased.reports.items()}
    studies.draw_bars(right, OUTCOMES, rates, ylabel="runs (%)")
    right.set_title(f"won: full {chased.won:.1%}, projected {chased.projected_won:.1%} of $\\mathcal{{C}}$", pad=20)
    return figure


def certified(context: Context) -> Figure:
    cells = CELLS if context.nodes >= min(TIMED_NODES) else CELLS[:2]
    sweep = experiments.sweep_cells(context.problem, cells, context.say)
    steps = context.problem.steps
    peers = {method: context.table(method).fraction(start=0, within=steps) for method in ("hji", "lax", "projected")}
    figure = plotting.new_figure(7.0, 3.7)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    studies.draw_cells(left, sweep.numbers, sweep.fractions, peers)
    draw_labels(right, context.table("hji"), sweep.finest, through=PURSUER_AT)
    right.set_title(f"pursuer at ({PURSUER_AT[2]:.2f}, {PURSUER_AT[3]:.2f}) m; line: interpolated tube", fontsize=8)
    figure.legend(handles=label_legend(), loc="outside upper right", ncols=3)
    return figure


@dataclass(frozen=True)
class FigureSpec:
    """One picture: the paper's figure number (None: not in the paper), what it shows, how it is drawn.

    `also` writes further files into a folder, for example an animation. A `study` solves many problems of its own and
    is no part of the main job.
    """

    number: int | None
    title: str
    draw: Callable[[Context], Figure]
    also: Callable[[Context, Path], list[Path]] | None = None
    study: bool = False


FIGURES: dict[str, FigureSpec] = {
    "fig01_problem": FigureSpec(
        1, "Robot arm in a known moving workspace with an unpredictable agent", problem_diagram
    ),
    "fig02_offline": FigureSpec(2, "Offline stage: games, recursion, look-up table", offline_diagram),
    "fig03_online": FigureSpec(3, "Online stage: control synthesis at each sampling step", online_diagram),
    "fig04_sampled_data": FigureSpec(
        4, "Sampled-data model: a continuous state, measured and controlled at times t_k", sampled_data
    ),
    "fig05_game": FigureSpec(5, "Who acts on the joint configuration", game_diagram),
    "fig06_reach_set": FigureSpec(6, "Reach set of S under one input", reach_set),
    "fig07_game_cost": FigureSpec(7, "Reach-avoid set, the cost's zero level, defeating adversaries", reach_avoid_game),
    "fig08_lookup_table": FigureSpec(8, "The look-up table and a run's way through it", lookup_table),
    "fig09_spaces": FigureSpec(9, "Workspace and configuration space", spaces),
    "fig10_tubes": FigureSpec(10, "Reach-avoid tubes from step 0", full_tubes),
    "fig11_projected": FigureSpec(11, "Reach-avoid tubes by projections", projected_tubes),
    "fig12_trajectory": FigureSpec(12, "A run in workspace and configuration space", trajectory, _animation),
    "fig13_comparison": FigureSpec(13, "Full and projected tubes laid over each other", comparison),
    "fig13_isosurface": FigureSpec(13, "Full and projected tubes over (q1, q2, p_x)", isosurfaces),
    "fig14_timing": FigureSpec(14, "Computation times, full against projected", timings),
    "extra_conservativeness": FigureSpec(
        None, "What projecting costs: volume ratio and Hausdorff distance of every tube", conservativeness
    ),
    "extra_fractions": FigureSpec(None, "Share of C inside against the steps to go, by method", fractions),
    "extra_adversary": FigureSpec(
        None, "The victory domain against the adversary's bounds, to extinction", adversary_bounds, study=True
    ),
    "extra_input_levels": FigureSpec(None, "What more input levels bring and cost", input_levels, study=True),
    "extra_rules": FigureSpec(None, "Selection rules: effort, clearance, time", selection_rules, study=True),
    "extra_view_time": FigureSpec(None, "View-times, and the collisions they let through", view_times, study=True),
    "extra_evader": FigureSpec(None, "The evading target", evader, study=True),
    "extra_certified": FigureSpec(
        None, "What is certified: against the number of cells, and in a slice", certified, study=True
    ),
}


def draw(name: str, context: Context) -> Figure:
    """Draw one figure.

    Raises
    ------
    ValueError
        For a name that is not in `FIGURES`.
    """
    if name not in FIGURES:
        raise ValueError(f"figure must be one of {', '.join(FIGURES)}, got {name!r}")
    with plotting.style():
        return FIGURES[name].draw(context)


def write(name: str, context: Context, folder: str | os.PathLike[str], formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw one figure and save it in `folder`, each file whole or not at all; returns the files.

    Raises
    ------
    ValueError
        For an unknown name or format.
    OSError
        Where the folder cannot be written.
    """
    folder = writable_folder(folder)
    files = plotting.save(draw(name, context), folder, name, formats)
    also = FIGURES[name].also
    return files + (also(context, folder) if also else [])


def draw_all(
    tables: Mapping[str, LookupTable],
    out: str | os.PathLike[str],
    *,
    seed: int = 0,
    timed_nodes: Sequence[int] | None = None,
    say: Callable[[str], Any] | None = None,
) -> list[Path]:
    """Write every figure but the studies; tables that are missing from `tables` are solved."""
    context = Context(tables=tables, seed=seed, timed_nodes=timed_nodes, say=say)
    files = []
    for name in (name for name, spec in FIGURES.items() if not spec.study):
        context.say(f"drawing {name}")
        files += write(name, context, out)
    return files
