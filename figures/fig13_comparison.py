"""Fig. 13: Projected tubes lie inside the full ones, of which they keep the share that stands above each slice."""

from collections.abc import Sequence

from common import Context, command_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from sdhj import plotting
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, PURSUER_LOOKS, UNSAFE_LOOKS, look
from sdhj.table.batches import Table

PURSUERS = ((0.24, 0.24), (-0.15, 0.21), (-0.27, -0.09), (0.12, -0.21), (0.30, 0.03), (0.03, 0.33))


def value(context: Context) -> list[float]:
    """The shares of the slices that are kept."""
    return [kept_share(context.table("hji"), context.table("projected"), (0.0, 0.0, *place)) for place in PURSUERS]


def draw(context: Context) -> Figure:
    full, inner = context.table("hji"), context.table("projected")
    figure = plotting.new_figure(7.0, 5.3)
    panels = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    for place, (ax, (px, py)) in enumerate(zip(panels, PURSUERS, strict=True)):
        through = (0.0, 0.0, px, py)
        draw_comparison(ax, full, inner, through=through)
        ax.set_title(f"({px:.2f}, {py:.2f}) m: {kept_share(full, inner, through):.0%} kept", fontsize=8)
        ax.set(xlabel=ax.get_xlabel() if place >= 3 else "", ylabel=ax.get_ylabel() if place % 3 == 0 else "")
    figure.legend(handles=comparison_legend(), loc="outside upper center", ncols=4, handleheight=1.1)
    return figure


def draw_comparison(ax: Axes, full: Table, inner: Table, through: Sequence[float]) -> None:
    """The largest tubes of two tables laid over each other: `full` light and solid, `inner` dark and dashed."""
    where = plotting.plane(full.grid, through)
    for table, looks, gid, height in ((full, FULL_LOOKS, "full", 1.0), (inner, INNER_LOOKS, "inner", 2.0)):
        values = where.of(table.grid, table.values(start=0, within=table.steps))
        plotting.draw_set(ax, where, values, looks, gid, height)
    for part in full.problem.unsafe:
        values = where.shaped(part.level_set(where.points[:, part.axes], 0.0))
        plotting.draw_set(ax, where, values, look(part.name) | {"facecolor": "none"}, part.name, zorder=3.0)
    plotting.frame_slice(ax, full.grid)


def comparison_legend() -> list[Patch]:
    """Legend entries of `draw_comparison`."""
    return [
        Patch(**FULL_LOOKS, label="full"),
        Patch(**INNER_LOOKS, label="projected"),
        Patch(**(UNSAFE_LOOKS | {"facecolor": "none"}), label="known obstacles"),
        Patch(**PURSUER_LOOKS, label="capture by the pursuer"),
    ]


def kept_share(full: Table, inner: Table, through: Sequence[float]) -> float:
    """Share of a slice of the full tube that the inner tube keeps; NaN where the full one is empty there."""
    where = plotting.plane(full.grid, through)
    inside = [where.of(table.grid, table.values(start=0, within=full.steps)) <= 0 for table in (full, inner)]
    return float(inside[1].sum() / inside[0].sum()) if inside[0].any() else float("nan")


if __name__ == "__main__":
    command_of(__file__)()
