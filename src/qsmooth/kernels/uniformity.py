"""How alike in size neighbouring cells are."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import parallel_kernel

# Area of the equilateral triangle with edges of one, beside 1 for the square.
TRIANGLE_AREA = 0.25 * math.sqrt(3.0)


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
        own = area[c] if cell_offsets[c + 1] - cell_offsets[c] == 4 else area[c] / TRIANGLE_AREA
        largest = np.nan
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] < 0:
                continue
            n = corner_cells[twins[k]]
            size = (
                area[n] if cell_offsets[n + 1] - cell_offsets[n] == 4 else area[n] / TRIANGLE_AREA
            )
            if not (own > 0.0 and size > 0.0):
                ratio = np.inf
            else:
                ratio = max(own, size) / min(own, size)
            largest = ratio if math.isnan(largest) else np.maximum(largest, ratio)
        out[c] = largest
