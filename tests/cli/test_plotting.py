"""``--plot`` and ``--with-quality``."""

import numpy as np
import pytest

from qsmooth import quality, read_mesh


@pytest.mark.parametrize("command", [["quality"], ["compare", "--methods", "laplacian,star"]])
def test_figures_of_commands(call, mesh_file, tmp_path, command):
    pytest.importorskip("matplotlib")
    folder = tmp_path / "figures"
    flags = ["--sweeps", 2] if command[0] == "compare" else ["--plot-scale", "quantiles"]
    code, out, _ = call(command[0], mesh_file, *command[1:], *flags, "--plot", folder)
    assert code == 0
    assert out.rstrip().endswith(f"Wrote {folder}")
    assert len(list(folder.iterdir())) == 6


@pytest.mark.parametrize(
    "flags",
    [["--plot-metric", "shape"], ["--plot-scale", "quantiles"], ["--plot-log"]],
    ids=lambda flags: flags[0],
)
def test_looks_of_figures_that_are_not_drawn(fails, mesh_file, flags):
    message = fails("quality", mesh_file, *flags)
    assert f"{flags[0]} is of figures" in message
    assert "add --plot FOLDER" in message


def test_histograms_with_a_logarithmic_axis(call, mesh_file, tmp_path):
    pytest.importorskip("matplotlib")
    plain, log = tmp_path / "plain", tmp_path / "log"
    assert call("quality", mesh_file, "--plot", plain)[0] == 0
    assert call("quality", mesh_file, "--plot", log, "--plot-log")[0] == 0
    for name, same in (("histograms.svg", False), ("mesh.svg", True)):
        assert ((plain / name).read_bytes() == (log / name).read_bytes()) == same


def test_every_metric_in_a_file(call, fails, mesh_file, tmp_path):
    out_file = tmp_path / "out.vtu"
    assert call("convert", mesh_file, out_file, "--with-quality")[0] == 0
    mesh = read_mesh(out_file)
    data = mesh.source.cell_data
    assert np.array_equal(np.concatenate(data["max_angle"]), quality(mesh).max_angle)
    assert "validity" in data
    message = fails("convert", mesh_file, tmp_path / "out.su2", "--with-quality")
    assert "format su2" in message
    assert "holds no cell data; vtu and vtk do" in message
