"""Where places lie in a mesh: the cell of each, found by walking, and the weights of its corners.

A cell that can hold a place is a triangle of positive area, a convex quad, or another quad that one
of its diagonals cuts into two triangles of positive area. All others are folded, and hold nothing.
Which cell a place is in goes by exact orientations; a place on an edge is in both cells.
"""

import math

from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, parallel_kernel, strict_helper
from qsmooth.kernels.geometry import orientation

FOLDED, TRIANGLE, CONVEX, CUT_FROM_FIRST, CUT_FROM_SECOND = 0, 1, 2, 3, 4
# A walk through more cells than this goes round in a circle, or too far to be quick.
MOST_STEPS = 500
# A place is on an edge if it is no farther than this share of the largest coordinate around.
ON_EDGE = 2.0**-50


@strict_helper()
def turn(xy: FloatArray, a: int, b: int, px: float, py: float) -> int:
    """Exact side of the edge from a to b that a place is on: 1 left, -1 right, 0 on its line."""
    return orientation(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], px, py)


@strict_helper()
def kind_of(xy: FloatArray, cell_vertices: IndexArray, first: int, last: int) -> int:
    """What a cell is to what looks for places in it, see above."""
    a, b, c = cell_vertices[first], cell_vertices[first + 1], cell_vertices[first + 2]
    at_b = turn(xy, a, b, xy[c, 0], xy[c, 1]) > 0
    if last - first == 3:
        return TRIANGLE if at_b else FOLDED
    d = cell_vertices[first + 3]
    from_first = at_b and turn(xy, c, d, xy[a, 0], xy[a, 1]) > 0
    from_second = turn(xy, d, a, xy[b, 0], xy[b, 1]) > 0 and turn(xy, b, c, xy[d, 0], xy[d, 1]) > 0
    if from_first and from_second:
        return CONVEX
    if from_first:
        return CUT_FROM_FIRST
    return CUT_FROM_SECOND if from_second else FOLDED


@helper()
def corners_of(
    cell_vertices: IndexArray, first: int, last: int, kind: int
) -> tuple[int, int, int, int]:
    """Corners a, b, c, d, such that a-c is what cuts a quad; of a triangle c comes twice."""
    a, b, c = cell_vertices[first], cell_vertices[first + 1], cell_vertices[first + 2]
    d = cell_vertices[last - 1]
    return (b, c, d, a) if kind == CUT_FROM_SECOND else (a, b, c, d)


@strict_helper()
def _in_triangle(xy: FloatArray, a: int, b: int, c: int, px: float, py: float) -> bool:
    return bool(
        turn(xy, a, b, px, py) >= 0 and turn(xy, b, c, px, py) >= 0 and turn(xy, c, a, px, py) >= 0
    )


@strict_helper()
def holds(
    xy: FloatArray,
    cell_vertices: IndexArray,
    ends: tuple[int, int],
    kind: int,
    px: float,
    py: float,
) -> bool:
    """Whether a place is in a cell of this kind or on its edges."""
    if kind == FOLDED:
        return False
    a, b, c, d = corners_of(cell_vertices, ends[0], ends[1], kind)
    return _in_triangle(xy, a, b, c, px, py) or (
        kind != TRIANGLE and _in_triangle(xy, a, c, d, px, py)
    )


@helper()
def _is_beside(xy: FloatArray, a: int, b: int, px: float, py: float) -> bool:
    """Whether a place is on the line of an edge but for the rounding of its coordinates."""
    ax, ay = xy[a, 0], xy[a, 1]
    ex, ey, dx, dy = xy[b, 0] - ax, xy[b, 1] - ay, px - ax, py - ay
    largest = max(abs(px), abs(py), abs(ax), abs(ay))
    near = ON_EDGE * ON_EDGE * largest * largest * (ex * ex + ey * ey)
    cross = ex * dy - ey * dx
    return bool(cross * cross <= near)


@strict_helper()
def find_by_walking(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    twins: IndexArray,
    corner_cells: IndexArray,
    start: int,
    px: float,
    py: float,
) -> int:
    """Walk from cell to cell over an edge that the place is beyond.

    A place that is beyond the boundary by no more than rounding, as what slides along it is, is in
    the cell there.

    Returns
    -------
    cell
        Or -2 - c where cell c is at the boundary, and the place beyond that; -1 where the walk
        leads nowhere.
    """
    c, came_from = start, -1
    for _ in range(MOST_STEPS):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        kind = kind_of(xy, cell_vertices, first, last)
        if holds(xy, cell_vertices, (first, last), kind, px, py):
            return c
        following, beside, around = -1, True, False
        if kind == FOLDED:
            return -1
        for k in range(first, last):
            a, b = cell_vertices[k], cell_vertices[k + 1 if k + 1 < last else first]
            if turn(xy, a, b, px, py) < 0:
                if twins[k] < 0:
                    beside = beside and _is_beside(xy, a, b, px, py)
                elif corner_cells[twins[k]] == came_from:
                    around = True
                else:
                    following = corner_cells[twins[k]]
                    break
        if following < 0:
            if around:
                return -1
            return c if beside else -2 - c
        came_from, c = c, following
    return -1


@helper()
def _unit(value: float) -> float:
    return min(1.0, max(0.0, value))


@helper()
def _of_triangle(
    ex: float, ey: float, fx: float, fy: float, qx: float, qy: float
) -> tuple[float, float]:
    """Coordinates (s, t) of q = s e + t f, within the triangle of e and f."""
    det = ex * fy - ey * fx
    s, t = (qx * fy - qy * fx) / det, (ex * qy - ey * qx) / det
    # What rounding left is solved for once more: in a sliver it is not small.
    rx, ry = qx - s * ex - t * fx, qy - s * ey - t * fy
    s, t = _unit(s + (rx * fy - ry * fx) / det), _unit(t + (ex * ry - ey * rx) / det)
    total = max(1.0, s + t)
    return s / total, t / total


@helper()
def _of_quad(
    ex: float, ey: float, fx: float, fy: float, gx: float, gy: float, qx: float, qy: float
) -> tuple[float, float]:
    """Coordinates (s, t) in the unit square of q = s e + t f + s t g, of a convex quad.

    That q - t f is parallel to e + t g is an equation of second order for t. Its left side rises
    from 0 or less at t = 0 to 0 or more at 1, so that the root with positive slope is the one.
    """
    zero = qx * ey - qy * ex
    first = qx * gy - qy * gx + ex * fy - ey * fx
    second = gx * fy - gy * fx
    root = math.sqrt(max(0.0, first * first - 4.0 * second * zero))
    t = 0.0
    if first >= 0.0:
        t = -2.0 * zero / (first + root) if first + root > 0.0 else 0.0
    elif second > 0.0:
        t = (root - first) / (2.0 * second)
    t = _unit(t)
    hx, hy = ex + t * gx, ey + t * gy
    s = _unit(((qx - t * fx) * hx + (qy - t * fy) * hy) / (hx * hx + hy * hy))
    # A Newton step for what rounding left.
    rx, ry = qx - t * fx - s * hx, qy - t * fy - s * hy
    kx, ky = fx + s * gx, fy + s * gy
    det = hx * ky - hy * kx
    if det > 0.0:
        s = _unit(s + (rx * ky - ry * kx) / det)
        t = _unit(t + (hx * ry - hy * rx) / det)
    return s, t


@helper()
def put_weights(
    xy: FloatArray,
    cell_vertices: IndexArray,
    ends: tuple[int, int],
    px: float,
    py: float,
    i: int,
    corners: IndexArray,
    weights: FloatArray,
) -> None:
    """Write the corners of the cell of a place and their weights, which add up to 1, into row i.

    Linear in a triangle, bilinear in a convex quad, linear in the half that it is in of another.
    """
    kind = kind_of(xy, cell_vertices, ends[0], ends[1])
    a, b, c, d = corners_of(cell_vertices, ends[0], ends[1], kind)
    qx, qy = px - xy[a, 0], py - xy[a, 1]
    bx, by = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
    cx, cy = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1]
    dx, dy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
    if kind == CONVEX:
        s, t = _of_quad(bx, by, dx, dy, cx - bx - dx, cy - by - dy, qx, qy)
        at_b, at_c, at_d = s * (1.0 - t), s * t, (1.0 - s) * t
    elif kind == TRIANGLE or turn(xy, a, c, px, py) <= 0:
        at_b, at_c = _of_triangle(bx, by, cx, cy, qx, qy)
        at_d = 0.0
    else:
        at_c, at_d = _of_triangle(cx, cy, dx, dy, qx, qy)
        at_b = 0.0
    corners[i, 0], corners[i, 1], corners[i, 2], corners[i, 3] = a, b, c, d
    weights[i, 0] = max(0.0, 1.0 - at_b - at_c - at_d)
    weights[i, 1], weights[i, 2], weights[i, 3] = at_b, at_c, at_d


@parallel_kernel()
def locate(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    twins: IndexArray,
    corner_cells: IndexArray,
    places: FloatArray,
    starts: IndexArray,
    found: IndexArray,
    corners: IndexArray,
    weights: FloatArray,
) -> None:
    """Find the cell that each place is in, walking from one nearby, and the weights of its corners.

    O. Devillers, S. Pion, M. Teillaud, "Walking in a triangulation", Int. J. Found. Comput. Sci. 13
    (2002), the visibility walk.

    Parameters
    ----------
    xy, cells, twins, corner_cells
        Coordinates, (n_vertices, 2), and cells, counter-clockwise, as in `qsmooth.topology`.
    places, starts : (m, 2), (m,)
        Where to look, and a cell to begin at.
    found : (m,)
        Overwritten. The cell, or -1 where the walk met a folded cell or an edge of the mesh, or
        went round in a circle.
    corners, weights : (m, 4)
        Overwritten where a cell was found. Of a triangle the last vertex comes twice.
    """
    cell_offsets, cell_vertices = cells
    for i in prange(len(places)):
        px, py = places[i, 0], places[i, 1]
        c = find_by_walking(xy, cell_offsets, cell_vertices, twins, corner_cells, starts[i], px, py)
        found[i] = max(c, -1)
        if c >= 0:
            ends = cell_offsets[c], cell_offsets[c + 1]
            put_weights(xy, cell_vertices, ends, px, py, i, corners, weights)
