"""Fig. 14: Projections save most of the time by the paper's scheme, and less of it by the default.

Seconds of a processor, in one thread, for what the paper counts: constraints, avoid tubes and recursion. Of the steps
of the recursion, which are all alike, some are timed, and the quickest is taken as many times as there are steps. The
least of up to three rounds counts, in which the methods take turns, so that what else the machine does falls on both.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numba
import numpy as np
from charts import METHOD_LOOKS, METHOD_NAMES
from common import PAPER_NODES, Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdhj
from sdhj import plotting
from sdhj.plotting.looks import INK, OUTCOME_INK
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.solver.methods import Method
from sdhj.solver.projections import default_subspaces
from sdhj.solver.schemes import STAGES

PAPER_SECONDS = {"hji": (586.0, 1540.0, 3093.0, 5615.0), "projected": (105.0, 190.0, 347.0, 549.0)}
PAPER_MACHINE = "Intel Xeon W-2145"
PAPER_METHOD = sdhj.HJI(sdhj.Scheme(flux="lax-friedrichs", frame="fixed"))  # a PDE for each input
SCHEMES: dict[str, dict[str, Method]] = {
    "paper's scheme": {"hji": PAPER_METHOD, "projected": sdhj.Projected(inner=PAPER_METHOD)},
    "default": {"hji": sdhj.HJI(), "projected": sdhj.Projected()},
}
LOOKS: dict[str, dict[str, Any]] = {
    "paper": {"color": "#9a9a9a", "markerfacecolor": "white"},
    "paper's scheme": {},
    "node updates": {"color": OUTCOME_INK, "marker": "x", "linestyle": ":"},
    "default": {"linewidth": 0.8, "markersize": 2.5},
}
ROUNDS = 3
SHORT = 2.0  # seconds of a method's rounds after which it has no other: what takes longer scatters less
ENOUGH = 0.5  # seconds of steps of the recursion that are timed, or one step
LINE = "{:>5}  {:<14}  {:>8}  {:>12}  {:>5}  {:>12}"  # which `printed` reads
Measured = Mapping[str, Mapping[str, Mapping[int, float]]]  # as in LOOKS, by method, by nodes


def value(context: Context) -> float:
    """How many times as many nodes the full method updates, by the paper's scheme."""
    whole, parts = [tuple(range(context.problem.grid.ndim))], default_subspaces(context.problem)
    return node_updates(context.problem, whole) / node_updates(context.problem, parts)


def draw(context: Context) -> Figure:
    figure = plotting.new_figure(7.0, 3.9)
    draw_timings(figure.subplots(1, 2), measure((context.nodes,) if context.coarse else PAPER_NODES, context.say))
    return figure


def measure(nodes: Sequence[int], say: Callable[[str], Any]) -> Measured:
    """Seconds of both schemes, and updates of nodes by the paper's; the ratios of full to projected are said.

    Compiling is not counted: every method plays on a small grid first.
    """
    found: Measured = {name: {method: {} for method in PAPER_SECONDS} for name in (*SCHEMES, "node updates")}
    say(LINE.format("nodes", "scheme", "full, s", "projected, s", "ratio", "node updates"))
    for count in (9, *nodes):
        problem = sdhj.arm_case_study(nodes=count)
        whole = [tuple(range(problem.grid.ndim))]
        updates = [node_updates(problem, spaces) for spaces in (whole, default_subspaces(problem))]
        for name, methods in SCHEMES.items():
            rounds: dict[str, list[float]] = {method: [] for method in methods}
            taken = dict.fromkeys(methods, 0.0)
            for method in [*methods] * ROUNDS:
                if taken[method] < SHORT:
                    began = time.process_time()
                    rounds[method].append(seconds_of_a_thread(problem, methods[method]))
                    taken[method] += time.process_time() - began
            seconds = [min(own) for own in rounds.values()]
            if count not in nodes:
                continue
            for method, spent, updated in zip(methods, seconds, updates, strict=True):
                found[name][method][count], found["node updates"][method][count] = spent, updated
            counted = f"{updates[0] / updates[1]:.1f}" if name != "default" else ""
            told = *(f"{spent:.2f}" for spent in seconds), f"{seconds[0] / seconds[1]:.1f}"
            say(LINE.format(count, name, *told, counted))
    return found


def printed(lines: Sequence[str]) -> Measured:
    """What `measure` has found, from the lines that it said: to a hundredth of a second."""
    found: dict[str, dict[str, dict[int, float]]] = {name: {"hji": {}, "projected": {}} for name in SCHEMES}
    for line in lines:
        nodes, scheme, *seconds = line[:5], line[7:21].strip(), line[21:31], line[31:45]
        if scheme in SCHEMES:
            for method, spent in zip(PAPER_SECONDS, seconds, strict=True):
                found[scheme][method][int(nodes)] = float(spent)
    return found


def seconds_of_a_thread(problem: ReachAvoidProblem, method: Method) -> float:
    """Seconds that a processor takes to solve a problem in one thread, told from some steps of the recursion."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        began = time.process_time()
        sets = method.sets(problem, progress=False)
        sets.begin()  # avoid tubes
        for step in range(problem.steps + 1):
            sets.write_goal(step)
        ready, spent = time.process_time(), [time.process_time()]
        while spent[-1] - ready < ENOUGH and len(spent) <= problem.steps:
            sets.extend(problem.steps - len(spent), 1)
            spent.append(time.process_time())
        return ready - began + steps_of_the_recursion(problem) * float(np.diff(spent).min())
    finally:
        numba.set_num_threads(threads)


def steps_of_the_recursion(problem: ReachAvoidProblem) -> int:
    """The entries (k, n) of the table with n > 0."""
    return problem.steps * (problem.steps + 1) // 2


def node_updates(problem: ReachAvoidProblem, spaces: Sequence[Sequence[int]]) -> int:
    """How often the paper's scheme writes a node: at each stage of each time step, and to unite each input's set.

    The games are played on subspaces, or on the one that is the whole. Each input takes the time steps that its own
    velocities ask for; avoid tubes take those of the fastest (`HJIGames.steps`).
    """
    games, grid, count = PAPER_METHOD.on(Samples(problem)), problem.grid, len(problem.inputs)
    stages, cfl = len(STAGES[games.scheme.integrator]), games.scheme.cfl
    total = 0
    for axes in map(tuple, spaces):
        fields = [games.velocities(j, axes, 0) for j in range(count)]
        steps = sum(field.steps(grid.subgrid(axes), problem.delta, cfl) for field in fields)
        total += steps_of_the_recursion(problem) * stages * steps * grid.subgrid(axes).size
    for part in problem.unsafe:
        own, intervals = Samples(problem).avoid_axes(part.axes), problem.steps if problem.moves(part) else 1
        kept = {tuple(axis for axis in own if axis in axes) for axes in spaces}  # of which one may be the set's own
        kept = {own} if own in kept else kept
        total += intervals * stages * count * sum(games.steps(axes, 0) * grid.subgrid(axes).size for axes in kept)
    return total + steps_of_the_recursion(problem) * count * grid.size


def draw_timings(axes: Sequence[Axes], measured: Measured) -> None:
    """Seconds beside the paper's, and the ratios of full to projected, on two axes; of LOOKS what is `measured`."""
    times, ratio = axes
    theirs = {method: dict(zip(PAPER_NODES, seconds, strict=True)) for method, seconds in PAPER_SECONDS.items()}
    shown = {name: {"paper": theirs, **measured}[name] for name in LOOKS if name in {"paper", *measured}}
    for method in PAPER_SECONDS:
        for name in (name for name in shown if name != "node updates"):
            looks, label = METHOD_LOOKS[method] | LOOKS[name], f"{METHOD_NAMES[method]}, {name}"
            times.plot(*zip(*shown[name][method].items(), strict=True), label=label, gid=f"{name}-{method}", **looks)
    for name, (full, projected) in ((name, shown[name].values()) for name in shown):
        quotients = [full[n] / projected[n] for n in full]
        looks = {"color": INK, "marker": "o", "linestyle": "-"} | LOOKS[name]
        ratio.plot(list(full), quotients, label=name, gid=f"{name}-ratio", **looks)
    times.set(yscale="log", ylabel="computation time (s)")
    ratio.set(ylabel="ratio", ylim=(0, None))
    for ax, said in (
        (times, f"sdhj: processor time of one thread; paper: {PAPER_MACHINE}"),
        (ratio, "full / projected: times" + ", and node updates of the paper's scheme" * ("node updates" in shown)),
    ):
        ax.legend(title=said, title_fontsize=7.0, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        ax.set_xlabel("nodes on each axis")
        ax.set_xticks(sorted({*PAPER_NODES, *measured["default"]["hji"]}))
        ax.minorticks_off()
        ax.grid(axis="y")


if __name__ == "__main__":
    command_of(__file__)()
