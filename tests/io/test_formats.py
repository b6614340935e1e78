"""Small files of every format: what is read, kept and converted."""

import re
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from format_samples import (
    COFF,
    EVERY,
    FILES,
    HOHQ_CURVED,
    ISM_CURVED,
    MSH20,
    NODES_L2,
    OBJ,
    OFF,
    ONE_KIND,
    POINTS,
    QUADS,
    SU2,
    TECPLOT_BLOCK,
    TECPLOT_POINT,
    TECPLOT_ZONES,
    TEXT,
    TRIANGLES,
    VTK,
    content_of,
)
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import format_of, format_records, formats, own_formats, read_mesh, write_mesh
from qsmooth.io.registry import folder_formats, named, only
from qsmooth.mesh import Mesh

# Formats that hold triangles and quads in one file.
MIXED = [form.NAME for form in own_formats() if form.NAME != "selafin"]


def is_float32(name: str) -> bool:
    return b"Float32" in content_of(name) or name in (
        "binary.vtk",
        "little.ply",
        "big.ply",
        "ugrid32.nc",
    )


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


@pytest.mark.parametrize("name", ONE_KIND)
def test_reading_formats_of_one_type_of_cell(put, name):
    _, expected, regions, n_lines = ONE_KIND[name]
    mesh = read_mesh(put(name, content_of(name)))
    assert mesh.points[:, :2].tolist() == [list(map(float, p)) for p in POINTS]
    assert [tuple(row) for block in mesh.cells for row in block.tolist()] == expected
    assert (None if mesh.regions is None else mesh.regions.tolist()) == regions
    assert len(mesh.topology.lines) == n_lines
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


ODD_ENDS = {
    "old Macintosh, and a newline at the end": lambda text: text.replace("\n", "\r") + "\n",
    "twice converted": lambda text: text.replace("\n", "\r\r\n"),
    "newline first": lambda text: text.replace("\n", "\n\r"),
    "of three sorts": lambda text: text.replace("\n", "\r\n", 5).replace("\nNE", "\rNE"),
    "form feeds and blanks": lambda text: text.replace("\n", " \t\f\n"),
    "none at the end": lambda text: text.rstrip("\n"),
}


@pytest.mark.parametrize("ends", ODD_ENDS)
def test_su2_with_odd_line_ends(put, ends):
    content = ODD_ENDS[ends](SU2).encode()
    path = put("a.su2", content)
    mesh = read_mesh(path)
    assert mesh.points.tolist() == [list(map(float, p)) for p in POINTS]
    assert [cells.tolist() for cells in mesh.cells] == [
        [list(cell) for cell in QUADS],
        [list(cell) for cell in TRIANGLES],
    ]
    assert list(mesh.source.names) == ["shore", "SEND_RECEIVE"]
    assert len(mesh.topology.lines) == 2
    write_mesh(path, move(mesh))
    assert re.sub(rb"1\.4333333333333333", b"1.1", path.read_bytes()) == content


def move(mesh: Mesh) -> Mesh:
    points = mesh.points.copy()
    points[4, :2] += [1 / 3, -1e-17]
    return mesh.with_points(points)


@pytest.mark.parametrize("name", EVERY)
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


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("form", MIXED)
def test_conversion(put, tmp_path, name, form):
    """Vertices, cells and, where both have them, regions and lines go over."""
    mesh = move(read_mesh(put(name, content_of(name))))
    path = tmp_path / f"converted{named(form).ENDINGS[0]}"
    kind = only(named(form))
    if kind and any(cells.shape[1] != (3 if kind == "triangle" else 4) for cells in mesh.cells):
        with pytest.raises(MeshError, match=f"format {form} holds {kind}s only, there are"):
            write_mesh(path, mesh, format=form)
        assert not path.exists()
        return
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        write_mesh(path, mesh, format=form)
    assert all(w.category is MeshWarning for w in caught)
    assert len(caught) <= 1
    said = str(caught[0].message) if caught else ""
    back = read_mesh(path, format=form)
    assert np.array_equal(back.points[:, :2], mesh.points[:, :2])
    old, new = (
        sorted(tuple(row) for block in one.cells for row in block.tolist()) for one in (mesh, back)
    )
    assert new == old
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


def test_tecplot_keeps_variables_zones_and_layout(put, tmp_path):
    mesh = read_mesh(put("a.dat", TECPLOT_POINT))
    assert list(mesh.source.point_data) == ["depth, m"]
    assert mesh.source.point_data["depth, m"].tolist() == [i + 0.5 for i in range(8)]
    mesh = read_mesh(put("b.tec", TECPLOT_BLOCK))
    assert np.isnan(mesh.source.cell_data["p"][1]).all()
    mesh = read_mesh(put("c.dat", TECPLOT_ZONES))
    assert mesh.source.names == {"left": (1, 2), "right": (2, 2)}
    assert mesh.source.extras == ("values of zone 3",)
    copy = tmp_path / "copy.dat"
    write_mesh(copy, move(mesh))
    old, new = TECPLOT_ZONES.split("\n"), copy.read_text().split("\n")
    assert [(a, b) for a, b in zip(old, new, strict=True) if a != b] == [
        ("1.1 0.9 0 1.5", "1.4333333333333333 0.9 0 1.5")
    ]


def test_tecplot_of_arrays_and_data(put, tmp_path):
    mesh = read_mesh(put("a.vtk", VTK))
    with pytest.warns(MeshWarning, match="cannot hold 2 line cells"):
        write_mesh(tmp_path / "a.dat", mesh)
    back = read_mesh(tmp_path / "a.dat")
    assert back.regions.tolist() == [7, 8, 8]
    assert list(back.source.point_data) == ["wind_0", "wind_1", "wind_2", "fixed"]
    write_mesh(tmp_path / "b.dat", Mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)]))
    assert "ZONETYPE=FETRIANGLE" in (tmp_path / "b.dat").read_text()
    assert read_mesh(tmp_path / "b.dat").cells[0].tolist() == [[0, 1, 2]]


def test_what_meshio_writes_as_tecplot_is_read(put, tmp_path):
    meshio = pytest.importorskip("meshio")
    points = np.array(POINTS, float) / 3
    cells = [("quad", QUADS), ("triangle", TRIANGLES)]
    data = {"p": np.arange(8.0)}
    meshio.Mesh(points, cells, point_data=data).write(tmp_path / "a.dat", file_format="tecplot")
    mesh = read_mesh(tmp_path / "a.dat")
    assert np.allclose(mesh.points, points, atol=1e-15)
    assert sum(map(len, mesh.cells)) == 3
    assert mesh.source.point_data["p"].tolist() == list(range(8))


def test_physical_names_without_a_dimension_have_that_of_their_cells(put, tmp_path):
    mesh = read_mesh(put("a.msh", MSH20))
    assert mesh.source.names == {"shore": (9, 1), "left part": (5, 2)}
    write_mesh(tmp_path / "copy.msh", move(mesh))
    old, new = MSH20.encode().split(b"\r\n"), (tmp_path / "copy.msh").read_bytes().split(b"\r\n")
    assert sum(a != b for a, b in zip(old, new, strict=True)) == 1
    with pytest.warns(MeshWarning):
        write_mesh(tmp_path / "b.vtk", mesh)


def test_places_of_corners_are_joined_where_they_are_the_same(put, tmp_path):
    mesh = read_mesh(put("l2.mesh", NODES_L2))
    assert mesh.points.tolist() == [list(map(float, p)) for p in POINTS[:7]]
    assert [cells.tolist() for cells in mesh.cells] == [
        [list(cell) for cell in QUADS],
        [list(cell) for cell in TRIANGLES],
    ]
    assert mesh.topology.lines.tolist() == [[0, 1]]
    assert mesh.source.notes == ()
    torn = NODES_L2.replace("1.1 0.9", "1.1 0.8", 1)
    with pytest.warns(MeshWarning, match="7 vertices have 8 places"):
        mesh = read_mesh(put("torn.mesh", torn))
    write_mesh(tmp_path / "copy.mesh", mesh)
    assert (tmp_path / "copy.mesh").read_text() == torn


@pytest.mark.parametrize("name", ["a.mesh", "a.inp"])
def test_curved_sides_hold_the_vertices_at_their_ends(put, tmp_path, name):
    content = ISM_CURVED if name == "a.mesh" else HOHQ_CURVED
    with pytest.warns(MeshWarning, match="1 curved side stays as it is; cells are judged as if"):
        mesh = read_mesh(put(name, content))
    copy = tmp_path / f"copy-{name}"
    write_mesh(copy, move(mesh))
    assert "0.5 -0.1 0" in copy.read_text()
    assert mesh.topology.lines[0].tolist() == [0, 1]
    points = mesh.points.copy()
    points[1, 0] += 0.1
    with pytest.raises(MeshError, match="vertex 1 at the end of a curved side has moved"):
        write_mesh(tmp_path / name, mesh.with_points(points))
    with pytest.warns(MeshWarning, match="cannot hold .*curved sides"):
        write_mesh(tmp_path / "a.off", mesh.with_points(points))


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


@pytest.mark.parametrize("ending", sorted({e for form in MIXED for e in named(form).ENDINGS}))
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
    own = [form.NAME for form in (*own_formats(), *folder_formats())]
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


def test_unknown_format(put):
    with pytest.raises(MeshError, match=r"unknown ending '\.xyz', known are .*\.avs, .*\.off, .*"):
        read_mesh(put("a.xyz", "garbage"))
    with pytest.raises(
        MeshError, match=r"known are .*; did you mean '\.off'\?, and it begins like"
    ):
        read_mesh(put("a.oof", "garbage"))
    with pytest.raises(MeshError, match=r"its name has no ending, known are .*\.avs.*begins like"):
        read_mesh(put("garbage", "garbage"))
    with pytest.raises(MeshError, match=r"unknown format 'of', known are .*abaqus.*mean 'off'\?"):
        read_mesh(put("a.off", OFF), format="of")
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
        with pytest.raises(MeshError, match=r"unknown ending '\.\w+', known are .*\.avs, "):
            write_mesh(tmp_path / name, mesh)
        assert not (tmp_path / name).exists()
    assert format_of(tmp_path / "out.xyz", mesh, format="off") == "off"
    with pytest.raises(MeshError, match="its name has no ending, known are"):
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


BEGINNINGS = {
    "solid x\n facet normal 0 0 1\n": "stl",
    '(1 "x")\n': "ansys",
    "$ a comment\nSOL 101\nCEND\n": "nastran",
    '<?xml version="1.0"?>\n<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>\n<Xdmf Version="3.0">': "xdmf",
    '<?xml version="1.0"?>\n<dolfin xmlns:dolfin="x">': "dolfin-xml",
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("ending", ["", ".txt"])
def test_a_file_whose_ending_says_nothing_is_known_by_its_content(put, name, ending):
    mesh = read_mesh(put(f"unknown{ending}", content_of(name)))
    assert mesh.source.format == read_mesh(put(name, content_of(name))).source.format


@pytest.mark.parametrize("head", BEGINNINGS)
def test_meshio_gets_what_begins_like_one_of_its_files(put, head):
    from qsmooth.io import via_meshio

    assert via_meshio.name_by_content(head.encode(), frozenset()) == BEGINNINGS[head]
    assert via_meshio.name_by_content(head.encode(), {BEGINNINGS[head]}) is None


def test_a_file_of_meshio_without_its_ending(tmp_path):
    mesh = Mesh(np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], float), [np.array([(0, 1, 2)])])
    for name, ending in (("stl", ".stl"), ("nastran", ".bdf")):
        path = tmp_path / f"a{ending}"
        write_mesh(path, mesh)
        path.rename(tmp_path / name)
        assert read_mesh(tmp_path / name).source.format == name


def test_records_of_formats_are_made_from_their_modules():
    records = {record.name: record for record in format_records()}
    assert {name: record.endings for name, record in records.items()} == formats()
    for form in own_formats():
        record = records[form.NAME]
        assert (record.reads, record.writes, record.through) == (True, True, "qsmooth")
        assert len(record.keeps) == len(form.HOLDS), "each word of HOLDS is told"
        assert record.title
    assert records["vtk"].to_dict()["keeps"][:2] == ["z", "point cells"]
    nastran = records["nastran"]
    assert (nastran.keeps, nastran.reads, nastran.through) == (None, True, "meshio")
    assert not records["tetgen"].writes
