"""The pages of the site that are no chapters: their Python runs, and what they name is there."""

import contextlib
import importlib
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import common as figures
import numpy as np
import pytest
from documents import ROOT, blocks, named_files

import sdhj
from sdhj.cli import main

SITE = ROOT / "notebooks" / "site"
PROGRAM = re.compile(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(
    "path", [*sorted(SITE.glob("*.md")), *sorted(SITE.parent.glob("*.ipynb"))], ids=lambda path: path.stem
)
def test_files_that_are_named_are_there(path: Path) -> None:
    assert [named for named in named_files(path) if not named.exists()] == []


def test_pages_say_what_the_code_says() -> None:
    """`python .ci/pages.py` writes them; without Gymnasium what it cannot import is read."""
    made = runpy.run_path(str(ROOT / ".ci" / "pages.py"))["pages"]()
    assert len(made) > 25
    assert [str(page) for page, text in made.items() if page.read_text("utf-8") != text] == [], "run .ci/pages.py"


def test_no_page_has_directives_that_only_the_site_can_show() -> None:
    """They stand in comments, and conf.py takes them out: README, what it links, and what that links."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "notebooks").rglob("*.md")]
    texts = {path: path.read_text("utf-8") for path in pages}
    assert [
        str(path) for path in pages if re.search(r"^(```|:::)+\{|^\.\. \w+::", visible(texts[path]), re.MULTILINE)
    ] == []
    # whoever reads api.md elsewhere still finds each name that the site describes there
    text = texts[SITE / "api.md"]
    for name in re.findall(r"^\.\. auto\w+:: (\S+)", text, re.MULTILINE):
        assert f"- [{name}](../../sdhj/" in visible(text)


def visible(text: str) -> str:
    """A page as it is shown where comments are all that is left out."""
    return re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*is certified")  # few cells: next to nothing is
def test_the_command_line_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands as they stand there, on few cells and nodes."""
    monkeypatch.chdir(tmp_path)
    text = (SITE / "commands.md").read_text(encoding="utf-8")
    block = re.search(r"^```bash\n(sdhj new.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert block is not None
    for line in block[1].splitlines():
        words = line.split("#")[0].split()[1:]
        if words[0] == "solve":
            words += ["--cells", "24,24,24"] if "certified" in words else ["--nodes", "9"]
        if words[0] != "warmup":
            assert main(words, standalone_mode=False) in (None, 0)
    assert {"arm.npz", "car.npz", "car.svg", "robot"} <= {path.name for path in tmp_path.iterdir()}


def commands() -> list[list[str]]:
    """What pages say to type of this project's programs, word for word; not what they only name."""
    found = dict[str, None]()
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(SITE.glob("*.md"))):
        text = path.read_text(encoding="utf-8")
        typed = re.findall(r"^```bash\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        lines = [line.split("#")[0] for part in typed for line in part.splitlines()]
        lines += re.findall(r"`([^`]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL))
        for part in (part for line in lines for part in line.split("&&")):
            if re.match(r"(python figures/\S+\.py|sdhj [a-z]+) ", (told := " ".join(part.split())) + " "):
                found[told] = None
    return [shlex.split(command) for command in found]


def test_every_command_of_a_page_is_one_that_its_program_takes(tmp_path: Path) -> None:
    """Its options, and how many arguments; that `sdhj` runs in an empty folder, the test above shows."""
    told = commands()
    assert len(told) > 40
    for typed, *words in told:
        if typed == "sdhj":
            name, *arguments = words
            command = main.commands[name]
        else:
            script, *arguments = words
            drawn = Path(script).stem in figures.NAMES
            module = importlib.import_module(Path(script).stem)
            command = figures.command_of(script) if drawn else vars(module).get("main")
        if not arguments or not isinstance(command, click.Command):
            continue  # it is named; or takes what stands in `sys.argv`
        try:
            here = "promises.py" in words[0]  # it writes into a page that there has to be
            with contextlib.chdir(ROOT if here else tmp_path):
                command.make_context(name if typed == "sdhj" else script, arguments)
        except click.NoSuchOption:
            raise
        except (click.MissingParameter, click.BadOptionUsage):
            assert typed == "sdhj" and any(word.startswith("--") for word in words)  # it names an option


def programs() -> list[Any]:
    """The programs of the pages, and what each prints, by page and heading; not those that go on from commands."""
    found = []
    for path in sorted(SITE.glob("*.md")):
        text = path.read_text(encoding="utf-8")
        for section in [] if "```bash\nsdhj new" in text else re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
            if program := PROGRAM.search(section):
                heading = section.splitlines()[0]
                found.append(pytest.param(program[1], program[2], id=f"{path.stem}: {heading}"))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("code", "shown"), programs())
def test_each_recipe_runs_by_itself_and_prints_what_is_shown(code: str, shown: str, tmp_path: Path) -> None:
    """In an empty folder and a process of its own; numbers to 5 %: another machine rounds elsewhere."""
    if "ReachAvoidEnv" in code:
        pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'sdhj[gym]'")
    (tmp_path / "recipe.py").write_text(code, encoding="utf-8")
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "recipe.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    number = re.compile(r"-?\d[\d,.]*(?:e[+-]\d+)?")
    assert number.sub("#", shown).split() == number.sub("#", done.stdout).split()
    for a, b in zip(number.findall(shown), number.findall(done.stdout), strict=True):
        one, other = (float(each.strip(",.").replace(",", "")) for each in (a, b))
        assert one == pytest.approx(
            other, rel=0.05, abs=0 if "." in a.strip(".") else 3
        )  # or to three, of what is counted
    assert (tmp_path / "pictures" / "office.png").is_file() or "plotting.save" not in code


@pytest.mark.slow
def test_the_quick_start_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its commands, one after the other, in an empty folder, and then its loop."""
    monkeypatch.chdir(tmp_path)
    text = (SITE / "start.md").read_text(encoding="utf-8")
    commands = re.search(r"^```bash\n(sdhj new.*?)^```$", text, re.MULTILINE | re.DOTALL)
    program = PROGRAM.search(text)
    assert commands is not None and program is not None
    for line in commands[1].splitlines():
        assert main(line.split()[1:], standalone_mode=False) in (None, 0)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(program[1], {})
    assert printed.getvalue().split() == program[2].split()
    assert (tmp_path / "car.svg").is_file()


def test_the_page_on_formulas_holds_what_it_says() -> None:
    """Its code runs, and its black box is one."""
    names: dict[str, Any] = {}
    for code in blocks(SITE / "formulas.md"):
        exec(code, names)
    assert names["moving"].moving and isinstance(names["masts"].level_set, sdhj.BlackBox)


def test_large_problems_are_solved_as_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same table from disk."""
    monkeypatch.chdir(tmp_path)
    solving, *_ = blocks(SITE / "large.md")
    names = {"sdhj": sdhj, "problem": sdhj.arm_case_study(nodes=9, steps=2)}
    exec(solving, names)
    memory = sdhj.solve(names["problem"], progress=False)
    np.testing.assert_array_equal(names["table"].values(start=0, within=2), memory.values(start=0, within=2))


@pytest.mark.slow
def test_a_worked_problem_is_played(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "path", [str(ROOT / "figures"), *sys.path])
    (code,) = blocks(SITE / "worked.md")
    exec(code.replace("10_000", "200"), {})
    assert "200 runs, hji table, adversary worst" in capsys.readouterr().out
