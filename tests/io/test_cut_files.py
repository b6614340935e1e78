"""SMS files have no counts: what tells that their end is missing is pointed out."""

import pytest

from format_samples import SMS
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import read_mesh

NODES = "".join(f"ND {k} {k % 3} {k // 3} 0\n" for k in range(6))
ELEMENTS = "E4Q 1 0 1 4 3 1\nE4Q 2 1 2 5 4 1\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (f"MESH2D\n{ELEMENTS}{NODES}"[:-1], "the last line has no end"),
        (f"MESH2D\n{NODES}E4Q 1 0 1 4 3 1\n", "nodes? .*in no element"),
        (f'MESH2D\n{ELEMENTS}{NODES}BEGPARAMDEF\nGM "Mesh"\n', "no ENDPARAMDEF"),
    ],
)
def test_signs_of_a_cut_are_told(put, content, message):
    with pytest.warns(MeshWarning, match=message):
        read_mesh(put("cut.2dm", content))


@pytest.mark.parametrize("content", [f"MESH2D\n{ELEMENTS}{NODES}", SMS])
def test_whole_files_are_read_in_silence(put, content):
    assert read_mesh(put("whole.2dm", content)).source.notes == ()


def test_meshio_says_what_is_wrong_and_of_which_format(put):
    path = put("a.nas", "BEGIN BULK\nGRID,1,,0.5,0.,0.\nCQUAD4,1,1,1,2,3,4\nENDDATA\n")
    with pytest.raises(MeshError, match=r"a\.nas': no valid file of format nastran: meshio says: "):
        read_mesh(path)


def test_what_meshio_did_not_foresee_is_told_in_words(put):
    rows = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,1.,1.,0.\nCTRIA3,1,1,1,2,9\n"
    path = put("a.nas", f"BEGIN BULK\n{rows}ENDDATA\n")
    with pytest.raises(MeshError, match=r"meshio says: 9 is asked for, .* \(KeyError\)$"):
        read_mesh(path)
