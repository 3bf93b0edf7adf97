"""Certified sets: reach-avoid tubes that hold on a computer, not only on paper.

A grid with interpolation approximates S_k^i; runs that start inside it can fail. Here the state space is cut into
cells (boxes), and a cell is *certified* for (start k, within n) only where a proof says that every state of the cell is
in the tube. The recursion is that of Theorem 2, with sets of cells:

    S_k^0 = cells inside L(t_k) and outside G(t_k)
    S_k^n = S_k^{n-1} and every cell for which some input u_j has (i) an image, everything that can be reached at
            t_{k+1} from anywhere in the cell, covered by cells of S_{k+1}^{n-1}, and (ii) a tube, everywhere the
            state can be during the interval, clear of G(t) at every time.
    S_k^1 has every cell, too, of which a clear input has an image inside L(t_{k+1}), where states are measured exactly:
            the target that a run ends in need not be made of cells (`sdhj.certified.arrivals`).

The obligations of the proof, where each is met, and the test (certified, promises) that fails without it:

1.  *The cells cover the state space, and their edges are exact.* `CellAxis`; numbers are the decimals they are written
    as, the period of an angle is an interval around 2 pi. [test_cells_partition_the_axis]
2.  *The image is outside what can be reached.* For the arm: `moved_bounds`, in fractions, with the adversary's worst
    velocities, and `CellAxis.image`, clipped at walls. [test_image_holds_the_worst_adversary] For the others:
    `Images.swept`, by intervals of the user's own functions. [test_general_reach_box_holds_every_trajectory,
    test_every_sample_is_inside, test_what_a_piece_adds_is_rounded_outward]
3.  *Every cell that the image needs is certified.* `erode_packed`, `erode_rows`, `add_certified`; `rows_inside`, and
    `images_inside` of 64 cells. [test_recursion_agrees_with_the_twin, test_sets_and_inputs_are_all_that_follows,
    test_words_of_cells_are_led_as_plain_loops_say] After a change only words with cells whose images it may be in are
    asked again. [test_every_cell_whose_image_a_change_is_in_is_asked_again]
4.  *All times count, not samples.* The joints are bounded over each part of the interval (`joint_ends`), the pursuer by
    its reach at the part's end (`touch_swept`), a disk by its speed (`steps_blocked`). [test_no_time_is_left_out]
    For the others: the box swept in each part, `mark_collisions`. [test_images_and_tubes_count_in_cells,
    test_cells_are_struck_as_plain_loops_say, test_signs_are_those_of_each_box_and_of_its_pieces,
    test_no_state_of_a_clear_cell_is_met] Each set is asked about on all axes that its tubes depend on, and no others:
    `sdhj.certified.dangers`. [test_a_forgery_is_refused]
5.  *All states of the cell count, not its corners.* The remainder of `link_points`. [test_hulls_hold_the_links]
6.  *A cell of the pursuer counts whole.* `touch_cells`. [test_pursuer_is_met_wherever_it_can_meet]
7.  *Rounding is outward.* `CONTACT_MARGIN`, added to every radius. [test_contact_within_rounding_is_not_clear]
8.  *States and plants are in floating point too.* A state within the *shell* of a certified cell counts as in it: 1e-10
    of the largest coordinate of an axis (`Proof.shell`), of the arm 1e-10 m and rad. Under an input certified for that
    cell the next state is within the shell, plus what the plant rounds, of a certified cell, and the tube as near to a
    clear one: `CONTACT_MARGIN` covers both. `contains` and `fraction` count closed cells (`Proof.rounding`), and the
    shell is the reserve of a run from there: it may drift by that in all, through the plant's rounding, because an
    image may stick out of its cells by 2e-13 of the coordinate, or because a velocity is not the decimal that
    `as_rounded_fraction` takes it for, 5e-13 of it. `CertifiedTable.steps_of_rounding` says for how many steps. Goals
    and tubes hold for states in the shell, too.
    [test_state_on_an_edge, test_a_promised_run_has_a_reserve_for_rounding, test_borders_may_coincide]
9.  *The target is reached by every state of the cell, outside G.* `tips_within` and `cells_clear` at an instant.
    [test_goal_cells_are_inside_the_target] For the others also by all of an image, whatever its cells: `Arrivals`.
    [test_arrivals_on_a_line_are_those_of_the_closed_form, test_no_state_of_a_cell_that_arrives_is_outside_the_target]
10. *What is measured is off* (`Sensing`). The sets are then of predictions, M_k^n of `sdhj.problem.sensing`. An image
    is of the cell widened by E, at every time that the interval may end, and widened by E again; tube and goal are of
    the cell widened by E, at every time that jitter allows. E is proved: `prediction_error`, `prediction_error_along`.
    With memory a cell holds the points that are carried on, whose state is within E: the image is widened by E before
    and shrunk by E after, to its middle at least. What is held at a wall as a whole is known there: the state of a
    layer is not widened along its axis, and no point but one that says so is in it (`Cells.wall_known`).
    [test_no_prediction_is_farther_off_than_proved, test_nobody_who_remembers_is_lost]
11. *The controller finds an input wherever the set promises one.* `arm_inputs` asks the same questions of the same cell
    with half the margin. [test_every_certified_state_has_an_input] For the others: `certified_inputs`.
    [test_sets_and_inputs_are_all_that_follows]

For robots of one's own, what each of these comes to, and what the checker refuses that lacks it: a forgery in
tests/lib/forged_robots.py, of which test_a_forgery_is_refused asks the sentence. In
tests/campaign/test_check_needs_it.py each step of the checker's argument is taken away, and a forgery is believed.

    1    axes: begin, length, whole cells                   "cells that begin elsewhere", "cells that are too narrow"
    1    cells that move alike are alike, and no wall near  "cells that are not alike", "a wall on the way"
    1    layers are at walls, of cells that know where      "a layer at an end that is no wall",
                                                            "a layer at an upper end that is no wall",
                                                            "a layer where an axis closes",
                                                            "a layer of cells that move alike"
    2    the adversary: bounds, gain, any way that it enters "a stronger push", "gusts from the other side"
    2    room for a piece, and the face of each end         "less growth", "growth from the lower end"
    2    walls hold back, on the way, too                   "a wall that holds"
    2    only what a wall holds as a whole is in a layer    "coasting that stays on the layer",
                                                            "the fastest that are not held by the wall"
    2    who brakes onto a layer moves on the way           "braking without a cell more"
    2    dynamics at the time of the step, and all of it    "the tide of another hour", "a little later"
    2, 3 the last cell of a lap is narrower                 "a seam like any other edge"
    3    every cell of an image, in the next set            "a cell more", "a step into sets of another time"
    3    under an input that is clear                       "a cell of which no input is clear"
    3    past a safe end by a cell; no other end counts     "past the lower end by less than a cell", "past a wall"
    3    what is to stay is new each time, also for ever    "a cell that is not safe as long"
    4    what is on the way, in every part and step         "a post not met at the end", "a post that comes later"
    4    each unsafe set is closed; unsafe ends             "a set that is closed", "out by the upper end"
    4    boxes as wide as what tubes are looked up without   test_bounds_of_a_lattice_hold_in_its_boxes
    4    every function of which a set's is the least        "the second post"
    4    laps of a tube, where an axis closes               "a set behind the seam", "a set before the seam"
    3    where all go along, 64 cells at a time             test_words_of_cells_are_led_as_plain_loops_say
    4    only what has wholly left is out of danger         "a rock at a safe end"
    4, 9 an angle on both sides of its jump                 test_every_value_is_on_a_side_of_the_jump
    5    all of a box, not only a part                      "the far half of a tube"
    8    states near a cell, near a tube                    "states near a cell", "a set nearer than rounding"
    9    all of a goal, at its time, outside G              "a goal more", "a goal of another time", "a goal in a post"
    9    all of an image in the target, of known states     "an arrival more", "an arrival that leaves",
                                                            "an arrival nearer than rounding",
                                                            "arrivals of predictions"
    10   predictions: error, delay, each input and time     "predictions that begin where the state is"
    10   moves, tubes and goals of predictions              "one measurement that errs", "a goal beside an error"
    10   points that are carried on, with memory alone      "errors that are forgotten", "images shrunk by too much",
                                                            "a middle that is elsewhere"
    10   layers, for who remembers to be there              "a measurement that errs nowhere",
                                                            "half a shell above a wall", "half a shell below a wall"
    10   a clock that is off                                "no early end", "a post beside an uncertain clock"

What the file states of bounds is believed by nobody: black boxes come from the problem beside it, and are tried at
states of each box. ["a slope of 0", "a slope that the file states", "a sweep that the file states"]

The proof is for the problem as data: arm, disks, speeds, bounds. For a robot of one's own it is for the functions as
they are written, read as exact arithmetic on the numbers in them; what floating point makes of them is within the slack
of 8, which is a share of the coordinates. Velocities may jump. Promises enter only where a function is a
`sdhj.BlackBox`: what its author declares. The unsafe set counts at every instant, so `view_time` makes no difference
here.
"""

import reprlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from tqdm import tqdm

from sdhj.arm.case_studies import as_built
from sdhj.certified.arm.proof import ArmProof
from sdhj.certified.cells import MOST_CELLS, MOST_PIECES, CellAxis, aligned
from sdhj.certified.choosing import chosen_cells
from sdhj.certified.general_proof import GeneralProof
from sdhj.certified.images import GrowsTooFast
from sdhj.certified.table import CellSets
from sdhj.common.checks import Options, number, whole
from sdhj.common.showing import hidden
from sdhj.problem.grid import MAX_NODES
from sdhj.problem.problem import ReachAvoidProblem

ARM_CELLS = (419, 419, 72, 72)
FINER = 32  # times as many parts of an interval are tried where a velocity grows too fast


@dataclass(frozen=True)
class Certified(Options):
    """The method with a proof: its sets hold for every state of a cell, every disturbance and every time (Theorem 2).

    Parameters
    ----------
    cells : sequence of int, optional
        About how many on each axis, adjusted so that cells align with the displacements of one interval, where
        possible. By default chosen by a rule, for what they lose and cost (`sdhj.certified.choosing`); for the arm's
        case study (419, 419, 72, 72).
    seconds : float
        Where cells are chosen: about what a solve may take on two cores, within a factor of three. A problem has the
        same cells on every machine.
    parts : int
        Into how many a sampling interval is cut to bound the tube, for the fastest input. Where a velocity grows too
        fast, up to 32 times as many are tried.

    Raises
    ------
    ValueError
        By `sdhj.solve` if it does not fit the problem, or a bound is missing.

    Notes
    -----
    The image of a cell is a box of cells, where "hji" and "lax" play the true shapes of a disturbance that moves
    several axes together: on a torus of 480 x 480 cells a gust along a diagonal leaves .073 of the states, of .138 that
    can be won; the octagon of a `Ball` .088 of .241; the arc of a heading that is off by up to .6 rad .157 of .189.

    Examples
    --------
    The more cells, the larger the share of the states that is proved:

    >>> import sdhj
    >>> speeds = [[-1.0], [0.0], [1.0]]  # m/s
    >>> problem = sdhj.ReachAvoidProblem(
    ...     grid=sdhj.Grid([-1.0], [1.0], [41]),
    ...     dynamics=sdhj.Dynamics(inputs=speeds, drift=speeds, gain=[[1.0]], bounds=[0.2]),
    ...     target=sdhj.TargetSet((0,), lambda x, t: abs(x[:, 0]) - 0.2),
    ...     unsafe=[],
    ...     delta=0.1,
    ...     steps=5,
    ... )
    >>> methods = [sdhj.Certified(cells=[cells]) for cells in (20, 40, 80)]
    >>> [round(sdhj.solve(problem, method).fraction(start=0, within=5), 2) for method in methods]
    [0.2, 0.45, 0.58]
    """

    cells: Sequence[int] | None = None
    parts: int = 10
    seconds: float = 60.0
    name: ClassVar[str] = "certified"

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", whole("parts", self.parts, least=1, most=MOST_PIECES))
        object.__setattr__(self, "seconds", number("seconds", self.seconds, least=0.0))
        if self.cells is not None:
            try:
                object.__setattr__(self, "cells", tuple(whole("cells", n, least=2, most=MAX_NODES) for n in self.cells))
            except (ValueError, TypeError):
                fits = f"whole numbers from 2 to {MAX_NODES:,}, one for each axis"
                raise ValueError(f"cells must be {fits}, got {reprlib.repr(self.cells)}") from None

    def sets(self, problem: ReachAvoidProblem, progress: bool | None = None) -> "CellSets":
        """The sets of a problem, ready for the recursion; preparing them takes about half of the time of a solve.

        ValueError if a function of the problem has no bound, or an interval leads too many cells on.
        """
        parts, most = self.parts, min(FINER * self.parts, MOST_PIECES)
        while True:
            try:
                # the table, its file and so the checker have the parts that it comes to here
                proof = replace(self, parts=parts).proof(problem)
                if parts == self.parts and not hidden(progress):
                    cells = " x ".join(str(axis.count) for axis in proof.axes)
                    tqdm.write(f"{cells} cells, at most {proof.peak_bytes / 1e6:,.0f} MB and the sets", file=sys.stderr)
                return CellSets(proof, progress)
            except GrowsTooFast as error:
                if parts == most:
                    more = f"use a shorter delta, or more parts than the {parts} that were tried last: "
                    raise ValueError(f"{error}, {more}Certified(parts=...)") from None
                parts = min(2 * parts, most)

    def proof(self, problem: ReachAvoidProblem) -> ArmProof | GeneralProof:
        """An `ArmProof` of the arm's case studies, else a `GeneralProof`, not yet prepared."""
        kind: type[ArmProof] | type[GeneralProof]  # an arm with another set is a robot like any other
        kind = ArmProof if as_built(problem) else GeneralProof
        return kind.of(problem, self.axes(problem), self.parts)

    def axes(self, problem: ReachAvoidProblem) -> tuple[CellAxis, ...]:
        """The cells of each axis: about `cells`, or as many as the rule chooses (`chosen_cells`), and aligned."""
        cells = self.cells
        if cells is None:
            cells = ARM_CELLS if as_built(problem) else chosen_cells(problem, self.parts, self.seconds)
        if len(cells) != problem.grid.ndim:
            raise ValueError(f"cells must be one number for each of the {problem.grid.ndim} axes, got {list(cells)}")
        axes = aligned(problem, cells)
        # before anything is made for each cell of an axis
        if (most := max(axis.count - sum(axis.layers) for axis in axes)) > MOST_CELLS:
            raise ValueError(f"certifying {most:,} cells of one axis; use at most {MOST_CELLS:,}, as a file may have")
        return axes
