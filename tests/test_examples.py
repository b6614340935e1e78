"""Example meshes: valid where they should be, of the size asked for, the same every time."""

import numpy as np
import pytest

from qsmooth import Mesh, examples, quality, smooth
from qsmooth.examples import DEMO_FILE, demo_mesh, spiral
from qsmooth.examples.spirals import made_spiral
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
    "distorted": (lambda: examples.distorted(10, seed=1), 100),
    "around a body": (lambda: examples.around_body(10), 96),
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


@pytest.mark.nojit
@pytest.mark.parametrize("n_quads", [200, 1000, 1900, 6000])
@pytest.mark.parametrize("seed", [0, 1])
def test_spiral_is_one_band_of_valid_quads(n_quads, seed):
    mesh = spiral(n_quads, seed=seed)
    assert mesh.n_cells == pytest.approx(n_quads, rel=0.05)
    assert quality(mesh).n_invalid == 0
    assert mesh.topology.n_parts == 1
    # A disc: vertices - edges + cells = 1.
    n_edges = mesh.ring_vertices.size // 2
    assert mesh.n_vertices - n_edges + mesh.n_cells == 1


@pytest.mark.nojit
def test_spiral_is_as_bad_as_the_papers():
    measured = quality(spiral())
    assert 14.0 <= measured.min_angle.min() <= 21.0
    assert 179.5 <= measured.max_angle.max() < 180.0
    assert 55.0 <= measured.aspect_ratio.max() <= 65.0
    assert 2.6 <= measured.aspect_ratio.mean() <= 2.8


@pytest.mark.nojit
def test_spiral_narrows_towards_its_centre():
    mesh = spiral(jitter=0.0)
    area = quality(mesh).area
    distance = np.hypot(*mesh.points[mesh.cells[0]].mean(axis=1).T)
    inner, outer = np.argsort(distance)[:200], np.argsort(distance)[-200:]
    assert area[inner].mean() < 0.1 * area[outer].mean()


@pytest.mark.nojit
def test_spiral_depends_on_the_seed_alone():
    one, again, other = spiral(seed=3), spiral(seed=3), spiral(seed=4)
    assert one.points.tobytes() == again.points.tobytes()
    assert np.array_equal(one.cells[0], again.cells[0])
    assert not np.array_equal(one.points, other.points)


@pytest.mark.nojit
def test_spiral_moves_no_boundary_vertex():
    mesh, moved = spiral(jitter=0.0), spiral(jitter=0.5)
    differs = (mesh.points != moved.points).any(axis=1)
    assert np.array_equal(differs, ~mesh.is_boundary)


@pytest.mark.nojit
@pytest.mark.parametrize(
    "options", [{"n_quads": 199}, {"jitter": -0.1}, {"jitter": np.nan}, {"jitter": np.inf}]
)
def test_spiral_refuses(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        spiral(**options)


@pytest.mark.nojit
def test_the_packaged_mesh_is_the_spiral():
    mesh, made, formula = demo_mesh(), spiral(), made_spiral()
    assert mesh.points.tobytes() == made.points.tobytes()
    for other in (made, formula):
        assert np.array_equal(mesh.cells[0], other.cells[0])
    # NumPy may change the stream of its generators, and sines differ in the last bit between
    # processors; the packaged file is what counts.
    assert mesh.points == pytest.approx(formula.points, abs=1e-12)
    assert quality(mesh).n_invalid == 0
    assert DEMO_FILE.stat().st_size < 150_000
