"""The energy of a star, its derivatives and its trials, on blocks of lanes.

What is added up stands in `newton_sweep`; here are the loops over the lanes of a block, for one
cell of each star: what it adds to the energy and its derivatives, and what it says of a trial.

Most blocks ask for little: squares of any size, and no wall before the mean has settled. What a
block asks for beyond that is told by its flags (`blocks.Rows`), and taken from loops of its own; a
branch inside a loop would stop vectorisation.
"""

import math
from typing import NamedTuple, TypeAlias

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper, lane_helper
from qsmooth.kernels.corner_energy import (
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
from qsmooth.kernels.lanes import (
    ENERGY,
    GX,
    GY,
    HXX,
    HXY,
    HYY,
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
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


# Three arrays of `blocks.Rows`: m11, m12, m22, or area, inv_area, size_weight.
RowArrays: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
# Two more: slim and near.
WallArrays: TypeAlias = tuple[FloatArray, FloatArray]


@lane_helper()
def nearer(terms: Terms, near: float) -> Terms:
    """Let a cell's wall on badness stand elsewhere: its threshold is divided by `near`."""
    return Terms(terms.mean_weight, terms.scale * near, terms.squarings, terms.power)


@lane_helper()
def power(r: float, squarings: int) -> float:
    """Raise r to 2 ** squarings, at most 6; by selects, as a loop would stop vectorisation."""
    r = r * r if squarings > 0 else r
    r = r * r if squarings > 1 else r
    r = r * r if squarings > 2 else r
    r = r * r if squarings > 3 else r
    r = r * r if squarings > 4 else r
    return r * r if squarings > 5 else r


# ------------------------------------------------------------------------------- derivatives


@lane_helper()
def shape_wall(f: float, slim: float) -> tuple[float, float, float]:
    """Raise f · slim to the power of 16; also its derivatives by f."""
    r = f * slim
    r2 = r * r
    r4 = r2 * r2
    r8 = r4 * r4
    r14 = r8 * r4 * r2
    return r14 * r2, 16.0 * slim * (r14 * r), 240.0 * slim * slim * r14


@lane_helper()
def _add_shape(
    n: Quadratic,
    det: Linear,
    slim: float,
    mean_weight: float,
    walled: bool,
    s: FloatArray,
    i: int,
) -> None:
    """Add a corner's shape energy and, if `walled`, the wall on it, with their derivatives."""
    inv, f, fx, fy = quotient(n, det)
    weight = mean_weight
    s[ENERGY + i] += mean_weight * f
    if walled:
        high, slope, second = shape_wall(f, slim)
        weight += slope
        s[ENERGY + i] += high
        s[HXX + i] += second * fx * fx
        s[HXY + i] += second * fx * fy
        s[HYY + i] += second * fy * fy
    s[GX + i] += weight * fx
    s[GY + i] += weight * fy
    xx, xy, yy = hessian(n.second, fx, fy, det)
    weight *= inv
    s[HXX + i] += weight * xx
    s[HXY + i] += weight * xy
    s[HYY + i] += weight * yy


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
    high = power(g * scale, terms.squarings)
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


# `walled` is a constant where these are called: what it rules out is not compiled.


@lane_helper()
def _add_quad(
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
    weight, scale = terms.mean_weight, terms.scale
    px, py = s[X + i], s[Y + i]
    ax, ay = star[k + i] - px, star[k + ROW + i] - py
    bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
    cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
    va, vc = half_square(ax, ay), half_square(cx, cy)
    det = determinant(ax, ay, cx, cy)
    _add_shape(rectangle_numerator(m11, m22, va, vc), det, slim, weight, walled, s, i)
    if walled:
        _add_wall(det, va, vc, scale, terms, s, i)
    # At the neighbouring corners the sides of a rectangle change places.
    ex, ey = bx - ax, by - ay
    ab, det = fixed_half_square(ex, ey), determinant_to_previous(ex, ey, -ax, -ay)
    _add_shape(rectangle_numerator(m22, m11, ab, va), det, slim, weight, walled, s, i)
    if walled:
        _add_wall(det, ab, va, scale, terms, s, i)
    ex, ey = bx - cx, by - cy
    cb, det = fixed_half_square(ex, ey), determinant_to_next(-cx, -cy, ex, ey)
    _add_shape(rectangle_numerator(m22, m11, vc, cb), det, slim, weight, walled, s, i)
    if walled:
        _add_wall(det, vc, cb, scale, terms, s, i)


@lane_helper()
def _add_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    i: int,
    target: Target,
    slim: float,
    terms: Terms,
    walled: bool,
) -> None:
    px, py = s[X + i], s[Y + i]
    ax, ay = star[k + i] - px, star[k + ROW + i] - py
    cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
    va, vc = half_square(ax, ay), half_square(cx, cy)
    # One determinant and one shape energy for the triangle, and a badness at each corner.
    det = determinant(ax, ay, cx, cy)
    shape = numerator(target, va, dot(ax, ay, cx, cy), vc)
    _add_shape(shape, det, slim, terms.mean_weight, walled, s, i)
    if walled:
        ac = fixed_half_square(cx - ax, cy - ay)
        # The sine of 60 degrees is ideal in triangles.
        scale = terms.scale * SINE_60
        _add_wall(det, va, vc, scale, terms, s, i)
        _add_wall(det, ac, va, scale, terms, s, i)
        _add_wall(det, ac, vc, scale, terms, s, i)


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
    """Add the shape energy of a quad of each star, and its derivatives."""
    m11s, _, m22s = rows
    for i in range(n):
        _add_quad(star, s, k, i, m11s[row + i], m22s[row + i], 0.0, terms, False)


@helper()
def add_walled_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    walls: WallArrays,
    wall_row: int,
    terms: Terms,
) -> None:
    """Add shape energy and walls of a quad of each star, and their derivatives."""
    m11s, _, m22s = rows
    slims, nears = walls
    for i in range(n):
        _add_quad(
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
def add_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add the shape energy of a triangle of each star, and its derivatives."""
    m11s, m12s, m22s = rows
    for i in range(n):
        target = Target(m11s[row + i], m12s[row + i], m22s[row + i])
        _add_triangle(star, s, k, i, target, 0.0, terms, False)


@helper()
def add_walled_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    walls: WallArrays,
    wall_row: int,
    terms: Terms,
) -> None:
    """Add shape energy and walls of a triangle of each star, and their derivatives."""
    m11s, m12s, m22s = rows
    slims, nears = walls
    for i in range(n):
        target = Target(m11s[row + i], m12s[row + i], m22s[row + i])
        _add_triangle(
            star, s, k, i, target, slims[wall_row + i], nearer(terms, nears[wall_row + i]), True
        )


@lane_helper()
def _add_size(
    det: Linear, area: float, inv_area: float, weight: float, s: FloatArray, i: int
) -> None:
    """Add weight · ½ (τ − 1/τ)² with τ = det / area, and its derivatives."""
    tau, back = det.value * inv_area, area / det.value
    square = back * back
    slope = weight * (tau - back * square) * inv_area
    second = weight * (1.0 + 3.0 * square * square) * inv_area * inv_area
    s[ENERGY + i] += 0.5 * weight * (tau - back) * (tau - back)
    s[GX + i] += slope * det.x
    s[GY + i] += slope * det.y
    s[HXX + i] += second * det.x * det.x
    s[HXY + i] += second * det.x * det.y
    s[HYY + i] += second * det.y * det.y


@helper()
def add_quad_size(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add the size term of a quad of each star, and its derivatives."""
    areas, inv_areas, weights = rows
    for i in range(n):
        area, inv_area = areas[row + i], inv_areas[row + i]
        weight = terms.mean_weight * weights[row + i]
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        _add_size(determinant(ax, ay, cx, cy), area, inv_area, weight, s, i)
        det = determinant_to_previous(bx - ax, by - ay, -ax, -ay)
        _add_size(det, area, inv_area, weight, s, i)
        det = determinant_to_next(-cx, -cy, bx - cx, by - cy)
        _add_size(det, area, inv_area, weight, s, i)


@helper()
def add_triangle_size(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: RowArrays,
    row: int,
    terms: Terms,
) -> None:
    """Add the size term of a triangle of each star, and its derivatives."""
    areas, inv_areas, weights = rows
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        weight = terms.mean_weight * weights[row + i]
        det = determinant(ax, ay, cx, cy)
        _add_size(det, areas[row + i], inv_areas[row + i], weight, s, i)
