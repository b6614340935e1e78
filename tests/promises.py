"""What every method promises, as checks of a method on a mesh; no method is known by name here.

A method says what it promises by `guards`, `untangles` and its options; the checks go by that and
by what they compute themselves, in exact arithmetic where signs are concerned. Each raises
AssertionError where a promise is broken.
"""

import contextlib
import functools
import json
from dataclasses import dataclass, replace
from unittest import mock

import numpy as np
from hypothesis import strategies as st

import qsmooth
import reference
from meshes import KINDS, place, random_mesh, random_meshes, tangle
from qsmooth import Mesh, SmoothResult, Stop, smooth
from qsmooth.engine import Stepwise, Threads
from qsmooth.methods.base import Method
from qsmooth.methods.driver import SweepingMethod
from qsmooth.options import spelled
from qsmooth.selection import select_cells, vertices_of
from qsmooth.split import split_quads

# What a mean shape may be given up for, at the least: so much more in the smallest sine.
LEAST_TRADE = 1e-2


# ------------------------------------------------------------------------------- any options

SELECTIONS = st.sampled_from([None, [0], [0, 1, 2], "max_angle > 100", "shape < 0.8"])
# Given by the checks themselves.
OURS = {"threads", "callback"}


def values(spec):
    """Values that an option may have, by what it says of itself."""
    if spec.kind == "flag":
        drawn = st.booleans()
    elif spec.kind == "choice":
        drawn = st.sampled_from(spec.choices)
    elif spec.kind == "number":
        drawn = numbers(spec.interval)
    elif spec.kind == "integer":
        drawn = integers(spec.interval)
    else:
        drawn = SELECTIONS if spec.name == "selection" else st.just(spec.default)
    return st.none() | drawn if spec.optional else drawn


def numbers(interval):
    """Any number in an interval, and often a plain one."""
    low, high = interval.low, interval.high
    plain = [low, low + 0.25, low + 0.5, low + 1.0, low + 90.0, high]
    anything = st.floats(
        low,
        high if np.isfinite(high) else None,
        exclude_min=not interval.with_low,
        exclude_max=not interval.with_high and bool(np.isfinite(high)),
        allow_infinity=False,
        allow_nan=False,
    )
    return anything | st.sampled_from([x for x in plain if x in interval and np.isfinite(x)])


def integers(interval):
    """Small integers in an interval, and a few larger ones."""
    first = int(interval.low)
    return st.sampled_from(
        [n for n in (*range(first, first + 9), 45, 300) if n in interval] or [first]
    )


@st.composite
def methods(draw, known: type[Method], *, repeatable=True, most_sweeps=300, **given):
    """A method with any of its options anywhere in their ranges.

    Repeatable means without a limit in seconds. Options that cannot go together with those drawn
    before them are left out.
    """
    chosen = {"max_sweeps": min(draw(integers(known.specs()["max_sweeps"].interval)), most_sweeps)}
    for name, spec in known.specs().items():
        if name in OURS | chosen.keys() | given.keys() or (repeatable and spec.unit == "seconds"):
            continue
        if not draw(st.booleans()):
            continue
        wanted = {**chosen, name: draw(values(spec))}
        with contextlib.suppress(ValueError):
            known(**wanted)
            chosen = wanted
    return known(**{**chosen, **given})


# ------------------------------------------------------------------------------- any meshes


@st.composite
def valid_meshes(draw):
    """Valid meshes; some with fixed vertices, regions, a vertex in no cell, and values as z."""
    made = draw(random_meshes())
    return draw(dressed(made.points, made.cells))


@st.composite
def tangled_meshes(draw):
    """Meshes whose interior vertices are anywhere: mostly with cells of every class."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    made = KINDS[draw(st.sampled_from(sorted(KINDS)))](draw(st.integers(2, 6)), rng)
    points = tangle(*made, rng, draw(st.sampled_from([0.4, 0.8, 1.5])))
    points = place(points, scale=draw(st.sampled_from([1.0, 1e-3, 1e9])), turn=0.3)
    return draw(dressed(points, made[1]))


@st.composite
def dressed(draw, points, cells):
    if draw(st.booleans()):
        return Mesh(points, cells)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    points = np.concatenate([points, 1.5 * points[:1]])
    return Mesh(
        np.column_stack([points, rng.normal(size=len(points))]),
        cells,
        fixed=rng.random(len(points)) < 0.2,
        regions=rng.integers(2, size=sum(map(len, cells))),
        surface="flat",
    )


def rough_meshes(size=5, kinds=("quads", "triangles", "mixed", "annulus", "L", "mixed fan")):
    """Valid meshes at random, without ties that rounding would decide."""
    return st.builds(
        random_mesh,
        kind=st.sampled_from(kinds),
        size=st.just(size),
        seed=st.integers(0, 2**32 - 1),
        amount=st.just(0.8),
    )


# ------------------------------------------------------------------------------- what is measured


# A mesh never changes, and several checks look at the same ones.
quality = functools.lru_cache(maxsize=8)(qsmooth.quality)


@functools.lru_cache(maxsize=8)
def corner_signs(mesh):
    """Exact sign of every corner; what rounding could decide is done in fractions."""
    offsets, vertices = mesh.cell_offsets, mesh.cell_vertices
    at = np.arange(len(vertices))
    first, last = (np.repeat(ends, np.diff(offsets)) for ends in (offsets[:-1], offsets[1:]))
    after = vertices[np.where(at + 1 < last, at + 1, first)]
    before = vertices[np.where(at > first, at - 1, last - 1)]
    u, w = mesh.xy[after] - mesh.xy[vertices], mesh.xy[before] - mesh.xy[vertices]
    plus, minus = u[:, 0] * w[:, 1], u[:, 1] * w[:, 0]
    signs = np.sign(plus - minus).astype(int)
    doubtful = np.abs(plus - minus) <= 1e-15 * (np.abs(plus) + np.abs(minus)) + 1e-280
    points = reference.as_complex(mesh.xy)
    for k in np.flatnonzero(doubtful):
        signs[k] = reference.sign(points[vertices[k]], points[after[k]], points[before[k]])
    return signs


def invalid_cells(mesh):
    """Mark the cells that are not valid: with a corner that is not convex."""
    return np.logical_or.reduceat(corner_signs(mesh) <= 0, mesh.cell_offsets[:-1])


def hopeless_cells(mesh, movable):
    """Mark the cells with a corner that is not convex and whose three vertices all stay."""
    stays, signs = ~movable[mesh.cell_vertices], corner_signs(mesh)
    hopeless = []
    for first, last in zip(mesh.cell_offsets[:-1], mesh.cell_offsets[1:], strict=True):
        rest, bad = stays[first:last], signs[first:last] <= 0
        hopeless.append((bad & rest & np.roll(rest, 1) & np.roll(rest, -1)).any())
    return np.array(hopeless)


def free_jacobian(mesh, movable):
    """Smallest scaled Jacobian of the corners that can change."""
    points, smallest = mesh.xy, np.inf
    for cell in reference.as_lists(mesh):
        for v, b, d in reference.corners(cell):
            if not movable[[v, b, d]].any():
                continue
            u, w = points[b] - points[v], points[d] - points[v]
            lengths = np.hypot(*u) * np.hypot(*w)
            sine = (u[0] * w[1] - u[1] * w[0]) / lengths if lengths else 0.0
            smallest = min(smallest, sine / (np.sqrt(0.75) if len(cell) == 3 else 1.0))
    return smallest


def movable_vertices(mesh, method):
    """Mark the vertices that may move by the mesh and the options."""
    movable = ~mesh.is_fixed
    if method.keep_interfaces:
        movable &= ~mesh.is_interface
    if method.selection is not None:
        movable &= vertices_of(mesh, select_cells(mesh, method.selection, method.selection_rings))
    return movable


# ------------------------------------------------------------------------------- one run


@dataclass
class Run:
    """A method on a mesh, and what came of it."""

    mesh: Mesh
    method: Method
    result: SmoothResult
    records: list

    @property
    def is_cut(self):
        """Whether quads are cut in two, so that only the triangles are looked after."""
        sizes = np.diff(self.mesh.cell_offsets)
        return getattr(self.method, "split_quads", False) is not False and (sizes == 4).any()

    def looked_after(self):
        """The cells that the method looks after, before and after."""
        mesh = self.mesh
        if self.is_cut:
            how = self.method.split_quads
            mesh = split_quads(mesh, "shorter" if how is True else how)
        return mesh, mesh.with_points(self.result.points)


def run(mesh, method, **options):
    """Smooth, and listen."""
    records = []
    method = replace(method, callback=records.append, **{"threads": 1, **options})
    return Run(mesh, method, smooth(mesh, method), records)


def corners_stay_convex(seen: Run):
    """No convex corner is lost: valid cells stay valid, and so does a valid mesh at every sweep."""
    before, after = seen.looked_after()
    valid = not invalid_cells(before).any()
    if seen.method.guards and (valid or not seen.method.untangles):
        assert not ((corner_signs(before) > 0) & (corner_signs(after) <= 0)).any(), "lost a corner"
    if seen.method.guards and valid and not seen.is_cut:
        assert all(record.n_invalid == 0 for record in seen.records), "invalid on the way"


def invalid_cells_get_no_more(seen: Run):
    """A method that untangles or guards never leaves more invalid cells than it found."""
    before, after = seen.looked_after()
    if seen.method.guards or seen.method.untangles:
        assert invalid_cells(after).sum() <= invalid_cells(before).sum(), "more invalid cells"


def worst_cell_keeps_its_quality(seen: Run):
    """With a guard on quality the smallest scaled Jacobian does not fall."""
    if getattr(seen.method, "guard", None) == "quality":
        before, after = (quality(mesh).scaled_jacobian.min() for mesh in seen.looked_after())
        assert after >= before - (1e-12 if seen.mesh.plane is not None else 0.0), "a worse cell"


def what_must_rest_rests(seen: Run):
    """Fixed vertices, interfaces, what is not selected and values keep their bits."""
    mesh, points = seen.mesh, seen.result.points
    rests = ~movable_vertices(mesh, seen.method)
    assert points[rests].tobytes() == mesh.points[rests].tobytes(), "moved what is fixed"
    if mesh.surface == "flat":
        assert points[:, 2:].tobytes() == mesh.points[:, 2:].tobytes(), "changed a value"
    assert np.isfinite(points).all(), "lost a vertex"
    assert all(
        np.array_equal(a, b) for a, b in zip(seen.result.mesh.cells, mesh.cells, strict=True)
    )


def figures_get_no_worse(seen: Run):
    """A method that untangles lowers no figure of a valid mesh, but by a trade that was one.

    The mean shape may then fall by `mean_loss` of the best that was seen, for a worst cell that is
    clearly better. After untangling there is nothing to keep.
    """
    mesh, after, trades = seen.mesh, seen.result.mesh, seen.result.outcome.trades
    held = seen.method.untangles and not invalid_cells(mesh).any()
    old, new = quality(mesh), quality(after)
    fell = held and new.shape.mean() < old.shape.mean()
    assert bool(trades) == fell, "a trade that is not told, or was none"
    if held:
        slack = 1e-9 if mesh.plane is not None else 0.0  # points are rounded once more in space
        assert new.min_angle.min() >= old.min_angle.min() - slack, "a smaller smallest angle"
        assert new.max_angle.max() <= old.max_angle.max() + slack, "a larger largest angle"
        assert new.scaled_jacobian.min() >= old.scaled_jacobian.min() - slack, "a worse cell"
    if fell:
        best = max([old.shape.mean(), *(record.mean_shape for record in seen.records)])
        loss = getattr(seen.method, "mean_loss", 0.0)
        assert new.shape.mean() >= (1.0 - loss) * best, "gave up more than is allowed"
        movable = movable_vertices(mesh, seen.method)
        gained = free_jacobian(after, movable) - free_jacobian(mesh, movable)
        assert gained > LEAST_TRADE - 1e-9, "gave up the mean shape for nothing"
        (trade,) = trades
        assert (trade.figure, trade.gained) == ("mean_shape", "scaled_jacobian")
        assert (trade.before, trade.after) == (old.shape.mean(), new.shape.mean())


def sweeps_are_counted(seen: Run):
    """Never more sweeps than allowed; the stages and the history tell of the same ones."""
    result, method = seen.result, seen.method
    assert result.sweeps <= method.max_sweeps, "too many sweeps"
    assert result.sweeps == sum(stage.sweeps for stage in result.outcome.stages)
    assert tuple(seen.records) == tuple(result.history), "the callback heard something else"
    assert all(stage.sweeps >= 0 and stage.steps >= 0 for stage in result.outcome.stages)
    assert bool(seen.records) == (result.sweeps > 0), "sweeps that no record tells of"
    gained = sum(stage.gain["n_invalid"] for stage in result.outcome.stages)
    last = seen.records[-1].n_invalid if seen.records else result.before.n_invalid
    assert gained == last - result.before.n_invalid, "gains that are none"


def outcome_is_true(seen: Run):
    """What the outcome says of the result is so."""
    mesh, method, result, outcome = seen.mesh, seen.method, seen.result, seen.result.outcome
    movable = movable_vertices(mesh, method)
    same = np.array_equal(result.points, mesh.points)
    assert (outcome.method, outcome.chosen) == (method.name, "")
    assert (outcome.guarded, outcome.untangles) == (method.guards, method.untangles)
    assert outcome.selected == (method.selection is not None)
    assert outcome.unchanged == same, "says that it is unchanged, or that it is not"
    assert result.before == quality(mesh).summary(), "summary of another mesh before"
    assert result.after == quality(result.mesh).summary(), "summary of another mesh after"
    bad, worse = invalid_cells(mesh), invalid_cells(result.mesh)
    assert (outcome.invalid is None) == (not bad.any() and not worse.any()), "invalid cells"
    if outcome.invalid is not None:
        assert (outcome.invalid.before, outcome.invalid.after) == (bad.sum(), worse.sum())
        assert outcome.invalid.first == (np.argmax(worse) if worse.any() else -1)
        hopeless = hopeless_cells(result.mesh, movable)
        assert outcome.invalid.proven == (hopeless.sum() if method.untangles else 0)
        if outcome.invalid.proven:
            assert outcome.invalid.first_proven == np.argmax(hopeless)
    assert (outcome.cut is not None) == seen.is_cut
    if outcome.cut is not None:
        assert outcome.cut.quads == (np.diff(mesh.cell_offsets) == 4).sum()
        assert outcome.cut.broken == (worse & ~bad).sum()


def used_up_its_share(seen: Run):
    """Whether the last of several groups of cells made all the sweeps that it was given."""
    groups = seen.method.stages() if isinstance(seen.method, SweepingMethod) else []
    made = seen.result.outcome.stages
    return len(groups) == len(made) > 1 and made[-1].sweeps == groups[-1][1]


def stop_is_true(seen: Run):
    """It stopped for the reason that it gives."""
    method, result, outcome = seen.method, seen.result, seen.result.outcome
    nothing = not movable_vertices(seen.mesh, method).any()
    if nothing:
        assert outcome.stop in (Stop.NOTHING_MOVES, Stop.STUCK), "whether a vertex can move"
    else:
        assert outcome.stop is not Stop.NOTHING_MOVES, "whether a vertex can move"
    assert result.converged == outcome.stop.by_itself
    holds = {
        Stop.NOTHING_MOVES: result.sweeps == 0 and outcome.unchanged,
        Stop.MAX_SWEEPS: result.sweeps == method.max_sweeps or used_up_its_share(seen),
        Stop.TIME_LIMIT: method.time_limit is not None,
        Stop.RESTS: bool(len(result.history))
        and result.history[-1].largest_share <= getattr(method, "rtol", -1.0),
        Stop.VALID: result.after.n_invalid == 0,
        Stop.STUCK: result.after.n_invalid > 0,
        Stop.TARGET_QUALITY: getattr(method, "target_quality", None) is not None
        and free_jacobian(result.mesh, movable_vertices(seen.mesh, method))
        >= method.target_quality - 1e-9,
        Stop.SETTLED: result.sweeps > 0,
    }
    assert holds[outcome.stop], f"stopped by {outcome.stop}?"
    option = {Stop.RESTS: "rtol", Stop.TARGET_QUALITY: "target_quality"}.get(
        outcome.stop, outcome.stop.value
    )
    told = getattr(method, option, None)
    assert np.isnan(outcome.stop_at) if told is None else outcome.stop_at == told


def can_be_told(seen: Run):
    """The result can be written as JSON and said in one line."""
    plain = seen.result.to_dict()
    again = json.loads(json.dumps(plain, allow_nan=False))
    assert again["outcome"]["stop"] == seen.result.outcome.stop
    assert again["outcome"]["sweeps"] == again["sweeps"] == seen.result.sweeps
    assert again["outcome"]["unchanged"] == seen.result.outcome.unchanged
    assert len(again["history"]) == len(seen.result.history)
    assert seen.result.reason.strip(), "stopped without a word"
    assert "\n" not in seen.result.reason


OF_ONE_RUN = [
    corners_stay_convex,
    invalid_cells_get_no_more,
    worst_cell_keeps_its_quality,
    what_must_rest_rests,
    figures_get_no_worse,
    sweeps_are_counted,
    outcome_is_true,
    stop_is_true,
    can_be_told,
]


def check(mesh, method):
    """Hold a method to all that can be seen in one run; a mesh that it refuses, it refuses.

    Gives the run, None where it was refused.
    """
    points = mesh.points.copy()
    seen, refusal = None, ""
    try:
        seen = run(mesh, method)
    except ValueError as error:
        refusal = str(error)
    assert refusal == spelled(method.why_not(mesh)), "refuses other meshes than it says"
    assert mesh.points.tobytes() == points.tobytes(), "changed its input"
    if seen is not None:
        for promise in OF_ONE_RUN:
            promise(seen)
    return seen


# ------------------------------------------------------------------------------- several runs


def told(seen: Run):
    """All that must be the same in two runs: bits, history, outcome but for the clock."""
    plain = seen.result.to_dict()
    del plain["seconds"]
    for stage in plain["outcome"]["stages"]:
        del stage["seconds"]
    return seen.result.points.tobytes(), plain, seen.result.reason


def bits_are_the_same(mesh, method, n_threads=2):
    """Run twice, on several threads, and colour by colour: always the same bits."""
    once = run(mesh, method)
    assert told(run(mesh, method)) == told(once), "another result the second time"
    assert told(run(mesh, method, threads=n_threads)) == told(once), "depends on the threads"
    calls = []
    with mock.patch.object(Threads, "run", Stepwise(calls.append).run):
        step_by_step = run(mesh, method)
    assert told(step_by_step) == told(once), "depends on what runs the colours"
    assert len(calls) >= once.result.sweeps, "sweeps that no engine runs"


def follows_the_input(made, method, *, scale=1.0, turn=0.0, shift=(0.0, 0.0), mirror=False):
    """Turned, scaled, shifted, mirrored input gives so changed output."""
    motion = {
        "scale": scale,
        "turn": turn,
        "shift": (shift[0] * scale, shift[1] * scale),
        "mirror": mirror,
    }
    result = smooth(made.mesh, method)
    other = smooth((place(made.points, **motion), made.cells), method)
    expected = place(result.points, **motion)
    np.testing.assert_allclose(other.points, expected, rtol=0.0, atol=1e-9 * scale)


def scales_by_bits(made, method, power):
    """A power of two changes no bit but those of the exponent."""
    factor = 2.0**power
    result = smooth(made.mesh, method)
    other = smooth((made.points * factor, made.cells), method)
    assert np.array_equal(other.points, result.points * factor), "depends on the unit"


def numbering_breaks_nothing(made, points, cells, new_of, method):
    """In another numbering: as valid, the same vertices fixed; on triangles about as good, too."""
    result, other = smooth(made.mesh, method), smooth((points, cells), method)
    fixed = made.mesh.is_fixed
    assert np.array_equal(other.points[new_of][fixed], made.points[fixed]), "moved what is fixed"
    if method.guards:
        assert not invalid_cells(other.mesh).any(), "not valid in another numbering"
    if getattr(method, "guard", None) == "quality" or method.untangles:
        assert other.after.worst["scaled_jacobian"] >= other.before.worst["scaled_jacobian"]
    if all(block.shape[1] == 3 for block in cells):
        # The order of the updates is another, so it ends near by at best.
        gained = abs(result.after.mean["shape"] - result.before.mean["shape"])
        apart = abs(other.after.mean["shape"] - result.after.mean["shape"])
        assert apart <= 0.02 + 0.35 * gained, "another mean shape"
