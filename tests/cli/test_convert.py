"""``qsmooth convert`` and ``qsmooth formats``; seams, which every command points out."""

import json

import numpy as np
import pytest

from qsmooth import Mesh, read_mesh, write_mesh
from qsmooth.io import formats

pytestmark = pytest.mark.nojit

SQUARES = [(0, 0), (1, 0), (1, 1), (0, 1), (1, 0), (2, 0), (2, 1), (1, 1)]
SEAM = "1 edge of the boundary lies on another"


@pytest.fixture
def seam_file(tmp_path):
    path = tmp_path / "seam.msh"
    mesh = Mesh(np.array(SQUARES, float), [[0, 1, 2, 3], [4, 5, 6, 7]], regions=[1, 2])
    write_mesh(path, mesh)
    return path


def test_formats_are_those_of_the_registry(call):
    code, out, err = call("formats")
    assert (code, err) == (0, "")
    for name, endings in formats().items():
        (line,) = [row for row in out.splitlines() if row.split()[:1] == [name]]
        assert " ".join(endings) in line
    _, out, _ = call("formats", "--json", "-")
    listed = {one["name"]: one for one in json.loads(out)["formats"]}
    assert list(listed) == list(formats())
    assert listed["gmsh"]["keeps"] is not None
    assert listed["nastran"]["keeps"] is None
    assert listed["xdmf"]["writes"]
    assert not listed["tetgen"]["writes"]
    assert not listed["cgns"]["reads"]


def test_convert_says_what_is_lost(call, fails, mesh_file, seam_file, tmp_path):
    out_file = tmp_path / "out.off"
    code, out, _ = call("convert", seam_file, out_file)
    assert code == 0
    assert f"Wrote {out_file}, 8 vertices, 2 cells, gmsh to off\nLost: 2 regions\n" in out
    assert read_mesh(out_file).n_cells == 2
    assert "exists; --overwrite replaces it" in fails("convert", seam_file, out_file)
    code, out, _ = call("convert", mesh_file, tmp_path / "copy.off", "--json", "-")
    assert json.loads(out)["lost"] == []
    assert (tmp_path / "copy.off").read_bytes() == mesh_file.read_bytes()
    message = fails("convert", mesh_file, tmp_path / "out.ofg")
    assert message.endswith("did you mean '.off'?")
    code, out, _ = call("convert", mesh_file, tmp_path / "plain", "--output-format", "vtk")
    assert "Nothing was lost." in out
    assert read_mesh(tmp_path / "plain").source.format == "vtk"


def test_convert_says_what_it_could_not_write(call, mesh_file, tmp_path):
    folder = tmp_path / "closed"
    folder.mkdir()
    (folder / "a.stl").mkdir()
    code, out, err = call("convert", mesh_file, folder / "a.stl")
    assert (code, out) == (2, "")
    assert "is a folder" in err
    code, out, err = call("convert", mesh_file, folder / "a.ele")
    assert (code, out) == (2, "")
    assert "format tetgen takes several files" in err


@pytest.mark.parametrize(
    "arguments",
    [("info",), ("quality",), ("smooth", "-o"), ("untangle", "-o"), ("convert", "")],
    ids=lambda arguments: arguments[0],
)
def test_every_command_points_out_seams_and_welds_them(call, seam_file, tmp_path, arguments):
    command, *more = arguments
    out_file = tmp_path / "out.msh"
    output = [word for word in (*more, out_file) if word] if more else []
    code, _, err = call(command, seam_file, *output)
    assert code == 0
    assert err == f"qsmooth: warning: '{seam_file}': {SEAM}, and stay apart; --merge welds them\n"
    for welding in (["--merge"], ["--merge-tolerance", "1e-6"]):
        extra = ["--overwrite"] if output else []
        code, _, err = call(command, seam_file, *output, *extra, *welding)
        assert code == 0
        assert err == f"qsmooth: '{seam_file}': {SEAM}, 2 vertices merged\n"
        if output:
            merged = read_mesh(out_file)
            assert (merged.n_vertices, merged.topology.n_parts) == (6, 1)
            assert merged.regions.tolist() == [1, 2]


def test_compare_points_out_seams(call, seam_file):
    _, _, err = call("compare", seam_file, "--methods", "laplacian", "--sweeps", 1)
    assert SEAM in err
    _, _, err = call("compare", seam_file, "--methods", "laplacian", "--merge", "--sweeps", 1)
    assert "2 vertices merged" in err


def test_merging_what_has_no_seam(call, fails, mesh_file):
    assert call("info", mesh_file)[2] == ""
    assert call("info", mesh_file, "--merge")[2] == f"qsmooth: '{mesh_file}': nothing to merge\n"
    message = fails("info", mesh_file, "--merge-tolerance", 0.5)
    assert message == "--merge-tolerance must be in [0, 0.25], got 0.5"
