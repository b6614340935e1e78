"""Steps of a session: a few sweeps over what does not rest, with all tables made once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.constraints import Freedom
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
from qsmooth.sliding import slider_of
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
        self.resting = Resting(lanes.topology, *lanes.tables, lanes.movable)
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
    movable : (n_vertices,)
        Vertices that may move.
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
        self._method, self._setting, self._engine = method, setting, engine
        self._swept, self._figures = swept, figures
        blocks = setting.blocks
        n_movable = setting.stars.vertices.size
        self._moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
        asks = np.zeros(len(blocks.table), np.int64)
        self.resting = Resting(setting.topology, blocks, asks, movable)
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


def without_slides(freedom: Freedom, inside: Inside) -> Freedom:
    """Let vertices that slide stay: in a step they are the host's, as the boundary is."""
    slider = slider_of(freedom, inside.mesh, inside)
    if slider is None:
        return freedom
    return replace(freedom, movable=slider.others(freedom), chains=None)


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
        self._freedom = without_slides(method.freedom(mesh).inside(self.inside), self.inside)
        self._rails = self._freedom.rails()
        self._engine = threads_for(method.threads, max(1, self._freedom.n_movable))
        self.figures = Figures(self.inside.topology, self._freedom.movable)
        self._dirty = self.figures.dirty  # of the cells that are swept
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
            return Idle(inside.topology, stars, movable)
        swept, figures, cells = inside, self.figures, self._freedom.cells
        if (cut := method.cut(mesh)) is not mesh:
            swept = Inside(cut, inside)
            figures = Figures(swept.topology, movable)
            self._dirty = figures.dirty
            stars = swept.topology.schedule_of(movable)
            cells = None if cells is None else np.repeat(cells, mesh.topology.cell_sizes - 2)
        setting = Setting(
            swept.topology, stars, np.nan, swept.chosen_cells(cells), rails=self._rails
        )
        return Plain(method, setting, self._engine, movable, figures, self.figures)

    def step(self, given: FloatArray, most: int) -> StepRecord | None:
        """Go to these coordinates, and sweep so often at most; the result is `resting.xy`.

        None where a coordinate is not finite or too large; then nothing is done.
        """
        resting, figures, sweeper = self.resting, self.figures, self._sweeper
        with self._engine.running():
            if not self._take_in(given):
                return None
            figures.look(resting.xy)
            if most > 0:
                self._follow(given)
            self._confine()
            self._left = min(self._left, figures.n_invalid)
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
            resting.end_step()
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
        self._take_in(xy)
        resting.awake[:] = awake
        self.figures.look(resting.xy)
        lost = self.figures.invalid() & ~was_invalid & self._method.guards
        vertices = topology.cell_vertices[np.repeat(lost, topology.cell_sizes)]
        return np.unique(topology.vertex_ids[vertices])

    def state(self) -> tuple[Any, ...]:
        """What a copy needs to go on from here, in the caller's order."""
        resting, back = self.resting, self.inside.back
        awake, low = resting.of_vertices(resting.awake), resting.of_vertices(resting.low)
        places = back(resting.xy), back(resting.left), back(resting.moves)
        return (*places, back(awake), back(low), self._left)

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go on from there."""
        xy, left, moves, awake, low, self._left = state
        resting, inside = self.resting, self.inside
        resting.xy[:] = inside.at_vertices(xy)
        resting.left[:], resting.moves[:] = inside.at_vertices(left), inside.at_vertices(moves)
        resting.awake[:] = resting.of_blocks(inside.at_vertices(awake))
        resting.low[:] = resting.of_blocks(inside.at_vertices(low))

    def _take_in(self, xy: FloatArray) -> bool:
        """Go to other coordinates, and note which cells to measure again; as `Resting.take_in`."""
        taken = self.resting.take_in(xy, self._dirty)
        if self._dirty is not self.figures.dirty:
            self.figures.dirty[:] = True
        return taken

    def _follow(self, given: FloatArray) -> None:
        """Let the vertices go on with the boundary, if that costs no corner."""
        resting, figures = self.resting, self.figures
        if self._rails.origin.size or not self._method.guards:
            return
        trial = resting.following(REST)
        if trial is None:
            return
        worst = figures.worst if not figures.n_invalid else None
        self._take_in(trial)
        figures.look(resting.xy)
        better = not figures.n_invalid if worst is None else figures.no_worse_than(worst)
        if not better:
            self._take_in(given)
            figures.look(resting.xy)

    def _confine(self) -> None:
        """Confine moves to what is allowed from here."""
        rails, freedom = self._rails, self._freedom
        if not rails.origin.size:
            return
        rails.origin[:] = self.resting.xy
        if freedom.reach is not None:
            self.resting.wake_all()  # what stopped at the end of its reach may go on
        if freedom.by_edge is not None:
            self._measure_reach(freedom.by_edge)

    def _measure_reach(self, by_edge: FloatArray) -> None:
        """Work out how far vertices may come, where that depends on their edges."""
        from qsmooth.kernels.untangle_sweep import shortest_edges

        reach, most = self._rails.reach, self._method.max_move
        shortest_edges(self.resting.xy, *self.inside.topology.rings, self._everyone, reach)
        np.multiply(reach, by_edge, out=reach, where=np.isfinite(by_edge))
        np.copyto(reach, np.inf, where=~np.isfinite(by_edge))
        if most is not None:
            np.minimum(reach, most, out=reach)
        np.subtract(reach, self._freedom.rounding, out=reach)
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
        self._take_in(xy)
        figures.look(resting.xy)
        self._left = figures.n_invalid
