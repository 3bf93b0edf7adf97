"""Graphs and their texts: what is simplified, what is linear, and what is refused."""

import math
import random
import re

import graphs
import numpy as np
import pytest

from sdhj.formulas.derivative import linear
from sdhj.formulas.graph import Lookup, Node, constant, interned, leaf, leaves, make, ordered, power, rebuilt
from sdhj.formulas.rules import RULES
from sdhj.formulas.text import MOST_LINES, alike, parsed, shown, written

X, Y, T = leaf("x", 0), leaf("x", 1), leaf("p", 0)
ZERO, ONE, NAN = constant(0.0), constant(1.0), constant(math.nan)
TABLE = Lookup.of([[0.0, 1.0, 0.5], [2.0, -1.0, 0.25]], [-1.0, -1.0], [2.0, 1.0])


def test_equal_nodes_are_one():
    assert make("add", X, Y) is make("add", X, Y) and make("add", X, Y) is not make("add", Y, X)
    assert constant(2) is constant(2.0) and constant(math.nan) is constant(math.nan) and constant(-0.0) is ZERO
    assert leaf("x", 0) is X and leaf("x", 0, 1) is not X
    assert constant(True) is ONE and ONE.truth and not constant(2.0).truth


@pytest.mark.parametrize(
    "node",
    [
        make("mul", ZERO, make("log", X)),
        make("mul", make("sqrt", X), ZERO),
        make("sub", make("log", X), make("log", X)),
        make("sub", make("exp", X), make("exp", X)),
        make("div", ZERO, X),
        make("div", X, X),
        make("where", make("less", make("log", X), ONE), Y, Y),
        make("where", NAN, X, Y),
        make("where", make("less", ZERO, ONE), make("log", X), Y),
        make("min", make("log", X), constant(-math.inf)),
        make("mul", ZERO, constant(math.inf)),
        make("sub", constant(math.inf), constant(math.inf)),
        make("less", NAN, ONE),
        make("and", ZERO, make("less", make("log", X), ONE)),
        make("or", ONE, make("less", make("log", X), ONE)),
        make("not", NAN),
        make("max", NAN, ONE),
        make("sign", NAN),
        make("sqrt", constant(-1.0)),
        make("div", ONE, ZERO),
        power(make("log", X), ZERO),
        power(X, constant(-2.0)),
        power(NAN, ZERO),
    ],
    ids=str,
)
def test_what_may_be_undefined_is_kept(node):
    assert not node.total
    assert np.isnan(graphs.values([node], [(x, 0.5) for x in (-1.0, 0.0, 1e4, 800.0)], [0.0])).any()


def test_what_is_simplified():
    sine = make("sin", X)
    assert make("mul", ZERO, sine) is ZERO and make("sub", sine, sine) is ZERO
    assert make("add", ZERO, X) is X and make("mul", X, ONE) is X and make("div", X, ONE) is X
    assert make("mul", X, constant(-1.0)).op == "neg" and make("mul", X, X).op == "sqr"
    assert make("add", X, make("neg", Y)) is make("sub", X, Y) and make("neg", make("neg", X)) is X
    assert make("add", constant(1.5), constant(2.0)) is constant(3.5)
    assert [power(X, constant(n)).op for n in (1, 2, 0.5, -1, 3, 2.5, 65)] == "x sqr sqrt div power pow pow".split()
    assert power(X, ZERO) is ONE and power(X, Y).op == "pow"
    assert make("where", ONE, X, make("log", Y)) is X
    assert rebuilt([make("mul", X, Y)], lambda one: ZERO if one is X else None) == [ZERO]


@pytest.mark.slow
def test_a_deep_graph_needs_no_recursion():
    node = X
    for _ in range(10_000):
        node = make("add", make("sin", node), Y)
    assert len(ordered([node])) == 20_002 and leaves([node], "x") == {0, 1}
    assert np.isfinite(graphs.values([node], [(0.1, 0.2)])).all()
    del node


def test_linear_parts():
    v, w = leaf("p", 1), leaf("p", 2)
    drift, gain = make("sin", X), make("cos", Y)
    chosen = make("where", make("less", X, Y), w, v)
    node = make("sub", make("add", drift, make("mul", gain, v)), make("div", chosen, T))
    parts = linear([node, X, make("neg", v)], [v, w])
    assert parts is not None and not leaves([one for row in parts for one in row], "p") & {1, 2}
    rng = np.random.default_rng(0)
    for x, y, t, *push in rng.uniform(0.5, 2.0, (20, 5)):
        for one, each in zip([node, X, make("neg", v)], parts, strict=True):
            (whole,), (rest, *slopes) = (graphs.values(some, [(x, y)], [t, *push])[:, 0] for some in ([one], each))
            assert whole == pytest.approx(rest + np.dot(slopes, push), abs=1e-12)


@pytest.mark.parametrize(
    "node",
    [
        make("sqr", leaf("p", 1)),
        make("mul", leaf("p", 1), leaf("p", 2)),
        make("mul", make("sin", leaf("p", 1)), leaf("p", 2)),
        make("div", X, leaf("p", 1)),
        make("abs", leaf("p", 1)),
        make("where", make("less", leaf("p", 1), X), X, Y),
        make("add", leaf("p", 2), make("max", leaf("p", 1), X)),
        make("where", make("less", X, leaf("p", 1)), leaf("p", 1), make("add", leaf("p", 1), X)),
        make("floor", leaf("p", 1)),
        make("mod", leaf("p", 1), constant(2.0)),
        make("hypot", leaf("p", 1), X),
        make("hypot", leaf("p", 1), constant(0.0)),
        interned("gridded", (leaf("p", 1), X), TABLE),
    ],
    ids=str,
)
def test_what_is_not_linear_has_no_parts(node):
    assert linear([X, node], [leaf("p", 1), leaf("p", 2)]) is None


def test_linear_parts_keep_what_may_be_undefined():
    (parts,) = linear([make("mul", make("log", X), leaf("p", 1))], [leaf("p", 1)])
    assert np.isnan(graphs.values(parts, [(-1.0, 0.0)], [0.0])).all()


def sample():
    grid = interned("gridded", (X, make("add", Y, T)), TABLE)
    again = interned("gridded", (Y, X), TABLE)
    return [make("mul", grid, power(X, constant(-3.0))), make("where", make("less", X, Y), again, constant(0.1)), X]


def test_texts_round_trip():
    tables = []
    lines = written(sample(), tables)
    assert len(tables) == 1 and lines[-1].startswith("return ") and not any("true" in line for line in lines)
    assert list(parsed(lines, tables, 2, 1)) == sample()
    assert list(parsed(lines, [tables[0].values], 2, 1)) == sample()


def test_the_order_of_lines_follows_from_the_graph_alone():
    first = written([make("add", make("sin", X), make("cos", Y))], [])
    late = make("cos", leaf("x", 1))
    assert written([make("add", make("sin", leaf("x", 0)), late)], []) == first
    assert first == ["x 0", "sin 0", "x 1", "cos 2", "add 1 3", "return 4"]


def test_alike_are_graphs_whose_constants_differ_by_rounding():
    def graph(c, origin=-1.0, op="add", more=0.0):
        table = Lookup.of(TABLE.values + more, [origin, -1.0], [2.0, 1.0])
        return [make(op, interned("gridded", (X, Y), table), make("mul", constant(c), X))]

    first = graph(0.3)
    for near in (graph(0.3 * (1 + 1e-13)), graph(0.3, -1.0 - 1e-13), graph(0.3, more=1e-13)):
        assert alike(first, near)
    for other in (
        graph(0.3 + 1e-10),
        graph(0.3, -1.0 - 1e-10),
        graph(0.3, more=1e-10),
        graph(0.3, op="sub"),
        [],
    ):
        assert not alike(first, other) and not alike(other, first)
    twice = [make("mul", make("add", X, constant(0.3)), make("add", Y, constant(c))) for c in (0.3, 0.3 * (1 + 1e-13))]
    assert alike(twice[:1], twice[1:])  # one constant there, two here
    assert alike([NAN], [NAN]) and not alike([NAN], [ONE])
    assert not alike([make("add", X, T)], [make("add", Y, T)]) and not alike([X], [T])
    assert not alike([power(X, constant(3))], [power(X, constant(4))])


BAD = [
    "",
    "x",
    "x 2",
    "x -1",
    "x 0 0",
    "x 0x0",
    "x ²",
    "x ٣",
    "p 1",
    "const",
    "const one",
    "const 0x1p+99999",
    "const true",
    "add 0",
    "add 0 2",
    "add 0 -1",
    "add 0 1 1",
    "power 0 65",
    "power 0 -65",
    "power 0 0x2",
    "power 0",
    "and 0 1",
    "not 0",
    "where 0 1 1",
    "sine 0",
    "__class__ 0",
    "return 0",
    "gridded 1 0 1 lower 0x0p+0 0x0p+0 spacing 0x1p+0 0x1p+0",
    "gridded 0 0 lower 0x0p+0 spacing 0x1p+0",
    "gridded 0 0 1 lower 0x0p+0 spacing 0x1p+0 0x1p+0",
    "gridded 0 0 1 spacing 0x1p+0 0x1p+0 lower 0x0p+0 0x0p+0",
    "gridded 0 0 1 lower 0x0p+0 0x0p+0 spacing 0x1p+0 -0x1p+0",
    "gridded 0 0 1 lower nan 0x0p+0 spacing 0x1p+0 0x1p+0",
    "gridded",
    7,
    None,
]


@pytest.mark.parametrize("line", BAD, ids=repr)
def test_bad_lines_are_refused_with_their_number(line):
    with pytest.raises(ValueError, match="2 of a formula"):
        parsed(["x 0", "x 1", line, "return 0"], [TABLE], 2, 1)


@pytest.mark.parametrize("line", ["return", "return 2", "return x", "x 0", "", "returns 0"])
def test_bad_last_lines_are_refused(line):
    with pytest.raises(ValueError, match="2 of a formula"):
        parsed(["x 0", "x 1", line], [], 2, 1)


@pytest.mark.parametrize("lines", [[], ["return 0"], ["x 0"] * (MOST_LINES + 1)])
def test_too_few_or_too_many_lines_are_refused(lines):
    with pytest.raises(ValueError, match="must have 2 to"):
        parsed(lines, [], 2, 1)


def test_fuzzed_texts_are_read_or_refused():
    rng, tables = random.Random(0), []
    lines = written(sample(), tables)
    words = [*RULES, "return", "lower", "spacing", "nan", "-1", "0", "1", "99", "0x1p+0", "1e5", "", "\x00", "True"]
    refused = 0
    for _ in range(3000):
        text = list(lines)
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(text))
            parts = text[at].split(" ")
            parts[rng.randrange(len(parts))] = rng.choice(words)
            text[at] = " ".join(parts)
            if rng.random() < 0.1:
                del text[rng.randrange(len(text))]
        try:
            nodes = parsed(text, tables, 2, 1)
        except ValueError as error:
            refused += 1
            assert "line " in str(error) or "must have" in str(error)
        else:
            assert all(isinstance(node, Node) for node in nodes)
            graphs.values(nodes, [(0.3, -0.2)], [0.5])
    assert 1000 < refused < 3000


def test_mathematics_to_look_at():
    node = make("sub", make("hypot", make("sub", X, make("mul", constant(0.5), T)), Y), constant(0.25))
    assert shown([node], ["x", "y"]) == ["hypot(x - 0.5 t, y) - 0.25"]
    node = make("sub", make("add", X, make("mul", constant(-0.05), T)), make("neg", Y))
    assert shown([node], ["x", "y"]) == ["x - 0.05 t + y"]


class Reader:
    """Mathematics as people read it: what stands side by side is multiplied first, then divided, then added."""

    def __init__(self, text, known):
        self.words, self.known = re.findall(r"\[[0-9]+\]|[a-z]+|[0-9.]+(?:e[+-]?[0-9]+)?|\S", text), known

    def at(self, *words):
        return bool(self.words) and self.words[0] in words

    def take(self, *words):
        assert not words or self.at(*words)
        return self.words.pop(0)

    def sum(self):
        value = self.quotient()
        while self.at("+", "-"):
            value = value + self.quotient() if self.take() == "+" else value - self.quotient()
        return value

    def quotient(self):
        value = self.product()
        while self.at("/"):
            self.take()
            value = value / self.product()
        return value

    def product(self):
        if self.at("-"):
            self.take()
            return -self.product()
        value = self.power()
        while self.words and not self.at("+", "-", "/", ")", ",") and not (self.bars and self.at("|")):
            value = value * self.power()
        return value

    def power(self):
        value = self.operand()
        while self.at("^"):
            self.take()
            value = value ** float(self.take())
        return value

    bars = 0  # that are open

    def operand(self):
        word = self.take()
        if word == "|":
            self.bars, outside = 1, self.bars
            value, self.bars = abs(self.sum()), outside
            self.take("|")
        elif word == "(" or (word in ("abs", "max") and self.take("(")):
            self.bars, outside = 0, self.bars
            given = [self.sum()]
            while self.at(","):
                self.take()
                given.append(self.sum())
            self.take(")")
            self.bars, value = outside, max(given) if word == "max" else abs(given[0]) if word == "abs" else given[0]
        else:
            value = self.known[word] if word in self.known else np.float64(word)
        return value


@pytest.mark.slow
@np.errstate(all="ignore")
def test_mathematics_reads_as_what_is_computed():
    rng, letters = random.Random(0), 0
    for _ in range(3000):
        nodes = [X, Y, T, *map(constant, rng.sample((0.5, -0.25, 2.0, -3.0, 1e7), 3))]
        for _ in range(rng.randint(2, 9)):
            op = rng.choice(["add", "sub", "mul", "mul", "mul", "div", "neg", "abs", "sqr", "power", "max"])
            chosen = [rng.choice(nodes[-5:]) for _ in range(RULES[op].arity)]
            nodes.append(make(op, *chosen, value=3 if op == "power" else None))
        known = {name: np.float64(rng.uniform(0.4, 1.6) * rng.choice((-1.0, 1.0))) for name in "xyt"}
        *lines, last = shown([nodes[-1]], ["x", "y"])
        for line in lines:
            letter, _, text = line.partition(" = ")
            known[letter], letters = Reader(text, known).sum(), letters + 1
        (node,) = rebuilt(nodes[-1:], lambda one: constant(float(f"{one.value:.6g}")) if one.op == "const" else None)
        expected = graphs.values([node], [(known["x"], known["y"])], [known["t"]]).item()
        assert not math.isfinite(expected) or Reader(last, known).sum() == pytest.approx(expected, rel=1e-6), (
            lines,
            last,
        )
    assert letters > 50


def test_a_long_formula_is_shown_whole():
    """In lines that fit a screen, each with a number that a later one names."""
    node, known = abs_of_a_difference(0), {"x": np.float64(0.3), "y": np.float64(-1.7)}
    for k in range(1, 60):
        node = make("max", node, abs_of_a_difference(k))
    *lines, last = shown([node], ["x", "y"])
    assert len(lines) > 5 and max(map(len, [*lines, last])) < 300 and not any("..." in line for line in [*lines, last])
    for line in lines:
        number, _, text = line.partition(" = ")
        known[number] = Reader(text, known).sum()
    assert Reader(last, known).sum() == pytest.approx(max(abs(0.3 + 1.7 * (k + 2)) for k in range(60)))
    assert all(f"{k + 2} y" in " ".join([*lines, last]) for k in range(60))


def abs_of_a_difference(k):
    return make("abs", make("sub", X, make("mul", constant(k + 2.0), Y)))


@pytest.mark.parametrize(
    "given", [(["a", "b"], 0.0, 1.0), ([1j, 2.0], 0.0, 1.0), ([1.0, 2.0], None, "x"), ([[1.0], [2.0, 3.0]], 0, 1)]
)
def test_a_table_of_what_are_no_numbers_is_refused_in_words(given):
    with pytest.raises(ValueError, match="values, lower and spacing"):
        Lookup.of(*given)
