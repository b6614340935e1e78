"""Laplacian smoothing: plain, the baseline that everybody knows, and guarded."""

import math
from typing import Any

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import inlined_helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, lane_row
from qsmooth.kernels.geometry import distance
from qsmooth.kernels.guards import NO_FENCE, centre_of, guarded_move
from qsmooth.kernels.ring_blocks import FIRST, N_NEIGHBOURS, SIZE, START, RingBlocks
from qsmooth.kernels.stars import CHUNK, Moves, Rings, Stars, Step

# The grain of the parallel loop over blocks of rings.
BLOCKS_A_CHUNK = 16
# Rows of lanes: where a vertex is, the sum of the ways to its neighbours, the shortest squared.
X, Y, DX, DY, SHORTEST = (lane_row(k) for k in range(5))
N_ROWS = 5
ONE: Any = np.uint64(1)


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
def laplacian_sweep(xy: FloatArray, blocks: RingBlocks, xy_out: FloatArray, moves: Moves) -> None:
    """Put each vertex at the mean of its ring, all at once and unguarded.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit.
    blocks
        The vertices that move, and their edge neighbours.
    xy_out : (n_vertices, 2)
        Overwritten in the rows of these vertices.
    moves
        Overwritten, in the order of the blocks' vertices.
    """
    table, vertices, neighbours = blocks
    lengths, shares = moves.lengths, moves.shares
    for chunk in prange((table.shape[0] + BLOCKS_A_CHUNK - 1) // BLOCKS_A_CHUNK):
        s = np.empty(N_ROWS * LANES)
        start = chunk * BLOCKS_A_CHUNK
        for block in range(start, min(start + BLOCKS_A_CHUNK, table.shape[0])):
            first, n = table[block, FIRST], table[block, SIZE]
            n_neighbours = table[block, N_NEIGHBOURS]
            k = table[block, START]
            for i in range(n):
                v = vertices[first + i]
                x, y = xy[v, 0], xy[v, 1]
                dx, dy, shortest = 0.0, 0.0, np.inf
                for _ in range(n_neighbours):
                    w = neighbours[k]
                    ex, ey = xy[w, 0] - x, xy[w, 1] - y
                    dx += ex
                    dy += ey
                    shortest = min(shortest, ex * ex + ey * ey)
                    k += ONE
                s[X + i], s[Y + i], s[DX + i], s[DY + i], s[SHORTEST + i] = x, y, dx, dy, shortest
            for i in range(n):
                dx, dy = s[DX + i] / n_neighbours, s[DY + i] / n_neighbours
                length, shortest = math.sqrt(dx * dx + dy * dy), math.sqrt(s[SHORTEST + i])
                s[X + i] += dx
                s[Y + i] += dy
                lengths[first + i] = length
                part = length / shortest if shortest > 0.0 else np.inf
                shares[first + i] = part if length > 0.0 else 0.0
            for i in range(n):
                v = vertices[first + i]
                xy_out[v, 0], xy_out[v, 1] = s[X + i], s[Y + i]


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
