"""Delaunay triangulations of the unit square: random points, and the simple cases of papers."""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.mesh import Mesh

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def random_triangles(n_triangles: int = 1000, *, seed: int = 0) -> Mesh:
    """Triangulate the unit square, with vertices at its corners and at random inside (Delaunay).

    Parameters
    ----------
    n_triangles
        An even number, 4 or more; half as many vertices less one are inside.

    Raises
    ------
    ValueError
        If `n_triangles` is odd or too small.
    """
    if n_triangles < 4 or n_triangles % 2:
        raise ValueError(f"n_triangles must be even and 4 or more, got {n_triangles}")
    inside = np.random.default_rng([n_triangles, seed]).random((n_triangles // 2 - 1, 2))
    return Mesh(*delaunay(SQUARE, inside))


def simple_case(n_faces: int = 3, *, good: bool = False, seed: int = 0) -> Mesh:
    """Make one of the simple cases that smoothers for triangles are tried on.

    Parameters
    ----------
    n_faces
        3 for one vertex inside a triangle, 12 or 40 (or any even number from 4) for a square.
    good
        Whether the vertices are well spread to begin with.
    """
    if n_faces == 3:
        place = (0.5, 0.3) if good else (0.85, 0.04)
        outer = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.5 * math.sqrt(3.0)), place]
        return Mesh(outer, [(0, 1, 3), (1, 2, 3), (2, 0, 3)])
    if not good:
        return random_triangles(n_faces, seed=seed)
    rng = np.random.default_rng([n_faces, seed, 1])
    inside = np.empty((0, 2))
    while len(inside) < n_faces // 2 - 1:  # of many candidates, the one farthest from the others
        candidates = 0.05 + 0.9 * rng.random((200, 2))
        others = np.concatenate([SQUARE, inside])
        near = np.hypot(*(candidates[:, None] - others).transpose(2, 0, 1)).min(axis=1)
        # Half a mesh size from the boundary is as good as a whole one from another vertex.
        near = np.minimum(near, 2.0 * np.minimum(candidates, 1.0 - candidates).min(axis=1))
        inside = np.concatenate([inside, candidates[[np.argmax(near)]]])
    return Mesh(*delaunay(SQUARE, inside))


def delaunay(corners: FloatArray, inside: FloatArray) -> tuple[FloatArray, IndexArray]:
    """Triangulate a rectangle with points inside."""
    # Here, as a kernel brings Numba, which other examples do not need.
    from qsmooth.kernels.delaunay import triangulate

    points = np.concatenate([corners, inside])
    low, high = corners.min(axis=0), corners.max(axis=0)
    n_rows = max(1, int(math.sqrt(len(inside) / 2.0)))
    along, row = inside[:, 0], np.floor((inside[:, 1] - low[1]) / (high[1] - low[1]) * n_rows)
    order = 4 + np.lexsort((np.where(row % 2 == 0, along, -along), row))
    triangles, bad = triangulate(points, order)
    if bad >= 0:
        raise ValueError(f"point {bad} coincides with another or is outside")
    return points, triangles
