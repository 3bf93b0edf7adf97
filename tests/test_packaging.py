"""The frame around the library: version, dependencies, what CI checks, and what every file must not name."""

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

import sdhj

ROOT = Path(__file__).parent.parent
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

# Absolute paths of somebody's machine: folders where people and their tools live.
# Not the middle of a longer path or address, nor of a picture's base64 text.
FOLDERS = r"(?:/(?:home|Users|root|work|opt|srv|mnt|media|shared)/\w|[A-Z]:\\+Users\b)"
MACHINE_PATH = re.compile(rf"(?:(?<![\w.+/)}}\]])|(?<=file://)){FOLDERS}")


def tracked_files() -> list[Path]:
    """Files that git tracks here, relative to the root; skips where this is no git checkout."""
    result = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if result.returncode != 0:
        pytest.skip("not a git checkout")
    return [Path(name) for name in result.stdout.split("\0") if name]


def pinned() -> dict[str, str]:
    """Name (normalised) to version of each line of environment.txt."""
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in pairs}


def test_version_is_the_same_everywhere() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", sdhj.__version__)
    try:
        installed = importlib.metadata.version("sdhj")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("sdhj is not installed, only on the path")
    assert installed == sdhj.__version__


def requirements(*extras: str) -> list[Requirement]:
    """What sdhj[extras] asks for, extras that extras name among them."""
    texts = [*PROJECT["dependencies"], *(text for extra in extras for text in PROJECT["optional-dependencies"][extra])]
    found = [Requirement(text) for text in texts]
    deeper = {extra for requirement in found if requirement.name == "sdhj" for extra in requirement.extras}
    return [r for r in found if r.name != "sdhj"] + (requirements(*sorted(deeper)) if deeper else [])


def test_pins_satisfy_the_requirements() -> None:
    versions = pinned()
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]
    tools = [Requirement(text) for group in groups.values() for text in group if isinstance(text, str)]
    for requirement in [*requirements("test"), *tools]:
        assert requirement.name in versions, f"environment.txt lacks {requirement.name}; run .ci/pin"
        assert requirement.specifier.contains(versions[requirement.name]), f"{requirement}: run .ci/pin"


@cache
def top_names(path: Path) -> set[str]:
    """The packages that a file imports, each by the first part of its name."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.append(node.module or "")
    return {name.split(".")[0] for name in names}


def imported(*patterns: str) -> dict[str, set[str]]:
    """For each third-party package the files that import it, of those that match a pattern."""
    found: dict[str, set[str]] = {}
    for path in sorted(path for pattern in patterns for path in ROOT.glob(pattern)):
        for top in top_names(path):
            found.setdefault(COMES_WITH.get(top, top), set()).add(str(path.relative_to(ROOT)))
    return {name: files for name, files in found.items() if name not in OURS | set(sys.stdlib_module_names)}


# Packages imported under another name than the one they are installed by, or that a declared one cannot do without.
COMES_WITH = {
    "IPython": "ipywidgets",
    "PIL": "pillow",
    "mpl_toolkits": "matplotlib",
    "nbformat": "nbval",
    "packaging": "pytest",
    "traitlets": "ipywidgets",
    "yaml": "pyyaml",
}
OURS = {"sdhj", "course"} | {
    path.stem for folder in ("figures", "notebooks", "tests") for path in (ROOT / folder).rglob("*.py")
}


@pytest.mark.parametrize(
    ("pattern", "extras"),
    [
        ("sdhj/*.py", []),
        ("sdhj/problem/shapes/maps.py", ["maps"]),
        ("sdhj/simulation/*.py", []),
        ("sdhj/simulation/environment.py", ["gym"]),
        ("sdhj/certified/**/*.py", []),
        ("sdhj/arm/*.py", ["plot"]),  # an arm is drawn with shapely
        ("sdhj/plotting/*.py", ["plot"]),
        ("figures/**/*.py", ["plot", "bench", "physics"]),
        ("notebooks/course/**/*.py", ["notebooks"]),
    ],
)
def test_imports_are_declared(pattern: str, extras: list[str]) -> None:
    """What files import is a dependency, or belongs to the extras with which they are used."""
    declared = {requirement.name.replace("-", "_") for requirement in requirements(*extras)}
    own = {"sdhj/problem/shapes/maps.py", "sdhj/simulation/environment.py"} - {
        pattern
    }  # these have extras of their own
    undeclared = {name: files - own for name, files in imported(pattern).items() if name not in declared}
    assert not any(undeclared.values()), undeclared


@pytest.mark.slow
def test_no_dependency_is_for_nothing() -> None:
    """Every dependency is imported by the package, every package of an extra somewhere."""
    everywhere = imported("sdhj/**/*.py", "figures/**/*.py", "notebooks/course/**/*.py", "tests/**/*.py")
    for text in PROJECT["dependencies"]:
        assert Requirement(text).name in imported("sdhj/**/*.py")
    tools = {"jupyterlab", "nbval", "pytest-benchmark", "pytest-xdist"}  # used without an import
    tools |= {"myst-nb", "pydata-sphinx-theme", "sphinx", "sphinx-mathjax-offline"}  # named in notebooks/site/conf.py
    tools |= {"dask"}  # which brings distributed
    for requirement in requirements(*PROJECT["optional-dependencies"]):
        assert requirement.name.replace("-", "_") in everywhere or requirement.name in tools, requirement.name


def fresh(code: str) -> subprocess.CompletedProcess[str]:
    """Run lines of Python in a new process, from the root."""
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_what_an_extra_brings_is_not_imported() -> None:
    """A robot needs neither pictures nor Jupyter."""
    run = fresh("import sys, sdhj; print(*sys.modules); import sdhj.plotting; print(*sys.modules)")
    modules, with_plotting = (set(line.split()) for line in run.stdout.splitlines())
    assert "sdhj.solver.recursion" in modules, run.stderr
    assert not modules & {"sdhj.plotting", "sdhj.simulation.environment"}
    assert not modules & {"IPython", "PIL", "dask", "gymnasium", "ipywidgets", "matplotlib"}
    assert not modules & {"scipy.ndimage", "scipy.optimize", "shapely"}
    assert "matplotlib" in with_plotting and "matplotlib.pyplot" not in with_plotting


# First the command line, which needs no pictures, and says in a line what is wrong.
MISSING = """
import sys
for absent in ("matplotlib", "scipy", "shapely"):
    sys.modules[absent] = None
from sdhj.cli import main
main(["--help"], standalone_mode=False)
try:
    main(["verify", "missing.npz"])
except SystemExit as ended:
    print("status", ended.code)
for absent in ("matplotlib", "scipy", "shapely"):
    del sys.modules[absent]
import numpy as np, sdhj
for missing, line in [
    ("matplotlib", "import sdhj.plotting"),
    ("shapely", "from sdhj.arm.workspace import Arm; Arm().outline([0.0, 0.0])"),
    ("gymnasium", "import sdhj.simulation.environment"),
    ("scipy", "sdhj.UnsafeSet.from_map(np.zeros((3, 3), bool), resolution=1.0)"),
    ("yaml", "sdhj.UnsafeSet.from_map('map.yaml')"),
    ("shapely", "sdhj.UnsafeSet.polygon([[0, 0], [1, 0], [0, 1]])"),
]:
    sys.modules[missing] = None
    try:
        exec(line)
    except ImportError as error:
        print(error)
    del sys.modules[missing]
"""


@pytest.mark.slow
def test_a_missing_extra_is_named() -> None:
    run = fresh(MISSING)
    command, _, rest = run.stdout.partition("status 2\n")
    assert "Commands:" in command and "missing.npz" in run.stderr and "Traceback" not in run.stderr
    told, extras = rest.splitlines(), ("plot", "plot", "gym", "maps", "maps", "maps")
    assert len(told) == len(extras), run.stderr
    assert all(f"sdhj[{extra}]" in line for extra, line in zip(extras, told, strict=True))


def test_citation_changelog_and_contributing_have_the_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (\S+)$", citation, re.MULTILINE) == [sdhj.__version__]
    assert f"git tag v{sdhj.__version__} &&" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    changes = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert changes[0] == sdhj.__version__


@pytest.mark.slow
def test_what_would_be_published_runs_the_readmes_car(tmp_path: Path) -> None:
    tracked_files()  # skips where there is nothing to clone
    done = subprocess.run([ROOT / ".ci" / "package", tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    built = {path.name for path in tmp_path.iterdir()}
    assert built == {f"sdhj-{sdhj.__version__}.tar.gz", f"sdhj-{sdhj.__version__}-py3-none-any.whl"}
    assert all(f"{name}: passed" in done.stdout for name in built)


@pytest.mark.slow
def test_no_file_names_a_place_on_one_machine() -> None:
    found = []
    for path in tracked_files():
        data = (ROOT / path).read_bytes() if (ROOT / path).is_file() else b""
        if b"\0" in data:  # not text
            continue
        for number, line in enumerate(data.decode("utf-8").splitlines(), start=1):
            if MACHINE_PATH.search(line) or f"{ROOT}/" in line:
                found.append(f"{path}:{number}: {line.strip()[:100]}")
    assert found == []
