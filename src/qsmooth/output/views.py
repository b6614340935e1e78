"""What to zoom on: windows on a mesh, and the cells in them."""

from __future__ import annotations

from typing import Any

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.mesh import Mesh
from qsmooth.metrics import Quality

# A zoomed view shows about so many cells.
ZOOM_CELLS = 120
# Places that are tried when looking for the narrowest and the best.
CANDIDATES = 120
# Of the places with about the largest share of the boundary, from this fraction up, the smallest
# is shown as the narrow one.
NARROW_SHARE = 0.9

# Windows are (2, 2): lower left and upper right corner, in the plane of the mesh.


def whole_window(*meshes: Mesh) -> FloatArray:
    """All of the meshes, which have the same cells, and a margin."""
    used = np.diff(meshes[0].star_offsets) > 0
    low = np.min([mesh.xy[used].min(axis=0) for mesh in meshes], axis=0)
    high = np.max([mesh.xy[used].max(axis=0) for mesh in meshes], axis=0)
    margin = 0.02 * _extent(low, high)
    return np.array([low - margin, high + margin])


def _extent(low: FloatArray, high: FloatArray) -> float:
    """Larger side of a box; of a mesh that is collapsed to a point, something to draw in."""
    extent = float((high - low).max())
    largest = float(max(np.abs(low).max(), np.abs(high).max()))
    return extent if extent > 1e-12 * largest else (1e-6 * largest or 1.0)


def _centres(mesh: Mesh) -> FloatArray:
    sums = np.add.reduceat(mesh.xy[mesh.cell_vertices], mesh.cell_offsets[:-1], axis=0)
    centres: FloatArray = sums / np.diff(mesh.cell_offsets)[:, None]
    return centres


def _nearest(centres: FloatArray, cell: int) -> IndexArray:
    """Cells around a cell, itself included: the nearest in the larger of the coordinates."""
    away = np.abs(centres - centres[cell]).max(axis=1)
    k = min(ZOOM_CELLS, len(away)) - 1
    return np.flatnonzero(away <= np.partition(away, k)[k])


def window_around(mesh: Mesh, cell: int, slope: float = 1.0) -> FloatArray:
    """Window on the cells around a cell, its height `slope` times its width."""
    near = _nearest(_centres(mesh), cell)
    corners = np.concatenate([part.reshape(-1, 2) for part in cell_corners(mesh, near)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    width = max(float(high[0] - low[0]), float(high[1] - low[1]) / slope)
    width = 1.02 * (width if width > 0.0 else _extent(low, high))
    half = 0.5 * np.array([width, slope * width])
    middle = low + 0.5 * (high - low)
    return np.array([middle - half, middle + half])


def _candidates(mesh: Mesh) -> IndexArray:
    # On large meshes fewer, as each is compared with all cells.
    n = min(CANDIDATES, mesh.n_cells, max(20, 1_000_000 // mesh.n_cells))
    return np.unique(np.linspace(0, mesh.n_cells - 1, n).astype(np.int64))


def narrow_window(mesh: Mesh) -> FloatArray:
    """Around the candidate whose neighbourhood has many corners on the boundary and is small."""
    sizes = np.diff(mesh.cell_offsets)
    on_boundary = mesh.is_boundary[mesh.cell_vertices].astype(np.float64)
    share = np.add.reduceat(on_boundary, mesh.cell_offsets[:-1]) / sizes
    centres, candidates = _centres(mesh), _candidates(mesh)
    near = [_nearest(centres, int(c)) for c in candidates]
    shares = np.array([share[cells].mean() for cells in near])
    extents = np.array([np.ptp(centres[cells], axis=0).max() for cells in near])
    extents[shares < NARROW_SHARE * shares.max()] = np.inf
    return window_around(mesh, int(candidates[int(np.argmin(extents))]))


def good_window(mesh: Mesh, measured: Quality) -> FloatArray:
    """Around the candidate whose neighbourhood has the best worst cell, then the best mean."""
    centres, candidates = _centres(mesh), _candidates(mesh)
    near = [measured["scaled_jacobian"][_nearest(centres, int(c))] for c in candidates]
    ranked = [(float(of.min()), float(of.mean())) for of in near]
    return window_around(mesh, int(candidates[ranked.index(max(ranked))]))


def edge_lengths(mesh: Mesh) -> FloatArray:
    """Mean length of the edges at each vertex, (n_vertices,); 0 where there is none."""
    counts = np.diff(mesh.ring_offsets)
    rows = np.repeat(np.arange(mesh.n_vertices), counts)
    lengths = np.linalg.norm(mesh.xy[mesh.ring_vertices] - mesh.xy[rows], axis=1)
    means: FloatArray = np.bincount(rows, lengths, mesh.n_vertices) / np.maximum(counts, 1)
    return means


def cells_in(mesh: Mesh, window: FloatArray) -> BoolArray:
    """Cells whose bounding box meets the window, (n_cells,)."""
    corners, starts = mesh.xy[mesh.cell_vertices], mesh.cell_offsets[:-1]
    low = np.minimum.reduceat(corners, starts, axis=0)
    high = np.maximum.reduceat(corners, starts, axis=0)
    seen: BoolArray = ((high >= window[0]) & (low <= window[1])).all(axis=1)
    return seen


def cell_corners(mesh: Mesh, cells: IndexArray) -> list[Any]:
    """Corners of the cells in arrays of equal length: triangles, then quads."""
    sizes = np.diff(mesh.cell_offsets)[cells]
    first = mesh.cell_offsets[:-1][cells]
    return [mesh.xy[mesh.cell_vertices[first[sizes == n][:, None] + np.arange(n)]] for n in (3, 4)]


def edges_of(mesh: Mesh, cells: IndexArray) -> IndexArray:
    """Every edge of the cells once, (k, 2)."""
    sizes = np.diff(mesh.cell_offsets)[cells]
    first = mesh.cell_offsets[:-1][cells]
    sides = []
    for n in (3, 4):
        corners = mesh.cell_vertices[first[sizes == n][:, None] + np.arange(n)]
        sides.append(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2))
    return np.unique(np.sort(np.concatenate(sides), axis=1), axis=0)
