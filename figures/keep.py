"""Run commands that pages quote, keep what they print, and write it into the pages and the chapters.

`python figures/keep.py timing maze` runs the commands of these names, `python figures/keep.py` tells which there are.

A page quotes a command below a mark, `<!-- maze: rows of `python figures/studies/costs.py maze` -->`: all lines that it
printed, its `rows` of a table, or `some lines`, which are found again by all but their numbers. What was printed is in
figures/kept/, with the commit that ran. Chapters read it there (`course.paper.kept`), and are executed again; a
figure of the command goes to the gallery, and says in the file which lines were printed when it was drawn.
"""

import hashlib
import re
import shlex
import subprocess
import sys
from collections.abc import Collection
from datetime import date
from pathlib import Path

import click
from common import HERE
from shrink import shrink

import sdhj

ROOT = HERE.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "notebooks" / "site").glob("*.md"))]
MARK = re.compile(
    r"<!-- (?P<name>\w+): (?P<what>lines|rows|some lines) of `(?P<command>[^`]+)` -->\n"
    r"(?P<block>```\w*\n.*?\n```|\|.*?\n(?=\n|\Z))",
    re.DOTALL,
)
NUMBER = re.compile(r"-?\d[\d.,]*(?:e[-+]?\d+)?")


def marks() -> dict[str, str]:
    """The commands that pages quote, by name."""
    return {mark["name"]: mark["command"] for page in PAGES for mark in MARK.finditer(page.read_text("utf-8"))}


def kept_file(name: str) -> Path:
    return HERE / "kept" / f"{name}.txt"


def kept(name: str) -> list[str]:
    """The lines that a command printed when it last ran."""
    return kept_file(name).read_text("utf-8").splitlines()[2:]


def digest(name: str) -> str:
    """Which lines a command printed."""
    return hashlib.sha256("\n".join(kept(name)).encode()).hexdigest()[:16]


def quoted(mark: re.Match[str]) -> str:
    """A mark and below it what its command printed.

    Raises
    ------
    ValueError
        For a line of the page that it did not print, whatever its numbers.
    """
    head, old, lines = mark[0][: -len(mark["block"])], mark["block"].splitlines(), kept(mark["name"])
    if mark["what"] == "rows":
        return head + "\n".join(line for line in lines if line.startswith("|")) + "\n"
    if mark["what"] == "some lines":
        printed: dict[str, list[str]] = {}
        for line in lines:
            printed.setdefault(shape(line), []).append(line)
        fixed = ("", *(line for line in old if line.startswith(("```", "| ---"))))
        for place, line in enumerate(old):
            if line not in fixed:
                if not printed.get(shape(line)):
                    raise ValueError(f"{mark['command']} printed no line like {line!r}; take it off the page")
                old[place] = printed[shape(line)].pop(0)
        lines = old
        return head + "\n".join(lines) + "\n" * old[0].startswith("|")
    return head + "\n".join([old[0], *lines, old[-1]])


def shape(line: str) -> str:
    """A line without its numbers, but for a whole number that it begins with: the nodes of a row."""
    first = re.sub(r"^(\s*\d+ |).*", r"\1", line)
    return " ".join((first + NUMBER.sub("#", line[len(first) :])).split())


def brought_up(text: str, names: Collection[str]) -> str:
    """A page with what commands of these names that it quotes have printed last."""
    return MARK.sub(lambda mark: quoted(mark) if mark["name"] in names else mark[0], text)


def run(name: str, command: str) -> None:
    """Run a command and keep its lines, without the names of the files that it has written."""
    arguments = [sys.executable, *shlex.split(command)[1:]]
    done = subprocess.run(arguments, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    lines = [line.rstrip() for line in done.stdout.strip().splitlines()]
    lines = [line for line in lines if not line or not (ROOT / line).exists()]
    revision = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(revision, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
    head = [f"$ {command}", f"sdhj {sdhj.__version__}, {commit}, {date.today()}"]
    kept_file(name).parent.mkdir(exist_ok=True)
    kept_file(name).write_text("\n".join([*head, *lines, ""]), encoding="utf-8")
    shrink(ROOT / "results", [Path(command.split()[1]).stem], printed=digest(name))


@click.command()
@click.argument("names", nargs=-1)
def main(names: tuple[str, ...]) -> None:
    """Run the commands of NAMES, keep what they print, and write it into pages and chapters."""
    commands = marks()
    for name in names or commands:
        click.echo(f"{name}: {commands[name]}")
        if names:
            run(name, commands[name])
    for page in PAGES:
        text = page.read_text("utf-8")
        if names and (new := brought_up(text, names)) != text:
            page.write_text(new, encoding="utf-8")
    for chapter in sorted((ROOT / "notebooks").glob("[0-9]*.ipynb")):
        if any(f'kept(\\"{name}\\")' in chapter.read_text("utf-8") for name in names):
            subprocess.run([sys.executable, ".ci/notebooks.py", "execute", chapter.name], cwd=ROOT, check=True)


if __name__ == "__main__":
    main()
