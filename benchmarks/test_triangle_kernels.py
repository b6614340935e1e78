"""The kernels of the methods for triangles: in cache and beyond, beside the sweep by star."""

import math

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth import Mesh, examples, quality
from qsmooth.kernels import angle, aspect_ratio, centroid, delaunay, star, uniformity
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.moves import thresholds
from qsmooth.split import split_quads

THREADS = [1, 2]


@pytest.fixture(scope="module", params=["4K", "500K"])
def triangles(request, smoke):
    """Two triangles in place of each quad of the rough grid."""
    return split_quads(Mesh(*rough_grid(45 if request.param == "4K" or smoke else 500)))


def run(benchmark, kernel, arguments, threads):
    """Time one call."""
    with use_threads(threads):
        kernel(*arguments)
        benchmark(kernel, *arguments)


def sweep_arguments(mesh):
    schedule = mesh.topology.schedule(True)
    moves, shares = np.empty((2, schedule.vertices.size))
    table = schedule.vertices, schedule.offsets, schedule.corners
    return schedule, mesh.xy.copy(), table, moves, shares


@pytest.mark.parametrize("threads", THREADS)
def test_star_sweep(benchmark, triangles, note, threads):
    s, xy, table, moves, shares = sweep_arguments(triangles)
    note(triangles, threads)
    arguments = (
        xy, s.colour_offsets, *table, s.cells, np.ones(triangles.n_cells),
        thresholds(120.0, 60.0, 90.0, 45.0), 0.25, 0.5, s.largest_star, moves, shares,
    )  # fmt: skip
    run(benchmark, star.star_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("guard", ["quality", "clearance"])
def test_aspect_ratio_sweep(benchmark, triangles, note, guard, threads):
    s, xy, table, moves, shares = sweep_arguments(triangles)
    note(triangles, threads)
    good = 0.5 if guard == "quality" else math.nan
    arguments = (
        xy, s.colour_offsets, *table, 1.2, 0.2, 4.0, 1.2, good, s.largest_star, moves, shares,
    )  # fmt: skip
    run(benchmark, aspect_ratio.aspect_ratio_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_angle_sweep(benchmark, triangles, note, threads):
    _, xy, table, moves, shares = sweep_arguments(triangles)
    note(triangles, threads)
    run(benchmark, angle.angle_sweep, (triangles.xy, *table, 1.0, xy, moves, shares), threads)


@pytest.mark.parametrize("threads", THREADS)
def test_guarded_angle_sweep(benchmark, triangles, note, threads):
    s, xy, table, moves, shares = sweep_arguments(triangles)
    note(triangles, threads)
    arguments = xy, s.colour_offsets, *table, 1.0, 0.5, moves, shares
    run(benchmark, angle.guarded_angle_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_centroid_sweep(benchmark, triangles, note, threads):
    _, xy, table, moves, shares = sweep_arguments(triangles)
    note(triangles, threads)
    run(benchmark, centroid.centroid_sweep, (triangles.xy, *table, xy, moves, shares), threads)


@pytest.mark.parametrize("threads", THREADS)
def test_smart_centroid_sweep(benchmark, triangles, note, threads):
    s, xy, table, moves, shares = sweep_arguments(triangles)
    note(triangles, threads)
    arguments = xy, s.colour_offsets, *table, 0.5, moves, shares
    run(benchmark, centroid.smart_centroid_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_size_jump(benchmark, triangles, note, threads):
    note(triangles, threads)
    out = np.empty(triangles.n_cells)
    arguments = (
        quality(triangles).area,
        triangles.cell_offsets,
        triangles.topology.given_twins,
        triangles.topology.corner_cells,
        out,
    )
    run(benchmark, uniformity.size_jump, arguments, threads)


@pytest.mark.parametrize("n_points", [500, 20_000])
def test_triangulate(benchmark, n_points):
    corners = examples.structured(1, 1).points[[0, 1, 3, 2]]
    inside = np.random.default_rng(0).random((n_points, 2))
    points = np.concatenate([corners, inside])
    order = 4 + np.argsort(np.floor(inside[:, 1] * math.sqrt(n_points / 2)), kind="stable")
    run(benchmark, delaunay.triangulate, (points, order), 1)
