"""Scalar geometry: orientation with certificates, corner angles, cell quality."""

import math

import numpy as np

from qsmooth.kernels._jit import helper, strict_helper

# Forward error bound of the orientation determinant, relative to the sum of its products'
# absolute values: J. R. Shewchuk, "Adaptive precision floating-point arithmetic and fast robust
# geometric predicates", Discrete & Computational Geometry 18 (1997), the constant ccwerrboundA.
ORIENTATION_BOUND = (3.0 + 16.0 * 2.0**-53) * 2.0**-53
# Products that underflow add an error of their own, of half the smallest number each.
UNDERFLOW_BOUND = 1e-322
# Splits a double into two halves of 26 bits, whose products are exact (Dekker 1971).
SPLITTER = 2.0**27 + 1.0
# An equilateral triangle has corners of 60 degrees; this lifts their sine to a score of one.
TRIANGLE_SCALE = 2.0 / math.sqrt(3.0)


@strict_helper()
def certainly_positive(left: float, right: float) -> bool:
    """Whether left - right, the rounded products of a determinant, is positive in any rounding."""
    bound = ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND
    return bool(left - right > bound)


@strict_helper()
def certainly_left(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> bool:
    """Whether a, b, c turn left beyond any rounding error; False when unsure."""
    return certainly_positive((ax - cx) * (by - cy), (ay - cy) * (bx - cx))


@strict_helper()
def two_sum(a: float, b: float) -> tuple[float, float]:
    """Add exactly: the rounded sum and its error (Knuth)."""
    total = a + b
    b_part = total - a
    return total, (a - (total - b_part)) + (b - b_part)


@strict_helper()
def two_product(a: float, b: float) -> tuple[float, float]:
    """Multiply exactly: the rounded product and its error (Dekker)."""
    product = a * b
    t = SPLITTER * a
    a_high = t - (t - a)
    a_low = a - a_high
    t = SPLITTER * b
    b_high = t - (t - b)
    b_low = b - b_high
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, error


@strict_helper()
def _exact_orientation(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Sign of the orientation determinant in exact arithmetic.

    The determinant written out has six products of coordinates; each is exactly the sum of two
    doubles, and the twelve are added without error into an expansion whose largest part has the
    sign. Scaling by a power of two first keeps the products clear of overflow and underflow.
    """
    largest = max(abs(ax), abs(ay), abs(bx), abs(by), abs(cx), abs(cy))
    if largest == 0.0:
        return 0
    # To about 2^500: as far from overflow of the products as from underflow.
    scale = math.ldexp(1.0, min(1000, 500 - math.frexp(largest)[1]))
    ax, ay, bx, by, cx, cy = (
        ax * scale, ay * scale, bx * scale, by * scale, cx * scale, cy * scale
    )  # fmt: skip
    expansion = np.zeros(12)
    size = 0
    for k in range(6):
        if k == 0:
            high, low = two_product(ax, by)
        elif k == 1:
            high, low = two_product(-ay, bx)
        elif k == 2:
            high, low = two_product(bx, cy)
        elif k == 3:
            high, low = two_product(-by, cx)
        elif k == 4:
            high, low = two_product(cx, ay)
        else:
            high, low = two_product(-cy, ax)
        for part in range(2):
            carry = low if part == 0 else high
            for i in range(size):
                carry, expansion[i] = two_sum(carry, expansion[i])
            expansion[size] = carry
            size += 1
    for i in range(size - 1, -1, -1):
        if expansion[i] > 0.0:
            return 1
        if expansion[i] < 0.0:
            return -1
    return 0


@strict_helper()
def orientation(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Exact sign of the turn a, b, c: 1 to the left, -1 to the right, 0 straight."""
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    det = left - right
    bound = ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND
    if det > bound:
        return 1
    if det < -bound:
        return -1
    return _exact_orientation(ax, ay, bx, by, cx, cy)


@helper()
def distance(ax: float, ay: float, bx: float, by: float) -> float:
    """Length of the edge from a to b."""
    return math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))


@helper()
def share(move: float, shortest: float) -> float:
    """What share of the shortest edge a move is; infinite where that has no length."""
    if move == 0.0:
        return 0.0
    return np.inf if shortest == 0.0 else move / shortest


@helper()
def corner_jacobian(ax: float, ay: float, bx: float, by: float, dx: float, dy: float) -> float:
    """Twice the signed area at corner a between its next vertex b and its previous vertex d."""
    return (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)


@helper()
def corner_dot(ax: float, ay: float, bx: float, by: float, dx: float, dy: float) -> float:
    """Dot product of the two edges at corner a."""
    return (bx - ax) * (dx - ax) + (by - ay) * (dy - ay)


@helper()
def sine(jacobian: float, length: float, other_length: float) -> float:
    """Sine of a corner; 0 where an edge has no length, NaN where a coordinate is NaN."""
    product = length * other_length
    return 0.0 if product == 0.0 else jacobian / product


@helper()
def quad_scaled_jacobian(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> float:
    """Score a quad by its worst corner's sine; the same bits from whichever corner it starts."""
    ab = distance(ax, ay, bx, by)
    bc = distance(bx, by, cx, cy)
    cd = distance(cx, cy, dx, dy)
    da = distance(dx, dy, ax, ay)
    worst = sine(corner_jacobian(ax, ay, bx, by, dx, dy), ab, da)
    worst = np.minimum(worst, sine(corner_jacobian(bx, by, cx, cy, ax, ay), bc, ab))
    worst = np.minimum(worst, sine(corner_jacobian(cx, cy, dx, dy, bx, by), cd, bc))
    worst = np.minimum(worst, sine(corner_jacobian(dx, dy, ax, ay, cx, cy), da, cd))
    return float(worst)


@helper()
def triangle_scaled_jacobian(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> float:
    """Score a triangle by its worst corner's sine over that of 60 degrees."""
    ab = distance(ax, ay, bx, by)
    bc = distance(bx, by, cx, cy)
    ca = distance(cx, cy, ax, ay)
    worst = sine(corner_jacobian(ax, ay, bx, by, cx, cy), ab, ca)
    worst = np.minimum(worst, sine(corner_jacobian(bx, by, cx, cy, ax, ay), bc, ab))
    worst = np.minimum(worst, sine(corner_jacobian(cx, cy, ax, ay, bx, by), ca, bc))
    return float(worst) * TRIANGLE_SCALE
