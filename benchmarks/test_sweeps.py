"""One sweep of each method's kernels, on quads and triangles, in cache and beyond, by threads."""

import math

import numpy as np
import pytest

from meshes import rough_grid
from qsmooth import Mesh, Quality
from qsmooth.kernels import angle, aspect_ratio, centroid, laplacian, quad, star
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.proposals import thresholds
from qsmooth.kernels.ring_blocks import build_ring_blocks
from qsmooth.kernels.stars import Moves, Rings
from qsmooth.methods.driver import record
from qsmooth.split import split_quads

pytestmark = pytest.mark.benchmark(group="sweeps")
THREADS = [1, 2]
ANGLES = thresholds(120.0, 60.0, 90.0, 45.0)
GOOD = {"quality": 0.5, "clearance": math.nan}


class Case:
    """What the sweeps of a mesh take, with the types that the methods pass."""

    def __init__(self, mesh):
        self.mesh, self.xy = mesh, mesh.xy.copy()
        self.stars = mesh.topology.schedule()
        n_movable = self.stars.vertices.size
        self.moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
        self.rings = Rings(*mesh.topology.rings)
        self.pace = np.ones(mesh.n_cells)
        self.all = 0, self.stars.colour_offsets.size - 1
        self.wanted = np.random.default_rng(0).uniform(-1e-6, 1e-6, (n_movable, 2))


def star_sweep(c, good):
    return star.star_sweep, (c.xy, c.stars, c.all, c.pace, ANGLES, 0.25, good, c.moves)


def quad_proposals(c, good):
    return quad.quad_proposals, (c.xy, c.stars, c.pace, ANGLES, 0.25, c.wanted.copy())


def guarded_commit(c, good):
    return quad.guarded_commit, (c.xy, c.stars, c.all, c.wanted, good, c.moves)


def laplacian_sweep(c, good):
    blocks = build_ring_blocks(np.sort(c.stars.vertices), c.rings)
    return laplacian.laplacian_sweep, (c.mesh.xy, blocks, c.xy, c.moves)


def smart_laplacian_sweep(c, good):
    return laplacian.smart_laplacian_sweep, (c.xy, c.rings, c.stars, c.all, good, c.moves)


def centroid_sweep(c, good):
    return centroid.centroid_sweep, (c.mesh.xy, c.stars, c.xy, c.moves)


def smart_centroid_sweep(c, good):
    return centroid.smart_centroid_sweep, (c.xy, c.stars, c.all, good, c.moves)


def angle_sweep(c, good):
    return angle.angle_sweep, (c.mesh.xy, c.stars, 1.0, c.xy, c.moves)


def guarded_angle_sweep(c, good):
    return angle.guarded_angle_sweep, (c.xy, c.stars, c.all, 1.0, good, c.moves)


def aspect_ratio_sweep(c, good):
    rest = 1.2, 0.2, 4.0, 1.2, good, c.moves
    return aspect_ratio.aspect_ratio_sweep, (c.xy, c.stars, c.all, *rest)


ON_QUADS = [
    star_sweep,
    quad_proposals,
    guarded_commit,
    laplacian_sweep,
    smart_laplacian_sweep,
    centroid_sweep,
    smart_centroid_sweep,
    guarded_angle_sweep,
]
ON_TRIANGLES = [star_sweep, smart_laplacian_sweep, angle_sweep, guarded_angle_sweep]


@pytest.fixture(scope="module", params=["4K", "500K"])
def triangles(request, smoke):
    """Two triangles in place of each quad of the rough grid."""
    return split_quads(Mesh(*rough_grid(45 if request.param == "4K" or smoke else 500)))


def run(benchmark, note, mesh, sweep, threads, guard="quality"):
    """Time one sweep, compiled by an untimed one."""
    case = Case(mesh)
    kernel, arguments = sweep(case, GOOD[guard])
    note(mesh, threads, movable=case.stars.vertices.size)
    with use_threads(threads):
        kernel(*arguments)
        benchmark(kernel, *arguments)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("sweep", ON_QUADS, ids=lambda sweep: sweep.__name__)
def test_on_quads(benchmark, note, mesh, sweep, threads):
    run(benchmark, note, mesh, sweep, threads)


@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("sweep", [*ON_TRIANGLES, aspect_ratio_sweep], ids=lambda s: s.__name__)
def test_on_triangles(benchmark, note, triangles, sweep, threads):
    run(benchmark, note, triangles, sweep, threads)


@pytest.mark.parametrize("sweep", [star_sweep, guarded_commit], ids=lambda s: s.__name__)
def test_with_the_clearance_guard_alone(benchmark, note, mesh, sweep):
    run(benchmark, note, mesh, sweep, 1, "clearance")


@pytest.fixture
def of_four(mesh):
    """The movable vertices of a mesh of quads, with four neighbours each."""
    return Case(mesh)


@pytest.mark.benchmark(group="laplacian")
def test_laplacian(benchmark, note, put_rate, of_four):
    kernel, arguments = laplacian_sweep(of_four, math.nan)
    note(of_four.mesh)
    kernel(*arguments)
    benchmark(kernel, *arguments)
    # Five ids of 32 bits; a place read and one written, which is read first; two more figures.
    moved = 5 * 4 + 3 * 16 + 2 * 2 * 8
    put_rate("vertex", of_four.stars.vertices.size, moved=moved, operations=4 * 8 + 12)


@pytest.mark.benchmark(group="laplacian")
def test_laplacian_and_record(benchmark, note, put_rate, of_four):
    kernel, arguments = laplacian_sweep(of_four, math.nan)
    note(of_four.mesh)

    def sweep():
        kernel(*arguments)
        return record(Quality(of_four.mesh.topology, of_four.xy), *of_four.moves)

    sweep()
    benchmark(sweep)
    moved = 5 * 4 + 3 * 16 + 2 * 2 * 8 + 40 + 16 + 4 * 8
    put_rate("vertex", of_four.stars.vertices.size, moved=moved, operations=4 * 8 + 12 + 130)


@pytest.mark.benchmark(group="laplacian")
def test_laplacian_as_a_sparse_product(benchmark, note, put_rate, of_four):
    sparse = pytest.importorskip("scipy.sparse")
    offsets, neighbours = of_four.rings
    counts = np.diff(offsets)
    weights = np.repeat(1.0 / np.maximum(counts, 1), counts)
    shape = (counts.size, counts.size)
    mean = sparse.csr_matrix(
        (weights, neighbours.astype(np.int32), offsets.astype(np.int32)), shape
    )
    note(of_four.mesh)
    benchmark(lambda: mean @ of_four.xy)
    put_rate("vertex", counts.size, moved=4 * 12 + 4 + 3 * 16, operations=4 * 4)
