"""The energy of a star, its derivatives and its trials, on blocks of lanes.

What is added up stands in `newton_sweep`; here are the loops over the lanes of a block, for one
cell of each star: what it adds to the energy and its derivatives, and what it says of a trial.
"""

import math
from typing import NamedTuple, TypeAlias

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper, lane_helper
from qsmooth.kernels.corner_energy import (
    INV_ROOT3,
    Linear,
    Quadratic,
    Target,
    determinant,
    determinant_to_next,
    determinant_to_previous,
    dot,
    fixed_half_square,
    half_square,
    hessian,
    numerator,
    quotient,
    rectangle_numerator,
)
from qsmooth.kernels.geometry import ORIENTATION_BOUND, UNDERFLOW_BOUND
from qsmooth.kernels.lanes import (
    ENERGY,
    GX,
    GY,
    HXX,
    HXY,
    HYY,
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
    X,
    Y,
)

# What the sine of a triangle's corner is at best: it counts as 1.
SINE_60 = math.sqrt(0.75)


class Terms(NamedTuple):
    """A `Wall` as the loops need it: one over its threshold, and its power as a float."""

    mean_weight: float
    scale: float
    squarings: int
    power: float


class Own(NamedTuple):
    """What is asked of one cell besides its shape; see `blocks.Rows`."""

    area: float
    inv_area: float
    size_weight: float
    slim: float


# The arrays of `blocks.Rows`, as helpers take them.
RowArrays: TypeAlias = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray
]


@lane_helper()
def _power(r: float, squarings: int) -> float:
    """Raise r to 2 ** squarings, at most 6; by selects, as a loop would stop vectorisation."""
    r = r * r if squarings > 0 else r
    r = r * r if squarings > 1 else r
    r = r * r if squarings > 2 else r
    r = r * r if squarings > 3 else r
    r = r * r if squarings > 4 else r
    return r * r if squarings > 5 else r


@lane_helper()
def _shape_wall(f: float, slim: float) -> tuple[float, float, float]:
    """Raise f · slim to the power of 16; also its derivatives by f."""
    r = f * slim
    r2 = r * r
    r4 = r2 * r2
    r8 = r4 * r4
    r14 = r8 * r4 * r2
    return r14 * r2, 16.0 * slim * (r14 * r), 240.0 * slim * slim * r14


@lane_helper()
def _size_term(
    det: float, inv: float, area: float, inv_area: float, weight: float
) -> tuple[float, float, float]:
    """Weight · ½ (τ − 1/τ)² with τ = det / area; also its derivatives by det."""
    tau, back = det * inv_area, area * inv
    square = back * back
    slope = weight * (tau - back * square) * inv_area
    second = weight * (1.0 + 3.0 * square * square) * inv_area * inv_area
    return 0.5 * weight * (tau - back) * (tau - back), slope, second


@lane_helper()
def _add_shape(
    n: Quadratic, det: Linear, own: Own, mean_weight: float, s: FloatArray, i: int
) -> None:
    """Add a corner's shape energy, the wall on it and the size term, with their derivatives."""
    inv, f, fx, fy = quotient(n, det)
    high, slope, second = _shape_wall(f, own.slim)
    size, size_slope, size_second = _size_term(
        det.value, inv, own.area, own.inv_area, mean_weight * own.size_weight
    )
    weight = mean_weight + slope
    s[ENERGY + i] += mean_weight * f + high + size
    s[GX + i] += weight * fx + size_slope * det.x
    s[GY + i] += weight * fy + size_slope * det.y
    xx, xy, yy = hessian(n.second, fx, fy, det)
    weight *= inv
    s[HXX + i] += weight * xx + second * fx * fx + size_second * det.x * det.x
    s[HXY + i] += weight * xy + second * fx * fy + size_second * det.x * det.y
    s[HYY + i] += weight * yy + second * fy * fy + size_second * det.y * det.y


@lane_helper()
def _add_wall(
    det: Linear, uu: Quadratic, ww: Quadratic, scale: float, terms: Terms, s: FloatArray, i: int
) -> None:
    """Add the wall on a corner's badness and its derivatives by the vertex that moves.

    Given are its determinant, and ½ |u|² and ½ |w|² of its edges; and one over the threshold.
    """
    # |u| |w| / det lies under (|u|² t + |w|² / t) / (2 det) for every t > 0, and touches it at the
    # t = |w| / |u| taken here. That bound is convex: what lowers it lowers the energy. It all takes
    # two divisions a corner; with five a sweep was a fifth slower.
    inv = 1.0 / det.value
    root = math.sqrt(uu.value * ww.value)
    inv_root = 1.0 / root
    t, inv_t = ww.value * inv_root, uu.value * inv_root
    g, inv_g = 2.0 * root * inv, 0.5 * det.value * inv_root
    gx = (uu.x * t + ww.x * inv_t - g * det.x) * inv
    gy = (uu.y * t + ww.y * inv_t - g * det.y) * inv
    high = _power(g * scale, terms.squarings)
    slope = terms.power * high * inv_g
    second = (terms.power - 1.0) * slope * inv_g
    s[ENERGY + i] += high
    s[GX + i] += slope * gx
    s[GY + i] += slope * gy
    slope *= inv
    xx, xy, yy = hessian(uu.second * t + ww.second * inv_t, gx, gy, det)
    s[HXX + i] += slope * xx + second * gx * gx
    s[HXY + i] += slope * xy + second * gx * gy
    s[HYY + i] += slope * yy + second * gy * gy


@helper()
def add_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add what a quad of each star adds to the energy and its derivatives."""
    m11s, _, m22s, areas, inv_areas, weights, slims = rows
    weight, scale = terms.mean_weight, terms.scale
    for i in range(n):
        m11, m22 = m11s[row + i], m22s[row + i]
        own = Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        va, vc = half_square(ax, ay), half_square(cx, cy)
        det = determinant(ax, ay, cx, cy)
        _add_shape(rectangle_numerator(m11, m22, va, vc), det, own, weight, s, i)
        _add_wall(det, va, vc, scale, terms, s, i)
        # At the neighbouring corners the sides of a rectangle change places.
        ex, ey = bx - ax, by - ay
        ab, det = fixed_half_square(ex, ey), determinant_to_previous(ex, ey, -ax, -ay)
        _add_shape(rectangle_numerator(m22, m11, ab, va), det, own, weight, s, i)
        _add_wall(det, ab, va, scale, terms, s, i)
        ex, ey = bx - cx, by - cy
        cb, det = fixed_half_square(ex, ey), determinant_to_next(-cx, -cy, ex, ey)
        _add_shape(rectangle_numerator(m22, m11, vc, cb), det, own, weight, s, i)
        _add_wall(det, vc, cb, scale, terms, s, i)


@helper()
def add_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add what a triangle of each star adds to the energy and its derivatives."""
    m11s, m12s, m22s, areas, inv_areas, weights, slims = rows
    # The sine of 60 degrees is ideal in triangles.
    scale = terms.scale * SINE_60
    for i in range(n):
        target = Target(m11s[row + i], m12s[row + i], m22s[row + i])
        own = Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        va, vc, ac = half_square(ax, ay), half_square(cx, cy), fixed_half_square(cx - ax, cy - ay)
        # One determinant and one shape energy for the triangle, and a badness at each corner.
        det = determinant(ax, ay, cx, cy)
        shape = numerator(target, va, dot(ax, ay, cx, cy), vc)
        _add_shape(shape, det, own, terms.mean_weight, s, i)
        _add_wall(det, va, vc, scale, terms, s, i)
        _add_wall(det, ac, va, scale, terms, s, i)
        _add_wall(det, ac, vc, scale, terms, s, i)


@lane_helper()
def _keep(margin: float, s: FloatArray, i: int) -> None:
    """Keep the least margin by which a trial is allowed."""
    s[MARGIN + i] = margin if margin < s[MARGIN + i] else s[MARGIN + i]


@lane_helper()
def _hold_edges(
    va: float, vc: float, shortest: float, longest: float, s: FloatArray, i: int
) -> None:
    """Keep the margins of a cell's edges; given are half the squares, two of edges that move."""
    own = min(va, vc)
    _keep(own - s[LEAST_EDGE + i], s, i)
    _keep(s[MOST_RATIO + i] * min(own, shortest) - max(max(va, vc), longest), s, i)


@lane_helper()
def _try_shape(n: float, det: float, own: Own, weight: float, s: FloatArray, i: int) -> None:
    """Add a corner's shape energy, the wall on it and the size term."""
    inv = 1.0 / det
    f = n * inv
    off = det * own.inv_area - own.area * inv
    s[TRIAL + i] += weight * (f + 0.5 * own.size_weight * off * off) + _power(f * own.slim, 4)


@lane_helper()
def _try_wall(
    det: float,
    dot_: float,
    uu: float,
    ww: float,
    scale: float,
    best_sine: float,
    squarings: int,
    s: FloatArray,
    i: int,
) -> None:
    """Add the wall on a corner, and keep the margin by which it is no worse than what is held."""
    lengths = 2.0 * math.sqrt(uu * ww)
    s[TRIAL + i] += _power(lengths / det * scale, squarings)
    _keep(s[MOST_COSINE + i] * lengths - dot_, s, i)
    _keep(dot_ - s[LEAST_COSINE + i] * lengths, s, i)
    _keep(det - s[LEAST_SINE + i] * best_sine * lengths, s, i)


@lane_helper()
def _certify(left: float, right: float, s: FloatArray, i: int) -> float:
    """Keep the margin by which a corner's area is certified positive; give its determinant."""
    det = left - right
    _keep(det - (ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND), s, i)
    return det


@helper()
def try_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add a quad's energy at the trial places, and keep the least margin that allows them."""
    # All differences are of stored coordinates, and each determinant is taken about one of its
    # points, as the error bound asks.
    m11s, _, m22s, areas, inv_areas, weights, slims = rows
    weight, scale, squarings = terms.mean_weight, terms.scale, terms.squarings
    for i in range(n):
        m11, m22 = m11s[row + i], m22s[row + i]
        own = Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        px, py = s[PX + i], s[PY + i]
        ax, ay, bx, by = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        cx, cy = star[k + ROW4 + i], star[k + ROW5 + i]
        ux, uy = ax - px, ay - py
        wx, wy = cx - px, cy - py
        va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
        det = _certify(ux * wy, uy * wx, s, i)
        _keep(s[MOST_SHAPE + i] * det - (va + vc), s, i)
        _try_shape(m11 * va + m22 * vc, det, own, weight, s, i)
        _try_wall(det, ux * wx + uy * wy, va, vc, scale, 1.0, squarings, s, i)
        ex, ey = bx - ax, by - ay
        ab = 0.5 * (ex * ex + ey * ey)
        det = _certify(ey * ux, ex * uy, s, i)
        _keep(s[MOST_SHAPE + i] * det - (ab + va), s, i)
        _try_shape(m22 * ab + m11 * va, det, own, weight, s, i)
        _try_wall(det, -(ex * ux + ey * uy), ab, va, scale, 1.0, squarings, s, i)
        ex, ey = bx - cx, by - cy
        cb = 0.5 * (ex * ex + ey * ey)
        det = _certify(ex * wy, ey * wx, s, i)
        _keep(s[MOST_SHAPE + i] * det - (cb + vc), s, i)
        _hold_edges(va, vc, min(ab, cb), max(ab, cb), s, i)
        _try_shape(m22 * vc + m11 * cb, det, own, weight, s, i)
        _try_wall(det, -(ex * wx + ey * wy), cb, vc, scale, 1.0, squarings, s, i)


@helper()
def try_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add a triangle's energy at the trial places, and keep the least margin that allows them."""
    m11s, m12s, m22s, areas, inv_areas, weights, slims = rows
    scale, squarings = terms.scale * SINE_60, terms.squarings
    for i in range(n):
        own = Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        ax, ay, cx, cy = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        ux, uy = ax - s[PX + i], ay - s[PY + i]
        wx, wy = cx - s[PX + i], cy - s[PY + i]
        ex, ey = cx - ax, cy - ay
        va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
        ac, uw = 0.5 * (ex * ex + ey * ey), ux * wx + uy * wy
        shape = m11s[row + i] * va + m12s[row + i] * uw + m22s[row + i] * vc
        det = _certify(ux * wy, uy * wx, s, i)
        _keep(s[MOST_SHAPE + i] * det - INV_ROOT3 * (va + vc + ac), s, i)
        _hold_edges(va, vc, ac, ac, s, i)
        _try_shape(shape, det, own, terms.mean_weight, s, i)
        _try_wall(det, uw, va, vc, scale, SINE_60, squarings, s, i)
        _try_wall(det, -(ex * ux + ey * uy), ac, va, scale, SINE_60, squarings, s, i)
        _try_wall(det, ex * wx + ey * wy, ac, vc, scale, SINE_60, squarings, s, i)
