"""The shape energy of a corner and its derivatives: for sweeps, metric and global Hessian alike.

A corner with edge vectors u to its next vertex and w to its previous one has the energy

    f = (m11 |u|² + 2 m12 u·w + m22 |w|²) / (2 det(u, w)),    m11 m22 − m12² = 1,

which is 1 where the corner has its target shape, however large and however turned, larger
elsewhere, and infinite where it is flat. Any target is possible; see `Target`.

To the one vertex that moves in a sweep the numerator is a quadratic function and the determinant a
linear one. What a sweep needs of them, value and derivatives, is passed on as `Quadratic` and
`Linear`.

P. M. Knupp, "Algebraic mesh quality metrics", SIAM J. Sci. Comput. 23 (2001): f = |T|² / (2 det T)
with T = A W⁻¹, A = (u, w) and W the same of the target.
"""

import math
from typing import NamedTuple

from qsmooth.kernels._jit import lane_helper

INV_ROOT3 = 1.0 / math.sqrt(3.0)


class Target(NamedTuple):
    """The shape that a corner is meant to have, with m11 m22 − m12² = 1.

    With target edge vectors p and q of a corner of area det(p, q) = d, m11 is |q|² / d, m12 is
    −p·q / d and m22 is |p|² / d: (1 / ρ, 0, ρ) for a rectangle with |p| = ρ |q|. Seen from the
    cell's other corners, u and w may have to change places.
    """

    m11: float
    m12: float
    m22: float


SQUARE = Target(1.0, 0.0, 1.0)
EQUILATERAL = Target(2.0 * INV_ROOT3, -INV_ROOT3, 2.0 * INV_ROOT3)


class Quadratic(NamedTuple):
    """A quadratic function of the place of the vertex that moves, as seen from where it is.

    Its Hessian is `second` times the identity.
    """

    value: float
    x: float
    y: float
    second: float


class Linear(NamedTuple):
    """A linear function of the place of the vertex that moves: its value and gradient."""

    value: float
    x: float
    y: float


# ------------------------------------------------------------------------------- the numerator


@lane_helper()
def half_square(x: float, y: float) -> Quadratic:
    """½ |e|² of an edge e = (x, y) from the vertex that moves, or with −e to it."""
    return Quadratic(0.5 * (x * x + y * y), -x, -y, 1.0)


@lane_helper()
def fixed_half_square(x: float, y: float) -> Quadratic:
    """½ |e|² of an edge that does not change."""
    return Quadratic(0.5 * (x * x + y * y), 0.0, 0.0, 0.0)


@lane_helper()
def dot(ux: float, uy: float, wx: float, wy: float) -> Quadratic:
    """u·w of two edges from the vertex that moves."""
    return Quadratic(ux * wx + uy * wy, -(ux + wx), -(uy + wy), 2.0)


@lane_helper()
def numerator(target: Target, uu: Quadratic, uw: Quadratic, ww: Quadratic) -> Quadratic:
    """½ (m11 |u|² + 2 m12 u·w + m22 |w|²), of ½ |u|², u·w and ½ |w|²."""
    m11, m12, m22 = target
    return Quadratic(
        m11 * uu.value + m12 * uw.value + m22 * ww.value,
        m11 * uu.x + m12 * uw.x + m22 * ww.x,
        m11 * uu.y + m12 * uw.y + m22 * ww.y,
        m11 * uu.second + m12 * uw.second + m22 * ww.second,
    )


@lane_helper()
def square_numerator(uu: Quadratic, ww: Quadratic) -> Quadratic:
    """Give the numerator for `SQUARE`, of ½ |u|² and ½ |w|²."""
    return Quadratic(uu.value + ww.value, uu.x + ww.x, uu.y + ww.y, uu.second + ww.second)


@lane_helper()
def rectangle_numerator(m11: float, m22: float, uu: Quadratic, ww: Quadratic) -> Quadratic:
    """Give the numerator for a rectangle, of ½ |u|² and ½ |w|²; m12 is 0."""
    return Quadratic(
        m11 * uu.value + m22 * ww.value,
        m11 * uu.x + m22 * ww.x,
        m11 * uu.y + m22 * ww.y,
        m11 * uu.second + m22 * ww.second,
    )


@lane_helper()
def equilateral_numerator(uu: Quadratic, ww: Quadratic, ee: Quadratic) -> Quadratic:
    """Give the numerator for `EQUILATERAL`, of half the squares of all three edges.

    As |w − u|² = |u|² − 2 u·w + |w|², it is the same at each corner of a triangle.
    """
    return Quadratic(
        INV_ROOT3 * (uu.value + ww.value + ee.value),
        INV_ROOT3 * (uu.x + ww.x + ee.x),
        INV_ROOT3 * (uu.y + ww.y + ee.y),
        INV_ROOT3 * (uu.second + ww.second + ee.second),
    )


# ------------------------------------------------------------------------------- the determinant


@lane_helper()
def determinant(ux: float, uy: float, wx: float, wy: float) -> Linear:
    """det(u, w) of two edges from the vertex that moves."""
    return Linear(ux * wy - uy * wx, uy - wy, wx - ux)


@lane_helper()
def determinant_to_next(ux: float, uy: float, ex: float, ey: float) -> Linear:
    """det(u, e) at a corner whose next vertex moves, and whose edge e does not."""
    return Linear(ux * ey - uy * ex, ey, -ex)


@lane_helper()
def determinant_to_previous(ex: float, ey: float, wx: float, wy: float) -> Linear:
    """det(e, w) at a corner whose previous vertex moves, and whose edge e does not."""
    return Linear(ex * wy - ey * wx, -ey, ex)


# ------------------------------------------------------------------------------- their quotient


@lane_helper()
def quotient(n: Quadratic, det: Linear) -> tuple[float, float, float, float]:
    """One over det, the energy f = n / det, and the gradient of f."""
    inv = 1.0 / det.value
    f = n.value * inv
    return inv, f, (n.x - f * det.x) * inv, (n.y - f * det.y) * inv


@lane_helper()
def hessian(second: float, x: float, y: float, det: Linear) -> tuple[float, float, float]:
    """Hessian of a quotient n / det, times det: xx, xy, yy.

    It is ∇²n − ∇f ∇detᵀ − ∇det ∇fᵀ, with ∇²n = `second` times the identity and ∇f = (x, y).
    """
    return (
        second - 2.0 * x * det.x,
        -(x * det.y + y * det.x),
        second - 2.0 * y * det.y,
    )


# ------------------------------------------------------------------------------- nothing moves


@lane_helper()
def corner_shape(target: Target, ux: float, uy: float, wx: float, wy: float) -> tuple[float, float]:
    """Numerator and determinant of the energy of a corner."""
    uu, ww = half_square(ux, uy), half_square(wx, wy)
    shape = numerator(target, uu, dot(ux, uy, wx, wy), ww)
    return shape.value, determinant(ux, uy, wx, wy).value


@lane_helper()
def ideal_corner_shape(
    is_triangle: bool, ux: float, uy: float, wx: float, wy: float
) -> tuple[float, float]:
    """Do as `corner_shape` for an equilateral triangle, else a square.

    With the general form the metric `shape` took 15 % longer for quads, 5 % for triangles.
    """
    uu, ww = half_square(ux, uy), half_square(wx, wy)
    if is_triangle:
        shape = equilateral_numerator(uu, ww, half_square(wx - ux, wy - uy))
    else:
        shape = square_numerator(uu, ww)
    return shape.value, determinant(ux, uy, wx, wy).value
