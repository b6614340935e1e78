"""Laplacian smoothing with area weights: to the centroid of the star polygon."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, block_at
from qsmooth.kernels.guard_rows import N_GUARD_ROWS, SHORTEST, SUM_X, SUM_Y, WEIGHT
from qsmooth.kernels.guards import guarded_moves, unguarded_moves
from qsmooth.kernels.lanes import (
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
    ROW6,
    SX,
    SY,
    X,
    Y,
    gather_stars,
    smaller,
)
from qsmooth.kernels.lone_guards import Guard
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import Moves


@helper()
def _add_quad(star: FloatArray, s: FloatArray, at: int, n: int) -> None:
    """Add three times the centroid of a quad, weighted by twice its area."""
    for i in range(n):
        x, y = s[X + i], s[Y + i]
        ax, ay, bx, by = star[at + i], star[at + ROW + i], star[at + ROW2 + i], star[at + ROW3 + i]
        cx, cy = star[at + ROW4 + i] - x, star[at + ROW5 + i] - y
        ax, ay, bx, by = ax - x, ay - y, bx - x, by - y
        area, other = ax * by - ay * bx, bx * cy - by * cx
        s[SUM_X + i] += area * (ax + bx) + other * (bx + cx)
        s[SUM_Y + i] += area * (ay + by) + other * (by + cy)
        s[WEIGHT + i] += area + other
        s[SHORTEST + i] = smaller(ax * ax + ay * ay, s[SHORTEST + i])


@helper()
def _add_triangle(star: FloatArray, s: FloatArray, at: int, n: int) -> None:
    """Add three times the centroid of a triangle, weighted by twice its area."""
    for i in range(n):
        ax, ay = star[at + i] - s[X + i], star[at + ROW + i] - s[Y + i]
        cx, cy = star[at + ROW2 + i] - s[X + i], star[at + ROW3 + i] - s[Y + i]
        area = ax * cy - ay * cx
        s[SUM_X + i] += area * (ax + cx)
        s[SUM_Y + i] += area * (ay + cy)
        s[WEIGHT + i] += area
        s[SHORTEST + i] = smaller(ax * ax + ay * ay, s[SHORTEST + i])


@helper()
def steps_to_centroids(star: FloatArray, s: FloatArray, block: Block) -> None:
    """Fill rows SX, SY and SHORTEST of a block: the steps to the centroids of the star polygons.

    Those are the cells' centroids, weighted by area; where there is none, a vertex has no step.
    """
    n, quads = block.size, block.n_quads
    for i in range(n):
        s[SUM_X + i], s[SUM_Y + i], s[WEIGHT + i], s[SHORTEST + i] = 0.0, 0.0, 0.0, np.inf
    for k in range(quads):
        _add_quad(star, s, k * ROW6, n)
    for k in range(block.n_triangles):
        _add_triangle(star, s, quads * ROW6 + k * ROW4, n)
    for i in range(n):
        found = s[WEIGHT + i] > 0.0
        total = 3.0 * s[WEIGHT + i]
        x, y = s[SUM_X + i] / total, s[SUM_Y + i] / total
        s[SX + i], s[SY + i] = x if found else 0.0, y if found else 0.0
        s[SHORTEST + i] = np.sqrt(s[SHORTEST + i])


@parallel_kernel()
def centroid_sweep(xy: FloatArray, blocks: Blocks, xy_out: FloatArray, moves: Moves) -> None:
    """Put each vertex at the centroid of its star polygon, all at once and unguarded.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit.
    blocks
        The movable vertices and the cells around them (`blocks.build_blocks`).
    xy_out : (n_vertices, 2)
        Overwritten in the rows of these vertices.
    moves
        Overwritten, in the order of the blocks.
    """
    _, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    lengths, shares = moves.lengths, moves.shares
    for b in prange(table.shape[0]):
        s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
        block = block_at(table, b)
        gather_stars(xy, vertices, stars, block, star, s)
        steps_to_centroids(star, s, block)
        unguarded_moves(xy_out, vertices, block, s, rails, lengths, shares)


@parallel_kernel()
def smart_centroid_sweep(
    xy: FloatArray, blocks: Blocks, colours: tuple[int, int], good: float, moves: Moves
) -> None:
    """Move each vertex towards its star polygon's centroid as far as its guards allow, in place.

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
            steps_to_centroids(star, s, block)
            guarded_moves(xy, vertices, block, guard, star, s, s, rails, lengths, shares)
