"""Each script of `examples/` runs as it stands, and does what its first lines say."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import qsmooth
from qsmooth import quality, read_mesh
from qsmooth.examples import around_body

SCRIPTS = sorted((Path(__file__).resolve().parent.parent / "examples").glob("*.py"))


def smooth_file(said, folder):
    old, new = (read_mesh(folder / name) for name in ("lake.msh", "lake-smoothed.msh"))
    before, after = quality(old).summary(), quality(new).summary()
    assert after.worst["min_angle"] > before.worst["min_angle"] + 10.0
    assert after.mean["shape"] > before.mean["shape"]
    assert f"mean shape: {before.mean['shape']:.3f} -> {after.mean['shape']:.3f}" in said
    assert np.array_equal(old.cells[0], new.cells[0])
    n_moved = int((old.points != new.points).any(axis=1).sum())
    assert f"{n_moved} of " in said


def moving_boundary(said, folder):
    rows = re.findall(r"^ .*° +(\d+), (\d+)$", said, re.MULTILINE)
    assert len(rows) == 12
    assert all(n_invalid == "0" for n_invalid, _ in rows)
    assert int(rows[-1][1]) > 0  # what would be folded if nothing were smoothed
    mesh = read_mesh(folder / "channel.vtk")
    assert quality(mesh).n_invalid == 0
    assert mesh.points[:, 1].min() >= 0.0
    assert mesh.points[20, 1] == pytest.approx(0.6)


def turning_body(said, folder):
    rows = re.findall(r"^ +\d+ +([\d.]+)° +([\d.]+) +(yes|no) +(\d+)", said, re.MULTILINE)
    assert len(rows) == 10
    assert float(rows[-1][0]) == 45.0
    summary = re.search(
        r"200 steps: .* valid in all of them: True, .* ([\d.]+)$", said, re.MULTILINE
    )
    assert float(summary[1]) > 0.7
    assert all(0 < int(sweeps) <= 4 for *_, sweeps in rows)
    smoothed = float(re.search(r"to the end: smallest scaled Jacobian ([\d.]+)", said)[1])
    assert smoothed >= float(rows[-1][1])
    mesh = read_mesh(folder / "body.vtk")
    assert quality(mesh).n_invalid == 0
    assert mesh.n_vertices == around_body(45).n_vertices


def distributed_body(said, folder):
    rows = re.findall(r"^ +\d+ +([\d.]+)° +([\d.]+) +yes$", said, re.MULTILINE)
    assert len(rows) == 5
    assert float(rows[-1][0]) == 22.5
    summary = re.search(
        r"50 steps: .* valid in all of them: True, .* ([\d.]+)$", said, re.MULTILINE
    )
    assert float(summary[1]) > 0.8
    mesh = read_mesh(folder / "body.vtk")
    assert quality(mesh).n_invalid == 0
    assert mesh.n_vertices == around_body(45).n_vertices


def worst_cells_only(said, folder):
    with (folder / "methods.csv").open(encoding="utf-8") as file:
        rows = {row["method"]: row for row in csv.DictReader(file)}
    n_bad, n_cells = map(int, re.match(r"(\d+) of (\d+) cells", said).groups())
    for method, row in rows.items():
        assert int(row["cells over 160°"]) < n_bad, method
        assert 0 < int(row["vertices moved"]) < n_cells / 2, method
    guarded = set(rows) - {"laplacian"}
    assert all(rows[method]["invalid cells"] == "0" for method in guarded)
    assert re.search(r"best is ([\w-]+)$", said.strip())[1] in rows


def quality_gate(said, folder):
    report = json.loads((folder / "gate.json").read_text(encoding="utf-8"))
    assert [entry["verdict"].split(":")[0] for entry in report.values()] == [
        "passed", "mended", "refused",
    ]  # fmt: skip
    assert "refused: no less than 164.1° can be had at vertex" in said
    mended = quality(read_mesh(folder / "folded.off"))
    assert mended.n_invalid == 0
    assert mended.min_angle.min() >= 25.0
    assert not (folder / "notched.off").exists()


def metric_field(said, folder):
    for kind, least in (("quads", 0.88), ("triangles", 0.76)):
        own = said[said.index(f"{kind}:") :]
        before, after = map(float, re.search(r"metric ([\d.]+) -> ([\d.]+)", own).groups())
        assert after > max(least, before + 0.2)
        rows = re.findall(r"(\d+) cells on the shock, .* width ([\d.]+) of", own)[:2]
        assert int(rows[1][0]) > 4 * int(rows[0][0])
        assert float(rows[1][1]) == pytest.approx(1.0, abs=0.2)
        mesh = quality(read_mesh(folder / f"shock-{kind}.vtk"))
        assert mesh.n_invalid == 0
        assert mesh.aspect_ratio.max() > 30.0


def hold_and_target(said, folder):
    rows = re.findall(
        r"^(.+): angles ([\d.]+)° to ([\d.]+)°, largest aspect ratio ([\d.]+), .* x ([\d.]+)$",
        said,
        re.MULTILINE,
    )
    runs = {name: tuple(map(float, figures)) for name, *figures in rows}
    free, held = runs["bump, as it comes"], runs["bump, held"]
    assert free[0] > held[0] + 20.0 > 28.0  # of 8.4 degrees
    assert 19.0 < held[2] < 20.0 < free[2]
    assert "aspect_ratio, held at 19.92, stopped" in said
    assert "given up: aspect_ratio 19.92 -> " in said
    assert runs["layer, as it comes"][3] == pytest.approx(1.0, abs=0.05)
    assert runs["layer, squares"][3] > 100.0
    for path in folder.glob("*.vtk"):
        assert quality(read_mesh(path)).n_invalid == 0


def poisson(said, folder):
    pattern = r"^(as it came|smoothed): " + ", ".join(
        rf"{name} (\S+)"
        for name in ("condition number", "iterations", "error of values", "error of slopes")
    )
    rows = {name: list(map(float, rest)) for name, *rest in re.findall(pattern, said, re.MULTILINE)}
    before, after = rows["as it came"], rows["smoothed"]
    assert after[0] < before[0] / 3
    assert after[1] < 0.75 * before[1]
    assert all(new < 0.9 * old for old, new in zip(before[2:], after[2:], strict=True))
    assert (folder / "poisson.png").stat().st_size > 10_000


def shallow_water(said, folder):
    pattern = r"^ +[\d.]+ +([\d.]+) to ([\d.]+) +([\d.]+)° +([\d.]+)$"
    rows = re.findall(pattern, said, re.MULTILINE)
    assert len(rows) == 8
    low, high, angle, volume = np.array(rows, float).T
    assert np.ptp(low) > 0.3
    assert np.ptp(high) > 0.3  # the shore goes up and down
    assert angle.min() > 30.0
    np.testing.assert_allclose(volume, volume[0], rtol=1e-9)
    assert abs(float(re.search(r"volume changed by (\S+) of itself", said)[1])) < 1e-12
    mesh = read_mesh(folder / "beach.vtk", surface="flat")
    assert quality(mesh).n_invalid == 0
    assert mesh.points[:, 2].max() > -0.1


CHECKS = {
    "hold_and_target": (hold_and_target, 0),
    "distributed_body": (distributed_body, 0),
    "metric_field": (metric_field, 0),
    "moving_boundary": (moving_boundary, 0),
    "poisson": (poisson, 0),
    "quality_gate": (quality_gate, 1),  # one mesh is refused
    "shallow_water": (shallow_water, 0),
    "smooth_file": (smooth_file, 0),
    "turning_body": (turning_body, 0),
    "worst_cells_only": (worst_cells_only, 0),
}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_script(script, tmp_path):
    if script.stem == "poisson":
        pytest.importorskip("skfem")
    if script.stem == "distributed_body" and not os.environ.get("QSMOOTH_REQUIRE_MPI"):
        pytest.importorskip("mpi4py")
    check, code = CHECKS[script.stem]  # a script without a check is not tested: give it one
    folder = tmp_path / "out"
    folder.mkdir()
    done = subprocess.run(
        [sys.executable, "-W", "error", "-X", "utf8", str(script), str(folder)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(qsmooth.__file__).resolve().parent.parent)},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    said = done.stderr.replace("compiling, first time only\n", "")
    assert (done.returncode, said) == (code, "")
    check(done.stdout, folder)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]  # nothing beside the folder given


def test_there_are_scripts():
    assert {script.stem for script in SCRIPTS} == set(CHECKS)
