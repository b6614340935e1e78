"""Layers and sizes that are meant are kept, and nothing is kept that is only noise."""

import numpy as np
import pytest

from qsmooth import examples, quality, read_mesh, smooth
from reference_targets import first_heights, ring, shaken

# The least and largest height of first layers that may be where the mesh was shaken by .35, as
# multiples of those of the mesh before that, and the share of the sides that are within 10 % of it.
LAYERS = {
    "boundary_layer()": (0.9, 1.1, 1.0),
    "wall_channel_two_zones.su2": (0.9, 1.1, 1.0),
    "centrifugal_blade_mixed.su2": (0.9, 1.1, 1.0),
    # One column beside the trailing edge, which meets triangles; 8 sides at the nose.
    "rae2822_mixed.su2": (0.9, 1.3, 0.98),
    "naca0012_113x33.su2": (0.9, 1.2, 0.8),
}


def get(name, request):
    if name == "boundary_layer()":
        return examples.boundary_layer()
    return read_mesh(request.getfixturevalue("shared_meshes") / name)


def kept(mesh, amount):
    """Heights of first layers after, as multiples of those before the mesh was shaken."""
    before, slim = first_heights(mesh, mesh.xy)
    after, _ = first_heights(mesh, smooth(shaken(mesh, amount)).mesh.xy)
    return (after / before)[slim]


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("amount", [0.0, 1e-7])
def test_first_layers_keep_their_heights(name, amount, request):
    heights = kept(get(name, request), amount)
    assert np.median(heights) == pytest.approx(1.0, abs=0.02)
    assert heights == pytest.approx(np.ones(heights.size), abs=0.05)


@pytest.mark.parametrize("name", LAYERS)
def test_first_layers_of_a_shaken_mesh_get_back_the_heights_they_had(name, request):
    heights = kept(get(name, request), 0.35)
    least, most, share = LAYERS[name]
    assert least <= heights.min()
    assert heights.max() <= most
    assert (np.abs(heights - 1.0) <= 0.1).mean() >= share
    assert np.median(heights) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    "make",
    [
        lambda: examples.boundary_layer(kind="mixed"),
        ring,
        lambda: ring(kind="triangle"),
    ],
    ids=["mixed", "ring", "ring of triangles"],
)
def test_layers_of_any_cells_keep_their_heights(make):
    assert np.abs(kept(make(), 0.0) - 1.0).max() < 0.05


def test_sizes_of_an_adapted_mesh_are_kept_to_its_last_digits(shared_meshes):
    mesh = read_mesh(shared_meshes / "tri_adapt.su2")
    found = []
    for amount in (0.0, 1e-7):
        after = quality(smooth(shaken(mesh, amount)).mesh)
        areas = np.percentile(after.area / quality(mesh).area, (1, 50, 99))
        found.append([after["min_angle"].min(), after.shape.mean(), *areas])
    angle, shape, least, median, most = found[0]
    assert angle > 23.0
    assert shape >= 0.925
    assert median == pytest.approx(0.94, abs=0.02)
    assert least > 0.6
    assert most < 1.7
    assert found[1] == pytest.approx(found[0], rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_distorted_squares_end_as_with_squares_for_a_target(seed):
    mesh = examples.distorted(24, seed)
    auto, ideal = smooth(mesh), smooth(mesh, target="ideal")
    assert np.array_equal(auto.points, ideal.points)


@pytest.mark.parametrize("seed", range(2))
def test_what_untangling_leaves_is_no_layer(seed):
    # And with squares the mean is so good that no ratios have to be tried.
    mesh = examples.random_interior(100, 100, seed=seed)
    auto, ideal = smooth(mesh), smooth(mesh, target="ideal")
    assert np.array_equal(auto.points, ideal.points)
    assert auto.sweeps == ideal.sweeps
    assert auto.after.worst["min_angle"] > 89.0


@pytest.mark.parametrize("name", ["spiral_2k.off", "sfepy_tri932.mesh", "mesquite_unstrquad.vtk"])
@pytest.mark.filterwarnings("ignore:.*CELLS says")
def test_isotropic_meshes_end_as_with_ideal_cells_for_a_target(name, shared_meshes):
    mesh = read_mesh(shared_meshes / name)
    assert np.array_equal(smooth(mesh).points, smooth(mesh, target="ideal").points)
