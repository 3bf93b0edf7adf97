"""The pages of the site that are no chapters: their Python runs, and what they name is there."""

import contextlib
import importlib
import io
import re
import runpy
import shlex
import sys
import tomllib
from dataclasses import replace
from importlib.util import find_spec
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


def test_the_rooms_are_listed() -> None:
    """All of them, and no other."""
    text = (SITE / "code.md").read_text(encoding="utf-8")
    rooms = {f"sdhj/{path.parent.name}/" for path in (ROOT / "sdhj").glob("*/__init__.py")}
    files = {f"sdhj/{path.name}" for path in (ROOT / "sdhj").glob("*.py")} - {"sdhj/__init__.py", "sdhj/__main__.py"}
    assert set(re.findall(r"`(sdhj/\w+(?:/|\.py))`", text[text.index("| room |") :])) == rooms | files


def test_rooms_and_files_stand_in_the_order_of_their_imports() -> None:
    rows = re.findall(r"^\| (`sdhj/.*?) \| (.*) \|$", (SITE / "code.md").read_text(encoding="utf-8"), re.MULTILINE)
    rooms = [name for first, _ in rows for name in re.findall(r"sdhj/(\w+)", first)]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert [*reversed(rooms)] == sorted(rooms, key=project["tool"]["importlinter"]["contracts"][0]["layers"].index)
    for first, text in rows:
        room = first.strip("`").split("`")[0].strip("/")
        files = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / room).glob("[!_]*.py")}
        named = [name for name in re.findall(r"`(\w+)`", text) if name in files]
        assert sorted(named) == sorted(files)
        for place, name in enumerate(named):
            needs = set(re.findall(rf"^from {room.replace('/', '.')}\.(\w+) import", files[name], re.MULTILINE))
            assert (name, needs & files.keys() - {*named[:place]}) == (name, set())


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


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """What the recipes define, run one after the other in an empty folder; and what each shows and what it printed."""
    text = (SITE / "recipes.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    said = []
    with contextlib.chdir(tmp_path_factory.mktemp("recipes")):
        for code, _, shown in re.findall(
            r"^```python\n(.*?)^```\n(\n```text\n(.*?)^```\n)?", text, re.MULTILINE | re.DOTALL
        ):
            if "ReachAvoidEnv" in code and find_spec("gymnasium") is None:
                continue
            with contextlib.redirect_stdout(io.StringIO()) as printed:
                exec(code, names)
            said.append((shown, printed.getvalue()))
        names["files"] = sorted(str(path) for path in Path().rglob("*.*"))
    return names, said


@pytest.fixture(scope="module")
def recipes(played: tuple[dict[str, Any], list[tuple[str, str]]]) -> dict[str, Any]:
    return played[0]


@pytest.mark.slow
def test_each_recipe_prints_what_is_shown(played: tuple[dict[str, Any], list[tuple[str, str]]]) -> None:
    """Word for word; numbers to 5 %: another machine rounds elsewhere, and another NumPy may draw other noise."""
    names, said = played
    number = re.compile(r"-?\d[\d,.]*(?:e[+-]\d+)?")
    for shown, printed in said:
        assert number.sub("#", shown).split() == number.sub("#", printed).split()
        for a, b in zip(number.findall(shown), number.findall(printed), strict=True):
            assert float(a.strip(",.").replace(",", "")) == pytest.approx(
                float(b.strip(",.").replace(",", "")), rel=0.05
            )
    silent = [place for place, (shown, _) in enumerate(said) if not shown]
    assert silent == [0, 6]  # the robot itself, and the picture
    assert {"office.yaml", "keep_out.pgm", "pictures/office.png"} <= set(names["files"])


@pytest.mark.slow
def test_the_map_and_the_desk_are_avoided(recipes: dict[str, Any]) -> None:
    controller = recipes["controller"]
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
def test_a_robot_in_the_mask_gets_out_and_on(recipes: dict[str, Any], rng: np.random.Generator) -> None:
    """The mask is the square from (0.6, 0.4) to (1.4, 1.2) m; none of the states on the way on is as near as 0.15 m."""
    obeying, leaving, inside = recipes["obeying"], recipes["leaving"], recipes["inside"]
    assert not obeying.table.contains([inside])[0] and leaving.table.contains([inside])[0]
    assert recipes["way_out"].outcome == recipes["way_on"].outcome == "reached"
    for start in rng.uniform([0.65, 0.45], [1.35, 1.15], (20, 2)):
        out = followed(leaving, start, lambda q: obeying.table.contains([q])[0], rng)
        on = followed(obeying, out[-1], lambda q: np.hypot(q[0] - 3.4, q[1] - 1.5) <= 0.4, rng)
        assert (np.hypot(*np.maximum(np.abs(on - [1.0, 0.8]) - 0.4, 0.0).T) > 0.15).all()
        both = np.concatenate([out, on])
        crossed = np.abs(both[:, 0] - 2.025) < 0.175
        assert (both > 0.2).all() and (np.abs(both[crossed, 1] - 1.5) < 0.5).all()  # the door


@pytest.mark.slow
def test_a_fence_holds_the_robot_and_the_pond_keeps_it_out(recipes: dict[str, Any], rng: np.random.Generator) -> None:
    table = recipes["fenced_in"]
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
def test_the_picture_shows_a_run_that_arrives(recipes: dict[str, Any]) -> None:
    drawn = [line for line in recipes["ax"].lines if line.get_gid() == "path"]
    assert drawn and drawn[0].get_xdata()[0] == 0.7 and recipes["run"].outcome == "reached"
    assert any((one.get_gid() or "").startswith("tube") for one in recipes["ax"].collections + recipes["ax"].patches)


@pytest.mark.slow
def test_a_robot_that_measures_with_an_error_is_promised_less(recipes: dict[str, Any]) -> None:
    action, real = recipes["action"], recipes["real"]
    exact = sdhj.solve(replace(real.problem, sensing=sdhj.Sensing()), progress=False, play=False)
    assert action.promised and not action.missed
    assert 0.1 < real.fraction(start=0, within=48) < exact.fraction(start=0, within=48)


@pytest.mark.slow
def test_the_filter_lets_through_what_is_safe(recipes: dict[str, Any]) -> None:
    controller, answer = recipes["controller"], recipes["answer"]
    assert answer.commands.tolist() == [0.5, 0.0] and answer.promised and not answer.changed
    before = controller.filter([[1.7, 0.7]] * 2, step=0, wanted=[[0.5, 0.0], [0.0, 0.5]])  # a wall to the right
    assert before.overruled.tolist() == [True, False] and before.promised.all()


@pytest.mark.slow
def test_the_robot_has_an_answer_everywhere(recipes: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    controller, act = recipes["controller"], recipes["act"]
    assert act([1.0, 1.5], 0) == controller.select([1.0, 1.5], 0)
    assert act([0.3, 1.5], 47) == controller.fallback([0.3, 1.5], 47).input  # a step is not enough from there
    assert capsys.readouterr().out == ""
    assert act([0.01, 1.5], 0) == 1  # in the wall to the left
    assert "nothing is promised at" in capsys.readouterr().out


@pytest.mark.slow
def test_the_octagon_holds_the_ball(recipes: dict[str, Any]) -> None:
    """How far the disturbances of the recipe reach in every direction: at least r, at most r / cos(22.5 degrees)."""
    (_, gain, bounds), directions = recipes["ball"].problem.dynamics.arrays, np.linspace(0.0, 2 * np.pi, 721)
    ways = np.stack([np.cos(directions), np.sin(directions)], axis=1)
    reach = np.abs(ways @ gain) @ bounds
    assert reach.min() == pytest.approx(0.1) and reach.max() == pytest.approx(0.1 / np.cos(np.pi / 8))
    boxed = sdhj.solve(recipes["problem"]([recipes["office"]]), progress=False)
    assert boxed.fraction(start=0, within=48) < recipes["ball"].fraction(start=0, within=48)


@pytest.mark.slow
def test_the_cart_stays_on_its_rail(recipes: dict[str, Any]) -> None:
    """Full brakes from 1.9 m/s take 0.6 m of the 0.8: after an interval of what was wanted they would take too much."""
    safe, braked = recipes["safe"], recipes["braked"]
    assert 0.3 < safe.fraction(start=0, within=1) < 0.7 and 5 < safe.steps < 100
    assert braked.promised and braked.overruled and braked.commands.tolist() == [-3.0]


@pytest.mark.slow
def test_the_long_horizon_is_long_enough(recipes: dict[str, Any]) -> None:
    some_time, at_most = recipes["some_time"], recipes["some_time"].steps
    same = sdhj.Certified(cells=some_time.details["cells"])
    longer = sdhj.solve(recipes["problem"]([recipes["office"]], steps=at_most + 10), same, progress=False)
    assert longer.fraction(start=0, within=at_most + 10) == some_time.fraction(start=0, within=at_most)


@pytest.mark.slow
def test_nothing_passes_the_thin_fence(recipes: dict[str, Any]) -> None:
    fenced = recipes["fenced"]
    assert fenced.contains([[2.6, 1.5], [1.4, 1.5]], start=0, within=48).tolist() == [True, False]


@pytest.mark.slow
def test_the_wind_blows_one_way(recipes: dict[str, Any]) -> None:
    low, high = recipes["windy"].problem.interval(0).extremes(0.0)[:, 0]  # of the input that rests
    np.testing.assert_allclose([low, high], [[0.0, -0.1], [0.2, 0.1]], rtol=0, atol=1e-15)


@pytest.mark.slow
def test_the_wind_from_a_table_is_a_formula(recipes: dict[str, Any]) -> None:
    dynamics = recipes["gusty"].problem.dynamics
    low, high = dynamics.extremes(np.array([[2.0, 1.5], [1.0, 0.0]]), 0, 0.0).transpose(1, 0, 2)
    np.testing.assert_allclose(high, [[0.15, 0.15], [0.075, 0.075]], rtol=1e-12)
    np.testing.assert_allclose(low, -high)
    assert recipes["gusty"].problem.opaque == {}


@pytest.mark.slow
def test_a_direction_that_is_turned_errs_to_the_safe_side(recipes: dict[str, Any]) -> None:
    """Every velocity that a turn by up to 0.2 rad gives lies in the box, whose sides are reached."""
    problem = recipes["skewed"].problem
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
def test_gymnasiums_recipe_arrives(recipes: dict[str, Any]) -> None:
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'sdhj[gym]'")
    (code,) = (code for code in blocks(SITE / "recipes.md") if "environment" in code)
    names = dict(recipes)
    exec(code, names)
    assert names["info"]["outcome"] == "reached" and names["terminated"]


def test_large_problems_are_solved_as_the_page_says(
    recipes: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same table from disk."""
    monkeypatch.chdir(tmp_path)
    solving, *_ = blocks(SITE / "large.md")
    names = {"sdhj": sdhj, "problem": recipes["problem"]([recipes["desk"]], steps=4)}
    exec(solving, names)
    memory = sdhj.solve(names["problem"], progress=False)
    np.testing.assert_array_equal(names["table"].values(start=0, within=4), memory.values(start=0, within=4))


@pytest.mark.slow
def test_a_worked_problem_is_played(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "path", [str(ROOT / "figures"), *sys.path])
    (code,) = blocks(SITE / "worked.md")
    exec(code.replace("10_000", "200"), {})
    assert "200 runs, hji table, adversary worst" in capsys.readouterr().out
