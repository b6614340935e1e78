"""One Newton step per vertex on the energy of its star, on blocks of lanes.

A quad's corner with edge vectors u, w has the shape energy f = (|u|² + |w|²) / (2 det(u, w)), a
triangle f = (|u|² + |w|² − u·w) / (√3 det(u, w)): 1 at best, infinite where it collapses. The
badness of a corner is g = |u| |w| / det(u, w), one over its sine (in a triangle, over that of 60°),
so that the largest g is one over the smallest scaled Jacobian. The energy is the sum of

    mean_weight · f + (g / limit)^power

over the cells and corners: the mean shape, and a wall that only bad corners feel, those with g
near or above `limit`. f is a square over a linear function of the vertex that moves, hence convex,
and g lies under such functions; Newton's steps are those of convex problems and point downhill.
"""

import math

import numpy as np
from numba import prange

from qsmooth._types import BlockArray, BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import FIRST, LANES, N_QUADS, N_TRIANGLES, SIZE, STAR, lane_row
from qsmooth.kernels.geometry import ORIENTATION_BOUND, UNDERFLOW_BOUND

INV_ROOT3 = 1.0 / math.sqrt(3.0)
SINE_60 = math.sqrt(0.75)
# Scratch of a block: rows of lanes in one flat array. One array with a constant row length lets the
# compiler see that rows do not overlap, and unsigned offsets need no wrap-around test; without
# either the loops over lanes stay scalar.
ROW, ROW2, ROW3, ROW4, ROW5, ROW6 = (lane_row(k) for k in range(1, 7))
N_ROWS = 15
ENERGY, GX, GY, HXX, HXY, HYY, TRIAL, MARGIN, SX, SY, X, Y, PX, PY, TODO = (
    lane_row(k) for k in range(N_ROWS)
)
# Share of its energy that a vertex's step must promise, by its linear model, to be worth a trial.
LEAST_PROMISE = 1e-14
# Fractions of the Newton step that are tried after the over-relaxed one.
FRACTIONS = (1.0, 0.4, 0.1)


@lane_helper()
def _power(r: float, squarings: int) -> float:
    """Raise r to 2 ** squarings, at most 6; by selects, as a loop would stop vectorisation."""
    r = r * r if squarings > 0 else r
    r = r * r if squarings > 1 else r
    r = r * r if squarings > 2 else r
    r = r * r if squarings > 3 else r
    r = r * r if squarings > 4 else r
    return r * r if squarings > 5 else r


@lane_helper()
def _add_corner(
    det: float, dx: float, dy: float, uu: float, ux: float, uy: float, u2: float,
    ww: float, wx: float, wy: float, w2: float, mean_weight: float, inv_limit: float,
    squarings: int, power: float, s: FloatArray, i: int,
) -> None:  # fmt: skip
    """Add a corner's energy and its derivatives by the vertex that moves.

    Given are its determinant, and the halves of its edges' squared lengths uu and ww, each with its
    gradient and the diagonal of its Hessian.
    """
    inv = 1.0 / det
    f = (uu + ww) * inv
    fx, fy = (ux + wx - f * dx) * inv, (uy + wy - f * dy) * inv
    # |u| |w| / det lies under (|u|² t + |w|² / t) / (2 det) for every t > 0, and touches it at the
    # t = |w| / |u| taken here. That bound is convex: what lowers it lowers the energy. It all takes
    # two divisions a corner; with five a sweep was a fifth slower.
    root = math.sqrt(uu * ww)
    inv_root = 1.0 / root
    t, inv_t = ww * inv_root, uu * inv_root
    g, inv_g = 2.0 * root * inv, 0.5 * det * inv_root
    gx, gy = (ux * t + wx * inv_t - g * dx) * inv, (uy * t + wy * inv_t - g * dy) * inv
    high = _power(g * inv_limit, squarings)
    slope = power * high * inv_g
    second = (power - 1.0) * slope * inv_g
    s[ENERGY + i] += mean_weight * f + high
    s[GX + i] += mean_weight * fx + slope * gx
    s[GY + i] += mean_weight * fy + slope * gy
    # The Hessian of a fraction n / det: (∇²n − ∇f ∇detᵀ − ∇det ∇fᵀ) / det
    first, slope = mean_weight * inv, slope * inv
    diagonal = first * (u2 + w2) + slope * (u2 * t + w2 * inv_t)
    mx, my = first * fx + slope * gx, first * fy + slope * gy
    s[HXX + i] += diagonal - 2.0 * mx * dx + second * gx * gx
    s[HXY + i] += second * gx * gy - (mx * dy + my * dx)
    s[HYY + i] += diagonal - 2.0 * my * dy + second * gy * gy


@helper()
def _add_quad(
    star: FloatArray, s: FloatArray, k: int, n: int, mean_weight: float, inv_limit: float,
    squarings: int, power: float,
) -> None:  # fmt: skip
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        va, vc = 0.5 * (ax * ax + ay * ay), 0.5 * (cx * cx + cy * cy)
        _add_corner(
            ax * cy - ay * cx, ay - cy, cx - ax, va, -ax, -ay, 1.0, vc, -cx, -cy, 1.0,
            mean_weight, inv_limit, squarings, power, s, i,
        )  # fmt: skip
        ex, ey = bx - ax, by - ay
        _add_corner(
            ey * ax - ex * ay, -ey, ex, 0.5 * (ex * ex + ey * ey), 0.0, 0.0, 0.0, va, -ax, -ay, 1.0,
            mean_weight, inv_limit, squarings, power, s, i,
        )  # fmt: skip
        ex, ey = bx - cx, by - cy
        _add_corner(
            cy * ex - cx * ey, ey, -ex, 0.5 * (ex * ex + ey * ey), 0.0, 0.0, 0.0, vc, -cx, -cy, 1.0,
            mean_weight, inv_limit, squarings, power, s, i,
        )  # fmt: skip


@lane_helper()
def _add_mean(
    det: float, dx: float, dy: float, n: float, nx: float, ny: float, n2: float, weight: float,
    s: FloatArray, i: int,
) -> None:  # fmt: skip
    """Add weight · n / det and its derivatives."""
    inv = 1.0 / det
    f = n * inv
    fx, fy = (nx - f * dx) * inv, (ny - f * dy) * inv
    s[ENERGY + i] += weight * f
    s[GX + i] += weight * fx
    s[GY + i] += weight * fy
    weight *= inv
    s[HXX + i] += weight * (n2 - 2.0 * fx * dx)
    s[HXY + i] -= weight * (fx * dy + fy * dx)
    s[HYY + i] += weight * (n2 - 2.0 * fy * dy)


@helper()
def _add_triangle(
    star: FloatArray, s: FloatArray, k: int, n: int, mean_weight: float, inv_limit: float,
    squarings: int, power: float,
) -> None:  # fmt: skip
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        va, vc = 0.5 * (ax * ax + ay * ay), 0.5 * (cx * cx + cy * cy)
        ex, ey = cx - ax, cy - ay
        ee = 0.5 * (ex * ex + ey * ey)
        det, dx, dy = ax * cy - ay * cx, ay - cy, cx - ax
        # |u|² + |w|² − u·w is half the sum of the three squared edges.
        _add_mean(
            det, dx, dy, INV_ROOT3 * (va + vc + ee), -INV_ROOT3 * (ax + cx), -INV_ROOT3 * (ay + cy),
            2.0 * INV_ROOT3, mean_weight, s, i,
        )  # fmt: skip
        # The sine of 60 degrees is ideal, so limits are those of quads by that much.
        limit = inv_limit * SINE_60
        _add_corner(
            det, dx, dy, va, -ax, -ay, 1.0, vc, -cx, -cy, 1.0, 0.0, limit, squarings, power, s, i
        )
        _add_corner(
            det, dx, dy, ee, 0.0, 0.0, 0.0, va, -ax, -ay, 1.0, 0.0, limit, squarings, power, s, i
        )
        _add_corner(
            det, dx, dy, ee, 0.0, 0.0, 0.0, vc, -cx, -cy, 1.0, 0.0, limit, squarings, power, s, i
        )


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


@lane_helper()
def _try_corner(
    left: float, right: float, uu: float, ww: float, mean_weight: float, inv_limit: float,
    squarings: int, s: FloatArray, i: int,
) -> None:  # fmt: skip
    """Add a corner's energy, and keep the least margin by which its area is certified positive."""
    det = left - right
    inv = 1.0 / det
    s[TRIAL + i] += mean_weight * 0.5 * (uu + ww) * inv + _power(
        math.sqrt(uu * ww) * inv * inv_limit, squarings
    )
    margin = det - (ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND)
    s[MARGIN + i] = margin if margin < s[MARGIN + i] else s[MARGIN + i]


@helper()
def _try_quad(
    star: FloatArray, s: FloatArray, k: int, n: int, mean_weight: float, inv_limit: float,
    squarings: int,
) -> None:  # fmt: skip
    # All differences are of stored coordinates, and each determinant is taken about one of its
    # points, as the error bound asks.
    for i in range(n):
        px, py = s[PX + i], s[PY + i]
        ax, ay, bx, by = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        cx, cy = star[k + ROW4 + i], star[k + ROW5 + i]
        ux, uy = ax - px, ay - py
        wx, wy = cx - px, cy - py
        va, vc = ux * ux + uy * uy, wx * wx + wy * wy
        _try_corner(ux * wy, uy * wx, va, vc, mean_weight, inv_limit, squarings, s, i)
        ex, ey = bx - ax, by - ay
        _try_corner(
            ey * ux, ex * uy, ex * ex + ey * ey, va, mean_weight, inv_limit, squarings, s, i
        )
        ex, ey = bx - cx, by - cy
        _try_corner(
            ex * wy, ey * wx, ex * ex + ey * ey, vc, mean_weight, inv_limit, squarings, s, i
        )


@helper()
def _try_triangle(
    star: FloatArray, s: FloatArray, k: int, n: int, mean_weight: float, inv_limit: float,
    squarings: int,
) -> None:  # fmt: skip
    for i in range(n):
        ax, ay, cx, cy = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        ux, uy = ax - s[PX + i], ay - s[PY + i]
        wx, wy = cx - s[PX + i], cy - s[PY + i]
        ex, ey = cx - ax, cy - ay
        va, vc, ee = ux * ux + uy * uy, wx * wx + wy * wy, ex * ex + ey * ey
        limit = inv_limit * SINE_60
        _try_corner(ux * wy, uy * wx, va, vc, 0.0, limit, squarings, s, i)
        inv = 1.0 / (ux * wy - uy * wx)
        s[TRIAL + i] += mean_weight * 0.5 * INV_ROOT3 * (va + vc + ee) * inv
        s[TRIAL + i] += _power(math.sqrt(ee * va) * inv * limit, squarings)
        s[TRIAL + i] += _power(math.sqrt(ee * vc) * inv * limit, squarings)


@helper()
def start_trial(s: FloatArray, n: int, fraction: float) -> None:
    """Put each lane's vertex at a fraction of its step, and clear what is summed up there."""
    for i in range(n):
        s[PX + i] = s[X + i] + fraction * s[SX + i]
        s[PY + i] = s[Y + i] + fraction * s[SY + i]
        s[TRIAL + i] = 0.0
        s[MARGIN + i] = np.inf


@helper()
def gather_block(
    xy: FloatArray, vertices: TableArray, stars: TableArray, first: int, n: int, n_corners: int,
    entry: int, star_xy: FloatArray, s: FloatArray, moves: FloatArray,
) -> None:  # fmt: skip
    """Fetch the stars of a block's vertices, and clear its accumulators."""
    for k in range(n_corners):
        x, y, row = k * ROW2, k * ROW2 + ROW, entry + k * n
        for i in range(n):
            w = stars[row + i]
            star_xy[x + i], star_xy[y + i] = xy[w, 0], xy[w, 1]
    for i in range(n):
        v = vertices[first + i]
        s[X + i], s[Y + i] = xy[v, 0], xy[v, 1]
        moves[first + i] = 0.0
    for i in range(ROW6):
        s[i] = 0.0


@helper()
def _move_block(
    xy: FloatArray, vertices: TableArray, stars: TableArray, first: int, n: int, quads: int,
    triangles: int, entry: int, relaxation: float, mean_weight: float, inv_limit: float,
    squarings: int, power: float, star_xy: FloatArray, s: FloatArray, moves: FloatArray,
) -> None:  # fmt: skip
    gather_block(xy, vertices, stars, first, n, 3 * quads + 2 * triangles, entry, star_xy, s, moves)
    triangle_rows = quads * ROW6
    for k in range(quads):
        _add_quad(star_xy, s, k * ROW6, n, mean_weight, inv_limit, squarings, power)
    for k in range(triangles):
        _add_triangle(
            star_xy, s, triangle_rows + k * ROW4, n, mean_weight, inv_limit, squarings, power
        )
    left = newton_step(s, n)
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        start_trial(s, n, fraction)
        for k in range(quads):
            _try_quad(star_xy, s, k * ROW6, n, mean_weight, inv_limit, squarings)
        for k in range(triangles):
            _try_triangle(
                star_xy, s, triangle_rows + k * ROW4, n, mean_weight, inv_limit, squarings
            )
        left = 0.0
        for i in range(n):
            if (s[TRIAL + i] < s[ENERGY + i]) & (s[MARGIN + i] > 0.0) & (s[TODO + i] > 0.0):
                v = vertices[first + i]
                xy[v, 0], xy[v, 1] = s[PX + i], s[PY + i]
                dx, dy = s[PX + i] - s[X + i], s[PY + i] - s[Y + i]
                moves[first + i] = math.sqrt(dx * dx + dy * dy)
                s[TODO + i] = 0.0
            left += s[TODO + i]
        fraction = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]


@parallel_kernel()
def newton_sweep(
    xy: FloatArray, colour_blocks: IndexArray, blocks: BlockArray, vertices: TableArray,
    stars: TableArray, largest_star: int, relaxation: float, mean_weight: float, limit: float,
    squarings: int, moves: FloatArray,
) -> None:  # fmt: skip
    """Move each vertex once, downhill on its star's energy, in place.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates of a valid mesh. Moved in place.
    colour_blocks, blocks, vertices, stars
        The movable vertices in blocks (`blocks.build_blocks`).
    largest_star
        Cells in the largest star.
    relaxation
        Multiple of the Newton step that is tried first; then 1, 0.4 and 0.1.
    mean_weight, limit, squarings
        The energy is the sum of mean_weight · f + (g / limit) ** (2 ** squarings).
    moves : (n_movable,)
        Overwritten, in block order. Length of each move.
    """
    power = 2.0**squarings
    inv_limit = 1.0 / limit
    for colour in range(colour_blocks.size - 1):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            scratch, star_xy = np.empty(N_ROWS * LANES), np.empty(6 * largest_star * LANES)
            _move_block(
                xy, vertices, stars, blocks[b, FIRST], blocks[b, SIZE], blocks[b, N_QUADS],
                blocks[b, N_TRIANGLES], blocks[b, STAR], relaxation, mean_weight, inv_limit,
                squarings, power, star_xy, scratch, moves,
            )  # fmt: skip


@parallel_kernel()
def cell_energy(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, movable: BoolArray,
    badness: FloatArray, shape: FloatArray,
) -> None:  # fmt: skip
    """Measure each cell's largest badness g, and its shape energy f (the mean over its corners).

    Parameters
    ----------
    movable : (n_vertices,)
        Corners without a movable vertex can't change and do not count.
    badness, shape : (n_cells,)
        Overwritten; 0 where no corner counts, infinite where one that does is not positive.
    """
    for c in prange(badness.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        triangle = last - first == 3
        worst, total = 0.0, 0.0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            if movable[a] or movable[b] or movable[d]:
                ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
                wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
                det = ux * wy - uy * wx
                uu, ww = ux * ux + uy * uy, wx * wx + wy * wy
                if not det > 0.0:
                    worst, total = np.inf, np.inf
                elif triangle:
                    worst = max(worst, SINE_60 * math.sqrt(uu * ww) / det)
                    total += INV_ROOT3 * (uu + ww - ux * wx - uy * wy) / det
                else:
                    worst = max(worst, math.sqrt(uu * ww) / det)
                    total += 0.5 * (uu + ww) / det
            d = a
        badness[c] = worst
        shape[c] = total / (last - first)
