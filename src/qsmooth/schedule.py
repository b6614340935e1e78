"""The order of a sweep: colours of the movable vertices, and the table of their stars.

Colours depend on the caller's ids and on connectivity, not on where vertices lie in memory, nor on
who has which part of the mesh. Vertices have priorities, a hash of their ids, and each takes the
smallest colour that those of higher priority leave (M. T. Jones and P. E. Plassmann, "A parallel
graph coloring heuristic", SIAM J. Sci. Comput. 14 (1993)): eight colours on quads. Iterated greedy
(J. C. Culberson and F. Luo, in "Cliques, Coloring, and Satisfiability", DIMACS 26 (1996)) brings
these down to six: whole colours choose anew, in another order. As no two vertices of a colour share
a cell, theirs does not matter.
"""

from __future__ import annotations

import numpy as np

from qsmooth._types import BoolArray, ColourArray, IndexArray
from qsmooth.checks import read_only
from qsmooth.errors import MeshError
from qsmooth.kernels.stars import Stars

# Rounds of iterated greedy over everything: they leave .3 % of the vertices of quads in the seventh
# colour. Then rounds over the last colours and what is around them, if their share is this at most.
WHOLE_ROUNDS, LAST_ROUNDS, LAST_SHARE = 2, 100, 1 / 32
# A colour that is nearly empty costs a sweep some microseconds. Of more vertices than these a round
# takes as long as a sweep, and a sweep ten milliseconds.
REDUCED_UP_TO = 2**18


def make_schedule(
    movable: BoolArray,
    ids: IndexArray,
    cells: tuple[IndexArray, IndexArray],
    stars: tuple[IndexArray, IndexArray],
    star_corners: IndexArray,
) -> Stars:
    """Order the movable vertices by colour, and gather their stars.

    Parameters
    ----------
    movable, ids : (n_vertices,)
        Which vertices may move, and the caller's number of each.
    cells, stars, star_corners
        As `Topology` has them.
    """
    from qsmooth.kernels import colouring

    colour, n_colours = colours(movable, ids, cells, stars)
    colour_offsets, vertices = colouring.order_by_colour(colour, n_colours)
    offsets, corners, of_rows = colouring.star_table(
        colour, colour_offsets, *cells, *stars, star_corners
    )
    return Stars(
        colour_offsets=read_only(colour_offsets),
        vertices=read_only(vertices),
        offsets=read_only(offsets),
        corners=read_only(corners),
        cells=read_only(of_rows),
        largest=int(np.diff(offsets).max(initial=0)),
    )


def colours(
    movable: BoolArray,
    ids: IndexArray,
    cells: tuple[IndexArray, IndexArray],
    stars: tuple[IndexArray, IndexArray],
) -> tuple[ColourArray, int]:
    """Colour the movable vertices such that two that share a cell differ.

    Parameters are those of `make_schedule`.

    Returns
    -------
    colour : (n_vertices,)
        -1 where a vertex does not move.
    n_colours
    """
    from qsmooth.kernels import colouring

    colour, taken = colouring.first_fit(movable, ids, *cells, *stars)
    n_colours = int(colour.max(initial=-1)) + 1
    everyone = np.flatnonzero(movable).astype(np.uint32)
    if everyone.size <= REDUCED_UP_TO:
        for turn in range(min(WHOLE_ROUNDS, n_colours)):
            colouring.choose_anew(colour, taken, everyone.copy(), n_colours, turn, *stars)
        _reduce(colour, taken, cells, stars)
        n_colours = int(colour.max(initial=-1)) + 1
    if n_colours > colouring.MOST_COLOURS:
        raise MeshError(f"the vertices need more than {colouring.MOST_COLOURS} colours")
    return colour, n_colours


def _reduce(
    colour: ColourArray,
    taken: IndexArray,
    cells: tuple[IndexArray, IndexArray],
    stars: tuple[IndexArray, IndexArray],
) -> None:
    """Do without the last colours, if these are small, in place."""
    from qsmooth.kernels import colouring

    counts = np.bincount(colour[colour >= 0])
    from_here = np.cumsum(counts[::-1])[::-1]  # vertices with this colour or a later one
    n_colours = int((from_here > LAST_SHARE * from_here[:1]).sum())
    listed = np.flatnonzero(colour >= n_colours).astype(np.uint32)
    is_listed, near = np.zeros(colour.size, np.bool_), np.empty(colour.size, np.uint32)
    for turn in range(LAST_ROUNDS):
        if not listed.size:
            break
        n = colouring.with_neighbours(listed, colour, *cells, *stars, is_listed, near)
        left = colouring.choose_anew(colour, taken, near[:n], n_colours, turn, *stars)
        listed = near[:left].copy()
