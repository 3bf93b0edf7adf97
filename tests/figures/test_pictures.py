"""What figures draw, asserted on the artists' data."""

import os
from dataclasses import replace

import extra_certified
import fig12_trajectory
import numpy as np
import pytest
import zoo
from artists import axes, named
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


def test_run_pictures(table, run):
    ax = axes()
    fig12_trajectory.draw_workspace_run(ax, table.problem, run)
    (way,) = named(ax, "tip-path")
    assert np.allclose(np.transpose(way.get_data()), scene(table.problem).arm.tip(run.states[:, :2]))
    assert len(named(ax, "arm")) == len(run.samples)


@pytest.mark.slow
def test_the_animation_is_a_gif_with_its_frames(table, run, tmp_path):
    path = fig12_trajectory.save_animation(table, run, tmp_path / "run.gif", frames=3, rate=4, dpi=40)
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert image.n_frames == 3  # the writer merges the still at the end into the last frame
    assert os.listdir(tmp_path) == ["run.gif"]
