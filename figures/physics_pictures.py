"""Pictures that MuJoCo drew, side by side."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from sdhj.grid import FloatArray


def draw_strip(figure: Figure, pictures: Sequence[tuple[float, FloatArray]]) -> None:
    """One panel for each picture (time in s, image of shape (H, W, 3)), from left to right."""
    panels = figure.subplots(1, len(pictures), squeeze=False)[0]
    for panel, (t, image) in zip(panels, pictures, strict=True):
        panel.imshow(image, interpolation="lanczos")
        panel.set_title(f"$t = {t:.2f}$ s", fontsize=8)
        panel.set_axis_off()
