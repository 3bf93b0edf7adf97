"""Interpolants and certificates on a line, live."""

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from course.draw.lines import ENDS, Claims, draw_interpolant, draw_line
from course.widgets import Explorer, Numbers, choice, slider

KINDS = {
    "one target": lambda x, shift: (x - shift) ** 2 - 0.1,
    "union of two": lambda x, shift: np.minimum(np.abs(x + 0.4 - shift), np.abs(x - 0.4 - shift)) - 0.3,
    "a thin post": lambda x, shift: 0.06 - np.abs(x - shift),
}


def explore_interpolation() -> Explorer:
    """A function on a line and its interpolant: what is falsely inside, and what is lost."""

    def draw(figure: Figure, kind: str, cells: int, shift: float) -> Numbers:
        nodes, x = np.linspace(-1, 1, cells + 1), np.linspace(-1, 1, 4001)
        exact = KINDS[kind](x, shift)
        chord = np.interp(x, nodes, KINDS[kind](nodes, shift))
        draw_interpolant(ax := figure.subplots(), (nodes, x, exact, chord))
        ax.legend(loc="upper right", ncols=5)
        return {
            "largest error": float(np.abs(chord - exact).max()),
            "falsely inside": float(np.mean((chord <= 0) & (exact > 1e-12))),
            "lost": float(np.mean((chord > 0) & (exact <= 0))),
        }

    controls = {
        "kind": choice("function", list(KINDS), "union of two"),
        "cells": slider("cells", 4, 40, 1, 10),
        "shift": slider("shift", -0.3, 0.3, 0.01, 0.05),
    }
    return Explorer(draw, controls, size=(6.6, 3.2), alt="A function on a line and its interpolant", motion="shift")


def explore_line(certify: Callable[..., Claims], post: Callable[[Any], Any]) -> Explorer:
    """The certificate on a line for any number of cells and any wind, by the function that the chapter wrote."""

    def draw(figure: Figure, cells: int, wind: int) -> Numbers:
        certificate = certify(cells, Fraction(wind, 100))
        draw_line(figure.subplots(), cells, certificate, post)
        return {
            "certified from step 0": sum(k == 0 for k, _ in certificate) / cells,
            "claims": len(certificate),
            "a wind's way, in cells": 0.25 * wind / 100 * cells / (2 * ENDS),
        }

    controls = {
        "cells": slider("cells", 20, 240, 1, 60),
        "wind": slider("wind, at most (1/100)", 0, 80, 5, 20),
    }
    return Explorer(
        draw,
        controls,
        size=(6.4, 3.2),
        alt="Certified cells of a line at steps 0 to 4",
        motion="cells",
        named=(61, 120, 121),
    )
