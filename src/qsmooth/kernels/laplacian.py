"""Laplacian smoothing: plain, the baseline that everybody knows, and guarded."""

import math
from typing import Any

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, block_at, lane_row
from qsmooth.kernels.confining import confine, confined
from qsmooth.kernels.guard_rows import N_GUARD_ROWS, SHORTEST
from qsmooth.kernels.guards import guarded_moves
from qsmooth.kernels.lanes import ROW, ROW2, ROW4, ROW6, SX, SY, X, Y, gather_stars, smaller
from qsmooth.kernels.lone_guards import Guard
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.ring_blocks import FIRST, N_NEIGHBOURS, SIZE, START, RingBlocks
from qsmooth.kernels.stars import Moves

# The grain of the parallel loop over blocks of rings.
BLOCKS_A_CHUNK = 16
# Rows of lanes of a plain sweep: where a vertex is, the sum of the ways to its neighbours, the
# shortest of them squared.
AT_X, AT_Y, DX, DY, NEAREST = (lane_row(k) for k in range(5))
N_ROWS = 5
ONE: Any = np.uint64(1)


@helper()
def _confine_means(
    xy: FloatArray,
    vertices: TableArray,
    first: int,
    n: int,
    s: FloatArray,
    rails: Rails,
    lengths: FloatArray,
    shares: FloatArray,
) -> None:
    """Put the means in AT_X and AT_Y where the vertices may be, and measure these moves."""
    for i in range(n):
        v = vertices[first + i]
        x, y = confine(v, s[AT_X + i], s[AT_Y + i], rails)
        s[AT_X + i], s[AT_Y + i] = x, y
        dx, dy = x - xy[v, 0], y - xy[v, 1]
        length, shortest = math.sqrt(dx * dx + dy * dy), math.sqrt(s[NEAREST + i])
        lengths[first + i] = length
        part = length / shortest if shortest > 0.0 else np.inf
        shares[first + i] = part if length > 0.0 else 0.0


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
    table, vertices, neighbours, own = blocks
    rails = Rails(*own)
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
                s[AT_X + i], s[AT_Y + i], s[NEAREST + i] = x, y, shortest
                s[DX + i], s[DY + i] = dx, dy
            for i in range(n):
                dx, dy = s[DX + i] / n_neighbours, s[DY + i] / n_neighbours
                length, shortest = math.sqrt(dx * dx + dy * dy), math.sqrt(s[NEAREST + i])
                s[AT_X + i] += dx
                s[AT_Y + i] += dy
                lengths[first + i] = length
                part = length / shortest if shortest > 0.0 else np.inf
                shares[first + i] = part if length > 0.0 else 0.0
            if confined(rails):
                _confine_means(xy, vertices, first, n, s, rails, lengths, shares)
            for i in range(n):
                v = vertices[first + i]
                xy_out[v, 0], xy_out[v, 1] = s[AT_X + i], s[AT_Y + i]


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
    colour_blocks, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    lengths, shares = moves.lengths, moves.shares
    guard = Guard(good, False, False)
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
            block = block_at(table, b)
            gather_stars(xy, vertices, stars, block, star, s)
            steps_to_means(star, s, block)
            guarded_moves(xy, vertices, block, guard, star, s, s, rails, lengths, shares)
