"""Smoothing by star: vertex by vertex, in place, colour by colour."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.blocks import LANES, Blocks, block_at
from qsmooth.kernels.clearance import guard_lines
from qsmooth.kernels.guard_rows import N_GUARD_ROWS, ROWS_OF_LINES
from qsmooth.kernels.guards import guarded_moves
from qsmooth.kernels.lanes import gather_stars
from qsmooth.kernels.lone_guards import Guard
from qsmooth.kernels.proposals import mean_proposals
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import Moves


@parallel_kernel()
def star_sweep(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    pace: FloatArray,
    thresholds: FloatArray,
    step: float,
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex once by what the cells of its star propose.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit. Moved in place.
    blocks
        The movable vertices and the cells around them (`blocks.build_blocks`).
    colours
        First colour to move, and the one to stop before; (0, n_colours) moves every vertex.
    pace : (n_cells,)
        Multiple of `step` at which each cell proposes; 0 for a cell that proposes nothing.
    thresholds : (2, 4)
        Angle thresholds as `proposals.thresholds` tabulates them.
    step
        Fraction of each move that is proposed, in (0, 1].
    good
        Scaled Jacobian of the ``"quality"`` guard; NaN for the ``"clearance"`` guard.
    moves
        Overwritten for the vertices of these colours, in the order of the blocks.
    """
    colour_blocks, table, vertices, stars, cells, largest, own = blocks
    rails = Rails(*own)
    lengths, shares = moves.lengths, moves.shares
    # The mean of places that each keep the clearance keeps it too.
    guard = Guard(good, False, False)
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
            lines = np.empty(ROWS_OF_LINES * largest * LANES)
            block = block_at(table, b)
            gather_stars(xy, vertices, stars, block, star, s)
            guard_lines(star, s, block, lines)
            mean_proposals(star, s, lines, block, cells, pace, thresholds, step, False)
            guarded_moves(xy, vertices, block, guard, star, s, lines, rails, lengths, shares)
