"""What every guarded method asks of a move: clearance, certificate, quality.

The guard lines of a vertex v are, in each cell (v, a, b, c) or (v, a, c) around it, a→c, and in a
quad also a→b and b→c: the corners that v takes part in are convex exactly when v is on the left of
all of them. Its clearance is the smallest signed distance to one. As a minimum of linear functions
it is concave, so that the mean of places that each keep the clearance keeps it too.
"""

import math
from typing import NamedTuple

import numpy as np

from qsmooth._types import FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, inlined_helper, strict_helper
from qsmooth.kernels.geometry import (
    certainly_left,
    orientation,
    quad_scaled_jacobian,
    share,
    triangle_scaled_jacobian,
)
from qsmooth.kernels.stars import NO_VERTEX, Centre, Step

# A clearance may fall by this fraction of the longest edge, or by this many units in the last place
# of the star's largest coordinate: a vertex that slides along its nearest guard line is not to be
# stopped, or let go, by rounding.
CLEARANCE_RTOL = 1e-12
CLEARANCE_ULPS = 16.0
# A step that fails is halved this often before the vertex stays.
HALVINGS = 3

# Columns of a guard line: distance of v from it, and the gradient of that distance.
LINE_DISTANCE, LINE_X, LINE_Y = 0, 1, 2


class Fence(NamedTuple):
    """How many guard lines a step must stay clear of, and how far from each of them."""

    n_lines: int
    least: float


# For a step that is known to keep the clearance, or need not.
NO_FENCE = Fence(0, 0.0)


@inlined_helper()
def centre_of(vertices: TableArray, offsets: IndexArray, i: int) -> Centre:
    """Look up the vertex at position i of `Stars.vertices`."""
    return Centre(i, vertices[i], offsets[i], offsets[i + 1])


@helper()
def _add_line(lines: FloatArray, n: int, px: float, py: float, qx: float, qy: float) -> int:
    """Append the line p→q, given relative to v; a line of no length is left out."""
    ex, ey = qx - px, qy - py
    length = math.sqrt(ex * ex + ey * ey)
    if length == 0.0:
        return n
    lines[n, LINE_DISTANCE] = (px * qy - py * qx) / length
    lines[n, LINE_X] = -ey / length
    lines[n, LINE_Y] = ex / length
    return n + 1


@helper()
def guard_lines(
    xy: FloatArray, corners: TableArray, centre: Centre, lines: FloatArray
) -> tuple[int, float, float, float]:
    """Fill `lines` with the guard lines of a vertex.

    Parameters
    ----------
    lines : (3 * cells in the star, 3)
        Overwritten in its first rows.

    Returns
    -------
    n_lines, longest, shortest, largest
        Longest and shortest of the vertex's edges; largest absolute coordinate of the star.
    """
    v = centre.v
    x, y = xy[v, 0], xy[v, 1]
    n = 0
    longest, shortest = 0.0, np.inf
    largest = max(abs(x), abs(y))
    for row in range(centre.first, centre.last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        largest = max(largest, abs(xy[a, 0]), abs(xy[a, 1]), abs(xy[c, 0]), abs(xy[c, 1]))
        ax, ay = xy[a, 0] - x, xy[a, 1] - y
        cx, cy = xy[c, 0] - x, xy[c, 1] - y
        va, vc = ax * ax + ay * ay, cx * cx + cy * cy
        longest = max(longest, va, vc)
        shortest = min(shortest, va, vc)
        n = _add_line(lines, n, ax, ay, cx, cy)
        if b != NO_VERTEX:
            largest = max(largest, abs(xy[b, 0]), abs(xy[b, 1]))
            bx, by = xy[b, 0] - x, xy[b, 1] - y
            n = _add_line(lines, n, ax, ay, bx, by)
            n = _add_line(lines, n, bx, by, cx, cy)
    return n, math.sqrt(longest), math.sqrt(shortest), largest


@helper()
def tolerated_loss(longest: float, largest: float) -> float:
    """How far a clearance may fall and still count as kept: see `CLEARANCE_RTOL`."""
    ulp = math.ldexp(1.0, math.frexp(largest)[1] - 53)
    return max(CLEARANCE_RTOL * longest, CLEARANCE_ULPS * ulp)


@helper()
def clearance(lines: FloatArray, n_lines: int) -> float:
    """Smallest signed distance from v to its guard lines; infinite where there is none."""
    smallest = np.inf
    for k in range(n_lines):
        smallest = min(smallest, lines[k, LINE_DISTANCE])
    return smallest


@helper()
def keeps_clearance(lines: FloatArray, n_lines: int, dx: float, dy: float, least: float) -> bool:
    """Whether v, moved by (dx, dy), is no nearer than `least` to any guard line."""
    for k in range(n_lines):
        moved = lines[k, LINE_DISTANCE] + (lines[k, LINE_X] * dx + lines[k, LINE_Y] * dy)
        if not moved >= least:
            return False
    return True


@strict_helper()
def _keeps_corner(
    left: bool, ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> bool:
    return left or orientation(ax, ay, bx, by, cx, cy) <= 0


@strict_helper()
def keeps_corners(xy: FloatArray, corners: TableArray, centre: Centre, x: float, y: float) -> bool:
    """Whether every positive corner that v takes part in is certified positive with v at (x, y).

    A corner that is not positive now has nothing to lose.
    """
    v = centre.v
    vx, vy = xy[v, 0], xy[v, 1]
    for row in range(centre.first, centre.last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        ax, ay, cx, cy = xy[a, 0], xy[a, 1], xy[c, 0], xy[c, 1]
        left = certainly_left(x, y, ax, ay, cx, cy)
        if not _keeps_corner(left, vx, vy, ax, ay, cx, cy):
            return False
        if b != NO_VERTEX:
            bx, by = xy[b, 0], xy[b, 1]
            left = certainly_left(ax, ay, bx, by, x, y)
            if not _keeps_corner(left, ax, ay, bx, by, vx, vy):
                return False
            left = certainly_left(bx, by, cx, cy, x, y)
            if not _keeps_corner(left, bx, by, cx, cy, vx, vy):
                return False
    return True


@helper()
def star_scaled_jacobian(
    xy: FloatArray, corners: TableArray, centre: Centre, x: float, y: float
) -> float:
    """Smallest scaled Jacobian of the star's cells with their vertex at (x, y)."""
    worst = np.inf
    for row in range(centre.first, centre.last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        if b != NO_VERTEX:
            score = quad_scaled_jacobian(
                x, y, xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
            )
        else:
            score = triangle_scaled_jacobian(x, y, xy[a, 0], xy[a, 1], xy[c, 0], xy[c, 1])
        worst = min(worst, score)
    return worst


@helper()
def allowed_step(
    xy: FloatArray,
    corners: TableArray,
    centre: Centre,
    dx: float,
    dy: float,
    good: float,
    lines: FloatArray,
    fence: Fence,
) -> tuple[float, float]:
    """Take the first of the whole step, its half, quarter and eighth that all guards allow.

    Parameters
    ----------
    dx, dy
        The step.
    good
        The ``"quality"`` guard: the star's smallest scaled Jacobian must not fall, or stay at or
        above this. NaN for no such guard.
    lines, fence
        The guard lines, and the clearance to keep.

    Returns
    -------
    x, y
        The place to store: the present one where no step is allowed.
    """
    x, y = xy[centre.v, 0], xy[centre.v, 1]
    present = np.nan  # the present quality, once it is needed
    for _ in range(HALVINGS + 1):
        new_x, new_y = x + dx, y + dy
        if (
            (new_x != x or new_y != y)
            and keeps_clearance(lines, fence.n_lines, dx, dy, fence.least)
            and keeps_corners(xy, corners, centre, new_x, new_y)
        ):
            if math.isnan(good):
                return new_x, new_y
            enough = good if math.isnan(present) else min(good, present)
            score = star_scaled_jacobian(xy, corners, centre, new_x, new_y)
            if score >= enough:
                return new_x, new_y
            if math.isnan(present):
                present = star_scaled_jacobian(xy, corners, centre, x, y)
                if score >= present:
                    return new_x, new_y
        dx *= 0.5
        dy *= 0.5
    return x, y


@inlined_helper()
def store_move(
    xy: FloatArray,
    centre: Centre,
    x: float,
    y: float,
    shortest: float,
    lengths: FloatArray,
    shares: FloatArray,
) -> None:
    """Put a vertex at (x, y), where `allowed_step` lets it go, and measure its move.

    Parameters
    ----------
    shortest
        Shortest edge of the vertex, before the move.
    lengths, shares : (n_movable,)
        As in `stars.Moves`: overwritten for this vertex.
    """
    dx, dy = x - xy[centre.v, 0], y - xy[centre.v, 1]
    xy[centre.v, 0], xy[centre.v, 1] = x, y
    length = math.sqrt(dx * dx + dy * dy)
    lengths[centre.i] = length
    shares[centre.i] = share(length, shortest)


@inlined_helper()
def guarded_move(
    xy: FloatArray,
    corners: TableArray,
    centre: Centre,
    step: Step,
    good: float,
    lines: FloatArray,
    fence: Fence,
    lengths: FloatArray,
    shares: FloatArray,
) -> None:
    """Move a vertex by as much of its step as its guards allow, and measure the move.

    Parameters
    ----------
    good, lines, fence
        As in `allowed_step`.
    lengths, shares
        As in `store_move`.
    """
    if step.dx == 0.0 and step.dy == 0.0:
        lengths[centre.i], shares[centre.i] = 0.0, 0.0
        return
    x, y = allowed_step(xy, corners, centre, step.dx, step.dy, good, lines, fence)
    store_move(xy, centre, x, y, step.shortest, lengths, shares)
