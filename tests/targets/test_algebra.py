"""Small matrices of targets: against numpy's, and by what they are for."""

import numpy as np
import pytest

from qsmooth.targets import EQUILATERAL, SQUARE
from qsmooth.targets.algebra import (
    corners_of_triangle,
    from_log,
    half_rectangle,
    log_from_equilateral,
    log_in_plane,
    of_eigenvalues,
    rectangle_corners,
    squared,
    step,
    unit_root,
)

pytestmark = pytest.mark.nojit


def coefficients(u, w):
    """The target of a corner with these edges, by its definition."""
    d = u[0] * w[1] - u[1] * w[0]
    return np.array([w @ w, -(u @ w), u @ u]) / d


def triangles(count=20, seed=0):
    """Counter-clockwise triangles of any shape."""
    p = np.random.default_rng(seed).normal(size=(count, 3, 2))
    u, w = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    turned = u[:, 0] * w[:, 1] < u[:, 1] * w[:, 0]
    p[turned] = p[turned][:, ::-1]
    return p


def targets_of(p):
    return np.array([coefficients(p[k - 2] - p[k], p[k - 1] - p[k]) for k in range(3)])


def tensor(entries):
    a, b, c = entries
    return np.array([[a, b], [b, c]])


def test_a_step_goes_either_way():
    assert step(np.array([-1.0, 0.0, 0.5, 1.0, 9.0]), (0.0, 1.0)).tolist() == [0, 0, 0.5, 1, 1]
    assert step(np.array([-1.0, 0.0, 0.5, 1.0, 9.0]), (1.0, 0.0)).tolist() == [1, 1, 0.5, 0, 0]


def test_corners_of_rectangles_and_of_their_halves():
    ratio = 3.0
    p = np.array([(0, 0), (ratio, 0), (ratio, 1), (0, 1)])
    expected = [coefficients(p[k - 3] - p[k], p[k - 1] - p[k]) for k in range(4)]
    (found,) = rectangle_corners(np.log([ratio]))
    assert found == pytest.approx(np.array(expected))
    half = p[:3]
    for position in range(3):  # of the first leg, which comes first, second or last
        own = np.roll(half, position, axis=0)
        (found,) = half_rectangle(np.log([ratio]), np.array([position]))
        assert found == pytest.approx(targets_of(own)[0])


def test_the_first_corner_of_a_triangle_tells_the_others():
    for p in triangles():
        own = targets_of(p)
        assert corners_of_triangle(own[:1])[0] == pytest.approx(own, rel=1e-9)
    assert corners_of_triangle(EQUILATERAL[None])[0] == pytest.approx(np.tile(EQUILATERAL, (3, 1)))


def test_logarithms_come_back_and_are_none_of_the_equilateral():
    m = np.array([targets_of(p)[0] for p in triangles()])
    assert from_log(log_from_equilateral(m)) == pytest.approx(m, rel=1e-9)
    assert log_from_equilateral(EQUILATERAL[None]) == pytest.approx(np.zeros((1, 2)), abs=1e-15)
    assert from_log(np.zeros((1, 2)))[0] == pytest.approx(EQUILATERAL)


def test_in_its_metric_a_triangle_is_equilateral():
    for p in triangles():
        u, w = p[1] - p[0], p[2] - p[0]
        ((half, both),) = log_in_plane(u[None], w[None], np.array([u[0] * w[1] - u[1] * w[0]]))
        values, vectors = np.linalg.eigh(tensor((half, both, -half)))
        metric = (vectors * np.exp(values)) @ vectors.T
        assert np.linalg.det(metric) == pytest.approx(1.0)
        lengths = [e @ metric @ e for e in (u, w, w - u)]
        assert lengths == pytest.approx([lengths[0]] * 3, rel=1e-9)


def test_turned_to_right_angles_lengths_are_in_proportion_and_the_area_stays():
    for p in triangles():
        u, w = p[1] - p[0], p[2] - p[0]
        ((a,), (b,)) = squared(u[None], w[None])
        assert a @ b == pytest.approx(0.0, abs=1e-12)
        assert a[0] * b[1] - a[1] * b[0] == pytest.approx(u[0] * w[1] - u[1] * w[0])
        ratio = np.linalg.norm(u) / np.linalg.norm(w)
        assert np.linalg.norm(a) / np.linalg.norm(b) == pytest.approx(ratio)
        turns = [np.arctan2(x[0] * y[1] - x[1] * y[0], x @ y) for x, y in ((u, a), (w, b))]
        assert turns[0] == pytest.approx(-turns[1])


def test_roots_and_logarithms_are_those_of_eigenvalues():
    rng = np.random.default_rng(3)
    for _ in range(20):
        a = rng.normal(size=(2, 2))
        m = a @ a.T + 0.01 * np.eye(2)
        entries = m[[0, 0, 1], [0, 1, 1]][None]
        root = tensor(unit_root(entries)[0])
        assert root @ root == pytest.approx(m / np.sqrt(np.linalg.det(m)))
        values, vectors = np.linalg.eigh(m)
        logs = tensor(of_eigenvalues(entries, np.log)[0])
        assert logs == pytest.approx((vectors * np.log(values)) @ vectors.T)
    assert unit_root(SQUARE[None])[0] == pytest.approx(SQUARE)
