"""Every step of the proof is needed: without it, the test that the docstring of sdhj.certified.sets names fails.

Each case takes one thing out of a copy of the library (an inflation, a rounding, a bound in time) and runs that test on
the copy, mostly without compiling.
"""

import mutations
import pytest

KERNELS, CELLS, GENERAL = "certified_kernels.py", "certified_cells.py", "certified_general.py"

# file, what is taken out, what is left, the test that must fail
MUTATIONS = {
    "doubt about 2 pi": (CELLS, "period / 2**49", "period / 2**90", "test_cells_partition_the_axis"),
    "worst velocity": (
        CELLS,
        "slow * duration, fast * duration",
        "fast * duration, fast * duration",
        "test_image_holds",
    ),
    "outward edge": (
        CELLS,
        "inside = math.ceil((offset + self._laps",
        "inside = math.floor((offset + self._laps",
        "test_image_holds",
    ),
    "outward wall": (
        CELLS,
        "max(math.ceil(high / self.width)",
        "max(math.floor(high / self.width)",
        "test_image_holds",
    ),
    "remainder of link 1": (KERNELS, "return 3, l1 * w1 * w1 / 8.0", "return 3, 0.0", "test_hulls_hold_the_links"),
    "remainder of link 2": (KERNELS, "w2 * w2)) / 8.0", "w2 * w2)) / 32.0", "test_hulls_hold_the_links"),
    "margin": (KERNELS, "MARGIN = 1e-8", "MARGIN = 0.0", "test_contact_within_rounding"),
    "margin of the target": (KERNELS, "+ remainder + MARGIN <= radius", "+ remainder <= radius", "test_contact_within"),
    "margin of the pursuer": (KERNELS, "radius + MARGIN,", "radius,", "test_contact_within_rounding"),
    "speed of a disk": (
        KERNELS,
        "radii[disk] + speeds[disk] * delta",
        "radii[disk] + 0.0 * delta",
        "test_no_time_is_left_out",
    ),
    "start of a part": (
        KERNELS,
        "high + max(fast * tau0, fast * tau1)",
        "high + fast * tau0",
        "test_no_time_is_left_out",
    ),
    "end of a part": (KERNELS, "low + min(slow * tau0, slow * tau1)", "low + slow * tau0", "test_no_time_is_left_out"),
    "pursuer at the end": (
        KERNELS,
        "growth = speed * delta * (part + 1) / parts",
        "growth = speed * delta * part / parts",
        "left_out_of_the_pursuit",
    ),
    "cell of the pursuer": (KERNELS, "highest + growth - plane[1]", "highest - plane[1]", "test_pursuer_is_met"),
    "walls of the pursuer": (KERNELS, "shift) | passes", "shift) & passes", "test_packed_erosion"),
    "slack": (KERNELS, "SLACK = 1e-10", "SLACK = 0.0", "test_state_on_an_edge"),
    "cells of the image": (KERNELS, "range(1, number[i])", "range(1, number[i] - 1)", "test_recursion_agrees"),
    "growth bound": (GENERAL, "slack = away @ self.matrix.T + push", "slack = push", "test_general_reach_box"),
    "rate of a set": (GENERAL, "rate * (boxes.end - boxes.begin) / 2", "0.0", "test_general_bounds_hold"),
    "size of a box": (GENERAL, "- boxes.half[:, axes] @ bounds", "- 0.0", "test_general_bounds_hold"),
}
COMPILED = {"slack", "cells of the image"}  # their tests solve a problem


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    with mutations.started(request, MUTATIONS, "test_certified.py", tmp_path_factory, compiled=COMPILED) as started:
        yield started


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_the_proof_needs_it(name, runs):
    mutations.assert_needed(runs[name].result())
