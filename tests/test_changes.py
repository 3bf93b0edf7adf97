"""Changes of marked statements, as tests of mutations make them: each kind, and that each row of a table makes one."""

import ast
import re
from pathlib import Path

import pytest
from changes import changed, changes, marked, marks, marks_in, parts, standing, statement_at, statements_of

TEXT = """
for k in range(n):  # obligation 4.1
    # obligation 4.2
    if low[k] <= a + b and not high[k] < (
        c * floor(d)  # obligation 4.3
    ):
        found |= f(low, high)  # obligation 4
"""
TREE = ast.parse(TEXT)
IF = next(node for node in ast.walk(TREE) if isinstance(node, ast.If))
ROW = re.compile(r'": \(\s*"(\d+\.\d+ [^"]+)"')  # of a table: the first of what a name stands for
TABLES = [
    "test_prover_mutations.py",
    "test_certified_mutations.py",
    "test_verify_mutations.py",
]


def number(text):
    return next(i for i, (*_, node) in enumerate(parts(IF), 1) if ast.unparse(node) == text)


@pytest.mark.parametrize(("line", "first"), [(2, "for"), (3, "if"), (5, "if"), (7, "found")])
def test_a_mark_is_of_the_statement_that_it_stands_in_or_before(line, first):
    assert ast.unparse(marked(statements_of(TREE), line)).startswith(first)


@pytest.mark.parametrize(
    ("change", "expected"),
    {
        "drop {low[k] <= a + b}": "not high[k] < c * floor(d)",
        "drop {a}": "low[k] <= b and (not high[k] < c * floor(d))",
        "zero {b}": "low[k] <= a + 0 and (not high[k] < c * floor(d))",
        "true {low[k] <= a + b}": "True and (not high[k] < c * floor(d))",
        "weaken {low[k] <= a + b}": "low[k] < a + b and (not high[k] < c * floor(d))",
        "turn {floor}": "low[k] <= a + b and (not high[k] < c * ceil(d))",
        "turn {a + b}": "low[k] <= a - b and (not high[k] < c * floor(d))",
        "turn {d}": "low[k] <= a + b and (not high[k] < c * floor(-d))",
        "copy {floor(d)} {d}; zero {a}": "low[k] <= 0 + b and (not high[k] < c * d)",
        "number {c} 2.5": "low[k] <= a + b and (not high[k] < 2.5 * floor(d))",
    }.items(),
)
def test_changes(change, expected):
    numbered = re.sub(r"{(.*?)}", lambda found: str(number(found[1])), change)
    assert ast.unparse(changed(IF, numbered).test) == expected


def test_expressions_are_made_of_those_that_are_there():
    a, c = number("a"), number("c")
    assert ast.unparse(changed(IF, f"put {c} {{{a}}} - 1").test).endswith("high[k] < (a - 1) * floor(d))")
    assert ast.unparse(changed(IF.body[0], "write {1} = {2}")) == "found = f(low, high)"
    assert isinstance(changed(IF.body[0], "drop"), ast.Pass)


def test_what_is_not_listed_has_its_changes():
    clauses = {f"{what} {number('low[k] <= a + b')}" for what in ("drop", "true", "false")}
    terms = {f"zero {number('a')}", f"zero {number('b')}", f"turn {number('floor')}"}
    assert clauses | terms < set(changes(IF)) and list(changes(IF.body[0])) == ["drop"]


@pytest.mark.slow
def test_every_row_of_the_tables_changes_something_and_every_number_is_in_a_row():
    rows = {}
    for name in TABLES:
        kind = "check" if name in TABLES[2:] else "obligation"
        (path,) = Path(__file__).parent.rglob(name)
        rows.setdefault(kind, []).extend(ROW.findall(path.read_text(encoding="utf-8")))
    for kind, of_kind in rows.items():
        assert len(of_kind) > 100
        used = set()
        for mark, change in (one.split(maxsplit=1) for row in of_kind for one in marks_in(row)):
            used.add(f"{kind} {mark}")
            for place in standing(f"{kind} {mark}"):
                old = statement_at(*place)
                assert ast.dump(changed(old, change)) != ast.dump(old), f"{kind} {mark}: {change} changes nothing"
        assert used == {mark for mark in marks() if mark.startswith(f"{kind} ") and "." in mark}
