"""Cells that no method can make valid, found by what cannot move and by connectivity."""

import math

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel
from qsmooth.kernels.confining import confine, confined
from qsmooth.kernels.geometry import orientation
from qsmooth.kernels.rails import Rails

# How far from the line between its neighbours a doublet is put, over their distance: the first at
# which one of its cells is certainly convex is the best. 1e-9 is 2e-7 degrees beyond 180.
HAIRS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)


@kernel()
def hopeless_cells(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, movable: BoolArray,
    out: BoolArray,
) -> None:  # fmt: skip
    """Mark cells in which what cannot move keeps a corner from being convex.

    The three vertices of a corner that is not convex can't move, or two vertices of a corner are
    at one place and can't move.

    Parameters
    ----------
    out : (n_cells,)
        Overwritten.
    """
    for c in range(out.size):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        out[c] = False
        d = cell_vertices[last - 1]
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            if not (movable[a] or movable[b] or movable[d]):
                turn = orientation(xy[d, 0], xy[d, 1], xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])
                out[c] = out[c] or turn <= 0
            else:
                out[c] = out[c] or (not (movable[a] or movable[b]) and _same(xy, a, b))
                out[c] = out[c] or (not (movable[b] or movable[d]) and _same(xy, b, d))
            d = a


@helper()
def _same(xy: FloatArray, v: int, w: int) -> bool:
    return bool(xy[v, 0] == xy[w, 0] and xy[v, 1] == xy[w, 1])


@kernel()
def mark_one_of_two(
    xy: FloatArray, doublets: IndexArray, star_offsets: IndexArray,
    star_cells: IndexArray, star_corners: IndexArray,
    cell_offsets: IndexArray, cell_vertices: IndexArray, taken: BoolArray, out: BoolArray,
) -> None:  # fmt: skip
    """Mark one cell of each doublet, a vertex whose two cells share both its edges.

    The angles of the two at the vertex add up to 360 degrees: one of them is not convex there.
    Where cells of several doublets are the same a cell counts for one of these only.

    Parameters
    ----------
    doublets : (n_doublets,)
        Vertices.
    taken : (n_cells,)
        Cells that do not count; those of the doublets are added.
    out : (n_cells,)
        The cells that are not convex at their doublet are marked, no other is changed.
    """
    for v in doublets:
        k = star_offsets[v]
        one, other, at = star_cells[k], star_cells[k + 1], star_corners[k]
        if taken[one] or taken[other]:
            continue
        taken[one] = taken[other] = True
        first, n = cell_offsets[one], cell_offsets[one + 1] - cell_offsets[one]
        b = cell_vertices[first + (at - first + 1) % n]
        d = cell_vertices[first + (at - first + n - 1) % n]
        turn = orientation(xy[d, 0], xy[d, 1], xy[v, 0], xy[v, 1], xy[b, 0], xy[b, 1])
        out[one if turn <= 0 else other] = True


@kernel()
def place_doublets(
    xy: FloatArray, doublets: IndexArray, star_offsets: IndexArray,
    star_cells: IndexArray, star_corners: IndexArray,
    cell_offsets: IndexArray, cell_vertices: IndexArray, rails: Rails, lengths: FloatArray,
) -> None:  # fmt: skip
    """Put each doublet half way between its two neighbours, and a hair to one side.

    There one of its two cells is convex at it, and the other has little more than 180 degrees,
    which is the least it can have. It stays where it is if it is not better there.

    Parameters
    ----------
    doublets, lengths : (n_doublets,)
        Vertices; and how far each moved, overwritten.
    rails
        Where they may be.
    """
    for i in range(doublets.size):
        v = doublets[i]
        lengths[i] = 0.0
        k = star_offsets[v]
        cells, at = (star_cells[k], star_cells[k + 1]), star_corners[k]
        first, n = cell_offsets[cells[0]], cell_offsets[cells[0] + 1] - cell_offsets[cells[0]]
        b = cell_vertices[first + (at - first + 1) % n]
        d = cell_vertices[first + (at - first + n - 1) % n]
        x, y = xy[v, 0], xy[v, 1]
        ex, ey = xy[d, 0] - xy[b, 0], xy[d, 1] - xy[b, 1]
        best_bad, best_angle = _rate(xy, cells, cell_offsets, cell_vertices)
        best_x, best_y = x, y
        # To the right of b to d is out of the first cell, which is then convex at v.
        for side in (1.0, -1.0):
            for hair in HAIRS:
                xy[v, 0] = 0.5 * (xy[b, 0] + xy[d, 0]) + side * hair * ey
                xy[v, 1] = 0.5 * (xy[b, 1] + xy[d, 1]) - side * hair * ex
                if confined(rails):
                    xy[v, 0], xy[v, 1] = confine(v, xy[v, 0], xy[v, 1], rails)
                bad, angle = _rate(xy, cells, cell_offsets, cell_vertices)
                if bad < best_bad or (bad == best_bad and angle < best_angle):
                    best_bad, best_angle = bad, angle
                    best_x, best_y = xy[v, 0], xy[v, 1]
        xy[v, 0], xy[v, 1] = best_x, best_y
        lengths[i] = math.sqrt((best_x - x) ** 2 + (best_y - y) ** 2)


@helper()
def _rate(
    xy: FloatArray, cells: tuple[int, int], cell_offsets: IndexArray, cell_vertices: IndexArray
) -> tuple[int, float]:
    """Count those of two cells that are not valid, and find their largest angle, in radians."""
    bad, largest = 0, 0.0
    for c in cells:
        first, last = cell_offsets[c], cell_offsets[c + 1]
        d, is_bad = cell_vertices[last - 1], False
        for k in range(first, last):
            a = cell_vertices[k]
            b = cell_vertices[k + 1] if k + 1 < last else cell_vertices[first]
            turn = orientation(xy[d, 0], xy[d, 1], xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])
            is_bad = is_bad or turn <= 0
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
            angle = math.atan2(ux * wy - uy * wx, ux * wx + uy * wy)
            largest = max(largest, angle if angle >= 0.0 else angle + 2.0 * math.pi)
            d = a
        bad += 1 if is_bad else 0
    return bad, largest
