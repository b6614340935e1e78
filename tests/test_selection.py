"""Selections, the worst group first, larger steps for bad cells, and what auto picks."""

import math

import numpy as np
import pytest

import reference
from meshes import KINDS, grid, random_mesh
from qsmooth import Mesh, quality, smooth
from qsmooth.selection import parse_threshold, select_cells, vertices_of

METHODS = ["star", "quad", "angle", "smart-laplacian", "laplacian"]


@pytest.fixture
def mesh():
    return random_mesh("quads", 8, seed=3, amount=0.9).mesh


# ------------------------------------------------------------------------------- selections


@pytest.mark.nojit
def test_cells_by_id_by_mask_and_by_threshold(mesh):
    largest = quality(mesh).max_angle
    ids = np.flatnonzero(largest > 150.0)
    assert 0 < len(ids) < mesh.n_cells
    for selection in (ids, ids.tolist(), largest > 150.0, "max_angle > 150", " max_angle>1.5e2 "):
        assert np.flatnonzero(select_cells(mesh, selection)).tolist() == ids.tolist()
    assert not select_cells(mesh, []).any()
    assert select_cells(mesh, "scaled_jacobian <= 1").all()
    assert not select_cells(mesh, "aspect_ratio < 1").any()
    assert select_cells(mesh, "min_angle >= 0").all()


@pytest.mark.nojit
def test_a_selection_grows_by_the_cells_that_touch_it():
    mesh = Mesh(*grid(7, 7))
    for rings, side in ((0, 1), (1, 3), (2, 5), (3, 7), (9, 7)):
        marked = select_cells(mesh, [24], rings).reshape(7, 7)
        low, high = 3 - side // 2, 4 + side // 2
        assert marked.sum() == side * side
        assert marked[low:high, low:high].all()
    assert vertices_of(mesh, select_cells(mesh, [24])).sum() == 4


@pytest.mark.nojit
@pytest.mark.parametrize("text", ["", "max_angle", "max_angle = 3", "area > 1", "shape > x", "> 3"])
def test_thresholds_that_are_none(text):
    with pytest.raises(ValueError, match="a threshold such as 'max_angle > 150'"):
        parse_threshold(text)


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("selection", "message"),
    [
        ([0, 72, -1], "2 cell ids in selection are outside 0 .. 71, the first is 72"),
        ([0, 72], "1 cell id in selection is outside 0 .. 71, the first is 72"),
        ([0.5], "must be cell ids"),
        ([[1, 2]], "must be cell ids"),
        (np.ones(3, bool), r"mask must have the shape \(72,\)"),
    ],
)
def test_selections_that_do_not_fit(mesh, selection, message):
    with pytest.raises(ValueError, match=message):
        smooth(mesh, "star", selection=selection)


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_only_the_vertices_of_selected_cells_move(mesh, method):
    chosen = vertices_of(mesh, select_cells(mesh, [30, 31], 1))
    result = smooth(mesh, method, selection=[30, 31], selection_rings=1, max_sweeps=5)
    moved = (result.points != mesh.points).any(axis=1)
    assert moved.any()
    assert not moved[~chosen].any()
    assert moved[chosen & ~mesh.is_fixed].all()
    if method != "laplacian":
        worst = result.after.worst["scaled_jacobian"]
        assert worst >= result.before.worst["scaled_jacobian"]


@pytest.mark.nojit
def test_all_cells_selected_is_no_selection(mesh):
    all_of_them = smooth(mesh, "star", selection="max_angle > 0", max_sweeps=5)
    assert all_of_them.points.tobytes() == smooth(mesh, "star", max_sweeps=5).points.tobytes()


@pytest.mark.nojit
def test_a_selection_of_nothing_rests(mesh):
    result = smooth(mesh, "star", selection=[])
    assert result.converged
    assert result.sweeps == 0
    assert "all selected are on the boundary or fixed" in result.reason
    assert result.points.tobytes() == mesh.points.tobytes()


@pytest.mark.nojit
def test_a_selection_of_quads_that_are_cut(mesh):
    chosen = vertices_of(mesh, select_cells(mesh, "max_angle > 150"))
    result = smooth(mesh, "angle", selection="max_angle > 150", split_quads=True, max_sweeps=4)
    moved = (result.points != mesh.points).any(axis=1)
    assert moved.any()
    assert not moved[~chosen].any()


@pytest.mark.nojit
@pytest.mark.parametrize("rings", [-1, 1.5, True])
def test_rings_are_a_count(mesh, rings):
    with pytest.raises(ValueError, match="selection_rings must be an integer of 0 or more"):
        smooth(mesh, "star", selection=[0], selection_rings=rings)


# ------------------------------------------------------------------------------- worst first


def groups(points, cells, fraction):
    worst = reference.worst_cells(points, cells, fraction)
    return {"worst": worst, "rest": set(range(len(cells))) - worst, "all": None}


@pytest.mark.parametrize("method", ["star", "quad"])
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_the_worst_group_goes_first_then_the_rest_then_all(kind, method):
    mesh = random_mesh(kind, 6, seed=4, amount=0.9).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    good = max(0.5, min(reference.scaled_jacobian(points, cell) for cell in cells))
    sweep = reference.star_sweep if method == "star" else reference.quad_sweep
    for group in ("worst", "rest", "all", "all"):
        active = groups(points, cells, 0.25)[group]
        points = sweep(points, cells, order, reference.Options(good=good, active=active, step=0.25))
    result = smooth(mesh, method, worst_fraction=0.25, worst_first=True, max_sweeps=4, rtol=0.0)
    assert result.sweeps == 4
    expected = [(z.real, z.imag) for z in points]
    np.testing.assert_allclose(result.mesh.xy, expected, rtol=0, atol=1e-10)


def test_each_group_ends_when_it_rests(mesh):
    result = smooth(mesh, "star", worst_fraction=0.1, worst_first=True, max_sweeps=3000)
    assert result.converged
    assert result.sweeps < 3000


@pytest.mark.nojit
def test_worst_first_needs_a_worst_group(mesh):
    with pytest.raises(ValueError, match="worst_first needs a worst_fraction below 1"):
        smooth(mesh, "star", worst_first=True)
    with pytest.raises(ValueError, match="method 'angle' has no option worst_f"):
        smooth(mesh, "angle", worst_fraction=0.5, worst_first=True)


# ------------------------------------------------------------------------------- larger steps


@pytest.mark.nojit
@pytest.mark.parametrize("method", ["star", "quad"])
def test_bad_cells_move_by_their_own_step(method):
    # Two squares by two with the centre off: every cell is past 1° and none past 359°.
    points, cells = grid(2, 2)
    points[4] = (1.0, 1.25)
    at = {}
    for angle in (1.0, 359.0):
        result = smooth(
            Mesh(points, cells), method, step=0.25, bad_step=0.75, bad_angle=angle, max_sweeps=1
        )
        at[angle] = result.points[4]
    for angle, step in ((1.0, 0.75), (359.0, 0.25)):
        plain = smooth(Mesh(points, cells), method, step=step, max_sweeps=1).points[4]
        assert at[angle] == pytest.approx(plain, abs=1e-14)
    assert at[1.0] != pytest.approx(at[359.0])


@pytest.mark.parametrize("method", ["star", "quad"])
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_larger_steps_keep_every_promise(kind, method):
    mesh = random_mesh(kind, 6, seed=9, amount=1.0).mesh
    result = smooth(mesh, method, bad_angle=110.0, bad_step=2.0, rtol=0.0, max_sweeps=15)
    assert all(record.n_invalid == 0 for record in result.history)
    assert result.after.worst["scaled_jacobian"] >= result.before.worst["scaled_jacobian"]


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bad_step": 0.0}, r"bad_step must be in \(0, 2\], got 0.0"),
        ({"bad_step": 2.5}, r"bad_step must be in \(0, 2\], got 2.5"),
        ({"bad_angle": 360.0}, r"bad_angle must be in \(0, 360\) degrees"),
        ({"max_edge_ratio": 0.5}, "max_edge_ratio must be 1 or more"),
        ({"weights": "volume"}, "weights must be 'uniform' or 'area'"),
        ({"guard": "some"}, "guard must be 'quality' or 'clearance', got 'some'"),
    ],
)
def test_options_out_of_range(mesh, options, message):
    with pytest.raises(ValueError, match=message):
        smooth(mesh, "star", **options)


# ------------------------------------------------------------------------------- auto


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "mixed", "triangles"])
def test_auto_is_the_default_and_says_what_it_chose(kind):
    mesh = random_mesh(kind, 4, seed=1).mesh
    result = smooth(mesh, max_sweeps=2)
    assert result.method == "optimize"
    assert result.reason.startswith("auto chose optimize; ")
    named = smooth(mesh, "optimize", max_sweeps=2)
    assert "auto" not in named.reason
    assert result.points.tobytes() == named.points.tobytes()
    assert smooth(mesh, "auto", max_sweeps=2).reason == result.reason


@pytest.mark.nojit
def test_auto_takes_the_triangle_method_for_quads_that_are_cut(mesh):
    result = smooth(mesh, split_quads=True, max_sweeps=1)
    assert result.method == "aspect-ratio"
    assert result.reason.startswith("auto chose aspect-ratio, as the quads are cut in triangles")


@pytest.mark.nojit
def test_options_that_the_chosen_method_lacks_are_named():
    triangles = random_mesh("triangles", 3).mesh
    with pytest.raises(ValueError, match=r"'optimize' has no option max_angle \(auto chose"):
        smooth(triangles, max_angle=110.0)
    with pytest.raises(ValueError, match="method must be one of auto, optimize, star"):
        smooth(triangles, "stars")


# ------------------------------------------------------------------------------- uniformity


@pytest.mark.nojit
def test_neighbours_of_one_size_have_no_jump():
    assert quality(Mesh(*grid(3, 2))).summary().mean["size_jump"] == pytest.approx(1.0)
    # An equilateral triangle on the side of a square is as large as it, for its kind.
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 1 + 0.75**0.5)]
    house = Mesh(points, [[(0, 1, 2, 3)], [(3, 2, 4)]])
    assert quality(house).size_jump == pytest.approx([1.0, 1.0])


@pytest.mark.nojit
def test_the_largest_jump_of_each_cell_and_their_geometric_mean():
    # Rectangles of widths 1, 2 and 6 in a row, and one alone.
    x = [0.0, 1.0, 3.0, 9.0]
    points = [(a, y) for y in (0.0, 1.0) for a in x] + [(20, 0), (21, 0), (21, 1), (20, 1)]
    cells = [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (8, 9, 10, 11)]
    measured = quality(Mesh(points, cells))
    assert measured.size_jump[:3] == pytest.approx([2.0, 3.0, 3.0])
    assert np.isnan(measured.size_jump[3])
    assert measured.summary().mean["size_jump"] == pytest.approx(18.0 ** (1.0 / 3.0))
    assert measured.summary().to_dict()["mean"]["size_jump"] == pytest.approx(18.0 ** (1.0 / 3.0))
    # The unit does not matter, nor which way cells are given.
    turned = Mesh(1e-6 * np.array(points), [cell[::-1] for cell in cells])
    assert quality(turned).size_jump[:3] == pytest.approx([2.0, 3.0, 3.0])


@pytest.mark.nojit
def test_a_cell_without_area_jumps_infinitely():
    points = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (0.5, 0.5)]
    measured = quality(Mesh(points, [(0, 1, 4, 3), (1, 2, 5, 4)]))
    if (measured.area <= 0.0).any():
        assert np.isinf(measured.size_jump).all()
    flat = Mesh([(0, 0), (1, 0), (2, 0), (1, 1)], [(0, 1, 2), (0, 2, 3)])
    assert np.isinf(quality(flat).size_jump).all()
    assert quality(flat).summary().to_dict()["mean"]["size_jump"] is None


@pytest.mark.parametrize("rings", [0, 1])
def test_the_worst_group_of_a_selection_is_among_the_selected(mesh, rings):
    marked = select_cells(mesh, "max_angle > 140", rings)
    chosen = set(np.flatnonzero(marked).tolist())
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    ranked = sorted(chosen, key=lambda c: -max(reference.angles(points, cells[c])))
    active = set(ranked[: math.ceil(0.3 * len(ranked))])
    order = mesh.topology.schedule(True, vertices_of(mesh, marked)).vertices.tolist()
    options = reference.Options(good=0.5, active=active, step=0.25)
    expected = [(z.real, z.imag) for z in reference.star_sweep(points, cells, order, options)]
    result = smooth(
        mesh, "star", selection="max_angle > 140", selection_rings=rings, worst_fraction=0.3,
        max_sweeps=1,
    )  # fmt: skip
    np.testing.assert_allclose(result.mesh.xy, expected, rtol=0, atol=1e-12)
