"""What shape and size each cell is meant to have.

The optimiser lowers, at every corner with edge vectors u and w,

    f(L u, L w) + ½ γ (τ − 1/τ)²,    τ = det(u, w) / (the cell's target area),

f being the energy of `kernels.corner_energy` to the corner's target. `Targets` holds the
coefficients of f, the map L, the areas and γ, all of them frozen: none depends on the coordinates
while vertices move.

``"auto"`` learns them from the mesh, by one idea: *what varies smoothly is meant, what varies at
random is not.* Three things are asked of every cell, and answered by weights from 0 to 1 that are
smooth in the coordinates, as nothing may hang on a last digit.

* Is it of a layer? Layers are sheets of quads (`kernels.sheets`), or of triangles that pair to
  quads, which are stretched along the sheet and nearly rectangular, whose heights scatter little,
  that lie at least three deep, and on sheets that are nearly rectangular from end to end. A
  distorted mesh has such quads too, but no such sheets. The regular grid that a layer grows out
  into belongs to it. Such a cell is to have right angles, and its own length and area, hence
  height; less what is noise in these.
* If not, is it stretched, as its neighbours are? Quads: their sides are averaged along the
  sheets. Triangles: their metrics are averaged with those around.
* Is the area of a triangle part of a smooth grading?

Everything else is to be a square or an equilateral triangle of any size.

Modules: `base` has the tuple and the ideal, `given` what a caller asks for, `learned` what the mesh
says, put together from `sheets`, `rectangles`, `triangles` and `sizes`; `algebra` has the small
matrices.
"""

from qsmooth.targets.algebra import EQUILATERAL, SQUARE
from qsmooth.targets.base import Targets, beside_others, ideal, ideal_corners, is_ideal
from qsmooth.targets.given import Metric, from_metric, from_ratios, initial
from qsmooth.targets.learned import candidates, learned
from qsmooth.targets.sheets import Sheets
from qsmooth.targets.sizes import with_sizes, without_sizes

__all__ = [
    "EQUILATERAL",
    "SQUARE",
    "Metric",
    "Sheets",
    "Targets",
    "beside_others",
    "candidates",
    "from_metric",
    "from_ratios",
    "ideal",
    "ideal_corners",
    "initial",
    "is_ideal",
    "learned",
    "with_sizes",
    "without_sizes",
]
