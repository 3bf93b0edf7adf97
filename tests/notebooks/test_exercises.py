"""The exercises: each check accepts its solution, refuses wrong answers with a word, and stands in its chapter once."""

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from course import exercises
from course.exercises import Check, exercise, expect, expect_close

pytestmark = pytest.mark.slow  # what a reader is asked to compute takes a while
NOTEBOOKS = Path(__file__).parent.parent.parent / "notebooks"
CHAPTERS = sorted(NOTEBOOKS.glob("[0-9][0-9]_*.ipynb"))


def checks(chapter: str) -> list[Check]:
    module = importlib.import_module(f"course.chapter_{chapter}")
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
        assert verdict.hint and "Your code raised" not in verdict.hint, str(verdict)


@pytest.mark.parametrize(("chapter", "number"), [("13", "13.3"), ("14", "14.5"), ("16", "16.3")])
def test_the_right_number_in_floating_point_is_told_to_be_a_fraction(chapter: str, number: str) -> None:
    [(check, right)] = [(check, right) for check, right in answers(chapter, "RIGHT").items() if check.number == number]

    def rounded(*given: Any) -> Any:
        found = right(*given)
        return [(float(low), float(high)) for low, high in found] if isinstance(found, list) else float(found)

    verdict = check(rounded)
    assert verdict.state == "not yet" and "Fraction" in verdict.hint, str(verdict)


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_every_exercise_stands_in_its_chapter_and_is_not_answered_there(path: Path) -> None:
    known = checks(path.name[:2])
    assert known and [check.number for check in known] == [
        f"{int(path.name[:2])}.{n}" for n in range(1, len(known) + 1)
    ]
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    for check in known:
        asked = [cell for cell in cells if re.search(rf"^{check.__name__}\(", cell.source, re.MULTILINE)]
        assert len(asked) == 1, f"{check.__name__} is asked in {len(asked)} cells of {path.name}"
        said = "".join(output.get("text", "") for output in asked[0].outputs)
        assert said == f"Exercise {check.number}: not answered yet.\n", f"{path.name} says: {said}"
    prose = "\n".join(cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "markdown")
    assert f"(solutions/solution_{path.name[:2]}.py)" in prose
    posed = dict(re.findall(r"^\*\*(\d+\.\d+) (.*?)(?=^\*\*\d+\.\d+ |\Z)", prose, re.MULTILINE | re.DOTALL))
    for check in known:  # one hint, below its check, or in its text where it needs a formula
        assert posed[check.number].count("<summary>Hint</summary>") + bool(check.help) == 1, check.number


# ---- the mechanism itself


@exercise("0.2")
def check_pair(number: Any, function: Any) -> None:
    """Three, and a function that keeps it."""
    expect(number == function(number) == 3, "three.")


@exercise("0.1", "Add it <to itself>.")
def check_double(double: Any) -> str:
    """Twice a number."""
    expect_close(double(np.array([1.0, 2.0])), [2.0, 4.0], "twice the number.")
    expect(double(0) == 0, "zero.")
    return "And quickly."


def test_a_check_tells_right_from_wrong() -> None:
    assert str(check_double(lambda x: 2 * x)) == "Exercise 0.1: right. And quickly."
    assert bool(check_double(lambda x: 2 * x)) and not bool(check_double(lambda x: x))
    assert "twice the number. (Off" in str(check_double(lambda x: x))
    assert "is (1,), and should" in str(check_double(lambda x: x[:1]))
    assert "Look at this: zero" in str(check_double(lambda x: 2 * x if np.ndim(x) else 1))
    assert not check_double(lambda x: x * np.nan)


def test_a_check_never_raises() -> None:
    assert "Your code raised ZeroDivisionError" in str(check_double(lambda x: 1 / 0))
    assert check_double(3).state == "not yet"
    assert check_double().state == "not yet"


def stub(x: Any) -> Any:
    """What the exercise asks for."""
    ...  # here


@pytest.mark.parametrize("untouched", [..., (..., ...), lambda x: None, lambda x: ..., stub])
def test_a_stub_is_not_answered(untouched: Any) -> None:
    verdict = check_double(untouched)
    assert verdict.state == "not answered yet" and not verdict
    assert verdict.state in exercises.STATES


def test_a_forgotten_return_is_told() -> None:
    def double(x: Any) -> None:
        x = 2 * x

    assert "end and returned nothing" in str(check_double(double))


def test_half_an_answer_is_told() -> None:
    assert check_pair(..., stub).state == "not answered yet"
    assert "answered: `stub` is still" in str(check_pair(3, stub))
    assert "is answered: part 2" in str(check_pair((3, ...), lambda x: x))
    assert "half an answer" in str(check_pair(3, lambda x: (x, None)))
    assert check_pair(3, lambda x: x)


def test_an_error_comes_with_the_readers_line() -> None:
    def deeper(x: Any) -> Any:
        return x + missing  # noqa: F821

    def double(x: Any) -> Any:
        return np.asarray(deeper(x))

    line = deeper.__code__.co_firstlineno + 1
    said = str(check_double(double))
    assert f"NameError: name 'missing' is not defined (line {line}: return x + missing" in said
    inside = str(check_double(lambda x: np.linalg.inv(x)))  # raised by NumPy, called by the reader
    assert "LinAlgError" in inside and "check_double(lambda x: np.linalg.inv(x))" in inside


def shown(verdict: Any, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is displayed beside the words."""
    found: list[Any] = []
    monkeypatch.setattr(exercises, "display", lambda thing, **_: found.append(thing))
    verdict._ipython_display_()
    return found


def test_the_hint_is_folded_until_the_answer_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    for answer in (..., lambda x: x):
        (folded,) = shown(check_double(answer), monkeypatch)
        assert folded["text/html"] == "<details><summary>Hint</summary>Add it &lt;to itself&gt;.</details>"
        assert "itself" not in folded["text/plain"]
    assert shown(check_double(lambda x: 2 * x), monkeypatch) == []


def test_a_verdict_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    check_pair(..., ...)._ipython_display_()  # an exercise without a hint
    assert capsys.readouterr().out == "Exercise 0.2: not answered yet.\n"
    assert repr(check_double) == "<check of exercise 0.1>" and check_double.__doc__ == "Twice a number."
