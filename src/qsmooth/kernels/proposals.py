"""The paper's moves of a quad's corner, and the proposals of all cells of a star.

"Quadrilateral Mesh Smoothing": where a corner's angle is too large or too small, push or pull it
along the normal of its diagonal, shrink or stretch the diagonal, and even out its distances to the
diagonal's ends. In a triangle the opposite edge plays the diagonal.
"""

from typing import NamedTuple

import numpy as np

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper
from qsmooth.kernels.blocks import Block
from qsmooth.kernels.guard_rows import (
    FIRST_KEPT,
    FIRST_X,
    FIRST_Y,
    LEAST,
    LINE,
    LINE2,
    LINE_X,
    LINE_Y,
    LOSS,
    QUAD_LINES,
    SECOND_KEPT,
    SECOND_X,
    SECOND_Y,
    STRIDE,
    SUM_X,
    SUM_Y,
    WEIGHT,
)
from qsmooth.kernels.lanes import ROW, ROW2, ROW3, ROW4, ROW5, ROW6, SX, SY, X, Y, smaller
from qsmooth.kernels.line_trees import ask_trees, grow_trees

# Rows of the thresholds: by kind of cell. Columns: `Limits`.
QUAD, TRIANGLE = 0, 1


def thresholds(
    max_angle: float, min_angle: float, triangle_max_angle: float, triangle_min_angle: float
) -> FloatArray:
    """Tabulate what the moves need of the angle thresholds (degrees), (2, 4).

    Columns: the cosines of the two thresholds, and the height over the diagonal, per length of
    it, at which an isosceles corner has exactly that angle.
    """
    angles = np.radians([[max_angle, min_angle], [triangle_max_angle, triangle_min_angle]])
    with np.errstate(divide="ignore", over="ignore"):  # at an angle of hardly more than 0
        return np.hstack([np.cos(angles), 0.5 / np.tan(0.5 * angles)])


class Limits(NamedTuple):
    """A row of what `thresholds` tabulates."""

    cos_max: float
    cos_min: float
    height_max: float
    height_min: float


@lane_helper()
def _off_limits(height: float, dot: float, edges: float, limits: Limits) -> tuple[bool, bool]:
    """Whether a corner's angle is too large, and whether it is too small."""
    found = edges > 0.0
    large = found & ((height < 0.0) | (dot < limits.cos_max * edges))
    return large, found & (not large) & (dot > limits.cos_min * edges)


@lane_helper()
def _push(
    height: float, length: float, dot: float, edges: float, limits: Limits, step: float
) -> float:
    """How far to move a corner away from its diagonal (negative: towards it); 0 for no proposal."""
    large, small = _off_limits(height, dot, edges, limits)
    way = (limits.height_max if large else limits.height_min) * length - height
    return step * way if (large & (way > 0.0)) | (small & (way < 0.0)) else 0.0


@lane_helper()
def _shrink(
    height: float, length: float, dot: float, edges: float, limits: Limits, step: float
) -> float:
    """How far to move each end of a corner's diagonal towards the other (negative: away)."""
    large, small = _off_limits(height, dot, edges, limits)
    way = length - abs(height) / (limits.height_max if large else limits.height_min)
    shrink, most = 0.5 * step * way, -0.5 * step * length
    shrink = most if small & (shrink < most) else shrink
    return shrink if (large & (way > 0.0)) | (small & (way < 0.0)) else 0.0


@helper()
def _gather_strides(
    s: FloatArray, block: Block, k: int, cells: TableArray, pace: FloatArray, step: float
) -> None:
    """Look up the fraction of its moves that cell k of each star proposes."""
    row = block.rows + k * block.size
    for i in range(block.size):
        s[STRIDE + i] = step * pace[cells[row + i]]


@helper()
def _propose(
    star: FloatArray,
    s: FloatArray,
    lines: FloatArray,
    u: int,
    w: int,
    line: int,
    n: int,
    limits: Limits,
) -> None:
    """Push or pull each vertex between its neighbours in rows u and w of a cell, and even it out.

    The line u→w is its guard line.
    """
    for i in range(n):
        x, y = s[X + i], s[Y + i]
        ux, uy = star[u + i] - x, star[u + ROW + i] - y
        wx, wy = star[w + i] - x, star[w + ROW + i] - y
        height, nx, ny = lines[line + i], lines[line + LINE_X + i], lines[line + LINE_Y + i]
        tx, ty = ny, -nx
        length = (wx - ux) * tx + (wy - uy) * ty
        edges = np.sqrt((ux * ux + uy * uy) * (wx * wx + wy * wy))
        push = _push(height, length, ux * wx + uy * wy, edges, limits, s[STRIDE + i])
        slide = s[STRIDE + i] * 0.5 * ((ux + wx) * tx + (uy + wy) * ty)
        s[FIRST_X + i], s[FIRST_Y + i] = nx * push, ny * push
        s[SECOND_X + i], s[SECOND_Y + i] = tx * slide, ty * slide
        s[FIRST_KEPT + i], s[SECOND_KEPT + i] = np.inf, np.inf


@helper()
def _shrink_diagonals(star: FloatArray, s: FloatArray, at: int, n: int, limits: Limits) -> int:
    """Shrink or stretch the diagonal v→b of a quad (v, a, b, c) for its corners a and c.

    Returns
    -------
    found
        Proposals, of all lanes.
    """
    found = 0
    for i in range(n):
        x, y, step = s[X + i], s[Y + i], s[STRIDE + i]
        ax, ay, bx, by = star[at + i], star[at + ROW + i], star[at + ROW2 + i], star[at + ROW3 + i]
        cx, cy = star[at + ROW4 + i] - x, star[at + ROW5 + i] - y
        ax, ay, bx, by = ax - x, ay - y, bx - x, by - y
        length = np.sqrt(bx * bx + by * by)
        inv = 1.0 / length
        tx, ty = bx * inv, by * inv
        ex, ey, fx, fy = ax - bx, ay - by, cx - bx, cy - by
        edges = np.sqrt((ax * ax + ay * ay) * (ex * ex + ey * ey))
        height = (ax * by - ay * bx) * inv
        at_a = _shrink(height, length, ax * ex + ay * ey, edges, limits, step)
        edges = np.sqrt((cx * cx + cy * cy) * (fx * fx + fy * fy))
        height = (bx * cy - by * cx) * inv
        at_c = _shrink(height, length, cx * fx + cy * fy, edges, limits, step)
        s[FIRST_X + i], s[FIRST_Y + i] = tx * at_a, ty * at_a
        s[SECOND_X + i], s[SECOND_Y + i] = tx * at_c, ty * at_c
        s[FIRST_KEPT + i], s[SECOND_KEPT + i] = np.inf, np.inf
        found += (1 if at_a != 0.0 else 0) + (1 if at_c != 0.0 else 0)
    return found


@lane_helper()
def _nearer(lines: FloatArray, line: int, dx: float, dy: float, kept: float) -> float:
    """Take the clearance from one more line into account."""
    moved = lines[line] + (lines[line + LINE_X] * dx + lines[line + LINE_Y] * dy)
    return smaller(moved, kept)


@helper()
def _keep_quad_lines(lines: FloatArray, s: FloatArray, line: int, n: int) -> None:
    """Keep the least clearances of two proposals from the lines of a quad."""
    for i in range(n):
        dx, dy, kept = s[FIRST_X + i], s[FIRST_Y + i], s[FIRST_KEPT + i]
        kept = _nearer(lines, line + i, dx, dy, kept)
        kept = _nearer(lines, line + LINE + i, dx, dy, kept)
        s[FIRST_KEPT + i] = _nearer(lines, line + LINE2 + i, dx, dy, kept)
        dx, dy, kept = s[SECOND_X + i], s[SECOND_Y + i], s[SECOND_KEPT + i]
        kept = _nearer(lines, line + i, dx, dy, kept)
        kept = _nearer(lines, line + LINE + i, dx, dy, kept)
        s[SECOND_KEPT + i] = _nearer(lines, line + LINE2 + i, dx, dy, kept)


@helper()
def _keep_line(lines: FloatArray, s: FloatArray, line: int, n: int) -> None:
    """Keep the least clearances of two proposals from one line."""
    for i in range(n):
        d, nx, ny = lines[line + i], lines[line + LINE_X + i], lines[line + LINE_Y + i]
        first = d + (nx * s[FIRST_X + i] + ny * s[FIRST_Y + i])
        second = d + (nx * s[SECOND_X + i] + ny * s[SECOND_Y + i])
        s[FIRST_KEPT + i] = smaller(first, s[FIRST_KEPT + i])
        s[SECOND_KEPT + i] = smaller(second, s[SECOND_KEPT + i])


@helper()
def _keep_lines(lines: FloatArray, s: FloatArray, block: Block) -> None:
    """Keep the least clearances of two proposals from all lines."""
    n, quads = block.size, block.n_quads
    for k in range(quads):
        _keep_quad_lines(lines, s, k * QUAD_LINES, n)
    for k in range(block.n_triangles):
        _keep_line(lines, s, quads * QUAD_LINES + k * LINE, n)


@helper()
def _add_kept(s: FloatArray, n: int) -> None:
    """Add the two proposals of each lane that are moves and keep the clearance."""
    for i in range(n):
        least, loss = s[LEAST + i], s[LOSS + i]
        dx, dy = s[FIRST_X + i], s[FIRST_Y + i]
        ex, ey = s[SECOND_X + i], s[SECOND_Y + i]
        moves = dx * dx + dy * dy >= loss * loss
        first = 1.0 if moves & (s[FIRST_KEPT + i] >= least) else 0.0
        moves = ex * ex + ey * ey >= loss * loss
        second = 1.0 if moves & (s[SECOND_KEPT + i] >= least) else 0.0
        s[SUM_X + i] += (dx if first > 0.0 else 0.0) + (ex if second > 0.0 else 0.0)
        s[SUM_Y + i] += (dy if first > 0.0 else 0.0) + (ey if second > 0.0 else 0.0)
        s[WEIGHT + i] += first + second


@helper()
def mean_proposals(
    star: FloatArray,
    s: FloatArray,
    lines: FloatArray,
    block: Block,
    cells: TableArray,
    pace: FloatArray,
    angles: FloatArray,
    step: float,
    by_quad: bool,
) -> None:
    """Average the accepted proposals that the cells around each vertex of a block make for it.

    Each cell pushes or pulls v and evens it out; `by_quad` adds what its two neighbours' corners
    propose to v as an end of their diagonals.

    Parameters
    ----------
    star, s, lines
        Scratch, as `clearance.guard_lines` leaves it; SX and SY are overwritten with the means,
        zero where nothing was accepted.
    block, cells
        As in `blocks.Blocks`.
    pace : (n_cells,)
        Multiple of `step` at which each cell proposes; 0 for a cell that proposes nothing.
    angles : (2, 4)
        As `thresholds` tabulates them.
    step
        Fraction of each move that is proposed, in (0, 1].
    """
    n, quads = block.size, block.n_quads
    for i in range(n):
        s[SUM_X + i], s[SUM_Y + i], s[WEIGHT + i] = 0.0, 0.0, 0.0
    of_quads = Limits(angles[QUAD, 0], angles[QUAD, 1], angles[QUAD, 2], angles[QUAD, 3])
    of_triangles = Limits(
        angles[TRIANGLE, 0], angles[TRIANGLE, 1], angles[TRIANGLE, 2], angles[TRIANGLE, 3]
    )
    count, trees = quads + block.n_triangles, grow_trees(lines, block)
    for k in range(count + quads if by_quad else count):
        cell = k if k < count else k - count
        _gather_strides(s, block, cell, cells, pace, step)
        if k >= count:
            if _shrink_diagonals(star, s, cell * ROW6, n, of_quads) == 0:
                continue
        else:
            u, w, line, asked = cell * ROW6, cell * ROW6 + ROW4, cell * QUAD_LINES, of_quads
            if k >= quads:
                u, line = quads * ROW2 + k * ROW4, quads * LINE2 + k * LINE
                w, asked = u + ROW2, of_triangles
            _propose(star, s, lines, u, w, line, n, asked)
        if trees.size:
            ask_trees(trees, s, block, FIRST_X, FIRST_Y, FIRST_KEPT)
            ask_trees(trees, s, block, SECOND_X, SECOND_Y, SECOND_KEPT)
        else:
            _keep_lines(lines, s, block)
        _add_kept(s, n)
    for i in range(n):
        found = s[WEIGHT + i] > 0.0
        x, y = s[SUM_X + i] / s[WEIGHT + i], s[SUM_Y + i] / s[WEIGHT + i]
        s[SX + i], s[SY + i] = x if found else 0.0, y if found else 0.0
