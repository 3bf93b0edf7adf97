"""Every step of the proof is needed: without it, the test that the docstring of sdhj.certified.sets names fails.

Each case takes one thing out of a copy of the library (an inflation, a rounding, a bound in time) and runs that test on
the copy, mostly without compiling.
"""

import mutations
import pytest

pytestmark = pytest.mark.slow

CELLS, IMAGES, GENERAL, BOUNDS = (f"certified/{name}.py" for name in ("cells", "images", "general_proof", "bounds"))
DYNAMICS, BLACK_BOXES, TAPE = "problem/dynamics.py", "formulas/formula.py", "kernels/tape.py"
RATE = "duration * (0.0 if self.rate is None else np.asarray(self.rate))"
PACKED, LINKS, CONTACT, STENCILS, PIECES = (
    f"kernels/{name}.py" for name in ("packed", "arm/links", "arm/contact", "stencils", "pieces")
)
SENSED = "test_what_an_interval_does_to_predictions"
SAMPLES, GROWTH = "test_every_sample_is_inside", "test_general_reach_box"

# file, what is taken out, what is left, the test that must fail
MUTATIONS = {
    "doubt about 2 pi": (CELLS, "period / 2**49", "period / 2**90", "test_cells_partition_the_axis"),
    "worst velocity": (
        CELLS,
        "self.moved(cell, float(back), float(ahead), True)",
        "self.moved(cell, float(ahead), float(ahead), True)",
        "test_image_holds",
    ),
    "outward edge": (
        CELLS,
        "np.minimum(np.ceil((end - laps[1] * length) / width)",
        "np.minimum(np.floor((end - laps[1] * length) / width)",
        "test_image_holds",
    ),
    "outward wall": (
        CELLS,
        "np.ceil((high - drift) / width)",
        "np.floor((high - drift) / width)",
        "test_image_holds",
    ),
    "remainder of link 1": (LINKS, "return 3, l1 * w1 * w1 / 8.0", "return 3, 0.0", "test_hulls_hold_the_links"),
    "remainder of link 2": (LINKS, "w2 * w2)) / 8.0", "w2 * w2)) / 32.0", "test_hulls_hold_the_links"),
    "margin": (LINKS, "CONTACT_MARGIN = 1e-8", "CONTACT_MARGIN = 0.0", "test_contact_within_rounding"),
    "margin of the target": (
        CONTACT,
        "+ remainder + CONTACT_MARGIN <= radius",
        "+ remainder <= radius",
        "test_contact_within",
    ),
    "margin of the pursuer": (CONTACT, "agent.radius + CONTACT_MARGIN +", "agent.radius +", "test_contact_within"),
    "margin of a disk": (CONTACT, "near + remainder + CONTACT_MARGIN", "near + remainder", "test_contact_within"),
    "speed of a disk": (
        CONTACT,
        "radii[disk] + speeds[disk] * near",
        "radii[disk] + 0.0 * near",
        "test_no_time_is_left_out",
    ),
    "undecided parts": (CONTACT, "blocked |= left", "pass", "test_no_time_is_left_out"),
    "start of a part": (
        LINKS,
        "high + max(fast * tau0, fast * tau1)",
        "high + fast * tau0",
        "test_no_time_is_left_out",
    ),
    "end of a part": (LINKS, "low + min(slow * tau0, slow * tau1)", "low + slow * tau0", "test_no_time_is_left_out"),
    "pursuer at the end": (
        CONTACT,
        "agent.speed * agent.delta * (part + 1) / parts",
        "agent.speed * agent.delta * part / parts",
        "left_out_of_the_pursuit",
    ),
    "cell of the pursuer": (LINKS, "highest + growth - agent.y", "highest - agent.y", "test_pursuer_is_met"),
    "walls of the pursuer": (PACKED, "k]) | passes", "k]) & passes", "test_packed_erosion"),
    "slack": (PACKED, "STATE_SLACK = 1e-10", "STATE_SLACK = 0.0", "test_state_on_an_edge"),
    "cells of the image": (PACKED, "range(1, number[i])", "range(1, number[i] - 1)", "test_recursion_agrees"),
    "room to move in": (
        IMAGES,
        "velocity = self.bounds.velocity(j, room[0], room[1], *times)",
        "velocity = self.bounds.velocity(j, ends[0], ends[1], *times)",
        GROWTH,
    ),
    "push of the adversary": (DYNAMICS, "np.stack([drift - spread, drift + spread]", "np.stack([drift, drift]", GROWTH),
    "walls on the way": (PIECES, "moved[side, m, k] = np.nextafter(at_wall", "at_wall = np.nextafter(at_wall", GROWTH),
    "tube between the parts": (
        IMAGES,
        "tube = [moved[0], moved[1]]",
        "tube = [moved[0] + np.inf, moved[1] - np.inf]",
        GROWTH,
    ),
    "upper face": (
        IMAGES,
        "self.bounds.fastest(side, axis",
        "self.bounds.fastest(0, axis",
        "test_damped_motion",
    ),
    "change with time": (BLACK_BOXES, RATE, "0.0", "test_timed_growth_holds"),
    "a box that grows": (
        DYNAMICS,
        "return np.sort(signs * ends, axis=0)",
        "return np.stack([signs * ends[1]] * 2)",
        "test_bounds_that_change",
    ),
    "time of an interval": (
        IMAGES,
        "(time + begin, time + end)",
        "(begin, end)",
        "test_timed_growth_holds",
    ),
    "boxes of a set": (
        GENERAL,
        "high = [begin + step + more",
        "high = [begin + more",
        "test_bounds_of_a_lattice",
    ),
    "rate of a set": (BLACK_BOXES, RATE, "0.0", "test_general_bounds_hold"),
    "size of a box": (BLACK_BOXES, "slope * np.sqrt((by**2).sum(axis=1))", "0.0", "test_general_bounds_hold"),
    "where an axis closes": (BOUNDS, "np.minimum.reduceat(found[0], first)", "found[0][first]", "test_a_box_across"),
    "all cells of an image": (
        STENCILS,
        "at[axis] < number[axis]",
        "at[axis] < number[axis] - 1",
        "test_images_are_inside",
    ),
    "error of the first measurement": (
        IMAGES,
        "self._held(start, before + SIDES * self.unsure)",
        "before.copy()",
        SENSED,
    ),
    "error of the next measurement": (IMAGES, "last + SIDES * self.unsure", "last", SENSED),
    "an early end": (IMAGES, "if begin >= soonest:", "if False:", SENSED),
    "a prediction in the target": (
        IMAGES,
        "self.shell[axis] + self.unsure[axis])",
        "self.shell[axis])",
        SENSED,
    ),
    "a late end": (CELLS, "measured(problem.delta) + late", "measured(problem.delta)", SENSED),
    "rounding of what is added": (
        PIECES,
        "np.nextafter(moved[side, m, k] + step, way * np.inf)",
        "moved[side, m, k] + step",
        "test_what_a_piece_adds",
    ),
    "the length of a piece": (PIECES, "way * 1e-15 * abs(step)", "0.0", "test_what_a_piece_adds"),
    "open sides of a jump": (TAPE, "lesser(b[0, m], c[0, m]))", "c[0, m])", SAMPLES),
}
COMPILED = {"slack", "cells of the image"}  # their tests solve a problem


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    with mutations.started(request, MUTATIONS, "certified", tmp_path_factory, compiled=COMPILED) as started:
        yield started


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_proof_needs_it(name, runs):
    mutations.assert_needed(runs[name].result())
