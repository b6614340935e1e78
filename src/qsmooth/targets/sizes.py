"""Sizes: areas of cells without what is noise in them, and whether they are graded on purpose."""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.targets.algebra import step
from qsmooth.targets.base import Targets, blocks
from qsmooth.topology import Topology

# Log areas are averaged over so many rings; noise is what differs from that, averaged over some
# more, and trend how far the averages vary in the whole mesh. Trend over noise: random triangles
# .7, meshes meant to be uniform .5 to 1.6, graded ones 3 to 100, tri_adapt 17 and shaken 3.2.
AREA_RINGS, NOISE_RINGS = 3, 6
AREA_TREND = 2.0, 4.0
# Noise in log areas at which half of what the averages leave is taken away.
AREA_NOISE = 0.1
# Added to the noise, so that a mesh of equal cells has no trend.
LEAST_NOISE = 0.01
# So small a share of an average counts as none.
LEAST_SHARE = 1e-12


def with_sizes(targets: Targets, topology: Topology, xy: FloatArray, weight: float) -> Targets:
    """Ask for a size of every cell: that of the targets, else its own, averaged as gradings are.

    Parameters
    ----------
    xy : (n_vertices, 2)
        A valid mesh; the area of a cell without any counts as the mean of all.
    weight
        Weight of the size term; layers keep theirs where that is larger.
    """
    sized = targets.size_weight > 0.0
    area = targets.area
    if not sized.all():
        unit = unit_of(xy)
        own = log_areas(topology, xy / unit)
        own, _, _ = without_area_noise(topology, own, np.ones(own.size, np.bool_))
        area = np.where(sized, area, np.exp(own) * unit**2)
    heavier = np.where(targets.is_layer, np.maximum(targets.size_weight, weight), weight)
    return targets._replace(area=area, size_weight=heavier)


def unit_of(xy: FloatArray) -> float:
    """Give a power of two near the size of the mesh: in it logarithms do not depend on the unit."""
    size = float(np.ptp(xy, axis=0).max(initial=0.0))
    return math.ldexp(1.0, math.frexp(size)[1]) if size > 0.0 else 1.0


def without_sizes(targets: Targets) -> Targets:
    """Ask for no size, but of layers."""
    return targets._replace(size_weight=np.where(targets.is_layer, targets.size_weight, 0.0))


def log_areas(topology: Topology, xy: FloatArray) -> FloatArray:
    """Log of what a cell's corners have for determinants, in the mean: (n_cells,)."""
    area = mean_determinants(topology, xy)
    good = area > 0.0
    mean = float(area[good].mean()) if good.any() else 1.0
    return np.log(np.where(good, area, mean))


def mean_determinants(topology: Topology, xy: FloatArray) -> FloatArray:
    """Mean of det(u, w) over each cell's corners, (n_cells,): twice the area of a triangle."""
    area = np.empty(topology.n_cells)
    for size, cells, places in blocks(topology):
        p = xy[topology.cell_vertices[places]]
        d, e = p[:, 2] - p[:, 0], p[:, -1] - p[:, 1]
        area[cells] = (0.5 if size == 4 else 1.0) * (d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])
    return area


def grading(topology: Topology, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weight of the areas as part of a smooth grading, and their logs without noise: (n_cells,).

    The areas are those of a corner: twice a triangle's. Only triangles count: beside the end of a
    layer they may be a thousand times as small as its quads, and not by chance.
    """
    area = np.abs(mean_determinants(topology, xy))
    logs = np.log(np.maximum(area, 1e-60 * (float(area.max()) or 1.0)))
    counts = topology.cell_sizes == 3
    cleaned, smooth, noise = without_area_noise(topology, logs, counts)
    trend = float(smooth[counts].std())
    return step(trend / (noise + LEAST_NOISE), AREA_TREND), cleaned


def without_area_noise(
    topology: Topology, logs: FloatArray, counts: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log areas without noise; what is smooth in them, less their mean; and the noise.

    Only cells that count are averaged; what is given of the others means nothing.
    """

    def average(values: FloatArray, rings: int) -> FloatArray:
        both = np.stack([np.where(counts, values, 0.0), counts], axis=1)
        sums = over_rings(topology, both, rings)
        return np.asarray(sums[:, 0] / np.maximum(sums[:, 1], LEAST_SHARE))

    centred = logs - logs[counts].mean()
    smooth = average(centred, AREA_RINGS)
    noise = np.sqrt(average((centred - smooth) ** 2, NOISE_RINGS))
    share = noise**4 / (noise**4 + AREA_NOISE**4)
    return logs + share * (smooth - centred), smooth, noise


def over_rings(topology: Topology, values: FloatArray, rings: int) -> FloatArray:
    """Average over neighbours, so often; (n_cells, k)."""
    from qsmooth.kernels.sheets import mean_with_neighbours

    old, new = values.copy(), np.empty_like(values)
    for _ in range(rings):
        mean_with_neighbours(topology.cell_offsets, topology.twins, topology.corner_cells, old, new)
        old, new = new, old
    return old
