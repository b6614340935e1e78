"""Sweeps towards targets with a direction: against jets, the plain twin, and a stretched plane."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
import reference_optimizer as slow
from meshes import random_mesh
from qsmooth import Mesh
from qsmooth.kernels import lanes, mapped_sweep, newton_sweep
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.blocks import LANES, build_blocks, row_corners

ENERGIES = [(1.0, math.inf, 1), (1.0, 1.5, 2), (0.5, 3.0, 5), (1.0, 1.1, 6)]
FREE = (2.0, -2.0, -2.0, 1e300, 1e300, -1e300)


def sweep(mesh, energy, asked, *, xy=None, threads=1, held=FREE):
    """Sweep once; returns new coordinates and the vertices in their order."""
    blocks = build_blocks(mesh.topology.schedule(True))
    lists = reference.as_lists(mesh)
    vertices = mesh.cell_vertices[row_corners(blocks, *mesh.topology.cells)].tolist()
    owns = [slow.asked_of(lists[c], asked) for c in blocks.cells.tolist()]
    shapes = np.array([own.targets[v] for v, own in zip(vertices, owns, strict=True)])
    rest = np.array([(own.area or 0.0, own.weight, own.slim) for own in owns]).T.copy()
    near = np.array([own.near for own in owns])
    maps = np.array([own.map[[0, 0, 1], [0, 1, 1]] for own in owns]).T.copy()
    xy = (mesh.xy if xy is None else xy).copy()
    with use_threads(threads):
        mapped_sweep.mapped_sweep(
            xy,
            blocks,
            (0, blocks.colour_blocks.size - 1),
            1.7,
            newton_sweep.Wall(float(energy[0]), float(energy[1]), energy[2]),
            np.tile(held, (mesh.n_vertices, 1)),
            slow.rows_of(mesh, blocks, shapes, *rest)._replace(near=near),
            mapped_sweep.Maps(*maps),
            np.full(blocks.vertices.size, np.nan),
        )
    return xy, blocks.vertices.tolist()


def asked_of(mesh, seed=0):
    return slow.random_asked(reference.as_lists(mesh), np.random.default_rng(seed), maps=True)


@pytest.mark.nojit
@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "mixed fan"])
def test_a_sweep_agrees_with_the_plain_one(kind, energy):
    # The plain one has its derivatives from jets: a wrong one here is a wrong step.
    mesh = random_mesh(kind, 4, seed=4, amount=0.8).mesh
    asked = asked_of(mesh)
    xy, order = sweep(mesh, energy, asked)
    points = slow.newton_sweep(
        reference.as_complex(mesh.xy), reference.as_lists(mesh), order, *energy, asked=asked
    )
    assert not np.array_equal(xy, mesh.xy)
    np.testing.assert_allclose(xy, [(z.real, z.imag) for z in points], rtol=0, atol=1e-9)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_what_is_held_is_held_in_the_plane_as_it_is(kind):
    mesh = random_mesh(kind, 4, seed=1, amount=0.6).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    held = 0.9, -0.8, 0.3, 30.0, 4.0, 1e-3
    asked = asked_of(mesh, 1)
    xy, order = sweep(mesh, ENERGIES[1], asked, held=held)
    expected = slow.newton_sweep(points, cells, order, *ENERGIES[1], asked=asked, held=held)
    np.testing.assert_allclose(xy, [(z.real, z.imag) for z in expected], rtol=0, atol=1e-9)


def derivatives(xy, n_sides, maps):
    """What comes back from a single mapped triangle or quad: energy, gradient, Hessian."""
    from qsmooth.kernels.star_energy import Terms, add_walled_quad, add_walled_triangle

    star, mapped = np.zeros(6 * LANES), np.zeros(6 * LANES)
    for k, place in enumerate(xy[1:].ravel()):
        star[k * LANES] = place
    s, own = np.zeros(lanes.N_ROWS * LANES), np.zeros(lanes.N_ROWS * LANES)
    s[lanes.X], s[lanes.Y] = xy[0]
    rows, one = tuple(np.array([x]) for x in maps), np.ones(1)
    mapped_sweep.map_places(star, s, lanes.ROW0, n_sides - 1, 1, rows, 0, mapped)
    add = add_walled_quad if n_sides == 4 else add_walled_triangle
    shapes = (one, 0.0 * one, one)
    walls = 0.5 * one, one
    add(mapped, own, lanes.ROW0, 1, shapes, 0, walls, 0, Terms(1.0, 0.0, 1, 2.0))
    mapped_sweep.take_back(own, 1, rows, 0, s)
    hessian = np.array([[s[lanes.HXX], s[lanes.HXY]], [s[lanes.HXY], s[lanes.HYY]]])
    return s[lanes.ENERGY], np.array([s[lanes.GX], s[lanes.GY]]), hessian


@pytest.mark.nojit
@pytest.mark.parametrize("n_sides", [3, 4])
@pytest.mark.parametrize("seed", range(4))
def test_derivatives_agree_with_differences_and_the_hessian_is_semi_definite(n_sides, seed):
    rng = np.random.default_rng(seed)
    xy = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])[:n_sides]
    xy += rng.uniform(-0.15, 0.15, xy.shape)
    maps, h = slow.random_map(rng)[[0, 0, 1], [0, 1, 1]], 1e-6
    _, gradient, hessian = derivatives(xy, n_sides, maps)
    for axis in range(2):
        ends = []
        for sign in (1.0, -1.0):
            moved = xy.copy()
            moved[0, axis] += sign * h
            ends.append(derivatives(moved, n_sides, maps))
        scale = np.abs(hessian).max()
        slope = (ends[0][0] - ends[1][0]) / (2.0 * h)
        assert gradient[axis] == pytest.approx(slope, abs=1e-6 * scale)
        slopes = (ends[0][1] - ends[1][1]) / (2.0 * h)
        np.testing.assert_allclose(hessian[axis], slopes, rtol=0, atol=1e-6 * scale)
    assert np.linalg.eigvalsh(hessian)[0] >= -1e-12 * np.abs(hessian).max()


@given(st.sampled_from(["quads", "triangles", "mixed"]), st.integers(0, 2**32 - 1))
def test_one_map_everywhere_is_a_sweep_in_the_mapped_plane(kind, seed):
    mesh = random_mesh(kind, 4, seed=seed, amount=0.6).mesh
    matrix = slow.random_map(np.random.default_rng(seed))
    asked = {frozenset(cell): slow.asked_of(cell, None) for cell in reference.as_lists(mesh)}
    xy, _ = sweep(Mesh(mesh.points @ matrix.T, mesh.cells), ENERGIES[0], asked)
    for own in asked.values():
        own.map = matrix
    mapped, _ = sweep(mesh, ENERGIES[0], asked)
    np.testing.assert_allclose(mapped @ matrix.T, xy, rtol=0, atol=1e-8)


@given(st.sampled_from(["quads", "triangles", "mixed"]), st.integers(0, 2**32 - 1))
def test_two_threads_give_the_bits_of_one(kind, seed):
    mesh = random_mesh(kind, 4, seed=seed, amount=0.6).mesh
    asked = asked_of(mesh, seed)
    one, two = (sweep(mesh, ENERGIES[1], asked, threads=k)[0] for k in (1, 2))
    assert one.tobytes() == two.tobytes()
