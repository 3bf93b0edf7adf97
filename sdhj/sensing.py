"""Measurement error, delay and jitter as data, and sets shrunk by what they leave unknown: see `sdhj.prediction`."""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sdhj.checks import number, whole
from sdhj.grid import FloatArray
from sdhj.hopf_lax import maximum_over_boxes

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
    """As `sdhj.prediction.half_widths`, of a problem that is checked; zeros where nothing is uncertain."""
    if not problem.sensing:
        return np.zeros(problem.grid.ndim), np.zeros(problem.grid.ndim)
    return importlib.import_module("sdhj.prediction").half_widths(problem)


def shrunk(problem: "ReachAvoidProblem", values: FloatArray, axes: Sequence[int] | None = None) -> FloatArray:
    """Level-set function of the places around which the whole box E is in {values <= 0}, on the grid, or of `axes`.

    The same array where nothing is uncertain.
    """
    axes = range(problem.grid.ndim) if axes is None else axes
    box = problem.half_widths[0][list(axes)]
    if not box.any():
        return values
    grid = problem.grid.subgrid(axes)
    ((_, out),) = maximum_over_boxes(grid, values, -box[None], box[None], "linear")
    for axis, (low, high) in enumerate(zip(*grid.faces("unsafe"), strict=True)):
        nodes = grid.nodes(axis)
        beyond = grid.lift(box[axis] - np.minimum(nodes - low, high - nodes), (axis,))  # -inf where no end is unsafe
        out = np.maximum(out, beyond.astype(out.dtype))
    return out
