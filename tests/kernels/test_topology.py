"""Connectivity against brute force, and orders and colours by their definition."""

import itertools

import numpy as np
import pytest
from hypothesis import given

import reference
from meshes import KINDS, annulus, fan, grid, random_mesh, random_meshes, renumber, turn_cells
from qsmooth import Mesh
from qsmooth.kernels import topology
from qsmooth.kernels.stars import NO_VERTEX


def rows(offsets, values):
    return [values[a:b].tolist() for a, b in itertools.pairwise(offsets)]


def given_cells(mesh):
    return [cell for block in mesh.cells for cell in block.tolist()]


@pytest.mark.nojit
@given(random_meshes())
def test_stars_rings_and_boundary_are_those_of_brute_force(made):
    mesh = made.mesh
    cells = given_cells(mesh)
    n = mesh.n_vertices
    assert rows(mesh.star_offsets, mesh.star_cells) == reference.stars(cells, n)
    assert rows(mesh.ring_offsets, mesh.ring_vertices) == reference.rings(cells, n)
    assert mesh.is_boundary.tolist() == reference.boundary(cells, n)
    assert np.array_equal(mesh.is_boundary, mesh.is_fixed)


@pytest.mark.nojit
@given(random_meshes())
def test_cells_run_alike_and_are_the_callers(made):
    mesh = made.mesh
    oriented = reference.as_lists(mesh)
    seen = set()
    for cell, theirs in zip(oriented, given_cells(mesh), strict=True):
        turned = cell[cell.index(theirs[0]) :] + cell[: cell.index(theirs[0])]
        assert turned in (theirs, [theirs[0], *theirs[:0:-1]])
        for side in reference.sides(cell):
            assert side not in seen
            seen.add(side)
    points = reference.as_complex(mesh.xy)
    assert all(reference.validity(points, cell) == 0 for cell in oriented)


@pytest.mark.nojit
@given(random_meshes())
def test_schedule_lists_each_movable_vertex_once_and_no_two_of_a_colour_share_a_cell(made):
    mesh = made.mesh
    schedule = mesh.topology.schedule(True)
    assert sorted(schedule.vertices.tolist()) == np.flatnonzero(~mesh.is_fixed).tolist()
    colours = rows(schedule.colour_offsets, schedule.vertices)
    assert all(colours)
    for cell in reference.as_lists(mesh):
        for colour in colours:
            assert len(set(cell) & set(colour)) <= 1
    for colour in colours:
        assert colour == sorted(colour)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_star_table_holds_the_other_corners_in_order(kind):
    mesh = random_mesh(kind, 4, seed=1, turned=0.5).mesh
    schedule = mesh.topology.schedule(True)
    cells = reference.as_lists(mesh)
    for i, v in enumerate(schedule.vertices.tolist()):
        span = slice(schedule.offsets[i], schedule.offsets[i + 1])
        assert schedule.cells[span].tolist() == reference.stars(cells, mesh.n_vertices)[v]
        for (_, *others), row in zip(reference.fan(v, cells), schedule.corners[span], strict=True):
            expected = others if len(others) == 3 else [others[0], int(NO_VERTEX), others[1]]
            assert row.tolist() == expected
    sizes = np.diff(schedule.offsets)
    assert schedule.largest == sizes.max()
    assert schedule.vertices.dtype == schedule.corners.dtype == schedule.cells.dtype == np.uint32


@pytest.mark.nojit
def test_a_hub_of_many_cells_is_sorted_and_coloured():
    points, cells = fan(60, "triangle")
    rng = np.random.default_rng(3)
    points, cells, new_of = renumber(points, cells, rng)
    mesh = Mesh(points, turn_cells(cells, rng))
    hub = new_of[0]
    ring = rows(mesh.ring_offsets, mesh.ring_vertices)[hub]
    assert ring == [v for v in range(61) if v != hub]
    assert mesh.topology.schedule(True).largest == 60


@pytest.mark.nojit
def test_twins_are_the_two_sides_of_one_edge():
    points, cells = grid(3, 2)
    vertices = cells[0].ravel()
    offsets = np.arange(0, vertices.size + 1, 4)
    stars = topology.stars(len(points), offsets, vertices)
    twins, n_bad, first_bad = topology.edge_twins(offsets, vertices, *stars)
    assert (n_bad, first_bad) == (0, -1)
    inside = np.flatnonzero(twins >= 0)
    assert len(inside) == 2 * 7
    assert np.array_equal(twins[twins[inside]], inside)
    heads = np.roll(vertices.reshape(-1, 4), -1, axis=1).ravel()
    assert np.array_equal(vertices[inside], heads[twins[inside]])


@pytest.mark.nojit
def test_the_first_offender_is_found():
    offsets = np.array([0, 3, 7])
    assert topology.find_bad_index(np.array([0, 1, 2, 3]), 4) == -1
    assert topology.find_bad_index(np.array([0, 1, 4, -1]), 4) == 2
    assert topology.find_bad_index(np.array([0, -1, 4]), 4) == 1
    assert topology.find_repeated_vertex(offsets, np.array([0, 1, 2, 0, 1, 2, 3])) == -1
    assert topology.find_repeated_vertex(offsets, np.array([0, 1, 2, 0, 1, 2, 0])) == 1


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("points_and_cells", "n_loops", "n_pinched"),
    [
        (grid(3, 2), 1, 0),
        (annulus(8, 2), 2, 0),
        ((np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)]), [np.array([(0, 1, 2), (0, 3, 4)])]),
         2, 1),
    ],
    ids=["grid", "annulus", "two triangles that meet in a point"],
)  # fmt: skip
def test_boundary_loops(points_and_cells, n_loops, n_pinched):
    mesh = Mesh(*points_and_cells)
    found, pinched = topology.boundary_loops(
        mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices, mesh.topology.twins
    )
    assert (found, pinched.sum()) == (n_loops, n_pinched)


@pytest.mark.nojit
def test_area_of_each_part_decides_and_then_the_majority():
    # Two parts of unlike sense: a valid mesh.
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    mesh = Mesh(np.concatenate([square, square + 3.0]), [(0, 1, 2, 3), (4, 7, 6, 5)])
    assert mesh.topology.n_parts == 2
    assert signs(mesh) == [1, 1]
    # A fold over an edge: the larger of its cells is the right way round.
    assert signs(Mesh([(0, 0), (0, 2), (1, 1), (2, 1)], [(0, 2, 1), (0, 1, 3)])) == [-1, 1]
    # A square whose centre lies far outside: its outline counts, and not the three cells turned.
    fan = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    for cells in (fan, [cell[::-1] for cell in fan]):
        assert signs(Mesh([*square, (0.5, 9.0)], cells)) == [1, 1, -1, 1]
        assert signs(Mesh([*square, (9.0, 9.0)], cells)) == [1, -1, -1, 1]
    # No area at all, 1 − 2 + 1: most cells.
    folded = [(0, 1, 2), (1, 0, 3), (2, 1, 4)]
    points = [(0, 0), (2, 0), (1, 1), (1, 2), (3, 1)]
    for cells in (folded, [cell[::-1] for cell in folded]):
        assert signs(Mesh(points, cells)) == [1, -1, 1]


def signs(mesh):
    points = reference.as_complex(mesh.xy)
    areas = [reference.area(points, cell) for cell in reference.as_lists(mesh)]
    return [(area > 0) - (area < 0) for area in areas]
