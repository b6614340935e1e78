"""Connectivity: from cells to stars, edges, rings and boundary.

These kernels run once per mesh and are linear in its size; they allocate what they return, large
arrays by NumPy: that asks for huge pages, without which it took longer to write to new memory than
to find out what to write (64 MB: 38 and 8 ms).
Connectivity errors come back as the index of the first offender, -1 for none.
"""

import numpy as np

from qsmooth._types import BoolArray, IndexArray
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
        first = cell_offsets[c]
        a, b, d = cell_vertices[first], cell_vertices[first + 1], cell_vertices[first + 2]
        repeated = (a == b) | (b == d) | (d == a)
        if cell_offsets[c + 1] - first == 4:
            e = cell_vertices[first + 3]
            repeated |= (a == e) | (b == e) | (d == e)
        if repeated:
            return c
    return -1


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
    cells, corners = np.empty(cell_vertices.size, np.int64), np.empty(cell_vertices.size, np.int64)
    _fill_stars(cell_offsets, cell_vertices, offsets, cells, corners)
    return offsets, cells, corners


@kernel()
def _fill_stars(
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    offsets: IndexArray,
    cells: IndexArray,
    corners: IndexArray,
) -> None:
    for k in range(cell_vertices.size):
        offsets[np.uint64(cell_vertices[k])] += 1
    total = 0
    for v in range(offsets.size):
        total += offsets[v]
        offsets[v] = total
    # Filled from behind, so that the end of each row becomes its start.
    for c in range(cell_offsets.size - 2, -1, -1):
        for k in range(cell_offsets[c + 1] - 1, cell_offsets[c] - 1, -1):
            w = np.uint64(cell_vertices[k])
            offsets[w] -= 1
            at = np.uint64(offsets[w])
            cells[at], corners[at] = c, k


@kernel()
def may_be_duplicates(
    cell_offsets: IndexArray, twins: IndexArray, corner_cells: IndexArray
) -> bool:
    """Whether two cells share more than one edge, as any two with the same vertices do."""
    for c in range(cell_offsets.size - 1):
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] < 0:
                continue
            for i in range(cell_offsets[c], k):
                if twins[i] >= 0 and corner_cells[twins[i]] == corner_cells[twins[k]]:
                    return True
    return False


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


def edge_twins(
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    star_corners: IndexArray,
) -> tuple[IndexArray, int, int]:
    """Pair the sides of cells that are one edge.

    The side at corner position k runs from that corner to the cell's next one.

    Parameters
    ----------
    star_offsets, star_cells, star_corners
        As `stars` gives them.

    Returns
    -------
    twins : (n_corners,)
        Corner position of the same edge in the neighbouring cell; -1 on the boundary.
    n_bad, first_bad
        How many sides are the third or later on their edge, and the first of them (-1: none).
    """
    twins = np.full(cell_vertices.size, -1, np.int64)
    scratch = np.full((2, star_offsets.size - 1), -1, np.int64)
    cells = _read_only(cell_offsets), _read_only(cell_vertices)
    stars = _read_only(star_offsets), _read_only(star_cells), _read_only(star_corners)
    n_bad, first_bad = _fill_twins(*cells, *stars, scratch, twins)
    return twins, n_bad, first_bad


def _read_only(array: IndexArray) -> IndexArray:
    """View an array read-only: kernels are compiled once for these and once for others."""
    view = array.view()
    view.flags.writeable = False
    return view


@kernel()
def _fill_twins(
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    star_corners: IndexArray,
    scratch: IndexArray,
    twins: IndexArray,
) -> tuple[int, int]:
    # Each edge is met in the star of its smaller vertex. There the first side to each larger vertex
    # is kept, with the vertex in whose star that was.
    star_of, side_of = scratch
    n_bad, first_bad = 0, -1
    for v in range(star_offsets.size - 1):
        for s in range(star_offsets[v], star_offsets[v + 1]):
            k = star_corners[s]
            first, last = cell_offsets[star_cells[s]], cell_offsets[star_cells[s] + 1]
            after = k + 1 if k + 1 < last else first
            before = k - 1 if k > first else last - 1
            for is_before in range(2):
                w = np.uint64(cell_vertices[before if is_before else after])
                if w <= np.uint64(v):
                    continue
                side = before if is_before else k
                if star_of[w] != v:
                    star_of[w], side_of[w] = v, side
                elif twins[np.uint64(side_of[w])] < 0:
                    twins[np.uint64(side_of[w])] = side
                    twins[np.uint64(side)] = side_of[w]
                else:
                    n_bad += 1
                    if first_bad < 0 or side < first_bad:
                        first_bad = side
    return n_bad, first_bad


def corner_cells(cell_offsets: IndexArray) -> IndexArray:
    """Cell of every corner position, (n_corners,)."""
    cells = np.empty(cell_offsets[-1], np.int64)
    fill_corner_cells(cell_offsets, cells)
    return cells


@kernel()
def fill_corner_cells(cell_offsets: IndexArray, cells: IndexArray) -> None:
    """Write the cell of every corner position, (n_corners,)."""
    for c in range(cell_offsets.size - 1):
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            cells[k] = c


def rings(
    n_vertices: int, cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray
) -> tuple[IndexArray, IndexArray]:
    """Map each vertex to its edge neighbours, ascending.

    Returns
    -------
    offsets, vertices : (n_vertices + 1,), (2 * n_edges,)
        CSR map.
    """
    offsets = np.zeros(n_vertices + 1, np.int64)
    _count_neighbours(cell_offsets, cell_vertices, twins, offsets)
    unsorted, vertices = np.empty(offsets[-1], np.int64), np.empty(offsets[-1], np.int64)
    _fill_rings(cell_offsets, cell_vertices, twins, offsets[:-1].copy(), unsorted)
    # Neighbours come in ascending order where each vertex, in order, enters its neighbours' rows.
    _enter_rows(offsets, unsorted, offsets[:-1].copy(), vertices)
    return offsets, vertices


@kernel()
def _count_neighbours(
    cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray, offsets: IndexArray
) -> None:
    # Every edge once: by its only side, or by the first of its two.
    for c in range(cell_offsets.size - 1):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        for k in range(first, last):
            if twins[k] < 0 or k < twins[k]:
                offsets[cell_vertices[k] + 1] += 1
                offsets[cell_vertices[k + 1 if k + 1 < last else first] + 1] += 1
    for v in range(offsets.size - 1):
        offsets[v + 1] += offsets[v]


@kernel()
def _fill_rings(
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    twins: IndexArray,
    fill: IndexArray,
    vertices: IndexArray,
) -> None:
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


@kernel()
def _enter_rows(
    offsets: IndexArray, unsorted: IndexArray, fill: IndexArray, vertices: IndexArray
) -> None:
    for w in range(fill.size):
        for k in range(offsets[w], offsets[w + 1]):
            v = unsorted[k]
            vertices[fill[v]] = w
            fill[v] += 1


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
    cells = np.empty(cell_offsets[-1], np.int64)
    fill_corner_cells(cell_offsets, cells)
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
