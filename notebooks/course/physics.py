"""The experiment with torques, of which a chapter shows the parts; its plant needs MuJoCo."""

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from matplotlib.figure import Figure

from course.widgets import show
from sdhj import plotting

STUDIES = Path(__file__).resolve().parents[2] / "figures" / "studies"


def experiment() -> ModuleType:
    """`figures/studies/experiment.py`; whether it can play in MuJoCo, `plays` says."""
    sys.path.insert(0, str(STUDIES))
    try:
        return importlib.import_module("experiment")
    finally:
        sys.path.remove(str(STUDIES))


def plays() -> bool:
    """Whether MuJoCo is installed; says what to do where it is not."""
    found = experiment().mujoco is not None
    if not found:
        print("MuJoCo is not installed, so nothing is played here: pip install 'sdhj[physics]'")
    return found


def film(played: Any, u_max: float, count: int = 5) -> None:
    """The longest of some runs as MuJoCo draws it; a line where it cannot."""
    module = experiment()
    world, run = module.World(module.arm(u_max)), module.longest(played.films)
    try:
        pictures = module.physics.frames(world, run, count, 240)
    except ValueError as error:
        print(error)
        return
    show(strip(pictures), alt="A run of the arm in MuJoCo, at five instants")


def strip(pictures: Sequence[tuple[float, Any]]) -> Figure:
    """Pictures of some instants, side by side."""
    with plotting.style():
        figure = plotting.new_figure(1.6 * len(pictures), 1.85)
        for panel, (t, image) in zip(figure.subplots(1, len(pictures)), pictures, strict=True):
            panel.imshow(image)
            panel.set_title(f"$t = {t:.2f}$ s", fontsize=8)
            panel.set_axis_off()
    return figure
