"""What targets are, and the plain ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.targets.algebra import EQUILATERAL, SQUARE
from qsmooth.topology import Topology


class Targets(NamedTuple):
    """The shape and size that each cell is meant to have; lengths in the mesh's own unit.

    Attributes
    ----------
    corners : (n_corners, 3)
        m11, m12, m22 of `corner_energy.Target` at each position of `topology.cell_vertices`, with
        u the edge to the cell's next vertex, w that to its previous one; m11 m22 − m12² = 1.
    area : (n_cells,)
        Target of det(u, w) at each corner: length times height of a quad, *twice* the area of a
        triangle. NaN where `size_weight` is 0.
    size_weight : (n_cells,)
        The weight γ of the size term, 0 or more.
    is_layer : (n_cells,)
        Cells of layers: the larger part of what is asked of them is to stay as they are.
    kind
        What the targets are, for reports.
    maps : (n_cells, 3) or None
        l11, l12, l22 of a symmetric L with determinant one, which edges are mapped by before f is
        taken; None where all are the identity. The size term takes the edges as they are.
    """

    corners: FloatArray
    area: FloatArray
    size_weight: FloatArray
    is_layer: BoolArray
    kind: str
    maps: FloatArray | None = None


def ideal(topology: Topology) -> Targets:
    """Ask for squares and equilateral triangles of any size."""
    n = topology.n_cells
    return Targets(
        corners=ideal_corners(topology),
        area=np.full(n, np.nan),
        size_weight=np.zeros(n),
        is_layer=np.zeros(n, np.bool_),
        kind="ideal",
    )


def beside_others(topology: Topology, chosen: BoolArray) -> BoolArray:
    """Which of the chosen cells, (n_cells,), share a vertex with one that is not chosen."""
    if not chosen.any():
        return np.zeros(chosen.size, np.bool_)
    shared = np.zeros(topology.n_vertices, np.bool_)
    shared[topology.cell_vertices[np.repeat(~chosen, topology.cell_sizes)]] = True
    at_cells = np.logical_or.reduceat(shared[topology.cell_vertices], topology.cell_offsets[:-1])
    return np.asarray(at_cells & chosen)


def ideal_corners(topology: Topology) -> FloatArray:
    """Coefficients of squares and equilateral triangles at all corners: (n_corners, 3)."""
    corners = np.zeros((topology.cell_vertices.size, 3))
    corners[:, 0], corners[:, 2] = SQUARE[0], SQUARE[2]
    if topology.n_quads < topology.n_cells:
        corners[np.repeat(topology.cell_sizes == 3, topology.cell_sizes)] = EQUILATERAL
    return corners


def is_ideal(corners: FloatArray, topology: Topology) -> bool:
    """Whether coefficients at all corners, (n_corners, 3), are those of `ideal_corners`."""
    if topology.n_quads == topology.n_cells:
        return bool((corners == SQUARE).all())
    return np.array_equal(corners, ideal_corners(topology))


def blocks(topology: Topology) -> list[tuple[int, IndexArray, IndexArray]]:
    """Triangles and quads: 3 or 4, the cells, (m,), and their corners' positions, (m, 3 or 4)."""
    out = []
    for size in (3, 4):
        cells = np.flatnonzero(topology.cell_sizes == size)
        if cells.size:
            out.append((size, cells, topology.cell_offsets[cells][:, None] + np.arange(size)))
    return out
