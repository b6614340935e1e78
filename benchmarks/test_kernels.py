"""Each kernel on its own: compiled by an untimed call, then on a mesh in cache and one beyond."""

import math

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth import Mesh
from qsmooth.kernels import laplacian, quad, star, topology
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.moves import thresholds

THREADS = [1, 2]


def run(benchmark, kernel, arguments, threads):
    """Time one call."""
    with use_threads(threads):
        kernel(*arguments)
        benchmark(kernel, *arguments)


def sweep_arguments(mesh):
    schedule = mesh.topology.schedule(True)
    n = schedule.vertices.size
    return schedule, mesh.xy.copy(), np.empty(n), np.empty(n), np.ones(mesh.n_cells, np.bool_)


LIMIT = thresholds(120.0, 60.0, 90.0, 45.0)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("guard", ["quality", "clearance"])
def test_star_sweep(benchmark, mesh, note, guard, threads):
    s, xy, moves, shares, active = sweep_arguments(mesh)
    note(mesh, threads)
    good = 0.5 if guard == "quality" else math.nan
    arguments = (
        xy, s.colour_offsets, s.vertices, s.offsets, s.corners, s.cells, active, LIMIT, 0.5, good,
        s.largest_star, moves, shares,
    )  # fmt: skip
    run(benchmark, star.star_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_quad_proposals(benchmark, mesh, note, threads):
    s, xy, _, _, active = sweep_arguments(mesh)
    note(mesh, threads)
    wanted = np.empty((s.vertices.size, 2))
    arguments = (
        xy, s.vertices, s.offsets, s.corners, s.cells, active, LIMIT, 0.5, s.largest_star, wanted,
    )  # fmt: skip
    run(benchmark, quad.quad_proposals, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_guarded_commit(benchmark, mesh, note, threads):
    s, xy, moves, shares, _ = sweep_arguments(mesh)
    note(mesh, threads)
    wanted = np.random.default_rng(0).uniform(-1e-6, 1e-6, (s.vertices.size, 2))
    arguments = (
        xy, s.colour_offsets, s.vertices, s.offsets, s.corners, wanted, 0.5, s.largest_star, moves,
        shares,
    )  # fmt: skip
    run(benchmark, quad.guarded_commit, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_laplacian_sweep(benchmark, mesh, note, threads):
    s, xy, moves, shares, _ = sweep_arguments(mesh)
    note(mesh, threads)
    arguments = (
        mesh.xy, mesh.ring_offsets, mesh.ring_vertices, s.vertices, xy, moves, shares,
    )  # fmt: skip
    run(benchmark, laplacian.laplacian_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_smart_laplacian_sweep(benchmark, mesh, note, threads):
    s, xy, moves, shares, _ = sweep_arguments(mesh)
    note(mesh, threads)
    arguments = (
        xy, mesh.ring_offsets, mesh.ring_vertices, s.colour_offsets, s.vertices, s.offsets,
        s.corners, 0.5, moves, shares,
    )  # fmt: skip
    run(benchmark, laplacian.smart_laplacian_sweep, arguments, threads)


@pytest.mark.parametrize("name", ["stars", "edge_twins"])
def test_incidence(benchmark, mesh, note, name):
    note(mesh)
    arguments = mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices
    run(benchmark, getattr(topology, name), arguments, 1)


def test_rings(benchmark, mesh, note):
    note(mesh)
    arguments = mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices, mesh.topology.twins
    run(benchmark, topology.rings, arguments, 1)


def test_colours(benchmark, mesh, note):
    note(mesh)
    arguments = (
        ~mesh.is_fixed, mesh.cell_offsets, mesh.cell_vertices, mesh.star_offsets, mesh.star_cells,
    )  # fmt: skip
    run(benchmark, topology.colours, arguments, 1)


def test_mesh_of_a_million_quads(benchmark, note, smoke):
    points, cells = rough_grid(45 if smoke else 1000)
    Mesh(*rough_grid(3))
    mesh = benchmark.pedantic(Mesh, (points, cells), rounds=3)
    note(mesh)


def test_schedule_of_a_million_quads(benchmark, note, smoke):
    points, cells = rough_grid(45 if smoke else 1000)
    mesh = Mesh(points, cells)

    def schedule():
        mesh.topology._schedules.clear()
        return mesh.topology.schedule(True)

    schedule()
    benchmark.pedantic(schedule, rounds=3)
    note(mesh)
