"""Chapter 13, Certificates: what it draws, its widgets, and the checks of its exercises."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import product
from math import gcd, lcm
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from course.chapter_09 import draw_over
from course.exercises import exercise, expect
from course.slices import HERE, LIVE, POSTURE, draw_slice_legend, here
from course.widgets import Explorer, Numbers, agent_sliders, slider, step_sliders
from sdhj.plotting import plane, step_colours
from sdhj.plotting.looks import FULL_LOOKS, INNER_LOOKS, OUTCOME_INK, UNSAFE_LOOKS
from sdhj.table.batches import Table

# ---- pictures

Claims = dict[tuple[int, int], tuple[int, int | None]]  # (step, cell): steps to go, input
ENDS, TARGET, DELTA, STEPS = 1.5, 0.3, 0.25, 4
ARROWS = {-1: "<", 0: "·", 1: ">"}


def draw_line(ax: Axes, cells: int, certificate: Claims, post: Callable[[Any], Any]) -> None:
    """Certified cells of each step, coloured by steps to go, over the way of the post; time runs upwards."""
    image, colours = np.zeros((STEPS + 1, cells, 4)), step_colours(STEPS)
    for (k, cell), (n, u) in certificate.items():
        image[k, cell] = colours[n]
        if u is not None and cells <= 60:
            x = -ENDS + (cell + 0.5) * 2 * ENDS / cells
            ax.text(x, k * DELTA, ARROWS[u], ha="center", va="center", fontsize=7, color="white" if n < 2 else "black")
    half = 0.35 * DELTA
    for k in range(STEPS + 1):
        extent = (-ENDS, ENDS, k * DELTA - half, k * DELTA + half)
        ax.imshow(image[k : k + 1], extent=extent, origin="lower", aspect="auto", interpolation="nearest", zorder=2.0)
    times = np.linspace(0, STEPS * DELTA, 2)
    left, right = np.array([[float(end) for end in post(t)] for t in times]).T
    ax.fill_betweenx(times, left, right, zorder=3.0, alpha=0.8, gid="post", **UNSAFE_LOOKS)
    for end in (-TARGET, TARGET):
        ax.axvline(end, color=OUTCOME_INK, linewidth=0.9, linestyle="--", zorder=4.0)
    ax.set(xlim=(-ENDS, ENDS), ylim=(-0.6 * DELTA, (STEPS + 0.6) * DELTA), xlabel="$x$")
    ax.set_yticks(DELTA * np.arange(STEPS + 1), [f"{k}" for k in range(STEPS + 1)])


def draw_line_game(figure: Figure, cases: dict[str, tuple[int, Claims]], post: Callable[[Any], Any]) -> None:
    """Certificates on a line side by side."""
    axes = np.atleast_1d(figure.subplots(1, len(cases), sharey=True))
    for ax, (title, (cells, certificate)) in zip(axes, cases.items(), strict=True):
        draw_line(ax, cells, certificate, post)
        ax.set_title(title)
    axes[0].set_ylabel("step $k$")


def draw_certified(
    figure: Figure,
    table: Table,
    certified: Any,
    *,
    state: Sequence[float],
    start: int = 0,
    within: int | None = None,
) -> Numbers:
    """What is proved (dark) of what interpolation says (light), on a slice through the pursuer in `state`."""
    within = table.steps - start if within is None else min(within, table.steps - start)
    where = plane(table.grid, state, resolution=LIVE)
    said, proved = (where.shaped(t.contains(where.points, start=start, within=within)) > 0 for t in (table, certified))
    right = draw_over(figure, table.problem, where, state, start, (said, proved))
    right.plot(*here(table.grid, state), **HERE)
    right.set_title(f"from step {start}, within {within} steps")
    areas = (FULL_LOOKS, "inside by interpolation only"), (INNER_LOOKS, "proved")
    draw_slice_legend(
        figure, table.problem, *(Patch(facecolor=looks["facecolor"], label=told) for looks, told in areas)
    )
    return {
        "slice inside by interpolation": float(said.mean()),
        "slice proved": float(proved.mean()),
        "proved and not inside by interpolation": float((proved & ~said).mean()),
    }


# ---- widgets


def explore_line(certify: Callable[..., Claims], post: Callable[[Any], Any]) -> Explorer:
    """The certificate on a line for any number of cells and any wind, by the function that the chapter wrote."""

    def draw(figure: Figure, cells: int, wind: int) -> Numbers:
        certificate = certify(cells, Fraction(wind, 100))
        draw_line(figure.subplots(), cells, certificate, post)
        return {
            "certified from step 0": sum(k == 0 for k, _ in certificate) / cells,
            "claims": len(certificate),
            "a wind's way, in cells": 0.25 * wind / 100 * cells / (2 * ENDS),
        }

    controls = {
        "cells": slider("cells", 20, 240, 1, 60),
        "wind": slider("wind, at most (1/100)", 0, 80, 5, 20),
    }
    return Explorer(
        draw,
        controls,
        size=(6.4, 3.2),
        alt="Certified cells of a line at steps 0 to 4",
        motion="cells",
        named=(61, 120, 121),
    )


def explore_certified(table: Table, certified: Any) -> Explorer:
    """What of an interpolated table is certified, slice by slice."""

    def draw(figure: Figure, px: float, py: float, start: int, within: int) -> Numbers:
        return draw_certified(figure, table, certified, state=(*POSTURE, px, py), start=start, within=within)

    return Explorer(
        draw,
        {**agent_sliders(table.problem), **step_sliders(table)},
        size=(8.6, 3.8),
        alt="Certified and interpolated tube",
        motion="px",
    )


# ---- checks


@exercise("13.1", "The left end moves with the least velocity, the right end with the greatest.")
def check_image(after):
    """[3/5 - 3/10, 13/20 - 1/5]."""
    wanted = Fraction(3, 5) - Fraction(3, 10), Fraction(13, 20) - Fraction(1, 5)
    expect(len(after) == 2, "a pair: the left and the right end.")
    expect(all(isinstance(end, Fraction) for end in after), "as Fractions, so that nothing is rounded.")
    expect(after[0] != Fraction(7, 20) or after[1] != Fraction(2, 5), "that is without the adversary.")
    expect(tuple(after) == wanted, "left end: a + delta (u - 1/5); right end: b + delta (u + 1/5).")


def _truth(a, b, u, wind, post, delta):
    """One side throughout: two linear functions of tau, each positive at both ends of the interval."""
    left, left_rate, right, right_rate = post
    below = (left - b, left + left_rate * delta - b - delta * (u + wind))
    above = (a - right, a + delta * (u - wind) - right - right_rate * delta)
    return min(below) > 0 or min(above) > 0


@exercise(
    "13.2",
    "A linear function is positive on an interval if it is so at both ends. Do this for each side of its own.",
)
def check_clear(stays_clear):
    """Random fractions, those that touch, and those that change sides."""
    delta, wind = Fraction(1, 4), Fraction(1, 5)
    jumped = Fraction(0), Fraction(1, 10), 30, wind, (Fraction(1), Fraction(0), Fraction(2), Fraction(0)), delta
    expect(not stays_clear(*jumped), "a cell that is left of the post at first and right of it in the end has met it.")
    touched = Fraction(0), Fraction(1), 0, Fraction(0), (Fraction(1), Fraction(0), Fraction(2), Fraction(0)), delta
    expect(not stays_clear(*touched), "closed intervals that share a point are not clear of each other.")
    late = Fraction(0), Fraction(1), 0, Fraction(0), (Fraction(2), Fraction(-5), Fraction(9), Fraction(0)), delta
    expect(not stays_clear(*late), "the post may arrive during the interval: look at its end too.")
    rng = np.random.default_rng(0)
    for _ in range(3000):
        a, width, left, thick = (Fraction(int(n), 20) for n in (*rng.integers(-20, 20, 1), *rng.integers(1, 20, 3)))
        rates = [Fraction(int(n), 10) for n in rng.integers(-20, 21, 2)]
        u = int(rng.integers(-1, 2))
        given = a, a + width, u, wind, (left, rates[0], left + thick, rates[1]), delta
        if left + thick + rates[1] * delta < left + rates[0] * delta:
            continue  # the post has turned inside out
        got = stays_clear(*given)
        expect(bool(got) == _truth(*given), f"for a, b, u, wind, post, delta = {given} the answer should be {not got}.")


@exercise("13.3", "Over a common denominator the ways are whole numbers, and these have a greatest common divisor.")
def check_aligned(aligned_width):
    """The greatest common divisor of the fractions delta (u +- wind)."""
    rng = np.random.default_rng(0)
    for delta, inputs, wind in (
        (Fraction(1, 4), (-1, 0, 1), Fraction(1, 5)),
        (Fraction(1, 4), (1,), Fraction(1, 5)),
        (Fraction(1, 10), (Fraction(-3), Fraction(-3, 2), 0, Fraction(3, 2), Fraction(3)), Fraction(3, 10)),
        (Fraction(1, 3), (0, 2), Fraction(1, 7)),
        (Fraction(1, 4), (-1, 1), Fraction(3, 10)),
        *(
            (Fraction(int(a), int(b)), (int(c), int(c * d)), Fraction(int(e), int(f)))
            for a, b, c, d, e, f in rng.integers(1, 40, (200, 6))
        ),
    ):
        width = aligned_width(delta, inputs, wind)
        expect(not isinstance(width, float), "as a Fraction, so that nothing is rounded.")
        expect(width > 0, "a width is positive.")
        ways = [delta * (Fraction(u) + sign * wind) for u in inputs for sign in (-1, 1)]
        common = lcm(*(way.denominator for way in ways))
        wanted = Fraction(gcd(*(int(way * common) for way in ways)), common)
        hint = f"delta {delta}, inputs {[str(u) for u in inputs]}, wind {wind}"
        fits = all((way / width).denominator == 1 for way in ways)
        expect(fits, f"{hint}: some way is no whole number of widths.")
        expect(width == wanted, f"{hint}: {width} fits, and {wanted / width} times as wide fits as well.")


def _game():
    """What is needed to judge claims: cells of two widths, a gate shut for an interval, a post at an instant."""
    edges = sorted(
        {Fraction(-1) + Fraction(i, 10) for i in range(15)} | {Fraction(1, 2) + Fraction(i, 20) for i in range(11)}
    )
    delta, wind, steps, target = Fraction(1, 4), Fraction(1, 10), 4, (Fraction(1, 5), Fraction(9, 10))

    def moved(a, b, u):
        return a + delta * (u - wind), b + delta * (u + wind)

    def safe(a, b, u, k):
        if u is None:
            return not (k == 3 and Fraction(3, 5) <= a and b <= Fraction(4, 5))
        return not (k == 1 and a < Fraction(-1, 5))

    return edges, target, steps, moved, safe


def _met(key, claim, edges, target, steps, moved, safe):
    """The step and the number of each cell that the image of a claim meets."""
    low, high = moved(edges[key[1]], edges[key[1] + 1], claim[1])
    return [(key[0] + 1, m) for m in range(len(edges) - 1) if edges[m + 1] > low and edges[m] < high]


def _faults(key, claim, certificate, edges, target, steps, moved, safe):
    """Everything that is wrong with a claim, in words."""
    (k, c), (n, u) = key, claim
    a, b = edges[c], edges[c + 1]
    if n == 0:
        if not (target[0] <= a and b <= target[1]):
            yield f"n = 0 outside the target is false, {'on its left' if a < target[0] else 'on its right'} too."
        if not safe(a, b, None, k):
            yield "n = 0 in the target, and in G at that instant: safe(a, b, None, k)."
        return
    if k + n > steps:
        yield "after the last step there is no step: k + n <= steps."
    if not safe(a, b, u, k):
        yield "a claim that is not safe on the way is false."
    low, high = moved(a, b, u)
    if low < edges[0] or high > edges[-1]:
        yield f"an image that leaves the line on the {'left' if low < edges[0] else 'right'} is covered by no cell."
    met = _met(key, claim, edges, target, steps, moved, safe)
    if not all(cell in certificate for cell in met):
        yield "a missing cell: whoever leans on it is false."
    if any(certificate.get(cell, (0,))[0] >= n for cell in met):
        yield "every cell that the image meets must have fewer steps to go than the claim itself."


def _true_claims(edges, target, steps, moved, safe):
    """A certificate whose claims are all true."""
    found, rest = {}, (edges, target, steps, moved, safe)
    for k in range(steps, -1, -1):
        for n in range(steps - k + 1):
            for c in range(len(edges) - 1):
                for claim in [(n, u) for u in ((-1, 0, 1) if n else (None,))]:
                    if (k, c) not in found and not [*_faults((k, c), claim, found, *rest)]:
                        found[k, c] = claim
    return found


def _forgeries(rng, most=12):
    """Certificates with a claim that has a single fault, up to `most` of each kind; and with a single cell missing."""
    rest, kinds = _game(), {}
    true, cells = _true_claims(*rest), len(rest[0]) - 1
    for key in product(range(rest[2] + 1), range(cells)):
        for claim in [(0, None), *product(range(1, rest[2] + 1), (-1, 0, 1))]:
            faults = [*_faults(key, claim, true, *rest)]
            if len(faults) < 2:
                kinds.setdefault("".join(faults), []).append((key, claim))
    for key, claim in kinds.pop(""):
        for place in _met(key, claim, *rest) if claim[0] else ():
            kinds.setdefault(place[1], []).append((key, claim, place))
    for found in kinds.values():
        for chosen in rng.permutation(len(found))[:most]:
            key, claim, *missing = found[chosen]
            yield {other: said for other, said in (true | {key: claim}).items() if other not in missing}


@exercise(
    "13.4",
    "For n = 0: in the target, and safe at the instant. For n >= 1: steps enough, safe on the way, the image on "
    "the line, and every cell that it meets needs fewer steps.",
)
def check_claims(claims_that_fail):
    """A true certificate; others with a single fault or a cell missing; and others with a dozen forged or left out."""
    rest = _game()
    true, rng, cells, steps = _true_claims(*rest), np.random.default_rng(0), len(rest[0]) - 1, rest[2]
    said = "in a true certificate nothing is false; cells that the image does not meet are nobody's business."
    expect(set(claims_that_fail(dict(true), *rest)) == set(), said)
    forgeries = [*_forgeries(rng)]
    for _ in range(30):
        forged = dict(true)
        for _ in range(12):
            key, n = (int(rng.integers(steps + 1)), int(rng.integers(cells))), int(rng.integers(steps + 1))
            forged[key] = n, (int(rng.integers(-1, 2)) if n else None)
            forged.pop((int(rng.integers(steps + 1)), int(rng.integers(cells))), None)
        forgeries.append(forged)
    for forged in forgeries:
        faults = {key: next(_faults(key, claim, forged, *rest), "") for key, claim in forged.items()}
        false, got = {key for key, fault in faults.items() if fault}, set(claims_that_fail(dict(forged), *rest))
        missed = min(false - got, default=None)
        expect(missed is None, f"claim {missed} was believed: {faults.get(missed)}")
        expect(got <= false, f"claim {min(got - false, default=None)} is true, and was called false.")


@exercise("13.5", "One np.nextafter outwards after each of the three operations, not one at the end.")
def check_outward(outward_image):
    """Contained, and within a few units in the last place."""
    rng = np.random.default_rng(0)
    cases = [tuple(rng.uniform(-1, 1, 5)) for _ in range(2000)]
    cases += [(1e16, 1e16, 1.0, 0.1, 0.1), (0.1, 0.2, -0.3, 1e-17, 0.7), (-1e-300, 1e-300, 1e-8, 1e-12, 0.25)]
    cases += [(1.0, 1.0, 1e-17, 0.0, 1.0), (0.1, 0.3, 0.3, 0.1, 3.0), (0.0, 0.0, 0.0, 0.0, 0.5)]
    for a, width, u, wind, tau in cases:
        b, wind, tau = a + abs(width) if abs(a) < 1e10 else a, abs(wind), abs(tau)
        low, high = outward_image(a, b, u, wind, tau)
        exact_low = Fraction(a) + Fraction(tau) * (Fraction(u) - Fraction(wind))
        exact_high = Fraction(b) + Fraction(tau) * (Fraction(u) + Fraction(wind))
        given = f"a, b, u, wind, tau = {(a, b, u, wind, tau)}"
        expect(Fraction(float(low)) <= exact_low, f"{given}: the left end is inside the exact image.")
        expect(Fraction(float(high)) >= exact_high, f"{given}: the right end is inside the exact image.")
        size = max(abs(a), abs(b), abs(tau * u), abs(tau * wind), 1e-290)
        slack = 16 * Fraction(float(np.spacing(size)))
        expect(exact_low - Fraction(float(low)) <= slack, f"{given}: the left end is farther out than it has to be.")
        expect(Fraction(float(high)) - exact_high <= slack, f"{given}: the right end is farther out than it has to be.")
