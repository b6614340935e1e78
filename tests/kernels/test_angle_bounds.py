"""Bounds at a vertex: by hand, and against the slow version."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
import reference_optimizer as slow
from meshes import KINDS, fan, grid, random_mesh, random_meshes
from qsmooth import Mesh
from qsmooth.kernels.angle_bounds import NO_SWINGS, Swings, angle_bounds
from qsmooth.kernels.topology import corner_cells, stars


def bounds(mesh, slides=(), swings=NO_SWINGS):
    """Bounds of every vertex, and which may move."""
    topology = mesh.topology
    movable = np.zeros(mesh.n_vertices, np.bool_)
    movable[topology.schedule(True).vertices] = True
    movable[list(slides)] = True
    offsets, _, corners = stars(mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices)
    smallest, largest = np.full((2, mesh.n_vertices), np.nan)
    angle_bounds(
        mesh.xy, mesh.cell_offsets, mesh.cell_vertices, corner_cells(mesh.cell_offsets),
        topology.twins, offsets, corners, movable, swings, smallest, largest,
    )  # fmt: skip
    return smallest, largest, movable


@pytest.mark.nojit
def test_a_grid_of_squares_has_90_degrees_everywhere():
    smallest, largest, _ = bounds(Mesh(*grid(3, 3)))
    assert smallest == pytest.approx(np.full(16, 90.0))
    assert largest == pytest.approx(np.full(16, 90.0))


@pytest.mark.nojit
@pytest.mark.parametrize("swing", [0.0, 4.0])
def test_edges_between_sliding_vertices_are_known_up_to_how_far_they_turn(swing):
    """Vertex 1 slides between the corners 0 and 2 of a row of two squares."""
    mesh = Mesh(*grid(2, 1))
    turn, after, before = np.full((3, 6), -1.0)
    turn[1], after[1], before[1] = 3.0, swing, 2.0 * swing
    smallest, largest, _ = bounds(mesh, [1], Swings(turn, after, before))
    assert (smallest[1], largest[1]) == pytest.approx((91.5, 88.5))
    assert (smallest[0], largest[0]) == pytest.approx((90.0 + swing, 90.0 - swing))
    assert (smallest[2], largest[2]) == pytest.approx((90.0 + 2 * swing, 90.0 - 2 * swing))
    assert (smallest[4], largest[4]) == pytest.approx((90.0, 90.0))
    # Of what just moves nothing is known.
    smallest, largest, _ = bounds(mesh, [1])
    assert [*smallest[:3], *largest[:3]] == [360.0, 360.0, 360.0, 0.0, 0.0, 0.0]


@pytest.mark.nojit
@pytest.mark.parametrize("valence", [3, 5, 8, 12])
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_a_free_hub_shares_a_full_turn(kind, valence):
    smallest, largest, _ = bounds(Mesh(*fan(valence, kind)))
    assert smallest[0] == largest[0] == 360.0 / valence


@pytest.mark.nojit
def test_a_vertex_in_no_cell_bounds_nothing():
    points, cells = grid(1, 1)
    smallest, largest, _ = bounds(Mesh([*points, (5.0, 5.0)], cells))
    assert (smallest[-1], largest[-1]) == (360.0, 0.0)


@pytest.mark.nojit
def test_one_fixed_edge_at_a_fixed_hub_leaves_a_full_turn():
    points, cells = grid(4, 4)
    fixed = np.zeros(25, np.bool_)
    fixed[[12, 13]] = True
    smallest, largest, _ = bounds(Mesh(points, cells, fixed=fixed))
    assert smallest[12] == largest[12] == 90.0


def agree(mesh):
    smallest, largest, movable = bounds(mesh)
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    for v in range(mesh.n_vertices):
        shares = slow.angle_shares(points, v, cells, movable)
        assert smallest[v] == pytest.approx(min(shares, default=360.0), abs=1e-7)
        assert largest[v] == pytest.approx(max(shares, default=0.0), abs=1e-7)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", KINDS)
def test_bounds_agree_with_the_slow_version(kind):
    agree(random_mesh(kind, 3, seed=2, amount=0.7).mesh)


@given(random_meshes(), st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.4, 0.8]))
@settings(max_examples=80)
def test_bounds_agree_with_any_vertices_fixed(made, seed, share):
    fixed = np.random.default_rng(seed).random(len(made.points)) < share
    agree(Mesh(made.points, made.cells, fixed=fixed))
