"""Outcomes: what a method did to a mesh and why it stopped, as records; `wording` says it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from qsmooth._json import finite


class Stop(StrEnum):
    """Why a method stopped."""

    RESTS = "rests"  # every vertex moves by less than `rtol` of its shortest edge
    SETTLED = "settled"  # quality no longer improves
    STOP_QUALITY = "stop_quality"  # the worst cell is as good as was asked for
    VALID = "valid"  # all cells are valid, which was all that was asked for
    STUCK = "stuck"  # untangling found no way for the cells that stay invalid
    MAX_SWEEPS = "max_sweeps"
    TIME_LIMIT = "time_limit"
    CALLBACK = "callback"  # the caller's callback asked for it, or raised an exception
    NOTHING_MOVES = "nothing_moves"  # no vertex may move

    @property
    def by_itself(self) -> bool:
        """Whether it was done, and neither cut short nor stuck."""
        return self not in (Stop.MAX_SWEEPS, Stop.TIME_LIMIT, Stop.CALLBACK, Stop.STUCK)


class Aim(StrEnum):
    """What a stage is for."""

    ALL_CELLS = "all_cells"
    WORST_GROUP = "worst_group"  # only the cells with the largest angles propose moves
    REST = "rest"  # only the others do
    UNTANGLE = "untangle"
    MEAN_SHAPE = "mean_shape"
    WORST_CELLS = "worst_cells"


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A run of sweeps with one aim.

    Attributes
    ----------
    aim
        What it is for.
    sweeps, steps
        Sweeps over the vertices, and Newton steps on all of them at once.
    seconds
        Time it took, callbacks left out.
    gain
        By figure (``min_angle``, ``max_angle``, ``mean_shape``, ``n_invalid``) how much larger it
        was after the stage than before, at the coordinates that it worked on: the result is the
        best that was seen, which need not be the last.
    """

    aim: Aim
    sweeps: int
    steps: int = 0
    seconds: float = field(default=0.0, compare=False)
    gain: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Trade:
    """A figure that got worse by over one percent, while another got better.

    Attributes
    ----------
    figure, before, after
        The one that was given up: ``aspect_ratio``, ``shape``, ``min_edge`` (the worst of the mesh)
        or ``mean_shape``.
    gained, gained_before, gained_after
        The one that gained most meanwhile: one of these, ``min_angle``, ``max_angle``,
        ``scaled_jacobian``, or ``target``, the mean quality towards the target; "" for none.
    """

    figure: str
    before: float
    after: float
    gained: str = ""
    gained_before: float = math.nan
    gained_after: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Target:
    """What cells were meant to be.

    Attributes
    ----------
    kind
        ``ideal``: squares and equilateral triangles; ``squares``: these, beside layers, gradings
        and stretched triangles as the mesh has them; ``ratios``: rectangles; ``initial``;
        ``metric``.
    before, after
        Mean quality of the cells towards that, 1 at best.
    ideal_before, ideal_after
        The same towards squares and equilateral triangles: the mean shape.
    """

    kind: str
    before: float
    after: float
    ideal_before: float = math.nan
    ideal_after: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """What became of the sizes of cells.

    Attributes
    ----------
    area_low, area_median, area_high
        Areas of the cells over what they were, the 1st, 50th and 99th percentile; 1 where no cell
        had an area.
    min_edge_before, min_edge_after
        The shortest edge.
    layers
        Share of the cells that are of layers, and were kept.
    """

    area_low: float
    area_median: float
    area_high: float
    min_edge_before: float
    min_edge_after: float
    layers: float


@dataclass(frozen=True, kw_only=True)
class Invalid:
    """Cells that stay invalid.

    Attributes
    ----------
    before, after
        How many cells were and are invalid.
    first
        The first that is, -1 where there is none.
    proven, first_proven
        Of those that are, how many no method can mend; and the first of these, -1 where there is
        none. Either what is fixed keeps a corner from being convex, or it is a doublet's.
    proven_doublets
        Of those proven, how many are one of the two cells of an interior vertex that has no more:
        their angles there add up to 360 degrees.
    """

    before: int
    after: int
    first: int = -1
    proven: int = 0
    first_proven: int = -1
    proven_doublets: int = 0


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Quads that were smoothed as two triangles each.

    Attributes
    ----------
    quads
        How many there are.
    diagonal
        Along which they were cut.
    broken
        How many were valid and are no longer.
    """

    quads: int
    diagonal: str
    broken: int


@dataclass(frozen=True, kw_only=True)
class Forbidden:
    """A better worst cell that was seen, and not taken as it would have cost too much.

    Attributes
    ----------
    scaled_jacobian
        Of that worst cell.
    mean_loss
        Share of the best mean shape that it may cost at most.
    """

    scaled_jacobian: float
    mean_loss: float


@dataclass(frozen=True, kw_only=True)
class Held:
    """A figure that is held, and what that keeps from getting better.

    It is told of a run that stopped by itself, where a vertex had a step to take, all others being
    where they are, that makes the cells around it better by over one percent, and this figure of
    one of them worse than it is held at. Where a step would break several figures the first of
    these counts: smallest angle, largest angle, scaled Jacobian, aspect ratio, shape, edge.

    Attributes
    ----------
    figure
        ``min_angle``, ``max_angle``, ``scaled_jacobian``, ``aspect_ratio``, ``shape`` or
        ``min_edge``.
    value
        The worst that is allowed in the region of the cell: what it was there at first.
    cell
        The cell that would get worse than that, of the vertex that would gain most.
    vertices
        How many vertices it keeps where they are.
    """

    figure: str
    value: float
    cell: int
    vertices: int


@dataclass(frozen=True, kw_only=True)
class Carried:
    """A value that belongs to places, where vertices have moved.

    Attributes
    ----------
    name
        ``z`` of a flat mesh, or the name of point data.
    interpolated
        Whether it was interpolated in the input mesh, or kept with its vertices.
    vertices
        How many vertices have moved.
    largest, rms
        How far off the input's own values it is at these where it moves along with them, in its
        own unit: the largest error, and the root of the mean square. By as much interpolation has
        changed it.
    """

    name: str
    interpolated: bool
    vertices: int
    largest: float
    rms: float


@dataclass(frozen=True, kw_only=True)
class Sliding:
    """What became of the vertices that were to slide, and of the lines that they are on.

    Attributes
    ----------
    boundary_vertices, may_slide, slid
        Vertices of the boundary; those of them that could slide; and that are elsewhere now.
    interface_vertices, interface_slid
        Vertices on lines inside the mesh that could slide, and that are elsewhere now.
    beside, off_curve
        Those that could not be brought onto the curve that was given, and how far from it they are
        at most, a length.
    deviation, deviation_share
        Largest distance of an edge from the line that it stands for, a length; and the largest as a
        share of its edge.
    on_curve, along_curve
        Whether that line is, anywhere, a curve that was given and not the mesh's own; and how many
        of those that could slide have it for their line.
    curves_unused
        Curves that were given and that no line of the mesh follows.
    line_vertices, kept_vertices
        Vertices on all the lines along which vertices were to slide, corners and ends with them;
        and those of them that are fixed, outside the selection, or have a direction of their own.
    """

    boundary_vertices: int
    may_slide: int
    slid: int
    interface_vertices: int = 0
    interface_slid: int = 0
    beside: int = 0
    deviation: float = 0.0
    deviation_share: float = 0.0
    on_curve: bool = False
    off_curve: float = 0.0
    along_curve: int = 0
    curves_unused: int = 0
    line_vertices: int = 0
    kept_vertices: int = 0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a method did and why it stopped.

    Attributes
    ----------
    method
        Its name.
    stop, stop_at
        Why it stopped; and the value of the option that stopped it (``rtol``, ``max_sweeps``,
        ``time_limit`` or ``stop_quality``), NaN where none did.
    chosen
        Why ``"auto"`` took the method; "" where it was asked for by name or is the usual one.
    guarded, untangles
        Whether it keeps valid cells valid; whether it makes invalid ones valid.
    selected
        Whether only vertices of selected cells could move.
    unchanged
        Whether every vertex is where it was.
    stages
        What was done, in order.
    largest_share
        Longest move of the last sweep as a share of its vertex's shortest edge.
    trades
        What got worse by over one percent while something else gained; of a mesh that was untangled
        first, worse than then.
    forbidden
        What could have been better at a cost that an option forbids.
    held
        Where what is held kept something from getting better, a record a figure.
    invalid
        What is or was not valid; None in a mesh of valid cells that stays one.
    cut
        How quads were cut in two, where they were.
    target
        What cells were meant to be, and how near they are; None of methods without such an aim, and
        where no sweep was allowed.
    sizes
        What became of the cells' sizes; None where there is no target.
    carried
        What became of values that belong to places, a record each.
    sliding
        What became of the vertices that were to slide; None where none was.
    limits
        Provable bounds of the angles, `qsmooth.Limits`, where the method works them out.
    """

    method: str
    stop: Stop
    stop_at: float = math.nan
    chosen: str = ""
    guarded: bool = True
    untangles: bool = False
    selected: bool = False
    unchanged: bool = False
    stages: tuple[Stage, ...] = ()
    largest_share: float = 0.0
    trades: tuple[Trade, ...] = ()
    forbidden: Forbidden | None = None
    held: tuple[Held, ...] = ()
    invalid: Invalid | None = None
    cut: Cut | None = None
    target: Target | None = None
    sizes: Sizes | None = None
    carried: tuple[Carried, ...] = ()
    sliding: Sliding | None = None
    limits: Any = None

    @property
    def sweeps(self) -> int:
        """Sweeps of all stages."""
        return sum(stage.sweeps for stage in self.stages)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for JSON: None for what is not finite."""
        plain: dict[str, Any] = {**vars(self), "stop": self.stop.value, "sweeps": self.sweeps}
        for name in ("stages", "trades", "held", "carried"):
            plain[name] = [asdict(record) for record in plain[name]]
        for name in ("forbidden", "invalid", "cut", "target", "sizes", "sliding"):
            plain[name] = None if plain[name] is None else asdict(plain[name])
        plain["limits"] = None if self.limits is None else self.limits.to_dict()
        made_finite: dict[str, Any] = finite(plain)
        return made_finite
