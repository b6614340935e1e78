"""What travels together: the stars of the movable vertices, rings, and a sweep's moves.

Kernels take the tuples of arrays as they are, unpack them first, and hand arrays to their helpers:
every look at an array in a tuple counts a reference, which in the loop over the vertices made
sweeps slower by 20 % (star) to 90 % (aspect ratio). Tuples of numbers cost nothing.

What a kernel writes is unpacked by name, ``lengths = moves.lengths``: Numba's parallel form does
not see that ``lengths, shares = moves`` are the caller's arrays, and leaves out writing to them.

Nothing here loads Numba: a `Topology` holds `Stars`.
"""

from typing import NamedTuple

import numpy as np

from qsmooth._types import FloatArray, IndexArray, TableArray

# Stands for the missing opposite vertex where a row of `Stars.corners` is a triangle.
NO_VERTEX = np.uint32(0xFFFFFFFF)


class Stars(NamedTuple):
    """The movable vertices colour by colour, and the cells around each.

    Attributes
    ----------
    colour_offsets, vertices : (n_colours + 1,), (n_movable,)
        CSR map from a colour to its vertices; no two vertices of one colour share a cell.
    offsets : (n_movable + 1,)
        Rows of the table below that belong to each of `vertices`.
    corners, cells : (n_rows, 3), (n_rows,)
        One row for each cell around a vertex v, counter-clockwise: a quad (v, a, b, c) is a, b, c,
        a triangle (v, a, c) is a, NO_VERTEX, c; and the number of that cell.
    largest
        Cells in the largest star.
    """

    colour_offsets: IndexArray
    vertices: TableArray
    offsets: IndexArray
    corners: TableArray
    cells: TableArray
    largest: int


class Rings(NamedTuple):
    """The edge neighbours of every vertex, ascending.

    Attributes
    ----------
    offsets, vertices : (n_vertices + 1,), (2 * n_edges,)
        CSR map.
    """

    offsets: IndexArray
    vertices: IndexArray


class Moves(NamedTuple):
    """What a sweep says of each movable vertex, in its order: of the blocks, where it has these.

    Attributes
    ----------
    lengths : (n_movable,)
        How far it moved, in the unit of the coordinates.
    shares : (n_movable,)
        That, as a fraction of its shortest edge.
    """

    lengths: FloatArray
    shares: FloatArray
