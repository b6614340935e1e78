"""Sums that do not depend on order."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qsmooth.sums import exact_mean, exact_sum


@pytest.mark.nojit
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=40))
def test_a_sum_is_rounded_once(values):
    exact = sum(map(Fraction, values), Fraction(0))
    try:
        expected = float(exact)
    except OverflowError:
        expected = math.inf if exact > 0 else -math.inf
    assert exact_sum(np.array(values, float)) == expected


def test_a_sum_does_not_depend_on_order():
    rng = np.random.default_rng(0)
    values = rng.lognormal(sigma=12.0, size=50_000) * rng.choice([-1.0, 1.0], 50_000)
    expected = math.fsum(values)
    for _ in range(3):
        assert exact_sum(rng.permutation(values)) == expected
    assert exact_sum(values.reshape(2, -1).T) == expected
    assert exact_mean(values) == expected / values.size


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([], 0.0),
        ([0.0, -0.0], 0.0),
        ([1e308, 1e308], math.inf),
        ([1e308, 1e308, -1e308], 1e308),
        ([5e-324, 5e-324], 1e-323),
        ([1.0, math.inf], math.inf),
        ([math.inf, -math.inf], math.nan),
        ([1.0, math.nan], math.nan),
    ],
)
def test_sums_at_the_ends_of_the_range(values, expected):
    found = exact_sum(np.array(values))
    assert found == expected or (math.isnan(found) and math.isnan(expected))


@pytest.mark.nojit
def test_the_mean_of_nothing_is_no_number():
    assert math.isnan(exact_mean(np.empty(0)))
    assert exact_mean(np.array([1.0, 2.0])) == 1.5
