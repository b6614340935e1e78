"""By star: vertex by vertex, each to the mean of what the cells around it propose."""

from __future__ import annotations

from dataclasses import dataclass

from qsmooth._types import FloatArray
from qsmooth.engine import Colours
from qsmooth.kernels.stars import Moves
from qsmooth.methods.driver import Setting, Sweep
from qsmooth.methods.proposing import Pace, ProposingMethod


@dataclass(frozen=True, kw_only=True)
class Star(ProposingMethod):
    """Smooth vertex by vertex: each goes to the mean of what the cells around it propose.

    Every cell pushes or pulls a corner whose angle is too large or too small, and evens out its
    distances to the neighbouring corners. About twice as fast as `Quad`.

    Notes
    -----
    The by-star method of "Quadrilateral Mesh Smoothing", with signed guard lines, coloured sweeps
    and a guard on quality added.
    """

    name = "star"
    title = "By star"
    purpose = (
        "Each vertex goes to the mean of the places that the cells around it propose, to mend "
        "their angles. Quick; for quads whose worst angles matter more than the last degree."
    )

    def start(self, setting: Setting) -> Sweep:
        """Set up a sweep."""
        from qsmooth.kernels.star import star_sweep

        thresholds, pace, blocks = self.thresholds(), Pace(self, setting), setting.blocks

        def move(xy: FloatArray, colours: Colours, moves: Moves) -> None:
            star_sweep(xy, blocks, colours, pace.values, thresholds, self.step, setting.good, moves)

        return Sweep(setting.n_colours, move, pace.update)
