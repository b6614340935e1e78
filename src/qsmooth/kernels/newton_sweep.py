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
from typing import NamedTuple

import numpy as np
from numba import prange

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, block_at
from qsmooth.kernels.corner_energy import (
    Linear,
    Quadratic,
    determinant,
    determinant_to_next,
    determinant_to_previous,
    equilateral_numerator,
    fixed_half_square,
    half_square,
    hessian,
    ideal_corner_shape,
    quotient,
    square_numerator,
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
    MARGIN,
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
    add_energy,
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


class Terms(NamedTuple):
    """A `Wall` as the loops need it: one over its threshold, and its power as a float."""

    mean_weight: float
    scale: float
    squarings: int
    power: float


@helper()
def _for_triangles(terms: Terms) -> Terms:
    """Measure badness in triangles, where the sine of 60 degrees is ideal: the wall alone."""
    return Terms(0.0, terms.scale * SINE_60, terms.squarings, terms.power)


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
    n: Quadratic,
    det: Linear,
    uu: Quadratic,
    ww: Quadratic,
    terms: Terms,
    s: FloatArray,
    i: int,
) -> None:
    """Add a corner's energy and its derivatives by the vertex that moves.

    Given are numerator and determinant of its shape energy, and ½ |u|² and ½ |w|² of its edges.
    """
    inv, f, fx, fy = quotient(n, det)
    # |u| |w| / det lies under (|u|² t + |w|² / t) / (2 det) for every t > 0, and touches it at the
    # t = |w| / |u| taken here. That bound is convex: what lowers it lowers the energy. It all takes
    # two divisions a corner; with five a sweep was a fifth slower.
    root = math.sqrt(uu.value * ww.value)
    inv_root = 1.0 / root
    t, inv_t = ww.value * inv_root, uu.value * inv_root
    g, inv_g = 2.0 * root * inv, 0.5 * det.value * inv_root
    gx = (uu.x * t + ww.x * inv_t - g * det.x) * inv
    gy = (uu.y * t + ww.y * inv_t - g * det.y) * inv
    high = _power(g * terms.scale, terms.squarings)
    slope = terms.power * high * inv_g
    second = (terms.power - 1.0) * slope * inv_g
    s[ENERGY + i] += terms.mean_weight * f + high
    s[GX + i] += terms.mean_weight * fx + slope * gx
    s[GY + i] += terms.mean_weight * fy + slope * gy
    # Both terms are quotients over det, so that their Hessians add up before the division.
    first, slope = terms.mean_weight * inv, slope * inv
    xx, xy, yy = hessian(
        first * n.second + slope * (uu.second * t + ww.second * inv_t),
        first * fx + slope * gx,
        first * fy + slope * gy,
        det,
    )
    s[HXX + i] += xx + second * gx * gx
    s[HXY + i] += second * gx * gy + xy
    s[HYY + i] += yy + second * gy * gy


@helper()
def add_quad(star: FloatArray, s: FloatArray, k: int, n: int, terms: Terms) -> None:
    """Add what a quad of each star adds to the energy and its derivatives."""
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        va, vc = half_square(ax, ay), half_square(cx, cy)
        _add_corner(square_numerator(va, vc), determinant(ax, ay, cx, cy), va, vc, terms, s, i)
        ex, ey = bx - ax, by - ay
        ab, det = fixed_half_square(ex, ey), determinant_to_previous(ex, ey, -ax, -ay)
        _add_corner(square_numerator(ab, va), det, ab, va, terms, s, i)
        ex, ey = bx - cx, by - cy
        cb, det = fixed_half_square(ex, ey), determinant_to_next(-cx, -cy, ex, ey)
        _add_corner(square_numerator(vc, cb), det, vc, cb, terms, s, i)


@helper()
def add_triangle(star: FloatArray, s: FloatArray, k: int, n: int, terms: Terms) -> None:
    """Add what a triangle of each star adds to the energy and its derivatives."""
    wall = _for_triangles(terms)
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        va, vc, ac = half_square(ax, ay), half_square(cx, cy), fixed_half_square(cx - ax, cy - ay)
        # One determinant and one shape energy for the triangle, and a badness at each corner.
        det, shape = determinant(ax, ay, cx, cy), equilateral_numerator(va, vc, ac)
        add_energy(shape, det, terms.mean_weight, s, i)
        _add_corner(shape, det, va, vc, wall, s, i)
        _add_corner(shape, det, ac, va, wall, s, i)
        _add_corner(shape, det, ac, vc, wall, s, i)


@lane_helper()
def _try_corner(
    left: float, right: float, n: float, uu: float, ww: float, terms: Terms, s: FloatArray, i: int
) -> None:
    """Add a corner's energy, and keep the least margin by which its area is certified positive."""
    det = left - right
    inv = 1.0 / det
    steepness = math.sqrt(uu * ww) * inv * (2.0 * terms.scale)
    s[TRIAL + i] += terms.mean_weight * n * inv + _power(steepness, terms.squarings)
    margin = det - (ORIENTATION_BOUND * (abs(left) + abs(right)) + UNDERFLOW_BOUND)
    s[MARGIN + i] = margin if margin < s[MARGIN + i] else s[MARGIN + i]


@helper()
def try_quad(star: FloatArray, s: FloatArray, k: int, n: int, terms: Terms) -> None:
    """Add the energy of a quad of each star at the trial places."""
    # All differences are of stored coordinates, and each determinant is taken about one of its
    # points, as the error bound asks.
    for i in range(n):
        px, py = s[PX + i], s[PY + i]
        ax, ay, bx, by = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        cx, cy = star[k + ROW4 + i], star[k + ROW5 + i]
        ux, uy = ax - px, ay - py
        wx, wy = cx - px, cy - py
        va, vc = half_square(ux, uy), half_square(wx, wy)
        shape = square_numerator(va, vc).value
        _try_corner(ux * wy, uy * wx, shape, va.value, vc.value, terms, s, i)
        ex, ey = bx - ax, by - ay
        ab = fixed_half_square(ex, ey)
        shape = square_numerator(ab, va).value
        _try_corner(ey * ux, ex * uy, shape, ab.value, va.value, terms, s, i)
        ex, ey = bx - cx, by - cy
        cb = fixed_half_square(ex, ey)
        shape = square_numerator(cb, vc).value
        _try_corner(ex * wy, ey * wx, shape, cb.value, vc.value, terms, s, i)


@helper()
def try_triangle(star: FloatArray, s: FloatArray, k: int, n: int, terms: Terms) -> None:
    """Add the energy of a triangle of each star at the trial places."""
    wall = _for_triangles(terms)
    for i in range(n):
        ax, ay, cx, cy = star[k + i], star[k + ROW + i], star[k + ROW2 + i], star[k + ROW3 + i]
        ux, uy = ax - s[PX + i], ay - s[PY + i]
        wx, wy = cx - s[PX + i], cy - s[PY + i]
        va, vc, ac = half_square(ux, uy), half_square(wx, wy), fixed_half_square(cx - ax, cy - ay)
        shape = equilateral_numerator(va, vc, ac).value
        _try_corner(ux * wy, uy * wx, shape, va.value, vc.value, wall, s, i)
        inv = 1.0 / (ux * wy - uy * wx)
        s[TRIAL + i] += terms.mean_weight * shape * inv
        at_a = math.sqrt(ac.value * va.value) * inv * (2.0 * wall.scale)
        at_c = math.sqrt(ac.value * vc.value) * inv * (2.0 * wall.scale)
        s[TRIAL + i] += _power(at_a, wall.squarings)
        s[TRIAL + i] += _power(at_c, wall.squarings)


@helper()
def _move_block(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    relaxation: float,
    terms: Terms,
    star_xy: FloatArray,
    s: FloatArray,
    lengths: FloatArray,
) -> None:
    gather_block(xy, vertices, stars, block, star_xy, s, lengths)
    n, quads, triangles = block.size, block.n_quads, block.n_triangles
    triangle_rows = quads * ROW6
    for k in range(quads):
        add_quad(star_xy, s, k * ROW6, n, terms)
    for k in range(triangles):
        add_triangle(star_xy, s, triangle_rows + k * ROW4, n, terms)
    left = newton_step(s, n)
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        start_trial(s, n, fraction)
        for k in range(quads):
            try_quad(star_xy, s, k * ROW6, n, terms)
        for k in range(triangles):
            try_triangle(star_xy, s, triangle_rows + k * ROW4, n, terms)
        left = store_better(xy, vertices, block, s, lengths)
        fraction = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]


@parallel_kernel()
def newton_sweep(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    relaxation: float,
    wall: Wall,
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
    lengths : (n_movable,)
        Overwritten for the vertices of these colours, in block order. Length of each move.
    """
    # Not in a helper: a parallel loop has to see the class of a tuple that it takes.
    terms = Terms(wall.mean_weight, 1.0 / wall.threshold, wall.squarings, 2.0**wall.squarings)
    colour_blocks, table, vertices, stars, largest = blocks
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
    badness: FloatArray,
    shape: FloatArray,
) -> None:
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
        best_sine = SINE_60 if triangle else 1.0
        worst, total = 0.0, 0.0
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            if movable[a] or movable[b] or movable[d]:
                ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
                wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
                n, det = ideal_corner_shape(triangle, ux, uy, wx, wy)
                if det > 0.0:
                    lengths = math.sqrt((ux * ux + uy * uy) * (wx * wx + wy * wy))
                    worst = max(worst, best_sine * lengths / det)
                    total += n / det
                else:
                    worst, total = np.inf, np.inf
            d = a
        badness[c] = worst
        shape[c] = total / (last - first)
