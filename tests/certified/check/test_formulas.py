"""Formulas of a file as the checker reads them: refused with a sentence, or evaluated line by line; memory bounded."""

import time
import timeit
import tracemalloc

import numpy as np
import pytest

from sdhj.certified.check import formulas
from sdhj.certified.check.formulas import MOST_LINES, read
from sdhj.certified.check.intervals import RULES
from sdhj.certified.check.stated import in_infix

DISK = ["x 0", "const 0x1.8000000000000p+0", "sub 0 1", "x 1", "hypot 2 3", "const 0x1p-1", "sub 4 5", "return 6"]
LOOKUP = "gridded 0 0 1 lower 0x0p+0 -0x1p+0 spacing 0x1p-1 0x1p-2"


def tables(number, axes):
    if number == 1:
        raise KeyError(f"tables/{number}")
    return np.zeros((1,) * axes) if number else np.arange(3.0**axes).reshape((3,) * axes)


def formula(lines, coordinates=2, parameters=1):
    told = {"coordinates": coordinates, "parameters": parameters, "lines": lines}
    return read("drift", told, coordinates, parameters, tables)


def test_a_disk_by_hand():
    low, high = formula(DISK).bounds(np.array([[0.0, 1.0], [1.0, -1.0]]), np.array([[0.5, 2.0], [2.0, 1.0]]), (0, 0))
    np.testing.assert_allclose(low[:, 0], [np.hypot(1, 1) - 0.5, -0.5], rtol=1e-14)
    np.testing.assert_allclose(high[:, 0], [np.hypot(1.5, 2) - 0.5, np.hypot(0.5, 1) - 0.5], rtol=1e-14)
    assert low[0, 0] < np.hypot(1, 1) - 0.5 and low[1, 0] == -0.5  # which is exact


def test_every_operation_can_be_read():
    lines = ["x 0", "x 1", "p 0", "less 0 1"]
    for name, (count, _) in RULES.items():
        truths = {"and": 2, "or": 2, "not": 1, "where": 1}.get(name, 0)
        words = [name, *["3"] * truths, *["0", "1", "2"][: count - truths]]
        lines.append(" ".join([*words, "-3"] if name == "power" else words))
    lines += [LOOKUP, "const inf", "const -inf", "const nan", "const 0x1.0p+0", f"where 3 3 {len(lines) + 4}"]
    lines += [f"not {len(lines) - 1}", f"return {' '.join(map(str, range(len(lines) + 1)))}"]
    low, high = formula(lines).bounds(np.full((5, 2), 0.25), np.full((5, 2), 0.5), (0.1, 0.2))
    assert low.shape == high.shape == (5, len(lines) - 1) and not (low > high).any()
    assert (np.isnan(low[:, -6:-3])).all() and np.isfinite(low[:, :4]).all()


def test_the_numbers_0_and_1_are_truth_values():
    lines = ["x 0", "const 0x0.0p+0", "const 0x1.0p+0", "less 0 2", "or 1 3", "and 2 3", "where 3 1 2", "not 6"]
    own = formula([*lines, "not 1", "return 4 5 7 8"], 1)
    low, high = own.bounds(np.array([[0.5], [1.5]]), np.array([[0.75], [2.0]]), (0, 0))
    assert low.tolist() == high.tolist() == [[1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]]
    with pytest.raises(ValueError, match="truth values"):
        formula(["x 0", "const 0x1.0p+1", "less 0 1", "or 1 2", "return 3"], 1)


def test_the_least_of_several_is_taken_apart_and_nothing_else():
    lines = ["x 0", "x 1", "p 0", "max 0 1", "min 3 2", "abs 1", "min 4 5", "min 6 4", "return 7 0"]
    assert {one.results for one in formula(lines).least_of} == {(2,), (3,), (5,)}


@pytest.mark.parametrize("many", [4, 5])
def test_few_jumps_are_taken_apart(many):
    lines = ["x 0", "const 0x1p+0", *(f"mod {0 if k == 0 else k + 1} 1" for k in range(many)), f"return {many + 1}"]
    assert len(formula(lines).jumps) == (4 if many == 4 else 0)


def test_an_unknown_number_is_a_truth_value():
    low, high = formula(["const nan", "not 0", "return 1"]).bounds(np.zeros((1, 2)), np.ones((1, 2)), (0, 0))
    assert np.isnan([low, high]).all()


def test_a_square_of_one_value_is_one():
    low, _ = formula(["x 0", "mul 0 0", "sqrt 1", "return 1 2"]).bounds(-np.ones((1, 2)), np.ones((1, 2)), (0, 0))
    assert low.tolist() == [[0.0, 0.0]]


def test_parameters_are_numbers_or_one_for_each_box():
    own = formula(["x 0", "p 1", "mul 0 1", "p 0", "add 2 3", "return 4"], 1, 2)
    half = np.array([1.0, 2.0])
    low, high = own.bounds(np.ones((2, 1)), np.ones((2, 1)), (0.0, 0.5), (-half, half))
    np.testing.assert_allclose([low[:, 0], high[:, 0]], [-half, half + 0.5], rtol=1e-14)


@pytest.mark.parametrize(("boxes", "numbers"), [(3, 1 << 23), (1 << 13, 1), (1 << 13, 40)])
def test_boxes_are_looked_at_in_turn(boxes, numbers, rng, monkeypatch):
    """Each with its own parameters, on both sides of a jump."""
    own = formula(["x 0", "p 1", "add 0 1", "p 0", "const 0x1p+0", "mod 2 4", "mul 5 3", "return 6 2"], 1, 2)
    low, first, second = rng.uniform(-2, 2, (10, 1)), rng.uniform(1, 2, 10), rng.uniform(-3, -2, 10)
    given = low, low + rng.uniform(0.0, 0.5, (10, 1)), (first, first + 0.5), (second, second + 0.1)
    whole = own.bounds(*given)
    most, asked = [], formulas.Formula.value
    monkeypatch.setattr(formulas, "MOST_BOXES", boxes)
    monkeypatch.setattr(formulas, "MOST_NUMBERS", numbers)
    watch = lambda node, operands, low, *more: most.append(len(low)) or asked(node, operands, low, *more)  # noqa: E731
    monkeypatch.setattr(formulas.Formula, "value", staticmethod(watch))
    np.testing.assert_array_equal(own.bounds(*given), whole)
    assert max(most) == min(boxes, max(numbers // 14, 1))
    each = [
        own.bounds(*(end[k : k + 1] for end in given[:2]), *((a[k], b[k]) for a, b in given[2:])) for k in range(10)
    ]
    np.testing.assert_array_equal(np.concatenate(each, axis=1), whole)


def test_what_reads_no_coordinate_has_bounds_at_each_time():
    """The same as for times that differ from box to box, and with jumps."""
    lines = ["x 0", "p 0", "mul 1 1", "const 0x1p+1", "mod 2 3", "add 0 2", "add 0 4", "return 2 4 5 6"]
    own, low, high = formula(lines, 1), np.array([[0.5], [1.5]]), np.array([[0.75], [2.0]])
    for times in ((0.0, 0.5), (0.0, 0.25), (0.25, 0.5), (1.0, 2.0), (0.0, 0.5)):
        found = own.bounds(low, high, times)
        np.testing.assert_array_equal(found, own.bounds(low, high, tuple(np.full(2, time) for time in times)))
        assert (found[1][:, 0] > times[1] ** 2).all() and (found[1][:, 0] < times[1] ** 2 + 1e-9).all()


PRINTED = {
    "a - (b - t)": ["sub 1 2", "sub 0 3"],
    "a - b - t": ["sub 0 1", "sub 3 2"],
    "a / (b * t)": ["mul 1 2", "div 0 3"],
    "(a + b) * t": ["add 0 1", "mul 3 2"],
    "a - (-2.0)": ["const -0x1p+1", "sub 0 3"],
    "-(a + b)": ["add 0 1", "neg 3"],
    "-a^2": ["mul 0 0", "neg 3"],
    "(-a)^3": ["neg 0", "power 3 3"],
    "b^-1": ["power 1 -1"],
    "-a + b": ["neg 0", "add 3 1"],
    "a + (-b)": ["neg 1", "add 0 3"],
    "(-a) * b": ["neg 0", "mul 3 1"],
    "a / b * t": ["div 0 1", "mul 3 2"],
    "(a / b)^2": ["div 0 1", "mul 3 3"],
    "(a^2)^3": ["sqr 0", "power 3 3"],
    "(-2.0)^3": ["const -0x1p+1", "power 3 3"],
    "-(-2.0)": ["const -0x1p+1", "neg 3"],
    "-(a / b)": ["div 0 1", "neg 3"],
    "(a < b) == (b <= t)": ["less 0 1", "lesseq 1 2", "equal 3 4"],
    "a - b < b * t": ["sub 0 1", "mul 1 2", "less 3 4"],
    "a < b and b < t or t == a": [*("less 0 1", "less 1 2", "equal 2 0", "and 3 4", "or 6 5")],
    "(a < b or b < t) and t == a": [*("less 0 1", "less 1 2", "equal 2 0", "or 3 4", "and 6 5")],
    f"{'a + ' * 17}a < b": [*(f"add {at or 0} 0" for at in (0, *range(3, 19))), "less 19 1"],  # of 69 characters
    f"{'a + ' * 17}sin(b)": [*(f"add {at or 0} 0" for at in (0, *range(3, 18))), "sin 1", "add 18 19"],
    f"e1 = {'a + ' * 17}sin(b); e1 * t": [
        *(f"add {at or 0} 0" for at in (0, *range(3, 18))),
        "sin 1",
        "add 18 19",
        "mul 20 2",
    ],
    "hypot(a + b, t)": ["add 0 1", "hypot 3 2"],
    "where((a < b or b <= t) and not(a == t), a, b)": [
        *("less 0 1", "lesseq 1 2", "or 3 4", "equal 0 2", "not 6", "and 5 7", "where 8 0 1"),
    ],
    "table[3 x 3, from [0.0, -1.0], by [0.5, 0.25]](a, b)": [LOOKUP],
    "e1 = a + b; e1 / (e1 * t)": ["add 0 1", "mul 3 2", "div 3 4"],
}


@pytest.mark.parametrize("text", PRINTED)
def test_what_is_printed_is_what_was_read(text):
    lines = ["x 0", "x 1", "p 0", *PRINTED[text]]
    named, results = in_infix(formula([*lines, f"return {len(lines) - 1}"]), "ab", "t")
    assert "; ".join([*named, *results]) == text


def test_what_it_reads_and_parts():
    both = formula(["x 0", "x 1", "p 0", "add 0 2", "neg 1", "return 3 4 1"])
    assert both.reads("p", 0) and not both.part(1, 2).reads("p") and both.part(1, 2).needed == [1, 4]
    assert both.part(0, 1).reads("x", 0) and not both.part(0, 1).reads("x", 1)


@pytest.mark.slow
def test_many_values_take_little_memory():
    """Of many values, few boxes are evaluated at once."""
    chain = formula(["x 0", *(f"sin {k}" for k in range(400)), "return 400"])
    tracemalloc.start()
    chain.bounds(np.zeros((200_000, 2)), np.ones((200_000, 2)), (0, 0))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1.2 * 8 * formulas.MOST_NUMBERS + 200_000 * 6 * 8


REFUSED = {
    "operand of a later line": (
        ["x 0", "add 0 2", "neg 0", "return 2"],
        "line 1 of drift",
    ),
    "itself": (["neg 0", "return 0"], "an operand "),
    "negative": (["x 0", "neg -1", "return 1"], "an operand "),
    "unknown operation": (["x 0", "__import__ 0", "return 1"], "those that are known"),
    "several spaces": (["x  0", "return 0"], "followed by one number"),
    "too few operands": (["x 0", "add 0", "return 1"], "add must have 2 operands"),
    "too many operands": (["x 0", "neg 0 0", "return 1"], "neg must have 1 operands"),
    "huge exponent": (["x 0", "power 0 65", "return 1"], "from -64 to 64"),
    "long exponent": (["x 0", f"power 0 {'9' * 10_000}", "return 1"], "an exponent "),
    "decimal": (["const 1.5", "return 0"], "must be hexadecimal"),
    "long number": ([f"const 0x1.{'0' * 10_000}p+0", "return 0"], "must be hexadecimal"),
    "too large": (["const 0x1p+9999", "return 0"], "not be as large"),
    "a truth as an operand": (["x 0", "not 0", "return 1"], "given truth values"),
    "a number as a condition": (["x 0", "where 0 0 0", "return 1"], "given truth values"),
    "coordinate": (["x 2", "return 0"], "a coordinate must"),
    "parameter": (["p 1", "return 0"], "a parameter must"),
    "no return": (["x 0", "x 1"], "the last line must"),
    "result of no line": (["x 0", "return 1"], "an operand must"),
    "no text": (["x 0", 7, "return 0"], "a line "),
    "no lines": ([], "list of at most"),
    "no list": ("return", "list of at most"),
    "too many lines": (["x 0"] * MOST_LINES + ["return 0"], "at most 100,000 lines"),
    "no table": (["x 0", "gridded 1 0 lower 0x0p+0 spacing 0x1p+0", "return 1"], "tables/1"),
    "spacing": (["x 0", "gridded 0 0 lower 0x0p+0 spacing -0x1p+0", "return 1"], "`spacing` above 0"),
    "no spacing": (["x 0", "gridded 0 0 lower 0x0p+0 spacing 0x0p+0", "return 1"], "`spacing` above 0"),
    "endless": (["x 0", "gridded 0 0 lower inf spacing 0x1p+0", "return 1"], "`lower` must be finite"),
    "seven axes": (["x 0", f"gridded 0{' 0' * 7} lower{' 0x0p+0' * 7} spacing{' 0x1p+0' * 7}", "return 1"], "1 to 6"),
    "spacing without an end": (["x 0", "gridded 0 0 lower 0x0p+0 spacing inf", "return 1"], "`spacing` above 0"),
    "a word more": (["x 0", "gridded 0 0 lower 0x0p+0 spacing 0x1p+0 0x1p+0", "return 1"], "gridded must have"),
    "lower twice": (["x 0", "gridded 0 0 lower 0x0p+0 lower 0x1p+0", "return 1"], "gridded must have"),
    "spacing twice": (["x 0", "gridded 0 0 spacing 0x0p+0 spacing 0x1p+0", "return 1"], "gridded must have"),
    "a table of one node": (["x 0", "gridded 2 0 lower 0x0p+0 spacing 0x1p+0", "return 1"], "two nodes"),
    "a small exponent": (["x 0", "power 0 -65", "return 1"], "from -64 to 64"),
    "a choice of numbers": (["x 0", "less 0 0", "where 1 0 0", "not 2", "return 3"], "given truth values"),
    "a number as a truth to take away": (["x 0", "less 0 0", "and 1 0", "return 2"], "given truth values"),
    "several numbers of a coordinate": (["x 0 0", "return 0"], "followed by one number"),
    "lower too short": (["x 0", "gridded 0 0 0 lower 0x0p+0 spacing 0x1p+0 0x1p+0", "return 1"], "gridded must have"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_formula_is_refused(name):
    lines, what = REFUSED[name]
    with pytest.raises((ValueError, KeyError), match=what):
        formula(lines)


def test_other_numbers_of_coordinates_are_refused():
    for given in (
        {"coordinates": 3, "parameters": 1, "lines": DISK},
        {"coordinates": 2, "parameters": 2, "lines": DISK},
    ):
        with pytest.raises(ValueError, match="drift must have"):
            read("drift", given, 2, 1, tables)


@pytest.mark.slow
def test_reading_takes_time_in_proportion(rng):
    def seconds(count):
        lines = ["x 0", *(f"add {k} {rng.integers(k + 1)}" for k in range(count)), f"return {count}"]
        # `timeit` turns the garbage collector off, which would look through all that other tests have left.
        return min(timeit.repeat(lambda: formula(lines).needed, timer=time.process_time, repeat=3, number=1))

    assert seconds(20_000) < 40 * max(seconds(2_000), 0.0025)
    deep = ["x 0", *(f"sin {k}" for k in range(MOST_LINES - 2)), f"return {MOST_LINES - 2}"]
    assert len(formula(deep).needed) == MOST_LINES - 1


@pytest.mark.slow
def test_forged_text_is_read_or_refused(rng):
    """Words exchanged, dropped, doubled and changed at random: a sentence or a formula, never another error."""
    lines = [*DISK[:-1], LOOKUP, "power 6 -2", "less 0 8", "where 9 7 8", "return 6 10"]
    words = [*{word for line in lines for word in line.split()}, "-1", "1e400", "inf", "nan", "", "\n", "0x1p+2000"]
    words.sort()
    refused = 0
    for _ in range(3000):
        forged = [line.split(" ") for line in lines]
        for _ in range(rng.integers(1, 4)):
            line = forged[rng.integers(len(forged))]
            place = int(rng.integers(len(line) + 1))
            line[place : place + int(rng.integers(0, 2))] = [words[rng.integers(len(words))]] * int(rng.integers(0, 3))
        try:
            found = formula([" ".join(line) for line in forged])
        except (ValueError, KeyError) as error:
            assert str(error)
            refused += 1
        else:
            low, high = found.bounds(np.zeros((3, 2)), np.ones((3, 2)), (0, 1))
            assert not (low > high).any()
    assert 500 < refused < 3000
