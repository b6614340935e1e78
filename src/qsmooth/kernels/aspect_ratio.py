"""Smoothing triangles by their edge ratios: along circumcircles, in place, colour by colour."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, TableArray
from qsmooth.kernels._jit import helper, inlined_helper, parallel_kernel
from qsmooth.kernels.guards import (
    HALVINGS,
    NO_FENCE,
    allowed_step,
    centre_of,
    clearance,
    guard_lines,
    keeps_clearance,
    store_move,
    tolerated_loss,
)
from qsmooth.kernels.stars import CHUNK, NO_VERTEX, Centre, Moves, Stars, Step


@helper()
def along_circumcircle(
    ux: float, uy: float, wx: float, wy: float, max_edge_ratio: float, step: float
) -> tuple[float, float, float]:
    """Move the corner at the origin of a triangle (0, u, w) towards its longer edge.

    It stays on the circumcircle: the angle at the corner is kept, and those at u and w, which grow
    and shrink in proportion to the arc, draw nearer to each other.

    Returns
    -------
    dx, dy
        Displacement, by `step` of the arc to the point where both edges are equally long. Zero
        where the ratio of the edges is within `max_edge_ratio`, or the triangle not positive.
    ratio
        The longer edge over the shorter; 0 where there is no displacement.
    """
    uu, ww = ux * ux + uy * uy, wx * wx + wy * wy
    jacobian = ux * wy - uy * wx
    longer, shorter = max(uu, ww), min(uu, ww)
    if not jacobian > 0.0 or longer <= max_edge_ratio * max_edge_ratio * shorter:
        return 0.0, 0.0, 0.0
    dot = ux * wx + uy * wy
    at_u, at_w = math.atan2(jacobian, uu - dot), math.atan2(jacobian, ww - dot)
    turn = 0.5 * step * (at_w - at_u)
    # The law of sines gives the new distance from u.
    scale = math.sin(at_w - turn) * math.sqrt(uu * ww) / jacobian
    along, across = scale * math.cos(at_u + turn), scale * math.sin(at_u + turn)
    ex, ey = wx - ux, wy - uy
    dx = ux + along * ex - across * ey
    dy = uy + along * ey + across * ex
    return dx, dy, math.sqrt(longer / shorter)


@helper()
def star_edge_ratio(
    xy: FloatArray, corners: TableArray, centre: Centre, x: float, y: float
) -> float:
    """Largest ratio of two edges of a triangle of the star, squared, with its vertex at (x, y)."""
    largest = 1.0
    for row in range(centre.first, centre.last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        if b != NO_VERTEX:
            continue
        ax, ay, cx, cy = xy[a, 0] - x, xy[a, 1] - y, xy[c, 0] - x, xy[c, 1] - y
        va, vc = ax * ax + ay * ay, cx * cx + cy * cy
        ac = (cx - ax) * (cx - ax) + (cy - ay) * (cy - ay)
        shortest = min(va, vc, ac)
        largest = max(largest, max(va, vc, ac) / shortest if shortest > 0.0 else np.inf)
    return largest


@inlined_helper()
def _step_within_ratio(
    xy: FloatArray,
    corners: TableArray,
    centre: Centre,
    step: Step,
    tolerated: float,
    good: float,
    lines: FloatArray,
) -> tuple[float, float]:
    """Take the step, halved until the star's largest edge ratio does not rise, or stay.

    Returns
    -------
    x, y
        The place to store.
    """
    x, y = xy[centre.v, 0], xy[centre.v, 1]
    dx, dy = step.dx, step.dy
    allowed = max(tolerated * tolerated, star_edge_ratio(xy, corners, centre, x, y))
    for _ in range(HALVINGS + 1):
        new_x, new_y = allowed_step(xy, corners, centre, dx, dy, good, lines, NO_FENCE)
        if star_edge_ratio(xy, corners, centre, new_x, new_y) <= allowed:
            return new_x, new_y
        dx, dy = 0.5 * (new_x - x), 0.5 * (new_y - y)
    return x, y


@inlined_helper()
def mean_along_circumcircles(
    xy: FloatArray,
    corners: TableArray,
    centre: Centre,
    max_edge_ratio: float,
    step: float,
    power: float,
    lines: FloatArray,
) -> Step:
    """Average what the triangles around a vertex propose, as far as no clearance is lost.

    Parameters
    ----------
    max_edge_ratio, step, power
        As in `aspect_ratio_sweep`.
    lines : (3 * cells in the star, 3)
        Scratch: overwritten with the guard lines of the vertex.

    Returns
    -------
    step
        Zero where nothing was accepted.
    """
    x, y = xy[centre.v, 0], xy[centre.v, 1]
    n_lines, longest, shortest, largest = guard_lines(xy, corners, centre, lines)
    loss = tolerated_loss(longest, largest)
    least = clearance(lines, n_lines) - loss
    sx, sy, total = 0.0, 0.0, 0.0
    for row in range(centre.first, centre.last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        if b != NO_VERTEX:
            continue
        dx, dy, ratio = along_circumcircle(
            xy[a, 0] - x, xy[a, 1] - y, xy[c, 0] - x, xy[c, 1] - y, max_edge_ratio, step
        )
        if dx * dx + dy * dy >= loss * loss and keeps_clearance(lines, n_lines, dx, dy, least):
            weight = ratio**power
            sx += weight * dx
            sy += weight * dy
            total += weight
    if not total > 0.0:
        return Step(0.0, 0.0, shortest)
    return Step(sx / total, sy / total, shortest)


@parallel_kernel()
def aspect_ratio_sweep(
    xy: FloatArray,
    stars: Stars,
    colours: tuple[int, int],
    max_edge_ratio: float,
    step: float,
    power: float,
    tolerated: float,
    good: float,
    moves: Moves,
) -> None:
    """Move each vertex once along the circumcircles of the triangles around it.

    Each triangle whose two edges at the vertex differ too much proposes a place; those that lose
    no clearance are averaged. Quads propose nothing, but are guarded.

    Parameters
    ----------
    xy, stars, colours, good, moves
        As in `star.star_sweep`.
    max_edge_ratio
        Edges whose ratio is no larger are left alone; 1 or more.
    step
        Fraction of the arc to the point where both edges are equal, in (0, 1].
    power
        Proposals are weighted by the ratio of their edges to this power; 0 is the plain mean.
    tolerated
        Besides the guards, no step may make the largest edge ratio of the star's triangles larger,
        unless it stays within this; infinite for no such rule.
    """
    colour_offsets, vertices, offsets, corners, _, largest = stars
    lengths, shares = moves.lengths, moves.shares
    for colour in range(colours[0], colours[1]):
        start, stop = colour_offsets[colour], colour_offsets[colour + 1]
        for chunk in prange((stop - start + CHUNK - 1) // CHUNK):
            lines = np.empty((3 * largest, 3))
            for i in range(start + chunk * CHUNK, min(start + (chunk + 1) * CHUNK, stop)):
                v = centre_of(vertices, offsets, i)
                wanted = mean_along_circumcircles(
                    xy, corners, v, max_edge_ratio, step, power, lines
                )
                lengths[i], shares[i] = 0.0, 0.0
                if wanted.dx == 0.0 and wanted.dy == 0.0:
                    continue
                x, y = _step_within_ratio(xy, corners, v, wanted, tolerated, good, lines)
                store_move(xy, v, x, y, wanted.shortest, lengths, shares)
