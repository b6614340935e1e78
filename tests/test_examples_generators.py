"""Generated meshes: valid where they should be, of the size asked for, the same every time."""

import math

import numpy as np
import pytest

from qsmooth import Mesh, examples, quality, smooth
from qsmooth.kernels.delaunay import triangulate
from qsmooth.kernels.topology import boundary_loops

VALID = {
    "structured": (lambda: examples.structured(4, 3), 12),
    "structured triangles": (lambda: examples.structured(4, 3, kind="triangle"), 24),
    "structured mixed": (lambda: examples.structured(4, 3, kind="mixed"), 18),
    "jittered": (lambda: examples.jittered(6, 5), 30),
    "jittered triangles": (lambda: examples.jittered(6, 5, kind="triangle", amount=1.0), 60),
    "jittered mixed": (lambda: examples.jittered(6, 5, kind="mixed", amount=2.0, seed=3), 45),
    "bump": (lambda: examples.bump(12), 144),
    "notch": (lambda: examples.notch(10), 100),
    "notch of triangles": (lambda: examples.notch(10, kind="triangle"), 200),
    "boundary layer": (lambda: examples.boundary_layer(10, 8), 80),
    "one vertex": (lambda: examples.simple_case(3), 3),
    "one vertex, good": (lambda: examples.simple_case(3, good=True), 3),
    "12 faces": (lambda: examples.simple_case(12), 12),
    "12 faces, good": (lambda: examples.simple_case(12, good=True), 12),
    "40 faces": (lambda: examples.simple_case(40), 40),
    "40 faces, good": (lambda: examples.simple_case(40, good=True), 40),
    "random triangles": (lambda: examples.random_triangles(4), 4),
    "more of them": (lambda: examples.random_triangles(100, seed=5), 100),
}


@pytest.mark.nojit
@pytest.mark.parametrize(("make", "n_cells"), VALID.values(), ids=VALID.keys())
def test_valid_of_the_right_size_and_the_same_again(make, n_cells):
    mesh = make()
    assert isinstance(mesh, Mesh)
    assert mesh.n_cells == n_cells
    assert quality(mesh).n_invalid == 0
    assert make().points.tobytes() == mesh.points.tobytes()


@pytest.mark.nojit
@pytest.mark.parametrize("name", ["jittered", "tangled", "random_interior"])
def test_seeds_differ_and_the_boundary_stays(name):
    make = getattr(examples, name)
    first, second = make(6, 6, seed=1), make(6, 6, seed=2)
    assert first.points.tobytes() != second.points.tobytes()
    rim = first.is_boundary
    assert np.array_equal(first.points[rim], examples.structured(6, 6).points[rim])


@pytest.mark.nojit
@pytest.mark.parametrize("name", ["tangled", "random_interior"])
def test_tangled_ones_are(name):
    assert quality(getattr(examples, name)(8, 8)).n_invalid > 10


@pytest.mark.nojit
@pytest.mark.parametrize("n_faces", [12, 40])
def test_the_good_cases_are_better_than_the_bad_ones(n_faces):
    good = quality(examples.simple_case(n_faces, good=True)).summary()
    bad = quality(examples.simple_case(n_faces)).summary()
    assert good.worst["aspect_ratio"] < bad.worst["aspect_ratio"]
    assert good.mean["shape"] > bad.mean["shape"]


@pytest.mark.nojit
def test_the_boundary_layer_starts_and_grows_as_said():
    mesh = examples.boundary_layer(6, 12, first=1e-4)
    heights = mesh.points[np.arange(13) * 7, 1]  # at x = 0, where the wall is level
    steps = np.diff(heights)
    assert heights[-1] == pytest.approx(1.0)
    assert steps[0] == pytest.approx(1e-4, rel=1e-6)
    assert steps[1:] / steps[:-1] == pytest.approx(np.full(11, steps[1] / steps[0]), rel=1e-6)


@pytest.mark.nojit
def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="n_triangles must be even and 4 or more, got 5"):
        examples.random_triangles(5)
    with pytest.raises(ValueError, match="kind must be 'quad', 'triangle' or 'mixed', got 'hex'"):
        examples.structured(2, 2, kind="hex")
    with pytest.raises(ValueError, match="n_quads must be 1000 or more"):
        examples.lake(10)
    with pytest.raises(ValueError, match="jitter must be 0 or more"):
        examples.lake(1000, jitter=-1.0)


def test_the_bump_is_as_bad_as_it_is_meant_to_be():
    assert quality(examples.bump(200)).scaled_jacobian.min() == pytest.approx(0.330, abs=5e-4)
    sharp = quality(examples.bump(200, height=0.8, width=0.1)).scaled_jacobian.min()
    assert sharp == pytest.approx(0.144, abs=5e-4)


def test_laplacian_breaks_the_notch_and_guarded_methods_do_not():
    mesh = examples.notch(40)
    assert smooth(mesh, "laplacian").after.n_invalid > 0
    for method in ("star", "quad", "smart-laplacian", "angle"):
        assert all(record.n_invalid == 0 for record in smooth(mesh, method).history)


@pytest.mark.parametrize("n_quads", [1000, 6000, 24_000])
def test_the_lake(n_quads):
    mesh = examples.lake(n_quads)
    assert abs(mesh.n_cells / n_quads - 1.0) < 0.05
    assert mesh.points.tobytes() == examples.lake(n_quads).points.tobytes()
    summary = quality(mesh).summary()
    assert (summary.n_triangles, summary.n_invalid) == (0, 0)
    assert summary.worst["max_angle"] > 178.0
    n_loops, pinched = boundary_loops(
        mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices, mesh.topology.twins
    )
    assert n_loops == 7  # the shore and six islands
    assert not pinched.any()
    assert mesh.topology.n_parts == 1
    assert not mesh.is_fixed[~mesh.is_boundary].any()  # no vertex is in no cell
    area = quality(mesh).area
    assert area.max() > 20.0 * area.min()  # graded


def test_other_lakes_are_whole_too():
    for seed in range(4):
        mesh = examples.lake(2000, seed=seed)
        assert quality(mesh).n_invalid == 0
        assert mesh.topology.n_parts == 1
    smoothed = examples.lake(2000, jitter=0.0)
    assert quality(smoothed).max_angle.max() < quality(mesh).max_angle.max()


# ------------------------------------------------------------------------------- Delaunay

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def areas(points, triangles):
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.nojit
@pytest.mark.parametrize("n", [1, 2, 5, 30, 120])
def test_no_point_is_inside_a_circle(n):
    rng = np.random.default_rng(n)
    points = np.concatenate([SQUARE, rng.random((n, 2))])
    triangles, bad = triangulate(points, rng.permutation(np.arange(4, n + 4)))
    assert bad == -1
    assert len(triangles) == 2 * n + 2
    assert (areas(points, triangles) > 0.0).all()
    for a, b, c in points[triangles]:
        centre = circumcentre(a, b, c)
        radius = math.dist(centre, a)
        assert np.hypot(*(points - centre).T).min() >= radius * (1.0 - 1e-9)


def circumcentre(a, b, c):
    left = 2.0 * np.array([b - a, c - a])
    return np.linalg.solve(left, [b @ b - a @ a, c @ c - a @ a])


@pytest.mark.nojit
def test_points_in_rows_and_on_circles_are_triangulated():
    inner = np.stack(np.meshgrid(np.arange(1, 6), np.arange(1, 6)), axis=-1).reshape(-1, 2) / 6.0
    points = np.concatenate([SQUARE, inner])
    triangles, bad = triangulate(points, np.arange(4, len(points)))
    assert bad == -1
    assert (areas(points, triangles) > 0.0).all()
    assert areas(points, triangles).sum() == pytest.approx(1.0)


@pytest.mark.nojit
@pytest.mark.parametrize("place", [(0.5, 0.5), (1.5, 0.5), (0.0, -1.0)])
def test_coincident_and_outer_points_are_named(place):
    points = np.array([*SQUARE, (0.5, 0.5), place])
    assert triangulate(points, np.array([4, 5]))[1] == 5
