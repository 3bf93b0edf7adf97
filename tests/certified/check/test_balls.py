"""Arb's second opinion on the bounds that the checker works out: it finds whatever is not in them."""

import flint
import numpy as np
import pytest
from forged_robots import save

from sdhj.certified.check import balls, formulas, intervals, verify
from sdhj.certified.check.formulas import Formula, Node

SECOND = "bounds hold where Arb's arithmetic looks"
TABLE = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 5))


def formula(op):
    """An operation of two coordinates, or of truths about them."""
    leaves = (Node("x", (), (0,)), Node("x", (), (1,)), Node("less", (0, 1)), Node("const", (), (0.3,)))
    if op == "gridded":
        node = Node(op, (0, 1), (TABLE, [0.05, 0.1], [0.2, 0.3], {}))
    elif op == "where":
        node = Node(op, (2, 0, 1))
    elif op in ("and", "or", "not"):
        node = Node(op, (2, 2)[: intervals.RULES[op][0]])
    else:
        given = (3,) if op == "power" else ()
        node = Node(op, (0, 1)[: intervals.RULES[op][0]], given)
    return Formula((*leaves, node), (4,))


def boxes(rng):
    low = rng.uniform(0.1, 0.8, (300, 2))
    return low, low + rng.uniform(0.0, 0.05, (300, 2))


@pytest.mark.parametrize("op", [*intervals.RULES, "gridded"])
def test_every_operation_has_a_second_opinion(op, monkeypatch, rng):
    """Which agrees with the bounds, and no more where these are moved to one side."""
    count, wrong = balls.outside(formula(op), *boxes(rng), (0.0, 1.0), 0)
    assert count > 250 and not wrong
    plain = Formula.value
    monkeypatch.setattr(
        Formula,
        "value",
        staticmethod(lambda node, *rest: [end + 1e-9 * (node.name == op) for end in plain(node, *rest)]),
    )
    assert len(balls.outside(formula(op), *boxes(rng), (0.0, 1.0), 0)[1]) > 250


@pytest.mark.slow
def test_a_root_that_is_off_is_found(monkeypatch, tmp_path):
    """By a share of 1e-9, as a library might be that was written for games."""
    path = save("windy", tmp_path / "table.npz")
    said = {claim.name: claim for claim in verify(path, samples=50, progress=False).claims}
    assert said[SECOND].checked > 1000 and not said[SECOND].failed
    count, rule = intervals.RULES["hypot"]
    shrunk = count, lambda a, b: tuple(end * (1 + 1e-9) for end in rule(a, b))
    monkeypatch.setitem(formulas.RULES, "hypot", shrunk)
    assert any(claim.name == SECOND and claim.failed for claim in verify(path, samples=50, progress=False).claims)


def test_without_it_or_for_all_cells_nothing_is_compared(monkeypatch, tmp_path):
    path = save("line", tmp_path / "table.npz")
    assert SECOND not in [claim.name for claim in verify(path, progress=False).claims]
    monkeypatch.setattr(balls, "INSTALLED", False)
    assert SECOND not in [claim.name for claim in verify(path, samples=5, progress=False).claims]


def test_what_a_ball_leaves_open_is_not_compared():
    near = flint.arb(0, 1e-60)
    assert balls.IN_BALLS["less"](near, flint.arb(0)) is None and balls.IN_BALLS["sign"](near) is None
    assert balls.IN_BALLS["floor"](near) is None and balls.IN_BALLS["mod"](flint.arb(1), flint.arb(0)) is None
    found = balls.values_at(formula("div"), [1.0, 0.0], [0.0])
    assert found == [None]
