"""Confining: the allowed place nearest to a proposed one.

Whatever proposes a place for a vertex puts it through `confine` before the place is certified, so
that none that is stored is anywhere but where the vertex may be.
"""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, SingleArray, TableArray
from qsmooth.kernels._jit import helper, inlined_helper, kernel, parallel_kernel, strict_helper
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
        stored; where the vertex was if there are no such numbers. What is not finite is only put
        back where there is a reach.
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


@kernel()
def project_system(
    xy: FloatArray,
    vertices: IndexArray,
    offsets: IndexArray,
    columns: TableArray,
    rails: Rails,
    unit: float,
    gradient: FloatArray,
    values: FloatArray | SingleArray,
    tangents: FloatArray,
) -> None:
    """Leave a linear system only what the vertices may still do, each along its tangent.

    Blocks stay as many: across its tangent a vertex has an equation of its own, with the solution
    zero.

    Parameters
    ----------
    vertices : (n_unknown,)
        The vertex of each row.
    offsets, columns
        As in `shape_hessian.block_pattern`.
    unit
        What coordinates are divided by in the system.
    gradient, values : (n_unknown, 2), (n_blocks, 2, 2)
        As `shape_hessian.assemble` leaves them. Changed in place.
    tangents : (n_unknown, 2)
        Overwritten: as `tangent` finds them, 0 where a vertex is free.
    """
    bends = np.empty(vertices.size)
    for i in range(vertices.size):
        v, gx, gy = vertices[i], gradient[i, 0], gradient[i, 1]
        tx, ty, bends[i] = tangent(v, xy[v, 0], xy[v, 1], gx, gy, rails)
        tangents[i, 0], tangents[i, 1] = tx, ty
        if tx != 0.0 or ty != 0.0:
            slope = gx * tx + gy * ty
            gradient[i, 0], gradient[i, 1] = slope * tx, slope * ty
    for row in range(vertices.size):
        tx, ty = tangents[row, 0], tangents[row, 1]
        on_rail = tx != 0.0 or ty != 0.0
        for k in range(offsets[row], offsets[row + 1]):
            column = columns[k]
            b = values[k]
            trace = b[0, 0] + b[1, 1]
            if on_rail:
                along_x, along_y = tx * b[0, 0] + ty * b[1, 0], tx * b[0, 1] + ty * b[1, 1]
                b[0, 0], b[0, 1], b[1, 0], b[1, 1] = (
                    tx * along_x, tx * along_y, ty * along_x, ty * along_y,
                )  # fmt: skip
            sx, sy = tangents[column, 0], tangents[column, 1]
            if sx != 0.0 or sy != 0.0:
                along_x, along_y = b[0, 0] * sx + b[0, 1] * sy, b[1, 0] * sx + b[1, 1] * sy
                b[0, 0], b[0, 1], b[1, 0], b[1, 1] = (
                    along_x * sx, along_x * sy, along_y * sx, along_y * sy,
                )  # fmt: skip
            if on_rail and column == row:
                bend = unit * bends[row]
                b[0, 0] += trace * ty * ty + bend * tx * tx
                b[1, 1] += trace * tx * tx + bend * ty * ty
                b[0, 1] += (bend - trace) * tx * ty
                b[1, 0] += (bend - trace) * tx * ty
