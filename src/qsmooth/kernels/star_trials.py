"""Trials of a block of lanes: the energy of each star with its vertex at its trial place.

A trial also keeps two margins: that by which the star stays valid, and that by which it gets no
worse than what is held. Both have to be positive. All differences are of stored coordinates, and
each determinant is taken about one of its points, as the error bound asks.
"""

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper, lane_helper
from qsmooth.kernels.corner_energy import INV_ROOT3, Target
from qsmooth.kernels.geometry import ORIENTATION_BOUND, UNDERFLOW_BOUND
from qsmooth.kernels.lanes import (
    HELD,
    LEAST_COSINE,
    LEAST_EDGE,
    LEAST_SINE,
    MARGIN,
    MOST_COSINE,
    MOST_RATIO,
    MOST_SHAPE,
    PX,
    PY,
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
    TRIAL,
    LaneRange,
)
from qsmooth.kernels.star_energy import (
    SINE_60,
    SLIM_SQUARINGS,
    RowArrays,
    Terms,
    WallArrays,
    nearer,
    power,
)

# The square of a triangle's best sine.
THREE_QUARTERS = 0.75


@lane_helper()
def _certify(left: float, right: float, s: FloatArray, i: int) -> float:
    """Keep the margin by which a corner's area is certified positive; give its determinant."""
    det = left - right
    margin = det - (ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND)
    s[MARGIN + i] = margin if margin < s[MARGIN + i] else s[MARGIN + i]
    return det


@lane_helper()
def _keep(margin: float, s: FloatArray, i: int) -> None:
    """Keep the least margin of what is held."""
    s[HELD + i] = margin if margin < s[HELD + i] else s[HELD + i]


@lane_helper()
def _hold(det: float, dot: float, squares: float, best: float, s: FloatArray, i: int) -> None:
    """Keep the margins of a corner's cosine and sine, of |u|² |w|² and the square of its best sine.

    All are squared, with their signs: this takes no root.
    """
    cosine = dot * abs(dot)
    _keep(s[MOST_COSINE + i] * squares - cosine, s, i)
    _keep(cosine - s[LEAST_COSINE + i] * squares, s, i)
    _keep(det * abs(det) - s[LEAST_SINE + i] * (best * squares), s, i)


@lane_helper()
def _try_corner(
    n: float,
    det: float,
    dot: float,
    squares: float,
    slim: float,
    terms: Terms,
    walled: bool,
    s: FloatArray,
    i: int,
) -> None:
    """Add a quad's corner: shape energy and, if `walled`, the walls on shape and corner."""
    _hold(det, dot, squares, 1.0, s, i)
    inv = 1.0 / det
    f = n * inv
    energy = terms.mean_weight * f
    if walled:
        gg = squares * inv * inv * (terms.scale * terms.scale)
        energy += power(f * slim, SLIM_SQUARINGS) + power(gg, terms.squarings - 1)
    s[TRIAL + i] += energy


@lane_helper()
def _try_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    i: int,
    m11: float,
    m22: float,
    slim: float,
    terms: Terms,
    walled: bool,
) -> None:
    px, py = s[PX + i], s[PY + i]
    ax, ay, bx, by = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
    cx, cy = star[k + ROW4 + i], star[k + ROW5 + i]
    ux, uy = ax - px, ay - py
    wx, wy = cx - px, cy - py
    va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
    det = _certify(ux * wy, uy * wx, s, i)
    n, dot = m11 * va + m22 * vc, ux * wx + uy * wy
    _try_corner(n, det, dot, 4.0 * va * vc, slim, terms, walled, s, i)
    ex, ey = bx - ax, by - ay
    ab = 0.5 * (ex * ex + ey * ey)
    det = _certify(ey * ux, ex * uy, s, i)
    n, dot = m22 * ab + m11 * va, -(ex * ux + ey * uy)
    _try_corner(n, det, dot, 4.0 * ab * va, slim, terms, walled, s, i)
    ex, ey = bx - cx, by - cy
    cb = 0.5 * (ex * ex + ey * ey)
    det = _certify(ex * wy, ey * wx, s, i)
    n, dot = m22 * vc + m11 * cb, -(ex * wx + ey * wy)
    _try_corner(n, det, dot, 4.0 * cb * vc, slim, terms, walled, s, i)


@lane_helper()
def _try_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    i: int,
    target: Target,
    slim: float,
    terms: Terms,
    walled: bool,
) -> None:
    ax, ay, cx, cy = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
    ux, uy = ax - s[PX + i], ay - s[PY + i]
    wx, wy = cx - s[PX + i], cy - s[PY + i]
    ex, ey = cx - ax, cy - ay
    va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
    ac, uw = 0.5 * (ex * ex + ey * ey), ux * wx + uy * wy
    det = _certify(ux * wy, uy * wx, s, i)
    at_v, at_a, at_c = 4.0 * va * vc, 4.0 * ac * va, 4.0 * ac * vc
    _hold(det, uw, at_v, THREE_QUARTERS, s, i)
    _hold(det, -(ex * ux + ey * uy), at_a, THREE_QUARTERS, s, i)
    _hold(det, ex * wx + ey * wy, at_c, THREE_QUARTERS, s, i)
    inv = 1.0 / det
    f = (target.m11 * va + target.m12 * uw + target.m22 * vc) * inv
    energy = terms.mean_weight * f
    if walled:
        energy += power(f * slim, SLIM_SQUARINGS)
    s[TRIAL + i] += energy
    if walled:
        scale = terms.scale * SINE_60
        scale *= scale
        s[TRIAL + i] += power(at_v * inv * inv * scale, terms.squarings - 1)
        s[TRIAL + i] += power(at_a * inv * inv * scale, terms.squarings - 1)
        s[TRIAL + i] += power(at_c * inv * inv * scale, terms.squarings - 1)


@helper()
def try_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    lanes: LaneRange,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add a quad's shape energy at the trial places, and keep the least margins."""
    m11s, _, m22s = rows
    for i in range(lanes[0], lanes[1]):
        _try_quad(star, s, k, i, m11s[row + i], m22s[row + i], 0.0, terms, False)


@helper()
def try_walled_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    lanes: LaneRange,
    rows: RowArrays,
    row: int,
    walls: WallArrays,
    wall_row: int,
    terms: Terms,
) -> None:
    """Add a quad's shape energy and walls, and keep the least margins."""
    m11s, _, m22s = rows
    slims, nears = walls
    for i in range(lanes[0], lanes[1]):
        _try_quad(
            star,
            s,
            k,
            i,
            m11s[row + i],
            m22s[row + i],
            slims[wall_row + i],
            nearer(terms, nears[wall_row + i]),
            True,
        )


@helper()
def try_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    lanes: LaneRange,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add a triangle's shape energy at the trial places, and keep the least margins."""
    m11s, m12s, m22s = rows
    for i in range(lanes[0], lanes[1]):
        target = Target(m11s[row + i], m12s[row + i], m22s[row + i])
        _try_triangle(star, s, k, i, target, 0.0, terms, False)


@helper()
def try_walled_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    lanes: LaneRange,
    rows: RowArrays,
    row: int,
    walls: WallArrays,
    wall_row: int,
    terms: Terms,
) -> None:
    """Add a triangle's shape energy and walls, and keep the least margins."""
    m11s, m12s, m22s = rows
    slims, nears = walls
    for i in range(lanes[0], lanes[1]):
        target = Target(m11s[row + i], m12s[row + i], m22s[row + i])
        _try_triangle(
            star, s, k, i, target, slims[wall_row + i], nearer(terms, nears[wall_row + i]), True
        )


# ------------------------------------------------------------------------------- sizes


@helper()
def try_size(
    star: FloatArray,
    s: FloatArray,
    a: int,
    c: int,
    lanes: LaneRange,
    sizes: RowArrays,
    row: int,
    mean_weight: float,
) -> None:
    """Add the size term of a corner at the trial places; a and c as in `add_size`."""
    areas, inv_areas, weights = sizes
    for i in range(lanes[0], lanes[1]):
        px, py = s[PX + i], s[PY + i]
        ax, ay, cx, cy = star[a + i], star[a + ROW + i], star[c + i], star[c + ROW + i]
        det = (ax - px) * (cy - py) - (ay - py) * (cx - px)
        off = det * inv_areas[row + i] - areas[row + i] / det
        s[TRIAL + i] += 0.5 * (mean_weight * weights[row + i]) * off * off


# ------------------------------------------------------------------------------- held on request


@lane_helper()
def _hold_edges(
    va: float, vc: float, shortest: float, longest: float, s: FloatArray, i: int
) -> None:
    """Keep the margins of a cell's edges; given are half the squares, two of edges that move."""
    own = min(va, vc)
    _keep(own - s[LEAST_EDGE + i], s, i)
    _keep(s[MOST_RATIO + i] * min(own, shortest) - max(max(va, vc), longest), s, i)


@helper()
def hold_quad(star: FloatArray, s: FloatArray, k: int, lanes: LaneRange) -> None:
    """Keep the margins of a quad's edges and of its shape."""
    for i in range(lanes[0], lanes[1]):
        px, py = s[PX + i], s[PY + i]
        ax, ay, bx, by = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        cx, cy = star[k + ROW4 + i], star[k + ROW5 + i]
        ux, uy = ax - px, ay - py
        wx, wy = cx - px, cy - py
        va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
        _keep(s[MOST_SHAPE + i] * (ux * wy - uy * wx) - (va + vc), s, i)
        ex, ey = bx - ax, by - ay
        ab = 0.5 * (ex * ex + ey * ey)
        _keep(s[MOST_SHAPE + i] * (ey * ux - ex * uy) - (ab + va), s, i)
        ex, ey = bx - cx, by - cy
        cb = 0.5 * (ex * ex + ey * ey)
        _keep(s[MOST_SHAPE + i] * (ex * wy - ey * wx) - (cb + vc), s, i)
        _hold_edges(va, vc, min(ab, cb), max(ab, cb), s, i)


@helper()
def hold_triangle(star: FloatArray, s: FloatArray, k: int, lanes: LaneRange) -> None:
    """Keep the margins of a triangle's edges and of its shape."""
    for i in range(lanes[0], lanes[1]):
        ax, ay, cx, cy = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        ux, uy = ax - s[PX + i], ay - s[PY + i]
        wx, wy = cx - s[PX + i], cy - s[PY + i]
        ex, ey = cx - ax, cy - ay
        va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
        ac = 0.5 * (ex * ex + ey * ey)
        _keep(s[MOST_SHAPE + i] * (ux * wy - uy * wx) - INV_ROOT3 * (va + vc + ac), s, i)
        _hold_edges(va, vc, ac, ac, s, i)
