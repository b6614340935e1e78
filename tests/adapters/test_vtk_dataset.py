"""Datasets of VTK and pyvista in memory."""

import numpy as np
import pytest

pytest.importorskip("pyvista")
import pyvista
import vtk
from vtkmodules.util.numpy_support import vtk_to_numpy

from object_samples import BED, POINTS, QUADS, TRIANGLES, all_ways_in, smoothed
from qsmooth import MeshError, Smoother, as_mesh, smooth, write_mesh
from qsmooth.adapters import back, vtk_dataset

SPACE = np.column_stack([POINTS, np.zeros(len(POINTS))])


def faces(*blocks):
    return np.concatenate([np.insert(block, 0, block.shape[1], axis=1).ravel() for block in blocks])


@pytest.fixture
def poly():
    mesh = pyvista.PolyData(
        SPACE.astype(np.float32),
        faces=faces(QUADS[:8], TRIANGLES),
        lines=[3, 0, 1, 2],
        verts=[1, 19],
    )
    mesh["bed"] = BED
    mesh["name of each"] = [f"vertex {v}" for v in range(20)]
    mesh["flow"] = SPACE.astype(np.float32) + 1.0
    mesh.cell_data["material"] = np.arange(mesh.n_cells) // 12
    mesh.field_data["time"] = [1.5]
    mesh.set_active_scalars("bed")
    return mesh


@pytest.fixture
def grid():
    mesh = pyvista.UnstructuredGrid({9: QUADS[:8], 5: TRIANGLES}, SPACE.copy())
    mesh["bed"] = BED
    mesh.cell_data["tag"] = np.arange(mesh.n_cells) + 0.5
    return mesh


def same_but_for_points(new, old):
    assert type(new) is type(old)
    assert new is not old
    plain = new.copy()
    plain.points = old.points
    return plain == old


def test_poly_data_comes_back_with_all_it_has(poly):
    before = poly.copy()
    new, points = smoothed(poly)
    assert same_but_for_points(new, poly)
    assert poly == before
    assert poly.points.dtype == np.float32
    assert new.points.dtype == np.float64
    assert np.array_equal(new.points, points)
    assert new.active_scalars_name == "bed"
    assert new["name of each"][3] == "vertex 3"
    assert not np.shares_memory(new["bed"], poly["bed"])


def test_cells_of_every_kind_are_taken_in_order(poly):
    mesh = as_mesh(poly)
    assert [cells.tolist() for cells in mesh.cells] == [QUADS[:8].tolist(), TRIANGLES.tolist()]
    # Two lines of one cell, and one vertex, come before the faces in a PolyData.
    assert mesh.topology.lines.tolist() == [[0, 1], [1, 2]]
    assert mesh.regions.tolist() == (np.arange(2, 18) // 12).tolist()


def test_unstructured_grid_comes_back_with_all_it_has(grid):
    new, points = smoothed(grid)
    assert same_but_for_points(new, grid)
    assert np.array_equal(new.points, points)
    all_ways_in(grid, same_but_for_points)


def test_structured_grid(grid):
    x, y = POINTS.reshape(4, 5, 2).transpose(2, 1, 0)
    given = pyvista.StructuredGrid(x, y, 0.0 * x)
    given["bed"] = BED
    assert sorted(as_mesh(given).cells[0].tolist()) == sorted(
        given.cast_to_unstructured_grid().cell_connectivity.reshape(-1, 4).tolist()
    )
    new, points = smoothed(given)
    assert same_but_for_points(new, given)
    assert np.array_equal(new.points, points)
    given.hide_cells([3], inplace=True)
    with pytest.raises(MeshError, match="blank cells"):
        as_mesh(given)


def test_an_heir_stays_one(poly):
    class Heir(pyvista.PolyData):
        pass

    assert type(smoothed(Heir(poly))[0]) is Heir


def test_plain_vtk_stays_plain(poly, grid):
    for given, kind in ((poly, vtk.vtkPolyData), (grid, vtk.vtkUnstructuredGrid)):
        plain = kind()
        plain.DeepCopy(given)
        new, points = smoothed(plain)
        assert type(new) is type(plain)
        assert np.array_equal(vtk_to_numpy(new.GetPoints().GetData()), points)
        assert new.GetPointData().GetNumberOfArrays() == plain.GetPointData().GetNumberOfArrays()
        assert np.array_equal(as_mesh(new).cell_vertices, as_mesh(given).cell_vertices)


def test_point_data_is_interpolated_where_vertices_go(poly):
    new, points = smoothed(poly, interpolate="bed,flow")
    assert new["bed"] == pytest.approx(points[:, :2] @ [0.5, 2.0] + 3.0)
    assert new["flow"].dtype == np.float32
    assert new["flow"] == pytest.approx(points + 1.0, rel=1e-6)
    assert poly["bed"].tolist() == BED.tolist()


def test_third_coordinate_as_a_value(poly):
    poly.points = np.column_stack([POINTS, BED**2])
    with pytest.raises(MeshError, match="surface"):
        as_mesh(poly)
    result = smooth(as_mesh(poly, surface="flat"), "star", max_sweeps=3, carry="keep")
    new = result.back()
    assert isinstance(new, pyvista.PolyData)
    assert new.points[:, 2].tolist() == (BED**2).tolist()


def test_a_session_gives_the_form_back(grid):
    smoother = Smoother(grid, "star", max_sweeps=2)
    assert same_but_for_points(smoother(as_mesh(grid).points).back(), grid)


def test_what_cannot_be_smoothed_is_named():
    with pytest.raises(MeshError, match="has no points"):
        as_mesh(vtk.vtkPolyData())
    with pytest.raises(MeshError, match="triangle_strip"):
        as_mesh(pyvista.Plane(i_resolution=2, j_resolution=2).triangulate().strip())
    with pytest.raises(MeshError, match="hexahedron"):
        as_mesh(pyvista.UnstructuredGrid({12: np.arange(8)[None]}, SPACE[:8]))
    with pytest.raises(TypeError, match=r"pyvista or VTK.* got ImageData"):
        as_mesh(pyvista.ImageData(dimensions=(3, 3, 1)))


def test_back_of_another_mesh_is_refused(grid, poly):
    with pytest.raises(ValueError, match="4 vertices for a mesh that has 20"):
        back(as_mesh((POINTS[[0, 1, 6, 5]], [(0, 1, 2, 3)])), grid)
    assert not vtk_dataset.accepts(vtk.vtkImageData())


def test_it_can_be_written_to_a_file(poly, tmp_path):
    write_mesh(tmp_path / "out.vtu", smooth(poly, "star", max_sweeps=1).mesh)
    again = pyvista.read(tmp_path / "out.vtu")
    assert again["bed"].tolist() == BED.tolist()
    assert again["material"].tolist().count(1) == poly["material"].tolist().count(1)


def test_quads_cut_in_two_come_back_whole(grid):
    new = smooth(grid, "aspect-ratio", split_quads="shorter", max_sweeps=2).back()
    assert same_but_for_points(new, grid)
