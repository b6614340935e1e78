"""How far the edges between vertices that slide along lines can turn."""

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel
from qsmooth.kernels.angle_bounds import HALF_TURN, Swings

# Degrees: more than the rounding of angles; and a line that turns less is as good as straight.
ANGLE_ROUNDING, NEARLY_STRAIGHT = 1e-9, 1e-6
# Of a line of more nodes it is not worked out how far its ends can turn.
MOST_NODES = 4000


@helper()
def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@helper()
def spread(nodes: FloatArray, first: int, last: int) -> float:
    """Angle between the directions of the segments that differ most, of a line of nodes; degrees.

    Edges between places on the line lie between these directions, if it is less than 180°.
    """
    way = low = high = 0.0
    ux = uy = 0.0
    for k in range(first, last):
        wx, wy = nodes[k + 1, 0] - nodes[k, 0], nodes[k + 1, 1] - nodes[k, 1]
        if wx == 0.0 and wy == 0.0:
            continue
        if ux != 0.0 or uy != 0.0:
            way += math.atan2(ux * wy - uy * wx, ux * wx + uy * wy)
            low, high = min(low, way), max(high, way)
        ux, uy = wx, wy
    return math.degrees(high - low) + ANGLE_ROUNDING


@helper()
def swing(
    nodes: FloatArray,
    start: int,
    stop: int,
    x: float,
    y: float,
    tolerance: float,
    far: FloatArray,
    turned: FloatArray,
) -> float:
    """By how much the edge from the start of a line to a place on it can turn, degrees.

    Nodes that it leaves out are no farther from it than `tolerance` says, so that it can't point
    far beside any of them.

    Parameters
    ----------
    start, stop
        First and last node, in either order; the line turns.
    x, y
        Where the end of the edge is.
    tolerance
        As a share of the edge.
    far, turned : (MOST_NODES,)
        Scratch.

    Returns
    -------
    float
        -1 where nothing is known.
    """
    sx, sy, step = nodes[start, 0], nodes[start, 1], 1 if stop > start else -1
    m = abs(stop - start)
    if m >= MOST_NODES:
        return -1.0
    base = math.atan2(nodes[start + step, 1] - sy, nodes[start + step, 0] - sx)
    for k in range(m):
        dx, dy = nodes[start + step * (k + 1), 0] - sx, nodes[start + step * (k + 1), 1] - sy
        far[k] = math.hypot(dx, dy)
        turned[k] = _wrapped(math.atan2(dy, dx) - base)
        if far[k] == 0.0 and k + 1 < m:
            return -1.0
    low = high = 0.0
    for k in range(1, m):
        reach = tolerance * max(far[k - 1], far[k])
        if reach >= far[0]:
            return -1.0
        least, most = -np.inf, np.inf
        for j in range(k):
            share = reach / far[j]
            # A node as near as that to the start bounds nothing; and an arc is longer than its
            # sine, so that most nodes need no arc.
            if share < 1.0 and (turned[j] - share > least or turned[j] + share < most):
                half = math.asin(share)
                least, most = max(least, turned[j] - half), min(most, turned[j] + half)
        if far[k] > 0.0:
            to = turned[k - 1] + _wrapped(turned[k] - turned[k - 1])
            least, most = max(least, min(turned[k - 1], to)), min(most, max(turned[k - 1], to))
        if least <= most:
            low, high = min(low, least), max(high, most)
    at = _wrapped(math.atan2(y - sy, x - sx) - base)
    return math.degrees(max(abs(low - at), abs(high - at))) + ANGLE_ROUNDING


@kernel()
def line_swings(
    xy: FloatArray,
    nodes: FloatArray,
    vertices: IndexArray,
    segments: IndexArray,
    offsets: IndexArray,
    wanted: BoolArray,
    tolerance: float,
    swings: Swings,
) -> None:
    """Find how far the edges of vertices that slide along lines can turn.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates.
    nodes, vertices, segments
        As in `outline.Outline`.
    offsets : (n_chains + 1,)
        First entry of each chain.
    wanted : (n_chains,)
        The chains whose vertices are asked for.
    tolerance
        How far an edge may be from its line, as a share of the edge.
    swings
        Overwritten where something is known of these.
    """
    turn, after, before = swings.turn, swings.after, swings.before
    far, turned = np.empty(MOST_NODES), np.empty(MOST_NODES)
    for chain in range(wanted.size):
        if not wanted[chain]:
            continue
        first, last = offsets[chain], offsets[chain + 1] - 1
        start, stop = segments[first], segments[last] + 1
        whole = spread(nodes, start, stop)
        for e in range(first + 1, last):
            turn[vertices[e]] = whole if whole < HALF_TURN else -1.0
        ahead = back = whole
        v, w = vertices[first + 1], vertices[last - 1]
        if whole >= NEARLY_STRAIGHT:
            ahead = swing(nodes, start, stop, xy[v, 0], xy[v, 1], tolerance, far, turned)
            back = swing(nodes, stop, start, xy[w, 0], xy[w, 1], tolerance, far, turned)
        after[v], before[w] = ahead, back
