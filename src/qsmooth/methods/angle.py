"""Angle-based: every edge at a vertex turns to the bisector at its other end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.engine import Colours
from qsmooth.kernels.stars import Moves
from qsmooth.methods.driver import Setting, Sweep, SweepingMethod
from qsmooth.options import option


@dataclass(frozen=True, kw_only=True)
class Angle(SweepingMethod):
    """Smooth by turning each edge onto the bisector of the angle at its other end.

    A vertex goes to the mean of the places to which its edges turn it, keeping their lengths. With
    ``guard="none"`` all vertices move at once and unguarded, as published; otherwise one by one,
    as far as the guards allow.

    Notes
    -----
    T. Zhou and K. Shimada, "An angle-based approach to two-dimensional mesh smoothing",
    Proceedings of the 9th International Meshing Roundtable (2000). In quads the polygon round a
    vertex runs through the opposite corners too, which do not turn it. So it is not stable there:
    on a square grid a sweep makes waves of six cells 1.125 times as high. Quads, also guarded ones,
    get slim; better cut them in two (`split_quads`), or take another method.
    """

    name = "angle"
    title = "Angle-based"
    purpose = (
        "Each edge turns onto the bisector at its other end; the published baseline for "
        "triangles. Not stable on quads, which it makes slim: cut them with `split_quads`."
    )

    step: float = option(1.0, within="(0, 1]", help="Share of the way to the mean that is made.")
    guard: Literal["quality", "clearance", "none"] = option(
        "quality",
        help="What every move keeps: clearance, that valid cells stay valid; quality, also that "
        "the worst cell does not get worse; none, nothing, all vertices at once as published.",
    )

    @property
    def guards(self) -> bool:
        """Whether it keeps valid cells valid with these options."""
        return self.guard != "none"

    @property
    def quality_guard(self) -> bool:
        """Whether no cell may get worse, below `driver.GOOD_SCALED_JACOBIAN`."""
        return self.guard == "quality"

    def start(self, setting: Setting) -> Sweep:
        """Set up a sweep."""
        from qsmooth.kernels.angle import angle_sweep, guarded_angle_sweep, star_polygons

        blocks = setting.blocks
        polygons = star_polygons(blocks)

        if not self.guards:
            previous = np.empty((setting.topology.n_vertices, 2))

            def keep(xy: FloatArray) -> None:
                previous[:] = xy

            def move_all(xy: FloatArray, _: Colours, moves: Moves) -> None:
                angle_sweep(previous, blocks, polygons, self.step, xy, moves)

            return Sweep(1, move_all, keep)

        def move(xy: FloatArray, colours: Colours, moves: Moves) -> None:
            guarded_angle_sweep(xy, blocks, polygons, colours, self.step, setting.good, moves)

        return Sweep(setting.n_colours, move)
