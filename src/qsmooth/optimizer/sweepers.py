"""Sweeps of a session's steps over what does not rest, of the optimiser and of other methods."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from qsmooth._types import BoolArray
from qsmooth.engine import Engine
from qsmooth.kernels.stars import Moves, Stars
from qsmooth.methods.driver import Setting, SweepingMethod
from qsmooth.optimizer.caps import ALWAYS, FREE
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.method import Optimize
from qsmooth.optimizer.resting import Figures, Resting
from qsmooth.sliding import Slider
from qsmooth.topology import Topology

# A vertex of the optimiser rests that moved by no more than this share of its shortest edge.
REST = 1e-3
# Corners whose sine is below this are pushed back by a wall, which stands there, or at a multiple
# of the worst sine where that is lower; a block of vertices that has felt it does so until all
# sines are better by a factor. The wall is of power 2 ** SQUARINGS. With it a body that has turned
# by 45 degrees in its box leaves a scaled Jacobian of .65, without it of .29.
WALLED, AHEAD, LEFT, SQUARINGS = 1.0 / 1.2, 1.0 / 0.6, 1.25, 3
# No wall is made for a worse corner than this.
LEAST_SINE = 1e-3


class Sweeper(Protocol):
    """Sweeps of one method over the blocks that are awake."""

    resting: Resting

    def prepare(self) -> None:
        """Look at the coordinates before the first sweep of a step."""
        ...

    def sweep(self) -> None:
        """Sweep once, and note what rests now."""
        ...

    def mark_changed(self) -> None:
        """Mark the cells to measure again."""
        ...


class Newton:
    """The optimiser's sweeps: downhill on the mean shape, with a wall where corners are bad.

    Parameters
    ----------
    method, lanes
        What is asked, and of which vertices; it is known what the cells are meant to be.
    movable : (n_vertices,)
        Vertices that may move and do not slide.
    figures
        Of the cells.
    slider
        The vertices that slide; None where none does.
    engine
        Who runs the sweeps.
    """

    def __init__(
        self,
        method: Optimize,
        lanes: Lanes,
        movable: BoolArray,
        figures: Figures,
        slider: Slider | None,
        engine: Engine,
    ) -> None:
        self._method, self._lanes, self._figures = method, lanes, figures
        slides = None if slider is None else slider.blocks
        self.resting = Resting(lanes.topology, *lanes.tables, movable, slides)
        self._part = self.resting.divide(engine, lanes.stars)
        self._held = np.tile(FREE[:ALWAYS], (lanes.topology.n_vertices, 1))
        self._lengths = np.zeros(lanes.stars.vertices.size)
        self._walls = method.worst and not method.by_metric

    def prepare(self) -> None:
        """Hold what the mesh has now, and find the blocks with bad corners."""
        from qsmooth.kernels.newton_sweep import Wall

        method, figures, resting = self._method, self._figures, self.resting
        if method.hold:
            caps = self._lanes.caps
            caps.hold(resting.xy, method.hold, angles=not method.by_metric)
            self._held = caps.swept
        elif not method.by_metric:
            figures.hold(self._held)
        judged = figures.judged(resting.xy)
        least = max(judged.least_sine, LEAST_SINE)
        limit = min(WALLED, AHEAD * least)
        if self._walls:
            resting.mark_low(judged.sines, limit, LEFT * limit)
        self._wall, self._no_wall = Wall(1.0, 1.0 / limit, SQUARINGS), Wall(1.0, np.inf, 1)

    def sweep(self) -> None:
        """Sweep once, and note what rests now."""
        lanes, resting = self._lanes, self.resting
        walls = (False, self._no_wall), (True, self._wall)
        for low, wall in walls:
            if resting.select(low):
                selected = resting.selected, resting.asks
                sweep = lanes.sweep(resting.xy, wall, self._held, self._lengths, selected)
                self._part.sweep(sweep, lanes.n_colours, resting.xy)
                resting.settle(self._lengths, REST)
        if lanes.slides:
            self._part.complete(resting.xy)
        for low, wall in walls:
            if (slides := resting.slides(low)) is not None:
                lengths = lanes.slide(resting.xy, wall, self._held, slides)
                resting.settle(lengths, REST, slides=True)
        resting.end_sweep()

    def mark_changed(self) -> None:
        """Mark the cells to measure again."""
        self.resting.mark_changed(self._figures.dirty)


class Plain:
    """The sweeps of the other methods.

    Parameters
    ----------
    method, setting
        What is done, and what it is done to.
    engine
        Who runs the sweeps.
    movable : (n_vertices,)
        Vertices that may move and do not slide.
    swept
        Figures of the cells that are swept: halves of quads, where these are cut in two.
    figures
        Figures of the mesh's own cells.
    """

    def __init__(
        self,
        method: SweepingMethod,
        setting: Setting,
        engine: Engine,
        movable: BoolArray,
        swept: Figures,
        figures: Figures,
    ) -> None:
        self._method, self._setting = method, setting
        self._swept, self._figures = swept, figures
        blocks = setting.blocks
        n_movable = setting.stars.vertices.size
        self._moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
        asks = np.zeros(len(blocks.table), np.int64)
        slides = setting.slides
        sliding = None if slides is None else slides.slider.blocks
        self._slid = np.zeros(0 if sliding is None else sliding.vertices.size)
        self.resting = Resting(setting.topology, blocks, asks, movable, sliding)
        if method.guards:
            setting.blocks = self.resting.selected
        self._sweep = method.start(setting)
        # What moves all vertices at once is not divided: it asks for no blocks.
        divided = method.guards and self._sweep.n_colours == setting.n_colours
        self._part = self.resting.divide(engine if divided else engine.alone, setting.stars)

    def prepare(self) -> None:
        """Hold what the mesh has now."""
        swept, method = self._swept, self._method
        if swept is not self._figures and method.guards:
            swept.dirty[:] = True
            swept.look(self.resting.xy)
        worst = swept.scaled_jacobian
        self._setting.good = method.good(worst)
        if self._setting.slides is not None:
            self._setting.slides.hold(worst if method.quality_guard else np.nan)

    def sweep(self) -> None:
        """Sweep once, and note what rests now."""
        sweep, resting, moves = self._sweep, self.resting, self._moves
        resting.select(False)
        sweep.prepare(resting.xy)
        self._part.sweep(
            lambda colours: sweep.move(resting.xy, colours, moves), sweep.n_colours, resting.xy
        )
        if self._method.guards:
            resting.settle(moves.lengths, self._method.rtol)
        elif moves.shares.max(initial=0.0) > self._method.rtol:
            resting.wake()
        self._slide()
        resting.end_sweep()

    def _slide(self) -> None:
        """Sweep over the vertices that slide."""
        slides, resting = self._setting.slides, self.resting
        if slides is not None:
            self._part.complete(resting.xy)
        if slides is not None and (selected := resting.slides(False)) is not None:
            slides.sweep(resting.xy, self._slid, selected)
            resting.settle(self._slid, self._method.rtol, slides=True)

    def mark_changed(self) -> None:
        """Mark the cells to measure again."""
        if self._method.guards and self._swept is self._figures:
            self.resting.mark_changed(self._figures.dirty)
        else:
            self._part.complete(self.resting.xy)
            self._figures.dirty[:] = True


class Idle:
    """No sweep: what untangling alone does with a valid mesh."""

    def __init__(self, topology: Topology, stars: Stars, movable: BoolArray) -> None:
        blocks = topology.blocks(stars)
        asks = np.zeros(len(blocks.table), np.int64)
        self.resting = Resting(topology, blocks, asks, movable)

    def prepare(self) -> None:
        """Look at nothing."""

    def sweep(self) -> None:
        """Move nothing."""
        self.resting.end_sweep()

    def mark_changed(self) -> None:
        """Mark no cell."""
