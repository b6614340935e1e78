"""Both Laplacian sweeps: by hand, and against the reference."""

import numpy as np
import pytest

import reference
from meshes import KINDS, fan, grid, random_mesh
from qsmooth import Mesh, smooth
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.angle import angle_sweep, star_polygons
from qsmooth.kernels.blocks import LANES, build_blocks
from qsmooth.kernels.centroid import centroid_sweep
from qsmooth.kernels.laplacian import laplacian_sweep
from qsmooth.kernels.ring_blocks import build_ring_blocks
from qsmooth.kernels.stars import Moves, Rings


def agree(mesh, xy, expected):
    size = np.ptp(mesh.xy, axis=0).max()
    np.testing.assert_allclose(xy, [(z.real, z.imag) for z in expected], rtol=0, atol=1e-11 * size)


@pytest.mark.nojit
@pytest.mark.parametrize("method", ["laplacian", "smart-laplacian"])
def test_centre_goes_to_the_mean_of_its_ring(method):
    points, cells = grid(2, 2)
    points[4] = (1.25, 0.75)
    points[5] = (2.5, 1.0)  # the ring is 1, 3, 5, 7; the opposite corners do not count
    result = smooth(Mesh(points, cells), method, max_sweeps=1)
    assert result.points[4] == pytest.approx((1.125, 1.0), abs=1e-15)
    assert result.history[0].largest_move == pytest.approx(np.hypot(0.125, 0.25))


@pytest.mark.nojit
def test_all_at_once_and_not_one_after_the_other():
    points, cells = grid(3, 2)  # two interior vertices, 5 and 6
    points[5] = (1.0, 1.4)
    result = smooth(Mesh(points, cells), "laplacian", max_sweeps=1)
    assert result.points[5] == pytest.approx((1.0, 1.0), abs=1e-15)
    assert result.points[6] == pytest.approx((2.0, 1.1), abs=1e-15)


@pytest.mark.nojit
@pytest.mark.parametrize("valence", [3, 4, 5, 7, 12, 40])
def test_any_valence_reaches_the_mean_in_one_sweep(valence):
    points, cells = fan(valence, "triangle")
    points[1:] *= 1.0 + 0.1 * np.cos(2.1 * np.arange(valence))[:, None]
    result = smooth((points, cells), "laplacian", max_sweeps=1)
    np.testing.assert_allclose(result.points[0], points[1:].mean(axis=0), atol=1e-15)
    np.testing.assert_array_equal(result.points[1:], points[1:])


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_plain_sweeps_agree_with_the_reference(kind):
    mesh = random_mesh(kind, 6, seed=21, amount=0.9, turned=0.5).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    for n in (1, 2, 3):
        points = reference.laplacian_sweep(points, cells, order)
        agree(mesh, smooth(mesh, "laplacian", max_sweeps=n, rtol=0.0).mesh.xy, points)


@pytest.mark.parametrize("guard", ["quality", "clearance"])
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_smart_sweeps_agree_with_the_reference(kind, guard):
    mesh = random_mesh(kind, 6, seed=22, amount=0.9, turned=0.5).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    worst = min(reference.scaled_jacobian(points, cell) for cell in cells)
    options = reference.Options(good=max(0.5, worst) if guard == "quality" else None)
    for n in (1, 2, 3):
        points = reference.smart_laplacian_sweep(points, cells, order, options)
        result = smooth(mesh, "smart-laplacian", max_sweeps=n, rtol=0.0, guard=guard)
        agree(mesh, result.mesh.xy, points)


def ring_blocks(mesh):
    movable = np.sort(mesh.topology.schedule(True).vertices)
    return build_ring_blocks(movable, Rings(*mesh.topology.rings))


AT_ONCE = {
    "laplacian": lambda mesh, stars, xy, moves: laplacian_sweep(
        mesh.xy, ring_blocks(mesh), xy, moves
    ),
    "centroid": lambda mesh, stars, xy, moves: centroid_sweep(
        mesh.xy, build_blocks(stars), xy, moves
    ),
    "angle": lambda mesh, stars, xy, moves: angle_sweep(
        mesh.xy, build_blocks(stars), star_polygons(build_blocks(stars)), 0.7, xy, moves
    ),
}


@pytest.mark.parametrize("name", AT_ONCE)
def test_sweeps_all_at_once_measure_their_moves_on_any_number_of_threads(name):
    mesh = random_mesh("mixed", 6, seed=23, amount=0.9).mesh
    stars = mesh.topology.schedule(True)
    order = (ring_blocks(mesh) if name == "laplacian" else build_blocks(stars)).vertices
    found = []
    for threads in (1, 2):
        xy, moves = mesh.xy.copy(), Moves(*np.full((2, stars.vertices.size), np.nan))
        with use_threads(threads):
            AT_ONCE[name](mesh, stars, xy, moves)
        assert np.hypot(*(xy - mesh.xy)[order].T) == pytest.approx(moves.lengths)
        assert (moves.shares > 0.0).all()
        found.append([xy.tobytes(), moves.lengths.tobytes(), moves.shares.tobytes()])
    assert found[0] == found[1]


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_blocks_of_rings_hold_each_movable_vertex_once_with_all_its_neighbours(kind):
    mesh = random_mesh(kind, 12, seed=4).mesh
    table, vertices, neighbours, _ = ring_blocks(mesh)
    assert sorted(vertices.tolist()) == np.flatnonzero(~mesh.is_fixed).tolist()
    rings = reference.rings(reference.as_lists(mesh), mesh.n_vertices)
    vertex, entry = 0, 0
    for first, size, n_neighbours, start in table.tolist():
        assert (first, start) == (vertex, entry)
        assert 0 < size <= LANES
        for v in vertices[first : first + size].tolist():
            assert neighbours[entry : entry + n_neighbours].tolist() == rings[v]
            entry += n_neighbours
        vertex += size
    assert (vertex, entry) == (vertices.size, neighbours.size)


@pytest.mark.nojit
def test_a_move_from_an_edge_of_no_length_is_an_infinite_share():
    points, cells = grid(2, 2)
    points[4] = points[1]
    mesh = Mesh(points, cells)
    xy, moves = mesh.xy.copy(), Moves(np.zeros(1), np.zeros(1))
    laplacian_sweep(mesh.xy, ring_blocks(mesh), xy, moves)
    assert moves.shares[0] == np.inf
    laplacian_sweep(xy.copy(), ring_blocks(mesh), xy, moves)
    assert moves.shares[0] == 0.0
