"""Meshes with outlines to slide along, and whether what slid is where it may be."""

import math
from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from meshes import annulus, grid
from qsmooth import Mesh
from qsmooth.kernels.geometry import orientation


def bay(n, amount, height=0.1, seed=0, regions=None):
    """A square with a wavy shore above, vertices shaken along the boundary and inside."""
    rng = np.random.default_rng(seed)
    points, (quads,) = grid(n, n)
    shake = rng.uniform(-0.5, 0.5, points.shape) * amount
    shake[(points == 0) | (points == n)] = 0.0
    x, y = ((points + shake) / n).T
    y = y * (1.0 + height * np.sin(2.0 * math.pi * x))
    return Mesh(np.stack([x, y], axis=1), [quads], regions=regions)


def ring(n_around, n_out, amount, seed=0):
    """A ring whose vertices are shaken around the centre."""
    points, cells = annulus(n_around, n_out)
    rng = np.random.default_rng(seed)
    radius, angle = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
    angle += rng.uniform(-0.5, 0.5, len(points)) * amount * 2.0 * math.pi / n_around
    return Mesh(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), cells)


def sides(mesh):
    """The edges with one cell, the cell to their left."""
    seen = {}
    for first, last in zip(mesh.cell_offsets[:-1], mesh.cell_offsets[1:], strict=True):
        cell = mesh.cell_vertices[first:last].tolist()
        for a, b in zip(cell, [*cell[1:], cell[0]], strict=True):
            seen[a, b] = True
    return [(a, b) for a, b in seen if (b, a) not in seen]


def turns(mesh):
    """By how much the boundary turns at each of its vertices, degrees."""
    after, before = dict(sides(mesh)), {b: a for a, b in sides(mesh)}
    found = {}
    for v, w in after.items():
        u, t = mesh.xy[v] - mesh.xy[before[v]], mesh.xy[w] - mesh.xy[v]
        found[v] = abs(math.degrees(math.atan2(u[0] * t[1] - u[1] * t[0], u @ t)))
    return found


def distance(p, a, b):
    d = b - a
    share = min(max((p - a) @ d / (d @ d), 0.0), 1.0)
    return float(np.linalg.norm(p - a - share * d)), share


def is_on(p, a, b):
    """Whether p is within an ulp of the segment: in fractions."""
    (px, py), (ax, ay), (bx, by) = ([Fraction(x) for x in q.tolist()] for q in (p, a, b))
    dx, dy = bx - ax, by - ay
    share = ((px - ax) * dx + (py - ay) * dy) / (dx * dx + dy * dy)
    share = min(max(share, Fraction(0)), Fraction(1))
    off = (px - ax - share * dx) ** 2 + (py - ay - share * dy) ** 2
    return off <= Fraction(float(np.spacing(np.abs([*p, *a, *b]).max()))) ** 2


def places(before, points):
    """Where each boundary vertex is on the boundary that it was on: a side, and a share of it."""
    old = sides(before)
    found = {}
    for v, _ in old:
        best = min(old, key=lambda side: distance(points[v], *before.xy[list(side)])[0])
        assert is_on(points[v], *before.xy[list(best)]), f"vertex {v} is beside the boundary"
        found[v] = best, distance(points[v], *before.xy[list(best)])[1]
    return found


def check_slid(before, points, tolerance, corner_angle=20.0):
    """Boundary vertices are on the old boundary, in order and near it; corners did not move."""
    found, after, turning = places(before, points), dict(sides(before)), turns(before)
    for v, turn in turning.items():
        if turn > corner_angle:
            assert points[v].tobytes() == before.xy[v].tobytes(), f"corner {v} moved"
    for v, w in after.items():
        # The nodes that the edge leaves out are those between the places of its ends.
        (here, at), (there, to) = found[v], found[w]
        node, cut = here[1], []
        while here != there and node != there[0]:
            cut.append(node)
            node = after[node]
            assert len(cut) < len(after), "out of order"
        if here != there:
            cut.append(node)
        else:
            assert at <= to, "out of order"
        length = float(np.linalg.norm(points[w] - points[v]))
        for node in cut:
            off = distance(before.xy[node], points[v], points[w])[0]
            assert off <= tolerance * length * (1.0 + 1e-9) + 1e-15, f"far from node {node}"


def crossings(points, edges):
    """Pairs of edges without a common vertex that have a common point, in exact arithmetic."""
    found = []
    for i, (a, b) in enumerate(edges):
        for c, d in edges[i + 1 :]:
            low = np.minimum(points[[a, c]], points[[b, d]])
            high = np.maximum(points[[a, c]], points[[b, d]])
            apart = (low[0] > high[1]).any() or (low[1] > high[0]).any()
            if {a, b} & {c, d} or apart:
                continue
            p, q, r, s = (tuple(points[v]) for v in (a, b, c, d))
            if (
                orientation(*p, *q, *r) * orientation(*p, *q, *s) <= 0
                and orientation(*r, *s, *p) * orientation(*r, *s, *q) <= 0
            ):
                found.append(((a, b), (c, d)))
    return found


MESHES = st.builds(
    bay,
    st.integers(4, 9),
    st.floats(0.0, 0.9),
    st.sampled_from([0.0, 0.05, 0.15]),
    st.integers(0, 99),
) | st.builds(ring, st.integers(19, 40), st.integers(2, 4), st.floats(0.0, 0.8), st.integers(0, 99))
