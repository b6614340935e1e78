"""Steps of a session: a few sweeps over what does not rest, with all tables made once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.constraints import Freedom
from qsmooth.engine import engine_for
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.methods.driver import Setting, SweepingMethod
from qsmooth.metrics import Quality
from qsmooth.numbering import Inside
from qsmooth.optimizer.ground import Ground, targets_inside
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.method import Optimize, Untangle
from qsmooth.optimizer.progress import Progress
from qsmooth.optimizer.resting import Figures
from qsmooth.optimizer.step_slides import StepSlider, layout_of
from qsmooth.optimizer.sweepers import REST, Idle, Newton, Plain, Sweeper
from qsmooth.optimizer.untangling import untangle
from qsmooth.sliding import Slides
from qsmooth.targets import Targets


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

    def __repr__(self) -> str:
        return (
            f"StepRecord(valid={self.valid}, scaled_jacobian={self.scaled_jacobian:.4f}, "
            f"sweeps={self.sweeps}, untangled={self.untangled}, rests={self.rests})"
        )


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
        layout = layout_of(method, mesh)
        freedom = layout.freedom.inside(self.inside)
        self._rails = freedom.rails()
        n_movable = max(1, freedom.n_movable)
        self._engine = engine_for(method.threads, n_movable, self.inside, method.team)
        cut = method.cut(mesh) if isinstance(method, SweepingMethod) else mesh
        swept = self.inside if cut is mesh else Inside(cut, self.inside)
        self._slider: StepSlider | None = None
        self._freedom, judged = freedom, None
        if freedom.chains is not None and freedom.chains.inner.size:
            self._slider = StepSlider(cut, swept, layout, method, self._rails)
            others = self._slider.others(freedom)
            self._freedom = replace(freedom, movable=others, chains=None)
            judged = others if others.any() and isinstance(method, Optimize) else None
        self.figures = Figures(self.inside.topology, freedom.movable, judged)
        self._swept_figures = self.figures
        if swept is not self.inside:
            self._swept_figures = Figures(swept.topology, freedom.movable)
        self._sweeper = self._sweeper_of(swept)
        self.resting = self._sweeper.resting
        self._left = 0

    def _sweeper_of(self, swept: Inside) -> Sweeper:
        method, movable, slider = self._method, self._freedom.movable, self._slider
        topology, rails = swept.topology, self._rails
        stars = topology.schedule_of(movable)
        if isinstance(method, Optimize) and self._meant is not None:
            lanes = Lanes(topology, stars, self._engine.alone, rails, slider)
            lanes.aim_at(targets_inside(self._meant, swept))
            return Newton(method, lanes, movable, self.figures, slider, self._engine)
        if not isinstance(method, SweepingMethod):
            return Idle(topology, stars, movable)
        cells = self._freedom.cells
        if cells is not None and swept is not self.inside:
            cells = np.repeat(cells, self.inside.mesh.topology.cell_sizes - 2)
        slides = None if slider is None else Slides(slider, np.nan)
        cells = swept.chosen_cells(cells)
        setting = Setting(topology, stars, np.nan, cells, rails=rails, slides=slides)
        figures = self._swept_figures, self.figures
        return Plain(method, setting, self._engine, movable, *figures)

    def step(self, given: FloatArray, most: int) -> StepRecord | None:
        """Go to these coordinates, and sweep so often at most; the result is `resting.xy`.

        None where a coordinate is not finite or too large; then nothing is done.
        """
        resting, figures, sweeper = self.resting, self.figures, self._sweeper
        with self._engine.running():
            if not self._take_in(given):
                return None
            resting.begin_step()
            if self._slider is not None and (resting.any_awake or resting.changed.any()):
                self._slider.start(resting.xy, resting.changed)
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

    @property
    def guards(self) -> bool:
        """Whether the method keeps valid cells valid."""
        return self._method.guards

    def record(self, sweeps: int, untangled: bool) -> StepRecord:
        """Say how things are."""
        return StepRecord(
            valid=not self.figures.n_invalid,
            scaled_jacobian=self.figures.scaled_jacobian,
            sweeps=sweeps,
            untangled=untangled,
            rests=not self.resting.any_awake,
        )

    def go_on_along_lines(self) -> None:
        """Find out where on the same lines vertices are that have been put back."""
        if self._slider is not None:
            self._slider.go_on(self.resting.xy)

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
        lines = None if self._slider is None else self._slider.state()
        return (*places, back(awake), back(low), self._left, lines)

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go on from there."""
        xy, left, moves, awake, low, self._left, lines = state
        resting, inside = self.resting, self.inside
        if self._slider is not None:
            self._slider.restore(lines)
        resting.xy[:] = inside.at_vertices(xy)
        resting.left[:], resting.moves[:] = inside.at_vertices(left), inside.at_vertices(moves)
        resting.awake[:] = resting.of_blocks(inside.at_vertices(awake))
        resting.low[:] = resting.of_blocks(inside.at_vertices(low))

    def _take_in(self, xy: FloatArray) -> bool:
        """Go to other coordinates, and note which cells to measure again; as `Resting.take_in`."""
        taken = self.resting.take_in(xy, self._swept_figures.dirty)
        if self._swept_figures is not self.figures:
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
        freedom = replace(self._with_slides(), origin=resting.xy.copy(), reach=reach)
        progress = Progress(Untangle(), Quality(self.inside.topology, xy.copy()))
        untangle(Ground(self.inside, freedom, self._engine), xy, progress)
        self._take_in(xy)
        if self._slider is not None:
            self._slider.go_on(resting.xy)
        figures.look(resting.xy)
        self._left = figures.n_invalid

    def _with_slides(self) -> Freedom:
        """What may move now, with what slides along the lines of this step."""
        freedom, slider, topology = self._freedom, self._slider, self.inside.topology
        if slider is None:
            return freedom
        chains = slider.chains_now()
        if not chains.inner.size:
            return freedom
        sliding = chains.sliding(topology.n_vertices)[topology.vertex_ids]
        return replace(freedom, movable=freedom.movable | sliding, chains=chains)
