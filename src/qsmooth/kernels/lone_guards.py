"""The guards of one lane: what a step of one vertex may be, with exact signs and the metric itself.

Slower than all lanes of a block together (`guards`), for the few that are in doubt there.
"""

import math
from typing import NamedTuple

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper, lane_helper, strict_helper
from qsmooth.kernels.blocks import Block
from qsmooth.kernels.confining import confine, confined
from qsmooth.kernels.geometry import (
    certainly_left,
    orientation,
    quad_scaled_jacobian,
    triangle_scaled_jacobian,
)
from qsmooth.kernels.guard_rows import LEAST, LINE, LINE_X, LINE_Y, MOST_RATIO
from qsmooth.kernels.lanes import ROW, ROW0, ROW2, ROW3, ROW4, ROW5, ROW6, SX, SY, X, Y
from qsmooth.kernels.rails import Rails

# The guard lines of a quad and of a triangle by the rows of their ends.
ENDS = ((ROW0, ROW4), (ROW0, ROW2), (ROW2, ROW4))
TRIANGLE_ENDS = (ROW0, ROW2)
# A step that fails is halved this often before the vertex stays.
HALVINGS = 3


class Guard(NamedTuple):
    """What a move has to keep beside its certificate.

    Attributes
    ----------
    good
        The ``"quality"`` guard: the star's smallest scaled Jacobian must not fall, or stay at or
        above this. NaN for no such guard.
    fenced
        Whether the clearance must be kept, from the guard lines.
    even
        Whether the largest ratio of two edges of the star's triangles must be kept.
    """

    good: float
    fenced: bool
    even: bool


@helper()
def keeps_clearance(
    lines: FloatArray, n_lines: int, i: int, dx: float, dy: float, least: float
) -> bool:
    """Whether the vertex of lane i, moved by (dx, dy), is no nearer than `least` to any line."""
    for k in range(n_lines):
        line = k * LINE + i
        moved = lines[line] + (lines[line + LINE_X] * dx + lines[line + LINE_Y] * dy)
        if not moved >= least:
            return False
    return True


@strict_helper()
def keeps_corners(
    star: FloatArray, block: Block, i: int, vx: float, vy: float, x: float, y: float
) -> bool:
    """Whether every positive corner that a vertex at (vx, vy) sees is certified so at (x, y).

    A corner that is not positive now has nothing to lose.
    """
    quads = block.n_quads
    for line in range(3 * quads + block.n_triangles):
        first, last = TRIANGLE_ENDS
        at = line * ROW4 - quads * ROW6  # as those of the quads come first
        if line < 3 * quads:
            at = line // 3 * ROW6
            first, last = ENDS[line % 3]
        px, py = star[at + first + i], star[at + first + ROW + i]
        qx, qy = star[at + last + i], star[at + last + ROW + i]
        if not certainly_left(px, py, qx, qy, x, y) and orientation(px, py, qx, qy, vx, vy) > 0:
            return False
    return True


@helper()
def star_scaled_jacobian(star: FloatArray, block: Block, i: int, x: float, y: float) -> float:
    """Smallest scaled Jacobian of the cells of lane i with their vertex at (x, y)."""
    worst = np.inf
    for k in range(block.n_quads):
        at = k * ROW6 + i
        ax, ay, bx, by = star[at], star[at + ROW], star[at + ROW2], star[at + ROW3]
        score = quad_scaled_jacobian(x, y, ax, ay, bx, by, star[at + ROW4], star[at + ROW5])
        worst = min(worst, score)
    for k in range(block.n_triangles):
        at = block.n_quads * ROW6 + k * ROW4 + i
        ax, ay, cx, cy = star[at], star[at + ROW], star[at + ROW2], star[at + ROW3]
        worst = min(worst, triangle_scaled_jacobian(x, y, ax, ay, cx, cy))
    return worst


@lane_helper()
def edge_ratio(star: FloatArray, at: int, i: int, x: float, y: float) -> float:
    """Largest ratio of two edges of the triangle in row `at`, squared, with v at (x, y)."""
    ax, ay = star[at + i] - x, star[at + ROW + i] - y
    cx, cy = star[at + ROW2 + i] - x, star[at + ROW3 + i] - y
    va, vc = ax * ax + ay * ay, cx * cx + cy * cy
    ac = (cx - ax) * (cx - ax) + (cy - ay) * (cy - ay)
    shortest = min(va, vc, ac)
    return max(va, vc, ac) / shortest if shortest > 0.0 else np.inf


@helper()
def star_edge_ratio(star: FloatArray, block: Block, i: int, x: float, y: float) -> float:
    """Largest such ratio of all triangles of lane i; 1 where there is none."""
    largest = 1.0
    for k in range(block.n_triangles):
        largest = max(largest, edge_ratio(star, block.n_quads * ROW6 + k * ROW4, i, x, y))
    return largest


@helper()
def _allowed_part(
    star: FloatArray,
    lines: FloatArray,
    block: Block,
    n_lines: int,
    i: int,
    x: float,
    y: float,
    dx: float,
    dy: float,
    good: float,
    least: float,
    v: int,
    rails: Rails,
) -> float:
    """Find the first of 1, a half, a quarter and an eighth of the step that all guards allow."""
    present = np.nan  # the present quality, once it is needed
    part = 1.0
    for _ in range(HALVINGS + 1):
        new_x, new_y = x + part * dx, y + part * dy
        way_x, way_y = part * dx, part * dy
        if confined(rails):
            new_x, new_y = confine(v, new_x, new_y, rails)
            way_x, way_y = new_x - x, new_y - y
        if (
            (new_x != x or new_y != y)
            and keeps_clearance(lines, n_lines, i, way_x, way_y, least)
            and keeps_corners(star, block, i, x, y, new_x, new_y)
        ):
            if math.isnan(good):
                return part
            enough = good if math.isnan(present) else min(good, present)
            score = star_scaled_jacobian(star, block, i, new_x, new_y)
            if score >= enough:
                return part
            if math.isnan(present):
                present = star_scaled_jacobian(star, block, i, x, y)
                if score >= present:
                    return part
        part *= 0.5
    return 0.0


@helper()
def lone_step(
    star: FloatArray,
    s: FloatArray,
    lines: FloatArray,
    block: Block,
    guard: Guard,
    i: int,
    v: int,
    rails: Rails,
) -> tuple[float, float]:
    """Take as much of the step of lane i, where vertex v is, as all its guards allow.

    Parameters
    ----------
    star, s, lines, block, guard, rails
        As in `guards.guarded_moves`.

    Returns
    -------
    x, y
        The place to store: the present one where no step is allowed.
    """
    x, y, dx, dy = s[X + i], s[Y + i], s[SX + i], s[SY + i]
    n_lines = 3 * block.n_quads + block.n_triangles if guard.fenced else block.size - block.size
    for _ in range(HALVINGS + 1):
        part = _allowed_part(
            star, lines, block, n_lines, i, x, y, dx, dy, guard.good, s[LEAST + i], v, rails
        )
        if part == 0.0:
            return x, y
        new_x, new_y = x + part * dx, y + part * dy
        if confined(rails):
            new_x, new_y = confine(v, new_x, new_y, rails)
        if star_edge_ratio(star, block, i, new_x, new_y) <= s[MOST_RATIO + i]:
            return new_x, new_y
        # By powers of two alone, so that the bits are those of all lanes together.
        dx, dy = 0.5 * part * dx, 0.5 * part * dy
    return x, y
