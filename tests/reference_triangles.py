"""Slow, obvious versions of the methods for triangles and of the area weights.

As in `reference`: complex numbers, lists of vertex ids, nothing shared with the package.
"""

import cmath
import itertools
import math

from reference import (
    allowed,
    aspect_ratio,
    clearance,
    determinant,
    fan,
    guard_lines,
    tolerance,
)


def circumcentre(a: complex, b: complex, c: complex) -> complex:
    u, w = b - a, c - a
    area = 2.0 * (u.conjugate() * w).imag
    return a + 1j * (w * abs(u) ** 2 - u * abs(w) ** 2) / -area


def along_circle(z: complex, a: complex, c: complex, step: float) -> complex:
    """Move z on the circle through z, a, c by a share of the arc to where both are as far."""
    centre = circumcentre(z, a, c)
    apex = centre + abs(z - centre) * 1j * (c - a) / abs(c - a)
    return centre + (z - centre) * cmath.exp(
        1j * step * cmath.phase((apex - centre) / (z - centre))
    )


def star_ratio(points, v, cells, z: complex) -> float:
    """Largest edge ratio of the triangles at v."""
    moved = dict(enumerate(points)) | {v: z}
    return max((aspect_ratio(moved, t) for t in fan(v, cells) if len(t) == 3), default=1.0)


def aspect_ratio_sweep(points, cells, order, ratio, step, options) -> list[complex]:
    """By aspect ratio: each vertex in turn, in place."""
    points = list(points)
    for v in order:
        z = points[v]
        tau, lines = tolerance(points, v, cells), guard_lines(points, v, cells)
        total, weights = 0j, 0.0
        for cell in fan(v, cells):
            if len(cell) == 4:
                continue
            a, c = points[cell[1]], points[cell[2]]
            if determinant(z, a, c) <= 0:
                continue
            own = max(abs(a - z), abs(c - z)) / min(abs(a - z), abs(c - z))
            if own <= ratio:
                continue
            place = along_circle(z, a, c, step)
            kept = clearance(lines, place) >= clearance(lines, z) - tau
            if kept and abs(place - z) >= tau:
                total += own**4 * (place - z)
                weights += own**4
        if not weights:
            continue
        way, most = total / weights, max(ratio, star_ratio(points, v, cells, z))
        for _ in range(4):
            place = allowed(points, v, cells, z + way, options)
            if star_ratio(points, v, cells, place) <= most * (1.0 + 1e-15):
                points[v] = place
                break
            way = 0.5 * (place - z)
    return points


def outline(v, cells):
    """What follows, and what goes before, each vertex of the polygon round v's star."""
    after, before = {}, {}
    for cell in fan(v, cells):
        for p, q in itertools.pairwise(cell[1:]):
            after[p], before[q] = q, p
    return after, before


def mean_of_bisectors(points, v, cells) -> complex:
    z = points[v]
    after, before = outline(v, cells)
    pivots = {w for cell in fan(v, cells) for w in (cell[1], cell[-1])}
    places = []
    for k in pivots:
        p, following, previous = points[k], points[after[k]], points[before[k]]
        if p in (z, following, previous):
            continue
        angle = cmath.phase((previous - p) / (following - p)) % (2.0 * math.pi)
        direction = (following - p) / abs(following - p)
        places.append(p + abs(z - p) * direction * cmath.exp(0.5j * angle))
    return sum(places) / len(places) if places else z


def angle_sweep(points, cells, order, step=1.0) -> list[complex]:
    """Angle-based as published: all at once."""
    new = list(points)
    for v in order:
        new[v] = points[v] + step * (mean_of_bisectors(points, v, cells) - points[v])
    return new


def guarded_angle_sweep(points, cells, order, step, options) -> list[complex]:
    points = list(points)
    for v in order:
        way = step * (mean_of_bisectors(points, v, cells) - points[v])
        points[v] = allowed(points, v, cells, points[v] + way, options)
    return points


def centroid(points, v, cells) -> complex:
    """Centroid of the polygon round v's star, seen from one of its corners."""
    after, _ = outline(v, cells)
    origin = points[next(iter(after))]
    area, moment = 0.0, 0j
    for p, q in after.items():
        a, b = points[p] - origin, points[q] - origin
        cross = (a.conjugate() * b).imag
        area += 0.5 * cross
        moment += cross * (a + b) / 6.0
    return origin + moment / area if area > 0.0 else points[v]


def centroid_sweep(points, cells, order) -> list[complex]:
    new = list(points)
    for v in order:
        new[v] = centroid(points, v, cells)
    return new


def smart_centroid_sweep(points, cells, order, options) -> list[complex]:
    points = list(points)
    for v in order:
        points[v] = allowed(points, v, cells, centroid(points, v, cells), options)
    return points
