"""What a mesh is found to be meant to be."""

import math

import numpy as np
import pytest

from qsmooth import Mesh, examples, quality, read_mesh, untangle
from qsmooth.kernels._jit import use_threads
from qsmooth.targets import EQUILATERAL, candidates, ideal, initial, learned
from reference_targets import auto, energies, layer, ring, shaken, unit

ISOTROPIC = {
    "squares": lambda: examples.structured(8, 8),
    "moved squares": lambda: examples.jittered(12, 12, amount=0.3),
    "cut squares": lambda: examples.jittered(12, 12, kind="triangle", amount=0.3),
    "both": lambda: examples.jittered(12, 12, kind="mixed", amount=0.3),
    "random triangles": lambda: examples.random_triangles(400),
    "spiral": examples.spiral,
    "one quad": lambda: Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)]),
    "one triangle": lambda: Mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)]),
}


@pytest.mark.parametrize("make", ISOTROPIC.values(), ids=ISOTROPIC.keys())
def test_isotropic_meshes_are_to_be_ideal(make):
    mesh = make()
    squares, ratios = candidates(mesh.topology, mesh.xy)
    plain = ideal(mesh.topology)
    assert squares is ratios
    assert squares.kind == "ideal"
    assert np.array_equal(squares.corners, plain.corners)
    assert not squares.size_weight.any()
    assert not squares.is_layer.any()


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_rectangles_of_a_layer_are_to_stay_as_they_are(kind):
    mesh = layer(kind=kind)
    targets = auto(mesh)
    f, tau = energies(mesh, targets)
    assert targets.is_layer.all()
    assert targets.size_weight == pytest.approx(np.ones(mesh.n_cells))
    assert unit(targets) == pytest.approx(np.ones(f.size))
    assert f == pytest.approx(np.ones(f.size), rel=1e-9)
    assert tau == pytest.approx(np.ones(f.size), rel=1e-9)


def test_two_rows_of_slim_quads_are_no_layer():
    assert auto(layer(ny=3)).is_layer.all()
    assert not auto(layer(ny=2)).is_layer.any()


def test_a_layer_over_a_wavy_wall_is_to_have_right_angles_and_keep_its_heights():
    mesh = examples.boundary_layer()
    targets = auto(mesh)
    _, tau = energies(mesh, targets)
    assert targets.is_layer.all()
    thin = targets.size_weight > 0.99
    means = tau.reshape(-1, 4).mean(axis=1)[thin]
    assert means == pytest.approx(np.ones(means.size), rel=0.005)
    # Rectangles: the coefficients have no mixed term, so f falls as angles become right.
    assert not targets.corners[:, 1].any()


def test_of_a_shaken_layer_the_noise_is_taken_away():
    mesh = layer(nx=60, ny=24)
    noisy = shaken(mesh, 0.35)
    assert not np.allclose(noisy.xy, mesh.xy)
    areas = auto(noisy).area / auto(mesh).area
    own = initial(noisy.topology, noisy.xy).area / auto(mesh).area
    assert auto(noisy).is_layer.all()
    assert np.std(np.log(areas)) < 0.25 * np.std(np.log(own))
    assert np.abs(np.log(areas)).max() < 0.2
    assert np.median(areas) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_heights_of_a_shaken_ring_are_those_of_the_ring(seed):
    mesh = ring(96)
    noisy = shaken(mesh, 0.35, seed)
    off = np.log(auto(noisy).area / auto(mesh).area)
    assert auto(noisy).is_layer.all()
    assert np.abs(off).max() < 0.15
    assert np.std(off) < 0.05
    assert abs(np.median(off)) < 0.03


def test_triangles_of_layers_round_a_bend_are_found():
    mesh = ring(kind="triangle")
    targets = auto(mesh)
    # Where it is stretched at all; out there it is 5 times as long as high.
    assert targets.is_layer.mean() > 0.8
    f, tau = energies(mesh, targets)
    of_layer = targets.is_layer[mesh.topology.corner_cells]
    assert np.median(f[of_layer]) < 1.01
    assert tau[of_layer] == pytest.approx(np.ones(of_layer.sum()), rel=0.1)


def test_layers_and_what_is_around_them_are_told_apart():
    """Slim quads below, and on top of them triangles of any shape but no meaning."""
    below = layer(nx=40, ny=6, first=0.01)
    height = below.points[:, 1].max()
    above = examples.jittered(40, 20, kind="triangle", amount=0.3)
    points = above.points * [40.0, 20.0] + [0.0, height]
    n = len(below.points)
    numbers = n - 41 + np.arange(len(points))  # the last row of the one is the first of the other
    mesh = Mesh(
        np.concatenate([below.points, points[41:]]), [below.cells[0], numbers[above.cells[0]]]
    )
    targets = auto(mesh)
    quads = mesh.topology.cell_sizes == 4
    assert targets.is_layer[quads].all()
    assert not targets.is_layer[~quads].any()
    corners = targets.corners[mesh.topology.cell_sizes[mesh.topology.corner_cells] == 3]
    assert corners == pytest.approx(np.tile(EQUILATERAL, (len(corners), 1)))


@pytest.mark.parametrize("seed", range(3))
def test_distortion_is_no_layer(seed):
    mesh = examples.distorted(64, seed)
    squares, _ = candidates(mesh.topology, mesh.xy)
    assert (quality(mesh).max_angle > 160).mean() > 0.24
    assert squares.kind == "ideal"


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_layers_are_those_that_were_there_before_untangling(kind):
    mended = layer(kind=kind)
    places = np.random.default_rng(0).permutation(np.flatnonzero(~mended.is_fixed))
    xy = mended.xy.copy()
    xy[~mended.is_fixed] = mended.xy[places]
    assert candidates(mended.topology, mended.xy)[0].is_layer.any()
    squares, _ = candidates(mended.topology, xy, mended.xy)
    assert not squares.is_layer.any()


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
@pytest.mark.parametrize("looks_like", ["layers", "a grading"])
def test_what_untangling_takes_away_is_not_meant(kind, looks_like):
    mended = examples.structured(24, 24, kind=kind)
    x, y = mended.points.T
    xy = np.exp(2.0 * mended.points)
    if looks_like == "layers":
        xy = np.stack([x, 1e-3 * np.expm1(5.0 * y)], axis=1)
    assert candidates(mended.topology, xy)[0].size_weight.any()
    squares, ratios = candidates(mended.topology, xy, mended.xy)
    assert squares is ratios
    assert squares.kind == "ideal"
    assert not squares.is_layer.any()
    assert not squares.size_weight.any()
    assert np.array_equal(squares.corners, ideal(mended.topology).corners)


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_the_sizes_that_untangling_leaves_are_not_meant(kind):
    mesh = examples.random_interior(20, 20, kind=kind)
    squares, _ = candidates(mesh.topology, mesh.xy, untangle(mesh).mesh.xy)
    assert squares.kind == "ideal"
    assert not squares.size_weight.any()


@pytest.mark.parametrize("seed", range(1, 4))
def test_slivers_at_a_border_are_not_meant(seed):
    # Among so many triangles some lie side by side that are stretched alike.
    mesh = examples.random_triangles(6000, seed=seed)
    squares, _ = candidates(mesh.topology, mesh.xy)
    assert squares.kind == "ideal"
    assert not squares.size_weight.any()


def test_ratios_are_those_of_the_mended_mesh():
    mended = examples.notch()
    xy = np.random.default_rng(0).permutation(mended.xy)
    _, ratios = candidates(mended.topology, xy, mended.xy)
    assert np.array_equal(ratios.corners, candidates(mended.topology, mended.xy)[1].corners)


def test_ratios_are_learned_where_nothing_is_a_layer():
    mesh = examples.notch()
    squares, ratios = candidates(mesh.topology, mesh.xy)
    assert squares.kind == "ideal"
    assert ratios.kind == "ratios"
    assert not ratios.size_weight.any()
    # Above the tip columns are squeezed to three tenths of their height: wide quads are meant.
    slim = np.abs(np.log(ratios.corners[:, 0])).max()
    assert math.log(3.0) < slim < math.log(12.0)


@pytest.mark.parametrize("n", [20, 120])
def test_ratios_of_hardly_a_cell_are_none(n):
    notch, beside = examples.notch(20), examples.structured(n, n)
    squares, ratios = candidates(notch.topology, notch.xy)
    n_stretched = int((ratios.corners != squares.corners)[::4].any(axis=1).sum())
    share = n_stretched / (notch.n_cells + beside.n_cells)
    assert (share < 0.01) is (n == 120)
    mesh = Mesh(
        np.concatenate([notch.points, beside.points + np.array([10.0, 0.0])]),
        np.concatenate([notch.cells[0], beside.cells[0] + notch.n_vertices]),
    )
    squares, ratios = candidates(mesh.topology, mesh.xy)
    assert (squares is ratios) is (share < 0.01)


def test_stretched_triangles_keep_their_shape_though_they_are_no_halves_of_quads():
    lattice = examples.structured(20, 20, kind="triangle")
    sheared = lattice.points @ np.array([[30.0, 0.0], [15.0, 1.0]])
    mesh = Mesh(sheared, lattice.cells)
    targets = auto(mesh)
    f, _ = energies(mesh, targets)
    assert f == pytest.approx(np.ones(f.size), rel=1e-6)


def test_graded_triangles_are_to_keep_their_areas_and_equal_ones_need_not():
    equal = examples.jittered(24, 24, kind="triangle", amount=0.1)
    graded = Mesh(np.exp(2.0 * equal.points), equal.cells)
    targets = auto(graded)
    assert not auto(equal).size_weight.any()
    assert targets.size_weight.mean() > 0.95
    _, tau = energies(graded, targets)
    assert np.median(tau) == pytest.approx(1.0, abs=0.02)


def test_invalid_cells_and_edges_of_no_length_are_no_trouble():
    for mesh in (
        examples.tangled(12, 12, kind="mixed"),
        Mesh([(0, 0), (0, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)]),
        Mesh([(0, 0), (1, 0), (2, 0), (0, 1)], [(0, 1, 2), (0, 2, 3)]),
        *(
            examples.structured(3, 3, kind=kind).with_points(np.outer(np.arange(16.0), line))
            for kind in ("quad", "triangle", "mixed")
            for line in ((0.0, 0.0), (0.0, 1.0), (1.0, 3.0))  # all at one place, or on a line
        ),
    ):
        for targets in (auto(mesh), initial(mesh.topology, mesh.xy)):
            assert np.isfinite(targets.corners).all()
            assert np.isfinite(targets.size_weight).all()
            assert np.isfinite(targets.area[targets.size_weight > 0]).all()


# ------------------------------------------------------------------------ properties of any mesh

ANY = {
    "layer": lambda: shaken(examples.boundary_layer(30, 16), 0.2),
    "layer of triangles": lambda: shaken(layer(20, 8, kind="triangle"), 0.02),
    "notch": examples.notch,
    "graded triangles": lambda: Mesh(
        np.exp(2.0 * examples.jittered(16, 16, kind="triangle", amount=0.2).points),
        examples.structured(16, 16, kind="triangle").cells,
    ),
    "mixed layer": lambda: examples.boundary_layer(20, 12, kind="mixed"),
    "ring": lambda: shaken(ring(), 0.2),
    "ring of triangles": lambda: ring(kind="triangle"),
}
ODD = {
    "flat quad": lambda: Mesh([(0, 0), (9, 0), (9, 0.1), (0, 0.1)], [(0, 1, 2, 3)]),
    "flat triangle": lambda: Mesh([(0, 0), (9, 0), (9, 0.1)], [(0, 1, 2)]),
    "strip": lambda: layer(nx=30, ny=1),
    "tower": lambda: layer(nx=1, ny=30),
    "strip of triangles": lambda: layer(nx=30, ny=1, kind="triangle"),
    # One quad beside two of half its height.
    "hanging node": lambda: Mesh(
        [(0, 0), (9, 0), (18, 0), (0, 1), (9, 0.5), (18, 0.5), (9, 1), (18, 1)],
        [(0, 1, 6, 3), (1, 2, 5, 4), (4, 5, 7, 6)],
    ),
}


@pytest.mark.parametrize("make", (ANY | ODD).values(), ids=(ANY | ODD).keys())
def test_a_power_of_two_times_the_mesh_is_learned_to_the_bit(make):
    mesh = make()
    before = auto(mesh)
    assert np.isfinite(before.corners).all()
    assert np.isfinite(before.area[before.size_weight > 0]).all()
    for power in (-30, 17):
        after = learned(mesh.topology, mesh.xy * 2.0**power)
        assert np.array_equal(after.corners, before.corners)
        assert np.array_equal(after.size_weight, before.size_weight)
        assert np.array_equal(after.area, before.area * 4.0**power, equal_nan=True)


@pytest.mark.parametrize("make", ANY.values(), ids=ANY.keys())
def test_turning_and_scaling_changes_areas_alone(make):
    mesh = make()
    turn = np.array([[0.28, 0.96], [-0.96, 0.28]])
    moved = Mesh(mesh.xy @ turn * 50.0 + [3.0, -2.0], mesh.cells)
    before, after = auto(mesh), auto(moved)
    assert after.corners == pytest.approx(before.corners, rel=1e-5, abs=1e-5)
    assert after.size_weight == pytest.approx(before.size_weight, abs=1e-5)
    assert after.area == pytest.approx(2500.0 * before.area, rel=1e-5, nan_ok=True)


@pytest.mark.parametrize("make", ANY.values(), ids=ANY.keys())
def test_other_numbers_give_the_same_targets(make):
    mesh = make()
    rng = np.random.default_rng(1)
    vertices = rng.permutation(mesh.n_vertices)
    blocks = [vertices[block] for block in mesh.cells]
    orders = [rng.permutation(len(block)) for block in blocks]
    points = np.empty_like(mesh.points)
    points[vertices] = mesh.points
    other = Mesh(points, [block[order] for block, order in zip(blocks, orders, strict=True)])
    starts = np.cumsum([0, *map(len, blocks[:-1])])
    cells = np.concatenate([start + order for start, order in zip(starts, orders, strict=True)])
    before, after = auto(mesh), auto(other)
    assert after.size_weight == pytest.approx(before.size_weight[cells], abs=1e-6)
    assert after.area == pytest.approx(before.area[cells], rel=1e-6, nan_ok=True)
    f, g = energies(mesh, before)[0], energies(other, after)[0]
    assert np.sort(g) == pytest.approx(np.sort(f), rel=1e-6)


@pytest.mark.parametrize("make", ANY.values(), ids=ANY.keys())
def test_nothing_hangs_on_the_last_digits(make):
    mesh = make()
    before, after = auto(mesh), auto(shaken(mesh, 1e-7))
    assert after.corners == pytest.approx(before.corners, rel=1e-4, abs=1e-4)
    assert after.size_weight == pytest.approx(before.size_weight, abs=1e-4)
    assert after.area == pytest.approx(before.area, rel=1e-4, nan_ok=True)


@pytest.mark.parametrize("make", ANY.values(), ids=ANY.keys())
def test_two_threads_learn_the_bits_of_one(make):
    mesh, found = make(), []
    for threads in (1, 2):
        with use_threads(threads):
            found.append([a.tobytes() for a in auto(mesh)[:4]])
    assert found[0] == found[1]


# -------------------------------------------------------------------------------- real meshes

# Share of the cells that are of a layer, from and to.
LAYERED = {
    "naca0012_113x33.su2": (0.9, 1.0),
    "rae2822_mixed.su2": (0.17, 0.21),
    "centrifugal_blade_mixed.su2": (0.53, 0.57),
    "wall_channel_two_zones.su2": (0.6, 0.8),
    "mesquite_hole_scheme.vtk": (1.0, 1.0),
}
UNLAYERED = [
    "spiral_2k.off", "hughes_qt_cpe4.inp", "dealii_two_holes.msh", "mesquite_shest_grid32.vtk",
    "mesquite_overture_mixed.vtk", "cantilever_crlf.su2", "tri_adapt.su2", "sfepy_tri932.mesh",
]  # fmt: skip


@pytest.mark.parametrize("name", LAYERED)
def test_layers_of_real_meshes_are_found_and_nothing_hangs_on_their_last_digits(
    shared_meshes, name
):
    mesh = read_mesh(shared_meshes / name)
    targets = auto(mesh)
    low, high = LAYERED[name]
    assert low <= targets.is_layer.mean() <= high
    own = np.log(initial(mesh.topology, mesh.xy).area)
    left = np.exp(np.log(targets.area) - own)[targets.is_layer]
    assert np.median(left) == pytest.approx(1.0, abs=0.005)
    again = auto(shaken(mesh, 1e-7))
    assert again.corners == pytest.approx(targets.corners, rel=1e-3, abs=1e-3)
    assert again.size_weight == pytest.approx(targets.size_weight, abs=1e-3)
    assert again.area == pytest.approx(targets.area, rel=1e-3, nan_ok=True)
    # Shaken by more than it can bear, it has the same layers, and nearly the same sizes.
    noisy = auto(shaken(mesh, 0.35))
    assert low - 0.05 <= noisy.is_layer.mean() <= high + 0.05
    both = noisy.is_layer & targets.is_layer & (mesh.topology.cell_sizes == 4)
    areas = noisy.area[both] / targets.area[both]
    assert np.median(areas) == pytest.approx(1.0, abs=0.02)
    assert np.std(np.log(areas)) < 0.1


@pytest.mark.parametrize("name", UNLAYERED)
def test_meshes_without_layers_have_none(shared_meshes, name):
    assert not auto(read_mesh(shared_meshes / name)).is_layer.any()


def test_sizes_of_an_adapted_mesh_are_meant(shared_meshes):
    mesh = read_mesh(shared_meshes / "tri_adapt.su2")
    targets = auto(mesh)
    assert targets.size_weight.mean() > 0.95
    own = initial(mesh.topology, mesh.xy).area
    assert np.nanmedian(targets.area / own) == pytest.approx(1.0, abs=0.02)
