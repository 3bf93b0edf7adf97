"""Fig. 13: full and projected tubes laid over each other."""

from collections.abc import Sequence

from common import Context, command_of
from matplotlib.figure import Figure

from sdhj import plotting
from sdhj.table import Table

PURSUERS = ((0.24, 0.24), (-0.15, 0.21), (-0.27, -0.09), (0.12, -0.21), (0.30, 0.03), (0.03, 0.33))


def draw(context: Context) -> Figure:
    full, inner = context.table("hji"), context.table("projected")
    figure = plotting.new_figure(7.0, 5.3)
    panels = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    for place, (ax, (px, py)) in enumerate(zip(panels, PURSUERS, strict=True)):
        through = (0.0, 0.0, px, py)
        plotting.draw_comparison(ax, full, inner, through=through)
        ax.set_title(f"({px:.2f}, {py:.2f}) m: {kept_share(full, inner, through):.0%} kept", fontsize=8)
        ax.set(xlabel=ax.get_xlabel() if place >= 3 else "", ylabel=ax.get_ylabel() if place % 3 == 0 else "")
    figure.legend(handles=plotting.comparison_legend(), loc="outside upper center", ncols=4, handleheight=1.1)
    return figure


def kept_share(full: Table, inner: Table, through: Sequence[float]) -> float:
    """Share of a slice of the full tube that the inner tube keeps; NaN where the full one is empty there."""
    where = plotting.plane(full.grid, through)
    inside = [where.of(table.grid, table.values(start=0, within=full.steps)) <= 0 for table in (full, inner)]
    return float(inside[1].sum() / inside[0].sum()) if inside[0].any() else float("nan")


if __name__ == "__main__":
    command_of(__file__)()
