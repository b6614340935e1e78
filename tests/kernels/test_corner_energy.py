"""The shape energy of a corner with any target: its minimum, and derivatives against jets."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import reference_optimizer as slow
from qsmooth.kernels import corner_energy as energy
from qsmooth.kernels import shape_hessian

pytestmark = pytest.mark.nojit

ROOT3 = math.sqrt(3.0)
LENGTHS, TURNS, OPENINGS = st.floats(0.1, 10.0), st.floats(-3.2, 3.2), st.floats(0.1, 3.0)
EDGES = st.floats(-2.0, 2.0)


def target_of(p, q):
    """Coefficients of the corner with edges p, q (complex), by the formulas of `Target`."""
    area = (p.conjugate() * q).imag
    return energy.Target(abs(q) ** 2 / area, -(p.conjugate() * q).real / area, abs(p) ** 2 / area)


def shape(target, u, w):
    n, det = energy.corner_shape(target, u.real, u.imag, w.real, w.imag)
    return n / det


@given(LENGTHS, LENGTHS, OPENINGS, TURNS, st.sampled_from([1e-9, 1.0, 1e9]))
def test_energy_is_one_at_the_target_however_turned_and_scaled(p, q, opening, turn, scale):
    q = cmath.rect(q, opening)
    target = target_of(p + 0j, q)
    assert target.m11 * target.m22 - target.m12**2 == pytest.approx(1.0, rel=1e-9, abs=1e-9)
    motion = cmath.rect(scale, turn)
    tolerance = 1e-14 * (target.m11 + target.m22) ** 2
    assert shape(target, p * motion, q * motion) == pytest.approx(1.0, abs=tolerance)


@given(LENGTHS, LENGTHS, OPENINGS, LENGTHS, LENGTHS, OPENINGS)
def test_energy_is_larger_elsewhere(p, q, opening, r, s, other_opening):
    target = target_of(p + 0j, cmath.rect(q, opening))
    found = shape(target, r + 0j, cmath.rect(s, other_opening))
    # By |T|² / (2 det T) with T = A W⁻¹.
    ideal = np.array([[p, q * math.cos(opening)], [0.0, q * math.sin(opening)]])
    actual = np.array([[r, s * math.cos(other_opening)], [0.0, s * math.sin(other_opening)]])
    to = actual @ np.linalg.inv(ideal)
    assert found == pytest.approx((to**2).sum() / (2.0 * np.linalg.det(to)), rel=1e-9)
    assert found >= 1.0 - 1e-9


def test_named_targets():
    assert energy.SQUARE == (1.0, 0.0, 1.0)
    assert target_of(1 + 0j, cmath.rect(1.0, math.pi / 3)) == pytest.approx(energy.EQUILATERAL)
    assert target_of(3 + 0j, 1j) == pytest.approx((1 / 3, 0.0, 3.0))
    rectangle = energy.Target(1 / 3, 0.0, 3.0)
    assert shape(rectangle, 6 + 0j, 2j) == pytest.approx(1.0)
    # A square where 3:1 is meant is as far off as 3:1 where a square is.
    assert shape(rectangle, 1 + 0j, 1j) == pytest.approx(shape(energy.SQUARE, 3 + 0j, 1j))
    assert shape(energy.SQUARE, 3 + 0j, 1j) == pytest.approx(5 / 3)


@given(EDGES, EDGES, EDGES, EDGES)
def test_the_short_forms_for_ideal_corners_are_the_general_one(ux, uy, wx, wy):
    uu, ww = energy.half_square(ux, uy), energy.half_square(wx, wy)
    uw, ee = energy.dot(ux, uy, wx, wy), energy.fixed_half_square(wx - ux, wy - uy)
    square = energy.numerator(energy.SQUARE, uu, uw, ww)
    np.testing.assert_allclose(energy.square_numerator(uu, ww), square, rtol=1e-15)
    triangle = energy.numerator(energy.EQUILATERAL, uu, uw, ww)
    np.testing.assert_allclose(
        energy.equilateral_numerator(uu, ww, ee), triangle, rtol=1e-14, atol=1e-14
    )
    for is_triangle, target in ((False, energy.SQUARE), (True, energy.EQUILATERAL)):
        np.testing.assert_allclose(
            energy.ideal_corner_shape(is_triangle, ux, uy, wx, wy),
            energy.corner_shape(target, ux, uy, wx, wy),
            rtol=1e-14,
            atol=1e-14,
        )


def dot_with_fixed(ux, uy, ex, ey):
    """u·e of an edge u that runs to the vertex that moves, and an edge e that does not change."""
    return energy.Quadratic(ux * ex + uy * ey, ex, ey, 0.0)


def terms(target, corner, following, previous, moving):
    """Numerator and determinant as functions of the place of one of the three vertices."""
    (vx, vy), (bx, by), (dx, dy) = corner, following, previous
    ux, uy, wx, wy = bx - vx, by - vy, dx - vx, dy - vy
    if moving == "corner":
        uu, ww = energy.half_square(ux, uy), energy.half_square(wx, wy)
        uw, det = energy.dot(ux, uy, wx, wy), energy.determinant(ux, uy, wx, wy)
    elif moving == "next":
        uu, ww = energy.half_square(-ux, -uy), energy.fixed_half_square(wx, wy)
        uw = dot_with_fixed(ux, uy, wx, wy)
        det = energy.determinant_to_next(ux, uy, wx, wy)
    else:
        uu, ww = energy.fixed_half_square(ux, uy), energy.half_square(-wx, -wy)
        uw = dot_with_fixed(wx, wy, ux, uy)
        det = energy.determinant_to_previous(ux, uy, wx, wy)
    return energy.numerator(target, uu, uw, ww), det


@given(LENGTHS, LENGTHS, OPENINGS, EDGES, EDGES, EDGES, EDGES)
@pytest.mark.parametrize("moving", ["corner", "next", "previous"])
def test_derivatives_by_each_vertex_are_those_of_jets(moving, p, q, opening, ux, uy, wx, wy):
    assume(ux * wy - uy * wx > 1e-2)
    target = target_of(p + 0j, cmath.rect(q, opening))
    places = {"corner": (0.3, -0.2), "next": (0.3 + ux, uy - 0.2), "previous": (0.3 + wx, wy - 0.2)}
    n, det = terms(target, *places.values(), moving)
    inv, f, fx, fy = energy.quotient(n, det)
    xx, xy, yy = energy.hessian(n.second, fx, fy, det)
    at = dict(places) | {moving: slow.Jet.variables(places[moving])}
    (vx, vy), (bx, by), (dx, dy) = at.values()
    jet_u, jet_w = (bx - vx, by - vy), (dx - vx, dy - vy)
    jet = (
        0.5 * target.m11 * (jet_u[0] * jet_u[0] + jet_u[1] * jet_u[1])
        + target.m12 * (jet_u[0] * jet_w[0] + jet_u[1] * jet_w[1])
        + 0.5 * target.m22 * (jet_w[0] * jet_w[0] + jet_w[1] * jet_w[1])
    ) / slow.determinant(jet_u, jet_w)
    scale = np.abs(jet.hessian).max() + np.abs(jet.gradient).max() + abs(jet.value)
    assert f == pytest.approx(jet.value, abs=1e-11 * scale)
    np.testing.assert_allclose((fx, fy), jet.gradient, rtol=0, atol=1e-11 * scale)
    hessian = inv * np.array([[xx, xy], [xy, yy]])
    np.testing.assert_allclose(hessian, jet.hessian, rtol=0, atol=1e-10 * scale)


@given(LENGTHS, LENGTHS, OPENINGS, EDGES, EDGES, EDGES, EDGES)
def test_the_image_of_a_corner_for_the_global_hessian_has_its_energy(p, q, opening, ux, uy, wx, wy):
    assume(ux * wy - uy * wx > 1e-2)
    target = target_of(p + 0j, cmath.rect(q, opening))
    weights = np.full((3, 2), np.nan)
    shape_hessian.fill_image(target, weights)
    assert weights.sum(axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)  # moving all moves nothing
    image = weights.T @ [(0.0, 0.0), (ux, uy), (wx, wy)]
    found = slow.corner_jet(*image).value
    assert found == pytest.approx(shape(target, complex(ux, uy), complex(wx, wy)), rel=1e-9)
