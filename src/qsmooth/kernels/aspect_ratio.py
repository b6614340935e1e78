"""Smoothing triangles by their edge ratios: along circumcircles, in place, colour by colour."""

import numpy as np
from numba import prange

from qsmooth._types import FloatArray
from qsmooth.kernels._jit import helper, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, block_at
from qsmooth.kernels.clearance import guard_lines, keep_clearances
from qsmooth.kernels.guard_rows import (
    FIRST_X,
    KEPT,
    LEAST,
    LOSS,
    MOST_RATIO,
    N_GUARD_ROWS,
    RATIO,
    ROWS_OF_LINES,
    SUM_X,
    SUM_Y,
    WEIGHT,
)
from qsmooth.kernels.guards import guarded_moves, judge_ratios
from qsmooth.kernels.lanes import (
    PX,
    PY,
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW6,
    SX,
    SY,
    X,
    Y,
    gather_stars,
    larger,
)
from qsmooth.kernels.line_trees import ask_trees, grow_trees
from qsmooth.kernels.lone_guards import Guard
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.stars import Moves
from qsmooth.kernels.trigonometry import arctangent, cosine_and_sine


@lane_helper()
def along_circumcircle(
    ux: float, uy: float, wx: float, wy: float, max_edge_ratio: float, step: float
) -> tuple[float, float, float]:
    """Move the corner at the origin of a triangle (0, u, w) towards its longer edge.

    It stays on the circumcircle: the angle at the corner is kept, and those at u and w, which grow
    and shrink in proportion to the arc, draw nearer to each other.

    Returns
    -------
    dx, dy
        Displacement, by `step` of the arc to the point where both edges are equally long. Zero
        where the ratio of the edges is within `max_edge_ratio`, or the triangle not positive.
    ratio
        The longer edge over the shorter; 0 where there is no displacement.
    """
    uu, ww = ux * ux + uy * uy, wx * wx + wy * wy
    jacobian, dot = ux * wy - uy * wx, ux * wx + uy * wy
    longer, shorter = (uu, ww) if uu > ww else (ww, uu)
    moves = (jacobian > 0.0) & (longer > max_edge_ratio * max_edge_ratio * shorter)
    # The cotangents of the angles at u and w, times the Jacobian. The difference of the two angles
    # is the angle at the centre of the arc that is left.
    at_u, at_w = uu - dot, ww - dot
    left = arctangent(jacobian * (at_u - at_w), at_u * at_w + jacobian * jacobian)
    cosine, sine = cosine_and_sine(0.5 * step * left)
    ex, ey = wx - ux, wy - uy
    # The law of sines gives the new distance from u.
    below = jacobian * (ex * ex + ey * ey) if moves else 1.0
    scale = (jacobian * cosine - at_w * sine) / below
    along = scale * (at_u * cosine - jacobian * sine)
    across = scale * (jacobian * cosine + at_u * sine)
    dx = ux + along * ex - across * ey
    dy = uy + along * ey + across * ex
    ratio = np.sqrt(longer / (shorter if moves else 1.0))
    return dx if moves else 0.0, dy if moves else 0.0, ratio if moves else 0.0


@helper()
def _propose(
    star: FloatArray, s: FloatArray, at: int, n: int, max_edge_ratio: float, step: float
) -> None:
    """Fill rows SX and SY with what a triangle proposes, and FIRST_X with the ratio."""
    for i in range(n):
        x, y = s[X + i], s[Y + i]
        ux, uy = star[at + i] - x, star[at + ROW + i] - y
        wx, wy = star[at + ROW2 + i] - x, star[at + ROW3 + i] - y
        dx, dy, ratio = along_circumcircle(ux, uy, wx, wy, max_edge_ratio, step)
        s[SX + i], s[SY + i], s[FIRST_X + i] = dx, dy, ratio


@helper()
def _raise_ratios(s: FloatArray, n: int, power: float) -> None:
    """Turn the ratios into weights."""
    if power == 4.0:  # a call for the power would stop vectorisation
        for i in range(n):
            square = s[FIRST_X + i] * s[FIRST_X + i]
            s[FIRST_X + i] = square * square
    else:
        for i in range(n):
            s[FIRST_X + i] = s[FIRST_X + i] ** power


@helper()
def _add_kept(s: FloatArray, n: int) -> None:
    """Add the proposals that are moves and keep the clearance."""
    for i in range(n):
        dx, dy, loss = s[SX + i], s[SY + i], s[LOSS + i]
        kept = (dx * dx + dy * dy >= loss * loss) & (s[KEPT + i] >= s[LEAST + i])
        weight = s[FIRST_X + i] if kept else 0.0
        s[SUM_X + i] += weight * dx if kept else 0.0
        s[SUM_Y + i] += weight * dy if kept else 0.0
        s[WEIGHT + i] += weight


@helper()
def mean_along_circumcircles(
    star: FloatArray,
    s: FloatArray,
    lines: FloatArray,
    block: Block,
    max_edge_ratio: float,
    step: float,
    power: float,
    tolerated: float,
) -> None:
    """Average what the triangles around each vertex propose, as far as no clearance is lost.

    Parameters
    ----------
    star, s, lines
        Scratch, as `clearance.guard_lines` leaves it; SX and SY are overwritten with the means,
        zero where nothing was accepted, and MOST_RATIO with the largest ratios to keep.
    max_edge_ratio, step, power, tolerated
        As in `aspect_ratio_sweep`.
    """
    n, trees = block.size, grow_trees(lines, block)
    for i in range(n):
        s[SUM_X + i], s[SUM_Y + i], s[WEIGHT + i] = 0.0, 0.0, 0.0
    for k in range(block.n_triangles):
        at = block.n_quads * ROW6 + k * ROW4
        _propose(star, s, at, n, max_edge_ratio, step)
        _raise_ratios(s, n, power)
        if trees.size:
            ask_trees(trees, s, block, SX, SY, KEPT)
        else:
            keep_clearances(lines, s, block, 1.0)
        _add_kept(s, n)
    for i in range(n):
        found = s[WEIGHT + i] > 0.0
        x, y = s[SUM_X + i] / s[WEIGHT + i], s[SUM_Y + i] / s[WEIGHT + i]
        s[SX + i], s[SY + i] = x if found else 0.0, y if found else 0.0
        s[PX + i], s[PY + i] = s[X + i], s[Y + i]
    judge_ratios(star, s, block)
    for i in range(n):
        s[MOST_RATIO + i] = larger(s[RATIO + i], tolerated * tolerated)


@parallel_kernel()
def aspect_ratio_sweep(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    max_edge_ratio: float,
    step: float,
    power: float,
    tolerated: float,
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex once along the circumcircles of the triangles around it.

    Each triangle whose two edges at the vertex differ too much proposes a place; those that lose
    no clearance are averaged. Quads propose nothing, but are guarded.

    Parameters
    ----------
    xy, blocks, colours, good, moves
        As in `star.star_sweep`.
    max_edge_ratio
        Edges whose ratio is no larger are left alone; 1 or more.
    step
        Fraction of the arc to the point where both edges are equal, in (0, 1].
    power
        Proposals are weighted by the ratio of their edges to this power; 0 is the plain mean.
    tolerated
        Besides the guards, no step may make the largest edge ratio of the star's triangles larger,
        unless it stays within this; infinite for no such rule.
    """
    colour_blocks, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    lengths, shares = moves.lengths, moves.shares
    guard = Guard(good, False, True)
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            s, star = np.empty(N_GUARD_ROWS * LANES), np.empty(6 * largest * LANES)
            lines = np.empty(ROWS_OF_LINES * largest * LANES)
            block = block_at(table, b)
            gather_stars(xy, vertices, stars, block, star, s)
            guard_lines(star, s, block, lines)
            mean_along_circumcircles(star, s, lines, block, max_edge_ratio, step, power, tolerated)
            guarded_moves(xy, vertices, block, guard, star, s, lines, rails, lengths, shares)
