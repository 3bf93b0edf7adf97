"""Exercises that answer: a check tells right from wrong and says what to look at.

A chapter's checks stand in `course/chapter_NN.py`, a function for each exercise, decorated with its number and
a hint:

    @exercise("1.1", "A difference of sets is max(a, -b).")
    def check_ring(ring):
        x, y = ...
        expect_close(ring(x, y), ..., "between the two circles: is the inside of the ring negative?")

In the notebook a stub is filled in by the reader and handed to the check on the last line of its cell:

    def ring(x, y):
        ...


    check_ring(ring)

It answers "not answered yet", "right", or what to look at; it never raises, so an unfinished notebook runs through.
Until the answer is right the hint is folded below it. Not answered is what nobody has touched: half an answer, or a
function without its `return`, is told so. Solutions stand in `solutions/solution_NN.py`: RIGHT maps each check to an
answer it must accept, WRONG to answers it must refuse. The tests play both.
"""

import dis
import html
import linecache
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import update_wrapper
from pathlib import Path
from typing import Any

import numpy as np
from IPython.display import display

import sdhj

STATES = ("right", "not yet", "not answered yet")
OURS = (Path(__file__).resolve().parent, Path(sdhj.__file__).resolve().parent)  # whose lines say nothing to the reader


class Wrong(Exception):
    """The answer is wrong; the message says what to look at."""


@dataclass(frozen=True)
class Verdict:
    """What a check says; true where the answer is right. `help` is shown folded, until it is."""

    number: str
    state: str
    hint: str = ""
    help: str = ""

    def __bool__(self) -> bool:
        return self.state == "right"

    def __str__(self) -> str:
        said = f"Exercise {self.number}: {self.state}."
        return f"{said} {self.hint}" if self.hint else said

    def _ipython_display_(self) -> None:
        print(self)
        if self.help and not self:
            folded = f"<details><summary>Hint</summary>{html.escape(self.help)}</details>"
            display({"text/html": folded, "text/plain": "(A hint is folded here.)"}, raw=True)


class Check:
    """A check as the reader calls it: with an answer, or several, and a `Verdict` comes back."""

    def __init__(self, number: str, help: str, judge: Callable[..., str | None]) -> None:
        update_wrapper(self, judge)
        self.number, self.help, self.judge = number, help, judge

    def __call__(self, *answers: Any) -> Verdict:
        state, hint = self._judged(answers)
        return Verdict(self.number, state, hint, self.help)

    def _judged(self, answers: tuple[Any, ...]) -> tuple[str, str]:
        parts = [part for answer in answers for part in _parts(answer)]
        if parts and all(map(_untouched, parts)):
            return "not answered yet", ""
        if any(map(_untouched, parts)):
            names = " and ".join(_named(part, place) for place, part in enumerate(parts, 1) if _untouched(part))
            return "not yet", f"Half of it is answered: {names} is still to be done."
        try:
            return "right", self.judge(*map(_asked, answers)) or ""
        except Wrong as wrong:
            return "not yet", f"Look at this: {wrong}"
        except Exception as error:  # whatever the reader's code does: it is told, and the notebook goes on
            return "not yet", f"Your code raised {type(error).__name__}: {error}{_where(error)}"

    def __repr__(self) -> str:
        return f"<check of exercise {self.number}>"


def exercise(number: str, help: str = "") -> Callable[[Callable[..., str | None]], Check]:
    """Make a function of the reader's answers a check; what it returns is said after "right"."""
    return lambda judge: Check(number, help, judge)


def _parts(answer: Any) -> Iterator[Any]:
    """An answer, or the parts of a pair of which one is still `...`."""
    if isinstance(answer, tuple | list) and any(part is ... for part in answer):
        yield from answer
    else:
        yield answer


def _untouched(answer: Any) -> bool:
    """Whether an answer is `...`, or a function that does nothing at all but to return nothing."""
    code = getattr(answer, "__code__", None)
    if answer is ... or code is None:
        return answer is ...
    steps = [step for step in dis.get_instructions(code) if step.opname not in ("RESUME", "NOP")]
    return all(
        step.opname.startswith(("LOAD_CONST", "RETURN_")) and (step.argval is None or step.argval is ...)
        for step in steps
    )


def _named(part: Any, place: int) -> str:
    return f"`{part.__name__}`" if callable(part) else f"part {place}"


def _asked(answer: Any) -> Any:
    """The answer; a function is watched for returning nothing, or half of what it should."""
    if not callable(answer) or isinstance(answer, type):
        return answer

    def watched(*args: Any, **kwargs: Any) -> Any:
        value = answer(*args, **kwargs)
        if value is None or value is ...:
            raise Wrong(f"`{answer.__name__}` came to its end and returned nothing: is a `return` missing?")
        if isinstance(value, tuple) and any(part is None or part is ... for part in value):
            raise Wrong(f"`{answer.__name__}` returned half an answer: a part of what it returns is nothing.")
        return value

    return update_wrapper(watched, answer)  # a check that compiles needs the function itself, `__wrapped__`


def _where(error: BaseException) -> str:
    """The last line of the reader's own code that an error came through."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        if not {*OURS} & {*file.parents} and "site-packages" not in file.parts:
            line = linecache.getline(frame.filename, frame.lineno or 0).strip()
            return f" (line {frame.lineno}: {line})" if line else f" (line {frame.lineno})"
    return ""


def expect(condition: Any, look_at: str) -> None:
    """Refuse the answer unless the condition holds everywhere; `look_at` says what to look at."""
    if not np.all(condition):
        raise Wrong(look_at)


def expect_close(got: Any, wanted: Any, look_at: str, within: float = 1e-9) -> None:
    """Refuse an answer that is not the wanted number or array, up to `within`; shapes are told apart first."""
    got, wanted = np.asarray(got, dtype=np.float64), np.asarray(wanted, dtype=np.float64)
    if got.shape != wanted.shape:
        raise Wrong(f"{look_at} (The shape is {got.shape}, and should be {wanted.shape}.)")
    off = np.abs(got - wanted)
    expect(off <= within, f"{look_at} (Off by up to {np.max(off, initial=0.0):.3g}.)")
