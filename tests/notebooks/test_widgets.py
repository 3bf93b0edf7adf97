"""The widgets' callbacks at the corners of their sliders; what they show is asserted as numbers, not as pixels."""

import base64
import gc
import html
import io
import json
import re
import threading
import time
import warnings
from collections.abc import Callable
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import frames
import numpy as np
import pytest
import zoo
from chapters import functions
from course import widgets
from course.chapter_01 import combine, explore_nodes, explore_sets
from course.chapter_02 import carry, explore_schemes, explore_upwinding
from course.chapter_03 import explore_value
from course.chapter_04 import draw_plane_game, explore_holding, explore_interval
from course.chapter_05 import explore_games
from course.chapter_06 import draw_both_spaces, explore_spaces, explore_view_time
from course.chapter_07 import explore_filling, explore_plane_game, explore_row, filling
from course.chapter_08 import explore_arm_game, explore_growing, explore_pursuer, explore_tube
from course.chapter_09 import explore_gap, explore_surface, paint, turned
from course.chapter_11 import explore_lookup, explore_pursuit, explore_run
from course.chapter_12 import explore_interpolation
from course.chapter_13 import explore_certified, explore_line
from course.chapter_14 import explore_evader
from course.chapter_15 import explore_car, reference_car
from course.chapter_16 import draw_line_sets, explore_sensing
from course.chapter_17 import explore_tracking
from course.paper import paper_figure, starts_of_runs
from course.robots import one_interval, point_robot
from course.slices import slice_values, steps_image
from matplotlib.figure import Figure
from PIL import Image

import sdhj
from sdhj.plotting import plane
from sdhj.plotting.looks import style
from sdhj.table.table import LookupTable

pytestmark = pytest.mark.slow  # most of them solve the four-dimensional case study
PNG = b"\x89PNG"
SMALL = 9  # nodes: the smallest grid on which the case study's target is held


def ends(control: Any) -> tuple[Any, Any]:
    if hasattr(control, "options"):
        return control.options[0], control.options[-1]
    return control.min, control.max


def pixels(png: bytes) -> Any:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def drawn_anew(explorer: widgets.Explorer) -> Any:
    """The explorer's picture on one of Matplotlib's own figures, its axes where the explorer has them."""
    kept = explorer.figure

    class Placed(Figure):
        def add_subplot(self, *args: Any, **options: Any) -> Any:
            ax = super().add_subplot(*args, **options)
            ax.set_position(kept.axes[len(self.axes) - 1].get_position(original=True))
            return ax

    with style():
        figure = Placed(kept.get_size_inches(), dpi=widgets.DPI)
    return pixels(widgets.render(explorer.draw, figure, **explorer.values)[0])


def edges(explorer: widgets.Explorer) -> Any:
    """The colours of the pixels around the explorer's picture."""
    shown = pixels(explorer.png)
    return np.concatenate((shown[0], shown[-1], shown[:, 0], shown[:, -1]))


def visit_corners(explorer: widgets.Explorer) -> list[dict[str, Any]]:
    """Move every control to both ends on its own, then all at once; the numbers shown at each stop.

    A control shows another picture at one end at least, or is greyed. At one end of each, and for one end of all, the
    picture is compared to one on a figure that never showed another.
    """
    shown, first, before = [], explorer.values, explorer.png

    def stop(fresh: int, **values: Any) -> bytes:
        shown.append(dict(explorer.set(**first | values)))
        assert explorer.error == "", f"{values}: {explorer.error}"
        assert explorer.png.startswith(PNG) and gc.isenabled()
        assert edges(explorer).min() > 200, f"{values}: something is cut off"
        if fresh:
            np.testing.assert_array_equal(pixels(explorer.png), drawn_anew(explorer), err_msg=str(values))
        return explorer.png

    for name, control in explorer.controls.items():
        moved = {stop(side, **{name: ends(control)[side]}) for side in (0, 1)} - {before}
        explorer.set(**first)
        assert bool(moved) is not control.disabled, name
    for side in (0, 1):
        stop(side, **{name: ends(control)[side] for name, control in explorer.controls.items()})
    explorer.set(**first)
    return shown


# ---- every explorer, at its corners


class Tables:
    """The small tables that explorers show, each solved where it is asked for first."""

    @cached_property
    def arm(self) -> LookupTable:
        return sdhj.solve(sdhj.arm_case_study(nodes=SMALL, steps=3), progress=False)

    @cached_property
    def projected(self) -> LookupTable:
        return sdhj.solve(self.arm.problem, method="projected", progress=False)

    @cached_property
    def proved(self) -> Any:
        return sdhj.solve(self.arm.problem, sdhj.Certified(cells=(42, 42, 12, 12)), progress=False)

    @cached_property
    def point(self) -> LookupTable:
        return sdhj.solve(point_robot(25), progress=False)

    @cached_property
    def car(self) -> LookupTable:
        return sdhj.solve(reference_car((17, 17, 16)), progress=False)

    def starts(self) -> list[list[float]]:
        return [list(map(float, q)) for q in starts_of_runs(self.arm, 2, within=2)]


@pytest.fixture(scope="module")
def tables() -> Tables:
    return Tables()


@pytest.fixture
def arm(tables: Tables) -> LookupTable:
    return tables.arm


@pytest.fixture
def point(tables: Tables) -> LookupTable:
    return tables.point


def certify(cells: int, wind: Fraction) -> dict[tuple[int, int], tuple[int, int | None]]:
    return {(0, cell): (0, None) for cell in range(0, cells, 1 + int(10 * wind))}


def drive(controller: Any, sensing: Any) -> tuple[Any, Any]:
    """Sixty paths; who does not reckon with an error of so many cm is lost in so many of them."""
    paths = np.cumsum(np.full((60, 9, 2), 0.01), axis=1) + np.linspace(-0.5, 0.5, 60)[:, None, None]
    return paths, np.arange(60) < 100 * sensing.error * (not controller.problem.sensing)


def follow(inputs: Any, torque: float, ratio: float) -> tuple[Any, ...]:
    times = np.linspace(0.0, 0.8, 81)
    reference = np.tile(inputs.max() * times, (1, 1))
    return times, reference, reference - ratio / torque, np.full((1, 81), torque)


def two_motors() -> sdhj.ReachAvoidProblem:
    """A point that two motors move, quickly solved."""
    target = sdhj.TargetSet((0, 1), lambda p, t: np.abs(p).max(axis=1) - 0.4)
    return zoo.plane(push=0.05, grid=sdhj.Grid([-1.5, -1.2], [1.5, 1.2], [25, 21]), target=target, delta=0.4, steps=2)


def moved(explorer: widgets.Explorer, **values: Any) -> widgets.Explorer:
    explorer.set(**values)
    return explorer


AT = {"q1": 0.6, "q2": 1.2, "px": 0.15, "py": 0.24}  # a posture of the arm in the target, and a place of its pursuer
THIN = {"nodes": 11, "thickness": 0.1}
EXPLORERS: dict[str, tuple[Callable[[Tables], widgets.Explorer], str, list[dict[str, Any]]]] = {
    # the explorer, a number that it shows, settings by which the number grows
    "sets": (
        lambda of: explore_sets(nodes=41),
        "area of the result",
        [{"operation": "intersection"}, {"operation": "union"}, {"operation": "union", "radius": 0.8}],
    ),
    "nodes": (
        lambda of: explore_nodes(),
        "nodes inside",
        [THIN | {"shift": 0.1}, THIN | {"shift": 0.0}, {"nodes": 41, "thickness": 0.6, "shift": 0.0}],
    ),
    "upwinding": (
        lambda of: explore_upwinding(),
        "largest error (m)",
        [{"difference": "right", "velocity": 1.0, "nodes": 80, "cfl": cfl} for cfl in (1.0, 0.75, 1.5)],
    ),
    "schemes": (
        lambda of: explore_schemes(),
        "mean error near the boundary (m)",
        [*({"order": order} for order in (3, 2, 1)), {"order": 1, "flux": "lax-friedrichs"}],
    ),
    "value": (lambda of: explore_value(functions("03_the_value_function.ipynb", "ride", "solve")["games"]), "", []),
    "games": (
        lambda of: explore_games(*map(functions("05_three_games.ipynb", "g1", "game_1").get, ("rail", "games"))),
        "",
        [],
    ),
    "interval": (
        lambda of: explore_interval(nodes=25),
        "share of the lake in the reach-avoid set",
        [{"show": "reach-avoid", "x": -0.4, "y": 0.2, "wind": wind} for wind in (0.5, 0.0)],
    ),
    "holding": (
        lambda of: explore_holding(nodes=15),
        "share of the square inside",
        [{"intervals": n} for n in (1, 2, 4)],
    ),
    "plane game": (lambda of: explore_plane_game(nodes=15), "within 4", [{"v_max": 0.5}, {"v_max": 0.0}]),
    "filling": (lambda of: explore_filling(of.point), "tubes", [{"made": 0}, {"made": 8}]),
    "row": (lambda of: explore_row(of.point), "tubes that hold the point", [{"start": 4, "x": -0.9}, {"x": 0.45}]),
    "spaces": (
        lambda of: explore_spaces(of.arm.problem),
        "unsafe sets (m, collision below 0)",
        [AT | {"px": 0.0, "py": 0.0}, AT],
    ),
    "view time": (
        lambda of: explore_view_time(sdhj.arm_case_study(nodes=SMALL, delta=0.4, steps=2)),
        "of it missed by the samples",
        [{"step": 1, "samples": n} for n in (20, 2, 1)],
    ),
    "tube": (lambda of: explore_tube(of.arm), "share of C inside", [{"start": 0, "within": n} for n in (1, 2, 3)]),
    "growing": (lambda of: explore_growing(steps=3), "", []),
    "pursuer": (
        lambda of: moved(explore_pursuer(of.arm), q1=0.6, q2=1.2),  # where the pursuer's place decides
        "share of the pursuer's places",
        [{"q1": -1.5, "q2": 0.0, "within": 0}, {"q1": 0.6, "q2": 1.2, "start": 0, "within": 3}],
    ),
    "gap": (
        lambda of: explore_gap(of.arm, of.projected),
        "slice inside, hji",
        [{"start": 0, "within": n} for n in (0, 3)],
    ),
    "surface": (lambda of: explore_surface({"full": of.arm, "projected": of.projected}), "", []),
    "interpolation": (
        lambda of: explore_interpolation(),
        "largest error",
        [{"kind": "one target", "cells": cells, "shift": 0.0} for cells in (40, 20, 10)],
    ),
    "line": (lambda of: explore_line(certify, lambda t: (1.0 - t, 1.2 - t)), "", []),
    "lookup": (lambda of: explore_lookup(of.arm), "", []),
    "pursuit": (lambda of: explore_pursuit(of.arm, of.starts()), "", []),
    "certified": (
        lambda of: explore_certified(of.arm, of.proved),
        "slice inside by interpolation",
        [{"start": 0, "within": n} for n in (0, 3)],
    ),
    "arm game": (
        lambda of: explore_arm_game(nodes=7, method="lax"),
        "share of C inside",
        [{"v_d": speed} for speed in (2.0, 0.0)],
    ),
    "evader": (
        lambda of: explore_evader(nodes=9, method="lax"),
        "share of C inside",
        [{"v_e": speed} for speed in (0.6, 0.0)],
    ),
    "run at random": (
        lambda of: explore_run(of.arm, of.starts(), adversaries=("worst", "random"), rules=("deepest", "effort")),
        "",
        [],
    ),
    "run": (
        lambda of: explore_run(of.arm, of.starts(), rules=("deepest", "effort")),
        "time (s)",
        [{"moment": moment} for moment in (0, 48, 100)],
    ),
    "car": (
        lambda of: explore_car(of.car),
        "share of places for this heading",
        [{"within": n, "heading": 0.0} for n in (0, 1, 2)],
    ),
    "sensing": (
        lambda of: explore_sensing(two_motors(), drive),
        "lost, does not, as it is",
        [{"error": error} for error in (0.0, 0.02, 0.08)],
    ),
    "tracking": (
        lambda of: explore_tracking(follow, lambda change, torque: change / torque),
        "largest distance (rad)",
        [{"torque": 4.0, "u_max": 3.0, "ratio": ratio} for ratio in (1.0, 2.0)],
    ),
}


def test_no_explorer_is_left_out() -> None:
    texts = (path.read_text("utf-8") for path in Path(widgets.__file__).parent.glob("chapter_*.py"))
    made = {name for text in texts for name in re.findall(r"^def explore_(\w+)", text, re.MULTILINE)}
    assert made <= {name.replace(" ", "_") for name in EXPLORERS}


@pytest.mark.parametrize("name", EXPLORERS)
def test_every_explorer_at_its_corners(name: str, tables: Tables) -> None:
    """Drawn there without an error; shares are shares; and what its chapter says grows does."""
    make, number, growing = EXPLORERS[name]
    explorer = make(tables)
    first, shown = explorer.values, visit_corners(explorer)
    shares = [value for told in shown for key, value in told.items() if "share" in key or "slice" in key]
    assert all(0.0 <= share <= 1.0 for share in shares)
    found = [float(explorer.set(**first | setting)[number]) for setting in growing]
    assert explorer.error == "" and found == sorted(set(found))


def test_what_explorers_of_the_arm_show_is_what_its_table_answers(arm: LookupTable) -> None:
    state, step = np.array([list(AT.values())]), 1
    shown = explore_spaces(arm.problem).set(**AT, step=float(step))
    assert shown["target (m, inside below 0)"] == pytest.approx(float(arm.problem.target_value(state, 0.1)[0]))
    assert shown["unsafe sets (m, collision below 0)"] == pytest.approx(float(arm.problem.unsafe_value(state, 0.1)[0]))
    held = sdhj.Controller(arm).steps_to_go(state[0], 0)
    tube, lookup = explore_tube(arm), explore_lookup(arm)
    assert lookup.set(**AT)["steps to go from step 0"] == held
    for axes in tube.controls["axes"].options:  # the same state on every slice
        assert tube.set(axes=axes, **AT, start=0, within=3)["steps to go of this state"] == held
        assert tube.numbers["share of C inside"] == arm.fraction(start=0, within=3)
    assert lookup.set(px=0.0, py=0.0)["steps to go from step 0"] == "none"  # on the arm's base
    starts = starts_of_runs(arm, 2, within=2)
    run = sdhj.simulate(sdhj.Controller(arm, rule="effort"), starts[1], adversary="aggressive", seed=3)
    runs = explore_run(arm, [list(map(float, q)) for q in starts], rules=("deepest", "effort"))
    shown = runs.set(number=1, adversary="aggressive", rule="effort", seed=3, moment=100)
    assert (shown["outcome"], shown["steps taken"]) == (run.outcome, len(run.inputs))
    assert explore_gap(arm, arm).numbers["in hji and not in hji"] == 0.0


def test_the_table_is_filled_from_below_each_tube_from_two_that_are_there(point: LookupTable) -> None:
    steps, order = point.steps, filling(point.steps)
    tubes = [entry for entry in order if entry[1] is not None]
    assert len(set(order)) == len(order) == (steps + 1) * (steps + 2) // 2 + steps
    for place, (k, n) in enumerate(order):
        needed = {(k, n - 1), (k + 1, n - 1), (k, None)} if n else set()
        assert needed <= set(order[:place])
    games = len(point.problem.inputs) * steps * (steps + 1) // 2  # (7.2)
    last = {"made last": f"tube k = 0, n = {steps}", "tubes": len(tubes), "games to reach": games}
    whole = explore_filling(point).set(made=len(order))
    assert whole == last | {"games to avoid": len(point.problem.inputs) * steps}


def test_a_slice_without_a_free_posture_says_so(arm: LookupTable) -> None:
    """With the pursuer on the arm's base every configuration collides: there is no outline to draw."""
    for state, full in (((0.3, -1.0, 0.24, 0.24), False), ((0.3, -1.0, 0.0, 0.0), True)):
        figure = Figure()
        draw_both_spaces(figure, arm.problem, state=state)
        drawn = {artist.get_gid() for artist in figure.axes[1].get_children()}
        assert ("pursuer-full" in drawn) is full and ("pursuer-edge" in drawn) is not full


def test_a_tube_grows_step_by_step_to_what_the_chapter_says() -> None:
    """Step by step, to more than with the case study's own eight intervals; and where it has grown to."""
    explorer = explore_growing()
    shares = [explorer.set(within=n)["share of C inside"] for n in range(21)]
    assert explorer.error == "" and shares == sorted(set(shares))
    eight = sdhj.solve(sdhj.arm_case_study((25, 25, 13, 13)), progress=False, play=False)
    assert round(shares[-1], 2) == 0.43 and round(eight.fraction(start=0, within=8), 2) == 0.37  # as chapter 8 says


def test_turning_keeps_lengths(rng: np.random.Generator) -> None:
    points = rng.normal(size=(20, 3))
    seen = turned(points, 37.0, -12.0)
    np.testing.assert_allclose(np.linalg.norm(seen, axis=1), np.linalg.norm(points, axis=1), rtol=1e-12)
    towards = turned(np.array([[1.0, 0.0, 0.0]]), 0.0, 0.0)
    np.testing.assert_allclose(towards, [[0.0, 0.0, 1.0]], atol=1e-12)  # seen from the x axis, it points at us


def test_paint_shows_the_nearest_triangle(rng: np.random.Generator) -> None:
    """Each pixel on its own: barycentric coordinates from a linear system, then the highest of all that hold it."""
    side = 24
    triangles = rng.uniform(-6, side + 6, (30, 3, 3))  # some of them partly outside
    triangles[0, 2] = (triangles[0, 0] + triangles[0, 1]) / 2  # seen from its side
    colours = rng.integers(0, 255, (30, 3)).astype(np.uint8)
    image, heights = np.zeros((side, side, 4), dtype=np.uint8), np.full((side, side), -np.inf)
    paint(triangles, colours, image, heights)
    expected = np.zeros_like(image)
    for y, x in np.ndindex(side, side):
        found = []
        for place, triangle in enumerate(triangles[1:], 1):
            shares = np.linalg.solve(np.vstack([triangle[:, :2].T, np.ones(3)]), (x, y, 1.0))
            if shares.min() >= 0:
                found.append((shares @ triangle[:, 2], place))
        if found:
            height, place = max(found)
            expected[y, x] = *colours[place], 255
            assert heights[y, x] == pytest.approx(height, abs=1e-9)  # rounding of coordinates up to 30
    np.testing.assert_array_equal(image, expected)


def test_what_a_coarse_grid_hides_is_told_below_the_picture_also_the_second_time() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        explorer = explore_arm_game(nodes=15, method="lax")
        for moved in (1.0, 0.3):
            assert "nodes" in explorer.note and html.escape(explorer.note) in explorer.panel().children[1].value
            explorer.set(v_d=moved)
    assert explore_arm_game(nodes=7, method="lax").note == ""  # every cell is near a node that sees


def test_sets_of_a_line_are_drawn_where_they_are() -> None:
    ax = Figure().subplots()
    rows = [("above", [(Fraction(-1, 2), Fraction(1, 2))], "true"), ("below", [(-0.3, -0.1), (0.1, 0.3)], "known")]
    draw_line_sets(ax, rows, 0.1)
    bars = {(line.get_gid(), *line.get_xdata(), line.get_ydata()[0]) for line in ax.lines if line.get_gid() != "box"}
    assert bars == {("above", -0.5, 0.5, 1), ("below", -0.3, -0.1, 0), ("below", 0.1, 0.3, 0)}
    assert [label.get_text() for label in ax.get_yticklabels()] == ["below", "above"]


# ---- the explorer itself


def draw_share(figure: Any, share: float) -> dict[str, float]:
    if share > 0.8:
        raise ValueError("share must be at most 0.8")
    figure.subplots().plot([0, 1], [0, share])
    return {"share": share}


def slider(value: float) -> Any:
    return widgets.slider("share", 0.0, 1.0, 0.1, value)


def taken_in(shown: dict[str, str]) -> tuple[bytes, str]:
    """The PNG file and the words of a picture, as a reader of HTML has them."""
    (image,) = ElementTree.fromstring(f"<p>{shown['text/html'].removesuffix('>')}/></p>")
    assert image.attrib["alt"] == shown["text/plain"] and set(image.attrib) == {"src", "alt"}
    kind, encoded = image.attrib["src"].split(",")
    assert (image.tag, kind) == ("img", "data:image/png;base64")
    return base64.b64decode(encoded), image.attrib["alt"]


def test_words_beside_a_picture_stay_words() -> None:
    said = """a < b & "c" > 'd'"""
    assert taken_in(widgets.as_html(PNG, said)) == (PNG, said)


def test_a_refused_setting_greys_the_picture_and_names_what_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    class Shown:
        images: ClassVar[list[Any]] = []

        def update(self, image: Any, raw: bool) -> None:
            self.images.append(taken_in(image))

    monkeypatch.setattr(widgets, "display", lambda *_, **__: Shown())
    controls = {"share": slider(0.5), "pace": widgets.slider("pace", 0, 9, 1, 3)}
    explorer = widgets.Explorer(lambda figure, share, pace: draw_share(figure, share), controls)
    explorer._ipython_display_()
    widgets.SHOWN.remove(explorer)
    assert explorer.set(share=0.9) == {"share": 0.5} and "at most 0.8" in explorer.error and gc.isenabled()
    png, alt = Shown.images[-1]
    grey = Image.open(io.BytesIO(png))
    assert np.ptp(np.asarray(grey.convert("RGB")).astype(int), axis=2).max() == 0
    assert alt.startswith("still the picture of share: 0.5. ")  # and not of pace, which is the same
    explorer.set(share=0.2)
    assert Shown.images[-1][0] == explorer.png and len(Shown.images) == 2


def test_frames_go_from_one_end_to_the_other_and_leave_no_trace() -> None:
    explorer = widgets.Explorer(draw_share, {"share": slider(0.5)})
    before = explorer.numbers, explorer.values, explorer.error
    found = list(frames.frames_of(explorer))
    assert [value for value, _, _ in found] == [f"{n / 10:g}" for n in range(9)]  # 0.9 and 1.0 are refused
    assert len({png for _, png, _ in found}) == len(found)
    assert all(said == f"share: {value}" for value, _, said in found)
    assert (explorer.numbers, explorer.values, explorer.error) == before
    np.testing.assert_array_equal(pixels(explorer.png), drawn_anew(explorer))


def test_frames_are_written_one_below_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    controls = {"share": widgets.slider("share", 0.0, 0.75, 0.01, 0.5), "moment": widgets.slider("moment", 0, 3, 1, 1)}
    explorer = widgets.Explorer(
        lambda figure, share, moment: draw_share(figure, share),
        controls,
        size=(3.0, 2.0),
        alt="a line",
        named=(0.33,),
        process="moment",
    )
    monkeypatch.setattr(frames, "SHOWN", [explorer])
    (tmp_path / "01_new-9-gone.webp").touch()  # of a widget that is no more
    frames.write_frames(tmp_path, "01_new", "a hash")
    told = json.loads((tmp_path / "01_new.json").read_text("utf-8"))
    share, moment = told["widgets"]
    assert told["code"] == "a hash" and (share["control"], share["at"], share["alt"]) == ("share", "0.5", "a line")
    assert share["named"] == ["0.33"] and {"0", "0.33", "0.5", "0.75"} < set(share["values"]) and not share["loop"]
    assert frames.FRAMES - 2 <= len(share["values"]) <= frames.FRAMES
    assert moment["loop"] and moment["values"] == ["0", "1", "2", "3"] and moment["widget"] == share["widget"]
    for strip in (share, moment):
        width, height = strip["size"]
        assert Image.open(tmp_path / strip["file"]).size == (width, height * len(strip["values"]))
    assert sorted(path.name for path in tmp_path.glob("*.webp")) == sorted((share["file"], moment["file"]))


def test_a_setting_that_comes_while_another_is_drawn_is_drawn_next() -> None:
    """Of three that come meanwhile only the last."""
    begun, go_on, drawn = threading.Event(), threading.Event(), []

    def draw(figure: Any, share: float) -> dict[str, float]:
        drawn.append(share)
        if share == 0.1:
            begun.set()
            assert go_on.wait(20)
        return draw_share(figure, share)

    explorer = widgets.Explorer(draw, {"share": slider(0.5)})
    moves = [threading.Thread(target=explorer.set, kwargs={"share": value}) for value in (0.1, 0.2, 0.3, 0.4)]
    moves[0].start()
    assert begun.wait(20)
    for value, thread in zip((0.2, 0.3, 0.4), moves[1:], strict=True):
        thread.start()
        while explorer.controls["share"].value != value:
            time.sleep(0.001)
    go_on.set()
    for thread in moves:
        thread.join()
    assert drawn == [0.5, 0.1, 0.4] and explorer.numbers == {"share": 0.4}


def test_a_first_setting_that_is_refused_raises() -> None:
    with pytest.raises(ValueError, match=r"at most 0\.8"):
        widgets.Explorer(draw_share, {"share": slider(0.9)})


@pytest.mark.parametrize("slow", [False, True])
def test_what_goes_wrong_is_said_whatever_it_is(slow: bool) -> None:
    """A callback that raises is silent in a notebook, and an Output widget swallows what is raised within it."""

    def draw(figure: Any, share: float) -> dict[str, float]:
        if share > 0.8:
            raise KeyError("<nothing> there")
        return draw_share(figure, share)

    explorer = widgets.Explorer(draw, {"share": slider(0.5)}, slow=slow)
    explorer.set(share=0.9)
    assert explorer.error == "KeyError: '<nothing> there'"
    told = explorer.panel().children[1]
    assert "role='alert'" in told.value and "&lt;nothing&gt;" in told.value
    explorer.set(share=0.5)  # the setting that the picture still shows
    assert explorer.error == "" and "role='alert'" not in told.value


def test_a_value_that_comes_back_rounded_draws_nothing() -> None:
    drawn = []

    def draw(figure: Any, share: float, angle: float) -> dict[str, float]:
        drawn.append((share, angle))
        return draw_share(figure, share)

    explorer = widgets.Explorer(draw, {"share": slider(0.1), "angle": widgets.angle("angle", 0.3)})
    explorer.set(share=0.09999999999999998)
    explorer.controls["angle"].slider.value = 0.2999999999999998
    assert drawn == [(0.1, 0.3)]
    explorer.controls["angle"].slider.value = 1.2400000000000002
    explorer.set(angle=-0.777)
    assert drawn[1:] == [(0.1, 1.24), (0.1, -0.777)]


# ---- the figure that it draws on


def draw_anything(figure: Figure, axes: int, wide: bool, share: float) -> None:
    """Other axes, ticks, labels, limits, legends, frames and words at each setting."""
    row = figure.subplots(1, axes, squeeze=False, sharey=axes == 3)[0]
    for number, ax in enumerate(row):
        ax.plot([0, 1], [0, 1 + share], label="a line")
        if wide:
            ax.set(xticks=[0.1, 0.5], ylabel="height", title="wide", ylim=(-3, 3))
        if share > 0.5:
            ax.legend()
            ax.set(xlabel=f"{share}", aspect="equal")
            ax.imshow(np.eye(3) * share)
        elif number:
            ax.axis("off")
            ax.text(0.5, 0.5, "no frame")
    if share > 0.8:
        figure.legend(handles=row[0].lines)
        figure.text(0.5, 0.5, "on top")


def test_a_figure_forgets_what_it_showed() -> None:
    controls = {"axes": widgets.slider("axes", 1, 3, 1, 2), "wide": widgets.choice("wide", (False, True), False)}
    explorer = widgets.Explorer(draw_anything, controls | {"share": slider(0.5)})
    tried = [(2, True, 0.5), (2, True, 0.6), (2, False, 0.9), (2, False, 0.2), (2, True, 0.2), (1, False, 0.2)]
    for axes, wide, share in [*tried, (3, True, 1.0), (3, True, 0.1), (2, False, 0.9), (2, False, 0.0)]:
        explorer.set(axes=axes, wide=wide, share=share)
        np.testing.assert_array_equal(pixels(explorer.png), drawn_anew(explorer), err_msg=f"{axes}, {wide}, {share}")


def test_what_was_refused_half_drawn_leaves_no_trace() -> None:
    def draw(figure: Figure, share: float) -> None:
        left, right = figure.subplots(1, 2)
        left.plot([0, share])
        if share > 0.8:
            raise ValueError("not more than 0.8")
        right.plot([share, 0])
        right.set_title(r"$\no$" if share > 0.6 else "")  # fails only when it is drawn

    explorer = widgets.Explorer(draw, {"share": slider(0.5)})
    for refused in (0.9, 0.7):
        explorer.set(share=refused)
        assert explorer.error
        explorer.set(share=0.2)
        np.testing.assert_array_equal(pixels(explorer.png), drawn_anew(explorer))
        explorer.set(share=0.5)


def shown_by(act: Callable[[], Any], monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    shown: list[Any] = []
    monkeypatch.setattr(widgets, "display", lambda thing, **options: shown.append(thing))
    act()
    return shown


def test_a_page_without_a_kernel_has_text_and_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    explorer = widgets.Explorer(draw_share, {"share": slider(0.5)}, alt="a line")
    panel, image = shown_by(explorer._ipython_display_, monkeypatch)
    assert widgets.VIEW in panel and "share (0.5)" in panel["text/plain"] and "Shown: share: 0.5" in panel["text/plain"]
    assert taken_in(image) == (explorer.png, "a line. share: 0.5") and explorer.png.startswith(PNG)


def test_pictures_of_axes_and_of_the_paper(monkeypatch: pytest.MonkeyPatch, point: LookupTable) -> None:
    (image,) = shown_by(lambda: widgets.picture(draw_plane_game, point, size=(3.0, 3.0)), monkeypatch)
    png, alt = taken_in(image)
    assert png.startswith(PNG) and alt.startswith("Tubes of a robot")
    (image,) = shown_by(lambda: paper_figure("fig05_game"), monkeypatch)
    assert taken_in(image)[1] == "Fig. 5: The policy moves the robot; the adversary disturbs it and moves the pursuer"
    with pytest.raises(ValueError, match="figure"):
        paper_figure("fig99")


# ---- slices and lessons


@pytest.mark.parametrize("axes", [(0, 1), (2, 3), (0, 2), (1, 3)])
def test_slice_values_are_multilinear(axes: tuple[int, int], rng: np.random.Generator) -> None:
    grid = sdhj.arm_case_study(nodes=(7, 8, 5, 6)).grid
    values = rng.normal(size=grid.shape).astype(np.float32)
    through = rng.uniform(grid.lower, grid.upper)
    where = plane(grid, through, axes, resolution=23)
    found = slice_values(grid, values, through, axes, where.x, where.y)
    np.testing.assert_allclose(found, where.of(grid, values), atol=1e-12)  # float64 rounding of sums of 16 terms


def test_steps_image_agrees_with_contains(arm: LookupTable) -> None:
    through = (0.0, 0.0, 0.2, -0.1)
    image = steps_image(arm, through=through, start=1, within=2, resolution=31)
    where = plane(arm.grid, through, resolution=31)
    expected = np.full(image.size, 3)
    for n in (2, 1, 0):
        expected[arm.contains(where.points, start=1, within=n)] = n
    assert np.mean(image.ravel() != expected) < 0.002  # values within rounding of zero may fall on either side


def test_one_interval_makes_the_table(point: LookupTable) -> None:
    """Theorem 2, by hand: the union over inputs of reach and avoid, and the tube before."""
    by_hand = point.values(start=1, within=1)
    for j in range(len(point.problem.inputs)):
        by_hand = np.minimum(by_hand, np.maximum(*one_interval(point.problem, j, start=1, within=2)))
    np.testing.assert_allclose(by_hand, point.values(start=1, within=2), atol=1e-6)


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda: combine(np.zeros(1), np.zeros(1), "xor"), "operation"),
        (lambda: carry("upwind"), "difference"),
    ],
)
def test_unknown_options_are_refused(act: Callable[[], Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        act()
