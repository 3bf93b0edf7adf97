"""Schemes against exact answers, live."""

import numpy as np
from matplotlib.figure import Figure

from course.draw.schemes import DIFFERENCES, INTEGRATOR, carry, draw_profile, draw_shrunk, shrink, shrunk_legend
from course.widgets import Explorer, Numbers, choice, slider
from sdhj.solver.schemes import Scheme


def explore_upwinding() -> Explorer:
    """A profile carried along a line with left, central or right differences and a time step of your choice."""

    def draw(figure: Figure, difference: str, cfl: float, nodes: int, velocity: float, duration: float) -> Numbers:
        with np.errstate(over="ignore"):
            profile = carry(difference, cfl=cfl, nodes=nodes, velocity=velocity, duration=duration)
        draw_profile(figure.subplots(), profile)
        return {"time steps": profile.steps, "largest error (m)": profile.error}

    controls = {
        "difference": choice("difference", DIFFERENCES, "right"),
        "cfl": slider("step, CFL number", 0.1, 1.5, 0.05, 0.75),
        "nodes": slider("nodes", 20, 160, 10, 80),
        "velocity": slider("velocity (m/s)", -1.0, 1.0, 0.25, 1.0),
        "duration": slider("carried for (s)", 0.0, 0.8, 0.05, 0.4),
    }
    alt = "A hat-shaped profile, where it should be and where it is computed to be"
    return Explorer(draw, controls, size=(7.0, 3.2), alt=alt, motion="cfl", named=(1.0,), process="duration")


def explore_schemes() -> Explorer:
    """A disk carried back under an adversary: flux, order and grid against the exact answer."""

    def draw(figure: Figure, flux: str, order: int, nodes: int, adversary: float) -> Numbers:
        scheme = Scheme(flux=flux, order=order, integrator=INTEGRATOR[order], frame="fixed", dtype="float64")
        case = shrink(nodes, scheme, adversary=adversary)
        ax = figure.subplots()
        draw_shrunk(ax, case)
        ax.legend(handles=shrunk_legend(), loc="lower right")
        return {
            "time steps": case.steps,
            "mean error near the boundary (m)": case.mean_error,
            "nodes wrongly inside": case.wrongly_inside,
        }

    controls = {
        "flux": choice("flux", ("godunov", "lax-friedrichs"), "godunov"),
        "order": choice("order", (1, 2, 3), 1),
        "nodes": slider("nodes on each axis", 11, 81, 2, 31),
        "adversary": slider("adversary's speed (m/s)", 0.0, 1.0, 0.05, 0.3),
    }
    return Explorer(draw, controls, size=(5.2, 3.9), alt="The computed reach set and the exact one", motion="nodes")
