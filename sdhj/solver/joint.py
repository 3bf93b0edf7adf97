"""The reach-avoid game of Prop. 1 in one PDE for each input, in place of the three games of App. A.3.

The two agree up to the scheme's error; this one is there to be compared with.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.boxes import Maxima
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.solver.games import HJIGames, ObstacleFunction, Pieces, in_eights
from sdhj.solver.recursion import GridSets, InputRows
from sdhj.solver.schemes import FiniteDifferences, evolve_with_early_end
from sdhj.table.table import AvoidTubes


class JointGames(HJIGames):
    """Games whose reach sets avoid all unsafe sets already, but not the unsafe ends of axes."""

    @property
    def shifted(self) -> bool:
        """As `HJIGames.shifted`, but never with unsafe sets, which would move in that frame."""
        return super().shifted and not self.samples.unsafe

    def grouped_reach_sets(
        self, values: FloatArray, step: int, some: Sequence[int] | None = None
    ) -> Iterator[Maxima | Pieces]:
        """Yield level-set functions of the reach-avoid sets (Definition 4), each of a PDE that has -g as obstacle."""
        samples, grid = self.samples, self.grid
        if not samples.unsafe:
            yield from super().grouped_reach_sets(values, step, some)
            return
        steps = self.steps(self.axes, step)
        obstacles = [ObstacleFunction.of(samples, unsafe_set, unsafe_set.axes) for unsafe_set in samples.unsafe]
        unsafe = [self.obstacle_at(obstacle, step, steps) for obstacle in obstacles]

        @cache
        def union(which: tuple[int, ...], tau: float) -> FloatArray:
            highest = np.full((1,) * grid.ndim, -np.inf)
            for one, obstacle in ((unsafe[place], obstacles[place]) for place in which):
                highest = np.maximum(highest, grid.lift(one(tau) if callable(one) else one, obstacle.axes))
            return np.ascontiguousarray(np.broadcast_to(highest, grid.shape), dtype=self.dtype)

        def solved() -> Iterator[tuple[int, FloatArray]]:
            for j in range(self.count) if some is None else some:
                self.solved += 1
                velocities = self.velocities(j, self.axes, step)
                which = tuple(place for place, one in enumerate(samples.unsafe) if one.counts(j))
                instant = samples.problem.view_time == "instantaneous"
                # of the sets that are unsafe under this input
                met: Any = None if not which else partial(union, which) if instant else union(which, 0.0)
                given = grid, values, velocities, self.duration, self.scheme, self.early
                yield j, evolve_with_early_end(*given, obstacle=met, steps=steps)[grid.inner]

        yield from in_eights(solved())


class JointSets(GridSets):
    """`GridSets` whose reach sets avoid everything already, but the unsafe ends of axes."""

    storable = False

    def begin(self) -> None:
        """As `GridSets.begin`; reach sets are intersected with no avoid tubes, unless the grid has unsafe ends."""
        # also solves all avoid tubes: look-ups in the table ask them, though without unsafe ends no reach set is
        # intersected with them
        super().begin()
        if not self.problem.grid.has("fails"):
            nothing = np.full(len(self.avoid.static), -np.inf, self.avoid.static.dtype)
            none = AvoidTubes((), nothing, (), np.tile(nothing, (len(self.avoid.moving), 1)))
            self.rows = InputRows(self.problem.grid, none)


@dataclass(frozen=True)
class Joint(FiniteDifferences):
    """Method "joint": the reach-avoid game of Prop. 1 in one PDE for each input.

    With unsafe sets the PDE is solved as by `Scheme(frame="fixed")`. It is more diffusive than `sdhj.HJI`, and may
    promise what lies in a gap between pieces of a tube (`sdhj.solver.findings`).

    Parameters
    ----------
    scheme : Scheme
        How the equations are discretised.

    Examples
    --------
    The share of the states from which the target is reached within 3 steps, by the games apart and by the joint one:

    >>> import sdhj
    >>> from sdhj.solver.joint import Joint
    >>> problem = sdhj.arm_case_study(nodes=13, steps=3)
    >>> [round(sdhj.solve(problem, method).fraction(start=0, within=3), 2) for method in (sdhj.HJI(), Joint())]
    [0.18, 0.16]
    """

    name: ClassVar[str] = "joint"

    def on(self, samples: Samples) -> JointGames:
        """The games of the intervals of a problem."""
        return JointGames(samples, self.scheme)

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> JointSets:
        """As `HJI.sets`."""
        return JointSets(problem, self)
