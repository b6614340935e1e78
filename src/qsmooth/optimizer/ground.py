"""What a run of the optimiser stands on: the mesh, what may move, and who runs the sweeps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from qsmooth._types import BoolArray
from qsmooth.constraints import Freedom
from qsmooth.engine import Engine
from qsmooth.kernels.rails import Rails
from qsmooth.numbering import Inside
from qsmooth.optimizer.lanes import Lanes
from qsmooth.sliding import Slider, slider_of
from qsmooth.targets import Targets
from qsmooth.topology import Topology


class Meant(NamedTuple):
    """What the cells of a mesh are meant to be.

    Attributes
    ----------
    readings
        The ways to read that, in the caller's order; plain first.
    isotropic
        Whether the mesh itself says that ideal is what they are meant to be.
    """

    readings: list[Targets]
    isotropic: bool


@dataclass(frozen=True)
class Ground:
    """The mesh, what may move, and who runs the sweeps.

    Attributes
    ----------
    inside
        The mesh as it lies in memory.
    freedom
        What may move, in the order inside.
    engine
        Who runs the sweeps.
    meant
        What cells are meant to be, where that is known already.
    """

    inside: Inside
    freedom: Freedom
    engine: Engine
    meant: Meant | None = None

    @property
    def topology(self) -> Topology:
        """Cells, in the order inside."""
        return self.inside.topology

    @property
    def movable(self) -> BoolArray:
        """Mark the vertices that may move, (n_vertices,)."""
        return self.freedom.movable

    @cached_property
    def rails(self) -> Rails:
        """Where they may be."""
        return self.freedom.rails()

    @cached_property
    def slider(self) -> Slider | None:
        """Those of them that slide; None where none does."""
        return slider_of(self.freedom, self.inside.mesh, self.inside)

    @cached_property
    def still(self) -> Ground:
        """The same with no vertex that slides."""
        if self.slider is None:
            return self
        freedom = replace(self.freedom, movable=self.slider.others(self.freedom), chains=None)
        return Ground(self.inside, freedom, self.engine)

    @cached_property
    def lanes(self) -> Lanes:
        """All of them in lanes; made when they are first wanted."""
        return self.lanes_of(self.movable)

    def forget(self) -> None:
        """Let go of the lanes; they are made anew where they are wanted again."""
        self.__dict__.pop("lanes", None)

    def lanes_of(self, vertices: BoolArray) -> Lanes:
        """Put only these in lanes, (n_vertices,)."""
        slider = None if self.slider is None else self.slider.only(vertices)
        if slider is not None:
            vertices = vertices & ~slider.mask
        stars = self.topology.schedule_of(vertices)
        return Lanes(self.topology, stars, self.engine, self.rails, slider)


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
