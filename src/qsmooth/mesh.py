"""The mesh: what a user holds. Flat arrays, checked once; topology is derived on demand."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.checks import (
    checked_blocks,
    checked_fixed,
    checked_points,
    checked_regions,
    read_only,
)
from qsmooth.errors import MeshError
from qsmooth.geographic import Projection, require_degrees
from qsmooth.notebook import page, thumbnail
from qsmooth.plane import Plane, coordinates, find_plane, is_level
from qsmooth.table import Row, Section, Table
from qsmooth.topology import Topology

Surface: TypeAlias = Literal["auto", "flat"]
MeshLike: TypeAlias = "Mesh | tuple[Any, Any]"


class Mesh:
    """A 2D mesh of quadrilaterals, triangles or both.

    Input is copied and checked; connectivity can't be changed afterwards. Inside, cells are turned
    to run alike: neighbours first, then each edge-connected part such that its area, which its
    boundary alone decides, is positive. So a mesh that is clockwise as a whole, or by parts, is a
    valid mesh.

    Parameters
    ----------
    points : (n, 2) or (n, 3)
        Coordinates, in any one unit.
    cells : (m, 4) or (m, 3) integers, or a list of such arrays
        Vertex ids of each cell, counted from 0. Cells are numbered as listed.
    surface
        What a third coordinate means. ``"auto"``: the points must lie in one plane (to 1e-9 of
        the mesh's diameter, or to the rounding of coordinates that have few digits), which is then
        smoothed in. ``"flat"``: x and y are the geometry, and
        z is a value that belongs to places, as the depth in a hydrodynamic mesh.
    fixed : (n,) bool, or vertex ids
        Vertices that must not move, besides those on the boundary.
    regions : (n_cells,) integers
        Region of each cell; vertices on the line between two regions are kept by default.
    geographic
        Whether x and y are longitudes and latitudes in degrees. Then the mesh is measured and
        smoothed in a conformal projection about its middle, in metres, where its angles are the
        true ones, and given back in degrees. A third coordinate is a value, as on a flat surface.

    Raises
    ------
    MeshError
        Coordinates that are not finite or too large, ids out of range, a vertex twice in a cell,
        a cell twice, an edge with three cells, a surface that can't be oriented or is not flat.
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike | Sequence[npt.ArrayLike],
        *,
        surface: Surface = "auto",
        fixed: npt.ArrayLike | None = None,
        regions: npt.ArrayLike | None = None,
        geographic: bool = False,
    ) -> None:
        self._surface: Surface = "flat" if geographic else _checked_surface(surface)
        self._points = read_only(checked_points(points))
        blocks = checked_blocks(cells)
        if len(self._points) == 0 or not blocks:
            raise MeshError("the mesh is empty: it has no vertices or no cells")
        fixed_mask = checked_fixed(fixed, len(self._points))
        region_ids = checked_regions(regions, sum(len(block) for block in blocks))
        self._topology = Topology(len(self._points), blocks, fixed_mask, region_ids)
        self._cells = _as_blocks(self._topology.given_vertices, blocks)
        self._plane: Plane | None = None
        self._projection: Projection | None = None
        if geographic:
            require_degrees(self._points)
            self._projection = Projection(self._points[self._topology.used])
        elif self._points.shape[1] == 3 and surface == "auto":
            topology = self._topology
            self._plane = find_plane(self._points, topology.used, topology.is_boundary)
        self._xy = self.project(self._points)
        self._topology.orient(self._xy)
        self._source: object = None
        self._origin: object = None

    def __repr__(self) -> str:
        kinds = {3: "triangles", 4: "quads"}
        counts = {k: sum(len(b) for b in self._cells if b.shape[1] == k) for k in kinds}
        cells = ", ".join(f"{n} {kinds[k]}" for k, n in counts.items() if n)
        return f"Mesh({self.n_vertices} vertices, {cells})"

    def _repr_html_(self) -> str:
        """Show a table and a picture in a notebook."""
        spans = " × ".join(f"{span:.4g}" for span in np.ptp(self._points, axis=0))
        rows = [Row("Extent", (spans,)), Row("Boundary vertices", (str(self.is_boundary.sum()),))]
        if self.regions is not None:
            rows.append(Row("Regions", (str(len(np.unique(self.regions))),)))
        picture = thumbnail(self._xy, self._topology.cells, self._topology.twins, None)
        return page(repr(self), Table(("",), (Section("", tuple(rows)),)), [picture])

    def __getstate__(self) -> dict[str, Any]:
        """Pickle all but the origin, which need not be a thing that can be."""
        return {**self.__dict__, "_origin": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled mesh; arrays come back writable, which is another type for kernels."""
        self.__dict__.update(state)
        self._points, self._xy = read_only(self._points), read_only(self._xy)
        self._cells = _as_blocks(self._topology.given_vertices, self._cells)

    @property
    def points(self) -> FloatArray:
        """Coordinates as float64 in the shape that came in, (n, 2) or (n, 3); read-only."""
        return self._points

    @property
    def cells(self) -> list[IndexArray]:
        """Blocks of cells, (m, 3) or (m, 4), in the caller's order and orientation; read-only."""
        return list(self._cells)

    @property
    def xy(self) -> FloatArray:
        """Coordinates in the plane of the mesh, (n, 2); read-only.

        In metres where those of the mesh are longitudes and latitudes.
        """
        return self._xy

    @property
    def topology(self) -> Topology:
        """What follows from the cells alone, shared by all meshes with the same cells."""
        return self._topology

    @property
    def plane(self) -> Plane | None:
        """The plane of the points; None where it is that of x and y."""
        return self._plane

    @property
    def projection(self) -> Projection | None:
        """The map of longitudes and latitudes; None where the coordinates are none."""
        return self._projection

    @property
    def geographic(self) -> bool:
        """Whether x and y are longitudes and latitudes in degrees."""
        return self._projection is not None

    @property
    def source(self) -> object:
        """The content of the file that the mesh was read from, or None; for `qsmooth.io`."""
        return self._source

    @property
    def origin(self) -> object:
        """What of another library the mesh was made of, or None; for `qsmooth.adapters`."""
        return self._origin

    @property
    def surface(self) -> Surface:
        """What a third coordinate means, as given."""
        return self._surface

    @property
    def n_vertices(self) -> int:
        """Count of points, orphans included."""
        return len(self._points)

    @property
    def n_cells(self) -> int:
        """Count of cells."""
        return self._topology.n_cells

    @property
    def regions(self) -> IndexArray | None:
        """Region of each cell, (n_cells,), or None; read-only."""
        return self._topology.regions

    @property
    def is_boundary(self) -> BoolArray:
        """Whether a vertex is on an edge with only one cell, (n,); read-only."""
        return self._topology.is_boundary

    @property
    def is_fixed(self) -> BoolArray:
        """Whether a vertex may never move: boundary, `fixed` and orphans, (n,); read-only."""
        return self._topology.is_fixed

    @property
    def is_interface(self) -> BoolArray:
        """Whether a vertex is on the line between two regions or on a line cell; read-only."""
        return self._topology.is_interface

    @property
    def star_offsets(self) -> IndexArray:
        """Row starts of the map from a vertex to its cells, (n + 1,); read-only."""
        return self._topology.star_offsets

    @property
    def star_cells(self) -> IndexArray:
        """Cells around each vertex, ascending, (n_corners,); read-only."""
        return self._topology.star_cells

    @property
    def ring_offsets(self) -> IndexArray:
        """Row starts of the map from a vertex to its edge neighbours, (n + 1,); read-only."""
        return self._topology.rings[0]

    @property
    def ring_vertices(self) -> IndexArray:
        """Edge neighbours of each vertex, ascending, (2 * n_edges,); read-only."""
        return self._topology.rings[1]

    @property
    def cell_offsets(self) -> IndexArray:
        """Row starts of the map from a cell to its corners, (n_cells + 1,); read-only."""
        return self._topology.cell_offsets

    @property
    def cell_vertices(self) -> IndexArray:
        """Corners of each cell, all cells running alike, (n_corners,); read-only."""
        return self._topology.cell_vertices

    def with_points(self, points: npt.ArrayLike) -> Mesh:
        """Make a mesh with the same connectivity, orientation and data at other coordinates.

        Parameters
        ----------
        points : same shape as `points`
            New coordinates; copied.

        Raises
        ------
        MeshError
            Another shape, coordinates that are not finite, or points outside the mesh's plane.
        """
        new = checked_points(points)
        if self._projection is not None:
            require_degrees(new)
        if new.shape != self._points.shape:
            raise MeshError(f"points must have the shape {self._points.shape}, got {new.shape}")
        if new.shape[1] == 3 and self._surface == "auto":
            topology = self._topology
            corners = new[topology.used]
            if self._plane is not None:
                self._plane.require(corners)
            elif not is_level(corners):
                find_plane(new, topology.used, topology.is_boundary)  # raises if there is none
                raise MeshError("the points lie in another plane than the mesh's own")
        return self._at(new)

    def with_xy(self, xy: FloatArray, moved: BoolArray) -> Mesh:
        """Put the `moved` vertices, (n,) bool, at `xy`; the others keep their bits.

        Where none has moved it is this mesh.

        Parameters
        ----------
        xy : (n, 2)
            Finite coordinates in the plane of the mesh; not checked.
        """
        if not moved.any():
            return self
        points = self._points.copy()
        if self._projection is not None:
            points[moved, :2] = self._projection.unproject(xy[moved])
        elif self._plane is None:
            points[moved, :2] = xy[moved]
        else:
            points[moved] += self._plane.displacement(xy[moved] - self._xy[moved])
        return self._at(points)

    def with_geographic(self, geographic: bool | None) -> Mesh:
        """Make a mesh whose x and y are, or are no, longitudes and latitudes in degrees.

        All else stays. None leaves it as it is.

        Raises
        ------
        MeshError
            If they can't be.
        """
        return self.taken_as("auto", geographic)

    def taken_as(self, surface: Surface, geographic: bool | None) -> Mesh:
        """Make a mesh of the same points whose coordinates mean something else.

        All else stays. ``"auto"`` and None leave it as it is.

        Raises
        ------
        MeshError
            If they can't be degrees.
        """
        surface = self._surface if _checked_surface(surface) == "auto" else surface
        geographic = self.geographic if geographic is None else geographic
        same_z = surface == self._surface or self._points.shape[1] == 2
        if same_z and geographic == self.geographic:
            return self
        mesh = Mesh(
            self._points,
            self.cells,
            surface=surface,
            fixed=self._topology.given_fixed,
            regions=self.regions,
            geographic=geographic,
        )
        return mesh.with_source(self._source, self._topology.lines).with_origin(self._origin)

    def project(self, points: FloatArray) -> FloatArray:
        """Coordinates of points in the plane of the mesh, (n, 2); read-only, not checked."""
        if self._projection is not None:
            return read_only(self._projection.project(points))
        return coordinates(points, self._plane)

    def with_fixed(self, fixed: npt.ArrayLike | None) -> Mesh:
        """Make a mesh whose vertices here must not move, instead of those fixed before.

        All else stays: regions, line cells, data, and the file that it was read from. Boundary
        vertices are fixed in any case.

        Parameters
        ----------
        fixed : (n,) bool, or vertex ids
            None for no vertex.

        Raises
        ------
        MeshError
            If it is neither, or has ids that are no vertices.
        """
        mask = checked_fixed(fixed, self.n_vertices)
        mesh = self._copy()
        mesh._topology = self._topology.with_fixed(
            np.zeros(self.n_vertices, np.bool_) if mask is None else mask
        )
        return mesh

    def with_cells(self, cells: IndexArray, regions: IndexArray | None = None) -> Mesh:
        """Put other cells, oriented as they are, on the same vertices; for `qsmooth.split`.

        Fixed vertices and line cells go along.

        Raises
        ------
        MeshError
            If an edge would have more than two cells.
        """
        mesh = self._copy()
        mesh._cells = [read_only(cells)]
        mesh._topology = Topology(
            self.n_vertices, mesh._cells, self._topology.given_fixed, regions, self._topology.lines
        )
        return mesh

    def with_values(self, points: FloatArray | None, source: object) -> Mesh:
        """Give the mesh other values at the same places; for `qsmooth.carrying`.

        Parameters
        ----------
        points : (n, 3) or None
            With another z, which is no part of the geometry; not checked.
        source
            Its file's content, with other point data.
        """
        mesh = self._copy()
        mesh._source = source
        if points is not None:
            mesh._points = read_only(points)
        return mesh

    def with_source(self, source: object, lines: IndexArray) -> Mesh:
        """Give the mesh its file's content and line cells, (k, 2); for `qsmooth.io`."""
        mesh = self._copy()
        mesh._source = source
        mesh._topology = self._topology.with_lines(lines)
        return mesh

    def with_origin(self, origin: object) -> Mesh:
        """Remember what the mesh was made of; for `qsmooth.adapters`."""
        mesh = self._copy()
        mesh._origin = origin
        return mesh

    def _copy(self) -> Mesh:
        mesh = object.__new__(Mesh)
        mesh.__dict__.update(self.__dict__)
        return mesh

    def _at(self, points: FloatArray) -> Mesh:
        """`with_points` without the checks; takes the array over."""
        mesh = self._copy()
        mesh._points = read_only(points)
        mesh._xy = self.project(points)
        return mesh


def _checked_surface(surface: Surface) -> Surface:
    if surface not in ("auto", "flat"):
        raise ValueError(f"surface must be 'auto' or 'flat', got {surface!r}")
    return surface


def _as_blocks(vertices: IndexArray, blocks: Sequence[IndexArray]) -> list[IndexArray]:
    """View the corners of all cells as the blocks that they came in."""
    ends = itertools.accumulate((block.size for block in blocks), initial=0)
    return [
        vertices[start : start + block.size].reshape(block.shape)
        for start, block in zip(ends, blocks, strict=False)
    ]


def plain_mesh(mesh: MeshLike) -> Mesh:
    """Take a mesh, or a pair ``(points, cells)``, as a `Mesh`; `qsmooth.as_mesh` takes all else."""
    if isinstance(mesh, Mesh):
        return mesh
    if isinstance(mesh, tuple) and len(mesh) == 2:
        return Mesh(*mesh)
    raise TypeError(
        f"expected a Mesh or a pair (points, cells), got {type(mesh).__name__}; "
        "as_mesh() takes meshes of other libraries"
    )
