"""Reports: what stands in the file is what was measured, and what holds a cell is true."""

import re

import numpy as np
import pytest

import meshes
import qsmooth
from qsmooth import Laplacian, Mesh, Star, compare, limits, quality, smooth
from qsmooth.examples import spiral
from qsmooth.metrics import METRICS
from qsmooth.output.report.holding import Holding
from qsmooth.output.report.packing import Packed, rounded
from qsmooth.output.report.states import states_of
from report_files import read_report, state_arrays

pytestmark = pytest.mark.nojit

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def rough(kind="quads", **more):
    return meshes.random_mesh(kind, 4, seed=3, **more).mesh


def why(result, metric, cell=None):
    """What holds the worst cell, or another, of a result."""
    before, after = states_of([result])
    if cell is None:
        cell = int(METRICS[metric].worst_cells(after.quality[metric], 1)[0])
    return Holding(after, before).why(cell, metric)


@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_the_file_holds_what_was_measured(tmp_path, kind):
    mesh = rough(kind, scale=500.0, shift=(6e6, -6.1e6))
    result = smooth(mesh, "star", max_sweeps=2)
    facts, arrays = read_report(qsmooth.report(result, tmp_path / "r.html", title="<a> & b"))
    assert facts["title"] == "<a> & b"
    assert [state["name"] for state in facts["states"]] == ["before", "star"]
    for k, (at, measured) in enumerate(
        [(mesh, result.quality_before), (result.mesh, result.quality_after)]
    ):
        xy, figures = state_arrays(facts, arrays, k)
        assert np.abs(xy - at.xy).max() <= 1e-7 * facts["scale"]
        for name in ("min_angle", "max_angle", "aspect_ratio", "shape", "size_jump"):
            np.testing.assert_allclose(figures[name], measured[name], rtol=1e-5)
        np.testing.assert_allclose(figures["area"], measured.area, rtol=1e-5)
        expected = [result.before, result.after][k].to_dict()
        assert facts["states"][k]["summary"] == expected
    cells = facts["cells"]
    shown = [arrays[cells["triangles"]].reshape(-1, 3), arrays[cells["quads"]].reshape(-1, 4)]
    order = np.arange(mesh.n_cells) if cells["ids"] is None else arrays[cells["ids"]]
    for corners, c in zip([*shown[0], *shown[1]], order, strict=True):
        first, last = mesh.cell_offsets[c : c + 2]
        assert corners.tolist() == mesh.cell_vertices[first:last].tolist()
    assert (arrays[facts["fixed"]] == mesh.is_fixed).all()
    assert facts["states"][1]["history"]["rows"]["min_angle"] == pytest.approx(
        result.history["min_angle"].tolist()
    )


def test_one_page_that_asks_for_nothing(tmp_path):
    result = smooth(rough(), "star", max_sweeps=1)
    path = qsmooth.report(result, tmp_path / "r.html", title="</script><script>alert(1)")
    text = path.read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "&lt;/script&gt;" in text
    links = re.findall(r"""(?:src|href)\s*=\s*["']?(?!data:|#)([^"'\s>]+)""", text)
    assert links == []
    assert not re.search(r"(?:url\(|@import|fetch\(|XMLHttpRequest)", text)
    assert not re.search(r"/\*(STYLE|SCRIPT|DATA)\*/|<!--(TITLE|ARRAYS)-->", text)
    again = qsmooth.report(result, tmp_path / "again.html", title="</script><script>alert(1)")
    assert again.read_bytes() == path.read_bytes()


def test_table_and_worst_cells_are_those_of_the_tables(tmp_path):
    mesh = rough()
    found = compare(mesh, ["star", Star(step=0.2), "laplacian"], max_sweeps=2)
    facts, _ = read_report(qsmooth.report(found, tmp_path / "r.html", metrics="min_angle,taper"))
    labels = ["Before", "By star", "By star (2)", "Laplacian"]
    assert [state["label"] for state in facts["states"]] == labels
    assert facts["table"]["columns"] == ["", *labels]
    rows = {row[0]: row[1:] for row in facts["table"]["rows"]}
    results = list(found[0].values())
    assert rows["Smallest angle"][1:] == [f"{r.after.worst['min_angle']:.2f}°" for r in results]
    assert rows["Sweeps"] == ["", *(str(r.sweeps) for r in results)]
    names = [metric["name"] for metric in facts["metrics"]]
    assert names == ["min_angle", "taper", "area", "area_change"]
    worst = [w for w in facts["states"][1]["worst"] if w["metric"] == "max_angle"]
    expected = results[0].quality_after.worst(10, "max_angle")
    assert [w["cell"] for w in worst] == expected.cells.tolist()
    assert [w["values"]["max_angle"] for w in worst] == expected.values["max_angle"].tolist()
    assert all(w["why"] for w in worst)


def test_several_results_have_to_start_alike(tmp_path):
    one, other = (smooth(rough(turn=t), "star", max_sweeps=1) for t in (0.0, 1.0))
    for wrong in ([one, other], [one, smooth(rough("triangles"), "star", max_sweeps=1)]):
        with pytest.raises(ValueError, match="started from the same mesh"):
            qsmooth.report(wrong, tmp_path / "r.html")
    with pytest.raises(ValueError, match="at least one result"):
        qsmooth.report([], tmp_path / "r.html")
    with pytest.raises(ValueError, match="metrics must be one of"):
        qsmooth.report(one, tmp_path / "r.html", metrics="magic")
    with pytest.raises(qsmooth.MeshError, match="cannot write"):
        qsmooth.report(one, tmp_path / "none" / "r.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("points", "cells"),
    [
        (SQUARE, [(0, 1, 2, 3)]),
        (SQUARE[:3], [(0, 1, 2)]),
        ([*SQUARE, (2, 0.5), (9, 9)], [[(0, 1, 2, 3)], [(1, 4, 2)]]),
        ([(0, 0), (1, 0), (0.1, 0.1), (0, 1)], [(0, 1, 2, 3)]),
        ([(0, 0), (1, 1), (1, 0), (0, 1)], [(0, 1, 2, 3)]),
        ([(0, 0), (1, 0), (1, 0), (0, 1)], [(0, 1, 2, 3)]),
        ([(0, 0), (1e70, 0), (1e70, 1), (0, 1e-9)], [(0, 1, 2, 3)]),
    ],
)
def test_odd_meshes(tmp_path, points, cells):
    mesh = Mesh(points, cells)
    for what in (mesh, smooth(mesh), smooth(mesh, "laplacian")):
        facts, arrays = read_report(qsmooth.report(what, tmp_path / "r.html"))
        assert facts["n_cells"] == mesh.n_cells
        for state in facts["states"]:
            assert arrays[state["invalid"]].sum() == state["n_invalid"]
            assert all(w["why"] for w in state["worst"])
            assert any("all its vertices stay" in w["why"] for w in state["worst"])
        xy, _ = state_arrays(facts, arrays, 0)
        used = mesh.topology.used
        assert np.abs(xy - mesh.xy)[used].max() <= 1e-7 * facts["scale"]


def test_geographic_and_tilted_meshes_are_drawn_in_their_plane(tmp_path):
    points, cells = meshes.rough_grid(4)
    for mesh in (
        Mesh(meshes.tilt(points), cells),
        Mesh(0.01 * points + (10.0, 50.0), cells, geographic=True),
    ):
        result = smooth(mesh, "star", max_sweeps=2)
        facts, arrays = read_report(qsmooth.report(result, tmp_path / "r.html"))
        for k, at in enumerate((mesh, result.mesh)):
            xy, _ = state_arrays(facts, arrays, k)
            assert np.abs(xy - at.xy).max() <= 1e-7 * facts["scale"]


def test_a_corner_between_edges_that_stay_is_named():
    points, cells = meshes.rough_grid(3)
    points[0] = (-1.0, -1.0)  # 37 degrees, between boundary edges
    result = smooth(Mesh(points, cells), "star", max_sweeps=3)
    words, vertex = why(result, "min_angle", 0)
    assert (words, vertex) == ("its corner at vertex 0 lies between two edges that stay", 0)


def test_a_limit_that_is_reached_is_named():
    # Three cells about one vertex in the middle of a hexagon of radius 1: 120 degrees each.
    points, cells = meshes.fan(3)
    points = points.copy()
    points[0] += (0.1, 0.05)
    result = smooth(Mesh(points, cells))
    worst = int(result.quality_after.max_angle.argmax())
    words, vertex = why(result, "max_angle", worst)
    assert vertex == 0
    bound = limits(result.mesh)
    assert f"has {bound.max_angle:.2f}° at least in any placement" in words
    reached = bound.reached_max_angle - bound.max_angle <= 0.05
    assert ("this limit is reached" in words) == reached


def test_what_holds_a_cell_by_the_users_own_choice():
    mesh = rough()
    fixed = np.ones(mesh.n_vertices, np.bool_)
    fixed[np.flatnonzero(~mesh.is_boundary)[0]] = False
    result = smooth(mesh, "star", fixed=fixed, max_sweeps=2)
    cell = next(
        c
        for c in range(mesh.n_cells)
        if fixed[mesh.cell_vertices[mesh.cell_offsets[c] : mesh.cell_offsets[c + 1]]].all()
        and not mesh.is_boundary[mesh.cell_vertices[mesh.cell_offsets[c] :][:4]].all()
    )
    words, vertex = why(result, "aspect_ratio", cell)
    assert "all its vertices stay" in words
    assert "vertices given as fixed" in words
    assert vertex is None
    near = smooth(mesh, "laplacian", max_move=1e-3, max_sweeps=5)
    said = " ".join(why(near, "shape", c)[0] for c in range(mesh.n_cells))
    assert "moved as far as allowed" in said
    assert "nothing proven" in why(smooth(mesh, "star", max_sweeps=1), "shape", 5)[0]


def test_promises_say_what_was_found(tmp_path):
    mesh = rough()
    facts, _ = read_report(
        qsmooth.report(smooth(mesh, Laplacian(max_sweeps=2)), tmp_path / "r.html")
    )
    assert any("nothing is promised" in s.lower() for s in facts["states"][1]["promised"])
    facts, _ = read_report(
        qsmooth.report(smooth(spiral(200, seed=1), max_sweeps=10), tmp_path / "r.html")
    )
    said = facts["states"][1]["promised"]
    assert any("none of" in s and "became invalid" in s for s in said)
    assert any("Smallest angle gets no worse" in s for s in said)


def test_rounding_keeps_what_is_not_finite_and_sixteen_bits():
    values = np.array([np.inf, -np.inf, np.nan, 0.0, -0.0, 153.2123, 1e30, 89.99], np.float32)
    found = rounded(values)
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(values))
    np.testing.assert_allclose(found, values, rtol=2.0**-17)
    assert (found[3:].view(np.uint32) & 0x7F == 0).all()


def test_a_million_quads_would_fit():
    """A fiftieth of them, with figures at random, takes a fiftieth of the room at most."""
    n = 20_000
    rng = np.random.default_rng(0)
    packed = Packed()
    ids = np.arange(n)[:, None] + np.array([0, 1, 150, 149])
    packed.ids(ids)
    for _ in range(2):
        packed.places(rng.uniform(-1.0, 1.0, (n, 2)))
        for _ in range(7):
            packed.figures(rng.uniform(0.0, 90.0, n))
    packed.figures(rng.uniform(0.5, 2.0, n))
    packed.marks(np.zeros(n))
    assert sum(map(len, packed.texts)) < 80e6 / 50


def test_a_mesh_alone(tmp_path):
    mesh = rough("mixed")
    facts, _ = read_report(qsmooth.report(mesh, tmp_path / "r.html"))
    assert [state["name"] for state in facts["states"]] == ["mesh"]
    assert facts["usual"] == 0
    assert facts["states"][0]["n_invalid"] == quality(mesh).n_invalid


def test_a_mesh_of_a_file_is_titled_by_it(tmp_path):
    qsmooth.write_mesh(tmp_path / "pond & <sea>.off", rough())
    mesh = qsmooth.read_mesh(tmp_path / "pond & <sea>.off")
    facts, _ = read_report(qsmooth.report(smooth(mesh, "star", max_sweeps=1), tmp_path / "r.html"))
    assert facts["title"] == "pond & <sea>.off"
