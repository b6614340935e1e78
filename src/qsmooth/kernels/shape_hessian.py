"""Gradient and Hessian of the shape energy of a whole mesh, for Newton steps on all vertices.

With the edge vectors u, w of a corner (of its image under the map that makes a corner of the target
shape square), put a for the length of their conformal part
(u_x + w_y, u_y − w_x) / √2 and b for that of their anticonformal part (u_x − w_y, u_y + w_x) / √2.
Then |u|² + |w|² = a² + b² and 2 det(u, w) = a² − b², so that the energy is
(a² + b²) / (a² − b²). It does not depend on the directions of the two parts: the eigenvalues of its
4 by 4 Hessian are those along the two circles and those of a 2 by 2 matrix in a and b. Clipping
them at zero gives the nearest semi-definite matrix in closed form.
"""

import math

import numpy as np

from qsmooth._types import FloatArray, IndexArray, SingleArray, TableArray
from qsmooth.kernels._jit import helper, kernel
from qsmooth.kernels.aggregation import sorted_rows
from qsmooth.kernels.corner_energy import Target

ROOT_HALF = math.sqrt(0.5)
# Among so many columns the one that is wanted is found quickest one by one.
FEW = 16


@kernel()
def block_pattern(
    unknown: IndexArray,
    n_unknown: int,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    star_offsets: IndexArray,
    star_cells: IndexArray,
    vertices: IndexArray,
) -> tuple[IndexArray, TableArray]:
    """Rows of the block matrix that couples the movable vertices of a cell with each other.

    Parameters
    ----------
    unknown : (n_vertices,)
        Number of each movable vertex's block row, -1 for the others.
    vertices : (n_unknown,)
        Vertex of each block row.

    Returns
    -------
    offsets, columns : (n_unknown + 1,), (n_blocks,)
        CSR map, columns ascending.
    """
    offsets = np.zeros(n_unknown + 1, np.int64)
    seen = np.full(n_unknown, -1, np.int64)
    columns = np.empty(0, np.uint32)
    for phase in range(2):
        seen[:] = -1
        for r in range(n_unknown):
            v = vertices[r]
            count = 0
            for s in range(star_offsets[v], star_offsets[v + 1]):
                c = star_cells[s]
                for k in range(cell_offsets[c], cell_offsets[c + 1]):
                    column = unknown[cell_vertices[k]]
                    if column >= 0 and seen[column] != r:
                        seen[column] = r
                        if phase == 1:
                            columns[offsets[r] + count] = column
                        count += 1
            if phase == 0:
                offsets[r + 1] = offsets[r] + count
        if phase == 0:
            columns = np.empty(offsets[-1], np.uint32)
    return offsets, sorted_rows(offsets, columns)


@helper()
def _projected(radial_a: float, mixed: float, radial_b: float) -> tuple[float, float, float]:
    """Clip the eigenvalues of a symmetric 2 by 2 matrix at zero."""
    mean = 0.5 * (radial_a + radial_b)
    half = 0.5 * (radial_a - radial_b)
    root = math.sqrt(half * half + mixed * mixed)
    low, high = mean - root, mean + root
    if low >= 0.0:
        return radial_a, mixed, radial_b
    if high <= 0.0:
        return 0.0, 0.0, 0.0
    # high · n nᵀ with n the eigenvector of the larger eigenvalue
    share = half / root
    return 0.5 * high * (1.0 + share), 0.5 * high * mixed / root, 0.5 * high * (1.0 - share)


@helper()
def corner_derivatives(
    ux: float, uy: float, wx: float, wy: float, gradient: FloatArray, hessian: FloatArray
) -> None:
    """Derivatives of the energy for a square by (ux, uy, wx, wy), the second made semi-definite.

    Parameters
    ----------
    gradient, hessian : (4,), (4, 4)
        Overwritten.
    """
    px, py = ROOT_HALF * (ux + wy), ROOT_HALF * (uy - wx)
    mx, my = ROOT_HALF * (ux - wy), ROOT_HALF * (uy + wx)
    aa, bb = px * px + py * py, mx * mx + my * my
    a, b = math.sqrt(aa), math.sqrt(bb)
    d = aa - bb
    inv = 1.0 / (d * d)
    f_a, f_b = -4.0 * a * bb * inv, 4.0 * aa * b * inv
    inv3 = inv / d
    h_aa, h_ab, h_bb = _projected(
        4.0 * bb * (3.0 * aa + bb) * inv3,
        -8.0 * a * b * (aa + bb) * inv3,
        4.0 * aa * (aa + 3.0 * bb) * inv3,
    )
    # Along p's circle the eigenvalue, f_a / a, is never positive; along m's, f_b / b, it always is.
    h_circle = 4.0 * aa * inv
    # Unit vectors of the two parts; where m vanishes its direction does not matter, as then
    # h_ab = 0 and h_bb = h_circle.
    pnx, pny = px / a, py / a
    mnx, mny = (mx / b, my / b) if b > 0.0 else (1.0, 0.0)
    # Rows: p's direction, m's direction and its normal in (ux, uy, wx, wy).
    e0, e1, e2, e3 = ROOT_HALF * pnx, ROOT_HALF * pny, -ROOT_HALF * pny, ROOT_HALF * pnx
    g0, g1, g2, g3 = ROOT_HALF * mnx, ROOT_HALF * mny, ROOT_HALF * mny, -ROOT_HALF * mnx
    n0, n1, n2, n3 = -ROOT_HALF * mny, ROOT_HALF * mnx, ROOT_HALF * mnx, ROOT_HALF * mny
    e, g, n = (e0, e1, e2, e3), (g0, g1, g2, g3), (n0, n1, n2, n3)
    for i in range(4):
        gradient[i] = f_a * e[i] + f_b * g[i]
        for j in range(4):
            hessian[i, j] = (
                h_aa * e[i] * e[j]
                + h_ab * (e[i] * g[j] + g[i] * e[j])
                + h_bb * g[i] * g[j]
                + h_circle * n[i] * n[j]
            )


@helper()
def add_size_term(
    ux: float,
    uy: float,
    wx: float,
    wy: float,
    inv_area: float,
    weight: float,
    gradient: FloatArray,
    hessian: FloatArray,
) -> None:
    """Add the derivatives of weight · ½ (τ − 1/τ)², τ = det(u, w) · inv_area, by (ux, uy, wx, wy).

    Of the second ones the semi-definite part: τ is taken as if it were linear.
    """
    tau = (ux * wy - uy * wx) * inv_area
    slope, second = weight * (tau - tau**-3), weight * (1.0 + 3.0 * tau**-4)
    by = (wy * inv_area, -wx * inv_area, -uy * inv_area, ux * inv_area)
    for i in range(4):
        gradient[i] += slope * by[i]
        for j in range(4):
            hessian[i, j] += second * by[i] * by[j]


@helper()
def fill_image(target: Target, weights: FloatArray) -> None:
    """Write down the image of a corner under the map that makes its target shape square.

    The image of the edges u, w is u, m12 u + m22 w, up to a common factor that the energy does not
    feel: then |image|² is m22 times the form of `corner_energy`.

    Parameters
    ----------
    weights : (3, 2)
        Overwritten. What the corner, its next and its previous vertex add to each of the two.
    """
    _, m12, m22 = target
    weights[0, 0], weights[0, 1] = -1.0, -(m12 + m22)
    weights[1, 0], weights[1, 1] = 1.0, m12
    weights[2, 0], weights[2, 1] = 0.0, m22


@helper()
def take_back(
    l11: float, l12: float, l22: float, gradient: FloatArray, hessian: FloatArray
) -> None:
    """Turn derivatives by mapped edges into those by the edges themselves, in place."""
    for i in (0, 2):
        x, y = gradient[i], gradient[i + 1]
        gradient[i], gradient[i + 1] = l11 * x + l12 * y, l12 * x + l22 * y
        for j in range(4):
            x, y = hessian[i, j], hessian[i + 1, j]
            hessian[i, j], hessian[i + 1, j] = l11 * x + l12 * y, l12 * x + l22 * y
    for j in (0, 2):
        for i in range(4):
            x, y = hessian[i, j], hessian[i, j + 1]
            hessian[i, j], hessian[i, j + 1] = l11 * x + l12 * y, l12 * x + l22 * y


@helper()
def _block_of(columns: TableArray, first: int, last: int, column: int) -> int:
    """Find the block of a column in its row, from `first` to before `last`."""
    low, high = first, last
    while high - low > FEW:
        middle = (low + high) // 2
        if columns[middle] <= column:
            low = middle
        else:
            high = middle
    while columns[low] != column:
        low += 1
    return low


@kernel()
def assemble(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    cells: IndexArray,
    unknown: IndexArray,
    offsets: IndexArray,
    columns: TableArray,
    targets: FloatArray,
    sizes: FloatArray,
    maps: FloatArray,
    gradient: FloatArray,
    values: FloatArray | SingleArray,
) -> None:
    """Sum the corners' derivatives into the gradient and the block matrix of the mesh.

    One thread, in the order of `cells`: the sums are the same whatever the machine.

    Parameters
    ----------
    cells : (n_cells,)
        All cells.
    unknown, offsets, columns
        As in `block_pattern`.
    targets, sizes, maps
        As in `cell_energy.cell_energy`.
    gradient : (n_unknown, 2)
        Overwritten.
    values : (n_blocks, 2, 2)
        Overwritten.
    """
    gradient[:] = 0.0
    values[:] = 0.0
    g, h = np.empty(4), np.empty((4, 4))
    weight = np.empty((3, 2))
    ids = np.empty(3, np.int64)
    for c in cells:
        first, last = cell_offsets[c], cell_offsets[c + 1]
        triangle = last - first == 3
        for k in range(first, last):
            ids[0] = cell_vertices[k]
            ids[1] = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            ids[2] = cell_vertices[k - 1] if k > first else cell_vertices[last - 1]
            free = False
            ux, uy, wx, wy = 0.0, 0.0, 0.0, 0.0
            for i in range(3):
                free = free or unknown[ids[i]] >= 0
            if not free:
                continue
            target = Target(targets[k, 0], targets[k, 1], targets[k, 2])
            fill_image(target, weight)
            x0, y0 = xy[ids[0], 0], xy[ids[0], 1]
            for i in range(1, 3):
                dx, dy = xy[ids[i], 0] - x0, xy[ids[i], 1] - y0
                ux += weight[i, 0] * dx
                uy += weight[i, 0] * dy
                wx += weight[i, 1] * dx
                wy += weight[i, 1] * dy
            if maps.shape[0] > 0:
                a, b, d = maps[c, 0], maps[c, 1], maps[c, 2]
                ux, uy = a * ux + b * uy, b * ux + d * uy
                wx, wy = a * wx + b * wy, b * wx + d * wy
            corner_derivatives(ux, uy, wx, wy, g, h)
            if sizes[c, 1] > 0.0:
                # The image has m22 times the area; maps keep it.
                add_size_term(ux, uy, wx, wy, sizes[c, 0] / target.m22, sizes[c, 1], g, h)
            if maps.shape[0] > 0:
                take_back(maps[c, 0], maps[c, 1], maps[c, 2], g, h)
            for i in range(3):
                row = unknown[ids[i]]
                if row < 0:
                    continue
                wi0, wi1 = weight[i, 0], weight[i, 1]
                for d in range(2):
                    gradient[row, d] += wi0 * g[d] + wi1 * g[2 + d]
                for j in range(3):
                    column = unknown[ids[j]]
                    if column < 0:
                        continue
                    low = _block_of(columns, offsets[row], offsets[row + 1], column)
                    wj0, wj1 = weight[j, 0], weight[j, 1]
                    for d in range(2):
                        for e in range(2):
                            values[low, d, e] += wi0 * (wj0 * h[d, e] + wj1 * h[d, 2 + e]) + wi1 * (
                                wj0 * h[2 + d, e] + wj1 * h[2 + d, 2 + e]
                            )
            if triangle:
                break
