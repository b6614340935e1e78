"""What is held: the worst figures of each region of a mesh, which no move may make worse."""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cached_property

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.metrics import Quality, Validity
from qsmooth.metrics.impossible import doublet_vertices
from qsmooth.parts import Alone, Run
from qsmooth.topology import Topology

# What can be held besides the angles and the scaled Jacobian: its worst in the mesh.
HOLDABLE = ("aspect_ratio", "shape", "min_edge")
# All that can be held, in the order of `kernels.held_figures`; how many of these are held always;
# and which are better smaller, as they are measured there.
HELD = ("min_angle", "max_angle", "scaled_jacobian", *HOLDABLE)
ALWAYS = 3
SMALLER = np.array([True, False, False, True, True, False])
# What holds nothing.
FREE = np.array([2.0, -2.0, -2.0, 1e300, 1e300, 0.0])
# How far beyond the worst a trial may be for rounding: as a fraction; and of cosines, where it
# makes the angle worse by that fraction at the most.
SLACK, ROUNDING = 1e-11, 4e-16


class Caps:
    """The worst figures of each region, which no corner and no cell of it may get beyond.

    Regions are cells that movable vertices connect. Cells that are not valid when this is worked
    out, and those of a vertex that no placement makes convex in both its cells, set no cap.

    Parameters
    ----------
    topology, movable
        Of the mesh: which vertices may move, (n,).
    part
        Who looks at which cells; all processes ask for the same.

    Attributes
    ----------
    swept : (n_vertices, 3) or (n_vertices, 6)
        For each vertex the caps of its region, as `newton_sweep` takes them, with no more columns
        than are held: what sweeps need not look at costs nothing.
    lost : (n_cells,)
        Cells with a movable vertex that set no cap.
    """

    def __init__(self, topology: Topology, movable: BoolArray, part: Alone | None = None) -> None:
        self.topology, self._movable, self._part = topology, movable, part or Alone()
        self.swept = np.tile(FREE[:ALWAYS], (topology.n_vertices, 1))
        self.lost = np.zeros(topology.n_cells, np.bool_)
        self._strict: FloatArray | None = None

    def hold(self, xy: FloatArray, also: Collection[str] = (), *, angles: bool = True) -> None:
        """From now on let nothing get worse than the worst of its region at these coordinates.

        That is angles and the scaled Jacobian, unless `angles` is false, and what is listed.
        """
        from qsmooth.kernels.held_figures import worst_of_regions

        (of_vertices, of_cells), part = self.regions, self._part
        run = part.run_of(self.topology)
        of_run = of_cells[run.cells]
        lost = (of_run >= 0) & self._set_none(xy, run)
        self.lost = part.of_cells(lost, self.topology)
        worst = np.tile(
            np.where(SMALLER, -np.inf, np.inf), (int(of_vertices.max(initial=-1)) + 2, 1)
        )
        of_run = np.where(lost, -1, of_run)
        worst_of_regions(self.figures(xy, run.topology), of_run, SMALLER, worst)
        of_parts = np.array(part.of_all(worst))
        worst = np.where(SMALLER, of_parts.max(axis=0), of_parts.min(axis=0))
        # The last row is of what is in no region. A region may have none but lost cells.
        worst[~np.isfinite(worst[:, 0])] = FREE
        for k, name in enumerate(HELD):
            if (name not in also) if name in HOLDABLE else not angles:
                worst[:, k] = FREE[k]
        self._worst, self._strict = worst, with_slack(worst, 0.5)
        n_columns = len(HELD) if also else ALWAYS
        caps = np.ascontiguousarray(with_slack(worst, 1.0)[:, :n_columns])
        if self.swept.shape[1] != n_columns:
            self.swept = np.empty((of_vertices.size, n_columns))
        np.take(caps, of_vertices, axis=0, out=self.swept, mode="wrap")

    @property
    def held(self) -> FloatArray:
        """All caps of each vertex's region, as `newton_sweep` takes them, (n_vertices, 6)."""
        if self._strict is None:
            return np.tile(FREE, (self.topology.n_vertices, 1))
        return np.asarray(with_slack(self._worst, 1.0)[self.regions[0]])

    @cached_property
    def regions(self) -> tuple[IndexArray, IndexArray]:
        """Numbers of the regions of vertices and of cells; -1 of what can't move or change."""
        from qsmooth.kernels.tangles import label_islands

        topology = self.topology
        stars = topology.star_offsets, topology.star_cells
        labels = np.where(self._movable, -2, -1)
        label_islands(np.flatnonzero(self._movable), *stars, *topology.cells, labels)
        offsets, vertices = topology.cells
        return labels, np.maximum.reduceat(labels[vertices], offsets[:-1])

    def value(self, figure: str, cell: int) -> float:
        """Say at what a figure of a cell is held, in the units of `Quality`."""
        k = HELD.index(figure)
        worst = float(self._worst[self.regions[1][cell], k])
        if k < 2:
            return math.degrees(math.acos(min(max(worst, -1.0), 1.0)))
        return {
            "scaled_jacobian": worst,
            "aspect_ratio": math.sqrt(worst),
            "shape": 1.0 / worst,
            "min_edge": math.sqrt(2.0 * worst),
        }[figure]

    def beyond(self, xy: FloatArray) -> BoolArray:
        """Mark the figures of each cell that are worse than what is held, (n_cells, 6).

        This is a little stricter than trials are: what is let through here is not so near a cap
        that its vertices would have no trial any more.
        """
        if self._strict is None:
            return np.zeros((self.lost.size, len(HELD)), np.bool_)
        figures, held = self.figures(xy), self._strict[self.regions[1]]
        worse = np.where(SMALLER, figures > held, figures < held)
        return np.asarray(worse & ~self.lost[:, None])

    def forbidden(self, xy: FloatArray, quality: Quality | None = None) -> BoolArray:
        """Mark the cells that are invalid at these coordinates, or worse than what is held.

        None of those that set no cap: they are as they are. `quality` is that of the coordinates,
        where it is known.
        """
        from qsmooth.kernels.held_figures import beyond_held

        quality = quality or Quality(self.topology, xy)
        n_cells, regions = self.lost.size, self.regions[1]
        bad = np.zeros(n_cells, np.bool_)
        if self._strict is not None:
            run = self._part.run_of(self.topology)
            own = bad[run.cells]
            of_run = regions[run.cells]
            beyond_held(xy, *run.topology.cells, self._movable, self._strict, of_run, own)
            bad = self._part.of_cells(own, self.topology)
        if quality.n_invalid:
            bad |= (quality.validity != Validity.VALID) & (regions >= 0)
        return np.asarray(bad & ~self.lost)

    def figures(self, xy: FloatArray, cells: Topology | None = None) -> FloatArray:
        """Measure what can be held of each cell, or of some, (n_cells, 6)."""
        from qsmooth.kernels.held_figures import held_figures

        cells = cells or self.topology
        out = np.empty((cells.n_cells, len(FREE)))
        held_figures(xy, *cells.cells, self._movable, out)
        return out

    def _set_none(self, xy: FloatArray, run: Run) -> BoolArray:
        """Mark the cells that are not valid, and those of doublets: one of the two never is."""
        if not run.topology.n_cells:
            return np.zeros(0, np.bool_)
        lost = Quality(run.topology, xy).validity != Validity.VALID
        doublets = doublet_vertices(self.topology)
        if doublets.any():
            offsets, vertices = run.topology.cells
            lost |= np.logical_or.reduceat(doublets[vertices], offsets[:-1])
        return np.asarray(lost)


def with_slack(worst: FloatArray, share: float) -> FloatArray:
    """Let figures, (n, 6), be worse by this share of what rounding may need."""
    slack = share * SLACK
    caps = worst.copy()
    cosines = worst[:, :2]
    signs = np.where(SMALLER, 1.0, -1.0)
    caps[:, :2] += signs[:2] * (slack * (1.0 - cosines**2) + share * ROUNDING)
    caps[:, 2:] *= 1.0 + slack * signs[2:]
    return caps
