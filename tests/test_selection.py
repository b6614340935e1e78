"""Selections: which cells, and that only their vertices move; jumps in size."""

import numpy as np
import pytest

from meshes import grid, random_mesh
from qsmooth import Mesh, Stop, quality, read_mesh, smooth
from qsmooth.registry import methods
from qsmooth.selection import (
    parse_selection,
    parse_threshold,
    read_ids,
    select_cells,
    select_vertices,
    vertices_of,
)
from qsmooth.vectors import shortest_edges, transition


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


# ------------------------------------------------------------------------------- regions, polygons

GMSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
1 7 "inlet"
2 3 "water"
2 4 "Sand Bank"
$EndPhysicalNames
$Nodes
9
1 0 0 0
2 1 0 0
3 2 0 0
4 0 1 0
5 1 1 0
6 2 1 0
7 0 2 0
8 1 2 0
9 2 2 0
$EndNodes
$Elements
6
1 1 2 7 1 4 1
2 1 2 7 1 7 4
3 3 2 3 1 1 2 5 4
4 3 2 3 1 2 3 6 5
5 3 2 4 2 4 5 8 7
6 3 2 4 2 5 6 9 8
$EndElements
"""
ABAQUS = """*NODE, NSET=EVERY
1, 0, 0
2, 1, 0
3, 2, 0
4, 0, 1
5, 1, 1
6, 2, 1
*ELEMENT, TYPE=CPS4, ELSET=WHOLE
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*NSET, NSET=Middle
2, 5
*ELSET, ELSET=RIGHT
2
"""


@pytest.fixture
def gmsh(tmp_path):
    path = tmp_path / "groups.msh"
    path.write_text(GMSH)
    return read_mesh(path)


@pytest.fixture
def abaqus(tmp_path):
    path = tmp_path / "sets.inp"
    path.write_text(ABAQUS)
    return read_mesh(path)


def test_cells_of_a_region_by_number_and_by_name(gmsh):
    for text in ("region == 4", "region=4", "region == Sand Bank", "region = 'sand bank'"):
        assert select_cells(gmsh, text).tolist() == [False, False, True, True]
    message = r"there is no region 5; the regions of the mesh are 3, 4, water, Sand Bank"
    with pytest.raises(ValueError, match=message):
        select_cells(gmsh, "region == 5")
    with pytest.raises(ValueError, match="did you mean 'water'"):
        select_cells(gmsh, "region == watr")
    with pytest.raises(ValueError, match="the mesh has no regions"):
        select_cells(Mesh(*grid(2, 2)), "region == 1")


@pytest.mark.nojit
def test_cells_of_a_polygon(tmp_path):
    mesh = Mesh(*grid(4, 4))
    corner = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    assert np.flatnonzero(select_cells(mesh, corner)).tolist() == [0, 1, 4]
    assert np.flatnonzero(select_cells(mesh, np.array(corner) + 0.1)).tolist() == [0, 1, 4]
    words = "polygon: 0,0 2,0 2,1 1,1 1,2 0,2"
    assert np.flatnonzero(select_cells(mesh, words)).tolist() == [0, 1, 4]
    assert np.flatnonzero(select_cells(mesh, parse_selection(words))).tolist() == [0, 1, 4]
    path = tmp_path / "corner.txt"
    path.write_text("# a corner\n0 0\n2 0\n2 1\n1 1\n1 2\n0 2\n")
    assert np.flatnonzero(select_cells(mesh, f"polygon: {path}")).tolist() == [0, 1, 4]
    for wrong in ("polygon: 0,0 1,1", "polygon: 0,0 1,1 2"):
        with pytest.raises(ValueError, match="pairs x,y of numbers, three or more"):
            select_cells(mesh, wrong)
    with pytest.raises(ValueError, match=r"cannot read .nowhere\.txt.: No such file"):
        select_cells(mesh, "polygon: nowhere.txt")
    with pytest.raises(ValueError, match="finite numbers"):
        select_cells(mesh, [[0, 0], [1, np.nan], [1, 1]])


# ------------------------------------------------------------------------------- vertices


def ids_of(mesh, given):
    return np.flatnonzero(select_vertices(mesh, given)).tolist()


@pytest.mark.nojit
def test_vertices_by_id_by_mask_and_by_condition():
    mesh = Mesh(*grid(2, 2))
    assert ids_of(mesh, [3, 4]) == ids_of(mesh, "3,4") == ids_of(mesh, " 3 4 ") == [3, 4]
    assert ids_of(mesh, np.arange(9) == 4) == [4]
    assert ids_of(mesh, "x < 1") == [0, 3, 6]
    assert ids_of(mesh, "x>=1 AND y <= 0") == [1, 2]
    assert ids_of(mesh, "x < 1 and y < 1, 8") == ids_of(mesh, ["x < 1 and y < 1", "8"]) == [0, 8]
    assert ids_of(mesh, []) == ids_of(mesh, "x > 7") == []
    deep = Mesh(np.column_stack([mesh.points, np.arange(9.0)]), mesh.cells, surface="flat")
    assert ids_of(deep, "z > 6.5") == [7, 8]
    for wrong in ("x <", "x < one", "w < 1", "z > 1", "x < 1 or y < 1", "wall"):
        with pytest.raises(ValueError, match="and names; the mesh has no names; got"):
            select_vertices(mesh, wrong)
    with pytest.raises(ValueError, match=r"1 vertex id in fixed is outside 0 .. 8, the first is 9"):
        select_vertices(mesh, "9")
    with pytest.raises(ValueError, match="must be vertex ids, a boolean mask"):
        select_vertices(mesh, 0.5)


def test_vertices_by_what_the_file_calls_them(gmsh, abaqus):
    assert ids_of(gmsh, "inlet") == ids_of(gmsh, "INLET") == [0, 3, 6]
    assert ids_of(gmsh, "sand bank") == [3, 4, 5, 6, 7, 8]
    assert ids_of(gmsh, "inlet, x > 1 and y < 1") == [0, 2, 3, 6]
    with pytest.raises(ValueError, match=r"are inlet, water, Sand Bank; .* did you mean 'inlet'"):
        select_vertices(gmsh, "inlett")
    assert ids_of(abaqus, "middle") == [1, 4]
    assert ids_of(abaqus, "right") == [1, 2, 4, 5]


def test_ids_from_a_file(tmp_path):
    path = tmp_path / "ids.txt"
    path.write_text("# the pier\n4\n5 # its end\n\n7, 8\n")
    assert read_ids(path, "fixed_file") == [4, 5, 7, 8]
    path.write_text("")
    assert read_ids(path, "fixed_file") == []
    path.write_text("4\nfive\n")
    with pytest.raises(ValueError, match=r"takes a file of vertex ids, and '.*' has 'five'"):
        read_ids(path, "fixed_file")


# ------------------------------------------------------------------------------- a transition


@pytest.mark.parametrize("rings", [1, 3])
def test_vertices_move_less_from_ring_to_ring_around_the_selection(rings):
    mesh = random_mesh("quads", 14, seed=2, amount=1.0).mesh
    middle = select_cells(mesh, [mesh.n_cells // 2])
    grown, shares = transition(mesh, middle, rings)
    assert np.array_equal(grown, select_cells(mesh, middle, rings))
    expected = np.zeros(mesh.n_vertices)
    for ring in range(rings, 0, -1):
        expected[vertices_of(mesh, select_cells(mesh, middle, ring))] = 1 - ring / (rings + 1)
    expected[vertices_of(mesh, middle)] = np.inf
    assert shares == pytest.approx(expected)
    limited = np.isfinite(shares)
    most = shares[limited] * shortest_edges(mesh)[limited]
    for method in ("star", "laplacian", "optimize"):
        points = smooth(mesh, method, selection=middle, selection_rings=rings).points
        moves = np.linalg.norm(points - mesh.points, axis=1)
        assert moves[~limited].any()
        assert (moves[limited] <= most).all()
