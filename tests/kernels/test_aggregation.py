"""Numbers of neighbours near each other, aggregates, and patterns that come out sorted."""

import numpy as np
import pytest

from meshes import random_mesh, renumber
from qsmooth import Mesh
from qsmooth.kernels.aggregation import UNNUMBERED, aggregate, breadth_first, sorted_rows
from qsmooth.kernels.shape_hessian import block_pattern

pytestmark = pytest.mark.nojit


def numbered(mesh, movable):
    topology = mesh.topology
    unknown = np.where(movable, UNNUMBERED, -1)
    starts = np.flatnonzero(movable)
    vertices, cells = np.full(starts.size, -5), np.full(mesh.n_cells, -5)
    stars = topology.star_offsets, topology.star_cells
    n = breadth_first(starts, *stars, *topology.cells, unknown, vertices, cells)
    return unknown, vertices, cells[:n]


def scattered(kind, seed):
    mesh = random_mesh(kind, 8, seed=seed).mesh
    return Mesh(*renumber(mesh.points, mesh.cells, np.random.default_rng(seed))[:2])


@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_each_movable_vertex_has_a_number_and_each_cell_around_is_listed_once(kind):
    mesh = scattered(kind, 1)
    movable = ~mesh.is_boundary
    movable[np.flatnonzero(movable)[::7]] = False
    unknown, vertices, cells = numbered(mesh, movable)
    assert np.array_equal(np.sort(vertices), np.flatnonzero(movable))
    assert np.array_equal(unknown[vertices], np.arange(vertices.size))
    assert (unknown[~movable] == -1).all()
    owner = np.repeat(np.arange(mesh.n_cells), np.diff(mesh.cell_offsets))
    around = np.unique(owner[movable[mesh.cell_vertices]])
    assert np.array_equal(np.sort(cells), around)


def test_neighbours_have_numbers_near_each_other():
    mesh = scattered("quads", 2)
    unknown, vertices, _ = numbered(mesh, ~mesh.is_boundary)
    offsets, columns = pattern(mesh, unknown, vertices)
    rows = np.repeat(np.arange(vertices.size), np.diff(offsets))
    assert np.abs(rows - columns.astype(int)).max() < 4 * vertices.size**0.5


def pattern(mesh, unknown, vertices):
    topology = mesh.topology
    stars = topology.star_offsets, topology.star_cells
    return block_pattern(unknown, vertices.size, *topology.cells, *stars, vertices)


@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_aggregates_are_neighbours_and_leave_nobody_out(kind):
    mesh = scattered(kind, 3)
    unknown, vertices, _ = numbered(mesh, ~mesh.is_boundary)
    offsets, columns = pattern(mesh, unknown, vertices)
    label = np.full(vertices.size, -9)
    n = aggregate(offsets, columns, label)
    assert np.array_equal(np.unique(label), np.arange(n))
    near = np.zeros((vertices.size, vertices.size), bool)
    near[np.repeat(np.arange(vertices.size), np.diff(offsets)), columns] = True
    for k in range(n):
        members = np.flatnonzero(label == k)
        # One of them, the root, has all that came first for neighbours; others are one farther.
        reach = near[np.ix_(members, members)]
        assert (reach @ reach).all(axis=1).any()
    assert n < vertices.size / 3


def test_rows_of_a_symmetric_map_are_sorted():
    rng = np.random.default_rng(0)
    full = rng.random((30, 30)) < 0.2
    full |= full.T
    offsets = np.concatenate([[0], np.cumsum(full.sum(axis=1))])
    expected = np.nonzero(full)[1]
    mixed = np.concatenate([rng.permutation(np.flatnonzero(row)) for row in full])
    assert np.array_equal(sorted_rows(offsets, mixed.astype(np.uint32)), expected)
