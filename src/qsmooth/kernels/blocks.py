"""Blocks of lanes: the layout of a sweep that the compiler can vectorise.

The movable vertices of one colour are grouped by the make-up of their stars, so many quads and so
many triangles, and cut into blocks of `LANES`. All vertices of a block then run through the same
passes, without a branch or a ragged loop, each in its lane.
"""

from typing import Any, NamedTuple

import numpy as np

from qsmooth._types import BlockArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, inlined_helper, kernel
from qsmooth.kernels.corner_energy import EQUILATERAL, SQUARE, Target
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import NO_VERTEX, Stars

# Vertices in a block: enough to hide latencies, few enough that a large star stays in cache.
LANES = 64
# Columns of `Blocks.table`.
FIRST, SIZE, N_QUADS, N_TRIANGLES, STAR, ROWS = range(6)
N_COLUMNS = 6
# Flags of `Rows.asks`: other shapes than the ideal ones, sizes, walls on shape.
SHAPES, SIZES, WALLS = 1, 2, 4
# What differs by no more than this from the coefficients of an ideal shape is ideal.
ROUNDING = 1e-15


class Blocks(NamedTuple):
    """The movable vertices in blocks of lanes whose stars are made up alike.

    Attributes
    ----------
    colour_blocks : (n_colours + 1,)
        CSR map from a colour to its blocks.
    table : (n_blocks, 6)
        First vertex, vertices, quads a star, triangles a star, start in `stars`, start in `cells`.
    vertices : (n_movable,)
        The vertices in the order of the blocks.
    stars : (n_entries,)
        For each block one row of its size for each corner: a, b, c of the first quad, ..., then a,
        c of the first triangle, ...
    cells : (n_rows,)
        For each block one row of its size for each cell: the first quad, ..., the first triangle,
        ...
    largest
        Cells in the largest star.
    rails
        Where the vertices may be.
    """

    colour_blocks: IndexArray
    table: BlockArray
    vertices: TableArray
    stars: TableArray
    cells: TableArray
    largest: int
    rails: Rails


class Rows(NamedTuple):
    """What is asked of each cell around each vertex, in the order of `Blocks.cells`.

    Attributes
    ----------
    asks : (n_blocks,)
        What a block asks for beside ideal shapes of any size: a sum of `SHAPES`, `SIZES`, `WALLS`.
        What is not asked for there is not looked up, and what no block asks for has no rows: (0,)
        in place of (n_rows,) below. Walls on badness look up `slim` and `near` in all blocks.
    m11, m12, m22 : (n_rows,)
        The target shape at the corner of the vertex (`corner_energy.Target`); in quads m12 is 0.
    area, inv_area : (n_rows,)
        Target of the corners' determinants, and one over it; both 0 where size does not count.
    size_weight : (n_rows,)
        Weight of the size term.
    slim : (n_rows,)
        One over the shape energy at which the wall on a cell's shape is 1 high; 0 for no wall.
    near : (n_rows,)
        The threshold of the wall on badness is divided by this.
    """

    asks: IndexArray
    m11: FloatArray
    m12: FloatArray
    m22: FloatArray
    area: FloatArray
    inv_area: FloatArray
    size_weight: FloatArray
    slim: FloatArray
    near: FloatArray


class Block(NamedTuple):
    """One row of `Blocks.table`."""

    first: int
    size: int
    n_quads: int
    n_triangles: int
    start: int
    rows: int


@inlined_helper()
def block_at(table: BlockArray, b: int) -> Block:
    """Look up block b."""
    return Block(
        table[b, FIRST],
        table[b, SIZE],
        table[b, N_QUADS],
        table[b, N_TRIANGLES],
        table[b, STAR],
        table[b, ROWS],
    )


def lane_row(k: int) -> Any:
    """Offset of row k in a flat array of rows of lanes."""
    return np.uint64(k * LANES)


@helper()
def _in_order(kind: IndexArray, colour_offsets: IndexArray, largest: int) -> IndexArray:
    """Order vertices by make-up within each colour: by counting, triangles before quads."""
    rows, spare = np.empty(kind.size, np.int64), np.empty(kind.size, np.int64)
    for i in range(kind.size):
        rows[i] = i
    counts = np.empty(largest + 2, np.int64)
    for shift in (0, 32):
        for colour in range(colour_offsets.size - 1):
            start, stop = colour_offsets[colour], colour_offsets[colour + 1]
            for k in range(largest + 2):
                counts[k] = 0
            for i in range(start, stop):
                counts[(kind[i] >> shift & 0xFFFFFFFF) + 1] += 1
            for k in range(largest + 1):
                counts[k + 1] += counts[k]
            for i in range(start, stop):
                k = kind[rows[i]] >> shift & 0xFFFFFFFF
                spare[start + counts[k]] = rows[i]
                counts[k] += 1
        rows, spare = spare, rows
    return rows


@kernel()
def build_blocks(stars: Stars) -> Blocks:
    """Cut coloured vertices into blocks of equal stars; they may be anywhere.

    Within a colour, blocks come in the order of their make-up, but for hubs, and vertices of one
    make-up in the order they had.
    """
    colour_offsets, listed, offsets, corners, of_rows, largest = stars
    n = listed.size
    kind = np.empty(n, np.int64)
    n_entries = 0
    for i in range(n):
        triangles = 0
        for row in range(offsets[i], offsets[i + 1]):
            triangles += 1 if corners[row, 1] == NO_VERTEX else 0
        quads = offsets[i + 1] - offsets[i] - triangles
        kind[i] = (quads << 32) | triangles
        n_entries += 3 * quads + 2 * triangles
    n_colours = colour_offsets.size - 1
    rows = _in_order(kind, colour_offsets, stars.largest)
    n_blocks = 0
    for colour in range(n_colours):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        size = 0
        for i in range(start, stop):
            if size == LANES or (i > start and kind[rows[i]] != kind[rows[i - 1]]):
                n_blocks += 1
                size = 0
            size += 1
        n_blocks += 1 if size else 0
    table = np.empty((n_blocks, N_COLUMNS), np.uint64)
    colour_blocks = np.empty(n_colours + 1, np.int64)
    colour_blocks[0] = 0
    vertices = np.empty(n, np.uint32)
    entries = np.empty(n_entries, np.uint32)
    cells = np.empty(of_rows.size, np.uint32)
    b, entry, first_row = 0, 0, 0
    for colour in range(n_colours):
        i, stop = colour_offsets[colour], colour_offsets[colour + 1]
        while i < stop:
            size = 1
            while size < LANES and i + size < stop and kind[rows[i + size]] == kind[rows[i]]:
                size += 1
            quads, triangles = kind[rows[i]] >> 32, kind[rows[i]] & 0xFFFFFFFF
            table[b, FIRST], table[b, SIZE] = i, size
            table[b, N_QUADS], table[b, N_TRIANGLES], table[b, STAR] = quads, triangles, entry
            table[b, ROWS] = first_row
            for lane in range(size):
                source = rows[i + lane]
                vertices[i + lane] = listed[source]
                quad_at = entry + lane
                triangle_at = entry + 3 * quads * size + lane
                quad_row = first_row + lane
                triangle_row = first_row + quads * size + lane
                for row in range(offsets[source], offsets[source + 1]):
                    if corners[row, 1] == NO_VERTEX:
                        entries[triangle_at] = corners[row, 0]
                        entries[triangle_at + size] = corners[row, 2]
                        triangle_at += 2 * size
                        cells[triangle_row] = of_rows[row]
                        triangle_row += size
                    else:
                        for k in range(3):
                            entries[quad_at + k * size] = corners[row, k]
                        quad_at += 3 * size
                        cells[quad_row] = of_rows[row]
                        quad_row += size
            entry += (3 * quads + 2 * triangles) * size
            first_row += (quads + triangles) * size
            i += size
            b += 1
        colour_blocks[colour + 1] = b
    free = Rails(np.empty((0, 2)), np.empty(0), np.empty((0, 2)))
    return Blocks(colour_blocks, table, vertices, entries, cells, largest, free)


@kernel()
def row_corners(blocks: Blocks, cell_offsets: IndexArray, cell_vertices: IndexArray) -> IndexArray:
    """Find the position in `cell_vertices` of each row's vertex in its cell, (n_rows,)."""
    out = np.empty(blocks.cells.size, np.int64)
    for b in range(blocks.table.shape[0]):
        size = np.int64(blocks.table[b, SIZE])
        first, row = np.int64(blocks.table[b, FIRST]), np.int64(blocks.table[b, ROWS])
        n_cells = np.int64(blocks.table[b, N_QUADS] + blocks.table[b, N_TRIANGLES])
        for k in range(n_cells):
            for i in range(size):
                c = blocks.cells[row + k * size + i]
                v = blocks.vertices[first + i]
                for position in range(cell_offsets[c], cell_offsets[c + 1]):
                    if cell_vertices[position] == v:
                        out[row + k * size + i] = position
    return out


@helper()
def _shape_of_row(
    shapes: FloatArray, row_corners: IndexArray, row: int, ideal: Target, weight: float
) -> Target:
    """Look up the target shape at a row's corner, times what it counts; ideal without corners."""
    if row_corners.size == 0:
        return Target(ideal.m11 * weight, ideal.m12 * weight, ideal.m22 * weight)
    k = row_corners[row]
    return Target(shapes[k, 0] * weight, shapes[k, 1] * weight, shapes[k, 2] * weight)


@kernel()
def make_rows(
    blocks: Blocks,
    row_corners: IndexArray,
    shapes: FloatArray,
    area: FloatArray,
    size_weight: FloatArray,
    slim: FloatArray,
    weight: FloatArray,
    wanted: int = SHAPES | SIZES | WALLS,
) -> Rows:
    """Put together what is asked of each row, and find out what each block asks for.

    Parameters
    ----------
    row_corners : (n_rows,)
        As `row_corners` finds them; (0,) where all shapes are ideal, and are not looked up.
    shapes : (n_corners, 3)
        m11, m12, m22 at each corner.
    area, size_weight, slim : (n_cells,)
        As in `Rows`; areas where the weight is 0 do not count.
    weight : (n_cells,)
        How much the shape energy of a cell counts; its wall stands where it stood.
    wanted
        A sum of `SHAPES`, `SIZES`, `WALLS`: what has rows even if no block asks for it.
    """
    table, cells = blocks.table, blocks.cells
    asks, found = np.empty(table.shape[0], np.int64), np.int64(wanted)
    for b in range(table.shape[0]):
        size, first = np.int64(table[b, SIZE]), np.int64(table[b, ROWS])
        n_quads = np.int64(table[b, N_QUADS])
        shaped, sized, walled = False, False, False
        for k in range(n_quads + np.int64(table[b, N_TRIANGLES])):
            ideal = SQUARE if k < n_quads else EQUILATERAL
            for row in range(first + k * size, first + (k + 1) * size):
                c = cells[row]
                m = _shape_of_row(shapes, row_corners, row, ideal, weight[c])
                off = max(abs(m.m11 - ideal.m11), abs(m.m12 - ideal.m12), abs(m.m22 - ideal.m22))
                shaped |= off > ROUNDING
                sized |= size_weight[c] > 0.0
                walled |= slim[c] / weight[c] > 0.0
        asks[b] = SHAPES * shaped + SIZES * sized + WALLS * walled
        found |= asks[b]
    n_shapes = cells.size if found & SHAPES else 0
    n_sizes = cells.size if found & SIZES else 0
    n_walls = cells.size if found & WALLS else 0
    m11, m12, m22 = np.empty(n_shapes), np.empty(n_shapes), np.empty(n_shapes)
    areas, inv_areas, size_weights = np.empty(n_sizes), np.empty(n_sizes), np.empty(n_sizes)
    slims, near = np.empty(n_walls), np.empty(n_walls)
    for b in range(table.shape[0] if found else 0):
        size, first = np.int64(table[b, SIZE]), np.int64(table[b, ROWS])
        n_quads = np.int64(table[b, N_QUADS])
        for row in range(first, first + size * (n_quads + np.int64(table[b, N_TRIANGLES]))):
            c = cells[row]
            if n_shapes:
                ideal = SQUARE if row < first + size * n_quads else EQUILATERAL
                m = _shape_of_row(shapes, row_corners, row, ideal, weight[c])
                m11[row], m12[row], m22[row] = m.m11, m.m12, m.m22
            if n_sizes:
                counts = size_weight[c] > 0.0 and area[c] > 0.0
                areas[row] = area[c] if counts else 0.0
                inv_areas[row] = 1.0 / area[c] if counts else 0.0
                size_weights[row] = size_weight[c]
            if n_walls:
                slims[row], near[row] = slim[c] / weight[c], 1.0
    return Rows(asks, m11, m12, m22, areas, inv_areas, size_weights, slims, near)
