"""Laplacian smoothing with area weights: to the centroid of the star polygon."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.guards import allowed_step
from qsmooth.kernels.star import CHUNK
from qsmooth.kernels.topology import NO_VERTEX


@helper()
def star_centroid(
    xy: FloatArray, v: int, corners: TableArray, first: int, last: int
) -> tuple[float, float, float]:
    """Find the centroid of the polygon round v's star: the cells' centroids, weighted by area.

    Returns
    -------
    dx, dy
        From v to the centroid; zero where the polygon has no positive area.
    shortest
        Shortest edge of v.
    """
    x, y = xy[v, 0], xy[v, 1]
    sx, sy, total, shortest = 0.0, 0.0, 0.0, np.inf
    for row in range(first, last):
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
        return 0.0, 0.0, shortest
    return sx / (3.0 * total), sy / (3.0 * total), shortest


@parallel_kernel()
def centroid_sweep(
    xy: FloatArray,
    vertices: TableArray,
    offsets: IndexArray,
    corners: TableArray,
    xy_out: FloatArray,
    moves: FloatArray,
    shares: FloatArray,
) -> None:
    """Put each vertex at the centroid of its star polygon, all at once and unguarded.

    Parameters
    ----------
    vertices, offsets, corners
        As in `star.star_sweep`.
    xy, xy_out, moves, shares
        As in `laplacian.laplacian_sweep`.
    """
    for i in prange(vertices.size):
        v = vertices[i]
        dx, dy, shortest = star_centroid(xy, v, corners, offsets[i], offsets[i + 1])
        xy_out[v, 0] = xy[v, 0] + dx
        xy_out[v, 1] = xy[v, 1] + dy
        moves[i] = math.sqrt(dx * dx + dy * dy)
        shares[i] = moves[i] / shortest if moves[i] > 0.0 else 0.0


@parallel_kernel()
def smart_centroid_sweep(
    xy: FloatArray,
    colour_offsets: IndexArray,
    vertices: TableArray,
    offsets: IndexArray,
    corners: TableArray,
    good: float,
    moves: FloatArray,
    shares: FloatArray,
) -> None:
    """Move each vertex towards its star polygon's centroid as far as its guards allow, in place.

    Parameters
    ----------
    xy, colour_offsets, vertices, offsets, corners, good, moves, shares
        As in `star.star_sweep`.
    """
    no_lines = np.empty((0, 3))
    for colour in range(colour_offsets.size - 1):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                v = vertices[i]
                x, y = xy[v, 0], xy[v, 1]
                first, last = offsets[i], offsets[i + 1]
                dx, dy, shortest = star_centroid(xy, v, corners, first, last)
                new_x, new_y = allowed_step(
                    xy, v, corners, first, last, dx, dy, good, no_lines, 0, 0.0
                )
                xy[v, 0], xy[v, 1] = new_x, new_y
                moves[i] = math.sqrt((new_x - x) * (new_x - x) + (new_y - y) * (new_y - y))
                shares[i] = moves[i] / shortest if moves[i] > 0.0 else 0.0
