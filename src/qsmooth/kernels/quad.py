"""Smoothing by quad: all cells propose at once, then the vertices follow, colour by colour."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.blocks import LANES, Blocks, block_at
from qsmooth.kernels.clearance import guard_lines
from qsmooth.kernels.guard_rows import N_GUARD_ROWS, ROWS_OF_LINES
from qsmooth.kernels.guards import guarded_moves
from qsmooth.kernels.lanes import SX, SY, gather_stars
from qsmooth.kernels.lone_guards import Guard
from qsmooth.kernels.proposals import mean_proposals
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import Moves


@parallel_kernel()
def quad_proposals(
    xy: FloatArray,
    blocks: Blocks,
    pace: FloatArray,
    thresholds: FloatArray,
    step: float,
    wanted: FloatArray,
) -> None:
    """Average, for each vertex, the accepted proposals of its cells' corners.

    Parameters
    ----------
    xy, blocks, pace, thresholds, step
        As in `star.star_sweep`; nothing moves here.
    wanted : (n_movable, 2)
        Overwritten. Displacement of each vertex, in the order of the blocks.
    """
    _, table, vertices, stars, cells, largest, _ = blocks
    for b in prange(table.shape[0]):
        s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
        lines = np.empty(ROWS_OF_LINES * largest * LANES)
        block = block_at(table, b)
        gather_stars(xy, vertices, stars, block, star, s)
        guard_lines(star, s, block, lines)
        mean_proposals(star, s, lines, block, cells, pace, thresholds, step, True)
        for i in range(block.size):
            wanted[block.first + i, 0] = s[SX + i]
            wanted[block.first + i, 1] = s[SY + i]


@parallel_kernel()
def guarded_commit(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    wanted: FloatArray,
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex by its wanted displacement, or as much of it as its guards allow.

    The neighbours may have moved since the displacement was proposed, so the clearance of the
    vertex's present place among their present places is asked for again.

    Parameters
    ----------
    wanted : (n_movable, 2)
        Displacement of each vertex, in the order of the blocks.
    xy, blocks, colours, good, moves
        As in `star.star_sweep`.
    """
    colour_blocks, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    lengths, shares = moves.lengths, moves.shares
    guard = Guard(good, True, False)
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
            lines = np.empty(ROWS_OF_LINES * largest * LANES)
            block = block_at(table, b)
            gather_stars(xy, vertices, stars, block, star, s)
            guard_lines(star, s, block, lines)
            for i in range(block.size):
                s[SX + i] = wanted[block.first + i, 0]
                s[SY + i] = wanted[block.first + i, 1]
            guarded_moves(xy, vertices, block, guard, star, s, lines, rails, lengths, shares)
