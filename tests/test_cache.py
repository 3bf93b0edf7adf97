"""Numba's disk cache must never run old code.

A cached kernel is thrown away when its own source file changes, and only then: an edit to a helper or a constant in
another file goes unseen, and the kernel goes on with the old one compiled in. `sdhj.compiling.kernel` watches the whole
package; a function compiled by Numba's own decorators may use nothing that comes from another file of the package.
(Arguments are no concern: they are not compiled in.)
"""

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from sdhj import compiling
from sdhj.compiling import LINE

PACKAGE = Path(__file__).parent.parent / "sdhj"
COMPILERS = {"njit", "jit", "vectorize", "guvectorize", "stencil", "cfunc", "generated_jit", "overload"}

Function = ast.FunctionDef | ast.AsyncFunctionDef


def names_read(node: ast.AST) -> set[str]:
    """Names that an expression or a body reads; of a.b.c that is a."""
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}


def names_bound(node: ast.AST) -> set[str]:
    """Names that a statement or a body assigns."""
    stored = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return stored | {n.arg for n in ast.walk(node) if isinstance(n, ast.arg)}


def is_compiler(node: ast.AST) -> bool:
    """Whether an expression is one of Numba's decorators: njit, njit(...), numba.njit, numba.njit(...)."""
    if isinstance(node, ast.Call):
        return is_compiler(node.func)
    name = node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", None)
    return name in COMPILERS


def is_cached(decorator: ast.expr) -> bool:
    options = decorator.keywords if isinstance(decorator, ast.Call) else []
    return any(o.arg == "cache" and isinstance(o.value, ast.Constant) and o.value.value is True for o in options)


def imports_of_package(tree: ast.AST) -> set[str]:
    """Names that a file imports from sdhj, wherever in the file."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.level > 0 or (node.module or "").split(".")[0] == "sdhj"):
            names |= {alias.asname or alias.name for alias in node.names}
        if isinstance(node, ast.Import):
            ours = [alias for alias in node.names if alias.name.split(".")[0] == "sdhj"]
            names |= {alias.asname or "sdhj" for alias in ours}
    return names


def foreign_names(tree: ast.Module) -> set[str]:
    """Names of a file that stand for something of another file: imports, and constants computed from them."""
    foreign = imports_of_package(tree)
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign) and names_read(node) & foreign:
            foreign |= names_bound(node)
    return foreign


def compiled_functions(tree: ast.Module) -> Iterator[tuple[Function, ast.expr]]:
    """Each compiled function with its decorator; @fast counts where the file has fast = njit(...)."""
    named = {
        n.targets[0].id: n.value for n in tree.body if isinstance(n, ast.Assign) and isinstance(n.targets[0], ast.Name)
    }
    for node in ast.walk(tree):
        for decorator in getattr(node, "decorator_list", []):
            if isinstance(decorator, ast.Name):
                decorator = named.get(decorator.id, decorator)
            if isinstance(node, Function) and is_compiler(decorator):
                yield node, decorator


def calls_that_compile(tree: ast.Module) -> Iterator[ast.Call]:
    """njit(f) and njit(cache=True)(f), which compile a function that `compiled_functions` does not see."""
    decorators = {id(d) for node in ast.walk(tree) for d in getattr(node, "decorator_list", [])}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and node.args and is_compiler(node.func) and id(node) not in decorators:
            yield node


def faults(source: str, file: str = "file.py") -> list[str]:
    """What in a file could make the disk cache run old code, or never hit; one line for each."""
    tree = ast.parse(source)
    foreign = foreign_names(tree)
    found = [
        f"{file}:{call.lineno}: compile functions with a decorator, where this test sees what they use"
        for call in calls_that_compile(tree)
    ]
    for function, decorator in compiled_functions(tree):
        where = f"{file}:{function.lineno}: {function.name}"
        defaults = [d for d in (*function.args.defaults, *function.args.kw_defaults) if d is not None]
        used = set[str]().union(*(names_read(part) for part in (*function.body, *defaults)))
        for name in sorted((used & foreign) - names_bound(function)):
            found.append(f"{where} uses {name} of another file; move one to the other, or pass it as an argument")
        if function not in tree.body:
            found.append(f"{where} is not at the top of its module, so it is compiled again in every process")
        if not is_cached(decorator):
            found.append(f"{where} is compiled without cache=True")
    return found


FILES = sorted(path for path in PACKAGE.rglob("*.py") if path.name != "compiling.py")  # which makes the decorator


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_compiled_functions_use_only_their_own_file(path: Path) -> None:
    assert faults(path.read_text(encoding="utf-8"), path.name) == []


def test_the_package_has_compiled_functions_to_check() -> None:
    trees = (ast.parse(p.read_text(encoding="utf-8")) for p in PACKAGE.rglob("*.py"))
    assert sum(len(list(compiled_functions(tree))) for tree in trees) >= 3


HEAD = "from numba import njit\nimport numba as nb\n"
KERNEL = "@njit(cache=True)\ndef kernel(x):\n    return "
PLANTED = {
    "helper": "from sdhj.grid import helper\n" + KERNEL + "helper(x)",
    "constant": "from sdhj.grid import EPS\n" + KERNEL + "x + EPS",
    "renamed": "from sdhj.grid import helper as h\n" + KERNEL + "h(x)",
    "relative": "from .grid import helper\n" + KERNEL + "helper(x)",
    "module": "from sdhj import grid\n" + KERNEL + "grid.helper(x)",
    "module renamed": "import sdhj.grid as g\n" + KERNEL + "g.helper(x)",
    "whole package": "import sdhj.grid\n" + KERNEL + "sdhj.grid.helper(x)",
    "default": "from sdhj.grid import EPS\n@njit(cache=True)\ndef kernel(x, e=EPS):\n    return x + e",
    "handed on": "from sdhj.grid import helper\n" + KERNEL + "map(helper, x)",
    "derived constant": "from sdhj.grid import A\nB = 2 * A\nC = B + 1\n" + KERNEL + "x + C",
    "attribute decorator": "from sdhj.grid import A\n@nb.njit(cache=True)\ndef kernel(x):\n    return A",
    "named decorator": "from sdhj.grid import A\nfast = njit(cache=True)\n@fast\ndef kernel(x):\n    return A",
    "not cached": "@njit\ndef kernel(x):\n    return x",
    "not cached, attribute": "@nb.njit\ndef kernel(x):\n    return x",
    "not cached, options": "@njit(parallel=True)\ndef kernel(x):\n    return x",
    "cache off": "@njit(cache=False)\ndef kernel(x):\n    return x",
    "closure": "def make(a):\n    @njit(cache=True)\n    def kernel(x):\n        return a * x\n    return kernel",
    "call, not decorator": "kernel = njit(lambda x: x)",
    "named decorator, not cached": "fast = njit(parallel=True)\n@fast\ndef kernel(x):\n    return x",
    "curried call": "kernel = njit(cache=True)(plain)",
}
HARMLESS = {
    "own helper": "@njit(cache=True)\ndef helper(x):\n    return x\n" + KERNEL + "helper(x)",
    "own constant": "EPS = 1e-6\n" + KERNEL + "x + EPS",
    "other libraries": "import numpy as np\n" + KERNEL + "np.sqrt(x)",
    "shadowed by the argument": "from sdhj.grid import x\n" + KERNEL + "x + 1",
    "plain function": "from sdhj.grid import helper\ndef shell(x):\n    return helper(x)\n" + KERNEL + "x",
    "named decorator": "fast = njit(cache=True)\n@fast\ndef kernel(x):\n    return x",
}


@pytest.mark.parametrize("source", PLANTED.values(), ids=PLANTED.keys())
def test_planted_fault_is_found(source: str) -> None:
    assert len(faults(HEAD + source)) == 1


@pytest.mark.parametrize("source", HARMLESS.values(), ids=HARMLESS.keys())
def test_harmless_code_passes(source: str) -> None:
    assert faults(HEAD + source) == []


TWO_FILES = {
    "helper.py": "from numba import njit\n\n@njit(cache=True)\ndef helper(x):\n    return x + 1\n",
    "apart.py": "from numba import njit\nfrom helper import helper\n\n" + KERNEL + "helper(x)\n",
    "together.py": "from numba import njit\n\n@njit(cache=True)\ndef helper(x):\n    return x + 1\n\n"
    + KERNEL
    + "helper(x)\n",
}


def run(code: str, folder: Path) -> str:
    """Run a line of Python in a new process, in a folder, with a cache of its own; return what it prints."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.slow
def test_an_edited_helper_is_seen_only_in_its_own_file(tmp_path: Path) -> None:
    """The reason for the rule: `apart` goes on with the old helper, `together` takes the new one.

    Should `apart` give 11 one day, Numba has learnt to watch other files and the rule can go.
    """
    for name, text in TWO_FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    code = "import apart, together; print(apart.kernel(1), together.kernel(1))"
    assert run(code, tmp_path).split() == ["2", "2"]
    for name in ("helper.py", "together.py"):
        edit(tmp_path / name, "x + 1", "x + 10")
    assert run(code, tmp_path).split() == ["2", "11"]


PACKAGE_OF_TWO = {
    "__init__.py": "",
    "helper.py": "from small.compiling import kernel\nSTEP = 1\n\n@kernel()\ndef helper(x):\n    return x + 1\n",
    "apart.py": "from small.compiling import kernel\nfrom small.helper import STEP, helper\n\n"
    "@kernel(nogil=True)\ndef twice(x):\n    return helper(helper(x)) * STEP\n",
}


@pytest.mark.slow
def test_a_change_to_any_file_of_the_package_is_seen(tmp_path: Path) -> None:
    """A helper or a constant of another file; what has not changed is read from the disk in the next process."""
    package = tmp_path / "small"
    package.mkdir()
    shutil.copy(PACKAGE / "compiling.py", package)
    for name, text in PACKAGE_OF_TWO.items():
        (package / name).write_text(text, encoding="utf-8")
    code = "from small.apart import twice; print(twice(1), len(twice.stats.cache_hits), len(twice.stats.cache_misses))"
    compiled, read = ["0", "1"], ["1", "0"]
    assert run(code, tmp_path).split() == ["3", *compiled]
    assert run(code, tmp_path).split() == ["3", *read]
    edit(package / "helper.py", "x + 1", "x + 10")
    assert run(code, tmp_path).split() == ["21", *compiled]
    assert run(code, tmp_path).split() == ["21", *read]
    edit(package / "helper.py", "STEP = 1", "STEP = 3")
    assert run(code, tmp_path).split() == ["63", *compiled]
    assert run(code, tmp_path).split() == ["63", *read]


@pytest.mark.slow
def test_functions_outside_the_package_see_their_own_file_change(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(TWO_FILES["helper.py"].replace("numba import njit", "sdhj.compiling import kernel"))
    edit(mine, "@njit(cache=True)", "@kernel()")
    code = "from mine import helper; print(helper(1), len(helper.stats.cache_hits))"
    assert run(code, tmp_path).split() == ["2", "0"]
    assert run(code, tmp_path).split() == ["2", "1"]
    edit(mine, "x + 1", "x + 10")
    assert run(code, tmp_path).split() == ["11", "0"]


@pytest.mark.parametrize("inside", [SimpleNamespace(), SimpleNamespace(_cache=None), SimpleNamespace(_cache=print)])
def test_kernel_does_without_what_numba_may_change(monkeypatch: pytest.MonkeyPatch, inside: SimpleNamespace) -> None:
    """The stamp is a private part of Numba's: in a version without it, and uncompiled, a kernel is a kernel still."""
    asked: list[dict[str, object]] = []

    def njit(**options: object) -> object:
        asked.append(options)
        return lambda function: inside

    monkeypatch.setattr(compiling, "njit", njit)
    assert compiling.kernel(parallel=True)(len) is inside
    assert asked == [{"cache": True, "parallel": True}]


@pytest.mark.slow
def test_a_kernel_of_the_package_is_compiled_anew_after_an_edit(tmp_path: Path) -> None:
    """Change the helper in a copy of interpolation.py: the cached public kernel gives the new answer."""
    source = Path(shutil.copy(PACKAGE / "interpolation.py", tmp_path))
    code = (
        "import numpy as np; from interpolation import interpolate; one = np.ones(1); "
        "print(interpolate(np.arange(5.0), np.array([[1.5]]), 0 * one, one, np.array([5]), np.array([False]))[0])"
    )
    assert float(run(code, tmp_path)) == 1.5
    edit(source, "(coordinate - lower) / spacing", "(coordinate - lower) / spacing + 1.0")
    assert float(run(code, tmp_path)) == 2.5


@pytest.mark.slow
def test_compiling_is_said_once_and_reading_from_the_cache_is_not(tmp_path: Path) -> None:
    """Two kernels are compiled in the first process, none in the second; what is around a call has the word."""
    code = """
import sys
import numpy as np
import sdhj
from sdhj.compiling import announced
sys.stderr = sys.stdout
grid = sdhj.Grid([0.0], [1.0], [5], [True])
with announced(progress={progress}):
    with announced(progress=True):
        grid.wrapped(np.zeros((1, 1)))
    grid.interpolate(np.zeros(5), np.zeros((1, 1)))
print("end")
"""
    told = code.format(progress=True)
    assert run(told, tmp_path).split("\n") == [LINE, "end", ""]
    assert run(told, tmp_path).split() == ["end"]
    quiet = tmp_path / "quiet"
    quiet.mkdir()
    assert run(code.format(progress=None).replace("=True", "=False"), quiet).split() == ["end"]
