"""Laplacian smoothing: plain, the baseline that everybody knows, and guarded."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, inlined_helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, block_at
from qsmooth.kernels.geometry import distance, share
from qsmooth.kernels.guard_rows import N_GUARD_ROWS, SHORTEST
from qsmooth.kernels.guards import guarded_moves
from qsmooth.kernels.lanes import ROW, ROW2, ROW4, ROW6, SX, SY, X, Y, gather_stars, smaller
from qsmooth.kernels.lone_guards import Guard
from qsmooth.kernels.stars import Moves, Rings, Stars, Step


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


@helper()
def steps_to_means(star: FloatArray, s: FloatArray, block: Block) -> None:
    """Fill rows SX, SY and SHORTEST of a block: the steps to the means of the edge neighbours.

    Each edge neighbour of a vertex inside the mesh is the next corner of one of its cells.
    """
    n, quads, count = block.size, block.n_quads, block.n_quads + block.n_triangles
    for i in range(n):
        s[SX + i], s[SY + i], s[SHORTEST + i] = 0.0, 0.0, np.inf
    for k in range(count):
        at = k * ROW6 if k < quads else quads * ROW2 + k * ROW4
        for i in range(n):
            dx, dy = star[at + i] - s[X + i], star[at + ROW + i] - s[Y + i]
            s[SX + i] += dx
            s[SY + i] += dy
            s[SHORTEST + i] = smaller(dx * dx + dy * dy, s[SHORTEST + i])
    for i in range(n):
        s[SX + i] /= count
        s[SY + i] /= count
        s[SHORTEST + i] = np.sqrt(s[SHORTEST + i])


@parallel_kernel()
def smart_laplacian_sweep(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex towards the mean of its ring as far as its guards allow, in place.

    Parameters
    ----------
    xy, blocks, colours, good, moves
        As in `star.star_sweep`.
    """
    colour_blocks, table, vertices, stars, _, largest = blocks
    lengths, shares = moves.lengths, moves.shares
    guard = Guard(good, False, False)
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
            block = block_at(table, b)
            gather_stars(xy, vertices, stars, block, star, s)
            steps_to_means(star, s, block)
            guarded_moves(xy, vertices, block, guard, star, s, s, lengths, shares)
