"""What goes from one format into another, and what is told of the rest."""

import sys

import numpy as np
import pytest

from qsmooth import Mesh, read_mesh, write_mesh
from qsmooth.errors import MeshError
from qsmooth.io import write_and_tell
from qsmooth.io.missing import require

GRID = """grid
2 5
1 -76.0 39.0 2.0
2 -75.0 39.0 4.0
3 -75.0 40.0 3.0
4 -76.0 40.0 5.0
5 -74.0 39.5 1.0
1 4 1 2 3 4
2 3 2 5 3
"""
CONTROL = "run\nid\n0\n1\n0\n0\n{} ! ICS\n"
NODE_STRING = """MESH2D
E4Q 1 1 2 3 4 1
E3T 2 2 5 3 2
ND 1 0 0 1
ND 2 1 0 2
ND 3 1 1 3
ND 4 0 1 4
ND 5 2 0.5 5
NS 1 -2 1 inflow
"""
INTERLEAVED = [np.array([(0, 1, 4, 3)]), np.array([(1, 2, 5), (1, 5, 4)]), np.array([(3, 4, 7, 6)])]
NINE = [(x, y) for y in range(3) for x in range(3)]


@pytest.mark.parametrize(
    ("ics", "degrees"),
    [("1", False), ("2", True), ("22", True), ("-24", True), ("2.5", False), ("x", False)],
)
def test_adcirc_is_in_degrees_if_its_control_file_says_so(tmp_path, ics, degrees):
    (tmp_path / "fort.14").write_text(GRID)
    assert not read_mesh(tmp_path / "fort.14").geographic
    (tmp_path / "fort.15").write_text(CONTROL.format(ics))
    assert read_mesh(tmp_path / "fort.14").geographic == degrees
    assert not read_mesh(tmp_path / "fort.14", geographic=False).geographic


@pytest.mark.parametrize(
    ("control", "degrees"),
    [
        ("&CORE\n  ipre = 0\n/\n&OPT\n  ics = 2 !lon/lat\n/\n", True),
        ("&OPT\n  ics = 1\n/\n", False),
        ("&OPT\n  ! ics = 2\n  ics_set_up = 2\n/\n", False),
    ],
)
def test_schism_is_in_degrees_if_its_parameters_say_so(tmp_path, control, degrees):
    (tmp_path / "param.nml").write_text(control)
    (tmp_path / "hgrid.gr3").write_text(GRID)
    assert read_mesh(tmp_path / "hgrid.gr3").geographic == degrees


def test_schism_has_a_file_that_is_in_degrees(tmp_path):
    (tmp_path / "hgrid.ll").write_text(GRID)
    mesh = read_mesh(tmp_path / "hgrid.ll")
    assert mesh.geographic
    write_mesh(tmp_path / "new.ll", mesh.with_points(mesh.points))
    assert (tmp_path / "new.ll").read_text() == GRID


def test_depths_are_levels_in_ugrid(tmp_path):
    (tmp_path / "a.gr3").write_text(GRID)
    write_mesh(tmp_path / "a.nc", read_mesh(tmp_path / "a.gr3"))
    levels = read_mesh(tmp_path / "a.nc").source.point_data["mesh2d_node_z"]
    assert list(levels) == [-2.0, -4.0, -3.0, -5.0, -1.0]


@pytest.mark.parametrize("ending", [".vtk", ".off", ".su2", ".exo"])
def test_degrees_and_values_of_z_are_told_where_a_format_has_no_word_for_them(tmp_path, ending):
    (tmp_path / "a.gr3").write_text(GRID)
    mesh = read_mesh(tmp_path / "a.gr3", geographic=True)
    lost = write_and_tell(tmp_path / f"a{ending}", mesh)
    assert "that x and y are degrees" in lost
    assert ("that z is a value" in lost) == (ending != ".su2")


def test_the_projection_of_mike_is_not_lost_where_degrees_are_kept(tmp_path):
    mesh = Mesh(NINE, INTERLEAVED, geographic=True)
    write_mesh(tmp_path / "a.mesh", mesh, format="mike")
    lost = write_and_tell(tmp_path / "a.nc", read_mesh(tmp_path / "a.mesh"))
    assert not any("projection" in word or "degrees" in word for word in lost)
    assert read_mesh(tmp_path / "a.nc").geographic


@pytest.mark.parametrize("ending", [".exo", ".med", ".xdmf"])
def test_names_are_not_lost_in_silence(tmp_path, ending):
    (tmp_path / "a.2dm").write_text(NODE_STRING)
    mesh = read_mesh(tmp_path / "a.2dm")
    lost = write_and_tell(tmp_path / f"a{ending}", mesh)
    assert "group names inflow" in lost
    assert len(read_mesh(tmp_path / f"a{ending}", surface="flat").topology.lines) == 1


def test_med_takes_types_of_cells_in_any_order(tmp_path):
    mesh = Mesh(NINE, INTERLEAVED, regions=[4, 5, 6, 7])
    write_mesh(tmp_path / "a.med", mesh)
    back = read_mesh(tmp_path / "a.med")
    assert [len(cells) for cells in back.cells] == [2, 2]
    assert back.cells[0].tolist() == [[0, 1, 4, 3], [3, 4, 7, 6]]
    assert back.regions.tolist() == [4, 7, 5, 6]


def test_xdmf_leaves_out_data_that_it_has_no_shape_for(tmp_path):
    (tmp_path / "a.gr3").write_text(GRID)
    mesh = read_mesh(tmp_path / "a.gr3")
    mesh.source.point_data |= {"steps": np.ones((5, 17)), "bed": np.arange(5.0)}
    lost = write_and_tell(tmp_path / "a.xdmf", mesh)
    assert "point data steps" in lost
    back = read_mesh(tmp_path / "a.xdmf", surface="flat")
    assert list(back.source.point_data) == ["bed"]


def test_a_library_that_is_hidden_is_one_that_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MeshError, match=r"pip install 'qsmooth\[io\]'"):
        require("h5py", "this")
