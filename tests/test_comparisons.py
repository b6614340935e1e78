"""Comparisons with other programs: how meshes are judged, how a quality is reached."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import growth
import paper
import peer_meshes
import time_to_quality
from apart import ask
from peer_meshes import Figures, make, measure
from peer_programs import SWEEPS, start_scipy
from peers import lines, ratios, summary
from qsmooth import Mesh, examples, quality, smooth
from qsmooth.paper.runs import METHODS
from time_to_quality import TOLERANCE, Calls, enough

BENCHMARKS = Path(peer_meshes.__file__).parent
PROGRAMS = ("peers", "growth", "paper", "publish")
GOOD = Figures(angle=50.0, worst=0.5, mean=0.8, shape=0.7, invalid=0)


@pytest.mark.parametrize("name", PROGRAMS)
def test_everything_imported_is_there(name):
    assert callable(runpy.run_path(str(BENCHMARKS / f"{name}.py"), run_name="imported")["main"])


@pytest.mark.parametrize("name", peer_meshes.MESHES)
def test_meshes_are_measured_as_by_the_package(name):
    points, cells = make(name, 100)
    found, own = measure(points, cells), quality(Mesh(points, cells)).summary()
    assert found.angle == pytest.approx(own.worst["min_angle"], rel=1e-9)
    assert found.worst == pytest.approx(own.worst["scaled_jacobian"], rel=1e-9)
    assert found.mean == pytest.approx(own.mean["scaled_jacobian"], rel=1e-9)
    assert found.shape == pytest.approx(own.mean["shape"], rel=1e-9)
    assert found.invalid == own.n_invalid


def test_the_hard_meshes_are_hard():
    assert measure(*make("notch", 400)).invalid == 0
    for name in ("tangled", "random", "fold"):
        assert measure(*make(name, 400)).invalid > 0


@pytest.mark.parametrize("name", ["lake", "triangles"])
def test_boundary_loops_go_round_the_mesh_once(name):
    points, cells = make(name, 100)
    loops = peer_meshes.boundary_loops(points, cells)
    on_loops = np.concatenate(loops)
    np.testing.assert_array_equal(
        np.sort(on_loops), np.flatnonzero(Mesh(points, cells).is_boundary)
    )
    assert on_loops.size == np.unique(on_loops).size
    first = points[loops[0]]
    assert (np.ptp(first, axis=0) == np.ptp(points, axis=0)).all()


def test_jacobi_sweeps_are_those_of_laplacian_smoothing():
    points, cells = make("square", 100)
    run, result = start_scipy(points.copy(), cells)
    run()
    own = smooth((points, cells), "laplacian", max_sweeps=SWEEPS["scipy"], rtol=0.0)
    np.testing.assert_allclose(result(), own.points, rtol=0, atol=1e-12)


@pytest.mark.parametrize("figure", ["worst", "mean", "shape"])
def test_a_mesh_is_as_good_in_every_figure(figure):
    just, under = 0.5 * TOLERANCE, 2.0 * TOLERANCE
    value = getattr(GOOD, figure)
    assert enough(GOOD._replace(**{figure: value - just}), GOOD)
    assert not enough(GOOD._replace(**{figure: value - under}), GOOD)


def test_where_the_other_is_invalid_any_valid_mesh_will_do():
    bad = GOOD._replace(invalid=3, worst=-1.0)
    assert enough(GOOD._replace(worst=0.01, mean=0.1), bad)
    assert not enough(bad, bad)
    assert not enough(bad, GOOD)


def test_the_fewest_sweeps_are_enough_and_one_less_is_not():
    points, cells = make("square", 100)
    calls = Calls(points, cells)
    wanted = measure(smooth((points, cells), "star", max_sweeps=11, rtol=0.0).points, cells)
    sweeps = calls.fewest("star", wanted, 60.0)
    assert enough(calls.with_sweeps("star", sweeps).figures, wanted)
    assert not enough(calls.with_sweeps("star", sweeps - 1).figures, wanted)
    reached = calls.quickest(wanted, 60.0)
    assert enough(reached.figures, wanted)
    assert reached.method in time_to_quality.METHODS


def test_what_no_method_reaches_is_not_reached():
    calls = Calls(*make("lake", 100))
    best = calls.with_sweeps("optimize", 10).figures
    assert calls.quickest(best._replace(worst=1.5), 0.0) is None


def test_a_process_answers_or_there_is_a_reason(tmp_path):
    question = {"task": "make", "name": "square", "size": 64, "folder": str(tmp_path)}
    made, why = ask("peer_runs.py", question, limit=120.0)
    assert (made["cells"], why) == (64, "")
    question = {"task": "program", "program": "scipy", "folder": str(tmp_path), "repeat": 1}
    done, why = ask("peer_runs.py", question, limit=120.0)
    assert done["holds_boundary"]
    assert Figures(*done["figures"]).worst > Figures(*made["figures"]).worst
    nothing, why = ask("peer_runs.py", {**question, "program": "none"}, limit=120.0)
    assert nothing is None
    assert "none" in why
    nothing, why = ask("peer_runs.py", question, limit=0.01)
    assert nothing is None
    assert why == "over 0.01 s"


def test_the_table_has_every_outcome():
    quality_ = list(GOOD)
    ran = {"seconds": 3.0, "runs": 3, "figures": quality_, "holds_boundary": True}
    reached = {"method": "star", "sweeps": 7, "seconds": 0.5, "figures": quality_}
    others = {
        "mfem": {**ran, "reached": reached, "ratio": 6.0},
        "vtk": {**ran, "reached": None, "holds_boundary": False},
        "scipy": ran,
        "gmsh-relocate": {"why": "not installed"},
    }
    own = {"seconds": 1.0, "sweeps": 90, "figures": quality_, "reached": {}}
    found = {
        "meshes": {"square": {"cells": 64, "figures": quality_, "qsmooth": own, "peers": others}},
        "programs": {"mfem": "4.8", "vtk": "9.5", "scipy": "1.16", "gmsh-relocate": None},
        "machine": dict.fromkeys(
            ("processor", "cores", "system", "python", "numpy", "numba", "qsmooth", "load"), "?"
        ),
    }
    given, end, mfem, vtk, scipy, gmsh = lines(found)
    assert {len(row) for row in lines(found)} == {11}
    assert given[1] == "(given)"
    assert end[9] == "optimize, 90 sweeps"
    assert mfem[8:] == ["500 ms", "star, 7 sweeps", "6"]
    assert vtk[1] == "vtk, moved the boundary"
    assert vtk[9] == "not reached"
    assert scipy[9] == "was valid as given"
    assert gmsh[2] == "not installed"
    assert ratios(found) == {"mfem": {"square": 6.0}}
    assert "geometric mean 6" in summary(found)
    assert "gmsh-relocate: not installed" in summary(found)


def test_growth_measures_a_whole_call(monkeypatch, tmp_path):
    pytest.importorskip("resource")
    monkeypatch.setattr(growth, "SIZES", (400,))
    monkeypatch.setattr(growth, "BUMPS", (100,))
    found = growth.run(say=lambda *words, flush: None)
    star, optimize, bump = found["rows"]
    assert [row["quads"] for row in found["rows"]] == [400, 400, 100]
    assert (star["sweeps"], star["stop"]) == (10, "max_sweeps")
    assert optimize["stop"] == bump["stop"] == "settled"
    for row in found["rows"]:
        assert row["worst"][1] > row["worst"][0]
        assert row["bytes"]["peak"] >= row["bytes"]["given"] >= row["bytes"]["base"] > 0
        assert len(growth.line(row)) == len(growth.HEAD)
    assert len(growth.line({"work": "star", "quads": 9, "why": "over 1 s"})) == len(growth.HEAD)


def test_the_peak_of_memory_is_in_bytes():
    pytest.importorskip("resource")
    held = np.ones(40_000_000)
    assert held.nbytes < growth.peak() < 1000 * held.nbytes


def test_the_table_of_the_paper_has_its_figures():
    found = paper.run(sweeps=2, repeats=1, sizes=(200, 1000))
    given, *methods = found["rows"][:4]
    assert [row["method"] for row in methods] == list(METHODS)
    summary = quality(examples.spiral(200)).summary()
    assert given["aspect_ratio"] == summary.worst["aspect_ratio"]
    assert given["mean_aspect_ratio"] == summary.mean["aspect_ratio"]
    rows = paper.lines(found)
    assert {len(row) for row in rows} == {len(paper.HEAD)}
    by_quad = next(row for row in rows if row[0].startswith("spiral") and row[1] == "quad")
    assert by_quad[3::2] == ["3.6", "10.1", "1.91", "155.0°", "18.8°"]
