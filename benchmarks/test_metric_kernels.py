"""Each metric on its own: compiled by an untimed call, then on a mesh in cache and one beyond."""

import numpy as np
import pytest

from qsmooth import Quality
from qsmooth.kernels._jit import use_threads
from qsmooth.metrics import METRICS
from sweep_bounds import Work

THREADS = [1, 2]


@pytest.mark.benchmark(group="metrics")
@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS.keys())
def test_metric(benchmark, mesh, note, metric, threads):
    topology = mesh.topology
    note(mesh, threads)

    def measure():
        return metric.measure(Quality(topology, mesh.xy))

    with use_threads(threads):
        measure()
        benchmark(measure)


@pytest.mark.benchmark(group="metrics")
@pytest.mark.parametrize("metrics", [None, "all"])
def test_summary(benchmark, mesh, note, metrics):
    note(mesh)

    def sum_up():
        return Quality(mesh.topology, mesh.xy).summary(metrics)

    sum_up()
    benchmark(sum_up)


@pytest.mark.benchmark(group="metrics")
def test_validity(benchmark, mesh, note):
    note(mesh)
    assert Quality(mesh.topology, mesh.xy).validity.shape == (mesh.n_cells,)
    benchmark(lambda: Quality(mesh.topology, mesh.xy).validity)


@pytest.mark.benchmark(group="metrics")
def test_glance(benchmark, mesh, note, put_bound):
    note(mesh)

    def glance():
        seen = Quality(mesh.topology, mesh.xy)
        return seen.extreme_angles, seen.mean_shape, seen.n_invalid

    glance()
    benchmark(glance)
    # An offset and four ids of 64 bits, a place, and the shape, which is read before it is written.
    put_bound(Work(130, 0, 40 + 16 + 16))


@pytest.mark.benchmark(group="metrics")
def test_figures_in_one_pass(benchmark, mesh, note, put_bound):
    note(mesh)

    def measure():
        return Quality(mesh.topology, mesh.xy).figure("shape")

    measure()
    benchmark(measure)
    put_bound(Work(130 + 120, 0, 40 + 16 + 6 * 16))


VERDICT = [
    "MinAngle", "MaxAngle", "EdgeRatio", "ScaledJacobian", "Shape", "Area", "AspectRatio",
    "Condition", "Skew", "Taper", "Stretch", "Distortion", "Shear", "Oddy", "RelativeSizeSquared",
]  # fmt: skip


@pytest.mark.benchmark(group="metrics")
@pytest.mark.parametrize("name", VERDICT)
def test_verdict(benchmark, mesh, note, name):
    pytest.importorskip("vtkmodules.vtkFiltersVerdict")
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import VTK_QUAD, vtkCellArray, vtkUnstructuredGrid
    from vtkmodules.vtkFiltersVerdict import vtkMeshQuality

    places, points, cells = np.zeros((mesh.n_vertices, 3)), vtkPoints(), vtkCellArray()
    places[:, :2] = mesh.xy
    points.SetData(numpy_to_vtk(places, deep=True))
    cells.SetData(4, numpy_to_vtkIdTypeArray(mesh.cell_vertices.copy(), deep=True))
    grid, ruler = vtkUnstructuredGrid(), vtkMeshQuality()
    grid.SetPoints(points)
    grid.SetCells(VTK_QUAD, cells)
    ruler.SetInputData(grid)
    getattr(ruler, f"SetQuadQualityMeasureTo{name}")()
    note(mesh)

    def measure():
        ruler.Modified()
        ruler.Update()

    benchmark(measure)
