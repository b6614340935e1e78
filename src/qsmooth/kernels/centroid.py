"""Laplacian smoothing with area weights: to the centroid of the star polygon."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import inlined_helper, parallel_kernel
from qsmooth.kernels.geometry import share
from qsmooth.kernels.guards import NO_FENCE, centre_of, guarded_move
from qsmooth.kernels.stars import CHUNK, NO_VERTEX, Centre, Moves, Stars, Step


@inlined_helper()
def step_to_centroid(xy: FloatArray, corners: TableArray, centre: Centre) -> Step:
    """Step to the centroid of the polygon round a star: the cells' centroids, weighted by area.

    Returns
    -------
    step
        Zero where the polygon has no positive area.
    """
    x, y = xy[centre.v, 0], xy[centre.v, 1]
    sx, sy, total, shortest = 0.0, 0.0, 0.0, np.inf
    for row in range(centre.first, centre.last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        ax, ay = xy[a, 0] - x, xy[a, 1] - y
        cx, cy = xy[c, 0] - x, xy[c, 1] - y
        shortest = min(shortest, math.sqrt(ax * ax + ay * ay))
        if b == NO_VERTEX:
            area = ax * cy - ay * cx
            sx += area * (ax + cx)
            sy += area * (ay + cy)
            total += area
            continue
        bx, by = xy[b, 0] - x, xy[b, 1] - y
        area = ax * by - ay * bx
        other = bx * cy - by * cx
        sx += area * (ax + bx) + other * (bx + cx)
        sy += area * (ay + by) + other * (by + cy)
        total += area + other
    if not total > 0.0:
        return Step(0.0, 0.0, shortest)
    return Step(sx / (3.0 * total), sy / (3.0 * total), shortest)


@parallel_kernel()
def centroid_sweep(xy: FloatArray, stars: Stars, xy_out: FloatArray, moves: Moves) -> None:
    """Put each vertex at the centroid of its star polygon, all at once and unguarded.

    Parameters
    ----------
    xy, stars, xy_out, moves
        As in `laplacian.laplacian_sweep`.
    """
    _, vertices, offsets, corners, _, _ = stars
    lengths, shares = moves.lengths, moves.shares
    for i in prange(vertices.size):
        v = vertices[i]
        dx, dy, shortest = step_to_centroid(xy, corners, centre_of(vertices, offsets, i))
        xy_out[v, 0] = xy[v, 0] + dx
        xy_out[v, 1] = xy[v, 1] + dy
        lengths[i] = math.sqrt(dx * dx + dy * dy)
        shares[i] = share(lengths[i], shortest)


@parallel_kernel()
def smart_centroid_sweep(
    xy: FloatArray, stars: Stars, colours: tuple[int, int], good: float, moves: Moves
) -> None:
    """Move each vertex towards its star polygon's centroid as far as its guards allow, in place.

    Parameters
    ----------
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
                wanted = step_to_centroid(xy, corners, v)
                guarded_move(xy, corners, v, wanted, good, no_lines, NO_FENCE, lengths, shares)
