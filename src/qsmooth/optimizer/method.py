"""The optimiser and untangling as methods: options, stages in order, and what came of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.engine import engine_for
from qsmooth.kernels.compiling import clock
from qsmooth.landing import guard, land, slid
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.methods.driver import invalid_cells, stored
from qsmooth.metrics import Quality
from qsmooth.metrics.bounds import angle_limits
from qsmooth.numbering import Inside
from qsmooth.optimizer.best import MEAN_LOSS, Best
from qsmooth.optimizer.figures import LEAST_GAIN
from qsmooth.optimizer.ground import Ground, Meant, targets_inside
from qsmooth.optimizer.judgement import judged
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.last_look import kept_from_better
from qsmooth.optimizer.parsing import parse_hold, parse_target
from qsmooth.optimizer.progress import ROUND, Progress
from qsmooth.optimizer.stages import improve_mean, mend_worst
from qsmooth.optimizer.untangling import untangle, with_proof
from qsmooth.options import opaque, option
from qsmooth.outcome import Aim, Forbidden, Held, Invalid, Outcome, Stop, Target
from qsmooth.result import History, SmoothResult
from qsmooth.sums import exact_mean
from qsmooth.targets import (
    Targets,
    candidates,
    from_metric,
    from_ratios,
    ideal,
    initial,
    with_sizes,
    without_sizes,
)

# Learned ratios are taken where with them the mean shape gets better by this factor than with
# squares: 1.025 to 1.16 times as good over notches and bumps, .97 to 1.0003 elsewhere.
CLEARLY = 1.01
# A metric that is a function of places is asked again where the cells have come to, so often at
# most, and until the mean target of areas and directions changes by less than this fraction.
ASKINGS, ASKED = 8, 1e-2
# Where no more than this share of the cells is invalid the mesh still says what it is meant to be.
FEW_INVALID = 0.01
# The last look is at corners as bad as this fraction of the worst one.
LAST_WALL = 0.95


def _change(old: Targets, new: Targets) -> float:
    """Mean relative change of the target areas, or of the maps where that is larger."""
    change = exact_mean(np.abs(np.log(new.area / old.area)))
    if old.maps is not None and new.maps is not None:
        lengths = [np.abs(maps).max(axis=1) for maps in (new.maps - old.maps, old.maps)]
        change = max(change, exact_mean(lengths[0] / lengths[1]))
    return change


@dataclass
class _Found:
    """What the stages came to."""

    xy: FloatArray
    good_enough: bool = False
    forbidden: Forbidden | None = None
    held: tuple[Held, ...] = ()
    start: FloatArray | None = None
    target: Target | None = None
    layers: float = 0.0


@dataclass(frozen=True, kw_only=True)
class _Staged(Method):
    """A method that goes through stages with aims of their own."""

    untangles = True
    sweeps_a_record = ROUND

    def run(self, mesh: Mesh, chosen: str = "", meant: Meant | None = None) -> SmoothResult:
        """Go through the stages, and sum up; what cells are `meant` to be may be known."""
        started = clock()
        inside = Inside(mesh, kept=not self.max_sweeps)
        before = inside.quality(mesh)
        freedom = self.freedom(mesh)
        movable, n_movable = freedom.movable, freedom.n_movable
        progress = Progress(self, before, started)
        result, found, after = mesh, _Found(mesh.xy), before
        bounds = slider = None
        if n_movable:
            engine = engine_for(self.threads, n_movable, inside, self.team)
            ground = Ground(inside, freedom.inside(inside), engine, meant)
            slider = ground.slider
            with engine.running():
                found = self.stages(ground, before, progress)
                ground.forget()  # the larger part of the memory of a run
                result = stored(mesh, inside.back(found.xy), freedom)
                after = before if result is mesh else inside.quality(result)
            bounds = self.bounds(ground, result, after)
        invalid = with_proof(invalid_cells(before, after), mesh.topology, result.xy, movable)
        seconds = progress.seconds
        stop = Stop.CALLBACK if progress.watch.asked else progress.stop
        stop = stop or self.finished(found, invalid)
        if not n_movable and stop is not Stop.STUCK:
            stop = Stop.NOTHING_MOVES
        start = before
        if found.start is not None and before.n_invalid:
            start = inside.quality_at(found.start)
        trades, sizes = judged(before, start, after, found.target, found.layers)
        summed_up = SmoothResult(
            mesh=result,
            outcome=Outcome(
                method=self.name,
                stop=stop,
                stop_at=self._stop_at(stop),
                chosen=chosen,
                untangles=True,
                selected=self.selection is not None,
                unchanged=result is mesh or np.array_equal(result.points, mesh.points),
                stages=tuple(progress.stages),
                largest_share=progress.history[-1].largest_share if progress.history else 0.0,
                trades=trades,
                forbidden=found.forbidden,
                held=found.held,
                invalid=invalid,
                target=found.target,
                sliding=slid(freedom, mesh, result, slider),
                sizes=sizes,
                limits=bounds,
            ),
            history=History(progress.history),
            quality_before=before,
            quality_after=after,
            seconds=seconds,
            freedom=freedom,
        )
        return progress.watch.give_back(summed_up)

    def _stop_at(self, stop: Stop) -> float:
        """Value of the option that stopped it, which has the stop's name; NaN where none did."""
        is_option = stop is not Stop.CALLBACK and stop.value in self.specs()
        value = getattr(self, stop.value) if is_option else None
        return math.nan if value is None else float(value)

    def stages(self, ground: Ground, before: Quality, progress: Progress) -> _Found:
        """Run the stages."""
        raise NotImplementedError

    def finished(self, found: _Found, invalid: Invalid | None) -> Stop:
        """Why it stopped where what the caller allows was not used up."""
        raise NotImplementedError

    def bounds(self, ground: Ground, result: Mesh, after: Quality) -> object:
        """Limits of the result's angles, where they belong to the outcome."""
        return None


@dataclass(frozen=True, kw_only=True)
class Optimize(_Staged):
    """Find the best places for the vertices: untangle, improve the mean, then the worst cells.

    Each vertex takes Newton steps downhill on the shape energy of the cells around it. Where a
    whole region has to move, Newton steps on all vertices at once take over. Then a wall, steeper
    and steeper, pushes back the corners with the smallest sine, and only these. It stops by itself
    when nothing more is gained.

    The result is never worse than the input in smallest angle, largest angle and smallest scaled
    Jacobian, nor in what `hold` adds: no move is taken that makes a corner or cell worse than the
    worst was. The worst cells may cost a share `mean_loss` of the best mean quality; what else got
    worse, and for what, the outcome says. An invalid mesh is untangled first; then the untangled
    mesh is what counts. A metric asks for angles of its own: towards it only validity is kept, and
    what `hold` lists, and there are no worst cells to see to. The history has a record for each
    round of ten sweeps.

    In Python the target may also be an array: ratios of sides, (n_cells,), of sides 0 and 2 over
    sides 1 and 3 in the caller's order, for quads only; or metric tensors in 1/length²,
    (n_vertices, 2, 2), symmetric and positive definite, in the coordinates of `mesh.xy`: edges e
    with eᵀ M e = 1 are as long as is meant. Or a function of places that gives such tensors,
    (k, 2) → (k, 2, 2), which is asked again where the cells have come to.

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
    objective: Literal["shape", "shape-size"] | None = option(
        None,
        default_words="by target",
        help="What the mean is of: the shape of cells as `target` has it; shape-size adds their "
        "area, and is the default for the target initial and for metrics.",
    )
    size_weight: float = option(
        1.0, within="[0, inf)", help="Weight of the area with the objective shape-size."
    )
    worst: bool = option(True, help="Whether to see to the worst cells too, or only to the mean.")
    stop_quality: float | None = option(
        None, within="(0, 1]", help="Smallest scaled Jacobian at which it may stop."
    )
    hold: Any = option(
        (),
        metavar="FIGURES",
        default_words="none",
        parse=parse_hold,
        help="What must not get worse besides the angles and the scaled Jacobian, of aspect_ratio, "
        "shape and min_edge, with commas between (in Python also a list).",
    )
    target: Any = opaque(
        "auto",
        metavar="TARGET",
        parse=parse_target,
        help="What cells are meant to be: auto, what the mesh says; ideal, squares and equilateral "
        "triangles; initial, their own size and ratio with right angles (in Python also ratios of "
        "sides, or a metric).",
    )
    mean_loss: float = option(
        MEAN_LOSS,
        within="[0, 1)",
        help="Share of the best mean shape that the worst cells may cost. Up to 0.1, "
        "in isotropic meshes, at least what the input had is left.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "hold", parse_hold(self.hold))
        object.__setattr__(self, "target", parse_target(self.target))

    def run(self, mesh: Mesh, chosen: str = "", meant: Meant | None = None) -> SmoothResult:
        """Go through the stages, and sum up; what cells are `meant` to be may be known."""
        if not isinstance(self.target, str):
            self._given(mesh, mesh.xy)  # what does not fit the mesh is told of before all else
        return super().run(mesh, chosen, meant)

    def stages(self, ground: Ground, before: Quality, progress: Progress) -> _Found:
        """Untangle, improve the mean, mend the worst cells; keep the best that was seen."""
        inside = ground.inside
        xy = inside.at_vertices(inside.mesh.xy)
        if not self.max_sweeps:
            progress.spent()  # notes that no sweep is why it stops
            return _Found(xy)
        lanes = ground.lanes
        given = xy.copy() if before.n_invalid else xy  # untangling may move more than is invalid
        if before.n_invalid:
            progress.watch.set_up()
            with progress.stage(Aim.UNTANGLE):
                untangle(ground, xy, progress)
        lanes.caps.hold(xy, self.hold, angles=not self.by_metric)
        start = xy
        with progress.stage(Aim.MEAN_SHAPE):
            meant = ground.meant
            if meant is None:
                few = before.n_invalid <= FEW_INVALID * lanes.topology.n_cells
                meant = self.read(inside, given, given if few else xy)
            progress.watch.set_up()
            best, xy = self._improved(lanes, inside, xy, meant, progress)
        by_walls = self.worst and not self.by_metric
        if by_walls and not (best.good_enough() or self._nothing_to_gain(lanes, best)):
            with progress.stage(Aim.WORST_CELLS):
                mend_worst(lanes, xy, best, progress)
        best.settle()
        self._land(ground, start, best)
        targets = lanes.targets
        was, now = self._towards(lanes, inside, start), self._towards(lanes, inside, best.xy)
        return _Found(
            best.xy,
            best.good_enough(),
            best.forbidden,
            self._kept(lanes, start, best, progress),
            start=start,
            target=Target(
                kind=targets.kind,
                before=was,
                after=now,
                ideal_before=exact_mean(lanes.quality(start).shape),
                ideal_after=exact_mean(lanes.quality(best.xy).shape),
            ),
            layers=float(targets.is_layer.mean()),
        )

    def _land(self, ground: Ground, start: FloatArray, best: Best) -> None:
        """Put sliding vertices where a function that is the curve has them, within what is held."""
        if ground.slider is None or ground.slider.chains.project is None:
            return
        caps, xy = ground.lanes.caps, best.xy.copy()
        caps.hold(xy if best.good_enough() else start, self.hold, angles=not self.by_metric)
        land(ground.slider, xy, caps.forbidden)
        best.take(xy)

    def _kept(
        self, lanes: Lanes, start: FloatArray, best: Best, progress: Progress
    ) -> tuple[Held, ...]:
        """Say where what is held kept a run that was not cut short from something better."""
        from qsmooth.kernels.newton_sweep import Wall

        if progress.stop is not None or best.good_enough() or self._nothing_to_gain(lanes, best):
            return ()
        lanes.caps.hold(start, self.hold, angles=not self.by_metric)
        threshold = (
            LAST_WALL * lanes.largest_badness(best.xy, finite=False) if self.worst else np.inf
        )
        held = kept_from_better(lanes, best.xy, Wall(1.0, threshold, 6))
        if not held and np.array_equal(best.xy, start):
            # Nothing has moved at all: then what keeps the mean from getting better is the reason.
            held = kept_from_better(lanes, best.xy, Wall(1.0, np.inf, 6))
        return held

    def _towards(self, lanes: Lanes, inside: Inside, xy: FloatArray) -> float:
        """Mean quality of coordinates towards what is meant; a function is asked where they are."""
        if callable(self.target):
            lanes.aim_at(self._asked_again(inside, xy))
        return exact_mean(1.0 / lanes.worst_shape(xy))

    @property
    def by_metric(self) -> bool:
        """Whether a metric says what is meant: it asks for angles of its own."""
        return not isinstance(self.target, str) and (callable(self.target) or self.target.ndim == 3)

    def _improved(
        self,
        lanes: Lanes,
        inside: Inside,
        start: FloatArray,
        meant: Meant,
        progress: Progress,
    ) -> tuple[Best, FloatArray]:
        """Improve the mean towards what the mesh is meant to be; where two readings of that differ,
        the one that comes nearer to squares and equilateral triangles is taken.
        """
        runs = []
        for targets in meant.readings:
            targets = targets_inside(targets, inside)
            best, xy = self._aimed(lanes, targets, start, progress, meant.isotropic)
            runs.append((best.figures.plain_shape, targets, best, xy))
            if best.figures.plain_shape * CLEARLY >= 1.0 or progress.spent():
                break  # no other can be so much better, or there is no time to try
        if callable(self.target):
            for _ in range(ASKINGS):
                _, old, best, xy = runs[-1]
                new = self._asked_again(inside, best.xy)
                if progress.spent() or _change(old, new) < ASKED:
                    break
                best, xy = self._aimed(lanes, new, best.xy, progress)
                runs = [(best.figures.plain_shape, new, best, xy)]
        plain, *others = runs
        chosen = plain
        for other in others:
            if other[0] >= CLEARLY * plain[0]:
                chosen = other
        lanes.aim_at(chosen[1])
        return chosen[2], chosen[3]

    def _aimed(
        self,
        lanes: Lanes,
        targets: Targets,
        start: FloatArray,
        progress: Progress,
        keep_mean: bool = False,
    ) -> tuple[Best, FloatArray]:
        """Improve the mean towards these targets."""
        lanes.aim_at(targets)
        xy = start.copy()
        best = Best(
            lanes,
            xy,
            progress,
            mean_loss=self.mean_loss,
            enough=self.stop_quality,
            keep_mean=keep_mean,
        )
        if not self._nothing_to_gain(lanes, best):
            improve_mean(lanes, xy, best, progress, worst=self.worst)
        return best, xy

    def _nothing_to_gain(self, lanes: Lanes, best: Best) -> bool:
        """Whether even perfect cells would not be worth moving a vertex for."""
        if self.by_metric or best.given.n_invalid:
            return False
        angle = 90.0 if lanes.topology.n_quads else 60.0
        perfect = replace(
            best.given, free_jacobian=1.0, shape=1.0, least_shape=1.0, low_angle=angle
        )
        return perfect.gain(best.given) < LEAST_GAIN

    def read(self, inside: Inside, given: FloatArray, mended: FloatArray) -> Meant:
        """What cells may be meant to be, plain first, then learned where that differs.

        They are learned of the mesh as it was given, or mended where too much of it is invalid; in
        the caller's order, as sums over the whole mesh are among them.
        """
        mesh, xy = inside.mesh, inside.back(mended)
        if not isinstance(self.target, str):
            return Meant([self._given(mesh, xy)], False)
        if self.target == "initial":
            return Meant([self._sized(mesh, initial(mesh.topology, xy), xy)], False)
        valid = None if mended is given else xy
        plain, learned = candidates(mesh.topology, inside.back(given), valid)
        isotropic = learned is plain and plain.kind == "ideal"
        found = [plain] if learned is plain else [plain, learned]
        if self.target == "ideal":
            found = [ideal(mesh.topology)]
        return Meant([self._sized(mesh, targets, xy) for targets in found], isotropic)

    def _asked_again(self, inside: Inside, xy: FloatArray) -> Targets:
        """Targets of a function at coordinates that are in the order inside."""
        return targets_inside(self._given(inside.mesh, inside.back(xy)), inside)

    def _given(self, mesh: Mesh, xy: FloatArray) -> Targets:
        """Targets from the caller's ratios or metric."""
        if not callable(self.target) and np.ndim(self.target) == 1:
            return self._sized(mesh, from_ratios(mesh, self.target), xy)
        return self._sized(mesh, from_metric(mesh, self.target, xy), xy)

    def _sized(self, mesh: Mesh, targets: Targets, xy: FloatArray) -> Targets:
        """Let sizes count as the objective says."""
        by_size = targets.kind in ("initial", "metric")
        if self.objective == "shape-size" or (self.objective is None and by_size):
            return with_sizes(targets, mesh.topology, xy, self.size_weight)
        return without_sizes(targets) if self.objective == "shape" and by_size else targets

    def finished(self, found: _Found, invalid: Invalid | None) -> Stop:
        """Why it stopped where no limit of the caller was reached."""
        return Stop.STOP_QUALITY if found.good_enough else Stop.SETTLED

    def bounds(self, ground: Ground, result: Mesh, after: Quality) -> object:
        """Limits of the result's angles."""
        xy = ground.inside.at_vertices(result.xy)
        swings = None if ground.slider is None else ground.slider.swings(xy)
        kept = ground.freedom.kept
        return angle_limits(ground.topology, xy, ground.movable, after, kept, swings)


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

    def stages(self, ground: Ground, before: Quality, progress: Progress) -> _Found:
        """Untangle, unless the mesh is valid."""
        xy = ground.inside.at_vertices(ground.inside.mesh.xy)
        if before.n_invalid:
            start = xy.copy()
            progress.watch.set_up()
            with progress.stage(Aim.UNTANGLE):
                untangle(ground, xy, progress)
            if ground.slider is not None:
                slid_there = (xy != start).any(axis=1)
                land(ground.slider, xy, guard(ground.topology, xy), slid_there)
        return _Found(xy)

    def finished(self, found: _Found, invalid: Invalid | None) -> Stop:
        """Why it stopped where what the caller allows was not used up."""
        return Stop.STUCK if invalid is not None and invalid.after else Stop.VALID
