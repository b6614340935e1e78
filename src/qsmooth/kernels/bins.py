"""Cells by square bins of the plane: where a walk through the mesh does not lead to a place."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel, parallel_kernel
from qsmooth.kernels.locating import FOLDED, holds, kind_of, put_weights

# Cells stand in so many bins on average at most, or bins are made larger.
MOST_BINS_A_CELL = 16


@helper()
def _bin(value: float, low: float, size: float, count: int) -> int:
    return min(count - 1, max(0, int((value - low) / size)))


@helper()
def _box(
    xy: FloatArray, cell_vertices: IndexArray, first: int, last: int
) -> tuple[float, float, float, float]:
    """Smallest and largest x, smallest and largest y of a cell."""
    v = cell_vertices[first]
    west, east, south, north = xy[v, 0], xy[v, 0], xy[v, 1], xy[v, 1]
    for k in range(first + 1, last):
        v = cell_vertices[k]
        west, east = min(west, xy[v, 0]), max(east, xy[v, 0])
        south, north = min(south, xy[v, 1]), max(north, xy[v, 1])
    return west, east, south, north


@kernel()
def build_bins(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    low: FloatArray,
    size: float,
    shape: tuple[int, int],
) -> tuple[IndexArray, IndexArray]:
    """List the cells that are not folded by the bins that their boxes touch.

    Parameters
    ----------
    low : (2,)
        Smallest coordinates of the first bin; it is `size` wide and high.
    shape
        Bins along x and along y.

    Returns
    -------
    offsets, cells
        CSR map from a bin, x running fastest, to cells, ascending; `cells` is empty where there
        would be too many: then bins have to be larger.
    """
    n_cells = cell_offsets.size - 1
    offsets = np.zeros(shape[0] * shape[1] + 1, np.int64)
    members = np.empty(0, np.int64)
    for filling in range(2):
        for c in range(n_cells - 1, -1, -1):
            first, last = cell_offsets[c], cell_offsets[c + 1]
            if kind_of(xy, cell_vertices, first, last) == FOLDED:
                continue
            west, east, south, north = _box(xy, cell_vertices, first, last)
            from_x, to_x = _bin(west, low[0], size, shape[0]), _bin(east, low[0], size, shape[0])
            from_y, to_y = _bin(south, low[1], size, shape[1]), _bin(north, low[1], size, shape[1])
            for y in range(from_y, to_y + 1):
                for x in range(from_x, to_x + 1):
                    b = y * shape[0] + x
                    if filling:
                        offsets[b] -= 1
                        members[offsets[b]] = c
                    else:
                        offsets[b] += 1
        if not filling:
            total = 0
            for b in range(offsets.size):
                total += offsets[b]
                offsets[b] = total
            if total > MOST_BINS_A_CELL * n_cells and offsets.size > 2:
                break
            members = np.empty(total, np.int64)
    return offsets, members


@helper()
def _nearest_on_edge(
    ax: float, ay: float, bx: float, by: float, px: float, py: float
) -> tuple[float, float]:
    """Place on the edge from a to b that is nearest to p."""
    ex, ey = bx - ax, by - ay
    length = ex * ex + ey * ey
    share = 0.0 if length == 0.0 else ((px - ax) * ex + (py - ay) * ey) / length
    share = min(1.0, max(0.0, share))
    return ax + share * ex, ay + share * ey


@helper()
def _holding(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    bins: tuple[IndexArray, IndexArray],
    b: int,
    px: float,
    py: float,
    nx: float,
    ny: float,
) -> int:
    """Of the cells that hold p the one whose corners' mean is nearest to n, or -1."""
    cell_offsets, cell_vertices = cells
    offsets, members = bins
    best, least = -1, np.inf
    for m in range(offsets[b], offsets[b + 1]):
        c = members[m]
        first, last = cell_offsets[c], cell_offsets[c + 1]
        kind = kind_of(xy, cell_vertices, first, last)
        if holds(xy, cell_vertices, (first, last), kind, px, py):
            x = y = 0.0
            for k in range(first, last):
                x += xy[cell_vertices[k], 0] - nx
                y += xy[cell_vertices[k], 1] - ny
            far = math.hypot(x, y) / (last - first)
            if far < least:
                best, least = c, far
    return best


@helper()
def _nearest(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    bins: tuple[IndexArray, IndexArray],
    at: tuple[int, int],
    size: float,
    shape: tuple[int, int],
    px: float,
    py: float,
) -> tuple[int, float, float]:
    """Cell nearest to a place that none holds, and the place on its edge; rings of bins outward."""
    cell_offsets, cell_vertices = cells
    offsets, members = bins
    best, least, bx, by = -1, np.inf, px, py
    for ring in range(shape[0] + shape[1]):
        if least <= (ring - 1) * size:
            break
        for y in range(max(0, at[1] - ring), min(shape[1], at[1] + ring + 1)):
            edge = y == at[1] - ring or y == at[1] + ring
            for x in range(max(0, at[0] - ring), min(shape[0], at[0] + ring + 1)):
                if not (edge or x == at[0] - ring or x == at[0] + ring):
                    continue
                b = y * shape[0] + x
                for m in range(offsets[b], offsets[b + 1]):
                    c = members[m]
                    first, last = cell_offsets[c], cell_offsets[c + 1]
                    for k in range(first, last):
                        v = cell_vertices[k]
                        w = cell_vertices[k + 1 if k + 1 < last else first]
                        ex, ey = _nearest_on_edge(xy[v, 0], xy[v, 1], xy[w, 0], xy[w, 1], px, py)
                        far = math.hypot(ex - px, ey - py)
                        if far < least:
                            best, least, bx, by = c, far, ex, ey
    return best, bx, by


@parallel_kernel()
def locate_by_bins(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    bins: tuple[IndexArray, IndexArray],
    low: FloatArray,
    size: float,
    shape: tuple[int, int],
    places: FloatArray,
    near: FloatArray,
    found: IndexArray,
    corners: IndexArray,
    weights: FloatArray,
) -> None:
    """Find the cell of each place among all cells, or the one nearest to it.

    Parameters
    ----------
    bins, low, size, shape
        As `build_bins` gives and takes them.
    places, near : (m, 2)
        Where to look. Of several cells, on top of each other, the one nearest to `near` counts.
    found, corners, weights
        As in `locating.locate`; -1 only where all cells are folded. Where no cell holds a place the
        weights are those of the nearest place on a cell's edge.
    """
    cell_offsets, cell_vertices = cells
    for i in prange(len(places)):
        px, py = places[i, 0], places[i, 1]
        bx, by = _bin(px, low[0], size, shape[0]), _bin(py, low[1], size, shape[1])
        c = _holding(xy, cells, bins, by * shape[0] + bx, px, py, near[i, 0], near[i, 1])
        if c < 0:
            c, px, py = _nearest(xy, cells, bins, (bx, by), size, shape, px, py)
        found[i] = c
        if c >= 0:
            ends = cell_offsets[c], cell_offsets[c + 1]
            put_weights(xy, cell_vertices, ends, px, py, i, corners, weights)
