"""What is asked of a mesh after every sweep, in one pass: extreme angles, shapes, validity."""

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
    look_at_cells,
    store_lanes,
)

# Columns of what comes out of a chunk: extremes of the diamond angle, cells in doubt.
N_COLUMNS = 3
# What each lane has seen so far.
LOWEST, HIGHEST, DOUBT = (lane_row(k) for k in range(4, 7))
N_ROWS = 7


@parallel_kernel()
def glance(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    shape: FloatArray,
    out: FloatArray,
) -> None:
    """Measure the shape of each cell, and find the extreme angles and how many cells are in doubt.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices
        As in `cell_figures.cell_figures`.
    shape : (n_cells,)
        Overwritten, as by `cell_figures.cell_figures`.
    out : (n_chunks, 3)
        Overwritten, a row for each `CELLS_A_CHUNK` cells: the smallest and the largest angle, as
        `cell_lanes.diamond_angle` gives it, of the cells whose coordinates are not NaN; the count
        of cells that are not valid, or not so beyond rounding.
    """
    n_cells = cell_offsets.size - 1
    for chunk in prange(out.shape[0]):
        cells = np.empty(LANES, np.int64)
        p, s = np.empty(N_PLACES * LANES), np.empty(N_ROWS * LANES)
        for i in range(LANES):
            s[LOWEST + i], s[HIGHEST + i], s[DOUBT + i] = 4.0, 0.0, 0.0
        start, stop = chunk * CELLS_A_CHUNK, min((chunk + 1) * CELLS_A_CHUNK, n_cells)
        for first in range(start, stop, LANES):
            last = min(first + LANES, stop)
            left = last - first
            for n_corners in (4, 3):
                n = look_at_cells(
                    xy, cell_offsets, cell_vertices, first, last, n_corners, cells, p, s
                )
                for i in range(n):
                    s[LOWEST + i] = min(s[LOWEST + i], s[LOW + i])
                    s[HIGHEST + i] = max(s[HIGHEST + i], s[HIGH + i])
                    s[DOUBT + i] += 1.0 - s[SURE + i]
                store_lanes(s, SHAPE, cells, n, shape)
                left -= n
                if left == 0:
                    break
        low, high, doubtful = 4.0, 0.0, 0.0
        for i in range(LANES):
            low, high = min(low, s[LOWEST + i]), max(high, s[HIGHEST + i])
            doubtful += s[DOUBT + i]
        out[chunk, 0], out[chunk, 1], out[chunk, 2] = low, high, doubtful
