"""The optimiser: what it reaches, its options, when it stops, and what it trades."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import promises
from meshes import KINDS, grid, place, random_mesh, tangle
from qsmooth import Optimize, Stop, limits, quality, read_mesh, smooth
from qsmooth.examples import bump, jittered, random_triangles, structured, tangled
from qsmooth.optimizer.progress import ROUND
from qsmooth.outcome import Aim

# ------------------------------------------------------------------------------- what it reaches


def test_jittered_squares_become_squares():
    result = smooth(jittered(20, 20, seed=1), "optimize")
    assert result.after.worst["min_angle"] > 89.0
    assert result.after.mean["shape"] > 0.999
    assert result.converged


@pytest.mark.nojit
def test_a_grid_of_squares_comes_back_no_worse():
    mesh = structured(3, 3)
    result = promises.check(mesh, Optimize(max_sweeps=30)).result
    assert np.array_equal(result.points, mesh.points)


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
def test_a_mesh_that_is_good_comes_back_no_worse_and_twice_changes_nothing(shared_meshes):
    for mesh in (read_mesh(shared_meshes / "dealii_hole8170.msh"), structured(40, 40)):
        once = promises.check(mesh, Optimize()).result
        assert once.outcome.trades == ()
        twice = promises.check(once.mesh, Optimize()).result
        for name in ("min_angle", "max_angle"):
            apart = once.after.worst[name] - twice.after.worst[name]
            assert abs(np.radians(apart)) < 1e-3
        assert twice.after.worst["scaled_jacobian"] - once.after.worst["scaled_jacobian"] < 1e-3
        assert abs(twice.after.mean["shape"] - once.after.mean["shape"]) < 1e-3


# Meshes whose smallest angle is limited at a vertex that the optimiser exhausts.
EXHAUSTED = [
    "superior_sibl_30k.off",
    "superior_hohq_1505.obj",
    "hughes_qt_cpe4.inp",
    "spiral_2k.off",
    "malpasset_2392.obj",
    "dealii_two_holes.msh",
    "dealii_step49.msh",
    "mesquite_tri48_circle.vtk",
    "sfepy_apartment_tri.vtk",
]


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", EXHAUSTED)
def test_the_smallest_angle_comes_near_what_the_connectivity_allows(shared_meshes, file):
    mesh = read_mesh(shared_meshes / file)
    result = promises.check(mesh, Optimize()).result
    found = limits(result.mesh)
    assert result.outcome.limits == found
    assert found.min_angle_vertex >= 0
    assert 0.995 * found.min_angle <= found.reached_min_angle <= found.min_angle + 1e-9
    assert result.after.n_invalid == 0
    assert f"{found.min_angle:.2f}°; set at vertex {found.min_angle_vertex}" in result.reason


@pytest.mark.parametrize(("n", "height", "width"), [(40, 0.5, 0.15), (100, 0.5, 0.15)])
def test_a_bump_is_mended(n, height, width):
    result = promises.check(bump(n, height=height, width=width), Optimize()).result
    assert result.before.worst["scaled_jacobian"] < 0.35
    assert result.after.worst["scaled_jacobian"] > 0.6


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "L"])
def test_turned_scaled_shifted_and_mirrored_it_ends_as_good(kind, seed):
    made = random_mesh(kind, 6, seed=seed, amount=0.9)
    result = smooth(made.mesh, "optimize")
    for motion in (
        {"turn": 1.1},
        {"mirror": True},
        {"scale": 1e-9, "turn": 0.4},
        {"scale": 1e9, "mirror": True},
        {"scale": 3.0, "shift": (6e6, -6e6)},
    ):
        other = smooth((place(made.points, **motion), made.cells), "optimize")
        assert other.after.n_invalid == 0
        worst, others = result.after.worst, other.after.worst
        # When to go on to the next wall, and which round was best, hangs on a rounding.
        assert others["min_angle"] == pytest.approx(worst["min_angle"], abs=0.5)
        assert others["max_angle"] == pytest.approx(worst["max_angle"], abs=1.0)
        assert others["scaled_jacobian"] == pytest.approx(worst["scaled_jacobian"], abs=0.01)
        assert other.after.mean["shape"] == pytest.approx(result.after.mean["shape"], abs=0.01)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e3, 1e9])
@pytest.mark.parametrize("shift", [0.0, 6e6])
def test_any_scale_anywhere_is_untangled_and_improved(scale, shift):
    mesh = tangled(15, 15, seed=3, kind="mixed")
    # Shifts are in the mesh's own unit, so that its coordinates can be told apart.
    points = (mesh.points * 1e3 + shift) * scale
    result = smooth(mesh.with_points(points), "optimize")
    assert result.before.n_invalid > 50
    assert result.after.n_invalid == 0
    assert result.after.worst["min_angle"] > 35.0


@pytest.mark.nojit
def test_extreme_angles_are_those_of_all_cells():
    for kind in KINDS:
        for seed in range(3):
            own = quality(random_mesh(kind, 4, seed=seed, amount=1.0).mesh)
            assert own.extreme_angles == (own.min_angle.min(), own.max_angle.max())


@given(st.sampled_from(sorted(KINDS)), st.integers(0, 2**32 - 1), st.floats(0.0, 2.0))
def test_extreme_angles_of_tangled_meshes(kind, seed, amount):
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](4, rng)
    own = quality((tangle(points, cells, rng, amount), cells))
    expected = own.min_angle.min(), own.max_angle.max()
    assert own.extreme_angles == pytest.approx(expected, abs=1e-9)


# ------------------------------------------------------------------------------- options


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"objective": "size"}, "objective must be 'shape', got 'size'"),
        ({"stop_quality": 0.0}, "stop_quality must be in (0, 1], got 0.0"),
        ({"stop_quality": 1.1}, "stop_quality must be in (0, 1], got 1.1"),
        ({"stop_quality": math.nan}, "stop_quality must be in (0, 1], got nan"),
        ({"mean_loss": -0.1}, "mean_loss must be in [0, 1), got -0.1"),
        ({"mean_loss": 1.0}, "mean_loss must be in [0, 1), got 1.0"),
        ({"mean_loss": math.nan}, "mean_loss must be in [0, 1), got nan"),
    ],
)
def test_an_option_out_of_range_is_named(options, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        Optimize(**options)
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        smooth(grid(2, 2), **options)


@pytest.mark.nojit
@pytest.mark.parametrize("max_sweeps", [0, 1, 7, 10, 23])
def test_it_sweeps_no_more_than_it_is_told(max_sweeps):
    mesh = random_mesh("mixed", 3, seed=2, amount=0.9).mesh
    seen = promises.check(mesh, Optimize(max_sweeps=max_sweeps))
    result = seen.result
    assert result.sweeps == max_sweeps
    assert result.outcome.stop is Stop.MAX_SWEEPS
    assert len(seen.records) >= math.ceil(max_sweeps / ROUND)
    assert (result.after.mean["shape"] > result.before.mean["shape"]) == (max_sweeps > 0)


def test_a_time_limit_stops_with_the_best_so_far():
    mesh = jittered(60, 60, seed=2)
    short = smooth(mesh, "optimize", time_limit=1e-6)
    assert short.outcome.stop is Stop.TIME_LIMIT
    assert "the time limit of 1e-06 s was reached" in short.reason
    smooth(mesh, "optimize")  # compiled
    limited = promises.check(mesh, Optimize(time_limit=0.02)).result
    assert limited.seconds < 2.0


def test_a_target_stops_early():
    mesh = jittered(30, 30, amount=0.45, seed=2)
    whole, early = smooth(mesh, "optimize"), smooth(mesh, "optimize", stop_quality=0.6)
    assert early.after.worst["scaled_jacobian"] >= 0.6
    assert early.sweeps < whole.sweeps
    assert early.outcome.stop is Stop.STOP_QUALITY
    assert early.outcome.stop_at == 0.6
    assert "the worst cell reached stop_quality=0.6" in early.reason
    beyond = smooth(mesh, "optimize", stop_quality=1.0)
    assert beyond.after.worst["scaled_jacobian"] == pytest.approx(
        whole.after.worst["scaled_jacobian"], abs=1e-2
    )


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
def test_the_worst_cells_cost_the_mean_what_they_may(shared_meshes):
    mesh = read_mesh(shared_meshes / "spiral_2k.off")
    mean_only = smooth(mesh, "optimize", worst=False)
    both = smooth(mesh, "optimize")
    assert [stage.aim for stage in mean_only.outcome.stages] == [Aim.MEAN_SHAPE]
    assert [stage.aim for stage in both.outcome.stages] == [Aim.MEAN_SHAPE, Aim.WORST_CELLS]
    assert both.after.worst["scaled_jacobian"] > mean_only.after.worst["scaled_jacobian"] + 0.05
    assert mean_only.after.mean["shape"] > both.after.mean["shape"]
    for loss in (0.0, 0.01, 0.05):
        result = promises.check(mesh, Optimize(mean_loss=loss)).result
        # The mean's own optimum is not told: the stage before the worst cells stops near it.
        least = (1.0 - loss) * mean_only.after.mean["shape"] - 2e-3
        assert result.after.mean["shape"] >= least


@pytest.mark.parametrize("loss", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_where_the_mean_is_at_its_best_worst_cells_cost_some_of_it(seed, loss):
    best = smooth(random_triangles(200, seed=seed), "optimize", worst=False).mesh
    # The check computes that the trade was one: what it cost, and what it gained.
    result = promises.check(best, Optimize(mean_loss=loss)).result
    assert result.after.mean["shape"] < result.before.mean["shape"]
    assert len(result.outcome.trades) == 1
    assert "the worst cells went first, as not all figures could be had" in result.reason
    kept = promises.check(best, Optimize(mean_loss=0.0)).result
    assert kept.outcome.trades == ()
    assert kept.after.mean["shape"] >= kept.before.mean["shape"]
    # What was not taken is told: it was better than what there is.
    assert (kept.outcome.forbidden is not None) == kept.outcome.unchanged
    if kept.outcome.forbidden is not None:
        assert kept.outcome.forbidden.scaled_jacobian > kept.before.worst["scaled_jacobian"]
        assert "that mean_loss=0 forbids" in kept.reason


@pytest.mark.nojit
def test_only_the_selected_move():
    mesh = random_mesh("quads", 6, seed=4, amount=0.9).mesh
    cells = [0, 1, 6, 7]
    result = promises.check(mesh, Optimize(selection=cells, max_sweeps=30)).result
    moved = (result.points != mesh.points).any(axis=1)
    assert moved.any()
    of_cells = np.zeros(mesh.n_vertices, np.bool_)
    of_cells[mesh.cell_vertices.reshape(-1, 4)[cells].ravel()] = True
    assert not moved[~of_cells].any()
    more = smooth(mesh, "optimize", selection=cells, selection_rings=1, max_sweeps=30, threads=1)
    assert (more.points != mesh.points).any(axis=1).sum() > moved.sum()


@pytest.mark.nojit
def test_a_mesh_in_space_stays_in_its_plane():
    made = random_mesh("quads", 4, seed=4, amount=0.9)
    lift = np.column_stack([0.8 * made.points[:, 0], made.points[:, 1], 0.6 * made.points[:, 0]])
    result = smooth((lift, made.cells), "optimize", max_sweeps=40, threads=1)
    flat = smooth(made.mesh, "optimize", max_sweeps=40, threads=1)
    assert result.after.n_invalid == 0
    assert result.points[:, 2] == pytest.approx(0.75 * result.points[:, 0], abs=1e-12)
    assert result.after.mean["shape"] == pytest.approx(flat.after.mean["shape"], abs=1e-3)
