"""Sets and their level-set functions, live."""

import numpy as np
from matplotlib.figure import Figure

from course.draw.sets import OPERATIONS, area, canvas, combine, disk, draw_functions, draw_nodes, rectangle
from course.widgets import Explorer, Numbers, choice, slider


def explore_sets(nodes: int = 81) -> Explorer:
    """Union, intersection and difference of a disk and a rectangle, as min and max of their functions."""
    grid = canvas(nodes)
    b = rectangle(grid, (0.25, 0.0), (0.35, 0.55))

    def draw(figure: Figure, operation: str, x: float, radius: float) -> Numbers:
        a = disk(grid, (x, 0.0), radius)
        c = combine(a, b, operation)
        draw_functions(figure, grid, {"$a$, disk": a, "$b$, rectangle": b, f"{operation}": c})
        return {f"area of {name}": area(grid, values, 401) for name, values in (("A", a), ("B", b), ("the result", c))}

    controls = {
        "operation": choice("operation", OPERATIONS, "union"),
        "x": slider("disk's centre x (m)", -0.9, 0.9, 0.05, -0.25),
        "radius": slider("disk's radius (m)", 0.1, 0.8, 0.05, 0.45),
    }
    return Explorer(
        draw, controls, size=(8.2, 3.0), alt="A disk, a rectangle, and what the operation makes of them", motion="x"
    )


def explore_nodes() -> Explorer:
    """What a coarse grid keeps of a thin bar: linear interpolation between nodes, and nothing else."""
    fine = canvas(401)

    def draw(figure: Figure, nodes: int, thickness: float, shift: float) -> Numbers:
        coarse, half = canvas(nodes), (0.7, thickness / 2)
        values, exact = (rectangle(grid, (0.0, shift), half) for grid in (coarse, fine))
        draw_nodes(figure, coarse, values, fine, exact)
        return {
            "spacing (m)": coarse.spacing[0],
            "true area": 1.4 * thickness,
            "area held": area(coarse, values, 401),
            "nodes inside": int(np.count_nonzero(values <= 0)),
        }

    controls = {
        "nodes": slider("nodes on each axis", 5, 41, 2, 11),
        "thickness": slider("thickness (m)", 0.04, 0.6, 0.02, 0.3),
        "shift": slider("shift (m)", -0.2, 0.2, 0.01, 0.05),
    }
    return Explorer(
        draw, controls, size=(6.0, 3.6), alt="A bar, and what the nodes of a coarse grid hold of it", motion="shift"
    )
