"""From the movable vertices to `stars.Stars`: colours, their order, the table of cells.

These kernels run once per set of movable vertices and are linear in its size; they allocate what
they return.
"""

import numpy as np

from qsmooth._types import BoolArray, IndexArray, TableArray
from qsmooth.kernels._jit import kernel
from qsmooth.kernels.stars import NO_VERTEX


@kernel()
def colours(
    movable: BoolArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
) -> tuple[IndexArray, int]:
    """Colour the movable vertices such that two that share a cell differ.

    Greedy, in the order of their numbers: each takes the smallest colour that is free.

    Returns
    -------
    colour : (n_vertices,)
        -1 where a vertex does not move.
    n_colours
    """
    n_vertices = movable.size
    colour = np.full(n_vertices, -1, np.int64)
    largest = 0
    for v in range(n_vertices):
        largest = max(largest, star_offsets[v + 1] - star_offsets[v])
    taken_by = np.full(3 * largest + 2, -1, np.int64)
    n_colours = 0
    for v in range(n_vertices):
        if not movable[v]:
            continue
        for s in range(star_offsets[v], star_offsets[v + 1]):
            c = star_cells[s]
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                if colour[cell_vertices[k]] >= 0:
                    taken_by[colour[cell_vertices[k]]] = v
        mine = 0
        while taken_by[mine] == v:
            mine += 1
        colour[v] = mine
        n_colours = max(n_colours, mine + 1)
    return colour, n_colours


@kernel()
def order_by_colour(colour: IndexArray, n_colours: int) -> tuple[IndexArray, TableArray]:
    """List the movable vertices colour by colour, ascending within each.

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
    vertices: TableArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    star_corners: IndexArray,
) -> tuple[IndexArray, TableArray, TableArray]:
    """Gather, for each listed vertex v, the other corners of the cells around it.

    Returns
    -------
    offsets : (n_listed + 1,)
        Rows of the table that belong to each listed vertex.
    corners : (n_rows, 3)
        A quad (v, a, b, c) gives a, b, c; a triangle (v, a, c) gives a, NO_VERTEX, c.
    cells : (n_rows,)
        The cell of each row.
    """
    offsets = np.zeros(vertices.size + 1, np.int64)
    for i in range(vertices.size):
        v = vertices[i]
        offsets[i + 1] = offsets[i] + star_offsets[v + 1] - star_offsets[v]
    corners = np.empty((offsets[-1], 3), np.uint32)
    cells = np.empty(offsets[-1], np.uint32)
    for i in range(vertices.size):
        row = offsets[i]
        v = vertices[i]
        for s in range(star_offsets[v], star_offsets[v + 1]):
            c = star_cells[s]
            first = cell_offsets[c]
            n_corners = cell_offsets[c + 1] - first
            at = star_corners[s] - first
            corners[row, 0] = cell_vertices[first + (at + 1) % n_corners]
            corners[row, 1] = NO_VERTEX
            if n_corners == 4:
                corners[row, 1] = cell_vertices[first + (at + 2) % n_corners]
            corners[row, 2] = cell_vertices[first + (at + n_corners - 1) % n_corners]
            cells[row] = c
            row += 1
    return offsets, corners, cells
