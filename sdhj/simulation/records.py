"""Bounds from records: how large the disturbance and the measurement error were in what a robot has recorded.

A record is a log of times, measured states y and the inputs u that acted. The push of a sample is the constant v with
which the model leads from a measured state to the next one,

    y_{i+1} = flow(y_i, u_i, v_i; t_{i+1} - t_i),

by least squares where the state has more axes than v has components. Of a disturbance that changes within a sample it
shows the mean. An error of at most e in both states changes a component of v_i by at most

    s_i = |B^+| (e + w(dt)) / dt,    w(0) = e,    dw/dt = A w,

where A holds the Lipschitz constants of the velocity (`sdhj.problem.steepness`). One log cannot tell the two apart:
white noise of size e looks like a push of 2 e / dt.

Two statements with a confidence 1 - alpha, of n records that were drawn alike and independently of one another:

* *The next record.* With the largest of m quantities in n records, another record exceeds any of them with a
  probability of at most the eps of sum_{i < m} C(n, i) eps^i (1 - eps)^(n - i) = alpha, whatever the distribution
  (Campi & Garatti 2008); this is about 3 / n for m = 1 at 95 %.
* *The bound.* Where the peaks x_1 >= x_2 >= ... have a density that does not vanish at their bound, what is beyond x_1
  is to what is between it and x_k as one spacing of uniform numbers to the k - 1 next, so that the bound is at most

      x_1 + (x_1 - x_k) (alpha^(-1 / (k - 1)) - 1),    k = 5:

  exact for a uniform density, else as n grows (Robson & Whitlock 1964 for k = 2). Noise adds to the push, so what is
  above the bound of both is above that of the push.

Nothing that was recorded bounds what comes next under other inputs.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from sdhj.common.checks import finite_array, number, whole
from sdhj.common.remembering import FloatArray
from sdhj.problem.interval import Interval
from sdhj.problem.problem import ReachAvoidProblem
from sdhj.problem.sensing import Sensing
from sdhj.problem.steepness import growth_bound, lipschitz_bounds

CORRECTIONS = 4  # of finding the push that explains a sample: each leaves an error that is dt times smaller
SAME_INPUT = 1e-6  # an input of the problem and one of a record, relative to the largest
LARGEST = 5  # peaks from which a bound is found
BISECTIONS = 60
STRIDES = 4  # Runge-Kutta steps of order 4 in a sample
INTEGRATED = 1e-6  # of an axis: how exact they are taken to be
SAME_SPAN = 1e-9  # s: samples whose durations differ by less are integrated together


@dataclass(frozen=True)
class RecordedBounds:
    """The result of `bounds_from_records`; `str()` is a summary.

    Attributes
    ----------
    bounds : (D,) array
        For `Dynamics(bounds=...)`, with the stated confidence.
    least : (D,) array
        What no measurement error explains.
    peaks : (n, D) array
        The largest push of each record.
    error : (ndim,) array
        For `Sensing(error=...)`: as given, or found.
    unexplained : (ndim,) array
        How far a state was from where any push and error can bring it: if not 0, the model lacks something, or the
        error is larger.
    exceeding : float
        The most that the probability can be of a further record in which a push is larger than all of `peaks`.
    confidence : float
    names : tuple of str
        Of the axes.
    """

    bounds: FloatArray
    least: FloatArray
    peaks: FloatArray
    error: FloatArray
    unexplained: FloatArray
    exceeding: float
    confidence: float
    names: tuple[str, ...]

    def __str__(self) -> str:
        lines = [f"{len(self.peaks)} records, confidence {self.confidence:.0%}"]
        for d, (low, seen, high) in enumerate(zip(self.least, self.peaks.max(axis=0), self.bounds, strict=True)):
            lines.append(f"v[{d}]: at least {low:.4g}, largest recorded {seen:.4g}, bound {high:.4g}")
        lines.append("measurement error: " + ", ".join(f"{e:.4g}" for e in self.error))
        lines.append(
            f"a further record exceeds the largest recorded with a probability of at most {self.exceeding:.2%}"
        )
        lines += [
            f"no push explains {much:.4g} of the motion along {name}: the model lacks something, or the error is larger"
            for name, much in zip(self.names, self.unexplained, strict=True)
            if much > 0
        ]
        return "\n".join(lines)


def bounds_from_records(
    problem: ReachAvoidProblem,
    records: Sequence[Any],
    *,
    error: Any = None,
    rest: Any = None,
    better: Sequence[Any] | None = None,
    confidence: float = 0.95,
) -> RecordedBounds:
    """Bounds of disturbance and measurement error from records of a robot: see `sdhj.simulation.records`.

    Parameters
    ----------
    problem : ReachAvoidProblem
        The model; its bounds and its sensing play no part.
    records : sequence of (T, 1 + ndim + m) array, or of paths to CSV files
        Time (s), measured state, and the input that acted until the next row. A file has a line with names first. At
        least two, drawn independently and alike.
    error : float, or one for each axis
        Of measurement, if it is known.
    rest : (T, 1 + ndim, ...) array, or a path
        In place of `error`: a record of the robot at rest; half of what a coordinate ranges over is its error.
    better : sequence as `records`
        In place of `error`: a better sensor's records, at the same times, whose distance is the error and whose pushes
        count.
    confidence : float
        With which all bounds hold together, above 0 and below 1.

    Raises
    ------
    ValueError
        If not just one of error, rest and better is given, v does not enter the velocity linearly, a recorded input is
        none of the problem's, or nothing tells a component of v from the others.
    OSError
        If a file cannot be read.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, ten times at 1 m/s for a second, in a wind that is new in each tenth:

    >>> rng = np.random.default_rng(0)
    >>> t, wind = np.arange(11) / 10, rng.uniform(-0.2, 0.2, (10, 10))
    >>> ways = np.hstack([np.zeros((10, 1)), np.cumsum(0.1 * (1.0 + wind), axis=1)])
    >>> records = [np.column_stack([t, way, np.ones(11)]) for way in ways]
    >>> found = sdhj.bounds_from_records(problem, records, error=0.0)
    >>> bool(found.least[0] <= 0.2 <= found.bounds[0])
    True
    """
    confidence = number("confidence", confidence, above=0.0, most=1 - 1e-9)
    if sum(given is not None for given in (error, rest, better)) != 1:
        raise ValueError(
            "give one of error, rest and better: a log alone does not tell a disturbance from an error of measurement"
        )
    if problem.dynamics.gain is None:
        raise ValueError("v must enter the velocity linearly: give drift and gain")
    ndim, D = problem.grid.ndim, problem.dynamics.disturbance_dim
    tables = [_record(f"records[{i}]", one, 1 + ndim + problem.inputs.shape[1]) for i, one in enumerate(records)]
    if len(tables) < 2:
        raise ValueError(f"two records or more are needed, got {len(tables)}")
    miss = (1 - confidence) / (D + (0 if error is not None else ndim))  # for each bound that is found
    seen, known = _measured(problem, tables, miss, error, rest, better)
    # of `seen`, which may be records of a better sensor, the states alone count: inputs are those of `tables`
    joined = [np.hstack([a[:, : 1 + ndim], b[:, 1 + ndim :]]) for a, b in zip(seen, tables, strict=True)]
    # What a better sensor has seen has no error.
    pushes, blur, beyond = _pushes(problem, joined, np.zeros(ndim) if better is not None else known)
    peaks, least = _peaks(pushes, [len(one) - 1 for one in tables]), np.maximum((pushes - blur).max(axis=0), 0.0)
    bounds, exceeding = _upper_bounds(peaks, miss), chance(len(tables), D, confidence)
    names = tuple(problem.grid.names)
    return RecordedBounds(bounds, least, peaks, known, beyond.max(axis=0), exceeding, confidence, names)


def _peaks(pushes: FloatArray, counts: list[int]) -> FloatArray:
    """The largest push of each record, (n, D), at least 0, of pushes (rows, D) that are -inf where none is told."""
    # the samples of all records lie one behind the other, in the order of `counts`
    peaks = np.maximum.reduceat(pushes, np.cumsum([0, *counts[:-1]]), axis=0)
    if (untold := peaks.max(axis=0) < 0).any():
        raise ValueError(
            f"nothing in the records tells v[{int(untold.argmax())}] from the other components of v; record inputs "
            "under which it moves the state otherwise than they do"
        )
    return np.maximum(peaks, 0.0)


def chance(count: int, quantities: int = 1, confidence: float = 0.95) -> float:
    """The most that the probability can be, with a confidence, that another record exceeds all of `count`.

    The eps of sum_{i < m} C(n, i) eps^i (1 - eps)^(n - i) = 1 - confidence, n = count, m = quantities.
    """
    count, quantities = whole("count", count, least=1), whole("quantities", quantities, least=1)
    low, high = 0.0, 1.0
    # of no more records than quantities nothing can be said: 1
    for _ in range(BISECTIONS if count > quantities else 0):
        eps = (low + high) / 2
        tail = sum(comb(count, i) * eps**i * (1 - eps) ** (count - i) for i in range(quantities))
        low, high = (eps, high) if tail > 1 - confidence else (low, eps)
    return high


def _measured(
    problem: ReachAvoidProblem, tables: list[FloatArray], miss: float, error: Any, rest: Any, better: Any
) -> tuple[list[FloatArray], FloatArray]:
    """The records whose states are nearest the true ones, and the bound (ndim,) on the error of measurement."""
    ndim = problem.grid.ndim
    if better is not None:
        seen = [_record(f"better[{i}]", one, 1 + ndim, wider=True) for i, one in enumerate(better)]
        if [len(one) for one in seen] != [len(one) for one in tables]:
            raise ValueError("better must have a record for each of records, with as many rows")
        pairs = zip(tables, seen, strict=True)
        misses = [np.abs(_difference(problem, a[:, 1 : 1 + ndim], b[:, 1 : 1 + ndim])).max(axis=0) for a, b in pairs]
        return seen, _upper_bounds(np.array(misses), miss)
    if rest is not None:
        still = _record("rest", rest, 1 + ndim, wider=True)[:, 1 : 1 + ndim]
        off = _difference(problem, still, still[:1])
        # half of what each coordinate ranges over, as nobody knows where the robot stood
        return tables, (_upper_bounds(off, miss / 2) + _upper_bounds(-off, miss / 2)) / 2
    return tables, np.zeros(ndim) + np.array(Sensing(error).error)


def _upper_bounds(values: FloatArray, miss: float) -> FloatArray:
    """Upper bounds (m,) on m quantities, each exceeded with probability `miss`, from n >= 2 recorded values (n, m).

    x_1 + (x_1 - x_k) (miss^(-1 / (k - 1)) - 1), x_1 >= x_2 >= ... the largest, k = min(`LARGEST`, n).
    """
    ordered = np.sort(values, axis=0)
    k = min(LARGEST, len(values))
    return np.asarray(ordered[-1] + (ordered[-1] - ordered[-k]) * (miss ** (-1 / (k - 1)) - 1))


def _record(name: str, given: Any, columns: int, wider: bool = False) -> FloatArray:
    """A record as float64 (T, columns, or more if `wider`), from an array or a CSV file."""
    if isinstance(given, str | os.PathLike):
        # The first row of a CSV file has names.
        given, name = np.loadtxt(given, delimiter=",", skiprows=1, ndmin=2), str(given)
    table = finite_array(name, given)
    fits = table.ndim == 2 and (table.shape[1] == columns or (wider and table.shape[1] > columns))
    if not fits or len(table) < 2:
        what = "time, state" if wider else "time, state and input"
        raise ValueError(f"{name} must have two rows or more, and {columns} columns ({what}), got shape {table.shape}")
    if (np.diff(table[:, 0]) <= 0).any():
        raise ValueError(f"the times of {name} must increase from row to row")
    return table


def _difference(problem: ReachAvoidProblem, one: FloatArray, other: FloatArray) -> FloatArray:
    """one - other for states (M, ndim), on a periodic axis at most half a turn: (M, ndim)."""
    grid, off = problem.grid, one - other
    turn = np.where(grid.periodic, np.array(grid.upper) - grid.lower, np.inf)
    return off - np.where(grid.periodic, turn, 0.0) * np.round(off / turn)


def _pushes(
    problem: ReachAvoidProblem, tables: list[FloatArray], error: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of all samples |v| (T, D), how much errors may have changed it (T, D), and what no push explains (T, ndim).

    By Newton's method with the pseudoinverse B^+ of the gain; errors may change it by |B^+| (e + w(dt)) / dt.
    """
    ndim, D = problem.grid.ndim, problem.dynamics.disturbance_dim
    before, after = (np.concatenate([one[part] for one in tables]) for part in (slice(-1), slice(1, None)))
    times, states, spans = before[:, 0], before[:, 1 : 1 + ndim], after[:, :1] - before[:, :1]
    inputs, count = _indices(problem, before[:, 1 + ndim :]), len(before)
    v, left, gain = np.zeros((count, D)), np.empty((count, ndim)), np.empty((count, ndim, D))
    timed = problem.dynamics.depends_on_time  # then each sample has a time of its own
    for rows in np.arange(count)[:, None] if timed else [np.arange(count)]:
        t = float(times[rows[0]]) if timed else 0.0
        interval = problem.interval(min(max(round(t / problem.delta), 0), problem.steps - 1) if timed else 0)
        gain[rows] = interval.gain(states[rows], inputs[rows], t)
        inverse = np.linalg.pinv(gain[rows])
        for _ in range(CORRECTIONS):
            ends = _flow(interval, states[rows], inputs[rows], v[rows], t, spans[rows])
            left[rows] = _difference(problem, after[rows, 1 : 1 + ndim], ends)
            v[rows] += np.einsum("mdi,mi->md", inverse, left[rows]) / spans[rows]
    inverse, longest = np.linalg.pinv(gain), float(spans.max())  # w is that of the longest dt
    slope, _, jumps = lipschitz_bounds(problem.grid, problem.dynamics, float(times.max()), longest)
    blur = error + growth_bound(slope, jumps, error, longest)
    told = np.abs(inverse @ gain - np.eye(D)).max(axis=2) < SAME_INPUT
    beyond = np.abs(left) - np.abs(np.eye(ndim) - gain @ inverse) @ blur
    small = INTEGRATED * (np.array(problem.grid.upper) - problem.grid.lower)
    # -inf where the gain does not tell a component from the others
    return np.where(told, np.abs(v), -np.inf), np.abs(inverse) @ blur / spans, np.where(beyond > small, beyond, 0.0)


def _indices(problem: ReachAvoidProblem, given: FloatArray) -> FloatArray:
    """The index (T,) of the problem's input that each recorded input (T, m) is."""
    distances = np.abs(given[:, None] - problem.inputs).max(axis=2)
    if (odd := distances.min(axis=1) > SAME_INPUT * max(1.0, np.abs(problem.inputs).max())).any():
        raise ValueError(
            f"the records have the input {given[odd][0].tolist()}, which is none of the problem's; make the "
            "problem with the inputs that were recorded"
        )
    return distances.argmin(axis=1)


def _flow(
    interval: Interval, states: FloatArray, inputs: FloatArray, v: FloatArray, t: float, spans: FloatArray
) -> FloatArray:
    """Where the model leads from states at time t, s, after durations (M, 1), s: (M, ndim)."""
    ends = states.copy()
    # Each span of its own costs `STRIDES` steps, so that spans that hardly differ count as one.
    rounded = np.round(spans[:, 0] / SAME_SPAN) * SAME_SPAN
    for span in np.unique(rounded):
        rows, h = rounded == span, float(span) / STRIDES
        for stride in range(STRIDES):
            ends[rows] = interval.advance(ends[rows], inputs[rows], v[rows], t + stride * h, h)
    return ends
