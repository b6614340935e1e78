"""One Newton step per vertex on the shape energy, on blocks of lanes.

The shape energy of a quad's corner with edge vectors u, w is f = (|u|² + |w|²) / (2 det(u, w)), of
a triangle f = (|u|² + |w|² − u·w) / (√3 det(u, w)): 1 at best, infinite where it collapses. Each
is a square over a linear function of the vertex that moves, hence convex where it is valid, and so is
the sum of

    mean_weight · f + (f / limit)^power

over the star: a vertex's problem has one minimum, and Newton's step always points downhill.
"""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import FIRST, LANES, N_QUADS, N_TRIANGLES, SIZE, STAR
from qsmooth.kernels.geometry import ORIENTATION_BOUND, UNDERFLOW_BOUND

INV_ROOT3 = 1.0 / math.sqrt(3.0)
# Scratch of a block: rows of lanes in one flat array. One array with a constant row length lets the
# compiler see that rows do not overlap, and unsigned offsets need no wrap-around test; without
# either the loops over lanes stay scalar.
ROW = np.uint64(LANES)
ROW2, ROW3, ROW4, ROW5, ROW6 = (np.uint64(k * LANES) for k in range(2, 7))
N_ROWS = 15
(
    ENERGY, GX, GY, HXX, HXY, HYY, TRIAL, MARGIN, SX, SY, X, Y, PX, PY, TODO
) = (np.uint64(k * LANES) for k in range(N_ROWS))  # fmt: skip
# Fractions of the Newton step that are tried after the over-relaxed one.
FRACTIONS = (1.0, 0.4, 0.1)


@lane_helper()
def _power(r: float, squarings: int) -> float:
    """r ** (2 ** squarings), for at most 6; selects, as a loop would stop vectorisation."""
    r = r * r if squarings > 0 else r
    r = r * r if squarings > 1 else r
    r = r * r if squarings > 2 else r
    r = r * r if squarings > 3 else r
    r = r * r if squarings > 4 else r
    return r * r if squarings > 5 else r


@lane_helper()
def _add_corner(
    det: float, squares: float, nx: float, ny: float, dx: float, dy: float, n2: float, scale: float,
    mean_weight: float, inv_limit: float, squarings: int, power: float, s: FloatArray, i: int,
) -> None:  # fmt: skip
    """Add a corner, f = scale · squares / det: (nx, ny), (dx, dy) are the gradients of the two."""
    inv = 1.0 / det
    f = scale * squares * inv
    fx, fy = (scale * nx - f * dx) * inv, (scale * ny - f * dy) * inv
    high = _power(f * inv_limit, squarings)
    slope = power * high / f
    first = mean_weight + slope
    second = (power - 1.0) * slope / f
    # Hessian of f: (scale · n2 · I − ∇f ∇detᵀ − ∇det ∇fᵀ) / det
    s[ENERGY + i] += mean_weight * f + high
    s[GX + i] += first * fx
    s[GY + i] += first * fy
    first *= inv
    s[HXX + i] += first * (scale * n2 - 2.0 * fx * dx) + second * fx * fx
    s[HXY + i] += second * fx * fy - first * (fx * dy + fy * dx)
    s[HYY + i] += first * (scale * n2 - 2.0 * fy * dy) + second * fy * fy


@helper()
def _add_quad(
    star: FloatArray, s: FloatArray, k: int, n: int,
    mean_weight: float, inv_limit: float, squarings: int, power: float,
) -> None:  # fmt: skip
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        _add_corner(
            ax * cy - ay * cx, ax * ax + ay * ay + cx * cx + cy * cy,
            -2.0 * (ax + cx), -2.0 * (ay + cy), ay - cy, cx - ax, 4.0, 0.5,
            mean_weight, inv_limit, squarings, power, s, i,
        )  # fmt: skip
        ux, uy = bx - ax, by - ay
        _add_corner(
            uy * ax - ux * ay, ux * ux + uy * uy + ax * ax + ay * ay,
            -2.0 * ax, -2.0 * ay, -uy, ux, 2.0, 0.5,
            mean_weight, inv_limit, squarings, power, s, i,
        )  # fmt: skip
        ux, uy = bx - cx, by - cy
        _add_corner(
            cy * ux - cx * uy, ux * ux + uy * uy + cx * cx + cy * cy,
            -2.0 * cx, -2.0 * cy, uy, -ux, 2.0, 0.5,
            mean_weight, inv_limit, squarings, power, s, i,
        )  # fmt: skip


@helper()
def _add_triangle(
    star: FloatArray, s: FloatArray, k: int, n: int,
    mean_weight: float, inv_limit: float, squarings: int, power: float,
) -> None:  # fmt: skip
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        _add_corner(
            ax * cy - ay * cx, ax * ax + ay * ay + cx * cx + cy * cy - ax * cx - ay * cy,
            -(ax + cx), -(ay + cy), ay - cy, cx - ax, 2.0, INV_ROOT3,
            mean_weight, inv_limit, squarings, power, s, i,
        )  # fmt: skip


@helper()
def newton_step(s: FloatArray, n: int) -> None:
    for i in range(n):
        hxx, hxy, hyy = s[HXX + i], s[HXY + i], s[HYY + i]
        gx, gy = s[GX + i], s[GY + i]
        inv = 1.0 / (hxx * hyy - hxy * hxy)
        s[SX + i] = -(hyy * gx - hxy * gy) * inv
        s[SY + i] = -(hxx * gy - hxy * gx) * inv


@lane_helper()
def _try_corner(
    left: float, right: float, squares: float, scale: float,
    mean_weight: float, inv_limit: float, squarings: int, s: FloatArray, i: int,
) -> None:  # fmt: skip
    """Add a corner's energy, and keep the least margin by which its area is certified positive."""
    det = left - right
    f = scale * squares / det
    s[TRIAL + i] += mean_weight * f + _power(f * inv_limit, squarings)
    margin = det - (ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND)
    s[MARGIN + i] = margin if margin < s[MARGIN + i] else s[MARGIN + i]


@helper()
def _try_quad(
    star: FloatArray, s: FloatArray, k: int, n: int, mean_weight: float, inv_limit: float, squarings: int
) -> None:
    # All differences are of stored coordinates, and each determinant is taken about one of its
    # points, as the error bound asks.
    for i in range(n):
        px, py = s[PX + i], s[PY + i]
        ax, ay, bx, by = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        cx, cy = star[k + ROW4 + i], star[k + ROW5 + i]
        ux, uy = ax - px, ay - py
        wx, wy = cx - px, cy - py
        va, vc = ux * ux + uy * uy, wx * wx + wy * wy
        _try_corner(ux * wy, uy * wx, va + vc, 0.5, mean_weight, inv_limit, squarings, s, i)
        ex, ey = bx - ax, by - ay
        _try_corner(
            ey * ux, ex * uy, ex * ex + ey * ey + va, 0.5, mean_weight, inv_limit, squarings, s, i
        )
        ex, ey = bx - cx, by - cy
        _try_corner(
            ex * wy, ey * wx, ex * ex + ey * ey + vc, 0.5, mean_weight, inv_limit, squarings, s, i
        )


@helper()
def _try_triangle(
    star: FloatArray, s: FloatArray, k: int, n: int, mean_weight: float, inv_limit: float, squarings: int
) -> None:
    for i in range(n):
        ux, uy = star[k + i] - s[PX + i], star[k + ROW + i] - s[PY + i]
        wx, wy = star[k + ROW2 + i] - s[PX + i], star[k + ROW3 + i] - s[PY + i]
        squares = ux * ux + uy * uy + wx * wx + wy * wy - ux * wx - uy * wy
        _try_corner(ux * wy, uy * wx, squares, INV_ROOT3, mean_weight, inv_limit, squarings, s, i)


@helper()
def start_trial(s: FloatArray, n: int, fraction: float) -> None:
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
        s[TODO + i] = 1.0
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
        _add_triangle(star_xy, s, triangle_rows + k * ROW4, n, mean_weight, inv_limit, squarings, power)
    newton_step(s, n)
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        start_trial(s, n, fraction)
        for k in range(quads):
            _try_quad(star_xy, s, k * ROW6, n, mean_weight, inv_limit, squarings)
        for k in range(triangles):
            _try_triangle(star_xy, s, triangle_rows + k * ROW4, n, mean_weight, inv_limit, squarings)
        left = 0.0
        for i in range(n):
            if (s[TRIAL + i] < s[ENERGY + i]) & (s[MARGIN + i] > 0.0) & (s[TODO + i] > 0.0):
                v = vertices[first + i]
                xy[v, 0], xy[v, 1] = s[PX + i], s[PY + i]
                dx, dy = s[PX + i] - s[X + i], s[PY + i] - s[Y + i]
                moves[first + i] = math.sqrt(dx * dx + dy * dy)
                s[TODO + i] = 0.0
            left += s[TODO + i]
        if left == 0.0 or attempt == len(FRACTIONS):
            break
        fraction = FRACTIONS[attempt]


@parallel_kernel()
def newton_sweep(
    xy: FloatArray, colour_blocks: IndexArray, blocks: TableArray, vertices: TableArray,
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
        The energy of a corner is mean_weight · f + (f / limit) ** (2 ** squarings).
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
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, worst: FloatArray,
    total: FloatArray,
) -> None:  # fmt: skip
    """Measure the largest and the summed shape energy f of each cell's corners.

    Parameters
    ----------
    worst, total : (n_cells,)
        Overwritten; infinite where a corner is not positive.
    """
    for c in prange(worst.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        triangle = last - first == 3
        w_max, w_sum = 0.0, 0.0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
            det = ux * wy - uy * wx
            squares = ux * ux + uy * uy + wx * wx + wy * wy
            if triangle:
                f = INV_ROOT3 * (squares - ux * wx - uy * wy) / det
            else:
                f = 0.5 * squares / det
            f = f if det > 0.0 else np.inf
            w_max = max(w_max, f)
            w_sum += f
            d = a
            if triangle:
                break
        worst[c] = w_max
        total[c] = w_sum
