"""What `"auto"` finds in meshes, and the gaps that the constants of `qsmooth.targets` lie in.

    python studies/targets.py [FILE ...]

prints, for generated meshes and the given files, as they are and with every free vertex moved by
up to .35 of its shortest edge: the share of layers and of cells whose size counts; how the height
that the targets ask of layers compares with that of the mesh before it was shaken (1st percentile,
median, 99th); and the figures that decide, over the links that are stretched five times or more
(regularity of the worst 1 %, median scatter), or for triangles the trend of areas over their noise.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from qsmooth import Mesh, read_mesh
from qsmooth._types import FloatArray
from qsmooth.examples import boundary_layer, bump, distorted, lake, notch, random_triangles, spiral
from qsmooth.targets import Sheets, candidates
from qsmooth.targets.sheets import LAYER_STRETCH, LAYER_WINDOW
from qsmooth.targets.sizes import AREA_RINGS, over_rings

MESHES = {
    "boundary_layer()": boundary_layer,
    "boundary_layer, triangles": lambda: boundary_layer(kind="triangle"),
    "notch()": notch,
    "bump(60)": lambda: bump(60, height=0.8, width=0.1),
    "distorted()": distorted,
    "spiral()": spiral,
    "lake()": lake,
    "random_triangles()": random_triangles,
}
SHAKE = 0.35


def shaken(mesh: Mesh) -> Mesh:
    """Move free vertices at random; cells may invert."""
    offsets, ring = mesh.topology.rings
    used = np.flatnonzero(np.diff(offsets) > 0)
    ends = mesh.xy[ring] - np.repeat(mesh.xy, np.diff(offsets), axis=0)
    shortest = np.zeros(mesh.n_vertices)
    shortest[used] = np.minimum.reduceat(np.hypot(*ends.T), offsets[:-1][used])
    moves = np.random.default_rng(3).uniform(-SHAKE, SHAKE, mesh.xy.shape) * shortest[:, None]
    return mesh.with_xy(mesh.xy + moves, ~mesh.is_fixed)


def log_areas(mesh: Mesh) -> FloatArray:
    """Log of twice the area of each cell; of nothing where it is not positive."""
    top = mesh.topology
    x, y = mesh.xy[top.cell_vertices].T
    after = np.arange(x.size) + 1
    after[top.cell_offsets[1:] - 1] = top.cell_offsets[:-1]
    twice = np.add.reduceat(x * y[after] - y * x[after], top.cell_offsets[:-1])
    return np.asarray(np.log(np.maximum(twice, 1e-30 * twice.max())))


def line(mesh: Mesh, given: Mesh) -> str:
    """What is found in a mesh, `given` before it was shaken."""
    start = time.perf_counter()
    found, ratios = candidates(mesh.topology, mesh.xy)
    text = f"{1e3 * (time.perf_counter() - start):4.0f} ms  {ratios.kind:8s}"
    text += f" layers {found.is_layer.mean():5.3f}  size {(found.size_weight > 0).mean():5.3f}"
    quads = found.is_layer & (mesh.topology.cell_sizes == 4)
    if quads.any():
        left = np.exp(np.log(2.0 * found.area[quads]) - log_areas(given)[quads])
        text += "  areas × " + " ".join(f"{v:.2f}" for v in np.percentile(left, [1, 50, 99]))
    sheets = Sheets(mesh.topology, mesh.xy)
    stretch, _ = sheets.fit(sheets.along - sheets.height, LAYER_WINDOW, 0)
    slim = stretch > LAYER_STRETCH[0]
    if slim.any():
        sine, _ = sheets.fit(np.repeat(sheets.sine, 2), LAYER_WINDOW, 0)
        _, square = sheets.fit(sheets.height, 3, 2)
        worst, scatter = np.percentile(sine[slim], 1), np.sqrt(np.median(square[slim]))
        text += f"  slim {slim.mean():.2f}: sine {worst:.2f} scatter {scatter:.3f}"
    triangles = mesh.topology.cell_sizes == 3
    if triangles.any():
        areas = log_areas(mesh)
        smooth = over_rings(mesh.topology, areas[:, None], AREA_RINGS)[:, 0]
        noise = np.sqrt(np.mean((areas - smooth)[triangles] ** 2))
        text += f"  trend {smooth[triangles].std():.2f} noise {noise:.2f}"
    return text


def main(files: list[str]) -> None:
    """Print the lines."""
    meshes = {name: make() for name, make in MESHES.items()}
    for file in files:
        name = Path(file)
        meshes[name.name] = read_mesh(name, surface="flat" if name.suffix == ".obj" else "auto")
    for name, mesh in meshes.items():
        print(f"{name:28s} {line(mesh, mesh)}", flush=True)
        print(f"{'  shaken':28s} {line(shaken(mesh), mesh)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
