"""What records say of a disturbance: the peaks of the records, in order, and the bounds that were found from them."""

import numpy as np
from matplotlib.axes import Axes

from sdhj.plotting.looks import FAINT, INK, OUTCOME_INK
from sdhj.simulation.records import RecordedBounds


def draw_records(ax: Axes, found: RecordedBounds, component: int = 0) -> None:
    """The share of the records in which a component of v was never larger, and its bounds.

    Parameters
    ----------
    ax : Axes
    found : RecordedBounds
        What `sdhj.bounds_from_records` returns.
    component : int
        Which component of v, from 0 on.

    Examples
    --------
    Ten records of a robot on a line, which is told to move at 1 m/s and pushed at random:

    >>> import numpy as np
    >>> import sdhj
    >>> from sdhj import plotting
    >>> problem = sdhj.ReachAvoidProblem(
    ...     grid=sdhj.Grid([-4.0], [4.0], [81]),
    ...     dynamics=sdhj.Dynamics([[-1.0], [1.0]], [[-1.0], [1.0]], [[1.0]], [0.0]),
    ...     target=sdhj.TargetSet((0,), lambda points, t: abs(points[:, 0]) - 1.0),
    ...     unsafe=[],
    ...     delta=0.1,
    ...     steps=5,
    ... )
    >>> t, wind = np.arange(11) / 10, np.random.default_rng(0).uniform(-0.2, 0.2, (10, 10))
    >>> ways = np.hstack([np.zeros((10, 1)), np.cumsum(0.1 * (1.0 + wind), axis=1)])
    >>> records = [np.column_stack([t, way, np.ones(11)]) for way in ways]
    >>> ax = plotting.new_figure(3, 3).subplots()
    >>> plotting.draw_records(ax, sdhj.bounds_from_records(problem, records, error=0.0))
    """
    peaks = np.sort(found.peaks[:, component])
    ax.step(peaks, np.arange(1, len(peaks) + 1) / len(peaks), where="post", color=INK, gid="peaks", label="records")
    least, bound = found.least[component], found.bounds[component]
    ax.axvline(least, color=FAINT, linestyle=":", gid="least", label="no error explains it")
    ax.axvline(bound, color=OUTCOME_INK, linestyle="--", gid="bound", label=f"bound, {found.confidence:.0%}")
    ax.set(
        xlabel=f"largest |v[{component}]| of a record", ylabel="share of the records", ylim=(0, 1.05), xlim=(0, None)
    )
    ax.legend(loc="upper left", fontsize="small")
