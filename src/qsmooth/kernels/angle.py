"""Angle-based smoothing: every edge at a vertex turns to the bisector at its other end."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, inlined_helper, parallel_kernel
from qsmooth.kernels.geometry import distance, share
from qsmooth.kernels.guards import NO_FENCE, centre_of, guarded_move
from qsmooth.kernels.stars import CHUNK, NO_VERTEX, Centre, Moves, Stars, Step


@helper()
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
    length = math.sqrt(vx * vx + vy * vy)
    side = math.sqrt(ux * ux + uy * uy)
    if length == 0.0 or side == 0.0 or (wx == 0.0 and wy == 0.0):
        return 0.0, 0.0, False
    half = 0.5 * math.atan2(ux * wy - uy * wx, ux * wx + uy * wy)
    if half < 0.0:  # a reflex angle
        half += math.pi
    along, across = length / side * math.cos(half), length / side * math.sin(half)
    return along * ux - across * uy, along * uy + across * ux, True


@inlined_helper()
def step_to_bisectors(xy: FloatArray, corners: TableArray, centre: Centre, step: float) -> Step:
    """Step towards the mean of the places that the edges of a vertex turn it to.

    Parameters
    ----------
    step
        Fraction of the way to the mean.

    Returns
    -------
    step
        Zero where no edge has a bisector to turn to.
    """
    first, last = centre.first, centre.last
    x, y = xy[centre.v, 0], xy[centre.v, 1]
    sx, sy, count, shortest = 0.0, 0.0, 0, np.inf
    for row in range(first, last):
        p = corners[row, 0]
        px, py = xy[p, 0], xy[p, 1]
        shortest = min(shortest, distance(x, y, px, py))
        # The star polygon runs on from p in this cell, and comes to p in the one on its other side.
        after = corners[row, 1] if corners[row, 1] != NO_VERTEX else corners[row, 2]
        before = NO_VERTEX
        for other in range(first, last):
            if corners[other, 2] == p:
                before = corners[other, 1] if corners[other, 1] != NO_VERTEX else corners[other, 0]
        if before == NO_VERTEX:
            continue
        new_x, new_y, found = onto_bisector(
            x - px, y - py, xy[after, 0] - px, xy[after, 1] - py,
            xy[before, 0] - px, xy[before, 1] - py,
        )  # fmt: skip
        if found:
            sx += (px - x) + new_x
            sy += (py - y) + new_y
            count += 1
    if count == 0:
        return Step(0.0, 0.0, shortest)
    return Step(step * (sx / count), step * (sy / count), shortest)


@parallel_kernel()
def angle_sweep(
    xy: FloatArray, stars: Stars, step: float, xy_out: FloatArray, moves: Moves
) -> None:
    """Move each vertex to the mean of its bisectors, all at once and unguarded, as published.

    Parameters
    ----------
    step
        Fraction of the way to the mean, in (0, 1]; 1 as published.
    xy, stars, xy_out, moves
        As in `laplacian.laplacian_sweep`.

    Notes
    -----
    T. Zhou and K. Shimada, "An angle-based approach to two-dimensional mesh smoothing",
    Proceedings of the 9th International Meshing Roundtable (2000).
    """
    _, vertices, offsets, corners, _, _ = stars
    lengths, shares = moves.lengths, moves.shares
    for i in prange(vertices.size):
        v = vertices[i]
        dx, dy, shortest = step_to_bisectors(xy, corners, centre_of(vertices, offsets, i), step)
        xy_out[v, 0] = xy[v, 0] + dx
        xy_out[v, 1] = xy[v, 1] + dy
        lengths[i] = math.sqrt(dx * dx + dy * dy)
        shares[i] = share(lengths[i], shortest)


@parallel_kernel()
def guarded_angle_sweep(
    xy: FloatArray,
    stars: Stars,
    colours: tuple[int, int],
    step: float,
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex towards the mean of its bisectors as far as its guards allow, in place.

    Parameters
    ----------
    step
        As in `angle_sweep`.
    xy, stars, colours, good, moves
        As in `star.star_sweep`.
    """
    colour_offsets, vertices, offsets, corners, _, _ = stars
    lengths, shares = moves.lengths, moves.shares
    no_lines = np.empty((0, 3))
    for colour in range(colours[0], colours[1]):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                v = centre_of(vertices, offsets, i)
                wanted = step_to_bisectors(xy, corners, v, step)
                guarded_move(xy, corners, v, wanted, good, no_lines, NO_FENCE, lengths, shares)
