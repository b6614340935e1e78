"""Which cell holds a place, and the weights of its corners."""

import numpy as np
import pytest

from meshes import KINDS, jitter, tangle
from qsmooth import Mesh
from qsmooth.kernels.locating import (
    CONVEX,
    CUT_FROM_FIRST,
    CUT_FROM_SECOND,
    FOLDED,
    TRIANGLE,
    holds,
    kind_of,
)
from qsmooth.remapping import _by_bins, locate

pytestmark = pytest.mark.nojit

SQUARE = [(0, 0), (2, 0), (2, 2), (0, 2)]
CELLS = {
    "triangle": ([(0, 0), (2, 0), (0, 2)], TRIANGLE, (0.5, 0.5), (1.5, 1.5)),
    "clockwise triangle": ([(0, 0), (0, 2), (2, 0)], FOLDED, None, (0.5, 0.5)),
    "flat triangle": ([(0, 0), (1, 0), (2, 0)], FOLDED, None, (1.0, 0.0)),
    "square": (SQUARE, CONVEX, (2.0, 2.0), (2.0, 2.0000001)),
    "reflex first": ([(1, 1), (2, 0), (4, 4), (0, 2)], CUT_FROM_FIRST, (3, 3), (1, 0.9)),
    "reflex second": ([(0, 2), (1, 1), (2, 0), (4, 4)], CUT_FROM_SECOND, (1, 1), (0.9, 1)),
    "straight": ([(0, 0), (1, 0), (2, 0), (1, 1)], CUT_FROM_SECOND, (1.5, 0), (1, -1e-300)),
    "bow tie": ([(0, 0), (2, 2), (2, 0), (0, 2)], FOLDED, None, (0.1, 1.0)),
    "clockwise square": (SQUARE[::-1], FOLDED, None, (1.0, 1.0)),
}  # fmt: skip


@pytest.mark.parametrize(("corners", "kind", "inside", "outside"), CELLS.values(), ids=CELLS.keys())
def test_kinds_of_cells_and_what_they_hold(corners, kind, inside, outside):
    xy, vertices = np.array(corners, float), np.arange(len(corners))
    ends = 0, len(corners)
    assert kind_of(xy, vertices, *ends) == kind
    assert not holds(xy, vertices, ends, kind, *outside)
    assert inside is None or holds(xy, vertices, ends, kind, *inside)


def at(mesh, places):
    return locate(mesh, np.array(places, float), np.zeros(len(places), np.int64), np.array(places))


def values_of(located):
    """Weight of each vertex for the first place."""
    return dict(zip(located.corners[0].tolist(), located.weights[0].tolist(), strict=True))


def test_weights_by_hand():
    square = Mesh(np.array(SQUARE, float), [[0, 1, 2, 3]])
    assert values_of(at(square, [(0.5, 1.5)])) == {0: 0.1875, 1: 0.0625, 2: 0.1875, 3: 0.5625}
    triangle = Mesh(np.array([(0, 0), (4, 0), (0, 4)], float), [[0, 1, 2]])
    found = at(triangle, [(1, 2)])
    assert found.weights[0].tolist() == [0.25, 0.25, 0.5, 0.0]
    bent = Mesh(np.array([(1, 1), (2, 0), (4, 4), (0, 2)], float), [[0, 1, 2, 3]])
    assert values_of(at(bent, [(1.5, 0.5)])) == {0: 0.5, 1: 0.5, 2: 0.0, 3: 0.0}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e30])
def test_weights_give_back_the_place(kind, scale):
    rng = np.random.default_rng(5)
    points, cells = KINDS[kind](5, rng)
    points = scale * jitter(points, cells, 0.9, rng)
    mesh = Mesh(points, cells)
    shares = rng.dirichlet(np.ones(3), mesh.n_cells)  # inside the first three corners of a cell
    corners = mesh.cell_vertices[mesh.cell_offsets[:-1, None] + np.arange(3)]
    places = (shares[:, :, None] * mesh.xy[corners]).sum(axis=1)
    walked = locate(mesh, places, np.zeros(mesh.n_cells, np.int64), places)
    searched = _by_bins(mesh, places, places)
    for cells_, corners_, weights in ((walked.cells, walked.corners, walked.weights), searched):
        assert cells_.tolist() == list(range(mesh.n_cells))
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-15)
        assert weights.min() >= 0.0
        back = (weights[:, :, None] * mesh.xy[corners_]).sum(axis=1)
        np.testing.assert_allclose(back, places, rtol=0, atol=1e-13 * np.abs(points).max())


def test_a_sliver_gives_back_the_place():
    corners = np.array([(0, 0), (1, 1e-9), (2, 0), (1, 2e-9)], float)
    mesh = Mesh(corners, [[0, 1, 2, 3]])
    place = np.array([[0.9, 1.05e-9]])
    found = at(mesh, place)
    back = (found.weights[0][:, None] * mesh.xy[found.corners[0]]).sum(axis=0)
    np.testing.assert_allclose(back, place[0], rtol=1e-9)


def test_outside_the_mesh_the_nearest_place_counts():
    points, cells = KINDS["L"](2, None)
    mesh = Mesh(points, cells)
    found = at(mesh, [(3.0, 2.5), (-1.0, 0.5), (50.0, 60.0)])  # in the notch, beside, far away
    back = (found.weights[:, :, None] * mesh.xy[found.corners]).sum(axis=1)
    np.testing.assert_allclose(back[:2], [(3.0, 2.0), (0.0, 0.5)], atol=1e-15)
    assert np.hypot(*(back[2] - (50, 60))) == pytest.approx(np.hypot(50 - 2, 60 - 4))


def test_folds_are_left_out_and_the_nearest_cell_counts():
    rng = np.random.default_rng(2)
    points, cells = KINDS["quads"](6, rng)
    mesh = Mesh(tangle(points, cells, rng, 1.2), cells)
    places = rng.uniform(0.0, 6.0, (200, 2))
    near = places + rng.normal(size=places.shape)
    found, _, _ = _by_bins(mesh, places, near)
    cell_vertices = mesh.cell_vertices.reshape(-1, 4)
    kinds = [kind_of(mesh.xy, mesh.cell_vertices, 4 * c, 4 * c + 4) for c in range(mesh.n_cells)]
    n_several = 0
    for place, by, c in zip(places, near, found, strict=True):
        held = [
            k for k in range(mesh.n_cells)
            if holds(mesh.xy, mesh.cell_vertices, (4 * k, 4 * k + 4), kinds[k], *place)
        ]  # fmt: skip
        far = [np.hypot(*(mesh.xy[cell_vertices[k]] - by).mean(axis=0)) for k in held]
        assert kinds[c] != FOLDED
        assert not held or c == held[int(np.argmin(far))]
        n_several += len(held) > 1
    assert n_several > 10


def test_no_cell_is_found_where_all_are_folded():
    mesh = Mesh(np.array([(0, 0), (1, 0), (2, 0)], float), [[0, 1, 2]])
    assert at(mesh, [(1.0, 0.0)]).cells.tolist() == [-1]
    point = Mesh(np.zeros((3, 2)), [[0, 1, 2]])
    assert at(point, [(1.0, 0.0)]).cells.tolist() == [-1]


def test_cells_that_are_all_over_each_other_share_few_bins():
    rng = np.random.default_rng(0)
    points, cells = KINDS["quads"](12, rng)
    mesh = Mesh(np.where(points % 12 == 0, points, rng.uniform(0, 12, points.shape)), cells)
    places = rng.uniform(0.0, 12.0, (20, 2))
    assert (_by_bins(mesh, places, places)[0] >= 0).all()
