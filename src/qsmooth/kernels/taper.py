"""Less and less of a step around what it would spoil."""

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import kernel


@kernel()
def taper(
    marked: BoolArray,
    rings: int,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    share: FloatArray,
) -> None:
    """Take the share of a step from the vertices of marked cells, and in part from those around.

    Visits only what it changes.

    Parameters
    ----------
    marked : (n_cells,)
        Cells whose vertices get 0.
    rings
        So many cells away, and farther, a vertex keeps its share: between, it gets no more than it
        has cells of that way behind it.
    cell_offsets, cell_vertices, star_offsets, star_cells
        CSR maps of the mesh.
    share : (n_vertices,)
        Changed.
    """
    front = np.empty(share.size, np.int64)
    n = 0
    for c in np.flatnonzero(marked):
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            v = cell_vertices[k]
            if share[v] > 0.0:
                share[v] = 0.0
                front[n] = v
                n += 1
    done = 0
    for ring in range(1, rings):
        most, last = ring / rings, n
        while done < last:
            v = front[done]
            done += 1
            for s in range(star_offsets[v], star_offsets[v + 1]):
                c = star_cells[s]
                for k in range(cell_offsets[c], cell_offsets[c + 1]):
                    w = cell_vertices[k]
                    if share[w] > most:
                        share[w] = most
                        front[n] = w
                        n += 1
