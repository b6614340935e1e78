"""Smoothing by quad: all cells propose at once, then the vertices follow, colour by colour."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.geometry import share
from qsmooth.kernels.guards import allowed_step, clearance, guard_lines, tolerated_loss
from qsmooth.kernels.moves import mean_proposal
from qsmooth.kernels.star import CHUNK


@parallel_kernel()
def quad_proposals(
    xy: FloatArray,
    vertices: TableArray,
    offsets: IndexArray,
    corners: TableArray,
    cells: TableArray,
    pace: FloatArray,
    limit: FloatArray,
    step: float,
    largest_star: int,
    wanted: FloatArray,
) -> None:
    """Average, for each vertex, the accepted proposals of its cells' corners.

    Parameters
    ----------
    xy, vertices, offsets, corners, cells, pace, limit, step, largest_star
        As in `star.star_sweep`; nothing moves here.
    wanted : (n_movable, 2)
        Overwritten. Displacement of each vertex.
    """
    for chunk in prange((vertices.size + CHUNK - 1) // CHUNK):
        lines = np.empty((3 * largest_star, 3))
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, vertices.size)):
            dx, dy, _ = mean_proposal(
                xy, vertices[i], corners, cells, offsets[i], offsets[i + 1], pace, limit, step,
                True, lines,
            )  # fmt: skip
            wanted[i, 0], wanted[i, 1] = dx, dy


@parallel_kernel()
def guarded_commit(
    xy: FloatArray,
    colour_offsets: IndexArray,
    vertices: TableArray,
    offsets: IndexArray,
    corners: TableArray,
    wanted: FloatArray,
    good: float,
    largest_star: int,
    moves: FloatArray,
    shares: FloatArray,
) -> None:
    """Move each vertex by its wanted displacement, or as much of it as its guards allow.

    The neighbours may have moved since the displacement was proposed, so the clearance of the
    vertex's present place among their present places is asked for again.

    Parameters
    ----------
    wanted : (n_movable, 2)
        Displacement of each vertex.
    xy, colour_offsets, vertices, offsets, corners, good, largest_star, moves, shares
        As in `star.star_sweep`.
    """
    for colour in range(colour_offsets.size - 1):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            lines = np.empty((3 * largest_star, 3))
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                moves[i], shares[i] = 0.0, 0.0
                dx, dy = wanted[i, 0], wanted[i, 1]
                if dx == 0.0 and dy == 0.0:
                    continue
                v = vertices[i]
                first, last = offsets[i], offsets[i + 1]
                n_lines, longest, shortest, largest = guard_lines(
                    xy, v, corners, first, last, lines
                )
                least = clearance(lines, n_lines) - tolerated_loss(longest, largest)
                x, y = xy[v, 0], xy[v, 1]
                new_x, new_y = allowed_step(
                    xy, v, corners, first, last, dx, dy, good, lines, n_lines, least
                )
                xy[v, 0], xy[v, 1] = new_x, new_y
                moves[i] = math.sqrt((new_x - x) * (new_x - x) + (new_y - y) * (new_y - y))
                shares[i] = share(moves[i], shortest)
