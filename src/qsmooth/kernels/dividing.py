"""A mesh divided among several ranks: who waits for whose vertices, and who measures which cell."""

import numpy as np

from qsmooth._types import BoolArray, IndexArray
from qsmooth.kernels._jit import kernel


@kernel()
def shared_vertices(
    owner: IndexArray, movable: BoolArray, cell_offsets: IndexArray, cell_vertices: IndexArray
) -> IndexArray:
    """List each movable vertex with every other rank that has one in a cell with it.

    Parameters
    ----------
    owner, movable : (n_vertices,)
        Which rank each vertex belongs to, and whether it may move.

    Returns
    -------
    codes : (n,)
        The other rank times n_vertices, plus the vertex; not sorted, and some more than once.
    """
    n_vertices, n_cells = owner.size, cell_offsets.size - 1
    codes = np.empty(0, np.int64)
    for fill in (False, True):
        n = 0
        for c in range(n_cells):
            start, stop = cell_offsets[c], cell_offsets[c + 1]
            first, mixed = owner[cell_vertices[start]], False
            for i in range(start + 1, stop):
                mixed |= owner[cell_vertices[i]] != first
            if not mixed:
                continue
            for i in range(start, stop):
                v = cell_vertices[i]
                for k in range(start, stop):
                    w = cell_vertices[k]
                    if movable[v] and movable[w] and owner[v] != owner[w]:
                        if fill:
                            codes[n] = owner[w] * n_vertices + v
                        n += 1
        if not fill:
            codes = np.empty(n, np.int64)
    return codes


@kernel()
def own_cells(
    rank: int,
    owner: IndexArray,
    movable: BoolArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    own: BoolArray,
) -> None:
    """Mark the cells that a rank measures, (n_cells,): each is some one rank's.

    That is the rank of the first of its movable vertices, which is told where the others go; or of
    the first of all, where none moves.
    """
    for c in range(own.size):
        first = np.int64(-1)
        for i in range(cell_offsets[c], cell_offsets[c + 1]):
            v = cell_vertices[i]
            if first < 0 or (movable[v], -v) > (movable[first], -first):
                first = v
        own[c] = owner[first] == rank
