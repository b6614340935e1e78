"""Constraints in the shell: each as in Python, files and names among them."""

import json

import meshio
import numpy as np
import pytest

from qsmooth import Constraints, limits, read_mesh, smooth, write_mesh
from qsmooth.examples import jittered
from qsmooth.sliding import limits_of
from test_selection import GMSH

pytestmark = pytest.mark.nojit


@pytest.fixture
def vtu_file(tmp_path):
    mesh = jittered(6, 6, seed=2)
    points = np.pad(mesh.points, ((0, 0), (0, 1)))
    data = {"slope": np.tile([1.0, 2.0, 0.0], (mesh.n_vertices, 1))}
    path = tmp_path / "mesh.vtu"
    meshio.write(path, meshio.Mesh(points, [("quad", mesh.cells[0])], point_data=data))
    return path


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (["--fixed", "24,25"], {"fixed": [24, 25]}),
        (["--fixed", "x < 0.5 and y >= 0.25"], {"fixed": "x < 0.5 and y >= 0.25"}),
        (["--fixed-file", "ids.txt"], {"fixed": [24, 25]}),
        (["--max-move", 0.01, "--max-move-share", 0.2], {"max_move": 0.01, "max_move_share": 0.2}),
        (["--directions", "1,2"], {"directions": (1, 2)}),
        (["--directions", "slope"], {"directions": (1, 2)}),
        (
            ["--selection", "polygon: 0,0 0.7,0 0.7,0.7 0,0.7", "--selection-rings", 1],
            {"selection": [[0, 0], [0.7, 0], [0.7, 0.7], [0, 0.7]], "selection_rings": 1},
        ),
    ],
)
def test_constraints_as_in_python(call, vtu_file, tmp_path, monkeypatch, words, options):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ids.txt").write_text("# two\n24\n25\n")
    out_file = tmp_path / "out.vtu"
    code, out, err = call(
        "smooth", vtu_file, "-o", out_file, "-m", "star", "--sweeps", 5, *words, "--json", "-"
    )
    assert (code, err) == (0, "")
    mesh = read_mesh(vtu_file)
    result = smooth(mesh, "star", max_sweeps=5, **options)
    assert read_mesh(out_file).points.tobytes() == result.points.tobytes()
    assert not np.array_equal(result.points, smooth(mesh, "star", max_sweeps=5).points)
    facts = json.loads(out)
    names = {word[2:].replace("-", "_") for word in words if str(word).startswith("--")}
    assert set(facts["options"]) == {"sweeps", *names}


@pytest.mark.parametrize("nothing", ["", " , "])
def test_fixed_that_names_nothing(fails, vtu_file, tmp_path, nothing):
    message = fails("smooth", vtu_file, "-o", tmp_path / "out.vtu", "--fixed", nothing)
    assert message.startswith("--fixed names no vertex")


def test_names_of_the_file(call, fails, tmp_path):
    path, out_file = tmp_path / "groups.msh", tmp_path / "out.msh"
    path.write_text(GMSH.replace("5 1 1 0", "5 1.3 1.2 0"))
    code, out, _ = call("smooth", path, "-o", out_file, "--no-keep-interfaces")
    assert code == 0
    assert read_mesh(out_file).points[4, 0] != 1.3
    code, out, _ = call(
        "smooth", path, "-o", out_file, "--overwrite", "--no-keep-interfaces", "--fixed", "water"
    )
    assert code == 0
    assert read_mesh(out_file).points[4, 0] == 1.3
    assert "set at vertex 4 by vertices given as fixed" in out
    message = fails("smooth", path, "-o", tmp_path / "new.msh", "--fixed", "sea")
    assert "the names of the mesh are inlet, water, Sand Bank; got 'sea'" in message
    assert message.startswith("--fixed takes vertex ids")
    message = fails("smooth", path, "-o", tmp_path / "new.msh", "--selection", "region = 9")
    assert "there is no region 9; the regions of the mesh are 3, 4, water, Sand Bank" in message
    message = fails("smooth", path, "-o", tmp_path / "new.msh", "--directions", "wind")
    assert message.startswith("--directions takes a vector such as 1,0")


def test_a_curve_is_a_file(call, vtu_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]
    (tmp_path / "square.xy").write_text("".join(f"{x} {y}\n" for x, y in corners))
    out_file = tmp_path / "out.vtu"
    words = "--boundary", "slide", "--curve", "square.xy", "--sweeps", 2
    code, out, _ = call("smooth", vtu_file, "-o", out_file, "-m", "star", *words, "--json", "-")
    assert code == 0
    options = {"sweeps": 2, "boundary": "slide", "curve": "square.xy"}
    assert json.loads(out)["options"] == options
    mesh, points = read_mesh(vtu_file), read_mesh(out_file).points
    for curve in (corners, tmp_path / "square.xy"):
        same = smooth(mesh, "star", max_sweeps=2, boundary="slide", curve=curve)
        assert points.tobytes() == same.points.tobytes()


def test_flags_are_spelled_as_in_a_shell(fails, vtu_file, tmp_path):
    words = "--interfaces", "slide", "--no-keep-interfaces"
    message = fails("smooth", vtu_file, "-o", tmp_path / "out.vtu", *words)
    assert "--interfaces slide" in message
    assert "--no-keep-interfaces lets" in message


def test_limits_of_what_may_move(call, vtu_file, tmp_path):
    for method in ("star", "optimize"):
        code, out, _ = call(
            "smooth", vtu_file, "-o", tmp_path / f"{method}.vtu", "-m", method, "--sweeps", 2,
            "--fixed", "x > 0.2 and x < 0.9",
        )  # fmt: skip
        assert code == 0
        assert "by vertices given as fixed" in out
    assert limits(read_mesh(vtu_file)).min_angle_set_by == ""


def test_limits_of_what_slides(call, tmp_path):
    mesh, out_file, report = jittered(6, 6, seed=2), tmp_path / "out.off", tmp_path / "report.json"
    mesh = mesh.with_points(mesh.points @ [[1.0, 0.0], [0.8, 0.6]])
    write_mesh(tmp_path / "in.off", mesh)
    options = "--boundary", "slide", "-m", "star", "--sweeps", 2, "--json", report
    assert call("smooth", tmp_path / "in.off", "-o", out_file, *options)[0] == 0
    told = limits_of(Constraints(boundary="slide").freedom(mesh), mesh, read_mesh(out_file))
    assert json.loads(report.read_text())["limits"] == told.to_dict()
    # The corners' edges stay on the sides.
    assert told.min_angle == pytest.approx(np.degrees(np.arctan2(0.6, 0.8)))
