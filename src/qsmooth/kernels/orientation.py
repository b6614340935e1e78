"""Which way cells run: neighbours alike, and each part such that its area is positive."""

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel
from qsmooth.kernels.topology import fill_corner_cells


@helper()
def _signed_area(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, c: int
) -> float:
    """Twice the area of one cell, positive counter-clockwise."""
    first, last = cell_offsets[c], cell_offsets[c + 1]
    a = np.uint64(cell_vertices[first])
    area = 0.0
    for k in range(first + 1, last - 1):
        b, d = np.uint64(cell_vertices[k]), np.uint64(cell_vertices[k + 1])
        area += (xy[b, 0] - xy[a, 0]) * (xy[d, 1] - xy[a, 1])
        area -= (xy[b, 1] - xy[a, 1]) * (xy[d, 0] - xy[a, 0])
    return area


@kernel()
def all_run_alike(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, twins: IndexArray
) -> bool:
    """Whether neighbours run alike as given and every cell has a positive area: nothing to turn."""
    for c in range(cell_offsets.size - 1):
        if not _signed_area(xy, cell_offsets, cell_vertices, c) > 0.0:
            return False
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            # Neighbours that run alike pass their common edge in opposite directions.
            if twins[k] >= 0 and cell_vertices[k] == cell_vertices[np.uint64(twins[k])]:
                return False
    return True


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
    cells = np.empty(cell_offsets[-1], np.int64)
    fill_corner_cells(cell_offsets, cells)
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
        area = _signed_area(xy, cell_offsets, cell_vertices, c)
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
