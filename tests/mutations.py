"""Take one thing out of a copy of the library, and see that a test notices."""

import ast
import importlib
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import types
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

import numba
import pytest
from changes import LIBRARY, mutant

TESTS = Path(__file__).parent
PARSING = Lock()  # CPython 3.11 counts the depth of trees for all threads together, and may then refuse to make one


@contextmanager
def started(request, kind, mutations, tests, folders, *, compiled=()):
    """The runs of all cases of a module that are asked for, by name, as many at a time as there are cores.

    kind : of the marks, "obligation" or "check". mutations : name -> (what is changed of which mark, see `changes`, the
    tests that must fail). tests : their file or folder. compiled : names of the cases whose tests run compiled.
    """
    chosen = [item.callspec.params["name"] for item in request.session.items if item.module is request.module]
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        yield {
            name: pool.submit(_run, kind, *mutations[name], tests, folders.mktemp("copy"), compiled=name in compiled)
            for name in chosen
        }
    finally:
        pool.shutdown(cancel_futures=True)


def _run(kind, change, test, tests, folder, *, compiled):
    """Run the tests of a name on a copy of the library in `folder` with a change."""
    with PARSING:
        file, tree = mutant(kind, change)
    shutil.copytree(LIBRARY, folder / "sdhj", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "sdhj" / file).write_text(ast.unparse(tree))
    command = ["-o", "addopts=--import-mode=importlib", "-q", "-x", "-p", "no:cacheprovider", "-m", "not bench"]
    command += [f"-c{TESTS.parent / 'pyproject.toml'}", *_holding(TESTS / tests, test), "-k", test]
    process = SERVER.Process(target=tested, args=(str(folder), command, compiled))
    process.start()
    process.join(600)
    process.kill()
    process.join()
    return subprocess.CompletedProcess(command, process.exitcode, (folder / "said").read_text(encoding="utf-8"))


# Importing these takes longer than most of the tests: one process does, and each run is a copy of it.
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["hypothesis", "matplotlib.pyplot", "numba", "pytest", "scipy.sparse"])


def tested(folder, command, compiled):
    """Run pytest on the library in `folder`, in a process of its own; what it prints is in a file there."""
    os.chdir(folder)
    os.environ |= {
        "NUMBA_DISABLE_JIT": "0" if compiled else "1",
        "NUMBA_CACHE_DIR": f"{folder}/cache",
        "PYTHONPATH": folder,
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # starting those takes as long as most of these tests
    }
    numba.config.reload_config()
    sys.dont_write_bytecode = True
    sys.path[:0] = [folder]
    with open("said", "wb", buffering=0) as said:
        for stream in (1, 2):
            os.dup2(said.fileno(), stream)
    code = pytest.main(command)
    sys.stdout.flush()
    os._exit(code)


def _holding(tests, name):
    """The file, or the files of a folder and of promises, with tests of a name: importing others takes longer."""
    files = sorted([*tests.rglob("test_*.py"), *(TESTS / "promises").glob("test_*.py")]) if tests.is_dir() else [tests]
    any_of = name.replace(" or ", "|")
    return [str(file) for file in files if re.search(rf"def \w*({any_of})", file.read_text(encoding="utf-8"))]


def assert_needed(run):
    """The tests of a run failed, by an assertion, or because bounds are compared with what they bound."""
    assert run.returncode == 1, run.stdout[-2000:]  # 1: tests ran and some failed
    assert any(words in run.stdout for words in ("AssertionError", "assert ", "DID NOT RAISE", "of that state alone"))


@contextmanager
def checker(folder, change):
    """`verify` of a copy of the checker in `folder` with a change; it imports nothing of the library."""
    file, tree = mutant("check", change)
    name = f"checker_{folder.name}".replace("-", "_")
    source = shutil.copytree(
        LIBRARY / "certified" / "check", folder / name, ignore=shutil.ignore_patterns("__pycache__")
    )
    (source / Path(file).relative_to("certified/check")).write_text(ast.unparse(tree))
    for path in source.rglob("*.py"):
        path.write_text(path.read_text().replace("sdhj.certified.check", name))
    compiles, numba.config.DISABLE_JIT = numba.config.DISABLE_JIT, 1  # what is compiled there is of arms
    sys.path.insert(0, str(folder))
    try:
        verify = importlib.import_module(name).verify
    finally:
        numba.config.DISABLE_JIT = compiles  # for kernels of the library, which may be compiled meanwhile
        sys.path.remove(str(folder))
    try:
        yield verify
    finally:
        for module in [module for module in sys.modules if module.split(".")[0] == name]:
            del sys.modules[module]


KERNELS = ("kernels/intervals.py", "kernels/tape.py")
PROVER = tuple(
    f"{name}.py"
    for name in (
        "kernels/pieces",
        "kernels/stencils",
        "kernels/windows",
        "certified/cells",
        "certified/bounds",
        "certified/word_tubes",
        "certified/arrivals",
        "certified/packing",
        "certified/images",
        "certified/general_proof",
    )
)


@contextmanager
def modules(chain, change):
    """The file of a chain with a change, and those after it, which import it: made anew, not compiled.

    A dictionary from files to modules. The library itself goes on with its own.
    """
    file, changed = mutant("obligation", change)
    names = {each: f"sdhj.{each.removesuffix('.py').replace('/', '.')}" for each in chain}
    kept, made = {name: sys.modules[name] for name in names.values()}, {}
    compiles, numba.config.DISABLE_JIT = numba.config.DISABLE_JIT, 1
    try:
        for each, name in names.items():
            if chain.index(each) < chain.index(file):
                continue  # it is as it was
            source = changed if each == file else (LIBRARY / each).read_text()
            made[each] = sys.modules[name] = module = types.ModuleType(name)
            setattr(sys.modules[name.rpartition(".")[0]], name.rpartition(".")[2], module)
            module.__file__ = str(LIBRARY / each)
            exec(compile(source, f"{name} of a mutation", "exec"), vars(module))
    finally:
        numba.config.DISABLE_JIT = compiles
        for name, module in kept.items():
            sys.modules[name] = module
            setattr(sys.modules[name.rpartition(".")[0]], name.rpartition(".")[2], module)
    yield made
