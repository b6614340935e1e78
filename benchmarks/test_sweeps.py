"""One sweep of each method's kernels, on quads and triangles, in cache and beyond, by threads.

Beside each figure stands what the machine could do on paper, see `sweep_bounds`.
"""

import math
import time

import numpy as np
import pytest

import sweep_bounds
from qsmooth import Quality
from qsmooth.kernels import angle, aspect_ratio, centroid, laplacian, quad, star
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.blocks import build_blocks
from qsmooth.kernels.proposals import thresholds
from qsmooth.kernels.ring_blocks import build_ring_blocks
from qsmooth.kernels.stars import Moves, Rings
from qsmooth.methods.driver import record
from qsmooth.parts import moved_by
from shapes import fan

pytestmark = pytest.mark.benchmark(group="sweeps")
THREADS = [1, 2]
ANGLES = thresholds(120.0, 60.0, 90.0, 45.0)
GOOD = {"quality": 0.5, "clearance": math.nan}


class Case:
    """What the sweeps of a mesh take, with the types that the methods pass."""

    def __init__(self, mesh):
        self.mesh, self.xy = mesh, mesh.xy.copy()
        self.stars = mesh.topology.schedule()
        self.blocks = build_blocks(self.stars)
        self.polygons = angle.star_polygons(self.blocks)
        n_movable = self.stars.vertices.size
        self.moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
        self.rings = Rings(*mesh.topology.rings)
        self.pace = np.ones(mesh.n_cells)
        self.all = 0, self.stars.colour_offsets.size - 1
        self.wanted = np.random.default_rng(0).uniform(-1e-6, 1e-6, (n_movable, 2))


def star_sweep(c, good):
    return star.star_sweep, (c.xy, c.blocks, c.all, c.pace, ANGLES, 0.25, good, c.moves)


def quad_proposals(c, good):
    return quad.quad_proposals, (c.xy, c.blocks, c.pace, ANGLES, 0.25, c.wanted.copy())


def guarded_commit(c, good):
    return quad.guarded_commit, (c.xy, c.blocks, c.all, c.wanted, good, c.moves)


def laplacian_sweep(c, good):
    blocks = build_ring_blocks(np.sort(c.stars.vertices), c.rings)
    return laplacian.laplacian_sweep, (c.mesh.xy, blocks, c.xy, c.moves)


def smart_laplacian_sweep(c, good):
    return laplacian.smart_laplacian_sweep, (c.xy, c.blocks, c.all, good, c.moves)


def centroid_sweep(c, good):
    return centroid.centroid_sweep, (c.mesh.xy, c.blocks, c.xy, c.moves)


def smart_centroid_sweep(c, good):
    return centroid.smart_centroid_sweep, (c.xy, c.blocks, c.all, good, c.moves)


def angle_sweep(c, good):
    return angle.angle_sweep, (c.mesh.xy, c.blocks, c.polygons, 1.0, c.xy, c.moves)


def guarded_angle_sweep(c, good):
    return angle.guarded_angle_sweep, (c.xy, c.blocks, c.polygons, c.all, 1.0, good, c.moves)


def aspect_ratio_sweep(c, good):
    rest = 1.2, 0.2, 4.0, 1.2, good, c.moves
    return aspect_ratio.aspect_ratio_sweep, (c.xy, c.blocks, c.all, *rest)


ON_QUADS = [
    star_sweep,
    quad_proposals,
    guarded_commit,
    laplacian_sweep,
    smart_laplacian_sweep,
    centroid_sweep,
    smart_centroid_sweep,
    guarded_angle_sweep,
]
ON_TRIANGLES = [star_sweep, smart_laplacian_sweep, angle_sweep, guarded_angle_sweep]


@pytest.fixture
def run(benchmark, note, put_bound):
    """Time one sweep, compiled by an untimed one, beside what the machine could do on paper."""

    def measure(mesh, sweep, threads, guard="quality"):
        case = Case(mesh)
        kernel, arguments = sweep(case, GOOD[guard])
        n_movable, name = case.stars.vertices.size, sweep.__name__
        note(mesh, threads, rate=(n_movable, "vertices"))
        with use_threads(threads):
            kernel(*arguments)
            benchmark(kernel, *arguments)
        if name in sweep_bounds.PASSES:
            put_bound(sweep_bounds.work_of(name, sweep_bounds.star_of(case.stars)), threads)

    return measure


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("sweep", ON_QUADS, ids=lambda sweep: sweep.__name__)
def test_on_quads(run, mesh, sweep, threads):
    run(mesh, sweep, threads)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("sweep", [*ON_TRIANGLES, aspect_ratio_sweep], ids=lambda s: s.__name__)
def test_on_triangles(run, triangles, sweep, threads):
    run(triangles, sweep, threads)


@pytest.mark.parametrize("sweep", [star_sweep, guarded_commit], ids=lambda s: s.__name__)
def test_with_the_clearance_guard_alone(run, mesh, sweep):
    run(mesh, sweep, 1, "clearance")


def test_smart_laplacian_beside_the_unguarded_one_of_vtk(benchmark, mesh, note, print_ratio, smoke):
    """A guarded sweep is to take no longer than one of vtkSmoothPolyDataFilter, which has none."""
    vtk = pytest.importorskip("vtk")
    numpy_support = pytest.importorskip("vtk.util.numpy_support")
    sweeps = 2 if smoke else 50
    case = Case(mesh)
    kernel, arguments = smart_laplacian_sweep(case, GOOD["quality"])
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    flat = np.column_stack([mesh.xy, np.zeros(mesh.n_vertices)])
    points.SetData(numpy_support.numpy_to_vtk(flat, deep=True))
    cells = vtk.vtkCellArray()
    offsets, vertices = (np.array(a, np.int64) for a in mesh.topology.cells)
    cells.SetData(
        numpy_support.numpy_to_vtkIdTypeArray(offsets, deep=True),
        numpy_support.numpy_to_vtkIdTypeArray(vertices, deep=True),
    )
    surface = vtk.vtkPolyData()
    surface.SetPoints(points)
    surface.SetPolys(cells)

    def theirs(count):
        smoother = vtk.vtkSmoothPolyDataFilter()
        smoother.SetInputData(surface)
        smoother.SetNumberOfIterations(count)
        smoother.SetConvergence(0.0)
        smoother.BoundarySmoothingOff()
        smoother.FeatureEdgeSmoothingOff()
        smoother.SetOutputPointsPrecision(vtk.vtkAlgorithm.DOUBLE_PRECISION)
        start = time.perf_counter()
        smoother.Update()
        return time.perf_counter() - start

    def ours():
        start = time.perf_counter()
        for _ in range(sweeps):
            kernel(*arguments)
        return (time.perf_counter() - start) / sweeps

    ours()
    seconds = []

    def both():
        # What its first sweep takes has the set-up in it.
        seconds.append((ours(), (theirs(1 + sweeps) - theirs(1)) / sweeps))

    benchmark.pedantic(both, rounds=1 if smoke else 3)
    own, other = np.min(seconds, axis=0)
    note(mesh, 1, rate=None, vtk_over_qsmooth=round(other / own, 2))
    print_ratio(
        f"smart Laplacian, {mesh.n_cells} quads: {1e3 * own:.2f} ms a guarded sweep, "
        f"VTK unguarded {1e3 * other:.2f} ms, {other / own:.1f} times as long"
    )


@pytest.mark.parametrize("n_cells", [1000, 10_000])
@pytest.mark.parametrize("sweep", [star_sweep, quad_proposals], ids=lambda s: s.__name__)
def test_round_one_vertex_of_many_cells(benchmark, note, sweep, n_cells):
    mesh = fan(n_cells)
    kernel, arguments = sweep(Case(mesh), GOOD["quality"])
    note(mesh, 1, rate=(n_cells, "cells"))
    kernel(*arguments)
    benchmark(kernel, *arguments)


@pytest.fixture
def of_four(mesh):
    """The movable vertices of a mesh of quads, with four neighbours each."""
    return Case(mesh)


@pytest.mark.benchmark(group="laplacian")
def test_laplacian(benchmark, note, put_bound, of_four):
    kernel, arguments = laplacian_sweep(of_four, math.nan)
    note(of_four.mesh, rate=(of_four.stars.vertices.size, "vertices"))
    kernel(*arguments)
    benchmark(kernel, *arguments)
    # Five ids of 32 bits; a place read and one written, which is read first; two more figures.
    moved = 5 * 4 + 3 * 16 + 2 * 2 * 8
    put_bound(sweep_bounds.Work(4 * 8 + 12, 0, moved))


@pytest.mark.benchmark(group="laplacian")
def test_laplacian_and_record(benchmark, note, put_bound, of_four):
    kernel, arguments = laplacian_sweep(of_four, math.nan)
    note(of_four.mesh, rate=(of_four.stars.vertices.size, "vertices"))

    def sweep():
        kernel(*arguments)
        return record(Quality(of_four.mesh.topology, of_four.xy), moved_by(*of_four.moves))

    sweep()
    benchmark(sweep)
    moved = 5 * 4 + 3 * 16 + 2 * 2 * 8 + 40 + 16 + 4 * 8
    put_bound(sweep_bounds.Work(4 * 8 + 12 + 130, 0, moved))


@pytest.mark.benchmark(group="laplacian")
def test_laplacian_as_a_sparse_product(benchmark, note, put_bound, of_four):
    sparse = pytest.importorskip("scipy.sparse")
    offsets, neighbours = of_four.rings
    counts = np.diff(offsets)
    weights = np.repeat(1.0 / np.maximum(counts, 1), counts)
    shape = (counts.size, counts.size)
    mean = sparse.csr_matrix(
        (weights, neighbours.astype(np.int32), offsets.astype(np.int32)), shape
    )
    note(of_four.mesh, rate=(counts.size, "vertices"))
    benchmark(lambda: mean @ of_four.xy)
    put_bound(sweep_bounds.Work(4 * 4, 0, 4 * 12 + 4 + 3 * 16))
