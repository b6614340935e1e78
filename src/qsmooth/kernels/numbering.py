"""Another order of vertices and cells in memory: neighbours near each other."""

from typing import Any

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel

# A digit of the radix sort, and how many there are in a key, two bits a level of the curve. What
# these do not tell apart, 2e-7 of the extent from each other, keeps the order that it had.
DIGIT_BITS, N_DIGITS = 11, 4
N_BUCKETS = 1 << DIGIT_BITS
LAST_BITS: Any = np.uint64(N_BUCKETS - 1)
# The curve of Hilbert in four states. A quarter of a square, 2 x + y, comes in this place, and is
# gone through in this state.
PLACES = np.array([[0, 1, 3, 2], [0, 3, 1, 2], [2, 3, 1, 0], [2, 1, 3, 0]], np.uint64)
STATES = np.array([[1, 0, 3, 0], [0, 2, 1, 1], [2, 1, 2, 3], [3, 3, 0, 2]], np.uint64)
ONE: Any = np.uint64(1)
TWO: Any = np.uint64(2)
LEVELS = DIGIT_BITS * N_DIGITS // 2
# So many in a row are sorted by insertion.
HUB = 24


@helper()
def place_on_curve(x: Any, y: Any) -> Any:
    """Find how far along the curve a place is; coordinates have `LEVELS` bits."""
    key, state = ONE - ONE, ONE - ONE
    for level in range(LEVELS - 1, -1, -1):
        shift = np.uint64(level)
        quarter = TWO * ((x >> shift) & ONE) + ((y >> shift) & ONE)
        key = (key << TWO) | PLACES[state, quarter]
        state = STATES[state, quarter]
    return key


@kernel()
def curve_order(xy: FloatArray, low: FloatArray, scale: FloatArray) -> IndexArray:
    """List vertices along the curve of Hilbert.

    Parameters
    ----------
    low, scale : (2,)
        What takes coordinates to 0 .. 2²² - 1: what to take away, then what to multiply with.

    Returns
    -------
    (n_vertices,)
        Vertices in that order; of equal places in the order of their numbers.
    """
    n = xy.shape[0]
    keys, order = np.empty(n, np.uint64), np.arange(n)
    counts = np.zeros((N_DIGITS, N_BUCKETS), np.int64)
    for v in range(n):
        x = np.uint64((xy[v, 0] - low[0]) * scale[0])
        y = np.uint64((xy[v, 1] - low[1]) * scale[1])
        key = place_on_curve(x, y)
        keys[v] = key
        for digit in range(N_DIGITS):
            counts[digit, np.int64(key & LAST_BITS)] += 1
            key >>= np.uint64(DIGIT_BITS)
    other_keys, other_order = np.empty_like(keys), np.empty_like(order)
    fill = np.empty(N_BUCKETS, np.int64)
    for digit in range(N_DIGITS):
        fill[0] = 0
        for bucket in range(N_BUCKETS - 1):
            fill[bucket + 1] = fill[bucket] + counts[digit, bucket]
        shift = np.uint64(DIGIT_BITS * digit)
        for i in range(n):
            own = np.int64((keys[i] >> shift) & LAST_BITS)
            other_keys[fill[own]], other_order[fill[own]] = keys[i], order[i]
            fill[own] += 1
        keys, other_keys = other_keys, keys
        order, other_order = other_order, order
    return order


@kernel()
def renumbered_cells(
    order: IndexArray, cell_offsets: IndexArray, cell_vertices: IndexArray
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Give cells the new numbers of their vertices, and put them into the order of the first ones.

    Parameters
    ----------
    order : (n_vertices,)
        Old numbers of the vertices in their new order.

    Returns
    -------
    cells : (n_cells,)
        Old numbers of the cells in their new order.
    offsets, vertices
        The new CSR map from a cell to its corners; each begins with the corner that it began with.
    """
    n_cells = cell_offsets.size - 1
    rank = np.empty(order.size, np.uint32)
    for i in range(order.size):
        rank[order[i]] = i
    corners, first = np.empty(cell_vertices.size, np.uint32), np.empty(n_cells, np.uint32)
    fill = np.zeros(order.size + 1, np.int64)
    for c in range(n_cells):
        least = np.uint32(0xFFFFFFFF)
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            corners[k] = rank[cell_vertices[k]]
            least = min(least, corners[k])
        first[c] = least
        fill[least + 1] += 1
    for v in range(order.size):
        fill[v + 1] += fill[v]
    cells = np.empty(n_cells, np.int64)
    for c in range(n_cells):
        cells[fill[first[c]]] = c
        fill[first[c]] += 1
    offsets, vertices = np.zeros(n_cells + 1, np.int64), np.empty(cell_vertices.size, np.int64)
    for i in range(n_cells):
        start, stop = cell_offsets[cells[i]], cell_offsets[cells[i] + 1]
        offsets[i + 1] = offsets[i] + stop - start
        for k in range(start, stop):
            vertices[offsets[i] + k - start] = corners[k]
    return cells, offsets, vertices


@kernel()
def sort_rows(offsets: IndexArray, values: IndexArray, others: IndexArray, ids: IndexArray) -> None:
    """Sort the rows of a CSR map by the ids of their values, and others along with them, in place.

    Parameters
    ----------
    values, others : (n_entries,)
        Both are changed.
    ids
        For each value what it is sorted by.
    """
    for row in range(offsets.size - 1):
        first, last = offsets[row], offsets[row + 1]
        # By insertion; at a hub, where that would take quadratic time, over gaps first (Shell).
        gap = 1 if last - first <= HUB else (last - first) // 2
        while gap > 0:
            for k in range(first + gap, last):
                value, other, at = values[k], others[k], k
                while at - gap >= first and ids[values[at - gap]] > ids[value]:
                    values[at], others[at] = values[at - gap], others[at - gap]
                    at -= gap
                values[at], others[at] = value, other
            gap = 1 if gap == 2 else gap * 5 // 11
