"""Colours by their definition: of ids and connectivity, and of nothing else."""

import itertools

import numpy as np
import pytest

from meshes import KINDS, fan, grid, random_mesh, renumber, rough_grid
from qsmooth import Mesh
from qsmooth.kernels import colouring
from qsmooth.kernels.numbering import sort_rows
from qsmooth.schedule import colours


def arrays(mesh):
    topology = mesh.topology
    stars = topology.star_offsets, topology.star_cells
    return topology.movable(), topology.vertex_ids, topology.cells, stars


def neighbours(mesh, movable):
    """Movable vertices that share a cell with each vertex."""
    near = [set() for _ in range(mesh.n_vertices)]
    for first, last in itertools.pairwise(mesh.cell_offsets):
        corners = mesh.cell_vertices[first:last].tolist()
        for v, w in itertools.permutations(corners, 2):
            if movable[w]:
                near[v].add(w)
    return near


@pytest.mark.nojit
def test_priorities_are_those_of_murmur3_and_differ():
    def fmix64(h):
        mask = 2**64 - 1
        h = ((h ^ (h >> 33)) * 0xFF51AFD7ED558CCD) & mask
        h = ((h ^ (h >> 33)) * 0xC4CEB9FE1A85EC53) & mask
        return h ^ (h >> 33)

    ids = [0, 1, 2, 12_345_678, 2**32 - 3]
    assert [int(colouring.priority(v)) for v in ids] == [fmix64(v) for v in ids]


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_first_fit_goes_by_priority(kind):
    mesh = random_mesh(kind, 5, seed=2).mesh
    movable, ids, cells, stars = arrays(mesh)
    colour, taken = colouring.first_fit(movable, ids, *cells, *stars)
    near, expected = neighbours(mesh, movable), np.full(mesh.n_vertices, -1)
    order = sorted(np.flatnonzero(movable), key=lambda v: -int(colouring.priority(v)))
    for v in order:
        used = {expected[w] for w in near[v]}
        expected[v] = next(c for c in itertools.count() if c not in used)
    assert colour.tolist() == expected.tolist()
    for c, (first, last) in enumerate(itertools.pairwise(cells[0])):
        own = colour[cells[1][first:last]]
        assert int(taken[c]) == sum(1 << int(k) for k in own if k >= 0)


@pytest.mark.nojit
@pytest.mark.parametrize("selected", [False, True])
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_no_two_vertices_that_share_a_cell_have_one_colour(kind, selected):
    mesh = random_mesh(kind, 6, seed=1).mesh
    movable, *others = arrays(mesh)
    if selected:
        movable = movable & (np.random.default_rng(0).random(mesh.n_vertices) < 0.6)
    colour, n_colours = colours(movable, *others)
    assert np.array_equal(colour >= 0, movable)
    assert sorted(set(colour[movable].tolist())) == list(range(n_colours))
    for v, near in enumerate(neighbours(mesh, movable)):
        assert not movable[v] or all(colour[w] != colour[v] for w in near)


def test_quads_get_six_colours_and_triangles_five():
    rng = np.random.default_rng(0)
    points, quads = rough_grid(150)
    for n in (points, quads), renumber(points, quads, rng)[:2]:
        assert colours(*arrays(Mesh(*n)))[1] <= 6
    assert colours(*arrays(random_mesh("triangles", 60, seed=0).mesh))[1] <= 6
    assert colours(*arrays(Mesh(*fan(500, "triangle"))))[1] == 1


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_colours_and_stars_do_not_depend_on_the_order_in_memory(kind):
    topology = random_mesh(kind, 6, seed=3).mesh.topology
    inner = topology.renumbered(np.random.default_rng(5).permutation(topology.n_vertices))
    ours, theirs = (t.schedule() for t in (topology, inner))
    assert ours.colour_offsets.tolist() == theirs.colour_offsets.tolist()

    def stars(topology, schedule):
        """By the caller's ids: each vertex with its colour and the rows of its star, in order."""
        ids = np.append(topology.vertex_ids, -1)
        found = {}
        for colour, (start, stop) in enumerate(itertools.pairwise(schedule.colour_offsets)):
            for i in range(start, stop):
                span = slice(schedule.offsets[i], schedule.offsets[i + 1])
                corners = np.minimum(schedule.corners[span].astype(np.int64), ids.size - 1)
                own = topology.cell_ids[schedule.cells[span]].tolist(), ids[corners].tolist()
                found[int(ids[schedule.vertices[i]])] = colour, *own
        return found

    assert stars(topology, ours) == stars(inner, theirs)


@pytest.mark.nojit
def test_a_grid_of_few_vertices_has_as_few_colours():
    assert colours(*arrays(Mesh(*grid(1, 1))))[1] == 0
    assert colours(*arrays(Mesh(*grid(2, 2))))[1] == 1
    assert colours(*arrays(Mesh(*grid(3, 3))))[1] == 4


@pytest.mark.nojit
@pytest.mark.parametrize("length", [0, 1, 4, 23, 24, 25, 100, 317])
def test_rows_are_sorted_by_ids_with_what_goes_along(length):
    rng = np.random.default_rng(length)
    ids, values = rng.permutation(400), rng.permutation(400)[: length + 3]
    others, before = 7 * values, values.copy()
    sort_rows(np.array([0, 2, 2 + length]), values, others, ids)
    assert np.diff(ids[values[2 : 2 + length]]).min(initial=1) > 0
    assert sorted(values[2 : 2 + length]) == sorted(before[2 : 2 + length])
    assert sorted(values[:2]) == sorted(before[:2])
    assert values[-1] == before[-1]
    assert np.array_equal(others, 7 * values)
