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

from qsmooth._types import BoolArray, FloatArray, IndexArray, TableArray
from qsmooth.kernels._jit import helper, kernel, lane_helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, block_at
from qsmooth.kernels.confining import confined
from qsmooth.kernels.corner_energy import (
    Linear,
    determinant,
    determinant_to_next,
    determinant_to_previous,
    equilateral_numerator,
    fixed_half_square,
    half_square,
    square_numerator,
)
from qsmooth.kernels.lanes import (
    FRACTIONS,
    N_ROWS,
    OWN,
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
    confine_lanes,
    gather_block,
    newton_step,
    start_trial,
    steps_on_rails,
    store_better,
)  # fmt: skip
from qsmooth.kernels.rails import Rails

# Row of scratch: the vertex's ε r.
SOFT = OWN


@lane_helper()
def regularised(det: Linear, soft: float) -> Linear:
    """Positive stand-in for a determinant, taken to be linear; `soft` is ε r.

    With a linear denominator the Hessian of the energy is never indefinite.
    """
    root = math.sqrt(det.value * det.value + soft * soft)
    # Two forms of one value: each without cancellation on its side.
    value = 0.5 * (det.value + root) if det.value > 0.0 else 0.5 * soft * soft / (root - det.value)
    slope = value / root
    return Linear(value, slope * det.x, slope * det.y)


@helper()
def add_quad(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    """Add what a quad of each star adds to the energy and its derivatives."""
    for i in range(n):
        px, py, soft = s[X + i], s[Y + i], s[SOFT + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        va, vc = half_square(ax, ay), half_square(cx, cy)
        det = regularised(determinant(ax, ay, cx, cy), soft)
        add_energy(square_numerator(va, vc), det, 1.0, s, i)
        ex, ey = bx - ax, by - ay
        det = regularised(determinant_to_previous(ex, ey, -ax, -ay), soft)
        add_energy(square_numerator(fixed_half_square(ex, ey), va), det, 1.0, s, i)
        ex, ey = bx - cx, by - cy
        det = regularised(determinant_to_next(-cx, -cy, ex, ey), soft)
        add_energy(square_numerator(vc, fixed_half_square(ex, ey)), det, 1.0, s, i)


@helper()
def add_triangle(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    """Add what a triangle of each star adds to the energy and its derivatives."""
    for i in range(n):
        px, py = s[X + i], s[Y + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        va, vc, ac = half_square(ax, ay), half_square(cx, cy), fixed_half_square(cx - ax, cy - ay)
        det = regularised(determinant(ax, ay, cx, cy), s[SOFT + i])
        add_energy(equilateral_numerator(va, vc, ac), det, 1.0, s, i)


@helper()
def try_quad(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    """Add the energy of a quad of each star at the trial places."""
    for i in range(n):
        px, py, soft = s[PX + i], s[PY + i], s[SOFT + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        bx, by = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        cx, cy = star[k + ROW4 + i] - px, star[k + ROW5 + i] - py
        va, vc = half_square(ax, ay), half_square(cx, cy)
        det = regularised(determinant(ax, ay, cx, cy), soft)
        s[TRIAL + i] += square_numerator(va, vc).value / det.value
        ex, ey = bx - ax, by - ay
        det = regularised(determinant_to_previous(ex, ey, -ax, -ay), soft)
        s[TRIAL + i] += square_numerator(fixed_half_square(ex, ey), va).value / det.value
        ex, ey = bx - cx, by - cy
        det = regularised(determinant_to_next(-cx, -cy, ex, ey), soft)
        s[TRIAL + i] += square_numerator(fixed_half_square(ex, ey), vc).value / det.value


@helper()
def try_triangle(star: FloatArray, s: FloatArray, k: int, n: int) -> None:
    """Add the energy of a triangle of each star at the trial places."""
    for i in range(n):
        px, py = s[PX + i], s[PY + i]
        ax, ay = star[k + i] - px, star[k + ROW + i] - py
        cx, cy = star[k + ROW2 + i] - px, star[k + ROW3 + i] - py
        va, vc, ac = half_square(ax, ay), half_square(cx, cy), fixed_half_square(cx - ax, cy - ay)
        det = regularised(determinant(ax, ay, cx, cy), s[SOFT + i])
        s[TRIAL + i] += equilateral_numerator(va, vc, ac).value / det.value


@helper()
def add_regularised(
    star_xy: FloatArray,
    s: FloatArray,
    vertices: TableArray,
    block: Block,
    sizes: FloatArray,
    epsilon: float,
) -> None:
    """Add up the regularised energy of each star of a block, and its derivatives."""
    n, quads = block.size, block.n_quads
    for i in range(n):
        s[SOFT + i] = epsilon * sizes[vertices[block.first + i]]
    for k in range(quads):
        add_quad(star_xy, s, k * ROW6, n)
    for k in range(block.n_triangles):
        add_triangle(star_xy, s, quads * ROW6 + k * ROW4, n)


@helper()
def try_regularised(star_xy: FloatArray, s: FloatArray, block: Block) -> None:
    """Add up the regularised energy of each star of a block at the trial places."""
    n, quads = block.size, block.n_quads
    for k in range(quads):
        try_quad(star_xy, s, k * ROW6, n)
    for k in range(block.n_triangles):
        try_triangle(star_xy, s, quads * ROW6 + k * ROW4, n)


@helper()
def _move_block(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    relaxation: float,
    sizes: FloatArray,
    epsilon: float,
    star_xy: FloatArray,
    s: FloatArray,
    rails: Rails,
    lengths: FloatArray,
) -> None:
    gather_block(xy, vertices, stars, block, star_xy, s, lengths)
    n = block.size
    add_regularised(star_xy, s, vertices, block, sizes, epsilon)
    left = newton_step(s, n)
    on_rails = confined(rails)
    if on_rails:
        left = steps_on_rails(s, vertices, block.first, n, rails)
    everyone = (n - n, n)  # of one type
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        start_trial(s, everyone, fraction)
        if on_rails:
            confine_lanes(s, PX, PY, everyone, vertices, block.first, rails)
        try_regularised(star_xy, s, block)
        # No margin is asked for: the mesh need not be valid.
        left = store_better(xy, vertices, block, everyone, s, lengths)
        fraction = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]


@parallel_kernel()
def untangle_sweep(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    relaxation: float,
    sizes: FloatArray,
    epsilon: float,
    lengths: FloatArray,
) -> None:
    """Move each vertex once, downhill on its star's regularised energy, in place.

    Parameters
    ----------
    sizes : (n_vertices,)
        Local mean squared edge length r.
    epsilon
        Regularisation ε; dimensionless.
    xy, blocks, colours, relaxation, lengths
        As in `newton_sweep.newton_sweep`; the mesh need not be valid.
    """
    colour_blocks, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            scratch, star_xy = np.empty(N_ROWS * LANES), np.empty(6 * largest * LANES)
            _move_block(
                xy,
                vertices,
                stars,
                block_at(table, b),
                relaxation,
                sizes,
                epsilon,
                star_xy,
                scratch,
                rails,
                lengths,
            )


@parallel_kernel()
def smallest_determinant(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, sizes: FloatArray,
    closed: BoolArray, cells: IndexArray, out: FloatArray,
) -> None:  # fmt: skip
    """Find each listed cell's smallest corner determinant over the local squared size r.

    Parameters
    ----------
    sizes : (n_vertices,)
        Local mean squared edge length.
    closed : (n_corners,)
        Corners that do not count.
    cells, out : (n_listed,)
        `out` is overwritten; dimensionless, negative where a corner is inverted, infinite where
        none counts.
    """
    for i in prange(cells.size):
        c = cells[i]
        first, last = cell_offsets[c], cell_offsets[c + 1]
        worst = np.inf
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
            if not closed[k]:
                worst = min(worst, (ux * wy - uy * wx) / sizes[a])
            d = a
        out[i] = worst


@kernel()
def spread_logarithms(
    ring_offsets: IndexArray, ring_vertices: IndexArray, values: FloatArray, out: FloatArray
) -> None:
    """Average a vertex's value with those of its ring (geometrically, when they are logarithms).

    Parameters
    ----------
    values, out : (n_vertices,)
        Infinite values (of vertices in no cell, or whose edges have no length) do not count.
    """
    for v in range(out.size):
        total, count = 0.0, 0
        if math.isfinite(values[v]):
            total, count = values[v], 1
        for k in range(ring_offsets[v], ring_offsets[v + 1]):
            w = ring_vertices[k]
            if math.isfinite(values[w]):
                total += values[w]
                count += 1
        out[v] = total / count if count > 0 else values[v]


@kernel()
def mean_squared_edge(
    xy: FloatArray, ring_offsets: IndexArray, ring_vertices: IndexArray, out: FloatArray
) -> None:
    """Average the squared lengths of each vertex's edges; 0 for a vertex in no cell."""
    for v in range(out.size):
        first, last = ring_offsets[v], ring_offsets[v + 1]
        total = 0.0
        for k in range(first, last):
            w = ring_vertices[k]
            dx, dy = xy[w, 0] - xy[v, 0], xy[w, 1] - xy[v, 1]
            total += dx * dx + dy * dy
        out[v] = total / (last - first) if last > first else 0.0


@kernel()
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
    for i in range(out.size):
        v = vertices[i]
        shortest = np.inf
        for k in range(ring_offsets[v], ring_offsets[v + 1]):
            w = ring_vertices[k]
            dx, dy = xy[w, 0] - xy[v, 0], xy[w, 1] - xy[v, 1]
            shortest = min(shortest, dx * dx + dy * dy)
        out[i] = math.sqrt(shortest)
