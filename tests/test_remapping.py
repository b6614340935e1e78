"""Values taken over to the same cells at other places."""

import numpy as np
import pytest

from meshes import grid, jitter, mixed, tangle, triangles
from qsmooth import Mesh, transfer
from qsmooth.kernels._jit import available_threads
from qsmooth.remapping import at_vertices

pytestmark = pytest.mark.nojit

KINDS = {
    "quads": lambda rng: grid(6, 5),
    "triangles": lambda rng: triangles(6, 5, rng),
    "mixed": lambda rng: mixed(6, 6, rng),
}


@pytest.fixture(params=KINDS)
def pair(request):
    """The same cells at two places."""
    rng = np.random.default_rng(7)
    points, cells = KINDS[request.param](rng)
    return [Mesh(jitter(points, cells, 0.9, rng), cells) for _ in range(2)]


def centroids(mesh):
    """Centroids and areas of cells, in triangles from the first corner."""
    found = []
    for block in mesh.cells:
        at = mesh.xy[block]
        area, moment = np.zeros(len(at)), np.zeros((len(at), 2))
        for i in range(1, at.shape[1] - 1):
            u, w = at[:, i] - at[:, 0], at[:, i + 1] - at[:, 0]
            part = 0.5 * (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0])
            area += part
            moment += part[:, None] * (at[:, 0] + (u + w) / 3)
        found.append(np.column_stack([moment / area[:, None], area]))
    both = np.concatenate(found)
    return both[:, :2], both[:, 2]


def linear(xy):
    return 3.0 + 2.0 * xy[:, 0] - 5.0 * xy[:, 1]


def test_linear_functions_are_exact_at_vertices(pair):
    old, new = pair
    found = transfer(old, new, linear(old.xy))
    assert np.abs(found - linear(new.xy)).max() < 1e-13
    assert np.abs(linear(old.xy) - linear(new.xy)).max() > 0.5  # what it is without


def test_between_corners_a_quad_is_bilinear():
    points, cells = grid(2, 2)
    new = points.copy()
    new[4] = 1.25, 1.5
    found = transfer((points, cells), (new, cells), points[:, 0] * points[:, 1])
    assert found[4] == 1.25 * 1.5


def test_vertices_that_have_not_moved_keep_their_bits(pair):
    old, new = pair
    values = np.random.default_rng(0).normal(size=old.n_vertices)
    found = transfer(old, new, values)
    rests = (old.xy == new.xy).all(axis=1)
    assert np.array_equal(found[rests], values[rests])
    assert not (found[~rests] == values[~rests]).any()
    assert found.min() >= values.min()
    assert found.max() <= values.max()


def test_shapes_and_types_stay(pair):
    old, new = pair
    for n, at in ((old.n_vertices, "vertices"), (old.n_cells, "cells")):
        values = np.random.default_rng(0).normal(size=(n, 3)).astype(np.float32)
        found = transfer(old, new, values, at)
        assert (found.shape, found.dtype) == (values.shape, np.float32)
        columns = [transfer(old, new, column.astype(float), at) for column in values.T]
        assert np.array_equal(found, np.stack(columns, axis=1).astype(np.float32))


def test_nan_spreads_to_what_it_has_weight_for():
    points, cells = grid(2, 2)
    values, new = np.zeros(9), points.copy()
    values[0] = np.nan
    new[4] = 1.5, 1.5
    assert transfer((points, cells), (new, cells), values)[4] == 0.0
    new[4] = 0.5, 0.5
    assert np.isnan(transfer((points, cells), (new, cells), values)[4])


@pytest.mark.parametrize("conserve", [False, True])
def test_means_of_linear_functions_are_exact(pair, conserve):
    old, new = pair
    values = linear(centroids(old)[0])
    found = transfer(old, new, values, "cells", conserve)
    assert np.abs(found - linear(centroids(new)[0])).max() < 1e-12


@pytest.mark.parametrize("conserve", [False, True])
def test_values_that_are_all_the_same_stay_so(pair, conserve):
    old, new = pair
    found = transfer(old, new, np.full((old.n_cells, 2), [0.1, -7e9]), "cells", conserve)
    np.testing.assert_allclose(found, np.full((old.n_cells, 2), [0.1, -7e9]), rtol=1e-13)


def test_sums_are_kept(pair):
    old, new = pair
    values = np.random.default_rng(1).uniform(1.0, 2.0, (old.n_cells, 2))
    before = (values * centroids(old)[1][:, None]).sum(axis=0)
    errors = {}
    for conserve in (True, False):
        found = transfer(old, new, values, at="cells", conserve=conserve)
        after = (found * centroids(new)[1][:, None]).sum(axis=0)
        errors[conserve] = np.abs(after / before - 1.0).max()
    assert errors[True] < 1e-14
    assert errors[False] > 1e-6


def test_sums_are_kept_where_the_boundary_moves():
    points, cells = grid(5, 5)
    new = points * (1.0 + 0.1 * points[:, ::-1])
    values = np.random.default_rng(1).uniform(1.0, 2.0, 25)
    found = transfer((points, cells), (new, cells), values, "cells", conserve=True)
    area = centroids(Mesh(new, cells))[1]
    assert (found * area).sum() == pytest.approx(values.sum(), rel=1e-14)


def test_a_smooth_function_stays_near_over_a_long_way():
    """A grid is squeezed by several cells: in steps, so that donors stay neighbours."""
    points, cells = grid(40, 4)
    old, new = Mesh(points, cells), points.copy()
    new[:, 0] = 40.0 * (points[:, 0] / 40.0) ** 1.6
    new = Mesh(new, cells)

    def wave(mesh):
        return 2.0 + np.sin(centroids(mesh)[0][:, 0] / 6.0)

    found = transfer(old, new, wave(old), "cells", conserve=True)
    assert np.abs(found - wave(new)).max() < 0.02
    assert (found * centroids(new)[1]).sum() == pytest.approx(wave(old).sum(), rel=1e-13)


def test_an_edge_between_two_cells_alone():
    points = np.array([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)], float)
    cells = [[0, 1, 4, 3], [1, 2, 5, 4]]
    new = points.copy()
    new[[1, 4], 0] = 1.25
    assert transfer((points, cells), (new, cells), np.array([4.0, 8.0]), "cells").tolist() == [
        4.5,
        8.5,
    ]
    found = transfer((points, cells), (new, cells), np.array([4.0, 8.0]), "cells", True)
    assert (found * [1.25, 0.75]).sum() == pytest.approx(12.0, rel=1e-15)


def test_one_cell_keeps_its_mean():
    points = np.array([(0, 0), (1, 0), (0, 1)], float)
    for conserve in (False, True):
        same = transfer((points, [[0, 1, 2]]), (points, [[0, 1, 2]]), [2.5], "cells", conserve)
        assert same.tolist() == [2.5]


@pytest.mark.parametrize("threads", [1, available_threads()])
def test_bits_do_not_depend_on_threads(pair, threads):
    old, new = pair
    vertices = np.arange(old.n_vertices)
    found = at_vertices(old, new.xy, vertices, threads)
    alone = at_vertices(old, new.xy, vertices, 1)
    assert np.array_equal(found.weights, alone.weights)
    assert np.array_equal(found.cells, alone.cells)


def test_a_mesh_that_was_folded_gives_values_between_its_own():
    rng = np.random.default_rng(3)
    points, cells = grid(8, 8)
    old = Mesh(tangle(points, cells, rng, 0.9), cells)
    values = rng.normal(size=old.n_vertices)
    found = transfer(old, (points, cells), values)
    assert values.min() <= found.min() <= found.max() <= values.max()
    was = np.abs(linear(old.xy) - linear(points)).max()
    found = transfer(old, (points, cells), linear(old.xy))
    assert np.abs(found - linear(points)).max() < 0.5 * was  # exact but where no cell is sound
    with pytest.raises(ValueError, match="positive area"):
        transfer(old, (points, cells), np.ones(64), "cells", conserve=True)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"at": "edges"}, ValueError, "at must be 'vertices' or 'cells', got 'edges'"),
        ({"conserve": True}, ValueError, "for means of cells"),
        ({"values": np.ones(8)}, ValueError, r"\(9,\) or \(9, k\), got \(8,\)"),
        ({"values": np.ones((9, 2, 2))}, ValueError, "values at vertices"),
        ({"values": np.ones(9, int)}, TypeError, "must be floats, got int64"),
        ({"new_mesh": grid(1, 8)}, ValueError, "the same cells"),
    ],
)
def test_what_is_refused(change, error, words):
    given = {"old_mesh": grid(2, 2), "new_mesh": grid(2, 2), "values": np.ones(9)}
    with pytest.raises(error, match=words):
        transfer(**{**given, **change})
