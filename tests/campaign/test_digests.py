"""What tables answer is what it was: see `record_digests`."""

import pytest
from digest_cases import CASES
from record_digests import differences, far, largest_change, machine, measured, recorded

RECORDED = recorded()


@pytest.mark.campaign
@pytest.mark.parametrize("name", CASES)
def test_nothing_has_changed(name):
    """On the machine of the record to the last bit, on another one but for rounding."""
    compared = differences if RECORDED["machine"] == machine() else far
    assert compared(name, RECORDED["cases"][name], measured(CASES[name])) == []


def test_every_record_has_its_case():
    assert list(RECORDED["cases"]) == list(CASES)


def test_what_changes_is_told():
    before = RECORDED["cases"]["line"]
    assert differences("line", before, before) == far("line", before, before) == []
    numbers = before["numbers"] | {"sum": before["numbers"]["sum"] * (1 + 1e-6)}
    (line,) = differences("line", before, before | {"values": "0", "numbers": numbers})
    assert line == "line: values changed; of their plain numbers most the sum, by 1e-06 of it"
    assert far("line", before, before | {"values": "0", "numbers": numbers}) == []
    assert "by 1e-06" in differences("line", before, before | {"numbers": numbers})[0]
    (line,) = differences("line", before, before | {"held": [1, 2], "inputs": before["inputs"]})
    assert line.startswith("line: held changed from [") and line.endswith("to [1, 2]")
    larger = before["numbers"] | {"most": before["numbers"]["most"] + 1.0}
    assert "most of the values changed by" in far("line", before, before | {"numbers": larger})[0]
    assert largest_change(before["numbers"], {}) == (float("inf"), f"there are others: {', '.join(sorted(numbers))}")
