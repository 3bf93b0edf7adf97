"""Every mutant of every solution is refused by its check in words, or is the same answer."""

from collections import Counter

import pytest
from solution_mutants import EQUIVALENT, NOTEBOOKS, Mutant, alike, mutants, played, why_same

CHAPTERS = sorted(path.stem[-2:] for path in (NOTEBOOKS / "solutions").glob("solution_*.py"))
QUICK = ("1.1", "1.2", "2.1", "2.3", "3.2", "3.4", "5.1", "5.3", "7.1", "10.1", "13.1", "13.3", "14.3", "15.4", "16.2")


def judge(mutant: Mutant) -> str:
    """What became of a mutant; fails where it was accepted and is not the same answer."""
    state, said = played(mutant)
    name = f"{mutant.number}: {mutant.what}"
    if why_same(mutant):
        assert state == "accepted", f"{name} is refused, so it is not the same: {said}"
        assert alike(mutant), f"{name} answers otherwise than the solution"
        return "the same"
    assert state != "accepted", f"{name} is accepted: {said}"
    raised = "Error: " in said  # by Python, before the check was asked
    assert state == "endless" or raised or len(said) > 40, f"{name} is refused without a word: {said}"
    return state


@pytest.mark.campaign
@pytest.mark.parametrize("chapter", CHAPTERS)
def test_every_mutant_of_a_solution_is_refused_or_is_the_same(chapter: str) -> None:
    found = Counter((mutant.number, judge(mutant)) for mutant in mutants(chapter))
    for number in {number for number, _ in found}:
        assert found[number, "refused"] >= 2, f"{number} has hardly a mutant that is refused"


@pytest.mark.slow
def test_a_sample_of_mutants_is_refused_or_is_the_same() -> None:
    """What takes no solve, every tenth."""
    chapters = sorted({f"{int(number.split('.')[0]):02d}" for number in QUICK})
    chosen = [mutant for chapter in chapters for mutant in mutants(chapter) if mutant.number in QUICK][::10]
    assert len(chosen) >= 30
    assert Counter(map(judge, chosen))["refused"] >= 20


@pytest.mark.campaign
def test_what_is_listed_as_the_same_is_a_mutant() -> None:
    known = {(mutant.number, why_same(mutant)) for chapter in CHAPTERS for mutant in mutants(chapter)}
    listed = {(number, reason) for number, of in EQUIVALENT.items() for reason in of.values()}
    assert listed <= known
    assert all(reason for _, reason in listed)
