"""A small table with proofs, which several files ask."""

import pytest
from naive_certified import SMALL

import sdhj
from sdhj.certified import CertifiedTable


@pytest.fixture(scope="session")
def small() -> CertifiedTable:
    """The small case study on 32 x 32 x 12 x 12 cells."""
    table = sdhj.solve(sdhj.arm_case_study(**SMALL), sdhj.Certified(cells=(32, 32, 12, 12), parts=4), progress=False)
    assert isinstance(table, CertifiedTable)
    return table
