"""Laplacian smoothing: to the mean of the neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.engine import Colours
from qsmooth.kernels.stars import Moves, Rings
from qsmooth.methods.driver import Setting, Sweep, SweepingMethod
from qsmooth.options import option

WEIGHTS_HELP = (
    "Where a vertex goes: uniform, to the mean of its neighbours; area, to the centroid of the "
    "polygon around it."
)


@dataclass(frozen=True, kw_only=True)
class Laplacian(SweepingMethod):
    """Move all vertices to the mean of their neighbours at once, unguarded.

    The baseline that everybody knows: cheap, and good on convex domains; near a re-entrant corner
    it inverts cells, and the outcome says how many. With area weights, to the centroid of the star
    polygon.

    Notes
    -----
    D. A. Field, "Laplacian smoothing and Delaunay triangulations", Communications in Applied
    Numerical Methods 4 (1988).
    """

    name = "laplacian"
    title = "Laplacian"
    purpose = (
        "All vertices at once to the mean of their neighbours: the baseline that everybody knows. "
        "Unguarded: near re-entrant corners it inverts cells."
    )
    guarded = False

    weights: Literal["uniform", "area"] = option("uniform", help=WEIGHTS_HELP)

    def start(self, setting: Setting) -> Sweep:
        """Set up a sweep."""
        previous = np.empty((setting.topology.n_vertices, 2))

        def keep(xy: FloatArray) -> None:
            previous[:] = xy

        if self.weights == "area":
            from qsmooth.kernels.centroid import centroid_sweep

            def to_centroids(xy: FloatArray, _: Colours, moves: Moves) -> None:
                centroid_sweep(previous, setting.blocks, xy, moves)

            return Sweep(1, to_centroids, keep)
        from qsmooth.kernels.laplacian import laplacian_sweep
        from qsmooth.kernels.ring_blocks import build_ring_blocks

        movable = np.sort(setting.stars.vertices)
        blocks = build_ring_blocks(movable, Rings(*setting.topology.rings))
        blocks = blocks._replace(rails=setting.rails)

        def to_means(xy: FloatArray, _: Colours, moves: Moves) -> None:
            laplacian_sweep(previous, blocks, xy, moves)

        return Sweep(1, to_means, keep)
