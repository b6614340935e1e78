"""By aspect ratio: triangles even out their edges along circumcircles."""

from __future__ import annotations

from dataclasses import dataclass

from qsmooth._types import FloatArray
from qsmooth.engine import Colours
from qsmooth.kernels.stars import Moves
from qsmooth.mesh import Mesh
from qsmooth.methods.driver import GuardedMethod, Setting, Sweep
from qsmooth.options import option

# Proposals are weighted by the edge ratio to this power.
RATIO_POWER = 4.0


@dataclass(frozen=True, kw_only=True)
class AspectRatio(GuardedMethod):
    """Smooth triangles by making the two edges at each corner more alike.

    Each triangle proposes to move its corner along its circumcircle towards the longer edge, which
    keeps the corner's angle. Proposals that cost no clearance are averaged, with the fourth power
    of their edge ratios for weights; a step that would make the largest ratio around the vertex
    larger is shortened. Quads propose nothing, but their validity and quality is kept; for quads
    alone it needs `split_quads`.

    Notes
    -----
    The circumcircle method for triangles that "Quadrilateral Mesh Smoothing" builds on. The source
    leaves open how to average, and has 1.5 for `max_edge_ratio`; these defaults were the best over
    random triangulations (``studies/study_triangles.py``).
    """

    name = "aspect-ratio"
    title = "By aspect ratio"
    purpose = (
        "Triangles move their corners along circumcircles until their edges are alike. For the "
        "aspect ratio of triangles; other methods reach better angles."
    )

    step: float = option(0.2, within="(0, 1]", help="Share of each proposed move that is made.")
    max_edge_ratio: float = option(
        1.2, within="[1, inf)", help="Two edges are left alone whose ratio is no larger."
    )

    def why_not(self, mesh: Mesh) -> str:
        """Say in a line why it can do nothing with the mesh's cells; "" where it can."""
        if self.split_quads is False and (mesh.topology.cell_sizes == 4).all():
            return (
                f"{self.owner} is for triangles and there is none; "
                "`split_quads='shorter'` cuts the quads in two"
            )
        return ""

    def start(self, setting: Setting) -> Sweep:
        """Set up a sweep."""
        from qsmooth.kernels.aspect_ratio import aspect_ratio_sweep

        blocks = setting.blocks

        def move(xy: FloatArray, colours: Colours, moves: Moves) -> None:
            aspect_ratio_sweep(
                xy, blocks, colours, self.max_edge_ratio, self.step, RATIO_POWER,
                self.max_edge_ratio, setting.good, moves,
            )  # fmt: skip

        return Sweep(setting.n_colours, move)
