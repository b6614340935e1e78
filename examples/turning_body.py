"""Keep the mesh around a body good while the body turns, as a simulation does at every time step.

    python examples/turning_body.py [FOLDER]

A square body turns by 45 degrees in a box, in 200 steps. `Smoother` makes its tables once; a step
then moves the vertices between body and box in place, in a few sweeps. Shown are some of the steps,
with how long each takes; the last mesh is written as VTK.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from qsmooth import Smoother, quality, write_mesh
from qsmooth.examples import around_body

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-"))
steps, turn = 200, np.radians(45.0)

mesh = around_body(45)
body = mesh.is_boundary & (np.abs(mesh.points).max(axis=1) < 0.5)
smoother = Smoother(mesh, threads=1)

points = mesh.points.copy()  # an array of the solver's; steps overwrite it
smoother.step(points)  # makes the tables, and compiles what this machine has not yet seen

print(" step   angle   smallest scaled Jacobian   valid   sweeps      ms")
records, seconds = [], []
for step in range(1, steps + 1):
    angle = turn * step / steps
    cos, sin = np.cos(angle), np.sin(angle)
    points[body] = mesh.points[body] @ np.array([[cos, sin], [-sin, cos]])
    started = time.perf_counter()
    records.append(smoother.step(points))
    seconds.append(time.perf_counter() - started)
    if step % 20 == 0:
        record = records[-1]
        print(
            f"{step:5d}  {np.degrees(angle):5.1f}°   {record.scaled_jacobian:24.3f}   "
            f"{'yes' if record.valid else 'no':>5}   {record.sweeps:6d}   {1e3 * seconds[-1]:5.2f}"
        )

worst = min(record.scaled_jacobian for record in records)
print(
    f"{mesh.n_vertices} vertices, {steps} steps: {1e3 * np.median(seconds):.2f} ms a step, "
    f"valid in all of them: {all(record.valid for record in records)}, "
    f"smallest scaled Jacobian {worst:.3f}"
)

# Now and then the solver may want a report, or more than a few sweeps: that is `smooth`.
result = smoother(points)
print(f"smoothed to the end: smallest scaled Jacobian {result.after.worst['scaled_jacobian']:.3f}")
path = folder / "body.vtk"
write_mesh(path, result.mesh)
print(f"{path}: {quality(result.mesh).n_invalid} invalid cells")
