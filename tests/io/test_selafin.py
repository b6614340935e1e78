"""TELEMAC's Selafin: byte orders, precisions, steps, and what becomes of each on writing."""

import struct
import warnings

import numpy as np
import pytest

from format_samples import ALONE, POINTS, QUADS, TRIANGLES, selafin
from meshes import rough_grid
from qsmooth import quality, read_mesh, smooth, write_mesh
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import selafin as form
from qsmooth.io.chains import boundary_numbers
from qsmooth.io.file_content import of_mesh
from qsmooth.io.selafin_layout import layout_of
from qsmooth.mesh import Mesh

CELLS = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 6, 5]]
DOUBLE = r"double precision \(SERAFIND\).*GEOMETRY FILE FORMAT = 'SERAFIND'"


@pytest.mark.parametrize("name", ALONE)
def test_reading(put, name):
    mesh = read_mesh(put(name, ALONE[name]))
    np.testing.assert_allclose(mesh.points[:, :2], POINTS, rtol=1e-7)
    assert mesh.cells[0].tolist() == CELLS
    source = mesh.source
    if name in ("big.slf", "little.sel"):
        assert mesh.surface == "flat"
        assert mesh.points[:, 2].tolist() == 8 * [-2.5]
        assert source.point_data["WATER DEPTH"].tolist() == 8 * [0.5]
        assert list(source.point_data) == ["WATER DEPTH"]
        assert source.field_data == {}
    elif name == "steps.res":
        assert mesh.points.shape == (8, 2)
        assert source.point_data["BOTTOM"].tolist() == 8 * [[-2.5, -1.5, -0.5]]
        assert source.point_data["WATER DEPTH"].tolist() == 8 * [[0.5, 1.5, 2.5]]
        assert source.field_data["time"].tolist() == [0, 10, 20]
        assert source.extras == ("the date",)
    else:
        assert mesh.points.shape == (8, 2)
        assert source.point_data == {}
    assert source.fields == tuple(source.point_data)


def moved(mesh: Mesh, by: float) -> Mesh:
    points = mesh.points.copy()
    points[4, 0] += by
    return mesh.with_points(points)


@pytest.mark.parametrize("name", ALONE)
def test_a_number_of_single_precision_changes_four_bytes(put, tmp_path, name):
    mesh = read_mesh(put(name, ALONE[name]))
    path = tmp_path / name
    write_mesh(path, mesh)
    assert path.read_bytes() == ALONE[name]
    points = mesh.points.copy()
    points[4, 0] = 1.125
    write_mesh(path, mesh.with_points(points))
    back = path.read_bytes()
    assert len(back) == len(ALONE[name])
    differ = np.flatnonzero(np.frombuffer(back, "u1") != np.frombuffer(ALONE[name], "u1"))
    assert 0 < differ.size <= np.ptp(differ) + 1 <= 8
    assert read_mesh(path).points[4, 0] == 1.125


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("n_steps", [0, 1, 3])
def test_what_rounding_would_spoil_makes_the_whole_file_double(put, tmp_path, order, n_steps):
    single, double = (selafin(order, size, n_steps, dated=True) for size in (4, 8))
    mesh = read_mesh(put("a.slf", single))
    points = mesh.points.copy()
    points[4, :2] = 1.3, 0.3 + 1e-12  # hardly to the left of the edge from vertex 1 to 5
    mesh = mesh.with_points(points)
    assert quality(mesh).n_invalid == 0
    path = tmp_path / "b.slf"
    with pytest.warns(MeshWarning, match=DOUBLE):
        write_mesh(path, mesh)
    back = read_mesh(path)
    assert np.array_equal(back.points, mesh.points)
    # Of what is no coordinate, the file is the one that would have been written in double.
    x_at = layout_of(double).x_at
    n = 2 * layout_of(double).record
    assert path.read_bytes()[:x_at] == double[:x_at]
    assert path.read_bytes()[x_at + n :] == double[x_at + n :]
    for name, values in mesh.source.point_data.items():
        assert np.array_equal(back.source.point_data[name], values)
    # A file of double precision is said to be so no more.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_mesh(path, moved(back, 1e-9))


def rough(n_steps: int) -> bytes:
    """A rough grid of triangles whose variables are not the same everywhere."""
    points, (quads,) = rough_grid(5)
    points = points.astype(np.float32).astype(np.float64)
    bed = (points @ [2.0, -1.0]).astype(np.float32)
    mesh = Mesh(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    content = of_mesh(mesh)
    if n_steps == 1:
        content.points = np.column_stack((points, bed))
        content.point_data = {"BOTTOM FRICTION": 3.0 * bed}
    else:
        steps = np.arange(1, n_steps + 1)
        content.point_data = {"BOTTOM": bed[:, None] * steps, "WATER DEPTH": -bed[:, None] * steps}
        content.field_data = {"time": 0.5 * steps}
    return form.write(content)


@pytest.mark.nojit
@pytest.mark.parametrize("n_steps", [1, 3])
@pytest.mark.parametrize("carry", ["interpolate", "keep"])
def test_variables_belong_to_places(put, tmp_path, n_steps, carry):
    mesh = read_mesh(put("a.slf", rough(n_steps)))
    result = smooth(mesh, "laplacian", max_sweeps=2, carry=carry)
    path = tmp_path / "b.slf"
    write_mesh(path, result.mesh)
    back = read_mesh(path)
    assert np.array_equal(back.points, result.points.astype(np.float32))
    went = (back.xy != mesh.xy).any(axis=1)
    assert went.any()
    bed = back.xy @ [2.0, -1.0]  # linear, so interpolated without error
    wanted = bed if carry == "interpolate" else mesh.xy @ [2.0, -1.0]
    if n_steps == 1:
        np.testing.assert_allclose(back.points[:, 2], wanted, atol=1e-6)
        np.testing.assert_allclose(back.source.point_data["BOTTOM FRICTION"], 3 * wanted, atol=2e-6)
    else:
        expected = wanted[:, None] * [1, 2, 3]
        np.testing.assert_allclose(back.source.point_data["BOTTOM"], expected, atol=2e-6)
        np.testing.assert_allclose(back.source.point_data["WATER DEPTH"], -expected, atol=2e-6)
        assert back.source.field_data["time"].tolist() == [0.5, 1.0, 1.5]
    if carry == "keep":
        said = "was carried along unchanged and is wrong by up to"
        assert result.reason.count(said) == 2
    else:
        assert "values were interpolated in the input mesh, which changed " in result.reason
    assert len(result.outcome.carried) == 2
    data = mesh.source.point_data
    for name, values in back.source.point_data.items():
        assert np.array_equal(values[~went], data[name][~went])


def test_what_bears_rounding_is_rounded(put, tmp_path):
    data = ALONE["big.slf"]
    mesh = moved(read_mesh(put("a.slf", data)), -0.05)
    write_mesh(tmp_path / "b.slf", mesh)
    assert (tmp_path / "b.slf").stat().st_size == len(data)
    rounded = mesh.points.astype(np.float32)
    assert (rounded != mesh.points).any()
    assert np.array_equal(read_mesh(tmp_path / "b.slf").points, rounded)


def test_rounded_by_hand_it_stays_single(put, tmp_path):
    mesh = moved(read_mesh(put("a.slf", ALONE["big.slf"])), 1e-3)
    single = mesh.with_points(mesh.points.astype(np.float32))
    assert quality(single).n_invalid == 0
    write_mesh(tmp_path / "b.slf", single)
    assert (tmp_path / "b.slf").stat().st_size == len(ALONE["big.slf"])


def test_new_files_are_single_where_that_holds_the_coordinates(tmp_path):
    path = tmp_path / "a.slf"
    points = np.array(POINTS[:6], float)
    quads = Mesh(np.round(points), QUADS)
    write_mesh(path, quads)
    assert path.read_bytes()[76:84] == b"SERAFIN "
    assert read_mesh(path).cells[0].tolist() == [list(q) for q in QUADS]
    with pytest.warns(MeshWarning, match=DOUBLE):
        write_mesh(path, Mesh(points, QUADS))
    assert path.read_bytes()[76:84] == b"SERAFIND"
    assert np.array_equal(read_mesh(path).points, points)
    with pytest.raises(MeshError, match="triangles or quads, the mesh has 1 triangles and 2 quads"):
        write_mesh(tmp_path / "b.slf", Mesh(np.array(POINTS, float), [QUADS, TRIANGLES]))
    assert not (tmp_path / "b.slf").exists()


def test_the_boundary_is_numbered_around_the_outside_then_around_islands():
    outer = [(3, 3), (0, 3), (0, 0), (3, 0)]
    hole = [(2, 2), (1, 2), (1, 1), (2, 1)]
    mesh = Mesh([*outer, *hole], [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)])
    assert boundary_numbers(of_mesh(mesh)).tolist() == [3, 4, 1, 2, 7, 6, 5, 8]


def test_data_of_points_become_variables(tmp_path, put):
    rows = "".join(f"{x} {y} 0 0.5 7\n" for x, y in np.round(POINTS[:6]).tolist())
    ply = (
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty double x\nproperty double y\n"
        "property double z\nproperty float roughness_of_the_bed\nproperty int mark\n"
        f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}4 0 1 4 3\n"
    )
    write_mesh(tmp_path / "a.slf", read_mesh(put("a.ply", ply)))
    data = read_mesh(tmp_path / "a.slf").source.point_data
    assert {name: values[0] for name, values in data.items()} == {
        "roughness_of_the": 0.5,
        "mark": 7,
    }


def test_an_origin_is_kept_and_said(put, tmp_path):
    at = BIG.index(struct.pack(">2i", 40, 1)) + 12
    data = changed(BIG, at, 500000)
    mesh = read_mesh(put("a.slf", data))
    assert mesh.source.extras == ("the origin of coordinates, [500000, 0]",)
    write_mesh(tmp_path / "b.slf", mesh.with_points(np.round(mesh.points)))
    assert (tmp_path / "b.slf").read_bytes()[: at + 4] == data[: at + 4]


def changed(data: bytes, at: int, value: int) -> bytes:
    return data[:at] + struct.pack(">i", value) + data[at + 4 :]


BIG = ALONE["big.slf"]
COUNTS_AT = BIG.index(struct.pack(">5i", 16, 5, 8, 3, 1)) + 4
WRONG = [
    (BIG[:60], "this is no file of format selafin"),
    (changed(BIG, 84, 81), "begins with|byte 0: the title"),
    (changed(BIG, 92, -1), "there cannot be -1 variables"),
    (changed(BIG, 92, 1 << 30), "there cannot be 1073741824 variables"),
    (changed(BIG, 92, 3), "byte 184: the name of a variable, a record of 32 bytes, .* one of 40"),
    (changed(BIG, 184 + 4 + 24, 5), "the file is 3D, of 5 planes"),
    (changed(BIG, COUNTS_AT, 6), "the nodes of elements, a record of 72 bytes, .* one of 60"),
    (changed(BIG, COUNTS_AT + 4, 9), "the numbers on the boundary, a record of 36"),
    (changed(BIG, COUNTS_AT + 8, 5), "5 elements of 5 nodes, 8 points"),
    (
        changed(BIG, COUNTS_AT + 24, 9),
        "1 triangle cell names vertices outside the 8 of the file",
    ),
    (BIG[:-1], "the file ends within time step 1"),
    (BIG + bytes(20), "the file ends within time step 2"),
    (changed(BIG, len(BIG) - 4, 31), "a record of 32 bytes expected in time step 1"),
]


@pytest.mark.parametrize(("data", "message"), WRONG, ids=range(len(WRONG)))
def test_wrong_files(put, data, message):
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(put("a.slf", data))
    assert "a.slf" in str(caught.value)


@pytest.mark.parametrize("name", ALONE)
def test_damaged_files_are_a_mesh_or_a_mesh_error(put, name):
    data = bytearray(ALONE[name])
    whole = read_mesh(put(name, ALONE[name])).xy
    for end in range(1, len(data), 7):
        try:
            mesh = read_mesh(put(name, bytes(data[:end])))
        except MeshError as error:
            assert name in str(error)  # noqa: PT017
        else:  # whole but for its steps
            assert np.array_equal(mesh.xy, whole)
    rng = np.random.default_rng(0)
    for _ in range(100):
        damaged = data.copy()
        damaged[rng.integers(0, len(data))] = rng.integers(0, 256)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)
            try:
                read_mesh(put(name, bytes(damaged)))
            except MeshError as error:
                assert name in str(error)  # noqa: PT017


# ------------------------------------------------------------------------------- real files

# Vertices, triangles, vertices on the boundary, steps, variables, smallest and largest angle.
REAL = {
    "malpasset_geo.slf": (13541, 26000, 1080, 1, 1, 5.65, 167.0),
    "tidal_flats_res.slf": (648, 1030, 264, 17, 5, 32.09, 113.58),
    "little_endian_double.slf": (17830, 35093, 565, 1, 2, 30.29, 101.94),
}


@pytest.mark.parametrize("name", REAL)
def test_real_files(shared_meshes, tmp_path, name):
    path = shared_meshes / "more" / name
    if not path.is_file():
        pytest.skip("the folder of more formats is not here")
    n, n_cells, n_boundary, n_steps, n_variables, low, high = REAL[name]
    mesh, data = read_mesh(path), path.read_bytes()
    layout = layout_of(data)
    assert (len(mesh.points), mesh.n_cells, layout.n_steps) == (n, n_cells, n_steps)
    assert len(layout.names) == n_variables
    found = quality(mesh)
    assert (round(float(np.min(found.min_angle)), 2), round(float(np.max(found.max_angle)), 2)) == (
        pytest.approx((low, high), abs=0.0051)
    )
    # What is numbered on the boundary, by the file and by what is written anew.
    stored = np.frombuffer(data, layout.order + "i4", n, layout.x_at - 4 - 4 * n)
    own = boundary_numbers(mesh.source)
    assert np.array_equal(stored > 0, own > 0)
    assert (own > 0).sum() == n_boundary
    assert np.array_equal(stored, own) or name == "malpasset_geo.slf"  # numbered in another way

    write_mesh(tmp_path / name, mesh)
    assert (tmp_path / name).read_bytes() == data
    points = mesh.points.copy()
    points[7, 0] = np.nextafter(points[7, 0], np.inf)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        write_mesh(tmp_path / name, mesh.with_points(points))
    back = read_mesh(tmp_path / name)
    assert np.array_equal(back.points, points.astype(layout.order + f"f{layout.size}"))
    assert ((tmp_path / name).read_bytes() == data) == (layout.size == 4)
    assert np.array_equal(back.cells[0], mesh.cells[0])
    for key, values in mesh.source.point_data.items():
        assert np.array_equal(back.source.point_data[key], values)
    for key, values in mesh.source.field_data.items():
        assert np.array_equal(back.source.field_data[key], values)
