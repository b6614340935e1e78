"""Point data that is interpolated goes back into its file, and nothing else is touched."""

import base64
import re
import struct
import zlib

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth import read_mesh, smooth, write_mesh
from qsmooth.errors import MeshWarning
from qsmooth.io import holds_point_data

pytestmark = pytest.mark.nojit

POINTS, (QUADS,) = rough_grid(4)
N = len(POINTS)
BED = 3.0 + POINTS @ [2.0, -1.0]
FLOW = np.column_stack([BED, -BED])
SPACE = np.column_stack([POINTS, np.zeros(N)])


def rows(array):
    return "".join(" ".join(map(repr, row)) + "\n" for row in np.atleast_2d(array).tolist())


def raw(array, dtype):
    return np.ascontiguousarray(array).astype(dtype).tobytes()


def vtk(binary):
    head = f"# vtk DataFile Version 3.0\nx\n{'BINARY' if binary else 'ASCII'}\n".encode()
    out = head + f"DATASET UNSTRUCTURED_GRID\nPOINTS {N} double\n".encode()

    def put(array, dtype):
        return raw(array, dtype) + b"\n" if binary else rows(array).encode()

    out += put(SPACE, ">f8") + b"CELLS 16 80\n"
    out += put(np.column_stack([np.full(16, 4), QUADS]), ">i4") + b"CELL_TYPES 16\n"
    out += put(np.full((16, 1), 9), ">i4") + f"POINT_DATA {N}\n".encode()
    out += b"SCALARS bed float 1\nLOOKUP_TABLE default\n" + put(BED[:, None], ">f4")
    out += f"FIELD FieldData 2\nflow 2 {N} double\n".encode() + put(FLOW, ">f8")
    return out + f"same 1 {N} double\n".encode() + put(BED[:, None], ">f8")


def ply(binary):
    kind = "binary_little_endian" if binary else "ascii"
    names = ("double x", "float bed", "double y", "double z", "double flow", "double same")
    head = f"ply\nformat {kind} 1.0\nelement vertex {N}\n"
    head += "".join(f"property {name}\n" for name in names)
    head += "element face 16\nproperty list uchar int vertex_indices\nend_header\n"
    table = np.column_stack([POINTS[:, 0], BED, POINTS[:, 1], 0 * BED, BED, BED])
    if not binary:
        faces = np.column_stack([np.full(16, 4), QUADS])
        return (head + rows(table) + rows(faces)).encode()
    body = b"".join(struct.pack("<dfdddd", *row) for row in table.tolist())
    return head.encode() + body + b"".join(struct.pack("<B4i", 4, *q) for q in QUADS.tolist())


def tecplot(packing):
    head = f'VARIABLES = "x", "bed", "y", "z", "flow", "same"\nZONE N={N}, E=16, '
    head += f"DATAPACKING={packing}, ZONETYPE=FEQUADRILATERAL\n"
    table = np.column_stack([POINTS[:, 0], BED, POINTS[:, 1], 0 * BED, BED, BED])
    return (head + rows(table if packing == "POINT" else table.T) + rows(QUADS + 1)).encode()


def vtu(how):
    """Text, base64, base64 of compressed blocks, or raw at the end."""
    appended = b""

    def block(array, dtype):
        stored = raw(array, dtype)
        if how != "zlib":
            return struct.pack("<I", len(stored)) + stored
        packed = zlib.compress(stored)
        return struct.pack("<4I", 1, len(stored), 0, len(packed)) + packed

    def put(name, array, kind, dtype, width):
        nonlocal appended
        head = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" '
        if how == "text":
            return head + f'format="ascii">\n{rows(array)}</DataArray>'
        if how == "appended":
            offset = len(appended)
            appended += block(array, dtype)
            return head + f'format="appended" offset="{offset}"/>'
        stored = block(array, dtype)
        cut = 16 if how == "zlib" else 0
        text = base64.b64encode(stored[:cut]) + base64.b64encode(stored[cut:])
        return head + f'format="binary">{text.decode()}</DataArray>'

    zipped = ' compressor="vtkZLibDataCompressor"' if how == "zlib" else ""
    xml = f'<VTKFile type="UnstructuredGrid" byte_order="LittleEndian"{zipped}><UnstructuredGrid>'
    xml += f'<Piece NumberOfPoints="{N}" NumberOfCells="16"><PointData Scalars="bed">'
    xml += put("bed", BED[:, None], "Float32", "<f4", 1) + put("flow", FLOW, "Float64", "<f8", 2)
    xml += put("same", BED[:, None], "Float64", "<f8", 1)
    xml += put("id", np.arange(N)[:, None], "Int32", "<i4", 1) + "</PointData><Points>"
    xml += put("Points", SPACE, "Float64", "<f8", 3) + "</Points><Cells>"
    xml += put("connectivity", QUADS, "Int64", "<i8", 1)
    xml += put("offsets", 4 * np.arange(1, 17)[:, None], "Int64", "<i8", 1)
    xml += put("types", np.full((16, 1), 9), "UInt8", "u1", 1)
    xml += "</Cells></Piece></UnstructuredGrid>"
    end = b""
    if how == "appended":
        end = b'<AppendedData encoding="raw">_' + appended + b"</AppendedData>"
    return xml.encode() + end + b"</VTKFile>"


def msh(binary, version="2.2"):
    """Nodes in another order in the data than in the mesh; two times of one name."""
    out = f"$MeshFormat\n{version} {int(binary)} 8\n".encode()
    out += struct.pack("<i", 1) + b"\n" if binary else b""
    out += b"$EndMeshFormat\n$Nodes\n"
    ids, cells = 10 * np.arange(1, N + 1), 10 * (QUADS + 1)
    if version == "4.1":
        out += f"1 {N} 10 {10 * N}\n2 1 0 {N}\n".encode() + rows(ids[:, None]).encode()
        out += rows(SPACE).encode() + b"$EndNodes\n$Elements\n1 16 1 16\n2 1 3 16\n"
        out += rows(np.column_stack([np.arange(1, 17), cells])).encode()
    elif binary:
        out += f"{N}\n".encode()
        out += b"".join(struct.pack("<iddd", k, *row) for k, row in zip(ids, SPACE, strict=True))
        out += b"\n$EndNodes\n$Elements\n16\n" + struct.pack("<iii", 3, 16, 0)
        out += raw(np.column_stack([np.arange(1, 17), cells]), "<i4") + b"\n"
    else:
        out += f"{N}\n".encode()
        for k, row in zip(ids.tolist(), SPACE.tolist(), strict=True):
            out += f"{k} {rows(row)}".encode()
        out += b"$EndNodes\n$Elements\n16\n"
        heads = np.column_stack([np.arange(1, 17), np.full((16, 2), (3, 0))])
        out += rows(np.column_stack([heads, cells])).encode()
    out += b"$EndElements\n$ElementData\nkept\n$EndElementData\n"

    def data(name, table, step=0):
        turned = np.argsort(np.sin(ids))
        width = table.shape[1]
        text = f'$NodeData\n1\n"{name}"\n1\n{step}.5\n3\n{step}\n{width}\n{N}\n'.encode()
        for k, row in zip(ids[turned].tolist(), table[turned].tolist(), strict=True):
            if binary:
                text += struct.pack(f"<i{width}d", k, *row)
            else:
                text += f"{k} {' '.join(map(repr, row))}\n".encode()
        return text + (b"\n" if binary else b"") + b"$EndNodeData\n"

    out += data("bed", BED[:, None]) + data("flow", np.column_stack([FLOW, 0 * BED]))
    return out + data("same", BED[:, None]) + data("same", BED[:, None], step=1)


FILES = {
    "text.msh": msh(False),
    "binary.msh": msh(True),
    "four.msh": msh(False, "4.1"),
    "text.vtk": vtk(False),
    "binary.vtk": vtk(True),
    "text.ply": ply(False),
    "binary.ply": ply(True),
    "point.dat": tecplot("POINT"),
    "block.dat": tecplot("BLOCK"),
    **{f"{how}.vtu": vtu(how) for how in ("text", "base64", "zlib", "appended")},
}


@pytest.mark.parametrize("name", FILES)
def test_named_point_data_is_written_in_place(tmp_path, name):
    path, plain, out = tmp_path / name, tmp_path / f"plain-{name}", tmp_path / f"out-{name}"
    path.write_bytes(FILES[name])
    mesh = read_mesh(path)
    options = {"method": "laplacian", "max_sweeps": 1}
    result = smooth(mesh, interpolate="bed,flow", **options)
    write_mesh(out, result.mesh)
    write_mesh(plain, smooth(mesh, **options).mesh)
    back, other = read_mesh(out), read_mesh(plain)
    assert np.array_equal(back.points, result.points)
    found = back.source.point_data
    expected = 3.0 + back.xy @ [2.0, -1.0]
    assert np.abs(expected - BED).max() > 0.05
    np.testing.assert_allclose(found["bed"], expected, rtol=2e-7)  # declared as float32
    columns = found["flow"].reshape(N, -1)[:, :2]
    np.testing.assert_allclose(columns[:, 0], expected, rtol=1e-14)
    np.testing.assert_allclose(
        columns, np.column_stack([expected, -expected])[:, : columns.shape[1]]
    )
    untouched = set(found) - {"bed", "flow"}
    assert "same" in untouched
    for key in untouched:
        assert np.array_equal(found[key], other.source.point_data[key])
    # Without the arrays that are named it is the file that is written with coordinates alone.
    assert same_outline(out.read_bytes(), name) == same_outline(plain.read_bytes(), name)
    if name.startswith("binary"):
        assert out.stat().st_size == path.stat().st_size


def same_outline(data, name):
    """What is no number: lines of text that begin with a letter or a bracket."""
    if name.endswith(".vtu"):
        data = data.partition(b"<AppendedData")[0]
        return [re.sub(rb' offset="\d+"', b"", tag) for tag in re.findall(rb"<[^>]+>", data)]
    return re.findall(rb"^[a-zA-Z#][ -~]*$", data, re.MULTILINE)


def test_as_bytes_only_the_named_array_differs(tmp_path):
    path = tmp_path / "in.vtk"
    path.write_bytes(FILES["binary.vtk"])
    mesh = read_mesh(path)
    for out, names in (("a.vtk", ()), ("b.vtk", ("flow",))):
        result = smooth(mesh, "laplacian", max_sweeps=1, interpolate=names)
        write_mesh(tmp_path / out, result.mesh)
    a, b = ((tmp_path / out).read_bytes() for out in ("a.vtk", "b.vtk"))
    begin = a.index(b"flow 2 25 double\n") + len(b"flow 2 25 double\n")
    end = begin + 16 * N
    assert a[:begin] + a[end:] == b[:begin] + b[end:]
    assert a[begin:end] != b[begin:end]


def test_another_format_gets_the_new_values(tmp_path):
    path = tmp_path / "in.vtu"
    path.write_bytes(FILES["base64.vtu"])
    result = smooth(read_mesh(path), "laplacian", max_sweeps=1, interpolate="flow")
    for out in ("out.vtk", "out.ply", "out.msh"):
        write_mesh(tmp_path / out, result.mesh)
        data = read_mesh(tmp_path / out).source.point_data
        flow = data["flow"][:, 0] if "flow" in data else data["flow_0"]
        np.testing.assert_allclose(flow, 3.0 + result.mesh.xy @ [2.0, -1.0], rtol=1e-14)


def test_what_keeps_point_data():
    assert holds_point_data("vtu")
    assert holds_point_data("xdmf")
    assert holds_point_data("gmsh")
    assert not holds_point_data("off")


def test_times_of_one_name_in_gmsh_are_columns(tmp_path):
    path, out = tmp_path / "in.msh", tmp_path / "out.msh"
    path.write_bytes(FILES["text.msh"])
    mesh = read_mesh(path)
    assert mesh.source.point_data["same"].shape == (N, 2)
    assert mesh.source.extras == ("section $ElementData",)
    result = smooth(mesh, "laplacian", max_sweeps=1, interpolate="same")
    write_mesh(out, result.mesh)
    same = read_mesh(out).source.point_data["same"]
    expected = 3.0 + result.mesh.xy @ [2.0, -1.0]
    np.testing.assert_allclose(same, np.column_stack([expected, expected]), rtol=1e-14)
    assert out.read_bytes().count(b"$NodeData") == 4
    # Written anew: what has too many columns for a tensor becomes times.
    mesh.source.point_data["many"] = np.arange(11.0) + BED[:, None]
    mesh.source.data = b""
    with pytest.warns(MeshWarning, match=r"cannot hold section \$ElementData"):
        write_mesh(out, mesh)
    assert np.array_equal(read_mesh(out).source.point_data["many"], np.arange(11.0) + BED[:, None])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('$NodeData\n1\n"same"', '$NodeData\nx\n"same"'),  # no count
        (f"\n1\n{N}\n", f"\n2\n{N}\n"),  # two numbers a node
        (f"\n1\n{N}\n", "\n1\n3\n"),  # not all nodes
    ],
)
def test_node_data_of_another_kind_are_kept_as_they_are(tmp_path, old, new):
    path, out = tmp_path / "in.msh", tmp_path / "out.msh"
    path.write_bytes(FILES["text.msh"].replace(old.encode(), new.encode()))
    mesh = read_mesh(path)
    assert "same" not in mesh.source.point_data
    assert "section $NodeData" in mesh.source.extras
    write_mesh(out, mesh)
    assert out.read_bytes() == path.read_bytes()
