"""Exercises that answer: a check tells right from wrong and says what to look at.

A chapter's checks stand in `checks_NN.py`, one function for each exercise, decorated with its number:

    @exercise("1.1")
    def check_ring(ring):
        x, y = ...
        expect_close(ring(x, y), ..., "between the two circles: is the inside of the ring negative?")

In the notebook a stub is filled in by the reader and handed to the check on the last line of its cell:

    def ring(x, y):
        ...


    check_ring(ring)

It answers "not answered yet", "right", or what to look at; it never raises, so an unfinished notebook runs through.
Solutions stand in `solutions/solution_NN.py`: RIGHT maps each check to an answer it must accept, WRONG to answers it
must refuse. The tests play both.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import update_wrapper
from typing import Any

import numpy as np

STATES = ("right", "not yet", "not answered yet")


class Unanswered(Exception):
    """The reader has not touched the stub: `...`, or a function that returns nothing."""


class Wrong(Exception):
    """The answer is wrong; the message says what to look at."""


@dataclass(frozen=True)
class Verdict:
    """What a check says; true where the answer is right."""

    number: str
    state: str
    hint: str = ""

    def __bool__(self) -> bool:
        return self.state == "right"

    def __str__(self) -> str:
        said = f"Exercise {self.number}: {self.state}."
        return f"{said} {self.hint}" if self.hint else said

    def _ipython_display_(self) -> None:
        print(self)


class Check:
    """A check as the reader calls it: with an answer, or several, and a `Verdict` comes back."""

    def __init__(self, number: str, judge: Callable[..., str | None]) -> None:
        update_wrapper(self, judge)
        self.number, self.judge = number, judge

    def __call__(self, *answers: Any) -> Verdict:
        try:
            return Verdict(self.number, "right", self.judge(*(_asked(answer) for answer in answers)) or "")
        except Unanswered:
            return Verdict(self.number, "not answered yet")
        except Wrong as wrong:
            return Verdict(self.number, "not yet", f"Look at this: {wrong}")
        except Exception as error:  # whatever the reader's code does: it is told, and the notebook goes on
            return Verdict(self.number, "not yet", f"Your code raised {type(error).__name__}: {error}")

    def __repr__(self) -> str:
        return f"<check of exercise {self.number}>"


def exercise(number: str) -> Callable[[Callable[..., str | None]], Check]:
    """Make a function of the reader's answers a check; what it returns is said after "right"."""
    return lambda judge: Check(number, judge)


def _asked(answer: Any) -> Any:
    """The answer; a function is watched for returning nothing."""
    if answer is ...:
        raise Unanswered
    if not callable(answer) or isinstance(answer, type):
        return answer

    def watched(*args: Any, **kwargs: Any) -> Any:
        if (value := answer(*args, **kwargs)) is None or value is ...:
            raise Unanswered
        return value

    return update_wrapper(watched, answer)  # a check that compiles needs the function itself, `__wrapped__`


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
