"""The movable vertices of a mesh in blocks of lanes, and the optimiser's sweeps over them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.engine import Engine
from qsmooth.kernels.rails import FREE as ANYWHERE
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import Moves, Rings, Stars
from qsmooth.metrics import Quality
from qsmooth.optimizer.caps import ALWAYS, FREE
from qsmooth.optimizer.extrapolation import Extrapolation
from qsmooth.optimizer.measuring import Measured
from qsmooth.optimizer.progress import ROUND, Progress
from qsmooth.parts import Glance, moved_by
from qsmooth.sliding import RELAXATION, Demand, Slider
from qsmooth.targets import Targets, beside_others, is_ideal
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from qsmooth.kernels.blocks import Blocks, Rows
    from qsmooth.kernels.newton_sweep import Wall

# The wall on a cell's shape is 1 high at this multiple of its shape energy, or at this energy.
SLIMMER, LEAST_SLIM = 1.2, 1.5
# No wall on shapes stands nearer than this energy.
LEAST_CAP = 1.1
# A cell with a larger shape energy than this, or one that is not valid, counts as one with this.
FLAT = 1e6
# While the worst cells are seen to, sizes count this much more in layers: else their heights drift.
LAYER_WEIGHT = 3.0
# And this much where layers border on other cells, whose worst angles would be paid with the height
# of the layer: at the trailing edge of an airfoil 1.9 times of it, and now 1.3. In triangles of
# layers too: their smallest angle is their height over their length.
BORDER_WEIGHT = 100.0
# Stands for the corners of the rows where these ask for ideal shapes.
NO_CORNERS = np.empty(0, np.int64)
# Where an extrapolation is forbidden vertices are put back so often before it is given up.
PUT_BACK = 12


class Lanes(Measured):
    """Sweeps over the movable vertices, and measures that only what can move counts in.

    All but untangling wants to know first what cells are meant to be (`aim_at`).

    Parameters
    ----------
    topology, stars
        Of the mesh, and of the vertices that may move.
    engine
        Who runs the sweeps.
    rails
        Where the vertices may be.
    slider
        The vertices that slide; None where none does.
    """

    def __init__(
        self,
        topology: Topology,
        stars: Stars,
        engine: Engine,
        rails: Rails = ANYWHERE,
        slider: Slider | None = None,
    ) -> None:
        movable = np.zeros(topology.n_vertices, np.bool_)
        movable[stars.vertices] = True
        # What sliding vertices alone change is not judged: where the outline is bent its angles are
        # as good as given, and would be the worst of all. Unless there is nothing else.
        judged = movable
        if slider is not None:
            movable = movable | slider.mask
            if not stars.vertices.size:
                judged = movable
        super().__init__(topology, movable, judged, engine.part(topology, stars))
        self.stars, self._engine, self.rails = stars, engine, rails
        self.n_colours = stars.colour_offsets.size - 1
        self._slider, n_free = slider, self._part.stars.vertices.size
        n_slides = 0 if slider is None else slider.vertices.size
        self._moves = Moves(np.zeros(n_free), np.zeros(n_free))
        self._slides = Moves(np.zeros(n_slides), np.zeros(n_slides))
        self._shortest = np.empty(n_free)

    @property
    def vertices(self) -> IndexArray:
        """Those that may move; those that slide come last, (n_movable,)."""
        listed = self.stars.vertices.astype(np.int64)
        if self._slider is None:
            return listed
        return np.concatenate([listed, np.flatnonzero(self._slider.mask)])

    @cached_property
    def _blocks(self) -> Blocks:
        """The vertices that this process sweeps in blocks of lanes."""
        return self.topology.blocks(self._part.stars)._replace(rails=self.rails)

    @cached_property
    def _in_turn(self) -> TableArray:
        """All vertices in the order of blocks, whoever sweeps them, (n_free,)."""
        if self._part.stars is self.stars:
            return self._blocks.vertices
        return self.topology.blocks(self.stars).vertices

    @cached_property
    def _rings(self) -> Rings:
        """Edge neighbours."""
        return Rings(*self.topology.rings)

    @cached_property
    def _ahead(self) -> Extrapolation:
        """What sweeps towards the present targets lead to."""
        vertices = self._blocks.vertices
        return Extrapolation(vertices, ROUND, self._engine, self.rails, self._part)

    @cached_property
    def _rows(self) -> Rows:
        """What is asked of the cells around each vertex; for `rows_for`."""
        from qsmooth.kernels.blocks import SHAPES, SIZES, WALLS, make_rows

        size_weight, slim, weight = self._asked
        rows: Rows = make_rows(
            self._blocks,
            NO_CORNERS if self._is_ideal else self._row_corners,
            self.targets.corners,
            self.targets.area,
            size_weight,
            slim,
            weight,
            0 if self.targets.maps is None else SHAPES | SIZES | WALLS,
        )
        return rows

    @cached_property
    def _asked_of_slides(self) -> Demand:
        """What is asked of the cells around each vertex that slides."""
        size_weight, slim, weight = self._asked
        targets, slider = self.targets, cast("Slider", self._slider)
        return slider.ask(targets.corners, targets.area, size_weight, slim, weight, targets.maps)

    def rows_for(self, wall: Wall) -> Rows:
        """What is asked of the cells around each vertex, with all that sweeps with a wall read."""
        rows, n_rows = self._rows, self._blocks.cells.size
        if math.isfinite(wall.threshold):
            if not rows.slim.size:
                rows = rows._replace(slim=np.zeros(n_rows))
            if not rows.near.size:
                rows = rows._replace(near=np.ones(n_rows))
            self._rows = rows
        return rows

    @cached_property
    def _is_ideal(self) -> bool:
        """Whether the present targets are squares and equilateral triangles."""
        own = self.targets
        return own.kind == "ideal" and is_ideal(own.corners, self.topology)

    @property
    def slides(self) -> bool:
        """Whether some of the vertices slide."""
        return self._slider is not None

    @cached_property
    def _row_corners(self) -> IndexArray:
        """Corner of the vertex in the cell of each row of the blocks."""
        from qsmooth.kernels.blocks import row_corners

        found: IndexArray = row_corners(self._blocks, *self.topology.cells)
        return found

    def newton(
        self, xy: FloatArray, wall: Wall, progress: Progress, *, extrapolate: bool = False
    ) -> None:
        """Sweep a round downhill on the mean shape and the wall; then, perhaps, go where it leads.

        Not where sizes count: there an extrapolation takes the heights of layers along.
        """
        sweep = self.sweep(xy, wall, self.caps.swept, self._moves.lengths)
        n_sweeps, part = progress.next_round(), self._part
        may = extrapolate and n_sweeps == ROUND and not self.sized
        ahead = self._ahead if may and self._ahead.due() else None
        if ahead is not None:
            ahead.start(xy, self.shortest_edges(xy))
        for _ in range(n_sweeps):
            part.sweep(sweep, part.n_colours, xy)
            self._slide(xy, wall)
            progress.sweeps += 1
            if progress.cut_short():
                part.complete(xy)
                return
            if ahead is not None:
                ahead.note(xy)
        part.complete(xy)
        if ahead is not None:
            ahead.judge(self._go(xy, ahead.extrapolated(xy), wall))

    def _slide(self, xy: FloatArray, wall: Wall) -> None:
        """Sweep over the vertices that slide."""
        if self._slider is not None:
            self._part.complete(xy)
            self.slide(xy, wall, self.caps.swept, self._slider.blocks)

    def slide(self, xy: FloatArray, wall: Wall, held: FloatArray, selected: Blocks) -> FloatArray:
        """Sweep over those in selected blocks; gives what each has moved, (n_sliding,)."""
        asked, lengths = self._asked_of_slides, self._slides.lengths
        cast("Slider", self._slider).sweep(xy, wall, held, asked, lengths, selected)
        return lengths

    def _go(self, xy: FloatArray, trial: FloatArray | None, wall: Wall) -> bool:
        """Go to where the sweeps lead if that is allowed and better; say whether."""
        if trial is None:
            return False
        look, height = self.look(xy), self._height(xy, wall)
        if self._put_back(xy, trial) and self._height(trial, wall) < height:
            xy[:] = trial
            return True
        self._look = look  # of the coordinates that stay, which are asked for next
        return False

    def _put_back(self, xy: FloatArray, trial: FloatArray) -> bool:
        """Put back the vertices of forbidden cells, and a ring; say whether that was enough."""
        from qsmooth.kernels.tangles import grow

        topology = self.topology
        for _ in range(PUT_BACK):
            bad = self.caps.forbidden(trial, self.look(trial).quality)
            if not bad.any():
                return True
            marked = np.zeros(topology.n_vertices, np.bool_)
            marked[topology.cell_vertices[np.repeat(bad, topology.cell_sizes)]] = True
            grow(marked, 1, *self._rings)
            trial[marked] = xy[marked]
        return False

    def _height(self, xy: FloatArray, wall: Wall) -> float:
        """Sum up the energy that sweeps bring down, the same in any order; lost cells have none."""
        from qsmooth.kernels.cell_energy import cell_heights

        own, run = self.look(xy).own, self._part.run_of(self.topology)
        slim, weight = (asked[run.cells] for asked in self._asked[1:])
        n_terms = np.where(run.topology.cell_sizes == 3, 1.0, 4.0)
        lost = self.caps.lost[run.cells]
        weights = np.where(lost, -1.0, wall.mean_weight * n_terms * weight)
        height = np.empty(weights.size)
        scale = self._near[run.cells] / wall.threshold
        assert self._is_near_whole, "another rank's walls count, too"
        cell_heights(
            own.energy, own.worst_shape, own.badness, weights, slim, scale, wall.squarings, height
        )
        return self._part.exact_sum(height)

    def shortest_edges(self, xy: FloatArray) -> FloatArray:
        """Measure the shortest edge of each movable vertex, (n_movable,), in block order."""
        from qsmooth.kernels.untangle_sweep import shortest_edges

        shortest_edges(xy, *self._rings, self._blocks.vertices, self._shortest)
        return self._shortest

    @property
    def tables(self) -> tuple[Blocks, IndexArray]:
        """The blocks, and what each of them asks for (`Rows.asks`)."""
        return self._blocks, self._rows.asks

    @cached_property
    def _row_maps(self) -> Any:
        """The maps of the cells around each vertex."""
        from qsmooth.kernels.mapped_sweep import Maps

        return Maps(*self.maps[self._blocks.cells].T.copy())

    def sweep(
        self,
        xy: FloatArray,
        wall: Wall,
        held: FloatArray,
        lengths: FloatArray,
        selected: tuple[Blocks, IndexArray] | None = None,
    ) -> Callable[[tuple[int, int]], None]:
        """Give the sweep over some colours that fits the targets.

        Only blocks that are `selected` are swept, where these and `Rows.asks` of them are given.
        """
        blocks, rows = self._blocks, self.rows_for(wall)
        if selected is not None:
            blocks, rows = selected[0], rows._replace(asks=selected[1])
        if self.targets.maps is None:
            from qsmooth.kernels.newton_sweep import newton_sweep

            return lambda colours: newton_sweep(
                xy, blocks, colours, RELAXATION, wall, held, rows, lengths
            )
        from qsmooth.kernels.mapped_sweep import mapped_sweep

        maps = self._row_maps
        return lambda colours: mapped_sweep(
            xy, blocks, colours, RELAXATION, wall, held, rows, maps, lengths
        )

    def try_colour(
        self, xy: FloatArray, colour: int, wall: Wall, held: FloatArray
    ) -> tuple[IndexArray, BoolArray]:
        """Move the vertices of one colour once, downhill within what is held, (n_vertices, 6).

        Returns
        -------
        vertices, moved
            Those of this colour, and which of them moved.
        """
        lengths, of_vertices = np.zeros(self._blocks.vertices.size), np.empty(len(xy))
        self._part.sweep_one(self.sweep(xy, wall, held, lengths), colour)
        of_vertices[self._blocks.vertices] = lengths
        self._part.complete(xy, of_vertices, colour=colour)
        vertices = self.stars.vertices[slice(*self.stars.colour_offsets[colour : colour + 2])]
        return vertices.astype(np.int64), of_vertices[vertices] > 0.0

    def kept_back(self, xy: FloatArray) -> float:
        """Fraction of the energy that a sweep would gain if nothing but validity were held."""
        from qsmooth.kernels.newton_sweep import Wall

        trial, held = xy.copy(), np.tile(FREE[:ALWAYS], (self.topology.n_vertices, 1))
        lengths, wall = np.empty_like(self._moves.lengths), Wall(1.0, np.inf, 1)
        self._part.sweep(self.sweep(trial, wall, held, lengths), self._part.n_colours, trial)
        self._part.complete(trial)
        before = self._part.exact_sum(self.own_energy(xy)[1])
        return 1.0 - self._part.exact_sum(self.own_energy(trial)[1]) / before

    def aim_at(self, targets: Targets) -> None:
        """Ask each cell for this shape and size from now on; takes walls on shape down."""
        self.targets, self._look = targets, None
        for found in ("_ahead", "_row_maps", "_is_ideal"):
            self.__dict__.pop(found, None)
        self.maps = np.empty((0, 3)) if targets.maps is None else targets.maps
        counts = targets.size_weight > 0.0
        inv_area = np.divide(1.0, targets.area, out=np.zeros(counts.size), where=counts)
        self.sizes = np.stack([inv_area, targets.size_weight], axis=1)
        self._ask(targets.size_weight, np.zeros(counts.size))

    def wall_off(self, xy: FloatArray, *, looser: float = 1.0, most: float = math.inf) -> None:
        """Put a wall on each cell's shape.

        Parameters
        ----------
        xy
            A little beyond the shapes at these coordinates, (n, 2), stand the walls;
        looser
            or farther, but for layers.
        most
            None is farther than this multiple of the worst shape's energy.
        """
        shape = self.worst_shape(xy)
        cap = np.maximum(SLIMMER * shape, LEAST_SLIM)
        cap[~self.targets.is_layer] *= looser
        slim = 1.0 / np.minimum(cap, max(LEAST_CAP, most * shape.max()))
        topology, is_layer = self.topology, self.targets.is_layer
        at_stake = beside_others(topology, is_layer) | (topology.cell_sizes == 3)
        weight = np.where(at_stake, BORDER_WEIGHT, LAYER_WEIGHT)
        weight = np.where(is_layer, weight, 1.0) * self.targets.size_weight
        self._ask(weight, slim)

    def measure_near(self, xy: FloatArray, rings: int) -> None:
        """Let each cell's wall on badness stand by the worst of so many rings around it."""
        from qsmooth.kernels.cell_energy import worst_around

        badness = self.own_energy(xy)[0]
        worst = np.maximum(np.where(np.isfinite(badness), badness, 1.0), 1.0)
        worst = self._part.of_cells(worst, self.topology)
        chosen, topology = None, self.topology
        if self._slider is None:
            chosen, topology = self._part.near(topology, rings)
        worst = worst if chosen is None else worst[chosen]
        worst = worst_around(worst, rings, *topology.cells, topology.n_vertices)
        self._near = np.ones(self.topology.n_cells)
        self._near[slice(None) if chosen is None else chosen] = 1.0 / worst
        self._is_near_whole = chosen is None
        self._rows = self._rows._replace(near=self._near[self._blocks.cells])
        if self._slider is not None:
            self._asked_of_slides = self._slider.near(self._asked_of_slides, self._near)

    def weigh_good(self, xy: FloatArray, power: int = 2) -> None:
        """Let each cell's shape energy f count by 1 / f² at these coordinates, or another power.

        With 1 / f² the energy falls as the mean of 1 / f, the mean shape, rises; else bad cells
        count for more. Walls on shapes stay where they are, those on badness stand alike.
        """
        size_weight, slim, _ = self._asked
        self._ask(size_weight, slim, np.minimum(self.worst_shape(xy), FLAT) ** -power)

    def _ask(
        self, size_weight: FloatArray, slim: FloatArray, weight: FloatArray | None = None
    ) -> None:
        """Let this be asked of the cells around each vertex."""
        weight = np.ones(slim.size) if weight is None else weight
        self._asked, self._near = (size_weight, slim, weight), np.ones(slim.size)
        self._is_near_whole = True
        self.__dict__.pop("_rows", None)
        self.__dict__.pop("_asked_of_slides", None)

    def untangle(self, xy: FloatArray, sizes: FloatArray, epsilon: float) -> None:
        """Sweep once downhill on the regularised energy; sizes are squared lengths, (n,)."""
        from qsmooth.kernels.untangle_sweep import untangle_sweep

        lengths = self._moves.lengths
        self._part.sweep(
            lambda colours: untangle_sweep(
                xy, self._blocks, colours, RELAXATION, sizes, epsilon, lengths
            ),
            self._part.n_colours,
            xy,
        )
        self._part.complete(xy)
        if self._slider is not None:
            self._slider.untangle(xy, sizes, epsilon, self._slides.lengths)

    def mend_more(self, xy: FloatArray, closed: BoolArray, progress: Progress) -> None:
        """Move each vertex to where more of its cells are good; closed corners don't count."""
        from qsmooth.kernels.tangles import mend_more

        topology = self.topology
        stars = topology.star_offsets, topology.star_cells, topology.star_corners
        tables, listed = (*stars, *topology.cells), self._in_turn.astype(np.int64)
        lengths = np.zeros(listed.size)
        self._engine.run(lambda _: mend_more(xy, tables, closed, listed, self.rails, lengths), 1)
        self._note(listed, lengths)
        progress.sweeps += 1

    def place_doublets(self, xy: FloatArray, progress: Progress) -> None:
        """Put each vertex, all of them doublets, where the largest angle at it is least."""
        from qsmooth.kernels.impossible import place_doublets

        topology, rails = self.topology, self.rails
        stars = topology.star_offsets, topology.star_cells, topology.star_corners
        listed = self._in_turn.astype(np.int64)
        lengths = np.zeros(listed.size)
        self._engine.run(
            lambda _: place_doublets(xy, listed, *stars, *topology.cells, rails, lengths), 1
        )
        self._note(listed, lengths)
        progress.sweeps += 1

    def _note(self, listed: IndexArray, lengths: FloatArray) -> None:
        """Keep how far vertices, all of them on each rank, have moved."""
        of_vertices = np.zeros(self.topology.n_vertices)
        of_vertices[listed] = lengths
        self._moves.lengths[:] = of_vertices[self._blocks.vertices]

    def report(self, xy: FloatArray, now: Quality | Glance, progress: Progress) -> None:
        """Note the last sweep in the history."""
        lengths, shares = self._moves
        shares[:] = 0.0
        np.divide(lengths, self.shortest_edges(xy), out=shares, where=lengths > 0.0)
        if self._slider is not None:
            self._slider.shares(xy, *self._slides)
        progress.note(now, self._part.moved(*self._moves).together(moved_by(*self._slides)))
