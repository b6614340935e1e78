"""Arctangents, cosines and sines in lanes against those of the standard library."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qsmooth.kernels.trigonometry import arctangent, cosine_and_sine

pytestmark = pytest.mark.nojit


@given(st.floats(-math.pi, math.pi), st.floats(1e-30, 1e30))
def test_arctangent(angle, length):
    y, x = np.float64(length * math.sin(angle)), np.float64(length * math.cos(angle))
    assert arctangent(y, x) == pytest.approx(math.atan2(y, x), rel=4e-16, abs=0.0)


@pytest.mark.parametrize("x", [-2.0, -1.0, -0.0, 0.0, 1.0, 2.0])
@pytest.mark.parametrize("y", [-2.0, -1.0, 1.0, 2.0])
def test_arctangent_where_formulas_meet(y, x):
    assert arctangent(np.float64(y), np.float64(x)) == pytest.approx(math.atan2(y, x), rel=4e-16)


def test_a_vector_of_no_length_has_no_angle():
    assert arctangent(0.0, 0.0) == 0.0


@given(st.floats(-0.5 * math.pi, 0.5 * math.pi))
def test_cosine_and_sine(angle):
    cosine, sine = cosine_and_sine(angle)
    assert cosine == pytest.approx(math.cos(angle), rel=0.0, abs=4e-16)
    assert sine == pytest.approx(math.sin(angle), rel=4e-16, abs=0.0)
