"""What the library has read of a robot's functions, as a reader of a chapter sees it."""

import re
import textwrap
from collections.abc import Callable

from sdhj.formulas.text import shown
from sdhj.problem.problem import ReachAvoidProblem


def mathematics(problem: ReachAvoidProblem, j: int = 0) -> list[str]:
    """The drift under input u_j and the level sets of a problem, whose functions were all read: a line for each."""
    names, ndim = problem.grid.names, problem.grid.ndim
    drift = shown(problem.dynamics.drift.outputs[j * ndim : (j + 1) * ndim], names)
    lines = [*drift[:-ndim], *(f"d{name}/dt = {one}" for name, one in zip(names, drift[-ndim:], strict=True))]
    for part in (problem.target, *problem.unsafe):
        *letters, value = shown(part.level_set.outputs, [names[axis] for axis in part.axes])
        lines += [*letters, f"{part.name}: {value} <= 0"]
    return lines


def reply(function: Callable[..., object], *given: object, **options: object) -> str:
    """What a function returns, as text; where the library refuses, what it says, without the name of a cell's file."""
    try:
        return str(function(*given, **options))
    except ValueError as error:
        said = re.sub(r"file \S+?, line", "line", str(error))
        return textwrap.fill(said, 84, subsequent_indent="  ", break_long_words=False)
