"""What sliding along the boundary is worth, and how far it takes the outline.

    python studies/sliding.py FILE...                        # these files; else the packaged meshes
    python studies/sliding.py FILE... --tolerance 0 0.01 0.05
    python studies/sliding.py FILE... --method star
    python studies/sliding.py FILE... --plot FOLDER          # the longest slides, before and after

A row for the input, one with the boundary fixed, and one with it sliding for each tolerance:
smallest and largest angle, 99th percentile of the cells' largest angles, largest aspect ratio, mean
shape, how many of the boundary vertices slid, how far an edge is from the old outline at most as a
share of the edge, and seconds of the call, compiled.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import qsmooth
from qsmooth import Mesh, SmoothResult, examples
from qsmooth.metrics import Quality

HEAD = (
    "| mesh | boundary | min ° | max ° | 99 % max ° | aspect | shape | slid | outline | s |\n|"
    + " --- |" * 10
)
PACKAGED = {"spiral": examples.spiral, "lake 2K": lambda: examples.lake(2000)}


def figures(quality: Quality) -> str:
    """Five columns of the table."""
    largest = quality.max_angle
    return (
        f"{quality.min_angle.min():.2f} | {largest.max():.2f} | {np.percentile(largest, 99):.2f} "
        f"| {quality.aspect_ratio.max():.2f} | {quality.shape.mean():.4f}"
    )


def row(name: str, how: str, result: SmoothResult) -> str:
    """One line of the table."""
    told = result.outcome.sliding
    slid = "" if told is None else f"{told.slid} of {told.boundary_vertices}"
    outline = "" if told is None else f"{100.0 * told.deviation_share:.2g} %"
    return (
        f"| {name} | {how} | {figures(result.quality_after)} | {slid} | {outline} "
        f"| {result.seconds:.1f} |"
    )


def plot(path: Path, before: Mesh, after: Mesh) -> None:
    """Draw the places where vertices slid farthest: edges before, grey, and after."""
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    def edges(mesh: Mesh) -> np.ndarray:
        first = np.repeat(np.arange(mesh.n_vertices), np.diff(mesh.ring_offsets))
        return mesh.xy[np.stack([first, mesh.ring_vertices], axis=1)]

    moves = np.linalg.norm(after.xy - before.xy, axis=1) * before.is_boundary
    figure = Figure(figsize=(12, 12))
    for k, v in enumerate(np.argsort(-moves)[:4]):
        axes = figure.add_subplot(2, 2, k + 1)
        size = 8.0 * moves[v]
        axes.add_collection(LineCollection(edges(before), colors="0.7", linewidths=0.8))
        axes.add_collection(LineCollection(edges(after), colors="tab:blue", linewidths=0.8))
        axes.set_xlim(before.xy[v, 0] - size, before.xy[v, 0] + size)
        axes.set_ylim(before.xy[v, 1] - size, before.xy[v, 1] + size)
        axes.set_aspect("equal")
    figure.savefig(path, dpi=110)


def main(argv: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--method", default="optimize")
    parser.add_argument("--tolerance", nargs="+", type=float, default=[0.01])
    parser.add_argument("--plot", type=Path, help="folder for pictures")
    options = parser.parse_args(argv)
    meshes = {path.stem: qsmooth.read_mesh(path, surface="flat") for path in options.files}
    print(HEAD)
    for name, mesh in (meshes or {name: make() for name, make in PACKAGED.items()}).items():
        print(f"| {name} | input | {figures(qsmooth.quality(mesh))} | | | |")
        result = qsmooth.smooth(mesh, options.method, threads=1)
        print(row(name, "fixed", result), flush=True)
        for tolerance in options.tolerance:
            result = qsmooth.smooth(
                mesh, options.method, boundary="slide", outline_tolerance=tolerance, threads=1
            )
            print(row(name, f"slides, {tolerance:g}", result), flush=True)
        if options.plot is not None:
            options.plot.mkdir(parents=True, exist_ok=True)
            plot(options.plot / f"{name}.png", mesh, result.mesh)


if __name__ == "__main__":
    main(sys.argv[1:])
