"""What is asked of a mesh after every sweep, in one pass and without an array of figures."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.blocks import LANES, lane_row
from qsmooth.kernels.cell_lanes import (
    CELLS_A_CHUNK,
    HIGH,
    LOW,
    N_PLACES,
    SHAPE,
    SURE,
    gather_cells,
    look_at_quads,
    look_at_triangles,
)

# Columns of what comes out: extremes of the diamond angle, sum of shapes, cells in doubt.
N_COLUMNS = 4
# What each lane has seen so far.
LOWEST, HIGHEST, TOTAL, DOUBT = (lane_row(k) for k in range(4, 8))
N_ROWS = 8


@parallel_kernel()
def glance(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, out: FloatArray
) -> None:
    """Find the extreme angles of a mesh, the sum of its shapes and how many cells are in doubt.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices
        As in `cell_metrics.angles`.
    out : (n_chunks, 4)
        Overwritten, a row for each `CELLS_A_CHUNK` cells: the smallest and the largest angle, as
        `cell_lanes.diamond_angle` gives it; the sum of the shapes; the count of cells that are not
        valid, or not so beyond rounding. Where a coordinate is NaN so is the sum of shapes, and the
        angles are those of the other cells.
    """
    n_cells = cell_offsets.size - 1
    for chunk in prange(out.shape[0]):
        cells = np.empty(LANES, np.int64)
        p, s = np.empty(N_PLACES * LANES), np.empty(N_ROWS * LANES)
        for i in range(LANES):
            s[LOWEST + i], s[HIGHEST + i], s[TOTAL + i], s[DOUBT + i] = 4.0, 0.0, 0.0, 0.0
        start, stop = chunk * CELLS_A_CHUNK, min((chunk + 1) * CELLS_A_CHUNK, n_cells)
        for first in range(start, stop, LANES):
            last = min(first + LANES, stop)
            left = last - first
            for n_corners in (4, 3):
                if left == 0:
                    break
                n = gather_cells(xy, cell_offsets, cell_vertices, first, last, n_corners, cells, p)
                left -= n
                if n_corners == 4:
                    look_at_quads(p, n, s)
                else:
                    look_at_triangles(p, n, s)
                for i in range(n):
                    s[LOWEST + i] = min(s[LOWEST + i], s[LOW + i])
                    s[HIGHEST + i] = max(s[HIGHEST + i], s[HIGH + i])
                    s[TOTAL + i] += s[SHAPE + i]
                    s[DOUBT + i] += 1.0 - s[SURE + i]
        low, high, shapes, doubtful = 4.0, 0.0, 0.0, 0.0
        for i in range(LANES):
            low, high = min(low, s[LOWEST + i]), max(high, s[HIGHEST + i])
            shapes += s[TOTAL + i]
            doubtful += s[DOUBT + i]
        out[chunk, 0], out[chunk, 1], out[chunk, 2], out[chunk, 3] = low, high, shapes, doubtful
