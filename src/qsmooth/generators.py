"""Meshes of any size from a formula and a seed: grids, lakes, random triangles, simple cases.

The same arguments give the same mesh. Public in `qsmooth.examples`.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.mesh import Mesh

Kind: TypeAlias = Literal["quad", "triangle", "mixed"]

# Coordinates of the lake are rounded to this, so that libraries that differ in the last bit of a
# sine make the same mesh.
LAKE_GRAIN = 2.0**-24
# Size of the lake's cells per distance from the coast, and the most beside those at the coast.
LAKE_GROWTH, LAKE_MOST = 0.18, 6.0
# Vertices stay away from those on the coast by this share of the size there: inside 1/√2 they
# could cut an edge of the coast off.
LAKE_MARGIN = 0.75


def structured(nx: int = 20, ny: int = 20, *, kind: Kind = "quad") -> Mesh:
    """Divide the unit square in `nx` by `ny` equal cells.

    Parameters
    ----------
    kind
        ``"quad"``; ``"triangle"`` for two triangles in place of each quad; ``"mixed"`` for that in
        the left half only.
    """
    x, y = np.meshgrid(np.linspace(0.0, 1.0, nx + 1), np.linspace(0.0, 1.0, ny + 1))
    return _grid(np.stack([x.ravel(), y.ravel()], axis=1), nx, ny, kind)


def jittered(
    nx: int = 20, ny: int = 20, *, amount: float = 0.5, seed: int = 0, kind: Kind = "quad"
) -> Mesh:
    """Move the interior vertices of `structured` at random, as far as every cell stays valid.

    Parameters
    ----------
    amount
        The longest move, in cells, 0 or more.
    """
    mesh = structured(nx, ny, kind=kind)
    moves = _random_moves(mesh, nx, ny, amount, seed)
    for attempt in range(60):
        moved = mesh.with_points(mesh.points + moves)
        bad = _worst_corners(moved) <= 0.02
        if not bad.any():
            return moved
        vertices = mesh.cell_vertices[np.repeat(bad, np.diff(mesh.cell_offsets))]
        moves[vertices] *= 0.8 if attempt < 50 else 0.0
    return mesh


def tangled(
    nx: int = 20, ny: int = 20, *, amount: float = 1.5, seed: int = 0, kind: Kind = "quad"
) -> Mesh:
    """Move the interior vertices of `structured` at random, whatever becomes of the cells.

    Parameters
    ----------
    amount
        The longest move, in cells, 0 or more.
    """
    mesh = structured(nx, ny, kind=kind)
    return mesh.with_points(mesh.points + _random_moves(mesh, nx, ny, amount, seed))


def random_interior(nx: int = 20, ny: int = 20, *, seed: int = 0, kind: Kind = "quad") -> Mesh:
    """Put the interior vertices of `structured` anywhere in the square."""
    mesh = structured(nx, ny, kind=kind)
    anywhere = np.random.default_rng(seed).random(mesh.points.shape)
    return mesh.with_points(np.where(mesh.is_boundary[:, None], mesh.points, anywhere))


def bump(n: int = 200, *, height: float = 0.5, width: float = 0.15) -> Mesh:
    """Press a bump into the bottom of a square grid of `n` by `n` quads.

    ``y + height (1 - y) exp(-((x - 1/2) / width)²)``: a whole region has to move to mend it.
    """
    points = structured(n, n).points.copy()
    x, y = points[:, 0], points[:, 1]
    points[:, 1] = y + height * (1.0 - y) * np.exp(-(((x - 0.5) / width) ** 2))
    return _grid(points, n, n, "quad")


def notch(n: int = 40, *, depth: float = 0.7, width: float = 0.2, kind: Kind = "quad") -> Mesh:
    """Cut a sharp notch into the top of a square grid of `n` by `n` cells.

    At its tip the domain is concave: the mean of a vertex's neighbours lies outside.
    """
    points = structured(n, n).points.copy()
    x, y = points[:, 0], points[:, 1]
    points[:, 1] = y * (1.0 - depth * np.maximum(0.0, 1.0 - np.abs(x - 0.5) / width))
    return _grid(points, n, n, kind)


def boundary_layer(nx: int = 60, ny: int = 24, *, first: float = 1e-5, kind: Kind = "quad") -> Mesh:
    """Lay thin quads along a wavy wall, the first of height `first`, growing geometrically to 1.

    Wanted anisotropy: what moves must not undo it.
    """
    growth = _growth(first, ny)
    layer = first * np.expm1(np.arange(ny + 1) * math.log(growth)) / (growth - 1.0)
    layer /= layer[-1]
    x, y = np.meshgrid(np.linspace(0.0, 3.0, nx + 1), layer)
    y = y + 0.1 * (1.0 - y) * np.sin(2.0 * math.pi * x)
    return _grid(np.stack([x.ravel(), y.ravel()], axis=1), nx, ny, kind)


def random_triangles(n_triangles: int = 1000, *, seed: int = 0) -> Mesh:
    """Triangulate the unit square, with vertices at its corners and at random inside (Delaunay).

    Parameters
    ----------
    n_triangles
        An even number, 4 or more; half as many vertices less one are inside.

    Raises
    ------
    ValueError
        If `n_triangles` is odd or too small.
    """
    if n_triangles < 4 or n_triangles % 2:
        raise ValueError(f"n_triangles must be even and 4 or more, got {n_triangles}")
    inside = np.random.default_rng([n_triangles, seed]).random((n_triangles // 2 - 1, 2))
    return Mesh(*_delaunay(_SQUARE, inside))


def simple_case(n_faces: int = 3, *, good: bool = False, seed: int = 0) -> Mesh:
    """Make one of the simple cases that smoothers for triangles are tried on.

    Parameters
    ----------
    n_faces
        3 for one vertex inside a triangle, 12 or 40 (or any even number from 4) for a square.
    good
        Whether the vertices are well spread to begin with.
    """
    if n_faces == 3:
        place = (0.5, 0.3) if good else (0.85, 0.04)
        outer = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.5 * math.sqrt(3.0)), place]
        return Mesh(outer, [(0, 1, 3), (1, 2, 3), (2, 0, 3)])
    if not good:
        return random_triangles(n_faces, seed=seed)
    rng = np.random.default_rng([n_faces, seed, 1])
    inside = np.empty((0, 2))
    while len(inside) < n_faces // 2 - 1:  # of many candidates, the one farthest from the others
        candidates = 0.05 + 0.9 * rng.random((200, 2))
        others = np.concatenate([_SQUARE, inside])
        near = np.hypot(*(candidates[:, None] - others).transpose(2, 0, 1)).min(axis=1)
        # Half a mesh size from the boundary is as good as a whole one from another vertex.
        near = np.minimum(near, 2.0 * np.minimum(candidates, 1.0 - candidates).min(axis=1))
        inside = np.concatenate([inside, candidates[[np.argmax(near)]]])
    return Mesh(*_delaunay(_SQUARE, inside))


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
    from qsmooth.examples import _jittered, _split

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
    points, quads, movable = _split(points, triangles)
    moved = _jittered(points, quads, movable, jitter, rng)
    return Mesh(np.round(moved / LAKE_GRAIN) * LAKE_GRAIN, quads)


_SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def _grid(points: FloatArray, nx: int, ny: int, kind: Kind) -> Mesh:
    """Join the points of a grid, row by row, to cells."""
    first = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    quads = np.stack([first, first + 1, first + nx + 2, first + nx + 1], axis=1)
    if kind == "quad":
        return Mesh(points, quads)
    if kind not in ("triangle", "mixed"):
        raise ValueError(f"kind must be 'quad', 'triangle' or 'mixed', got {kind!r}")
    cut = np.ones(len(quads), np.bool_)
    if kind == "mixed":
        cut = np.tile(np.arange(nx) < nx // 2, ny)
    triangles = quads[cut][:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return Mesh(points, [triangles, quads[~cut]] if kind == "mixed" else triangles)


def _random_moves(mesh: Mesh, nx: int, ny: int, amount: float, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    moves = rng.uniform(-amount, amount, mesh.points.shape) / (nx, ny)
    moves[mesh.is_boundary] = 0.0
    return moves


def _worst_corners(mesh: Mesh) -> FloatArray:
    from qsmooth.metrics import quality

    return quality(mesh).scaled_jacobian


def _growth(first: float, n: int) -> float:
    """Ratio of a geometric series of `n` terms from `first` with the sum one."""
    low, high = 1.0 + 1e-9, 1e3
    for _ in range(200):
        middle = 0.5 * (low + high)
        if n * math.log(middle) > math.log1p((middle - 1.0) / first):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _delaunay(corners: FloatArray, inside: FloatArray) -> tuple[FloatArray, IndexArray]:
    """Triangulate a rectangle with points inside."""
    from qsmooth.kernels.delaunay import triangulate

    points = np.concatenate([corners, inside])
    low, high = corners.min(axis=0), corners.max(axis=0)
    n_rows = max(1, int(math.sqrt(len(inside) / 2.0)))
    along, row = inside[:, 0], np.floor((inside[:, 1] - low[1]) / (high[1] - low[1]) * n_rows)
    order = 4 + np.lexsort((np.where(row % 2 == 0, along, -along), row))
    triangles, bad = triangulate(points, order)
    if bad >= 0:
        raise ValueError(f"point {bad} coincides with another or is outside")
    return points, triangles


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
    points, triangles = _delaunay(box, np.concatenate([coast, inside]))
    triangles = triangles[(triangles >= 4).all(axis=1)]
    triangles = triangles[_inside(points[triangles].mean(axis=1), rims)]
    used = np.unique(triangles)
    return points[used], np.searchsorted(used, triangles)
