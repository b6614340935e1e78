"""Trees of guard lines: whether a place keeps its clearance from all the lines of a large star.

Each cell round a vertex proposes a place, and each place has to keep its clearance from the lines
of all cells: round a vertex of ten thousand cells that is a hundred million distances a sweep. In a
tree of the lines by their directions a place is compared with bounds of many lines at a time, and
with the few lines themselves that these leave in doubt.
"""

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper
from qsmooth.kernels.blocks import Block
from qsmooth.kernels.guard_rows import LEAST, LINE, LINE_X, LINE_Y
from qsmooth.kernels.lanes import larger, smaller

# Stars of fewer lines, or of fewer for each lane of their block, are asked line by line, all lanes
# together: that is quicker then, by up to 2.5 times.
MANY, MANY_A_LANE = 64, 8
# Lines in a leaf.
LEAF = 8
# Figures of a line, as in `guard_rows`, and of a node: the least distance of its lines, and the
# bounds of their gradients.
OF_LINE, OF_NODE = 3, 5


@helper()
def count_lines(block: Block) -> int:
    """Guard lines of each star of a block."""
    return int(np.int64(3 * block.n_quads + block.n_triangles))


@helper()
def tree_room(n_lines: int) -> int:
    """Floats that the tree of a star takes."""
    return OF_LINE * n_lines + OF_NODE * 2 * ((n_lines + LEAF - 1) // LEAF)


@helper()
def _sector(nx: float, ny: float, n: int) -> int:
    """Sort a direction into one of n sectors; 0 for none."""
    size = abs(nx) + abs(ny)
    if not 0.0 < size < np.inf:
        return 0
    turn = 1.0 - nx / size
    turn = turn if ny >= 0.0 else 4.0 - turn
    return min(int(0.25 * turn * n), n - 1)


@helper()
def _sort_lines(lines: FloatArray, i: int, n: int, trees: FloatArray, at: int) -> None:
    """Write down the lines of lane i sector by sector."""
    sectors, places = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    for k in range(n):
        line = k * LINE + i
        sectors[k] = _sector(lines[line + LINE_X], lines[line + LINE_Y], n)
        places[sectors[k] + 1] += 1
    for k in range(n):
        places[k + 1] += places[k]
    for k in range(n):
        line, to = k * LINE + i, at + OF_LINE * places[sectors[k]]
        trees[to], trees[to + 1] = lines[line], lines[line + LINE_X]
        trees[to + 2] = lines[line + LINE_Y]
        places[sectors[k]] += 1


@helper()
def _bound_nodes(trees: FloatArray, at: int, n: int) -> None:
    """Fill the nodes, from 1 on: node p holds nodes 2 p and 2 p + 1, or is a leaf."""
    n_leaves, nodes = (n + LEAF - 1) // LEAF, at + OF_LINE * n
    for p in range(2 * n_leaves - 1, 0, -1):
        node = nodes + OF_NODE * p
        trees[node] = trees[node + 1] = trees[node + 3] = np.inf
        trees[node + 2] = trees[node + 4] = -np.inf
        first = (p - n_leaves) * LEAF
        for k in range(first, min(first + LEAF, n) if p >= n_leaves else first):
            line = at + OF_LINE * k
            if trees[line] < np.inf:  # no place is too near to a side that has no length
                trees[node] = smaller(trees[line], trees[node])
                trees[node + 1] = smaller(trees[line + 1], trees[node + 1])
                trees[node + 2] = larger(trees[line + 1], trees[node + 2])
                trees[node + 3] = smaller(trees[line + 2], trees[node + 3])
                trees[node + 4] = larger(trees[line + 2], trees[node + 4])
        for child in range(2 * p, 2 * p + 2 if p < n_leaves else 2 * p):
            other = nodes + OF_NODE * child
            trees[node] = smaller(trees[other], trees[node])
            trees[node + 1] = smaller(trees[other + 1], trees[node + 1])
            trees[node + 2] = larger(trees[other + 2], trees[node + 2])
            trees[node + 3] = smaller(trees[other + 3], trees[node + 3])
            trees[node + 4] = larger(trees[other + 4], trees[node + 4])


@helper()
def grow_trees(lines: FloatArray, block: Block) -> FloatArray:
    """Make the trees of a block's stars, if these are large.

    Parameters
    ----------
    lines
        As `clearance.guard_lines` fills it.

    Returns
    -------
    trees : (size * tree_room(n_lines),)
        Lane by lane; (0,) where the stars are not large.
    """
    n, size = count_lines(block), int(np.int64(block.size))
    if n < max(MANY, MANY_A_LANE * size):
        size = 0
    trees = np.empty(size * tree_room(n))
    for i in range(size):
        at = i * tree_room(n)
        _sort_lines(lines, i, n, trees, at)
        _bound_nodes(trees, at, n)
    return trees


@helper()
def _least_distance(trees: FloatArray, node: int, dx: float, dy: float) -> float:
    """Bound the distances from the lines of a node after a move by (dx, dy)."""
    # Rounded as the distances themselves are: rounding keeps order, so that none is below this.
    x: float = trees[node + 1] if dx >= 0.0 else trees[node + 2]
    y: float = trees[node + 3] if dy >= 0.0 else trees[node + 4]
    distance: float = trees[node]
    return distance + (x * dx + y * dy)


@helper()
def keeps_lines(trees: FloatArray, at: int, n: int, dx: float, dy: float, least: float) -> bool:
    """Whether a vertex moved by (dx, dy) is no nearer than `least` to any of the n lines at `at`.

    That is rounded, line by line, as `clearance.keep_clearances` does it.
    """
    n_leaves, nodes = (n + LEAF - 1) // LEAF, at + OF_LINE * n
    p = 1
    while p > 0:
        if not _least_distance(trees, nodes + OF_NODE * p, dx, dy) >= least:
            if p < n_leaves:
                p *= 2
                continue
            first = (p - n_leaves) * LEAF
            for k in range(first, min(first + LEAF, n)):
                line = at + OF_LINE * k
                if trees[line] + (trees[line + 1] * dx + trees[line + 2] * dy) < least:
                    return False
        while p & 1:  # what a right child holds is done with its parent
            p >>= 1
        p += 1 if p > 0 else 0
    return True


@helper()
def ask_trees(
    trees: FloatArray, s: FloatArray, block: Block, x_row: int, y_row: int, kept_row: int
) -> None:
    """Fill a row with what counts as the clearance left by moves: infinite where it is kept.

    Parameters
    ----------
    trees
        As `grow_trees` fills it.
    s
        Scratch, with moves in rows `x_row` and `y_row`, and in LEAST the clearance to keep.
    """
    n = count_lines(block)
    for i in range(int(np.int64(block.size))):
        dx, dy = s[x_row + i], s[y_row + i]
        kept = keeps_lines(trees, i * tree_room(n), n, dx, dy, s[LEAST + i])
        s[kept_row + i] = np.inf if kept else -np.inf
