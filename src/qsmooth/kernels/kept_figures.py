"""Figures of cells that a session keeps, and measures again where something has moved."""

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel, lane_helper
from qsmooth.kernels.blocks import LANES, lane_row
from qsmooth.kernels.cell_lanes import (
    N_PLACES,
    X0,
    X1,
    X2,
    X3,
    Y0,
    Y1,
    Y2,
    Y3,
    gather_cells,
    store_lanes,
)
from qsmooth.kernels.geometry import certainly_left
from qsmooth.kernels.star_energy import SINE_60

# Rows of figures: the largest and the smallest cosine and the smallest sine of a cell's corners
# that can change, and the smallest sine of all, in a triangle over that of 60 degrees, each squared
# with its sign kept; 1 where the cell is valid beyond rounding, else 0.
MOST_COSINE, LEAST_COSINE, LEAST_SINE, WORST_SINE, SURE = range(5)
N_FIGURES = 5
# The same as rows of lanes, and whether each corner counts.
MOST, LEAST, SINE, WORST, CERTAIN, COUNTS = (lane_row(k) for k in range(6))
NEXT = lane_row(1)
N_ROWS = 9
IN_A_TRIANGLE = 1.0 / SINE_60**2


@lane_helper()
def _corner(
    ax: float, ay: float, bx: float, by: float, dx: float, dy: float
) -> tuple[float, float, float]:
    """Signed squares of a corner's cosine and sine; and 1 where it is certainly positive, or 0."""
    ux, uy, wx, wy = bx - ax, by - ay, dx - ax, dy - ay
    det, dot = ux * wy - uy * wx, ux * wx + uy * wy
    lengths = (ux * ux + uy * uy) * (wx * wx + wy * wy)
    inv = 1.0 / lengths if lengths > 0.0 else 0.0
    sure = 1.0 if certainly_left(bx, by, dx, dy, ax, ay) else 0.0
    return dot * abs(dot) * inv, det * abs(det) * inv, sure


@lane_helper()
def _add_corner(
    s: FloatArray, i: int, counts: int, ax: float, ay: float, bx: float, by: float,
    dx: float, dy: float,
) -> None:  # fmt: skip
    """Add what a corner says to the figures in its lane."""
    cosine, sine, sure = _corner(ax, ay, bx, by, dx, dy)
    mine = s[counts + i] > 0.0
    s[MOST + i] = max(s[MOST + i], cosine) if mine else s[MOST + i]
    s[LEAST + i] = min(s[LEAST + i], cosine) if mine else s[LEAST + i]
    s[SINE + i] = min(s[SINE + i], sine) if mine else s[SINE + i]
    s[WORST + i] = min(s[WORST + i], sine)
    s[CERTAIN + i] *= sure


@helper()
def _look_at(p: FloatArray, n: int, n_corners: int, s: FloatArray) -> None:
    """Find the figures of the cells in lanes; corners that don't count are as good as can be."""
    for i in range(n):
        s[MOST + i], s[LEAST + i], s[SINE + i] = -1.0, 1.0, np.inf
        s[WORST + i], s[CERTAIN + i] = np.inf, 1.0
    if n_corners == 4:
        for i in range(n):
            ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
            cx, cy, dx, dy = p[X2 + i], p[Y2 + i], p[X3 + i], p[Y3 + i]
            _add_corner(s, i, COUNTS, ax, ay, bx, by, dx, dy)
            _add_corner(s, i, COUNTS + NEXT, bx, by, cx, cy, ax, ay)
            _add_corner(s, i, COUNTS + NEXT + NEXT, cx, cy, dx, dy, bx, by)
            _add_corner(s, i, COUNTS + NEXT + NEXT + NEXT, dx, dy, ax, ay, cx, cy)
    else:
        for i in range(n):
            ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
            cx, cy = p[X2 + i], p[Y2 + i]
            _add_corner(s, i, COUNTS, ax, ay, bx, by, cx, cy)
            _add_corner(s, i, COUNTS + NEXT, bx, by, cx, cy, ax, ay)
            _add_corner(s, i, COUNTS + NEXT + NEXT, cx, cy, ax, ay, bx, by)
            s[SINE + i] *= IN_A_TRIANGLE
            s[WORST + i] *= IN_A_TRIANGLE


@kernel()
def measure_chunks(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    counts: FloatArray,
    dirty: BoolArray,
    figures: FloatArray,
) -> None:
    """Measure the cells of the marked chunks again, and take these for clean.

    Parameters
    ----------
    counts : (n_corners,)
        1 at corners with a movable vertex, which can change, else 0.
    dirty : (n_chunks,)
        Overwritten with false.
    figures : (5, n_cells)
        Overwritten there, as the rows at the head of this module say.
    """
    n_cells = cell_offsets.size - 1
    cells = np.empty(LANES, np.int64)
    p, s = np.empty(N_PLACES * LANES), np.empty(N_ROWS * LANES)
    most, least, sine = figures[MOST_COSINE], figures[LEAST_COSINE], figures[LEAST_SINE]
    worst, sure = figures[WORST_SINE], figures[SURE]
    for chunk in range(dirty.size):
        if not dirty[chunk]:
            continue
        dirty[chunk] = False
        first, last = chunk * LANES, min((chunk + 1) * LANES, n_cells)
        left = last - first
        for n_corners in (4, 3):
            n = gather_cells(xy, cell_offsets, cell_vertices, first, last, n_corners, cells, p)
            if n == 0:
                continue
            for i in range(n):
                k = np.uint64(cell_offsets[cells[i]])
                row = np.uint64(i) + COUNTS
                for _ in range(n_corners):
                    s[row] = counts[k]
                    k, row = k + np.uint64(1), row + NEXT
            _look_at(p, n, n_corners, s)
            store_lanes(s, MOST, cells, n, most)
            store_lanes(s, LEAST, cells, n, least)
            store_lanes(s, SINE, cells, n, sine)
            store_lanes(s, WORST, cells, n, worst)
            store_lanes(s, CERTAIN, cells, n, sure)
            left -= n
            if left == 0:
                break


@helper()
def _signed_root(square: float) -> float:
    return math.copysign(math.sqrt(abs(square)), square)


@kernel()
def worst_figures(figures: FloatArray, regions: IndexArray, worst: FloatArray) -> tuple[float, int]:
    """Find the worst figures of each region, and of all cells.

    Parameters
    ----------
    figures : (5, n_cells)
        As by `measure_chunks`.
    regions : (n_cells,)
        Region of each cell; those with -1, and cells that are not valid, do not count.
    worst : (n_regions, 3)
        Overwritten: the largest cosine, infinitely small where no cell counts, the smallest cosine
        and the smallest sine.

    Returns
    -------
    scaled_jacobian
        The smallest of all cells.
    n_doubtful
        Cells that are not valid, or not beyond rounding.
    """
    for r in range(worst.shape[0]):
        worst[r, 0], worst[r, 1], worst[r, 2] = -np.inf, np.inf, np.inf
    lowest, doubtful = np.inf, 0
    for c in range(regions.size):
        lowest = min(lowest, figures[WORST_SINE, c])
        r = regions[c]
        if figures[SURE, c] == 0.0:
            doubtful += 1
        elif r >= 0:
            worst[r, 0] = max(worst[r, 0], figures[MOST_COSINE, c])
            worst[r, 1] = min(worst[r, 1], figures[LEAST_COSINE, c])
            worst[r, 2] = min(worst[r, 2], figures[LEAST_SINE, c])
    for r in range(worst.shape[0]):
        if worst[r, 0] > -np.inf:
            for k in range(3):
                worst[r, k] = _signed_root(worst[r, k])
    return _signed_root(lowest), doubtful
