"""Triangulations of matplotlib."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from matplotlib.tri import Triangulation

from object_samples import POINTS, QUADS, all_ways_in, smoothed
from qsmooth import as_mesh
from qsmooth.adapters import back

TRIANGLES = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])


def same_but_for_points(new, old):
    assert type(new) is type(old) is Triangulation
    masks = [None if t.mask is None else t.mask.tolist() for t in (new, old)]
    return np.array_equal(new.triangles, old.triangles) and masks[0] == masks[1]


def test_it_comes_back():
    given = Triangulation(*POINTS.T, TRIANGLES)
    new, points = smoothed(given)
    assert same_but_for_points(new, given)
    assert np.array_equal(np.stack([new.x, new.y], axis=1), points)
    assert np.array_equal(np.stack([given.x, given.y], axis=1), POINTS)
    all_ways_in(given, same_but_for_points)


def test_masked_triangles_are_no_part_and_stay_masked():
    mask = np.zeros(len(TRIANGLES), bool)
    mask[[3, 15]] = True
    given = Triangulation(*POINTS.T, TRIANGLES, mask)
    assert as_mesh(given).cells[0].tolist() == TRIANGLES[~mask].tolist()
    new, points = smoothed(given)
    assert same_but_for_points(new, given)
    assert not np.shares_memory(new.mask, given.mask)
    # The corners of what is masked are on the boundary now.
    held = np.unique(TRIANGLES[mask])
    assert np.array_equal(points[held], POINTS[held])


def test_other_vertices_are_refused():
    given = Triangulation(*POINTS.T, TRIANGLES)
    with pytest.raises(ValueError, match="3 vertices for a mesh that has 20"):
        back(as_mesh((POINTS[[0, 1, 6]], [(0, 1, 2)])), given)
