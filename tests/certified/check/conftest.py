"""What the checker reads of the small case study."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from naive_certified import CIRCLE, LINE, SMALL, STILL, sensing
from plain import run_plainly

import sdhj
from sdhj.certified.check.arm.claims import Scene
from sdhj.certified.check.arm.separation import World


@pytest.fixture
def checked_plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """The checker as the plain Python that it is: to compile it takes half a minute, which `test_claims` waits for."""
    run_plainly(monkeypatch, "sdhj.certified.check")


@pytest.fixture
def arm_world() -> Callable[..., World]:
    """The numbers of the small case study with three obstacles; other edges of cells, other arguments."""

    def world(edges: Any = None, **changes: Any) -> World:
        recipe = sdhj.arm_case_study(**(SMALL | {"obstacles": [STILL, LINE, CIRCLE]} | changes)).recipe
        return Scene(recipe, sensing()).world((np.linspace(-1, 1, 9),) * 4 if edges is None else tuple(edges))

    return world


@pytest.fixture
def recipe() -> Any:
    """How the small case study is made, a copy that a test may change."""
    made = sdhj.arm_case_study(**SMALL).recipe
    return {name: dict(one) if isinstance(one, dict) else one for name, one in made.items()}
