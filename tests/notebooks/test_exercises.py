"""The exercises: each check accepts its solution, refuses wrong answers with a word, and stands in its chapter once."""

import importlib
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import exercises
import nbformat
import numpy as np
import pytest
from exercises import Check, exercise, expect, expect_close

pytestmark = pytest.mark.slow  # what a reader is asked to compute takes a while
NOTEBOOKS = Path(__file__).parent.parent.parent / "notebooks"
CHAPTERS = [
    path for path in sorted(NOTEBOOKS.glob("[0-9][0-9]_*.ipynb")) if (NOTEBOOKS / f"checks_{path.name[:2]}.py").exists()
]
FEWEST = 4  # exercises in a chapter


def checks(chapter: str) -> list[Check]:
    module = importlib.import_module(f"checks_{chapter}")
    return [value for value in vars(module).values() if isinstance(value, Check)]


def answers(chapter: str, kind: str) -> dict[Check, Any]:
    return importlib.import_module(f"solutions.solution_{chapter}").__dict__[kind]


def given(answer: Any) -> tuple[Any, ...]:
    return answer if isinstance(answer, tuple) else (answer,)


def every_check() -> Iterator[Any]:
    for path in CHAPTERS:
        for check in checks(path.name[:2]):
            yield pytest.param(path.name[:2], check, id=check.number)


@pytest.mark.parametrize(("chapter", "check"), list(every_check()))
def test_the_solution_is_right(chapter: str, check: Check) -> None:
    verdict = check(*given(answers(chapter, "RIGHT")[check]))
    assert verdict, str(verdict)


@pytest.mark.parametrize(("chapter", "check"), list(every_check()))
def test_wrong_answers_are_refused_with_a_word(chapter: str, check: Check) -> None:
    wrong = answers(chapter, "WRONG")[check]
    assert len(wrong) >= 1
    for number, answer in enumerate(wrong, 1):
        verdict = check(*given(answer))
        assert verdict.state == "not yet", f"wrong answer {number} to {check.number}: {verdict}"
        assert len(verdict.hint) > 20 and "Your code raised" not in verdict.hint, str(verdict)


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_every_exercise_stands_in_its_chapter_and_is_not_answered_there(path: Path) -> None:
    known = checks(path.name[:2])
    assert len(known) >= FEWEST
    assert [check.number for check in known] == [f"{int(path.name[:2])}.{n}" for n in range(1, len(known) + 1)]
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    for check in known:
        asked = [cell for cell in cells if re.search(rf"^{check.__name__}\(", cell.source, re.MULTILINE)]
        assert len(asked) == 1, f"{check.__name__} is asked in {len(asked)} cells of {path.name}"
        said = "".join(output.get("text", "") for output in asked[0].outputs)
        assert said == f"Exercise {check.number}: not answered yet.\n", f"{path.name} says: {said}"
    prose = "\n".join(cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "markdown")
    assert f"(solutions/solution_{path.name[:2]}.py)" in prose
    for check in known:
        assert f"**{check.number}" in prose, f"{path.name} does not pose exercise {check.number}"


# ---- the mechanism itself


@exercise("0.1")
def check_double(double: Any) -> str:
    """Twice a number."""
    expect_close(double(np.array([1.0, 2.0])), [2.0, 4.0], "twice the number.")
    expect(double(0) == 0, "zero.")
    return "And quickly."


def test_a_check_tells_right_from_wrong() -> None:
    assert str(check_double(lambda x: 2 * x)) == "Exercise 0.1: right. And quickly."
    assert bool(check_double(lambda x: 2 * x)) and not bool(check_double(lambda x: x))
    assert "Look at this: twice the number. (Off by up to 2.)" in str(check_double(lambda x: x))
    assert "The shape is (1,), and should be (2,)" in str(check_double(lambda x: x[:1]))
    assert "Look at this: zero" in str(check_double(lambda x: 2 * x if np.ndim(x) else 1))
    assert not check_double(lambda x: x * np.nan)


def test_a_check_never_raises() -> None:
    assert "Your code raised ZeroDivisionError" in str(check_double(lambda x: 1 / 0))
    assert check_double(3).state == "not yet"
    assert check_double().state == "not yet"


@pytest.mark.parametrize("stub", [..., lambda x: None, lambda x: ...], ids=["dots", "none", "returns-dots"])
def test_a_stub_is_not_answered(stub: Any) -> None:
    verdict = check_double(stub)
    assert verdict.state == "not answered yet" and not verdict
    assert verdict.state in exercises.STATES


def test_a_verdict_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    check_double(...)._ipython_display_()
    assert capsys.readouterr().out == "Exercise 0.1: not answered yet.\n"
    assert repr(check_double) == "<check of exercise 0.1>" and check_double.__doc__ == "Twice a number."


def test_solutions_do_not_import_tests() -> None:
    for path in sorted((NOTEBOOKS / "solutions").glob("*.py")):
        assert set(runpy.run_path(str(path))) >= {"RIGHT", "WRONG"}
