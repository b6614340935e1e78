"""Meshes for comparisons with other programs, from a formula and a seed, and how they are judged.

A mesh is an array of points, (n, 2), and one of cells, (m, 4) or (m, 3), counter-clockwise. What
quality is does not come from qsmooth: one piece of plain code measures what all programs made.
"""

import math
from typing import NamedTuple

import numpy as np

MESHES = ("square", "tangled", "random", "notch", "fold", "lake", "triangles")
SIZES = {"2k": 2000, "24k": 24_000}
# A peak of 70 % of the height, as narrow as to fold the limit of Laplacian smoothing.
PEAK, WIDTH = 0.7, 0.13
# Random moves are taken back until every corner has a sine of this much.
LEAST_SINE = 0.02


def make(name, size):
    """Points and cells of one of `MESHES`, of about `size` cells."""
    from qsmooth import examples

    n = max(4, round(math.sqrt(size)))
    if name == "square":
        mesh = examples.jittered(n, n, seed=1)
    elif name == "tangled":
        mesh = examples.tangled(n, n, amount=1.0, seed=1)
    elif name == "random":
        mesh = examples.random_interior(n, n, seed=1)
    elif name == "lake":
        mesh = examples.lake(max(1000, size))
    elif name == "triangles":
        mesh = examples.random_triangles(2 * (size // 2), seed=1)
    else:
        mesh = _over_a_peak(n)
        points = _harmonic(mesh) if name == "fold" else _shaken(mesh)
        mesh = mesh.with_points(points)
    width = 3 if name == "triangles" else 4
    return mesh.points, mesh.cell_vertices.reshape(-1, width)


def _over_a_peak(n):
    """A square of n by n quads with a deep smooth peak in its bottom."""
    from qsmooth import examples

    mesh = examples.structured(n, n)
    x, y = mesh.points.T

    def height(x):
        return PEAK * np.exp(-(((x - 0.5) / WIDTH) ** 2))

    low = height(x) - height(0.0)
    return mesh.with_points(np.stack([x, low + (1.0 - low) * y], axis=1))


def _shaken(mesh):
    """Points with the interior vertices moved at random, as far as every cell stays valid."""
    cells = mesh.cell_vertices.reshape(-1, 4)
    sides = mesh.points[np.roll(cells, -1, axis=1)] - mesh.points[cells]
    lengths = np.hypot(sides[..., 0], sides[..., 1])
    shortest = np.full(mesh.n_vertices, np.inf)
    for corners in (cells, np.roll(cells, -1, axis=1)):
        np.minimum.at(shortest, corners, lengths)
    moves = np.random.default_rng(8).uniform(-0.4, 0.4, mesh.points.shape) * shortest[:, None]
    moves[mesh.is_boundary] = 0.0
    for _ in range(60):
        _, _, sines = _corners(mesh.points + moves, cells)
        bad = sines.min(axis=1) < LEAST_SINE
        if not bad.any():
            break
        moves[cells[bad]] *= 0.5
    return mesh.points + moves


def _harmonic(mesh):
    """Points with every interior vertex at the mean of its neighbours: folded at the peak."""
    from scipy.sparse import csr_matrix, diags
    from scipy.sparse.linalg import spsolve

    n, (offsets, neighbours) = mesh.n_vertices, mesh.topology.rings
    ring = csr_matrix((np.ones(offsets[-1]), neighbours, offsets), shape=(n, n))
    matrix = (diags(np.diff(offsets).astype(float)) - ring).tocsr()[~mesh.is_boundary]
    points = mesh.points.copy()
    right = -matrix[:, mesh.is_boundary] @ points[mesh.is_boundary]
    points[~mesh.is_boundary] = spsolve(matrix[:, ~mesh.is_boundary].tocsc(), right)
    return points


def edges(cells):
    """Each edge once, (e, 2)."""
    return np.unique(np.sort(_sides(cells), axis=1), axis=0)


def boundary(cells, n):
    """Mask of the vertices on an edge with only one cell."""
    mask = np.zeros(n, bool)
    mask[_boundary_sides(cells).ravel()] = True
    return mask


def boundary_loops(points, cells):
    """Closed loops of boundary vertices, that round all the others first."""
    after = dict(_boundary_sides(cells).tolist())
    loops = []
    while after:
        loop = [next(iter(after))]
        while (following := after.pop(loop[-1])) != loop[0]:
            loop.append(following)
        loops.append(loop)
    return sorted(loops, key=lambda loop: -float(np.ptp(points[loop], axis=0).prod()))


def _sides(cells):
    return np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)


def _boundary_sides(cells):
    """Sides with one cell, as they run in it."""
    sides = _sides(cells)
    _, inverse, counts = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return sides[counts[inverse.ravel()] == 1]


class Figures(NamedTuple):
    """Smallest angle in degrees, scaled Jacobians, mean shape, cells with a corner not convex."""

    angle: float
    worst: float
    mean: float
    shape: float
    invalid: int


def measure(points, cells):
    """Figures of a mesh; the shape of an invalid cell is 0."""
    det, dot, sines = _corners(points, cells)
    triangles = cells.shape[1] == 3
    scaled = sines.min(axis=1) * (2.0 / math.sqrt(3.0) if triangles else 1.0)
    invalid = ~(det > 0.0).all(axis=1)
    return Figures(
        angle=float((np.degrees(np.arctan2(det, dot)) % 360.0).min()),
        worst=float(scaled.min()),
        mean=float(scaled.mean()),
        shape=float(np.where(invalid, 0.0, _shapes(points, cells, det)).mean()),
        invalid=int(invalid.sum()),
    )


def _corners(points, cells):
    """Determinant, product and sine of the two edges at each corner."""
    u = points[np.roll(cells, -1, axis=1)] - points[cells]
    w = points[np.roll(cells, 1, axis=1)] - points[cells]
    det = u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        sines = det / np.sqrt((u * u).sum(axis=-1) * (w * w).sum(axis=-1))
    return det, (u * w).sum(axis=-1), sines


def _shapes(points, cells, det):
    """Shape as in VTK's verdict: of a quad that of its worst corner, 1 for a square."""
    sides = points[np.roll(cells, -1, axis=1)] - points[cells]
    squares = (sides * sides).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        if cells.shape[1] == 3:
            return 2.0 * math.sqrt(3.0) * det[:, 0] / squares.sum(axis=1)
        return (2.0 * det / (squares + np.roll(squares, 1, axis=1))).min(axis=1)
