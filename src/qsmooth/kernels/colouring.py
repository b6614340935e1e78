"""From the movable vertices to `stars.Stars`: colours, their order, the table of cells.

These kernels run once per set of movable vertices and are linear in its size; they allocate what
they return. `qsmooth.schedule` puts them together.
"""

from typing import Any

import numpy as np

from qsmooth._types import BoolArray, ColourArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, inlined_helper, kernel
from qsmooth.kernels.stars import NO_VERTEX

# The colours in a cell are bits of a word. First fit in random order takes about ten; a vertex that
# finds none of these free is given one more, which is refused (`qsmooth.schedule`).
MOST_COLOURS = 64
ONE: Any = np.uint64(1)
# The lowest bit that is not set, of each byte: a loop over bits costs a wrong guess each time.
BYTE: Any = np.uint64(0xFF)
LOWEST_FREE = np.array([(~byte & (byte + 1)).bit_length() - 1 for byte in range(256)])


@helper()
def priority(vertex: int) -> Any:
    """Hash an id, one to one (the finaliser of MurmurHash3)."""
    h = np.uint64(vertex)
    h = (h ^ (h >> np.uint64(33))) * np.uint64(0xFF51AFD7ED558CCD)
    h = (h ^ (h >> np.uint64(33))) * np.uint64(0xC4CEB9FE1A85EC53)
    return h ^ (h >> np.uint64(33))


@inlined_helper()
def free_colour(v: int, taken: Any, star_offsets: IndexArray, star_cells: IndexArray) -> Any:
    """Find the smallest colour that none of a vertex's cells has; `MOST_COLOURS` where none is."""
    seen = ONE - ONE
    for s in range(star_offsets[v], star_offsets[v + 1]):
        seen |= taken[star_cells[s]]
    bits, colour = seen & BYTE, 0
    while bits == BYTE and colour < MOST_COLOURS - 8:
        colour += 8
        bits = (seen >> np.uint64(colour)) & BYTE
    return colour + LOWEST_FREE[bits]


@helper()
def _turns(
    movable: BoolArray, ids: IndexArray, cell_offsets: IndexArray, cell_vertices: IndexArray
) -> TableArray:
    """List each cell's movable corners in the order of their priorities, then n_vertices (nobody).

    Cell c's part, (corners + 1,), begins at ``cell_offsets[c] + c``.
    """
    priorities = np.empty(movable.size, np.uint64)
    for v in range(movable.size):
        priorities[v] = priority(ids[v])
    out = np.empty(cell_vertices.size + cell_offsets.size - 1, np.uint32)
    for k in range(out.size):
        out[k] = movable.size
    for c in range(cell_offsets.size - 1):
        first = cell_offsets[c] + c
        stop = first
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            v = cell_vertices[k]
            if movable[v]:
                at = stop
                while at > first and priorities[out[at - 1]] < priorities[v]:
                    out[at] = out[at - 1]
                    at -= 1
                out[at] = v
                stop += 1
    return out


@kernel()
def first_fit(
    movable: BoolArray,
    ids: IndexArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
) -> tuple[ColourArray, Any]:
    """Give each movable vertex the smallest colour that those of higher priority leave.

    A vertex is due when it is the next in each of its cells.

    Parameters
    ----------
    ids : (n_vertices,)
        The numbers that priorities are made from.

    Returns
    -------
    colour : (n_vertices,)
        -1 where a vertex does not move.
    taken : (n_cells,)
        The colours in each cell, a bit each.
    """
    n_vertices, n_cells = movable.size, cell_offsets.size - 1
    turns = _turns(movable, ids, cell_offsets, cell_vertices)
    colour, taken = np.empty(n_vertices, np.int8), np.zeros(n_cells, np.uint64)
    at, waits = np.empty(n_cells, np.uint32), np.empty(n_vertices + 1, np.uint32)
    for v in range(n_vertices):
        colour[v] = -1
        waits[v] = star_offsets[v + 1] - star_offsets[v]
    waits[n_vertices] = NO_VERTEX  # nobody is never due
    for c in range(n_cells):
        at[c] = cell_offsets[c] + c
        waits[turns[at[c]]] -= 1
    due = np.empty(n_vertices + 1, np.uint32)
    for seed in range(n_vertices):
        if not movable[seed] or waits[seed] != 0 or colour[seed] >= 0:
            continue
        due[0] = seed
        head, n_due = 0, 1
        while head < n_due:
            v = due[head]
            head += 1
            mine = free_colour(v, taken, star_offsets, star_cells)
            colour[v] = mine
            for s in range(star_offsets[v], star_offsets[v + 1]):
                c = star_cells[s]
                taken[c] |= ONE << np.uint64(mine)
                at[c] += 1
                w = turns[at[c]]
                waits[w] -= 1
                # Written in any case: a branch would be guessed wrongly half the time.
                due[n_due] = w
                n_due += 1 if waits[w] == 0 else 0
    return colour, taken


@kernel()
def choose_anew(
    colour: ColourArray,
    taken: Any,
    listed: TableArray,
    n_colours: int,
    turn: int,
    star_offsets: IndexArray,
    star_cells: IndexArray,
) -> int:
    """Let the listed vertices choose anew, whole colours at a time: first from `n_colours` on.

    Parameters
    ----------
    colour, taken
        As `first_fit` gives them; changed in place.
    listed
        Changed, see below.
    turn
        How far the order of the colours is turned: without, the last comes first.

    Returns
    -------
    int
        How many have `n_colours` or beyond; they are the first of `listed` now.
    """
    offsets, by_colour = np.zeros(MOST_COLOURS + 2, np.int64), np.empty(listed.size, np.uint32)
    for v in listed:
        offsets[colour[v] + 1] += 1
    for c in range(MOST_COLOURS + 1):
        offsets[c + 1] += offsets[c]
    fill = offsets.copy()
    for v in listed:
        mine = colour[v]
        by_colour[fill[mine]] = v
        fill[mine] += 1
        others = ~(ONE << np.uint64(mine))
        for s in range(star_offsets[v], star_offsets[v + 1]):
            taken[star_cells[s]] &= others
    beyond = 0
    for step in range(MOST_COLOURS, -1, -1):
        old = step if step >= n_colours else (step + turn) % n_colours
        for i in range(offsets[old], offsets[old + 1]):
            v = by_colour[i]
            mine = free_colour(v, taken, star_offsets, star_cells)
            colour[v] = mine
            for s in range(star_offsets[v], star_offsets[v + 1]):
                taken[star_cells[s]] |= ONE << np.uint64(mine)
            if mine >= n_colours:
                listed[beyond] = v
                beyond += 1
    return beyond


@kernel()
def with_neighbours(
    listed: TableArray,
    colour: ColourArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    is_listed: BoolArray,
    out: TableArray,
) -> int:
    """List the vertices that share a cell with a listed one, these too, if they have a colour.

    Parameters
    ----------
    is_listed : (n_vertices,)
        False everywhere, before and after.
    out : (n_vertices,)
        Overwritten.

    Returns
    -------
    int
        How many.
    """
    n = 0
    for v in listed:
        for s in range(star_offsets[v], star_offsets[v + 1]):
            c = star_cells[s]
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                w = cell_vertices[k]
                if colour[w] >= 0 and not is_listed[w]:
                    is_listed[w] = True
                    out[n] = w
                    n += 1
    for i in range(n):
        is_listed[out[i]] = False
    return n


@kernel()
def order_by_colour(colour: ColourArray, n_colours: int) -> tuple[IndexArray, TableArray]:
    """List the movable vertices colour by colour, in the order of memory within each.

    Returns
    -------
    colour_offsets, vertices : (n_colours + 1,), (n_movable,)
        CSR map.
    """
    offsets = np.zeros(n_colours + 1, np.int64)
    for v in range(colour.size):
        if colour[v] >= 0:
            offsets[colour[v] + 1] += 1
    for c in range(n_colours):
        offsets[c + 1] += offsets[c]
    fill = offsets[:-1].copy()
    vertices = np.empty(offsets[-1], np.uint32)
    for v in range(colour.size):
        if colour[v] >= 0:
            vertices[fill[colour[v]]] = v
            fill[colour[v]] += 1
    return offsets, vertices


@kernel()
def star_table(
    colour: ColourArray,
    colour_offsets: IndexArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    star_corners: IndexArray,
) -> tuple[IndexArray, TableArray, TableArray]:
    """Gather, for each vertex v as `order_by_colour` lists them, the other corners of its cells.

    Goes through the vertices in the order of memory, and fills in the colours side by side.

    Returns
    -------
    offsets : (n_listed + 1,)
        Rows of the table that belong to each listed vertex.
    corners : (n_rows, 3)
        A quad (v, a, b, c) gives a, b, c; a triangle (v, a, c) gives a, NO_VERTEX, c.
    cells : (n_rows,)
        The cell of each row.
    """
    offsets, fill = np.zeros(colour_offsets[-1] + 1, np.int64), colour_offsets.copy()
    for v in range(colour.size):
        if colour[v] >= 0:
            fill[colour[v]] += 1
            offsets[fill[colour[v]]] = star_offsets[v + 1] - star_offsets[v]
    for i in range(colour_offsets[-1]):
        offsets[i + 1] += offsets[i]
    corners = np.empty((offsets[-1], 3), np.uint32)
    cells = np.empty(offsets[-1], np.uint32)
    for c in range(fill.size):
        fill[c] = colour_offsets[c]
    for v in range(colour.size):
        if colour[v] < 0:
            continue
        row = offsets[fill[colour[v]]]
        fill[colour[v]] += 1
        for s in range(star_offsets[v], star_offsets[v + 1]):
            c, at = star_cells[s], star_corners[s]
            first, last = cell_offsets[c], cell_offsets[c + 1]
            # No division by the count of corners, which would take half the time.
            after = at + 1 if at + 1 < last else first
            before = at - 1 if at > first else last - 1
            corners[row, 0], corners[row, 2] = cell_vertices[after], cell_vertices[before]
            corners[row, 1] = NO_VERTEX
            if last - first == 4:
                corners[row, 1] = cell_vertices[after + 1 if after + 1 < last else first]
            cells[row] = c
            row += 1
    return offsets, corners, cells
