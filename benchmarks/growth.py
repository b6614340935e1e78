"""Time and memory a quad from ten thousand quads to a million, or to ten millions with --full.

    python benchmarks/growth.py --json growth.json --plot growth.png
    python benchmarks/growth.py --full                 # needs 13 GB

Each row has a process of its own, after a small mesh: it makes the `Mesh`, smooths it, and sums up
before and after. Grids whose vertices are moved at random get ten sweeps of star, or the optimiser
for a minute at most; over a steep bump, where a whole region has to move, for five, by the clock.
Seconds are of processor time, on one thread. Bytes a quad are the peak of the process above
what it had before the arrays were read, the caller's 48 bytes a quad among them.
"""

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path

import numpy as np

from apart import (
    answer,
    ask,
    free_memory,
    machine,
    machine_words,
    markdown,
    own_cache,
    processor_time,
    resource,
)

SIZES, LARGEST = (10_000, 100_000, 1_000_000), 10_000_000
BUMPS, LARGEST_BUMP = (24_000, 250_000), 1_000_000
SWEEPS, TIME_LIMIT, BUMP_LIMIT = 10, 60.0, 300.0
WORK = {
    "star": ("star", {"max_sweeps": SWEEPS, "rtol": 0.0}),
    "optimize": ("optimize", {"time_limit": TIME_LIMIT}),
    "bump": ("optimize", {"time_limit": BUMP_LIMIT}),
}
# What a process may take besides smoothing: making and reading the mesh, compiling.
MORE = 300.0
# Left to others: where there is no more than this, a process ends instead of pressing them out.
LEFT_FREE = 2e9
HEAD = (
    "work", "quads", "sweeps", "Mesh, s", "smooth, s", "both reports, s", "smooth, ns a quad",
    "peak, bytes a quad", "peak, GB", "stopped",
)  # fmt: skip


# ------------------------------------------------------------------------------- a process


def rough_grid(n):
    """Points and cells of n by n unit squares, every inner vertex moved at random."""
    points = np.empty((n + 1, n + 1, 2))
    points[..., 0], points[..., 1] = np.arange(n + 1.0), np.arange(n + 1.0)[:, None]
    inner = points[1:-1, 1:-1]
    inner += np.random.default_rng(0).uniform(-0.2, 0.2, inner.shape)
    ids = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    corners = ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]
    return points.reshape(-1, 2), np.stack(corners, axis=-1).reshape(-1, 4)


def make(work, quads, folder):
    """Write the arrays of a mesh."""
    n = round(math.sqrt(quads))
    if work == "bump":
        from qsmooth.examples import bump

        mesh = bump(n)
        points, cells = mesh.points, mesh.cell_vertices.reshape(-1, 4)
    else:
        points, cells = rough_grid(n)
    np.save(f"{folder}/points.npy", points)
    np.save(f"{folder}/cells.npy", cells)
    return {}


def peak():
    """Most bytes of memory that this process had so far."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def measure(work, folder):
    """Figures of one row."""
    own_cache()
    from qsmooth import Mesh, smooth

    if math.isfinite(free := free_memory()):
        most = int(max(free - LEFT_FREE, LEFT_FREE))
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    method, options = WORK[work]
    small = smooth(rough_grid(8), method, threads=1, max_sweeps=20)
    small.before, small.after  # noqa: B018 - summed up when asked for
    base = peak()
    points, cells = np.load(f"{folder}/points.npy"), np.load(f"{folder}/cells.npy")
    given, seconds = peak(), [processor_time()]
    mesh = Mesh(points, cells)
    seconds.append(processor_time())
    result = smooth(mesh, method, threads=1, **options)
    seconds.append(processor_time())
    reports = result.before, result.after
    seconds.append(processor_time())
    return {
        "quads": len(cells),
        "sweeps": result.sweeps,
        "stop": result.outcome.stop.value,
        "seconds": dict(zip(("mesh", "smooth", "reports"), np.diff(seconds), strict=True)),
        "bytes": {"base": base, "given": given, "peak": peak()},
        "worst": [report.worst["scaled_jacobian"] for report in reports],
    }


# ------------------------------------------------------------------------------- all of them


def run(full=False, most=LARGEST, say=print):
    """All rows, as plain values."""
    rows, sizes = [], (*SIZES, LARGEST) if full else SIZES
    bumps = (*BUMPS, LARGEST_BUMP) if full else BUMPS
    jobs = [(work, n) for work in ("star", "optimize") for n in sizes]
    jobs += [("bump", n) for n in bumps]
    found = {"machine": machine(), "rows": rows}
    for work, quads in jobs:
        if quads > most:
            continue
        with tempfile.TemporaryDirectory() as folder:
            question = {"task": "make", "work": work, "quads": quads, "folder": folder}
            done, why = ask("growth.py", question, limit=MORE)
            if done is not None:
                limit = MORE + WORK[work][1].get("time_limit", TIME_LIMIT)
                question = {"task": "measure", "work": work, "folder": folder}
                done, why = ask("growth.py", question, limit=limit)
        rows.append({"work": work, "quads": quads, **(done or {"why": why})})
        say("  ".join(line(rows[-1])), flush=True)
    return found


def line(row):
    """A row of the table, as texts."""
    if "why" in row:
        return [row["work"], f"{row['quads']:,}", row["why"], *[""] * (len(HEAD) - 3)]
    quads, seconds, held = row["quads"], row["seconds"], row["bytes"]
    return [
        row["work"],
        f"{quads:,}",
        str(row["sweeps"]),
        *(f"{seconds[key]:.3g}" for key in ("mesh", "smooth", "reports")),
        f"{1e9 * seconds['smooth'] / quads:.0f}",
        f"{(held['peak'] - held['base']) / quads:.0f}",
        f"{1e-9 * held['peak']:.2f}",
        row["stop"].replace("_", " "),
    ]


def plot(found, path):
    """Nanoseconds and bytes a quad over the number of quads."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 2)
    for work in WORK:
        rows = [row for row in found["rows"] if row["work"] == work and "why" not in row]
        quads = [row["quads"] for row in rows]
        whole = [1e6 * sum(row["seconds"].values()) / row["quads"] for row in rows]
        held = [(row["bytes"]["peak"] - row["bytes"]["base"]) / row["quads"] for row in rows]
        title = {"star": f"star, {SWEEPS} sweeps", "bump": "optimize, bump"}.get(work, work)
        faces = ["none" if row["stop"] == "time_limit" else None for row in rows]
        for part, values in zip(axes, (whole, held), strict=True):
            (drawn,) = part.plot(quads, values, "-", label=title)
            colour = drawn.get_color()
            part.scatter(quads, values, edgecolors=colour, c=[face or colour for face in faces])
    for part, words in zip(axes, ("microseconds a quad", "peak bytes a quad"), strict=True):
        part.set(xscale="log", yscale="log", xlabel="quads", ylabel=words)
        part.grid(alpha=0.3)
    axes[0].scatter([], [], edgecolors="grey", c="none", label="cut short by the time limit")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8)
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--full", action="store_true", help="to ten million quads")
    parser.add_argument("--most", type=int, default=LARGEST, help="quads at most")
    parser.add_argument("--json", type=Path, help="write all figures into this file")
    parser.add_argument("--plot", type=Path, help="write a figure into this file")
    parser.add_argument("--markdown", action="store_true", help="print a table for Markdown")
    parser.add_argument("--question", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.question:
        question = json.loads(options.question)
        answer({"make": make, "measure": measure}[question.pop("task")](**question))
        return
    if resource is None:
        raise SystemExit("memory can't be measured on this system")
    found = run(options.full, options.most)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.plot:
        plot(found, options.plot)
    if options.markdown:
        print("\n" + markdown(HEAD, [line(row) for row in found["rows"]]))
    print(machine_words(found["machine"]))


if __name__ == "__main__":
    main()
