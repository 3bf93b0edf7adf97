"""One piece of an interval, for many boxes at once: the arithmetic of `sdhj.certified.images`, where its reasons stand.

Boxes, how far their ends have moved, and bounds on velocities in them are (2, M, ndim): lower ends, upper ends.
shift_invariant (ndim,) bool: axes on which a box is all there is. shell (ndim,): room for rounding, of which it takes
less than a millionth: it is off by some units in the last place, 2e-16 of a coordinate, and the shell is 1e-10 of the
largest one. Numbers that are undefined are passed on, never dropped.
"""

import math

import numpy as np

from sdhj.kernels.compiling import kernel


@kernel(nogil=True)
def guess_enclosure(start, moved, before, shift_invariant, shell, ends, enclosure):
    """ends = start + moved, and `enclosure` a guess of what boxes sweep in the next piece, both in place."""
    for side in range(2):
        way = 2.0 * side - 1.0
        for m in range(start.shape[1]):
            for k in range(shift_invariant.size):
                end = start[side, m, k]
                last = before[side, m, k]
                if not shift_invariant[k]:
                    end += moved[side, m, k]
                ends[side, m, k] = enclosure[side, m, k] = end
                if not shift_invariant[k]:
                    # About what the last piece added, a fifth more, and the shell, as `sweep` asks for strictly less.
                    enclosure[side, m, k] = (
                        end + (last if way * last > 0.0 else 0.0) + way * (0.2 * abs(last) + shell[k])
                    )


@kernel(nogil=True)
def sweep(ends, velocity, h, shift_invariant, shell, enclosure, out):
    """out = the hull of `ends` and ends + h velocity, a quarter of the shell wider; returns whether in `enclosure`.

    All (2, M, ndim). If it stays strictly inside, the velocities, which hold in the enclosure, were right; False for
    NaN. Shift-invariant axes are not checked: no velocity depends on them.
    """
    inside = True
    for side in range(2):
        way = 2.0 * side - 1.0
        for m in range(ends.shape[1]):
            for k in range(shift_invariant.size):
                end = out[side, m, k] = ends[side, m, k]
                if not shift_invariant[k]:
                    moved = end + h * velocity[side, m, k]
                    end = (end if way * moved <= way * end else moved) + way * shell[k] / 4
                    out[side, m, k] = end
                    # Strictly, which NaN never is.
                    inside &= way * end < way * enclosure[side, m, k]
    return inside


@kernel(nogil=True)
def narrow_to_face(ends, velocity, h, side, axis, shell, box):
    """Narrow `box`, in place, along an axis to where the state that is first (side 0), or last (1), can be within h.

    ends[side] + h [min(velocity, 0), max(velocity, 0)], and an eighth of `shell`, a number, more. The velocity in this
    face alone moves the end on (Mueller's theorem, `Images._piece`): a wider box is safe and a narrower one is not.
    """
    for m in range(ends.shape[1]):
        end = ends[side, m, axis]
        least, most = velocity[0, m, axis], velocity[1, m, axis]
        box[0, m, axis] = end + h * (least if least < 0.0 else 0.0) - shell / 8
        box[1, m, axis] = end + h * (most if most > 0.0 else 0.0) + shell / 8


@kernel(nogil=True)
def move_on(moved, velocity, h):
    """moved += h velocity, rounded outward, in place; both (2, M, ndim). Where the velocity is 0, nothing is added."""
    for side in range(2):
        way = 2.0 * side - 1.0
        for m in range(moved.shape[1]):
            for k in range(moved.shape[2]):
                step = h * velocity[side, m, k]
                step += way * 1e-15 * abs(step)  # h is off the length of the piece by less
                if step != 0.0:
                    moved[side, m, k] = np.nextafter(moved[side, m, k] + step, way * np.inf)


@kernel(nogil=True)
def clip_to_walls(start, moved, shift_invariant, walls):
    """Clip `moved`, in place, so that start + moved ends at walls (2, ndim), outward; not on shift-invariant axes."""
    for side in range(2):
        for m in range(start.shape[1]):
            for k in range(shift_invariant.size):
                begin, place = start[side, m, k], start[side, m, k] + moved[side, m, k]
                if not shift_invariant[k] and (place < walls[0, k] or place > walls[1, k]):
                    at_wall = walls[0, k] if place < walls[0, k] else walls[1, k]
                    # Rounded outward, as start + moved is computed once more.
                    moved[side, m, k] = np.nextafter(at_wall - begin, np.inf if side else -np.inf)


# ---- boxes where functions are bounded


@kernel(nogil=True)
def boxes_of_product(at, ends, sizes, out):
    """Write to out (2, M, d) the boxes with flat numbers at (M,) of a product of intervals.

    ends (2, d, most) : the lower and the upper ends of the intervals along each axis, sizes (d,) of them.
    """
    for m in range(at.size):
        number = at[m]
        # The last axis fastest, as in NumPy's flat numbers, by which callers ask.
        for back in range(sizes.size):
            k = sizes.size - 1 - back
            whole = number // sizes[k]
            i, number = number - whole * sizes[k], whole
            out[0, m, k], out[1, m, k] = ends[0, k, i], ends[1, k, i]


@kernel(nogil=True)
def cut_boxes(low, high, ends, periodic, out, rows):
    """Cut boxes low, high (M, d) at ends (2, d) of bounded axes and where periodic ones close; returns how many.

    out (2, M * 2^p, d), rows (M * 2^p,) : overwritten with the pieces and with the box of each, for p periodic axes.
    """
    count = 0
    for m in range(low.shape[0]):
        first = count
        rows[count] = m
        count += 1
        for k in range(periodic.size):
            lower, upper = ends[0, k], ends[1, k]
            begin, end = low[m, k], high[m, k]
            pieces = count - first
            if not periodic[k]:
                begin, end = min(max(begin, lower), upper), min(max(end, lower), upper)
            elif end - begin >= upper - lower:
                begin, end = lower, upper
            elif begin < lower or end > upper:
                laps = math.floor((begin - lower) / (upper - lower)) * (upper - lower)
                begin, end = max(begin - laps, lower), end - laps
            for i in range(first, first + pieces):
                out[0, i, k], out[1, i, k] = begin, min(end, upper)
                if end > upper:
                    # The piece past the seam is the box itself along the axes before.
                    for before in range(k):
                        out[0, count, before], out[1, count, before] = out[0, i, before], out[1, i, before]
                    out[0, count, k], out[1, count, k] = lower, end - (upper - lower)
                    rows[count] = m
                    count += 1
    return count
