"""Smoothing by quad: all cells propose at once, then the vertices follow, colour by colour."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.guards import (
    Fence,
    centre_of,
    clearance,
    guard_lines,
    guarded_move,
    tolerated_loss,
)
from qsmooth.kernels.proposals import mean_proposal
from qsmooth.kernels.stars import CHUNK, Moves, Stars, Step


@parallel_kernel()
def quad_proposals(
    xy: FloatArray,
    stars: Stars,
    pace: FloatArray,
    thresholds: FloatArray,
    step: float,
    wanted: FloatArray,
) -> None:
    """Average, for each vertex, the accepted proposals of its cells' corners.

    Parameters
    ----------
    xy, stars, pace, thresholds, step
        As in `star.star_sweep`; nothing moves here.
    wanted : (n_movable, 2)
        Overwritten. Displacement of each vertex.
    """
    _, vertices, offsets, corners, cells, largest = stars
    for chunk in prange((vertices.size + CHUNK - 1) // CHUNK):
        lines = np.empty((3 * largest, 3))
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, vertices.size)):
            v = centre_of(vertices, offsets, i)
            mean = mean_proposal(xy, corners, cells, v, pace, thresholds, step, True, lines)
            wanted[i, 0], wanted[i, 1] = mean.dx, mean.dy


@parallel_kernel()
def guarded_commit(
    xy: FloatArray,
    stars: Stars,
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
        Displacement of each vertex.
    xy, stars, colours, good, moves
        As in `star.star_sweep`.
    """
    colour_offsets, vertices, offsets, corners, _, largest = stars
    lengths, shares = moves.lengths, moves.shares
    for colour in range(colours[0], colours[1]):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            lines = np.empty((3 * largest, 3))
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                lengths[i], shares[i] = 0.0, 0.0
                dx, dy = wanted[i, 0], wanted[i, 1]
                if dx == 0.0 and dy == 0.0:
                    continue
                v = centre_of(vertices, offsets, i)
                n_lines, longest, shortest, furthest = guard_lines(xy, corners, v, lines)
                least = clearance(lines, n_lines) - tolerated_loss(longest, furthest)
                step, fence = Step(dx, dy, shortest), Fence(n_lines, least)
                guarded_move(xy, corners, v, step, good, lines, fence, lengths, shares)
