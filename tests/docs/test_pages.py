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
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import click
import common as figures
import numpy as np
import pytest
from documents import ROOT, blocks, named_files

import sdhj
from sdhj.cli import main
from sdhj.formulas.arrays import MOST_NODES
from sdhj.formulas.formula import program
from sdhj.formulas.graph import MOST_AXES, MOST_EXPONENT
from sdhj.formulas.rules import RULES
from sdhj.formulas.text import MOST_LINES, parsed
from sdhj.kernels.tape import packed, play
from sdhj.problem.consistency import COMPARED_STATES

SITE = ROOT / "notebooks" / "site"
PROGRAM = re.compile(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)
WITH_PROGRAMS = ("maps", "filters", "for_ever", "records", "choosing", "trouble")  # each runs by itself
COLUMNS = 88  # of code: what is wider GitHub cuts


@pytest.mark.parametrize("path", sorted(SITE.glob("*.md")), ids=lambda path: path.stem)
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


def test_the_site_takes_directives_out_of_comments() -> None:
    conf = runpy.run_path(str(SITE / "conf.py"))
    for name, shown in (
        ("index", "```{toctree}\n"),
        ("site/api", "- {py:obj}`sdhj.solve`: "),
        ("site/numbers", "```{include} "),
    ):
        source = [(ROOT / "notebooks" / f"{name}.md").read_text("utf-8")]
        conf["with_directives"](None, name, source)
        assert shown in source[0] and "<!-- {" not in source[0]
        assert "[The table of all cases]" not in source[0]


def test_every_file_of_every_room_has_a_line_after_those_that_it_imports() -> None:
    """The rooms, too, in the order of the layers that a linter checks."""
    text = (SITE / "code.md").read_text(encoding="utf-8")
    named = re.findall(r"^- \[\w+\]\(\.\./\.\./(sdhj/\S+\.py)\): \S", text, re.MULTILINE)
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / "sdhj").rglob("*.py")}
    assert sorted(named) == sorted(file for file in files if not Path(file).name.startswith("__"))
    place = {name: number for number, name in enumerate(named)}
    for name in named:
        room = Path(name).parent.as_posix()
        needs = re.findall(
            rf"^from {room.replace('/', '.')}\.(\w+) import", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE
        )
        after = {other for other in needs if place.get(f"{room}/{other}.py", -1) > place[name]}
        assert (name, after) == (name, set())
    assert place["sdhj/kernels/tape.py"] < place["sdhj/problem/grid.py"] < place["sdhj/table/table.py"]
    assert place["sdhj/solver/games.py"] < place["sdhj/certified/sets.py"] < place["sdhj/solving.py"]


def test_commands_that_are_named_are_there() -> None:
    text = (SITE / "commands.md").read_text(encoding="utf-8")
    named = set(re.findall(r"(?:^|`)sdhj ([a-z]+)", text, re.MULTILINE))
    listed = re.search(r"lists the commands: ([^.]+)\.", text)
    assert listed is not None
    assert set(re.findall(r"`(\w+)`", listed[1])) == set(main.commands) == named


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
    """The programs of the pages, and what each prints, by page and heading."""
    found = []
    for name in WITH_PROGRAMS:
        for section in re.split(r"^## ", (SITE / f"{name}.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
            if program := PROGRAM.search(section):
                heading = section.splitlines()[0]
                found.append(pytest.param(program[1], program[2], id=f"{name}: {heading}"))
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


def test_there_is_a_recipe_below_every_heading_that_a_page_lists() -> None:
    """And no more: the list at the top of a page of recipes is complete."""
    for name in WITH_PROGRAMS[:4]:
        text = (SITE / f"{name}.md").read_text(encoding="utf-8")
        listed = re.findall(r"^- \[(.+)\]\(#[\w-]+\)$", text, re.MULTILINE)
        assert listed == re.findall(r"^## (.+)$", text, re.MULTILINE)
        assert len(PROGRAM.findall(text)) == len(listed) >= 4


def test_code_is_not_wider_than_github_shows() -> None:
    for path in (ROOT / "README.md", *sorted(SITE.glob("*.md"))):
        code = re.findall(r"^```python\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        wide = [line for block in code for line in block.splitlines() if len(line) > COLUMNS]
        assert (path.name, wide) == (path.name, [])


@cache
def played(page: str, heading: str) -> dict[str, Any]:
    """What the program below a heading defines, run in an empty folder."""
    (code,) = blocks(SITE / f"{page}.md", f"## {heading}\n")
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        with contextlib.redirect_stdout(io.StringIO()):
            exec(code, names)
    return names


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


@pytest.mark.slow
def test_the_map_and_the_desk_are_avoided() -> None:
    controller = played("maps", "A map, and a picture of what is promised")["controller"]
    assert sdhj.monte_carlo(controller, runs=300, adversary="worst", seed=0, progress=False).rate("collided") < 0.005
    here, wall, desk = controller.table.contains([[0.7, 1.0], [2.03, 0.5], [0.9, 2.3]], start=0, within=48)
    assert here and not wall and not desk


def followed(controller: Any, q: Any, until: Any, rng: np.random.Generator) -> np.ndarray:
    """The states (M, 2) of a robot that is pushed about at random, 10 of an interval; `until`: a set of states."""
    path = [np.array(q, dtype=float)]
    for step in range(controller.table.steps):
        if until(path[-1]):
            break
        velocity = controller.table.problem.inputs[controller.select(path[-1], step)]
        for _ in range(10):
            path.append(path[-1] + 0.025 * (velocity + rng.choice([-0.1, 0.1], 2)))
    assert until(path[-1])
    return np.array(path)


@pytest.mark.slow
def test_a_robot_in_the_mask_gets_out_and_on(rng: np.random.Generator) -> None:
    """The mask is the square from (0.6, 0.4) to (1.4, 1.2) m; none of the states on the way on is as near as 0.15 m."""
    recipe = played("maps", "A keep-out mask, and the way out of one")
    obeying, leaving, inside = recipe["obeying"], recipe["leaving"], recipe["inside"]
    assert not obeying.table.contains([inside])[0] and leaving.table.contains([inside])[0]
    assert recipe["way_out"].outcome == recipe["way_on"].outcome == "reached"
    for start in rng.uniform([0.65, 0.45], [1.35, 1.15], (20, 2)):
        out = followed(leaving, start, lambda q: obeying.table.contains([q])[0], rng)
        on = followed(obeying, out[-1], lambda q: np.hypot(q[0] - 3.4, q[1] - 1.5) <= 0.4, rng)
        assert (np.hypot(*np.maximum(np.abs(on - [1.0, 0.8]) - 0.4, 0.0).T) > 0.15).all()
        both = np.concatenate([out, on])
        crossed = np.abs(both[:, 0] - 2.025) < 0.175
        assert (both > 0.0).all() and (np.abs(both[crossed, 1] - 1.5) < 0.5).all()  # the door


@pytest.mark.slow
def test_a_fence_holds_the_robot_and_the_pond_keeps_it_out(rng: np.random.Generator) -> None:
    table = played("maps", "A fence to stay inside, with a pond")["fenced_in"]
    boxes = np.array([[[0.35, 0.35], [2.45, 2.65]], [[0.35, 0.35], [3.65, 1.75]]])  # the two halves less the radius
    q = rng.uniform([0, 0], [4, 3], (20_000, 2))
    free = ((q > boxes[:, None, 0]) & (q < boxes[:, None, 1])).all(axis=2).any(axis=0)
    free &= np.hypot(*np.maximum(np.abs(q - [1.7, 1.2]) - 0.3, 0.0).T) > 0.15
    won = table.contains(q)
    assert not won[~free].any() and won[free].mean() > 0.9
    for start in q[won][:20]:
        path = followed(sdhj.Controller(table), start, lambda q: np.hypot(q[0] - 3.4, q[1] - 1.5) <= 0.4, rng)
        assert ((path > boxes[:, None, 0]) & (path < boxes[:, None, 1])).all(axis=2).any(axis=0).all()
    proved = sdhj.solve(table.problem, sdhj.Certified(cells=[160, 120]), progress=False)
    assert proved.fraction() > 0.8 * table.fraction()


@pytest.mark.slow
def test_the_picture_shows_a_run_that_arrives() -> None:
    recipe = played("maps", "A map, and a picture of what is promised")
    drawn = [line for line in recipe["ax"].lines if line.get_gid() == "path"]
    assert drawn and drawn[0].get_xdata()[0] == 0.7 and recipe["run"].outcome == "reached"
    assert any((one.get_gid() or "").startswith("tube") for one in recipe["ax"].collections + recipe["ax"].patches)
    assert recipe["ax"].get_xlabel() == "x (m)" and len(recipe["figure"].axes) == 2


@pytest.mark.slow
def test_a_robot_that_measures_with_an_error_is_promised_less() -> None:
    recipe = played("records", "Measurement error, delay and jitter")
    action, real = recipe["action"], recipe["loop"].table
    exact = sdhj.solve(replace(real.problem, sensing=sdhj.Sensing()), progress=False, play=False)
    assert action.promised and not action.missed
    assert 0.1 < real.fraction(start=0, within=48) < exact.fraction(start=0, within=48)


@pytest.mark.slow
def test_the_filter_lets_through_what_is_safe() -> None:
    """From 1.7 m the wall, at 1.85 m for the robot's middle, is met within an interval of 0.25 s at 0.6 m/s."""
    guard = played("filters", "A safety filter for any commander")["guard"]
    answer = guard.filter([[0.7, 0.7], [1.7, 0.7], [1.7, 0.7]], step=0, wanted=[[0.5, 0.0], [0.5, 0.0], [0.0, 0.5]])
    assert answer.overruled.tolist() == [False, True, False] and answer.promised.all()
    assert answer.commands[0].tolist() == [0.5, 0.0]


@pytest.mark.slow
def test_the_robot_has_an_answer_everywhere(capsys: pytest.CaptureFixture[str]) -> None:
    recipe = played("filters", "Where the table knows no way")
    controller, act = recipe["controller"], recipe["act"]
    assert act([1.0, 1.5], 0) == controller.select([1.0, 1.5], 0)
    assert act([0.3, 1.5], 47) == controller.fallback([0.3, 1.5], 47).input  # a step is not enough from there
    assert capsys.readouterr().out == ""
    act([2.02, 1.5], 0)  # in the wall
    assert "nothing is promised at" in capsys.readouterr().out


@pytest.mark.slow
def test_the_octagon_holds_the_ball() -> None:
    """How far the disturbances of the recipe reach in every direction: at least r, at most r / cos(22.5 degrees)."""
    recipe = played("records", "Disturbances in a ball")
    problem, speeds = recipe["problem"], recipe["speeds"]
    (_, gain, bounds), directions = problem.dynamics.arrays, np.linspace(0.0, 2 * np.pi, 721)
    ways = np.stack([np.cos(directions), np.sin(directions)], axis=1)
    reach = np.abs(ways @ gain) @ bounds
    assert reach.min() == pytest.approx(0.1) and reach.max() == pytest.approx(0.1 / np.cos(np.pi / 8))
    boxed = replace(problem, dynamics=sdhj.Dynamics(speeds, drift=speeds, gain=np.eye(2), bounds=[0.1, 0.1]))
    tables = [sdhj.solve(one, progress=False, play=False) for one in (boxed, problem)]
    assert tables[0].fraction(start=0, within=48) < tables[1].fraction(start=0, within=48)


@pytest.mark.slow
def test_the_cart_stays_on_its_rail() -> None:
    """Full brakes from 1.9 m/s take 0.6 m of the 0.8: after an interval of what was wanted they would take too much."""
    recipe = played("for_ever", "Staying safe for ever")
    safe, braked = recipe["safe"], recipe["braked"]
    assert 0.3 < safe.fraction(start=0, within=1) < 0.7 and 5 < safe.steps < 100
    assert braked.promised and braked.overruled and braked.commands.tolist() == [-3.0]


@pytest.mark.slow
def test_the_long_horizon_is_long_enough() -> None:
    table = played("for_ever", "A target, however long it takes")["table"]
    same, at_most = sdhj.Certified(cells=table.details["cells"]), table.steps
    longer = sdhj.solve(replace(table.problem, steps=at_most + 10), same, progress=False)
    assert longer.fraction(start=0, within=at_most + 10) == table.fraction(start=0, within=at_most)


@pytest.mark.slow
def test_nothing_passes_the_thin_fence() -> None:
    fenced = played("maps", "What a coarse grid hides")["fenced"]
    assert fenced.contains([[2.6, 1.5], [1.4, 1.5]], start=0, within=48).tolist() == [True, False]


@pytest.mark.slow
def test_the_wind_blows_one_way() -> None:
    problem = played("records", "Bounds that are not symmetric")["problem"]
    low, high = problem.interval(0).extremes(0.0)[:, 0]  # of the input that rests
    np.testing.assert_allclose([low, high], [[0.0, -0.1], [0.2, 0.1]], rtol=0, atol=1e-15)


@pytest.mark.slow
def test_the_wind_from_a_table_is_a_formula() -> None:
    problem = played("records", "Wind from a table")["problem"]
    low, high = problem.dynamics.extremes(np.array([[2.0, 1.5], [1.0, 0.0]]), 0, 0.0).transpose(1, 0, 2)
    np.testing.assert_allclose(high, [[0.15, 0.15], [0.075, 0.075]], rtol=1e-12)
    np.testing.assert_allclose(low, -high)
    assert problem.opaque == {}


@pytest.mark.slow
def test_a_direction_that_is_turned_errs_to_the_safe_side() -> None:
    """Every velocity that a turn by up to 0.2 rad gives lies in the box, whose sides are reached."""
    problem = played("records", "A disturbance that does not enter linearly")["problem"]
    assert problem.dynamics.gain is None
    low, high = problem.dynamics.extremes(np.zeros((1, 2)), 1, 0.0)[0]
    turned = 0.5 * np.array([[np.cos(v), np.sin(v)] for v in np.linspace(-0.2, 0.2, 401)])
    assert (low <= turned.min(axis=0) + 1e-12).all() and (turned.max(axis=0) - 1e-12 <= high).all()
    np.testing.assert_allclose([low, high], [turned.min(axis=0), turned.max(axis=0)], atol=1e-6)


def test_the_page_on_formulas_holds_what_it_says() -> None:
    """Its code runs, its black box is one, and its limits are the library's."""
    names: dict[str, Any] = {}
    for code in blocks(SITE / "formulas.md"):
        exec(code, names)
    assert names["moving"].moving and isinstance(names["masts"].level_set, sdhj.BlackBox)
    text = (SITE / "formulas.md").read_text(encoding="utf-8")
    for limit in (
        f"{MOST_NODES:,}",
        f"{MOST_LINES:,}",
        f"-{MOST_EXPONENT} to {MOST_EXPONENT}",
        f"1 to {MOST_AXES} axes",
    ):
        assert limit in text
    assert f"at {COMPARED_STATES} random states" in text


def test_every_rule_is_on_the_page_and_the_lines_are_read_again() -> None:
    text = (SITE / "formulas.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \| (?:\d|1 to 6) \|", text, re.MULTILINE) == list(RULES)
    lines = re.search(r"^```text\n(x 0\n.*?)\n```$", text, re.MULTILINE | re.DOTALL)
    assert lines is not None
    (disk,) = parsed(lines[1].splitlines(), [], 2, 1)
    states, found = np.array([[1.0, 0.5], [0.3, 0.0]]), np.empty((1, 2))
    play(packed(*program([disk])), states, np.array([2.0]), found)
    np.testing.assert_allclose(found[0], np.hypot(states[:, 0] - 0.4, states[:, 1]) - 0.5, atol=1e-12)


@pytest.mark.slow
def test_gymnasiums_recipe_arrives() -> None:
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'sdhj[gym]'")
    names = played("filters", "An environment for learning agents")
    assert names["info"]["outcome"] == "reached" and names["terminated"]


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
