"""Changes of a statement on its syntax tree: a clause dropped, an inequality weakened, a term zero, a sign turned.

What may be changed is marked in the source: `# obligation 4.2` behind a statement, or above it on a line of its own. A
change is written as what is done to which of the statement's expressions, counted from 1 as they are written, an
expression before its parts:

    "drop"         the whole statement            "weaken 3"     < for <=, <= for <, and so on
    "drop 3"       3 from what it is a part of    "turn 3"       < for >, + for -, floor for ceil, -x for x
    "zero 3"       0 for it                       "copy 3 5"     5 for it
    "true 3"       True for it; and "false 3"     "number 3 2.5" this number for it

and where none of these does, "put 3 {3} - {5}" is another expression for 3 made of the statement's own, and "write {1}
= {5}" another statement. Several changes are made at once with a semicolon between them; expressions are counted
before the first. No name of the library's is quoted, so that what is marked can be renamed.

    python tests/changes.py 4.2        what is marked so, its expressions, and each change that `changes` makes of it
"""

import ast
import copy
import re
import sys
from collections.abc import Iterator
from functools import cache
from io import StringIO
from pathlib import Path
from tokenize import COMMENT, generate_tokens

LIBRARY = Path(__file__).parent.parent / "sdhj"
MARK = re.compile(r"# (?P<kind>obligation|check) (?P<number>\d+(?:\.\d+)?)\b")
WEAKER = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
TURNED = {
    **{ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or},
    **{ast.Or: ast.And, ast.Mult: ast.Div, ast.Div: ast.Mult},
}
PAIRS = [("floor", "ceil"), ("min", "max"), ("minimum", "maximum"), ("any", "all")]
OPPOSITE = {a: b for pair in PAIRS for a, b in (pair, pair[::-1])}


# ---- marks


@cache
def read(path: Path) -> list[ast.stmt]:
    """The statements of a file, which nobody changes."""
    return statements_of(ast.parse(path.read_text(encoding="utf-8")))


@cache
def marks() -> dict[str, list[tuple[Path, int]]]:
    """Where each mark stands: "obligation 4.2" -> files and lines. A bare "obligation 4" may stand in many places."""
    found: dict[str, list[tuple[Path, int]]] = {}
    for path in sorted(LIBRARY.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for word in generate_tokens(StringIO(text).readline) if MARK.search(text) else ():
            for mark in MARK.finditer(word.string) if word.type == COMMENT else ():
                found.setdefault(mark[0][2:], []).append((path, word.start[0]))
    return found


def headed(statement: ast.stmt) -> int:
    """The last line of a statement without the statements in it."""
    if not any(isinstance(child, ast.stmt) for child in ast.iter_child_nodes(statement)):
        return statement.end_lineno or 0
    return max([statement.lineno, *(node.end_lineno or 0 for *_, node in parts(statement))])


def marked(statements: list[ast.stmt], line: int) -> ast.stmt:
    """The statement that a mark on a line is about: the one that it stands in or behind, or the next."""
    around = [s for s in statements if s.lineno <= line <= (s.end_lineno or 0) and line <= headed(s)]
    if around:
        return max(around, key=lambda s: s.lineno)
    return min((s for s in statements if s.lineno > line), key=lambda s: s.lineno)


def statements_of(tree: ast.Module) -> list[ast.stmt]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]


# ---- expressions


def parts(statement: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, ast.expr]]:
    """Every expression of a statement as parent, field, place in it where it is a list, and itself."""
    for name, value in ast.iter_fields(statement):
        for place, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(child, ast.expr):
                yield statement, name, place, child
            if isinstance(child, ast.AST) and not isinstance(child, ast.stmt):
                yield from parts(child)


def put(parent: ast.AST, name: str, place: int | None, new: ast.AST) -> None:
    if place is None:
        setattr(parent, name, new)
    else:
        getattr(parent, name)[place] = new


def without(parent: ast.AST, name: str, place: int | None, spots: dict[int, tuple]) -> None:
    """Leave an expression out of its parent, which its only other part replaces where it is one of two."""
    rest: ast.AST | None = None
    if isinstance(parent, ast.BinOp):
        rest = parent.left if name == "right" else parent.right
    elif isinstance(parent, ast.IfExp):
        rest = parent.orelse if name == "body" else parent.body
    elif isinstance(parent, ast.Subscript):
        rest = parent.value
    elif isinstance(parent, ast.keyword):
        for node in [one for *_, one in spots.values() if isinstance(one, ast.Call) and parent in one.keywords]:
            node.keywords.remove(parent)
        return
    elif isinstance(parent, ast.BoolOp) and len(parent.values) == 2:
        rest = parent.values[1 - (place or 0)]
    elif isinstance(parent, ast.Compare) and name == "comparators":
        del parent.ops[place or 0]
    if rest is None:
        assert place is not None, f"nothing to drop from `{ast.unparse(parent)}`"
        del getattr(parent, name)[place]
        return
    put(*spots[id(parent)][:3], rest)


def turned(node: ast.expr) -> ast.expr:
    """The other way round: a comparison, an operation, a function that has an opposite, or else the sign."""
    if isinstance(node, ast.Compare):
        return ast.Compare(node.left, [TURNED[type(op)]() for op in node.ops], node.comparators)
    if isinstance(node, ast.BinOp) and type(node.op) in TURNED:
        return ast.BinOp(node.left, TURNED[type(node.op)](), node.right)
    if isinstance(node, ast.BoolOp):
        return ast.BoolOp(TURNED[type(node.op)](), node.values)
    if isinstance(node, ast.Name) and node.id in OPPOSITE:
        return ast.Name(OPPOSITE[node.id], node.ctx)
    if isinstance(node, ast.Attribute) and node.attr in OPPOSITE:
        return ast.Attribute(node.value, OPPOSITE[node.attr], node.ctx)
    return node.operand if isinstance(node, ast.UnaryOp) else ast.UnaryOp(ast.USub(), node)


def weakened(node: ast.expr) -> ast.expr:
    assert isinstance(node, ast.Compare), f"`{ast.unparse(node)}` is no comparison"
    return ast.Compare(node.left, [WEAKER[type(op)]() for op in node.ops], node.comparators)


def changed(statement: ast.stmt, change: str) -> ast.stmt:
    """A copy of a statement with a change, or several."""
    new = copy.deepcopy(statement)
    found = list(parts(new))
    texts = [ast.unparse(node) for *_, node in found]
    spots = {id(node): (parent, name, place, node) for parent, name, place, node in found}
    for one in change.split("; "):
        what, *numbers = one.split()
        if what == "write":
            return ast.parse(_filled(one[6:], texts)).body[0]
        if not numbers:
            return ast.Pass()
        parent, name, place, node = found[int(numbers[0]) - 1]
        if name not in ("args", "elts", "values", "keywords") or what != "drop":
            place = place if place is None else next(i for i, o in enumerate(getattr(parent, name)) if o is node)
        else:
            place = next(i for i, one in enumerate(getattr(parent, name)) if one is node)
        if what == "drop":
            without(parent, name, place, spots)
            continue
        other: ast.AST
        if what == "copy":
            other = copy.deepcopy(found[int(numbers[1]) - 1][3])
        elif what in ("number", "put"):
            other = ast.parse(_filled(one.split(maxsplit=2)[2], texts), mode="eval").body
        elif what in ("zero", "true", "false"):
            other = ast.Constant({"zero": 0, "true": True, "false": False}[what])
        else:
            other = {"turn": turned, "weaken": weakened}[what](node)
        put(parent, name, place, other)
    return new


def _filled(text: str, expressions: list[str]) -> str:
    """A text in which {3} is the third expression."""
    return re.sub(r"\{(\d+)\}", lambda found: f"({expressions[int(found[1]) - 1]})", text)


def changes(statement: ast.stmt) -> Iterator[str]:
    """Those that an obligation has without being listed: a clause dropped, an inequality true or false, a term zero."""
    if isinstance(statement, ast.AugAssign | ast.Expr):
        yield "drop"
    for number, (parent, name, _, node) in enumerate(parts(statement), 1):
        if isinstance(node, ast.Compare):
            yield from (f"true {number}", f"false {number}")
        if isinstance(parent, ast.BoolOp) or (
            isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.BitAnd | ast.BitOr)
        ):
            yield f"drop {number}"
        elif isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add | ast.Sub):
            yield f"zero {number}"
        if name == "func" and isinstance(node, ast.Name | ast.Attribute):
            if getattr(node, "id", getattr(node, "attr", "")) in OPPOSITE:
                yield f"turn {number}"


def mutant(kind: str, row: str) -> tuple[str, ast.Module]:
    """The file in which marks of a kind stand and its tree with their changes: "4.2 drop 1; turn 3; 4.3 zero 5"."""
    pairs = [one.split(maxsplit=1) for one in marks_in(row)]
    (path,) = {at for number, _ in pairs for at, _ in standing(f"{kind} {number}")}
    tree, new = ast.parse(path.read_text(encoding="utf-8")), {}
    for number, change in pairs:
        for _, line in standing(f"{kind} {number}"):
            statement = marked(statements_of(tree), line)
            new[id(statement)] = changed(statement, change)
            assert ast.dump(new[id(statement)]) != ast.dump(statement), f"{kind} {number}: {change} changes nothing"
    for node in list(ast.walk(tree)):
        for field, value in ast.iter_fields(node):
            if isinstance(value, list):
                getattr(node, field)[:] = [_in_place(new.get(id(child)), child) for child in value]
    return str(path.relative_to(LIBRARY)), ast.parse(ast.unparse(tree))  # what was copied to the left may be set now


def marks_in(row: str) -> list[str]:
    """A row's marks, each with its changes."""
    return re.split(r"; (?=\d)", row)


def standing(mark: str) -> list[tuple[Path, int]]:
    """Where a mark stands."""
    assert mark in marks(), f"nothing in the library is marked `# {mark}`"
    return marks()[mark]


def unlisted(kind: str) -> list[str]:
    """Every change of what is marked without a number of its own: rows of obligations that no table has."""
    return [
        f"{mark.partition(' ')[2]} {change}"
        for mark, places in marks().items()
        if re.fullmatch(rf"{kind} \d+", mark)
        for change in dict.fromkeys(one for place in places for one in changes(statement_at(*place)))
    ]


def statement_at(path: Path, line: int) -> ast.stmt:
    """What a mark on a line of a file is about."""
    return marked(read(path), line)


def _in_place(new: ast.AST | None, old: ast.AST) -> ast.AST:
    """What stands where a statement stood: of one that holds others, those too."""
    if new is None:
        return old
    for field in ("body", "orelse"):  # statements within may be marked, too
        if not isinstance(new, ast.Pass) and isinstance(getattr(old, field, None), list):
            setattr(new, field, getattr(old, field))
    return ast.copy_location(new, old)


def main(number: str) -> None:
    for mark in (f"obligation {number}", f"check {number}"):
        for path, line in marks().get(mark, ()):
            statement = statement_at(path, line)
            print(f"{mark}, {path.relative_to(LIBRARY)}:{line}\n\n    {ast.unparse(statement).splitlines()[0]}\n")
            for at, (*_, node) in enumerate(parts(statement), 1):
                print(f"    {at:3} {ast.unparse(node)}")
            for change in changes(statement):
                print(f"\n    {change}: {ast.unparse(changed(statement, change)).splitlines()[0]}")


if __name__ == "__main__":
    main(sys.argv[1])
