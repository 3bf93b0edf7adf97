"""What records say of a disturbance: the peaks of the records, in order, and the bounds that were found from them."""

import numpy as np
from matplotlib.axes import Axes

from sdhj.plotting.looks import FAINT, INK, OUTCOME_INK
from sdhj.simulation.records import RecordedBounds


def draw_records(ax: Axes, found: RecordedBounds, component: int = 0) -> None:
    """The share of the records in which a component of v was never larger than x, and its bounds.

    Parameters
    ----------
    ax : Axes
    found : RecordedBounds
        Of `sdhj.bounds_from_records`.
    component : int
        Of v, from 0 on.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, and two records in which it is faster than its input of 1 m/s:

    >>> from sdhj import plotting
    >>> t = np.arange(11) / 10
    >>> records = [np.column_stack([t, speed * t, np.ones(11)]) for speed in (1.1, 1.2)]
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> plotting.draw_records(ax, sdhj.bounds_from_records(problem, records, error=0.0))
    """
    peaks = np.sort(found.peaks[:, component])
    # A step up at each peak, to the share of the peaks that are no larger.
    ax.step(peaks, np.arange(1, len(peaks) + 1) / len(peaks), where="post", color=INK, gid="peaks", label="records")
    least, bound = found.least[component], found.bounds[component]
    ax.axvline(least, color=FAINT, linestyle=":", gid="least", label="no error explains it")
    ax.axvline(bound, color=OUTCOME_INK, linestyle="--", gid="bound", label=f"bound, {found.confidence:.0%}")
    ax.set(
        xlabel=f"largest |v[{component}]| of a record", ylabel="share of the records", ylim=(0, 1.05), xlim=(0, None)
    )
    ax.legend(loc="upper left", fontsize="small")
