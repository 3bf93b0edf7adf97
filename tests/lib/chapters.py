"""What the cells of chapters define."""

import ast
from pathlib import Path
from typing import Any

import nbformat

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"


def functions(name: str, *wanted: str) -> dict[str, Any]:
    """What the cells of a chapter define that hold one of the wanted functions, and the imports before them."""
    cells = [cell.source for cell in nbformat.read(NOTEBOOKS / name, as_version=4).cells if cell.cell_type == "code"]
    found: dict[str, Any] = {}
    imports = [node for node in ast.parse(cells[0]).body if isinstance(node, ast.Import | ast.ImportFrom)]
    exec("\n".join(map(ast.unparse, imports)), found)
    for source in cells:
        if any(f"def {function}(" in source for function in wanted):
            exec(source.split("\npicture(")[0].split("\npaper_figure(")[0], found)
    return found
