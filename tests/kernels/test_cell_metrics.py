"""Metrics of single cells: by hand, against the reference, and what is not finite."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import reference
from qsmooth.kernels import cell_figures, cell_lanes, cell_metrics

ROOT2, ROOT3 = math.sqrt(2.0), math.sqrt(3.0)
NAN, INF = math.nan, math.inf
# Corners; smallest and largest angle, aspect ratio, scaled Jacobian, shape, area.
CELLS = {
    "square": ([(0, 0), (2, 0), (2, 2), (0, 2)], (90, 90, 1, 1, 1, 4)),
    "rectangle": ([(0, 0), (3, 0), (3, 1), (0, 1)], (90, 90, 3, 1, 0.6, 3)),
    "rhombus of 30°": (
        [(0, 0), (2, 0), (2 + ROOT3, 1), (ROOT3, 1)],
        (30, 150, 1, 0.5, 0.5, 2),
    ),
    "equilateral triangle": ([(0, 0), (2, 0), (1, ROOT3)], (60, 60, 1, 1, 1, ROOT3)),
    "half a square": (
        [(0, 0), (1, 0), (0, 1)],
        (45, 90, ROOT2, ROOT2 / ROOT3, ROOT3 / 2, 0.5),
    ),
    "clockwise square": ([(0, 0), (0, 1), (1, 1), (1, 0)], (270, 270, 1, -1, 0, -1)),
    "clockwise triangle": (
        [(0, 0), (1, ROOT3), (2, 0)],
        (300, 300, 1, -1, 0, -ROOT3),
    ),
    "arrowhead": (
        [(0, 0), (2, -2), (0.5, 0), (2, 2)],
        (math.degrees(math.atan2(4, 3)) - 45, 360 - 2 * math.degrees(math.atan2(4, 3)),
         2 * ROOT2 / 2.5, -0.96, 0, 1),
    ),
    "bow tie": ([(0, 0), (1, 0), (0, 1), (1, 1)], (45, 315, ROOT2, -1 / ROOT2, 0, 0)),
    "flat corner": (
        [(0, 0), (1, 0), (2, 0), (1, 1)],
        (45, 180, ROOT2, 0, 0, 1),
    ),
    "collapsed edge": ([(0, 0), (0, 0), (1, 1), (0, 1)], (0, 90, INF, 0, 0, 0.5)),
    "a point": ([(3, 4)] * 4, (0, 0, INF, 0, 0, 0)),
    "collapsed triangle": ([(0, 0), (1, 0), (3, 0)], (0, 180, 3, 0, 0, 0)),
    "lost corner": ([(0, 0), (1, 0), (NAN, 1), (0, 1)], (NAN,) * 6),
}  # fmt: skip


def measure(xy):
    """Every metric of one cell, in the order of the figures."""
    arguments = np.array(xy, dtype=float), np.array([0, len(xy)]), np.arange(len(xy))
    out, doubtful = np.full((6, 1), -99.0), np.full(1, -99.0)
    cell_figures.cell_figures(*arguments, out, doubtful)
    return out[:, 0]


def classify(xy):
    out = np.full(1, -99)
    arguments = np.array(xy, dtype=float), np.array([0, len(xy)]), np.arange(len(xy))
    cell_metrics.validity(*arguments, out)
    return int(out[0])


@pytest.mark.nojit
@pytest.mark.parametrize(("corners", "expected"), CELLS.values(), ids=CELLS.keys())
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("start", [0, 1, 2])
def test_metrics_of_one_cell_in_any_unit_from_any_corner(corners, expected, unit, start):
    corners = corners[start:] + corners[:start]
    found = measure(unit * np.array(corners, dtype=float))
    expected = np.array(expected) * [1, 1, 1, 1, 1, unit**2]
    assert found[5] == pytest.approx(expected[5], rel=1e-12, abs=1e-12 * unit**2, nan_ok=True)
    assert found[:5] == pytest.approx(expected[:5], rel=1e-12, abs=1e-9, nan_ok=True)


CLASSES = {
    "square": ([(0, 0), (1, 0), (1, 1), (0, 1)], "VALID"),
    "flat corner": ([(0, 0), (1, 0), (2, 0), (1, 1)], "COLLAPSED"),
    "flat by the last bit": ([(0, 0), (1, 2.0**-1074), (2, 0), (1, 1)], "CONCAVE"),
    "convex by the last bit": ([(0, 0), (1, -(2.0**-1074)), (2, 0), (1, 1)], "VALID"),
    "edge of no length": ([(0, 0), (0, 0), (1, 1), (0, 1)], "COLLAPSED"),
    "a point": ([(1, 1)] * 4, "COLLAPSED"),
    "a line": ([(0, 0), (1, 0), (2, 0), (3, 0)], "COLLAPSED"),
    "arrowhead": ([(0, 0), (2, -2), (0.5, 0), (2, 2)], "CONCAVE"),
    "bow tie": ([(0, 0), (1, 0), (0, 1), (1, 1)], "CROSSED"),
    "folded": ([(0, 0), (2, 0), (1, 0), (1, 1)], "CROSSED"),
    "clockwise square": ([(0, 0), (0, 1), (1, 1), (1, 0)], "INVERTED"),
    "clockwise arrowhead": ([(0, 0), (2, 2), (0.5, 0), (2, -2)], "INVERTED"),
    "triangle": ([(0, 0), (1, 0), (0, 1)], "VALID"),
    "flat triangle": ([(0, 0), (1, 0), (2, 0)], "COLLAPSED"),
    "clockwise triangle": ([(0, 0), (0, 1), (1, 0)], "INVERTED"),
}


@pytest.mark.nojit
@pytest.mark.parametrize(("corners", "name"), CLASSES.values(), ids=CLASSES.keys())
@pytest.mark.parametrize("start", [0, 1, 2])
def test_classes_by_hand(corners, name, start):
    corners = corners[start:] + corners[:start]
    assert classify(corners) == getattr(cell_metrics, name)
    assert reference.validity([complex(*p) for p in corners], list(range(len(corners)))) == (
        getattr(cell_metrics, name)
    )


quarter = st.integers(-4, 4).map(lambda k: k / 4.0)
anywhere = st.floats(-10.0, 10.0).filter(lambda x: x == 0.0 or abs(x) > 1e-30)
cells = st.integers(3, 4).flatmap(
    lambda n: st.one_of(
        st.lists(st.tuples(quarter, quarter), min_size=n, max_size=n),
        st.lists(st.tuples(anywhere, anywhere), min_size=n, max_size=n),
    )
)


@pytest.mark.nojit
@given(cells, st.sampled_from([0.0, 6e6, 1.0 / 3.0]))
@settings(max_examples=300)
def test_classes_agree_with_fractions(corners, shift):
    corners = [(x + shift, y - shift) for x, y in corners]
    points = [complex(x, y) for x, y in corners]
    assert classify(corners) == reference.validity(points, list(range(len(corners))))


@pytest.mark.nojit
@given(cells)
@settings(max_examples=300)
def test_metrics_agree_with_the_reference(corners):
    points, cell = [complex(x, y) for x, y in corners], list(range(len(corners)))
    lengths = [abs(points[w] - points[v]) for v, w in reference.sides(cell)]
    assume(all(length == 0.0 or length > 1e-9 for length in lengths))
    found = measure(corners)
    angles = reference.angles(points, cell)
    # An angle that rounding may put on either side of 0° = 360° is left to the tests by hand.
    assume(all(1e-6 < angle < 360.0 - 1e-6 or angle == 0.0 for angle in angles))
    assume(0.0 not in angles or min(lengths) == 0.0)
    expected = (
        min(angles), max(angles), reference.aspect_ratio(points, cell),
        reference.scaled_jacobian(points, cell), reference.shape(points, cell),
        reference.area(points, cell),
    )  # fmt: skip
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


def corner_angle(det, dot):
    return cell_lanes.degrees_of(cell_lanes.diamond_angle(np.float64(det), np.float64(dot)))


@pytest.mark.nojit
@given(st.floats(0.0, 360.0, exclude_max=True), st.floats(1e-3, 1e3))
def test_corner_angles_are_in_one_turn(angle, size):
    radians = math.radians(angle)
    det, dot = size * math.sin(radians), size * math.cos(radians)
    found = corner_angle(det, dot)
    assert 0.0 <= found < 360.0
    assert min(abs(found - angle), 360.0 - abs(found - angle)) < 1e-9
    exact = math.degrees(math.atan2(det, dot)) % 360.0
    assert abs(found - exact) <= 4.0 * math.ulp(max(found, exact)) or exact > 359.9999999999999


@pytest.mark.nojit
@pytest.mark.parametrize("angle", range(0, 360, 45))
def test_eighths_of_a_turn_are_exact(angle):
    det, dot = (round(math.sqrt(2.0) * f(math.radians(angle))) for f in (math.sin, math.cos))
    assert corner_angle(3e-7 * det, 3e-7 * dot) == angle


@pytest.mark.nojit
def test_a_turn_short_of_a_full_one_by_less_than_rounding_is_none():
    assert corner_angle(-1e-300, 1.0) == 0.0
    assert corner_angle(-0.0, 1.0) == 0.0
    assert corner_angle(0.0, -1.0) == 180.0
    assert corner_angle(0.0, 0.0) == corner_angle(0.0, -0.0) == 0.0
