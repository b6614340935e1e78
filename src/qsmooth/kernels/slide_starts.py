"""The outline of a step: chains laid through where their vertices are, and what is a corner now."""

import math

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel
from qsmooth.kernels.outline import Outline


@helper()
def _turn(xy: FloatArray, a: int, v: int, b: int) -> float:
    """By how much the way from a over v to b turns, degrees."""
    ux, uy = xy[v, 0] - xy[a, 0], xy[v, 1] - xy[a, 1]
    wx, wy = xy[b, 0] - xy[v, 0], xy[b, 1] - xy[v, 1]
    return abs(math.degrees(math.atan2(ux * wy - uy * wx, ux * wx + uy * wy)))


@kernel()
def start_outline(
    xy: FloatArray,
    changed: BoolArray,
    outline: Outline,
    offsets: IndexArray,
    own: BoolArray,
    chain_of: IndexArray,
    corner_angle: float,
    fresh: BoolArray,
) -> None:
    """Lay lines through where the host has put their vertices, and let those at corners stay.

    Chains of which it has moved no vertex are left as they are, with the lines that they have.

    Parameters
    ----------
    xy, changed : (n_vertices, 2), (n_vertices,)
        Coordinates, and what the host has moved.
    outline
        Of chains that it has moved, what is free is overwritten; and of those that are marked, the
        nodes and where vertices are.
    offsets : (n_chains + 1,)
        Entries of each chain.
    own : (n_chains,)
        Chains whose line has a node at each of their vertices, and no other.
    chain_of : (n_sliding,)
        Chain of each vertex that slides, in the order of the blocks.
    corner_angle
        Degrees; where a chain turns by more a vertex stays.
    fresh : (n_chains,)
        Overwritten: the chains that the host has moved.
    """
    nodes, vertices, segments = outline.nodes, outline.vertices, outline.segments
    fractions, off, entries, free = outline.fractions, outline.off, outline.entries, outline.free
    for chain in range(own.size):
        first, last = offsets[chain], offsets[chain + 1] - 1
        fresh[chain] = False
        for e in range(first, last + 1):
            if changed[vertices[e]]:
                fresh[chain] = True
        if fresh[chain] and own[chain]:
            k = segments[first]  # the first of a chain is at the first node of its line
            for e in range(first, last + 1):
                nodes[k, 0], nodes[k, 1] = xy[vertices[e], 0], xy[vertices[e], 1]
                segments[e], fractions[e], off[e] = k, 0.0, False
                k += 1
            segments[last], fractions[last] = k - 2, 1.0
    for i in range(entries.size):
        if fresh[chain_of[i]]:
            e = entries[i]
            free[i] = _turn(xy, vertices[e - 1], vertices[e], vertices[e + 1]) <= corner_angle
