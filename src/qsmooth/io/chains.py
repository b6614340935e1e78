"""Line cells as strings of vertices, and the boundary: what hydrodynamic formats list."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.io.file_content import FileContent


def chains(edges: IndexArray) -> list[IndexArray]:
    """Join edges, (k, 2), to strings of vertices along them; closed ones end as they begin.

    Edges that follow each other stay together; each is run along once, and never backwards.
    """
    if not len(edges):
        return []
    cuts = np.flatnonzero(edges[1:, 0] != edges[:-1, 1]) + 1
    pieces = [np.append(part[:, 0], part[-1, 1]) for part in np.split(edges, cuts)]
    waiting: dict[int, list[int]] = {}
    for p in reversed(range(len(pieces))):
        waiting.setdefault(int(pieces[p][0]), []).append(p)
    ends = {int(piece[-1]) for piece in pieces}
    heads = [p for p, piece in enumerate(pieces) if int(piece[0]) not in ends]
    taken = [False] * len(pieces)
    found = []
    for p in [*heads, *range(len(pieces))]:
        if taken[p]:
            continue
        parts: list[IndexArray] = []
        following: int | None = p
        while following is not None:
            taken[following] = True
            parts.append(pieces[following] if not parts else pieces[following][1:])
            others = waiting.get(int(parts[-1][-1]), [])
            while others and taken[others[-1]]:
                others.pop()
            following = others.pop() if others else None
        found.append(np.concatenate(parts))
    return found


def boundary_edges(content: FileContent) -> IndexArray:
    """List the edges with one cell, (k, 2), each with the mesh on its left."""
    edges = np.concatenate(
        [
            np.stack((cells, np.roll(cells, -1, axis=1)), axis=-1).reshape(-1, 2)
            for cells, _ in content.counter_clockwise()
        ]
    )
    low, high = edges.min(axis=1), edges.max(axis=1)
    _, first, count = np.unique(
        low * len(content.points) + high, return_index=True, return_counts=True
    )
    alone: IndexArray = edges[np.sort(first[count == 1])]
    return alone


def is_island(points: FloatArray, chain: IndexArray) -> bool:
    """Whether a closed string with the mesh on its left runs around a hole."""
    x, y = (points[chain, :2] - points[chain[0], :2]).T
    return bool((x[:-1] * y[1:] - x[1:] * y[:-1]).sum() < 0.0)


def boundary_numbers(content: FileContent) -> IndexArray:
    """Number the boundary's vertices from 1, (n_vertices,); 0 inside.

    As TELEMAC does: around the outside counter-clockwise, then around islands clockwise, each from
    the vertex of the least x + y.
    """
    found = np.zeros(len(content.points), np.int64)
    loops = chains(boundary_edges(content))
    loops.sort(key=lambda loop: is_island(content.points, loop))
    n_found = 0
    for loop in loops:
        at = loop[:-1]
        first = int(np.argmin(content.points[at, :2].sum(axis=1)))
        at = np.roll(at, -first)
        _, once = np.unique(at, return_index=True)  # a loop may touch itself
        fresh = at[np.sort(once)]
        fresh = fresh[found[fresh] == 0]
        found[fresh] = n_found + 1 + np.arange(fresh.size)
        n_found += fresh.size
    return found
