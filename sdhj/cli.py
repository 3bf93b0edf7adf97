"""The command line: `sdhj --help`."""

import functools
import json
import os
import re
import reprlib
import runpy
import signal
import sys
import time
import traceback
import uuid
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from functools import reduce
from multiprocessing import get_context
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory, gettempdir
from types import FrameType
from typing import Any, cast

import click
import numpy as np

from sdhj.arm.case_studies import arm_case_study
from sdhj.arm.workspace import KINEMATICS
from sdhj.certified.check import verify as check
from sdhj.certified.export import FIELDS, export_c
from sdhj.certified.sets import Certified
from sdhj.certified.table import CertifiedTable
from sdhj.common.findings import ResolutionWarning
from sdhj.common.remembering import FloatArray
from sdhj.common.showing import announced
from sdhj.formulas.graph import Node, leaf
from sdhj.formulas.text import shown
from sdhj.problem.grid import Grid
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.restoring import formulas_in, sets_in, tables_of
from sdhj.problem.sets import VIEW_TIMES
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.runs import MOST_RUNS, monte_carlo, outcome_name, simulate
from sdhj.solving import METHODS, load, solve
from sdhj.table.controller import Controller
from sdhj.table.files import (
    TEMPORARIES,
    VERSION,
    arrays_in,
    opened_table,
    read_head,
    replaced_whole,
    writable_file,
)
from sdhj.table.rules import RULES


def stop(number: int, frame: FrameType | None) -> None:
    """Handle a signal: delete temporary files, say on standard error that sdhj was stopped, and end the process.

    Nothing is raised that could be caught; the exit status is 128 + `number`.
    """
    for temporary in list(TEMPORARIES):
        with suppress(OSError):
            temporary.unlink()
    what = "interrupted" if number == signal.SIGINT else "ended by a signal"
    with suppress(OSError):
        os.write(2, f"\nsdhj was {what}; no unfinished file is left, and existing files are unchanged\n".encode())
    os._exit(128 + number)


NEW_ROBOT = Path(__file__).with_name("new_robot.txt")
INTERPOLATED = tuple(name for name in METHODS if name != Certified.name)  # tubes between nodes
METHOD = click.Choice(list(METHODS))
RUNS = click.IntRange(1, MOST_RUNS)
SEED = click.IntRange(0)
PATH = click.Path(path_type=Path)
TABLE = click.argument("table", type=PATH)
PROBLEM = click.option("--problem", help="module:name or file.py:name of the problem, of a table with black boxes.")
VIEWS = click.Choice(VIEW_TIMES)
READINGS = click.Choice(KINEMATICS)
# small problems that call every kernel, what takes longest first: so many cells that certified tubes grow
WARM_CELLS = {"arm": (63, 63, 18, 18), "car": (48, 48, 32)}
WARMED = [(robot, method) for method in ("certified", "hji") for robot in WARM_CELLS]
WARMED += [("arm", "projected"), ("arm", "lax")]


class Refusal(click.ClickException):
    """An error that ends a command with one clear line on standard error and exit status 2."""

    exit_code = 2


def plainly(function: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command: errors become one line on standard error, and compiling is reported."""

    @functools.wraps(function)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            with announced(progress=True):
                function(*args, **kwargs)
        except BrokenPipeError:  # the reader has closed the pipe; click then ends silently
            raise
        except KeyboardInterrupt:
            click.echo("\ninterrupted; no unfinished file is left, and existing files are unchanged", err=True)
            sys.exit(128 + signal.SIGINT)
        # what the package raises on purpose; anything else is a fault of its own, and shows a traceback
        except (ValueError, OSError, MemoryError, ImportError) as error:
            said = str(error)
            if isinstance(error, OSError) and error.filename is not None and error.strerror:  # not "[Errno 17] ..."
                said = f"{os.fsdecode(error.filename)}: {error.strerror}"
            raise Refusal(" ".join(said.split()) or type(error).__name__) from error

    return wrapped


def numbers(option: str, text: str, kind: type = float) -> list[Any]:
    """The numbers in a text, separated by commas: at least one; ValueError names `option`."""
    try:
        return [kind(part) for part in text.split(",")]
    except ValueError:
        kinds = "whole numbers" if kind is int else "numbers"
        # STATE is an argument, and no option
        option = option if option.isupper() else f"--{option}"
        raise ValueError(f"{option} must be {kinds} separated by commas, got {reprlib.repr(text)}") from None


@click.group(context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(VERSION, prog_name="sdhj")
def main() -> None:
    """Sampled-data Hamilton-Jacobi reachability for robust motion planning."""


@main.command("solve")
@click.argument("robot", required=False)
@click.option("--nodes", type=int, help="Of the arm: nodes on each axis.  [default: 25]")
@click.option("--steps", type=int, help="Of the arm: N, the number of sampling intervals.  [default: 8]")
@click.option("--method", type=METHOD, help="The method.  [default: hji; certified without a number of steps]")
@click.option("--view-time", type=VIEWS, help="Of the arm: how moving obstacles are treated within an interval.")
@click.option("--kinematics", type=READINGS, help="Of the arm: the textbook's, or Eq. (8) as printed.")
@click.option("--cells", help="The number of cells on each axis, separated by commas; implies --method certified.")
@click.option("--seconds", type=float, help="About what a solve may take, to choose cells; implies --method certified.")
@click.option("--store", type=PATH, help="A folder for a table larger than memory, in place of -o.")
@click.option("-o", "--output", type=PATH, help="The file to write or replace.")
@plainly
def solve_command(
    robot: str | None,
    method: str | None,
    cells: str | None,
    seconds: float | None,
    store: Path | None,
    output: Path | None,
    **of_the_arm: Any,
) -> None:
    """Solve a robot's problem, or the arm's case study, and write its table.

    ROBOT is module:name or file.py:name, of a problem or of a function that returns one; by default the paper's arm.
    """
    counts = None if cells is None else numbers("cells", cells, int)
    of_cells: dict[str, Any] = {"cells": counts, "seconds": seconds}
    of_cells = {name: value for name, value in of_cells.items() if value is not None}
    if of_cells and method not in (None, Certified.name):
        raise ValueError(
            f"--{next(iter(of_cells))} needs --method certified, got --method {method}; leave out one of them"
        )
    if (output is None) == (store is None):
        raise ValueError("give -o, the file to write, or --store, a folder for a table larger than memory")
    chosen: Any = Certified(**of_cells) if of_cells or method == Certified.name else method
    # Before the solve, which may take long.
    if output is not None:
        writable_file(output)
    # click hands these options over by the names of `arm_case_study`'s arguments
    given = {name: value for name, value in of_the_arm.items() if value is not None}
    if robot is not None and given:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise ValueError(f"{options} is of the arm's case study; state it in the problem of {robot}")
    problem = arm_case_study(**({"nodes": 25, "steps": 8} | given)) if robot is None else user_problem(robot, "ROBOT")
    table = solve(problem, chosen, store=store)
    if output is not None:
        try:
            table.save(output)
        except OSError as error:  # as on a full disk
            kept = Path(gettempdir()) / f"sdhj-{uuid.uuid4().hex}.npz"
            table.save(kept)
            raise Refusal(f"{error}; the table was saved as {kept} instead") from error
    name, steps = click.format_filename(cast(Path, output or store)), table.steps
    what = "stays clear" if problem.has_no_target else "target reachable"
    share, took = table.fraction(start=0, within=steps), table.details["seconds"]
    lasting = f"within {steps} steps"
    if problem.has_no_target:
        lasting = f"for ever, found in {steps} steps" if table.details.get("endless") else f"for {steps} steps"
    click.echo(f"{name}: {what} from {share:.1%} of C {lasting}; solved in {took:.1f} s")


@main.command("simulate")
@TABLE
@click.option("--start", help="Simulate one run from this state: numbers separated by commas, for the arm q1,q2,px,py.")
@click.option("--runs", type=RUNS, show_default="10000", help="Number of runs from uniformly drawn admissible states.")
@click.option("--adversary", default="worst", type=click.Choice(list(ADVERSARIES)), help="The adversary's strategy.")
@click.option("--rule", default="deepest", help="The rule that selects one of the safe inputs.")
@click.option("--seed", default=0, type=SEED, help="Seed of the adversary and of the start states.")
@plainly
def simulate_command(table: Path, start: str | None, runs: int | None, adversary: str, rule: str, seed: int) -> None:
    """Simulate the controller of a table against an adversary."""
    state = None if start is None else np.array(numbers("start", start))
    if start is not None and runs is not None:
        # Refused before the table is read.
        raise ValueError("--start simulates one run and --runs many from random start states; give only one of them")
    controller = Controller(load(table), rule=rule)
    if state is None:
        click.echo(str(monte_carlo(controller, runs=runs or 10_000, adversary=adversary, seed=seed)))
        return
    if state.size != controller.problem.grid.ndim or not np.isfinite(state).all():
        raise ValueError(f"--start must be {controller.problem.grid.ndim} finite numbers, got {reprlib.repr(start)}")
    trajectory = simulate(controller, state, adversary=adversary, seed=seed)
    # the states of a run that belong to one input
    inputs, per_input = controller.problem.inputs, len(trajectory.states) // max(len(trajectory.inputs), 1)
    for i, (t, at) in enumerate(zip(trajectory.times, trajectory.states, strict=True)):
        line = f"{t:7.3f} s  " + "  ".join(f"{x:+8.4f}" for x in at)
        if per_input and i % per_input == 0 and i // per_input < len(trajectory.inputs):
            j = int(trajectory.inputs[i // per_input])
            line += f"  input {j}: ({', '.join(format(u, 'g') for u in inputs[j])})"
        click.echo(line)
    click.echo(f"outcome: {outcome_name(trajectory.outcome, controller.problem.has_no_target)}")


@main.command()
@TABLE
@plainly
def info(table: Path) -> None:
    """Print what a table contains and how it was computed."""
    with opened_table(table, check=True) as (head, file):
        mathematics = in_mathematics(head, arrays_in(file))
    grid, steps = head["grid"], head["steps"]
    name = click.format_filename(table)
    click.echo(f"{name}: {head['problem']}, method {head['method']}, written by sdhj {head['sdhj_version']}")
    for axis, (low, high, n) in enumerate(zip(grid.lower, grid.upper, grid.shape, strict=True)):
        ends = " and ".join(dict.fromkeys(grid.ends[axis]))  # of the lower and of the upper end
        kind = "periodic" if grid.periodic[axis] else f"bounded, {ends} ends"
        click.echo(f"  {grid.names[axis]}: {n} nodes on [{low:g}, {high:g}], {kind}")
    lasting = " (steps=None)" if head["details"].get("endless") else ""
    much = f"{len(head['inputs'])} inputs, view-time {head['view_time']}"
    click.echo(f"  {steps} steps of {head['delta']:g} s{lasting}, {much}")
    if head["sensing"]:
        click.echo(
            "  sensing: " + ", ".join(f"{name} {value}" for name, value in head["sensing"].entry_in_head.items())
        )
    click.echo(f"  details: {json.dumps(head['details'], sort_keys=True)}")
    # of a certified table alone, by `solve`
    if "checked" in head["details"]:
        looked, made = head["details"]["checked"]
        more = f"; sdhj verify {name} checks all" if looked < made else ""
        click.echo(f"  {looked:,} of {made:,} claims were checked at the solve{more}")
    click.echo(f"  problem digest: {head['digest']}")
    for line in mathematics:
        click.echo(f"  {line}")
    if opaque := head["formulas"]["opaque"]:
        click.echo("  black boxes, which a file cannot contain, so that load(path, problem=...) needs the problem:")
        for what, why in opaque.items():
            click.echo(f"    {what}: {why}")
        return
    # Shares need the table itself, which of black boxes only their author can load.
    read = load(table)
    if isinstance(read, CertifiedTable):
        steps_of = f"{read.steps_of_rounding()} steps in which all rounding, of 1e-14 each, falls to one side"
        click.echo(f"  from the states that it contains, promises hold for {steps_of}")
    shares = [read.fraction(start=0, within=n) for n in range(steps + 1)]
    click.echo("  share of C inside from step 0: " + "  ".join(f"{n}: {share:.4f}" for n, share in enumerate(shares)))


def in_mathematics(head: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> list[str]:
    """The dynamics under the first input, and the level-set function of each set, as lines; without black boxes."""
    found, grid = formulas_in(head, tables_of(arrays)), head["grid"]
    bounds, velocity = found["bounds"].entries[0], list[Node]()
    v = [f"v{d + 1}" for d in range(len(bounds))]
    if "velocity" in found:
        velocity = found["velocity"].entries[0].tolist()
    elif {"drift", "gain"} <= set(found):
        pushes = found["gain"].entries[0] * [leaf("p", 1 + d) for d in range(len(v))]
        velocity = reduce(np.add, pushes.T, found["drift"].entries[0]).tolist()
    u = ", ".join(format(one, "g") for one in head["inputs"][0])
    lines = [f"dynamics under the first of {len(head['inputs'])} inputs, u = ({u}):"]
    # `shown` ends with a line for each result; the lines before are letters for parts of these
    text, most = shown(velocity, grid.names, ["t", *v]), shown(bounds.tolist(), grid.names)[-len(v) :]
    letters, rates = text[: len(text) - len(velocity)], text[len(text) - len(velocity) :]
    text = letters + [f"d{name}/dt = {one}" for name, one in zip(grid.names, rates, strict=False)]
    text += [f"|{one}| <= {bound}" for one, bound in zip(v, most, strict=True) if bound != "0"]
    lines += [f"  {one}" for one in text]
    if all(entry["kind"] != "target" for entry in head["sets"]):
        lines.append("no target: the robot only has to stay clear")
    for name, entry in sets_in(head).items():
        if name in found:
            chosen = "" if entry.get("sampling", "nodes") == "nodes" else f", sampling {entry['sampling']}"
            chosen += f", under inputs {', '.join(map(str, entry['inputs']))}" if "inputs" in entry else ""
            *letters, value = shown(found[name].outputs, [grid.names[axis] for axis in entry["axes"]])
            lines.append(f"{entry['kind']} {entry['name']!r}{chosen}:")
            lines += [f"  {one}" for one in (*letters, f"{value} <= 0")]
    return lines


@main.command("verify")
@TABLE
@click.option(
    "--samples",
    default=0,
    type=click.IntRange(0),
    help="Check so many random cells (of the arm, pairs of them); 0: all.",
)
@click.option("--seed", default=0, type=SEED, help="Seed of the random sample.")
@click.option("--everywhere", is_flag=True, help="Prove what the file says of cells that are not promised, too.")
@PROBLEM
@click.option("--table", "of_folder", type=PATH, help="Of the folder of an export: its table.")
@click.pass_context
@plainly
def verify_command(
    context: click.Context,
    table: Path,
    samples: int,
    seed: int,
    everywhere: bool,
    problem: str | None,
    of_folder: Path | None,
) -> None:
    """Check every claim of a certified table again, or with --table those of the folder of an export."""
    exported = None
    if of_folder is not None:
        exported, table = (table / "sdhj_table.bin" if table.is_dir() else table), of_folder
    elif (table / "sdhj_table.bin").is_file():
        raise ValueError(f"{table} is the folder of an export; give the table that it was made of: --table table.npz")
    given = {"samples": samples or None, "seed": seed, "everywhere": everywhere, "exported": exported}
    # 1: a claim is not proved; what could not be checked at all is a `Refusal`, with 2
    context.exit(0 if proved(table, problem, **given) else 1)


def proved(table: Path, problem: str | None, **options: Any) -> bool:
    """Whether the checker proves all claims of a certified table's file and, if given, of a file `exported` from it.

    Prints the problem as the checker read it, its report and the time.
    """
    if read_head(table)["method"] != "certified":
        how = 'solve(problem, "certified") makes a table with one, and so does `sdhj solve --method certified`'
        raise ValueError(f"{table} contains interpolated tubes, which have no proof; {how}")
    began, given = time.perf_counter(), None if problem is None else user_problem(problem)
    if given is not None:
        load(table, problem=given)  # which compares: what is proved of another problem says nothing of the file's
    report = check(table, given, **options)
    click.echo(f"{report.problem}\n\n{report}" if report.problem else f"{report}")
    click.echo(f"took {time.perf_counter() - began:.1f} s")
    return report.ok


def user_problem(name: str, option: str = "--problem") -> ReachAvoidProblem:
    """The problem that a user names as module:name or file.py:name, or what a function of that name returns.

    ValueError, naming `option`, whatever is wrong with the user's code.
    """
    place, _, what = name.rpartition(":")
    if not re.fullmatch(r"\w+", what) or not (place.endswith(".py") or re.fullmatch(r"[\w.]+", place)):
        raise ValueError(f"{option} must be module:name or file.py:name, of a problem, got {name!r}")
    # for good, as what the problem's functions import when they are called has to be found, too
    sys.path.insert(0, "")  # the module may lie in the current folder
    try:
        if place.endswith(".py"):
            sys.path.insert(0, str(Path(place).resolve().parent))
            found = runpy.run_path(place)[what]
        else:
            found = resolve_name(name)
        problem = found if isinstance(found, ReachAvoidProblem) else found()
    except Exception as error:  # user code can raise anything
        if isinstance(error, KeyError) and error.args == (what,):
            raise ValueError(f"{option} {name}: there is no {what} in it") from error
        where = _line_of(error, place)
        raise ValueError(f"{option} {name} failed with {type(error).__name__}: {error}{where}") from error
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"{option} {name} must be or return a ReachAvoidProblem, got {reprlib.repr(problem)}")
    return problem


def _line_of(error: Exception, place: str) -> str:
    """The words " (line n of place)": the last line of a user's file in an error's traceback; or ""."""
    lines = [at.lineno for at in traceback.extract_tb(error.__traceback__) if at.filename.endswith(Path(place).name)]
    return f" (line {lines[-1]} of {place})" if lines and place.endswith(".py") else ""


@main.command("export")
@TABLE
@click.option("-o", "--output", required=True, type=PATH, help="The folder to write to.")
@click.option("--rule", type=click.Choice([*RULES, "small"]), help="Which proved input the robot applies.")
@click.option("--only", help=f"What the file answers, some of {','.join(FIELDS)}: less is smaller.")
@click.option(
    "--brake", type=click.IntRange(0), help="The input to apply where nothing is proved; by default the least."
)
@click.option("--check", "check_it", is_flag=True, help="Prove the table and the file, as `sdhj verify` does.")
@PROBLEM
@click.pass_context
@plainly
def export_command(
    context: click.Context,
    table: Path,
    output: Path,
    rule: str | None,
    only: str | None,
    brake: int | None,
    check_it: bool,
    problem: str | None,
) -> None:
    """Write a certified table for a robot, as C99."""
    read = load(table, problem=None if problem is None else user_problem(problem))
    fields = tuple(only.split(",")) if only else FIELDS
    done = export_c(cast(Any, read), output, rule=rule, only=fields, brake=brake)
    click.echo(f"{output}: sdhj_table.bin, {done.nbytes:,} bytes of flash; sdhj.h, sdhj_robot.h: 5 kB of code")
    click.echo(
        f"  stack: some {STACK} bytes; a look-up loads 4 numbers of a cell, of {2**read.grid.ndim} cells, twice, on "
        "edges of all axes"
    )
    if check_it and not proved(table, problem, exported=output / "sdhj_table.bin"):
        context.exit(1)


STACK = 300  # bytes at most, of gcc on x86-64


@main.command("explain")
@TABLE
@click.argument("state")
@click.option("--step", default=0, type=click.IntRange(0), help="k, the step at which the robot is there.")
@click.option("--within", type=click.IntRange(0), help="n, the steps to go.  [default: all that are left]")
@PROBLEM
@plainly
def explain_command(table: Path, state: str, step: int, within: int | None, problem: str | None) -> None:
    """Say why a table promises a STATE, numbers separated by commas, or does not."""
    read: Any = load(table, problem=None if problem is None else user_problem(problem))
    q, names = np.array(numbers("STATE", state)), read.grid.names
    if len(q) != len(names):
        given = f"{len(names)} number{'s' * (len(names) > 1)} separated by commas, for {', '.join(names)}"
        raise ValueError(f"STATE must be {given}, got {state!r}")
    if step > read.steps:
        raise ValueError(f"--step must be from 0 to {read.steps}, as the table has so many steps, got {step}")
    click.echo(str(read.explain(q, step, within)))


@main.command("plot")
@TABLE
@click.option("-o", "--output", required=True, type=PATH, help="The PNG or SVG to write.")
@click.option("--axes", help="The two axes of the slice by name, separated by a comma.  [default: the first two]")
@click.option("--at", multiple=True, help="Where the slice is on another axis: name=number.  [default: the middle]")
@click.option("--step", default=0, type=click.IntRange(0), help="k, the step of the tubes.")
@click.option("--start", help="Draw a run from this state, numbers separated by commas, in place of the tubes.")
@click.option("--adversary", default="worst", type=click.Choice(list(ADVERSARIES)), help="Of the run.")
@PROBLEM
@plainly
def plot_command(
    table: Path,
    output: Path,
    axes: str | None,
    at: tuple[str, ...],
    step: int,
    start: str | None,
    adversary: str,
    problem: str | None,
) -> None:
    """Draw the tubes of a table on a slice, or a run."""
    from sdhj import plotting

    # refused before the table is read, which may take long
    plotting.looks.writable_picture(output, (".png", ".svg"))
    read = load(table, problem=None if problem is None else user_problem(problem))
    along, through = slice_of(read.grid, axes, at)
    with plotting.style():
        figure = plotting.new_figure(4.2, 3.8)
        ax = figure.subplots()
        if start is None:
            plotting.draw_tubes(ax, read, through=through, start=step, axes=along)
            rest = [axis for axis in range(read.grid.ndim) if axis not in along]
            ax.set_title(", ".join(f"{read.grid.names[axis]} = {through[axis]:g}" for axis in rest))
        else:
            run = simulate(Controller(read), np.array(numbers("start", start)), adversary=adversary)
            plotting.draw_run(ax, read, run, axes=along)
            click.echo(f"outcome: {outcome_name(run.outcome, read.problem.has_no_target)}")
        with replaced_whole(output) as temporary:
            figure.savefig(temporary)
    click.echo(f"{output}: {' and '.join(read.grid.names[axis] for axis in along)} of {read.problem.name!r}")


def slice_of(grid: Grid, axes: str | None, at: Sequence[str]) -> tuple[list[int], FloatArray]:
    """The axes of a slice, by number, and a state on it: in the middle but where `at` has "name=number"."""
    if grid.ndim < 2:
        raise ValueError("a slice has two axes, and this robot has one; `sdhj info` prints its shares")

    def axis_of(name: str) -> int:
        if name.strip() not in grid.names:
            raise ValueError(f"there is no axis {name.strip()!r}; the axes are {', '.join(grid.names)}")
        return list(grid.names).index(name.strip())

    along = [axis_of(name) for name in axes.split(",")] if axes else [0, 1]
    if len(along) != 2:
        raise ValueError(f"--axes must be two names separated by a comma, got {axes!r}")
    through = np.add(grid.lower, grid.upper) / 2
    for one in at:
        # Without "=" the value is "", which `numbers` refuses.
        name, _, value = one.partition("=")
        (through[axis_of(name)],) = numbers("at", value)
    return along, through


@main.command("new")
@click.argument("file", type=PATH)
@plainly
def new_command(file: Path) -> None:
    """Write a commented robot to begin with, to FILE, for example car.py."""
    if file.suffix != ".py":
        raise ValueError(f"a robot is a Python file, such as car.py, got {file}")
    if file.exists():
        raise ValueError(f"{file} exists; choose another name")
    with replaced_whole(file) as temporary:
        temporary.write_text(NEW_ROBOT.read_text(encoding="utf-8"), encoding="utf-8")
    table = file.with_suffix(".npz")
    click.echo(f"{file}: a car that you can change. Next: sdhj solve {file}:problem --method certified -o {table}")


@main.command()
@plainly
def warmup() -> None:
    """Compile every kernel and store it in the disk cache."""
    with ProcessPoolExecutor(
        min(2, os.cpu_count() or 1), get_context("spawn")
    ) as pool:  # compilers wait for each other
        found = {pool.submit(compile_kernels, *one): " by ".join(one) for one in WARMED}
        for one in as_completed(found):
            click.echo(f"{found[one]}: {one.result():.1f} s")


def compile_kernels(robot: str, method: str) -> float:
    """Compile all kernels that a small problem of arm or car calls; returns how long it took, s."""
    began, certified = time.perf_counter(), method == Certified.name
    problem = arm_case_study(nodes=9, steps=2) if robot == "arm" else new_robot()
    with warnings.catch_warnings(action="ignore", category=ResolutionWarning):  # the table is thrown away
        table = solve(problem, Certified(cells=WARM_CELLS[robot]) if certified else method, progress=False)
    # look-ups, runs and the checker have kernels of their own
    table.contains(np.add(problem.grid.lower, problem.grid.upper) / 2)
    monte_carlo(Controller(table), runs=10, adversary="worst", seed=0, progress=False)
    if certified:
        with TemporaryDirectory() as folder:
            table.save(path := Path(folder) / "certified.npz")
            check(path, samples=10, progress=False)
    return time.perf_counter() - began


def new_robot() -> ReachAvoidProblem:
    """The problem of the robot that `sdhj new` writes."""
    # of this name, as the text itself and `sdhj new` tell users to solve FILE:problem
    problem: ReachAvoidProblem = runpy.run_path(str(NEW_ROBOT))["problem"]()
    return problem


def command() -> None:
    """Run the command `sdhj`, and end the process."""
    for number in (signal.SIGINT, signal.SIGTERM):  # end it at once, unless they are ignored
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, stop)
    warnings.formatwarning = lambda message, *_, **__: f"Warning: {message}\n"
    try:
        main(prog_name="sdhj")
    except OSError as error:  # the output of --help cannot be written
        sys.exit(f"Error: {error}")
    finally:
        try:
            click.echo(nl=False)
        except OSError:  # Python would try once more at its end, and end with a traceback
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
