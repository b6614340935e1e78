"""All that is asked of every cell after each round of the optimiser, in one pass."""

import numpy as np
from numba import prange

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import parallel_kernel
from qsmooth.kernels.cell_energy import badness_and_size, mapped_shape
from qsmooth.kernels.cell_lanes import diamond_angle
from qsmooth.kernels.corner_energy import Target, corner_shape, ideal_corner_shape
from qsmooth.kernels.geometry import certainly_left, corner_dot, corner_jacobian
from qsmooth.kernels.star_energy import SINE_60


@parallel_kernel()
def round_figures(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    movable: BoolArray,
    targets: FloatArray,
    sizes: FloatArray,
    maps: FloatArray,
    badness: FloatArray,
    energy: FloatArray,
    worst: FloatArray,
    shape: FloatArray,
    smallest: FloatArray,
    largest: FloatArray,
    area: FloatArray,
    certain: BoolArray,
) -> None:
    """Measure what several kernels do one by one, to the same bits, in one pass over the corners.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices, movable, targets, sizes, maps
        As in `cell_energy`.
    badness, energy : (n_cells,)
        Overwritten, as by `cell_energy`;
    worst : (n_cells,)
        the largest shape energy of its corners towards their targets; 1 at best, infinite where a
        corner is not positive;
    shape, area, smallest, largest : (n_cells,)
        as by `cell_figures`, the angles in its diamond measure.
    certain : (n_cells,)
        Overwritten: whether a cell is valid beyond any rounding error.
    """
    mapped = maps.shape[0] > 0
    for c in prange(badness.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        is_triangle = last - first == 3
        best_sine = SINE_60 if is_triangle else 1.0
        inv_area, weight = sizes[c, 0], sizes[c, 1]
        g, total, f, ratio = 0.0, 0.0, 1.0, np.inf
        low, high, twice, sure = 4.0, 0.0, 0.0, True
        at_d = cell_vertices[last - 1]
        dx, dy, d_moves = xy[at_d, 0], xy[at_d, 1], movable[at_d]
        at_a = cell_vertices[first]
        ax, ay, a_moves = xy[at_a, 0], xy[at_a, 1], movable[at_a]
        x0, y0 = ax, ay
        for k in range(first, last):
            at_b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            bx, by, b_moves = xy[at_b, 0], xy[at_b, 1], movable[at_b]
            ux, uy, wx, wy = bx - ax, by - ay, dx - ax, dy - ay
            target = Target(targets[k, 0], targets[k, 1], targets[k, 2])
            n, det = corner_shape(target, ux, uy, wx, wy)
            if mapped:
                n = mapped_shape(target, maps[c, 0], maps[c, 1], maps[c, 2], ux, uy, wx, wy)
            energy_here = n / det if det > 0.0 else np.inf
            f = max(f, energy_here)
            if a_moves or b_moves or d_moves:
                if det > 0.0:
                    own, size = badness_and_size(det, ux, uy, wx, wy, best_sine, inv_area, weight)
                    g = max(g, own)
                    total += energy_here
                    total += size
                else:
                    g, total = np.inf, np.inf
            if k == first or not is_triangle:
                n, det = ideal_corner_shape(is_triangle, ux, uy, wx, wy)
                ratio = np.minimum(ratio, 0.0 if n == 0.0 else det / n)
            angle = diamond_angle(
                corner_jacobian(ax, ay, bx, by, dx, dy), corner_dot(ax, ay, bx, by, dx, dy)
            )
            low, high = np.minimum(low, angle), np.maximum(high, angle)
            sure &= certainly_left(dx, dy, ax, ay, bx, by)
            if k > first and k + 1 < last:
                twice += corner_jacobian(x0, y0, ax, ay, bx, by)
            dx, dy, d_moves = ax, ay, a_moves
            ax, ay, a_moves = bx, by, b_moves
        badness[c], energy[c] = g, total / (last - first)
        worst[c], shape[c] = f, np.maximum(ratio, 0.0)
        smallest[c], largest[c] = low, high
        area[c], certain[c] = 0.5 * twice, sure
