"""Small algebra of targets: matrices of two rows, many at a time, by their entries."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from qsmooth._types import FloatArray, IndexArray

Range: TypeAlias = tuple[float, float]

ROOT3 = math.sqrt(3.0)
# Coefficients m11, m12, m22 of `corner_energy.Target`.
SQUARE = np.array([1.0, 0.0, 1.0])
EQUILATERAL = np.array([2.0 / ROOT3, -1.0 / ROOT3, 2.0 / ROOT3])


def step(x: FloatArray, limits: Range) -> FloatArray:
    """Smooth step from 0 at the first limit to 1 at the second, which may be the smaller."""
    t = np.clip((x - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def dots(u: FloatArray, w: FloatArray) -> FloatArray:
    """Dot products of rows."""
    return np.asarray(u[:, 0] * w[:, 0] + u[:, 1] * w[:, 1])


def sums(u: FloatArray, w: FloatArray, i: int, j: int) -> FloatArray:
    """Entry i, j of A Aᵀ with A = (u, w)."""
    return np.asarray(u[:, i] * u[:, j] + w[:, i] * w[:, j])


def rectangle_corners(log_ratio: FloatArray) -> FloatArray:
    """Coefficients at the four corners of rectangles, log |side 0| / |side 1| given: (m, 4, 3)."""
    out = np.zeros((log_ratio.size, 4, 3))
    ratio, inverse = np.exp(log_ratio), np.exp(-log_ratio)
    out[:, 0::2, 0] = out[:, 1::2, 2] = inverse[:, None]
    out[:, 1::2, 0] = out[:, 0::2, 2] = ratio[:, None]
    return out


def half_rectangle(log_ratio: FloatArray, position: IndexArray) -> FloatArray:
    """Coefficients at the first corner of a triangle that is half a rectangle: (m, 3).

    Its legs are sides `position` and `position` + 1, (m,), and the former is as many times as long
    as the latter.
    """
    ratio, inverse = np.exp(log_ratio), np.exp(-log_ratio)
    zero, both = np.zeros(log_ratio.size), ratio + inverse
    # At the corner that the first leg starts from, at the right angle, and at the last.
    by_corner = np.stack(
        [
            np.stack([both, -ratio, ratio], axis=1),
            np.stack([ratio, zero, inverse], axis=1),
            np.stack([inverse, -inverse, both], axis=1),
        ]
    )
    return np.asarray(by_corner[-position % 3, np.arange(log_ratio.size)])


def corners_of_triangle(m: FloatArray) -> FloatArray:
    """Coefficients at all corners from those at the first: (m, 3) → (m, 3, 3).

    The numerator of f is the same at each: with edges a + b + c = 0, u = a and w = −c at the first
    corner, u = b and w = −a at the second.
    """
    out = np.empty((len(m), 3, 3))
    out[:, 0] = m
    for k in (1, 2):
        m11, m12, m22 = out[:, k - 1].T
        # u = −w', w = u' − w' with u', w' the edges at the next corner.
        out[:, k] = np.stack([m22, -m12 - m22, m11 + 2.0 * m12 + m22], axis=1)
    return out


def log_from_equilateral(m: FloatArray) -> FloatArray:
    """Logarithm of E^−½ M E^−½, E the equilateral triangle's: half its xx − yy, and its xy."""
    return unit_log(*between(_INVERSE_ROOT, m[:, 0], m[:, 1], m[:, 2]))


def from_log(log: FloatArray) -> FloatArray:
    """Coefficients M of such a logarithm: (m, 2) → (m, 3)."""
    size = np.hypot(log[:, 0], log[:, 1])
    cosh = np.cosh(size)
    factor = np.where(size > 0.0, np.sinh(size) / np.where(size > 0.0, size, 1.0), 1.0)
    half = factor * log[:, 0]
    return np.stack(between(_ROOT, cosh + half, factor * log[:, 1], cosh - half), axis=1)


def between(
    r: tuple[float, float, float], xx: FloatArray, xy: FloatArray, yy: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Entries xx, xy, yy of R N R, R and N symmetric and given by theirs."""
    a, b, c = r
    return (
        a * a * xx + 2.0 * a * b * xy + b * b * yy,
        a * b * xx + (a * c + b * b) * xy + b * c * yy,
        b * b * xx + 2.0 * b * c * xy + c * c * yy,
    )


def unit_log(xx: FloatArray, xy: FloatArray, yy: FloatArray) -> FloatArray:
    """Logarithm of symmetric matrices with determinant one: half its xx − yy, and its xy."""
    half = 0.5 * (xx - yy)
    sinh = np.hypot(half, xy)
    factor = np.where(sinh > 0.0, np.arcsinh(sinh) / np.where(sinh > 0.0, sinh, 1.0), 1.0)
    return np.stack([factor * half, factor * xy], axis=1)


def log_in_plane(u: FloatArray, w: FloatArray, det: FloatArray) -> FloatArray:
    """Logarithm of the metric in which a triangle is equilateral, scaled to determinant one."""
    v = (2.0 * w - u) / ROOT3
    xx, xy, yy = (sums(u, v, i, j) for i, j in ((1, 1), (0, 1), (0, 0)))
    scale = 2.0 / ROOT3 * det
    return unit_log(xx / scale, -xy / scale, yy / scale)


def squared(u: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn vectors to right angles by as much each: lengths in proportion, the same area."""
    lengths = np.hypot(u[:, 0], u[:, 1]), np.hypot(w[:, 0], w[:, 1])
    a, b = u / lengths[0][:, None], w / lengths[1][:, None]
    # The middle of a and of b turned back by a right angle.
    d = a + np.stack([b[:, 1], -b[:, 0]], axis=1)
    d /= np.hypot(d[:, 0], d[:, 1])[:, None]
    sine = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    p, q = (np.sqrt(sine) * length for length in lengths)
    return p[:, None] * d, q[:, None] * np.stack([-d[:, 1], d[:, 0]], axis=1)


def unit_root(m: FloatArray) -> FloatArray:
    """Square root, scaled to determinant one, of symmetric matrices: xx, xy, yy, (m, 3)."""
    root_det = np.sqrt(m[:, 0] * m[:, 2] - m[:, 1] ** 2)
    n = m / root_det[:, None]
    # Cayley and Hamilton: (N + 1)² = (tr N + 2) N where det N = 1.
    n += SQUARE
    return np.asarray(n / np.sqrt(n[:, 0] + n[:, 2])[:, None])


def of_eigenvalues(m: FloatArray, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Apply a function to the eigenvalues of symmetric matrices: xx, xy, yy, (m, 3)."""
    middle, half = 0.5 * (m[:, 0] + m[:, 2]), 0.5 * (m[:, 0] - m[:, 2])
    radius = np.hypot(half, m[:, 1])
    high, low = function(middle + radius), function(middle - radius)
    mean = 0.5 * (high + low)
    factor = np.where(radius > 0.0, 0.5 * (high - low) / np.where(radius > 0.0, radius, 1.0), 0.0)
    return np.stack([mean + factor * half, factor * m[:, 1], mean - factor * half], axis=1)


# Entries xx, xy, yy of E^½ and E^−½, E being EQUILATERAL; the determinant is one.
_ROOT = tuple(unit_root(EQUILATERAL[None])[0].tolist())
_INVERSE_ROOT = (_ROOT[2], -_ROOT[1], _ROOT[0])
