"""Newton sweeps: derivatives against jets and differences, steps against the plain twin."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
import reference_optimizer as slow
from meshes import KINDS, fan, grid, place, random_mesh, random_meshes
from qsmooth import Mesh, quality
from qsmooth.kernels import lanes, newton_sweep, star_trials
from qsmooth.kernels import star_energy as star_kernels
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.blocks import LANES, build_blocks, row_corners
from qsmooth.kernels.stars import NO_VERTEX

# Weight of the mean, threshold and squarings: the mean alone, walls of every power, both.
ENERGIES = [
    (1.0, math.inf, 1),
    (0.0, 1.0, 1),
    (1.0, 1.5, 2),
    (2.0, 1.3, 3),
    (1.0, 2.0, 4),
    (0.5, 3.0, 5),
    (1.0, 1.1, 6),
]


def wall(energy):
    weight, threshold, squarings = energy
    return newton_sweep.Wall(float(weight), float(threshold), squarings)


def terms(energy):
    weight, threshold, squarings = energy
    return star_kernels.Terms(float(weight), 1.0 / threshold, squarings, 2.0**squarings)


# What holds nothing: the cosines, the sine, the squared ratio of edges, f, half the squared edge.
FREE = (2.0, -2.0, -2.0, 1e300, 1e300, -1e300)


def asked_table(vertices, cells, asked):
    """What is asked of each cell around each vertex: m11, m12, m22, area, weight, slim, near."""
    table = []
    for v, cell in zip(vertices, cells, strict=True):
        own = slow.asked_of(cell, asked)
        table.append((*own.targets[v], own.area or 0.0, own.weight, own.slim, own.near))
    return np.array(table, float).reshape(-1, 7)


def rows_of_blocks(mesh, blocks, asked):
    corners = row_corners(blocks, *mesh.topology.cells)
    cells = reference.as_lists(mesh)
    table = asked_table(
        mesh.cell_vertices[corners].tolist(), [cells[c] for c in blocks.cells.tolist()], asked
    )
    *rest, near = table[:, 3:].T.copy()
    return slow.rows_of(mesh, blocks, table[:, :3], *rest)._replace(near=near)


def sweep(mesh, energy, *, xy=None, threads=1, colours=None, asked=None, held=FREE):
    """Sweep once; returns new coordinates, the vertices in their order and their moves."""
    blocks = build_blocks(mesh.topology.schedule(True))
    # Angles and sines alone, where nothing else is held.
    held = held[:3] if held == FREE else held
    rest = np.tile(held, (mesh.n_vertices, 1)), rows_of_blocks(mesh, blocks, asked)
    xy = (mesh.xy if xy is None else xy).copy()
    moves = np.full(blocks.vertices.size, np.nan)
    with use_threads(threads):
        for some in colours or [(0, blocks.colour_blocks.size - 1)]:
            newton_sweep.newton_sweep(xy, blocks, some, 1.7, wall(energy), *rest, moves)
    return xy, blocks.vertices, moves


def lane(mesh, v, asked=None):
    """Scratch of a block with one lane, for vertex v: star, scratch, quads, triangles, what is
    asked: shapes, sizes, walls on shape.
    """
    schedule = mesh.topology.schedule(True)
    i = schedule.vertices.tolist().index(v)
    of_vertex = slice(schedule.offsets[i], schedule.offsets[i + 1])
    rows = schedule.corners[of_vertex]
    is_triangle = rows[:, 1] == NO_VERTEX
    numbers, lists = schedule.cells[of_vertex], reference.as_lists(mesh)
    cells = [lists[c] for c in [*numbers[~is_triangle], *numbers[is_triangle]]]
    quads, triangles = rows[~is_triangle], rows[is_triangle][:, [0, 2]]
    corners = np.concatenate([quads.ravel(), triangles.ravel()])
    star = np.zeros(2 * LANES * corners.size)
    star.reshape(corners.size, 2, LANES)[:, :, 0] = mesh.xy[corners]
    s = np.zeros(lanes.N_ROWS * LANES)
    s[lanes.X], s[lanes.Y] = mesh.xy[v]
    m11, m12, m22, area, weight, slim, near = asked_table([v] * len(cells), cells, asked).T.copy()
    inv_area = np.divide(1.0, area, out=np.zeros(area.size), where=area > 0.0)
    asks = (m11, m12, m22), (area, inv_area, weight), (slim, near)
    return star, s, len(quads), len(triangles), asks


def run_loops(made, energy, module, prefix, which):
    """Run the loops over all cells of a star, those with walls where there are any."""
    star, s, n_quads, n_triangles, (shapes, sizes, walls) = made
    walled = math.isfinite(energy[1]) or walls[0].any()
    for k in range(n_quads + n_triangles):
        kind = "quad" if k < n_quads else "triangle"
        row = min(k, n_quads) * lanes.ROW6 + max(0, k - n_quads) * lanes.ROW4
        at = star, s, row, which
        if walled:
            loop = getattr(module, f"{prefix}_walled_{kind}")
            loop(*at, shapes, k, walls, k, terms(energy))
        else:
            getattr(module, f"{prefix}_{kind}")(*at, shapes, k, terms(energy))
        pairs = newton_sweep.SEEN if k < n_quads else [(lanes.ROW0, lanes.ROW2)]
        for a, c in pairs if sizes[2].any() else []:
            loop = getattr(module, f"{prefix}_size")
            loop(star, s, row + a, row + c, which, sizes, k, terms(energy).mean_weight)


def derivatives(mesh, v, energy, asked=None):
    """Energy, gradient and Hessian of a vertex's star, by the kernel."""
    made = lane(mesh, v, asked)
    run_loops(made, energy, star_kernels, "add", 1)
    s = made[1]
    gradient = np.array([s[lanes.GX], s[lanes.GY]])
    hessian = np.array([[s[lanes.HXX], s[lanes.HXY]], [s[lanes.HXY], s[lanes.HYY]]])
    return s[lanes.ENERGY], gradient, hessian


def trial(mesh, v, z, energy, asked=None):
    """Energy and margin with the vertex at z, by the kernel."""
    made = lane(mesh, v, asked)
    s = made[1]
    s[lanes.PX], s[lanes.PY], s[lanes.MARGIN] = *z, math.inf
    run_loops(made, energy, star_trials, "try", (0, 1))
    return s[lanes.TRIAL], s[lanes.MARGIN]


def star_energy(mesh, v, z, energy, *, bound=False, asked=None):
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    places = slow.places_with(points, v, z)
    return slow.star_energy(places, v, cells, *energy, bound=bound, asked=asked)


def asked_of(mesh, seed=0, *, maps=False):
    """Targets at random."""
    return slow.random_asked(reference.as_lists(mesh), np.random.default_rng(seed), maps=maps)


def some_vertices(mesh, count=4):
    vertices = np.sort(mesh.topology.schedule(True).vertices).tolist()
    return vertices[:: max(1, len(vertices) // count)]


# ------------------------------------------------------------------------------- by hand


@pytest.mark.nojit
def test_energy_of_squares_and_of_equilateral_triangles_is_one_a_term():
    square = Mesh(*grid(2, 2))
    # Twelve corners see the centre of four squares; f = g = 1 in each.
    energy, gradient, hessian = derivatives(square, 4, (3.0, 0.5, 1))
    assert energy == pytest.approx(12 * (3.0 + 4.0))
    assert gradient == pytest.approx([0.0, 0.0], abs=1e-13)
    assert hessian[0, 0] == pytest.approx(hessian[1, 1])
    hexagon = [(math.cos(k * math.pi / 3), math.sin(k * math.pi / 3)) for k in range(6)]
    triangles = Mesh([(0.0, 0.0), *hexagon], [(0, 1 + k, 1 + (k + 1) % 6) for k in range(6)])
    # Six triangles: one f and three g in each.
    energy, gradient, _ = derivatives(triangles, 0, (3.0, 0.5, 1))
    assert energy == pytest.approx(6 * 3.0 + 18 * 4.0)
    assert gradient == pytest.approx([0.0, 0.0], abs=1e-13)


@pytest.mark.nojit
@pytest.mark.parametrize("energy", ENERGIES)
def test_the_centre_of_four_squares_comes_home_and_stays(energy):
    points, cells = grid(2, 2)
    mesh = Mesh(points, cells)
    xy, _, moves = sweep(mesh, energy)
    assert np.array_equal(xy, mesh.xy)
    assert moves.tolist() == [0.0]
    points[4] = 1.3, 0.8
    xy = Mesh(points, cells).xy
    for _ in range(200):
        xy, *_ = sweep(mesh, energy, xy=xy)
    assert xy[4] == pytest.approx((1.0, 1.0), abs=1e-6)


@pytest.mark.nojit
def test_moves_are_lengths_and_only_movable_vertices_move():
    mesh = random_mesh("mixed", 4, seed=3).mesh
    xy, vertices, moves = sweep(mesh, (1.0, 1.5, 2))
    lengths = np.hypot(*(xy - mesh.xy).T)
    assert lengths[vertices] == pytest.approx(moves, abs=1e-15)
    assert (moves > 0.0).any()
    assert not lengths[mesh.is_fixed].any()


# ------------------------------------------------------------------------------- derivatives


@pytest.mark.nojit
@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "annulus", "mixed fan"])
@pytest.mark.parametrize("targets", ["ideal", "any"])
def test_derivatives_agree_with_jets_and_with_differences(kind, energy, targets):
    mesh = random_mesh(kind, 4, seed=5, amount=0.4).mesh
    asked = asked_of(mesh) if targets == "any" else None
    for v in some_vertices(mesh):
        own, gradient, hessian = derivatives(mesh, v, energy, asked)
        variables = slow.Jet.variables(mesh.xy[v])
        jet = star_energy(mesh, v, variables, energy, bound=True, asked=asked)
        scale = np.abs(jet.hessian).max()
        assert own == pytest.approx(jet.value, rel=1e-12)
        np.testing.assert_allclose(gradient, jet.gradient, rtol=0, atol=1e-12 * scale)
        np.testing.assert_allclose(hessian, jet.hessian, rtol=0, atol=1e-12 * scale)
        # The bound touches the energy: one gradient for both.
        h = 1e-5
        differences = [
            (
                star_energy(mesh, v, mesh.xy[v] + h * axis, energy, asked=asked)
                - star_energy(mesh, v, mesh.xy[v] - h * axis, energy, asked=asked)
            )
            / (2.0 * h)
            for axis in np.eye(2)
        ]
        assert gradient == pytest.approx(differences, abs=1e-4 * scale)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles"])
def test_hessian_of_the_mean_agrees_with_differences_of_gradients(kind):
    made = random_mesh(kind, 4, seed=8, amount=0.4)
    mesh, h = made.mesh, 1e-5
    for v in some_vertices(mesh):
        _, _, hessian = derivatives(mesh, v, ENERGIES[0])
        columns = []
        for axis in np.eye(2):
            ends = []
            for sign in (1.0, -1.0):
                xy = mesh.xy.copy()
                xy[v] += sign * h * axis
                ends.append(derivatives(mesh.with_points(xy), v, ENERGIES[0])[1])
            columns.append((ends[0] - ends[1]) / (2.0 * h))
        np.testing.assert_allclose(
            hessian, np.array(columns), rtol=0, atol=1e-5 * np.abs(hessian).max()
        )


@pytest.mark.nojit
@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("seed", range(4))
def test_the_hessian_is_positive_definite(seed, energy):
    mesh = random_mesh("mixed", 4, seed=seed, amount=1.0).mesh
    for v in some_vertices(mesh, 20):
        _, gradient, hessian = derivatives(mesh, v, energy)
        assert np.linalg.eigvalsh(hessian)[0] > 0.0
        if np.abs(gradient).max() > 1e-9:
            assert gradient @ np.linalg.solve(hessian, -gradient) < 0.0


@pytest.mark.nojit
@pytest.mark.parametrize("energy", ENERGIES)
def test_trial_energy_is_the_energy_and_its_margin_the_smallest_area(energy):
    mesh = random_mesh("mixed", 4, seed=2, amount=0.5).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    for v in some_vertices(mesh):
        for shift in (0.0, 0.02):
            z = mesh.xy[v] + shift
            for asked in (asked_of(mesh), None):
                found, margin = trial(mesh, v, z, energy, asked)
                expected = star_energy(mesh, v, z, energy, asked=asked)
                assert found == pytest.approx(expected, rel=1e-12)
            moved = [*points[:v], complex(*z), *points[v + 1 :]]
            areas = [
                float(reference.determinant(*(moved[w] for w in corner)))
                for cell in reference.fan(v, cells)
                for corner in reference.corners(cell)
                if v in corner
            ]
            assert margin == pytest.approx(min(areas), abs=1e-12)
            assert margin < min(areas)


# ------------------------------------------------------------------------------- the sweep


def agree(mesh, energy, sweeps=1, asked=None, held=None):
    xy, points, cells = mesh.xy, reference.as_complex(mesh.xy), reference.as_lists(mesh)
    size = np.ptp(mesh.xy, axis=0).max()
    for _ in range(sweeps):
        xy, order, _ = sweep(mesh, energy, xy=xy, asked=asked, held=held or FREE)
        points = slow.newton_sweep(
            points, cells, order.tolist(), *energy, asked=asked, held=held
        )  # fmt: skip
        expected = [(z.real, z.imag) for z in points]
        np.testing.assert_allclose(xy, expected, rtol=0, atol=1e-9 * size)


@pytest.mark.nojit
@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("kind", ["quads", "mixed", "triangle fan"])
def test_a_sweep_agrees_with_the_plain_one(kind, energy):
    agree(random_mesh(kind, 4, seed=4, amount=0.8).mesh, energy)


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "mixed fan"])
@pytest.mark.parametrize("energy", ENERGIES[:4])
def test_a_sweep_towards_any_targets_agrees_with_the_plain_one(kind, energy):
    mesh = random_mesh(kind, 4, seed=4, amount=0.8).mesh
    agree(mesh, energy, asked=asked_of(mesh))


def worst_of(mesh, xy):
    """What can be held, at coordinates: of corners with a movable vertex, and of cells with one."""
    points, movable = reference.as_complex(xy), set(mesh.topology.schedule(True).vertices.tolist())
    most, least, sine, ratio, shape, edge = -2.0, 2.0, 2.0, 0.0, 0.0, math.inf
    for cell in reference.as_lists(mesh):
        lengths = [abs(points[cell[i]] - points[cell[i - 1]]) for i in range(len(cell))]
        target = slow.asked_of(cell, None).targets
        if movable & set(cell):
            ratio = max(ratio, (max(lengths) / min(lengths)) ** 2)
        for i, corner in enumerate(reference.corners(cell)):
            if not movable & set(corner):
                continue
            u, w = slow.edges_at(xy.tolist(), cell, i)
            product = math.hypot(*u) * math.hypot(*w)
            cosine = (u[0] * w[0] + u[1] * w[1]) / product
            most, least = max(most, cosine), min(least, cosine)
            best = slow.SINE_60 if len(cell) == 3 else 1.0
            sine = min(sine, slow.determinant(u, w) / product / best)
            shape = max(shape, slow.shape_energy(u, w, target[corner[0]]))
            for w in corner[1:]:
                if movable & {corner[0], w}:
                    edge = min(edge, 0.5 * abs(points[w] - points[corner[0]]) ** 2)
    return np.array([most, least, sine, ratio, shape, edge])


# The sign says which way is worse.
SIGNS = np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0])


@pytest.mark.nojit
@pytest.mark.parametrize("row", range(6))
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_a_held_figure_gets_no_worse_and_would_else(kind, row):
    fell = 0
    for seed in range(12):
        mesh = random_mesh(kind, 4, seed=seed, amount=0.3).mesh
        # Targets that pull away from the ideal.
        asked = asked_of(mesh, seed)
        worst = worst_of(mesh, mesh.xy)
        held = np.array(FREE)
        held[row] = worst[row] + SIGNS[row] * 1e-11 * abs(worst[row])
        ends = []
        for limits in (FREE, tuple(held)):
            xy = mesh.xy
            for _ in range(5):
                xy, *_ = sweep(mesh, ENERGIES[0], xy=xy, asked=asked, held=limits)
            ends.append(SIGNS[row] * (worst_of(mesh, xy)[row] - worst[row]))
        assert ends[1] <= 2e-11 * abs(worst[row])
        fell += ends[0] > 1e-3 * abs(worst[row])
    assert fell


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_a_sweep_that_holds_agrees_with_the_plain_one(kind):
    for seed in range(4):
        mesh = random_mesh(kind, 4, seed=seed, amount=0.8).mesh
        worst = worst_of(mesh, mesh.xy)
        held = tuple(worst + SIGNS * 1e-11 * np.abs(worst))
        agree(mesh, ENERGIES[2], 2, asked=asked_of(mesh, seed), held=held)


@pytest.mark.parametrize("energy", ENERGIES)
@pytest.mark.parametrize("kind", KINDS)
def test_sweeps_of_every_kind_of_mesh_agree_with_the_plain_ones(kind, energy):
    agree(random_mesh(kind, 5, seed=6, amount=0.7).mesh, energy, sweeps=3)


def test_blocks_of_more_than_one_vertex_and_of_more_than_one_block_agree():
    made = random_mesh("mixed", 22, seed=1, amount=0.6)
    agree(made.mesh, (1.0, 1.6, 3))


@pytest.mark.nojit
@pytest.mark.parametrize("valence", [3, 4, 5, 7, 12, 40])
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_one_vertex_of_any_valence_agrees(kind, valence):
    points, cells = fan(valence, kind)
    points[0] = 0.31, -0.17
    agree(Mesh(points, cells), (1.0, 2.0, 3))


@given(random_meshes(), st.sampled_from(ENERGIES))
@settings(max_examples=100)
def test_energy_never_rises_and_valid_stays_valid_at_every_sweep(made, energy):
    mesh = made.mesh
    cells = reference.as_lists(mesh)
    movable = mesh.topology.schedule(True).vertices.tolist()
    xy = mesh.xy
    before = slow.total_energy(reference.as_complex(xy), cells, movable, *energy)
    for _ in range(3):
        xy, *_ = sweep(mesh, energy, xy=xy)
        points = reference.as_complex(xy)
        assert not any(reference.validity(points, cell) for cell in cells)
        after = slow.total_energy(points, cells, movable, *energy)
        # Far from the origin a trial is measured where it is stored.
        assert after <= before * (1.0 + 1e-9)
        before = after
    fixed = mesh.is_fixed
    assert xy[fixed].tobytes() == mesh.xy[fixed].tobytes()


@given(random_meshes(), st.sampled_from(ENERGIES))
def test_two_threads_give_the_bits_of_one(made, energy):
    mesh = made.mesh
    one, _, moves = sweep(mesh, energy)
    two, _, moves_of_two = sweep(mesh, energy, threads=2)
    assert one.tobytes() == two.tobytes()
    assert moves.tobytes() == moves_of_two.tobytes()


@pytest.mark.nojit
def test_colours_one_by_one_are_the_whole_sweep_to_the_bit():
    mesh = random_mesh("mixed", 4, seed=7, amount=0.6).mesh
    n_colours = mesh.topology.schedule(True).colour_offsets.size - 1
    energy = (1.0, 1.5, 2)
    one, many = (
        sweep(mesh, energy, colours=some) for some in (None, [(k, k + 1) for k in range(n_colours)])
    )
    for left, right in zip(one, many, strict=True):
        assert left.tobytes() == right.tobytes()


@given(st.integers(0, 2**32 - 1), st.sampled_from(ENERGIES), st.integers(-40, 40))
def test_scaling_by_a_power_of_two_scales_the_bits(seed, energy, power):
    made = random_mesh("mixed", 4, seed=seed, amount=0.7)
    factor = 2.0**power
    xy, *_ = sweep(made.mesh, energy)
    other, *_ = sweep(Mesh(made.points * factor, made.cells), energy)
    # Every quantity scales without rounding but the bound of underflow in a certificate.
    assert np.array_equal(other, xy * factor)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(ENERGIES[:4]),
    st.floats(0.0, 6.0),
    st.sampled_from([1e-9, 1.0, 1e9]),
    st.booleans(),
)
def test_a_sweep_turns_scales_and_mirrors_with_the_mesh(seed, energy, turn, scale, mirror):
    made = random_mesh("mixed", 4, seed=seed, amount=0.6)
    motion = {"turn": turn, "scale": scale, "mirror": mirror}
    # In one colour order for both: the numbering is the same.
    xy, *_ = sweep(made.mesh, energy)
    other, *_ = sweep(Mesh(place(made.points, **motion), made.cells), energy)
    np.testing.assert_allclose(other, place(xy, **motion), rtol=0.0, atol=1e-8 * scale)


@pytest.mark.nojit
def test_a_vertex_of_a_valid_mesh_never_leaves_its_kernel():
    # A sliver over which the whole Newton step would be far too long.
    points = [(0.0, 1e-9), (-1.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    mesh = Mesh(points, [(0, 1, 2), (0, 2, 3), (0, 3, 1)])
    xy = mesh.xy
    for _ in range(60):
        xy, *_ = sweep(mesh, (1.0, math.inf, 1), xy=xy)
        assert quality((xy, [(0, 1, 2), (0, 2, 3), (0, 3, 1)])).n_invalid == 0
    assert xy[0] == pytest.approx((0.0, 0.36), abs=0.1)
