"""The figures that can be held: those of `Quality`, of what can change, in the trials' own bits."""

import numpy as np
import pytest

from meshes import KINDS, random_mesh
from qsmooth import Mesh, quality
from qsmooth.kernels.held_figures import NOTHING, beyond_held, held_figures


def measured(mesh, movable):
    found = np.full((mesh.n_cells, 6), np.nan)
    held_figures(mesh.xy, *mesh.topology.cells, movable, found)
    return found


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_they_are_those_of_quality(kind, scale):
    mesh = random_mesh(kind, 3, seed=11, amount=0.8, scale=scale).mesh
    found = measured(mesh, np.ones(mesh.n_vertices, np.bool_))
    own = quality(mesh)
    assert np.degrees(np.arccos(found[:, 0])) == pytest.approx(own.min_angle, abs=1e-9)
    assert np.degrees(np.arccos(found[:, 1])) == pytest.approx(own.max_angle, abs=1e-9)
    assert found[:, 2] == pytest.approx(own.scaled_jacobian, rel=1e-12)
    assert np.sqrt(found[:, 3]) == pytest.approx(own.aspect_ratio, rel=1e-12)
    assert 1.0 / found[:, 4] == pytest.approx(own.shape, rel=1e-12)
    assert np.sqrt(2.0 * found[:, 5]) == pytest.approx(own.min_edge, rel=1e-12)


@pytest.mark.nojit
def test_what_cannot_change_does_not_count():
    mesh = random_mesh("mixed", 3, seed=11, amount=0.8).mesh
    nobody = np.zeros(mesh.n_vertices, np.bool_)
    assert np.array_equal(measured(mesh, nobody), np.tile(NOTHING, (mesh.n_cells, 1)))
    # A quad with one vertex that moves: the corner opposite to it stays, and so do its edges.
    quad = Mesh([(0.0, 0.0), (1.0, 0.0), (1.1, 1.0), (0.0, 1.0)], [(0, 1, 2, 3)])
    only = np.array([True, False, False, False])
    ((most, least, sine, ratio, shape, edge),) = measured(quad, only)
    # Of the corners at 0, 1 and 3 that at 1 has over 90 degrees.
    assert np.degrees(np.arccos(most)) == pytest.approx(90.0)
    assert np.degrees(np.arccos(least)) == pytest.approx(90.0 + np.degrees(np.arctan(0.1)))
    assert sine == pytest.approx(1.0 / np.hypot(1.0, 0.1))
    assert np.sqrt(ratio) == pytest.approx(1.1)
    assert edge == pytest.approx(0.5)
    assert shape == pytest.approx((1.0 + 1.0 + 0.01) / 2.0)


@pytest.mark.nojit
def test_a_corner_that_is_not_positive_is_told_by_its_sine_and_shape():
    mesh = Mesh([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], [(0, 1, 2, 3)])
    ((_, _, sine, _, shape, _),) = measured(mesh, np.ones(4, np.bool_))
    assert sine < 0.0
    assert shape == np.inf


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_cell_is_beyond_what_is_held_where_one_of_its_figures_is(kind):
    mesh = random_mesh(kind, 3, seed=11, amount=0.8).mesh
    movable = np.ones(mesh.n_vertices, np.bool_)
    figures, regions = measured(mesh, movable), np.arange(mesh.n_cells) % 2 - 1
    free = np.array([2.0, -2.0, -2.0, np.inf, np.inf, 0.0])
    smaller = np.array([True, False, False, True, True, False])
    for k in range(6):
        # Each region holds the middle of this figure in it, and none of the others; the last row
        # is of the cells in no region.
        held = np.tile(free, (2, 1))
        for region in (-1, 0):
            held[region, k] = np.median(figures[regions == region, k])
        found = np.ones(mesh.n_cells, np.bool_)
        beyond_held(mesh.xy, *mesh.topology.cells, movable, held, regions, found)
        own, cap = figures[:, k], held[regions, k]
        np.testing.assert_array_equal(found, own > cap if smaller[k] else own < cap)
        assert 0 < found.sum() < mesh.n_cells
