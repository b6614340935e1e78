"""What no placement of the vertices can beat: provable bounds on the angles of a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray
from qsmooth.adapters import as_mesh
from qsmooth.mesh import Surface
from qsmooth.metrics.quality import Quality, quality
from qsmooth.notebook import page
from qsmooth.table import Row, Section, Table
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from qsmooth.kernels.angle_bounds import Swings

FULL_TURN = 360.0
# What keeps vertices where they are: words for these, and a mask, (n_vertices,).
Kept: TypeAlias = tuple[str, BoolArray]
# What is said where a limit is that of sliding vertices.
BY_SLIDING = "the boundary that vertices slide along"


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
    min_angle_set_by, max_angle_set_by
        Which vertices set the limit by staying where they are, in words, as in "fixed boundary
        vertices"; of several the first without which it would be another, what the mesh itself
        keeps first. "" where none does: the count of cells around a vertex, or the angle sum.
    quality
        Metrics of the mesh, which notebooks draw; None where the limits are those that a run tells.
    """

    min_angle: float
    max_angle: float
    min_angle_vertex: int
    max_angle_vertex: int
    reached_min_angle: float
    reached_max_angle: float
    min_angle_set_by: str = ""
    max_angle_set_by: str = ""
    quality: Quality | None = field(default=None, repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, fit for JSON."""
        plain = asdict(replace(self, quality=None))
        del plain["quality"]
        return plain

    def __repr__(self) -> str:
        return (
            f"Limits(smallest angle {self.reached_min_angle:.2f}° of at most "
            f"{self.min_angle:.2f}°, largest {self.reached_max_angle:.2f}° of at least "
            f"{self.max_angle:.2f}°)"
        )

    def _repr_html_(self) -> str:
        """Show a table and a picture in a notebook."""
        rows = tuple(
            Row(f"{which} angle", (f"{now:.2f}°", f"{best:.2f}°", where.lstrip(",; ")))
            for which, now, best, where in (
                ("Smallest", self.reached_min_angle, self.min_angle,
                 _set_at(self.min_angle_vertex, self.min_angle_set_by)),
                ("Largest", self.reached_max_angle, self.max_angle,
                 _set_at(self.max_angle_vertex, self.max_angle_set_by)),
            )
        )  # fmt: skip
        columns = "Now", "Best of any placement", "Limited by"
        pictures = [] if self.quality is None else [self.quality.picture()]
        return page("Limits of the angles", Table(columns, (Section("", rows),)), pictures)

    def __str__(self) -> str:
        return "\n".join(
            [
                f"smallest angle {self.reached_min_angle:.2f}°; no placement of this connectivity "
                f"can exceed {self.min_angle:.2f}°"
                f"{_set_at(self.min_angle_vertex, self.min_angle_set_by)}",
                f"largest angle {self.reached_max_angle:.2f}°; no placement of this connectivity "
                f"can go below {self.max_angle:.2f}°"
                f"{_set_at(self.max_angle_vertex, self.max_angle_set_by)}",
            ]
        )


def limits(
    mesh: Any,
    *,
    keep_interfaces: bool = True,
    movable: npt.ArrayLike | None = None,
    surface: Surface = "auto",
    geographic: bool | None = None,
) -> Limits:
    """Bound the smallest and the largest angle that any placement of the vertices can have.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or what `as_mesh` takes.
    keep_interfaces
        Whether vertices on the line between two regions, or on line cells of the file, stay.
    movable : (n_vertices,) bool
        Vertices that may move, if these are others; boundary vertices may be among them. They
        count as free to go anywhere. That holds of vertices that slide, too, but is not the best
        that can be said of them: the limits that `optimize` tells, and those that the shell shows
        of every method, know how far edges along the boundary can turn.
    surface, geographic
        What the coordinates mean, see `Mesh`; by default what the mesh says.

    Returns
    -------
    Limits

    Raises
    ------
    MeshError
        If a pair is no mesh.
    ValueError
        If `movable` is no such mask.
    """
    mesh = as_mesh(mesh, surface=surface, geographic=geographic)
    topology = mesh.topology
    kept = [*kept_by(topology, keep_interfaces)]
    if movable is None:
        free = topology.movable(keep_interfaces)
    else:
        free = np.asarray(movable)
        if free.dtype != np.bool_ or free.shape != (mesh.n_vertices,):
            raise ValueError(
                f"movable must be booleans of the shape ({mesh.n_vertices},), "
                f"got {free.dtype} of the shape {free.shape}"
            )
        free = free & topology.used
        kept.append(("vertices that may not move", ~free))
    now = quality(mesh)
    return replace(angle_limits(topology, mesh.xy, free, now, kept), quality=now)


def kept_by(topology: Topology, keep_interfaces: bool) -> list[Kept]:
    """List what the mesh itself keeps where it is."""
    kept = [
        ("fixed boundary vertices", topology.is_boundary),
        ("fixed vertices of the mesh", topology.is_fixed),
    ]
    if keep_interfaces:
        kept.append(("vertices between regions", topology.is_interface))
    return kept


def angle_limits(
    topology: Topology,
    xy: FloatArray,
    movable: BoolArray,
    now: Quality,
    kept: Sequence[Kept] = (),
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
    kept
        What keeps the vertices that stay, in the order in which a limit is put down to it.
    swings
        What is known of those of them that slide along the boundary.

    Notes
    -----
    The bound at a vertex: between two fixed edges that follow each other round a fixed vertex the
    angle θ is given, and shared by the d cells there; round any other vertex it is 360°. In a
    valid mesh these angles add up to θ, so their mean is θ / d.
    """
    sizes = topology.cell_sizes
    by_sum = 60.0 if (sizes == 3).any() else 90.0, 90.0 if (sizes == 4).any() else 60.0
    smallest, largest = vertex_bounds(topology, xy, movable, swings)
    low = topology.first_vertex(smallest == smallest.min())
    high = topology.first_vertex(largest == largest.max())
    ends = float(smallest[low]), float(largest[high])
    at_low, at_high = ends[0] < by_sum[0], ends[1] > by_sum[1]
    args = topology, xy, movable, kept, swings
    by_low = _set_by(*args, low, ends[0], 0) if at_low else ""
    by_high = _set_by(*args, high, ends[1], 1) if at_high else ""
    return Limits(
        min_angle=min(by_sum[0], ends[0]),
        max_angle=max(by_sum[1], ends[1]),
        min_angle_vertex=int(topology.vertex_ids[low]) if at_low else -1,
        max_angle_vertex=int(topology.vertex_ids[high]) if at_high else -1,
        reached_min_angle=float(now.min_angle.min()),
        reached_max_angle=float(now.max_angle.max()),
        min_angle_set_by=by_low,
        max_angle_set_by=by_high,
    )


def vertex_bounds(
    topology: Topology, xy: FloatArray, movable: BoolArray, swings: Swings | None
) -> tuple[FloatArray, FloatArray]:
    """Bound the smallest and the largest angle at each vertex, degrees, (n_vertices,).

    Of the cells at a vertex one has an angle there of at most the former, and one of at least the
    latter, wherever the movable vertices go in a valid mesh. Arguments are as in `angle_limits`.
    """
    from qsmooth.kernels.angle_bounds import NO_SWINGS, angle_bounds

    smallest, largest = np.empty(topology.n_vertices), np.empty(topology.n_vertices)
    angle_bounds(
        xy, *topology.cells, topology.corner_cells, topology.twins, topology.star_offsets,
        topology.star_corners, movable, swings or NO_SWINGS, smallest, largest,
    )  # fmt: skip
    return smallest, largest


def _set_by(
    topology: Topology,
    xy: FloatArray,
    movable: BoolArray,
    kept: Sequence[Kept],
    swings: Swings | None,
    v: int,
    bound: float,
    which: int,
) -> str:
    """Say by which of `kept`, and those before it, the bound at vertex v is what it is.

    Parameters
    ----------
    which
        0 for the bound of the smallest angle, 1 for that of the largest.
    """
    free = np.ones_like(movable)
    count = topology.star_offsets[v + 1] - topology.star_offsets[v]
    if not topology.is_boundary[v] and bound == FULL_TURN / count:
        return ""
    if swings is not None and vertex_bounds(topology, xy, free, swings)[which][v] == bound:
        return BY_SLIDING
    for words, vertices in kept:
        free = (free & ~vertices) | movable
        if (
            np.array_equal(free, movable)
            or vertex_bounds(topology, xy, free, swings)[which][v] == bound
        ):
            return words
    return ""


def _set_at(vertex: int, set_by: str) -> str:
    if vertex < 0:
        return ", the mean angle of a cell"
    return f"; set at vertex {vertex}" + (f" by {set_by}" if set_by else "")
