"""What is held: region by region, without what nothing can mend, and never worse by a hair."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import promises
from meshes import KINDS, grid, random_mesh, tangle
from qsmooth import Mesh, Optimize, quality, smooth
from qsmooth.engine import threads_for
from qsmooth.examples import jittered, random_triangles, structured, tangled
from qsmooth.metrics import Validity
from qsmooth.optimizer.caps import FREE, HELD, HOLDABLE, Caps
from qsmooth.optimizer.lanes import Lanes
from qsmooth.targets import ideal


def caps_of(mesh, also=()):
    caps = Caps(mesh.topology, ~mesh.is_fixed)
    caps.hold(mesh.xy, also)
    return caps


def good_and_bad():
    """Two squares beside each other, one jittered and one much more; what they share is fixed."""
    mesh = jittered(20, 10, amount=0.45, seed=2)
    points, at = mesh.points.copy(), structured(20, 10).points
    left = at[:, 0] < 10.0 / 20.0 * at[:, 0].max()
    points[left] += 0.6 * (at - points)[left]
    shared = at[:, 0] == 0.5 * at[:, 0].max()
    points[shared] = at[shared]
    return Mesh(points, mesh.cells, fixed=shared)


LEFT = np.tile(np.arange(20) < 10, 10)
HALVES = LEFT, ~LEFT


@pytest.mark.nojit
def test_regions_are_what_movable_vertices_connect():
    mesh = good_and_bad()
    of_vertices, of_cells = caps_of(mesh).regions
    assert sorted(set(of_vertices.tolist())) == [-1, 0, 1]
    assert np.array_equal(of_vertices == -1, mesh.is_fixed)
    assert set(of_cells[LEFT].tolist()) == {0}
    assert set(of_cells[~LEFT].tolist()) == {1}
    caps = caps_of(mesh)
    own = quality(mesh)
    for region, half in enumerate(HALVES):
        v = int(np.flatnonzero(of_vertices == region)[0])
        assert np.degrees(np.arccos(caps.held[v, 0])) == pytest.approx(
            own.min_angle[half].min(), abs=1e-4
        )
        cell = int(np.flatnonzero(half)[45])
        assert caps.value("max_angle", cell) == pytest.approx(own.max_angle[half].max(), abs=1e-4)
    for held in caps.held[mesh.is_fixed]:
        assert held == pytest.approx(FREE, rel=1e-9)


@pytest.mark.parametrize("hold", [(), HOLDABLE])
def test_each_region_gets_no_worse_than_its_own_worst(hold):
    mesh = good_and_bad()
    result = promises.check(mesh, Optimize(hold=hold)).result
    before, after = quality(mesh), quality(result.mesh)
    for half in HALVES:
        for name in ("min_angle", "scaled_jacobian", *hold):
            worse = np.max if name == "aspect_ratio" else np.min
            old, new = worse(before[name][half]), worse(after[name][half])
            assert (new - old) * (-1.0 if name == "aspect_ratio" else 1.0) >= -1e-9 * abs(old)
        assert after.max_angle[half].max() <= before.max_angle[half].max() * (1.0 + 1e-9)


def test_a_good_region_gets_no_worse_for_the_sake_of_its_mean_beside_a_bad_one():
    # Where the worst cells have been seen to the mean would take some of that back.
    good = smooth(random_triangles(200, seed=0), Optimize(target="ideal")).mesh
    bad = random_triangles(200, seed=1)
    n, m = good.n_vertices, good.n_cells
    mesh = Mesh(
        np.concatenate([good.points, bad.points + np.array([2.0, 0.0])]),
        [np.concatenate([good.cells[0], bad.cells[0] + n])],
    )
    before = quality(mesh)
    assert before.min_angle[m:].min() < before.min_angle[:m].min() - 10.0
    result = promises.check(mesh, Optimize(target="ideal", worst=False)).result
    after = quality(result.mesh)
    assert not np.array_equal(result.points[:n], mesh.points[:n])
    assert after.min_angle[:m].min() >= before.min_angle[:m].min() * (1.0 - 1e-9)
    assert after.max_angle[:m].max() <= before.max_angle[:m].max() * (1.0 + 1e-9)


def settled_but_far_from_the_worst(seed):
    """Triangles as good as they get, and then all shaken that are far from the largest angle."""
    settled = smooth(random_triangles(600, seed=seed), Optimize(target="ideal")).mesh
    own = quality(settled)
    worst = settled.points[settled.cells[0][own.max_angle.argmax()]].mean(axis=0)
    shortest = np.full(settled.n_vertices, np.inf)
    np.minimum.at(shortest, settled.cell_vertices, np.repeat(own.min_edge, 3))
    far = (np.linalg.norm(settled.points - worst, axis=1) > 0.2) & ~settled.is_fixed
    shift = np.random.default_rng(seed).uniform(-1.0, 1.0, settled.points.shape)
    return settled.with_points(settled.points + shift * (0.25 * shortest * far)[:, None])


@pytest.mark.parametrize("seed", [2, 7, 13])
def test_one_region_does_not_veto_what_others_gain(monkeypatch, seed):
    mesh = settled_but_far_from_the_worst(seed)
    for method in (Optimize(target="ideal"), Optimize(target="ideal", worst=False)):
        held = promises.check(mesh, method).result
        assert held.after.worst["max_angle"] <= mesh_angle(mesh) * (1.0 + 1e-9)
        assert held.after.mean["shape"] > held.before.mean["shape"] + 0.02
        assert held.after.worst["min_angle"] > held.before.worst["min_angle"] + 1.0
    # Left to itself the mean gives the largest angle up, at one place; held there it gains as much.
    monkeypatch.setattr(Caps, "hold", lambda *_, **__: None)
    free = smooth(mesh, method)
    assert free.after.worst["max_angle"] > mesh_angle(mesh) + 0.1
    assert held.after.mean["shape"] > free.after.mean["shape"] - 1e-3


def mesh_angle(mesh):
    return quality(mesh).max_angle.max()


@pytest.mark.nojit
@pytest.mark.parametrize("held", [False, True])
def test_where_no_angle_is_held_invalid_cells_are_forbidden_all_the_same(held):
    mesh = random_mesh("mixed", 4, seed=3, amount=0.9).mesh
    caps = Caps(mesh.topology, ~mesh.is_fixed)
    if held:
        caps.hold(mesh.xy, angles=False)
    assert not caps.forbidden(mesh.xy).any()
    trial = mesh.xy.copy()
    trial[np.flatnonzero(~mesh.is_fixed)[0]] += 10.0  # beyond all its cells
    invalid = quality(mesh.with_points(trial)).validity != Validity.VALID
    assert invalid.any()
    assert np.array_equal(caps.forbidden(trial), invalid)


# ------------------------------------------------------------------------------- a part of a mesh


@pytest.mark.parametrize("hold", [(), *((name,) for name in HOLDABLE), HOLDABLE])
def test_what_is_selected_is_held_too(hold):
    mesh = jittered(24, 24, amount=0.45, seed=6)
    method = Optimize(hold=hold, selection="max_angle > 130", selection_rings=1)
    result = promises.check(mesh, method).result
    movable = promises.movable_vertices(mesh, method)
    moved = (result.points != mesh.points).any(axis=1)
    assert moved.any()
    assert not moved[~movable].any()
    assert result.after.worst["min_angle"] > result.before.worst["min_angle"]


@pytest.mark.parametrize("hold", [(), HOLDABLE])
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_selected_tangles_are_mended_and_then_held(kind, hold):
    mesh = tangled(16, 16, amount=1.2, seed=5, kind=kind)
    method = Optimize(hold=hold, selection="scaled_jacobian <= 0", selection_rings=2)
    result = promises.check(mesh, method).result
    assert result.after.n_invalid < result.before.n_invalid
    rests = ~promises.movable_vertices(mesh, method)
    assert np.array_equal(result.points[rests], mesh.points[rests])


@pytest.mark.nojit
def test_parts_of_a_selection_that_do_not_touch_are_regions():
    mesh = jittered(12, 12, amount=0.3, seed=1)
    method = Optimize(selection=[13, 14, 130], max_sweeps=20)
    movable = promises.movable_vertices(mesh, method)
    of_vertices, _ = Caps(mesh.topology, movable).regions
    assert of_vertices.max() == 1
    promises.check(mesh, method)


# ------------------------------------------------------------------------------- what sets no cap


def with_hopeless_cell(kind="quad"):
    """Jittered cells, and one whose two boundary vertices are at one place."""
    mesh = jittered(12, 12, amount=0.35, seed=4, kind=kind)
    points = mesh.points.copy()
    points[3] = points[4]
    return mesh.with_points(points)


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
@pytest.mark.parametrize("hold", [(), HOLDABLE])
def test_hopeless_cells_set_no_cap_and_veto_nothing(kind, hold):
    mesh = with_hopeless_cell(kind)
    before = quality(mesh)
    assert before.n_invalid == 1
    caps = caps_of(mesh, hold)
    assert caps.lost.sum() == 1
    assert not caps.forbidden(mesh.xy).any()
    assert np.abs(caps.held[np.flatnonzero(caps.regions[0] == 0)[0], :3]).max() < 1.0
    result = promises.check(mesh, Optimize(hold=hold)).result
    after = quality(result.mesh)
    assert after.n_invalid == 1
    others = ~caps.lost
    assert after.shape[others].mean() > before.shape[others].mean() + 0.02
    assert after.min_angle[others].min() >= before.min_angle[others].min() * (1.0 - 1e-9)
    assert after.max_angle[others].max() <= before.max_angle[others].max() * (1.0 + 1e-9)
    if not hold:
        assert after.min_angle[others].min() > before.min_angle[others].min() + 3.0


@pytest.mark.nojit
@pytest.mark.parametrize("n", [2, 3])
def test_where_every_vertex_is_one_of_a_hopeless_cell(n):
    # Of the two-by-two grid the only one; of the other all four, in cells at its corners.
    points, cells = grid(n, n)
    corners = [0, n, n * (n + 1), (n + 1) ** 2 - 1]
    points[corners] = points[[1, n - 1, n * (n + 1) + 1, (n + 1) ** 2 - 2]]
    result = promises.check(Mesh(points, cells), Optimize(max_sweeps=60)).result
    assert result.after.n_invalid == 4


def test_the_worst_cells_are_mended_beside_a_doublet():
    points, (quads,) = grid(9, 9)
    rng = np.random.default_rng(5)
    inside = ((points > 0) & (points < 9)).all(axis=1)
    points = points + rng.uniform(-0.25, 0.25, points.shape) * inside[:, None]
    a, b, c, d = quads[40]
    cells = [*np.delete(quads, 40, axis=0), (a, b, c, 100), (a, 100, c, d)]
    mesh = Mesh([*points, points[[a, c]].mean(axis=0)], [np.array(cells)])
    caps = caps_of(mesh)
    assert np.array_equal(np.flatnonzero(caps.lost), [80, 81])
    result = promises.check(mesh, Optimize()).result
    old, new = quality(mesh), quality(result.mesh)
    assert new.n_invalid == result.outcome.invalid.proven == 1
    assert new.scaled_jacobian[:80].min() > old.scaled_jacobian[:80].min() + 0.1


def test_a_cell_without_a_shape_weighs_no_others():
    # A doublet alone: both cells are flat at it, and stay so.
    points = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 1)]
    doublet = Mesh(points, [(0, 1, 2, 4), (0, 4, 2, 3)])
    result = promises.check(doublet, Optimize()).result
    assert result.after.n_invalid == result.outcome.invalid.proven == 1
    assert np.isfinite(result.points).all()


@given(st.sampled_from(sorted(KINDS)), st.integers(0, 2**32 - 1), st.floats(0.1, 1.2))
def test_cells_that_stay_invalid_get_no_more_and_others_are_held(kind, seed, amount):
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](4, rng)
    points = tangle(points, cells, rng, amount)
    fixed = rng.random(len(points)) < 0.3  # what is fixed where it is tangled stays so
    mesh = Mesh(points, cells, fixed=fixed)
    promises.check(mesh, Optimize(max_sweeps=60))


# ------------------------------------------------------------------------------- by no hair


def slivers(kind, n, seed, least):
    """Cells of one kind, one of which is so flat that rounding shows, at a place of its own."""
    made = random_mesh(kind, n, seed=seed, amount=0.9)
    return Mesh(made.points * (1.0, least), made.cells)


@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "triangle fan"])
@pytest.mark.parametrize("least", [1.0, 1e-3, 1e-6, 1e-9])
def test_the_state_that_sets_the_caps_meets_them(kind, least):
    for seed in range(5):
        mesh = slivers(kind, 4, seed, least)
        caps = caps_of(mesh, HOLDABLE)
        assert not caps.forbidden(mesh.xy)[quality(mesh).validity == Validity.VALID].any()


@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
@pytest.mark.parametrize("least", [1.0, 1e-2, 1e-5])
def test_a_worst_corner_does_not_freeze_its_cell(kind, least):
    # Every vertex is tried with caps as they are at the very place where it is, and far beyond:
    # what is refused with the one and not the other makes something worse.
    from qsmooth.kernels.newton_sweep import Wall

    mesh = slivers(kind, 5, 3, least)
    lanes = Lanes(mesh.topology, mesh.topology.schedule(True), threads_for(1, mesh.n_vertices))
    lanes.aim_at(ideal(mesh.topology))
    lanes.caps.hold(mesh.xy, HOLDABLE)
    nothing = np.tile(FREE, (mesh.n_vertices, 1))
    wall = Wall(1.0, np.inf, 1)
    refused = 0
    for colour in range(lanes.n_colours):
        xy, free = mesh.xy.copy(), mesh.xy.copy()
        vertices, can = lanes.try_colour(xy, colour, wall, lanes.caps.held)
        _, could = lanes.try_colour(free, colour, wall, nothing)
        assert not (can & ~could).any()
        assert not lanes.caps.beyond(xy).any() or least < 1.0
        stays = could & ~can
        refused += stays.sum()
        for v in vertices[stays]:
            trial = mesh.xy.copy()
            trial[v] = free[v]
            assert lanes.caps.beyond(trial)[
                mesh.star_cells[slice(*mesh.star_offsets[v : v + 2])]
            ].any()
    assert refused < 0.5 * lanes.movable.sum()


SCALES = st.sampled_from([1e-6, 1e-3, 1.0, 1e3, 1e6])
HOLDS = st.sampled_from([(), *((name,) for name in HOLDABLE), HOLDABLE])
TARGETS = st.sampled_from(["auto", "ideal", "initial"])


@given(
    st.sampled_from(sorted(KINDS)), st.integers(0, 2**32 - 1), st.sampled_from([0.3, 0.9]), SCALES,
    HOLDS, TARGETS,
)  # fmt: skip
@example("triangles", 7, 0.9, 1e6, HOLDABLE, "auto")
def test_what_is_held_is_never_worse_by_over_a_billionth(kind, seed, amount, scale, hold, target):
    mesh = random_mesh(kind, 4, seed=seed, amount=amount, scale=scale).mesh
    result = smooth(mesh, Optimize(hold=hold, target=target, max_sweeps=200))
    before, after = quality(mesh), quality(result.mesh)
    for name in (*HELD[:3], *hold):
        if name in ("max_angle", "aspect_ratio"):
            assert after[name].max() <= before[name].max() * (1.0 + 1e-9)
        else:
            assert after[name].min() >= before[name].min() * (1.0 - 1e-9)


@given(
    st.sampled_from(sorted(KINDS)), st.integers(0, 2**32 - 1), st.sampled_from([0.5, 1.0]), SCALES,
    HOLDS,
)  # fmt: skip
def test_nor_worse_than_the_untangled_mesh(kind, seed, amount, scale, hold):
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](4, rng)
    mesh = Mesh(tangle(points, cells, rng, amount) * scale, cells)
    promises.check(mesh, Optimize(hold=hold, max_sweeps=200))


@pytest.mark.parametrize("hold", [(), HOLDABLE])
def test_what_is_held_has_the_same_bits_on_two_threads(hold):
    for mesh in (with_hopeless_cell("mixed"), settled_but_far_from_the_worst(3)):
        promises.bits_are_the_same(mesh, Optimize(hold=hold, target="ideal"))
