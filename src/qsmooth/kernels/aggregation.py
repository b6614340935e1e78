"""Levels of a multigrid solver: which rows of a block matrix go together, and how.

The graph of a matrix of blocks is cut into aggregates, a vertex and its neighbours. A coarse
displacement is one of each aggregate; a row takes the mean of those of its neighbours and its own.
On a grid of quads, whose aggregates are 3 by 3, that is bilinear interpolation.

Smoothed aggregation: P. Vaněk, J. Mandel, M. Brezina, Computing 56 (1996); here smoothed by the
graph alone, so that all of this is worked out once for any values.
"""

import numpy as np

from qsmooth._types import IndexArray, TableArray
from qsmooth.kernels._jit import kernel
from qsmooth.kernels.graphs import Graph, Shares

NONE = -1
# Stands for the number of a vertex that has none yet.
UNNUMBERED = -2


@kernel()
def breadth_first(
    starts: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    unknown: IndexArray,
    vertices: IndexArray,
    cells: IndexArray,
) -> int:
    """Number movable vertices, neighbours near each other, and list the cells around them.

    Stars are in the order of the caller's ids: so is what rests on this, however the mesh is
    numbered inside.

    Parameters
    ----------
    starts : (n,)
        Movable vertices; from the first one on that has no number yet, again and again.
    star_offsets, star_cells, cell_offsets, cell_vertices
        CSR maps of the mesh.
    unknown : (n_vertices,)
        The number of each vertex: overwritten where it is `UNNUMBERED`; the others are left
        out.
    vertices : (n,)
        Overwritten. The vertices in their new order.
    cells : (n_cells,)
        Overwritten. The cells around them, in the order in which they are met.

    Returns
    -------
    int
        The number of these cells.
    """
    listed = np.zeros(cells.size, np.bool_)
    done, found, n_listed = 0, 0, 0
    for start in starts:
        if unknown[start] == UNNUMBERED:
            unknown[start], vertices[found] = found, start
            found += 1
        while done < found:
            v = vertices[done]
            done += 1
            for s in range(star_offsets[v], star_offsets[v + 1]):
                c = star_cells[s]
                if listed[c]:
                    continue
                listed[c], cells[n_listed] = True, c
                n_listed += 1
                for k in range(cell_offsets[c], cell_offsets[c + 1]):
                    w = cell_vertices[k]
                    if unknown[w] == UNNUMBERED:
                        unknown[w], vertices[found] = found, w
                        found += 1
    return n_listed


@kernel()
def aggregate(offsets: IndexArray, columns: TableArray, label: IndexArray) -> int:
    """Cut a graph into aggregates.

    Parameters
    ----------
    offsets, columns
        CSR map of the graph; each row has itself among its neighbours.
    label : (n,)
        Overwritten. The aggregate of each row.

    Returns
    -------
    int
        Their number.
    """
    label[:] = NONE
    count = 0
    for i in range(label.size):
        first, last = offsets[i], offsets[i + 1]
        free = True
        for k in range(first, last):
            if label[columns[k]] != NONE:
                free = False
                break
        if free:
            for k in range(first, last):
                label[columns[k]] = count
            count += 1
    # All others have a neighbour in an aggregate; they join the one with most of their neighbours.
    # Written down negative first, so as not to count themselves.
    for i in range(label.size):
        if label[i] != NONE:
            continue
        best, most = 0, 0
        for k in range(offsets[i], offsets[i + 1]):
            own, votes = label[columns[k]], 0
            if own < 0:
                continue
            for m in range(offsets[i], offsets[i + 1]):
                votes += label[columns[m]] == own
            if votes > most:
                best, most = own, votes
        label[i] = -2 - best
    for i in range(label.size):
        if label[i] < NONE:
            label[i] = -2 - label[i]
    return count


@kernel()
def interpolation(offsets: IndexArray, columns: TableArray, label: IndexArray) -> Shares:
    """Let each row take the mean of the aggregates of its neighbours and its own.

    Parameters are those of `aggregate`. The shares of a row add up to 1.
    """
    n = label.size
    part_offsets = np.zeros(n + 1, np.int64)
    parts, shares = np.empty(columns.size, np.uint32), np.empty(columns.size, np.float32)
    at = 0
    for i in range(n):
        share = np.float32(1.0 / (offsets[i + 1] - offsets[i]))
        first = at
        for k in range(offsets[i], offsets[i + 1]):
            own, m = label[columns[k]], first
            while m < at and parts[m] != own:
                m += 1
            if m == at:
                parts[m], shares[m] = own, np.float32(0.0)
                at += 1
            shares[m] += share
        part_offsets[i + 1] = at
    return Shares(part_offsets, parts[:at].copy(), shares[:at].copy())


@kernel()
def transposed(shares: Shares, n_columns: int) -> Shares:
    """Turn a matrix round: for each column its rows, ascending, and their values."""
    offsets, columns, values = shares
    to_offsets = np.zeros(n_columns + 1, np.int64)
    for j in columns:
        to_offsets[j + 1] += 1
    for j in range(n_columns):
        to_offsets[j + 1] += to_offsets[j]
    at = to_offsets[:-1].copy()
    rows, moved = np.empty(columns.size, np.uint32), np.empty(columns.size, np.float32)
    for i in range(offsets.size - 1):
        for k in range(offsets[i], offsets[i + 1]):
            j = columns[k]
            rows[at[j]], moved[at[j]] = i, values[k]
            at[j] += 1
    return Shares(to_offsets, rows, moved)


@kernel()
def sorted_rows(offsets: IndexArray, columns: TableArray) -> TableArray:
    """Sort the columns of each row of a symmetric CSR map: walk through it, and turn it round."""
    at = offsets[:-1].copy()
    ascending = np.empty(columns.size, np.uint32)
    for i in range(at.size):
        for k in range(offsets[i], offsets[i + 1]):
            j = columns[k]
            ascending[at[j]] = i
            at[j] += 1
    return ascending


@kernel()
def product_graphs(graph: Graph, part: Shares, row: Shares) -> tuple[Graph, Graph]:
    """Rows of the coarse matrix Pᵀ A P, and of Pᵀ A, which comes first.

    Parameters
    ----------
    graph, part, row
        Of A, of P, and of Pᵀ.

    Returns
    -------
    half, to
        Of Pᵀ A and of Pᵀ A P, both with columns in the order in which they are met.
    """
    offsets, columns = graph
    part_offsets, parts, row_offsets, rows = part.offsets, part.columns, row.offsets, row.columns
    n, n_coarse = offsets.size - 1, row_offsets.size - 1
    half_offsets, to_offsets = np.zeros(n_coarse + 1, np.int64), np.zeros(n_coarse + 1, np.int64)
    half_columns, to_columns = np.empty(0, np.uint32), np.empty(0, np.uint32)
    seen, met = np.empty(n, np.int64), np.empty(n_coarse, np.int64)
    for phase in range(2):
        seen[:] = NONE
        met[:] = NONE
        for r in range(n_coarse):
            at_half, at_to = half_offsets[r], to_offsets[r]
            for a in range(row_offsets[r], row_offsets[r + 1]):
                i = rows[a]
                for k in range(offsets[i], offsets[i + 1]):
                    j = columns[k]
                    if seen[j] == r:
                        continue
                    seen[j] = r
                    if phase == 1:
                        half_columns[at_half] = j
                    at_half += 1
                    for p in range(part_offsets[j], part_offsets[j + 1]):
                        c = parts[p]
                        if met[c] != r:
                            met[c] = r
                            if phase == 1:
                                to_columns[at_to] = c
                            at_to += 1
            if phase == 0:
                half_offsets[r + 1], to_offsets[r + 1] = at_half, at_to
        if phase == 0:
            half_columns = np.empty(half_offsets[-1], np.uint32)
            to_columns = np.empty(to_offsets[-1], np.uint32)
    return Graph(half_offsets, half_columns), Graph(to_offsets, to_columns)


@kernel()
def product_places(
    graph: Graph,
    part: Shares,
    row: Shares,
    half: Graph,
    to: Graph,
    half_places: TableArray,
    to_places: TableArray,
) -> None:
    """Work out where each product of `multigrid.multiply_out` is added.

    Parameters
    ----------
    graph, part, row, half, to
        As in `product_graphs`; columns in any order.
    half_places, to_places
        Overwritten. Place in the row of Pᵀ A of each product Pᵀ · A, and in the row of Pᵀ A P of
        each product (Pᵀ A) · P, in the order in which they are made. Unsigned, of any size that
        holds the length of a row.
    """
    offsets, columns = graph
    part_offsets, parts, row_offsets, rows = part.offsets, part.columns, row.offsets, row.columns
    half_offsets, half_columns = half
    to_offsets, to_columns = to
    place = np.empty(offsets.size - 1, np.uint32)
    coarse_place = np.empty(row_offsets.size - 1, np.uint32)
    at_half, at_to = 0, 0
    for r in range(row_offsets.size - 1):
        for t in range(half_offsets[r], half_offsets[r + 1]):
            place[half_columns[t]] = t - half_offsets[r]
        for t in range(to_offsets[r], to_offsets[r + 1]):
            coarse_place[to_columns[t]] = t - to_offsets[r]
        for a in range(row_offsets[r], row_offsets[r + 1]):
            i = rows[a]
            for k in range(offsets[i], offsets[i + 1]):
                half_places[at_half] = place[columns[k]]
                at_half += 1
        for t in range(half_offsets[r], half_offsets[r + 1]):
            j = half_columns[t]
            for p in range(part_offsets[j], part_offsets[j + 1]):
                to_places[at_to] = coarse_place[parts[p]]
                at_to += 1
