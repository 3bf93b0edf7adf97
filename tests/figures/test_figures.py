"""Every figure of the paper, drawn from coarse grids: complete, unclipped, solved once; and the scripts around them."""

import shutil
from dataclasses import replace

import fig04_sampled_data
import fig14_timing
import numpy as np
import pytest
import shrink
from artists import axes, named
from click.testing import CliRunner
from common import HERE, NAMES, Context, command_of, draw, script, starts_of_runs, title, write
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

import sdhj
from sdhj import plotting
from sdhj.common.remembering import read_only

# One number of each figure, or a few, that is drawn from data, on a grid of 9 nodes on each axis
VALUES = {
    "fig01_problem": 0.15186,
    "fig04_sampled_data": 0.79599,
    "fig06_reach_set": 0.05234,
    "fig07_game_cost": 0.03875,
    "fig08_lookup_table": [7, 6, 4, 3, 2],
    "fig09_spaces": 0.14309,
    "fig10_tubes": [0.03453, 0.03453, 0.0733, 0.12384, 0.15885, 0.20057, 0.24662, 0.28067, 0.31211],
    "fig11_projected": [0.03453, 0.03453, 0.06732, 0.11468, 0.14728, 0.17867, 0.21952, 0.25559, 0.28072],
    "fig12_trajectory": 0.5,
    "fig13_comparison": [0.63436, 0.60423, 0.9285, 0.93663, 0.87181, 0.90312],
    "fig13_isosurface": 0.03178,
    "fig14_timing": 2.78845,
    "extra_adversary": [0.27758, 0.0],
    "extra_air3d": [0.28806, 0.27636],
    "extra_certified": [0.01003, 0.27246],
    "extra_conservativeness": 0.89941,
    "extra_dcdc": 0.8578,
    "extra_evader": [0.0436, 0.0],
    "extra_fractions": [0.03453, 0.03453, 0.10098, 0.14294, 0.17245, 0.23023, 0.27894, 0.29991, 0.33362],
    "extra_input_levels": [0.30811, 0.31211],
    "extra_overview": 0.38174,
    "extra_rules": [3.6675, 2.64375, 3.58875, 3.47625],
    "extra_sensing": [0.30143, 0.13824],
    "extra_view_time": [0.10831, 0.16734, 0.10986],
    "extra_worked": [0.25507, 0.61931, 0.69825, 0.59583, 0.74844],
}
# Those whose lines, bars or images show the numbers above
CHARTS = {name for name in VALUES if name.startswith("extra")}
CHARTS -= {"extra_dcdc", "extra_overview", "extra_rules", "extra_worked"}
DIAGRAMS = {"fig02_offline", "fig03_online", "fig05_game"}
LEFT_OUT = {name for name in NAMES if not getattr(script(name), "MAIN_JOB", True)}


@pytest.fixture(scope="module")
def context() -> Context:
    return Context(nodes=9, runs=5)


@pytest.fixture(autouse=True)
def nothing_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 14 with made-up times: the main job's test measures them."""
    times = {"hji": {9: 0.5}, "projected": {9: 0.25}}
    names = "paper's scheme", "node updates", "default"
    monkeypatch.setattr(fig14_timing, "measure", lambda nodes, say: dict.fromkeys(names, times))


def sticks_out(figure: Figure) -> float:
    """By how many pixels something is beyond the edges of the figure."""
    with plotting.style():
        figure.draw_without_rendering()
        box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    return figure.dpi * max(-box.x0, -box.y0, box.x1 - width, box.y1 - height)


def test_every_figure_of_the_paper_is_there():
    assert [int(name[3:5]) for name in NAMES if name.startswith("fig")] == [*range(1, 14), 13, 14]
    for name in NAMES:
        said = title(name)
        assert said.startswith(f"Fig. {int(name[3:5])}: ") if name.startswith("fig") else len(said.split()) > 5, said
        assert 'if __name__ == "__main__":\n    command_of(__file__)()\n' in (HERE / f"{name}.py").read_text()
    assert VALUES.keys() | DIAGRAMS == set(NAMES)
    assert LEFT_OUT == {
        f"extra_{what}"
        for what in "adversary air3d certified dcdc evader input_levels rules sensing view_time worked".split()
    }


def numbers(figure: Figure) -> np.ndarray:
    """What lines, bars and images show; shares also where they are in percent."""
    found = [line.get_ydata() for ax in figure.axes for line in ax.lines]
    found += [[bar.get_height() for bar in ax.patches if isinstance(bar, Rectangle)] for ax in figure.axes]
    found += [np.ma.filled(image.get_array(), np.nan) for ax in figure.axes for image in ax.images]
    every = np.concatenate([np.ravel(one).astype(float) for one in found])
    return np.concatenate([every, every / 100])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_figures_are_drawn_whole_and_show_their_numbers(context, name):
    figure = draw(name, context)
    assert figure.axes and sticks_out(figure) < 1.0  # antialiasing
    if name in CHARTS:
        for one in np.ravel(VALUES[name]):
            assert np.nanmin(np.abs(numbers(figure) - one)) < 5e-4, one  # as below


@pytest.mark.slow
def test_the_way_through_the_table_is_framed(context):
    figure, run = draw("fig08_lookup_table", context), context.run
    framed = [ax.get_gid() for ax in figure.axes if ax.get_gid() and ax.spines["left"].get_linewidth() > 1.5]
    way = [f"cell-{k}-{n}" for k, n in enumerate(run.steps_to_go)]
    assert run.outcome == "reached" and framed == [*way, f"cell-{len(way)}-0"]


def test_ratios_of_times_are_those_of_the_times():
    left, right = axes(ncols=2)
    times = {"hji": {25: 8.0, 40: 60.0}, "projected": {25: 2.0, 40: 6.0}}
    fig14_timing.draw_timings((left, right), dict.fromkeys(("paper's scheme", "node updates", "default"), times))
    assert named(left, "default-hji")[0].get_xydata().tolist() == [[25, 8.0], [40, 60.0]]
    assert named(right, "default-ratio")[0].get_ydata().tolist() == [4.0, 10.0]
    assert named(right, "paper-ratio")[0].get_ydata()[[0, -1]] == pytest.approx([586 / 105, 5615 / 549])


LONG = LEFT_OUT | {"fig08_lookup_table", "fig13_isosurface"}  # the main job draws them, too


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in VALUES])
def test_values(context, name):
    assert script(name).value(context) == pytest.approx(VALUES[name], abs=5e-4)  # three nodes of 9^4


def test_a_run_starts_in_its_tube(context):
    table = context.table("hji")
    starts = starts_of_runs(table, 5, within=4)
    assert 1 <= len(starts) <= 5
    assert table.contains(starts, start=0, within=4).all()
    assert not table.contains(starts, start=0, within=3).any()
    assert np.array_equal(starts, starts_of_runs(table, 5, within=4))
    assert context.run.outcome == "reached"


def test_no_start_is_an_error(context):
    empty = sdhj.solve(sdhj.arm_case_study(nodes=9, steps=1), method="lax", progress=False)
    empty = replace(empty, tubes=read_only(np.ones_like(empty.tubes)))
    with pytest.raises(ValueError, match="20000 states is admissible"):
        starts_of_runs(empty, 3)


def test_sampled_run_holds_its_input():
    run = fig04_sampled_data.sampled_run(wind=0.0, turn=0.0, delta=0.2, intervals=4)
    assert set(run.held.ravel()) <= set(run.levels)
    per = (len(run.times) - 1) // 4
    for k in range(4):  # without wind and current the boat moves in straight lines
        piece = run.states[k * per : (k + 1) * per + 1]
        assert np.allclose(np.diff(piece, axis=0) / np.diff(run.times[: per + 1])[:, None], run.held[k])
    assert not np.allclose(fig04_sampled_data.sampled_run(seed=1).states, fig04_sampled_data.sampled_run(seed=2).states)


@pytest.mark.slow
def test_write_and_refusals(context, tmp_path):
    files = write("fig09_spaces", context, tmp_path / "new" / "folder", formats=("svg",))
    assert [path.name for path in files] == ["fig09_spaces.svg"] and files[0].stat().st_size > 5000
    assert 'id="pursuer' in files[0].read_text()
    with pytest.raises(ValueError, match="figure"):
        draw("fig99", context)
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="choose a folder"):
        write("fig09_spaces", context, tmp_path / "file")


def test_the_gallery_has_pictures_of_all():
    assert {path.stem for path in (HERE / "gallery").glob("*.png")} > set(NAMES)


# ---- the scripts


@pytest.mark.slow
def test_a_script_writes_its_figure_and_the_gallery_shows_it_small(tmp_path, monkeypatch):
    given = ["--nodes", "9", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(command_of("fig09_spaces.py"), given)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["fig09_spaces.pdf", "fig09_spaces.png"]
    assert "fig09_spaces.pdf" in result.output
    monkeypatch.setattr(shrink, "HERE", tmp_path)
    (tmp_path / "gallery").mkdir()
    for name in ("fig09_spaces", "fig10_tubes"):  # the arm in both, its grid in one
        (tmp_path / f"{name}.py").write_text((HERE / f"{name}.py").read_text("utf-8"), "utf-8")
    shutil.copy(tmp_path / "out" / "fig09_spaces.png", tmp_path / "out" / "fig10_tubes.png")
    shrink.shrink(tmp_path / "out", nodes="9")
    small = tmp_path / "gallery" / "fig09_spaces.png"
    with Image.open(small) as image, Image.open(tmp_path / "gallery" / "fig10_tubes.png") as computed:
        assert image.width == shrink.WIDTH
        assert "nodes" not in image.info and computed.info["nodes"] == "9"
    assert 5000 < small.stat().st_size < 40_000
