"""What may move, where to, and how far: the caller's word on the vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray
from qsmooth.curves import checked_curve, parse_curve
from qsmooth.kernels.rails import FREE, Rails
from qsmooth.mesh import Mesh
from qsmooth.numbering import Inside
from qsmooth.options import OptionError, Options, opaque, option
from qsmooth.outline import Chains, find_chains
from qsmooth.selection import marked, parse_selection, select_cells, vertices_of

# Of the largest coordinate of points in a tilted plane: more than their rounding.
ROUNDING = 2.0**-49


@dataclass(frozen=True, kw_only=True)
class Freedom:
    """What may move of one mesh, and where to.

    Attributes
    ----------
    movable : (n_vertices,)
        Vertices that may move at all.
    cells : (n_cells,) or None
        Selected cells; None for all.
    origin : (n_vertices, 2)
        Where the vertices were.
    reach : (n_vertices,) or None
        How far from there each may be; None for any distance.
    directions : (n_vertices, 2) or None
        Unit vectors along which alone they may move, NaN for any direction; None for all.
    rounding
        A length that a move may grow by when it is stored: in a tilted plane.
    chains
        Lines along which some of `movable` slide, of the caller's vertices; None where none does.
    tolerance
        How far an edge on these may be from its line, as a share of the edge.
    """

    movable: BoolArray
    cells: BoolArray | None
    origin: FloatArray
    reach: FloatArray | None = None
    directions: FloatArray | None = None
    rounding: float = 0.0
    chains: Chains | None = None
    tolerance: float = 0.0

    @property
    def n_movable(self) -> int:
        """How many vertices may move."""
        return int(self.movable.sum())

    def beyond(self, moves: FloatArray) -> BoolArray:
        """Mark vertices whose moves, (n_vertices, 2 or 3), are longer than they may be."""
        if self.reach is None:
            return np.zeros(len(moves), np.bool_)
        within: BoolArray = np.linalg.norm(moves, axis=1) <= self.reach
        return ~within

    def inside(self, inside: Inside) -> Freedom:
        """Put it into the order inside; the selected cells stay the caller's."""
        if not inside.topology.is_renumbered:
            return self
        return replace(
            self,
            movable=self.movable[inside.topology.vertex_ids],
            origin=inside.at_vertices(self.origin),
            reach=None if self.reach is None else inside.at_vertices(self.reach),
            directions=None if self.directions is None else inside.at_vertices(self.directions),
        )

    def rails(self) -> Rails:
        """Say it to kernels; empty where movable vertices may be anywhere."""
        if self.reach is None and self.directions is None:
            return FREE
        n = len(self.origin)
        reach = np.full(n, np.inf) if self.reach is None else self.reach
        return Rails(
            origin=self.origin.copy(),
            reach=np.maximum(reach - self.rounding, 0.0),
            direction=np.full((n, 2), np.nan)
            if self.directions is None
            else self.directions.copy(),
        )


@dataclass(frozen=True, kw_only=True)
class Constraints(Options):
    """What may move, where to, and how far; the fields are keywords of `smooth`, too."""

    owner = "constraints"

    selection: Any = opaque(
        None,
        metavar="CELLS",
        parse=parse_selection,
        help="Cells whose vertices may move: ids, as in 3,7,12 (in Python also a mask), or a "
        "threshold on a metric, as in 'max_angle > 150'.",
    )
    selection_rings: int = option(
        0, within="[0, inf)", help="How often the selection grows by the cells that touch it."
    )
    fixed: Any = opaque(
        None,
        metavar="VERTICES",
        help="Vertices that stay besides those that do anyway: ids or a mask.",
    )
    boundary: Literal["fixed", "slide"] = option(
        "fixed", help="Whether boundary vertices stay, or slide along the boundary."
    )
    interfaces: Literal["fixed", "slide"] = option(
        "fixed", help="Whether vertices on lines between regions stay, or slide along these."
    )
    keep_interfaces: bool = option(
        True, help="Whether vertices on lines between regions, and on line cells, stay."
    )
    corner_angle: float = option(
        20.0,
        within="[0, 180]",
        unit="degrees",
        help="Sliding vertices where the outline turns by more than this are corners, and stay.",
    )
    outline_tolerance: float = option(
        0.01,
        within="[0, 1)",
        help="How far sliding may take the outline from where it was, as a share of the local "
        "edge.",
    )
    curve: Any = opaque(
        None,
        metavar="FILE",
        parse=parse_curve,
        help="What sliding vertices slide along instead of the mesh's own outline: a finer "
        "polyline (in Python also a function that projects places onto a curve).",
    )
    max_move: float | None = option(
        None, within="(0, inf)", help="How far a vertex may come from where it was, a length."
    )
    max_move_share: float | None = option(
        None,
        within="(0, inf)",
        help="How far a vertex may come from where it was, as a share of its shortest edge there.",
    )
    directions: Any = opaque(
        None,
        metavar="DIRECTIONS",
        help="Directions along which alone vertices may move, (n_vertices, 2), NaN for free.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.selection, str):
            parse_selection(self.selection)
        if self.curve is not None:
            object.__setattr__(self, "curve", checked_curve(self.curve))
            if "slide" not in (self.boundary, self.interfaces):
                raise OptionError("`curve` needs `boundary='slide'` or `interfaces='slide'`")
        if self.interfaces == "slide" and not self.keep_interfaces:
            raise OptionError(
                "`interfaces='slide'` keeps vertices on the lines between regions, and "
                "`keep_interfaces=False` lets them leave these: take one of the two"
            )
        if self.directions is not None:
            object.__setattr__(self, "directions", unit_vectors(self.directions))

    def freedom(self, mesh: Mesh) -> Freedom:
        """Work out what may move of a mesh, in the caller's order.

        Raises
        ------
        OptionError
            Where a constraint does not fit the mesh.
        """
        may, cells = np.ones(mesh.n_vertices, np.bool_), None
        if self.selection is not None:
            cells = select_cells(mesh, self.selection, self.selection_rings)
            may &= vertices_of(mesh, cells)
        if self.fixed is not None:
            may &= ~marked(np.asarray(self.fixed), mesh.n_vertices, "vertex", "fixed")
        directions = self.directions
        if directions is not None and len(directions) != mesh.n_vertices:
            raise OptionError(
                f"`directions` must have the shape ({mesh.n_vertices}, 2), got {directions.shape}"
            )
        movable = mesh.topology.movable(self.keep_interfaces) & may
        if directions is not None:
            may &= np.isnan(directions[:, 0])
        chains = self._chains(mesh, may)
        if chains is not None:
            movable |= chains.sliding(mesh.n_vertices)
        return Freedom(
            movable=movable,
            cells=cells,
            origin=mesh.xy,
            reach=self._reach(mesh),
            directions=directions,
            rounding=0.0 if mesh.plane is None else ROUNDING * float(np.abs(mesh.points).max()),
            chains=chains,
            tolerance=self.outline_tolerance,
        )

    def _chains(self, mesh: Mesh, may: BoolArray) -> Chains | None:
        """Find the lines along which vertices slide, of those that may move, (n_vertices,)."""
        if "slide" not in (self.boundary, self.interfaces):
            return None
        chains = find_chains(
            mesh,
            may,
            boundary=self.boundary == "slide",
            interfaces=self.interfaces == "slide",
            corner_angle=self.corner_angle,
            curve=self.curve,
        )
        return chains if chains.inner.size else None

    def _reach(self, mesh: Mesh) -> FloatArray | None:
        """How far each vertex may come from where it is, (n_vertices,)."""
        if self.max_move is None and self.max_move_share is None:
            return None
        reach = np.full(mesh.n_vertices, np.inf if self.max_move is None else self.max_move)
        if self.max_move_share is not None:
            np.minimum(reach, self.max_move_share * shortest_edges(mesh), out=reach)
        return reach


def unit_vectors(directions: npt.ArrayLike) -> FloatArray:
    """Take directions as unit vectors, (n, 2); rows of NaN stay.

    Raises
    ------
    OptionError
        If they are no such array, or one has no length.
    """
    try:
        array = np.array(directions, np.float64)
    except (TypeError, ValueError):
        raise OptionError("`directions` must be numbers in an (n_vertices, 2) array") from None
    if array.ndim != 2 or array.shape[1] != 2:
        raise OptionError(f"`directions` must have the shape (n_vertices, 2), got {array.shape}")
    free = np.isnan(array)
    array[free.all(axis=1)] = np.nan
    # Scaled first: squares would overflow, or vanish.
    largest = np.abs(array).max(axis=1, initial=0.0)
    bad = ~free.all(axis=1) & ~(np.isfinite(largest) & (largest > 0.0))
    if bad.any():
        v = int(np.argmax(bad))
        raise OptionError(
            "each row of `directions` must be a vector with a length, or NaN twice; that of vertex "
            f"{v} is {array[v].tolist()}"
        )
    array /= largest[:, None]
    array /= np.hypot(array[:, 0], array[:, 1])[:, None]
    return array


def shortest_edges(mesh: Mesh) -> FloatArray:
    """Measure the shortest edge of each vertex, (n_vertices,); infinite for one without edges."""
    from qsmooth.kernels.untangle_sweep import shortest_edges

    out = np.empty(mesh.n_vertices)
    everyone = np.arange(mesh.n_vertices, dtype=np.uint32)
    shortest_edges(mesh.xy.copy(), *mesh.topology.rings, everyone, out)
    return out
