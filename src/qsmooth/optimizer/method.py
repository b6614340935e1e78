"""The optimiser and untangling as methods: options, stages in order, and what came of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.engine import threads_for
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.methods.driver import invalid_cells, stored
from qsmooth.metrics import Quality, limits, quality
from qsmooth.optimizer.best import Best
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import ROUND, Progress
from qsmooth.optimizer.stages import improve_mean, mend_worst
from qsmooth.optimizer.untangling import untangle, with_proof
from qsmooth.options import option
from qsmooth.outcome import Aim, Forbidden, Invalid, Outcome, Stop, Trade
from qsmooth.result import History, SmoothResult


@dataclass
class _Found:
    """What the stages came to."""

    xy: FloatArray
    reached_target: bool = False
    trades: tuple[Trade, ...] = ()
    forbidden: Forbidden | None = None


@dataclass(frozen=True, kw_only=True)
class _Staged(Method):
    """A method that goes through stages with aims of their own."""

    untangles = True
    sweeps_a_record = ROUND

    def run(self, mesh: Mesh, chosen: str = "") -> SmoothResult:
        """Go through the stages, and sum up."""
        before = quality(mesh)
        summary = before.summary()
        only, _ = self.selected(mesh)
        stars = mesh.topology.schedule(self.keep_interfaces, only)
        progress = Progress(self, summary)
        result, found, invalid = mesh, _Found(mesh.xy), invalid_cells(before, before)
        if stars.vertices.size:
            engine = threads_for(self.threads, stars.vertices.size)
            with engine.running():
                lanes = Lanes(mesh.topology, stars, engine)
                found = self.stages(lanes, mesh.xy.copy(), before, progress)
                result = stored(mesh, found.xy)
                invalid = invalid_cells(before, quality(result))
        movable = np.zeros(mesh.n_vertices, np.bool_)
        movable[stars.vertices] = True
        invalid = with_proof(invalid, mesh.topology, result.xy, movable)
        bounds = self.bounds(result) if stars.vertices.size else None
        seconds = progress.seconds
        stop = progress.stop or self.finished(found, invalid)
        if not stars.vertices.size and stop is not Stop.STUCK:
            stop = Stop.NOTHING_MOVES
        after = quality(result)
        return SmoothResult(
            mesh=result,
            outcome=Outcome(
                method=self.name,
                stop=stop,
                stop_at=self._stop_at(stop),
                chosen=chosen,
                untangles=True,
                selected=self.selection is not None,
                unchanged=np.array_equal(result.points, mesh.points),
                stages=tuple(progress.stages),
                largest_share=progress.history[-1].largest_share if progress.history else 0.0,
                trades=found.trades,
                forbidden=found.forbidden,
                invalid=invalid,
                limits=bounds,
            ),
            history=History(progress.history),
            before=summary,
            after=after.summary(),
            seconds=seconds,
        )

    def _stop_at(self, stop: Stop) -> float:
        """Value of the option that stopped it, which has the stop's name; NaN where none did."""
        value = getattr(self, stop.value, None)
        return math.nan if value is None else float(value)

    def stages(self, lanes: Lanes, xy: FloatArray, before: Quality, progress: Progress) -> _Found:
        """Run the stages; `xy` may be changed."""
        raise NotImplementedError

    def finished(self, found: _Found, invalid: Invalid | None) -> Stop:
        """Why it stopped where what the caller allows was not used up."""
        raise NotImplementedError

    def bounds(self, result: Mesh) -> object:
        """Limits of the result's angles, where they belong to the outcome."""
        return None


@dataclass(frozen=True, kw_only=True)
class Optimize(_Staged):
    """Find the best places for the vertices: untangle, improve the mean, then the worst cells.

    Each vertex takes Newton steps downhill on the shape energy of the cells around it. Where a
    whole region has to move, Newton steps on all vertices at once take over. Then a wall, steeper
    and steeper, pushes back the corners with the smallest sine, and only these. It stops by itself
    when nothing more is gained.

    The result is never worse than the input in smallest angle, largest angle, smallest scaled
    Jacobian and mean shape. Where the four can't all be had the worst cells go first, and the
    outcome says so. An invalid mesh is untangled first; then the untangled mesh is what counts.
    The history has a record for each round of ten sweeps.

    Notes
    -----
    Mean ratio: P. M. Knupp, "Algebraic mesh quality metrics", SIAM J. Sci. Comput. 23 (2001).
    Untangling: see `Untangle`.
    """

    name = "optimize"
    title = "Optimise"
    purpose = (
        "Untangles if need be, then finds the best mean shape, then the best worst cell. The "
        "default; the one to take unless there is a reason for another."
    )

    max_sweeps: int = option(5000, within="[0, inf)", flag="sweeps", help="Sweeps at most.")
    objective: Literal["shape"] = option(
        "shape",
        help="What the mean is of: shape is the mean ratio to squares and equilateral triangles.",
    )
    worst: bool = option(True, help="Whether to see to the worst cells too, or only to the mean.")
    target_quality: float | None = option(
        None, within="(0, 1]", help="Smallest scaled Jacobian at which it may stop."
    )
    mean_loss: float = option(
        0.1, within="[0, 1)", help="Share of the best mean shape that the worst cells may cost."
    )

    def stages(self, lanes: Lanes, xy: FloatArray, before: Quality, progress: Progress) -> _Found:
        """Untangle, improve the mean, mend the worst cells; keep the best that was seen."""
        best = Best(lanes, xy, progress, mean_loss=self.mean_loss, target=self.target_quality)
        if best.given.n_invalid:
            with progress.stage(Aim.UNTANGLE):
                untangle(lanes, xy, progress)
            best.restart(xy, mean_counts=False)
        with progress.stage(Aim.MEAN_SHAPE):
            improve_mean(lanes, xy, lanes.stars, best, progress, worst=self.worst)
        if self.worst and not best.reached_target():
            with progress.stage(Aim.WORST_CELLS):
                mend_worst(lanes, xy, best, progress)
        best.settle()
        return _Found(best.xy, best.reached_target(), best.trades, best.forbidden)

    def finished(self, found: _Found, invalid: Invalid | None) -> Stop:
        """Why it stopped where what the caller allows was not used up."""
        return Stop.TARGET_QUALITY if found.reached_target else Stop.SETTLED

    def bounds(self, result: Mesh) -> object:
        """Limits of the result's angles."""
        return limits(result, keep_interfaces=self.keep_interfaces)


@dataclass(frozen=True, kw_only=True)
class Untangle(_Staged):
    """Make an invalid mesh valid by moving vertices, and stop there.

    The result is a valid mesh; or one with as few invalid cells as were seen, and the outcome says
    how many stay invalid, where, and for which of them that is proven. A valid mesh comes back as
    it is.

    Notes
    -----
    V. Garanzha, I. Kaporin, L. Kudryavtseva, F. Protais, N. Ray, D. Sokolov, "Foldover-free maps
    in 50 lines of code", ACM Trans. Graph. 40 (2021): the regularised determinant; here with
    Newton steps vertex by vertex.
    """

    name = "untangle"
    title = "Untangle"
    purpose = "Makes an invalid mesh valid, and stops there."
    listed = False

    max_sweeps: int = option(20_000, within="[0, inf)", flag="sweeps", help="Sweeps at most.")

    def stages(self, lanes: Lanes, xy: FloatArray, before: Quality, progress: Progress) -> _Found:
        """Untangle, unless the mesh is valid."""
        if before.n_invalid:
            with progress.stage(Aim.UNTANGLE):
                untangle(lanes, xy, progress)
        return _Found(xy)

    def finished(self, found: _Found, invalid: Invalid | None) -> Stop:
        """Why it stopped where what the caller allows was not used up."""
        return Stop.STUCK if invalid is not None and invalid.after else Stop.VALID
