"""Every figure of the paper, drawn from coarse grids: complete, unclipped, solved once; and the scripts around them."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from matplotlib.text import Text

import sdhj
from sdhj import figures, plotting
from sdhj.cli import figure_command
from sdhj.plotting import studies

SCRIPTS = Path(__file__).parent.parent / "figures"


@pytest.fixture(scope="module")
def context() -> figures.Context:
    shared = figures.Context(nodes=9)
    shared.timings = {"hji": {9: 0.5}, "projected": {9: 0.25}}  # measuring is tested on its own
    return shared


def words(figure: Figure) -> list[Text]:
    """Every text that is shown, but for the ticks of axes in three dimensions."""
    found = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for ax in figure.axes:
        found += ax.texts
        found += ax.get_legend().get_texts() if ax.get_legend() else []
        if not ax.axison:
            continue
        found += [ax.title, ax._left_title, ax._right_title, ax.xaxis.label, ax.yaxis.label]
        for axis in (ax.xaxis, ax.yaxis) if ax.name != "3d" else ():
            low, high = sorted(axis.get_view_interval())
            for tick in axis.get_major_ticks():
                found += [tick.label1] if low <= tick.get_loc() <= high else []
        found += [ax.zaxis.label] if ax.name == "3d" else []
    return [text for text in found if text.get_visible() and text.get_text().strip()]


def clipped(figure: Figure) -> list[str]:
    """Texts that stick out of the figure."""
    with plotting.style():
        figure.draw_without_rendering()
        page = figure.bbox.padded(1.0)  # antialiasing
        boxes = [(text.get_text(), text.get_window_extent()) for text in words(figure)]
    assert boxes
    return [
        text
        for text, box in boxes
        if not (page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0 and box.y1 <= page.y1)
    ]


def test_every_figure_of_the_paper_is_there():
    assert {spec.number for spec in figures.FIGURES.values()} - {None} == set(range(1, 15))
    for name, spec in figures.FIGURES.items():
        assert name.startswith("extra_" if spec.number is None else f"fig{spec.number:02d}_")


STUDIES = {name for name, spec in figures.FIGURES.items() if spec.study}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in STUDIES else []) for name in figures.FIGURES]
)
def test_figures_are_drawn_whole(context, name, monkeypatch):
    monkeypatch.setattr(figures, "STUDY_RUNS", 5)
    figure = figures.draw(name, context)
    assert clipped(figure) == []
    assert figure.axes


@pytest.mark.parametrize("name", ["fig02_offline", "fig03_online", "fig05_game"])
def test_words_stay_in_their_boxes(context, name):
    figure = figures.draw(name, context)
    with plotting.style():
        figure.draw_without_rendering()
        boxes = [patch.get_window_extent() for patch in figure.axes[0].patches if patch.get_gid() == "box"]
        assert len(boxes) >= 5
        for text in figure.axes[0].texts:
            own = text.get_window_extent()
            middle = (own.x0 + own.x1) / 2, (own.y0 + own.y1) / 2
            for box in boxes:
                if box.contains(*middle):
                    assert box.x0 <= own.x0 and own.x1 <= box.x1 and box.y0 <= own.y0 and own.y1 <= box.y1, (
                        text.get_text()
                    )


def test_tables_are_solved_once(monkeypatch):
    solved = []
    solve = sdhj.solve

    def counting(problem, **options):
        solved.append(options["method"])
        return solve(problem, **options)

    monkeypatch.setattr(sdhj, "solve", counting)
    said = []
    fresh = figures.Context(nodes=9, say=said.append)
    for name in ("fig10_tubes", "fig11_projected", "fig13_comparison", "fig08_lookup_table", "fig13_isosurface"):
        figures.draw(name, fresh)
    assert sorted(solved) == ["hji", "projected"]
    assert len(said) == 2
    given = figures.Context(tables={"hji": fresh.table("hji")})
    assert given.problem is fresh.problem
    figures.draw("fig10_tubes", given)
    assert len(solved) == 2


def test_projected_tubes_are_the_projected_tables(context):
    full, inner = (figures.draw(name, context) for name in ("fig10_tubes", "fig11_projected"))

    def outer(figure: Figure) -> np.ndarray:
        sets = [c for c in figure.axes[0].collections if (c.get_gid() or "") == "tube-8"]
        return np.concatenate([path.vertices for path in sets[0].get_paths()])

    assert not np.array_equal(outer(full), outer(inner))


def test_kept_share(context):
    full, inner = context.table("hji"), context.table("projected")
    for px, py in figures.PURSUERS:
        kept = figures.kept_share(full, inner, (0.0, 0.0, px, py))
        assert 0.0 <= kept <= 1.0
        assert figures.kept_share(full, full, (0.0, 0.0, px, py)) == 1.0
    assert np.isnan(figures.kept_share(full, inner, (0.0, 0.0, 0.0, 0.0)))  # the pursuer on the arm's base


def test_a_run_starts_in_its_tube(context):
    table = context.table("hji")
    starts = figures.starts_of_runs(table, 5, within=4)
    assert 1 <= len(starts) <= 5
    assert table.contains(starts, start=0, within=4).all()
    assert not table.contains(starts, start=0, within=3).any()
    assert np.array_equal(starts, figures.starts_of_runs(table, 5, within=4))
    assert context.run.outcome == "reached"


def test_no_start_is_an_error(context):
    empty = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=1), method="lax", progress=False)
    empty.tubes[...] = 1.0
    with pytest.raises(ValueError, match="none of 20000 states is admissible"):
        figures.starts_of_runs(empty, 3)


def test_measured_times_are_those_of_whole_solutions(monkeypatch):
    solved = []
    monkeypatch.setattr(
        sdhj, "solve", lambda problem, **options: solved.append((problem.grid.shape[0], options["method"]))
    )
    monkeypatch.setattr(figures, "compile_kernels", lambda methods: solved.append(methods))
    seconds = figures.measure((11, 13), ("hji", "lax"))
    assert solved == [("hji", "lax"), (11, "hji"), (11, "lax"), (13, "hji"), (13, "lax")]
    assert seconds.keys() == {"hji", "lax"} and all(t > 0 for by_nodes in seconds.values() for t in by_nodes.values())
    assert figures.Context(nodes=25).timed_nodes == studies.PAPER_NODES
    assert figures.Context(nodes=11).timed_nodes == (11,)


def test_write_and_refusals(context, tmp_path):
    files = figures.write("fig09_spaces", context, tmp_path / "new" / "folder", formats=("svg", "pdf", "png"))
    assert [path.name for path in files] == ["fig09_spaces.svg", "fig09_spaces.pdf", "fig09_spaces.png"]
    assert all(path.stat().st_size > 5000 for path in files)
    assert 'id="pursuer' in files[0].read_text()
    with pytest.raises(ValueError, match=r"figure must be one of fig01_problem.*got 'fig99'"):
        figures.draw("fig99", context)
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="choose a folder"):
        figures.write("fig09_spaces", context, tmp_path / "file")


@pytest.mark.slow
def test_draw_all_writes_everything(context, tmp_path):
    said = []
    tables = {method: context.table(method) for method in ("hji", "projected", "lax")}
    files = figures.draw_all(tables, tmp_path, say=said.append)
    assert {path.stem for path in files} == {name for name, spec in figures.FIGURES.items() if not spec.study}
    assert [path.suffix for path in files if path.stem == "fig12_trajectory"] == [".pdf", ".png", ".gif"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in files)
    assert "drawing fig01_problem" in said and "drawing extra_evader" not in said


# ----------------------------------------------------------------------------------------------------------------------
# The scripts
# ----------------------------------------------------------------------------------------------------------------------


def test_each_figure_has_its_script():
    scripts = sorted(path.stem for path in SCRIPTS.glob("*.py"))
    numbered = [name for name in scripts if name.startswith("fig")]
    assert [int(name[3:5]) for name in numbered] == list(range(1, 15))
    extra = [name for name in scripts if name.startswith("extra_")]
    assert set(extra) == {name for name, spec in figures.FIGURES.items() if spec.number is None}
    assert set(scripts) == {*numbered, *extra, "make_all"}
    for name in extra:
        assert f'figure_command("{name}")()' in (SCRIPTS / f"{name}.py").read_text()
    for name in numbered:
        assert name in figures.FIGURES
        text = (SCRIPTS / f"{name}.py").read_text()
        assert f"figure_command({int(name[3:5])})()" in text and text.startswith(f'"""Fig. {int(name[3:5])}: ')
        spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
        spec.loader.exec_module(importlib.util.module_from_spec(spec))  # importing draws nothing


def test_a_script_writes_its_figure(tmp_path):
    result = CliRunner().invoke(figure_command(9), ["--nodes", "9", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["fig09_spaces.pdf", "fig09_spaces.png"]
    assert "fig09_spaces.pdf" in result.output


@pytest.mark.parametrize(
    ("options", "said"), [(["--nodes", "3"], "at least 5"), (["--out", "blocked/inside"], "choose a folder")]
)
def test_a_script_refuses_in_one_line(tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(tmp_path)
    Path("blocked").touch()
    result = CliRunner().invoke(figure_command(9), options)
    assert result.exit_code == 2
    assert said in result.output and "Traceback" not in result.output
    assert len(result.output.strip().splitlines()) == 1


def test_help_says_what_is_drawn():
    result = CliRunner().invoke(figure_command(10), ["--help"])
    assert "Reach-avoid tubes" in result.output and "--nodes" in result.output
    assert "Every figure" in CliRunner().invoke(figure_command(), ["--help"]).output
