"""Delaunay triangulation: no vertex in a circle, every place filled, bad points named."""

import math

import numpy as np
import pytest

from qsmooth.kernels.delaunay import triangulate

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def areas(points, triangles):
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.nojit
@pytest.mark.parametrize("n", [1, 2, 5, 30, 120])
def test_no_point_is_inside_a_circle(n):
    rng = np.random.default_rng(n)
    points = np.concatenate([SQUARE, rng.random((n, 2))])
    triangles, bad = triangulate(points, rng.permutation(np.arange(4, n + 4)))
    assert bad == -1
    assert len(triangles) == 2 * n + 2
    assert (areas(points, triangles) > 0.0).all()
    for a, b, c in points[triangles]:
        centre = circumcentre(a, b, c)
        radius = math.dist(centre, a)
        assert np.hypot(*(points - centre).T).min() >= radius * (1.0 - 1e-9)


def circumcentre(a, b, c):
    left = 2.0 * np.array([b - a, c - a])
    return np.linalg.solve(left, [b @ b - a @ a, c @ c - a @ a])


@pytest.mark.nojit
def test_points_in_rows_and_on_circles_are_triangulated():
    inner = np.stack(np.meshgrid(np.arange(1, 6), np.arange(1, 6)), axis=-1).reshape(-1, 2) / 6.0
    points = np.concatenate([SQUARE, inner])
    triangles, bad = triangulate(points, np.arange(4, len(points)))
    assert bad == -1
    assert (areas(points, triangles) > 0.0).all()
    assert areas(points, triangles).sum() == pytest.approx(1.0)


@pytest.mark.nojit
@pytest.mark.parametrize("place", [(0.5, 0.5), (1.5, 0.5), (0.0, -1.0)])
def test_coincident_and_outer_points_are_named(place):
    points = np.array([*SQUARE, (0.5, 0.5), place])
    assert triangulate(points, np.array([4, 5]))[1] == 5
