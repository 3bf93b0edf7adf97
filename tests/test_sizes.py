"""How large the house may become: lines by ring, the longest file and function, arguments of a kernel, names."""

import ast
import sys
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from subprocess import check_output

import pytest

PACKAGE = Path(__file__).parent.parent / "sdhj"
FILES = sorted(PACKAGE.rglob("*.py"))
CENTRAL = ("grid", "dynamics", "problem", "games", "recursion", "table", "controller")
RUN_BY_IMPORT = """
import sys, sdhj
print(*(module.__file__ for name, module in sys.modules.items() if name.split(".")[0] == "sdhj"))
"""
CORE = [Path(name) for name in check_output([sys.executable, "-c", RUN_BY_IMPORT], text=True).split()]
COMPILERS = {"kernel", "njit"}

# Names that two files may share: each stands for the same thing there, in code that must not import the other's.
TWICE = {"Array", "KINEMATICS", "ONE", "STRIDES"}  # the checker has its own: it imports nothing of what it checks


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def lines(paths: list[Path]) -> int:
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    return (node for node in ast.walk(tree(path)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def compiled(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether Numba's decorator, or the package's own, stands above a function."""
    plain = (node.func if isinstance(node, ast.Call) else node for node in function.decorator_list)
    return any(
        (node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")) in COMPILERS for node in plain
    )


def defined(path: Path) -> Iterator[str]:
    """Names that a file defines at its top: functions, classes, constants; not __dunder__ names."""
    for node in tree(path).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names = [node.name]
        else:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            names = [name.id for target in targets if target for name in ast.walk(target) if isinstance(name, ast.Name)]
        yield from (name for name in names if not name.startswith("__"))


@pytest.mark.parametrize(
    ("what", "paths", "most"),
    [
        ("the package", FILES, 16_200),
        ("the core, which `import sdhj` runs", CORE, 5_100),
        ("its central files", [PACKAGE / f"{name}.py" for name in CENTRAL], 2_300),
    ],
)
def test_a_ring_stays_small(what: str, paths: list[Path], most: int) -> None:
    assert lines(paths) <= most, f"{what} has {lines(paths)} lines"


def test_files_and_functions_stay_short() -> None:
    long = [f"{path.name}: {lines([path])} lines" for path in FILES if lines([path]) > 450]
    for path in FILES:
        spans = ((function.name, function.end_lineno - function.lineno + 1) for function in functions(path))
        long += [f"{path.name}: {name} has {span} lines" for name, span in spans if span > 60]
    assert long == []


def test_kernels_take_few_arguments() -> None:
    kernels = [(path, function) for path in FILES for function in functions(path) if compiled(function)]
    assert len(kernels) > 20  # or this looks for the wrong decorator
    many = []
    for path, function in kernels:
        number = len(function.args.posonlyargs + function.args.args + function.args.kwonlyargs)
        many += [f"{path.name}: {function.name} has {number}"] if number > 8 else []
    assert many == []


def test_one_name_means_one_thing() -> None:
    """No two functions, classes or constants of one name, private ones among them."""
    pairs = sorted((name, str(path.relative_to(PACKAGE))) for path in FILES for name in set(defined(path)))
    shared = {name: [file for _, file in group] for name, group in groupby(pairs, key=lambda pair: pair[0])}
    twice = {name: files for name, files in shared.items() if len(files) > 1 and name not in TWICE | {"main"}}
    assert twice == {}
