"""The lines of oblique images: of each row of cells the first and the last along the last axis."""

import math

from sdhj.kernels.compiling import kernel

# of the terms that are added up: what rounding may do to them is less than a tenth of it
ROUNDING = 1e-14


@kernel(nogil=True)
def draw_lines(low, high, least, most, normals, width, stick, out):
    """Write the lines of images, which lie inside boxes of cells and between planes, to out (M, rows, 2) int16.

    The first and the last cell along the last axis, as offsets from a cell's own index; a line without cells ends
    before it begins. Rows are of the axes that a normal has a part along, but the last; those beyond a box are left as
    they are.

    low, high (M, ndim) int64 : the boxes, as offsets.
    least, most (M, K) : how far anything in a cell may get along each of the normals (K, ndim).
    width (ndim,) : of the cells. stick (ndim,) : what an image may stick out of its box.
    """
    last, many = width.size - 1, normals.shape[0]
    for m in range(low.shape[0]):
        rows = 1
        for axis in range(last):
            if along_one(normals, axis):
                rows *= high[m, axis] - low[m, axis] + 1
        for row in range(rows):
            begin = low[m, last] * width[last] - stick[last]
            end, empty = (high[m, last] + 1) * width[last] + stick[last], False
            for side in range(2 * many):
                k, way, rest = side >> 1, 2.0 * (side & 1) - 1.0, row
                slack = most[m, k] if way > 0.0 else -least[m, k]
                size = abs(slack)
                for axis in range(last, -1, -1):
                    slope = way * normals[k, axis]
                    slack += max(slope * width[axis], 0.0)  # the farthest of the cell itself  # obligation 2.34
                    if axis < last and along_one(normals, axis):
                        count = high[m, axis] - low[m, axis] + 1
                        at, rest = low[m, axis] + rest % count, rest // count
                        near = at * width[axis] - (stick[axis] if at == low[m, axis] else 0.0)
                        far = (at + 1) * width[axis] + (stick[axis] if at == high[m, axis] else 0.0)
                        slack -= min(slope * near, slope * far)  # obligation 2.37
                        size += abs(slope) * max(abs(near), abs(far))
                slack += ROUNDING * size
                slope = way * normals[k, last]
                if slope > 0.0:
                    end = min(end, slack / slope)  # obligation 2.38
                elif slope < 0.0:
                    begin = max(begin, slack / slope)  # obligation 2.39
                else:
                    empty |= slack < 0.0  # obligation 2.49
            out[m, row, 0], out[m, row, 1] = 0, -1
            if begin <= end and not empty:  # obligation 2.50
                first = math.floor((begin + stick[last] / 2) / width[last])
                past = math.ceil((end - stick[last] / 2) / width[last]) - 1
                out[m, row, 0] = min(max(first, low[m, last]), high[m, last])
                out[m, row, 1] = max(min(past, high[m, last]), out[m, row, 0])


@kernel(inline="always")
def along_one(normals, axis):
    """Whether one of the normals (K, ndim) has a part along an axis."""
    for k in range(normals.shape[0]):
        if normals[k, axis] != 0.0:
            return True
    return False
