"""Newton sweeps towards targets with a direction: edges are mapped before their shape is taken.

Each cell has a symmetric map L with determinant one, frozen while vertices move. The energy is that
of `newton_sweep`, with f of the mapped edges in the mean and in the wall on shape. Sizes, the wall
on corners, what is held and validity are those of the edges as they are.

The star is mapped cell by cell, about the place of the vertex, and goes through the same loops.
What they find comes back by the chain rule: the gradient by L, the Hessian by L H L.

A kernel of its own: nobody else waits for it to compile, or carries maps along.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, Block, Blocks, Rows, block_at
from qsmooth.kernels.confining import confined
from qsmooth.kernels.lanes import (
    ENERGY,
    FRACTIONS,
    GX,
    GY,
    HXX,
    HXY,
    HYY,
    N_ROWS,
    PX,
    PY,
    ROW,
    ROW2,
    ROW4,
    ROW6,
    TRIAL,
    LaneRange,
    X,
    Y,
    confine_lanes,
    gather_block,
    newton_step,
    start_trial,
    steps_on_rails,
    store_better,
)
from qsmooth.kernels.newton_sweep import N_SEEN, SEEN, Wall, gather_held
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.star_energy import (
    RowArrays,
    Terms,
    WallArrays,
    add_size,
    add_walled_quad,
    add_walled_triangle,
)
from qsmooth.kernels.star_trials import (
    hold_quad,
    hold_triangle,
    try_size,
    try_walled_quad,
    try_walled_triangle,
)


class Maps(NamedTuple):
    """The map of each cell around each vertex, in the order of `Blocks.cells`.

    Attributes
    ----------
    l11, l12, l22 : (n_rows,)
        A symmetric, positive definite matrix L with determinant one; edges e become L e.
    """

    l11: FloatArray
    l12: FloatArray
    l22: FloatArray


@helper()
def map_places(
    star: FloatArray,
    s: FloatArray,
    k: int,
    places: int,
    n: int,
    maps: RowArrays,
    row: int,
    mapped: FloatArray,
) -> None:
    """Map the places of a cell's other vertices, as seen from the vertex that moves."""
    l11, l12, l22 = maps
    for j in range(places):
        x = k + j * ROW2
        y = x + ROW
        for i in range(n):
            dx, dy = star[x + i] - s[X + i], star[y + i] - s[Y + i]
            mapped[x + i] = l11[row + i] * dx + l12[row + i] * dy
            mapped[y + i] = l12[row + i] * dx + l22[row + i] * dy


@helper()
def take_back(own: FloatArray, n: int, maps: RowArrays, row: int, s: FloatArray) -> None:
    """Add a mapped cell's energy and derivatives, in `own`, to those of the star."""
    l11, l12, l22 = maps
    for i in range(n):
        a, b, c = l11[row + i], l12[row + i], l22[row + i]
        gx, gy = own[GX + i], own[GY + i]
        xx, xy, yy = own[HXX + i], own[HXY + i], own[HYY + i]
        s[ENERGY + i] += own[ENERGY + i]
        s[GX + i] += a * gx + b * gy
        s[GY + i] += b * gx + c * gy
        s[HXX + i] += a * a * xx + 2.0 * a * b * xy + b * b * yy
        s[HXY + i] += a * b * xx + (a * c + b * b) * xy + b * c * yy
        s[HYY + i] += b * b * xx + 2.0 * b * c * xy + c * c * yy


@helper()
def map_trial(s: FloatArray, lanes: LaneRange, maps: RowArrays, row: int, own: FloatArray) -> None:
    """Map the trial places of the vertices."""
    l11, l12, l22 = maps
    for i in range(lanes[0], lanes[1]):
        dx, dy = s[PX + i] - s[X + i], s[PY + i] - s[Y + i]
        own[PX + i] = l11[row + i] * dx + l12[row + i] * dy
        own[PY + i] = l12[row + i] * dx + l22[row + i] * dy
        own[TRIAL + i] = 0.0


class Asked(NamedTuple):
    """What is asked of the cells of each star, as arrays of rows that loops over lanes read.

    Attributes
    ----------
    shapes, sizes
        As in `blocks.Rows`.
    shape_walls, corner_walls
        `slim` and `near` of `blocks.Rows`; in the latter no shape counts.
    maps
        As in `Maps`.
    """

    shapes: RowArrays
    sizes: RowArrays
    shape_walls: WallArrays
    corner_walls: WallArrays
    maps: RowArrays


@helper()
def add_stars(
    star_xy: FloatArray,
    s: FloatArray,
    block: Block,
    what: Asked,
    terms: Terms,
    mapped: FloatArray,
    own: FloatArray,
) -> None:
    """Add up the energy of each star of a block, and its derivatives.

    Parameters
    ----------
    mapped, own
        Scratch like `star_xy` and `s`.
    """
    shapes, sizes, shape_walls, corner_walls, maps = what
    n, quads, triangles, row = block.size, block.n_quads, block.n_triangles, block.rows
    weight = terms.mean_weight
    # In the plane as it is no shape counts, in the mapped one no badness of corners does.
    shape_terms = Terms(weight, 0.0, 1, 2.0)
    zero = own[X : X + ROW]
    none, at_none = (zero, zero, zero), row - row
    for k in range(quads + triangles):
        at, k_row = min(k, quads) * ROW2 + k * ROW4, row + k * n
        for i in range(ROW6):
            own[i] = 0.0
        if k < quads:
            map_places(star_xy, s, at, 3, n, maps, k_row, mapped)
            add_walled_quad(mapped, own, at, n, shapes, k_row, shape_walls, k_row, shape_terms)
            add_walled_quad(star_xy, s, at, n, none, at_none, corner_walls, k_row, terms)
            for j in range(N_SEEN):
                a, c = at + SEEN[j][0], at + SEEN[j][1]
                add_size(star_xy, s, a, c, n, sizes, k_row, weight)
        else:
            map_places(star_xy, s, at, 2, n, maps, k_row, mapped)
            add_walled_triangle(mapped, own, at, n, shapes, k_row, shape_walls, k_row, shape_terms)
            add_walled_triangle(star_xy, s, at, n, none, at_none, corner_walls, k_row, terms)
            add_size(star_xy, s, at, at + ROW2, n, sizes, k_row, weight)
        take_back(own, n, maps, k_row, s)


@helper()
def try_stars(
    star_xy: FloatArray,
    s: FloatArray,
    block: Block,
    what: Asked,
    terms: Terms,
    more: bool,
    mapped: FloatArray,
    own: FloatArray,
) -> None:
    """Add up the energy of each star at the trial places, and keep the least margins.

    Parameters
    ----------
    more
        Whether edges and shapes are held.
    mapped, own
        As `add_stars` leaves them.
    """
    shapes, sizes, shape_walls, corner_walls, maps = what
    n, quads, triangles, row = block.size, block.n_quads, block.n_triangles, block.rows
    weight = terms.mean_weight
    shape_terms = Terms(weight, 0.0, 1, 2.0)
    zero = own[X : X + ROW]
    none, at_none = (zero, zero, zero), row - row
    everyone = (n - n, n)  # of one type
    for k in range(quads + triangles):
        at, k_row = min(k, quads) * ROW2 + k * ROW4, row + k * n
        map_trial(s, everyone, maps, k_row, own)
        if k < quads:
            try_walled_quad(
                mapped, own, at, everyone, shapes, k_row, shape_walls, k_row, shape_terms
            )
            try_walled_quad(star_xy, s, at, everyone, none, at_none, corner_walls, k_row, terms)
            for j in range(N_SEEN):
                a, c = at + SEEN[j][0], at + SEEN[j][1]
                try_size(star_xy, s, a, c, everyone, sizes, k_row, weight)
            if more:
                hold_quad(star_xy, s, at, everyone)
        else:
            try_walled_triangle(
                mapped, own, at, everyone, shapes, k_row, shape_walls, k_row, shape_terms
            )
            try_walled_triangle(star_xy, s, at, everyone, none, at_none, corner_walls, k_row, terms)
            try_size(star_xy, s, at, at + ROW2, everyone, sizes, k_row, weight)
            if more:
                hold_triangle(star_xy, s, at, everyone)
        for i in range(n):
            s[TRIAL + i] += own[TRIAL + i]


@helper()
def _move_block(
    xy: FloatArray,
    vertices: TableArray,
    stars: TableArray,
    block: Block,
    relaxation: float,
    terms: Terms,
    held: FloatArray,
    shapes: RowArrays,
    sizes: RowArrays,
    shape_walls: WallArrays,
    corner_walls: WallArrays,
    maps: RowArrays,
    star_xy: FloatArray,
    mapped: FloatArray,
    s: FloatArray,
    own: FloatArray,
    rails: Rails,
    lengths: FloatArray,
) -> None:
    what = Asked(shapes, sizes, shape_walls, corner_walls, maps)
    gather_block(xy, vertices, stars, block, star_xy, s, lengths)
    gather_held(vertices, block.first, block.size, held, s)
    add_stars(star_xy, s, block, what, terms, mapped, own)
    left = newton_step(s, block.size)
    on_rails = confined(rails)
    if on_rails:
        left = steps_on_rails(s, vertices, block.first, block.size, rails)
    everyone = (block.size - block.size, block.size)  # of one type
    fraction = relaxation
    for attempt in range(len(FRACTIONS) + 1):
        if left == 0.0:
            break
        start_trial(s, everyone, fraction)
        if on_rails:
            confine_lanes(s, PX, PY, everyone, vertices, block.first, rails)
        try_stars(star_xy, s, block, what, terms, held.shape[1] > 3, mapped, own)
        left = store_better(xy, vertices, block, everyone, s, lengths)
        fraction = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]


@parallel_kernel()
def mapped_sweep(
    xy: FloatArray,
    blocks: Blocks,
    colours: tuple[int, int],
    relaxation: float,
    wall: Wall,
    held: FloatArray,
    rows: Rows,
    maps: Maps,
    lengths: FloatArray,
) -> None:
    """Move each vertex once, downhill on its star's energy, in place.

    Parameters
    ----------
    maps
        The map of each cell of each star.
    xy, blocks, colours, relaxation, wall, held, rows, lengths
        As in `newton_sweep.newton_sweep`.
    """
    terms = Terms(wall.mean_weight, 1.0 / wall.threshold, wall.squarings, 2.0**wall.squarings)
    colour_blocks, table, vertices, stars, _, largest, own = blocks
    rails = Rails(*own)
    shapes, shape_walls = (rows.m11, rows.m12, rows.m22), (rows.slim, rows.near)
    sizes, own_maps = (rows.area, rows.inv_area, rows.size_weight), (maps.l11, maps.l12, maps.l22)
    corner_walls = np.zeros(rows.slim.size), rows.near
    for colour in range(colours[0], colours[1]):
        for b in prange(colour_blocks[colour], colour_blocks[colour + 1]):
            star_xy, mapped = np.empty(6 * largest * LANES), np.empty(6 * largest * LANES)
            _move_block(
                xy,
                vertices,
                stars,
                block_at(table, b),
                relaxation,
                terms,
                held,
                shapes,
                sizes,
                shape_walls,
                corner_walls,
                own_maps,
                star_xy,
                mapped,
                np.empty(N_ROWS * LANES),
                np.zeros(N_ROWS * LANES),
                rails,
                lengths,
            )
