"""What a round of the optimiser is judged by, measured of all cells in one pass."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.metrics import Quality
from qsmooth.metrics.quality import in_degrees, percentile
from qsmooth.parts import Alone, Glance
from qsmooth.targets import Targets
from qsmooth.topology import Topology


class Own(NamedTuple):
    """What this process has measured: all cells, or a run of them where several have one each.

    Attributes
    ----------
    badness, energy, worst_shape, shape, area, smallest, largest : (n,)
        As `kernels.round_figures` has them.
    """

    badness: FloatArray
    energy: FloatArray
    worst_shape: FloatArray
    shape: FloatArray
    area: FloatArray
    smallest: FloatArray
    largest: FloatArray


class Look:
    """The figures of every cell at some coordinates.

    Parameters
    ----------
    topology, xy, movable, targets, sizes, maps
        As `kernels.round_figures` takes them. The coordinates are copied.
    part
        Who looks at which cells. What is said of all of them, all processes have to ask for.

    Attributes
    ----------
    own
        What this process has measured.
    """

    def __init__(
        self,
        topology: Topology,
        xy: FloatArray,
        movable: BoolArray,
        targets: Targets,
        sizes: FloatArray,
        maps: FloatArray,
        part: Alone | None = None,
    ) -> None:
        from qsmooth.kernels.round_figures import round_figures

        self._topology, self._xy, self._part = topology, xy.copy(), part or Alone()
        run = self._part.run_of(topology)
        n = run.topology.n_cells
        b, e, w, s, a, low, high = (np.empty(n) for _ in Own._fields)
        certain = np.empty(n, np.bool_)
        corners = targets.corners[run.corners]
        measured = run.topology.cells
        maps = maps[run.cells] if maps.size else maps
        round_figures(
            self._xy, *measured, movable, corners, sizes[run.cells], maps,
            b, e, w, s, low, high, a, certain,
        )  # fmt: skip
        self.own = Own(b, e, w, s, a, low, high)
        self._is_certain = bool(certain.all())

    def is_of(self, xy: FloatArray) -> bool:
        """Whether these are the coordinates that were looked at."""
        return np.array_equal(self._xy, xy)

    def _whole(self, own: FloatArray) -> FloatArray:
        return self._part.of_cells(own, self._topology)

    @cached_property
    def badness(self) -> FloatArray:
        """Of all cells, (n_cells,)."""
        return self._whole(self.own.badness)

    @cached_property
    def energy(self) -> FloatArray:
        """Of all cells, (n_cells,)."""
        return self._whole(self.own.energy)

    @cached_property
    def worst_shape(self) -> FloatArray:
        """Of all cells, (n_cells,)."""
        return self._whole(self.own.worst_shape)

    @cached_property
    def area(self) -> FloatArray:
        """Of all cells, (n_cells,)."""
        return self._whole(self.own.area)

    def low_angle(self, percent: float) -> float:
        """Percentile of the cells' smallest angles, degrees."""
        return percentile(self._whole(self.own.smallest), percent, in_degrees)

    def high_angle(self, percent: float) -> float:
        """Percentile of the cells' largest angles, degrees."""
        return percentile(self._whole(self.own.largest), percent, in_degrees)

    @cached_property
    def mean_shape(self) -> float:
        """Mean of the cells' shape towards squares and equilateral triangles."""
        return self._part.exact_sum(self.own.shape) / self._topology.n_cells

    @cached_property
    def quality(self) -> Quality:
        """Metrics of all cells; it is known whether all are valid."""
        quality = Quality(self._topology, self._xy)
        if all(self._part.of_all(self._is_certain)):
            quality.know_valid()
        return quality

    @cached_property
    def glance(self) -> Glance:
        """What a round is noted with."""
        own = self.own
        extremes = own.smallest.min(initial=np.inf), own.largest.max(initial=-np.inf)
        low, high = np.array(self._part.of_all(extremes)).T
        smallest, largest = in_degrees([float(low.min()), float(high.max())])
        return Glance((smallest, largest), self.mean_shape, self.quality.n_invalid)
