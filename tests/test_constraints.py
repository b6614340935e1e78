"""Constraints: what stays, stays to the bit; no vertex is ever anywhere but where it may be."""

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import promises
from meshes import fan, grid, random_mesh, tilt
from promises import invalid_cells
from qsmooth import (
    Constraints,
    Mesh,
    MeshError,
    Star,
    Stop,
    compare,
    limits,
    read_mesh,
    smooth,
    untangle,
    write_mesh,
)
from qsmooth.numbering import numbered
from qsmooth.registry import all_methods
from test_selection import GMSH

every_method = pytest.mark.parametrize("known", all_methods().values(), ids=all_methods())


@st.composite
def constrained(draw):
    """A mesh, valid or tangled, and constraints of its vertices."""
    mesh = draw(promises.valid_meshes() | promises.tangled_meshes())
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    size = float(np.ptp(mesh.points, axis=0).max())
    given_, n = {}, mesh.n_vertices
    if draw(st.booleans()):
        given_["fixed"] = rng.random(n) < 0.3
    if draw(st.booleans()):
        given_["max_move"] = size * draw(st.sampled_from([1e-3, 1e-2, 0.1]))
    if draw(st.booleans()):
        given_["max_move_share"] = draw(st.sampled_from([1e-3, 0.1, 0.5]))
    if draw(st.booleans()):
        directions = rng.normal(size=(n, 2))
        directions[rng.random(n) < 0.3] = (1.0, 0.0)
        directions[rng.random(n) < 0.4] = np.nan
        given_["directions"] = directions
    return mesh, given_


def shortest_edges(mesh):
    shortest = np.full(mesh.n_vertices, np.inf)
    for v in range(mesh.n_vertices):
        ring = mesh.ring_vertices[mesh.ring_offsets[v] : mesh.ring_offsets[v + 1]]
        if ring.size:
            shortest[v] = np.linalg.norm(mesh.xy[ring] - mesh.xy[v], axis=1).min()
    return shortest


def check(mesh, points, given_):
    """Every vertex is where the constraints let it be."""
    moves = (points - mesh.points)[:, :2]
    lengths = np.linalg.norm(moves, axis=1)
    assert points[mesh.is_fixed].tobytes() == mesh.points[mesh.is_fixed].tobytes()
    if "fixed" in given_:
        fixed = given_["fixed"]
        assert points[fixed].tobytes() == mesh.points[fixed].tobytes()
    if "max_move" in given_:
        assert (lengths <= given_["max_move"]).all()
    if "max_move_share" in given_:
        assert (lengths <= given_["max_move_share"] * shortest_edges(mesh)).all()
    if "directions" in given_:
        on_line = np.isfinite(given_["directions"]).all(axis=1)
        ux, uy = given_["directions"][on_line].T
        off = np.abs(moves[on_line, 0] * uy - moves[on_line, 1] * ux) / np.hypot(ux, uy)
        assert (off <= 3.0 * np.spacing(np.abs(points[:, :2]).max())).all()


@every_method
@given(st.data())
@settings(max_examples=30)
def test_no_vertex_is_where_it_may_not_be(known, data):
    mesh, given_ = data.draw(constrained())
    method = known(max_sweeps=40, threads=1, **given_)
    if method.why_not(mesh):
        return
    result = smooth(mesh, method)
    check(mesh, result.points, given_)
    if method.guards:
        before, after = invalid_cells(mesh), invalid_cells(result.mesh)
        assert after.sum() <= before.sum()
        assert known.untangles or not (after & ~before).any()


@every_method
@given(st.data())
@settings(max_examples=8)
def test_neither_threads_nor_numbering_change_a_bit_of_it(known, data):
    mesh, given_ = data.draw(constrained())
    method = known(max_sweeps=20, **given_)
    if method.why_not(mesh):
        return
    points = smooth(mesh, known(max_sweeps=20, threads=1, **given_)).points
    assert smooth(mesh, known(max_sweeps=20, threads=2, **given_)).points.tobytes() == (
        points.tobytes()
    )
    with numbered("curve"):
        inside = smooth(mesh, known(max_sweeps=20, threads=1, **given_)).points
    assert inside.tobytes() == points.tobytes()


# ------------------------------------------------------------------------------- by hand


@pytest.fixture
def mesh():
    return random_mesh("quads", 8, seed=3, amount=0.9).mesh


def test_constraints_are_options_too(mesh):
    together = Constraints(fixed="x < 0.3", max_move=0.05)
    expected = smooth(mesh, "star", fixed="x < 0.3", max_move=0.05).points
    assert smooth(mesh, "star", constraints=together).points.tobytes() == expected.tobytes()
    assert smooth(mesh, Star(), constraints=together).points.tobytes() == expected.tobytes()
    results, _ = compare(mesh, ["star"], constraints=together)
    assert results["star"].points.tobytes() == expected.tobytes()
    assert untangle(mesh, constraints=together).mesh is mesh
    for method, beside in (("star", {"max_move": 1.0}), (Star(max_move=1.0), {})):
        with pytest.raises(TypeError, match="given in constraints and beside them: max_move"):
            smooth(mesh, method, constraints=together, **beside)
    with pytest.raises(TypeError, match="beside them: fixed"):
        untangle(mesh, constraints=together, fixed=[1])
    with pytest.raises(TypeError, match="constraints has no option 'fixd'; did you mean 'fixed'"):
        Constraints.of({"fixd": 3})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fixed": [90]}, r"1 vertex id in fixed is outside 0 .. 89, the first is 90"),
        ({"fixed": np.ones(3, bool)}, r"a fixed mask must have the shape \(90,\), got \(3,\)"),
        ({"max_move": 0.0}, "max_move must be over 0, got 0.0"),
        ({"max_move": np.inf}, "max_move must be over 0, got inf"),
        ({"max_move_share": -1}, "max_move_share must be over 0, got -1"),
        ({"directions": "wind"}, "point data with two or three components, of which the mesh has"),
        ({"directions": "1,x"}, "point data with two or three components, of which the mesh has"),
        ({"directions": "1,1e"}, "takes a vector such as 1,0; '1e' is no number"),
        ({"directions": (0, 0)}, r"no vectors with a length.* of vertex 0: \[0.0, 0.0\]"),
        ({"directions": np.ones((3, 2))}, r"must have the shape \(90, 2\), got \(3, 2\)"),
        ({"directions": np.ones(3)}, r"of the shape \(n_vertices, 2\).*; got numbers of the shape"),
        ({"directions": [[1.0, np.nan]] * 90}, r"^90 of the directions .* vertex 0: \[1.0, nan\]"),
        ({"fixed_file": "nowhere.txt"}, r"fixed_file: cannot read 'nowhere.txt': No such file"),
    ],
)
def test_constraints_that_fit_no_mesh(mesh, options, message):
    with pytest.raises(ValueError, match=message):
        smooth(mesh, "star", **options)


@pytest.mark.nojit
@pytest.mark.parametrize("fixed", [0.5, [0.5], [[1, 2]], {"a": 1}, [1, "x < 0"]])
def test_what_can_be_no_vertices_is_refused_at_once(fixed):
    with pytest.raises(ValueError, match="fixed must be vertex ids, a boolean mask"):
        Constraints(fixed=fixed)


@pytest.mark.nojit
def test_vectors_of_any_length_are_directions():
    given_ = np.array([[3.0, 4.0], [1e-300, 0.0], [0.0, -1e300], [np.nan, np.nan]])
    made = Constraints(directions=given_).directions
    assert made[:3] == pytest.approx(np.array([[0.6, 0.8], [1.0, 0.0], [0.0, -1.0]]))
    assert np.isnan(made[3]).all()
    assert Constraints(directions="3, 4").directions == (0.6, 0.8)
    assert Constraints(directions=(0, -2)).directions == (0.0, -1.0)


def test_directions_of_the_file_also_in_a_tilted_plane(mesh, tmp_path):
    up = np.tile([0.0, 0.0, 2.0], (mesh.n_vertices, 1))
    for name, points in (("flat", mesh.points), ("tilted", tilt(mesh.points))):
        space = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
        data = {"up": np.add(up, (0.0, 1.0, 0.0)), "heat": up[:, 0]}
        path = tmp_path / f"{name}.vtu"
        meshio.write(path, meshio.Mesh(space, [("quad", mesh.cells[0])], point_data=data))
        read = read_mesh(path)
        result = smooth(read, "star", directions="up")
        moves = (result.mesh.xy - read.xy)[(result.points != read.points).any(axis=1)]
        axis = np.array([0.0, 1.0]) if read.plane is None else read.plane.axes @ (0.0, 1.0, 2.0)
        assert len(moves) > 20
        assert np.abs(moves @ (-axis[1], axis[0])).max() < 1e-14
    with pytest.raises(ValueError, match=r"components, those are up; got 'heat'"):
        smooth(read, "star", directions="heat")


@pytest.mark.parametrize("method", ["star", "optimize", "laplacian"])
def test_no_move_is_longer_in_a_tilted_plane(mesh, method):
    points = 1e4 + tilt(mesh.points)
    result = smooth((points, mesh.cells), method, max_move=0.01)
    lengths = np.linalg.norm(result.points - points, axis=1)
    assert 0.0099 < lengths.max() <= 0.01


def test_the_optimiser_comes_to_rest_along_lines(mesh):
    # Only heights are free: downhill in each of them, so that none is left to gain.
    directions = np.tile([0.0, 1.0], (mesh.n_vertices, 1))
    result = smooth(mesh, worst=False, directions=directions, max_sweeps=400)
    again = smooth(result.mesh, worst=False, directions=directions, max_sweeps=400)
    assert result.after.mean["shape"] > result.before.mean["shape"] + 0.01
    assert again.after.mean["shape"] < result.after.mean["shape"] + 1e-3
    assert result.points[:, 0].tobytes() == mesh.points[:, 0].tobytes()


def test_a_vertex_at_the_end_of_its_reach_slides_round_it():
    # The middle vertex wants to the middle, and may only come to the nearest place of its disc.
    points, cells = grid(2, 2)
    points[4] = 1.5, 1.6
    result = smooth((points, cells), worst=False, max_move=0.3)
    way = (1.0 - points[4]) / np.linalg.norm(1.0 - points[4])
    assert result.points[4] == pytest.approx(points[4] + 0.3 * way, abs=2e-2)
    assert 0.2999 < np.linalg.norm(result.points[4] - points[4]) <= 0.3


# ------------------------------------------------------------------------------- fixed in the mesh


def test_a_mesh_with_other_fixed_vertices_keeps_all_else(tmp_path):
    path = tmp_path / "groups.msh"
    path.write_text(GMSH)
    read = read_mesh(path)
    fixed = read.with_fixed([4])
    assert fixed.is_fixed.all()
    assert not read.is_fixed[4]
    assert not fixed.with_fixed(None).is_fixed[4]
    assert fixed.source is read.source
    assert np.array_equal(fixed.regions, read.regions)
    assert np.array_equal(fixed.is_interface, read.is_interface)
    assert fixed.topology.lines.tolist() == read.topology.lines.tolist()
    assert smooth(fixed, "star", keep_interfaces=False).outcome.stop is Stop.NOTHING_MOVES
    write_mesh(tmp_path / "again.msh", fixed)
    assert (tmp_path / "again.msh").read_text() == GMSH
    with pytest.raises(MeshError, match="1 id in fixed is outside"):
        read.with_fixed([9])


def test_fixed_vertices_stay_where_cells_lie_along_a_curve(mesh):
    free = ~mesh.is_fixed
    for fixed in (np.flatnonzero(free)[::3], []):
        with numbered("curve"):
            points = smooth(mesh.with_fixed(fixed), "star").points
        moved = (points != mesh.points).any(axis=1)
        assert not moved[fixed].any()
        assert moved.sum() > 20


# ------------------------------------------------------------------------------- limits


def test_a_limit_names_what_sets_it():
    points, cells = grid(6, 6)
    points[25] += (0.0, -0.6)
    mesh, kept = Mesh(points, cells), np.zeros(49, bool)
    free = limits(mesh)
    assert (free.min_angle_set_by, free.max_angle_set_by) == ("", "")
    # Vertex 24 in the middle, its neighbour below, and that to the right.
    kept[[17, 24, 25]] = True
    found = limits(mesh, movable=~(mesh.is_boundary | kept))
    assert found.min_angle == pytest.approx(90.0 - np.degrees(np.arctan(0.6)))
    assert (found.min_angle_vertex, found.min_angle_set_by) == (24, "vertices that may not move")
    assert "set at vertex 24 by vertices that may not move" in str(found)
    assert found.to_dict()["min_angle_set_by"] == "vertices that may not move"
    told = smooth(mesh, fixed=kept).outcome.limits
    assert (told.min_angle_vertex, told.min_angle_set_by) == (24, "vertices given as fixed")
    assert limits(mesh.with_fixed(kept)).min_angle_set_by == "fixed vertices of the mesh"
    told = smooth(mesh, selection=[0, 35]).outcome.limits
    assert (told.min_angle_vertex, told.min_angle_set_by) == (24, "vertices outside the selection")
    # Five triangles round a vertex: by nothing but their count.
    few = limits(fan(5, "triangle"))
    assert (few.max_angle_vertex, few.max_angle_set_by) == (0, "")
    with pytest.raises(ValueError, match=r"movable must be booleans of the shape \(49,\)"):
        limits(mesh, movable=[1, 2])


def test_a_sharp_corner_of_the_boundary_sets_a_limit():
    points = np.array([(0, 0), (2, 0), (2, 0.5), (1, 1.0)], float)
    found = limits((points, [[0, 1, 2, 3]]))
    assert (found.min_angle_vertex, found.min_angle_set_by) == (0, "fixed boundary vertices")
    assert "by fixed boundary vertices" in str(found)
    free = limits((points, [[0, 1, 2, 3]]), movable=np.ones(4, bool))
    assert (free.min_angle, free.min_angle_set_by) == (90.0, "")
