"""Checks of the exercises of chapter 2."""

import numpy as np

from course.exercises import exercise, expect, expect_close


@exercise(
    "2.1",
    "The greatest speeds are those of the velocity and of the adversary together, and 41 nodes have 40 gaps.",
)
def check_steps(steps):
    """ceil(0.5 (1.3 + 0.8) / (3 / 40) / 0.75)."""
    expect(steps != 18, "the count is the next whole number above: a step must not be longer than allowed.")
    expect(
        steps != 14,
        "does the adversary add to the speed (1.3 and 0.8 m/s)? Does a step take 0.75 of what (2.6) allows?",
    )
    expect(steps not in (12, 20), "rates add over the axes, and 41 nodes have 40 gaps between them.")
    expect_close(steps, 19, "0.5 s times the sum of speed over spacing, divided by the CFL number.")


@exercise(
    "2.2",
    "Two Euler steps multiply by (1 + z)^2. Half of that and half of 1 is G, which is complex: its size is asked for.",
)
def check_amplification(amplification):
    """|1 + z + z^2 / 2|."""
    theta = np.linspace(-np.pi, np.pi, 101)
    for courant in (0.25, 0.75, 1.0):
        z = courant * (np.exp(1j * theta) - 1)
        got = np.asarray(amplification(courant, theta))
        expect(np.isrealobj(got), "return the absolute value of G, a real number for each theta.")
        euler = np.allclose(got, np.abs(1 + z))
        expect(not euler, "that is a single Euler step. Multiply twice by 1 + z, and take the mean with 1.")
        expect_close(got, np.abs(1 + z + z**2 / 2), "half of 1 and half of (1 + z) squared.")
    return "At most 1 up to a CFL number of 1, and closer to it for long waves than Euler's: less is smeared out."


@exercise("2.3", "In `godunov` the largest of the candidates wins. Who chooses here, and is zero a candidate?")
def check_help(helper):
    """min over w of max(w, 0) p+ + min(w, 0) p-."""
    minus, plus = np.random.default_rng(0).normal(size=(2, 400))
    for low, high in ((0.2, 1.0), (-1.0, -0.1), (-0.6, 1.3), (-0.5, 0.5), (0.4, 0.4)):
        w = np.unique([*np.linspace(low, high, 41), *([0.0] if low < 0 < high else [])])[:, None]
        best = np.min(np.maximum(w, 0) * plus + np.minimum(w, 0) * minus, axis=0)
        got = np.asarray(helper(minus, plus, low, high))
        where = f"velocities in [{low}, {high}]"
        expect(
            got <= best + 1e-9, f"{where}: the robot can do better, and may choose any w between, standing still too."
        )
        expect_close(got, best, f"{where}: which side does each velocity look to? Right where w > 0.")


@exercise("2.4", "Follow one state: where is it after tau, if it meets the end on its way, and if it does not?")
def check_wall(at_the_wall):
    """min(x + tau, 1)."""
    x = np.linspace(-1, 1, 41)
    for tau in (0.0, 0.3, 1.0, 2.5):
        got = np.asarray(at_the_wall(x, tau))
        expect(got.shape == x.shape, "x is an array: one cost for each start.")
        expect(np.isfinite(got), "the end is a wall here and not a cliff: the state stays, nothing is lost.")
        expect(got <= 1 + 1e-9, "no state passes the wall at x = 1, so no state pays more than 1.")
        expect_close(got, np.minimum(x + tau, 1.0), "a state that has not yet met the wall pays x + tau.")
    return "A grid whose end is not a wall in the world needs an unsafe margin instead, or pretends that there is one."


def _eno3(values, h):
    """From the definition: nodes i - 1 and i (or i and i + 1), then twice the neighbour with the smaller difference."""
    count, found = len(values), np.zeros((2, len(values)))
    for side, base in enumerate((-1, 0)):
        for i in range(count):
            nodes = [i + base, i + base + 1]
            for _ in range(2):
                left, right = [nodes[0] - 1, *nodes], [*nodes, nodes[-1] + 1]
                sizes = [abs(np.diff(values[np.mod(one, count)], len(nodes))[0]) for one in (left, right)]
                nodes = left if sizes[0] < sizes[1] else right
            places = np.array(nodes) - i
            found[side, i] = np.polyfit(places, values[np.mod(nodes, count)], 3)[2] / h
    return found


@exercise(
    "2.5",
    "Keep three arrays: D between nodes, B = D - D at nodes, C = B - B between nodes. With which factor C enters "
    "is the slope of (i - a)(i - b) / 6 at node i.",
)
def check_third(eno3):
    """Exact for cubics, third order for a sine, one-sided at a kink."""
    n, h = 60, 0.1
    x = h * np.arange(n)
    away = slice(4, -4)
    for power in range(1, 4):
        minus, plus = eno3((x - 2.0) ** power, h)
        expect(np.shape(minus) == (n,) and np.shape(plus) == (n,), "p- and p+ at each of the nodes.")
        exact = power * (x - 2.0) ** (power - 1)
        for name, got in (("p-", minus), ("p+", plus)):
            expect_close(got[away], exact[away], f"{name} is not exact for x^{power}.", within=1e-8)
    errors = []
    for n in (40, 80, 160):
        x = 2 * np.pi / n * np.arange(n)
        minus, plus = eno3(np.sin(x), 2 * np.pi / n)
        errors.append(np.mean(np.abs(minus - np.cos(x)) + np.abs(plus - np.cos(x))))
    order = np.log2(errors[-2] / errors[-1])
    expect(order > 2.7, f"for a sine the error falls with order {order:.1f}. Is the line closed at its ends?")
    rough = np.random.default_rng(0).normal(size=40)
    said = "on values that jump: which four nodes does each difference use? One more is next to those already used."
    expect_close(eno3(rough, 0.5), _eno3(rough, 0.5), said)
    x = 0.1 * (np.arange(60) - 30)
    minus, plus = eno3(np.abs(x), 0.1)
    left, right = slice(6, 30), slice(31, 54)
    expect_close(np.r_[minus[left], plus[right]], np.r_[-np.ones(24), np.ones(23)], "it looks across a kink of |x|.")
    expect_close(
        [minus[30], plus[30]], [-1.0, 1.0], "at the kink p- is the slope on the left, p+ the one on the right."
    )
    return f"Fitted order on a sine: {order:.1f}."


@exercise(
    "2.6",
    "Where would the function have to be concave, and how near to zero would it have to be there? 16 steps of a mean "
    "of two neighbours spread a crest over a few nodes.",
)
def check_filled(lowered, filled):
    """Second differences below zero; two lost nodes claimed by the right scheme."""
    values = np.random.default_rng(0).normal(size=60)
    got = np.asarray(lowered(values))
    expect(got.shape == (60,), "one answer for each node of the periodic line.")
    bend = np.roll(values, -1) - 2 * values + np.roll(values, 1)
    expect(
        not np.array_equal(got, bend > 0),
        "the sign of the term is that of the second derivative: where is that negative?",
    )
    expect(got == (bend < 0), "a node and its two neighbours tell: the second difference, on a line that closes.")
    nodes, courant, steps = 80, 0.5, 16
    x, h = np.linspace(-1.0, 1.0, nodes, endpoint=False), 2.0 / nodes
    start = np.asarray(filled(x), dtype=np.float64)
    expect(start.shape == x.shape, "x is an array: one value for each place.")
    expect(np.abs(np.roll(start, -1) - start) <= h * (1 + 1e-9), "somewhere the slope is more than one, ends included.")
    computed = start
    for _ in range(steps):
        computed = (1 - courant) * computed + courant * np.roll(computed, -1)
    exact = np.asarray(filled(np.mod(x + steps * courant * h + 1.0, 2.0) - 1.0), dtype=np.float64)
    expect(np.any(exact <= 0), "there is nothing to be reached.")
    false = int(np.count_nonzero((computed <= 0) & (exact > 1e-12)))
    expect(
        false >= 2,
        f"{false} lost nodes are claimed. The function has to be concave, and just above zero, between two parts.",
    )
    return f"{false} lost nodes are claimed. The coarser the grid, the wider the gaps that it fills."
