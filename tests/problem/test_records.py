"""Bounds from records: a car whose wind and slip are hidden, closed forms, and what is refused."""

from dataclasses import replace
from functools import cache
from math import comb

import numpy as np
import pytest
import zoo

import sdhj
from sdhj import plotting
from sdhj.simulation.records import chance

DRAWS, DT = 200, 0.25  # s
# 200 draws at 95 %: 190 +- 3.1 expected; fewer than 180 happen by chance once in five hundred times.
FEWEST = 180


@cache
def car() -> sdhj.ReachAvoidProblem:
    """A car that slides more, the more it turns."""

    def gain(q, u):
        one, none = np.ones(len(q)), np.zeros(len(q))
        rows = [one, none, none], [none, one, none], [none, none, u[1] * one]
        return np.stack([np.stack(row, axis=1) for row in rows], axis=1)

    return replace(
        zoo.car(),
        grid=sdhj.Grid([-20, -20, -np.pi], [20, 20, np.pi], [41, 41, 32], periodic=[False, False, True]),
        dynamics=sdhj.Dynamics(zoo.INPUTS, zoo.car().dynamics.drift, gain, [0.0, 0.0, 0.0]),
        target=zoo.goal(0.0, 0.0, 5.0),
        unsafe=[],
        delta=DT,
        steps=8,
    )


def driven(rng, hidden, error, records=20, samples=20, held=1) -> list[np.ndarray]:
    """Records by the car's closed form: arcs, blown along; wind and slip are drawn for `held` samples, the noise for
    each."""
    q, rows = rng.uniform(-1, 1, (records, 3)), []
    for k in range(samples + 1):
        if k % held == 0:
            u, v = rng.choice(car().inputs, records), rng.uniform(-1, 1, (records, 3)) * hidden
        rows.append(np.column_stack([np.full(records, k * DT), q + rng.uniform(-1, 1, (records, 3)) * error, u]))
        half, heading = u[:, 1] * (1 + v[:, 2]) * DT / 2, q[:, 2]
        chord = u[:, 0] * DT * np.sinc(half / np.pi)
        q = q + np.column_stack([chord * np.cos(heading + half), chord * np.sin(heading + half), 2 * half])
        q[:, :2] += DT * v[:, :2]
        q[:, 2] = (q[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return list(np.stack(rows, axis=1))


def at_rest(rng, error, samples=400) -> np.ndarray:
    return np.column_stack([0.02 * np.arange(samples), [1.0, 2.0, 3.0] + rng.uniform(-1, 1, (samples, 3)) * error])


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("given", "a better sensor")]


@pytest.mark.parametrize("told", ["nothing to tell", "a record at rest", *SLOW])
@pytest.mark.slow
def test_hidden_wind_and_slip_lie_within_what_is_found(told) -> None:
    rng, within, seen = np.random.default_rng(3), 0, 0
    for _ in range(DRAWS):
        hidden = rng.uniform(0.05, 0.3, 3)
        error = np.zeros(3) if told == "nothing to tell" else rng.uniform(0.001, 0.01, 3)
        records = driven(rng, hidden, np.zeros(3))
        noisy = [one + np.pad(rng.uniform(-1, 1, (len(one), 3)) * error, ((0, 0), (1, 2))) for one in records]
        given = {"error": error} if told in ("nothing to tell", "given") else {"rest": at_rest(rng, error)}
        found = sdhj.bounds_from_records(car(), noisy, **({"better": records} if told == "a better sensor" else given))
        within += bool((found.bounds >= hidden).all() and (found.error >= error).all())
        seen += bool((found.least <= hidden).all())  # up to the model's own rounding, always
        assert (found.bounds < 2.5 * hidden + 0.1).all() and not found.unexplained.any()
    assert within >= FEWEST and seen == DRAWS


def test_without_the_error_noise_is_taken_for_wind(rng) -> None:
    """What one log cannot tell: noise of size e is a push of up to 2 e / dt. The error takes it away again."""
    error = np.array([0.02, 0.02, 0.0])
    records = driven(rng, np.zeros(3), error)
    blown = sdhj.bounds_from_records(car(), records, error=0.0)
    assert (0.7 * 2 * error[:2] / DT < blown.peaks.max(axis=0)[:2]).all()
    assert (blown.peaks.max(axis=0)[:2] <= 2 * error[:2] / DT * (1 + 1e-6)).all() and (blown.least[:2] > 0.1).all()
    assert (sdhj.bounds_from_records(car(), records, error=error).least < 1e-12).all()  # rounding


def test_a_sample_shows_the_mean_of_a_wind(rng) -> None:
    """A wind that changes in the middle of a sample: what is recorded is its mean, below the peak."""
    line = line_problem()
    winds = rng.uniform(-0.2, 0.2, (40, 40))
    ways = [np.column_stack([np.arange(41) * 0.1, [0.0, *np.cumsum(0.1 * (1 + w))], np.ones(41)]) for w in winds]
    every, other = (sdhj.bounds_from_records(line, [w[::n] for w in ways], error=0.0) for n in (1, 2))
    np.testing.assert_allclose(every.peaks[:, 0], np.abs(winds).max(axis=1), rtol=0, atol=1e-12)
    means = np.abs(winds.reshape(40, 20, 2).mean(axis=2)).max(axis=1)
    np.testing.assert_allclose(other.peaks[:, 0], means, rtol=0, atol=1e-12)


def line_problem(**changes) -> sdhj.ReachAvoidProblem:
    given = {"inputs": [[-1.0], [1.0]], "drift": [[-1.0], [1.0]], "gain": [[1.0]], "bounds": [0.0]}
    return zoo.line(dynamics=sdhj.Dynamics(**(given | changes)), delta=0.1, steps=5)


@pytest.mark.slow
def test_bounds_are_those_of_uniform_spacings() -> None:
    """Of uniform peaks the bound is exceeded with probability 1 - confidence exactly, whatever their number."""
    rng, line = np.random.default_rng(5), line_problem()
    for count in (2, 3, 5, 12):
        held = 0
        for _ in range(600):
            winds = rng.uniform(0, 0.2, count)
            ways = [np.array([[0.0, 0.0, 1.0], [0.1, 0.1 * (1 + wind), 1.0]]) for wind in winds]
            held += sdhj.bounds_from_records(line, ways, error=0.0, confidence=0.8).bounds[0] >= 0.2
        assert held / 600 == pytest.approx(0.8, abs=0.065)  # four standard deviations


def test_chances_are_binomial_and_hold() -> None:
    assert chance(1000) == pytest.approx(1 - 0.05 ** (1 / 1000), rel=1e-9) and 1000 * chance(1000) < 3.0
    assert chance(2, 2) == chance(1, 1 + 1) == 1.0 and chance(400, 2) == pytest.approx(4.74 / 400, rel=0.01)
    for count, m in ((20, 1), (50, 3)):
        eps = chance(count, m, 0.9)
        assert sum(comb(count, i) * eps**i * (1 - eps) ** (count - i) for i in range(m)) == pytest.approx(0.1)
    rng = np.random.default_rng(0)  # of n draws of two uniform numbers: how much lies beyond the largest
    largest = rng.uniform(size=(4000, 60, 2)).max(axis=1)
    beyond = 1 - largest.prod(axis=1)
    assert (beyond > chance(60, 2)).mean() == pytest.approx(0.05, abs=0.014)


def test_files_are_read_as_arrays_are(tmp_path, rng) -> None:
    records, still = driven(rng, np.array([0.1, 0.2, 0.1]), np.full(3, 0.001), 5), at_rest(rng, 0.001)
    paths = [tmp_path / f"{i}.csv" for i in range(5)]
    for path, one in zip([*paths, tmp_path / "rest.csv"], [*records, still], strict=True):
        np.savetxt(path, one, delimiter=",", header="t,x,y,heading,speed,turn", fmt="%.17g")
    ours, read = (
        sdhj.bounds_from_records(car(), given, rest=rest)
        for given, rest in ((records, still), (paths, tmp_path / "rest.csv"))
    )
    assert str(ours) == str(read) and "5 records, confidence 95%" in str(read)


def test_a_model_that_lacks_something_is_told(rng) -> None:
    records = driven(rng, np.array([0.1, 0.1, 0.0]), np.zeros(3))
    still = sdhj.Dynamics(car().inputs, car().dynamics.drift, np.eye(3)[:, 2:], [0.1])
    lacking = replace(car(), dynamics=still)
    found = sdhj.bounds_from_records(lacking, records, error=0.001)
    assert (found.unexplained[:2] > 0.01).all() and "the model lacks something" in str(found)


def test_what_does_not_fit_is_refused(rng) -> None:
    records, bounds = driven(rng, np.full(3, 0.1), np.zeros(3), 3), sdhj.bounds_from_records
    with pytest.raises(ValueError, match="error, rest and better"):
        bounds(car(), records)
    with pytest.raises(ValueError, match="error, rest and better"):
        bounds(car(), records, error=0.0, rest=at_rest(rng, 0.1))
    with pytest.raises(ValueError, match="are needed, got 1"):
        bounds(car(), records[:1], error=0.0)
    with pytest.raises(ValueError, match="more, and 6 columns"):
        bounds(car(), [one[:, :5] for one in records], error=0.0)
    with pytest.raises(ValueError, match=r"of records\[0\] must increase"):
        bounds(car(), [one[::-1] for one in records], error=0.0)
    with pytest.raises(ValueError, match="for each of records"):
        bounds(car(), records, better=records[:2])
    straight = [np.hstack([one[:, :4], np.tile([0.5, 0.0], (len(one), 1))]) for one in records]
    with pytest.raises(ValueError, match=r"the records tells v\[2\]"):
        bounds(car(), straight, error=0.0)
    with pytest.raises(ValueError, match="confidence "):
        bounds(car(), records, error=0.0, confidence=1.0)
    with pytest.raises(ValueError, match="error"):
        bounds(car(), records, error=-0.1)


def test_time_in_the_velocity(rng) -> None:
    """A gust that is known, and a wind that is not: each sample has its own time."""
    gusty = line_problem(drift=lambda q, u, t: np.stack([u[0] + 0.5 * np.sin(3 * t) + 0 * q[:, 0]], axis=1))
    winds, t = rng.uniform(-0.2, 0.2, (6, 5)), np.arange(6) * 0.1
    gust = -np.diff(np.cos(3 * t)) * 0.5 / 3
    ways = [np.column_stack([t, [0.0, *np.cumsum(0.1 * (1 + w) + gust)], np.ones(6)]) for w in winds]
    found = sdhj.bounds_from_records(gusty, ways, error=0.0)
    np.testing.assert_allclose(found.peaks[:, 0], np.abs(winds).max(axis=1), rtol=0, atol=1e-6)


def test_what_was_found_is_drawn(rng) -> None:
    found = sdhj.bounds_from_records(car(), driven(rng, np.full(3, 0.1), np.full(3, 0.002)), error=0.002)
    ax = plotting.new_figure(3, 3).subplots()
    plotting.draw_records(ax, found, 1)
    drawn = {line.get_gid(): line for line in ax.lines}
    assert drawn["bound"].get_xdata()[0] == found.bounds[1] and drawn["least"].get_xdata()[0] == found.least[1]
    np.testing.assert_array_equal(drawn["peaks"].get_xdata(), np.sort(found.peaks[:, 1]))
