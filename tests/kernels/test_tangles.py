"""Where a mesh is tangled: bad cells, their neighbourhood, islands, places that mend more."""

import numpy as np
import pytest

import reference
from meshes import KINDS, fan, grid, tangle
from promises import invalid_cells
from qsmooth import Mesh
from qsmooth.kernels import tangles
from qsmooth.kernels.rails import FREE


def tangled(kind="mixed", size=5, seed=0, amount=1.0):
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](size, rng)
    return Mesh(tangle(points, cells, rng, amount), cells)


def bad_cells(mesh, xy, closed=None, cells=None):
    cells = np.arange(mesh.n_cells) if cells is None else np.array(cells)
    closed = np.zeros(mesh.cell_vertices.size, np.bool_) if closed is None else closed
    out = np.ones(cells.size, np.bool_)
    tangles.bad_cells(xy, *mesh.topology.cells, closed, cells, out)
    return out


def mend(mesh, vertices, closed=None):
    xy, listed = mesh.xy.copy(), np.array(vertices, np.int64)
    closed = np.zeros(mesh.cell_vertices.size, np.bool_) if closed is None else closed
    t, lengths = mesh.topology, np.full(listed.size, np.nan)
    tables = t.star_offsets, t.star_cells, t.star_corners, *t.cells
    tangles.mend_more(xy, tables, closed, listed, FREE, lengths)
    return xy, lengths


@pytest.mark.nojit
@pytest.mark.parametrize("seed", range(4))
def test_bad_cells_are_those_that_are_not_valid_but_for_closed_corners(seed):
    mesh = tangled(seed=seed)
    bad = invalid_cells(mesh)
    assert np.array_equal(bad_cells(mesh, mesh.xy), bad)
    assert np.array_equal(bad_cells(mesh, mesh.xy, cells=[7, 2]), bad[[7, 2]])
    closed = np.random.default_rng(seed).random(mesh.cell_vertices.size) < 0.5
    points, k = reference.as_complex(mesh.xy), 0
    expected = np.zeros(mesh.n_cells, np.bool_)
    for c, cell in enumerate(reference.as_lists(mesh)):
        for corner in reference.corners(cell):
            concave = reference.sign(*(points[w] for w in corner)) <= 0
            expected[c] |= concave and not closed[k]
            k += 1
    assert np.array_equal(bad_cells(mesh, mesh.xy, closed), expected)


@pytest.mark.nojit
def test_growing_goes_along_edges():
    mesh = Mesh(*grid(6, 6))
    x, y = mesh.xy.T
    for rings in range(4):
        marked = (x == 2) & (y == 3)
        listed = tangles.grow(marked, rings, mesh.ring_offsets, mesh.ring_vertices)
        assert np.array_equal(marked, np.abs(x - 2) + np.abs(y - 3) <= rings)
        assert sorted(listed.tolist()) == np.flatnonzero(marked).tolist()


@pytest.mark.nojit
def test_islands_share_no_cell():
    mesh = Mesh(*grid(6, 1))
    x = mesh.xy[:, 0]
    labels = np.where((x <= 1) | (x == 3) | (x >= 5), -2, -1)
    t = mesh.topology
    listed = np.flatnonzero(labels == -2)
    n = tangles.label_islands(listed, t.star_offsets, t.star_cells, *t.cells, labels)
    assert n == 3
    assert np.array_equal(labels, np.select([x <= 1, x == 3, x >= 5], [0, 1, 2], -1))


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_a_vertex_outside_its_star_goes_to_the_middle_of_where_all_is_good(kind):
    points, cells = fan(6, kind)
    points[0] = 3.0, -1.0
    mesh = Mesh(points, cells)
    assert invalid_cells(mesh).any()
    xy, lengths = mend(mesh, [0])
    assert not invalid_cells(mesh.with_points(xy)).any()
    assert np.abs(xy[0]).max() < 0.2
    assert lengths[0] == pytest.approx(np.hypot(*(xy[0] - points[0])))
    assert xy[1:].tobytes() == mesh.xy[1:].tobytes()
    # A vertex all of whose cells are good stays.
    again, lengths = mend(mesh.with_points(xy), [0])
    assert (again.tobytes(), lengths[0]) == (xy.tobytes(), 0.0)


@pytest.mark.nojit
def test_where_not_all_cells_can_be_good_most_are():
    # One ear of the ring lies within: its two cells can't both be good from where the others are.
    points, cells = fan(8, "triangle")
    points[3] = 0.9, -0.9
    points[0] = 4.0, 0.0
    mesh = Mesh(points, cells)
    xy, _ = mend(mesh, [0])
    after = bad_cells(mesh, xy).sum()
    assert after < bad_cells(mesh, mesh.xy).sum()
    # No place of a fine grid is better.
    for x in np.linspace(-1.5, 1.5, 25):
        for y in np.linspace(-1.5, 1.5, 25):
            trial = xy.copy()
            trial[0] = x, y
            assert bad_cells(mesh, trial).sum() >= after


@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("seed", range(3))
def test_mending_never_costs_a_cell(kind, seed):
    mesh = tangled(kind, 5, seed)
    movable = np.flatnonzero(~mesh.is_fixed)
    count = bad_cells(mesh, mesh.xy).sum()
    for _ in range(4):
        xy, lengths = mend(mesh, movable)
        mesh = mesh.with_points(xy)
        now = bad_cells(mesh, xy).sum()
        assert now <= count
        assert (lengths >= 0.0).all()
        count = now


@pytest.mark.nojit
def test_closed_corners_do_not_keep_a_vertex_from_mending():
    points, cells = grid(2, 2)
    points[4] = 2.7, 0.1
    mesh = Mesh(points, cells)
    closed = np.zeros(16, np.bool_)
    assert np.array_equal(mend(mesh, [4])[0], mend(mesh, [4], closed)[0])
    xy, lengths = mend(mesh, [4], ~closed)
    assert (xy.tobytes(), lengths[0]) == (mesh.xy.tobytes(), 0.0)
