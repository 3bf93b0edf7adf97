"""Every step of the checker is needed: without it, one of the tests in tests/certified/check fails.

Each case takes one thing out of a copy of the library and runs that test on the copy, without compiling.
"""

import mutations
import pytest

pytestmark = pytest.mark.campaign

EXACT, FORMS, TABLES, TEXT = "test_every_exact", "test_closed_forms", "test_tables_are_interpolated", "test_what_is_no"
COVER, LISTS, REFUSED = "test_cells_that_do_not", "test_image_lists", "test_numbers_beyond"
ROW, CLEAR, FLAGS = "test_nothing_that_samples", "test_what_is_proved", "test_flags_that"
FARTHER, DISK, HAIR, HALF = "test_no_point", "test_a_disk_stays", "test_contact_is_met", "test_half_planes_prove"
BOXES = "test_boxes_cover"
EROSION, SURVEY, BESIDE, TIPS = "test_erosion", "test_survey", "test_states_beside", "test_tips"

# what is changed of which mark `# check` in the checker, the test that must fail
MUTATIONS = {
    "2 pi from below": ("1.1 true 3", COVER),
    "2 pi from above": ("1.1 true 6", COVER),
    "doubt about 2 pi": ("1.1 true 9", COVER),
    "the last cell": ("1.2 true 11", COVER),
    "the agent's box": ("1.3 zero 15; number 22 9", COVER),
    "where the box begins": ("1.1 true 14", COVER),
    "slow end": ("3.1 zero 7", LISTS),
    "fast end": ("3.2 zero 16", LISTS),
    "errors of both measurements": ("3.3 drop 9", LISTS),
    "a late end": ("3.4 drop 17", LISTS),
    "a late begin": ("4.1 drop 19", DISK),
    "error of a joint": ("4.2 drop 3", BESIDE),
    "error of the agent": ("4.3 drop 10", BESIDE),
    "error in a half plane": ("4.4 zero 20", "test_half_planes_count"),
    "laps": ("3.5 copy 6 14", LISTS),
    "numbers that are let in": ("7.1 true 3", REFUSED),
    "numbers below zero": ("7.1 false 8", REFUSED),
    "linear term of joint 1": ("4.5 drop 5", FARTHER),
    "linear term of the tip": ("4.6 zero 7", FARTHER),
    "linear term of joint 2": ("4.6 drop 16", FARTHER),
    "bend of joint 1": ("4.7 zero 5", FARTHER),
    "bend of joint 2": ("4.8 zero 10", FARTHER),
    "the base": ("4.9 copy 1 3", FARTHER),
    "the elbow": ("4.8 put 3 -1.0", FARTHER),
    "move of a disk": ("4.10 zero 6; zero 9", DISK),
    "bend of a path": ("4.10 zero 12", DISK),
    "rounding": ("6.1 zero 2", HAIR),
    "error of states": ("4.11 zero 2", BESIDE),
    "radius": ("6.2 drop 4; 6.3 drop 5", HAIR),
    "disturbance": ("4.12 drop 9", CLEAR),
    "disturbance of a row": ("4.13 zero 15; zero 18; zero 20; zero 23", "test_half_planes_count"),
    "start of the time": ("4.14 copy 13 15", CLEAR),
    "end of the time": ("4.15 copy 17 19", CLEAR),
    "move of the agent": ("4.3 drop 4", CLEAR),
    "half of the time": ("4.16 put 10 {4} + ({6} == 4)", CLEAR),
    "half of the disturbance": ("4.16 put 10 {4} + ({6} > 4)", "test_all_that_a_dist"),
    "half of the box": ("4.16 put 10 {4} + ({6} < 4)", CLEAR),
    "second link": ("4.17 number 4 1", CLEAR),
    "cell of the agent": ("4.18 zero 4", CLEAR),
    "move in a half plane": ("4.4 drop 12", HALF),
    "parts of a sweep": ("4.19 number 4 1", HALF),
    "far edge of a column": ("4.20 drop 3", HALF),
    "width of a half plane": ("4.21 turn 7", HALF),
    "lower end of a column": ("4.22 put 5 {6} > {7}[-1]", HALF),
    "bend of the tip": ("4.23 copy 2 4", TIPS),
    "turn of the tip": ("4.24 zero 3; zero 5", TIPS),
    "size of the evader": ("5.1 copy 8 11; copy 13 16", ROW),
    "all of erosion": ("3.6 write {1} = {2}", EROSION),
    "all of a column": ("3.7 drop 12", EROSION),
    "sets that grow": ("2.1 false 1", SURVEY),
    "all ends of joint 1": ("5.2 number 4 1", ROW),
    "all ends of joint 2": ("5.3 number 4 1", ROW),
    "one step less": ("5.4 put 5 min({5} + 1, len(todo) - 1)", ROW),
    "reach and clear at once": ("5.5 drop 6", ROW),
    "inputs that are allowed": ("5.6 drop 5", ROW),
    "many cells at once": ("5.7 drop", ROW),
    "cells one by one": ("5.8 drop", ROW),
    "many cells at a goal": ("5.9 drop", ROW),
    "the pursuer at a goal": ("5.10 drop", ROW),
    "obstacles at a goal": ("5.11 true 1", ROW),
    "the target at its time": ("5.12 true 1", ROW),
    "the evader's tips": ("5.13 false 1", ROW),
    "outward rounding": ("6.4 drop 4", EXACT),
    "underflow": ("6.5 zero 2", EXACT),
    "not below zero": ("6.6 copy 2 5", FORMS),
    "signs of products": ("6.7 copy 2 9", FORMS),
    "a divisor of zero": ("6.8 put 3 {5} > {10}", FORMS),
    "a share of zero": ("6.9 copy 2 9", EXACT),
    "odd powers": ("6.10 copy 2 12", EXACT),
    "a base of zero": ("6.11 drop 14", EXACT),
    "NumPy's powers of one": ("6.12 drop 6", "test_what_is_undefined"),
    "hills": ("6.13 copy 9 14", EXACT),
    "valleys": ("6.13 copy 2 8", EXACT),
    "poles": ("6.14 put 3 {9}.isnan(begin)", FORMS),
    "the jump of an angle": ("6.15 put 2 {15} > {16}[1]", EXACT),
    "laps of a rest": ("6.16 copy 2 11", FORMS),
    "the part below a jump": ("6.17 true 3", EXACT),
    "the last of two laps": ("6.18 copy 13 2", EXACT),
    "all sides of jumps": ("6.19 number 25 2", "test_every_value_is_on"),
    "NaN in a comparison": ("6.20 drop 10", "test_what_is_undefined"),
    "an open condition": ("6.21 copy 9 13", EXACT),
    "nodes in a box": ("6.22 zero 12", TABLES),
    "the lower end in a table": ("6.39 zero 10", TABLES),
    "the upper end in a table": ("6.40 zero 20", TABLES),
    "the last block": ("6.23 turn 16", TABLES),
    "endless ends": ("6.24 put 2 ~{5}.isnan({6} + {10})", FORMS),
    "what is taken away": ("6.25 put 4 (-{6}[0], -{6}[1])", EXACT),
    "all corners": ("6.26 put 2 [{3} for {5}, {6} in zip({8}, {10}, strict=True)]", EXACT),
    "two ends for all boxes": ("6.42 true 11", "test_one_interval_for"),
    "zeros of both signs for all boxes": ("6.42 put 11 {12} == {15}", "test_one_interval_for"),
    "the end of a time": ("6.43 copy 17 14", "test_what_reads_no"),
    "least absolute values": ("6.27 copy 5 8; copy 15 11", EXACT),
    "most absolute values": ("6.27 copy 16 12", EXACT),
    "even powers": ("6.28 false 1", EXACT),
    "errors of functions": ("6.29 zero 2", EXACT),
    "what falls": ("6.30 zero 12; number 18 1", EXACT),
    "sizes of both sides": ("6.31 copy 9 11; copy 12 14", EXACT),
    "what is surely less": ("6.32 number 9 1", EXACT),
    "what is never less": ("6.33 zero 16", EXACT),
    "what is surely equal": ("6.34 put 3 {5} == {15}", FORMS),
    "what is not": ("6.35 zero 287; number 292 1", EXACT),
    "rounding of tables": ("6.36 zero 3; 6.37 zero 4", TABLES),
    "blocks of a table": ("6.38 turn 7", TABLES),
    "what is read": ("7.2 put 9 {10} is None", "test_what_it_reads"),
    "later lines": ("7.3 put 8 10 ** 6", TEXT),
    "lines": ("7.4 true 7", TEXT),
    "exponents": ("7.5 true 4", TEXT),
    "truth values": ("7.6 true 4", TEXT),
    "values let go": ("7.7 drop", "test_many_values"),
    "flags": ("4.25 drop 7", FLAGS),
    "time of a flag": ("4.26 zero 2", FLAGS),
}


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    with mutations.started(request, "check", MUTATIONS, "certified/check", tmp_path_factory) as started:
        yield started


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_check_needs_it(name, runs):
    mutations.assert_needed(runs[name].result())
