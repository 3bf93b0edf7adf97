"""Measurement error, delay and jitter as data, and sets shrunk by what they leave unknown: see `sdhj.prediction`."""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.checks import number, whole
from sdhj.grid import FloatArray

if TYPE_CHECKING:
    from sdhj.problem import ReachAvoidProblem


@dataclass(frozen=True)
class Sensing:
    """How well a robot measures and how promptly it acts; by default exactly and at once.

    Parameters
    ----------
    error : float, or one for each axis
        e, the most by which a measurement is off, in the units of the state.
    delay : float
        d, from a measurement to the start of the input that is chosen from it, s.
    jitter : float
        j, how early or late a sampling time may come, s.
    rest : int
        Index of the input that is held before the first one starts.

    Raises
    ------
    ValueError
        For what is no number or negative; a problem also checks that it fits.
    """

    error: Any = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    rest: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.error, Sequence | np.ndarray) and not isinstance(self.error, str):
            errors = tuple(number(f"error[{axis}]", one, least=0.0) for axis, one in enumerate(self.error))
            object.__setattr__(self, "error", errors)
        else:
            object.__setattr__(self, "error", number("error", self.error, least=0.0))
        for name in ("delay", "jitter"):
            object.__setattr__(self, name, number(name, getattr(self, name), least=0.0))
        object.__setattr__(self, "rest", whole("rest", self.rest, least=0))

    def __bool__(self) -> bool:
        """Whether anything is not exact or not at once."""
        return bool(np.any(self.error) or self.delay or self.jitter)

    def held(self, delta: float) -> tuple[float, float]:
        """The longest time for which an input may be held, s, and how much sooner that may end."""
        return delta + 2 * self.jitter, 4 * self.jitter

    def check(self, problem: "ReachAvoidProblem") -> None:
        """Raise ValueError where a problem does not fit it."""
        if self:
            importlib.import_module("sdhj.prediction").check_sensing(problem)


def half_widths(problem: "ReachAvoidProblem") -> tuple[FloatArray, FloatArray]:
    """As `sdhj.prediction.boxes`; zeros where nothing is uncertain."""
    if not problem.sensing:
        return np.zeros(problem.grid.ndim), np.zeros(problem.grid.ndim)
    return importlib.import_module("sdhj.prediction").boxes(problem)


def shrunk(problem: "ReachAvoidProblem", values: FloatArray, axes: Sequence[int] | None = None) -> FloatArray:
    """As `sdhj.prediction.less_the_box`, on the grid or that of some axes; `values` where nothing is uncertain."""
    axes = range(problem.grid.ndim) if axes is None else axes
    if not problem.half_widths[0][list(axes)].any():
        return values
    return importlib.import_module("sdhj.prediction").less_the_box(problem, values, axes)


def worst_around(problem: "ReachAvoidProblem", values: FloatArray, points: FloatArray) -> FloatArray:
    """The largest of interpolated values (*grid.shape) over the box E around points (M, ndim): (M,)."""
    if not problem.half_widths[0].any():
        return problem.grid.interpolate(values, points)
    around = importlib.import_module("sdhj.prediction").spots_of_the_box(problem, points)
    found = problem.grid.interpolate(values, around.reshape(-1, problem.grid.ndim))
    return found.reshape(around.shape[:2]).max(axis=1)
