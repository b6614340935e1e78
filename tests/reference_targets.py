"""Targets by their definition, and meshes that ask for some."""

import numpy as np
import pytest

import meshes
from qsmooth import Mesh
from qsmooth.targets import learned

GROWTH = 1.3


def auto(mesh):
    return learned(mesh.topology, mesh.xy)


def energies(mesh, targets):
    """Energy f at each corner, and τ, by the definition."""
    top = mesh.topology
    f, tau = np.empty(top.cell_vertices.size), np.empty(top.cell_vertices.size)
    for c in range(top.n_cells):
        first, n = top.cell_offsets[c], top.cell_sizes[c]
        root = np.eye(2)
        if targets.maps is not None:
            xx, xy, yy = targets.maps[c]
            root = np.array([[xx, xy], [xy, yy]])
            assert np.linalg.det(root) == pytest.approx(1.0)
        p = mesh.xy[top.cell_vertices[first : first + n]]
        for i in range(n):
            u, w = root @ (p[(i + 1) % n] - p[i]), root @ (p[i - 1] - p[i])
            m11, m12, m22 = targets.corners[first + i]
            det = u[0] * w[1] - u[1] * w[0]
            f[first + i] = (m11 * u @ u + 2 * m12 * u @ w + m22 * w @ w) / (2 * det)
            tau[first + i] = det / targets.area[c]
    return f, tau


def unit(targets):
    m11, m12, m22 = targets.corners.T
    return m11 * m22 - m12**2


def layer(nx=12, ny=10, first=1e-3, kind="quad"):
    """A graded rectangle: layers of heights that grow by `GROWTH`, of length 1."""
    y, x = np.meshgrid(np.arange(ny + 1.0), np.arange(nx + 1.0), indexing="ij")
    points = np.stack([x.ravel(), first * (GROWTH ** y.ravel() - 1) / (GROWTH - 1)], axis=1)
    _, (quads,) = meshes.grid(nx, ny)
    cells = meshes.split(quads, np.ones(len(quads), bool)) if kind == "triangle" else quads
    return Mesh(points, cells)


def shaken(mesh, amount, seed=3):
    """Every free vertex moved by up to so much of its shortest edge; see `peers/sizes.py`."""
    offsets, ring = mesh.topology.rings
    ends = mesh.xy[ring] - np.repeat(mesh.xy, np.diff(offsets), axis=0)
    shortest = np.minimum.reduceat(np.hypot(*ends.T), offsets[:-1])
    moves = np.random.default_rng(seed).uniform(-amount, amount, mesh.xy.shape)
    return mesh.with_xy(mesh.xy + moves * shortest[:, None], ~mesh.is_fixed)


def ring(n=48, ny=14, first=1e-3, kind="quad"):
    """Layers round a circle: an O-grid, whose sheets along the wall are closed."""
    radii = 1.0 + first * (GROWTH ** np.arange(ny + 1.0) - 1) / (GROWTH - 1)
    angles = 2.0 * np.pi * np.arange(n) / n
    points = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    row, i = np.arange(ny)[:, None] * n, np.arange(n)
    after = (i + 1) % n
    quads = np.stack([row + i, row + n + i, row + n + after, row + after], axis=-1).reshape(-1, 4)
    cells = meshes.split(quads, np.ones(len(quads), bool)) if kind == "triangle" else quads
    return Mesh(points.reshape(-1, 2), cells)


def first_heights(mesh, xy):
    """Heights of the first layers' quads or triangles over the boundary, and which are slim."""
    heights, slim, top = [], [], mesh.topology
    for size in (3, 4):
        first = top.cell_offsets[:-1][top.cell_sizes == size]
        places = first[:, None] + np.arange(size)
        rows, k = np.nonzero(top.twins[places] < 0)
        p = [xy[top.cell_vertices[places[rows, (k + j) % size]]] for j in range(size)]
        side = p[1] - p[0]
        length = np.hypot(*side.T)
        off = [np.abs(side[:, 0] * (q - p[0])[:, 1] - side[:, 1] * (q - p[0])[:, 0]) for q in p[2:]]
        heights.append(np.mean(off, axis=0) / length)
        slim.append(length > 5.0 * heights[-1])
    return np.concatenate(heights), np.concatenate(slim)
