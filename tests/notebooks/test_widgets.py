"""The widgets' callbacks at the corners of their sliders; what they show is asserted as numbers, not as pixels."""

import gc
import io
import json
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar

import frames
import matplotlib as mpl
import numpy as np
import pytest
from course import widgets
from course.chapter_01 import area, canvas, combine, explore_nodes, explore_sets, rectangle
from course.chapter_02 import carry, explore_schemes, explore_upwinding, shrink
from course.chapter_04 import draw_plane_game, explore_holding, explore_interval
from course.chapter_06 import draw_both_spaces, explore_spaces, explore_view_time, union_of_samples
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
from matplotlib.axis import Tick
from matplotlib.figure import Figure
from PIL import Image

import sdhj
from sdhj.plotting import plane
from sdhj.plotting.looks import style
from sdhj.solver.schemes import Scheme
from sdhj.table.table import LookupTable

pytestmark = pytest.mark.slow  # most of them solve the four-dimensional case study
PNG = b"\x89PNG"
SMALL = 9  # nodes: the smallest grid on which the case study's target is held


@pytest.fixture(scope="module")
def arm() -> LookupTable:
    return sdhj.solve(sdhj.arm_case_study(nodes=SMALL, steps=3), progress=False)


@pytest.fixture(scope="module")
def projected(arm: LookupTable) -> LookupTable:
    return sdhj.solve(arm.problem, method="projected", progress=False)


@pytest.fixture(scope="module")
def point() -> LookupTable:
    return sdhj.solve(point_robot(25), progress=False)


@pytest.fixture(scope="module")
def car_table() -> LookupTable:
    return sdhj.solve(reference_car((17, 17, 16)), progress=False)


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


def visit_corners(explorer: widgets.Explorer) -> list[dict[str, Any]]:
    """Move every control to both ends on its own, then all at once; the numbers shown at each stop.

    At one end of each, and for one end of all, the picture is compared to one on a figure that never showed another.
    """
    shown = []
    first = explorer.values
    stops = [{name: end} for name, control in explorer.controls.items() for end in ends(control)]
    stops += [{name: ends(control)[side] for name, control in explorer.controls.items()} for side in (0, 1)]
    for place, stop in enumerate(stops):
        shown.append(dict(explorer.set(**first | stop)))
        assert explorer.error == "", f"{stop}: {explorer.error}"
        assert explorer.png.startswith(PNG)
        if place % 2:
            np.testing.assert_array_equal(pixels(explorer.png), drawn_anew(explorer), err_msg=str(stop))
    explorer.set(**first)
    return shown


# ---- every explorer, at its corners


def test_sets_at_the_corners() -> None:
    explorer = explore_sets(nodes=41)
    for shown in visit_corners(explorer):
        assert 0.0 <= shown["area of the result"] <= shown["area of A"] + shown["area of B"]
    whole = explorer.set(operation="union")
    parts = whole["area of A"] + whole["area of B"]
    assert whole["area of the result"] + explorer.set(operation="intersection")["area of the result"] == pytest.approx(
        parts,
        abs=0.02,  # inclusion and exclusion, up to what interpolation cuts off at corners
    )
    assert explorer.set(radius=0.8)["area of A"] > 2 * whole["area of A"]


def test_nodes_at_the_corners() -> None:
    explorer = explore_nodes()
    visit_corners(explorer)
    lost = explorer.set(nodes=11, thickness=0.1, shift=0.1)  # between two rows of nodes
    assert (lost["nodes inside"], lost["area held"]) == (0, 0.0)
    assert explorer.set(shift=0.0)["nodes inside"] > 0
    fine = explorer.set(nodes=41, thickness=0.6, shift=0.0)
    assert fine["area held"] == pytest.approx(fine["true area"], rel=0.05)


def test_upwinding_at_the_corners() -> None:
    explorer = explore_upwinding()
    visit_corners(explorer)
    assert explorer.set(difference="right", velocity=1.0, cfl=1.0, nodes=80)["largest error (m)"] < 1e-12
    assert explorer.set(cfl=1.5)["largest error (m)"] > 1.0
    assert explorer.set(difference="left", cfl=0.75)["largest error (m)"] > 1.0
    assert explorer.set(velocity=-1.0)["largest error (m)"] < 0.05


def test_schemes_at_the_corners() -> None:
    explorer = explore_schemes()
    visit_corners(explorer)
    errors = [explorer.set(order=order)["mean error near the boundary (m)"] for order in (1, 2, 3)]
    assert errors[0] > 2 * errors[1] > 2 * errors[2]
    sharp = explorer.set(order=1)["mean error near the boundary (m)"]
    assert explorer.set(flux="lax-friedrichs")["mean error near the boundary (m)"] > sharp


def test_interval_at_the_corners() -> None:
    explorer = explore_interval(nodes=25)
    visit_corners(explorer)
    calm = explorer.set(show="reach-avoid", wind=0.0, x=-0.4, y=0.2)
    windy = explorer.set(wind=0.5)
    share = "share of the lake in the reach-avoid set"
    assert calm[share] > windy[share]
    assert float(calm["cost of q, Eq. (6)"]) < float(windy["cost of q, Eq. (6)"])
    assert calm["runs won"] == "64 of 64" and calm["costliest run"] <= 0
    assert calm["cost of q, Eq. (6)"] == pytest.approx(calm["on half the nodes"], abs=0.1)  # m, a spacing


def test_each_set_of_one_interval_has_its_own_share() -> None:
    explorer = explore_interval(nodes=25)
    shown = {name: dict(explorer.set(show=name)) for name in ("reach", "avoid", "reach-avoid")}
    names = {"reach": "reach set", "avoid": "avoid tube", "reach-avoid": "reach-avoid set"}
    shares = {name: numbers[f"share of the lake in the {names[name]}"] for name, numbers in shown.items()}
    assert shares["avoid"] > shares["reach"] > shares["reach-avoid"] > 0  # most of the lake is clear of the obstacle
    assert all(sum("share of the lake" in told for told in numbers) == 1 for numbers in shown.values())


def test_holding_at_the_corners() -> None:
    explorer = explore_holding(nodes=15)
    visit_corners(explorer)
    shares = [explorer.set(intervals=n)["share of the square inside"] for n in (1, 2, 4)]
    assert shares[0] < shares[1] < shares[2]
    assert explorer.numbers["one-step games solved"] == 9 * 10


def test_plane_game_at_the_corners() -> None:
    explorer = explore_plane_game(nodes=15)
    for shown in visit_corners(explorer):
        assert list(shown.values()) == sorted(shown.values())  # tubes are nested
    assert explorer.set(v_max=0.0)["within 4"] > explorer.set(v_max=0.5)["within 4"]
    assert "within 1" not in explorer.set(start=4)


def test_another_start_of_the_plane_game_solves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    explorer = explore_plane_game(nodes=15)
    monkeypatch.setattr(sdhj, "solve", lambda *_, **__: pytest.fail("solved anew"))
    before = explorer.numbers
    assert explorer.set(start=2) != before and explorer.error == ""


def test_the_table_is_filled_from_below_each_tube_from_two_that_are_there(point: LookupTable) -> None:
    steps, order = point.steps, filling(point.steps)
    tubes = [entry for entry in order if entry[1] is not None]
    assert len(set(order)) == len(order) == (steps + 1) * (steps + 2) // 2 + steps
    for place, (k, n) in enumerate(order):
        needed = {(k, n - 1), (k + 1, n - 1), (k, None)} if n else set()
        assert needed <= set(order[:place])
    explorer = explore_filling(point)
    visit_corners(explorer)
    games = len(point.problem.inputs) * steps * (steps + 1) // 2  # (7.2)
    last = {"made last": f"tube k = 0, n = {steps}", "tubes": len(tubes), "games to reach": games}
    assert explorer.set(made=len(order)) == last | {"games to avoid": len(point.problem.inputs) * steps}
    assert explorer.set(made=0) == {"made last": "nothing", "tubes": 0, "games to reach": 0, "games to avoid": 0}


def test_row_at_the_corners(point: LookupTable) -> None:
    explorer = explore_row(point)
    visit_corners(explorer)
    assert explorer.set(start=0, x=0.45, y=0.0) == {"fewest steps to go": 0, "tubes that hold the point": 5}
    lost = explorer.set(start=4, x=-0.9)
    assert np.isnan(lost["fewest steps to go"]) and lost["tubes that hold the point"] == 0


def test_spaces_at_the_corners(arm: LookupTable) -> None:
    explorer = explore_spaces(arm.problem)
    visit_corners(explorer)
    shown = explorer.set(q1=0.3, q2=-1.0, px=0.1, py=0.0, step=1.0)
    state = np.array([[0.3, -1.0, 0.1, 0.0]])
    assert shown["target (m, inside below 0)"] == pytest.approx(float(arm.problem.target_value(state, 0.1)[0]))
    assert shown["unsafe sets (m, collision below 0)"] == pytest.approx(float(arm.problem.unsafe_value(state, 0.1)[0]))


def test_a_slice_without_a_free_posture_says_so(arm: LookupTable) -> None:
    """With the pursuer on the arm's base every configuration collides: there is no outline to draw."""
    for state, full in (((0.3, -1.0, 0.24, 0.24), False), ((0.3, -1.0, 0.0, 0.0), True)):
        figure = Figure()
        draw_both_spaces(figure, arm.problem, state=state)
        drawn = {artist.get_gid() for artist in figure.axes[1].get_children()}
        assert ("pursuer-full" in drawn) is full and ("pursuer-edge" in drawn) is not full


def test_view_time_at_the_corners() -> None:
    explorer = explore_view_time(sdhj.arm_case_study(nodes=SMALL, delta=0.4, steps=2))
    visit_corners(explorer)
    missed = [explorer.set(step=1, samples=n)["of it missed by the samples"] for n in (1, 2, 20)]
    assert missed[0] > missed[1] > missed[2] >= 0.0


def test_tube_at_the_corners(arm: LookupTable) -> None:
    explorer = explore_tube(arm)
    visit_corners(explorer)
    shares = [explorer.set(start=0, within=n)["share of the slice inside"] for n in range(4)]
    assert shares == sorted(shares) and shares[0] < shares[-1]
    assert explorer.numbers["share of C inside"] == arm.fraction(start=0, within=3)
    state = np.array([[0.6, 1.2, 0.15, 0.24]])
    held = [n for n in range(4) if arm.contains(state, start=0, within=n)[0]]
    assert explorer.set(q1=0.6, q2=1.2, px=0.15, py=0.24)["steps to go of this state"] == held[0]


def test_a_tube_grows_step_by_step_to_what_the_chapter_says() -> None:
    """Step by step, to more than with the case study's own eight intervals; and where it has grown to."""
    explorer = explore_growing()
    shares = [explorer.set(within=n)["share of C inside"] for n in range(21)]
    assert explorer.error == "" and shares == sorted(set(shares))
    eight = sdhj.solve(sdhj.arm_case_study((25, 25, 13, 13)), progress=False, play=False)
    assert round(shares[-1], 2) == 0.43 and round(eight.fraction(start=0, within=8), 2) == 0.37  # as chapter 8 says


def test_other_slices_of_the_tube(arm: LookupTable) -> None:
    explorer = explore_tube(arm)
    at = {"q1": 0.6, "q2": 1.2, "px": 0.15, "py": 0.24, "within": 3}
    shown = [dict(explorer.set(axes=axes, **at)) for axes in explorer.controls["axes"].options]
    assert len({numbers["steps to go of this state"] for numbers in shown}) == 1  # the same state on every slice
    assert len({numbers["share of the slice inside"] for numbers in shown}) == len(shown)


def test_pursuer_at_the_corners(arm: LookupTable) -> None:
    explorer = explore_pursuer(arm)
    shown = visit_corners(explorer)
    assert all(0.0 <= numbers["share of the pursuer's places"] <= 1.0 for numbers in shown)
    share = "share of the pursuer's places"
    far = explorer.set(q1=0.6, q2=1.2, start=0, within=3)[share]  # the end-effector is in the target
    assert far > 0.5 and explorer.set(q1=-1.5, q2=0.0, within=0)[share] == 0.0


def test_gap_at_the_corners(arm: LookupTable, projected: LookupTable) -> None:
    explorer = explore_gap(arm, projected)
    for shown in visit_corners(explorer):
        assert shown["slice inside, projected"] <= shown["slice inside, hji"] + shown["in projected and not in hji"]
    assert explore_gap(arm, arm).numbers["in hji and not in hji"] == 0.0


def test_surface_at_the_corners(arm: LookupTable, projected: LookupTable) -> None:
    explorer = explore_surface({"full": arm, "projected": projected})
    for shown in visit_corners(explorer):
        assert shown["share of the box inside, projected"] <= shown["share of the box inside, full"] + 1e-3
    before = explorer.png
    explorer.set(azimuth=explorer.values["azimuth"] + 60)
    assert explorer.png != before


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


def test_interpolation_at_the_corners() -> None:
    explorer = explore_interpolation()
    visit_corners(explorer)
    errors = [explorer.set(kind="one target", cells=cells, shift=0.0)["largest error"] for cells in (10, 20, 40)]
    assert errors == pytest.approx([2 / 8 / 25, 2 / 8 / 100, 2 / 8 / 400], rel=1e-3)  # h^2 s'' / 8
    assert explorer.set(kind="a thin post", cells=4, shift=0.25)["falsely inside"] > 0


def test_line_at_the_corners() -> None:
    def certify(cells: int, wind: Fraction) -> dict[tuple[int, int], tuple[int, int | None]]:
        return {(0, cell): (0, None) for cell in range(0, cells, 1 + int(10 * wind))}

    explorer = explore_line(certify, lambda t: (1.0 - t, 1.2 - t))
    for shown in visit_corners(explorer):
        assert 0 < shown["certified from step 0"] <= 1


def test_lookup_at_the_corners(arm: LookupTable) -> None:
    explorer = explore_lookup(arm)
    visit_corners(explorer)
    state = {"q1": 0.6, "q2": 1.2, "px": 0.15, "py": 0.24}
    shown = explorer.set(**state)
    held = sdhj.Controller(arm).steps_to_go(np.array(list(state.values())), 0)
    assert shown["steps to go from step 0"] == ("none" if held is None else held)
    assert explorer.set(px=0.0, py=0.0)["steps to go from step 0"] == "none"  # on the arm's base


def test_pursuit_at_the_corners(arm: LookupTable) -> None:
    starts = [list(map(float, q)) for q in starts_of_runs(arm, 2, within=2)]
    explorer = explore_pursuit(arm, starts)
    for shown in visit_corners(explorer):
        assert shown["clearance now (m)"] > 0 or shown["outcome"] == "collided"
    first = explorer.set(x=-0.3, y=-0.3, moment=100, disturbance="none")["clearance now (m)"]
    assert explorer.set(x=0.1, y=0.2)["clearance now (m)"] != first


def test_certified_at_the_corners(arm: LookupTable) -> None:
    proved = sdhj.solve(arm.problem, sdhj.Certified(cells=(42, 42, 12, 12)), progress=False)
    explorer = explore_certified(arm, proved)
    for shown in visit_corners(explorer):
        assert 0.0 <= shown["proved and not inside by interpolation"] <= shown["slice proved"] <= 1.0
    shares = [explorer.set(start=0, within=n)["slice proved"] for n in range(4)]
    assert shares == sorted(shares)
    same = explore_certified(arm, arm).numbers
    assert same["slice proved"] == same["slice inside by interpolation"] > 0.0


@pytest.mark.slow
def test_arm_game_at_the_corners() -> None:
    explorer = explore_arm_game(nodes=7, method="lax")
    visit_corners(explorer)
    strong = explorer.set(v_d=2.0)["share of C inside"]
    assert explorer.set(v_d=0.0)["share of C inside"] > strong


def test_what_a_coarse_grid_hides_is_told_below_the_picture_also_the_second_time() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        explorer = explore_arm_game(nodes=15, method="lax")
        for moved in (1.0, 0.3):
            assert "hides between the nodes" in explorer.note and "hides between" in explorer.panel().children[1].value
            explorer.set(v_d=moved)
    assert explore_arm_game(nodes=7, method="lax").note == ""  # every cell is near a node that sees


@pytest.mark.slow
def test_evader_at_the_corners() -> None:
    explorer = explore_evader(nodes=9, method="lax")
    visit_corners(explorer)
    assert explorer.set(v_e=0.0)["share of C inside"] > explorer.set(v_e=0.6)["share of C inside"]


def test_run_at_the_corners(arm: LookupTable) -> None:
    starts = starts_of_runs(arm, 2, within=2)
    explorer = explore_run(arm, [list(map(float, q)) for q in starts], rules=("deepest", "effort"))
    visit_corners(explorer)
    times = [float(explorer.set(moment=moment)["time (s)"]) for moment in (0, 48, 100)]
    assert times == sorted(times) and times[0] == 0.0 and times[-1] > 0.0
    controller = sdhj.Controller(arm, rule="effort")
    run = sdhj.simulate(controller, starts[1], adversary="aggressive", seed=3)
    shown = explorer.set(number=1, adversary="aggressive", rule="effort", seed=3, moment=100)
    assert (shown["outcome"], shown["steps taken"]) == (run.outcome, len(run.inputs))


def test_car_at_the_corners(car_table: LookupTable) -> None:
    explorer = explore_car(car_table)
    visit_corners(explorer)
    shares = [
        explorer.set(within=n, heading=0.0)["share of places for this heading"] for n in range(car_table.steps + 1)
    ]
    assert shares == sorted(shares) and shares[0] < shares[-1]


def test_sensing_at_the_corners() -> None:
    def drive(controller: Any, sensing: Any) -> tuple[Any, Any]:
        paths = np.cumsum(np.full((60, 9, 2), 0.01), axis=1) + np.linspace(-0.5, 0.5, 60)[:, None, None]
        return paths, np.arange(60) < 100 * sensing.error * (not controller.problem.sensing)

    def goal(p: Any, t: float) -> Any:
        return np.abs(p).max(axis=1) - 0.4

    problem = replace(reference_robot(), target=sdhj.TargetSet((0, 1), goal))
    explorer = explore_sensing(problem, drive)
    for shown in visit_corners(explorer):
        assert 0.0 < shown["promised, reckons with it"] <= shown["promised, does not"]
    assert explorer.set(error=0.08)["lost, does not, as it is"] == pytest.approx(8 / 60)
    assert explorer.numbers["lost, reckons with it, as it is"] == 0.0
    assert explorer.numbers["lost, does not, perfect"] == explorer.numbers["lost, reckons with it, perfect"] == 0.0
    (table,) = explorer.figure.axes[-1].tables
    cells = {place: cell.get_text().get_text() for place, cell in table.get_celld().items()}
    assert [cells[row, column] for row in (1, 2) for column in (0, 1)] == ["0 of 60 lost"] * 2 + [
        "8 of 60 lost",
        "0 of 60 lost",
    ]
    assert (
        explorer.set(error=0.0, delay=0.0, jitter=0.0)["promised, reckons with it"]
        == (explorer.numbers["promised, does not"])
    )


def test_tracking_at_the_corners() -> None:
    """What is shown is how far the joint that was simulated is from its reference, beside the formula."""

    def follow(inputs: Any, torque: float, ratio: float) -> tuple[Any, ...]:
        times = np.linspace(0.0, 0.8, 81)
        reference = np.tile(inputs.max() * times, (1, 1))
        return times, reference, reference - ratio / torque, np.full((1, 81), torque)

    explorer = explore_tracking(follow, lambda change, torque: change / torque)
    for shown in visit_corners(explorer):
        assert shown["largest distance (rad)"] > 0.0
    shown = explorer.set(torque=4.0, u_max=3.0, ratio=2.0)
    assert shown == {"largest distance (rad)": pytest.approx(0.5), "formula (17.2)": pytest.approx(1.5)}
    drawn = {line.get_gid(): line.get_ydata() for ax in explorer.figure.axes for line in ax.lines}
    np.testing.assert_allclose(drawn["off"], drawn["joint"] - drawn["reference"])
    np.testing.assert_allclose(drawn["torque"], 4.0)


def reference_robot() -> sdhj.ReachAvoidProblem:
    """A point that two motors move, quickly solved."""
    inputs = [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-1.5, -1.2], [1.5, 1.2], [25, 21]),
        sdhj.Dynamics(inputs, inputs, np.eye(2), [0.05, 0.05]),
        sdhj.TargetSet((0, 1), lambda p, t: np.abs(p).max(axis=1) - 0.4),
        [],
        0.4,
        2,
    )


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


def test_a_refused_setting_keeps_the_picture() -> None:
    explorer = widgets.Explorer(draw_share, {"share": slider(0.5)})
    before = explorer.png
    assert explorer.set(share=0.9) == {"share": 0.5}
    assert "at most 0.8" in explorer.error and "at most 0.8" in explorer._status.value
    assert explorer.png == before
    assert explorer.set(share=0.2) == {"share": 0.2} and explorer.error == "" and explorer.png != before


def test_a_refused_setting_greys_the_picture_and_names_what_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    class Shown:
        images: ClassVar[list[Any]] = []

        def update(self, image: Any) -> None:
            self.images.append(image)

    monkeypatch.setattr(widgets, "display", lambda *_, **__: Shown())
    controls = {"share": slider(0.5), "pace": widgets.slider("pace", 0, 9, 1, 3)}
    explorer = widgets.Explorer(lambda figure, share, pace: draw_share(figure, share), controls)
    explorer._ipython_display_()
    widgets.SHOWN.remove(explorer)
    explorer.set(share=0.9)
    grey = Image.open(io.BytesIO(Shown.images[-1].data))
    assert np.ptp(np.asarray(grey.convert("RGB")).astype(int), axis=2).max() == 0
    assert grey.info["Description"] == "share: 0.5"
    assert Shown.images[-1].alt.startswith("still the picture of share: 0.5. ")  # and not of pace, which is the same
    assert "in grey, is that of share: 0.5." in explorer._status.value
    explorer.set(share=0.2)
    assert Shown.images[-1].data == explorer.png and len(Shown.images) == 2


def test_a_control_without_a_part_is_greyed(arm: LookupTable) -> None:
    starts = [list(map(float, q)) for q in starts_of_runs(arm, 1, within=2)]
    explorer = explore_run(arm, starts, adversaries=("random", "worst"))
    assert explorer.controls["seed"].disabled
    pictures = []
    for seed in (0, 5):
        pictures.append([])
        for adversary in ("worst", "random"):
            explorer.set(adversary=adversary, seed=seed)
            assert explorer.controls["seed"].disabled == (adversary == "worst")
            pictures[-1].append(explorer.png)
    assert pictures[0][0] == pictures[1][0] and pictures[0][1] != pictures[1][1]


def test_frames_go_from_one_end_to_the_other_and_leave_no_trace() -> None:
    explorer = widgets.Explorer(draw_share, {"share": slider(0.5)})
    before, values = explorer.png, explorer.values
    found = list(frames.frames_of(explorer))
    assert [value for value, _, _ in found] == [f"{n / 10:g}" for n in range(9)]  # 0.9 and 1.0 are refused
    assert len({png for _, png, _ in found}) == len(found)
    assert all(said == f"share: {value}" for value, _, said in found)
    assert (explorer.png, explorer.values, explorer.error) == (before, values, "")


@pytest.mark.parametrize(
    ("control", "named"),
    [
        (widgets.slider("cells", 20, 240, 1, 60), (61, 120, 121)),
        (widgets.slider("step", 0.1, 1.5, 0.05, 0.75), (1.0,)),
        (widgets.slider("shift", -0.2, 0.2, 0.01, 0.05), ()),
        (widgets.slider("intervals", 1, 20, 1, 4), ()),
        (widgets.angle("angle", 0.92), (0.3,)),
    ],
)
def test_frames_hold_the_ends_the_first_setting_and_what_the_text_names(control: Any, named: Any) -> None:
    found = frames.places(control, named)
    assert len(found) <= frames.FRAMES and found == sorted(set(found))
    for value in (control.min, control.max, control.value, *named):
        assert min(abs(value - place) for place in found) < 1e-9
    every = round((control.max - control.min) / control.step) + 1
    assert len(found) >= min(every, frames.FRAMES - 2)  # as many as there is room for, or nearly
    apart = np.diff(found)
    assert apart.max() <= 2 * (control.max - control.min) / (min(every, frames.FRAMES) - 1) + 1e-9


def test_frames_of_a_tall_picture_are_as_many_as_a_file_holds() -> None:
    """WebP pictures have up to 16,383 pixels on a side."""
    explorer = widgets.Explorer(draw_share, {"share": widgets.slider("share", 0.0, 0.75, 0.01, 0.5)}, size=(1.0, 8.0))
    assert 15 <= len(list(frames.frames_of(explorer))) <= 16_383 // 920


def test_frames_are_written_one_below_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    controls = {"share": slider(0.5), "moment": widgets.slider("moment", 0, 3, 1, 1)}
    explorer = widgets.Explorer(
        lambda figure, share, moment: draw_share(figure, share),
        controls,
        size=(3.0, 2.0),
        alt="a line",
        named=(0.3,),
        process="moment",
    )
    monkeypatch.setattr(frames, "SHOWN", [explorer])
    (tmp_path / "01_new-9-gone.webp").touch()  # of a widget that is no more
    frames.write_frames(tmp_path, "01_new", "a hash")
    told = json.loads((tmp_path / "01_new.json").read_text("utf-8"))
    share, moment = told["widgets"]
    assert told["code"] == "a hash" and (share["control"], share["at"], share["alt"]) == ("share", "0.5", "a line")
    assert share["named"] == ["0.3"] and {"0.3", "0.5"} < set(share["values"]) and not share["loop"]
    assert moment["loop"] and moment["values"] == ["0", "1", "2", "3"] and moment["widget"] == share["widget"]
    for strip in (share, moment):
        width, height = strip["size"]
        assert Image.open(tmp_path / strip["file"]).size == (width, height * len(strip["values"]))
    assert sorted(path.name for path in tmp_path.glob("*.webp")) == sorted((share["file"], moment["file"]))


def test_two_threads_move_one_slider_and_the_newest_setting_wins() -> None:
    """As a kernel may that answers in two threads: no error, rcParams as before, the picture of where the slider is."""
    drawing, most = [], []

    def draw(figure: Any, share: float) -> dict[str, float]:
        drawing.append(share)
        most.append(len(drawing))
        numbers = draw_share(figure, share)
        time.sleep(0.002)  # in which the other thread would begin
        drawing.pop()
        return numbers

    explorer = widgets.Explorer(draw, {"share": slider(0.5)})
    kept, errors = dict(mpl.rcParams), []

    def move(values: Any) -> None:
        for value in values:
            explorer.set(share=value)
            errors.append(explorer.error)

    steps = [n / 10 for n in range(8)]
    threads = [threading.Thread(target=move, args=(order,)) for order in (steps * 4, steps[::-1] * 4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(errors) == {""} and len(errors) == 64 and max(most) == 1
    assert dict(mpl.rcParams) == kept
    shown = explorer.values["share"]
    assert explorer.numbers == {"share": shown} and f"share: {shown:g}" in explorer._status.value
    np.testing.assert_array_equal(pixels(explorer.png), drawn_anew(explorer))


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


def test_a_slice_says_what_its_lines_mean(arm: LookupTable) -> None:
    for explorer in (explore_tube(arm), explore_certified(arm, arm)):
        (legend,) = explorer.figure.legends
        said = {text.get_text() for text in legend.get_texts()}
        assert {"target", "obstacles: collision", "pursuer: collision", "the state on the left"} <= said
        shown = legend.get_window_extent()
        assert shown.x0 >= 0 and shown.x1 <= explorer.figure.bbox.width


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
    assert explorer.error == "KeyError: '<nothing> there'" and "&lt;nothing&gt; there" in explorer._status.value
    explorer.set(share=0.5)  # the setting that the picture still shows
    assert explorer.error == "" and "share: 0.5" in explorer._status.value


@pytest.mark.parametrize("collecting", [True, False])
def test_garbage_waits_for_the_picture_and_no_longer(collecting: bool) -> None:
    """Whether the picture is drawn or refused; a reader who has switched the collector off keeps it off."""
    seen = []

    def draw(figure: Any, share: float) -> dict[str, float]:
        seen.append(gc.isenabled())
        return draw_share(figure, share)

    explorer = widgets.Explorer(draw, {"share": slider(0.5)})
    before = gc.isenabled()
    (gc.enable if collecting else gc.disable)()
    try:
        for share in (0.4, 0.9):  # the second is refused
            explorer.set(share=share)
            assert seen[-1] is False and gc.isenabled() is collecting
    finally:
        (gc.enable if before else gc.disable)()
    assert len(seen) == 3


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


def test_what_plays_begins_where_the_slider_is() -> None:
    """Linked in the browser, a player at 0 would put the slider to 0 when both are shown."""
    control = widgets.played(widgets.slider("moment", 0, 100, 4, 60))
    assert control.player.value == control.value == 60


def test_a_picture_holds_what_it_says() -> None:
    explorer = widgets.Explorer(draw_share, {"share": slider(0.5)})
    for _ in range(2):
        assert Image.open(io.BytesIO(explorer.png)).info["Description"] == widgets.told_of(explorer.numbers)
        explorer.set(share=0.2)


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


def test_axes_are_made_once_and_framed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which is what takes time; the picture follows all the same."""

    def draw(figure: Figure, share: float) -> None:
        ax = figure.subplots()
        ax.plot([0, 1], [0, share])
        ax.set(xlim=(0, 2), ylim=(0, 2))

    explorer = widgets.Explorer(draw, {"share": slider(0.5)})
    (ax,), before = explorer.figure.axes, explorer.png
    explorer.set(share=0.4)
    monkeypatch.setattr(Tick, "draw", lambda *_: pytest.fail("drawn again"))
    explorer.set(share=0.3)
    assert explorer.error == "" and explorer.figure.axes == [ax] and explorer.png != before


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
    assert image.data.startswith(PNG) and image.alt == "a line. share: 0.5"


def test_pictures_of_axes_and_of_the_paper(monkeypatch: pytest.MonkeyPatch, point: LookupTable) -> None:
    (image,) = shown_by(lambda: widgets.picture(draw_plane_game, point, size=(3.0, 3.0)), monkeypatch)
    assert image.data.startswith(PNG) and image.alt.startswith("Tubes of a robot")
    (image,) = shown_by(lambda: paper_figure("fig05_game"), monkeypatch)
    assert image.alt == "Fig. 5: The policy moves the robot; the adversary disturbs it and moves the pursuer"
    with pytest.raises(ValueError, match="figure must be one of"):
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


def test_area_of_a_rectangle() -> None:
    grid = canvas(41)
    assert area(grid, rectangle(grid, (0.1, 0.0), (0.5, 0.25))) == pytest.approx(0.5, abs=0.01)


def test_shrink_converges_at_second_order() -> None:
    errors = [shrink(n, Scheme(frame="fixed", dtype="float64")).mean_error for n in (21, 41, 81)]
    order = -np.polyfit(np.log((20, 40, 80)), np.log(errors), 1)[0]
    assert order > 1.5, order  # the solution has kinks, where no scheme is better than first order


def test_more_samples_of_the_view_time_miss_less(arm: LookupTable, rng: np.random.Generator) -> None:
    part = next(part for part in arm.problem.unsafe if part.moving)
    points = rng.uniform(-np.pi, np.pi, (2000, 2))
    swept = part.over(points, 0.0, 0.4, "swept")
    unions = [union_of_samples(part, points, 0.0, 0.4, n) for n in (1, 3, 9)]
    assert (unions[0] >= unions[1] - 1e-12).all() and (unions[1] >= unions[2] - 1e-12).all()
    assert (unions[2] >= swept - 1e-9).all()


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda: combine(np.zeros(1), np.zeros(1), "xor"), "operation must be one of"),
        (lambda: carry("upwind"), "difference must be one of"),
    ],
)
def test_unknown_options_are_refused(act: Callable[[], Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        act()
