"""Where a mesh is tangled: bad cells, the vertices near them, and places that mend more cells.

A corner is closed when no move can make it convex, or when all that can be done for it is done by
other means; it counts in no cell.
"""

import numpy as np
from numba import prange

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel, parallel_kernel
from qsmooth.kernels.confining import confine, confined
from qsmooth.kernels.geometry import orientation
from qsmooth.kernels.rails import Rails

# Corners of a polygon that is clipped by the three lines of each cell of a star.
N_LINES = 3
# A region that is a smaller share of the star's bounding box is no place for a vertex.
LEAST_REGION = 1e-12


@parallel_kernel()
def bad_cells(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, closed: BoolArray,
    cells: IndexArray, out: BoolArray,
) -> None:  # fmt: skip
    """Mark the listed cells that have an open corner which is not convex, in exact arithmetic.

    Parameters
    ----------
    closed : (n_corners,)
        Corners that do not count.
    cells, out : (n_listed,)
        `out` is overwritten.
    """
    for i in prange(cells.size):
        c = cells[i]
        out[i] = _is_bad(xy, cell_offsets, cell_vertices, closed, c)


@helper()
def _is_bad(
    xy: FloatArray, offsets: IndexArray, vertices: IndexArray, closed: BoolArray, c: int
) -> bool:
    first, last = offsets[c], offsets[c + 1]
    d = vertices[last - 1]
    for k in range(first, last):
        a = vertices[k]
        b = vertices[k + 1] if k + 1 < last else vertices[first]
        if not closed[k]:
            turn = orientation(xy[d, 0], xy[d, 1], xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])
            if turn <= 0:
                return True
        d = a
    return False


@kernel()
def grow(
    marked: BoolArray, n_rings: int, ring_offsets: IndexArray, ring_vertices: IndexArray
) -> IndexArray:
    """Mark all vertices within so many edges of the marked ones, in place, and list them.

    Visits only what it marks.
    """
    listed = np.flatnonzero(marked)
    front = listed
    for _ in range(n_rings):
        n = 0
        for v in front:
            for k in range(ring_offsets[v], ring_offsets[v + 1]):
                n += 0 if marked[ring_vertices[k]] else 1
        after = np.empty(n, np.int64)
        n = 0
        for v in front:
            for k in range(ring_offsets[v], ring_offsets[v + 1]):
                w = ring_vertices[k]
                if not marked[w]:
                    marked[w] = True
                    after[n] = w
                    n += 1
        front = after[:n]
        listed = np.concatenate((listed, front))
    return listed


@kernel()
def label_islands(
    listed: IndexArray, star_offsets: IndexArray, star_cells: IndexArray,
    cell_offsets: IndexArray, cell_vertices: IndexArray, labels: IndexArray,
) -> int:  # fmt: skip
    """Number the islands of the listed vertices: of two that share a cell both are in one.

    Parameters
    ----------
    labels : (n_vertices,)
        -2 at the listed vertices on entry, anything else at all others; the numbers, from 0, at
        the listed ones on return.

    Returns
    -------
    n_islands
    """
    stack = np.empty(listed.size, np.int64)
    count = 0
    for seed in listed:
        if labels[seed] != -2:
            continue
        labels[seed] = count
        stack[0], top = seed, 1
        while top:
            top -= 1
            v = stack[top]
            for k in range(star_offsets[v], star_offsets[v + 1]):
                c = star_cells[k]
                for j in range(cell_offsets[c], cell_offsets[c + 1]):
                    w = cell_vertices[j]
                    if labels[w] == -2:
                        labels[w] = count
                        stack[top] = w
                        top += 1
        count += 1
    return count


@helper()
def _lines(
    xy: FloatArray, vertices: IndexArray, closed: BoolArray, first: int, last: int, k: int,
    out: IndexArray,
) -> int:  # fmt: skip
    """List directed lines, left of which the vertex at k must be for its cell to be good.

    Returns
    -------
    n_lines
        -1 where the opposite corner is not convex: the cell is bad wherever this vertex goes.
    """
    n = last - first
    after, before = first + (k - first + 1) % n, first + (k - first + n - 1) % n
    a, c = vertices[after], vertices[before]
    count = 0
    if not closed[k]:
        out[0], out[1] = a, c
        count = 1
    if n == 3:
        # The turn is the same at all three corners.
        if count == 0 and not (closed[after] and closed[before]):
            out[0], out[1] = a, c
            count = 1
        return count
    opposite = first + (k - first + 2) % n
    b = vertices[opposite]
    if not closed[opposite]:
        turn = orientation(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1])
        if turn <= 0:
            return -1
    if not closed[after]:
        out[2 * count], out[2 * count + 1] = a, b
        count += 1
    if not closed[before]:
        out[2 * count], out[2 * count + 1] = b, c
        count += 1
    return count


@helper()
def _clip(
    polygon: FloatArray, n: int, ax: float, ay: float, bx: float, by: float, out: FloatArray
) -> int:
    """Keep the part of a convex polygon left of the line from a to b; return its corners."""
    count = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        px, py, qx, qy = polygon[i, 0], polygon[i, 1], polygon[j, 0], polygon[j, 1]
        p = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
        q = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
        if p > 0.0:
            out[count, 0], out[count, 1] = px, py
            count += 1
        if (p > 0.0) != (q > 0.0):
            t = p / (p - q)
            out[count, 0], out[count, 1] = px + t * (qx - px), py + t * (qy - py)
            count += 1
    return count


@helper()
def _area(polygon: FloatArray, n: int) -> float:
    total = 0.0
    for i in range(1, n - 1):
        ux, uy = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1]
        wx, wy = polygon[i + 1, 0] - polygon[0, 0], polygon[i + 1, 1] - polygon[0, 1]
        total += 0.5 * (ux * wy - uy * wx)
    return total


@kernel()
def mend_more(
    xy: FloatArray, topology: tuple[IndexArray, IndexArray, IndexArray, IndexArray, IndexArray],
    closed: BoolArray, listed: IndexArray, rails: Rails, lengths: FloatArray,
) -> None:  # fmt: skip
    """Move each listed vertex, one after the other, to a place where more of its cells are good.

    Where a cell is good, as far as one vertex goes, is a convex region. The regions of a star are
    cut with each other going round from each of its cells, those left out that would leave
    nothing; the vertex goes to the middle of the region that is in most of them, if that costs no
    cell. In place, and on one thread.

    Parameters
    ----------
    topology
        star_offsets, star_cells, star_corners, cell_offsets, cell_vertices, as in `Topology`.
    closed : (n_corners,)
        Corners that do not count.
    listed, lengths : (n_listed,)
        Vertices; and how far each moved, overwritten.
    rails
        Where they may be.
    """
    star_offsets, star_cells, star_corners, offsets, vertices = topology
    largest = 0
    for v in listed:
        largest = max(largest, star_offsets[v + 1] - star_offsets[v])
    size = 8 + 2 * N_LINES * largest
    polygon, trial, spare = np.empty((size, 2)), np.empty((size, 2)), np.empty((size, 2))
    lines = np.empty(2 * N_LINES, np.int64)
    place = np.empty(2)
    for i in range(listed.size):
        v = listed[i]
        lengths[i] = 0.0
        first, last = star_offsets[v], star_offsets[v + 1]
        n = last - first
        x, y = xy[v, 0], xy[v, 1]
        low_x, low_y, high_x, high_y = x, y, x, y
        good = 0
        for k in range(first, last):
            c = star_cells[k]
            good += 0 if _is_bad(xy, offsets, vertices, closed, c) else 1
            for j in range(offsets[c], offsets[c + 1]):
                w = vertices[j]
                low_x, high_x = min(low_x, xy[w, 0]), max(high_x, xy[w, 0])
                low_y, high_y = min(low_y, xy[w, 1]), max(high_y, xy[w, 1])
        if good == n:
            continue
        least = LEAST_REGION * (high_x - low_x) * (high_y - low_y)
        most, widest = -1, 0.0
        for start in range(2 * n):
            corners = 4
            polygon[0, 0], polygon[0, 1] = low_x, low_y
            polygon[1, 0], polygon[1, 1] = high_x, low_y
            polygon[2, 0], polygon[2, 1] = high_x, high_y
            polygon[3, 0], polygon[3, 1] = low_x, high_y
            count = 0
            for step in range(n):
                row = first + ((start + step) % n if start < n else (start + n - step) % n)
                c = star_cells[row]
                n_lines = _lines(
                    xy, vertices, closed, offsets[c], offsets[c + 1], star_corners[row], lines
                )
                if n_lines < 0:
                    continue
                m = corners
                trial[:m] = polygon[:m]
                for line in range(n_lines):
                    a, b = lines[2 * line], lines[2 * line + 1]
                    m = _clip(trial, m, xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], spare)
                    trial[:m] = spare[:m]
                if m >= 3 and _area(trial, m) > least:
                    count += 1
                    corners = m
                    polygon[:m] = trial[:m]
            area = _area(polygon, corners)
            if count > most or (count == most and area > widest):
                most, widest = count, area
                place[0], place[1] = polygon[:corners, 0].mean(), polygon[:corners, 1].mean()
        if confined(rails):
            place[0], place[1] = confine(v, place[0], place[1], rails)
        xy[v, 0], xy[v, 1] = place[0], place[1]
        now = 0
        for k in range(first, last):
            now += 0 if _is_bad(xy, offsets, vertices, closed, star_cells[k]) else 1
        if now >= good:
            lengths[i] = np.sqrt((place[0] - x) ** 2 + (place[1] - y) ** 2)
        else:
            xy[v, 0], xy[v, 1] = x, y
