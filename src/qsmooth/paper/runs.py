"""What the paper's methods make of its kinds of meshes, beside the paper's own numbers.

What is known of the paper's numbers is here and nowhere else. Its meshes are not public; the
packaged spiral and the lake are of the same outlines and sizes, and the spiral is as bad as the
paper's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from qsmooth.examples import lake, spiral
from qsmooth.mesh import Mesh
from qsmooth.metrics import Summary, quality
from qsmooth.result import SmoothResult
from qsmooth.smoothing import smooth

SWEEPS = 50
METHODS = ("laplacian", "star", "quad")
GIVEN = "given"
# Columns of the paper's table; aspect ratios are the largest and the mean, angles in degrees.
COLUMNS = ("seconds", "aspect_ratio", "mean_aspect_ratio", "max_angle", "min_angle")
Numbers = tuple[float | None, float | None, float | None, float | None, float | None]
KNOWN: dict[tuple[str, str], Numbers] = {
    ("spiral", GIVEN): (None, 59.8, 2.61, 180.0, 20.7),
    ("spiral", "laplacian"): (0.004, None, None, None, None),
    ("spiral", "star"): (1.5, 10.3, 1.86, 177.0, 15.9),
    ("spiral", "quad"): (3.6, 10.1, 1.91, 155.0, 18.8),
}
UNKNOWN: Numbers = (None, None, None, None, None)
# The paper's choices, as far as they are known, and the defaults here.
PAPER_STEP, PAPER_GUARD = 0.5, "clearance"
OUR_STEP, OUR_GUARD = 0.25, "quality"
# Other spirals of the same make, which tell how much hangs on the mesh.
SEEDS = range(8)

Row = dict[str, Any]


@dataclass(frozen=True)
class Runs:
    """All runs of the two meshes.

    Attributes
    ----------
    found
        What the page tells, as plain values: "sweeps", "rows" (as `row` makes them), "ways" (the
        spiral with either step and either guard), "seeds" (ranges over other spirals).
    meshes
        The given ones by name.
    results
        By name of mesh and method.
    plain
        Of the spiral with the paper's choices, by method.
    """

    found: dict[str, Any]
    meshes: dict[str, Mesh]
    results: dict[tuple[str, str], SmoothResult]
    plain: dict[str, SmoothResult]

    def stage(self, mesh: str, method: str) -> Mesh | SmoothResult:
        """Give a mesh as it came, or what a method made of it."""
        return self.meshes[mesh] if method == GIVEN else self.results[mesh, method]


def row(mesh: str, cells: int, method: str, summary: Summary, seconds: float | None) -> Row:
    """Put the numbers of the paper's table together for one mesh."""
    worst = summary.worst
    return {
        "mesh": mesh,
        "cells": cells,
        "method": method,
        "invalid": summary.n_invalid,
        "seconds": seconds,
        "aspect_ratio": worst["aspect_ratio"],
        "mean_aspect_ratio": summary.mean["aspect_ratio"],
        "max_angle": worst["max_angle"],
        "min_angle": worst["min_angle"],
    }


def text_of(column: str, value: float | None) -> str:
    """Write a number of the table; nothing where it is not known."""
    if value is None:
        return ""
    if column.endswith("angle"):
        return f"{value:.1f}°"
    return f"{value:.3g}"


def run(
    sizes: tuple[int, int] = (1900, 24_000),
    *,
    sweeps: int = SWEEPS,
    seeds: Sequence[int] = SEEDS,
    on_run: Callable[[str], None] = lambda _: None,
) -> Runs:
    """Make the paper's table, and measure what our numbers differ by and why.

    Parameters
    ----------
    sizes
        About how many quads the spiral and the lake have.
    sweeps
        Of each run.
    seeds
        Of other spirals.
    on_run
        Called with the name of each mesh before it is smoothed.
    """
    meshes = {"spiral": spiral(sizes[0]), "lake": lake(sizes[1])}
    rows, results = [], {}
    for name, mesh in meshes.items():
        on_run(name)
        rows.append(row(name, mesh.n_cells, GIVEN, quality(mesh).summary(), None))
        for method in METHODS:
            _sweep(mesh, method, 2)  # the first call compiles
            begin = time.process_time()
            result = _sweep(mesh, method, sweeps)
            seconds = time.process_time() - begin
            results[name, method] = result
            rows.append(row(name, mesh.n_cells, method, result.after, seconds))
    on_run("other spirals")
    ways, plain = _ways(meshes["spiral"], sweeps)
    others = _over_seeds(sizes[0], sweeps, seeds)
    found = {"sweeps": sweeps, "rows": rows, "ways": ways, "seeds": others, "n_seeds": len(seeds)}
    return Runs(found, meshes, results, plain)


def _sweep(mesh: Mesh, method: str, sweeps: int, **options: Any) -> SmoothResult:
    return smooth(mesh, method, max_sweeps=sweeps, rtol=0.0, threads=1, **options)


def _ways(mesh: Mesh, sweeps: int) -> tuple[list[Row], dict[str, SmoothResult]]:
    """Smooth the spiral with either step and either guard."""
    rows, plain = [], {}
    for method in ("star", "quad"):
        for step in (OUR_STEP, PAPER_STEP):
            for guard in (OUR_GUARD, PAPER_GUARD):
                result = _sweep(mesh, method, sweeps, step=step, guard=guard)
                rows.append(
                    row("spiral", mesh.n_cells, method, result.after, None)
                    | {"step": step, "guard": guard, "as_far": _as_far(method, result)}
                )
                if (step, guard) == (PAPER_STEP, PAPER_GUARD):
                    plain[method] = result
    return rows, plain


def _as_far(method: str, result: SmoothResult) -> int | None:
    """Count the sweeps after which the largest angle is and stays below the paper's last one."""
    theirs = KNOWN["spiral", method][COLUMNS.index("max_angle")]
    over = [k for k, record in enumerate(result.history, 1) if record.max_angle > (theirs or 0.0)]
    sweeps = (over[-1] if over else 0) + 1
    return sweeps if sweeps <= len(result.history) else None


def _over_seeds(size: int, sweeps: int, seeds: Sequence[int]) -> dict[str, dict[str, list[float]]]:
    """Ranges of the numbers over other spirals, given and by the paper's choices."""
    found: dict[str, list[Row]] = {GIVEN: [], "star": [], "quad": []}
    for seed in seeds:
        mesh = spiral(size, seed=seed)
        found[GIVEN].append(row("", mesh.n_cells, GIVEN, quality(mesh).summary(), None))
        for method in ("star", "quad"):
            result = _sweep(mesh, method, sweeps, step=PAPER_STEP, guard=PAPER_GUARD)
            found[method].append(row("", mesh.n_cells, method, result.after, None))
    return {
        method: {
            column: [min(r[column] for r in rows), max(r[column] for r in rows)]
            for column in COLUMNS[1:]
        }
        for method, rows in found.items()
    }
