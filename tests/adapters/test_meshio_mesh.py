"""Meshes of meshio in memory."""

import meshio
import numpy as np
import pytest

from format_samples import POINTS, QUADS, TRIANGLES
from qsmooth import MeshError, from_meshio, read_mesh, to_meshio
from qsmooth.adapters import as_mesh, back, meshio_mesh


@pytest.fixture
def given():
    return meshio.Mesh(
        np.array(POINTS, float),
        [
            ("line", np.array([(0, 1)])),
            ("quad", np.array(QUADS)),
            ("triangle", np.array(TRIANGLES)),
        ],
        point_data={"depth": np.arange(8.0)},
        cell_data={"region": [np.array([0]), np.array([3, 4]), np.array([4])]},
        field_data={"time": np.array([1.5])},
        point_sets={"pin": np.array([1])},
        cell_sets={"left": [np.array([], int), np.array([0]), np.array([], int)]},
    )


def test_everything_comes_back(given):
    mesh = from_meshio(given)
    assert mesh.regions.tolist() == [3, 4, 4]
    assert mesh.topology.lines.tolist() == [[0, 1]]
    again = to_meshio(mesh)
    assert again.point_data["depth"].tolist() == list(range(8))
    assert [b.type for b in again.cells] == ["line", "quad", "triangle"]
    assert again.point_sets["pin"].tolist() == [1]
    assert again.cell_sets["left"][1].tolist() == [0]


def test_back_is_a_copy_with_other_coordinates(given):
    given.points = given.points.astype(np.float32)
    given.info = "of the caller"
    mesh = as_mesh(given)
    moved = np.array(mesh.points)
    moved[4] = 1.0 + 1e-12, 1.0
    new = back(mesh.with_points(moved), given)
    assert type(new) is meshio.Mesh
    assert new.points.tobytes() == moved.tobytes()
    assert new.info == "of the caller"
    new.points[0] = new.cells[1].data[0] = new.point_data["depth"][0] = 7
    assert given.points[4].tolist() == [np.float32(1.1), np.float32(0.9)]
    assert given.cells[1].data[0].tolist() == [0, 1, 4, 3]
    assert given.point_data["depth"][0] == 0


def test_back_of_another_mesh_is_refused(given):
    mesh = as_mesh((POINTS[:4], [(0, 1, 3)]))
    with pytest.raises(ValueError, match=r"points of shape \(4, 2\) for a mesh of \(8, 2\)"):
        back(mesh, given)


def test_what_is_no_mesh_is_refused(given):
    given.cells[2] = meshio.CellBlock("triangle", np.array([(2, 6, 8)]))
    with pytest.raises(MeshError, match="1 triangle cell names vertices outside the 8"):
        from_meshio(given)


def test_third_coordinate_as_a_value(given):
    given.points = np.column_stack([given.points, np.arange(8) ** 2])
    with pytest.raises(MeshError, match="surface"):
        as_mesh(given)
    assert as_mesh(given, surface="flat").points[7, 2] == 49.0


def test_accepts_by_the_class_and_its_heirs(given):
    class Heir(meshio.Mesh):
        pass

    assert meshio_mesh.accepts(given)
    assert meshio_mesh.accepts(Heir(given.points, given.cells))
    assert not meshio_mesh.accepts("mesh")
    assert not meshio_mesh.accepts(from_meshio(given))


def test_files_through_meshio(shared_meshes):
    for name in ("dealii_two_holes.msh", "rae2822_mixed.su2", "sfepy_apartment_tri.vtk"):
        mesh = read_mesh(shared_meshes / name)
        again = from_meshio(to_meshio(mesh))
        assert np.array_equal(again.points, mesh.points)
        assert [c.tolist() for c in again.cells] == [c.tolist() for c in mesh.cells]
        assert np.array_equal(again.regions, mesh.regions)
        assert np.array_equal(again.topology.lines, mesh.topology.lines)
