"""How VTK's filters take a dataset.

Not in their own file, which ParaView runs without entering it among Python's modules: there no
dataclass can be made.
"""

from __future__ import annotations

from dataclasses import dataclass

from qsmooth.mesh import Surface
from qsmooth.options import Options, option


@dataclass(frozen=True, kw_only=True)
class Reading(Options):
    """How a dataset is taken, whatever the method."""

    owner = "dataset"

    surface: Surface = option(
        "auto",
        help="What z means: auto, the points lie in one plane, which may be tilted; flat, x and y "
        "are the geometry and z is a value.",
    )
