"""Angle-based smoothing and the centroid of the star polygon: by hand and against the reference."""

import math

import numpy as np
import pytest

import reference
import reference_triangles
from meshes import KINDS, grid, random_mesh
from qsmooth import Mesh, smooth
from qsmooth.kernels.angle import onto_bisector, star_polygons
from qsmooth.kernels.blocks import FIRST, N_QUADS, N_TRIANGLES, ROWS, SIZE, STAR, build_blocks

DIAMOND = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1)]
RIM = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]


def four_squares(centre):
    points, cells = grid(2, 2)
    points[4] = centre
    return Mesh(points, cells)


@pytest.mark.nojit
def test_the_bisector_of_an_angle_of_any_size():
    for degrees in (10, 90, 179, 180, 181, 270, 350):
        end = math.radians(degrees)
        x, y, found = onto_bisector(0.3, 0.4, 2.0, 0.0, 3 * math.cos(end), 3 * math.sin(end))
        assert found
        assert (x, y) == pytest.approx((0.5 * math.cos(end / 2), 0.5 * math.sin(end / 2)))


@pytest.mark.nojit
@pytest.mark.parametrize("zero", [0, 1, 2])
def test_no_bisector_without_a_length(zero):
    pairs = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)]
    pairs[zero] = (0.0, 0.0)
    assert onto_bisector(*pairs[0], *pairs[1], *pairs[2]) == (0.0, 0.0, False)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_polygons_are_those_of_the_reference(kind):
    mesh = random_mesh(kind, 5, seed=8, amount=0.9, turned=0.5).mesh
    blocks, cells = build_blocks(mesh.topology.schedule(True)), reference.as_lists(mesh)
    before = star_polygons(blocks)
    for block in blocks.table.astype(int):
        for lane in range(block[SIZE]):
            v = int(blocks.vertices[block[FIRST] + lane])
            _, expected = reference_triangles.outline(v, cells)
            found = {}
            for k in range(block[N_QUADS] + block[N_TRIANGLES]):
                corner = 3 * k if k < block[N_QUADS] else block[N_QUADS] + 2 * k
                pivot = int(blocks.stars[block[STAR] + corner * block[SIZE] + lane])
                found[pivot] = int(before[block[ROWS] + k * block[SIZE] + lane])
            assert found == {pivot: expected[pivot] for pivot in found}
            assert len(found) == block[N_QUADS] + block[N_TRIANGLES]


@pytest.mark.nojit
@pytest.mark.parametrize("guard", ["none", "quality", "clearance"])
@pytest.mark.parametrize("d", [0.5, -0.2])
def test_one_vertex_in_four_triangles(d, guard):
    # Left and right it is on its bisectors and stays; from above and below it comes to x = 0, and
    # what these two do to y cancels.
    result = smooth(Mesh([(d, 0.0), *RIM], DIAMOND), "angle", max_sweeps=1, guard=guard)
    assert result.points[0] == pytest.approx((0.5 * d, 0.0), abs=1e-15)


@pytest.mark.nojit
@pytest.mark.parametrize("guard", ["none", "quality"])
def test_one_vertex_in_four_quads_turns_about_its_neighbours_only(guard):
    result = smooth(four_squares((1.3, 1.0)), "angle", max_sweeps=1, guard=guard)
    assert result.points[4] == pytest.approx((1.15, 1.0), abs=1e-15)


@pytest.mark.nojit
def test_one_vertex_at_the_centroid_of_its_star():
    # Whatever the vertex's place, that of the square is its centre.
    result = smooth(four_squares((1.4, 0.7)), "laplacian", max_sweeps=1, weights="area")
    assert result.points[4] == pytest.approx((1.0, 1.0), abs=1e-15)
    # An isosceles triangle cut from inside: a third of its height, where the mean is too.
    points = [(0.1, 0.3), (-1.0, 0.0), (1.0, 0.0), (0.0, 3.0)]
    mesh = Mesh(points, [(0, 1, 2), (0, 2, 3), (0, 3, 1)])
    assert smooth(mesh, "laplacian", max_sweeps=1, weights="area").points[0] == pytest.approx(
        (0.0, 1.0), abs=1e-15
    )
    # A square with one more vertex on its rim: the mean moves, the centroid does not.
    points = [(0.4, 0.5), (0.0, 0.0), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0), (0.0, 1.0)]
    mesh = Mesh(points, [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5), (0, 5, 1)])
    for method in ("laplacian", "smart-laplacian"):
        uniform = smooth(mesh, method, max_sweeps=1).points[0]
        assert uniform == pytest.approx((0.6, 0.5), abs=1e-15)
        area = smooth(mesh, method, max_sweeps=1, weights="area").points[0]
        assert area == pytest.approx((0.5, 0.5), abs=1e-15)


REFERENCES = {
    ("angle", "none"): lambda p, c, o, s: reference_triangles.angle_sweep(p, c, o),
    ("angle", "quality"): lambda p, c, o, s: reference_triangles.guarded_angle_sweep(
        p, c, o, 1.0, s
    ),
    ("laplacian", "quality"): lambda p, c, o, s: reference_triangles.centroid_sweep(p, c, o),
    ("smart-laplacian", "quality"): reference_triangles.smart_centroid_sweep,
}


@pytest.mark.parametrize(("method", "guard"), REFERENCES)
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_whole_meshes_agree_with_the_reference(kind, method, guard):
    mesh = random_mesh(kind, 5, seed=8, amount=0.9, turned=0.5).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    good = max(0.5, min(reference.scaled_jacobian(points, cell) for cell in cells))
    options = {} if method == "angle" else {"weights": "area"}
    if guard != "quality":
        options["guard"] = guard
    for n in (1, 2):
        points = REFERENCES[method, guard](points, cells, order, reference.Options(good=good))
        result = smooth(mesh, method, max_sweeps=n, rtol=0.0, **options)
        size = np.ptp(mesh.xy, axis=0).max()
        expected = [(z.real, z.imag) for z in points]
        np.testing.assert_allclose(result.mesh.xy, expected, rtol=0, atol=1e-9 * size)


@pytest.mark.nojit
def test_the_step_is_a_share_of_the_way():
    result = smooth(Mesh([(0.4, 0.0), *RIM], DIAMOND), "angle", max_sweeps=1, step=0.5)
    assert result.points[0] == pytest.approx((0.3, 0.0), abs=1e-15)


def test_unguarded_it_says_what_it_broke_and_guarded_nothing_breaks():
    from qsmooth.examples import random_triangles

    mesh = random_triangles(400, seed=1)
    free = smooth(mesh, "angle", guard="none")
    assert free.after.n_invalid > 0
    assert f"angle is unguarded: it made {free.after.n_invalid} cell" in free.reason
    for guard in ("quality", "clearance"):
        assert all(r.n_invalid == 0 for r in smooth(mesh, "angle", guard=guard).history)


@pytest.mark.nojit
@pytest.mark.parametrize("method", ["star", "quad", "smart-laplacian", "aspect-ratio"])
def test_other_methods_can_not_go_unguarded(method):
    mesh = Mesh([(0.4, 0.0), *RIM], DIAMOND)
    with pytest.raises(ValueError, match="guard must be 'quality' or 'clearance', got 'none'"):
        smooth(mesh, method, guard="none")
    with pytest.raises(ValueError, match="guard must be 'quality', 'clearance' or 'none', got 'no"):
        smooth(mesh, "angle", guard="no")


def test_on_quads_waves_grow_and_on_quads_that_are_cut_they_do_not():
    # By hand: of the waves (1, ±1) cos k(x + y) one is multiplied by ½ + ½ cos k + ½ sin² k.
    n = 36
    mesh = Mesh(*grid(n, n))
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    wave = np.cos(math.pi / 3.0 * (x + y))
    height = 1e-6 * wave
    height[mesh.is_boundary] = 0.0
    inner = (np.abs(x - n / 2) < 6) & (np.abs(y - n / 2) < 6)

    def growth(sign, **options):
        start = mesh.with_points(mesh.points + np.stack([height, sign * height], axis=1))
        end = smooth(start, "angle", guard="none", max_sweeps=1, **options)
        before = (start.points - mesh.points)[inner]
        after = (end.points - mesh.points)[inner]
        return float((before * after).sum() / (before * before).sum())

    assert max(growth(1.0), growth(-1.0)) == pytest.approx(1.125, abs=1e-4)
    assert max(growth(s, split_quads="first") for s in (1.0, -1.0)) < 1.0
