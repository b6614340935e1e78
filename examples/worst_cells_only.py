"""Mend only the cells that need it, and see which method does it best.

    python examples/worst_cells_only.py [FOLDER]

Only the vertices of cells with an angle over 160° may move, and those of the cells that touch
them by half of their shortest edge; all else keeps its coordinates to the last bit. Writes a table
of the methods as CSV.
"""

import csv
import sys
import tempfile
from pathlib import Path

from qsmooth import quality, smooth
from qsmooth.examples import lake

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-"))
mesh = lake(2000, jitter=0.0)
bad = quality(mesh).max_angle > 160.0
print(f"{bad.sum()} of {mesh.n_cells} cells have an angle over 160°")

rows = []
for method in ("laplacian", "smart-laplacian", "star", "quad", "optimize"):
    # A threshold on any figure of `quality`; ids of cells or a mask do as well.
    result = smooth(mesh, method, selection="max_angle > 160", selection_rings=1)
    angles = quality(result.mesh).max_angle
    rows.append(
        {
            "method": method,
            "cells over 160°": int((angles > 160.0).sum()),
            "their largest": round(float(angles[bad].max()), 1),
            "mean shape": round(result.after.mean["shape"], 3),
            "invalid cells": result.after.n_invalid,
            "vertices moved": int((result.points != mesh.points).any(axis=1).sum()),
            "seconds": round(result.seconds, 3),
        }
    )

print("  ".join(f"{name:>15}" for name in rows[0]))
for row in rows:
    print("  ".join(f"{value!s:>15}" for value in row.values()))

path = folder / "methods.csv"
with path.open("w", newline="", encoding="utf-8") as file:
    writer = csv.DictWriter(file, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)

# `laplacian` guards nothing: a mesh that it breaks is no candidate, however good its other cells.
valid = [row for row in rows if row["invalid cells"] == 0]
best = min(valid, key=lambda row: (row["cells over 160°"], row["their largest"]))
print(f"{path}: best is {best['method']}")
