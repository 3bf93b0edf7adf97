"""Docstring lines, code lines and words of docstrings of the package, by room.

Usage: python tests/lib/docstring_lines.py [FOLDER]

A code line is neither blank nor comment nor docstring. CONTRIBUTING says how many lines of docstrings are wanted.
"""

import ast
import io
import sys
import tokenize
from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent.parent / "sdhj"
SCOPES = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def counted(text: str) -> Counter[str]:
    """How many docstring lines, code lines and words of docstrings a program has."""
    described, written, words = set[int](), set[int](), 0
    for scope in ast.walk(ast.parse(text)):
        if isinstance(scope, SCOPES) and (docstring := ast.get_docstring(scope)) is not None:
            described |= set(range(scope.body[0].lineno, (scope.body[0].end_lineno or 0) + 1))
            words += len(docstring.split())
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            written |= set(range(token.start[0], token.end[0] + 1))
    return Counter(docstrings=len(described), code=len(written - described), words=words)


def by_room(folder: Path) -> dict[str, Counter[str]]:
    """What `counted` says of the files of each room together, and of all rooms."""
    found: dict[str, Counter[str]] = {}
    for path in sorted(folder.rglob("*.py")):
        here = counted(path.read_text("utf-8"))
        for room in (path.parent.relative_to(folder).as_posix(), "all"):
            found.setdefault(room, Counter()).update(here)
    return found


def main(folder: Path = PACKAGE) -> None:
    for room, count in sorted(by_room(folder).items()):
        share = count["docstrings"] / max(count["code"], 1)
        print(f"{room:20} {count['docstrings']:6} / {count['code']:6} = {share:.2f}  {count['words']:7} words")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
