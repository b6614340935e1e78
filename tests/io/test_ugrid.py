"""UGRID files: what real ones have, what follows the nodes, what is kept."""

import sys
import warnings

import numpy as np
import pytest

from format_samples import POINTS, QUADS, TRIANGLES, content_of
from meshes import rough_grid
from qsmooth import Mesh, read_mesh, smooth, write_mesh
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io.netcdf_classic import compose, parse

RUN = "star"  # cheap to compile

# Vertices, triangles, quads, smallest and largest angle, by independent code.
REAL = {
    "ugrid_magdalena_1d2d_net.nc": (2352, 628, 1928, 26.57, 90.0),
    "ugrid_quad_and_triangle.nc": (5, 1, 1, 53.13, 126.87),
    "ugrid_float_connectivity_map.nc": (6, 0, 2, 90.0, 90.0),
    "ugrid09_spherical_cut_net.nc": (1657, 0, 1446, 84.39, 95.85),
}
HDF5 = {"ugrid_quad_and_triangle.nc", "ugrid_float_connectivity_map.nc"}


def read(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        return read_mesh(path, **options)


def real(shared_meshes, name):
    path = shared_meshes / "more" / name
    if not path.exists():
        pytest.skip("the folder of more formats is not here")
    if name in HDF5:
        pytest.importorskip("h5py")
    return path


def netcdf(form, points, rows, *, dtype="f8", start=0, fill=-1, **more):
    """A file by the NetCDF library, with places of faces and edges and a bed."""
    from netCDF4 import Dataset

    file = Dataset("a.nc", "w", memory=1024, format=form)
    edges = np.unique(np.sort([[r[k - 1], r[k]] for r in rows for k in range(4)], axis=1), axis=0)
    for name, n in {"node": len(points), "face": len(rows), "most": 4, "edge": len(edges),
                    "two": 2, "time": None}.items():  # fmt: skip
        file.createDimension(name, n)

    def put(name, kind, dims, values, **attributes):
        options = {"zlib": True} if form == "NETCDF4" and more.get("zlib") and dims else {}
        one = file.createVariable(
            name, kind, dims, fill_value=attributes.pop("fill", None), **options
        )
        one[...] = values
        one.setncatts(attributes)

    put("mesh", "i4", (), 0, cf_role="mesh_topology", topology_dimension=2,
        node_coordinates="mesh_x mesh_y", face_node_connectivity="corners",
        edge_node_connectivity="edges", face_coordinates="face_x face_y",
        edge_coordinates="edge_x edge_y")  # fmt: skip
    put("corners", "i4", ("face", "most"), np.asarray(rows) + start, start_index=start, fill=fill)
    put("edges", "i4", ("edge", "two"), edges + start, start_index=start)
    for k, axis in enumerate("xy"):
        put(f"mesh_{axis}", dtype, ("node",), points[:, k], fill=-999.0,
            standard_name=f"projection_{axis}_coordinate")  # fmt: skip
        put(f"face_{axis}", "f8", ("face",), points[rows].mean(axis=1)[:, k])
        put(f"edge_{axis}", "f8", ("edge",), points[edges].mean(axis=1)[:, k])
    put(
        "bed",
        "f4",
        ("node",),
        points @ [2.0, -1.0],
        fill=np.float32(-9.0),
        mesh="mesh",
        location="node",
    )
    put("wind", "f8", ("time", "node"), [points[:, 0], points[:, 1]], units="m s-1")
    put("depth", "f8", ("face",), np.arange(len(rows)))
    return bytes(file.close())


def values_of(path, name):
    from netCDF4 import Dataset

    with Dataset(path) as file:
        file.set_auto_mask(False)
        return np.asarray(file[name][...])


@pytest.fixture(params=["NETCDF3_CLASSIC", "NETCDF3_64BIT_DATA", "NETCDF4", "NETCDF4 zlib"])
def form(request):
    if "NETCDF4" in request.param:
        pytest.importorskip("h5py")
    pytest.importorskip("netCDF4")
    return request.param


@pytest.mark.parametrize("name", REAL)
def test_real_files_have_their_figures(shared_meshes, name):
    mesh = read(real(shared_meshes, name))
    n_vertices, n_triangles, n_quads, low, high = REAL[name]
    counts = {k: sum(len(b) for b in mesh.cells if b.shape[1] == k) for k in (3, 4)}
    assert (mesh.n_vertices, counts[3], counts[4]) == (n_vertices, n_triangles, n_quads)
    angles = []
    for cells in mesh.cells:
        ahead = np.roll(mesh.points[cells], -1, axis=1) - mesh.points[cells]
        back = -np.roll(ahead, 1, axis=1)
        cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
        angles += np.degrees(np.arctan2(cross, (ahead * back).sum(axis=-1))).ravel().tolist()
    assert [min(angles), max(angles)] == pytest.approx([low, high], abs=0.006)


def test_odd_declarations_are_pointed_out(shared_meshes):
    path = real(shared_meshes, "ugrid_quad_and_triangle.nc")
    with pytest.warns(MeshWarning, match="start_index 1 declared, nodes count from 0"):
        assert read_mesh(path).source.geographic
    assert not read(real(shared_meshes, "ugrid_magdalena_1d2d_net.nc")).source.geographic


@pytest.mark.parametrize("name", REAL)
def test_real_files_keep_every_byte_that_does_not_follow_from_the_nodes(
    shared_meshes, tmp_path, name
):
    path, copy = real(shared_meshes, name), tmp_path / "copy.nc"
    mesh = read(path)
    write_mesh(copy, mesh)
    assert copy.read_bytes() == path.read_bytes()
    points = mesh.points.copy()
    points[2] += 1e-4
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        write_mesh(copy, mesh.with_points(points))
    assert np.array_equal(read(copy).points, points)
    old, new = (np.frombuffer(p.read_bytes(), np.uint8) for p in (path, copy))
    assert len(old) == len(new)
    assert (old != new).sum() <= 8 * 2 * 14  # one node, its faces and edges and their bounds


def test_all_that_follows_from_the_nodes_follows(form, put, tmp_path):
    points, (rows,) = rough_grid(4)
    name, _, zlib = form.partition(" ")
    path = put("a.nc", netcdf(name, points, rows, start=1, zlib=bool(zlib)))
    result = smooth(read_mesh(path), RUN, interpolate="bed,wind")
    out = tmp_path / "out.nc"
    write_mesh(out, result.mesh)
    new = result.points
    assert (new != points).any()
    edges = values_of(out, "edges") - 1
    for k, axis in enumerate("xy"):
        assert np.array_equal(values_of(out, f"mesh_{axis}"), new[:, k])
        np.testing.assert_allclose(values_of(out, f"face_{axis}"), new[rows].mean(axis=1)[:, k])
        np.testing.assert_allclose(values_of(out, f"edge_{axis}"), new[edges].mean(axis=1)[:, k])
    np.testing.assert_allclose(values_of(out, "bed"), new @ [2.0, -1.0], atol=1e-6)
    np.testing.assert_allclose(values_of(out, "wind"), new.T, atol=1e-9)
    for kept in ("corners", "edges", "depth", "mesh"):
        assert np.array_equal(values_of(out, kept), values_of(path, kept))
    assert read_mesh(out).source.cell_data.keys() == {"depth"}


def test_float32_becomes_float64_with_all_that_belongs_to_it(form, put, tmp_path):
    from netCDF4 import Dataset

    points, (rows,) = rough_grid(4)
    name, _, zlib = form.partition(" ")
    path = put("a.nc", netcdf(name, points, rows, dtype="f4", zlib=bool(zlib)))
    mesh, out = read_mesh(path), tmp_path / "out.nc"
    moved = mesh.points.copy()
    moved[12] += 1 / 3e6
    write_mesh(out, mesh.with_points(moved))
    assert np.array_equal(read_mesh(out).points, moved)
    with Dataset(out) as new, Dataset(path) as old:
        assert new["mesh_x"].dtype == np.float64
        assert new["mesh_x"].dimensions == ("node",)
        assert new["mesh_x"]._FillValue == np.float64(-999.0)
        assert new["mesh_x"].standard_name == "projection_x_coordinate"
        assert set(new.variables) == set(old.variables)
        for one in old.variables:
            if not one.endswith(("_x", "_y")):
                assert np.array_equal(new[one][...], old[one][...])
                assert new[one].dimensions == old[one].dimensions


def test_fill_values_of_data_are_no_values(put, tmp_path):
    pytest.importorskip("netCDF4")
    points, (rows,) = rough_grid(4)
    data = bytearray(netcdf("NETCDF3_CLASSIC", points, rows))
    parse(data).variables["bed"].values[0] = -9.0
    path = put("a.nc", bytes(data))
    mesh = read_mesh(path)
    assert np.flatnonzero(np.isnan(mesh.source.point_data["bed"])).tolist() == [0]
    result = smooth(mesh, RUN, interpolate="bed")
    write_mesh(tmp_path / "out.nc", result.mesh)
    assert values_of(tmp_path / "out.nc", "bed")[0] == -9.0
    assert np.isnan(read_mesh(tmp_path / "out.nc").source.point_data["bed"][0])


def test_places_that_are_no_means_stay_and_that_is_told(put, tmp_path):
    pytest.importorskip("netCDF4")
    points, (rows,) = rough_grid(4)
    data = bytearray(netcdf("NETCDF3_CLASSIC", points, rows))
    parse(data).variables["face_x"].values[3] += 0.1
    mesh = read_mesh(put("a.nc", bytes(data)))
    with pytest.warns(MeshWarning, match="face_x, face_y are neither means nor centroids"):
        write_mesh(tmp_path / "out.nc", smooth(mesh, RUN).mesh)
    for axis in "xy":
        old, new = (values_of(tmp_path / name, f"face_{axis}") for name in ("a.nc", "out.nc"))
        assert np.array_equal(old, new)


def test_centroids_stay_centroids(put, tmp_path):
    points, (rows,) = rough_grid(4)
    p = points[rows]
    halves = [p[:, [0, 1, 2]], p[:, [0, 2, 3]]]
    areas = [np.cross(h[:, 1] - h[:, 0], h[:, 2] - h[:, 0]) for h in map(in_space, halves)]
    weights = [area[:, 2:] for area in areas]
    centres = sum(w * h.mean(axis=1) for w, h in zip(weights, halves, strict=True)) / sum(weights)
    data = bytearray(netcdf("NETCDF3_CLASSIC", points, rows))
    for k, axis in enumerate("xy"):
        parse(data).variables[f"face_{axis}"].values[...] = centres[:, k]
    mesh = read_mesh(put("a.nc", bytes(data)))
    write_mesh(tmp_path / "out.nc", mesh.with_points(3.0 * points))
    found = np.column_stack([values_of(tmp_path / "out.nc", f"face_{axis}") for axis in "xy"])
    np.testing.assert_allclose(found, 3.0 * centres, rtol=1e-12)


def in_space(points):
    return np.pad(points, ((0, 0), (0, 0), (0, 1)))


def changed(**attributes):
    """The classic sample with other attributes of its corners; None removes one."""
    content = parse(content_of("ugrid.nc"))
    corners = content.variables["corners"]
    rows = attributes.pop("rows", None)
    if rows is not None:
        corners.values = np.array(rows, corners.values.dtype)
    for name, value in attributes.items():
        corners.attributes.pop(name)
        if value is not None:
            corners.attributes[name] = np.array([value], ">i4")
    return compose(content)


@pytest.mark.parametrize(
    ("content", "note"),
    [
        (changed(start_index=0), "start_index 0 declared, nodes count from 1"),
        (changed(start_index=None), "start_index none declared, nodes count from 1"),
        (changed(rows=[(0, 1, 4, 3), (1, 2, 5, 4), (2, 6, 5, -9)]), "1 declared, nodes count from"),
        (changed(rows=[(1, 2, 5, 4), (2, 3, 6, 5), (3, 7, 6, 0)]), ""),
        (changed(rows=[(1, 2, 5, 4), (2, 3, 6, 5), (3, 7, 6, -2147483647)]), ""),
    ],
)  # fmt: skip
def test_nodes_are_counted_as_they_must_be(put, content, note):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = read_mesh(put("a.nc", move_last_node_into_the_mesh(content)))
    assert [tuple(r) for b in mesh.cells for r in b.tolist()] == [*QUADS, *TRIANGLES]
    assert note in "".join(str(one.message) for one in caught)
    assert bool(caught) == bool(note)


def move_last_node_into_the_mesh(content):
    """Leave out the node that no cell names, so that the highest number tells."""
    found = parse(content)
    for stored in found.variables.values():
        if "node" in stored.dims:
            axis = stored.dims.index("node")
            stored.values = np.take(stored.values, range(7), axis=axis)
    found.dims["node"] = 7
    return compose(found)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (changed(rows=[(1, 2, 5, 4), (2, 3, 6, 5), (3, -9, 6, 7)]), r"1 faces .* first is face 2"),
        (changed(rows=[(1, 2, 5, 4), (2, 3, 6, 5), (3, 7, 60, -9)]), "outside the 8 of the file"),
        (content_of("ugrid.nc")[:400], "header, byte|ends too early|cut off"),
        (content_of("ugrid.nc")[:-200], "cut off"),
        (content_of("ugrid.nc").replace(b"corners", b"Corners", 1), "corners|Corners"),
        (content_of("ugrid.nc").replace(b"topology", b"tapology"), "no mesh_topology"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(put, content, message):
    with pytest.raises(MeshError, match=message):
        read_mesh(put("a.nc", content))


def test_polygons_are_refused_by_name(put):
    content = parse(content_of("ugrid.nc"))
    content.dims["most"] = 5
    rows = [(1, 2, 5, 4, -9), (2, 3, 7, 6, 5), (3, 7, 6, -9, -9)]
    content.variables["corners"].values = np.array(rows, ">i4")
    with pytest.raises(MeshError, match=r"1 of type polygon5 .*cell 1"):
        read_mesh(put("a.nc", compose(content)))


def test_any_order_of_dimensions_and_coordinates(put):
    content = parse(content_of("ugrid.nc"))
    corners = content.variables["corners"]
    corners.dims, corners.values = ("most", "face"), np.ascontiguousarray(corners.values.T)
    content.variables["mesh"].attributes |= {"node_coordinates": "y x", "face_dimension": "face"}
    mesh = read_mesh(put("a.nc", compose(content)))
    assert mesh.points.tolist() == [list(map(float, p)) for p in POINTS]
    assert mesh.n_cells == 3


@pytest.mark.parametrize("form", ["CLASSIC", "64BIT_OFFSET", "64BIT_DATA"])
def test_files_are_laid_out_as_by_the_library(form):
    pytest.importorskip("netCDF4")
    points, (rows,) = rough_grid(4)
    data = netcdf(f"NETCDF3_{form}", points, rows)
    assert compose(parse(data)) == data.rstrip(b"\0").ljust(len(compose(parse(data))), b"\0")


def test_a_new_file_has_what_the_mesh_has(put, tmp_path):
    points, (rows,) = rough_grid(4)
    mesh = Mesh(
        np.column_stack([points, points[:, 0]]), rows, surface="flat", regions=np.arange(16)
    )
    path = tmp_path / "a.nc"
    write_mesh(path, mesh)
    back = read_mesh(path)
    assert np.array_equal(back.points, points)
    assert np.array_equal(back.source.point_data["mesh2d_node_z"], points[:, 0])
    assert np.array_equal(back.regions, np.arange(16))
    assert len(parse(path.read_bytes()).variables["mesh2d_edge_nodes"].values) == 40


def test_faces_of_a_new_file_run_anticlockwise(tmp_path):
    points, (rows,) = rough_grid(4)
    write_mesh(tmp_path / "a.nc", Mesh(points, rows[:, ::-1]))
    assert np.array_equal(read_mesh(tmp_path / "a.nc").cells[0], np.roll(rows, 1, axis=1))


def test_without_its_library_one_line_says_what_to_install(put, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MeshError, match=r"needs h5py.*pip install 'qsmooth\[io\]'") as caught:
        read_mesh(put("a.nc", b"\x89HDF\r\n\x1a\n" + bytes(100)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("source", ["written", "ugrid_magdalena_1d2d_net.nc"])
def test_xugrid_and_meshkernel_open_what_was_smoothed(shared_meshes, tmp_path, source):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        xarray = pytest.importorskip("xarray")
        xugrid = pytest.importorskip("xugrid")
        pytest.importorskip("meshkernel")
    path, out = tmp_path / "in.nc", tmp_path / "out.nc"
    if source == "written":
        points, (rows,) = rough_grid(4)
        write_mesh(path, Mesh(points, rows, regions=np.arange(16)))
    else:
        path.write_bytes(real(shared_meshes, source).read_bytes())
    mesh = read(path)
    result = smooth(mesh, RUN, max_sweeps=2)
    write_mesh(out, result.mesh)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        old, new = (xarray.open_dataset(p, engine="scipy").load() for p in (path, out))
        grids = {one.name: one for one in xugrid.UgridDataset(new).ugrid.grids}
        grid = grids["mesh2d"]
        kernel = grid.meshkernel.mesh2d_get()
    assert np.array_equal(grid.node_coordinates, result.points)
    assert grid.n_face == mesh.n_cells
    assert np.array_equal(np.column_stack([kernel.node_x, kernel.node_y]), result.points)
    assert set(new.variables) == set(old.variables)
    for name in old.variables:
        assert new[name].attrs == old[name].attrs
        if not name.endswith(("_x", "_y")) or not name.startswith("mesh2d"):
            np.testing.assert_array_equal(new[name].values, old[name].values)
