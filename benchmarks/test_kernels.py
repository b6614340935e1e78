"""Each kernel on its own: compiled by an untimed call, then on a mesh in cache and one beyond."""

import math

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth import Mesh
from qsmooth.kernels import cell_metrics, colouring, laplacian, quad, star, topology
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.proposals import thresholds
from qsmooth.kernels.stars import Moves, Rings

THREADS = [1, 2]


def run(benchmark, kernel, arguments, threads):
    """Time one call."""
    with use_threads(threads):
        kernel(*arguments)
        benchmark(kernel, *arguments)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("name", ["scaled_jacobian", "shape", "aspect_ratio", "area", "validity"])
def test_metric(benchmark, mesh, note, name, threads):
    out = np.empty(mesh.n_cells, np.int64 if name == "validity" else np.float64)
    note(mesh, threads)
    arguments = mesh.xy, mesh.cell_offsets, mesh.cell_vertices, out
    run(benchmark, getattr(cell_metrics, name), arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_angles(benchmark, mesh, note, threads):
    out = np.empty((2, mesh.n_cells))
    note(mesh, threads)
    arguments = mesh.xy, mesh.cell_offsets, mesh.cell_vertices, out[0], out[1]
    run(benchmark, cell_metrics.angles, arguments, threads)


def sweep_arguments(mesh):
    """Coordinates, stars, all colours and what a sweep overwrites."""
    stars = mesh._topology.schedule(True)
    moves = Moves(*np.empty((2, stars.vertices.size)))
    return mesh.xy.copy(), stars, (0, stars.colour_offsets.size - 1), moves


ANGLES = thresholds(120.0, 60.0, 90.0, 45.0)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("guard", ["quality", "clearance"])
def test_star_sweep(benchmark, mesh, note, guard, threads):
    xy, stars, colours, moves = sweep_arguments(mesh)
    note(mesh, threads)
    good = 0.5 if guard == "quality" else math.nan
    arguments = xy, stars, colours, np.ones(mesh.n_cells), ANGLES, 0.5, good, moves
    run(benchmark, star.star_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_quad_proposals(benchmark, mesh, note, threads):
    xy, stars, _, _ = sweep_arguments(mesh)
    note(mesh, threads)
    wanted = np.empty((stars.vertices.size, 2))
    arguments = xy, stars, np.ones(mesh.n_cells), ANGLES, 0.5, wanted
    run(benchmark, quad.quad_proposals, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_guarded_commit(benchmark, mesh, note, threads):
    xy, stars, colours, moves = sweep_arguments(mesh)
    note(mesh, threads)
    wanted = np.random.default_rng(0).uniform(-1e-6, 1e-6, (stars.vertices.size, 2))
    arguments = xy, stars, colours, wanted, 0.5, moves
    run(benchmark, quad.guarded_commit, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_laplacian_sweep(benchmark, mesh, note, threads):
    xy, stars, _, moves = sweep_arguments(mesh)
    note(mesh, threads)
    arguments = mesh.xy, Rings(mesh.ring_offsets, mesh.ring_vertices), stars, xy, moves
    run(benchmark, laplacian.laplacian_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_smart_laplacian_sweep(benchmark, mesh, note, threads):
    xy, stars, colours, moves = sweep_arguments(mesh)
    note(mesh, threads)
    arguments = xy, Rings(mesh.ring_offsets, mesh.ring_vertices), stars, colours, 0.5, moves
    run(benchmark, laplacian.smart_laplacian_sweep, arguments, threads)


@pytest.mark.parametrize("name", ["stars", "edge_twins"])
def test_incidence(benchmark, mesh, note, name):
    note(mesh)
    arguments = mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices
    run(benchmark, getattr(topology, name), arguments, 1)


def test_rings(benchmark, mesh, note):
    note(mesh)
    arguments = mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices, mesh._topology.twins
    run(benchmark, topology.rings, arguments, 1)


def test_colours(benchmark, mesh, note):
    note(mesh)
    arguments = (
        ~mesh.is_fixed, mesh.cell_offsets, mesh.cell_vertices, mesh.star_offsets, mesh.star_cells,
    )  # fmt: skip
    run(benchmark, colouring.colours, arguments, 1)


def test_mesh_of_a_million_quads(benchmark, note, smoke):
    points, cells = rough_grid(45 if smoke else 1000)
    Mesh(*rough_grid(3))
    mesh = benchmark.pedantic(Mesh, (points, cells), rounds=3)
    note(mesh)


def test_schedule_of_a_million_quads(benchmark, note, smoke):
    points, cells = rough_grid(45 if smoke else 1000)
    mesh = Mesh(points, cells)

    def schedule():
        mesh._topology._schedules.clear()
        return mesh._topology.schedule(True)

    schedule()
    benchmark.pedantic(schedule, rounds=3)
    note(mesh)
