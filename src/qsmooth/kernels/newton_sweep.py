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

from typing import NamedTuple

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, Rows, block_at
from qsmooth.kernels.lanes import (
    FRACTIONS,
    LEAST_COSINE,
    LEAST_EDGE,
    LEAST_SINE,
    MOST_COSINE,
    MOST_RATIO,
    MOST_SHAPE,
    N_ROWS,
    ROW4,
    ROW6,
    gather_block,
    newton_step,
    start_trial,
    store_better,
)
from qsmooth.kernels.star_energy import (
    RowArrays,
    Terms,
    add_quad,
    add_triangle,
    try_quad,
    try_triangle,
)


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
def _move_block(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    relaxation: float,
    terms: Terms,
    held: FloatArray,
    rows: RowArrays,
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
        add_quad(star_xy, s, k * ROW6, n, rows, row + k * n, terms)
    for k in range(triangles):
        add_triangle(star_xy, s, triangle_rows + k * ROW4, n, rows, triangle_row + k * n, terms)
    left = newton_step(s, n)
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        start_trial(s, n, fraction)
        for k in range(quads):
            try_quad(star_xy, s, k * ROW6, n, rows, row + k * n, terms)
        for k in range(triangles):
            try_triangle(star_xy, s, triangle_rows + k * ROW4, n, rows, triangle_row + k * n, terms)
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
    terms = Terms(wall.mean_weight, 1.0 / wall.threshold, wall.squarings, 2.0**wall.squarings)
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
