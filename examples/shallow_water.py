"""Shallow water on a mesh that follows the shore as the water sloshes up and down a beach.

    python examples/shallow_water.py [FOLDER]

In each step water flows between cells (first order, Rusanov's flux), the boundary on the beach
moves to where the water is 5 cm deep, the mesh is smoothed, and depth and momentum are taken over
to the cells' new places. Not a drop is lost: `transfer` keeps the sum of depth times area. The last
mesh is written as VTK, with the bed as z.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from qsmooth import Mesh, quality, smooth, transfer, write_mesh

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-"))
GRAVITY, SLOPE, SHORE_DEPTH, STEP, STEPS = 9.81, 0.2, 0.05, 0.01, 160
nx, ny = 30, 12


def beach(y):
    """Where the bed is at the level of still water."""
    return 5.0 + 0.5 * np.cos(np.pi * y)


def bed(xy):
    """Height of the bed over still water."""
    return SLOPE * (xy[:, 0] - beach(xy[:, 1]))


# A channel of quads, from a wall at x = 0 to the beach.
ids = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
share, across = np.meshgrid(np.linspace(0.0, 1.0, nx + 1), np.linspace(0.0, 2.0, ny + 1))
share, across = share.ravel(), across.ravel()
shore = beach(across) - SHORE_DEPTH / SLOPE
quads = np.stack([ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], axis=-1).reshape(-1, 4)
mesh = Mesh(np.stack([share * shore, across], axis=1), quads)
at_shore, at_sides = ids[:, -1], ids[[0, -1]].ravel()
cells = np.arange(len(quads)).reshape(ny, nx)

# The edges never change: their ends, and the cells on their left and right (none: a wall).
ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
owner = np.repeat(np.arange(len(quads)), 4)
order = np.lexsort(np.sort(ends, axis=1).T)
ordered = np.sort(ends, axis=1)[order]
twice = np.flatnonzero((ordered[1:] == ordered[:-1]).all(axis=1))
neighbour = np.full(len(ends), -1)
neighbour[order[twice]], neighbour[order[twice + 1]] = owner[order[twice + 1]], owner[order[twice]]
edges = np.flatnonzero((neighbour < 0) | (owner < neighbour))
first, last, left, right = *ends[edges].T, owner[edges], neighbour[edges]
wall = right < 0
right = np.where(wall, left, right)


def physical_flux(depth, momentum, normal):
    """What crosses an edge of unit length, pressure left out."""
    through = (momentum * normal).sum(axis=1)
    return np.column_stack([through, momentum * (through / depth)[:, None]])


def flow(mesh, state):
    """One step in time on a mesh that stands still; keeps water at rest on any bed."""
    along = mesh.xy[last] - mesh.xy[first]
    length = np.hypot(*along.T)
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    height = bed(mesh.xy[quads].mean(axis=1))
    step = np.maximum(height[left], height[right])
    sides = []
    for side in (left, right):
        depth = np.maximum(1e-6, state[side, 0] + height[side] - step)
        momentum = state[side, 1:] * (depth / state[side, 0])[:, None]
        if side is right:  # a wall reflects what comes
            back = 2.0 * (momentum * normal).sum(axis=1)
            momentum = momentum - np.where(wall, back, 0.0)[:, None] * normal
        sides.append(np.column_stack([depth, momentum]))
    a, b = sides
    speed = np.maximum(
        *(np.hypot(*s[:, 1:].T) / s[:, 0] + np.sqrt(GRAVITY * s[:, 0]) for s in sides)
    )
    crossing = 0.5 * sum(physical_flux(s[:, 0], s[:, 1:], normal) for s in sides)
    crossing -= 0.5 * speed[:, None] * (b - a)
    pressure = 0.25 * GRAVITY * (a[:, 0] ** 2 + b[:, 0] ** 2)
    change = np.zeros_like(state)
    for side, own, sign in ((left, a, -1.0), (right, b, 1.0)):
        push = pressure + 0.5 * GRAVITY * (state[side, 0] ** 2 - own[:, 0] ** 2)
        total = crossing + np.column_stack([np.zeros(len(push)), push[:, None] * normal])
        keep = ~wall if side is right else slice(None)
        np.add.at(change, side[keep], sign * (length[:, None] * total)[keep])
    return state + STEP * change / quality(mesh).area[:, None]


def with_shore(mesh, state):
    """Move the boundary on the beach to where the water gets too shallow, as fast as it may."""
    level = state[cells[:, -1], 0] + bed(mesh.xy[quads[cells[:, -1]]].mean(axis=1))
    at_vertices = 0.5 * (np.append(level[:1], level) + np.append(level, level[-1:]))
    wanted = beach(mesh.xy[at_shore, 1]) + (at_vertices - SHORE_DEPTH) / SLOPE
    points = mesh.points.copy()
    points[at_shore, 0] += np.clip(0.5 * (wanted - points[at_shore, 0]), -0.02, 0.02)
    ends_of_rows = np.repeat(points[at_shore, 0], nx + 1)
    points[at_sides, 0] = (share * ends_of_rows)[at_sides]
    return mesh.with_points(points)


# Depth and momentum of each cell: the water stands higher at the wall.
middles = mesh.xy[quads].mean(axis=1)
state = np.zeros((len(quads), 3))
state[:, 0] = 0.12 * np.cos(np.pi * middles[:, 0] / 5.0) * (middles[:, 0] < 5.0) - bed(middles)
state[:, 0] = np.maximum(state[:, 0], 0.5 * SHORE_DEPTH)
volume = start = (state[:, 0] * quality(mesh).area).sum()

print("  time   shore at      smallest angle   volume")
for number in range(1, STEPS + 1):
    state = flow(mesh, state)
    moved = with_shore(mesh, state)
    smoothed = smooth(moved, max_sweeps=20).mesh
    state = transfer(mesh, smoothed, state, at="cells", conserve=True)
    mesh = smoothed
    if number % 20 == 0:
        now = quality(mesh)
        volume = (state[:, 0] * now.area).sum()
        low, high = mesh.xy[at_shore, 0].min(), mesh.xy[at_shore, 0].max()
        reach, angle = f"{low:.2f} to {high:.2f}", now.min_angle.min()
        print(f"{number * STEP:6.2f}   {reach} {angle:12.1f}°   {volume:.9f}")

print(f"volume changed by {volume / start - 1.0:.1e} of itself")
path = folder / "beach.vtk"
write_mesh(path, Mesh(np.column_stack([mesh.xy, bed(mesh.xy)]), quads, surface="flat"))
print(f"{path}: {mesh.n_cells} quads, invalid: {quality(mesh).n_invalid}")
