"""What the optimiser asks of every cell after a round of sweeps: its energies."""

import math

import numpy as np
from numba import prange

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel, parallel_kernel
from qsmooth.kernels.corner_energy import Target, corner_shape
from qsmooth.kernels.star_energy import SINE_60, SLIM_SQUARINGS, power


@helper()
def mapped_shape(
    target: Target,
    l11: float,
    l12: float,
    l22: float,
    ux: float,
    uy: float,
    wx: float,
    wy: float,
) -> float:
    """Give the numerator of a corner's shape energy for mapped edges; the determinant stays."""
    return corner_shape(
        target, l11 * ux + l12 * uy, l12 * ux + l22 * uy, l11 * wx + l12 * wy, l12 * wx + l22 * wy
    )[0]


@helper()
def badness_and_size(
    det: float,
    ux: float,
    uy: float,
    wx: float,
    wy: float,
    best_sine: float,
    inv_area: float,
    size_weight: float,
) -> tuple[float, float]:
    """Badness g of a corner with a positive determinant, and its size term."""
    lengths = math.sqrt((ux * ux + uy * uy) * (wx * wx + wy * wy))
    size = 0.0
    if size_weight > 0.0:
        tau = det * inv_area
        size = 0.5 * size_weight * (tau - 1.0 / tau) ** 2
    return best_sine * lengths / det, size


@parallel_kernel()
def cell_energy(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    movable: BoolArray,
    targets: FloatArray,
    sizes: FloatArray,
    maps: FloatArray,
    badness: FloatArray,
    energy: FloatArray,
) -> None:
    """Measure each cell's largest badness g, and its energy: shape and size, mean of its corners.

    Parameters
    ----------
    movable : (n_vertices,)
        Corners without a movable vertex can't change and do not count.
    targets : (n_corners, 3)
        m11, m12, m22 at each corner (`corner_energy.Target`).
    sizes : (n_cells, 2)
        One over the target of the corners' determinants, and the weight of the size term.
    maps : (n_cells, 3) or (0, 3)
        l11, l12, l22 of the maps that edges take before f does; none where there are none.
    badness, energy : (n_cells,)
        Overwritten; 0 where no corner counts, infinite where one that does is not positive.
    """
    for c in prange(badness.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        best_sine = SINE_60 if last - first == 3 else 1.0
        inv_area, weight = sizes[c, 0], sizes[c, 1]
        worst, total = 0.0, 0.0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            if movable[a] or movable[b] or movable[d]:
                ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
                wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
                target = Target(targets[k, 0], targets[k, 1], targets[k, 2])
                n, det = corner_shape(target, ux, uy, wx, wy)
                if maps.shape[0] > 0:
                    n = mapped_shape(target, maps[c, 0], maps[c, 1], maps[c, 2], ux, uy, wx, wy)
                if det > 0.0:
                    g, size = badness_and_size(det, ux, uy, wx, wy, best_sine, inv_area, weight)
                    worst = max(worst, g)
                    total += n / det
                    total += size
                else:
                    worst, total = np.inf, np.inf
            d = a
        badness[c] = worst
        energy[c] = total / (last - first)


@kernel()
def cell_heights(
    energy: FloatArray,
    worst: FloatArray,
    badness: FloatArray,
    weights: FloatArray,
    slim: FloatArray,
    scale: FloatArray,
    squarings: int,
    out: FloatArray,
) -> None:
    """Put together what sweeps bring down: energy, and the walls on shape and badness.

    Parameters
    ----------
    energy, worst, badness : (n_cells,)
        As by `round_figures`.
    weights : (n_cells,)
        What the energy counts for; cells with less than 0 do not count at all.
    slim, scale : (n_cells,)
        One over where the walls on shape and on badness stand; 0 for none.
    squarings
        The wall on badness is of power 2 ** squarings.
    out : (n_cells,)
        Overwritten.
    """
    for c in range(out.size):
        out[c] = 0.0
        if weights[c] >= 0.0:
            out[c] = weights[c] * energy[c]
            if slim[c] > 0.0:
                out[c] += power(worst[c] * slim[c], SLIM_SQUARINGS)
            if scale[c] > 0.0:
                out[c] += power(badness[c] * scale[c], squarings)


@kernel()
def worst_around(
    worst: FloatArray,
    rings: int,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    n_vertices: int,
) -> FloatArray:
    """Find the largest value among the cells of so many rings around each cell.

    Parameters
    ----------
    worst : (n_cells,)
        A value of each cell, 0 or more.
    """
    at, now = np.empty(n_vertices), worst.copy()
    for _ in range(rings):
        for v in range(n_vertices):
            at[v] = 0.0
        for c in range(now.size):
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                v = cell_vertices[k]
                at[v] = max(at[v], now[c])
        for c in range(now.size):
            for k in range(cell_offsets[c], cell_offsets[c + 1]):
                now[c] = max(now[c], at[cell_vertices[k]])
    return now
