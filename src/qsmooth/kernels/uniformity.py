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
        own = _size(area[c], cell_offsets[c + 1] - cell_offsets[c])
        largest = np.nan
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] < 0:
                continue
            n = corner_cells[twins[k]]
            other = _size(area[n], cell_offsets[n + 1] - cell_offsets[n])
            ratio = np.inf
            if own > 0.0 and other > 0.0:
                ratio = max(own, other) / min(own, other)
            largest = ratio if math.isnan(largest) else max(largest, ratio)
        out[c] = largest
