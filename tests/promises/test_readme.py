"""The README's two commands and its Python, and that what it names is there."""

import re
import runpy
import shlex
from pathlib import Path
from typing import Any

import pytest
from documents import ROOT, blocks, named_files

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
        ("<!-- tests -->\n\n```bash\npytest\n```\n", "found 0"),
        ("<!-- tests -->\n```bash\npytest\n```\n" * 2, "found 2"),
        ("<!-- tests -->\n```bash\npytest\npytest\n```\n", "one line"),
    ],
)
def test_a_readme_without_its_command_is_refused(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        command(text, "tests")


def test_files_that_are_named_are_there() -> None:
    assert len(named_files(ROOT / "README.md")) > 20
    missing = [path for path in named_files(ROOT / "README.md") if not path.exists()]
    assert [path for path in missing if path.name != "car.py"] == []  # which the reader saves


def test_the_checker_is_as_long_as_it_says() -> None:
    """Of all robots but the paper's arm."""
    said = re.search(r"some ([\d,]+) lines of NumPy", " ".join(TEXT.split()))
    files = [*(ROOT / "sdhj" / "certified" / "check").glob("*.py")]
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)
    assert said and abs(int(said[1].replace(",", "")) - lines) < 100


def test_the_first_screen_has_the_robot_of_a_user_before_the_papers() -> None:
    """A picture, a program whose loop asks for inputs, what it prints, how to install it, and what to use when."""
    order = [
        "![",
        "```python",
        "controller.step(",
        "```text",
        "certified",
        "- **",
        "pip install",
        "| what you want",
        "paper's arm",
    ]
    places = [TEXT.index(order[0])]
    for part in order[1:]:
        places.append(TEXT.index(part, places[-1]))
    assert TEXT[: places[-1]].count("\n") < 115


def shape_of(text: str) -> list[str]:
    """Lines without their numbers, which differ in their last digits between machines."""
    return [re.sub(r"[\d.%]+", "#", " ".join(line.split())) for line in text.splitlines()]


def printed_below(heading: str) -> str:
    """What the first program below a heading prints, as README shows it."""
    shown = re.search(r"^```text\n(.*?)^```$", TEXT[TEXT.index(heading) :], re.MULTILINE | re.DOTALL)
    assert shown is not None
    return shown[1]


@pytest.mark.slow
def test_the_arm_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (arm,) = blocks(ROOT / "README.md", "## The paper's arm")
    exec(arm, {})
    said = capsys.readouterr().out
    shown = printed_below("## The paper's arm")
    assert shape_of(said) == shape_of(shown)
    assert said.splitlines()[:3] == shown.splitlines()[:3]
    assert (tmp_path / "arm.npz").is_file()


@pytest.mark.slow
def test_the_car_arrives(capsys: pytest.CaptureFixture[str]) -> None:
    (car,) = blocks(ROOT / "README.md", "## Your robot")
    names: dict[str, Any] = {}
    exec(car, names)
    said, shown = capsys.readouterr().out, printed_below("## Your robot")
    assert shape_of(said) == shape_of(shown)
    for line, other in zip(said.splitlines()[:2], shown.splitlines()[:2], strict=True):
        (share, lost), wanted = (list(map(float, re.findall(r"([\d.]+)%", each))) for each in (line, other))
        assert (share, lost) == pytest.approx(wanted, abs=0.3)
    assert lost == 0.0 and said.splitlines()[2:] == shown.splitlines()[2:]
    assert names["problem"].target_value(names["q"][None], 0.0)[0] <= 0 and 0 < names["step"] < 8
