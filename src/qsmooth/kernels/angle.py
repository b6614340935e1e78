"""Angle-based smoothing: every edge at a vertex turns to the bisector at its other end."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, kernel, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, block_at
from qsmooth.kernels.guard_rows import (
    FIRST_X,
    FIRST_Y,
    N_GUARD_ROWS,
    SHORTEST,
    SUM_X,
    SUM_Y,
    WEIGHT,
)
from qsmooth.kernels.guards import guarded_moves, unguarded_moves
from qsmooth.kernels.lanes import (
    ROW,
    ROW2,
    ROW3,
    ROW4,
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


@kernel()
def star_polygons(blocks: Blocks) -> TableArray:
    """Find what goes before each edge neighbour in the polygon round its vertex.

    Returns
    -------
    before : (n_rows,)
        In the order of `Blocks.cells`: for the next corner a of each cell, the vertex before a in
        the cell on the other side of the edge to a; a itself where there is none.
    """
    table, stars = blocks.table, blocks.stars
    before = np.empty(blocks.cells.size, np.uint32)
    n_vertices = np.int64(0)
    for v in stars:
        n_vertices = max(n_vertices, np.int64(v) + 1)
    # Of each corner of the star at hand what goes before it in the cell whose last corner it is.
    previous = np.empty(n_vertices, np.uint32)
    for b in range(table.shape[0]):
        block = block_at(table, b)
        n, quads = block.size, block.n_quads
        for lane in range(n):
            star = block.start + lane
            for k in range(quads + block.n_triangles):
                first = stars[star + (3 * k if k < quads else quads + 2 * k) * n]
                previous[first] = first
            for k in range(quads + block.n_triangles):
                last = star + (3 * k + 2 if k < quads else quads + 2 * k + 1) * n
                previous[stars[last]] = stars[last - n]
            for k in range(quads + block.n_triangles):
                first = stars[star + (3 * k if k < quads else quads + 2 * k) * n]
                before[block.rows + k * n + lane] = previous[first]
    return before


@lane_helper()
def onto_bisector(
    vx: float, vy: float, ux: float, uy: float, wx: float, wy: float
) -> tuple[float, float, bool]:
    """Turn v about the origin onto the bisector of the angle from u, counter-clockwise, to w.

    Returns
    -------
    x, y
        The new place, as far from the origin as v.
    found
        False where there is no such angle: u, v or w is at the origin.
    """
    vv, uu, ww = vx * vx + vy * vy, ux * ux + uy * uy, wx * wx + wy * wy
    inv = 1.0 / np.sqrt(uu * ww)
    cosine, sine = (ux * wx + uy * wy) * inv, (ux * wy - uy * wx) * inv
    # A vector at half the angle, in (0, π]: of the two that there are the one that is not short.
    sharp = cosine > 0.0
    hx = 1.0 + cosine if sharp else sine
    hy = sine if sharp else 1.0 - cosine
    reflex = sharp & (sine < 0.0)
    scale = np.sqrt(vv / (uu * (hx * hx + hy * hy)))
    scale = -scale if reflex else scale
    x, y = (hx * ux - hy * uy) * scale, (hx * uy + hy * ux) * scale
    found = (vv > 0.0) & (uu > 0.0) & (ww > 0.0)
    return x if found else 0.0, y if found else 0.0, found


@helper()
def _gather_before(xy: FloatArray, polygons: TableArray, row: int, n: int, s: FloatArray) -> None:
    for i in range(n):
        w = polygons[row + i]
        s[FIRST_X + i], s[FIRST_Y + i] = xy[w, 0], xy[w, 1]


@helper()
def _add_bisector(star: FloatArray, s: FloatArray, at: int, n: int) -> None:
    """Add the step to which the edge to the next corner of a cell turns each vertex."""
    for i in range(n):
        px, py = star[at + i], star[at + ROW + i]
        dx, dy = px - s[X + i], py - s[Y + i]
        x, y, found = onto_bisector(
            -dx, -dy, star[at + ROW2 + i] - px, star[at + ROW3 + i] - py,
            s[FIRST_X + i] - px, s[FIRST_Y + i] - py,
        )  # fmt: skip
        s[SUM_X + i] += dx + x if found else 0.0
        s[SUM_Y + i] += dy + y if found else 0.0
        s[WEIGHT + i] += 1.0 if found else 0.0
        s[SHORTEST + i] = smaller(dx * dx + dy * dy, s[SHORTEST + i])


@helper()
def steps_to_bisectors(
    xy: FloatArray,
    star: FloatArray,
    s: FloatArray,
    block: Block,
    polygons: TableArray,
    step: float,
) -> None:
    """Fill rows SX, SY and SHORTEST of a block: to the means of where its edges turn each vertex.

    Parameters
    ----------
    polygons
        As `star_polygons` finds them.
    step
        Fraction of the way to the mean; a vertex whose edges have no bisector has no step.
    """
    n, quads = block.size, block.n_quads
    for i in range(n):
        s[SUM_X + i], s[SUM_Y + i], s[WEIGHT + i], s[SHORTEST + i] = 0.0, 0.0, 0.0, np.inf
    for k in range(quads + block.n_triangles):
        _gather_before(xy, polygons, block.rows + k * n, n, s)
        _add_bisector(star, s, k * ROW6 if k < quads else quads * ROW2 + k * ROW4, n)
    for i in range(n):
        found = s[WEIGHT + i] > 0.0
        x, y = s[SUM_X + i] / s[WEIGHT + i], s[SUM_Y + i] / s[WEIGHT + i]
        s[SX + i], s[SY + i] = step * x if found else 0.0, step * y if found else 0.0
        s[SHORTEST + i] = np.sqrt(s[SHORTEST + i])


@parallel_kernel()
def angle_sweep(
    xy: FloatArray,
    blocks: Blocks,
    polygons: TableArray,
    step: float,
    xy_out: FloatArray,
    moves: Moves,
) -> None:
    """Move each vertex to the mean of its bisectors, all at once and unguarded, as published.

    Parameters
    ----------
    polygons
        As `star_polygons` finds them.
    step
        Fraction of the way to the mean, in (0, 1]; 1 as published.
    xy, blocks, xy_out, moves
        As in `centroid.centroid_sweep`.

    Notes
    -----
    T. Zhou and K. Shimada, "An angle-based approach to two-dimensional mesh smoothing",
    Proceedings of the 9th International Meshing Roundtable (2000).
    """
    _, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    lengths, shares = moves.lengths, moves.shares
    for b in prange(table.shape[0]):
        s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
        block = block_at(table, b)
        gather_stars(xy, vertices, stars, block, star, s)
        steps_to_bisectors(xy, star, s, block, polygons, step)
        unguarded_moves(xy_out, vertices, block, s, rails, lengths, shares)


@parallel_kernel()
def guarded_angle_sweep(
    xy: FloatArray,
    blocks: Blocks,
    polygons: TableArray,
    colours: tuple[int, int],
    step: float,
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex towards the mean of its bisectors as far as its guards allow, in place.

    Parameters
    ----------
    polygons, step
        As in `angle_sweep`.
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
            steps_to_bisectors(xy, star, s, block, polygons, step)
            guarded_moves(xy, vertices, block, guard, star, s, s, rails, lengths, shares)
