"""The optimiser: what it reaches, its options, when it stops, and what it trades."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import promises
from meshes import KINDS, grid, place, random_mesh, tangle
from qsmooth import Mesh, Optimize, Stop, limits, quality, read_mesh, smooth
from qsmooth.examples import (
    boundary_layer,
    bump,
    jittered,
    notch,
    random_triangles,
    structured,
    tangled,
)
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


@pytest.mark.nojit
def test_what_nothing_could_better_is_known_at_one_look():
    grid = structured(4, 4)
    for off, sweeps in ((1e-6, False), (0.03, True)):
        points = grid.points.copy()
        points[6] += off
        result = smooth(Mesh(points, grid.cells), "optimize", max_sweeps=20)
        assert (result.sweeps > 0) is sweeps
        assert result.outcome.unchanged is not sweeps
        assert result.outcome.target is not None
        if not sweeps:
            assert result.outcome.stop is Stop.SETTLED
            assert [stage.aim for stage in result.outcome.stages] == [Aim.MEAN_SHAPE]


def test_one_bad_corner_among_many_good_cells_is_mended():
    # The mean has less to gain than is worth moving a vertex for.
    mesh = structured(40, 40)
    points = mesh.points.copy()
    points[20 * 41 + 20] += 0.3 / 40
    result = smooth(mesh.with_points(points), "optimize")
    assert 1.0 - result.before.mean["shape"] < 1e-3
    assert result.before.worst["min_angle"] < 80.0
    assert result.after.worst["min_angle"] > 89.0


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
def test_a_mesh_that_is_good_comes_back_no_worse_and_twice_changes_nothing(shared_meshes):
    for mesh in (read_mesh(shared_meshes / "dealii_hole8170.msh"), structured(40, 40)):
        once = promises.check(mesh, Optimize()).result
        twice = promises.check(once.mesh, Optimize()).result
        for name in ("min_angle", "max_angle"):
            apart = once.after.worst[name] - twice.after.worst[name]
            assert abs(np.radians(apart)) < 1e-3
        assert twice.after.worst["scaled_jacobian"] - once.after.worst["scaled_jacobian"] < 1e-3
        assert abs(twice.after.mean["shape"] - once.after.mean["shape"]) < 1e-3


# Meshes whose smallest angle is limited at a vertex that the optimiser exhausts.
NO_TARGET = (
    "target must be 'auto', 'ideal' or 'initial'; or real numbers: ratios of sides, (n_cells,), or "
    "metric tensors, (n_vertices, 2, 2); or a function of places that gives such tensors; got "
)
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
        ({"objective": "size"}, "objective must be 'shape' or 'shape-size', got 'size'"),
        ({"size_weight": -1.0}, "size_weight must be 0 or more, got -1.0"),
        ({"hold": "aspect"}, "hold takes 'aspect_ratio', 'shape' or 'min_edge', got 'aspect'; "
         "did you mean 'aspect_ratio'?"),
        ({"hold": ["shape", "min_angle"]}, "hold takes 'aspect_ratio', 'shape' or 'min_edge', got "
         "'min_angle', which is held anyway, but where a metric is the target"),
        ({"hold": 3}, "hold takes 'aspect_ratio', 'shape' or 'min_edge', got 3"),
        ({"hold": [None]}, "hold takes 'aspect_ratio', 'shape' or 'min_edge', got None"),
        ({"target": "idle"}, "target must be 'auto', 'ideal' or 'initial', got 'idle'; did you "
         "mean 'ideal'?"),
        ({"target": 2.0}, NO_TARGET + "2.0"),
        ({"target": None}, NO_TARGET + "None"),
        ({"target": [[1.0]]}, NO_TARGET + "[[1.0]]"),
        ({"target": {"a"}}, NO_TARGET + "{'a'}"),
        ({"target": ["a"] * 160}, NO_TARGET + "['a', 'a', 'a', 'a', 'a', 'a', ...]"),
        ({"target": np.ones((4, 2))}, NO_TARGET + "an array of float64 of the shape (4, 2)"),
        ({"target": 1j * np.ones(4)}, NO_TARGET + "an array of complex128 of the shape (4,)"),
        ({"stop_quality": 0.0}, "stop_quality must be in (0, 1], got 0.0"),
        ({"stop_quality": 1.1}, "stop_quality must be in (0, 1], got 1.1"),
        ({"stop_quality": math.nan}, "stop_quality must be in (0, 1], got nan"),
        ({"mean_loss": -0.1}, "mean_loss must be in [0, 1), got -0.1"),
        ({"mean_loss": 1.0}, "mean_loss must be in [0, 1), got 1.0"),
        ({"mean_loss": math.nan}, "mean_loss must be in [0, 1), got nan"),
    ],
)  # fmt: skip
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
def test_where_the_mean_is_at_its_best_worst_cells_may_cost_so_much_of_it(seed, loss):
    best = smooth(random_triangles(200, seed=seed), "optimize", worst=False).mesh
    result = promises.check(best, Optimize(mean_loss=loss)).result
    assert result.after.mean["shape"] >= (1.0 - loss) * result.before.mean["shape"] - 2e-3
    gain = result.after.worst["scaled_jacobian"] - result.before.worst["scaled_jacobian"]
    assert gain > 0.01
    kept = promises.check(best, Optimize(mean_loss=0.0)).result
    assert kept.after.mean["shape"] >= kept.before.mean["shape"] - 1e-3
    # What was not taken is told: it was better than what there is.
    if kept.outcome.forbidden is not None:
        assert kept.outcome.forbidden.scaled_jacobian > kept.before.worst["scaled_jacobian"]
        assert "that mean_loss=0 forbids" in kept.reason


@pytest.mark.parametrize("seed", range(3))
def test_where_cells_are_to_be_ideal_the_mean_is_no_worse_than_it_was(seed):
    mesh = smooth(random_triangles(200, seed=seed), "optimize", worst=False).mesh
    result = promises.check(mesh, Optimize()).result
    if result.outcome.target.kind == "ideal":
        assert result.after.mean["shape"] >= result.before.mean["shape"]
    loose = promises.check(mesh, Optimize(mean_loss=0.3)).result
    assert loose.after.worst["scaled_jacobian"] >= result.after.worst["scaled_jacobian"] - 1e-3


# ------------------------------------------------------------------------------- what is held


@pytest.mark.nojit
@pytest.mark.parametrize(
    "given",
    ["shape,aspect_ratio", ["aspect_ratio", "shape"], {"shape", "aspect_ratio"},
     " aspect-ratio , shape,", iter(["shape", "aspect_ratio", "shape"])],
)  # fmt: skip
def test_what_to_hold_may_be_given_in_many_ways(given):
    assert Optimize(hold=given).hold == ("aspect_ratio", "shape")
    assert Optimize(hold="min_edge").hold == ("min_edge",)
    assert Optimize(hold="").hold == Optimize(hold=[]).hold == Optimize().hold == ()
    assert Optimize(hold="shape") == Optimize(hold=["shape"]) != Optimize()


def steep_bump():
    return bump(60, height=0.8, width=0.1)


def test_a_bump_is_mended_and_what_is_held_is_kept():
    free = promises.check(steep_bump(), Optimize()).result
    before, after = free.before.worst, free.after.worst
    assert after["min_angle"] > 30.0
    assert after["min_angle"] > before["min_angle"] + 15.0
    held = promises.check(steep_bump(), Optimize(hold=("aspect_ratio", "shape"))).result
    assert held.after.worst["aspect_ratio"] <= before["aspect_ratio"] * (1.0 + 1e-9)
    assert held.after.worst["min_angle"] > before["min_angle"] + 2.0
    assert not {"aspect_ratio", "shape"} & {trade.figure for trade in held.outcome.trades}


@pytest.mark.parametrize("name", ["aspect_ratio", "shape", "min_edge"])
def test_each_figure_gets_no_worse_where_it_is_held_and_would_else(name):
    better = promises.HOLDABLE[name]
    fell = 0
    for mesh in (steep_bump(), notch(20)):
        ends = []
        for hold in ((), (name,)):
            result = promises.check(mesh, Optimize(hold=hold)).result
            old, new = (quality(m)[name] for m in (mesh, result.mesh))
            ends.append(old.min() - new.min() if better else new.max() - old.max())
        assert ends[1] <= 1e-9 * abs(old.min() if better else old.max())
        fell += ends[0] > 1e-3 * abs(old.min() if better else old.max())
    assert fell


def two_regions():
    """Squares that are jittered, and a bad corner that can't get better as it is fixed."""
    mesh = jittered(24, 24, amount=0.4, seed=1)
    points = mesh.points.copy()
    points[0] = 0.4 * points[26]  # the corner of the square, towards the next vertex inside
    return mesh.with_points(points)


def test_a_cell_that_cannot_get_better_vetoes_nothing():
    mesh = two_regions()
    result = promises.check(mesh, Optimize()).result
    assert result.after.mean["shape"] > 0.98
    assert result.after.mean["shape"] > result.before.mean["shape"] + 0.02


# ------------------------------------------------------------------------------- targets


@pytest.mark.parametrize("target", ["auto", "ideal", "initial"])
def test_targets_by_name(target):
    mesh = jittered(16, 16, seed=3)
    result = promises.check(mesh, Optimize(target=target)).result
    told = result.outcome.target
    assert told.kind == ("initial" if target == "initial" else "ideal")
    assert told.after > told.before
    assert ("mean quality towards" in result.reason) == (told.kind != "ideal")


def test_rectangles_of_given_ratios_are_made():
    # Squares pressed to a half: the target says that they were to be.
    mesh = jittered(12, 12, seed=3)
    mesh = mesh.with_points(mesh.points * (1.0, 0.5))
    ratios = np.full(mesh.n_cells, 2.0)
    result = promises.check(mesh, Optimize(target=ratios)).result
    assert result.outcome.target.kind == "ratios"
    assert result.outcome.target.after > 0.999
    assert result.after.worst["min_angle"] > 89.0
    with pytest.raises(ValueError, match=r"ratios must have the shape \(144,\), got \(3,\)"):
        smooth(mesh, target=[1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="for meshes of quads only"):
        smooth(random_triangles(50), target=[1.0])


def test_sizes_follow_where_they_count():
    # Columns that are wider to the right: with sizes they stay so.
    mesh = jittered(24, 8, amount=0.2, seed=1)
    points = mesh.points.copy()
    points[:, 0] = points[:, 0] ** 1.5
    mesh = mesh.with_points(points)
    by_shape = smooth(mesh, target="ideal", objective="shape").outcome.sizes
    by_size = smooth(mesh, target="ideal", objective="shape-size", size_weight=10.0).outcome.sizes
    assert by_shape.area_high > 1.5 * by_size.area_high
    none = smooth(mesh, target="ideal", objective="shape-size", size_weight=0.0)
    assert np.array_equal(none.points, smooth(mesh, target="ideal").points)


def test_layers_are_kept_and_told_of():
    result = promises.check(boundary_layer(), Optimize()).result
    sizes = result.outcome.sizes
    assert sizes.layers > 0.2
    assert 0.9 < sizes.area_low <= sizes.area_high < 1.1
    if not result.outcome.unchanged:
        assert "cells are layers and were kept" in (result.reason)


# ------------------------------------------------------------------------------- what is told


def test_what_got_worse_is_told_with_what_it_was_given_for():
    mesh = bump(30, height=0.8, width=0.1)
    result = promises.check(mesh, Optimize(target="ideal")).result
    assert result.outcome.trades
    text = result.reason
    names = {"aspect_ratio": "largest aspect ratio", "min_edge": "shortest edge",
             "shape": "smallest shape", "mean_shape": "mean shape"}  # fmt: skip
    for trade in result.outcome.trades:
        assert f"{names[trade.figure]} {trade.before:.3g} -> {trade.after:.3g}" in text or (
            trade.figure == "mean_shape"
        )
        assert trade.gained
    held = [t.figure for t in result.outcome.trades if t.figure != "mean_shape"]
    assert f"with hold='{','.join(held)}'" in text
    kept = promises.check(mesh, Optimize(target="ideal", hold=held)).result
    assert not set(held) & {trade.figure for trade in kept.outcome.trades}


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
