"""``qsmooth compare``."""

import json
import re

import pytest

from qsmooth import limits, read_mesh, smooth, write_mesh
from qsmooth.examples import random_triangles

pytestmark = pytest.mark.nojit


def test_compare_puts_methods_side_by_side(call, mesh_file):
    before = mesh_file.read_bytes()
    code, out, err = call("compare", mesh_file, "--sweeps", 4)
    assert (code, err) == (0, "")
    head = next(line for line in out.splitlines() if "Original" in line)
    for name in ("Optimise", "By star", "By quad", "Angle-based", "Laplacian", "Smart Laplacian"):
        assert name in head
        assert f"{name}: 4 sweeps in" in out
    assert "By aspect ratio" not in head
    assert "By aspect ratio: skipped; method 'aspect-ratio' is for triangles" in out
    assert "--split-quads shorter cuts the quads in two" in out
    assert re.search(r"Mean of size ratios +\d", out)
    assert "* best of the row" in out
    assert mesh_file.read_bytes() == before


def test_compare_at_80_columns_takes_two_screens(call, mesh_file, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(mesh_file.parent)
    mesh_file = mesh_file.name
    code, out, _ = call("compare", mesh_file, "--sweeps", 2)
    assert code == 0
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 80
    assert "Cells by" not in out
    assert re.search(r": best or equal in \d+ of 13 figures; skipped: aspect-ratio$",
                     " ".join(lines))  # fmt: skip
    out = call("compare", mesh_file, "--methods", "star,quad", "--sweeps", 1, "--histograms")[1]
    assert "Cells by smallest angle" in out
    assert max(map(len, out.splitlines())) <= 80


def test_compare_takes_names_and_options(call, mesh_file, tmp_path):
    report = tmp_path / "report.json"
    code, out, _ = call(
        "compare", mesh_file, "--methods", "quad, laplacian,quad", "--sweeps", 3, "--step", 0.25,
        "--json", report,
    )  # fmt: skip
    assert code == 0
    assert "By star" not in out
    facts = json.loads(report.read_text())
    assert [m["method"] for m in facts["methods"]] == ["quad", "laplacian"]
    mesh = read_mesh(mesh_file)
    for found, options in zip(facts["methods"], [{"step": 0.25}, {}], strict=True):
        expected = smooth(mesh, found["method"], max_sweeps=3, **options)
        assert found["after"] == expected.after.to_dict()


def test_compare_on_triangles_has_the_extremes_of_each_method(call, tmp_path):
    path = tmp_path / "triangles.off"
    write_mesh(path, random_triangles(60))
    code, out, _ = call("compare", path)
    assert code == 0
    assert "skipped" not in out
    head = next(line for line in out.splitlines() if "Original" in line)
    assert "By aspect ratio" in head
    for label in ("Smallest angle", "Largest angle", "Largest aspect ratio"):
        (row,) = re.findall(rf"^{label}  .*$", out, re.MULTILINE)
        assert len(re.findall(r"[\d.]+", row)) == 8  # the original and seven methods
    assert out.count("no placement of this connectivity") == 2  # of the optimiser's result


def test_compare_hands_options_to_those_that_have_them(call, mesh_file, tmp_path):
    report = tmp_path / "report.json"
    code, _, _ = call(
        "compare", mesh_file, "--methods", "optimize,angle,aspect-ratio,star", "--sweeps", 20,
        "--no-worst", "--guard", "none", "--split-quads", "second", "--json", report,
    )  # fmt: skip
    assert code == 0
    facts = json.loads(report.read_text())
    assert facts["skipped"] == {}
    mesh = read_mesh(mesh_file)
    split = {"split_quads": "second"}
    own = [{"worst": False}, {"guard": "none", **split}, split, split]
    for found, options in zip(facts["methods"], own, strict=True):
        expected = smooth(mesh, found["method"], max_sweeps=20, **options)
        assert found["after"] == expected.after.to_dict()
        assert found["limits"] == limits(expected.mesh).to_dict()


def test_compare_says_in_json_what_was_skipped(call, mesh_file):
    facts = json.loads(call("compare", mesh_file, "--sweeps", 1, "--json", "-")[1])
    assert list(facts["skipped"]) == ["aspect-ratio"]
    assert len(facts["methods"]) == 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--methods", "star,quad", "--guard", "none"],
            "--guard must be 'quality' or 'clearance', got 'none'",
        ),
        (["--methods", "star", "--no-worst"], "method star has no option --worst"),
        (["--methods", "magic"], "--methods takes names out of optimize, angle,"),
        (["--methods", ","], "got none"),
        (["--methods", "star,laplacien"], "got laplacien; did you mean 'laplacian'?"),
        (["--methods", "laplacian", "--step", 0.5], "method laplacian has no option --step"),
        (["--sweeps", -1], "--sweeps must be"),
    ],
)
def test_compare_refuses(fails, mesh_file, arguments, message):
    assert message in fails("compare", mesh_file, *arguments)


def test_no_sweep_at_all(call, mesh_file):
    code, out, _ = call("compare", mesh_file, "--sweeps", 0)
    assert code == 0
    assert "no sweep was asked for" in out
