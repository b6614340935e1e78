"""Confining: the allowed place nearest to a proposed one.

Whatever proposes a place for a vertex puts it through `confine` before the place is certified, so
that none that is stored is anywhere but where the vertex may be.
"""

import math

from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, inlined_helper, parallel_kernel, strict_helper
from qsmooth.kernels.rails import Rails

# A place is within reach if the square of its distance falls short of that of the reach by this
# share: more than the rounding of differences, squares, sum and root together, in any formula.
ROUNDING = 2.0**-48
# As near to the end of its reach, as a share of it, a vertex is at the end.
AT_END = 1e-8


@inlined_helper()
def confined(rails: Rails) -> bool:
    """Whether there is any vertex that may not be just anywhere."""
    return bool(rails.origin.shape[0] > 0)


@strict_helper()
def within_reach(dx: float, dy: float, reach: float) -> bool:
    """Whether (dx, dy) is no longer than the reach, in any rounding."""
    return bool(dx * dx + dy * dy <= reach * reach * (1.0 - ROUNDING))


@strict_helper()
def confine(v: int, x: float, y: float, rails: Rails) -> tuple[float, float]:
    """Find the allowed place of vertex v nearest to (x, y).

    Returns
    -------
    x, y
        On the line, up to the rounding of the coordinates, and within reach, as these numbers are
        stored. Where the vertex was if there is no such number, or if (x, y) is not finite.
    """
    origin_x, origin_y = rails.origin[v, 0], rails.origin[v, 1]
    direction_x, direction_y, reach = rails.direction[v, 0], rails.direction[v, 1], rails.reach[v]
    dx, dy = x - origin_x, y - origin_y
    if direction_x == direction_x:
        along = dx * direction_x + dy * direction_y
        dx, dy = along * direction_x, along * direction_y
        x, y = origin_x + dx, origin_y + dy
    if within_reach(x - origin_x, y - origin_y, reach):
        return x, y
    share, less = reach / math.sqrt(dx * dx + dy * dy), ROUNDING
    while less < 1.0:
        share *= 1.0 - less
        x, y = origin_x + share * dx, origin_y + share * dy
        if within_reach(x - origin_x, y - origin_y, reach):
            return x, y
        less *= 2.0
    return origin_x, origin_y


@helper()
def tangent(
    v: int, x: float, y: float, gx: float, gy: float, rails: Rails
) -> tuple[float, float, float]:
    """Find the line along which vertex v can move downhill from (x, y), where only one is left.

    Parameters
    ----------
    gx, gy
        Gradient of what is to fall.

    Returns
    -------
    tx, ty
        Unit vector; both 0 where the vertex may go to all sides that lead downhill.
    bend
        What the rail's curvature adds to the second derivative along it.
    """
    if rails.direction[v, 0] == rails.direction[v, 0]:
        return rails.direction[v, 0], rails.direction[v, 1], 0.0
    dx, dy, reach = x - rails.origin[v, 0], y - rails.origin[v, 1], rails.reach[v]
    distance = math.sqrt(dx * dx + dy * dy)
    outwards = -(gx * dx + gy * dy)
    if outwards > 0.0 and distance >= (1.0 - AT_END) * reach:
        inv = 1.0 / distance
        return -dy * inv, dx * inv, outwards * inv * inv
    return 0.0, 0.0, 0.0


@parallel_kernel()
def confine_places(xy: FloatArray, vertices: TableArray, rails: Rails) -> None:
    """Put the listed vertices at the allowed places nearest to where they are, in place.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates. Changed in place.
    vertices : (n,)
        Each once.
    rails
        Not empty.
    """
    for i in prange(vertices.size):
        v = vertices[i]
        x, y = confine(v, xy[v, 0], xy[v, 1], rails)
        xy[v, 0], xy[v, 1] = x, y
