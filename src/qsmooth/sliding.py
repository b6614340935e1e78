"""Vertices that slide along lines: set up for one run, swept, and reported."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.constraints import Freedom
from qsmooth.kernels.rails import FREE as ANYWHERE
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import Stars
from qsmooth.mesh import Mesh
from qsmooth.metrics import Limits, quality
from qsmooth.metrics.bounds import angle_limits
from qsmooth.numbering import Inside
from qsmooth.outcome import Sliding
from qsmooth.outline import Chains, boundary_sides, spread, swing
from qsmooth.schedule import make_schedule
from qsmooth.targets import ideal

if TYPE_CHECKING:
    from qsmooth.kernels.angle_bounds import Swings
    from qsmooth.kernels.blocks import Blocks, Rows
    from qsmooth.kernels.mapped_sweep import Maps
    from qsmooth.kernels.newton_sweep import Wall
    from qsmooth.kernels.outline import Outline, Sides

# Multiple of the Newton step that is tried first.
RELAXATION = 1.7
# More than the rounding of sines: what is held is not undercut by it.
SLACK = 1e-14
# Cosines and a sine that hold nothing.
NO_COSINE, NO_SINE = 2.0, -2.0


@dataclass(frozen=True)
class Asked:
    """What is asked of the cells around sliding vertices.

    Attributes
    ----------
    rows, maps
        As `slide_sweep` takes them.
    """

    rows: Rows
    maps: Maps


class Slider:
    """The vertices that slide, and where they are.

    Colours, blocks and the order of the sweep are those of the caller's numbering: whether an edge
    would meet another may hang on which of two vertices goes first.

    Parameters
    ----------
    mesh
        What is swept, in the caller's order.
    inside
        Its order in memory.
    chains
        What slides, and along which lines; of the caller's vertices.
    tolerance
        How far an edge may be from its line, as a share of the edge.
    rails
        Where vertices may be besides, in the order inside.

    Attributes
    ----------
    vertices : (n_sliding,)
        Those that slide, in the order of the blocks.
    """

    def __init__(
        self,
        mesh: Mesh,
        inside: Inside,
        chains: Chains,
        tolerance: float,
        rails: Rails = ANYWHERE,
    ) -> None:
        self._mesh, self._inside, self._chains = mesh, inside, chains
        self.topology = inside.topology
        self._tolerance, self._rails = tolerance, rails
        # Coordinates for which it is known where the vertices are; shared by all of `only`.
        self._known: list[FloatArray] = []

    @cached_property
    def mask(self) -> BoolArray:
        """Mark the vertices that slide, in the order inside, (n_vertices,)."""
        return self._chains.sliding(self.topology.n_vertices)[self.topology.vertex_ids]

    @cached_property
    def blocks(self) -> Blocks:
        """The vertices in blocks of lanes."""
        from qsmooth.kernels.blocks import build_blocks

        outer, inner = self._mesh.topology, self.topology
        slides = self._chains.sliding(outer.n_vertices)
        stars: Stars = make_schedule(
            slides, outer.vertex_ids, outer.cells, (outer.star_offsets, outer.star_cells),
            outer.star_corners,
        )  # fmt: skip
        blocks: Blocks = build_blocks(stars)._replace(rails=self._rails)
        if not inner.is_renumbered:
            return blocks
        at, cell_at = _places(inner.vertex_ids), _places(inner.cell_ids)
        return blocks._replace(
            vertices=at[blocks.vertices], stars=at[blocks.stars], cells=cell_at[blocks.cells]
        )

    def only(self, chosen: BoolArray) -> Slider:
        """Give the same with only these, (n_vertices,) in the order inside, free to slide."""
        # Copied with what is set up, the places of the vertices too: these are the same for both.
        mask, outline, _ = self.mask & chosen, self._outline, self._row_corners
        other = copy.copy(self)
        other.__dict__["mask"] = mask
        other.__dict__["_outline"] = outline._replace(free=chosen[self.vertices])
        return other

    @property
    def vertices(self) -> IndexArray:
        """Those that slide, in the order of the blocks, (n_sliding,)."""
        return self.blocks.vertices.astype(np.int64)

    @cached_property
    def _outline(self) -> Outline:
        from qsmooth.kernels.outline import Outline

        chains = self._chains
        vertices = chains.vertices
        if self.topology.is_renumbered:
            vertices = _places(self.topology.vertex_ids).astype(np.int64)[vertices]
        entry = np.full(self.topology.n_vertices, -1)
        entry[vertices[chains.inner]] = chains.inner
        return Outline(
            nodes=chains.nodes.copy(),
            vertices=vertices.copy(),
            segments=chains.segments.copy(),
            fractions=chains.fractions.copy(),
            off=chains.off.copy(),
            sides=self._entry_sides(vertices),
            entries=entry[self.vertices],
            free=np.ones(self.vertices.size, np.bool_),
            tolerance=self._tolerance,
        )

    @cached_property
    def _sides(self) -> Sides:
        """The sides of the boundary, near ones near each other."""
        from qsmooth.kernels.numbering import LEVELS, curve_order
        from qsmooth.kernels.outline import Sides

        # By the caller's numbers, so that equal places have the same order.
        ends = boundary_sides(self._mesh.topology)
        middle = 0.5 * (self._mesh.xy[ends[:, 0]] + self._mesh.xy[ends[:, 1]])
        low, size = middle.min(axis=0), np.ptp(middle, axis=0)
        scale = np.divide(2**LEVELS - 1, size, where=size > 0.0, out=np.zeros(2))
        ends = ends[curve_order(middle, low, scale)]
        if self.topology.is_renumbered:
            ends = _places(self.topology.vertex_ids).astype(np.int64)[ends]
        leaves = 1 << max(0, len(ends) - 1).bit_length()
        return Sides(np.ascontiguousarray(ends), np.empty((2 * leaves, 4)))

    def _entry_sides(self, vertices: IndexArray) -> IndexArray:
        """Side of the boundary from each entry to the next."""
        ends = np.sort(self._sides.ends, axis=1)
        known = {(a, b): i for i, (a, b) in enumerate(ends.tolist())}
        out = np.full(vertices.size, -1)
        offsets = self._chains.offsets.tolist()
        listed = vertices.tolist()
        for chain in np.flatnonzero(self._chains.on_boundary).tolist():
            for e in range(offsets[chain], offsets[chain + 1] - 1):
                a, b = listed[e], listed[e + 1]
                out[e] = known[(a, b) if a < b else (b, a)]
        return out

    @cached_property
    def _row_corners(self) -> IndexArray:
        from qsmooth.kernels.blocks import row_corners

        found: IndexArray = row_corners(self.blocks, *self.topology.cells)
        return found

    def ask(
        self,
        corners: FloatArray,
        area: FloatArray,
        size_weight: FloatArray,
        slim: FloatArray,
        weight: FloatArray,
        maps: FloatArray | None = None,
    ) -> Asked:
        """Put together what is asked of cells, as `blocks.make_rows` takes it; and their maps."""
        from qsmooth.kernels.blocks import SHAPES, SIZES, WALLS, make_rows
        from qsmooth.kernels.mapped_sweep import Maps

        every = SHAPES | SIZES | WALLS
        asked = self._row_corners, corners, area, size_weight, slim, weight, every
        rows = make_rows(self.blocks, *asked)
        n_rows = self.blocks.cells.size
        identity = np.repeat([[1.0], [0.0], [1.0]], n_rows, axis=1)
        own = identity if maps is None else maps[self.blocks.cells].T.copy()
        return Asked(rows, Maps(own[0], own[1], own[2]))

    def ask_ideal(self) -> Asked:
        """Ask for squares and equilateral triangles."""
        targets, n = ideal(self.topology), self.topology.n_cells
        none = np.zeros(n)
        return self.ask(targets.corners, targets.area, none, none, np.ones(n))

    def near(self, asked: Asked, near: FloatArray) -> Asked:
        """Let the walls on badness stand elsewhere, (n_cells,)."""
        return Asked(asked.rows._replace(near=near[self.blocks.cells]), asked.maps)

    def sweep(
        self,
        xy: FloatArray,
        wall: Wall,
        held: FloatArray,
        asked: Asked,
        lengths: FloatArray,
        selected: Blocks | None = None,
    ) -> None:
        """Move each vertex once, in place; what each moved is written to `lengths`.

        Only blocks that are `selected` are swept, where these are given.
        """
        from qsmooth.kernels.slide_sweep import slide_sweep

        self._refresh(xy)
        slide_sweep(
            xy, self.blocks if selected is None else selected, self._outline, self._sides,
            RELAXATION, wall, held, asked.rows, asked.maps, lengths,
        )  # fmt: skip
        self._note(xy)

    def untangle(
        self, xy: FloatArray, sizes: FloatArray, epsilon: float, lengths: FloatArray
    ) -> None:
        """Move each vertex once downhill on the regularised energy, as `Lanes.untangle`."""
        from qsmooth.kernels.slide_sweep import slide_untangling

        self._refresh(xy)
        slide_untangling(
            xy, self.blocks, self._outline, self._sides, RELAXATION, sizes, epsilon, lengths
        )
        self._note(xy)

    def meets(self, xy: FloatArray) -> bool:
        """Whether two sides of the boundary meet that do not share a vertex."""
        from qsmooth.kernels.outline import any_meet

        self._refresh(xy)
        return bool(any_meet(xy, self._sides))

    def _refresh(self, xy: FloatArray) -> None:
        """Find out where the vertices are, if others have moved them."""
        from qsmooth.kernels.outline import fit_boxes, locate

        now = xy[self._outline.vertices]
        if self._known and np.array_equal(self._known[0], now):
            return
        if self._known or not np.array_equal(self._inside.at_vertices(self._mesh.xy), xy):
            locate(xy, self._outline, self._chains.ends)
        fit_boxes(xy, self._sides)
        self._known[:] = [now]

    def _note(self, xy: FloatArray) -> None:
        """It is known where the vertices are at these coordinates."""
        self._known[:] = [xy[self._outline.vertices]]

    def swings(self, xy: FloatArray) -> Swings:
        """Say how far the edges of vertices that slide along the boundary can turn."""
        from qsmooth.kernels.angle_bounds import HALF_TURN, Swings

        n, offsets, chains = self.topology.n_vertices, self._chains.offsets, self._chains
        turn, after, before = np.full(n, -1.0), np.full(n, -1.0), np.full(n, -1.0)
        vertices = self._outline.vertices
        for chain in np.flatnonzero(chains.on_boundary).tolist():
            first, last = offsets[chain], offsets[chain + 1] - 1
            own = vertices[first : last + 1]
            if chains.off[first : last + 1].any():
                continue  # edges may stay beside the line
            nodes = chains.nodes[chains.segments[first] : chains.segments[last] + 2]
            most = spread(nodes)
            turn[own[1:-1]] = most if most < HALF_TURN else -1.0
            after[own[1]] = swing(nodes, xy[own[1]], self._tolerance)
            before[own[-2]] = swing(nodes[::-1], xy[own[-2]], self._tolerance)
        return Swings(turn, after, before)

    def shares(self, xy: FloatArray, lengths: FloatArray, shares: FloatArray) -> None:
        """Take each vertex's move, (n_sliding,), as a share of its shortest edge."""
        from qsmooth.kernels.untangle_sweep import shortest_edges

        shortest = np.empty(lengths.size)
        shortest_edges(xy, *self.topology.rings, self.blocks.vertices, shortest)
        shares[:] = 0.0
        np.divide(lengths, shortest, out=shares, where=lengths > 0.0)

    def others(self, free: Freedom) -> BoolArray:
        """Mark the vertices that may move and do not slide, in the order inside, (n_vertices,)."""
        return free.movable & ~self.mask

    def report(self, before: FloatArray, xy: FloatArray) -> Sliding:
        """Sum up where the vertices have come to, from `before`; both in the order inside."""
        from qsmooth.kernels.outline import deviations

        self._refresh(xy)
        outline, chains = self._outline, self._chains
        far = np.empty((outline.vertices.size, 2))
        deviations(xy, outline, far)
        far[chains.offsets[1:] - 1] = 0.0
        moved = (xy != before).any(axis=1)[outline.vertices[chains.inner]]
        on_boundary = np.repeat(chains.on_boundary, np.diff(chains.offsets))[chains.inner]
        return Sliding(
            boundary_vertices=int(self.topology.is_boundary.sum()),
            may_slide=int(on_boundary.sum()),
            slid=int((moved & on_boundary).sum()),
            interface_vertices=int((~on_boundary).sum()),
            interface_slid=int((moved & ~on_boundary).sum()),
            beside=int(outline.off[chains.inner].sum()),
            deviation=float(far[:, 0].max(initial=0.0)),
            deviation_share=float(far[:, 1].max(initial=0.0)),
            on_curve=chains.on_curve,
        )


class Slides:
    """Sweeps over sliding vertices between those of a method that knows nothing of them.

    They go downhill on the shape energy towards squares and equilateral triangles.

    Parameters
    ----------
    slider
        What slides.
    worst
        Scaled Jacobian below which no cell may come; NaN for none, but all stay valid.
    """

    def __init__(self, slider: Slider, worst: float) -> None:
        self.slider, self._asked = slider, slider.ask_ideal()
        self._held = np.tile([NO_COSINE, -NO_COSINE, NO_SINE], (slider.topology.n_vertices, 1))
        self.hold(worst)

    def hold(self, worst: float) -> None:
        """Let no cell come below another scaled Jacobian."""
        self._held[:, 2] = worst * (1.0 + SLACK) if worst > 0.0 else NO_SINE

    def sweep(self, xy: FloatArray, lengths: FloatArray, selected: Blocks | None = None) -> None:
        """Move each vertex once, in place; its move is written to `lengths`, (n_sliding,).

        Only blocks that are `selected` are swept, where these are given.
        """
        from qsmooth.kernels.newton_sweep import Wall

        wall = Wall(1.0, np.inf, 1)
        self.slider.sweep(xy, wall, self._held, self._asked, lengths, selected)


def slider_of(free: Freedom, mesh: Mesh, inside: Inside) -> Slider | None:
    """Set up what slides; None where nothing does.

    Parameters
    ----------
    free
        What may move, in the order inside.
    mesh, inside
        What is swept, and its order in memory.
    """
    if free.chains is None:
        return None
    return Slider(mesh, inside, free.chains, free.tolerance, free.rails())


def slid(freedom: Freedom, before: Mesh, after: Mesh) -> Sliding | None:
    """Say what became of the vertices that could slide; None where none could."""
    slider = slider_of(freedom, before, Inside(before, kept=True))
    return None if slider is None else slider.report(before.xy.copy(), after.xy.copy())


def limits_of(freedom: Freedom, before: Mesh, after: Mesh) -> Limits:
    """Bound the angles that what may move of `before` can bring about, as `angle_limits` does it.

    Edges between vertices that slide along the boundary turn as far as the boundary does. What
    else holds a vertex to a line, or near to where it was, is left out: the bound holds without.
    """
    slider = slider_of(freedom, before, Inside(before, kept=True))
    swings = None if slider is None else slider.swings(after.xy)
    movable, kept = freedom.movable, freedom.kept
    return angle_limits(after.topology, after.xy, movable, quality(after), kept, swings)


def _places(ids: IndexArray) -> TableArray:
    """Where each id is in a permutation."""
    places = np.empty(ids.size, np.uint32)
    places[ids] = np.arange(ids.size, dtype=np.uint32)
    return places
