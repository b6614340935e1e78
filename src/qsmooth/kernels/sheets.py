"""Sheets: the strips of quads that one crosses by always leaving through the opposite side.

Each quad lies on two sheets. A *link* is a quad seen as a part of one of them: link 2 q of quad q
is crossed through its sides 1 and 3, link 2 q + 1 through its sides 0 and 2. Links are listed sheet
by sheet, in the order in which one comes to them, so what varies along a sheet is a signal in time,
and can be fitted as one.
"""

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import kernel, parallel_kernel
from numba import prange


@kernel()
def pair_triangles(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray
) -> IndexArray:
    """Pair triangles that share their longest side: quads cut in two.

    Returns
    -------
    (n_cells,)
        Position of each triangle's longest side where it is the other's too, else -1.
    """
    n_cells = cell_offsets.size - 1
    longest = np.full(n_cells, -1, np.int64)
    owner = np.empty(cell_vertices.size, np.int64)
    for c in range(n_cells):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        most = -1.0
        for k in range(first, last):
            owner[k] = c
            a, b = cell_vertices[k], cell_vertices[k + 1 if k + 1 < last else first]
            length = (xy[b, 0] - xy[a, 0]) ** 2 + (xy[b, 1] - xy[a, 1]) ** 2
            if last - first == 3 and length > most:
                most, longest[c] = length, k
    pairs = np.full(n_cells, -1, np.int64)
    for c in range(n_cells):
        if longest[c] >= 0:
            twin = twins[longest[c]]
            if twin >= 0 and longest[owner[twin]] == twin:
                pairs[c] = longest[c]
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
    for ring in range(2):
        for start in range(n):
            is_end = neighbours[start, 0] < 0 or neighbours[start, 1] < 0
            if seen[start] or not (is_end or ring):
                continue
            link, before = start, np.int64(-1)
            side = 1 if neighbours[start, 0] < 0 else 0
            while link >= 0 and not seen[link]:
                seen[link] = True
                links[filled] = link
                filled += 1
                if before >= 0:
                    side = 1 if neighbours[link, 0] == before else 0
                before, link = link, neighbours[link, side]
            closed[n_sheets] = ring == 1
            n_sheets += 1
            offsets[n_sheets] = filled
    return offsets[: n_sheets + 1].copy(), links, closed[:n_sheets].copy()


@parallel_kernel()
def fit_along(
    offsets: IndexArray,
    links: IndexArray,
    closed: BoolArray,
    values: FloatArray,
    half: int,
    degree: int,
    fit: FloatArray,
    residual: FloatArray,
) -> None:
    """Fit a polynomial to what lies within `half` links of each link along its sheet.

    The weights fall as (1 - t²)², t the distance over `half` + 1. Near the end of a sheet there are
    fewer to one side; where there are too few the degree falls.

    Parameters
    ----------
    offsets, links, closed
        As `order_sheets` gives them.
    values : (n_links,)
        What is fitted.
    half, degree
        Half the width of the window; 0, 1 or 2.
    fit, residual : (n_links,)
        Overwritten: the polynomial's value at the link; the mean square of what is left of the
        values in the window, per degree of freedom of the fit, 0 where there is none.
    """
    for s in prange(offsets.size - 1):
        first, n = offsets[s], offsets[s + 1] - offsets[s]
        for i in range(n):
            low, high = i - half, i + half
            if not closed[s] or n < 2 * half + 1:
                low, high = max(low, 0), min(high, n - 1)
            s0 = s1 = s2 = s3 = s4 = y0 = y1 = y2 = yy = 0.0
            centre = values[links[first + i]]
            for j in range(low, high + 1):
                t = (j - i) / (half + 1.0)
                w = (1.0 - t * t) ** 2
                y = values[links[first + (j + n) % n]] - centre
                s0 += w
                s1 += w * t
                s2 += w * t * t
                s3 += w * t * t * t
                s4 += w * t * t * t * t
                y0 += w * y
                y1 += w * y * t
                y2 += w * y * t * t
                yy += w * y * y
            count = high - low + 1
            a = y0 / s0
            b = c = 0.0
            used = min(degree, count - 1)
            if used == 1:
                det = s0 * s2 - s1 * s1
                a, b = (y0 * s2 - y1 * s1) / det, (y1 * s0 - y0 * s1) / det
            elif used == 2:
                p, q, r = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
                det = s0 * p + s1 * q + s2 * r
                a = (y0 * p + y1 * q + y2 * r) / det
                b = (y0 * q + y1 * (s0 * s4 - s2 * s2) + y2 * (s1 * s2 - s0 * s3)) / det
                c = (y0 * r + y1 * (s1 * s2 - s0 * s3) + y2 * (s0 * s2 - s1 * s1)) / det
            left = max(yy - a * y0 - b * y1 - c * y2, 0.0)
            fit[links[first + i]] = centre + a
            free = count - used - 1
            residual[links[first + i]] = left / s0 * count / free if free > 0 else 0.0
