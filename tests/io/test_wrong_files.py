"""Files that are wrong, cut off or of cells that cannot be smoothed are refused in words."""

import warnings

import numpy as np
import pytest

from format_samples import (
    ABAQUS,
    EVERY,
    FILES,
    MEDIT,
    MFEM,
    MSH2,
    OBJ,
    OFF,
    ONE_KIND,
    PLY,
    SMS,
    SU2,
    UCD,
    UNV,
    XDA,
    content_of,
)
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import own_formats, read_mesh

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
    "a.2dm": (SMS.replace("E3T 3 25 65 55", "E6T 3 25 65 55 5 15 35"), "triangle6 .*, line 6"),
    "a.unv": (
        UNV.replace("41         2         1         7         3\n", "42 2 1 7 6\n 5 15 35 "),
        "triangle6 .*line 35",
    ),
    "a.xda": (XDA.replace("3 10 8 2 6 5\n", "4 10 8 2 6 5 0 1 2\n"), "triangle6 .*line 31"),
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
    ("a.off", "1.1 0.9", "1.1 nan", "1 vertex is not finite, the first is vertex 4, line 9"),
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
    ("v1.msh", "\n1 3 5 1 4 1 2 5 4", "\n1 1 5 1 4 1 2 5 4", "line 14: a line with 2 tags cannot"),
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
    ("a.2dm", "ND 25 2 0 -2.5", "ND 25 2 0", "line 9: a node needs an id, x, y and z"),
    ("a.2dm", "ND 25 2 0 -2.5", "ND 25 2 zero -2.5", "line 9: 'zero' is not a number"),
    ("a.2dm", "ND 25 2", "ND 15 2", "1 node ids come twice"),
    ("a.2dm", "E4Q 1 5 15 45 35 7", "E4Q 1 5 15 45", "line 4: an element needs an id and 4 nodes"),
    ("a.2dm", "E4Q 1 5 15 45 35 7", "E4Q 1 5 15 45 36 7", "node id 36"),
    ("a.2dm", "E3T 3", "E5P 3", "line 6: 'E5P' is no card of SMS"),
    ("a.2dm", "NS -25 9", "NS 25 9", "line 16: .*'\"shore\"' is no node id"),
    ("a.2dm", "NS -75 3", "NS 75 3", "line 17: .*no negative id"),
    ("a.2dm", "NS -75 3", "7 5 3", "line 17: '7' is no card"),
    ("fort.14", "3 8 !", "3 80 !", "line 2: the header says 80 nodes and 3 elements, 21 lines"),
    ("fort.14", "25 2 0 2.5D0", "25 2 0", "line 5: a node needs an id, x, y and a depth"),
    ("fort.14", "25 2 0 2.5D0", "15 2 0 2.5D0", "1 node ids come twice"),
    ("fort.14", "1 4 5 15 45 35", "1 5 5 15 45 35", "line 11: an element of 5 nodes that does not"),
    ("fort.14", "1 4 5 15 45 35", "1 4 5 15 45 36", "node id 36"),
    ("fort.14", "1 = Number", "2 = Number", "line 24: 25 nodes of a boundary .land. expected"),
    ("fort.14", "20 = Number of", "24 = Number of", "line 23: a node of a weir needs one across"),
    ("fort.14", "2 20 =", "3 20 =", "line 24: 3 nodes of a boundary .land. expected, this is none"),
    ("mike.mesh", "1000 8 UTM", "1000 9 UTM", "line 9: node 9 of 9 needs an id, x, y, z, code"),
    ("mike.mesh", "1000 8 UTM", "1000 99 UTM", "the header says 99 nodes, 12 lines follow"),
    ("mike.mesh", "25 2 0 -2.5 0", "25 2 0 -2.5", "line 3: node 3 of 8 needs an id, x, y, z, code"),
    ("mike.mesh", "3 4 25", "4 4 25", "line 9: the header says 4 elements, 3 lines follow"),
    ("mike.mesh", "3 4 25", "3 4 26", "line 9: .*type .21 or 25. expected"),
    ("mike.mesh", "3 4 25", "3 3 21", "line 10: an element needs an id and 3 to 3 nodes"),
    ("mike.mesh", "1 5 15 45 35", "1 5 15 45 36", "node id 36"),
    ("mfem.mesh", "vertices\n8\n2\n", "vertices\n8\nnodes\n", "FiniteElementSpace expected"),
    ("nodes.mesh", "H1_2D_P1", "H1_2D_P3", "line 24: nodes of 'H1_2D_P3'.*higher order is curved"),
    ("nodes.mesh", "VDim: 2", "VDim: 4", "4 coordinates of a node"),
    ("nodes.mesh", "Ordering: 0", "Ordering: 2", "must be 0 or 1"),
    ("nodes.mesh", "vertices\n8", "vertices\n9", "line 24.*too early"),
    ("freefem.msh", "8 5 2", "8 5 3", "5 triangles and 3 edges take 56 numbers, the file has 53"),
    ("freefem.msh", "1 5 4 7", "1 5 9 7", "1 triangle cell names.*line 11.*vertex 8"),
    ("freefem.msh", "1 5 4 7", "1 5 4 x", "line 11: 'x' is not an integer"),
    ("point.dat", "N=8", "N=9", "line 17: the file ends too early: 3 numbers"),
    ("point.dat", "E=3", "E=4", "line"),
    ("point.dat", "E=3", "E=2", "line 5: 32 numbers expected, 36 found"),
    ("point.dat", "2 3 6 5", "2 3 6 9", "line 16: a cell names a node outside 1..8"),
    ("point.dat", "ET=QUADRILATERAL", "ET=BRICK", "line 5: a zone of type 'BRICK' is not read"),
    ("point.dat", "N=8, E=3,\n F=FEPOINT, ET=QUADRILATERAL", "I=4, J=2", "type 'ORDERED'"),
    ("point.dat", "1.1 0.9 4.5", "3*1.5", "line 11: values written once for several"),
    ("block.tec", "[3-4]", "[3-5]", "line 2: there is no variable 5, of 4"),
    ("block.tec", "=block", "=point", "values at cells need DATAPACKING=BLOCK"),
    ("zones.dat", "[1-4]=1", "[1-4]=2", "line 12: coordinates of zone 2"),
    ("zones.dat", "[1-3]=1", "[1-2]=1", "line 16: 16 values expected, 8 found"),
    ("zones.dat", "[1-4]=1", "[1-2]=1", "line 11: coordinates that|values expected"),
    ("zones.dat", "VARSHARELIST=([1-3]=1), ", "", "a moving mesh|values expected"),
    ("ism.mesh", " 8 2 2", " 8 3 2", "3 elements expected, the file has 2"),
    ("ism.mesh", "0 0 0 0", "1 0 0 0", "line 1[23]: a point of a curved side"),
    ("ism.mesh", " 8 2 2", " 8 2 61", "order 61"),
    ("ism.mesh", "shore --- ---", "shore ---", "line 12: an element needs four names"),
    ("ism.mesh", "2 3 6 5", "2 3 6 9", "vertex id 9"),
    ("ismv2.mesh", "8 7 2 2", "8 8 2 2", "line"),
    ("ismmm.mesh", "5 Marrow", "5", "line 14: this is no element: 5 words"),
    ("hohq.inp", "**  0 0 0 0", "**  0 0 2 0", "line 17: this is no element"),
    ("a.unv", "273.15\n    -1\n", "273.15\n", "a dataset has no end"),
    ("a.unv", "  2411\n", "  2419\n", "no dataset of nodes"),
    ("a.unv", "  2412\n", "  2419\n", "no dataset of elements"),
    ("a.unv", "        25        65        55", "        25        65", "ends within an element"),
    ("a.unv", "        25        65        55", "        25        65        56", "node id 56"),
    ("a.unv", "        12        44         2", "        12        44", "line .*element"),
    ("a.unv", "         0         3\nright", "         0         9\nright", "group of 9 members"),
    ("a.xda", "3\t # n", "4\t # n", "elements that were refined"),
    ("a.xda", "8\t # number of nodes", "9\t # number of nodes", "line"),
    ("a.xda", "5 9 8 1 2 5 4", "5 9 8 1 2 5", "a quad needs 7 numbers"),
    ("a.xda", "5 9 8 1 2 5 4", "99 9 8 1 2 5 4", "element type 99"),
    ("a.xda", "1 0 9", "2 3 9", "line 56: 1 conditions are on no side"),
    ("a.xda", "7 4\n3 5", "7 4\n8 5", "line 64: there is no node 8"),
    ("a.xda", "0\t # vector length", "1\t # vector length", "integers of nodes"),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), WRONG)
def test_wrong_files(put, name, old, new, message):
    content = (FILES | ONE_KIND)[name][0]
    assert isinstance(content, str)
    assert old in content
    path = put(name, content.replace(old, new, 1))
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.filterwarnings("ignore:.*cut off")
def test_truncated_anywhere(put, name):
    """One clear error, or, where only a remark was cut off, the same mesh."""
    content = content_of(name)
    whole = read_mesh(put(name, content))
    for end in places_to_cut(name, len(content)):
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


def places_to_cut(name: str, size: int) -> list[int]:
    """Every eleventh byte; ten where each try starts a process."""
    step = (size - 2) // 9 if name == "hdf5.nc" else 11
    return list(range(1, size, step))


def is_open_ended(name: str) -> bool:
    """Formats without counts: a file cut off may be a whole one. MFEM ends with coordinates."""
    return name in ("a.obj", "abaqus.inp", "mfem.mesh", "nodes.mesh", "a.2dm")


@pytest.mark.parametrize("ending", sorted({e for form in own_formats() for e in form.ENDINGS}))
def test_garbage(put, ending):
    rng = np.random.default_rng(0)
    for content in (b"garbage\n1 2 3\n", rng.bytes(3000), b"\0" * 100, b"1\n", b"{}", b"<a/>"):
        path = put(f"a{ending}", content)
        with pytest.raises(MeshError) as caught:
            read_mesh(path)
        assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", EVERY)
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
