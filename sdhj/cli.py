"""The command line: `sdhj --help`."""

import functools
import json
import os
import re
import reprlib
import signal
import sys
import time
import uuid
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import reduce
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory, gettempdir
from types import FrameType
from typing import Any

import click
import numpy as np

from sdhj.arm.case_studies import arm_case_study
from sdhj.certified.check import verify as check
from sdhj.certified.labels import shares
from sdhj.certified.sets import Certified
from sdhj.formulas.graph import Node, leaf
from sdhj.formulas.text import shown
from sdhj.kernels import FloatArray
from sdhj.kernels.compiling import announced
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.restoring import formulas_in, sets_in
from sdhj.problem.sets import VIEW_TIMES
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.runs import MOST_RUNS, monte_carlo, simulate
from sdhj.solver.resolution import ResolutionWarning
from sdhj.solving import load, solve
from sdhj.table.controller import Controller
from sdhj.table.files import TEMPORARIES, VERSION, arrays_in, header, opened, tables_of, writable_file


def stop(number: int, frame: FrameType | None) -> None:
    """Delete temporary files and end the process with status 128 + the signal's number; no exception can be caught."""
    for temporary in list(TEMPORARIES):
        with suppress(OSError):
            temporary.unlink()
    what = "interrupted" if number == signal.SIGINT else "asked to end"
    with suppress(OSError):
        os.write(2, f"\nsdhj was {what}; no unfinished file is left, and existing files are unchanged\n".encode())
    os._exit(128 + number)


def stop_at_signals() -> None:
    """Make Ctrl-C and SIGTERM end this process with `stop`."""
    for number in (signal.SIGINT, signal.SIGTERM):
        with suppress(ValueError):  # only the main thread may set handlers
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                signal.signal(number, stop)


INTERPOLATED = ("hji", "projected", "lax")  # the methods whose tubes are interpolated between nodes
METHOD = click.Choice([*INTERPOLATED, "certified"])
PICTURES = (".png", ".pdf", ".svg")
RUNS = click.IntRange(1, MOST_RUNS)
SEED = click.IntRange(0)
VIEWS = click.Choice(VIEW_TIMES)
READINGS = click.Choice(["relative", "printed"])
WARM_CELLS = (63, 63, 18, 18)  # enough cells that the tubes of the certified table grow, so that every kernel is called


class Interrupted(click.ClickException):
    """One sentence on standard error, exit status 130, as shells expect after Ctrl-C."""

    exit_code = 130


class Refusal(click.ClickException):
    """One clear line on standard error, exit status 2."""

    exit_code = 2


def plainly(command: Callable[..., None]) -> Callable[..., None]:
    """Turn the library's errors into one line without a traceback, and report when kernels are compiled."""

    @functools.wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            with announced(progress=True):
                command(*args, **kwargs)
        except BrokenPipeError:  # the reader has closed the pipe; click then ends silently
            raise
        except KeyboardInterrupt:
            raise Interrupted("interrupted; no unfinished file is left, and existing files are unchanged") from None
        except (ValueError, OSError, MemoryError, ImportError) as error:
            raise Refusal(" ".join(str(error).split()) or type(error).__name__) from error

    return wrapped


def writable_picture(path: Path | None, suffixes: Sequence[str] = PICTURES) -> None:
    """Check before long work that the picture `path`, if there is one, can be drawn and written.

    Raises
    ------
    ValueError, OSError, ImportError
        For another file type, for a place that cannot be written to, and without Matplotlib.
    """
    if path is None:
        return
    writable_file(path)
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{path} must end in {' or '.join(suffixes)}, which selects the file type of the picture")
    from sdhj.plotting import write  # noqa: F401 - a failing import is reported before long work


class WithStart(click.Command):
    """A command whose option --start takes all numbers that follow it."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        if "--start" in args:
            first = args.index("--start") + 1
            last = next((place for place in range(first, len(args)) if not is_number(args[place])), len(args))
            if first == last < len(args):
                raise click.UsageError(f"--start must be followed by numbers, got {reprlib.repr(args[first])}", context)
            args = [*args[:first], " ".join(args[first:last]), *args[last:]]
        return super().parse_args(context, args)


def is_number(text: str) -> bool:
    """Whether a word is a number."""
    with suppress(ValueError):
        float(text)
        return True
    return False


def whole_numbers(option: str, text: str) -> list[int]:
    """Parse whole numbers separated by commas."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--{option} must be whole numbers separated by commas, got {text!r}") from None


@click.group(context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(VERSION, prog_name="sdhj")
def main() -> None:
    """Sampled-data Hamilton-Jacobi reachability for robust motion planning."""


@main.command("solve")
@click.option("--nodes", default=25, help="Nodes on each axis.")
@click.option("--steps", default=8, help="N, the number of sampling intervals.")
@click.option("--method", default="hji", type=METHOD, help="The method that solves the games.")
@click.option("--view-time", default="swept", type=VIEWS, help="How moving obstacles are treated within an interval.")
@click.option("--kinematics", default="relative", type=READINGS, help="The textbook arm, or Eq. (8) as printed.")
@click.option("--cells", help="With --method certified: the number of cells on each axis, separated by commas.")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The HDF5 file to write.")
@plainly
def solve_command(
    nodes: int, steps: int, method: str, view_time: str, kinematics: str, cells: str | None, output: Path
) -> None:
    """Solve the arm case study and write its look-up table."""
    if cells is not None and method != "certified":
        raise ValueError(f"--cells needs --method certified, got --method {method}; leave out one of them")
    counts = None if cells is None else whole_numbers("cells", cells)
    writable_file(output)
    problem = arm_case_study(nodes=nodes, steps=steps, view_time=view_time, kinematics=kinematics)
    chosen = Certified(cells=counts) if method == "certified" else method
    table = solve(problem, chosen)
    name = click.format_filename(_saved(table, output))
    share, seconds = table.fraction(start=0, within=steps), table.details["seconds"]
    click.echo(f"{name}: target reachable from {share:.1%} of C within {steps} steps; solved in {seconds:.1f} s")


def at_a_terminal() -> bool:
    """Whether a user can be prompted."""
    return sys.stdin is not None and sys.stdin.isatty()


def _saved(table: Any, output: Path) -> Path:
    """Save the table and return its path; if that fails, as on a full disk, prompt for another path at a terminal.

    Without a terminal the table is saved in the folder for temporary files, and the error message names it.
    """
    while True:
        try:
            table.save(output)
            return output
        except OSError as error:
            if at_a_terminal():
                click.echo(f"Error: {error}", err=True)
                output = click.prompt("Another file to write the table to", type=click.Path(path_type=Path))
            else:
                kept = Path(gettempdir()) / f"sdhj-{uuid.uuid4().hex}.h5"
                table.save(kept)
                raise Refusal(f"{error}; the table was saved as {kept} instead") from error


@main.command("simulate", cls=WithStart)
@click.argument("table", type=click.Path(path_type=Path))
@click.option("--start", help="Simulate one run from this state: a number for each axis, for the arm q1 q2 px py.")
@click.option("--runs", type=RUNS, show_default="10000", help="Number of runs from uniformly drawn admissible states.")
@click.option("--adversary", default="worst", type=click.Choice(list(ADVERSARIES)), help="The adversary's strategy.")
@click.option("--rule", default="deepest", help="The rule that selects one of the safe inputs.")
@click.option("--seed", default=0, type=SEED, help="Seed of the adversary and of the start states.")
@plainly
def simulate_command(table: Path, start: str | None, runs: int | None, adversary: str, rule: str, seed: int) -> None:
    """Simulate the controller of a table against an adversary."""
    state = np.array(start.split() if start is not None else [], float)
    if start is not None and not (state.size and np.isfinite(state).all()):
        raise ValueError(f"--start must be finite numbers, one for each axis, got {reprlib.repr(start)}")
    if start is not None and runs is not None:
        raise ValueError("--start simulates one run and --runs many from random start states; give only one of them")
    controller = Controller(load(table), rule=rule)
    if start is None:
        click.echo(str(monte_carlo(controller, runs=runs or 10_000, adversary=adversary, seed=seed)))
        return
    trajectory = simulate(controller, state, adversary=adversary, seed=seed)
    for t, at in zip(trajectory.times, trajectory.states, strict=True):
        click.echo(f"{t:7.3f} s  " + "  ".join(f"{x:+8.4f}" for x in at))
    click.echo(f"outcome: {trajectory.outcome}")


@main.command()
@click.argument("table", type=click.Path(path_type=Path))
@plainly
def info(table: Path) -> None:
    """Print what a table contains and how it was computed."""
    with opened(table) as (head, file):
        mathematics = in_mathematics(head, arrays_in(file))
    grid, steps = head["grid"], head["steps"]
    name = click.format_filename(table)
    click.echo(f"{name}: {head['problem']}, method {head['method']}, written by sdhj {head['sdhj_version']}")
    for axis in range(grid.ndim):
        kind = "periodic" if grid.periodic[axis] else "bounded"
        click.echo(
            f"  {grid.names[axis]}: {grid.shape[axis]} nodes on [{grid.lower[axis]:g}, {grid.upper[axis]:g}], {kind}"
        )
    click.echo(f"  {steps} steps of {head['delta']:g} s, {len(head['inputs'])} inputs, view-time {head['view_time']}")
    click.echo(f"  details: {json.dumps(head['details'], sort_keys=True)}")
    click.echo(f"  problem digest: {head['digest']}")
    for line in mathematics:
        click.echo(f"  {line}")
    if opaque := head["formulas"]["opaque"]:
        click.echo("  black boxes, which a file cannot contain, so that load(path, problem=...) needs the problem:")
        for what, why in opaque.items():
            click.echo(f"    {what}: {why}")
        return
    read = load(table)
    shares = [read.fraction(start=0, within=n) for n in range(steps + 1)]
    click.echo("  share of C inside from step 0: " + "  ".join(f"{n}: {share:.4f}" for n, share in enumerate(shares)))


def in_mathematics(head: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> list[str]:
    """The dynamics under the first input, and the sets, of the head of a file and its tables, as lines."""
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
    text = shown(velocity, grid.names, ["t", *v])
    lines += text[: len(text) - len(velocity)]
    lines += [f"d{name}/dt = {one}" for name, one in zip(grid.names, text[len(text) - len(velocity) :], strict=False)]
    most = shown(bounds.tolist(), grid.names)
    lines += [f"|{one}| <= {bound}" for one, bound in zip(v, most[-len(v) :], strict=True) if bound != "0"]
    lines[1:] = [f"  {one}" for one in lines[1:]]
    for name, entry in sets_in(head).items():
        if name in found:
            *letters, value = shown(found[name].outputs, [grid.names[axis] for axis in entry["axes"]])
            lines += [f"{entry['kind']} {entry['name']!r}:", *(f"  {one}" for one in letters), f"  {value} <= 0"]
    return lines


@main.command("verify")
@click.argument("table", type=click.Path(path_type=Path))
@click.option(
    "--samples",
    default=0,
    type=click.IntRange(0),
    help="Check a random sample of this many cells (for the arm, pairs of joint cells); 0 checks every claim.",
)
@click.option("--seed", default=0, type=SEED, help="Seed of the random sample.")
@click.option(
    "--certified",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Certified table with which an interpolated table is compared.",
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Figure of the comparison: png, pdf or svg.")
@click.option("--problem", help="module:function that returns the problem, of a table with black boxes.")
@click.pass_context
@plainly
def verify_command(
    context: click.Context,
    table: Path,
    samples: int,
    seed: int,
    certified: Path | None,
    output: Path | None,
    problem: str | None,
) -> None:
    """Check a certified table, or compare another table with one."""
    writable_picture(output)
    certain = header(table)["method"] == "certified"
    if certain and (certified or output):
        raise ValueError(
            f"{table} is itself a certified table: its claims are checked, and there is nothing to compare or to draw; "
            "leave out --certified and -o, or give an interpolated table first"
        )
    if certain:
        began = time.perf_counter()
        report = check(table, user_problem(problem), samples=samples or None, seed=seed)
        click.echo(f"{report}\ntook {time.perf_counter() - began:.1f} s")
        context.exit(0 if report.ok else 1)
    if samples:
        raise ValueError(f"--samples applies to certified tables only, and {table} is not one; leave it out")
    if certified is None:
        raise ValueError(
            f"{table} contains interpolated tubes, which have no proof; make a certified table with `sdhj solve "
            "--method certified -o certified.h5` and compare with it: `sdhj verify --certified certified.h5 ...`"
        )
    read, proof = load(table), load(certified)
    if proof.method != "certified":
        raise ValueError(f"{certified} was solved by {proof.method!r}; --certified needs a table of method 'certified'")
    _compare(read, proof, seed, output)


def user_problem(name: str | None) -> Any:
    """Return what module:function returns; the module may lie in the current folder."""
    if name is None:
        return None
    if not re.fullmatch(r"[\w.]+:\w+", name):
        raise ValueError(f"--problem must be module:function, got {name!r}")
    sys.path.insert(0, "")
    try:
        problem = resolve_name(name)()
    except Exception as error:  # user code can raise anything
        raise ValueError(f"calling --problem {name} failed with {type(error).__name__}: {error}") from error
    if not isinstance(problem, ReachAvoidProblem):
        raise ValueError(f"--problem {name} must return a ReachAvoidProblem, got {reprlib.repr(problem)}")
    return problem


def _compare(table: Any, proof: Any, seed: int, output: Path | None) -> None:
    for name, share in shares(table, proof, within=table.steps, seed=seed).items():
        click.echo(f"{name:<14}{share:8.2%} of the state space, within {table.steps} steps from step 0")
    if output is not None:
        from sdhj import plotting

        with plotting.style():
            figure = plotting.new_figure(5.0, 4.6)
            middle = np.mean([table.grid.lower, table.grid.upper], axis=0).tolist()
            through = [0.0, 0.0, 0.24, 0.24] if table.problem.recipe else middle
            plotting.draw_labels(figure.subplots(), table, proof, through=through)
            figure.legend(handles=plotting.label_legend(), loc="outside upper center", ncols=3)
            plotting.write(figure, output)
        click.echo(output)


@main.command()
@plainly
def warmup() -> None:
    """Compile every kernel and store it in the disk cache."""
    compile_kernels((*INTERPOLATED, "certified"), click.echo)


def compile_kernels(methods: Sequence[str] = INTERPOLATED, say: Callable[[str], Any] = lambda line: None) -> None:
    """Compile every kernel that the methods and the controller need, by solving a small problem."""
    for method in methods:
        began = time.perf_counter()
        say(f"warming up {method}")
        chosen = Certified(cells=WARM_CELLS) if method == "certified" else method
        with warnings.catch_warnings(action="ignore", category=ResolutionWarning):  # the table is thrown away
            table = solve(arm_case_study(nodes=9, steps=2), chosen, progress=False)
        monte_carlo(Controller(table), runs=10, adversary="worst", seed=0, progress=False)
        if method == "certified":
            with TemporaryDirectory() as folder:
                table.save(path := Path(folder) / "certified.h5")
                check(path, samples=10, progress=False)
        say(f"  {time.perf_counter() - began:.1f} s")


def command() -> None:
    """Run the command `sdhj`; Ctrl-C and SIGTERM end it at once."""
    stop_at_signals()
    main(prog_name="sdhj")


if __name__ == "__main__":
    command()
