"""The driver of methods that sweep: history, when it stops, and meshes with something wrong."""

import dataclasses

import numpy as np
import pytest

import promises
import reference
from meshes import annulus, grid, random_mesh, renumber, tilt
from qsmooth import Mesh, Quality, Stop, quality, smooth
from qsmooth.methods import driver
from qsmooth.methods.driver import SweepingMethod
from qsmooth.registry import all_methods, methods
from qsmooth.sums import exact_mean

SWEEPING = {name: m for name, m in methods().items() if issubclass(m, SweepingMethod)}
# With its defaults.
GUARDED = {name: m for name, m in SWEEPING.items() if m().guards}
every_sweeping = pytest.mark.parametrize("known", SWEEPING.values(), ids=SWEEPING)
every_guarded = pytest.mark.parametrize("known", GUARDED.values(), ids=GUARDED)


def rough(kind="mixed", size=6, seed=1):
    return random_mesh(kind, size, seed=seed, amount=0.9).mesh


# ------------------------------------------------------------------------------- history


@pytest.mark.nojit
@every_sweeping
def test_history_tells_what_each_sweep_did(known):
    mesh = rough(size=5)
    result = smooth(mesh, known(max_sweeps=4, rtol=0.0))
    assert result.sweeps == len(result.history) == 4
    before = mesh.points
    for n, record in enumerate(result.history, start=1):
        now = smooth(mesh, known(max_sweeps=n, rtol=0.0))
        assert now.history == result.history[:n]
        own = quality(now.mesh)
        assert record.min_angle == own.min_angle.min()
        assert record.max_angle == own.max_angle.max()
        assert record.mean_shape == exact_mean(own.shape)
        assert record.n_invalid == own.n_invalid
        moves = np.hypot(*(now.points - before).T)
        assert record.n_moved == (moves > 0.0).sum()
        assert record.largest_move == pytest.approx(moves.max(), rel=1e-9)
        assert record.largest_share > 0.0
        before = now.points
    (stage,) = result.outcome.stages
    assert stage.gain["mean_shape"] == pytest.approx(
        result.history[-1].mean_shape - result.before.mean["shape"]
    )
    assert stage.gain["n_invalid"] == result.after.n_invalid - result.before.n_invalid


# ------------------------------------------------------------------------------- when it stops


@pytest.mark.nojit
@every_sweeping
def test_rtol_of_zero_runs_all_sweeps(known):
    result = smooth(rough(size=3), known(rtol=0.0, max_sweeps=25))
    assert result.sweeps == 25
    assert result.outcome.stop is Stop.MAX_SWEEPS
    assert result.outcome.stop_at == 25
    assert not result.converged
    assert result.reason.startswith("stopped after 25 sweeps, as max_sweeps says")


@pytest.mark.nojit
@every_sweeping
def test_out_of_sweeps_is_a_result(known):
    result = smooth(rough(), known(max_sweeps=2))
    assert (result.sweeps, result.converged) == (2, False)
    assert result.outcome.stop is Stop.MAX_SWEEPS
    assert result.outcome.largest_share == result.history[-1].largest_share > 0.0
    assert "vertices still moved by up to" in result.reason


@every_sweeping
def test_rest_means_what_rtol_says(known):
    results = [
        (rtol, smooth(rough(kind, 4), known(rtol=rtol, max_sweeps=500)))
        for rtol in (0.3, 0.05, 0.01)
        for kind in ("mixed", "triangles")
    ]
    rested = [(rtol, r) for rtol, r in results if r.outcome.stop is Stop.RESTS]
    assert rested
    for rtol, result in rested:
        shares = result.history["largest_share"]
        assert shares[-1] <= rtol
        assert (shares[:-1] > rtol).all()
        assert result.outcome.stop_at == rtol
        assert result.converged


def test_quality_that_no_longer_improves_is_reason_to_stop():
    result = smooth(rough("L", 8, seed=2), "star", rtol=1e-12, max_sweeps=2000)
    assert result.outcome.stop is Stop.SETTLED
    assert result.converged
    assert result.reason == "quality no longer improves"
    n = driver.PATIENCE
    for name, sign, least in (
        ("min_angle", 1, driver.LEAST_ANGLE_GAIN),
        ("max_angle", -1, driver.LEAST_ANGLE_GAIN),
        ("mean_shape", 1, driver.LEAST_SHAPE_GAIN),
    ):
        values = sign * result.history[name]
        assert values[-n:].max() <= values[:-n].max() + least


# ------------------------------------------------------------------------------- threads


@every_sweeping
def test_two_threads_give_the_bits_of_one(known):
    # Several chunks a colour: threads have something to share.
    mesh = rough("mixed", 24, seed=9)
    results = [smooth(mesh, known(max_sweeps=8, rtol=0.0, threads=n)) for n in (1, 2, None)]
    for result in results[1:]:
        assert result.points.tobytes() == results[0].points.tobytes()
        assert result.history == results[0].history


# ------------------------------------------------------------------------------- guards


@pytest.mark.nojit
def test_plain_laplacian_inverts_cells_on_a_concave_domain_and_says_so():
    # Five cells around: the mean of the neighbours, along chords, lies within the hole.
    mesh = Mesh(*annulus(5, 2))
    result = smooth(mesh, "laplacian")
    assert result.before.n_invalid == 0
    n = result.after.n_invalid
    assert n > 0
    assert result.history[-1].n_invalid == n
    assert not result.outcome.guarded
    assert (result.outcome.invalid.before, result.outcome.invalid.after) == (0, n)
    assert f"laplacian is unguarded: it made {n} cells invalid" in result.reason
    for known in GUARDED.values():
        if not known().why_not(mesh):
            guarded = smooth(mesh, known())
            assert guarded.after.n_invalid == 0
            assert not guarded.history["n_invalid"].any()
            assert guarded.outcome.invalid is None


def at_the_edge(seed):
    """A valid mesh some of whose corners are convex by the last bits only, near 6e6."""
    rng = np.random.default_rng(seed)
    made = random_mesh("mixed", 4, seed=seed, amount=0.5, shift=(6e6, 6e6))
    points = made.points.copy()
    mesh = made.mesh
    cells = reference.as_lists(mesh)
    for v in rng.permutation(np.flatnonzero(~mesh.is_boundary))[:4]:
        # Go towards a neighbour's far side until one more bisection would break a corner.
        target = points[rng.integers(len(points))]
        low, high = 0.0, 1.0
        exact = reference.as_complex(points)
        for _ in range(60):
            share = 0.5 * (low + high)
            place = points[v] + share * (target - points[v])
            exact[v] = complex(*place)
            good = all(s > 0 for c in cells if v in c for s in reference.corner_signs(exact, c))
            low, high = (share, high) if good else (low, share)
        points[v] = points[v] + low * (target - points[v])
    return mesh.with_points(points)


@pytest.mark.parametrize("seed", range(8))
@every_guarded
def test_a_mesh_valid_by_a_hair_stays_valid(known, seed):
    mesh = at_the_edge(seed)
    assert not promises.invalid_cells(mesh).any()
    for guard in ("quality", "clearance"):
        for step in ({"step": 0.5}, {"step": 1.0}) if "step" in known.specs() else ({},):
            for sweeps in (1, 3):
                result = smooth(mesh, known(guard=guard, max_sweeps=sweeps, rtol=0.0, **step))
                assert not promises.invalid_cells(result.mesh).any()


@pytest.mark.nojit
def test_quality_guard_against_clearance_alone():
    # On good graded cells the paper's check alone lets the worst one fall, the default does not.
    for amount in (0.0, 0.1, 0.3):
        mesh = random_mesh("graded", 6, seed=1, amount=amount).mesh
        for method in ("star", "quad"):
            kept = smooth(mesh, method, rtol=0.0, max_sweeps=10)
            assert kept.after.worst["scaled_jacobian"] >= kept.before.worst["scaled_jacobian"]
            loose = smooth(mesh, method, rtol=0.0, max_sweeps=10, guard="clearance")
            assert loose.after.n_invalid == 0
            assert loose.after.worst["scaled_jacobian"] < loose.before.worst["scaled_jacobian"]


# ------------------------------------------------------------------------------- not so good meshes

ODD = {
    "two vertices at one place": (
        [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (0, 2), (1, 2), (2, 2), (1, 1)],
        [[(0, 1, 4, 3), (1, 2, 5, 4), (4, 5, 8, 7), (3, 4, 7, 6)], [(9, 5, 8)]],
    ),
    "an edge of no length": (
        [(0, 0), (1, 0), (2, 0), (0, 1), (2, 1), (2, 1), (0, 2), (1, 2), (2, 2)],
        [(0, 1, 4, 3), (1, 2, 5, 4), (4, 5, 8, 7), (3, 4, 7, 6)],
    ),
    "all at one place": ([(3, 3)] * 9, grid(2, 2)[1]),
    "all on a line": ([(k, 0) for k in range(9)], grid(2, 2)[1]),
    "a hanging node": (
        [(0, 0), (2, 0), (2, 1), (2, 2), (0, 2), (3, 0), (3.2, 1), (3, 2), (4, 0), (4, 1), (4, 2)],
        [(0, 1, 3, 4), (1, 5, 6, 2), (2, 6, 7, 3), (5, 8, 9, 6), (6, 9, 10, 7)],
    ),
    "a pinched vertex": (
        [(0, 0), (1, 0), (1, 1), (0, 1), (2, 1), (2, 2), (1, 2)],
        [(0, 1, 2, 3), (2, 4, 5, 6)],
    ),
    "a doublet": (
        [(0, 0), (2, 0), (2, 2), (0, 2), (0.9, 1)],
        [(0, 1, 2, 4), (0, 4, 2, 3)],
    ),
    "a cell inside out": (
        [(0, 0), (1, 0), (2, 0), (0, 1), (5, 5), (2, 1), (0, 2), (1, 2), (2, 2)],
        grid(2, 2)[1],
    ),
}


# Compiled alone: plain Python raises where an edge of no length is divided by.
@pytest.mark.parametrize("known", methods().values(), ids=methods())
@pytest.mark.parametrize("name", ODD)
def test_odd_meshes_keep_every_promise(name, known):
    points, cells = ODD[name]
    mesh = Mesh(np.array(points, dtype=float), cells)
    promises.check(mesh, known(max_sweeps=5))
    if "split_quads" in known.specs():
        promises.check(mesh, known(max_sweeps=5, rtol=0.0, split_quads=True))
    str(quality(mesh).summary())


@pytest.mark.nojit
def test_disconnected_parts_are_each_on_their_own():
    one = random_mesh("quads", 4, seed=1, amount=0.9)
    two = random_mesh("mixed", 4, seed=2, amount=0.9)
    n = len(one.points)
    both = Mesh(
        np.concatenate([one.points, two.points + 1000.0]),
        [*one.cells, *(block[:, ::-1] + n for block in two.cells)],
    )
    assert both.topology.n_parts == 2
    for known in GUARDED.values():
        options = {"max_sweeps": 5, "rtol": 0.0, "guard": "clearance"}
        result = smooth(both, known(**options))
        assert result.after.n_invalid == 0
        if not known().why_not(one.mesh):
            alone = smooth(one.mesh, known(**options))
            np.testing.assert_allclose(result.points[:n], alone.points, atol=1e-10)


@pytest.mark.nojit
def test_what_is_valid_by_a_hair_in_a_tilted_plane_is_valid_as_it_is_stored():
    # The centre of four squares goes to a hair's breadth from a diagonal. In the plane's own
    # coordinates that is valid; where rounding to points in space would spoil it, it goes back.
    kept, taken_back = 0, 0
    flat, cells = grid(2, 2)
    for seed in range(20):
        mesh = Mesh(tilt(flat, seed) + 1000.0, cells)
        a, b = mesh.xy[1], mesh.xy[3]
        xy = mesh.xy.copy()
        for hair in (1e-15, 1e-14, 1e-11):
            xy[4] = 0.3 * a + 0.7 * b + hair * (mesh.xy[8] - mesh.xy[0])
            if Quality(mesh.topology, xy).n_invalid:
                continue
            result = driver.stored(mesh, xy.copy())
            assert quality(result).n_invalid == 0
            moved = (result.points != mesh.points).any(axis=1)
            assert moved.tolist() in ([False] * 9, [v == 4 for v in range(9)])
            kept += moved.any()
            taken_back += not moved.any()
    assert kept
    assert taken_back


# ------------------------------------------------------------------------------- symmetries


def test_what_came_beyond_its_reach_in_a_tilted_plane_goes_back():
    flat = random_mesh("quads", 5, seed=2, amount=0.2).mesh
    mesh = Mesh(tilt(flat.points), flat.cells)
    inner = np.flatnonzero(~mesh.is_boundary)
    xy = mesh.xy.copy()
    xy[inner] += 0.02
    reach = np.full(mesh.n_vertices, np.inf)
    reach[inner[::2]] = 0.01
    freedom = dataclasses.replace(all_methods()["star"]().freedom(mesh), reach=reach)
    moved = (driver.stored(mesh, xy, freedom).points != mesh.points).any(axis=1)
    assert np.flatnonzero(moved).tolist() == inner[1::2].tolist()


@pytest.mark.nojit
@every_guarded
def test_the_whole_mesh_clockwise_is_the_same_mesh(known):
    made = random_mesh("mixed", 5, seed=4, amount=0.9)
    result = smooth(made.mesh, known(max_sweeps=3, rtol=0.0))
    turned = Mesh(made.points, [block[:, ::-1] for block in made.cells])
    other = smooth(turned, known(max_sweeps=3, rtol=0.0))
    np.testing.assert_allclose(other.points, result.points, atol=1e-12)
    assert other.before.n_invalid == 0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "L", "annulus"])
@pytest.mark.parametrize("method", ["optimize", "star", "quad", "smart-laplacian"])
def test_in_another_numbering_these_end_near_by(method, kind, seed):
    # Not a promise of all: angle is not stable on quads, aspect-ratio not in the worst angles.
    made = random_mesh(kind, 7, seed=seed, amount=0.8)
    points, cells, _ = renumber(made.points, made.cells, np.random.default_rng(seed))
    result = smooth(made.mesh, method, max_sweeps=60)
    other = smooth((points, cells), method, max_sweeps=60)
    assert other.after.mean["shape"] == pytest.approx(result.after.mean["shape"], abs=0.02)
    assert other.after.mean["max_angle"] == pytest.approx(result.after.mean["max_angle"], abs=5.0)
    for name in ("min_angle", "max_angle"):
        gained = abs(result.after.worst[name] - result.before.worst[name])
        slack = 6.0 + 0.35 * gained
        assert abs(other.after.worst[name] - result.after.worst[name]) <= slack


def test_plain_laplacian_does_not_depend_on_the_numbering():
    made = random_mesh("mixed", 7, seed=5, amount=0.8)
    points, cells, new_of = renumber(made.points, made.cells, np.random.default_rng(1))
    result = smooth(made.mesh, "laplacian", max_sweeps=20, rtol=0.0)
    other = smooth((points, cells), "laplacian", max_sweeps=20, rtol=0.0)
    np.testing.assert_allclose(other.points[new_of], result.points, atol=1e-12)
