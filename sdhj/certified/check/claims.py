"""Claims of a file, how many of them were made, checked and not proved; and the verdict."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sdhj.certified.check.intervals import Array

SHOWN = 5  # failures listed for each claim
COVER, PREDICTED, MOVES, CLEAR, ARRIVE, GROW, GOALS, NEARER = (
    "cells cover the axes",
    "predictions are as near as stated",
    "moves",
    "clear of the unsafe sets",
    "into the target itself",
    "sets grow with the steps to go",
    "in the target, and safe",
    "one step nearer",
)


@dataclass(frozen=True)
class Claim:
    """One kind of claim: how many of these a file makes, how many were checked, and which were not proved.

    failures : a text for each claim that was not proved, or for the first of `number`.
    beside : how many the file says besides, of cells of which nothing is promised; they were not looked at.
    """

    name: str
    made: int
    checked: int
    failures: Sequence[str]
    number: int | None = None
    beside: int = 0

    @property
    def failed(self) -> int:
        """The number of checked claims that were not proved."""
        return len(self.failures) if self.number is None else self.number

    def __str__(self) -> str:
        """The claim in a line, and below it the first `SHOWN` failures."""
        proved = "proved" if self.checked == self.made else "no fault in these"  # a sample proves nothing of the rest
        verdict = proved if self.failed == 0 else f"{self.failed:,} NOT proved"
        line = f"{self.name}: {self.checked:,} of {self.made:,} checked, {verdict}"
        line += f"; {self.beside:,} of cells that are not promised were not looked at" if self.beside else ""
        return "\n".join([line, *(f"    {failure}" for failure in self.failures[:SHOWN])])


class Count:
    """How many claims were made, checked, not proved, and left aside as nothing is promised of them (`beside`)."""

    def __init__(self, made: int = 0, checked: int = 0, failed: Sequence[Any] | Array = (), what: str = "") -> None:
        """Begin with these numbers; failed : the numbers of cells of which it was not proved, named behind `what`."""
        self.made, self.checked, self.beside, self.failed = made, checked, 0, len(failed)
        self.wrong = [f"{what}{cell}" for cell in failed[:SHOWN]]

    def add(self, more: "Count") -> None:
        """Add the numbers of another count."""
        self.made, self.checked = self.made + more.made, self.checked + more.checked
        self.beside, self.failed = self.beside + more.beside, self.failed + more.failed
        self.wrong = [*self.wrong, *more.wrong][:SHOWN]

    def claim(self, name: str) -> Claim:
        """The `Claim` of a name that has these numbers."""
        return Claim(name, self.made, self.checked, self.wrong, self.failed, beside=self.beside)


@dataclass(frozen=True)
class Verdict:
    """The result of `verify`: all claims of a file, with what was checked and what was not proved of each.

    problem : the problem as the checker read it, in words and formulas.
    """

    claims: tuple[Claim, ...]
    problem: str = ""

    @property
    def ok(self) -> bool:
        """Whether nothing that was checked failed; of a sample this proves nothing of the rest."""
        return all(claim.failed == 0 for claim in self.claims)

    def __str__(self) -> str:
        """The claims, one below the other."""
        return "\n".join(str(claim) for claim in self.claims)
