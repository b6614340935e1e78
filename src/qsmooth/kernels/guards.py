"""What every guarded method asks of a move, on blocks of lanes: clearance, certificate, quality.

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
from qsmooth.kernels.clearance import keep_clearances
from qsmooth.kernels.confining import confined
from qsmooth.kernels.geometry import certainly_positive
from qsmooth.kernels.guard_rows import (
    BY_RATIO,
    CERTAIN,
    ENOUGH,
    FIRST_X,
    FIRST_Y,
    KEPT,
    LEAST,
    LONE,
    MOST_RATIO,
    NEW_X,
    NEW_Y,
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
    confine_lanes,
    larger,
    smaller,
)
from qsmooth.kernels.lone_guards import Guard, edge_ratio, lone_step
from qsmooth.kernels.rails import Rails

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
def _place(s: FloatArray, n: int, fraction: float) -> None:
    """Put the vertices at a fraction of their steps."""
    for i in range(n):
        s[PX + i] = s[X + i] + fraction * s[SX + i]
        s[PY + i] = s[Y + i] + fraction * s[SY + i]


@helper()
def _try(star: FloatArray, s: FloatArray, block: Block) -> None:
    """Certify and score what the vertices see at their trial places."""
    n, quads = block.size, block.n_quads
    for i in range(n):
        s[CERTAIN + i], s[SCORE + i] = 1.0, np.inf
    for k in range(quads):
        at = k * ROW6
        for i in range(n):
            px, py = s[PX + i], s[PY + i]
            ax, ay = star[at + i], star[at + ROW + i]
            bx, by = star[at + ROW2 + i], star[at + ROW3 + i]
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
            ax, ay = star[at + i], star[at + ROW + i]
            cx, cy = star[at + ROW2 + i], star[at + ROW3 + i]
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
            ax, ay = star[at + i], star[at + ROW + i]
            bx, by = star[at + ROW2 + i], star[at + ROW3 + i]
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
def _keep_clearances(lines: FloatArray, s: FloatArray, block: Block) -> None:
    """Find the clearances that are left at trial places that are no fraction of the steps away."""
    for i in range(block.size):
        s[FIRST_X + i], s[FIRST_Y + i] = s[SX + i], s[SY + i]
        s[SX + i], s[SY + i] = s[PX + i] - s[X + i], s[PY + i] - s[Y + i]
    keep_clearances(lines, s, block, 1.0)
    for i in range(block.size):
        s[SX + i], s[SY + i] = s[FIRST_X + i], s[FIRST_Y + i]


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
    rails: Rails,
    lengths: FloatArray,
    shares: FloatArray,
) -> None:
    """Move the vertices of a block by their whole steps, and measure: as in `guarded_moves`."""
    n = block.size
    for i in range(n):
        s[NEW_X + i], s[NEW_Y + i] = s[X + i] + s[SX + i], s[Y + i] + s[SY + i]
    if confined(rails):
        confine_lanes(s, NEW_X, NEW_Y, (n - n, n), vertices, block.first, rails)
    _store(xy, vertices, block.first, n, s, lengths, shares)


@helper()
def guarded_moves(
    xy: FloatArray,
    vertices: TableArray,
    block: Block,
    guard: Guard,
    star: FloatArray,
    s: FloatArray,
    lines: FloatArray,
    rails: Rails,
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
        As `clearance.guard_lines` fills it, if `guard.fenced`; LEAST has the clearances to keep.
    rails
        Where they may be.
    lengths, shares : (n_movable,)
        As in `stars.Moves`: overwritten for this block.
    """
    n, on_rails = block.size, confined(rails)
    left = _want(s, n, guard)
    for attempt in range(len(TRIALS)):
        if left == 0:
            break
        _place(s, n, TRIALS[attempt])
        if on_rails and attempt != PRESENT:
            confine_lanes(s, PX, PY, (n - n, n), vertices, block.first, rails)
        _try(star, s, block)
        if attempt == PRESENT:
            _ask_no_more(star, s, block)
            continue
        if guard.fenced:
            if on_rails:
                _keep_clearances(lines, s, block)
            else:
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
            s[NEW_X + i], s[NEW_Y + i] = lone_step(
                star, s, lines, block, guard, i, vertices[block.first + i], rails
            )
    _store(xy, vertices, block.first, n, s, lengths, shares)
