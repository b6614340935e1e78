"""Loops of a multigrid solver for block matrices, 2 by 2, that are symmetric and not negative.

A matrix is a CSR map, columns ascending, with the values of a block, row by row, in a row of an
array. Values and vectors are of single precision, as they only have to show the way; products of
vectors are added up in double precision, chunk by chunk, so that they are the same for any number
of threads. So are the sweeps: each chunk of rows is swept by itself, and takes what lies outside as
it was before.
"""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, SingleArray, TableArray
from qsmooth.kernels._jit import kernel, parallel_kernel
from qsmooth.kernels.graphs import Graph, Shares

# Rows of a chunk at least; and chunks at most.
CHUNK, MOST_CHUNKS = 8192, 64


@kernel()
def chunk_rows(n: int) -> int:
    """Say how many rows a chunk of n rows has."""
    return max(CHUNK, -(-n // MOST_CHUNKS))


@parallel_kernel()
def invert_diagonal(
    diagonal: IndexArray, values: SingleArray, shift: float, inverse: SingleArray
) -> None:
    """Invert the blocks on the diagonal.

    Parameters
    ----------
    diagonal : (n,)
        Where in `values`, (n_blocks, 4), each of them is.
    shift
        By this fraction of its trace its diagonal grows.
    inverse : (n, 3)
        Overwritten with xx, xy, yy; 0 where there is none.
    """
    for i in prange(diagonal.size):
        k = diagonal[i]
        xx, xy, yy = np.float64(values[k, 0]), np.float64(values[k, 1]), np.float64(values[k, 3])
        more = shift * (xx + yy)
        xx += more
        yy += more
        det = xx * yy - xy * xy
        inv = 1.0 / det if det > 0.0 else 0.0
        inverse[i, 0], inverse[i, 1], inverse[i, 2] = yy * inv, -xy * inv, xx * inv


@parallel_kernel()
def multiply_out(
    offsets: IndexArray,
    values: SingleArray,
    part: Shares,
    row: Shares,
    half: Graph,
    starts: IndexArray,
    half_places: TableArray,
    to_places: TableArray,
    to_offsets: IndexArray,
    to_values: SingleArray,
) -> None:
    """Multiply out the coarse matrix Pᵀ A P.

    Parameters
    ----------
    offsets, values
        Of A.
    part, row, half
        P, Pᵀ, and the rows of Pᵀ A.
    starts : (n_coarse, 2)
        Where in the next two each coarse row begins.
    half_places, to_places
        As in `aggregation.product_places`.
    to_offsets
        Of Pᵀ A P.
    to_values
        Overwritten.
    """
    part_offsets, _, part_shares = part
    row_offsets, rows, row_shares = row
    half_offsets, half_columns = half
    n = row_offsets.size - 1
    size = chunk_rows(n)
    for chunk in prange((n + size - 1) // size):
        longest = 0
        for r in range(chunk * size, min(n, (chunk + 1) * size)):
            longest = max(longest, half_offsets[r + 1] - half_offsets[r])
        sums = np.empty((longest, 4), np.float32)
        for r in range(chunk * size, min(n, (chunk + 1) * size)):
            first = half_offsets[r]
            n_half = half_offsets[r + 1] - first
            for t in range(n_half):
                for d in range(4):
                    sums[t, d] = 0.0
            at = starts[r, 0]
            for a in range(row_offsets[r], row_offsets[r + 1]):
                i, share = rows[a], row_shares[a]
                for k in range(offsets[i], offsets[i + 1]):
                    t = half_places[at]
                    at += 1
                    for d in range(4):
                        sums[t, d] += share * values[k, d]
            base = to_offsets[r]
            for k in range(base, to_offsets[r + 1]):
                for d in range(4):
                    to_values[k, d] = 0.0
            at = starts[r, 1]
            for t in range(n_half):
                j = half_columns[first + t]
                for p in range(part_offsets[j], part_offsets[j + 1]):
                    k = base + to_places[at]
                    at += 1
                    share = part_shares[p]
                    for d in range(4):
                        to_values[k, d] += share * sums[t, d]


@parallel_kernel()
def sweep_forward(
    offsets: IndexArray,
    columns: TableArray,
    diagonal: IndexArray,
    values: SingleArray,
    inverse: SingleArray,
    right: SingleArray,
    x: SingleArray,
) -> None:
    """Sweep once over the rows from x = 0, each solved for its own block, chunk by chunk.

    Parameters
    ----------
    offsets, columns, diagonal, values, inverse
        A matrix, and the inverse blocks on its diagonal.
    right : (n, 2)
        The right-hand side.
    x : (n, 2)
        Overwritten.
    """
    n = diagonal.size
    size = chunk_rows(n)
    for chunk in prange((n + size - 1) // size):
        begin = chunk * size
        for i in range(begin, min(n, begin + size)):
            a, b = right[i, 0], right[i, 1]
            for k in range(diagonal[i] - 1, offsets[i] - 1, -1):
                j = columns[k]
                if j < begin:
                    break
                a -= values[k, 0] * x[j, 0] + values[k, 1] * x[j, 1]
                b -= values[k, 2] * x[j, 0] + values[k, 3] * x[j, 1]
            x[i, 0] = inverse[i, 0] * a + inverse[i, 1] * b
            x[i, 1] = inverse[i, 1] * a + inverse[i, 2] * b


@parallel_kernel()
def remaining(
    offsets: IndexArray,
    columns: TableArray,
    diagonal: IndexArray,
    values: SingleArray,
    x: SingleArray,
    residual: SingleArray,
) -> None:
    """Work out what is left of the right-hand side after `sweep_forward`.

    Parameters are those of `sweep_forward`; `residual`, (n, 2), is overwritten. What a row has
    solved is done with: only what came after it is left.
    """
    n = diagonal.size
    size = chunk_rows(n)
    for chunk in prange((n + size - 1) // size):
        begin = chunk * size
        for i in range(begin, min(n, begin + size)):
            a, b = np.float32(0.0), np.float32(0.0)
            for k in range(diagonal[i] + 1, offsets[i + 1]):
                j = columns[k]
                a -= values[k, 0] * x[j, 0] + values[k, 1] * x[j, 1]
                b -= values[k, 2] * x[j, 0] + values[k, 3] * x[j, 1]
            for k in range(offsets[i], diagonal[i]):
                j = columns[k]
                if j >= begin:
                    break
                a -= values[k, 0] * x[j, 0] + values[k, 1] * x[j, 1]
                b -= values[k, 2] * x[j, 0] + values[k, 3] * x[j, 1]
            residual[i, 0], residual[i, 1] = a, b


@parallel_kernel()
def combine(
    offsets: IndexArray, columns: TableArray, shares: SingleArray, x: SingleArray, out: SingleArray
) -> None:
    """Overwrite each row with a sum of shares of others: Pᵀ x."""
    for r in prange(offsets.size - 1):
        a, b = np.float32(0.0), np.float32(0.0)
        for k in range(offsets[r], offsets[r + 1]):
            a += shares[k] * x[columns[k], 0]
            b += shares[k] * x[columns[k], 1]
        out[r, 0], out[r, 1] = a, b


@parallel_kernel()
def add_parts(
    offsets: IndexArray,
    parts: TableArray,
    shares: SingleArray,
    coarse: SingleArray,
    x: SingleArray,
    out: SingleArray,
) -> None:
    """Add the coarse displacement: x + P · coarse."""
    for i in prange(offsets.size - 1):
        a, b = x[i, 0], x[i, 1]
        for k in range(offsets[i], offsets[i + 1]):
            a += shares[k] * coarse[parts[k], 0]
            b += shares[k] * coarse[parts[k], 1]
        out[i, 0], out[i, 1] = a, b


@parallel_kernel()
def sweep_backward(
    offsets: IndexArray,
    columns: TableArray,
    values: SingleArray,
    inverse: SingleArray,
    right: SingleArray,
    before: SingleArray,
    x: SingleArray,
) -> None:
    """Sweep once over the rows, the last one first, chunk by chunk.

    Parameters
    ----------
    offsets, columns, values, inverse, right
        As in `sweep_forward`.
    before : (n, 2)
        What to begin with.
    x : (n, 2)
        Overwritten.
    """
    n = inverse.shape[0]
    size = chunk_rows(n)
    for chunk in prange((n + size - 1) // size):
        end = min(n, (chunk + 1) * size)
        for i in range(end - 1, chunk * size - 1, -1):
            a, b = right[i, 0], right[i, 1]
            for k in range(offsets[i], offsets[i + 1]):
                j = columns[k]
                if j == i:
                    continue
                if i < j < end:
                    vx, vy = x[j, 0], x[j, 1]
                else:
                    vx, vy = before[j, 0], before[j, 1]
                a -= values[k, 0] * vx + values[k, 1] * vy
                b -= values[k, 2] * vx + values[k, 3] * vy
            x[i, 0] = inverse[i, 0] * a + inverse[i, 1] * b
            x[i, 1] = inverse[i, 1] * a + inverse[i, 2] * b


@parallel_kernel()
def multiply(
    offsets: IndexArray,
    columns: TableArray,
    values: FloatArray | SingleArray,
    x: FloatArray,
    out: FloatArray,
    products: FloatArray,
) -> None:
    """Multiply a vector by the matrix.

    Parameters
    ----------
    x, out : (n, 2)
        The vector; overwritten.
    products : (MOST_CHUNKS,)
        Overwritten. Their scalar product, chunk by chunk.
    """
    n = offsets.size - 1
    size = chunk_rows(n)
    products[:] = 0.0
    for chunk in prange((n + size - 1) // size):
        total = 0.0
        for i in range(chunk * size, min(n, (chunk + 1) * size)):
            a, b = 0.0, 0.0
            for k in range(offsets[i], offsets[i + 1]):
                vx, vy = x[columns[k], 0], x[columns[k], 1]
                a += values[k, 0] * vx + values[k, 1] * vy
                b += values[k, 2] * vx + values[k, 3] * vy
            out[i, 0], out[i, 1] = a, b
            total += a * x[i, 0] + b * x[i, 1]
        products[chunk] = total


@parallel_kernel()
def go_along(
    share: float,
    direction: FloatArray,
    image: FloatArray,
    x: FloatArray,
    residual: FloatArray,
    rounded: SingleArray,
) -> None:
    """Go along a direction of conjugate gradients, in place.

    Parameters
    ----------
    share
        How far.
    direction, image : (n, 2)
        The direction, and the matrix times it.
    x, residual : (n, 2)
        Changed.
    rounded : (n, 2)
        Overwritten with the residual.
    """
    for i in prange(x.shape[0]):
        for d in range(2):
            x[i, d] += share * direction[i, d]
            left = residual[i, d] - share * image[i, d]
            residual[i, d], rounded[i, d] = left, left


@parallel_kernel()
def turn(share: float, downhill: SingleArray, direction: FloatArray) -> None:
    """Make the next direction of conjugate gradients of the last and of where it is downhill."""
    for i in prange(direction.shape[0]):
        for d in range(2):
            direction[i, d] = downhill[i, d] + share * direction[i, d]


@parallel_kernel()
def scalar_product(x: FloatArray, y: SingleArray, products: FloatArray) -> None:
    """Multiply two vectors, (n, 2), chunk by chunk."""
    n = x.shape[0]
    size = chunk_rows(n)
    products[:] = 0.0
    for chunk in prange((n + size - 1) // size):
        total = 0.0
        for i in range(chunk * size, min(n, (chunk + 1) * size)):
            total += x[i, 0] * y[i, 0] + x[i, 1] * y[i, 1]
        products[chunk] = total
