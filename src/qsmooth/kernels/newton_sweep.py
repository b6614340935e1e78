"""One Newton step per vertex on the energy of its star, on blocks of lanes.

f is the shape energy of `corner_energy`, for squares in quads and for equilateral triangles: a
term a corner of a quad, one a triangle. The badness of a corner is g = |u| |w| / det(u, w), one
over its sine (in a triangle, over that of 60°), so that the largest g is one over the smallest
scaled Jacobian. The energy is the sum of

    mean_weight · f + (g / threshold)^power

over the cells and corners: the mean shape, and a wall that only bad corners feel, those with g
near or above `threshold`. f is a square over a linear function of the vertex that moves, hence
convex, and g lies under such functions; Newton's steps are those of convex problems and point
downhill.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import prange

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, Rows, block_at
from qsmooth.kernels.corner_energy import (
    INV_ROOT3,
    Linear,
    Quadratic,
    Target,
    corner_shape,
    determinant,
    determinant_to_next,
    determinant_to_previous,
    dot,
    fixed_half_square,
    half_square,
    hessian,
    numerator,
    quotient,
    rectangle_numerator,
)
from qsmooth.kernels.geometry import ORIENTATION_BOUND, UNDERFLOW_BOUND
from qsmooth.kernels.lanes import (
    ENERGY,
    FRACTIONS,
    GX,
    GY,
    HXX,
    HXY,
    HYY,
    LEAST_COSINE,
    LEAST_EDGE,
    LEAST_SINE,
    MARGIN,
    MOST_COSINE,
    MOST_RATIO,
    MOST_SHAPE,
    N_ROWS,
    PX,
    PY,
    ROW,
    ROW2,
    ROW3,
    ROW4,
    ROW5,
    ROW6,
    TRIAL,
    X,
    Y,
    gather_block,
    newton_step,
    start_trial,
    store_better,
)  # fmt: skip

SINE_60 = math.sqrt(0.75)


class Wall(NamedTuple):
    """The weights of the energy mean_weight · f + (g / threshold) ** (2 ** squarings).

    Attributes
    ----------
    mean_weight
        0 or more.
    threshold
        The badness, 1 or more, at which the wall is 1 high; infinite for no wall.
    squarings
        1 to 6: a wall of power 2 to 64.
    """

    mean_weight: float
    threshold: float
    squarings: int


class _Terms(NamedTuple):
    """A `Wall` as the loops need it: one over its threshold, and its power as a float."""

    mean_weight: float
    scale: float
    squarings: int
    power: float


class _Own(NamedTuple):
    """What is asked of one cell besides its shape; see `blocks.Rows`."""

    area: float
    inv_area: float
    size_weight: float
    slim: float


# The arrays of `blocks.Rows`, as helpers take them.
_RowArrays: TypeAlias = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray
]


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
def _shape_wall(f: float, slim: float) -> tuple[float, float, float]:
    """Raise f · slim to the power of 16; also its derivatives by f."""
    r = f * slim
    r2 = r * r
    r4 = r2 * r2
    r8 = r4 * r4
    r14 = r8 * r4 * r2
    return r14 * r2, 16.0 * slim * (r14 * r), 240.0 * slim * slim * r14


@lane_helper()
def _size_term(
    det: float, inv: float, area: float, inv_area: float, weight: float
) -> tuple[float, float, float]:
    """Weight · ½ (τ − 1/τ)² with τ = det / area; also its derivatives by det."""
    tau, back = det * inv_area, area * inv
    off = tau - back
    slope = weight * (tau - back * back * back) * inv_area
    return 0.5 * weight * off * off, slope, weight * (1.0 + 3.0 * back**4) * inv_area * inv_area


@lane_helper()
def _add_shape(
    n: Quadratic, det: Linear, own: _Own, mean_weight: float, s: FloatArray, i: int
) -> None:
    """Add a corner's shape energy, the wall on it and the size term, with their derivatives."""
    inv, f, fx, fy = quotient(n, det)
    high, slope, second = _shape_wall(f, own.slim)
    size, size_slope, size_second = _size_term(
        det.value, inv, own.area, own.inv_area, mean_weight * own.size_weight
    )
    weight = mean_weight + slope
    s[ENERGY + i] += mean_weight * f + high + size
    s[GX + i] += weight * fx + size_slope * det.x
    s[GY + i] += weight * fy + size_slope * det.y
    xx, xy, yy = hessian(n.second, fx, fy, det)
    weight *= inv
    s[HXX + i] += weight * xx + second * fx * fx + size_second * det.x * det.x
    s[HXY + i] += weight * xy + second * fx * fy + size_second * det.x * det.y
    s[HYY + i] += weight * yy + second * fy * fy + size_second * det.y * det.y


@lane_helper()
def _add_wall(
    det: Linear, uu: Quadratic, ww: Quadratic, scale: float, terms: _Terms, s: FloatArray, i: int
) -> None:
    """Add the wall on a corner's badness and its derivatives by the vertex that moves.

    Given are its determinant, and ½ |u|² and ½ |w|² of its edges; and one over the threshold.
    """
    # |u| |w| / det lies under (|u|² t + |w|² / t) / (2 det) for every t > 0, and touches it at the
    # t = |w| / |u| taken here. That bound is convex: what lowers it lowers the energy. It all takes
    # two divisions a corner; with five a sweep was a fifth slower.
    inv = 1.0 / det.value
    root = math.sqrt(uu.value * ww.value)
    inv_root = 1.0 / root
    t, inv_t = ww.value * inv_root, uu.value * inv_root
    g, inv_g = 2.0 * root * inv, 0.5 * det.value * inv_root
    gx = (uu.x * t + ww.x * inv_t - g * det.x) * inv
    gy = (uu.y * t + ww.y * inv_t - g * det.y) * inv
    high = _power(g * scale, terms.squarings)
    slope = terms.power * high * inv_g
    second = (terms.power - 1.0) * slope * inv_g
    s[ENERGY + i] += high
    s[GX + i] += slope * gx
    s[GY + i] += slope * gy
    slope *= inv
    xx, xy, yy = hessian(uu.second * t + ww.second * inv_t, gx, gy, det)
    s[HXX + i] += slope * xx + second * gx * gx
    s[HXY + i] += slope * xy + second * gx * gy
    s[HYY + i] += slope * yy + second * gy * gy


@helper()
def _add_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: _RowArrays,
    row: int,
    terms: _Terms,
) -> None:
    m11s, _, m22s, areas, inv_areas, weights, slims = rows
    weight, scale = terms.mean_weight, terms.scale
    for i in range(n):
        m11, m22 = m11s[row + i], m22s[row + i]
        own = _Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        va, vc = half_square(ax, ay), half_square(cx, cy)
        det = determinant(ax, ay, cx, cy)
        _add_shape(rectangle_numerator(m11, m22, va, vc), det, own, weight, s, i)
        _add_wall(det, va, vc, scale, terms, s, i)
        # At the neighbouring corners the sides of a rectangle change places.
        ex, ey = bx - ax, by - ay
        ab, det = fixed_half_square(ex, ey), determinant_to_previous(ex, ey, -ax, -ay)
        _add_shape(rectangle_numerator(m22, m11, ab, va), det, own, weight, s, i)
        _add_wall(det, ab, va, scale, terms, s, i)
        ex, ey = bx - cx, by - cy
        cb, det = fixed_half_square(ex, ey), determinant_to_next(-cx, -cy, ex, ey)
        _add_shape(rectangle_numerator(m22, m11, vc, cb), det, own, weight, s, i)
        _add_wall(det, vc, cb, scale, terms, s, i)


@helper()
def _add_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: _RowArrays,
    row: int,
    terms: _Terms,
) -> None:
    m11s, m12s, m22s, areas, inv_areas, weights, slims = rows
    # The sine of 60 degrees is ideal in triangles.
    scale = terms.scale * SINE_60
    for i in range(n):
        target = Target(m11s[row + i], m12s[row + i], m22s[row + i])
        own = _Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        va, vc, ac = half_square(ax, ay), half_square(cx, cy), fixed_half_square(cx - ax, cy - ay)
        # One determinant and one shape energy for the triangle, and a badness at each corner.
        det = determinant(ax, ay, cx, cy)
        shape = numerator(target, va, dot(ax, ay, cx, cy), vc)
        _add_shape(shape, det, own, terms.mean_weight, s, i)
        _add_wall(det, va, vc, scale, terms, s, i)
        _add_wall(det, ac, va, scale, terms, s, i)
        _add_wall(det, ac, vc, scale, terms, s, i)


@lane_helper()
def _keep(margin: float, s: FloatArray, i: int) -> None:
    """Keep the least margin by which a trial is allowed."""
    s[MARGIN + i] = margin if margin < s[MARGIN + i] else s[MARGIN + i]


@lane_helper()
def _hold_edges(
    va: float, vc: float, shortest: float, longest: float, s: FloatArray, i: int
) -> None:
    """Keep the margins of a cell's edges; given are half the squares, two of edges that move."""
    own = min(va, vc)
    _keep(own - s[LEAST_EDGE + i], s, i)
    _keep(s[MOST_RATIO + i] * min(own, shortest) - max(max(va, vc), longest), s, i)


@lane_helper()
def _try_shape(n: float, det: float, own: _Own, weight: float, s: FloatArray, i: int) -> None:
    """Add a corner's shape energy, the wall on it and the size term."""
    inv = 1.0 / det
    f = n * inv
    off = det * own.inv_area - own.area * inv
    s[TRIAL + i] += weight * (f + 0.5 * own.size_weight * off * off) + _power(f * own.slim, 4)


@lane_helper()
def _try_wall(
    det: float,
    dot_: float,
    uu: float,
    ww: float,
    scale: float,
    best_sine: float,
    squarings: int,
    s: FloatArray,
    i: int,
) -> None:
    """Add the wall on a corner, and keep the margin by which it is no worse than what is held."""
    lengths = 2.0 * math.sqrt(uu * ww)
    s[TRIAL + i] += _power(lengths / det * scale, squarings)
    _keep(s[MOST_COSINE + i] * lengths - dot_, s, i)
    _keep(dot_ - s[LEAST_COSINE + i] * lengths, s, i)
    _keep(det - s[LEAST_SINE + i] * best_sine * lengths, s, i)


@lane_helper()
def _certify(left: float, right: float, s: FloatArray, i: int) -> float:
    """Keep the margin by which a corner's area is certified positive; give its determinant."""
    det = left - right
    _keep(det - (ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND), s, i)
    return det


@helper()
def _try_quad(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: _RowArrays,
    row: int,
    terms: _Terms,
) -> None:
    # All differences are of stored coordinates, and each determinant is taken about one of its
    # points, as the error bound asks.
    m11s, _, m22s, areas, inv_areas, weights, slims = rows
    weight, scale, squarings = terms.mean_weight, terms.scale, terms.squarings
    for i in range(n):
        m11, m22 = m11s[row + i], m22s[row + i]
        own = _Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        px, py = s[PX + i], s[PY + i]
        ax, ay, bx, by = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        cx, cy = star[k + ROW4 + i], star[k + ROW5 + i]
        ux, uy = ax - px, ay - py
        wx, wy = cx - px, cy - py
        va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
        det = _certify(ux * wy, uy * wx, s, i)
        _keep(s[MOST_SHAPE + i] * det - (va + vc), s, i)
        _try_shape(m11 * va + m22 * vc, det, own, weight, s, i)
        _try_wall(det, ux * wx + uy * wy, va, vc, scale, 1.0, squarings, s, i)
        ex, ey = bx - ax, by - ay
        ab = 0.5 * (ex * ex + ey * ey)
        det = _certify(ey * ux, ex * uy, s, i)
        _keep(s[MOST_SHAPE + i] * det - (ab + va), s, i)
        _try_shape(m22 * ab + m11 * va, det, own, weight, s, i)
        _try_wall(det, -(ex * ux + ey * uy), ab, va, scale, 1.0, squarings, s, i)
        ex, ey = bx - cx, by - cy
        cb = 0.5 * (ex * ex + ey * ey)
        det = _certify(ex * wy, ey * wx, s, i)
        _keep(s[MOST_SHAPE + i] * det - (cb + vc), s, i)
        _hold_edges(va, vc, min(ab, cb), max(ab, cb), s, i)
        _try_shape(m22 * vc + m11 * cb, det, own, weight, s, i)
        _try_wall(det, -(ex * wx + ey * wy), cb, vc, scale, 1.0, squarings, s, i)


@helper()
def _try_triangle(
    star: FloatArray,
    s: FloatArray,
    k: int,
    n: int,
    rows: _RowArrays,
    row: int,
    terms: _Terms,
) -> None:
    m11s, m12s, m22s, areas, inv_areas, weights, slims = rows
    scale, squarings = terms.scale * SINE_60, terms.squarings
    for i in range(n):
        own = _Own(areas[row + i], inv_areas[row + i], weights[row + i], slims[row + i])
        ax, ay, cx, cy = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        ux, uy = ax - s[PX + i], ay - s[PY + i]
        wx, wy = cx - s[PX + i], cy - s[PY + i]
        ex, ey = cx - ax, cy - ay
        va, vc = 0.5 * (ux * ux + uy * uy), 0.5 * (wx * wx + wy * wy)
        ac, uw = 0.5 * (ex * ex + ey * ey), ux * wx + uy * wy
        shape = m11s[row + i] * va + m12s[row + i] * uw + m22s[row + i] * vc
        det = _certify(ux * wy, uy * wx, s, i)
        _keep(s[MOST_SHAPE + i] * det - INV_ROOT3 * (va + vc + ac), s, i)
        _hold_edges(va, vc, ac, ac, s, i)
        _try_shape(shape, det, own, terms.mean_weight, s, i)
        _try_wall(det, uw, va, vc, scale, SINE_60, squarings, s, i)
        _try_wall(det, -(ex * ux + ey * uy), ac, va, scale, SINE_60, squarings, s, i)
        _try_wall(det, ex * wx + ey * wy, ac, vc, scale, SINE_60, squarings, s, i)


@helper()
def _move_block(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    relaxation: float,
    terms: _Terms,
    held: FloatArray,
    rows: _RowArrays,
    star_xy: FloatArray,
    s: FloatArray,
    lengths: FloatArray,
) -> None:
    gather_block(xy, vertices, stars, block, star_xy, s, lengths)
    n, quads, triangles = block.size, block.n_quads, block.n_triangles
    for i in range(n):
        v = vertices[block.first + i]
        s[MOST_COSINE + i], s[LEAST_COSINE + i] = held[v, 0], held[v, 1]
        s[LEAST_SINE + i], s[MOST_RATIO + i] = held[v, 2], held[v, 3]
        s[MOST_SHAPE + i], s[LEAST_EDGE + i] = held[v, 4], held[v, 5]
    triangle_rows = quads * ROW6
    row = block.rows
    triangle_row = row + quads * n
    for k in range(quads):
        _add_quad(star_xy, s, k * ROW6, n, rows, row + k * n, terms)
    for k in range(triangles):
        _add_triangle(star_xy, s, triangle_rows + k * ROW4, n, rows, triangle_row + k * n, terms)
    left = newton_step(s, n)
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        start_trial(s, n, fraction)
        for k in range(quads):
            _try_quad(star_xy, s, k * ROW6, n, rows, row + k * n, terms)
        for k in range(triangles):
            _try_triangle(
                star_xy, s, triangle_rows + k * ROW4, n, rows, triangle_row + k * n, terms
            )
        left = store_better(xy, vertices, block, s, lengths)
        fraction = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]


@parallel_kernel()
def newton_sweep(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    relaxation: float,
    wall: Wall,
    held: FloatArray,
    rows: Rows,
    lengths: FloatArray,
) -> None:
    """Move each vertex once, downhill on its star's energy, in place.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates of a valid mesh. Moved in place.
    blocks
        The movable vertices (`blocks.build_blocks`).
    colours
        First colour to move, and the one to stop before; (0, n_colours) moves every vertex.
    relaxation
        Multiple of the Newton step that is tried first; then 1, 0.4 and 0.1.
    wall
        The weights of the energy.
    held : (n_vertices, 6)
        What no corner and no cell that the vertex changes may be worse than: the largest cosine,
        the smallest cosine, the smallest sine (in a triangle over that of 60 degrees) of a corner;
        the longest over the shortest edge of a cell, squared; the shape energy to the ideal cell;
        half the square of an edge. A move to what is worse is refused, as one that inverts a cell.
    rows
        What is asked of each cell of each star.
    lengths : (n_movable,)
        Overwritten for the vertices of these colours, in block order. Length of each move.
    """
    # Not in a helper: a parallel loop has to see the class of a tuple that it takes.
    terms = _Terms(wall.mean_weight, 1.0 / wall.threshold, wall.squarings, 2.0**wall.squarings)
    colour_blocks, table, vertices, stars, _, largest = blocks
    row_arrays = (
        rows.m11, rows.m12, rows.m22, rows.area, rows.inv_area, rows.size_weight, rows.slim,
    )  # fmt: skip
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            scratch, star_xy = np.empty(N_ROWS * LANES), np.empty(6 * largest * LANES)
            _move_block(
                xy,
                vertices,
                stars,
                block_at(table, b),
                relaxation,
                terms,
                held,
                row_arrays,
                star_xy,
                scratch,
                lengths,
            )


@parallel_kernel()
def cell_energy(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    movable: BoolArray,
    targets: FloatArray,
    sizes: FloatArray,
    badness: FloatArray,
    energy: FloatArray,
) -> None:
    """Measure each cell's largest badness g, and its energy: shape and size, mean of its corners.

    Parameters
    ----------
    movable : (n_vertices,)
        Corners without a movable vertex can't change and do not count.
    targets : (n_corners, 3)
        m11, m12, m22 at each corner (`corner_energy.Target`).
    sizes : (n_cells, 2)
        One over the target of the corners' determinants, and the weight of the size term.
    badness, energy : (n_cells,)
        Overwritten; 0 where no corner counts, infinite where one that does is not positive.
    """
    for c in prange(badness.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        best_sine = SINE_60 if last - first == 3 else 1.0
        inv_area, weight = sizes[c, 0], sizes[c, 1]
        worst, total = 0.0, 0.0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            if movable[a] or movable[b] or movable[d]:
                ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
                wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
                target = Target(targets[k, 0], targets[k, 1], targets[k, 2])
                n, det = corner_shape(target, ux, uy, wx, wy)
                if det > 0.0:
                    lengths = math.sqrt((ux * ux + uy * uy) * (wx * wx + wy * wy))
                    worst = max(worst, best_sine * lengths / det)
                    total += n / det
                    if weight > 0.0:
                        tau = det * inv_area
                        total += 0.5 * weight * (tau - 1.0 / tau) ** 2
                else:
                    worst, total = np.inf, np.inf
            d = a
        badness[c] = worst
        energy[c] = total / (last - first)


@parallel_kernel()
def corner_extremes(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    movable: BoolArray,
    out: FloatArray,
) -> None:
    """Measure the extremes of each cell's corners, by the formulas of `newton_sweep`.

    Parameters
    ----------
    movable : (n_vertices,)
        Corners without a movable vertex can't change and do not count.
    out : (n_cells, 3)
        Overwritten: the largest cosine, the smallest cosine, the smallest sine (in a triangle over
        that of 60 degrees); -1, 1, 1 where no corner counts.
    """
    for c in prange(out.shape[0]):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        best_sine = SINE_60 if last - first == 3 else 1.0
        most, least, sine = -1.0, 1.0, 1.0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            if movable[a] or movable[b] or movable[d]:
                ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
                wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
                lengths = math.sqrt((ux * ux + uy * uy) * (wx * wx + wy * wy))
                cosine = (ux * wx + uy * wy) / lengths
                most, least = max(most, cosine), min(least, cosine)
                sine = min(sine, (ux * wy - uy * wx) / (lengths * best_sine))
            d = a
        out[c, 0], out[c, 1], out[c, 2] = most, least, sine


@parallel_kernel()
def worst_shape(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    targets: FloatArray,
    out: FloatArray,
) -> None:
    """Measure the largest shape energy of each cell's corners, towards their targets.

    Parameters
    ----------
    targets : (n_corners, 3)
        m11, m12, m22 at each corner (`corner_energy.Target`).
    out : (n_cells,)
        Overwritten; 1 at best, infinite where a corner is not positive.
    """
    for c in prange(out.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        worst = 1.0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            target = Target(targets[k, 0], targets[k, 1], targets[k, 2])
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
            n, det = corner_shape(target, ux, uy, wx, wy)
            worst = max(worst, n / det if det > 0.0 else np.inf)
            d = a
        out[c] = worst
