"""A lake with a ragged coast and islands, of quads that are small at the coast."""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.examples.thirds import shaken, split_in_three
from qsmooth.examples.triangles import delaunay
from qsmooth.mesh import Mesh

# Coordinates of the lake are rounded to this, so that libraries that differ in the last bit of a
# sine make the same mesh.
LAKE_GRAIN = 2.0**-24
# Size of the lake's cells per distance from the coast, and the most beside those at the coast.
LAKE_GROWTH, LAKE_MOST = 0.18, 6.0
# Vertices stay away from those on the coast by this share of the size there: inside 1/√2 they
# could cut an edge of the coast off.
LAKE_MARGIN = 0.75


def lake(n_quads: int = 24_000, *, jitter: float = 0.45, seed: int = 7) -> Mesh:
    """Make a lake with a ragged coast and islands, of quads that are small at the coast.

    Points of a quadtree are triangulated, each triangle is cut into three quads, and the interior
    vertices are moved at random, as far as every quad stays strictly convex: many have a corner of
    nearly 180°.

    Parameters
    ----------
    n_quads
        About how many, 1000 or more.
    jitter
        Vertices move by up to this share of their shortest edge; 0 leaves them in place.

    Raises
    ------
    ValueError
        If `n_quads` is too small or `jitter` is negative.
    """
    if n_quads < 1000:
        raise ValueError(f"n_quads must be 1000 or more, got {n_quads}")
    if not 0.0 <= jitter < math.inf:
        raise ValueError(f"jitter must be 0 or more, got {jitter}")
    rng = np.random.default_rng(seed)
    curves = _coast(rng, math.sqrt(24_000 / n_quads))
    size = 3.2 / math.sqrt(n_quads)
    for _ in range(4):  # the number of triangles goes with the inverse square of the size
        points, triangles = _fill(curves, size, seed)
        ratio = 3.0 * len(triangles) / n_quads
        if abs(ratio - 1.0) < 0.02:
            break
        size *= math.sqrt(ratio)
    points, quads, movable = split_in_three(points, triangles)
    moved = shaken(points, quads, movable, jitter, rng)
    return Mesh(np.round(moved / LAKE_GRAIN) * LAKE_GRAIN, quads)


def _coast(rng: np.random.Generator, smoothness: float) -> list[FloatArray]:
    """Draw the shore and the islands as closed curves of many points; the shore comes first."""
    t = np.linspace(0.0, 2.0 * math.pi, 6000, endpoint=False)
    most = max(4, int(24 / max(1.0, smoothness)))
    shore = _curve(t, rng, most, 0.26)
    shore[:, 0] *= 1.9
    curves = [shore]
    while len(curves) < 7:
        centre = rng.uniform((-1.9, -1.0), (1.9, 1.0))
        radius = rng.uniform(0.04, 0.14)
        apart = min(np.hypot(*(curve - centre).T).min() for curve in curves)
        if _inside(centre[None], curves)[0] and apart > radius + 0.12:
            island = centre + radius * _curve(t[::4], rng, max(3, most // 4), 0.2)
            curves.append(island)
    return curves


def _curve(t: FloatArray, rng: np.random.Generator, most: int, amplitude: float) -> FloatArray:
    """Draw a closed curve round the origin with `most` waves of falling height."""
    radius = np.ones_like(t)
    for k in range(2, most + 1):
        height = amplitude * rng.normal() / k**1.25
        radius += height * np.cos(k * t + rng.uniform(0.0, 2.0 * math.pi))
    radius = np.maximum(radius, 0.3)
    curve: FloatArray = radius[:, None] * np.stack([np.cos(t), np.sin(t)], axis=1)
    return curve


def _inside(points: FloatArray, curves: list[FloatArray]) -> BoolArray:
    """Whether points are in the lake: an odd number of curves' edges to the right of them."""
    odd = np.zeros(len(points), np.bool_)
    for curve in curves:
        ahead = np.roll(curve, -1, axis=0)
        for start in range(0, len(points), 2000):
            some = slice(start, start + 2000)
            x, y = points[some, 0, None], points[some, 1, None]
            crosses = (curve[:, 1] > y) != (ahead[:, 1] > y)
            rise = np.where(ahead[:, 1] == curve[:, 1], 1.0, ahead[:, 1] - curve[:, 1])
            at = curve[:, 0] + (y - curve[:, 1]) * (ahead[:, 0] - curve[:, 0]) / rise
            odd[some] ^= (np.count_nonzero(crosses & (x < at), axis=1) % 2).astype(np.bool_)
    return odd


def _resampled(curve: FloatArray, size: float) -> FloatArray:
    """Take points on a closed curve at equal distances of about `size`."""
    closed = np.concatenate([curve, curve[:1]])
    passed = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    at = np.linspace(0.0, passed[-1], max(8, round(passed[-1] / size)) + 1)[:-1]
    points = np.stack([np.interp(at, passed, closed[:, d]) for d in range(2)], axis=1)
    return np.round(points / LAKE_GRAIN) * LAKE_GRAIN


def _distance(points: FloatArray, coast: FloatArray) -> FloatArray:
    """Distance of each point to the nearest one on the coast."""
    out = np.empty(len(points))
    for start in range(0, len(points), 1000):
        some = slice(start, start + 1000)
        dx = points[some, 0, None] - coast[:, 0]
        dy = points[some, 1, None] - coast[:, 1]
        out[some] = np.sqrt((dx * dx + dy * dy).min(axis=1))
    return out


def _fill(curves: list[FloatArray], size: float, seed: int) -> tuple[FloatArray, IndexArray]:
    """Triangulate the lake with edges of about `size` at the coast and longer ones inside."""
    rims = [_resampled(curve, size) for curve in curves]
    coast = np.concatenate(rims)
    rng = np.random.default_rng([seed, 1])
    low, high = coast.min(axis=0) - size, coast.max(axis=0) + size
    # Leaves of a quadtree that is divided where its cells are larger than wanted there.
    side = LAKE_MOST * size
    counts = np.ceil((high - low) / side).astype(np.int64)
    i, j = np.meshgrid(np.arange(counts[0]), np.arange(counts[1]))
    centres = low + side * (np.stack([i.ravel(), j.ravel()], axis=1) + 0.5)
    leaves = []
    while len(centres):
        away = _distance(centres, coast)
        wanted = size * np.minimum(1.0 + LAKE_GROWTH * away / size, LAKE_MOST)
        divide = (side > wanted) & (side > size)
        kept = ~divide & (away > LAKE_MARGIN * size + 0.25 * side)
        leaves.append(centres[kept] + 0.25 * side * rng.uniform(-1.0, 1.0, (int(kept.sum()), 2)))
        quarter = 0.25 * side * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        centres = (centres[divide][:, None] + quarter).reshape(-1, 2)
        side *= 0.5
    inside = np.concatenate(leaves)
    inside = np.round(inside[_inside(inside, rims)] / LAKE_GRAIN) * LAKE_GRAIN
    low, high = low - 1.0, high + 1.0
    box = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    points, triangles = delaunay(box, np.concatenate([coast, inside]))
    triangles = triangles[(triangles >= 4).all(axis=1)]
    triangles = triangles[_inside(points[triangles].mean(axis=1), rims)]
    used = np.unique(triangles)
    return points[used], np.searchsorted(used, triangles)
