"""Every step of the proof is needed: without it, the test that the docstring of sdhj.certified.sets names fails.

Each case takes one thing out of a copy of the library (an inflation, a rounding, a bound in time) and runs that test on
the copy, mostly without compiling.
"""

import re

import mutations
import pytest
from changes import unlisted

import sdhj.certified.sets

pytestmark = pytest.mark.campaign

# what is changed of which mark `# obligation` in the library, the test that must fail
MUTATIONS = {
    "doubt about 2 pi": ("1.4 number 11 90", "test_cells_partition_the_axis"),
    "worst velocity": ("2.23 copy 15 18", "test_image_holds"),
    "outward edge": ("2.24 turn 14", "test_image_holds"),
    "outward wall": ("2.19 turn 14", "test_image_holds"),
    "remainder of link 1": ("5.1 zero 3", "test_hulls_hold_the_links"),
    "remainder of link 2": ("5.2 number 23 32.0", "test_hulls_hold_the_links"),
    "margin": ("7.31 zero 2", "test_contact_within_rounding"),
    "margin of the target": ("7.32 drop 6", "test_contact_within"),
    "margin of the pursuer": ("7.33 drop 6", "test_contact_within"),
    "margin of a disk": ("7.34 drop 14", "test_contact_within"),
    "speed of a disk": ("7.34 zero 9", "test_no_time_is_left_out"),
    "undecided parts": ("4.31 drop", "test_no_time_is_left_out"),
    "start of a part": ("4.32 copy 6 8", "test_no_time_is_left_out"),
    "end of a part": ("4.33 copy 6 8", "test_no_time_is_left_out"),
    "pursuer at the end": ("4.34 drop 14; 4.35 drop 14", "left_out_of_the_pursuit"),
    "cell of the pursuer": ("6.1 drop 12", "test_pursuer_is_met"),
    "walls of the pursuer": ("3.16 turn 6", "test_packed_erosion"),
    "slack": ("8.1 zero 2", "test_state_on_an_edge"),
    "cells of the image": ("3.17 put 5 {5} - 1; 3.18 put 5 {5} - 1", "test_recursion_agrees"),
    "room to move in": ("2.25 zero 12; 2.26 zero 12", "test_general_reach_box"),
    "push of the adversary": ("2.27 copy 5 6; copy 8 6", "test_general_reach_box"),
    "walls on the way": ("2.18 copy 1 11", "test_general_reach_box"),
    "tube between the parts": ("2.28 put 3 {3} + np.inf; put 6 {6} - np.inf", "test_general_reach_box"),
    "upper face": ("2.17 zero 11", "test_damped_motion"),
    "change with time": ("2.29 zero 4", "test_timed_growth_holds"),
    "time of an interval": ("2.12 copy 10 12; copy 13 15", "test_timed_growth_holds"),
    "boxes of a set": ("4.1 drop 6", "test_bounds_of_a_lattice"),
    "rate of a set": ("2.29 zero 4", "test_general_bounds_hold"),
    "size of a box": ("4.36 zero 9", "test_general_bounds_hold"),
    "where an axis closes": ("4.37 put 3 {7}[{10}]", "test_a_box_across"),
    "all cells of an image": ("3.1 put 5 {5} - 1", "test_images_are_inside"),
    "error of the first measurement": ("2.6 put 14 {19}.copy()", "test_what_an_interval_does_to_predictions"),
    "error of the next measurement": ("2.7 drop 14", "test_what_an_interval_does_to_predictions"),
    "an early end": ("2.11 false 1", "test_what_an_interval_does_to_predictions"),
    "a prediction in the target": ("9.7 drop 15", "test_what_an_interval_does_to_predictions"),
    "a late end": ("10.8 drop 14", "test_what_an_interval_does_to_predictions"),
    "rounding of what is added": ("2.31 copy 7 10", "test_what_a_piece_adds"),
    "the length of a piece": ("2.32 zero 2", "test_what_a_piece_adds"),
    "open sides of a jump": ("7.24 copy 16 11", "test_every_sample_is_inside"),
}
# the tests that the docstring of `sdhj.certified.sets` names: for what is marked `# obligation 4` alone
TESTS = {
    number: " or ".join(re.findall(r"\btest_\w+(?!\w|\.py)", text))
    for number, text in re.findall(r"(?ms)^(\d+)\.  ?(.*?)(?=^\d+\. |^For robots)", sdhj.certified.sets.__doc__ or "")
}
MUTATIONS |= {f"{row} (not listed)": (row, TESTS[row.split()[0]]) for row in unlisted("obligation")}
COMPILED = {"slack", "cells of the image"}  # their tests solve a problem


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    with mutations.started(
        request, "obligation", MUTATIONS, "certified", tmp_path_factory, compiled=COMPILED
    ) as started:
        yield started


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_proof_needs_it(name, runs):
    mutations.assert_needed(runs[name].result())
