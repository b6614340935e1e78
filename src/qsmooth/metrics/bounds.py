"""What no placement of the vertices can beat: provable bounds on the angles of a mesh."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.adapters import to_mesh
from qsmooth.metrics.quality import Quality, quality
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from qsmooth.kernels.angle_bounds import Swings


@dataclass(frozen=True)
class Limits:
    """How good the angles of a mesh can get by moving vertices alone.

    Round a vertex with d cells and the angle θ between them all one of the d angles is at most
    θ / d, and one at least that. A quad has an angle of at most and one of at least 90°, a triangle
    60°. No placement of the movable vertices that keeps the mesh valid can do better.

    Attributes
    ----------
    min_angle, max_angle
        Degrees: the smallest angle can't be larger, the largest can't be smaller than this.
    min_angle_vertex, max_angle_vertex
        The vertex that sets the limit; -1 where the angle sum of a cell does.
    reached_min_angle, reached_max_angle
        The mesh's own smallest and largest angle, degrees.
    """

    min_angle: float
    max_angle: float
    min_angle_vertex: int
    max_angle_vertex: int
    reached_min_angle: float
    reached_max_angle: float

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, fit for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return "\n".join(
            [
                f"smallest angle {self.reached_min_angle:.2f}°; no placement of this connectivity "
                f"can exceed {self.min_angle:.2f}°{_set_at(self.min_angle_vertex)}",
                f"largest angle {self.reached_max_angle:.2f}°; no placement of this connectivity "
                f"can go below {self.max_angle:.2f}°{_set_at(self.max_angle_vertex)}",
            ]
        )


def limits(mesh: Any, *, keep_interfaces: bool = True) -> Limits:
    """Bound the smallest and the largest angle that any placement of the vertices can have.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or a mesh of meshio.
    keep_interfaces
        Whether vertices on the line between two regions, or on line cells of the file, stay.

    Returns
    -------
    Limits

    Raises
    ------
    MeshError
        If a pair is no mesh.
    """
    mesh = to_mesh(mesh)
    movable = mesh.topology.movable(keep_interfaces)
    return angle_limits(mesh.topology, mesh.xy, movable, quality(mesh))


def angle_limits(
    topology: Topology,
    xy: FloatArray,
    movable: BoolArray,
    now: Quality,
    swings: Swings | None = None,
) -> Limits:
    """Bound the smallest and the largest angle that the movable vertices can bring about.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates; only those of vertices that stay count, and for the angles reached so far.
    movable : (n_vertices,)
        Vertices that may move, anywhere.
    now
        Metrics of the cells at these coordinates, in any order.
    swings
        What is known of those of them that slide along the boundary.

    Notes
    -----
    The bound at a vertex: between two fixed edges that follow each other round a fixed vertex the
    angle θ is given, and shared by the d cells there; round any other vertex it is 360°. In a
    valid mesh these angles add up to θ, so their mean is θ / d.
    """
    from qsmooth.kernels.angle_bounds import NO_SWINGS, angle_bounds

    smallest, largest = np.empty(topology.n_vertices), np.empty(topology.n_vertices)
    angle_bounds(
        xy, *topology.cells, topology.corner_cells, topology.twins, topology.star_offsets,
        topology.star_corners, movable, swings or NO_SWINGS, smallest, largest,
    )  # fmt: skip
    sizes = topology.cell_sizes
    by_sum = 60.0 if (sizes == 3).any() else 90.0, 90.0 if (sizes == 4).any() else 60.0
    low = topology.first_vertex(smallest == smallest.min())
    high = topology.first_vertex(largest == largest.max())
    return Limits(
        min_angle=float(min(by_sum[0], smallest[low])),
        max_angle=float(max(by_sum[1], largest[high])),
        min_angle_vertex=int(topology.vertex_ids[low]) if smallest[low] < by_sum[0] else -1,
        max_angle_vertex=int(topology.vertex_ids[high]) if largest[high] > by_sum[1] else -1,
        reached_min_angle=float(now.min_angle.min()),
        reached_max_angle=float(now.max_angle.max()),
    )


def _set_at(vertex: int) -> str:
    return f"; set at vertex {vertex}" if vertex >= 0 else ", the mean angle of a cell"
