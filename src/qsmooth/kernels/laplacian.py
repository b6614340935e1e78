"""Laplacian smoothing: plain, the baseline that everybody knows, and guarded."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import inlined_helper, parallel_kernel
from qsmooth.kernels.geometry import distance, share
from qsmooth.kernels.guards import NO_FENCE, centre_of, guarded_move
from qsmooth.kernels.stars import CHUNK, Moves, Rings, Stars, Step


@inlined_helper()
def step_to_ring(
    xy: FloatArray, ring_offsets: IndexArray, ring_vertices: IndexArray, v: int
) -> Step:
    """Step from v to the mean of its edge neighbours."""
    x, y = xy[v, 0], xy[v, 1]
    first, last = ring_offsets[v], ring_offsets[v + 1]
    dx, dy, shortest = 0.0, 0.0, np.inf
    for k in range(first, last):
        w = ring_vertices[k]
        dx += xy[w, 0] - x
        dy += xy[w, 1] - y
        shortest = min(shortest, distance(x, y, xy[w, 0], xy[w, 1]))
    return Step(dx / (last - first), dy / (last - first), shortest)


@parallel_kernel()
def laplacian_sweep(
    xy: FloatArray, rings: Rings, stars: Stars, xy_out: FloatArray, moves: Moves
) -> None:
    """Put each vertex at the mean of its ring, all at once and unguarded.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit.
    rings
        The edge neighbours of each vertex.
    stars
        Its `vertices` are those that move.
    xy_out : (n_vertices, 2)
        Overwritten in the rows of these vertices.
    moves
        Overwritten.
    """
    vertices = stars.vertices
    ring_offsets, ring_vertices = rings
    lengths, shares = moves.lengths, moves.shares
    for i in prange(vertices.size):
        v = vertices[i]
        dx, dy, shortest = step_to_ring(xy, ring_offsets, ring_vertices, v)
        xy_out[v, 0] = xy[v, 0] + dx
        xy_out[v, 1] = xy[v, 1] + dy
        lengths[i] = math.sqrt(dx * dx + dy * dy)
        shares[i] = share(lengths[i], shortest)


@parallel_kernel()
def smart_laplacian_sweep(
    xy: FloatArray,
    rings: Rings,
    stars: Stars,
    colours: tuple[int, int],
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex towards the mean of its ring as far as its guards allow, in place.

    Parameters
    ----------
    rings
        The edge neighbours of each vertex.
    xy, stars, colours, good, moves
        As in `star.star_sweep`.
    """
    colour_offsets, vertices, offsets, corners, _, _ = stars
    ring_offsets, ring_vertices = rings
    lengths, shares = moves.lengths, moves.shares
    no_lines = np.empty((0, 3))
    for colour in range(colours[0], colours[1]):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                v = centre_of(vertices, offsets, i)
                wanted = step_to_ring(xy, ring_offsets, ring_vertices, v.v)
                guarded_move(xy, corners, v, wanted, good, no_lines, NO_FENCE, lengths, shares)
