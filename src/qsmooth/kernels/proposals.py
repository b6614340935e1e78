"""The paper's moves of a quad's corner, and the proposals of all cells of a star.

"Quadrilateral Mesh Smoothing": where a corner's angle is too large or too small, push or pull it
along the normal of its diagonal, shrink or stretch the diagonal, and even out its distances to the
diagonal's ends. In a triangle the opposite edge plays the diagonal.
"""

import math

import numpy as np

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper
from qsmooth.kernels.guards import clearance, guard_lines, keeps_clearance, tolerated_loss
from qsmooth.kernels.stars import NO_VERTEX, Centre, Step

# Rows of the thresholds: by kind of cell. Columns: too large, too small; see `thresholds`.
QUAD, TRIANGLE = 0, 1
COS_MAX, COS_MIN, HEIGHT_MAX, HEIGHT_MIN = range(4)


def thresholds(
    max_angle: float, min_angle: float, triangle_max_angle: float, triangle_min_angle: float
) -> FloatArray:
    """Tabulate what the moves need of the angle thresholds (degrees), (2, 4).

    Columns: the cosines of the two thresholds, and the height over the diagonal, per length of
    it, at which an isosceles corner has exactly that angle.
    """
    angles = np.radians([[max_angle, min_angle], [triangle_max_angle, triangle_min_angle]])
    with np.errstate(divide="ignore", over="ignore"):  # at an angle of hardly more than 0
        return np.hstack([np.cos(angles), 0.5 / np.tan(0.5 * angles)])


@helper()
def _push(
    ux: float, uy: float, wx: float, wy: float, angles: FloatArray, kind: int, step: float
) -> tuple[float, float, float, float, float]:
    """Look at the corner at the origin between its next vertex u and its previous vertex w.

    Returns
    -------
    tx, ty
        Unit vector from u to w.
    push
        How far to move the corner to the left of u→w (negative: to the right); 0 for no proposal.
    slide
        How far to move it along u→w to even it out.
    shrink
        How far to move each end of the diagonal towards the other (negative: away).
    """
    ex, ey = wx - ux, wy - uy
    length = math.sqrt(ex * ex + ey * ey)
    if length == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    tx, ty = ex / length, ey / length
    jacobian = ux * wy - uy * wx
    dot = ux * wx + uy * wy
    height = jacobian / length
    edges = math.sqrt((ux * ux + uy * uy) * (wx * wx + wy * wy))
    slide = step * 0.5 * ((ux + wx) * tx + (uy + wy) * ty)
    push, shrink = 0.0, 0.0
    if edges > 0.0:
        if jacobian < 0.0 or dot < angles[kind, COS_MAX] * edges:  # too large an angle
            wanted = angles[kind, HEIGHT_MAX] * length
            if height < wanted:
                push = step * (wanted - height)
            wanted = abs(height) / angles[kind, HEIGHT_MAX]
            if length > wanted:
                shrink = 0.5 * step * (length - wanted)
        elif dot > angles[kind, COS_MIN] * edges:  # too small an angle
            wanted = angles[kind, HEIGHT_MIN] * length
            if height > wanted:
                push = step * (wanted - height)
            wanted = abs(height) / angles[kind, HEIGHT_MIN]
            if length < wanted:
                shrink = max(0.5 * step * (length - wanted), -0.5 * step * length)
    return tx, ty, push, slide, shrink


@helper()
def _add_if_kept(
    lines: FloatArray,
    n_lines: int,
    least: float,
    smallest: float,
    dx: float,
    dy: float,
    total_x: float,
    total_y: float,
    count: int,
) -> tuple[float, float, int]:
    """Add a proposal to the accepted ones unless it is no move at all or loses clearance."""
    if dx * dx + dy * dy >= smallest * smallest and keeps_clearance(lines, n_lines, dx, dy, least):
        return total_x + dx, total_y + dy, count + 1
    return total_x, total_y, count


@helper()
def mean_proposal(
    xy: FloatArray,
    corners: TableArray,
    cells: TableArray,
    centre: Centre,
    pace: FloatArray,
    angles: FloatArray,
    step: float,
    by_quad: bool,
    lines: FloatArray,
) -> Step:
    """Average the accepted proposals that the cells around a vertex v make for it.

    Each cell pushes or pulls v and evens it out; `by_quad` adds what its two neighbours' corners
    propose to v as an end of their diagonals.

    Parameters
    ----------
    corners, cells
        As in `stars.Stars`.
    pace : (n_cells,)
        Multiple of `step` at which each cell proposes; 0 for a cell that proposes nothing.
    angles : (2, 4)
        As `thresholds` tabulates them.
    step
        Fraction of each move that is proposed, in (0, 1].
    lines : (3 * cells in the star, 3)
        Scratch: overwritten with the guard lines of v.

    Returns
    -------
    step
        Zero where nothing was accepted.
    """
    n_lines, longest, shortest, largest = guard_lines(xy, corners, centre, lines)
    loss = tolerated_loss(longest, largest)
    least = clearance(lines, n_lines) - loss
    x, y = xy[centre.v, 0], xy[centre.v, 1]
    sx, sy, count = 0.0, 0.0, 0
    for row in range(centre.first, centre.last):
        stride = step * pace[cells[row]]
        if stride == 0.0:
            continue
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        ax, ay = xy[a, 0] - x, xy[a, 1] - y
        cx, cy = xy[c, 0] - x, xy[c, 1] - y
        kind = TRIANGLE if b == NO_VERTEX else QUAD
        tx, ty, push, slide, _ = _push(ax, ay, cx, cy, angles, kind, stride)
        sx, sy, count = _add_if_kept(
            lines, n_lines, least, loss, -ty * push, tx * push, sx, sy, count
        )
        if by_quad and kind == QUAD:
            bx, by = xy[b, 0] - x, xy[b, 1] - y
            # v is the previous vertex of corner a, whose diagonal runs from b to v,
            tx2, ty2, _, _, shrink = _push(bx - ax, by - ay, -ax, -ay, angles, kind, stride)
            sx, sy, count = _add_if_kept(
                lines, n_lines, least, loss, -tx2 * shrink, -ty2 * shrink, sx, sy, count
            )
            # and the next vertex of corner c, whose diagonal runs from v to b.
            tx2, ty2, _, _, shrink = _push(-cx, -cy, bx - cx, by - cy, angles, kind, stride)
            sx, sy, count = _add_if_kept(
                lines, n_lines, least, loss, tx2 * shrink, ty2 * shrink, sx, sy, count
            )
        sx, sy, count = _add_if_kept(
            lines, n_lines, least, loss, tx * slide, ty * slide, sx, sy, count
        )
    if count == 0:
        return Step(0.0, 0.0, shortest)
    return Step(sx / count, sy / count, shortest)
