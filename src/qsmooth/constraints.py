"""What may move, where to, and how far: the caller's word on the vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.curves import Curve, checked_curve, read_curve
from qsmooth.geographic import SEMI_AXIS, Projection
from qsmooth.kernels.rails import FREE, Rails
from qsmooth.mesh import Mesh
from qsmooth.metrics.bounds import Kept, kept_by
from qsmooth.numbering import Inside
from qsmooth.options import OptionError, Options, opaque, option
from qsmooth.outline import Chains, find_chains
from qsmooth.selection import (
    check_vertices,
    marked,
    parse_selection,
    parse_vertices,
    read_ids,
    select_cells,
    select_vertices,
)
from qsmooth.vectors import directions_of, parse_directions, shortest_edges, transition

# Of the largest coordinate of points in a tilted plane, or of the Earth's radius for those in
# degrees: more than their rounding.
ROUNDING = 2.0**-49


@dataclass(frozen=True, kw_only=True)
class Freedom:
    """What may move of one mesh, and where to.

    Attributes
    ----------
    movable : (n_vertices,)
        Vertices that may move at all.
    kept
        What keeps the others: words for them, and a mask, (n_vertices,); one after the other.
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
        Lines along which some of `movable` slide, of the caller's vertices; without any where none
        can, None where none is to.
    tolerance
        How far an edge on these may be from its line, as a share of the edge.
    by_edge : (n_vertices,) or None
        What share of its shortest edge each may come, infinite for any; None for all. That is in
        `reach` already, as the edges were.
    """

    movable: BoolArray
    kept: tuple[Kept, ...]
    cells: BoolArray | None
    origin: FloatArray
    reach: FloatArray | None = None
    directions: FloatArray | None = None
    rounding: float = 0.0
    chains: Chains | None = None
    tolerance: float = 0.0
    by_edge: FloatArray | None = None

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
            kept=tuple((words, kept[inside.topology.vertex_ids]) for words, kept in self.kept),
            origin=inside.at_vertices(self.origin),
            reach=None if self.reach is None else inside.at_vertices(self.reach),
            directions=None if self.directions is None else inside.at_vertices(self.directions),
            by_edge=None if self.by_edge is None else inside.at_vertices(self.by_edge),
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
        help="Cells whose vertices may move: ids, as in 3,7,12 (in Python also a mask); a "
        "threshold on a metric, as in 'max_angle > 150'; a region, as in 'region == 3', also by "
        "its name in the file; or the cells in a polygon, as in 'polygon: 0,0 2,0 2,1', or in one "
        "of a file, 'polygon: FILE' (in Python also an array, (k, 2)).",
    )
    selection_rings: int = option(
        0,
        within="[0, inf)",
        help="Rings of cells around the selection, in which vertices move less and less: of n "
        "rings, in ring k by up to (n + 1 - k) / (n + 1) of their shortest edge.",
    )
    fixed: Any = opaque(
        None,
        metavar="VERTICES",
        parse=parse_vertices,
        help="Vertices that stay besides those that do anyway: ids, as in 3,7,12 (in Python also a "
        "mask); conditions, as in 'x < 0 and y >= 1.5'; or what the file has by name: point sets, "
        "physical groups, markers, cell sets.",
    )
    fixed_file: Any = opaque(
        None,
        metavar="FILE",
        help="A file of such ids, one a line, counted from 0; what follows a # does not count.",
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
        help="What sliding vertices slide along instead of the mesh's own outline: a finer "
        "polyline, a line x y for each place, an empty line between two (in Python also an array, "
        "a list of such, or a function that projects places onto a curve).",
    )
    max_move: float | None = option(
        None,
        within="(0, inf)",
        help="How far a vertex may come from where it was, in the unit of the coordinates.",
    )
    max_move_share: float | None = option(
        None,
        within="(0, inf)",
        help="How far a vertex may come from where it was, as a share of its shortest edge there.",
    )
    directions: Any = opaque(
        None,
        metavar="DIRECTIONS",
        help="Along what alone vertices may move: a vector for all, as in 1,0, or the name of "
        "point data with two or three components (in Python also an array, (n_vertices, 2)). NaN "
        "where a vertex is free.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.selection, str):
            parse_selection(self.selection)
        if self.curve is not None:
            is_file = isinstance(self.curve, (str, Path))
            curve = read_curve(self.curve) if is_file else checked_curve(self.curve)
            object.__setattr__(self, "curve", curve)
            if "slide" not in (self.boundary, self.interfaces):
                raise OptionError("`curve` needs `boundary='slide'` or `interfaces='slide'`")
        if self.interfaces == "slide" and not self.keep_interfaces:
            raise OptionError(
                "`interfaces='slide'` keeps vertices on the lines between regions, and "
                "`keep_interfaces=False` lets them leave these: take one of the two"
            )
        if self.fixed is not None:
            check_vertices(self.fixed)
        if self.directions is not None:
            object.__setattr__(self, "directions", parse_directions(self.directions))

    def resolved(self, mesh: Mesh) -> Self:
        """Make masks of the vertices and cells that are given in words, or in a file.

        Raises
        ------
        OptionError
            Where a constraint does not fit the mesh.
        """
        if self.directions is not None:
            directions_of(mesh, self.directions)
        chosen = None if self.selection is None else select_cells(mesh, self.selection)
        return replace(self, fixed=self._fixed(mesh), fixed_file=None, selection=chosen)

    def freedom(self, mesh: Mesh) -> Freedom:
        """Work out what may move of a mesh, in the caller's order.

        Raises
        ------
        OptionError
            Where a constraint does not fit the mesh.
        """
        topology, cells, shares = mesh.topology, None, None
        kept: list[Kept] = []
        if (fixed := self._fixed(mesh)) is not None:
            kept.append(("vertices given as fixed", fixed))
        if self.selection is not None:
            chosen = select_cells(mesh, self.selection)
            cells, shares = transition(mesh, chosen, self.selection_rings)
            kept.append(("vertices outside the selection", shares == 0.0))
        directions = None if self.directions is None else directions_of(mesh, self.directions)
        stays = [marks for _, marks in kept]
        if directions is not None:
            stays.append(~np.isnan(directions[:, 0]))
        chains = self._chains(mesh, stays)
        slide = np.zeros(mesh.n_vertices, np.bool_)
        if chains is not None:
            slide = chains.sliding(mesh.n_vertices)
        own = kept_by(topology, self.keep_interfaces)
        kept = [*((words, marks & ~slide) for words, marks in own), *kept]
        by_edge = self._by_edge(mesh, shares)
        return Freedom(
            movable=~np.logical_or.reduce([marks for _, marks in kept]),
            kept=tuple(kept),
            cells=cells,
            origin=mesh.xy,
            reach=self._reach(mesh, by_edge),
            directions=directions,
            rounding=_rounding(mesh),
            chains=chains,
            tolerance=self.outline_tolerance,
            by_edge=by_edge,
        )

    def _fixed(self, mesh: Mesh) -> BoolArray | None:
        """Mark the vertices given as fixed, (n_vertices,); None where none are."""
        marks = [] if self.fixed is None else [select_vertices(mesh, self.fixed)]
        if self.fixed_file is not None:
            ids = np.array(read_ids(self.fixed_file, "fixed_file"), np.int64)
            marks.append(marked(ids, mesh.n_vertices, "vertex", "fixed_file"))
        return np.logical_or.reduce(marks) if marks else None

    def _chains(self, mesh: Mesh, stays: list[BoolArray]) -> Chains | None:
        """Find the lines along which vertices slide, but for those marked, (n_vertices,) each."""
        if "slide" not in (self.boundary, self.interfaces):
            return None
        may = np.ones(mesh.n_vertices, np.bool_)
        for marks in stays:
            may &= ~marks
        return find_chains(
            mesh,
            may,
            boundary=self.boundary == "slide",
            interfaces=self.interfaces == "slide",
            corner_angle=self.corner_angle,
            curve=on_map(self.curve, mesh.projection),
        )

    def _by_edge(self, mesh: Mesh, shares: FloatArray | None) -> FloatArray | None:
        """What share of its shortest edge each vertex may come, (n_vertices,).

        Parameters
        ----------
        shares : (n_vertices,) or None
            As `transition` gives them.
        """
        if self.max_move_share is None and (shares is None or self.selection_rings == 0):
            return None
        by_edge = np.full(mesh.n_vertices, np.inf)
        if self.max_move_share is not None:
            by_edge[:] = self.max_move_share
        if shares is not None:
            by_edge = np.where(shares > 0.0, np.minimum(by_edge, shares), by_edge)
        return by_edge

    def _reach(self, mesh: Mesh, by_edge: FloatArray | None) -> FloatArray | None:
        """How far each vertex may come from where it is, (n_vertices,)."""
        if self.max_move is None and by_edge is None:
            return None
        reach = np.full(mesh.n_vertices, np.inf if self.max_move is None else self.max_move)
        limited = np.isfinite(by_edge) if by_edge is not None else np.zeros(0, np.bool_)
        if by_edge is not None and limited.any():
            with np.errstate(over="ignore"):
                edges = by_edge[limited] * shortest_edges(mesh)[limited]
            reach[limited] = np.minimum(reach[limited], edges)
        return reach if np.isfinite(reach).any() else None


def _rounding(mesh: Mesh) -> float:
    """How far places are off as they are stored, in the plane of the mesh."""
    if mesh.projection is not None:
        return ROUNDING * SEMI_AXIS
    return 0.0 if mesh.plane is None else ROUNDING * float(np.abs(mesh.points).max())


def on_map(curve: Curve | None, projection: Projection | None) -> Curve | None:
    """Put a curve of longitudes and latitudes on the map in which a mesh of these is measured."""
    if curve is None or projection is None:
        return curve
    if not callable(curve):
        return [projection.project(one) for one in curve]
    given, here = curve, projection

    def onto(places: FloatArray) -> FloatArray:
        return here.project(np.asarray(given(here.unproject(places)), dtype=np.float64))

    return onto
