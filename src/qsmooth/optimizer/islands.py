"""Islands of vertices around tangles, each untangled for itself, all in the same sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.optimizer.extrapolation import Extrapolation
from qsmooth.optimizer.ground import Ground
from qsmooth.optimizer.progress import ROUND, Progress

if TYPE_CHECKING:
    from qsmooth.optimizer.lanes import Lanes

# Square of the regularisation at a valid corner: it is lowered by the factor, down to the least,
# each time that no more is gained.
FLOOR, FLOOR_FACTOR, LEAST_FLOOR = 1e-4, 0.01, 1e-9
# The square grows by this times that of the smallest determinant, where that is negative.
PER_DETERMINANT = 0.04
# What an extrapolation may cost the smallest determinant, as a fraction of itself.
MOST_LOST = 0.02
# The smallest determinant has grown when it did by this fraction of itself.
LEAST_PROGRESS = 1e-3


@dataclass(frozen=True)
class Task:
    """What is untangled.

    Attributes
    ----------
    ground, progress
        What may move, and what counts the sweeps.
    xy : (n, 2)
        Changed in place.
    closed : (n_corners,)
        Corners that do not count.
    sizes : (n,)
        Local mean squared edge length.
    """

    ground: Ground
    progress: Progress
    xy: FloatArray
    closed: BoolArray
    sizes: FloatArray


class Islands:
    """Vertices around tangles, in islands that share no cell.

    Each has a regularisation and a patience of its own, so that what becomes of one does not
    hang on another, however tangled that is.

    Parameters
    ----------
    task
        What is untangled.
    vertices : (n,)
        Those that may move.
    patience
        Sweeps without any progress after which an island is given up.
    """

    def __init__(self, task: Task, vertices: BoolArray, patience: int) -> None:
        from qsmooth.kernels.tangles import label_islands

        topology = task.ground.topology
        self._task, self._most_patience = task, patience
        self._labels = np.where(vertices, -2, -1)
        n = label_islands(
            np.flatnonzero(vertices),
            topology.star_offsets,
            topology.star_cells,
            *topology.cells,
            self._labels,
        )
        self._floor = np.full(n, FLOOR)
        self._least = np.full(n, -np.inf)
        self._patience = np.full(n, patience)
        self._worst = np.full(n, np.inf)
        self._put_in_lanes(vertices)
        self._best_xy = task.xy[self._vertices]
        self._best = self._count_bad()

    def sweep(self, most_sweeps: int | None) -> None:
        """Sweep until no island has a bad cell, or all that have are given up.

        Each is left with the coordinates with the fewest bad cells that were seen.

        Parameters
        ----------
        most_sweeps
            Sweeps after which all are given up; None for no limit.
        """
        xy, progress = self._task.xy, self._task.progress
        last = np.inf if most_sweeps is None else progress.sweeps + most_sweeps
        active = self._best > 0
        before = progress.sweeps
        ground = self._task.ground
        free = self._lanes.stars.vertices
        ahead = Extrapolation(free, ROUND, ground.engine, ground.rails)
        size = np.sqrt(self._task.sizes[free])
        ahead.start(xy, size)
        while active.any() and progress.sweeps < last and not progress.spent():
            active &= self._has_patience()
            if not active.any():
                break
            self._lanes.untangle(xy, *self._softness())
            progress.sweeps += 1
            ahead.note(xy)
            self._determinants()
            if ahead.full:
                self._go(ahead.extrapolated(xy))
                ahead.start(xy, size)
            if progress.sweeps % ROUND == 0:
                self._lanes.report(xy, self._lanes.quality(xy), progress)
            self._keep_best(progress.sweeps % ROUND == 0)
            active &= self._best > 0
        xy[self._vertices] = self._best_xy
        if progress.sweeps > before:
            self._lanes.report(xy, self._lanes.quality(xy), progress)

    def _go(self, trial: FloatArray | None) -> None:
        """Go to where the sweeps lead, but for islands whose worst corner would lose by it."""
        if trial is None:
            return
        xy, worst = self._task.xy, self._worst
        before = xy[self._vertices]
        xy[:] = trial
        self._determinants()
        with np.errstate(invalid="ignore"):  # infinite where no corner counts
            worse = self._worst < worst - MOST_LOST * np.abs(worst)
        if worse.any():
            back = worse[self._island_of_vertex]
            xy[self._vertices[back]] = before[back]
            self._determinants()

    def mend_more(self, rounds: int, patience: int, *, wholly: bool) -> bool:
        """Look for places that mend more cells, one vertex at a time; say whether there were.

        Parameters
        ----------
        rounds, patience
            How often each vertex is moved at most, and without gain.
        wholly
            Whether only islands that are left without any bad cell may keep what was gained.
        """
        xy, progress = self._task.xy, self._task.progress
        first, given, waited = self._best.copy(), self._best_xy.copy(), 0
        for _ in range(rounds):
            if waited == patience or not self._best.any() or progress.spent():
                break
            before = self._best.sum()
            self._lanes.mend_more(xy, self._task.closed, progress)
            if progress.sweeps % ROUND == 0:
                self._lanes.report(xy, self._lanes.quality(xy), progress)
            self._keep_best(surely=True)
            waited = 0 if self._best.sum() < before else waited + 1
        if wholly:
            back = (self._best > 0)[self._island_of_vertex]
            self._best_xy[back] = given[back]
            self._best[self._best > 0] = first[self._best > 0]
        xy[self._vertices] = self._best_xy
        self._lanes.report(xy, self._lanes.quality(xy), progress)
        return bool((self._best < first).any())

    def _put_in_lanes(self, vertices: BoolArray) -> None:
        """List the vertices, and their cells island by island."""
        ground = self._task.ground
        everything = int(vertices.sum()) == int(ground.movable.sum())
        self._lanes: Lanes = ground.lanes if everything else ground.lanes_of(vertices)
        self._vertices = self._lanes.vertices
        self._island_of_vertex = self._labels[self._vertices]
        counts, rows = rows_of(ground.topology.star_offsets, self._vertices)
        cells, at = np.unique(ground.topology.star_cells[rows], return_index=True)
        islands = np.repeat(self._island_of_vertex, counts)[at]
        order = np.argsort(islands, kind="stable")
        self._cells, self._island_of_cell = cells[order].astype(np.int64), islands[order]
        self._starts = np.searchsorted(self._island_of_cell, np.arange(self._floor.size))
        self._smallest = np.empty(cells.size)
        self._bad = np.empty(cells.size, np.bool_)
        self._soft = np.zeros(ground.topology.n_vertices)
        self._determinants()

    def _determinants(self) -> None:
        """Find the smallest determinant of each cell and of each island."""
        from qsmooth.kernels.untangle_sweep import smallest_determinant

        task = self._task
        cells = task.ground.topology.cells
        smallest_determinant(task.xy, *cells, task.sizes, task.closed, self._cells, self._smallest)
        self._worst = np.minimum.reduceat(self._smallest, self._starts)

    def _has_patience(self) -> BoolArray:
        """Mark the islands that still gain, or get a lower floor, or have waited little for it."""
        least, worst = self._least, self._worst
        grew = ~np.isfinite(least)
        grew[~grew] = worst[~grew] > least[~grew] + LEAST_PROGRESS * np.abs(least[~grew])
        over = ~grew & (self._patience == 0)
        lower = over & (self._floor > LEAST_FLOOR)
        self._floor[lower] *= FLOOR_FACTOR
        renewed = grew | lower
        least[renewed], self._patience[renewed] = worst[renewed], self._most_patience
        has: BoolArray = ~over | lower
        self._patience[has] -= 1
        return has

    def _softness(self) -> tuple[FloatArray, float]:
        """Work out each vertex's regularisation ε r: as an array, and a number to multiply."""
        epsilon = np.sqrt(self._floor + PER_DETERMINANT * np.minimum(0.0, self._worst) ** 2)
        if epsilon.size == 1:
            return self._task.sizes, float(epsilon[0])
        sizes = self._task.sizes[self._vertices]
        self._soft[self._vertices] = epsilon[self._island_of_vertex] * sizes
        return self._soft, 1.0

    def _keep_best(self, surely: bool) -> None:
        """Keep the coordinates of islands with fewer bad cells than ever.

        Parameters
        ----------
        surely
            Whether to count even where the determinants don't show any gain.
        """
        fewer = np.add.reduceat(self._smallest <= 0.0, self._starts, dtype=np.int64) < self._best
        if not (surely or fewer.any()):
            return
        count = self._count_bad()
        better = count < self._best
        if better.any():
            self._best[better] = count[better]
            kept = better[self._island_of_vertex]
            self._best_xy[kept] = self._task.xy[self._vertices[kept]]

    def _count_bad(self) -> IndexArray:
        """Count the bad cells of each island, in exact arithmetic."""
        from qsmooth.kernels.tangles import bad_cells

        task = self._task
        cells = task.ground.topology.cells
        bad_cells(task.xy, *cells, task.closed, self._cells, self._bad)
        return np.add.reduceat(self._bad, self._starts, dtype=np.int64)


def rows_of(offsets: IndexArray, listed: IndexArray) -> tuple[IndexArray, IndexArray]:
    """List the rows of a CSR map that belong to some entries; and how many each has."""
    counts = offsets[listed + 1] - offsets[listed]
    starts = np.cumsum(counts) - counts
    return counts, np.repeat(offsets[listed] - starts, counts) + np.arange(counts.sum())
