"""What counts as keeping the clearance: by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from meshes import KINDS, grid, random_mesh
from qsmooth import Constraints, Mesh
from qsmooth.kernels import clearance, guards, lanes, lone_guards
from qsmooth.kernels.blocks import LANES, Block, build_blocks
from qsmooth.kernels.guard_rows import (
    LEAST,
    LOSS,
    MOST_RATIO,
    N_GUARD_ROWS,
    ROWS_OF_LINES,
    SHORTEST,
)
from qsmooth.kernels.lanes import SX, SY, X, Y
from qsmooth.kernels.lone_guards import Guard
from qsmooth.kernels.quad import guarded_commit
from qsmooth.kernels.stars import Moves

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize(
    ("longest", "largest", "expected"),
    [
        (2.0, 3.0, 2e-12),
        (1e-6, 6e6, 2.0**-26),  # 16 times the 2^-30 between numbers near 6e6
        (1.0, 4096.0, 2.0**-36),
        (0.0, 1.0, 2.0**-48),
    ],
)
def test_tolerated_loss(longest, largest, expected):
    assert clearance.tolerated_loss(longest, largest) == pytest.approx(expected, rel=1e-12)
    assert clearance.tolerated_loss(2.0**40 * longest, 2.0**40 * largest) == pytest.approx(
        2.0**40 * expected, rel=1e-12
    )


@given(st.floats(1e-30, 1e30))
def test_tolerated_loss_of_a_point_is_16_spacings(largest):
    assert clearance.tolerated_loss(0.0, largest) == 16.0 * math.ulp(largest)


def commit(mesh, step):
    xy, moves = mesh.xy.copy(), Moves(*np.empty((2, 1)))
    blocks = build_blocks(mesh.topology.schedule(True))
    guarded_commit(xy, blocks, (0, 1), np.array([step]), math.nan, moves)
    return xy[4] - mesh.xy[4]


@pytest.mark.parametrize(("shift", "tau"), [(0.0, 1e-12), (6e6, 2.0**-26)])
def test_clearance_may_fall_by_the_tolerated_loss_and_no_more(shift, tau):
    # The centre of four squares goes straight at the nearest guard line, a diagonal.
    points, cells = grid(2, 2)
    mesh = Mesh(points + shift, cells)
    assert (commit(mesh, np.array([-0.9, -0.9]) * tau / math.sqrt(2)) < 0.0).all()
    # An eighth of 8.8 τ is over τ: not even the third halving is short enough.
    assert not commit(mesh, np.array([-8.8, -8.8]) * tau / math.sqrt(2)).any()
    # The same the other way: clearance from the opposite diagonal falls.
    assert not commit(mesh, np.array([8.8, 8.8]) * tau / math.sqrt(2)).any()


def gathered(mesh, steps=None):
    """Each block of a mesh with its scratch: its vertices, star, rows and guard lines."""
    blocks = build_blocks(mesh.topology.schedule(True))
    for b in range(len(blocks.table)):
        block = Block(*blocks.table[b])
        star, s = np.empty(6 * blocks.largest * LANES), np.full(N_GUARD_ROWS * LANES, np.nan)
        lines = np.empty(ROWS_OF_LINES * blocks.largest * LANES)
        lanes.gather_stars(mesh.xy, blocks.vertices, blocks.stars, block, star, s)
        clearance.guard_lines(star, s, block, lines)
        first = int(block.first)
        of_block = blocks.vertices[first : first + int(block.size)]
        yield block, of_block.tolist(), star, s, lines


def row(array, k, lane):
    """Of row k of an array of rows of lanes."""
    return float(array[int(k) + lane])


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_lines_and_clearance_are_those_of_the_reference(kind):
    mesh = random_mesh(kind, 5, seed=8, amount=1.0, turned=0.5, shift=(-3.0, 100.0)).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    seen = []
    for block, vertices, _, s, lines in gathered(mesh):
        n_lines = int(3 * block.n_quads + block.n_triangles)
        for lane, v in enumerate(vertices):
            expected = reference.guard_lines(points, v, cells)
            found = [row(lines, 3 * LANES * k, lane) for k in range(n_lines)]
            assert sorted(found) == pytest.approx(
                sorted(reference.left_of(p, q, points[v]) for p, q in expected), abs=1e-12
            )
            tau = reference.tolerance(points, v, cells)
            assert row(s, LOSS, lane) == pytest.approx(tau)
            least = reference.clearance(expected, points[v]) - tau
            assert row(s, LEAST, lane) == pytest.approx(least, abs=1e-12)
            ring = reference.rings(cells, mesh.n_vertices)[v]
            shortest = min(abs(points[w] - points[v]) for w in ring)
            assert row(s, SHORTEST, lane) == pytest.approx(shortest)
            seen.append(v)
    assert sorted(seen) == sorted(mesh.topology.schedule(True).vertices.tolist())


def test_a_line_of_no_length_is_left_out():
    points, cells = grid(2, 2)
    points[5] = points[2]  # the lower right square loses a side
    mesh = Mesh(points, cells)
    ((_, _, _, s, lines),) = gathered(mesh)
    distances = [row(lines, 3 * LANES * k, 0) for k in range(12)]
    assert distances.count(math.inf) == 1
    kept = reference.guard_lines(reference.as_complex(points), 4, reference.as_lists(mesh))
    assert len(kept) == 11
    assert row(s, LEAST, 0) == pytest.approx(reference.clearance(kept, complex(*points[4])))


# ------------------------------------------------------------------------------- lanes and alone

# Every other vertex may only move along a line.
SOME = np.array([[0.6, 0.8], [np.nan, np.nan]] * 50)


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("good", [math.nan, 0.5, 0.9])
@pytest.mark.parametrize("tangled", [0.0, 0.7])
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
@pytest.mark.parametrize("constraints", [{}, {"max_move_share": 0.1, "directions": SOME}])
def test_all_lanes_together_take_the_steps_that_each_takes_alone(
    constraints, kind, tangled, good, even
):
    # Steps of all lengths, and some of none, on a mesh that is valid and on one that is not: whole,
    # halved and refused ones are met, and lanes in doubt.
    mesh = random_mesh(kind, 6, seed=8, amount=0.9, turned=0.5).mesh
    rng = np.random.default_rng(5)
    shake = tangled * rng.uniform(-1.0, 1.0, mesh.points.shape) * ~mesh.is_boundary[:, None]
    mesh = mesh.with_points(mesh.points + shake)
    if constraints:
        constraints = {**constraints, "directions": constraints["directions"][: mesh.n_vertices]}
    rails = Constraints(**constraints).freedom(mesh).rails()
    shares = []
    for block, vertices, star, s, lines in gathered(mesh):
        n = int(block.size)
        steps = rng.normal(size=(2, n)) * 10.0 ** rng.uniform(-17.0, 0.5, n)
        steps[:, rng.uniform(size=n) < 0.1] = 0.0
        s[int(SX) : int(SX) + n], s[int(SY) : int(SY) + n] = steps
        for lane in range(n):
            place = row(s, X, lane), row(s, Y, lane)
            present = lone_guards.star_edge_ratio(star, block, np.uint64(lane), *place)
            s[int(MOST_RATIO) + lane] = max(4.0, present) if even else math.inf
        guard = Guard(good, True, even)
        places = [
            lone_guards.lone_step(
                star, s, lines, block, guard, np.uint64(lane), np.uint32(vertices[lane]), rails
            )
            for lane in range(n)
        ]
        xy, lengths, of_edges = mesh.xy.copy(), np.empty(n), np.empty(n)
        ids, own = np.array(vertices, np.uint32), block._replace(first=np.uint64(0))
        guards.guarded_moves(xy, ids, own, guard, star, s, lines, rails, lengths, of_edges)
        assert np.array_equal(xy[vertices], places)
        assert lengths == pytest.approx(np.hypot(*(xy - mesh.xy)[vertices].T))
        others = np.delete(np.arange(mesh.n_vertices), vertices)
        assert np.array_equal(xy[others], mesh.xy[others])
        wanted = np.hypot(*steps)
        shares.extend((lengths[wanted > 1e-9] / wanted[wanted > 1e-9]).round(3))
    assert 0.0 in shares
    assert max(shares) > 0.0 if constraints else 1.0 in shares
