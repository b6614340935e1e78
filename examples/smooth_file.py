"""Smooth a mesh file: read it, see how bad it is, smooth, write, see what was gained.

    python examples/smooth_file.py            # writes into a temporary folder
    python examples/smooth_file.py FOLDER     # or here

With a file of your own it is `read_mesh("mine.msh")`; the ending tells the format.
"""

import sys
import tempfile
from pathlib import Path

from qsmooth import limits, quality, read_mesh, smooth, write_mesh
from qsmooth.examples import lake

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-"))
rough, smoothed = folder / "lake.msh", folder / "lake-smoothed.msh"
write_mesh(rough, lake(2000))  # a file to begin with: a lake with islands, as Gmsh's MSH

mesh = read_mesh(rough)
before = quality(mesh).summary()
print(f"{rough.name}: {mesh.n_cells} cells on {mesh.n_vertices} vertices")

# Without a method it untangles if need be, and then optimises. The boundary stays where it is.
result = smooth(mesh)
print(result.reason)

after = result.after
for name, unit in (("min_angle", "°"), ("max_angle", "°"), ("scaled_jacobian", "")):
    print(f"worst {name}: {before.worst[name]:.3f}{unit} -> {after.worst[name]:.3f}{unit}")
print(f"mean shape: {before.mean['shape']:.3f} -> {after.mean['shape']:.3f}")
print(f"invalid cells: {before.n_invalid} -> {after.n_invalid}")

# No placement of the vertices can do better than this; it is why a corner may stay as it was.
print(limits(result.mesh))

# Nothing but coordinates differs from the file that was read.
write_mesh(smoothed, result.mesh)
old, new = rough.read_bytes().splitlines(), smoothed.read_bytes().splitlines()
changed = sum(a != b for a, b in zip(old, new, strict=True))
print(f"{smoothed}: {changed} of {len(new)} lines differ from {rough.name}")
