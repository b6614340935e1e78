"""The driver of methods that sweep: sweeps, watches, keeps the history and stops."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.constraints import Freedom
from qsmooth.engine import Colours, engine_for
from qsmooth.kernels.compiling import clock
from qsmooth.kernels.rails import FREE, Rails
from qsmooth.kernels.stars import Moves, Stars
from qsmooth.landing import guard, land, slid
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.methods.watching import Watch
from qsmooth.metrics import Quality, Validity, quality
from qsmooth.numbering import Inside
from qsmooth.options import OptionError, option
from qsmooth.outcome import Aim, Cut, Invalid, Outcome, Stage, Stop
from qsmooth.parts import Glance, Moved, Part, moved_by
from qsmooth.result import History, SmoothResult, SweepRecord
from qsmooth.sliding import Slides, slider_of
from qsmooth.split import Diagonal, split_quads
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from qsmooth.kernels.blocks import Blocks

# Quality has stopped improving when, over this many sweeps, neither the smallest nor the largest
# angle got better by this many degrees, nor the mean shape by this much.
PATIENCE = 10
LEAST_ANGLE_GAIN = 0.01
LEAST_SHAPE_GAIN = 1e-4
# The "quality" guard lets a cell get worse only down to this scaled Jacobian.
GOOD_SCALED_JACOBIAN = 0.5
# Degrees of longitude that a cell spans at most to be held valid in degrees, too: next to a pole
# they say nothing of its shape.
MOST_SPAN = 10.0


def _nothing(xy: FloatArray) -> None:
    pass


@dataclass(frozen=True)
class Sweep:
    """One sweep of a method, as an engine runs it.

    Attributes
    ----------
    n_colours
        Groups of vertices that move one after the other; 1 where all move at once.
    move
        Moves the vertices of a range of colours in the (n, 2) coordinates, in place, and writes
        the moves.
    prepare
        Called with the coordinates before the first colour of a sweep.
    """

    n_colours: int
    move: Callable[[FloatArray, Colours, Moves], None]
    prepare: Callable[[FloatArray], None] = _nothing


@dataclass
class Setting:
    """What the driver found out before the first sweep.

    Attributes
    ----------
    topology, stars
        Of the mesh that is swept: with its quads cut in two, if that is asked for.
    good
        Scaled Jacobian down to which a cell may get worse; NaN without the ``"quality"`` guard. A
        session sets it anew for each step.
    selected : (n_cells,) or None
        Cells that take part; None for all.
    aim
        Which group of cells proposes moves.
    rails
        Where the vertices may be.
    slides
        Sweeps over the vertices that slide; None where none does.
    complete
        Fills in where the vertices have come to that other processes sweep, (n_vertices, 2), in
        place: before one looks farther than the cells around those of `stars`.
    """

    topology: Topology
    stars: Stars
    good: float
    selected: BoolArray | None
    aim: Aim = Aim.ALL_CELLS
    rails: Rails = FREE
    slides: Slides | None = None
    complete: Callable[[FloatArray], None] = _nothing

    @cached_property
    def blocks(self) -> Blocks:
        """The movable vertices in blocks of lanes; of a session, those that are awake."""
        return self.topology.blocks(self.stars)._replace(rails=self.rails)

    @property
    def n_colours(self) -> int:
        """Colours of the movable vertices."""
        return self.stars.colour_offsets.size - 1


@dataclass(frozen=True, kw_only=True)
class SweepingMethod(Method):
    """A method that repeats one sweep until every vertex rests or quality no longer improves."""

    rtol: float = option(
        1e-3,
        within="[0, 1)",
        help="A vertex rests when it moves less than this share of its shortest edge; stop when "
        "all rest or quality no longer improves. 0 makes all sweeps.",
    )
    split_quads: bool | Literal["shorter", "first", "second"] = option(
        False,
        help="Cut each quad in two triangles along this diagonal (in Python True: the shorter) and "
        "smooth these; only they are guarded.",
    )

    def start(self, setting: Setting) -> Sweep:
        """Set up a sweep; for derived classes."""
        raise NotImplementedError

    @property
    def quality_guard(self) -> bool:
        """Whether no cell may get worse, below `GOOD_SCALED_JACOBIAN`."""
        return False

    @property
    def diagonal(self) -> Diagonal:
        """Along which quads are cut."""
        return cast("Diagonal", "shorter" if self.split_quads is True else self.split_quads)

    def stages(self) -> list[tuple[Aim, int]]:
        """List which group of cells proposes moves, and for how many sweeps at most."""
        return [(Aim.ALL_CELLS, self.max_sweeps)]

    def run(self, mesh: Mesh, chosen: str = "") -> SmoothResult:
        """Sweep until every vertex rests, quality no longer improves, or no more is allowed."""
        watch = Watch(self)
        inside = Inside(mesh, kept=not self.max_sweeps)
        before = inside.quality(mesh)
        freedom, cut = self.freedom(mesh), self.cut(mesh)
        swept = inside if cut is mesh else Inside(cut, inside, kept=not self.max_sweeps)
        selected = freedom.cells
        if selected is not None and cut is not mesh:
            selected = np.repeat(selected, mesh.topology.cell_sizes - 2)
        topology = swept.topology
        run = _Run(self, inside.topology, inside.at_vertices(mesh.xy), before, watch)
        engine = None
        if freedom.n_movable:
            engine = engine_for(self.threads, freedom.n_movable, inside, self.team)
        slider = None
        if engine is not None and self.max_sweeps:
            free = freedom.inside(inside)
            slider = slider_of(free, cut, swept)
            stars = topology.schedule_of(free.movable if slider is None else slider.others(free))
            good = worst = math.nan
            if self.quality_guard:
                measured = swept.quality(cut) if cut is not mesh else before
                worst = float(measured.scaled_jacobian.min())
                good = self.good(worst)
            cells = swept.chosen_cells(selected)
            slides = None if slider is None else Slides(slider, worst)
            watch.set_up()
            with engine.running():
                part = engine.part(topology, stars, inside.topology)
                setting = Setting(
                    topology, part.stars, good, cells,
                    rails=free.rails(), slides=slides, complete=part.complete,
                )  # fmt: skip
                for aim, n_sweeps in self.stages():
                    run.stage(replace(setting, aim=aim), part, n_sweeps)
            if slider is not None:
                land(slider, run.xy, guard(topology, run.xy, worst))
        elif engine is not None:
            run.stop = Stop.MAX_SWEEPS
        xy = inside.back(run.xy)
        if cut is mesh or not self.guards:
            result = stored(mesh, xy, freedom, guarded=self.guards)
        else:
            points = stored(cut, xy, freedom).points
            result = mesh if points is mesh.points else mesh.with_points(points)
        after = before if result is mesh else inside.quality(result)
        summed_up = SmoothResult(
            mesh=result,
            outcome=run.outcome(
                method=self.name,
                chosen=chosen,
                guarded=self.guards,
                selected=self.selection is not None,
                unchanged=result is mesh or np.array_equal(result.points, mesh.points),
                sliding=slid(freedom, mesh, result, slider),
                invalid=invalid_cells(before, after),
                cut=None
                if cut is mesh
                else Cut(
                    quads=int((mesh.topology.cell_sizes == 4).sum()),
                    diagonal=self.diagonal,
                    broken=_count_broken(before, after),
                ),
            ),
            history=History(run.history),
            quality_before=before,
            quality_after=after,
            seconds=run.seconds,
            freedom=freedom,
        )
        return watch.give_back(summed_up)

    def cut(self, mesh: Mesh) -> Mesh:
        """Return the mesh that is swept: with its quads cut in two, if that is asked for."""
        if self.split_quads is not False and (mesh.topology.cell_sizes == 4).any():
            return split_quads(mesh, self.diagonal)
        if reason := self.why_not(mesh):
            raise OptionError(reason)
        return mesh

    def good(self, worst: float) -> float:
        """Scaled Jacobian down to which a cell may get worse, of a mesh whose smallest is `worst`.

        NaN without that guard.
        """
        return max(GOOD_SCALED_JACOBIAN, worst) if self.quality_guard else math.nan


@dataclass(frozen=True, kw_only=True)
class GuardedMethod(SweepingMethod):
    """A sweeping method whose every move keeps valid cells valid."""

    guard: Literal["quality", "clearance"] = option(
        "quality",
        help="What every move keeps: clearance, that valid cells stay valid; quality, also that "
        "the worst cell does not get worse.",
    )

    @property
    def quality_guard(self) -> bool:
        """Whether no cell may get worse, below `GOOD_SCALED_JACOBIAN`."""
        return self.guard == "quality"


class _Run:
    """The sweeps of one call: coordinates, history, clock, and why they stopped."""

    def __init__(
        self,
        method: SweepingMethod,
        topology: Topology,
        xy: FloatArray,
        before: Quality,
        watch: Watch,
    ) -> None:
        self.method, self.topology, self.xy, self.watch = method, topology, xy, watch
        self.history: list[SweepRecord] = []
        self.stages: list[Stage] = []
        self.seconds = 0.0
        self.stop: Stop | None = Stop.NOTHING_MOVES
        self._start = record_of(before)

    def stage(self, setting: Setting, part: Part, n_sweeps: int) -> None:
        """Sweep so often at most."""
        if self.stop in (Stop.TIME_LIMIT, Stop.CALLBACK):
            return
        n_free, slides = setting.stars.vertices.size, setting.slides
        n_slides = 0 if slides is None else slides.slider.vertices.size
        moves = Moves(np.zeros(n_free), np.zeros(n_free))
        slid = Moves(np.zeros(n_slides), np.zeros(n_slides))
        sweep = self.method.start(setting)
        first, seconds = len(self.history), self.seconds
        self.stop = None
        while self.stop is None and len(self.history) < first + n_sweeps:
            started = clock()
            sweep.prepare(self.xy)
            part.sweep(
                lambda colours: sweep.move(self.xy, colours, moves), sweep.n_colours, self.xy
            )
            if slides is not None:
                part.complete(self.xy)
                slides.sweep(self.xy, slid.lengths)
                slides.slider.shares(self.xy, *slid)
            self.seconds += clock() - started
            moved = part.moved(*moves).together(moved_by(*slid))
            self.history.append(record(part.glance(self.topology, self.xy), moved))
            self.watch.tell(self.history[-1])
            self.stop = self._why_stop(self.history[first:])
        part.complete(self.xy)
        past = self.history[first - 1] if first else self._start
        self.stages.append(
            Stage(
                aim=setting.aim,
                sweeps=len(self.history) - first,
                seconds=self.seconds - seconds,
                gain=gain(past, self.history[-1] if self.history else self._start),
            )
        )

    def _why_stop(self, records: list[SweepRecord]) -> Stop | None:
        if (cut_short := self.watch.stop()) is not None:
            return cut_short
        if self.method.rtol == 0.0:
            return None
        if records[-1].largest_share <= self.method.rtol:
            return Stop.RESTS
        return None if _improves(records) else Stop.SETTLED

    def outcome(self, **known: Any) -> Outcome:
        """Sum up."""
        stop = Stop.MAX_SWEEPS if self.stop is None else self.stop
        stop_at = {
            Stop.RESTS: self.method.rtol,
            Stop.MAX_SWEEPS: self.method.max_sweeps,
            Stop.TIME_LIMIT: self.method.time_limit,
        }.get(stop)
        return Outcome(
            stop=stop,
            stop_at=math.nan if stop_at is None else float(stop_at),
            stages=tuple(self.stages),
            largest_share=self.history[-1].largest_share if self.history else 0.0,
            **known,
        )


def record_of(before: Quality) -> SweepRecord:
    """Note how a mesh is before the first sweep."""
    return record(before, Moved(0.0, 0.0, 0))


def record(now: Quality | Glance, moved: Moved) -> SweepRecord:
    """Note what a sweep did."""
    smallest, largest = now.extreme_angles
    return SweepRecord(
        largest_move=moved.largest,
        largest_share=moved.largest_share,
        n_moved=moved.vertices,
        min_angle=smallest,
        max_angle=largest,
        mean_shape=now.mean_shape,
        n_invalid=now.n_invalid,
    )


def gain(past: SweepRecord, now: SweepRecord) -> dict[str, float]:
    """By how much the figures of a record have grown."""
    names = ("min_angle", "max_angle", "mean_shape", "n_invalid")
    return {name: getattr(now, name) - getattr(past, name) for name in names}


def invalid_cells(before: Quality, after: Quality) -> Invalid | None:
    """Count the invalid cells; None where there were none and are none."""
    if not before.n_invalid and not after.n_invalid:
        return None
    bad = after.validity != Validity.VALID
    return Invalid(
        before=before.n_invalid,
        after=after.n_invalid,
        first=int(np.argmax(bad)) if after.n_invalid else -1,
    )


def _count_broken(before: Quality, after: Quality) -> int:
    """Count the cells that were valid and are not."""
    broken = (before.validity == Validity.VALID) & (after.validity != Validity.VALID)
    return int(broken.sum())


def moved(mesh: Mesh, xy: FloatArray) -> BoolArray:
    """Mark the vertices that are elsewhere now, (n_vertices,)."""
    marked: BoolArray = (xy != mesh.xy).any(axis=1)
    return marked


def stored(
    mesh: Mesh, xy: FloatArray, freedom: Freedom | None = None, *, guarded: bool = True
) -> Mesh:
    """Give the mesh its new coordinates, certified as they are stored, unless it is not guarded.

    In x and y what was certified is what is stored. Points of a tilted plane, and those in
    degrees, are rounded once more, and edges that are straight in degrees are curved on the map:
    where that costs a corner, by a hair, the cell's vertices go back to where they were, and so do
    those that it takes beyond their reach.
    """
    marked = moved(mesh, xy)
    result = mesh.with_xy(xy, marked)
    if (mesh.plane is None and mesh.projection is None) or result is mesh:
        return result
    were_valid = _valid_in_each_plane(mesh) if guarded else []
    while True:
        lost = np.zeros(mesh.n_cells, np.bool_)
        for was, now in zip(were_valid, _valid_in_each_plane(result), strict=False):
            lost |= was & ~now
        beyond = np.zeros_like(marked)
        if freedom is not None:
            moves = result.points - mesh.points if mesh.projection is None else result.xy - mesh.xy
            beyond = marked & freedom.beyond(moves)
        if not (lost.any() or beyond.any()):
            return result
        marked[mesh.cell_vertices[np.repeat(lost, mesh.topology.cell_sizes)]] = False
        marked &= ~beyond
        result = mesh.with_xy(xy, marked)


def _valid_in_each_plane(mesh: Mesh) -> list[BoolArray]:
    """Mark the valid cells as they are measured and, if other, in degrees."""
    found = [quality(mesh).validity == Validity.VALID]
    if mesh.projection is not None:
        found.append(valid_in_degrees(mesh, mesh.points))
    return found


def valid_in_degrees(mesh: Mesh, points: FloatArray) -> BoolArray:
    """Mark the cells that are valid where straight edges are straight in degrees, (n_cells,).

    Those around a pole or the globe, which are no cells in degrees, count as valid.

    Parameters
    ----------
    mesh
        Of longitudes and latitudes.
    points : (n_vertices, 2) or (n_vertices, 3)
        Where its vertices are.
    """
    assert mesh.projection is not None
    degrees = mesh.projection.unrolled(points)
    longitudes, starts = degrees[mesh.cell_vertices, 0], mesh.cell_offsets[:-1]
    spans = np.maximum.reduceat(longitudes, starts) - np.minimum.reduceat(longitudes, starts)
    valid = Quality(mesh.topology, degrees).validity == Validity.VALID
    return np.asarray(valid | (spans > MOST_SPAN))


def _improves(records: list[SweepRecord]) -> bool:
    """Whether the last sweeps got the mesh better than all before them."""
    if len(records) <= PATIENCE:
        return True
    past, recent = records[:-PATIENCE], records[-PATIENCE:]
    return (
        max(r.min_angle for r in recent) > max(r.min_angle for r in past) + LEAST_ANGLE_GAIN
        or min(r.max_angle for r in recent) < min(r.max_angle for r in past) - LEAST_ANGLE_GAIN
        or max(r.mean_shape for r in recent) > max(r.mean_shape for r in past) + LEAST_SHAPE_GAIN
    )
