"""The circumcircle method: by hand, against the reference, and its promise on the largest ratio."""

import math

import numpy as np
import pytest

import reference
import reference_triangles
from meshes import random_mesh
from qsmooth import Mesh, quality, smooth
from qsmooth.kernels.aspect_ratio import along_circumcircle

DIAMOND = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1)]
RIM = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]


@pytest.mark.nojit
@pytest.mark.parametrize("step", [0.25, 0.5, 1.0])
def test_on_a_half_circle_the_corner_goes_towards_the_middle(step):
    # v at 30° over a diameter; both edges are as long at 90°.
    v = np.array([math.cos(math.radians(30)), math.sin(math.radians(30))])
    a, c = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
    dx, dy, ratio = along_circumcircle(*(a - v), *(c - v), 1.5, step)
    angle = math.radians(30 + 60 * step)
    assert (v[0] + dx, v[1] + dy) == pytest.approx((math.cos(angle), math.sin(angle)), abs=1e-14)
    assert ratio == pytest.approx(1.0 / math.tan(math.radians(15)))


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("u", "w"),
    [
        ((-1.0, -1.0), (1.4, -1.0)),  # within the ratio
        ((1.0, -1.0), (-3.0, -1.0)),  # turned over
        ((1.0, 0.0), (3.0, 0.0)),  # flat
        ((0.0, 0.0), (3.0, 0.0)),  # with an edge of no length
    ],
)
def test_what_proposes_nothing(u, w):
    assert along_circumcircle(*u, *w, 1.5, 0.5) == (0.0, 0.0, 0.0)


@pytest.mark.nojit
@pytest.mark.parametrize("step", [0.2, 0.5, 1.0])
def test_one_vertex_in_four_triangles(step):
    # From (½, 0) only the two triangles at (1, 0) have a ratio over 1.5. Each circle has its centre
    # at (¾, ±¾) and the radius √⅝; the upper one goes from −(180° − atan 3) to −135°.
    mesh = Mesh([(0.5, 0.0), *RIM], DIAMOND)
    result = smooth(mesh, "aspect-ratio", max_edge_ratio=1.5, step=step, max_sweeps=1)
    start, end = math.atan(3.0) - math.pi, -0.75 * math.pi
    x = 0.75 + math.sqrt(0.625) * math.cos(start + step * (end - start))
    assert result.points[0] == pytest.approx((x, 0.0), abs=1e-14)
    assert result.method == "aspect-ratio"


@pytest.mark.nojit
def test_ratios_within_the_threshold_rest():
    mesh = Mesh([(0.1, 0.0), *RIM], DIAMOND)
    result = smooth(mesh, "aspect-ratio", max_edge_ratio=1.5)
    assert result.points.tobytes() == mesh.points.tobytes()
    assert result.converged


def agree(mesh, xy, expected):
    size = np.ptp(mesh.xy, axis=0).max()
    np.testing.assert_allclose(xy, [(z.real, z.imag) for z in expected], rtol=0, atol=1e-9 * size)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["triangle fan", "mixed fan"])
@pytest.mark.parametrize("valence", [3, 4, 5, 6, 9])
def test_one_vertex_agrees_with_the_reference(kind, valence):
    mesh = random_mesh(kind, valence - 1, seed=valence, amount=1.0).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    good = max(0.5, min(reference.scaled_jacobian(points, cell) for cell in cells))
    options = reference.Options(good=good)
    expected = reference_triangles.aspect_ratio_sweep(points, cells, [0], 1.1, 0.5, options)
    result = smooth(mesh, "aspect-ratio", max_edge_ratio=1.1, step=0.5, max_sweeps=1)
    agree(mesh, result.mesh.xy, expected)


@pytest.mark.parametrize("guard", ["quality", "clearance"])
@pytest.mark.parametrize("kind", ["triangles", "mixed"])
def test_whole_meshes_agree_with_the_reference(kind, guard):
    mesh = random_mesh(kind, 6, seed=5, amount=0.9, turned=0.5).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    good = max(0.5, min(reference.scaled_jacobian(points, cell) for cell in cells))
    options = reference.Options(good=good if guard == "quality" else None)
    for n in (1, 2):
        points = reference_triangles.aspect_ratio_sweep(points, cells, order, 1.2, 0.2, options)
        result = smooth(mesh, "aspect-ratio", max_sweeps=n, rtol=0.0, guard=guard)
        agree(mesh, result.mesh.xy, points)


@pytest.mark.parametrize("step", [0.2, 1.0])
@pytest.mark.parametrize("seed", range(6))
def test_no_triangle_turns_over_and_the_largest_ratio_never_rises(seed, step):
    from qsmooth.examples import random_triangles

    mesh = random_triangles(200, seed=seed)
    largest = quality(mesh).aspect_ratio.max()
    for guard in ("quality", "clearance"):
        at = mesh
        for _ in range(5):
            result = smooth(at, "aspect-ratio", max_sweeps=1, step=step, guard=guard)
            assert result.after.n_invalid == 0
            now = result.after.worst["aspect_ratio"]
            assert now <= max(1.2, quality(at).aspect_ratio.max()) * (1.0 + 1e-12)
            at = result.mesh
        assert now <= largest
        assert at.points.tobytes() != mesh.points.tobytes()


@pytest.mark.nojit
def test_quads_alone_are_refused_in_one_line():
    with pytest.raises(ValueError, match="there is none; split_quads='shorter' cuts") as e:
        smooth(([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)]), "aspect-ratio")
    assert "\n" not in str(e.value)
