"""The table of the paper "Quadrilateral Mesh Smoothing": 50 sweeps, its own figures beside ours.

    python benchmarks/paper.py --json paper.json

What is known of the paper's figures, and the meshes in place of its own, are those of `qsmooth
paper`; here times are measured often enough to be published.
"""

import argparse
import json
import statistics
from pathlib import Path

from apart import machine, machine_words, markdown, own_cache, processor_time

REPEATS = 7
HEAD = (
    "mesh", "method", "seconds", "paper's", "largest aspect ratio", "paper's", "mean", "paper's",
    "largest angle", "paper's", "smallest", "paper's",
)  # fmt: skip


def run(sweeps=None, repeats=REPEATS, sizes=(1900, 24_000)):
    """All rows, as plain values."""
    own_cache()
    from qsmooth import examples, quality, smooth
    from qsmooth.paper.runs import GIVEN, METHODS, SWEEPS, row

    sweeps = SWEEPS if sweeps is None else sweeps
    rows, meshes = [], {"spiral": examples.spiral(sizes[0]), "lake": examples.lake(sizes[1])}
    for name, mesh in meshes.items():
        rows.append(row(name, mesh.n_cells, GIVEN, quality(mesh).summary(), None))
        for method in METHODS:
            smooth(mesh, method, max_sweeps=2, threads=1)
            seconds = []
            for _ in range(repeats):
                begin = processor_time()
                result = smooth(mesh, method, max_sweeps=sweeps, rtol=0.0, threads=1)
                seconds.append(processor_time() - begin)
            middle = statistics.median(seconds)
            rows.append(row(name, mesh.n_cells, method, result.after, middle))
    return {"machine": machine(), "sweeps": sweeps, "rows": rows}


def lines(found):
    """Rows of the table, as texts: each figure with the paper's beside it."""
    from qsmooth.paper.runs import COLUMNS, KNOWN, UNKNOWN, text_of

    out = []
    for row in found["rows"]:
        theirs = KNOWN.get((row["mesh"], row["method"]), UNKNOWN)
        line = [f"{row['mesh']}, {row['cells']} quads", row["method"]]
        for column, other in zip(COLUMNS, theirs, strict=True):
            line += [text_of(column, row[column]), text_of(column, other)]
        if row["invalid"]:
            line[1] += f", {row['invalid']} invalid"
        out.append(line)
    return out


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
