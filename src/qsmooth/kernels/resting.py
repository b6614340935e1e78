"""What a session keeps track of between calls: which blocks of vertices rest, which cells changed.

A block of lanes rests when none of its vertices moved by more than a share of its shortest edge the
last time that it was visited, and nothing around it has moved since. Cells are measured again in
chunks of `LANES`, where one of them has changed (`kept_figures`).
"""

import math

import numpy as np

from qsmooth._types import BlockArray, BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import kernel
from qsmooth.kernels.blocks import FIRST, LANES, N_COLUMNS, N_QUADS, N_TRIANGLES, ROWS, SIZE


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
def host_factor(
    given: FloatArray, xy: FloatArray, moves: FloatArray, movable: BoolArray
) -> tuple[float, float]:
    """Compare how far the vertices that do not move by themselves come with the step before.

    Parameters
    ----------
    given, xy, moves : (n_vertices, 2)
        Where they are put, where they were, and how far they came in the step before.
    movable : (n_vertices,)
        Those that do not count.

    Returns
    -------
    factor
        Multiple of the step before that comes nearest, 0 where nothing moved in one of the two.
    likeness
        Square of the cosine between the two.
    """
    now, before, both = 0.0, 0.0, 0.0
    for v in range(movable.size):
        if not movable[v]:
            x, y = given[v, 0] - xy[v, 0], given[v, 1] - xy[v, 1]
            now += x * x + y * y
            before += moves[v, 0] * moves[v, 0] + moves[v, 1] * moves[v, 1]
            both += x * moves[v, 0] + y * moves[v, 1]
    if now * before > 0.0:
        return both / before, both * both / (now * before)
    return 0.0, 0.0


@kernel()
def follow(
    xy: FloatArray,
    moves: FloatArray,
    factor: float,
    movable: BoolArray,
    changed: BoolArray,
    ring_offsets: IndexArray,
    ring_vertices: IndexArray,
    rtol: float,
    out: FloatArray,
) -> None:
    """Let vertices go on as in the step before, but for those that the host has moved.

    Parameters
    ----------
    xy, moves : (n_vertices, 2)
        Where they are, and how far they came.
    factor
        By what multiple of that they go on.
    movable, changed : (n_vertices,)
        Those that may, and those that the host has moved (`take_in`).
    rtol
        Moves of no more than this share of the shortest edge are left out.
    out : (n_vertices, 2)
        Overwritten.
    """
    for v in range(movable.size):
        x, y = xy[v, 0], xy[v, 1]
        out[v, 0], out[v, 1] = x, y
        dx, dy = factor * moves[v, 0], factor * moves[v, 1]
        if movable[v] and not changed[v] and (dx != 0.0 or dy != 0.0):
            shortest = np.inf
            for k in range(ring_offsets[v], ring_offsets[v + 1]):
                w = ring_vertices[k]
                ux, uy = xy[w, 0] - x, xy[w, 1] - y
                shortest = min(shortest, ux * ux + uy * uy)
            if dx * dx + dy * dy > rtol * rtol * shortest:
                out[v, 0], out[v, 1] = x + dx, y + dy


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
        The row `LEAST_SINE` of `kept_figures`, (n_cells,).
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
