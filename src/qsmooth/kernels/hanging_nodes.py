"""Hanging nodes: vertices in the middle of an edge of a cell that does not have them."""

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import kernel


@kernel()
def hanging_nodes(
    xy: FloatArray,
    edges: IndexArray,
    vertices: IndexArray,
    tolerance: float,
    axis: int,
    out: IndexArray,
) -> None:
    """Find for each vertex an edge that it hangs on.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit.
    edges : (n_edges, 2)
        Vertices of each edge; only edges with one cell can have a hanging node.
    vertices : (k,)
        The vertices in question, ascending by their coordinate along `axis`.
    tolerance
        How far from the edge a vertex may be, and how far from its ends it must be, as a fraction
        of the edge's length.
    axis
        0 or 1: the longer side of the mesh, along which the search goes.
    out : (k,)
        Overwritten. Index in `edges` of the shortest edge that the vertex hangs on, -1 where none.
    """
    out[:] = -1
    shortest = np.full(vertices.size, np.inf)
    along = np.empty(vertices.size)
    for i in range(vertices.size):
        along[i] = xy[vertices[i], axis]
    other = 1 - axis
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
        length = np.hypot(ux, uy)
        if length == 0.0:
            continue
        off = tolerance * length
        low = min(xy[a, other], xy[b, other]) - off
        high = max(xy[a, other], xy[b, other]) + off
        last = max(xy[a, axis], xy[b, axis]) + off
        i = np.searchsorted(along, min(xy[a, axis], xy[b, axis]) - off)
        while i < along.size and along[i] <= last:
            v = vertices[i]
            if low <= xy[v, other] <= high and v != a and v != b and length < shortest[i]:
                px, py = xy[v, 0] - xy[a, 0], xy[v, 1] - xy[a, 1]
                share = (px * (ux / length) + py * (uy / length)) / length
                height = abs(px * (uy / length) - py * (ux / length))
                if tolerance < share < 1.0 - tolerance and height <= off:
                    out[i] = e
                    shortest[i] = length
            i += 1
