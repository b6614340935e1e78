"""Topology: what depends on connectivity alone, derived once and shared by all placements."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.checks import all_read_only, counted, read_only
from qsmooth.errors import MeshError
from qsmooth.kernels.stars import Stars
from qsmooth.schedule import make_schedule

if TYPE_CHECKING:
    from collections.abc import Sequence

    from qsmooth.kernels.blocks import Blocks

# Tables hold vertex ids in 32 bits, and keep one for "none".
LARGEST_COUNT = 2**32 - 2


class Topology:
    """Cells and what follows from them: CSR maps, orientation, boundary, colours.

    All meshes made by `Mesh.with_points` share one. Arrays are read-only.

    Attributes
    ----------
    n_vertices, n_cells, n_quads
        Counts; orphans are vertices too.
    cell_offsets, cell_vertices : (n_cells + 1,), (n_corners,)
        CSR map from a cell to its corners; all cells of a part run alike.
    star_offsets, star_cells : (n_vertices + 1,), (n_corners,)
        CSR map from a vertex to its cells, in the order of the caller's ids.
    given_vertices : (n_corners,)
        Corners as the caller listed them.
    turned : (n_cells,)
        Cells that run the other way than the caller's.
    used, is_boundary, given_fixed, is_fixed : (n_vertices,)
        In a cell; on an edge with only one cell; fixed by the caller; never to move: both of these,
        and orphans.
    regions : (n_cells,) or None
        Region of each cell.
    lines : (k, 2)
        Line cells of the file.
    is_renumbered
        Whether vertices and cells have other numbers than the caller's (`renumbered`).
    """

    def __init__(
        self,
        n_vertices: int,
        blocks: Sequence[IndexArray],
        fixed: BoolArray | None = None,
        regions: IndexArray | None = None,
        lines: IndexArray | None = None,
    ) -> None:
        from qsmooth.kernels import topology as kernels

        self.n_vertices = n_vertices
        self.n_cells = sum(len(block) for block in blocks)
        if max(n_vertices, 2 * self.n_cells) > LARGEST_COUNT:
            raise MeshError(f"a mesh may have {LARGEST_COUNT} vertices and half as many cells")
        self.regions = None if regions is None else read_only(regions)
        self.lines = read_only(np.empty((0, 2), np.int64) if lines is None else lines)
        self.n_quads = sum(len(block) for block in blocks if block.shape[1] == 4)
        # Read-only from here on, as kernels are compiled once more for arrays that are not.
        self.cell_offsets = read_only(_offsets_of(blocks))
        flat = [block.ravel() for block in blocks]
        vertices = read_only(np.concatenate(flat) if len(flat) > 1 else flat[0])
        self.given_vertices = vertices
        bad = kernels.find_bad_index(vertices, n_vertices)
        if bad >= 0:
            count = int(((vertices < 0) | (vertices >= n_vertices)).sum())
            raise MeshError(
                f"{counted(count, 'vertex id is', 'vertex ids are')} outside "
                f"0 .. {n_vertices - 1}, the first is {vertices[bad]} in cell {self._cell_of(bad)}"
            )
        bad = kernels.find_repeated_vertex(self.cell_offsets, vertices)
        if bad >= 0:
            corners = vertices[self.cell_offsets[bad] : self.cell_offsets[bad + 1]].tolist()
            raise MeshError(f"cell {bad} has a vertex twice: {corners}")
        star_offsets, star_cells, star_corners = kernels.stars(
            n_vertices, self.cell_offsets, vertices
        )
        self.star_offsets, self.star_cells = read_only(star_offsets), read_only(star_cells)
        self._given_star_corners = star_corners
        twins, count, bad = kernels.edge_twins(
            self.cell_offsets, vertices, star_offsets, star_cells, star_corners
        )
        # Cells with the same vertices are neighbours by two edges, or by one with more cells.
        cells = kernels.corner_cells(self.cell_offsets)
        if count or kernels.may_be_duplicates(self.cell_offsets, twins, cells):
            self._refuse_duplicates()
        if count:
            cell = self._cell_of(bad)
            first, last = self.cell_offsets[cell], self.cell_offsets[cell + 1]
            head = vertices[bad + 1 if bad + 1 < last else first]
            raise MeshError(
                f"{counted(count, 'cell side is', 'cell sides are')} the third or later on "
                f"one edge (not a 2D mesh), the first is edge {vertices[bad]}-{head} of cell {cell}"
            )
        self._given_twins: IndexArray | None = read_only(twins)
        self.used = read_only(np.diff(star_offsets) > 0)
        self.is_boundary = read_only(
            kernels.mark_edge_ends(n_vertices, self.cell_offsets, vertices, twins < 0)
        )
        self._fix(np.zeros(n_vertices, np.bool_) if fixed is None else fixed)
        self._schedules: dict[bool, Stars] = {}
        self._blocks: dict[bool, Blocks] = {}
        self.is_renumbered = False
        self._along_curve: Topology | None = None
        self.keep_orientation()

    def _refuse_duplicates(self) -> None:
        from qsmooth.kernels import topology as kernels

        count, cell, earlier = kernels.find_duplicate_cells(
            self.cell_offsets, self.given_vertices, self.star_offsets, self.star_cells
        )
        if count:
            raise MeshError(
                f"{counted(count, 'cell has', 'cells have')} the same vertices as another, "
                f"the first is cell {cell} (as cell {earlier})"
            )

    def keep_orientation(self) -> None:
        """Take the cells to run as they are given."""
        self.turned = read_only(np.zeros(self.n_cells, np.bool_))
        self.cell_vertices = self.given_vertices

    def orient(self, xy: FloatArray) -> None:
        """Turn the cells to run alike; called once, when the coordinates are known.

        Raises
        ------
        MeshError
            If that can't be: a Möbius strip.
        """
        from qsmooth.kernels import orientation

        given, twins = self.given_vertices, self.given_twins
        if orientation.all_run_alike(xy, self.cell_offsets, given, twins):
            return
        turned, parts, n_parts, conflict = orientation.orient_parts(self.cell_offsets, given, twins)
        if conflict >= 0:
            raise MeshError(
                "the cells can't be oriented alike (a Möbius strip): going round, "
                f"cell {conflict} meets itself turned over"
            )
        orientation.turn_parts(xy, self.cell_offsets, given, parts, n_parts, turned)
        self.turned = read_only(turned)
        if self.any_turned:
            self.cell_vertices = read_only(
                orientation.oriented_cells(self.cell_offsets, given, turned)
            )

    @cached_property
    def n_parts(self) -> int:
        """Parts connected by edges."""
        from qsmooth.kernels import orientation

        parts: int = orientation.orient_parts(self.cell_offsets, self.cell_vertices, self.twins)[2]
        return parts

    @cached_property
    def vertex_ids(self) -> IndexArray:
        """The caller's number of each vertex, (n_vertices,)."""
        return read_only(np.arange(self.n_vertices))

    @cached_property
    def cell_ids(self) -> IndexArray:
        """The caller's number of each cell, (n_cells,)."""
        return read_only(np.arange(self.n_cells))

    def first_vertex(self, marked: BoolArray) -> int:
        """Which of the marked vertices, (n_vertices,), comes first for the caller; 0 of none."""
        return _first(marked, self.vertex_ids)

    def first_cell(self, marked: BoolArray) -> int:
        """Which of the marked cells, (n_cells,), comes first for the caller; 0 of none."""
        return _first(marked, self.cell_ids)

    @cached_property
    def any_turned(self) -> bool:
        """Whether a cell runs the other way than the caller's."""
        return bool(self.turned.any())

    @property
    def cells(self) -> tuple[IndexArray, IndexArray]:
        """The pair (cell_offsets, cell_vertices), as kernels take it."""
        return self.cell_offsets, self.cell_vertices

    @property
    def given_twins(self) -> IndexArray:
        """The other cell's side of each edge, as the caller listed corners, or -1, (n_corners,)."""
        from qsmooth.kernels import topology as kernels

        if self._given_twins is None:
            stars = self.star_offsets, self.star_cells, self._given_star_corners
            twins, _, _ = kernels.edge_twins(self.cell_offsets, self.given_vertices, *stars)
            self._given_twins = read_only(twins)
        return self._given_twins

    @cached_property
    def twins(self) -> IndexArray:
        """For each side of the oriented cells, the same edge's side in the neighbour, or -1."""
        from qsmooth.kernels import topology as kernels

        if not self.any_turned:
            return self.given_twins
        stars = self.star_offsets, self.star_cells, self.star_corners
        twins, _, _ = kernels.edge_twins(*self.cells, *stars)
        return read_only(twins)

    @cached_property
    def corner_cells(self) -> IndexArray:
        """Cell of each corner position, (n_corners,)."""
        from qsmooth.kernels import topology as kernels

        return read_only(kernels.corner_cells(self.cell_offsets))

    @cached_property
    def star_corners(self) -> IndexArray:
        """Position in `cell_vertices` of each vertex in each of its cells, (n_corners,)."""
        from qsmooth.kernels import topology as kernels

        if not self.any_turned:
            return read_only(self._given_star_corners)
        return read_only(kernels.stars(self.n_vertices, *self.cells)[2])

    @cached_property
    def rings(self) -> tuple[IndexArray, IndexArray]:
        """CSR map from a vertex to its edge neighbours, in the order of the caller's ids.

        (n + 1,), (2 * n_edges,).
        """
        from qsmooth.kernels import numbering
        from qsmooth.kernels import topology as kernels

        offsets, vertices = kernels.rings(
            self.n_vertices, self.cell_offsets, self.given_vertices, self.given_twins
        )
        if self.is_renumbered:
            numbering.sort_rows(offsets, vertices, vertices.copy(), self.vertex_ids)
        return read_only(offsets), read_only(vertices)

    @cached_property
    def cell_sizes(self) -> IndexArray:
        """Corners of each cell, 3 or 4, (n_cells,)."""
        return read_only(np.diff(self.cell_offsets))

    @cached_property
    def is_interface(self) -> BoolArray:
        """Whether a vertex is on the line between two regions or on a line cell, (n_vertices,)."""
        from qsmooth.kernels import topology as kernels

        marked = np.zeros(self.n_vertices, np.bool_)
        if self.regions is not None:
            region = np.repeat(self.regions, self.cell_sizes)
            twins = self.given_twins
            sides = (twins >= 0) & (region != region[twins])
            marked |= kernels.mark_edge_ends(
                self.n_vertices, self.cell_offsets, self.given_vertices, sides
            )
        marked[self.lines.ravel()] = True
        return read_only(marked)

    def __getstate__(self) -> dict[str, object]:
        """Leave out what sweeps are made of; it is made again when asked for."""
        return {**self.__dict__, "_schedules": {}, "_blocks": {}, "_along_curve": None}

    def __setstate__(self, state: dict[str, object]) -> None:
        """Restore; arrays come back writable, which is another type for kernels."""
        for name, value in state.items():
            if name == "_given_star_corners":  # it never was read-only
                self.__dict__[name] = value
            else:
                self.__dict__[name] = all_read_only(value)

    def with_lines(self, lines: IndexArray) -> Topology:
        """Share everything but the line cells, (k, 2)."""
        topology = self._copy()
        topology.__dict__.pop("is_interface", None)
        topology.lines = read_only(np.array(lines, np.int64).reshape(-1, 2))
        return topology

    def with_fixed(self, fixed: BoolArray) -> Topology:
        """Share everything but which vertices the caller fixes, (n_vertices,)."""
        topology = self._copy()
        topology._fix(fixed)
        return topology

    def _fix(self, fixed: BoolArray) -> None:
        self.given_fixed = read_only(fixed)
        self.is_fixed = read_only(self.is_boundary | ~self.used | fixed)

    def _copy(self) -> Topology:
        topology = object.__new__(Topology)
        topology.__dict__.update(self.__dict__)
        topology._schedules, topology._blocks, topology._along_curve = {}, {}, None
        return topology

    def along_curve(self, xy: FloatArray) -> Topology:
        """Give the same cells with vertices, and cells, along a curve that fills the plane.

        It is made once: where the vertices have moved meanwhile, they are not far off.

        Parameters
        ----------
        xy : (n_vertices, 2)
            Coordinates, in the order of this topology.
        """
        if self._along_curve is None:
            self._along_curve = self.renumbered(along_curve(xy))
        return self._along_curve

    def renumbered(self, vertex_ids: IndexArray) -> Topology:
        """Give the same cells with vertices in this order, (n_vertices,), and cells in a like one.

        `vertex_ids` and `cell_ids` are the caller's numbers there. Stars and rings keep the order
        of these, so that sums over them have the same bits. Regions and lines stay behind: what
        they mark as interface is known.
        """
        from qsmooth.kernels import numbering
        from qsmooth.kernels import topology as kernels

        cell_ids, offsets, vertices = numbering.renumbered_cells(vertex_ids, *self.cells)
        star_offsets, star_cells, star_corners = kernels.stars(self.n_vertices, offsets, vertices)
        numbering.sort_rows(star_offsets, star_cells, star_corners, cell_ids)
        inner = object.__new__(Topology)
        inner.__dict__.update(
            n_vertices=self.n_vertices,
            n_cells=self.n_cells,
            n_quads=self.n_quads,
            regions=None,
            lines=self.lines[:0],
            vertex_ids=read_only(vertex_ids),
            cell_ids=read_only(cell_ids),
            cell_offsets=read_only(offsets),
            cell_vertices=read_only(vertices),
            star_offsets=read_only(star_offsets),
            star_cells=read_only(star_cells),
            turned=read_only(np.zeros(self.n_cells, np.bool_)),
            used=read_only(self.used[vertex_ids]),
            is_boundary=read_only(self.is_boundary[vertex_ids]),
            given_fixed=read_only(self.given_fixed[vertex_ids]),
            is_fixed=read_only(self.is_fixed[vertex_ids]),
            is_interface=read_only(self.is_interface[vertex_ids]),
            _given_star_corners=star_corners,
            is_renumbered=True,
            _given_twins=None,
            _schedules={},
            _blocks={},
            _along_curve=None,
        )
        inner.given_vertices = inner.cell_vertices
        return inner

    def only_cells(self, chosen: BoolArray) -> Topology:
        """Give some of the cells, (n_cells,), with all vertices: to be measured, no more."""
        part = object.__new__(Topology)
        sizes = self.cell_sizes[chosen]
        part.__dict__.update(
            n_vertices=self.n_vertices,
            n_cells=int(sizes.size),
            n_quads=int((sizes == 4).sum()),
            cell_offsets=read_only(np.concatenate([[0], np.cumsum(sizes)])),
            cell_vertices=read_only(self.cell_vertices[np.repeat(chosen, self.cell_sizes)]),
        )
        return part

    def run_of_cells(self, first: int, stop: int) -> Topology:
        """Give the cells from one number up to another, with all vertices: to be measured."""
        offsets, vertices = self.cells
        part = object.__new__(Topology)
        part.__dict__.update(
            n_vertices=self.n_vertices,
            n_cells=stop - first,
            n_quads=int(offsets[stop] - offsets[first]) - 3 * (stop - first),
            cell_offsets=read_only(offsets[first : stop + 1] - offsets[first]),
            cell_vertices=vertices[offsets[first] : offsets[stop]],
        )
        return part

    def movable(self, keep_interfaces: bool = True) -> BoolArray:
        """Mark the vertices that may move, (n_vertices,)."""
        movable = ~self.is_fixed
        if keep_interfaces:
            movable &= ~self.is_interface
        return movable

    def schedule(self, keep_interfaces: bool = True, only: BoolArray | None = None) -> Stars:
        """Return the movable vertices in `only`, in the order of a sweep, and their stars."""
        if only is not None:
            return self._make_schedule(self.movable(keep_interfaces) & only)
        if keep_interfaces not in self._schedules:
            self._schedules[keep_interfaces] = self._make_schedule(self.movable(keep_interfaces))
        return self._schedules[keep_interfaces]

    def schedule_of(self, movable: BoolArray) -> Stars:
        """Return the vertices marked as movable, (n_vertices,), in the order of a sweep.

        Unlike `schedule` it asks no further: also vertices that usually stay may be among them.
        """
        for keep_interfaces in (True, False):
            if np.array_equal(movable, self.movable(keep_interfaces)):
                return self.schedule(keep_interfaces)
        return self._make_schedule(movable)

    def blocks(self, stars: Stars) -> Blocks:
        """Cut a schedule into blocks of lanes, once for those without a selection."""
        from qsmooth.kernels.blocks import build_blocks

        for keep_interfaces, schedule in self._schedules.items():
            if schedule is stars:
                if keep_interfaces not in self._blocks:
                    self._blocks[keep_interfaces] = build_blocks(stars)
                return self._blocks[keep_interfaces]
        made: Blocks = build_blocks(stars)
        return made

    def _make_schedule(self, movable: BoolArray) -> Stars:
        stars = self.star_offsets, self.star_cells
        return make_schedule(movable, self.vertex_ids, self.cells, stars, self.star_corners)

    def _cell_of(self, corner: int) -> int:
        return int(np.searchsorted(self.cell_offsets, corner, side="right")) - 1


def along_curve(xy: FloatArray) -> IndexArray:
    """List places, (n, 2), along a curve that fills the plane."""
    from qsmooth.kernels import numbering

    columns = xy.T  # one after the other: over both at once NumPy takes ten times as long
    low = np.array([column.min() for column in columns])
    size = np.array([column.max() for column in columns]) - low
    scale = np.where(size > 0.0, (2**numbering.LEVELS - 1) / np.where(size > 0.0, size, 1.0), 0.0)
    order: IndexArray = numbering.curve_order(xy, low, scale)
    return order


def _first(marked: BoolArray, ids: IndexArray) -> int:
    places = np.flatnonzero(marked)
    return int(places[np.argmin(ids[places])]) if places.size else 0


def _offsets_of(blocks: Sequence[IndexArray]) -> IndexArray:
    """Row starts of the map from a cell to its corners."""
    offsets = np.zeros(1 + sum(len(block) for block in blocks), np.int64)
    first = start = 0
    for block in blocks:
        last, stop = first + len(block), start + block.size
        offsets[first : last + 1] = np.arange(start, stop + 1, block.shape[1])
        first, start = last, stop
    return offsets
