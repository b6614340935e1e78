"""The figures of cells that can be held, by the very formulas of the trials of `newton_sweep`."""

import math

import numpy as np
from numba import prange

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel, parallel_kernel
from qsmooth.kernels.corner_energy import INV_ROOT3
from qsmooth.kernels.star_energy import SINE_60

# Of a cell that no movable vertex changes: as good as can be.
NOTHING = (-1.0, 1.0, 1.0, 1.0, 1.0, np.inf)


@parallel_kernel()
def held_figures(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    movable: BoolArray,
    out: FloatArray,
) -> None:
    """Measure the worst of each cell's corners and edges that can change.

    Parameters
    ----------
    movable : (n_vertices,)
        Corners and edges without a movable vertex can't change and do not count.
    out : (n_cells, 6)
        Overwritten: the largest cosine, the smallest cosine, the smallest sine (in a triangle over
        that of 60 degrees) of a corner; the longest over the shortest edge, squared; the shape
        energy to the ideal cell, infinite where a corner is not positive; half the square of an
        edge. What it says of a cell with two vertices at one place is of no use.
    """
    for c in prange(out.shape[0]):
        figures = _figures_of(xy, cell_vertices, cell_offsets[c], cell_offsets[c + 1], movable)
        out[c, 0], out[c, 1], out[c, 2], out[c, 3], out[c, 4], out[c, 5] = figures


@parallel_kernel()
def beyond_held(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    movable: BoolArray,
    held: FloatArray,
    regions: IndexArray,
    out: BoolArray,
) -> None:
    """Mark the cells with a figure that is worse than what is held.

    Parameters
    ----------
    movable : (n_vertices,)
        As in `held_figures`.
    held : (n_regions, 6)
        What is held in each region, by the figures of `held_figures`.
    regions : (n_cells,)
        Region of each cell; -1 for the last row.
    out : (n_cells,)
        Overwritten. Figures that are NaN are not worse.
    """
    for c in prange(out.size):
        most, least, sine, ratio, shape, edge = _figures_of(
            xy, cell_vertices, cell_offsets[c], cell_offsets[c + 1], movable
        )
        region = regions[c] if regions[c] >= 0 else held.shape[0] - 1
        out[c] = (
            most > held[region, 0]
            or least < held[region, 1]
            or sine < held[region, 2]
            or ratio > held[region, 3]
            or shape > held[region, 4]
            or edge < held[region, 5]
        )


@kernel()
def worst_of_regions(
    figures: FloatArray, regions: IndexArray, smaller: BoolArray, worst: FloatArray
) -> None:
    """Find the worst figures of the cells of each region.

    Parameters
    ----------
    figures : (n_cells, k)
        Of each cell; NaN gets through.
    regions : (n_cells,)
        Number of the region of each cell; cells with -1 do not count.
    smaller : (k,)
        Whether the smaller figure is the better one.
    worst : (n_regions, k)
        What counts as worst without any cell on entry, overwritten where a cell's figure is worse.
    """
    for c in range(regions.size):
        region = regions[c]
        if region >= 0:
            for k in range(smaller.size):
                own, old = figures[c, k], worst[region, k]
                worst[region, k] = np.maximum(old, own) if smaller[k] else np.minimum(old, own)


@helper()
def _figures_of(
    xy: FloatArray, cell_vertices: IndexArray, first: int, last: int, movable: BoolArray
) -> tuple[float, float, float, float, float, float]:
    """Measure the worst of the corners and edges of one cell that can change."""
    is_triangle = last - first == 3
    best_sine = SINE_60 if is_triangle else 1.0
    most, least, sine, ratio, shape, edge = NOTHING
    shortest, longest = np.inf, 0.0
    d = cell_vertices[last - 1]
    own_det = _triangle(xy, movable, cell_vertices, first) if is_triangle else 0.0
    for k in range(first, last):
        a = cell_vertices[k]
        b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
        ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
        wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
        uu, ww = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
        shortest, longest = min(shortest, uu), max(longest, uu)
        if movable[a] or movable[b]:
            edge = min(edge, uu)
        if movable[a] or movable[b] or movable[d]:
            lengths = 2.0 * math.sqrt(uu * ww)
            cosine = (ux * wx + uy * wy) / lengths
            most, least = max(most, cosine), min(least, cosine)
            det = own_det if is_triangle else ux * wy - uy * wx
            sine = min(sine, det / (lengths * best_sine))
            total = uu + ww
            if is_triangle:
                ex, ey = xy[d, 0] - xy[b, 0], xy[d, 1] - xy[b, 1]
                total = INV_ROOT3 * (total + 0.5 * (ex * ex + ey * ey))
            shape = max(shape, total / det if det > 0.0 else np.inf)
        d = a
    if edge < np.inf:
        ratio = longest / shortest
    return most, least, sine, ratio, shape, edge


@helper()
def _triangle(xy: FloatArray, movable: BoolArray, cell_vertices: IndexArray, first: int) -> float:
    """Find the smallest of a triangle's determinants about each vertex that may move.

    A trial takes the one about the vertex that it moves; they differ by rounding.
    """
    least = np.inf
    a, b, d = cell_vertices[first], cell_vertices[first + 1], cell_vertices[first + 2]
    for _ in range(3):
        if movable[a]:
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
            least = min(least, ux * wy - uy * wx)
        a, b, d = b, d, a
    return least
