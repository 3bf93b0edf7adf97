"""Write what pages say of the code: first sentences of docstrings, tables of records, the rooms, the gallery.

Usage: python .ci/pages.py

Lines of the reference that begin with a name end with the first sentence of its docstring; each class has a page of its
own, which links its file. What else is made stands between `<!-- made: NAME -->` and `<!-- end -->`. A page so written
can be read where the site is not: tests/docs/test_pages.py compares.
"""

import ast
import inspect
import pydoc
import re
import tomllib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import sdhj
from sdhj.formulas.rules import RULES
from sdhj.formulas.text import written

ROOT = Path(__file__).resolve().parent.parent
SITE, FIGURES = ROOT / "notebooks" / "site", ROOT / "figures"
MADE = re.compile(r"(<!-- made: (\w+) -->\n).*?(<!-- end -->\n)", re.DOTALL)
OF_CLASS = re.compile(r"\A(# .*\n\n)(?:`.*\n\n?)?(<!-- )")
ENTRY = re.compile(r"^- \[(?P<shown>[\w.]+)\]\((?P<to>[^)]+)\): .*$", re.MULTILINE)


def made(path: Path) -> str:
    """A page as it should be."""
    text = path.read_text("utf-8")
    if path.parent.name == "api":
        return OF_CLASS.sub(lambda mark: mark[1] + stands_in(path) + mark[2], text)
    text = MADE.sub(lambda mark: f"{mark[1]}\n{globals()[mark[2]]()}\n\n{mark[3]}", text)
    return ENTRY.sub(lambda mark: entry(mark["shown"]), text) if path.name == "api.md" else text


def pages() -> dict[Path, str]:
    """All pages that something is written into, as they should be."""
    of_classes = sorted((SITE / "api").glob("*.md"))
    return {
        path: made(path)
        for path in (*(SITE / f"{name}.md" for name in ("api", "code", "formulas", "gallery")), *of_classes)
    }


def entry(shown: str) -> str:
    """A line of the reference: a name, linked to the page of a class or else to its file, and what it is."""
    name = shown if shown.split(".")[0] == "sdhj" else f"sdhj.{shown}"
    page = SITE / "api" / f"{shown.removeprefix('sdhj.')}.md"
    sentence, path = found(described(page) if page.is_file() else name)
    return f"- [{shown}]({f'api/{page.name}' if page.is_file() else f'../../{path}'}): {sentence}"


def described(page: Path) -> str:
    """The name of the class, or module, that a page of the reference is about."""
    return re.findall(r"(?:autoclass|automodule):: (\S+)\n", page.read_text("utf-8"))[0]


def stands_in(page: Path) -> str:
    """A line for those who read the page as it is: where the docstrings stand that the site shows here."""
    path = found(described(page))[1]
    return f"`{described(page)}` stands in [{path}](../../../{path}).\n\n"


def found(name: str) -> tuple[str, str]:
    """The first sentence of the docstring of what a dotted name stands for, and its file in the repository."""
    if name.startswith("sdhj.simulation.environment.") and not find_spec("gymnasium"):  # cannot be imported then
        path = ROOT / "sdhj" / "simulation" / "environment.py"
        body = ast.parse(path.read_text("utf-8")).body
        (docstring,) = (ast.get_docstring(one) for one in body if getattr(one, "name", "") == name.split(".")[-1])
    else:
        given: Any = pydoc.locate(name)
        docstring, path = inspect.getdoc(given), Path(inspect.getsourcefile(inspect.unwrap(given)) or "")
    return first_sentence(docstring or ""), path.relative_to(ROOT).as_posix()


def rules() -> str:
    """All operations of formulas, as a table."""
    rows = ["| operation | operands | in NumPy | what it gives |", "| --- | --- | --- | --- |"]
    for rule in RULES.values():
        names = ", ".join(f"`{name}`" for name in rule.numpy.split(", ") if name).replace("|", r"\|")
        operands = "1 to 6" if rule.arity < 0 else rule.arity
        rows.append(f"| `{rule.name}` | {operands} | {names} | {rule.says} |")
    return "\n".join(rows)


def lines() -> str:
    """The text of one formula, of a moving disk."""
    disk = sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 0.2 * t, p[:, 1]) - 0.5).level_set
    return "\n".join(["```text", *written(disk.outputs, []), "```"])


def rooms() -> str:
    """Each room of the package with a line for each file, of both those first that others import."""
    order = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"][0][
        "layers"
    ]
    parts = []
    for name in reversed(order):
        if (room := ROOT / "sdhj" / name).is_dir():
            for folder in (room, *sorted(path.parent for path in room.rglob("*/__init__.py"))):
                parts.append(f"### `{folder.relative_to(ROOT).as_posix()}/`\n\n{opening(folder / '__init__.py')}")
                parts.append("\n".join(line_of(path) for path in in_order_of_imports(folder)))
        elif name != "__main__":
            parts.append(line_of(room.with_suffix(".py")))
    return "\n\n".join(filter(None, parts))


def in_order_of_imports(folder: Path) -> list[Path]:
    """The files of a room, each after those of the room that it imports."""
    files, placed = {path.stem: path for path in sorted(folder.glob("[!_]*.py"))}, dict[str, Path]()
    room = ".".join(folder.relative_to(ROOT).parts)

    def put(name: str) -> None:
        for other in re.findall(rf"^from {room}\.(\w+) import", files[name].read_text("utf-8"), re.MULTILINE):
            if other in files and other not in placed:
                put(other)
        placed[name] = files[name]

    for name in files:
        if name not in placed:
            put(name)
    return list(placed.values())


def line_of(path: Path) -> str:
    """A line on a file: its name, linked, and the first sentence of its docstring."""
    return f"- [{path.stem}](../../{path.relative_to(ROOT).as_posix()}): {opening(path)}"


def opening(path: Path) -> str:
    """The first sentence of a file's docstring."""
    return first_sentence(ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "")


def first_sentence(docstring: str) -> str:
    """The lines of a docstring up to the first that ends with a full stop, as one."""
    said = docstring.split("\n\n")[0].splitlines()
    last = next((number for number, line in enumerate(said) if line.endswith(".")), len(said) - 1)
    return " ".join(line.strip() for line in said[: last + 1])


def gallery() -> str:
    """Of each script of figures/ what its docstring says, and its picture."""
    parts = []
    for path in (*sorted(FIGURES.glob("fig[0-9]*.py")), *sorted(FIGURES.glob("extra_*.py"))):
        sentence, _, more = (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").partition("\n")
        with Image.open(FIGURES / "gallery" / f"{path.stem}.png") as image:
            nodes = image.info.get("nodes")
        if nodes:
            more += f"\n\nThe arm has {nodes} nodes on each axis here."
        picture = f"![{sentence}](../../figures/gallery/{path.stem}.png)"
        parts += [f"## {sentence.removesuffix('.')}", f"`{path.name}`", picture, *filter(None, [more.strip()])]
    return "\n\n".join(parts)


if __name__ == "__main__":
    for changed, wanted in pages().items():
        changed.write_text(wanted, "utf-8")
