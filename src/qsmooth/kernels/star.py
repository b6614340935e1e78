"""Smoothing by star: vertex by vertex, in place, colour by colour."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.guards import NO_FENCE, centre_of, guarded_move
from qsmooth.kernels.proposals import mean_proposal
from qsmooth.kernels.stars import CHUNK, Moves, Stars


@parallel_kernel()
def star_sweep(
    xy: FloatArray,
    stars: Stars,
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
    stars
        The movable vertices and the cells around them.
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
        Overwritten for the vertices of these colours.
    """
    colour_offsets, vertices, offsets, corners, cells, largest = stars
    lengths, shares = moves.lengths, moves.shares
    for colour in range(colours[0], colours[1]):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            lines = np.empty((3 * largest, 3))
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                v = centre_of(vertices, offsets, i)
                # The mean of places that each keep the clearance keeps it too.
                wanted = mean_proposal(xy, corners, cells, v, pace, thresholds, step, False, lines)
                guarded_move(xy, corners, v, wanted, good, lines, NO_FENCE, lengths, shares)
