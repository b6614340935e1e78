"""The kernels of the methods for triangles: in cache and beyond, beside the sweep by star."""

import math

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth import Mesh, examples, quality
from qsmooth.kernels import angle, aspect_ratio, centroid, delaunay, star, uniformity
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.proposals import thresholds
from qsmooth.kernels.stars import Moves
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
    """Coordinates, stars, all colours and what a sweep overwrites."""
    stars = mesh._topology.schedule(True)
    moves = Moves(*np.empty((2, stars.vertices.size)))
    return mesh.xy.copy(), stars, (0, stars.colour_offsets.size - 1), moves


@pytest.mark.parametrize("threads", THREADS)
def test_star_sweep(benchmark, triangles, note, threads):
    xy, stars, colours, moves = sweep_arguments(triangles)
    note(triangles, threads)
    angles = thresholds(120.0, 60.0, 90.0, 45.0)
    arguments = xy, stars, colours, np.ones(triangles.n_cells), angles, 0.25, 0.5, moves
    run(benchmark, star.star_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("guard", ["quality", "clearance"])
def test_aspect_ratio_sweep(benchmark, triangles, note, guard, threads):
    xy, stars, colours, moves = sweep_arguments(triangles)
    note(triangles, threads)
    good = 0.5 if guard == "quality" else math.nan
    arguments = xy, stars, colours, 1.2, 0.2, 4.0, 1.2, good, moves
    run(benchmark, aspect_ratio.aspect_ratio_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_angle_sweep(benchmark, triangles, note, threads):
    xy, stars, _, moves = sweep_arguments(triangles)
    note(triangles, threads)
    run(benchmark, angle.angle_sweep, (triangles.xy, stars, 1.0, xy, moves), threads)


@pytest.mark.parametrize("threads", THREADS)
def test_guarded_angle_sweep(benchmark, triangles, note, threads):
    xy, stars, colours, moves = sweep_arguments(triangles)
    note(triangles, threads)
    arguments = xy, stars, colours, 1.0, 0.5, moves
    run(benchmark, angle.guarded_angle_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_centroid_sweep(benchmark, triangles, note, threads):
    xy, stars, _, moves = sweep_arguments(triangles)
    note(triangles, threads)
    run(benchmark, centroid.centroid_sweep, (triangles.xy, stars, xy, moves), threads)


@pytest.mark.parametrize("threads", THREADS)
def test_smart_centroid_sweep(benchmark, triangles, note, threads):
    xy, stars, colours, moves = sweep_arguments(triangles)
    note(triangles, threads)
    arguments = xy, stars, colours, 0.5, moves
    run(benchmark, centroid.smart_centroid_sweep, arguments, threads)


@pytest.mark.parametrize("threads", THREADS)
def test_size_jump(benchmark, triangles, note, threads):
    note(triangles, threads)
    out = np.empty(triangles.n_cells)
    arguments = quality(triangles).area, triangles.cell_offsets, *triangles._neighbours, out
    run(benchmark, uniformity.size_jump, arguments, threads)


@pytest.mark.parametrize("n_points", [500, 20_000])
def test_triangulate(benchmark, n_points):
    corners = examples.structured(1, 1).points[[0, 1, 3, 2]]
    inside = np.random.default_rng(0).random((n_points, 2))
    points = np.concatenate([corners, inside])
    order = 4 + np.argsort(np.floor(inside[:, 1] * math.sqrt(n_points / 2)), kind="stable")
    run(benchmark, delaunay.triangulate, (points, order), 1)
