"""What a session keeps track of between calls: which blocks of vertices rest, which cells changed.

A block of lanes rests when none of its vertices moved by more than a share of its shortest edge the
last time that it was visited, and nothing around it has moved since. Cells are measured again in
chunks of `LANES`, where one of them has changed.
"""

import math

import numpy as np

from qsmooth._types import BlockArray, BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, kernel, lane_helper
from qsmooth.kernels.blocks import (
    FIRST,
    LANES,
    N_COLUMNS,
    N_QUADS,
    N_TRIANGLES,
    ROWS,
    SIZE,
    lane_row,
)
from qsmooth.kernels.cell_lanes import (
    N_PLACES,
    X0,
    X1,
    X2,
    X3,
    Y0,
    Y1,
    Y2,
    Y3,
    gather_cells,
    store_lanes,
)
from qsmooth.kernels.geometry import certainly_left
from qsmooth.kernels.star_energy import SINE_60

# Rows of figures: the largest and the smallest cosine and the smallest sine of a cell's corners
# that can change, and the smallest sine of all, in a triangle over that of 60 degrees, each squared
# with its sign kept; 1 where the cell is valid beyond rounding, else 0.
MOST_COSINE, LEAST_COSINE, LEAST_SINE, WORST_SINE, SURE = range(5)
N_FIGURES = 5
# The same as rows of lanes, and whether each corner counts.
MOST, LEAST, SINE, WORST, CERTAIN, COUNTS = (lane_row(k) for k in range(6))
NEXT = lane_row(1)
N_ROWS = 9
IN_A_TRIANGLE = 1.0 / SINE_60**2


@kernel()
def take_in(given: FloatArray, xy: FloatArray, largest: float, changed: BoolArray) -> int:
    """Put other coordinates in the place of those that are there, and mark where they differ.

    Parameters
    ----------
    given, xy : (n_vertices, 2)
        `xy` is overwritten.
    largest
        Largest coordinate.
    changed : (n_vertices,)
        Overwritten.

    Returns
    -------
    n_changed
        -1 where a coordinate is too large or not finite; nothing is put in place then.
    """
    for v in range(given.shape[0]):
        if not (abs(given[v, 0]) <= largest and abs(given[v, 1]) <= largest):
            return -1
    count = 0
    for v in range(given.shape[0]):
        x, y = given[v, 0], given[v, 1]
        differs = x != xy[v, 0] or y != xy[v, 1]
        xy[v, 0], xy[v, 1] = x, y
        changed[v] = differs
        count += differs
    return count


@kernel()
def wake_around(
    changed: BoolArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    block_of: IndexArray,
    awake: BoolArray,
    dirty: BoolArray,
) -> None:
    """Wake the blocks of the vertices around changed ones, and mark the chunks of their cells.

    Parameters
    ----------
    changed : (n_vertices,)
        As by `take_in`.
    block_of : (n_vertices,)
        Block of each vertex, -1 of one that does not move.
    awake, dirty : (n_blocks,), (n_chunks,)
        Set to true there, left as they are elsewhere.
    """
    for v in range(changed.size):
        if changed[v]:
            for k in range(star_offsets[v], star_offsets[v + 1]):
                c = star_cells[k]
                dirty[c // LANES] = True
                for j in range(cell_offsets[c], cell_offsets[c + 1]):
                    block = block_of[cell_vertices[j]]
                    if block >= 0:
                        awake[block] = True


@kernel()
def number_blocks(table: BlockArray, vertices: TableArray, block_of: IndexArray) -> None:
    """Write down the block of each listed vertex; the others' entries are left as they are."""
    for b in range(table.shape[0]):
        first = np.int64(table[b, FIRST])
        for i in range(first, first + np.int64(table[b, SIZE])):
            block_of[vertices[i]] = b


@kernel()
def block_neighbours(
    table: BlockArray,
    cells: TableArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    block_of: IndexArray,
) -> tuple[IndexArray, IndexArray]:
    """Find the blocks that share a cell with each block, itself among them: a CSR map."""
    n = table.shape[0]
    offsets, seen = np.zeros(n + 1, np.int64), np.full(n, -1, np.int64)
    found = np.empty(0, np.int64)
    for fill in range(2):
        count = 0
        for b in range(n):
            first = np.int64(table[b, ROWS])
            rows = np.int64(table[b, SIZE] * (table[b, N_QUADS] + table[b, N_TRIANGLES]))
            for row in range(first, first + rows):
                c = cells[row]
                for j in range(cell_offsets[c], cell_offsets[c + 1]):
                    other = block_of[cell_vertices[j]]
                    if other >= 0 and seen[other] != 2 * b + fill:
                        seen[other] = 2 * b + fill
                        if fill:
                            found[count] = other
                        count += 1
            offsets[b + 1] = count
        if not fill:
            found = np.empty(count, np.int64)
    return offsets, found


@kernel()
def select(
    table: BlockArray,
    colour_blocks: IndexArray,
    asks: IndexArray,
    awake: BoolArray,
    chosen: BoolArray,
    wanted: bool,
    table_out: BlockArray,
    colour_blocks_out: IndexArray,
    asks_out: IndexArray,
    blocks_out: IndexArray,
) -> int:
    """Gather the rows of the awake blocks that are, or are not, chosen.

    Parameters
    ----------
    table, colour_blocks, asks
        Of all blocks, as in `blocks.Blocks` and `blocks.Rows`.
    awake, chosen : (n_blocks,)
        Those are gathered that are awake, and as chosen as is wanted.
    table_out, colour_blocks_out, asks_out
        Overwritten: the same of these blocks, as many rows as there are.
    blocks_out : (n_blocks,)
        Overwritten: numbers of these blocks.

    Returns
    -------
    n_selected
    """
    n = 0
    colour_blocks_out[0] = 0
    for colour in range(colour_blocks.size - 1):
        for b in range(colour_blocks[colour], colour_blocks[colour + 1]):
            if awake[b] and chosen[b] == wanted:
                for k in range(N_COLUMNS):
                    table_out[n, k] = table[b, k]
                asks_out[n], blocks_out[n] = asks[b], b
                n += 1
        colour_blocks_out[colour + 1] = n
    return n


@kernel()
def settle(
    xy: FloatArray,
    table: BlockArray,
    vertices: TableArray,
    blocks: IndexArray,
    lengths: FloatArray,
    ring_offsets: IndexArray,
    ring_vertices: IndexArray,
    neighbour_offsets: IndexArray,
    neighbours: IndexArray,
    rtol: float,
    touched: BoolArray,
    awake: BoolArray,
) -> None:
    """Wake the blocks around those that a sweep has moved.

    Parameters
    ----------
    table, blocks
        The blocks that were swept, and their numbers (`select`), (n_selected,).
    vertices, lengths : (n_movable,)
        As in `blocks.Blocks`, and how far each of these moved.
    neighbour_offsets, neighbours
        As by `block_neighbours`.
    rtol
        A vertex rests that moved by no more than this share of its shortest edge.
    touched, awake : (n_blocks,)
        Set to true: blocks in which a vertex moved; those around one that does not rest.
    """
    for at in range(blocks.size):
        b = blocks[at]
        first = np.int64(table[at, FIRST])
        moved, rests = False, True
        for i in range(first, first + np.int64(table[at, SIZE])):
            if lengths[i] > 0.0:
                moved = True
                if not rests:
                    break
                v = vertices[i]
                shortest = np.inf
                for k in range(ring_offsets[v], ring_offsets[v + 1]):
                    w = ring_vertices[k]
                    dx, dy = xy[w, 0] - xy[v, 0], xy[w, 1] - xy[v, 1]
                    shortest = min(shortest, dx * dx + dy * dy)
                rests = lengths[i] <= rtol * math.sqrt(shortest)
        if moved:
            touched[b] = True
        if not rests:
            for k in range(neighbour_offsets[b], neighbour_offsets[b + 1]):
                awake[neighbours[k]] = True


@kernel()
def mark_chunks(table: BlockArray, cells: TableArray, touched: BoolArray, dirty: BoolArray) -> None:
    """Mark the chunks of the cells of touched blocks, and take these for untouched again."""
    for b in range(table.shape[0]):
        if touched[b]:
            touched[b] = False
            first = np.int64(table[b, ROWS])
            rows = np.int64(table[b, SIZE] * (table[b, N_QUADS] + table[b, N_TRIANGLES]))
            for row in range(first, first + rows):
                dirty[cells[row] // LANES] = True


@kernel()
def mark_low(
    table: BlockArray, cells: TableArray, awake: BoolArray, sines: FloatArray, least: float,
    enough: float, low: BoolArray,
) -> None:  # fmt: skip
    """Mark the awake blocks with a cell whose smallest sine is too small.

    Parameters
    ----------
    sines
        The row `LEAST_SINE` of figures, (n_cells,).
    least, enough
        Squares like these: a block is marked for a cell below `least`; one that is marked already
        stays so for a cell below `enough`, or it would be marked and not by turns.
    low : (n_blocks,)
        Overwritten for the blocks that are awake.
    """
    for b in range(table.shape[0]):
        if awake[b]:
            limit = enough if low[b] else least
            low[b] = False
            first = np.int64(table[b, ROWS])
            rows = np.int64(table[b, SIZE] * (table[b, N_QUADS] + table[b, N_TRIANGLES]))
            for row in range(first, first + rows):
                if sines[cells[row]] < limit:
                    low[b] = True
                    break


@lane_helper()
def _corner(
    ax: float, ay: float, bx: float, by: float, dx: float, dy: float
) -> tuple[float, float, float]:
    """Signed squares of a corner's cosine and sine; and 1 where it is certainly positive, or 0."""
    ux, uy, wx, wy = bx - ax, by - ay, dx - ax, dy - ay
    det, dot = ux * wy - uy * wx, ux * wx + uy * wy
    lengths = (ux * ux + uy * uy) * (wx * wx + wy * wy)
    inv = 1.0 / lengths if lengths > 0.0 else 0.0
    sure = 1.0 if certainly_left(bx, by, dx, dy, ax, ay) else 0.0
    return dot * abs(dot) * inv, det * abs(det) * inv, sure


@lane_helper()
def _add_corner(
    s: FloatArray, i: int, counts: int, ax: float, ay: float, bx: float, by: float,
    dx: float, dy: float,
) -> None:  # fmt: skip
    """Add what a corner says to the figures in its lane."""
    cosine, sine, sure = _corner(ax, ay, bx, by, dx, dy)
    mine = s[counts + i] > 0.0
    s[MOST + i] = max(s[MOST + i], cosine) if mine else s[MOST + i]
    s[LEAST + i] = min(s[LEAST + i], cosine) if mine else s[LEAST + i]
    s[SINE + i] = min(s[SINE + i], sine) if mine else s[SINE + i]
    s[WORST + i] = min(s[WORST + i], sine)
    s[CERTAIN + i] *= sure


@helper()
def _look_at(p: FloatArray, n: int, n_corners: int, s: FloatArray) -> None:
    """Find the figures of the cells in lanes; corners that don't count are as good as can be."""
    for i in range(n):
        s[MOST + i], s[LEAST + i], s[SINE + i] = -1.0, 1.0, np.inf
        s[WORST + i], s[CERTAIN + i] = np.inf, 1.0
    if n_corners == 4:
        for i in range(n):
            ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
            cx, cy, dx, dy = p[X2 + i], p[Y2 + i], p[X3 + i], p[Y3 + i]
            _add_corner(s, i, COUNTS, ax, ay, bx, by, dx, dy)
            _add_corner(s, i, COUNTS + NEXT, bx, by, cx, cy, ax, ay)
            _add_corner(s, i, COUNTS + NEXT + NEXT, cx, cy, dx, dy, bx, by)
            _add_corner(s, i, COUNTS + NEXT + NEXT + NEXT, dx, dy, ax, ay, cx, cy)
    else:
        for i in range(n):
            ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
            cx, cy = p[X2 + i], p[Y2 + i]
            _add_corner(s, i, COUNTS, ax, ay, bx, by, cx, cy)
            _add_corner(s, i, COUNTS + NEXT, bx, by, cx, cy, ax, ay)
            _add_corner(s, i, COUNTS + NEXT + NEXT, cx, cy, ax, ay, bx, by)
            s[SINE + i] *= IN_A_TRIANGLE
            s[WORST + i] *= IN_A_TRIANGLE


@kernel()
def measure_chunks(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    counts: FloatArray,
    dirty: BoolArray,
    figures: FloatArray,
) -> None:
    """Measure the cells of the marked chunks again, and take these for clean.

    Parameters
    ----------
    counts : (n_corners,)
        1 at corners with a movable vertex, which can change, else 0.
    dirty : (n_chunks,)
        Overwritten with false.
    figures : (5, n_cells)
        Overwritten there, as the rows at the head of this module say.
    """
    n_cells = cell_offsets.size - 1
    cells = np.empty(LANES, np.int64)
    p, s = np.empty(N_PLACES * LANES), np.empty(N_ROWS * LANES)
    most, least, sine = figures[MOST_COSINE], figures[LEAST_COSINE], figures[LEAST_SINE]
    worst, sure = figures[WORST_SINE], figures[SURE]
    for chunk in range(dirty.size):
        if not dirty[chunk]:
            continue
        dirty[chunk] = False
        first, last = chunk * LANES, min((chunk + 1) * LANES, n_cells)
        left = last - first
        for n_corners in (4, 3):
            n = gather_cells(xy, cell_offsets, cell_vertices, first, last, n_corners, cells, p)
            if n == 0:
                continue
            for i in range(n):
                k = np.uint64(cell_offsets[cells[i]])
                row = np.uint64(i) + COUNTS
                for _ in range(n_corners):
                    s[row] = counts[k]
                    k, row = k + np.uint64(1), row + NEXT
            _look_at(p, n, n_corners, s)
            store_lanes(s, MOST, cells, n, most)
            store_lanes(s, LEAST, cells, n, least)
            store_lanes(s, SINE, cells, n, sine)
            store_lanes(s, WORST, cells, n, worst)
            store_lanes(s, CERTAIN, cells, n, sure)
            left -= n
            if left == 0:
                break


@helper()
def _signed_root(square: float) -> float:
    return math.copysign(math.sqrt(abs(square)), square)


@kernel()
def worst_figures(figures: FloatArray, regions: IndexArray, worst: FloatArray) -> tuple[float, int]:
    """Find the worst figures of each region, and of all cells.

    Parameters
    ----------
    figures : (5, n_cells)
        As by `measure_chunks`.
    regions : (n_cells,)
        Region of each cell; those with -1, and cells that are not valid, do not count.
    worst : (n_regions, 3)
        Overwritten: the largest cosine, infinitely small where no cell counts, the smallest cosine
        and the smallest sine.

    Returns
    -------
    scaled_jacobian
        The smallest of all cells.
    n_doubtful
        Cells that are not valid, or not beyond rounding.
    """
    for r in range(worst.shape[0]):
        worst[r, 0], worst[r, 1], worst[r, 2] = -np.inf, np.inf, np.inf
    lowest, doubtful = np.inf, 0
    for c in range(regions.size):
        lowest = min(lowest, figures[WORST_SINE, c])
        r = regions[c]
        if figures[SURE, c] == 0.0:
            doubtful += 1
        elif r >= 0:
            worst[r, 0] = max(worst[r, 0], figures[MOST_COSINE, c])
            worst[r, 1] = min(worst[r, 1], figures[LEAST_COSINE, c])
            worst[r, 2] = min(worst[r, 2], figures[LEAST_SINE, c])
    for r in range(worst.shape[0]):
        if worst[r, 0] > -np.inf:
            for k in range(3):
                worst[r, k] = _signed_root(worst[r, k])
    return _signed_root(lowest), doubtful
