"""The README's two commands and its Python, and that what it names is there."""

import re
import runpy
import shlex
from pathlib import Path
from typing import Any

import pytest

from sdhj.cli import main

ROOT = Path(__file__).parent.parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
VENV = [["python", "-m", "venv", ".venv"], [".", ".venv/bin/activate"]]

command = runpy.run_path(str(ROOT / ".ci" / "readme_command.py"))["readme_command"]


def parts(mark: str) -> list[list[str]]:
    return [shlex.split(part) for part in command(TEXT, mark).split(" && ")]


def test_the_main_job() -> None:
    assert parts("main job") == [*VENV, ["pip", "install", ".[plot]"], ["python", "figures/reproduce.py"]]


def test_the_tests() -> None:
    assert parts("tests") == [*VENV, ["pip", "install", "-e", ".[test]"], ["pytest"]]


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
    with pytest.raises(ValueError, match=said):
        command(text, "tests")


def test_files_that_are_named_are_there() -> None:
    """Links, pictures, scripts, and the modules of the table of the core: all of them, and no other."""
    targets = re.findall(r"\]\(([^)#:]+)\)", TEXT) + re.findall(r'src="([^"]+)"', TEXT)
    targets += re.findall(r"python (\S+\.py)", TEXT)
    assert len(targets) > 30
    assert [target for target in targets if not (ROOT / target).exists()] == []
    table = TEXT[TEXT.index("| core |") : TEXT.index("| around it |")]
    core = {path.name for path in (ROOT / "sdhj").glob("*.py")} - {"__init__.py", "__main__.py", "cli.py"}
    assert set(re.findall(r"`(\w+\.py)`", table)) == core


def test_commands_that_are_named_are_there() -> None:
    named = set(re.findall(r"`sdhj\s+([a-z]+)", TEXT))
    listed = re.search(r"lists the commands: ([^.]+)\.", TEXT)
    assert listed is not None
    assert set(re.findall(r"`(\w+)`", listed[1])) == set(main.commands) >= named


@pytest.mark.slow
def test_the_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The paper's arm, and a car that the second block drives into its target."""
    monkeypatch.chdir(tmp_path)
    arm, car = re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    exec(arm, {})
    assert "10000 runs, hji table, adversary worst" in capsys.readouterr().out
    assert (tmp_path / "arm.h5").is_file()
    names: dict[str, Any] = {}
    exec(car, names)
    lost = re.search(r"collided +(\d+)", capsys.readouterr().out)
    assert lost is not None and int(lost[1]) < 100
    assert names["problem"].target_value(names["q"][None], 0.0)[0] <= 0 and 0 < names["step"] < 8
