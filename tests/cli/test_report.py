"""``qsmooth report``, and ``--report`` of other commands."""

import numpy as np
import pytest

from qsmooth import Mesh, read_mesh, smooth, write_mesh
from report_files import read_report, state_arrays

pytestmark = pytest.mark.nojit


@pytest.fixture
def page(tmp_path):
    return tmp_path / "page.html"


def names(facts):
    return [state["name"] for state in facts["states"]]


def test_what_the_usual_method_makes_of_a_mesh(call, mesh_file, page):
    code, out, err = call("report", mesh_file, "--sweeps", 10, "-o", page)
    assert (code, err) == (0, "")
    assert out.startswith(f"Wrote {page}, 0.")
    facts, arrays = read_report(page)
    assert facts["title"] == "mesh.off"
    assert names(facts) == ["before", "optimize"]
    expected = smooth(read_mesh(mesh_file), max_sweeps=10)
    xy, _ = state_arrays(facts, arrays, 1)
    assert np.abs(xy - expected.mesh.xy).max() <= 1e-7 * facts["scale"]
    assert "--sweeps" in facts["states"][1]["reason"]


def test_several_methods_and_what_was_skipped(call, mesh_file, page):
    call("report", mesh_file, "--methods", "star,laplacian,aspect-ratio", "--sweeps", 2, "-o", page)
    facts, _ = read_report(page)
    assert names(facts) == ["before", "star", "laplacian"]
    assert "By aspect ratio: skipped" in facts["notes"][0]


@pytest.mark.parametrize("none", ["none", ""])
def test_quality_of_one_mesh(call, mesh_file, page, none):
    assert call("report", mesh_file, "--methods", none, "--metrics", "all", "-o", page)[0] == 0
    facts, _ = read_report(page)
    assert names(facts) == ["before"]
    assert "taper" in facts["states"][0]["values"]


def test_two_files(call, fails, mesh_file, page, tmp_path):
    mesh = read_mesh(mesh_file)
    points = mesh.points.copy()
    points[~mesh.is_fixed, :2] += 1e-3
    after = tmp_path / "after.off"
    write_mesh(after, mesh.with_points(points))
    page.write_text("an old one")
    call("report", mesh_file, after, "-o", page)
    facts, arrays = read_report(page)
    assert facts["title"] == "mesh.off, after.off"
    assert names(facts) == ["before", "after"]
    xy, _ = state_arrays(facts, arrays, 1)
    assert np.abs(xy - points[:, :2]).max() <= 1e-7 * facts["scale"]
    call("report", mesh_file, after, "--methods", "star", "--sweeps", 1, "-o", page)
    assert names(read_report(page)[0]) == ["before", "after", "star"]

    other = tmp_path / "other.off"
    cells = mesh.cells[0].copy()
    cells[[3, 4]] = cells[[4, 3]]
    write_mesh(other, Mesh(mesh.points, cells))
    kept = page.read_bytes()
    message = f"{other} does not have the cells of {mesh_file}: cell 3 has other vertices"
    assert fails("report", mesh_file, other, "-o", page) == message
    write_mesh(other, Mesh(mesh.points, cells[:-1]))
    assert "302 cells instead of 303" in fails("report", mesh_file, other, "-o", page)
    assert page.read_bytes() == kept


def test_smooth_and_compare_write_one_too(call, mesh_file, page, tmp_path):
    out = tmp_path / "out.off"
    args = "smooth", mesh_file, "-o", out, "-m", "star", "--sweeps", 2
    code, said, _ = call(*args, "--report", page)
    assert code == 0
    assert f"Wrote {out} and {page}" in said
    facts, arrays = read_report(page)
    assert names(facts) == ["before", "star"]
    xy, _ = state_arrays(facts, arrays, 1)
    assert np.abs(xy - read_mesh(out).xy).max() <= 1e-7 * facts["scale"]
    code, said, _ = call("compare", mesh_file, "--sweeps", 1, "--report", page)
    assert code == 0
    assert f"Wrote {page}" in said
    facts, _ = read_report(page)
    assert len(facts["states"]) == 7
    assert "skipped" in facts["notes"][0]


def test_what_cannot_be_written_is_told_in_a_line(call, fails, mesh_file, page, tmp_path):
    kept = mesh_file.read_bytes()
    assert "--output would write over" in fails("report", mesh_file, "-o", mesh_file)
    for command in (["smooth", "-o", tmp_path / "o.off"], ["compare"]):
        message = fails(command[0], mesh_file, *command[1:], "--report", mesh_file)
        assert "--report would write over" in message
        assert "there" in fails(command[0], mesh_file, *command[1:], "--report", "none/r.html")
    assert mesh_file.read_bytes() == kept
    assert "--step is of methods" in fails(
        "report", mesh_file, "--methods", "none", "--step", 0.5, "-o", page
    )
    assert "did you mean 'star'" in fails("report", mesh_file, "--methods", "sttar", "-o", page)
    assert "--metrics must be one of" in fails("report", mesh_file, "--metrics", "no", "-o", page)
    assert not page.exists()
    assert not (tmp_path / "o.off").exists()


def test_help_says_that_one_mesh_is_enough(call):
    assert "qsmooth report BEFORE [AFTER] [OPTIONS]" in call("report", "--help")[1]
