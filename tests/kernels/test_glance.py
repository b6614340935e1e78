"""What is asked after every sweep: the same as of all cells, in lanes and on threads."""

import math

import numpy as np
import pytest

import reference
from meshes import KINDS, grid, random_mesh
from qsmooth import Mesh, Quality
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.cell_lanes import CELLS_A_CHUNK
from qsmooth.sums import exact_mean


def glance(mesh, xy=None):
    seen = Quality(mesh.topology, mesh.xy if xy is None else xy)
    return seen.extreme_angles, seen.mean_shape, seen.n_invalid


@pytest.mark.nojit
@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("amount", [0.3, 1.0, 3.0])
def test_a_glance_sees_what_all_cells_are(kind, amount):
    mesh = random_mesh(kind, 7, seed=8, amount=amount).mesh
    (smallest, largest), shape, n_invalid = glance(mesh)
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    angles = [reference.angles(points, cell) for cell in cells]
    assert smallest == pytest.approx(min(map(min, angles)), abs=1e-9)
    assert largest == pytest.approx(max(map(max, angles)), abs=1e-9)
    assert shape == pytest.approx(np.mean([reference.shape(points, cell) for cell in cells]))
    assert n_invalid == sum(reference.validity(points, cell) != 0 for cell in cells)


@pytest.mark.parametrize("n", [1, 8, 9, 40])
def test_blocks_and_chunks_are_filled_to_any_extent_in_any_order(n):
    points, (quads,) = grid(n, n)
    mesh = Mesh(points + 0.05 * np.random.default_rng(0).random(points.shape), quads)
    # Every other quad cut in two where it is in the list.
    cells = [[quad] if k % 2 else [quad[:3], quad[[0, 2, 3]]] for k, quad in enumerate(quads)]
    mixed = Mesh(mesh.points, [np.array(block) for block in cells])
    assert n < 40 or mesh.n_cells > CELLS_A_CHUNK
    for each in (mesh, mixed):
        own = Quality(each.topology, each.xy)
        (smallest, largest), shape, _ = glance(each)
        assert (smallest, largest) == (own.min_angle.min(), own.max_angle.max())
        assert shape == exact_mean(own.shape)
        points, cells = reference.as_complex(each.xy), reference.as_lists(each)
        for c in {0, each.n_cells // 3, each.n_cells - 1}:
            assert own.shape[c] == pytest.approx(reference.shape(points, cells[c]))
            assert own.area[c] == pytest.approx(reference.area(points, cells[c]))


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_threads_change_no_bit(kind):
    mesh = random_mesh(kind, 40, seed=3, amount=1.0).mesh
    found = []
    for threads in (1, 2):
        with use_threads(threads):
            own = Quality(mesh.topology, mesh.xy)
            found.append([glance(mesh), own.min_angle.tobytes(), own.scaled_jacobian.tobytes()])
    assert found[0] == found[1]


@pytest.mark.nojit
def test_a_lost_coordinate_shows():
    mesh = Mesh(*grid(3, 3))
    xy = mesh.xy.copy()
    xy[5, 1] = math.nan
    (smallest, largest), shape, n_invalid = glance(mesh, xy)
    assert math.isnan(smallest)
    assert math.isnan(largest)
    assert math.isnan(shape)
    assert n_invalid
