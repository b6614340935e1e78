"""Slopes of what is known as one number a cell."""

from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import parallel_kernel

# Neighbours whose second moment across a line is under this share of that along it are on the line.
ON_A_LINE = 1e-10


@parallel_kernel()
def cell_gradients(
    centres: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    stars: tuple[IndexArray, IndexArray],
    values: FloatArray,
    out: FloatArray,
) -> None:
    """Fit a linear function to each cell and those that share a vertex with it.

    By least squares of the differences to the cell's own value, weighted by one over the distance
    squared; a cell that shares an edge counts twice.

    Parameters
    ----------
    centres : (n_cells, 2)
        Centroids.
    cells, stars
        CSR maps from a cell to its vertices and from a vertex to its cells.
    values : (n_cells, k)
        One number a cell of each of `k` quantities.
    out : (n_cells, k, 2)
        Overwritten. Slopes along x and y. Where all neighbours lie on a line there is none across
        it.
    """
    cell_offsets, cell_vertices = cells
    star_offsets, star_cells = stars
    for c in prange(len(out)):
        cx, cy = centres[c, 0], centres[c, 1]
        xx = x_y = yy = 0.0
        for j in range(values.shape[1]):
            out[c, j, 0] = out[c, j, 1] = 0.0
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            v = cell_vertices[k]
            for s in range(star_offsets[v], star_offsets[v + 1]):
                other = star_cells[s]
                dx, dy = centres[other, 0] - cx, centres[other, 1] - cy
                square = dx * dx + dy * dy
                if square == 0.0:
                    continue
                ux, uy = dx / square, dy / square
                xx, x_y, yy = xx + ux * dx, x_y + ux * dy, yy + uy * dy
                for j in range(values.shape[1]):
                    step = values[other, j] - values[c, j]
                    out[c, j, 0] += ux * step
                    out[c, j, 1] += uy * step
        trace, det = xx + yy, xx * yy - x_y * x_y
        for j in range(values.shape[1]):
            bx, by = out[c, j, 0], out[c, j, 1]
            if det > ON_A_LINE * trace * trace:
                out[c, j, 0] = (yy * bx - x_y * by) / det
                out[c, j, 1] = (xx * by - x_y * bx) / det
            elif trace > 0.0:
                # The right side lies along the line, on which the matrix multiplies by its trace.
                out[c, j, 0] = bx / trace
                out[c, j, 1] = by / trace
