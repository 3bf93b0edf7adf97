"""What the functions in the cells of chapters say, and those around them."""

from fractions import Fraction

import numpy as np
import pytest
import zoo
from chapters import functions
from course.chapter_03 import explore_value
from course.chapter_05 import explore_games
from course.reading import mathematics

pytestmark = pytest.mark.slow


def test_the_value_of_the_equation_is_that_of_the_worst_signal() -> None:
    """At every corner of the sliders, in all three games."""
    own = functions("03_the_value_function.ipynb", "ride", "solve")
    explorer = explore_value(own["games"])
    for game in ("reach", "avoid", "reach-avoid"):
        for v_max in (0.0, 0.25, 0.8):
            shown = explorer.set(game=game, v_max=v_max, start=-0.1)
            assert shown["value from the equation"] == pytest.approx(shown["costliest run tried"], abs=0.03)
    calm = explorer.set(game="reach", v_max=0.0)["value from the equation"]
    assert explorer.set(v_max=0.4)["value from the equation"] > calm


def test_three_games_at_the_corners() -> None:
    own = functions("05_three_games.ipynb", "g1", "game_1")
    explorer = explore_games(own["rail"], own["games"])
    first = dict(explorer.numbers)
    assert first["all three"] <= min(first[f"game {number}"] for number in (1, 2, 3))
    fast = explorer.set(v_p=1.0)
    assert fast["game 2"] < first["game 2"] and fast["game 1"] == first["game 1"]


def test_the_scheme_of_chapter_2_is_monotone() -> None:
    """Godunov's flux grows with p+ and falls with p-, and equals H where they agree."""
    own = functions("02_upwinding.ipynb", "godunov")
    p, q = np.random.default_rng(0).normal(size=(2, 200))
    for low, high in ((0.1, 1.0), (-1.0, -0.2), (-0.5, 0.8)):
        flux = own["godunov"]
        assert np.allclose(flux(p, p, low, high), np.maximum(low * p, high * p))
        assert (flux(p, q + 0.1, low, high) >= flux(p, q, low, high)).all()
        assert (flux(p + 0.1, q, low, high) <= flux(p, q, low, high)).all()


def test_the_sets_of_a_line_hold_every_end() -> None:
    """K(u) of chapter 16 against every end that a dense set of times and pushes brings about."""
    own = functions("16_the_robot_as_it_is.ipynb", "kept")
    rng, later = np.random.default_rng(0), [(Fraction(-1), Fraction(-1, 5)), (Fraction(0), Fraction(1))]
    for jitter in (Fraction(0), Fraction(1, 20), Fraction(1, 8)):
        for u in (-1, 0, 1):
            found = own["kept"](later, u, Fraction(6, 5), jitter)
            assert found
            ends = np.linspace(0.5 - 2 * float(jitter), 0.5 + 2 * float(jitter), 21)
            for q in rng.uniform(-1.6, 1.6, 300):
                speeds = u + np.linspace(-0.2, 0.2, 21)
                to = q + np.outer(ends, speeds)
                top = max(q, q + ends[-1] * speeds[-1])
                leads_there = top <= 1.2 and any((low <= to).all() and (to <= high).all() for low, high in later)
                assert leads_there == any(low <= q <= high for low, high in found), (jitter, u, q)


def test_who_reckons_with_errors_does_not_lose() -> None:
    """At the widget's own settings, by the chapter's own loop."""
    own = functions("16_the_robot_as_it_is.ipynb", "cart", "drive")
    sdhj, cart = own["sdhj"], own["cart"]
    perfect = own["perfect"]
    assert not own["drive"](perfect, sdhj.Sensing())[1].any()
    for told in ({"error": 0.02, "delay": 0.1, "jitter": 0.02}, {"delay": 0.2}, {"error": 0.05}):
        sensing = sdhj.Sensing(**told, memory=False)
        aware = sdhj.Controller(sdhj.solve(cart(sensing=sensing), progress=False))
        assert own["drive"](aware, sensing)[1].mean() <= 0.005  # interpolated: what chapter 12 is about
        assert own["drive"](perfect, sensing)[1].mean() >= 0.02


def test_what_is_long_and_used_twice_has_a_line_of_its_own() -> None:
    def drift(q: np.ndarray, u: np.ndarray) -> np.ndarray:
        bent = np.sin(q[:, 0]) + np.cos(q[:, 1])
        return np.stack([bent * np.abs(bent), bent], axis=1)

    assert mathematics(zoo.plane(drift=drift))[:3] == ["a = sin(x1) + cos(x2)", "dx1/dt = a |a|", "dx2/dt = a"]
