"""Slow twin of the controller's kernel, in plain loops. Imports nothing from sdhj.

A grid is the dictionary {lower, spacing, shape, periodic}, each with one entry for an axis.
"""

import itertools
import math


def position(q, axis, grid):
    """The coordinate counted in cells from the first node, clipped at walls."""
    p = (q - grid["lower"][axis]) / grid["spacing"][axis]
    return p if grid["periodic"][axis] else min(max(p, 0.0), grid["shape"][axis] - 1.0)


def node(i, axis, grid):
    return i % grid["shape"][axis] if grid["periodic"][axis] else min(i, grid["shape"][axis] - 1)


def surrounding(point, axes, grid):
    """(weight, multi-index) of every node of the cell around a point that has a weight, on the subgrid of `axes`."""
    found = []
    for sides in itertools.product((0, 1), repeat=len(axes)):
        weight, index = 1.0, []
        for axis, side in zip(axes, sides, strict=True):
            p = position(point[axis], axis, grid)
            left = math.floor(p)
            weight *= p - left if side else 1.0 - (p - left)
            index.append(node(left + side, axis, grid))
        if weight > 0.0:
            found.append((weight, tuple(index)))
    return found


def interpolated(values, point, axes, grid):
    return sum(weight * float(values[index]) for weight, index in surrounding(point, axes, grid))


def largest_in_box(values, low, high, order, grid):
    """Maximum over the box [low, high] taken one axis after the other, order[0] first, all others held at nodes."""

    def reduced(done, index):
        if done == 0:
            return float(values[tuple(index)])
        axis = order[done - 1]
        first, last = position(low[axis], axis, grid), position(high[axis], axis, grid)
        inner = range(math.ceil(first), math.floor(last) + 1)
        candidates = []
        for p in (first, last, *inner):
            left = math.floor(p)
            value = 0.0
            for weight, i in ((1.0 - (p - left), left), (p - left, left + 1)):
                if weight > 0.0:
                    index[axis] = node(i, axis, grid)
                    value += weight * reduced(done - 1, index)
            candidates.append(value)
        return max(candidates)

    return reduced(len(order), [0] * len(order))


def planes_around(pieces, ways, pairs, grid):
    """(normal, greatest n . x) of planes around boxes (low, high), in the plane of each pair of axes; ways a turn."""
    planes = []
    for a, b in pairs:
        for k in range(ways):
            normal = [0.0] * len(grid["spacing"])
            normal[a] = math.cos(2 * math.pi * k / ways) / grid["spacing"][a]
            normal[b] = math.sin(2 * math.pi * k / ways) / grid["spacing"][b]
            if 4 * k % ways:
                corners = itertools.chain(*(itertools.product(*zip(*box, strict=True)) for box in pieces))
                planes.append((normal, max(sum(map(math.prod, zip(normal, x, strict=True))) for x in corners)))
    return planes


def slabs_between(low, high, planes, grid):
    """Boxes (low, high) of at most a quarter of a cell on all axes but the last that planes cut, and between these."""
    own = [axis for axis in range(len(low)) if any(normal[axis] for normal, _ in planes)]
    cuts = [1] * len(low)
    for axis in own[:-1]:
        cuts[axis] = max(math.ceil(4 * (high[axis] - low[axis]) / grid["spacing"][axis]), 1)
    for at in itertools.product(*map(range, cuts)):
        wide = [(b - a) / count for a, b, count in zip(low, high, cuts, strict=True)]
        first = [a + i * w for a, i, w in zip(low, at, wide, strict=True)]
        last = [a + w for a, w in zip(first, wide, strict=True)]
        for normal, most in planes:
            rest = sum(min(n * a, n * b) for n, a, b in zip(normal[: own[-1]], first, last, strict=False))
            if normal[own[-1]] > 0:
                last[own[-1]] = min(last[own[-1]], (most - rest) / normal[own[-1]])
            elif normal[own[-1]] < 0:
                first[own[-1]] = max(first[own[-1]], (most - rest) / normal[own[-1]])
            elif rest > most:
                first[own[-1]] = math.inf
        if first[own[-1]] <= last[own[-1]] + 1e-9 * grid["spacing"][own[-1]]:
            yield first, last


def largest_in_set(values, low, high, halves, planes, order, grid):
    """Maximum over a box and segments from -half to half, over boxes no more than half a cell apart along each.

    Or, where there are planes, over slabs between them.
    """
    if planes:
        return max(largest_in_box(values, *slab, order, grid) for slab in slabs_between(low, high, planes, grid))
    each = []
    for half in halves:
        cells = max(abs(h) / dx for h, dx in zip(half, grid["spacing"], strict=True))
        count = math.ceil(4 * cells)
        each.append([[(2 * i / count - 1) * h for h in half] for i in range(count + 1)])
    most = -math.inf
    for moves in itertools.product(*each):
        shift = [sum(move[axis] for move in moves) for axis in range(len(low))]
        most = max(most, largest_in_box(values, low + shift, high + shift, order, grid))
    return most


def corners_of(low, high, halves, planes, grid):
    """Of a box its corners; with segments the ends that lie farthest in these directions.

    With planes, the last places on the ways there from the middle of the box that are not beyond one.
    """
    corners, middle = [], [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    for sides in itertools.product((-1, 1), repeat=len(low)):
        corner = [a if side < 0 else b for side, a, b in zip(sides, low, high, strict=True)]
        for half in halves:
            towards = sum(side * h / dx for side, h, dx in zip(sides, half, grid["spacing"], strict=True))
            corner = [x + (h if towards >= 0 else -h) for x, h in zip(corner, half, strict=True)]
        share = 1.0
        for normal, most in planes:
            here, there = (sum(map(math.prod, zip(normal, x, strict=True))) for x in (middle, corner))
            share = min(share, (most - here) / (there - here)) if there > here else share
        if planes:
            corner = [a + max(share, 0.0) * (b - a) for a, b in zip(middle, corner, strict=True)]
        corners.append(corner)
    return corners


def decide(q, tubes, following, marks, boxes, order, avoid, grid, true, within=1):
    """Steps to go (None where not admissible), safe inputs, margins and the best input at one state.

    Parameters
    ----------
    tubes : list of arrays, S_k with 0, 1, ... steps to go
    following : list of arrays, S_{k+1} with 0, 1, ... steps to go; empty at the last step
    marks : list of bool arrays (*shape, L), which inputs each node marks, for each n
    boxes : list of (low, high, halves, planes), what each input can lead to: corners of a box, segments around these,
        or what is between planes (normal, greatest n . x)
    avoid : list of (axes, values (L, *shape of those axes))
    true : what the true sets say: {"unsafe": of q, "off the target": of q, "passes": callable (j, steps left)}, bools
    within : judge inputs by the tube of so many steps to go where that is more than the fewest
    """
    axes = list(range(len(q)))
    fewest = to_go = next((n for n, tube in enumerate(tubes) if interpolated(tube, q, axes, grid) <= 0.0), None)
    if to_go == 0 and true["off the target"]:
        to_go = 1 if following else None
    if to_go is None or true["unsafe"] or not following:
        return None if true["unsafe"] else to_go, [], [], None
    inputs, nodes = range(len(boxes)), [index for _, index in surrounding(q, axes, grid)]
    hazard = [max(interpolated(values[j], q, axes, grid) for axes, values in avoid) for j in inputs]

    def by_tube(n):
        margins = [largest_in_set(following[n - 1], *box, order, grid) for box in boxes]
        marked = [all(marks[n][index][j] for index in nodes) for j in inputs]
        first = [j for j in inputs if marked[j] and margins[j] <= 0.0]
        return margins, marked, first, [j for j in inputs if margins[j] <= 0.0 and hazard[j] <= 0.0]

    n = max(to_go, within)
    margins, marked, first, second = by_tube(n)
    if fewest == n < len(following) and not first and not second:
        longer = by_tube(n + 1)
        if longer[2] or longer[3]:  # it makes the promise of one step more
            margins, marked, first, second = longer
            n = to_go = n + 1
    safe = sorted(first or second, key=lambda j: (margins[j], j))
    while safe and not true["passes"](safe[0], n - 1):
        del safe[0]
    if safe:
        return to_go, sorted(safe), margins, safe[0]
    both = [max(margin, h) for margin, h in zip(margins, hazard, strict=True)]
    if first or second:
        least = min(first or second, key=lambda j: (margins[j], j))
    else:
        least = min(inputs, key=lambda j: (not marked[j], both[j], j))
    ranked = [least, *sorted(set(inputs) - {least}, key=lambda j: (both[j], j))]
    passing = [j for j in ranked if both[j] < math.inf and true["passes"](j, n - 1)]
    return to_go, [], margins, passing[0] if passing else least


def looked_at(q, path, box, grid, times, unsafe, target):
    """Whether neither the path, at its times, nor the corners of a box at the last of them meet the unsafe set.

    With a target the corners have to be in it. Walls are the caller's.
    """
    corners = corners_of(*box, grid)
    places = [*zip(path, times, strict=True), *((corner, times[-1]) for corner in corners)]
    if any(unsafe(place, t) for place, t in places):
        return False
    return target is None or all(target(corner, times[-1]) for corner in corners)


def best(safe, scores, margins):
    """The input of least score in each row, of equals the one of least margin, then the first; -1 where none is safe.

    safe, margins: (M, L); scores: one for each safe pair, row after row.
    """
    scores, chosen = iter(scores), []
    for row, margin in zip(safe, margins, strict=True):
        ranked = [(next(scores), margin[j], j) for j in range(len(row)) if row[j]]
        chosen.append(min(ranked)[2] if ranked else -1)
    return chosen


def fallback_scores(q, following, boxes, avoid, grid):
    """For each input (avoid tube, margin) at one state, by which the fallback takes the least.

    The margin is the largest value of the last of `following` at the corners of the input's box.
    """
    axes, scores = range(len(q)), []
    for j, box in enumerate(boxes):
        margin = max(interpolated(following[-1], corner, axes, grid) for corner in corners_of(*box, grid))
        scores.append((max(interpolated(values[j], q, own, grid) for own, values in avoid), margin))
    return scores
