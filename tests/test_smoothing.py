"""The driver: options, what it reports, when it stops, and meshes with something wrong."""

import math
import re

import numpy as np
import pytest

import reference
from meshes import annulus, grid, random_mesh, tangle, tilt
from qsmooth import (
    Mesh,
    quality,
    smooth,
    smooth_laplacian,
    smooth_quad,
    smooth_smart_laplacian,
    smooth_star,
    smoothing,
)

GUARDED = {
    "star": smooth_star,
    "quad": smooth_quad,
    "smart-laplacian": smooth_smart_laplacian,
}
METHODS = {**GUARDED, "laplacian": smooth_laplacian}


def rough(kind="quads", size=6, seed=1):
    return random_mesh(kind, size, seed=seed, amount=0.9).mesh


# ------------------------------------------------------------------------------- options

BAD = [
    ({"max_sweeps": -1}, "max_sweeps must be an integer of 0 or more, got -1"),
    ({"max_sweeps": 2.0}, "max_sweeps must be an integer of 0 or more, got 2.0"),
    ({"max_sweeps": True}, "max_sweeps must be an integer of 0 or more, got True"),
    ({"max_sweeps": math.nan}, "max_sweeps must be an integer of 0 or more, got nan"),
    ({"rtol": -1e-9}, "rtol must be in [0, 1), got -1e-09"),
    ({"rtol": 1.0}, "rtol must be in [0, 1), got 1.0"),
    ({"rtol": math.nan}, "rtol must be in [0, 1), got nan"),
    ({"guard": "none"}, "guard must be 'quality' or 'clearance', got 'none'"),
    ({"guard": None}, "guard must be 'quality' or 'clearance', got None"),
    ({"min_angle": 0.0}, "min_angle must be in (0, 180) degrees, got 0.0"),
    ({"min_angle": math.nan}, "min_angle must be in (0, 180) degrees, got nan"),
    ({"min_angle": 120.0}, "max_angle must be over min_angle and below 180 degrees, got 120.0"),
    ({"max_angle": 60.0}, "max_angle must be over min_angle and below 180 degrees, got 60.0"),
    ({"max_angle": 180.0}, "max_angle must be over min_angle and below 180 degrees, got 180.0"),
    ({"max_angle": math.nan}, "max_angle must be over min_angle and below 180 degrees, got nan"),
    ({"max_angle": math.inf}, "max_angle must be over min_angle and below 180 degrees, got inf"),
    ({"triangle_min_angle": -5.0}, "triangle_min_angle must be in (0, 180) degrees, got -5.0"),
    ({"triangle_min_angle": 90.0},
     "triangle_max_angle must be over triangle_min_angle and below 180 degrees, got 90.0"),
    ({"triangle_max_angle": 200.0},
     "triangle_max_angle must be over triangle_min_angle and below 180 degrees, got 200.0"),
    ({"triangle_max_angle": math.nan},
     "triangle_max_angle must be over triangle_min_angle and below 180 degrees, got nan"),
    ({"step": 0.0}, "step must be in (0, 1], got 0.0"),
    ({"step": 1.5}, "step must be in (0, 1], got 1.5"),
    ({"step": math.nan}, "step must be in (0, 1], got nan"),
    ({"worst_fraction": 0.0}, "worst_fraction must be in (0, 1], got 0.0"),
    ({"worst_fraction": 1.01}, "worst_fraction must be in (0, 1], got 1.01"),
    ({"worst_fraction": math.nan}, "worst_fraction must be in (0, 1], got nan"),
    ({"threads": 0}, "threads must be an integer of 1 or more, got 0"),
    ({"threads": 1.0}, "threads must be an integer of 1 or more, got 1.0"),
    ({"threads": True}, "threads must be an integer of 1 or more, got True"),
    ({"threads": 10**6}, "threads must be at most "),
]  # fmt: skip


@pytest.mark.nojit
@pytest.mark.parametrize(("options", "message"), BAD, ids=[str(o) for o, _ in BAD])
def test_an_option_out_of_range_is_named_with_its_range_and_value(options, message):
    for run in (smooth_star, smooth_quad):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
            run(grid(2, 2), **options)


@pytest.mark.nojit
@pytest.mark.parametrize(
    "options",
    [
        {"max_sweeps": np.int32(3)},
        {"rtol": 0},
        {"rtol": np.float32(0.5)},
        {"step": 1},
        {"worst_fraction": 1e-9},
        {"min_angle": 1e-9, "max_angle": 179.999},
        {"min_angle": np.float64(89), "max_angle": 90},
        {"threads": np.int64(1)},
    ],
    ids=str,
)
def test_options_at_the_ends_of_their_ranges_and_of_other_number_types(options):
    for run in (smooth_star, smooth_quad):
        result = run(rough(size=3), **options)
        assert result.after.n_invalid == 0


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("laplacian", {"guard": "clearance"}),
        ("laplacian", {"step": 0.25}),
        ("smart-laplacian", {"worst_fraction": 0.5}),
        ("smart-laplacian", {"max_angle": 100.0}),
        ("laplacian", {"triangle_min_angle": 40.0}),
    ],
)
def test_an_option_that_a_method_does_not_have(method, options):
    (option,) = options
    with pytest.raises(ValueError, match=f"method '{method}' has no option {option}"):
        smooth(grid(2, 2), method, **options)
    with pytest.raises(TypeError, match="unexpected keyword"):
        METHODS[method](grid(2, 2), **options)


@pytest.mark.nojit
@pytest.mark.parametrize(("method", "most"), [("star", 50), ("laplacian", 50), ("optimize", 5000)])
def test_each_method_has_a_limit_of_its_own(monkeypatch, method, most):
    from qsmooth import smoothing

    seen = []
    name = "_optimized" if method == "optimize" else "_iterate"
    monkeypatch.setattr(smoothing, name, lambda *given: seen.extend(given))
    smooth(grid(2, 2), method)
    (settings,) = [given for given in seen if isinstance(given, smoothing._Settings)]
    assert settings.max_sweeps == most


@pytest.mark.nojit
def test_a_method_that_is_none():
    with pytest.raises(
        ValueError, match=r"method must be one of auto, optimize, star, quad, .*; got 'fast'"
    ):
        smooth(grid(2, 2), "fast")


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_options_are_keywords_and_a_pair_is_a_mesh(method):
    with pytest.raises(TypeError):
        METHODS[method](grid(2, 2), 5)
    mesh = rough(size=3)
    results = [
        smooth(mesh, method, max_sweeps=3),
        METHODS[method](mesh, max_sweeps=3),
        METHODS[method]((mesh.points, mesh.cells), max_sweeps=3),
        METHODS[method]((mesh.points.tolist(), mesh.cells[0].tolist()), max_sweeps=3),
    ]
    for result in results:
        assert result.method == method
        assert np.array_equal(result.points, results[0].points)
    with pytest.raises(TypeError, match=r"expected a Mesh, .* got str"):
        METHODS[method]("mesh.off")


# ------------------------------------------------------------------------------- the result


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_history_tells_what_each_sweep_did(method):
    mesh = rough(size=5)
    seen = []
    result = smooth(mesh, method, max_sweeps=4, rtol=0.0, callback=seen.append)
    assert result.sweeps == 4
    assert seen == list(result.history)
    before = mesh.points
    for n, record in enumerate(result.history, start=1):
        now = smooth(mesh, method, max_sweeps=n, rtol=0.0)
        assert now.history == result.history[:n]
        own = quality(now.mesh)
        assert record.min_angle == own.min_angle.min()
        assert record.max_angle == own.max_angle.max()
        assert record.mean_shape == own.shape.mean()
        assert record.n_invalid == own.n_invalid
        moves = np.hypot(*(now.points - before).T)
        assert record.n_moved == (moves > 0.0).sum()
        assert record.largest_move == pytest.approx(moves.max(), rel=1e-9)
        assert record.largest_share > 0.0
        before = now.points


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_result_carries_both_summaries_and_the_input_stays(method):
    mesh = rough(size=4)
    points = mesh.points.copy()
    result = smooth(mesh, method)
    assert np.array_equal(mesh.points, points)
    assert result.before == quality(mesh).summary()
    assert result.after == quality(result.mesh).summary()
    assert result.points is result.mesh.points
    assert result.mesh.cell_vertices is mesh.cell_vertices
    assert [b.tolist() for b in result.mesh.cells] == [b.tolist() for b in mesh.cells]
    assert result.seconds >= 0.0
    assert np.array_equal(result.points[mesh.is_boundary], points[mesh.is_boundary])
    assert result.after.worst["scaled_jacobian"] >= result.before.worst["scaled_jacobian"]


@pytest.mark.nojit
def test_an_exception_in_the_callback_gets_through():
    def stop(record):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        smooth_star(rough(size=3), callback=stop)
    assert smooth_star(rough(size=3)).sweeps > 0


# ------------------------------------------------------------------------------- when it stops


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_no_sweep(method):
    mesh = rough(size=3)
    result = smooth(mesh, method, max_sweeps=0)
    assert (result.sweeps, result.history, result.converged) == (0, (), False)
    assert result.reason == "no sweep was asked for"
    assert np.array_equal(result.points, mesh.points)


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_nothing_can_move(method):
    result = smooth(grid(5, 1), method)
    assert result.converged
    assert result.sweeps == 0
    assert result.reason.startswith("no vertex can move")


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_a_square_grid_rests_at_once(method):
    points, cells = grid(4, 4)
    result = smooth((points, cells), method)
    assert result.converged
    assert result.sweeps == 1
    assert "every vertex rests" in result.reason
    assert np.array_equal(result.points, points)


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_rtol_of_zero_runs_all_sweeps(method):
    result = smooth(grid(3, 3), method, rtol=0.0, max_sweeps=7)
    assert result.sweeps == 7
    assert not result.converged
    assert result.reason.startswith("stopped after 7 sweeps, as max_sweeps says")


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
def test_out_of_sweeps_is_a_result(method):
    result = smooth(rough(), method, max_sweeps=2)
    assert result.sweeps == 2
    assert not result.converged
    assert result.reason.startswith("stopped after 2 sweeps, as max_sweeps says")


@pytest.mark.parametrize("method", METHODS)
def test_rest_means_what_rtol_says(method):
    mesh = rough(size=4)
    rests = [
        r
        for rtol in (0.3, 0.05, 0.01)
        if "rests" in (r := smooth(mesh, method, rtol=rtol, max_sweeps=500)).reason
        and r.history[-1].largest_share <= rtol
        and all(record.largest_share > rtol for record in r.history[:-1])
    ]
    assert rests
    assert all(r.converged for r in rests)


def test_quality_that_no_longer_improves_is_reason_to_stop():
    mesh = rough("L", 8, seed=2)
    result = smooth_star(mesh, rtol=1e-12, max_sweeps=2000)
    assert result.converged
    assert result.reason == "quality has not improved for 10 sweeps"
    past, recent = result.history[:-10], result.history[-10:]
    assert max(r.min_angle for r in recent) <= max(r.min_angle for r in past) + 0.01
    assert min(r.max_angle for r in recent) >= min(r.max_angle for r in past) - 0.01
    assert max(r.mean_shape for r in recent) <= max(r.mean_shape for r in past) + 1e-4


# ------------------------------------------------------------------------------- worst_fraction


@pytest.mark.nojit
@pytest.mark.parametrize("method", ["star", "quad"])
@pytest.mark.parametrize("fraction", [0.01, 0.2, 0.6])
def test_only_the_worst_cells_make_proposals(method, fraction):
    mesh = rough("quads", 6, seed=7)
    result = smooth(mesh, method, worst_fraction=fraction, max_sweeps=1)
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    worst = reference.worst_cells(points, cells, fraction)
    assert len(worst) == math.ceil(fraction * mesh.n_cells)
    touched = {v for c in worst for v in cells[c]}
    moved = np.flatnonzero((result.points != mesh.points).any(axis=1))
    assert len(moved)
    assert set(moved.tolist()) <= touched


# ------------------------------------------------------------------------------- threads


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["quads", "mixed"])
def test_two_threads_give_the_bits_of_one(method, kind):
    mesh = rough(kind, 24, seed=9)
    one = smooth(mesh, method, max_sweeps=8, rtol=0.0, threads=1)
    two = smooth(mesh, method, max_sweeps=8, rtol=0.0, threads=2)
    own = smooth(mesh, method, max_sweeps=8, rtol=0.0)
    assert one.points.tobytes() == two.points.tobytes() == own.points.tobytes()
    assert one.history == two.history == own.history


def test_smoothing_from_several_python_threads_at_once():
    from concurrent.futures import ThreadPoolExecutor

    meshes = [rough("quads", 10, seed=k) for k in range(4)]
    alone = [smooth_star(mesh, max_sweeps=5, threads=1).points.tobytes() for mesh in meshes]
    with ThreadPoolExecutor(4) as pool:
        together = pool.map(lambda m: smooth_star(m, max_sweeps=5, threads=1).points, meshes)
        assert [points.tobytes() for points in together] == alone


# ------------------------------------------------------------------------------- not so good meshes


@pytest.mark.nojit
def test_plain_laplacian_inverts_cells_on_a_concave_domain_and_says_so():
    # Five cells around: the mean of the neighbours, along chords, lies within the hole.
    mesh = Mesh(*annulus(5, 2))
    result = smooth_laplacian(mesh)
    assert result.before.n_invalid == 0
    n = result.after.n_invalid
    assert n > 0
    assert result.history[-1].n_invalid == n
    assert re.search(f"laplacian is unguarded.* made {n} cells invalid", result.reason)
    for method in GUARDED:
        guarded = smooth(mesh, method)
        assert guarded.after.n_invalid == 0
        assert all(record.n_invalid == 0 for record in guarded.history)
        assert "invalid" not in guarded.reason


def lost_corners(before, after):
    """Positive corners of one mesh that are not positive in the other."""
    old, new = reference.as_complex(before.xy), reference.as_complex(after.xy)
    return [
        (c, i)
        for c, cell in enumerate(reference.as_lists(before))
        for i, (a, b) in enumerate(
            zip(reference.corner_signs(old, cell), reference.corner_signs(new, cell), strict=True)
        )
        if a > 0 >= b
    ]


@pytest.mark.parametrize("guard", ["quality", "clearance"])
@pytest.mark.parametrize("method", GUARDED)
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "L", "annulus"])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_tangled_mesh_loses_no_valid_corner_and_the_reason_says_so(kind, method, guard, seed):
    made = random_mesh(kind, 5, seed=seed)
    points = tangle(made.points, made.cells, np.random.default_rng(seed), 0.8)
    mesh = made.mesh.with_points(points)
    n_before = quality(mesh).n_invalid
    assert n_before
    for sweeps in (1, 2, 10):
        result = smooth(mesh, method, guard=guard, max_sweeps=sweeps, rtol=0.0)
        assert not lost_corners(mesh, result.mesh)
        n = result.after.n_invalid
        cells = "1 cell" if n == 1 else f"{n} cells"
        assert f"and {method} does not untangle: {cells} invalid now" in result.reason
        assert f"invalid) and {method}" in result.reason


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


@pytest.mark.nojit
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ODD)
def test_odd_meshes_crash_nothing(name, method):
    points, cells = ODD[name]
    mesh = Mesh(np.array(points, dtype=float), cells)
    result = smooth(mesh, method, max_sweeps=5, rtol=0.0)
    assert np.isfinite(result.points).all()
    assert np.array_equal(result.points[mesh.is_fixed], mesh.points[mesh.is_fixed])
    if method in GUARDED:
        assert not lost_corners(mesh, result.mesh)
        assert result.after.n_invalid <= result.before.n_invalid
    str(result.before)


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
    result = smooth_star(both, max_sweeps=5, rtol=0.0, guard="clearance")
    alone = smooth_star(one.mesh, max_sweeps=5, rtol=0.0, guard="clearance")
    np.testing.assert_allclose(result.points[:n], alone.points, atol=1e-10)
    assert result.after.n_invalid == 0


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
            if quality(mesh.with_points(xy)).n_invalid:
                continue
            result = smoothing._stored(mesh, xy.copy())
            assert quality(result).n_invalid == 0
            moved = (result.points != mesh.points).any(axis=1)
            assert moved.tolist() in ([False] * 9, [v == 4 for v in range(9)])
            kept += moved.any()
            taken_back += not moved.any()
    assert kept
    assert taken_back


@pytest.mark.nojit
@pytest.mark.parametrize("method", GUARDED)
def test_the_whole_mesh_clockwise_is_the_same_mesh(method):
    made = random_mesh("quads", 5, seed=4, amount=0.9)
    result = smooth(made.mesh, method, max_sweeps=3, rtol=0.0)
    turned = Mesh(made.points, [block[:, ::-1] for block in made.cells])
    other = smooth(turned, method, max_sweeps=3, rtol=0.0)
    np.testing.assert_allclose(other.points, result.points, atol=1e-12)
    assert other.before.n_invalid == 0


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
