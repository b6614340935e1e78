"""What is kept of a mesh from one step of a session to the next: what rests, and its figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.checks import LARGEST_COORDINATE
from qsmooth.engine import Engine
from qsmooth.kernels.stars import Stars
from qsmooth.metrics.impossible import doublet_vertices
from qsmooth.optimizer.caps import ALWAYS, FREE, Caps, with_slack
from qsmooth.parts import Alone, Part
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from qsmooth.kernels.blocks import Blocks

# Row starts, and what is in the rows.
Csr: TypeAlias = tuple[IndexArray, IndexArray]

# Vertices follow those that the host moves where these go on as in the step before: the square of
# the cosine between the two is so large; and by no more than this multiple of that step.
ALIKE, LARGEST_FACTOR = 0.25, 2.0


class Figures:
    """Figures of the cells at the present coordinates, measured again where these have changed.

    Parameters
    ----------
    topology, movable
        Of the mesh: which vertices may move, (n_vertices,).
    judged : (n_vertices,)
        Those of them whose corners say where walls stand; all if it is None.

    Attributes
    ----------
    dirty : (n_chunks,)
        Chunks of cells to measure again.
    n_invalid, scaled_jacobian
        Cells that are not valid, in exact arithmetic; the smallest of all cells.
    """

    def __init__(
        self, topology: Topology, movable: BoolArray, judged: BoolArray | None = None
    ) -> None:
        from qsmooth.kernels.blocks import LANES
        from qsmooth.kernels.kept_figures import N_FIGURES

        self._topology = topology
        self._counts = _can_change(topology, movable).astype(np.float64)
        self._values = np.ones((N_FIGURES, topology.n_cells))
        self.dirty = np.ones(-(-topology.n_cells // LANES), np.bool_)
        self._of_vertices, of_cells = Caps(topology, movable).regions
        # One of the two cells of a doublet is never valid: they set no cap.
        at_doublets = doublet_vertices(topology)[topology.cell_vertices]
        lost = np.logical_or.reduceat(at_doublets, topology.cell_offsets[:-1])
        self._of_cells = np.where(lost, -1, of_cells)
        # The last row is of what is in no region.
        self._worst = np.empty((int(self._of_vertices.max(initial=-1)) + 2, ALWAYS))
        self._worst_of_all = np.tile(FREE, (len(self._worst), 1))
        self.n_invalid, self.scaled_jacobian = 0, 1.0
        self._judged = self if judged is None else Figures(topology, judged)

    def judged(self, xy: FloatArray) -> Figures:
        """Give the same figures, measured, of the corners that say where walls stand."""
        if self._judged is not self:
            self._judged.look(xy)
        return self._judged

    def invalid(self) -> BoolArray:
        """Mark the cells that are not valid, (n_cells,)."""
        from qsmooth.kernels.kept_figures import SURE

        return np.asarray(self._values[SURE] == 0.0)

    @property
    def sines(self) -> FloatArray:
        """Smallest sine of each cell's corners that can change, squared with its sign."""
        from qsmooth.kernels.kept_figures import LEAST_SINE

        sines: FloatArray = self._values[LEAST_SINE]
        return sines

    def look(self, xy: FloatArray) -> None:
        """Measure what has changed."""
        from qsmooth.kernels.kept_figures import measure_chunks, worst_figures

        if self._judged is not self:
            self._judged.dirty |= self.dirty

        measure_chunks(xy, *self._topology.cells, self._counts, self.dirty, self._values)
        worst = self._values, self._of_cells, self._worst
        self.scaled_jacobian, doubtful = worst_figures(*worst)
        self.n_invalid = 0
        if doubtful:
            self.n_invalid = self._decide(xy)
            worst_figures(*worst)

    @property
    def worst(self) -> FloatArray:
        """The largest and smallest cosine and the smallest sine of each region; a copy."""
        return self._worst.copy()

    def no_worse_than(self, worst: FloatArray) -> bool:
        """Whether all cells are valid, and no region is worse than it was (`worst`)."""
        now = self._worst
        return not (
            self.n_invalid or (now[:, 0] > worst[:, 0]).any() or (now[:, 1:] < worst[:, 1:]).any()
        )

    def _decide(self, xy: FloatArray) -> int:
        """Find out which of the doubtful cells are valid; count the others."""
        from qsmooth.kernels.kept_figures import SURE
        from qsmooth.kernels.tangles import bad_cells

        cells = np.flatnonzero(self._values[SURE] == 0.0)
        bad, none = np.empty(cells.size, np.bool_), np.zeros(self._counts.size, np.bool_)
        bad_cells(xy, *self._topology.cells, none, cells, bad)
        self._values[SURE, cells[~bad]] = 1.0
        return int(bad.sum())

    @property
    def least_sine(self) -> float:
        """Smallest sine of the corners that can change."""
        return float(self._worst[:, 2].min(initial=1.0))

    def hold(self, held: FloatArray) -> None:
        """Hold the worst of each region: `held`, (n_vertices, 3), is as `newton_sweep` takes it."""
        some = np.isfinite(self._worst[:, 0])
        self._worst_of_all[:, :ALWAYS] = np.where(some[:, None], self._worst, FREE[:ALWAYS])
        caps = np.ascontiguousarray(with_slack(self._worst_of_all, 1.0)[:, :ALWAYS])
        np.take(caps, self._of_vertices, axis=0, out=held, mode="wrap")


class _Part:
    """Blocks that are swept together, and which of them are next.

    Parameters
    ----------
    blocks, asks
        The blocks, and what each of them asks for.
    first
        Number of the first of them among all blocks.
    """

    def __init__(self, blocks: Blocks, asks: IndexArray, first: int) -> None:
        n_blocks = len(blocks.table)
        self.blocks, self._asks, self._mine = blocks, asks, slice(first, first + n_blocks)
        self.selected = blocks._replace(
            table=blocks.table.copy(), colour_blocks=blocks.colour_blocks.copy()
        )
        self.asks, self._listed = asks.copy(), np.empty(n_blocks, np.int64)
        self.count = 0

    def number(self, block_of: IndexArray) -> None:
        """Write down the block of each vertex."""
        from qsmooth.kernels.resting import number_blocks

        number_blocks(self.blocks.table, self.blocks.vertices, block_of)
        block_of[self.blocks.vertices] += self._mine.start

    def select(self, awake: BoolArray, low: BoolArray, wanted: bool) -> int:
        """Select the awake blocks that are low, or those that are not; count them."""
        from qsmooth.kernels.resting import select

        blocks, out = self.blocks, self.selected
        self.count = select(
            blocks.table, blocks.colour_blocks, self._asks, awake[self._mine], low[self._mine],
            wanted, out.table, out.colour_blocks, self.asks, self._listed,
        )  # fmt: skip
        return self.count

    def settle(
        self,
        xy: FloatArray,
        lengths: FloatArray,
        rings: Csr,
        neighbours: Csr,
        rtol: float,
        touched: BoolArray,
        awake: BoolArray,
    ) -> None:
        """Note what a sweep over the selected blocks has moved."""
        from qsmooth.kernels.resting import settle

        around = neighbours[0][self._mine.start :], neighbours[1]
        settle(
            xy, self.selected.table, self.blocks.vertices, self._listed[: self.count], lengths,
            *rings, *around, rtol, touched[self._mine], awake,
        )  # fmt: skip

    def mark_low(self, sines: FloatArray, limits: tuple[float, float], awake: BoolArray,
                 low: BoolArray) -> None:  # fmt: skip
        """Mark the awake blocks with a low cell."""
        from qsmooth.kernels.resting import mark_low

        mine = self._mine
        mark_low(self.blocks.table, self.blocks.cells, awake[mine], sines, *limits, low[mine])

    def mark_changed(self, touched: BoolArray, dirty: BoolArray) -> None:
        """Mark the chunks of the cells of touched blocks."""
        from qsmooth.kernels.resting import mark_chunks

        mark_chunks(self.blocks.table, self.blocks.cells, touched[self._mine], dirty)


class Resting:
    """Which blocks of vertices rest, and where the vertices have been left.

    Parameters
    ----------
    topology, blocks, asks
        Of the mesh; its movable vertices in blocks; what each block asks for.
    movable : (n_vertices,)
        These vertices.
    slides
        Those that slide, in blocks that come after the others; None where none does.

    Attributes
    ----------
    xy : (n_vertices, 2)
        The present coordinates.
    changed : (n_vertices,)
        Where `take_in` has changed them.
    selected, asks
        The blocks to sweep next, and what they ask for: `select` overwrites what is in there.
    left, moves : (n_vertices, 2)
        Where the last step left them, and how far they came in it; of vertices that slide, how far
        the host moved them.
    awake, low : (n_blocks,)
        Blocks that do not rest; those with a cell whose sine is low (`mark_low`).
    """

    def __init__(
        self,
        topology: Topology,
        blocks: Blocks,
        asks: IndexArray,
        movable: BoolArray,
        slides: Blocks | None = None,
    ) -> None:
        self._topology, self._free, self._slides = topology, _Part(blocks, asks, 0), None
        self._parts = [self._free]
        n_blocks = len(blocks.table)
        if slides is not None:
            n_slides = len(slides.table)
            self._slides = _Part(slides, np.zeros(n_slides, np.int64), n_blocks)
            self._parts.append(self._slides)
            self._sliding = slides.vertices.astype(np.int64)
            self._given, self._came = np.empty((2, self._sliding.size, 2))
            n_blocks += n_slides
        self._block_of = np.full(topology.n_vertices, -1, np.int64)
        for part in self._parts:
            part.number(self._block_of)
        self._neighbours = self._find_neighbours()
        self.selected, self.asks = self._free.selected, self._free.asks
        self.awake, self._next = np.ones(n_blocks, np.bool_), np.zeros(n_blocks, np.bool_)
        self._touched, self.low = np.zeros(n_blocks, np.bool_), np.zeros(n_blocks, np.bool_)
        self.changed = np.empty(topology.n_vertices, np.bool_)
        self.xy = np.full((topology.n_vertices, 2), np.nan)
        self._part = Alone()
        self._own: BoolArray | None = None
        self._movable, self._trial = movable, np.empty((topology.n_vertices, 2))
        self._not_host = movable if slides is None else movable.copy()
        self.left, self.moves = np.full_like(self.xy, np.nan), np.full_like(self.xy, np.nan)

    def _find_neighbours(self) -> Csr:
        """Find the blocks that share a cell with each block."""
        from qsmooth.kernels.blocks import ROWS
        from qsmooth.kernels.resting import block_neighbours

        table = np.concatenate([part.blocks.table for part in self._parts])
        cells = np.concatenate([part.blocks.cells for part in self._parts])
        n_free, n_rows = len(self._free.blocks.table), self._free.blocks.cells.size
        table[n_free:, ROWS] += np.uint64(n_rows)
        found: Csr = block_neighbours(table, cells, *self._topology.cells, self._block_of)
        return found

    def divide(self, engine: Engine, stars: Stars) -> Part:
        """Give who sweeps which of the blocks that do not slide; it is asked at each sweep."""
        self._part = part = engine.steps(self._topology, stars, self._block_of)
        self._own = part.own_blocks
        return part

    def take_in(self, given: FloatArray, dirty: BoolArray) -> bool:
        """Go to other coordinates, and wake what is around those that differ.

        Returns
        -------
        bool
            False where a coordinate is not finite or too large, and nothing is done.
        """
        from qsmooth.kernels.resting import take_in, wake_around

        count = take_in(given, self.xy, LARGEST_COORDINATE, self.changed)
        if count > 0:
            topology = self._topology
            stars = topology.star_offsets, topology.star_cells
            wake_around(self.changed, *stars, *topology.cells, self._block_of, self.awake, dirty)
        return bool(count >= 0)

    def following(self, rtol: float) -> FloatArray | None:
        """Where the vertices would be if they went on with the others, (n_vertices, 2).

        None where the others, which the host moves, do not go on as in the step before. Moves of
        less than a share `rtol` of the shortest edge are left out.
        """
        from qsmooth.kernels.resting import follow, host_factor

        if self._slides is not None:
            # What could slide counts where the host has moved it.
            not_host, sliding = self._not_host, self._sliding
            not_host[sliding] = ~self.changed[sliding]
        factor, likeness = host_factor(self.xy, self.left, self.moves, self._not_host)
        if not likeness >= ALIKE or abs(factor) > LARGEST_FACTOR:
            return None
        rings, changed = self._topology.rings, self.changed
        moves, trial = self.moves, self._trial
        follow(self.xy, moves, factor, self._movable, changed, *rings, rtol, trial)
        return trial

    def begin_step(self) -> None:
        """Note where the host has put the vertices that slide."""
        if self._slides is not None:
            np.take(self.xy, self._sliding, axis=0, out=self._given, mode="clip")

    def end_step(self) -> None:
        """Note how far the vertices have come."""
        np.subtract(self.xy, self.left, out=self.moves)
        if self._slides is not None:
            np.take(self.left, self._sliding, axis=0, out=self._came, mode="clip")
            np.subtract(self._given, self._came, out=self._came)
            self.moves[self._sliding] = self._came
        np.copyto(self.left, self.xy)

    def of_vertices(self, of_blocks: BoolArray) -> BoolArray:
        """Marks of blocks as marks of their vertices, (n_vertices,)."""
        marked = np.zeros(self._block_of.size, np.bool_)
        inside = self._block_of >= 0
        marked[inside] = of_blocks[self._block_of[inside]]
        return marked

    def of_blocks(self, of_vertices: BoolArray) -> BoolArray:
        """Mark the blocks with a marked vertex, (n_blocks,)."""
        marked = np.zeros(self.awake.size, np.bool_)
        marked[self._block_of[of_vertices & (self._block_of >= 0)]] = True
        return marked

    @property
    def any_awake(self) -> bool:
        """Whether some block does not rest."""
        return bool(self.awake.any())

    def wake_all(self) -> None:
        """Let no block rest, in the next sweep."""
        self.awake[:] = True

    def wake(self) -> None:
        """Let all blocks be awake after this sweep."""
        self._next[:] = True

    def mark_low(self, sines: FloatArray, least: float, enough: float) -> None:
        """Mark the awake blocks with a cell whose sine is below the least.

        Those that are marked stay so until all sines are enough.
        """
        limits = least * abs(least), enough * abs(enough)
        for part in self._parts:
            part.mark_low(sines, limits, self.awake, self.low)

    def select(self, low: bool) -> bool:
        """Select the awake blocks that are marked low, or those that are not; is there any?

        Of several processes each selects its own.
        """
        if self._own is None:
            return self._free.select(self.awake, self.low, low) > 0
        n_free = self._own.size
        wanted = self.awake[:n_free] & (self.low[:n_free] == low)
        self._free.select(wanted & self._own, self.low, low)
        return bool(wanted.any())

    def slides(self, low: bool) -> Blocks | None:
        """Select the same of the vertices that slide; None where there is none.

        All processes sweep all of them.
        """
        part = self._slides
        if part is None or not part.select(self.awake, self.low, low):
            return None
        return part.selected._replace(table=part.selected.table[: part.count])

    def settle(self, lengths: FloatArray, rtol: float, *, slides: bool = False) -> None:
        """Note what a sweep over the selected blocks has moved, (n_movable,) or (n_sliding,)."""
        part = self._slides if slides else self._free
        assert part is not None
        rings, touched = self._topology.rings, self._touched
        part.settle(self.xy, lengths, rings, self._neighbours, rtol, touched, self._next)

    def end_sweep(self) -> None:
        """From now on those are awake that this sweep has woken."""
        self._part.either(self._next)
        self.awake, self._next = self._next, self.awake
        self._next[:] = False

    def mark_changed(self, dirty: BoolArray) -> None:
        """Mark the chunks of the cells that have moved since this was last asked."""
        self._part.complete(self.xy)
        self._part.either(self._touched)
        for part in self._parts:
            part.mark_changed(self._touched, dirty)


def _can_change(topology: Topology, movable: BoolArray) -> BoolArray:
    """Mark the corners with a movable vertex at, before or after them, (n_corners,)."""
    offsets, vertices = topology.cells
    after = np.arange(1, vertices.size + 1)
    after[offsets[1:] - 1] = offsets[:-1]
    moves = movable[vertices]
    before = np.empty_like(moves)
    before[after] = moves
    return np.asarray(moves | moves[after] | before)
