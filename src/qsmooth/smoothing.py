"""Smoothing: the methods, and the driver that sweeps, watches and stops."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray
from qsmooth._words import plural
from qsmooth.mesh import Mesh, MeshLike, as_mesh
from qsmooth.metrics import Quality, Summary, Validity, limits, quality
from qsmooth.topology import Schedule

if TYPE_CHECKING:
    from qsmooth.split import Diagonal

Guard: TypeAlias = Literal["quality", "clearance", "none"]
Weights: TypeAlias = Literal["uniform", "area"]
Objective: TypeAlias = Literal["shape"]

# Below this many movable vertices a sweep is over before a second thread has woken up, or waits for
# it on a busy machine (24K vertices, two cores of which one was taken: fifteen times slower).
PARALLEL_FROM = 100_000
# Quality has stopped improving when, over this many sweeps, neither the smallest nor the largest
# angle got better by this many degrees, nor the mean shape by this much.
PATIENCE = 10
LEAST_ANGLE_GAIN = 0.01
LEAST_SHAPE_GAIN = 1e-4
# The "quality" guard lets a cell get worse only down to this scaled Jacobian.
GOOD_SCALED_JACOBIAN = 0.5
# Proposals of the aspect-ratio method are weighted by the edge ratio to this power.
RATIO_POWER = 4.0
# Sweeps at most, unless the caller or the method says otherwise.
SWEEPS = 50


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
    history: tuple[SweepRecord, ...] = field(repr=False)
    before: Summary = field(repr=False)
    after: Summary = field(repr=False)
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
    start: Callable[[Mesh, Schedule, _Settings], Sweep] | None  # None: it has a driver of its own
    step: float = 0.25  # the default
    max_sweeps: int = SWEEPS  # the default


@dataclass(frozen=True)
class _Settings:
    """Checked options of `smooth`."""

    max_sweeps: int = SWEEPS
    rtol: float = 1e-3
    guard: str = "quality"
    max_angle: float = 120.0
    min_angle: float = 60.0
    triangle_max_angle: float = 90.0
    triangle_min_angle: float = 45.0
    step: float = 0.25
    worst_fraction: float = 1.0
    worst_first: bool = False
    bad_angle: float = 180.0
    bad_step: float | None = None
    max_edge_ratio: float = 1.2
    weights: str = "uniform"
    split_quads: bool | str = False
    selection: Any = None
    selection_rings: int = 0
    objective: str = "shape"
    worst: bool = True
    target_quality: float | None = None
    time_limit: float | None = None
    mean_loss: float = 0.1
    keep_interfaces: bool = True
    threads: int | None = None
    # What the driver finds out: see `allowed_step`, `_Pace`.
    good: float = math.nan
    group: str = "all"
    selected: BoolArray | None = None

    @property
    def diagonal(self) -> Diagonal:
        """Along which quads are cut."""
        return cast("Diagonal", "shorter" if self.split_quads is True else self.split_quads)

    def __post_init__(self) -> None:
        for name, default in vars(_Settings).items():
            value = getattr(self, name, None)
            if isinstance(default, float) and not _is_number(value):
                raise ValueError(f"{name} must be a number, got {value!r}")
            if isinstance(default, bool) and name != "split_quads" and not isinstance(value, bool):
                raise ValueError(f"{name} must be True or False, got {value!r}")
        for name in ("bad_step", "target_quality", "time_limit"):
            if getattr(self, name) is not None and not _is_number(getattr(self, name)):
                raise ValueError(f"{name} must be a number, got {getattr(self, name)!r}")
        _require_integer("max_sweeps", self.max_sweeps, 0)
        _require(0.0 <= self.rtol < 1.0, "rtol must be in [0, 1)", self.rtol)
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
        if self.worst_first and self.worst_fraction == 1.0:
            raise ValueError("worst_first needs a worst_fraction below 1")
        _require(
            0.0 < self.bad_angle < 360.0, "bad_angle must be in (0, 360) degrees", self.bad_angle
        )
        if self.bad_step is not None:
            _require(0.0 < self.bad_step <= 2.0, "bad_step must be in (0, 2]", self.bad_step)
        _require(
            1.0 <= self.max_edge_ratio < math.inf,
            "max_edge_ratio must be 1 or more",
            self.max_edge_ratio,
        )
        if self.weights not in ("uniform", "area"):
            raise ValueError(f"weights must be 'uniform' or 'area', got {self.weights!r}")
        if self.split_quads not in (False, True, "shorter", "first", "second"):
            raise ValueError(
                "split_quads must be True, False, 'shorter', 'first' or 'second', "
                f"got {self.split_quads!r}"
            )
        _require_integer("selection_rings", self.selection_rings, 0)
        if self.objective != "shape":
            raise ValueError(f"objective must be 'shape', got {self.objective!r}")
        if self.target_quality is not None:
            _require(
                0.0 < self.target_quality <= 1.0,
                "target_quality must be in (0, 1]",
                self.target_quality,
            )
        if self.time_limit is not None:
            _require(self.time_limit > 0.0, "time_limit must be over 0 seconds", self.time_limit)
        _require(0.0 <= self.mean_loss < 1.0, "mean_loss must be in [0, 1)", self.mean_loss)
        if self.threads is not None:
            from qsmooth.kernels._jit import available_threads

            most = available_threads()
            _require_integer("threads", self.threads, 1)
            _require(self.threads <= most, f"threads must be at most {most} here", self.threads)


def smooth(
    mesh: MeshLike,
    method: str = "auto",
    *,
    max_sweeps: int | None = None,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    max_angle: float = 120.0,
    min_angle: float = 60.0,
    triangle_max_angle: float = 90.0,
    triangle_min_angle: float = 45.0,
    step: float | None = None,
    worst_fraction: float = 1.0,
    worst_first: bool = False,
    bad_angle: float = 180.0,
    bad_step: float | None = None,
    max_edge_ratio: float = 1.2,
    weights: Weights = "uniform",
    split_quads: bool | Diagonal = False,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
    objective: Objective = "shape",
    worst: bool = True,
    target_quality: float | None = None,
    time_limit: float | None = None,
    mean_loss: float = 0.1,
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
        ``"optimize"``, ``"star"``, ``"quad"``, ``"aspect-ratio"``, ``"angle"``,
        ``"smart-laplacian"`` or ``"laplacian"``; see `smooth_optimize`, `smooth_star` and their
        like. All but the last keep a valid mesh valid after every single move. ``"auto"`` means
        optimize. The options below are of some methods only; one that the method does not have is
        refused.
    max_sweeps
        Stop here at the latest; the result then has ``converged=False``. 0 or more; None for the
        method's own limit, 5000 for optimize and 50 for the others.
    rtol
        A vertex rests when it moves less than this share of its shortest edge; stop once all do,
        or when quality no longer improves. In [0, 1); 0 runs all sweeps.
    guard
        What every step has to keep: ``"clearance"`` only validity; ``"quality"`` also the star's
        smallest scaled Jacobian, or one of 0.5 (more, where the whole mesh begins with more), so
        that the worst cell never gets worse. ``"none"``, for ``"angle"`` only: as published,
        all vertices at once and unguarded.
    max_angle, min_angle
        Degrees, 0 < min_angle < max_angle < 180. Corners of quads beyond these are mended.
    triangle_max_angle, triangle_min_angle
        The same for triangles.
    step
        Fraction of each proposed move that is made, in (0, 1]; None for the method's own default.
    worst_fraction
        Share of the cells that propose moves in a sweep, those with the worst largest angles, in
        (0, 1].
    worst_first
        Smooth the worst group (of `worst_fraction`) first, then the rest, then all, each for a
        third of the sweeps or until it rests. Gains little over plain sweeps with the default
        step (``studies/subset.py``), as does `bad_step`.
    bad_angle, bad_step
        Cells whose largest angle is over `bad_angle` degrees propose moves by `bad_step`, in
        (0, 2], instead of `step`; None for no difference.
    max_edge_ratio
        The aspect-ratio method leaves two edges alone whose ratio is no larger, 1 or more.
    weights
        Of the Laplacian methods: ``"uniform"`` for the mean of the neighbours, ``"area"`` for the
        centroid of the star polygon.
    split_quads
        Whether to cut each quad in two triangles and smooth these: along its ``"shorter"``
        diagonal (True), or that from its ``"first"`` or ``"second"`` vertex. What is guarded then
        are the triangles; the result says how many quads that broke.
    selection
        Cells whose vertices may move: ids, a mask, or a threshold such as ``"max_angle > 150"`` on
        one of the metrics of `quality`. None for all.
    selection_rings
        How often the selection grows by the cells that touch it.
    objective, worst, target_quality, time_limit, mean_loss
        Of the optimiser: see `smooth_optimize`.
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
    if not isinstance(method, str) or (method not in METHODS and method != "auto"):
        raise ValueError(f"method must be one of auto, {', '.join(METHODS)}; got {method!r}")
    mesh = as_mesh(mesh)
    chosen = ""
    if method == "auto":
        method, why = _choose(split_quads)
        chosen = f"auto chose {method}{why}"
    guards = ("quality", "clearance", "none") if method == "angle" else ("quality", "clearance")
    if guard not in guards:
        words = " or ".join(", ".join(map(repr, guards)).rsplit(", ", 1))
        raise ValueError(f"guard must be {words}, got {guard!r}")
    settings = _Settings(
        max_sweeps=METHODS[method].max_sweeps if max_sweeps is None else max_sweeps,
        rtol=rtol,
        guard=guard,
        max_angle=max_angle,
        min_angle=min_angle,
        triangle_max_angle=triangle_max_angle,
        triangle_min_angle=triangle_min_angle,
        step=METHODS[method].step if step is None else step,
        worst_fraction=worst_fraction,
        worst_first=worst_first,
        bad_angle=bad_angle,
        bad_step=bad_step,
        max_edge_ratio=max_edge_ratio,
        weights=weights,
        split_quads=split_quads,
        selection=selection,
        selection_rings=selection_rings,
        objective=objective,
        worst=worst,
        target_quality=target_quality,
        time_limit=time_limit,
        mean_loss=mean_loss,
        keep_interfaces=keep_interfaces,
        threads=threads,
    )
    defaults = _Settings(step=METHODS[method].step)
    for option in sorted(METHOD_OPTIONS - METHODS[method].options):
        given = getattr(settings, option) != getattr(defaults, option)
        if given or (option == "step" and step is not None):
            of = f" ({chosen})" if chosen else ""
            raise ValueError(f"method {method!r} has no option {option}{of}")
    if method == "optimize":
        return _optimized(mesh, settings, callback, chosen)
    return _iterate(mesh, METHODS[method], settings, callback, chosen)


def smooth_optimize(
    mesh: MeshLike,
    *,
    objective: Objective = "shape",
    worst: bool = True,
    target_quality: float | None = None,
    time_limit: float | None = None,
    max_sweeps: int = 5000,
    mean_loss: float = 0.1,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Find the best places for the vertices: untangle, improve the mean, then the worst cells.

    Each vertex takes Newton steps downhill on the shape energy of the cells around it. Where a
    whole region has to move, Newton steps on all vertices at once take over. Then a wall, steeper
    and steeper, pushes back the corners with the smallest sine, and only these. It stops by itself
    when nothing more is gained.

    The result is never worse than the input in smallest angle, largest angle, smallest scaled
    Jacobian and mean shape. Where the four can't all be had the worst cells go first, and the
    reason says so. An invalid mesh is untangled first; then the untangled mesh is what counts.

    Parameters
    ----------
    mesh
        A `Mesh`, or a pair ``(points, cells)``. It is not changed.
    objective
        What the mean stage improves: ``"shape"``, the mean ratio to squares and equilateral
        triangles, whatever their size.
    worst
        Whether to see to the worst cells too; else only to the mean.
    target_quality
        Smallest scaled Jacobian, in (0, 1], at which it may stop.
    time_limit
        Seconds, over 0, after which it stops with the best so far. With a limit the result depends
        on the machine.
    max_sweeps
        Stop here at the latest. 0 or more.
    mean_loss
        Share of the best mean shape, in [0, 1), that the worst cells may cost.
    selection, selection_rings, keep_interfaces, threads, callback
        As in `smooth`; the callback is called every ten sweeps, and the history has a record for
        each of these rounds.

    Returns
    -------
    SmoothResult

    Raises
    ------
    ValueError
        An option outside its range.
    MeshError
        If a pair is no mesh.

    Notes
    -----
    Mean ratio: P. M. Knupp, "Algebraic mesh quality metrics", SIAM J. Sci. Comput. 23 (2001).
    Untangling: see `untangle`.
    """
    return smooth(
        mesh, "optimize", objective=objective, worst=worst, target_quality=target_quality,
        time_limit=time_limit, max_sweeps=max_sweeps, mean_loss=mean_loss, selection=selection,
        selection_rings=selection_rings, keep_interfaces=keep_interfaces, threads=threads,
        callback=callback,
    )  # fmt: skip


def untangle(
    mesh: MeshLike,
    *,
    time_limit: float | None = None,
    max_sweeps: int = 20_000,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Make an invalid mesh valid by moving vertices, and stop there.

    The result is a valid mesh; or one with as few invalid cells as were seen, and the reason says
    how many stay invalid, where, and for which of them that is proven. A valid mesh comes back as
    it is.

    Parameters
    ----------
    mesh
        A `Mesh`, or a pair ``(points, cells)``. It is not changed.
    time_limit
        Seconds, over 0, after which it stops.
    max_sweeps
        Stop here at the latest. 0 or more.
    keep_interfaces, threads, callback
        As in `smooth_optimize`.

    Returns
    -------
    SmoothResult
        ``converged`` says whether the mesh is valid.

    Raises
    ------
    ValueError
        An option outside its range.
    MeshError
        If a pair is no mesh.

    Notes
    -----
    V. Garanzha, I. Kaporin, L. Kudryavtseva, F. Protais, N. Ray, D. Sokolov, "Foldover-free maps
    in 50 lines of code", ACM Trans. Graph. 40 (2021): the regularised determinant; here with
    Newton steps vertex by vertex.
    """
    settings = _Settings(
        max_sweeps=max_sweeps,
        time_limit=time_limit,
        keep_interfaces=keep_interfaces,
        threads=threads,
    )
    return _optimized(as_mesh(mesh), settings, callback, only_untangle=True)


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
    step: float = 0.25,
    worst_fraction: float = 1.0,
    worst_first: bool = False,
    bad_angle: float = 180.0,
    bad_step: float | None = None,
    split_quads: bool | Diagonal = False,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
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
        worst_first=worst_first, bad_angle=bad_angle, bad_step=bad_step, split_quads=split_quads,
        selection=selection, selection_rings=selection_rings, keep_interfaces=keep_interfaces,
        threads=threads, callback=callback,
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
    step: float = 0.25,
    worst_fraction: float = 1.0,
    worst_first: bool = False,
    bad_angle: float = 180.0,
    bad_step: float | None = None,
    split_quads: bool | Diagonal = False,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
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
        worst_first=worst_first, bad_angle=bad_angle, bad_step=bad_step, split_quads=split_quads,
        selection=selection, selection_rings=selection_rings, keep_interfaces=keep_interfaces,
        threads=threads, callback=callback,
    )  # fmt: skip


def smooth_aspect_ratio(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    max_edge_ratio: float = 1.2,
    step: float = 0.2,
    split_quads: bool | Diagonal = False,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Smooth triangles by making the two edges at each corner more alike.

    Each triangle proposes to move its corner along its circumcircle towards the longer edge, which
    keeps the corner's angle. Proposals that cost no clearance are averaged, with the fourth power
    of their edge ratios for weights; a step that would make the largest ratio around the vertex
    larger is shortened. Quads propose nothing, but their validity and quality is kept.

    The source leaves open how to average, and has 1.5 for `max_edge_ratio`; these defaults were
    the best over random triangulations (``studies/triangles.py``).

    Parameters, result and errors are those of `smooth`; also a `ValueError` where there is no
    triangle.

    Notes
    -----
    The circumcircle method for triangles that "Quadrilateral Mesh Smoothing" builds on.
    """
    return smooth(
        mesh, "aspect-ratio", max_sweeps=max_sweeps, rtol=rtol, guard=guard,
        max_edge_ratio=max_edge_ratio, step=step, split_quads=split_quads, selection=selection,
        selection_rings=selection_rings, keep_interfaces=keep_interfaces, threads=threads,
        callback=callback,
    )  # fmt: skip


def smooth_angle(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    step: float = 1.0,
    split_quads: bool | Diagonal = False,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Smooth by turning each edge onto the bisector of the angle at its other end.

    A vertex goes to the mean of the places to which its edges turn it, keeping their lengths. With
    ``guard="none"`` all vertices move at once and unguarded, as published; otherwise one by one,
    as far as the guards allow.

    Parameters, result and errors are those of `smooth`.

    Notes
    -----
    T. Zhou and K. Shimada, "An angle-based approach to two-dimensional mesh smoothing",
    Proceedings of the 9th International Meshing Roundtable (2000). In quads the polygon round a
    vertex runs through the opposite corners too, which do not turn it. So it is not stable there:
    on a square grid a sweep makes waves of six cells 1.125 times as high. Quads, also guarded ones,
    get slim; better cut them in two (`split_quads`), or take another method.
    """
    return smooth(
        mesh, "angle", max_sweeps=max_sweeps, rtol=rtol, guard=guard, step=step,
        split_quads=split_quads, selection=selection, selection_rings=selection_rings,
        keep_interfaces=keep_interfaces, threads=threads, callback=callback,
    )  # fmt: skip


def smooth_smart_laplacian(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    guard: Guard = "quality",
    weights: Weights = "uniform",
    split_quads: bool | Diagonal = False,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Move each vertex towards the mean of its neighbours, as far as no cell suffers.

    With area weights, towards the centroid of its star polygon.

    Parameters, result and errors are those of `smooth`.
    """
    return smooth(
        mesh, "smart-laplacian", max_sweeps=max_sweeps, rtol=rtol, guard=guard,
        weights=weights, split_quads=split_quads, selection=selection,
        selection_rings=selection_rings, keep_interfaces=keep_interfaces, threads=threads,
        callback=callback,
    )  # fmt: skip


def smooth_laplacian(
    mesh: MeshLike,
    *,
    max_sweeps: int = 50,
    rtol: float = 1e-3,
    weights: Weights = "uniform",
    split_quads: bool | Diagonal = False,
    selection: npt.ArrayLike | str | None = None,
    selection_rings: int = 0,
    keep_interfaces: bool = True,
    threads: int | None = None,
    callback: Callback | None = None,
) -> SmoothResult:
    """Move all vertices to the mean of their neighbours at once, unguarded.

    The baseline that everybody knows: cheap, and good on convex domains; near a re-entrant corner
    it inverts cells, and the result says how many. With area weights, to the centroid of the star
    polygon.

    Parameters, result and errors are those of `smooth`.
    """
    return smooth(
        mesh, "laplacian", max_sweeps=max_sweeps, rtol=rtol,
        weights=weights, split_quads=split_quads, selection=selection,
        selection_rings=selection_rings, keep_interfaces=keep_interfaces, threads=threads,
        callback=callback,
    )  # fmt: skip


def _start_star(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.star import star_sweep

    limit, pace = _limits(settings), _Pace(mesh, settings)

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        star_sweep(
            xy, schedule.colour_offsets, schedule.vertices, schedule.offsets, schedule.corners,
            schedule.cells, pace(xy), limit, float(settings.step), settings.good,
            schedule.largest_star, moves, shares,
        )  # fmt: skip

    return sweep


def _start_quad(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.quad import guarded_commit, quad_proposals

    limit, pace = _limits(settings), _Pace(mesh, settings)
    wanted = np.empty((schedule.vertices.size, 2))

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        quad_proposals(
            xy, schedule.vertices, schedule.offsets, schedule.corners, schedule.cells, pace(xy),
            limit, float(settings.step), schedule.largest_star, wanted,
        )  # fmt: skip
        guarded_commit(
            xy, schedule.colour_offsets, schedule.vertices, schedule.offsets, schedule.corners,
            wanted, settings.good, schedule.largest_star, moves, shares,
        )  # fmt: skip

    return sweep


def _start_laplacian(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.laplacian import laplacian_sweep

    previous = np.empty((mesh.n_vertices, 2))
    if settings.weights == "area":
        from qsmooth.kernels.centroid import centroid_sweep

        table = schedule.vertices, schedule.offsets, schedule.corners

        def area_sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
            previous[:] = xy
            centroid_sweep(previous, *table, xy, moves, shares)

        return area_sweep
    rings = mesh.ring_offsets, mesh.ring_vertices

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        previous[:] = xy
        laplacian_sweep(previous, *rings, schedule.vertices, xy, moves, shares)

    return sweep


def _start_smart_laplacian(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.laplacian import smart_laplacian_sweep

    if settings.weights == "area":
        from qsmooth.kernels.centroid import smart_centroid_sweep

        def area_sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
            smart_centroid_sweep(
                xy, schedule.colour_offsets, schedule.vertices, schedule.offsets,
                schedule.corners, settings.good, moves, shares,
            )  # fmt: skip

        return area_sweep
    rings = mesh.ring_offsets, mesh.ring_vertices

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        smart_laplacian_sweep(
            xy, *rings, schedule.colour_offsets, schedule.vertices, schedule.offsets,
            schedule.corners, settings.good, moves, shares,
        )  # fmt: skip

    return sweep


def _start_aspect_ratio(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.aspect_ratio import aspect_ratio_sweep

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        aspect_ratio_sweep(
            xy, schedule.colour_offsets, schedule.vertices, schedule.offsets, schedule.corners,
            float(settings.max_edge_ratio), float(settings.step), RATIO_POWER,
            float(settings.max_edge_ratio), settings.good, schedule.largest_star, moves, shares,
        )  # fmt: skip

    return sweep


def _start_angle(mesh: Mesh, schedule: Schedule, settings: _Settings) -> Sweep:
    from qsmooth.kernels.angle import angle_sweep, guarded_angle_sweep

    table = schedule.vertices, schedule.offsets, schedule.corners
    if settings.guard == "none":
        previous = np.empty((mesh.n_vertices, 2))

        def unguarded_sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
            previous[:] = xy
            angle_sweep(previous, *table, float(settings.step), xy, moves, shares)

        return unguarded_sweep

    def sweep(xy: FloatArray, moves: FloatArray, shares: FloatArray) -> None:
        guarded_angle_sweep(
            xy, schedule.colour_offsets, *table, float(settings.step), settings.good, moves, shares
        )

    return sweep


_SWEEPING = frozenset(
    {
        "max_sweeps",
        "rtol",
        "split_quads",
        "selection",
        "selection_rings",
        "keep_interfaces",
        "threads",
    }
)
_ANGLES = frozenset(
    {
        "max_angle",
        "min_angle",
        "triangle_max_angle",
        "triangle_min_angle",
        "step",
        "worst_fraction",
        "worst_first",
        "bad_angle",
        "bad_step",
    }
)
_OPTIMIZING = frozenset(
    {
        "max_sweeps",
        "selection",
        "selection_rings",
        "objective",
        "worst",
        "target_quality",
        "time_limit",
        "mean_loss",
        "keep_interfaces",
        "threads",
    }
)
METHODS = {
    method.name: method
    for method in (
        Method("optimize", "Optimise", _OPTIMIZING, True, None, max_sweeps=5000),
        Method("star", "By star", _SWEEPING | _ANGLES | {"guard"}, True, _start_star),
        Method("quad", "By quad", _SWEEPING | _ANGLES | {"guard"}, True, _start_quad),
        Method(
            "aspect-ratio",
            "By aspect ratio",
            _SWEEPING | {"guard", "step", "max_edge_ratio"},
            True,
            _start_aspect_ratio,
            step=0.2,
        ),
        Method("angle", "Angle-based", _SWEEPING | {"guard", "step"}, True, _start_angle, 1.0),
        Method("laplacian", "Laplacian", _SWEEPING | {"weights"}, False, _start_laplacian),
        Method(
            "smart-laplacian",
            "Smart Laplacian",
            _SWEEPING | {"guard", "weights"},
            True,
            _start_smart_laplacian,
        ),
    )
}
METHOD_OPTIONS = _SWEEPING | _ANGLES | _OPTIMIZING | {"guard", "max_edge_ratio", "weights"}


class _Pace:
    """At which multiple of `step` each cell proposes in a sweep, 0 where it proposes nothing.

    The worst group, those with the largest angles, is found anew for every sweep.
    """

    def __init__(self, mesh: Mesh, settings: _Settings) -> None:
        self._mesh, self._settings = mesh, settings
        everyone = np.arange(mesh.n_cells)
        ranked = everyone if settings.selected is None else np.flatnonzero(settings.selected)
        self._ranked = ranked
        self._count = math.ceil(settings.worst_fraction * len(ranked))
        self._ranks = settings.group != "all" and self._count < len(ranked)
        self._pace = np.ones(mesh.n_cells)

    def __call__(self, xy: FloatArray) -> FloatArray:
        settings = self._settings
        if not self._ranks and settings.bad_step is None:
            return self._pace
        from qsmooth.kernels.cell_metrics import angles

        smallest, largest = np.empty(self._mesh.n_cells), np.empty(self._mesh.n_cells)
        angles(xy, self._mesh.cell_offsets, self._mesh.cell_vertices, smallest, largest)
        self._pace[:] = 1.0
        if settings.bad_step is not None:
            self._pace[largest > settings.bad_angle] = settings.bad_step / settings.step
        if self._ranks:
            order = np.argsort(-largest[self._ranked], kind="stable")
            silent = np.ones(self._mesh.n_cells, np.bool_)
            worst = self._ranked[order[: self._count]]
            rest = self._ranked[order[self._count :]]
            silent[worst if settings.group == "worst" else rest] = False
            self._pace[silent] = 0.0
        return self._pace


def _choose(split_quads: object) -> tuple[str, str]:
    """Pick a method for ``"auto"``, and say why."""
    if split_quads is not False:
        return "aspect-ratio", ", as the quads are cut in triangles"
    return "optimize", ""


def _stages(settings: _Settings) -> list[tuple[str, int]]:
    """List which group of cells proposes, and for how many sweeps at most."""
    if not settings.worst_first:
        return [("all" if settings.worst_fraction == 1.0 else "worst", settings.max_sweeps)]
    third = settings.max_sweeps // 3
    return [("worst", third), ("rest", third), ("all", settings.max_sweeps - 2 * third)]


def _cut(mesh: Mesh, method: Method, settings: _Settings) -> Mesh:
    """Return the mesh that is swept: with its quads cut in two, if that is asked for."""
    n_triangles = int((np.diff(mesh.cell_offsets) == 3).sum())
    if settings.split_quads is not False and n_triangles < mesh.n_cells:
        from qsmooth.split import split_quads

        return split_quads(mesh, settings.diagonal)
    if reason := why_not(mesh, method.name):
        raise ValueError(reason)
    return mesh


def why_not(mesh: Mesh, method: str) -> str:
    """Say in one line why a method can do nothing with the mesh's cells; empty where it can."""
    if method == "aspect-ratio" and (np.diff(mesh.cell_offsets) == 4).all():
        return (
            "method 'aspect-ratio' is for triangles and there is none; "
            "split_quads=True cuts the quads in two"
        )
    return ""


def _limits(settings: _Settings) -> FloatArray:
    from qsmooth.kernels.moves import thresholds

    return thresholds(
        settings.max_angle,
        settings.min_angle,
        settings.triangle_max_angle,
        settings.triangle_min_angle,
    )


def _iterate(
    mesh: Mesh, method: Method, settings: _Settings, callback: Callback | None, chosen: str = ""
) -> SmoothResult:
    """Sweep until every vertex rests, quality no longer improves, or `max_sweeps` is reached."""
    from qsmooth.kernels._jit import use_threads

    before_quality = quality(mesh)
    before = before_quality.summary()
    cut = _cut(mesh, method, settings)
    only, selected = _selected(mesh, settings)
    if selected is not None and cut is not mesh:
        selected = np.repeat(selected, np.diff(mesh.cell_offsets) - 2)
    settings = replace(settings, selected=selected)
    schedule = cut.topology.schedule(settings.keep_interfaces, only)
    n_movable = schedule.vertices.size
    threads = _n_threads(settings, n_movable)
    if settings.guard == "quality":
        smallest = (
            float(quality(cut).scaled_jacobian.min())
            if cut is not mesh
            else (before.worst["scaled_jacobian"])
        )
        settings = replace(settings, good=max(GOOD_SCALED_JACOBIAN, smallest))
    guarded = method.guarded and settings.guard != "none"
    xy = mesh.xy.copy()
    moves, shares = np.zeros(n_movable), np.zeros(n_movable)
    history: list[SweepRecord] = []
    stop = "" if n_movable else _why_none_moves(settings)
    seconds = 0.0
    with use_threads(threads):
        assert method.start is not None
        for group, n_sweeps in _stages(settings) if n_movable else []:
            sweep = method.start(cut, schedule, replace(settings, group=group))
            n_past, stop = len(history), ""
            while not stop and len(history) < n_past + n_sweeps:
                start = time.perf_counter()
                sweep(xy, moves, shares)
                seconds += time.perf_counter() - start
                history.append(_record(Quality(mesh.topology, xy), moves, shares))
                if callback is not None:
                    callback(history[-1])
                stop = _why_stop(history[n_past:], settings.rtol)
    if not guarded:
        result = mesh.with_xy(xy, _moved(mesh, xy))
    elif cut is mesh:
        result = _stored(mesh, xy)
    else:
        result = mesh.with_points(_stored(cut, xy).points)
    after_quality = quality(result)
    after = after_quality.summary()
    notes = [chosen] if chosen else []
    if cut is not mesh:
        lost = (before_quality.validity == Validity.VALID) & (
            after_quality.validity != Validity.VALID
        )
        notes.append(_split_note(mesh, settings, int(lost.sum())))
    return SmoothResult(
        mesh=result,
        method=method.name,
        sweeps=len(history),
        converged=bool(stop),
        reason="; ".join([*notes, _reason(stop, history, method, before, after, cut is mesh)]),
        history=tuple(history),
        before=before,
        after=after,
        seconds=seconds,
    )


def _optimized(
    mesh: Mesh,
    settings: _Settings,
    callback: Callback | None,
    chosen: str = "",
    *,
    only_untangle: bool = False,
) -> SmoothResult:
    """Optimise, or only untangle; see `smooth_optimize` and `untangle`."""
    from qsmooth import optimization
    from qsmooth.kernels._jit import use_threads

    before = quality(mesh).summary()
    only, _ = _selected(mesh, settings)
    schedule = mesh.topology.schedule(settings.keep_interfaces, only)
    n_movable = schedule.vertices.size
    history: list[SweepRecord] = []

    def note(now: Quality, moves: FloatArray, shares: FloatArray) -> None:
        history.append(_record(now, moves, shares))
        if callback is not None:
            callback(history[-1])

    progress = optimization.Progress(
        worst=settings.worst,
        target_quality=settings.target_quality,
        time_limit=settings.time_limit,
        max_sweeps=settings.max_sweeps,
        mean_loss=settings.mean_loss,
        note=note,
    )
    result, reason = mesh, _why_none_moves(settings)
    start = time.perf_counter()
    if n_movable:
        run = optimization.untangle if only_untangle else optimization.optimize
        with use_threads(_n_threads(settings, n_movable)):
            result = _stored(mesh, run(mesh, schedule, progress))
        reason = progress.verdict()
        if not only_untangle:
            bounds = str(limits(result, keep_interfaces=settings.keep_interfaces))
            reason = "; ".join([reason, *bounds.splitlines()])
    seconds = time.perf_counter() - start
    after = quality(result).summary()
    return SmoothResult(
        mesh=result,
        method="untangle" if only_untangle else "optimize",
        sweeps=progress.sweeps,
        converged=not progress.limit and not (only_untangle and after.n_invalid),
        reason="; ".join([*([chosen] if chosen else []), reason]),
        history=tuple(history),
        before=before,
        after=after,
        seconds=seconds,
    )


def _selected(mesh: Mesh, settings: _Settings) -> tuple[BoolArray | None, BoolArray | None]:
    """Vertices that may move by the selection, and the selected cells; None where all are."""
    if settings.selection is None:
        return None, None
    from qsmooth.selection import select_cells, vertices_of

    cells = select_cells(mesh, settings.selection, settings.selection_rings)
    return vertices_of(mesh, cells), cells


def _n_threads(settings: _Settings, n_movable: int) -> int:
    from qsmooth.kernels._jit import available_threads

    if settings.threads is not None:
        return settings.threads
    return available_threads() if n_movable >= PARALLEL_FROM else 1


def _why_none_moves(settings: _Settings) -> str:
    if settings.selection is not None:
        return "no vertex can move: all selected are on the boundary or fixed"
    return "no vertex can move: all are on the boundary, fixed or in no cell"


def _split_note(mesh: Mesh, settings: _Settings, n_lost: int) -> str:
    """Say how the quads were cut, and what that did to them."""
    n_quads = int((np.diff(mesh.cell_offsets) == 4).sum())
    return (
        f"{plural(n_quads, 'quad was', 'quads were')} smoothed as two triangles each, cut along "
        f"the {settings.diagonal} diagonal, which broke {n_lost if n_lost else 'none'} of them"
    )


def _record(now: Quality, moves: FloatArray, shares: FloatArray) -> SweepRecord:
    smallest, largest = now.extreme_angles
    return SweepRecord(
        largest_move=float(moves.max()),
        largest_share=float(shares.max()),
        n_moved=int((moves > 0.0).sum()),
        min_angle=smallest,
        max_angle=largest,
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
    stop: str,
    history: list[SweepRecord],
    method: Method,
    before: Summary,
    after: Summary,
    whole: bool = True,
) -> str:
    """Say in words why it stopped and what is wrong with the result."""
    if stop:
        parts = [stop]
    elif not history:
        parts = ["no sweep was asked for"]
    else:
        parts = [
            f"stopped after {plural(len(history), 'sweep')}, as max_sweeps says; vertices still "
            f"moved by up to {100.0 * history[-1].largest_share:.2g} % of their shortest edge"
        ]
    if before.n_invalid:
        parts.append(
            f"the mesh was not valid ({plural(before.n_invalid, 'cell')} of {before.n_cells} "
            f"invalid) and {method.name} does not untangle: "
            f"{plural(after.n_invalid, 'cell')} invalid now"
        )
    elif after.n_invalid and whole:
        parts.append(
            f"{method.name} is unguarded: it made {plural(after.n_invalid, 'cell')} invalid"
        )
    return "; ".join(parts)


def _moved(mesh: Mesh, xy: FloatArray) -> BoolArray:
    moved: BoolArray = (xy != mesh.xy).any(axis=1)
    return moved


def _stored(mesh: Mesh, xy: FloatArray) -> Mesh:
    """Give the mesh its new coordinates, certified as they are stored.

    In x and y what was certified is what is stored. Points of a tilted plane are rounded once
    more: where that costs a corner, by a hair, the cell's vertices go back to where they were.
    """
    moved = _moved(mesh, xy)
    result = mesh.with_xy(xy, moved)
    if mesh.plane is None:
        return result
    was_valid = quality(mesh).validity == Validity.VALID
    while True:
        lost = was_valid & (quality(result).validity != Validity.VALID)
        if not lost.any():
            return result
        vertices = mesh.cell_vertices[np.repeat(lost, np.diff(mesh.cell_offsets))]
        moved[vertices] = False
        result = mesh.with_xy(xy, moved)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _require(condition: bool, what: str, value: object) -> None:
    if not condition:
        raise ValueError(f"{what}, got {value}")


def _require_integer(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} must be an integer of {least} or more, got {value!r}")
