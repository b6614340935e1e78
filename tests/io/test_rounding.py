"""What bears single precision, and what does not."""

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth.io.rounding import bears_single

TRIANGLE = [np.array([[0, 1, 2]])]
RIGHT = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
pytestmark = pytest.mark.nojit


def test_a_rough_grid_at_the_origin_does_and_far_from_it_does_not():
    points, cells = rough_grid(8)
    old = points.astype(np.float32).astype(np.float64)
    mild = old + 1e-3 * (old.mean(axis=0) - old)
    assert bears_single(old, mild, cells)
    far = 1e8
    assert not bears_single(old + far, mild + far, cells)


@pytest.mark.parametrize("turn", [1, -1])
def test_a_corner_that_rounding_folds(turn):
    cells = [TRIANGLE[0][:, ::turn]]
    thin = np.array([[0.0, 0.0], [3.0, 1.0], [1.5, 0.5 + 1e-12]])
    assert not bears_single(thin, thin, cells)  # however bad the old mesh was
    assert bears_single(RIGHT, RIGHT * 1.1, cells)


def test_no_corner_gets_worse_than_the_worst_was():
    good = RIGHT * 1.1
    worse = good + np.array([[0.0, 0.0], [0.0, 0.0], [-1.0, 0.0]])
    assert bears_single(worse, good, TRIANGLE)
    assert not bears_single(RIGHT, worse, TRIANGLE)


def test_what_was_concave_need_not_be_convex():
    dart = [np.array([[0, 1, 2, 3]])]
    points = np.array([[0.0, 0.0], [2.0, -1.0], [0.7, 0.0], [2.0, 1.0]])
    assert bears_single(points, points, dart)


def test_beyond_the_range_of_single():
    assert not bears_single(RIGHT, RIGHT * 1e39, TRIANGLE)


def test_without_cells():
    assert bears_single(RIGHT, RIGHT * 1.1, [np.empty((0, 3), np.int64)])
