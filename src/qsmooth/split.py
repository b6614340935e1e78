"""Cutting quads in two triangles each, to run triangle methods on them."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.mesh import Mesh

Diagonal: TypeAlias = Literal["shorter", "first", "second"]
DIAGONALS = ("shorter", "first", "second")


def split_quads(mesh: Mesh, diagonal: Diagonal = "shorter") -> Mesh:
    """Cut each quad in two triangles; triangles stay, and so do vertices and their order.

    Parameters
    ----------
    diagonal
        ``"shorter"``: the shorter one of each quad (the first where both are as long);
        ``"first"``: from its first to its third vertex; ``"second"``: from its second to its
        fourth. A quad at an interior vertex with two cells only is cut through that vertex, as
        the same triangle would come out twice otherwise.

    Returns
    -------
    Mesh
        Cell by cell in the same order, oriented as `mesh` is; fixed vertices, regions and line
        cells go along.

    Raises
    ------
    ValueError
        If `diagonal` is none of these.
    MeshError
        If quads lie on each other such that an edge would have more than two triangles.
    """
    if diagonal not in DIAGONALS:
        raise ValueError(f"diagonal must be one of {', '.join(DIAGONALS)}; got {diagonal!r}")
    offsets, vertices = mesh.cell_offsets, mesh.cell_vertices
    is_quad = np.diff(offsets) == 4
    quads = vertices[offsets[:-1][is_quad, None] + np.arange(4)]
    second = _cut_by_second(mesh, quads, diagonal)
    cut = np.where(second[:, None], np.roll(quads, -1, axis=1), quads)
    n_pieces = np.where(is_quad, 2, 1)
    first = np.concatenate([[0], np.cumsum(n_pieces)])[:-1]
    triangles = np.empty((int(n_pieces.sum()), 3), np.int64)
    triangles[first[is_quad]] = cut[:, [0, 1, 2]]
    triangles[first[is_quad] + 1] = cut[:, [0, 2, 3]]
    triangles[first[~is_quad]] = vertices[offsets[:-1][~is_quad, None] + np.arange(3)]
    regions = None if mesh.regions is None else np.repeat(mesh.regions, n_pieces)
    try:
        return mesh.with_cells(triangles, regions)
    except MeshError as error:
        raise MeshError(f"the quads can't be cut in two along these diagonals: {error}") from None


def _cut_by_second(mesh: Mesh, quads: IndexArray, diagonal: Diagonal) -> BoolArray:
    """Whether each quad is cut from its second to its fourth corner."""
    if diagonal == "shorter":
        first, second = _squares(mesh.xy, quads, 0), _squares(mesh.xy, quads, 1)
        cut: BoolArray = second < first
    else:
        cut = np.full(len(quads), diagonal == "second")
    is_thin = (np.diff(mesh.star_offsets) == 2) & ~mesh.is_boundary
    thin = is_thin[quads]
    cut[thin[:, 0] | thin[:, 2]] = False
    cut[thin[:, 1] | thin[:, 3]] = True
    return cut


def _squares(xy: FloatArray, quads: IndexArray, corner: int) -> FloatArray:
    """Squared length of the diagonal from `corner` of each quad."""
    d = xy[quads[:, corner + 2]] - xy[quads[:, corner]]
    squares: FloatArray = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1]
    return squares
