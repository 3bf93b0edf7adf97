"""Looking for what is drawn: artists by the identifiers they carry."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet

from sdhj import plotting


def axes(**options):
    """The axes of a new figure."""
    return plotting.new_figure(4, 4).subplots(**options)


def named(ax: Axes, gid: str) -> list:
    """All artists with that identifier."""
    return [artist for artist in ax.get_children() if artist.get_gid() == gid]


def vertices(ax: Axes, gid: str) -> np.ndarray:
    """All points of the one contour set with that identifier."""
    (artist,) = named(ax, gid)
    assert isinstance(artist, ContourSet)
    return np.concatenate([path.vertices for path in artist.get_paths()])
