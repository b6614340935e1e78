"""The outline that vertices slide along: places on it, how far edges are from it, what they cross.

An outline is chains of segments. Each chain runs from one vertex that stays to another, and the
vertices that slide along it keep their order. Where a vertex is on it is a segment and a fraction
of that segment, so that a place keeps all its digits however long the chain is.
"""

import math
from typing import NamedTuple

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel, strict_helper
from qsmooth.kernels.geometry import orientation, two_product, two_sum

# A place is on a segment if it is no farther than this share of the largest coordinate around.
ON_SEGMENT = 2.0**-50
# The largest fraction of a segment that is not its end.
BELOW_ONE = 1.0 - 2.0**-53


class Outline(NamedTuple):
    """Chains of segments, and where vertices are on them; an entry is a vertex of a chain.

    Attributes
    ----------
    nodes : (n_nodes, 2)
        Places that the segments join, chain by chain: segment k goes from node k to node k + 1.
    vertices : (n_entries,)
        The vertices of each chain in order; the first and the last of a chain stay.
    segments, fractions : (n_entries,)
        Where each is: the segment, and the share of it that lies behind, in [0, 1). The last
        entry of a chain is at fraction 1 of its last segment.
    off : (n_entries,)
        Whether a vertex is not on the outline, and that is only the place nearest to it.
    sides : (n_entries,)
        Side of the boundary (`Sides`) from an entry to the next; -1 of lines inside the mesh, and
        of the last entry of a chain.
    entries : (n_sliding,)
        Entry of each vertex that slides, in the order of the blocks of these.
    free : (n_sliding,)
        Which of them may slide now.
    tolerance
        How far an edge may be from the outline, as a share of the edge.
    slack
        How far beside a segment a vertex may be and yet count as on it, as a share of the segment:
        more than rounding where segments only come near to what is meant.
    """

    nodes: FloatArray
    vertices: IndexArray
    segments: IndexArray
    fractions: FloatArray
    off: BoolArray
    sides: IndexArray
    entries: IndexArray
    free: BoolArray
    tolerance: float
    slack: float = 0.0


class Sides(NamedTuple):
    """The sides of the boundary, in a tree of boxes.

    Attributes
    ----------
    ends : (n_sides, 2)
        The two vertices of each.
    boxes : (2 * n_leaves, 4)
        Smallest x and y, largest x and y; of side i in row n_leaves + i. Row k, from 1 on, holds
        rows 2 k and 2 k + 1. There is a power of two of leaves.
    """

    ends: IndexArray
    boxes: FloatArray


# ------------------------------------------------------------------------------- places


@strict_helper()
def _between(a: float, b: float, fraction: float) -> float:
    """Round a + fraction · (b - a), worked out to twice the digits."""
    high, low = two_sum(b, -a)
    product, error = two_product(fraction, high)
    total, rest = two_sum(a, product)
    return total + (rest + (error + fraction * low))


@strict_helper()
def place_at(nodes: FloatArray, segment: int, fraction: float) -> tuple[float, float]:
    """Find the place at a fraction of a segment, each coordinate rounded once."""
    return (
        _between(nodes[segment, 0], nodes[segment + 1, 0], fraction),
        _between(nodes[segment, 1], nodes[segment + 1, 1], fraction),
    )


@helper()
def segment_length(nodes: FloatArray, segment: int) -> float:
    """Length of a segment."""
    dx = nodes[segment + 1, 0] - nodes[segment, 0]
    dy = nodes[segment + 1, 1] - nodes[segment, 1]
    return math.sqrt(dx * dx + dy * dy)


@helper()
def tangent(nodes: FloatArray, segment: int) -> tuple[float, float]:
    """Unit vector along a segment; zero where it has no length."""
    length = segment_length(nodes, segment)
    inv = 1.0 / length if length > 0.0 else 0.0
    dx = nodes[segment + 1, 0] - nodes[segment, 0]
    dy = nodes[segment + 1, 1] - nodes[segment, 1]
    return dx * inv, dy * inv


@helper()
def advance(
    nodes: FloatArray, segment: int, fraction: float, way: float, first: int, last: int
) -> tuple[int, float]:
    """Go so far along the outline, back where `way` is negative, within these segments.

    Returns
    -------
    segment, fraction
        The end of the last segment is at fraction 1.
    """
    k, f = segment, fraction
    while True:
        length = segment_length(nodes, k)
        if way >= 0.0:
            left = (1.0 - f) * length
            if way < left:
                f += way / length
                if f < 1.0:
                    return k, f
                left = 0.0
            if k >= last:
                return last, 1.0
            way, k, f = max(way - left, 0.0), k + 1, 0.0
        else:
            if -way <= f * length and length > 0.0:
                return k, max(f + way / length, 0.0)
            if k <= first:
                return first, 0.0
            way, k, f = min(way + f * length, 0.0), k - 1, 1.0


@helper()
def _nearest_fraction(nodes: FloatArray, segment: int, x: float, y: float) -> tuple[float, float]:
    """Fraction of a segment that is nearest to a place, and the square of the distance."""
    ax, ay = nodes[segment, 0], nodes[segment, 1]
    dx, dy = nodes[segment + 1, 0] - ax, nodes[segment + 1, 1] - ay
    squares = dx * dx + dy * dy
    f = 0.0
    if squares > 0.0:
        f = min(max(((x - ax) * dx + (y - ay) * dy) / squares, 0.0), 1.0)
    ox, oy = x - (ax + f * dx), y - (ay + f * dy)
    return f, ox * ox + oy * oy


@helper()
def _largest(nodes: FloatArray, segment: int) -> float:
    """Largest coordinate of a segment, without its sign."""
    here = max(abs(nodes[segment, 0]), abs(nodes[segment, 1]))
    there = max(abs(nodes[segment + 1, 0]), abs(nodes[segment + 1, 1]))
    return float(max(here, there))


@helper()
def is_before(segment: int, fraction: float, other: int, other_fraction: float) -> bool:
    """Whether a place comes before another."""
    return bool(segment < other or (segment == other and fraction < other_fraction))


@kernel()
def locate(xy: FloatArray, outline: Outline, first_last: IndexArray) -> None:
    """Find where the sliding vertices are, after others have moved them.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates.
    outline
        What it says of where vertices are is overwritten, in order along each chain.
    first_last : (n_chains, 2)
        First and last entry of each chain.
    """
    nodes, vertices, segments = outline.nodes, outline.vertices, outline.segments
    fractions, off = outline.fractions, outline.off
    for chain in range(first_last.shape[0]):
        first, last = first_last[chain, 0], first_last[chain, 1]
        k, f = segments[first], fractions[first]
        for e in range(first + 1, last):
            v = vertices[e]
            x, y = xy[v, 0], xy[v, 1]
            least, best, best_f, is_off = np.inf, k, f, True
            for segment in range(k, segments[last] + 1):
                own, squares = _nearest_fraction(nodes, segment, x, y)
                if segment == k:
                    own = max(own, f)
                if squares < least:
                    least, best, best_f = squares, segment, own
                    near = ON_SEGMENT * _largest(nodes, segment)
                    near = max(near, outline.slack * segment_length(nodes, segment))
                    is_off = squares > near * near
                    if not is_off:
                        break
            if best_f >= 1.0 and best < segments[last]:
                best, best_f = best + 1, 0.0
            off[e] = is_off
            k, f = best, min(best_f, BELOW_ONE)
            segments[e], fractions[e] = k, f


# ------------------------------------------------------------------------------- how far it is


@helper()
def deviation(
    nodes: FloatArray,
    segment: int,
    ax: float,
    ay: float,
    last: int,
    bx: float,
    by: float,
) -> tuple[float, float]:
    """How far the outline from a, on `segment`, to b, on segment `last`, is from the edge a, b.

    Returns
    -------
    squares, length
        The square of the largest distance, which the nodes between have: of the outline from the
        edge, and so of the edge from the outline; and the square of the edge's length.
    """
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    inv = 1.0 / length if length > 0.0 else 0.0
    most = 0.0
    for k in range(segment + 1, last + 1):
        ox, oy = nodes[k, 0] - ax, nodes[k, 1] - ay
        f = min(max((ox * dx + oy * dy) * inv, 0.0), 1.0)
        ox, oy = ox - f * dx, oy - f * dy
        most = max(most, ox * ox + oy * oy)
    return most, length


@kernel()
def deviations(xy: FloatArray, outline: Outline, out: FloatArray) -> None:
    """Measure how far each edge of the outline is from it.

    Parameters
    ----------
    out : (n_entries, 2)
        Overwritten: of the edge from an entry to the next, the distance and that as a share of the
        edge; of no meaning for the last of a chain.
    """
    nodes, vertices, segments = outline.nodes, outline.vertices, outline.segments
    for e in range(vertices.size):
        out[e, 0] = out[e, 1] = 0.0
        if e + 1 < vertices.size:
            a, b = vertices[e], vertices[e + 1]
            squares, length = deviation(
                nodes, segments[e], xy[a, 0], xy[a, 1], segments[e + 1], xy[b, 0], xy[b, 1]
            )
            if squares > 0.0:
                out[e, 0] = math.sqrt(squares)
                out[e, 1] = math.sqrt(squares / length) if length > 0.0 else np.inf


# ------------------------------------------------------------------------------- what it crosses


@helper()
def _fit(boxes: FloatArray, k: int, ax: float, ay: float, bx: float, by: float) -> None:
    boxes[k, 0], boxes[k, 1] = min(ax, bx), min(ay, by)
    boxes[k, 2], boxes[k, 3] = max(ax, bx), max(ay, by)


@helper()
def _join(boxes: FloatArray, k: int) -> None:
    a, b = 2 * k, 2 * k + 1
    boxes[k, 0], boxes[k, 1] = min(boxes[a, 0], boxes[b, 0]), min(boxes[a, 1], boxes[b, 1])
    boxes[k, 2], boxes[k, 3] = max(boxes[a, 2], boxes[b, 2]), max(boxes[a, 3], boxes[b, 3])


@kernel()
def fit_boxes(xy: FloatArray, sides: Sides) -> None:
    """Fit all boxes to the sides as they are; `sides.boxes` is overwritten."""
    ends, boxes = sides.ends, sides.boxes
    leaves = boxes.shape[0] // 2
    for i in range(leaves):
        if i < ends.shape[0]:
            a, b = ends[i, 0], ends[i, 1]
            _fit(boxes, leaves + i, xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])
        else:
            _fit(boxes, leaves + i, np.inf, np.inf, np.inf, np.inf)
            boxes[leaves + i, 2] = boxes[leaves + i, 3] = -np.inf
    for k in range(leaves - 1, 0, -1):
        _join(boxes, k)


@helper()
def refit(xy: FloatArray, ends: IndexArray, boxes: FloatArray, side: int) -> None:
    """Fit the boxes around one side, whose vertex has moved."""
    a, b = ends[side, 0], ends[side, 1]
    k = boxes.shape[0] // 2 + side
    _fit(boxes, k, xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])
    k //= 2
    while k > 0:
        _join(boxes, k)
        k //= 2


@strict_helper()
def _meet(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    cx: float,
    cy: float,
    dx: float,
    dy: float,
) -> bool:
    """Whether the segments a, b and c, d, whose boxes overlap, have a point in common: exactly."""
    on_both = orientation(ax, ay, bx, by, cx, cy) * orientation(ax, ay, bx, by, dx, dy)
    if on_both > 0:
        return False
    return orientation(cx, cy, dx, dy, ax, ay) * orientation(cx, cy, dx, dy, bx, by) <= 0


@helper()
def _is_of(v: int, a: int, b: int) -> bool:
    """Whether v is one of the two ends."""
    return bool(v in (a, b))


@helper()
def meets_side(
    xy: FloatArray, ends: IndexArray, boxes: FloatArray, v: int, x: float, y: float, u: int
) -> bool:
    """Whether the edge from vertex u to vertex v, at (x, y), would meet another side.

    Sides of u and v do not count: the cells there say what is allowed.
    """
    ux, uy = xy[u, 0], xy[u, 1]
    low_x, low_y, high_x, high_y = min(x, ux), min(y, uy), max(x, ux), max(y, uy)
    leaves = boxes.shape[0] // 2
    k = 1
    # Depth first, without a stack: down to the left, and on to the right of what is done.
    while True:
        apart = (
            boxes[k, 0] > high_x or boxes[k, 2] < low_x
            or boxes[k, 1] > high_y or boxes[k, 3] < low_y
        )  # fmt: skip
        if not apart and k < leaves:
            k *= 2
            continue
        if not apart:
            a, b = ends[k - leaves, 0], ends[k - leaves, 1]
            own = _is_of(u, a, b) or _is_of(v, a, b)
            if not own and _meet(x, y, ux, uy, xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1]):
                return True
        while k & 1:
            k >>= 1
        if k == 0:
            return False
        k += 1


@kernel()
def meeting_sides(xy: FloatArray, sides: Sides, out: BoolArray) -> None:
    """Mark the sides that meet another with which they share no vertex; the boxes fit the sides.

    Parameters
    ----------
    out : (n_sides,)
        Overwritten.
    """
    ends, boxes = sides.ends, sides.boxes
    for i in range(ends.shape[0]):
        a, b = ends[i, 0], ends[i, 1]
        out[i] = meets_side(xy, ends, boxes, b, xy[b, 0], xy[b, 1], a)
