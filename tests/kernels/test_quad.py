"""The by-quad sweep: by hand, and against the reference at any valence and on whole meshes."""

import math

import numpy as np
import pytest

import reference
from meshes import KINDS, grid, random_mesh
from qsmooth import Mesh, smooth
from qsmooth.kernels.blocks import build_blocks
from qsmooth.kernels.proposals import thresholds
from qsmooth.kernels.quad import guarded_commit, quad_proposals
from qsmooth.kernels.stars import Moves

ROOT2 = math.sqrt(2.0)


def propose(mesh, *, step=0.5, active=None, angles=(120.0, 60.0, 90.0, 45.0)):
    """Displacements that a sweep wants, of the movable vertices."""
    blocks = build_blocks(mesh.topology.schedule(True))
    pace = np.ones(mesh.n_cells)
    if active is not None:
        pace[:] = 0.0
        pace[active] = 1.0
    wanted = np.full((blocks.vertices.size, 2), np.nan)
    quad_proposals(mesh.xy, blocks, pace, thresholds(*angles), step, wanted)
    return wanted


def commit(mesh, wanted, *, good=math.nan):
    stars = mesh.topology.schedule(True)
    xy = mesh.xy.copy()
    moves = Moves(*np.full((2, stars.vertices.size), np.nan))
    colours = 0, stars.colour_offsets.size - 1
    guarded_commit(xy, build_blocks(stars), colours, np.array(wanted, dtype=float), good, moves)
    return xy, moves.lengths, moves.shares


def agree(mesh, xy, expected):
    size = np.ptp(mesh.xy, axis=0).max()
    np.testing.assert_allclose(xy, [(z.real, z.imag) for z in expected], rtol=0, atol=1e-11 * size)


def bent_corner(centre=(1.0, 1.0)):
    """Four quads; the corner at vertex 1, on the boundary, has 136.4° over a diagonal of √2."""
    points, cells = grid(2, 2)
    points[1], points[2], points[4] = (0.7, 0.3), (1.4, 0.0), centre
    points[5], points[7], points[8] = (1.3, 1.0), (1.0, 1.3), (1.3, 1.3)
    return Mesh(points, cells)


@pytest.mark.nojit
def test_a_square_grid_wants_nothing():
    assert not propose(Mesh(*grid(4, 3))).any()


@pytest.mark.nojit
def test_a_corner_on_the_boundary_shrinks_its_diagonal():
    # The corner's height is 0.2·√2, so that 120° wants a diagonal of 0.4·√2·tan 60°; the centre
    # goes a quarter of the rest towards the origin. Evening itself out would lose it clearance.
    wanted = propose(bent_corner(), active=[0])
    shrink = 0.25 * (ROOT2 - 0.4 * ROOT2 * math.tan(math.radians(60.0)))
    assert wanted[0] == pytest.approx((-shrink / ROOT2, -shrink / ROOT2), abs=1e-15)


@pytest.mark.nojit
def test_both_neighbours_shrink_a_diagonal():
    # The interior corner 5 of a row of quads is flat: both ends of its diagonal move, 6 and 9.
    points, cells = grid(3, 3)
    points[5] = (1.45, 1.45)  # in the cell 5, 6, 10, 9 its angle is over 160°
    mesh = Mesh(points, cells)
    wanted = propose(mesh, active=[4])
    options = reference.Options(active={4})
    xy, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    expected = reference.quad_sweep(xy, cells, mesh.topology.schedule(True).vertices, options)
    order = mesh.topology.schedule(True).vertices.tolist()
    assert {v for v in order if expected[v] != xy[v]} >= {6, 9}
    free, _, _ = commit(mesh, wanted)
    agree(mesh, free, expected)


@pytest.mark.nojit
def test_diagonals_stretch_by_half_the_step_at_most():
    # The corner at the origin has under 1° and its diagonal is far too short: it may stretch by
    # step·L/2 at each end.
    points = [
        (0.0, 0.0), (100.0, -0.5), (200.0, 0.0), (100.0, 0.5), (0.0, 80.0), (200.0, 80.0),
        (100.0, 160.0),
    ]  # fmt: skip
    mesh = Mesh(points, [(0, 1, 2, 3), (0, 3, 6, 4), (3, 2, 5, 6)])
    wanted = propose(mesh, active=[0])
    found = [
        place - complex(100.0, 0.5)
        for v, place in reference.proposals(
            reference.as_complex(points), [0, 1, 2, 3], reference.Options(), by_quad=True
        )
        if v == 3
    ]
    # Corners 0 and 2 stretch it by ½·½·1 each; its own corner, too flat, pushes it on.
    assert [z for z in found if abs(z - 0.25j) < 1e-12] == pytest.approx([0.25j, 0.25j])
    expected = reference.mean_of_accepted(
        reference.as_complex(points), 3, reference.as_lists(mesh),
        [complex(100.0, 0.5) + z for z in found],
    )  # fmt: skip
    assert complex(*wanted[0]) == pytest.approx(expected - complex(100.0, 0.5), abs=1e-12)


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("step", "share"), [(0.4, 1.0), (0.9, 0.5), (1.3, 0.25), (2.5, 0.125), (9.0, 0.0)]
)
def test_commit_halves_a_step_until_the_clearance_is_kept(step, share):
    # The centre goes left from (1.3, 1), where the diagonals on its right are 0.7/√2 away. After
    # 0.6 those on its left are as near: 0.9 is halved once, 1.3 twice, 2.5 three times, 9 stays.
    points, cells = grid(2, 2)
    points[4] = (1.3, 1.0)
    xy, moves, shares = commit(Mesh(points, cells), [(-step, 0.0)])
    assert xy[4] == pytest.approx((1.3 - share * step, 1.0), abs=1e-15)
    assert moves == pytest.approx([share * step])
    assert shares == pytest.approx([share * step / 0.7])


@pytest.mark.nojit
def test_commit_asks_where_the_neighbours_are_now():
    # The second finds the first moved, and its own clearance another one than it was.
    points, cells = grid(3, 2)  # two interior vertices, 5 and 6
    mesh = Mesh(points, cells)
    wanted = np.array([(0.3, 0.2), (-0.3, -0.1)])
    xy, *_ = commit(mesh, wanted)
    expected = reference.as_complex(points)
    for v, step in zip(mesh.topology.schedule(True).vertices.tolist(), wanted, strict=True):
        target = expected[v] + complex(*step)
        expected[v] = reference.allowed(
            expected, v, reference.as_lists(mesh), target, reference.Options(), check_clearance=True
        )
    agree(mesh, xy, expected)


@pytest.mark.nojit
@pytest.mark.parametrize("guard", ["clearance", "quality"])
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
@pytest.mark.parametrize("valence", [3, 4, 5, 6, 8, 11])
def test_one_vertex_of_any_valence_agrees_with_the_reference(valence, kind, guard):
    mesh = random_mesh(f"{kind} fan", valence - 1, seed=valence, amount=1.0).mesh
    good = 0.5 if guard == "quality" else None
    for turn in range(6):  # of the ring, so that the corners differ
        points = mesh.points.copy()
        k = np.arange(1, len(points))
        points[1:] *= 1.0 + 0.15 * np.cos(3.1 * k + turn)[:, None]
        placed = mesh.with_points(points)
        xy, *_ = commit(placed, propose(placed), good=math.nan if good is None else good)
        expected = reference.quad_sweep(
            reference.as_complex(points), reference.as_lists(mesh), [0],
            reference.Options(good=good),
        )  # fmt: skip
        agree(placed, xy, expected)


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
    mesh = random_mesh(kind, 6, seed=12, amount=0.9, turned=0.5).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    own = dict(options)
    share = own.pop("worst_fraction", 1.0)
    worst = min(reference.scaled_jacobian(points, cell) for cell in cells)
    good = max(0.5, worst) if own.pop("guard", "quality") == "quality" else None
    for n in (1, 2, 3):
        active = reference.worst_cells(points, cells, share) if share < 1.0 else None
        settings = reference.Options(**({"step": 0.25} | own), good=good, active=active)
        points = reference.quad_sweep(points, cells, order, settings)
        agree(mesh, smooth(mesh, "quad", max_sweeps=n, rtol=0.0, **options).mesh.xy, points)
