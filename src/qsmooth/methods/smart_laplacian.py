"""Guarded Laplacian smoothing: towards the mean of the neighbours, as far as no cell suffers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from qsmooth._types import FloatArray
from qsmooth.engine import Colours
from qsmooth.kernels.stars import Moves
from qsmooth.methods.driver import GuardedMethod, Setting, Sweep
from qsmooth.methods.laplacian import WEIGHTS_HELP
from qsmooth.options import option


@dataclass(frozen=True, kw_only=True)
class SmartLaplacian(GuardedMethod):
    """Move each vertex towards the mean of its neighbours, as far as no cell suffers.

    With area weights, towards the centroid of its star polygon.

    Notes
    -----
    L. A. Freitag, "On combining Laplacian and optimization-based mesh smoothing techniques",
    AMD 220 (1997).
    """

    name = "smart-laplacian"
    title = "Smart Laplacian"
    purpose = (
        "Vertex by vertex towards the mean of the neighbours, as far as no cell suffers. The "
        "quickest guarded method; good for a mean that is better soon."
    )

    weights: Literal["uniform", "area"] = option("uniform", help=WEIGHTS_HELP)

    def start(self, setting: Setting) -> Sweep:
        """Set up a sweep."""
        blocks = setting.blocks
        if self.weights == "area":
            from qsmooth.kernels.centroid import smart_centroid_sweep

            def to_centroid(xy: FloatArray, colours: Colours, moves: Moves) -> None:
                smart_centroid_sweep(xy, blocks, colours, setting.good, moves)

            return Sweep(setting.n_colours, to_centroid)
        from qsmooth.kernels.laplacian import smart_laplacian_sweep

        def to_mean(xy: FloatArray, colours: Colours, moves: Moves) -> None:
            smart_laplacian_sweep(xy, blocks, colours, setting.good, moves)

        return Sweep(setting.n_colours, to_mean)
