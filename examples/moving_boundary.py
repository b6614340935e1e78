"""Keep a mesh good while its boundary moves, as a simulation does at every time step.

    python examples/moving_boundary.py [FOLDER]

A bump rises from the bottom of a channel. Moving only the boundary folds the cells above it over;
smoothed after every step the mesh stays valid. The last mesh is written as VTK.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from qsmooth import Mesh, quality, smooth, write_mesh

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-"))

# Plain arrays, as a solver holds them: 40 by 16 quads in a channel of 3 by 1.
nx, ny = 40, 16
x, y = np.meshgrid(np.linspace(0.0, 3.0, nx + 1), np.linspace(0.0, 1.0, ny + 1))
points = np.stack([x.ravel(), y.ravel()], axis=1)
first = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
quads = np.stack([first, first + 1, first + nx + 2, first + nx + 1], axis=1)

# Made once: what follows from the cells alone is shared by all meshes that `with_points` makes.
mesh = start = Mesh(points, quads)
bottom = np.flatnonzero(points[:, 1] == 0.0)

print(" step  height   smallest angle   largest angle   invalid, and if only the boundary moved")
for step in range(1, 13):
    height = 0.05 * step
    points = mesh.points.copy()
    points[bottom, 1] = height * np.exp(-(((points[bottom, 0] - 1.5) / 0.35) ** 2))
    # The boundary stays where it was put; cells that this has folded over are untangled.
    result = smooth(mesh.with_points(points))
    mesh = result.mesh

    unsmoothed = start.points.copy()
    unsmoothed[bottom] = points[bottom]
    folded = quality(start.with_points(unsmoothed)).n_invalid
    worst = result.after.worst
    print(
        f"{step:5d}  {height:6.2f}   {worst['min_angle']:13.1f}°   {worst['max_angle']:12.1f}°   "
        f"{result.after.n_invalid:7d}, {folded}"
    )

# An array in the shape that came in goes back to the solver.
points = mesh.points
path = folder / "channel.vtk"
write_mesh(path, mesh)
print(f"{path}: {len(points)} vertices")
