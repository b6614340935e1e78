"""Bounds on angles: how the angle at a vertex is shared out among the cells around it."""

import math
from typing import NamedTuple

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel

FULL_TURN, HALF_TURN = 360.0, 180.0


class Swings(NamedTuple):
    """How far the edges between sliding vertices can turn; empty where none slides.

    All in degrees; -1 where no more is known than that the vertex moves, or where it stays.

    Attributes
    ----------
    turn : (n_vertices,)
        Of a vertex that slides along the boundary: by how much the angle between its two edges
        there can differ from 180°.
    after, before : (n_vertices,)
        Of such a vertex: by how much the edge from the vertex before it on the boundary, the cells
        to the left, or that to the vertex after it, can turn from where it is, if that vertex
        stays.
    """

    turn: FloatArray
    after: FloatArray
    before: FloatArray


NO_SWINGS = Swings(np.empty(0), np.empty(0), np.empty(0))


@helper()
def _direction(xy: FloatArray, v: int, w: int) -> float:
    return math.degrees(math.atan2(xy[w, 1] - xy[v, 1], xy[w, 0] - xy[v, 0]))


@helper()
def _turn(start: float, stop: float) -> float:
    """Angle from one direction counter-clockwise to another, in (0, 360]."""
    turn = stop - start
    if turn <= 0.0:
        turn += FULL_TURN
    return turn


@helper()
def _same_place(xy: FloatArray, v: int, w: int) -> bool:
    return bool(xy[v, 0] == xy[w, 0] and xy[v, 1] == xy[w, 1])


@kernel()
def angle_bounds(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    corner_cells: IndexArray,
    twins: IndexArray,
    star_offsets: IndexArray,
    star_corners: IndexArray,
    movable: BoolArray,
    swings: Swings,
    smallest: FloatArray,
    largest: FloatArray,
) -> None:
    """Bound the smallest and the largest angle at each vertex.

    Between two fixed edges that follow each other round a fixed vertex lie d cells and an angle θ
    that nothing can change. So one of the d angles is at most θ / d, and one at least. Round a
    vertex without a fixed edge θ is 360°. Where the edges are of a boundary along which vertices
    slide, θ is known up to how far they can turn.

    Parameters
    ----------
    corner_cells, twins : (n_corners,)
        Cell of each corner position, and the corner position of each side in the neighbour.
    star_offsets, star_corners : (n_vertices + 1,), (n_corners,)
        CSR map from a vertex to its corner positions.
    movable : (n_vertices,)
        Vertices that may move.
    swings
        What is known of those that slide.
    smallest, largest : (n_vertices,)
        Overwritten. Degrees: the least θ / d and the largest one; 360 and 0 where there is no cell.
    """
    for v in range(smallest.size):
        smallest[v], largest[v] = FULL_TURN, 0.0
        for start in range(star_offsets[v], star_offsets[v + 1]):
            # A run of cells begins at a fixed edge: on the boundary, or between fixed vertices.
            k = star_corners[start]
            c = corner_cells[k]
            first, last = cell_offsets[c], cell_offsets[c + 1]
            w = cell_vertices[k + 1 if k + 1 < last else first]
            known = swings.turn.size > 0 and twins[k] < 0
            if movable[v] and not (known and swings.turn[v] >= 0.0):
                continue
            swing = 0.0
            if movable[w] and not movable[v]:
                swing = swings.after[w] if known else -1.0
                if swing < 0.0:
                    continue
            begin, count = w, 0
            while True:
                c = corner_cells[k]
                first, last = cell_offsets[c], cell_offsets[c + 1]
                count += 1
                side = k - 1 if k > first else last - 1
                w = cell_vertices[side]
                k = twins[side]
                if k < 0 or not (movable[w] or movable[v]):
                    break
            if movable[v]:
                smallest[v] = min(smallest[v], (HALF_TURN + swings.turn[v]) / count)
                largest[v] = max(largest[v], (HALF_TURN - swings.turn[v]) / count)
                continue
            if movable[w]:  # an open end that may move anywhere bounds nothing
                if k >= 0 or swings.turn.size == 0 or swings.before[w] < 0.0:
                    continue
                swing += swings.before[w]
            if _same_place(xy, v, begin) or _same_place(xy, v, w):  # no direction
                continue
            if w == begin and count == star_offsets[v + 1] - star_offsets[v] and k >= 0:
                angle = FULL_TURN
            else:
                angle = _turn(_direction(xy, v, begin), _direction(xy, v, w))
            smallest[v] = min(smallest[v], (angle + swing) / count)
            largest[v] = max(largest[v], (angle - swing) / count)
        n_cells = star_offsets[v + 1] - star_offsets[v]
        if largest[v] == 0.0 and n_cells > 0:
            # No fixed edge: a full turn, if the cells close round the vertex.
            k, count = star_corners[star_offsets[v]], 0
            begin = k
            while True:
                c = corner_cells[k]
                side = k - 1 if k > cell_offsets[c] else cell_offsets[c + 1] - 1
                count += 1
                k = twins[side]
                if k < 0 or k == begin:
                    break
            if k == begin and count == n_cells:
                smallest[v] = largest[v] = FULL_TURN / count
