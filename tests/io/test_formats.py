"""Small files of every format: what is read, kept, converted and refused."""

import base64
import struct
import sys
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest

from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import format_of, formats, own_formats, read_mesh, write_mesh
from qsmooth.io.registry import named
from qsmooth.mesh import Mesh

# Two quads and a triangle on six vertices and one that no cell uses:
#   3 -- 4 -- 5
#   |    |    | \
#   0 -- 1 -- 2 - 6      7 alone
POINTS = [(0, 0), (1, 0), (2, 0), (0, 1), (1.1, 0.9), (2, 1), (3, 0), (9, 9)]
QUADS = [(0, 1, 4, 3), (1, 2, 5, 4)]
TRIANGLES = [(2, 6, 5)]
XYZ = "".join(f"{x} {y} 0\n" for x, y in POINTS)

OFF = f"""OFF # a comment

# counts
8 3 0
{XYZ}4 0 1 4 3  255 0 0
4  1 2 5 4
3\t2 6 5 0.5 0.5 0.5 # grey
"""
COFF = "COFF\n8 3 0\n" + XYZ.replace(" 0\n", " 0  1 0 0 1\n") + "4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\n"
NOFF = "NOFF 8 3 0\n" + XYZ.replace(" 0\n", " 0  0 0 1\n") + "4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\n"
FLOWING = "OFF 8 3 0 " + XYZ.replace("\n", " ") + "4 0 1 4 3 4 1 2 5 4 3 2 6 5"
OBJ = (
    "# made by hand\nmtllib a.mtl\no plate\n"
    + "".join(f"v {x} {y} 0\n" for x, y in POINTS)
    + "vt 0 0\nvn 0 0 1\ng left\nusemtl red\nf 1/1/1 2/1/1 5//1 4/1\nf -7 -6 -3 -4\nl 1 2 3\np 8\n"
    + "s off\nf 3 7 \\\n 6\n"
)
MSH2 = (
    '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n1 9 "shore"\n2 5 "left part"\n'
    "$EndPhysicalNames\n$Comments\nanything\n$EndComments\n$Nodes\n8\n"
    + "".join(f"{10 * i + 5} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "$EndNodes\n$Elements\n5\n1 15 2 0 1 5\n2 1 2 9 1 5 15\n3 3 2 5 1 5 15 45 35\n"
    "4 3 2 6 2 15 25 55 45\n7 2 3 6 2 0 25 65 55\n$EndElements\n$Periodic\n0\n$EndPeriodic\n"
)
MSH1 = (
    "$NOD\n8\n"
    + "".join(f"{i + 1} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "$ENDNOD\n$ELM\n3\n1 3 5 1 4 1 2 5 4\n2 3 6 1 4 2 3 6 5\n3 2 6 1 3 3 7 6\n$ENDELM\n"
)
MSH4 = (
    "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 1 2 0\n1 0 0 0 0\n"
    "1 0 0 0 1 0 0 1 9 2 1 1\n1 0 0 0 1 1 0 1 5 1 1\n2 1 0 0 2 1 0 1 6 0\n$EndEntities\n"
    "$Nodes\n2 8 1 8\n1 1 1 3\n1\n2\n3\n0 0 0 0.0\n1 0 0 0.5\n2 0 0 1.0\n2 1 0 5\n4\n5\n6\n7\n8\n"
    + "".join(f"{x} {y} 0\n" for x, y in POINTS[3:])
    + "$EndNodes\n$Elements\n4 4 1 4\n1 1 1 1\n1 1 2\n2 1 3 1\n2 1 2 5 4\n2 2 3 1\n3 2 3 6 5\n"
    "2 2 2 1\n4 3 7 6\n$EndElements\n"
)
MSH40 = (
    "$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n1 8\n1 2 0 8\n"
    + "".join(f"{i + 1} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "$EndNodes\n$Elements\n2 3\n1 2 3 2\n1 1 2 5 4\n2 2 3 6 5\n2 2 2 1\n3 3 7 6\n$EndElements\n"
)
VTK = (
    "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\n"
    "time 1 1 double\n0.25\nPOINTS 8 float\n"
    + XYZ
    + "CELLS 5 20\n4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\n3 0 1 2\n1 7\nCELL_TYPES 5\n9 9 5 4 1\n"
    "CELL_DATA 5\nSCALARS material int 1\nLOOKUP_TABLE default\n7 8 8 0 0\n"
    "POINT_DATA 8\nVECTORS wind double\n" + XYZ + "METADATA\nINFORMATION 0\n\n"
    "SCALARS fixed bit\n1 1 1 1 0 1 1 1\n"
)
VTK5 = (
    "# vtk DataFile Version 5.1\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n"
    + XYZ
    + "CELLS 4 11\nOFFSETS vtktypeint64\n0 4 8 11\nCONNECTIVITY vtktypeint64\n"
    "0 1 4 3 1 2 5 4 2 6 5\nCELL_TYPES 3\n9\n9\n5\n"
)
POLYDATA = (
    "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 8 double\n"
    + XYZ
    + "POLYGONS 3 14\n4 0 1 4 3\n4 1 2 5 4\n3 2 6 5\nLINES 1 3\n2 0 1\n"
    "CELL_DATA 4\nSCALARS material int\nLOOKUP_TABLE default\n0 7 8 8\n"
)
PLY = (
    "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 8\nproperty float x\nproperty float y\n"
    "property float z\nproperty uchar red\nelement face 3\nproperty list uchar int vertex_indices\n"
    "property int flag\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    + XYZ.replace(" 0\n", " 0 255\n")
    + "4 0 1 4 3 1\n4 1 2 5 4 1\n3 2 6 5 1\n0 1\n"
)
SU2 = (
    "% by hand\nNDIME= 2\nNPOIN= 8 8\n"
    + "".join(f"{x}\t{y} {i}\n" for i, (x, y) in enumerate(POINTS))
    + "NELEM= 3\n9 0 1 4 3 0\n9 1 2 5 4 1\n5 2 6 5 2\nNMARK= 2\nMARKER_TAG= shore\n"
    "MARKER_ELEMS= 2\n3 0 1\n3 1 2\nMARKER_TAG= SEND_RECEIVE\nMARKER_ELEMS= 1\nSEND_TO= 1\n1 7\n"
)
ABAQUS = (
    "*Heading\n plate, by hand\n** a comment, with = and 1, 2, 3\n*NODE, NSET=ALL\n"
    + "".join(f"{10 * i + 5}, {x:.1f}, {y:.2e}, 0.\n" for i, (x, y) in enumerate(POINTS))
    + "*Element, type=CPE4R,\n elset=left\n1, 5, 15, 45, 35\n*ELEMENT, TYPE=S4, ELSET=right\n"
    "2, 15, 25, 55, 45\n*ELEMENT, TYPE=S3R, ELSET=RIGHT\n3, 25, 65, 55\n"
    "*ELEMENT, TYPE=T2D2, ELSET=rim\n4, 5, 15\n*NSET, NSET=fixed, GENERATE\n5, 25, 10\n"
    "*ELSET, ELSET=both\nleft, right\n*MATERIAL, NAME=steel\n*ELASTIC\n210000., 0.3\n"
)
UCD = (
    "# by hand\n8 4 1 0 0\n"
    + "".join(f"{10 * i + 5} {x} {y} 0\n" for i, (x, y) in enumerate(POINTS))
    + "1 7 quad 5 15 45 35\n2 8 quad 15 25 55 45\n3 8 tri 25 65 55\n4 1 line 5 15\n"
    "1 1\ndepth, m\n" + "".join(f"{10 * i + 5} 1.5\n" for i in range(8))
)
MEDIT = (
    "MeshVersionFormatted 2 # by hand\nDimension\n2\nVertices\n8\n"
    + "".join(f"{x} {y} 3\n" for x, y in POINTS)
    + "Edges 1\n1 2 9\nQuadrilaterals\n2\n1 2 5 4 7\n2 3 6 5 8\nTriangles\n1\n3 7 6 8\n"
    "Corners\n2\n1\n3\nEnd\n"
)
MFEM = (
    "MFEM mesh v1.0\n\n# by hand\ndimension\n2\n\nelements\n3\n"
    "7 3 0 1 4 3\n8 3 1 2 5 4\n8 2 2 6 5\n\nboundary\n1\n9 1 0 1\n\nvertices\n8\n2\n"
    + "".join(f"{x} {y}\n" for x, y in POINTS)
)


def vtu_arrays(points: str, cells: tuple[str, str, str], head: str = "") -> str:
    connectivity, offsets, types = cells
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0"{head}>\n'
        '<UnstructuredGrid><FieldData><DataArray type="Float64" Name="time" NumberOfTuples="1" '
        'format="ascii">0.5</DataArray></FieldData>\n'
        '<Piece NumberOfPoints="8" NumberOfCells="3">\n<CellData><DataArray type="Int32" '
        'Name="material" format="ascii">7 8 8</DataArray></CellData>\n<Points>'
        f'<DataArray type="Float32" NumberOfComponents="3" Name="Points" {points}'
        f'</DataArray></Points>\n<Cells><DataArray type="Int64" Name="connectivity" {connectivity}'
        f'</DataArray><DataArray type="Int64" Name="offsets" {offsets}</DataArray>'
        f'<DataArray type="UInt8" Name="types" {types}</DataArray></Cells>\n</Piece>'
        "</UnstructuredGrid>"
    )


TEXT_CELLS = (
    'format="ascii">0 1 4 3 1 2 5 4 2 6 5',
    'format="ascii">4 8 11',
    'format="ascii">9 9 5',
)
VTU = vtu_arrays('format="ascii">\n' + XYZ, TEXT_CELLS) + "</VTKFile>\n"
FLOATS = np.array([(x, y, 0) for x, y in POINTS], "<f4").tobytes()


def vtu_base64() -> bytes:
    stored = base64.b64encode(struct.pack("<I", len(FLOATS)) + FLOATS).decode()
    return (vtu_arrays(f'format="binary">\n  {stored}\n', TEXT_CELLS) + "</VTKFile>\n").encode()


def vtu_compressed() -> bytes:
    packed = zlib.compress(FLOATS)
    header = struct.pack("<IIII", 1, 1 << 15, len(FLOATS), len(packed))
    stored = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    head = ' compressor="vtkZLibDataCompressor"'
    text = vtu_arrays(f'format="binary">{stored}', TEXT_CELLS, head)
    return (text + "</VTKFile>\n").encode()


def vtu_raw() -> bytes:
    blocks = [
        FLOATS,
        np.array([0, 1, 4, 3, 1, 2, 5, 4, 2, 6, 5], "<i8").tobytes(),
        np.array([4, 8, 11], "<i8").tobytes(),
        np.array([9, 9, 5], "u1").tobytes(),
    ]
    offsets, raw = [], b""
    for block in blocks:
        offsets.append(f'format="appended" offset="{len(raw)}">')
        raw += struct.pack("<Q", len(block)) + block
    head = ' byte_order="LittleEndian" header_type="UInt64"'
    text = vtu_arrays(offsets[0], tuple(offsets[1:]), head)
    return (
        text.encode() + b'<AppendedData encoding="raw">\n_' + raw + b"\n</AppendedData></VTKFile>"
    )


def vtk_binary() -> bytes:
    return (
        b"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n"
        + np.array([(x, y, 0) for x, y in POINTS], ">f4").tobytes()
        + b"\nCELLS 3 14\n"
        + np.array([4, 0, 1, 4, 3, 4, 1, 2, 5, 4, 3, 2, 6, 5], ">i4").tobytes()
        + b"\nCELL_TYPES 3\n"
        + np.array([9, 9, 5], ">i4").tobytes()
        + b"\nCELL_DATA 3\nSCALARS material int 1\nLOOKUP_TABLE default\n"
        + np.array([7, 8, 8], ">i4").tobytes()
        + b"\n"
    )


def ply_binary(order: str) -> bytes:
    name = "little" if order == "<" else "big"
    header = (
        f"ply\nformat binary_{name}_endian 1.0\nelement vertex 8\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\nelement face 3\n"
        "property list uchar int vertex_index\nend_header\n"
    )
    body = b"".join(struct.pack(order + "fffB", x, y, 0, 9) for x, y in POINTS)
    for cell in [*QUADS, *TRIANGLES]:
        body += struct.pack(f"{order}B{len(cell)}i", len(cell), *cell)
    return header.encode() + body


def msh2_binary() -> bytes:
    nodes = b"".join(struct.pack("<iddd", i + 1, x, y, 0) for i, (x, y) in enumerate(POINTS))
    quads = b"".join(
        struct.pack("<7i", k + 1, 5 + k, 1, *(v + 1 for v in quad)) for k, quad in enumerate(QUADS)
    )
    triangle = struct.pack("<6i", 3, 6, 1, *(v + 1 for v in TRIANGLES[0]))
    return (
        b"$MeshFormat\n2.2 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n$Nodes\n8\n" + nodes
        + b"\n$EndNodes\n$Elements\n3\n" + struct.pack("<iii", 3, 2, 2) + quads
        + struct.pack("<iii", 2, 1, 2) + triangle + b"\n$EndElements\n"
    )  # fmt: skip


def msh4_binary() -> bytes:
    coordinates = np.array([(x, y, 0) for x, y in POINTS], "<f8").tobytes()
    return (
        b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n$Nodes\n"
        + struct.pack("<4Q", 1, 8, 1, 8) + struct.pack("<iiiQ", 2, 1, 0, 8)
        + struct.pack("<8Q", *range(1, 9)) + coordinates + b"\n$EndNodes\n$Elements\n"
        + struct.pack("<4Q", 2, 3, 1, 3) + struct.pack("<iiiQ", 2, 1, 3, 2)
        + struct.pack("<10Q", 1, 1, 2, 5, 4, 2, 2, 3, 6, 5)
        + struct.pack("<iiiQ", 2, 2, 2, 1) + struct.pack("<4Q", 3, 3, 7, 6) + b"\n$EndElements\n"
    )  # fmt: skip


# File name -> content, regions of the three cells (or None), number of line cells.
FILES: dict[str, tuple[str | bytes, list[int] | None, int]] = {
    "a.off": (OFF, None, 0),
    "coff.off": (COFF, None, 0),
    "noff.off": (NOFF, None, 0),
    "flowing.off": (FLOWING, None, 0),
    "a.obj": (OBJ, None, 2),
    "v2.msh": (MSH2, [5, 6, 6], 1),
    "v1.msh": (MSH1, [5, 6, 6], 0),
    "v4.msh": (MSH4, [5, 6, 6], 1),
    "v40.msh": (MSH40, [1, 1, 2], 0),
    "binary2.msh": (msh2_binary(), [5, 6, 6], 0),
    "binary4.msh": (msh4_binary(), [1, 1, 2], 0),
    "a.vtk": (VTK, [7, 8, 8], 2),
    "v5.vtk": (VTK5, None, 0),
    "poly.vtk": (POLYDATA, [7, 8, 8], 1),
    "binary.vtk": (vtk_binary(), [7, 8, 8], 0),
    "a.vtu": (VTU, [7, 8, 8], 0),
    "base64.vtu": (vtu_base64(), [7, 8, 8], 0),
    "compressed.vtu": (vtu_compressed(), [7, 8, 8], 0),
    "raw.vtu": (vtu_raw(), [7, 8, 8], 0),
    "a.ply": (PLY, None, 1),
    "little.ply": (ply_binary("<"), None, 0),
    "big.ply": (ply_binary(">"), None, 0),
    "a.su2": (SU2, [1, 1, 1], 2),
    "abaqus.inp": (ABAQUS, [1, 2, 2], 1),
    "ucd.inp": (UCD, [7, 8, 8], 1),
    "medit.mesh": (MEDIT, [7, 8, 8], 1),
    "mfem.mesh": (MFEM, [7, 8, 8], 1),
}
TEXT = [name for name, (content, _, _) in FILES.items() if isinstance(content, str)]


def content_of(name: str) -> bytes:
    content = FILES[name][0]
    return content.encode() if isinstance(content, str) else content


@pytest.fixture
def put(tmp_path):
    """Write a file and give back its path."""

    def write(name: str, content: str | bytes) -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def is_float32(name: str) -> bool:
    return b"Float32" in content_of(name) or name in ("binary.vtk", "little.ply", "big.ply")


@pytest.mark.parametrize("name", FILES)
def test_reading(put, name):
    _, regions, n_lines = FILES[name]
    mesh = read_mesh(put(name, content_of(name)))
    rtol = 1e-7 if is_float32(name) else 0
    np.testing.assert_allclose(mesh.points[:, :2], POINTS, rtol=rtol)
    cells = [tuple(row) for block in mesh.cells for row in block.tolist()]
    assert cells == [*QUADS, *TRIANGLES]
    assert (None if mesh.regions is None else mesh.regions.tolist()) == regions
    assert len(mesh.topology.lines) == n_lines
    if n_lines:
        assert mesh.topology.lines[0].tolist() == [0, 1]


@pytest.mark.parametrize("name", TEXT)
def test_crlf_and_a_byte_order_mark(put, name):
    content = content_of(name).replace(b"\n", b"\r\n")
    if not name.endswith(".vtu"):
        content = b"\xef\xbb\xbf" + content
    path = put(name, content)
    mesh = read_mesh(path)
    assert mesh.points[:, :2].tolist() == [list(map(float, p)) for p in POINTS]
    write_mesh(path, move(mesh))
    assert np.array_equal(read_mesh(path).points, move(mesh).points)
    if not name.endswith(".vtu"):
        assert path.read_bytes().count(b"\r\n") == content.count(b"\r\n")


def move(mesh: Mesh) -> Mesh:
    points = mesh.points.copy()
    points[4, :2] += [1 / 3, -1e-17]
    return mesh.with_points(points)


@pytest.mark.parametrize("name", FILES)
def test_writing_back_keeps_every_other_byte(put, tmp_path, name):
    mesh = read_mesh(put(name, content_of(name)))
    copy = tmp_path / f"copy-{name}"
    write_mesh(copy, mesh)
    assert copy.read_bytes() == content_of(name)

    write_mesh(copy, move(mesh))
    back = read_mesh(copy)
    assert np.array_equal(back.points, move(mesh).points)
    for key in ("point_data", "cell_data", "field_data", "point_sets", "cell_sets"):
        old, new = getattr(mesh.source, key), getattr(back.source, key)
        assert list(old) == list(new)
        for label in old:
            np.testing.assert_equal(new[label], old[label])
    assert back.source.names == mesh.source.names
    assert back.source.extras == mesh.source.extras
    if name in TEXT:
        before, after = content_of(name).split(), copy.read_bytes().split()
        assert len(before) == len(after)
        assert sum(a != b for a, b in zip(before, after, strict=True)) <= 5


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("form", [form.NAME for form in own_formats()])
def test_conversion(put, tmp_path, name, form):
    """Vertices, cells and, where both have them, regions and lines go over."""
    mesh = move(read_mesh(put(name, content_of(name))))
    path = tmp_path / f"converted{named(form).ENDINGS[0]}"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        write_mesh(path, mesh, format=form)
    assert all(w.category is MeshWarning for w in caught)
    assert len(caught) <= 1
    said = str(caught[0].message) if caught else ""
    back = read_mesh(path, format=form)
    assert np.array_equal(back.points[:, :2], mesh.points[:, :2])
    cells = [tuple(row) for block in back.cells for row in block.tolist()]
    assert sorted(cells) == sorted([*QUADS, *TRIANGLES])
    kept = mesh.regions is not None and back.regions is not None
    if mesh.regions is not None and len(set(mesh.regions.tolist())) > 1:
        same = kept and len(set(back.regions.tolist())) == len(set(mesh.regions.tolist()))
        assert same or "regions" in said
    assert len(back.topology.lines) == len(mesh.topology.lines) or "line cells" in said


def test_conversion_says_what_is_lost(put, tmp_path):
    mesh = read_mesh(put("a.vtk", VTK))
    with pytest.warns(MeshWarning) as caught:
        write_mesh(tmp_path / "a.off", mesh)
    (warning,) = caught
    said = str(warning.message)
    for word in ("2 line cells", "1 point cells", "2 regions", "wind, fixed", "time", "a.off"):
        assert word in said


def test_gmsh_keeps_names_and_lines_of_su2(put, tmp_path):
    mesh = read_mesh(put("a.su2", SU2))
    with pytest.warns(MeshWarning, match="comments"):
        write_mesh(tmp_path / "a.msh", mesh)
    back = read_mesh(tmp_path / "a.msh")
    assert back.source.names["shore"][1] == 1
    assert len(back.topology.lines) == 2
    with pytest.warns(MeshWarning, match="1 point cells"):
        write_mesh(tmp_path / "b.su2", back)
    assert b"MARKER_TAG= shore\nMARKER_ELEMS= 2\n" in (tmp_path / "b.su2").read_bytes()


@pytest.mark.parametrize("ending", sorted({e for form in own_formats() for e in form.ENDINGS}))
def test_mesh_from_arrays_to_every_ending(tmp_path, ending):
    mesh = Mesh(np.array(POINTS, float) / 3, [np.array(QUADS), np.array(TRIANGLES)])
    path = tmp_path / f"a{ending}"
    write_mesh(path, mesh)
    back = read_mesh(path)
    assert np.array_equal(back.points[:, :2], mesh.points)
    assert [c.tolist() for c in back.cells] == [c.tolist() for c in mesh.cells] or ending == ".mesh"


def test_regions_of_arrays_are_written(tmp_path):
    mesh = Mesh(np.array(POINTS, float), [np.array(QUADS), np.array(TRIANGLES)], regions=[4, 4, 5])
    for name in ("a.msh", "a.vtk", "a.vtu", "a.inp", "a.mesh", "a.avs"):
        write_mesh(tmp_path / name, mesh)
        regions = read_mesh(tmp_path / name).regions
        assert len(np.unique(regions)) == 2, name


def test_formats_have_names_and_endings():
    listed = formats()
    own = [form.NAME for form in own_formats()]
    assert list(listed)[: len(own)] == sorted(own)
    assert listed["abaqus"] == (".inp",)
    assert "nastran" in listed
    assert not {"avsucd", "svg"} & set(listed)


def test_importing_io_brings_neither_meshio_nor_numba():
    import subprocess

    code = "import sys, qsmooth.io; print({'meshio', 'numba'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("name", "ending"), [("nastran", ".bdf"), ("tecplot", ".dat"), ("stl", ".stl")]
)
def test_other_formats_come_through_meshio(tmp_path, name, ending):
    points = np.array(POINTS[:6], float)
    mesh = Mesh(points, [np.array([(0, 1, 4), (0, 4, 3)]), np.array([(1, 2, 5)])])
    path = tmp_path / f"a{ending}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        write_mesh(path, mesh)
    back = read_mesh(path)
    assert sum(map(len, back.cells)) == 3
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


SECOND_ORDER = {
    "a.vtk": (
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 6 double\n"
        "0 0 0 1 0 0 0 1 0 .5 0 0 .5 .5 0 0 .5 0\nCELLS 1 7\n6 0 1 2 3 4 5\nCELL_TYPES 1\n22\n",
        "1 of type triangle6 .*cell 0, line 8",
    ),
    "a.msh": (MSH2.replace("7 2 3 6 2 0 25 65 55", "7 9 2 6 2 5 15 25 35 45 55"), "triangle6"),
    "tetra.msh": (MSH2.replace("7 2 3 6 2 0 25 65 55", "7 4 2 6 2 5 15 25 35"), "tetra .*3D"),
    "a.inp": (
        ABAQUS.replace("S3R, ELSET=RIGHT\n3, 25, 65, 55", "CPS6\n3, 5, 15, 25, 35, 45, 55"),
        "triangle6",
    ),
    "solid.inp": (ABAQUS.replace("TYPE=S4,", "TYPE=C3D4,"), "C3D4"),
    "a.off": (OFF.replace("3\t2 6 5 0.5 0.5 0.5", "5 2 6 5 4 3"), "polygon5 .*cell 2, line 15"),
    "a.obj": (OBJ + "f 1 2 3 4 5\n", "polygon5"),
    "a.ply": (PLY.replace("3 2 6 5 1", "5 2 6 5 4 3 1"), "polygon5"),
    "a.su2": (SU2.replace("5 2 6 5 2", "10 2 6 5 3 2"), "tetra"),
    "ucd.inp": (UCD.replace("3 8 tri 25 65 55", "3 8 tri6 25 65 55 5 15 35"), "triangle6"),
    "medit.mesh": (MEDIT.replace("End", "TrianglesP2 1\n1 2 3 4 5 6 0\nEnd"), "triangle6"),
    "mfem.mesh": (MFEM.replace("8 2 2 6 5", "8 4 2 6 5 3"), "tetra"),
}  # fmt: skip


@pytest.mark.parametrize("name", SECOND_ORDER)
def test_cells_that_cannot_be_smoothed_are_named(put, name):
    content, message = SECOND_ORDER[name]
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(put(name, content))
    assert name in str(caught.value)


# File, what to replace, by what, and the message.
WRONG = [
    ("a.off", "8 3 0\n", "8 4 0\n", "4 faces"),
    ("a.off", "8 3 0\n", "9 3 0\n", "line"),
    ("a.off", "8 3 0\n", "99999999999 3 0\n", "99999999999 vertices"),
    ("a.off", "4  1 2 5 4", "4  1 2 5 44", "line 14.*vertex 44"),
    ("a.off", "4  1 2 5 4", "4  1 2 5", "line 14.*does not fit"),
    ("a.off", "1.1 0.9", "1.1 abc", "line 9: 'abc' is not a number"),
    ("a.off", "1.1 0.9", "1.1 nan", "1 vertices are not finite, the first is vertex 4, line 9"),
    ("flowing.off", "OFF 8 3", "OFF 8 2", "2 faces"),
    ("a.obj", "v 1 0 0", "v 1 0", "line 5.*three coordinates"),
    ("a.obj", "f -7 -6 -3 -4", "f -70 -6 -3 -4", "vertices outside"),
    ("a.obj", "f -7 -6 -3 -4", "f 0 2 3 4", "counts from 1"),
    ("a.obj", "g left", "nonsense", "line 14: 'nonsense'"),
    ("v2.msh", "$Nodes\n8", "$Nodes\n9", "line"),
    ("v2.msh", "$Elements\n5", "$Elements\n6", "line"),
    ("v2.msh", "$Elements\n5", "$Elements\n4", "EndElements expected"),
    ("v2.msh", "2 1 2 9 1 5 15", "2 1 2 9 1 5 16", "node id 16"),
    ("v2.msh", "2 1 2 9 1 5 15", "2 99 2 9 1 5 15", "element type 99"),
    ("v2.msh", "\n15 1", "\n5 1", "ids come twice"),
    ("v2.msh", "2.2 0 8", "3.0 0 8", "MSH version 3.0"),
    ("v4.msh", "2 8 1 8", "2 9 1 8", "says 9 nodes"),
    ("v4.msh", "4 4 1 4", "4 5 1 4", "says 5 elements"),
    ("a.vtk", "POINTS 8", "POINTS 9", "line"),
    ("a.vtk", "POINTS 8", "POINTS -8", "count"),
    ("a.vtk", "CELLS 5 20", "CELLS 4 20", "CELLS says 4 cells"),
    ("a.vtk", "CELL_TYPES 5", "CELL_TYPES 4", "line"),
    ("a.vtk", "POINT_DATA 8", "POINT_DATA 7", "POINT_DATA says 7"),
    ("a.vtk", "DATASET UNSTRUCTURED_GRID", "DATASET STRUCTURED_POINTS", "STRUCTURED_POINTS"),
    ("a.vtu", 'NumberOfPoints="8"', 'NumberOfPoints="9"', "says 9 points"),
    ("a.vtu", 'NumberOfCells="3"', 'NumberOfCells="4"', "says 4 cells"),
    ("a.vtu", "</Points>", "</Point>", "XML"),
    ("a.ply", "element vertex 8", "element vertex 9", "line"),
    ("a.ply", "element face 3", "element face 2", "line"),
    ("a.ply", "property float y\n", "", "no x and y|more numbers"),
    ("a.su2", "NPOIN= 8 8", "NPOIN= 9", "NPOIN= says 9 rows, the file has 8"),
    ("a.su2", "NELEM= 3", "NELEM= 2", "line 15: NELEM= says 2 rows, the file has 3"),
    ("a.su2", "MARKER_ELEMS= 2", "MARKER_ELEMS= 3", "MARKER_ELEMS= says 3"),
    ("a.su2", "9 1 2 5 4 1", "9 1 2 5 44 1", "line 14.*44"),
    ("a.su2", "NDIME= 2", "NDIME= two", "count, not 'two'"),
    ("a.su2", "NDIME= 2", "NDIME= 2\nNZONE= 2", "2 zones"),
    ("abaqus.inp", "1, 5, 15, 45, 35", "1, 5, 15, 45, 36", "node id 36"),
    ("abaqus.inp", "1, 5, 15, 45, 35", "1, 5, 15, 45", "line 15.*id and 4 nodes"),
    ("abaqus.inp", "TYPE=S4", "TYPE=XYZ", "XYZ"),
    ("abaqus.inp", "*NODE, NSET=ALL", "*NODE, INPUT=other.inp", "another file"),
    ("ucd.inp", "8 4 1 0 0", "8 5 1 0 0", "line"),
    ("ucd.inp", "8 4 1 0 0", "8 400 1 0 0", "400 cells"),
    ("ucd.inp", "3 8 tri", "3 8 try", "'try' is unknown"),
    ("medit.mesh", "Vertices\n8", "Vertices\n9", "line"),
    ("medit.mesh", "Edges 1", "Edges 2", "line"),
    ("medit.mesh", "Triangles\n1", "Triangles\n100", "too early"),
    ("mfem.mesh", "elements\n3", "elements\n4", "line"),
    ("mfem.mesh", "elements\n3", "elements\n2", "is no section"),
    ("mfem.mesh", "MFEM mesh v1.0", "MFEM NURBS mesh v1.0", "only 'MFEM mesh'"),
    ("mfem.mesh", "vertices\n8\n2\n", "vertices\n8\nnodes\n", "curved"),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), WRONG)
def test_wrong_files(put, name, old, new, message):
    content = FILES[name][0]
    assert isinstance(content, str)
    assert old in content
    path = put(name, content.replace(old, new, 1))
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", FILES)
def test_truncated_anywhere(put, name):
    """One clear error, or, where only a remark was cut off, the same mesh."""
    content = content_of(name)
    whole = read_mesh(put(name, content))
    for end in range(1, len(content), 11):
        path = put(name, content[:end])
        try:
            mesh = read_mesh(path)
        except MeshError as error:
            assert str(path) in str(error)  # noqa: PT017
            continue
        n = min(mesh.points.shape[1], whole.points.shape[1])
        same = np.array_equal(mesh.points[:, :n], whole.points[:, :n])
        fewer = len(mesh.cells) <= len(whole.cells)
        assert (same and fewer) or is_open_ended(name), end


def is_open_ended(name: str) -> bool:
    """Formats without counts: a file cut off may be a whole one. MFEM ends with coordinates."""
    return name in ("a.obj", "abaqus.inp", "mfem.mesh")


@pytest.mark.parametrize("ending", sorted({e for form in own_formats() for e in form.ENDINGS}))
def test_garbage(put, ending):
    rng = np.random.default_rng(0)
    for content in (b"garbage\n1 2 3\n", rng.bytes(3000), b"\0" * 100, b"1\n", b"{}", b"<a/>"):
        path = put(f"a{ending}", content)
        with pytest.raises(MeshError) as caught:
            read_mesh(path)
        assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", FILES)
def test_damaged_bytes_never_end_in_another_error(put, name):
    rng = np.random.default_rng(0)
    content = bytearray(content_of(name))
    for _ in range(30):
        damaged = content.copy()
        for place in rng.integers(0, len(content), 3):
            damaged[place] = rng.integers(0, 256)
        path = put(name, bytes(damaged))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)
            try:
                read_mesh(path)
            except MeshError as error:
                assert str(path) in str(error)  # noqa: PT017


def test_meshio_never_leaves_the_interpreter(put, capsys):
    for name in ("a.bdf", "a.stl", "a.xdmf", "a.vol", "a.e", "a.med", "a.f3grid", "a.dat"):
        with pytest.raises(MeshError, match=name):
            read_mesh(put(name, b"garbage\n1 2 3\n"))
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("content", ["", " \n\n", "\t"])
@pytest.mark.parametrize("name", ["a.off", "a.msh", "a.vtu", "a.bdf"])
def test_empty_file(put, name, content):
    with pytest.raises(MeshError, match="empty"):
        read_mesh(put(name, content))


def test_unknown_format(put):
    with pytest.raises(MeshError, match=r"ending '\.xyz'.*off"):
        read_mesh(put("a.xyz", "garbage"))
    with pytest.raises(MeshError, match="unknown format 'xyz'"):
        read_mesh(put("a.off", OFF), format="xyz")
    mesh = read_mesh(put("a.off", OFF))
    with pytest.raises(MeshError, match="unknown format 'xyz'"):
        write_mesh("a.off", mesh, format="xyz")
    with pytest.raises(MeshError, match="unknown ending"):
        write_mesh("a.xyz", Mesh(np.array(POINTS, float), [np.array(QUADS)]))


def test_an_ending_that_says_nothing_is_no_way_to_the_format_of_the_source(put, tmp_path):
    mesh = read_mesh(put("a.txt", OBJ), format="obj")
    for name in ("out", "out.txt", "out.TXT", "out.obj"):
        assert format_of(tmp_path / name, mesh) == "obj"
        write_mesh(tmp_path / name, mesh)
        assert (tmp_path / name).read_text() == OBJ
    for name in ("out.xyz", "out.ojb"):
        with pytest.raises(MeshError, match=r"unknown ending '\.\w+', known are abaqus, gmsh"):
            write_mesh(tmp_path / name, mesh)
        assert not (tmp_path / name).exists()
    assert format_of(tmp_path / "out.xyz", mesh, format="off") == "off"
    with pytest.raises(MeshError, match="unknown ending ''"):
        format_of(tmp_path / "out", Mesh(np.array(POINTS, float), [np.array(QUADS)]))


def test_a_file_with_a_wrong_ending_says_what_it_is(put):
    with pytest.raises(MeshError, match="looks like obj: say so with format='obj'"):
        read_mesh(put("a.off", OBJ))
    assert len(read_mesh(put("a.off", OBJ), format="obj").points) == 8
    assert len(read_mesh(put("noending", OFF)).points) == 8


def test_the_ending_that_several_share_goes_by_where_the_mesh_came_from(put, tmp_path):
    for name, start in (("ucd.inp", b"# by hand"), ("mfem.mesh", b"MFEM")):
        path = tmp_path / f"out{Path(name).suffix}"
        write_mesh(path, move(read_mesh(put(name, content_of(name)))))
        assert path.read_bytes().startswith(start)


@pytest.mark.parametrize(
    "name", ["a.vtk", "binary.vtk", "a.vtu", "raw.vtu", "compressed.vtu", "base64.vtu"]
)
def test_vtk_reads_what_is_written_back(put, name):
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    path = put(name, content_of(name))
    mesh = move(read_mesh(path))
    write_mesh(path, mesh)
    reader = (
        vtk.vtkXMLUnstructuredGridReader()
        if name.endswith("vtu")
        else vtk.vtkUnstructuredGridReader()
    )
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), mesh.points)
    assert grid.GetNumberOfCells() in (3, 5)


@pytest.mark.parametrize(
    "form", ["gmsh", "vtk", "vtu", "obj", "ply", "su2", "abaqus", "ucd", "medit"]
)
def test_meshio_reads_what_is_converted(put, tmp_path, form, capsys):
    meshio = pytest.importorskip("meshio")
    mesh = move(read_mesh(put("coff.off", COFF)))
    path = tmp_path / "a.any"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_mesh(path, mesh, format=form)
        other = meshio.read(path, file_format="avsucd" if form == "ucd" else form)
    assert np.array_equal(other.points[:, :2], mesh.points[:, :2])
    for kind, expected in (("quad", QUADS), ("triangle", TRIANGLES)):
        cells = [tuple(row) for block in other.cells if block.type == kind for row in block.data]
        assert cells == expected
