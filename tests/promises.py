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
import pytest
from hypothesis import strategies as st

import qsmooth
import reference
from meshes import KINDS, place, random_mesh, random_meshes, tangle
from qsmooth import Constraints, Mesh, SmoothResult, Stop, Untangle, smooth
from qsmooth.engine import Stepwise, Threads
from qsmooth.methods.base import Method
from qsmooth.methods.driver import SweepingMethod
from qsmooth.options import spelled
from qsmooth.outcome import Aim
from qsmooth.selection import select_cells, select_vertices, vertices_of
from qsmooth.split import split_quads

# How much worse than what is held a figure may be, relative to itself; for rounding.
HELD = 1e-9
# Gains of less than this do not count when the best mean is sought.
LEAST_GAIN = 2e-3
# The figures that can be held by an option, and whether they are better when larger.
HOLDABLE = {"aspect_ratio": False, "shape": True, "min_edge": True}


# ------------------------------------------------------------------------------- any options

SELECTIONS = st.sampled_from([None, [0], [0, 1, 2], "max_angle > 100", "shape < 0.8"])
# Of the sign of coordinates, which no unit changes.
FIXED = st.sampled_from([None, [0, 1, 2], "x < 0", "y >= 0 and x > 0, 3"])
DIRECTIONS = st.sampled_from([None, (1.0, 0.0), (0.6, -0.8)])
HOLDS = st.sets(st.sampled_from(["aspect_ratio", "shape", "min_edge"]))
TARGETS = st.sampled_from(["auto", "ideal", "initial"])
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
        others = {
            "selection": SELECTIONS, "hold": HOLDS, "target": TARGETS, "fixed": FIXED,
            "directions": DIRECTIONS,
        }  # fmt: skip
        drawn = others.get(spec.name, st.just(spec.default))
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
    """Mark the cells that no placement of the movable vertices makes valid, as far as is seen.

    They have a corner that is not convex and whose three vertices all stay, or two vertices of a
    corner that stay at one place. Of the two cells of an interior vertex that has no others one is
    marked, if neither counts already.
    """
    hopeless, cells = np.zeros(mesh.n_cells, np.bool_), reference.as_lists(mesh)
    points = [tuple(p) for p in mesh.xy.tolist()]
    at = zip(mesh.cell_vertices.tolist(), mesh.topology.corner_cells.tolist(), strict=True)
    bad = dict(zip(at, (corner_signs(mesh) <= 0).tolist(), strict=True))
    for c, cell in enumerate(cells):
        for v, after, before in reference.corners(cell):
            stay = [w for w in (v, after, before) if not movable[w]]
            one_place = len({points[w] for w in stay}) < len(stay)
            hopeless[c] |= one_place or (len(stay) == 3 and bad[v, c])
    taken, stars = set(np.flatnonzero(hopeless).tolist()), {}
    for v, c in sorted(bad):
        stars.setdefault(v, []).append(c)
    for v, star in stars.items():
        if len(star) == 2 and not mesh.is_boundary[v] and not taken & set(star):
            taken |= set(star)
            hopeless[next(c for c in star if bad[v, c])] = True
    return hopeless


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
    if method.fixed is not None:
        movable &= ~select_vertices(mesh, method.fixed)
    return movable | sliding_vertices(mesh, method)


def sliding_vertices(mesh, method):
    """Mark the vertices that may slide, as the method says; no others than those on lines."""
    slides = np.zeros(mesh.n_vertices, np.bool_)
    if method.boundary == "slide":
        slides |= mesh.is_boundary
    if method.interfaces == "slide":
        slides |= mesh.is_interface
    return slides & method.freedom(mesh).movable if slides.any() else slides


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
    """Fixed vertices, interfaces and what is not selected keep their bits, and values theirs."""
    mesh, points = seen.mesh, seen.result.points
    rests = ~movable_vertices(mesh, seen.method)
    assert points[rests].tobytes() == mesh.points[rests].tobytes(), "moved what is fixed"
    if mesh.surface == "flat":
        z, was = points[:, 2], mesh.points[:, 2]
        if seen.method.carry == "keep":
            assert z.tobytes() == was.tobytes(), "changed a value"
        assert z.min() >= was.min(), "a value below all others"
        assert z.max() <= was.max(), "a value over all others"
    assert np.isfinite(points).all(), "lost a vertex"
    assert all(
        np.array_equal(a, b) for a, b in zip(seen.result.mesh.cells, mesh.cells, strict=True)
    )


def nothing_is_too_far(seen: Run):
    """No vertex comes farther than it may, nor off the line along which it may move."""
    mesh, method, points = seen.mesh, seen.method, seen.result.points
    moves = points - mesh.points
    if mesh.plane is None:
        moves = moves[:, :2]  # z is no place there
    lengths = np.linalg.norm(moves, axis=1)
    if method.max_move is not None:
        assert (lengths <= method.max_move).all(), "moved too far"
    if method.directions is not None and mesh.plane is None:
        ux, uy = method.directions
        ulp = np.spacing(np.abs(points[:, :2]).max())
        assert (np.abs(moves[:, 0] * uy - moves[:, 1] * ux) <= 3.0 * ulp).all(), "off its line"


def what_slides_stays_on_its_line(seen: Run):
    """Vertices that slide are on the lines that they were on, but for rounding."""
    mesh = seen.mesh
    slides = sliding_vertices(mesh, seen.method) & (mesh.is_boundary | mesh.is_interface)
    if not slides.any() or mesh.plane is not None:
        return
    on_line = mesh.is_boundary | mesh.is_interface
    a = np.repeat(np.arange(mesh.n_vertices), np.diff(mesh.ring_offsets))
    b = mesh.ring_vertices
    both = on_line[a] & on_line[b] & (a < b)
    start, step = mesh.xy[a[both]], mesh.xy[b[both]] - mesh.xy[a[both]]
    away = seen.result.points[slides, None, :2] - start
    share = np.clip((away * step).sum(axis=2) / (step * step).sum(axis=1), 0.0, 1.0)
    off = np.linalg.norm(away - share[..., None] * step, axis=2).min(axis=1)
    assert (off <= 4.0 * np.spacing(np.abs(mesh.xy).max())).all(), "left its line"


def held_from(seen: Run):
    """The mesh whose worst figures are held: the input, or what untangling alone makes of it.

    None where there is none: untangling is all that is done, or where that went can't be repeated.
    """
    mesh, method = seen.mesh, seen.method
    if not invalid_cells(mesh).any():
        return mesh
    stages = seen.result.outcome.stages
    if method.time_limit is not None or mesh.plane is not None or not stages:
        return None
    if stages[0].aim is not Aim.UNTANGLE or method.name == "untangle":
        return None
    constraints = {name: getattr(method, name) for name in Constraints.specs()}
    alone = Untangle(max_sweeps=method.max_sweeps, threads=1, **constraints)
    return smooth(mesh, alone).mesh


def cells_that_count(mesh):
    """Mark the cells whose figures are held: valid ones, but those of interior vertices with two.

    One of these two is not valid whatever is done, and so the other can't be good.
    """
    n_cells = np.bincount(mesh.cell_vertices, minlength=mesh.n_vertices)
    doublets = (n_cells == 2) & ~mesh.is_boundary
    beside = np.logical_or.reduceat(doublets[mesh.cell_vertices], mesh.cell_offsets[:-1])
    return ~invalid_cells(mesh) & ~beside


def corner_figures(mesh, cells):
    """Smallest angle, largest angle, smallest sine (over 60 degrees' in triangles): in radians.

    Of these cells, (n_cells,).
    """
    offsets, vertices = mesh.cell_offsets, mesh.cell_vertices
    at = np.arange(len(vertices))
    first, last = (np.repeat(ends, np.diff(offsets)) for ends in (offsets[:-1], offsets[1:]))
    u = mesh.xy[vertices[np.where(at + 1 < last, at + 1, first)]] - mesh.xy[vertices]
    w = mesh.xy[vertices[np.where(at > first, at - 1, last - 1)]] - mesh.xy[vertices]
    det, dot = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0], (u * w).sum(axis=1)
    angles = np.arctan2(det, dot)
    best = np.where(last - first == 3, np.sqrt(0.75), 1.0)
    counts = np.repeat(cells, np.diff(offsets))
    angles, u, w = angles[counts], u[counts], w[counts]
    sines = det[counts] / np.hypot(u[:, 0], u[:, 1]) / np.hypot(w[:, 0], w[:, 1]) / best[counts]
    return angles.min(), angles.max(), sines.min()


def figures_get_no_worse(seen: Run):
    """What a method that untangles holds gets no worse, and the mean falls by `mean_loss` at most.

    Held are the smallest and the largest angle, the smallest scaled Jacobian, and what the option
    `hold` lists; of an invalid mesh those after untangling, and of cells that stay invalid none.
    """
    if not seen.method.untangles or (start := held_from(seen)) is None:
        return
    after, cells = seen.result.mesh, cells_that_count(start)
    assert not (corner_signs(start)[corner_signs(after) <= 0] > 0).any(), "lost a convex corner"
    if not cells.any():
        return
    old, new = corner_figures(start, cells), corner_figures(after, cells)
    # Points are rounded once more in space.
    slack = HELD if start.plane is None else 1e-7
    # An angle is known to about its rounding over its sine: only slivers are as bad as that.
    fine = 1e-15 / max(old[2], 1e-8)
    assert new[0] >= old[0] * (1.0 - slack) - fine, "a smaller smallest angle"
    assert new[1] <= old[1] * (1.0 + slack) + fine, "a larger largest angle"
    assert new[2] >= old[2] * (1.0 - slack), "a worse cell"
    for name in getattr(seen.method, "hold", ()):
        best = 1.0 if HOLDABLE[name] else -1.0
        before, now = ((best * quality(mesh)[name][cells]).min() for mesh in (start, after))
        assert now >= before - slack * abs(before), f"a worse {name}"
    told = seen.result.outcome.target
    if told is None:
        # Without an aim of its own a method is held to the mean shape.
        lowest = quality(start).shape.mean()
        loss = getattr(seen.method, "mean_loss", 0.0) if seen.method.name != "untangle" else 1.0
        best = max([lowest, *(record.mean_shape for record in seen.records)])
        assert quality(after).shape.mean() >= (1.0 - loss) * best - LEAST_GAIN, "lost of the mean"
        return
    allowed = 1.0 - seen.method.mean_loss
    assert told.after >= allowed * told.before - LEAST_GAIN, "lost of the mean"
    if told.kind == "ideal" and not invalid_cells(start).any():
        means = quality(start).shape.mean(), quality(after).shape.mean()
        assert (told.before, told.after) == pytest.approx(means, rel=1e-9), "tells another mean"


def trades_are_told(seen: Run):
    """Every figure that can be given up, and got worse by over one percent, is told of; no other.

    What it was given for is a figure that gained, and none gained more.
    """
    told = {trade.figure: trade for trade in seen.result.outcome.trades}
    if seen.result.outcome.target is None:
        assert not told, "a trade that was none"
        return
    start = held_from(seen)
    if start is None or invalid_cells(start).any():
        return
    old, new = quality(start), quality(seen.result.mesh)
    figures = {name: (old[name].min(), new[name].min()) for name in ("shape", "min_edge")}
    figures["mean_shape"] = old.shape.mean(), new.shape.mean()
    figures["aspect_ratio"] = old.aspect_ratio.max(), new.aspect_ratio.max()
    for name, (before, after) in figures.items():
        ratio = before / after if name == "aspect_ratio" else after / before
        limit = 1.0 / 1.01 if name == "aspect_ratio" else 0.99
        if abs(ratio - limit) > 1e-9:
            assert (name in told) == (ratio < limit), f"a trade of {name} untold, or none"
        if name in told:
            trade = told[name]
            assert (trade.before, trade.after) == pytest.approx((before, after), rel=1e-9)
    for trade in told.values():
        if trade.gained in figures:
            pair = trade.gained_before, trade.gained_after
            assert pair == pytest.approx(figures[trade.gained], rel=1e-9), "gained otherwise"


def what_holds_back_is_told(seen: Run):
    """A figure that kept something from getting better is held, and near where it is held."""
    told = seen.result.outcome.held
    assert len({held.figure for held in told}) == len(told), "a figure told of twice"
    if not told:
        return
    assert seen.result.converged, "tells what a run that was cut short could not do"
    names = ("min_angle", "max_angle", "scaled_jacobian", *getattr(seen.method, "hold", ()))
    assert {held.figure for held in told} <= set(names), "a figure that is not held"
    movable = movable_vertices(seen.mesh, seen.method)
    start, after = held_from(seen), seen.result.mesh
    for held in told:
        smaller = held.figure in ("max_angle", "aspect_ratio")
        corners = slice(*after.cell_offsets[held.cell : held.cell + 2])
        assert 1 <= held.vertices <= movable.sum()
        assert movable[after.cell_vertices[corners]].any(), "a cell that nothing changes"
        if start is None:
            continue
        # It is the worst of something in the mesh that counts: no better than the mesh's own.
        figures = quality(start)[held.figure][cells_that_count(start)]
        worst, slack = (figures.max() if smaller else figures.min()), 1e-6 * abs(held.value)
        assert (held.value - worst) * (-1.0 if smaller else 1.0) >= -slack, "held at what is worse"


def sizes_are_told(seen: Run):
    """Areas are compared with those of the input, and the shortest edge is that of the mesh."""
    sizes = seen.result.outcome.sizes
    assert (sizes is None) == (seen.result.outcome.target is None)
    if sizes is None:
        return
    old, new = quality(seen.mesh), quality(seen.result.mesh)
    had_area = old.area > 0.0
    ratios = new.area[had_area] / old.area[had_area] if had_area.any() else [1.0]
    expected = np.percentile(ratios, [1, 50, 99])
    found = sizes.area_low, sizes.area_median, sizes.area_high
    assert found == pytest.approx(expected, rel=1e-6), "other areas"
    edges = old.min_edge.min(), new.min_edge.min()
    assert (sizes.min_edge_before, sizes.min_edge_after) == pytest.approx(edges, rel=1e-9)
    assert 0.0 <= sizes.layers <= 1.0


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
        Stop.STOP_QUALITY: getattr(method, "stop_quality", None) is not None
        and free_jacobian(result.mesh, movable_vertices(seen.mesh, method))
        >= method.stop_quality - 1e-9,
        # Cells that nothing could make better by a thousandth need no sweep to be known as such.
        Stop.SETTLED: result.sweeps > 0
        or (
            outcome.unchanged
            and free_jacobian(result.mesh, movable_vertices(seen.mesh, method)) > 1.0 - 1e-3
        ),
    }
    assert holds[outcome.stop], f"stopped by {outcome.stop}?"
    option = {Stop.RESTS: "rtol", Stop.STOP_QUALITY: "stop_quality"}.get(
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


def values_are_those_of_the_input(seen: Run):
    """Each z is the one that some cell of the input has there, and the outcome says the change."""
    mesh, result = seen.mesh, seen.result
    flat = mesh.surface == "flat" and not np.array_equal(result.mesh.xy, mesh.xy)
    assert [record.name for record in result.outcome.carried] == ["z"] * flat
    if not flat:
        return
    (record,) = result.outcome.carried
    moved = (result.mesh.xy != mesh.xy).any(axis=1)
    assert record.vertices == moved.sum()
    assert record.interpolated == (seen.method.carry == "interpolate")
    change = np.abs(result.points - mesh.points)[moved, 2]
    if record.interpolated:
        assert record.largest == change.max(), "tells of another change"
        np.testing.assert_allclose(record.rms, np.sqrt((change**2).mean()), rtol=1e-9, atol=0)
    else:
        again = smooth(mesh, replace(seen.method, carry="interpolate", callback=None))
        assert record == replace(again.outcome.carried[0], interpolated=False)


OF_ONE_RUN = [
    corners_stay_convex,
    invalid_cells_get_no_more,
    worst_cell_keeps_its_quality,
    what_must_rest_rests,
    nothing_is_too_far,
    values_are_those_of_the_input,
    what_slides_stays_on_its_line,
    figures_get_no_worse,
    trades_are_told,
    what_holds_back_is_told,
    sizes_are_told,
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
    inside = movable_vertices(mesh, method) & ~sliding_vertices(mesh, method)
    if inside.any():
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
    if method.max_move is not None:
        # Not where that would round it, or be no length any more.
        method = replace(method, max_move=min(max(method.max_move, 1e-200), 1e200))
    result = smooth(made.mesh, method)
    if method.max_move is not None:
        method = replace(method, max_move=method.max_move * factor)
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
