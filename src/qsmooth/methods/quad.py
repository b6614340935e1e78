"""By quad: all cells propose at once, then the vertices go to the mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.engine import Colours
from qsmooth.kernels.stars import Moves
from qsmooth.methods.driver import Setting, Sweep
from qsmooth.methods.proposing import Pace, ProposingMethod


@dataclass(frozen=True, kw_only=True)
class Quad(ProposingMethod):
    """Smooth cell by cell: each moves all its corners, and the vertices go to the mean.

    Besides the moves of `Star`, a corner with a bad angle shortens or lengthens its diagonal, so
    that also corners on the boundary are mended, by their neighbours.

    Notes
    -----
    The by-quad method of "Quadrilateral Mesh Smoothing".
    """

    name = "quad"
    title = "By quad"
    purpose = (
        "The moves of star for all corners of a cell at once; a bad corner also shortens or "
        "lengthens its diagonal, which helps next to the boundary. Twice the time of star."
    )

    def start(self, setting: Setting) -> Sweep:
        """Set up a sweep."""
        from qsmooth.kernels.quad import guarded_commit, quad_proposals

        thresholds, pace, blocks = self.thresholds(), Pace(self, setting), setting.blocks
        wanted = np.empty((blocks.vertices.size, 2))

        def propose(xy: FloatArray) -> None:
            pace.update(xy)
            quad_proposals(xy, blocks, pace.values, thresholds, self.step, wanted)

        def move(xy: FloatArray, colours: Colours, moves: Moves) -> None:
            guarded_commit(xy, blocks, colours, wanted, setting.good, moves)

        return Sweep(setting.n_colours, move, propose)
