"""Confining: the allowed place nearest to a proposed one, exactly within reach."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qsmooth.kernels.confining import confine, confine_places, tangent
from qsmooth.kernels.rails import FREE, Rails

lengths = st.floats(1e-9, 1e9)
places = st.floats(-1e9, 1e9)


def rails(origin, reach=math.inf, direction=(math.nan, math.nan)):
    return Rails(np.array([origin], float), np.array([reach]), np.array([direction], float))


def exact_distance(a, b):
    """Square of the distance of two places, without rounding."""
    return sum((Fraction(p) - Fraction(q)) ** 2 for p, q in zip(a, b, strict=True))


@pytest.mark.nojit
def test_the_nearest_place_of_a_disc_of_a_line_and_of_a_piece_of_one():
    assert confine(0, 3.0, 4.0, rails((0, 0), 5.1)) == (3.0, 4.0)
    assert confine(0, 3.0, 4.0, rails((0, 0), 2.5)) == pytest.approx((1.5, 2.0), rel=1e-13)
    assert confine(0, 3.0, 4.0, rails((1, 1), direction=(0, 1))) == (1.0, 4.0)
    assert confine(0, 3.0, 4.0, rails((1, 1), 2.0, (0, 1))) == pytest.approx((1.0, 3.0), rel=1e-13)
    assert confine(0, 2.0, 0.0, rails((0, 0), direction=(0.6, 0.8))) == pytest.approx((0.72, 0.96))


@pytest.mark.nojit
@pytest.mark.parametrize("place", [(math.nan, 1.0), (math.inf, 1.0), (-math.inf, math.inf)])
def test_from_no_place_a_vertex_with_a_reach_goes_back_to_where_it_was(place):
    assert confine(0, *place, rails((2, 3), 1.0)) == (2.0, 3.0)


@given(st.tuples(places, places), st.tuples(places, places), lengths)
def test_no_place_is_beyond_its_reach_however_that_is_measured(origin, place, reach):
    found = confine(0, *place, rails(origin, reach))
    assert exact_distance(found, origin) <= Fraction(reach) ** 2
    assert np.linalg.norm(np.subtract(found, origin)) <= reach
    assert math.hypot(found[0] - origin[0], found[1] - origin[1]) <= reach
    if math.dist(origin, place) <= 0.999 * reach:
        assert found == place
    # As near to the end of its reach as places can be stored.
    else:
        ulp = math.ulp(max(map(abs, (*origin, *found))))
        assert math.dist(found, origin) >= 0.998 * reach - 4.0 * ulp


@given(st.tuples(places, places), st.tuples(places, places), lengths, st.floats(0.0, 6.3))
def test_places_are_on_the_line_up_to_rounding(origin, place, reach, angle):
    ux, uy = math.cos(angle), math.sin(angle)
    x, y = confine(0, *place, rails(origin, reach, (ux, uy)))
    ulp = math.ulp(max(map(abs, (*origin, x, y))))
    assert abs((x - origin[0]) * uy - (y - origin[1]) * ux) <= 2.0 * ulp
    assert exact_distance((x, y), origin) <= Fraction(reach) ** 2


@pytest.mark.nojit
def test_what_is_left_of_a_way_downhill():
    assert tangent(0, 1.0, 0.0, -1.0, 0.5, rails((0, 0), direction=(0, 1)))[:2] == (0.0, 1.0)
    assert tangent(0, 0.5, 0.0, -1.0, 0.5, rails((0, 0), 1.0)) == (0.0, 0.0, 0.0)
    assert tangent(0, 1.0, 0.0, 1.0, 0.5, rails((0, 0), 1.0)) == (0.0, 0.0, 0.0)  # inwards
    tx, ty, bend = tangent(0, 2.0, 0.0, -3.0, 0.5, rails((0, 0), 2.0))
    assert (tx, abs(ty), bend) == (0.0, 1.0, 1.5)


@pytest.mark.nojit
def test_only_the_listed_vertices_are_put_back():
    xy = np.array([[0.0, 0.0], [5.0, 0.0], [9.0, 0.0]])
    held = Rails(np.zeros((3, 2)), np.array([1.0, 2.0, 3.0]), np.full((3, 2), np.nan))
    confine_places(xy, np.array([1], np.uint32), held)
    assert xy[[0, 2]].tolist() == [[0.0, 0.0], [9.0, 0.0]]
    assert xy[1] == pytest.approx([2.0, 0.0], rel=1e-13)
    assert not FREE.origin.size
