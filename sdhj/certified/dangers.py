"""The unsafe sets and unsafe ends of a problem, by the axes that it takes to tell which inputs are clear of them.

How far a tube reaches along the axes of an unsafe set depends on these, and on all that velocities along them read.
Where ends are safe it depends on their axes, too. Cells that differ on other
axes only are alike, so bits are kept for cells of these axes alone; once, if nothing moves, else for each step.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sdhj.certified.cells import CellAxis
from sdhj.formulas.formula import Formula
from sdhj.problem.problem import ReachAvoidProblem


class Dangers(NamedTuple):
    """The unsafe sets and unsafe ends that are asked about for cells of the same axes."""

    axes: tuple[int, ...]  # ascending
    sets: tuple[int, ...]  # numbers of unsafe sets
    ends: tuple[int, ...]  # axes whose unsafe ends these are
    moving: bool  # whether anything depends on the time, so that there are bits for each step

    @property
    def entry_in_head(self) -> dict[str, Any]:
        """What a file says of it."""
        return {"axes": [*self.axes], "sets": [*self.sets], "ends": [*self.ends]}

    def shape(self, problem: ReachAvoidProblem, axes: Sequence[CellAxis]) -> tuple[int, int, int]:
        """For how many steps, cells of its axes, and bytes of a cell there are bits: (starts, cells, bytes)."""
        starts = problem.most_steps if self.moving else 1
        return starts, math.prod(axes[k].count for k in self.axes), -(-len(problem.inputs) // 8)


def dangers_of(problem: ReachAvoidProblem) -> tuple[Dangers, ...]:
    """All dangers of a problem, those of different axes apart, as the checker asks for them."""
    return problem.remembered("dangers of cells", lambda: _dangers_of(problem))


def _dangers_of(problem: ReachAvoidProblem) -> tuple[Dangers, ...]:
    grid, dynamics, found = problem.grid, problem.dynamics, dict[tuple[int, ...], list[list[int]]]()
    # of black boxes all is read, whatever they state, as `BlackBox.reads` of the checker says; with fewer axes than it
    # asks for a file is refused (`Argument.read_clear`)
    reads = np.array(dynamics.reads) | (not dynamics.formulas)
    if isinstance(dynamics.gain, Formula):  # the checker counts what is read for a push of 0, too
        reads |= dynamics.gain.reads.reshape(len(problem.inputs), grid.ndim, -1, grid.ndim).any(axis=(0, 2))
    frees, fails = (np.flatnonzero(grid.ends_where(fate).any(axis=0)).tolist() for fate in ("frees", "fails"))

    def among(axes: Sequence[int]) -> list[list[int]]:
        # the lists (sets, ends) in `found`, to be added to, of these axes, those of safe ends, and all they depend on
        own = {*axes, *frees}
        while more := {int(k) for i in own for k in np.flatnonzero(reads[i])} - own:
            own |= more
        return found.setdefault(tuple(sorted(own)), [[], []])

    for number, part in enumerate(problem.unsafe):
        among(part.axes)[0].append(number)
    for axis in fails:
        among([axis])[1].append(axis)
    timed = dynamics.depends_on_time
    return tuple(
        Dangers(axes, tuple(sets), tuple(ends), timed or any(problem.unsafe[number].moving for number in sets))
        for axes, (sets, ends) in found.items()
    )


def kept_together(dangers: Sequence[Dangers]) -> tuple[Dangers, ...]:
    """Those of fewer axes together with those of more, where that takes no more memory.

    Files have them in this order, and are refused with another.
    """
    out = list[Dangers]()
    # those of more axes first, so that they are there to be joined
    for one in sorted(dangers, key=lambda one: (-len(one.axes), not one.moving)):
        for at, more in enumerate(out):
            if {*one.axes} <= {*more.axes} and more.moving >= one.moving:
                sets, ends = tuple(sorted(more.sets + one.sets)), tuple(sorted(more.ends + one.ends))
                out[at] = more._replace(sets=sets, ends=ends)
                break
        else:
            out.append(one)
    return tuple(out)
