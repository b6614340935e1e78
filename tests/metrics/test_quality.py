"""Quality of meshes: against VTK's verdict, against the reference, and its summary by hand."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
from meshes import KINDS, grid, random_mesh, random_meshes, tangle
from qsmooth import Mesh, Quality, Validity, quality, read_mesh
from qsmooth.metrics import METRICS
from qsmooth.metrics.registry import VERDICT as VERDICT_SOURCE

# Verdict's names where they are not ours in capitals.
VERDICT = {"aspect_ratio": "EdgeRatio", "verdict_aspect_ratio": "AspectRatio"}
# Ours that verdict has, besides those whose record says so.
SHARED = "min_angle", "max_angle", "aspect_ratio", "scaled_jacobian", "shape", "area"


def verdict(mesh, name):
    """VTK's figure for every cell."""
    pytest.importorskip("vtkmodules.vtkFiltersVerdict")
    # Only these modules: `import vtk` would want the graphics libraries.
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid
    from vtkmodules.vtkFiltersVerdict import vtkMeshQuality

    xyz = np.zeros((mesh.n_vertices, 3))
    xyz[:, :2] = mesh.xy
    points = vtkPoints()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(xyz, deep=True))
    cells = vtkCellArray()
    cells.SetData(
        numpy_to_vtkIdTypeArray(mesh.cell_offsets.copy(), deep=True),
        numpy_to_vtkIdTypeArray(mesh.cell_vertices.copy(), deep=True),
    )
    kinds = np.where(np.diff(mesh.cell_offsets) == 3, 5, 9).astype(np.uint8)
    data = vtkUnstructuredGrid()
    data.SetPoints(points)
    data.SetCells(numpy_to_vtk(kinds, deep=True), cells)
    ruler = vtkMeshQuality()
    ruler.SetInputData(data)
    theirs = VERDICT.get(name, name.title().replace("_", ""))
    for corners, kind in ((3, "Triangle"), (4, "Quad")):
        if name not in METRICS or corners in METRICS[name].corners:
            getattr(ruler, f"Set{kind}QualityMeasureTo{theirs}")()
    ruler.Update()
    return vtk_to_numpy(ruler.GetOutput().GetCellData().GetArray("Quality")).copy()


def assert_as_verdict(mesh):
    own = quality(mesh)
    valid = own.validity == Validity.VALID
    assert valid.any()
    for name in (*SHARED, *(n for n, m in METRICS.items() if VERDICT_SOURCE in m.source)):
        compared = valid
        if name in METRICS:
            compared = valid & np.isin(mesh.topology.cell_sizes, METRICS[name].corners)
        if not compared.any():
            continue
        found, expected = getattr(own, name)[compared], verdict(mesh, name)[compared]
        if name.endswith("angle"):
            # Verdict's arccos loses half the digits where its argument is near ±1.
            sine = np.sin(np.radians(np.clip(expected, 1e-6, 180.0 - 1e-6)))
            tolerance = 1e-9 + np.degrees(4e-16 / np.maximum(sine, 1e-8))
        elif name == "area":
            tolerance = 1e-9 * np.abs(expected)
        else:
            tolerance = 1e-9 * np.maximum(1.0, np.abs(expected))
        worst = np.argmax(np.abs(found - expected) - tolerance)
        assert abs(found[worst] - expected[worst]) <= (
            tolerance if np.ndim(tolerance) == 0 else tolerance[worst]
        ), (name, worst)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_random_cells_agree_with_verdict(kind, seed):
    assert_as_verdict(random_mesh(kind, 8, seed=seed, amount=1.0, turned=0.5).mesh)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["quads", "triangles", "mixed"]))
def test_valid_cells_of_tangled_meshes_agree_with_verdict(seed, kind):
    made = random_mesh(kind, 6, seed=seed)
    points = tangle(made.points, made.cells, np.random.default_rng(seed), 0.5)
    assert_as_verdict(made.mesh.with_points(points))


@pytest.mark.parametrize(
    "file",
    [
        "superior_24k.off", "spiral_2k.off", "malpasset_2392.obj", "mesquite_polar_mixed.vtk",
        "sfepy_tri932.mesh", "tri_adapt.su2", "mesquite_tangled_quad.vtk", "rae2822_mixed.su2",
        "centrifugal_blade_mixed.su2", "hughes_6k.obj", "naca0012_113x33.su2",
    ],
)  # fmt: skip
def test_real_cells_agree_with_verdict(shared_meshes, file):
    assert_as_verdict(read_mesh(shared_meshes / file))


@given(random_meshes(), st.booleans())
def test_meshes_agree_with_the_reference(made, tangled):
    mesh = made.mesh
    if tangled:
        rng = np.random.default_rng(made.seed)
        mesh = mesh.with_points(tangle(made.points, made.cells, rng, made.scale))
    # Near 6e6 area is only as exact as differences of coordinates are.
    points = reference.as_complex(mesh.xy - mesh.xy[0])
    cells = reference.as_lists(mesh)
    own = quality(mesh)
    exact = reference.as_complex(mesh.xy)
    assert own.validity.tolist() == [reference.validity(exact, cell) for cell in cells]
    size = made.scale**2
    for name in ("aspect_ratio", "scaled_jacobian", "shape", "area"):
        expected = [getattr(reference, name)(points, cell) for cell in cells]
        scale = size if name == "area" else 1.0
        np.testing.assert_allclose(getattr(own, name), expected, rtol=1e-9, atol=1e-9 * scale)
    angles = [reference.angles(points, cell) for cell in cells]
    away = np.array([min(a) > 1e-5 and max(a) < 360.0 - 1e-5 for a in angles])
    np.testing.assert_allclose(own.min_angle[away], np.array([min(a) for a in angles])[away],
                               atol=1e-7)  # fmt: skip
    np.testing.assert_allclose(own.max_angle[away], np.array([max(a) for a in angles])[away],
                               atol=1e-7)  # fmt: skip


@pytest.mark.nojit
@given(random_meshes(), st.floats(0.0, 6.0), st.booleans())
@settings(max_examples=25)
def test_metrics_turn_scale_and_mirror_with_the_mesh(made, turn, mirror):
    flip = np.array([-1.0 if mirror else 1.0, 1.0])
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    points = made.points - made.points[0]
    own = quality((points, made.cells))
    other = quality(((points * flip) @ rotation * 16.0, made.cells))
    assert np.array_equal(own.validity, other.validity)
    np.testing.assert_allclose(other.area, 256.0 * own.area, rtol=1e-9)
    for name, metric in METRICS.items():
        factor = 16.0 if metric.unit == "length" else 1.0
        np.testing.assert_allclose(other[name], factor * own[name], rtol=1e-7, atol=1e-7)


# ------------------------------------------------------------------------------- summary


@pytest.mark.nojit
def test_summary_counts_classes():
    points, cells = grid(6, 2)
    mesh = Mesh(points, cells)
    points[8] = (0.5, 0.5)  # corner of cell 0, flat now
    points[12] = (4.9, -0.4)  # cell 5 crossed, cell 4 too
    summary = quality(mesh.with_points(points)).summary()
    exact = reference.as_complex(points)
    classes = [reference.validity(exact, cell) for cell in reference.as_lists(mesh)]
    assert summary.validity == {
        name: classes.count(k)
        for k, name in enumerate(("valid", "collapsed", "concave", "crossed", "inverted"))
    }
    assert summary.validity["collapsed"] == 1
    assert summary.n_invalid == summary.n_cells - summary.validity["valid"] >= 2


@pytest.mark.nojit
def test_summary_of_a_mesh_by_hand():
    # A rectangle of 3 by 1, and a triangle with a right angle and legs of 1 and 2 on it.
    mesh = Mesh([(0, 0), (3, 0), (3, 1), (0, 1), (5, 0)], [[(0, 1, 2, 3)], [(1, 4, 2)]])
    summary = quality(mesh).summary()
    acute = math.degrees(math.atan2(1, 2))
    assert (summary.n_vertices, summary.n_quads, summary.n_triangles) == (5, 1, 1)
    assert summary.area == pytest.approx(4.0)
    assert summary.worst == pytest.approx(
        {
            "min_angle": acute,
            "max_angle": 90.0,
            "aspect_ratio": 3.0,
            "scaled_jacobian": math.sin(math.radians(acute)) * 2 / math.sqrt(3),
            "shape": 0.6,
            "size_jump": 3.0 * 3**0.5 / 4.0,
        }
    )
    assert summary.mean == pytest.approx(
        {
            "min_angle": 0.5 * (90.0 + acute),
            "max_angle": 90.0,
            "aspect_ratio": 0.5 * (3.0 + math.sqrt(5)),
            "scaled_jacobian": 0.5 * (1 + math.sin(math.radians(acute)) * 2 / math.sqrt(3)),
            "shape": 0.5 * (0.6 + 4 * math.sqrt(3) / 10),
            "size_jump": 3.0 * 3**0.5 / 4.0,
        }
    )
    assert summary.histograms["max_angle"].edges[:4] == (60.0, 70.0, 80.0, 90.0)
    assert summary.histograms["max_angle"].counts[3] == 2
    assert summary.histograms["min_angle"].counts[2] == 1
    assert sum(summary.histograms["min_angle"].counts) == 2
    assert summary.histograms["aspect_ratio"].counts[1] == 2


@pytest.mark.nojit
def test_histograms_count_every_cell_once():
    for kind in sorted(KINDS):
        mesh = random_mesh(kind, 5, seed=5, amount=1.0).mesh
        own = quality(mesh)
        summary = own.summary()
        for name, histogram in summary.histograms.items():
            assert sum(histogram.counts) == mesh.n_cells
            assert sum(histogram.percent) == pytest.approx(100.0)
            values = getattr(own, name)
            for low, high, n in zip(
                histogram.edges[1:-2], histogram.edges[2:-1], histogram.counts[1:-1], strict=True
            ):
                assert n == ((values >= low) & (values < high)).sum()
            assert len(histogram.labels) == len(histogram.counts)
        has_triangles = summary.n_triangles > 0
        assert summary.histograms["max_angle"].edges[0] == (60.0 if has_triangles else 90.0)
        assert summary.histograms["max_angle"].labels[-1] == "180 and more"


@pytest.mark.nojit
def test_means_of_aspect_leave_out_edges_of_no_length():
    mesh = Mesh([(0, 0), (1, 0), (1, 1), (1, 1), (0, 1)], [[(0, 1, 2, 3)], [(0, 3, 4)]])
    summary = quality(mesh).summary()
    assert summary.worst["aspect_ratio"] == math.inf
    assert summary.mean["aspect_ratio"] == pytest.approx(math.sqrt(2))
    plain = summary.to_dict()
    assert plain["worst"]["aspect_ratio"] is None
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert plain["n_invalid"] == 1


@pytest.mark.nojit
def test_worst_cells_come_first():
    made = random_mesh("quads", 6, seed=6, amount=1.0)
    own = quality(made.mesh)
    for by, metric in METRICS.items():
        worst = own.worst(5, by=by)
        values = own[by] if metric.higher_is_better else -own[by]
        assert worst.cells.tolist() == np.argsort(values, kind="stable")[:5].tolist()
        np.testing.assert_array_equal(worst.values[by], getattr(own, by)[worst.cells])
        corners = made.mesh.cell_vertices.reshape(-1, 4)[worst.cells]
        np.testing.assert_allclose(worst.centres, made.points[corners].mean(axis=1))
        assert json.dumps(worst.to_dict(), allow_nan=False)
    assert len(own.worst(10**6).cells) == made.mesh.n_cells
    assert own.worst(0).cells.size == 0
    assert own.worst(0).centres.shape == (0, 2)
    with pytest.raises(ValueError, match=r"by must be one of .*; got 'size'"):
        own.worst(by="size")
    with pytest.raises(ValueError, match="k must be 0 or more, got -1"):
        own.worst(-1)


@pytest.mark.nojit
def test_quality_takes_a_pair_and_measures_once():
    own = quality(grid(3, 2))
    assert isinstance(own, Quality)
    assert own.shape is own.shape
    assert own.n_invalid == 0
    assert own.validity.dtype == np.int64
    with pytest.raises(TypeError, match=r"expected a Mesh, .* got list"):
        quality([1, 2])
