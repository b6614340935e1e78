"""What every guarded method asks of a move, on blocks of lanes: clearance, certificate, quality.

The guard lines of a vertex v are, in each cell (v, a, b, c) or (v, a, c) around it, a→c, and in a
quad also a→b and b→c: the corners that v takes part in are convex exactly when v is on the left of
all of them. Its clearance is the smallest signed distance to one. As a minimum of linear functions
it is concave, so that the mean of places that each keep the clearance keeps it too.

All lanes of a block are tried together. Their certificates are those of `geometry`; the scores are
squared and rounded otherwise than those of the metric, so that a lane whose score is within
`SCORE_ROUNDING` of what is asked, or which has a corner of no certain sign, is asked again in
`lone_guards`, where what is exact is exact.
"""

import math

import numpy as np

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper
from qsmooth.kernels.blocks import Block
from qsmooth.kernels.geometry import certainly_positive
from qsmooth.kernels.guard_rows import (
    BY_RATIO,
    CERTAIN,
    ENOUGH,
    KEPT,
    LARGEST,
    LEAST,
    LINE,
    LINE2,
    LINE_X,
    LINE_Y,
    LONE,
    LONGEST,
    LOSS,
    MOST_RATIO,
    NEW_X,
    NEW_Y,
    QUAD_LINES,
    RATIO,
    SCORE,
    SHORTEST,
    WAS_CERTAIN,
)
from qsmooth.kernels.lanes import (
    PX,
    PY,
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
    ROW6,
    SX,
    SY,
    TODO,
    X,
    Y,
)
from qsmooth.kernels.lone_guards import Guard, edge_ratio, lone_step

# A clearance may fall by this fraction of the longest edge, or by this many units in the last place
# of the star's largest coordinate: a vertex that slides along its nearest guard line is not to be
# stopped, or let go, by rounding.
CLEARANCE_RTOL = 1e-12
CLEARANCE_ULPS = 16.0
# What is tried: the whole steps, against what is good in itself; where the vertices are, to ask for
# no more than that; and the steps again, halved until the vertex stays.
TRIALS = (1.0, 0.0, 1.0, 0.5, 0.25, 0.125)
PRESENT = 1
N_HALVED = len(TRIALS) - PRESENT - 1
# Up to so many lanes of a block that want another try are tried one by one.
FEW = 4
# More than the rounding errors of the square of a score, here and in the metric.
SCORE_ROUNDING = 1e-13
# The squares of edges below this count as 0 here: a quotient by one could be all rounding.
LEAST_SQUARE = 1e-280
# The square of a triangle's best sine.
THREE_QUARTERS = 0.75
# x · UNIT_OF - x · UNIT_OF · BELOW_ONE is the largest power of two in x: S. M. Rump, T. Ogita,
# S. Oishi, "Accurate floating-point summation", SIAM J. Sci. Comput. 31 (2008), algorithm 3.5.
UNIT_OF, BELOW_ONE, EPSILON = 2.0**52 + 1.0, 1.0 - 2.0**-53, 2.0**-52


# ------------------------------------------------------------------------------- guard lines


@lane_helper()
def tolerated_loss(longest: float, largest: float) -> float:
    """How far a clearance may fall and still count as kept: see `CLEARANCE_RTOL`."""
    scaled = UNIT_OF * largest
    by_rounding = CLEARANCE_ULPS * EPSILON * abs(scaled - BELOW_ONE * scaled)
    by_length = CLEARANCE_RTOL * longest
    return by_length if by_length > by_rounding else by_rounding


@lane_helper()
def smaller(a: float, b: float) -> float:
    """Take the smaller, and b where one is NaN."""
    return a if a < b else b


@lane_helper()
def larger(a: float, b: float) -> float:
    """Take the larger, and b where one is NaN."""
    return a if a > b else b


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


# ------------------------------------------------------------------------------- trials


@lane_helper()
def _one_over(square: float) -> float:
    return 1.0 / square if square > LEAST_SQUARE else 0.0


@lane_helper()
def _squared_sine(det: float, inv: float, other: float) -> float:
    """Square of a sine with its sign, given one over the squares of the edges."""
    return (det * inv) * (abs(det) * other)


@lane_helper()
def _judge_corner(
    left: float, right: float, inv: float, other: float, s: FloatArray, i: int
) -> None:
    """Keep the certificate and the least score of a quad's corner."""
    s[CERTAIN + i] = s[CERTAIN + i] if certainly_positive(left, right) else 0.0
    s[SCORE + i] = smaller(_squared_sine(left - right, inv, other), s[SCORE + i])


@helper()
def _try(star: FloatArray, s: FloatArray, block: Block, fraction: float) -> None:
    """Put the vertices at a fraction of their steps; certify and score what they see."""
    n, quads = block.size, block.n_quads
    for i in range(n):
        s[PX + i] = s[X + i] + fraction * s[SX + i]
        s[PY + i] = s[Y + i] + fraction * s[SY + i]
        s[CERTAIN + i], s[SCORE + i] = 1.0, np.inf
    for k in range(quads):
        at = k * ROW6
        for i in range(n):
            px, py = s[PX + i], s[PY + i]
            ax, ay, bx, by = (
                star[at + i],
                star[at + ROW + i],
                star[at + ROW2 + i],
                star[at + ROW3 + i],
            )
            cx, cy = star[at + ROW4 + i], star[at + ROW5 + i]
            ux, uy, wx, wy = ax - px, ay - py, cx - px, cy - py
            ex, ey, fx, fy = bx - ax, by - ay, bx - cx, by - cy
            u, w = _one_over(ux * ux + uy * uy), _one_over(wx * wx + wy * wy)
            e, f = _one_over(ex * ex + ey * ey), _one_over(fx * fx + fy * fy)
            _judge_corner(ux * wy, uy * wx, u, w, s, i)
            _judge_corner(ey * ux, ex * uy, u, e, s, i)
            _judge_corner(fx * wy, fy * wx, w, f, s, i)
    for k in range(block.n_triangles):
        at = quads * ROW6 + k * ROW4
        for i in range(n):
            px, py = s[PX + i], s[PY + i]
            ax, ay, cx, cy = (
                star[at + i],
                star[at + ROW + i],
                star[at + ROW2 + i],
                star[at + ROW3 + i],
            )
            ux, uy, wx, wy, ex, ey = ax - px, ay - py, cx - px, cy - py, cx - ax, cy - ay
            u, w = _one_over(ux * ux + uy * uy), _one_over(wx * wx + wy * wy)
            e = _one_over(ex * ex + ey * ey)
            left, right = ux * wy, uy * wx
            s[CERTAIN + i] = s[CERTAIN + i] if certainly_positive(left, right) else 0.0
            at_v = _squared_sine(left - right, u, w)
            # Not all by one determinant: beside a short edge it has the rounding of the long ones.
            at_a = _squared_sine(ey * ux - ex * uy, u, e)
            at_c = _squared_sine(ey * wx - ex * wy, w, e)
            least = smaller(smaller(at_v, at_a), at_c)
            s[SCORE + i] = smaller(least / THREE_QUARTERS, s[SCORE + i])


@helper()
def _ask_no_more(star: FloatArray, s: FloatArray, block: Block) -> None:
    """Ask for no more than what was found where the vertices are, and in the corners opposite."""
    n = block.size
    for k in range(block.n_quads):
        at = k * ROW6
        for i in range(n):
            ax, ay, bx, by = (
                star[at + i],
                star[at + ROW + i],
                star[at + ROW2 + i],
                star[at + ROW3 + i],
            )
            cx, cy = star[at + ROW4 + i], star[at + ROW5 + i]
            ex, ey, fx, fy = ax - bx, ay - by, cx - bx, cy - by
            e, f = _one_over(ex * ex + ey * ey), _one_over(fx * fx + fy * fy)
            s[SCORE + i] = smaller(_squared_sine(fx * ey - fy * ex, e, f), s[SCORE + i])
    for i in range(n):
        s[WAS_CERTAIN + i] = s[CERTAIN + i]
        s[ENOUGH + i] = smaller(s[SCORE + i], s[ENOUGH + i])


@helper()
def judge_ratios(star: FloatArray, s: FloatArray, block: Block) -> None:
    """Find the largest ratio of two edges of a triangle, squared, at the trial places."""
    for i in range(block.size):
        s[RATIO + i] = 1.0
    for k in range(block.n_triangles):
        at = block.n_quads * ROW6 + k * ROW4
        for i in range(block.size):
            s[RATIO + i] = larger(edge_ratio(star, at, i, s[PX + i], s[PY + i]), s[RATIO + i])


@helper()
def _accept(s: FloatArray, n: int) -> int:
    """Take the trial places that all guards allow for certain; count the lanes that try on."""
    left = 0
    for i in range(n):
        px, py = s[PX + i], s[PY + i]
        todo = (s[TODO + i] > 0.0) & ((px != s[X + i]) | (py != s[Y + i]))
        good = (s[CERTAIN + i] > 0.0) & (s[SCORE + i] > s[ENOUGH + i] + SCORE_ROUNDING)
        good &= todo & (s[KEPT + i] >= s[LEAST + i]) & (s[RATIO + i] <= s[MOST_RATIO + i])
        s[NEW_X + i] = px if good else s[NEW_X + i]
        s[NEW_Y + i] = py if good else s[NEW_Y + i]
        s[TODO + i] = 1.0 if todo & (not good) else 0.0
        left += 1 if todo & (not good) else 0
    return left


@helper()
def _part_doubts(s: FloatArray, n: int) -> None:
    """Set the lanes apart that were not refused for certain."""
    for i in range(n):
        lost = (s[CERTAIN + i] == 0.0) & (s[WAS_CERTAIN + i] > 0.0)
        lost |= (s[SCORE + i] < s[ENOUGH + i] - SCORE_ROUNDING) | (s[KEPT + i] < s[LEAST + i])
        kept = (s[CERTAIN + i] > 0.0) & (s[SCORE + i] > s[ENOUGH + i] + SCORE_ROUNDING)
        uneven = kept & (s[KEPT + i] >= s[LEAST + i]) & (s[RATIO + i] > s[MOST_RATIO + i])
        doubt = (s[TODO + i] > 0.0) & (not lost) & (not uneven)
        s[BY_RATIO + i] += 1.0 if uneven else 0.0
        s[LONE + i] = 1.0 if doubt else s[LONE + i]
        s[TODO + i] = 0.0 if doubt else s[TODO + i]


@helper()
def _want(s: FloatArray, n: int, guard: Guard) -> int:
    """Get ready to try the steps of a block; count the lanes that have one."""
    enough = -np.inf if math.isnan(guard.good) else guard.good * abs(guard.good)
    left = 0
    for i in range(n):
        s[NEW_X + i], s[NEW_Y + i] = s[X + i], s[Y + i]
        s[LONE + i], s[BY_RATIO + i] = 0.0, 0.0
        todo = (s[SX + i] != 0.0) | (s[SY + i] != 0.0)
        s[TODO + i] = 1.0 if todo else 0.0
        left += 1 if todo else 0
        s[ENOUGH + i] = enough
    if not guard.fenced:
        for i in range(n):
            s[KEPT + i], s[LEAST + i] = 0.0, 0.0
    if not guard.even:
        for i in range(n):
            s[RATIO + i], s[MOST_RATIO + i] = 1.0, np.inf
    return left


@helper()
def _store(
    xy: FloatArray,
    vertices: TableArray,
    first: int,
    n: int,
    s: FloatArray,
    lengths: FloatArray,
    shares: FloatArray,
) -> None:
    """Put the vertices at their new places, and measure the moves."""
    for i in range(n):
        dx, dy = s[NEW_X + i] - s[X + i], s[NEW_Y + i] - s[Y + i]
        length = np.sqrt(dx * dx + dy * dy)
        share = length / s[SHORTEST + i]
        lengths[first + i] = length
        shares[first + i] = share if length > 0.0 else 0.0
    for i in range(n):
        v = vertices[first + i]
        xy[v, 0], xy[v, 1] = s[NEW_X + i], s[NEW_Y + i]


@helper()
def unguarded_moves(
    xy: FloatArray,
    vertices: TableArray,
    block: Block,
    s: FloatArray,
    lengths: FloatArray,
    shares: FloatArray,
) -> None:
    """Move the vertices of a block by their whole steps, and measure: as in `guarded_moves`."""
    for i in range(block.size):
        s[NEW_X + i], s[NEW_Y + i] = s[X + i] + s[SX + i], s[Y + i] + s[SY + i]
    _store(xy, vertices, block.first, block.size, s, lengths, shares)


@helper()
def guarded_moves(
    xy: FloatArray,
    vertices: TableArray,
    block: Block,
    guard: Guard,
    star: FloatArray,
    s: FloatArray,
    lines: FloatArray,
    lengths: FloatArray,
    shares: FloatArray,
) -> None:
    """Move the vertices of a block by as much of their steps as their guards allow, and measure.

    Parameters
    ----------
    vertices, block
        As in `blocks.Blocks`.
    star, s
        Scratch, as `lanes.gather_stars` fills it, with the steps in rows SX and SY, and the
        shortest edges in SHORTEST; if `guard.even`, the ratios to keep in MOST_RATIO.
    lines
        As `guard_lines` fills it, with the clearances to keep in LEAST, if `guard.fenced`.
    lengths, shares : (n_movable,)
        As in `stars.Moves`: overwritten for this block.
    """
    n = block.size
    left = _want(s, n, guard)
    for attempt in range(len(TRIALS)):
        if left == 0:
            break
        _try(star, s, block, TRIALS[attempt])
        if attempt == PRESENT:
            _ask_no_more(star, s, block)
            continue
        if guard.fenced:
            keep_clearances(lines, s, block, TRIALS[attempt])
        if guard.even:
            judge_ratios(star, s, block)
        left = _accept(s, n)
        if left <= FEW:
            break
        if attempt > PRESENT:
            _part_doubts(s, n)
    for i in range(n):
        # Steps that were refused by the ratio and by other guards in turn may be halved further.
        mixed = 0.0 < s[BY_RATIO + i] < N_HALVED
        if s[LONE + i] > 0.0 or (s[TODO + i] > 0.0 and (left <= FEW or mixed)):
            s[NEW_X + i], s[NEW_Y + i] = lone_step(star, s, lines, block, guard, i)
    _store(xy, vertices, block.first, n, s, lengths, shares)
