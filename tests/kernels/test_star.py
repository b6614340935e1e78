"""The by-star sweep: by hand, and against the reference at any valence and on whole meshes."""

import cmath
import math

import numpy as np
import pytest

import reference
from meshes import KINDS, grid, random_mesh
from qsmooth import Mesh, smooth
from qsmooth.kernels.blocks import build_blocks
from qsmooth.kernels.proposals import thresholds
from qsmooth.kernels.star import star_sweep
from qsmooth.kernels.stars import Moves

ROOT2 = math.sqrt(2.0)


def sweep(
    mesh, *, step=0.5, good=math.nan, active=None, angles=(120.0, 60.0, 90.0, 45.0), colours=None
):
    """Run one sweep; returns new coordinates, moves and shares of the movable vertices."""
    stars = mesh.topology.schedule(True)
    blocks, xy = build_blocks(stars), mesh.xy.copy()
    moves = Moves(*np.full((2, stars.vertices.size), np.nan))
    pace = np.ones(mesh.n_cells)
    if active is not None:
        pace[:] = 0.0
        pace[active] = 1.0
    for some in colours or [(0, stars.colour_offsets.size - 1)]:
        star_sweep(xy, blocks, some, pace, thresholds(*angles), step, good, moves)
    return xy, moves.lengths, moves.shares


def four_squares(centre, **outer):
    """Two by two unit squares, cell 0 at the lower left, with vertex 4 at `centre`."""
    points, cells = grid(2, 2)
    points[4] = centre
    for name, place in outer.items():
        points[int(name[1:])] = place
    return Mesh(points, cells)


@pytest.mark.nojit
def test_a_square_grid_stays_to_the_bit():
    mesh = Mesh(*grid(4, 3))
    xy, moves, shares = sweep(mesh)
    assert np.array_equal(xy, mesh.xy)
    assert not moves.any()
    assert not shares.any()


@pytest.mark.nojit
@pytest.mark.parametrize("d", [0.25, -0.1])
@pytest.mark.parametrize("step", [0.25, 0.5, 1.0])
def test_evening_out_alone_closes_half_the_step(d, step):
    # Off-centre by d, with all angles in range: each cell slides the centre along its diagonal,
    # by step·d/√2. Two of the slides run parallel to the nearest guard lines, and count: the sum of
    # the four is (0, −2·step·d).
    xy, moves, shares = sweep(four_squares((1.0, 1.0 + d)), step=step)
    assert xy[4] == pytest.approx((1.0, 1.0 + d - 0.5 * step * d), abs=1e-15)
    assert moves == pytest.approx([0.5 * step * abs(d)])
    assert shares == pytest.approx([0.5 * step * abs(d) / (1.0 - abs(d))])


@pytest.mark.nojit
def test_a_corner_that_is_too_large_is_pushed_out():
    # At (¾, ¾) the lower left corner has 126.87° over its diagonal of √2, at height ½/√2; 120°
    # would be at √2/2 / tan 60°.
    xy, *_ = sweep(four_squares((0.75, 0.75)), active=[0])
    height, wanted = 0.5 / ROOT2, 0.5 * ROOT2 / math.tan(math.radians(60.0))
    to = 0.75 + 0.5 * (wanted - height) / ROOT2
    assert xy[4] == pytest.approx((to, to), abs=1e-15)


@pytest.mark.nojit
def test_a_corner_that_is_too_small_is_pulled_in():
    # Over a diagonal of √2 the corner at (1.6, 1.6) has height 2.2/√2; 60° is at √2/2 / tan 30°.
    mesh = four_squares((1.6, 1.6), p5=(2.2, 1.6), p7=(1.6, 2.2), p8=(2.2, 2.2))
    xy, *_ = sweep(mesh, active=[0])
    height, wanted = 2.2 / ROOT2, 0.5 * ROOT2 / math.tan(math.radians(30.0))
    to = 1.6 + 0.5 * (wanted - height) / ROOT2
    # Nearer to its lines to the lower left, and no nearer than the nearest of the others.
    assert xy[4] == pytest.approx((to, to), abs=1e-15)


@pytest.mark.nojit
def test_a_pull_needs_the_height_and_not_only_the_angle():
    # Seen from far off-centre the side 1-2 is under 5°, but the corner is too low for 45°, not too
    # high: a "pull" would push. Only the evening out remains, half of the 2.5 to the bisector.
    points = [(3.0, 0.5), (0.0, 0.0), (1.0, 0.0), (10.0, 0.0), (5.0, 10.0)]
    mesh = Mesh(points, [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1)])
    xy, *_ = sweep(mesh, active=[0])
    assert xy[0] == pytest.approx((1.75, 0.5), abs=1e-15)


@pytest.mark.nojit
def test_colours_one_by_one_are_the_whole_sweep_to_the_bit():
    mesh = random_mesh("mixed", 4, seed=7, amount=0.9).mesh
    n_colours = mesh.topology.schedule(True).colour_offsets.size - 1
    assert n_colours > 2
    steps = [(k, k + 1) for k in range(n_colours)]
    for one, many in zip(sweep(mesh), sweep(mesh, colours=steps), strict=True):
        assert one.tobytes() == many.tobytes()
    # A part of the colours leaves the vertices of the others, and what was said of them, alone.
    stars = mesh.topology.schedule(True)
    xy, moves, shares = sweep(mesh, colours=[(1, 2)])
    start, stop = stars.colour_offsets[1], stars.colour_offsets[2]
    others = np.delete(stars.vertices, np.arange(start, stop))
    assert np.array_equal(xy[others], mesh.xy[others])
    assert np.array_equal(np.flatnonzero(~np.isnan(moves)), np.arange(start, stop))
    assert np.array_equal(np.flatnonzero(~np.isnan(shares)), np.arange(start, stop))


@pytest.mark.nojit
def test_a_pace_scales_the_step_of_a_cell():
    mesh = four_squares((0.75, 0.75))
    slow, *_ = sweep(mesh, step=0.25)
    blocks, xy = build_blocks(mesh.topology.schedule(True)), mesh.xy.copy()
    moves = Moves(*np.empty((2, 1)))
    angles = thresholds(120.0, 60.0, 90.0, 45.0)
    star_sweep(xy, blocks, (0, 1), np.full(4, 0.5), angles, 0.5, math.nan, moves)
    assert np.array_equal(xy, slow)


@pytest.mark.nojit
def test_no_active_cell_proposes_nothing():
    mesh = four_squares((0.7, 1.2))
    xy, moves, _ = sweep(mesh, active=[])
    assert np.array_equal(xy, mesh.xy)
    assert not moves.any()


def agree(mesh, xy, expected):
    size = np.ptp(mesh.xy, axis=0).max()
    np.testing.assert_allclose(xy, [(z.real, z.imag) for z in expected], rtol=0, atol=1e-11 * size)


@pytest.mark.nojit
@pytest.mark.parametrize("guard", ["clearance", "quality"])
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
@pytest.mark.parametrize("valence", [3, 4, 5, 6, 7, 9, 12])
def test_one_vertex_of_any_valence_agrees_with_the_reference(valence, kind, guard):
    made = random_mesh(f"{kind} fan", valence - 1, seed=valence, amount=1.0)
    mesh = made.mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    good = 0.5 if guard == "quality" else None
    for turn in range(6):  # of the ring, so that the corners differ
        rim = [points[0]] + [
            z * cmath.exp(0.15 * math.cos(3.1 * k + turn) + 0.07j * math.sin(5.3 * k + turn))
            for k, z in enumerate(points[1:])
        ]
        placed = mesh.with_points([(z.real, z.imag) for z in rim])
        xy, moves, _ = sweep(placed, good=math.nan if good is None else good)
        rim = reference.as_complex(placed.xy)
        expected = reference.star_sweep(rim, cells, [0], reference.Options(good=good))
        agree(placed, xy, expected)
        assert moves[0] == pytest.approx(abs(expected[0] - rim[0]), abs=1e-11)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"guard": "clearance"},
        {"step": 1.0, "max_angle": 100.0, "min_angle": 80.0},
        {"triangle_max_angle": 70.0, "triangle_min_angle": 50.0, "step": 0.25},
        {"worst_fraction": 0.3},
    ],
    ids=str,
)
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_whole_meshes_agree_with_the_reference_sweep_by_sweep(kind, options):
    mesh = random_mesh(kind, 6, seed=11, amount=0.9, turned=0.5).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    own = dict(options)
    share = own.pop("worst_fraction", 1.0)
    worst = min(reference.scaled_jacobian(points, cell) for cell in cells)
    good = max(0.5, worst) if own.pop("guard", "quality") == "quality" else None
    for n in (1, 2, 3):
        active = reference.worst_cells(points, cells, share) if share < 1.0 else None
        settings = reference.Options(**({"step": 0.25} | own), good=good, active=active)
        points = reference.star_sweep(points, cells, order, settings)
        agree(mesh, smooth(mesh, "star", max_sweeps=n, rtol=0.0, **options).mesh.xy, points)


def test_on_a_tangled_mesh_it_agrees_too():
    made = random_mesh("mixed", 6, seed=3)
    rng = np.random.default_rng(4)
    mesh = made.mesh
    free = ~mesh.is_boundary
    mesh = mesh.with_points(mesh.points + rng.uniform(-1, 1, mesh.points.shape) * free[:, None])
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    assert any(reference.validity(points, cell) for cell in cells)
    order = mesh.topology.schedule(True).vertices.tolist()
    for n in (1, 2, 3):
        points = reference.star_sweep(points, cells, order, reference.Options(good=0.5, step=0.25))
        agree(mesh, smooth(mesh, "star", max_sweeps=n, rtol=0.0).mesh.xy, points)


@pytest.mark.nojit
@pytest.mark.parametrize(("d", "moves"), [(5e-13, False), (1e-11, True)])
def test_what_is_below_the_tolerated_loss_is_no_proposal(d, moves):
    # The slides are d / (2·√2) long, and τ is 1e-12: its longest edge is 1.
    mesh = four_squares((1.0, 1.0 + d))
    xy, *_ = sweep(mesh)
    assert (xy[4, 1] != mesh.xy[4, 1]) == moves
