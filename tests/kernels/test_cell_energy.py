"""What cells are measured by after a round: against the plain twins, by hand, in any unit."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
import reference_optimizer as slow
from meshes import KINDS, grid, random_mesh, random_meshes
from qsmooth import Mesh, Validity, quality
from qsmooth.kernels import cell_energy as cell_kernels


def asked_of(mesh, *, maps=False):
    """Targets at random."""
    return slow.random_asked(reference.as_lists(mesh), np.random.default_rng(0), maps=maps)


def some_vertices(mesh, count=4):
    vertices = np.sort(mesh.topology.schedule(True).vertices).tolist()
    return vertices[:: max(1, len(vertices) // count)]


def targets_of(mesh, asked=None):
    """Targets of all corners; one over the area, and the weight; and the map of each cell."""
    owns = [(cell, slow.asked_of(cell, asked)) for cell in reference.as_lists(mesh)]
    targets = [own.targets[v] for cell, own in owns for v in cell]
    sizes = [(1.0 / own.area if own.area else 0.0, own.weight) for _, own in owns]
    maps = [own.map[[0, 0, 1], [0, 1, 1]] for _, own in owns] if asked else np.empty((0, 3))
    return np.array(targets), np.array(sizes), np.array(maps)


def cell_energy(mesh, movable, asked=None):
    worst, total = np.full((2, mesh.n_cells), np.nan)
    mask = np.zeros(mesh.n_vertices, np.bool_)
    mask[movable] = True
    cell_kernels.cell_energy(
        mesh.xy, *mesh.topology.cells, mask, *targets_of(mesh, asked), worst, total
    )
    return worst, total


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_cell_energy_agrees_with_the_reference(kind):
    mesh = random_mesh(kind, 3, seed=11, amount=0.8).mesh
    movable = some_vertices(mesh, 2)
    places = mesh.xy.tolist()
    for asked in (None, asked_of(mesh), asked_of(mesh, maps=True)):
        worst, total = cell_energy(mesh, movable, asked)
        for c, cell in enumerate(reference.as_lists(mesh)):
            _, g = slow.terms(places, [cell], set(movable))
            f, _ = slow.shape_terms(places, [cell], set(movable), asked)
            assert worst[c] == pytest.approx(max(g, default=0.0), rel=1e-12)
            share = 1.0 if len(cell) == 3 else 1.0 / 4.0
            assert total[c] == pytest.approx(share * math.fsum(f), rel=1e-12)


@pytest.mark.nojit
def test_badness_is_one_over_the_scaled_jacobian():
    mesh = random_mesh("mixed", 4, seed=12, amount=0.8).mesh
    worst, _ = cell_energy(mesh, np.arange(mesh.n_vertices))
    assert worst == pytest.approx(1.0 / quality(mesh).scaled_jacobian, rel=1e-12)


@pytest.mark.nojit
def test_an_invalid_corner_that_can_change_has_infinite_energy():
    points, cells = grid(2, 2)
    points[4] = 2.5, 1.0
    mesh = Mesh(points, cells)
    worst, total = cell_energy(mesh, [4])
    invalid = quality(mesh).validity != Validity.VALID
    assert np.array_equal(np.isinf(worst), invalid)
    assert np.array_equal(np.isinf(total), invalid)
    worst, total = cell_energy(mesh, [])
    assert not worst.any()
    assert not total.any()


@given(st.sampled_from(sorted(KINDS)), st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 1e9]))
def test_energies_have_no_unit(kind, seed, scale):
    made = random_mesh(kind, 4, seed=seed, amount=1.0)
    everyone = np.arange(len(made.points))
    own = cell_energy(made.mesh, everyone)
    scaled = cell_energy(made.mesh.with_points(made.points * scale), everyone)
    np.testing.assert_allclose(scaled, own, rtol=1e-9)


# ------------------------------------------------------------------------------- heights


@pytest.mark.nojit
@pytest.mark.parametrize("squarings", range(1, 7))
def test_heights_are_energy_and_walls_of_what_counts(squarings):
    energy = np.array([1.0, 1.5, 2.0, 1.25, np.inf])
    worst, badness = np.array([1.1, 2.0, 3.0, 1.5, np.inf]), np.array([1.2, 1.4, 2.0, 1.1, np.inf])
    weights = np.array([4.0, 0.0, 1.0, -1.0, 1.0])
    slim, scale = np.array([0.5, 0.6, 0.0, 0.5, 0.0]), np.array([0.8, 0.0, 0.5, 0.8, 0.0])
    out = np.full(5, np.nan)
    cell_kernels.cell_heights(energy, worst, badness, weights, slim, scale, squarings, out)
    power = 2**squarings
    expected = [4.0 + 0.55**16 + 0.96**power, 1.2**16, 2.0 + 1.0**power, 0.0, np.inf]
    np.testing.assert_allclose(out, expected, rtol=1e-12)


# ------------------------------------------------------------------------------- worst around


def worst_around(mesh, values, rings):
    given = values.copy()
    found = cell_kernels.worst_around(values, rings, *mesh.topology.cells, mesh.n_vertices)
    assert np.array_equal(values, given)
    return found


@pytest.mark.nojit
def test_worst_of_a_row_of_squares_is_that_of_so_many_on_either_side():
    mesh = Mesh(*grid(7, 1))
    values = np.array([3.0, 0.0, 0.0, 1.0, 0.0, 2.0, 5.0])
    assert worst_around(mesh, values, 0).tolist() == values.tolist()
    assert worst_around(mesh, values, 1).tolist() == [3.0, 3.0, 1.0, 1.0, 2.0, 5.0, 5.0]
    assert worst_around(mesh, values, 2).tolist() == [3.0, 3.0, 3.0, 2.0, 5.0, 5.0, 5.0]
    assert worst_around(mesh, values, 7).tolist() == [5.0] * 7


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("rings", [0, 1, 3])
def test_worst_around_agrees_with_the_plain_one(kind, rings):
    mesh = random_mesh(kind, 4, seed=2).mesh
    values = np.random.default_rng(1).exponential(size=mesh.n_cells)
    expected = slow.worst_around(values.tolist(), reference.as_lists(mesh), rings)
    assert worst_around(mesh, values, rings).tolist() == expected


@given(random_meshes(), st.integers(0, 4))
def test_worst_around_never_falls_with_the_rings_and_ends_at_the_worst(made, rings):
    mesh = made.mesh
    values = np.random.default_rng(rings).exponential(size=mesh.n_cells)
    fewer, more = (worst_around(mesh, values, rings + k) for k in (0, 1))
    assert (values <= fewer).all()
    assert (fewer <= more).all()
    assert worst_around(mesh, more, mesh.n_cells).max() == values.max()
