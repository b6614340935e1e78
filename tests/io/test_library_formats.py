"""Formats for which meshio needs libraries of the extra io: Exodus, MED, XDMF, HMF, CGNS."""

import io
import sys

import numpy as np
import pytest

from format_samples import POINTS, QUADS, TRIANGLES
from qsmooth import Mesh, read_mesh, write_mesh
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import formats

LIBRARIES = {"exodus": "netCDF4", "med": "h5py", "xdmf": "h5py", "hmf": "h5py", "h5m": "h5py"}
SIGNATURES = {"exodus": b"CDF\x01", "xdmf": b"<Xdmf/>"}
XY = np.array(POINTS, float) + 0.125


def need(name):
    pytest.importorskip(LIBRARIES[name])
    if name == "exodus":
        pytest.importorskip("h5py")  # where it is NetCDF-4


def made(path, name):
    """A file by meshio with data of all kinds that the format has."""
    import meshio

    cells = [("quad", np.array(QUADS)), ("triangle", np.array(TRIANGLES))]
    point_data = {"depth": np.arange(8.0)}
    more = {"cell_data": {"area": [np.array([1.0, 2.0]), np.array([3.0])]}}
    if name == "hmf":
        more = {}  # meshio does not read its own
    if name == "exodus":
        more = {"point_sets": {"inlet": np.array([0, 3])}}
    if name == "med":
        more |= {"cell_sets": {"left": [[0], []]}}
    meshio.write(path, meshio.Mesh(XY, cells, point_data=point_data, **more), file_format=name)
    return path


@pytest.mark.parametrize("name", ["exodus", "med", "xdmf", "hmf"])
def test_round_trip_with_data(tmp_path, name):
    need(name)
    ending = formats()[name][0]
    path, out = made(tmp_path / f"a{ending}", name), tmp_path / f"b{ending}"
    mesh = read_mesh(path)
    assert np.array_equal(mesh.points[:, :2], XY)
    assert [tuple(r) for b in mesh.cells for r in b.tolist()] == [*QUADS, *TRIANGLES]
    assert np.array_equal(mesh.source.point_data["depth"], np.arange(8.0))
    points = mesh.points.copy()
    points[4, :2] += [1 / 3, -1e-17]
    write_mesh(out, mesh.with_points(points))
    back = read_mesh(out)
    assert np.array_equal(back.points, points)
    for key in ("point_data", "cell_data", "point_sets", "cell_sets"):
        old, new = getattr(mesh.source, key), getattr(back.source, key)
        assert list(old) == list(new)
        for label in old:
            np.testing.assert_equal(new[label], old[label])


@pytest.mark.parametrize("name", ["exodus", "med"])
def test_coordinates_are_written_where_they_stand(tmp_path, name):
    need(name)
    path = made(tmp_path / f"a{formats()[name][0]}", name)
    mesh, before = read_mesh(path), path.read_bytes()
    write_mesh(path, mesh)
    assert path.read_bytes() == before
    points = mesh.points.copy()
    points[4, 0] = 1.25
    write_mesh(path, mesh.with_points(points))
    old, new = (np.frombuffer(data, np.uint8) for data in (before, path.read_bytes()))
    assert len(old) == len(new)
    assert 0 < (old != new).sum() <= 8


def classic_exodus(dtype="f8"):
    """An Exodus file of NetCDF's classic form with a side set, of which meshio reads nothing."""
    from scipy.io import netcdf_file

    with io.BytesIO() as buffer:
        file = netcdf_file(buffer, "w", version=2)
        file.title, file.api_version = "a", np.float32(8.0)
        sizes = {"num_dim": 2, "num_nodes": 8, "num_elem": 2, "num_el_blk": 1, "num_el_in_blk1": 2,
                 "num_nod_per_el1": 4, "num_side_sets": 1, "num_side_ss1": 1}  # fmt: skip
        for name, n in sizes.items():
            file.createDimension(name, n)
        for k, axis in enumerate("xy"):
            file.createVariable(f"coord{axis}", dtype, ("num_nodes",))[:] = XY[:, k]
        connect = file.createVariable("connect1", "i4", ("num_el_in_blk1", "num_nod_per_el1"))
        connect[:] = np.array(QUADS) + 1
        connect.elem_type = "QUAD4"
        for name in ("elem_ss1", "side_ss1"):
            file.createVariable(name, "i4", ("num_side_ss1",))[:] = [2]
        file.flush()
        return buffer.getvalue()


@pytest.mark.parametrize("dtype", ["f8", "f4"])
def test_side_sets_of_exodus_stay(put, dtype):
    need("exodus")
    path = put("a.exo", classic_exodus(dtype))
    mesh = read_mesh(path)
    points = mesh.points.copy()
    points[4, 0] += 1 / 3
    write_mesh(path, mesh.with_points(points))
    assert np.array_equal(read_mesh(path).points, points)
    from netCDF4 import Dataset

    with Dataset(path) as file:
        assert file["coordx"].dtype == np.float64
        assert file["elem_ss1"][:].tolist() == file["side_ss1"][:].tolist() == [2]
        assert file["connect1"].elem_type == "QUAD4"


def test_numbers_beside_an_xdmf_file_come_into_it(tmp_path):
    need("xdmf")
    mesh = read_mesh(made(tmp_path / "a.xdmf", "xdmf"))
    assert (tmp_path / "a.h5").exists()
    write_mesh(tmp_path / "b.xdmf", mesh)
    assert {p.name for p in tmp_path.iterdir()} == {"a.xdmf", "a.h5", "b.xdmf"}
    assert np.array_equal(read_mesh(tmp_path / "b.xdmf").points, mesh.points)


def test_what_a_format_cannot_hold_is_named(tmp_path):
    need("h5m")
    mesh = Mesh(XY, [np.array(QUADS), np.array(TRIANGLES)])
    with pytest.warns(MeshWarning, match="h5m cannot hold order or types of cells"):
        write_mesh(tmp_path / "a.h5m", mesh)
    with pytest.raises(MeshError, match="cgns"):
        write_mesh(tmp_path / "a.cgns", mesh)
    assert not (tmp_path / "a.cgns").exists()


@pytest.mark.parametrize("name", ["exodus", "med", "hmf", "h5m", "cgns"])
def test_without_its_library_one_line_says_what_to_install(put, tmp_path, monkeypatch, name):
    library = LIBRARIES.get(name, "h5py")
    monkeypatch.setitem(sys.modules, library, None)
    ending = formats()[name][0]
    words = rf"{library}.*pip install 'qsmooth\[io\]'"
    with pytest.raises(MeshError, match=words) as caught:
        read_mesh(put(f"a{ending}", b"x"))
    assert "\n" not in str(caught.value)
    with pytest.raises(MeshError, match=words):
        write_mesh(tmp_path / f"b{ending}", Mesh(np.pad(XY, ((0, 0), (0, 1))), np.array(TRIANGLES)))


@pytest.mark.parametrize("name", ["exodus", "med", "xdmf"])
def test_damaged_files_are_refused(tmp_path, name):
    need(name)
    path = made(tmp_path / f"a{formats()[name][0]}", name)
    good = path.read_bytes()
    bad = bytearray(good)
    bad[len(good) // 4 : len(good) // 2] = bytes(len(good) // 2 - len(good) // 4)
    for content in (good[: len(good) // 2], bytes(bad), SIGNATURES.get(name, good[:8])):
        path.write_bytes(content)
        with pytest.raises(MeshError, match=path.name):
            read_mesh(path)
