"""What a Mesh takes, refuses, derives and gives back."""

import re

import numpy as np
import pytest

import reference
from meshes import grid, random_mesh, tilt, turn_cells
from qsmooth import Mesh, MeshError, Validity, quality, smooth

pytestmark = pytest.mark.nojit

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
QUAD = [(0, 1, 2, 3)]


# ------------------------------------------------------------------------------- what it takes


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int32, np.int64])
@pytest.mark.parametrize("order", ["C", "F"])
def test_points_of_any_number_type_and_order_become_float64(dtype, order):
    given = np.array(SQUARE, dtype=dtype, order=order)
    mesh = Mesh(given, QUAD)
    assert mesh.points.dtype == np.float64
    assert mesh.points.flags.c_contiguous
    assert np.array_equal(mesh.points, given)


@pytest.mark.parametrize("dtype", [np.int8, np.int32, np.int64, np.uint32, np.uint64])
@pytest.mark.parametrize("order", ["C", "F"])
def test_cells_of_any_integer_type_and_order_become_int64(dtype, order):
    mesh = Mesh(SQUARE, np.array([(0, 1, 2), (0, 2, 3)], dtype=dtype, order=order))
    (block,) = mesh.cells
    assert block.dtype == np.int64
    assert block.flags.c_contiguous
    assert block.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("cells", "blocks"),
    [
        ([(0, 1, 2, 3)], [[[0, 1, 2, 3]]]),
        ([[0, 1, 2], [0, 2, 3]], [[[0, 1, 2], [0, 2, 3]]]),
        ([np.array([0, 1, 2]), np.array([0, 2, 3])], [[[0, 1, 2], [0, 2, 3]]]),
        ([[(0, 1, 2)], [(0, 2, 3)]], [[[0, 1, 2]], [[0, 2, 3]]]),
        ([np.empty((0, 4), int), np.array([(0, 1, 2), (0, 2, 3)])], [[[0, 1, 2], [0, 2, 3]]]),
        ((np.array([(0, 1, 2)]), [(0, 2, 3)]), [[[0, 1, 2]], [[0, 2, 3]]]),
    ],
)
def test_cells_as_rows_as_an_array_or_as_blocks(cells, blocks):
    assert [block.tolist() for block in Mesh(SQUARE, cells).cells] == blocks


def test_blocks_of_both_kinds_keep_order_and_orientation():
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1)]
    blocks = [[(4, 1, 2)], [(0, 3, 2, 1)], [(2, 5, 4)]]
    mesh = Mesh(points, blocks)
    assert [block.tolist() for block in mesh.cells] == [[list(r) for r in b] for b in blocks]
    assert mesh.n_cells == 3
    assert mesh.cell_offsets.tolist() == [0, 3, 7, 10]
    assert repr(mesh) == "Mesh(6 vertices, 2 triangles, 1 quads)"
    xy = reference.as_complex(mesh.xy)
    assert [reference.area(xy, cell) for cell in reference.as_lists(mesh)] == [0.5, 1.0, 0.5]


def test_read_only_input_is_taken_and_no_input_is_changed_or_shared():
    points, (cells,) = grid(3, 3)
    fixed, regions = np.zeros(16, bool), np.zeros(9, np.int64)
    arrays = points, cells, fixed, regions
    copies = [array.copy() for array in arrays]
    for array in arrays:
        array.flags.writeable = False
    mesh = Mesh(points, cells, fixed=fixed, regions=regions)
    result = smooth(mesh, "star")
    for array, copy in zip(arrays, copies, strict=True):
        assert np.array_equal(array, copy)
        array.flags.writeable = True
        for own in (mesh.points, mesh.xy, *mesh.cells, mesh.cell_vertices, mesh.regions,
                    mesh.is_fixed, result.points):  # fmt: skip
            assert not np.shares_memory(array, own)
    points[5] = 99.0
    cells[:] = 0
    fixed[:] = True
    regions[:] = 7
    assert mesh.points[5].tolist() == [1.0, 1.0]
    assert mesh.cells[0][0].tolist() == [0, 1, 5, 4]
    assert not mesh.is_fixed[5]
    assert mesh.regions.tolist() == [0] * 9


def test_everything_it_hands_out_is_read_only_and_typed():
    mesh = Mesh(*grid(2, 2), regions=[0, 0, 1, 1])
    for name in ("star_offsets", "star_cells", "ring_offsets", "ring_vertices", "cell_offsets",
                 "cell_vertices", "regions"):  # fmt: skip
        array = getattr(mesh, name)
        assert array.dtype == np.int64, name
        assert not array.flags.writeable, name
    for name in ("is_boundary", "is_fixed", "is_interface"):
        array = getattr(mesh, name)
        assert array.dtype == np.bool_, name
        assert not array.flags.writeable, name
    for array in (mesh.points, mesh.xy, *mesh.cells):
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@pytest.mark.parametrize("width", [2, 3])
def test_points_keep_the_shape_that_came_in(width):
    points = np.zeros((4, width))
    points[:, :2] = SQUARE
    mesh = Mesh(points, QUAD)
    assert mesh.points.shape == (4, width)
    assert mesh.xy.shape == (4, 2)
    assert smooth(mesh, "star").points.shape == (4, width)


# ------------------------------------------------------------------------------- what it refuses


def refused(match):
    return pytest.raises(MeshError, match=f"^{re.escape(match)}")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_coordinates_that_are_not_finite(value):
    points = np.array(grid(3, 3)[0])
    points[[5, 9], [1, 0]] = value
    with refused("2 vertices are not finite, the first is vertex 5"):
        Mesh(points, grid(3, 3)[1])
    points[9] = 0.0
    with refused("1 vertex is not finite, the first is vertex 5"):
        Mesh(points, grid(3, 3)[1])


def test_coordinates_whose_products_overflow():
    with refused("1 vertex is beyond 1e+75, where areas overflow, the first is vertex 2"):
        Mesh([(0, 0), (1, 0), (1e76, 1), (0, 1)], QUAD)


@pytest.mark.parametrize("bad", [-1, 4, 2**40])
def test_ids_out_of_range(bad):
    with refused(f"1 vertex id is outside 0 .. 3, the first is {bad} in cell 1"):
        Mesh(SQUARE, [(0, 1, 2), (0, 2, bad)])


def test_ids_out_of_range_are_counted():
    with refused("3 vertex ids are outside 0 .. 3, the first is 7 in cell 0"):
        Mesh(SQUARE, [(0, 1, 7), (0, -2, 9)])
    with refused("cells has a vertex id beyond 64 bits: 18446744073709551615"):
        Mesh(SQUARE, np.array([(0, 1, 2**64 - 1)], dtype=np.uint64))


def test_a_vertex_twice_in_a_cell():
    with refused("cell 1 has a vertex twice: [0, 2, 0]"):
        Mesh(SQUARE, [(0, 1, 2), (0, 2, 0)])


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([(0, 1, 2, 3), (0, 1, 2, 3)], "1 cell has the same vertices as another, the first is "
         "cell 1 (as cell 0)"),
        ([(0, 1, 2, 3), (2, 1, 0, 3)], "1 cell has the same vertices as another, the first is "
         "cell 1 (as cell 0)"),
        ([(0, 1, 2, 3), (0, 2, 1, 3)], "1 cell has the same vertices as another, the first is "
         "cell 1 (as cell 0)"),
        ([(0, 1, 2), (0, 2, 3), (1, 2, 0), (3, 0, 2)], "2 cells have the same vertices as another, "
         "the first is cell 2 (as cell 0)"),
    ],
)  # fmt: skip
def test_the_same_cell_twice(cells, message):
    with refused(message):
        Mesh(SQUARE, cells)


@pytest.mark.parametrize(
    ("points", "cells"),
    [
        ([], []),
        (np.empty((0, 2)), np.empty((0, 4), int)),
        (np.empty((0, 3)), []),
        (SQUARE, []),
        (SQUARE, np.empty((0, 3), int)),
        (SQUARE, [np.empty((0, 3), int), np.empty((0, 4), int)]),
    ],
)
def test_an_empty_mesh(points, cells):
    with refused("the mesh is empty"):
        Mesh(points, cells)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([0.0, 1.0, 2.0], "points must have the shape (n, 2) or (n, 3), got (3,)"),
        (np.zeros((4, 1)), "points must have the shape (n, 2) or (n, 3), got (4, 1)"),
        (np.zeros((4, 4)), "points must have the shape (n, 2) or (n, 3), got (4, 4)"),
        (np.zeros((4, 2, 1)), "points must have the shape (n, 2) or (n, 3), got (4, 2, 1)"),
        (5.0, "points must have the shape (n, 2) or (n, 3), got ()"),
        ([(0, 0), (1, 0), (1,)], "points must be numbers in an (n, 2) or (n, 3) array"),
        ([("a", "b")] * 4, "points must be numbers in an (n, 2) or (n, 3) array"),
        (None, "points must"),
    ],
)
def test_points_of_wrong_shape(points, message):
    with refused(message):
        Mesh(points, QUAD)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([(0, 1, 2, 3, 4)], "cells must be an (m, 3) or (m, 4) integer array, got 5-vertex cells"),
        ([(0, 1)], "cells must be an (m, 3) or (m, 4) integer array, got 2-vertex cells"),
        ([0, 1, 2, 3], "cells must be an (m, 3) or (m, 4) integer array"),
        (np.arange(4), "cells must be an (m, 3) or (m, 4) integer array, got the shape (4,)"),
        ([(0, 1, 2), (0, 1, 2, 3)], "cells must be an (m, 3) or (m, 4) integer array: rows differ"),
        ([(0.0, 1.0, 2.0)], "cells must hold integers, got float64"),
        ([(True, False, True)], "cells must hold integers, got bool"),
        ([("a", "b", "c")], "cells must hold integers"),
        ([[(0, 1, 2)], [(0, 1, 2, 3, 4)]],
         "cells[1] must be an (m, 3) or (m, 4) integer array, got 5-vertex cells"),
        (np.zeros((1, 2, 2, 2), int), "cells must be an (m, 3) or (m, 4) integer array"),
        (7, "cells must be an integer array or a list of them, got int"),
        (None, "cells must be an integer array or a list of them, got NoneType"),
    ],
)  # fmt: skip
def test_cells_of_wrong_shape(cells, message):
    with refused(message):
        Mesh([*SQUARE, (2, 2)], cells)


def test_an_edge_with_three_cells():
    points = [(0, 0), (1, 0), (0.5, 1), (0.5, -1), (0.5, 2)]
    with refused("1 cell side is the third or later on one edge (not a 2D mesh), the first is "
                 "edge 0-1 of cell 2"):  # fmt: skip
        Mesh(points, [(0, 1, 2), (1, 0, 3), (0, 1, 4)])


@pytest.mark.parametrize("n", [3, 5, 6])
def test_a_moebius_strip(n):
    turn = 2 * np.pi * np.arange(n) / n
    points = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate([points, 2 * points])
    cells = [(k, k + 1, n + k + 1, n + k) for k in range(n - 1)]
    Mesh(points, [*cells, (n - 1, 0, n, 2 * n - 1)])  # closed as a ring it is a mesh
    with refused("the cells can't be oriented alike (a Möbius strip)"):
        Mesh(points, [*cells, (n - 1, n, 0, 2 * n - 1)])


@pytest.mark.parametrize(
    ("fixed", "message"),
    [
        ([True], "a fixed mask must have the shape (4,), got (1,)"),
        (np.zeros((4, 1), bool), "a fixed mask must have the shape (4,), got (4, 1)"),
        ([0, 4, -1], "2 ids in fixed are outside 0 .. 3, the first is 4"),
        ([0, 4], "1 id in fixed is outside 0 .. 3, the first is 4"),
        ([0.0], "fixed must be a boolean mask or a list of vertex ids"),
        ([[0], [1]], "fixed must be a boolean mask or a list of vertex ids"),
    ],
)
def test_fixed_that_fits_no_mesh(fixed, message):
    with refused(message):
        Mesh(SQUARE, QUAD, fixed=fixed)


@pytest.mark.parametrize("regions", [[0, 1], 3, [0.5], [[0]]])
def test_regions_that_fit_no_mesh(regions):
    with refused("regions must be 1 integers, one for each cell"):
        Mesh(SQUARE, QUAD, regions=regions)


def test_surface_has_two_values():
    with pytest.raises(ValueError, match="surface must be 'auto' or 'flat', got 'round'"):
        Mesh(SQUARE, QUAD, surface="round")


# ------------------------------------------------------------------------------- what it derives


def test_boundary_and_fixed():
    points, cells = grid(4, 4)
    mesh = Mesh(points, cells)
    edge = ((points == 0) | (points == 4)).any(axis=1)
    assert np.array_equal(mesh.is_boundary, edge)
    assert np.array_equal(mesh.is_fixed, edge)
    for fixed in ([12], np.array([12], np.uint8), np.arange(25) == 12):
        mesh = Mesh(points, cells, fixed=fixed)
        assert np.array_equal(mesh.is_fixed, edge | (np.arange(25) == 12))
        assert np.array_equal(mesh.is_boundary, edge)
    assert np.array_equal(Mesh(points, cells, fixed=[]).is_fixed, edge)


def test_fixed_vertices_keep_their_bits():
    made = random_mesh("quads", 6, seed=2, amount=0.8)
    inner = np.flatnonzero(~made.mesh.is_boundary)
    chosen = inner[::3]
    result = smooth(Mesh(made.points, made.cells, fixed=chosen), "star", rtol=0.0, max_sweeps=5)
    assert np.array_equal(result.points[chosen], made.points[chosen])
    rest = np.setdiff1d(inner, chosen)
    assert (result.points[rest] != made.points[rest]).any()


def test_interfaces_are_the_lines_between_regions():
    made = random_mesh("quads", 7, seed=3, amount=0.8)
    regions = np.arange(made.mesh.n_cells) // 21
    mesh = Mesh(made.points, made.cells, regions=regions)
    expected = reference.interface(reference.as_lists(mesh), regions, mesh.n_vertices)
    assert mesh.is_interface.tolist() == expected
    inside = mesh.is_interface & ~mesh.is_boundary
    assert inside.any()
    kept = smooth(mesh, "star", rtol=0.0, max_sweeps=5)
    assert np.array_equal(kept.points[inside], mesh.points[inside])
    assert (kept.points != mesh.points).any()
    free = smooth(mesh, "star", rtol=0.0, max_sweeps=5, keep_interfaces=False)
    assert (free.points[inside] != mesh.points[inside]).any()
    assert np.array_equal(free.mesh.regions, regions)
    without = smooth(Mesh(made.points, made.cells), "star", rtol=0.0, max_sweeps=5)
    assert np.array_equal(free.points, without.points)


def test_orphans_stay_and_are_fixed():
    points, cells = grid(3, 3)
    points[5] = (1.3, 1.2)
    points = np.concatenate([[(9.0, 9.0)], points, [(-5.0, 1e9)]])
    mesh = Mesh(points, [cells[0] + 1])
    assert mesh.is_fixed[[0, 17]].all()
    assert not mesh.is_boundary[[0, 17]].any()
    result = smooth(mesh, "star")
    assert np.array_equal(result.points[[0, 17]], points[[0, 17]])
    assert (result.points != points).any()


def test_an_orphan_out_of_plane_is_no_matter():
    points = np.zeros((5, 3))
    points[:4, :2] = SQUARE
    points[4] = (0.5, 0.5, 77.0)
    mesh = Mesh(points, QUAD)
    assert np.array_equal(smooth(mesh, "star").points, points)


# ------------------------------------------------------------------------------- planes


def flat_and_tilted(seed=0):
    made = random_mesh("mixed", 6, seed=seed, amount=0.8)
    return Mesh(made.points, made.cells), Mesh(tilt(made.points, seed), made.cells)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_tilted_plane_is_measured_and_smoothed_in(seed):
    flat, tilted = flat_and_tilted(seed)
    for name in ("min_angle", "max_angle", "aspect_ratio", "scaled_jacobian", "shape", "area"):
        np.testing.assert_allclose(
            getattr(quality(tilted), name), getattr(quality(flat), name), rtol=1e-9, atol=1e-9
        )
    result = smooth(tilted, "star", rtol=0.0, max_sweeps=10)
    assert result.after.n_invalid == 0
    same = smooth(flat, "star", rtol=0.0, max_sweeps=10)
    for name, value in same.after.worst.items():
        assert result.after.worst[name] == pytest.approx(value, rel=1e-6, abs=1e-9)
    stays = tilted.is_fixed
    assert np.array_equal(result.points[stays], tilted.points[stays])
    # The plane itself: no point leaves it by more than rounding.
    centre = tilted.points.mean(axis=0)
    normal = np.linalg.svd(tilted.points - centre)[2][2]
    assert np.abs((result.points - centre) @ normal).max() < 1e-14 * 20


def test_vertices_that_rest_keep_their_bits_in_a_tilted_plane():
    points, cells = grid(6, 3)
    tilted = Mesh(tilt(points), cells)
    points[9] += 0.3  # one vertex is off; far from it the squares are fine
    result = smooth(Mesh(tilt(points), cells), "star", max_sweeps=1)
    moved = (result.points != tilt(points)).any(axis=1)
    assert 0 < moved.sum() <= 9
    assert np.array_equal(result.points[~moved], tilt(points)[~moved])
    assert tilted.n_vertices == len(points)


def test_level_z_is_carried_along_to_the_bit():
    points, cells = grid(4, 4)
    points[12] += 0.3
    z = np.full(25, -5.1)
    points = np.column_stack([points, z])
    result = smooth((points, cells), "star")
    assert np.array_equal(result.points[:, 2], z)
    assert (result.points[:, :2] != points[:, :2]).any()


def test_flat_takes_z_as_a_value():
    points, cells = grid(4, 4)
    points[12] += 0.3
    z = np.random.default_rng(0).normal(size=25)
    space = np.column_stack([points, z])
    with pytest.raises(MeshError, match=r"do not lie in one plane.*surface='flat'"):
        Mesh(space, cells)
    mesh = Mesh(space, cells, surface="flat")
    assert mesh.surface == "flat"
    result = smooth(mesh, "star", carry="keep")
    assert np.array_equal(result.points[:, 2], z)
    assert np.array_equal(result.points[:, :2], smooth((points, cells), "star").points)


@pytest.mark.parametrize("turned", [0, 1])
def test_a_vertical_plane_is_a_plane(turned):
    points, cells = grid(3, 3)
    points[5] += 0.2
    space = np.insert(points, turned, 7.0, axis=1)
    result = smooth((space, cells), "star")
    assert result.before.n_invalid == result.after.n_invalid == 0
    assert np.abs(result.points[:, turned] - 7.0).max() < 1e-12
    assert result.before.area == pytest.approx(9.0)


# ------------------------------------------------------------------------------- with_points


def test_with_points_keeps_everything_else():
    points, cells = grid(3, 3)
    cells = turn_cells(cells, np.random.default_rng(1))
    mesh = Mesh(points, cells, fixed=[5], regions=np.arange(9))
    new = points * 2.0
    other = mesh.with_points(new)
    new[0] = 99.0
    assert np.array_equal(other.points, points * 2.0)
    assert np.array_equal(mesh.points, points)
    assert np.array_equal(other.xy, points * 2.0)
    for name in ("cell_vertices", "star_cells", "is_fixed", "regions"):
        assert getattr(other, name) is getattr(mesh, name)
    assert [b.tolist() for b in other.cells] == [b.tolist() for b in mesh.cells]


def test_with_points_keeps_the_orientation():
    # Mirrored, every cell is inverted: the mesh does not decide anew which way it runs.
    points, cells = grid(2, 2)
    mirrored = Mesh(points, cells).with_points(points * [-1.0, 1.0])
    assert (quality(mirrored).validity == Validity.INVERTED).all()
    assert (quality(Mesh(points * [-1.0, 1.0], cells)).validity == Validity.VALID).all()


def test_with_points_refuses():
    mesh = Mesh(*grid(2, 2))
    with refused("points must have the shape (9, 2), got (9, 3)"):
        mesh.with_points(np.zeros((9, 3)))
    with refused("points must have the shape (9, 2), got (8, 2)"):
        mesh.with_points(np.zeros((8, 2)))
    bad = mesh.points.copy()
    bad[3, 0] = np.nan
    with refused("1 vertex is not finite, the first is vertex 3"):
        mesh.with_points(bad)


def test_with_points_stays_in_the_plane():
    flat, tilted = flat_and_tilted()
    with refused("the points do not lie in one plane"):
        tilted.with_points(tilted.points + np.random.default_rng(0).normal(size=(1, 3)) * 0.1
                           * (np.arange(tilted.n_vertices) == 3)[:, None])  # fmt: skip
    level = Mesh(np.column_stack([flat.points, np.ones(flat.n_vertices)]), flat.cells)
    with refused("the points lie in another plane"):
        level.with_points(tilt(flat.points))
    moved = level.with_points(np.column_stack([flat.points, np.full(flat.n_vertices, 2.0)]))
    assert np.array_equal(moved.points[:, 2], np.full(flat.n_vertices, 2.0))


def test_a_plane_is_as_exact_as_the_digits_of_the_boundary(tmp_path):
    rng = np.random.default_rng(3)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    grid = np.array([(x, y) for y in range(5) for x in range(5)], dtype=float)
    cells = [
        (5 * j + i, 5 * j + i + 1, 5 * j + i + 6, 5 * j + i + 5) for j in range(4) for i in range(4)
    ]
    exact = np.c_[grid, np.zeros(25)] @ axes + (10.0, 20.0, -5.0)
    exact[12] += 0.3 * axes[0]
    for points in (exact, exact.astype(np.float32), exact.round(6), exact.round(4)):
        result = smooth(Mesh(points, cells), "star")
        assert result.after.worst["min_angle"] > 80.0
        # What comes out is a mesh that can be read again.
        Mesh(result.points, cells)
    noisy = exact + 1e-6 * rng.normal(size=exact.shape)
    with pytest.raises(MeshError, match="do not lie in one plane"):
        Mesh(noisy, cells)


@pytest.mark.nojit
def test_cells_are_kept_once():
    quads, triangles = np.array([(0, 1, 4, 3)]), np.array([(1, 2, 4), (2, 5, 4)])
    points, _ = grid(2, 1)
    for blocks in ([quads, triangles], [triangles]):
        mesh = Mesh(points, blocks)
        for kept, block in zip(mesh.cells, blocks, strict=True):
            assert np.array_equal(kept, block)
            assert not np.shares_memory(kept, block)
            assert np.shares_memory(kept, mesh.cell_vertices)
            assert not kept.flags.writeable
