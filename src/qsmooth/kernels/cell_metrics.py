"""Quality of each cell beside `cell_figures`: its shortest edge and the exact class of validity."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.geometry import distance, orientation

VALID, COLLAPSED, CONCAVE, CROSSED, INVERTED = range(5)


@parallel_kernel()
def min_edge(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, out: FloatArray
) -> None:
    """Measure each cell's shortest edge, which bounds the time step of explicit solvers.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices
        As in `cell_figures.cell_figures`.
    out : (n_cells,)
        Overwritten. In the unit of the coordinates, 0 or more. NaN where a coordinate is NaN.
    """
    for c in prange(out.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        shortest = np.inf
        a = cell_vertices[last - 1]
        for k in range(first, last):
            b = cell_vertices[k]
            shortest = np.minimum(shortest, distance(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1]))
            a = b
        out[c] = shortest


@parallel_kernel()
def validity(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, out: IndexArray
) -> None:
    """Class each cell by the exact signs of its corners.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices
        As in `min_edge`; coordinates are finite.
    out : (n_cells,)
        Overwritten. A quad is valid (0) with four positive corners, collapsed (1) with a zero and
        no negative one, concave (2) with one negative, crossed (3) with two, or with one negative
        and a zero, inverted (4) with three or four. A triangle is valid, collapsed or inverted.
    """
    for c in prange(out.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        negative, zero = 0, 0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            sign = orientation(xy[d, 0], xy[d, 1], xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])
            negative += 1 if sign < 0 else 0
            zero += 1 if sign == 0 else 0
            d = a
        if negative >= 3:
            out[c] = INVERTED
        elif negative == 2 or (negative == 1 and zero > 0):
            out[c] = CROSSED
        elif negative == 1:
            out[c] = CONCAVE
        elif zero > 0:
            out[c] = COLLAPSED
        else:
            out[c] = VALID
