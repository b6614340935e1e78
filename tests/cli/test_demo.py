"""``qsmooth demo``."""

import re
import sys

import pytest

from qsmooth import quality, read_mesh


def test_demo_needs_no_file(call, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    code, out, err = call("demo", "--sweeps", 2)
    assert (code, err) == (0, "")
    folder = tmp_path / "qsmooth-demo"
    assert "Spiral: 1899 quads" in out
    assert "Smart Laplacian" in out
    assert "Wrote 22 figures, as PNG and SVG, into qsmooth-demo" in out
    assert quality(read_mesh(folder / "spiral-optimize.off")).n_invalid == 0
    assert read_mesh(folder / "spiral.off").n_cells == 1899
    assert (folder / "comparison-whole.png").exists()


def test_demo_without_matplotlib(call, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    folder = tmp_path / "there"
    code, out, err = call("demo", "--sweeps", 1, "-o", folder)
    assert code == 0
    assert "Smart Laplacian" in out
    assert err.startswith("qsmooth: warning: no figures: ")
    assert sorted(path.name for path in folder.iterdir()) == ["spiral-optimize.off", "spiral.off"]


def test_demo_of_the_lake(call, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    from qsmooth.examples import lake

    monkeypatch.setattr("qsmooth.examples.lake", lambda: lake(1000))
    code, out, _ = call("demo", "--mesh", "lake", "--sweeps", 1, "-o", tmp_path)
    assert code == 0
    assert re.search(r"^Lake: \d+ quads", out)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["lake-optimize.off", "lake.off"]


def test_demo_refuses_a_file_for_a_folder(fails, mesh_file):
    assert "is a file" in fails("demo", "-o", mesh_file)
