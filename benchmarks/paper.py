"""The table of the paper "Quadrilateral Mesh Smoothing": 50 sweeps, its own figures beside ours.

    python benchmarks/paper.py --json paper.json

The paper's meshes are not public. `spiral()` and `lake()` are of the same outlines and sizes, and
the spiral is as bad as the paper's. What is known of the paper's own figures are those of its
spiral; on what machine they were taken is not.
"""

import argparse
import json
import statistics
from pathlib import Path

from apart import machine, machine_words, markdown, own_cache, processor_time

SWEEPS, REPEATS = 50, 7
METHODS = ("laplacian", "star", "quad")
HEAD = (
    "mesh", "method", "seconds", "paper's", "largest aspect ratio", "paper's", "mean", "paper's",
    "largest angle", "paper's", "smallest", "paper's",
)  # fmt: skip
FIGURES = ("seconds", "aspect_ratio", "mean_aspect_ratio", "max_angle", "min_angle")
PAPER = {
    ("spiral", "given"): (None, 59.8, 2.61, 180.0, 20.7),
    ("spiral", "laplacian"): (0.004, None, None, None, None),
    ("spiral", "star"): (1.5, 10.3, 1.86, 177.0, 15.9),
    ("spiral", "quad"): (3.6, 10.1, 1.91, 155.0, 18.8),
}


def run(sweeps=SWEEPS, repeats=REPEATS, sizes=(1900, 24_000)):
    """All rows, as plain values."""
    own_cache()
    from qsmooth import examples, quality, smooth

    rows, meshes = [], {"spiral": examples.spiral(sizes[0]), "lake": examples.lake(sizes[1])}
    for name, mesh in meshes.items():
        rows.append(_row(name, "given", mesh, quality(mesh).summary(), None))
        for method in METHODS:
            smooth(mesh, method, max_sweeps=2, threads=1)
            seconds = []
            for _ in range(repeats):
                begin = processor_time()
                result = smooth(mesh, method, max_sweeps=sweeps, rtol=0.0, threads=1)
                seconds.append(processor_time() - begin)
            rows.append(_row(name, method, mesh, result.after, statistics.median(seconds)))
    return {"machine": machine(), "sweeps": sweeps, "rows": rows}


def _row(name, method, mesh, summary, seconds):
    worst = summary.worst
    return {
        "mesh": name,
        "cells": mesh.n_cells,
        "method": method,
        "invalid": summary.n_invalid,
        "seconds": seconds,
        "aspect_ratio": worst["aspect_ratio"],
        "mean_aspect_ratio": summary.mean["aspect_ratio"],
        "max_angle": worst["max_angle"],
        "min_angle": worst["min_angle"],
    }


def lines(found):
    """Rows of the table, as texts: each figure with the paper's beside it."""
    out = []
    for row in found["rows"]:
        theirs = PAPER.get((row["mesh"], row["method"]), (None,) * len(FIGURES))
        line = [f"{row['mesh']}, {row['cells']} quads", row["method"]]
        for key, other in zip(FIGURES, theirs, strict=True):
            line += [_text(key, row[key]), _text(key, other)]
        if row["invalid"]:
            line[1] += f", {row['invalid']} invalid"
        out.append(line)
    return out


def _text(key, value):
    if value is None:
        return ""
    if key == "seconds":
        return f"{value:.3g}"
    return f"{value:.1f}°" if key.endswith("angle") else f"{value:.3g}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--json", type=Path, help="write all figures into this file")
    options = parser.parse_args()
    found = run()
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(markdown(HEAD, lines(found)))
    print("\n" + machine_words(found["machine"]))


if __name__ == "__main__":
    main()
