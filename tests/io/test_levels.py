"""What is z in one format and data in another, and what names and neighbours of files say."""

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth import Mesh, to_meshio
from qsmooth.inspection import inspect, may_be_degrees
from qsmooth.io import formats, read_mesh, write_and_tell, write_mesh
from qsmooth.io.netcdf_classic import compose, parse


@pytest.fixture
def bed():
    """A mesh with a bed level, and the levels."""
    points, (quads,) = rough_grid(4)
    levels = np.linspace(-5.0, -1.0, len(points))
    return Mesh(np.column_stack((points, levels)), quads, surface="flat"), levels


@pytest.mark.parametrize(("ending", "sign"), [(".14", -1.0), (".2dm", 1.0), (".slf", 1.0)])
def test_the_bed_of_a_ugrid_is_z_elsewhere_and_comes_back(tmp_path, bed, ending, sign):
    mesh, levels = bed
    write_mesh(tmp_path / "a.nc", mesh)
    net = read_mesh(tmp_path / "a.nc")
    assert np.array_equal(net.source.point_data["mesh2d_node_z"], levels)
    grid = net.with_points(net.points.astype(np.float32))  # Selafin holds these in singles
    lost = write_and_tell(tmp_path / f"b{ending}", grid)
    assert not [what for what in lost if "node_z" in what]
    other = read_mesh(tmp_path / f"b{ending}")
    assert np.allclose(other.points[:, 2], sign * levels)
    write_and_tell(tmp_path / "c.nc", other)
    assert np.allclose(read_mesh(tmp_path / "c.nc").source.point_data["mesh2d_node_z"], levels)


@pytest.mark.parametrize(
    ("about", "upwards"),
    [
        ({"standard_name": "altitude", "positive": "up"}, 1.0),
        ({"standard_name": "altitude", "positive": "down"}, -1.0),
        ({"standard_name": "sea_floor_depth_below_geoid"}, -1.0),
        ({"standard_name": "depth", "positive": "Down"}, -1.0),
        ({"standard_name": "depth", "positive": "up"}, 1.0),
        ({"positive": "down"}, -1.0),  # by its name alone it is the bed
    ],
)
def test_the_bed_of_a_ugrid_counts_as_it_says(tmp_path, bed, about, upwards):
    mesh, values = bed
    write_mesh(tmp_path / "a.nc", mesh)
    net = parse((tmp_path / "a.nc").read_bytes())
    z = net.variables["mesh2d_node_z"]
    del z.attributes["standard_name"]
    z.attributes.update(about)
    (tmp_path / "a.nc").write_bytes(compose(net))
    for ending, sign in ((".2dm", upwards), (".14", -upwards)):  # one has heights, one depths
        path = tmp_path / f"b{ending}"
        write_and_tell(path, read_mesh(tmp_path / "a.nc"))
        assert np.array_equal(read_mesh(path).points[:, 2], sign * values)
        write_and_tell(tmp_path / "c.nc", read_mesh(path))
        back = read_mesh(tmp_path / "c.nc").source.point_data["mesh2d_node_z"]
        assert np.array_equal(back, upwards * values)


def test_formats_with_point_data_keep_the_bed_as_such(tmp_path, bed):
    write_mesh(tmp_path / "a.nc", bed[0])
    assert write_and_tell(tmp_path / "b.vtk", read_mesh(tmp_path / "a.nc")) == ()
    assert np.array_equal(read_mesh(tmp_path / "b.vtk").source.point_data["mesh2d_node_z"], bed[1])


def test_a_file_whose_name_says_degrees_loses_none(tmp_path, bed):
    mesh = bed[0].with_geographic(True)
    assert write_and_tell(tmp_path / "a.ll", mesh) == ()
    assert read_mesh(tmp_path / "a.ll").geographic
    assert write_and_tell(tmp_path / "a.gr3", mesh) == ("that x and y are degrees",)
    (tmp_path / "param.nml").write_text("ics = 2\n")
    assert write_and_tell(tmp_path / "b.gr3", mesh) == ()


def test_files_that_say_that_they_are_in_lengths_get_no_hint(tmp_path, bed):
    points = bed[0].points + np.array([10.0, 50.0, 0.0])
    mesh = bed[0].with_points(points)
    assert may_be_degrees(mesh)
    assert any("look like degrees" in note for note in inspect(mesh).notes)
    write_mesh(tmp_path / "a.gr3", mesh)
    assert may_be_degrees(read_mesh(tmp_path / "a.gr3"))
    (tmp_path / "param.nml").write_text("ics = 1\n")
    assert not may_be_degrees(read_mesh(tmp_path / "a.gr3"))
    write_mesh(tmp_path / "a.nc", mesh)
    assert inspect(read_mesh(tmp_path / "a.nc")).notes == ()
    assert inspect(read_mesh(tmp_path / "a.gr3", geographic=False)).notes == ()


def test_two_formats_share_no_name():
    assert formats()["ugrid"] == (".nc",)
    assert ".ugrid" in formats()["aflr"]


def test_aflr_goes_through_meshio_under_its_name(tmp_path):
    points, (quads,) = rough_grid(4)
    given = to_meshio(Mesh(np.column_stack((points, 0.0 * points[:, 0])), quads))
    given.write(tmp_path / "a.b8.ugrid", file_format="ugrid")
    assert read_mesh(tmp_path / "a.b8.ugrid").source.format == "aflr"
