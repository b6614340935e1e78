"""Heights that add up to where the layers lie."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.stacks import WALL_NOISE, match_heights

GROWN = 1.2 ** np.arange(12)


def matched(heights, reference, width=4, walls=(True, False), closed=False):
    n = len(heights)
    out = np.empty(n)
    sheet = np.array([0, n]), np.arange(n), np.array([closed])
    match_heights(*sheet, np.array([walls]), np.array(heights), np.array(reference), width, out)
    return out


def by_definition(heights, reference, i, width, walls):
    """Fit a, b and c in one go, by another way."""
    n = len(heights)
    low, high = max(i - width, 0), min(i + width, n - 1)
    t = (np.arange(n) - i) / (width + 1.0)
    window = slice(low, high + 1)

    def off(x):
        a, b, c = x
        model = reference * np.exp(a + b * t)
        beside = np.minimum(np.append(model, np.inf), np.insert(model, 0, np.inf))
        beside[0] *= WALL_NOISE if walls[0] else 1.0
        beside[n] *= WALL_NOISE if walls[1] else 1.0
        places = np.insert(np.cumsum((heights - model)[window]), 0, 0.0) - c
        at = (np.arange(low, high + 2) - 0.5 - i) / (width + 1.0)
        return places, (1.0 - at**2) / beside[low : high + 2]

    x = np.zeros(3)
    for _ in range(20):  # errors as they are, then what they weigh is fitted
        _, weights = off(x)
        x = least_squares(lambda y, w=weights: off(y)[0] * w, x, x_scale=[1, 1, heights[low]]).x
    return x[0]


@pytest.mark.nojit
@pytest.mark.parametrize("closed", [False, True])
def test_what_is_the_reference_but_for_a_factor_is_found(closed):
    t = np.arange(12.0)
    given = GROWN if not closed else 1.0 + 0.1 * np.sin(t)
    assert matched(given, given, closed=closed) == pytest.approx(np.zeros(12), abs=1e-13)
    assert matched(1.3 * given, given, closed=closed) == pytest.approx(
        np.full(12, np.log(1.3)), abs=1e-6
    )
    if not closed:
        bent = given * np.exp(0.02 * (t - 5.0))
        assert matched(bent, given) == pytest.approx(0.02 * (t - 5.0), abs=1e-6)


@pytest.mark.parametrize("walls", [(True, False), (False, False), (True, True)])
def test_places_are_met_as_by_definition(walls):
    rng = np.random.default_rng(2)
    places = np.insert(np.cumsum(GROWN), 0, 0.0)
    places[1:-1] += 0.1 * rng.uniform(-1, 1, 11) * GROWN[:-1]
    heights = np.diff(places)
    found = matched(heights, GROWN, walls=walls)
    for i in (0, 1, 5, 11):
        expected = by_definition(heights, GROWN, i, 4, walls)
        assert found[i] == pytest.approx(expected, abs=2e-3)


@pytest.mark.nojit
@pytest.mark.parametrize("growth", [1.2, 2.5])
def test_the_way_along_the_sheet_and_the_unit_are_of_no_account(growth):
    rng = np.random.default_rng(5)
    reference = growth ** np.arange(20.0)
    heights = reference * np.exp(0.2 * rng.uniform(-1, 1, 20))
    found = matched(heights, reference, width=8)
    back = matched(heights[::-1], reference[::-1], width=8, walls=(False, True))
    assert back[::-1] == pytest.approx(found, abs=1e-9)
    assert np.array_equal(matched(heights / 1024, reference / 1024, width=8), found)


def test_places_tell_more_than_heights_do():
    rng = np.random.default_rng(0)
    off = []
    for _ in range(200):
        places = np.insert(np.cumsum(GROWN), 0, 0.0)
        places[1:-1] += rng.uniform(-0.35, 0.35, 11) * GROWN[:-1]
        off.append(matched(np.diff(places), GROWN, width=8)[0])
    # The heights themselves are off by .35 / √3 = .20.
    assert np.std(off) < 0.11
    assert abs(np.mean(off)) < 0.02


@pytest.mark.nojit
def test_one_or_two_layers_are_no_trouble():
    assert matched([2.0], [1.0]) == pytest.approx([np.log(2.0)], abs=1e-3)
    assert matched([2.0, 2.0], [1.0, 1.0]) == pytest.approx(np.full(2, np.log(2.0)), abs=1e-3)
    assert np.isfinite(matched([1e-30, 1.0, 1e-30], [1.0, 1e-20, 1.0])).all()
    assert matched([1.0], [1.0], closed=True).tolist() == [0.0]


def test_two_threads_match_the_bits_of_one():
    rng = np.random.default_rng(1)
    heights, found = np.exp(rng.normal(size=300)), []
    sheets = np.arange(0, 301, 30), rng.permutation(300), np.arange(10) % 2 == 0
    walls = np.ones((10, 2), bool)
    for threads in (1, 2):
        with use_threads(threads):
            out = np.empty(300)
            match_heights(*sheets, walls, heights, np.ones(300), 8, out)
            found.append(out.tobytes())
    assert found[0] == found[1]
