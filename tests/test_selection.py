"""Selections: which cells, and that only their vertices move; jumps in size."""

import numpy as np
import pytest

from meshes import grid, random_mesh
from qsmooth import Mesh, Stop, quality, smooth
from qsmooth.registry import methods
from qsmooth.selection import parse_threshold, select_cells, vertices_of


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
@pytest.mark.parametrize("known", methods().values(), ids=methods())
def test_only_the_vertices_of_selected_cells_move(known):
    mesh = random_mesh("triangles", 8, seed=3, amount=0.9).mesh
    chosen = vertices_of(mesh, select_cells(mesh, [60, 61], 1))
    method = known(selection=[60, 61], selection_rings=1, max_sweeps=5, threads=1)
    result = smooth(mesh, method)
    assert result.outcome.selected
    moved = (result.points != mesh.points).any(axis=1)
    assert moved.any()
    assert not moved[~chosen].any()
    if method.guards:
        assert result.after.worst["scaled_jacobian"] >= result.before.worst["scaled_jacobian"]


@pytest.mark.nojit
def test_all_cells_selected_is_no_selection(mesh):
    all_of_them = smooth(mesh, "star", selection="max_angle > 0", max_sweeps=5)
    assert all_of_them.points.tobytes() == smooth(mesh, "star", max_sweeps=5).points.tobytes()


@pytest.mark.nojit
def test_a_selection_of_nothing_rests(mesh):
    result = smooth(mesh, "star", selection=[])
    assert result.converged
    assert result.sweeps == 0
    assert result.outcome.stop is Stop.NOTHING_MOVES
    assert result.reason == "no vertex can move: all selected are on the boundary or fixed"
    assert result.points.tobytes() == mesh.points.tobytes()


@pytest.mark.nojit
@pytest.mark.parametrize("rings", [-1, 1.5, True])
def test_rings_are_a_count(mesh, rings):
    with pytest.raises(ValueError, match="selection_rings must be an integer of 0 or more"):
        smooth(mesh, "star", selection=[0], selection_rings=rings)


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
