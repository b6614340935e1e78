"""Scratch memory of a block of lanes, and one Newton step in each lane.

Scratch is rows of lanes in one flat array. One array with a constant row length lets the compiler
see that rows do not overlap, and unsigned offsets need no wrap-around test; without either the
loops over lanes stay scalar.
"""

import math
from typing import TypeAlias

import numpy as np

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper
from qsmooth.kernels.blocks import Block, lane_row
from qsmooth.kernels.confining import confine, tangent
from qsmooth.kernels.corner_energy import Linear, Quadratic, hessian, quotient
from qsmooth.kernels.rails import Rails

# The first lane of a block to look at, and the one to stop before.
LaneRange: TypeAlias = tuple[int, int]
ROW0, ROW, ROW2, ROW3, ROW4, ROW5, ROW6 = (lane_row(k) for k in range(7))
N_ROWS = 23
# Energy, gradient and Hessian of the star; energy of a trial and the least margin of its areas;
# Newton step; place and trial place; 1 while the vertex has a step to take; for one kernel's use;
# what is held, and the least margin by which a trial keeps it.
(
    ENERGY, GX, GY, HXX, HXY, HYY, TRIAL, MARGIN, SX, SY, X, Y, PX, PY, TODO, OWN,
    MOST_COSINE, LEAST_COSINE, LEAST_SINE, MOST_RATIO, MOST_SHAPE, LEAST_EDGE, HELD,
) = (lane_row(k) for k in range(N_ROWS))  # fmt: skip
# Share of its energy that a vertex's step must promise, by its linear model, to be worth a trial.
LEAST_PROMISE = 1e-14
# Fractions of the Newton step that are tried after the over-relaxed one.
FRACTIONS = (1.0, 0.4, 0.1)


@lane_helper()
def smaller(a: float, b: float) -> float:
    """Take the smaller, and b where one is NaN."""
    return a if a < b else b


@lane_helper()
def larger(a: float, b: float) -> float:
    """Take the larger, and b where one is NaN."""
    return a if a > b else b


@helper()
def gather_stars(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    star_xy: FloatArray,
    s: FloatArray,
) -> None:
    """Fetch the coordinates of a block's vertices and of their stars; as `gather_block`."""
    first, n = block.first, block.size
    for k in range(3 * block.n_quads + 2 * block.n_triangles):
        x, y, row = k * ROW2, k * ROW2 + ROW, block.start + k * n
        for i in range(n):
            w = stars[row + i]
            star_xy[x + i], star_xy[y + i] = xy[w, 0], xy[w, 1]
    for i in range(n):
        v = vertices[first + i]
        s[X + i], s[Y + i] = xy[v, 0], xy[v, 1]


@helper()
def gather_block(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    star_xy: FloatArray,
    s: FloatArray,
    lengths: FloatArray,
) -> None:
    """Fetch the stars of a block's vertices, and clear its accumulators.

    Parameters
    ----------
    vertices, stars
        As in `blocks.Blocks`.
    star_xy, s
        Scratch, overwritten: two rows for each corner of the star, x and y; the rows above.
    lengths : (n_movable,)
        Overwritten with 0 for this block.
    """
    gather_stars(xy, vertices, stars, block, star_xy, s)
    for i in range(block.size):
        lengths[block.first + i] = 0.0
    for i in range(ROW6):
        s[i] = 0.0


@lane_helper()
def add_energy(n: Quadratic, det: Linear, weight: float, s: FloatArray, i: int) -> None:
    """Add weight · n / det and its derivatives."""
    inv, f, fx, fy = quotient(n, det)
    s[ENERGY + i] += weight * f
    s[GX + i] += weight * fx
    s[GY + i] += weight * fy
    xx, xy, yy = hessian(n.second, fx, fy, det)
    weight *= inv
    s[HXX + i] += weight * xx
    s[HXY + i] += weight * xy
    s[HYY + i] += weight * yy


@helper()
def newton_step(s: FloatArray, n: int) -> float:
    """Solve each lane's 2 by 2 system for its Newton step; count the lanes that have one to take.

    A step that promises less than rounding can show is none: the vertex rests.
    """
    left = 0.0
    for i in range(n):
        hxx, hxy, hyy = s[HXX + i], s[HXY + i], s[HYY + i]
        gx, gy = s[GX + i], s[GY + i]
        inv = 1.0 / (hxx * hyy - hxy * hxy)
        sx = -(hyy * gx - hxy * gy) * inv
        sy = -(hxx * gy - hxy * gx) * inv
        s[SX + i], s[SY + i] = sx, sy
        s[TODO + i] = 1.0 if -(gx * sx + gy * sy) > LEAST_PROMISE * s[ENERGY + i] else 0.0
    for i in range(n):
        left += s[TODO + i]
    return left


@helper()
def steps_on_rails(s: FloatArray, vertices: TableArray, first: int, n: int, rails: Rails) -> float:
    """Take Newton's step in one dimension where a vertex may move along a line only.

    Parameters
    ----------
    s
        Scratch, as `newton_step` leaves it.
    vertices, first
        The vertex of lane i is ``vertices[first + i]``.

    Returns
    -------
    left
        Lanes that have a step to take.
    """
    left = 0.0
    for i in range(n):
        gx, gy = s[GX + i], s[GY + i]
        tx, ty, bend = tangent(vertices[first + i], s[X + i], s[Y + i], gx, gy, rails)
        if tx != 0.0 or ty != 0.0:
            slope = gx * tx + gy * ty
            curvature = tx * tx * s[HXX + i] + 2.0 * tx * ty * s[HXY + i] + ty * ty * s[HYY + i]
            length = -slope / (curvature + bend)
            s[SX + i], s[SY + i] = length * tx, length * ty
            s[TODO + i] = 1.0 if -slope * length > LEAST_PROMISE * s[ENERGY + i] else 0.0
        left += s[TODO + i]
    return left


@helper()
def confine_lanes(
    s: FloatArray,
    x: int,
    y: int,
    lanes: LaneRange,
    vertices: TableArray,
    first: int,
    rails: Rails,
) -> None:
    """Put the places in rows `x` and `y` where the vertices may be; as `steps_on_rails`."""
    for i in range(lanes[0], lanes[1]):
        s[x + i], s[y + i] = confine(vertices[first + i], s[x + i], s[y + i], rails)


@helper()
def start_trial(s: FloatArray, lanes: LaneRange, fraction: float) -> None:
    """Put each lane's vertex at a fraction of its step, and clear what is summed up there."""
    for i in range(lanes[0], lanes[1]):
        s[PX + i] = s[X + i] + fraction * s[SX + i]
        s[PY + i] = s[Y + i] + fraction * s[SY + i]
        s[TRIAL + i] = 0.0
        s[MARGIN + i] = np.inf
        s[HELD + i] = np.inf


@helper()
def store_better(
    xy: FloatArray,
    vertices: TableArray,
    block: Block,
    lanes: LaneRange,
    s: FloatArray,
    lengths: FloatArray,
) -> float:
    """Store the trial places that lower the energy and keep every margin, and measure the moves.

    Returns
    -------
    left
        Those of these lanes that still have a step to take.
    """
    first = block.first
    left = 0.0
    for i in range(lanes[0], lanes[1]):
        good = (s[TRIAL + i] < s[ENERGY + i]) & (s[MARGIN + i] > 0.0) & (s[HELD + i] > 0.0)
        if good & (s[TODO + i] > 0.0):
            v = vertices[first + i]
            xy[v, 0], xy[v, 1] = s[PX + i], s[PY + i]
            dx, dy = s[PX + i] - s[X + i], s[PY + i] - s[Y + i]
            lengths[first + i] = math.sqrt(dx * dx + dy * dy)
            s[TODO + i] = 0.0
        left += s[TODO + i]
    return left
