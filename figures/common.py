"""What the figures share: tables that are solved once, a run, and a command line for each script.

A script `figNN_*.py` or `extra_*.py` has a function `draw(context)` that returns a Matplotlib figure, and its docstring
says in a sentence what that shows. Where it draws data, `value(context)` is a number, or some, that the figure shows,
and that the tests compare. Where it has `also(context, folder)`, that writes further files, an animation for example.
One with `MAIN_JOB = False` solves many problems of its own and is left out of the main job.
"""

import importlib
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import click
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Patch

import sdhj
from sdhj import plotting
from sdhj.arm.case_studies import ArmScene, scene
from sdhj.cli import SEED, plainly
from sdhj.common.remembering import FloatArray
from sdhj.plotting.looks import INK, TARGET_LOOKS, Looks, writable_folder
from sdhj.simulation.runs import Trajectory
from sdhj.table.batches import Table

HERE = Path(__file__).parent
ARROW_SECONDS = 0.8
NAMES = [path.stem for kind in ("fig[0-9]*", "extra_*") for path in sorted(HERE.glob(f"{kind}.py"))]
FORMATS = ("pdf", "png")
PAPER_NODES = (25, 30, 35, 40)
SHOWN_STATE = (-2.2, -0.9, 0.19, 0.22)  # what Figs. 1 and 9 show
PURSUER_AT = (0.0, 0.0, 0.24, 0.24)  # a slice of the tubes: the joint angles play no part
CANDIDATES = 20_000  # states among which a run's start is chosen
STARTS = 20  # runs, of which the longest is shown


class Context:
    """What the figures are drawn from, each part made when first asked for and kept.

    Parameters
    ----------
    nodes : int
        Nodes on each axis of the case study.
    tables : mapping, optional
        Tables that are already solved, by method; they fix the problem.
    seed : int
        Of the run that Figs. 8 and 12 show, and of the runs that are counted.
    runs : int
        Closed-loop runs in a study.
    say : callable, optional
        Receives a line before anything that takes long.
    """

    def __init__(
        self,
        *,
        nodes: int = 25,
        tables: Mapping[str, Table] | None = None,
        seed: int = 0,
        runs: int = 200,
        say: Callable[[str], Any] | None = None,
    ) -> None:
        self._tables = dict(tables or {})
        given = next(iter(self._tables.values()), None)
        self.problem = given.problem if given else sdhj.arm_case_study(nodes=nodes)
        self.seed, self.runs, self.say = seed, runs, say or (lambda line: None)
        self.nodes = self.problem.grid.shape[0]
        self.coarse = self.nodes < min(PAPER_NODES)  # a quick look: less of what takes long

    @property
    def scene(self) -> ArmScene:
        return scene(self.problem)

    def table(self, method: str = "hji") -> Table:
        """The case study's table by a method, solved once."""
        if method not in self._tables:
            self.say(f"solving: {method}, {self.nodes} nodes on each axis")
            self._tables[method] = sdhj.solve(self.problem, method=method)
        return self._tables[method]

    def shares(self, method: str) -> list[float]:
        """Share of C inside from step 0 by a method, for 0 steps to go and more."""
        return [self.table(method).fraction(start=0, within=n) for n in range(self.problem.steps + 1)]

    @cached_property
    def run(self) -> Trajectory:
        """A run of the controller against the paper's random adversary: of STARTS many, the one with the most steps."""
        return longest_run(self.table("hji"), "random", self.seed)


def longest_run(table: Table, adversary: str, seed: int) -> Trajectory:
    """Of STARTS many runs against an adversary the one that takes the most steps to the target."""
    controller = sdhj.Controller(table)
    tried = [sdhj.simulate(controller, start, adversary, seed=seed) for start in starts_of_runs(table, STARTS, seed)]
    return max(tried, key=lambda run: (run.outcome == "reached", len(run.inputs)))


def starts_of_runs(table: Table, count: int, seed: int = 0, within: int = 7) -> FloatArray:
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
            nearest = np.argsort(np.where(deep, _agent_to_target(table, states), np.inf), kind="stable")
            return states[nearest[: min(count, int(deep.sum()))]]
    raise ValueError(f"none of {CANDIDATES} states is admissible; use more nodes or an easier problem")


def _agent_to_target(table: Table, states: FloatArray) -> FloatArray:
    """How far the agent is from the middle of the known target's way, (M,); zeros where the target is the agent."""
    problem = table.problem
    target = scene(problem).target
    if target is None:
        return np.zeros(len(states))
    return np.linalg.norm(states[:, 2:4] - target.centre(problem.time(problem.steps) / 2), axis=1)


def set_legend(figure: Figure, *more: Artist, target: Looks = TARGET_LOOKS, pursuer: str = "pursuer") -> None:
    """What the sets of the case study look like, and what else is drawn, above the pictures."""
    entries: list[Artist] = [plotting.patch("obstacles", "known obstacles"), Patch(**target, label="target")]
    entries += [plotting.patch("pursuer", pursuer), *more]
    figure.legend(handles=entries, loc="outside upper center", ncols=3, handleheight=1.1)


# --------------------------------------------------------------------------------------------------------------------
# Drawing by name
# --------------------------------------------------------------------------------------------------------------------


def script(name: str) -> ModuleType:
    """The module that draws a figure; ValueError for a name that is not in `NAMES`."""
    if name not in NAMES:
        raise ValueError(f"figure must be one of {', '.join(NAMES)}, got {name!r}")
    return importlib.import_module(name)


def title(name: str) -> str:
    """What a figure shows, in a line."""
    return (script(name).__doc__ or "").splitlines()[0].rstrip(".")


def draw(name: str, context: Context) -> Figure:
    """Draw one figure in the project's style."""
    with plotting.style():
        return script(name).draw(context)


def write(name: str, context: Context, folder: str | os.PathLike[str], formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw one figure and save it in `folder`, each file whole or not at all; returns the files."""
    folder = writable_folder(folder)
    files = plotting.save(draw(name, context), folder, name, formats)
    also = getattr(script(name), "also", None)
    return files + (also(context, folder) if also else [])


def of_main_job() -> list[str]:
    """The figures that the main job draws."""
    return [name for name in NAMES if getattr(script(name), "MAIN_JOB", True)]


def write_all(context: Context, folder: str | os.PathLike[str], names: Sequence[str] = NAMES) -> list[Path]:
    """Write some figures, by default every one."""
    files = []
    for name in names:
        context.say(f"drawing {name}")
        files += write(name, context, folder)
    return files


def command(text: str, action: Callable[[Context, Path], list[Path]]) -> click.Command:
    """A command line that draws something into a folder; `text` is its help."""

    @click.command(help=f"{text}.", context_settings={"show_default": True})
    @click.option("--nodes", default=25, help="Nodes on each axis of the case study.")
    @click.option("--out", default="results", type=click.Path(path_type=Path), help="Folder for the files.")
    @click.option("--seed", default=0, type=SEED, help="Of the run that is shown.")
    @plainly
    def main(nodes: int, out: Path, seed: int) -> None:
        writable_folder(out)  # before long work
        for path in action(Context(nodes=nodes, seed=seed, say=click.echo), out):
            click.echo(path)

    return main


def draw_velocities(ax: Axes, view: ArmScene) -> None:
    """White arrows from the centres of the moving disks, as far as they go in `ARROW_SECONDS` from t = 0."""
    looks: dict[str, Any] = {"arrowstyle": "simple,head_width=6,head_length=6,tail_width=2.2", "mutation_scale": 1.0}
    looks |= {"facecolor": "white", "edgecolor": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0, "zorder": 4.5}
    for disk in [*view.obstacles, *([] if view.target is None else [view.target])]:
        if disk.speed:
            here, step = disk.centre(0.0), 1e-4
            velocity = (disk.centre(step) - disk.centre(-step)) / (2 * step)
            ends = tuple(here), tuple(here + ARROW_SECONDS * velocity)
            ax.add_artist(FancyArrowPatch(*ends, gid="velocity", **looks))


def command_of(file: str) -> click.Command:
    """The command line of a script, which gives its `__file__`."""
    name = Path(file).stem
    return command(title(name), lambda context, out: write(name, context, out))
