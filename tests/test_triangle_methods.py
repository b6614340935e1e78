"""What holds for every method, on any mesh and on the real ones: the methods of triangles here."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshes import KINDS, place, random_mesh, random_meshes
from qsmooth import Mesh, examples, quality, smooth
from test_real_meshes import VALID, read

# Method and options; whether validity and the worst cell are kept.
GUARDED = {
    "aspect-ratio": {},
    "aspect-ratio, clearance": {"guard": "clearance", "step": 1.0, "max_edge_ratio": 1.0},
    "angle": {},
    "angle, clearance": {"guard": "clearance", "step": 0.5},
    "smart-laplacian": {"weights": "area"},
    "star": {"worst_fraction": 0.1, "worst_first": True, "bad_angle": 130.0, "bad_step": 1.5},
    "quad": {"worst_fraction": 0.1, "worst_first": True, "bad_angle": 130.0, "bad_step": 1.5},
    "star, selected": {"selection": "max_angle > 100", "selection_rings": 1},
}
UNGUARDED = {"angle, none": {"guard": "none"}, "laplacian": {"weights": "area"}}


def run(mesh, name, **more):
    """Smooth; quads alone are nothing to the aspect-ratio method."""
    method = name.split(",")[0]
    options = (GUARDED | UNGUARDED)[name] | more
    if method == "aspect-ratio" and (np.diff(mesh.cell_offsets) == 4).all():
        options["split_quads"] = True
    return smooth(mesh, method, **options)


@given(random_meshes(), st.sampled_from(sorted(GUARDED)))
def test_valid_stays_valid_and_the_worst_cell_never_gets_worse(made, name):
    mesh = made.mesh
    result = run(mesh, name, max_sweeps=4, rtol=0.0)
    rests = mesh.is_fixed | mesh.is_interface
    assert result.points[rests].tobytes() == mesh.points[rests].tobytes()
    if "two triangles" in result.reason:
        return  # what is kept then are the triangles
    assert all(record.n_invalid == 0 for record in result.history)
    if "clearance" not in name:
        before = result.before.worst["scaled_jacobian"]
        assert result.after.worst["scaled_jacobian"] >= before - 1e-14


@pytest.mark.parametrize("name", [*GUARDED, *UNGUARDED])
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_turned_scaled_and_moved_input_gives_so_moved_output(kind, name):
    made = random_mesh(kind, 5, seed=6, amount=0.8)
    mesh = made.mesh
    result = run(mesh, name, max_sweeps=3, rtol=0.0)
    move = {"scale": 250.0, "turn": 0.7, "shift": (3.0, -8.0)}
    other = run(Mesh(place(made.points, **move), made.cells), name, max_sweeps=3, rtol=0.0)
    np.testing.assert_allclose(other.points, place(result.points, **move), rtol=0, atol=2e-8)
    mirrored = Mesh(place(made.points, mirror=True), made.cells)
    other = run(mirrored, name, max_sweeps=3, rtol=0.0)
    np.testing.assert_allclose(other.points, place(result.points, mirror=True), atol=1e-10)


@pytest.mark.parametrize("name", [*GUARDED, *UNGUARDED])
def test_the_bits_do_not_depend_on_the_threads(name):
    mesh = examples.jittered(40, 40, kind="mixed", seed=2)
    one = run(mesh, name, max_sweeps=3, rtol=0.0, threads=1)
    two = run(mesh, name, max_sweeps=3, rtol=0.0, threads=2)
    assert one.points.tobytes() == two.points.tobytes()


@pytest.mark.parametrize("name", [*GUARDED, *UNGUARDED])
def test_fixed_vertices_interfaces_and_orphans_stay(name):
    made = random_mesh("mixed", 8, seed=2, amount=0.8)
    points = np.concatenate([made.points, [(0.5, 0.5), (40.0, 3.0)]])
    middle = made.points[:, 0].mean()
    regions = np.concatenate([made.points[b, 0].mean(axis=1) < middle for b in made.cells])
    mesh = Mesh(points, made.cells, regions=regions, fixed=[20, 30])
    rests = mesh.is_fixed | mesh.is_interface
    assert (mesh.is_interface & ~mesh.is_boundary).any()
    for options in ({}, {"split_quads": True}):
        result = run(mesh, name, max_sweeps=3, **options)
        assert result.points[rests].tobytes() == mesh.points[rests].tobytes()
        assert (result.points != mesh.points).any()
        assert all(np.array_equal(a, b) for a, b in zip(result.mesh.cells, mesh.cells, strict=True))


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", VALID)
def test_every_real_mesh(shared_meshes, file):
    mesh = read(shared_meshes, file)
    slack = 1e-12 if mesh.plane is not None else 0.0
    rests = mesh.is_fixed | mesh.is_interface
    for name in [*GUARDED, *UNGUARDED]:
        result = run(mesh, name, max_sweeps=3, rtol=0.0)
        assert result.points[rests].tobytes() == mesh.points[rests].tobytes()
        if name in UNGUARDED or "two triangles" in result.reason:
            if result.after.n_invalid:
                assert str(result.after.n_invalid) in result.reason
            continue
        assert all(record.n_invalid == 0 for record in result.history), name
        if "clearance" not in name:
            worst = result.before.worst["scaled_jacobian"]
            assert result.after.worst["scaled_jacobian"] >= worst - slack, name


@pytest.mark.parametrize("seed", range(3))
def test_on_tangled_meshes_no_valid_cell_is_lost(seed):
    mesh = examples.tangled(12, 12, kind="mixed", seed=seed)
    valid = quality(mesh).validity == 0
    for name in GUARDED:
        result = run(mesh, name, max_sweeps=6)
        assert not (valid & (quality(result.mesh).validity != 0)).any()
        assert f"{result.method} does not untangle" in result.reason


# ------------------------------------------------------------------------ the studies' claims


@pytest.fixture(scope="module")
def random_triangulations():
    return {n: [examples.random_triangles(n, seed=s) for s in range(20)] for n in (12, 40, 1000)}


@pytest.mark.parametrize("n_faces", [12, 40, 1000])
def test_by_aspect_ratio_wins_two_of_three_over_angle_based(random_triangulations, n_faces):
    meshes = random_triangulations[n_faces]
    ratios = {}
    for method in ("aspect-ratio", "angle"):
        results = [smooth(mesh, method) for mesh in meshes]
        assert all(record.n_invalid == 0 for r in results for record in r.history)
        ratios[method] = np.array([r.after.worst["aspect_ratio"] for r in results])
    ours, theirs = ratios.values()
    assert (ours < theirs).sum() >= 14
    assert np.median(ours) < np.median(theirs)


@pytest.mark.parametrize("file", ["spiral_2k.off", "superior_24k.off"])
def test_fifty_sweeps_make_no_figure_worse_and_quad_the_smaller_largest_angle(shared_meshes, file):
    mesh = read(shared_meshes, file)
    results = {m: smooth(mesh, m, max_sweeps=50, rtol=0.0) for m in ("star", "quad")}
    for result in results.values():
        assert result.sweeps == 50
        assert all(record.n_invalid == 0 for record in result.history)
        for before, after in (
            (result.before.worst, result.after.worst),
            (result.before.mean, result.after.mean),
        ):
            assert after["max_angle"] <= before["max_angle"]
            assert after["min_angle"] >= before["min_angle"]
            assert after["aspect_ratio"] <= before["aspect_ratio"]
    largest = {m: r.after.worst["max_angle"] for m, r in results.items()}
    assert largest["quad"] <= largest["star"]
