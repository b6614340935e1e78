"""Looking up a vertex of `Stars` by its position."""

from qsmooth._types import IndexArray, TableArray
from qsmooth.kernels._jit import inlined_helper
from qsmooth.kernels.stars import Centre


@inlined_helper()
def centre_of(vertices: TableArray, offsets: IndexArray, i: int) -> Centre:
    """Look up the vertex at position i of `Stars.vertices`."""
    return Centre(i, vertices[i], offsets[i], offsets[i + 1])
