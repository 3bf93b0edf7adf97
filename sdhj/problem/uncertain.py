"""What the sets of a problem become where the state is known to within a box E: see `sdhj.problem.sensing`."""

from collections.abc import Sequence

import numpy as np

from sdhj.common.remembering import FloatArray
from sdhj.problem.boxes import maximum_over_boxes
from sdhj.problem.problem import ReachAvoidProblem


def eroded_by_error(problem: ReachAvoidProblem, values: FloatArray, axes: Sequence[int] | None = None) -> FloatArray:
    """The maximum over x +- E, and over how far that reaches past unsafe ends: the set shrunk by E."""
    axes = range(problem.grid.ndim) if axes is None else axes
    grid, box = problem.grid.subgrid(axes), problem.half_widths[0][list(axes)]
    if not box.any():
        return values
    ((_, out),) = maximum_over_boxes(grid, values, -box[None], box[None], "linear")
    for axis, (low, high) in enumerate(zip(*grid.faces("fails"), strict=True)):
        nodes = grid.nodes(axis)
        beyond = grid.lift(box[axis] - np.minimum(nodes - low, high - nodes), (axis,))  # -inf where no end is unsafe
        out = np.maximum(out, beyond.astype(out.dtype))
    return out


def must_lead_into(problem: ReachAvoidProblem, values: FloatArray) -> FloatArray:
    """Level-set function of where an interval must lead for the controller's point to be in a set."""
    # with memory that point is carried on, and this stands for E; else it is a prediction, within E of the state
    grown = problem.half_widths[1]
    if not problem.sensing.remembers:
        return eroded_by_error(problem, values)
    if not grown.any():
        return values
    ((_, out),) = maximum_over_boxes(problem.grid, values, -grown[None], grown[None], "linear")
    return out


def largest_in_error_box(problem: ReachAvoidProblem, values: FloatArray, points: FloatArray) -> FloatArray:
    """The largest interpolated value over x +- E, clipped at walls: (M,)."""
    grid, columns = problem.grid, []
    if not problem.half_widths[0].any():
        return grid.interpolate(values, points)
    # on each axis the largest value is at an end of the box or at a node in between
    for axis, (width, lower, h) in enumerate(zip(problem.half_widths[0], grid.lower, grid.spacing, strict=True)):
        x = points[:, axis, None]
        nodes = lower + h * (np.ceil((x - width - lower) / h) + np.arange(int(2 * width / h) + 1))
        between = [x - width, np.minimum(nodes, x + width), x + width]
        columns.append(np.concatenate(between, axis=1) if width else x)
    places = np.indices([column.shape[1] for column in columns]).reshape(len(columns), -1)
    found = np.stack([column[:, place] for column, place in zip(columns, places, strict=True)], axis=-1)
    # the point itself, too, which may lie off the grid
    around = np.concatenate([points[:, None], grid.clipped(found)], axis=1)
    return grid.interpolate(values, around.reshape(-1, grid.ndim)).reshape(around.shape[:2]).max(axis=1)
