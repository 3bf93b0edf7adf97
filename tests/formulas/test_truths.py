"""Comparisons of the time are numbers to Python: what is computed of them is what Python computes, or is refused."""

import numpy as np
import pytest
import zoo

import sdhj

TIMES = (0.0, 0.3, 0.5, 0.7, 1.0, 1.7, 3.0)
GATES = {  # of the time; each stands in np.where, or is a number
    "~": lambda t: ~(t > 0.5),
    "invert": lambda t: np.invert(t > 0.5),
    "~ of both": lambda t: ~((t > 0.5) & (t < 2)),
    "~ of a product": lambda t: ~((t > 0.5) * (t < 2)),
    "~ twice": lambda t: ~~(t > 0.5),
    "~ of a cosine": lambda t: ~(np.cos(t) > 0.5),
    "~ of unequal": lambda t: ~(t != 0.5),
    "not": lambda t: not (t > 0.5),
    "and": lambda t: t > 0.5 and t < 2,
    "chain": lambda t: 0.5 < t < 2,
    "sum": lambda t: ((t > 0.5) + (t > 1)) == 2,
    "sum with True": lambda t: (True + (t > 0.5)) == 2,
    "sum of products": lambda t: ((t > 0.5) * (t < 2) + (t > 1) * (t < 2)) > 1.5,
    "difference": lambda t: (t > 0.5) - (t > 1),
    "negative": lambda t: -(t > 0.5) < -0.5,
    "less one": lambda t: (t > 0.5) - 1,
    "one less": lambda t: 1 - (t > 0.5),
    "exclusive": lambda t: (t > 0.5) ^ (t > 1),
    "exclusive with True": lambda t: (t > 0.5) ^ True,
    "exclusive with 1": lambda t: (t > 0.5) ^ 1,
    "or with 2": lambda t: ((t > 0.5) | 2) == 2,
    "== True": lambda t: (t > 0.5) == True,  # noqa: E712
    "== 1": lambda t: (t > 0.5) == 1,
    "!= True": lambda t: (t > 0.5) != True,  # noqa: E712
    "== another": lambda t: (t > 0.5) == (t > 1),
    "is True": lambda t: (t > 0.5) is True,
    "< another": lambda t: (t > 0.5) < (t > 1),
    "power": lambda t: (t > 0.5) ** 2 > 0.5,
    "share": lambda t: (t > 0.5) / 2 > 0.3,
    "floor": lambda t: (t > 0.5) // 2 > 0.3,
    "rest": lambda t: (t > 0.5) % 2 > 0.3,
    "shifted": lambda t: (t > 0.5) << 1,
    "absolute": lambda t: abs(t > 0.5),
    "positive": lambda t: +(t > 0.5),
    "builtin sum": lambda t: sum([t > 0.5, t > 1]) == 2,
    "sum of a list": lambda t: np.sum([t > 0.5, t > 1]) == 2,
    "logical": lambda t: np.logical_not(t > 0.5),
    "logical or": lambda t: np.logical_or(t > 1, t < 0.5),
    "turned round": lambda t: t <= 0.5,
    "index": lambda t: (1.0, 0.0)[t > 0.5],
    "type": lambda t: type(t) is float and 1.0,
}


@pytest.mark.parametrize("name", GATES)
def test_a_gate_of_the_time_is_what_python_says_or_refused(name):
    gate = GATES[name]

    def level(p, t):
        return np.where(gate(t), np.abs(p[:, 0]) - 0.3, 1.0)

    try:
        unsafe = sdhj.UnsafeSet((0,), level)
        problem = zoo.line(
            (-0.5, 0.5),
            lower=[-2.0],
            upper=[2.0],
            nodes=41,
            **zoo.ALONE,
            target=zoo.goal(1.2, 0.4),
            unsafe=[unsafe],
            delta=0.25,
            steps=12,
        )
    except ValueError as error:
        assert "sdhj.BlackBox(" in str(error) or "its formula says" in str(error)
        return
    points = np.array([[0.0], [0.2], [1.0]])
    for t in TIMES:
        with np.errstate(all="ignore"):
            assert problem.unsafe[0].level_set(points, t).tolist() == level(points, t).tolist()


@pytest.mark.parametrize("name", ["~", "~ of both", "~ of a product", "sum", "sum with True", "sum of products"])
def test_numbers_of_truths_are_refused_with_what_to_write(name):
    with pytest.raises(ValueError, match="Python: ~True is -2"):
        sdhj.UnsafeSet((0,), lambda p, t: np.where(GATES[name](t), np.abs(p[:, 0]) - 0.3, 1.0))


@pytest.mark.parametrize("name", ["logical", "logical or", "turned round", "exclusive", "one less"])
def test_what_is_said_to_write_is_read(name):
    sdhj.UnsafeSet((0,), lambda p, t: np.where(GATES[name](t), np.abs(p[:, 0]) - 0.3, 1.0))
