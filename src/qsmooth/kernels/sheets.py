"""Sheets of quads, and what varies along them.

A sheet is the strip of quads that one crosses by always leaving through the side opposite the one
entered (also: chord, dual curve). Each quad lies on two. A *link* is a quad as a part of one of
them: link 2 q of quad q is crossed through its sides 1 and 3, link 2 q + 1 through its sides 0 and
2. Listed sheet by sheet, in the order in which one comes to them, the links make signals of one
dimension, in which noise can be told from trend.

A sheet may meet itself, and have one quad twice, but a link once.
"""

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel

# Rounds in which triangles that are left pair with others that are.
ROUNDS = 4


@helper()
def corner_off(ux: float, uy: float, wx: float, wy: float) -> float:
    """Size of the cosine between edges; infinite where the corner is not convex."""
    if not ux * wy - uy * wx > 0.0:
        return math.inf
    size = math.sqrt((ux * ux + uy * uy) * (wx * wx + wy * wy))
    return abs(ux * wx + uy * wy) / size if size > 0.0 else math.inf


@helper()
def sides_off(ux: float, uy: float, wx: float, wy: float) -> float:
    """Size of the log ratio of lengths."""
    u, w = ux * ux + uy * uy, wx * wx + wy * wy
    return abs(0.5 * math.log(u / w)) if u > 0.0 and w > 0.0 else math.inf


@kernel()
def pair_triangles(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray
) -> IndexArray:
    """Pair the triangles that make quads next to rectangles, as those of a quad cut in two do.

    Two pair where each is the best partner of the other; those that are left then look among what
    is left. In a thin layer along a wall that bends, a triangle's longest side need not be the one
    that a quad was cut along.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices
        As in every kernel; quads are left alone.
    twins : (n_corners,)
        The other cell's side of each edge, or -1.

    Returns
    -------
    (n_cells,)
        Side that a triangle has in common with its partner, a position in `cell_vertices`, or -1.
    """
    n_cells = cell_offsets.size - 1
    cells = np.empty(cell_vertices.size, np.int64)
    for c in range(n_cells):
        cells[cell_offsets[c] : cell_offsets[c + 1]] = c
    scores = np.full(cell_vertices.size, np.inf)
    for c in range(n_cells):
        first = cell_offsets[c]
        for k in range(first, cell_offsets[c + 1]):
            twin = twins[k]
            if twin > k and cell_offsets[c + 1] - first == 3:
                start = cell_offsets[cells[twin]]
                if cell_offsets[cells[twin] + 1] - start == 3:
                    a, b = cell_vertices[k], cell_vertices[first + (k - first + 1) % 3]
                    e = cell_vertices[first + (k - first + 2) % 3]
                    d = cell_vertices[start + (twin - start + 2) % 3]
                    # Sides of the quad a, d, b, e, one after the other.
                    px, py = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
                    qx, qy = xy[b, 0] - xy[d, 0], xy[b, 1] - xy[d, 1]
                    rx, ry = xy[e, 0] - xy[b, 0], xy[e, 1] - xy[b, 1]
                    sx, sy = xy[a, 0] - xy[e, 0], xy[a, 1] - xy[e, 1]
                    off = corner_off(px, py, qx, qy) + corner_off(qx, qy, rx, ry)
                    off += corner_off(rx, ry, sx, sy) + corner_off(sx, sy, px, py)
                    off += sides_off(px, py, rx, ry) + sides_off(qx, qy, sx, sy)
                    scores[k] = scores[twin] = off
    pairs, best = np.full(n_cells, -1, np.int64), np.full(n_cells, -1, np.int64)
    for _ in range(ROUNDS):
        for c in range(n_cells):
            best[c] = -1
            least = np.inf
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                if pairs[c] < 0 and scores[k] < least and pairs[cells[twins[k]]] < 0:
                    least, best[c] = scores[k], k
        for c in range(n_cells):
            if best[c] >= 0 and best[cells[twins[best[c]]]] == twins[best[c]]:
                pairs[c] = best[c]
    return pairs


@kernel()
def order_sheets(neighbours: IndexArray) -> tuple[IndexArray, IndexArray, BoolArray]:
    """List the links sheet by sheet.

    Parameters
    ----------
    neighbours : (n_links, 2)
        The links before and after each, in either order, or -1.

    Returns
    -------
    offsets, links, closed : (n_sheets + 1,), (n_links,), (n_sheets,)
        CSR map from a sheet to its links in order; whether its last is followed by its first.
    """
    n = neighbours.shape[0]
    links, seen = np.empty(n, np.int64), np.zeros(n, np.bool_)
    offsets, closed = np.zeros(n + 1, np.int64), np.zeros(n, np.bool_)
    n_sheets = filled = 0
    for ring in range(2):  # first those with an end, then what is left: rings
        for start in range(n):
            is_end = neighbours[start, 0] < 0 or neighbours[start, 1] < 0
            if seen[start] or not (is_end or ring == 1):
                continue
            link = start
            side = 1 if neighbours[start, 0] < 0 else 0
            while link >= 0 and not seen[link]:
                seen[link] = True
                links[filled] = link
                filled += 1
                after = neighbours[link, side]
                if after >= 0:
                    side = 1 if neighbours[after, 0] == link else 0
                link = after
            closed[n_sheets] = ring == 1
            n_sheets += 1
            offsets[n_sheets] = filled
    return offsets[: n_sheets + 1].copy(), links, closed[:n_sheets].copy()


@kernel()
def fit_along(
    offsets: IndexArray,
    links: IndexArray,
    closed: BoolArray,
    values: FloatArray,
    width: int,
    degree: int,
    fit: FloatArray,
    residual: FloatArray,
) -> None:
    """Fit a polynomial to the values within `width` links of each link along its sheet.

    The weights are (1 - t²)², t being the distance over `width` + 1. Near the end of a sheet the
    window has less to one side; where it has too few links the degree falls.

    Parameters
    ----------
    offsets, links, closed
        As `order_sheets` gives them.
    values : (n_links,)
        What is fitted.
    width, degree
        Half the width of the window in links; 0, 1 or 2.
    fit, residual : (n_links,)
        Overwritten: the polynomial at the link; the weighted mean square of what it leaves of the
        values, over the share of degrees of freedom that it leaves; 0 where that is none.
    """
    for s in range(closed.size):
        first, n = offsets[s], offsets[s + 1] - offsets[s]
        line = np.empty(n)
        for i in range(n):
            line[i] = values[links[first + i]]
        # On a ring no window is cut off, but none may come round to its own link.
        half = min(width, (n - 1) // 2) if closed[s] else width
        weights, square = np.empty(2 * half + 1), 1.0 / (half + 1.0)
        for k in range(2 * half + 1):
            t = (k - half) * square
            weights[k] = (1.0 - t * t) ** 2
        for i in range(n):
            low, high = i - half, i + half
            if not closed[s]:
                low, high = max(low, 0), min(high, n - 1)
            centre = line[i]
            s0 = s1 = s2 = s3 = s4 = y0 = y1 = y2 = yy = 0.0
            for j in range(low, high + 1):
                k = j
                if k < 0:
                    k += n
                elif k >= n:
                    k -= n
                t, w, y = (j - i) * square, weights[j - i + half], line[k] - centre
                wt, wy = w * t, w * y
                s0 += w
                y0 += wy
                yy += wy * y
                if degree > 0:
                    s1 += wt
                    s2 += wt * t
                    y1 += wy * t
                if degree > 1:
                    s3 += wt * t * t
                    s4 += wt * t * t * t
                    y2 += wy * t * t
            used = min(degree, high - low)
            a, b, c = y0 / s0, 0.0, 0.0
            if used == 1:
                det = s0 * s2 - s1 * s1
                a, b = (y0 * s2 - y1 * s1) / det, (y1 * s0 - y0 * s1) / det
            elif used == 2:  # by the cofactors of the normal equations
                p, q, r = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
                u, v, w = s0 * s4 - s2 * s2, s1 * s2 - s0 * s3, s0 * s2 - s1 * s1
                det = s0 * p + s1 * q + s2 * r
                a = (y0 * p + y1 * q + y2 * r) / det
                b = (y0 * q + y1 * u + y2 * v) / det
                c = (y0 * r + y1 * v + y2 * w) / det
            link = links[first + i]
            fit[link] = centre + a
            count = high - low + 1
            left = max(yy - a * y0 - b * y1 - c * y2, 0.0) / s0
            residual[link] = left * count / (count - used - 1) if count > used + 1 else 0.0


@kernel()
def mean_with_neighbours(
    cell_offsets: IndexArray,
    twins: IndexArray,
    corner_cells: IndexArray,
    values: FloatArray,
    means: FloatArray,
) -> None:
    """Average what each cell has with what the cells across its sides have.

    Parameters
    ----------
    cell_offsets, twins, corner_cells
        CSR map from a cell to its sides, the other cell's side of each or -1, and a side's cell.
    values : (n_cells, k)
        What is averaged.
    means : (n_cells, k)
        Overwritten.
    """
    for c in range(cell_offsets.size - 1):
        for i in range(values.shape[1]):
            total, count = values[c, i], 1
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                if twins[k] >= 0:
                    total += values[corner_cells[twins[k]], i]
                    count += 1
            means[c, i] = total / count


@kernel()
def group_sizes(
    cell_offsets: IndexArray, twins: IndexArray, corner_cells: IndexArray, marked: BoolArray
) -> IndexArray:
    """Count the marked cells that hang together across sides with each marked cell, (n_cells,).

    Parameters
    ----------
    cell_offsets, twins, corner_cells
        As in `mean_with_neighbours`.
    marked : (n_cells,)
        Cells that count; the others have 0.
    """
    sizes = np.zeros(marked.size, np.int64)
    group = np.empty(marked.size, np.int64)
    for start in range(marked.size):
        if not marked[start] or sizes[start] > 0:
            continue
        group[0], count, done = start, 1, 0
        sizes[start] = 1
        while done < count:
            c = group[done]
            done += 1
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                if twins[k] >= 0:
                    other = corner_cells[twins[k]]
                    if marked[other] and sizes[other] == 0:
                        group[count], sizes[other] = other, 1
                        count += 1
        for i in range(count):
            sizes[group[i]] = count
    return sizes
