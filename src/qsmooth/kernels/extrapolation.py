"""Vector extrapolation of sweeps: what the arrays of moves need of compiled loops."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, MoveArray, TableArray
from qsmooth.kernels._jit import kernel, parallel_kernel

# Bits of a product of two moves, as a fraction of the largest; less those that a sum may add.
BITS = 61


@parallel_kernel()
def note_moves(
    xy: FloatArray, vertices: TableArray, inv_size: FloatArray, last: FloatArray, moves: MoveArray
) -> None:
    """Note how far each vertex has come since the last note.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates.
    vertices : (n,)
        The vertices to look at.
    inv_size : (n,)
        One over the unit of length at each of them.
    last : (n, 2)
        Where they were; overwritten with where they are.
    moves : (n, 2)
        Overwritten, in units of length.
    """
    for i in prange(vertices.size):
        v = vertices[i]
        for k in range(2):
            moves[i, k] = np.float32((xy[v, k] - last[i, k]) * inv_size[i])
            last[i, k] = xy[v, k]


@kernel()
def products(moves: MoveArray, largest: float, count: int) -> IndexArray:
    """Sum up the products of all pairs of sweeps' moves, in whole units.

    Sums of integers are the same in any order: what rests on them depends neither on threads nor
    on numbering.

    Parameters
    ----------
    moves : (n_sweeps, n, 2)
        As `note_moves` notes them.
    largest
        The largest of them, and of all others whose sums are added to these.
    count
        How many vertices all these are of.

    Returns
    -------
    sums : (n_sweeps, n_sweeps)
        In a unit that depends on `largest` and `count`.
    """
    n_sweeps, n = moves.shape[0], moves.shape[1]
    bits = BITS - int(np.ceil(np.log2(2.0 * count)))
    scale, unit = 1.0 / largest, 2.0**bits
    sums = np.zeros((n_sweeps, n_sweeps), np.int64)
    for j in range(n_sweeps):
        for k in range(j + 1):
            total = np.int64(0)
            for i in range(n):
                x = (np.float64(moves[j, i, 0]) * scale) * (np.float64(moves[k, i, 0]) * scale)
                y = (np.float64(moves[j, i, 1]) * scale) * (np.float64(moves[k, i, 1]) * scale)
                total += np.int64((x + y) * unit)
            sums[j, k], sums[k, j] = total, total
    return sums


@parallel_kernel()
def add_moves(
    xy: FloatArray,
    vertices: TableArray,
    size: FloatArray,
    moves: MoveArray,
    weights: FloatArray,
) -> None:
    """Move each vertex by a weighted sum of its noted moves, in place.

    Parameters
    ----------
    weights : (n_sweeps,)
        What each sweep's move counts.
    xy, vertices, size, moves
        As above; `size` is the unit of length.
    """
    for i in prange(vertices.size):
        v = vertices[i]
        dx, dy = 0.0, 0.0
        for k in range(weights.size):
            dx += weights[k] * moves[k, i, 0]
            dy += weights[k] * moves[k, i, 1]
        xy[v, 0] += size[i] * dx
        xy[v, 1] += size[i] * dy
