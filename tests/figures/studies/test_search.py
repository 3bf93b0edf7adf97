"""The search for losing adversaries: it finds a planted way to lose that random play misses, and none where there is
a proof."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import search
import zoo
from search import search_losing

import sdhj
from sdhj.certified import CertifiedTable
from sdhj.simulation import runs as simulation
from sdhj.simulation.adversaries import ADVERSARIES
from sdhj.simulation.outcomes import OUTCOMES
from sdhj.simulation.runs import SUBSTEPS, rollouts, simulate
from sdhj.table.controller import Controller

PLAY = ("aggressive", "worst")
COLLIDED = OUTCOMES.index("collided")
NEEDLE = np.array([0.055, -0.037])  # where it is, from where the robot would be without an adversary
START = np.array([-2.4, -0.4])


@cache
def torus_table() -> sdhj.LookupTable:
    return sdhj.solve(zoo.torus_problem(nodes=32), sdhj.HopfLax(), progress=False)


@cache
def certified_table() -> CertifiedTable:
    return sdhj.solve(sdhj.arm_case_study(nodes=9, steps=3), sdhj.Certified(cells=(105, 105, 36, 36)), progress=False)


def planted(radius: float) -> Controller:
    """A table that does not know of a small disk, there at the end of the second interval only."""
    table = torus_table()
    middle = simulate(Controller(table), START, "none").states[2 * SUBSTEPS] + NEEDLE
    end = 2 * table.problem.delta
    needle = sdhj.UnsafeSet(
        (0, 1),
        lambda p, t: np.hypot(np.hypot(*zoo.wrapped(p - middle).T), 10 * (t - end)) - radius,
        name="needle",
    )
    return Controller(replace(table, problem=replace(table.problem, unsafe=(*table.problem.unsafe, needle))))


@pytest.mark.slow
def test_a_needle_that_random_play_misses_is_found() -> None:
    """Two intervals spread the robot over 0.32 x 0.32; the needle is a disk of radius 0.002 in it, so a random run
    hits it with a chance of at most 4 * 0.002^2 pi / 0.32^2 = 5e-4 (a sum of two uniform variables is twice as dense
    as its mean at the most, on each axis). Of 40 searches of 512 runs 26 hit it, of 40 times 512 random runs none."""
    controller, starts = planted(0.002), np.tile(START, (40, 1))
    report = search_losing(controller, starts, population=32, generations=16, progress=False)
    rng = np.random.default_rng(0)
    random = rollouts(controller, np.repeat(starts, 512, axis=0), ADVERSARIES["random"], rng)[0]
    hits = (random == COLLIDED).reshape(40, 512).any(axis=1).sum()
    assert report.count("collided") == report.lost.sum() >= 15 > 3 >= hits
    assert (report.generation[report.lost] > 0).all()  # not by luck in the first, which is random
    assert (report.clearance[report.lost] <= 0).all() and (report.clearance[~report.lost] > 0).all()
    run = simulate(controller, START, report.adversary(int(report.lost.argmax())))
    assert run.outcome == "collided" and len(run.times) == 2 * SUBSTEPS + 1


@pytest.mark.slow
def test_where_a_proof_says_so_nobody_wins() -> None:
    report = search_losing(Controller(certified_table()), 100, population=16, generations=4, progress=False)
    assert not report.lost.any() and (report.outcomes == OUTCOMES.index("reached")).all()
    assert report.clearance.min() > 0 and report.depth.min() >= 0
    assert 100 * 16 < report.rollouts <= 100 * 16 * 4  # those that start in the target play one generation
    assert (report.generation == -1).all() and "0 of 100 starts" in str(report)


@pytest.mark.slow
def test_a_proof_against_a_weaker_adversary_is_refuted() -> None:
    """The adversary may do a fifth more than the table was certified for. The search finds more starts that lose
    than the strongest of the named adversaries does, and many more than random play with as many runs."""
    table = certified_table()
    drift, gain, bounds = table.problem.dynamics.arrays
    stronger = sdhj.Dynamics(table.problem.inputs, drift, gain, 1.2 * bounds)
    proof = replace(table.proof, problem=replace(table.problem, dynamics=stronger))
    controller = Controller(replace(table, proof=proof))
    report = search_losing(controller, 150, population=16, generations=8, progress=False)
    named = {name: rollouts(controller, report.starts, ADVERSARIES[name], np.random.default_rng(0))[0] for name in PLAY}
    failed = {name: int((outcomes != OUTCOMES.index("reached")).sum()) for name, outcomes in named.items()}
    again = np.repeat(report.starts, 128, axis=0)
    random = rollouts(controller, again, ADVERSARIES["random"], np.random.default_rng(0))[0].reshape(150, 128)
    luck = int((random != OUTCOMES.index("reached")).any(axis=1).sum())
    assert report.lost.sum() >= 10 and report.lost.sum() > 1.5 * max(failed.values()) and report.lost.sum() > 1.5 * luck


@pytest.mark.slow
def test_plans_keep_to_the_box_and_reproduce_what_they_did() -> None:
    controller = planted(0.02)
    report = search_losing(controller, 60, population=12, generations=3, switches=2, seed=5, progress=False)
    assert report.plans.shape == (60, 3, 2, 2) and (np.abs(report.plans) <= 1.0).all()
    outcomes = [simulate(controller, q, report.adversary(i)).outcome for i, q in enumerate(report.starts)]
    assert outcomes == [OUTCOMES[place] for place in report.outcomes]
    assert report.lost.any() and not report.lost.all()


@pytest.mark.slow
def test_a_seed_fixes_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    controller = planted(0.02)
    monkeypatch.setattr(search, "CHUNK", 32)
    one, other = (search_losing(controller, 20, population=8, generations=3, seed=s, progress=False) for s in (1, 2))
    monkeypatch.setattr(search, "threads", lambda: 1)
    again = search_losing(controller, 20, population=8, generations=3, seed=1, progress=False)
    for name in ("starts", "outcomes", "generation", "plans", "clearance", "depth", "rollouts"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    assert (one.starts != other.starts).all()
    assert len(np.unique(one.starts, axis=0)) == 20


def test_each_generation_is_no_worse() -> None:
    controller = Controller(torus_table())
    starts = simulation.admissible_states(controller, 20, np.random.default_rng(0))
    least = [
        search_losing(controller, starts, population=8, generations=n, progress=False).clearance for n in (1, 2, 6)
    ]
    assert (least[1] <= least[0]).all() and (least[2] <= least[1]).all() and (least[2] < least[0]).mean() > 0.3


def test_what_does_not_fit_is_refused() -> None:
    controller = Controller(torus_table())
    for options, message in (
        ({"population": 3}, "population"),
        ({"generations": 0}, "generations "),
        ({"switches": 3}, "switches must divide 20"),
        ({"switches": 0}, "switches "),
        ({"seed": -1}, "seed "),
        ({"starts": 0}, "starts "),
        ({"starts": np.empty((0, 2))}, "no state"),
        ({"starts": [[np.nan, 0.0]]}, "NaN"),
    ):
        with pytest.raises(ValueError, match=message):
            search_losing(controller, **{"starts": 5, **options})
    with pytest.raises(sdhj.NotAdmissible, match="start 1"):
        search_losing(controller, [START, [3.0, 3.0]])
