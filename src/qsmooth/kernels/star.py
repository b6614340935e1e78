"""Smoothing by star: vertex by vertex, in place, colour by colour."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.geometry import share
from qsmooth.kernels.guards import allowed_step
from qsmooth.kernels.moves import mean_proposal

# Vertices that share one piece of scratch memory, and the grain of the parallel loop.
CHUNK = 128


@parallel_kernel()
def star_sweep(
    xy: FloatArray,
    colour_offsets: IndexArray,
    vertices: TableArray,
    offsets: IndexArray,
    corners: TableArray,
    cells: TableArray,
    pace: FloatArray,
    limit: FloatArray,
    step: float,
    good: float,
    largest_star: int,
    moves: FloatArray,
    shares: FloatArray,
) -> None:
    """Move each vertex once by what the cells of its star propose.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit. Moved in place.
    colour_offsets, vertices : (n_colours + 1,), (n_movable,)
        The movable vertices by colour: no two of one colour share a cell.
    offsets, corners, cells : (n_movable + 1,), (n_rows, 3), (n_rows,)
        The table of their stars (`topology.star_table`).
    pace : (n_cells,)
        Multiple of `step` at which each cell proposes; 0 for a cell that proposes nothing.
    limit : (2, 4)
        Angle thresholds as `moves.thresholds` tabulates them.
    step
        Fraction of each move that is proposed, in (0, 1].
    good
        Scaled Jacobian of the ``"quality"`` guard; NaN for the ``"clearance"`` guard.
    largest_star
        Cells in the largest star.
    moves, shares : (n_movable,)
        Overwritten. Length of each move, and what share it was of the vertex's shortest edge.
    """
    for colour in range(colour_offsets.size - 1):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            lines = np.empty((3 * largest_star, 3))
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                v = vertices[i]
                first, last = offsets[i], offsets[i + 1]
                dx, dy, shortest = mean_proposal(
                    xy, v, corners, cells, first, last, pace, limit, step, False, lines
                )
                moves[i], shares[i] = 0.0, 0.0
                if dx != 0.0 or dy != 0.0:
                    x, y = xy[v, 0], xy[v, 1]
                    new_x, new_y = allowed_step(
                        xy, v, corners, first, last, dx, dy, good, lines, 0, 0.0
                    )
                    xy[v, 0], xy[v, 1] = new_x, new_y
                    moves[i] = math.sqrt((new_x - x) * (new_x - x) + (new_y - y) * (new_y - y))
                    shares[i] = share(moves[i], shortest)
