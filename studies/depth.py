"""How far the sea bed is off after smoothing: depths interpolated, and carried along unchanged.

    python studies/depth.py                   # a lake with a rough bed, made from a seed
    python studies/depth.py a.obj b.vtk       # meshes with a depth as z
    python studies/depth.py --method star a.obj

For each mesh the bed of the smoothed mesh is compared with that of the input, each as its own
cells have it: linear in triangles, bilinear in quads. Sixteen places of each cell are looked at,
and count by area. Last, the same with a linear bed in place of the mesh's own.

What it showed is in docs/methods.md. Interpolated, vertices lie on the input's bed; what is left
lies between them, where the cells cut off its ridges and hollows otherwise than those of the input.
What is carried along is wrong by two to five times as much in the mean.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

from qsmooth import Mesh, quality, read_mesh, smooth
from qsmooth.examples import lake
from qsmooth.remapping import locate

FloatArray = npt.NDArray[np.float64]

# Places in the unit square: four by four, away from edges.
PLACES = [(s, t) for s in (0.1, 0.4, 0.6, 0.9) for t in (0.1, 0.4, 0.6, 0.9)]


def rough_lake() -> Mesh:
    """A lake of 5K quads with hills and hollows of a few cells' size."""
    mesh = lake(5000)
    low, size = mesh.xy.min(axis=0), np.ptp(mesh.xy, axis=0).max()
    x, y = ((mesh.xy - low) / size).T
    z = -10.0 * np.sin(11.0 * x) * np.cos(7.0 * y) - 3.0 * np.sin(60.0 * x + 40.0 * y)
    return Mesh(np.column_stack([mesh.xy, z]), mesh.cells, surface="flat")


def shape_functions(n_corners: int, s: float, t: float) -> FloatArray:
    """Weights of the corners at a place of the unit square, folded into a triangle."""
    if n_corners == 3:
        s, t = (1.0 - s, 1.0 - t) if s + t > 1.0 else (s, t)
        return np.array([1.0 - s - t, s, t])
    return np.array([(1.0 - s) * (1.0 - t), s * (1.0 - t), s * t, (1.0 - s) * t])


def bed_errors(old: Mesh, new: Mesh) -> tuple[float, float]:
    """Largest error of the new bed against the old one, and the root of its mean square."""
    places, depths, weights, starts = [], [], [], []
    areas, offset = quality(new).area, 0
    for block in new.cells:
        cells = np.arange(offset, offset + len(block))
        offset += len(block)
        for place in PLACES:
            shape = shape_functions(block.shape[1], *place)
            places.append((shape[:, None] * new.xy[block]).sum(axis=1))
            depths.append((shape * new.points[block, 2]).sum(axis=1))
            weights.append(areas[cells])
            starts.append(cells)
    at = np.concatenate(places)
    found = locate(old, at, np.concatenate(starts), at)
    depth = (found.weights * old.points[found.corners, 2]).sum(axis=1)
    error, weight = np.concatenate(depths) - depth, np.concatenate(weights)
    return float(np.abs(error).max()), float(np.sqrt((weight * error**2).sum() / weight.sum()))


def study(name: str, mesh: Mesh, method: str) -> None:
    """Print the errors for one mesh."""
    runs = {carry: smooth(mesh, method, carry=carry) for carry in ("interpolate", "keep")}
    z = mesh.points[:, 2]
    moves = np.hypot(*(runs["keep"].mesh.xy - mesh.xy).T)
    print(f"{name}: {mesh.n_cells} cells, depth {z.min():.4g} to {z.max():.4g}")
    print(f"  {(moves > 0.0).sum()} vertices moved, by up to {moves.max():.3g}")
    for carry, result in runs.items():
        largest, rms = bed_errors(mesh, result.mesh)
        print(f"  {carry:11}: bed off by up to {largest:.4g}, root mean square {rms:.3g}")
    record = runs["interpolate"].outcome.carried[0]
    print(f"  at vertices: up to {record.largest:.4g}, root mean square {record.rms:.3g}, if kept")
    bed = 3.0 + mesh.xy @ np.array([0.01, -0.02])
    plane = Mesh(np.column_stack([mesh.xy, bed]), mesh.cells, surface="flat")
    smoothed = smooth(plane, method).points
    error = np.abs(smoothed[:, 2] - 3.0 - smoothed[:, :2] @ np.array([0.01, -0.02])).max()
    print(f"  a linear bed from {bed.min():.4g} to {bed.max():.4g}: off by up to {error:.2g}")


def main(arguments: list[str]) -> None:
    """Print the errors for each mesh."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("meshes", nargs="*", type=Path)
    parser.add_argument("--method", default="optimize")
    chosen = parser.parse_args(arguments)
    if not chosen.meshes:
        study("a lake", rough_lake(), chosen.method)
    for path in chosen.meshes:
        study(path.name, read_mesh(path, surface="flat"), chosen.method)


if __name__ == "__main__":
    main(sys.argv[1:])
