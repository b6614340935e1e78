"""Trees of guard lines: the answer of each line by itself, to the bit."""

import numpy as np
import pytest

from qsmooth import Mesh, smooth
from qsmooth.kernels.blocks import LANES, Block
from qsmooth.kernels.clearance import keep_clearances
from qsmooth.kernels.guard_rows import KEPT, LEAST, N_GUARD_ROWS
from qsmooth.kernels.lanes import SX, SY
from qsmooth.kernels.line_trees import ask_trees, grow_trees
from shapes import fan

DIRECTIONS = {
    "all around": (0.0, 2.0 * np.pi),
    "nearly one": (0.7, 0.7 + 1e-9),
    "along an axis": (np.pi, np.pi),
}


def lines_of(n, spread, seed):
    """Lines of one star, (n, 3), a few without length, and moves to ask, (40, 2)."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(*spread, n)
    found = np.column_stack([rng.uniform(1.0, 1.1, n), np.cos(angles), np.sin(angles)])
    found[rng.integers(0, n, 3)] = np.inf, 0.0, 0.0
    moves = rng.uniform(-0.1, 0.1, (40, 2)) * 10.0 ** rng.uniform(-9, 0, (40, 1))
    moves[:2] = (0.0, 0.0), (np.nan, 1.0)
    return found, moves


@pytest.mark.nojit
@pytest.mark.parametrize("spread", DIRECTIONS.values(), ids=DIRECTIONS.keys())
@pytest.mark.parametrize("n", [64, 65, 71, 200, 1000])
def test_a_tree_says_what_all_lines_say(n, spread):
    n_lanes = 2
    block = Block(*np.array([0, n_lanes, 0, n, 0, 0], np.uint64))
    lines, s = np.full(3 * LANES * n, np.nan), np.full(N_GUARD_ROWS * LANES, np.nan)
    for lane in range(n_lanes):
        found, moves = lines_of(n, spread, seed=n + lane)
        lines.reshape(n, 3, LANES)[:, :, lane] = found
    trees = grow_trees(lines, block)
    assert trees.size
    answers, ones = set(), np.ones(n_lanes)
    for dx, dy in moves:
        s[int(SX) : int(SX) + n_lanes], s[int(SY) : int(SY) + n_lanes] = dx, dy
        keep_clearances(lines, s, block, 1.0)
        kept = s[int(KEPT) : int(KEPT) + n_lanes].copy()
        # What is just kept, what is just not, and all else.
        for least in (kept, np.nextafter(kept, np.inf), np.nextafter(kept, -np.inf), ones):
            s[int(LEAST) : int(LEAST) + n_lanes] = least
            ask_trees(trees, s, block, SX, SY, KEPT)
            told = s[int(KEPT) : int(KEPT) + n_lanes] >= least
            assert told.tolist() == (kept >= least).tolist()
            answers |= set(told.tolist())
    assert answers == {False, True}


@pytest.mark.nojit
def test_ordinary_stars_are_asked_line_by_line():
    for size, n_quads, n_triangles in ((1, 21, 0), (64, 0, 511), (64, 170, 0)):
        block = Block(*np.array([0, size, n_quads, n_triangles, 0, 0], np.uint64))
        assert grow_trees(np.empty(0), block).size == 0


@pytest.mark.parametrize(
    ("name", "kind"),
    [(n, k) for n in ("star", "quad") for k in ("triangle", "quad")]
    + [("aspect-ratio", "triangle")],
)
def test_one_star_ends_where_each_of_many_does_that_are_asked_line_by_line(name, kind):
    # A block of 64 lanes has no trees at 100 cells; a lone lane has.
    alone, rng = fan(100, kind), np.random.default_rng(100)
    points, rough = alone.points.copy(), 0.1 if kind == "triangle" else 0.03
    points[1:] *= rng.uniform(1.0 - rough, 1.0 + rough, (len(points) - 1, 1))
    cells = rng.permutation(alone.cells[0])
    many = np.vstack([cells + k * len(points) for k in range(LANES)])
    options = {"max_sweeps": 20, "rtol": 0.0, "threads": 1}
    for guard in ("clearance", "quality"):
        one = smooth(Mesh(points, [cells]), name, guard=guard, **options)
        together = smooth(Mesh(np.tile(points, (LANES, 1)), [many]), name, guard=guard, **options)
        assert np.any(one.points[0] != points[0])
        assert together.points.tobytes() == np.tile(one.points, (LANES, 1)).tobytes()
