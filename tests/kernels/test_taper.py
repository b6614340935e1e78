"""Shares of a step around marked cells, by distance."""

import numpy as np
import pytest

from meshes import grid
from qsmooth import Mesh
from qsmooth.kernels.taper import taper

pytestmark = pytest.mark.nojit


def tapered(mesh, marked, share, rings=4):
    cells = np.zeros(mesh.n_cells, np.bool_)
    cells[list(marked)] = True
    stars = mesh.topology.star_offsets, mesh.topology.star_cells
    taper(cells, rings, *mesh.topology.cells, *stars, share)
    return share


def test_shares_grow_with_the_distance_from_the_marked_cells():
    mesh = Mesh(*grid(9, 9))
    share = tapered(mesh, [4 * 9 + 4], np.ones(mesh.n_vertices))
    x, y = mesh.points.T
    away = np.maximum(np.abs(x - 4.5), np.abs(y - 4.5)) - 0.5
    assert share == pytest.approx(np.minimum(away / 4, 1.0))


def test_what_is_less_already_stays_and_more_cells_only_take():
    mesh = Mesh(*grid(9, 3))
    first = tapered(mesh, [0], np.ones(mesh.n_vertices))
    both = tapered(mesh, [0, 26], np.ones(mesh.n_vertices))
    after = tapered(mesh, [26], first.copy())
    assert np.array_equal(after, both)
    assert (after <= first).all()
    assert np.array_equal(tapered(mesh, [], first.copy()), first)
