"""Other programs' readers open what is written, and see the same mesh and values."""

import warnings

import numpy as np
import pytest

from format_samples import selafin
from meshes import rough_grid
from qsmooth import read_mesh, write_mesh
from qsmooth.errors import MeshWarning
from qsmooth.io.file_content import of_mesh
from qsmooth.mesh import Mesh

XY, (QUADS,) = rough_grid(4)
DEPTH = np.round(XY[:, 0] ** 2 + XY[:, 1], 3)


def mixed() -> Mesh:
    """Half of the grid as triangles, with depths, and its south side as a boundary."""
    points = np.column_stack((XY, DEPTH))
    halves = np.concatenate((QUADS[8:, :3], QUADS[8:, [0, 2, 3]]))
    mesh = Mesh(points, [QUADS[:8], halves], surface="flat")
    content = of_mesh(mesh)
    content.z_means = "depth"
    content.blocks = [*content.blocks, ("line", np.array([(k, k + 1) for k in range(4)]))]
    return content.to_mesh("auto")


def test_sms(tmp_path):
    py2dm = pytest.importorskip("py2dm")
    mesh = mixed()
    write_mesh(tmp_path / "a.2dm", mesh)
    with py2dm.Reader(str(tmp_path / "a.2dm")) as file:
        nodes = np.array([node.pos for node in file.iter_nodes()])
        cells = [tuple(v - 1 for v in cell.nodes) for cell in file.iter_elements()]
        (string,) = file.iter_node_strings()
    assert np.array_equal(nodes, np.column_stack((XY, -DEPTH)))
    assert cells == [tuple(row) for block in mesh.cells for row in block.tolist()]
    assert list(string.nodes) == [1, 2, 3, 4, 5]


def test_mike(tmp_path):
    mikeio = pytest.importorskip("mikeio")
    mesh = mixed()
    with pytest.warns(MeshWarning, match="4 line cells"):
        write_mesh(tmp_path / "a.mesh", mesh, format="mike")
    other = mikeio.Mesh(tmp_path / "a.mesh")
    assert np.array_equal(other.node_coordinates, np.column_stack((XY, -DEPTH)))
    cells = [tuple(row) for row in other.element_table]
    assert cells == [tuple(row) for block in mesh.cells for row in block.tolist()]
    assert np.array_equal(other.geometry.codes == 1, mesh.topology.is_boundary)


@pytest.mark.parametrize(
    ("size", "place", "stored"),
    [
        (4, [1.05, 0.95], np.float32),
        (4, [1.3, 0.3 + 1e-12], np.float64),  # rounded it would fold a cell
        (8, [1.05, 0.95], np.float64),
    ],
)
def test_telemac(tmp_path, put, size, place, stored):
    serafin = pytest.importorskip("serafin")
    mesh = read_mesh(put("a.slf", selafin(size=size, n_steps=3, dated=True)))
    points = mesh.points.copy()
    points[4] = place
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        write_mesh(tmp_path / "b.slf", mesh.with_points(points))
    points = points.astype(stored)
    with serafin.SerafinReader(str(tmp_path / "b.slf"), "en") as file:
        file.read_header()
        file.get_time()
        header = file.header
        assert np.array_equal(np.column_stack((header.x, header.y)), points)
        assert np.array_equal(np.asarray(header.ikle).reshape(-1, 3) - 1, mesh.cells[0])
        assert list(file.time) == [0.0, 10.0, 20.0]
        for name, key in (("B", "BOTTOM"), ("H", "WATER DEPTH")):
            for step in range(3):
                values = file.read_var_in_frame(step, name)
                assert np.array_equal(values, mesh.source.point_data[key][:, step])
