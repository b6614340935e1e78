"""Connectivity: from cells to stars, edges, rings, boundary and orientation.

These kernels run once per mesh and are linear in its size; they allocate what they return.
Connectivity errors come back as the index of the first offender, -1 for none.
"""

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import kernel


@kernel()
def find_bad_index(cell_vertices: IndexArray, n_vertices: int) -> int:
    """Position of the first vertex id outside 0 .. n_vertices - 1, or -1."""
    for k in range(cell_vertices.size):
        if cell_vertices[k] < 0 or cell_vertices[k] >= n_vertices:
            return k
    return -1


@kernel()
def find_repeated_vertex(cell_offsets: IndexArray, cell_vertices: IndexArray) -> int:
    """First cell that has a vertex twice, or -1."""
    for c in range(cell_offsets.size - 1):
        for i in range(cell_offsets[c], cell_offsets[c + 1]):
            for j in range(cell_offsets[c], i):
                if cell_vertices[i] == cell_vertices[j]:
                    return c
    return -1


@kernel()
def stars(
    n_vertices: int, cell_offsets: IndexArray, cell_vertices: IndexArray
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Map each vertex to its cells, ascending, and to its corners there.

    Returns
    -------
    offsets, cells, corners : (n_vertices + 1,), (n_corners,), (n_corners,)
        CSR map; ``corners`` holds positions in `cell_vertices`.
    """
    offsets = np.zeros(n_vertices + 1, np.int64)
    for k in range(cell_vertices.size):
        offsets[cell_vertices[k] + 1] += 1
    for v in range(n_vertices):
        offsets[v + 1] += offsets[v]
    fill = offsets[:-1].copy()
    cells = np.empty(cell_vertices.size, np.int64)
    corners = np.empty(cell_vertices.size, np.int64)
    for c in range(cell_offsets.size - 1):
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            v = cell_vertices[k]
            cells[fill[v]] = c
            corners[fill[v]] = k
            fill[v] += 1
    return offsets, cells, corners


@kernel()
def find_duplicate_cells(
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
) -> tuple[int, int, int]:
    """Count cells that have the same vertices as an earlier one; also the first such pair.

    Returns
    -------
    count, cell, earlier_cell
        The cells are -1 when there is no pair.
    """
    n_cells = cell_offsets.size - 1
    count, cell, earlier_cell = 0, -1, -1
    shared = np.zeros(n_cells, np.int64)  # vertices in common with the cell in hand
    touched = np.empty(n_cells, np.int64)
    for c in range(n_cells):
        # Two cells with the same vertices meet in any three stars; of one triangle's or quad's
        # vertices the largest star (a hub of thousands, perhaps) need not be read.
        first, last = cell_offsets[c], cell_offsets[c + 1]
        hub, largest = -1, -1
        for k in range(first, last):
            v = cell_vertices[k]
            size = star_offsets[v + 1] - star_offsets[v]
            if size > largest:
                hub, largest = v, size
        n_touched = 0
        for k in range(first, last):
            v = cell_vertices[k]
            if v == hub:
                continue
            for s in range(star_offsets[v], star_offsets[v + 1]):
                other = star_cells[s]
                if other >= c:
                    break
                if shared[other] == 0:
                    touched[n_touched] = other
                    n_touched += 1
                shared[other] += 1
        found = -1
        for t in range(n_touched):
            other = touched[t]
            n_corners = last - first
            if (
                shared[other] == n_corners - 1
                and cell_offsets[other + 1] - cell_offsets[other] == n_corners
            ):
                for k in range(cell_offsets[other], cell_offsets[other + 1]):
                    if cell_vertices[k] == hub:
                        found = other
            shared[other] = 0
        if found >= 0:
            count += 1
            if cell < 0:
                cell, earlier_cell = c, found
    return count, cell, earlier_cell


@kernel()
def edge_twins(
    n_vertices: int, cell_offsets: IndexArray, cell_vertices: IndexArray
) -> tuple[IndexArray, int, int]:
    """Pair the sides of cells that are one edge.

    The side at corner position k runs from that corner to the cell's next one.

    Returns
    -------
    twins : (n_corners,)
        Corner position of the same edge in the neighbouring cell; -1 on the boundary.
    n_bad, first_bad
        How many sides are the third or later on their edge, and the first of them (-1: none).
    """
    n_corners = cell_vertices.size
    head = np.empty(n_corners, np.int64)
    for c in range(cell_offsets.size - 1):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        for k in range(first, last):
            head[k] = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
    # Sides sorted by their smaller vertex (counting sort); within such a row, the sides met so far
    # are found by their larger vertex.
    offsets = np.zeros(n_vertices + 1, np.int64)
    for k in range(n_corners):
        offsets[min(cell_vertices[k], head[k]) + 1] += 1
    for v in range(n_vertices):
        offsets[v + 1] += offsets[v]
    fill = offsets[:-1].copy()
    sides = np.empty(n_corners, np.int64)
    for k in range(n_corners):
        v = min(cell_vertices[k], head[k])
        sides[fill[v]] = k
        fill[v] += 1
    twins = np.full(n_corners, -1, np.int64)
    row_of = np.full(n_vertices, -1, np.int64)
    side_of = np.empty(n_vertices, np.int64)
    n_bad, first_bad = 0, -1
    for v in range(n_vertices):
        for s in range(offsets[v], offsets[v + 1]):
            k = sides[s]
            w = max(cell_vertices[k], head[k])
            if row_of[w] != v:
                row_of[w] = v
                side_of[w] = k
            elif twins[side_of[w]] < 0:
                twins[side_of[w]] = k
                twins[k] = side_of[w]
            else:
                n_bad += 1
                if first_bad < 0 or k < first_bad:
                    first_bad = k
    return twins, n_bad, first_bad


@kernel()
def corner_cells(cell_offsets: IndexArray) -> IndexArray:
    """Cell of every corner position, (n_corners,)."""
    cells = np.empty(cell_offsets[-1], np.int64)
    for c in range(cell_offsets.size - 1):
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            cells[k] = c
    return cells


@kernel()
def orient_parts(
    cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray
) -> tuple[BoolArray, IndexArray, int, int]:
    """Make neighbours run alike: which cells to turn round, and the edge-connected parts.

    Returns
    -------
    turned : (n_cells,)
        True where a cell has to be reversed to run like the first cell of its part.
    parts : (n_cells,)
        Part of each cell, numbered in the order of their first cells.
    n_parts
    conflict
        A cell that two of its neighbours orient differently (a Möbius strip), or -1.
    """
    n_cells = cell_offsets.size - 1
    cells = corner_cells(cell_offsets)
    turned = np.zeros(n_cells, np.bool_)
    parts = np.full(n_cells, -1, np.int64)
    stack = np.empty(n_cells, np.int64)
    n_parts = 0
    for seed in range(n_cells):
        if parts[seed] >= 0:
            continue
        parts[seed] = n_parts
        stack[0] = seed
        n_stack = 1
        while n_stack > 0:
            n_stack -= 1
            c = stack[n_stack]
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                t = twins[k]
                if t < 0:
                    continue
                # Neighbours that run alike pass their common edge in opposite directions.
                differs = cell_vertices[k] == cell_vertices[t]
                other = cells[t]
                if parts[other] < 0:
                    parts[other] = n_parts
                    turned[other] = turned[c] != differs
                    stack[n_stack] = other
                    n_stack += 1
                elif (turned[other] != turned[c]) != differs:
                    return turned, parts, n_parts, c
        n_parts += 1
    return turned, parts, n_parts, -1


@kernel()
def turn_parts(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    parts: IndexArray,
    n_parts: int,
    turned: BoolArray,
) -> None:
    """Turn whole parts such that their area is positive.

    The sum of a part's signed areas depends on its boundary alone. So it tells which way the cells
    have to run however tangled the interior is, where a vote of the cells can go wrong.

    Parameters
    ----------
    turned : (n_cells,)
        As `orient_parts` gives it; overwritten. Where the area is zero, the sign that most cells
        have decides; where there is none, the part stays as it was given.
    """
    votes = np.zeros(n_parts, np.int64)
    areas = np.zeros(n_parts)
    for c in range(cell_offsets.size - 1):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        a = cell_vertices[first]
        area = 0.0
        for k in range(first + 1, last - 1):
            b, d = cell_vertices[k], cell_vertices[k + 1]
            area += (xy[b, 0] - xy[a, 0]) * (xy[d, 1] - xy[a, 1])
            area -= (xy[b, 1] - xy[a, 1]) * (xy[d, 0] - xy[a, 0])
        area = -area if turned[c] else area
        areas[parts[c]] += area
        votes[parts[c]] += 1 if area > 0.0 else (-1 if area < 0.0 else 0)
    for c in range(turned.size):
        p = parts[c]
        if areas[p] < 0.0 or (areas[p] == 0.0 and votes[p] < 0):
            turned[c] = not turned[c]


@kernel()
def oriented_cells(
    cell_offsets: IndexArray, cell_vertices: IndexArray, turned: BoolArray
) -> IndexArray:
    """Corners of all cells, those of turned cells in reverse order from the same first corner."""
    out = cell_vertices.copy()
    for c in range(turned.size):
        if turned[c]:
            first, last = cell_offsets[c], cell_offsets[c + 1]
            for k in range(first + 1, last):
                out[k] = cell_vertices[last - (k - first)]
    return out


@kernel()
def rings(
    n_vertices: int, cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray
) -> tuple[IndexArray, IndexArray]:
    """Map each vertex to its edge neighbours, ascending.

    Returns
    -------
    offsets, vertices : (n_vertices + 1,), (2 * n_edges,)
        CSR map.
    """
    # Every edge once: by its only side, or by the first of its two.
    offsets = np.zeros(n_vertices + 1, np.int64)
    for c in range(cell_offsets.size - 1):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        for k in range(first, last):
            if twins[k] < 0 or k < twins[k]:
                offsets[cell_vertices[k] + 1] += 1
                offsets[cell_vertices[k + 1 if k + 1 < last else first] + 1] += 1
    for v in range(n_vertices):
        offsets[v + 1] += offsets[v]
    fill = offsets[:-1].copy()
    vertices = np.empty(offsets[-1], np.int64)
    for c in range(cell_offsets.size - 1):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        for k in range(first, last):
            if twins[k] < 0 or k < twins[k]:
                v = cell_vertices[k]
                w = cell_vertices[k + 1 if k + 1 < last else first]
                vertices[fill[v]] = w
                fill[v] += 1
                vertices[fill[w]] = v
                fill[w] += 1
    # Neighbours come in ascending order where each vertex, in order, enters its neighbours' rows.
    fill = offsets[:-1].copy()
    ordered = np.empty_like(vertices)
    for w in range(n_vertices):
        for k in range(offsets[w], offsets[w + 1]):
            v = vertices[k]
            ordered[fill[v]] = w
            fill[v] += 1
    return offsets, ordered


@kernel()
def mark_edge_ends(
    n_vertices: int, cell_offsets: IndexArray, cell_vertices: IndexArray, sides: BoolArray
) -> BoolArray:
    """Vertices at either end of the marked sides, (n_vertices,)."""
    marked = np.zeros(n_vertices, np.bool_)
    for c in range(cell_offsets.size - 1):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        for k in range(first, last):
            if sides[k]:
                marked[cell_vertices[k]] = True
                marked[cell_vertices[k + 1 if k + 1 < last else first]] = True
    return marked


@kernel()
def boundary_loops(
    n_vertices: int, cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray
) -> tuple[int, BoolArray]:
    """Count the closed loops of boundary edges, and mark where the boundary touches itself.

    Returns
    -------
    n_loops
        Loops through a pinched vertex count as the boundary is followed with the cells on its left.
    pinched : (n_vertices,)
        Vertices with more than two boundary edges.
    """
    n_corners = cell_vertices.size
    cells = corner_cells(cell_offsets)
    degree = np.zeros(n_vertices, np.int64)
    done = np.zeros(n_corners, np.bool_)
    n_loops = 0
    for start in range(n_corners):
        if twins[start] >= 0 or done[start]:
            continue
        n_loops += 1
        k = start
        while not done[k]:
            done[k] = True
            degree[cell_vertices[k]] += 1
            # Turn round the head of this side, from cell to cell, to the next boundary side.
            while True:
                c = cells[k]
                k = k + 1 if k + 1 < cell_offsets[c + 1] else cell_offsets[c]
                if twins[k] < 0:
                    break
                k = twins[k]
    return n_loops, degree > 1
