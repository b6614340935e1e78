"""The mesh: flat arrays, checked once; topology is derived on demand."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.kernels.stars import Stars

if TYPE_CHECKING:
    import meshio

Surface: TypeAlias = Literal["auto", "flat"]
A = TypeVar("A", bound=npt.NDArray[Any])
MeshLike: TypeAlias = "Mesh | tuple[Any, Any]"

# Points may leave their common plane by this fraction of the mesh's diameter.
PLANE_TOLERANCE = 1e-9
# Products of four coordinates must not overflow, nor those of a mesh's lengths vanish.
LARGEST_COORDINATE = 1e75
SMALLEST_DIAMETER = 1e-75
# Rounding beyond this fraction of the diameter is no excuse.
MOST_ROUNDING = 1e-5
# Points may leave it by the rounding of boundary coordinates with at most so many digits.
FEW_DIGITS = 9
# Tables hold vertex ids in 32 bits, and keep one for "none".
LARGEST_COUNT = 2**32 - 2


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
        z is a value that is carried along, as the depth in a hydrodynamic mesh.
    fixed : (n,) bool, or vertex ids
        Vertices that must not move, besides those on the boundary.
    regions : (n_cells,) integers
        Region of each cell; vertices on the line between two regions are kept by default.

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
    ) -> None:
        if surface not in ("auto", "flat"):
            raise ValueError(f"surface must be 'auto' or 'flat', got {surface!r}")
        self._surface: Surface = surface
        self._points = _read_only(_checked_points(points))
        blocks = _checked_blocks(cells)
        if len(self._points) == 0 or not blocks:
            raise MeshError("the mesh is empty: it has no vertices or no cells")
        self._cells = [_read_only(block) for block in blocks]
        fixed_mask = _checked_fixed(fixed, len(self._points))
        region_ids = _checked_regions(regions, sum(len(block) for block in blocks))
        self._topology = _Topology(len(self._points), blocks, fixed_mask, region_ids)
        self._frame = _frame(self._points, self._topology, surface)
        self._xy = self._project(self._points)
        self._topology.orient(self._xy)
        self._source: object = None

    def __repr__(self) -> str:
        kinds = {3: "triangles", 4: "quads"}
        counts = {k: sum(len(b) for b in self._cells if b.shape[1] == k) for k in kinds}
        cells = ", ".join(f"{n} {kinds[k]}" for k, n in counts.items() if n)
        return f"Mesh({self.n_vertices} vertices, {cells})"

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
        """Coordinates in the plane of the mesh, (n, 2); read-only."""
        return self._xy

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
        new = _checked_points(points)
        if new.shape != self._points.shape:
            raise MeshError(f"points must have the shape {self._points.shape}, got {new.shape}")
        if new.shape[1] == 3 and self._surface == "auto":
            corners = new[self._topology.used]
            if self._frame is not None:
                _require_plane(corners, self._frame)
            elif not _is_level(corners):
                _frame(new, self._topology, "auto")  # raises, unless the plane is another
                raise MeshError("the points lie in another plane than the mesh's own")
        return self._at(new)

    def _at(self, points: FloatArray) -> Mesh:
        """`with_points` without the checks; takes the array over."""
        mesh = object.__new__(Mesh)
        mesh.__dict__.update(self.__dict__)
        mesh._points = _read_only(points)
        mesh._xy = mesh._project(points)
        return mesh

    def _at_xy(self, xy: FloatArray) -> Mesh:
        """View the mesh at other coordinates of its plane, to measure it; `points` stay behind."""
        mesh = object.__new__(Mesh)
        mesh.__dict__.update(self.__dict__)
        mesh._xy = _read_only(xy)
        return mesh

    def _with_xy(self, xy: FloatArray, moved: BoolArray) -> Mesh:
        """Put the `moved` vertices at `xy`; the others keep their bits."""
        points = self._points.copy()
        if self._frame is None:
            points[moved, :2] = xy[moved]
        else:
            points[moved] += (xy[moved] - self._xy[moved]) @ self._frame.axes
        return self._at(points)

    def _project(self, points: FloatArray) -> FloatArray:
        if self._frame is None:
            return _read_only(np.ascontiguousarray(points[:, :2]))
        return _read_only(np.ascontiguousarray((points - self._frame.origin) @ self._frame.axes.T))

    def _recut(self, triangles: IndexArray, regions: IndexArray | None) -> Mesh:
        """Put other cells, oriented as they are, on the same vertices; for `qsmooth.split`."""
        mesh = object.__new__(Mesh)
        mesh.__dict__.update(self.__dict__)
        mesh._cells = [_read_only(triangles)]
        topology = _Topology(self.n_vertices, mesh._cells, self.is_fixed.copy(), regions)
        topology.keep_orientation()
        mesh._topology = topology.with_lines(self._lines)
        return mesh

    def _attach(self, source: object, lines: IndexArray) -> Mesh:
        """Give the mesh its file's document and line cells, (k, 2); for `qsmooth.io`."""
        mesh = object.__new__(Mesh)
        mesh.__dict__.update(self.__dict__)
        mesh._source = source
        mesh._topology = self._topology.with_lines(lines)
        return mesh

    @property
    def _lines(self) -> IndexArray:
        return self._topology.lines

    @property
    def _neighbours(self) -> tuple[IndexArray, IndexArray]:
        """For each side of the given cells its twin in the neighbour or -1; and sides' cells."""
        return self._topology._given_twins, self._topology.corner_cells

    @classmethod
    def from_meshio(cls, mesh: meshio.Mesh, *, surface: Surface = "auto") -> Mesh:
        """Take over a `meshio.Mesh` with its data; the same as reading it from a file."""
        from qsmooth import io

        return io.from_meshio(mesh, surface=surface)

    def to_meshio(self) -> meshio.Mesh:
        """Hand the mesh, with the data of its file, to meshio."""
        from qsmooth import io

        return io.to_meshio(self)


def as_mesh(mesh: MeshLike) -> Mesh:
    """Take a mesh, or a pair ``(points, cells)``, as a `Mesh`."""
    if isinstance(mesh, Mesh):
        return mesh
    if isinstance(mesh, tuple) and len(mesh) == 2:
        return Mesh(*mesh)
    raise TypeError(f"expected a Mesh or a pair (points, cells), got {type(mesh).__name__}")


class _Frame:
    """The plane of a mesh that is not in x and y: an origin and two unit axes, (2, 3).

    Points may leave it by `tolerance`: a small fraction of the diameter, or more where the
    coordinates are rounded. That is told by those on the boundary, which no smoothing moves.
    """

    def __init__(
        self, origin: FloatArray, axes: FloatArray, diameter: float, boundary: FloatArray
    ) -> None:
        self.origin, self.axes, self.diameter = origin, axes, diameter
        self.normal = np.cross(axes[0], axes[1])
        self.tolerance = PLANE_TOLERANCE * diameter
        if np.abs((boundary - origin) @ self.normal).max(initial=0.0) > self.tolerance:
            rounding = min(_rounding(boundary), MOST_ROUNDING * diameter)
            self.tolerance = max(self.tolerance, rounding)


class _Topology:
    """What depends on connectivity alone; shared by all meshes made by `Mesh.with_points`."""

    def __init__(
        self,
        n_vertices: int,
        blocks: list[IndexArray],
        fixed: BoolArray | None,
        regions: IndexArray | None,
    ) -> None:
        from qsmooth.kernels import topology as kernels

        self.n_vertices = n_vertices
        self.n_cells = sum(len(block) for block in blocks)
        if max(n_vertices, 2 * self.n_cells) > LARGEST_COUNT:
            raise MeshError(f"a mesh may have {LARGEST_COUNT} vertices and half as many cells")
        self.regions = None if regions is None else _read_only(regions)
        self.lines: IndexArray = np.empty((0, 2), np.int64)
        sizes = np.concatenate([np.full(len(b), b.shape[1], np.int64) for b in blocks])
        self.cell_offsets = _read_only(np.concatenate([[0], np.cumsum(sizes)]))
        vertices = np.concatenate([block.ravel() for block in blocks])
        bad = kernels.find_bad_index(vertices, n_vertices)
        if bad >= 0:
            count = int(((vertices < 0) | (vertices >= n_vertices)).sum())
            raise MeshError(
                f"{_counted(count, 'vertex id is', 'vertex ids are')} outside "
                f"0 .. {n_vertices - 1}, the first is {vertices[bad]} in cell {self._cell_of(bad)}"
            )
        bad = kernels.find_repeated_vertex(self.cell_offsets, vertices)
        if bad >= 0:
            corners = vertices[self.cell_offsets[bad] : self.cell_offsets[bad + 1]].tolist()
            raise MeshError(f"cell {bad} has a vertex twice: {corners}")
        self._given_vertices = vertices
        star_offsets, star_cells, star_corners = kernels.stars(
            n_vertices, self.cell_offsets, vertices
        )
        self.star_offsets, self.star_cells = _read_only(star_offsets), _read_only(star_cells)
        count, cell, earlier = kernels.find_duplicate_cells(
            self.cell_offsets, vertices, star_offsets, star_cells
        )
        if count:
            raise MeshError(
                f"{_counted(count, 'cell has', 'cells have')} the same vertices as another, "
                f"the first is cell {cell} (as cell {earlier})"
            )
        self._star_corners: IndexArray | None = star_corners
        self._given_twins, count, bad = kernels.edge_twins(n_vertices, self.cell_offsets, vertices)
        if count:
            cell = self._cell_of(bad)
            first, last = self.cell_offsets[cell], self.cell_offsets[cell + 1]
            head = vertices[bad + 1 if bad + 1 < last else first]
            raise MeshError(
                f"{_counted(count, 'cell side is', 'cell sides are')} the third or later on "
                f"one edge (not a 2D mesh), the first is edge {vertices[bad]}-{head} of cell {cell}"
            )
        self.used = np.diff(star_offsets) > 0
        self.is_boundary = _read_only(
            kernels.mark_edge_ends(n_vertices, self.cell_offsets, vertices, self._given_twins < 0)
        )
        is_fixed = self.is_boundary | ~self.used
        if fixed is not None:
            is_fixed |= fixed
        self.is_fixed = _read_only(is_fixed)
        self._schedules: dict[bool, Stars] = {}

    def orient(self, xy: FloatArray) -> None:
        """Turn the cells to run alike; called once, when the coordinates are known."""
        from qsmooth.kernels import topology as kernels

        given, twins = self._given_vertices, self._given_twins
        turned, parts, n_parts, conflict = kernels.orient_parts(self.cell_offsets, given, twins)
        if conflict >= 0:
            raise MeshError(
                "the cells can't be oriented alike (a Möbius strip): going round, "
                f"cell {conflict} meets itself turned over"
            )
        kernels.turn_parts(xy, self.cell_offsets, given, parts, n_parts, turned)
        self.n_parts = n_parts
        self.turned = _read_only(turned)
        self.any_turned = bool(turned.any())
        self.cell_vertices = _read_only(
            kernels.oriented_cells(self.cell_offsets, given, turned) if self.any_turned else given
        )

    def keep_orientation(self) -> None:
        """Take the cells to run as they are given; instead of `orient`."""
        self.n_parts = 1
        self.turned = _read_only(np.zeros(self.n_cells, np.bool_))
        self.any_turned = False
        self.cell_vertices = _read_only(self._given_vertices)

    @cached_property
    def twins(self) -> IndexArray:
        """For each side of the oriented cells, the same edge's side in the neighbour, or -1."""
        from qsmooth.kernels import topology as kernels

        if not self.any_turned:
            return _read_only(self._given_twins)
        twins, _, _ = kernels.edge_twins(self.n_vertices, self.cell_offsets, self.cell_vertices)
        return _read_only(twins)

    @cached_property
    def corner_cells(self) -> IndexArray:
        from qsmooth.kernels import topology as kernels

        return _read_only(kernels.corner_cells(self.cell_offsets))

    @cached_property
    def rings(self) -> tuple[IndexArray, IndexArray]:
        from qsmooth.kernels import topology as kernels

        offsets, vertices = kernels.rings(
            self.n_vertices, self.cell_offsets, self._given_vertices, self._given_twins
        )
        return _read_only(offsets), _read_only(vertices)

    @cached_property
    def is_interface(self) -> BoolArray:
        from qsmooth.kernels import topology as kernels

        marked = np.zeros(self.n_vertices, np.bool_)
        if self.regions is not None:
            region = np.repeat(self.regions, np.diff(self.cell_offsets))
            twins = self._given_twins
            sides = (twins >= 0) & (region != region[twins])
            marked |= kernels.mark_edge_ends(
                self.n_vertices, self.cell_offsets, self._given_vertices, sides
            )
        marked[self.lines.ravel()] = True
        return _read_only(marked)

    def with_lines(self, lines: IndexArray) -> _Topology:
        topology = object.__new__(_Topology)
        topology.__dict__.update(self.__dict__)
        topology.__dict__.pop("is_interface", None)
        topology.lines = _read_only(np.array(lines, np.int64).reshape(-1, 2))
        topology._schedules = {}
        return topology

    def schedule(self, keep_interfaces: bool, only: BoolArray | None = None) -> Stars:
        """Return the movable vertices in `only`, in the order of a sweep, and their stars."""
        if only is not None:
            return self._make_schedule(keep_interfaces, only)
        if keep_interfaces not in self._schedules:
            self._schedules[keep_interfaces] = self._make_schedule(keep_interfaces, None)
        return self._schedules[keep_interfaces]

    def _make_schedule(self, keep_interfaces: bool, only: BoolArray | None) -> Stars:
        from qsmooth.kernels import colouring
        from qsmooth.kernels import topology as kernels

        movable = ~self.is_fixed
        if keep_interfaces:
            movable &= ~self.is_interface
        if only is not None:
            movable &= only
        cells = self.cell_offsets, self.cell_vertices
        star_offsets, star_cells, star_corners = (
            self.star_offsets,
            self.star_cells,
            self._star_corners,
        )
        if self.any_turned or star_corners is None:
            _, _, star_corners = kernels.stars(self.n_vertices, *cells)
        colour, n_colours = colouring.colours(movable, *cells, star_offsets, star_cells)
        colour_offsets, vertices = colouring.order_by_colour(colour, n_colours)
        offsets, corners, row_cells = colouring.star_table(
            vertices, *cells, star_offsets, star_cells, star_corners
        )
        return Stars(
            colour_offsets=_read_only(colour_offsets),
            vertices=_read_only(vertices),
            offsets=_read_only(offsets),
            corners=_read_only(corners),
            cells=_read_only(row_cells),
            largest=int(np.diff(offsets).max(initial=0)),
        )

    def _cell_of(self, corner: int) -> int:
        return int(np.searchsorted(self.cell_offsets, corner, side="right")) - 1


def _read_only(array: A) -> A:
    view = array.view()
    view.flags.writeable = False
    return view


def _checked_points(points: npt.ArrayLike) -> FloatArray:
    try:
        if np.iscomplexobj(points):
            raise TypeError("they are complex")
        array = np.array(points, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise MeshError(f"points must be numbers in an (n, 2) or (n, 3) array: {error}") from None
    if array.size == 0 and array.ndim < 3:
        raise MeshError("the mesh is empty: it has no vertices")
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise MeshError(f"points must have the shape (n, 2) or (n, 3), got {array.shape}")
    bad = ~np.isfinite(array).all(axis=1)
    if bad.any():
        raise MeshError(_count(bad, "not finite"))
    diameter = float(np.linalg.norm(np.ptp(np.clip(array, -1e75, 1e75), axis=0)))
    if 0.0 < diameter < SMALLEST_DIAMETER:
        raise MeshError(f"the mesh is {diameter:.3g} across, where areas vanish: scale it up")
    bad = (np.abs(array) > LARGEST_COORDINATE).any(axis=1)
    if bad.any():
        raise MeshError(_count(bad, f"beyond {LARGEST_COORDINATE:g}, where areas overflow"))
    return array


def _count(bad: Any, what: str) -> str:
    n, first = int(bad.sum()), int(np.argmax(bad))
    return f"{_counted(n, 'vertex is', 'vertices are')} {what}, the first is vertex {first}"


def _counted(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"


def _checked_blocks(cells: npt.ArrayLike | Sequence[npt.ArrayLike]) -> list[IndexArray]:
    blocks = [_checked_block(block, name) for block, name in _split_blocks(cells)]
    return [block for block in blocks if len(block)]


def _split_blocks(cells: Any) -> Iterable[tuple[Any, str]]:
    """One array, a list of rows, or a list of arrays."""
    if isinstance(cells, np.ndarray):
        return [(cells, "cells")]
    try:
        blocks = list(cells)
    except TypeError:
        raise MeshError(
            f"cells must be an integer array or a list of them, got {type(cells).__name__}"
        ) from None
    if any(np.ndim(row) != 1 for block in blocks[:1] for row in _rows(block)):
        return [(cells, "cells")]  # a list of rows, or something that is refused as such
    return [(block, f"cells[{k}]") for k, block in enumerate(blocks)]


def _rows(block: Any) -> list[Any]:
    try:
        return list(block[:1])
    except TypeError:
        return [block]


def _checked_block(block: Any, name: str) -> IndexArray:
    try:
        array = np.asarray(block)
    except ValueError:
        raise MeshError(f"{name} must be an (m, 3) or (m, 4) integer array: rows differ") from None
    if array.size == 0:
        return np.empty((0, 4), np.int64)
    if array.ndim != 2 or array.shape[1] not in (3, 4):
        what = f"{array.shape[1]}-vertex cells" if array.ndim == 2 else f"the shape {array.shape}"
        raise MeshError(f"{name} must be an (m, 3) or (m, 4) integer array, got {what}")
    if array.dtype.kind not in "iu":
        raise MeshError(f"{name} must hold integers, got {array.dtype}")
    if array.dtype == np.uint64 and array.max() > np.iinfo(np.int64).max:
        raise MeshError(f"{name} has a vertex id beyond 64 bits: {array.max()}")
    return np.array(array, dtype=np.int64, order="C")


def _checked_fixed(fixed: npt.ArrayLike | None, n_vertices: int) -> BoolArray | None:
    if fixed is None:
        return None
    array = np.asarray(fixed)
    if array.dtype == np.bool_:
        if array.shape != (n_vertices,):
            raise MeshError(f"a fixed mask must have the shape ({n_vertices},), got {array.shape}")
        return array.copy()
    mask = np.zeros(n_vertices, np.bool_)
    if array.shape == (n_vertices,) and n_vertices > 2 and np.isin(array, (0, 1)).all():
        raise MeshError(
            "fixed looks like a mask of 0 and 1: give booleans, or a list of vertex ids"
        )
    if array.size:
        if array.dtype.kind not in "iu" or array.ndim != 1:
            raise MeshError("fixed must be a boolean mask or a list of vertex ids")
        bad = (array < 0) | (array >= n_vertices)
        if bad.any():
            count = _counted(int(bad.sum()), "id in fixed is", "ids in fixed are")
            raise MeshError(
                f"{count} outside 0 .. {n_vertices - 1}, the first is {array[np.argmax(bad)]}"
            )
        mask[array.astype(np.int64)] = True
    return mask


def _checked_regions(regions: npt.ArrayLike | None, n_cells: int) -> IndexArray | None:
    if regions is None:
        return None
    array = np.asarray(regions)
    if array.shape != (n_cells,) or array.dtype.kind not in "iub":
        raise MeshError(
            f"regions must be {n_cells} integers, one for each cell, "
            f"got {array.dtype} of the shape {array.shape}"
        )
    return np.array(array, dtype=np.int64)


def _frame(points: FloatArray, topology: _Topology, surface: Surface) -> _Frame | None:
    """Find the plane of the used points; None where x and y are the plane's own coordinates."""
    if points.shape[1] == 2 or surface == "flat":
        return None
    corners = points[topology.used]
    if _is_level(corners):
        return None
    low, high = corners.min(axis=0), corners.max(axis=0)
    diameter = float(np.linalg.norm(high - low))
    # The mean lies in the plane; the middle of the bounding box need not.
    origin = corners.mean(axis=0)
    # The triangular factor of all the points spans the same plane; its SVD is 3 by 3.
    factor = np.linalg.qr(corners - origin, mode="r")
    axes = np.linalg.svd(factor)[2]
    normal = np.cross(axes[0], axes[1])
    # Look at the plane from the side that its largest component faces.
    if normal[np.argmax(np.abs(normal))] < 0.0:
        axes[1] = -axes[1]
    frame = _Frame(origin, axes[:2], diameter, points[topology.is_boundary])
    _require_plane(corners, frame)
    return frame


def _is_level(corners: FloatArray) -> bool:
    """Whether z is constant."""
    spans = np.ptp(corners, axis=0)
    return bool(spans[2] <= PLANE_TOLERANCE * np.linalg.norm(spans))


def _rounding(corners: FloatArray) -> float:
    """How far coordinates may be off for having been rounded to float32, or to a few digits."""
    sizes = np.abs(corners[corners != 0.0])
    largest = float(sizes.max())
    if np.array_equal(corners.astype(np.float32), corners):
        return largest * float(np.finfo(np.float32).eps)
    exponents = np.floor(np.log10(sizes))
    for digits in range(1, FEW_DIGITS + 1):
        unit = 10.0 ** (exponents + 1 - digits)
        if (np.abs(np.round(sizes / unit) * unit - sizes) <= 1e-15 * sizes).all():
            return float(unit.max())
    return 0.0


def _require_plane(corners: FloatArray, frame: _Frame) -> None:
    off = np.abs((corners - frame.origin) @ frame.normal)
    if off.max() > frame.tolerance:
        raise MeshError(
            "the points do not lie in one plane: they leave it by up to "
            f"{off.max():.3g}, in a mesh {frame.diameter:.3g} across; if z is a value on a flat "
            "mesh (a depth, say), use surface='flat' (--surface flat)"
        )
