import numpy as np
import pytest

from qsmooth import Mesh, quality
from qsmooth.examples import DEMO_FILE, demo_mesh, spiral

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize("n_quads", [200, 1000, 1900, 6000])
@pytest.mark.parametrize("seed", [0, 1])
def test_spiral_is_one_band_of_valid_quads(n_quads, seed):
    mesh = Mesh(*spiral(n_quads, seed=seed))
    assert mesh.n_cells == pytest.approx(n_quads, rel=0.05)
    assert quality(mesh).n_invalid == 0
    assert mesh.topology.n_parts == 1
    # A disc: vertices - edges + cells = 1.
    n_edges = mesh.ring_vertices.size // 2
    assert mesh.n_vertices - n_edges + mesh.n_cells == 1


def test_spiral_is_as_bad_as_the_papers():
    measured = quality(spiral())
    assert 14.0 <= measured.min_angle.min() <= 21.0
    assert 179.5 <= measured.max_angle.max() < 180.0
    assert 55.0 <= measured.aspect_ratio.max() <= 65.0
    assert 2.6 <= measured.aspect_ratio.mean() <= 2.8


def test_spiral_narrows_towards_its_centre():
    points, quads = spiral(jitter=0.0)
    area = quality((points, quads)).area
    distance = np.hypot(*points[quads].mean(axis=1).T)
    inner, outer = np.argsort(distance)[:200], np.argsort(distance)[-200:]
    assert area[inner].mean() < 0.1 * area[outer].mean()


def test_spiral_depends_on_the_seed_alone():
    one, again, other = spiral(seed=3), spiral(seed=3), spiral(seed=4)
    assert np.array_equal(one[0], again[0])
    assert np.array_equal(one[1], again[1])
    assert not np.array_equal(one[0], other[0])


def test_spiral_moves_no_boundary_vertex():
    points, quads = spiral(jitter=0.0)
    moved, _ = spiral(jitter=0.5)
    boundary = Mesh(points, quads).is_boundary
    assert np.array_equal(points[boundary], moved[boundary])
    assert (points[~boundary] != moved[~boundary]).any(axis=1).all()


@pytest.mark.parametrize(
    "options", [{"n_quads": 199}, {"jitter": -0.1}, {"jitter": np.nan}, {"jitter": np.inf}]
)
def test_spiral_refuses(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        spiral(**options)


def test_demo_mesh_is_the_spiral_rounded():
    mesh = demo_mesh()
    points, quads = spiral()
    assert np.array_equal(mesh.cells[0], quads)
    # NumPy may change the stream of its generators; the packaged file is what counts.
    assert mesh.points[:, :2] == pytest.approx(points, abs=0.51e-5)
    assert quality(mesh).n_invalid == 0
    assert DEMO_FILE.stat().st_size < 100_000
