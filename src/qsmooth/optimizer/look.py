"""What a round of the optimiser is judged by, measured of all cells in one pass."""

from __future__ import annotations

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.metrics import Quality
from qsmooth.targets import Targets
from qsmooth.topology import Topology


class Look:
    """The figures of every cell at some coordinates.

    Parameters
    ----------
    topology, xy, movable, targets, sizes, maps
        As `kernels.round_figures` takes them. The coordinates are copied.

    Attributes
    ----------
    badness, energy, worst_shape : (n_cells,)
        As `kernels.round_figures` has them.
    quality
        Metrics of the cells; those that a round is judged by are known.
    """

    def __init__(
        self,
        topology: Topology,
        xy: FloatArray,
        movable: BoolArray,
        targets: Targets,
        sizes: FloatArray,
        maps: FloatArray,
    ) -> None:
        from qsmooth.kernels.round_figures import round_figures

        n = topology.n_cells
        self._xy = xy.copy()
        self.badness, self.energy, self.worst_shape = np.empty(n), np.empty(n), np.empty(n)
        shape, area, certain = np.empty(n), np.empty(n), np.empty(n, np.bool_)
        smallest, largest = np.empty(n), np.empty(n)
        round_figures(
            self._xy,
            *topology.cells,
            movable,
            targets.corners,
            sizes,
            maps,
            self.badness,
            self.energy,
            self.worst_shape,
            shape,
            smallest,
            largest,
            area,
            certain,
        )
        self.quality = Quality(topology, self._xy)
        self.quality.know(
            shape=shape, area=area, diamonds=(smallest, largest), valid=bool(certain.all())
        )

    def is_of(self, xy: FloatArray) -> bool:
        """Whether these are the coordinates that were looked at."""
        return np.array_equal(self._xy, xy)
