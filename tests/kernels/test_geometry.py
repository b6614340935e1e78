"""Exact signs and certificates against fractions; scalar helpers by hand."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import reference
from qsmooth.kernels import geometry

UNIT = 2.0**-53


def exact_sign(*xy):
    a, b, c = (complex(xy[i], xy[i + 1]) for i in (0, 2, 4))
    return reference.sign(a, b, c)


@st.composite
def nearly_straight(draw):
    """Three points as good as on a line: where floating point cannot tell."""
    base = draw(st.sampled_from([0.0, 0.5, 1.0, 12.0, 1e-3, 6e6, 1e15]))
    size = draw(st.sampled_from([1.0, 1e-6, 24.0, 1e9, 1.0 / 3.0]))
    t = draw(st.floats(-2.0, 2.0))
    dx, dy = draw(st.floats(-1.0, 1.0)), draw(st.floats(-1.0, 1.0))
    ulps = draw(st.lists(st.integers(-3, 3), min_size=6, max_size=6))
    ax, ay = base, base
    bx, by = base + size * dx, base + size * dy
    cx, cy = ax + t * (bx - ax), ay + t * (by - ay)
    return [x + n * math.ulp(x) for x, n in zip((ax, ay, bx, by, cx, cy), ulps, strict=True)]


def ordinary_float(x):
    return x == 0.0 or 1e-60 < abs(x) < 1e60


coordinates = st.floats(-1e60, 1e60).filter(ordinary_float)


@pytest.mark.nojit
@given(nearly_straight())
@settings(max_examples=400)
@example([0.5, 0.5, 12.0, 12.0, 24.0, 24.0])
@example([0.5 + UNIT, 0.5, 12.0, 12.0, 24.0, 24.0])
@example([6e6, 6e6, 6e6 + 1.0, 6e6 + 1.0, 6e6 + 0.5, 6e6 + 0.5 + 2.0**-30])
def test_orientation_has_the_exact_sign_where_points_are_nearly_on_a_line(xy):
    sign = exact_sign(*xy)
    assert geometry.orientation(*xy) == sign
    if geometry.certainly_left(*xy):
        assert sign == 1
    if geometry.certainly_left(*xy[2:4], *xy[0:2], *xy[4:6]):
        assert sign == -1


@pytest.mark.nojit
@given(st.lists(coordinates, min_size=6, max_size=6))
@settings(max_examples=200)
@example([0.0] * 6)
@example([1e-60, 0.0, 0.0, 1e-60, 0.0, 0.0])
@example([1e60, 1e-60, -1e60, 1e-60, 3.0, 1e-60])
def test_orientation_has_the_exact_sign_of_any_three_points(xy):
    assert geometry.orientation(*xy) == exact_sign(*xy)
    if geometry.certainly_left(*xy):
        assert exact_sign(*xy) == 1


@pytest.mark.nojit
@given(st.lists(st.integers(-3, 3), min_size=6, max_size=6), st.integers(-200, 200))
def test_small_integers_times_any_power_of_two(xy, power):
    xy = [math.ldexp(x, power) for x in xy]
    sign = exact_sign(*xy)
    assert geometry.orientation(*xy) == sign
    assert geometry.certainly_left(*xy) == (sign > 0)


@pytest.mark.nojit
@given(nearly_straight())
@settings(max_examples=100)
def test_orientation_turns_with_its_points(xy):
    a, b, c = xy[0:2], xy[2:4], xy[4:6]
    sign = geometry.orientation(*a, *b, *c)
    assert geometry.orientation(*b, *c, *a) == sign
    assert geometry.orientation(*b, *a, *c) == -sign


@pytest.mark.nojit
@pytest.mark.parametrize("bad", range(6))
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_nothing_is_certain_of_a_coordinate_that_is_not_finite(bad, value):
    xy = [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]
    assert geometry.certainly_left(*xy)
    xy[bad] = value
    with np.errstate(invalid="ignore"):
        assert not geometry.certainly_left(*xy) or value == math.inf


@pytest.mark.nojit
def test_the_filter_alone_is_not_enough():
    # Shewchuk's example: the rounded determinant of these is 0 or of the wrong sign.
    wrong = 0
    for i in range(0, 64, 7):
        for j in range(0, 64, 5):
            xy = (0.5 + i * UNIT, 0.5 + j * UNIT, 12.0, 12.0, 24.0, 24.0)
            rounded = np.sign((xy[0] - 24.0) * (xy[3] - 24.0) - (xy[1] - 24.0) * (xy[2] - 24.0))
            wrong += rounded != exact_sign(*xy)
            assert geometry.orientation(*xy) == exact_sign(*xy)
    assert wrong


@pytest.mark.nojit
def test_scalar_helpers_by_hand():
    assert geometry.distance(1.0, 2.0, 4.0, 6.0) == 5.0
    assert geometry.corner_jacobian(1.0, 1.0, 3.0, 1.0, 1.0, 4.0) == 6.0
    assert geometry.corner_dot(0.0, 0.0, 3.0, 4.0, 4.0, 3.0) == 24.0
    assert geometry.sine(3.0, 2.0, 3.0) == 0.5
    assert geometry.sine(0.0, 0.0, 3.0) == 0.0
    assert math.isnan(geometry.sine(math.nan, 1.0, 1.0))


@pytest.mark.nojit
@given(st.lists(st.floats(-10.0, 10.0), min_size=8, max_size=8))
@settings(max_examples=100)
def test_a_quad_scores_the_same_bits_from_whichever_corner_it_starts(xy):
    assume(len({tuple(xy[i : i + 2]) for i in (0, 2, 4, 6)}) == 4)
    score = geometry.quad_scaled_jacobian(*xy)
    for start in (2, 4, 6):
        assert geometry.quad_scaled_jacobian(*xy[start:], *xy[:start]) == score
    score = geometry.triangle_scaled_jacobian(*xy[:6])
    for start in (2, 4):
        assert geometry.triangle_scaled_jacobian(*xy[start:6], *xy[:start]) == score
