"""Blocks of lanes: the layout of a sweep that the compiler can vectorise.

The movable vertices of one colour are grouped by the make-up of their stars, so many quads and so
many triangles, and cut into blocks of `LANES`. All vertices of a block then run through the same
passes, without a branch or a ragged loop, each in its lane.
"""

from typing import Any

import numpy as np

from qsmooth._types import BlockArray, IndexArray, TableArray
from qsmooth.kernels._jit import kernel
from qsmooth.kernels.topology import NO_VERTEX

# Vertices in a block: enough to hide latencies, few enough that a large star stays in cache.
LANES = 64
# Columns of the table of blocks.
FIRST, SIZE, N_QUADS, N_TRIANGLES, STAR = range(5)


def lane_row(k: int) -> Any:
    """Offset of row k in a flat array of rows of lanes."""
    return np.uint64(k * LANES)


@kernel()
def build_blocks(
    colour_offsets: IndexArray, vertices: TableArray, offsets: IndexArray, corners: TableArray
) -> tuple[IndexArray, BlockArray, TableArray, TableArray, IndexArray]:
    """Cut coloured vertices into blocks of equal stars.

    Parameters
    ----------
    colour_offsets, vertices, offsets, corners
        A schedule: (n_colours + 1,), (n_movable,), (n_movable + 1,), (n_rows, 3).

    Returns
    -------
    colour_blocks : (n_colours + 1,)
        Blocks of each colour.
    blocks : (n_blocks, 5)
        First vertex, vertices, quads a star, triangles a star, start in `stars`.
    block_vertices : (n_movable,)
        The vertices in the order of the blocks.
    stars : (n_entries,)
        For each block one row of its size for each corner: a, b, c of the first quad, ..., then a,
        c of the first triangle, ...
    rows : (n_movable,)
        Position of each block vertex in the schedule.
    """
    n = vertices.size
    kind = np.empty(n, np.int64)
    n_entries = 0
    for i in range(n):
        triangles = 0
        for row in range(offsets[i], offsets[i + 1]):
            triangles += 1 if corners[row, 1] == NO_VERTEX else 0
        quads = offsets[i + 1] - offsets[i] - triangles
        kind[i] = (quads << 32) | triangles
        n_entries += 3 * quads + 2 * triangles
    n_colours = colour_offsets.size - 1
    rows = np.empty(n, np.int64)
    n_blocks = 0
    for colour in range(n_colours):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        order = np.argsort(kind[start:stop], kind="mergesort")
        size = 0
        for i in range(start, stop):
            rows[i] = start + order[i - start]
            if size == LANES or (i > start and kind[rows[i]] != kind[rows[i - 1]]):
                n_blocks += 1
                size = 0
            size += 1
        n_blocks += 1 if size else 0
    blocks = np.empty((n_blocks, 5), np.uint64)
    colour_blocks = np.zeros(n_colours + 1, np.int64)
    block_vertices = np.empty(n, np.uint32)
    stars = np.empty(n_entries, np.uint32)
    b, entry = 0, 0
    for colour in range(n_colours):
        i, stop = colour_offsets[colour], colour_offsets[colour + 1]
        while i < stop:
            size = 1
            while size < LANES and i + size < stop and kind[rows[i + size]] == kind[rows[i]]:
                size += 1
            quads, triangles = kind[rows[i]] >> 32, kind[rows[i]] & 0xFFFFFFFF
            blocks[b, FIRST], blocks[b, SIZE] = i, size
            blocks[b, N_QUADS], blocks[b, N_TRIANGLES], blocks[b, STAR] = quads, triangles, entry
            for lane in range(size):
                source = rows[i + lane]
                block_vertices[i + lane] = vertices[source]
                quad_at = entry + lane
                triangle_at = entry + 3 * quads * size + lane
                for row in range(offsets[source], offsets[source + 1]):
                    if corners[row, 1] == NO_VERTEX:
                        stars[triangle_at] = corners[row, 0]
                        stars[triangle_at + size] = corners[row, 2]
                        triangle_at += 2 * size
                    else:
                        for k in range(3):
                            stars[quad_at + k * size] = corners[row, k]
                        quad_at += 3 * size
            entry += (3 * quads + 2 * triangles) * size
            i += size
            b += 1
        colour_blocks[colour + 1] = b
    return colour_blocks, blocks, block_vertices, stars, rows
