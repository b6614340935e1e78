"""What triangles are meant to be: layers, stretched as those around, graded."""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.targets.algebra import (
    corners_of_triangle,
    dots,
    from_log,
    half_rectangle,
    log_from_equilateral,
    log_in_plane,
    step,
)
from qsmooth.targets.sheets import Sheets
from qsmooth.targets.sizes import grading, over_rings
from qsmooth.topology import Topology

# Averages of triangles' metrics, over so many rings, that are stretched as much mean it.
TRIANGLE_STRETCH, TRIANGLE_RINGS = (math.log(4.0), math.log(8.0)), 4
TRIANGLE_SCATTER = 0.6, 0.3
# So many of them hang together: a few slivers at a border make up each other's averages.
GROUP = 12, 36


def fill_triangles(
    topology: Topology,
    xy: FloatArray,
    sheets: Sheets,
    layer: FloatArray,
    log_ratio: FloatArray,
    log_area: FloatArray,
    corners: FloatArray,
    area: FloatArray,
    weight: FloatArray,
) -> None:
    """Fill in corners, log areas and weights of the triangles, in place."""
    triangles = np.flatnonzero(topology.cell_sizes == 3)
    if not triangles.size:
        return
    first = topology.cell_offsets[triangles]
    p = xy[topology.cell_vertices[first[:, None] + np.arange(3)]]
    u, w = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    det = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    good = det > 0.0
    in_plane = np.zeros((topology.n_cells, 3))
    in_plane[triangles, :2] = log_in_plane(u, w, np.where(good, det, 1.0)) * good[:, None]
    in_plane[:, 2] = dots(in_plane, in_plane)
    mean = over_rings(topology, in_plane, TRIANGLE_RINGS)[triangles]
    stretch = np.hypot(mean[:, 0], mean[:, 1])
    scatter = np.sqrt(np.maximum(mean[:, 2] - stretch**2, 0.0))
    meant = step(stretch, TRIANGLE_STRETCH) * good
    meant *= step(scatter / np.maximum(stretch, TRIANGLE_STRETCH[0]), TRIANGLE_SCATTER)
    meant *= step(_group_sizes(topology, sheets, layer, triangles, meant), GROUP)
    log_shape = np.zeros((triangles.size, 2))
    rows = np.flatnonzero(meant)
    u, w = u[rows], w[rows]
    own = np.stack([dots(w, w), -dots(u, w), dots(u, u)], axis=1) / det[rows, None]
    log_shape[rows] = meant[rows, None] * log_from_equilateral(own)

    graded, log_det = grading(topology, xy)
    log_det, own_weight = log_det[triangles], np.maximum(graded[triangles], meant) * good
    # Pairs that are of a layer: halves of rectangles.
    place = np.full(topology.n_cells, -1)
    place[triangles] = np.arange(triangles.size)
    pairs = np.arange(sheets.n_quads, len(sheets.sides))
    pairs = pairs[layer[pairs] > 0.0]
    for cells, side in ((sheets.first, 0), (sheets.second, 2)):
        rows = place[cells[pairs]]
        half = half_rectangle(log_ratio[pairs], sheets.sides[pairs, side] - first[rows])
        share = layer[pairs]
        log_shape[rows] += share[:, None] * (log_from_equilateral(half) - log_shape[rows])
        log_det[rows] += share * (log_area[pairs] - log_det[rows])
        own_weight[rows] = np.maximum(own_weight[rows], share)
    rows = np.flatnonzero(log_shape.any(axis=1))
    own = corners_of_triangle(from_log(log_shape[rows]))
    corners[first[rows, None] + np.arange(3)] = own
    area[triangles], weight[triangles] = log_det, own_weight


def _group_sizes(
    topology: Topology,
    sheets: Sheets,
    layer: FloatArray,
    triangles: IndexArray,
    meant: FloatArray,
) -> FloatArray:
    """Count what hangs together with each triangle: stretched ones, and cells of layers."""
    from qsmooth.kernels.sheets import group_sizes

    marked = np.zeros(topology.n_cells, np.bool_)
    marked[triangles] = meant > 0.0
    for cells in (sheets.first, sheets.second):
        marked[cells[layer > 0.0]] = True
    sides = topology.cell_offsets, topology.twins, topology.corner_cells
    return np.asarray(group_sizes(*sides, marked)[triangles].astype(float))
