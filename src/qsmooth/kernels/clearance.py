"""Guard lines and clearances, on blocks of lanes.

The guard lines of a vertex v are, in each cell (v, a, b, c) or (v, a, c) around it, a→c, and in a
quad also a→b and b→c: the corners that v takes part in are convex exactly when v is on the left of
all of them. Its clearance is the smallest signed distance to one. As a minimum of linear functions
it is concave, so that the mean of places that each keep the clearance keeps it too.
"""

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper, lane_helper
from qsmooth.kernels.blocks import Block
from qsmooth.kernels.guard_rows import (
    KEPT,
    LARGEST,
    LEAST,
    LINE,
    LINE2,
    LINE_X,
    LINE_Y,
    LONGEST,
    LOSS,
    QUAD_LINES,
    SHORTEST,
)
from qsmooth.kernels.lanes import (
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
    ROW6,
    SX,
    SY,
    X,
    Y,
    larger,
    smaller,
)

# A clearance may fall by this fraction of the longest edge, or by this many units in the last place
# of the star's largest coordinate: a vertex that slides along its nearest guard line is not to be
# stopped, or let go, by rounding.
CLEARANCE_RTOL = 1e-12
CLEARANCE_ULPS = 16.0
# x · UNIT_OF - x · UNIT_OF · BELOW_ONE is the largest power of two in x: S. M. Rump, T. Ogita,
# S. Oishi, "Accurate floating-point summation", SIAM J. Sci. Comput. 31 (2008), algorithm 3.5.
UNIT_OF, BELOW_ONE, EPSILON = 2.0**52 + 1.0, 1.0 - 2.0**-53, 2.0**-52


@lane_helper()
def tolerated_loss(longest: float, largest: float) -> float:
    """How far a clearance may fall and still count as kept: see `CLEARANCE_RTOL`."""
    scaled = UNIT_OF * largest
    by_rounding = CLEARANCE_ULPS * EPSILON * abs(scaled - BELOW_ONE * scaled)
    by_length = CLEARANCE_RTOL * longest
    return by_length if by_length > by_rounding else by_rounding


@lane_helper()
def _write_line(lines: FloatArray, line: int, px: float, py: float, qx: float, qy: float) -> float:
    """Write down the line p→q, given relative to v, and give its distance."""
    ex, ey = qx - px, qy - py
    length = np.sqrt(ex * ex + ey * ey)
    inv = 1.0 / length
    distance = (px * qy - py * qx) * inv
    inv = inv if length > 0.0 else 0.0
    distance = distance if length > 0.0 else np.inf
    lines[line] = distance
    lines[line + LINE_X] = -ey * inv
    lines[line + LINE_Y] = ex * inv
    return distance


@helper()
def guard_lines(star: FloatArray, s: FloatArray, block: Block, lines: FloatArray) -> None:
    """Fill `lines`, and find the clearance to keep, the tolerated loss and the shortest edges.

    Parameters
    ----------
    star, s
        Scratch, as `lanes.gather_stars` fills it.
    lines : (9 * LANES * cells in the star,)
        Overwritten.
    """
    n, quads = block.size, block.n_quads
    for i in range(n):
        s[LEAST + i], s[SHORTEST + i], s[LONGEST + i] = np.inf, np.inf, 0.0
        s[LARGEST + i] = larger(abs(s[X + i]), abs(s[Y + i]))
    for k in range(quads):
        at, line = k * ROW6, k * QUAD_LINES
        for i in range(n):
            x, y = s[X + i], s[Y + i]
            ax, ay = star[at + i], star[at + ROW + i]
            bx, by = star[at + ROW2 + i], star[at + ROW3 + i]
            cx, cy = star[at + ROW4 + i], star[at + ROW5 + i]
            at_a, at_b = larger(abs(ax), abs(ay)), larger(abs(bx), abs(by))
            largest = larger(larger(at_a, at_b), larger(abs(cx), abs(cy)))
            s[LARGEST + i] = larger(largest, s[LARGEST + i])
            ax, ay, bx, by, cx, cy = ax - x, ay - y, bx - x, by - y, cx - x, cy - y
            va, vc = ax * ax + ay * ay, cx * cx + cy * cy
            s[LONGEST + i] = larger(larger(va, vc), s[LONGEST + i])
            s[SHORTEST + i] = smaller(smaller(va, vc), s[SHORTEST + i])
            least = smaller(_write_line(lines, line + i, ax, ay, cx, cy), s[LEAST + i])
            least = smaller(_write_line(lines, line + LINE + i, ax, ay, bx, by), least)
            s[LEAST + i] = smaller(_write_line(lines, line + LINE2 + i, bx, by, cx, cy), least)
    for k in range(block.n_triangles):
        at, line = quads * ROW6 + k * ROW4, quads * QUAD_LINES + k * LINE
        for i in range(n):
            x, y = s[X + i], s[Y + i]
            ax, ay = star[at + i], star[at + ROW + i]
            cx, cy = star[at + ROW2 + i], star[at + ROW3 + i]
            largest = larger(larger(abs(ax), abs(ay)), larger(abs(cx), abs(cy)))
            s[LARGEST + i] = larger(largest, s[LARGEST + i])
            ax, ay, cx, cy = ax - x, ay - y, cx - x, cy - y
            va, vc = ax * ax + ay * ay, cx * cx + cy * cy
            s[LONGEST + i] = larger(larger(va, vc), s[LONGEST + i])
            s[SHORTEST + i] = smaller(smaller(va, vc), s[SHORTEST + i])
            s[LEAST + i] = smaller(_write_line(lines, line + i, ax, ay, cx, cy), s[LEAST + i])
    for i in range(n):
        loss = tolerated_loss(np.sqrt(s[LONGEST + i]), s[LARGEST + i])
        s[LOSS + i] = loss
        s[LEAST + i] -= loss
        s[SHORTEST + i] = np.sqrt(s[SHORTEST + i])


@helper()
def keep_clearances(lines: FloatArray, s: FloatArray, block: Block, fraction: float) -> None:
    """Find the clearances that are left after a fraction of each step."""
    n = block.size
    for i in range(n):
        s[KEPT + i] = np.inf
    for k in range(3 * block.n_quads + block.n_triangles):
        line = k * LINE
        for i in range(n):
            dx, dy = fraction * s[SX + i], fraction * s[SY + i]
            moved = lines[line + i] + (
                lines[line + LINE_X + i] * dx + lines[line + LINE_Y + i] * dy
            )
            s[KEPT + i] = smaller(moved, s[KEPT + i])
