"""Seams are found, and welded within a tolerance; what would spoil a cell is refused."""

import numpy as np
import pytest

from qsmooth import Mesh, MeshError, MeshWarning, merge, quality, read_mesh, smooth, write_mesh
from qsmooth.examples import jittered, structured
from qsmooth.inspection import inspect
from qsmooth.merging import find_seams

pytestmark = pytest.mark.nojit


def apart(mesh, **options):
    """The same cells, each with vertices of its own."""
    blocks, n = [], 0
    for cells in mesh.cells:
        blocks.append(n + np.arange(cells.size).reshape(cells.shape))
        n += cells.size
    points = np.concatenate([mesh.points[cells.ravel()] for cells in mesh.cells])
    return Mesh(points, blocks, **options)


def two_squares(gap=0.0, turned=False, height=1.0):
    """Two squares side by side, `gap` apart; the second clockwise if `turned`."""
    left = [(0, 0), (1, 0), (1, height), (0, height)]
    right = [(1 + gap, 0), (2, 0), (2, height), (1 + gap, height)]
    second = [4, 7, 6, 5] if turned else [4, 5, 6, 7]
    return Mesh(np.array([*left, *right], float), np.array([[0, 1, 2, 3], second]))


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_cells_apart_become_the_mesh_that_they_were(kind):
    whole = jittered(5, 4, kind=kind, seed=2)
    parts = apart(whole)
    assert parts.topology.n_parts == whole.n_cells
    merged = merge(parts)
    assert merged.n_vertices == whole.n_vertices
    assert merged.topology.n_parts == 1
    assert int((merged.topology.twins < 0).sum()) == int((whole.topology.twins < 0).sum())
    for one, other in zip(merged.cells, whole.cells, strict=True):
        assert np.array_equal(merged.points[one], whole.points[other])


def test_the_lowest_vertex_stays_and_others_keep_their_order():
    mesh = two_squares()
    seams = find_seams(mesh)
    assert seams.edges.tolist() == [[[1, 2], [4, 7]]]
    assert (seams.n_edges, seams.n_welded) == (1, 2)
    assert str(seams) == "1 edge of the boundary lies on another"
    merged = merge(mesh)
    assert merged.cells[0].tolist() == [[0, 1, 2, 3], [1, 4, 5, 2]]
    assert np.array_equal(merged.points, mesh.points[[0, 1, 2, 3, 5, 6]])
    assert merge(merged) is merged


def test_cells_that_run_the_other_way_are_joined_too():
    assert merge(two_squares(turned=True)).topology.n_parts == 1


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_tolerance_is_a_share_of_the_shortest_edge(unit):
    for height, reach in ((1.0, 1.0), (0.01, 0.01)):  # of flat cells the height
        near = two_squares(gap=0.5e-3 * reach, height=height)
        near = Mesh(unit * near.points, near.cells)
        assert find_seams(near).n_edges == 0
        assert find_seams(near, 0.4e-3).n_edges == 0
        assert merge(near, 0.6e-3).n_vertices == 6
    assert merge(two_squares(gap=1e-12), 0.0).n_vertices == 8
    assert merge(two_squares(gap=1e-12)).n_vertices == 6


def test_far_from_the_origin_and_across_bins():
    rng = np.random.default_rng(3)
    for shift in (0.0, 5e5, -1e7 / 3):
        whole = structured(9, 7)
        parts = apart(whole)
        noise = 2e-4 * (rng.random(parts.points.shape) - 0.5) / 9
        shifted = Mesh(parts.points + noise + shift, parts.cells)
        assert merge(shifted, 1e-3).n_vertices == whole.n_vertices


def test_what_is_no_seam():
    points = [(0, 0), (1, 0), (1, 1), (0, 1)]
    above = Mesh([*points, *points], [[0, 1, 2, 3], [4, 5, 6, 7]])  # one on top of the other
    assert find_seams(above).n_edges == 0
    corner = Mesh([*points, *[(x + 1, y + 1) for x, y in points]], [[0, 1, 2, 3], [4, 5, 6, 7]])
    assert find_seams(corner).n_edges == 0
    # A coarse cell beside two fine ones: vertices in common, and no edge.
    coarse = [(0, 0), (2, 0), (2, 2), (0, 2)]
    fine = [(2, 0), (3, 0), (3, 1), (2, 1), (3, 2), (2, 2)]
    cells = [[0, 1, 2, 3], [4, 5, 6, 7], [7, 6, 8, 9]]
    assert find_seams(Mesh([*coarse, *fine], cells)).n_edges == 0


def test_a_cut_inside_one_part_is_a_seam():
    angles = np.linspace(0.0, 2.0 * np.pi, 13)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    ring[-1] = ring[0]
    points = np.concatenate([ring, 2.0 * ring])
    cells = [[i, 13 + i, 14 + i, 1 + i] for i in range(12)]
    merged = merge((points, cells))
    assert merged.n_vertices == 24
    assert inspect(merged).n_boundary_loops == 2


def test_a_step_in_the_sea_bed_is_kept():
    flat = two_squares()
    depths = np.array([0, 1, 1, 0, 5, 2, 2, 1], float)
    cliff = Mesh(np.column_stack([flat.points, depths]), flat.cells, surface="flat")
    assert find_seams(cliff).n_edges == 0
    depths[[4, 7]] = 1.0
    even = Mesh(np.column_stack([flat.points, depths]), flat.cells, surface="flat")
    merged = merge(even)
    assert (merged.n_vertices, merged.surface) == (6, "flat")


def test_regions_and_fixed_vertices_stay():
    whole = structured(4, 4)
    regions = np.arange(whole.n_cells) % 3
    fixed = np.arange(whole.n_cells) * 4
    merged = merge(apart(whole, regions=regions, fixed=fixed))
    assert np.array_equal(merged.regions, regions)
    firsts = np.concatenate([cells[:, 0] for cells in merged.cells])
    assert set(np.flatnonzero(merged.topology.given_fixed)) == set(firsts.tolist())


def test_what_would_spoil_a_cell_is_refused():
    with pytest.raises(MeshError, match="merging would make cell 1 degenerate: of its vertices"):
        merge(folded())
    with pytest.raises(MeshError, match=r"cannot be merged: .* third or later on one edge"):
        merge(three_on_an_edge())
    with pytest.raises(ValueError, match=r"tolerance must be in \[0, 0.25\], got 0.3"):
        merge(two_squares(), 0.3)
    with pytest.raises(ValueError, match="tolerance"):
        merge(two_squares(), True)


def folded():
    """A cell whose both ends lie on other cells at one place: it has no length."""
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (1, 0), (1, 0), (1, 1), (1, 1)]
    points += [(1, 0), (2, 0), (2, 1), (1, 1)]
    return Mesh(np.array(points, float), [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]])


def three_on_an_edge():
    """Two cells on one side of an edge, and one on its other side."""
    left = [(0, 0), (1, 0), (1, 1), (0, 1)]
    steep = [(-1, 2), (1, 0), (1, 1)]
    right = [(1, 0), (2, 0), (2, 1), (1, 1)]
    return Mesh([*left, *steep, *right],
                [np.array([(0, 1, 2, 3), (7, 8, 9, 10)]), np.array([(4, 5, 6)])])  # fmt: skip


def test_a_weld_that_turns_a_flat_cell_over_is_refused():
    # The apex of a flat triangle would take the place of a vertex below its base.
    points = [(1, 0), (1, 1), (0.5, -0.05), (0, 0), (1, 0), (0.5, 0.05)]
    mesh = Mesh(np.array(points), [[0, 1, 2], [3, 4, 5]])
    assert find_seams(mesh, 0.25).n_edges == 1
    with pytest.raises(
        MeshError, match="would make 1 cell invalid, the first is cell 1; a smaller"
    ):
        merge(mesh, 0.25)


def test_files_are_written_anew_with_what_belongs_to_cells_and_vertices(tmp_path):
    path = tmp_path / "a.vtk"
    path.write_text(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n"
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n1 0 0\n2 0 0\n2 1 0\n1 1 0\n"
        "CELLS 3 13\n4 0 1 2 3\n4 4 5 6 7\n2 4 5\nCELL_TYPES 3\n9\n9\n3\n"
        "CELL_DATA 3\nSCALARS material int\nLOOKUP_TABLE default\n7 8 9\n"
        "POINT_DATA 8\nSCALARS bed double\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 7\n"
    )
    merged = merge(read_mesh(path))
    for out in (tmp_path / "b.vtk", path):
        write_mesh(out, merged)
        back = read_mesh(out)
        assert back.n_vertices == 6
        assert back.regions.tolist() == [7, 8]
        assert back.source.point_data["bed"].tolist() == [0, 1, 2, 3, 5, 6]
        assert back.topology.lines.tolist() == [[1, 4]]
    with pytest.warns(MeshWarning, match="cannot hold"):
        write_mesh(tmp_path / "a.off", merged)


def test_seams_no_longer_hold_vertices_back():
    merged = merge(apart(jittered(6, 6, seed=4)))
    result = smooth(merged, "laplacian", max_sweeps=5)
    assert quality(result.mesh).min_angle.min() > quality(merged).min_angle.min()


def test_info_names_them():
    facts = inspect(two_squares())
    (found,) = [f for f in facts.findings if f.name == "unmerged edges"]
    assert (found.count, found.items) == (1, ((1, 2, 4, 7),))
