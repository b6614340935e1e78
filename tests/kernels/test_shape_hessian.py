"""The matrix of a Newton step on the whole mesh: against jets, eigh and a dense sum."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
import reference_optimizer as slow
from meshes import KINDS, grid, random_mesh, random_meshes
from qsmooth import Mesh
from qsmooth.kernels import shape_hessian


def corner(u, w):
    gradient, matrix = np.full(4, np.nan), np.full((4, 4), np.nan)
    shape_hessian.corner_derivatives(*u, *w, gradient, matrix)
    return gradient, matrix


def assembled(mesh, vertices=None, asked=None):
    """Gradient and dense matrix by the kernels, of all movable vertices or of those given."""
    owns = [(cell, slow.asked_of(cell, asked)) for cell in reference.as_lists(mesh)]
    targets = np.array([own.targets[v] for cell, own in owns for v in cell])
    sizes = np.array([(1.0 / own.area if own.area else 0.0, own.weight) for _, own in owns])
    maps = np.empty((0, 3))
    if asked:
        maps = np.array([own.map[[0, 0, 1], [0, 1, 1]] for _, own in owns])
    if vertices is None:
        vertices = np.sort(mesh.topology.schedule(True).vertices.astype(np.int64))
    n = len(vertices)
    unknown = np.full(mesh.n_vertices, -1, np.int64)
    unknown[vertices] = np.arange(n)
    cells = mesh.cell_offsets, mesh.cell_vertices
    offsets, columns = shape_hessian.block_pattern(
        unknown, n, *cells, mesh.star_offsets, mesh.star_cells, vertices
    )
    gradient, values = np.full((n, 2), np.nan), np.full((columns.size, 2, 2), np.nan)
    shape_hessian.assemble(
        mesh.xy, *cells, mesh.topology.cell_ids, unknown, offsets, columns, targets, sizes, maps,
        gradient, values,
    )  # fmt: skip
    dense = np.zeros((2 * n, 2 * n))
    for r in range(n):
        for k in range(offsets[r], offsets[r + 1]):
            c = columns[k]
            dense[2 * r : 2 * r + 2, 2 * c : 2 * c + 2] = values[k]
    return vertices.tolist(), offsets, columns, gradient, dense


CORNERS = {
    "square": ((1.0, 0.0), (0.0, 1.0)),
    "turned square": ((0.6, 0.8), (-0.8, 0.6)),
    "thin": ((1.0, 0.0), (0.0, 1e-3)),
    "nearly flat": ((1.0, 0.0), (-1.0, 1e-3)),
    "nearly folded": ((1.0, 0.0), (1.0, 1e-3)),
    "60 degrees": ((1.0, 0.0), (0.5, 0.75**0.5)),
}


@pytest.mark.nojit
@pytest.mark.parametrize(("u", "w"), CORNERS.values(), ids=CORNERS.keys())
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a_corners_matrix_is_the_projected_hessian(u, w, unit):
    u, w = unit * np.array(u), unit * np.array(w)
    gradient, matrix = corner(u, w)
    jet = slow.corner_jet(u, w)
    scale = np.abs(jet.hessian).max()
    np.testing.assert_allclose(gradient * unit, jet.gradient * unit, rtol=1e-9, atol=1e-9)
    expected = slow.semi_definite(jet.hessian)
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-9 * scale)
    assert np.linalg.eigvalsh(matrix)[0] >= -1e-12 * scale


@pytest.mark.nojit
def test_the_hessian_of_a_corner_has_a_direction_to_clip():
    # Else the test above would say nothing.
    for u, w in CORNERS.values():
        eigenvalues = np.linalg.eigvalsh(slow.corner_jet(np.array(u), np.array(w)).hessian)
        assert eigenvalues[0] < 0.0 or (u, w) in (CORNERS["square"], CORNERS["turned square"])


LENGTH = st.floats(0.5, 2.0)


@given(LENGTH, LENGTH, st.floats(0.0, 2.0 * math.pi), st.floats(0.05, math.pi - 0.05))
def test_any_positive_corner(length, other, direction, angle):
    u = length * np.array([math.cos(direction), math.sin(direction)])
    w = other * np.array([math.cos(direction + angle), math.sin(direction + angle)])
    gradient, matrix = corner(u, w)
    jet = slow.corner_jet(u, w)
    scale = np.abs(jet.hessian).max()
    np.testing.assert_allclose(gradient, jet.gradient, rtol=0, atol=1e-9 * (1.0 + scale))
    np.testing.assert_allclose(matrix, slow.semi_definite(jet.hessian), rtol=0, atol=1e-8 * scale)


@pytest.mark.nojit
def test_jets_agree_with_differences():
    # What everything here is measured by.
    at, h = np.array([1.0, 0.2, -0.3, 0.9]), 1e-5

    def jet(x):
        return slow.corner_jet(x[:2], x[2:])

    here = jet(at)
    for k, axis in enumerate(np.eye(4)):
        up, down = jet(at + h * axis), jet(at - h * axis)
        assert here.gradient[k] == pytest.approx((up.value - down.value) / (2 * h), abs=1e-8)
        slopes = (up.gradient - down.gradient) / (2 * h)
        np.testing.assert_allclose(here.hessian[k], slopes, rtol=0, atol=1e-7)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "annulus", "quad fan"])
@pytest.mark.parametrize("targets", ["ideal", "any", "mapped"])
def test_the_assembled_matrix_agrees_with_the_dense_sum(kind, targets):
    mesh = random_mesh(kind, 3, seed=3, amount=0.5).mesh
    cells = reference.as_lists(mesh)
    asked = None
    if targets != "ideal":
        asked = slow.random_asked(cells, np.random.default_rng(1), maps=targets == "mapped")
    unknowns, _, _, gradient, dense = assembled(mesh, asked=asked)
    expected = slow.gradient_and_hessian(reference.as_complex(mesh.xy), cells, unknowns, asked)
    scale = np.abs(expected[1]).max()
    np.testing.assert_allclose(gradient.ravel(), expected[0], rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(dense, expected[1], rtol=0, atol=1e-11 * scale)
    assert np.linalg.eigvalsh(dense)[0] >= -1e-12 * scale


@pytest.mark.nojit
@pytest.mark.parametrize("valence", [15, 16, 17, 33, 70])
def test_the_blocks_of_a_long_row_are_found(valence):
    """The hub of a fan is in one cell with all others."""
    angle = 2.0 * math.pi * np.arange(valence) / valence
    rim = np.random.default_rng(valence).permutation(valence + 1)
    hub, rim = rim[0], rim[1:]
    points = np.zeros((valence + 1, 2))
    points[rim] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    mesh = Mesh(points, [(hub, rim[k - 1], rim[k]) for k in range(valence)])
    unknowns, offsets, _, gradient, dense = assembled(mesh, np.arange(valence + 1))
    assert np.diff(offsets).max() == valence + 1
    cells = reference.as_lists(mesh)
    expected = slow.gradient_and_hessian(reference.as_complex(mesh.xy), cells, unknowns)
    scale = np.abs(expected[1]).max()
    np.testing.assert_allclose(gradient.ravel(), expected[0], rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(dense, expected[1], rtol=0, atol=1e-11 * scale)


@given(random_meshes(sizes=st.integers(2, 4)), st.integers(0, 2**32 - 1))
def test_the_matrix_is_symmetric_and_semi_definite_and_the_step_points_downhill(made, seed):
    mesh = made.mesh
    vertices = np.sort(mesh.topology.schedule(True).vertices.astype(np.int64))
    some = vertices[np.random.default_rng(seed).random(vertices.size) < 0.8]
    _, offsets, columns, gradient, dense = assembled(mesh, some)
    scale = np.abs(dense).max(initial=1e-300)
    np.testing.assert_allclose(dense, dense.T, rtol=0, atol=1e-13 * scale)
    if some.size:
        assert np.linalg.eigvalsh(dense / scale)[0] >= -1e-12
        # Scaled, as squares of 1e30 have no determinant.
        step = np.linalg.lstsq(dense / scale, -gradient.ravel(), rcond=None)[0]
        assert step @ gradient.ravel() <= 1e-12 * np.abs(gradient).max() * np.abs(step).max()
    for r in range(some.size):
        row = columns[offsets[r] : offsets[r + 1]]
        assert (np.diff(row) > 0).all()
        assert r in row


@pytest.mark.nojit
@pytest.mark.parametrize("kind", KINDS)
def test_the_gradient_agrees_with_differences_of_the_energy(kind):
    mesh = random_mesh(kind, 3, seed=7, amount=0.4).mesh
    unknowns, _, _, gradient, _ = assembled(mesh)
    cells, h = reference.as_lists(mesh), 1e-6
    for row, v in list(enumerate(unknowns))[:4]:
        for d in range(2):
            ends = []
            for sign in (1.0, -1.0):
                xy = mesh.xy.copy()
                xy[v, d] += sign * h
                points = reference.as_complex(xy)
                ends.append(slow.total_energy(points, cells, unknowns, 1.0, np.inf, 1))
            slope = (ends[0] - ends[1]) / (2.0 * h)
            assert gradient[row, d] == pytest.approx(slope, abs=1e-5 * (1.0 + abs(slope)))


@pytest.mark.nojit
def test_the_pattern_couples_the_movable_vertices_of_each_cell():
    _, offsets, columns, *_ = assembled(Mesh(*grid(4, 4)))
    rows = [columns[a:b].tolist() for a, b in itertools.pairwise(offsets)]
    # Three by three interior vertices: the centre has all nine, a corner four.
    assert rows[4] == list(range(9))
    assert rows[0] == [0, 1, 3, 4]
    assert rows[5] == [1, 2, 4, 5, 7, 8]
