"""Names in backticks, in docstrings and on pages, are names of something that is there."""

import ast
import builtins
import json
import keyword
import pydoc
import re
import tomllib
from functools import cache
from pathlib import Path

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
KNOWN = {"sdhj", *dir(builtins), *keyword.kwlist, *sdhj.__all__, *RULES, *EXTRAS, *main.commands}
KNOWN |= {*re.findall(r"sdhj_\w+", C, re.IGNORECASE)}
MODULES = {path.stem: [one for one in FILES if one.stem == path.stem] for path in FILES}
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
def members() -> dict[str, set[str]]:
    """Of each class of the package what it, or a class that it is made of, has: methods, fields, what `self` keeps."""
    found, parents = dict[str, set[str]](), dict[str, set[str]]()
    for kind in (node for path in FILES for node in ast.walk(tree(path)) if isinstance(node, ast.ClassDef)):
        own = (one for one in ast.walk(kind) if isinstance(one, ast.Attribute) and ast.unparse(one.value) == "self")
        found.setdefault(kind.name, set()).update(defined(kind), (one.attr for one in own))
        parents.setdefault(kind.name, set()).update(ast.unparse(base).split(".")[-1] for base in kind.bases)
    for _ in range(3):  # as deep as classes are made of one another
        for name, above in parents.items():
            found[name].update(*(found.get(one, set()) for one in above))
    return found


def resolves(name: str, here: set[str]) -> bool:
    """Whether a name, dotted or not, means something where the names `here` are known."""
    first, _, rest = name.partition(".")
    offered = (members().get(kind, set()) for kind in sdhj.__all__)
    if name in OUTSIDE:
        return True
    if not rest:
        return first in here | KNOWN | MODULES.keys() | members().keys() | set[str]().union(*offered)
    if first == "sdhj" and rest != "h":
        return pydoc.locate(name) is not None
    second = rest.split(".")[0]
    if kinds := [members()[kind] for kind in STANDS_FOR.get(first, (first,)) if kind in members()]:
        return any(second in kind for kind in kinds)
    files = (path for path in (ROOT / name, *ROOT.rglob(f"[!.]*/{name}")) if path.is_file())
    known = {*name.split(".")} <= here or any(second in defined(tree(path)) for path in MODULES.get(first, ()))
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
