"""Measuring what sweeps have come to, each process a part of the cells."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.metrics import Quality
from qsmooth.optimizer.caps import Caps
from qsmooth.optimizer.figures import LOW, TINY, Figures
from qsmooth.optimizer.look import Look
from qsmooth.parts import Part
from qsmooth.targets import Targets
from qsmooth.topology import Topology


class Measured:
    """A mesh whose cells are measured towards targets.

    Parameters
    ----------
    topology, movable
        Of the mesh: which vertices may move, (n_vertices,).
    judged
        Those of them whose corners count.
    part
        Who looks at which cells.

    Attributes
    ----------
    targets, sizes, maps
        What is asked of the cells, as `kernels.round_figures` takes it.
    """

    targets: Targets
    sizes: FloatArray
    maps: FloatArray

    def __init__(
        self, topology: Topology, movable: BoolArray, judged: BoolArray, part: Part
    ) -> None:
        self.topology, self.movable, self._judged, self._part = topology, movable, judged, part
        self._look: Look | None = None

    @property
    def sized(self) -> bool:
        """Whether sizes count."""
        return bool(self.sizes[:, 1].any())

    @cached_property
    def caps(self) -> Caps:
        """What is held; nothing at first."""
        return Caps(self.topology, self.movable, self._part)

    def quality(self, xy: FloatArray) -> Quality:
        """Measure the mesh at these coordinates."""
        return Quality(self.topology, xy)

    def look(self, xy: FloatArray) -> Look:
        """Measure the cells at these coordinates; the last look is kept, and used again."""
        if self._look is None or not self._look.is_of(xy):
            self._look = None  # it is as large as the next one
            self._look = Look(
                self.topology, xy, self._judged, self.targets, self.sizes, self.maps, self._part
            )
        return self._look

    def worst_shape(self, xy: FloatArray) -> FloatArray:
        """Largest shape energy of each cell's corners towards their targets, (n_cells,)."""
        return self.look(xy).worst_shape

    def energy(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Largest badness and mean shape energy of each cell, (n_cells,).

        Cells that nothing can be done for (`Caps.lost`) have none.
        """
        look = self.look(xy)
        return self._counted(look.badness, look.energy, self.caps.lost)

    def own_energy(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `energy`, of the cells that this process looks at."""
        own, cells = self.look(xy).own, self._part.run_of(self.topology).cells
        return self._counted(own.badness, own.energy, self.caps.lost[cells])

    @staticmethod
    def _counted(
        badness: FloatArray, energy: FloatArray, lost: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        if not lost.any():
            return badness, energy
        return np.where(lost, 0.0, badness), np.where(lost, 0.0, energy)

    def total_energy(self, xy: FloatArray) -> float:
        """Sum of the cells' shape energy, where that is finite."""
        energy = self.own_energy(xy)[1]
        return self._part.exact_sum(energy[np.isfinite(energy)])

    def largest_badness(self, xy: FloatArray, *, finite: bool = True) -> float:
        """Badness of the worst cell, or of the worst whose badness is finite; 1 at least."""
        badness = self.own_energy(xy)[0]
        if finite:
            badness = badness[np.isfinite(badness)]
        return self._part.largest(float(badness.max(initial=1.0)))

    def figures(self, xy: FloatArray) -> Figures:
        """Sum up what coordinates, (n, 2), are judged by."""
        look, part, n_cells = self.look(xy), self._part, self.topology.n_cells
        badness, energy = self.own_energy(xy)
        shape = 1.0 / look.own.worst_shape
        extremes = part.of_all((badness.max(initial=1.0), shape.min(initial=np.inf)))
        worst, least = np.array(extremes).T
        return Figures(
            free_jacobian=1.0 / float(worst.max()),
            shape=part.exact_sum(shape) / n_cells,
            least_shape=float(least.min()),
            low_angle=look.low_angle(LOW),
            energy=part.exact_sum(energy) / n_cells,
            plain_shape=look.mean_shape,
            n_invalid=look.quality.n_invalid,
            resized=self._resized(look),
        )

    def _resized(self, look: Look) -> float:
        """Mean over the cells of γ |log τ|."""
        run = self._part.run_of(self.topology)
        inv_area, weight = self.sizes[run.cells].T
        if not self.sized:
            return 0.0
        # Twice the area of a triangle, as the targets are.
        twice = np.where(run.topology.cell_sizes == 3, 2.0, 1.0)
        tau = np.where(weight > 0.0, twice * look.own.area * inv_area, 1.0)
        total = self._part.exact_sum(weight * np.abs(np.log(np.maximum(tau, TINY))))
        return total / self.topology.n_cells
