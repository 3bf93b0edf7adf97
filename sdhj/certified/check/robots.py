"""The claims of a file for a robot of one's own, whose functions are given: derived anew with `spans`.

1.  *Moves.* From anywhere in the cells at a place each input leads into the cells that the file says: `driven` follows
    the ends of the box in ever shorter pieces until what they reach lies inside.
2.  *Clear.* Where the file says that an input is clear from a cell, every unsafe set's function is above zero in boxes
    that the cell sweeps; boxes for which this is open are halved along each axis, `DEEPEST` times.
3.  *Goals* are inside the target and outside the unsafe sets at t_k.
4.  *Steps.* For every new cell of S_k^n an input is clear and its cells, counted, are all in S_{k+1}^{n-1}.

A place is the part of a cell that its moves depend on; on the other axes the velocity is bounded wherever the state may
be. Functions that cannot be called with spans are bounded by what the file states of them (`Verdict` names those).
"""

import json
import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise, product
from typing import Any

import h5py
import numpy as np
from tqdm import tqdm

from sdhj.certified.check.bits import Array
from sdhj.certified.check.reading import decimal, expect
from sdhj.certified.check.spans import Span, ends_of

NEAR = 1e-10  # a state so near to a cell counts as in it
STICKS_OUT = 2e-13  # of a cell, what an image may; and what rounding here adds
FINER = (8, 32, 128)  # pieces of a part, until what is said is proved
DEEPEST = 4
AT_ONCE = 1 << 16  # boxes
BAD = (TypeError, ValueError, AttributeError, LookupError, AssertionError)


class Robot:
    """A problem's functions over boxes, and the cells of a file; ValueError where the two do not fit together."""

    def __init__(self, file: h5py.File, problem: Any) -> None:
        group, grid, self.problem = file["certified"], problem.grid, problem
        self.steps = int(file.attrs["steps"])
        self.counts = np.array(group.attrs["shape"])
        told = zip(*(group.attrs[name] for name in ("lowers", "widths")), group.attrs["extents"], strict=True)
        self.axes = [(Fraction(low), Fraction(width), *map(Fraction, extent)) for low, width, extent in told]
        self.parts, matrix, time, self.stated = json.loads(group.attrs["bounds"])
        self.matrix, self.time = (None if given is None else np.array(given) for given in (matrix, time))
        names = ("index", "pool", "low", "high", "clear", "strides")
        self.index, self.pool, self.low, self.high, self.clear, self.strides = (group[name][()] for name in names)
        self.rests_on: set[str] = set()
        self.known, ndim = self.strides > 0, len(self.counts)
        self.periodic, starts = np.array(grid.periodic), len(self.low)
        canonical = np.where(self.known, np.cumprod([1, *np.where(self.known, self.counts, 1)[:0:-1]])[::-1], 0)
        size, rows = int(np.prod(self.counts)), int(np.prod(self.counts[:-1]))
        pairs, count = (self.steps + 1) * (self.steps + 2) // 2, len(problem.dynamics.inputs)
        timed = "t" in sum(problem.dynamics.takes.values(), ())
        moving = any(part.rate > 0 for part in problem.unsafe)
        expect(len(self.axes) == ndim == grid.ndim and problem.steps in (None, self.steps), "axes and steps of the problem", ndim)
        expect(np.array_equal(self.strides, canonical), "strides must count the places", self.strides)
        shape = count, int(np.prod(self.counts[self.known])), ndim
        fits = self.low.shape == self.high.shape == (starts, *shape) and starts == (self.steps if timed else 1)
        fits &= self.clear.shape == (self.steps if timed or moving else 1, size, -(-count // 8))
        fits &= self.pool.shape[1:] == (-(-self.counts[-1] // 64),) and self.index.shape[1:] == (rows,)
        fits &= self.index.max() < len(self.pool) and (self.low <= self.high).all()
        self.timeless = len(self.index) != pairs
        fits &= not self.timeless or (not timed and not moving and len(self.index) in (1, self.steps + 1))
        expect(bool(fits), "the arrays must fit the problem", self.index.shape)
        self.edges = [np.array([float(low + i * w) for i in range(n)] + [float(low + (a + b) / 2)]) for n, (low, w, a, b) in zip(self.counts, self.axes, strict=True)]

    def cover(self) -> list[str]:
        """What is wrong with the cells of the axes."""
        wrong, grid = [], self.problem.grid
        for axis, (n, (low, width, least, most)) in enumerate(zip(self.counts.tolist(), self.axes, strict=True)):
            length = decimal(grid.upper[axis]) - decimal(grid.lower[axis])
            fits = low == decimal(grid.lower[axis]) and least <= length <= most and (n - 1) * width < least
            fits &= n * width >= most and most - least <= (length / 2**40 if self.periodic[axis] else 0)
            if not self.known[axis]:  # cells that move alike are alike, and nothing holds them back on the way
                fits &= not self.periodic[axis] or abs(n * width - most) <= STICKS_OUT
                fits &= self.periodic[axis] or "wall" not in grid.ends[axis] or not self.problem.dynamics.takes
            wrong += [] if fits else [f"axis {axis}: {n} cells of width {float(width):.6g} do not cover it"]
        return wrong

    # ---- functions over boxes: Array low, high (M, axes), and times

    def value(self, part: Any, low: Array, high: Array, times: tuple[float, float]) -> tuple[Array, Array]:
        """Bounds of a level set."""
        rate, stated, middle = getattr(part, "rate", None), self.stated.get(part.name), sum(times) / 2
        drift = 0.0 if not rate else rate * (times[1] - times[0]) / 2
        fixed = times[0] if rate == 0 else middle

        def at_centre(a: Array, b: Array) -> Span:
            half = (b - a) / 2 * (1 + 1e-9)
            slope = part.slope * np.sqrt((half**2).sum(axis=1)) if stated is None else half @ np.array(stated)
            value = np.asarray(part.level_set((a + b) / 2, fixed), dtype=np.float64)
            self.rests_on.add(part.name)
            return Span(value - slope - 1e-9 * (1 + abs(value)) - drift, value + slope + 1e-9 * (1 + abs(value)) + drift)

        def own(a: Array, b: Array) -> Span:
            self.rests_on.add(part.name)
            return Span(*part.level_set.enclosure(a, b, *times))

        def still(a: Array, b: Array) -> Span:
            return part.level_set(Span(a, b), fixed) + Span(-drift, drift)

        ways = [own] if hasattr(part.level_set, "enclosure") else []
        ways += [lambda a, b: part.level_set(Span(a, b), times[0] if times[0] == times[1] else Span(*times))]
        ways += ([still] if rate is not None else []) + [at_centre]
        answer = self.cut(part.axes, low, high, lambda a, b: first_of(ways, a, b, (len(a),)))
        return answer.low, answer.high

    def velocity(self, j: int, low: Array, high: Array, times: tuple[float, float]) -> Span:
        """Bounds of the velocity under u_j and any adversary."""
        dynamics, u = self.problem.dynamics, self.problem.dynamics.inputs[j]

        def term(name: str, points: Any, t: Any) -> Any:
            function = getattr(dynamics, name)
            if not callable(function):
                return np.asarray(function)[j] if name == "drift" else np.asarray(function)
            if isinstance(points, Span) and hasattr(function, "enclosure"):
                self.rests_on.add(name)
                return Span(*function.enclosure(points.low, points.high, u, *times))
            given = {"points": points, "u": u, "t": t}
            return function(*(given[one] for one in dynamics.takes[name]))

        def called(a: Array, b: Array) -> Span:
            points, t = Span(a, b), times[0] if times[0] == times[1] else Span(*times)
            gain, most = term("gain", points, t), term("bounds", points, t)
            push = np.sum(np.abs(Span(*two(gain))) * np.abs(Span(*two(most))), axis=-1).high
            return term("drift", points, t) + Span(-push, push)

        def at_centre(a: Array, b: Array) -> Span:
            points, t = (a + b) / 2, sum(times) / 2
            drift = np.broadcast_to(term("drift", points, t), a.shape)
            push = np.abs(term("gain", points, t)) @ term("bounds", points, t)
            push = push + (b - a) / 2 @ (np.zeros((a.shape[1],) * 2) if self.matrix is None else self.matrix).T
            push = push + (0.0 if self.time is None else self.time * (times[1] - times[0]) / 2)
            push = push * (1 + 1e-9) + 1e-9 * (1 + np.abs(drift))
            self.rests_on.add("dynamics")
            return Span(drift - push, drift + push)

        ways = [called] + ([at_centre] if self.matrix is not None or self.time is not None else [])
        return self.cut(range(len(self.counts)), low, high, lambda a, b: first_of(ways, a, b, a.shape))

    def cut(self, axes: Any, low: Array, high: Array, of: Callable[[Array, Array], Span]) -> Span:
        """Bounds over boxes, asked for within the ends of the axes: in two halves where a periodic one closes."""
        low, high, grid = low.copy(), high.copy(), self.problem.grid
        for column, axis in enumerate(axes):
            least, most = grid.lower[axis], grid.upper[axis]
            if not self.periodic[axis]:
                low[:, column], high[:, column] = (np.clip(end[:, column], least, most) for end in (low, high))
                continue
            full = high[:, column] - low[:, column] >= most - least
            turns = np.floor((low[:, column] - least) / (most - least)) * (most - least)
            low[:, column] = np.where(full, least, np.maximum(low[:, column] - turns, least))
            high[:, column] = np.where(full, most, high[:, column] - turns)
            if (over := high[:, column] > most).any():
                second = low[over], high[over]
                second[0][:, column], second[1][:, column] = least, second[1][:, column] - (most - least)
                high[over, column] = most
                one, two_ = self.cut(axes, low, high, of), self.cut(axes, *second, of)
                one.low[over] = np.minimum(one.low[over], two_.low)
                one.high[over] = np.maximum(one.high[over], two_.high)
                return one
        pieces = [of(low[at : at + AT_ONCE], high[at : at + AT_ONCE]) for at in range(0, max(len(low), 1), AT_ONCE)]
        return Span(*(np.concatenate([ends_of(piece, side) for piece in pieces]) for side in (0, 1)))

    # ---- moves

    def driven(self, places: Array, j: int, start: float, finer: int) -> tuple[Array, Array]:
        """How far the ends of boxes at places move: in each part (M, parts, 2, ndim), at last (M, 2, ndim)."""
        grid, delta = self.problem.grid, float(self.problem.delta)
        cells = self.cells_at(places)
        at = [np.where(self.known, np.stack([self.edges[a][cells[:, a] + s] for a in range(len(self.counts))], 1) + (2 * s - 1) * NEAR, (grid.lower, grid.upper)[s]) for s in (0, 1)]
        moved, swept = np.zeros((2, *cells.shape)), np.empty((len(cells), self.parts, 2, cells.shape[1]))
        wall = np.array([["wall" == end for end in ends] for ends in grid.ends]).T & ~self.periodic & self.known
        bars = np.where(wall[0], grid.lower, -np.inf), np.where(wall[1], grid.upper, np.inf)
        cuts = start + delta * np.arange(self.parts * finer + 1) / (self.parts * finer)
        for part in range(self.parts):
            least, most = moved[0].copy(), moved[1].copy()
            for times in pairwise(cuts[part * finer : (part + 1) * finer + 1].tolist()):
                moved = self.piece(at, moved, j, times)
                for side, bar in product((0, 1), (0, 1)):
                    place = at[side] + moved[side]
                    beyond = place < bars[0] if bar == 0 else place > bars[1]
                    moved[side] = np.where(beyond, bars[bar] - at[side] + (2 * side - 1) * 1e-15, moved[side])
                least, most = np.minimum(least, moved[0]), np.maximum(most, moved[1])
            swept[:, part, 0], swept[:, part, 1] = least, most
        return swept, np.moveaxis(moved, 0, 1)

    def piece(self, at: list[Array], moved: Array, j: int, times: tuple[float, float]) -> Array:
        """`moved` after a piece: an end moves as fast as the velocity can be in the box's face on its side."""
        h = (times[1] - times[0]) * (1 + 1e-15)
        low, high = (np.where(self.known, at[side] + moved[side], at[side]) for side in (0, 1))
        grown = 0.0
        for _ in range(30):
            a, b = low - self.known * (grown + 1e-11), high + self.known * (grown + 1e-11)
            speed = self.velocity(j, a, b, times)
            ahead = low + h * np.minimum(speed.low, 0), high + h * np.maximum(speed.high, 0)
            if (~self.known | ((ahead[0] > a) & (ahead[1] < b))).all():
                break
            grown = 1.3 * np.maximum(np.maximum(low - ahead[0], ahead[1] - high), grown)
        else:
            raise ValueError("no box was found that the state stays in")
        slow, fast = speed.low.copy(), speed.high.copy()
        for axis in np.flatnonzero(self.known):
            for side, own in enumerate((low, high)):
                face = [a.copy(), b.copy()]
                face[0][:, axis] = own[:, axis] + h * np.minimum(speed.low[:, axis], 0) - 1e-11
                face[1][:, axis] = own[:, axis] + h * np.maximum(speed.high[:, axis], 0) + 1e-11
                there = self.velocity(j, *face, times)
                (slow, fast)[side][:, axis] = (there.low, there.high)[side][:, axis]
        steps = [h * v + (2 * side - 1) * 2e-15 * np.abs(h * v) for side, v in enumerate((slow, fast))]
        out = [by + step + (2 * side - 1) * 3e-16 * np.abs(by + step) for side, (by, step) in enumerate(zip(moved, steps, strict=True))]
        return np.stack(out)

    def cells_at(self, places: Array) -> Array:
        """A cell (M, ndim) at each place, 0 on the other axes."""
        return np.stack([(places // max(s, 1)) % n if s else 0 * places for s, n in zip(self.strides, self.counts, strict=True)], axis=1)

    def moves_hold(self, places: Array, start: int, j: int, last: Array) -> Array:
        """Whether what is reached from places lies in the cells that the file says: (M,) bool."""
        fits, cells = np.ones(len(places), np.bool_), self.cells_at(places)
        low, high = (array[start, j, places].astype(np.int64) for array in (self.low, self.high))
        for axis, (_, width, least, most) in enumerate(self.axes):
            n, w, edges = self.counts[axis], float(width), self.edges[axis]
            if self.periodic[axis] and self.known[axis]:
                length, own = float((least + most) / 2), cells[:, axis]
                first, end = (edges[k % n] + k // n * length for k in (own + low[:, axis], own + high[:, axis] + 1))
                first, end = first - edges[own], end - edges[own + 1]
            else:
                first, end = low[:, axis] * w, high[:, axis] * w
            fits &= (first <= last[:, 0, axis] + STICKS_OUT) & (last[:, 1, axis] <= end + STICKS_OUT)
        return fits

    # ---- tubes and sets

    def outside(self, part: Any, low: Array, high: Array, times: tuple[float, float], depth: int = DEEPEST) -> Array:
        """Whether boxes (M, axes) are proved to be outside an unsafe set, (M,)."""
        out = self.value(part, low, high, times)[0] > 0
        open_ = np.flatnonzero(~out)
        if depth and open_.size:
            shares = np.ones(open_.size, np.bool_)
            middle = (low[open_] + high[open_]) / 2
            for upper in product((False, True), repeat=low.shape[1]):
                left = np.flatnonzero(shares)
                a, b = np.where(upper, middle[left], low[open_][left]), np.where(upper, high[open_][left], middle[left])
                shares[left] = self.outside(part, a, b, times, depth - 1)
            out[open_] = shares
        return out

    def clear_holds(self, numbers: Array, step: int, swept: Array) -> Array:
        """Whether tubes from cells (M,), swept (M, parts, 2, ndim), are clear in the interval from a step: (M,)."""
        grid, cells = self.problem.grid, np.stack(np.unravel_index(numbers, self.counts), axis=1)
        start, delta = step * float(self.problem.delta), float(self.problem.delta)
        ends = [np.stack([self.edges[a][cells[:, a] + side] for a in range(len(self.counts))], axis=1) for side in (0, 1)]
        out = np.ones(len(cells), np.bool_)
        for axis in np.flatnonzero(~self.periodic):
            room = 1e-6 * grid.spacing[axis]
            for side, kind in enumerate(grid.ends[axis]):
                if kind == "unsafe":
                    furthest = [swept[:, :, 0, axis].min(axis=1), swept[:, :, 1, axis].max(axis=1)][side] + ends[side][:, axis]
                    out &= furthest >= grid.lower[axis] - room if side == 0 else furthest <= grid.upper[axis] + room
        for part in self.problem.unsafe:
            own = list(part.axes)
            boxes = [ends[side][:, None, own] + swept[:, :, side][:, :, own] + (2 * side - 1) * 2 * NEAR for side in (0, 1)]
            todo = np.flatnonzero(out)
            if part.rate == 0:
                whole = self.outside(part, boxes[0][todo].min(axis=1), boxes[1][todo].max(axis=1), self.always(), 0)
                todo = todo[~whole]
            for piece in range(self.parts):
                cuts = [start + delta * (piece + k) / self.parts for k in (0, 1)]
                times = self.always() if part.rate == 0 else (cuts[0], cuts[1])
                good = self.outside(part, boxes[0][todo, piece], boxes[1][todo, piece], times)
                out[todo[~good]] = False
                todo = todo[good]
        return out

    def always(self) -> tuple[float, float]:
        return 0.0, self.steps * float(self.problem.delta)

    def goals_hold(self, numbers: Array, step: int) -> Array:
        """Whether cells are inside the target and outside the unsafe sets at t_k, (M,)."""
        t = step * float(self.problem.delta)
        times, cells = self.always() if self.timeless else (t, t), np.stack(np.unravel_index(numbers, self.counts), axis=1)
        ends = [np.stack([self.edges[a][cells[:, a] + s] for a in range(len(self.counts))], axis=1) + (2 * s - 1) * NEAR for s in (0, 1)]
        out = np.ones(len(cells), np.bool_)
        for part in self.problem.unsafe:
            out &= self.outside(part, *(end[:, list(part.axes)] for end in ends), times)
        if not self.problem.stays:
            own = list(self.problem.target.axes)
            out &= self.value(self.problem.target, ends[0][:, own], ends[1][:, own], times)[1] <= 0
        return out

    def bits(self, row: int) -> Array:
        """A set of the file, (cells,) bool."""
        blocks = self.pool[self.index[row]].view(np.uint8)
        return np.unpackbits(blocks, axis=1, count=int(self.counts[-1]), bitorder="little").ravel().view(np.bool_)

    def steps_hold(self, numbers: Array, step: int, following: Array) -> Array:
        """Whether from cells some input that is clear leads into a set only, all its cells counted: (M,) bool."""
        cells = np.stack(np.unravel_index(numbers, self.counts), axis=1)
        inside = following.reshape(self.counts)
        for axis in np.flatnonzero(self.periodic):
            inside = np.concatenate([inside] * 3, axis=axis)
        sums = np.pad(inside, [(1, 0)] * inside.ndim).astype(np.int32)
        for axis in range(sums.ndim):
            np.cumsum(sums, axis=axis, out=sums)
        start, out = min(step, len(self.low) - 1), np.zeros(len(numbers), np.bool_)
        clear = self.clear[min(step, len(self.clear) - 1)]
        for j in range(self.low.shape[1]):
            left = np.flatnonzero(~out)
            left = left[(clear[numbers[left], j // 8] >> np.uint8(j % 8)) & 1 == 1]
            places = cells[left] @ self.strides
            first, last = (cells[left] + array[start, j, places] for array in (self.low, self.high))
            end = np.where(self.periodic, 3 * self.counts, self.counts) - 1
            fits = ((last - first < self.counts) | ~self.periodic).all(axis=1)
            turn = np.where(self.periodic, first // self.counts, 0) * self.counts
            first, last = np.clip(first - turn, 0, end), np.clip(last - turn, 0, end)
            total, volume = np.zeros(len(left), np.int64), np.prod(last - first + 1, axis=1)
            for corner in product((0, 1), repeat=cells.shape[1]):
                at = tuple(np.where(side, last[:, a] + 1, first[:, a]) for a, side in enumerate(corner))
                total += sums[at] * (-1) ** (corner.count(0))
            out[left] = fits & (total == volume)
        return out


def two(value: Any) -> tuple[Any, Any]:
    return ends_of(value, 0), ends_of(value, 1)


def first_of(ways: list[Any], low: Array, high: Array, shape: tuple[int, ...]) -> Span:
    """The answer of the first way that goes through."""
    failed: list[Exception] = []
    for way in ways:
        try:
            answer = way(low, high)
            return Span(*(np.broadcast_to(end, shape) for end in two(answer)))
        except BAD as error:
            failed.append(error)
    raise ValueError(f"a function of the problem cannot be called with spans: {failed[0]}")


def examine(file: h5py.File, problem: Any, samples: int | None, seed: int, silent: bool) -> Iterator[tuple[str, int, int, list[str]]]:
    """Of each kind of claim its name, how many were made and checked, and what failed."""
    robot = Robot(file, problem)
    wrong = robot.cover()
    yield "cells cover the axes", len(robot.axes), len(robot.axes), wrong
    if wrong:
        return
    size, rng = int(np.prod(robot.counts)), np.random.default_rng(seed)
    chosen = np.ones(size, np.bool_)
    if samples is not None:
        chosen[:] = False
        chosen[rng.permutation(size)[:samples]] = True
    yield from examine_moves(robot, chosen, silent)
    yield from examine_sets(robot, chosen, silent)
    if robot.rests_on:
        yield f"rests on what is stated of {', '.join(sorted(robot.rests_on))}", 0, 0, []


def examine_moves(robot: Robot, chosen: Array, silent: bool) -> Iterator[tuple[str, int, int, list[str]]]:
    """Every move; and every input that is clear, from the cells chosen."""
    places = np.arange(robot.low.shape[2])
    numbers = np.flatnonzero(chosen)
    at = np.stack(np.unravel_index(numbers, robot.counts), axis=1) @ robot.strides
    wrong: tuple[list[str], list[str]] = ([], [])
    made = checked = 0
    for start, j in tqdm([*product(range(len(robot.low)), range(robot.low.shape[1]))], desc="moves", disable=silent):
        steps = range(len(robot.clear)) if len(robot.low) == 1 else [start]
        flags = {step: (robot.clear[step, :, j // 8] >> np.uint8(j % 8)) & 1 for step in steps}
        told = {step: np.flatnonzero(flags[step][numbers]) for step in steps}
        made, checked = made + sum(int(f.sum()) for f in flags.values()), checked + sum(t.size for t in told.values())
        moving = places
        for finer in FINER:
            asked = np.union1d(moving, np.concatenate([at[some] for some in told.values()])).astype(np.int64)
            if not asked.size:
                break
            swept, last = robot.driven(asked, j, start * float(robot.problem.delta), finer)
            moving = np.intersect1d(moving, asked[~robot.moves_hold(asked, start, j, last)])
            for step, some in told.items():
                rows = np.searchsorted(asked, at[some])
                slabs = [slice(begin, begin + AT_ONCE) for begin in range(0, some.size, AT_ONCE)]
                good = [robot.clear_holds(numbers[some[own]], step, swept[rows[own]]) for own in slabs]
                told[step] = some[~np.concatenate(good)] if good else some
        wrong[0].extend(f"start {start}, input {j}, place {place}" for place in moving)
        wrong[1].extend(f"start {step}, input {j}, cell {n}" for step, some in told.items() for n in numbers[some])
    count = math.prod(robot.low.shape[:3])
    yield "moves", count, count, wrong[0]
    yield "clear of the unsafe sets", made, checked, wrong[1]


def examine_sets(robot: Robot, chosen: Array, silent: bool) -> Iterator[tuple[str, int, int, list[str]]]:
    """Goals, whether sets grow (without a target: shrink), and every step."""
    stays, kinds = robot.problem.stays, {"in the target, and safe": [0, 0], "one step nearer": [0, 0]}
    failed: dict[str, list[str]] = {"sets grow with the steps to go": [], **{name: [] for name in kinds}}
    rows = [(0, n) for n in range(robot.steps + 1)]
    if not robot.timeless:
        rows = [(k, n) for k in range(robot.steps + 1) for n in range(robot.steps - k + 1)]
    if len(robot.index) == 1:  # what is safe for ever: it leads into itself
        rows = [(0, 0), (0, 1)]

    def row_of(step: int, within: int) -> int:
        if robot.timeless:
            return min(within, len(robot.index) - 1)
        return step * (robot.steps + 1) - step * (step - 1) // 2 + within

    for step, within in tqdm(rows, desc="sets", disable=silent):
        here = robot.bits(row_of(step, within))
        name = "one step nearer" if within else "in the target, and safe"
        new = here
        if within:
            less = robot.bits(row_of(step, within - 1))
            if ((here & ~less) if stays else (less & ~here)).any():
                failed["sets grow with the steps to go"].append(f"start {step}, within {within}")
            new = here if stays else here & ~less
        numbers = np.flatnonzero(new & chosen)
        kinds[name][0] += int(new.sum())
        kinds[name][1] += numbers.size
        if not within:
            good = robot.goals_hold(numbers, step)
        else:
            good = robot.steps_hold(numbers, step, robot.bits(row_of(step + 1, within - 1)))
        failed[name].extend(f"start {step}, within {within}, cell {number}" for number in numbers[~good])
    yield "sets grow with the steps to go", len(rows), len(rows), failed["sets grow with the steps to go"]
    for name, (made, checked) in kinds.items():
        yield name, made, checked, failed[name]
