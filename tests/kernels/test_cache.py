"""How kernels are compiled; what is compiled is kept on disk, and never run when it is old.

Numba throws a cached kernel away when its own source file changes, and only then: an edit to a helper or a constant in
another file goes unseen. `sdhj.kernels.compiling.kernel` watches the folder of kernels and nothing else, so all that is
compiled lies there (the independent checker, which imports nothing of the
package, has a decorator of its own for its folder).
"""

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest

from sdhj.common.showing import LINE
from sdhj.kernels import compiling
from sdhj.kernels.compiling import kernel

PACKAGE = Path(__file__).parents[2] / "sdhj"
COMPILERS = {"njit", "jit", "vectorize", "guvectorize", "stencil", "cfunc", "overload", "register_jitable"}
MAKERS = {Path("kernels/compiling.py"), Path("certified/check/arm/bits.py")}  # of the two decorators
FILES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))


def faults(source: str) -> list[str]:
    """What in a file could make the disk cache run old code, or never hit; one line for each."""
    module, found = ast.parse(source), []
    for node in ast.walk(module):
        if isinstance(node, ast.Name | ast.Attribute) and (name := getattr(node, "id", getattr(node, "attr", None))):
            found += [f"{node.lineno}: {name} does not see changes in other files"] if name in COMPILERS else []
        if isinstance(node, ast.FunctionDef) and node not in module.body:
            names = {n.id for d in node.decorator_list for n in ast.walk(d) if isinstance(n, ast.Name)}
            found += [f"{node.lineno}: {node.name} is compiled in every process anew"] if "kernel" in names else []
    return found


@pytest.mark.slow
def test_everything_is_compiled_by_the_decorator_that_watches_the_package() -> None:
    """But for the two files that make the decorators; and in its folder."""
    texts = {path: (PACKAGE / path).read_text(encoding="utf-8") for path in FILES}
    found = {path: faults(text) for path, text in texts.items()}
    assert {path for path, its in found.items() if its} == MAKERS, found
    compiled = {
        path.parts[0] for path, text in texts.items() if re.search(r"^ *@(kernel|inlined)\b", text, re.MULTILINE)
    }
    assert compiled == {"kernels"}


def run(code: str, folder: Path, **changed: str) -> str:
    """Run a line of Python in a new process, in a folder, with a cache of its own; return what it prints."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"} | changed
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


HEAD = "from small.compiling import inlined, kernel\n"
SMALL = {
    "__init__.py": "",
    "helper.py": f"{HEAD}STEP = 1\n\n@kernel()\ndef helper(x):\n    return x + 1\n\n"
    "@inlined\ndef unrolled(x):\n    return x * 5\n",
    "apart.py": f"{HEAD}from small.helper import STEP, helper, unrolled\n\n"
    "@kernel(nogil=True)\ndef twice(x):\n    return unrolled(helper(helper(x)) * STEP)\n",
}


def small_package(folder: Path) -> Path:
    package = folder / "small"
    package.mkdir()
    shutil.copy(PACKAGE / "kernels" / "compiling.py", package)
    for name, text in SMALL.items():
        (package / name).write_text(text, encoding="utf-8")
    return package


ANSWERS = "from small.apart import twice; print(twice(1), len(twice.stats.cache_hits), len(twice.stats.cache_misses))"


@pytest.mark.slow
def test_a_change_to_a_file_that_is_imported_is_seen(tmp_path: Path) -> None:
    """A helper or a constant of another file; what has not changed is read from the disk in the next process.

    So is what has been changed back.
    """
    package = small_package(tmp_path)

    def compiled_once_then_read(answer: int) -> None:
        assert run(ANSWERS, tmp_path).split() == [str(answer), "0", "1"]
        assert run(ANSWERS, tmp_path).split() == [str(answer), "1", "0"]

    compiled_once_then_read(15)
    edit(package / "helper.py", "x + 1", "x + 10")
    compiled_once_then_read(105)
    edit(package / "helper.py", "x + 10", "x + 1")
    assert run(ANSWERS, tmp_path).split() == ["15", "1", "0"]
    edit(package / "helper.py", "STEP = 1", "STEP = 3")
    compiled_once_then_read(45)
    edit(package / "helper.py", "x * 5", "x * 2")
    compiled_once_then_read(18)


def test_old_versions_are_cleared(tmp_path: Path) -> None:
    """By the time at which they were last used; what is no version of a kernel stays."""
    now = time.time()
    for days in (0, 1, 2, 29, 31, 400):
        path = tmp_path / f"lookup.decide-427.py311.{days}.code"
        path.write_bytes(b"0" * 10)
        os.utime(path, (now - days * 86400,) * 2)
    (tmp_path / "mine.txt").touch()
    os.utime(tmp_path / "mine.txt", (0, 0))

    def left() -> list[str]:
        return sorted(path.suffixes[-2][1:] for path in tmp_path.glob("*.code"))

    compiling._clear.__wrapped__(tmp_path)
    assert left() == ["0", "1", "2", "29"]
    assert (tmp_path / "mine.txt").exists()
    compiling._clear.__wrapped__(tmp_path / "nowhere")


@pytest.mark.slow
def test_an_edit_elsewhere_compiles_nothing(tmp_path: Path) -> None:
    """A comment in any room but that of the kernels."""
    package = shutil.copytree(PACKAGE, tmp_path / "sdhj", ignore=shutil.ignore_patterns("__pycache__"))
    code = """
import numpy as np, sdhj
from sdhj.kernels.interpolation import wrap
sdhj.Grid([0.0], [1.0], [5], [True]).wrapped(np.zeros((1, 1)))
print(sdhj.__file__, len(wrap.stats.cache_misses))
"""
    told = str(package / "__init__.py")
    assert run(code, tmp_path, PYTHONPATH=str(tmp_path)).split() == [told, "1"]
    edited = [file for file in package.rglob("*.py") if package / "kernels" not in file.parents]
    assert len(edited) > 50
    for file in edited:
        file.write_text(file.read_text(encoding="utf-8") + "# a comment\n", encoding="utf-8")
    assert run(code, tmp_path, PYTHONPATH=str(tmp_path)).split() == [told, "0"]


@pytest.mark.slow
def test_functions_outside_the_package_see_their_own_file_change(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(
        "from sdhj.kernels.compiling import kernel\n@kernel()\ndef helper(x):\n    return x + 1\n", encoding="utf-8"
    )
    code = "from mine import helper; print(helper(1), len(helper.stats.cache_hits))"
    assert run(code, tmp_path).split() == ["2", "0"]
    assert run(code, tmp_path).split() == ["2", "1"]
    edit(mine, "x + 1", "x + 10")
    assert run(code, tmp_path).split() == ["11", "0"]


@pytest.mark.slow
def test_compiling_is_said_once_and_reading_from_the_cache_is_not(tmp_path: Path) -> None:
    """Two kernels are compiled in the first process, none in the second; what is around a call has the word."""
    code = """
import sys
import numpy as np
import sdhj
from sdhj.common.showing import announced
sys.stderr = sys.stdout
grid = sdhj.Grid([0.0], [1.0], [5], [True])
with announced(progress={progress}):
    with announced(progress=True):
        grid.wrapped(np.zeros((1, 1)))
    grid.interpolate(np.zeros(5), np.zeros((1, 1)))
print("end")
"""
    told = code.format(progress=None)  # where standard error is no terminal
    assert run(told, tmp_path).split("\n") == [LINE, "end", ""]
    assert run(told, tmp_path).split() == ["end"]
    quiet, cell = tmp_path / "quiet", tmp_path / "cell"
    quiet.mkdir()
    cell.mkdir()
    assert run(code.format(progress=False).replace("=True", "=False"), quiet).split() == ["end"]
    stream = 'import io; sys.stderr = type("Stream", (io.StringIO,), {"__module__": "ipykernel.iostream"})()'
    in_a_cell = told.replace("sys.stderr = sys.stdout", stream) + "print(len(sys.stderr.getvalue()))"
    assert run(in_a_cell, cell).split() == ["end", "0"]


# ---- kernels that Python calls, and that kernels call


def pair(**options: object) -> tuple[Any, Any]:
    """A kernel that refuses what is negative, and one that calls it twice."""

    @kernel(**options)
    def root(x):
        if x < 0.0:
            raise ValueError("negative")
        return np.sqrt(x)

    @kernel(**options)
    def roots(x):
        return root(x) + root(4.0 * x)

    return root, roots


def refused(called: Any) -> None:
    with pytest.raises(ValueError, match="negative"):
        called(-1.0)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("linked", [True, False])
@pytest.mark.parametrize("first", [0, 1])
def test_a_kernel_is_called_from_both_sides(monkeypatch: pytest.MonkeyPatch, first: int, linked: bool) -> None:
    """In either order; and where Numba does not have what linking needs, by which nothing but the time changes."""
    monkeypatch.setattr(compiling, "LINKED", compiling.LINKED and linked)
    both = pair()
    for called in (both[first], both[1 - first], *both):
        assert called(4.0) == (2.0 if called is both[0] else 6.0)
        refused(called)
    assert len(both[0].overloads) == len(both[1].overloads) == 1


BOTH = """
from sdhj.kernels.compiling import kernel
@kernel()
def root(x):
    if x < 0.0:
        raise ValueError("negative")
    return x ** 0.5
@kernel(parallel=True)
def roots(x):
    out = x + 0.0
    for i in prange(x.size):
        out[i] = root(x[i])
    return out
"""


@pytest.mark.slow
@pytest.mark.parametrize("first", ["root(4.0)", "roots(np.ones(5) * 4.0)[4]"])
def test_processes_find_what_others_left(tmp_path: Path, first: str) -> None:
    """One of the two kernels on disk and the other not, in a process that calls both, in a loop that threads share."""
    (tmp_path / "both.py").write_text("import numpy as np\nfrom numba import prange\n" + BOTH, encoding="utf-8")
    code = "import numpy as np; from both import root, roots; print({})"
    assert run(code.format(first), tmp_path).split() == ["2.0"]
    both = "root(4.0), roots(np.ones(5) * 4.0)[4], len(root.stats.cache_hits) + len(roots.stats.cache_hits)"
    for read in ("1", "2"):
        assert run(code.format(both), tmp_path).split() == ["2.0", "2.0", read]


# ---- the cache is optional


MINE = """
from maker import {decorator} as kernel
@kernel()
def triple(x):
    return 3 * x
"""
ASKED = "from mine import triple; print(triple(2), len(triple.stats.cache_hits))"
DECORATORS = dict(zip(sorted(MAKERS, reverse=True), ("kernel", "compiled"), strict=True))


def process(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), **environment}
    return subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)


@pytest.fixture(params=DECORATORS, ids=str)
def mine(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A folder with a module of one kernel, by a copy of the package's decorator or the checker's."""
    shutil.copy(PACKAGE / request.param, tmp_path / "maker.py")
    (tmp_path / "mine.py").write_text(MINE.format(decorator=DECORATORS[request.param]), encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_nothing_can_be_written(tmp_path: Path) -> None:
    """Neither the installation, nor the home, nor what NUMBA_CACHE_DIR names: it runs, and says so once.

    Files stand where folders would have to be made, which stops the administrator too.
    """
    shutil.copytree(PACKAGE, tmp_path / "sdhj", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in {path.parent for path in (tmp_path / "sdhj").rglob("*.py")}:
        (folder / "__pycache__").touch()
    code = """
import numpy as np, sdhj, sdhj.certified.check
grid = sdhj.Grid([0.0], [1.0], [5])
print(sdhj.__file__, grid.interpolate(np.arange(5.0), np.array([[0.5]]))[0])
"""
    nowhere = {name: "/dev/null/home" for name in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")}
    done = process(code, tmp_path, PYTHONPATH=str(tmp_path), **nowhere)
    assert done.stdout.split() == [str(tmp_path / "sdhj" / "__init__.py"), "2.0"], done.stderr
    assert done.stderr.count("compiled code is not kept") == 1 and "set NUMBA_CACHE_DIR" in done.stderr


def flipped(data: bytes) -> bytes:
    """Every hundredth byte changed."""
    return bytes(byte ^ 0xFF if place % 100 == 50 else byte for place, byte in enumerate(data))


@pytest.mark.slow
@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[:100], lambda data: data[:-1], flipped])
def test_a_damaged_cache_is_thrown_away(mine: Path, damage: Callable[[bytes], bytes]) -> None:
    """Every file of it: the answer is right, and the next process reads what was compiled in its place."""
    assert process(ASKED, mine).stdout.split() == ["6", "0"]
    files = [path for path in (mine / "cache").rglob("*") if path.is_file()]
    assert files and process(ASKED, mine).stdout.split() == ["6", "1"]
    for path in files:
        path.write_bytes(damage(path.read_bytes()))
    assert process(ASKED, mine).stdout.split() == ["6", "0"]
    assert process(ASKED, mine).stdout.split() == ["6", "1"]


def test_a_cache_on_a_full_disk_does_not_end_the_work(
    mine: Path, monkeypatch: pytest.MonkeyPatch, files_of_at_most: Callable[[int], AbstractContextManager[None]]
) -> None:
    """A limit on the size of files stands for the disk."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(mine / "cache"))
    monkeypatch.syspath_prepend(mine)
    for name in ("maker", "mine"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with warnings.catch_warnings(record=True) as told, files_of_at_most(100):
        triple = importlib.import_module("mine").triple
        assert (triple(2), triple(2.5)) == (6, 7.5)
    said = ["compiled code is not kept"] if "_say_uncached" in (mine / "maker.py").read_text(encoding="utf-8") else []
    assert [str(warning.message)[:25] for warning in told] == said  # the checker's decorator says nothing
    assert [path for path in (mine / "cache").rglob("*") if path.is_file()] == []


# ---- two processes at once


AT_ONCE = """
import sys, time
from pathlib import Path
from mine import triple
Path(sys.argv[1]).touch()
while len(list(Path().glob("ready*"))) < 2:
    time.sleep(0.001)
print(triple(2), len(triple.stats.cache_misses))
"""


@pytest.mark.slow
@pytest.mark.parametrize("mine", [Path("kernels/compiling.py")], indirect=True, ids=str)
def test_of_two_processes_one_compiles(mine: Path) -> None:
    """Both are about to call the same function when either does; the other one waits and reads what is kept."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(mine / "cache")}
    command = [sys.executable, "-c", AT_ONCE]
    both = [
        subprocess.Popen([*command, name], cwd=mine, env=environment, stdout=subprocess.PIPE, text=True)
        for name in ("ready1", "ready2")
    ]
    assert sorted(process.communicate()[0].split() for process in both) == [["6", "0"], ["6", "1"]]
    assert not list((mine / "cache").rglob("*.lock"))


def locking_fails(*_: object) -> None:
    raise OSError("no locks available")


LOCKS = {
    "Windows": None,
    "none": SimpleNamespace(LOCK_EX=2, flock=locking_fails),
}


@pytest.mark.parametrize("locks", LOCKS)
def test_locks_are_optional(monkeypatch: pytest.MonkeyPatch, locks: str) -> None:
    monkeypatch.setattr(compiling, "fcntl", LOCKS[locks])

    @kernel()
    def four(x):
        return 4 * x

    assert four(2) == 8 and not list(Path(four.stats.cache_path).glob("*four*.lock"))
