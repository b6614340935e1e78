"""Sweeps over the vertices that slide along the outline, on blocks of lanes.

The energy, what is held and the certificate are those of `mapped_sweep`. Newton's step is one of
arc length along the outline, on to other segments where it leads there, and trials are places on
these as they are stored. A trial is also refused where the vertex would pass its neighbours on the
outline, where an edge would be farther from the outline than is allowed, and where an edge would
meet another side of the boundary.

While a mesh is untangled the energy is the regularised one of `untangle_sweep`, and no margin is
asked for.

The last test depends on all sides as they are: these sweeps run on one thread. There are few
vertices to an outline.
"""

import math

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel
from qsmooth.kernels.blocks import LANES, Blocks, Rows, block_at
from qsmooth.kernels.confining import confined, within_reach
from qsmooth.kernels.lanes import (
    ENERGY,
    FRACTIONS,
    GX,
    GY,
    HELD,
    HXX,
    HXY,
    HYY,
    LEAST_PROMISE,
    MARGIN,
    N_ROWS,
    PX,
    PY,
    SX,
    TODO,
    TRIAL,
    X,
    Y,
    gather_block,
)
from qsmooth.kernels.mapped_sweep import Asked, Maps, add_stars, try_stars
from qsmooth.kernels.newton_sweep import Wall, gather_held
from qsmooth.kernels.outline import (
    Outline,
    Sides,
    advance,
    deviation,
    is_before,
    meets_side,
    place_at,
    refit,
    tangent,
)
from qsmooth.kernels.rails import Rails
from qsmooth.kernels.star_energy import Terms
from qsmooth.kernels.untangle_sweep import add_regularised, try_regularised

# A step that the outline forbids is made shorter by this, so often: round a bend only short ones
# keep the edge near it. That costs little beside the energy of a trial.
SHORTER, SHORTENED = 0.35, 4


@helper()
def step_along(
    s: FloatArray, i: int, nodes: FloatArray, segment: int, fraction: float
) -> tuple[float, float]:
    """Find Newton's step of arc length in lane i, and what it promises by its linear model."""
    gx, gy = s[GX + i], s[GY + i]
    tx, ty = tangent(nodes, segment)
    slope = gx * tx + gy * ty
    if fraction == 0.0 and slope >= 0.0:
        # At a node, where it does not go downhill ahead: what lies behind.
        tx, ty = tangent(nodes, segment - 1)
        slope = max(gx * tx + gy * ty, 0.0)
    bend = tx * tx * s[HXX + i] + 2.0 * tx * ty * s[HXY + i] + ty * ty * s[HYY + i]
    if slope == 0.0 or not bend > 0.0:
        return 0.0, 0.0
    return -slope / bend, slope * slope / bend


@helper()
def start_sliding(s: FloatArray, first: int, n: int, outline: Outline) -> float:
    """Work out the step of each lane; count the lanes that have one to take."""
    nodes, segments, fractions = outline.nodes, outline.segments, outline.fractions
    off, entries, free = outline.off, outline.entries, outline.free
    left = 0.0
    for i in range(n):
        s[SX + i] = s[TODO + i] = 0.0
        if not free[first + i]:
            continue
        e = entries[first + i]
        if off[e]:
            # Any place on the outline is better than one beside it.
            s[ENERGY + i], s[TODO + i] = np.inf, 1.0
        else:
            step, promise = step_along(s, i, nodes, segments[e], fractions[e])
            s[SX + i] = step
            s[TODO + i] = 1.0 if promise > LEAST_PROMISE * s[ENERGY + i] else 0.0
        left += s[TODO + i]
    return left


@helper()
def _farther(xy: FloatArray, outline: Outline, e: int, segment: int, x: float, y: float) -> float:
    """How far an edge of entry e, at (x, y) on `segment`, is from the outline: the farther one.

    As a share of the edge, squared.
    """
    nodes, vertices, segments = outline.nodes, outline.vertices, outline.segments
    u, w = vertices[e - 1], vertices[e + 1]
    squares, length = deviation(nodes, segments[e - 1], xy[u, 0], xy[u, 1], segment, x, y)
    ahead, ahead_length = deviation(nodes, segment, x, y, segments[e + 1], xy[w, 0], xy[w, 1])
    return max(squares / length, ahead / ahead_length)


@helper()
def _keeps_near(xy: FloatArray, outline: Outline, e: int, segment: int, x: float, y: float) -> bool:
    """Whether the edges of entry e, at (x, y) on `segment`, stay as near to the outline as asked.

    That is within the tolerance; or no farther than they are, where that is beyond it.
    """
    share = _farther(xy, outline, e, segment, x, y)
    if share <= outline.tolerance * outline.tolerance:
        return True
    v = outline.vertices[e]
    return bool(share <= _farther(xy, outline, e, outline.segments[e], xy[v, 0], xy[v, 1]))


@helper()
def _on_one_segment(outline: Outline, e: int, segment: int) -> bool:
    """Whether entry e and its neighbours lie on one segment, up to rounding, and it stays there."""
    if outline.slack > 0.0:
        return False
    last, end = outline.segments[e + 1], outline.fractions[e + 1]
    return bool(
        outline.segments[e - 1] == segment
        and outline.segments[e] == segment
        and (last == segment or (last == segment + 1 and end == 0.0))
    )


@helper()
def fits_line(
    xy: FloatArray, outline: Outline, e: int, segment: int, fraction: float, x: float, y: float
) -> bool:
    """Whether the vertex of entry e keeps its order at this place, and its edges near the line."""
    segments, fractions = outline.segments, outline.fractions
    return bool(
        is_before(segments[e - 1], fractions[e - 1], segment, fraction)
        and is_before(segment, fraction, segments[e + 1], fractions[e + 1])
        and (outline.off[e] or _keeps_near(xy, outline, e, segment, x, y))
    )


@helper()
def meets_another(
    xy: FloatArray, outline: Outline, sides: Sides, e: int, segment: int, x: float, y: float
) -> bool:
    """Whether an edge of entry e, at (x, y) on `segment`, would meet another side."""
    if outline.sides[e] < 0 or (not outline.off[e] and _on_one_segment(outline, e, segment)):
        return False
    vertices, ends, boxes = outline.vertices, sides.ends, sides.boxes
    v, before, after = vertices[e], vertices[e - 1], vertices[e + 1]
    return bool(
        meets_side(xy, ends, boxes, v, x, y, before) or meets_side(xy, ends, boxes, v, x, y, after)
    )


@helper()
def _in_reach(rails: Rails, v: int, x: float, y: float) -> bool:
    """Whether a place is within the reach of a vertex."""
    if not confined(rails):
        return True
    dx, dy = x - rails.origin[v, 0], y - rails.origin[v, 1]
    return bool(within_reach(dx, dy, rails.reach[v]))


@helper()
def place_trials(
    xy: FloatArray,
    first: int,
    n: int,
    share: float,
    s: FloatArray,
    outline: Outline,
    rails: Rails,
    to_segment: IndexArray,
    to_fraction: FloatArray,
) -> int:
    """Put the vertices at a share of their steps along the outline, and clear what is summed up.

    At less of it where the outline or the reach forbids that. Where all of that is forbidden the
    vertex has no step to take, and its segment is -1.

    Returns
    -------
    allowed
        How many may go there.
    """
    nodes, segments, fractions = outline.nodes, outline.segments, outline.fractions
    allowed = 0
    for i in range(n):
        e = outline.entries[first + i]
        s[PX + i], s[PY + i] = s[X + i], s[Y + i]
        to_segment[i] = -1
        if s[TODO + i] > 0.0:
            way, low, high = share * s[SX + i], segments[e - 1], segments[e + 1]
            s[TODO + i] = 0.0
            for _ in range(1 + SHORTENED):
                k, f = advance(nodes, segments[e], fractions[e], way, low, high)
                x, y = place_at(nodes, k, f)
                if _in_reach(rails, outline.vertices[e], x, y) and fits_line(
                    xy, outline, e, k, f, x, y
                ):
                    to_segment[i], to_fraction[i] = k, f
                    s[PX + i], s[PY + i] = x, y
                    s[TODO + i] = 1.0
                    allowed += 1
                    break
                way *= SHORTER
        s[TRIAL + i] = 0.0
        s[MARGIN + i] = np.inf
        s[HELD + i] = np.inf
    return allowed


@helper()
def store_slides(
    xy: FloatArray,
    first: int,
    n: int,
    s: FloatArray,
    outline: Outline,
    sides: Sides,
    to_segment: IndexArray,
    to_fraction: FloatArray,
    lengths: FloatArray,
) -> float:
    """Store the trial places that lower the energy and may be; count the lanes that are left."""
    entries, vertices = outline.entries, outline.vertices
    segments, fractions, off = outline.segments, outline.fractions, outline.off
    ends, boxes = sides.ends, sides.boxes
    left = 0.0
    for i in range(n):
        e, x, y = entries[first + i], s[PX + i], s[PY + i]
        good = (s[TRIAL + i] < s[ENERGY + i]) & (s[MARGIN + i] > 0.0) & (s[HELD + i] > 0.0)
        good &= (s[TODO + i] > 0.0) & (to_segment[i] >= 0)
        # Neighbours are of other colours; what is met depends on all that have moved.
        if good and not meets_another(xy, outline, sides, e, to_segment[i], x, y):
            v = vertices[e]
            xy[v, 0], xy[v, 1] = x, y
            dx, dy = x - s[X + i], y - s[Y + i]
            lengths[first + i] = math.sqrt(dx * dx + dy * dy)
            segments[e], fractions[e], off[e] = to_segment[i], to_fraction[i], False
            if outline.sides[e] >= 0:
                refit(xy, ends, boxes, outline.sides[e])
                refit(xy, ends, boxes, outline.sides[e - 1])
            s[TODO + i] = 0.0
        left += s[TODO + i]
    return left


@kernel()
def slide_sweep(
    xy: FloatArray,
    blocks: Blocks,
    outline: Outline,
    sides: Sides,
    relaxation: float,
    wall: Wall,
    held: FloatArray,
    rows: Rows,
    maps: Maps,
    lengths: FloatArray,
) -> None:
    """Move each sliding vertex once, downhill on its star's energy, in place.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates. Only vertices whose cells are valid then move, in place.
    blocks
        The vertices that slide.
    outline, sides
        Where they are and may be; both are kept up to date.
    relaxation, wall, held, rows, maps
        As in `mapped_sweep.mapped_sweep`.
    lengths : (n_sliding,)
        Overwritten. Length of each move, in block order.
    """
    terms = Terms(wall.mean_weight, 1.0 / wall.threshold, wall.squarings, 2.0**wall.squarings)
    table, vertices, stars, largest = blocks.table, blocks.vertices, blocks.stars, blocks.largest
    rails = Rails(*blocks.rails)
    what = Asked(
        (rows.m11, rows.m12, rows.m22),
        (rows.area, rows.inv_area, rows.size_weight),
        (rows.slim, rows.near),
        (np.zeros(rows.slim.size), rows.near),
        (maps.l11, maps.l12, maps.l22),
    )
    star_xy, mapped = np.empty(6 * largest * LANES), np.empty(6 * largest * LANES)
    s, own = np.empty(N_ROWS * LANES), np.zeros(N_ROWS * LANES)
    to_segment, to_fraction = np.empty(LANES, np.int64), np.empty(LANES)
    for b in range(table.shape[0]):
        block = block_at(table, b)
        first, n = block.first, block.size
        gather_block(xy, vertices, stars, block, star_xy, s, lengths)
        gather_held(vertices, first, n, held, s)
        add_stars(star_xy, s, block, what, terms, mapped, own)
        left = start_sliding(s, first, n, outline)
        share = relaxation
        for attempt in range(len(FRACTIONS) + 1):
            if left == 0.0:
                break
            if place_trials(xy, first, n, share, s, outline, rails, to_segment, to_fraction):
                try_stars(star_xy, s, block, what, terms, held.shape[1] > 3, mapped, own)
                left = store_slides(
                    xy, first, n, s, outline, sides, to_segment, to_fraction, lengths
                )
            share = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]


@kernel()
def slide_untangling(
    xy: FloatArray,
    blocks: Blocks,
    outline: Outline,
    sides: Sides,
    relaxation: float,
    sizes: FloatArray,
    epsilon: float,
    lengths: FloatArray,
) -> None:
    """Move each sliding vertex once, downhill on its star's regularised energy, in place.

    Parameters
    ----------
    sizes, epsilon
        As in `untangle_sweep.untangle_sweep`.
    xy, blocks, outline, sides, relaxation, lengths
        As in `slide_sweep`; the mesh need not be valid.
    """
    table, vertices, stars, largest = blocks.table, blocks.vertices, blocks.stars, blocks.largest
    rails = Rails(*blocks.rails)
    star_xy, s = np.empty(6 * largest * LANES), np.empty(N_ROWS * LANES)
    to_segment, to_fraction = np.empty(LANES, np.int64), np.empty(LANES)
    for b in range(table.shape[0]):
        block = block_at(table, b)
        first, n = block.first, block.size
        gather_block(xy, vertices, stars, block, star_xy, s, lengths)
        add_regularised(star_xy, s, vertices, block, sizes, epsilon)
        left = start_sliding(s, first, n, outline)
        share = relaxation
        for attempt in range(len(FRACTIONS) + 1):
            if left == 0.0:
                break
            if place_trials(xy, first, n, share, s, outline, rails, to_segment, to_fraction):
                try_regularised(star_xy, s, block)
                left = store_slides(
                    xy, first, n, s, outline, sides, to_segment, to_fraction, lengths
                )
            share = FRACTIONS[min(attempt, len(FRACTIONS) - 1)]
