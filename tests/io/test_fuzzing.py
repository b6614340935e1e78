"""Damaged and hostile files: a mesh or a MeshError, without hanging, within 500 MB.

That it takes two seconds at most is measured: ``benchmarks/test_reading.py``, ``tools/fuzz.py``.
"""

import base64
import lzma
import resource
import struct
import sys
import time
import zlib

import numpy as np
import pytest

from crafted_files import MANY, SECTIONS, one_card_an_element
from format_samples import (
    ABAQUS,
    ISM,
    SMS,
    SU2,
    TEXT_CELLS,
    UCD,
    UNV,
    VTK,
    XDA,
    XYZ,
    vtu_arrays,
)
from qsmooth.errors import MeshError
from qsmooth.io import read_mesh

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")

SEED, SECONDS = 1, 30.0
# Of processor time: no bound on how fast a machine is, but on what grows beyond all measure.
HANGS = 20.0


def test_damaged_files_are_a_mesh_or_a_mesh_error():
    from fuzzing import fuzz

    *wrong, (count, _) = fuzz(SEED, SECONDS, most=HANGS)
    assert wrong == []
    assert count > 50


def test_a_case_is_the_same_again():
    from fuzzing import damaged

    files = {"a.off": b"OFF\n1 2 3\n", "b.obj": 30 * b"v 1 2 3\n"}
    made = [damaged(files, 7, case) for case in range(50)]
    assert made == [damaged(files, 7, case) for case in range(50)]
    assert len(set(made)) > 25


def bomb(name: str) -> str:
    """A file of a few hundred kilobytes that says to hold a gigabyte."""
    codec = {"vtkZLibDataCompressor": zlib, "vtkLZMADataCompressor": lzma}[name]
    packed = codec.compress(bytes(200 << 20))
    header = struct.pack("<IIII", 1, 200 << 20, 0, len(packed))
    stored = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    head = f' compressor="{name}"'
    return vtu_arrays(f'format="binary">{stored}', TEXT_CELLS, head) + "</VTKFile>\n"


def laughs() -> str:
    entities = "".join(f'<!ENTITY a{i + 1} "{10 * f"&a{i};"}">' for i in range(12))
    return f'<!DOCTYPE l [<!ENTITY a0 "ha">{entities}]><VTKFile type="UnstructuredGrid">&a12;'


def polygons() -> str:
    faces = "".join(f"{5 + k % 40} {(5 + k % 40) * '0 '}\n" for k in range(15_000))
    return f"OFF\n3 15000 0\n0 0 0\n1 0 0\n0 1 0\n{faces}"


VTK_HEAD = "# vtk DataFile Version 3.0\n\nASCII\n"
HOSTILE = {
    "zlib.vtu": (bomb("vtkZLibDataCompressor"), "said to be compressed"),
    "lzma.vtu": (bomb("vtkLZMADataCompressor"), "said to be compressed"),
    "laughs.vtu": (laughs(), "no valid XML"),
    "deep.vtu": ('<VTKFile type="UnstructuredGrid">' + 70_000 * "<a>" + 70_000 * "</a>", "XML"),
    "float.vtu": (
        vtu_arrays('format="ascii">\n' + XYZ, TEXT_CELLS).replace('"Int64"', '"Float64"')
        + "</VTKFile>",
        "no integers",
    ),
    "texts.vtk": (
        VTK_HEAD + "DATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\na 1 1000000000 string\nx\n",
        "1000000000 texts expected",
    ),
    "grid.vtk": (
        VTK_HEAD + "DATASET STRUCTURED_GRID\nDIMENSIONS 4294967296 4294967296 1\nPOINTS 0 float\n",
        "do not fit 0 points",
    ),
    "float.vtk": (
        VTK_HEAD + f"DATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n{XYZ}CELLS 2 4\n"
        "OFFSETS double\n0 4\nCONNECTIVITY double\n0 1 4 3\nCELL_TYPES 1\n9\n",
        "are no integers",
    ),
    "ranges.inp": (
        ABAQUS + "*NSET, NSET=a, GENERATE\n" + 30 * "1, 1000000, 1\n",
        "too many of them",
    ),
    "infinite.inp": (ABAQUS.replace("\n25, ", "\n1e400, "), "1 node ids are no integers"),
    "half.inp": (UCD.replace("\n25 2", "\n25.5 2"), "no integers, the first is 25.5"),
    "polygons.off": (polygons(), "and 35 more types"),
    "marks.su2": (SU2.replace("ELEMS= 2", "ELEMS= 99999999"), "says 99999999 rows"),
    "zones.dat": (
        "VARIABLES = x y\n"
        + 15_000 * "ZONE T=a, N=3,E=1,F=FEPOINT,ET=TRIANGLE\n0 0\n1 0\n0 1\n1 2 3\n",
        "more than 9804 such zones",
    ),
    "order.mesh": (ISM.replace(" 8 2 2", " 8 2 99999999"), "sides of order 99999999"),
    "nodes.xda": (XDA.replace("8\t # number of nodes", "99999999\t #"), "are missing"),
    "group.unv": (UNV.replace("         3\nright", "  99999999\nright"), "99999999 members"),
    "rows.vtk": (VTK.replace("CELLS 5 20", "CELLS 999999999 20"), "999999999 cells"),
}


def read_within_limits(path):
    memory, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    try:
        return read_mesh(path)
    finally:
        assert time.process_time() - started < HANGS
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory < 500_000


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_within_limits(put, name):
    content, message = HOSTILE[name]
    path = put(name, content)
    with pytest.raises(MeshError, match=message):
        read_within_limits(path)


@pytest.mark.parametrize("name", SECTIONS)
def test_any_number_of_sections_is_read_in_time(put, name):
    read_mesh(put("warm.inp", ABAQUS))
    content = SECTIONS[name]()
    assert 800_000 < len(content) <= 1 << 20
    assert read_within_limits(put(name, content)).n_cells == 1


def test_a_keyword_goes_on_over_empty_lines_and_up_to_the_next(put):
    content = ABAQUS.replace("*Element, type=CPE4R,\n elset", "*Element, type=CPE4R,\n \n elset")
    content = content.replace("*Heading\n plate, by hand", "*Heading,")
    assert read_mesh(put("gaps.inp", content)).regions.tolist() == [1, 2, 2]


def test_a_card_for_each_element_is_read_in_time(put):
    read_mesh(put("warm.inp", ABAQUS))
    mesh = read_within_limits(put("cards.inp", one_card_an_element()))
    assert np.array_equal(mesh.regions, 1 + np.arange(9000))


@pytest.mark.parametrize("name", MANY)
@pytest.mark.filterwarnings("ignore:.*nodes are declared")
def test_a_section_for_each_node_is_read_in_time(put, name):
    read_mesh(put("warm.2dm", SMS))
    mesh = read_within_limits(put(name, MANY[name]()))
    assert mesh.n_cells == 3
    assert len(mesh.source.names) in (2, 80_002, 200_002)


def test_sets_by_the_ten_thousand_are_read_in_time(put):
    read_mesh(put("warm.xda", XDA))
    sets = "".join(f"1 {k}\n" for k in range(40_000))
    content = XDA.replace("2\t # number of nodesets\n7 4\n3 5\n", f"40000\t #\n{sets}")
    mesh = read_within_limits(put("sets.xda", content))
    assert len(mesh.source.point_sets) == 40_000
    groups = "".join(f"{k} 0 0 0 0 0 0 1\ng{k}\n 7 5 0 0\n" for k in range(10_000))
    mesh = read_within_limits(put("groups.unv", f"{UNV}    -1\n  2467\n{groups}    -1\n"))
    assert len(mesh.source.point_sets) == 10_001


def test_sets_of_sets_do_not_double_for_ever(put):
    nested = "*ELSET, ELSET=a\n1, 2\n" + 60 * "*ELSET, ELSET=a\na, a\n"
    mesh = read_within_limits(put("nested.inp", ABAQUS + nested))
    assert mesh.n_cells == 3
    assert mesh.source.cell_sets["A"][0].tolist() == [0]


@pytest.mark.parametrize("tiny", ["1e-320", "5e-324", "-1e-310"])
def test_a_coordinate_next_to_zero_says_nothing_strange(put, tiny):
    content = f"OFF\n4 1 0\n0 0 {tiny}\n1 0 0.3\n1 1 0.3\n{tiny} 1 0\n4 0 1 2 3\n"
    assert read_mesh(put("tiny.off", content)).n_cells == 1


CUT_OFF = {
    "ansys.msh": '(1 "x")\n(10 (1',
    "a.mdpa": "Begin Nodes\n 1 0 0 0\n",
    "a.dat": 'TITLE = "x"\nVARIABLES = "X", "Y"\nZONE N=9, E=9, F=FEPOINT, ET=TRIANGLE\n0 0\n',
}


@pytest.mark.parametrize("name", CUT_OFF)
def test_no_reader_of_meshio_goes_on_for_ever_behind_the_end(put, name):
    with pytest.raises(MeshError, match=f"meshio says|{name}"):
        read_within_limits(put(name, CUT_OFF[name]))
