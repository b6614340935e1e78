"""Bad quads out of good triangles: each is cut into three, then the vertices are shaken."""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray

# Every corner keeps at least this sine, or half of what it had before the vertices were moved.
LEAST_SINE = 0.002


def split_in_three(
    points: FloatArray, triangles: IndexArray
) -> tuple[FloatArray, IndexArray, BoolArray]:
    """Cut each triangle into three quads; also mark the vertices that are not on the boundary."""
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, edge_of_side, n_sides = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    middle = len(points) + edge_of_side.reshape(-1, 3)
    centre = len(points) + len(edges) + np.arange(len(triangles))
    quads = np.stack(
        [
            np.stack([triangles[:, i], middle[:, i], centre, middle[:, i - 1]], axis=1)
            for i in range(3)
        ],
        axis=1,
    ).reshape(-1, 4)
    points = np.concatenate([points, points[edges].mean(axis=1), points[triangles].mean(axis=1)])
    movable = np.ones(len(points), np.bool_)
    rim = np.flatnonzero(n_sides == 1)
    movable[edges[rim]] = False
    movable[middle.min() + rim] = False
    return points, quads, movable


def shaken(
    points: FloatArray,
    quads: IndexArray,
    movable: BoolArray,
    jitter: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Move vertices at random; shorten the moves around quads that would not stay convex."""
    reach = np.full(len(points), np.inf)
    for i in range(4):
        a, b = quads[:, i], quads[:, i - 1]
        length = np.hypot(*(points[a] - points[b]).T)
        np.minimum.at(reach, a, length)
        np.minimum.at(reach, b, length)
    angle = rng.uniform(0.0, 2.0 * math.pi, len(points))
    reach *= jitter * movable * np.sqrt(rng.uniform(0.0, 1.0, len(points)))
    moves = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    least = np.minimum(LEAST_SINE, 0.5 * worst_sines(points, quads))
    for attempt in range(60):
        bad = worst_sines(points + moves, quads) < least
        if not bad.any():
            break
        moves[quads[bad]] *= 0.8 if attempt < 40 else 0.0
    moved: FloatArray = points + moves
    return moved


def worst_sines(points: FloatArray, quads: IndexArray) -> FloatArray:
    """Smallest corner sine of each quad."""
    forward = np.roll(points[quads], -1, axis=1) - points[quads]
    back = -np.roll(forward, 1, axis=1)
    area = forward[..., 0] * back[..., 1] - forward[..., 1] * back[..., 0]
    lengths = np.hypot(forward[..., 0], forward[..., 1])
    sines: FloatArray = area / np.maximum(lengths * np.roll(lengths, 1, axis=1), 1e-300)
    worst: FloatArray = sines.min(axis=1)
    return worst
