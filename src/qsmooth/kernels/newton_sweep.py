"""One Newton step per vertex on the energy of its star, on blocks of lanes.

f is the shape energy of `corner_energy` towards each cell's target: a term a corner of a quad, one
a triangle. τ is a corner's determinant over what the target says of it. The badness of a corner is
g = |u| |w| / det(u, w), one over its sine (in a triangle, over that of 60°), so that the largest g
is one over the smallest scaled Jacobian. The energy is the sum of

    mean_weight · (f + ½ γ (τ − 1/τ)²) + (f / F)^16 + (g / threshold)^power

over the cells and corners: mean shape and size; a wall on each cell's shape, F a little beyond what
it was, so that none gets slim for others' sake; and a wall that only bad corners feel, those with g
near or above `threshold`. f is a square over a linear function of the vertex that moves, hence
convex, and g lies under such functions; Newton's steps are those of convex problems and point
downhill.

A trial is refused where it lowers no energy, inverts a cell, or makes a corner or cell worse than
what is held: no state on the way is worse than the first.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, SHAPES, SIZES, WALLS, Block, Blocks, Rows, block_at
from qsmooth.kernels.confining import confined
from qsmooth.kernels.corner_energy import EQUILATERAL
from qsmooth.kernels.lanes import (
    FRACTIONS,
    LEAST_COSINE,
    LEAST_EDGE,
    LEAST_SINE,
    MOST_COSINE,
    MOST_RATIO,
    MOST_SHAPE,
    N_ROWS,
    PX,
    PY,
    ROW0,
    ROW2,
    ROW4,
    ROW6,
    TODO,
    confine_lanes,
    gather_block,
    newton_step,
    start_trial,
    steps_on_rails,
    store_better,
)
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.star_energy import (
    RowArrays,
    Terms,
    WallArrays,
    add_quad,
    add_size,
    add_triangle,
    add_walled_quad,
    add_walled_triangle,
)
from qsmooth.kernels.star_trials import (
    hold_quad,
    hold_triangle,
    try_quad,
    try_size,
    try_triangle,
    try_walled_quad,
    try_walled_triangle,
)

# Up to so many lanes of a block are tried one by one, more of them all together.
FEW = 6
ONE: Any = np.uint64(1)
# The three corners of a quad that see the vertex, by the rows of the other two vertices that make
# up their determinants.
SEEN = ((ROW0, ROW4), (ROW0, ROW2), (ROW2, ROW4))
N_SEEN = len(SEEN)


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


@helper()
def gather_held(vertices: TableArray, first: int, n: int, held: FloatArray, s: FloatArray) -> None:
    """Look up what is held around each vertex: cosines and sine squared, with their signs."""
    for i in range(n):
        v = vertices[first + i]
        most, least, sine = held[v, 0], held[v, 1], held[v, 2]
        s[MOST_COSINE + i], s[LEAST_COSINE + i] = most * abs(most), least * abs(least)
        s[LEAST_SINE + i] = sine * abs(sine)
    if held.shape[1] > 3:
        for i in range(n):
            v = vertices[first + i]
            s[MOST_RATIO + i], s[MOST_SHAPE + i] = held[v, 3], held[v, 4]
            s[LEAST_EDGE + i] = held[v, 5]


@helper()
def _fill_ideal(ideal: FloatArray) -> None:
    """Write down rows of lanes of what ideal cells ask for: 1, and m11 and m12 of triangles."""
    for i in range(LANES):
        ideal[i], ideal[LANES + i], ideal[2 * LANES + i] = 1.0, EQUILATERAL.m11, EQUILATERAL.m12


@helper()
def _move_block(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    relaxation: float,
    terms: Terms,
    held: FloatArray,
    asked: int,
    shapes: RowArrays,
    sizes: RowArrays,
    walls: WallArrays,
    star_xy: FloatArray,
    s: FloatArray,
    ideal: FloatArray,
    rails: Rails,
    lengths: FloatArray,
) -> None:
    gather_block(xy, vertices, stars, block, star_xy, s, lengths)
    n, quads, triangles, row = block.size, block.n_quads, block.n_triangles, block.rows
    gather_held(vertices, block.first, n, held, s)
    walled, sized = terms.scale > 0.0 or asked & WALLS != 0, asked & SIZES != 0
    more = held.shape[1] > 3
    # Ideal shapes are read from rows that stay in the cache, with no loop of their own.
    quad_shapes, triangle_shapes, first_shape, next_shape = shapes, shapes, row, n
    if asked & SHAPES == 0:
        _fill_ideal(ideal)
        one, diagonal, other = ideal[:LANES], ideal[LANES : 2 * LANES], ideal[2 * LANES :]
        quad_shapes, triangle_shapes = (one, one, one), (diagonal, other, diagonal)
        first_shape, next_shape = row - row, n - n
    for k in range(quads):
        at, own, k_row = k * ROW6, first_shape + k * next_shape, row + k * n
        if walled:
            add_walled_quad(star_xy, s, at, n, quad_shapes, own, walls, k_row, terms)
        else:
            add_quad(star_xy, s, at, n, quad_shapes, own, terms)
        if sized:
            for j in range(N_SEEN):
                a, c = at + SEEN[j][0], at + SEEN[j][1]
                add_size(star_xy, s, a, c, n, sizes, k_row, terms.mean_weight)
    for k in range(quads, quads + triangles):
        at, own, k_row = quads * ROW2 + k * ROW4, first_shape + k * next_shape, row + k * n
        if walled:
            add_walled_triangle(star_xy, s, at, n, triangle_shapes, own, walls, k_row, terms)
        else:
            add_triangle(star_xy, s, at, n, triangle_shapes, own, terms)
        if sized:
            add_size(star_xy, s, at, at + ROW2, n, sizes, k_row, terms.mean_weight)
    left = newton_step(s, n)
    on_rails = confined(rails)
    if on_rails:
        left = steps_on_rails(s, vertices, block.first, n, rails)
    nobody = n - n  # zero of its type
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        # All lanes together, or the few that are left one by one.
        alone = left <= FEW
        left = 0.0
        first = nobody
        while first < n:
            lanes = first, (first + ONE if alone else n)
            first = lanes[1]
            if alone and s[TODO + lanes[0]] == 0.0:
                continue
            start_trial(s, lanes, fraction)
            if on_rails:
                confine_lanes(s, PX, PY, lanes, vertices, block.first, rails)
            for k in range(quads):
                at, own, k_row = k * ROW6, first_shape + k * next_shape, row + k * n
                if walled:
                    try_walled_quad(star_xy, s, at, lanes, quad_shapes, own, walls, k_row, terms)
                else:
                    try_quad(star_xy, s, at, lanes, quad_shapes, own, terms)
                if sized:
                    for j in range(N_SEEN):
                        a, c = at + SEEN[j][0], at + SEEN[j][1]
                        try_size(star_xy, s, a, c, lanes, sizes, k_row, terms.mean_weight)
                if more:
                    hold_quad(star_xy, s, at, lanes)
            for k in range(quads, quads + triangles):
                at, own, k_row = quads * ROW2 + k * ROW4, first_shape + k * next_shape, row + k * n
                if walled:
                    try_walled_triangle(
                        star_xy, s, at, lanes, triangle_shapes, own, walls, k_row, terms
                    )
                else:
                    try_triangle(star_xy, s, at, lanes, triangle_shapes, own, terms)
                if sized:
                    try_size(star_xy, s, at, at + ROW2, lanes, sizes, k_row, terms.mean_weight)
                if more:
                    hold_triangle(star_xy, s, at, lanes)
            left += store_better(xy, vertices, block, lanes, s, lengths)
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
    held : (n_vertices, 3) or (n_vertices, 6)
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
    terms = Terms(wall.mean_weight, 1.0 / wall.threshold, wall.squarings, 2.0**wall.squarings)
    colour_blocks, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    asks, shapes = rows.asks, (rows.m11, rows.m12, rows.m22)
    sizes, walls = (rows.area, rows.inv_area, rows.size_weight), (rows.slim, rows.near)
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
                asks[b],
                shapes,
                sizes,
                walls,
                star_xy,
                scratch,
                np.empty(3 * LANES),
                rails,
                lengths,
            )
