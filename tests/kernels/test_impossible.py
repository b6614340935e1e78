"""Cells that can't be valid: what is fixed, doublets, and where doublets are put."""

import numpy as np
import pytest

from meshes import KINDS, grid, tangle
from promises import hopeless_cells, invalid_cells
from qsmooth import Mesh, quality
from qsmooth.kernels import impossible
from qsmooth.kernels.rails import FREE
from qsmooth.metrics.impossible import impossible as prove


def hopeless(mesh, movable):
    out, mask = np.ones(mesh.n_cells, np.bool_), np.zeros(mesh.n_vertices, np.bool_)
    mask[movable] = True
    impossible.hopeless_cells(mesh.xy, mesh.cell_offsets, mesh.cell_vertices, mask, out)
    return out.tolist()


@pytest.mark.nojit
def test_a_cell_is_hopeless_by_a_bad_corner_of_fixed_vertices_only():
    # A dart: over 180 degrees at 2, which sees 1, 2 and 3.
    dart = Mesh([(0.0, 0.0), (2.0, 0.0), (0.5, 0.5), (0.0, 2.0)], [(0, 1, 2, 3)])
    assert hopeless(dart, []) == [True]
    assert hopeless(dart, [0]) == [True]
    for v in (1, 2, 3):
        assert hopeless(dart, [v]) == [False]
    square = Mesh(*grid(1, 1))
    assert hopeless(square, []) == [False]


@pytest.mark.nojit
def test_a_cell_is_hopeless_by_two_fixed_vertices_at_one_place():
    # An edge of no length, a diagonal of no length; and no cell is lost by a vertex that can move.
    for pair in ((0, 1), (0, 2)):
        points = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
        points[pair[1]] = points[pair[0]]
        mesh = Mesh(points, [(0, 1, 2, 3)])
        others = [v for v in range(4) if v not in pair]
        assert hopeless(mesh, others) == [True]
        assert hopeless(mesh, [pair[0], others[0]]) == [False]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["mixed", "annulus", "quad fan"])
def test_proofs_agree_with_exact_signs(kind, seed):
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](5, rng)
    points = tangle(points, cells, rng, 2.0)
    mesh = Mesh(np.round(points), cells)  # many at one place
    movable = ~mesh.is_fixed & (rng.random(mesh.n_vertices) < 0.5)
    proof = prove(mesh.topology, mesh.xy, movable)
    assert np.array_equal(proof.cells, hopeless_cells(mesh, movable))
    assert proof.cells.any()
    assert not (proof.cells & ~invalid_cells(mesh)).any()


def with_doublet(x, y):
    """Two by two squares, the first cut in two by a vertex that only these two share."""
    points, (quads,) = grid(2, 2)
    cut = [(0, 1, 4, 9), (0, 9, 4, 3)]
    return Mesh([*points, (x, y)], [np.array([*cut, *quads[1:].tolist()])])


@pytest.mark.nojit
def test_a_doublet_has_one_hopeless_cell_the_one_that_is_not_convex_there():
    for place, bad in (((0.3, 0.7), 1), ((0.7, 0.3), 0), ((0.5, 0.5), 0)):
        mesh = with_doublet(*place)
        proof = prove(mesh.topology, mesh.xy, ~mesh.is_fixed)
        assert np.flatnonzero(proof.doublets).tolist() == [9]
        assert np.flatnonzero(proof.cells).tolist() == [bad]
        assert not proof.by_fixed.any()
        closed = np.flatnonzero(proof.closed)
        assert mesh.cell_vertices[closed].tolist() == [9, 9]


@pytest.mark.nojit
def test_cells_of_two_doublets_count_once():
    # A vertex more in the second of the two cells: three cells in a row, of which one is shared.
    points, (quads,) = grid(2, 2)
    cut = [(0, 1, 4, 9), (0, 9, 4, 10), (0, 10, 4, 3)]
    mesh = Mesh([*points, (0.6, 0.4), (0.4, 0.6)], [np.array([*cut, *quads[1:].tolist()])])
    proof = prove(mesh.topology, mesh.xy, ~mesh.is_fixed)
    assert np.flatnonzero(proof.doublets).tolist() == [9, 10]
    assert proof.cells.sum() == 1
    assert np.array_equal(proof.cells, hopeless_cells(mesh, ~mesh.is_fixed))


@pytest.mark.nojit
@pytest.mark.parametrize("place", [(0.3, 0.7), (0.8, 0.3), (0.9, 0.9), (1.7, 0.2)])
@pytest.mark.parametrize("far", [0.0, 1e6])
def test_a_doublet_goes_to_where_180_degrees_are_least_exceeded(place, far):
    mesh = with_doublet(*place)
    mesh = mesh.with_points(mesh.points + far)
    xy, lengths, t = mesh.xy.copy(), np.full(1, np.nan), mesh.topology
    stars = t.star_offsets, t.star_cells, t.star_corners
    impossible.place_doublets(xy, np.array([9]), *stars, *t.cells, FREE, lengths)
    after = quality(mesh.with_points(xy))
    assert after.n_invalid == 1
    assert 180.0 < after.max_angle.max() < 180.01
    assert lengths == pytest.approx([np.hypot(*(xy[9] - mesh.xy[9]))])
    assert xy[:9].tobytes() == mesh.xy[:9].tobytes()
    again = xy.copy()
    impossible.place_doublets(again, np.array([9]), *stars, *t.cells, FREE, lengths)
    assert lengths[0] <= 1e-6
    assert np.abs(again - xy).max() <= 1e-6
