"""Steps of a session: a few sweeps over what does not rest, with all tables made once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.engine import Engine, threads_for
from qsmooth.kernels.stars import Moves, Stars
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.methods.driver import Setting, SweepingMethod
from qsmooth.metrics import Quality
from qsmooth.numbering import Inside
from qsmooth.optimizer.caps import ALWAYS, FREE
from qsmooth.optimizer.ground import Ground, targets_inside
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.method import Optimize, Untangle
from qsmooth.optimizer.progress import Progress
from qsmooth.optimizer.resting import Figures, Resting
from qsmooth.optimizer.untangling import untangle
from qsmooth.targets import Targets
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


@dataclass(frozen=True)
class StepRecord:
    """What one step of a `Smoother` came to.

    Attributes
    ----------
    valid
        Whether every cell is valid, decided in exact arithmetic.
    scaled_jacobian
        The smallest of all cells.
    sweeps
        Sweeps that were made, over what did not rest.
    untangled
        Whether the points were given with invalid cells that untangling was tried on.
    rests
        Whether every vertex rests: of the same points the next step makes no sweep.
    """

    valid: bool
    scaled_jacobian: float
    sweeps: int
    untangled: bool
    rests: bool


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
    figures
        Of the cells.
    """

    def __init__(self, method: Optimize, lanes: Lanes, figures: Figures) -> None:
        self._method, self._lanes, self._figures = method, lanes, figures
        self.resting = Resting(lanes.topology, *lanes.tables)
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
        least = max(figures.least_sine, LEAST_SINE)
        limit = min(WALLED, AHEAD * least)
        if self._walls:
            resting.mark_low(figures.sines, limit, LEFT * limit)
        self._wall, self._no_wall = Wall(1.0, 1.0 / limit, SQUARINGS), Wall(1.0, np.inf, 1)

    def sweep(self) -> None:
        """Sweep once, and note what rests now."""
        lanes, resting = self._lanes, self.resting
        for low, wall in ((False, self._no_wall), (True, self._wall)):
            if resting.select(low):
                selected = resting.selected, resting.asks
                sweep = lanes.sweep(resting.xy, wall, self._held, self._lengths, selected)
                lanes.run(sweep)
                resting.settle(self._lengths, REST)
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
        swept: Figures,
        figures: Figures,
    ) -> None:
        self._method, self._setting, self._engine = method, setting, engine
        self._swept, self._figures = swept, figures
        blocks = setting.blocks
        n_movable = setting.stars.vertices.size
        self._moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
        self.resting = Resting(setting.topology, blocks, np.zeros(len(blocks.table), np.int64))
        if method.guards:
            setting.blocks = self.resting.selected
        self._sweep = method.start(setting)

    def prepare(self) -> None:
        """Hold what the mesh has now."""
        swept, method = self._swept, self._method
        if swept is not self._figures and method.guards:
            swept.dirty[:] = True
            swept.look(self.resting.xy)
        self._setting.good = method.good(swept.scaled_jacobian)

    def sweep(self) -> None:
        """Sweep once, and note what rests now."""
        sweep, resting, moves = self._sweep, self.resting, self._moves
        resting.select(False)
        sweep.prepare(resting.xy)
        self._engine.run(lambda colours: sweep.move(resting.xy, colours, moves), sweep.n_colours)
        if self._method.guards:
            resting.settle(moves.lengths, self._method.rtol)
        elif moves.shares.max(initial=0.0) > self._method.rtol:
            resting.wake()
        resting.end_sweep()

    def mark_changed(self) -> None:
        """Mark the cells to measure again."""
        if self._method.guards and self._swept is self._figures:
            self.resting.mark_changed(self._figures.dirty)
        else:
            self._figures.dirty[:] = True


class Idle:
    """No sweep: what untangling alone does with a valid mesh."""

    def __init__(self, topology: Topology, stars: Stars) -> None:
        blocks = topology.blocks(stars)
        self.resting = Resting(topology, blocks, np.zeros(len(blocks.table), np.int64))

    def prepare(self) -> None:
        """Look at nothing."""

    def sweep(self) -> None:
        """Move nothing."""
        self.resting.end_sweep()

    def mark_changed(self) -> None:
        """Mark no cell."""


class Stepper:
    """Steps of a method on one mesh, from coordinates in the order inside.

    Parameters
    ----------
    method, mesh
        What is done, and to which cells.
    meant
        What cells are meant to be; None for methods that do not ask.

    Attributes
    ----------
    inside
        The mesh as it lies in memory.
    figures
        Of its cells.
    resting
        Where the vertices are, and which rest.
    """

    def __init__(self, method: Method, mesh: Mesh, meant: Targets | None) -> None:
        self._method, self.inside, self._meant = method, Inside(mesh), meant
        self._freedom = method.freedom(mesh).inside(self.inside)
        self._rails = self._freedom.rails()
        self._engine = threads_for(method.threads, max(1, self._freedom.n_movable))
        self.figures = Figures(self.inside.topology, self._freedom.movable)
        self._sweeper = self._sweeper_of(mesh)
        self.resting = self._sweeper.resting
        self._left = 0

    def _sweeper_of(self, mesh: Mesh) -> Sweeper:
        method, inside, movable = self._method, self.inside, self._freedom.movable
        stars = inside.topology.schedule_of(movable)
        if isinstance(method, Optimize) and self._meant is not None:
            lanes = Lanes(inside.topology, stars, self._engine, self._rails)
            lanes.aim_at(targets_inside(self._meant, inside))
            return Newton(method, lanes, self.figures)
        if not isinstance(method, SweepingMethod):
            return Idle(inside.topology, stars)
        swept, figures, cells = inside, self.figures, self._freedom.cells
        if (cut := method.cut(mesh)) is not mesh:
            swept = Inside(cut, inside)
            figures = Figures(swept.topology, movable)
            stars = swept.topology.schedule_of(movable)
            cells = None if cells is None else np.repeat(cells, mesh.topology.cell_sizes - 2)
        setting = Setting(
            swept.topology, stars, np.nan, swept.chosen_cells(cells), rails=self._rails
        )
        return Plain(method, setting, self._engine, figures, self.figures)

    def step(self, given: FloatArray, most: int) -> StepRecord | None:
        """Go to these coordinates, and sweep so often at most; the result is `resting.xy`.

        None where a coordinate is not finite or too large; then nothing is done.
        """
        resting, figures, sweeper = self.resting, self.figures, self._sweeper
        with self._engine.running():
            if not resting.take_in(given, figures.dirty):
                return None
            figures.look(resting.xy)
            self._confine()
            untangled = most > 0 and self._method.guards and figures.n_invalid > self._left
            if untangled:
                self._untangle()
            sweeps = 0
            if resting.any_awake:
                sweeper.prepare()
                while sweeps < most and resting.any_awake:
                    sweeper.sweep()
                    sweeps += 1
                sweeper.mark_changed()
                figures.look(resting.xy)
        return self.record(sweeps, untangled)

    def record(self, sweeps: int, untangled: bool) -> StepRecord:
        """Say how things are."""
        return StepRecord(
            valid=not self.figures.n_invalid,
            scaled_jacobian=self.figures.scaled_jacobian,
            sweeps=sweeps,
            untangled=untangled,
            rests=not self.resting.any_awake,
        )

    def go_on_from(self, xy: FloatArray, was_invalid: BoolArray) -> IndexArray:
        """Go to coordinates that differ by rounding, and wake nothing.

        Returns
        -------
        vertices
            Those of the cells, by the caller's numbers, that are invalid now and were not.
        """
        resting, topology = self.resting, self.inside.topology
        awake = resting.awake.copy()
        resting.take_in(xy, self.figures.dirty)
        resting.awake[:] = awake
        self.figures.look(resting.xy)
        lost = self.figures.invalid() & ~was_invalid & self._method.guards
        vertices = topology.cell_vertices[np.repeat(lost, topology.cell_sizes)]
        return np.unique(topology.vertex_ids[vertices])

    def state(self) -> tuple[FloatArray, BoolArray, BoolArray, int]:
        """What a copy needs to go on from here, in the caller's order."""
        resting, back = self.resting, self.inside.back
        awake, low = resting.of_vertices(resting.awake), resting.of_vertices(resting.low)
        return back(resting.xy), back(awake), back(low), self._left

    def restore(self, state: tuple[FloatArray, BoolArray, BoolArray, int]) -> None:
        """Go on from there."""
        xy, awake, low, self._left = state
        resting, inside = self.resting, self.inside
        resting.xy[:] = inside.at_vertices(xy)
        resting.awake[:] = resting.of_blocks(inside.at_vertices(awake))
        resting.low[:] = resting.of_blocks(inside.at_vertices(low))

    def _confine(self) -> None:
        """Confine moves to what is allowed from here."""
        rails, method = self._rails, self._method
        if not rails.origin.size:
            return
        rails.origin[:] = self.resting.xy
        if method.max_move is None and method.max_move_share is None:
            return
        # What stopped at the end of its reach may go on.
        self.resting.wake_all()
        if method.max_move_share is not None:
            self._measure_reach()

    def _measure_reach(self) -> None:
        """Work out how far vertices may come, where that depends on their edges."""
        from qsmooth.kernels.untangle_sweep import shortest_edges

        reach, rings = self._rails.reach, self.inside.topology.rings
        shortest_edges(self.resting.xy, *rings, self._everyone, reach)
        reach *= self._method.max_move_share or 0.0
        if self._method.max_move is not None:
            np.minimum(reach, self._method.max_move, out=reach)
        reach -= self._freedom.rounding
        np.maximum(reach, 0.0, out=reach)

    @cached_property
    def _everyone(self) -> TableArray:
        return np.arange(self.inside.topology.n_vertices, dtype=np.uint32)

    def _untangle(self) -> None:
        """Untangle near the invalid cells; those that nothing can be done about are left."""
        resting, figures = self.resting, self.figures
        xy = resting.xy.copy()
        reach = None if self._freedom.reach is None else self._rails.reach.copy()
        freedom = replace(self._freedom, origin=resting.xy.copy(), reach=reach)
        progress = Progress(Untangle(), Quality(self.inside.topology, xy.copy()))
        untangle(Ground(self.inside, freedom, self._engine), xy, progress)
        resting.take_in(xy, figures.dirty)
        figures.look(resting.xy)
        self._left = figures.n_invalid
