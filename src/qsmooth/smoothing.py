"""Smoothing: the methods, and the driver that sweeps, watches and stops."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.mesh import Mesh, MeshLike, Schedule, as_mesh
from qsmooth.metrics import Quality, Summary, Validity, quality

Guard: TypeAlias = Literal["quality", "clearance"]

# Below this many movable vertices a sweep is over before a second thread has woken up.
PARALLEL_FROM = 20_000
# Quality has stopped improving when, over this many sweeps, neither the smallest nor the largest
# angle got better by this many degrees, nor the mean shape by this much.
PATIENCE = 10
LEAST_ANGLE_GAIN = 0.01
LEAST_SHAPE_GAIN = 1e-4
# The "quality" guard lets a cell get worse only down to this scaled Jacobian.
GOOD_SCALED_JACOBIAN = 0.5


@dataclass(frozen=True)
class SweepRecord:
    """What one sweep did.

    Attributes
    ----------
    largest_move
        Length of the longest move, in the mesh's unit.
    largest_share
        Largest move as a share of its vertex's shortest edge.
    n_moved
        Vertices that moved.
    min_angle, max_angle
        Smallest and largest angle of the mesh afterwards, degrees.
    mean_shape
        Mean of the cells' shape afterwards.
    n_invalid
        Cells that are not valid afterwards.
    """

    largest_move: float
    largest_share: float
    n_moved: int
    min_angle: float
    max_angle: float
    mean_shape: float
    n_invalid: int


@dataclass(frozen=True)
class SmoothResult:
    """A smoothed mesh, and how it came about.

    Attributes
    ----------
    mesh
        The mesh at its new coordinates; connectivity and data are the input's.
    method
        The method's name.
    sweeps
        How many sweeps were made.
    converged
        Whether it stopped by itself: all vertices rest, or quality no longer improves.
    reason
        Why it stopped, and what is left to say, in plain words.
    history
        One record a sweep.
    before, after
        Quality of the input and of the result.
    seconds
        Time of the sweeps, without reading, checking and summing up.
    """

    mesh: Mesh
    method: str
    sweeps: int
    converged: bool
    reason: str
    history: tuple[SweepRecord, ...]
    before: Summary
    after: Summary
    seconds: float

    @property
    def points(self) -> FloatArray:
        """New coordinates, in the shape of the input's."""
        return self.mesh.points


Callback: TypeAlias = Callable[[SweepRecord], None]
# A sweep moves vertices of (n, 2) coordinates in place; it writes each one's length and share.
Sweep: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], None]


@dataclass(frozen=True)
class Method:
    """A smoothing method: its name, its source in words, and which options it has."""

    name: str
    title: str
    options: frozenset[str]
    guarded: bool
    start: Callable[[Mesh, Schedule, _Settings], Sweep]


@dataclass(frozen=True)
class _Settings:
    """Checked options of `smooth`."""

    max_sweeps: int = 50
    rtol: float = 1e-3
    guard: str = "quality"
    max_angle: float = 120.0
    min_angle: float = 60.0
    triangle_max_angle: float = 90.0
    triangle_min_angle: float = 45.0
    step: float = 0.5
    worst_fraction: float = 1.0
    keep_interfaces: bool = True
    threads: int | None = None
    good: float = math.nan

    def __post_init__(self) -> None:
        _require_integer("max_sweeps", self.max_sweeps, 0)
        _require(0.0 <= self.rtol < 1.0, "rtol must be in [0, 1)", self.rtol)
        if self.guard not in ("quality", "clearance"):
            raise ValueError(f"guard must be 'quality' or 'clearance', got {self.guard!r}")
        for prefix in ("", "triangle_"):
            low, high = getattr(self, prefix + "min_angle"), getattr(self, prefix + "max_angle")
            _require(0.0 < low < 180.0, f"{prefix}min_angle must be in (0, 180) degrees", low)
            _require(
                low < high < 180.0,
                f"{prefix}max_angle must be over {prefix}min_angle and below 180 degrees",
                high,
            )
        _require(0.0 < self.step <= 1.0, "step must be in (0, 1]", self.step)
        _require(
            0.0 < self.worst_fraction <= 1.0,
            "worst_fraction must be in (0, 1]",
            self.worst_fraction,
        )
        if self.threads is not None:
            from qsmooth.kernels._jit import available_threads

            most = available_threads()
            _require_integer("threads", self.threads, 1)
            _require(self.threads <= most, f"threads must be at most {most} here", self.threads)


def smooth(
    mesh: MeshLike,
    method: str = "star",
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    max_angle: float = 120.0,
    min_angle: float = 60.0,
    triangle_max_angle: float = 90.0,
    triangle_min_angle: float = 45.0,
    step: float = 0.5,
    worst_fraction: float = 1.0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Make a mesh better by moving its vertices; the cells stay as they are.

    Parameters
    ----------
    mesh
        A `Mesh`, or a pair ``(points, cells)``. It is not changed.
    method
        ``"star"``, ``"quad"``, ``"smart-laplacian"`` or ``"laplacian"``; see `smooth_star` and
        its like. All but the last keep a valid mesh valid after every single move.
    max_sweeps
        Stop here at the latest; the result then has ``converged=False``. 0 or more.
    rtol
        A vertex rests when it moves less than this share of its shortest edge; stop once all do,
        or when quality no longer improves. In [0, 1); 0 runs all sweeps.
    guard
        What every step has to keep: ``"clearance"`` only validity; ``"quality"`` also the star's
        smallest scaled Jacobian, or one of 0.5 (more, where the whole mesh begins with more), so
        that the worst cell never gets worse.
    max_angle, min_angle
        Degrees, 0 < min_angle < max_angle < 180. Corners of quads beyond these are mended.
    triangle_max_angle, triangle_min_angle
        The same for triangles.
    step
        Fraction of each proposed move that is made, in (0, 1].
    worst_fraction
        Share of the cells that propose moves in a sweep, those with the worst largest angles, in
        (0, 1].
    keep_interfaces
        Whether vertices on the line between two regions, or on line cells of the file, stay.
    threads
        How many threads; None chooses by size. The result does not depend on it.
    callback
        Called after each sweep with its `SweepRecord`.

    Returns
    -------
    SmoothResult

    Raises
    ------
    ValueError
        An option outside its range, or one that the method does not have.
    MeshError
        If a pair is no mesh.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}; got {method!r}")
    settings = _Settings(
        max_sweeps=max_sweeps,
        rtol=rtol,
        guard=guard,
        max_angle=max_angle,
        min_angle=min_angle,
        triangle_max_angle=triangle_max_angle,
        triangle_min_angle=triangle_min_angle,
        step=step,
        worst_fraction=worst_fraction,
        keep_interfaces=keep_interfaces,
        threads=threads,
    )
    defaults = _Settings()
    for option in sorted(METHOD_OPTIONS - METHODS[method].options):
        if getattr(settings, option) != getattr(defaults, option):
            raise ValueError(f"method {method!r} has no option {option}")
    return _iterate(as_mesh(mesh), METHODS[method], settings, callback)


def smooth_star(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    max_angle: float = 120.0,
    min_angle: float = 60.0,
    triangle_max_angle: float = 90.0,
    triangle_min_angle: float = 45.0,
    step: float = 0.5,
    worst_fraction: float = 1.0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Smooth vertex by vertex: each goes to the mean of what the cells around it propose.

    Every cell pushes or pulls a corner whose angle is too large or too small, and evens out its
    distances to the neighbouring corners. About twice as fast as `smooth_quad`.

    Parameters, result and errors are those of `smooth`.

    Notes
    -----
    The by-star method of "Quadrilateral Mesh Smoothing".
    """
    return smooth(
        mesh, "star", max_sweeps=max_sweeps, rtol=rtol, guard=guard, max_angle=max_angle,
        min_angle=min_angle, triangle_max_angle=triangle_max_angle,
        triangle_min_angle=triangle_min_angle, step=step, worst_fraction=worst_fraction,
        keep_interfaces=keep_interfaces, threads=threads, callback=callback,
    )  # fmt: skip


def smooth_quad(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    max_angle: float = 120.0,
    min_angle: float = 60.0,
    triangle_max_angle: float = 90.0,
    triangle_min_angle: float = 45.0,
    step: float = 0.5,
    worst_fraction: float = 1.0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Smooth cell by cell: each moves all its corners, and the vertices go to the mean.

    Besides the moves of `smooth_star`, a corner with a bad angle shortens or lengthens its
    diagonal, so that also corners on the boundary are mended, by their neighbours.

    Parameters, result and errors are those of `smooth`.

    Notes
    -----
    The by-quad method of "Quadrilateral Mesh Smoothing".
    """
    return smooth(
        mesh, "quad", max_sweeps=max_sweeps, rtol=rtol, guard=guard, max_angle=max_angle,
        min_angle=min_angle, triangle_max_angle=triangle_max_angle,
        triangle_min_angle=triangle_min_angle, step=step, worst_fraction=worst_fraction,
        keep_interfaces=keep_interfaces, threads=threads, callback=callback,
    )  # fmt: skip


def smooth_smart_laplacian(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Move each vertex towards the mean of its neighbours, as far as no cell suffers.

    Parameters, result and errors are those of `smooth`.
    """
    return smooth(
        mesh, "smart-laplacian", max_sweeps=max_sweeps, rtol=rtol, guard=guard,
        keep_interfaces=keep_interfaces, threads=threads, callback=callback,
    )  # fmt: skip


def smooth_laplacian(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Move all vertices to the mean of their neighbours at once, unguarded.

    The baseline that everybody knows: cheap, and good on convex domains; near a re-entrant corner
    it inverts cells, and the result says how many.

    Parameters, result and errors are those of `smooth`.
    """
    return smooth(
        mesh, "laplacian", max_sweeps=max_sweeps, rtol=rtol,
        keep_interfaces=keep_interfaces, threads=threads, callback=callback,
    )  # fmt: skip


def _start_star(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.star import star_sweep

    limit, active = _limits(settings), _Active(mesh, settings)

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        star_sweep(
            xy, schedule.colour_offsets, schedule.vertices, schedule.offsets, schedule.corners,
            schedule.cells, active(xy), limit, float(settings.step), settings.good,
            schedule.largest_star, moves, shares,
        )  # fmt: skip

    return sweep


def _start_quad(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.quad import guarded_commit, quad_proposals

    limit, active = _limits(settings), _Active(mesh, settings)
    wanted = np.empty((schedule.vertices.size, 2))

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        quad_proposals(
            xy, schedule.vertices, schedule.offsets, schedule.corners, schedule.cells, active(xy),
            limit, float(settings.step), schedule.largest_star, wanted,
        )  # fmt: skip
        guarded_commit(
            xy, schedule.colour_offsets, schedule.vertices, schedule.offsets, schedule.corners,
            wanted, settings.good, schedule.largest_star, moves, shares,
        )  # fmt: skip

    return sweep


def _start_laplacian(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.laplacian import laplacian_sweep

    rings = mesh.ring_offsets, mesh.ring_vertices
    previous = np.empty((mesh.n_vertices, 2))

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        previous[:] = xy
        laplacian_sweep(previous, *rings, schedule.vertices, xy, moves, shares)

    return sweep


def _start_smart_laplacian(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.laplacian import smart_laplacian_sweep

    rings = mesh.ring_offsets, mesh.ring_vertices

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        smart_laplacian_sweep(
            xy, *rings, schedule.colour_offsets, schedule.vertices, schedule.offsets,
            schedule.corners, settings.good, moves, shares,
        )  # fmt: skip

    return sweep


_SWEEPING = frozenset({"max_sweeps", "rtol", "keep_interfaces", "threads"})
_ANGLES = frozenset(
    {"max_angle", "min_angle", "triangle_max_angle", "triangle_min_angle", "step", "worst_fraction"}
)
METHODS = {
    method.name: method
    for method in (
        Method("star", "By star", _SWEEPING | _ANGLES | {"guard"}, True, _start_star),
        Method("quad", "By quad", _SWEEPING | _ANGLES | {"guard"}, True, _start_quad),
        Method("laplacian", "Laplacian", _SWEEPING, False, _start_laplacian),
        Method(
            "smart-laplacian",
            "Smart Laplacian",
            _SWEEPING | {"guard"},
            True,
            _start_smart_laplacian,
        ),
    )
}
METHOD_OPTIONS = _SWEEPING | _ANGLES | {"guard"}


class _Active:
    """Which cells make proposals in a sweep: those with the worst largest angles."""

    def __init__(self, mesh: Mesh, settings: _Settings) -> None:
        self._mesh = mesh
        self._count = math.ceil(settings.worst_fraction * mesh.n_cells)
        self._active = np.ones(mesh.n_cells, np.bool_)

    def __call__(self, xy: FloatArray) -> BoolArray:
        if self._count < self._mesh.n_cells:
            from qsmooth.kernels.cell_metrics import angles

            smallest, largest = np.empty(self._mesh.n_cells), np.empty(self._mesh.n_cells)
            angles(xy, self._mesh.cell_offsets, self._mesh.cell_vertices, smallest, largest)
            self._active[:] = False
            self._active[np.argsort(-largest, kind="stable")[: self._count]] = True
        return self._active


def _limits(settings: _Settings) -> FloatArray:
    from qsmooth.kernels.moves import thresholds

    return thresholds(
        settings.max_angle,
        settings.min_angle,
        settings.triangle_max_angle,
        settings.triangle_min_angle,
    )


def _iterate(
    mesh: Mesh, method: Method, settings: _Settings, callback: Callback | None
) -> SmoothResult:
    """Sweep until every vertex rests, quality no longer improves, or `max_sweeps` is reached."""
    from qsmooth.kernels._jit import available_threads, use_threads

    before_quality = quality(mesh)
    before = before_quality.summary()
    schedule = mesh._topology.schedule(settings.keep_interfaces)
    n_movable = schedule.vertices.size
    threads = settings.threads
    if threads is None:
        threads = available_threads() if n_movable >= PARALLEL_FROM else 1
    if settings.guard == "quality":
        good = max(GOOD_SCALED_JACOBIAN, before.worst["scaled_jacobian"])
        object.__setattr__(settings, "good", float(good))
    xy = mesh.xy.copy()
    moves, shares = np.zeros(n_movable), np.zeros(n_movable)
    history: list[SweepRecord] = []
    stop = "" if n_movable else "no vertex can move: all are on the boundary, fixed or in no cell"
    sweep = method.start(mesh, schedule, settings)
    seconds = 0.0
    with use_threads(threads):
        while not stop and len(history) < settings.max_sweeps:
            start = time.perf_counter()
            sweep(xy, moves, shares)
            seconds += time.perf_counter() - start
            history.append(_record(mesh, xy, moves, shares))
            if callback is not None:
                callback(history[-1])
            stop = _why_stop(history, settings.rtol)
    result = _stored(mesh, xy) if method.guarded else mesh._with_xy(xy, _moved(mesh, xy))
    after = quality(result).summary()
    return SmoothResult(
        mesh=result,
        method=method.name,
        sweeps=len(history),
        converged=bool(stop),
        reason=_reason(stop, history, method, before, after),
        history=tuple(history),
        before=before,
        after=after,
        seconds=seconds,
    )


def _record(mesh: Mesh, xy: FloatArray, moves: FloatArray, shares: FloatArray) -> SweepRecord:
    now = Quality(mesh._at_xy(xy))
    return SweepRecord(
        largest_move=float(moves.max()),
        largest_share=float(shares.max()),
        n_moved=int((moves > 0.0).sum()),
        min_angle=float(now.min_angle.min()),
        max_angle=float(now.max_angle.max()),
        mean_shape=float(now.shape.mean()),
        n_invalid=now.n_invalid,
    )


def _why_stop(history: list[SweepRecord], rtol: float) -> str:
    """Why to stop now, or an empty string."""
    last = history[-1]
    if rtol == 0.0:
        return ""
    if last.largest_share <= rtol:
        return f"every vertex rests: none moved by over {rtol:.3g} of its shortest edge"
    if len(history) <= PATIENCE:
        return ""
    past, recent = history[:-PATIENCE], history[-PATIENCE:]
    gained = (
        max(r.min_angle for r in recent) > max(r.min_angle for r in past) + LEAST_ANGLE_GAIN
        or min(r.max_angle for r in recent) < min(r.max_angle for r in past) - LEAST_ANGLE_GAIN
        or max(r.mean_shape for r in recent) > max(r.mean_shape for r in past) + LEAST_SHAPE_GAIN
    )
    return "" if gained else f"quality has not improved for {PATIENCE} sweeps"


def _reason(
    stop: str, history: list[SweepRecord], method: Method, before: Summary, after: Summary
) -> str:
    """Say in words why it stopped and what is wrong with the result."""
    if stop:
        parts = [stop]
    elif not history:
        parts = ["no sweep was asked for"]
    else:
        parts = [
            f"stopped after {len(history)} sweeps, as max_sweeps says; vertices still moved by "
            f"up to {100.0 * history[-1].largest_share:.2g} % of their shortest edge"
        ]
    if before.n_invalid:
        parts.append(
            f"the mesh was not valid ({_cells(before.n_invalid)} of {before.n_cells} invalid) and "
            f"{method.name} does not untangle: {_cells(after.n_invalid)} invalid now"
        )
    elif after.n_invalid:
        parts.append(f"{method.name} is unguarded: it made {_cells(after.n_invalid)} invalid")
    return "; ".join(parts)


def _cells(n: int) -> str:
    return f"{n} cell" if n == 1 else f"{n} cells"


def _moved(mesh: Mesh, xy: FloatArray) -> BoolArray:
    moved: BoolArray = (xy != mesh.xy).any(axis=1)
    return moved


def _stored(mesh: Mesh, xy: FloatArray) -> Mesh:
    """Give the mesh its new coordinates, certified as they are stored.

    In x and y what was certified is what is stored. Points of a tilted plane are rounded once
    more: where that costs a corner, by a hair, the cell's vertices go back to where they were.
    """
    moved = _moved(mesh, xy)
    result = mesh._with_xy(xy, moved)
    if mesh._frame is None:
        return result
    was_valid = quality(mesh).validity == Validity.VALID
    while True:
        lost = was_valid & (quality(result).validity != Validity.VALID)
        if not lost.any():
            return result
        vertices = mesh.cell_vertices[np.repeat(lost, np.diff(mesh.cell_offsets))]
        moved[vertices] = False
        result = mesh._with_xy(xy, moved)


def _require(condition: bool, what: str, value: object) -> None:
    if not condition:
        raise ValueError(f"{what}, got {value}")


def _require_integer(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} must be an integer of {least} or more, got {value!r}")
