"""What tables answer is what it was: see `record_digests`."""

import pytest
from digest_cases import CASES
from record_digests import differences, far, machine, measured, recorded

RECORDED = recorded()


@pytest.mark.campaign
@pytest.mark.parametrize("name", CASES)
def test_nothing_has_changed(name):
    """On the machine of the record to the last bit, on another one but for rounding."""
    compared = differences if RECORDED["machine"] == machine() else far
    assert compared(name, RECORDED["cases"][name], measured(CASES[name])) == []


def test_every_record_has_its_case():
    assert list(RECORDED["cases"]) == list(CASES)
