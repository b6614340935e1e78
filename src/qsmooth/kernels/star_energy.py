"""The energy of a star, its derivatives and its trials, on blocks of lanes.

What is added up stands in `newton_sweep`; here are the loops over the lanes of a block, for one
cell of each star: what it adds to the energy and its derivatives, and what it says of a trial.

Most blocks ask for little: squares of any size, and no wall before the mean has settled. What a
block asks for beyond that is told by its flags (`blocks.Rows`), and taken from loops of its own; a
branch inside a loop would stop vectorisation.

The energies are rounded as those of `star_trials` are: at rest a vertex would else take a hair of
rounding, raised to the power of 64, for a step that it cannot find.
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
    add_energy,
)

# What the sine of a triangle's corner is at best: it counts as 1.
SINE_60 = math.sqrt(0.75)
# The wall on a cell's shape is of power 2 to this power.
SLIM_SQUARINGS = 4


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
    return r8 * r8, 16.0 * slim * (r14 * r), 240.0 * slim * slim * r14


@lane_helper()
def _badness(
    det_inv: float, dx: float, dy: float, uu: Quadratic, ww: Quadratic, inv_squares: float
) -> tuple[float, float, float, float]:
    """Square of g = |u| |w| / det, gradient of log g, and what of its Hessian is a multiple of one.

    Given are one over det, the gradient of log det, ½ |u|², ½ |w|² and one over their product.
    """
    # |u| |w| / det lies under (|u|² t + |w|² / t) / (2 det) for every t > 0, and touches it at the
    # t = |w| / |u| taken here. That bound is convex: what lowers it lowers the energy. Over g it
    # needs no root.
    half = 0.5 * inv_squares
    return (
        4.0 * uu.value * ww.value * det_inv * det_inv,
        (uu.x * ww.value + ww.x * uu.value) * half - dx,
        (uu.y * ww.value + ww.y * uu.value) * half - dy,
        (uu.second * ww.value + ww.second * uu.value) * half,
    )


@lane_helper()
def _add_wall(
    det_inv: float,
    dx: float,
    dy: float,
    uu: Quadratic,
    ww: Quadratic,
    inv_squares: float,
    scale: float,
    terms: Terms,
    s: FloatArray,
    i: int,
) -> None:
    """Add the wall on a corner's badness, with its derivatives; `scale` is one over the threshold.

    The rest is as in `_badness`.
    """
    gg, lx, ly, diagonal = _badness(det_inv, dx, dy, uu, ww, inv_squares)
    high = power(gg * (scale * scale), terms.squarings - 1)
    first = terms.power * high
    second = (terms.power - 1.0) * first
    mx, my = first * lx, first * ly
    s[ENERGY + i] += high
    s[GX + i] += mx
    s[GY + i] += my
    s[HXX + i] += first * diagonal - 2.0 * mx * dx + second * lx * lx
    s[HXY + i] += second * lx * ly - (mx * dy + my * dx)
    s[HYY + i] += first * diagonal - 2.0 * my * dy + second * ly * ly


@lane_helper()
def _add_walled(
    n: Quadratic,
    det: Linear,
    uu: Quadratic,
    ww: Quadratic,
    slim: float,
    terms: Terms,
    s: FloatArray,
    i: int,
) -> None:
    """Add the shape energy of a quad's corner, the wall on it and that on badness.

    Given are f's numerator, the determinant, and ½ |u|² and ½ |w|² of the edges.
    """
    inv, f, fx, fy = quotient(n, det)
    wall, slope, bend = shape_wall(f, slim)
    weight = terms.mean_weight + slope
    dx, dy = det.x * inv, det.y * inv
    gg, lx, ly, diagonal = _badness(inv, dx, dy, uu, ww, 1.0 / (uu.value * ww.value))
    high = power(gg * (terms.scale * terms.scale), terms.squarings - 1)
    first = terms.power * high
    second = (terms.power - 1.0) * first
    # What the Hessians of quotients have in common: −∇ ∇log detᵀ − ∇log det ∇ᵀ.
    mx, my = weight * fx + first * lx, weight * fy + first * ly
    diagonal = weight * inv * n.second + first * diagonal
    s[ENERGY + i] += terms.mean_weight * f + (wall + high)
    s[GX + i] += mx
    s[GY + i] += my
    s[HXX + i] += diagonal - 2.0 * mx * dx + bend * fx * fx + second * lx * lx
    s[HXY + i] += bend * fx * fy + second * lx * ly - (mx * dy + my * dx)
    s[HYY + i] += diagonal - 2.0 * my * dy + bend * fy * fy + second * ly * ly


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
    """Add a quad; `walled` is a constant to the compiler, which leaves out what it rules out."""
    px, py = s[X + i], s[Y + i]
    ax, ay = star[k + i] - px, star[k + ROW + i] - py
    bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
    cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
    va, vc = half_square(ax, ay), half_square(cx, cy)
    # At the neighbouring corners the sides of a rectangle change places.
    ex, ey, hx, hy = bx - ax, by - ay, bx - cx, by - cy
    ab, cb = fixed_half_square(ex, ey), fixed_half_square(hx, hy)
    at_v, at_a = determinant(ax, ay, cx, cy), determinant_to_previous(ex, ey, -ax, -ay)
    at_c = determinant_to_next(-cx, -cy, hx, hy)
    n_v, n_a = rectangle_numerator(m11, m22, va, vc), rectangle_numerator(m22, m11, ab, va)
    n_c = rectangle_numerator(m22, m11, vc, cb)
    if walled:
        _add_walled(n_v, at_v, va, vc, slim, terms, s, i)
        _add_walled(n_a, at_a, ab, va, slim, terms, s, i)
        _add_walled(n_c, at_c, vc, cb, slim, terms, s, i)
    else:
        add_energy(n_v, at_v, terms.mean_weight, s, i)
        add_energy(n_a, at_a, terms.mean_weight, s, i)
        add_energy(n_c, at_c, terms.mean_weight, s, i)


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
    """Add a triangle: one determinant and one shape energy, and a badness at each corner."""
    px, py = s[X + i], s[Y + i]
    ax, ay = star[k + i] - px, star[k + ROW + i] - py
    cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
    va, vc = half_square(ax, ay), half_square(cx, cy)
    det = determinant(ax, ay, cx, cy)
    n = numerator(target, va, dot(ax, ay, cx, cy), vc)
    if not walled:
        add_energy(n, det, terms.mean_weight, s, i)
    else:
        inv, f, fx, fy = quotient(n, det)
        wall, slope, bend = shape_wall(f, slim)
        weight = terms.mean_weight + slope
        s[ENERGY + i] += terms.mean_weight * f + wall
        s[GX + i] += weight * fx
        s[GY + i] += weight * fy
        xx, xy, yy = hessian(n.second, fx, fy, det)
        weight *= inv
        s[HXX + i] += weight * xx + bend * fx * fx
        s[HXY + i] += weight * xy + bend * fx * fy
        s[HYY + i] += weight * yy + bend * fy * fy
        ac = fixed_half_square(cx - ax, cy - ay)
        dx, dy = det.x * inv, det.y * inv
        all_inv = 1.0 / (va.value * vc.value * ac.value)
        # The sine of 60 degrees is ideal in triangles.
        scale = terms.scale * SINE_60
        _add_wall(inv, dx, dy, va, vc, all_inv * ac.value, scale, terms, s, i)
        _add_wall(inv, dx, dy, ac, va, all_inv * vc.value, scale, terms, s, i)
        _add_wall(inv, dx, dy, ac, vc, all_inv * va.value, scale, terms, s, i)


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
def add_size(
    star: FloatArray,
    s: FloatArray,
    a: int,
    c: int,
    n: int,
    sizes: RowArrays,
    row: int,
    mean_weight: float,
) -> None:
    """Add the size term of a corner of each star, and its derivatives.

    Its determinant is that of the edges to the places in rows a and c, whichever corner it is.
    """
    areas, inv_areas, weights = sizes
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        det = determinant(
            star[a + i] - px, star[a + ROW + i] - py, star[c + i] - px, star[c + ROW + i] - py
        )
        weight = mean_weight * weights[row + i]
        _add_size(det, areas[row + i], inv_areas[row + i], weight, s, i)
