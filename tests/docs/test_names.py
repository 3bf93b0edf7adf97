"""Names in backticks, in docstrings and on pages, are names of something that is there."""

import ast
import builtins
import importlib
import inspect
import json
import keyword
import pydoc
import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documents import ROOT

import sdhj
from sdhj.cli import main
from sdhj.formulas.rules import RULES

STANDS_FOR = {  # what a name before a dot means
    "table": ("LookupTable", "CertifiedTable"),
    "controller": ("Controller",),
    "problem": ("ReachAvoidProblem",),
    "report": ("Report",),
}
NAME = re.compile(r"(?<![`\w])`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\([^`]*\))?`(?!`)")
FILES = sorted((ROOT / "sdhj").rglob("*.py"))
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
# Of the system, NumPy, Numba, Python, and of other projects that pages cite.
OUTSIDE = {"MALLOC_TRIM_THRESHOLD_", "unzip", *dir(np), "NUMBA_CACHE_DIR", "__pycache__"}
OUTSIDE |= {"hj_reachability.systems.Air3d", "print_if_then_else", "problem.json"}
C = "".join((ROOT / "sdhj" / "certified" / name).read_text("utf-8") for name in ("sdhj.h", "export.py"))
KNOWN = {*dir(builtins), *keyword.kwlist, *sdhj.__all__, *RULES, *EXTRAS, *main.commands}
KNOWN |= {*re.findall(r"sdhj_\w+", C, re.IGNORECASE)}
SCOPES = (ast.Module, ast.ClassDef, ast.FunctionDef)


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def words(given: ast.AST) -> set[str]:
    """The names in a program, and its strings that could be names: keys of heads, options."""
    found = set[str]()
    for node in ast.walk(given):
        values = (getattr(node, field, None) for field in ("id", "arg", "attr", "name", "value", "asname"))
        found |= {value for value in values if isinstance(value, str) and value.isidentifier()}
    return found


def defined(given: ast.AST) -> set[str]:
    """The names of a file's functions, methods and classes, its constants, and the fields of its classes."""
    found = set[str]()
    for scope in (node for node in ast.walk(given) if isinstance(node, SCOPES)):
        found |= {getattr(scope, "name", "")}
        fields = (node for node in scope.body if isinstance(node, ast.Assign | ast.AnnAssign))
        if not isinstance(scope, ast.FunctionDef):
            found |= {part.id for node in fields for part in ast.walk(node) if isinstance(part, ast.Name)}
    return found


@cache
def modules() -> dict[str, list[Any]]:
    """The modules of the package that can be imported here, by their last names."""
    found: dict[str, list[Any]] = {}
    for path in (path for path in FILES if path.stem not in ("__main__", "environment")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        found.setdefault(name.rpartition(".")[2], []).append(importlib.import_module(name))
    return found


@cache
def classes(name: str) -> list[Any]:
    """The classes of the package with this name."""
    given = (vars(module).get(name) for several in modules().values() for module in several)
    return [one for one in given if inspect.isclass(one)]


@cache
def members(kind: type) -> set[str]:
    """The attributes of a class and of what is made of it."""
    own = [one for one in kind.__mro__ if one.__module__.startswith("sdhj")]
    made = {name for one in own for name in re.findall(r"\bself\.(\w+)\b.* = ", inspect.getsource(one))}
    return made.union(dir(kind), *map(inspect.get_annotations, own))


@cache
def offered() -> set[str]:
    """The attributes of all classes that users name."""
    kinds = (getattr(sdhj, name) for name in sdhj.__all__)
    return set[str]().union(*(members(kind) for kind in kinds if inspect.isclass(kind)))


def resolves(name: str, here: set[str]) -> bool:
    """Whether a name, dotted or not, means something where the names `here` are known."""
    first, _, rest = name.partition(".")
    if name in OUTSIDE:
        return True
    if not rest:
        return first in here | KNOWN or first in modules() or first in offered() or bool(classes(first))
    if first == "sdhj" and rest != "h":
        return pydoc.locate(name) is not None
    second = rest.split(".")[0]
    if kinds := [one for kind in STANDS_FOR.get(first, (first,)) for one in classes(kind)]:
        return any(second in members(kind) for kind in kinds)
    files = (path for path in (ROOT / name, *ROOT.rglob(f"[!.]*/{name}")) if path.is_file())
    known = {*name.split(".")} <= here or any(hasattr(module, second) for module in modules().get(first, []))
    return known or pydoc.locate(name) is not None or rest in ("h", "bin") or next(files, None) is not None


def gone(text: str, here: set[str]) -> set[str]:
    """The names in backticks of a text that mean nothing."""
    return {name for name in NAME.findall(text) if not resolves(name, here)}


@pytest.mark.slow
def test_docstrings_name_what_is_there() -> None:
    """In its file, or by a definition of its room or of the kernels."""
    found, rooms = set[str](), dict[str, set[str]]()
    for path in FILES:
        rooms.setdefault(path.relative_to(ROOT).parts[1], set()).update(defined(tree(path)))
    for path in FILES:
        here = words(tree(path)) | rooms[path.relative_to(ROOT).parts[1]] | rooms["kernels"]
        said = (ast.get_docstring(node) for node in ast.walk(tree(path)) if isinstance(node, SCOPES))
        found |= {f"{path.relative_to(ROOT)}: {name}" for name in gone("\n".join(filter(None, said)), here)}
    assert found == set()


def text_of(path: Path) -> tuple[str, str]:
    """What a page says, and its code."""
    if path.suffix == ".ipynb":
        cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(path.read_text("utf-8"))["cells"]]
        said, code = ("\n".join(text for kind, text in cells if kind == wanted) for wanted in ("markdown", "code"))
        return said, code
    said, *blocks = re.split(r"^```", path.read_text("utf-8"), flags=re.MULTILINE)
    return "\n".join([said, *blocks[1::2]]), "\n".join(blocks[::2])


@pytest.mark.slow
def test_pages_name_what_is_there() -> None:
    """In the package, in code that goes with the pages, or in the page's own."""
    folders = [ROOT / name for name in ("figures", "notebooks", "tests", ".ci")]
    others = [path for folder in folders for path in folder.rglob("*.py")]
    everywhere = {path.name for folder in folders for path in (folder, *folder.rglob("*/"))}
    everywhere = everywhere.union(*(words(tree(path)) for path in FILES), *(defined(tree(path)) for path in others))
    everywhere |= {path.stem for path in others}
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "notebooks").rglob("*.md"))]
    found = set[str]()
    for path in [*pages, *sorted((ROOT / "notebooks").glob("*.ipynb"))]:
        text, code = text_of(path)
        here = everywhere | {*re.findall(r"\w+", code)}
        found |= {f"{path.relative_to(ROOT)}: {name}" for name in gone(text, here)}
    assert found == set()


@pytest.mark.slow
def test_a_name_that_is_gone_is_found() -> None:
    """By its class, by what a name stands for on pages, in a module, in a file; and no other."""
    there = "`Images.swept`, `table.values(start=0)`, `sdhj.table.rules.RULES`, `select`, `sdhj.h`, `environment.txt`"
    assert gone(there, set()) == set()
    names = {"Images.reached", "table.cell", "sdhj.table.files.opened", "measured", "controller.selected"}
    assert gone(", ".join(f"`{name}`" for name in names), {"cell", "measure"}) == names
