"""Untangling sweeps: derivatives against jets, steps against the plain twin, the local sizes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
import reference_optimizer as slow
from meshes import KINDS, grid, place, random_mesh, tangle
from qsmooth import Mesh, Validity, quality
from qsmooth.kernels import lanes, untangle_sweep
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.blocks import LANES, build_blocks
from qsmooth.kernels.corner_energy import Linear
from qsmooth.kernels.stars import NO_VERTEX

EPSILONS = [1e-3, 0.05, 0.5, 2.0]


def tangled(kind="quads", size=4, seed=0, amount=1.0):
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](size, rng)
    return Mesh(tangle(points, cells, rng, amount), cells)


def sweep(mesh, sizes, epsilon, *, xy=None, threads=1):
    """Sweep once; returns new coordinates, the vertices in their order and their moves."""
    blocks = build_blocks(mesh.topology.schedule(True))
    colours = 0, blocks.colour_blocks.size - 1
    xy = (mesh.xy if xy is None else xy).copy()
    moves = np.full(blocks.vertices.size, np.nan)
    with use_threads(threads):
        untangle_sweep.untangle_sweep(xy, blocks, colours, 1.7, sizes, float(epsilon), moves)
    return xy, blocks.vertices, moves


def derivatives(mesh, v, soft):
    """Energy, gradient and Hessian of a vertex's star, by the kernel; and a trial's energy."""
    s = mesh.topology.schedule(True)
    i = s.vertices.tolist().index(v)
    rows = s.corners[s.offsets[i] : s.offsets[i + 1]]
    is_triangle = rows[:, 1] == NO_VERTEX
    quads, triangles = rows[~is_triangle], rows[is_triangle][:, [0, 2]]
    corners = np.concatenate([quads.ravel(), triangles.ravel()])
    star = np.zeros(2 * LANES * corners.size)
    star.reshape(corners.size, 2, LANES)[:, :, 0] = mesh.xy[corners]
    s = np.zeros(lanes.N_ROWS * LANES)
    s[lanes.X], s[lanes.Y] = s[lanes.PX], s[lanes.PY] = mesh.xy[v]
    s[untangle_sweep.SOFT] = soft
    for k in range(len(quads)):
        untangle_sweep.add_quad(star, s, k * lanes.ROW6, 1)
        untangle_sweep.try_quad(star, s, k * lanes.ROW6, 1)
    for k in range(len(triangles)):
        row = len(quads) * lanes.ROW6 + k * lanes.ROW4
        untangle_sweep.add_triangle(star, s, row, 1)
        untangle_sweep.try_triangle(star, s, row, 1)
    gradient = np.array([s[lanes.GX], s[lanes.GY]])
    hessian = np.array([[s[lanes.HXX], s[lanes.HXY]], [s[lanes.HXY], s[lanes.HYY]]])
    return s[lanes.ENERGY], gradient, hessian, s[lanes.TRIAL]


def soft_energy(mesh, v, z, soft, *, linear=False):
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    return slow.soft_energy(slow.places_with(points, v, z), v, cells, soft, linear=linear)


# ------------------------------------------------------------------------------- derivatives


@pytest.mark.nojit
@pytest.mark.parametrize("soft", EPSILONS)
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "annulus"])
def test_derivatives_agree_with_jets_and_with_differences(kind, soft):
    mesh = tangled(kind, 3, seed=2)
    for v in mesh.topology.schedule(True).vertices.tolist()[:6]:
        own, gradient, hessian, trial = derivatives(mesh, v, soft)
        # The Hessian is that with the stand-in replaced by its tangent, which has its gradient.
        jet = soft_energy(mesh, v, slow.Jet.variables(mesh.xy[v]), soft, linear=True)
        scale = np.abs(jet.hessian).max()
        assert own == pytest.approx(jet.value, rel=1e-12)
        assert trial == pytest.approx(jet.value, rel=1e-12)
        np.testing.assert_allclose(gradient, jet.gradient, rtol=1e-10, atol=1e-12 * scale)
        np.testing.assert_allclose(hessian, jet.hessian, rtol=1e-10, atol=1e-12 * scale)
        h = 1e-6 * soft
        for axis, own_slope in zip(np.eye(2), gradient, strict=True):
            ends = [soft_energy(mesh, v, mesh.xy[v] + s * h * axis, soft) for s in (1.0, -1.0)]
            slope = (ends[0] - ends[1]) / (2.0 * h)
            assert own_slope == pytest.approx(slope, rel=1e-4, abs=1e-4 * np.abs(gradient).max())


@pytest.mark.nojit
@pytest.mark.parametrize("soft", EPSILONS)
def test_the_hessian_is_never_indefinite_however_tangled(soft):
    for seed in range(4):
        mesh = tangled("mixed", 4, seed=seed, amount=2.0)
        for v in mesh.topology.schedule(True).vertices.tolist():
            _, _, hessian, _ = derivatives(mesh, v, soft)
            low, high = np.linalg.eigvalsh(hessian)
            assert low > -1e-12 * high
            assert high > 0.0


@pytest.mark.nojit
@pytest.mark.parametrize("soft", [1e-12, 1e-3, 1.0])
@pytest.mark.parametrize("det", [-1e9, -1.0, -1e-9, 0.0, 1e-9, 1.0, 1e9])
def test_the_stand_in_is_positive_increasing_and_near_a_large_determinant(det, soft):
    value, slope, across = untangle_sweep.regularised(Linear(det, 1.0, -2.0), soft)
    assert value > 0.0
    assert across == -2.0 * slope
    assert 0.0 < slope <= 1.0
    # χ solves χ² − det χ = soft² / 4; each side for its own sign, as else they cancel.
    assert value * (value - det) == pytest.approx(0.25 * soft * soft, rel=1e-6, abs=1e-6 * det**2)
    if det == 0.0:
        assert (value, slope) == (0.5 * soft, 0.5)


# ------------------------------------------------------------------------------- the sweep


def agree(mesh, epsilon, sweeps):
    sizes = np.random.default_rng(0).uniform(0.7, 1.4, mesh.n_vertices)
    xy, points, cells = mesh.xy, reference.as_complex(mesh.xy), reference.as_lists(mesh)
    size = np.ptp(mesh.xy, axis=0).max()
    for _ in range(sweeps):
        xy, order, _ = sweep(mesh, sizes, epsilon, xy=xy)
        points = slow.untangle_sweep(points, cells, order.tolist(), sizes, epsilon)
        np.testing.assert_allclose(xy, [(z.real, z.imag) for z in points], rtol=0, atol=1e-8 * size)


@pytest.mark.nojit
@pytest.mark.parametrize("epsilon", EPSILONS)
def test_a_sweep_agrees_with_the_plain_one(epsilon):
    agree(tangled("mixed", 3, seed=1), epsilon, 1)


@pytest.mark.parametrize("epsilon", EPSILONS[1:])
@pytest.mark.parametrize("kind", KINDS)
def test_sweeps_of_every_kind_of_mesh_agree_with_the_plain_ones(kind, epsilon):
    agree(tangled(kind, 5, seed=3, amount=0.7), epsilon, 2)


KINDS_OF_MESH = st.sampled_from(sorted(KINDS))
SEEDS = st.integers(0, 2**32 - 1)


@given(KINDS_OF_MESH, st.integers(2, 6), SEEDS, st.floats(0.0, 3.0), st.sampled_from(EPSILONS))
@settings(max_examples=100)
def test_energy_never_rises_where_sizes_are_constant(kind, size, seed, amount, epsilon):
    # Each vertex sees its star with its own r: only where r is constant is there one energy.
    mesh = tangled(kind, size, seed, amount)
    sizes, cells = np.full(mesh.n_vertices, 0.8), reference.as_lists(mesh)
    movable = mesh.topology.schedule(True).vertices.tolist()
    xy = mesh.xy
    before = slow.total_soft_energy(reference.as_complex(xy), cells, movable, 0.8 * epsilon)
    for _ in range(3):
        xy, *_ = sweep(mesh, sizes, epsilon, xy=xy)
        after = slow.total_soft_energy(reference.as_complex(xy), cells, movable, 0.8 * epsilon)
        assert after <= before * (1.0 + 1e-12)
        before = after
    assert xy[mesh.is_fixed].tobytes() == mesh.xy[mesh.is_fixed].tobytes()


@given(KINDS_OF_MESH, SEEDS, st.sampled_from(EPSILONS))
def test_a_vertex_alone_never_goes_uphill_whatever_its_size(kind, seed, epsilon):
    made = tangled(kind, 3, seed)
    movable = made.topology.schedule(True).vertices.tolist()
    v = movable[seed % len(movable)]
    fixed = np.ones(made.n_vertices, np.bool_)
    fixed[v] = False
    mesh = Mesh(made.xy, _blocks(made), fixed=fixed)
    sizes = np.random.default_rng(seed).uniform(0.1, 10.0, mesh.n_vertices)
    xy, vertices, moves = sweep(mesh, sizes, epsilon)
    assert vertices.tolist() == [v]
    before, after = (soft_energy(mesh, v, tuple(at[v]), epsilon * sizes[v]) for at in (mesh.xy, xy))
    assert after < before if moves[0] > 0.0 else np.array_equal(xy, mesh.xy)


def _blocks(mesh):
    cells = reference.as_lists(mesh)
    return [b for n in (4, 3) if (b := [cell for cell in cells if len(cell) == n])]


@given(KINDS_OF_MESH, SEEDS, st.sampled_from(EPSILONS))
def test_two_threads_give_the_bits_of_one(kind, seed, epsilon):
    mesh = tangled(kind, 5, seed)
    sizes = np.ones(mesh.n_vertices)
    one, _, moves = sweep(mesh, sizes, epsilon)
    two, _, moves_of_two = sweep(mesh, sizes, epsilon, threads=2)
    assert one.tobytes() == two.tobytes()
    assert moves.tobytes() == moves_of_two.tobytes()


@given(SEEDS, st.floats(0.0, 6.0), st.sampled_from([1e-9, 1.0, 1e9]), st.booleans())
def test_a_sweep_turns_scales_and_mirrors_with_the_mesh(seed, turn, scale, mirror):
    made = random_mesh("mixed", 4, seed=seed, amount=1.0)
    motion = {"turn": turn, "scale": scale, "mirror": mirror}
    sizes = np.ones(len(made.points))
    xy, *_ = sweep(made.mesh, sizes, 0.3)
    other, *_ = sweep(Mesh(place(made.points, **motion), made.cells), sizes * scale**2, 0.3)
    np.testing.assert_allclose(other, place(xy, **motion), rtol=0.0, atol=1e-7 * scale)


@pytest.mark.nojit
def test_sweeps_untangle_a_vertex_that_left_its_star():
    points, cells = grid(2, 2)
    points[4] = 3.2, -0.4
    mesh = Mesh(points, cells)
    xy, sizes = mesh.xy, np.ones(9)
    for _ in range(20):
        xy, *_ = sweep(mesh, sizes, 0.1, xy=xy)
    assert quality((xy, cells)).n_invalid == 0
    assert xy[4] == pytest.approx((1.0, 1.0), abs=0.05)


# ------------------------------------------------------------------------------- helpers


@pytest.mark.nojit
def test_smallest_determinant_is_each_cells_over_the_local_size():
    mesh = tangled("mixed", 3, seed=4)
    sizes = np.linspace(0.5, 2.0, mesh.n_vertices)
    out, closed = np.full(mesh.n_cells, np.nan), np.zeros(mesh.cell_vertices.size, np.bool_)
    every, cells = np.arange(mesh.n_cells), mesh.topology.cells
    untangle_sweep.smallest_determinant(mesh.xy, *cells, sizes, closed, every, out)
    points = reference.as_complex(mesh.xy)
    expected = [
        min(
            float(reference.determinant(*(points[w] for w in corner))) / sizes[corner[0]]
            for corner in reference.corners(cell)
        )
        for cell in reference.as_lists(mesh)
    ]
    assert out == pytest.approx(expected, abs=1e-13)
    assert np.array_equal(out <= 0.0, quality(mesh).validity != Validity.VALID)
    # Only of the cells that are listed, and of the corners that are not closed.
    some, listed = np.full(2, np.nan), np.array([5, 1])
    untangle_sweep.smallest_determinant(mesh.xy, *cells, sizes, closed, listed, some)
    assert np.array_equal(some, out[listed])
    closed[mesh.cell_offsets[5] : mesh.cell_offsets[6]] = True
    untangle_sweep.smallest_determinant(mesh.xy, *cells, sizes, closed, listed, some)
    assert np.array_equal(some, [np.inf, out[1]])


@pytest.mark.nojit
def test_mean_squared_edge_and_its_spread_by_hand():
    # Two by one squares and a vertex in no cell.
    points, cells = grid(2, 1)
    mesh = Mesh([*points * (1.0, 2.0), (9.0, 9.0)], cells)
    rings = mesh.ring_offsets, mesh.ring_vertices
    sizes = np.full(7, np.nan)
    untangle_sweep.mean_squared_edge(mesh.xy, *rings, sizes)
    assert sizes == pytest.approx([2.5, 2.0, 2.5, 2.5, 2.0, 2.5, 0.0])
    spread = np.full(7, np.nan)
    values = np.array([1.0, 4.0, 2.0, -math.inf, 6.0, 0.0, -math.inf])
    untangle_sweep.spread_logarithms(*rings, values, spread)
    # Vertex 0 has neighbours 1 and 3, of which 3 does not count; 3 counts 0 and 4.
    assert spread == pytest.approx([2.5, 13 / 4, 2.0, 3.5, 10 / 3, 8 / 3, -math.inf])


@pytest.mark.nojit
def test_shortest_edges_of_listed_vertices():
    points, cells = grid(2, 2)
    points[4] = 1.25, 1.0
    mesh = Mesh(points, cells)
    out = np.full(3, np.nan)
    listed = np.array([4, 0, 5], np.uint32)
    untangle_sweep.shortest_edges(mesh.xy, mesh.ring_offsets, mesh.ring_vertices, listed, out)
    assert out.tolist() == [0.75, 1.0, 0.75]
