"""What no placement of the movable vertices can make valid, with proof."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.topology import Topology


@dataclass(frozen=True)
class Impossible:
    """Cells that stay invalid wherever the movable vertices go.

    Attributes
    ----------
    topology
        Of the mesh.
    by_fixed : (n_cells,)
        Cells with a corner that what can't move keeps from being convex.
    by_doublet : (n_cells,)
        One of the two cells of each interior vertex that has no more: the one that is not convex
        there now. None where one of the two is a cell that counts already.
    doublets : (n_vertices,)
        These vertices, all of them.
    """

    topology: Topology
    by_fixed: BoolArray
    by_doublet: BoolArray
    doublets: BoolArray

    @cached_property
    def cells(self) -> BoolArray:
        """All these cells, (n_cells,); a valid mesh has none, and no mesh fewer invalid ones."""
        return self.by_fixed | self.by_doublet

    @cached_property
    def closed(self) -> BoolArray:
        """Corners for which nothing is to be had by untangling, (n_corners,)."""
        topology = self.topology
        closed = np.zeros(topology.cell_vertices.size, np.bool_)
        if self.doublets.any():
            closed |= self.doublets[topology.cell_vertices]
        if self.by_fixed.any():
            closed |= np.repeat(self.by_fixed, topology.cell_sizes)
        return closed


def impossible(topology: Topology, xy: FloatArray, movable: BoolArray) -> Impossible:
    """Find the cells that no placement of the movable vertices can make valid.

    Parameters
    ----------
    topology, xy, movable
        Of a mesh: (n, 2) coordinates; and (n,), which vertices may move.
    """
    from qsmooth.kernels import impossible as kernels

    if not xy.flags.writeable:
        xy = xy.copy()  # kernels are compiled once more for arrays that are read-only
    by_fixed = np.empty(topology.n_cells, np.bool_)
    kernels.hopeless_cells(xy, *topology.cells, movable, by_fixed)
    doublets = doublet_vertices(topology)
    by_doublet = np.zeros(topology.n_cells, np.bool_)
    if doublets.any():
        listed = np.flatnonzero(doublets)
        kernels.mark_one_of_two(
            xy,
            listed[np.argsort(topology.vertex_ids[listed])],
            topology.star_offsets,
            topology.star_cells,
            topology.star_corners,
            *topology.cells,
            by_fixed.copy(),
            by_doublet,
        )
    return Impossible(topology, by_fixed, by_doublet, doublets)


def doublet_vertices(topology: Topology) -> BoolArray:
    """Mark the interior vertices with two cells, (n_vertices,).

    The two share both edges there, and their angles at the vertex add up to 360 degrees.
    """
    doublets: BoolArray = (np.diff(topology.star_offsets) == 2) & ~topology.is_boundary
    return doublets
