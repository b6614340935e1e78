"""What the optimiser makes of many meshes: angles, ratios, edges, areas, heights of layers, time.

    python studies/before_after.py FILE...                  # these files and the packaged meshes
    python studies/before_after.py FILE... --other SRC      # beside another version's src folder
    python studies/before_after.py FILE... --shake 1e-7     # each also with its vertices shaken

Meshes that can't be read, are invalid, or have no vertex to move are left out. Each version runs
in a process of its own, on one thread, after a short run that compiles. For each mesh a row for the
input (in), one for this version (new), and for the other (old), all measured here:

* smallest and largest angle, largest aspect ratio (longest over shortest edge of a cell), smallest
  and mean scaled Jacobian, mean shape;
* shortest edge over the input's; areas over the input's, 1st, 50th and 99th percentile;
* heights of first layers over the input's, least, median and most: a side on the boundary is of a
  first layer where, in the input, it is more than 5 times as long as its cell is high, which is the
  mean distance of the cell's other vertices from the side's line;
* seconds of the call.

A shaken mesh (every free vertex moved by up to so much of its shortest edge in x and y) is
compared with the mesh that was shaken, not with itself. After the table: what became worse than the
input in a held figure, in the aspect ratio, mean shape or mean scaled Jacobian; what came back as
it was; and figures that --shake changes by more than 1 %.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import qsmooth
from qsmooth import Mesh, examples, quality, read_mesh

SLIM = 5.0
COLUMNS = (
    "mesh", "", "min °", "max °", "aspect", "SJ min", "SJ mean", "shape", "edge ×",
    "areas × 1/50/99 %", "heights × least/median/most", "s",
)  # fmt: skip
PACKAGED = {
    "jittered": lambda: examples.jittered(),
    "jittered triangles": lambda: examples.jittered(kind="triangle"),
    "jittered mixed": lambda: examples.jittered(kind="mixed"),
    "bump 60": lambda: examples.bump(60, height=0.8, width=0.1),
    "bump 200": lambda: examples.bump(200),
    "notch": lambda: examples.notch(),
    "notch triangles": lambda: examples.notch(kind="triangle"),
    "notch mixed": lambda: examples.notch(kind="mixed"),
    "distorted 0": lambda: examples.distorted(64, 0),
    "distorted 1": lambda: examples.distorted(64, 1),
    "boundary_layer": lambda: examples.boundary_layer(),
    "boundary_layer triangles": lambda: examples.boundary_layer(kind="triangle"),
    "random_triangles": lambda: examples.random_triangles(),
    "simple_case": lambda: examples.simple_case(),
    "spiral": lambda: examples.spiral(),
    "lake 2K": lambda: examples.lake(2000),
}


def blocks(mesh):
    """Cells as arrays, turned to run alike: [(m, 3), (m, 4)], those there are."""
    topology = mesh.topology
    out = []
    for size in (3, 4):
        first = topology.cell_offsets[:-1][topology.cell_sizes == size]
        if first.size:
            out.append(topology.cell_vertices[first[:, None] + np.arange(size)])
    return out


def areas(xy, cells):
    """Area of each cell."""
    shifted = [(xy[c], xy[np.roll(c, -1, 1)]) for c in cells]
    return np.concatenate(
        [0.5 * np.abs((a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(1)) for a, b in shifted]
    )


def first_layers(xy, cells):
    """Length of each boundary side, and height of its cell over it."""
    sides = np.concatenate([np.stack([c, np.roll(c, -1, 1)], -1).reshape(-1, 2) for c in cells])
    _, which, counts = np.unique(np.sort(sides, 1), axis=0, return_inverse=True, return_counts=True)
    alone = counts[which.ravel()] == 1
    lengths, heights, start = [], [], 0
    for c in cells:
        n = c.shape[1]
        k, i = np.nonzero(alone[start : start + c.size].reshape(c.shape))
        start += c.size
        a = xy[c[k, i]]
        side = xy[c[k, (i + 1) % n]] - a
        length = np.hypot(*side.T)
        others = [xy[c[k, (i + j) % n]] - a for j in range(2, n)]
        away = [np.abs(side[:, 0] * o[:, 1] - side[:, 1] * o[:, 0]) for o in others]
        lengths.append(length)
        heights.append(np.mean(away, axis=0) / np.maximum(length, 1e-300))
    return np.concatenate(lengths), np.concatenate(heights)


def figures(mesh, xy, base):
    """All figures of these coordinates, sizes as multiples of those at `base`."""
    q = quality(mesh.with_xy(xy, np.ones(mesh.n_vertices, bool)))
    at_base = quality(mesh.with_xy(base, np.ones(mesh.n_vertices, bool)))
    summary, cells = q.summary(), blocks(mesh)
    area = np.percentile(areas(xy, cells) / areas(base, cells), (1, 50, 99))
    length, height = first_layers(base, cells)
    slim = length > SLIM * height
    layer = first_layers(xy, cells)[1][slim] / height[slim]
    return {
        "min_angle": summary.worst["min_angle"],
        "max_angle": summary.worst["max_angle"],
        "aspect": summary.worst["aspect_ratio"],
        "sj": summary.worst["scaled_jacobian"],
        "sj_mean": summary.mean["scaled_jacobian"],
        "shape": summary.mean["shape"],
        "edge": q["min_edge"].min() / at_base["min_edge"].min(),
        **dict(zip(("area_1", "area_50", "area_99"), area, strict=True)),
        "heights": (layer.min(), np.median(layer), layer.max()) if layer.size else None,
    }


def row(name, which, f, seconds):
    """A line of the table."""
    height = "-" if f["heights"] is None else " / ".join(f"{x:.3f}" for x in f["heights"])
    areas = " / ".join(f"{f[key]:.2f}" for key in ("area_1", "area_50", "area_99"))
    values = (
        name, which, f"{f['min_angle']:.2f}", f"{f['max_angle']:.2f}", f"{f['aspect']:.4g}",
        f"{f['sj']:.4f}", f"{f['sj_mean']:.4f}", f"{f['shape']:.4f}", f"{f['edge']:.3f}", areas,
        height, seconds,
    )  # fmt: skip
    return "| " + " | ".join(values) + " |"


def shaken(mesh, amount, seed=3):
    """Coordinates with every free vertex moved by up to so much of its shortest edge."""
    xy, shortest = mesh.xy, np.full(mesh.n_vertices, np.inf)
    for c in blocks(mesh):
        for i in range(c.shape[1]):
            length = np.hypot(*(xy[c[:, i]] - xy[c[:, i - 1]]).T)
            np.minimum.at(shortest, c[:, i], length)
            np.minimum.at(shortest, c[:, i - 1], length)
    shortest[mesh.is_fixed] = 0.0
    moves = np.random.default_rng(seed).uniform(-amount, amount, (mesh.n_vertices, 2))
    return xy + moves * shortest[:, None]


def flat(mesh, xy):
    """The same mesh in its plane: what every version can be given."""
    return Mesh(xy, mesh.cells, fixed=mesh.is_fixed, regions=mesh.regions)


def collect(files, only):
    """Meshes by name, those that can be optimised."""
    makers = {Path(f).name: lambda f=f: read_mesh(f, surface="flat") for f in files} | PACKAGED
    out = {}
    for name, make in makers.items():
        if only and not any(word in name for word in only):
            continue
        try:
            mesh = make()
        except (qsmooth.MeshError, ValueError, OSError) as error:
            print(f"{name}: left out: {str(error).splitlines()[0]}", file=sys.stderr)
            continue
        mesh = flat(mesh, mesh.xy)
        if quality(mesh).n_invalid or mesh.is_fixed.all():
            print(f"{name}: left out: invalid, or nothing moves", file=sys.stderr)
            continue
        out[name] = mesh
    return out


def run_all(folder, repeat):
    """What a version's process does: smooth each mesh of the folder, and write what comes out."""
    for path in sorted(Path(folder).glob("in-*.npz")):
        data = np.load(path)
        cells = [data[key] for key in sorted(data) if key.startswith("cells")]
        regions = data.get("regions")
        mesh = Mesh(data["xy"], cells, fixed=data["fixed"], regions=regions)
        qsmooth.smooth(mesh, "optimize", max_sweeps=30, threads=1)
        seconds = []
        for _ in range(repeat):
            start = time.perf_counter()
            result = qsmooth.smooth(mesh, "optimize", threads=1)
            seconds.append(time.perf_counter() - start)
        out = path.with_name(path.name.replace("in-", "out-"))
        np.savez(out, xy=result.mesh.xy, seconds=min(seconds))


def smoothed(meshes, source, cache, repeat):
    """Coordinates and seconds of each mesh by the version in that folder."""
    with tempfile.TemporaryDirectory() as folder:
        for k, mesh in enumerate(meshes):
            cells = {f"cells{i}": block for i, block in enumerate(mesh.cells)}
            if mesh.regions is not None:
                cells["regions"] = mesh.regions
            path = Path(folder) / f"in-{k:03d}.npz"
            np.savez(path, xy=mesh.xy, fixed=mesh.is_fixed, **cells)
        environment = os.environ | {"PYTHONPATH": str(source), "NUMBA_CACHE_DIR": str(cache)}
        command = [sys.executable, __file__, "--run", folder, "--repeat", str(repeat)]
        subprocess.run(command, check=True, env=environment)
        out = [np.load(Path(folder) / f"out-{k:03d}.npz") for k in range(len(meshes))]
        return [(data["xy"], float(data["seconds"])) for data in out]


def remarks(name, before, after, unchanged):
    """What is worse than before, or unchanged."""
    worse = {
        "smallest angle": before["min_angle"] - after["min_angle"] > 1e-9 * before["min_angle"],
        "largest angle": after["max_angle"] - before["max_angle"] > 1e-9 * before["max_angle"],
        "scaled Jacobian": before["sj"] - after["sj"] > 1e-9 * before["sj"],
    }
    out = [f"{name}: HELD {what} worse" for what, is_worse in worse.items() if is_worse]
    if after["aspect"] > before["aspect"] * 1.005:
        out.append(f"{name}: aspect ratio {before['aspect']:.4g} -> {after['aspect']:.4g}")
    for key, words in (("shape", "mean shape"), ("sj_mean", "mean scaled Jacobian")):
        if after[key] < before[key] - 5e-4:
            out.append(f"{name}: {words} {before[key]:.4f} -> {after[key]:.4f}")
    if unchanged:
        out.append(f"{name}: unchanged")
    return out


def moved_figures(name, one, two):
    """Figures that differ by more than 1 %."""
    out = []
    for key, value in one.items():
        if key != "heights" and abs(two[key] / value - 1.0) > 0.01:
            out.append(f"{name}: {key} {value:.4g}, shaken {two[key]:.4g}")
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*")
    parser.add_argument("--other", help="src folder of the version to compare with")
    parser.add_argument("--shake", type=float, help="also with every vertex moved by so much")
    parser.add_argument("--only", nargs="*", help="meshes whose name contains one of these")
    parser.add_argument("--cache", default=None, help="where compiled code of each version goes")
    parser.add_argument(
        "--repeat", type=int, default=1, help="runs, of which the least time counts"
    )
    parser.add_argument("--run", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        run_all(options.run, options.repeat)
        return
    meshes = collect(options.files, options.only)
    cache = Path(options.cache or tempfile.mkdtemp())
    own = Path(qsmooth.__file__).parents[1]
    given = list(meshes.values())
    runs = {"new": smoothed(given, own, cache / "new", options.repeat)}
    if options.other:
        runs["old"] = smoothed(given, options.other, cache / "old", options.repeat)
    if options.shake:
        moved = [flat(mesh, shaken(mesh, options.shake)) for mesh in given]
        runs["shaken"] = smoothed(moved, own, cache / "new", 1)
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    notes = []
    for k, (name, mesh) in enumerate(meshes.items()):
        before = figures(mesh, mesh.xy, mesh.xy)
        print(row(f"{name} ({mesh.n_cells})", "in", before, ""))
        found = {}
        for which, results in runs.items():
            xy, seconds = results[k]
            found[which] = figures(mesh, xy, mesh.xy)
            print(row("", which, found[which], f"{seconds:.2f}"), flush=True)
            if which != "shaken":
                same = np.array_equal(xy, mesh.xy)
                notes += remarks(f"{which}: {name}", before, found[which], same)
        if "shaken" in found:
            notes += moved_figures(name, found["new"], found["shaken"])
    print()
    print("\n".join(f"- {note}" for note in sorted(notes)))


if __name__ == "__main__":
    main()
