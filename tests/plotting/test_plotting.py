"""The drawing functions: what is in the pictures, asserted on the artists' data, not on pixels."""

import itertools
import logging

import numpy as np
import pytest
import shapely
import zoo
from artists import axes, named, vertices
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from zoo import torus_problem, unicycle_problem

import sdhj
from sdhj import plotting
from sdhj.arm.case_studies import scene
from sdhj.plotting import looks, slices, trajectories
from sdhj.simulation.runs import Trajectory

THROUGH = (0.0, 0.0, 0.2, 0.2)


@pytest.fixture(scope="module")
def table() -> sdhj.LookupTable:
    return zoo.small_arm_table()


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return zoo.small_arm_run()


# ---- slices


def test_a_slice_closes_the_seam_and_agrees_with_the_table(table):
    where = slices.plane(table.grid, THROUGH, resolution=41)
    assert where.x[0] == -np.pi and where.x[-1] == np.pi
    values = where.of(table.grid, table.values(start=0, within=3))
    assert np.abs(values[:, 0] - values[:, -1]).max() < 1e-12
    assert np.abs(values[0] - values[-1]).max() < 1e-12
    inside = table.contains(where.points, start=0, within=3)
    assert np.array_equal(where.shaped(inside), values <= 0)
    assert inside.any() and not inside.all()
    row, column = 7, 30  # rows go with the second axis
    assert np.array_equal(where.points[row * 41 + column], [where.x[column], where.y[row], 0.2, 0.2])


def test_a_slice_along_other_axes(table):
    where = slices.plane(table.grid, (0.5, -0.5, 0.0, 0.0), axes=(2, 3), resolution=11)
    assert np.array_equal(where.points[:, :2], np.tile([0.5, -0.5], (121, 1)))
    assert where.x[[0, -1]].tolist() == [-0.36, 0.36]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"axes": (0, 0)}, r"grid, got \(0, 0\)"),
        ({"axes": (0, 4)}, " 0 to 3"),
        ({"start": 99}, "start"),
    ],
)
def test_tubes_that_there_are_not_are_refused(table, options, said):
    with pytest.raises(ValueError, match=said):
        slices.draw_tubes(Figure().subplots(), table, through=(0.0, 0.0, 0.2, 0.2), **options)


@pytest.mark.parametrize(
    ("through", "said"),
    [
        ((0.0, 0.0), "one state of 4"),
        ((0, 0, 0.4, 0.0), r"\[-0.36, 0.36\], got 0.4"),
        ((0, 0, 0, np.nan), "py in"),
    ],
)
def test_a_slice_through_no_state_is_refused(table, through, said):
    with pytest.raises(ValueError, match=said):
        slices.plane(table.grid, through)


def test_a_drawn_set_is_the_set():
    grid = sdhj.Grid([-1, -1], [1, 1], [5, 5])
    where = slices.plane(grid, (0, 0), resolution=201)
    values = where.shaped(np.hypot(where.points[:, 0] - 0.2, where.points[:, 1]) - 0.5)
    ax = axes()
    slices.draw_set(ax, where, values, looks.UNSAFE_LOOKS, "disk")
    radii = np.hypot(*(vertices(ax, "disk-edge") - [0.2, 0.0]).T)
    # linear interpolation of a distance on cells of h = 0.01 errs by at most h^2 / (8 r) times two
    assert np.abs(radii - 0.5).max() < 2 * 0.01**2 / (8 * 0.5)
    assert named(ax, "disk")[0].hatches == [looks.UNSAFE_LOOKS["hatch"]]


def test_an_empty_set_draws_nothing_and_a_full_one_has_no_edge():
    where = slices.plane(sdhj.Grid([-1, -1], [1, 1], [5, 5]), (0, 0), resolution=5)
    ax = axes()
    slices.draw_set(ax, where, np.ones((5, 5)), looks.UNSAFE_LOOKS, "empty")
    slices.draw_set(ax, where, -np.ones((5, 5)), looks.UNSAFE_LOOKS, "full")
    assert not named(ax, "empty") and not named(ax, "empty-edge") and not named(ax, "full-edge")
    assert np.ptp(vertices(ax, "full"), axis=0).tolist() == [2.0, 2.0]


def test_tubes_are_nested_and_follow_the_sliders(table):
    ax = axes()
    slices.draw_tubes(ax, table, through=THROUGH)
    boxes = [np.concatenate([vertices(ax, f"tube-{n}").min(0), -vertices(ax, f"tube-{n}").max(0)]) for n in range(4)]
    assert all((later <= earlier + 1e-9).all() for earlier, later in itertools.pairwise(boxes))
    heights = [named(ax, f"tube-{n}")[0].get_zorder() for n in range(4)]
    assert heights == sorted(heights, reverse=True)  # smaller sets lie on top
    few = axes()
    slices.draw_tubes(few, table, through=THROUGH, start=1, within=1)
    assert named(few, "tube-1") and not named(few, "tube-2")
    expected = axes()
    where = slices.plane(table.grid, THROUGH)
    slices.draw_set(expected, where, where.of(table.grid, table.values(start=1, within=1)), looks.FULL_LOOKS, "set")
    assert np.array_equal(vertices(few, "tube-1"), vertices(expected, "set"))


@pytest.mark.parametrize(
    ("start", "within", "px", "py"),
    [(0, 0, -0.36, -0.36), (0, 3, -0.36, 0.36), (3, 0, 0.36, -0.36), (2, 99, 0.36, 0.36)],
)
def test_tubes_at_the_corners_of_the_sliders(table, start, within, px, py):
    ax = axes()
    slices.draw_tubes(ax, table, through=(0, 0, px, py), start=start, within=within)
    drawn = {artist.get_gid() for artist in ax.get_children()} - {None}
    most = min(within, 3 - start)
    inside = {
        f"tube-{n}"
        for n in range(most + 1)
        if table.contains(slices.plane(table.grid, (0, 0, px, py)).points, start=start, within=n).any()
    }
    assert {gid for gid in drawn if gid.startswith("tube") and "edge" not in gid} == inside


@pytest.mark.slow
def test_constraints_move_with_time_and_pursuer(table):
    problem = table.problem
    here, there, later = axes(), axes(), axes()
    slices.draw_constraints(here, problem, through=THROUGH, resolution=61)
    slices.draw_constraints(there, problem, through=(0, 0, -0.2, 0.2), resolution=61)
    slices.draw_constraints(later, problem, through=THROUGH, step=3, resolution=61)
    assert not np.array_equal(vertices(here, "pursuer-edge"), vertices(there, "pursuer-edge"))
    assert np.array_equal(vertices(here, "target-edge"), vertices(there, "target-edge"))
    assert np.array_equal(vertices(here, "pursuer-edge"), vertices(later, "pursuer-edge"))
    assert not np.array_equal(vertices(here, "target-edge"), vertices(later, "target-edge"))
    assert not np.array_equal(vertices(here, "obstacles-edge"), vertices(later, "obstacles-edge"))
    inside = problem.target_value(
        np.column_stack([vertices(here, "target-edge"), np.zeros((len(vertices(here, "target-edge")), 2))]), 0.0
    )
    assert np.abs(inside).max() < 0.15 * (2 * np.pi / 60) ** 2  # h^2 / 8 times the curvature of a 0.3 m arm, with room
    only = axes()
    slices.draw_constraints(only, problem, through=THROUGH, parts=["pursuer"], resolution=61)
    assert not named(only, "target") and named(only, "pursuer-edge")


def test_slices_know_any_problem():
    problem = torus_problem()
    table = sdhj.solve(problem, method="lax", progress=False)
    ax = axes()
    slices.draw_tubes(ax, table, through=(0.0, 0.0))
    slices.draw_constraints(ax, problem, through=(0.0, 0.0))
    assert named(ax, "tube-3") and named(ax, "target") and named(ax, "orbiting disk")
    assert ax.get_xlabel() == "x1"


def test_a_path_is_cut_at_the_seam():
    grid = sdhj.Grid([-np.pi, -np.pi, 0], [np.pi, np.pi, 1], [5, 5, 5], [True, True, False])
    s = np.linspace(0, 1, 60)[:, None]
    states = np.hstack([2.0 + 3.0 * s, -2.0 - 8.0 * s, s])  # over the right seam once, over the bottom one twice
    frame = shapely.box(-np.pi, -np.pi, np.pi, np.pi)
    for given in (states, grid.wrapped(states)):
        path = slices.unwrapped(grid, given)
        assert np.isnan(path[:, 0]).sum() == 3
        laps = [shapely.LineString(path[at : at + 60]) for at in range(0, len(path), 61)]
        pieces = [lap.intersection(frame) for lap in laps]
        assert min(piece.length for piece in pieces) > 0.0
        assert np.isclose(sum(piece.length for piece in pieces), np.hypot(3, 8))  # nothing of the path is lost
        inside = grid.wrapped(np.column_stack([path, np.zeros(len(path))]))[:60, :2]
        assert np.allclose(inside, grid.wrapped(states)[:, :2])


# ---- workspace


def test_workspace_shows_everything_where_it_is(table):
    view = scene(table.problem)
    ax = axes()
    state = np.array([0.4, 1.1, -0.2, 0.3])
    plotting.draw_workspace(ax, view, state=state, time=0.5, trail=np.array([0.0, 0.4, 0.8]))
    for place, disk in enumerate(view.obstacles):
        (circle,) = named(ax, f"obstacle-{place}")
        assert isinstance(circle, Circle)
        assert np.allclose(circle.center, disk.centre(0.5)) and circle.radius == disk.radius
    (agent,) = named(ax, "pursuer")
    assert np.allclose(agent.center, state[2:]) and agent.radius == 0.04
    (tip,) = named(ax, "tip")
    assert np.allclose(np.ravel(tip.get_data()), view.arm.tip(state[:2]))
    (arm,) = named(ax, "arm")
    assert np.allclose(arm.get_xy()[:-1], view.arm.outline(state[:2])[:-1])
    assert len(named(ax, "target-trail")) == 3 and not named(ax, "obstacle-0-trail")  # the first does not move


def test_a_workspace_without_a_state_has_no_arm(table):
    ax = axes()
    plotting.draw_workspace(ax, scene(table.problem))
    assert named(ax, "target") and not named(ax, "arm") and not named(ax, "pursuer")


# ---- runs


def test_a_run_of_any_robot_on_any_slice():
    problem = unicycle_problem()
    table = sdhj.solve(problem, progress=False)
    start = np.array([-0.6, 0.3, -0.5])
    run = sdhj.simulate(sdhj.Controller(table), start, adversary="random")
    ax = axes()
    trajectories.draw_run(ax, table, run, axes=(2, 0))
    (way,) = named(ax, "path")
    assert (way.get_xdata()[0], way.get_ydata()[0]) == (start[2], start[0])
    assert named(ax, "tube") and ax.get_xlabel() == "theta"
    (marks,) = named(ax, "marks")
    assert len(marks.get_xdata()) == len(run.samples) > 1


def test_the_targets_of_a_run_are_where_they_are_when_it_begins_and_ends(table, run):
    ax = axes()
    trajectories.draw_run(ax, table, run)
    for name, t in (("target", 0.0), ("target-then", run.times[-1])):
        edge = vertices(ax, f"{name}-edge")
        states = np.column_stack([edge, np.tile(run.states[0, 2:], (len(edge), 1))])
        assert np.abs(table.problem.target_value(states, t)).max() < 0.15 * (2 * np.pi / 120) ** 2, name


def test_a_run_that_begins_in_the_target_is_a_point_in_it():
    table = sdhj.solve(unicycle_problem(), progress=False)
    inside = sdhj.simulate(sdhj.Controller(table), np.array([0.1, 0.2, 0.0]))
    ax = axes()
    trajectories.draw_run(ax, table, inside)
    (way,) = named(ax, "path")
    assert len(inside.inputs) == 0 and way.get_xdata().tolist() == [0.1] and named(ax, "tube")


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_moment_of_a_run(table, run, share):
    figure = plotting.new_figure(6, 3)
    index = int(share * (len(run.times) - 1))
    for _ in range(2):  # drawing again replaces what was there
        trajectories.draw_moment(figure, table, run, index=index)
    left, right = figure.axes
    (agent,) = named(left, "pursuer")
    assert np.allclose(agent.center, run.states[index, 2:])
    assert named(right, "pursuer-edge") or not (table.problem.unsafe_value(run.states, 0.0) < 0).any()
    assert (run.outcome in right.get_title(loc="center")) == (share == 1.0)


# ---- style and files


def picture() -> Figure:
    with plotting.style():
        figure = plotting.new_figure(2, 2)
        ax = figure.subplots()
        ax.plot([0, 1], [1, 0], label=r"$\mathcal{S}_k^i$")
        ax.contourf(np.arange(9.0).reshape(3, 3), levels=[0, 4], hatches=["//"])
        ax.legend()
    return figure


@pytest.mark.slow
def test_the_same_figure_gives_the_same_bytes(tmp_path, caplog):
    first = plotting.save(picture(), tmp_path / "a", "p", ("pdf", "svg", "png"))
    second = plotting.save(picture(), tmp_path / "b", "p", ("pdf", "svg", "png"))
    assert [path.name for path in first] == ["p.pdf", "p.svg", "p.png"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
        assert b"Date" not in one.read_bytes() or one.suffix == ".png"
    assert all(record.levelno < logging.WARNING for record in caplog.records)


def test_bad_formats_and_folders_are_refused(tmp_path):
    with pytest.raises(ValueError, match="svg, png, got tiff"):
        plotting.save(picture(), tmp_path, "p", ("tiff",))
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    with pytest.raises(OSError, match="cannot write in"):
        plotting.save(picture(), blocked / "inside", "p")


def test_the_style_leaves_no_trace():
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    with plotting.style():
        assert mpl.rcParams["svg.hashsalt"] == "sdhj"
    assert dict(mpl.rcParams) == before
