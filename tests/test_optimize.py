"""The optimiser: what its result promises, untangling, options, and steps on the whole mesh."""

import importlib.util
import math
import re
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
from meshes import KINDS, grid, place, random_mesh, random_meshes, tangle
from qsmooth import (
    Mesh,
    limits,
    newton,
    quality,
    read_mesh,
    smooth,
    smooth_optimize,
    smooth_star,
    untangle,
)
from qsmooth.examples import bump, jittered, random_interior, structured, tangled
from qsmooth.kernels._jit import use_threads
from qsmooth.optimization import ROUND

WENT_FIRST = "worst cells went first"


def figures(summary):
    """The four that a result must not lower; larger is better in all."""
    return np.array(
        [
            summary.worst["min_angle"],
            -summary.worst["max_angle"],
            summary.worst["scaled_jacobian"],
            summary.mean["shape"],
        ]
    )


def check_no_worse(result):
    """All four figures are no worse, or the worst cells' three where the reason says so."""
    before, after = figures(result.before), figures(result.after)
    count = 3 if WENT_FIRST in result.reason else 4
    assert (after[:count] >= before[:count]).all(), (before, after, result.reason)


def is_valid(mesh):
    """In exact arithmetic, and not by the package."""
    points = reference.as_complex(mesh.xy)
    return not any(reference.validity(points, cell) for cell in reference.as_lists(mesh))


# ------------------------------------------------------------------------------- promises

OPTIONS = st.fixed_dictionaries(
    {},
    optional={
        "worst": st.booleans(),
        "target_quality": st.sampled_from([0.3, 0.9]),
        "max_sweeps": st.sampled_from([1, 7, 45, 300]),
        "mean_loss": st.sampled_from([0.0, 0.02, 0.5]),
    },
)


@given(random_meshes(), OPTIONS)
@settings(max_examples=150)
def test_valid_stays_valid_and_no_figure_gets_worse(made, options):
    mesh = made.mesh
    result = smooth_optimize(mesh, threads=1, **options)
    assert all(record.n_invalid == 0 for record in result.history)
    assert is_valid(result.mesh)
    check_no_worse(result)
    rests = mesh.is_fixed
    assert result.points[rests].tobytes() == mesh.points[rests].tobytes()
    assert result.sweeps <= options.get("max_sweeps", 5000)


# A second thread that waits for a core makes many short sweeps slow: few of them, and few examples.
@given(random_meshes(), OPTIONS)
@settings(max_examples=15)
def test_two_threads_give_the_bits_of_one(made, options):
    options = {**options, "max_sweeps": min(options.get("max_sweeps", 35), 35)}
    one = smooth_optimize(made.mesh, threads=1, **options)
    two = smooth_optimize(made.mesh, threads=2, **options)
    assert one.points.tobytes() == two.points.tobytes()
    assert (one.history, one.reason) == (two.history, two.reason)


@given(st.sampled_from(sorted(KINDS)), st.integers(0, 2**32 - 1), st.integers(2, 6))
@settings(max_examples=60)
def test_a_tangled_mesh_never_gets_more_invalid_cells(kind, seed, size):
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](size, rng)
    mesh = Mesh(tangle(points, cells, rng, 1.5), cells)
    for run in (untangle, smooth_optimize):
        one = run(mesh, threads=1, max_sweeps=600)
        assert one.after.n_invalid <= one.before.n_invalid
        assert is_valid(one.mesh) == (one.after.n_invalid == 0)
        assert one.points[mesh.is_fixed].tobytes() == mesh.points[mesh.is_fixed].tobytes()
    if one.before.n_invalid == 0:
        check_no_worse(one)


@pytest.mark.parametrize("seed", range(4))
def test_two_threads_untangle_to_the_bits_of_one(seed):
    mesh = tangled(20, 20, amount=2.0, seed=seed, kind="mixed")
    one, two = (untangle(mesh, threads=threads, max_sweeps=12) for threads in (1, 2))
    assert one.before.n_invalid > one.after.n_invalid
    assert one.points.tobytes() == two.points.tobytes()


@given(random_meshes(), st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_fixed_vertices_interfaces_orphans_and_z_stay(made, seed):
    rng = np.random.default_rng(seed)
    orphan = made.points[:1] * 1.5
    points = np.concatenate([made.points, orphan])
    n_cells = sum(map(len, made.cells))
    mesh = Mesh(
        np.column_stack([points, rng.normal(size=len(points))]),
        made.cells,
        fixed=rng.random(len(points)) < 0.2,
        regions=rng.integers(2, size=n_cells),
        surface="flat",
    )
    result = smooth_optimize(mesh, max_sweeps=60, threads=1)
    rests = mesh.is_fixed | mesh.is_interface
    rests[-1] = True
    assert result.points[rests].tobytes() == mesh.points[rests].tobytes()
    assert result.points[:, 2].tobytes() == mesh.points[:, 2].tobytes()
    freed = smooth_optimize(mesh, max_sweeps=60, keep_interfaces=False, threads=1)
    rests = mesh.is_fixed
    assert freed.points[rests].tobytes() == mesh.points[rests].tobytes()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "L"])
def test_turned_scaled_shifted_and_mirrored_it_ends_as_good(kind, seed):
    made = random_mesh(kind, 6, seed=seed, amount=0.9)
    result = smooth_optimize(made.mesh)
    for motion in (
        {"turn": 1.1},
        {"mirror": True},
        {"scale": 1e-9, "turn": 0.4},
        {"scale": 1e9, "mirror": True},
        {"scale": 3.0, "shift": (6e6, -6e6)},
    ):
        other = smooth_optimize((place(made.points, **motion), made.cells))
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
    result = smooth_optimize(mesh.with_points(points))
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


# ------------------------------------------------------------------------------- what it reaches


def test_jittered_squares_become_squares():
    result = smooth_optimize(jittered(20, 20, seed=1))
    assert result.after.worst["min_angle"] > 89.0
    assert result.after.mean["shape"] > 0.999
    assert result.converged


@pytest.mark.nojit
def test_a_grid_of_squares_comes_back_no_worse():
    mesh = structured(3, 3)
    result = smooth_optimize(mesh, threads=1, max_sweeps=30)
    check_no_worse(result)
    assert np.array_equal(result.points, mesh.points)


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
def test_a_mesh_that_is_good_comes_back_no_worse_and_twice_changes_nothing(shared_meshes):
    for mesh in (read_mesh(shared_meshes / "dealii_hole8170.msh"), structured(40, 40)):
        once = smooth_optimize(mesh)
        assert WENT_FIRST not in once.reason
        check_no_worse(once)
        twice = smooth_optimize(once.mesh)
        check_no_worse(twice)
        change = np.abs(figures(twice.after) - figures(once.after))
        change[:2] = np.radians(change[:2])
        assert (change < 1e-3).all()


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
    result = smooth_optimize(mesh)
    found = limits(result.mesh)
    assert found.min_angle_vertex >= 0
    assert 0.995 * found.min_angle <= found.reached_min_angle <= found.min_angle + 1e-9
    assert result.after.n_invalid == 0
    check_no_worse(result)
    assert f"{found.min_angle:.2f}°; set at vertex {found.min_angle_vertex}" in result.reason


# ------------------------------------------------------------------------------- untangling


@pytest.mark.nojit
def test_a_vertex_outside_its_star_comes_back():
    points, cells = grid(2, 2)
    points[4] = 2.7, 0.1
    result = untangle((points, cells), threads=1)
    assert (result.before.n_invalid, result.after.n_invalid) == (2, 0)
    assert result.converged
    assert "untangled 2 cells" in result.reason
    assert result.method == "untangle"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_random_interiors_and_tangled_squares_become_valid(kind, seed):
    for mesh in (
        random_interior(40, 40, seed=seed, kind=kind),
        tangled(30, 30, amount=1.5, seed=seed, kind=kind),
    ):
        result = untangle(mesh)
        assert result.before.n_invalid > 0.3 * mesh.n_cells
        assert result.after.n_invalid == 0
        assert result.converged
        assert is_valid(result.mesh)


@pytest.fixture(scope="session")
def hard_cases(shared):
    """The makers of the hard cases, which need numpy and scipy."""
    folder = shared / "peers"
    if not (folder / "meshes.py").is_file():
        pytest.skip("the hard cases are not here")
    own = sys.modules.pop("meshes", None)
    sys.path.insert(0, str(folder))
    try:
        spec = importlib.util.spec_from_file_location("hard_cases", folder / "meshes.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(folder))
        if own is not None:
            sys.modules["meshes"] = own
    return module


@pytest.mark.parametrize("case", ["tangled-2k", "tangledx-2k", "notcht-2k", "fold-2k"])
def test_the_hard_cases_become_valid(hard_cases, case):
    points, cells = hard_cases.make(case)
    result = untangle((points, cells))
    assert result.before.n_invalid > 0
    assert result.after.n_invalid == 0
    better = smooth_optimize((points, cells))
    assert better.after.n_invalid == 0
    assert better.after.worst["scaled_jacobian"] > result.after.worst["scaled_jacobian"]


TANGLED_FILES = [
    "mesquite_tangled_quad.vtk",
    "mesquite_hole_tanglap.vtk",
    "mesquite_inverted_hole.vtk",
    "mesquite_shest_grid32.vtk",
    "mesquite_tri58_tangled.vtk",
]


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", TANGLED_FILES)
def test_tangled_files_become_valid(shared_meshes, file):
    mesh = read_mesh(shared_meshes / file)
    for run in (untangle, smooth_optimize):
        result = run(mesh)
        assert result.before.n_invalid > 0
        assert result.after.n_invalid == 0
        assert is_valid(result.mesh)
        rests = mesh.is_fixed
        assert result.points[rests].tobytes() == mesh.points[rests].tobytes()


def says_stays(reason, count, given, first):
    words = rf"\b{count} of {given} invalid cells? stays? invalid, the first is cell {first}\b"
    return re.search(words, reason) is not None


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("run", [untangle, smooth_optimize])
def test_a_collapsed_cell_of_fixed_vertices_is_named(shared_meshes, run):
    mesh = read_mesh(shared_meshes / "hughes_6k.obj")
    result = run(mesh)
    assert result.after.n_invalid == 1
    assert says_stays(result.reason, 1, 1, 4902)
    assert "for 1 of them nothing can help" in result.reason
    if run is untangle:
        assert not result.converged
        assert np.array_equal(result.points, mesh.points)


@pytest.mark.nojit
@pytest.mark.parametrize("run", [untangle, smooth_optimize])
def test_an_inverted_quad_of_fixed_vertices_is_proven_hopeless(run):
    # A grid whose boundary folds a cell at the lower left over: 0 lies within cell (1, 1).
    points, cells = grid(3, 3)
    points[0] = 0.9, 0.9
    fixed = np.zeros(16, np.bool_)
    fixed[5] = True
    mesh = Mesh(points, cells, fixed=fixed)
    before = quality(mesh)
    result = run(mesh, threads=1, max_sweeps=50)
    assert before.n_invalid == 1
    assert result.after.n_invalid == 1
    assert says_stays(result.reason, 1, 1, 0)
    assert "for 1 of them nothing can help" in result.reason
    assert "the first is cell 0)" in result.reason


@pytest.mark.nojit
def test_a_reflex_corner_within_one_cell_is_proven_hopeless_and_the_rest_is_untangled():
    # The domain's corner at 0 goes in so far that its only cell has over 180 degrees there.
    points, cells = grid(3, 3)
    points[0] = 0.6, 0.6
    points[10] = 0.2, 2.8
    mesh = Mesh(points, cells)
    assert quality(mesh).n_invalid > 1
    result = untangle(mesh, threads=1, max_sweeps=600)
    assert result.after.n_invalid == 1
    assert not result.converged
    assert says_stays(result.reason, 1, result.before.n_invalid, 0)
    assert "for 1 of them nothing can help" in result.reason
    assert "no way was found" not in result.reason


@pytest.mark.nojit
def test_what_is_not_proven_is_not_called_so():
    # One free vertex and no place for it: each of its cells asks for a side of the square.
    points = [(0.0, 0.0), (1.0, 0.0), (0.45, 0.5), (1.0, 1.0), (0.0, 1.0), (0.55, 0.5), (0.5, 0.5)]
    mesh = Mesh(points, [(6, 0, 1), (6, 1, 2), (6, 2, 3), (6, 3, 4), (6, 4, 5), (6, 5, 0)])
    result = untangle(mesh, threads=1, max_sweeps=30)
    assert result.after.n_invalid <= result.before.n_invalid
    if result.after.n_invalid:
        assert "no way was found, which does not prove that there is none" in result.reason
        assert "nothing can help" not in result.reason


@pytest.mark.nojit
def test_untangling_a_valid_mesh_changes_nothing():
    mesh = random_mesh("mixed", 4, seed=1, amount=0.9).mesh
    result = untangle(mesh, threads=1)
    assert result.points.tobytes() == mesh.points.tobytes()
    assert (result.sweeps, result.converged, result.history) == (0, True, ())
    assert "there was nothing to untangle" in result.reason


@pytest.mark.nojit
def test_untangling_stops_where_it_is_told_and_never_with_more_invalid_cells():
    mesh = random_interior(6, 6, seed=1)
    none = untangle(mesh, max_sweeps=0, threads=1)
    assert np.array_equal(none.points, mesh.points)
    assert not none.converged
    one = untangle(mesh, max_sweeps=1, threads=1)
    assert one.sweeps <= 1
    assert one.after.n_invalid <= one.before.n_invalid
    short = untangle(mesh, time_limit=1e-9, threads=1)
    assert not short.converged
    assert "time limit" in short.reason
    for options, message in [
        ({"max_sweeps": -1}, "max_sweeps must be an integer of 0 or more, got -1"),
        ({"time_limit": 0.0}, "time_limit must be over 0 seconds, got 0.0"),
        ({"threads": 0}, "threads must be an integer of 1 or more, got 0"),
    ]:
        with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
            untangle(mesh, **options)


# ------------------------------------------------------------------------------- options


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"objective": "size"}, "objective must be 'shape', got 'size'"),
        ({"target_quality": 0.0}, "target_quality must be in (0, 1], got 0.0"),
        ({"target_quality": 1.1}, "target_quality must be in (0, 1], got 1.1"),
        ({"target_quality": math.nan}, "target_quality must be in (0, 1], got nan"),
        ({"time_limit": 0.0}, "time_limit must be over 0 seconds, got 0.0"),
        ({"time_limit": -1.0}, "time_limit must be over 0 seconds, got -1.0"),
        ({"time_limit": math.nan}, "time_limit must be over 0 seconds, got nan"),
        ({"mean_loss": -0.1}, "mean_loss must be in [0, 1), got -0.1"),
        ({"mean_loss": 1.0}, "mean_loss must be in [0, 1), got 1.0"),
        ({"mean_loss": math.nan}, "mean_loss must be in [0, 1), got nan"),
        ({"max_sweeps": -1}, "max_sweeps must be an integer of 0 or more, got -1"),
        ({"max_sweeps": 1.5}, "max_sweeps must be an integer of 0 or more, got 1.5"),
        ({"threads": 0}, "threads must be an integer of 1 or more, got 0"),
        ({"selection_rings": -1}, "selection_rings must be an integer of 0 or more, got -1"),
    ],
)
def test_an_option_out_of_range_is_named(options, message):
    for run in (smooth_optimize, smooth):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
            run(grid(2, 2), **options)


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("method", "option"),
    [
        *[("optimize", o) for o in ({"step": 0.5}, {"rtol": 0.1}, {"guard": "clearance"},
                                    {"max_angle": 100.0}, {"weights": "area"},
                                    {"worst_fraction": 0.5}, {"max_edge_ratio": 2.0})],
        *[("star", o) for o in ({"worst": False}, {"target_quality": 0.5}, {"time_limit": 1.0},
                                {"mean_loss": 0.2})],
    ],
)  # fmt: skip
def test_options_of_other_methods_are_refused(method, option):
    (name,) = option
    with pytest.raises(ValueError, match=f"^method '{method}' has no option {name}"):
        smooth(grid(3, 3), method, **option)
    with pytest.raises(TypeError):
        (smooth_optimize if method == "optimize" else smooth_star)(grid(3, 3), **option)


@pytest.mark.nojit
def test_auto_means_optimize():
    mesh = random_mesh("quads", 3, seed=2).mesh
    auto, own = (smooth(mesh, m, max_sweeps=20, threads=1) for m in ("auto", "optimize"))
    assert auto.method == own.method == "optimize"
    assert "auto chose optimize" in auto.reason
    assert auto.points.tobytes() == own.points.tobytes()
    assert smooth_optimize(mesh, max_sweeps=20, threads=1).points.tobytes() == own.points.tobytes()


@pytest.mark.nojit
@pytest.mark.parametrize("max_sweeps", [0, 1, 7, 10, 23])
def test_it_sweeps_no_more_than_it_is_told(max_sweeps):
    mesh = random_mesh("mixed", 3, seed=2, amount=0.9).mesh
    records = []
    result = smooth_optimize(mesh, max_sweeps=max_sweeps, callback=records.append, threads=1)
    assert result.sweeps == max_sweeps
    assert not result.converged
    assert f"max_sweeps={max_sweeps}" in result.reason
    assert tuple(records) == result.history
    assert len(records) >= math.ceil(max_sweeps / ROUND)
    if max_sweeps == 0:
        assert np.array_equal(result.points, mesh.points)
    else:
        assert result.after.mean["shape"] > result.before.mean["shape"]
    check_no_worse(result)


@pytest.mark.nojit
def test_nothing_can_move():
    for run in (smooth_optimize, untangle):
        result = run(grid(1, 4))
        assert result.sweeps == 0
        assert result.reason == "no vertex can move: all are on the boundary, fixed or in no cell"


@pytest.mark.nojit
def test_the_input_is_not_changed_and_the_result_has_both_summaries():
    mesh = random_mesh("quads", 3, seed=1, amount=0.9).mesh
    points = mesh.points.copy()
    result = smooth_optimize(mesh, max_sweeps=30, threads=1)
    assert np.array_equal(mesh.points, points)
    assert result.before == quality(mesh).summary()
    assert result.after == quality(result.mesh).summary()
    assert result.seconds > 0.0
    assert result.mesh.cell_vertices is mesh.cell_vertices or np.array_equal(
        result.mesh.cell_vertices, mesh.cell_vertices
    )


def test_a_time_limit_stops_with_the_best_so_far():
    mesh = jittered(60, 60, seed=2)
    short = smooth_optimize(mesh, time_limit=1e-6)
    assert not short.converged
    assert "the time limit of 1e-06 s was reached" in short.reason
    check_no_worse(short)
    smooth_optimize(mesh)  # compiled
    limited = smooth_optimize(mesh, time_limit=0.02)
    assert limited.seconds < 2.0
    check_no_worse(limited)


def test_a_target_stops_early():
    mesh = jittered(30, 30, amount=0.45, seed=2)
    whole, early = smooth_optimize(mesh), smooth_optimize(mesh, target_quality=0.6)
    assert early.after.worst["scaled_jacobian"] >= 0.6
    assert early.sweeps < whole.sweeps
    assert early.converged
    beyond = smooth_optimize(mesh, target_quality=1.0)
    assert beyond.after.worst["scaled_jacobian"] == pytest.approx(
        whole.after.worst["scaled_jacobian"], abs=1e-2
    )


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
def test_the_worst_cells_cost_the_mean_what_they_may(shared_meshes):
    mesh = read_mesh(shared_meshes / "spiral_2k.off")
    mean_only = smooth_optimize(mesh, worst=False)
    both = smooth_optimize(mesh)
    assert "worst cells" not in mean_only.reason
    assert both.after.worst["scaled_jacobian"] > mean_only.after.worst["scaled_jacobian"] + 0.05
    assert mean_only.after.mean["shape"] > both.after.mean["shape"]
    for loss in (0.0, 0.01, 0.05):
        result = smooth_optimize(mesh, mean_loss=loss)
        # The mean's own optimum is not told: the stage before the worst cells stops near it.
        least = (1.0 - loss) * mean_only.after.mean["shape"] - 2e-3
        assert result.after.mean["shape"] >= least
        check_no_worse(result)


@pytest.mark.nojit
def test_only_the_selected_move():
    mesh = random_mesh("quads", 6, seed=4, amount=0.9).mesh
    cells = [0, 1, 6, 7]
    result = smooth_optimize(mesh, selection=cells, max_sweeps=30, threads=1)
    moved = (result.points != mesh.points).any(axis=1)
    assert moved.any()
    of_cells = np.zeros(mesh.n_vertices, np.bool_)
    of_cells[mesh.cell_vertices.reshape(-1, 4)[cells].ravel()] = True
    assert not moved[~of_cells].any()
    check_no_worse(result)
    more = smooth_optimize(mesh, selection=cells, selection_rings=1, max_sweeps=30, threads=1)
    assert (more.points != mesh.points).any(axis=1).sum() > moved.sum()


@pytest.mark.nojit
def test_a_mesh_in_space_stays_in_its_plane():
    made = random_mesh("quads", 4, seed=4, amount=0.9)
    lift = np.column_stack([0.8 * made.points[:, 0], made.points[:, 1], 0.6 * made.points[:, 0]])
    result = smooth_optimize((lift, made.cells), max_sweeps=40, threads=1)
    flat = smooth_optimize(made.mesh, max_sweeps=40, threads=1)
    assert result.after.n_invalid == 0
    assert result.points[:, 2] == pytest.approx(0.75 * result.points[:, 0], abs=1e-12)
    assert result.after.mean["shape"] == pytest.approx(flat.after.mean["shape"], abs=1e-3)


# ------------------------------------------------------------------------------- the whole mesh


def solver(mesh):
    return newton.GlobalNewton(mesh, mesh.topology.schedule(True))


def warped(n=24, kind="quad"):
    """A valid grid in which a whole region has to move."""
    mesh = structured(n, n, kind=kind)
    x, y = mesh.points.T
    low = 0.5 * np.exp(-(((x - 0.5) / 0.15) ** 2))
    return mesh.with_points(np.stack([x, y + low * (1.0 - y)], axis=1))


def energy(mesh, xy):
    from qsmooth.kernels.newton_sweep import cell_energy

    worst, total = np.empty((2, mesh.n_cells))
    movable = np.zeros(mesh.n_vertices, np.bool_)
    movable[mesh.topology.schedule(True).vertices] = True
    cell_energy(xy, mesh.cell_offsets, mesh.cell_vertices, movable, worst, total)
    return float((total * np.where(np.diff(mesh.cell_offsets) == 3, 1.0, 4.0)).sum())


@pytest.mark.parametrize("direct_up_to", [50_000, 0], ids=["direct", "multigrid"])
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_steps_on_the_whole_mesh_go_downhill_and_keep_it_valid(monkeypatch, kind, direct_up_to):
    monkeypatch.setattr(newton, "DIRECT_UP_TO", direct_up_to)
    mesh = warped(kind=kind)
    steps = solver(mesh)
    xy = mesh.xy.copy()
    gains = []
    for _ in range(4):
        before = energy(mesh, xy)
        state = np.random.get_state()  # noqa: NPY002
        gains.append(steps.step(xy))
        after = energy(mesh, xy)
        now = np.random.get_state()  # noqa: NPY002
        assert all(np.array_equal(a, b) for a, b in zip(state, now, strict=True))
        assert after <= before
        assert gains[-1] == pytest.approx(1.0 - after / before, abs=1e-12)
        assert is_valid(mesh.with_points(xy))
    assert gains[0] > 0.01
    assert xy[mesh.is_fixed].tobytes() == mesh.xy[mesh.is_fixed].tobytes()


@pytest.mark.parametrize("direct_up_to", [50_000, 0], ids=["direct", "multigrid"])
def test_a_step_has_the_same_bits_twice_and_on_two_threads(monkeypatch, direct_up_to):
    monkeypatch.setattr(newton, "DIRECT_UP_TO", direct_up_to)
    mesh = warped()
    ends = []
    for threads in (1, 2):
        np.random.seed(threads)  # noqa: NPY002
        xy = mesh.xy.copy()
        with use_threads(threads):
            solver(mesh).step(xy)
        ends.append(xy.tobytes())
    assert ends[0] == ends[1]


def test_direct_and_multigrid_steps_go_the_same_way(monkeypatch):
    mesh = warped()
    ends = []
    for limit in (50_000, 0):
        monkeypatch.setattr(newton, "DIRECT_UP_TO", limit)
        xy = mesh.xy.copy()
        solver(mesh).step(xy)
        ends.append(xy - mesh.xy)
    size = np.linalg.norm(ends[0])
    assert np.linalg.norm(ends[0] - ends[1]) < 0.1 * size


def test_few_steps_do_what_sweeps_take_hundreds_for():
    mesh = warped(40)
    xy = mesh.xy.copy()
    steps = solver(mesh)
    for _ in range(8):
        steps.step(xy)
    assert steps.step(xy) < 1e-3
    swept = smooth_optimize(mesh, worst=False, max_sweeps=50)
    assert energy(mesh, xy) < energy(mesh, swept.mesh.xy)


def test_a_step_at_the_optimum_changes_nothing():
    mesh = structured(6, 6)
    xy = mesh.xy.copy()
    assert solver(mesh).step(xy) == pytest.approx(0.0, abs=1e-12)
    assert xy == pytest.approx(mesh.xy, abs=1e-12)


def test_where_sweeps_would_creep_it_takes_steps_on_the_whole_mesh(monkeypatch):
    # All interior columns pressed to the left: a change has to cross the whole mesh.
    mesh = structured(60, 60)
    x, y = mesh.points.T
    inside = ~mesh.is_boundary[:, None]
    mesh = mesh.with_points(np.where(inside, np.stack([x**4, y], axis=1), mesh.points))
    result = smooth_optimize(mesh)
    assert re.search(r"and \d+ Newton steps on the whole mesh", result.reason)
    assert result.after.worst["min_angle"] > 89.0
    assert all(record.n_invalid == 0 for record in result.history)
    check_no_worse(result)
    mean = smooth_optimize(mesh, worst=False, max_sweeps=200)
    monkeypatch.setattr(newton.GlobalNewton, "step", lambda self, xy: 0.0)
    creeping = smooth_optimize(mesh, worst=False, max_sweeps=200)
    assert mean.after.mean["shape"] > creeping.after.mean["shape"] + 0.01


@pytest.mark.parametrize(("n", "height", "width"), [(40, 0.5, 0.15), (100, 0.5, 0.15)])
def test_a_bump_is_mended(n, height, width):
    result = smooth_optimize(bump(n, height=height, width=width))
    check_no_worse(result)
    assert result.before.worst["scaled_jacobian"] < 0.35
    assert result.after.worst["scaled_jacobian"] > 0.6
