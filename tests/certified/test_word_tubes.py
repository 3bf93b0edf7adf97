"""Words of boxes and cells, united over windows: against plain loops, and against boxes that are counted."""

import itertools

import numpy as np
import pytest
from forged_robots import ROBOTS
from scipy.ndimage import maximum_filter

import sdhj
from sdhj.certified import word_tubes
from sdhj.certified.cells import CellAxis
from sdhj.certified.general_proof import GeneralProof
from sdhj.certified.packing import words_by_input
from sdhj.certified.word_tubes import Lattice, far_beyond, united, windows, with_margins
from sdhj.common.remembering import read_only
from sdhj.kernels.packed import to_bits, to_words
from sdhj.kernels.windows import ClearWords, add_predecessors


@pytest.mark.parametrize("seed", range(8))
def test_what_tubes_overlap_is_united_as_plain_loops_say(seed):
    """Windows before, across and behind cells of two axes, the last of up to three words, with and without periods."""
    rng = np.random.default_rng(seed)
    counts, fine = [5, int(rng.choice([3, 63, 64, 130]))], rng.integers(1, 4, 2)
    periodic = rng.random(2) < 0.5
    axes = [CellAxis(0, (n, n), 1, bool(wraps)) for n, wraps in zip(counts, periodic, strict=True)]
    lattice = Lattice(axes, np.zeros(2, bool), fine, np.zeros(2), np.zeros(2))
    boxes = rng.random(counts * fine) < 0.1
    first = rng.integers(-6, 7, (6, 2))
    last = first + rng.integers(0, 6, first.shape)
    first[1], last[1] = first[0], last[0]
    planes = np.moveaxis(boxes.reshape(counts[0] * fine[0], counts[1], fine[1]), -1, -2)
    wide = with_margins(to_words(planes), axes[-1], far_beyond(lattice, first, last))
    seen = []
    for some, met in united(wide, lattice, first, last, np.arange(6), 1):
        found = to_bits(met, counts[1])
        for tube in some:
            for cell in np.ndindex(*counts):
                overlapped = [
                    [(b % (n * f) if wraps else min(max(b, 0), n * f - 1)) for b in range(f * c + a, f * c + z + 1)]
                    for c, n, f, a, z, wraps in zip(cell, counts, fine, first[tube], last[tube], periodic, strict=True)
                ]
                assert found[cell] == any(boxes[at] for at in itertools.product(*overlapped))
        seen.append(set(some.tolist()))
    assert set().union(*seen) == set(range(6)) and any({0, 1} <= one for one in seen)


def test_windows_hold_tubes(rng):
    """Boxes from first to last, wider by what they are, hold what a tube sweeps from cell 0, but for what is narrow."""
    axes = [CellAxis(0, (9, 9), 1, False)] * 2
    for _ in range(200):
        fine, low, high = rng.integers(1, 5, 2), rng.uniform(0.0, 0.3, 2), rng.uniform(0.0, 0.3, 2)
        ends = np.sort(rng.uniform(-2.0, 2.0, (1, 2, 2)))
        first, last = windows(Lattice(axes, np.zeros(2, bool), fine, low, high), np.full(2, 0.01), ends)
        assert (first / fine - low <= ends[..., 0] + 0.01 + 1e-12).all()
        assert ((last + 1) / fine + high >= 1.0 + ends[..., 1] - 0.01 - 1e-12).all()


def _clear(monkeypatch, in_words):
    problem, cells, parts = ROBOTS["pursued"]
    proof = GeneralProof.of(problem(), sdhj.Certified(cells=cells).axes(problem()), parts)
    with monkeypatch.context() as patched:
        patched.setattr(word_tubes, "COUNTED", 0 if in_words else 1 << 60)
        assert len(proof.sets_tested_in_words) == 2 * in_words
        proof.prepare(False)
    return proof, np.unpackbits(proof.bits_of_clear[0], axis=-1, bitorder="little", count=4).astype(bool)


@pytest.mark.slow
def test_no_state_of_a_clear_cell_is_met(monkeypatch, rng):
    """Of drawn states, at all times of a step, under drawn plays.

    What is not clear shares a face with a cell that is not by counted boxes either: boxes are half a cell, and in an
    interval the pursuer moves by .1 m, of a cell's .25 m.
    """
    (proof, words), (_, counted) = (_clear(monkeypatch, one) for one in (True, False))
    problem, runs = proof.problem, 40_000
    assert 0.1 < words.mean() < 0.9
    shape, modes = (3, *[axis.count for axis in proof.axes], 4), ["nearest", "nearest", "wrap", "nearest", "nearest"]
    around = [[1, *[3 if k == axis else 1 for k in range(3)], 1] for axis in range(3)]
    near = np.any([maximum_filter(~counted.reshape(shape), size=one, mode=modes) for one in around], axis=0)
    assert not (~words.reshape(shape) & ~near).any() and near.mean() < 0.6
    states = rng.uniform(problem.grid.lower, problem.grid.upper, (runs, 3))
    own = [np.searchsorted(axis.edges(), q, "right") - 1 for axis, q in zip(proof.axes, states.T, strict=True)]
    numbers, met = np.ravel_multi_index(own, [axis.count for axis in proof.axes]), 0
    for step, j in itertools.product(range(problem.steps), range(4)):
        q, push = states.copy(), rng.choice([-1.0, 1.0], (runs, 3)) * [0.4, 0.1, 0.1]
        hit = np.zeros(runs, bool)
        for t in np.linspace(0.0, problem.delta, 11):
            at = q + t * (problem.dynamics.inputs[j] @ np.eye(3)[1:] + push)
            at[:, 0] = np.clip(at[:, 0], -1.0, 1.0)
            hit |= problem.unsafe_value(problem.grid.wrapped(at), problem.time(step) + t) <= 0
        assert not (hit & words[step, numbers, j]).any()
        met += int(hit.sum())
    assert met > 1000


@pytest.mark.slow
def test_cells_are_led_by_inputs_that_are_clear(rng):
    """Of wanted cells that miss nothing those from which some input of a group is clear, as plain loops say."""
    missing, wanted, before = (rng.random((3, 70)) < share for share in (0.4, 0.7, 0.2))
    clear, inputs = rng.integers(0, 256, (213, 2)).astype(np.uint8), np.array([1, 10])
    clear[210:] |= rng.integers(0, 256, (3, 2)).astype(np.uint8)  # of rows alone
    led = to_words(before)
    words = np.concatenate([words_by_input(clear[:210], 70, 16).ravel(), words_by_input(clear[210:], 1, 16).ravel()])
    kinds = ClearWords(*read_only((words, np.array([0, 96]), np.array([6, 3]), np.array([[2, 1], [1, 0]]))))
    add_predecessors(to_words(missing), kinds, inputs, to_words(wanted), led, np.array([3, 70]))
    clear = clear[:210].reshape(3, 70, 2) & clear[210:, None]
    safe = (clear[..., 0] >> 1 & 1) | (clear[..., 1] >> 2 & 1) == 1
    assert np.array_equal(to_bits(led, 70), before | (wanted & ~missing & safe))
    assert 0 < (wanted & ~missing & ~safe & ~before).sum() < (wanted & ~missing & ~before).sum()
