"""How alike in size neighbouring cells are."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, parallel_kernel

# Area of the equilateral triangle with edges of one, beside 1 for the square.
TRIANGLE_AREA = 0.25 * math.sqrt(3.0)


@helper()
def _size(area: float, n_corners: int) -> float:
    """Area over that of the ideal cell with edges of one."""
    return area if n_corners == 4 else area / TRIANGLE_AREA


@parallel_kernel()
def size_jump(
    area: FloatArray,
    cell_offsets: IndexArray,
    twins: IndexArray,
    corner_cells: IndexArray,
    out: FloatArray,
) -> None:
    """Measure the largest ratio of size between each cell and its edge neighbours.

    Parameters
    ----------
    area : (n_cells,)
        Signed areas, in any one unit.
    cell_offsets : (n_cells + 1,)
        Corner positions of each cell.
    twins, corner_cells : (n_corners,)
        The same edge's position in the neighbouring cell, or -1; the cell of each position.
    out : (n_cells,)
        Overwritten. 1 or more; infinite where an area is not positive, NaN without a neighbour.
    """
    for c in prange(out.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        own = _size(area[c], last - first)
        smallest, largest = np.inf, -np.inf
        for k in range(first, last):
            if twins[k] < 0:
                continue
            n = np.uint64(corner_cells[np.uint64(twins[k])])
            other = _size(area[n], cell_offsets[n + np.uint64(1)] - cell_offsets[n])
            smallest = min(smallest, other if other > 0.0 else 0.0)
            largest = max(largest, other)
        # One division for all the smaller ones, and one for the larger.
        ratio = np.nan
        if smallest < np.inf:
            ratio = np.inf
            if own > 0.0 and smallest > 0.0:
                ratio = max(own / smallest, largest / own)
        out[c] = ratio
