"""What a run of the optimiser stands on: the mesh, what may move, and who runs the sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsmooth._types import BoolArray
from qsmooth.engine import Engine
from qsmooth.numbering import Inside
from qsmooth.optimizer.lanes import Lanes
from qsmooth.targets import Targets
from qsmooth.topology import Topology


@dataclass(frozen=True)
class Ground:
    """The mesh, what may move, and who runs the sweeps.

    Attributes
    ----------
    inside
        The mesh as it lies in memory.
    keep_interfaces, only
        Whether interfaces stay, and which vertices are selected, None for all, (n_vertices,).
    engine
        Who runs the sweeps.
    """

    inside: Inside
    keep_interfaces: bool
    only: BoolArray | None
    engine: Engine

    @property
    def topology(self) -> Topology:
        """Cells, in the order inside."""
        return self.inside.topology

    @cached_property
    def movable(self) -> BoolArray:
        """Mark the vertices that may move, (n_vertices,)."""
        movable = self.topology.movable(self.keep_interfaces)
        return movable if self.only is None else movable & self.only

    @cached_property
    def lanes(self) -> Lanes:
        """All of them in lanes; made when they are first wanted."""
        stars = self.topology.schedule(self.keep_interfaces, self.only)
        return Lanes(self.topology, stars, self.engine)

    def lanes_of(self, vertices: BoolArray) -> Lanes:
        """Put only these in lanes, (n_vertices,)."""
        return Lanes(
            self.topology, self.topology.schedule(self.keep_interfaces, vertices), self.engine
        )


def targets_inside(targets: Targets, inside: Inside) -> Targets:
    """Put targets of the caller's cells into the order inside."""
    if not inside.topology.is_renumbered:
        return targets
    cells = inside.topology.cell_ids
    return targets._replace(
        corners=np.take(targets.corners, inside.corner_places, axis=0),
        area=targets.area[cells],
        size_weight=targets.size_weight[cells],
        is_layer=targets.is_layer[cells],
        maps=None if targets.maps is None else np.take(targets.maps, cells, axis=0),
    )
