"""Parameters of tests of which some are slow."""

from collections.abc import Iterable
from typing import Any

import pytest


def but_slow(every: Iterable[Any], *slow: Any) -> list[Any]:
    """Every parameter, those in `slow` marked so; each of these must be one."""
    every = list(every)
    assert set(slow) <= set(every), f"no parameters: {set(slow) - set(every)}"
    return [pytest.param(one, marks=pytest.mark.slow) if one in slow else one for one in every]
