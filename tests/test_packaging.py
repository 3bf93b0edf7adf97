"""The frame around the library: version, metadata, the README's commands, and what every file must not name."""

import ast
import importlib.metadata
import os
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
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

TOP_LEVEL = {
    ".ci",
    ".gitignore",
    ".pre-commit-config.yaml",
    "LICENSE",
    "README.md",
    "environment.txt",
    "figures",
    "notebooks",
    "pyproject.toml",
    "sdhj",
    "tests",
}


def tracked_files() -> list[Path]:
    """Files that git tracks here, relative to the root; skips where this is no git checkout."""
    result = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if result.returncode != 0:
        pytest.skip("not a git checkout")
    return [Path(name) for name in result.stdout.split("\0") if name]


def readme_command(mark: str) -> str:
    extract = runpy.run_path(str(ROOT / ".ci" / "readme_command.py"))["readme_command"]
    command: str = extract((ROOT / "README.md").read_text(encoding="utf-8"), mark)
    return command


def pinned() -> dict[str, str]:
    """Name (normalised) to version of each line of environment.txt."""
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in pairs}


def source_version() -> str:
    for node in ast.parse((ROOT / "sdhj" / "__init__.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__version__":
            version: str = ast.literal_eval(node.value)
            return version
    raise AssertionError("sdhj/__init__.py has no __version__ = ...")


def test_version_is_the_same_everywhere() -> None:
    assert sdhj.__version__ == source_version()
    assert re.fullmatch(r"\d+\.\d+\.\d+", sdhj.__version__)
    try:
        installed = importlib.metadata.version("sdhj")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("sdhj is not installed, only on the path")
    assert installed == sdhj.__version__


def test_readme_main_job() -> None:
    parts = [shlex.split(part) for part in readme_command("main job").split(" && ")]
    assert parts[0][:2] == ["git", "clone"]
    assert parts[1] == ["cd", "sdhj"]
    assert parts[-2:] == [["pip", "install", "."], ["sdhj", "reproduce"]]


def test_readme_tests() -> None:
    parts = [shlex.split(part) for part in readme_command("tests").split(" && ")]
    assert parts[0] == ["python", "-m", "venv", ".venv"]
    assert ["pip", "install", "-e", ".[test]"] in parts
    assert parts[-1] == ["pytest"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no block at all", "found 0"),
        ("<!-- tests -->\n\n```bash\npytest\n```\n", "found 0"),
        ("<!-- tests -->\n```bash\npytest\n```\n" * 2, "found 2"),
        ("<!-- tests -->\n```bash\npytest\npytest\n```\n", "one line"),
        ("<!-- tests -->\n```bash\n\n```\n", "one line"),
    ],
)
def test_a_readme_without_its_command_is_refused(text: str, said: str) -> None:
    extract = runpy.run_path(str(ROOT / ".ci" / "readme_command.py"))["readme_command"]
    with pytest.raises(ValueError, match=said):
        extract(text, "tests")


def main_job_faults(results: Path, environment: Path) -> list[str]:
    found: list[str] = runpy.run_path(str(ROOT / ".ci" / "check_main_job.py"))["faults"](results, environment)
    return found


@pytest.fixture
def main_job(tmp_path: Path) -> tuple[Path, Path]:
    """What a good main job leaves, made by hand: a folder of results and an environment with sdhj in it."""
    results, environment = tmp_path / "results", tmp_path / "venv"
    site = environment / "lib" / "python3.11" / "site-packages"
    for folder in (results, site / "sdhj", site / "sdhj-0.1.0.dist-info"):
        folder.mkdir(parents=True)
    (environment / "pyvenv.cfg").write_text("")
    (site / "sdhj" / "grid.py").write_text("")
    record = "../../../bin/sdhj,sha256=x,1\nsdhj/grid.py,sha256=x,0\nsdhj-0.1.0.dist-info/RECORD,,\n"
    (site / "sdhj-0.1.0.dist-info" / "RECORD").write_text(record)
    (results / "fig10.png").write_bytes(b"picture")
    (results / "results.csv").write_text("table")
    return results, environment


def test_a_good_main_job_passes(main_job: tuple[Path, Path]) -> None:
    assert main_job_faults(*main_job) == []


def test_a_bad_main_job_is_found(main_job: tuple[Path, Path]) -> None:
    results, environment = main_job
    (results / "fig10.png").rename(results / "fig10.txt")
    (results / "results.csv").write_text("")
    site = environment / "lib" / "python3.11" / "site-packages"
    with (site / "sdhj-0.1.0.dist-info" / "RECORD").open("a") as record:
        record.write("tests/conftest.py,sha256=x,0\n")
    (site / "tests").mkdir()
    (site / "tests" / "conftest.py").write_text("")
    os.utime(site / "sdhj" / "grid.py", (0, 0))
    found = "\n".join(main_job_faults(results, environment))
    for said in ("no figure", "results.csv is empty", "has tests beside the package", "grid.py is older"):
        assert said in found
    assert len(found.splitlines()) == 4
    assert main_job_faults(results / "absent", environment / "absent")[0].startswith("no figure")


def test_pins_satisfy_the_requirements() -> None:
    versions = pinned()
    extras = PROJECT["optional-dependencies"]
    for text in PROJECT["dependencies"] + extras["test"] + extras["lint"]:
        requirement = Requirement(text)
        assert requirement.name in versions, f"environment.txt lacks {requirement.name}; run .ci/pin"
        assert requirement.specifier.contains(versions[requirement.name]), f"{text}: run .ci/pin"


@pytest.mark.slow
def test_the_python_of_the_readme_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The paper's arm, and a car that the second block drives into its target."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    arm, car = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    exec(arm, {})
    assert "10000 runs, hji table, adversary worst" in capsys.readouterr().out
    assert (tmp_path / "arm.h5").is_file()
    names: dict[str, Any] = {}
    exec(car, names)
    lost = re.search(r"collided +(\d+)", capsys.readouterr().out)
    assert lost is not None and int(lost[1]) < 100
    assert names["problem"].target_value(names["q"][None], 0.0)[0] <= 0 and 0 < names["step"] < 8


def test_imports_are_declared() -> None:
    """Every third-party module that the package imports is a dependency or belongs to an extra."""
    texts = PROJECT["dependencies"] + [r for extra in PROJECT["optional-dependencies"].values() for r in extra]
    declared = {Requirement(text).name.replace("-", "_").lower() for text in texts}
    declared |= {"sdhj", "ipython", "traitlets", "mpl_toolkits"}  # the last three come with ipywidgets and matplotlib
    for path in sorted((ROOT / "sdhj").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module or ""]
            for top in {name.split(".")[0] for name in names} - set(sys.stdlib_module_names):
                assert top.lower() in declared, f"{path.name} imports {top}, which pyproject.toml does not list"


def test_top_level_holds_what_it_should() -> None:
    assert {path.parts[0] for path in tracked_files()} <= TOP_LEVEL


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


@pytest.mark.parametrize("folder", ["home", "Users", "root", "work", "opt"])
@pytest.mark.parametrize("before", ["", " ", '"', "(", "`", "--out=", "file://"])
def test_machine_paths_are_recognised(folder: str, before: str) -> None:
    assert MACHINE_PATH.search(f"{before}/{folder}/somebody/file.txt")


@pytest.mark.parametrize("text", ["/usr/bin/env", "https://example.org/home/page", "a/work/b", "and/or", "iVBOR/opt/x"])
def test_harmless_slashes_pass(text: str) -> None:
    assert not MACHINE_PATH.search(text)
