"""What Figs. 10, 12 and 13 draw, asserted on the artists' data."""

import os
from dataclasses import replace

import extra_certified
import fig10_tubes
import fig12_trajectory
import fig13_comparison
import numpy as np
import pytest
import zoo
from artists import axes, named, vertices
from PIL import Image

import sdhj
from sdhj import plotting
from sdhj.arm.case_studies import scene
from sdhj.common.remembering import read_only
from sdhj.simulation.runs import Trajectory

THROUGH = (0.0, 0.0, 0.2, 0.2)


@pytest.fixture(scope="module")
def table() -> sdhj.LookupTable:
    return zoo.small_arm_table()


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return zoo.small_arm_run()


def test_comparison_lays_two_tables_over_each_other(table):
    ax = axes()
    fig13_comparison.draw_comparison(ax, table, table, THROUGH)
    assert np.array_equal(vertices(ax, "full"), vertices(ax, "inner"))
    assert named(ax, "inner")[0].get_zorder() > named(ax, "full")[0].get_zorder()
    assert len(fig13_comparison.comparison_legend()) == 4


def test_labels_are_colours_of_a_slice(table):
    """A table held against a smaller one of the same game: what that holds counts as proved."""
    smaller = replace(table, tubes=read_only(table.tubes + 0.02))
    ax = axes()
    extra_certified.draw_labels(ax, table, smaller, through=THROUGH, resolution=31)
    (image,) = named(ax, "labels")
    where = plotting.plane(table.grid, THROUGH, resolution=31)
    proved, claimed = (where.shaped(one.contains(where.points, start=0, within=3)) > 0 for one in (smaller, table))
    found = image.get_array()
    assert np.array_equal(found == extra_certified.LABELS.index("certified"), proved) and proved.any()
    assert np.array_equal(found == extra_certified.LABELS.index("not certified"), claimed & ~proved)
    assert np.array_equal(found == extra_certified.LABELS.index("outside"), ~claimed) and (claimed & ~proved).any()
    assert named(ax, "tube-edge")


@pytest.mark.slow
def test_every_step_to_go_is_seen():
    """Each adds at least a hundredth of the slice, on the grid that Figs. 10 and 11 show."""
    fine = sdhj.solve(sdhj.arm_case_study(), method="lax", progress=False)
    for place in fig10_tubes.PURSUERS:
        where = plotting.plane(fine.grid, (0.0, 0.0, *place), resolution=49)
        shares = [(where.of(fine.grid, fine.values(start=0, within=n)) <= 0).mean() for n in range(9)]
        assert np.diff(shares).min() > 0.01


def test_the_target_of_the_tubes_is_in_the_legend(table):
    figure = fig10_tubes.draw_two_slices(table)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["known obstacles", "target", "capture by the pursuer"]
    assert legend.get_patches()[1].get_facecolor() == pytest.approx(plotting.step_colours(3)[0])


def test_steps_bar_shows_every_number():
    ax = axes()
    fig10_tubes.draw_steps_bar(ax, 5, "steps to go")
    assert ax.get_xticks().tolist() == [0, 1, 2, 3, 4, 5]


def test_run_pictures(table, run):
    problem = table.problem
    ax = axes()
    fig12_trajectory.draw_workspace_run(ax, problem, run)
    (way,) = named(ax, "tip-path")
    assert np.allclose(np.transpose(way.get_data()), scene(problem).arm.tip(run.states[:, :2]))
    assert len(named(ax, "arm")) == len(run.samples)
    ax = axes()
    plotting.draw_run(ax, table, run)
    (way,) = named(ax, "path")
    shown = np.transpose(way.get_data())
    assert (np.abs(shown[~np.isnan(shown[:, 0])]) <= np.pi + 1e-12).all()
    (marks,) = named(ax, "marks")
    assert len(marks.get_xdata()) == len(run.samples)
    assert named(ax, "tube")
    for name, t in (("target", 0.0), ("target-then", run.times[-1])):  # at the start, and where it is reached
        edge = vertices(ax, f"{name}-edge")
        states = np.column_stack([edge, np.tile(run.states[0, 2:], (len(edge), 1))])
        assert np.abs(problem.target_value(states, t)).max() < 0.15 * (2 * np.pi / 120) ** 2, name
    strip = axes(nrows=2, ncols=3).ravel()
    fig12_trajectory.draw_frames(strip, problem, run)
    assert sum(bool(named(ax, "arm")) for ax in strip) == min(6, len(run.samples))


@pytest.mark.slow
def test_the_animation_is_a_gif_with_its_frames(table, run, tmp_path):
    path = fig12_trajectory.save_animation(table, run, tmp_path / "run.gif", frames=3, rate=4, dpi=40)
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert image.n_frames == 3  # the writer merges the still at the end into the last frame
    assert os.listdir(tmp_path) == ["run.gif"]
