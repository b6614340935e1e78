"""Values that belong to places, at vertices that have moved: for the steps of a session."""

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel
from qsmooth.kernels.locating import corners_of, find_by_walking, kind_of, put_weights

# A place beside a triangle is near it if it is the mean of the corners with no larger weights.
FARTHEST = 3.0
# A cell is far from flat where the determinant of each corner is this share of their sum.
FAR_FROM_FLAT = 1e-6


@helper()
def _towards(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    stars: tuple[IndexArray, IndexArray],
    v: int,
    px: float,
    py: float,
) -> int:
    """The cell around a vertex that the way to a place leads into, to begin a walk at."""
    offsets, vertices = cells
    x, y = xy[v, 0], xy[v, 1]
    first = stars[0][v]
    for k in range(first, stars[0][v + 1]):
        c = stars[1][k]
        start, stop = offsets[c], offsets[c + 1]
        at = start
        while vertices[at] != v:
            at += 1
        a = vertices[at + 1 if at + 1 < stop else start]
        b = vertices[at - 1 if at > start else stop - 1]
        after = (xy[a, 0] - x) * (py - y) - (xy[a, 1] - y) * (px - x)
        before = (px - x) * (xy[b, 1] - y) - (py - y) * (xy[b, 0] - x)
        if after >= 0.0 and before >= 0.0:
            return int(c)
    return int(stars[1][first])


@helper()
def _surely_holds(
    xy: FloatArray, cells: tuple[IndexArray, IndexArray], c: int, px: float, py: float
) -> bool:
    """Whether a place is in a cell that is far from flat, but for rounding: without a walk."""
    offsets, vertices = cells
    first, last = offsets[c], offsets[c + 1]
    least, total = np.inf, 0.0
    before = vertices[last - 1]
    ax, ay = xy[before, 0], xy[before, 1]
    at = vertices[first]
    bx, by = xy[at, 0], xy[at, 1]
    for k in range(first, last):
        if (bx - ax) * (py - ay) - (by - ay) * (px - ax) < 0.0:
            return False
        following = vertices[k + 1 if k + 1 < last else first]
        dx, dy = xy[following, 0], xy[following, 1]
        det = (bx - ax) * (dy - by) - (by - ay) * (dx - bx)
        least, total = min(least, det), total + det
        ax, ay, bx, by = bx, by, dx, dy
    return bool(least > FAR_FROM_FLAT * total)


@helper()
def _beyond(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    c: int,
    px: float,
    py: float,
    values: FloatArray,
) -> tuple[float, bool]:
    """The value at a place beside a cell, linearly from its corners; and whether it is near."""
    offsets, vertices = cells
    kind = kind_of(xy, vertices, offsets[c], offsets[c + 1])
    i, j, k, _ = corners_of(vertices, offsets[c], offsets[c + 1], kind)
    ex, ey, fx, fy = (
        xy[j, 0] - xy[i, 0],
        xy[j, 1] - xy[i, 1],
        xy[k, 0] - xy[i, 0],
        xy[k, 1] - xy[i, 1],
    )
    qx, qy = px - xy[i, 0], py - xy[i, 1]
    det = ex * fy - ey * fx
    s, t = (qx * fy - qy * fx) / det, (ex * qy - ey * qx) / det
    near = max(abs(s), abs(t), abs(1.0 - s - t)) <= FARTHEST
    return values[i] + s * (values[j] - values[i]) + t * (values[k] - values[i]), near


@kernel()
def carry_values(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    stars: tuple[IndexArray, IndexArray],
    twins: IndexArray,
    corner_cells: IndexArray,
    is_boundary: BoolArray,
    places: FloatArray,
    values: FloatArray,
    out: FloatArray,
    lost: IndexArray,
) -> int:
    """Interpolate values where vertices have come to, in the mesh as it was.

    Where a vertex of the boundary is beyond that, by less than a cell, the values go on as in the
    cell there: linearly.

    Parameters
    ----------
    xy, places : (n_vertices, 2)
        Where the vertices were and where they are.
    cells, stars, twins, corner_cells, is_boundary
        As in `qsmooth.topology`.
    values, out : (n_vertices,)
        What there was, and, overwritten, what is there now: the same at vertices that have not
        moved.
    lost : (n_vertices,)
        Overwritten with the vertices to which no walk leads; they keep their values.

    Returns
    -------
    n_lost
    """
    offsets, vertices = cells
    corners, weights = np.empty((1, 4), np.int64), np.empty((1, 4))
    n_lost = 0
    for v in range(values.size):
        px, py = places[v, 0], places[v, 1]
        out[v] = values[v]
        if px == xy[v, 0] and py == xy[v, 1]:
            continue
        c = _towards(xy, cells, stars, v, px, py)
        if not _surely_holds(xy, cells, c, px, py):
            c = find_by_walking(xy, offsets, vertices, twins, corner_cells, c, px, py)
        if c < 0:
            near = c < -1 and is_boundary[v]
            if near:
                total, near = _beyond(xy, cells, -2 - c, px, py, values)
                if near:
                    out[v] = total
            if not near:
                lost[n_lost] = v
                n_lost += 1
            continue
        put_weights(xy, vertices, (offsets[c], offsets[c + 1]), px, py, 0, corners, weights)
        base = values[corners[0, 0]]
        total = base
        for i in range(1, 4):
            if weights[0, i] > 0.0:  # what is NaN at a corner of no weight is not asked
                total += weights[0, i] * (values[corners[0, i]] - base)
        out[v] = total
    return n_lost
