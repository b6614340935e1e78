"""Grids: the unit square in rows of cells, as it is, shaken, folded, bent or squeezed."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.mesh import Mesh

Kind: TypeAlias = Literal["quad", "triangle", "mixed"]
# Of `distorted`: longest over shortest length along a side; the cotangents, with their sign turned,
# of the angle that a quarter of the quads have and of the largest; how often vertices are moved.
UNEVEN = 100.0
FLAT, MOST_FLAT = 1.0 / math.tan(math.radians(20.0)), 100.0
ROUNDS = 1000


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
        bad = _scaled_jacobian(moved) <= 0.02
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


def around_body(n: int = 45) -> Mesh:
    """Fill a box of 2 by 2 around a square body, a fifth as wide, with equal quads.

    The body's middle is the origin; turned about it, with the box at rest, it asks the quads
    between to follow.

    Parameters
    ----------
    n
        Quads along a side of the box, 5 or more.

    Raises
    ------
    ValueError
        If `n` is too small.
    """
    if n < 5:
        raise ValueError(f"n must be 5 or more, got {n}")
    mesh = structured(n, n)
    width = n // 5
    first = (n - width) // 2
    inside = np.zeros((n, n), np.bool_)
    inside[first : first + width, first : first + width] = True
    cells = mesh.cells[0][~inside.ravel()]
    used, vertices = np.unique(cells, return_inverse=True)
    centre = (first + 0.5 * width) / n  # not quite that of the box where n and width are not alike
    return Mesh(2.0 * (mesh.points[used] - centre), vertices.reshape(cells.shape))


def distorted(n: int = 64, seed: int = 0) -> Mesh:
    """Distort the unit square's grid of `n` by `n` quads violently; all of them stay convex.

    Along each side lengths vary smoothly, the longest `UNEVEN` times the shortest, each side in its
    own way; the grid's lines are straight. Then vertices move at random, each by up to half of its
    shortest edge, where its quads stay convex, until a quarter of the quads have a corner over
    160°. Distortion is not intent: neither directions nor ratios of sides are meant.

    Parameters
    ----------
    n
        2 or more.

    Raises
    ------
    ValueError
        If `n` is too small.
    """
    if n < 2:
        raise ValueError(f"n must be 2 or more, got {n}")
    rng = np.random.default_rng([n, seed])
    bottom, top, left, right = (_uneven(n, rng) for _ in range(4))
    lean, slope = top - bottom, (right - left)[:, None]
    x = (bottom + lean * left[:, None]) / (1.0 - lean * slope)
    y = left[:, None] + slope * x
    mesh = _grid(np.stack([x.ravel(), y.ravel()], axis=1), n, n, "quad")
    points, quads = mesh.points.copy(), mesh.cells[0]
    vertices = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    # No two vertices of one of these four share a quad.
    groups = [vertices[i:n:2, j:n:2].ravel() for i in (1, 2) for j in (1, 2)]
    for _ in range(ROUNDS):
        if (_flattest(points, quads) > FLAT).mean() > 0.25:
            break
        for group in groups:
            if group.size:
                _move_if_convex(points, quads, group, n, rng)
    return mesh.with_points(points)


def _uneven(n: int, rng: np.random.Generator) -> FloatArray:
    """Points from 0 to 1 at distances that vary smoothly by a factor of `UNEVEN`."""
    middle = (np.arange(n) + 0.5) / n
    wave = np.zeros(n)
    for k in range(1, 5):
        amplitude, phase = rng.normal() / k, rng.uniform()
        wave += amplitude * np.cos(2.0 * math.pi * (0.5 * k * middle + phase))
    lengths = UNEVEN ** ((wave - wave.min()) / (wave.max() - wave.min()))
    return np.concatenate([[0.0], np.cumsum(lengths)[:-1] / lengths.sum(), [1.0]])


def _flattest(points: FloatArray, quads: IndexArray) -> FloatArray:
    """Largest cotangent, with its sign turned, of each quad's corners; infinite if not convex."""
    p = points[quads]
    u, w = np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p
    det = u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]
    convex = (det > 0.0).all(axis=1)
    flat = -(u * w).sum(axis=2) / np.where(det > 0.0, det, 1.0)
    return np.where(convex, flat.max(axis=1), np.inf)


def _move_if_convex(
    points: FloatArray, quads: IndexArray, group: IndexArray, n: int, rng: np.random.Generator
) -> None:
    """Move interior vertices of a grid that share no quad, those whose quads stay convex."""
    edges = [points[group + step] - points[group] for step in (-1, 1, -n - 1, n + 1)]
    shortest = np.min([np.hypot(*edge.T) for edge in edges], axis=0)
    old = points[group]
    points[group] += rng.uniform(-0.5, 0.5, old.shape) * shortest[:, None]
    row, column = np.divmod(group, n + 1)
    below_left = (row - 1) * n + column - 1
    star = below_left[:, None] + [0, 1, n, n + 1]
    flattest = _flattest(points, quads[star.ravel()]).reshape(star.shape).max(axis=1)
    refused = flattest > MOST_FLAT
    points[group[refused]] = old[refused]


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


def _scaled_jacobian(mesh: Mesh) -> FloatArray:
    # Here, as a kernel brings Numba, which the other grids do not need.
    from qsmooth.kernels.cell_figures import N_FIGURES, SCALED_JACOBIAN, cell_figures
    from qsmooth.kernels.cell_lanes import n_chunks

    out = np.empty((N_FIGURES, mesh.n_cells))
    cell_figures(mesh.xy, *mesh.topology.cells, out, np.empty(n_chunks(mesh.n_cells)))
    score: FloatArray = out[SCALED_JACOBIAN]
    return score
