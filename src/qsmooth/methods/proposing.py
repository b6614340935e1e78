"""What star and quad share: angles that are mended, and which cells propose moves in a sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.methods.driver import GuardedMethod, Setting
from qsmooth.metrics import Quality
from qsmooth.options import OptionError, option
from qsmooth.outcome import Aim


@dataclass(frozen=True, kw_only=True)
class ProposingMethod(GuardedMethod):
    """A method whose cells propose to mend corners with too large or too small an angle."""

    step: float = option(0.25, within="(0, 1]", help="Share of each proposed move that is made.")
    max_angle: float = option(
        120.0,
        within="(0, 180)",
        unit="degrees",
        help="Corners of quads with a larger angle are mended.",
    )
    min_angle: float = option(
        60.0,
        within="(0, 180)",
        unit="degrees",
        help="Corners of quads with a smaller angle are mended.",
    )
    triangle_max_angle: float = option(
        90.0,
        within="(0, 180)",
        unit="degrees",
        help="Corners of triangles with a larger angle are mended.",
    )
    triangle_min_angle: float = option(
        45.0,
        within="(0, 180)",
        unit="degrees",
        help="Corners of triangles with a smaller angle are mended.",
    )
    worst_fraction: float = option(
        1.0,
        within="(0, 1]",
        help="Share of the cells that propose moves in a sweep, those with the largest angles.",
    )
    worst_first: bool = option(
        False,
        help="Smooth that share first, then the rest, then all, each for a third of the sweeps.",
    )
    bad_angle: float = option(
        180.0,
        within="(0, 360)",
        unit="degrees",
        help="Cells with a larger angle propose moves by `bad_step` instead of `step`.",
    )
    bad_step: float | None = option(
        None, within="(0, 2]", default_words="as `step`", help="See `bad_angle`."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for prefix in ("", "triangle_"):
            low, high = getattr(self, f"{prefix}min_angle"), getattr(self, f"{prefix}max_angle")
            if not low < high:
                raise OptionError(
                    f"`{prefix}max_angle` must be over `{prefix}min_angle`, which is {low:g} "
                    f"degrees, got {high:g}"
                )
        if self.worst_first and self.worst_fraction == 1.0:
            raise OptionError("`worst_first` needs a `worst_fraction` below 1")

    def stages(self) -> list[tuple[Aim, int]]:
        """List which group of cells proposes moves, and for how many sweeps at most."""
        if not self.worst_first:
            group = Aim.ALL_CELLS if self.worst_fraction == 1.0 else Aim.WORST_GROUP
            return [(group, self.max_sweeps)]
        third = self.max_sweeps // 3
        return [
            (Aim.WORST_GROUP, third),
            (Aim.REST, third),
            (Aim.ALL_CELLS, self.max_sweeps - 2 * third),
        ]

    def thresholds(self) -> FloatArray:
        """Tabulate the angles for kernels, (2, 4)."""
        from qsmooth.kernels.proposals import thresholds

        return thresholds(
            self.max_angle, self.min_angle, self.triangle_max_angle, self.triangle_min_angle
        )


class Pace:
    """At which multiple of `step` each cell proposes in a sweep, 0 where it proposes nothing.

    The worst group, those with the largest angles, is found anew for every sweep.
    """

    def __init__(self, method: ProposingMethod, setting: Setting) -> None:
        self._method, self._topology, self._aim = method, setting.topology, setting.aim
        self._complete = setting.complete
        n_cells = setting.topology.n_cells
        selected = setting.selected
        ranked = np.arange(n_cells) if selected is None else np.flatnonzero(selected)
        self._count = math.ceil(method.worst_fraction * len(ranked))
        self._ranks = self._aim is not Aim.ALL_CELLS and self._count < len(ranked)
        if self._ranks:  # of equal ones the first for the caller comes first
            self._ranked = ranked[np.argsort(setting.topology.cell_ids[ranked])]
        self.values = np.ones(n_cells)

    def update(self, xy: FloatArray) -> None:
        """Set `values`, (n_cells,), for the next sweep."""
        method = self._method
        if not self._ranks and method.bad_step is None:
            return
        self._complete(xy)
        largest = Quality(self._topology, xy).figure("max_angle")
        self.values[:] = 1.0
        if method.bad_step is not None:
            self.values[largest > method.bad_angle] = method.bad_step / method.step
        if self._ranks:
            order = np.argsort(-largest[self._ranked], kind="stable")
            silent = np.ones(self.values.size, np.bool_)
            worst, rest = np.split(self._ranked[order], [self._count])
            silent[worst if self._aim is Aim.WORST_GROUP else rest] = False
            self.values[silent] = 0.0
