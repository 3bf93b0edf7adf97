"""Methods: how the sets of Theorem 2 are represented and computed, as objects that contain their options.

A method has a `name` and a function `sets(problem, progress)`, which returns the sets that
`sdhj.solver.recursion.recursion` fills in. Any object with these two can be passed to `solve`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from sdhj.common.checks import Options, option
from sdhj.problem.boxes import INTERPOLATIONS
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.samples import Samples
from sdhj.solver.games import HJIGames, HopfLaxGames
from sdhj.solver.recursion import GridSets, TubeSets
from sdhj.solver.schemes import DTYPES, FiniteDifferences


class Method(Protocol):
    """The interface of a method for `solve`: a name, and sets that `recursion` fills in."""

    @property
    def name(self) -> str:
        """The name by which tables and files call it."""

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> TubeSets:
        """The sets of a problem, which `recursion` fills in."""


@dataclass(frozen=True)
class HJI(FiniteDifferences):
    """Method "hji": finite differences for the Hamilton-Jacobi-Isaacs equations, on the whole grid.

    Parameters
    ----------
    scheme : Scheme
        How the equations are discretised.

    Examples
    --------
    The share of the states from which the target is reached within 3 steps, with differences of two orders:

    >>> import sdhj
    >>> problem = sdhj.arm_case_study(nodes=13, steps=3)
    >>> methods = sdhj.HJI(), sdhj.HJI(sdhj.Scheme(order=1, frame="fixed"))
    >>> [round(sdhj.solve(problem, method).fraction(start=0, within=3), 2) for method in methods]
    [0.18, 0.05]
    """

    name: ClassVar[str] = "hji"

    def on(self, samples: Samples, axes: Sequence[int] | None = None) -> HJIGames:
        """The games of the intervals of a problem, on some axes, by default all."""
        return HJIGames(samples, self.scheme, axes)

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> GridSets:
        """The tubes as level-set functions on the grid, filled in by `recursion`."""
        return GridSets(problem, self)


@dataclass(frozen=True)
class HopfLax(Options):
    """Method "lax": the Hopf-Lax formula, for velocities that do not depend on the state; exact up to interpolation.

    Where a component of the disturbance moves several axes, the maximum is taken over the true set, a zonotope.
    Interpolation then errs to either side: outwards in bowls of the level-set function, inwards at ridges. The box
    around the set, which is larger, is used where v does not enter linearly, where gain or bounds depend on time, and
    for components that move an axis with a wall, unless the set is symmetric about it and no input moves along it.

    Parameters
    ----------
    interpolation : {"limited", "linear"}
        Between nodes: to third order, or linearly (`sdhj.solver.hopf_lax`).
    dtype : {"float32", "float64"}

    Raises
    ------
    ValueError
        By `sdhj.solve` if velocities depend on the state, or the sensing has jitter.

    Examples
    --------
    Linear interpolation loses states on a coarse grid:

    >>> import sdhj
    >>> problem = sdhj.arm_case_study(nodes=13, steps=3)
    >>> methods = sdhj.HopfLax(), sdhj.HopfLax(interpolation="linear")
    >>> [round(sdhj.solve(problem, method).fraction(start=0, within=3), 2) for method in methods]
    [0.19, 0.14]
    """

    interpolation: str = "limited"
    dtype: str = "float32"
    name: ClassVar[str] = "lax"

    def __post_init__(self) -> None:
        option("interpolation", self.interpolation, INTERPOLATIONS)
        option("dtype", self.dtype, DTYPES)

    @property
    def options(self) -> dict[str, Any]:
        """As `FiniteDifferences.options`."""
        return {"interpolation": self.interpolation, "dtype": self.dtype}

    def on(self, samples: Samples, axes: Sequence[int] | None = None) -> HopfLaxGames:
        """As `HJI.on`, by the Hopf-Lax formula."""
        return HopfLaxGames(samples, self.interpolation, self.dtype, axes)

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> GridSets:
        """As `HJI.sets`; ValueError with jitter."""
        refuse_jitter(problem)
        return GridSets(problem, self)


def refuse_jitter(problem: ReachAvoidProblem) -> None:
    """Raise ValueError where intervals may end early, for which there is no formula."""
    if problem.sensing.jitter:
        raise ValueError(
            f'method="lax" has no formula for intervals that end early, and the sensing has jitter = '
            f'{problem.sensing.jitter:g} s; use method="hji" or "certified"'
        )
