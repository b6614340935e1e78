"""Delaunay triangulation of points in a rectangle, by insertion and flips."""

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import kernel, strict_helper
from qsmooth.kernels.geometry import orientation

# Forward error bound of the in-circle determinant, relative to its permanent: J. R. Shewchuk,
# "Adaptive precision floating-point arithmetic and fast robust geometric predicates", Discrete &
# Computational Geometry 18 (1997), the constant iccerrboundA.
IN_CIRCLE_BOUND = (10.0 + 96.0 * 2.0**-53) * 2.0**-53


@strict_helper()
def certainly_in_circle(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, px: float, py: float
) -> bool:
    """Whether p is inside the circle through a, b, c (counter-clockwise) beyond rounding error."""
    ax, ay, bx, by, cx, cy = ax - px, ay - py, bx - px, by - py, cx - px, cy - py
    a, b, c = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    det = a * (bx * cy - by * cx) + b * (cx * ay - cy * ax) + c * (ax * by - ay * bx)
    size = (
        a * (abs(bx * cy) + abs(by * cx))
        + b * (abs(cx * ay) + abs(cy * ax))
        + c * (abs(ax * by) + abs(ay * bx))
    )
    return bool(det > IN_CIRCLE_BOUND * size)


@kernel()
def triangulate(xy: FloatArray, order: IndexArray) -> tuple[IndexArray, int]:
    """Triangulate points in a rectangle.

    Edges are flipped only where that is certain to be right, and no triangle turns over, by exact
    signs: so it ends, and the triangles are valid, on any input; points that are on one circle to
    rounding may leave an edge that is Delaunay to rounding only.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates. The first four are the corners of a rectangle, counter-clockwise, and all
        others are strictly inside it, no two alike.
    order : (n_vertices - 4,)
        The others, in the order in which they are inserted: neighbours soon after each other.

    Returns
    -------
    triangles : (2 * n_vertices - 6, 3)
        Counter-clockwise.
    first_bad
        The first vertex that coincides with another or is not inside, or -1; the triangles are
        then incomplete.
    """
    size = max(2 * xy.shape[0] - 6, 2)
    # Corner i of a triangle is opposite its neighbour i; -1 outside.
    tri = np.empty((size, 3), np.int64)
    near = np.empty((size, 3), np.int64)
    tri[0, 0], tri[0, 1], tri[0, 2] = 0, 1, 2
    tri[1, 0], tri[1, 1], tri[1, 2] = 0, 2, 3
    near[0, 0], near[0, 1], near[0, 2] = -1, 1, -1
    near[1, 0], near[1, 1], near[1, 2] = -1, -1, 0
    count = 2
    stack = np.empty(16 + 6 * size, np.int64)
    t = 0
    for k in range(order.size):
        p = order[k]
        px, py = xy[p, 0], xy[p, 1]
        # Walk: cross any side that has p on its far side. Starting sides differ from step to step,
        # which keeps the walk out of circles.
        for steps in range(4 * size):
            crossed = False
            for j in range(3):
                i = (j + steps) % 3
                a, b = tri[t, (i + 1) % 3], tri[t, (i + 2) % 3]
                if orientation(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], px, py) < 0:
                    t = near[t, i]
                    crossed = True
                    break
            if t < 0:
                return tri[:count], p
            if not crossed:
                break
        for i in range(3):
            if xy[tri[t, i], 0] == px and xy[tri[t, i], 1] == py:
                return tri[:count], p
        # Three triangles round p; one is flat where p is on a side, and is flipped at once.
        a, b, c = tri[t, 0], tri[t, 1], tri[t, 2]
        na, nb, nc = near[t, 0], near[t, 1], near[t, 2]
        t1, t2 = count, count + 1
        count += 2
        tri[t, 0], tri[t, 1], tri[t, 2] = p, b, c
        near[t, 0], near[t, 1], near[t, 2] = na, t1, t2
        tri[t1, 0], tri[t1, 1], tri[t1, 2] = p, c, a
        near[t1, 0], near[t1, 1], near[t1, 2] = nb, t2, t
        tri[t2, 0], tri[t2, 1], tri[t2, 2] = p, a, b
        near[t2, 0], near[t2, 1], near[t2, 2] = nc, t, t1
        for i in range(3):
            if nb >= 0 and near[nb, i] == t:
                near[nb, i] = t1
            if nc >= 0 and near[nc, i] == t:
                near[nc, i] = t2
        stack[0], stack[1], stack[2] = t, t1, t2
        n_stack = 3
        # Triangles on the stack have p as corner 0; look at the side opposite to it.
        while n_stack > 0:
            n_stack -= 1
            s = stack[n_stack]
            o = near[s, 0]
            if o < 0:
                continue
            b, c = tri[s, 1], tri[s, 2]
            j = 0
            while tri[o, j] == b or tri[o, j] == c:
                j += 1
            d = tri[o, j]
            flat = orientation(px, py, xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]) == 0
            if not flat and not certainly_in_circle(
                px, py, xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1], xy[d, 0], xy[d, 1]
            ):
                continue
            if (
                orientation(px, py, xy[b, 0], xy[b, 1], xy[d, 0], xy[d, 1]) <= 0
                or orientation(px, py, xy[d, 0], xy[d, 1], xy[c, 0], xy[c, 1]) <= 0
            ):
                continue
            # s = (p, b, c) and o = (d, c, b) become s = (p, b, d) and o = (p, d, c).
            beyond_b = near[o, (j + 1) % 3]  # opposite c in o: across the side d, b
            beyond_c = near[o, (j + 2) % 3]
            if tri[o, (j + 1) % 3] == b:
                beyond_b, beyond_c = beyond_c, beyond_b
            side_c = near[s, 1]  # across the side c, p
            side_b = near[s, 2]  # across the side p, b
            tri[s, 0], tri[s, 1], tri[s, 2] = p, b, d
            near[s, 0], near[s, 1], near[s, 2] = beyond_b, o, side_b
            tri[o, 0], tri[o, 1], tri[o, 2] = p, d, c
            near[o, 0], near[o, 1], near[o, 2] = beyond_c, side_c, s
            for i in range(3):
                if beyond_b >= 0 and near[beyond_b, i] == o:
                    near[beyond_b, i] = s
                if side_c >= 0 and near[side_c, i] == s:
                    near[side_c, i] = o
            stack[n_stack], stack[n_stack + 1] = s, o
            n_stack += 2
    return tri[:count], -1
