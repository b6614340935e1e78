"""Blocks of lanes: every vertex once, in its colour, with its own star."""

import itertools

import numpy as np
import pytest
from hypothesis import given

from meshes import KINDS, grid, random_mesh, random_meshes
from qsmooth import Mesh
from qsmooth.kernels.blocks import (
    FIRST,
    LANES,
    N_QUADS,
    N_TRIANGLES,
    ROWS,
    SHAPES,
    SIZE,
    SIZES,
    STAR,
    WALLS,
    build_blocks,
    make_rows,
    row_corners,
)
from qsmooth.kernels.corner_energy import EQUILATERAL, SQUARE
from qsmooth.kernels.stars import NO_VERTEX


def blocks_of(mesh):
    schedule = mesh.topology.schedule(True)
    return schedule, build_blocks(schedule)


def rows_of(schedule, i):
    """Quads (a, b, c) and triangles (a, c) of one vertex of a schedule, and all their cells."""
    rows = schedule.corners[schedule.offsets[i] : schedule.offsets[i + 1]].tolist()
    cells = schedule.cells[schedule.offsets[i] : schedule.offsets[i + 1]].tolist()
    both = list(zip(rows, cells, strict=True))
    quads = [(tuple(row), c) for row, c in both if row[1] != NO_VERTEX]
    triangles = [((row[0], row[2]), c) for row, c in both if row[1] == NO_VERTEX]
    return [q for q, _ in quads], [t for t, _ in triangles], [c for _, c in quads + triangles]


def check(mesh):
    schedule, made = blocks_of(mesh)
    colour_blocks, blocks, vertices, stars, cells, largest, _ = made
    corners_of_rows = row_corners(made, *mesh.topology.cells)
    n = schedule.vertices.size
    assert largest == schedule.largest
    position = {v: i for i, v in enumerate(schedule.vertices.tolist())}
    rows = [position[v] for v in vertices.tolist()]
    assert sorted(rows) == list(range(n))
    assert colour_blocks[0] == 0
    assert colour_blocks[-1] == len(blocks)
    first, entry, first_row = 0, 0, 0
    for colour, (start, stop) in enumerate(itertools.pairwise(colour_blocks)):
        for block in blocks[start:stop].astype(int):
            size, n_quads, n_triangles = block[SIZE], block[N_QUADS], block[N_TRIANGLES]
            assert 1 <= size <= LANES
            assert block[FIRST] == first
            assert block[STAR] == entry
            assert block[ROWS] == first_row
            n_corners = 3 * n_quads + 2 * n_triangles
            table = stars[entry : entry + n_corners * size].reshape(n_corners, size)
            n_rows = (n_quads + n_triangles) * size
            in_rows = cells[first_row : first_row + n_rows].reshape(-1, size)
            positions = corners_of_rows[first_row : first_row + n_rows].reshape(-1, size)
            for lane in range(size):
                quads, triangles, own = rows_of(schedule, rows[first + lane])
                assert in_rows[:, lane].tolist() == own
                assert (mesh.topology.corner_cells[positions[:, lane]] == own).all()
                assert (mesh.cell_vertices[positions[:, lane]] == vertices[first + lane]).all()
                corners = table[:, lane].tolist()
                assert [tuple(q) for q in np.reshape(corners[: 3 * n_quads], (-1, 3))] == quads
                pairs = np.reshape(corners[3 * n_quads :], (-1, 2))
                assert [tuple(p) for p in pairs] == triangles
            first, entry, first_row = first + size, entry + n_corners * size, first_row + n_rows
        assert first == schedule.colour_offsets[colour + 1]
    assert first == n
    assert entry == stars.size
    assert first_row == cells.size == corners_of_rows.size


@pytest.mark.nojit
@pytest.mark.parametrize("kind", KINDS)
def test_every_vertex_is_in_one_block_with_its_star(kind):
    check(random_mesh(kind, 5, seed=1).mesh)


@given(random_meshes())
def test_blocks_of_any_mesh(made):
    check(made.mesh)


@pytest.mark.nojit
def test_blocks_are_full_where_all_stars_are_alike():
    schedule, (colour_blocks, blocks, *_) = blocks_of(Mesh(*grid(21, 21)))
    sizes = np.diff(schedule.colour_offsets)
    assert np.diff(colour_blocks).tolist() == (-(-sizes // LANES)).tolist()
    full = [[*[LANES] * (size // LANES), size % LANES] for size in sizes.tolist()]
    assert blocks[:, SIZE].tolist() == [size for colour in full for size in colour if size]
    assert set(blocks[:, N_QUADS].tolist()) == {4}
    assert not blocks[:, N_TRIANGLES].any()


@pytest.mark.nojit
def test_no_movable_vertex_makes_no_block():
    _, (colour_blocks, blocks, vertices, stars, cells, largest, _) = blocks_of(Mesh(*grid(1, 3)))
    assert colour_blocks[-1] == 0
    assert len(blocks) == vertices.size == stars.size == cells.size == largest == 0


# ------------------------------------------------------------------------------- what is asked


def asked_of(mesh):
    """Blocks of a mesh, the corners of their rows, and what asks for nothing but ideal shapes."""
    _, blocks = blocks_of(mesh)
    is_triangle = mesh.topology.cell_sizes == 3
    shapes = np.where(is_triangle[mesh.topology.corner_cells, None], EQUILATERAL, SQUARE)
    figures = np.zeros((3, mesh.n_cells))
    return blocks, row_corners(blocks, *mesh.topology.cells), (shapes, *figures)


def of_blocks(blocks, of_rows):
    """Whether any row of each block is marked."""
    starts = blocks.table[:, ROWS].astype(int)
    return [bool(some.any()) for some in np.split(of_rows, starts[1:])]


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_ideal_shapes_of_any_size_ask_for_nothing(kind):
    mesh = random_mesh(kind, 5, seed=1).mesh
    blocks, corners, asked = asked_of(mesh)
    rows = make_rows(blocks, corners, *asked, np.ones(mesh.n_cells))
    assert not rows.asks.any()
    assert rows.asks.size == len(blocks.table)
    assert (rows.near == 1.0).all()
    assert rows.near.size == blocks.cells.size


@pytest.mark.nojit
def test_what_no_block_asks_for_has_no_rows():
    mesh = random_mesh("mixed", 5, seed=1).mesh
    blocks, corners, (shapes, area, size_weight, slim) = asked_of(mesh)
    one, n = np.ones(mesh.n_cells), blocks.cells.size
    of_groups = []
    for figures in (np.zeros_like(slim), slim), (one, slim), (np.zeros_like(slim), one):
        rows = make_rows(blocks, corners, shapes, area, *figures, one, 0)
        sizes = [values.size for values in rows[1:]]
        of_groups.append([set(sizes[:3]), set(sizes[3:6]), set(sizes[6:])])
    assert of_groups == [[{0}, {0}, {0}], [{0}, {n}, {0}], [{0}, {0}, {n}]]
    rows = make_rows(blocks, corners, 2.0 * shapes, area, size_weight, slim, one, 0)
    assert [values.size for values in rows[1:]] == [n] * 3 + [0] * 5


@pytest.mark.nojit
def test_ideal_shapes_need_no_corners():
    mesh = random_mesh("mixed", 5, seed=1).mesh
    blocks, corners, asked = asked_of(mesh)
    weight, wanted = np.linspace(0.5, 2.0, mesh.n_cells), SHAPES | SIZES | WALLS
    looked_up = make_rows(blocks, corners, *asked, weight, wanted)
    known = make_rows(blocks, corners[:0], *asked, weight, wanted)
    for first, second in zip(looked_up, known, strict=True):
        assert first.tobytes() == second.tobytes()


@pytest.mark.nojit
def test_a_block_asks_for_what_one_of_its_rows_does():
    mesh = random_mesh("mixed", 6, seed=1).mesh
    blocks, corners, (shapes, area, size_weight, slim) = asked_of(mesh)
    first, last = blocks.cells[0], blocks.cells[-1]
    area[:] = 2.0
    shapes[corners[3]] *= 1.5
    size_weight[first], slim[last] = 0.3, 0.7
    rows = make_rows(blocks, corners, shapes, area, size_weight, slim, np.ones(mesh.n_cells))
    of_cell = blocks.cells
    for flag, marked in (
        (SHAPES, corners == corners[3]),
        (SIZES, of_cell == first),
        (WALLS, of_cell == last),
    ):
        assert ((rows.asks & flag) > 0).tolist() == of_blocks(blocks, marked)
        assert 0 < sum(of_blocks(blocks, marked)) < len(blocks.table)
    assert np.array_equal(np.stack([rows.m11, rows.m12, rows.m22], axis=1), shapes[corners])
    assert np.array_equal(rows.slim, slim[of_cell])
    # Areas that do not count are none.
    assert np.array_equal(rows.area, np.where(of_cell == first, 2.0, 0.0))
    assert np.array_equal(rows.inv_area, np.where(of_cell == first, 0.5, 0.0))


@pytest.mark.nojit
def test_cells_that_count_for_more_have_their_walls_where_they_were():
    mesh = random_mesh("mixed", 6, seed=1).mesh
    blocks, corners, (shapes, area, size_weight, slim) = asked_of(mesh)
    weight = np.linspace(0.5, 2.0, mesh.n_cells)
    slim[:] = 0.7
    rows = make_rows(blocks, corners, shapes, area, size_weight, slim, weight)
    counts = weight[blocks.cells]
    assert rows.m11 == pytest.approx(counts * shapes[corners, 0])
    assert rows.slim * counts == pytest.approx(np.full(counts.size, 0.7))


@pytest.mark.nojit
def test_where_no_vertex_moves_nothing_is_asked():
    mesh = Mesh(*grid(1, 3))
    blocks, corners, asked = asked_of(mesh)
    rows = make_rows(blocks, corners, *asked, np.ones(mesh.n_cells))
    assert rows.asks.size == rows.m11.size == rows.near.size == 0
