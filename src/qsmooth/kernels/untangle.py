"""Untangling: Newton steps per vertex on the shape energy with a regularised determinant.

Where the determinant of a corner is not positive the shape energy has a wall. Replacing det by
r χ(det / r), χ(d) = (d + √(ε² + d²)) / 2, with r the local mean squared edge length, makes it
finite everywhere and steep where corners are inverted; as the worst corner improves, ε is lowered.

V. Garanzha, I. Kaporin, L. Kudryavtseva, F. Protais, N. Ray, D. Sokolov, "Foldover-free maps in 50
lines of code", ACM Trans. Graph. 40 (2021), in two dimensions.
"""

import math

import numpy as np
from numba import prange

from qsmooth._types import BlockArray, BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import FIRST, LANES, N_QUADS, N_TRIANGLES, SIZE, STAR, lane_row
from qsmooth.kernels.geometry import distance, orientation
from qsmooth.kernels.newton import (
    ENERGY,
    FRACTIONS,
    GX,
    GY,
    HXX,
    HXY,
    HYY,
    INV_ROOT3,
    PX,
    PY,
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
    ROW6,
    TODO,
    TRIAL,
    X,
    Y,
    gather_block,
    newton_step,
    start_trial,
)  # fmt: skip

N_ROWS = 16
# One more row of scratch: the vertex's ε r.
SOFT = lane_row(15)


@lane_helper()
def _regularised(det: float, soft: float) -> tuple[float, float]:
    """Positive stand-in for a determinant, and its derivative; `soft` is ε r."""
    root = math.sqrt(det * det + soft * soft)
    # Two forms of one value: each without cancellation on its side.
    value = 0.5 * (det + root) if det > 0.0 else 0.5 * soft * soft / (root - det)
    return value, value / root


@lane_helper()
def _add_corner(
    det: float, squares: float, nx: float, ny: float, dx: float, dy: float, n2: float, scale: float,
    s: FloatArray, i: int,
) -> None:  # fmt: skip
    value, slope = _regularised(det, s[SOFT + i])
    inv = 1.0 / value
    f = scale * squares * inv
    dx, dy = slope * dx, slope * dy
    fx, fy = (scale * nx - f * dx) * inv, (scale * ny - f * dy) * inv
    s[ENERGY + i] += f
    s[GX + i] += fx
    s[GY + i] += fy
    # The Hessian as if the stand-in were linear: then it is never indefinite.
    s[HXX + i] += (scale * n2 - 2.0 * fx * dx) * inv
    s[HXY + i] -= (fx * dy + fy * dx) * inv
    s[HYY + i] += (scale * n2 - 2.0 * fy * dy) * inv


@helper()
def _add_quad(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        _add_corner(
            ax * cy - ay * cx, ax * ax + ay * ay + cx * cx + cy * cy,
            -2.0 * (ax + cx), -2.0 * (ay + cy), ay - cy, cx - ax, 4.0, 0.5, s, i,
        )  # fmt: skip
        ux, uy = bx - ax, by - ay
        _add_corner(
            uy * ax - ux * ay, ux * ux + uy * uy + ax * ax + ay * ay,
            -2.0 * ax, -2.0 * ay, -uy, ux, 2.0, 0.5, s, i,
        )  # fmt: skip
        ux, uy = bx - cx, by - cy
        _add_corner(
            cy * ux - cx * uy, ux * ux + uy * uy + cx * cx + cy * cy,
            -2.0 * cx, -2.0 * cy, uy, -ux, 2.0, 0.5, s, i,
        )  # fmt: skip


@helper()
def _add_triangle(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        _add_corner(
            ax * cy - ay * cx, ax * ax + ay * ay + cx * cx + cy * cy - ax * cx - ay * cy,
            -(ax + cx), -(ay + cy), ay - cy, cx - ax, 2.0, INV_ROOT3, s, i,
        )  # fmt: skip


@lane_helper()
def _try_corner(det: float, squares: float, scale: float, s: FloatArray, i: int) -> None:
    value, _ = _regularised(det, s[SOFT + i])
    s[TRIAL + i] += scale * squares / value


@helper()
def _try_quad(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    for i in range(n):
        px, py = s[PX + i], s[PY + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        va, vc = ax * ax + ay * ay, cx * cx + cy * cy
        _try_corner(ax * cy - ay * cx, va + vc, 0.5, s, i)
        ux, uy = bx - ax, by - ay
        _try_corner(uy * ax - ux * ay, ux * ux + uy * uy + va, 0.5, s, i)
        ux, uy = bx - cx, by - cy
        _try_corner(cy * ux - cx * uy, ux * ux + uy * uy + vc, 0.5, s, i)


@helper()
def _try_triangle(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    for i in range(n):
        px, py = s[PX + i], s[PY + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        squares = ax * ax + ay * ay + cx * cx + cy * cy - ax * cx - ay * cy
        _try_corner(ax * cy - ay * cx, squares, INV_ROOT3, s, i)


@helper()
def _move_block(
    xy: FloatArray, vertices: TableArray, stars: TableArray, first: int, n: int, quads: int,
    triangles: int, entry: int, relaxation: float, sizes: FloatArray, epsilon: float,
    star_xy: FloatArray, s: FloatArray, moves: FloatArray,
) -> None:  # fmt: skip
    gather_block(xy, vertices, stars, first, n, 3 * quads + 2 * triangles, entry, star_xy, s, moves)
    for i in range(n):
        s[SOFT + i] = epsilon * sizes[vertices[first + i]]
    triangle_rows = quads * ROW6
    for k in range(quads):
        _add_quad(star_xy, s, k * ROW6, n)
    for k in range(triangles):
        _add_triangle(star_xy, s, triangle_rows + k * ROW4, n)
    left = newton_step(s, n)
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        start_trial(s, n, fraction)
        for k in range(quads):
            _try_quad(star_xy, s, k * ROW6, n)
        for k in range(triangles):
            _try_triangle(star_xy, s, triangle_rows + k * ROW4, n)
        left = 0.0
        for i in range(n):
            if (s[TRIAL + i] < s[ENERGY + i]) & (s[TODO + i] > 0.0):
                v = vertices[first + i]
                xy[v, 0], xy[v, 1] = s[PX + i], s[PY + i]
                dx, dy = s[PX + i] - s[X + i], s[PY + i] - s[Y + i]
                moves[first + i] = math.sqrt(dx * dx + dy * dy)
                s[TODO + i] = 0.0
            left += s[TODO + i]
        fraction = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]


@parallel_kernel()
def untangle_sweep(
    xy: FloatArray, colour_blocks: IndexArray, blocks: BlockArray, vertices: TableArray,
    stars: TableArray, largest_star: int, relaxation: float, sizes: FloatArray, epsilon: float,
    moves: FloatArray,
) -> None:  # fmt: skip
    """Move each vertex once, downhill on its star's regularised energy, in place.

    Parameters
    ----------
    sizes : (n_vertices,)
        Local mean squared edge length r.
    epsilon
        Regularisation ε; dimensionless.
    xy, colour_blocks, blocks, vertices, stars, largest_star, relaxation, moves
        As in `newton.newton_sweep`; the mesh need not be valid.
    """
    for colour in range(colour_blocks.size - 1):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            scratch, star_xy = np.empty(N_ROWS * LANES), np.empty(6 * largest_star * LANES)
            _move_block(
                xy, vertices, stars, blocks[b, FIRST], blocks[b, SIZE], blocks[b, N_QUADS],
                blocks[b, N_TRIANGLES], blocks[b, STAR], relaxation, sizes, epsilon, star_xy,
                scratch, moves,
            )  # fmt: skip


@parallel_kernel()
def smallest_determinant(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, sizes: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Find each cell's smallest corner determinant over the local squared size r.

    Parameters
    ----------
    sizes : (n_vertices,)
        Local mean squared edge length.
    out : (n_cells,)
        Overwritten; dimensionless, negative where a corner is inverted.
    """
    for c in prange(out.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        worst = np.inf
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
            worst = min(worst, (ux * wy - uy * wx) / sizes[a])
            d = a
        out[c] = worst


@parallel_kernel()
def spread_logarithms(
    ring_offsets: IndexArray, ring_vertices: IndexArray, values: FloatArray, out: FloatArray
) -> None:
    """Average a vertex's value with those of its ring (geometrically, when they are logarithms).

    Parameters
    ----------
    values, out : (n_vertices,)
        Infinite values (of vertices in no cell, or whose edges have no length) do not count.
    """
    for v in prange(out.size):
        total, count = 0.0, 0
        if math.isfinite(values[v]):
            total, count = values[v], 1
        for k in range(ring_offsets[v], ring_offsets[v + 1]):
            w = ring_vertices[k]
            if math.isfinite(values[w]):
                total += values[w]
                count += 1
        out[v] = total / count if count > 0 else values[v]


@parallel_kernel()
def mean_squared_edge(
    xy: FloatArray, ring_offsets: IndexArray, ring_vertices: IndexArray, out: FloatArray
) -> None:
    """Average the squared lengths of each vertex's edges; 0 for a vertex in no cell."""
    for v in prange(out.size):
        first, last = ring_offsets[v], ring_offsets[v + 1]
        total = 0.0
        for k in range(first, last):
            w = ring_vertices[k]
            dx, dy = xy[w, 0] - xy[v, 0], xy[w, 1] - xy[v, 1]
            total += dx * dx + dy * dy
        out[v] = total / (last - first) if last > first else 0.0


@parallel_kernel()
def hopeless_cells(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, movable: BoolArray,
    out: BoolArray,
) -> None:  # fmt: skip
    """Mark cells with a corner that is not positive and whose three vertices can't move.

    Parameters
    ----------
    out : (n_cells,)
        Overwritten.
    """
    for c in prange(out.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        out[c] = False
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            if not (movable[a] or movable[b] or movable[d]):
                turn = orientation(xy[d, 0], xy[d, 1], xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])
                out[c] = out[c] or turn <= 0
            d = a


@parallel_kernel()
def shortest_edges(
    xy: FloatArray, ring_offsets: IndexArray, ring_vertices: IndexArray, vertices: TableArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Measure the shortest edge of each listed vertex.

    Parameters
    ----------
    vertices, out : (n_listed,)
        `out` is overwritten; a length.
    """
    for i in prange(out.size):
        v = vertices[i]
        shortest = np.inf
        for k in range(ring_offsets[v], ring_offsets[v + 1]):
            w = ring_vertices[k]
            shortest = min(shortest, distance(xy[v, 0], xy[v, 1], xy[w, 0], xy[w, 1]))
        out[i] = shortest
