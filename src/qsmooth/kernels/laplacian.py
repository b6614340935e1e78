"""Laplacian smoothing: plain, the baseline that everybody knows, and guarded."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.geometry import distance, share
from qsmooth.kernels.guards import allowed_step
from qsmooth.kernels.star import CHUNK


@parallel_kernel()
def laplacian_sweep(
    xy: FloatArray,
    ring_offsets: IndexArray,
    ring_vertices: IndexArray,
    vertices: TableArray,
    xy_out: FloatArray,
    moves: FloatArray,
    shares: FloatArray,
) -> None:
    """Put each vertex at the mean of its ring, all at once and unguarded.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit.
    ring_offsets, ring_vertices : (n_vertices + 1,), (2 * n_edges,)
        CSR map from a vertex to its edge neighbours.
    vertices : (n_movable,)
        The vertices that move.
    xy_out : (n_vertices, 2)
        Overwritten in the rows of `vertices`.
    moves, shares : (n_movable,)
        Overwritten. Length of each move, and what share it was of the vertex's shortest edge.
    """
    for i in prange(vertices.size):
        v = vertices[i]
        x, y = xy[v, 0], xy[v, 1]
        first, last = ring_offsets[v], ring_offsets[v + 1]
        dx, dy, shortest = 0.0, 0.0, np.inf
        for k in range(first, last):
            w = ring_vertices[k]
            dx += xy[w, 0] - x
            dy += xy[w, 1] - y
            shortest = min(shortest, distance(x, y, xy[w, 0], xy[w, 1]))
        dx /= last - first
        dy /= last - first
        xy_out[v, 0] = x + dx
        xy_out[v, 1] = y + dy
        moves[i] = math.sqrt(dx * dx + dy * dy)
        shares[i] = share(moves[i], shortest)


@parallel_kernel()
def smart_laplacian_sweep(
    xy: FloatArray,
    ring_offsets: IndexArray,
    ring_vertices: IndexArray,
    colour_offsets: IndexArray,
    vertices: TableArray,
    offsets: IndexArray,
    corners: TableArray,
    good: float,
    moves: FloatArray,
    shares: FloatArray,
) -> None:
    """Move each vertex towards the mean of its ring as far as its guards allow, in place.

    Parameters
    ----------
    ring_offsets, ring_vertices
        As in `laplacian_sweep`.
    xy, colour_offsets, vertices, offsets, corners, good, moves, shares
        As in `star.star_sweep`.
    """
    no_lines = np.empty((0, 3))
    for colour in range(colour_offsets.size - 1):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                v = vertices[i]
                x, y = xy[v, 0], xy[v, 1]
                first, last = ring_offsets[v], ring_offsets[v + 1]
                dx, dy, shortest = 0.0, 0.0, np.inf
                for k in range(first, last):
                    w = ring_vertices[k]
                    dx += xy[w, 0] - x
                    dy += xy[w, 1] - y
                    shortest = min(shortest, distance(x, y, xy[w, 0], xy[w, 1]))
                new_x, new_y = allowed_step(
                    xy, v, corners, offsets[i], offsets[i + 1],
                    dx / (last - first), dy / (last - first), good, no_lines, 0, 0.0,
                )  # fmt: skip
                xy[v, 0], xy[v, 1] = new_x, new_y
                moves[i] = math.sqrt((new_x - x) * (new_x - x) + (new_y - y) * (new_y - y))
                shares[i] = share(moves[i], shortest)
