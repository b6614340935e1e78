"""Rings in blocks: vertices with equally many neighbours, for loops without a ragged inner one."""

from typing import Any, NamedTuple

import numpy as np

from qsmooth._types import BlockArray, TableArray
from qsmooth.kernels._jit import kernel
from qsmooth.kernels.blocks import LANES
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import Rings

# Vertices are grouped by their neighbours within stretches of so many ids: the coordinates of a
# stretch stay in cache while its groups pass.
STRETCH = 4096
# Columns of `RingBlocks.table`.
FIRST, SIZE, N_NEIGHBOURS, START = range(4)
N_COLUMNS = 4


class RingBlocks(NamedTuple):
    """The movable vertices in blocks of up to `LANES` that have equally many edge neighbours.

    Attributes
    ----------
    table : (n_blocks, 4)
        First vertex, vertices, neighbours of each, start in `neighbours`.
    vertices : (n_movable,)
        The vertices in the order of the blocks.
    neighbours : (n_entries,)
        For each vertex of a block a row of its neighbours.
    rails
        Where the vertices may be.
    """

    table: BlockArray
    vertices: TableArray
    neighbours: TableArray
    rails: Rails


@kernel()
def build_ring_blocks(movable: TableArray, rings: Rings) -> Any:
    """Put vertices into blocks, by stretches of ids, then by their neighbours, then by id.

    They may be anywhere.

    Parameters
    ----------
    movable : (n_movable,)
        Ids, ascending.
    rings
        The edge neighbours of every vertex.

    Returns
    -------
    RingBlocks
    """
    offsets, ring_vertices = rings.offsets, rings.vertices
    n, n_entries, most = movable.size, 0, 0
    for i in range(n):
        size = offsets[movable[i] + 1] - offsets[movable[i]]
        n_entries += size
        most = max(most, size)
    vertices, neighbours = np.empty(n, np.uint32), np.empty(n_entries, np.uint32)
    table = np.empty((n, N_COLUMNS), np.uint64)
    starts = np.empty(most + 2, np.int64)
    first, entry, n_blocks = 0, 0, 0
    while first < n:
        last = first
        starts[:] = 0
        while last < n and movable[last] // STRETCH == movable[first] // STRETCH:
            starts[offsets[movable[last] + 1] - offsets[movable[last]] + 1] += 1
            last += 1
        starts[0] = first
        for size in range(most + 1):
            starts[size + 1] += starts[size]
        for i in range(first, last):
            size = offsets[movable[i] + 1] - offsets[movable[i]]
            vertices[starts[size]] = movable[i]
            starts[size] += 1
        i = first
        for size in range(most + 1):
            while i < starts[size]:
                count = min(LANES, starts[size] - i)
                table[n_blocks, FIRST], table[n_blocks, SIZE] = i, count
                table[n_blocks, N_NEIGHBOURS], table[n_blocks, START] = size, entry
                n_blocks += 1
                for v in vertices[i : i + count]:
                    for k in range(offsets[v], offsets[v + 1]):
                        neighbours[entry] = ring_vertices[k]
                        entry += 1
                i += count
        first = last
    free = Rails(np.empty((0, 2)), np.empty(0), np.empty((0, 2)))
    return RingBlocks(table[:n_blocks].copy(), vertices, neighbours, free)
