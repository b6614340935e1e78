"""Quads cut in two triangles: which ones, and what the report says."""

import numpy as np
import pytest

from meshes import grid, random_mesh, tilt
from qsmooth import Mesh, MeshError, quality, smooth
from qsmooth.split import split_quads

KITE = [(0.0, 0.0), (2.0, -1.0), (5.0, 0.0), (2.0, 1.0)]


def triangles(mesh):
    return [sorted(cell.tolist()) for block in mesh.cells for cell in block]


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("diagonal", "expected"),
    [
        ("shorter", [[0, 1, 3], [1, 2, 3]]),
        ("first", [[0, 1, 2], [0, 2, 3]]),
        ("second", [[0, 1, 3], [1, 2, 3]]),
    ],
)
def test_a_kite_is_cut(diagonal, expected):
    for turn in (False, True):  # clockwise input has the same diagonals
        cells = [(0, 3, 2, 1)] if turn else [(0, 1, 2, 3)]
        cut = split_quads(Mesh(KITE, cells), diagonal)
        assert sorted(triangles(cut)) == expected
        assert quality(cut).n_invalid == 0


@pytest.mark.nojit
def test_where_both_are_as_long_the_first_is_taken():
    cut = split_quads(Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)]))
    assert sorted(triangles(cut)) == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.nojit
def test_triangles_stay_and_everything_goes_along():
    points, (quads,) = grid(2, 1)
    mesh = Mesh(points, [[(0, 1, 4)], [(0, 4, 3)], quads[1:]], fixed=[1], regions=[0, 0, 5])
    cut = split_quads(mesh)
    assert triangles(cut)[:2] == [[0, 1, 4], [0, 3, 4]]
    assert cut.n_cells == 4
    assert cut.regions.tolist() == [0, 0, 5, 5]
    assert cut.is_fixed.tolist() == mesh.is_fixed.tolist()
    assert cut.is_interface.tolist() == mesh.is_interface.tolist()
    assert quality(cut).area.sum() == pytest.approx(quality(mesh).area.sum())


@pytest.mark.nojit
def test_a_vertex_between_two_quads_is_cut_through():
    # Vertex 4 has two quads, which is never valid; cut elsewhere both would give one triangle.
    points = [(0, 0), (2, 0), (2, 2), (0, 2), (1.0, 1.0)]
    mesh = Mesh(points, [(0, 1, 2, 4), (0, 4, 2, 3)])
    for diagonal in ("shorter", "first", "second"):
        cut = split_quads(mesh, diagonal)
        assert all(4 in t for t in triangles(cut))
        assert len(triangles(cut)) == 4


@pytest.mark.nojit
def test_bad_choices_are_named():
    mesh = Mesh(*grid(2, 2))
    with pytest.raises(ValueError, match="diagonal must be one of shorter, first, second"):
        split_quads(mesh, "longer")
    with pytest.raises(ValueError, match="split_quads must be False, True"):
        smooth(mesh, split_quads="longer")


@pytest.mark.nojit
def test_quads_that_lie_on_each_other_can_not_be_cut():
    # Two quads with the same diagonal 0-2 and no side in common.
    points = [(0, 0), (2, -1), (4, 0), (2, 1), (2, -2), (2, 2)]
    mesh = Mesh(points, [(0, 1, 2, 3), (0, 4, 2, 5)])
    with pytest.raises(MeshError, match="can't be cut in two along these diagonals"):
        split_quads(mesh, "first")


@pytest.mark.parametrize("diagonal", [True, "shorter", "first", "second"])
@pytest.mark.parametrize("method", ["star", "aspect-ratio", "angle", "smart-laplacian"])
def test_what_is_swept_are_the_triangles(method, diagonal):
    mesh = random_mesh("quads", 7, seed=2, amount=0.9).mesh
    cut = split_quads(mesh, "shorter" if diagonal is True else diagonal)
    # Cut along a diagonal that leaves valid quads it is a valid triangle mesh, and stays one.
    assert quality(cut).n_invalid == 0
    result = smooth(mesh, method, split_quads=diagonal, max_sweeps=8, rtol=0.0)
    alone = smooth(cut, method, max_sweeps=8, rtol=0.0)
    assert result.points.tobytes() == alone.points.tobytes()
    assert alone.after.n_invalid == 0
    n_broken = result.after.n_invalid
    name = "shorter" if diagonal is True else diagonal
    assert f"{mesh.n_cells} quads were smoothed as two triangles each" in result.reason
    assert f"along the {name} diagonal, which broke {n_broken or 'none'} of them" in result.reason
    assert result.mesh.cells[0].tobytes() == mesh.cells[0].tobytes()
    assert [record.n_invalid for record in result.history][-1] == n_broken


def test_some_quads_break_and_the_figure_is_right():
    from qsmooth.examples import lake

    result = smooth(lake(1000), "aspect-ratio", split_quads=True)
    assert result.before.n_invalid == 0
    assert result.after.n_invalid > 0
    assert f"broke {result.after.n_invalid} of them" in result.reason


def test_a_tilted_plane_keeps_its_plane():
    made = random_mesh("quads", 5, seed=1)
    mesh = Mesh(tilt(made.points), made.cells)
    result = smooth(mesh, "angle", split_quads=True)
    assert result.points.shape == mesh.points.shape
    offsets = (result.points - mesh.plane.origin) @ mesh.plane.normal
    assert np.abs(offsets).max() < 1e-12


@pytest.mark.nojit
def test_triangles_have_nothing_to_cut():
    mesh = Mesh([(0.5, 0.0), (1, 0), (0, 1), (-1, 0), (0, -1)],
                [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1)])  # fmt: skip
    result = smooth(mesh, "star", split_quads=True, max_sweeps=1)
    assert "two triangles" not in result.reason
