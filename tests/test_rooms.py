"""The shape of the house: where imports may stand and point."""

import ast
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "sdhj"
FILES = sorted(PACKAGE.rglob("*.py"))
# Rooms whose extra may not be installed: alone these may be imported inside a function.
OPTIONAL = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["sdhj"]["optional"]


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def functions(module: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    return (node for node in ast.walk(module) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def imported(node: ast.AST) -> list[str]:
    """The modules that a statement imports from, by their full names."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        whole = f"{'.' * node.level}{node.module or ''}"
        own = whole == "sdhj"  # rooms, or names of the facade
        return [f"sdhj.{a.name}" if (PACKAGE / a.name).is_dir() else "sdhj" for a in node.names] if own else [whole]
    return []


def is_own(name: str) -> bool:
    return name.startswith((".", "sdhj.")) or name == "sdhj"


def faults(module: ast.Module) -> list[str]:
    """What hides an import from a reader: one line for each."""
    found = []
    top = {id(node) for node in module.body}
    for node in ast.walk(module):
        for name in filter(is_own, imported(node)):
            if name == "sdhj" or name.startswith("."):
                found.append(f"{node.lineno}: imports the facade, or by a relative name")  # type: ignore[attr-defined]
            elif id(node) not in top and not any(name == room or name.startswith(f"{room}.") for room in OPTIONAL):
                found.append(f"{node.lineno}: {name} is imported inside a block")  # type: ignore[attr-defined]
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__"):
            given = node.args[0] if node.args else None
            if not isinstance(given, ast.Constant) or is_own(str(given.value)):
                found.append(f"{node.lineno}: {ast.unparse(node)}")
        for_types = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        if for_types and any(map(imported, ast.walk(node))):
            found.append(f"{node.lineno}: TYPE_CHECKING")
    return found


@pytest.mark.slow
def test_imports_stand_at_the_top() -> None:
    rooms = [path for path in FILES if path != PACKAGE / "__init__.py"]
    assert {str(path): found for path in rooms if (found := faults(tree(path)))} == {}


def test_the_facade_imports_everything_at_once() -> None:
    """And nothing hangs on what is typed: no sys.argv, no signal handler."""
    facade = tree(PACKAGE / "__init__.py")
    assert not list(functions(facade))
    assert not {"sys", "signal", "importlib"} & {name for node in ast.walk(facade) for name in imported(node)}


def test_optional_rooms_are_there() -> None:
    for room in OPTIONAL:
        path = ROOT / room.replace(".", "/")
        assert path.is_dir() or path.with_suffix(".py").is_file()


def test_kernels_import_nothing_of_the_rest() -> None:
    """Compiled code is stamped with its folder alone; of `common.remembering` none of it calls anything."""
    for path in sorted((PACKAGE / "kernels").rglob("*.py")):
        own = {name for node in ast.walk(tree(path)) for name in imported(node) if is_own(name)}
        own -= {"sdhj.common.remembering", *(f"sdhj.common.remembering.{name}" for name in ("FloatArray", "read_only"))}
        assert all(name == "sdhj.kernels" or name.startswith("sdhj.kernels.") for name in own), path.name
